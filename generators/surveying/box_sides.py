"""Moves the sides of a room's rectangle to the walls.

1. Each side goes to the plane in which most of the wall's surface lies nearby (`to_walls`).
2. What stands on a wardrobe or hangs before a wall may reach as high as the wall itself, and the plan then ends there.
   But it does not go on along the whole side as a wall does: a side of which little is a wall is moved outward to the
   plane that is one (`behind_things`).

A rectangle is a (2, 2) array: lowest and highest x and z (m), changed in place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.surveying.cloud import SurfaceCloud, quantiles
from generators.surveying.frame import LEVEL

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: How far a side is moved to a wall at most, and to one of either winding (m).
_SNAP, _SNAP_CELL = 0.3, 0.08
#: Surface this near to a plane lies in it (m).
_THICK = 0.05
#: Length of the pieces of a side in which a wall is or is not (m).
_PIECE = 0.1
#: Share of a side from which on it is certainly a wall, that a plane farther out must have, and how much more it must.
_CERTAIN, _WALL, _MORE = 0.8, 0.6, 0.15
#: How far out a wall is looked for (m): wardrobes are up to 0.7 m deep.
_DEEPEST = 0.8
#: Share of the strip up to there in which the scan has something: the inside of a wall is empty.
_FURNISHED = 0.8


def to_walls(walls: SurfaceCloud, sides: Array) -> None:
    """Move each side to the wall nearby; ``walls``: the surface above most furniture."""
    for end, axis in ((0, 0), (0, 1), (1, 0), (1, 1)):
        values, facing = _across(walls, sides, end, axis)
        area = walls.area[_beside(walls, sides, axis)]
        off = np.abs(values - sides[end, axis])
        # Usually the plan is right to a cell. Farther away, only what faces the room counts, or the next room's
        # side of a thin wall would.
        for own in ((off <= _SNAP_CELL) & (np.abs(facing) >= LEVEL), (off <= _SNAP) & (facing >= LEVEL)):
            plane = _wall_plane(values[own], area[own])
            if plane is not None:
                sides[end, axis] = plane
                break


def behind_things(tops: SurfaceCloud, seen: Mask, origin: Array, cell: float, sides: Array) -> bool:
    """Move the sides that are no walls out to the walls behind; returns whether one was moved.

    Args:
        tops: the surface just below the ceiling.
        seen: (NX, NZ) cells of the plan in which the scan has anything.
        origin: (2,) x and z of its outer corner.
        cell: side of a cell (m).
        sides: (2, 2) of the rectangle.
    """
    moved = False
    for end, axis in ((0, 0), (0, 1), (1, 0), (1, 1)):
        place = _wall_behind(tops, sides, end, axis)
        if place is None:
            continue
        strip = np.sort(np.stack([sides[end], sides[end]]), axis=0)
        strip[:, 1 - axis] = sides[:, 1 - axis]
        strip[:, axis] = sorted((sides[end, axis], place))
        first, last = np.round((strip - origin) / cell).astype(np.int64)
        cells = seen[first[0] : last[0], first[1] : last[1]]
        if cells.size and cells.mean() >= _FURNISHED:
            sides[end, axis] = place
            moved = True
    return moved


def _wall_behind(tops: SurfaceCloud, sides: Array, end: int, axis: int) -> float | None:
    """Where the wall behind a side is; None if the side is a wall, or if there is none behind it."""
    values, facing = _across(tops, sides, end, axis)
    along = tops.points[_beside(tops, sides, axis), 2 - 2 * axis]
    piece = np.floor((along - sides[0, 1 - axis]) / _PIECE).astype(np.int64)
    pieces = max(round(float(sides[1, 1 - axis] - sides[0, 1 - axis]) / _PIECE), 1)
    outward = (sides[end, axis] - values) * (1.0 if end == 0 else -1.0)

    def share(faces: Mask) -> float:
        return len(np.unique(piece[faces])) / pieces

    # Outside, only what faces the room counts, or the next room's side of a thin wall would.
    here = share((np.abs(facing) >= LEVEL) & (np.abs(outward) <= _THICK))
    if here >= _CERTAIN:
        return None
    steps = np.arange(_THICK, _DEEPEST, _THICK / 2)
    planes = [(facing >= LEVEL) & (np.abs(outward - step) <= _THICK) for step in steps]
    best = max(planes, key=share)
    return float(np.median(values[best])) if share(best) >= max(_WALL, here + _MORE) else None


def _beside(cloud: SurfaceCloud, sides: Array, axis: int) -> Mask:
    """(P,) what lies between the other two sides."""
    along = cloud.points[:, 2 - 2 * axis]
    return np.asarray((along >= sides[0, 1 - axis]) & (along <= sides[1, 1 - axis]))


def _across(cloud: SurfaceCloud, sides: Array, end: int, axis: int) -> tuple[Array, Array]:
    """Coordinates across a side of what lies beside it, and how much it faces the room (cosines)."""
    own = _beside(cloud, sides, axis)
    return cloud.points[own, 2 * axis], cloud.normals[own, 2 * axis] * (1.0 if end == 0 else -1.0)


def _wall_plane(values: Array, area: Array, least: float = 0.4) -> float | None:
    """Where along an axis most of the wall's surface lies; None if there is less than ``least`` m² of it."""
    if area.sum() < least:
        return None
    bins = np.floor(values / 0.02).astype(np.int64)
    first = int(bins.min())
    wide = np.convolve(np.bincount(bins - first, weights=area), np.ones(3), mode="same")
    middle = (int(np.argmax(wide)) + first + 0.5) * 0.02
    near = np.abs(values - middle) <= 0.05
    return float(quantiles(values[near], area[near], [0.5])[0])
