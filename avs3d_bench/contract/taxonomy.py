"""The names of the benchmark: categories, rooms, parts.

Source: "3D Audio-Visual Segmentation" (Sokolov, Bhosale, Zhu, 2024), benchmark 3DAVS-S34-O7.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

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
#: part_1: one instance of the category that sounds; part_2: several, one sounds; part_3: any number of
#: sources, with programmes, off-screen sound, silence.
PART_3 = "part_3"
PARTS = ("part_1", "part_2", PART_3)
#: What a category is called: a name of its own must fit this, too.
CATEGORY_PATTERN = r"^[a-z][a-z0-9_]{0,63}$"
#: Largest number of names that a message lists.
_MOST_NAMED = 12
#: Largest number of categories that a manifest adds: category masks have 8 bits, and 0 means nothing.
MOST_OWN_CATEGORIES = 255 - len(CATEGORIES)


def _known(value: str, allowed: tuple[str, ...], what: str) -> str:
    if value in allowed:
        return value
    hint = did_you_mean(value, allowed)
    more = f" and {len(allowed) - _MOST_NAMED} more" if len(allowed) > _MOST_NAMED else ""
    raise UsageError(f"unknown {what} {excerpt(value)}: expected one of {', '.join(allowed[:_MOST_NAMED])}{more}{hint}")


def check_category(value: str, *, silent: bool = False, own: Sequence[str] = ()) -> str:
    """Return ``value`` if it is a category (with ``silent``, a distractor passes too), else raise ``UsageError``.

    ``own`` are the categories that a manifest adds.
    """
    return _known(value, (*CATEGORIES, *own, *(DISTRACTORS if silent else ())), "category")


def check_category_name(value: str) -> str:
    """Return ``value`` if it can be the name of a category, known or new, else raise ``UsageError``.

    Examples:
        >>> check_category_name("hair_dryer")
        'hair_dryer'
    """
    if isinstance(value, str) and re.fullmatch(CATEGORY_PATTERN, value):
        return value
    raise UsageError(
        f"category {excerpt(value)}: expected lower-case letters, digits and underscores, a letter first, at most 64 "
        "characters, e.g. hair_dryer"
    )


def check_room(value: str) -> str:
    """Return ``value`` if it is a room type, else raise ``UsageError``."""
    return _known(value, ROOMS, "room")


def class_ids(own: Sequence[str] = ()) -> dict[str, int]:
    """Category → its value in `category_masks/` and in `categories/` of a submission; 0 means nothing.

    Args:
        own: the categories that the dataset's manifest adds, in its order; they come after the seven of the paper.

    Examples:
        >>> class_ids(("hair_dryer",))["washing_machine"], class_ids(("hair_dryer",))["hair_dryer"]
        (1, 8)
    """
    return {name: number for number, name in enumerate((*CATEGORIES, *own), start=1)}
