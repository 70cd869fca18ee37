"""Oriented boxes that stand upright, and exact overlap tests with triangles, segments and one another.

The tests are separating-axis tests (Gottschalk, Lin, Manocha, SIGGRAPH 1996; Akenine-Möller, "Fast 3D triangle-box
overlap testing", 2001), vectorised over the triangles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.core.scene import Mesh

Array = NDArray[np.float64]
_SIGNS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)


def axis_rotation(axis: str, angle: float | Array) -> Array:
    """(…, 3, 3) right-handed rotations about ``"x"``, ``"y"`` or ``"z"`` by ``angle`` (…) radians."""
    cosine, sine = np.cos(angle), np.sin(angle)
    first = "xyz".index(axis)
    second, third = (first + 1) % 3, (first + 2) % 3
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., first, first] = 1.0
    out[..., second, second], out[..., third, third] = cosine, cosine
    out[..., second, third], out[..., third, second] = -sine, sine
    return out


def yaw_matrix(yaw: float) -> Array:
    """(3, 3) rotation about +Y by ``yaw`` radians: the front +Z turns to (sin yaw, 0, cos yaw)."""
    return axis_rotation("y", yaw)


@dataclass(frozen=True, eq=False)
class UprightBox:
    """A box turned about the vertical.

    Attributes:
        centre: (3,) metres.
        half: (3,) half extents along its own x, y, z.
        yaw: radians about +Y.
    """

    centre: Array
    half: Array
    yaw: float

    @classmethod
    def around(cls, mesh: Mesh, position: ArrayLike, yaw: float) -> UprightBox:
        """The bounding box of ``mesh``, placed with its origin at ``position`` and turned by ``yaw``."""
        low, high = mesh.bounds.astype(np.float64)
        centre = yaw_matrix(yaw) @ ((low + high) / 2) + np.asarray(position, dtype=np.float64)
        return cls(centre, (high - low) / 2, yaw)

    def grown(self, by: float) -> UprightBox:
        """The box with every face moved outwards by ``by`` metres (inwards where negative)."""
        return UprightBox(self.centre, np.maximum(self.half + by, 1e-4), self.yaw)

    def to_local(self, points: ArrayLike) -> Array:
        """Points (..., 3) in the box's own frame, relative to its centre."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.centre) @ yaw_matrix(self.yaw))

    @property
    def footprint(self) -> Array:
        """(4, 2) x and z of the corners, in order around the box."""
        local = np.zeros((4, 3))
        local[:, [0, 2]] = _SIGNS * self.half[[0, 2]]
        return np.asarray((local @ yaw_matrix(self.yaw).T + self.centre)[:, [0, 2]])

    @property
    def bounds(self) -> Array:
        """(2, 3) lowest and highest corner of the axis-aligned box around it."""
        reach = np.abs(yaw_matrix(self.yaw)) @ self.half
        return np.stack([self.centre - reach, self.centre + reach])

    def distance(self, points: ArrayLike) -> Array:
        """(...,) distance from points (..., 3); 0 inside."""
        return np.asarray(np.linalg.norm(np.maximum(np.abs(self.to_local(points)) - self.half, 0.0), axis=-1))

    def hits_triangles(self, triangles: ArrayLike) -> NDArray[np.bool_]:
        """(F,) whether the solid box and each triangle (F, 3, 3) share a point."""
        corners = np.asarray(triangles)
        low, high = self.bounds
        out = ((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)
        near = np.flatnonzero(out)
        if not len(near):
            return np.asarray(out)
        local = self.to_local(corners[near])
        apart = ((local.min(axis=1) > self.half) | (local.max(axis=1) < -self.half)).any(axis=1)
        edges = np.roll(local, -1, axis=1) - local
        normal = np.cross(edges[:, 0], edges[:, 1])
        apart |= np.abs(np.einsum("fi,fi->f", normal, local[:, 0])) > np.abs(normal) @ self.half
        for axis in np.eye(3):
            for k in range(3):
                across = np.cross(axis, edges[:, k])
                spread = np.einsum("fi,fci->fc", across, local)
                reach = np.abs(across) @ self.half
                apart |= (spread.min(axis=1) > reach) | (spread.max(axis=1) < -reach)
        out[near] = ~apart
        return np.asarray(out)

    def hits_box(self, other: UprightBox) -> bool:
        """Whether two upright boxes overlap."""
        if abs(self.centre[1] - other.centre[1]) > self.half[1] + other.half[1]:
            return False
        a, b = self.footprint, other.footprint
        for yaw in (self.yaw, other.yaw):
            for axis in (np.array([math.cos(yaw), -math.sin(yaw)]), np.array([math.sin(yaw), math.cos(yaw)])):
                if (a @ axis).min() > (b @ axis).max() or (b @ axis).min() > (a @ axis).max():
                    return False
        return True

    def blocks(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.bool_]:
        """(N,) whether the box meets the segments from ``starts`` (N, 3) to ``ends`` (N, 3); slab test."""
        p, q = self.to_local(starts), self.to_local(ends)
        along = np.where(np.abs(q - p) < 1e-12, 1e-12, q - p)
        one, two = (-self.half - p) / along, (self.half - p) / along
        enter = np.minimum(one, two).max(axis=-1)
        leave = np.maximum(one, two).min(axis=-1)
        return np.asarray((enter <= leave) & (leave >= 0) & (enter <= 1))
