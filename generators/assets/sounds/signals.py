"""Elementary signals: shaped noise, drifting tones, struck resonances, bubbles.

All functions take and return float64 at `SAMPLE_RATE`; times are in seconds, frequencies in hertz.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, iirpeak, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE

Array = NDArray[np.float64]
F = TypeVar("F", bound=np.floating)


def time_axis(count: int) -> Array:
    """(count,) seconds."""
    return np.arange(count) / SAMPLE_RATE


def band_noise(count: int, rng: Generator, low: float, high: float, order: int = 2) -> Array:
    """Gaussian noise of unit RMS between ``low`` and ``high`` (Butterworth of ``order`` on each side)."""
    # The filter needs time to settle, so a lead-in is computed and cut off.
    lead = SAMPLE_RATE // 5
    noise = rng.standard_normal(count + lead)
    sections = butter(order, [low, min(high, 0.48 * SAMPLE_RATE)], btype="bandpass", fs=SAMPLE_RATE, output="sos")
    return unit(sosfilt(sections, noise)[lead:])


def unit(signal: Array) -> Array:
    """The signal at RMS 1 (unchanged where silent)."""
    level = float(np.sqrt(np.mean(np.square(signal)))) if len(signal) else 0.0
    return signal / level if level > 0 else signal


def resonance(signal: Array, frequency: float, quality: float) -> Array:
    """The signal through a resonator of unit peak gain."""
    b, a = iirpeak(frequency, quality, fs=SAMPLE_RATE)
    return np.asarray(lfilter(b, a, signal), dtype=np.float64)


def shelf(signal: Array, corner: float, gain_db: float) -> Array:
    """First-order high shelf: 0 dB at low, ``gain_db`` at high frequencies, half of it (in dB) at ``corner``."""
    gain = 10 ** (gain_db / 20)
    # Analogue (g·s + ω·√g)/(s + ω·√g), bilinear with the corner prewarped.
    k = np.tan(np.pi * corner / SAMPLE_RATE) * np.sqrt(gain)
    b, a = np.array([gain + k, k - gain]) / (1 + k), np.array([1.0, (k - 1) / (1 + k)])
    return np.asarray(lfilter(b, a, signal), dtype=np.float64)


def drift(count: int, rng: Generator, rate: float, depth: float) -> Array:
    """A smooth random curve with about ``rate`` independent values per second, mean 0, standard deviation ``depth``."""
    knots = max(6, int(np.ceil(count / SAMPLE_RATE * rate)) + 4)
    values = rng.standard_normal(knots)
    return np.asarray(depth * CubicSpline(np.arange(knots), values)(time_axis(count) * rate + 1.0))


def phase_of(frequency: Array | float, count: int, start: float = 0.0) -> Array:
    """(count,) phase in radians of an oscillator with that (drifting) frequency."""
    if np.ndim(frequency) == 0:
        return start + 2 * np.pi * float(frequency) * time_axis(count)
    return start + 2 * np.pi * np.cumsum(np.asarray(frequency)) / SAMPLE_RATE


def period(size: int, amplitudes: Sequence[float] | Array, rng: Generator) -> Array:
    """(size,) one period of harmonics k = 1, 2, … with random phases."""
    turn = np.arange(size) * (2 * np.pi / size)
    table = np.zeros(size)
    for k, amplitude in enumerate(amplitudes, start=1):
        table += amplitude * np.sin(k * turn + rng.uniform(0, 2 * np.pi))
    return table


def harmonics(phase: Array, amplitudes: Sequence[float] | Array, rng: Generator) -> Array:
    """Sum of sin(k·phase + random start) · amplitude_k, k = 1, 2, … (one period is tabulated and looked up)."""
    size = 8192
    table = period(size, amplitudes, rng)
    place = np.mod(phase * (size / (2 * np.pi)), size)
    index = place.astype(np.int64)
    fraction = place - index
    index %= size
    following = np.roll(table, -1)
    return np.asarray(table[index] * (1 - fraction) + following[index] * fraction)


def upsampled(values: NDArray[F], step: int, count: int) -> NDArray[F]:
    """(count,) lines through values that are ``step`` samples apart, of their type; beyond the last, the last."""
    missing = (count - 1) // step + 2 - len(values)
    if missing > 0:
        values = np.concatenate([values, np.full(missing, values[-1])]).astype(values.dtype)
    out = np.diff(values)[:, None] * (np.arange(step) / step).astype(values.dtype)
    out += values[:-1, None]
    return np.asarray(out.ravel()[:count])


def ramp(count: int, times: Sequence[float], levels: Sequence[float], soft: float = 0.05) -> Array:
    """Piecewise linear envelope through (time, level), its corners rounded over ``soft`` seconds."""
    line = np.interp(time_axis(count), times, levels)
    width = max(1, int(soft * SAMPLE_RATE))
    padded = np.pad(line, (width // 2, width - 1 - width // 2), mode="edge")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    return np.asarray((total[width:] - total[:-width]) / width)


def strike(modes: Sequence[tuple[float, float, float]], seconds: float, rng: Generator, attack: float = 3e-4) -> Array:
    """A struck body: ``modes`` are (frequency, time to fall by 60 dB, amplitude)."""
    t = time_axis(int(seconds * SAMPLE_RATE))
    out = np.zeros(len(t))
    for frequency, decay, amplitude in modes:
        out += amplitude * np.exp(-6.91 * t / decay) * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 2 * np.pi))
    return out * (1.0 - np.exp(-t / attack))


def bubble(radius_mm: float, rise: float, seconds: float = 0.12) -> Array:
    """One bubble: a damped sine at Minnaert's frequency (3.26 m/s over the radius) whose pitch rises.

    Model: K. van den Doel, "Physically based models for liquid sounds", ACM TAP 2 (2005) 534–546: damping
    0.13/r + 0.0072·r^(−3/2) per second with r in metres, pitch f(t) = f0·(1 + rise·damping·t).
    """
    radius = radius_mm * 1e-3
    base = 3.26 / radius
    damping = 0.13 / radius + 0.0072 * radius**-1.5
    t = time_axis(int(seconds * SAMPLE_RATE))
    pitch = base * (1.0 + rise * damping * t)
    fade = np.minimum(1.0, t / 0.0015)
    return np.asarray(
        fade * np.exp(-damping * t) * np.sin(2 * np.pi * np.cumsum(np.minimum(pitch, 9000.0)) / SAMPLE_RATE)
    )


def bubbles(count: int, rng: Generator, rate: Array | float, radii_mm: tuple[float, float]) -> Array:
    """A stream of bubbles: a Poisson process with ``rate`` (per second, may vary in time), radii log-uniform."""
    out = np.zeros(count)
    curve = np.broadcast_to(np.asarray(rate, dtype=np.float64), count)
    peak = float(curve.max(initial=0.0))
    if peak <= 0:
        return out
    kinds = [bubble(r, rise) for r, rise in zip(np.geomspace(*radii_mm, 24), rng.uniform(0.02, 0.12, 24), strict=True)]
    total = rng.poisson(peak * count / SAMPLE_RATE)
    starts = np.sort(rng.integers(0, max(1, count), total))
    keep = rng.uniform(0, peak, total) < curve[starts]
    choice = rng.integers(0, len(kinds), total)
    level = rng.uniform(0.2, 1.0, total) ** 2
    for start, kind, gain in zip(starts[keep], choice[keep], level[keep], strict=True):
        add_at(out, int(start), gain * kinds[kind])
    return out


def add_at(out: NDArray[np.floating], start: int, piece: NDArray[np.floating]) -> None:
    """Add ``piece`` to ``out`` from sample ``start`` on; samples beyond the ends of ``out`` are dropped."""
    low, high = max(0, start), min(len(out), start + len(piece))
    if high > low:
        out[low:high] += piece[low - start : high - start]
