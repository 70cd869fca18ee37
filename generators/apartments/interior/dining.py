"""The dining table and its chairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.apartments.interior.arrange import Arranger, Options, Where
from generators.apartments.interior.pieces import Placed
from generators.apartments.interior.walking import walkable

Array = NDArray[np.float64]

#: Height of the lower edge of the lamp over the table, above the floor (m): 0.85 m above the table's top, so that
#: people who sit there see each other below it.
PENDANT_BOTTOM = 1.6
#: Tables that are tried, from the largest on; without options the table has a length of its own.
_TABLES: tuple[Options, ...] = ({}, {"length": 1.25}, {"length": 0.9})
#: Kitchens from this area on (m²) try the largest table too.
_LARGE_KITCHEN = 15
#: Gap between a table and its wall (m).
_TABLE_GAP = 0.04
#: Turns of a table (degrees), with its long side or its end at the wall, and what each adds to the score of a place.
_TURNS = ((0.0, 0.2), (90.0, 0.0))
#: Score of a place per metre from the nearest counter, and the distance (m) from which on it stays the same.
_COUNTER_WEIGHT, _COUNTER_REACH = 0.6, 3.0
#: Loss per metre from the nearer corner, so that the table does not stand in the middle of a long wall, and the
#: distance (m) from which on it is the same.
_CORNER_WEIGHT, _CORNER_REACH = 0.6, 0.8
#: Upper limit of the random part of a place's score.
_JITTER = 0.5
#: Number of places, from the best on, at which a table is tried with its chairs: each costs a search for the ways.
_TRIES = 16
#: Chairs at a table: as many as are wanted, and as few as are accepted.
_CHAIRS, _LEAST_CHAIRS = 4, 2
#: Floor that must remain reachable once a table with its chairs is placed (m²).
_LEAST_WALKABLE = 2.5
#: Width of a table's side for each person (m): the usual place setting.
_PLACE_WIDTH = 0.6
#: How far chairs are pushed under a table (m).
_TUCKED = 0.2
#: Random part of a seat's score (m): it only decides between sides of the same length.
_SEAT_JITTER = 0.05
#: Chairs are turned by up to this angle to either side (degrees), as people leave them.
_CHAIR_TURN = 6


def dining(a: Arranger) -> Placed | None:
    """A table with two to four chairs at a wall, away from the counters; a smaller one where a large one does not fit.

    Returns:
        The table, or None if none fits.
    """
    solid = [p for p in a.placed if p.furniture.kind == "kitchen_counter"]
    for options in _TABLES if a.room.area > _LARGE_KITCHEN else _TABLES[1:]:
        table = a.model("dining_table", **options)
        found = []
        for turn, bonus in _TURNS:
            for spot in a.spots(table, where=Where(gap=_TABLE_GAP, turn=turn)):
                away = min(
                    (float(np.linalg.norm((p.low + p.high)[[0, 2]] / 2 - spot.centre[[0, 2]])) for p in solid),
                    default=0,
                )
                value = (
                    bonus
                    + _COUNTER_WEIGHT * min(away, _COUNTER_REACH)
                    - _CORNER_WEIGHT * min(spot.corner, _CORNER_REACH)
                    + a.rng.uniform(0, _JITTER)
                )
                found.append((value, spot))
        before = a.snapshot()
        best: tuple[int, list[Placed], Placed] | None = None
        for _, spot in sorted(found, key=lambda pair: -pair[0])[:_TRIES]:
            piece = a.put(table, spot)
            seats = chairs_round(a, piece, _CHAIRS)
            if seats >= _LEAST_CHAIRS and (best is None or seats > best[0]) and walkable(a) > _LEAST_WALKABLE:
                best = (seats, list(a.placed), piece)
            a.revert(before)
            if best is not None and best[0] == _CHAIRS:
                break
        if best is not None:
            a.placed[:] = best[1]
            return best[2]
    return None


def chairs_round(a: Arranger, table: Placed, count: int, *, zones: bool = True) -> int:
    """Push up to ``count`` chairs under a table's free sides, the longest sides first.

    Args:
        a: the room.
        table: a table or desk.
        count: most chairs.
        zones: whether the chairs must leave the reserved volumes free.

    Returns:
        How many chairs found room.
    """
    chair = a.model("chair")
    _low, high = chair.mesh.bounds.astype(np.float64)
    centre, size = (table.low + table.high) / 2, table.high - table.low
    seats = []
    for axis, across in ((0, 2), (2, 0)):
        places = int(size[across] // _PLACE_WIDTH)
        for sign in (-1.0, 1.0):
            for k in range(places):
                at = centre.copy()
                at[across] += size[across] * ((k + 0.5) / places - 0.5)
                at[axis] += sign * (size[axis] / 2 + high[2] - _TUCKED)
                # The chair's front (+Z) looks at the table.
                toward = np.zeros(3)
                toward[axis] = -sign
                seats.append(
                    (
                        float(size[across]) + a.rng.uniform(0, _SEAT_JITTER),
                        at,
                        float(np.degrees(np.arctan2(toward[0], toward[2]))),
                    )
                )
    done = 0
    for _, at, yaw in sorted(seats, key=lambda seat: -seat[0]):
        turn = yaw + float(a.rng.uniform(-_CHAIR_TURN, _CHAIR_TURN))
        if done < count and a.place_free(chair, at[[0, 2]], turn, ignore=(table,), zones=zones) is not None:
            done += 1
    return done
