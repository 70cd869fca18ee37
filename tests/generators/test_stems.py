"""Sources of part_3: programmes to the sample, stems, what is audible, direct sound against the engine's own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.geometry import Pose
from generators.acoustics.analytic import AnalyticBackend
from generators.acoustics.direct import DirectPath
from generators.manifest.schema import SHORTEST_SOUND, BurstsSpec, ProgrammeSpec, TurnSpec
from generators.observation.programme import RAMP, gated, intervals_of
from generators.observation.stems import Stem, audible_sources, direct_to_reverberant, mixture
from tests.support.acoustic_rooms import box_scene, with_absorption

PRE_ROLL = 2.0
RAMP_SAMPLES = round(RAMP * SAMPLE_RATE)


def intervals(programme: ProgrammeSpec | None, seconds: float = 20.0, seed: int = 0) -> tuple[tuple[float, float], ...]:
    return intervals_of(programme, seconds, PRE_ROLL, np.random.default_rng(seed))


def clip(amplitude: float, seed: int = 0) -> np.ndarray:
    """Noise of that RMS."""
    noise = np.random.default_rng(seed).standard_normal((2, SAMPLE_RATE))
    return (noise * amplitude / np.sqrt(np.mean(noise**2))).astype(np.float32)


# Programmes


def test_always_begins_before_the_first_frame() -> None:
    assert intervals(None) == ((-PRE_ROLL, 20.0),)


def test_the_shortest_interval_may_be_a_rounded_difference() -> None:
    assert SHORTEST_SOUND > 0.15 - 0.1
    programme = ProgrammeSpec(intervals=((0.1, 0.15),))
    assert intervals(programme) == ((0.1, 0.15),)


def test_turns_fill_the_time_without_overlap() -> None:
    first, second = (
        intervals(ProgrammeSpec(turn=TurnSpec(number=number, of=2, seconds=3, pause=1)), 18.0) for number in (1, 2)
    )
    assert first == ((0, 3), (8, 11), (16, 18))
    assert second == ((4, 7), (12, 15))


@given(
    seed=st.integers(0, 1000),
    sound=st.tuples(st.floats(0.05, 5), st.floats(0, 5)),
    pause=st.tuples(st.floats(0.05, 5), st.floats(0, 5)),
    seconds=st.integers(1, 60),
)
def test_bursts_keep_to_their_ranges(
    seed: int, sound: tuple[float, float], pause: tuple[float, float], seconds: int
) -> None:
    spec = BurstsSpec(sound=(sound[0], sum(sound)), pause=(pause[0], sum(pause)), seed=0)
    found = intervals(ProgrammeSpec(bursts=spec), seconds, seed)
    assert found == intervals(ProgrammeSpec(bursts=spec), seconds, seed)
    ends = [0.0, *(end for _, end in found)]
    for (start, end), before in zip(found, ends, strict=False):
        assert spec.pause[0] - 1e-9 <= start - before <= spec.pause[1] + 1e-9
        assert 0 < end - start <= spec.sound[1] + 1e-9
        assert end - start >= spec.sound[0] - 1e-9 or end == seconds


@given(start=st.floats(0, 6), length=st.floats(0.05, 3))
def test_a_gate_opens_and_closes_at_the_sample(start: float, length: float) -> None:
    signal = np.ones(round((PRE_ROLL + 10) * SAMPLE_RATE))
    out = gated(signal, [(start, start + length)], PRE_ROLL)
    sounding = np.flatnonzero(out)
    assert sounding[0] == round((start + PRE_ROLL) * SAMPLE_RATE)
    assert sounding[-1] == round((start + length + PRE_ROLL) * SAMPLE_RATE) - 1
    ramp = min(RAMP_SAMPLES, len(sounding) // 2)
    assert (np.diff(out[sounding[0] : sounding[0] + ramp]) > 0).all()
    assert (out[sounding[0] + ramp : sounding[-1] + 1 - ramp] == 1).all()
    # Without a click: no step is larger than that of the ramp itself.
    assert np.abs(np.diff(out)).max() <= math.pi / 2 / ramp


def test_a_source_that_always_sounds_has_no_ramp() -> None:
    signal = np.random.default_rng(1).standard_normal(5 * SAMPLE_RATE).astype(np.float32)
    np.testing.assert_array_equal(gated(signal, [(-PRE_ROLL, 3.0)], PRE_ROLL), signal)


# What is audible


def heard(*stems: np.ndarray) -> dict[str, Stem]:
    return {f"source_{n}": Stem(stem) for n, stem in enumerate(stems, start=1)}


def test_levels_are_decibels_of_the_rms_over_both_ears() -> None:
    loud, soft = clip(0.1, 1), clip(0.02, 2)
    one, two = audible_sources(mixture([loud, soft]), heard(loud, soft))
    assert one.level_db == pytest.approx(-20.0, abs=1e-3)
    assert two.level_db == pytest.approx(20 * math.log10(0.02), abs=1e-3)
    assert one.snr_db == pytest.approx(20 * math.log10(5), abs=1e-3)
    assert two.snr_db == pytest.approx(-20 * math.log10(5), abs=1e-3)


@pytest.mark.parametrize(("amplitude", "listed"), [(1.02e-3, True), (0.98e-3, False)])
def test_sixty_decibels_below_full_scale_is_the_limit(amplitude: float, listed: bool) -> None:
    stem = clip(amplitude)
    assert bool(audible_sources(stem, heard(stem))) is listed


@pytest.mark.parametrize(("amplitude", "listed"), [(0.0102, True), (0.0098, False)])
def test_twenty_decibels_below_the_rest_is_the_limit(amplitude: float, listed: bool) -> None:
    soft, rest = clip(amplitude, 1), clip(0.1, 2)
    found = {one.source for one in audible_sources(mixture([soft, rest]), heard(soft, rest))}
    assert ("source_1" in found) is listed
    assert "source_2" in found


def test_alone_there_is_no_snr() -> None:
    stem = clip(0.1)
    (one,) = audible_sources(stem, heard(stem))
    assert one.snr_db is None


def test_the_background_counts_as_the_rest() -> None:
    stem, noise = clip(0.01, 1), clip(0.2, 2)
    assert not audible_sources(mixture([stem, noise]), heard(stem))


# Direct sound


def test_direct_to_reverberant_in_a_box_is_that_of_its_image_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """The closed form renders the direct sound alone when every wall absorbs all; the rest is the difference."""
    source, pose = (3.2, 2.4, 3.1), Pose.from_yaw((5.2, 2.6, 4.7), 0.4)
    with_absorption(monkeypatch, 0.3)
    scene = box_scene((8.0, 5.0, 8.0))
    full = AnalyticBackend().open(scene, source, room="kitchen").impulse_response(pose)
    alone = AnalyticBackend(absorption=0.9999, tail=False).open(scene, source, room="kitchen").impulse_response(pose)
    part = DirectPath(scene, source).of(full, pose)
    assert part is not None
    direct = float(np.sum(part.astype(np.float64) ** 2))
    assert 10 * math.log10(direct / float(np.sum(alone.astype(np.float64) ** 2))) == pytest.approx(0, abs=0.3)
    signal = np.zeros((2, SAMPLE_RATE), dtype=np.float32)
    whole, early = signal.copy(), signal.copy()
    whole[:, : full.shape[1]] = full[:, :SAMPLE_RATE]
    early[:, : part.shape[1]] = part
    rest = float(np.sum((whole.astype(np.float64) - early) ** 2))
    assert direct_to_reverberant(early, whole) == pytest.approx(10 * math.log10(direct / rest), abs=1e-3)


def test_without_one_part_there_is_no_ratio() -> None:
    stem = clip(0.1)
    assert direct_to_reverberant(np.zeros_like(stem), stem) is None
    assert direct_to_reverberant(stem, stem) is None
    assert direct_to_reverberant(np.zeros_like(stem), np.zeros_like(stem)) is None
