"""From layouts to texels: the point, normal and albedo that each texel of the light maps stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.low_discrepancy import pattern_of
from generators.core.scene import F32, I32
from generators.lighting.emitters import face_areas
from generators.lighting.surfaces import LitSurfaces, albedo_at, in_chunks
from generators.lighting.unwrap import LightMapLayout

#: Rays start this far above the surface, so that they do not meet it again (metres).
PUSH = 0.0015
#: Points on a chart's border are drawn this far into their face: in a corner of a room they must not lie in the wall.
PULL = 0.004
#: Texels per piece of work.
_CHUNK = 1 << 14
#: Squared distance from which on a texel's centre lies beside its face (texels²); below it is rounding.
_ASIDE = 1e-4
#: A face that curves with a smaller radius than this (texels) is a rounded edge, too narrow for texels of its own.
_TIGHT = 0.75


@dataclass(frozen=True, eq=False)
class Sheet:
    """The light maps of several parts as one array: part p owns ``height[p]`` × ``width[p]`` cells from ``offset[p]``.

    Attributes:
        uv: (F, 3, 2) float32, faces of all parts in texels of their own map.
        chart: (F,) int32, different for every chart of every part.
        offset: (P + 1,) int64.
        width: (P,) int64.
        height: (P,) int64.
    """

    uv: F32
    chart: I32
    offset: NDArray[np.int64]
    width: NDArray[np.int64]
    height: NDArray[np.int64]

    @staticmethod
    def of(layouts: Sequence[LightMapLayout]) -> Sheet:
        """Put the layouts one after the other."""
        charts = np.cumsum([0] + [int(layout.chart.max()) + 1 for layout in layouts])
        sizes = [layout.width * layout.height for layout in layouts]
        return Sheet(
            uv=np.concatenate([layout.uv for layout in layouts]),
            chart=np.concatenate([own.chart + first for own, first in zip(layouts, charts[:-1], strict=True)]).astype(
                np.int32
            ),
            offset=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            width=np.array([layout.width for layout in layouts], dtype=np.int64),
            height=np.array([layout.height for layout in layouts], dtype=np.int64),
        )

    def image(self, part: int, values: NDArray[Any]) -> NDArray[Any]:
        """(H, W, …) view of part ``part``'s cells in ``values`` (cells, …)."""
        cells = values[self.offset[part] : self.offset[part + 1]]
        return cells.reshape(int(self.height[part]), int(self.width[part]), *values.shape[1:])


@dataclass(frozen=True, eq=False)
class Texels:
    """The covered texels of a sheet, in the order of their cells.

    Attributes:
        cell: (N,) int64 cell of the sheet.
        index: (cells,) int32, the texel of a cell, -1 where the cell belongs to no chart.
        face: (N,) int32.
        pattern: (N,) int32, see `sampling.pattern_of`.
        position: (N, 3) float32, where rays start.
        normal: (N, 3) float32 shading normal.
        across: (N, 2, 3) float32, the surface vectors of one texel along columns and rows.
        albedo: (N, 3) float32.
        area: (N,) float32 of the surface in its square, m². A texel whose centre lies beside the face leaves this to
            those of the chart whose centre does not, if there are any, and has 0.
    """

    cell: NDArray[np.int64]
    index: I32
    face: I32
    pattern: I32
    position: F32
    normal: F32
    across: F32
    albedo: F32
    area: F32

    def __len__(self) -> int:
        return len(self.cell)


def rasterise(surfaces: LitSurfaces, sheet: Sheet, wanted: NDArray[np.bool_] | None = None, workers: int = 1) -> Texels:
    """Find the texels that bilinear look-up on any face can touch.

    A texel whose centre lies beside its face stands for the nearest point of the face, so that the map is defined
    a full texel beyond every chart's border. A texel on a rounded edge stands for the wide face beside it: the edge's
    normals lean towards what lies round the corner, and its light would spread over the rim of the wide face.

    Args:
        surfaces: the faces.
        sheet: their light maps.
        wanted: (F,) which faces; all if missing.
        workers: threads; the result does not depend on them.
    """
    nearest, owner, weights, covered = _owners(surfaces, sheet, wanted, workers)
    cell = np.flatnonzero(owner >= 0)
    index = np.full(len(owner), -1, dtype=np.int32)
    index[cell] = np.arange(len(cell), dtype=np.int32)
    face = owner[cell]
    count = len(cell)
    position, normal = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    across = np.zeros((count, 2, 3), dtype=np.float32)
    albedo = np.empty((count, 3), dtype=np.float32)
    pattern = np.empty(count, dtype=np.int32)

    def properties(first: int, last: int) -> None:
        own = slice(first, last)
        part = surfaces.part[face[own]]
        local, width = cell[own] - sheet.offset[part], sheet.width[part]
        inside = weights[cell[own]]
        pattern[own] = pattern_of((local % width).astype(np.int32), (local // width).astype(np.int32))
        albedo[own] = albedo_at(surfaces, face[own], inside[:, 0], inside[:, 1])
        _properties(
            face[own],
            inside,
            surfaces.triangles,
            surfaces.normals,
            surfaces.face_normal,
            sheet.uv,
            position[own],
            normal[own],
            across[own],
        )

    in_chunks(properties, count, _CHUNK, workers)
    return Texels(
        cell=cell,
        index=index,
        face=face,
        pattern=pattern,
        position=position,
        normal=normal,
        across=across,
        albedo=albedo,
        area=_areas(covered[cell], nearest[cell] <= _ASIDE, sheet.chart[face]),
    )


def _areas(covered: F32, is_inside: NDArray[np.bool_], chart: I32) -> F32:
    """(N,) `Texels.area` of texels with ``covered`` (N,) square metres of a ``chart`` (N,) each."""
    if not len(covered):
        return covered
    whole, kept = np.bincount(chart, covered), np.bincount(chart, covered * is_inside)
    share = np.where(kept > 0, whole / np.maximum(kept, 1e-30), 1.0)
    return np.where(is_inside | (kept[chart] <= 0), covered * share[chart], 0.0).astype(np.float32)


def _owners(
    surfaces: LitSurfaces, sheet: Sheet, wanted: NDArray[np.bool_] | None, workers: int
) -> tuple[F32, I32, F32, F32]:
    """Of each cell: squared distance (texels²) to the nearest face, the face it stands for or -1, where (2), its m²."""
    cells = int(sheet.offset[-1])
    nearest = np.full(cells, np.inf, dtype=np.float32)
    beside = np.full(cells, np.inf, dtype=np.float32)
    owner = np.full(cells, -1, dtype=np.int32)
    weights = np.zeros((cells, 2), dtype=np.float32)
    covered, nothing = np.zeros(cells, dtype=np.float32), np.zeros(len(sheet.uv), dtype=np.float32)
    metres = _texel_areas(surfaces, sheet)
    tight = _is_tight(surfaces, sheet)
    faces = np.flatnonzero(np.ones(len(sheet.uv), dtype=bool) if wanted is None else wanted)
    # Faces are ordered by part, and each part has cells of its own.
    begin = np.searchsorted(surfaces.part[faces], np.arange(len(sheet.width) + 1))

    def cover(first: int, last: int) -> None:
        own = faces[begin[first] : begin[last]]
        maps = sheet.uv, sheet.chart, surfaces.part, sheet.offset, sheet.width, sheet.height
        _cover(own, *maps, False, metres, nearest, owner, weights, covered)
        if tight[own].any():
            _cover(own[~tight[own]], *maps, True, nothing, beside, owner, weights, covered)

    in_chunks(cover, len(sheet.width), 1, workers)
    return nearest, owner, weights, covered


def _texel_areas(surfaces: LitSurfaces, sheet: Sheet) -> F32:
    """(F,) square metres of a face to a square texel of its map."""
    on_map = sheet.uv.astype(np.float64)
    side, other = on_map[:, 1] - on_map[:, 0], on_map[:, 2] - on_map[:, 0]
    texels = np.abs(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]) / 2
    return np.where(texels > 1e-9, face_areas(surfaces.triangles) / np.maximum(texels, 1e-9), 0.0).astype(np.float32)


def _is_tight(surfaces: LitSurfaces, sheet: Sheet) -> NDArray[np.bool_]:
    """(F,) whether a face is part of a rounded edge: its normals turn by a lot over little width (see `_TIGHT`)."""
    corners, normals = sheet.uv.astype(np.float64), surfaces.normals.astype(np.float64)
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.sqrt((sides**2).sum(axis=2).max(axis=1))
    doubled = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    cosine = np.einsum("fkc,fkc->fk", normals, np.roll(normals, -1, axis=1)).min(axis=1)
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.asarray(doubled < _TIGHT * turn * longest)


@inline
def _closest(px: float, py: float, a: Any, b: Any, c: Any) -> Any:
    """Barycentric weights (of b and c) of the triangle's point nearest to (px, py) (Ericson 2005, section 5.1.5)."""
    abx, aby, acx, acy = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    apx, apy = px - a[0], py - a[1]
    d1, d2 = abx * apx + aby * apy, acx * apx + acy * apy
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    bpx, bpy = px - b[0], py - b[1]
    d3, d4 = abx * bpx + aby * bpy, acx * bpx + acy * bpy
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return (d1 / (d1 - d3) if d1 > d3 else 0.0), 0.0
    cpx, cpy = px - c[0], py - c[1]
    d5, d6 = abx * cpx + aby * cpy, acx * cpx + acy * cpy
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, (d2 / (d2 - d6) if d2 > d6 else 0.0)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        total = (d4 - d3) + (d5 - d6)
        w = (d4 - d3) / total if total > 0.0 else 0.0
        return 1.0 - w, w
    total = va + vb + vc
    return vb / total, vc / total


@inline
def _held(t: float) -> float:
    """Integral from 0 to t of what lies between 0 and 1 of a number."""
    return 0.0 if t <= 0.0 else (t * t / 2.0 if t < 1.0 else t - 0.5)


@njit
def _cut(corners: Any, x: float, y: float) -> float:
    """Area of a triangle (3, 2) within the unit square from (x, y): the sum of what lies below its edges there."""
    total = 0.0
    for k in range(3):
        p, q = corners[k], corners[(k + 1) % 3]
        left, right = max(min(p[0], q[0]), x), min(max(p[0], q[0]), x + 1.0)
        if right <= left:
            continue
        slope = (q[1] - p[1]) / (q[0] - p[0])
        one, other = p[1] + slope * (left - p[0]) - y, p[1] + slope * (right - p[0]) - y
        if abs(other - one) < 1e-6:
            height = min(max((one + other) / 2.0, 0.0), 1.0)
        else:
            height = (_held(other) - _held(one)) / (other - one)
        total += height * (right - left) if q[0] > p[0] else height * (left - right)
    return abs(total)


@njit
def _cover(
    faces: NDArray[np.intp],
    uv: F32,
    chart: I32,
    part: I32,
    offset: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
    again: bool,
    metres: F32,
    nearest: F32,
    owner: I32,
    weights: F32,
    covered: F32,
) -> None:
    """Give cells to the nearest of some faces; ``again``: only those that a face of the same chart has.

    What lies of a face in a cell, in texels, times its ``metres`` (F,) is added to ``covered``.
    """
    for f in faces:
        p = part[f]
        a, b, c = uv[f, 0], uv[f, 1], uv[f, 2]
        left = max(int(np.floor(min(a[0], b[0], c[0]) - 1.5)), 0)
        right = min(int(np.ceil(max(a[0], b[0], c[0]) + 0.5)), width[p] - 1)
        low = max(int(np.floor(min(a[1], b[1], c[1]) - 1.5)), 0)
        high = min(int(np.ceil(max(a[1], b[1], c[1]) + 0.5)), height[p] - 1)
        for y in range(low, high + 1):
            for x in range(left, right + 1):
                v, w = _closest(x + 0.5, y + 0.5, a, b, c)
                dx = a[0] + v * (b[0] - a[0]) + w * (c[0] - a[0]) - x - 0.5
                dy = a[1] + v * (b[1] - a[1]) + w * (c[1] - a[1]) - y - 0.5
                if abs(dx) > 1.01 or abs(dy) > 1.01:
                    continue
                distance = dx * dx + dy * dy
                cell = offset[p] + y * width[p] + x
                if distance < 0.5 and metres[f] > 0.0:
                    covered[cell] += _cut(uv[f], x, y) * metres[f]
                if again and (owner[cell] < 0 or chart[owner[cell]] != chart[f]):
                    continue
                if distance < nearest[cell]:
                    nearest[cell] = distance
                    owner[cell] = f
                    weights[cell, 0], weights[cell, 1] = v, w


@njit
def _properties(
    face: I32,
    weights: F32,
    triangles: F32,
    normals: F32,
    face_normal: F32,
    map_uv: F32,
    position: F32,
    normal: F32,
    across: F32,
) -> None:
    for i in range(len(face)):
        f = face[i]
        v, w = weights[i, 0], weights[i, 1]
        u = 1.0 - v - w
        middle = np.zeros(3)
        length = 0.0
        for k in range(3):
            position[i, k] = u * triangles[f, 0, k] + v * triangles[f, 1, k] + w * triangles[f, 2, k]
            middle[k] = (triangles[f, 0, k] + triangles[f, 1, k] + triangles[f, 2, k]) / 3.0
            normal[i, k] = u * normals[f, 0, k] + v * normals[f, 1, k] + w * normals[f, 2, k]
            length += normal[i, k] ** 2
        length = np.sqrt(length)
        facing = 0.0
        for k in range(3):
            normal[i, k] = normal[i, k] / length if length > 1e-9 else face_normal[f, k]
            facing += normal[i, k] * face_normal[f, k]
        if facing < 0.05:
            for k in range(3):
                normal[i, k] = face_normal[f, k]
        if min(u, v, w) < 1e-3:
            distance = 0.0
            for k in range(3):
                distance += (middle[k] - position[i, k]) ** 2
            t = min(0.25, PULL / max(np.sqrt(distance), 1e-9))
            for k in range(3):
                position[i, k] += t * (middle[k] - position[i, k])
        for k in range(3):
            position[i, k] += PUSH * face_normal[f, k]
        # Surface vectors of a step of one texel: the inverse of the face's map from edges to texels.
        a, b = map_uv[f, 1] - map_uv[f, 0], map_uv[f, 2] - map_uv[f, 0]
        det = a[0] * b[1] - a[1] * b[0]
        if abs(det) > 1e-9:
            for k in range(3):
                e1, e2 = triangles[f, 1, k] - triangles[f, 0, k], triangles[f, 2, k] - triangles[f, 0, k]
                across[i, 0, k] = (e1 * b[1] - e2 * a[1]) / det
                across[i, 1, k] = (e2 * a[0] - e1 * b[0]) / det
