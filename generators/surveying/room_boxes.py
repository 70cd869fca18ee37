"""The rooms of a flat as boxes, found on a plan of its walls.

1. Plan. On a 5 cm grid, a cell is a wall where upright surface lies in the band just below the ceiling: furniture does
   not reach it, and above doors there is a lintel, so that closed and open doors alike separate rooms there. A cell is
   inside where the floor or the ceiling lies below or above it.
2. Rooms. The inside without the walls is eroded, so that narrow passages break; each connected rest is a room and gets
   back the cells that are nearest to it.
3. Boxes. A room that fills most of its bounding rectangle has this one, an L-shaped one the largest rectangle in it.
   Each side is then moved to the wall (box_sides.py).

Coordinates are metres, Y up, walls parallel to the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.scans.layers import largest_rectangle
from generators.surveying.box_sides import behind_things, to_walls
from generators.surveying.cloud import SurfaceCloud, quantiles
from generators.surveying.frame import LEVEL, Levels

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Side of a cell of the plan (m).
CELL = 0.05
#: Band of walls below the ceiling (m): its upper and lower edge.
WALL_BAND = (0.06, 0.40)
#: Surface this near to the height of the floor or the ceiling belongs to it (m).
_NEAR = 0.15
#: Gaps in walls and in the inside that are closed (m): holes of a scan.
_GAP = 0.4
#: Longer side of a lamp at most, and of a lintel over a door or passage; what is longer without a wall is a beam (m).
_LAMP, WIDEST_LINTEL = 0.8, 2.4
#: What stands or hangs below a beam and is not as long makes no wall of it (m): pillars, clothes.
_PILLAR = 0.4
#: Radii of erosion (m): passages up to twice as wide break. The first is usual; the others are tried for a number of
#: rooms that the user names.
NECKS = (0.5, 0.4, 0.6, 0.3, 0.75, 0.9, 0.2, 1.1)
#: Smallest room: its shorter side (m) and its floor (m²).
NARROWEST, SMALLEST = 1.2, 2.0
#: Share of its plan in which a room has floor or furniture, up to this height (m). What was only seen through a door
#: has less (0.63 and 0.67 in two scans; twelve rooms have at least 0.91).
_SEEN, _REACH = 0.8, 1.6
#: A room with at least this share of its bounding rectangle is a rectangle.
_FULL = 0.9
_MARGIN = 0.5


@dataclass(frozen=True, eq=False)
class WallPlan:
    """The plan of a flat; the first axis of the masks is x, the second z.

    Attributes:
        origin: (2,) x and z of the outer corner of cell [0, 0].
        walls: (NX, NZ) wall cells.
        inside: (NX, NZ) cells under a ceiling or over a floor.
        seen: (NX, NZ) cells in which the scan has anything below `_REACH`.
    """

    origin: Array
    walls: Mask
    inside: Mask
    seen: Mask


@dataclass(frozen=True)
class RoomBox:
    """A room: the lowest and highest corner of its inside, and whether it is a part of a larger, angular one."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    part: bool = False

    @property
    def area(self) -> float:
        """Of its floor, m²."""
        return (self.high[0] - self.low[0]) * (self.high[2] - self.low[2])


def draw_plan(cloud: SurfaceCloud, levels: Levels) -> WallPlan:
    """The plan of a flat on ``levels.floor``."""
    points = cloud.points
    own = (points[:, 1] >= levels.floor - 0.5) & (points[:, 1] <= levels.ceiling + 0.5)
    low, high = points[own][:, [0, 2]].min(axis=0) - _MARGIN, points[own][:, [0, 2]].max(axis=0) + _MARGIN
    shape = tuple(int(n) for n in np.ceil((high - low) / CELL))

    def cells(mask: Mask) -> Mask:
        """The cells that hold points of a mask."""
        out = np.zeros(shape, dtype=bool)
        at = np.floor((points[mask][:, [0, 2]] - low) / CELL).astype(np.int64)
        out[at[:, 0], at[:, 1]] = True
        return out

    level = np.abs(cloud.normals[:, 1]) >= LEVEL
    below = levels.ceiling - points[:, 1]
    walls = cells(~level & (below >= WALL_BAND[0]) & (below <= WALL_BAND[1]))
    floor = cells(level & (np.abs(points[:, 1] - levels.floor) <= _NEAR))
    inside = floor | cells(level & (np.abs(below) <= _NEAR)) if levels.has_ceiling else floor | cells(own)
    reach = round(_GAP / CELL)
    for line in (np.ones((reach, 1), dtype=bool), np.ones((1, reach), dtype=bool)):
        walls |= _along(walls, line)
    walls = _without_lamps_and_beams(walls, cells(~level & (np.abs(points[:, 1] - levels.floor - 1.5) <= 0.3)))
    inside = ndimage.binary_closing(np.pad(inside, reach), iterations=reach // 2)[reach:-reach, reach:-reach]
    seen = cells((points[:, 1] >= levels.floor - _REACH) & (points[:, 1] <= levels.floor + _REACH))
    seen = ndimage.binary_closing(seen, np.ones((3, 3), dtype=bool))
    return WallPlan(low, walls, ndimage.binary_fill_holes(inside), seen)


def _along(walls: Mask, line: Mask) -> Mask:
    """Gaps in straight pieces of wall: closed along ``line`` where the wall goes on for 30 cm on both sides."""
    size = max(line.shape)
    straight = ndimage.binary_opening(walls, np.ones([min(n, 6) for n in line.shape], dtype=bool))
    pad = [(size, size), (size, size)]
    closed: Mask = ndimage.binary_closing(np.pad(straight, pad), line)[size:-size, size:-size]
    return closed


def _without_lamps_and_beams(walls: Mask, below: Mask) -> Mask:
    """The walls without what hangs from the ceiling: small things, and long ones with nothing ``below`` them."""
    around = np.ones((3, 3), dtype=bool)
    out = _where_size(walls, around, lambda side: side >= _LAMP)
    below = ndimage.binary_dilation(_where_size(below, around, lambda side: side >= _PILLAR), around, iterations=2)
    hanging = out & ~below
    return out & ~_where_size(hanging, around, lambda side: side > WIDEST_LINTEL)


def _where_size(mask: Mask, around: Mask, keep: Callable[[float], bool]) -> Mask:
    """The connected pieces of a mask whose longer side (m) is to be kept."""
    pieces, _ = ndimage.label(mask, around)
    sides = [max(s.stop - s.start for s in box) * CELL for box in ndimage.find_objects(pieces)]
    return np.array([False, *(keep(side) for side in sides)])[pieces]


def find_boxes(cloud: SurfaceCloud, levels: Levels, plan: WallPlan, wanted: int | None = None) -> tuple[RoomBox, ...]:
    """The rooms, the largest first.

    Args:
        cloud: of the surface.
        levels: floor and ceiling.
        plan: of the walls.
        wanted: so many rooms; None: as many as there seem to be.
    """
    found: tuple[RoomBox, ...] = ()
    for neck in NECKS if wanted else NECKS[:1]:
        boxes = _boxes(cloud, levels, plan, neck)
        if wanted is None or len(boxes) == wanted:
            return boxes
        if len(boxes) > len(found):
            found = boxes
    return found[:wanted]


def _boxes(cloud: SurfaceCloud, levels: Levels, plan: WallPlan, neck: float) -> tuple[RoomBox, ...]:
    out = []
    for region in _regions(plan, neck):
        box = _rectangle(region)
        if box is None:
            continue
        (first, last), part = box
        low, high = plan.origin + np.array(first) * CELL, plan.origin + np.array(last) * CELL
        own = plan.seen[first[0] : last[0], first[1] : last[1]]
        out.append((_snapped(cloud, levels, plan, low, high, part), float(own.mean())))
    good = [pair for pair in out if min(pair[0].high[k] - pair[0].low[k] for k in (0, 2)) >= NARROWEST]
    good = sorted((pair for pair in good if pair[0].area >= SMALLEST), key=lambda pair: (-pair[0].area, pair[0].low))
    return tuple(box for number, (box, seen) in enumerate(good) if number == 0 or seen >= _SEEN)


def _regions(plan: WallPlan, neck: float) -> list[Mask]:
    """The cells of each room."""
    free = plan.inside & ~plan.walls
    distance = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * CELL
    cores, count = ndimage.label(distance > neck)
    if not count:
        return []
    away, nearest = ndimage.distance_transform_edt(cores == 0, return_indices=True)
    owner = np.where(free & (away * CELL <= 1.5 * neck), cores[tuple(nearest)], 0)
    regions = []
    for number in range(1, count + 1):
        pieces, _ = ndimage.label(owner == number)
        own = pieces[cores == number]
        regions.append(ndimage.binary_fill_holes(np.isin(pieces, np.unique(own[own > 0]))))
    return regions


def _rectangle(region: Mask) -> tuple[tuple[tuple[int, int], tuple[int, int]], bool] | None:
    """First and last (exclusive) cell of the rectangle of a room, and whether it leaves out a part of it."""
    # Narrow bulges (a doorway's reveal, a niche) do not make a room wider.
    smooth = ndimage.binary_opening(region, np.ones((13, 13), dtype=bool))
    if not smooth.any():
        return None
    x, z = np.flatnonzero(smooth.any(axis=1)), np.flatnonzero(smooth.any(axis=0))
    first, last = (int(x[0]), int(z[0])), (int(x[-1]) + 1, int(z[-1]) + 1)
    share = smooth.sum() / ((last[0] - first[0]) * (last[1] - first[1]))
    if share >= _FULL:
        return (first, last), False
    # Pillars and cupboards up to the ceiling leave dents, which the largest rectangle would keep away from.
    dented = ndimage.binary_closing(np.pad(smooth, 12), np.ones((13, 13), dtype=bool))[12:-12, 12:-12]
    row, column, rows, columns = largest_rectangle(dented)
    return ((row, column), (row + rows, column + columns)), True


def _snapped(cloud: SurfaceCloud, levels: Levels, plan: WallPlan, low: Array, high: Array, part: bool) -> RoomBox:
    """The rectangle (x, z) with its sides moved to the walls, from the floor to the ceiling that it has."""
    sides = np.array([low, high])
    below = levels.ceiling - cloud.points[:, 1]
    walls = cloud.where((cloud.points[:, 1] >= levels.floor + 1.2) & (below >= 0))
    tops = cloud.where((below >= WALL_BAND[0]) & (below <= WALL_BAND[1]))
    to_walls(walls, sides)
    # A side that is moved makes others longer, and they may be no wall then.
    for _ in range(3):
        if not behind_things(tops, plan.seen, plan.origin, CELL, sides):
            break
        to_walls(walls, sides)
    return _between(cloud, levels, sides.tolist(), part)


def _between(cloud: SurfaceCloud, levels: Levels, sides: Sequence[Sequence[float]], part: bool) -> RoomBox:
    """The box over a rectangle: up to the level surface that is the ceiling there, or to where its walls end."""
    (x0, z0), (x1, z1) = sides
    points = cloud.points
    own = (points[:, 0] > x0) & (points[:, 0] < x1) & (points[:, 2] > z0) & (points[:, 2] < z1)
    own &= (np.abs(cloud.normals[:, 1]) >= LEVEL) & (np.abs(points[:, 1] - levels.ceiling) <= 0.8)
    own &= points[:, 1] > levels.floor + 1.9
    top = levels.ceiling
    if levels.has_ceiling and cloud.area[own].sum() > 0.3 * (x1 - x0) * (z1 - z0):
        top = float(quantiles(points[own, 1], cloud.area[own], [0.5])[0])
    low = (round(x0, 3) + 0.0, round(levels.floor, 3) + 0.0, round(z0, 3) + 0.0)
    return RoomBox(low, (round(x1, 3) + 0.0, round(top, 3) + 0.0, round(z1, 3) + 0.0), part)
