"""Intervals of means: determined by the seed, independent of the order, and about as wide as the theory predicts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from benchmarks.home_coverage import coverage
from evaluators.statistics import bootstrap
from evaluators.statistics.bootstrap import difference_interval, interval

values = st.lists(st.floats(0, 1), min_size=2, max_size=40)


@given(values, st.randoms(use_true_random=False))
@settings(max_examples=30)
def test_order_changes_nothing_and_the_mean_lies_within(numbers: list[float], random: Any):
    low, high = interval(numbers, resamples=500, fewest=2)
    assert (low, high) == interval(random.sample(numbers, len(numbers)), resamples=500, fewest=2)
    assert min(numbers) <= low <= high <= max(numbers)


def test_one_value_has_no_interval():
    assert interval([0.5]) is None
    assert interval([]) is None
    assert interval([0.5], fewest=0) is None


def test_five_values_are_too_few_and_six_are_enough():
    assert interval([0.1, 0.2, 0.3, 0.4, 0.5]) is None
    assert interval([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) is not None
    # All values on one side of the median: 2/2ⁿ, the least share of cases that an interval within their range misses.
    assert 2 / 2 ** (bootstrap.FEWEST - 1) > 1 - bootstrap.CONFIDENCE >= 2 / 2**bootstrap.FEWEST


def test_equal_values_have_an_interval_of_no_width():
    assert interval([0.1] * 7) == (0.1, 0.1)


def test_it_is_as_wide_as_the_normal_approximation_says():
    sample = np.random.default_rng(5).normal(0.5, 0.1, 200)
    low, high = interval(list(sample))
    error = sample.std() / np.sqrt(len(sample))
    assert low == pytest.approx(sample.mean() - 1.96 * error, abs=0.1 * error)
    assert high == pytest.approx(sample.mean() + 1.96 * error, abs=0.1 * error)


def test_it_covers_the_true_mean_as_often_as_it_says():
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(300):
        low, high = interval(list(rng.uniform(0, 1, 34)), resamples=1000)
        hits += low <= 0.5 <= high
    assert 0.90 <= hits / 300 <= 0.98


def test_blocks_change_no_draw(monkeypatch: pytest.MonkeyPatch):
    numbers = list(np.random.default_rng(0).uniform(0, 1, 30))
    whole = interval(numbers, resamples=1000)
    monkeypatch.setattr(bootstrap, "_BLOCK", 30 * 64)
    assert interval(numbers, resamples=1000) == whole


def test_another_seed_draws_otherwise():
    numbers = list(np.random.default_rng(0).uniform(0, 1, 30))
    assert interval(numbers, seed=1) != interval(numbers, seed=0)


# --- Differences: corrected intervals ---------------------------------------------------------------------------------


def scipys(sums: np.ndarray, sizes: np.ndarray, method: str) -> tuple[float, float]:
    """The same interval by scipy, from the same draws."""
    draws = np.random.default_rng(np.random.SeedSequence([bootstrap.SEED, len(sums)]))
    found = stats.bootstrap(
        (sums, sizes), lambda a, b, axis=-1: a.sum(axis=axis) / b.sum(axis=axis), n_resamples=1000, paired=True,
        vectorized=True, method=method, rng=draws,
    )  # fmt: skip
    return found.confidence_interval.low, found.confidence_interval.high


@pytest.mark.parametrize("count", [6, 19, 20, 34])
def test_the_interval_of_differences_is_scipys(count: int):
    """Skewed values, so that bias and skewness matter."""
    values = np.sort(np.random.default_rng(count).gamma(0.7, 0.2, count)) - 0.1
    found = difference_interval([[value] for value in values], resamples=1000)
    assert found is not None
    assert found.method == ("BCa" if count >= 20 else "percentile")
    expected = scipys(values, np.ones(count), found.method)
    assert (found.low, found.high) == pytest.approx(expected, abs=1e-12)


def test_the_interval_of_clusters_is_scipys():
    rng = np.random.default_rng(8)
    clusters = sorted(sorted(rng.gamma(0.7, 0.2, int(rng.integers(1, 6))).tolist()) for _ in range(16))
    found = difference_interval(clusters, resamples=1000, bca_fewest=16)
    sums, sizes = np.array([sum(one) for one in clusters]), np.array([float(len(one)) for one in clusters])
    assert found is not None
    assert (found.low, found.high) == pytest.approx(scipys(sums, sizes, "BCa"), abs=1e-12)


def test_the_correction_moves_the_interval_of_skewed_values_towards_the_long_tail():
    values = [[0.0]] * 14 + [[0.1]] * 4 + [[0.9]] * 2
    plain = bootstrap.clustered_interval(values)
    found = difference_interval(values)
    assert found is not None
    assert plain is not None
    assert found.low > plain[0]
    assert found.high > plain[1]


def test_equal_differences_have_an_interval_of_no_width():
    found = difference_interval([[0.1]] * 24)
    assert found is not None
    assert (found.low, found.high) == (0.1, 0.1)


def test_few_differences_have_no_interval():
    assert difference_interval([[0.1], [0.2], [0.3], [0.4], [0.5]]) is None
    assert difference_interval([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]]) is None


# --- Homes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("between", "within"), [(0.15, 0.15), (0.1, 0.15), (0.05, 0.2), (0.0, 0.2)])
def test_eight_homes_of_three_groups_hold_the_true_mean(between: float, within: float):
    nested, alone = coverage(8, 3, between, within, trials=300, seed=3)
    assert 0.90 <= nested <= 0.99
    assert nested >= alone


def test_groups_alone_hold_it_too_seldom_where_homes_differ():
    nested, alone = coverage(8, 3, 0.15, 0.1, trials=300, seed=3)
    assert alone < 0.8 < nested


def test_one_home_and_homes_of_one_group_are_the_ordinary_bootstrap():
    clusters = [[0.1, 0.3], [0.2], [0.9], [0.4, 0.4, 0.5], [0.0], [0.7], [0.6]]
    plain = bootstrap.clustered_interval(clusters)
    assert plain is not None
    assert bootstrap.clustered_interval(clusters, homes=["a"] * 7) == plain
    assert bootstrap.clustered_interval(clusters, homes=list("abcdefg")) == plain


def test_names_and_order_of_homes_change_nothing():
    rng = np.random.default_rng(4)
    clusters = [rng.uniform(0, 1, int(rng.integers(1, 4))).tolist() for _ in range(12)]
    homes = [place % 4 for place in range(12)]
    found = bootstrap.clustered_interval(clusters, homes=homes)
    turned = bootstrap.clustered_interval(clusters[::-1], homes=[f"home {7 * home}" for home in homes[::-1]])
    assert found == turned


def test_homes_that_are_alike_within_count_once_each():
    """Twelve groups of six homes, two alike in each: the resamples of a home's mean are those of six values."""
    values = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    found = bootstrap.clustered_interval(
        [[v] for v in values for _ in range(2)], homes=[h for h in range(6) for _ in "ab"]
    )
    assert found == pytest.approx(interval(values), abs=0.02)


def test_the_variance_of_a_resampled_mean_is_that_of_the_two_stages():
    """Var = (H−1)/H · s_b² / H + Σ_h s_h² / (H²·m), with the population variances of homes' means and within a home."""
    rng = np.random.default_rng(6)
    table = rng.normal(0, 1, (5, 1)) + rng.normal(0, 0.7, (5, 4))
    clusters = [[float(value)] for value in table.ravel()]
    resampled = bootstrap._Resampled.of(clusters, np.repeat(np.arange(5), 4).tolist(), 2, 200_000, 0)
    assert resampled is not None
    expected = table.mean(axis=1).var() / 5 + table.var(axis=1).mean() / (5 * 4)
    assert resampled.means.var() == pytest.approx(expected, rel=0.02)
    assert resampled.means.mean() == pytest.approx(table.mean(), abs=0.01)


def test_blocks_change_no_draw_of_homes(monkeypatch: pytest.MonkeyPatch):
    clusters = [[float(value)] for value in np.random.default_rng(0).uniform(0, 1, 30)]
    homes = [place % 5 for place in range(30)]
    whole = bootstrap.clustered_interval(clusters, homes=homes, resamples=1000)
    monkeypatch.setattr(bootstrap, "_BLOCK", 30 * 64)
    assert bootstrap.clustered_interval(clusters, homes=homes, resamples=1000) != (0, 1)
    assert whole == pytest.approx(bootstrap.clustered_interval(clusters, homes=homes, resamples=1000), abs=0.03)


def test_differences_are_corrected_from_twenty_homes_on():
    rng = np.random.default_rng(9)
    values = [[float(value)] for value in rng.gamma(0.7, 0.2, 48)]
    few, many = [place // 6 for place in range(48)], [place // 2 for place in range(48)]
    assert difference_interval(values, homes=few).method == "percentile"  # type: ignore[union-attr]
    assert difference_interval(values, homes=many).method == "BCa"  # type: ignore[union-attr]
    assert difference_interval(values).method == "BCa"  # type: ignore[union-attr]


def test_few_homes_are_said():
    assert bootstrap.homes_note(["a"] * 9) == (
        "one home: the intervals resample what is in it, and say nothing of other homes"
    )
    assert bootstrap.homes_note(["a", "b", "b"]) == "2 homes, fewer than 6: the intervals are too narrow"
    assert bootstrap.homes_note([str(home) for home in range(6)]) is None
    assert bootstrap.homes_note([]) is None
