"""Lines, likeness and bandwidth of synthesised sounds."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

SAMPLE_RATE = 44_100
Array = NDArray[np.float64]


def _power(signal: Array, padded: int = 1) -> tuple[Array, Array]:
    """Power of the windowed signal, ``padded`` times as long by zeros, and the frequencies (Hz)."""
    length = padded * len(signal)
    power = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), length)) ** 2
    return power, np.fft.rfftfreq(length, 1 / SAMPLE_RATE)


def energy_at(signal: Array, wanted: Iterable[float], within: float) -> Array:
    """Energy less than ``within`` Hz from each frequency."""
    power, frequencies = _power(signal)
    return np.array([power[np.abs(frequencies - each) < within].sum() for each in wanted])


def strongest(signal: Array, low: float, high: float, padded: int = 1) -> float:
    """Frequency (Hz) of the strongest line between two frequencies."""
    power, frequencies = _power(signal, padded)
    inside = (frequencies >= low) & (frequencies <= high)
    return float(frequencies[inside][np.argmax(power[inside])])


def likeness(signal: Array, first: int, last: int) -> float:
    """The largest autocorrelation at lags of ``first`` to ``last`` samples, re that without a lag."""
    correlation = np.fft.irfft(np.abs(np.fft.rfft(signal, 2 * len(signal))) ** 2)
    return float(correlation[first:last].max() / correlation[0])


def share_above(signal: Array, corner: float) -> float:
    """Share of the energy above a frequency (Hz)."""
    power = np.abs(np.fft.rfft(signal, 2 * len(signal))) ** 2
    return float(power[np.fft.rfftfreq(2 * len(signal), 1 / SAMPLE_RATE) > corner].sum() / power.sum())


def prominence(signal: Array, low: float, high: float) -> float:
    """By how much (dB) the highest line of the mean spectrum of seconds stands above the median of its third octave."""
    seconds = signal[: len(signal) // SAMPLE_RATE * SAMPLE_RATE].reshape(-1, SAMPLE_RATE)
    power = (np.abs(np.fft.rfft(seconds * np.hanning(SAMPLE_RATE), axis=1)) ** 2).mean(axis=0)
    bands = [power[int(begin) : int(1.26 * begin)] for begin in np.geomspace(low, high / 1.26, 12)]
    return max(float(10 * np.log10(band.max() / np.median(band))) for band in bands)
