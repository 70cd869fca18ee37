"""Which part of an annotated scan is the bathroom, the kitchen, the living room.

1. Labels of regions, where the data set has them (Matterport3D): bathroom ``a``, else toilet ``t``; kitchen ``k``;
   living room ``l``, else family room ``f``, lounge ``n`` or TV room ``v``.
2. Objects: a toilet makes a bathroom; an oven or stove, or a sink with a refrigerator, a kitchen; a sofa with a TV a
   living room.

Of several candidates of one kind the one with the largest floor is taken; one region is two rooms only where there is
no other (an open plan).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.scans.annotations import Annotations, Region

Array = NDArray[np.float64]


def _names_of(text: str) -> frozenset[str]:
    return frozenset(text.split("|"))


TOILETS = _names_of("toilet|toilet seat|toilet bowl|wc")
OVENS = _names_of(
    "oven|stove|cooker|range|oven and stove|stove and oven|oven stove|stovetop|stove top|cooktop|hob|kitchen stove|"
    "kitchen oven|gas stove|electric stove|wall oven|range oven|kitchen range"
)
SINKS = _names_of("sink|kitchen sink|double sink|washbasin")
FRIDGES = _names_of("refrigerator|fridge|fridge freezer|refrigerator freezer|freezer|kitchen fridge")
SOFAS = _names_of("sofa|couch|sectional sofa|sectional|loveseat|sofa seat|couch seat|l-shaped sofa")
SCREENS = _names_of("tv|television|tv screen|tv monitor|flatscreen tv|flat screen tv|television set")

#: Labels of regions in the order of preference.
LABELS: dict[str, tuple[str, ...]] = {"bathroom": ("a", "t"), "kitchen": ("k",), "living_room": ("l", "fnv")}
#: A region with one of these is judged by its objects.
UNLABELLED = ("", "-", "z")
#: A room is no smaller than this (sides, height), metres.
SMALLEST = (1.2, 1.7)
#: A room is no higher above its floor, metres: what lies higher is a gallery or the next storey.
HIGHEST = 4.5


def _bathroom(names: frozenset[str]) -> bool:
    return bool(names & TOILETS)


def _kitchen(names: frozenset[str]) -> bool:
    return bool(names & OVENS) or bool(names & SINKS and names & FRIDGES)


def _living_room(names: frozenset[str]) -> bool:
    return bool(names & SOFAS and names & SCREENS)


BY_OBJECTS: dict[str, Callable[[frozenset[str]], bool]] = {
    "bathroom": _bathroom,
    "kitchen": _kitchen,
    "living_room": _living_room,
}


def find_rooms(annotations: Annotations) -> dict[str, Array]:
    """Room name → box (2, 3) of each benchmark room that the annotations show."""
    regions = [region for region in annotations.regions if large_enough(region)]
    out: dict[str, Array] = {}
    used: set[int] = set()
    for room in LABELS:
        every = candidates(annotations, regions, room)
        chosen = next((r for r in every if r.index not in used), every[0] if every else None)
        if chosen is not None:
            used.add(chosen.index)
            box = chosen.box.copy()
            box[1, 1] = min(box[1, 1], box[0, 1] + HIGHEST)
            out[room] = box
    return out


def candidates(annotations: Annotations, regions: Iterable[Region], room: str) -> list[Region]:
    """The regions that may be ``room``, the best first."""
    regions = sorted(regions, key=lambda region: (-_floor_area(region), region.index))
    labelled = [region for labels in LABELS[room] for region in regions if region.label and region.label in labels]
    if labelled:
        return labelled
    is_room = BY_OBJECTS[room]
    return [r for r in regions if r.label in UNLABELLED and is_room(_names(annotations, r))]


def large_enough(region: Region) -> bool:
    """Whether it is large enough for a standing person."""
    sides = region.box[1] - region.box[0]
    return bool(np.isfinite(sides).all() and min(sides[0], sides[2]) >= SMALLEST[0] and sides[1] >= SMALLEST[1])


def missing_room(name: str, room: str, given: Iterable[str], annotations: Annotations | None) -> Avs3dError:
    """The line for a room that is neither ``given`` nor found."""
    mend = f"give scans.{name}.rooms.{room}: the lowest and highest corner of its inside (metres, Y up)"
    head = f"scan {name}: no room {room!r}; it has {', '.join(given) or 'none'} by the manifest"
    if annotations is None:
        return Avs3dError(f"{head}, and no annotations to find others by; {mend}")
    what = {
        "bathroom": "a region labelled a or t, or one with a toilet",
        "kitchen": "a region labelled k, or one with an oven or stove, or a sink and a refrigerator",
        "living_room": "a region labelled l, f, n or v, or one with a sofa and a TV",
    }.get(room, "its box in the manifest: only bathroom, kitchen and living_room are looked for")
    source = annotations.source.name
    if not annotations.regions:
        seen = f"{len(annotations.objects)} objects without geometry (the .semantic.glb is not there)"
    else:
        large = sum(large_enough(region) for region in annotations.regions)
        seen = f"{len(annotations.regions)} regions, {large} of them large enough"
        labels = sorted({r.label for r in annotations.regions if r.label not in UNLABELLED})
        seen += f", labelled {' '.join(labels)}" if labels else ""
    found = ", ".join(find_rooms(annotations)) or "none"
    return Avs3dError(f"{head}, {found} by {source} ({seen}); expected {what}; {mend}")


def _names(annotations: Annotations, region: Region) -> frozenset[str]:
    return frozenset(word for item in annotations.in_region(region.index) for word in item.words)


def _floor_area(region: Region) -> float:
    sides = region.box[1] - region.box[0]
    return float(sides[0] * sides[2])
