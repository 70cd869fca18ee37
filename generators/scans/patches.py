"""Places for objects in a scanned room: floor, tables, worktops, shelves, free wall, by ray casting.

1. Height layers (generators/scans/layers.py); the floor is the lowest level (2 cm bins) that at least 15 % of the grid,
   and half a square metre, sees with half a metre free above it.
2. Tops (generators/scans/tops.py): ``side_table`` below 0.7 m, ``worktop`` to 1.1 m, ``shelf`` above.
3. Walls (generators/scans/walls.py).

How much a rigid surface may wave depends on the scan: it is measured on the floor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.rays import RayCaster
from generators.core.scene import F32, Room, Support
from generators.scans.flatness import flatness
from generators.scans.layers import CELL, Layers, cast_down, find_floor
from generators.scans.tops import FINE, ScanRays, fault, find_patches, find_tops
from generators.scans.walls import find_walls

#: Side of the squares of floor on which its waves are measured (m), and how many are.
_SQUARE, _SQUARES = 0.4, 60
#: What lies this near to a room's box may hide or carry something in it (m).
_NEAR = 1.0


class RefusedTop(NamedTuple):
    """A level surface on which nothing is put: its (4, 3) corners, m, and why."""

    corners: NDArray[np.float64]
    why: str


def find_supports(triangles: F32, room: Room, name: str) -> tuple[float, list[Support]]:
    """The floor's height and all supports of one room.

    Args:
        triangles: (F, 3, 3) the scan's surface.
        room: its box.
        name: for messages.

    Raises:
        Avs3dError: if nothing was scanned in or near the box, or it holds no floor.
    """
    layers, around = _looked_at(triangles, room, name)
    floor = around.floor
    low, high = room.low, room.high
    ground = Support(
        "floor",
        room.name,
        (low[0], round(floor, 4) + 0.0, low[2]),
        (0.0, 0.0, high[2] - low[2]),
        (high[0] - low[0], 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
        high[1] - floor,
    )
    return floor, [ground, *find_tops(layers, around, room), *find_walls(around, room)]


def refused_tops(triangles: F32, room: Room, name: str) -> list[RefusedTop]:
    """The level surfaces of one room on which nothing is put; arguments and errors as of `find_supports`."""
    layers, around = _looked_at(triangles, room, name)
    out = []
    for patch in find_patches(layers, around):
        u, v = patch.size[:, None] * patch.along
        why = fault(patch, around)
        if why:
            out.append(RefusedTop(patch.corner + np.stack([0 * u, u, u + v, v]), why))
    return out


def _looked_at(triangles: F32, room: Room, name: str) -> tuple[Layers, ScanRays]:
    low, high = (np.asarray(corner, dtype=np.float32) for corner in (room.low, room.high))
    near = ((triangles.min(axis=1) <= high + _NEAR) & (triangles.max(axis=1) >= low - _NEAR)).all(axis=1)
    if not near.any():
        raise Avs3dError(f"{name}: nothing was scanned in or near its box; check rooms, scale, up and turn")
    caster = RayCaster(triangles[near])
    layers = cast_down(caster, room)
    return layers, scan_rays(caster, layers, find_floor(layers, name))


def scan_rays(caster: RayCaster, layers: Layers, floor: float) -> ScanRays:
    """Rays, the floor, and the median wave of free squares of it: what the scan itself adds to a rigid surface."""
    around = ScanRays(caster, floor, 0.0)
    free = np.asarray(((np.abs(layers.height - floor) <= 0.03) & (layers.clearance >= 0.5)).any(axis=2))
    side = round(_SQUARE / CELL)
    corners = [
        (i, j)
        for i in range(0, free.shape[0] - side + 1, side)
        for j in range(0, free.shape[1] - side + 1, side)
        if free[i : i + side, j : j + side].mean() > 0.98
    ]
    step = np.arange(FINE / 2, _SQUARE, FINE)
    waves = []
    for i, j in corners[:: max(1, len(corners) // _SQUARES)]:
        points = np.zeros((len(step), len(step), 3))
        points[..., 0] = layers.x[i] - CELL / 2 + step[:, None]
        points[..., 1] = floor + 0.1
        points[..., 2] = layers.z[j] - CELL / 2 + step
        height = 0.1 - around.distance(points, np.array([0.0, -1.0, 0.0]))
        waves.append(flatness(height, np.abs(height) <= 0.06, FINE).wave)
    return ScanRays(caster, floor, float(np.median(waves)) if waves else 0.0)
