"""Places on a leaderboard: who is separated from whom by a test of paired differences, figure by figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from avs3d_bench.contract.comparisons import FigureComparison, PairedDifference, PartOrOverall
from avs3d_bench.contract.scores import Metric, Scores
from evaluators.statistics.comparison import WARN_BELOW, compare_figure

#: More methods are ordered by their means alone: the correction for so many pairs leaves few p-values below the level,
#: and the tests of all figures would take minutes.
MOST_METHODS = 50
#: Pairs whose differences are shown for every figure; of more, for the ranking figure alone …
PAIRS_OF_EVERY_FIGURE = 10
#: … and of even more, none.
MOST_PAIRS = 200


@dataclass(frozen=True)
class PairRow:
    """Two ranked methods.

    Attributes:
        first: key of one.
        second: key of the other.
        differences: one per column; None where there is nothing to compare.
    """

    first: str
    second: str
    differences: tuple[PairedDifference | None, ...]


@dataclass(frozen=True)
class Standings:
    """The comparison of the ranked methods of one table.

    Attributes:
        figures: name of a figure → its comparison; figures of fewer than two methods are left out.
        tested: whether places come from tests; if not, from the order of means.
        columns: the figures of ``pairs``.
        pairs: every pair, the better means first; none of too many.
        units: fewest observations (or groups of siblings) of a pair under the ranking figure; None without a pair.
    """

    figures: Mapping[str, FigureComparison]
    tested: bool
    columns: tuple[Metric, ...]
    pairs: tuple[PairRow, ...]
    units: int | None

    def place(self, key: str, metric: Metric) -> int | None:
        """The place of a method under a figure; None if it is not tested."""
        found = self.figures.get(metric.name)
        return None if found is None else next((one.place for one in found.methods if one.name == key), None)

    @property
    def few(self) -> bool:
        """Whether there are so few observations that most differences cannot be found."""
        return self.units is not None and self.units < WARN_BELOW


def standings(
    methods: Mapping[str, Scores], metrics: Sequence[Metric], ranking: Metric, part: PartOrOverall
) -> Standings:
    """Compare the ranked methods of a table.

    Args:
        methods: key → scores, of one dataset, truth and protocol version.
        metrics: the figures.
        ranking: the figure that ranks.
        part: or ``overall``.
    """
    if not 2 <= len(methods) <= MOST_METHODS:
        return Standings({}, len(methods) < 2, (), (), None)
    count = len(methods) * (len(methods) - 1) // 2
    shown = metrics if count <= PAIRS_OF_EVERY_FIGURE else (ranking,) if count <= MOST_PAIRS else ()
    figures = {}
    for metric in metrics:
        found = compare_figure(methods, metric, part, intervals=metric in shown)
        if found is not None:
            figures[metric.name] = found
    columns = tuple(metric for metric in shown if metric.name in figures)
    ranked = figures.get(ranking.name)
    pairs = _pairs(ranked, [figures[metric.name] for metric in columns]) if columns and ranked else ()
    return Standings(figures, True, columns, pairs, min((one.units for one in ranked.differences), default=None)
                     if ranked else None)  # fmt: skip


def _pairs(ranked: FigureComparison, columns: Sequence[FigureComparison]) -> tuple[PairRow, ...]:
    """Pairs of the methods that have the ranking figure, the better mean first."""
    order = {method.name: index for index, method in enumerate(ranked.methods)}
    known: list[dict[tuple[str, str], PairedDifference]] = []
    for figure in columns:
        found = {(one.first, one.second): one for one in figure.differences}
        known.append(found | {(b, a): _turned(one) for (a, b), one in found.items()})
    rows = [
        PairRow(a, b, tuple(found.get((a, b)) for found in known)) for a in order for b in order if order[a] < order[b]
    ]
    return tuple(row for row in rows if any(row.differences))


def _turned(one: PairedDifference) -> PairedDifference:
    """The same with the second method first."""
    changes: dict[str, Any] = {"first": one.second, "second": one.first, "mean": -one.mean}
    changes["interval"] = None if one.interval is None else (-one.interval[1], -one.interval[0])
    changes["verdict"] = {"better": "worse", "worse": "better"}.get(one.verdict, one.verdict)
    return one.model_copy(update=changes)
