"""Tests of whether an object fits at a place: no collision, no blocked passage, visible to the walking agent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.core.boxes import UprightBox, yaw_matrix
from generators.core.freespace import CELL, SENSOR_HEIGHT, FreeSpace, distance_to_polygon
from generators.core.scene import Mesh, SupportKind
from generators.placement.site import Site

Array = NDArray[np.float64]

#: Depth (m) to which a triangle may reach into an object's box: contact is not collision.
SKIN = 0.002
#: In a scan, bumps of the support between an object's feet may reach this far up (in from the wall) below it (m).
BUMPS = 0.012
#: Least distance between objects (m).
ELBOW_ROOM = 0.03
#: Least distance of an object from a doorway (m).
DOOR_ZONE = 0.6
#: Size that the largest connected free floor must keep: a share of its size before, or an area (m²).
KEEP_SHARE, KEEP_AREA = 0.8, 1.2
#: Least floor area (m²) of the places, 0.7–3 m away, from which half of an object's front is in sight.
VIEW_NEAR, VIEW_FAR, VIEW_AREA = 0.7, 3.0, 0.30
#: Least angular width of these places as seen from the object (degrees).
VIEW_SPREAD = 35.0
#: Largest number of places from which the visibility of an object is tested.
_EYES = 80


@dataclass(frozen=True, eq=False)
class Body:
    """An object at a possible place: its box, (S, 3) points spread over its front, and a small tilt of the box.

    The tilt (3, 3), about the box's centre, is None for an upright object.
    """

    box: UprightBox
    fronts: Array
    tilt: Array | None = None

    @classmethod
    def of(cls, mesh: Mesh, fronts: Array, position: ArrayLike, yaw: float, tilt: Array | None = None) -> Body:
        """``mesh`` and its ``fronts`` (`front_points`) placed at ``position``, turned by ``yaw``, then by ``tilt``."""
        origin = np.asarray(position, dtype=np.float64)
        world = fronts @ yaw_matrix(yaw).T
        if tilt is not None:
            world = world @ tilt.T
        return cls(turned_about(UprightBox.around(mesh, position, yaw), position, tilt), world + origin, tilt)

    @property
    def centre(self) -> Array:
        """(3,) middle of the box."""
        return self.box.centre


class RoomFitting:
    """The tests of one room. A reason of refusal is a verb phrase in the plural, because error messages count them."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self._before = site.space.largest()

    def fault_alone(self, body: Body, kind: SupportKind) -> str:
        """The reason why an object on a support of ``kind`` does not fit even without the others; "" if it fits."""
        box = body.box
        if self.site.scanned:
            # It touches the support already: bumps between its feet are no collision.
            towards = yaw_matrix(box.yaw)[:, 2] if kind == "wall" else np.array([0.0, 1.0, 0.0])
            less = np.minimum(BUMPS * (np.array([0, 0, 1]) if kind == "wall" else np.array([0, 1, 0])), box.half) / 2
            box = UprightBox(box.centre + less.sum() * towards, box.half - less, box.yaw)
        if self.site.collides(box.grown(-SKIN), body.tilt):
            return "collide with the room"
        if kind == "floor":
            for door in self.site.doors:
                if distance_to_polygon(door, body.box.footprint).min() < DOOR_ZONE:
                    return "stand in a doorway"
        return self.fault_together([body])

    def fault_together(self, bodies: Sequence[Body]) -> str:
        """The reason why objects that fit separately do not fit together; "" if they fit."""
        for index, one in enumerate(bodies):
            if any(one.box.grown(ELBOW_ROOM).hits_box(other.box) for other in bodies[:index]):
                return "touch another object"
        left = self.site.space.without([body.box.footprint for body in bodies]).largest()
        if left.area < min(KEEP_SHARE * self._before.area, KEEP_AREA):
            return "leave too little free floor"
        # Each door that could be reached before must still be reachable.
        if not all((way & left.walkable).any() for way in self._ways):
            return "block a door"
        for index, body in enumerate(bodies):
            others = [other.box for k, other in enumerate(bodies) if k != index]
            if self._hidden(body, others, left):
                return "hide an object" if others else "are hidden from the free floor"
        return ""

    @cached_property
    def _ways(self) -> list[NDArray[np.bool_]]:
        """For each reachable door, the cells of the largest free floor just inside it."""
        centres = self._before.cell_centres()
        ways = []
        for door in self.site.doors:
            near = np.linalg.norm(centres[:, None] - door[None, ::4], axis=2).min(axis=1) <= 0.5
            ways.append(near.reshape(self._before.walkable.shape) & self._before.walkable)
        return [way for way in ways if way.any()]

    def _hidden(self, body: Body, others: Sequence[UprightBox], floor: FreeSpace) -> bool:
        """Whether the object's front is visible from too little of the free ``floor``."""
        yaw = body.box.yaw
        offsets = floor.points - body.centre[[0, 2]]
        distance = np.linalg.norm(offsets, axis=1)
        before = offsets @ np.array([math.sin(yaw), math.cos(yaw)]) > 0
        cells = floor.points[(distance >= VIEW_NEAR) & (distance <= VIEW_FAR) & before]
        step = max(1, len(cells) // _EYES)
        eyes = cells[::step]
        if not len(eyes):
            return True
        eye = np.insert(eyes, 1, floor.floor + SENSOR_HEIGHT, axis=1)
        starts, ends = np.repeat(eye, len(body.fronts), axis=0), np.tile(body.fronts, (len(eye), 1))
        blocked = self.site.caster.occluded(starts, ends - starts, 0.999)
        for box in others:
            blocked |= box.blocks(starts, ends)
        sees = 1 - blocked.reshape(len(eye), -1).mean(axis=1) >= 0.5
        if sees.sum() * step * CELL * CELL < VIEW_AREA:
            return True
        bearings = np.degrees(np.arctan2(*(eyes[sees] - body.centre[[0, 2]]).T))
        ahead = (bearings - math.degrees(yaw) + 180) % 360 - 180
        return bool(np.ptp(ahead) < VIEW_SPREAD)


def turned_about(box: UprightBox, origin: ArrayLike, tilt: Array | None) -> UprightBox:
    """``box`` with its centre turned by a small ``tilt`` (3, 3) about ``origin`` (3,); it stays upright itself."""
    if tilt is None:
        return box
    about = np.asarray(origin, dtype=np.float64)
    return replace(box, centre=tilt @ (box.centre - about) + about)


def front_points(mesh: Mesh, count: int = 24) -> Array:
    """(count, 3) points 1 cm in front of the faces that face forward (+Z), spread in proportion to area."""
    triangles = mesh.positions.astype(np.float64)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    points, _ = spread_points(triangles, np.maximum(normals[:, 2], 0.0), count)
    return np.asarray(points + np.array([0.0, 0.0, 0.01]))


def spread_points(triangles: Array, weights: Array, count: int) -> tuple[Array, NDArray[np.intp]]:
    """Points on ``triangles`` (F, 3, 3), spread in proportion to ``weights`` (F,) without random numbers.

    Within a triangle they follow the additive sequence of the plastic number (Roberts, 2018).

    Returns:
        points (count, 3) and the face of each (count,).
    """
    if weights.sum() <= 0:
        weights = np.ones(len(triangles))
    edges = np.cumsum(weights) / weights.sum()
    faces = np.minimum(np.searchsorted(edges, (np.arange(count) + 0.5) / count), len(triangles) - 1)
    r, s = ((0.5 + np.arange(1, count + 1) * step) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    outside = r + s > 1
    r, s = np.where(outside, 1 - r, r)[:, None], np.where(outside, 1 - s, s)[:, None]
    a, b, c = (triangles[faces, k] for k in range(3))
    return np.asarray(a + r * (b - a) + s * (c - a)), faces
