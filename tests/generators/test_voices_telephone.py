"""Telephones: cadences of networks, blows of a clapper, tones of ringer circuits, companding, a motor on wood."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from generators.assets.sounds import find_voice
from generators.assets.sounds.bells import (
    NORTH_AMERICA,
    UNITED_KINGDOM,
    Ringer,
    blows,
    cadence,
    gong,
    shell_ratio,
    turning,
    wave,
)
from generators.assets.sounds.devices.telephone_tones import _companded
from generators.assets.sounds.room_tone import over_room_tone

SR = 44_100
Array = NDArray[np.float64]


def play(name: str, seconds: float, seed: int) -> Array:
    return find_voice("telephone", name).play(int(seconds * SR), np.random.default_rng(seed))


def envelope(signal: Array, low: float, high: float, rate: int = 490) -> Array:
    """Level of a band, ``rate`` values per second."""
    band = sosfiltfilt(butter(2, [low, high], "bandpass", fs=SR, output="sos"), signal)
    step = SR // rate
    return np.asarray(np.sqrt(np.square(band[: len(band) // step * step]).reshape(-1, step).mean(axis=1)))


def loudest(signal: Array, seconds: float) -> Array:
    """The stretch of that length with the most energy."""
    total = np.concatenate([[0.0], np.cumsum(np.square(signal))])
    width = int(seconds * SR)
    first = int(np.argmax(total[width:] - total[:-width]))
    return signal[first : first + width]


def peaks(signal: Array, low: float, high: float, number: int) -> list[float]:
    """The strongest frequencies of a band, more than 5 % apart."""
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), 4 * len(signal))) ** 2
    frequencies = np.fft.rfftfreq(4 * len(signal), 1 / SR)
    power[(frequencies < low) | (frequencies > high)] = 0
    found = []
    for _ in range(number):
        found.append(float(frequencies[np.argmax(power)]))
        power[np.abs(frequencies / found[-1] - 1) < 0.05] = 0
    return sorted(found)


@pytest.mark.parametrize("pattern", [UNITED_KINGDOM, NORTH_AMERICA])
def test_bursts_have_the_lengths_of_the_network(pattern: tuple[float, ...]) -> None:
    rings = cadence(200 * SR, np.random.default_rng(1), pattern)
    lengths = np.array([b - a for a, b in rings.bursts])
    assert np.median(lengths) == pytest.approx(np.median(pattern[::2]), rel=0.05)
    starts = np.array([a for a, _ in rings.bursts])[:: len(pattern) // 2]
    assert np.median(np.diff(starts)) == pytest.approx(sum(pattern), rel=0.04)
    assert np.std(np.diff(starts)) > 0, "no exact period"
    assert rings.bursts[0][0] <= 0 < rings.ends[-1] < rings.bursts[-1][1] + sum(pattern)


def test_a_british_bell_rings_twice_and_pauses() -> None:
    # High modes fall fast: the level dips by 8 dB or more in the pause of 0.2 s, and by far more in that of 2 s.
    level = np.convolve(envelope(play("uk_desk_bell", 16, 3), 8000, 14_000), np.ones(25) / 25, "same")
    middle = level - level.mean()
    likeness = np.fft.irfft(np.abs(np.fft.rfft(middle, 2 * len(level))) ** 2)[: len(level)]
    period = (2 * 490 + int(np.argmax(likeness[2 * 490 : 4 * 490]))) / 490
    assert period == pytest.approx(3.0, rel=0.04)
    sounding = 20 * np.log10(level / np.percentile(level, 98)) > -7
    starts = np.flatnonzero(np.diff(sounding.astype(int)) > 0) / 490
    gaps = np.diff(starts)
    assert np.sum(np.abs(gaps - 0.6) < 0.1) >= 4, "a second ring 0.6 s after the first"
    assert np.sum(np.abs(gaps - 2.4) < 0.15) >= 3, "2.4 s from a second ring to the next first one"


def test_each_gong_is_struck_once_per_period_of_the_ringing_current() -> None:
    silent = (np.zeros(1),)
    ringer = Ringer((silent, silent), current=20.0, bias=0.2, unsteady=1e-3, missed=0.0)
    times, which, strength = blows(ringer, (1.0, 3.0), np.random.default_rng(0))
    assert len(times) == pytest.approx(80, abs=4)
    assert np.all(np.diff(which) != 0), "from one gong to the other"
    assert np.diff(times[which == 0]).mean() == pytest.approx(1 / 20, rel=0.02)
    assert strength[0] < strength[5:-3].mean() > strength[-1], "the clapper swings up and out"


@pytest.mark.parametrize(("name", "low", "high"), [("us_desk_bell", 19.0, 21.0), ("uk_desk_bell", 23.5, 27.0)])
def test_a_ring_beats_at_the_ringing_current(name: str, low: float, high: float) -> None:
    burst = loudest(play(name, 9, 5), 0.38 if name == "uk_desk_bell" else 1.8)
    level = envelope(burst, 5000, 14_000)
    swing = np.abs(np.fft.rfft((level - level.mean()) * np.hanning(len(level)), 8192))
    rates = np.fft.rfftfreq(8192, 1 / 490)
    top = float(rates[np.argmax(swing * (rates > 10) * (rates < 60))])
    assert low <= top <= high or 2 * low <= top <= 2 * high


def test_modes_of_a_gong_are_those_of_a_shell_in_pairs() -> None:
    # The formula's own values: 6/√5, 24/√10, 60/√17 re the first.
    assert [shell_ratio(m) for m in (2, 3, 4)] == pytest.approx([1.0, 2.828, 5.423], abs=2e-3)
    modes = gong(np.random.default_rng(2), 1000.0, 1.5, 1.0)
    first, second = modes[0], modes[1]
    assert 1000 * 0.97 < first[0] < second[0] < 1000 * 1.03
    assert 0.0005 < second[0] / first[0] - 1 < 0.013
    assert modes[2][0] == pytest.approx(2828, rel=0.03)
    assert modes[4][1] < first[1], "high modes fall faster"


def test_tones_of_ringer_circuits_have_the_ratios_of_their_datasheets() -> None:
    chirping = loudest(play("ringer_ic_piezo", 7, 8), 0.35)
    low, high = peaks(chirping, 700, 2400, 2)
    # The switching puts side lines 8 to 16 Hz apart on both.
    assert low / high == pytest.approx(0.725, abs=0.03)
    for seed in (1, 2):
        divided = loudest(play("ringer_ic_speaker", 7, seed), 0.35)
        low, high = peaks(divided, 450, 1150, 2)
        # The half waves of the ringing current put lines 40 to 100 Hz beside them.
        assert low / high == pytest.approx(0.8, abs=0.09)


def test_companding_has_the_noise_of_eight_bits() -> None:
    t = np.arange(8000) / 8000
    for level in (0.7, 0.05):
        tone = level * np.sin(2 * np.pi * 437 * t)
        noise = float(np.std(_companded(tone) - tone) / np.std(tone))
        assert -42 < 20 * np.log10(noise) < -30, "about the same at all levels"


def test_a_vibration_is_at_the_speed_of_its_motor_and_rattles() -> None:
    sound = loudest(play("mobile_vibration_wood", 8, 2), 0.4)
    base = peaks(sound, 60, 900, 1)[0]
    assert any(130 * 0.96 <= base / k <= 200 * 1.04 for k in (0.5, 1, 2, 3, 4))
    power = np.abs(np.fft.rfft(sound)) ** 2
    frequencies = np.fft.rfftfreq(len(sound), 1 / SR)
    assert power[frequencies > 700].sum() > 0.02 * power.sum()


@pytest.mark.parametrize("name", ["uk_desk_bell", "mobile_buzzer_melody", "ringer_ic_speaker", "smartphone_marimba"])
def test_no_voice_repeats_to_the_sample(name: str) -> None:
    sound = play(name, 10, 4)[::2]
    n = len(sound)
    products = np.fft.irfft(np.abs(np.fft.rfft(sound, 2 * n)) ** 2)[:n]
    energy = np.concatenate([[0.0], np.cumsum(np.square(sound))])
    lags = np.arange(SR // 8, n // 2)
    alike = products[lags] / np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    assert alike.max() < 0.98


@pytest.mark.parametrize("name", ["us_desk_bell", "wall_single_gong", "ringer_ic_piezo", "voip_office"])
def test_pauses_hold_a_room_and_nothing_sounds_above_sixteen_kilohertz(name: str) -> None:
    sound = play(name, 8, 6)
    seconds = np.square(sound.reshape(8, SR)).mean(axis=1)
    assert 10 * np.log10(seconds.min() / seconds.mean()) > -27
    power = np.abs(np.fft.rfft(sound)) ** 2
    assert power[16_000 * 8 :].sum() < 4e-3 * power.sum()


def test_an_oscillator_drifts_about_its_frequency() -> None:
    phase = turning(4 * SR, np.random.default_rng(0), 440.0, 0.002, 0.001)
    assert (phase[-1] - phase[0]) / (2 * np.pi) == pytest.approx(440 * 4, rel=0.01)
    tone = wave(phase, [1.0, 0.5], np.random.default_rng(0))
    assert peaks(tone, 300, 1000, 2) == pytest.approx([440, 880], rel=0.015)


def test_a_room_is_heard_where_nothing_rings() -> None:
    assert over_room_tone(np.zeros(SR), np.random.default_rng(0)).std() > 0
