"""The voices of vacuum cleaners: splits, physics of motors and nozzles, no exact repetition."""

import numpy as np
import pytest

from generators.assets.sounds import find_voice, voices
from generators.assets.sounds.devices.vacuum_cleaner import _leak
from generators.assets.sounds.devices.vacuum_cleaner_parts import Habit, universal_motor, work
from generators.assets.sounds.fans import frames
from tests.support.spectra import likeness, prominence, share_above, strongest
from tests.support.tiers import some

SR = 44_100
VOICES = voices("vacuum_cleaner")


def second_levels(signal):
    power = np.square(signal[: len(signal) // SR * SR]).reshape(-1, SR).mean(axis=1)
    return 10 * np.log10(power / power.mean())


@pytest.mark.parametrize("voice", some(VOICES, every=4), ids=lambda voice: voice.name)
def test_a_take_never_repeats_exactly_and_ends_below_16_khz(voice):
    heard = voice.play(SR + 7, np.random.default_rng(1))
    assert likeness(heard - heard.mean(), SR // 100, SR // 2) < 0.98
    assert share_above(heard - heard.mean(), 16_000) < 0.02


@pytest.mark.parametrize("name", ["hand_brushed", "central_inlet"])
def test_no_second_is_silent(name):
    voice = next(voice for voice in VOICES if voice.name == name)
    assert second_levels(voice.play(15 * SR, np.random.default_rng(5))).min() > -27.0


def test_a_leak_hisses_most_at_the_end_of_hearing():
    heard = _leak(8 * SR, np.random.default_rng(2)).astype(np.float64)
    octaves = [share_above(heard, low) - share_above(heard, 2 * low) for low in (1250.0, 2500.0, 5000.0, 10_000.0)]
    assert np.all(10 * np.log10(np.divide(octaves[1:], octaves[:-1])) > 2.0)


def test_a_series_motor_runs_up_when_the_nozzle_seals():
    take = work(60 * SR, np.random.default_rng(3), Habit(off=(0.4, 0.5), seal=(2.0, 6.0), lift=(40.0, 50.0)))
    full = take.speed > 0.9
    assert np.median(take.speed[full & (take.sealed > 0.9)]) > 1.04 * np.median(take.speed[full & (take.sealed < 0.1)])
    assert np.median(take.flow[full & (take.sealed > 0.9)]) < 0.8 * np.median(take.flow[full & (take.sealed < 0.1)])


def test_a_universal_motor_hums_at_twice_the_mains_frequency():
    signal = universal_motor(4 * SR, np.random.default_rng(2), np.full(frames(4 * SR), 311.0), 6, 0.3, 0.0)
    assert min(abs(strongest(signal, 0, 180) - hum) for hum in (100.0, 120.0)) < 1.5
    assert abs(strongest(signal, 500, 6000) / (6 * 311.0) % 1.0 - 0.5) > 0.49


def test_a_lined_canister_has_no_line_of_its_fan_and_an_open_motor_has():
    stands = {
        name: [
            prominence(find_voice("vacuum_cleaner", name).play(6 * SR, np.random.default_rng(seed)), 1000, 8000)
            for seed in range(3)
        ]
        for name in ("quiet_canister", "backpack", "corded_handheld")
    }
    assert max(stands["quiet_canister"]) < 10.0 < min(stands["backpack"] + stands["corded_handheld"])
