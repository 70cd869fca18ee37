"""The bedroom and the hall: no observation is made in them, but they are seen through open doors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.dining import chairs_round
from generators.apartments.interior.fittings import (
    cornered,
    curtains,
    door_leaves,
    doors_of,
    near,
    pictures,
    radiator,
)
from generators.apartments.interior.pieces import origin_height
from generators.apartments.interior.walking import walkable

Array = NDArray[np.float64]

#: Bed: free floor before it, and free width on both sides, for a nightstand of 0.45 m (m).
_BED_FRONT, _BED_MARGIN = 0.6, 0.45
#: Loss of score per metre between the bed's middle and the middle of its wall.
_BED_MIDDLE = 0.5
#: Free floor before a bed that fits only without nightstands on both sides (m).
_TIGHT_BED_FRONT = 0.5
#: Distance from the bed's middle to the middle of the rug (m), towards the foot: the rug shows before the foot.
_RUG_OFFSET = 0.7
#: Free floor before the wardrobe, to open its doors, and before the desk, for the chair (m).
_WARDROBE_FRONT, _DESK_FRONT = 0.6, 0.5
#: Quality of a bedroom that has a bed, and what wardrobe and desk add.
_BED_QUALITY, _WARDROBE_QUALITY, _DESK_QUALITY = 0.5, 0.3, 0.1
#: Height of the middle of the picture over the bed, and of the point near which it hangs, above the floor (m).
_PICTURE_HEIGHT, _PICTURE_TARGET = 1.65, 1.6
#: Loss of score per metre between the picture and that point: it hangs over the bed wherever it can.
_PICTURE_NEAR = 3.0
#: Heights of the plants in bedroom and hall (m).
_BEDROOM_PLANT, _HALL_PLANT = 0.75, 0.7
#: Floor that the agent's middle must be able to reach in bedroom and hall (m²).
_BEDROOM_WALKABLE, _HALL_WALKABLE = 1.5, 1.0

#: Free floor before the hall's shoe cabinet, to open its flaps and stand there (m).
_SHOES_FRONT = 0.6
#: Size of the picture over the shoe cabinet (m); its lower edge is this high above the floor (m) and this far above the
#: things on the cabinet (m), at least.
_SHOES_PICTURE = {"width": 0.7, "height": 0.9}
_SHOES_PICTURE_BOTTOM, _SHOES_PICTURE_GAP = 1.15, 0.04
#: Height of the top of the coat rack above the floor (m): its hooks are then at about 1.6 m.
_RACK_TOP = 1.95
#: Loss of score per metre between the coat rack and the last of the doors.
_RACK_NEAR = 0.5
#: The runner's size: shares of the hall's length and width, and the most of each (m).
_RUNNER_LENGTH, _RUNNER_WIDTH = (0.45, 3.0), (0.5, 1.0)
#: A hall that is larger than this (m²) has a sideboard and a bookshelf too.
_LARGE_HALL = 11
#: Free floor before those (m): people walk past them.
_HALL_FRONT = 0.75
#: Width of the bookshelf in the hall (m).
_HALL_SHELF_WIDTH = 0.8
#: Pictures in the hall, at most.
_HALL_PICTURES = 3
#: Numbers of the picture and the plant: pieces of a kind with the same number look the same in all rooms of a flat.
_SHOES_PICTURE_NUMBER, _BEDROOM_PLANT_NUMBER = 5, 2


def furnish_bedroom(a: Arranger) -> float:
    """Furnish a bedroom: bed between nightstands, wardrobe, desk with chair; returns its quality, 0 to 1."""
    curtains(a)
    door_leaves(a)
    bed = a.place(
        "bed",
        score=lambda s: -abs(s.along - s.wall.length / 2) * _BED_MIDDLE,
        where=Where(front=_BED_FRONT, margin=_BED_MARGIN),
    )
    if bed is None:
        bed = a.place("bed", score=cornered, where=Where(front=_TIGHT_BED_FRONT))
    if bed is None:
        return 0.0
    _, spot = bed
    for _ in range(2):
        a.place("nightstand", score=near(spot.centre), jitter=0.0, where=Where(sides=[spot.wall.side]))
    rug = a.model("rug")
    a.place_free(rug, (spot.centre + spot.wall.normal * _RUG_OFFSET)[[0, 2]], spot.wall.yaw)
    wardrobe = a.place("wardrobe", score=cornered, where=Where(front=_WARDROBE_FRONT))
    quality = _BED_QUALITY + _WARDROBE_QUALITY * (wardrobe is not None)
    desk = a.place("desk", where=Where(front=_DESK_FRONT))
    if desk is not None:
        chairs_round(a, desk[0], 1, zones=False)
        quality += _DESK_QUALITY
    a.place("plant", score=cornered, copy=_BEDROOM_PLANT_NUMBER, options={"height": _BEDROOM_PLANT})
    radiator(a)
    over_bed = near(spot.wall.point(spot.along, _PICTURE_TARGET), _PICTURE_NEAR)
    pictures(a, 1, height=_PICTURE_HEIGHT, score=over_bed)
    return quality if walkable(a) > _BEDROOM_WALKABLE else 0.0


def furnish_hall(a: Arranger) -> float:
    """Furnish a hall: shoe cabinet, coats, picture, runner, in a large one shelves; returns its quality, 0 or 1."""
    cabinet = a.place("shoe_cabinet", where=Where(front=_SHOES_FRONT))
    if cabinet is not None:
        spot = cabinet[1]
        picture = a.model("picture", _SHOES_PICTURE_NUMBER, **_SHOES_PICTURE)
        bottom = max(_SHOES_PICTURE_BOTTOM, float(cabinet[0].high[1]) + _SHOES_PICTURE_GAP)
        height = origin_height(picture, bottom)
        a.place_free(picture, spot.wall.point(spot.along, 0.0)[[0, 2]], spot.wall.yaw, height=height)
    rack = a.model("coat_rack")
    where = Where(height=_RACK_TOP - float(rack.mesh.bounds[1, 1]))
    a.place("coat_rack", score=near(doors_of(a)[-1], _RACK_NEAR), where=where)
    r = a.room
    length, across = max(r.x1 - r.x0, r.z1 - r.z0), min(r.x1 - r.x0, r.z1 - r.z0)
    long = min(_RUNNER_LENGTH[0] * length, _RUNNER_LENGTH[1])
    wide = min(_RUNNER_WIDTH[0] * across, _RUNNER_WIDTH[1])
    runner = a.model("rug", length=round(long, 2), width=round(wide, 2))
    a.place_free(runner, ((r.x0 + r.x1) / 2, (r.z0 + r.z1) / 2), 0.0 if r.x1 - r.x0 >= r.z1 - r.z0 else 90.0)
    if r.area > _LARGE_HALL:
        front = Where(front=_HALL_FRONT)
        a.place("sideboard", where=front)
        a.place("bookshelf", copy=1, score=cornered, options={"width": _HALL_SHELF_WIDTH}, where=front)
    a.place("plant", score=cornered, options={"height": _HALL_PLANT})
    pictures(a, _HALL_PICTURES)
    return 1.0 if walkable(a) > _HALL_WALKABLE else 0.0
