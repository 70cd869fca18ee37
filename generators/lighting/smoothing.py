"""Removing the sampling pattern from baked light, and giving a value to every cell that look-up can touch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import njit
from generators.core.scene import F32, I32
from generators.lighting.surfaces import LitSurfaces, in_chunks
from generators.lighting.texels import Sheet, Texels

#: Weights over five texels that give each of the four columns (rows) of a tile the same share.
_WINDOW = np.array([0.5, 1.0, 1.0, 1.0, 0.5])
#: Differences of this many standard deviations count as noise. With 1.5, the blocks over which the visible share of a
#: lamp is taken show as a lattice on ceilings.
_REACH = 2.5
#: Added to the variance of the texels' places (texels²), so that one or two texels give no wild slope.
_RIDGE = 0.1
#: A texel is a speckle only if so many around it are known.
_FEW = 3
#: The first unknown texel beside known ones gets at least this part of their light.
_LEAST = 0.85
#: Cells beyond the covered ones that get a value, for look-up with rounding errors and for mip-maps.
_RINGS = 2
#: Texels per piece of work.
_CHUNK = 1 << 14


@njit
def _smooth(
    chosen: NDArray[np.int64],
    light: F32,
    variance: F32,
    position: F32,
    normal: F32,
    across: F32,
    cell: NDArray[np.int64],
    index: I32,
    part: I32,
    offset: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
    window: Any,
    reach: float,
    ridge: float,
    out: F32,
) -> None:
    half = len(window) // 2
    near = np.empty((len(window), len(window)), dtype=np.int64)
    weights = np.empty((len(window), len(window)))
    for i in chosen:
        p = part[i]
        local = cell[i] - offset[p]
        row, column = local // width[p], local % width[p]
        step = 0.0
        for c in range(3):
            step += across[i, 0, c] ** 2 + across[i, 1, c] ** 2
        limit = 1.5 * step * (half + 1) ** 2 + 1e-6
        # A few rays that all agree show no variance of their own: what the tile around shows is the better estimate.
        spread_sum = 0.0
        count = 0
        for dy in range(-half, half + 1):
            for dx in range(-half, half + 1):
                y, x = row + dy, column + dx
                near[dy + half, dx + half] = -1
                if y < 0 or y >= height[p] or x < 0 or x >= width[p]:
                    continue
                j = index[offset[p] + y * width[p] + x]
                if j < 0 or (variance[j] < 0.0 and j != i):
                    continue
                square = facing = 0.0
                for c in range(3):
                    square += (position[j, c] - position[i, c]) ** 2
                    facing += normal[j, c] * normal[i, c]
                if square > limit or facing < 0.7:
                    continue
                near[dy + half, dx + half] = j
                spread_sum += max(variance[j], 0.0)
                count += 1
        if spread_sum <= 0.0:
            for c in range(3):
                out[i, c] = light[i, c]
            continue
        noise = 2.0 * spread_sum / max(count, 1)
        total = mx = my = xx = yy = xy = 0.0
        for dy in range(-half, half + 1):
            for dx in range(-half, half + 1):
                j = near[dy + half, dx + half]
                weights[dy + half, dx + half] = 0.0
                if j < 0:
                    continue
                facing = difference = 0.0
                for c in range(3):
                    facing += normal[j, c] * normal[i, c]
                    difference += (light[j, c] - light[i, c]) / 3.0
                weight = window[dy + half] * window[dx + half] * (facing - 0.7) / 0.3
                # Differences well above the noise are edges of shadows: they stay.
                if dx != 0 or dy != 0:
                    weight *= np.exp(-difference * difference / (2.0 * reach * reach * noise + 1e-12))
                weights[dy + half, dx + half] = weight
                total += weight
                mx += weight * dx
                my += weight * dy
                xx += weight * dx * dx
                yy += weight * dy * dy
                xy += weight * dx * dy
        if total <= 0.0:
            for c in range(3):
                out[i, c] = light[i, c]
            continue
        mx, my = mx / total, my / total
        xx += total * (ridge - mx * mx)
        yy += total * (ridge - my * my)
        xy -= total * mx * my
        det = xx * yy - xy * xy
        slope_x, slope_y = (yy * mx - xy * my) / det, (xx * my - xy * mx) / det
        sums = np.zeros(3)
        lowest, highest = np.full(3, np.inf), np.zeros(3)
        for dy in range(-half, half + 1):
            for dx in range(-half, half + 1):
                weight = weights[dy + half, dx + half]
                if weight == 0.0:
                    continue
                j = near[dy + half, dx + half]
                weight *= 1.0 / total - slope_x * (dx - mx) - slope_y * (dy - my)
                for c in range(3):
                    sums[c] += weight * light[j, c]
                    lowest[c], highest[c] = min(lowest[c], light[j, c]), max(highest[c], light[j, c])
        for c in range(3):
            out[i, c] = min(max(sums[c], lowest[c]), highest[c])


@njit
def _despeckle(
    light: F32,
    known: NDArray[np.bool_],
    chart: I32,
    cell: NDArray[np.int64],
    index: I32,
    part: I32,
    offset: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
    least: int,
    first: int,
    last: int,
    out: F32,
) -> None:
    highest = np.empty(3, dtype=np.float32)
    for i in range(first, last):
        if not known[i]:
            continue
        p = part[i]
        local = cell[i] - offset[p]
        row, column = local // width[p], local % width[p]
        highest[:] = 0.0
        count = 0
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                y, x = row + dy, column + dx
                if (dx == 0 and dy == 0) or y < 0 or y >= height[p] or x < 0 or x >= width[p]:
                    continue
                j = index[offset[p] + y * width[p] + x]
                if j < 0 or not known[j] or chart[j] != chart[i]:
                    continue
                count += 1
                for c in range(3):
                    highest[c] = max(highest[c], light[j, c])
        if count >= least:
            for c in range(3):
                out[i, c] = min(out[i, c], highest[c])


def despeckle(
    surfaces: LitSurfaces, sheet: Sheet, texels: Texels, light: F32, known: NDArray[np.bool_], workers: int = 1
) -> F32:
    """A copy of (N, 3) ``light`` in which no ``known`` texel is brighter than all of those around it in its chart.

    A texel of which one ray by chance meets something small and bright is not averaged away by `smooth`, because it
    differs from its neighbours by more than their noise. Texels with fewer than `_FEW` known neighbours stay.
    """
    out = light.copy()
    part, chart = surfaces.part[texels.face], sheet.chart[texels.face]
    maps = (sheet.offset, sheet.width, sheet.height)

    def work(first: int, last: int) -> None:
        _despeckle(light, known, chart, texels.cell, texels.index, part, *maps, _FEW, first, last, out)

    in_chunks(work, len(light), _CHUNK, workers)
    return out


def smooth(
    surfaces: LitSurfaces,
    sheet: Sheet,
    texels: Texels,
    light: F32,
    variance: F32,
    chosen: NDArray[np.int64] | None = None,
    workers: int = 1,
) -> F32:
    """Average (N, 3) ``light`` over tiles of texels of one surface, as far as its differences may be noise.

    The average is a weighted linear regression over the place: at the edge of a surface and beside what stands on it,
    where all texels lie on one side, a mean would take light from farther away (J. Fan & I. Gijbels, "Local polynomial
    modelling and its applications", 1996, section 3.2.5). With texels all round it is the mean.

    Args:
        surfaces: the faces.
        sheet: their light maps.
        texels: the texels.
        light: (N, 3).
        variance: (N,) of the luminance of ``light``; negative: the texel has no light of its own.
        chosen: indices of the texels to smooth, the others stay; all if missing.
        workers: threads; the result does not depend on them.
    """
    out = light.copy()
    part = surfaces.part[texels.face]
    own = np.arange(len(light)) if chosen is None else chosen

    def work(first: int, last: int) -> None:
        _smooth(
            own[first:last],
            light,
            variance,
            texels.position,
            texels.normal,
            texels.across,
            texels.cell,
            texels.index,
            part,
            sheet.offset,
            sheet.width,
            sheet.height,
            _WINDOW,
            _REACH,
            _RIDGE,
            out,
        )

    in_chunks(work, len(own), _CHUNK, workers)
    return out


@njit
def _fill(
    light: F32,
    known: NDArray[np.bool_],
    chart: I32,
    cell: NDArray[np.int64],
    index: I32,
    part: I32,
    offset: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
    rings: int,
    least: float,
    first: int,
    last: int,
) -> None:
    """Flood known light into the unknown ones of the texels ``first`` to ``last``, whole charts, ring by ring."""
    count = 0
    for i in range(first, last):
        if not known[i]:
            count += 1
    waiting = np.empty(count, dtype=np.int64)
    number = 0
    for i in range(first, last):
        if not known[i]:
            waiting[number] = i
            number += 1
    fresh = np.zeros((count, 3), dtype=np.float32)
    done = np.empty(count, dtype=np.int64)
    ring = -1
    while number > 0 and rings != 0:
        rings -= 1
        ring += 1
        filled = left = 0
        for n in range(number):
            i = waiting[n]
            p = part[i]
            local = cell[i] - offset[p]
            row, column = local // width[p], local % width[p]
            total = 0.0
            sums = np.zeros(3)
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    y, x = row + dy, column + dx
                    if y < 0 or y >= height[p] or x < 0 or x >= width[p]:
                        continue
                    j = index[offset[p] + y * width[p] + x]
                    if j < 0 or not known[j] or chart[j] != chart[i]:
                        continue
                    weight = 1.0 / (dx * dx + dy * dy)
                    total += weight
                    # Light goes on falling as it fell between the two texels before. It does not go on rising: what
                    # is beside a lamp is bright enough.
                    far = j
                    y, x = y + dy, x + dx
                    if ring == 0 and 0 <= y < height[p] and 0 <= x < width[p]:
                        far = index[offset[p] + y * width[p] + x]
                        if far < 0 or not known[far] or chart[far] != chart[i]:
                            far = j
                    for c in range(3):
                        ahead = 2.0 * light[j, c] - light[far, c]
                        sums[c] += weight * min(max(ahead, least * light[j, c]), light[j, c])
            if total > 0.0:
                for c in range(3):
                    fresh[filled, c] = sums[c] / total
                done[filled] = i
                filled += 1
            else:
                waiting[left] = i
                left += 1
        for n in range(filled):
            i = done[n]
            known[i] = True
            for c in range(3):
                light[i, c] = fresh[n, c]
        number = left
        if filled == 0:
            break


def fill(
    surfaces: LitSurfaces,
    sheet: Sheet,
    texels: Texels,
    light: F32,
    known: NDArray[np.bool_],
    rings: int = -1,
    workers: int = 1,
) -> F32:
    """A copy of (N, 3) ``light`` in which unknown texels take the light of the nearest known ones of their chart.

    In the first ring of unknown texels light that falls goes on falling linearly, up to a contact.

    ``rings`` limits how many texels deep; negative: no limit. ``workers`` threads do it; the result does not depend on
    them.
    """
    out, is_known = light.copy(), known.copy()
    part = surfaces.part[texels.face]
    chart = sheet.chart[texels.face]
    begin = np.searchsorted(texels.cell, sheet.offset)
    maps = (sheet.offset, sheet.width, sheet.height)

    def flood(number: int, _: int) -> None:
        own = (begin[number], begin[number + 1])
        _fill(out, is_known, chart, texels.cell, texels.index, part, *maps, rings, _LEAST, *own)

    in_chunks(flood, len(sheet.width), 1, workers)
    return out


@njit
def _ring(image: Any, known: Any, fresh: Any) -> None:
    """Give empty cells the mean of the known ones among the four beside them; ``fresh`` is working memory."""
    rows, columns = known.shape
    for y in range(rows):
        for x in range(columns):
            fresh[y, x] = False
            if known[y, x]:
                continue
            red = green = blue = number = np.float32(0.0)
            for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                row, column = y + dy, x + dx
                if 0 <= row < rows and 0 <= column < columns and known[row, column]:
                    red += image[row, column, 0]
                    green += image[row, column, 1]
                    blue += image[row, column, 2]
                    number += np.float32(1.0)
            if number > np.float32(0.0):
                fresh[y, x] = True
                image[y, x, 0], image[y, x, 1], image[y, x, 2] = red / number, green / number, blue / number
    for y in range(rows):
        for x in range(columns):
            known[y, x] |= fresh[y, x]


def spread(sheet: Sheet, texels: Texels, light: F32, workers: int = 1) -> F32:
    """(cells, 3) light maps: the texels' light, and two rings of empty cells around them filled from them."""
    cells = np.zeros((int(sheet.offset[-1]), 3), dtype=np.float32)
    cells[texels.cell] = light
    covered = texels.index >= 0

    def work(part: int, _: int) -> None:
        image, known = sheet.image(part, cells), sheet.image(part, covered)
        for _ in range(_RINGS):
            _ring(image, known, np.empty_like(known))

    in_chunks(work, len(sheet.width), 1, workers)
    return cells
