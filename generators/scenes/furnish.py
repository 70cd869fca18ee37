"""What stands where in each kind of room.

Every room is furnished several times with other random choices; the first arrangement that meets its room's demands
(walking area, free spots for the objects of the benchmark) is taken, or else the best one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.materials import Palette
from generators.scenes.arrange import Arranger, Placed, Spot, world_box
from generators.scenes.floorplan import SIDES, FloorPlan, RoomPlan, Side
from generators.scenes.kitchen import chairs_round, furnish_kitchen

Array = NDArray[np.float64]
ATTEMPTS = 14
OPPOSITE: dict[Side, Side] = {"north": "south", "south": "north", "east": "west", "west": "east"}


def near(point: Array | Sequence[float], weight: float = 1.0) -> Callable[[Spot], float]:
    """Score: the nearer to a point (x, y, z), the better."""
    target = np.asarray(point, dtype=np.float64)[[0, 2]]
    return lambda spot: -weight * float(np.linalg.norm(spot.centre[[0, 2]] - target))


def cornered(spot: Spot) -> float:
    """Score: in a corner."""
    return -2.0 * min(spot.corner, 1.0)


def doors_seen_from(a: Arranger) -> Array:
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
    doors = doors_seen_from(a)

    def score(spot: Spot) -> float:
        if not len(doors):
            return 0.0
        toward = doors - spot.centre
        toward[:, 1] = 0
        toward /= np.linalg.norm(toward, axis=1, keepdims=True) + 1e-9
        return float((toward @ spot.wall.normal).max())

    return score


def _curtains(a: Arranger) -> None:
    """Curtains at every window of the room."""
    for side in SIDES:
        wall = a.room.wall(side)
        for copy, opening in enumerate(o for o in a.plan.openings_of(a.room.name, side) if o.kind == "window"):
            along = wall.along(opening.start, opening.stop)
            width = min(along[1] - along[0] + 0.5, wall.length - 0.04)
            furniture = a.model("curtains", 0, width=round(width, 3), height=round(min(a.plan.height - 0.12, 2.45), 3))
            low, high = furniture.mesh.bounds
            middle = float(np.clip(sum(along) / 2, -low[0] + 0.01, wall.length - high[0] - 0.01))
            position = wall.point(middle, 0.03 - float(low[1]), 0.03 - float(low[2]))
            a.place_free(furniture, position[[0, 2]], wall.yaw, height=float(position[1]), windows=False, zones=False)


def _radiator(a: Arranger) -> None:
    """A radiator below a window where that is free, else on a free wall."""
    panes = []
    for side in SIDES:
        wall = a.room.wall(side)
        for opening in a.plan.openings_of(a.room.name, side):
            if opening.kind == "window":
                panes.append(wall.point(sum(wall.along(opening.start, opening.stop)) / 2, 0.0))
    furniture = a.model("radiator")
    height = 0.12 - float(furniture.mesh.bounds[0, 1])

    def score(spot: Spot) -> float:
        return -min((float(np.linalg.norm((spot.centre - p)[[0, 2]])) for p in panes), default=0.0)

    a.place("radiator", score=score, height=height, jitter=0.05)


def _lamps(a: Arranger) -> None:
    """Ceiling lamps along the room's longer axis, one for every 4 m."""
    r = a.room
    size = np.array([r.x1 - r.x0, r.z1 - r.z0])
    axis = int(np.argmax(size))
    count = max(1, round(float(size[axis]) / 4.2))
    for k in range(count):
        centre = np.array([r.x0 + r.x1, r.z0 + r.z1]) / 2
        centre[axis] += size[axis] * ((k + 0.5) / count - 0.5)
        a.place_free(a.model("ceiling_lamp"), centre, 0.0, height=a.plan.height, windows=False)


def _pictures(a: Arranger, count: int, *, height: float = 1.55, score: Callable[[Spot], float] | None = None) -> None:
    for copy in range(count):
        a.place("picture", copy=copy, height=height, score=score, margin=0.12)


def _bathroom(a: Arranger) -> float:
    """Tub or shower in a corner, washbasin with its mirror, towels, mat, basket; free walls for machines and toilet."""
    doors = doors_seen_from(a)
    far = near(doors.mean(axis=0), -0.5)
    tub = a.seed % 3 != 2
    main = a.place(
        "bathtub" if tub else "shower",
        score=lambda s: cornered(s) + far(s) + (0.3 if s.wall.length < 3.3 else 0.0),
        front=0.5,
    )
    if main is None:
        main = a.place("shower", score=lambda s: cornered(s) + far(s), front=0.5)
    if main is None:
        return 0.0
    view = facing_door(a)
    basin = a.place("washbasin", score=lambda s: 1.5 * view(s), front=0.6, margin=0.12, top=2.0)
    if basin is None:
        return 0.0
    tub_piece, tub_spot = main
    mirror = a.model("mirror")
    spot = basin[1]
    if basin[0].high[1] < 1.3:
        at = spot.wall.point(spot.along, 1.55)
        a.place_free(mirror, at[[0, 2]], spot.wall.yaw, height=1.55)
    mat = a.model("bath_mat")
    depth = float(mat.mesh.bounds[1, 2] - mat.mesh.bounds[0, 2])
    front = tub_spot.centre + tub_spot.wall.normal * (_depth(tub_spot) / 2 + depth / 2 + 0.05)
    a.place_free(mat, front[[0, 2]], tub_spot.wall.yaw)
    a.place("towel_rail", height=1.45, score=near(tub_spot.centre, 1.0), margin=0.05)
    # Small things stand close to the fixtures and leave long stretches of wall.
    a.place("bathroom_cabinet", score=lambda s: near(spot.centre, 1.0)(s) + 0.5 * cornered(s), front=0.35, jitter=0.8)
    a.place("laundry_basket", score=lambda s: 1.5 * cornered(s) + near(tub_spot.centre, 0.3)(s))
    _radiator(a)
    spots = a.wall_spots(0.66, 0.64, 0.95, 1.0)
    if a.walkable() < 1.2 or not a.free_rectangle(1.6, 1.8):
        return 0.0
    return min(spots, 4) / 4


def _depth(spot: Spot) -> float:
    """How far a piece reaches into the room."""
    axis = int(np.argmax(np.abs(spot.wall.normal)))
    return float(spot.high[axis] - spot.low[axis])


def _sofa_and_television(a: Arranger) -> tuple[Placed, Spot, Spot] | None:
    """Sofa and television face to face: the sofa at the opposite wall, or free in the room where there is no place."""
    sofa, stand = a.model("sofa"), a.model("tv_stand")
    depth = float(sofa.mesh.bounds[1, 2] - sofa.mesh.bounds[0, 2])
    stands = a.spots(stand, margin=0.05)
    seats = a.spots(sofa) + a.spots(sofa, gap=0.22, windows=False)
    best: tuple[float, Spot, Spot] | None = None
    for tv in stands:
        across = 0 if abs(tv.wall.u[0]) > 0.5 else 2
        for seat in seats:
            if seat.wall.side != OPPOSITE[tv.wall.side]:
                continue
            shift = abs(float(seat.centre[across] - tv.centre[across]))
            if shift > 0.35:
                continue
            apart = float(np.linalg.norm((seat.centre - tv.centre)[[0, 2]]))
            middle = abs(seat.along - seat.wall.length / 2)
            value = -2 * shift - abs(apart - 3.8) * 0.5 - 0.25 * middle + a.rng.uniform(0, 0.8)
            if best is None or value > best[0]:
                best = (value, tv, seat)
    if best is None:
        for tv in stands:
            wall = a.room.wall(OPPOSITE[tv.wall.side])
            reach = 2.9 + depth / 2
            position = tv.centre + tv.wall.normal * reach
            position[1] = 0.0
            box = world_box(sofa, position, wall.yaw)
            if a.free(box[0][None], box[1][None])[0]:
                value = -abs(tv.along - tv.wall.length / 2) + a.rng.uniform(0, 0.5)
                if best is None or value > best[0]:
                    along = float((position - wall.origin) @ wall.u)
                    best = (value, tv, Spot(wall, along, position, wall.yaw, *box))
    if best is None:
        return None
    _, tv, seat = best
    a.put(stand, tv)
    return a.put(sofa, seat), seat, tv


def _seating(a: Arranger) -> Spot | None:
    """The sofa group: television opposite, coffee table on a rug, armchair, side table and lamp beside."""
    group = _sofa_and_television(a)
    if group is None:
        return None
    _, seat, tv = group
    normal, u = seat.wall.normal, seat.wall.u
    table = a.model("coffee_table")
    t_low, t_high = table.mesh.bounds.astype(np.float64)
    reach = _depth(seat) / 2 + 0.4 + (t_high[2] - t_low[2]) / 2
    centre = seat.centre + normal * reach
    a.place_free(a.model("rug"), (centre - normal * 0.15)[[0, 2]], seat.wall.yaw)
    a.place_free(table, centre[[0, 2]], seat.wall.yaw)
    beside = seat.centre.copy()
    a.place("side_table", sides=[seat.wall.side], score=near(beside), jitter=0.0)
    a.place("floor_lamp", sides=[seat.wall.side], score=near(beside), jitter=0.0)
    chair = a.model("armchair")
    half = float(chair.mesh.bounds[1, 2] - chair.mesh.bounds[0, 2]) / 2
    for sign in a.rng.permutation([-1.0, 1.0]):
        at = centre + u * sign * ((t_high[0] - t_low[0]) / 2 + 0.4 + half) + normal * a.rng.uniform(0.0, 0.25)
        # A chair on the sofa's right (+u) looks back along −u, turned a little towards the television.
        yaw = seat.wall.yaw - sign * 90.0 + sign * float(a.rng.uniform(8, 22))
        if a.place_free(chair, at[[0, 2]], yaw) is not None:
            break
    return seat


def _living_room(a: Arranger) -> float:
    """Sofa group, shelves, sideboard, plants, curtains, pictures."""
    _curtains(a)
    seat = _seating(a)
    if seat is None:
        return 0.0
    quality = 0.4
    quality += 0.2 * (a.place("sideboard", score=lambda s: -abs(s.along - s.wall.length / 2) * 0.2, front=0.5, margin=0.05) is not None)
    quality += 0.2 * (a.place("bookshelf", score=cornered, front=0.45) is not None)
    if a.room.area > 23:
        a.place("bookshelf", score=cornered, front=0.45, copy=0)
    a.place("plant", score=cornered)
    quality += 0.1 * (a.place("side_table", copy=1, score=cornered) is not None)
    _radiator(a)
    over = seat.wall.point(seat.along, 1.6)
    _pictures(a, 1, height=1.6, score=near(over, 3.0))
    _pictures(a, 2, height=1.55)
    if a.walkable() < 5.0 or not a.free_rectangle(1.5, 2.0):
        return 0.0
    return quality + 0.1


def _bedroom(a: Arranger) -> float:
    """Bed between nightstands, wardrobe, desk with chair."""
    _curtains(a)
    bed = a.place("bed", score=lambda s: -abs(s.along - s.wall.length / 2) * 0.5, front=0.6, margin=0.45)
    if bed is None:
        bed = a.place("bed", score=cornered, front=0.5)
    if bed is None:
        return 0.0
    _, spot = bed
    for _ in range(2):
        a.place("nightstand", sides=[spot.wall.side], score=near(spot.centre), jitter=0.0)
    rug = a.model("rug")
    a.place_free(rug, (spot.centre + spot.wall.normal * 0.7)[[0, 2]], spot.wall.yaw)
    quality = 0.5 + 0.3 * (a.place("wardrobe", score=cornered, front=0.6) is not None)
    desk = a.place("desk", front=0.5)
    if desk is not None:
        chairs_round(a, desk[0], 1)
        quality += 0.1
    a.place("plant", score=cornered, copy=2)
    _radiator(a)
    _pictures(a, 1, height=1.65, score=near(spot.wall.point(spot.along, 1.6), 3.0))
    return quality if a.walkable() > 1.5 else 0.0


def _hall(a: Arranger) -> float:
    """Shoe cabinet, coats, mirror, runner."""
    cabinet = a.place("shoe_cabinet", front=0.6)
    if cabinet is not None:
        spot = cabinet[1]
        at = spot.wall.point(spot.along, 1.6)
        a.place_free(a.model("mirror"), at[[0, 2]], spot.wall.yaw, height=1.6)
    a.place("coat_rack", height=1.65, score=near(doors_seen_from(a)[-1], 0.5))
    _pictures(a, 2)
    return 1.0 if a.walkable() > 1.0 else 0.0


RULES: dict[str, Callable[[Arranger], float]] = {
    "bathroom": _bathroom,
    "kitchen": furnish_kitchen,
    "living_room": _living_room,
    "bedroom": _bedroom,
    "hall": _hall,
}


def furnish(plan: FloorPlan, room: RoomPlan, palette: Palette, seed: int, rng: Generator) -> Arranger:
    """Furnish one room.

    Args:
        plan: the flat.
        room: the room.
        palette: materials.
        seed: of the flat; decides the furniture's shapes.
        rng: decides their places.

    Returns:
        The room with everything in its place.
    """
    empty = Arranger(plan, room, palette, seed, rng)
    best, best_quality = empty, -1.0
    for child in rng.spawn(ATTEMPTS):
        attempt = empty.restart(child)
        _lamps(attempt)
        quality = RULES[room.name](attempt)
        if quality > best_quality:
            best, best_quality = attempt, quality
        if quality >= 0.999:
            break
    return best
