"""A directivity as a short sum of filters with directional weights, per octave.

Once the delay of each direction is taken out, the responses of a head to neighbouring directions are alike, and within
an octave a few principal components describe them all: H(f, direction) ≈ Σ wₖ(direction)·Gₖ(f), with real weights. Each
direction counts by the solid angle it stands for and relative to its own energy, so that the quiet side of a head is as
accurate as the loud one. What the sum leaves out is made up for by a factor, so that every direction has its exact
energy in every octave: levels and their interaural differences do not depend on the number of components.

References:
    D. J. Kistler, F. L. Wightman, "A model of head-related transfer functions based on principal components analysis
    and minimum-phase reconstruction", JASA 91 (1992) 1637–1647.
    M. J. Evans, J. A. S. Angus, A. I. Tew, "Analyzing head-related transfer function measurements using surface
    spherical harmonics", JASA 104 (1998) 2400–2411 (why the delay is taken out first).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from generators.acoustics.tracer.arrivals import BANDS
from generators.acoustics.tracer.receivers.bands import band_weights
from generators.acoustics.tracer.receivers.gridding import RANKS, Grids
from generators.core.blas import one_blas_thread

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
C64 = NDArray[np.complex64]
C128 = NDArray[np.complex128]


@dataclass(frozen=True)
class Components:
    """How many components an octave gets.

    As few as keep the root mean square error over the octave's directions and frequencies below two limits:

    Attributes:
        accuracy: of the complex response, relative to it.
        timing: s; the error as a phase, 2πf·timing at the octave's centre. It decides at low frequencies, where a small
            error of the phase is a great one of the delay.
        most: most components, whatever the error.
    """

    accuracy: float
    timing: float
    most: int

    def largest_error(self, band: int) -> float:
        """Largest relative error in octave ``band`` of `BANDS`."""
        return min(self.accuracy, 2 * np.pi * BANDS[band] * self.timing)


#: Start of the filters' taper to 0 at the Nyquist frequency, as a fraction of it: a real filter cannot have a phase
#: there.
_TAPER = 0.94
#: Bits of the filters' and weights' largest value (`_on_grid`).
_GRID_BITS = 26


@dataclass(frozen=True, eq=False)
class DirectionalBasis:
    """Weights and filters of a directivity.

    Attributes:
        sample_rate: Hz.
        rows: (T, C) float32, weights of every tabulated direction; the columns of all octaves, one after the other.
        columns: per octave (first column, number of columns).
        impulses: (C, L) float64, the filters; times before 0 are at the end.
        error_db: (8,) root mean square error relative to the response, dB; 0 for an octave above the Nyquist frequency.
    """

    sample_rate: int
    rows: F32
    columns: tuple[tuple[int, int], ...]
    impulses: F64
    error_db: F64

    def filters(self, grids: Grids) -> tuple[C64, ...]:
        """Per octave (bins, columns) complex64: the filters' responses times the octave's weights, for `Port`."""
        return _filters(self, grids)


@lru_cache(maxsize=16)
def _filters(basis: DirectionalBasis, grids: Grids) -> tuple[C64, ...]:
    samples = grids.samples
    half = basis.impulses.shape[1] // 2
    padded = np.zeros((len(basis.impulses), samples))
    padded[:, :half] = basis.impulses[:, :half]
    padded[:, -half:] = basis.impulses[:, -half:]
    spectra = rfft(padded, axis=1)
    return tuple(
        np.ascontiguousarray((spectra[first : first + count, : len(weights)] * weights).T, dtype=np.complex64)
        for (first, count), weights in zip(basis.columns, grids.weights, strict=True)
    )


@one_blas_thread
def directional_basis(responses: C128, solid_angles: F64, sample_rate: int, components: Components) -> DirectionalBasis:
    """Principal components of ``responses``, as many in each octave as are needed.

    Args:
        responses: (T, F) spectra of the tabulated directions at F = L/2 + 1 frequencies from 0 to the Nyquist
            frequency, their delays taken out.
        solid_angles: (T,) weight of each direction.
        sample_rate: Hz.
        components: how many they are.
    """
    frequencies = np.linspace(0.0, sample_rate / 2, responses.shape[1])
    rows, columns, spectra, errors = [], [], [], []
    first = 0
    for band, weight in enumerate(band_weights(frequencies)):
        if not weight.any():
            columns.append((first, 0))
            errors.append(0.0)
            continue
        directional, filters, error = _components(
            responses, weight, solid_angles, components.largest_error(band), components.most
        )
        rows.append(directional)
        spectra.append(filters)
        errors.append(error)
        columns.append((first, directional.shape[1]))
        first += directional.shape[1]
    place = frequencies / (sample_rate / 2)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.clip((place - _TAPER) / (1 - _TAPER), 0.0, 1.0))
    impulses = _on_grid(irfft(np.concatenate(spectra) * taper, axis=1))
    assert len(columns) == len(BANDS)
    table = np.ascontiguousarray(_on_grid(np.concatenate(rows, axis=1)), dtype=np.float32)
    return DirectionalBasis(sample_rate, table, tuple(columns), impulses, np.array(errors))


def _on_grid(values: F64) -> F64:
    """Values rounded to multiples of a power of two, 2⁻²⁶ of the largest (−156 dB): less than responses resolve.

    The last bits of a decomposition depend on the processor's BLAS kernels; those of a response must not.
    """
    step = 2.0 ** (np.ceil(np.log2(np.abs(values).max())) - _GRID_BITS)
    return np.asarray(np.round(values / step) * step)


def _components(
    responses: C128, weight: F64, solid_angles: F64, largest_error: float, most: int
) -> tuple[F64, C128, float]:
    """Weights (T, R), filters (R, F) and relative error (dB) of one octave."""
    inside = weight > 0
    shaped = responses[:, inside] * weight[inside]
    relative = np.concatenate([shaped.real, shaped.imag], axis=1)
    energy = np.linalg.norm(relative, axis=1)
    if not energy.any():  # a measured head above the file's own Nyquist frequency
        return np.zeros((len(responses), 1)), np.zeros((1, responses.shape[1]), dtype=np.complex128), 0.0
    # A direction without any sound in this octave has nothing to be relative to.
    scale = np.where(energy > 0, energy, 1.0)
    relative /= scale[:, None]
    share = np.sqrt(solid_angles / solid_angles.sum())
    weighted = relative * share[:, None]
    # The triangular factor has the same axes, and far fewer rows where there are thousands of directions.
    small = np.linalg.qr(weighted, mode="r") if len(weighted) > weighted.shape[1] else weighted
    _, singular, axes = np.linalg.svd(small, full_matrices=False)
    total = float(np.sum(singular**2))
    left = np.sqrt(np.maximum(total - np.cumsum(singular**2), 0.0) / total)
    enough = np.flatnonzero(left <= largest_error)
    wanted = int(enough[0]) + 1 if len(enough) else most
    # A kernel's ranks are few: between two of them the next one costs no more.
    count = min(next(rank for rank in RANKS if rank >= min(wanted, most)), len(axes))
    directional = relative @ axes[:count].T
    # The least-squares fit of the filters at all frequencies: the columns of weights are orthogonal.
    power = np.maximum(singular[:count] ** 2, np.finfo(np.float64).eps * total)
    filters = ((directional * (share**2 / scale)[:, None]).T @ responses) / power[:, None]
    found = np.linalg.norm(directional, axis=1)  # the axes are orthonormal
    directional *= (energy / np.where(found > 0, found, 1.0))[:, None]
    return directional, filters, 20 * float(np.log10(max(left[count - 1], 1e-15)))
