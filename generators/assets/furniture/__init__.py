"""Furniture: about forty kinds, each with variants, as `Furniture` records in their own frame.

`build_furniture` makes one piece from a palette (materials and common details of the flat, such as its handles) and a
random number generator (the form of this piece). `KINDS` maps a kind's name to a function that makes it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from avs3d_bench.errors import UsageError, did_you_mean
from generators.assets.furniture import (
    bath,
    bathroom,
    bedroom,
    counter,
    decor,
    dining,
    kitchen,
    lamps,
    plants,
    seating,
    storage,
    tables,
)
from generators.assets.furniture.common import Furniture, Kit, Mount
from generators.assets.materials import Palette

__all__ = ["KINDS", "Furniture", "Mount", "build_furniture", "options_of"]

_BUILDERS: dict[str, Callable[..., None]] = {
    builder.__name__: builder
    for builder in (
        bath.bathtub,
        bath.shower,
        bathroom.washbasin,
        bathroom.vanity_cabinet,
        bathroom.towel_rail,
        bathroom.bath_mat,
        bathroom.laundry_basket,
        bathroom.bathroom_cabinet,
        counter.kitchen_counter,
        kitchen.wall_cabinet,
        kitchen.fridge,
        kitchen.oven_unit,
        kitchen.extractor_hood,
        kitchen.kitchen_shelf,
        dining.dining_table,
        dining.chair,
        dining.stool,
        dining.waste_bin,
        seating.sofa,
        seating.armchair,
        tables.coffee_table,
        tables.side_table,
        tables.tv_stand,
        tables.desk,
        storage.bookshelf,
        storage.sideboard,
        storage.shelf_board,
        storage.shoe_cabinet,
        storage.coat_rack,
        storage.wardrobe,
        bedroom.bed,
        bedroom.nightstand,
        decor.rug,
        plants.plant,
        decor.picture,
        decor.curtains,
        lamps.floor_lamp,
        lamps.ceiling_lamp,
        decor.radiator,
        decor.door_leaf,
    )
}


def options_of(kind: str) -> tuple[str, ...]:
    """The names of the options that `build_furniture` takes for a kind (``length``, ``width``, ``features``, …)."""
    return tuple(inspect.signature(_builder(kind)).parameters)[1:]


def _builder(kind: str) -> Callable[..., None]:
    if kind not in _BUILDERS:
        hint = did_you_mean(kind, _BUILDERS)
        raise UsageError(f"unknown furniture {kind!r}: expected one of {', '.join(_BUILDERS)}{hint}")
    return _BUILDERS[kind]


def build_furniture(kind: str, palette: Palette, rng: np.random.Generator, **options: object) -> Furniture:
    """Make one piece of furniture.

    Args:
        kind: a key of `KINDS`.
        palette: the flat's materials.
        rng: chooses the variant, its proportions and the small things on it.
        **options: options of the kind (see `options_of`); lengths in metres; None: chosen by ``rng``.

    Returns:
        The piece in its own frame; the same bytes for the same palette, ``rng`` state and options.

    Raises:
        UsageError: if the kind or an option does not exist, or a length is not a positive number.
    """
    builder = _builder(kind)
    allowed = options_of(kind)
    for name, value in options.items():
        if name not in allowed:
            raise UsageError(f"{kind}: no option {name!r}; expected one of {', '.join(allowed) or 'none'}")
        if name in ("length", "width", "height") and value is not None and not 0 < float(str(value)) < 100:
            raise UsageError(f"{kind}: {name} is {value}, expected metres above 0")
    kit = Kit(palette, rng)
    builder(kit, **options)
    return kit.finish(kind)


def _bound(kind: str) -> Callable[..., Furniture]:
    def make(palette: Palette, rng: np.random.Generator, **options: object) -> Furniture:
        return build_furniture(kind, palette, rng, **options)

    return make


#: Kind → builder ``(palette, rng, **options) → Furniture``.
KINDS: dict[str, Callable[..., Furniture]] = {kind: _bound(kind) for kind in _BUILDERS}
