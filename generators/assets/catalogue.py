"""Catalogue of the procedural models: the seven sounding categories, and the distractors, which are always silent.

A category has variants, the products of the benchmarks, and training variants: families that draw another product from
each generator state, so that what is trained on them has not seen a model of a benchmark.
"""

from __future__ import annotations

from numpy.random import Generator

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, check_category
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from generators.assets.model import Model, framed
from generators.assets.objects import (
    clock,
    coffee_machine,
    dishwasher,
    fan,
    kettle,
    microwave,
    oven,
    radio,
    telephone,
    toilet,
    vacuum_cleaner,
    washing_machine,
)
from generators.assets.objects.design import Build, Mount
from generators.assets.objects.training import (
    clocks,
    coffee_machines,
    dishwashers,
    fans,
    kettles,
    microwaves,
    ovens,
    radios,
    telephones,
    toilets,
    vacuum_cleaners,
    washing_machines,
)
from generators.core.scene import Licence

__all__ = ["Model", "Mount", "build_model", "framed", "training_variants", "variants"]

_VARIANTS: dict[str, dict[str, Build]] = {
    "washing_machine": washing_machine.VARIANTS,
    "toilet": toilet.VARIANTS,
    "vacuum_cleaner": vacuum_cleaner.VARIANTS,
    "microwave": microwave.VARIANTS,
    "coffee_machine": coffee_machine.VARIANTS,
    "clock": clock.VARIANTS,
    "telephone": telephone.VARIANTS,
    "oven": oven.VARIANTS,
    "dishwasher": dishwasher.VARIANTS,
    "kettle": kettle.VARIANTS,
    "fan": fan.VARIANTS,
    "radio": radio.VARIANTS,
}
_FAMILIES: dict[str, dict[str, Build]] = {
    "washing_machine": washing_machines.FAMILIES,
    "toilet": toilets.FAMILIES,
    "vacuum_cleaner": vacuum_cleaners.FAMILIES,
    "microwave": microwaves.FAMILIES,
    "coffee_machine": coffee_machines.FAMILIES,
    "clock": clocks.FAMILIES,
    "telephone": telephones.FAMILIES,
    "oven": ovens.FAMILIES,
    "dishwasher": dishwashers.FAMILIES,
    "kettle": kettles.FAMILIES,
    "fan": fans.FAMILIES,
    "radio": radios.FAMILIES,
}
if not set(_VARIANTS) == set(_FAMILIES) == {*CATEGORIES, *DISTRACTORS}:
    raise RuntimeError("the catalogue's categories differ from the taxonomy's")


def variants(category: str) -> tuple[str, ...]:
    """The names of a category's variants, of which a benchmark draws one.

    Raises:
        UsageError: if the category is unknown.

    Examples:
        >>> variants("microwave")
        ('steel', 'white', 'black')
    """
    return tuple(_VARIANTS[check_category(category, silent=True)])


def training_variants(category: str) -> tuple[str, ...]:
    """The names of a category's families for training; no benchmark draws them, and none is a name of `variants`.

    Raises:
        UsageError: if the category is unknown.

    Examples:
        >>> len(training_variants("microwave")), set(training_variants("microwave")) & set(variants("microwave"))
        (3, set())
    """
    return tuple(_FAMILIES[check_category(category, silent=True)])


def build_model(category: str, variant: str, rng: Generator) -> Model:
    """Build a model; the same generator state gives the same model.

    Args:
        category: one of the seven categories or a distractor.
        variant: one of `variants` or `training_variants`.
        rng: chooses the differences between two copies of a product (a colour, the time on a clock), or the product of
            a family.

    Raises:
        UsageError: if the category or the variant is unknown.
    """
    known = (*variants(category), *training_variants(category))
    if variant not in known:
        hint = did_you_mean(variant, known)
        raise UsageError(f"unknown variant {excerpt(variant)} of {category}: expected one of {', '.join(known)}{hint}")
    build = _VARIANTS[category].get(variant) or _FAMILIES[category][variant]
    design = framed(build(rng))
    name = f"{category}/{variant}"
    design.mesh.check(name)
    return Model(name, category, design.mesh, design.mount, Licence(), design.source_point)
