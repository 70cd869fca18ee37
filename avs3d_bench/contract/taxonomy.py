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
#: The paper's hard case beside a sounding microwave; no manifest makes it sound.
OVEN = "oven"
#: Distractors: objects without a class id, silent wherever they are seen. A manifest may declare any of them but the
#: oven, with files of its own: then it is a category like any other.
DISTRACTORS = (OVEN, "dishwasher", "kettle", "fan", "radio")
#: Sounds that come from other rooms only and are never marked, so that they have no class id either; the same holds.
OFF_SCREEN_CATEGORIES = ("dishwasher", "kettle", "fan", "speech_babble", "music", "dog", "street")
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


def _known(value: str, allowed: Sequence[str], what: str) -> str:
    if value in allowed:
        return value
    hint = did_you_mean(value, allowed)
    raise UsageError(f"unknown {what} {excerpt(value)}: {_expected(allowed)}{hint}")


def _expected(allowed: Sequence[str]) -> str:
    more = f" and {len(allowed) - _MOST_NAMED} more" if len(allowed) > _MOST_NAMED else ""
    return f"expected one of {', '.join(allowed[:_MOST_NAMED])}{more}"


def check_category(value: str, *, silent: bool = False, off_screen: bool = False, own: Sequence[str] = ()) -> str:
    """Return ``value`` if it is a category, else raise ``UsageError``.

    Args:
        value: to check.
        silent: whether objects are meant that may be silent: distractors pass, too.
        off_screen: whether sounds of other rooms are meant: `OFF_SCREEN_CATEGORIES` pass, too.
        own: the categories that a manifest adds.
    """
    allowed = tuple(dict.fromkeys(
        (*CATEGORIES, *own, *(DISTRACTORS if silent else ()), *(OFF_SCREEN_CATEGORIES if off_screen else ()))
    ))  # fmt: skip
    if value not in allowed and value in (*DISTRACTORS, *OFF_SCREEN_CATEGORIES):
        away = "heard from other rooms alone (a source of part_3 with its room)"
        if silent:
            why = f"is no object, but {away}"
        elif value not in OFF_SCREEN_CATEGORIES:
            why = "never sounds"
        else:
            why = f"is silent where it is seen, and {away}" if value in DISTRACTORS else f"is {away}"
        raise UsageError(f"{value} {why}: {_expected(allowed)}")
    return _known(value, allowed, "category")


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
