"""Bootstrap intervals of a mean over observations (Efron & Tibshirani 1993, percentile method).

Observations that share their pictures are not independent: `clustered_interval` resamples whole groups of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

#: The intervals hold 95 % of the means of this many resamples.
RESAMPLES = 10_000
CONFIDENCE = 0.95
SEED = 0
#: Least number of values with an interval. The means of resamples never leave the range of the values; n independent
#: values all lie on one side of their distribution's median with probability 2 / 2ⁿ, and five do so in more than 5 %.
FEWEST = 6
#: Resampled values at a time, so that memory does not grow with the number of observations.
_BLOCK = 2_000_000


def _blocks(count: int, resamples: int, seed: int) -> Iterator[NDArray[np.intp]]:
    rng = np.random.default_rng(np.random.SeedSequence([seed, count]))
    rows = max(1, _BLOCK // count)
    for start in range(0, resamples, rows):
        yield rng.integers(0, count, (min(rows, resamples - start), count), dtype=np.intp)


@lru_cache(maxsize=16)
def _small(count: int, resamples: int, seed: int) -> NDArray[np.intp]:
    """All resamples of a small group: one draw serves every figure of it."""
    return np.concatenate(list(_blocks(count, resamples, seed)))


def interval(
    values: Sequence[float],
    *,
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    fewest: int = FEWEST,
) -> tuple[float, float] | None:
    """The interval that holds ``confidence`` of the means of resamples (with replacement) of the values.

    The values are sorted first: their order changes nothing.

    Args:
        values: one per observation.
        resamples: how many.
        seed: of the draws; the same seed and number of values give the same draws.
        confidence: the share, centred.
        fewest: fewer values have no interval; at least 2.

    Returns:
        (low, high); None for fewer than ``fewest`` values.
    """
    if len(values) < max(2, fewest):
        return None
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    count = len(ordered)
    if count * resamples <= _BLOCK:
        means = ordered[_small(count, resamples, seed)].mean(axis=1)
    else:
        means = np.concatenate([ordered[block].mean(axis=1) for block in _blocks(count, resamples, seed)])
    tail = (1 - confidence) / 2
    low, high = np.quantile(means, [tail, 1 - tail])
    # A mean of equal numbers may differ from them in the last bit; an interval never leaves the values' range.
    return float(np.clip(low, ordered[0], ordered[-1])), float(np.clip(high, ordered[0], ordered[-1]))


def clustered_interval(
    clusters: Sequence[Sequence[float]],
    *,
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    fewest: int = FEWEST,
) -> tuple[float, float] | None:
    """The interval of the mean of all values, if clusters of them are resampled as a whole.

    A resample draws as many clusters as there are, with replacement; its mean is that of all values in them. The
    clusters are sorted first: their order, and that of their values, changes nothing.

    Args:
        clusters: the values of each; empty clusters are left out.
        resamples: how many.
        seed: of the draws; the same seed and number of clusters give the same draws.
        confidence: the share, centred.
        fewest: fewer clusters have no interval; at least 2.

    Returns:
        (low, high); None for fewer than ``fewest`` clusters.
    """
    ordered = sorted(sorted(cluster) for cluster in clusters if cluster)
    if len(ordered) < max(2, fewest):
        return None
    sums = np.array([math.fsum(cluster) for cluster in ordered])
    sizes = np.array([len(cluster) for cluster in ordered], dtype=np.float64)
    blocks = _blocks(len(ordered), resamples, seed)
    means = np.concatenate([sums[block].sum(axis=1) / sizes[block].sum(axis=1) for block in blocks])
    tail = (1 - confidence) / 2
    low, high = np.quantile(means, [tail, 1 - tail])
    least, most = (sums / sizes).min(), (sums / sizes).max()
    # As in `interval`: a mean of equal numbers may differ from them in the last bit.
    return float(np.clip(low, least, most)), float(np.clip(high, least, most))
