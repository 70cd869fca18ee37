"""Loudness according to ITU-R BS.1770-4, and a true-peak limiter.

K-weighting is two second-order sections. The recommendation prints their coefficients for 48 kHz only; here they are
derived from the analogue prototypes of those coefficients, so that the weighting is the same at every sample rate.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import fftconvolve, firwin, resample_poly, sosfilt

Array = NDArray[np.float64]

#: Loudness of every source (LUFS).
TARGET_LUFS = -18.0
#: Largest true peak of a source (dBTP).
CEILING_DB = -1.0
#: Gating block and hop (75 % overlap), BS.1770-4 annex 1.
_BLOCK, _OVERLAP = 0.4, 4
_ABSOLUTE_GATE, _RELATIVE_GATE = -70.0, -10.0
_OVERSAMPLING = 4
#: The filter of the oversampling, that of `scipy.signal.resample_poly`, and what it can make of each of the magnitudes
#: round a sample: the largest of its phases, and a little for rounding.
_FINE = firwin(20 * _OVERSAMPLING + 1, 1 / _OVERSAMPLING, window=("kaiser", 5.0))
_PHASES = np.pad(_FINE * _OVERSAMPLING, (0, _OVERSAMPLING - 1)).reshape(-1, _OVERSAMPLING)
_MOST = (1 + 1e-9) * np.abs(_PHASES).max(axis=1)
#: Stretches that are nearer to each other than this are oversampled as one; at most so many samples at once, with such
#: a margin.
_NEAR, _CHUNK, _MARGIN = 1 << 11, 1 << 18, 64


def k_weighting(sample_rate: int) -> Array:
    """(2, 6) second-order sections: the head's shelf (+4 dB above 1.7 kHz) and the RLB high-pass (38 Hz)."""

    def prototype(frequency: float, quality: float) -> tuple[float, float]:
        k = math.tan(math.pi * frequency / sample_rate)
        return k, 1.0 + k / quality + k * k

    k, a0 = prototype(1681.974450955533, q := 0.7071752369554196)
    high = 10 ** (3.999843853973347 / 20)
    band = high**0.4996667741545416
    shelf = [
        (high + band * k / q + k * k) / a0,
        2 * (k * k - high) / a0,
        (high - band * k / q + k * k) / a0,
        1.0,
        2 * (k * k - 1) / a0,
        (1 - k / q + k * k) / a0,
    ]
    k, a0 = prototype(38.13547087602444, q := 0.5003270373238773)
    high_pass = [1.0, -2.0, 1.0, 1.0, 2 * (k * k - 1) / a0, (1 - k / q + k * k) / a0]
    return np.array([shelf, high_pass])


def integrated_loudness(signal: NDArray[np.floating], sample_rate: int) -> float:
    """Gated loudness of a mono signal in LUFS (= LKFS); −inf for silence or less than 0.4 s.

    Args:
        signal: (n,) samples, full scale 1.
        sample_rate: Hz.
    """
    weighted = sosfilt(k_weighting(sample_rate), np.asarray(signal, dtype=np.float64))
    hop = round(_BLOCK * sample_rate / _OVERLAP)
    steps = len(weighted) // hop
    if steps < _OVERLAP:
        return -math.inf
    energy = np.square(weighted[: steps * hop]).reshape(steps, hop).mean(axis=1)
    power = np.convolve(energy, np.full(_OVERLAP, 1 / _OVERLAP), mode="valid")

    def level(mean_square: float) -> float:
        return -0.691 + 10 * math.log10(mean_square)

    loud = power[power > 10 ** ((_ABSOLUTE_GATE + 0.691) / 10)]
    if not len(loud):
        return -math.inf
    gate = level(float(loud.mean())) + _RELATIVE_GATE
    return level(float(loud[loud > 10 ** ((gate + 0.691) / 10)].mean()))


def true_peak_envelope(signal: NDArray[np.floating], least: float = 0.0) -> Array:
    """(n,) largest magnitude of the four-fold oversampled signal round each sample (BS.1770-4 annex 2).

    Args:
        signal: (n,).
        least: where the oversampled signal cannot exceed this, the magnitude of the sample itself will do: most samples
            are far below the ceiling of a limiter.
    """
    samples = np.asarray(signal, dtype=np.float64)
    out = np.abs(samples)
    for start, stop in _stretches(out, least):
        low, high = max(0, start - _MARGIN), min(len(samples), stop + _MARGIN)
        fine = np.abs(resample_poly(samples[low:high], _OVERSAMPLING, 1, window=_FINE))  # type: ignore[call-overload]
        own = slice(start - low, stop - low)
        for phase in range(_OVERSAMPLING):
            np.maximum(out[start:stop], fine[phase::_OVERSAMPLING][own], out=out[start:stop])
    return out


def _stretches(magnitudes: Array, least: float) -> list[tuple[int, int]]:
    """First sample and end of the stretches beyond which the oversampled signal stays at or below ``least``."""
    if not len(magnitudes):
        return []
    half = len(_MOST) // 2
    at = np.flatnonzero(np.convolve(magnitudes, _MOST)[half : half + len(magnitudes)] > least)
    if not len(at):
        return []
    gaps = np.flatnonzero(np.diff(at) > _NEAR)
    runs = zip(at[np.append(0, gaps + 1)].tolist(), at[np.append(gaps, -1)].tolist(), strict=True)
    return [(k, min(k + _CHUNK, last + 1)) for first, last in runs for k in range(first, last + 1, _CHUNK)]


def limit(signal: NDArray[np.floating], sample_rate: int, ceiling: float) -> Array:
    """Look-ahead limiter: smoothly reduces the gain from 4 ms before to 4 ms after each peak above ``ceiling``."""
    samples = np.asarray(signal, dtype=np.float64)
    envelope = true_peak_envelope(samples, ceiling)
    if envelope.max(initial=0.0) <= ceiling:
        return samples
    reach = max(1, round(0.004 * sample_rate))
    gain = minimum_filter1d(np.minimum(1.0, ceiling / np.maximum(envelope, 1e-12)), 2 * reach + 1, mode="nearest")
    window = np.hanning(2 * reach + 1)
    padded = np.pad(gain, reach, mode="edge")
    smooth = fftconvolve(padded, window / window.sum(), mode="valid")
    return samples * np.minimum(smooth, 1.0)


def normalised(
    signal: NDArray[np.floating], sample_rate: int, target_lufs: float, ceiling_db: float
) -> NDArray[np.float32]:
    """The signal at ``target_lufs`` integrated loudness with its true peak limited to ``ceiling_db`` dBTP.

    Limiting reduces the loudness, so level adjustment and limiting alternate until the error is below 0.05 LU.
    """
    out = np.asarray(signal, dtype=np.float64)
    ceiling = 10 ** (ceiling_db / 20)
    for _ in range(8):
        change = target_lufs - integrated_loudness(out, sample_rate)
        out = limit(out * 10 ** (change / 20), sample_rate, ceiling * 0.99)
        if abs(change) < 0.05:
            break
    return out.astype(np.float32)
