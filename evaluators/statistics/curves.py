"""Figures by factor: strict IoU and pair accuracy in bins of distance, direction, reverberation and others.

A bin's figure is computed as that of a whole dataset, from the frames of the bin alone: a mean over observations of
means over frames, for the pair accuracy a mean over groups of shares of pairs. So a single bin with all frames has the
figure of the file of scores. Intervals resample homes, then observations (under ``listen``, groups); docs/factors.md
has the definition with a worked example.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from avs3d_bench.contract.frame_rows import FrameRow
from avs3d_bench.contract.scores import METRICS, Metric
from avs3d_bench.contract.taxonomy import CATEGORIES, ROOMS
from evaluators.metrics.masks import mean
from evaluators.statistics.bootstrap import DifferenceInterval, clustered_interval, difference_interval

#: Figures that are shown by factor, the main one first.
FIGURES: tuple[Metric, ...] = tuple(
    metric
    for wanted in (("strict", "IoU"), ("listen", "pair_accuracy"), ("listen", "IoU"))
    for metric in METRICS
    if (metric.protocol, metric.name) == wanted
)


@dataclass(frozen=True)
class Factor:
    """A column of the table of frames, and its bins.

    Attributes:
        name: of the column.
        title: in pages.
        unit: in pages.
        cuts: where one bin ends and the next begins (which the cut belongs to), in ``unit``; None: each name is a bin.
        scale: from the column's unit to ``unit``.
        absolute: whether the sign is ignored.
        zero: whether 0 has a bin of its own.
    """

    name: str
    title: str
    unit: str = ""
    cuts: tuple[float, ...] | None = None
    scale: float = 1.0
    absolute: bool = False
    zero: bool = False

    def bin_of(self, row: FrameRow) -> str | None:
        """Label of the bin of a frame; None where the factor is not known."""
        value = getattr(row, self.name)
        if value is None or self.cuts is None:
            return None if value is None else str(value)
        number = (abs(value) if self.absolute else value) * self.scale
        if self.zero and number == 0:
            return self.labels[0]
        return self.labels[bisect_right(self.cuts, number) + self.zero]

    def ends(self, label: str) -> tuple[float | None, float | None]:
        """Where a bin begins and ends, in ``unit``; None where it is open, and of names."""
        if self.cuts is None:
            return None, None
        if self.zero and label == self.labels[0]:
            return 0.0, 0.0
        place = self.labels.index(label) - self.zero
        bounds = (None, *self.cuts, None)
        return bounds[place], bounds[place + 1]

    @property
    def labels(self) -> tuple[str, ...]:
        """The bins in order; empty for names."""
        if self.cuts is None:
            return ()
        whole = self.name == "twins"  # a number of objects: each below the last cut is a bin
        between = [f"{low:g}" if whole else f"{_text(low)} to {_text(high)}" for low, high in _pairs(self.cuts)]
        first, last = ("0" if whole else f"< {_text(self.cuts[0])}"), f"≥ {_text(self.cuts[-1])}"
        return (*(("0",) if self.zero else ()), first, *between, last)


def _text(number: float) -> str:
    return f"{number:g}".replace("-", "−")


def _pairs(cuts: Sequence[float]) -> list[tuple[float, float]]:
    return list(pairwise(cuts))


#: Every factor, in the order of pages. The bins are fixed, so that curves of different datasets can be compared.
FACTORS: tuple[Factor, ...] = (
    Factor("visible_share", "visible size", "% of the picture", (0.1, 0.3, 1.0, 3.0, 10.0), 100.0, zero=True),
    Factor("distance_m", "distance", "m", (1.0, 2.0, 3.0, 4.0, 6.0)),
    Factor("azimuth_deg", "|azimuth|", "°", (10.0, 20.0, 30.0, 45.0, 90.0), absolute=True),
    Factor("elevation_deg", "elevation", "°", (-30.0, -20.0, -10.0, 0.0, 10.0)),
    Factor("t30_s", "T30", "s", (0.2, 0.4, 0.6, 0.8, 1.2)),
    Factor("drr_db", "DRR", "dB", (-10.0, -5.0, 0.0, 5.0, 10.0)),
    Factor("snr_db", "SNR", "dB", (-10.0, 0.0, 5.0, 10.0, 20.0)),
    Factor("twins", "silent twins", "", (1.0, 2.0, 3.0)),
    Factor("twin_distance_m", "nearest silent twin", "m", (1.0, 2.0, 3.0, 4.0)),
    Factor("category", "category"),
    Factor("room", "room"),
)


@dataclass(frozen=True)
class FactorPoint:
    """A figure in one bin.

    Attributes:
        value: the figure.
        interval: its 95 % interval; None for fewer than six observations (``listen``: groups).
        observations: values in the mean; for the pair accuracy, groups.
        frames: rows with the figure.
    """

    value: float
    interval: tuple[float, float] | None
    observations: int
    frames: int


@dataclass(frozen=True)
class BinDifference:
    """First method minus second in one bin, over observations (pair accuracy: groups).

    Attributes:
        value: mean of the paired differences.
        interval: its 95 % interval; None for fewer than six observations (``listen``: groups).
    """

    value: float
    interval: DifferenceInterval | None


@dataclass(frozen=True)
class Bin:
    """A bin of a factor.

    Attributes:
        label: e.g. ``1 to 2``, or a name.
        points: of each method; None where it has no frame with the figure in the bin.
        difference: of two methods; None of any other number, and of an empty bin.
    """

    label: str
    points: tuple[FactorPoint | None, ...]
    difference: BinDifference | None = None


@dataclass(frozen=True)
class FactorCurve:
    """A figure against a factor.

    Attributes:
        factor: the factor.
        metric: the figure.
        bins: from the first to the last that has a frame.
        unknown: reason → number of frames with the figure, of the first method, for which the factor is not known.
    """

    factor: Factor
    metric: Metric
    bins: tuple[Bin, ...]
    unknown: Mapping[str, int]


#: Resampled unit (observation or group) → unit of equal weight in the mean (likewise) → its value.
_Values = dict[str, dict[str, float]]


def values_of(rows: Iterable[FrameRow], metric: Metric) -> _Values:
    """The values of some frames: one per observation, for the pair accuracy one per group."""
    pairs: dict[str, list[int]] = {}
    ious: dict[tuple[str, str], list[float]] = {}
    for row in rows:
        unit = row.group or row.key
        if metric.name == "pair_accuracy":
            found = pairs.setdefault(unit, [0, 0])
            found[0] += row.pairs_right or 0
            found[1] += row.pairs or 0
        elif row.IoU is not None:
            ious.setdefault((unit, row.key), []).append(row.IoU)
    if metric.name == "pair_accuracy":
        return {unit: {unit: right / count} for unit, (right, count) in pairs.items() if count}
    values: _Values = {}
    for (unit, key), some in ious.items():
        values.setdefault(unit, {})[key] = mean(some) or 0.0
    return values


def has_figure(row: FrameRow, metric: Metric) -> bool:
    """Whether a frame counts in a figure."""
    if row.protocol != metric.protocol:
        return False
    return bool(row.pairs) if metric.name == "pair_accuracy" else row.IoU is not None


def point(rows: Sequence[FrameRow], metric: Metric, *, intervals: bool = True) -> FactorPoint | None:
    """A figure over some frames that have it; None of none."""
    values = values_of(rows, metric)
    clusters = [list(each.values()) for each in values.values()]
    flat = [value for cluster in clusters for value in cluster]
    value = mean(flat)
    if value is None:
        return None
    homes = _homes(rows)
    found = clustered_interval(clusters, homes=[homes[unit] for unit in values]) if intervals else None
    return FactorPoint(value, found, len(flat), len(rows))


def difference(first: Sequence[FrameRow], second: Sequence[FrameRow], metric: Metric) -> BinDifference | None:
    """First minus second over what both have values for; None of nothing."""
    mine, theirs = values_of(first, metric), values_of(second, metric)
    homes = _homes(first)
    clusters = {
        unit: [value - theirs[unit][key] for key, value in values.items() if key in theirs[unit]]
        for unit, values in mine.items()
        if unit in theirs
    }
    value = mean(each for cluster in clusters.values() for each in cluster)
    found = difference_interval(list(clusters.values()), homes=[homes[unit] for unit in clusters])
    return None if value is None else BinDifference(value, found)


def _homes(rows: Iterable[FrameRow]) -> dict[str, str]:
    """Resampled unit (observation or group) → its home."""
    return {row.group or row.key: row.scan for row in rows}


def curve(tables: Sequence[Sequence[FrameRow]], factor: Factor, metric: Metric) -> FactorCurve:
    """A figure of one or more methods against a factor.

    Args:
        tables: of each method, rows of the same frames.
        factor: the factor.
        metric: one of `FIGURES`.
    """
    binned: list[dict[str, list[FrameRow]]] = []
    unknown: Counter[str] = Counter()
    for number, table in enumerate(tables):
        bins: dict[str, list[FrameRow]] = {}
        for row in table:
            if not has_figure(row, metric):
                continue
            label = factor.bin_of(row)
            if label is not None:
                bins.setdefault(label, []).append(row)
            elif number == 0:
                unknown[row.unavailable.get(factor.name, "not known")] += 1
        binned.append(bins)
    labels = _occurring(factor, {label for bins in binned for label in bins})
    return FactorCurve(
        factor, metric, tuple(_bin(label, binned, metric) for label in labels), dict(sorted(unknown.items()))
    )


def _bin(label: str, binned: Sequence[Mapping[str, Sequence[FrameRow]]], metric: Metric) -> Bin:
    some = [bins.get(label, ()) for bins in binned]
    points = tuple(point(rows, metric) for rows in some)
    return Bin(label, points, difference(some[0], some[1], metric) if len(some) == 2 else None)


def _occurring(factor: Factor, found: set[str]) -> list[str]:
    """The bins from the first to the last that has a frame; names in the order of the taxonomy, others last."""
    if factor.cuts is None:
        known = [name for name in (*CATEGORIES, *ROOMS) if name in found]
        return known + sorted(found - {*known})
    places = [place for place, label in enumerate(factor.labels) if label in found]
    return list(factor.labels[places[0] : places[-1] + 1]) if places else []


def curves(tables: Sequence[Sequence[FrameRow]]) -> tuple[FactorCurve, ...]:
    """Every figure that some frame has against every factor that is known for some frame, figure by figure."""
    found = [
        curve(tables, factor, metric)
        for metric in FIGURES
        if any(has_figure(row, metric) for row in tables[0])
        for factor in FACTORS
    ]
    return tuple(found)
