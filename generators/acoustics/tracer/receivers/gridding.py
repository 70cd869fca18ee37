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
from generators.core.jit import inline, njit

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


def _block(rank: int) -> Callable[..., None]:
    """A function that adds one arrival to a grid of ``rank`` channels; with a constant rank its loops are unrolled."""

    @inline
    def add(  # pragma: no cover  # compiled
        grid: F32, start: int, row: F32, column: int, pressure: float, table: F32, step: int
    ) -> None:
        for tap in range(TAPS):
            amount = pressure * table[step, tap]
            for k in range(rank):
                grid[start + tap * rank + k] += amount * row[column + k]

    return add


#: Ranks with a function of their own; a basis has as many components as one of them.
RANKS = (1, 2, 4, 6, 8, 9, 12, 16)
_add_1, _add_2, _add_4, _add_6, _add_8, _add_9, _add_12, _add_16 = (_block(rank) for rank in RANKS)


@njit
def spread(  # pragma: no cover  # compiled
    grid: F32,
    layout: I64,
    time: F64,
    period: float,
    index: NDArray[np.int32],
    rows: F32,
    pressure: F32,
    table: F32,
) -> None:
    """Add arrivals to the grids of all octaves, in order.

    Args:
        grid: (G,) all grids, one after the other; that of an octave is (length + TAPS, rank), row after row, and begins
            TAPS/2 − 1 samples before time 0: `folded` joins its ends. Changed.
        layout: (8, 4) per octave: first element in ``grid``, length, rank (of `RANKS`), first column in ``rows``.
        time: (n,) s, from −period on and below period.
        period: s that every grid spans.
        index: (n,) row of ``rows`` for each arrival.
        rows: (K, C) weights of an octave's ``rank`` channels.
        pressure: (n, 8).
        table: `window_table`.
    """
    for i in range(len(time)):
        place = time[i] / period
        if place < 0:
            place += 1.0
        row = rows[index[i]]
        for band in range(layout.shape[0]):
            length, rank, column = layout[band, 1], layout[band, 2], layout[band, 3]
            p = pressure[i, band]
            if length == 0 or p == 0:
                continue
            u = place * length
            whole = int(u)
            step = int((u - whole) * FRACTIONS)
            start = layout[band, 0] + whole * rank
            if rank == 1:
                _add_1(grid, start, row, column, p, table, step)
            elif rank == 2:
                _add_2(grid, start, row, column, p, table, step)
            elif rank == 4:
                _add_4(grid, start, row, column, p, table, step)
            elif rank == 6:
                _add_6(grid, start, row, column, p, table, step)
            elif rank == 8:
                _add_8(grid, start, row, column, p, table, step)
            elif rank == 9:
                _add_9(grid, start, row, column, p, table, step)
            elif rank == 12:
                _add_12(grid, start, row, column, p, table, step)
            else:
                _add_16(grid, start, row, column, p, table, step)


def folded(grid: F32) -> F32:
    """(length, rank) samples of a periodic grid from the (length + TAPS, rank) that `spread` filled."""
    before = TAPS // 2 - 1
    length = len(grid) - TAPS
    samples = grid[before : before + length].copy()
    samples[length - before :] += grid[:before]
    samples[: TAPS - before] += grid[before + length :]
    return samples
