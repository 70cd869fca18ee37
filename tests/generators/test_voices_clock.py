"""Physical facts of the voices of clocks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds import Voice, find_voice, voices
from generators.assets.sounds.devices import clock_electric, clock_escapements
from tests.support.spectra import likeness, share_above
from tests.support.tiers import some

Array = NDArray[np.float64]
SECONDS = 6
COUNT = SECONDS * SAMPLE_RATE
VOICES = pytest.mark.parametrize("voice", voices("clock"), ids=lambda voice: voice.name)


def _rate(signal: Array, low: float, high: float) -> float:
    """Strongest rate (Hz) of the envelope between two rates."""
    envelope = np.sqrt(np.square(signal).reshape(-1, 147).mean(axis=1))
    spectrum = np.abs(np.fft.rfft((envelope - envelope.mean()) * np.hanning(len(envelope)), 8 * len(envelope)))
    rates = np.fft.rfftfreq(8 * len(envelope), 147 / SAMPLE_RATE)
    inside = (rates >= low) & (rates <= high)
    return float(rates[inside][np.argmax(spectrum[inside])])


def test_beats_keep_time_but_never_exactly() -> None:
    times = clock_escapements.beats(COUNT * 10, np.random.default_rng(2), 0.5, error=0.04, teeth=30, uneven=0.001)
    intervals = np.diff(times)
    assert intervals.mean() == pytest.approx(0.5, rel=2e-3)
    assert abs(intervals[::2].mean() - intervals[1::2].mean()) == pytest.approx(0.04, abs=0.003)
    assert intervals[::2].std() > 5e-4


def test_strokes_of_a_lever_are_apart_by_the_time_to_pass_the_lift_angle() -> None:
    """A balance of 2.5 Hz that swings 250° passes 52° of lift in 13.3 ms."""
    delays, forces = clock_escapements.lever_strokes(np.random.default_rng(0), 2.5, 250.0, 52.0)
    assert delays[2] - delays[0] == pytest.approx(0.01327, abs=5e-5)
    assert np.argmax(forces) == 2


def test_a_step_rings_down_at_the_rotors_own_frequency() -> None:
    delays, forces = clock_electric.step_strokes(np.random.default_rng(0), swing=50.0, damping=0.2, pulse=0.031)
    assert np.diff(delays[1:7]) == pytest.approx(np.full(5, 0.01))
    assert (np.diff(forces[1:7]) < 0).all()


@pytest.mark.parametrize(
    ("name", "low", "high"), [("wall_quartz", 0.99, 1.01), ("kitchen_timer", 3.9, 5.6), ("carriage_lever", 3.9, 5.1)]
)
def test_heard_rate_of_ticks(name: str, low: float, high: float) -> None:
    heard = find_voice("clock", name).play(COUNT, np.random.default_rng(3))
    assert low <= _rate(heard, 0.7 * low, 1.5 * high) <= high


def test_a_mains_clock_hums_at_twice_the_mains_frequency() -> None:
    heard = find_voice("clock", "synchronous").play(COUNT, np.random.default_rng(3))
    spectrum = np.abs(np.fft.rfft(heard * np.hanning(COUNT)))
    deep = spectrum[70 * SECONDS : 130 * SECONDS]
    assert min(abs(70 + np.argmax(deep) / SECONDS - hum) for hum in (100.0, 120.0)) < 0.3
    assert deep.max() > 10 * np.median(deep)


@pytest.mark.parametrize("voice", some(voices("clock"), every=4), ids=lambda voice: voice.name)
def test_a_take_is_never_near_silence_never_periodic_and_ends_below_16_khz(voice: Voice) -> None:
    heard = voice.play(COUNT, np.random.default_rng(7))
    assert heard.dtype == np.float64
    power = np.square(heard).reshape(SECONDS, -1).mean(axis=1)
    assert 10 * np.log10(power.min() / power.mean()) > -27
    assert likeness(heard, SAMPLE_RATE // 10, COUNT // 2) < 0.98
    assert share_above(heard, 16_000) < 0.01
