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
    """Groups of neighbouring open texels of one chart.

    Attributes:
        of: (N,) int32 block of a texel, -1 for texels inside of things.
        members: open texels ordered by block.
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


def make_blocks(surfaces: Surfaces, sheet: Sheet, texels: Texels, is_open: NDArray[np.bool_]) -> Blocks:
    """Group the texels for which ``is_open`` (N,) is true."""
    part = surfaces.part[texels.face]
    local = texels.cell - sheet.offset[part]
    column, row = local % sheet.width[part] // TILE, local // sheet.width[part] // TILE
    chart = sheet.chart[texels.face].astype(np.int64)
    members = np.flatnonzero(is_open)
    order = np.lexsort((members, column[members], row[members], chart[members]))
    members = members[order]
    keys = np.stack([chart[members], row[members], column[members]], axis=1)
    fresh = np.ones(len(members), dtype=bool)
    fresh[1:] = np.any(keys[1:] != keys[:-1], axis=1)
    of = np.full(len(texels), -1, dtype=np.int32)
    of[members] = np.cumsum(fresh) - 1
    first = np.flatnonzero(fresh)
    return Blocks(of=of, members=members, start=np.append(first, len(members)).astype(np.int64), place=keys[first])
