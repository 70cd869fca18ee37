"""Who may be ranked with whom: from files of scores to the tables of a leaderboard.

Only like is ranked with like: a table holds one dataset (name, version, sha256 of dataset.json), one protocol version,
one part. Runs over a part of a dataset are shown below the ranks. Files whose observations or reference rows differ
were not scored against the same truth, whatever their dataset is called, and get a table of their own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from avs3d_bench.contract.comparisons import PartOrOverall
from avs3d_bench.contract.scores import (
    ALL_REFERENCES,
    BLIND_REFERENCES,
    PROTOCOL_PARTS,
    GroupScores,
    Metric,
    Scores,
    metrics_of,
)
from evaluators.reporting.pages import PART_TITLES, REFERENCE_TITLES, figure
from evaluators.reporting.report import authors_text, headline
from evaluators.reporting.standings import Standings, standings

_PARTS: tuple[PartOrOverall, ...] = ("overall", "part_1", "part_2", "part_3")
#: Order of the protocols on a page; the first that there is is shown first.
_PROTOCOLS = ("listen", "strict", "official")
_DIGEST_LENGTH = 7


@dataclass(frozen=True)
class ScoresEntry:
    """One file of scores.

    Attributes:
        scores: what it holds.
        source: where it came from.
        digest: sha256 of its contents, wherever its report lies.
        name: what its files in the folder are called.
        twin: whether another entry has the same method name.
        report: its report, None where there is none.
        note: why its report is not copied, None where it is, or there is none.
        verified: whether a record of `avs3d verify` that the page's author named confirms all values.
    """

    scores: Scores
    source: Path
    digest: str
    report: Path | None
    name: str = ""
    twin: bool = False
    note: str | None = None
    verified: bool = False

    @property
    def whole(self) -> bool:
        """Whether every observation of the dataset was scored."""
        return self.scores.dataset.scored == self.scores.dataset.observations

    @property
    def truth(self) -> str | None:
        """The ground truth that its masks were made from (an oracle): it is shown, and not ranked."""
        return self.scores.submission.truth

    @property
    def short_digest(self) -> str:
        """Tells entries of one method name apart."""
        return self.digest[:_DIGEST_LENGTH]

    @property
    def authors(self) -> str:
        """In one line."""
        return authors_text(self.scores.submission.authors)


@dataclass(frozen=True, order=True)
class ScoringRule:
    """A protocol, its version, and the voxels of the 3D figures where it has them."""

    protocol: str
    version: str
    voxel_size: float | None

    @property
    def id(self) -> str:
        """For attributes of the page."""
        return f"{self.protocol}-{self.version}" + (f"-{self.voxel_size:g}" if self.voxel_size is not None else "")


@dataclass(frozen=True)
class RankingRow:
    """One row of a table.

    Attributes:
        rank: the place, from 1, shared by methods that no test separates; None for rows that are not ranked:
            references, oracles, parts of a dataset.
        title: the method or reference.
        entry: None for a reference.
        group: the scores in the row.
    """

    rank: int | None
    title: str
    entry: ScoresEntry | None
    group: GroupScores


@dataclass(frozen=True)
class RankingTable:
    """One dataset, one ruler, one part, one truth.

    Attributes:
        rows: best first, reference rows among them.
        partial: rows scored on a part of the dataset, not ranked.
        metrics: the columns.
        ranking: the figure that ranks.
        observations: how many each mean in ``rows`` goes over.
        standings: the tests of the ranked rows; its keys are digests of entries.
        titles: key → method, with a part of the digest where several entries have one name.
    """

    rows: tuple[RankingRow, ...]
    partial: tuple[RankingRow, ...]
    metrics: tuple[Metric, ...]
    ranking: Metric
    observations: int
    standings: Standings
    titles: Mapping[str, str]

    def place(self, row: RankingRow, metric: Metric) -> int | None:
        """Of a ranked row under a figure, if it was tested."""
        return self.standings.place(row.entry.digest, metric) if row.entry and row.rank is not None else None


@dataclass(frozen=True)
class RankingView:
    """The rows of the page for a dataset, one part and one ruler.

    Attributes:
        part: ``overall``, ``part_1``, ``part_2`` or ``part_3``.
        ruler: which.
        tables: one, or several where the truths differ, or none.
        left_out: methods that were scored against the dataset, but not with this ruler.
    """

    part: str
    ruler: ScoringRule
    tables: tuple[RankingTable, ...]
    left_out: tuple[str, ...]

    @property
    def fits(self) -> bool:
        """Whether the protocol scores the part at all."""
        scored = {str(name): parts for name, parts in PROTOCOL_PARTS.items()}
        return self.part == "overall" or self.part in scored.get(self.ruler.protocol, ())


@dataclass(frozen=True)
class DatasetRanking:
    """One dataset.

    Attributes:
        name: the dataset's.
        version: None in the official release.
        sha256: None in the official release.
        observations: how many it has.
        entries: how many files were scored against it.
        views: one per part and ruler.
    """

    name: str
    version: str | None
    sha256: str | None
    observations: int
    entries: int
    views: tuple[RankingView, ...]


def leaderboard_values(entries: Sequence[ScoresEntry]) -> dict[str, Any]:
    """The values for the template."""
    rulers = _ordered({ruler for entry in entries for ruler in rulers_of(entry)})
    parts = [name for name in _PARTS if any(_group(entry, name) is not None for entry in entries)]
    several = Counter((ruler.protocol, ruler.version) for ruler in rulers)
    labels = {
        ruler.id: f"{ruler.protocol} {ruler.version}"
        + (
            f", {ruler.voxel_size:g} m voxels"
            if several[ruler.protocol, ruler.version] > 1 and ruler.voxel_size
            else ""
        )
        for ruler in rulers
    }
    return {
        "sections": _sections(entries, rulers, parts),
        "entries": len(entries),
        "verified": sum(entry.verified for entry in entries),
        "rulers": [(ruler.id, labels[ruler.id]) for ruler in rulers],
        "labels": labels,
        "parts": [(name, PART_TITLES[name]) for name in parts],
        "protocols": tuple(dict.fromkeys(ruler.protocol for ruler in rulers)),
    }


def rulers_of(entry: ScoresEntry) -> tuple[ScoringRule, ...]:
    """The protocols of a file of scores, each with its version and the size of the voxels."""
    said = entry.scores.avs3d_eval
    return tuple(
        ScoringRule(name, version, said.voxel_size if name == "strict" else None)
        for name, version in said.protocols.items()
    )


def _ordered(rulers: Iterable[ScoringRule]) -> list[ScoringRule]:
    """Listen before strict before official, the newest version first."""

    def order(ruler: ScoringRule) -> tuple[Any, ...]:
        numbers = tuple(-int(piece) for piece in re.findall(r"\d+", ruler.version))
        return (_PROTOCOLS.index(ruler.protocol), numbers, ruler.version, ruler.voxel_size or 0.0)

    return sorted(rulers, key=order)


def _group(entry: ScoresEntry, part: str) -> GroupScores | None:
    scores = entry.scores
    return scores.overall if part == "overall" else {str(k): v for k, v in scores.parts.items()}.get(part)


def dataset_identity(entry: ScoresEntry) -> tuple[str, str, str, int]:
    """Values that two entries share if they were scored against the same dataset."""
    data = entry.scores.dataset
    return data.name, data.version or "", data.sha256 or "", data.observations


def _sections(
    entries: Sequence[ScoresEntry], rulers: Sequence[ScoringRule], parts: Sequence[PartOrOverall]
) -> tuple[DatasetRanking, ...]:
    """The datasets, the one with the most entries first."""
    found: dict[tuple[str, str, str, int], list[ScoresEntry]] = {}
    for entry in entries:
        found.setdefault(dataset_identity(entry), []).append(entry)
    sections = []
    for identity in sorted(found, key=lambda key: (-len(found[key]), key)):
        name, version, sha256, observations = identity
        members = found[identity]
        views = tuple(
            RankingView(part, ruler, _tables(members, ruler, part), _left_out(members, ruler))
            for ruler in rulers
            for part in parts
        )
        sections.append(DatasetRanking(name, version or None, sha256 or None, observations, len(members), views))
    return tuple(sections)


def _tables(entries: Iterable[ScoresEntry], ruler: ScoringRule, part: PartOrOverall) -> tuple[RankingTable, ...]:
    """Usually one; the entries without the part or the ruler are left out."""
    members = [entry for entry in entries if ruler in rulers_of(entry) and _scored(_group(entry, part), ruler)]
    truths: dict[Any, list[ScoresEntry]] = {}
    for entry in members:
        if entry.whole:
            truths.setdefault(truth_figures(entry, ruler), []).append(entry)
    partial = [entry for entry in members if not entry.whole]
    if not truths and partial:
        return (_table([], partial, ruler, part),)
    ordered = sorted(truths.values(), key=lambda group: (-len(group), group[0].digest))
    return tuple(_table(group, [] if number else partial, ruler, part) for number, group in enumerate(ordered))


def _scored(group: GroupScores | None, ruler: ScoringRule) -> bool:
    """Whether a group has scores of the ruler's protocol."""
    return getattr(group, ruler.protocol, None) is not None


def _left_out(entries: Iterable[ScoresEntry], ruler: ScoringRule) -> tuple[str, ...]:
    return tuple(entry.scores.submission.method for entry in entries if ruler not in rulers_of(entry))


def truth_figures(entry: ScoresEntry, ruler: ScoringRule) -> tuple[Any, ...]:
    """The figures of the blind reference rows: they depend only on the dataset and the protocol.

    The observations belong to it, because a dataset without a sha256 may share its name with another. The deaf rows do
    not: files of scores of earlier versions have none, and only a dataset with a sha256 has them.
    """
    rows = []
    for name in BLIND_REFERENCES:
        for part, group in sorted(entry.scores.references.get(name, {}).items()):
            for metric in metrics_of(ruler.protocol):
                value = figure(group, metric)
                rows.append((name, part, metric.name, None if value is None else round(value, 6)))
    return (tuple(sorted((row.key, row.frames) for row in entry.scores.observations)), tuple(rows))


def _table(
    entries: Sequence[ScoresEntry], partial: Sequence[ScoresEntry], ruler: ScoringRule, part: PartOrOverall
) -> RankingTable:
    rows: Sequence[RankingRow] = [_row(entry, part) for entry in entries]
    below = [_row(entry, part) for entry in partial]
    beside = references_of(entries)
    references = [
        RankingRow(None, REFERENCE_TITLES[name], None, group)
        for name in ALL_REFERENCES
        if (group := beside.get(name, {}).get(part)) is not None and _scored(group, ruler)
    ]
    everything = metrics_of(ruler.protocol)
    metrics = tuple(
        m for m in everything if any(figure(row.group, m) is not None for row in (*rows, *references, *below))
    )
    # A figure that no row has ranks nothing: part_3 observations without siblings have no pair accuracy.
    ranking = headline(metrics) or headline(everything)
    assert ranking is not None  # every protocol has an IoU
    competing = {row.entry.digest: row.entry.scores for row in rows if row.entry and _competes(row)}
    found = standings(competing, metrics, ranking, part)
    ranked = [*_ranked(rows, found, ranking), *references]
    return RankingTable(
        _best_first(ranked, ranking), _best_first(below, ranking), metrics or (ranking,), ranking,
        observations=max(row.group.observations for row in (ranked or below)), standings=found,
        titles={e.digest: f"{e.scores.submission.method}{f' ({e.short_digest})' if e.twin else ''}" for e in entries},
    )  # fmt: skip


def _ranked(rows: Iterable[RankingRow], found: Standings, ranking: Metric) -> list[RankingRow]:
    """The rows with their places: those of the tests, else by the figure itself."""
    values = [value for row in rows if _competes(row) and (value := figure(row.group, ranking)) is not None]

    def rank(row: RankingRow) -> int | None:
        tested = found.place(row.entry.digest, ranking) if row.entry else None
        return tested or _rank(figure(row.group, ranking), values)

    return [replace(row, rank=rank(row)) if _competes(row) else row for row in rows]


def references_of(entries: Iterable[ScoresEntry]) -> Mapping[str, Mapping[str, GroupScores]]:
    """The reference rows of entries of one truth: the longest list, for earlier versions wrote no deaf rows."""
    return max((entry.scores.references for entry in entries), key=len, default={})


def _row(entry: ScoresEntry, part: str) -> RankingRow:
    group = _group(entry, part)
    assert group is not None  # entries without the part were left out
    return RankingRow(None, entry.scores.submission.method, entry, group)


def _competes(row: RankingRow) -> bool:
    return row.entry is not None and row.entry.truth is None


def _rank(value: float | None, values: Iterable[float]) -> int | None:
    """1 + how many are better; equal values share a rank."""
    return None if value is None else 1 + sum(other > value for other in values)


def _best_first(rows: Iterable[RankingRow], ranking: Metric) -> tuple[RankingRow, ...]:
    def order(row: RankingRow) -> tuple[Any, ...]:
        value = figure(row.group, ranking)
        digest = row.entry.digest if row.entry else ""
        return (value is None, -(value or 0.0), row.entry is None, row.title, digest)

    return tuple(sorted(rows, key=order))
