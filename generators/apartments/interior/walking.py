"""What a furnished room leaves free: floor to walk on, walls for further things."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.apartments.floorplan import SIDES
from generators.apartments.interior.arrange import WALL_GAP, Arranger
from generators.apartments.interior.pieces import FLAT

Array = NDArray[np.float64]

#: The agent is a cylinder of this radius whose sensor is 1.5 m high; what hangs above this height is no obstacle.
AGENT_RADIUS = 0.2
OVERHEAD = 1.75
CELL = 0.05


def occupancy(a: Arranger) -> NDArray[np.bool_]:
    """(X, Z) bool at 5 cm: floor cells under something that a walker would touch."""
    r = a.room
    shape = (int((r.x1 - r.x0) / CELL), int((r.z1 - r.z0) / CELL))
    x = r.x0 + (np.arange(shape[0]) + 0.5) * CELL
    z = r.z0 + (np.arange(shape[1]) + 0.5) * CELL
    taken = np.zeros(shape, dtype=bool)
    for piece in a.placed:
        if piece.flat:
            continue
        for low, high in piece.boxes:
            if low[1] <= OVERHEAD:
                taken |= ((x > low[0]) & (x < high[0]))[:, None] & ((z > low[2]) & (z < high[2]))[None]
    return taken


def walkable(a: Arranger) -> float:
    """Square metres that the agent's centre can reach, or 0 if it cannot get from each door to all others."""
    r = a.room
    # Walls are obstacles too: a rim of taken cells, open at the doors.
    taken = np.pad(occupancy(a), 1, constant_values=True)
    clear = ndimage.distance_transform_edt(~taken) * CELL >= AGENT_RADIUS + CELL / 2
    labels, _ = ndimage.label(clear)
    doors = []
    for side in SIDES:
        wall = r.wall(side)
        for opening in a.plan.openings_of(r.name, side):
            if opening.kind in ("door", "passage"):
                start, stop = wall.along(opening.start, opening.stop)
                at = wall.point((start + stop) / 2, 0.0, AGENT_RADIUS + 0.12)
                doors.append(int(labels[int((at[0] - r.x0) / CELL) + 1, int((at[2] - r.z0) / CELL) + 1]))
    if not doors or min(doors) == 0 or len(set(doors)) > 1:
        return 0.0
    return float((labels == doors[0]).sum()) * CELL**2


def free_rectangle(a: Arranger, width: float, depth: float) -> bool:
    """Whether a rectangle of floor of that size, either way round, is free."""
    taken = occupancy(a)
    total = np.pad(np.cumsum(np.cumsum(taken, axis=0), axis=1), ((1, 0), (1, 0)))
    for x, z in ((width, depth), (depth, width)):
        m, n = int(np.ceil(x / CELL)), int(np.ceil(z / CELL))
        if m > taken.shape[0] or n > taken.shape[1]:
            continue
        window = total[m:, n:] - total[:-m, n:] - total[m:, :-n] + total[:-m, :-n]
        if (window == 0).any():
            return True
    return False


def wall_spots(a: Arranger, width: float, depth: float, height: float, apart: float) -> int:
    """How many boxes of that size still fit at the walls, their middles ``apart`` metres or more."""
    found: list[Array] = []
    for side in SIDES:
        wall = a.room.wall(side)
        alongs = np.arange(width / 2 + 0.01, wall.length - width / 2 - 0.01, 0.05)
        if not len(alongs):
            continue
        ends = [
            wall.points(alongs - width / 2, FLAT, WALL_GAP),
            wall.points(alongs + width / 2, height, WALL_GAP + depth),
        ]
        for k in np.flatnonzero(a.free(np.minimum(*ends), np.maximum(*ends))):
            at = wall.point(alongs[k], 0.0, depth / 2)
            if all(np.linalg.norm(at - other) >= apart for other in found):
                found.append(at)
    return len(found)
