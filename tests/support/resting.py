"""Gaps between a placed object and the surface that it stands or hangs on, by rays through both."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.core.rays import RayCaster
from generators.core.scene import Mesh

Array = NDArray[np.float64]


def gaps_below(mesh: Mesh, room: RayCaster, away: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> tuple[Array, Array]:
    """Gap between an object and the room, at every point of a 5 mm grid at which the object is near its support.

    Args:
        mesh: the object in world coordinates.
        room: rays on the room without it.
        away: unit vector from the support to the object.

    Returns:
        gap (K,) metres, negative where the object cuts in; and the height (K,) of the object's surface there above its
        lowest point along ``away``. Points over holes are left out.
    """
    up = np.asarray(away, dtype=np.float64)
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.5 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(up, side)])
    points = mesh.positions.reshape(-1, 3).astype(np.float64)
    lowest = float((points @ up).min())
    plan = points[points @ up <= lowest + 0.02] @ frame.T
    a, b = (np.arange(p + 0.0005, q, 0.005) for p, q in zip(plan.min(axis=0), plan.max(axis=0), strict=True))
    grid = np.stack([g.reshape(-1) for g in np.meshgrid(a, b, indexing="ij")], axis=1) @ frame
    ways = np.broadcast_to(up, grid.shape)
    reach, _ = RayCaster(mesh.positions).closest(grid + (lowest - 0.2) * up, ways)
    under = lowest - 0.2 + np.minimum(reach.astype(np.float64), 1e3)
    reach, _ = room.closest(grid + (lowest + 0.08) * up, -ways)
    surface = lowest + 0.08 - np.minimum(reach.astype(np.float64), 1e3)
    near = (under <= lowest + 0.02) & (surface >= lowest - 0.05)
    return (under - surface)[near], under[near] - lowest
