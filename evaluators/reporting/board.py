"""A leaderboard as one JSON file: every row with the digest of the file of scores that it comes from.

The tables are those of the page (`evaluators.reporting.ranking`): like is ranked with like, and methods that no test of
paired differences separates share a place.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from avs3d_bench.contract.schema import Record, Sha256, Text
from evaluators.reporting.pages import figure
from evaluators.reporting.question_tables import QuestionTable
from evaluators.reporting.ranking import RankingRow, RankingTable, RankingView, ScoresEntry, leaderboard_values


class BoardEntry(Record):
    """A file of scores."""

    digest: Sha256 = Field(description="of its contents, as `avs3d verify` and the page have it")
    file: Text = Field(description="its name")
    method: Text
    dataset: Text
    dataset_version: str | None
    dataset_sha256: Sha256 | None = Field(description="sha256 of dataset.json; null for the official release")
    scored: int
    observations: int = Field(description="of the dataset; fewer are scored in a run over a part of it")
    toolkit_version: Text
    protocols: dict[str, Text] = Field(description="protocol → version")
    truth: str | None = Field(description="the truth that its masks were made from; such a row is not ranked")
    verified: bool


class BoardRow(Record):
    """A row of a table."""

    place: int | None = Field(description="from 1; null for references, oracles and runs over a part of a dataset")
    title: Text
    digest: Sha256 | None = Field(description="of the entry; null for a reference row")
    figures: dict[str, float] = Field(description="name → mean; those without a value are left out")


class BoardTable(Record):
    """One dataset, one protocol, one part, one truth; best first."""

    dataset: Text
    dataset_version: str | None
    dataset_sha256: Sha256 | None
    part: Text
    protocol: Text
    protocol_version: Text
    ranked_by: Text
    observations: int
    tested: bool = Field(description="whether places come from tests; if not, from the order of means")
    rows: tuple[BoardRow, ...]
    partial: tuple[BoardRow, ...] = Field(description="runs over a part of the dataset")


class Board(Record):
    """The file."""

    left_out: ClassVar[frozenset[str]] = frozenset({"questions"})

    avs3d_leaderboard: Literal["1.0"] = "1.0"
    entries: tuple[BoardEntry, ...]
    tables: tuple[BoardTable, ...]
    questions: tuple[QuestionTable, ...] | None = Field(default=None, description="absent if there are none")


def board_of(entries: Sequence[ScoresEntry], questions: Sequence[QuestionTable] = ()) -> Board:
    """The leaderboard of some files of scores; their order makes no difference."""
    ordered = sorted(entries, key=lambda entry: (entry.scores.submission.method, entry.digest))
    tables = [
        _table(section.name, section.version, section.sha256, view, table)
        for section in leaderboard_values(ordered)["sections"]
        for view in section.views
        for table in view.tables
    ]
    return Board(entries=tuple(map(_entry, ordered)), tables=tuple(tables), questions=tuple(questions) or None)


def _entry(entry: ScoresEntry) -> BoardEntry:
    data, said = entry.scores.dataset, entry.scores.avs3d_eval
    return BoardEntry(
        digest=entry.digest, file=entry.source.name, method=entry.scores.submission.method, dataset=data.name,
        dataset_version=data.version, dataset_sha256=data.sha256, scored=data.scored, observations=data.observations,
        toolkit_version=said.version, protocols={str(name): version for name, version in said.protocols.items()},
        truth=entry.truth, verified=entry.verified,
    )  # fmt: skip


def _table(name: str, version: str | None, sha256: str | None, view: RankingView, table: RankingTable) -> BoardTable:
    return BoardTable(
        dataset=name, dataset_version=version, dataset_sha256=sha256, part=view.part, protocol=view.ruler.protocol,
        protocol_version=view.ruler.version, ranked_by=table.ranking.name, observations=table.observations,
        tested=table.standings.tested, rows=_rows(table.rows, table), partial=_rows(table.partial, table),
    )  # fmt: skip


def _rows(rows: Iterable[RankingRow], table: RankingTable) -> tuple[BoardRow, ...]:
    found = []
    for row in rows:
        values = {metric.name: figure(row.group, metric) for metric in table.metrics}
        known = {name: value for name, value in values.items() if value is not None}
        digest = row.entry.digest if row.entry else None
        found.append(BoardRow(place=row.rank, title=row.title, digest=digest, figures=known))
    return tuple(found)
