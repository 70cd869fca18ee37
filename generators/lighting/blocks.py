"""Blocks: 4 × 4 texels of one chart, the unit in which light that varies slowly is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.low_discrepancy import TILE
from generators.core.scene import F32, I32
from generators.lighting.surfaces import LitSurfaces, in_chunks
from generators.lighting.texels import Sheet, Texels

#: Blocks per piece of work.
_CHUNK = 1 << 12


@dataclass(frozen=True, eq=False)
class Blocks:
    """Groups of neighbouring texels of one chart: of all of them, or of those in free space (`where`).

    Attributes:
        of: (N,) int32 block of a texel, -1 for texels that are in none.
        members: the texels ordered by block.
        start: (B + 1,) int64, block b owns ``members[start[b]:start[b + 1]]``.
        place: (B, 3) int64 chart, row and column of the tile that holds the block.
    """

    of: I32
    members: NDArray[np.int64]
    start: NDArray[np.int64]
    place: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start) - 1

    def mean(self, values: F32, measured: NDArray[np.bool_] | None = None, workers: int = 1) -> F32:
        """(B, C) mean over each block of (N, C) ``values``; of those that are ``measured`` (N,), where it is given.

        It is computed on ``workers`` threads and does not depend on them.
        """
        out = np.zeros((len(self), values.shape[1]), dtype=np.float32)

        def work(first: int, last: int) -> None:
            begin, start = self.start[first], self.start[first:last]
            own = self.members[begin : self.start[last]]
            weight = np.ones(len(own)) if measured is None else measured[own].astype(np.float64)
            total = np.add.reduceat(values[own] * weight[:, None], start - begin, axis=0)
            number = np.add.reduceat(weight, start - begin)
            out[first:last] = total / np.maximum(number, 1.0)[:, None]

        in_chunks(work, len(self), _CHUNK, workers)
        return out

    def where(self, kept: NDArray[np.bool_]) -> Blocks:
        """The blocks of the texels for which ``kept`` (N,) is true; a block without such a texel is gone."""
        members = self.members[kept[self.members]]
        return _grouped(members, self.place[self.of[members]], len(self.of))


def make_blocks(surfaces: LitSurfaces, sheet: Sheet, texels: Texels, workers: int = 1) -> Blocks:
    """Group all texels, on ``workers`` threads; the result does not depend on them."""
    count = len(texels)
    members, place = np.empty(count, dtype=np.int64), np.empty((count, 3), dtype=np.int64)
    # Texels and charts are both ordered by part.
    begin = np.searchsorted(texels.cell, sheet.offset)

    def group(part: int, _: int) -> None:
        own = slice(begin[part], begin[part + 1])
        row, column = np.divmod(texels.cell[own] - sheet.offset[part], sheet.width[part])
        chart = sheet.chart[texels.face[own]].astype(np.int64)
        order = np.lexsort((column // TILE, row // TILE, chart))  # stable: by number within a block
        members[own] = order + begin[part]
        place[own] = np.stack([chart, row // TILE, column // TILE], axis=1)[order]

    in_chunks(group, len(sheet.width), 1, workers)
    return _grouped(members, place, count)


def _grouped(members: NDArray[np.int64], place: NDArray[np.int64], texels: int) -> Blocks:
    """Blocks of ``members`` (M,), numbers of texels ordered by ``place`` (M, 3); ``texels`` is how many there are."""
    fresh = np.ones(len(members), dtype=bool)
    fresh[1:] = False
    for column in place.T:
        fresh[1:] |= column[1:] != column[:-1]
    of = np.full(texels, -1, dtype=np.int32)
    of[members] = np.cumsum(fresh) - 1
    first = np.flatnonzero(fresh)
    return Blocks(of=of, members=members, start=np.append(first, len(members)).astype(np.int64), place=place[first])
