"""Contents of the paper's tables: sections of comparable scores, rows of methods and references, and their CSV."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from csv import DictWriter
from dataclasses import dataclass
from typing import Any

from avs3d_bench.commands.report import printable
from avs3d_bench.contract.schema import Scalar
from avs3d_bench.contract.scores import ALL_REFERENCES, METRICS, PAIR_FIGURES, GroupScores, Metric, Scores
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.text.printable import no_formula
from evaluators.reporting import paper
from evaluators.reporting.pages import REFERENCE_TITLES, figure, interval
from evaluators.reporting.ranking import ScoresEntry, ScoringRule, references_of
from evaluators.reporting.series import SETTINGS, THRESHOLD, comparable, series_of, titles_of

#: The figures in both tables.
COLUMNS: tuple[Metric, ...] = tuple(
    metric
    for metric in METRICS
    if (metric.protocol, metric.name)
    in {
        ("official", "mIoU"), ("official", "F"), ("strict", "IoU"), ("strict", "F"), ("strict", "wrong_instance_rate"),
        *(("listen", name) for name in (*PAIR_FIGURES, "IoU", "FP_rate", "class_mIoU")),
    }
)  # fmt: skip


@dataclass(frozen=True)
class PaperRow:
    """One row of a table.

    Attributes:
        title: the method or reference, with a suffix if others have the same name.
        entry: None for a reference.
        part: ``part_1``, ``part_2``, ``part_3`` or ``overall``.
        group: the scores in the row.
        match: the paper's row, or why there is none; None for a reference.
        paper: figure of the protocol ``official`` → the paper's.
        threshold: in Table 3.
    """

    title: str
    entry: ScoresEntry | None
    part: str
    group: GroupScores
    match: paper.Match | None
    paper: Mapping[str, float]
    threshold: float | None = None


@dataclass(frozen=True)
class PaperSection:
    """Rows that can be compared.

    Attributes:
        number: from 1.
        rulers: protocols and versions.
        rows: of the table: per part the methods, best first, and the references; at least one of a method.
        swept: how many runs of a series only Table 3 shows.
    """

    number: int
    rulers: tuple[ScoringRule, ...]
    rows: tuple[PaperRow, ...]
    swept: int = 0

    @property
    def scores(self) -> Scores:
        """Any of its files: they agree in dataset, observations and references."""
        return self._entry.scores

    @property
    def heading(self) -> str:
        """Dataset, version and how much of it, e.g. ``open-s34-o7 1.0.0, 8 of 34 observations``."""
        return _heading(self._entry)

    @property
    def columns(self) -> tuple[Metric, ...]:
        """The figures that any row has."""
        return tuple(m for m in COLUMNS if any(figure(row.group, m) is not None for row in self.rows))

    @property
    def _entry(self) -> ScoresEntry:
        return next(row.entry for row in self.rows if row.entry)


@dataclass(frozen=True)
class PaperTable:
    """A table of the paper with our figures.

    Attributes:
        name: ``table2`` or ``table3``.
        sections: what compares with what; never empty.
        elsewhere: headings of what only the other table shows.
    """

    name: str
    sections: tuple[PaperSection, ...]
    elsewhere: tuple[str, ...] = ()

    def picture(self, section: PaperSection) -> str:
        """Name of a section's picture, without its suffix."""
        return self.name if section.number == 1 else f"{self.name}-{section.number}"


def table_2(entries: Iterable[ScoresEntry]) -> PaperTable:
    """Methods × parts, reference rows last.

    A group of files that has nothing but series is left to Table 3, unless there is no other.
    """
    groups = [(rulers, members, series_of(members)) for rulers, members in comparable(entries)]
    only_series = [sum(map(len, several)) == len(members) for _, members, several in groups]
    sections: list[PaperSection] = []
    elsewhere: list[str] = []
    for (rulers, members, several), swept_whole in zip(groups, only_series, strict=True):
        if swept_whole and not all(only_series):
            elsewhere.append(_heading(members[0]))
            continue
        swept = {
            entry.digest
            for series in several
            if paper.VOTING_THRESHOLD in series
            for threshold, entry in series.items()
            if threshold != paper.VOTING_THRESHOLD
        }
        shown = tuple(entry for entry in members if entry.digest not in swept)
        titles = titles_of(shown)
        rows: list[PaperRow] = []
        for part in PARTS:
            for entry in shown:
                group = _part(entry.scores.parts, part)
                if group is not None:
                    match = paper.match(entry.scores.submission)
                    figures = paper.TABLE_2[match.row].get(part, {}) if match.row else {}
                    rows.append(PaperRow(titles[entry.digest], entry, part, group, match, figures))
            rows += _references(shown, part)
        sections.append(PaperSection(len(sections) + 1, rulers, tuple(rows), len(swept)))
    return PaperTable("table2", tuple(sections), tuple(elsewhere))


def table_3(entries: Iterable[ScoresEntry]) -> PaperTable | None:
    """Series of voting thresholds, the highest first; None where there is no series."""
    sections: list[PaperSection] = []
    for rulers, members in comparable(entries):
        several = series_of(members)
        if not several:
            continue
        titles = titles_of([next(iter(series.values())) for series in several], SETTINGS)
        rows: list[PaperRow] = []
        for series in several:
            title = titles[next(iter(series.values())).digest]
            for threshold, entry in series.items():
                match = paper.match_sweep(entry.scores.submission)
                figures = paper.TABLE_3.get(threshold, {}) if match.row else {}
                rows.append(PaperRow(title, entry, "overall", entry.scores.overall, match, figures, threshold))
        rows += _references(members, "overall")
        sections.append(PaperSection(len(sections) + 1, rulers, tuple(rows)))
    return PaperTable("table3", tuple(sections)) if sections else None


def _heading(entry: ScoresEntry) -> str:
    """Dataset, version and how much of it, e.g. ``open-s34-o7 1.0.0, 8 of 34 observations``."""
    data = entry.scores.dataset
    count = f"{data.scored} observation{'' if data.scored == 1 else 's'}"
    part = count if entry.whole else f"{data.scored} of {data.observations} observations"
    return f"{data.name} {data.version or '(official release)'}, {part}"


def _part(groups: Mapping[Any, GroupScores], part: str) -> GroupScores | None:
    return groups.get(part)


def _references(entries: Iterable[ScoresEntry], part: str) -> list[PaperRow]:
    """The reference rows; the same for every entry of a section, because one truth gives one figure."""
    references = references_of(entries)
    beside = {name: references.get(name, {}).get(part) for name in ALL_REFERENCES}
    return [PaperRow(REFERENCE_TITLES[name], None, part, group, None, {}) for name, group in beside.items() if group]


def records(table: PaperTable) -> list[dict[str, Scalar]]:
    """A table as in its CSV: one record per row and part, full precision, intervals as ``_low``, ``_high``."""
    scenes = any(ruler.protocol == "listen" for section in table.sections for ruler in section.rulers)
    columns = [metric for metric in COLUMNS if metric.protocol != "listen" or scenes]
    found = [_record(section, row, table, columns) for section in table.sections for row in section.rows]
    return [{name: inert(value) for name, value in record.items()} for record in found]


def inert(value: Scalar) -> Scalar:
    """Text of one line that is no formula."""
    return no_formula(printable(value)) if isinstance(value, str) else value


def csv(table: PaperTable) -> str:
    """The text of the CSV file; `pandas.read_csv` gives `records` back."""
    lines = records(table)
    stream = io.StringIO()
    writer = DictWriter(stream, list(lines[0]) if lines else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return stream.getvalue()


def _record(section: PaperSection, row: PaperRow, table: PaperTable, columns: Iterable[Metric]) -> dict[str, Scalar]:
    data = section.scores.dataset
    out: dict[str, Scalar] = {
        "section": section.number,
        "dataset": data.name,
        "dataset_version": data.version,
        "dataset_sha256": data.sha256,
        "dataset_observations": data.observations,
        "protocols": ", ".join(f"{ruler.protocol} {ruler.version}" for ruler in section.rulers),
        "part": row.part,
        "observations": row.group.observations,
        "kind": "method" if row.entry else "reference",
        "method": row.title,
        "digest": row.entry.short_digest if row.entry else None,
    }
    if table.name == "table3":
        out[THRESHOLD] = row.threshold
    for metric in columns:
        low, high = interval(row.group, metric) or (None, None)
        name = f"{metric.protocol}_{metric.name}"
        out |= {name: figure(row.group, metric), f"{name}_low": low, f"{name}_high": high}
        if metric.protocol == "official":
            out[f"paper_{metric.name}"] = row.paper.get(metric.name)
    found = row.match
    return out | {
        "paper_row": found.row if found else None,
        "paper_differs": "; ".join(found.differs) or None if found else None,
    }
