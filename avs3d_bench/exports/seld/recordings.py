"""Names, folds and cuts of recordings, as STARSS23 and the stereo data of DCASE 2025 have them.

    foa      foa_dev/dev-train-avs3d/fold3_room2_mix004.wav                        one recording per observation
    stereo   stereo_dev/dev-train-avs3d/fold3_room2_mix004_deg195_start0050.wav    clips of 5 s

Fold 3 is for training (`dev-train-avs3d`), fold 4 for testing (`dev-test-avs3d`): the baselines of the challenge choose
files by the fold. Homes are in one of the two, never in both, so that siblings, which have the same pictures, and rooms
are not, either. A room's number is its place among the rooms that are exported, a mix's number that of the observation
in its room.
"""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from avs3d_bench.contract import layout
from avs3d_bench.errors import UsageError

SeldFormat = Literal["foa", "stereo", "binaural"]
FORMATS: tuple[SeldFormat, ...] = get_args(SeldFormat)
SeldSplit = Literal["dev-train-avs3d", "dev-test-avs3d"]
TRAIN, TEST = get_args(SeldSplit)
#: Fold of each split.
_FOLDS = {TRAIN: 3, TEST: 4}
#: Of that many homes, one is for testing.
_ONE_IN = 5
#: Seconds of a clip of stereo.
CLIP_SECONDS = 5


@dataclass(frozen=True)
class SeldScene:
    """An observation as a recording.

    Attributes:
        key: of the observation.
        split: its folder.
        name: of its files, without a suffix.
    """

    key: str
    split: SeldSplit
    name: str

    def clips(self, seconds: int, form: SeldFormat) -> tuple[SeldClip, ...]:
        """What is written of a recording of so many seconds; less than a clip of stereo at its end is left out."""
        if form == "foa":
            return (SeldClip(self.name, 0, seconds, 0),)
        views = []
        for start in range(0, seconds - CLIP_SECONDS + 1, CLIP_SECONDS):
            view = 0 if form == "binaural" else drawn_view(self.key, start)
            views.append(SeldClip(f"{self.name}_deg{view:03d}_start{10 * start:04d}", start, CLIP_SECONDS, view))
        return tuple(views)


@dataclass(frozen=True)
class SeldClip:
    """One file of sound with its labels.

    Attributes:
        name: of its files, without a suffix.
        start: its first second in the observation.
        seconds: its length.
        view: direction in which it looks, degrees to the right of the camera.
    """

    name: str
    start: int
    seconds: int
    view: int


def drawn_view(key: str, start: int) -> int:
    """The view of a stereo clip, 0 to 359 degrees: drawn from the key and the second, whatever else is exported."""
    return int.from_bytes(hashlib.sha256(f"seld view of {key} at {start}".encode()).digest()[:8], "big") % 360


def plan_scenes(keys: Sequence[str], test: Sequence[str] = ()) -> tuple[SeldScene, ...]:
    """The recordings of observations, in the order of their keys.

    Args:
        keys: of the observations.
        test: names of the homes for testing, with wildcards; none: every fifth home, at least one of two or more,
            drawn by their names.

    Raises:
        UsageError: if a pattern matches no home.
    """
    places = {key: layout.parse_key(key) for key in sorted(keys)}
    homes = sorted({place.scan for place in places.values()})
    tested = _test_homes(homes, test)
    rooms = sorted({(place.scan, place.room) for place in places.values()})
    mixes = dict.fromkeys(rooms, 0)
    scenes = []
    for key, place in places.items():
        mixes[place.scan, place.room] += 1
        split: SeldSplit = TEST if place.scan in tested else TRAIN
        room, mix = rooms.index((place.scan, place.room)) + 1, mixes[place.scan, place.room]
        scenes.append(SeldScene(key, split, f"fold{_FOLDS[split]}_room{room}_mix{mix:03d}"))
    return tuple(scenes)


def _test_homes(homes: Sequence[str], patterns: Sequence[str]) -> frozenset[str]:
    if not patterns:
        count = 0 if len(homes) < 2 else max(1, len(homes) // _ONE_IN)
        return frozenset(sorted(homes, key=lambda home: hashlib.sha256(home.encode()).hexdigest())[:count])
    found: set[str] = set()
    for pattern in patterns:
        matching = fnmatch.filter(homes, pattern)
        if not matching:
            raise UsageError(f"--test-home {pattern}: matches none of the homes {', '.join(homes[:8])}")
        found.update(matching)
    return frozenset(found)
