"""Paired differences between kinds of pictures and between methods, from known scores."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.pictures_who_wins import MANIFEST, OBSERVATIONS, comparisons, difference, less
from generators.manifest.reading import read_manifest


def scores(mean: float, seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {key: mean + 0.02 * rng.standard_normal() for key in OBSERVATIONS}


def test_a_lead_that_turns_with_the_pictures_is_found() -> None:
    tables = {
        "baked": {"2d": scores(0.5, 1), "official": scores(0.5, 2), "spatial": scores(0.7, 3)},
        "pathtraced": {"2d": scores(0.5, 4), "official": scores(0.5, 5), "spatial": scores(0.4, 6)},
    }
    found = comparisons(tables)
    lead = "EchoSegnet spatial less listener, 2D"
    assert found[f"{lead}, baked"]["mean"] == pytest.approx(0.2, abs=0.02)
    assert found[f"{lead}, pathtraced"]["mean"] == pytest.approx(-0.1, abs=0.02)
    change = found[f"change of ({lead})"]
    assert change["mean"] == pytest.approx(-0.3, abs=0.03)
    assert change["interval"][0] < change["mean"] < change["interval"][1] < 0
    assert change["p"] < 0.01
    same = found["listener, 2D: path traced less baked"]
    assert same["interval"][0] < 0 < same["interval"][1]
    assert same["p"] > 0.1


def test_only_observations_that_both_have_are_compared() -> None:
    first, second = scores(0.5, 1), scores(0.4, 2)
    del second[OBSERVATIONS[0]]
    found = difference(less(first, second))
    assert found["observations"] == len(OBSERVATIONS) - 1


def test_the_observations_are_of_all_homes_and_categories_of_the_open_benchmark() -> None:
    specs = {str(spec.key): spec for spec in read_manifest(MANIFEST).manifest.observations}
    chosen = [specs[key] for key in OBSERVATIONS]
    assert {spec.scan for spec in chosen} == {spec.scan for spec in specs.values()}
    assert {spec.category for spec in chosen} == {spec.category for spec in specs.values()}
    assert sum(spec.part == "part_2" for spec in chosen) == len(chosen) / 2
