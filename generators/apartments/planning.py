"""Draws up floor plans: layouts of rooms, doors between them, windows in the outer walls, from a seed.

Four layouts, mirrored and transposed, with free proportions, give flats of 55–110 m² in which every room but the hall
meets daylight and every room can be reached from the hall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import DOOR_HEIGHT, INNER_WALL, SIDES, FloorPlan, Opening, RoomPlan, Side

#: Door and window openings keep this far from a room's corners, so that frames and skirting fit.
CORNER_MARGIN = 0.14


@dataclass(frozen=True)
class _Cell:
    """A room with half of its inner walls: what tiles the rectangle."""

    name: str
    x0: float
    z0: float
    x1: float
    z1: float


def _between(rng: Generator, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 2)


def _corridor(rng: Generator) -> list[_Cell]:
    """Living room and kitchen on one side of a corridor, bathroom and bedroom on the other."""
    living, kitchen = _between(rng, 4.75, 5.5), _between(rng, 3.45, 3.95)
    bath, deep, hall, shallow = (
        _between(rng, 3.2, 3.6),
        _between(rng, 4.95, 5.3),
        _between(rng, 1.5, 1.75),
        _between(rng, 3.4, 3.7),
    )
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
    left, right = _between(rng, 4.75, 5.4), _between(rng, 3.5, 3.9)
    kitchen, hall, bath = _between(rng, 3.7, 3.9), _between(rng, 2.78, 2.95), _between(rng, 3.2, 3.4)
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
    left, right = _between(rng, 4.75, 5.3), _between(rng, 3.45, 3.9)
    living, hall = _between(rng, 4.95, 5.5), _between(rng, 1.7, 2.0)
    depth = living + hall
    kitchen = _between(rng, 3.65, depth - 3.0)
    return [
        _Cell("living_room", 0, 0, left, living),
        _Cell("hall", 0, living, left, depth),
        _Cell("kitchen", left, 0, left + right, kitchen),
        _Cell("bathroom", left, kitchen, left + right, depth),
    ]


def _two_rows(rng: Generator) -> list[_Cell]:
    """Kitchen and living room above bathroom, hall and bedroom."""
    kitchen, living = _between(rng, 3.5, 4.0), _between(rng, 5.1, 5.7)
    bath, hall = _between(rng, 3.15, 3.4), _between(rng, 2.1, 2.4)
    deep, shallow = _between(rng, 4.95, 5.4), _between(rng, 3.4, 3.8)
    width, depth = kitchen + living, deep + shallow
    return [
        _Cell("kitchen", 0, 0, kitchen, deep),
        _Cell("living_room", kitchen, 0, width, deep),
        _Cell("bathroom", 0, deep, bath, depth),
        _Cell("hall", bath, deep, bath + hall, depth),
        _Cell("bedroom", bath + hall, deep, width, depth),
    ]


LAYOUTS = (_corridor, _two_columns, _compact, _two_rows)


def _inner(cells: list[_Cell]) -> tuple[RoomPlan, ...]:
    """Cells less half a wall wherever another cell lies behind."""
    x1, z1 = max(c.x1 for c in cells), max(c.z1 for c in cells)
    half = INNER_WALL / 2

    def inset(value: float, edge: float, direction: int) -> float:
        return round(value if abs(value - edge) < 1e-6 else value + direction * half, 3)

    return tuple(
        RoomPlan(c.name, inset(c.x0, 0, 1), inset(c.z0, 0, 1), inset(c.x1, x1, -1), inset(c.z1, z1, -1)) for c in cells
    )


def _turned(rooms: tuple[RoomPlan, ...], rng: Generator) -> tuple[RoomPlan, ...]:
    """Mirror in x and z and transpose, each by a coin."""
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
    near = INNER_WALL + 1e-3
    for side, other, gap in (
        ("east", "west", b.x0 - a.x1),
        ("west", "east", a.x0 - b.x1),
        ("south", "north", b.z0 - a.z1),
        ("north", "south", a.z0 - b.z1),
    ):
        if abs(gap - INNER_WALL) < near - INNER_WALL + 1e-3:
            upright = side in ("east", "west")
            low = max(a.z0, b.z0) if upright else max(a.x0, b.x0)
            high = min(a.z1, b.z1) if upright else min(a.x1, b.x1)
            if high - low > 0.5:
                return side, other, low, high  # type: ignore[return-value]
    return None


#: Which rooms a door joins, in this order, wherever they share a wall.
_DOORS = (
    ("hall", "living_room"),
    ("hall", "kitchen"),
    ("hall", "bathroom"),
    ("hall", "bedroom"),
)


def _doors(rooms: tuple[RoomPlan, ...], rng: Generator) -> list[Opening]:
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
        width = _between(rng, 0.87, 0.95)
        low, high = low + CORNER_MARGIN, high - CORNER_MARGIN
        if high - low < width:
            continue
        # Near a corner, so that the walls keep long free stretches.
        slack = min(0.1, high - low - width)
        offset = _between(rng, 0.0, slack)
        start = low + offset if rng.integers(2) else high - width - offset
        out.append(Opening("door", first, side, start, start + width, 0.0, DOOR_HEIGHT, second, other_side))
    shared = _shared(named["kitchen"], named["living_room"])
    if shared is not None:
        side, other_side, low, high = shared
        width = _between(rng, 1.25, 1.7)
        low, high = low + 0.25, high - 0.25
        start = low if rng.integers(2) else high - width
        out.append(Opening("passage", "kitchen", side, start, start + width, 0.0, 2.2, "living_room", other_side))
    return out


def _outer_sides(room: RoomPlan, bounds: tuple[float, float, float, float]) -> list[Side]:
    x0, z0, x1, z1 = bounds
    test: dict[Side, bool] = {
        "north": abs(room.z0 - z0) < 1e-6,
        "east": abs(room.x1 - x1) < 1e-6,
        "south": abs(room.z1 - z1) < 1e-6,
        "west": abs(room.x0 - x0) < 1e-6,
    }
    return [side for side in SIDES if test[side]]


def _window(room: RoomPlan, side: Side, width: float, bottom: float, top: float, share: float) -> Opening:
    """A window whose centre lies at ``share`` of the wall's length."""
    upright = side in ("east", "west")
    low, high = (room.z0, room.z1) if upright else (room.x0, room.x1)
    centre = low + share * (high - low)
    start = float(np.clip(centre - width / 2, low + 0.34, high - 0.34 - width))
    return Opening("window", room.name, side, start, start + width, bottom, top)


def _open_end(room: RoomPlan, side: Side, doors: list[Opening]) -> float:
    """0 or 1: the end of a wall at which the opposite wall has its doors; a window there leaves the other end free."""
    opposite = {"north": "south", "south": "north", "east": "west", "west": "east"}[side]
    low, high = (room.z0, room.z1) if side in ("east", "west") else (room.x0, room.x1)
    middles = [
        (o.start + o.stop) / 2
        for o in doors
        if (o.room, o.side) == (room.name, opposite) or (o.other, o.other_side) == (room.name, opposite)
    ]
    return float(bool(middles) and sum(middles) / len(middles) > (low + high) / 2)


def _windows(rooms: tuple[RoomPlan, ...], height: float, doors: list[Opening], rng: Generator) -> list[Opening]:
    """Windows on outer walls: wide in the living room, above the worktop in the kitchen, small in the bathroom."""
    bounds = FloorPlan(rooms, (), height).bounds
    out: list[Opening] = []
    head = round(min(height - 0.25, 2.3), 2)
    for room in rooms:
        sides = _outer_sides(room, bounds)
        order = [sides[i] for i in rng.permutation(len(sides))]
        for rank, side in enumerate(order):
            length = room.wall(side).length
            share = _between(rng, 0.42, 0.58)
            if room.name == "living_room":
                if rank == 0:
                    width, bottom = min(_between(rng, 1.9, 2.5), length - 1.6), 0.88
                elif rank == 1:
                    width, bottom = _between(rng, 0.9, 1.15), 0.88
                    share = _open_end(room, side, doors)
                else:
                    continue
            elif room.name == "kitchen":
                if rank > 0:
                    continue
                width, bottom = _between(rng, 1.1, 1.4), 1.08
            elif room.name == "bathroom":
                if rank > 0:
                    continue
                width, bottom = _between(rng, 0.7, 0.9), 1.2
            elif room.name == "hall":
                continue
            else:
                if rank > 0:
                    continue
                width, bottom = _between(rng, 1.3, 1.7), 0.88
            out.append(_window(room, side, width, bottom, head, share))
    return out


def _entrance(rooms: tuple[RoomPlan, ...], openings: list[Opening], rng: Generator) -> list[Opening]:
    """The flat's entrance: a closed leaf on the hall's shortest outer wall that has room for it."""
    bounds = FloorPlan(rooms, (), 0.0).bounds
    hall = next(room for room in rooms if room.name == "hall")
    for side in sorted(_outer_sides(hall, bounds), key=lambda s: hall.wall(s).length):
        upright = side in ("east", "west")
        low, high = (hall.z0, hall.z1) if upright else (hall.x0, hall.x1)
        if high - low >= 0.95 + 2 * CORNER_MARGIN:
            start = (low + high - 0.95) / 2
            return [Opening("entrance", "hall", side, start, start + 0.95, 0.0, DOOR_HEIGHT)]
    return []


def make_floor_plan(seed: int, rng: Generator) -> FloorPlan:
    """A flat's plan; consecutive seeds take different layouts, ``rng`` decides everything else."""
    rooms = _turned(_inner(LAYOUTS[seed % len(LAYOUTS)](rng)), rng)
    height = _between(rng, 2.5, 2.75)
    doors = _doors(rooms, rng)
    openings = [*doors, *_windows(rooms, height, doors, rng)]
    return FloorPlan(rooms, (*openings, *_entrance(rooms, openings, rng)), height)
