"""Training frames dubbed with dry sounds: excerpts, responses in the store, plans, what is heard, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import soundfile
from click.testing import CliRunner
from scipy.signal import fftconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import write_webdataset
from tests.support.needs import need

torch = pytest.importorskip("torch", reason="torch is not installed: the listener cannot run")
need("lightning_fabric", reason="lightning-fabric is not installed: the listener cannot be trained")

from baselines.listener import augment, dry, shards  # noqa: E402
from baselines.listener.batches import UNKNOWN, Sampler  # noqa: E402
from tests.support import tiny_scenes  # noqa: E402
from tests.support.tiny_listener import SMALL  # noqa: E402

torch.set_num_threads(1)
MICROWAVE, TELEPHONE = CATEGORIES.index("microwave"), CATEGORIES.index("telephone")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shards of two pictures with five sounds each, and their impulse responses."""
    folder = tmp_path_factory.mktemp("dubbed")
    tiny_scenes.write_part_3(folder / "set", frames=2, size=64, rirs=True)
    write_webdataset(folder / "set", folder / "shards", extras=["rirs"], workers=1)
    return folder / "shards"


@pytest.fixture(scope="module")
def store(data: Path) -> shards.ShardStore:
    return shards.read_store(data, data.parent / "store", workers=1)


@pytest.fixture(scope="module")
def sounds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three excerpts of noise each for the microwave and the telephone."""
    path = tmp_path_factory.mktemp("dry") / "dry.npz"
    noise = np.random.default_rng(0).normal(0, 0.1, (6, dry.EXCERPT)).astype(np.float16)
    dry.write_dry(path, noise, [MICROWAVE] * 3 + [TELEPHONE] * 3)
    return path


def test_what_is_heard_is_the_second_half_of_the_convolution() -> None:
    rng = np.random.default_rng(1)
    source, response = rng.normal(size=dry.EXCERPT), rng.normal(size=(2, SAMPLE_RATE)) * np.exp(-np.arange(44100) / 9e3)
    heard = augment.heard_through(torch.from_numpy(source)[None], torch.from_numpy(response)[None])
    expected = fftconvolve(source[None], response, axes=1)[:, SAMPLE_RATE : 2 * SAMPLE_RATE]
    np.testing.assert_allclose(heard[0], expected, atol=1e-9)


def test_frames_with_one_audible_source_have_its_response(data: Path, store: shards.ShardStore) -> None:
    dataset = Dataset(data.parent / "set")
    frames = {f"{key}/{frame.name}": frame for key in tiny_scenes.GROUP for frame in dataset[key].frames}
    assert any(store.table.has_response)
    for number, key in enumerate(store.table.keys):
        one = len(store.table.audible[number]) == 1 and not store.table.others[number]
        assert not store.table.has_response[number] or one
        found = np.asarray(store.responses[number], np.float64)
        if not store.table.has_response[number]:
            assert not found.any()
            continue
        expected = frames[key].impulse_response("source_1")[:, :SAMPLE_RATE]
        assert np.abs(found).max() == pytest.approx(1.0, abs=1e-3)
        np.testing.assert_allclose(found[:, : expected.shape[1]], expected / np.abs(expected).max(), atol=1e-3)
    silent = [number for number, key in enumerate(store.table.keys) if key.startswith(tiny_scenes.SILENT)]
    both = [number for number, key in enumerate(store.table.keys) if key.startswith(tiny_scenes.BOTH)]
    assert not any(store.table.has_response[number] for number in silent + both)


def test_half_of_the_sounds_with_a_response_are_dubbed_with_sounds_of_their_category(
    store: shards.ShardStore, sounds: Path
) -> None:
    assert (Sampler(store, 2).plan(0).dubs == -1).all()  # without dry sounds
    sampler = Sampler(replace(store, dry=dry.read_dry(sounds)), 2)
    possible = dubbed = 0
    for step in range(40):
        plan = sampler.plan(step)
        for sound, dub in zip(plan.sounds.ravel(), plan.dubs.ravel(), strict=True):
            if sound < 0 or not store.table.has_response[sound]:
                assert dub == -1
                continue
            possible, dubbed = possible + 1, dubbed + (dub >= 0)
            if dub >= 0:
                assert store.table.audible[sound] == ["microwave" if dub < 3 else "telephone"]
    assert 0.35 < dubbed / possible < 0.65
    np.testing.assert_array_equal(sampler.plan(3).dubs, Sampler(sampler.store, 2).plan(3).dubs)


def test_a_dubbed_sound_is_heard_through_the_response_at_the_level_of_the_frame(
    store: shards.ShardStore, sounds: Path
) -> None:
    known = dry.read_dry(sounds)
    bank, sampler = augment.Bank(replace(store, dry=known), torch.device("cpu")), Sampler(replace(store, dry=known), 2)
    plan = next(plan for plan in map(sampler.plan, range(40)) if (plan.dubs[:, 0] >= 0).any())
    none = np.full_like(plan.dubs, -1)
    plain = replace(plan, dubs=none, sounds=np.stack([plan.sounds[:, 0], none[:, 0]], axis=1))
    own = bank.gather(plain, None).sounds.numpy()
    heard = bank.gather(replace(plain, dubs=plan.dubs), None).sounds.numpy()
    for row, dub in enumerate(plan.dubs[:, 0]):
        if dub < 0:
            np.testing.assert_array_equal(heard[row], own[row])
            continue
        response = np.asarray(store.responses[plan.sounds[row, 0]], np.float64)
        expected = fftconvolve(np.asarray(known.samples[dub], np.float64)[None], response, axes=1)
        expected = expected[:, SAMPLE_RATE : 2 * SAMPLE_RATE]
        expected *= np.sqrt(np.mean(np.square(own[row])) / np.mean(np.square(expected)))
        np.testing.assert_allclose(heard[row], expected, atol=2e-3 * np.abs(expected).max())


def test_a_third_of_the_sounds_that_are_not_dubbed_come_from_a_file_of_a_codec(
    store: shards.ShardStore, sounds: Path
) -> None:
    """Unless the run leaves `codec` out, and never where nothing is drawn at random."""
    dubbing = replace(store, dry=dry.read_dry(sounds))
    bank, sampler = augment.Bank(dubbing, torch.device("cpu")), Sampler(dubbing, 2)
    plans = [sampler.plan(step) for step in range(40)]
    own = np.concatenate([plan.coded[(plan.sounds >= 0) & (plan.dubs < 0)] for plan in plans])
    assert 0.25 < own.mean() < 0.45
    assert not any((plan.coded & ((plan.sounds < 0) | (plan.dubs >= 0))).any() for plan in plans)
    for plan in plans:
        first = plan.sounds[:, 0]
        heard = bank._mixed(replace(plan, sounds=np.stack([first, np.full_like(first, -1)], axis=1)), None, coded=True)
        for row in np.flatnonzero((first >= 0) & (plan.dubs[:, 0] < 0)):
            expected = (store.coded if plan.coded[row, 0] else store.sounds)[first[row]]
            np.testing.assert_array_equal(heard[row].numpy(), np.asarray(expected, np.float32))
    plan = next(plan for plan in plans if plan.coded.any())
    same = replace(plan, coded=np.zeros_like(plan.coded))
    assert torch.equal(bank.gather(plan, None).sounds, bank.gather(same, None).sounds)
    left_out = [bank.gather(each, torch.Generator().manual_seed(0), ("codec",)).sounds for each in (plan, same)]
    assert torch.equal(*left_out)


def test_stored_files_of_codecs_sound_like_their_originals(store: shards.ShardStore) -> None:
    for number, level in enumerate(np.abs(np.asarray(store.sounds, np.float64)).max(axis=(1, 2))):
        one, other = np.asarray(store.sounds[number], np.float64), np.asarray(store.coded[number], np.float64)
        if level > 1e-3:
            error = np.square(one - other).mean() / np.square(one).mean()
            assert 1e-4 < error < 0.95


def test_a_sound_of_no_class_is_never_dubbed(store: shards.ShardStore, sounds: Path) -> None:
    others = [True] * len(store.table.others)
    unknown = replace(store, table=replace(store.table, others=others), dry=dry.read_dry(sounds))
    for step in range(5):
        plan = Sampler(unknown, 2).plan(step)
        assert plan.audible[:, UNKNOWN].any()
        assert (plan.dubs == -1).all()


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "dry.npz"
    with pytest.raises(
        Avs3dError, match=r"dry.npz: cannot be read .*; expected dry sounds \(python -m benchmarks.list"
    ):
        dry.read_dry(path)
    path.write_bytes(b"nothing")
    with pytest.raises(Avs3dError, match="cannot be read"):
        dry.read_dry(path)
    dry.write_dry(path, np.zeros((2, 100), np.float16), [0, 1])
    with pytest.raises(Avs3dError, match=r"float16 samples of shape \(2, 100\); expected dry sounds"):
        dry.read_dry(path)
    dry.write_dry(path, np.zeros((1, dry.EXCERPT), np.float16), [7])
    with pytest.raises(Avs3dError, match="a category has a number beyond the 7"):
        dry.read_dry(path)


def test_excerpts_are_of_voices_for_training_and_sound_in_their_second_half() -> None:
    from benchmarks.listener_dry import excerpts

    first, other = excerpts((MICROWAVE, "turntable_transformer", 0)), excerpts((MICROWAVE, "turntable_transformer", 1))
    assert first.dtype == np.float16
    assert first.shape[1] == dry.EXCERPT
    levels = np.sqrt(np.mean(np.square(first[:, SAMPLE_RATE:].astype(float)), axis=1))
    assert (levels > 0.05 * levels.max()).all()
    np.testing.assert_array_equal(first, excerpts((MICROWAVE, "turntable_transformer", 0)))
    assert not np.array_equal(first[0], other[0])


def test_excerpts_of_a_recording_are_of_its_sounding_places_and_it_is_credited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording that is silent in its second half: excerpts are of the first, each at a speed of its own."""
    from benchmarks import listener_dry
    from generators.library.lock import read_lock

    store = listener_dry.Store(tmp_path / "store")
    monkeypatch.setattr(listener_dry.Store, "default", lambda: store)
    lock = read_lock(listener_dry.MANIFESTS / listener_dry.LOCK_NAME)
    first = next(each for each in lock.assets if each.kind == "sound" and each.split == "train")
    tone = 0.3 * np.sin(2 * np.pi * 1000 * np.arange(12 * SAMPLE_RATE) / SAMPLE_RATE)
    tone[6 * SAMPLE_RATE :] = 0
    data = BytesIO()
    soundfile.write(data, tone, SAMPLE_RATE, format="WAV")
    sha256, size = store.put(first.id, "sound.wav", data.getvalue())
    entry = first.model_copy(update={"sha256": sha256, "bytes": size, "file": "sound.wav", "trim": None})
    known = lock.model_copy(update={"assets": [entry]})
    monkeypatch.setattr(listener_dry, "read_lock", lambda _: known)
    monkeypatch.setattr(listener_dry, "voices", lambda _: ())
    found = CliRunner().invoke(
        listener_dry.main, ["-o", str(tmp_path / "dry.npz"), "--recorded", "6", "--workers", "1"]
    )
    assert found.exit_code == 0, found.output
    made = dry.read_dry(tmp_path / "dry.npz")
    assert [CATEGORIES[number] for number in made.categories] == [entry.category] * 6
    assert [(each.asset, each.author, each.name) for each in made.credits] == [(entry.id, entry.author, entry.licence)]
    heard = made.samples[:, SAMPLE_RATE:].astype(float)
    assert (np.sqrt(np.mean(heard**2, axis=1)) > 0.01).all()
    pitches = np.abs(np.fft.rfft(heard)).argmax(axis=1)
    assert len(set(pitches)) > 3
    assert all(1000 / listener_dry.FASTER - 3 <= pitch <= 1000 * listener_dry.FASTER + 3 for pitch in pitches)


@pytest.mark.slow
def test_the_command_dubs_and_the_card_says_with_what(
    data: Path, sounds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from baselines.listener import job, steps
    from baselines.listener.cli import train

    monkeypatch.setitem(job.SIZES, "small", SMALL)
    monkeypatch.setattr(steps, "SETTLING_STEPS", 2)
    options = ["--steps", "2", "--batch-size", "4", "--precision", "fp32", "--accelerator", "cpu", "--workers", "1",
               "--size", "small", "--dry", str(sounds)]  # fmt: skip
    run = ["listener", "--data", str(data), "-o", str(tmp_path / "run"), *options]
    found = CliRunner().invoke(train, run, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    card = json.loads((tmp_path / "run" / "model_card.json").read_text())
    assert card["training"]["dry_sounds"] == dry.read_dry(sounds).digest
    assert (
        f"dubbed with the dry sounds of sha256 `{card['training']['dry_sounds']}`"
        in (tmp_path / "run" / "model_card.md").read_text()
    )
    plain = tmp_path / "plain"
    write_webdataset(data.parent / "set", plain, workers=1)
    with pytest.raises(UsageError, match=r"no frame of .*plain has an impulse response; make them --with rirs"):
        CliRunner().invoke(
            train, ["listener", "--data", str(plain), "-o", str(tmp_path / "other"), *options], catch_exceptions=False
        )
