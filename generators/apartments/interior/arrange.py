"""Where a piece of furniture may stand: candidate spots along walls, collisions, clearances.

A room's `Arranger` keeps the pieces placed so far and the volumes that must stay free: before doors, windows and the
fronts of cupboards.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.apartments.floorplan import SIDES, FloorPlan, RoomPlan, Side, WallFrame, WallOpening
from generators.apartments.interior.pieces import FLAT, TOUCH, Placed, WallSpot, overlaps, world_box
from generators.assets.furniture import Furniture, build_furniture
from generators.assets.materials import Palette
from generators.core.scene import Part

Array = NDArray[np.float64]

#: Gap between floor furniture and the wall (m): the skirting boards are 0.014 m thick.
WALL_GAP = 0.02
#: Width kept free on both sides of a window (m): with a casing, its sill is 0.11 m wider than the opening on each side.
WINDOW_SIDE = 0.12
#: Height kept free below a window (m): the sill is 0.03 m thick.
_SILL = 0.04
#: Depth kept free before a window (m): furniture that is higher than the sill would cover a part of it.
_WINDOW_DEPTH = 0.4
#: Width kept free on both sides of a door (m): its casing is 0.07 m wide.
_DOOR_SIDE = 0.09
#: Height of the volume kept free before a door (m): `floorplan.DOOR_HEIGHT` and a little of the casing above.
_DOORWAY_TOP = 2.1
#: Depth kept free before a door or the entrance (m): about the width of a leaf.
_DOOR_DEPTH = 0.85
#: Depth kept free before a passage (m): it has no leaf, so this only lets people through.
_PASSAGE_DEPTH = 0.75
#: Gap between a piece in a corner and the wall beside it (m).
_CORNER_GAP = 0.003
#: Distance between the places that are tried along a wall (m), at most.
_SPACING = 0.05
#: Resolution at which a wall is searched for free stretches (m).
_CELL = 0.01
#: Half the width of the box that tests one such cell (m); less than half a cell, so that a touch does not count.
_PROBE = 0.004
#: Upper limit of the random number that is added to a place's score, unless a rule names another. Scores are mostly
#: distances in metres, so this chooses among places that are about 0.3 m worse than the best.
JITTER = 0.3
#: How an option of a kind of furniture is given: its name and value.
Options = dict[str, object]


@dataclass(frozen=True)
class Where:
    """Where at the walls of a room a piece may stand; lengths in metres.

    Attributes:
        sides: the walls to try.
        height: of its origin above the floor.
        gap: between its back and the wall; None: `WALL_GAP`, or nothing for what hangs on the wall.
        front: depth that must be free before it as well.
        margin: free width on its left and right.
        windows: whether it must leave windows free.
        turn: degrees; 90 puts its right side at the wall in place of its back.
        top: the wall above it must be free up to this height.
    """

    sides: Sequence[Side] = SIDES
    height: float = 0.0
    gap: float | None = None
    front: float = 0.0
    margin: float = 0.0
    windows: bool = True
    turn: float = 0.0
    top: float = 0.0


ANYWHERE = Where()


class Arranger:
    """One room while it is being furnished.

    Attributes:
        placed: the furniture placed so far.
        memory: results of rules for the empty room; all attempts share it.
        doorways: the room's doors, passages and entrance with the world boxes that are kept free before them.
        extras: further parts that are no furniture (tiles on a wall).
    """

    def __init__(self, plan: FloorPlan, room: RoomPlan, palette: Palette, seed: int, rng: Generator) -> None:
        """``seed`` (of the flat) decides the furniture's shapes, ``rng`` the places."""
        self.plan, self.room, self.palette, self.rng = plan, room, palette, rng
        self.seed = seed
        self.placed: list[Placed] = []
        self.extras: list[Part] = []
        self.memory: dict[object, object] = {}
        self._models: dict[tuple[str, int, str], Furniture] = {}
        self.doorways: list[tuple[WallOpening, Array, Array]] = []
        self._panes: list[tuple[Array, Array]] = []
        for side in SIDES:
            wall = room.wall(side)
            for opening in plan.openings_of(room.name, side):
                a, b = wall.along(opening.start, opening.stop)
                if opening.kind == "window":
                    span = (a - WINDOW_SIDE, b + WINDOW_SIDE)
                    self._panes.append(self.volume(wall, span, (opening.bottom - _SILL, opening.top), _WINDOW_DEPTH))
                else:
                    span = (a - _DOOR_SIDE, b + _DOOR_SIDE)
                    depth = _PASSAGE_DEPTH if opening.kind == "passage" else _DOOR_DEPTH
                    self.doorways.append((opening, *self.volume(wall, span, (FLAT, _DOORWAY_TOP), depth)))
        self._zones = [(low, high) for _, low, high in self.doorways]

    # -- building ----------------------------------------------------------------------------------------------------

    def model(self, kind: str, copy: int = 0, /, **options: object) -> Furniture:
        """The room's piece number ``copy`` of a kind; the same call gives the same piece."""
        key = (kind, copy, repr(sorted(options.items())))
        if key not in self._models:
            rng = np.random.default_rng([self.seed, zlib.crc32(kind.encode()), copy])
            self._models[key] = build_furniture(kind, self.palette, rng, **options)
        return self._models[key]

    def restart(self, rng: Generator) -> Arranger:
        """The same room, empty, with the same pieces to choose from and other random choices."""
        other = Arranger(self.plan, self.room, self.palette, self.seed, rng)
        other._models, other.memory = self._models, self.memory
        return other

    def snapshot(self) -> tuple[int, int]:
        """A mark to which `revert` can return."""
        return len(self.placed), len(self._zones)

    def revert(self, mark: tuple[int, int]) -> None:
        """Take away everything placed and reserved since ``mark``."""
        del self.placed[mark[0] :]
        del self._zones[mark[1] :]

    # -- volumes -----------------------------------------------------------------------------------------------------

    def volume(
        self, wall: WallFrame, along: tuple[float, float], height: tuple[float, float], depth: float
    ) -> tuple[Array, Array]:
        """World box before a wall."""
        p, q = wall.point(along[0], height[0]), wall.point(along[1], height[1], depth)
        return np.minimum(p, q), np.maximum(p, q)

    def reserve(self, low: Array, high: Array) -> None:
        """Keep a world box free of later furniture (flat things may lie in it)."""
        self._zones.append((low, high))

    def free(
        self,
        low: Array,
        high: Array,
        *,
        windows: bool = True,
        zones: bool = True,
        ignore: Sequence[Placed] = (),
    ) -> NDArray[np.bool_]:
        """(K,): which of K boxes lie in the room and overlap nothing.

        Args:
            low: (K, 3) lowest corners.
            high: (K, 3) highest corners.
            windows: whether they must leave the windows free.
            zones: whether they must leave the reserved volumes free.
            ignore: pieces that they may overlap (a chair pushed under its table).
        """
        r = self.room
        inner = (low[:, 0] > r.x0 - TOUCH) & (high[:, 0] < r.x1 + TOUCH)
        inner &= (low[:, 2] > r.z0 - TOUCH) & (high[:, 2] < r.z1 + TOUCH)
        inner &= (low[:, 1] > -TOUCH) & (high[:, 1] < self.plan.height + TOUCH)
        boxes = [box for p in self.placed if not p.flat and p not in ignore for box in p.boxes]
        boxes += (self._zones if zones else []) + (self._panes if windows else [])
        if boxes:
            lows, highs = np.array([b[0] for b in boxes]), np.array([b[1] for b in boxes])
            inner &= ~overlaps(low, high, lows, highs).any(axis=1)
        return inner

    # -- spots -------------------------------------------------------------------------------------------------------

    def spots(self, furniture: Furniture, where: Where = ANYWHERE) -> list[WallSpot]:
        """Free places of a piece with its back at a wall."""
        gap, margin, turn = where.gap, where.margin, where.turn
        if gap is None:
            gap = 0.0 if furniture.mount == "wall" else WALL_GAP
        low, high = world_box(furniture, np.zeros(3), turn)
        out: list[WallSpot] = []
        for side in where.sides:
            wall = self.room.wall(side)
            first, last = -low[0] + _CORNER_GAP + margin, wall.length - high[0] - _CORNER_GAP - margin
            if last < first:
                continue
            count = max(2, int((last - first) / _SPACING) + 1)
            alongs = np.linspace(first, last, count)
            positions = wall.points(alongs, where.height, gap - low[2])
            ends = [
                wall.points(alongs + low[0] - margin, where.height + low[1], gap),
                wall.points(alongs + high[0] + margin, where.height + high[1], gap + high[2] - low[2]),
            ]
            lows, highs = np.minimum(*ends), np.maximum(*ends)
            highs[:, 1] = np.maximum(highs[:, 1], where.top)
            ok = self.free(lows, highs, windows=where.windows)
            if where.front > 0:
                reach = [
                    lows + np.minimum(wall.normal * where.front, 0),
                    highs + np.maximum(wall.normal * where.front, 0),
                ]
                reach[0][:, 1] = np.maximum(reach[0][:, 1], FLAT)
                ok &= self._front_free(reach[0], reach[1])
            yaw = wall.yaw + turn
            box = world_box(furniture, np.zeros(3), yaw)
            for k in np.flatnonzero(ok):
                at = positions[k]
                out.append(WallSpot(wall, float(alongs[k]), at, yaw, box[0] + at, box[1] + at))
        return out

    def _front_free(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """Like `free`, but overlaps with reserved volumes are allowed: people walk through both."""
        r = self.room
        inner = (low[:, 0] > r.x0 - TOUCH) & (high[:, 0] < r.x1 + TOUCH)
        inner &= (low[:, 2] > r.z0 - TOUCH) & (high[:, 2] < r.z1 + TOUCH)
        solid = [box for p in self.placed if not p.flat for box in p.boxes]
        if solid:
            inner &= ~overlaps(low, high, np.array([b[0] for b in solid]), np.array([b[1] for b in solid])).any(axis=1)
        return inner

    def put(self, furniture: Furniture, spot: WallSpot, *, front: float = 0.0) -> Placed:
        """Place a piece at a spot and keep ``front`` metres before it free."""
        piece = Placed(furniture, spot.position, spot.yaw, spot.low, spot.high)
        self.placed.append(piece)
        if front > 0:
            low = spot.low + np.minimum(spot.wall.normal * front, 0)
            high = spot.high + np.maximum(spot.wall.normal * front, 0)
            low[1] = max(low[1], FLAT)
            self.reserve(low, high)
        return piece

    def place(
        self,
        kind: str,
        *,
        where: Where = ANYWHERE,
        score: Callable[[WallSpot], float] | None = None,
        copy: int = 0,
        jitter: float = JITTER,
        options: Options | None = None,
    ) -> tuple[Placed, WallSpot] | None:
        """Put a kind at its best free spot (highest ``score`` plus noise of size ``jitter``), if there is any."""
        furniture = self.model(kind, copy, **(options or {}))
        found = self.spots(furniture, where)
        if not found:
            return None
        noise = self.rng.uniform(0, jitter, len(found)) if jitter else np.zeros(len(found))
        values = [(score(spot) if score else 0.0) + n for spot, n in zip(found, noise, strict=True)]
        spot = found[int(np.argmax(values))]
        return self.put(furniture, spot, front=where.front), spot

    def place_free(
        self,
        furniture: Furniture,
        centre: Sequence[float] | Array,
        yaw: float,
        *,
        height: float = 0.0,
        windows: bool = True,
        zones: bool = True,
        ignore: Sequence[Placed] = (),
    ) -> Placed | None:
        """Place a piece with its origin at ``centre`` (x, z), if it fits; rugs need only lie in the room."""
        position = np.array([centre[0], height, centre[1]], dtype=np.float64)
        low, high = world_box(furniture, position, yaw)
        piece = Placed(furniture, position, yaw, low, high)
        if piece.flat:
            r = self.room
            ok = low[0] > r.x0 and high[0] < r.x1 and low[2] > r.z0 and high[2] < r.z1
        else:
            ok = bool(self.free(low[None], high[None], windows=windows, zones=zones, ignore=ignore)[0])
        if not ok:
            return None
        self.placed.append(piece)
        return piece

    def stretches(
        self, wall: WallFrame, height: tuple[float, float], depth: float, *, windows: bool = True
    ) -> list[tuple[float, float]]:
        """Free intervals of a wall for things of that height range and depth, in steps of 1 cm."""
        steps = np.arange(_CELL / 2, wall.length, _CELL)
        ends = [
            wall.points(steps - _PROBE, height[0], 0.0),
            wall.points(steps + _PROBE, height[1], depth),
        ]
        ok = self.free(np.minimum(*ends), np.maximum(*ends), windows=windows)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ok.astype(np.int8), [0]])))
        return [(round(a * _CELL, 2), round(min(b * _CELL, wall.length), 2)) for a, b in edges.reshape(-1, 2)]
