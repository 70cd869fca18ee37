"""The names of the benchmark: categories, rooms, parts.

Source: "3D Audio-Visual Segmentation" (Sokolov, Bhosale, Zhu, 2024), benchmark 3DAVS-S34-O7.
"""

from __future__ import annotations

from avs3d_bench.errors import UsageError, did_you_mean, excerpt

#: The seven sounding categories.
CATEGORIES = (
    "washing_machine",
    "toilet",
    "vacuum_cleaner",
    "microwave",
    "coffee_machine",
    "clock",
    "telephone",
)
#: Categories that are always silent (the paper's hard case: an oven beside a sounding microwave).
DISTRACTORS = ("oven",)
ROOMS = ("bathroom", "kitchen", "living_room")
PARTS = ("part_1", "part_2")


def _known(value: str, allowed: tuple[str, ...], what: str) -> str:
    if value in allowed:
        return value
    hint = did_you_mean(value, allowed)
    raise UsageError(f"unknown {what} {excerpt(value)}: expected one of {', '.join(allowed)}{hint}")


def check_category(value: str, *, silent: bool = False) -> str:
    """Return ``value`` if it is a category (with ``silent``, a distractor passes too), else raise ``UsageError``."""
    return _known(value, CATEGORIES + DISTRACTORS if silent else CATEGORIES, "category")


def check_room(value: str) -> str:
    """Return ``value`` if it is a room type, else raise ``UsageError``."""
    return _known(value, ROOMS, "room")
