"""Paired comparison of methods: differences over common observations, with intervals, p-values and shared places.

The values of one figure are paired by observation (pair accuracies: by group of siblings). Under ``listen`` whole
groups are resampled and change sign, as siblings share their pictures; intervals resample homes first.
docs/comparing.md has formulas and examples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from avs3d_bench.contract.comparisons import ComparedMethod, FigureComparison, PairedDifference, PartOrOverall, Verdict
from avs3d_bench.contract.scores import METRICS, PAIR_FIGURES, Metric, ObservationScores, Scores
from avs3d_bench.errors import UsageError
from evaluators.metrics.pairs import group_accuracies
from evaluators.statistics.bootstrap import difference_interval
from evaluators.statistics.sign_flips import LEVEL, flips_for, holm, places, sign_flip_p_values

#: Fewer observations, or groups of siblings, get a warning.
WARN_BELOW = 10
#: IoU below which the sounding object counts as missed.
MISSED = 0.1
#: Figures that are compared only on request.
EXTRA_METRICS = (
    Metric("strict", "wrong_observation", "wrong observation", False, "",
           "share of observations in which a twin is marked in some frame and the sounding object is missed"),
)  # fmt: skip
#: ``strict.IoU`` → the figure, for everything that can be compared.
FIGURES: dict[str, Metric] = {f"{metric.protocol}.{metric.name}": metric for metric in (*METRICS, *EXTRA_METRICS)}
#: Differences that are smaller are rounding errors (in units of the figure).
_NOTHING = 1e-12


def metric_of(figure: str) -> Metric:
    """The figure of that name.

    Raises:
        UsageError: if there is none.
    """
    if figure not in FIGURES:
        raise UsageError(f"figure {figure!r}: expected one of {', '.join(sorted(FIGURES))}")
    return FIGURES[figure]


def figure_of(observation: ObservationScores, metric: Metric) -> float | None:
    """A figure of an observation; None if it is not available."""
    scores = getattr(observation, metric.protocol)
    if metric not in EXTRA_METRICS:
        value: float | None = getattr(scores, metric.name, None)
        return value
    rate, iou = (getattr(scores, name, None) for name in ("wrong_instance_rate", "IoU"))
    return None if rate is None or iou is None else float(rate > 0 and iou < MISSED)


@dataclass(frozen=True)
class Values:
    """One figure of one method.

    Attributes:
        of: what has a value (key of an observation; keys of all scored siblings, for the pair accuracy) → value.
        units: the same → what is resampled and changes sign as a whole.
        homes: unit → the home that it lies in.
    """

    of: Mapping[str, float]
    units: Mapping[str, str]
    homes: Mapping[str, str]

    @property
    def mean(self) -> float:
        """Over all values, of which there is at least one."""
        return math.fsum(self.of.values()) / len(self.of)


def values_of(scores: Scores, metric: Metric, part: str) -> Values:
    """The values of the observations of a part, or ``overall``, that have the figure."""
    chosen = [one for one in scores.observations if part in ("overall", one.part)]
    if metric.protocol == "listen" and metric.name in PAIR_FIGURES:
        names = {one.group: " ".join(sorted(one.observations)) for one in scores.siblings or ()}
        accuracies = group_accuracies(scores.siblings or (), [one.key for one in chosen], metric.name)
        found = {names[group]: value for group, value in accuracies.items()}
        homes = {names[one.group]: one.scan for one in chosen if one.group is not None and one.group in accuracies}
        return Values(found, {name: name for name in found}, homes)
    known = [(one, value) for one in chosen if (value := figure_of(one, metric)) is not None]
    units = {one.key: (one.group or one.key) if metric.protocol == "listen" else one.key for one, _ in known}
    return Values({one.key: value for one, value in known}, units, {units[one.key]: one.scan for one, _ in known})


@dataclass(frozen=True)
class Pair:
    """Two methods whose common values are compared, first minus second.

    Attributes:
        first: name of one.
        second: name of the other.
        clusters: differences by unit: observations, or groups of siblings.
        homes: of each unit.
    """

    first: str
    second: str
    clusters: tuple[tuple[float, ...], ...]
    homes: tuple[str, ...]

    @classmethod
    def of(cls, first: tuple[str, Values], second: tuple[str, Values]) -> Pair:
        """The differences over what both have."""
        (name, mine), (other, theirs) = first, second
        clusters: dict[str, list[float]] = {}
        for key in sorted(mine.of.keys() & theirs.of.keys()):
            away = mine.of[key] - theirs.of[key]
            clusters.setdefault(mine.units[key], []).append(0.0 if abs(away) < _NOTHING else away)
        homes = tuple(mine.homes[unit] for unit in clusters)
        return cls(name, other, tuple(tuple(cluster) for cluster in clusters.values()), homes)

    @property
    def sums(self) -> list[float]:
        """One per unit."""
        return [math.fsum(cluster) for cluster in self.clusters]

    @property
    def count(self) -> int:
        """Number of differences."""
        return sum(map(len, self.clusters))


def compare_figure(
    methods: Mapping[str, Scores],
    metric: Metric,
    part: PartOrOverall,
    *,
    pairs: Iterable[tuple[str, str]] | None = None,
    intervals: bool = True,
) -> FigureComparison | None:
    """Compare methods by one figure in one part.

    Args:
        methods: name → scores; of one dataset, truth and protocol version, which is not checked here.
        metric: the figure.
        part: or ``overall``.
        pairs: those to compare, which are all that Holm's correction counts; None: all.
        intervals: compute them; p-values and places do not need them.

    Returns:
        None if fewer than two methods have the figure.
    """
    values = {name: found for name, scores in methods.items() if (found := values_of(scores, metric, part)).of}
    if len(values) < 2:
        return None
    chosen = itertools.combinations(values, 2) if pairs is None else pairs
    paired = [Pair.of((a, values[a]), (b, values[b])) for a, b in chosen if a in values and b in values]
    paired = [pair for pair in paired if pair.clusters]
    p_values = _p_values(paired)
    differences = [
        _difference(pair, p, corrected, metric, intervals)
        for pair, p, corrected in zip(paired, p_values, holm(p_values), strict=True)
    ]
    return FigureComparison(
        part=part, protocol=metric.protocol, figure=metric.name, higher_is_better=metric.higher_is_better,
        methods=_methods(values, differences, metric), differences=tuple(differences),
    )  # fmt: skip


def _p_values(pairs: Sequence[Pair]) -> list[float]:
    """One per pair; pairs of as many units are tested with the same signs."""
    found = [1.0] * len(pairs)
    sizes: dict[int, list[int]] = {}
    for index, pair in enumerate(pairs):
        sizes.setdefault(len(pair.clusters), []).append(index)
    for indices in sizes.values():
        columns = np.array([pairs[index].sums for index in indices]).T
        for index, p in zip(indices, sign_flip_p_values(columns, flips=flips_for(len(pairs))), strict=True):
            found[index] = float(p)
    return found


def _difference(pair: Pair, p: float, corrected: float, metric: Metric, intervals: bool) -> PairedDifference:
    interval = difference_interval(pair.clusters, homes=pair.homes) if intervals else None
    mean = math.fsum(pair.sums) / pair.count
    return PairedDifference(
        first=pair.first, second=pair.second, units=len(pair.clusters), observations=pair.count, mean=mean,
        interval=None if interval is None else (interval.low, interval.high),
        interval_method=None if interval is None else interval.method,
        p=p, p_holm=corrected, verdict=_verdict(pair, mean, corrected, metric),
    )  # fmt: skip


def _verdict(pair: Pair, mean: float, corrected: float, metric: Metric) -> Verdict:
    if not any(any(cluster) for cluster in pair.clusters):
        return "equal"
    if corrected >= LEVEL:
        return "undecided"
    return "better" if (mean > 0) == metric.higher_is_better else "worse"


def _methods(
    values: Mapping[str, Values], differences: Iterable[PairedDifference], metric: Metric
) -> tuple[ComparedMethod, ...]:
    """The best first, with their places."""
    better = {(one.first, one.second) for one in differences if one.verdict == "better"}
    better |= {(one.second, one.first) for one in differences if one.verdict == "worse"}
    sign = -1 if metric.higher_is_better else 1
    ordered = sorted(values, key=lambda name: (sign * values[name].mean, name))
    found = places(ordered, lambda first, second: (first, second) in better)
    return tuple(
        ComparedMethod(name=name, mean=values[name].mean, observations=len(values[name].of), place=found[name])
        for name in ordered
    )
