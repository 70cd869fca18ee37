"""Arrivals at arbitrary times onto regular grids of samples, exactly: a non-uniform Fourier transform (type 1).

The spectrum of arrivals at times t is Σ p·exp(−2πi·f·t). To get it with an FFT, each arrival is spread over `TAPS`
samples of a grid with a Kaiser–Bessel window, and the spectrum of the grid is divided by that of the window. So every
arrival, early or late, keeps its time to far below a sample, and there is no filter for fractional delays.

An octave needs its grid only as fine as its highest frequency asks for: the grids of the lower octaves are short.

References:
    A. Dutt, V. Rokhlin, "Fast Fourier transforms for nonequispaced data", SIAM J. Sci. Comput. 14 (1993) 1368–1393.
    J. Fessler, B. Sutton, "Nonuniform fast Fourier transforms using min-max interpolation", IEEE Trans. Signal
    Processing 51 (2003) 560–574 (Kaiser–Bessel window, its shape and its transform).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.special import i0

from generators.acoustics.tracer.receivers.bands import band_weights, roll_off, upper_edges
from generators.core.jit import njit

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Samples over which an arrival is spread.
TAPS = 4
#: Rate of a grid divided by the least that its highest frequency needs (twice that frequency).
OVERSAMPLING = 1.5
#: Fractions of a sample for which the window is tabulated; the nearest one is used.
FRACTIONS = 1024
#: Shape of the Kaiser–Bessel window: the largest for which aliases of the pass-band stay outside of its main lobe.
_SHAPE = 0.98 * math.pi * TAPS * (1 - 1 / (2 * OVERSAMPLING))


@lru_cache(maxsize=1)
def window_table() -> F32:
    """(FRACTIONS, TAPS) weights of the samples floor(u) − TAPS/2 + 1 … for u − floor(u) = (k + 1/2)/FRACTIONS."""
    fraction = (np.arange(FRACTIONS) + 0.5) / FRACTIONS
    offset = np.arange(TAPS)[None, :] - (TAPS // 2 - 1) - fraction[:, None]
    inside = np.maximum(1 - (2 * offset / TAPS) ** 2, 0.0)
    return np.where(np.abs(offset) < TAPS / 2, i0(_SHAPE * np.sqrt(inside)), 0.0).astype(np.float32)


def window_spectrum(cycles: F64) -> F64:
    """Fourier transform of the window at ``cycles`` per sample, |cycles| < _SHAPE/(π·TAPS): TAPS·sinh(s)/s."""
    s = np.sqrt(_SHAPE**2 - (np.pi * TAPS * cycles) ** 2)
    return np.asarray(TAPS * np.sinh(s) / s)


@dataclass(frozen=True, eq=False)
class Grids:
    """The grids of all octaves for responses of one length.

    Attributes:
        sample_rate: Hz, of the response.
        samples: length of the response's FFT; all grids span the same period, samples/sample_rate seconds.
        lengths: (8,) samples of each octave's grid; 0 for an octave above the Nyquist frequency.
        bins: (8,) number of the FFT's bins, from 0 Hz on, that an octave contributes to.
        weights: per octave (bins,): its filter, divided by the window's spectrum, with the roll-off at the top.
    """

    sample_rate: int
    samples: int
    lengths: I64
    bins: I64
    weights: tuple[F64, ...]

    @property
    def period(self) -> float:
        """Seconds that a grid spans before it repeats."""
        return self.samples / self.sample_rate


@lru_cache(maxsize=64)
def grids_for(samples: int, sample_rate: int) -> Grids:
    """The grids for an FFT of ``samples`` samples."""
    frequencies = np.arange(samples // 2 + 1) * (sample_rate / samples)
    shape = band_weights(frequencies) * roll_off(frequencies, sample_rate)
    lengths, bins, weights = [], [], []
    for band, edge in enumerate(upper_edges(sample_rate)):
        count = min(int(edge * samples / sample_rate) + 1, len(frequencies)) if edge > 0 else 0
        length = next_fast_len(max(math.ceil(2 * OVERSAMPLING * count), 2 * TAPS), real=True) if count else 0
        lengths.append(length)
        bins.append(count)
        weights.append(shape[band, :count] / window_spectrum(np.arange(count) / max(length, 1)))
    return Grids(sample_rate, samples, np.array(lengths), np.array(bins), tuple(weights))


def fft_length(least: int) -> int:
    """A length of at least ``least`` samples out of few, so that filters of one length serve many responses."""
    power = 1 << max(least - 1, 1023).bit_length()
    # 5/8, 3/4, 7/8 or all of a power of two: at most a fifth too long.
    return next(power * eighth // 8 for eighth in (5, 6, 7, 8) if power * eighth // 8 >= least)


#: Numbers of channels that grids have. Each has a loop of its own, compiled when it is first used: with a constant
#: number of channels it is unrolled.
RANKS = (1, 2, 4, 6, 8, 9, 12, 16)


@lru_cache(maxsize=len(RANKS))
def spread_of(rank: int) -> Callable[..., None]:
    """The compiled function that adds arrivals to the grid of an octave with ``rank`` channels, in order.

    Its arguments:
        grid: (G,) float32; from ``first`` on the octave's (length + TAPS, rank), row after row, beginning TAPS/2 − 1
            samples before time 0: `folded` joins its ends. Changed.
        first: first element.
        length: of the grid, samples.
        place: (n,) float64 time of each arrival as a share of the grid's period, below 1.
        index: (n,) int32 row of ``rows`` for each arrival.
        rows: (K, C) float32 weights of the channels.
        column: first column of the octave.
        pressure: (n, 8) float32.
        band: number of the octave.
        table: `window_table`.
    """

    @njit
    def spread(  # pragma: no cover  # compiled
        grid: F32,
        first: int,
        length: int,
        place: F64,
        index: NDArray[np.int32],
        rows: F32,
        column: int,
        pressure: F32,
        band: int,
        table: F32,
    ) -> None:
        for i in range(len(place)):
            p = pressure[i, band]
            if p == 0:
                continue
            u = place[i] * length
            whole = int(u)
            step = int((u - whole) * FRACTIONS)
            start = first + whole * rank
            row = index[i]
            for tap in range(TAPS):
                amount = p * table[step, tap]
                for k in range(rank):
                    grid[start + tap * rank + k] += amount * rows[row, column + k]

    return spread


def folded(grid: F32) -> F32:
    """(length, rank) samples of a periodic grid from the (length + TAPS, rank) that `spread` filled."""
    before = TAPS // 2 - 1
    length = len(grid) - TAPS
    samples = grid[before : before + length].copy()
    samples[length - before :] += grid[:before]
    samples[: TAPS - before] += grid[before + length :]
    return samples
