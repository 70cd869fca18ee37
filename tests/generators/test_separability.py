"""The separability table: what its networks' spectra go through, and what neighbours and networks know of a sound."""

from __future__ import annotations

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from benchmarks import separability, separability_choice
from benchmarks.separability_network import MELS, Network, Training, band_of, changed, log_mel, seen

torch: Any = pytest.importorskip("torch")

#: Nothing is changed.
PLAIN = Training(response_db=0.0, ends=0.0, floors=0.0, shift=0.0, hidden_time=0.0)


def spectra(count: int, level: float = 0.0) -> Any:
    """Even spectra (count, 1, MELS, 20)."""
    return torch.full((count, 1, MELS, 20), level)


def test_nothing_changes_without_a_change() -> None:
    torch.manual_seed(0)
    batch = torch.randn(4, 1, MELS, 20)
    assert torch.equal(changed(batch, spectra(1), PLAIN), batch)


def test_spectra_end_above_the_lowest_end_and_begin_below_300_hz() -> None:
    torch.manual_seed(0)
    out = changed(spectra(200), spectra(1), replace(PLAIN, ends=1.0, begins=1.0, end_hz=3000.0))
    hidden = (out == -10.0).all(dim=3)[:, 0].float().mean(dim=0).numpy()
    assert not hidden[int(band_of(300.0)) + 1 : int(band_of(3000.0))].any()
    assert hidden[-1] > 0.9
    assert hidden[0] > 0.9
    assert 0.2 < hidden[round((band_of(3000.0) + MELS) / 2)] < 0.8


def test_a_floor_has_its_level_below_the_clip() -> None:
    torch.manual_seed(0)
    batch = spectra(100)
    batch[:, :, :, 10:] = -9.0
    out = changed(batch, spectra(1), replace(PLAIN, floors=1.0, floor_db=(-40.0, -40.0)))
    silent = (out[:, :, :, 10:] * np.log(10)).exp().mean(dim=(1, 2, 3))
    # The clip's power is that of its loud half.
    np.testing.assert_allclose(10 * np.log10(silent.numpy()), -43.0, atol=0.1)
    assert out[:, :, :, 10:].mean(dim=3).std() > 0.3, "floors have different slopes"
    np.testing.assert_allclose(out[:, :, :, :10].numpy(), 0.0, atol=0.02)


def test_a_shift_moves_all_bands_alike() -> None:
    torch.manual_seed(1)
    batch = torch.arange(MELS).view(1, 1, -1, 1) * torch.ones(5, 1, MELS, 4)
    moved = (changed(batch, spectra(1), replace(PLAIN, shift=2.0)) - batch)[:, :, 12:-12]
    assert moved.std(dim=2).max() < 1e-4
    assert moved.mean(dim=2).abs().min() > 0.01


def test_what_a_network_sees_has_no_level_and_nothing_below_its_depth() -> None:
    training = replace(PLAIN, depth_db=50.0)
    torch.manual_seed(2)
    batch = torch.randn(3, 1, MELS, 20)
    assert torch.allclose(seen(batch, training), seen(batch + 2.0, training), atol=1e-4)
    deep = torch.where(torch.arange(MELS).view(1, 1, -1, 1) > 40, -7.0, batch)
    deeper = torch.where(torch.arange(MELS).view(1, 1, -1, 1) > 40, -10.0, batch)
    assert torch.allclose(seen(deep, training), seen(deeper, training))
    assert not torch.allclose(seen(deep, training), seen(batch, training))


def test_a_network_learns_what_differs_and_not_the_response() -> None:
    """Noise that swings and noise that does not; those asked about have another response."""
    rng = np.random.default_rng(0)
    clips = rng.standard_normal((96, 44_100))
    labels = np.arange(96) % 2
    clips[labels == 1] *= 1 + 0.9 * np.sin(2 * np.pi * 8 * np.arange(44_100) / 44_100)
    mel = log_mel(clips)
    network = Network(mel[:64], labels[:64], Training(epochs=40, width=4))
    dull = mel[64:] - np.linspace(0, 2, MELS, dtype=np.float32)[:, None]
    answers = network.probabilities(dull)
    np.testing.assert_allclose(answers.sum(axis=1), 1.0, atol=1e-5)
    assert (answers.argmax(axis=1) == labels[64:]).mean() > 0.9
    loud_above = np.where(np.arange(MELS)[:, None] > band_of(4000.0), 3.0, dull).astype(np.float32)
    assert np.array_equal(network.probabilities(loud_above, 4000.0), network.probabilities(dull, 4000.0))
    assert not np.array_equal(network.probabilities(loud_above, 8200.0), network.probabilities(dull, 8200.0))


def test_the_chosen_network_alone_is_asked_about_tests(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rng, asked_about = np.random.default_rng(0), []

    def noise(split: str) -> separability.Clips:
        names = [f"{category}/{split}_{n}/0/dry" for category in CATEGORIES for n in range(4)]
        samples = rng.standard_normal((len(names), SAMPLE_RATE)).astype(np.float32)
        return separability.Clips(samples, np.repeat(np.arange(len(CATEGORIES)), 4), names)

    def voices_of(split: str, seed: int, units: int, workers: int | None) -> list[separability.Clips]:
        asked_about.append((split, seed, units))
        return [noise(split)]

    small = {name: replace(PLAIN, epochs=1, width=2, asked_hz=hz) for name, hz in (("all", 20_000.0), ("low", 4000.0))}
    monkeypatch.setattr(separability_choice, "CANDIDATES", small)
    monkeypatch.setattr(separability_choice, "of_voices", voices_of)
    monkeypatch.setattr(separability_choice, "of_lock", lambda split, seed: noise(split))
    monkeypatch.setattr(separability_choice, "of_recordings", lambda folder, seed: noise("heard"))
    monkeypatch.setattr(separability, "NETWORKS", 1)
    out = tmp_path / "choice.json"
    words = ["-o", str(out), "--units", "2", "--asked", "1", "--workers", "1"]
    separability_choice.main(words)
    assert [split for split, _, _ in asked_about] == ["train", "validation"], "no test voice without --recordings"
    alone = json.loads(out.read_text())
    separability_choice.main([*words, "--recordings", str(tmp_path)])
    assert asked_about[-1] == ("test", 2, 1)
    found = json.loads(out.read_text())
    assert set(alone["shares"]) == set(alone["scores"]) == set(small)
    assert found["chosen"] == max(small, key=lambda name: found["scores"][name])
    assert set(found["network"]) == {"validation", "test", "recordings"}
    table = separability.shares_table({"network": found["network"]})
    assert all(cell for row in table for cell in row)


def test_of_each_category_as_many_voices_are_held_back_others_with_another_seed() -> None:
    voices = np.repeat([f"{category}/{n}" for category in CATEGORIES for n in range(5)], 2)
    first, second = (separability_choice.held_back(voices, seed) for seed in separability_choice.SEEDS)
    assert first.sum() == second.sum() == 2 * len(CATEGORIES) * separability_choice.HELD
    assert (first != second).any()
    assert all(here.reshape(-1, 2).std() == 0 for here in (first[:2], first[2:4]))
    for category in CATEGORIES:
        assert len(set(voices[first & np.char.startswith(voices, category)])) == separability_choice.HELD


def test_the_candidate_is_chosen_whose_weakest_set_is_best() -> None:
    uneven, even = {"held back": 0.9, "recordings": 0.4}, {"held back": 0.6, "recordings": 0.5}
    name, scores = separability_choice.best({"uneven": {0: uneven, 1: uneven}, "even": {0: even, 1: even}})
    assert (name, scores) == ("even", {"uneven": 0.4, "even": 0.5})


def test_candidates_that_differ_in_what_is_asked_share_a_network(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, count = np.random.default_rng(0), 7 * 4
    names = [f"{category}/{n}/0/dry" for category in CATEGORIES for n in range(4)]
    train = separability.Clips(np.zeros((count, 1), np.float32), np.repeat(np.arange(7), 4), names)
    mel = rng.normal(size=(count, MELS, 96)).astype(np.float32)
    made: list[Network] = []

    def counted(*of: Any) -> Network:
        made.append(Network(*of))
        return made[-1]

    monkeypatch.setattr(separability_choice, "Network", counted)
    asked, asked_hz = {"validation": (train.labels, [mel, mel])}, {"all": 20_000.0, "low": 4000.0}
    found = separability_choice.measured(train, mel, asked, Training(epochs=1, width=2), asked_hz, 0)
    assert len(made) == 1
    assert {name: set(sets) for name, sets in found.items()} == {key: {"held back", "validation"} for key in asked_hz}
    assert all(0 <= share <= 1 for sets in found.values() for share in sets.values())
    low = made[0].probabilities(mel, 4000.0).argmax(axis=1) == train.labels
    assert found["low"]["validation"] == pytest.approx(np.mean([low[train.labels == n].mean() for n in range(7)]))


def test_recordings_of_a_split_are_those_in_the_store_each_with_as_many_excerpts_as_a_voice_has_units(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = separability.Store(tmp_path)
    monkeypatch.setattr(separability.Store, "default", lambda: store)
    lock = separability.read_lock(separability.MANIFESTS / separability.LOCK_NAME)
    with pytest.raises(Avs3dError, match="no recording of the split train; bring them"):
        separability.of_lock("train", 0, 2)
    entries = []
    for entry in [each for each in lock.assets if each.kind == "sound" and each.split == "train"][:2]:
        noise, data = np.random.default_rng(0).normal(0, 0.1, 3 * 44100), BytesIO()
        soundfile.write(data, noise, 44100, format="WAV")
        sha256, size = store.put(entry.id, "sound.wav", data.getvalue())
        entries.append(
            entry.model_copy(update={"sha256": sha256, "bytes": size, "file": "sound.wav", "trim": (0.0, 2.5)})
        )
    known = lock.model_copy(update={"assets": [*entries, *lock.assets]})
    monkeypatch.setattr(separability, "read_lock", lambda _: known)
    several, once = separability.of_lock("train", 0, 2), separability.of_lock("train", 0)
    for entry in entries:
        assert {name.rsplit("/", 1)[0] for name in several.names if entry.id in name} == {
            f"{entry.category}/{entry.id}/{n}" for n in "01"
        }
    assert {len(clips.names) for clips in (several, once)} == {80, 8}, "2 × 2 × 2 × 10 s, and 2 × 2 × 2.5 s"
    assert {CATEGORIES[label] for label in several.labels} == {entry.category for entry in entries}
    both = separability.joined([several, once])
    assert (len(both.samples), both.names) == (88, several.names + once.names)


def test_who_is_asked_is_asked_dry_and_reverberant_and_the_verdict_has_both() -> None:
    asked = separability._of_voice((5, "longcase", (1,), 1))
    assert set(asked.names) == {f"clock/longcase/0/{state}" for state in separability.STATES}
    levels = np.sqrt(np.mean(np.square(asked.samples), axis=1))
    np.testing.assert_allclose(levels, 1.0, atol=1e-5)
    dry = asked.states == "dry"
    # Every dry second is right, of the reverberant ones none.
    answers = np.eye(len(CATEGORIES))[np.where(dry, 5, 0)]
    found = separability.verdict(answers, asked)
    assert found["dry"] == {"seconds": 1.0, "takes": 1.0}
    assert found["reverberant"] == {"seconds": 0.0, "takes": 0.0}
    assert found["seconds"] == pytest.approx(dry.mean())
    assert found["takes"] == 0.5
    assert found["by_voice"] == {"clock/longcase": pytest.approx(dry.mean())}
    report = {"network": {"test": {"whole": found}}}
    assert separability.shares_table(report) == [["network", "test", f"{dry.mean():.2f} (0.50)", "", "", ""]]
    assert separability.states_table(report) == [["network", "test", "1.00 (1.00)", "0.00 (0.00)"]]


def test_textures_know_drops_from_rushing_air_of_one_spectrum_and_no_level() -> None:
    rng = np.random.default_rng(5)
    air = rng.standard_normal((8, SAMPLE_RATE))
    drops = np.where(rng.random(air.shape) < 0.0005, air, 0.0)
    of_air, of_drops = (separability._texture(each, 512).mean(axis=0) for each in (air, drops))
    np.testing.assert_allclose(separability._texture(30.0 * air, 512).mean(axis=0), of_air, atol=1e-3)
    # A sum of powers varies less than one, whose root has the variation of a Rayleigh distribution, 0.52.
    assert np.exp(of_air[:24]).max() < 0.52 + 0.04
    assert (of_drops[24:48] > of_air[24:48] + 0.5).all(), "skewness"
    assert (of_drops[48:72] > of_air[48:72] + 0.2).all(), "kurtosis"


def test_bands_that_swing_together_are_known() -> None:
    air = np.random.default_rng(7).standard_normal((8, SAMPLE_RATE))
    gusts = air * (1.0 + np.sin(2 * np.pi * 12 * np.arange(SAMPLE_RATE) / SAMPLE_RATE))
    alone, together = (separability._texture(each, 2048)[:, 72:].mean(axis=0) for each in (air, gusts))
    assert np.abs(alone).max() < 0.25
    assert together.min() > 0.4


def test_a_band_that_was_filtered_away_has_no_texture() -> None:
    low = separability.low_pass(1000.0)(np.random.default_rng(6).standard_normal(SAMPLE_RATE))[None]
    skewness, kurtosis = (separability._texture(low, 512)[0, begin : begin + 24] for begin in (24, 48))
    above = separability.TEXTURE_EDGES[:-1] > 8000.0
    assert np.abs(skewness[above]).max() < 0.5
    assert kurtosis[above].max() < np.log1p(4.0)
    assert kurtosis[separability.TEXTURE_EDGES[1:] < 1000.0].min() > np.log1p(2.0)
