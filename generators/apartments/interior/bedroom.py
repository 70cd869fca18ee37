"""The bedroom and the hall: not rooms of the benchmark, but seen through its doors."""

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
from generators.apartments.interior.walking import walkable

Array = NDArray[np.float64]


def furnish_bedroom(a: Arranger) -> float:
    """Bed between nightstands, wardrobe, desk with chair."""
    curtains(a)
    door_leaves(a)
    bed = a.place("bed", score=lambda s: -abs(s.along - s.wall.length / 2) * 0.5, where=Where(front=0.6, margin=0.45))
    if bed is None:
        bed = a.place("bed", score=cornered, where=Where(front=0.5))
    if bed is None:
        return 0.0
    _, spot = bed
    for _ in range(2):
        a.place("nightstand", score=near(spot.centre), jitter=0.0, where=Where(sides=[spot.wall.side]))
    rug = a.model("rug")
    a.place_free(rug, (spot.centre + spot.wall.normal * 0.7)[[0, 2]], spot.wall.yaw)
    quality = 0.5 + 0.3 * (a.place("wardrobe", score=cornered, where=Where(front=0.6)) is not None)
    desk = a.place("desk", where=Where(front=0.5))
    if desk is not None:
        chairs_round(a, desk[0], 1, zones=False)
        quality += 0.1
    a.place("plant", score=cornered, copy=2, options={"height": 0.75})
    radiator(a)
    pictures(a, 1, height=1.65, score=near(spot.wall.point(spot.along, 1.6), 3.0))
    return quality if walkable(a) > 1.5 else 0.0


def furnish_hall(a: Arranger) -> float:
    """Shoe cabinet, coats, picture, runner; a long hall has shelves too."""
    cabinet = a.place("shoe_cabinet", where=Where(front=0.6))
    if cabinet is not None:
        spot = cabinet[1]
        picture = a.model("picture", 5, width=0.7, height=0.9)
        height = max(1.15, float(cabinet[0].high[1]) + 0.04) - float(picture.mesh.bounds[0, 1])
        a.place_free(picture, spot.wall.point(spot.along, 0.0)[[0, 2]], spot.wall.yaw, height=height)
    rack = a.model("coat_rack")
    a.place("coat_rack", score=near(doors_of(a)[-1], 0.5), where=Where(height=1.95 - float(rack.mesh.bounds[1, 1])))
    r = a.room
    length, across = max(r.x1 - r.x0, r.z1 - r.z0), min(r.x1 - r.x0, r.z1 - r.z0)
    runner = a.model("rug", length=round(min(0.45 * length, 3.0), 2), width=round(min(0.5 * across, 1.0), 2))
    a.place_free(runner, ((r.x0 + r.x1) / 2, (r.z0 + r.z1) / 2), 0.0 if r.x1 - r.x0 >= r.z1 - r.z0 else 90.0)
    if r.area > 11:
        a.place("sideboard", where=Where(front=0.75))
        a.place("bookshelf", copy=1, score=cornered, options={"width": 0.8}, where=Where(front=0.75))
    a.place("plant", score=cornered, options={"height": 0.7})
    pictures(a, 3)
    return 1.0 if walkable(a) > 1.0 else 0.0
