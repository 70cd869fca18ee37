"""The sign-flip test, Holm's correction and shared places: against scipy, by hand, and by their properties."""

from __future__ import annotations

import doctest
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from evaluators.statistics import sign_flips
from evaluators.statistics.sign_flips import FLIPS, MOST_FLIPS, flips_for, holm, is_exact, places, sign_flip_p_values

differences = st.lists(st.integers(-20, 20).map(lambda number: number / 10), min_size=1, max_size=9)


def by_hand(values: list[float]) -> float:
    """All patterns, one after the other."""
    sums = [abs(sum(s * v for s, v in zip(signs, values, strict=True)))
            for signs in itertools.product((1, -1), repeat=len(values))]  # fmt: skip
    return sum(one >= abs(sum(values)) - 1e-9 for one in sums) / len(sums)


def test_the_examples_of_the_docstrings() -> None:
    found = doctest.testmod(sign_flips)
    assert found.attempted >= 3
    assert found.failed == 0


@given(differences)
@settings(max_examples=50)
def test_few_values_are_tested_with_every_pattern(values: list[float]) -> None:
    (p,) = sign_flip_p_values(np.array(values)[:, None])
    assert p == by_hand(values)


@pytest.mark.parametrize("count", [3, 8, 13])
def test_it_is_scipys_permutation_test(count: int) -> None:
    values = np.random.default_rng(count).normal(0.3, 1, count)
    expected = stats.permutation_test((values,), np.mean, permutation_type="samples", n_resamples=2**count)
    assert sign_flip_p_values(values[:, None])[0] == pytest.approx(expected.pvalue, abs=1e-12)


def test_random_patterns_come_close_to_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(3).normal(0.5, 1, (12, 4))
    exact = sign_flip_p_values(values)
    monkeypatch.setattr(sign_flips, "is_exact", lambda count, flips: False)
    drawn = sign_flip_p_values(values)
    assert drawn != pytest.approx(exact, abs=1e-12), "the patterns were drawn"
    assert drawn == pytest.approx(exact, abs=4 * np.sqrt(0.25 / FLIPS))


@given(st.lists(st.floats(-1, 1), min_size=20, max_size=30), st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_neither_the_order_nor_which_is_first_changes_a_p_value(values: list[float], random) -> None:
    shuffled = random.sample(values, len(values))
    columns = np.array([values, shuffled, [-value for value in values]]).T
    one, other, swapped = sign_flip_p_values(columns, flips=500)
    assert one == other == swapped
    assert 1 / 500 <= one <= 1


def test_equal_values_have_p_1_and_a_random_test_never_has_0() -> None:
    assert sign_flip_p_values(np.zeros((30, 1)))[0] == 1
    assert sign_flip_p_values(np.ones((30, 1)))[0] == 1 / FLIPS
    assert sign_flip_p_values(np.ones((1, 1)))[0] == 1, "one value cannot say anything"
    assert sign_flip_p_values(np.empty((0, 2))).tolist() == [1, 1]


def test_blocks_change_no_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).normal(0.2, 1, (30, 3))
    few = values[:10]
    whole = [sign_flip_p_values(each).tolist() for each in (values, few)]
    monkeypatch.setattr(sign_flips, "_BLOCK", 30 * 64)
    assert [sign_flip_p_values(each).tolist() for each in (values, few)] == whole


def test_more_tests_have_more_patterns_so_that_the_least_corrected_p_value_stays_small() -> None:
    assert flips_for(1) == FLIPS
    assert flips_for(10**6) == MOST_FLIPS
    for pairs in range(1, 500):
        assert pairs / flips_for(pairs) <= 0.005
    assert is_exact(13, FLIPS)
    assert not is_exact(14, FLIPS)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_is_the_step_down_procedure(p_values: list[float]) -> None:
    """Hypotheses are rejected in the order of their p-values until one is above level / (number that is left)."""
    corrected = holm(p_values)
    for level in (0.01, 0.05, 0.5):
        rejected: set[int] = set()
        order = sorted(range(len(p_values)), key=p_values.__getitem__)
        for rank, index in enumerate(order):
            if (len(p_values) - rank) * p_values[index] > level:
                break
            rejected.add(index)
        assert {index for index, value in enumerate(corrected) if value <= level} == rejected


def test_holm_of_nothing_is_nothing() -> None:
    assert holm([]) == []


@given(st.integers(1, 7), st.data())
def test_different_places_mean_that_a_test_separates(count: int, data: st.DataObject) -> None:
    names = [str(index) for index in range(count)]
    above = {pair: data.draw(st.booleans()) for pair in itertools.combinations(names, 2)}
    found = places(names, lambda better, worse: above[better, worse])
    assert found["0"] == 1
    for better, worse in itertools.combinations(names, 2):
        assert found[better] <= found[worse]
        if found[better] < found[worse]:
            assert above[better, worse]
    # Nothing is shared without need: where all above are separated from all below, a new place begins.
    for index in range(1, count):
        cut = all(above[better, worse] for better in names[:index] for worse in names[index:])
        assert (found[names[index]] == index + 1) == cut


def test_a_chain_shares_a_place() -> None:
    """The first is better than the third, and neither is separated from the second."""
    assert places(["a", "b", "c"], lambda better, worse: (better, worse) == ("a", "c")) == {"a": 1, "b": 1, "c": 1}
