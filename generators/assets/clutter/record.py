"""`ClutterKind`: a line of the catalogue of small things."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from generators.assets.furniture.common import Furniture, Kit
from generators.assets.materials import Palette

#: Where a small thing stands (level places) or hangs (upright places); `generators.apartments.interior.clutter` has the
#: furniture that offers each.
LevelPlace = Literal[
    "worktop",
    "hob",
    "board",
    "cabinet_top",
    "sill",
    "basin",
    "tub",
    "table",
    "coffee_table",
    "desk",
    "nightstand",
    "sideboard",
    "bed",
    "seat",
    "floor",
    "entrance",
]
UprightPlace = Literal["wall", "door_side", "worktop_wall", "basin_wall", "tub_wall", "fridge", "ceiling"]
Place = LevelPlace | UprightPlace


@dataclass(frozen=True)
class ClutterKind:
    """A kind of small thing: how it is made, where it is, how many there are.

    Attributes:
        name: of the kind; a part is called ``<room>/<name>_<n>``.
        build: adds the thing to a `Kit`, its front towards +Z: standing on y = 0; or its back at z = 0 and
            ``kit.mount`` "wall"; or hanging from y = 0 and ``kit.mount`` "ceiling". ``kit.rng`` decides form and size.
        places: where it may be, the preferred one first.
        rooms: type of room → least and greatest number of such things there; fewer where there is no space.
        height: range of the height of its middle above the floor (m), for upright places.
        turn: largest deviation of its yaw from its support's front (degrees), for level places.
        rear: whether it stands near the back of its support.
    """

    name: str
    build: Callable[[Kit], None]
    places: tuple[Place, ...]
    rooms: Mapping[str, tuple[int, int]]
    height: tuple[float, float] = (0.0, 0.0)
    turn: float = 12.0
    rear: bool = False

    def make(self, palette: Palette, seed: int, copy: int) -> Furniture:
        """Thing number ``copy`` of this kind in the home ``seed``; the same call gives the same bytes."""
        kit = Kit(palette, np.random.default_rng([seed, zlib.crc32(self.name.encode()), copy]))
        self.build(kit)
        return kit.finish(self.name)
