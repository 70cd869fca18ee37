"""Pictures on the walls that furnishing left blank."""

from __future__ import annotations

from dataclasses import dataclass

from generators.apartments.floorplan import SIDES, WallFrame
from generators.apartments.interior.arrange import Arranger

#: Height range of a wall that must be free for a picture (m): below is furniture; above, a picture would hang too high.
BAND = (1.15, 2.0)
#: Height of a picture's middle above the floor (m): about the eyes of a person who stands.
HEIGHT = 1.58
#: Least length of a free stretch of wall that gets a picture (m): beside it, there is still space for a wall clock.
BLANK = 1.5
#: Free wall on both sides of a picture (m).
MARGIN = 0.35
#: Number of pictures that a room gets at most.
MOST = {"kitchen": 2, "bathroom": 1, "living_room": 3, "bedroom": 3, "hall": 2}
#: First number of the pieces of the kind "picture" that hang here, and how many numbers each room has; the rules of the
#: rooms use lower numbers.
_FIRST = 10
#: Depth of air that must be free before a picture (m).
_AIR = 0.02
#: Range of the share of the space left in a stretch that is on the picture's left: near the middle, with variation.
_LEFT_SHARE = (0.3, 0.7)


@dataclass(frozen=True)
class _Stretch:
    wall: WallFrame
    start: float
    stop: float

    @property
    def length(self) -> float:
        return self.stop - self.start


def dress_walls(a: Arranger) -> None:
    """Hang pictures on blank stretches of wall, the longest first; the furniture stays as it is."""
    first = _FIRST * (1 + list(MOST).index(a.room.name))  # no two rooms have the same pictures
    for number in range(first, first + MOST[a.room.name]):
        picture = a.model("picture", number)
        low, high = picture.mesh.bounds
        need = max(BLANK, float(high[0] - low[0]) + 2 * MARGIN)
        found = [
            _Stretch(wall, *span)
            for wall in map(a.room.wall, SIDES)
            for span in a.stretches(wall, BAND, float(high[2]) + _AIR)
        ]
        blank = [stretch for stretch in found if stretch.length >= need]
        if not blank:
            return
        longest = max(blank, key=lambda stretch: stretch.length)
        # Pictures near the middle of a short stretch, towards one end of a long one.
        space = longest.length - need
        along = longest.start + need / 2 + space * float(a.rng.uniform(*_LEFT_SHARE))
        a.place_free(picture, longest.wall.point(along, 0.0)[[0, 2]], longest.wall.yaw, height=HEIGHT)
