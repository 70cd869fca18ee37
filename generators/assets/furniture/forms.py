"""Plain geometry of the furniture kit: chamfered boxes, grids, outlines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _chamfered_cube() -> tuple[Array, Array, NDArray[np.int64], Array]:
    """Topology of a box with chamfered edges: signs (24, 3), in-face mask (24, 3), faces (44, 3), normals (24, 3).

    Each corner has one vertex per adjacent face, and that face's normal; the chamfers between them so shade as
    rounded edges at 44 triangles a box.
    """
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    signs = np.array([c for c in corners for _ in range(3)])
    axes = np.tile(np.arange(3), 8)
    inset = np.ones((24, 3))
    inset[np.arange(24), axes] = 0.0
    normals = np.zeros((24, 3))
    normals[np.arange(24), axes] = signs[np.arange(24), axes]
    at = {(c, a): 3 * k + a for k, c in enumerate(corners) for a in range(3)}
    polygons: list[list[int]] = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for s in (-1.0, 1.0):
            loop = []
            for p, q in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
                corner = [0.0, 0.0, 0.0]
                corner[a], corner[b], corner[c] = s, p, q
                loop.append(at[(corner[0], corner[1], corner[2]), a])
            polygons.append(loop)
            for t in (-1.0, 1.0):
                lo, hi = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
                lo[a], lo[b], lo[c] = s, t, -1.0
                hi[a], hi[b], hi[c] = s, t, 1.0
                low, high = (lo[0], lo[1], lo[2]), (hi[0], hi[1], hi[2])
                polygons.append([at[low, a], at[low, b], at[high, b], at[high, a]])
    polygons += [[at[c, 0], at[c, 1], at[c, 2]] for c in corners]
    place = signs - 0.3 * signs * inset
    faces = []
    for polygon in polygons:
        corner3 = place[polygon]
        turned = np.cross(corner3[1] - corner3[0], corner3[2] - corner3[0]) @ corner3.mean(axis=0) < 0
        loop = polygon[::-1] if turned else polygon
        faces += [[loop[0], loop[k], loop[k + 1]] for k in range(1, len(loop) - 1)]
    return signs, inset, np.array(faces), normals


#: The parts of `_chamfered_cube`.
SIGNS, INSET, CHAMFER_FACES, CHAMFER_NORMALS = _chamfered_cube()


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """(F, 3) triangles of a grid of rows × columns vertices in row-major order."""
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij"))
    a, b, c, d = i * columns + j, i * columns + j + 1, (i + 1) * columns + j + 1, (i + 1) * columns + j
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def outward(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """The faces of a closed solid, turned so that its signed volume is positive."""
    p = vertices[faces] - vertices.mean(axis=0)
    volume = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum()
    return faces if volume > 0 else faces[:, ::-1]


def rounded_rectangle(width: float, depth: float, radius: float, *, per_corner: int = 6) -> Array:
    """(4·per_corner, 2) outline (x, z) about the origin, counter-clockwise seen with z downwards on paper."""
    r = min(radius, 0.499 * width, 0.499 * depth)
    angle = np.linspace(0, np.pi / 2, per_corner)
    points = []
    for k, (sx, sz) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        t = angle + k * np.pi / 2
        points.append(np.stack([sx * (width / 2 - r) + r * np.cos(t), sz * (depth / 2 - r) + r * np.sin(t)], axis=1))
    return np.concatenate(points)
