"""The voices of vacuum cleaners: splits, physics of motors and nozzles, no exact repetition."""

import numpy as np
import pytest

from generators.assets.sounds import voices
from generators.assets.sounds.devices.vacuum_cleaner_parts import Habit, universal_motor, work
from generators.assets.sounds.fans import frames

SR = 44_100
VOICES = voices("vacuum_cleaner")


def second_levels(signal):
    power = np.square(signal[: len(signal) // SR * SR]).reshape(-1, SR).mean(axis=1)
    return 10 * np.log10(power / power.mean())


def test_ten_voices_of_known_and_new_mechanisms():
    splits = [voice.split for voice in VOICES]
    assert (splits.count("train"), splits.count("validation"), splits.count("test")) == (6, 1, 3)
    assert len({voice.name for voice in VOICES}) == len({voice.play for voice in VOICES}) == 10
    known = {voice.mechanism for voice in VOICES if voice.split == "train"}
    tested = {voice.mechanism for voice in VOICES if voice.split == "test"}
    assert tested & known
    assert tested - known


@pytest.mark.parametrize("voice", VOICES, ids=lambda voice: voice.name)
def test_a_take_follows_its_seed_and_never_repeats_exactly(voice):
    first, again, other = (voice.play(SR + 7, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first.dtype == np.float64
    assert first.shape == (SR + 7,)
    assert np.isfinite(first).all()
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)
    power = np.abs(np.fft.rfft(first - first.mean(), 1 << 17)) ** 2
    correlation = np.fft.irfft(power)[: SR // 2]
    assert correlation[SR // 100 :].max() < 0.98 * correlation[0]
    high = np.fft.rfftfreq(1 << 17, 1 / SR) > 16_000
    assert power[high].sum() < 0.02 * power.sum()


@pytest.mark.parametrize("name", ["hand_brushed", "central_inlet"])
def test_no_second_is_silent(name):
    voice = next(voice for voice in VOICES if voice.name == name)
    assert second_levels(voice.play(15 * SR, np.random.default_rng(5))).min() > -27.0


def test_a_series_motor_runs_up_when_the_nozzle_seals():
    take = work(60 * SR, np.random.default_rng(3), Habit(off=(0.4, 0.5), seal=(2.0, 6.0), lift=(40.0, 50.0)))
    full = take.speed > 0.9
    assert np.median(take.speed[full & (take.sealed > 0.9)]) > 1.04 * np.median(take.speed[full & (take.sealed < 0.1)])
    assert np.median(take.flow[full & (take.sealed > 0.9)]) < 0.8 * np.median(take.flow[full & (take.sealed < 0.1)])


def test_a_universal_motor_hums_at_twice_the_mains_frequency():
    signal = universal_motor(4 * SR, np.random.default_rng(2), np.full(frames(4 * SR), 311.0), 6, 0.3, 0.0)
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2
    frequencies = np.fft.rfftfreq(len(signal), 1 / SR)
    low = frequencies < 180
    assert min(abs(frequencies[low][power[low].argmax()] - hum) for hum in (100.0, 120.0)) < 1.5
    band = (frequencies > 500) & (frequencies < 6000)
    assert abs(frequencies[band][power[band].argmax()] / (6 * 311.0) % 1.0 - 0.5) > 0.49
