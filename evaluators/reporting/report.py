"""The HTML report of an evaluation: one file that needs no network, made to be read.

From top to bottom: what was scored, a card per part, bars with their intervals beside the reference rows, all figures,
every observation in a table that sorts, the worst and the best frames in pictures, what each protocol means, and what
it takes to get the same numbers again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avs3d_bench.contract.frame_rows import FrameRow
from avs3d_bench.contract.scores import (
    ALL_REFERENCES,
    BLIND_REFERENCES,
    DEAF_ORACLES,
    DEAF_REFERENCES,
    METRICS,
    PAIR_FIGURES,
    GroupScores,
    Metric,
    ObservationScores,
    Scores,
)
from avs3d_bench.contract.taxonomy import CATEGORIES, PARTS, ROOMS
from avs3d_bench.dataset import Dataset
from avs3d_bench.text.templates import words
from evaluators.protocols.strict import unseen_note
from evaluators.reading.records import Evaluation, FrameScore, Submission
from evaluators.reporting.factors import factor_page
from evaluators.reporting.pages import PART_NOTES, PART_TITLES, REFERENCE_TITLES, figure, interval, write_page
from evaluators.reporting.pictures import Triple, draw_triple
from evaluators.reporting.siblings import draw_siblings
from evaluators.statistics.bootstrap import homes_note
from evaluators.statistics.frame_rows import frame_rows

#: Groups of siblings that a report shows, those with the most wrong pairs first.
SHOWN_GROUPS = 6


@dataclass(frozen=True)
class Bar:
    """One row of a chart; positions are in percent of its scale.

    Attributes:
        label: the name of the figure.
        note: a word more about it.
        kind: ``own`` (the submission on a part), ``reference`` (below it), ``group`` (the submission on a group).
        value: the figure; None where there is none.
        pair: its 95 % interval.
        width: of the bar.
        low: left end of the whisker; None without an interval.
        high: right end.
    """

    label: str
    note: str
    kind: str
    value: float | None
    pair: tuple[float, float] | None
    width: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class BarChart:
    """Bars of one figure.

    Attributes:
        metric: which.
        blocks: title of a block → its bars.
        ticks: position in percent → label.
        floor: position of the best reference over all observations; None where lower is better.
        floor_name: which reference that is.
    """

    metric: Metric
    blocks: tuple[tuple[str, tuple[Bar, ...]], ...]
    ticks: tuple[tuple[float, str], ...]
    floor: float | None
    floor_name: str


@dataclass(frozen=True)
class PartCard:
    """A part at a glance.

    Attributes:
        title: its name.
        note: what it holds.
        group: its scores.
        metric: the figure printed large.
        beside: the other main figures.
        best: name and value of the best reference that neither looks nor listens.
        deaf: name and value of the best one that has true masks but does not listen, where several objects could sound.
    """

    title: str
    note: str
    group: GroupScores
    metric: Metric
    beside: tuple[Metric, ...]
    best: tuple[str, float] | None
    deaf: tuple[str, float] | None = None


def write_report(path: Path, evaluation: Evaluation, dataset: Dataset, submission: Submission) -> None:
    """Write the report of an evaluation to ``path``, atomically; the same input gives the same bytes.

    Args:
        path: the HTML file.
        evaluation: what `evaluators.score.score` returned.
        dataset: the truth, for the pictures.
        submission: the submission, still open, for the pictures.

    Raises:
        Avs3dError: if a frame of the pictures cannot be read, or the report cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from avs3d_bench import Dataset
        >>> from evaluators.score import score
        >>> dataset = Dataset("data/demo")
        >>> with open_submission("data/demo-submissions/centre-box") as submission:
        ...     write_report(Path("report.html"), score(submission, dataset), dataset, submission)
        >>> "strict IoU" in Path("report.html").read_text("utf-8")
        True
    """
    scores = evaluation.scores
    frames = {
        "worst": _triples(evaluation.worst, dataset, submission),
        "best": _triples(evaluation.best, dataset, submission),
    }
    twins = any(triple.twins for triples in frames.values() for triple in triples)
    groups = [draw_siblings(shown, dataset, submission) for shown in evaluation.groups[:SHOWN_GROUPS]]
    rows = frame_rows(evaluation, dataset) if evaluation.frames else ()
    values = report_values(scores, rows) | {"frames": frames, "has_twins": twins, "groups": groups}
    write_page(Path(path), "report.html.j2", values)


def _triples(frames: Iterable[FrameScore], dataset: Dataset, submission: Submission) -> tuple[Triple, ...]:
    return tuple(draw_triple(frame, dataset, submission) for frame in frames)


def report_values(scores: Scores, rows: Sequence[FrameRow] = ()) -> dict[str, Any]:
    """The values of the scores, and of the rows of their frames, for the template."""
    known = tuple(metric for metric in METRICS if _known(scores, metric))
    return {
        "scores": scores,
        "partial": scores.dataset.scored < scores.dataset.observations,
        "unseen": unseen_note(scores),
        "few_homes": homes_note([row.scan for row in scores.observations]),
        "frame_count": scores.overall.frames,
        "metrics": known,
        "spans": [(name, sum(metric.protocol == name for metric in known)) for name in scores.avs3d_eval.protocols],
        "cards": cards(scores, in_order(known)),
        "charts": tuple(chart(scores, metric) for metric in in_order(known)),
        "chart_options": [(f"{m.protocol}-{m.name}", f"{m.protocol} {m.title}") for m in in_order(known)],
        "table": figure_rows(scores),
        "observations": scores.observations,
        "has_category": any(observation.category for observation in scores.observations),
        "has_visible": any(observation.strict or observation.listen for observation in scores.observations),
        "protocols": tuple(scores.avs3d_eval.protocols),
        "unavailable": unavailable(scores),
        "all_metrics": METRICS,
        "groups": (),
        **factor_page([rows]),
        "runtime": runtime_text(scores.submission.runtime),
        "authors": authors_text(scores.submission.authors),
    }


def _known(scores: Scores, metric: Metric) -> bool:
    groups = (scores.overall, *scores.parts.values())
    return any(figure(group, metric) is not None for group in groups) or any(
        observation_figure(observation, metric) is not None for observation in scores.observations
    )


def observation_figure(observation: ObservationScores, metric: Metric) -> float | None:
    """A figure of an observation; None where it is not known."""
    value: float | None = getattr(getattr(observation, metric.protocol), metric.name, None)
    return value


def headline(known: Iterable[Metric]) -> Metric | None:
    """The main figure: the pair accuracy over twins where there are some, else over all, strict IoU, released mIoU."""
    by_name = {(metric.protocol, metric.name): metric for metric in known}
    listen = [("listen", name) for name in ("twins", "pair_accuracy", "IoU")]
    order = (*listen, ("strict", "IoU"), ("official", "mIoU"))
    return next((by_name[each] for each in order if each in by_name), None)


def in_order(known: tuple[Metric, ...]) -> tuple[Metric, ...]:
    """The figures, those of the main figure's protocol first."""
    first = headline(known)
    return tuple(sorted(known, key=lambda metric: first is None or metric.protocol != first.protocol))


def cards(scores: Scores, known: tuple[Metric, ...]) -> tuple[PartCard, ...]:
    """Overall and each part at a glance; the main figure of a part is one of a protocol that scores it."""
    chosen = {*(("listen", name) for name in PAIR_FIGURES), ("listen", "IoU"), ("listen", "FP_rate"),
              ("listen", "class_mIoU"),
              ("strict", "F"), ("strict", "boundary_F"), ("strict", "FP_rate"), ("strict", "wrong_instance_rate"),
              ("strict", "IoU_3D"), ("official", "mIoU"), ("official", "F")}  # fmt: skip
    found = []
    for name, group in _parts(scores).items():
        scored = [m for m in known if getattr(group, m.protocol) is not None]
        metric = headline(scored)
        if metric is None:
            continue
        deaf = {"part_2": DEAF_REFERENCES, "part_3": DEAF_ORACLES}.get(name)
        found.append(
            PartCard(
                PART_TITLES[name],
                PART_NOTES[name],
                group,
                metric,
                tuple(m for m in scored if (m.protocol, m.name) in chosen and m is not metric),
                best_reference(scores, name, metric),
                best_reference(scores, name, metric, deaf) if deaf else None,
            )
        )
    return tuple(found)


def _parts(scores: Scores) -> dict[str, GroupScores]:
    """Overall first; a dataset of one part has one group."""
    found: dict[str, GroupScores] = {str(name): group for name, group in scores.parts.items()}
    parts = {name: found[name] for name in PARTS if name in found}
    return parts if len(parts) == 1 else {"overall": scores.overall, **parts}


def best_reference(
    scores: Scores, part: str, metric: Metric, among: Iterable[str] = BLIND_REFERENCES
) -> tuple[str, float] | None:
    """Name and value of the reference that does best on a part; None where none is known or lower is better."""
    if not metric.higher_is_better:
        return None
    values = [(figure(scores.references.get(name, {}).get(part), metric), name) for name in among]
    found = [(value, name) for value, name in values if value is not None]
    if not found:
        return None
    value, name = max(found, key=lambda pair: pair[0])
    return REFERENCE_TITLES[name], value


def chart(scores: Scores, metric: Metric) -> BarChart:
    """The bars of one figure: parts with their references, then categories and rooms."""
    groups = [*_parts(scores).values(), *scores.categories.values(), *scores.rooms.values()]
    references = [scores.references.get(name, {}).get(part) for name in ALL_REFERENCES for part in _parts(scores)]
    top = scale_end(metric, [figure(group, metric) for group in (*groups, *references)],
                    [interval(group, metric) for group in groups])  # fmt: skip

    def bar(label: str, note: str, kind: str, group: GroupScores | None) -> Bar:
        value, pair = figure(group, metric), interval(group, metric)
        low, high = (100 * pair[0] / top, 100 * pair[1] / top) if pair else (None, None)
        return Bar(label, note, kind, value, pair, 100 * (value or 0.0) / top, low, high)

    blocks: list[tuple[str, tuple[Bar, ...]]] = []
    for name, group in _parts(scores).items():
        rows = [bar("submission", "", "own", group)]
        for reference in ALL_REFERENCES:
            beside = scores.references.get(reference, {}).get(name)
            if figure(beside, metric) is not None:
                rows.append(bar(REFERENCE_TITLES[reference], "reference", "reference", beside))
        blocks.append((PART_TITLES[name], tuple(rows)))
    for title, names, found in (("Categories", CATEGORIES, scores.categories), ("Rooms", ROOMS, scores.rooms)):
        rows = [bar(words(n), _count(found[n].observations), "group", found[n]) for n in _order(names, found)]
        if rows:
            blocks.append((title, tuple(rows)))
    whole = next(iter(_parts(scores)))
    best = best_reference(scores, whole, metric)
    ticks = tuple((25.0 * step, f"{top * step / 4:g}") for step in range(5))
    return BarChart(metric, tuple(blocks), ticks, 100 * best[1] / top if best else None, best[0] if best else "")


def _count(observations: int) -> str:
    return f"{observations} obs."


def _order(names: Iterable[str], found: Mapping[str, Any]) -> list[str]:
    """In the order of the taxonomy; unknown names come last."""
    known = [name for name in names if name in found]
    return known + sorted(name for name in found if name not in known)


def scale_end(metric: Metric, values: Iterable[float | None], intervals: Iterable[tuple[float, float] | None]) -> float:
    """Where a chart's scale ends: 1 for shares, else a round number that all fit below."""
    if not metric.unit:
        return 1.0
    largest = max([value for value in values if value is not None] + [p[1] for p in intervals if p] + [1e-3])
    step = 10.0 ** math.floor(math.log10(largest))
    return next(step * factor for factor in (1, 2, 4, 8, 10) if step * factor >= largest * (1 - 1e-9))


def figure_rows(scores: Scores) -> tuple[tuple[str, str, str, GroupScores], ...]:
    """Rows of the table of all figures: (kind, name, note, group)."""
    rows: list[tuple[str, str, str, GroupScores]] = []
    for name, group in _parts(scores).items():
        rows.append(("part", PART_TITLES[name], PART_NOTES[name], group))
        for reference in ALL_REFERENCES:
            beside = scores.references.get(reference, {}).get(name)
            if beside is not None:
                rows.append(("reference", REFERENCE_TITLES[reference], "reference", beside))
    for names, found, kind in ((CATEGORIES, scores.categories, "category"), (ROOMS, scores.rooms, "room")):
        rows += [(kind, words(name), "", found[name]) for name in _order(names, found)]
    return tuple(rows)


def unavailable(scores: Scores) -> tuple[tuple[Metric, str], ...]:
    """Figures that are null over all observations, and why."""
    reasons = {name: getattr(scores.overall, name).unavailable for name in ("strict", "listen")
               if getattr(scores.overall, name) is not None}  # fmt: skip
    return tuple(
        (metric, reasons[metric.protocol].get(metric.name) or "not known")
        for metric in METRICS
        if metric.protocol in reasons and figure(scores.overall, metric) is None
    )


def authors_text(authors: str | tuple[str, ...] | None) -> str:
    """Authors in one line."""
    return authors or "" if authors is None or isinstance(authors, str) else ", ".join(authors)


def runtime_text(runtime: object) -> str:
    """The `runtime` of submission.json, in one line."""
    if runtime is None:
        return ""
    if isinstance(runtime, Mapping):
        return ", ".join(f"{name}: {runtime_text(value)}" for name, value in runtime.items())
    return f"{runtime:g}" if isinstance(runtime, float) else str(runtime)
