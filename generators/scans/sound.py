"""How the surfaces of a scan sound: acoustic labels from annotations where there are some, else by slope and height.

The category of the object that a face belongs to is looked up in `CATEGORIES`; what stands nowhere, and all of a scan
without annotations, gets the default: the floor is parquet (tiles in a bathroom), level tops are wood, the rest is
plaster. A SoundSpaces material file replaces the table for the categories that it names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from generators.acoustics.materialfile import MaterialFile
from generators.core.scene import Mesh, Room
from generators.scans.annotations import AnnotatedObject, Annotations

Array = NDArray[np.float64]

#: |cosine| of the slope of a level face.
LEVEL = 0.8
#: Label of a face if nothing is known.
DEFAULT_LABEL = "plaster"
FLOOR_LABEL = "parquet"
#: Floors of rooms that are not parquet.
FLOOR_OF_ROOM = {"bathroom": "tile"}
TOP_LABEL = "wood"

#: Acoustic label → names of objects (HM3D's free words and Matterport3D's mpcat40), and heads of longer names.
CATEGORIES: dict[str, str] = {
    "plaster": "wall|ceiling|column|pillar|beam|wall panel|soffit|arch",
    "wood": "door|cabinet|cabinets|cupboard|table|desk|counter|countertop|worktop|shelf|shelves|shelving|bookshelf|"
    "bookcase|wardrobe|closet|dresser|drawer|drawers|chest of drawers|nightstand|bedside table|stool|bench|chair|"
    "door frame|doorframe|frame|window frame|furniture|stairs|stair|staircase|step|railing|banister|bannister|"
    "board panel|board|panel|sideboard|stand|headboard|crate|box|piano|crib|vanity|island|kitchen island|molding|"
    "skirting",
    "upholstery": "sofa|couch|armchair|bed|mattress|cushion|pillow|ottoman|pouffe|pouf|loveseat|sectional|seating|"
    "sofa chair|office chair|recliner|sofa seat|couch seat|sofa cushion",
    "curtain": "curtain|curtains|drape|drapes|drapery",
    "carpet": "carpet|rug|mat|doormat|bath mat|floor mat|carpet floor",
    "glass": "window|window glass|mirror|glass|shower glass|shower screen|shower door|glass door|sliding door|skylight",
    "fabric": "towel|clothes|clothing|blanket|bedspread|sheet|cloth|lampshade|blind|blinds|duvet|bag|robe|tablecloth|"
    "laundry|coat|jacket|shoes|hat|apparel|linen|backpack|shower curtain|canvas",
    "ceramic": "toilet|toilet seat|sink|bathtub|bath|tub|bidet|vase|basin|washbasin|urinal|pot|dish|cup|plate|bowl",
    "tile": "shower|shower wall|shower floor|shower tub|backsplash|splashback|tiles|tile|floor tile|wall tile|"
    "bathroom floor",
    "metal": "refrigerator|fridge|freezer|oven|stove|cooker|cooktop|hob|range|range hood|hood|extractor hood|microwave|"
    "dishwasher|washing machine|washer|dryer|radiator|heater|faucet|tap|appliance|appliances|pipe|handrail|lamp|"
    "chandelier|fan|boiler|lighting|light|water heater|vent|air conditioner|towel bar|shower head|gym equipment|"
    "kitchen appliance|safe|oven and stove",
    "plastic": "tv|television|monitor|screen|tv monitor|bin|trash can|basket|printer|bottle|bucket|telephone|phone|toy|"
    "computer|laptop|speaker|clock|vacuum cleaner|coffee machine|coffee maker|keyboard|fire alarm|switch",
    "paper": "book|books|picture|painting|poster|photo|magazine|map",
    "foliage": "plant|flower|flowers|tree|bush|potted plant",
    "brick": "fireplace|chimney|brick wall",
    "concrete": "pavement|concrete floor",
    "parquet": "wood floor|wooden floor|parquet|laminate floor",
}
#: No object is placed on surfaces with these labels or names.
_SOFT = frozenset({"upholstery", "ceramic", "fabric", "curtain", "foliage", "glass"})
_SEATS = frozenset(
    {"chair", "stool", "stairs", "step", "radiator", "stove", "cooktop", "hob", "bin", "basket", "lamp", "shower"}
)
_LABEL_OF = {name: label for label, names in CATEGORIES.items() for name in names.split("|")}
#: Names of floors in annotations, which do not give the material.
_FLOORS = frozenset({"floor", "floors", "ground"})


def label_of_category(words: Sequence[str]) -> str | None:
    """The acoustic label for what an object is called, ``floor`` for one of no known material, None if unknown.

    Each name is tried as a whole, then without its first words: of ``white kitchen cabinet``, ``cabinet`` counts.
    """
    for name in words:
        parts = name.partition("/")[0].split()  # ``floor /other room``
        for first in range(len(parts)):
            tail = " ".join(parts[first:])
            if tail in _FLOORS:
                return "floor"
            if tail in _LABEL_OF:
                return _LABEL_OF[tail]
    return None


def no_table(item: AnnotatedObject) -> bool:
    """Whether nothing is put on an object, however level it is."""
    words = item.words
    return label_of_category(sorted(words)) in _SOFT or any(word.split()[-1] in _SEATS for word in words)


def labelled(
    mesh: Mesh, rooms: Sequence[tuple[Room, float]], annotations: Annotations | None, materials: MaterialFile | None
) -> Mesh:
    """``mesh`` with a label on every acoustic face.

    Args:
        mesh: its labels are those that the file's material names told, `DEFAULT_LABEL` elsewhere.
        rooms: each room with the height of its floor.
        annotations: of the scan.
        materials: a SoundSpaces material file.
    """
    triangles = mesh.acoustic_positions.astype(np.float64)
    middle = triangles.mean(axis=1)
    labels = np.array(mesh.acoustic_labels, dtype=object)
    kinds = _kinds(triangles, middle, rooms)
    unknown = labels == DEFAULT_LABEL
    for kind, label in (("floor", FLOOR_LABEL), ("top", TOP_LABEL)):
        labels[unknown & (kinds == kind)] = label
    for name, label in FLOOR_OF_ROOM.items():
        labels[unknown & (kinds == "floor") & _inside(middle, [room for room, _ in rooms if room.name == name])] = label
    floors = labels.copy()
    if annotations is not None:
        owners = annotations.owners(middle)
        table = [_label_of_object(item, materials) for item in annotations.objects]
        for number in np.unique(owners[owners >= 0]):
            own, label = owners == number, table[number]
            if label == "floor":
                labels[own] = np.where(kinds[own] == "floor", floors[own], FLOOR_LABEL)
            elif label is not None:
                labels[own] = label
    if materials is not None:
        # What no annotation names is still a wall, a floor or a ceiling to the file.
        named = owners >= 0 if annotations is not None else np.zeros(len(labels), dtype=bool)
        for kind in ("wall", "floor", "ceiling"):
            given = materials.label_for([kind])
            if given is not None:
                labels[unknown & ~named & (kinds == kind)] = given
    return replace(mesh, acoustic_labels=tuple(str(label) for label in labels))


def _label_of_object(item: AnnotatedObject, materials: MaterialFile | None) -> str | None:
    words = [word for word in (item.category, item.group) if word]
    given = materials.label_for(words) if materials is not None else None
    return given if given is not None else label_of_category(words)


def _kinds(triangles: Array, middle: Array, rooms: Sequence[tuple[Room, float]]) -> NDArray[np.str_]:
    """(A,) ``floor``, ``top``, ``ceiling`` or ``wall`` by slope and height above the floor of the room."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    level = np.abs(cross[:, 1]) >= LEVEL * np.maximum(np.linalg.norm(cross, axis=1), 1e-20)
    kinds = np.where(level, "", "wall").astype("<U8")
    for room, floor in rooms:
        inside = level & _inside(middle, [room])
        above = middle[:, 1] - floor
        kinds[inside & (np.abs(above) <= 0.12)] = "floor"
        kinds[inside & (above > 0.3) & (above < 1.2)] = "top"
        kinds[inside & (above >= 2.0)] = "ceiling"
    return kinds


def _inside(middle: Array, rooms: Sequence[Room]) -> NDArray[np.bool_]:
    """(A,) whether faces lie over or under the plan of one of ``rooms``."""
    out = np.zeros(len(middle), dtype=bool)
    for room in rooms:
        low, high = np.asarray(room.low)[[0, 2]], np.asarray(room.high)[[0, 2]]
        out |= ((middle[:, [0, 2]] >= low) & (middle[:, [0, 2]] <= high)).all(axis=1)
    return out
