"""The voices: each is of one split, has a model, repeats for a seed, differs between seeds, and is never silent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import UsageError
from generators.assets.sounds import SECOND_FLOOR_DB, TARGET_LUFS, Voice, find_voice, synthesise, voices
from generators.assets.sounds.capture import captured
from generators.assets.sounds.loudness import integrated_loudness
from generators.manifest.reading import read_manifest
from generators.observation.sources import choose_signal
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans
from tests.support.homes import write_manifest
from tests.support.tiers import some

SR = 44_100
ALL = [voice for category in CATEGORIES for voice in voices(category)]
#: Largest share of a voice's energy above 16 kHz.
TOP_SHARE = 0.006


def name_of(voice: Voice) -> str:
    return f"{voice.category}/{voice.name}"


@pytest.mark.parametrize("category", CATEGORIES)
def test_a_category_has_at_least_twelve_devices_of_known_and_new_mechanisms(category: str) -> None:
    found = voices(category)
    splits = [voice.split for voice in found]
    assert splits.count("train") >= 8
    assert (splits.count("validation"), splits.count("test")) == (1, 3)
    assert len({voice.name for voice in found}) == len({voice.play for voice in found}) == len(found)
    assert len({voice.mechanism for voice in found}) >= 3
    assert all(voice.category == category and voice.source and voice.kind == "synthesised" for voice in found)
    trained, tested = ({voice.mechanism for voice in found if voice.split == split} for split in ("train", "test"))
    assert len(tested) >= 2
    assert tested - trained
    # Clocks for tests have mechanisms of their own names, though their parts are those of clocks for training.
    assert tested & trained or category == "clock"


@pytest.mark.parametrize(
    "voice",
    some(ALL, every=10),
    ids=name_of,
)
def test_a_take_follows_its_seed(voice: Voice) -> None:
    first, again, other = (voice.play(SR + 7, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.shape == (SR + 7,)
    assert first.dtype == np.float64
    assert np.isfinite(first).all()
    assert first.tobytes() == again.tobytes()
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("voice", ALL, ids=name_of)
def test_a_voice_repeats_for_a_seed_is_never_silent_and_has_no_seam_of_silence(voice: Voice) -> None:
    short, again, other = (
        synthesise(voice.category, 1, np.random.default_rng(seed), one)
        for seed, one in ((3, voice), (3, voice.name), (4, voice))
    )
    assert short.tobytes() == again.tobytes()
    assert np.corrcoef(short, other)[0, 1] < 0.5
    samples = synthesise(voice.category, 12, np.random.default_rng(3), voice)
    assert integrated_loudness(np.float64(samples), SR) == pytest.approx(TARGET_LUFS, abs=1.0)
    levels = 10 * np.log10(np.mean(np.square(np.float64(samples).reshape(12, SR)), axis=1))
    assert levels.min() > SECOND_FLOOR_DB
    # No silence between events: in every 50 ms there is the room of the voice or the floor of the capture.
    moments = np.square(np.float64(samples[: 240 * 2205]).reshape(240, 2205)).mean(axis=1)
    assert 10 * np.log10(moments.min() / moments.mean()) > -65.0
    # No device of these has more above 16 kHz (docs/sounds.md, Bandwidth and floor).
    power = np.abs(np.fft.rfft(np.float64(samples))) ** 2
    assert power[np.fft.rfftfreq(len(samples), 1 / SR) > 16_000].sum() < TOP_SHARE * power.sum()


def test_a_length_of_one_second_works_too() -> None:
    for category in CATEGORIES:
        assert synthesise(category, 1, np.random.default_rng(0), voices(category)[0]).shape == (SR,)


def test_unknown_voices_are_one_line() -> None:
    with pytest.raises(UsageError, match=r"^clock has no voice 'sundial'; expected one of longcase, "):
        find_voice("clock", "sundial")
    with pytest.raises(UsageError, match="did you mean 'clock'"):
        voices("clok")


def test_a_capture_ends_the_spectrum_and_puts_a_floor_under_silence() -> None:
    rng = np.random.default_rng(5)
    burst = rng.standard_normal(2 * SR) * (np.arange(2 * SR) < SR)
    ends, floors = [], []
    for seed in range(12):
        heard = captured(burst, np.random.default_rng(seed))
        power = np.abs(np.fft.rfft(heard[:SR])) ** 2
        total = np.cumsum(power) / power.sum()
        ends.append(float(np.searchsorted(total, 0.98)))
        floors.append(10 * np.log10(np.mean(np.square(heard[-SR // 2 :])) / np.mean(np.square(heard[:SR]))))
    assert 3000 < min(ends) < 8000
    assert max(ends) > 14_000
    assert -66 < min(floors) < max(floors) < -30
    assert np.ptp(floors) > 10
    assert not captured(np.zeros(SR), np.random.default_rng(0)).any()


def test_a_voice_that_falls_silent_has_the_floor_of_its_capture() -> None:
    """Devices have a room of their own, mostly above the capture's floor: this one has none."""

    def burst(count: int, rng: Generator) -> NDArray[np.float64]:
        return rng.standard_normal(count) * (np.arange(count) % SR < SR // 2)

    device = Voice.of("clock", burst, "train", "a burst in each second", "none")
    for seed in range(6):
        samples = np.float64(synthesise("clock", 2, np.random.default_rng(seed), device)).reshape(2, 2, SR // 2)
        loud, quiet = np.square(samples[:, :, SR // 8 :]).mean(axis=(0, 2))
        assert -66 < 10 * np.log10(quiet / loud) < -30


# --- in a manifest ----------------------------------------------------------------------------------------------------


def plans(folder: Path, **changes: Any) -> dict[str, ObservationPlan]:
    """Plans of a microwave in part_1 and of clocks in part_2, by category."""
    found = make_plans(read_manifest(write_manifest(folder, **changes)), GenerateOptions(audio="analytic"))
    return {str(plan.spec.category): plan for plan in found}


@pytest.mark.slow
def test_a_source_plays_one_of_its_voices_and_its_record_names_it(tmp_path: Path) -> None:
    plain = plans(tmp_path)
    voiced, again = (plans(tmp_path, voices={"clock": ["wall_quartz", "flip"]}) for _ in range(2))
    signal = choose_signal(voiced["clock"], "clock")
    assert signal.asset in {"procedural:clock/wall_quartz", "procedural:clock/flip"}
    assert signal.samples.tobytes() == choose_signal(again["clock"], "clock").samples.tobytes()
    old = choose_signal(plain["clock"], "clock")
    assert old.asset == "procedural:clock"
    assert old.samples.tobytes() != signal.samples.tobytes()
    # Only what hears a category depends on its voices, and pictures never do.
    assert voiced["clock"].digest != plain["clock"].digest
    assert voiced["microwave"].digest == plain["microwave"].digest
    assert voiced["clock"].pictures_digest == plain["clock"].pictures_digest


@pytest.mark.slow
def test_both_voices_of_a_manifest_are_drawn(tmp_path: Path) -> None:
    names = {"microwave": ["popcorn", "timer_bell"]}
    drawn = [plans(tmp_path, voices=names, seed=seed)["microwave"] for seed in range(8)]
    heard = {choose_signal(plan, "microwave").asset for plan in drawn}
    assert heard == {"procedural:microwave/popcorn", "procedural:microwave/timer_bell"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"voices": {"clock": ["sundial"]}}, "tiny: voices: clock has no voice 'sundial'; expected one of longcase"),
        ({"voices": {"clock": ["flip", "flip"]}}, "'flip' is listed twice"),
        ({"voices": {"clock": []}}, "voices.clock"),
        (
            {
                "voices": {"clock": ["flip"]},
                "sounds": {"clock": [{"file": "a.wav", "licence": {"name": "CC0-1.0", "author": "a"}}]},
            },
            "the files in sounds replace the voices of clock; leave out one of both",
        ),
    ],
)
def test_wrong_voices_are_one_line(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as error:
        plans(tmp_path, **changes)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
