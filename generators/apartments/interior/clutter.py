"""Puts the small things of the catalogue (`generators.assets.clutter`) on the furniture, walls and floor of a room.

A thing's place is drawn at random among those that its kind names, and tested: rays from above it (in front of it, for
things on walls) must all meet one flat surface, so that it neither floats nor enters anything, and its box must keep
clear of other small things and of what is reserved for the objects of the benchmark. All depends on the home's seed
alone, so that nothing here tells which object sounds.
"""

from __future__ import annotations

import copy
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.apartments.floorplan import SIDES, WallFrame
from generators.apartments.interior.arrange import WALL_GAP, Arranger
from generators.apartments.interior.bathroom import MACHINE, MACHINE_PLACES, MACHINE_SPACING
from generators.apartments.interior.pieces import FLAT, Placed, overlaps, turned_bounds
from generators.apartments.interior.walking import walkable, wall_spots
from generators.apartments.joinery import FRAME_DEPTH, PANE_DEPTH, SILL_DEPTH
from generators.assets.clutter.catalogue import kinds_for
from generators.assets.clutter.record import ClutterKind, Place
from generators.assets.furniture import Furniture
from generators.assets.shapes import rotation
from generators.core.arrays import distinct_rows
from generators.core.rays import RayCaster
from generators.core.scene import Part, Support

Array = NDArray[np.float64]

#: Level place → kinds of furniture whose upper faces offer it, and the range of their height above the floor (m).
LEVELS: dict[Place, tuple[tuple[str, ...], tuple[float, float]]] = {
    "worktop": (("kitchen_counter", "oven_unit"), (0.89, 0.903)),
    "hob": (("kitchen_counter",), (0.904, 0.912)),
    "board": (("wall_cabinet", "kitchen_shelf", "shelf_board", "bookshelf", "bathroom_cabinet"), (0.3, 2.0)),
    "cabinet_top": (("wall_cabinet", "fridge", "oven_unit", "bathroom_cabinet", "wardrobe"), (1.55, 2.3)),
    "basin": (("washbasin",), (0.84, 0.86)),
    "tub": (("bathtub",), (0.45, 0.7)),
    "table": (("dining_table",), (0.6, 0.85)),
    "coffee_table": (("coffee_table", "side_table"), (0.25, 0.7)),
    "desk": (("desk",), (0.65, 0.8)),
    "nightstand": (("nightstand",), (0.3, 0.7)),
    "sideboard": (("sideboard", "tv_stand", "shoe_cabinet"), (0.3, 1.1)),
}
#: Upholstered place → kind of furniture → where on it things lie: shares of its width and depth about its middle.
SOFT: dict[Place, dict[str, tuple[tuple[float, float], tuple[float, float]]]] = {
    "bed": {"bed": ((-0.4, 0.4), (-0.12, 0.42))},
    "seat": {
        "sofa": ((-0.38, 0.38), (-0.06, 0.43)),
        "armchair": ((-0.27, 0.27), (0.0, 0.38)),
        "chair": ((-0.42, 0.42), (-0.28, 0.42)),
        "stool": ((-0.4, 0.4), (-0.4, 0.4)),
    },
}
#: How far from flat upholstery may be under a thing, which lies halfway in (m), and how far from its middle's height.
_SOFT_FLAT, _SOFT_SLACK = 0.04, 0.05
#: Height from which the middle of a piece of upholstery is measured (m).
_SOFT_TOP = 1.2
#: Furniture beside which people put things down.
_STANDING = ("sofa", "bed", "nightstand", "desk", "sideboard", "tv_stand", "bookshelf", "wardrobe", "shoe_cabinet")
#: Cosine above which a side of a piece is its front, before which nothing stands.
_FRONT = 0.5
#: Gap between a thing on the floor and the furniture beside which it stands (m).
_BESIDE_GAP = (0.015, 0.06)
#: Reserved for the objects of the benchmark: share of a support's longer side (or of a free stretch of wall), and its
#: least length (m), by the kind of support. Up to six machines stand on the worktops of a kitchen, up to four on its
#: table; clocks, telephones and radios stand on shelves.
RESERVED = {"worktop": (1.0, 0.0), "shelf": (0.55, 0.38), "side_table": (0.55, 0.42), "wall": (0.35, 0.5)}
#: The same of tables at which people eat: their shorter side is this wide or wider (m).
_TABLE, _TABLE_WIDTH = (0.6, 0.68), 0.6
#: How much of a worktop's depth is reserved, from its front edge (m): bottles and boards stand at the wall behind it.
RESERVED_DEPTH = 0.44
#: Height above a support that is reserved with it (m).
_RESERVED_HEIGHT = 0.6
#: Least cosine between a level face's normal and the vertical, and how much the heights of joined faces may differ (m).
_LEVEL, _SAME_HEIGHT = 0.999, 5e-4
#: Least area of a surface (m²).
_LEAST_AREA = 0.004
#: Places that are drawn for a thing, and how many of those without a collision are tested with rays.
_DRAWS, _TRIALS = 128, 20
#: Furniture that is turned by less than this from the room's axes has places on its upholstery (degrees).
_LEVEL_YAW = 1.0
#: Gap between small things (m), and between them and the edge of what they stand on (m).
_GAP, _EDGE = 0.006, 0.004
#: Distance between the rays under a thing (m), at most, and how far from flat a surface may be (m).
_RAY_STEP, _FLAT = 0.008, 0.0012
#: Height above a support from which the first rays look for it (m).
_PROBE = 0.03
#: Gap between a thing and its support (m), so that no faces coincide.
_CONTACT = 0.0004
#: Depth of air that must be free before a thing on a wall (m).
_AIR = 0.12
#: Height that must be free above a thing (m): rays begin above boards that lie closely over their support.
_HEADROOM = 0.03
#: How far the surface behind a thing on a wall may stand out from the wall (m): tiles; on a fridge: behind its handles.
_PROUD, _FRIDGE_PROUD = 0.02, 0.09
#: How far the surface may be from where a place expects it (m): on floors there are rugs.
_SLACK: dict[Place, float] = {"fridge": _FRIDGE_PROUD, "ceiling": _FLAT, "floor": 0.02, "entrance": 0.02}
#: Height and thickness of a skirting board (m), at most; what reaches lower on a wall stands out further than this.
_SKIRTING_TOP, _SKIRTING_THICK = 0.16, 0.018
#: Share of its walkable floor that a room keeps, and the rooms in which machines need places at walls.
_WALKABLE = 0.92
_MACHINE_ROOMS = ("bathroom", "kitchen")
#: Distances of a switch from a door's opening (m), and of things from the ends of a wall (m).
_DOOR_SIDES, _WALL_END = (0.14, 0.2, 0.28), 0.05
#: Rooms in which no observation is made, and what is kept free there: shares of a support and of the walkable floor.
QUIET, _QUIET_SHARE, _QUIET_WALKABLE = ("bedroom", "hall"), 0.3, 0.8
#: Reach along the wall beside washbasin and tub (m).
_BESIDE = 0.55
#: Depth of a strip of floor along a wall (m), and gap between an entrance and its mat (m).
_STRIP, _MAT_GAP = 0.5, 0.06


@dataclass(frozen=True, eq=False)
class _Rectangle:
    """A level rectangle in the world: lowest and highest corner (3,) of one height, and the yaw of its front."""

    low: Array
    high: Array
    yaw: float

    @property
    def area(self) -> float:
        size = self.high - self.low
        return float(size[0] * size[2])


@dataclass(frozen=True, eq=False)
class _Face:
    """A stretch of a wall or of a piece's front: ``span`` along ``frame`` (m), and how far it may stand out (m)."""

    frame: WallFrame
    span: tuple[float, float]
    proud: float = _PROUD


@dataclass(frozen=True, eq=False)
class _Candidates:
    """A thing in K possible places: origins (K, 3), yaws (K,) in degrees, corners (K, 3) of its world boxes."""

    position: Array
    yaw: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, thing: Furniture, position: Array, yaw: Array) -> _Candidates:
        """``thing`` at ``position`` (K, 3), turned by ``yaw`` (K,)."""
        low, high = turned_bounds(thing, yaw)
        return cls(position, yaw, position + low, position + high)

    def __len__(self) -> int:
        return len(self.yaw)

    def __getitem__(self, chosen: NDArray[np.intp]) -> _Candidates:
        return _Candidates(self.position[chosen], self.yaw[chosen], self.low[chosen], self.high[chosen])

    def one(self, index: int) -> _Candidate:
        """Number ``index``."""
        return _Candidate(self.position[index], float(self.yaw[index]), self.low[index], self.high[index])


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A thing in a possible place: origin (3,), yaw (degrees), its world box."""

    position: Array
    yaw: float
    low: Array
    high: Array


def add_clutter(a: Arranger, caster: RayCaster, supports: Sequence[Support]) -> list[Part]:
    """The small things of a furnished room.

    Args:
        a: the room; it is not changed.
        caster: of all triangles of the home without small things.
        supports: places of the objects of the benchmark in this room; a part of each stays free.

    Returns:
        One part per thing, called ``<room>/<kind>_<n>``.
    """
    rng = np.random.default_rng([a.seed, zlib.crc32(b"clutter"), zlib.crc32(a.room.name.encode())])
    placer = _Placer(a, caster, supports, rng)
    parts = []
    for kind in kinds_for(a.room.name):
        least, most = kind.rooms[a.room.name]
        for number in range(int(rng.integers(least, most + 1))):
            thing = kind.make(a.palette, a.seed, zlib.crc32(f"{a.room.name} {number}".encode()))
            found = placer.place(kind, thing)
            if found is None:
                break
            mesh = thing.mesh.transformed(rotation("y", found.yaw), found.position)
            parts.append(Part(f"{a.room.name}/{kind.name}_{number}", mesh))
    return parts


class _Placer:
    """Finds places for small things in one room."""

    def __init__(self, a: Arranger, caster: RayCaster, supports: Sequence[Support], rng: Generator) -> None:
        self._caster, self._rng = caster, rng
        # Things on the floor join a copy of the room, which tells how much floor and wall they leave.
        self._room = copy.copy(a)
        self._room.placed = list(a.placed)
        self._machines = self._machine_places()
        self._walkable = walkable(self._room)
        self._quiet = a.room.name in QUIET
        reserved = [_reserved(support, rng, quiet=self._quiet) for support in supports if support.kind != "floor"]
        self._taken_low = [low for low, _ in reserved]
        self._taken_high = [high for _, high in reserved]
        self._surfaces = {place: _surfaces(a.placed, *rule) for place, rule in LEVELS.items()}
        self._surfaces["sill"] = _sills(a)
        self._surfaces |= {place: self._upholstery(rule) for place, rule in SOFT.items()}

    def place(self, kind: ClutterKind, thing: Furniture) -> _Candidate | None:
        """A free place of a thing, which is taken from now on; None: there is none."""
        for place in kind.places:
            candidates = self._candidates(place, kind, thing)
            for index in np.flatnonzero(~self._meets(candidates.low, candidates.high))[:_TRIALS]:
                found = self._settled(place, candidates.one(int(index)))
                if found is not None and (place != "floor" or self._leaves_floor(found, thing)):
                    self._taken_low.append(found.low)
                    self._taken_high.append(found.high)
                    return found
        return None

    def _upholstery(self, rule: dict[str, tuple[tuple[float, float], tuple[float, float]]]) -> list[_Rectangle]:
        """Where things may lie on the upholstered pieces of a room, at the height of the middle of each place."""
        out = []
        for piece in self._room.placed:
            if piece.furniture.kind not in rule or abs((piece.yaw + 45) % 90 - 45) > _LEVEL_YAW:
                continue
            (x0, x1), (z0, z1) = rule[piece.furniture.kind]
            low, high = piece.furniture.mesh.bounds.astype(np.float64)
            middle, size = (low + high) / 2, high - low
            local = np.array([[x * size[0], 0.0, z * size[2]] for x in (x0, x1) for z in (z0, z1)]) + middle * (1, 0, 1)
            corners = local @ rotation("y", piece.yaw).T + piece.position
            centre = corners.mean(axis=0)
            centre[1] = _SOFT_TOP
            distance, _ = self._caster.closest(centre[None], np.array([[0.0, -1.0, 0.0]]))
            corners[:, 1] = _SOFT_TOP - float(distance[0])
            out.append(_Rectangle(corners.min(axis=0), corners.max(axis=0), piece.yaw))
        return out

    # -- candidates --------------------------------------------------------------------------------------------------

    def _candidates(self, place: Place, kind: ClutterKind, thing: Furniture) -> _Candidates:
        if place in self._surfaces:
            return self._on_levels(self._surfaces[place], kind, thing)
        if place == "floor":
            return self._on_floor(kind, thing)
        if place == "entrance":
            return self._at_entrance(thing)
        if place == "ceiling":
            return self._on_ceiling(thing)
        return self._on_faces(self._faces(place, thing), kind, thing)

    def _on_levels(self, rectangles: list[_Rectangle], kind: ClutterKind, thing: Furniture) -> _Candidates:
        """Places on rectangles, each drawn in proportion to its area."""
        if not rectangles:
            return _nowhere()
        areas = np.array([r.area for r in rectangles])
        chosen = self._rng.choice(len(rectangles), _DRAWS, p=areas / areas.sum())
        front = np.array([r.yaw for r in rectangles])[chosen]
        yaw = front + self._rng.uniform(-kind.turn, kind.turn, _DRAWS)
        share = self._rng.random((_DRAWS, 2))
        if kind.rear:
            ahead = _fronts(front)[:, [0, 2]]
            rows, axis = np.arange(_DRAWS), np.argmax(np.abs(ahead), axis=1)
            back = 0.12 * share[rows, axis]
            share[rows, axis] = np.where(ahead[rows, axis] > 0, back, 1 - back)
        low, high = turned_bounds(thing, yaw)
        least = np.array([r.low for r in rectangles])[chosen] - low
        room = (np.array([r.high for r in rectangles])[chosen] - high - least)[:, [0, 2]] - 2 * _EDGE
        least[:, [0, 2]] += _EDGE + share * room
        return self._above_support(_Candidates.of(thing, least, yaw)[np.flatnonzero((room >= 0).all(axis=1))])

    def _above_support(self, candidates: _Candidates) -> _Candidates:
        """The candidates whose middle and corners have the support just below them: many rectangles have holes."""
        if not len(candidates):
            return candidates
        low, high = candidates.low, candidates.high
        shares = np.array([(0.5, 0.5), (0.02, 0.02), (0.02, 0.98), (0.98, 0.02), (0.98, 0.98)])
        rays = np.repeat(low[:, None], len(shares), axis=1)
        rays[:, :, [0, 2]] += shares * (high - low)[:, None, [0, 2]]
        rays[:, :, 1] += _PROBE
        down = np.broadcast_to([0.0, -1.0, 0.0], rays.shape)
        distance, _ = self._caster.closest(rays.reshape(-1, 3), down.reshape(-1, 3))
        level = np.abs(distance.reshape(-1, len(shares)) - _PROBE) <= _FLAT
        return candidates[np.flatnonzero(level.all(axis=1))]

    def _on_floor(self, kind: ClutterKind, thing: Furniture) -> _Candidates:
        """Places on the floor with the back at a wall, the nearer to a corner the earlier; then beside furniture."""
        walls = [self._room.room.wall(side) for side in SIDES]
        count = _DRAWS // 4
        along = np.concatenate([self._rng.uniform(0.0, wall.length, count) for wall in walls])
        wall_yaw, length = (np.repeat([getattr(w, name) for w in walls], count) for name in ("yaw", "length"))
        origin, u, normal = (
            np.repeat([getattr(w, name) for w in walls], count, axis=0) for name in ("origin", "u", "normal")
        )
        yaw = wall_yaw + self._rng.uniform(-kind.turn, kind.turn, len(along))
        back = -np.minimum(*((end * normal).sum(axis=1) for end in turned_bounds(thing, yaw)))
        depth = WALL_GAP + back + (0.0 if kind.rear else self._rng.uniform(0.0, 0.12, len(along)))
        at = origin + along[:, None] * u + depth[:, None] * normal
        order = np.argsort(np.minimum(along, length - along), kind="stable")
        beside, turned = self._beside(kind, thing)
        found = _Candidates.of(thing, np.concatenate([at[order], beside]), np.concatenate([yaw[order], turned]))
        return found[np.flatnonzero(self._room.free(found.low, found.high))]

    def _beside(self, kind: ClutterKind, thing: Furniture) -> tuple[Array, Array]:
        """Places (K, 3) on the floor beside the furniture, not before its front, and yaws (K,)."""
        pieces = [p for p in self._room.placed if p.furniture.kind in _STANDING]
        if not pieces:
            return np.zeros((0, 3)), np.zeros(0)
        chosen, side = self._rng.integers(len(pieces), size=_DRAWS), self._rng.integers(4, size=_DRAWS)
        piece_yaw, first, last = (
            np.array(values)[chosen] for values in zip(*((p.yaw, p.low, p.high) for p in pieces), strict=True)
        )
        yaw = piece_yaw + self._rng.uniform(-kind.turn, kind.turn, _DRAWS)
        low, high = turned_bounds(thing, yaw)
        rows, axis = np.arange(_DRAWS), np.where(side % 2, 2, 0)
        gap = self._rng.uniform(*_BESIDE_GAP, _DRAWS)
        at = first + self._rng.random((_DRAWS, 3)) * (last - first)
        behind, ahead = first[rows, axis] - gap - high[rows, axis], last[rows, axis] + gap - low[rows, axis]
        at[rows, axis] = np.where(side < 2, ahead, behind)
        at[:, 1] = 0.0
        faces = _fronts(piece_yaw)[rows, axis] * np.where(side < 2, 1, -1) > _FRONT
        return at[~faces], yaw[~faces]

    def _at_entrance(self, thing: Furniture) -> _Candidates:
        """Before the flat's entrance."""
        at, yaw = [], []
        for side in SIDES:
            wall = self._room.room.wall(side)
            for opening in self._room.plan.openings_of(self._room.room.name, side):
                if opening.kind == "entrance":
                    middle = sum(wall.along(opening.start, opening.stop)) / 2
                    at.append(wall.point(middle, 0.0, _MAT_GAP - float(thing.mesh.bounds[0, 2])))
                    yaw.append(wall.yaw)
        return _Candidates.of(thing, np.array(at).reshape(-1, 3), np.array(yaw, dtype=np.float64))

    def _on_ceiling(self, thing: Furniture) -> _Candidates:
        """Anywhere on the ceiling, not near its rim."""
        r = self._room.room
        at = np.full((_DRAWS, 3), self._room.plan.height)
        at[:, [0, 2]] = (r.x0, r.z0) + self._rng.uniform(0.2, 0.8, (_DRAWS, 2)) * (r.x1 - r.x0, r.z1 - r.z0)
        return _Candidates.of(thing, at, np.zeros(_DRAWS))

    def _faces(self, place: Place, thing: Furniture) -> list[_Face]:
        """The stretches of wall (or front) that a place means."""
        room = self._room
        walls = [room.room.wall(side) for side in SIDES]
        if place == "wall":
            return [_Face(wall, (_WALL_END, wall.length - _WALL_END)) for wall in walls]
        if place == "door_side":
            half = float(thing.mesh.bounds[1, 0])
            spots = []
            for opening, _, _ in room.doorways:
                side = opening.side if opening.room == room.room.name else opening.other_side
                assert side is not None
                wall = room.room.wall(side)
                start, stop = wall.along(opening.start, opening.stop)
                middles = [x for d in _DOOR_SIDES for x in (start - d, stop + d)]
                spots += [_Face(wall, (x - half, x + half)) for x in middles if half < x < wall.length - half]
            return spots
        kinds = {
            "worktop_wall": "kitchen_counter",
            "basin_wall": "washbasin",
            "tub_wall": "bathtub",
            "fridge": "fridge",
        }
        out = []
        for piece in room.placed:
            if piece.furniture.kind != kinds[place]:
                continue
            for wall in walls:
                if abs((piece.yaw - wall.yaw + 180) % 360 - 180) > 1:
                    continue
                axis = int(np.argmax(np.abs(wall.u)))
                start, stop = wall.along(float(piece.low[axis]), float(piece.high[axis]))
                if place == "fridge":
                    depth = float(
                        max((piece.low - wall.origin) @ wall.normal, (piece.high - wall.origin) @ wall.normal)
                    )
                    front = WallFrame(wall.side, wall.point(0.0, 0.0, depth), wall.u, wall.normal, wall.length)
                    # The front plane touches the handles; the door lies behind it.
                    out.append(_Face(front, (start, stop), -_FRIDGE_PROUD))
                elif place == "worktop_wall":
                    out.append(_Face(wall, (start + _WALL_END, stop - _WALL_END)))
                else:
                    out.append(_Face(wall, (max(start - _BESIDE, 0.02), min(stop + _BESIDE, wall.length - 0.02))))
        return out

    def _on_faces(self, faces: list[_Face], kind: ClutterKind, thing: Furniture) -> _Candidates:
        """Places on stretches of wall, their depth not settled yet."""
        low, high = thing.mesh.bounds.astype(np.float64)
        fitting = [f for f in faces if f.span[1] - f.span[0] >= high[0] - low[0] - 1e-6]
        if not fitting:
            return _nowhere()
        spans = np.array([f.span for f in fitting])
        lengths = spans[:, 1] - spans[:, 0]
        chosen = self._rng.choice(len(fitting), _DRAWS, p=lengths / lengths.sum())
        first = spans[chosen, 0] - low[0]
        along = self._rng.uniform(first, np.maximum(spans[chosen, 1] - high[0], first))
        height = self._rng.uniform(*kind.height, _DRAWS)
        at = np.array(
            [
                fitting[index].frame.point(a, h, min(fitting[index].proud, 0.0))
                for index, a, h in zip(chosen.tolist(), along.tolist(), height.tolist(), strict=True)
            ]
        )
        out = _Candidates.of(thing, at, np.array([f.frame.yaw for f in fitting], dtype=np.float64)[chosen])
        if high[2] > _AIR / 2 and self._room.doorways:
            ways = [np.array(ends) for ends in zip(*((low, high) for _, low, high in self._room.doorways), strict=True)]
            out = out[np.flatnonzero(~overlaps(out.low, out.high, *ways).any(axis=1))]
        return out

    # -- tests -------------------------------------------------------------------------------------------------------

    def _settled(self, place: Place, c: _Candidate) -> _Candidate | None:
        """The candidate in contact with one flat surface with nothing in its box, or None."""
        if place == "ceiling":
            normal, air = np.array([0.0, -1.0, 0.0]), _AIR
        elif place in self._surfaces or place in ("floor", "entrance"):
            normal, air = np.array([0.0, 1.0, 0.0]), _HEADROOM
        else:
            normal, air = rotation("y", c.yaw)[:, 2].round(6), _AIR
        axis = int(np.argmax(np.abs(normal)))
        sign = float(np.sign(normal[axis]))
        depth = float(c.high[axis] - c.low[axis])
        slack = _SOFT_SLACK if place in SOFT else _SLACK.get(place, _FLAT if normal[1] else _PROUD)
        uneven = _SOFT_FLAT if place in SOFT else _FLAT
        start = (c.low[axis] if sign > 0 else c.high[axis]) + sign * (depth + air + slack)
        across = [k for k in range(3) if k != axis]
        lines = [
            np.linspace(c.low[k] + 1e-4, c.high[k] - 1e-4, max(3, int((c.high[k] - c.low[k]) / _RAY_STEP) + 2))
            for k in across
        ]
        grid = np.stack([g.reshape(-1) for g in np.meshgrid(*lines, indexing="ij")], axis=1)
        origins = np.empty((len(grid), 3))
        origins[:, across], origins[:, axis] = grid, start
        distance, _ = self._caster.closest(origins, np.broadcast_to(-normal, origins.shape))
        distance = distance.astype(np.float64)
        if axis != 1:
            # Cables hang before skirting boards.
            skirting = (origins[:, 1] < _SKIRTING_TOP) & (distance > distance.max() - _SKIRTING_THICK)
            distance[skirting] = distance.max()
        nearest, furthest = float(distance.min()), float(distance.max())
        if furthest - nearest > uneven or not depth + air - uneven <= nearest <= depth + air + slack + uneven:
            return None
        if place in SOFT:
            nearest = (nearest + furthest) / 2
        shift = np.zeros(3)
        shift[axis] = start - sign * (nearest - _CONTACT) - (c.low[axis] if sign > 0 else c.high[axis])
        moved = _Candidate(c.position + shift, c.yaw, c.low + shift, c.high + shift)
        return None if self._meets(moved.low[None], moved.high[None])[0] else moved

    def _meets(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """(K,) whether boxes (K, 3) overlap what is taken."""
        if not self._taken_low:
            return np.zeros(len(low), dtype=bool)
        taken = overlaps(low - _GAP, high + _GAP, np.array(self._taken_low), np.array(self._taken_high))
        return np.asarray(taken.any(axis=1))

    def _machine_places(self) -> int:
        """How many of the places at walls that the benchmark wants are left."""
        if self._room.room.name not in _MACHINE_ROOMS:
            return 0
        return min(wall_spots(self._room, MACHINE, MACHINE_SPACING), MACHINE_PLACES)

    def _leaves_floor(self, c: _Candidate, thing: Furniture) -> bool:
        """Whether a thing on the floor leaves floor to walk on, and walls for machines; it joins the room then."""
        if c.high[1] <= FLAT:
            return True
        self._room.placed.append(Placed(thing, c.position, c.yaw, c.low, c.high))
        share = _QUIET_WALKABLE if self._quiet else _WALKABLE
        if self._machine_places() >= self._machines and walkable(self._room) >= share * self._walkable:
            return True
        self._room.placed.pop()
        return False


def _nowhere() -> _Candidates:
    return _Candidates(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))


def _fronts(yaw: Array) -> Array:
    """(K, 3) where the fronts of pieces with these yaws (K,) look."""
    return rotation("y", yaw)[:, :, 2]


def reserved_length(support: Support, *, quiet: bool = False) -> float:
    """How much of the longer side of a support, of a worktop's front or of a free stretch of wall, stays free (m).

    In a ``quiet`` room, where no observation is made, it is less.
    """
    sides = [float(np.linalg.norm(side)) for side in (support.u, support.v)]
    share, least = RESERVED[support.kind]
    if quiet:
        share, least = _QUIET_SHARE, 0.0
    elif support.kind == "side_table" and min(sides) >= _TABLE_WIDTH:
        share, least = _TABLE
    length = max(sides)
    if support.kind == "wall":
        length = sides[0]
    elif support.kind == "worktop":
        length = sides[1 - _deep_side(support)]
    return min(max(share * length, least), length)


def _deep_side(support: Support) -> int:
    """Which of the two sides of a support leads away from its front: 0 or 1."""
    u, v = (abs(float(np.dot(side, support.front))) for side in (support.u, support.v))
    return int(v > u)


def _reserved(support: Support, rng: Generator, *, quiet: bool) -> tuple[Array, Array]:
    """World box over the part of a support that stays free: an end of a level one, the middle of a wall's."""
    kept = reserved_length(support, quiet=quiet)
    origin, u, v = (np.asarray(c, dtype=np.float64) for c in (support.origin, support.u, support.v))
    if support.kind == "wall":
        half = kept / float(np.linalg.norm(u)) / 2
        corners = np.stack([origin + (0.5 - half) * u, origin + (0.5 + half) * u + v])
        corners = np.concatenate([corners, corners + np.asarray(support.normal) * support.clearance])
        return corners.min(axis=0), corners.max(axis=0)
    if support.kind == "worktop":
        origin, u, v = _front_strip(support)
    elif np.linalg.norm(u) < np.linalg.norm(v):
        u, v = v, u
    share = kept / float(np.linalg.norm(u))
    first = 0.0 if rng.random() < 0.5 else 1.0 - share
    corners = np.stack([origin + first * u, origin + (first + share) * u + v])
    low, high = corners.min(axis=0), corners.max(axis=0)
    high[1] += _RESERVED_HEIGHT
    return low, high


def _front_strip(support: Support) -> tuple[Array, Array, Array]:
    """Origin, front side and depth (3,) of a worktop's rectangle down to `RESERVED_DEPTH` behind its front edge."""
    origin = np.asarray(support.origin, dtype=np.float64)
    deep = _deep_side(support)
    along, back = (np.asarray((support.u, support.v)[k], dtype=np.float64) for k in (1 - deep, deep))
    kept = min(RESERVED_DEPTH / float(np.linalg.norm(back)), 1.0)
    if back @ support.front > 0:
        origin = origin + (1 - kept) * back
    return origin, along, kept * back


def _surfaces(placed: Sequence[Placed], kinds: tuple[str, ...], heights: tuple[float, float]) -> list[_Rectangle]:
    """Level faces of pieces of some kinds, those that are joined at one height as one rectangle."""
    out = []
    for piece in placed:
        if piece.furniture.kind in kinds:
            turned = piece.furniture.mesh.transformed(rotation("y", piece.yaw), piece.position)
            for low, high in _level_faces(turned.positions.astype(np.float64)):
                rectangle = _Rectangle(low, high, piece.yaw)
                if heights[0] <= low[1] <= heights[1] and rectangle.area >= _LEAST_AREA:
                    out.append(rectangle)
    return out


def _level_faces(triangles: Array) -> list[tuple[Array, Array]]:
    """Boxes of the level faces (F, 3, 3) that look up, those together that share corners."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(across, axis=1)
    level = triangles[(across[:, 1] > _LEVEL * size) & (np.ptp(triangles[:, :, 1], axis=1) < _SAME_HEIGHT)]
    if not len(level):
        return []
    corner = distinct_rows(np.round(level.reshape(-1, 3) / _SAME_HEIGHT).astype(np.int64))[1].reshape(-1, 3)
    edges = np.concatenate([corner[:, :2], corner[:, 1:]])
    count = int(corner.max()) + 1
    graph = coo_matrix((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    pieces, label = connected_components(graph, directed=False)
    own = label[corner[:, 0]]
    boxes = []
    for piece in range(pieces):
        points = level[own == piece].reshape(-1, 3)
        boxes.append((points.min(axis=0), points.max(axis=0)))
    return boxes


def _sills(a: Arranger) -> list[_Rectangle]:
    """The sills of the room's windows: what lies before the frame."""
    out = []
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind == "window":
                start, stop = wall.along(opening.start, opening.stop)
                p, q = (
                    wall.point(start, opening.bottom, SILL_DEPTH),
                    wall.point(stop, opening.bottom, FRAME_DEPTH - PANE_DEPTH),
                )
                out.append(_Rectangle(np.minimum(p, q), np.maximum(p, q), wall.yaw))
    return out
