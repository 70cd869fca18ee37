"""Blocks of voices that rotate or blow: spectra, angles, coasting, impacts."""

import numpy as np

from generators.assets.sounds.fans import (
    CONTROL_RATE,
    approach,
    blades,
    frames,
    noise,
    passages,
    rotor,
    slopes,
    struck,
    turns_of,
)

SR = 44_100


def spectrum(signal):
    return np.fft.rfftfreq(len(signal), 1 / SR), np.abs(np.fft.rfft(signal * np.hanning(len(signal)))) ** 2


def test_noise_has_the_spectrum_that_was_asked_for():
    signal = noise(10 * SR, np.random.default_rng(0), slopes([(100.0, 0.0), (1600.0, -24.0), (12_800.0, -33.0)]))
    frequencies, power = spectrum(signal)

    def density(low, high):
        return 10 * np.log10(power[(frequencies > low) & (frequencies < high)].mean())

    assert abs(np.sqrt(np.mean(np.square(signal))) - 1.0) < 0.05
    for low, high, expected in ((200, 800, -12.0), (2000, 8000, -6.0)):
        assert abs(density(high * 0.9, high * 1.1) - density(low * 0.9, low * 1.1) - expected) < 1.0


def test_a_fan_sounds_at_its_blade_passing_frequency():
    rng = np.random.default_rng(1)
    turns = turns_of(np.full(frames(4 * SR), 311.0), 4 * SR)
    frequencies, power = spectrum(rotor(turns, blades(6, rng, 0.2), rng, 311.0))
    assert abs(frequencies[power.argmax()] - 6 * 311.0) < 5.0
    shares = [power[np.abs(frequencies - 6 * 311.0 * k) < 60].sum() / power.sum() for k in (1, 2)]
    assert shares[0] > shares[1] > 0.01


def test_orders_above_16_khz_are_left_out():
    turns = turns_of(np.full(frames(SR), 1800.0), SR)
    assert not rotor(turns, {9: 1.0}, np.random.default_rng(0), 1800.0).any()


def test_a_motor_coasts_down_exponentially():
    speed = approach(4 * SR, [(1.0, 1.0), (2.0, 0.0), (1.0, 0.5)], 1.0, 0.3, 0.8)
    at = (np.array([0.9, 1.8, 2.6]) * CONTROL_RATE).astype(int)
    assert np.allclose(speed[at], [1.0, np.exp(-0.8 / 0.8), np.exp(-1.6 / 0.8)], atol=0.01)
    assert abs(speed[-1] - 0.5) < 0.05


def test_passages_count_the_marks_of_a_rotor():
    turns = turns_of(np.full(frames(10 * SR), 2.5), 10 * SR, 0.3)
    assert abs(len(passages(turns, 3.0, np.random.default_rng(0))) - 75) <= 1


def test_many_and_few_impacts_are_the_same_sum():
    body = slopes([(300.0, -6.0), (1500.0, 0.0), (6000.0, -12.0)])
    few, many = np.array([1000, 1003]), np.repeat([1000, 1003], 800)
    one = struck(SR, np.random.default_rng(4), few, np.ones(2), body, 0.05)
    other = struck(SR, np.random.default_rng(4), many, np.ones(1600), body, 0.05)
    assert len(one) == len(other) == SR
    assert not one[:1000].any()
    assert np.abs(other[:990]).max() < 1e-4 * np.abs(other).max()
