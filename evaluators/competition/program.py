"""The scoring program of a competition: from the platform's folders to a row of the leaderboard.

    main(["/app/input", "/app/output"])

reads the submission from ``input/res``, the truth from ``input/ref`` and the task from ``competition.json`` in
the working directory, where the scoring program lies. It writes

- ``scores.json``: the leaderboard's columns, with `DECIMALS`. Not written where anything is wrong, so that the platform
  reports failure;
- ``avs3d_scores.json``: the file of scores that `avs3d-eval --json` writes, for the organisers;
- ``detailed_results.html``: the figures, or the bad files; nothing about single observations or the truth.

The log on stdout and stderr names the bad files (`SHOWN` at most), the result or the cause of a failure. Exit status:
0 scored, 1 submission invalid or damaged data, 2 not set up as expected.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from avs3d_bench.commands.report import Problem, printable, shorten
from avs3d_bench.contract.competition import DECIMALS, REFERENCE_PRIVATE, REFERENCE_PUBLIC, TASK_JSON, CompetitionTask
from avs3d_bench.contract.scores import PROTOCOLS, Protocol, Scores
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import os_error_line, read_record, write_bytes, write_json
from evaluators.competition.page import SHOWN, CompetitionRow, results_page
from evaluators.reading.records import InvalidSubmission
from evaluators.reading.submission import open_submission
from evaluators.score import score

SCORES_JSON = "scores.json"
RECORD_JSON = "avs3d_scores.json"
DETAILS_HTML = "detailed_results.html"
#: Masks that one process scores before others would have started.
_FEW_MASKS = 400
#: What the platform adds to a submission: the exit code of its first step.
_PLATFORM_FILES = ("metadata",)


def main(arguments: Sequence[str]) -> NoReturn:
    """Run the scoring program and exit.

    Args:
        arguments: the folders of input and output.
    """
    try:
        if len(arguments) != 2:
            raise UsageError(f"arguments {list(arguments)}; expected the folders of input and output")
        status = run(Path(arguments[0]), Path(arguments[1]), Path.cwd())
    except Avs3dError as error:
        _say(f"scoring: error: {error}")
        status = error.exit_code
    except OSError as error:
        _say(f"scoring: error: {os_error_line(error)}")
        status = 1
    except MemoryError:
        _say("scoring: error: out of memory; the organisers must use a larger worker")
        status = 1
    raise SystemExit(status)


def run(source: Path, target: Path, program: Path) -> int:
    """Score what lies in the platform's folders.

    Args:
        source: the input: ``res`` with the submission, ``ref`` with the truth.
        target: the output.
        program: the folder of the scoring program.

    Returns:
        the exit status: 0 scored, 1 submission invalid.

    Raises:
        UsageError: if the submission is none, or the task does not fit this evaluator.
        Avs3dError: if the reference data are damaged.
    """
    task = read_record(program / TASK_JSON, CompetitionTask)
    print(f"{task.title}: {len(task.observations)} observations", flush=True)
    _check_task(task)
    data = Dataset(source / "ref" / REFERENCE_PUBLIC, source / "ref" / REFERENCE_PRIVATE)
    missing = [key for key in task.observations if key not in data]
    if missing:
        raise UsageError(f"reference data: no {missing[0]}; the organisers must upload the bundle again")
    names: tuple[Protocol, ...] = tuple(task.protocols)
    try:
        with open_submission(_submission(source / "res")) as submission:
            evaluation = score(submission, data, protocols=names, only=task.observations, workers=_workers(data, task))
    except InvalidSubmission as error:
        problems = _own_problems(error.report.problems)
        _say("\n".join(_lines(problems)))
        wrong = sum(problem.severity == "error" for problem in problems)
        which = "named above" if len(problems) <= SHOWN else "the first ones named above; `avs3d check` names all"
        _say(f"scoring: error: {wrong:,} error{'' if wrong == 1 else 's'} in the submission, {which}; no score")
        write_bytes(target / DETAILS_HTML, results_page(task.title, (), problems).encode())
        return 1
    scores = evaluation.scores
    rows = _rows(task, scores)
    values = leaderboard_row(task, scores)
    for row in rows:
        print(row.text)
    problems = _own_problems(evaluation.warnings)
    if problems:
        print("\n".join(_lines(problems)))
    write_bytes(target / DETAILS_HTML, results_page(task.title, rows, problems).encode())
    write_json(target / RECORD_JSON, scores)
    # Last: with this file, the platform takes the submission as scored.
    write_json(target / SCORES_JSON, values)
    print(f"scored: {len(values)} of {len(task.columns)} columns", flush=True)
    return 0


def _workers(data: Dataset, task: CompetitionTask) -> int | None:
    """One process for what it scores in seconds; None, one per core, for more."""
    return 1 if sum(len(data[key].test) for key in task.observations) < _FEW_MASKS else None


def leaderboard_row(task: CompetitionTask, scores: Scores) -> dict[str, float]:
    """Column key → value with `DECIMALS`, for all columns that this submission has.

    A figure that is not available (3D without points) or has no interval (fewer than six observations) is left out: the
    platform takes numbers only.
    """
    row = {}
    for column in task.columns:
        summary = getattr(scores.overall, column.protocol)
        if summary is None:
            continue
        value = getattr(summary, column.figure)
        if column.bound != "mean":
            interval = summary.intervals.get(column.figure)
            value = interval[column.bound == "high"] if interval and value is not None else None
        if value is not None:
            row[column.key] = round(float(value), DECIMALS)
    return row


def _rows(task: CompetitionTask, scores: Scores) -> tuple[CompetitionRow, ...]:
    """The overall figures, one row each, in the order of the leaderboard."""
    found = []
    for column in task.columns:
        if column.bound != "mean":
            continue
        summary = getattr(scores.overall, column.protocol)
        value = getattr(summary, column.figure) if summary is not None else None
        interval = summary.intervals.get(column.figure) if summary is not None else None
        reason = getattr(summary, "unavailable", {}).get(column.figure) if summary is not None else None
        found.append(CompetitionRow(column.title, value, interval if value is not None else None, reason))
    return tuple(found)


def _check_task(task: CompetitionTask) -> None:
    """The protocols of the task are those of this evaluator.

    Raises:
        UsageError: naming the protocol.
    """
    for name, version in task.protocols.items():
        if PROTOCOLS[name] != version:
            raise UsageError(
                f"protocol {name} {PROTOCOLS[name]} in this image, expected {version}; the organisers must use the "
                f"image of avs3d-bench {task.toolkit_version}"
            )


def _submission(folder: Path) -> Path:
    """Where the submission lies: the folder, or the only folder or archive in it.

    Raises:
        UsageError: if there is nothing.
    """
    if not folder.is_dir():
        raise UsageError("input/res: missing; expected the submission")
    entries = [path for path in folder.iterdir() if path.name not in _PLATFORM_FILES and path.name != "__MACOSX"]
    if not entries:
        raise UsageError("the submission is empty; expected submission.json and the masks at the root of the archive")
    # Links are not followed: one may lead to the truth.
    only = entries[0] if len(entries) == 1 and not entries[0].is_symlink() else None
    if only is not None and (only.is_dir() or only.suffix.lower() == ".zip"):
        if only.name.startswith("part_"):
            return folder
        print(f"the submission lies in {printable(only.name)}")
        return only
    return folder


def _own_problems(problems: Sequence[Problem]) -> tuple[Problem, ...]:
    """Without those of files that the platform added."""
    return tuple(problem for problem in problems if problem.path not in _PLATFORM_FILES)


def _lines(problems: Sequence[Problem]) -> list[str]:
    """The findings as lines of the log, `SHOWN` of them at most."""
    first, rest = shorten(problems, SHOWN)
    lines = [printable(f"{problem.severity}: {problem.path}: {problem.message}") for problem in first]
    return [*lines, f"… and {rest}"] if rest else lines


def _say(message: str) -> None:
    print(message, file=sys.stderr, flush=True)
