"""Rays that wander through a room from surface to surface, mirrored or scattered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.measures.decay import SPEED_OF_SOUND
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.rays import RayCaster
from generators.core.scene import Room

Array = NDArray[np.float64]

#: Rays, reflections of each, points from which they start.
RAYS, REFLECTIONS, POINTS = 2000, 160, 8
#: Least distance of these points from all surfaces (m); heights at which they are looked for, shares of the room's.
_CLEAR, _HEIGHTS = 0.25, (0.35, 0.5, 0.65)
#: Distance before a surface at which the reflected ray starts (m), on the way it came: no other surface is passed.
_OFF = 1e-3
_SEED = 34
#: Share of the reflections that are scattered where the material does not matter.
_SCATTERING = 0.3


class RayWalk(NamedTuple):
    """Reflections of rays.

    Attributes:
        time: (R, K) when each happens, s; infinite once a ray has left.
        face: (R, K) which face reflects; −1 where a ray meets none, and after that.
    """

    time: Array
    face: NDArray[np.int32]

    @property
    def escaped(self) -> float:
        """Share of the flights from surface to surface that leave the mesh."""
        gone = int((self.face < 0).any(axis=1).sum())
        return gone / max(int((self.face >= 0).sum()) + gone, 1)


def walk(caster: RayCaster, triangles: Array, scattering: Array, points: Array) -> RayWalk:
    """Send `RAYS` rays from ``points`` and follow them over `REFLECTIONS` reflections.

    Args:
        caster: of the triangles.
        triangles: (A, 3, 3) metres.
        scattering: (A,) share of the reflections that follow Lambert's law; the others are mirrored.
        points: (P, 3) where they start, in all directions.
    """
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-30)
    rng, each = np.random.default_rng(_SEED), max(RAYS // len(points), 1)
    origin, way = np.repeat(points, each, axis=0), np.tile(fibonacci_directions(each), (len(points), 1))
    time, faces = np.full((len(way), REFLECTIONS), np.inf), np.full((len(way), REFLECTIONS), -1, dtype=np.int32)
    passed, alive = np.zeros(len(way)), np.arange(len(way))
    for step in range(REFLECTIONS):
        distance, face = caster.closest(origin[alive], way[alive])
        inside = face >= 0
        time[alive[~inside], step] = passed[alive[~inside]]
        alive, face, distance = alive[inside], face[inside], distance[inside].astype(np.float64)
        passed[alive] += distance / SPEED_OF_SOUND
        time[alive, step], faces[alive, step] = passed[alive], face
        if not len(alive):
            break
        towards, normal = way[alive], normals[face]
        normal *= -np.sign((normal * towards).sum(axis=1))[:, None]
        mirrored = towards - 2 * (towards * normal).sum(axis=1)[:, None] * normal
        # Lambert's cosine law: the normal plus a point on the unit sphere.
        ball = rng.normal(size=(len(alive), 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        diffuse = rng.random(len(alive)) < scattering[face]
        new = np.where(diffuse[:, None], normal + ball, mirrored)
        origin[alive] += towards * np.maximum(distance - _OFF, 0.0)[:, None]
        way[alive] = new / np.maximum(np.linalg.norm(new, axis=1, keepdims=True), 1e-12)
    return RayWalk(time, faces)


def free_points(caster: RayCaster, room: Room) -> Array:
    """(N, 3) points of a room that are far from all surfaces, spread over it; its middle if there are none."""
    low, high = np.asarray(room.low), np.asarray(room.high)
    shares = np.stack(np.meshgrid(np.linspace(0.1, 0.9, 9), _HEIGHTS, np.linspace(0.1, 0.9, 9), indexing="ij"), axis=-1)
    points = low + shares.reshape(-1, 3) * (high - low)
    around = fibonacci_directions(60)
    distance, face = caster.closest(np.repeat(points, len(around), axis=0), np.tile(around, (len(points), 1)))
    reach = np.where(face >= 0, distance, np.inf).reshape(len(points), -1)
    nearest = reach.min(axis=1)
    # Inside a piece of furniture, nothing is far.
    sees = np.median(reach, axis=1) >= 0.15 * float(np.linalg.norm(high - low))
    clear = points[(nearest >= min(_CLEAR, float(np.median(nearest)))) & sees]
    if not len(clear):
        return np.asarray((low + high) / 2)[None]
    return np.asarray(clear[np.unique(np.linspace(0, len(clear) - 1, POINTS).round().astype(np.int64))])


def escaped_share(caster: RayCaster, triangles: Array, rooms: Sequence[Room]) -> float:
    """Share of the flights between surfaces, in all rooms, that leave the mesh ``triangles`` (A, 3, 3)."""
    scattering = np.full(len(triangles), _SCATTERING)
    return float(np.mean([walk(caster, triangles, scattering, free_points(caster, room)).escaped for room in rooms]))
