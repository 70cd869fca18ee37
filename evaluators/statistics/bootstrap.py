"""Bootstrap intervals of a mean over observations (Efron & Tibshirani 1993).

Observations that share their pictures are not independent: `clustered_interval` resamples whole groups of them.
Intervals of scores are percentiles of the resampled means; those of differences between methods are corrected for bias
and skewness (`difference_interval`: BCa, Efron 1987).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
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


def column_intervals(columns: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """Figure → the interval of its values (`interval`), without figures that have none."""
    found = {name: interval(values) for name, values in columns.items()}
    return {name: pair for name, pair in found.items() if pair is not None}


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
    resampled = _Resampled.of(clusters, max(2, fewest), resamples, seed)
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
    resamples: int = RESAMPLES,
    seed: int = SEED,
    confidence: float = CONFIDENCE,
    bca_fewest: int = BCA_FEWEST,
) -> DifferenceInterval | None:
    """The interval of a mean of paired differences, if clusters of them are resampled as a whole.

    From ``bca_fewest`` clusters on its ends are the BCa percentiles of the resampled means: with z₀ = Φ⁻¹(share of
    means below the observed one, ties half) and a = Σuᵢ³ / (6·(Σuᵢ²)^1.5), u the jackknife means' distances from their
    mean, the end of the normal quantile z is the percentile Φ(z₀ + (z₀ + z) / (1 − a·(z₀ + z))) (Efron 1987). Fewer
    clusters, but at least `FEWEST`: the percentiles themselves, as in `clustered_interval`.

    `scipy.stats.bootstrap` finds the same from the same draws, and is much slower (tests/evaluators/test_bootstrap.py).

    Args:
        clusters: the differences of each; empty clusters are left out.
        resamples: how many.
        seed: of the draws; the same seed and number of clusters give the same draws.
        confidence: the share, centred.
        bca_fewest: fewer clusters have an interval of percentiles.

    Returns:
        None for fewer than `FEWEST` clusters.
    """
    resampled = _Resampled.of(clusters, FEWEST, resamples, seed)
    if resampled is None:
        return None
    tails = ((1 - confidence) / 2, (1 + confidence) / 2)
    if len(resampled.sums) < bca_fewest:
        return DifferenceInterval(*resampled.between(*tails), "percentile")
    return DifferenceInterval(*resampled.between(*resampled.corrected(tails)), "BCa")


@dataclass(frozen=True)
class _Resampled:
    """Sums and sizes of clusters, and the means of resamples of them."""

    sums: NDArray[np.float64]
    sizes: NDArray[np.float64]
    means: NDArray[np.float64]

    @classmethod
    def of(cls, clusters: Sequence[Sequence[float]], fewest: int, resamples: int, seed: int) -> _Resampled | None:
        ordered = sorted(sorted(cluster) for cluster in clusters if cluster)
        if len(ordered) < fewest:
            return None
        sums = np.array([math.fsum(cluster) for cluster in ordered])
        sizes = np.array([len(cluster) for cluster in ordered], dtype=np.float64)
        count = len(ordered)
        small = count * resamples <= _BLOCK
        blocks = [_small(count, resamples, seed)] if small else _blocks(count, resamples, seed)
        if (sizes == 1).all():
            means = np.concatenate([sums[block].sum(axis=1) for block in blocks]) / count
        else:
            means = np.concatenate([sums[block].sum(axis=1) / sizes[block].sum(axis=1) for block in blocks])
        return cls(sums, sizes, means)

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
        jackknife = (self.sums.sum() - self.sums) / (self.sizes.sum() - self.sizes)
        away = jackknife.mean() - jackknife
        spread = (away**2).sum()
        if not np.isfinite(bias) or spread <= margin**2:
            return shares  # all clusters are equal
        skewness = (away**3).sum() / (6 * spread**1.5)
        z = bias + ndtri(np.array(shares))
        lower, upper = ndtr(bias + z / (1 - skewness * z))
        return float(lower), float(upper)
