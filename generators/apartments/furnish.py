"""Furnishes a room by the rules of its kind.

Every room is furnished several times with other random choices; the first arrangement that meets all demands of the
room (walking area, free places for the objects of the benchmark) is taken, or else the best one. Then pictures are hung
on walls that are still blank.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import FloorPlan, RoomPlan
from generators.apartments.interior.arrange import Arranger
from generators.apartments.interior.bathroom import furnish_bathroom
from generators.apartments.interior.bedroom import furnish_bedroom, furnish_hall
from generators.apartments.interior.fittings import lamps
from generators.apartments.interior.kitchen import furnish_kitchen
from generators.apartments.interior.living import furnish_living_room
from generators.apartments.interior.walls import dress_walls
from generators.assets.materials import Palette

#: How often a room is furnished before the best arrangement is taken.
ATTEMPTS = 14
#: An arrangement of at least this quality is taken at once: the highest quality is 1, less rounding errors.
_PERFECT = 0.999

#: Room name → its rule, which furnishes the room and returns the arrangement's quality, from 0 (unusable) to 1.
RULES: dict[str, Callable[[Arranger], float]] = {
    "bathroom": furnish_bathroom,
    "kitchen": furnish_kitchen,
    "living_room": furnish_living_room,
    "bedroom": furnish_bedroom,
    "hall": furnish_hall,
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
        lamps(attempt)
        quality = RULES[room.name](attempt)
        if quality > best_quality:
            best, best_quality = attempt, quality
        if quality >= _PERFECT:
            break
    # Its own generator: what hangs on the walls changes nothing that stands in the room.
    best.rng = np.random.default_rng([seed, zlib.crc32(b"walls"), zlib.crc32(room.name.encode())])
    dress_walls(best)
    return best
