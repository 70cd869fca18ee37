"""Pictures on the walls that furnishing left blank."""

from __future__ import annotations

from dataclasses import dataclass

from generators.apartments.floorplan import SIDES, WallFrame
from generators.apartments.interior.arrange import Arranger

#: What must be free of a wall, above the floor (m): below, furniture stands; above, it would be too high to look at.
BAND = (1.15, 2.0)
#: A picture's middle above the floor (m).
HEIGHT = 1.58
#: A free stretch of wall from this length on counts as blank (m). A picture leaves enough of it for a wall clock.
BLANK = 1.5
#: Free wall on both sides of a picture (m).
MARGIN = 0.35
#: Number of pictures that a room gets at most.
MOST = {"kitchen": 2, "bathroom": 1, "living_room": 3, "bedroom": 3, "hall": 2}
#: Pieces of the kind "picture" from this number on hang here, ten numbers a room; furnishing takes lower ones.
_FIRST = 10


@dataclass(frozen=True)
class _Stretch:
    wall: WallFrame
    start: float
    stop: float

    @property
    def length(self) -> float:
        return self.stop - self.start


def dress_walls(a: Arranger) -> None:
    """Hang pictures on blank stretches of wall, the longest first; what stands already stays as it is."""
    first = _FIRST * (1 + list(MOST).index(a.room.name))  # no two rooms have the same pictures
    for number in range(first, first + MOST[a.room.name]):
        picture = a.model("picture", number)
        low, high = picture.mesh.bounds
        need = max(BLANK, float(high[0] - low[0]) + 2 * MARGIN)
        found = [
            _Stretch(wall, *span)
            for wall in map(a.room.wall, SIDES)
            for span in a.stretches(wall, BAND, float(high[2]) + 0.02)
        ]
        blank = [stretch for stretch in found if stretch.length >= need]
        if not blank:
            return
        longest = max(blank, key=lambda stretch: stretch.length)
        # Pictures near the middle of a short stretch, towards one end of a long one.
        space = longest.length - need
        along = longest.start + need / 2 + space * float(a.rng.uniform(0.3, 0.7))
        a.place_free(picture, longest.wall.point(along, 0.0)[[0, 2]], longest.wall.yaw, height=HEIGHT)
