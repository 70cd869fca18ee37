"""Settings of a competition's scoring program: which observations it scores and which figures it reports.

`avs3d export codabench` writes this record beside the scoring program, and `evaluators.competition` reads it there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

from pydantic import Field

from avs3d_bench.contract.schema import Record, Text
from avs3d_bench.contract.scores import PROTOCOLS, Metric, Protocol, ProtocolVersion, metrics_of

#: The record's name beside the scoring program.
TASK_JSON = "competition.json"
#: The dataset's two trees below the platform's folder of reference data.
REFERENCE_PUBLIC, REFERENCE_PRIVATE = "public", "private"
#: The figure that ranks submissions under each protocol; its interval is shown, those of other figures are hidden.
MAIN_FIGURES: dict[Protocol, str] = {"strict": "IoU", "listen": "twins", "official": "mIoU"}
#: Those of observations of part_3 without a pair of twins.
MAIN_WITHOUT_TWINS: dict[Protocol, str] = MAIN_FIGURES | {"listen": "pair_accuracy"}

#: Decimals of all figures that participants see. With more of them, scores of submissions that differ in a few pixels
#: would tell the truth of these pixels.
DECIMALS = 3

Bound = Literal["mean", "low", "high"]


class Column(Record):
    """A column of the leaderboard: a mean over observations, or a bound of its 95 % interval."""

    key: Text
    title: Text
    protocol: Protocol
    figure: Text = Field(description="name of the figure in the file of scores")
    bound: Bound
    higher_is_better: bool
    hidden: bool


class CompetitionTask(Record):
    """One task of a competition."""

    format: Literal[1] = 1
    title: Text
    toolkit_version: Text = Field(description="version that wrote the bundle")
    protocols: dict[Protocol, ProtocolVersion] = Field(description="protocol → version that the evaluator must have")
    observations: tuple[Text, ...] = Field(min_length=1, description="keys of the observations that are scored")
    columns: tuple[Column, ...] = Field(min_length=1, description="the first one ranks")


def task_protocols(parts: Collection[str]) -> dict[Protocol, ProtocolVersion]:
    """The protocols that fit observations of some parts, the ranking one first.

    Examples:
        >>> list(task_protocols({"part_1"}))
        ['strict', 'official']
        >>> list(task_protocols({"part_3"}))
        ['listen']
    """
    names: list[Protocol] = []
    if {"part_1", "part_2"} & set(parts):
        names += ["strict", "official"]
    if "part_3" in parts:
        names.insert(0, "listen")
    return {name: PROTOCOLS[name] for name in names}


def columns_of(protocols: Collection[Protocol], main: Mapping[Protocol, str] = MAIN_FIGURES) -> tuple[Column, ...]:
    """The leaderboard's columns: the ranking figure and its interval, then the others, hidden bounds last.

    Ties of the first column are broken by the columns to its right; hidden ones would break them too, so that they
    come after all figures.

    Args:
        protocols: the ranking one first.
        main: protocol → the figure that ranks.
    """
    shown: list[Column] = []
    bounds: list[Column] = []
    for number, protocol in enumerate(protocols):
        figures = sorted(metrics_of(protocol), key=lambda metric: metric.name != main[protocol])
        for metric in figures:
            is_main = metric.name == main[protocol]
            mean, *interval = (_column(metric, bound, hidden=not is_main) for bound in ("mean", "low", "high"))
            shown.append(mean)
            (shown if is_main and number == 0 else bounds).extend(interval)
    return (*shown, *sorted(bounds, key=lambda column: column.hidden))


def _column(metric: Metric, bound: Bound, *, hidden: bool) -> Column:
    key = f"{metric.protocol}_{metric.name}"
    title = f"{metric.protocol} {metric.title}" + (f" ({metric.unit})" if metric.unit else "")
    return Column(
        key=key if bound == "mean" else f"{key}_{bound}",
        title=title if bound == "mean" else f"{title}, 95 % {bound}",
        protocol=metric.protocol,
        figure=metric.name,
        bound=bound,
        higher_is_better=metric.higher_is_better,
        hidden=bound != "mean" and hidden,
    )
