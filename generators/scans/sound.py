"""How the surfaces of a scan sound: acoustic labels from annotations where there are some, else from their places.

The category of the object that a face belongs to is looked up in `CATEGORIES`; what stands nowhere gets the default:
the floor is parquet (tiles in a bathroom), level tops are wood, the rest is plaster. A SoundSpaces material file
replaces the table for the categories that it names. Without annotations, `generators.scans.places` guesses what a face
is, and `MATERIAL_OF` what that is made of. The manifest's ``surfaces`` decides before all of these, but not over an
annotated object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from generators.acoustics.materialfile import MaterialFile
from generators.acoustics.materials import MATERIALS, triangle_areas
from generators.core.scene import Mesh, Room
from generators.scans.annotations import AnnotatedObject, Annotations
from generators.scans.places import AROUND, PLACES, REASONS, near_room, places_of

Array = NDArray[np.float64]

#: |cosine| of the slope of a level face.
LEVEL = 0.8
#: Label of a face if nothing is known.
DEFAULT_LABEL = "plaster"
FLOOR_LABEL = "parquet"
#: Floors of rooms that are not parquet.
FLOOR_OF_ROOM = {"bathroom": "tile"}
TOP_LABEL = "wood"
#: Place of a scan without annotations → its label.
MATERIAL_OF = {
    "floor": FLOOR_LABEL,
    "wall": "plaster",
    "ceiling": "plaster",
    "window": "glass",
    "soft": "clutter",
    "shelves": "paper",
    "curtain": "curtain",
    "furniture": TOP_LABEL,
    "other": DEFAULT_LABEL,
}

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


def check_surfaces(surfaces: Mapping[str, str], where: str) -> None:
    """Check the places and materials of a manifest's ``surfaces``, or of a command's options.

    Args:
        surfaces: place → acoustic material.
        where: for messages.

    Raises:
        UsageError: naming the first one that does not exist, with those that do.
    """
    for place, material in surfaces.items():
        for what, name, known in (("place", place, PLACES), ("acoustic material", material, tuple(MATERIALS))):
            if name not in known:
                hint = did_you_mean(name, known)
                raise UsageError(f"{where}: unknown {what} {excerpt(name)}; expected one of {', '.join(known)}{hint}")


class LabelledScan(NamedTuple):
    """A scan's mesh with a label on every acoustic face, and (A,) the place of each, one of `PLACES`."""

    mesh: Mesh
    places: NDArray[np.str_]


class SurfaceRow(NamedTuple):
    """One line of the table of what a scan's rooms are made of.

    Attributes:
        place: one of `PLACES`.
        material: acoustic label.
        area: m², in all rooms.
        share: of the area of all rooms.
        why: what the guess rests on.
    """

    place: str
    material: str
    area: float
    share: float
    why: str


def labelled(
    mesh: Mesh,
    rooms: Sequence[tuple[Room, float]],
    annotations: Annotations | None,
    materials: MaterialFile | None,
    surfaces: Mapping[str, str] | None = None,
) -> LabelledScan:
    """``mesh`` with a label on every acoustic face.

    Args:
        mesh: its labels are those that the file's material names told, `DEFAULT_LABEL` elsewhere.
        rooms: each room with the height of its floor.
        annotations: of the scan.
        materials: a SoundSpaces material file.
        surfaces: place → label, as the manifest corrects it.
    """
    triangles = mesh.acoustic_positions.astype(np.float64)
    middle = triangles.mean(axis=1)
    labels = np.array(mesh.acoustic_labels, dtype=object)
    annotated = annotations is not None
    places = _kinds(triangles, middle, rooms) if annotated else places_of(mesh, rooms)
    table = {"floor": FLOOR_LABEL, "furniture": TOP_LABEL} if annotated else MATERIAL_OF
    unknown = labels == DEFAULT_LABEL
    for place, label in table.items():
        labels[unknown & (places == place)] = label
    for name, label in FLOOR_OF_ROOM.items():
        inside = _inside(middle, [room for room, _ in rooms if room.name == name])
        labels[unknown & (places == "floor") & inside] = label
    named = np.zeros(len(labels), dtype=bool)
    if annotations is not None:
        named = _annotate(labels, places == "floor", annotations.owners(middle), annotations, materials)
    if materials is not None:
        # What no annotation names is still a wall, a floor or a ceiling to the file.
        for kind in ("wall", "floor", "ceiling"):
            given = materials.label_for([kind])
            if given is not None:
                labels[unknown & ~named & (places == kind)] = given
    shell = named & ~np.isin(labels.astype(str), (FLOOR_LABEL, DEFAULT_LABEL))
    for place, label in (surfaces or {}).items():
        labels[(places == place) & ~shell] = label
    return LabelledScan(replace(mesh, acoustic_labels=tuple(str(label) for label in labels)), places)


def _annotate(
    labels: NDArray[np.object_],
    ground: NDArray[np.bool_],
    owners: NDArray[np.signedinteger],
    annotations: Annotations,
    materials: MaterialFile | None,
) -> NDArray[np.bool_]:
    """Set the labels (A,) of faces that belong to annotated objects; (A,) which do."""
    floors = labels.copy()
    table = [_label_of_object(item, materials) for item in annotations.objects]
    for number in np.unique(owners[owners >= 0]):
        own, label = owners == number, table[number]
        if label == "floor":
            labels[own] = np.where(ground[own], floors[own], FLOOR_LABEL)
        elif label is not None:
            labels[own] = label
    return np.asarray(owners >= 0)


def surface_table(scan: LabelledScan, rooms: Sequence[tuple[Room, float]]) -> tuple[SurfaceRow, ...]:
    """What the rooms of a scan are made of: rows in the order of `PLACES`, then by area."""
    triangles = scan.mesh.acoustic_positions.astype(np.float64)
    area, middle = triangle_areas(triangles), triangles.mean(axis=1)
    near = np.zeros(len(area), dtype=bool)
    for room, _ in rooms:
        near |= near_room(middle, room, AROUND)
    labels, whole = np.array(scan.mesh.acoustic_labels), float(area[near].sum())
    rows = []
    for place in PLACES:
        own = near & (scan.places == place)
        sums = {str(label): float(area[own & (labels == label)].sum()) for label in np.unique(labels[own])}
        rows += [
            SurfaceRow(place, label, size, size / whole, REASONS[place])
            for label, size in sorted(sums.items(), key=lambda pair: -pair[1])
        ]
    return tuple(rows)


def _label_of_object(item: AnnotatedObject, materials: MaterialFile | None) -> str | None:
    words = [word for word in (item.category, item.group) if word]
    given = materials.label_for(words) if materials is not None else None
    return given if given is not None else label_of_category(words)


def _kinds(triangles: Array, middle: Array, rooms: Sequence[tuple[Room, float]]) -> NDArray[np.str_]:
    """(A,) ``floor``, ``furniture`` (a level top), ``ceiling``, ``wall`` or ``other`` by slope and height."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    level = np.abs(cross[:, 1]) >= LEVEL * np.maximum(np.linalg.norm(cross, axis=1), 1e-20)
    kinds = np.where(level, "other", "wall").astype("<U9")
    for room, floor in rooms:
        inside = level & _inside(middle, [room])
        above = middle[:, 1] - floor
        kinds[inside & (np.abs(above) <= 0.12)] = "floor"
        kinds[inside & (above > 0.3) & (above < 1.2)] = "furniture"
        kinds[inside & (above >= 2.0)] = "ceiling"
    return kinds


def _inside(middle: Array, rooms: Sequence[Room]) -> NDArray[np.bool_]:
    """(A,) whether faces lie over or under the plan of one of ``rooms``."""
    out = np.zeros(len(middle), dtype=bool)
    for room in rooms:
        low, high = np.asarray(room.low)[[0, 2]], np.asarray(room.high)[[0, 2]]
        out |= ((middle[:, [0, 2]] >= low) & (middle[:, [0, 2]] <= high)).all(axis=1)
    return out
