"""A place to eat: a table with chairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.apartments.interior.arrange import Arranger, Options, Where
from generators.apartments.interior.pieces import Placed
from generators.apartments.interior.walking import walkable

Array = NDArray[np.float64]

#: Lower edge of the lamp over the table.
PENDANT_BOTTOM = 1.6


def dining(a: Arranger) -> Placed | None:
    """A table with two chairs or more, lengthwise or endwise at a wall away from the units; a small one if need be."""
    solid = [p for p in a.placed if p.furniture.kind == "kitchen_counter"]
    sizes: tuple[Options, ...] = ({}, {"length": 1.25}, {"length": 0.9})
    for options in sizes if a.room.area > 15 else sizes[1:]:
        table = a.model("dining_table", **options)
        found = []
        for turn, bonus in ((0.0, 0.2), (90.0, 0.0)):
            for spot in a.spots(table, where=Where(gap=0.04, turn=turn)):
                away = min(
                    (float(np.linalg.norm((p.low + p.high)[[0, 2]] / 2 - spot.centre[[0, 2]])) for p in solid),
                    default=0,
                )
                value = bonus + 0.6 * min(away, 3.0) - 0.6 * min(spot.corner, 0.8) + a.rng.uniform(0, 0.5)
                found.append((value, spot))
        before = a.snapshot()
        best: tuple[int, list[Placed], Placed] | None = None
        for _, spot in sorted(found, key=lambda pair: -pair[0])[:16]:
            piece = a.put(table, spot)
            seats = chairs_round(a, piece, 4)
            if seats >= 2 and (best is None or seats > best[0]) and walkable(a) > 2.5:
                best = (seats, list(a.placed), piece)
            a.revert(before)
            if best is not None and best[0] == 4:
                break
        if best is not None:
            a.placed[:] = best[1]
            return best[2]
    return None


def chairs_round(a: Arranger, table: Placed, count: int, *, tucked: float = 0.2, zones: bool = True) -> int:
    """Draw up to ``count`` chairs to the free sides of a table, by ``tucked`` metres; returns how many found room."""
    chair = a.model("chair")
    _low, high = chair.mesh.bounds.astype(np.float64)
    centre, size = (table.low + table.high) / 2, table.high - table.low
    seats = []
    for axis, across in ((0, 2), (2, 0)):
        places = int(size[across] // 0.6)
        for sign in (-1.0, 1.0):
            for k in range(places):
                at = centre.copy()
                at[across] += size[across] * ((k + 0.5) / places - 0.5)
                at[axis] += sign * (size[axis] / 2 + high[2] - tucked)
                # The chair's front (+Z) looks at the table.
                toward = np.zeros(3)
                toward[axis] = -sign
                seats.append(
                    (
                        float(size[across]) + a.rng.uniform(0, 0.05),
                        at,
                        float(np.degrees(np.arctan2(toward[0], toward[2]))),
                    )
                )
    done = 0
    for _, at, yaw in sorted(seats, key=lambda seat: -seat[0]):
        turn = yaw + float(a.rng.uniform(-6, 6))
        if done < count and a.place_free(chair, at[[0, 2]], turn, ignore=(table,), zones=zones) is not None:
            done += 1
    return done
