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
from generators.apartments.interior.pieces import Placed, WallSpot, origin_height
from generators.apartments.interior.walking import FloorDemand, Size, wall_spots
from generators.assets.furniture import Furniture

Array = NDArray[np.float64]

#: Place that a washing machine takes at a wall (m): a machine of 0.60 m × 0.60 m × 0.85 m with some play on all sides.
MACHINE = Size(width=0.66, depth=0.64, height=0.95)
#: Distance between the middles of two such places (m), at least.
MACHINE_SPACING = 1.0
#: Places for machines and toilets that a bathroom should keep: up to two of each stand there in the benchmark.
MACHINE_PLACES = 4
#: Floor that must remain free.
_FLOOR = FloorDemand(area=1.2, rectangle=(1.6, 1.8))

#: One flat in this many has a shower in place of the bathtub.
_FLATS_PER_SHOWER = 3
#: Free floor before tub and shower, to get in and out (m).
_TUB_FRONT = 0.5
#: Score of a place for tub or shower per metre from the doors' mean position: far from the door is better.
_FAR_FROM_DOOR = 0.5
#: A tub's score at a wall shorter than this (m) is raised by this: there it leaves the longer walls free.
_SHORT_WALL, _SHORT_WALL_BONUS = 3.3, 0.3
#: Gap between a shower and the wall at its back (m), and the distance from a wall's end within which it counts as in
#: the corner (m).
_SHOWER_GAP, _SHOWER_CORNER = 0.002, 0.01
#: Upper limit of the random part of the score of a shower's place.
_SHOWER_JITTER = 0.5

#: Free floor before the washbasin (m): as much as a person takes who stands there.
_BASIN_FRONT = 0.6
#: Free width on both sides of the washbasin, for elbows (m), and height up to which the wall above it must be free for
#: the cabinet (m).
_BASIN_MARGIN, _BASIN_TOP = 0.12, 2.0
#: Weight of `facing_door` in the score of the washbasin's place.
_BASIN_IN_VIEW = 1.5
#: Height of the lower edge of the cabinet over the washbasin (m), and its gap above what is on the washbasin (m).
_VANITY_BOTTOM, _VANITY_GAP = 1.14, 0.02

#: Gap between the mat and the tub or shower (m).
_MAT_GAP = 0.05
#: Gap between a second mat and the washbasin (m); there is none if another mat's middle is this near to the
#: washbasin's (m).
_SECOND_MAT_GAP, _MAT_DISTANCE = 0.04, 1.1
#: Height of the lowest point of a towel rail, and of the second one, above the floor (m).
_RAIL_BOTTOM, _SECOND_RAIL_BOTTOM = 0.95, 0.98
#: Free wall on both sides of a towel rail (m).
_RAIL_MARGIN = 0.05
#: Towel rails of at least this height (m) are heated ladders (1.15 m); others are bars (0.44 m).
_LADDER = 1.0
#: Length of the radiator (m): short, for walls are scarce.
_RADIATOR_LENGTH = 0.5
#: Free floor before the cabinet, to open its doors (m), and the upper limit of the random part of its place's score.
_CABINET_FRONT, _CABINET_JITTER = 0.35, 0.8
#: Weights in the scores of the places of small things, which stand in corners and near the fixtures so that long
#: stretches of wall remain free: of `cornered` for basket and bin, and for the cabinet; per metre of distance for the
#: basket from the tub, the bin from the washbasin, the shelf board from the tub.
_SMALL_CORNERED, _CABINET_CORNERED = 1.5, 0.5
_BASKET_NEAR, _BIN_NEAR, _BOARD_NEAR = 0.3, 0.5, 0.5
#: Number of the bathroom's shelf board: other things lie on it than on the living room's.
_BOARD = 3


def _machine_spots(a: Arranger) -> int:
    """How many washing machines still fit at the walls."""
    return wall_spots(a, MACHINE, MACHINE_SPACING)


def _spare(a: Arranger, furnish_more: Callable[[], object]) -> None:
    """Add optional furniture; remove it again if it leaves too few places for machines and toilets."""
    before = a.snapshot()
    spots = _machine_spots(a)
    furnish_more()
    if _machine_spots(a) < min(spots, MACHINE_PLACES):
        a.revert(before)


def _shower(a: Arranger, score: Callable[[WallSpot], float]) -> tuple[Placed, WallSpot] | None:
    """Place a shower: it has tiles at its back and on its left, so it stands at the left end of a wall."""
    shower = a.model("shower")
    where = Where(gap=_SHOWER_GAP, front=_TUB_FRONT)
    found = [s for s in a.spots(shower, where=where) if s.extent[0] < _SHOWER_CORNER]
    if not found:
        return None
    spot = max(found, key=lambda s: score(s) + a.rng.uniform(0, _SHOWER_JITTER))
    return a.put(shower, spot, front=_TUB_FRONT), spot


def furnish_bathroom(a: Arranger) -> float:
    """Furnish a bathroom: tub or shower, washbasin and cabinet, towels, mat, basket; walls free for the benchmark.

    Returns:
        Share of the wanted places for machines and toilets that remain, or 0 if something necessary does not fit.
    """
    doors = doors_of(a)
    far = near(doors.mean(axis=0), -_FAR_FROM_DOOR)
    main = None
    if a.seed % _FLATS_PER_SHOWER != _FLATS_PER_SHOWER - 1:
        main = a.place(
            "bathtub",
            score=lambda s: cornered(s) + far(s) + (_SHORT_WALL_BONUS if s.wall.length < _SHORT_WALL else 0.0),
            where=Where(front=_TUB_FRONT),
        )
    if main is None:
        main = _shower(a, far)
    if main is None:
        return 0.0
    view = facing_door(a)
    where = Where(front=_BASIN_FRONT, margin=_BASIN_MARGIN, top=_BASIN_TOP)
    basin = a.place("washbasin", score=lambda s: _BASIN_IN_VIEW * view(s), where=where)
    if basin is None:
        return 0.0
    _tub_piece, tub_spot = main
    spot = basin[1]
    cabinet = a.model("vanity_cabinet")
    height = origin_height(cabinet, max(_VANITY_BOTTOM, float(basin[0].high[1]) + _VANITY_GAP))
    at = spot.wall.point(spot.along, 0.0)
    if a.place_free(cabinet, at[[0, 2]], spot.wall.yaw, height=height) is None:
        return 0.0
    mat = a.model("bath_mat")
    depth = float(mat.mesh.bounds[1, 2] - mat.mesh.bounds[0, 2])
    front = tub_spot.centre + tub_spot.wall.normal * (depth_of(tub_spot) / 2 + depth / 2 + _MAT_GAP)
    a.place_free(mat, front[[0, 2]], tub_spot.wall.yaw)
    rail = a.model("towel_rail")
    a.place(
        "towel_rail",
        score=near(tub_spot.centre),
        where=Where(height=origin_height(rail, _RAIL_BOTTOM), margin=_RAIL_MARGIN),
    )
    by_tub, by_basin = near(tub_spot.centre, _BASKET_NEAR), near(spot.centre, _BIN_NEAR)
    a.place("laundry_basket", score=lambda s: _SMALL_CORNERED * cornered(s) + by_tub(s))
    _spare(
        a,
        lambda: a.place(
            "bathroom_cabinet",
            score=lambda s: near(spot.centre)(s) + _CABINET_CORNERED * cornered(s),
            jitter=_CABINET_JITTER,
            where=Where(front=_CABINET_FRONT),
        ),
    )
    if not _is_ladder(rail):
        _spare(a, lambda: radiator(a, _RADIATOR_LENGTH))  # a ladder is a radiator itself
    _spare(a, lambda: a.place("waste_bin", score=lambda s: _SMALL_CORNERED * cornered(s) + by_basin(s)))
    _beside_basin(a, spot)
    shelf_board(a, copy=_BOARD, score=near(tub_spot.centre, _BOARD_NEAR))
    return min(_machine_spots(a), MACHINE_PLACES) / MACHINE_PLACES if _FLOOR.met(a) else 0.0


def _is_ladder(rail: Furniture) -> bool:
    """Whether a towel rail is a heated ladder."""
    return bool(rail.mesh.bounds[1, 1] - rail.mesh.bounds[0, 1] >= _LADDER)


def _beside_basin(a: Arranger, spot: WallSpot) -> None:
    """A mat before the washbasin, if none lies near, and a second towel rail beside it."""
    second = a.model("bath_mat", 1)
    reach = depth_of(spot) / 2 + float(second.mesh.bounds[1, 2]) + _SECOND_MAT_GAP
    if not any(p.flat and np.linalg.norm((p.position - spot.centre)[[0, 2]]) < _MAT_DISTANCE for p in a.placed):
        a.place_free(second, (spot.centre + spot.wall.normal * reach)[[0, 2]], spot.wall.yaw)
    rail = a.model("towel_rail", 1)
    if not _is_ladder(rail):
        a.place(
            "towel_rail",
            copy=1,
            score=near(spot.centre),
            where=Where(height=origin_height(rail, _SECOND_RAIL_BOTTOM), margin=_RAIL_MARGIN),
        )
