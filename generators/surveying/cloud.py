"""Points spread over the surface of a mesh, with their normals and areas: what all of a survey is measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import csgraph

from generators.core.scene import F32
from generators.scans.annotations import spread_over

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Largest number of points on one triangle.
MOST_POINTS = 250_000
#: Voxels along the diagonal of a mesh when its separate pieces are looked for.
_VOXELS = 60
#: A separate piece with less than this share of the area is junk; a larger one may be another room.
JUNK_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class SurfaceCloud:
    """Points on a surface.

    Attributes:
        points: (P, 3) in the unit of the mesh.
        normals: (P, 3) unit normals by the winding of the faces.
        area: (P,) of the surface that each point stands for, square units.
    """

    points: Array
    normals: Array
    area: Array

    @classmethod
    def of(cls, triangles: F32, spacing: float) -> SurfaceCloud:
        """Spread points over (F, 3, 3) triangles, about ``spacing`` apart, at least one on each."""
        corners = triangles.astype(np.float64)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1)
        _, face, points = spread_over(corners, spacing, MOST_POINTS)
        share = length / 2 / np.maximum(np.bincount(face, minlength=len(corners)), 1)
        normals = cross / np.maximum(length, 1e-30)[:, None]
        return cls(points, normals[face], share[face])

    def moved(self, rotation: Array, scale: float = 1.0) -> SurfaceCloud:
        """The cloud after p → rotation · (scale · p)."""
        return SurfaceCloud(self.points @ rotation.T * scale, self.normals @ rotation.T, self.area * scale**2)

    def where(self, keep: Mask) -> SurfaceCloud:
        """The points of a mask (P,)."""
        return SurfaceCloud(self.points[keep], self.normals[keep], self.area[keep])

    def turned_out(self) -> SurfaceCloud:
        """The cloud with its normals the other way round."""
        return SurfaceCloud(self.points, -self.normals, self.area)

    def thinned(self, most: int) -> SurfaceCloud:
        """Every n-th point, so that about ``most`` are left; the areas are not changed."""
        step = max(1, len(self.points) // most)
        return SurfaceCloud(self.points[::step], self.normals[::step], self.area[::step])

    @property
    def diagonal(self) -> float:
        """Of the box that holds all but the outermost hundredth of the area on each side."""
        few = self.thinned(100_000)
        sides = [np.ptp(quantiles(few.points[:, axis], few.area, [0.01, 0.99])) for axis in range(3)]
        return float(np.linalg.norm(sides))


def quantiles(values: Array, weights: Array, shares: ArrayLike) -> Array:
    """The values below which ``shares`` of the weights lie."""
    order = np.argsort(values)
    index = np.searchsorted(np.cumsum(weights[order]), np.asarray(shares, dtype=np.float64) * weights.sum())
    return np.asarray(values[order[np.minimum(index, len(order) - 1)]])


def main_part(cloud: SurfaceCloud) -> Mask:
    """(P,) which points do not belong to floating junk: small pieces with a gap around them.

    Pieces are connected sets of voxels, a 60th of the diagonal wide.
    """
    side = max(cloud.diagonal, 1e-9) / _VOXELS
    keys = np.floor((cloud.points - cloud.points.min(axis=0)) / side).astype(np.int64)
    # A stray vertex may be millions of voxels away.
    keys = np.minimum(keys, 1 << 20)
    codes, owner = np.unique((keys[:, 0] << 42) + (keys[:, 1] << 21) + keys[:, 2], return_inverse=True)
    rows, columns = [], []
    for step in np.ndindex(3, 3, 3):
        if step > (1, 1, 1):
            dx, dy, dz = (number - 1 for number in step)
            wanted = codes + (dx << 42) + (dy << 21) + dz
            at = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
            near = np.flatnonzero(codes[at] == wanted)
            rows.append(near)
            columns.append(at[near])
    links = np.concatenate(rows), np.concatenate(columns)
    graph = sparse.coo_array((np.ones(len(links[0])), links), shape=(len(codes), len(codes)))
    _, piece = csgraph.connected_components(graph, directed=False)
    shares = np.bincount(piece[owner], weights=cloud.area)
    keep = shares >= JUNK_SHARE * shares.sum()
    return np.asarray(keep[piece][owner])
