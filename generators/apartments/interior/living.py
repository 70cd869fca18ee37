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
from generators.apartments.interior.pieces import Placed, WallSpot, world_box
from generators.apartments.interior.walking import FloorDemand

Array = NDArray[np.float64]

#: Free width on both sides of the television's stand (m).
_STAND_MARGIN = 0.05
#: Gap between the wall and a sofa that stands before a window (m): room for the radiator below it and for the curtains.
_SOFA_WINDOW_GAP = 0.22
#: A sofa faces the television if their middles differ by at most this along the wall (m).
_MOST_SHIFT = 0.35
#: Distance between the middles of sofa and television (m) that is best where both stand at walls.
_VIEWING_DISTANCE = 3.8
#: Score of such a pair, per metre: loss by shift, by deviation from `_VIEWING_DISTANCE`, by distance of the sofa from
#: the middle of its wall; and the upper limit of the random part.
_SHIFT_WEIGHT, _DISTANCE_WEIGHT, _MIDDLE_WEIGHT, _PAIR_JITTER = 2, 0.5, 0.25, 0.8
#: Distance from the middle of the television's stand to the front of a sofa that stands free in the room (m).
_FREE_DISTANCE = 2.9
#: Upper limit of the random part of the score of a television before such a sofa.
_FREE_JITTER = 0.5

#: Gap between sofa and coffee table, and between coffee table and armchair (m): as much as lets a person sit down and
#: reach the table.
_TABLE_GAP, _CHAIR_GAP = 0.4, 0.4
#: The rug is this much longer than the sofa (m), and its middle is this much nearer to the sofa than the table's (m),
#: so that it reaches below the sofa's front edge.
_RUG_EXTRA, _RUG_SHIFT = 0.2, 0.12
#: How much further from the sofa than the table's middle the armchair's may be (m).
_CHAIR_SHIFT = 0.25
#: The armchair faces the table, turned towards the television by an angle in this range (degrees).
_CHAIR_TURN = (8, 22)

#: Free floor before the sideboard, and before bookshelves (m): as much as lets a person open a door or take a book.
_SIDEBOARD_FRONT, _SHELF_FRONT = 0.5, 0.45
#: Free width on both sides of the sideboard (m).
_SIDEBOARD_MARGIN = 0.05
#: Loss of score per metre between the sideboard's middle and the middle of its wall.
_SIDEBOARD_MIDDLE = 0.2
#: Living rooms that are larger than this (m²) have a second bookshelf.
_LARGE = 23
#: Height of the plant (m).
_PLANT_HEIGHT = 0.95
#: Height above the floor of the middle of the picture over the sofa, and of two further ones (m).
_SOFA_PICTURE, _PICTURES = 1.6, 1.55
#: Loss of score per metre between the first picture and the place over the sofa: it hangs there wherever it can.
_PICTURE_NEAR = 3.0
#: Floor that must remain free.
_FLOOR = FloorDemand(area=5.0, rectangle=(1.5, 2.0))
#: Quality of a living room that has its sofa group, and what sideboard, bookshelf, a second side table and the free
#: floor add.
_SOFA_QUALITY, _SIDEBOARD_QUALITY, _BOOKSHELF_QUALITY, _TABLE_QUALITY, _FLOOR_QUALITY = 0.4, 0.2, 0.2, 0.1, 0.1


def _sofa_and_television(a: Arranger) -> tuple[Placed, WallSpot, WallSpot] | None:
    """Place sofa and television opposite each other: the sofa at a wall, or free in the room if no wall has space.

    Returns:
        The sofa, its spot and the television's, or None if they do not fit.
    """
    sofa, stand = a.model("sofa"), a.model("tv_stand")
    depth = float(sofa.mesh.bounds[1, 2] - sofa.mesh.bounds[0, 2])
    stands = a.spots(stand, where=Where(margin=_STAND_MARGIN))
    seats = a.spots(sofa) + a.spots(sofa, where=Where(gap=_SOFA_WINDOW_GAP, windows=False))
    best: tuple[float, WallSpot, WallSpot] | None = None
    for tv in stands:
        across = 0 if abs(tv.wall.u[0]) > 0.5 else 2
        for seat in seats:
            if seat.wall.side != OPPOSITE[tv.wall.side]:
                continue
            shift = abs(float(seat.centre[across] - tv.centre[across]))
            if shift > _MOST_SHIFT:
                continue
            apart = float(np.linalg.norm((seat.centre - tv.centre)[[0, 2]]))
            middle = abs(seat.along - seat.wall.length / 2)
            value = (
                -_SHIFT_WEIGHT * shift
                - abs(apart - _VIEWING_DISTANCE) * _DISTANCE_WEIGHT
                - _MIDDLE_WEIGHT * middle
                + a.rng.uniform(0, _PAIR_JITTER)
            )
            if best is None or value > best[0]:
                best = (value, tv, seat)
    if best is None:
        for tv in stands:
            wall = a.room.wall(OPPOSITE[tv.wall.side])
            reach = _FREE_DISTANCE + depth / 2
            position = tv.centre + tv.wall.normal * reach
            position[1] = 0.0
            box = world_box(sofa, position, wall.yaw)
            if a.free(box[0][None], box[1][None])[0]:
                value = -abs(tv.along - tv.wall.length / 2) + a.rng.uniform(0, _FREE_JITTER)
                if best is None or value > best[0]:
                    along = float((position - wall.origin) @ wall.u)
                    best = (value, tv, WallSpot(wall, along, position, wall.yaw, *box))
    if best is None:
        return None
    _, tv, seat = best
    a.put(stand, tv)
    return a.put(sofa, seat), seat, tv


def _seating(a: Arranger) -> WallSpot | None:
    """Place the sofa group: television, coffee table on a rug, armchair, side table, lamp; returns the sofa's spot."""
    group = _sofa_and_television(a)
    if group is None:
        return None
    _, seat, _tv = group
    normal, u = seat.wall.normal, seat.wall.u
    table = a.model("coffee_table")
    t_low, t_high = table.mesh.bounds.astype(np.float64)
    reach = depth_of(seat) / 2 + _TABLE_GAP + (t_high[2] - t_low[2]) / 2
    centre = seat.centre + normal * reach
    rug = a.model("rug", length=round(width_of(seat) + _RUG_EXTRA, 2))
    a.place_free(rug, (centre - normal * _RUG_SHIFT)[[0, 2]], seat.wall.yaw)
    a.place_free(table, centre[[0, 2]], seat.wall.yaw)
    beside = seat.centre.copy()
    a.place("side_table", score=near(beside), jitter=0.0, where=Where(sides=[seat.wall.side]))
    a.place("floor_lamp", score=near(beside), jitter=0.0, where=Where(sides=[seat.wall.side]))
    chair = a.model("armchair")
    half = float(chair.mesh.bounds[1, 2] - chair.mesh.bounds[0, 2]) / 2
    for sign in a.rng.permutation([-1.0, 1.0]):
        aside = (t_high[0] - t_low[0]) / 2 + _CHAIR_GAP + half
        at = centre + u * sign * aside + normal * a.rng.uniform(0.0, _CHAIR_SHIFT)
        # A chair on the sofa's right (+u) looks back along −u, turned a little towards the television.
        yaw = seat.wall.yaw - sign * 90.0 + sign * float(a.rng.uniform(*_CHAIR_TURN))
        if a.place_free(chair, at[[0, 2]], yaw) is not None:
            break
    return seat


def furnish_living_room(a: Arranger) -> float:
    """Furnish a living room: sofa group, shelves, sideboard, plant, curtains, pictures; returns its quality, 0 to 1."""
    curtains(a)
    door_leaves(a)
    seat = _seating(a)
    if seat is None:
        return 0.0
    sideboard = a.place(
        "sideboard",
        score=lambda s: -abs(s.along - s.wall.length / 2) * _SIDEBOARD_MIDDLE,
        where=Where(front=_SIDEBOARD_FRONT, margin=_SIDEBOARD_MARGIN),
    )
    bookshelf = a.place("bookshelf", score=cornered, where=Where(front=_SHELF_FRONT))
    if a.room.area > _LARGE:
        a.place("bookshelf", score=cornered, where=Where(front=_SHELF_FRONT))
    a.place("plant", score=cornered, options={"height": _PLANT_HEIGHT})
    side_table = a.place("side_table", copy=1, score=cornered)
    radiator(a)
    shelf_board(a)
    pictures(a, 1, height=_SOFA_PICTURE, score=near(seat.wall.point(seat.along, _SOFA_PICTURE), _PICTURE_NEAR))
    pictures(a, 2, height=_PICTURES)
    if not _FLOOR.met(a):
        return 0.0
    quality = _SOFA_QUALITY + _SIDEBOARD_QUALITY * (sideboard is not None)
    quality += _BOOKSHELF_QUALITY * (bookshelf is not None)
    quality += _TABLE_QUALITY * (side_table is not None)
    return quality + _FLOOR_QUALITY
