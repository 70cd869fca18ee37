"""Late sound whose fine structure is the same everywhere, so that responses change smoothly with position.

Detected rays are a random sample: a ray that a listener's disc just misses at one place is there at full strength a
hair's breadth on, so that the waveforms of two near places differ by more than the room explains. Here the rays only
say how much energy comes when and from where. It is put on carriers: arrivals at fixed times, from fixed directions
and with fixed signs, which depend on the seed alone. Only their amplitudes depend on source and listener.

Energies are those of cells of time, into which an arrival between the centres of two counts in proportion (a linear
spline); directions in a cell are a von Mises–Fisher density with the mean direction vector of its arrivals (its
concentration after A. Banerjee et al., J. Machine Learning Research 6 (2005) 1345–1382, eq. 4.4). Nothing of this jumps
where an arrival moves. Echoes of scattered sound closer together than a cell, and directions finer than one
preferred direction per cell, are lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.arrivals import BANDS, Arrivals

F64 = NDArray[np.float64]

#: Distance of the centres of two cells, s.
_CELL = 0.005
#: Carriers per cell: as dense as the arrivals of a trace are in a living room.
_PER_CELL = 125
#: Largest length of a mean direction vector; 1 would be a single direction.
_MOST_ALIKE = 0.95
_LEAST = 1e-30


@dataclass(frozen=True, eq=False)
class _Carriers:
    """``time`` (n,) s, ``direction`` (n, 3), ``sign`` (n,): prefixes of one endless sequence."""

    time: F64
    direction: F64
    sign: F64

    @classmethod
    def drawn(cls, cells: int, seed: int) -> _Carriers:
        drawn = np.random.Generator(np.random.Philox(key=seed)).random((cells * _PER_CELL, 4))
        height, turn = 2 * drawn[:, 1] - 1, 2 * np.pi * drawn[:, 2]
        flat = np.sqrt(1 - height**2)
        direction = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
        time = (np.arange(len(drawn)) + drawn[:, 0]) * (_CELL / _PER_CELL)
        return cls(time, direction, np.where(drawn[:, 3] < 0.5, 1.0, -1.0))


def on_carriers(late: Arrivals, soonest: float, seed: int) -> Arrivals:
    """The energy of ``late`` on carriers; the energy in each octave stays.

    Args:
        late: arrivals whose sum is a sum of energies.
        soonest: s; nothing comes before (the time of the straight line from the source).
        seed: of the carriers.
    """
    if not len(late):
        return late
    energy = np.square(late.pressure, dtype=np.float64)
    cells = int(late.time.max() / _CELL) + 2
    spread = _shares(late.time)
    sums = _summed(np.concatenate([energy, energy.sum(axis=1, keepdims=True) * late.direction], axis=1), spread, cells)
    mean = sums[:, len(BANDS) :] / np.maximum(sums[:, : len(BANDS)].sum(axis=1, keepdims=True), _LEAST)
    carriers = _Carriers.drawn(cells - 1, seed)
    spread = _shares(carriers.time)
    # Cells reach back by their width: carriers begin softly where sound can have come.
    open_ = np.clip((carriers.time - soonest) / _CELL, 0.0, 1.0)
    weights = [share * open_ * _density(mean[cell], carriers.direction) for cell, share in spread]
    taken = sum(np.bincount(cell, weight, cells) for (cell, _), weight in zip(spread, weights, strict=True))
    per_weight = sums[:, : len(BANDS)] / np.maximum(taken, _LEAST)[:, None]
    found = sum(per_weight[cell] * weight[:, None] for (cell, _), weight in zip(spread, weights, strict=True))
    pressure = carriers.sign[:, None] * np.sqrt(found)
    heard = pressure.any(axis=1)
    return Arrivals(
        carriers.time[heard], carriers.direction[heard].astype(np.float32), pressure[heard].astype(np.float32)
    )


def _shares(time: F64) -> list[tuple[NDArray[np.int64], F64]]:
    """The two cells of each time and its share in them."""
    cell = np.asarray(time / _CELL, dtype=np.int64)
    after = time / _CELL - cell
    return [(cell, 1 - after), (cell + 1, after)]


def _summed(values: F64, spread: list[tuple[NDArray[np.int64], F64]], cells: int) -> F64:
    """(cells, columns) sums of ``values`` (n, columns)."""
    columns = [
        np.asarray(sum(np.bincount(cell, share * column, cells) for cell, share in spread)) for column in values.T
    ]
    return np.stack(columns, axis=1)


def _density(mean: F64, direction: F64) -> F64:
    """(n,) von Mises–Fisher density, up to a factor of the cell, about mean direction vectors (n, 3)."""
    length = np.linalg.norm(mean, axis=1)
    alike = np.minimum(length, _MOST_ALIKE)
    concentration = alike * (3 - alike**2) / (1 - alike**2)
    towards = np.einsum("ij,ij->i", mean, direction) / np.maximum(length, _LEAST)
    return np.asarray(np.exp(concentration * (towards - 1)))
