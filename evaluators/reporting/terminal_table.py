"""The table of scores on a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from avs3d_bench.commands.report import screen
from avs3d_bench.contract.scores import ALL_REFERENCES, METRICS, PAIR_KINDS, GroupScores, Metric, Scores
from evaluators.protocols.strict import unseen_note
from evaluators.reading.archive import printable
from evaluators.statistics.bootstrap import homes_note

if TYPE_CHECKING:
    from rich.console import Console

_PROTOCOLS = {"official": "off.", "strict": "strict", "listen": "listen"}
#: Columns that the table may take.
_WIDEST = 1000
#: Headings as narrow as 80 columns ask for.
_HEADINGS = {
    "boundary_F": "bound.\nF",
    "FP_rate": "FP\nrate",
    "FP_area": "FP\narea",
    "wrong_instance_rate": "wrong\ninst.",
    "IoU_3D": "3D\nIoU",
    "centroid_error": "centr.\nerr. m",
    "pair_accuracy": "pair\nacc.",
    "category": "cate-\ngory",
    "off_screen": "off-\nscr.",
    "silence": "si-\nlence",
    "several": "sev-\neral",
    "class_mIoU": "class\nmIoU",
}

#: Reference row of true masks → which of them it marks.
_DEAF_MASKS = {
    "deaf_category": "every instance of the sounding category",
    "deaf_most_seen": "of these, the one that is seen most",
    "deaf_all": "in part_3 every instance that can sound",
    "deaf_single": "in part_3 the one that is best for all siblings",
}


def _value(group: GroupScores, metric: Metric) -> float | None:
    scores = getattr(group, metric.protocol)
    value: float | None = getattr(scores, metric.name) if scores else None
    return value


def _number(value: float | None) -> str:
    """Four characters: ``.823``, ``1.00``, ``12.3``."""
    if value is None:
        return "–"
    text = f"{value:.3f}"
    return text.removeprefix("0") if text.startswith("0.") else text[:4].rstrip(".")


def _interval(group: GroupScores, metric: Metric) -> str:
    scores = getattr(group, metric.protocol)
    pair = scores.intervals.get(metric.name) if scores else None
    return "" if pair is None else "\n".join(map(_number, pair))


def print_scores(scores: Scores, console: Console | None = None) -> None:
    """Print the means per part, category and room, the reference rows, and the figures that are unavailable.

    The intervals (95 %, bootstrap over homes and observations) are printed below the means of the parts.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    out = console or screen()
    wanted = scores.avs3d_eval.protocols
    columns = [metric for metric in METRICS if metric.protocol in wanted and _known(scores, metric)]
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0)
    table.add_column("", no_wrap=True)
    for position, metric in enumerate(columns):
        first = position == 0 or columns[position - 1].protocol != metric.protocol
        title = _HEADINGS.get(metric.name, metric.title)
        head = f"{_PROTOCOLS[metric.protocol]}\n{title}" if first else title
        table.add_column(Text(head), justify="right", no_wrap=True)

    def add(name: str, group: GroupScores, style: str = "") -> None:
        table.add_row(name, *(_number(_value(group, m)) for m in columns), style=style)

    def add_all(groups: Iterable[tuple[str, GroupScores]]) -> None:
        for name, group in groups:
            add(f"{name} ({group.observations})", group)
        table.add_section()

    for name, group in [*scores.parts.items(), ("overall", scores.overall)]:
        add(f"{name} ({group.observations})", group, "bold")
        spread = [_interval(group, metric) for metric in columns]
        if any(spread):
            table.add_row("  95 % interval", *spread, style="dim")
        for reference in ALL_REFERENCES:
            beside = scores.references.get(reference, {}).get(name)
            if beside is not None:
                add(f"  {reference.replace('_', ' ')}", beside, "dim")
        table.add_section()
    add_all(scores.categories.items())
    add_all(scores.rooms.items())
    said = scores.submission
    version = f" {scores.dataset.version}" if scores.dataset.version else " (official release)"
    out.print(Text(printable(f"{said.method} on {scores.dataset.name}{version}"), style="bold"), soft_wrap=True)
    if said.layout == "official" and said.masks:
        out.print(Text(f"official folder: {said.masks} (--official-folder chooses)"), soft_wrap=True)
    # Whole on a narrow terminal too, which wraps its lines: cut to its width there would be no figure left.
    table.width = out.measure(table, options=out.options.update(max_width=_WIDEST)).maximum
    out.print(table, soft_wrap=True)
    _print_notes(scores, out)
    versions = ", ".join(f"{name} {version}" for name, version in wanted.items())
    out.print(Text(f"protocols {versions}; avs3d-bench {scores.avs3d_eval.version}", style="dim"))


def _print_notes(scores: Scores, out: Console) -> None:
    """Print what the reference rows are, and which figures are missing or leave observations out."""
    from rich.text import Text

    deaf = {name: masks for name, masks in _DEAF_MASKS.items() if name in scores.references}
    if deaf:
        out.print(Text("deaf: true masks, chosen without the sound", style="dim"))
        for name, masks in deaf.items():
            out.print(Text(f"  {name.removeprefix('deaf_').replace('_', ' ')}: {masks}", style="dim"))
        if "deaf_category" in scores.references:
            out.print(Text("in part_1 nothing else could sound, so that they are the truth", style="dim"))
    if scores.overall.listen is not None and any(
        getattr(scores.overall.listen, kind) is not None for kind in PAIR_KINDS
    ):
        names = ", ".join(kind.replace("_", "-") for kind in PAIR_KINDS)
        out.print(Text(f"{names}: pair accuracy by kind of pair", style="dim"))
    if scores.soft is not None:
        means = [*scores.soft.parts.items(), ("overall", scores.soft.overall)]
        text = ", ".join(f"{name} ({one.count}) {_number(one.AP)}" for name, one in means)
        out.print(Text(f"average precision of soft masks: {text}"), soft_wrap=True)
    part = scores.dataset
    if part.scored < part.observations:
        out.print(Text(f"{part.scored} of {part.observations} observations were asked for: no score of the benchmark"))
    unseen = unseen_note(scores)
    if unseen:
        out.print(Text(f"warning: {unseen}"), soft_wrap=True)
    if any(getattr(scores.overall, name).intervals for name in scores.avs3d_eval.protocols):
        note = homes_note([row.scan for row in scores.observations])
        if note:
            out.print(Text(note, style="dim"), soft_wrap=True)
    for metric in METRICS:
        reasons = getattr(getattr(scores.overall, metric.protocol), "unavailable", {})
        if metric.name in reasons:
            out.print(Text(f"{metric.title}: not available ({reasons[metric.name]})", style="dim"))
    for reference, why in scores.references_unavailable.items():
        out.print(Text(f"{reference.replace('_', ' ')}: no such row ({why})", style="dim"))


def _known(scores: Scores, metric: Metric) -> bool:
    """Whether any row has the figure."""
    return any(_value(group, metric) is not None for group in (scores.overall, *scores.parts.values()))
