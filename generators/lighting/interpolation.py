"""Indirect light that is measured per block, interpolated to texels where it varies slowly.

The distance over which indirect light changes is about the harmonic mean of the distances to what a point sees (Ward
et al., "A ray tracing solution for diffuse interreflection", SIGGRAPH 1988). Where it is several times the size of a
block, the light of the blocks around is as good as rays of every texel's own, and has less noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import njit
from generators.core.low_discrepancy import TILE
from generators.core.scene import F32, I32
from generators.lighting.blocks import Blocks
from generators.lighting.surfaces import in_chunks
from generators.lighting.texels import Sheet, Texels

#: A block is far from everything if the harmonic mean distance is at least this many times its side.
_FAR = 3.0
#: From this ratio on every other texel is gathered, like the black squares of a chessboard.
_NEAR = 0.5
#: Least length of the mean of a block's unit normals: a block on a curve tighter than this is gathered per texel.
_FLAT = 0.97
#: Blocks this many rows and columns away take part in the interpolation.
_RINGS = 2
#: Radius of the interpolation's kernel (texels).
_RADIUS = 9.0
#: Added to the variance of the blocks' places (texels²), so that one or two blocks give no wild slope.
_RIDGE = 0.5
#: Texels and blocks per piece of work.
_TEXELS, _BLOCKS = 1 << 14, 1 << 12


def _around(blocks: Blocks, workers: int = 1) -> I32:
    """(B, 25) the blocks in the tiles around each block, of the same chart; -1 where there is none."""
    if not len(blocks):
        return np.zeros((0, (2 * _RINGS + 1) ** 2), dtype=np.int32)
    chart, row, column = blocks.place.T
    rows, columns = int(row.max()) + 2 * _RINGS + 1, int(column.max()) + 2 * _RINGS + 1
    # Ascending, because blocks are ordered by chart, row and column.
    key = (chart * rows + row + _RINGS) * columns + column + _RINGS
    steps = range(-_RINGS, _RINGS + 1)
    wanted = [dy * columns + dx for dy in steps for dx in steps]
    found = np.empty((len(key), len(wanted)), dtype=np.int32)

    def look(first: int, last: int) -> None:
        own = key[first:last]
        for number, step in enumerate(wanted):
            at = np.minimum(np.searchsorted(key, own + step), len(key) - 1)
            found[first:last, number] = np.where(key[at] == own + step, at, -1)

    in_chunks(look, len(key), _BLOCKS, workers)
    return found


@njit
def _fit(
    texel: NDArray[np.int64],
    of: I32,
    place: F32,
    normal: F32,
    around: I32,
    centre: F32,
    facing: F32,
    trust: F32,
    light: F32,
    radius: float,
    ridge: float,
    out: F32,
) -> None:
    """Weighted linear regression over the blocks around, evaluated at each texel."""
    count = around.shape[1]
    weight = np.empty(count)
    for t in texel:
        b = of[t]
        sum_w = sum_x = sum_y = sum_xx = sum_xy = sum_yy = 0.0
        for k in range(count):
            weight[k] = 0.0
            other = around[b, k]
            if other < 0:
                continue
            x, y = centre[other, 0] - place[t, 0], centre[other, 1] - place[t, 1]
            near = 1.0 - (x * x + y * y) / (radius * radius)
            turn = 0.0
            for c in range(3):
                turn += facing[other, c] * normal[t, c]
            turn = (turn - 0.7) / 0.3
            if near <= 0.0 or turn <= 0.0:
                continue
            w = near * near * turn * trust[other]
            weight[k] = w
            sum_w += w
            sum_x += w * x
            sum_y += w * y
            sum_xx += w * x * x
            sum_xy += w * x * y
            sum_yy += w * y * y
        if sum_w <= 0.0:
            for c in range(3):
                out[t, c] = light[b, c]
            continue
        mean_x, mean_y = sum_x / sum_w, sum_y / sum_w
        xx, xy = sum_xx / sum_w - mean_x * mean_x + ridge, sum_xy / sum_w - mean_x * mean_y
        yy = sum_yy / sum_w - mean_y * mean_y + ridge
        det = xx * yy - xy * xy
        slope_x, slope_y = (yy * mean_x - xy * mean_y) / det, (xx * mean_y - xy * mean_x) / det
        red = green = blue = 0.0
        for k in range(count):
            if weight[k] == 0.0:
                continue
            other = around[b, k]
            x, y = centre[other, 0] - place[t, 0], centre[other, 1] - place[t, 1]
            w = weight[k] / sum_w * (1.0 - slope_x * (x - mean_x) - slope_y * (y - mean_y))
            red += w * light[other, 0]
            green += w * light[other, 1]
            blue += w * light[other, 2]
        out[t, 0], out[t, 1], out[t, 2] = max(red, 0.0), max(green, 0.0), max(blue, 0.0)


@njit
def _beside(
    chosen: Any,
    chart: I32,
    place: F32,
    cell: NDArray[np.int64],
    width: NDArray[np.int64],
    index: I32,
    of: I32,
    beside: I32,
) -> None:
    """The texels (4 of each of ``chosen``) left, right, above and below that are of the same chart and in a block."""
    for i in range(len(chosen)):
        t = chosen[i]
        for k in range(4):
            dx, dy = (k - 1 if k % 2 == 0 else 0), (k - 2 if k % 2 == 1 else 0)
            beside[i, k] = -1
            x = int(place[t, 0]) + dx
            if x < 0 or x >= width[t]:
                continue
            at = cell[t] + dy * width[t] + dx
            if at < 0 or at >= len(index):
                continue
            other = index[at]
            if other >= 0 and chart[other] == chart[t] and of[other] >= 0:
                beside[i, k] = other


@njit
def _average(chosen: NDArray[np.int64], beside: I32, light: F32, variance: F32) -> None:
    for i in range(len(chosen)):
        t = chosen[i]
        count = 0
        red = green = blue = noise = 0.0
        for k in range(4):
            other = beside[i, k]
            if other < 0:
                continue
            red += light[other, 0]
            green += light[other, 1]
            blue += light[other, 2]
            noise += variance[other]
            count += 1
        light[t, 0], light[t, 1], light[t, 2] = red / count, green / count, blue / count
        variance[t] = noise / count


@dataclass(frozen=True, eq=False)
class Slow:
    """Where light varies slowly.

    Attributes:
        blocks: all blocks.
        is_slow: (B,) whether the light of a block's texels is to be interpolated.
        trust: (B,) float32 how much a block counts in the interpolation: less, the nearer something is.
        facing: (B, 3) float32 mean direction of a block's normals.
        place: (N, 2) float32 column and row of each texel.
        around: (B, 25) int32 see `_around`.
        between: (K,) int64 texels of other blocks whose light is the mean of that of their neighbours.
        beside: (K, 4) int32 these neighbours, -1 where there is none.
    """

    blocks: Blocks
    is_slow: NDArray[np.bool_]
    trust: F32
    facing: F32
    place: F32
    around: I32
    between: NDArray[np.int64]
    beside: I32

    @staticmethod
    def of(
        sheet: Sheet,
        part: I32,
        texels: Texels,
        blocks: Blocks,
        distance: F32,
        is_enclosed: NDArray[np.bool_] | None = None,
        workers: int = 1,
    ) -> Slow:
        """Judge all blocks.

        Args:
            sheet: the light maps.
            part: (N,) part of each texel.
            texels: the texels.
            blocks: their groups.
            distance: (B,) harmonic mean of the distances to what a block sees, metres.
            is_enclosed: (B,) whether a block lies in a narrow gap, where no camera sees it: its light is
                interpolated. None is if missing.
            workers: threads; the result does not depend on them.
        """
        place, side = np.empty((len(texels), 2), dtype=np.float32), np.empty((len(texels), 1), dtype=np.float32)

        def measure(first: int, last: int) -> None:
            own = slice(first, last)
            row, column = np.divmod(texels.cell[own] - sheet.offset[part[own]], sheet.width[part[own]])
            place[own, 0], place[own, 1] = column, row
            side[own, 0] = np.linalg.norm(texels.across[own], axis=2).max(axis=1)

        in_chunks(measure, len(texels), _TEXELS, workers)
        size = TILE * blocks.mean(side, workers=workers)[:, 0]
        ratio = distance / np.maximum(size, 1e-9)
        facing = blocks.mean(texels.normal, workers=workers)
        length = np.linalg.norm(facing, axis=1)
        facing /= np.maximum(length, 1e-9)[:, None]
        trust = np.clip(ratio / _FAR, 0.05, 1.0) ** 2
        is_slow = (ratio >= _FAR) & (length >= _FLAT)
        if is_enclosed is not None:
            is_slow |= is_enclosed
        some = (ratio >= _NEAR) & (length >= _FLAT) & ~is_slow
        members = blocks.members
        between = members[some[blocks.of[members]]]
        between = between[(place[between, 0] + place[between, 1]) % 2 == 1]
        beside = np.empty((len(between), 4), dtype=np.int32)
        chart, width = sheet.chart[texels.face], sheet.width[part]

        def look(first: int, last: int) -> None:
            own = between[first:last]
            _beside(own, chart, place, texels.cell, width, texels.index, blocks.of, beside[first:last])

        in_chunks(look, len(between), _TEXELS, workers)
        enough = (beside >= 0).sum(axis=1) >= 2
        trusted = trust.astype(np.float32)
        return Slow(
            blocks,
            is_slow,
            trusted,
            facing,
            place,
            _around(blocks, workers),
            between[enough],
            np.ascontiguousarray(beside[enough]),
        )

    def measured_apart(self) -> NDArray[np.bool_]:
        """(N,) the texels of blocks that are not slow whose light is to be measured."""
        of = self.blocks.of
        apart = (of >= 0) & ~self.is_slow[of]
        apart[self.between] = False
        return np.asarray(apart)

    def fill_between(self, light: F32, variance: F32) -> None:
        """Give ``light`` (N, 3) and ``variance`` (N,) at the texels `between` the mean of their neighbours."""
        _average(self.between, self.beside, light, variance)

    def sites(self, texels: Texels) -> NDArray[np.bool_]:
        """(N,) a quarter of the texels of each slow block, of patterns that make one stratified set; all of small ones.

        The blocks round a block use the other three quarters, so that together they have all patterns.
        """
        of, members = self.blocks.of, self.blocks.members
        turn = (self.blocks.place[:, 1] + 2 * self.blocks.place[:, 2]) % 4
        slow = members[self.is_slow[of[members]]]
        chosen = texels.pattern[slow] // 4 == turn[of[slow]]
        number = np.bincount(of[slow], chosen, minlength=len(self.blocks))
        sites = np.zeros(len(texels), dtype=bool)
        sites[slow] = chosen | (number[of[slow]] < 2)
        return sites

    def interpolate(
        self,
        texels: Texels,
        light: F32,
        out: F32,
        measured: NDArray[np.bool_] | None = None,
        workers: int = 1,
    ) -> None:
        """Write the light of the blocks around into ``out`` (N, 3) at the texels of slow blocks; other rows stay.

        A linear function of the place on the surface is reproduced as it is, at the edge of a chart too.

        Args:
            texels: the texels.
            light: (B, 3) float32 of the blocks.
            out: (N, 3) float32.
            measured: (N,) which texels a block's light is the mean of; all if missing.
            workers: threads; the result does not depend on them.
        """
        blocks = self.blocks
        texel = blocks.members[self.is_slow[blocks.of[blocks.members]]]
        centre = blocks.mean(self.place, measured, workers)

        def fit(first: int, last: int) -> None:
            _fit(
                texel[first:last],
                blocks.of,
                self.place,
                texels.normal,
                self.around,
                centre,
                self.facing,
                self.trust,
                light,
                _RADIUS,
                _RIDGE,
                out,
            )

        in_chunks(fit, len(texel), _TEXELS, workers)
