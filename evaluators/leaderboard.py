"""A static page that ranks files of scores, and says where they must not be ranked.

    index.html                     the page
    reports/NAME.html, NAME.json   the report and the scores of each entry

The folder can be served, or opened from disk, as it is; its own score files can be ranked again. Only like is ranked
with like: a table holds one dataset (name, version, sha256 of dataset.json), one protocol version, one part. Runs over
a part of a dataset are shown below the ranks, and files whose reference rows differ were not scored against the same
truth and get a table of their own. The order of the files makes no difference.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.files import dump_json, read_bytes, read_record, write_bytes
from avs3d_bench.scores import REFERENCES, GroupScores, Metric, Scores, metrics_of
from evaluators.pages import PART_TITLES, REFERENCE_TITLES, figure, write_page
from evaluators.report import authors_text, headline

_PARTS = ("overall", "part_1", "part_2")
_SLUG_LENGTH, _DIGEST_LENGTH = 60, 7


@dataclass(frozen=True)
class Entry:
    """One file of scores.

    Attributes:
        scores: what it holds.
        source: where it came from.
        digest: sha256 of its contents, wherever its report lies.
        name: what its files in the folder are called.
        twin: whether another entry has the same method name.
        report: its report, None where there is none.
    """

    scores: Scores
    source: Path
    digest: str
    report: Path | None
    name: str = ""
    twin: bool = False

    @property
    def whole(self) -> bool:
        """Whether every observation of the dataset was scored."""
        return self.scores.dataset.scored == self.scores.dataset.observations

    @property
    def short_digest(self) -> str:
        """Tells entries of one method name apart."""
        return self.digest[:_DIGEST_LENGTH]

    @property
    def authors(self) -> str:
        """In one line."""
        return authors_text(self.scores.submission.authors)


@dataclass(frozen=True, order=True)
class Ruler:
    """What figures are measured with: a protocol, its version, and the voxels of the 3D figures where it has them."""

    protocol: str
    version: str
    voxel_size: float | None

    @property
    def id(self) -> str:
        """For attributes of the page."""
        return f"{self.protocol}-{self.version}" + (f"-{self.voxel_size:g}" if self.voxel_size is not None else "")


@dataclass(frozen=True)
class Row:
    """One row of a table.

    Attributes:
        rank: from 1; None of what is not ranked.
        title: the method or reference.
        entry: None for a reference.
        group: the scores in the row.
    """

    rank: int | None
    title: str
    entry: Entry | None
    group: GroupScores


@dataclass(frozen=True)
class Table:
    """One dataset, one ruler, one part, one truth.

    Attributes:
        rows: best first, reference rows among them.
        partial: what was scored over a part of the dataset, not ranked.
        metrics: the columns.
        ranking: the figure that ranks.
        observations: how many each mean in ``rows`` goes over.
    """

    rows: tuple[Row, ...]
    partial: tuple[Row, ...]
    metrics: tuple[Metric, ...]
    ranking: Metric
    observations: int


@dataclass(frozen=True)
class View:
    """What the page shows of a dataset for one choice of part and ruler.

    Attributes:
        part: ``overall``, ``part_1`` or ``part_2``.
        ruler: which.
        tables: one, or several where the truths differ, or none.
        left_out: methods that were scored against the dataset, but not with this ruler.
    """

    part: str
    ruler: Ruler
    tables: tuple[Table, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Section:
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
    views: tuple[View, ...]


def write_leaderboard(folder: Path, score_files: Sequence[Path]) -> None:
    """Write the page, and copies of the score files and their reports, into a folder.

    Args:
        folder: made if missing; files of other names in it stay.
        score_files: written by ``avs3d-eval --json``; a file given twice counts once.

    Raises:
        UsageError: if there is no score file, or one would be overwritten by another's copy.
        Avs3dError: if a file is no file of scores (the file and the field are named), or nothing can be written.
    """
    folder = Path(folder)
    entries = read_entries(score_files)
    _refuse_overwriting(folder, entries)
    for entry in entries:
        report = None
        if entry.report is not None:
            report = f"{entry.name}.html"
            _write(folder / "reports" / report, read_bytes(entry.report))
        scores = entry.scores.model_copy(update={"report": report})
        _write(folder / "reports" / f"{entry.name}.json", dump_json(scores).encode())
    write_page(folder / "index.html", "leaderboard.html.j2", leaderboard_values(entries))


def _write(path: Path, data: bytes) -> None:
    if not (path.is_file() and path.read_bytes() == data):
        write_bytes(path, data)


def read_entries(score_files: Sequence[Path]) -> tuple[Entry, ...]:
    """The entries of a board, each with its name, sorted by method.

    Raises:
        UsageError: if there is none.
        Avs3dError: if a file is broken.
    """
    if not score_files:
        raise UsageError("no file of scores: expected at least one file written by avs3d-eval --json")
    found: dict[str, Entry] = {}
    for path in sorted(map(Path, score_files)):
        entry = _read_entry(path)
        known = found.get(entry.digest)
        if known is None or (known.report is None and entry.report is not None):
            found[entry.digest] = entry
    entries = sorted(found.values(), key=lambda entry: (entry.scores.submission.method, entry.digest))
    methods = Counter(entry.scores.submission.method for entry in entries)
    slugs = Counter(_slug(entry.scores.submission.method) for entry in entries)
    named = []
    for entry in entries:
        method = entry.scores.submission.method
        slug = _slug(method)
        name = slug if slugs[slug] == 1 else f"{slug}--{entry.short_digest}"
        named.append(Entry(entry.scores, entry.source, entry.digest, entry.report, name, methods[method] > 1))
    return tuple(named)


def _read_entry(path: Path) -> Entry:
    scores = read_record(path, Scores)
    if len(scores.observations) != scores.dataset.scored:
        raise Avs3dError(
            f"{path}: observations: {len(scores.observations)} in the list, but dataset.scored is "
            f"{scores.dataset.scored}; score the submission anew"
        )
    if not scores.avs3d_eval.protocols:
        raise Avs3dError(f"{path}: avs3d_eval.protocols: empty, expected official or strict; score the submission anew")
    for protocol in scores.avs3d_eval.protocols:
        if getattr(scores.overall, protocol) is None:
            raise Avs3dError(
                f"{path}: overall.{protocol}: null, though avs3d_eval.protocols lists it; score the submission anew"
            )
    # Without the report's place and the order of keys, so that a copy in a leaderboard counts as the same entry.
    contents = json.dumps(scores.model_dump(mode="json", exclude={"report"}), sort_keys=True)
    digest = hashlib.sha256(contents.encode()).hexdigest()
    return Entry(scores, path, digest, _report(path, scores))


def _report(path: Path, scores: Scores) -> Path | None:
    """The report that lies beside the file of scores; None where it is gone, or a link leads elsewhere."""
    if scores.report is None:
        return None
    report = (path.parent / scores.report).resolve()
    return report if report.is_file() and report.is_relative_to(path.parent.resolve()) else None


def _slug(method: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", method.lower())[:_SLUG_LENGTH].strip("-") or "method"


def _refuse_overwriting(folder: Path, entries: Iterable[Entry]) -> None:
    """A copy must not take the place of another entry's file."""
    owners: dict[Path, str] = {}
    for entry in entries:
        owners[entry.source.resolve()] = entry.digest
        if entry.report is not None:
            owners[entry.report] = entry.digest
    targets = [(folder / "index.html", "")]
    targets += [(folder / "reports" / f"{e.name}{suffix}", e.digest) for e in entries for suffix in (".json", ".html")]
    for target, digest in targets:
        if owners.get(target.resolve(), digest) != digest:
            raise UsageError(
                f"{target}: the leaderboard would overwrite this score file or report; choose another folder"
            )


def leaderboard_values(entries: Sequence[Entry]) -> dict[str, Any]:
    """What the template needs."""
    rulers = _ordered({ruler for entry in entries for ruler in _rulers(entry)})
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
        "rulers": [(ruler.id, labels[ruler.id]) for ruler in rulers],
        "labels": labels,
        "parts": [(name, PART_TITLES[name]) for name in parts],
    }


def _rulers(entry: Entry) -> tuple[Ruler, ...]:
    said = entry.scores.avs3d_eval
    return tuple(
        Ruler(name, version, said.voxel_size if name == "strict" else None) for name, version in said.protocols.items()
    )


def _ordered(rulers: Iterable[Ruler]) -> list[Ruler]:
    """Strict before official, the newest version first."""

    def order(ruler: Ruler) -> tuple[Any, ...]:
        numbers = tuple(-int(piece) for piece in re.findall(r"\d+", ruler.version))
        return (ruler.protocol != "strict", numbers, ruler.version, ruler.voxel_size or 0.0)

    return sorted(rulers, key=order)


def _group(entry: Entry, part: str) -> GroupScores | None:
    scores = entry.scores
    return scores.overall if part == "overall" else {str(k): v for k, v in scores.parts.items()}.get(part)


def _identity(entry: Entry) -> tuple[str, str, str, int]:
    """What two entries must share to have been scored against the same dataset."""
    data = entry.scores.dataset
    return data.name, data.version or "", data.sha256 or "", data.observations


def _sections(entries: Sequence[Entry], rulers: Sequence[Ruler], parts: Sequence[str]) -> tuple[Section, ...]:
    """The datasets, the one with the most entries first."""
    found: dict[tuple[str, str, str, int], list[Entry]] = {}
    for entry in entries:
        found.setdefault(_identity(entry), []).append(entry)
    sections = []
    for identity in sorted(found, key=lambda key: (-len(found[key]), key)):
        name, version, sha256, observations = identity
        members = found[identity]
        views = tuple(
            View(part, ruler, _tables(members, ruler, part), _left_out(members, ruler))
            for ruler in rulers
            for part in parts
        )
        sections.append(Section(name, version or None, sha256 or None, observations, len(members), views))
    return tuple(sections)


def _tables(entries: Iterable[Entry], ruler: Ruler, part: str) -> tuple[Table, ...]:
    """Usually one; the entries without the part or the ruler are left out."""
    members = [entry for entry in entries if ruler in _rulers(entry) and _group(entry, part) is not None]
    truths: dict[Any, list[Entry]] = {}
    for entry in members:
        if entry.whole:
            truths.setdefault(_truth(entry, ruler), []).append(entry)
    partial = [entry for entry in members if not entry.whole]
    if not truths and partial:
        return (_table([], partial, ruler, part),)
    ordered = sorted(truths.values(), key=lambda group: (-len(group), group[0].digest))
    return tuple(_table(group, [] if number else partial, ruler, part) for number, group in enumerate(ordered))


def _left_out(entries: Iterable[Entry], ruler: Ruler) -> tuple[str, ...]:
    return tuple(entry.scores.submission.method for entry in entries if ruler not in _rulers(entry))


def _truth(entry: Entry, ruler: Ruler) -> tuple[Any, ...]:
    """The figures of the reference rows: what one dataset gives one protocol, whoever scores it.

    The observations belong to it, because a dataset without a sha256 may share its name with another.
    """
    rows = []
    for name in REFERENCES:
        for part, group in sorted(entry.scores.references.get(name, {}).items()):
            for metric in metrics_of(ruler.protocol):
                value = figure(group, metric)
                rows.append((name, part, metric.name, None if value is None else round(value, 6)))
    return (tuple(sorted((row.key, row.frames) for row in entry.scores.observations)), tuple(rows))


def _table(entries: Sequence[Entry], partial: Sequence[Entry], ruler: Ruler, part: str) -> Table:
    ranking = headline(metrics_of(ruler.protocol))
    assert ranking is not None  # both protocols have an IoU
    rows = [_row(entry, part) for entry in entries]
    values = [value for row in rows if (value := figure(row.group, ranking)) is not None]
    rows = [Row(_rank(figure(r.group, ranking), values), r.title, r.entry, r.group) for r in rows]
    beside = entries[0].scores.references if entries else {}
    for name in REFERENCES:
        group = beside.get(name, {}).get(part)
        if group is not None:
            rows.append(Row(None, REFERENCE_TITLES[name], None, group))
    below = [_row(entry, part) for entry in partial]
    metrics = tuple(
        m for m in metrics_of(ruler.protocol) if any(figure(row.group, m) is not None for row in (*rows, *below))
    )
    count = max(row.group.observations for row in (rows or below))
    return Table(_best_first(rows, ranking), _best_first(below, ranking), metrics or (ranking,), ranking, count)


def _row(entry: Entry, part: str) -> Row:
    group = _group(entry, part)
    assert group is not None  # entries without the part were left out
    return Row(None, entry.scores.submission.method, entry, group)


def _rank(value: float | None, values: Iterable[float]) -> int | None:
    """1 + how many are better; equal values share a rank."""
    return None if value is None else 1 + sum(other > value for other in values)


def _best_first(rows: Iterable[Row], ranking: Metric) -> tuple[Row, ...]:
    def order(row: Row) -> tuple[Any, ...]:
        value = figure(row.group, ranking)
        digest = row.entry.digest if row.entry else ""
        return (value is None, -(value or 0.0), row.entry is None, row.title, digest)

    return tuple(sorted(rows, key=order))
