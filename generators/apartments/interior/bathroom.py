"""The bathroom."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.fittings import (
    cornered,
    depth_of,
    doors_of,
    facing_door,
    near,
    radiator,
    shelf_board,
)
from generators.apartments.interior.pieces import Placed, Spot
from generators.apartments.interior.walking import free_rectangle, walkable, wall_spots

Array = NDArray[np.float64]


def _machine_spots(a: Arranger) -> int:
    """How many washing machines still fit at the walls, 1 m apart."""
    return wall_spots(a, 0.66, 0.64, 0.95, 1.0)


def _spare(a: Arranger, furnish_more: Callable[[], object]) -> None:
    """Add what the room can spare: taken back where it leaves fewer than four spots for machines and toilet."""
    before = a.snapshot()
    spots = _machine_spots(a)
    furnish_more()
    if _machine_spots(a) < min(spots, 4):
        a.revert(before)


def _shower(a: Arranger, score: Callable[[Spot], float]) -> tuple[Placed, Spot] | None:
    """The shower has tiles at its back and on its left: it stands in the left corner of a wall."""
    shower = a.model("shower")
    found = [s for s in a.spots(shower, where=Where(gap=0.002, front=0.5)) if s.extent[0] < 0.01]
    if not found:
        return None
    spot = max(found, key=lambda s: score(s) + a.rng.uniform(0, 0.5))
    return a.put(shower, spot, front=0.5), spot


def furnish_bathroom(a: Arranger) -> float:
    """Tub or shower in a corner, washbasin and cabinet, towels, mat, basket; free walls for machines and toilet."""
    doors = doors_of(a)
    far = near(doors.mean(axis=0), -0.5)
    tub = a.seed % 3 != 2
    main = None
    if tub:
        main = a.place(
            "bathtub",
            score=lambda s: cornered(s) + far(s) + (0.3 if s.wall.length < 3.3 else 0.0),
            where=Where(front=0.5),
        )
    if main is None:
        main = _shower(a, far)
    if main is None:
        return 0.0
    view = facing_door(a)
    basin = a.place("washbasin", score=lambda s: 1.5 * view(s), where=Where(front=0.6, margin=0.12, top=2.0))
    if basin is None:
        return 0.0
    _tub_piece, tub_spot = main
    spot = basin[1]
    cabinet = a.model("vanity_cabinet")
    height = max(1.14, float(basin[0].high[1]) + 0.02) - float(cabinet.mesh.bounds[0, 1])
    at = spot.wall.point(spot.along, 0.0)
    if a.place_free(cabinet, at[[0, 2]], spot.wall.yaw, height=height) is None:
        return 0.0
    mat = a.model("bath_mat")
    depth = float(mat.mesh.bounds[1, 2] - mat.mesh.bounds[0, 2])
    front = tub_spot.centre + tub_spot.wall.normal * (depth_of(tub_spot) / 2 + depth / 2 + 0.05)
    a.place_free(mat, front[[0, 2]], tub_spot.wall.yaw)
    rail = a.model("towel_rail")
    a.place(
        "towel_rail",
        score=near(tub_spot.centre, 1.0),
        where=Where(height=0.95 - float(rail.mesh.bounds[0, 1]), margin=0.05),
    )
    # Small things stand close to the fixtures and leave long stretches of wall.
    a.place("laundry_basket", score=lambda s: 1.5 * cornered(s) + near(tub_spot.centre, 0.3)(s))
    _spare(
        a,
        lambda: a.place(
            "bathroom_cabinet",
            score=lambda s: near(spot.centre, 1.0)(s) + 0.5 * cornered(s),
            jitter=0.8,
            where=Where(front=0.35),
        ),
    )
    if rail.mesh.bounds[1, 1] - rail.mesh.bounds[0, 1] < 1.0:
        _spare(a, lambda: radiator(a, 0.5))  # a ladder rail warms the room by itself
    _spare(a, lambda: a.place("waste_bin", score=lambda s: 1.5 * cornered(s) + near(spot.centre, 0.5)(s)))
    _beside_basin(a, spot)
    shelf_board(a, copy=3, score=near(tub_spot.centre, 0.5))
    spots = _machine_spots(a)
    if walkable(a) < 1.2 or not free_rectangle(a, 1.6, 1.8):
        return 0.0
    return min(spots, 4) / 4


def _beside_basin(a: Arranger, spot: Spot) -> None:
    """A mat before the washbasin, where none lies near, and hooks beside it."""
    second = a.model("bath_mat", 1)
    reach = depth_of(spot) / 2 + float(second.mesh.bounds[1, 2]) + 0.04
    if not any(p.flat and np.linalg.norm((p.position - spot.centre)[[0, 2]]) < 1.1 for p in a.placed):
        a.place_free(second, (spot.centre + spot.wall.normal * reach)[[0, 2]], spot.wall.yaw)
    hooks = a.model("towel_rail", 1)
    if hooks.mesh.bounds[1, 1] - hooks.mesh.bounds[0, 1] < 0.8:
        a.place(
            "towel_rail",
            copy=1,
            score=near(spot.centre),
            where=Where(height=0.98 - float(hooks.mesh.bounds[0, 1]), margin=0.05),
        )
