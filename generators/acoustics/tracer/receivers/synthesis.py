"""From arrivals to the response of one ear, microphone or set of coincident channels.

An arrival adds to the response p(f)·d(f)·exp(−2πi·f·(t + τ)): its octave pressures, joined by the weights of `bands`,
the directivity of the receiver, and its time plus the receiver's delay τ for its direction. A directivity is given per
octave as a short sum Σ wₖ(direction)·Gₖ(f): arrivals are added up once for each k with the real weights wₖ, and the
filters Gₖ are applied to the sums. The cost per arrival therefore does not depend on the filters' lengths.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from avs3d_bench.errors import Avs3dError
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.gridding import (
    TAPS,
    Grids,
    fft_length,
    folded,
    grids_for,
    spread_of,
    window_table,
)

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
C64 = NDArray[np.complex64]
C128 = NDArray[np.complex128]

#: Seconds of the response after the last arrival: the filters of the lowest octaves have faded by 60 dB.
TAIL = 0.03
#: Seconds at the end of the FFT's period that take up what its circular filters put before time 0.
GUARD = 0.06
#: Longest response (s); a longer one is an error of whoever made the arrivals, not a room.
LONGEST = 60.0
LEAST_RATE, MOST_RATE = 8000, 192_000
#: Deviation of a direction's length from 1 that single precision explains.
_UNIT = 1e-3


@dataclass(frozen=True, eq=False)
class ReceiverPort:
    """How one point of a receiver hears the arrivals.

    Attributes:
        delay: (n,) s after the arrival at the head's centre, or 0.
        index: (n,) int32, row of ``rows`` of each arrival.
        rows: (K, C) float32, directional weights.
        columns: per octave the columns of ``rows`` that it uses, as (first, count).
        filters: per octave (bins, count) complex64: the responses whose weighted sum is the directivity, times the
            weights of the octave; the port then has one channel. None: every column is a channel of its own.
    """

    delay: F64 | float
    index: NDArray[np.int32]
    rows: F32
    columns: tuple[tuple[int, int], ...]
    filters: Sequence[C64] | None = None


def checked(arrivals: Arrivals, rotation: F64, sample_rate: int) -> F64:
    """(n, 3) float64 directions in the head's frame (x right, y up, z backward), all input checked.

    Raises:
        Avs3dError: naming what is not finite, negative, of a wrong shape or no direction.
    """
    turn = np.asarray(rotation, dtype=np.float64)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=_UNIT):
        raise Avs3dError("receiver: the listener's rotation is no orthonormal (3, 3) matrix")
    if not LEAST_RATE <= sample_rate <= MOST_RATE:
        raise Avs3dError(f"receiver: sample rate {sample_rate!r} Hz, expected {LEAST_RATE} to {MOST_RATE}")
    for name in ("time", "direction", "pressure"):
        values = getattr(arrivals, name)
        # The sum of finite numbers of such sizes is finite, and is faster to get than a test of each.
        if not math.isfinite(float(np.sum(values, dtype=np.float64))) and not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[0])
            raise Avs3dError(f"receiver: {name} of arrival {row} of {len(arrivals)} is NaN or infinite")
    if len(arrivals) and not (arrivals.time.min() >= 0 and arrivals.time.max() <= LONGEST):
        raise Avs3dError(
            f"receiver: arrival times {arrivals.time.min():g} to {arrivals.time.max():g} s, expected 0 to {LONGEST:g}"
        )
    directions = arrivals.direction.astype(np.float64)
    square = np.einsum("ij,ij->i", directions, directions)
    if len(arrivals) and np.abs(square - 1).max() > 2 * _UNIT:
        row = int(np.abs(square - 1).argmax())
        raise Avs3dError(f"receiver: direction of arrival {row} has length {math.sqrt(square[row]):.4g}, expected 1")
    # Not the product of BLAS, which may round differently with another number of threads.
    return np.asarray(np.einsum("ij,jk->ik", directions, turn))


def response_length(arrivals: Arrivals, sample_rate: int, reach: float) -> int:
    """Samples of a response whose receiver delays arrivals by up to ``reach`` seconds, filters included."""
    last = float(arrivals.time.max()) if len(arrivals) else 0.0
    return math.ceil((last + reach + TAIL) * sample_rate)


def grids_of_length(samples: int, sample_rate: int) -> Grids:
    """The grids for a response of ``samples`` samples."""
    return grids_for(fft_length(samples + math.ceil(GUARD * sample_rate)), sample_rate)


def synthesise(arrivals: Arrivals, ports: Sequence[ReceiverPort], grids: Grids, samples: int) -> F32:
    """The response (channels, samples) float32 of all ports, one after the other.

    Args:
        arrivals: finite.
        ports: one per point of the receiver.
        grids: of `grids_of_length`.
        samples: length of the response.
    """
    parts = [_port_spectra(arrivals, port, grids) for port in ports]
    spectra = np.concatenate(parts, axis=1)
    return np.ascontiguousarray(irfft(spectra, grids.samples, axis=0)[:samples].T, dtype=np.float32)


def _port_spectra(arrivals: Arrivals, port: ReceiverPort, grids: Grids) -> C128:
    """(bins, channels) spectra of one port."""
    ranks = np.array([count for _, count in port.columns])
    sizes = np.where(grids.lengths > 0, grids.lengths + TAPS, 0) * ranks
    first = np.cumsum(sizes) - sizes
    grid = np.zeros(int(sizes.sum()), dtype=np.float32)
    place = (arrivals.time + port.delay) / grids.period
    place[place < 0] += 1.0
    channels = 1 if port.filters is not None else int(ranks[0])
    spectra = np.zeros((grids.samples // 2 + 1, channels), dtype=np.complex128)
    for band in range(len(BANDS)):
        if not sizes[band]:
            continue
        spread_of(int(ranks[band]))(
            grid, first[band], grids.lengths[band], place, port.index, port.rows, port.columns[band][0],
            arrivals.pressure, band, window_table(),
        )  # fmt: skip
        sums = folded(grid[first[band] : first[band] + sizes[band]].reshape(-1, ranks[band]))
        count = grids.bins[band]
        spectrum = rfft(sums, axis=0)[:count]
        if port.filters is None:
            spectra[:count] += spectrum * grids.weights[band][:, None]
        else:
            spectra[:count, 0] += np.einsum("ij,ij->i", spectrum, port.filters[band])
    return spectra
