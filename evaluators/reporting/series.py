"""Which files of scores share a table, their names in it, and which of them form a series of thresholds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from avs3d_bench.contract.scores import metrics_of
from avs3d_bench.errors import Avs3dError
from evaluators.reading.archive import printable
from evaluators.reporting import paper
from evaluators.reporting.pages import figure
from evaluators.reporting.ranking import ScoresEntry, ScoringRule, dataset_identity, rulers_of, truth_figures
from evaluators.reporting.report import headline

#: Settings in ``runtime`` of submission.json that a series shares, with the method's name.
SETTINGS = ("method", "variant", "aisrm", "masks", "iterations", "seed")
THRESHOLD = "voting_threshold"
#: Decimals within which two thresholds are one.
_DECIMALS = 6

#: Voting threshold → entry, the highest threshold first; two or more.
Series = dict[float, ScoresEntry]


def comparable(entries: Iterable[ScoresEntry]) -> tuple[tuple[tuple[ScoringRule, ...], tuple[ScoresEntry, ...]], ...]:
    """Groups of scores on the same data, the same observations and with the same protocols.

    Returns:
        (protocols, entries) of every group, the one with the most observations and files first; in it the best first.
    """
    found: dict[Any, list[ScoresEntry]] = {}
    for entry in entries:
        rulers = tuple(sorted(rulers_of(entry)))
        found.setdefault(
            (dataset_identity(entry), rulers, tuple(truth_figures(entry, ruler) for ruler in rulers)), []
        ).append(entry)
    ordered = sorted(
        found.items(),
        key=lambda item: (-item[1][0].scores.dataset.scored, -len(item[1]), item[0][:2], item[1][0].digest),
    )
    return tuple((key[1], _best_first(members)) for key, members in ordered)


def _best_first(entries: Iterable[ScoresEntry]) -> tuple[ScoresEntry, ...]:
    """By the figure that ranks in the leaderboard, over all observations."""

    def order(entry: ScoresEntry) -> tuple[Any, ...]:
        known = (m for name in entry.scores.avs3d_eval.protocols for m in metrics_of(name))
        metric = headline(m for m in known if figure(entry.scores.overall, m) is not None)
        value = figure(entry.scores.overall, metric) if metric else None
        return value is None, -(value or 0.0), entry.scores.submission.method, entry.digest

    return tuple(sorted(entries, key=order))


def titles_of(entries: Sequence[ScoresEntry], keys: Sequence[str] = (*SETTINGS, THRESHOLD)) -> dict[str, str]:
    """Digest → method; of one name several, with those settings in which they differ, else with the digest."""
    titles = {}
    for entry in entries:
        name = entry.scores.submission.method
        namesakes = [e for e in entries if e.scores.submission.method == name]
        said = paper.settings(entry.scores.submission)
        differing = [k for k in keys if len({repr(paper.settings(e.scores.submission).get(k)) for e in namesakes}) > 1]
        apart = ", ".join(f"{key.replace('_', ' ')} {said.get(key, 'not said')}" for key in differing)
        titles[entry.digest] = printable(f"{name} ({apart})" if apart else name)
    counts = Counter(titles.values())
    short = {entry.digest: entry.short_digest for entry in entries}
    return {d: title if counts[title] == 1 else f"{title} [{short[d]}]" for d, title in titles.items()}


def series_of(entries: Iterable[ScoresEntry]) -> list[Series]:
    """The series among comparable entries, in their order.

    Raises:
        Avs3dError: if a threshold is none, or a series has one of them twice.
    """
    found: dict[tuple[str, ...], list[tuple[float, ScoresEntry]]] = {}
    for entry in entries:
        threshold = _threshold(entry)
        if threshold is not None:
            said = paper.settings(entry.scores.submission)
            # As text: True and 1 are equal, and are not the same setting.
            key = (entry.scores.submission.method, *(repr(said.get(name)) for name in SETTINGS))
            found.setdefault(key, []).append((threshold, entry))
    several = []
    for members in found.values():
        series = dict(sorted(members, key=lambda member: -member[0]))
        if len(series) < 2:
            continue
        if len(series) < len(members):
            twice = next(t for t, count in Counter(t for t, _ in members).items() if count > 1)
            one, other = sorted(str(entry.source) for t, entry in members if t == twice)[:2]
            raise Avs3dError(
                f"{one}, {other}: both have voting threshold {twice:g} and the same method and settings; give one, or "
                "name their methods differently"
            )
        several.append(series)
    return several


def _threshold(entry: ScoresEntry) -> float | None:
    value = paper.settings(entry.scores.submission).get(THRESHOLD)
    if value is None:
        return None
    if isinstance(value, bool | str) or not 0.0 <= value <= 1.0:
        raise Avs3dError(
            f"{entry.source}: submission.runtime.{THRESHOLD}: found {value!r}, expected a number from 0 to 1; correct "
            "submission.json and score it again"
        )
    return round(float(value), _DECIMALS)
