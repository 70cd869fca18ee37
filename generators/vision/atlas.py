"""The displayed colours of lit faces as one picture: an atlas for renderers that know textures but no light maps.

A light map's layout is cut into charts (connected faces of one material that lie the same way up), each is enlarged
until its texels are as fine as asked for, and the charts are packed on shelves of one or more pages. Every texel is
shaded as the camera's rays are (kernels.shade_texels). Round each chart there is a margin in the colours of its rim, so
that bilinear look-up and the first mip levels take nothing from its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.scenes.scene import F32, I32
from generators.vision import kernels
from generators.vision.jit import inline, njit
from generators.vision.tables import SceneTables
from generators.vision.tone import WHITE, srgb_table, tone_table

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
U8 = NDArray[np.uint8]

#: Longest side of a page; every renderer of the last fifteen years takes textures of that size.
PAGE = 4096
#: Texels round a chart that are filled with the colours of its rim.
MARGIN = 3
#: Texels per texel of the light map where there is no texture: displayed light bends between the map's texels.
UNTEXTURED = 2.0
#: Texels of a texture per texel of the atlas where the texture is coarser than what was asked for.
COARSE = 1.5


@dataclass(frozen=True, eq=False)
class Atlas:
    """Colours of lit faces.

    Attributes:
        face: (K,) int64, the faces that have a light map.
        page: (K,) int32, the page of each.
        uv: (K, 3, 2) float32 in [0, 1] on its page; (0, 0) is the outer corner of texel [0, 0], v grows with the rows.
        pages: (H, W, 3) uint8 sRGB each.
    """

    face: I64
    page: I32
    uv: F32
    pages: tuple[U8, ...]


@dataclass(frozen=True, eq=False)
class _Charts:
    """What is packed. ``low`` and ``scale``: a point at light-map texel p lies (p − low)·scale texels into its chart.

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
    """Where charts lie: (C, 2) column and row of the outer corner, (C,) shelf; shelves: page, first row, height."""

    corner: I64
    shelf: I64
    shelves: list[tuple[int, int, int]]
    width: int
    heights: list[int]


def bake_atlas(tables: SceneTables, triangles: F32, *, texel: float, side: int = PAGE) -> Atlas:
    """Shade every lit face of a scene into an atlas.

    Args:
        tables: the scene, as `build_tables` lays it out.
        triangles: (F, 3, 3) its faces.
        texel: the finest texel wanted, metres.
        side: longest side of a page, texels.

    Returns:
        The atlas; the same scene gives the same bytes.
    """
    face = np.flatnonzero(tables.light[tables.surface] >= 0)
    if not len(face):
        return Atlas(face, np.zeros(0, dtype=np.int32), np.zeros((0, 3, 2), dtype=np.float32), ())
    corner = tables.light_uv[face].astype(np.float64)
    corner[:, 1:] += corner[:, :1]
    charts = _cut(tables, triangles, face, corner, texel, side - 2 * MARGIN)
    places = _pack(charts.size, side)
    own = charts.of
    at = (corner - charts.low[own, None]) * charts.scale[own, None, None] + MARGIN + places.corner[own, None]
    footprint = _footprint(tables, face, charts.scale[own])
    pages = [np.zeros((height, places.width, 3), dtype=np.uint8) for height in places.heights]
    tone, srgb = tone_table(), srgb_table()
    shelf = places.shelf[own]
    order = np.argsort(shelf, kind="stable")
    bounds = np.searchsorted(shelf[order], np.arange(len(places.shelves) + 1))
    charts_on = np.argsort(places.shelf, kind="stable")
    chart_bounds = np.searchsorted(places.shelf[charts_on], np.arange(len(places.shelves) + 1))
    for number, (page, top, height) in enumerate(places.shelves):
        on = order[bounds[number] : bounds[number + 1]]
        box = np.concatenate([places.corner[own[on]], places.corner[own[on]] + charts.size[own[on]]], axis=1)
        band = at[on] - np.array([0, top])
        nearest = np.full((height, places.width), np.inf, dtype=np.float32)
        owner = np.full((height, places.width), -1, dtype=np.int32)
        inside = np.zeros((height, places.width, 2), dtype=np.float32)
        _cover(band, (box - np.array([0, top, 0, top])).astype(np.int64), nearest, owner, inside)
        cell = owner.reshape(-1)
        light = np.zeros((len(cell), 3), dtype=np.float32)
        shown = np.where(cell >= 0, face[on][cell], -1).astype(np.int32)
        local = np.zeros((len(tables.surface), 2, 2), dtype=np.float32) if not number else local_footprint
        local_footprint = local
        local_footprint[face[on]] = footprint[on]
        kernels.shade_texels(shown, inside.reshape(-1, 2), local_footprint, tables, tone, WHITE, light)
        here = charts_on[chart_bounds[number] : chart_bounds[number + 1]]
        boxes = np.concatenate([places.corner[here], charts.size[here]], axis=1) - np.array([0, top, 0, 0])
        _fill(boxes, owner, light.reshape(height, places.width, 3))
        kernels.encode(light.reshape(-1), srgb, pages[page][top : top + height].reshape(-1))
    sizes = np.array([[image.shape[1], image.shape[0]] for image in pages], dtype=np.float64)
    page_of = np.array([shelf[0] for shelf in places.shelves], dtype=np.int32)[shelf]
    return Atlas(face, page_of, (at / sizes[page_of][:, None]).astype(np.float32), tuple(pages))
