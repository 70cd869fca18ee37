"""Which lamps light a room: how often a path tracer tries each of them, in proportion to the light that arrives.

A home has a hundred lamps and windows, of which a room sees a few. A path that ends at a lamp behind a wall brings
nothing, so lamps are tried in proportion to the direct light that they cast on the surfaces which are seen from within
the room, its doorways included (light tried by its contribution: Shirley, Wang and Zimmerman, "Monte Carlo techniques
for direct lighting calculations", ACM Trans. Graph. 15 (1996)). No lamp is left out: those that light the room by way
of other rooms keep the share `LEAST` of all tries, so that the mean picture stays the same and noise alone changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.low_discrepancy import fibonacci_directions
from generators.core.rays import Tracer
from generators.core.scene import F32, Room

#: Share of all tries that goes to lamps by their power alone, wherever they are.
LEAST = 0.1
#: Rays by which the surfaces of a room are found, and points of each lamp.
_RAYS, _POINTS = 512, 32
#: Lamps nearer than this (m) to a surface do not count for more.
_NEAR = 0.3
#: Rays end this much before what they are sent to (m).
_GAP = 2e-3


@dataclass(frozen=True, eq=False)
class Lamp:
    """A surface that shines.

    Attributes:
        positions: (F, 3, 3) corners of its faces, metres.
        normals: (F, 3, 3) their normals; they shine to this side.
        emission: (3,) radiance of red, green and blue.
    """

    positions: F32
    normals: F32
    emission: Sequence[float]

    @property
    def area(self) -> NDArray[np.float64]:
        """(F,) areas of the faces, m²."""
        edges = self.positions.astype(np.float64)
        return np.asarray(np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) / 2)

    @property
    def power(self) -> float:
        """Area times radiance, summed over the colours."""
        return float(self.area.sum() * sum(self.emission))

    def points(self, rng: np.random.Generator) -> tuple[F32, F32]:
        """(`_POINTS`, 3) points and unit normals, evenly spread over the area."""
        ends = np.cumsum(self.area)
        face = np.searchsorted(ends, (np.arange(_POINTS) + rng.random(_POINTS)) / _POINTS * ends[-1])
        face = np.minimum(face, len(ends) - 1)
        share = rng.dirichlet((1.0, 1.0, 1.0), _POINTS)[..., None]
        normal = self.normals[face].sum(axis=1)
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        return (self.positions[face] * share).sum(axis=1).astype(np.float32), normal.astype(np.float32)


def lamp_weights(lamps: Sequence[Lamp], tracer: Tracer, room: Room | None) -> NDArray[np.float64]:
    """How often each lamp is tried in a room.

    Args:
        lamps: of the scene.
        tracer: of all its triangles, through none of which light passes.
        room: that is looked at; None: not known, so that power alone counts.

    Returns:
        (lamps,) positive weights; their sum is 1.
    """
    if not lamps:
        return np.zeros(0)
    power = np.array([lamp.power for lamp in lamps])
    by_power: NDArray[np.float64] = power / power.sum()
    if room is None:
        return by_power
    rng = np.random.default_rng(0)  # the same tries in each run
    seen = _surfaces(tracer, room, rng)
    light = np.array([_irradiance(lamp, tracer, seen, rng) for lamp in lamps])
    return np.asarray((1 - LEAST) * light / light.sum() + LEAST * by_power) if light.any() else by_power


def _surfaces(tracer: Tracer, room: Room, rng: np.random.Generator) -> F32:
    """(N, 3) points just before surfaces that are seen from anywhere in the room."""
    low, high = np.array(room.low), np.array(room.high)
    start = (low + (high - low) * rng.random((_RAYS, 3))).astype(np.float32)
    way = fibonacci_directions(_RAYS).astype(np.float32)
    hit = tracer.intersect(start, way)
    met = hit["primID"] >= 0
    far = np.maximum(hit["tfar"][met, None] - _GAP, 0.0)
    return np.asarray(start[met] + far * way[met], dtype=np.float32)


def _irradiance(lamp: Lamp, tracer: Tracer, seen: F32, rng: np.random.Generator) -> float:
    """The light that a lamp casts on points, as if they were small balls: summed, in no particular unit."""
    points, normals = lamp.points(rng)
    pick = np.arange(len(seen)) % _POINTS
    way = (points[pick] - seen).astype(np.float32)
    distance = np.linalg.norm(way, axis=1)
    cosine = -(way * normals[pick]).sum(axis=1) / np.maximum(distance, 1e-9)
    lit = np.flatnonzero((cosine > 0) & (distance > _GAP))
    if not len(lit):
        return 0.0
    hidden = tracer.occluded(seen[lit], way[lit], (1 - _GAP / distance[lit]).astype(np.float32))
    lit = lit[~hidden]
    return float((cosine[lit] / np.maximum(distance[lit], _NEAR) ** 2).sum() * lamp.power)
