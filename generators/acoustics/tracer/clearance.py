"""Distance from points to the nearest surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit

F64 = NDArray[np.float64]


def clearance(corners: F64, points: F64, limit: float) -> F64:
    """(L,) distance in m from each of ``points`` (L, 3) to the nearest triangle, at most ``limit``.

    Args:
        corners: (T, 9) first corner and the edges to the two others (`MeshTables.corners`).
        points: metres.
        limit: metres.
    """
    first = corners[:, :3]
    others = np.stack([first, first + corners[:, 3:6], first + corners[:, 6:]], axis=1)
    out = np.empty(len(points))
    _clearance(corners, others.min(axis=1), others.max(axis=1), np.ascontiguousarray(points), limit, out)
    return out


@inline
def _distance2(corners: F64, i: int, x: float, y: float, z: float) -> float:
    """Squared distance from a point to triangle i (C. Ericson, *Real-Time Collision Detection*, 2005, § 5.1.5)."""
    e1x, e1y, e1z = corners[i, 3], corners[i, 4], corners[i, 5]
    e2x, e2y, e2z = corners[i, 6], corners[i, 7], corners[i, 8]
    px, py, pz = x - corners[i, 0], y - corners[i, 1], z - corners[i, 2]
    d1, d2 = e1x * px + e1y * py + e1z * pz, e2x * px + e2y * py + e2z * pz
    aa, ab, bb = (
        e1x * e1x + e1y * e1y + e1z * e1z,
        e1x * e2x + e1y * e2y + e1z * e2z,
        e2x * e2x + e2y * e2y + e2z * e2z,
    )
    d3, d4, d5, d6 = d1 - aa, d2 - ab, d1 - ab, d2 - bb
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s, t = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    rx, ry, rz = px - s * e1x - t * e2x, py - s * e1y - t * e2y, pz - s * e1z - t * e2z
    squared: float = rx * rx + ry * ry + rz * rz
    return squared


@njit
def _clearance(corners: F64, low: F64, high: F64, points: F64, limit: float, out: F64) -> None:
    for j in range(len(points)):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        best = limit * limit
        for i in range(len(corners)):
            dx = max(max(low[i, 0] - x, x - high[i, 0]), 0.0)
            dy = max(max(low[i, 1] - y, y - high[i, 1]), 0.0)
            dz = max(max(low[i, 2] - z, z - high[i, 2]), 0.0)
            if dx * dx + dy * dy + dz * dz < best:
                best = min(best, _distance2(corners, i, x, y, z))
        out[j] = math.sqrt(best)
