"""Floor plans: rectangular rooms that tile one rectangle, their walls, doors and windows.

Plan coordinates are the world's x (east) and z (south) in metres, floor at y = 0. A room is its inner rectangle; the
walls fill what lies between the rooms and round them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Side = Literal["north", "east", "south", "west"]
OpeningKind = Literal["door", "passage", "window", "entrance"]
Array = NDArray[np.float64]

SIDES: tuple[Side, ...] = ("north", "east", "south", "west")
#: Thickness of the walls between rooms (m): a usual partition wall with its plaster.
INNER_WALL = 0.12
#: Height of door openings (m): room for the usual leaf of about 2 m.
DOOR_HEIGHT = 2.05
#: Clockwise neighbours: the wall at a wall's right end (seen from inside), at its left end, and across the room.
RIGHT: dict[Side, Side] = {"north": "east", "east": "south", "south": "west", "west": "north"}
LEFT: dict[Side, Side] = {b: a for a, b in RIGHT.items()}
OPPOSITE: dict[Side, Side] = {"north": "south", "south": "north", "east": "west", "west": "east"}


@dataclass(frozen=True)
class WallFrame:
    """A wall as seen from inside its room.

    A model whose front is +Z and whose back stands at this wall has its own +X along ``u``.

    Attributes:
        side: of the room.
        origin: (3,) lower left corner.
        u: (3,) unit vector to the right.
        normal: (3,) unit vector into the room.
        length: metres.
    """

    side: Side
    origin: Array
    u: Array
    normal: Array
    length: float

    def point(self, along: float, height: float, depth: float = 0.0) -> Array:
        """(3,) world point ``along`` the wall, ``height`` above the floor, ``depth`` in front of the wall."""
        return np.asarray(self.origin + self.u * along + self.normal * depth + np.array([0.0, height, 0.0]))

    def points(self, along: Array, height: float, depth: float) -> Array:
        """(N, 3) world points at several places ``along`` (N,) the wall."""
        return np.asarray(self.point(0.0, height, depth) + along[:, None] * self.u)

    def along(self, start: float, stop: float) -> tuple[float, float]:
        """The interval [start, stop] of the world coordinate that runs along the wall, in wall coordinates."""
        axis = int(np.argmax(np.abs(self.u)))
        a, b = ((value - self.origin[axis]) * self.u[axis] for value in (start, stop))
        return (float(min(a, b)), float(max(a, b)))

    @property
    def yaw(self) -> float:
        """Degrees about +Y that turn a model's front (+Z) into the room."""
        return float(np.degrees(np.arctan2(self.normal[0], self.normal[2])))


@dataclass(frozen=True)
class RoomPlan:
    """The inner rectangle of a room: x0 < x1, z0 < z1, metres."""

    name: str
    x0: float
    z0: float
    x1: float
    z1: float

    @property
    def area(self) -> float:
        """Square metres of floor."""
        return (self.x1 - self.x0) * (self.z1 - self.z0)

    def wall(self, side: Side) -> WallFrame:
        """The room's wall on ``side``."""
        origin, u, normal = {
            "north": ((self.x0, 0, self.z0), (1, 0, 0), (0, 0, 1)),
            "east": ((self.x1, 0, self.z0), (0, 0, 1), (-1, 0, 0)),
            "south": ((self.x1, 0, self.z1), (-1, 0, 0), (0, 0, -1)),
            "west": ((self.x0, 0, self.z1), (0, 0, -1), (1, 0, 0)),
        }[side]
        length = self.x1 - self.x0 if side in ("north", "south") else self.z1 - self.z0
        return WallFrame(side, np.array(origin, float), np.array(u, float), np.array(normal, float), length)


@dataclass(frozen=True)
class WallOpening:
    """A rectangular hole in a wall, or (``entrance``) a closed door leaf on it; lengths in metres.

    ``start`` and ``stop`` are world coordinates along the wall (x on north and south walls, z on the others);
    ``room``/``side`` is the wall of the room that owns the reveal, ``other``/``other_side`` the wall behind it.
    """

    kind: OpeningKind
    room: str
    side: Side
    start: float
    stop: float
    bottom: float
    top: float
    other: str | None = None
    other_side: Side | None = None


@dataclass(frozen=True)
class FloorPlan:
    """Rooms, openings and heights of a flat (metres)."""

    rooms: tuple[RoomPlan, ...]
    openings: tuple[WallOpening, ...]
    height: float

    def room(self, name: str) -> RoomPlan:
        """The room called ``name`` (KeyError if there is none)."""
        return {room.name: room for room in self.rooms}[name]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x0, z0, x1, z1 of the flat inside its outer walls."""
        return (
            min(r.x0 for r in self.rooms),
            min(r.z0 for r in self.rooms),
            max(r.x1 for r in self.rooms),
            max(r.z1 for r in self.rooms),
        )

    def openings_of(self, room: str, side: Side) -> tuple[WallOpening, ...]:
        """The openings in one wall of a room, whichever room owns them."""
        return tuple(
            o for o in self.openings if (o.room, o.side) == (room, side) or (o.other, o.other_side) == (room, side)
        )
