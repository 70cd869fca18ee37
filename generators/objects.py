"""Objects to place in a home: procedural models of twelve categories, and meshes of one's own.

Examples:
    >>> from generators import Home, objects
    >>> home = Home.from_scan("room.glb", rooms={"kitchen": [[0, 0, 0], [4, 2.6, 3.6]]})
    >>> home.place([objects.build("microwave", seed=3), objects.build("clock", seed=1)], rng=2)
    <HomeScene room: kitchen; 1: microwave/black in the kitchen; 2: clock/square in the kitchen>
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS
from generators.assets.catalogue import Model, build_model, training_variants, variants
from generators.assets.meshfile import CategoryDefaults, load_model, usual_of
from generators.assets.objects.design import Mount
from generators.core.scene import Licence
from generators.core.seeds import random_numbers

__all__ = ["Model", "build", "categories", "load", "training_variants", "variants"]


def categories() -> tuple[str, ...]:
    """The categories of which there are models: the seven that sound, then those that are always silent in datasets.

    Examples:
        >>> categories()[:3]
        ('washing_machine', 'toilet', 'vacuum_cleaner')
    """
    return (*CATEGORIES, *DISTRACTORS)


def build(
    category: str, variant: str | None = None, *, seed: np.random.Generator | int = 0, among: Sequence[str] = ()
) -> Model:
    """Build a procedural model; the same arguments give the same model.

    Args:
        category: one of `categories`.
        variant: one of `variants` or `training_variants`; None: one is drawn.
        seed: random numbers, or their seed: they draw the variant, and what differs between two copies of a product (a
            colour, the time on a clock).
        among: the variants of which one is drawn; none: all of `variants`.

    Returns:
        The model: metres, Y up, front towards +Z.

    Raises:
        UsageError: if the category or the variant is unknown; the line names the nearest.

    Examples:
        >>> microwave = build("microwave", seed=3)
        >>> microwave.category, microwave.name.startswith("microwave/"), len(microwave.size)
        ('microwave', True, 3)
    """
    rng = random_numbers(seed, "seed")
    known = tuple(among) or variants(category)
    return build_model(category, variant or known[int(rng.integers(len(known)))], rng)


def load(
    path: str | Path,
    category: str,
    *,
    height: float | None = None,
    mount: Mount | None = None,
    licence: Licence | None = None,
    up: str = "y",
    front: str = "+z",
) -> Model:
    """Read a GLB, glTF, OBJ or PLY file as an object.

    Args:
        path: of the mesh, with its textures.
        category: one of `categories`; with ``mount``, any name.
        height: of the object, metres; None: the file's unit is the metre, or, where that is not plausible, the height
            is the usual one of the category.
        mount: where an object of a category of your own stands: floor, surface, wall or wall_or_surface.
        licence: of the file; None: it is not known.
        up: the file's axis that points up.
        front: the file's axis that points to the front.

    Raises:
        UsageError: for an unknown category without ``mount``, or axes that are not perpendicular.
        Avs3dError: if the file is missing or no mesh, or the height is not plausible.

    Examples:
        >>> import trimesh
        >>> _ = trimesh.creation.cylinder(radius=7, height=24).export("kettle.ply")  # in centimetres, along z
        >>> kettle = load("kettle.ply", "kettle", height=0.24, up="z", front="+y")
        >>> kettle.name, [round(side, 2) for side in kettle.size]  # width, height, depth (m)
        ('kettle.ply', [0.14, 0.24, 0.14])
    """
    usual = usual_of(category) if mount is None else CategoryDefaults(height or 0.3, mount, 0.5)
    terms = licence or Licence("unknown", "unknown", Path(path).name)
    return load_model(path, category, licence=terms, height=height, up=up, front=front, usual=usual)
