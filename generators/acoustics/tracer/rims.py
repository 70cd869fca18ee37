"""The rims of the mirror planes, and where they end the surface: at free edges and where another material begins."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.tracer.kernels import FAR, closest_hits
from generators.acoustics.tracer.tables import MeshTables, Rims
from generators.core.bvh import STACK

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Corners of triangles nearer than this (m) are one.
_ONE_CORNER = 1e-4
#: A rim is looked at in pieces of about this length (m).
_PIECE = 0.25
#: Height above a surface, and distance before its rim, at which a look across the rim starts (m).
_HEIGHT, _BEFORE = 2e-3, 5e-3
#: What rises within this distance behind a rim (m) goes on from it, as the other wall of a corner does.
_GAP = 0.05
#: Distance behind a rim (m) of the look for a surface that goes on.
_BEHIND = 0.02
#: A surface that goes on lower by up to this (m), as the floor round a rug, continues the upper one: a step that is
#: small beside the wavelengths and zones in question.
_STEP = 0.1
#: One that goes on lower by up to this (m) lies in the same plane.
_LEVEL = 1.5e-3


def rims_of(mesh: MeshTables, equation: F64, bounds: F64) -> Rims:
    """The rims of all planes of ``mesh``, whose equations (P, 4) and bounds (P, 6) are given."""
    ends, plane = _outlines(mesh, equation)
    ends, plane = _pieces(ends, plane)
    free = np.zeros((len(ends), 3), dtype=np.bool_)
    if len(ends):
        for side, sign in enumerate((1.0, -1.0)):
            free[:, side] = _ends_surface(mesh, ends, plane, sign * equation[plane, :3], equation[plane, :3])
        free[:, 2] = free[:, 0] | free[:, 1]
        ends, plane, free = _merged(ends, plane, free)
    first = np.searchsorted(plane, np.arange(len(equation) + 1)).astype(np.int32)
    is_open = np.zeros(len(equation), dtype=np.bool_)
    is_open[plane[free[:, 2]]] = True
    normal = np.ascontiguousarray(equation[:, :3])
    return Rims(first, ends, free, normal, bounds, is_open, np.flatnonzero(is_open).astype(np.int32))


def _outlines(mesh: MeshTables, equation: F64) -> tuple[F64, I64]:
    """(E, 6) both ends of the outlines, counterclockwise about the plane's normal, and the plane (E,) of each."""
    used = np.flatnonzero(mesh.plane >= 0)
    plane = mesh.plane[used].astype(np.int64)
    a = mesh.corners[used, :3]
    corners = np.stack([a, a + mesh.corners[used, 3:6], a + mesh.corners[used, 6:]], axis=1)
    normal = np.cross(mesh.corners[used, 3:6], mesh.corners[used, 6:])
    reversed_ = np.einsum("ij,ij->i", normal, equation[plane, :3]) < 0
    corners[reversed_] = corners[reversed_, ::-1]
    keys = np.round(corners.reshape(-1, 3) / _ONE_CORNER).astype(np.int64)
    _, index, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(-1, 3).astype(np.int64)
    start, end = number.reshape(-1), np.roll(number, -1, axis=1).reshape(-1)
    edges = np.unique(np.stack([np.repeat(plane, 3), start, end], axis=1), axis=0)
    count = len(index) + 1
    forth = (edges[:, 0] * count + edges[:, 1]) * count + edges[:, 2]
    back = (edges[:, 0] * count + edges[:, 2]) * count + edges[:, 1]
    edges = edges[~np.isin(forth, back) & (edges[:, 1] != edges[:, 2])]
    points = corners.reshape(-1, 3)[index]
    return np.concatenate([points[edges[:, 1]], points[edges[:, 2]]], axis=1), edges[:, 0]


def _pieces(ends: F64, plane: I64) -> tuple[F64, I64]:
    """The edges cut into pieces, in their order."""
    length = np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
    count = np.maximum(np.ceil(length / _PIECE), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(ends)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    start, step = ends[owner, :3], (ends[owner, 3:] - ends[owner, :3]) / count[owner, None]
    # The last piece ends where the edge does, to the last bit.
    last = np.where((place + 1 == count[owner])[:, None], ends[owner, 3:], start + (place + 1)[:, None] * step)
    return np.concatenate([start + place[:, None] * step, last], axis=1), plane[owner]


def _ends_surface(mesh: MeshTables, ends: F64, plane: I64, facing: F64, normal: F64) -> NDArray[np.bool_]:
    """(E,) whether nothing goes on behind each edge, seen from the side that ``facing`` (E, 3) points to."""
    along = ends[:, 3:] - ends[:, :3]
    outward = np.cross(along, normal)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-30)
    middle = 0.5 * (ends[:, 3:] + ends[:, :3]) + _HEIGHT * facing
    across, _ = _first(mesh, middle - _BEFORE * outward, outward)
    down, hit = _first(mesh, middle + _BEHIND * outward, -facing)
    neighbour = np.where(hit >= 0, mesh.plane[hit], -1)
    level = np.abs(down - _HEIGHT) < _LEVEL
    goes_on = (down < _STEP + _HEIGHT) & ~(level & (neighbour >= 0) & (neighbour != plane))
    return np.asarray((across > _BEFORE + _GAP) & ~goes_on)


def _first(mesh: MeshTables, origins: F64, directions: F64) -> tuple[F64, NDArray[np.int32]]:
    distance, triangle = np.empty(len(origins)), np.empty(len(origins), dtype=np.int32)
    stack, entries = np.empty(STACK, dtype=np.int32), np.empty(STACK)
    closest_hits(
        mesh, np.ascontiguousarray(origins), np.ascontiguousarray(directions), distance, triangle, stack, entries
    )
    return np.where(distance < FAR, distance, math.inf), triangle


def _merged(ends: F64, plane: I64, free: NDArray[np.bool_]) -> tuple[F64, I64, NDArray[np.bool_]]:
    """Neighbouring pieces of one straight edge that are alike, joined again."""
    along = ends[:, 3:] - ends[:, :3]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    same = (plane[1:] == plane[:-1]) & (free[1:] == free[:-1]).all(axis=1)
    same &= (np.abs(ends[1:, :3] - ends[:-1, 3:]).max(axis=1) < 1e-12) & (
        np.einsum("ij,ij->i", along[1:], along[:-1]) > 1 - 1e-12
    )
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    last = np.append(first[1:], len(ends)) - 1
    return np.concatenate([ends[first, :3], ends[last, 3:]], axis=1), plane[first], free[first]
