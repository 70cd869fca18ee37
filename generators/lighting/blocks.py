"""Blocks: 4 × 4 texels of one chart, the unit in which light that varies slowly is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.low_discrepancy import TILE
from generators.core.scene import F32, I32
from generators.lighting.surfaces import Surfaces
from generators.lighting.texels import Sheet, Texels


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

    def mean(self, values: F32, measured: NDArray[np.bool_] | None = None) -> F32:
        """(B, C) mean over each block of (N, C) ``values``; of those that are ``measured`` (N,), where it is given."""
        if not len(self):
            return np.zeros((0, values.shape[1]), dtype=np.float32)
        weight = np.ones(len(self.members)) if measured is None else measured[self.members].astype(np.float64)
        total = np.add.reduceat(values[self.members] * weight[:, None], self.start[:-1], axis=0)
        number = np.add.reduceat(weight, self.start[:-1])
        return np.asarray(total / np.maximum(number, 1.0)[:, None], dtype=np.float32)

    def where(self, kept: NDArray[np.bool_]) -> Blocks:
        """The blocks of the texels for which ``kept`` (N,) is true; a block without such a texel is gone."""
        members = self.members[kept[self.members]]
        return _grouped(members, self.place[self.of[members]], len(self.of))


def make_blocks(surfaces: Surfaces, sheet: Sheet, texels: Texels) -> Blocks:
    """Group all texels."""
    part = surfaces.part[texels.face]
    local = texels.cell - sheet.offset[part]
    column, row = local % sheet.width[part] // TILE, local // sheet.width[part] // TILE
    chart = sheet.chart[texels.face].astype(np.int64)
    members = np.lexsort((column, row, chart))  # stable: by number within a block
    return _grouped(members, np.stack([chart, row, column], axis=1)[members], len(texels))


def _grouped(members: NDArray[np.int64], place: NDArray[np.int64], texels: int) -> Blocks:
    """Blocks of ``members`` (M,), numbers of texels ordered by ``place`` (M, 3); ``texels`` is how many there are."""
    fresh = np.ones(len(members), dtype=bool)
    fresh[1:] = np.any(place[1:] != place[:-1], axis=1)
    of = np.full(texels, -1, dtype=np.int32)
    of[members] = np.cumsum(fresh) - 1
    first = np.flatnonzero(fresh)
    return Blocks(of=of, members=members, start=np.append(first, len(members)).astype(np.int64), place=place[first])
