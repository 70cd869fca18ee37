"""Fittings of every kind of room (lamps, curtains, radiators, door leaves, pictures), and scores for places."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import LEFT, RIGHT, SIDES
from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.pieces import WallSpot, origin_height, overlaps, world_box

Array = NDArray[np.float64]

#: `cornered`: loss per metre between a piece and the nearer corner, and the distance from which on it is the same (m).
_CORNER_WEIGHT, _CORNER_REACH = 2.0, 1.0
#: Length of a curtain rod: this multiple of the window's width and this much more (m), so that the cloth, drawn to the
#: sides, hangs mostly before the wall.
_ROD_SHARE, _ROD_EXTRA = 1.25, 0.5
#: A rod is this much shorter than its wall (m), at least, and ends this far from the wall's ends (m).
_ROD_PLAY, _ROD_END = 0.1, 0.01
#: Height of curtains (m), where the ceiling is high enough, and what else they are lower than the room (m).
_CURTAIN_HEIGHT, _CURTAIN_HEADROOM = 2.45, 0.12
#: Gap between curtains and the floor, and between curtains and the wall (m).
_CURTAIN_GAP = 0.03
#: Height of a radiator's lowest point, the end of its pipe, above the floor (m).
RADIATOR_BOTTOM = 0.02
#: Random part of the score of a radiator's place (m): small, so that it hangs below a window wherever it can.
_RADIATOR_JITTER = 0.05
#: Length of a room per ceiling lamp (m).
_LAMP_SPACING = 4.2
#: Height of a picture's middle above the floor (m): about the eyes of a person who stands.
_PICTURE_HEIGHT = 1.55
#: Free wall on both sides of a picture (m).
_PICTURE_MARGIN = 0.12
#: Height of a shelf board's lowest point above the floor (m): above the back of a sofa, within reach.
_BOARD_BOTTOM = 1.4
#: Free wall on both sides of a shelf board (m).
_BOARD_MARGIN = 0.15
#: A door leaf is this much narrower and lower than its opening (m): the joints round it.
_LEAF_JOINTS, _LEAF_FLOOR_JOINT = 0.02, 0.015
#: A leaf stands open along the next wall if its opening ends this far from the corner (m): nearer, the handle would
#: touch the wall; further, the open leaf would stand out into the room.
_LEAF_CORNER = (0.12, 0.32)
#: Distance of an open leaf's hinge edge from the wall with the door (m), and of its middle plane from the side of the
#: opening (m), towards the corner.
_HINGE_GAP, _LEAF_OFFSET = 0.02, 0.03


def near(point: Array | Sequence[float], weight: float = 1.0) -> Callable[[WallSpot], float]:
    """Score of a place: minus its horizontal distance from a point (x, y, z), times ``weight``."""
    target = np.asarray(point, dtype=np.float64)[[0, 2]]
    return lambda spot: -weight * float(np.linalg.norm(spot.centre[[0, 2]] - target))


def cornered(spot: WallSpot) -> float:
    """Score of a place: high in the corners of a room."""
    return -_CORNER_WEIGHT * min(spot.corner, _CORNER_REACH)


def doors_of(a: Arranger) -> Array:
    """(N, 3) middles of the room's doors and passages."""
    out = []
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind != "window":
                out.append(wall.point(sum(wall.along(opening.start, opening.stop)) / 2, 0.0))
    return np.array(out).reshape(-1, 3)


def facing_door(a: Arranger) -> Callable[[WallSpot], float]:
    """Score of a place: high on a wall that faces a door, where it is seen on entering."""
    doors = doors_of(a)

    def score(spot: WallSpot) -> float:
        if not len(doors):
            return 0.0
        toward = doors - spot.centre
        toward[:, 1] = 0
        toward /= np.linalg.norm(toward, axis=1, keepdims=True) + 1e-9
        return float((toward @ spot.wall.normal).max())

    return score


def curtains(a: Arranger) -> None:
    """Curtains at every window of the room."""
    for side in SIDES:
        wall = a.room.wall(side)
        for _copy, opening in enumerate(o for o in a.plan.openings_of(a.room.name, side) if o.kind == "window"):
            along = wall.along(opening.start, opening.stop)
            width = min(_ROD_SHARE * (along[1] - along[0]) + _ROD_EXTRA, wall.length - _ROD_PLAY)
            tall = min(a.plan.height - _CURTAIN_HEADROOM, _CURTAIN_HEIGHT)
            furniture = a.model("curtains", 0, width=round(width, 3), height=round(tall, 3))
            low, high = furniture.mesh.bounds
            middle = float(np.clip(sum(along) / 2, -low[0] + _ROD_END, wall.length - high[0] - _ROD_END))
            position = wall.point(middle, origin_height(furniture, _CURTAIN_GAP), _CURTAIN_GAP - float(low[2]))
            a.place_free(furniture, position[[0, 2]], wall.yaw, height=float(position[1]), windows=False, zones=False)


def radiator(a: Arranger, length: float | None = None) -> None:
    """A radiator below a window where that is free, else on a free wall."""
    panes = []
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind == "window":
                panes.append(wall.point(sum(wall.along(opening.start, opening.stop)) / 2, 0.0))
    options: dict[str, object] = {} if length is None else {"length": length}
    furniture = a.model("radiator", **options)

    def score(spot: WallSpot) -> float:
        return -min((float(np.linalg.norm((spot.centre - p)[[0, 2]])) for p in panes), default=0.0)

    where = Where(height=origin_height(furniture, RADIATOR_BOTTOM))
    a.place("radiator", score=score, jitter=_RADIATOR_JITTER, options=options, where=where)


def lamps(a: Arranger) -> None:
    """Ceiling lamps along the room's longer axis, one for about every 4 m; flat discs in the plainer rooms."""
    r = a.room
    flush = r.name in ("bathroom", "hall", "kitchen")
    size = np.array([r.x1 - r.x0, r.z1 - r.z0])
    axis = int(np.argmax(size))
    count = max(1, round(float(size[axis]) / _LAMP_SPACING))
    for k in range(count):
        centre = np.array([r.x0 + r.x1, r.z0 + r.z1]) / 2
        centre[axis] += size[axis] * ((k + 0.5) / count - 0.5)
        lamp = a.model("ceiling_lamp", drop=0) if flush else a.model("ceiling_lamp")
        a.place_free(lamp, centre, 0.0, height=a.plan.height, windows=False)


def pictures(
    a: Arranger, count: int, *, height: float = _PICTURE_HEIGHT, score: Callable[[WallSpot], float] | None = None
) -> None:
    """Up to ``count`` pictures on the walls, their middles at ``height``."""
    for copy in range(count):
        a.place("picture", copy=copy, score=score, where=Where(height=height, margin=_PICTURE_MARGIN))


def width_of(spot: WallSpot) -> float:
    """How much of the wall a piece covers."""
    return spot.extent[1] - spot.extent[0]


def depth_of(spot: WallSpot) -> float:
    """How far a piece reaches into the room."""
    axis = int(np.argmax(np.abs(spot.wall.normal)))
    return float(spot.high[axis] - spot.low[axis])


def shelf_board(a: Arranger, copy: int = 0, score: Callable[[WallSpot], float] | None = None) -> None:
    """A board on the wall with a few things on it, wherever the wall is free."""
    height = origin_height(a.model("shelf_board", copy), _BOARD_BOTTOM)
    a.place("shelf_board", copy=copy, score=score, where=Where(height=height, margin=_BOARD_MARGIN))


def door_leaves(a: Arranger) -> None:
    """Leaves of the doors that are near a corner: they stand open along the next wall."""
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind != "door":
                continue
            start, stop = wall.along(opening.start, opening.stop)
            width, tall = stop - start - _LEAF_JOINTS, opening.top - _LEAF_FLOOR_JOINT
            leaf = a.model("door_leaf", width=round(width, 3), height=round(tall, 3))
            half = float(leaf.mesh.bounds[1, 0])
            for gap, corner_side, left in ((start, LEFT[side], False), (wall.length - stop, RIGHT[side], True)):
                if not _LEAF_CORNER[0] <= gap <= _LEAF_CORNER[1]:
                    continue
                # The next wall meets this one at its right end (left neighbour) or its left end (right neighbour).
                beside = a.room.wall(corner_side)
                along = half + _HINGE_GAP if left else beside.length - half - _HINGE_GAP
                at = beside.point(along, 0.0, gap - _LEAF_OFFSET)
                yaw = beside.yaw + (0.0 if left else 180.0)
                low, high = world_box(leaf, at, yaw)
                others = [(p, q) for other, p, q in a.doorways if other is not opening]
                if not any(overlaps(low[None], high[None], p[None], q[None])[0, 0] for p, q in others):
                    a.place_free(leaf, at[[0, 2]], yaw, zones=False)
                break
