"""Physical facts of the voices of washing machines and of their parts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import welch

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds import Voice, find_voice, machines, voices
from generators.assets.sounds.devices.washing_machine_tubs import _drizzle
from tests.support.spectra import likeness, share_above, strongest
from tests.support.tiers import some

Array = NDArray[np.float64]
SECONDS = 4
COUNT = SECONDS * SAMPLE_RATE
VOICES = pytest.mark.parametrize("voice", voices("washing_machine"), ids=lambda voice: voice.name)


def _constant(value: float) -> Array:
    return np.full(machines.control_count(COUNT), value)


def test_an_induction_motor_slips_behind_its_field() -> None:
    """Four poles at 50 Hz: 25 turns per second less 2–6 %; the hum stays at 100 Hz."""
    heard = machines.induction_motor(COUNT, np.random.default_rng(1), 50.0, slots=30, pairs=2)
    assert strongest(heard, 30, 1000) == pytest.approx(100.0, abs=0.5)
    slot = strongest(heard, 30 * 25 * 0.92, 30 * 25)
    assert 0.015 < 1 - slot / (30 * 25) < 0.08


def test_a_permanent_magnet_motor_sings_at_even_electrical_orders() -> None:
    heard = machines.permanent_magnet_motor(COUNT, np.random.default_rng(1), _constant(5.0), 20.0, pairs=24, teeth=36)
    orders = strongest(heard, 60, 4000) / (24 * 5.0)
    assert orders == pytest.approx(2 * round(orders / 2), rel=0.005)


def test_a_pitted_ring_is_hit_at_four_tenths_of_the_balls_per_turn() -> None:
    """Eight balls at ten turns per second: 32 hits per second, but not in step."""
    body = machines.plate(np.random.default_rng(0), 800, 4000, 20, 0.05)
    heard = machines.bearing_defect(COUNT, np.random.default_rng(1), _constant(10.0), 10.0, 8, body)
    envelope = np.abs(heard)
    assert strongest(envelope - envelope.mean(), 25, 45) == pytest.approx(0.4 * 8 * 10, rel=0.04)


@pytest.mark.slow
def test_a_pitted_ring_is_heard_beside_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over rinse and spin, the growl is at least a fifth of the voice's RMS."""
    voice = find_voice("washing_machine", "worn_bearing")
    whole = voice.play(10 * COUNT, np.random.default_rng(2))
    pitted = machines.bearing_defect
    place = "generators.assets.sounds.devices.washing_machine_drums.bearing_defect"
    monkeypatch.setattr(place, lambda *arguments: 0.0 * pitted(*arguments))
    smooth = voice.play(10 * COUNT, np.random.default_rng(2))
    assert 0.2 < np.std(whole - smooth) / np.std(whole) < 0.8


def test_small_drops_ring_at_thirteen_to_sixteen_kilohertz() -> None:
    heard = _drizzle(COUNT, np.random.default_rng(1), _constant(1.0))
    frequencies, power = welch(heard, SAMPLE_RATE, nperseg=512)
    assert 12_000 < frequencies[np.argmax(power)] < 16_000


def test_a_synchronous_pump_keeps_to_the_mains() -> None:
    body = machines.plate(np.random.default_rng(0), 160, 3000, 20, 0.05)
    heard = machines.synchronous_pump(COUNT, np.random.default_rng(1), 60.0, body, _constant(0.2))
    assert strongest(heard, 100, 140) == pytest.approx(120.0, abs=0.5)


def test_a_tub_swings_most_at_the_resonance_of_its_suspension() -> None:
    speeds = np.linspace(0.1, 40.0, 4000)
    swing = machines.unbalance(speeds, 4.0, 0.1)
    assert speeds[np.argmax(swing)] == pytest.approx(4.0, rel=0.05)
    assert swing[-1] == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("voice", some(voices("washing_machine"), every=4), ids=lambda voice: voice.name)
def test_a_take_is_never_near_silence_never_periodic_and_ends_below_16_khz(voice: Voice) -> None:
    heard = voice.play(COUNT, np.random.default_rng(7))
    assert heard.dtype == np.float64
    power = np.square(heard).reshape(SECONDS, -1).mean(axis=1)
    assert 10 * np.log10(power.min() / power.mean()) > -27
    assert likeness(heard, SAMPLE_RATE // 10, COUNT // 2) < 0.98
    assert share_above(heard, 16_000) < 0.003
