"""The displayed colours of lit faces as one picture: an atlas for renderers that know textures but no light maps.

A light map's layout is cut into charts (connected faces of one material that lie the same way up), each is enlarged
until its texels are as fine as asked for, and the charts are packed on shelves of one or more pages. Every texel is
shaded as the camera's rays are (kernels.shade_texels). Round each chart there is a margin in the colours of its rim, so
that bilinear look-up and the first mip levels take nothing from its neighbours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.core.jit import inline, njit
from generators.core.scene import F32, I32
from generators.core.tone import WHITE, srgb_table, tone_table
from generators.vision import kernels
from generators.vision.tables import SceneTables

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
U8 = NDArray[np.uint8]

#: Longest side of a page; every renderer of the last fifteen years takes textures of that size.
PAGE = 4096
#: Texels round a chart that are filled with the colours of its rim.
MARGIN = 3
#: How far a texel's centre may lie from the face whose nearest point it shows, texels: a margin's diagonal.
REACH = 1.5 * MARGIN
#: Texels per texel of the light map, whose light bends there, and per texel of a texture, unless that is too fine.
LIGHT, TEXTURE = 2.0, 1.5


@dataclass(frozen=True, eq=False)
class Atlas:
    """Colours of lit faces.

    Attributes:
        page: (K,) int32, the page of each.
        uv: (K, 3, 2) float32 in [0, 1] on its page; (0, 0) is the outer corner of texel [0, 0], v grows with the rows.
        pages: (H, W, 3) uint8 sRGB each.
    """

    page: I32
    uv: F32
    pages: tuple[U8, ...]


@dataclass(frozen=True, eq=False)
class _Charts:
    """The packed charts. A point at light-map texel p lies (p − low)·scale texels into its chart, margins apart.

    Attributes:
        of: (K,) the chart of each face.
        low: (C, 2) lowest column and row in the light map.
        scale: (C,) atlas texels per light-map texel.
        size: (C, 2) width and height with margins, texels.
    """

    of: I64
    low: F64
    scale: F64
    size: I64


@dataclass(frozen=True, eq=False)
class _Places:
    """Where charts lie.

    Attributes:
        corner: (C, 2) column and row of the chart's outer corner on its page.
        shelf: (C,) the shelf of the chart.
        shelves: page, first row and height of each.
        sizes: (P, 2) width and height of each page.
    """

    corner: I64
    shelf: I64
    shelves: list[tuple[int, int, int]]
    sizes: I64


def bake_atlas(tables: SceneTables, triangles: F32, face: I64, *, texel: float, side: int = PAGE) -> Atlas:
    """Shade faces of a scene into an atlas.

    Args:
        tables: the scene, as `build_tables` lays it out.
        triangles: (F, 3, 3) its faces.
        face: (K,) which of them, all with a light map.
        texel: the finest texel wanted, metres.
        side: longest side of a page, texels.

    Returns:
        The atlas; the same scene gives the same bytes.
    """
    corner = tables.light_uv[face].astype(np.float64)
    corner[:, 1:] += corner[:, :1]
    charts = _cut(tables, face, _areas(triangles[face]), corner, texel, side - 2 * MARGIN)
    places = _pack(charts.size, side)
    at = (corner - charts.low[charts.of, None]) * charts.scale[charts.of, None, None] + MARGIN
    at += places.corner[charts.of, None]
    footprint = np.zeros((len(tables.surface), 2, 2), dtype=np.float32)
    footprint[face] = _footprint(tables, face, charts.scale[charts.of])
    pages = tuple(np.zeros((height, width, 3), dtype=np.uint8) for width, height in places.sizes.tolist())
    tone, srgb = tone_table(), srgb_table()
    # Shelf by shelf, so that the memory per texel stays small.
    for number, (page, top, height) in enumerate(places.shelves):
        here = np.flatnonzero(places.shelf == number)
        own = np.flatnonzero(places.shelf[charts.of] == number)
        up = np.array([0, top])
        boxes = np.concatenate([places.corner[here] - up, charts.size[here]], axis=1)
        index = np.zeros(len(charts.size), dtype=np.int64)
        index[here] = np.arange(len(here))
        shape = (height, int(places.sizes[page, 0]))
        owner, inside = np.full(shape, -1, dtype=np.int32), np.zeros((*shape, 2), dtype=np.float32)
        light = np.zeros((*shape, 3), dtype=np.float32)
        _cover(at[own] - up, face[own], boxes[index[charts.of[own]]], owner, inside)
        kernels.shade_texels(
            owner.reshape(-1), inside.reshape(-1, 2), footprint, tables, tone, WHITE, light.reshape(-1, 3)
        )
        _fill(boxes, owner, light)
        kernels.encode(light.reshape(-1), srgb, pages[page][top : top + height].reshape(-1))
    page_of = np.array([page for page, _, _ in places.shelves], dtype=np.int32)[places.shelf[charts.of]]
    return Atlas(page_of, (at / places.sizes[page_of][:, None]).astype(np.float32), pages)


def _areas(triangles: F32) -> F64:
    """(K,) square metres."""
    edges = triangles[:, 1:].astype(np.float64) - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def _cut(tables: SceneTables, face: I64, area: F64, corner: F64, texel: float, longest: int) -> _Charts:
    """Charts of the faces of some ``area`` (K,) whose corners lie at ``corner`` (K, 3, 2) in their light maps."""
    surface = tables.surface[face]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    signed = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    # Corners join faces where they lie at the same place of the layout, on one material, the same way up.
    place = np.round(corner * 256.0).astype(np.int64)
    key = np.concatenate(
        [
            place,
            np.repeat(np.stack([surface, signed < 0], axis=1)[:, None], 3, axis=1),
        ],
        axis=2,
    ).reshape(-1, 4)
    _, vertex = np.unique(key, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    edges = np.concatenate([vertex[:, :2], vertex[:, 1:]])
    count = int(vertex.max()) + 1
    graph = coo_matrix((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    pieces, label = connected_components(graph, directed=False)
    of = label[vertex[:, 0]].astype(np.int64)
    low, high = np.full((pieces, 2), np.inf), np.full((pieces, 2), -np.inf)
    np.minimum.at(low, of, corner.min(axis=1))
    np.maximum.at(high, of, corner.max(axis=1))
    world = np.bincount(of, area, pieces)
    layout = np.bincount(of, np.abs(signed) / 2, pieces)
    light_texel = np.sqrt(world / np.maximum(layout, 1e-9))
    detail = np.bincount(of, area * _texture_texel(tables, face), pieces) / np.maximum(world, 1e-12)
    wanted = np.maximum(np.minimum(light_texel / LIGHT, detail / TEXTURE), texel)
    extent = high - low
    scale = np.minimum(light_texel / wanted, (longest - 1) / np.maximum(extent.max(axis=1), 1e-9))
    size = np.ceil(extent * scale[:, None]).astype(np.int64) + 2 * MARGIN
    return _Charts(of, low, scale, np.maximum(size, 2 * MARGIN + 1))


def _texture_texel(tables: SceneTables, face: I64) -> F64:
    """(K,) side of a texel of the face's texture on its surface, along the finer axis, metres; 1 m without one."""
    texture = tables.texture[tables.surface[face]]
    pool = tables.textures
    size = pool.size[pool.first[np.maximum(texture, 0)]].astype(np.float64)
    rate = np.linalg.norm(tables.gradient[face].astype(np.float64), axis=2) * size[:, ::-1]
    return np.where(texture >= 0, 1.0 / np.maximum(rate.max(axis=1), 1.0), 1.0)


def _footprint(tables: SceneTables, face: I64, scale: F64) -> F32:
    """(K, 2, 2) change of the texture coordinates per atlas texel along its columns and rows (0 for flat layouts)."""
    light = tables.light_uv[face, 1:].astype(np.float64) * scale[:, None, None]
    texture = tables.uv[face, 1:].astype(np.float64)
    determinant = light[:, 0, 0] * light[:, 1, 1] - light[:, 0, 1] * light[:, 1, 0]
    solid = np.abs(determinant) > 1e-9
    inverse = np.where(solid, 1.0 / np.where(solid, determinant, 1.0), 0.0)[:, None]
    # With the layout's edges as rows of L and the texture's as rows of T, the change per texel is L⁻¹ T.
    along = (light[:, 1, 1, None] * texture[:, 0] - light[:, 0, 1, None] * texture[:, 1]) * inverse
    down = (light[:, 0, 0, None] * texture[:, 1] - light[:, 1, 0, None] * texture[:, 0]) * inverse
    return np.stack([along, down], axis=1).astype(np.float32)


def _pack(size: I64, side: int) -> _Places:
    """Stand charts (C, 2) on shelves, the tallest first."""
    area = int((size[:, 0] * size[:, 1]).sum())
    width = 64
    while width < side and (width * width < 1.1 * area or width < size[:, 0].max()):
        width *= 2
    width = min(width, side)
    corner, shelf = np.zeros_like(size), np.zeros(len(size), dtype=np.int64)
    shelves: list[tuple[int, int, int]] = []
    heights: list[int] = []
    x = width
    for chart in np.lexsort((np.arange(len(size)), -size[:, 0], -size[:, 1])).tolist():
        wide, high = int(size[chart, 0]), int(size[chart, 1])
        if x + wide > width:
            if not heights or heights[-1] + high > side:
                heights.append(0)
            shelves.append((len(heights) - 1, heights[-1], high))
            heights[-1] += high
            x = 0
        corner[chart] = x, shelves[-1][1]
        shelf[chart] = len(shelves) - 1
        x += wide
    return _Places(corner, shelf, shelves, np.array([(width, height) for height in heights], dtype=np.int64))


@inline
def _to_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float]:
    """Squared distance of p to the segment ab, and how far along it the nearest point lies (0 to 1)."""
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    t = 0.0
    if length > 0.0:
        t = min(max(((px - ax) * dx + (py - ay) * dy) / length, 0.0), 1.0)
    ex, ey = ax + t * dx - px, ay + t * dy - py
    return ex * ex + ey * ey, t


@njit
def _cover(corner: F64, face: I64, box: I64, owner: I32, inside: F32) -> None:
    """Find what each texel shows: the face it lies in, or the nearest point of one within `REACH`.

    Args:
        corner: (K, 3, 2) corners, texels of the band.
        face: (K,) their numbers.
        box: (K, 4) column, row, width and height of the face's chart: nothing outside of it is touched.
        owner: (H, W), −1; the face is written.
        inside: (H, W, 2), written: barycentric weights of the point's corners 1 and 2.
    """
    nearest = np.full(owner.shape, np.float32(np.inf), dtype=np.float32)
    for k in range(corner.shape[0]):
        ax, ay = corner[k, 0, 0], corner[k, 0, 1]
        bx, by = corner[k, 1, 0], corner[k, 1, 1]
        cx, cy = corner[k, 2, 0], corner[k, 2, 1]
        determinant = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        solid = abs(determinant) > 1e-9
        inverse = 1.0 / determinant if solid else 0.0
        left, right = box[k, 0], box[k, 0] + box[k, 2]
        upper, lower = box[k, 1], box[k, 1] + box[k, 3]
        x0 = max(left, math.floor(min(ax, bx, cx) - REACH))
        x1 = min(right, math.ceil(max(ax, bx, cx) + REACH))
        y0 = max(upper, math.floor(min(ay, by, cy) - REACH))
        y1 = min(lower, math.ceil(max(ay, by, cy) + REACH))
        for row in range(y0, y1):
            py = row + 0.5
            for column in range(x0, x1):
                if nearest[row, column] <= 0.0:
                    continue
                px = column + 0.5
                if solid:
                    v = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) * inverse
                    w = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) * inverse
                    if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
                        nearest[row, column] = 0.0
                        owner[row, column] = face[k]
                        inside[row, column, 0], inside[row, column, 1] = v, w
                        continue
                best, t = _to_segment(px, py, ax, ay, bx, by)
                v, w = t, 0.0
                other, t = _to_segment(px, py, bx, by, cx, cy)
                if other < best:
                    best, v, w = other, 1.0 - t, t
                other, t = _to_segment(px, py, cx, cy, ax, ay)
                if other < best:
                    best, v, w = other, 0.0, 1.0 - t
                if best < REACH * REACH and best < nearest[row, column]:
                    nearest[row, column] = best
                    owner[row, column] = face[k]
                    inside[row, column, 0], inside[row, column, 1] = v, w


@njit
def _fill(boxes: I64, owner: I32, light: F32) -> None:
    """Give the texels of each chart's box (column, row, width, height) that show nothing the chart's mean light."""
    for b in range(boxes.shape[0]):
        x, y, wide, high = boxes[b, 0], boxes[b, 1], boxes[b, 2], boxes[b, 3]
        red = green = blue = 0.0
        count = 0
        for row in range(y, y + high):
            for column in range(x, x + wide):
                if owner[row, column] >= 0:
                    red += light[row, column, 0]
                    green += light[row, column, 1]
                    blue += light[row, column, 2]
                    count += 1
        if count == 0 or count == wide * high:
            continue
        for row in range(y, y + high):
            for column in range(x, x + wide):
                if owner[row, column] < 0:
                    light[row, column, 0] = red / count
                    light[row, column, 1] = green / count
                    light[row, column, 2] = blue / count
