"""The rules of a Codabench competition bundle, and the check of a bundle against them.

Each rule names its source: ``yaml`` is the page "Yaml-Structure" and ``bundle`` the page "Competition-Bundle-Structure"
of the organisers' documentation (https://docs.codabench.org/latest/Organizers/Benchmark_Creation/), ``unpacker`` is
`src/apps/competitions/unpackers/`, ``models`` are the `models.py` of `competitions`, `tasks` and `leaderboards`, and
``worker`` is `compute_worker/compute_worker.py`, all in https://github.com/codalab/codabench (read in November 2026).
docs/competition.md lists them.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime, time
from pathlib import Path, PurePosixPath
from typing import IO, Any

import yaml

from avs3d_bench.errors import UsageError

BUNDLE_YAML = "competition.yaml"
#: Of a scoring program: its key ``command`` is what the worker runs.
METADATA_YAML = "metadata.yaml"
#: Where the worker puts a program, its input and its output in the container (``worker``).
PROGRAM, INPUT, OUTPUT = "/app/program", "/app/input", "/app/output"
#: Longest names (``models``).
MOST_TITLE, MOST_IMAGE, MOST_LEADERBOARD, MOST_KEY, MOST_COLUMN, MOST_NAME = 256, 128, 64, 36, 36, 256
SUBMISSION_RULES = (
    "Add", "Add_And_Delete", "Add_And_Delete_Multiple", "Force_Last", "Force_Latest_Multiple", "Force_Best",
)  # fmt: skip
COMPUTATIONS = ("sum", "avg", "min", "max", "avg_rank")
PICTURES = (".png", ".jpg", ".jpeg")

#: Keys that the unpacker reads; it ignores any other without a word, a misspelt one too (``yaml``, ``unpacker``).
KNOWN = {
    "competition": "version title description image terms registration_auto_approve docker_image "
    "make_programs_available make_input_data_available queue enable_detailed_results "
    "show_detailed_results_in_submission_panel show_detailed_results_in_leaderboard contact_email reward "
    "auto_run_submissions can_participants_make_submissions_public forum_enabled competition_type fact_sheet pages "
    "phases tasks solutions leaderboards",
    "page": "title file",
    "phase": "index name description start end max_submissions max_submissions_per_day auto_migrate_to_this_phase "
    "execution_time_limit hide_output hide_prediction_output hide_score_output starting_kit public_data "
    "accepts_only_result_submissions tasks",
    "task": "index name description key input_data reference_data scoring_program ingestion_program "
    "ingestion_only_during_scoring",
    "solution": "index name description key path tasks",
    "leaderboard": "title key submission_rule hidden columns",
    "column": "title key index sorting computation computation_indexes precision hidden",
}


def check_bundle(path: str | Path) -> tuple[str, ...]:
    """Everything that the platform would refuse or misread in a bundle, one line each; empty if it is valid.

    Raises:
        UsageError: if the file is missing or no zip archive.
    """
    if not Path(path).is_file() or not zipfile.is_zipfile(path):
        raise UsageError(f"{path}: no zip archive; expected a competition bundle")
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        if BUNDLE_YAML not in names:
            return (f"{BUNDLE_YAML}: missing; expected it at the root of the bundle",)
        try:
            competition = yaml.safe_load(archive.read(BUNDLE_YAML))
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            return (f"{BUNDLE_YAML}: no YAML ({' '.join(str(error).split())})",)
        if not isinstance(competition, Mapping):
            return (f"{BUNDLE_YAML}: {type(competition).__name__}, expected a mapping",)
        return tuple(_Check(archive, competition).problems())


class _Check:
    """The rules, on one bundle."""

    def __init__(self, archive: zipfile.ZipFile, competition: Mapping[str, Any]) -> None:
        self.archive = archive
        self.names = frozenset(archive.namelist())
        self.competition = competition

    def problems(self) -> Iterator[str]:
        yield from self._archive()
        yield from self._head()
        yield from self._pages()
        yield from self._tasks()
        yield from self._solutions()
        yield from self._phases()
        yield from self._leaderboards()

    def _archive(self) -> Iterator[str]:
        """The platform unpacks every member into one folder (unpacker)."""
        if len(self.names) < len(self.archive.namelist()):
            yield "bundle: a name occurs twice; expected each once"
        for name in sorted(self.names):
            if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\\" in name:
                yield f"{name}: leads out of the bundle; expected a relative path"

    def _head(self) -> Iterator[str]:
        head = self.competition
        yield from _unknown("competition", head, BUNDLE_YAML)
        if str(head.get("version")) != "2":  # yaml: without it, the unpacker of version 1 reads the file
            yield f"version: {head.get('version')!r}, expected 2"
        yield from _text(head, "title", "competition", MOST_TITLE)
        yield from self._file(head, "image", "competition", PICTURES)
        yield from self._page_file(head, "terms", "competition")
        image = head.get("docker_image")
        if image is not None and (not isinstance(image, str) or not 0 < len(image) <= MOST_IMAGE or " " in image):
            yield f"docker_image: {image!r}, expected name:tag of at most {MOST_IMAGE} characters"
        email = head.get("contact_email")
        if email is not None and not re.fullmatch(r"[^@\s]+@[^@\s]+\.[^@\s]+", str(email)):
            yield f"contact_email: {email!r}, expected an address"

    def _pages(self) -> Iterator[str]:
        for number, page in _records(self.competition, "pages"):
            yield from _unknown("page", page, f"pages[{number}]")
            yield from _text(page, "title", f"pages[{number}]", MOST_NAME)
            yield from self._page_file(page, "file", f"pages[{number}]")
        if not isinstance(self.competition.get("pages"), list):  # the unpacker iterates over it
            yield "pages: missing; expected a list"

    def _tasks(self) -> Iterator[str]:
        found = list(_records(self.competition, "tasks"))
        if not found:
            yield "tasks: missing; expected at least one"
        yield from _indexes(found, "tasks")
        for number, task in found:
            where = f"tasks[{number}]"
            yield from _unknown("task", task, where)
            if "key" in task:
                continue
            yield from _text(task, "name", where, MOST_NAME)
            yield from self._file(task, "scoring_program", where, (".zip",))
            yield from self._program(task.get("scoring_program"), where)
            for kind in ("input_data", "reference_data", "ingestion_program"):
                if kind in task:
                    yield from self._file(task, kind, where, (".zip",))

    def _program(self, name: object, where: str) -> Iterator[str]:
        """A scoring program needs metadata.yaml with a command at its root, which no shell reads (worker)."""
        if name not in self.names:
            return
        with self.archive.open(str(name)) as stream:
            inner = _inner(stream)
        if inner is None:
            yield f"{name}: no zip archive; expected the scoring program"
        elif METADATA_YAML not in inner.namelist():
            yield f"{name}: no {METADATA_YAML} at its root; expected one with the key command"
        else:
            metadata = yaml.safe_load(inner.read(METADATA_YAML))
            command = metadata.get("command") if isinstance(metadata, Mapping) else None
            if not isinstance(command, str) or not command.strip():
                yield f"{name}: {METADATA_YAML} has no command ({where})"
            elif re.search(r"[|&;<>`]", command):
                yield f"{name}: command {command!r} needs a shell, which the worker does not start"

    def _solutions(self) -> Iterator[str]:
        found = list(_records(self.competition, "solutions"))
        yield from _indexes(found, "solutions")
        tasks = {task.get("index") for _, task in _records(self.competition, "tasks")}
        for number, solution in found:
            where = f"solutions[{number}]"
            yield from _unknown("solution", solution, where)
            if "key" not in solution:
                yield from self._file(solution, "path", where, (".zip",))
            yield from _pointers(solution, tasks, where)

    def _phases(self) -> Iterator[str]:
        found = sorted(_records(self.competition, "phases"), key=lambda pair: _number(pair[1].get("index")))
        if not found:
            yield "phases: missing; expected at least one"
        tasks = {task.get("index") for _, task in _records(self.competition, "tasks")}
        ended: datetime | None = None
        for position, (number, phase) in enumerate(found):
            where = f"phases[{number}]"
            yield from _unknown("phase", phase, where)
            yield from _text(phase, "name", where, MOST_NAME)
            yield from _pointers(phase, tasks, where)
            for key in ("public_data", "starting_kit"):
                if key in phase:
                    yield from self._file(phase, key, where, (".zip",))
            for key in ("max_submissions", "max_submissions_per_day", "execution_time_limit"):
                if key in phase and (not isinstance(phase[key], int) or isinstance(phase[key], bool) or phase[key] < 1):
                    yield f"{where}: {key} {phase[key]!r}, expected a whole number from 1"
            if position == 0 and phase.get("auto_migrate_to_this_phase"):
                yield f"{where}: auto_migrate_to_this_phase, but no phase comes before it"
            start, end = _moment(phase.get("start")), _moment(phase.get("end"))
            if start is None:
                yield f"{where}: start {phase.get('start')!r}, expected YYYY-MM-DD HH:MM:SS"
            if phase.get("end") is not None and end is None:
                yield f"{where}: end {phase['end']!r}, expected YYYY-MM-DD HH:MM:SS"
            if start and end and end <= start:
                yield f"{where}: ends {end}, before it starts"
            if end is None and position < len(found) - 1:
                yield f"{where}: no end, but a phase comes after it"
            # Equal times are refused too ("Phases dates conflict").
            if position and start and ended and start <= ended:
                yield f"{where}: starts {start}, expected later than the end of the phase before it, {ended}"
            ended = end

    def _leaderboards(self) -> Iterator[str]:
        found = list(_records(self.competition, "leaderboards"))
        if len(found) != 1:  # every phase gets the first one (unpacker)
            yield f"leaderboards: {len(found)}, expected one: the platform uses the first for all phases"
        for number, board in found:
            where = f"leaderboards[{number}]"
            yield from _unknown("leaderboard", board, where)
            yield from _text(board, "title", where, MOST_LEADERBOARD)
            yield from _text(board, "key", where, MOST_KEY)
            if board.get("submission_rule", "Add") not in SUBMISSION_RULES:
                yield f"{where}: submission_rule {board['submission_rule']!r}, expected one of {SUBMISSION_RULES}"
            columns = list(_records(board, "columns"))
            if not columns:
                yield f"{where}: no columns; expected at least one"
            yield from _indexes(columns, f"{where}.columns")
            keys = [column.get("key") for _, column in columns]
            yield from (f"{where}: key {key!r} twice; expected each once" for key in _doubles(keys))
            for place, column in columns:
                yield from self._column(column, f"{where}.columns[{place}]", len(columns))

    @staticmethod
    def _column(column: Mapping[str, Any], where: str, count: int) -> Iterator[str]:
        yield from _unknown("column", column, where)
        yield from _text(column, "title", where, MOST_COLUMN)
        yield from _text(column, "key", where, MOST_KEY)
        if column.get("sorting", "desc") not in ("asc", "desc"):
            yield f"{where}: sorting {column['sorting']!r}, expected asc or desc"
        precision = column.get("precision", 2)
        if not isinstance(precision, int) or not 0 <= precision <= 10:  # scores have ten decimal places (models)
            yield f"{where}: precision {precision!r}, expected 0 to 10"
        if "computation" in column:
            if column["computation"] not in COMPUTATIONS:
                yield f"{where}: computation {column['computation']!r}, expected one of {COMPUTATIONS}"
            indexes = column.get("computation_indexes")
            if not isinstance(indexes, list) or not set(map(_number, indexes)) <= set(range(count)):
                yield f"{where}: computation_indexes {indexes!r}, expected indexes of columns"

    def _file(self, record: Mapping[str, Any], key: str, where: str, suffixes: Sequence[str]) -> Iterator[str]:
        name = record.get(key)
        if not isinstance(name, str) or name not in self.names:
            yield f"{where}: {key} {name!r} is not in the bundle"
        elif not name.lower().endswith(tuple(suffixes)):
            yield f"{where}: {key} {name!r}, expected {' or '.join(suffixes)}"

    def _page_file(self, record: Mapping[str, Any], key: str, where: str) -> Iterator[str]:
        """A page is a text that is not empty (unpacker)."""
        found = list(self._file(record, key, where, (".md", ".html")))
        if not found and not self.archive.read(record[key]).strip():
            found = [f"{where}: {record[key]} is empty"]
        yield from found


def _inner(stream: IO[bytes]) -> zipfile.ZipFile | None:
    import io

    try:
        return zipfile.ZipFile(io.BytesIO(stream.read()))
    except zipfile.BadZipFile:
        return None


def _records(parent: Mapping[str, Any], key: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    value = parent.get(key)
    for number, each in enumerate(value if isinstance(value, list) else ()):
        yield number, each if isinstance(each, Mapping) else {}


def _unknown(kind: str, record: Mapping[str, Any], where: str) -> Iterator[str]:
    known = KNOWN[kind].split()
    yield from (f"{where}: the platform ignores the key {key!r}" for key in record if key not in known)


def _text(record: Mapping[str, Any], key: str, where: str, most: int) -> Iterator[str]:
    value = record.get(key)
    if not isinstance(value, str) or not 0 < len(value) <= most:
        yield f"{where}: {key} {value!r}, expected a text of 1 to {most} characters"


def _indexes(records: Sequence[tuple[int, Mapping[str, Any]]], where: str) -> Iterator[str]:
    indexes = [record.get("index") for _, record in records]
    if any(not isinstance(index, int) or isinstance(index, bool) or index < 0 for index in indexes):
        yield f"{where}: index {indexes}, expected a whole number from 0 in each"
    yield from (f"{where}: index {index!r} twice; expected each once" for index in _doubles(indexes))


def _doubles(values: Sequence[object]) -> list[object]:
    return [value for number, value in enumerate(values) if value in values[:number]]


def _pointers(record: Mapping[str, Any], tasks: set[Any], where: str) -> Iterator[str]:
    pointed = record.get("tasks")
    if not isinstance(pointed, list) or not pointed:
        yield f"{where}: no tasks; expected at least one index"
    else:
        yield from (f"{where}: no task has the index {index!r}" for index in pointed if index not in tasks)


def _number(value: object) -> int:
    return value if isinstance(value, int) else -1


def _moment(value: object) -> datetime | None:
    """A date, a time stamp, or a text of either, as the platform reads it: in UTC."""
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError:
            return None
    if isinstance(value, datetime):
        return value.replace(tzinfo=None)
    return datetime.combine(value, time()) if isinstance(value, date) else None
