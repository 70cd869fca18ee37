"""Where a piece of furniture may stand: candidate spots along walls, collisions, door clearances, walkability.

Furniture stands at yaws of 90° (or slightly off), so axis-aligned world boxes describe it. A room's `Arranger` keeps
what stands already and the volumes to be left free: in front of doors, before windows, before cupboard doors.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from generators.assets.furniture import Furniture, build_furniture
from generators.assets.materials import Palette
from generators.assets.shapes import rotation
from generators.scenes.floorplan import SIDES, FloorPlan, RoomPlan, Side, WallFrame
from generators.scenes.scene import Part

Array = NDArray[np.float64]

#: Things lower than this are lain or stood upon (rugs, mats).
FLAT = 0.04
#: Floor furniture keeps clear of the skirting boards.
WALL_GAP = 0.02
#: The agent is a cylinder of this radius whose sensor is 1.5 m high; what hangs above this height is no obstacle.
AGENT_RADIUS = 0.2
OVERHEAD = 1.75
CELL = 0.05
_TOUCH = 2e-3


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece of furniture in its place: turned by ``yaw`` degrees, its origin at ``position`` (3,); ``low`` and
    ``high`` (3,) bound it in the world."""

    furniture: Furniture
    position: Array
    yaw: float
    low: Array
    high: Array

    @property
    def flat(self) -> bool:
        """Whether other things may stand on it (a rug)."""
        return self.furniture.mount == "floor" and bool(self.high[1] <= FLAT)


@dataclass(frozen=True, eq=False)
class Spot:
    """A candidate place at a wall: the middle of the piece is ``along`` the wall."""

    wall: WallFrame
    along: float
    position: Array
    yaw: float
    low: Array
    high: Array

    @property
    def corner(self) -> float:
        """Metres between the piece and the nearer end of its wall."""
        a, b = self.extent
        return max(0.0, min(a, self.wall.length - b))

    @property
    def extent(self) -> tuple[float, float]:
        """The interval of the wall that the piece covers."""
        axis = int(np.argmax(np.abs(self.wall.u)))
        return self.wall.along(self.low[axis], self.high[axis])

    @property
    def centre(self) -> Array:
        """(3,) middle of its box."""
        return (self.low + self.high) / 2


def world_box(furniture: Furniture, position: Array, yaw: float) -> tuple[Array, Array]:
    """Axis-aligned world bounds of a turned piece."""
    low, high = furniture.mesh.bounds.astype(np.float64)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    moved = corners @ rotation("y", yaw).T + position
    return moved.min(axis=0), moved.max(axis=0)


def overlaps(low: Array, high: Array, lows: Array, highs: Array) -> NDArray[np.bool_]:
    """(K, N): which of K boxes meet which of N boxes by more than a touch."""
    inside = (low[:, None] < highs[None] - _TOUCH) & (high[:, None] > lows[None] + _TOUCH)
    return np.asarray(inside.all(axis=2))


class Arranger:
    """One room while it is being furnished.

    Attributes:
        placed: what stands in it so far.
        memory: what rules have worked out about the empty room; all attempts share it.
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
        self._zones: list[tuple[Array, Array]] = []
        self._panes: list[tuple[Array, Array]] = []
        for side in SIDES:
            wall = room.wall(side)
            for opening in plan.openings_of(room.name, side):
                a, b = wall.along(opening.start, opening.stop)
                if opening.kind == "window":
                    self._panes.append(self.volume(wall, (a - 0.12, b + 0.12), (opening.bottom - 0.04, opening.top), 0.4))
                else:
                    depth = 0.75 if opening.kind == "passage" else 0.85
                    self._zones.append(self.volume(wall, (a - 0.09, b + 0.09), (FLAT, 2.1), depth))

    # -- building ----------------------------------------------------------------------------------------------------

    def model(self, kind: str, copy: int = 0, **options: object) -> Furniture:
        """The room's piece number ``copy`` of a kind; the same call gives the same piece."""
        key = (kind, copy, repr(sorted(options.items())))
        if key not in self._models:
            rng = np.random.default_rng([self.seed, zlib.crc32(kind.encode()), copy])
            self._models[key] = build_furniture(kind, self.palette, rng, **options)
        return self._models[key]

    def restart(self, rng: Generator) -> Arranger:
        """The same room, empty, with the same pieces at hand and other random choices."""
        other = Arranger(self.plan, self.room, self.palette, self.seed, rng)
        other._models, other.memory = self._models, self.memory
        return other

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
        """(K,): which of K boxes lie in the room and meet nothing.

        Args:
            low: (K, 3) lowest corners.
            high: (K, 3) highest corners.
            windows: whether they must leave the windows free.
            zones: whether they must leave the reserved volumes free.
            ignore: pieces that they may meet (a chair drawn up to its table).
        """
        r = self.room
        inner = (low[:, 0] > r.x0 - _TOUCH) & (high[:, 0] < r.x1 + _TOUCH)
        inner &= (low[:, 2] > r.z0 - _TOUCH) & (high[:, 2] < r.z1 + _TOUCH)
        inner &= (low[:, 1] > -_TOUCH) & (high[:, 1] < self.plan.height + _TOUCH)
        boxes = [(p.low, p.high) for p in self.placed if not p.flat and p not in ignore]
        boxes += (self._zones if zones else []) + (self._panes if windows else [])
        if boxes:
            lows, highs = np.array([b[0] for b in boxes]), np.array([b[1] for b in boxes])
            inner &= ~overlaps(low, high, lows, highs).any(axis=1)
        return inner

    # -- spots -------------------------------------------------------------------------------------------------------

    def spots(
        self,
        furniture: Furniture,
        *,
        sides: Sequence[Side] = SIDES,
        height: float = 0.0,
        gap: float = WALL_GAP,
        front: float = 0.0,
        margin: float = 0.0,
        windows: bool = True,
        turn: float = 0.0,
        top: float = 0.0,
    ) -> list[Spot]:
        """Free places of a piece with its back at a wall.

        Args:
            furniture: the piece.
            sides: the walls to try.
            height: of its origin above the floor.
            gap: between its back and the wall.
            front: depth that must be free before it as well.
            margin: free width on its left and right.
            windows: whether it must leave windows free.
            turn: degrees; 90 puts its right side at the wall in place of its back.
            top: the wall above it must be free up to this height.
        """
        low, high = world_box(furniture, np.zeros(3), turn)
        out: list[Spot] = []
        for side in sides:
            wall = self.room.wall(side)
            first, last = -low[0] + 0.003 + margin, wall.length - high[0] - 0.003 - margin
            if last < first:
                continue
            count = max(2, int((last - first) / 0.05) + 1)
            alongs = np.linspace(first, last, count)
            positions = np.array([wall.point(a, height, gap - low[2]) for a in alongs])
            ends = [
                np.array([wall.point(a + low[0] - margin, height + low[1], gap) for a in alongs]),
                np.array([wall.point(a + high[0] + margin, height + high[1], gap + high[2] - low[2]) for a in alongs]),
            ]
            lows, highs = np.minimum(*ends), np.maximum(*ends)
            highs[:, 1] = np.maximum(highs[:, 1], top)
            ok = self.free(lows, highs, windows=windows)
            if front > 0:
                reach = [lows + np.minimum(wall.normal * front, 0), highs + np.maximum(wall.normal * front, 0)]
                reach[0][:, 1] = np.maximum(reach[0][:, 1], FLAT)
                ok &= self._front_free(reach[0], reach[1])
            for k in np.flatnonzero(ok):
                yaw = wall.yaw + turn
                out.append(Spot(wall, float(alongs[k]), positions[k], yaw, *world_box(furniture, positions[k], yaw)))
        return out

    def _front_free(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """Like `free`, but door zones may be met: both are walked through."""
        r = self.room
        inner = (low[:, 0] > r.x0 - _TOUCH) & (high[:, 0] < r.x1 + _TOUCH)
        inner &= (low[:, 2] > r.z0 - _TOUCH) & (high[:, 2] < r.z1 + _TOUCH)
        solid = [p for p in self.placed if not p.flat]
        if solid:
            inner &= ~overlaps(low, high, np.array([p.low for p in solid]), np.array([p.high for p in solid])).any(axis=1)
        return inner

    def put(self, furniture: Furniture, spot: Spot, *, front: float = 0.0) -> Placed:
        """Stand a piece at a spot and keep ``front`` metres before it free."""
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
        score: Callable[[Spot], float] | None = None,
        copy: int = 0,
        sides: Sequence[Side] = SIDES,
        height: float = 0.0,
        gap: float | None = None,
        front: float = 0.0,
        margin: float = 0.0,
        windows: bool = True,
        top: float = 0.0,
        jitter: float = 0.3,
        options: dict[str, object] | None = None,
    ) -> tuple[Placed, Spot] | None:
        """Put a kind at its best free spot (highest ``score`` plus noise of size ``jitter``), if there is any."""
        furniture = self.model(kind, copy, **(options or {}))
        space = gap if gap is not None else (0.0 if furniture.mount == "wall" else WALL_GAP)
        found = self.spots(
            furniture, sides=sides, height=height, gap=space, front=front, margin=margin, windows=windows, top=top
        )
        if not found:
            return None
        noise = self.rng.uniform(0, jitter, len(found)) if jitter else np.zeros(len(found))
        values = [(score(spot) if score else 0.0) + n for spot, n in zip(found, noise, strict=True)]
        spot = found[int(np.argmax(values))]
        return self.put(furniture, spot, front=front), spot

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
        """Stand a piece with its origin at ``centre`` (x, z), if it fits; rugs need only lie in the room."""
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

    def stretches(self, wall: WallFrame, height: tuple[float, float], depth: float, *, windows: bool = True) -> list[tuple[float, float]]:
        """Free intervals of a wall for things of that height range and depth, by 1 cm."""
        steps = np.arange(0.005, wall.length, 0.01)
        ends = [
            np.array([wall.point(s - 0.004, height[0]) for s in steps]),
            np.array([wall.point(s + 0.004, height[1], depth) for s in steps]),
        ]
        ok = self.free(np.minimum(*ends), np.maximum(*ends), windows=windows)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ok.astype(np.int8), [0]])))
        return [(round(a * 0.01, 2), round(min(b * 0.01, wall.length), 2)) for a, b in edges.reshape(-1, 2)]

    # -- walking -----------------------------------------------------------------------------------------------------

    def occupancy(self) -> NDArray[np.bool_]:
        """(X, Z) bool at 5 cm: floor cells under something that a walker would touch."""
        r = self.room
        shape = (int((r.x1 - r.x0) / CELL), int((r.z1 - r.z0) / CELL))
        x = r.x0 + (np.arange(shape[0]) + 0.5) * CELL
        z = r.z0 + (np.arange(shape[1]) + 0.5) * CELL
        taken = np.zeros(shape, dtype=bool)
        for piece in self.placed:
            if piece.flat or piece.low[1] > OVERHEAD:
                continue
            across = (x > piece.low[0]) & (x < piece.high[0])
            taken |= across[:, None] & ((z > piece.low[2]) & (z < piece.high[2]))[None]
        return taken

    def walkable(self) -> float:
        """Square metres that the agent's centre can reach, or 0 if it cannot get from each door to all others."""
        r = self.room
        # Walls are obstacles too: a rim of taken cells, open at the doors.
        taken = np.pad(self.occupancy(), 1, constant_values=True)
        clear = ndimage.distance_transform_edt(~taken) * CELL >= AGENT_RADIUS + CELL / 2
        labels, _ = ndimage.label(clear)
        doors = []
        for side in SIDES:
            wall = r.wall(side)
            for opening in self.plan.openings_of(r.name, side):
                if opening.kind in ("door", "passage"):
                    a, b = wall.along(opening.start, opening.stop)
                    at = wall.point((a + b) / 2, 0.0, AGENT_RADIUS + 0.12)
                    doors.append(int(labels[int((at[0] - r.x0) / CELL) + 1, int((at[2] - r.z0) / CELL) + 1]))
        if not doors or min(doors) == 0 or len(set(doors)) > 1:
            return 0.0
        return float((labels == doors[0]).sum()) * CELL**2

    def free_rectangle(self, width: float, depth: float) -> bool:
        """Whether a rectangle of floor of that size, either way round, is free."""
        taken = self.occupancy()
        total = np.pad(np.cumsum(np.cumsum(taken, axis=0), axis=1), ((1, 0), (1, 0)))
        for a, b in ((width, depth), (depth, width)):
            m, n = int(np.ceil(a / CELL)), int(np.ceil(b / CELL))
            if m > taken.shape[0] or n > taken.shape[1]:
                continue
            window = total[m:, n:] - total[:-m, n:] - total[m:, :-n] + total[:-m, :-n]
            if (window == 0).any():
                return True
        return False

    def wall_spots(self, width: float, depth: float, height: float, apart: float) -> int:
        """How many boxes of that size still fit at the walls, their middles ``apart`` metres or more."""
        found: list[Array] = []
        for side in SIDES:
            wall = self.room.wall(side)
            alongs = np.arange(width / 2 + 0.01, wall.length - width / 2 - 0.01, 0.05)
            if not len(alongs):
                continue
            ends = [
                np.array([wall.point(a - width / 2, FLAT, WALL_GAP) for a in alongs]),
                np.array([wall.point(a + width / 2, height, WALL_GAP + depth) for a in alongs]),
            ]
            for k in np.flatnonzero(self.free(np.minimum(*ends), np.maximum(*ends))):
                at = wall.point(alongs[k], 0.0, depth / 2)
                if all(np.linalg.norm(at - other) >= apart for other in found):
                    found.append(at)
        return len(found)

