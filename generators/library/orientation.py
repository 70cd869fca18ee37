"""Finds the outer side of each face: makes the winding consistent, then decides by visibility.

Models from unknown sources have faces of either winding, duplicate faces and single sheets. After Takayama, Jacobson,
Kavan and Sorkine-Hornung, "A Simple Method for Correcting Facet Orientations in Polygon Meshes Based on Ray Casting"
(JCGT 2014):
faces that are connected by edges of exactly two faces form a patch; a patch is wound consistently, and its outside is
the side from which more rays leave the object.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from generators.assets.acoustic_twin import weld
from generators.core.rays import RayCaster

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Corners nearer than this distance (m) are one vertex.
WELD = 2e-5
#: Sample points per patch, sample points in total, and rays from each side of a point.
_LEAST, _POINTS, _RAYS = 24, 8_000, 6
#: A sheet is visible from behind if at least this share of the rays from its back reaches a viewer.
_SEEN = 0.12


@dataclass(frozen=True, eq=False)
class Winding:
    """Orientation of the faces.

    Attributes:
        flip: (F,) bool, faces whose winding must be reversed.
        sheet: (F,) bool, faces of sheets that are visible from both sides.
        inconsistent: number of faces whose winding differed from that of their neighbours.
        inverted: number of faces of patches that were inside out as a whole.
        shared: number of edges at which more than two faces meet.
        open_edges: number of edges with only one face.
    """

    flip: Flags
    sheet: Flags
    inconsistent: int
    inverted: int
    shared: int
    open_edges: int


def find_winding(triangles: Array, blockers: Array | None = None) -> Winding:
    """Decide which of the triangles (F, 3, 3), in metres, Y up, must be reversed.

    Args:
        triangles: without degenerate and duplicate faces.
        blockers: (B, 3, 3) more triangles that stop rays.
    """
    _, faces = weld(triangles, WELD)
    patch, turned, shared, open_edges = _patches(faces)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    count = int(patch.max()) + 1
    # Within a patch, the winding of the majority counts as the intended one.
    turned_area = np.bincount(patch, weights=area * turned, minlength=count)
    whole_area = np.bincount(patch, weights=area, minlength=count)
    turned ^= (turned_area > 0.5 * whole_area)[patch]
    wound = np.where(turned[:, None, None], triangles[:, [0, 2, 1]], triangles)
    front, back, seen_front, seen_back = _visibility(wound, patch, area, blockers)
    inverted = back > front + 0.02
    thin = (np.minimum(seen_front, seen_back) > _SEEN) & ~_closed(faces, patch, count)
    return Winding(
        flip=turned ^ inverted[patch],
        sheet=thin[patch],
        inconsistent=int(turned.sum()),
        inverted=int(inverted[patch].sum()),
        shared=shared,
        open_edges=open_edges,
    )


def _edges(faces: Faces) -> tuple[Faces, Faces, Flags]:
    """Per face edge: a key of its two vertices, its face, and whether it runs from the lower to the higher vertex."""
    start, end = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    return low * (int(faces.max()) + 1) + high, np.repeat(np.arange(len(faces)), 3), start < end


def _patches(faces: Faces) -> tuple[Faces, Flags, int, int]:
    """Patch of each face, whether it is wound against its patch, and the numbers of edges with > 2 and with 1 face.

    The graph of faces is doubled: node f is face f unchanged, node F + f the reversed face. If a patch cannot be wound
    consistently (a Möbius strip), both nodes are in one component: its faces are left unchanged.
    """
    total = len(faces)
    key, owner, rising = _edges(faces)
    order = np.argsort(key, kind="stable")
    key, owner, rising = key[order], owner[order], rising[order]
    _, first, size = np.unique(key, return_index=True, return_counts=True)
    pair = first[size == 2]
    left, right = owner[pair], owner[pair + 1]
    same = (rising[pair] == rising[pair + 1]).astype(
        np.int64
    )  # two neighbours of equal winding run along their common edge in opposite directions
    rows = np.concatenate([left, left + total])
    columns = np.concatenate([right + total * same, right + total * (1 - same)])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * total, 2 * total))
    _, label = connected_components(graph, directed=False)
    straight, turned = label[:total], label[total:]
    twisted = straight == turned
    _, patch = np.unique(np.minimum(straight, turned), return_inverse=True)
    return patch.reshape(-1), (straight > turned) & ~twisted, int((size > 2).sum()), int((size == 1).sum())


def _closed(faces: Faces, patch: Faces, count: int) -> Flags:
    """Which patches have no open edge."""
    key, owner, _ = _edges(faces)
    _, inverse, size = np.unique(key, return_inverse=True, return_counts=True)
    lone = size[inverse.reshape(-1)] == 1
    closed = np.ones(count, dtype=bool)
    closed[patch[owner[lone]]] = False
    return closed


def _visibility(
    triangles: Array, patch: Faces, area: Array, blockers: Array | None
) -> tuple[Array, Array, Array, Array]:
    """Per patch, from its front and its back: shares of rays that leave the object, and that reach a viewer."""
    rng = np.random.Generator(np.random.PCG64(2014))  # the same points for the same mesh
    face = _sample_faces(patch, area)
    u, v = rng.random(len(face)), rng.random(len(face))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    a, b, c = (triangles[face, k] for k in range(3))
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    everything = triangles if blockers is None or not len(blockers) else np.concatenate([triangles, blockers])
    caster = RayCaster(everything.astype(np.float32))
    span = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    count = int(patch.max()) + 1
    samples = np.bincount(patch[face], minlength=count) * _RAYS
    shares: list[Array] = []
    seen: list[Array] = []
    for side in (1.0, -1.0):
        toward = side * normal
        sphere: Any = rng.normal(size=(len(face), _RAYS, 3))
        sphere /= np.linalg.norm(sphere, axis=2, keepdims=True)
        directions = (toward[:, None] + 0.98 * sphere).reshape(-1, 3)  # cosine-weighted (Lambert)
        origins = np.repeat(points + toward * max(1e-5, 2e-5 * span), _RAYS, axis=0)
        free = ~caster.occluded(origins, directions)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        # A viewer is in front of the object or beside it, and not below it.
        onlooker = free & (directions[:, 1] > -0.1) & (directions[:, 2] > -0.2)
        owner = np.repeat(patch[face], _RAYS)
        shares.append(np.bincount(owner, weights=free, minlength=count) / samples)
        seen.append(np.bincount(owner, weights=onlooker, minlength=count) / samples)
    return shares[0], shares[1], seen[0], seen[1]


def _sample_faces(patch: Faces, area: Array) -> Faces:
    """Faces of the sample points: in proportion to area, with a minimum for every patch."""
    count = int(patch.max()) + 1
    whole = np.bincount(patch, weights=area, minlength=count)
    wanted = np.maximum(np.ceil(_POINTS * whole / whole.sum()), _LEAST)
    order = np.lexsort((np.arange(len(patch)), patch))
    cumulative = np.cumsum(area[order])
    last = np.searchsorted(patch[order], np.arange(count), side="right") - 1
    start = np.concatenate([[0.0], cumulative[last][:-1]])
    owner = np.repeat(np.arange(count), wanted.astype(np.int64))
    rank = np.arange(len(owner)) - np.repeat(np.concatenate([[0], np.cumsum(wanted)[:-1]]), wanted.astype(np.int64))
    at = start[owner] + (rank + 0.5) / wanted[owner] * whole[owner]
    found = np.searchsorted(cumulative, at)
    first = np.concatenate([[0], last[:-1] + 1])
    return np.asarray(order[np.clip(found, first[owner], last[owner])])
