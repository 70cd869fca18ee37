"""Bootstrap intervals of a mean over observations in homes (Efron & Tibshirani 1993).

A benchmark speaks of homes that it does not hold: observations of one home have its rooms, objects and reverberation in
common, and those that share their pictures (siblings) even more. Intervals therefore resample in two stages (Davison &
Hinkley 1997, section 3.8): as many homes as there are, with replacement, and in each drawn home as many of its clusters
(observations, or groups of siblings) as it has, with replacement. With one home, or one cluster in every home, this is
the ordinary bootstrap of clusters, or of homes.

Intervals of scores are percentiles of the resampled means; those of differences between methods are corrected for bias
and skewness (`difference_interval`: BCa, Efron 1987).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

#: The intervals hold 95 % of the means of this many resamples.
RESAMPLES = 10_000
CONFIDENCE = 0.95
SEED = 0
#: Fewer homes get a note: that the interval is too narrow, or with one home that it is not about other homes.
FEW_HOMES = 6
#: Least number of values with an interval. The means of resamples never leave the range of the values; n independent
#: values all lie on one side of their distribution's median with probability 2 / 2ⁿ, and five do so in more than 5 %.
FEWEST = 6
#: Least number of values of a difference whose interval is corrected (BCa). The correction is estimated from them, and
#: with fewer it does more harm than good (docs/comparing.md, benchmarks/comparison_power.py).
BCA_FEWEST = 20
#: Resampled values at a time, so that memory does not grow with the number of observations.
_BLOCK = 2_000_000


def _blocks(count: int, resamples: int, seed: int) -> Iterator[NDArray[np.intp]]:
    rng = np.random.default_rng(np.random.SeedSequence([seed, count]))
    rows = max(1, _BLOCK // count)
    for start in range(0, resamples, rows):
        yield rng.integers(0, count, (min(rows, resamples - start), count), dtype=np.intp)


@lru_cache(maxsize=16)
def _small(count: int, resamples: int, seed: int) -> NDArray[np.intp]:
    """All resamples of a small group: one draw serves every figure of it, and every pair of methods."""
    return np.concatenate(list(_blocks(count, resamples, seed)))


def _nested_blocks(sizes: Sequence[int], resamples: int, seed: int) -> Iterator[NDArray[np.float64]]:
    """How often each cluster is in a resample, (rows, clusters), of homes with ``sizes`` clusters.

    A home that is drawn k times contributes k · size draws among its clusters.
    """
    homes = len(sizes)
    rng = np.random.default_rng(np.random.SeedSequence([seed, *sizes]))
    rows = max(1, _BLOCK // sum(sizes))
    for start in range(0, resamples, rows):
        drawn = rng.multinomial(homes, np.full(homes, 1 / homes), size=min(rows, resamples - start))
        yield np.concatenate(
            [rng.multinomial(drawn[:, home] * size, np.full(size, 1 / size)) for home, size in enumerate(sizes)], axis=1
        ).astype(np.float64)


@lru_cache(maxsize=16)
def _small_nested(sizes: tuple[int, ...], resamples: int, seed: int) -> NDArray[np.float64]:
    """As `_small`, for clusters in homes."""
    return np.concatenate(list(_nested_blocks(sizes, resamples, seed)))


def interval(
    values: Sequence[float],
    *,
    homes: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    fewest: int = FEWEST,
) -> tuple[float, float] | None:
    """`clustered_interval` of values that are independent within a home, one per observation."""
    return clustered_interval(
        [[value] for value in values],
        homes=homes, resamples=resamples, seed=seed, confidence=confidence, fewest=fewest,
    )  # fmt: skip


def homes_note(homes: Collection[str]) -> str | None:
    """What the number of homes means for intervals, in one line; None where there are enough.

    Args:
        homes: of the observations.
    """
    count = len({*homes})
    if count == 1:
        return "one home: the intervals resample what is in it, and say nothing of other homes"
    return f"{count} homes, fewer than {FEW_HOMES}: the intervals are too narrow" if 1 < count < FEW_HOMES else None


def column_intervals(
    columns: Mapping[str, Sequence[float]], homes: Mapping[str, Sequence[Hashable]]
) -> dict[str, tuple[float, float]]:
    """Figure → the interval of its values (`interval`), without figures that have none.

    Args:
        columns: figure → its values.
        homes: figure → the home of each of them.
    """
    found = {name: interval(values, homes=homes[name]) for name, values in columns.items()}
    return {name: pair for name, pair in found.items() if pair is not None}


def clustered_interval(
    clusters: Sequence[Sequence[float]],
    *,
    homes: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    fewest: int = FEWEST,
) -> tuple[float, float] | None:
    """The interval that holds ``confidence`` of the means of resamples: homes, then clusters of values as a whole.

    The mean of a resample is that of all values in it. Homes and clusters are sorted by their values first: their names
    and their order, and that of the values, change nothing.

    Args:
        clusters: the values of each; empty clusters are left out.
        homes: the home of each cluster; None: all in one, so that clusters alone are resampled.
        resamples: how many.
        seed: of the draws; the same seed and numbers of clusters give the same draws.
        confidence: the share, centred.
        fewest: fewer clusters have no interval; at least 2.

    Returns:
        (low, high); None for fewer than ``fewest`` clusters.
    """
    resampled = _Resampled.of(clusters, homes, max(2, fewest), resamples, seed)
    return None if resampled is None else resampled.between((1 - confidence) / 2, (1 + confidence) / 2)


@dataclass(frozen=True)
class DifferenceInterval:
    """Interval of a mean difference.

    Attributes:
        low: its lower end.
        high: its upper end.
        method: ``BCa``, or ``percentile`` where there are too few values for the correction.
    """

    low: float
    high: float
    method: Literal["BCa", "percentile"]


def difference_interval(
    clusters: Sequence[Sequence[float]],
    *,
    homes: Sequence[Hashable] | None = None,
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    bca_fewest: int = BCA_FEWEST,
) -> DifferenceInterval | None:
    """The interval of a mean of paired differences: homes are resampled, then clusters of differences as a whole.

    From ``bca_fewest`` homes on (clusters, with one home) its ends are the BCa percentiles of the resampled means: with
    z₀ = Φ⁻¹(share of means below the observed one, ties half), a = Σuᵢ³ / (6·(Σuᵢ²)^1.5) and u the distances of the
    means without one home (cluster) from their mean, the end of the normal quantile z is the percentile
    Φ(z₀ + (z₀ + z) / (1 − a·(z₀ + z))) (Efron 1987). Fewer, but at least `FEWEST` clusters: the percentiles themselves,
    as in `clustered_interval`.

    `scipy.stats.bootstrap` finds the same from the same draws, and is much slower (tests/evaluators/test_bootstrap.py).

    Args:
        clusters: the differences of each; empty clusters are left out.
        homes: as for `clustered_interval`.
        resamples: how many.
        seed: of the draws; the same seed and number of clusters give the same draws.
        confidence: the share, centred.
        bca_fewest: fewer homes (with one home: clusters) have an interval of percentiles.

    Returns:
        None for fewer than `FEWEST` clusters.
    """
    resampled = _Resampled.of(clusters, homes, FEWEST, resamples, seed)
    if resampled is None:
        return None
    tails = ((1 - confidence) / 2, (1 + confidence) / 2)
    if len(resampled.units) < bca_fewest:
        return DifferenceInterval(*resampled.between(*tails), "percentile")
    return DifferenceInterval(*resampled.between(*resampled.corrected(tails)), "BCa")


@dataclass(frozen=True)
class _Resampled:
    """Sums and sizes of clusters, and the means of resamples of them.

    Attributes:
        sums: of each cluster.
        sizes: number of values of each cluster.
        units: (units, 2) sum and size of what is drawn first: a home, or a cluster where that is the same.
        means: of the resamples.
    """

    sums: NDArray[np.float64]
    sizes: NDArray[np.float64]
    units: NDArray[np.float64]
    means: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        clusters: Sequence[Sequence[float]],
        homes: Sequence[Hashable] | None,
        fewest: int,
        resamples: int,
        seed: int,
    ) -> _Resampled | None:
        of_home: dict[Hashable, list[list[float]]] = {}
        for cluster, home in zip(clusters, [None] * len(clusters) if homes is None else homes, strict=True):
            if cluster:
                of_home.setdefault(home, []).append(sorted(cluster))
        nested = sorted(sorted(some) for some in of_home.values())
        ordered = [cluster for some in nested for cluster in some]
        if len(ordered) < fewest:
            return None
        sums = np.array([math.fsum(cluster) for cluster in ordered])
        sizes = np.array([len(cluster) for cluster in ordered], dtype=np.float64)
        counts = tuple(map(len, nested))
        table = np.column_stack([sums, sizes])
        if len(counts) == 1 or max(counts) == 1:
            return cls(sums, sizes, table, _cluster_means(sums, sizes, resamples, seed))
        units = np.add.reduceat(table, np.cumsum((0, *counts[:-1])), axis=0)
        small = len(sums) * resamples <= _BLOCK
        blocks = [_small_nested(counts, resamples, seed)] if small else _nested_blocks(counts, resamples, seed)
        means = [(block @ sums) / (block @ sizes) for block in blocks]
        return cls(sums, sizes, units, np.concatenate(means))

    def between(self, lower: float, upper: float) -> tuple[float, float]:
        """Two quantiles of the means."""
        low, high = np.quantile(self.means, [lower, upper])
        least, most = (self.sums / self.sizes).min(), (self.sums / self.sizes).max()
        # As in `interval`: a mean of equal numbers may differ from them in the last bit.
        return float(np.clip(low, least, most)), float(np.clip(high, least, most))

    def corrected(self, shares: tuple[float, float]) -> tuple[float, float]:
        """BCa's shares in place of nominal ones."""
        observed = self.sums.sum() / self.sizes.sum()
        # A resample with the observed mean may differ from it in the last bits.
        margin = 1e-12 * np.abs(self.sums).sum() / self.sizes.sum()
        below, above = (self.means < observed - margin).mean(), (self.means > observed + margin).mean()
        bias = ndtri((1 + below - above) / 2)
        left = self.units.sum(axis=0) - self.units
        jackknife = left[:, 0] / left[:, 1]
        away = jackknife.mean() - jackknife
        spread = (away**2).sum()
        if not np.isfinite(bias) or spread <= margin**2:
            return shares  # all are equal
        skewness = (away**3).sum() / (6 * spread**1.5)
        z = bias + ndtri(np.array(shares))
        lower, upper = ndtr(bias + z / (1 - skewness * z))
        return float(lower), float(upper)


def _cluster_means(
    sums: NDArray[np.float64], sizes: NDArray[np.float64], resamples: int, seed: int
) -> NDArray[np.float64]:
    """(resamples,) means of as many clusters as there are, drawn with replacement."""
    count = len(sums)
    blocks = [_small(count, resamples, seed)] if count * resamples <= _BLOCK else _blocks(count, resamples, seed)
    if (sizes == 1).all():
        return np.asarray(np.concatenate([sums[block].sum(axis=1) for block in blocks]) / count)
    return np.concatenate([sums[block].sum(axis=1) / sizes[block].sum(axis=1) for block in blocks])
