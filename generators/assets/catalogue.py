"""The objects that sound, and the oven that only looks as if it did.

Model frame: metres, Y up, front towards +Z. ``floor`` and ``surface`` models have their origin at the centre of their
footprint on the bottom (y = 0 is the support); ``wall`` models at the centre of the back face (z = 0 is the wall);
``wall_or_surface`` models at the middle of the lower edge of the back face, so that either contact is at 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from avs3d_bench.errors import UsageError
from avs3d_bench.taxonomy import CATEGORIES, DISTRACTORS, check_category
from generators.assets.objects import (
    clock,
    coffee_machine,
    microwave,
    oven,
    telephone,
    toilet,
    vacuum_cleaner,
    washing_machine,
)
from generators.assets.objects.design import Build, Design, Mount, Point
from generators.assets.objects.finishes import mirrored
from generators.scenes.scene import Licence, Mesh

__all__ = ["Model", "Mount", "build_model", "framed", "variants"]

_VARIANTS: dict[str, dict[str, Build]] = {
    "washing_machine": washing_machine.VARIANTS,
    "toilet": toilet.VARIANTS,
    "vacuum_cleaner": vacuum_cleaner.VARIANTS,
    "microwave": microwave.VARIANTS,
    "coffee_machine": coffee_machine.VARIANTS,
    "clock": clock.VARIANTS,
    "telephone": telephone.VARIANTS,
    "oven": oven.VARIANTS,
}
if set(_VARIANTS) != {*CATEGORIES, *DISTRACTORS}:
    raise RuntimeError("the catalogue's categories differ from the taxonomy's")


@dataclass(frozen=True, eq=False)
class Model:
    """One product, in the model frame; the identical instances of an observation share one.

    Attributes:
        name: ``category/variant``, or the file it was loaded from.
        category: see `avs3d_bench.taxonomy`.
        mesh: metres, Y up, front towards +Z.
        mount: what it stands on or hangs from.
        licence: of the mesh and its textures.
        source_point: where the sound leaves it, in the model frame; on or a little in front of its surface.
    """

    name: str
    category: str
    mesh: Mesh
    mount: Mount
    licence: Licence = field(default_factory=Licence)
    source_point: Point = (0.0, 0.0, 0.0)

    @property
    def size(self) -> tuple[float, float, float]:
        """Width (x), height (y) and depth (z) of the bounding box, metres."""
        x, y, z = (float(v) for v in np.diff(self.mesh.bounds, axis=0)[0])
        return x, y, z


def variants(category: str) -> tuple[str, ...]:
    """The names of a category's variants.

    Raises:
        UsageError: if the category is unknown.
    """
    return tuple(_VARIANTS[check_category(category, silent=True)])


def build_model(category: str, variant: str, rng: Generator) -> Model:
    """Build a model; the same generator state gives the same model.

    Args:
        category: one of the seven categories or a distractor.
        variant: one of `variants`.
        rng: chooses what differs between two copies of a product (a colour, the time a clock shows).

    Raises:
        UsageError: if the category or the variant is unknown.
    """
    known = variants(category)
    if variant not in known:
        raise UsageError(f"unknown variant {variant!r} of {category}: expected one of {', '.join(known)}")
    design = framed(_VARIANTS[category][variant](rng))
    name = f"{category}/{variant}"
    mesh = mirrored(design.mesh)
    mesh.check(name)
    return Model(name, category, mesh, design.mount, Licence(), design.source_point)


def framed(design: Design) -> Design:
    """``design`` moved into the model frame of its mount (see the module)."""
    low, high = design.mesh.bounds.astype(np.float64)
    middle = (low + high) / 2
    anchor = {
        "floor": (middle[0], low[1], middle[2]),
        "surface": (middle[0], low[1], middle[2]),
        "wall": (middle[0], middle[1], low[2]),
        "wall_or_surface": (middle[0], low[1], low[2]),
    }[design.mount]
    shift = -np.asarray(anchor, dtype=np.float64)
    x, y, z = (float(v) for v in np.asarray(design.source_point) + shift)
    return Design(design.mesh.transformed(np.eye(3), shift), design.mount, (x, y, z))
