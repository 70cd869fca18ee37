"""Scores against a parameter of a sweep, from files of scores: one curve per method, with intervals.

Each value of the parameter has the scores of the same observations under another condition
(`evaluators.protocols.conditions`). Figures and intervals of a value are those that the file of scores would have if
only its observations had been scored: means over observations, pair accuracy over groups, pairs of siblings under the
same condition only.

The change from a reference value is the mean of paired differences: of each original under both conditions, or of each
group for pair accuracy. Its interval resamples homes, then originals, in part_3 groups, as `avs3d compare` does.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from csv import DictWriter
from dataclasses import dataclass
from pathlib import Path

from avs3d_bench.contract.layout import parse_key
from avs3d_bench.contract.scores import METRICS, PAIR_FIGURES, GroupScores, Metric, ObservationScores, SiblingScores
from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean
from evaluators.metrics.pairs import group_accuracies
from evaluators.reporting.leaderboard import read_entries
from evaluators.reporting.pages import figure, interval, number, span
from evaluators.reporting.ranking import ScoresEntry, dataset_identity, rulers_of
from evaluators.reporting.series import titles_of
from evaluators.reporting.table_contents import inert
from evaluators.reporting.tables_markdown import plain
from evaluators.statistics.bootstrap import difference_interval
from evaluators.statistics.comparison import figure_of
from evaluators.summary import summarise

Value = float | str | None
#: Field → value of everything that varies beside the parameter; empty if nothing does.
Setting = tuple[tuple[str, Value], ...]

_KIND = "background.kind"
#: Field → its value in an observation that nothing was done to.
_PLAIN: dict[str, Value] = {"acoustics.absorption_scale": 1.0, "background.snr_db": None}
#: Figures that are drawn unless others are asked for: those of them that the files hold.
USUAL = ("listen.pair_accuracy", "listen.IoU", "strict.IoU", "official.mIoU")


@dataclass(frozen=True)
class SweepPoint:
    """The scores of one method at one value of the parameter.

    Attributes:
        value: of the parameter; None: no background.
        group: means and intervals over the observations with this value.
        t30: mean reverberation time of these observations (s); None where it is not known.
        rows: the scores of the observations.
        siblings: the groups, with the pairs under this condition alone.
    """

    value: Value
    group: GroupScores
    t30: float | None
    rows: tuple[ObservationScores, ...]
    siblings: tuple[SiblingScores, ...]

    def units(self, metric: Metric) -> dict[str, tuple[str, float]]:
        """The units by which differences are paired (an original, or a group) → their cluster and value of a figure."""
        if metric.protocol == "listen" and metric.name in PAIR_FIGURES:
            found = group_accuracies(self.siblings, [row.key for row in self.rows], metric.name)
            return {group: (group, value) for group, value in found.items()}
        known = [(row, figure_of(row, metric)) for row in self.rows]
        return {
            row.condition.variant_of: (row.group or row.condition.variant_of, value)
            for row, value in known
            if row.condition is not None and value is not None
        }


@dataclass(frozen=True)
class Change:
    """The change of a figure from the reference value, paired.

    Attributes:
        mean: of the differences.
        interval: its 95 % interval; None for fewer than six originals or groups.
        units: number of pairs.
    """

    mean: float
    interval: tuple[float, float] | None
    units: int


@dataclass(frozen=True)
class SweepCurve:
    """One method under one setting of the other parameters.

    Attributes:
        method: its name, with a suffix if others have the same one.
        setting: values of the other parameters.
        points: in the order of `order_of`.
    """

    method: str
    setting: Setting
    points: tuple[SweepPoint, ...]

    def change(self, point: SweepPoint, metric: Metric, reference: Value) -> Change | None:
        """The change of a figure from the point with the value ``reference`` to another; None where one is missing."""
        first = next((one.units(metric) for one in self.points if one.value == reference), {})
        pairs = [(first[name], unit) for name, unit in point.units(metric).items() if name in first]
        if not pairs or point.value == reference:
            return None
        clusters: dict[str, list[float]] = {}
        for (_, before), (cluster, after) in pairs:
            clusters.setdefault(cluster, []).append(after - before)
        # A cluster is named by the key of an observation, which names the home.
        homes = [parse_key(cluster).scan for cluster in clusters]
        spread = difference_interval(list(clusters.values()), homes=homes)
        mean = math.fsum(value for some in clusters.values() for value in some) / len(pairs)
        return Change(mean, None if spread is None else (spread.low, spread.high), len(pairs))


@dataclass(frozen=True)
class Sweep:
    """Everything that the files and the picture show.

    Attributes:
        field: the parameter, e.g. ``background.snr_db``.
        dataset: name and version.
        metrics: the figures.
        curves: one per method and setting.
        reference: the value from which changes are measured.
    """

    field: str
    dataset: str
    metrics: tuple[Metric, ...]
    curves: tuple[SweepCurve, ...]
    reference: Value


def read_sweep(score_files: Sequence[Path], *, over: str | None = None, figures: Sequence[str] = ()) -> Sweep:
    """The curves of files of scores.

    Args:
        score_files: written by ``avs3d-eval --json``, all on the same dataset.
        over: the parameter; None: the only one that varies.
        figures: names such as ``strict.IoU``; none: those of `USUAL` that the files hold.

    Raises:
        UsageError: if the files are of different datasets or without variants, or a name is unknown.
        Avs3dError: if a file is broken.
    """
    entries = read_entries(score_files, reports=False)
    first = entries[0]
    for entry in entries:
        if dataset_identity(entry) != dataset_identity(first) or _keys(entry) != _keys(first):
            raise UsageError(f"{first.source}, {entry.source}: scores on different datasets or observations; give one")
        if sorted(rulers_of(entry)) != sorted(rulers_of(first)):
            raise UsageError(f"{first.source}, {entry.source}: scores under different protocols; score both again")
    field, others = _parameter(first, over)
    data = first.scores.dataset
    titles = titles_of(entries)
    curves = [curve for entry in entries for curve in _curves(entry, titles[entry.digest], field, others)]
    curves.sort(key=lambda curve: (curve.method, [order_of(value) for _, value in curve.setting]))
    metrics = _metrics(curves, figures)
    values = sorted({point.value for curve in curves for point in curve.points}, key=order_of)
    plain_value = _PLAIN.get(field, values[0])
    reference = plain_value if plain_value in values else values[0]
    return Sweep(field, " ".join(filter(None, (data.name, data.version))), metrics, tuple(curves), reference)


def order_of(value: Value) -> tuple[bool, float, str]:
    """Sorts values: no background first, then numbers, then words."""
    return (value is not None, value if isinstance(value, float) else 0.0, value if isinstance(value, str) else "")


def values_of(sweep: Sweep) -> list[Value]:
    """All values of the parameter, sorted; those of the background from none to loud noise."""
    values = sorted({point.value for curve in sweep.curves for point in curve.points}, key=order_of)
    if sweep.field == "background.snr_db":
        values = [value for value in values if value is None] + [value for value in values[::-1] if value is not None]
    return values


def value_text(value: Value) -> str:
    """A value as the option ``--over`` of avs3d sweep writes it."""
    return "none" if value is None else value if isinstance(value, str) else f"{value:g}"


def _keys(entry: ScoresEntry) -> list[str]:
    return sorted(row.key for row in entry.scores.observations)


def _values(entry: ScoresEntry) -> dict[str, list[Value]]:
    """Field → its values among the observations, sorted."""
    found: dict[str, set[Value]] = {}
    for row in entry.scores.observations:
        for name, value in (row.condition.values if row.condition else {}).items():
            found.setdefault(name, set()).add(value)
    return {name: sorted(found[name], key=order_of) for name in sorted(found)}


def _parameter(entry: ScoresEntry, over: str | None) -> tuple[str, tuple[str, ...]]:
    """The parameter, and the others that vary.

    Raises:
        UsageError: if there is none, or several and none is named.
    """
    values = _values(entry)
    varying = [name for name, some in values.items() if len(some) > 1]
    if _KIND in varying and len([one for one in values[_KIND] if one is not None]) < 2:
        varying.remove(_KIND)
    if not varying:
        raise UsageError(
            f"{entry.source}: no observations that are variants of one another; expected scores on a dataset made "
            "from a manifest of avs3d sweep"
        )
    if over is not None and over not in varying:
        hint = did_you_mean(over, varying)
        raise UsageError(f"--over {over}: does not vary in {entry.source}; expected {' or '.join(varying)}{hint}")
    if over is None and len(varying) > 1:
        raise UsageError(f"{entry.source}: {' and '.join(varying)} vary; name one with --over")
    field = over or varying[0]
    return field, tuple(name for name in varying if name != field)


def _curves(entry: ScoresEntry, title: str, field: str, others: Sequence[str]) -> Iterable[SweepCurve]:
    rows = [row for row in entry.scores.observations if row.condition]
    settings = {_setting(row, others) for row in rows}
    # Without a background there is no kind of it: such observations belong to the curves of all kinds.
    whole = {one for one in settings if (_KIND, None) not in one} or settings
    for setting in sorted(whole, key=lambda one: [order_of(value) for _, value in one]):
        mine = [row for row in rows if _setting(row, others) in (setting, _without_background(setting))]
        found: dict[Value, list[ObservationScores]] = {}
        for row in mine:
            found.setdefault(_value(row, field), []).append(row)
        points = [_point(value, found[value], entry.scores.siblings or ()) for value in sorted(found, key=order_of)]
        yield SweepCurve(title, setting, tuple(points))


def _setting(row: ObservationScores, names: Sequence[str]) -> Setting:
    return tuple((name, _value(row, name)) for name in names)


def _without_background(setting: Setting) -> Setting:
    return tuple((name, None if name == _KIND else value) for name, value in setting)


def _value(row: ObservationScores, name: str) -> Value:
    values = row.condition.values.items() if row.condition else ()
    return next((value for field, value in values if field == name), None)


def _point(value: Value, rows: Sequence[ObservationScores], siblings: Sequence[SiblingScores]) -> SweepPoint:
    keys = {row.key for row in rows}
    under = [
        one.model_copy(update={"pairs": tuple(p for p in one.pairs if {p.first, p.second} <= keys)}) for one in siblings
    ]
    times = [row.condition.t30 for row in rows if row.condition and row.condition.t30 is not None]
    t30 = sum(times) / len(times) if times else None
    return SweepPoint(value, summarise(rows, under), t30, tuple(rows), tuple(under))


def _metrics(curves: Sequence[SweepCurve], names: Sequence[str]) -> tuple[Metric, ...]:
    known = {f"{metric.protocol}.{metric.name}": metric for metric in METRICS}
    for name in names:
        if name not in known:
            raise UsageError(f"--figure {name}: expected one of {', '.join(known)}{did_you_mean(name, known)}")
    held = [
        metric
        for name, metric in known.items()
        if name in (names or USUAL)
        and any(figure(point.group, metric) is not None for curve in curves for point in curve.points)
    ]
    if not held:
        raise Avs3dError(f"the files of scores hold none of {', '.join(names or USUAL)}; choose others with --figure")
    return tuple(held)


def count_of(group: GroupScores, metric: Metric) -> int:
    """Number of observations (of pair_accuracy: groups) in a figure."""
    scores = getattr(group, metric.protocol)
    return int(getattr(scores, "counts", {}).get(metric.name, group.observations))


def csv_text(sweep: Sweep) -> str:
    """One line per method, setting, value and figure."""
    others = [name for name, _ in sweep.curves[0].setting]
    names = ["method", *others, sweep.field, "t30", "figure", "n", "mean", "low", "high"]
    names += ["change", "change_low", "change_high"]
    stream = io.StringIO()
    writer = DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    for curve in sweep.curves:
        for point in curve.points:
            for metric in sweep.metrics:
                spread, change = interval(point.group, metric), curve.change(point, metric, sweep.reference)
                ends = change and change.interval
                writer.writerow(
                    {name: value_text(value) for name, value in curve.setting}
                    | {
                        "method": inert(curve.method), sweep.field: value_text(point.value), "t30": point.t30,
                        "figure": f"{metric.protocol}.{metric.name}", "n": count_of(point.group, metric),
                        "mean": figure(point.group, metric), "low": spread and spread[0], "high": spread and spread[1],
                        "change": change and change.mean, "change_low": ends and ends[0],
                        "change_high": ends and ends[1],
                    }
                )  # fmt: skip
    return stream.getvalue()


def markdown_text(sweep: Sweep, picture: bool) -> str:
    """A table per figure and setting: a row per method, a column per value."""
    blocks = [f"# {sweep.field}: {plain(sweep.dataset)}"]
    if picture:
        blocks.append("![Scores against the parameter](curve.png)")
    blocks.append(
        "Mean over observations (pair accuracy: over groups) and its 95 % interval; n is their number. Changes are "
        f"means of paired differences from {sweep.field} {value_text(sweep.reference)}."
    )
    for setting in dict.fromkeys(curve.setting for curve in sweep.curves):
        curves = [curve for curve in sweep.curves if curve.setting == setting]
        if setting:
            blocks.append("## " + ", ".join(f"{name} {value_text(value)}" for name, value in setting))
        points = {point.value: point for curve in reversed(curves) for point in curve.points}
        values = [value for value in values_of(sweep) if value in points]
        head = [sweep.field, *map(value_text, values)]
        times = ["T30 (s)", *("–" if (t30 := points[value].t30) is None else f"{t30:.2f}" for value in values)]
        rows = [head, ["---"] * len(head), times]
        for metric in sweep.metrics:
            counts = [str(count_of(points[value].group, metric)) for value in values]
            rows.append([f"n, {metric.protocol} {metric.title}", *counts])
            for curve in curves:
                at = {point.value: point for point in curve.points}
                groups = [at[value].group if value in at else None for value in values]
                cells = [f"{number(figure(group, metric))} {_brackets(group, metric)}".strip() for group in groups]
                rows.append([f"{metric.title}, {plain(curve.method)}", *cells])
                found = [curve.change(at[v], metric, sweep.reference) if v in at else None for v in values]
                rows.append([f"its change, {plain(curve.method)}", *map(_change_text, found)])
        blocks.append("\n".join(f"| {' | '.join(row)} |" for row in rows))
    return "\n\n".join(blocks) + "\n"


def _change_text(change: Change | None) -> str:
    if change is None:
        return "–"
    if change.mean == 0 and change.interval in (None, (0.0, 0.0)):
        return "0"
    ends = f" ({change.interval[0]:+.3f} to {change.interval[1]:+.3f})" if change.interval else ""
    return f"{change.mean:+.3f}{ends}"


def _brackets(group: GroupScores | None, metric: Metric) -> str:
    text = span(interval(group, metric))
    return f"({text})" if text else ""
