"""The edges of a mesh at which sound is diffracted: convex wedges and the rims of sheets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.geometry import AcousticMesh
from generators.acoustics.tracer.clearance import clearance

F64 = NDArray[np.float64]

#: Shortest edge that diffracts (m): a quarter of the wavelength at 170 Hz.
LEAST_LENGTH = 0.5
#: Least angle (radians) by which an edge stands out; flatter ones are what a curved surface was cut into.
_LEAST_BEND = 0.35
#: A rim is one only if nothing touches it; distance (m) within which a surface does.
_TOUCHES = 1e-3


@dataclass(frozen=True, eq=False)
class Edges:
    """Straight edges with the wedge of air round each of them.

    Attributes:
        start: (E, 3) one end, metres.
        along: (E, 3) unit vector to the other end.
        length: (E,) metres.
        face: (E, 3) unit vector from the edge into its first face: angle 0 of the wedge.
        side: (E, 3) unit vector across ``along`` and ``face``: angle 90° of the wedge.
        opening: (E,) angle of the air from face to face (radians), above π.
    """

    start: F64
    along: F64
    length: F64
    face: F64
    side: F64
    opening: F64

    def __len__(self) -> int:
        """Number of edges."""
        return len(self.length)

    def cylindrical(self, point: F64) -> tuple[F64, F64, F64]:
        """Distance from each edge's line, angle in [0, 2π) from its first face and place along it of a point (3,)."""
        offset = point - self.start
        x, y = np.einsum("ij,ij->i", offset, self.face), np.einsum("ij,ij->i", offset, self.side)
        return np.hypot(x, y), np.mod(np.arctan2(y, x), 2 * np.pi), np.einsum("ij,ij->i", offset, self.along)


def edges_of(mesh: AcousticMesh) -> Edges:
    """The diffracting edges of ``mesh``: of two faces, from the outside; of one face, if nothing else touches it.

    The air is taken to be on the side where the angle between the faces exceeds 180°: in a corner of a room, which
    diffracts nothing, it is outside of the room, where neither source nor listener are.
    """
    faces = np.concatenate([np.zeros((0, 3), dtype=np.int64), *mesh.groups.values()])
    corners = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    third = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    long = np.linalg.norm(mesh.vertices[corners[:, 0]] - mesh.vertices[corners[:, 1]], axis=1) >= LEAST_LENGTH
    corners, third = np.sort(corners[long], axis=1), third[long]
    ends, first, index, count = np.unique(corners, axis=0, return_index=True, return_inverse=True, return_counts=True)
    order = np.argsort(index.reshape(-1), kind="stable")
    last = order[np.cumsum(count) - 1] if len(order) else first
    start, along = mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]

    def into(which: NDArray[np.int64]) -> F64:
        offset = mesh.vertices[third[which]] - start
        offset = offset - np.einsum("ij,ij->i", offset, along)[:, None] * along
        return np.asarray(offset / np.linalg.norm(offset, axis=1)[:, None])

    face, other = into(first), into(last)
    side = np.cross(along, face)
    angle = np.mod(np.arctan2(np.einsum("ij,ij->i", other, side), np.einsum("ij,ij->i", other, face)), 2 * np.pi)
    # The air is on the side of the greater angle.
    side = np.where((angle < np.pi)[:, None], -side, side)
    opening = np.where(count == 1, 2 * np.pi, np.where(angle < np.pi, 2 * np.pi - angle, angle))
    wedge = (count == 2) & (opening - np.pi > _LEAST_BEND)
    rim = np.flatnonzero(count == 1)
    # Just outside of the rim: where meshes are cut without common vertices, the surface goes on there.
    outside = start[rim] + (length[rim] / 2)[:, None] * along[rim] - 2 * _TOUCHES * face[rim]
    triangles = mesh.triangles
    table = np.concatenate([triangles[:, :1], triangles[:, 1:] - triangles[:, :1]], axis=1).reshape(-1, 9)
    free = clearance(table, outside, 4 * _TOUCHES) > 2 * _TOUCHES - 1e-6
    keep = np.concatenate([np.flatnonzero(wedge), rim[free]])
    keep.sort()
    return Edges(start[keep], along[keep], length[keep], face[keep], side[keep], opening[keep])
