"""Shadows on a scan: maps of the factors by which objects change what is displayed of the surfaces near them.

The pictures of a scan hold its light and are shown as they are. Faces near objects become parts of their own with a
light map, whose texels are that factor; everything else stays as it is. Charts are the connected faces that look the
same way (of six), seen along that axis: the faces of a scan are many, small and rough, and their light is smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from generators.core.arrays import distinct_rows
from generators.core.low_discrepancy import TILE, cosine_directions
from generators.core.scene import F32, DenseMesh, LightMap, Mesh, Part, Scene
from generators.core.tone import tone_curve
from generators.lighting.direct import direct_light
from generators.lighting.gather import CHUNK, hemisphere_rays
from generators.lighting.lit_scene import OUTSIDE
from generators.lighting.scan_sun import BUMPS
from generators.lighting.sun import sun_light
from generators.lighting.surfaces import in_chunks
from generators.lighting.surroundings import RAYS, SAMPLES, WORKERS, Surroundings, nearest_box
from generators.lighting.unwrap import LightMapLayout

#: How far objects shade a scan: this many times their longest side, within limits (m).
_FAR, _LEAST, _MOST = 2.0, 0.35, 1.2
#: Side of the texels (m): a part of the least reach within limits, made larger if there would be more than so many.
_PART, _FINEST, _COARSEST, _TEXELS = 1 / 60, 0.006, 0.012, 200_000
#: Rounds in which the normals of neighbouring faces are averaged, and the least cosine between such neighbours.
_ROUNDS, _ALIKE = 4, 0.5
#: Least cosine between a face and the axis along which its chart is seen.
_EDGE_ON = 0.3
#: Corners are welded if their coordinates, multiplied by this (1/m), round to the same integers.
_WELD = 1e4
#: Shadow rays per place and emitter, and from how many places around a texel takes its light.
_SHADOW_RAYS, _AVERAGED = 8, 8


def reach_of(boxes: Sequence[F32]) -> list[float]:
    """How far (m) each of some boxes (2, 3) shades a scan."""
    return [float(np.clip(_FAR * (box[1] - box[0]).max(), _LEAST, _MOST)) for box in boxes]


def with_shadow_maps(scene: Scene, boxes: Sequence[F32]) -> Scene:
    """A scan whose faces near the boxes (2, 3) have maps without shadows; any other scene as it is."""
    if scene.stage is None:
        return scene
    texel = float(np.clip(_PART * min(reach_of(boxes), default=0.0), _FINEST, _COARSEST))
    parts: list[Part] = []
    for part in scene.parts:
        if not scene.is_scan(part) or part.light is not None or not _has_pictures(part.mesh):
            parts.append(part)
            continue
        near = _near(part.mesh.positions, boxes)
        if not near.any():
            parts.append(part)
            continue
        mesh = part.mesh
        if near.all():
            parts.append(_mapped(part, mesh, part.dense, texel))
            continue
        # The sound of the whole part stays with the rest, which is never changed again.
        silent = replace(mesh, acoustic_positions=mesh.acoustic_positions[:0], acoustic_labels=())
        rest = own = None
        if part.dense is not None:
            close = _near(part.dense.mesh.positions, boxes)
            rest, own = (DenseMesh(_faces(part.dense.mesh, which)) for which in (~close, close))
        parts.append(replace(part, mesh=_faces(mesh, ~near), dense=rest))
        parts.append(_mapped(part, _faces(silent, near), own, texel))
    return replace(scene, parts=tuple(parts))


def _mapped(part: Part, mesh: Mesh, dense: DenseMesh | None, texel: float) -> Part:
    """``part`` with the faces of ``mesh``, in pictures those of ``dense``, and a map without shadows."""
    light = _blank(mesh.positions, texel)
    if dense is not None:
        dense = replace(dense, light_uv=_carried(dense.mesh.positions, mesh.positions, light.uv))
    return replace(part, mesh=_smoothed(mesh), light=light, dense=dense)


def _carried(triangles: F32, base: F32, uv: F32) -> F32:
    """(F, 3, 2) where faces (F, 3, 3) lie in a map in which faces ``base`` (N, 3, 3) lie at ``uv`` (N, 3, 2).

    Each takes the place of the nearest face of ``base`` that looks the same way; corners beyond that lie on its rim.
    """
    # A turn of the normal by one radian counts like 3 cm.
    keys = (np.concatenate([t.mean(axis=1), 0.03 * _unit(_face_normals(t))], axis=1) for t in (base, triangles))
    tree, where = keys
    nearest = cKDTree(tree).query(where)[1]
    corner = base[nearest].astype(np.float64)
    edges = corner[:, 1:] - corner[:, :1]
    gram = np.einsum("fik,fjk->fij", edges, edges)
    onto = np.einsum("fik,fck->fci", edges, triangles - corner[:, :1])
    determinant = np.maximum(gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2, 1e-24)[:, None]
    v = (gram[:, 1, 1, None] * onto[..., 0] - gram[:, 0, 1, None] * onto[..., 1]) / determinant
    w = (gram[:, 0, 0, None] * onto[..., 1] - gram[:, 0, 1, None] * onto[..., 0]) / determinant
    shares = np.maximum(np.stack([1 - v - w, v, w], axis=2), 0.0)
    shares /= shares.sum(axis=2, keepdims=True)
    return np.asarray(np.einsum("fcs,fsk->fck", shares, uv[nearest].astype(np.float64)).astype(np.float32))


def _has_pictures(mesh: Mesh) -> bool:
    """Whether the colours of a scan were read: without, another program draws the scan's own file."""
    return any(material.texture is not None for material in mesh.materials)


def _near(triangles: F32, boxes: Sequence[F32]) -> NDArray[np.bool_]:
    """(F,) which faces lie within reach of a box and have a side to it."""
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    near = np.zeros(len(triangles), dtype=bool)
    for box, reach in zip(boxes, reach_of(boxes), strict=True):
        gap = np.maximum(np.maximum(box[0] - high, low - box[1]), 0.0)
        near |= np.einsum("ij,ij->i", gap, gap) < reach * reach
    return near


def _faces(mesh: Mesh, chosen: NDArray[np.bool_]) -> Mesh:
    return replace(
        mesh,
        positions=mesh.positions[chosen],
        normals=mesh.normals[chosen],
        uv=mesh.uv[chosen],
        face_material=mesh.face_material[chosen],
    )


def _vertices(triangles: F32) -> NDArray[np.int64]:
    """(F, 3) numbers of the corners; those in the same place have the same."""
    keys = np.round(triangles.reshape(-1, 3).astype(np.float64) * _WELD).astype(np.int64)
    return np.asarray(distinct_rows(keys)[1].reshape(-1, 3), dtype=np.int64)


def _face_normals(triangles: F32) -> NDArray[np.float64]:
    """(F, 3) normals as long as the faces are large."""
    corner = triangles.astype(np.float64)
    return np.asarray(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def _smoothed(mesh: Mesh) -> Mesh:
    """The mesh with shading normals without the roughness of the scan; edges of things stay."""
    vertex = _vertices(mesh.positions)
    whole = _face_normals(mesh.positions)
    area = np.linalg.norm(whole, axis=1)
    normal = _unit(whole)
    count = int(vertex.max()) + 1
    corner = np.tile(normal[:, None], (1, 3, 1))
    for _ in range(_ROUNDS):
        weighted = np.repeat(normal * area[:, None], 3, axis=0)
        sums = np.stack([np.bincount(vertex.reshape(-1), weighted[:, c], count) for c in range(3)], axis=1)
        mean = _unit(np.asarray(sums, dtype=np.float64))[vertex]
        alike = np.einsum("fkc,fc->fk", mean, normal) > _ALIKE
        corner = np.where(alike[..., None], mean, normal[:, None])
        normal = _unit(np.asarray(corner.mean(axis=1)))
    return replace(mesh, normals=corner.astype(np.float32))


def _blank(triangles: F32, texel: float) -> LightMap:
    """A map of ones for faces (F, 3, 3)."""
    layout = layout_of(triangles, texel)
    size = np.array([layout.width, layout.height])
    texels = np.ones((layout.height, layout.width, 3), dtype=np.float16)
    return LightMap((layout.uv / size).astype(np.float32), texels)


def layout_of(triangles: F32, texel: float = _COARSEST) -> LightMapLayout:
    """Where faces (F, 3, 3) of a scan lie in a light map with texels of about ``texel`` metres."""
    vertex = _vertices(triangles)
    own = normal = _face_normals(triangles)
    area = float(np.linalg.norm(normal, axis=1).sum()) / 2
    texel = max(texel, float(np.sqrt(area / _TEXELS)))
    for _ in range(2):  # rough faces take the side of those around them
        count = int(vertex.max()) + 1
        spread = np.repeat(normal, 3, axis=0)
        sums = np.stack([np.bincount(vertex.reshape(-1), spread[:, c], count) for c in range(3)], axis=1)
        normal = np.asarray(sums[vertex].mean(axis=1))
    # But none that it is seen edge-on from: it would have no texels of its own.
    normal = np.where(np.sign(normal) * _unit(own) >= _EDGE_ON, normal, 0.0)
    normal = np.where(normal.any(axis=1, keepdims=True), normal, own)
    axis = np.argmax(np.abs(normal), axis=1)
    side = axis * 2 + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)
    chart = _charts(vertex, side)
    across = np.array([[1, 2], [2, 0], [0, 1]])[axis]
    flat = np.take_along_axis(triangles.astype(np.float64), across[:, None, :], axis=2) / texel
    charts = int(chart.max()) + 1
    low, high = np.full((charts, 2), np.inf), np.full((charts, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(axis=1))
    np.maximum.at(high, chart, flat.max(axis=1))
    # A texel beyond its rim on each side is the chart's own: look-up is bilinear.
    size = np.ceil(high - low).astype(np.int64) + 3
    corner, width, height = _packed(size)
    uv = flat - low[chart][:, None] + corner[chart][:, None] + 1.5
    return LightMapLayout(uv.astype(np.float32), chart.astype(np.int32), width, height)


def _charts(vertex: NDArray[np.int64], side: NDArray[np.int64]) -> NDArray[np.int64]:
    """(F,) the chart of each face: faces of one side that share corners."""
    count = len(vertex)
    corner = vertex * 6 + side[:, None]
    _, corner = np.unique(corner.reshape(-1), return_inverse=True)
    face = np.repeat(np.arange(count), 3)
    number = count + int(corner.max()) + 1
    graph = coo_matrix((np.ones(len(face), dtype=np.int8), (face, corner.reshape(-1) + count)), shape=(number, number))
    piece = connected_components(graph, directed=False)[1][:count]
    return np.asarray(np.unique(piece, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _packed(size: NDArray[np.int64]) -> tuple[NDArray[np.int64], int, int]:
    """(C, 2) corners of rectangles of sizes (C, 2: width, height) on shelves, and the width and height of all."""
    width = int(max(size[:, 0].max(), np.sqrt(1.2 * (size[:, 0] * size[:, 1]).sum())))
    corner = np.zeros_like(size)
    left = top = shelf = 0
    for chart in np.argsort(-size[:, 1], kind="stable"):
        wide, high = int(size[chart, 0]), int(size[chart, 1])
        if left + wide > width:
            left, top, shelf = 0, top + shelf, 0
        corner[chart] = left, top
        left, shelf = left + wide, max(shelf, high)
    return corner, width, top + shelf


def scaled_distance(position: F32, boxes: list[F32], reach: float) -> F32:
    """(N,) distance of points from the box (2, 3) in whose reach they are deepest, as part of that, times ``reach``."""
    distance = np.full(len(position), np.inf, dtype=np.float32)
    for box, own in zip(boxes, reach_of(boxes), strict=True):
        distance = np.minimum(distance, nearest_box(position, [box]) * np.float32(reach / own))
    return distance


def received(room: Surroundings, texel: NDArray[np.int64]) -> F32:
    """Light (n, 3) of some texels of a scan without the objects.

    It is measured at one texel of each tile and averaged over those near by: it varies slowly.
    """
    texels, base = room.texels, room.lit
    part = base.surfaces.part[texels.face[texel]]
    row, column = np.divmod(texels.cell[texel] - base.sheet.offset[part], base.sheet.width[part])
    chart = base.sheet.chart[texels.face[texel]]
    tile = np.column_stack([part, chart, row // TILE, column // TILE])
    places = texel[np.unique(tile, axis=0, return_index=True)[1]]
    table = cosine_directions(RAYS)
    light = np.zeros((len(places), 3), dtype=np.float32)
    every = np.ones((1, len(room.emitters)), dtype=bool)

    def hidden(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        ahead = beyond_bumps(directions)
        return base.tracer.occluded(origins + ahead * directions, directions, far - ahead[:, 0])

    def measure(first: int, last: int) -> None:
        own = places[first:last]
        position, normal, pattern = texels.position[own], texels.normal[own], texels.pattern[own]
        under = base.surfaces.face_normal[texels.face[own]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = base.tracer.intersect(origins + np.float32(BUMPS) * directions, directions)
        face = np.where(hits["primID"] < 0, OUTSIDE, hits["primID"])
        light[first:last] = room.dim.reflected(face, hits["u"], hits["v"]).reshape(len(own), RAYS, 3).mean(axis=1)
        reach = np.repeat(every, len(own), axis=0)
        light[first:last] += direct_light(room.emitters, reach, pattern, position, normal, hidden, rays=_SHADOW_RAYS)[0]

    in_chunks(measure, len(places), CHUNK, WORKERS)
    # A turn of the normal by one radian counts like 20 cm.
    tree = cKDTree(np.concatenate([texels.position[places], 0.2 * texels.normal[places]], axis=1))
    where = np.concatenate([texels.position[texel], 0.2 * texels.normal[texel]], axis=1)
    found = tree.query(where, k=list(range(1, min(_AVERAGED, len(places)) + 1)))
    away, near = np.asarray(found[0]), np.asarray(found[1])
    weight = 1.0 / (away**2 + 1e-3)
    weight /= weight.sum(axis=1, keepdims=True)
    around = np.asarray(np.einsum("nk,nkc->nc", weight, light[near]).astype(np.float32))
    if room.sun is None:
        return around
    # The edge of a patch of sun is sharp.
    own = (texels.pattern[texel], texels.position[texel], texels.normal[texel], texels.across[texel])
    return around + sun_light(room.sun, *own, base.tracer, SAMPLES)


def beyond_bumps(directions: F32) -> F32:
    """(N, 1) how far along directions (N, 3), in their lengths, what is nearer than `BUMPS` ends."""
    length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
    ahead: F32 = np.minimum(np.float32(BUMPS) / np.maximum(length, np.float32(1e-9)), np.float32(0.5))
    return ahead[:, None]


def displayed(radiance: F32, ratio: F32, black: F32 | float = 0.0) -> F32:
    """The factor (N, 3) of display light when radiance (N, 3), as a scan's texels show it, changes by ``ratio``.

    Over it lies the radiance ``black``, which does not change.
    """
    shown = np.maximum(radiance, 1e-3)
    return np.asarray((tone_curve(shown * ratio + black) / tone_curve(shown + black)).astype(np.float32))
