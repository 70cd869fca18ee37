"""Measured directions on the sphere: what solid angle each stands for, and interpolation between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from avs3d_bench.errors import Avs3dError

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Largest hole between the directions (degrees from its centre to its edge). Sets that leave out what is below the
#: listener have up to 60.
LARGEST_HOLE = 75.0
#: Barycentric weights this far below 0 are rounding.
_INSIDE = -1e-9


@dataclass(frozen=True, eq=False)
class SphereMesh:
    """Triangles between directions: the faces of their convex hull (Delaunay's triangulation of the sphere).

    Attributes:
        points: (M, 3) unit vectors.
        triangles: (F, 3) indices of points.
    """

    points: F64
    triangles: I64

    @classmethod
    def of(cls, points: F64, where: object) -> SphereMesh:
        """Triangulate ``points``.

        Raises:
            Avs3dError: if they leave too large a hole for interpolation; ``where`` is the file they come from.
        """
        need = f"expected directions all around, without holes of more than {LARGEST_HOLE:g}° radius"
        if len(points) < 4:
            raise Avs3dError(f"{where}: has {len(points)} directions; {need}")
        try:
            hull = ConvexHull(points)
        except QhullError:
            raise Avs3dError(f"{where}: its {len(points)} directions lie in one plane; {need}") from None
        # A face at distance d from the centre spans a cap of radius arccos d.
        hole = math.degrees(math.acos(float(np.clip(-hull.equations[:, 3].max(), -1.0, 1.0))))
        if hole > LARGEST_HOLE:
            raise Avs3dError(f"{where}: its directions leave a hole of {hole:.0f}° radius; {need}")
        return cls(points, np.asarray(hull.simplices, dtype=np.int64))

    def solid_angles(self) -> F64:
        """(M,) sr of the sphere that each point stands for: a third of each triangle that it belongs to.

        A. van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983) 125–126.
        """
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
        cosines = 1 + sum(np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
        angles = 2 * np.arctan2(volume, cosines)
        return np.asarray(
            np.bincount(self.triangles.ravel(), np.repeat(angles / 3, 3), len(self.points)), dtype=np.float64
        )

    def interpolation(self, directions: F64) -> tuple[I64, F64]:
        """Points (n, 3) and barycentric weights (n, 3), which add up to 1, for unit vectors (n, 3)."""
        inverses: F64 = np.asarray(np.linalg.inv(self.points[self.triangles].transpose(0, 2, 1)))
        corners = np.zeros((len(directions), 3), dtype=np.int64)
        weights = np.zeros((len(directions), 3))
        incident = _incident(self.triangles, len(self.points))
        nearest = np.asarray(cKDTree(self.points).query(directions)[1])
        for i, (direction, point) in enumerate(zip(directions, nearest, strict=True)):
            face, w = _best(inverses, incident[point], direction)
            if w.min() < _INSIDE:
                # The triangle need not touch the nearest point.
                face, w = _best(inverses, np.arange(len(inverses)), direction)
            corners[i] = self.triangles[face]
            weights[i] = np.maximum(w, 0.0)
        return corners, weights / weights.sum(axis=1, keepdims=True)


def _incident(triangles: I64, count: int) -> list[I64]:
    """Triangles at each point."""
    faces = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(triangles.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(triangles.ravel(), minlength=count))
    return np.split(faces[order], ends[:-1])


def _best(inverses: F64, faces: I64, direction: F64) -> tuple[int, F64]:
    """The triangle out of ``faces`` in which the direction lies, or lies least far outside, and its weights."""
    found = inverses[faces] @ direction
    # Of a triangle on the other side all weights are negative.
    best = int(found.min(axis=1).argmax())
    return int(faces[best]), found[best]
