"""A static page that ranks files of scores, with links to their reports.

    index.html                     the page
    reports/NAME.html, NAME.json   the report and the scores of each entry

The folder can be served, or opened from disk, as it is; its own score files can be ranked again. What is ranked with
what: `evaluators.reporting.ranking`. The order of the files makes no difference.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from avs3d_bench.commands.outputs import check_replaceable
from avs3d_bench.commands.report import printable
from avs3d_bench.contract.scores import Scores
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import dump_json, write_bytes, write_json
from evaluators.reporting.board import board_of
from evaluators.reporting.pages import write_page
from evaluators.reporting.question_tables import split_questions
from evaluators.reporting.ranking import ScoresEntry, leaderboard_values
from evaluators.reporting.report_check import read_report
from evaluators.reporting.score_file import contents_digest, read_scores, read_verification
from evaluators.reporting.signatures import LEADERBOARD, REPORT, SCORES

_SLUG_LENGTH = 60
_SHORT_DIGEST = 12
#: Characters of a name in a message.
_NAMED = 200


def write_leaderboard(
    folder: Path, score_files: Sequence[Path], verified: Sequence[Path] = (), json_file: Path | None = None
) -> tuple[str, ...]:
    """Write the page, and copies of the score files and their reports, into a folder.

    Args:
        folder: made if missing; files of other names in it stay.
        score_files: written by ``avs3d-eval --json`` or ``avs3d qa-score --json``; a file given twice counts once.
            Those of questions get a table of their own and are not copied.
        verified: written by ``avs3d verify --json``, by whoever makes the page: the files of scores that they confirm
            are marked. Records that lie beside the files of scores are never looked for, since their authors can write
            them.
        json_file: gets the tables as JSON as well (`evaluators.reporting.board`).

    Returns:
        a line for each report that is not copied, since it lies elsewhere or is none that this toolkit wrote, and for
        each record that confirms none of the files.

    Raises:
        UsageError: if there is no score file, or a file would be overwritten that is no part of this leaderboard.
        Avs3dError: if a file is no file of scores (the file and the field are named), or nothing can be written.

    Examples:
        >>> from pathlib import Path
        >>> files = sorted(Path("data/demo-scores").glob("*.json"))
        >>> write_leaderboard(Path("leaderboard"), files, json_file=Path("leaderboard.json"))
        ()
        >>> sorted(path.name for path in Path("leaderboard").rglob("*") if path.is_file())
        ['centre-box.json', 'index.html', 'oracle-category.json']
    """
    folder = Path(folder)
    masks, questions = split_questions(score_files)
    entries, notes = _marked(read_entries(masks) if masks or not questions else (), verified)
    _refuse_overwriting(folder, entries, verified)
    for entry in entries:
        report = None
        if entry.report is not None:
            report = f"{entry.name}.html"
            _write(folder / "reports" / report, read_report(entry.report))
        scores = entry.scores.model_copy(update={"report": report})
        _write(folder / "reports" / f"{entry.name}.json", dump_json(scores).encode())
    write_page(folder / "index.html", "leaderboard.html.j2", leaderboard_values(entries) | {"questions": questions})
    if json_file is not None:
        write_json(json_file, board_of(entries, questions))
    return (*(entry.note for entry in entries if entry.note), *notes)


def _marked(entries: Sequence[ScoresEntry], records: Sequence[Path]) -> tuple[tuple[ScoresEntry, ...], list[str]]:
    """The entries, marked where a record confirms them; and a line for each record that confirms none."""
    confirmed, notes = set(), []
    digests = {entry.digest for entry in entries}
    for path in map(Path, records):
        record = read_verification(path)
        if not record.same or record.differences or not record.values:
            notes.append(f"{path}: marks nothing: {len(record.differences):,} of its values were not confirmed")
        elif record.scores.digest not in digests:
            method = printable(record.scores.method[:_NAMED])
            notes.append(
                f"{path}: marks nothing: it is about other scores of {method}, digest "
                f"{record.scores.digest[:_SHORT_DIGEST]}; verify the file of scores that is ranked here"
            )
        else:
            confirmed.add(record.scores.digest)
    return tuple(replace(entry, verified=entry.digest in confirmed) for entry in entries), notes


def _write(path: Path, data: bytes) -> None:
    if not (path.is_file() and path.read_bytes() == data):
        write_bytes(path, data)


def read_entries(score_files: Sequence[Path], *, reports: bool = True) -> tuple[ScoresEntry, ...]:
    """The entries of a board, each with its name, sorted by method.

    Args:
        score_files: written by ``avs3d-eval --json``.
        reports: look for their reports as well.

    Raises:
        UsageError: if there is none.
        Avs3dError: if a file is broken.
    """
    if not score_files:
        raise UsageError("no file of scores: expected at least one file written by avs3d-eval --json")
    found: dict[str, ScoresEntry] = {}
    for path in sorted(map(Path, score_files)):
        entry = read_entry(path, reports)
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
        named.append(replace(entry, name=name, twin=methods[method] > 1))
    return tuple(named)


def read_entry(path: Path, reports: bool) -> ScoresEntry:
    """One file of scores.

    Args:
        path: written by ``avs3d-eval --json``.
        reports: look for its report as well.

    Raises:
        Avs3dError: if the file is broken.
    """
    scores = read_scores(path)
    # A copy in a leaderboard, whose report lies elsewhere, counts as the same entry.
    digest = contents_digest(scores)
    report, why = _report(path, scores) if reports else (None, None)
    return ScoresEntry(scores, path, digest, report, note=why)


def _report(path: Path, scores: Scores) -> tuple[Path | None, str | None]:
    """The report that lies beside the file of scores, or why there is none that may be copied; both None if gone."""
    if scores.report is None:
        return None, None
    folder = path.resolve().parent  # a link to a file of scores has no report beside it
    report = folder / scores.report
    if "/" in scores.report:
        return None, f"{path}: report {printable(scores.report[:_NAMED])!r} is not copied: expected one beside the file"
    if not os.path.lexists(report):
        return None, None
    if report.is_symlink():
        return None, f"{report}: not copied: a link; expected the report itself"
    try:
        read_report(report)
    except Avs3dError as error:
        return None, f"not copied: {error}"
    return report, None


def _slug(method: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", method.lower())[:_SLUG_LENGTH].strip("-") or "method"


def _refuse_overwriting(folder: Path, entries: Iterable[ScoresEntry], records: Iterable[Path]) -> None:
    """A copy must not take the place of another entry's file, a record of `avs3d verify`, or a file of others."""
    owners = {Path(path).resolve(): str(path) for path in records}
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
    page = folder / "index.html"
    check_replaceable(page, (LEADERBOARD,))
    # Beside a leaderboard's page, reports/ holds copies; elsewhere, files of scores may be the only ones.
    copies = {".json": (SCORES,), ".html": (REPORT,)} if page.is_file() else {}
    for target, _ in targets[1:]:
        if target.resolve() not in owners:
            check_replaceable(target, copies.get(target.suffix, ()))
