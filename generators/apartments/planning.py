"""Generates floor plans: layouts of rooms, doors between them, windows in the outer walls, from a seed.

Four layouts, mirrored and transposed, with free proportions, give flats of 55–110 m² in which every room but the hall
has a window and every room can be reached from the hall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import DOOR_HEIGHT, INNER_WALL, SIDES, FloorPlan, RoomPlan, Side, WallOpening

#: Distance of doors from a room's corners (m), at least, so that casing (0.07 m) and skirting fit.
CORNER_MARGIN = 0.14
#: Widths of doors (m): the opening of a usual leaf of 0.86 m and a little more.
_DOOR_WIDTHS = (0.87, 0.95)
#: Doors are at most this much further from a corner than `CORNER_MARGIN` (m).
_DOOR_SLACK = 0.1
#: Rooms share a wall if it is longer than this (m), and if the gap between them differs from `INNER_WALL` by less (m).
_LEAST_SHARED, _WALL_TOLERANCE = 0.5, 2e-3
#: Widths and height of the passage between kitchen and living room, and its distance from the corners (m).
_PASSAGE_WIDTHS, _PASSAGE_HEIGHT, _PASSAGE_MARGIN = (1.25, 1.7), 2.2, 0.25
#: Width of the entrance (m).
_ENTRANCE_WIDTH = 0.95
#: Heights of rooms (m): usual in flats.
_ROOM_HEIGHTS = (2.5, 2.75)
#: Height of the upper edge of windows above the floor, and its distance from the ceiling (m): at most and at least.
_WINDOW_TOP, _LINTEL = 2.3, 0.25
#: Distance of windows from a room's corners (m), at least: curtains hang beside them.
_WINDOW_MARGIN = 0.34
#: Share of a wall's length at which the middle of a window is.
_WINDOW_SHARE = (0.42, 0.58)
#: Tolerance in comparing coordinates (m).
_SAME = 1e-6


class _WindowSize(NamedTuple):
    """A kind of window; lengths in metres.

    Attributes:
        widths: range of its width.
        bottom: height of its lower edge above the floor.
        wall: length of wall that must remain beside it, in all.
        aside: whether it is at that end of its wall at which the opposite wall has its doors: the other end stays free.
    """

    widths: tuple[float, float]
    bottom: float
    wall: float = 0.0
    aside: bool = False


#: Height of the parapet below windows of living rooms and bedrooms (m): a radiator (0.70 m) fits below it.
_PARAPET = 0.88
#: Windows of each room: the first on an outer wall that is chosen at random, the second on another. The kitchen's is
#: above the worktop (0.90 m), the bathroom's above the tub.
_WINDOW_SIZES = {
    "living_room": (_WindowSize((1.9, 2.5), _PARAPET, wall=1.6), _WindowSize((0.9, 1.15), _PARAPET, aside=True)),
    "kitchen": (_WindowSize((1.1, 1.4), 1.08),),
    "bathroom": (_WindowSize((0.7, 0.9), 1.2),),
    "bedroom": (_WindowSize((1.3, 1.7), _PARAPET),),
    "hall": (),
}


@dataclass(frozen=True)
class _Cell:
    """A room with half the thickness of its inner walls: the cells tile the rectangle of the flat; metres."""

    name: str
    x0: float
    z0: float
    x1: float
    z1: float


# In the layouts, each size is drawn from a range in metres, in a fixed order. The ranges keep rooms large enough for
# their furniture and for the benchmark's objects: without the walls, at least 2.8 m × 3.1 m for a bathroom,
# 3.0 m × 3.4 m for a kitchen and 4.2 m × 4.8 m for a living room.


def _between(rng: Generator, low: float, high: float) -> float:
    """A length between two others (m), in whole centimetres."""
    return round(float(rng.uniform(low, high)), 2)


def _corridor(rng: Generator) -> list[_Cell]:
    """Living room and kitchen on one side of a corridor, bathroom and bedroom on the other."""
    living, kitchen = _between(rng, 4.75, 5.5), _between(rng, 3.45, 3.95)  # widths
    bath = _between(rng, 3.2, 3.6)  # width
    deep, hall, shallow = _between(rng, 4.95, 5.3), _between(rng, 1.5, 1.75), _between(rng, 3.4, 3.7)  # depths
    width, z1, z2, z3 = living + kitchen, deep, deep + hall, deep + hall + shallow
    return [
        _Cell("living_room", 0, 0, living, z1),
        _Cell("kitchen", living, 0, width, z1),
        _Cell("hall", 0, z1, width, z2),
        _Cell("bathroom", 0, z2, bath, z3),
        _Cell("bedroom", bath, z2, width, z3),
    ]


def _two_columns(rng: Generator) -> list[_Cell]:
    """Living room above bedroom; kitchen, hall and bathroom beside them."""
    left, right = _between(rng, 4.75, 5.4), _between(rng, 3.5, 3.9)  # widths
    kitchen, hall, bath = _between(rng, 3.7, 3.9), _between(rng, 2.78, 2.95), _between(rng, 3.2, 3.4)  # depths
    depth = kitchen + hall + bath
    living = kitchen + hall / 2
    return [
        _Cell("living_room", 0, 0, left, living),
        _Cell("bedroom", 0, living, left, depth),
        _Cell("kitchen", left, 0, left + right, kitchen),
        _Cell("hall", left, kitchen, left + right, kitchen + hall),
        _Cell("bathroom", left, kitchen + hall, left + right, depth),
    ]


def _compact(rng: Generator) -> list[_Cell]:
    """Living room above hall; kitchen above bathroom."""
    left, right = _between(rng, 4.75, 5.3), _between(rng, 3.45, 3.9)  # widths
    living, hall = _between(rng, 4.95, 5.5), _between(rng, 1.7, 2.0)  # depths
    depth = living + hall
    kitchen = _between(rng, 3.65, depth - 3.0)  # depth; leaves 3 m to the bathroom
    return [
        _Cell("living_room", 0, 0, left, living),
        _Cell("hall", 0, living, left, depth),
        _Cell("kitchen", left, 0, left + right, kitchen),
        _Cell("bathroom", left, kitchen, left + right, depth),
    ]


def _two_rows(rng: Generator) -> list[_Cell]:
    """Kitchen and living room above bathroom, hall and bedroom."""
    kitchen, living = _between(rng, 3.5, 4.0), _between(rng, 5.1, 5.7)  # widths
    bath, hall = _between(rng, 3.15, 3.4), _between(rng, 2.1, 2.4)  # widths
    deep, shallow = _between(rng, 4.95, 5.4), _between(rng, 3.4, 3.8)  # depths
    width, depth = kitchen + living, deep + shallow
    return [
        _Cell("kitchen", 0, 0, kitchen, deep),
        _Cell("living_room", kitchen, 0, width, deep),
        _Cell("bathroom", 0, deep, bath, depth),
        _Cell("hall", bath, deep, bath + hall, depth),
        _Cell("bedroom", bath + hall, deep, width, depth),
    ]


#: One layout per seed, in turn.
LAYOUTS = (_corridor, _two_columns, _compact, _two_rows)


def _inner(cells: list[_Cell]) -> tuple[RoomPlan, ...]:
    """Cells less half a wall wherever another cell lies behind."""
    x1, z1 = max(c.x1 for c in cells), max(c.z1 for c in cells)
    half = INNER_WALL / 2

    def inset(value: float, edge: float, direction: int) -> float:
        return round(value if abs(value - edge) < _SAME else value + direction * half, 3)

    return tuple(
        RoomPlan(c.name, inset(c.x0, 0, 1), inset(c.z0, 0, 1), inset(c.x1, x1, -1), inset(c.z1, z1, -1)) for c in cells
    )


def _turned(rooms: tuple[RoomPlan, ...], rng: Generator) -> tuple[RoomPlan, ...]:
    """The rooms mirrored in x, mirrored in z and transposed, each with a probability of one half."""
    mirror_x, mirror_z, transpose = (bool(rng.integers(2)) for _ in range(3))
    x1, z1 = max(r.x1 for r in rooms), max(r.z1 for r in rooms)
    out = []
    for r in rooms:
        room = r
        if mirror_x:
            room = replace(room, x0=round(x1 - room.x1, 3), x1=round(x1 - room.x0, 3))
        if mirror_z:
            room = replace(room, z0=round(z1 - room.z1, 3), z1=round(z1 - room.z0, 3))
        if transpose:
            room = replace(room, x0=room.z0, z0=room.x0, x1=room.z1, z1=room.x1)
        out.append(room)
    return tuple(out)


def _shared(a: RoomPlan, b: RoomPlan) -> tuple[Side, Side, float, float] | None:
    """Where two rooms share a wall: side of a, side of b, interval along it."""
    for side, other, gap in (
        ("east", "west", b.x0 - a.x1),
        ("west", "east", a.x0 - b.x1),
        ("south", "north", b.z0 - a.z1),
        ("north", "south", a.z0 - b.z1),
    ):
        if abs(gap - INNER_WALL) < _WALL_TOLERANCE:
            upright = side in ("east", "west")
            low = max(a.z0, b.z0) if upright else max(a.x0, b.x0)
            high = min(a.z1, b.z1) if upright else min(a.x1, b.x1)
            if high - low > _LEAST_SHARED:
                return side, other, low, high  # type: ignore[return-value]
    return None


#: Which rooms a door joins, in this order, wherever they share a wall.
_DOORS = (
    ("hall", "living_room"),
    ("hall", "kitchen"),
    ("hall", "bathroom"),
    ("hall", "bedroom"),
)


def _doors(rooms: tuple[RoomPlan, ...], rng: Generator) -> list[WallOpening]:
    """Doors from the hall to every room beside it, and a wide passage between kitchen and living room."""
    named = {room.name: room for room in rooms}
    out = []
    for first, second in _DOORS:
        if first not in named or second not in named:
            continue
        shared = _shared(named[first], named[second])
        if shared is None:
            continue
        side, other_side, low, high = shared
        width = _between(rng, *_DOOR_WIDTHS)
        low, high = low + CORNER_MARGIN, high - CORNER_MARGIN
        if high - low < width:
            continue
        # Near a corner, so that the walls keep long free stretches.
        slack = min(_DOOR_SLACK, high - low - width)
        offset = _between(rng, 0.0, slack)
        start = low + offset if rng.integers(2) else high - width - offset
        out.append(WallOpening("door", first, side, start, start + width, 0.0, DOOR_HEIGHT, second, other_side))
    shared = _shared(named["kitchen"], named["living_room"])
    if shared is not None:
        side, other_side, low, high = shared
        width = _between(rng, *_PASSAGE_WIDTHS)
        low, high = low + _PASSAGE_MARGIN, high - _PASSAGE_MARGIN
        start = low if rng.integers(2) else high - width
        stop = start + width
        out.append(
            WallOpening("passage", "kitchen", side, start, stop, 0.0, _PASSAGE_HEIGHT, "living_room", other_side)
        )
    return out


def _outer_sides(room: RoomPlan, bounds: tuple[float, float, float, float]) -> list[Side]:
    x0, z0, x1, z1 = bounds
    test: dict[Side, bool] = {
        "north": abs(room.z0 - z0) < _SAME,
        "east": abs(room.x1 - x1) < _SAME,
        "south": abs(room.z1 - z1) < _SAME,
        "west": abs(room.x0 - x0) < _SAME,
    }
    return [side for side in SIDES if test[side]]


def _window(room: RoomPlan, side: Side, width: float, bottom: float, top: float, share: float) -> WallOpening:
    """A window whose centre lies at ``share`` of the wall's length."""
    upright = side in ("east", "west")
    low, high = (room.z0, room.z1) if upright else (room.x0, room.x1)
    centre = low + share * (high - low)
    start = float(np.clip(centre - width / 2, low + _WINDOW_MARGIN, high - _WINDOW_MARGIN - width))
    return WallOpening("window", room.name, side, start, start + width, bottom, top)


def _open_end(room: RoomPlan, side: Side, doors: list[WallOpening]) -> float:
    """0 or 1: the end of a wall at which the opposite wall has its doors; a window there leaves the other end free."""
    opposite = {"north": "south", "south": "north", "east": "west", "west": "east"}[side]
    low, high = (room.z0, room.z1) if side in ("east", "west") else (room.x0, room.x1)
    middles = [
        (o.start + o.stop) / 2
        for o in doors
        if (o.room, o.side) == (room.name, opposite) or (o.other, o.other_side) == (room.name, opposite)
    ]
    return float(bool(middles) and sum(middles) / len(middles) > (low + high) / 2)


def _windows(rooms: tuple[RoomPlan, ...], height: float, doors: list[WallOpening], rng: Generator) -> list[WallOpening]:
    """Windows on outer walls, by `_WINDOW_SIZES`."""
    bounds = FloorPlan(rooms, (), height).bounds
    out: list[WallOpening] = []
    head = round(min(height - _LINTEL, _WINDOW_TOP), 2)
    for room in rooms:
        sides, sizes = _outer_sides(room, bounds), _WINDOW_SIZES[room.name]
        order = [sides[i] for i in rng.permutation(len(sides))]
        for rank, side in enumerate(order):
            share = _between(rng, *_WINDOW_SHARE)
            if rank >= len(sizes):
                continue
            size = sizes[rank]
            width = min(_between(rng, *size.widths), room.wall(side).length - size.wall)
            if size.aside:
                share = _open_end(room, side, doors)
            out.append(_window(room, side, width, size.bottom, head, share))
    return out


def _entrance(rooms: tuple[RoomPlan, ...], openings: list[WallOpening], rng: Generator) -> list[WallOpening]:
    """The flat's entrance: a closed leaf on the hall's shortest outer wall that is long enough."""
    bounds = FloorPlan(rooms, (), 0.0).bounds
    hall = next(room for room in rooms if room.name == "hall")
    for side in sorted(_outer_sides(hall, bounds), key=lambda s: hall.wall(s).length):
        upright = side in ("east", "west")
        low, high = (hall.z0, hall.z1) if upright else (hall.x0, hall.x1)
        if high - low >= _ENTRANCE_WIDTH + 2 * CORNER_MARGIN:
            start = (low + high - _ENTRANCE_WIDTH) / 2
            return [WallOpening("entrance", "hall", side, start, start + _ENTRANCE_WIDTH, 0.0, DOOR_HEIGHT)]
    return []


def make_floor_plan(seed: int, rng: Generator) -> FloorPlan:
    """A flat's plan; consecutive seeds take different layouts, ``rng`` decides everything else."""
    rooms = _turned(_inner(LAYOUTS[seed % len(LAYOUTS)](rng)), rng)
    height = _between(rng, *_ROOM_HEIGHTS)
    doors = _doors(rooms, rng)
    openings = [*doors, *_windows(rooms, height, doors, rng)]
    return FloorPlan(rooms, (*openings, *_entrance(rooms, openings, rng)), height)
