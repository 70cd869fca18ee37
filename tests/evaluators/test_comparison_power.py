"""How often `avs3d compare` is wrong: the recorded simulation, and a smaller one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.formats.files import read_json
from benchmarks import comparison_power
from benchmarks.comparison_power import METHODS, WORLDS, coverage, power, type_1
from evaluators.statistics.sign_flips import LEVEL, sign_flip_p_values

DOCS = Path(__file__).parents[2] / "docs"
RECORDED: dict[str, Any] = read_json(DOCS / "results" / "comparison-power.json")
ANY = f"any pair of {METHODS}"


def limit(trials: int) -> float:
    """The largest share of errors that a test of that level makes by chance: four standard errors above."""
    return float(LEVEL + 4 * np.sqrt(LEVEL * (1 - LEVEL) / trials))


def test_recorded_errors_are_five_per_cent_where_methods_can_be_exchanged() -> None:
    trials, few = RECORDED["trials"], RECORDED["trials of several methods and of intervals"]
    for world in ("IoU", "rare errors"):
        for by_case in RECORDED["type I"][world].values():
            assert by_case["two methods"]["share"] <= limit(trials)
            assert by_case[ANY]["share"] <= limit(few)
    for count in ("9", "20", "34", "94"):
        assert RECORDED["type I"]["IoU"][count]["two methods"]["share"] >= 0.04, "not merely cautious"
    for by_count in RECORDED["power"].values():
        shares = [by_count[count]["share"] for count in sorted(by_count, key=int)]
        assert np.all(np.diff(shares) > -0.01), "more observations find more"


@pytest.mark.parametrize("world", WORLDS)
def test_methods_of_a_world_have_one_mean(world: str) -> None:
    scores = WORLDS[world](np.random.default_rng(0), (200_000,), 3)
    assert scores.shape == (200_000, 3)
    means = scores.mean(axis=0)
    assert means == pytest.approx(np.full(3, means.mean()), abs=0.003)


@pytest.mark.slow
def test_a_smaller_simulation_finds_the_recorded_errors() -> None:
    found = type_1("IoU", 20, 2000, seed=1)
    assert 0.03 <= found["two methods"]["share"] <= limit(2000)
    assert found[ANY]["share"] <= limit(500)


@pytest.mark.slow
def test_a_smaller_simulation_finds_the_recorded_coverage_and_power() -> None:
    for share, recorded in (
        (coverage("IoU", 34, 500, seed=1)["BCa"], RECORDED["coverage"]["IoU"]["34"]["BCa"]),
        (power(0.2, 34, 1000, seed=1), RECORDED["power"]["0.2"]["34"]),
        (power(0.1, 94, 1000, seed=1), RECORDED["power"]["0.1"]["94"]),
    ):
        assert share["share"] == pytest.approx(recorded["share"], abs=4 * (share["error"] + recorded["error"]))


@pytest.mark.slow
def test_errors_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test without correction, or one whose p-values are too small, is found out."""
    monkeypatch.setattr(comparison_power, "holm", lambda p_values: list(p_values))
    assert type_1("IoU", 20, 2000, seed=1)[ANY]["share"] > limit(500)
    monkeypatch.setattr(comparison_power, "sign_flip_p_values", lambda values: sign_flip_p_values(values) / 2)
    assert type_1("IoU", 20, 2000, seed=1)["two methods"]["share"] > limit(2000)


def test_differences_of_one_mean_and_another_shape_are_not_what_the_test_assumes() -> None:
    """The table says so: the sign of a skewed difference is no coin."""
    scores = WORLDS["skewed"](np.random.default_rng(3), (9, 2000), 2)
    share = (sign_flip_p_values(scores[..., 0] - scores[..., 1]) < LEVEL).mean()
    assert share > limit(2000)


@pytest.mark.slow
def test_siblings_must_change_sign_together() -> None:
    """Differences that siblings share: with a sign for each sibling, equal methods are separated far too often."""
    groups, siblings, trials = 16, 6, 2000
    rng = np.random.default_rng(4)
    shared = rng.normal(0, 1, (groups, 1, trials))
    differences = shared + rng.normal(0, 0.5, (groups, siblings, trials))
    together = (sign_flip_p_values(differences.sum(axis=1)) < LEVEL).mean()
    apart = (sign_flip_p_values(differences.reshape(-1, trials)) < LEVEL).mean()
    assert 0.03 <= together <= limit(trials)
    assert apart > 0.3
