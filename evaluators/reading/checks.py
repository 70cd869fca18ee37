"""Problems of a submission, file by file, found before it is scored.

`check_structure` (in `evaluators.reading.structure`) looks at names, kinds and links and opens nothing but folders;
`check_contents` decodes what is left. Scoring runs the first and does the second while it decodes anyway.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.media import png_header
from avs3d_bench.parallel import advance, process_each
from avs3d_bench.predictions import read_mask, read_points
from avs3d_bench.report import Problem, Report, ordered
from evaluators.reading.structure import check_structure
from evaluators.reading.submission import open_submission
from evaluators.records import InvalidSubmission, Submission

__all__ = [
    "InvalidSubmission",
    "check",
    "check_contents",
    "check_structure",
    "check_submission",
    "has_points",
    "problem_of",
]


def check_submission(
    path: str | Path,
    dataset_root: str | Path,
    *,
    only: Iterable[str] = (),
    aisrm: bool | None = None,
    workers: int | None = None,
    progress: bool = False,
) -> Report:
    """Everything that is wrong with the submission at ``path`` for the dataset at ``dataset_root``.

    Args:
        path: a folder or a .zip.
        dataset_root: ours or the official release.
        only: shell patterns of observation keys; the others are left out.
        aisrm: which folder of the released pipeline's output to read; see `open_submission`.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if one of the paths is no submission or no dataset, or no observation matches ``only``.
        Avs3dError: if the dataset is damaged.
    """
    dataset = Dataset(dataset_root)
    observations = select(dataset, only)
    try:
        with open_submission(path, aisrm=aisrm) as submission:
            problems = check_structure(submission, dataset, observations)
            return check_contents(submission, observations, problems, workers=workers, progress=progress)
    except InvalidSubmission as error:
        return error.report


#: The public name: `from evaluators import check`.
check = check_submission


def select(dataset: Dataset, only: Iterable[str]) -> tuple[Observation, ...]:
    """The observations that match one of the patterns, all without patterns.

    Raises:
        UsageError: if there is none.
    """
    patterns = tuple(only)
    chosen = dataset.select(*patterns)
    if not chosen:
        what = f"no observation matches {' '.join(patterns)}" if patterns else "no observation"
        raise UsageError(f"{dataset.root}: {what}; expected some of {', '.join(dataset.keys[:3]) or 'part_1/…'}")
    return chosen


def problem_of(submission: Submission, path: Path, error: Avs3dError) -> Problem:
    """An error about one of the submission's files as a finding."""
    return Problem("error", path.relative_to(submission.root).as_posix(), str(error).removeprefix(f"{path}: "))


def has_points(submission: Submission, observations: Iterable[Observation]) -> bool:
    """Whether the submission holds any 3D prediction; the released pipeline never writes one."""
    if submission.layout == "official":
        return False
    return any(os.path.lexists(submission.points_path(observation.key)) for observation in observations)


def check_contents(
    submission: Submission,
    observations: Sequence[Observation],
    problems: Sequence[Problem],
    *,
    workers: int | None = None,
    progress: bool = False,
) -> Report:
    """Decode every file that `check_structure` had nothing against.

    Args:
        submission: the opened submission.
        observations: of the dataset, those asked for.
        problems: what `check_structure` found.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Returns:
        the report, with the findings of both.
    """
    bad = frozenset(problem.path for problem in problems if problem.severity == "error")
    points = has_points(submission, observations)
    look = partial(_look, submission, observations[0].path.parents[3], bad, points)
    keys = [observation.key for observation in observations]
    files = int(submission.layout == "avs3d")
    found = list(problems)
    sizes = [len(observation.test) for observation in observations]
    looked = process_each(look, keys, workers=workers, label="checking frames", progress=progress, sizes=sizes)
    for _, (count, more) in looked:
        files += count
        found += more
    return Report(submission.named, True, len(keys), files, ordered(found))


def _look(
    submission: Submission, root: Path, bad: frozenset[str], points: bool, key: str
) -> tuple[int, tuple[Problem, ...]]:
    """(files read, findings) of one observation."""
    observation = Observation(root, key)
    problems, files = [], 0
    for number, frame in enumerate(observation.test):
        advance(number, len(observation.test))
        path = submission.mask_path(key, frame.name)
        name = path.relative_to(submission.root)
        if not bad.isdisjoint((name.as_posix(), name.parent.as_posix())):  # the file, or a folder behind a link
            continue
        size = png_header(frame.path(layout.SEMANTIC_MASKS))
        files += 1
        try:
            read_mask(path, size.width, size.height, released=submission.layout == "official")
        except Avs3dError as error:
            problems.append(problem_of(submission, path, error))
    path = submission.points_path(key)
    if points and path.relative_to(submission.root).as_posix() not in bad:
        files += 1
        try:
            read_points(path)
        except Avs3dError as error:
            problems.append(problem_of(submission, path, error))
    return files, tuple(problems)
