"""The living room: a sofa group before a television, shelves, a sideboard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import OPPOSITE
from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.fittings import (
    cornered,
    curtains,
    depth_of,
    door_leaves,
    near,
    pictures,
    radiator,
    shelf_board,
    width_of,
)
from generators.apartments.interior.pieces import Placed, Spot, world_box
from generators.apartments.interior.walking import free_rectangle, walkable

Array = NDArray[np.float64]


def _sofa_and_television(a: Arranger) -> tuple[Placed, Spot, Spot] | None:
    """Sofa and television face to face: the sofa at the opposite wall, or free in the room where there is no place."""
    sofa, stand = a.model("sofa"), a.model("tv_stand")
    depth = float(sofa.mesh.bounds[1, 2] - sofa.mesh.bounds[0, 2])
    stands = a.spots(stand, where=Where(margin=0.05))
    seats = a.spots(sofa) + a.spots(sofa, where=Where(gap=0.22, windows=False))
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
    _, seat, _tv = group
    normal, u = seat.wall.normal, seat.wall.u
    table = a.model("coffee_table")
    t_low, t_high = table.mesh.bounds.astype(np.float64)
    reach = depth_of(seat) / 2 + 0.4 + (t_high[2] - t_low[2]) / 2
    centre = seat.centre + normal * reach
    a.place_free(a.model("rug", length=round(width_of(seat) + 0.2, 2)), (centre - normal * 0.12)[[0, 2]], seat.wall.yaw)
    a.place_free(table, centre[[0, 2]], seat.wall.yaw)
    beside = seat.centre.copy()
    a.place("side_table", score=near(beside), jitter=0.0, where=Where(sides=[seat.wall.side]))
    a.place("floor_lamp", score=near(beside), jitter=0.0, where=Where(sides=[seat.wall.side]))
    chair = a.model("armchair")
    half = float(chair.mesh.bounds[1, 2] - chair.mesh.bounds[0, 2]) / 2
    for sign in a.rng.permutation([-1.0, 1.0]):
        at = centre + u * sign * ((t_high[0] - t_low[0]) / 2 + 0.4 + half) + normal * a.rng.uniform(0.0, 0.25)
        # A chair on the sofa's right (+u) looks back along −u, turned a little towards the television.
        yaw = seat.wall.yaw - sign * 90.0 + sign * float(a.rng.uniform(8, 22))
        if a.place_free(chair, at[[0, 2]], yaw) is not None:
            break
    return seat


def furnish_living_room(a: Arranger) -> float:
    """Sofa group, shelves, sideboard, plants, curtains, pictures."""
    curtains(a)
    door_leaves(a)
    seat = _seating(a)
    if seat is None:
        return 0.0
    quality = 0.4
    quality += 0.2 * (
        a.place(
            "sideboard", score=lambda s: -abs(s.along - s.wall.length / 2) * 0.2, where=Where(front=0.5, margin=0.05)
        )
        is not None
    )
    quality += 0.2 * (a.place("bookshelf", score=cornered, where=Where(front=0.45)) is not None)
    if a.room.area > 23:
        a.place("bookshelf", score=cornered, copy=0, where=Where(front=0.45))
    a.place("plant", score=cornered, options={"height": 0.95})
    quality += 0.1 * (a.place("side_table", copy=1, score=cornered) is not None)
    radiator(a)
    shelf_board(a)
    over = seat.wall.point(seat.along, 1.6)
    pictures(a, 1, height=1.6, score=near(over, 3.0))
    pictures(a, 2, height=1.55)
    if walkable(a) < 5.0 or not free_rectangle(a, 1.5, 2.0):
        return 0.0
    return quality + 0.1
