"""The sign-flip permutation test of paired differences, Holm's correction for several tests, and shared places.

If two methods are equally good, each observation's difference is as likely to be +d as −d, whatever its distribution
(Fisher 1935). The test counts how often the mean of differences with random signs is at least as far from 0 as the
observed one. Observations that share their pictures change sign together. docs/comparing.md has worked examples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Sign patterns of a test, the observed one among them: at least this many …
FLIPS = 10_000
#: … more for many tests at a time, so that Holm's factor leaves small p-values small …
FLIPS_PER_TEST = 500
#: … and at most this many.
MOST_FLIPS = 100_000
SEED = 0
#: p-value after Holm's correction below which two methods are separated.
LEVEL = 0.05
#: Signs drawn at a time, so that memory does not grow with the number of observations.
_BLOCK = 2_000_000


def flips_for(tests: int) -> int:
    """Number of sign patterns for so many tests at a time."""
    return min(max(FLIPS, FLIPS_PER_TEST * tests), MOST_FLIPS)


def is_exact(count: int, flips: int) -> bool:
    """Whether all 2ⁿ sign patterns of ``count`` values are tried: if they are no more than ``flips``."""
    return count < 64 and 2**count <= flips


def _patterns(count: int, flips: int, seed: int) -> Iterator[NDArray[np.floating]]:
    """Blocks of rows of signs: one of every two opposite patterns if all are tried, else ``flips`` − 1 random ones."""
    rows = max(1, _BLOCK // count)
    if is_exact(count, flips):
        # Opposite patterns have opposite sums: half of them, with the last sign positive, have all distances from 0.
        for start in range(0, 2 ** (count - 1), rows):
            numbers = np.arange(start, min(start + rows, 2 ** (count - 1)))
            yield 1.0 - 2.0 * (numbers[:, None] >> np.arange(count) & 1)
        return
    rng = np.random.default_rng(np.random.SeedSequence([seed, count]))
    for start in range(0, flips - 1, rows):
        signs = rng.integers(0, 2, (min(rows, flips - 1 - start), count), dtype=np.int8)
        yield 2.0 * signs - 1.0


def sign_flip_p_values(differences: ArrayLike, *, flips: int = FLIPS, seed: int = SEED) -> NDArray[np.float64]:
    """Two-sided p-values of mean differences, one test per column; the tests share their sign patterns.

    `scipy.stats.permutation_test` computes the same where all patterns are tried (tests/evaluators/test_sign_flips.py);
    it needs seconds for one test of 34 differences.

    Args:
        differences: (n, tests); the row of an observation, or of a group of them its sum of differences.
        flips: sign patterns; if there are no more than so many in all, each is tried once and the p-value is exact.
            Else the observed pattern and ``flips`` − 1 random ones: no p-value is below 1 / ``flips``.
        seed: of the random signs.

    Returns:
        (tests,) shares of the patterns whose sum is at least as far from 0 as the observed one; 1 of no differences.

    Examples:
        >>> sign_flip_p_values([[0.1], [0.2], [0.4], [0.3]]).tolist()  # all of one sign: 2 of 2⁴ patterns
        [0.125]
    """
    values = np.asarray(differences, dtype=np.float64)
    count, tests = values.shape
    if count == 0:
        return np.ones(tests)
    # Sums of the same numbers may differ in the last bits.
    observed = np.abs(values.sum(axis=0)) - 1e-12 * np.abs(values).sum(axis=0)
    # Signs are random: those of the differences, and their order, make no difference.
    sizes = np.sort(np.abs(values), axis=0)
    tried = 0 if is_exact(count, flips) else 1  # the observed pattern
    found = np.full(tests, tried, dtype=np.int64)
    for signs in _patterns(count, flips, seed):
        found += (np.abs(signs @ sizes) >= observed).sum(axis=0)
        tried += len(signs)
    return found / tried


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values corrected for their number (Holm 1979): the chance of any false rejection is at most the level.

    The k-th smallest of m is multiplied by m − k + 1, and none becomes smaller than one that was smaller before.

    Examples:
        >>> holm([0.03, 0.01, 0.04])
        [0.06, 0.03, 0.06]
    """
    order = sorted(range(len(p_values)), key=p_values.__getitem__)
    corrected, largest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def places(ordered: Sequence[str], separated: Callable[[str, str], bool]) -> dict[str, int]:
    """Places from 1, shared where nothing separates: two methods have different places only if a test separates them.

    A new place begins where every method above is separated from every method below. Methods that share a place need
    not all be equal: a chain of neighbours that are too close to be separated shares one place.

    Args:
        ordered: names, the best mean first.
        separated: whether the first of two is better by a test.

    Examples:
        >>> places(["a", "b", "c"], lambda better, worse: worse == "c")
        {'a': 1, 'b': 1, 'c': 3}
    """
    found: dict[str, int] = {}
    place = 1
    for index, name in enumerate(ordered):
        if all(separated(above, below) for above in ordered[:index] for below in ordered[index:]):
            place = index + 1
        found[name] = place
    return found
