"""The faint sound between events: what a quiet room and the mains leave in a recording of a device that pauses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator
from scipy.fft import irfft, next_fast_len
from scipy.signal import butter, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.loudness import TARGET_LUFS, integrated_loudness
from generators.assets.sounds.signals import Array, add_at, strike, time_axis, unit, upsampled

#: RMS level of the room (dBFS) once the whole is at `TARGET_LUFS`; the floor that no second may go below is −45.
_ROOM_DBFS = (-41.0, -37.5)


def slow_curve(count: int, rng: Generator, rate: float, depth: float) -> Array:
    """A random curve like `signals.drift`, linear between values: cheaper for minutes of sound.

    Args:
        count: samples.
        rng: the only source of randomness.
        rate: independent values per second.
        depth: standard deviation.

    Returns:
        (count,) of mean 0.
    """
    step = max(1, round(SAMPLE_RATE / rate))
    start = int(rng.integers(0, step))
    values = rng.normal(0.0, depth, (count + start) // step + 2)
    return upsampled(values, step, count + start)[start:]


def sloped_noise(count: int, rng: Generator, low: float, corner: float, knee: float) -> Array:
    """Noise of unit RMS: rises to ``low``, falls gently from ``corner`` and by 6 dB/octave more from ``knee`` (Hz)."""
    lead = SAMPLE_RATE // 10
    noise = rng.standard_normal(count + lead)
    high_pass = butter(1, low, "highpass", fs=SAMPLE_RATE, output="sos")
    first = butter(1, corner, fs=SAMPLE_RATE)
    second = butter(1, min(knee, 0.45 * SAMPLE_RATE), fs=SAMPLE_RATE)
    falling = sosfilt(high_pass, lfilter(*first, noise))
    # A tenth of the unfiltered noise makes the first slope gentle (3 to 5 dB/octave), as spectra of rooms are.
    return unit(lfilter(*second, falling + rng.uniform(0.04, 0.15) * noise)[lead:])


def room_tone(count: int, rng: Generator) -> Array:
    """A quiet room of unit RMS: ventilation, the mains and its harmonics, now and then a creak.

    Model: spectra that fall by about 5 dB per octave, as the RC curves do (W. E. Blazier, "Revised noise criteria for
    application in the acoustical design and rating of HVAC systems", Noise Control Engineering 16 (1981)).
    """
    corner = np.exp(rng.uniform(np.log(250.0), np.log(1200.0)))
    air = sloped_noise(count, rng, rng.uniform(150.0, 400.0), corner, rng.uniform(3000.0, 9000.0))
    air *= np.exp(slow_curve(count, rng, rng.uniform(0.3, 2.0), 0.1))
    mains = float(rng.choice([50.0, 60.0])) * (1 + rng.normal(0.0, 4e-4))
    t = time_axis(count)
    hum = np.zeros(count)
    for order in rng.choice([2, 3, 4, 5, 6, 8, 10], 2, replace=False):
        hum += rng.uniform(0.05, 0.35) * np.sin(2 * np.pi * order * mains * t + rng.uniform(0, 2 * np.pi))
    for _ in range(rng.poisson(0.15 * count / SAMPLE_RATE)):
        modes = [(rng.uniform(300, 3000), rng.uniform(0.01, 0.06), rng.uniform(0.3, 1.0)) for _ in range(3)]
        add_at(air, int(rng.integers(0, count)), rng.uniform(0.5, 3.0) * strike(modes, 0.08, rng))
    return unit(air + rng.uniform(0.1, 0.8) * hum)


def over_room_tone(signal: Array, rng: Generator) -> Array:
    """The sound of a device in a room whose level keeps every second of it above the floor of sources."""
    loudness = integrated_loudness(signal, SAMPLE_RATE)
    if not np.isfinite(loudness):
        return signal + 0.05 * room_tone(len(signal), rng)
    level = 10 ** ((rng.uniform(*_ROOM_DBFS) + loudness - TARGET_LUFS) / 20)
    return signal + level * room_tone(len(signal), rng)


def spectrum_noise(count: int, rng: Generator, knots: Sequence[float], levels_db: Sequence[float]) -> Array:
    """Gaussian noise of unit RMS with a spectrum in dB (density) between ``knots`` (Hz), linear over octaves."""
    size = next_fast_len(max(count, 2), real=True)
    frequencies = np.fft.rfftfreq(size, 1 / SAMPLE_RATE)
    octaves = np.log2(np.maximum(frequencies, 1.0))
    gains = 10 ** (np.interp(octaves, np.log2(knots), levels_db) / 20)
    gains[0] = 0.0
    # Single precision halves the time; its error lies 120 dB below.
    parts = rng.standard_normal(2 * len(gains), dtype=np.float32).view(np.complex64)
    return unit(irfft(parts * gains.astype(np.float32), size)[:count].astype(np.float64))
