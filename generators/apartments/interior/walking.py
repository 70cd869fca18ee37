"""Free space that a furnished room keeps: floor to walk on, places at walls for further things."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.apartments.floorplan import SIDES
from generators.apartments.interior.arrange import WALL_GAP, Arranger
from generators.apartments.interior.pieces import FLAT

Array = NDArray[np.float64]

#: Radius of the agent, a cylinder (m).
AGENT_RADIUS = 0.2
#: Furniture whose lower edge is above this height (m) is no obstacle: the agent's sensor is 1.5 m above the floor.
OVERHEAD = 1.75
#: Size of a cell of the floor's grid (m).
CELL = 0.05
#: A door counts as reached where the agent's middle comes this much nearer to it (m) than it must be to stand there.
_DOOR_SLACK = 0.12
#: Distance between the places that are tried along a wall, and gap between the outermost and the wall's ends (m).
_SPACING, _END_GAP = 0.05, 0.01


class Size(NamedTuple):
    """Width, depth and height of a box (m), as seen from the front."""

    width: float
    depth: float
    height: float


@dataclass(frozen=True)
class FloorDemand:
    """Free floor that a furnished room must keep.

    Attributes:
        area: floor that the agent's middle must be able to reach, without a way blocked between two doors (m²).
        rectangle: sides of a rectangle that must be free in one piece (m): ways along the furniture do not make one.
    """

    area: float
    rectangle: tuple[float, float]

    def met(self, a: Arranger) -> bool:
        """Whether the room keeps both."""
        return walkable(a) >= self.area and free_rectangle(a, *self.rectangle)


def occupancy(a: Arranger) -> NDArray[np.bool_]:
    """(X, Z) whether something that the agent would touch stands on, or hangs above, each cell of the floor."""
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
    """Floor that the agent's middle can reach (m²), or 0 if it cannot get from each door to all others."""
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
                at = wall.point((start + stop) / 2, 0.0, AGENT_RADIUS + _DOOR_SLACK)
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


def wall_spots(a: Arranger, size: Size, apart: float) -> int:
    """How many boxes of that size still fit at the walls, their middles at least ``apart`` metres from each other."""
    width, depth, height = size
    found: list[Array] = []
    for side in SIDES:
        wall = a.room.wall(side)
        alongs = np.arange(width / 2 + _END_GAP, wall.length - width / 2 - _END_GAP, _SPACING)
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
