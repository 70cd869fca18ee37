"""What every kind of room has: lamps, curtains, radiators, doors, pictures; and scores for places."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import LEFT, RIGHT, SIDES
from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.pieces import Spot, overlaps, world_box

Array = NDArray[np.float64]


def near(point: Array | Sequence[float], weight: float = 1.0) -> Callable[[Spot], float]:
    """Score: the nearer to a point (x, y, z), the better."""
    target = np.asarray(point, dtype=np.float64)[[0, 2]]
    return lambda spot: -weight * float(np.linalg.norm(spot.centre[[0, 2]] - target))


def cornered(spot: Spot) -> float:
    """Score: in a corner."""
    return -2.0 * min(spot.corner, 1.0)


def doors_of(a: Arranger) -> Array:
    """(N, 3) middles of the room's doors and passages."""
    out = []
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind != "window":
                out.append(wall.point(sum(wall.along(opening.start, opening.stop)) / 2, 0.0))
    return np.array(out).reshape(-1, 3)


def facing_door(a: Arranger) -> Callable[[Spot], float]:
    """Score: what one sees on entering, on a wall the door looks at."""
    doors = doors_of(a)

    def score(spot: Spot) -> float:
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
            width = min(1.25 * (along[1] - along[0]) + 0.5, wall.length - 0.1)
            furniture = a.model("curtains", 0, width=round(width, 3), height=round(min(a.plan.height - 0.12, 2.45), 3))
            low, high = furniture.mesh.bounds
            middle = float(np.clip(sum(along) / 2, -low[0] + 0.01, wall.length - high[0] - 0.01))
            position = wall.point(middle, 0.03 - float(low[1]), 0.03 - float(low[2]))
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
    height = 0.02 - float(furniture.mesh.bounds[0, 1])

    def score(spot: Spot) -> float:
        return -min((float(np.linalg.norm((spot.centre - p)[[0, 2]])) for p in panes), default=0.0)

    a.place("radiator", score=score, jitter=0.05, options=options, where=Where(height=height))


def lamps(a: Arranger) -> None:
    """Ceiling lamps along the room's longer axis, one for every 4 m; flat discs in the plainer rooms."""
    r = a.room
    flush = r.name in ("bathroom", "hall", "kitchen")
    size = np.array([r.x1 - r.x0, r.z1 - r.z0])
    axis = int(np.argmax(size))
    count = max(1, round(float(size[axis]) / 4.2))
    for k in range(count):
        centre = np.array([r.x0 + r.x1, r.z0 + r.z1]) / 2
        centre[axis] += size[axis] * ((k + 0.5) / count - 0.5)
        lamp = a.model("ceiling_lamp", drop=0) if flush else a.model("ceiling_lamp")
        a.place_free(lamp, centre, 0.0, height=a.plan.height, windows=False)


def pictures(a: Arranger, count: int, *, height: float = 1.55, score: Callable[[Spot], float] | None = None) -> None:
    """Up to ``count`` pictures on the walls, their middles at ``height``."""
    for copy in range(count):
        a.place("picture", copy=copy, score=score, where=Where(height=height, margin=0.12))


def width_of(spot: Spot) -> float:
    """How much of the wall a piece covers."""
    return spot.extent[1] - spot.extent[0]


def depth_of(spot: Spot) -> float:
    """How far a piece reaches into the room."""
    axis = int(np.argmax(np.abs(spot.wall.normal)))
    return float(spot.high[axis] - spot.low[axis])


def shelf_board(a: Arranger, copy: int = 0, score: Callable[[Spot], float] | None = None) -> None:
    """A board on the wall with a few things on it, above nothing in particular."""
    board = a.model("shelf_board", copy)
    a.place(
        "shelf_board", copy=copy, score=score, where=Where(height=1.4 - float(board.mesh.bounds[0, 1]), margin=0.15)
    )


def door_leaves(a: Arranger) -> None:
    """Leaves of doors beside a corner of the room they open into, standing open along the next wall."""
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind != "door":
                continue
            start, stop = wall.along(opening.start, opening.stop)
            leaf = a.model("door_leaf", width=round(stop - start - 0.02, 3), height=round(opening.top - 0.015, 3))
            half = float(leaf.mesh.bounds[1, 0])
            for gap, corner_side, left in ((start, LEFT[side], False), (wall.length - stop, RIGHT[side], True)):
                if not 0.12 <= gap <= 0.32:
                    continue
                # The next wall meets this one at its right end (left neighbour) or its left end (right neighbour).
                beside = a.room.wall(corner_side)
                along = half + 0.02 if left else beside.length - half - 0.02
                at = beside.point(along, 0.0, gap - 0.03)
                yaw = beside.yaw + (0.0 if left else 180.0)
                low, high = world_box(leaf, at, yaw)
                others = [(p, q) for other, p, q in a.doorways if other is not opening]
                if not any(overlaps(low[None], high[None], p[None], q[None])[0, 0] for p, q in others):
                    a.place_free(leaf, at[[0, 2]], yaw, zones=False)
                break
