"""Skeleton of the furniture; see `build_furniture`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from generators.assets.materials import TILES, Palette
from generators.assets.shapes import MeshBuilder
from generators.scenes.scene import Mesh, Support

Mount = Literal["floor", "wall", "ceiling"]


@dataclass(frozen=True, eq=False)
class Furniture:
    kind: str
    mesh: Mesh
    supports: tuple[Support, ...] = ()
    mount: Mount = "floor"


_SIZES: dict[str, tuple[float, float, float, Mount, str]] = {
    "bathtub": (1.7, 0.58, 0.75, "floor", ""), "shower": (0.9, 2.0, 0.9, "floor", ""),
    "washbasin": (0.8, 0.85, 0.48, "floor", ""), "mirror": (0.7, 0.8, 0.03, "wall", ""),
    "towel_rail": (0.5, 1.2, 0.1, "wall", ""), "bath_mat": (0.8, 0.015, 0.5, "floor", ""),
    "laundry_basket": (0.42, 0.6, 0.42, "floor", ""), "bathroom_cabinet": (0.4, 1.7, 0.35, "floor", ""),
    "kitchen_counter": (2.4, 0.9, 0.63, "floor", "worktop"), "wall_cabinet": (1.8, 0.7, 0.36, "wall", ""),
    "fridge": (0.6, 1.85, 0.65, "floor", ""), "oven_unit": (0.6, 2.1, 0.62, "floor", ""),
    "extractor_hood": (0.6, 0.7, 0.5, "wall", ""), "dining_table": (1.6, 0.75, 0.9, "floor", "side_table"),
    "chair": (0.45, 0.85, 0.5, "floor", ""), "kitchen_shelf": (0.9, 0.25, 0.24, "wall", "shelf"),
    "sofa": (2.1, 0.82, 0.92, "floor", ""), "armchair": (0.82, 0.85, 0.85, "floor", ""),
    "coffee_table": (1.1, 0.42, 0.6, "floor", "side_table"), "tv_stand": (1.6, 1.25, 0.42, "floor", ""),
    "bookshelf": (0.9, 1.95, 0.32, "floor", "shelf"), "side_table": (0.48, 0.55, 0.48, "floor", "side_table"),
    "sideboard": (1.6, 0.78, 0.44, "floor", "side_table"), "rug": (2.3, 0.012, 1.6, "floor", ""),
    "floor_lamp": (0.42, 1.6, 0.42, "floor", ""), "plant": (0.6, 1.2, 0.6, "floor", ""),
    "picture": (0.7, 0.5, 0.03, "wall", ""), "curtains": (2.0, 2.4, 0.14, "wall", ""),
    "bed": (1.7, 1.0, 2.1, "floor", ""), "wardrobe": (1.5, 2.1, 0.6, "floor", ""),
    "nightstand": (0.45, 0.5, 0.4, "floor", "side_table"), "ceiling_lamp": (0.4, 0.5, 0.4, "ceiling", ""),
    "radiator": (1.0, 0.6, 0.1, "wall", ""), "door_leaf": (0.8, 2.0, 0.1, "floor", ""),
    "coat_rack": (0.8, 0.3, 0.2, "wall", ""), "shoe_cabinet": (0.8, 0.9, 0.3, "floor", "side_table"),
    "stool": (0.35, 0.45, 0.35, "floor", ""), "desk": (1.3, 0.75, 0.65, "floor", "side_table"),
    "waste_bin": (0.28, 0.35, 0.28, "floor", ""), "shelf_board": (0.8, 0.04, 0.22, "wall", "shelf"),
}
KINDS = dict.fromkeys(_SIZES)


def build_furniture(kind: str, palette: Palette, rng: np.random.Generator, **options: object) -> Furniture:
    """Skeleton: a box with the kind's size; options length/width/height/features are honoured later too."""
    w, h, d, mount, support = _SIZES[kind]
    w = float(options.get("length") or options.get("width") or w)  # type: ignore[arg-type]
    h = float(options.get("height") or h)  # type: ignore[arg-type]
    centre = {"floor": (0, h / 2, 0), "wall": (0, 0, d / 2), "ceiling": (0, -h / 2, 0)}[mount]
    b = MeshBuilder(TILES).box((w, h, d), centre, palette.material("wood"), bevel=0.005, segments=1)
    supports: tuple[Support, ...] = ()
    if support:
        y = h if mount == "floor" else h / 2
        z = -d / 2 if mount == "floor" else 0.0
        supports = (Support(support, "", (-w / 2 + 0.03, y, z + 0.03), (w - 0.06, 0, 0), (0, 0, d - 0.06), (0, 1, 0), (0, 0, 1), 0.45),)  # type: ignore[arg-type]
    return Furniture(kind, b.build(), supports, mount)
