"""The aims of the listener, which were set before the training, beside what was measured (docs/listener.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from statistics import fmean
from typing import Any

from benchmarks.listener_seeds import PARTS, cell
from benchmarks.listener_summary import MISSING, share


@dataclass(frozen=True)
class Aim:
    """A figure of `benchmarks.listener_seeds.figures_of`, or a loss, and what it is to be.

    Attributes:
        title: in the table.
        limit: the figure is to be at least this, a loss or error at most.
        row: dataset and row of the figure.
        group: part, or what `figures_of` has of the class map and of frames without a sound from the room.
        metric: name of the figure.
        usual: dataset and row that a loss is against, of as many observations; the larger loss of both parts counts.
        most: whether the limit is the largest value.
    """

    title: str
    limit: float
    row: str
    group: str = ""
    metric: str = "strict_IoU"
    usual: str | None = None
    most: bool = False

    def values(self, found: Mapping[str, Any]) -> list[float]:
        """The value of each seed; none where a row was not measured."""
        if self.usual is None:
            figure = found.get(self.row, {}).get(self.group, {}).get(self.metric)
            return list(figure["values"]) if figure else []
        if not {self.row, self.usual} <= found.keys():
            return []
        if found[self.row].get("observations") != found[self.usual].get("observations"):
            return []
        pairs = [[found[row][part][self.metric]["values"] for row in (self.usual, self.row)] for part in PARTS]
        losses = [[a - b for a, b in zip(*pair, strict=True)] for pair in pairs]
        return [max(of_seed) for of_seed in zip(*losses, strict=True)]

    def verdict(self, value: float) -> str:
        """``met``, or by how much it is missed."""
        gap = value - self.limit if self.most else self.limit - value
        return "met" if gap <= 0 else f"missed by {share(gap, 2)}"


_OPEN, _SEEN = "open-s34-o7", "open-s34-o7-classes"
AIMS = (
    Aim("strict IoU with recordings, part_1", 0.60, f"{_OPEN}-recorded-2d", "part_1"),
    Aim("… with `spatial`", 0.70, f"{_OPEN}-recorded-spatial", "part_1"),
    *(Aim(f"strict IoU with test voices, {part}", 0.75, f"{_OPEN}-2d", part) for part in PARTS),
    *(Aim(f"… with `spatial`, {part}", 0.82, f"{_OPEN}-spatial", part) for part in PARTS),
    *(Aim(f"models that others made, with `spatial`, {part}", 0.80, f"{_OPEN}-sh3d-spatial", part) for part in PARTS),
    Aim("a real room, part_1", 0.65, "open-scans-2d", "part_1"),
    Aim("a real room, part_2", 0.50, "open-scans-2d", "part_2"),
    Aim("pair accuracy of twins", 0.65, "listen-2d", "part_3", "twins"),
    Aim("… with `spatial`", 0.88, "listen-spatial", "part_3", "twins"),
    Aim("loss with other heads", 0.05, f"{_OPEN}-heads-2d", usual=f"{_OPEN}-2d", most=True),
    Aim("loss with another engine", 0.05, f"{_OPEN}+soundspaces-2d", usual=f"{_OPEN}-2d", most=True),
    Aim(
        "loss with path-traced pictures of all observations",
        0.05,
        f"{_OPEN}-pathtraced-2d",
        usual=f"{_OPEN}-24frames-2d",
        most=True,
    ),
    Aim("class map, IoU of clocks", 0.65, _SEEN, "classes", "clock"),
    Aim("… of telephones", 0.55, _SEEN, "classes", "telephone"),
    Aim("… of vacuum cleaners", 0.70, _SEEN, "classes", "vacuum_cleaner"),
    Aim("calibration error above .1", 0.05, _SEEN, "masks", "calibration_error", most=True),
    Aim("marked in silence", 0.01, "listen-2d", "marked", "silence", most=True),
    Aim("marked with sounds of other rooms alone", 0.05, "listen-2d", "marked", "other_rooms", most=True),
)


def answers(aim: Aim) -> list[Aim]:
    """An aim; where it is one of the network's masks, also that of the listener's other answer, from the walk."""
    if aim.row.endswith("-spatial"):
        return [aim, replace(aim, title="… on masks of direction", row=f"{aim.row}-direction")]
    if not aim.row.endswith("-2d"):
        return [aim]
    row, usual = aim.row.replace("-2d", "-both"), aim.usual and aim.usual.replace("-2d", "-both")
    return [aim, replace(aim, title="… by name and direction", row=row, usual=usual)]


def aim_rows(package: Mapping[str, Any], seeds: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the docs: the aim, the package, the seeds, and whether the package has it.

    Args:
        package, seeds: of `figures_of`.
    """
    rows = []
    for aim in chain.from_iterable(map(answers, AIMS)):
        own, every = aim.values(package), aim.values(seeds)
        said = cell({"values": every, "mean": fmean(every), "interval": None}) if every else MISSING
        limit = f"{aim.title} {'≤' if aim.most else '≥'} {share(aim.limit, 2)}"
        rows.append([limit, share(own[0]) if own else MISSING, said, aim.verdict(own[0]) if own else "not measured"])
    return rows
