"""The voices of microwave ovens: splits, physics of supplies, fans and turntables, no exact repetition."""

import numpy as np
import pytest

from generators.assets.sounds import voices
from generators.assets.sounds.devices.microwave_parts import (
    beeps,
    duty,
    inverter,
    louvres,
    session,
    shaded_pole_fan,
    transformer,
)
from generators.assets.sounds.fans import CONTROL_RATE, GRID, frames, turns_of
from tests.support.spectra import energy_at, likeness, share_above
from tests.support.tiers import some

SR = 44_100
VOICES = voices("microwave")


def lines(signal, spacing, orders):
    """Energy at multiples of ``spacing`` (Hz), within 2 Hz."""
    return energy_at(signal, [spacing * order for order in orders], 2.0)


@pytest.mark.parametrize("voice", some(VOICES, every=4), ids=lambda voice: voice.name)
def test_a_take_never_repeats_exactly_and_ends_below_16_khz(voice):
    heard = voice.play(SR + 7, np.random.default_rng(1))
    assert likeness(heard - heard.mean(), SR // 100, SR // 2) < 0.98
    assert share_above(heard - heard.mean(), 16_000) < 0.01


def test_no_second_is_silent_when_the_door_is_open():
    voice = next(voice for voice in VOICES if voice.name == "commercial_twin")
    signal = voice.play(30 * SR, np.random.default_rng(5))
    power = np.square(signal).reshape(-1, SR).mean(axis=1)
    assert power.min() > 10**-2.7 * power.mean()


def test_a_transformer_hums_at_even_multiples_and_its_load_adds_odd_ones():
    count, seed = 4 * SR, 7
    cycle = turns_of(np.full(frames(count), 50.0), count)
    on = np.ones(frames(count))
    loaded = transformer(count, np.random.default_rng(seed), cycle, 50.0, on, 400.0)
    late = np.where(np.arange(frames(count)) > CONTROL_RATE, 1.0, 0.0)
    idle = transformer(count, np.random.default_rng(seed), cycle, 50.0, late, 400.0)[int(1.1 * SR) : int(2.1 * SR)]
    even, odd = range(2, 20, 2), range(1, 20, 2)
    assert lines(loaded, 50.0, even).sum() > 2 * lines(loaded, 50.0, odd).sum()
    share = [lines(signal, 50.0, odd).sum() / lines(signal, 50.0, even).sum() for signal in (idle, loaded)]
    assert share[0] < 0.3 * share[1]


def test_an_inverter_pulses_at_twice_the_mains_frequency():
    count = 3 * SR
    cycle = turns_of(np.full(frames(count), 60.0), count)
    signal = inverter(count, np.random.default_rng(3), cycle, 60.0, np.ones(frames(count)))
    envelope = np.square(signal)
    assert lines(envelope - envelope.mean(), 60.0, (2,)) > 10 * lines(envelope - envelope.mean(), 60.0, (1,))


def test_a_shaded_pole_motor_turns_slower_than_the_mains_by_its_slip():
    count = 6 * SR
    _, tones = shaded_pole_fan(count, np.random.default_rng(4), np.ones(frames(count)), 50.0, (0.1, 0.1), 500.0)
    at_speed = lines(tones, 45.0, range(1, 25)).sum()
    assert at_speed > 20 * lines(tones, 50.0, [k for k in range(1, 25) if k * 50 % 45 not in (0, 5, 40)]).sum()


def test_an_oven_takes_up_to_three_decibels_per_octave_of_what_leaves_at_its_back():
    gains = np.interp([125.0, 500.0, 1000.0, 8000.0], GRID, louvres(np.random.default_rng(1)))
    assert gains[:2] == pytest.approx([0.0, 0.0], abs=0.1)
    assert -3.0 <= gains[2] <= -1.5
    assert gains[3] == pytest.approx(4 * gains[2], abs=0.1)


def test_a_relay_switches_the_drawn_share_of_the_cooking():
    power, relay = duty(200 * SR, np.random.default_rng(1), np.ones(frames(200 * SR)), 20.0, 0.4)
    assert abs(power.mean() - 0.4) < 0.02
    assert abs(len(relay) - 20) <= 2


def test_beeps_have_their_pitch_and_number():
    signal = beeps(4 * SR, np.random.default_rng(2), np.array([SR]), 2000.0, 0.5, 0.9, 3)
    assert lines(signal, 2000.0, (1,)) > 0.5 * np.sum(np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2)
    gate = np.abs(signal).reshape(-1, SR // 100).max(axis=1) > 0.1
    assert np.count_nonzero(np.diff(gate.astype(int)) == 1) == 3


def test_a_session_opens_the_door_between_two_runs():
    held = session(300 * SR, np.random.default_rng(6), (20.0, 40.0), (6.0, 8.0))
    assert (held.ends[: len(held.opens)] < held.opens).all()
    assert (held.opens < held.closes).all()
    inside = held.opens[held.opens < 300 * SR] // 64
    assert not held.cooking[inside].any()
    assert held.heated.max() < 41.0
