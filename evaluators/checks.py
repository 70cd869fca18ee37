"""What is wrong with a submission, file by file, before anyone scores it.

`check_structure` looks at names, kinds and links and opens nothing but folders; `check_contents` decodes what is left.
Scoring runs the first and does the second while it decodes anyway.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.media import png_header
from avs3d_bench.parallel import process_each
from avs3d_bench.report import Problem, Report, ordered
from avs3d_bench.taxonomy import PARTS
from evaluators.archive import printable
from evaluators.masks import read_mask, read_points
from evaluators.records import InvalidSubmission, Submission
from evaluators.submission import open_submission

__all__ = ["InvalidSubmission", "check_contents", "check_structure", "check_submission", "has_points", "problem_of"]

#: Files that may stand at the top beside submission.json.
_COMPANIONS = ("README", "LICENCE", "LICENSE", "CITATION")
#: Entries of a folder tree that are looked at beyond those expected.
_SURPLUS = 100_000


def check_submission(
    path: str | Path,
    dataset_root: str | Path,
    *,
    only: Iterable[str] = (),
    workers: int | None = None,
    progress: bool = False,
) -> Report:
    """Everything that is wrong with the submission at ``path`` for the dataset at ``dataset_root``.

    Args:
        path: a folder or a .zip.
        dataset_root: ours or the official release.
        only: shell patterns of observation keys; the others are left out.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if one of the paths is no submission or no dataset, or no observation matches ``only``.
        Avs3dError: if the dataset is damaged.
    """
    dataset = Dataset(dataset_root)
    observations = select(dataset, only)
    try:
        with open_submission(path) as submission:
            problems = check_structure(submission, dataset, observations)
            return check_contents(submission, observations, problems, workers=workers, progress=progress)
    except InvalidSubmission as error:
        return error.report


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
    """Whether the submission holds any 3D prediction; the released pipeline writes none, whatever its folders hold."""
    if submission.layout == "official":
        return False
    return any(os.path.lexists(submission.points_path(observation.key)) for observation in observations)


# Structure


@dataclass(frozen=True)
class _Entry:
    """Something in the submission's folder: its path relative to the root, and what it is."""

    path: str
    kind: str  # file, folder, link or other


def check_structure(submission: Submission, dataset: Dataset, observations: Sequence[Observation]) -> list[Problem]:
    """Missing, surplus and misplaced files, and what is no plain file; nothing is decoded.

    Args:
        submission: the opened submission.
        dataset: what it is for.
        observations: those of the dataset that are asked for; the rest is neither missed nor surplus.
    """
    problems = list(submission.problems)
    problems += _check_record(submission, dataset)
    problems += _check_folders(submission, observations)
    found: dict[str, str] = {}
    expected = _expected(submission, observations)
    scan = _walk(submission, observations, len(expected))
    for entry in scan:
        if entry is None:
            problems.append(
                Problem("error", ".", f"more than {_SURPLUS:,} surplus files and folders; the rest is not looked at")
            )
            break
        found[entry.path] = entry.kind
    problems += _check_entries(submission, dataset, observations, found, expected)
    problems += [Problem("error", path, "missing; expected a mask") for path in expected if path not in found]
    problems += _check_points(submission, observations, found)
    return problems


def _check_record(submission: Submission, dataset: Dataset) -> Iterator[Problem]:
    if submission.layout == "official" or any(p.path == layout.SUBMISSION_JSON for p in submission.problems):
        return
    said, record = submission.record, dataset.record
    named = printable(f"{said.dataset} {said.dataset_version}")
    if record is None:
        yield Problem(
            "note", layout.SUBMISSION_JSON, f"{named}: cannot be held against this "
            f"dataset, which has no {layout.DATASET_JSON}",
        )  # fmt: skip
    elif (said.dataset, said.dataset_version) != (record.name, record.version):
        yield Problem(
            "error", layout.SUBMISSION_JSON,
            f"made for {named}, expected {record.name} {record.version}, this dataset",
        )  # fmt: skip


def _check_folders(submission: Submission, observations: Iterable[Observation]) -> Iterator[Problem]:
    """Folders of masks in the released pipeline's own tree that a link puts elsewhere (in ours a link is no folder)."""
    root = submission.root.resolve()
    for observation in observations:
        folder = submission.root / observation.key / submission.masks
        if submission.layout == "official" and folder.is_dir() and not folder.resolve().is_relative_to(root):
            path = folder.relative_to(submission.root).as_posix()
            yield Problem("error", path, "a link out of the submission; expected a folder")


def _expected(submission: Submission, observations: Iterable[Observation]) -> dict[str, None]:
    """Paths of the masks, relative."""
    return {
        submission.mask_path(o.key, frame.name).relative_to(submission.root).as_posix(): None
        for o in observations
        for frame in o.test
    }


def _walk(submission: Submission, observations: Sequence[Observation], expected: int) -> Iterator[_Entry | None]:
    """Everything in the submission, links not followed; None at the end if there is absurdly much.

    In the official layout the folder is the pipeline's own: only the masks' folders are looked at.
    """
    root = submission.root
    tops = [""]
    if submission.layout == "official":
        tops = [f"{o.key}/{submission.masks}" for o in observations if (root / o.key / submission.masks).is_dir()]
    left = expected + _SURPLUS
    folders = list(reversed(tops))
    while folders:
        folder = folders.pop()
        below = []
        with os.scandir(root / folder) as entries:
            for entry in entries:
                left -= 1
                if left < 0:
                    yield None
                    return
                path = f"{folder}/{entry.name}" if folder else entry.name
                if entry.is_symlink():
                    yield _Entry(path, "link")
                elif entry.is_dir():
                    yield _Entry(path, "folder")
                    below.append(path)
                else:
                    yield _Entry(path, "file" if entry.is_file() else "other")
        folders += sorted(below, reverse=True)


def _check_entries(
    submission: Submission,
    dataset: Dataset,
    observations: Sequence[Observation],
    found: dict[str, str],
    expected: Collection[str],
) -> Iterator[Problem]:
    root = submission.root.resolve()
    asked = {o.key: o for o in observations}
    for path, kind in sorted(found.items()):
        name = printable(path)
        if kind == "other":
            yield Problem("error", name, "no plain file (a pipe, socket or device); expected none")
            continue
        if kind == "link":
            fault = _link_fault(root, submission.root / path)
            if fault:
                yield Problem("error", name, fault)
                continue
        pieces = path.split("/")
        key = "/".join(pieces[:4])
        inside = "/".join(pieces[4:])
        if path in expected or (key in asked and inside == layout.SUBMISSION_POINTS):
            if kind == "folder":
                yield Problem("error", name, "a folder; expected a file")
        elif pieces[0] not in PARTS:
            if len(pieces) == 1 and path != layout.SUBMISSION_JSON:
                yield from _at_the_top(name, kind)
        elif kind == "folder":
            if len(pieces) == 4 and key not in dataset.keys:
                yield Problem("error", name, "no such observation in the dataset")
            elif len(pieces) > 4 and key in asked and not submission.masks.startswith(inside):
                yield Problem("error", name, f"surplus folder; expected {submission.masks}/ only")
        elif key in asked:
            yield Problem("error", name, _surplus(asked[key], submission, inside))
        elif key not in dataset.keys:
            yield Problem("error", name, "surplus file; no such observation in the dataset")


def _at_the_top(name: str, kind: str) -> Iterator[Problem]:
    if not (name.upper().startswith(_COMPANIONS) or name.lower().endswith(".md")):
        what = "folder" if kind == "folder" else "file"
        yield Problem("warning", name, f"not looked at: no {what} of a submission")


def _surplus(observation: Observation, submission: Submission, inside: str) -> str:
    folder, _, name = inside.rpartition("/")
    stem = name.removesuffix(".png")
    if folder == submission.masks and name.endswith(".png") and observation.splits.get(stem) == "train":
        return "a mask of a train frame; expected test frames only"
    if folder == submission.masks:
        return "surplus file; expected one mask per test frame, named as the frame (frame_000.png)"
    return f"surplus file; expected {submission.masks}/frame_000.png and {layout.SUBMISSION_POINTS} only"


def _link_fault(root: Path, path: Path) -> str | None:
    """What is wrong with a symbolic link; None for one to a file inside the submission."""
    try:
        target = path.resolve(strict=True)
        mode = target.stat().st_mode
    except (OSError, RuntimeError):
        return "a broken or circular link; expected a file"
    if not target.is_relative_to(root):
        return "a link out of the submission; expected a file"
    if not stat.S_ISREG(mode):
        return "a link to what is no file; expected a file"
    return None


def _check_points(
    submission: Submission, observations: Sequence[Observation], found: dict[str, str]
) -> Iterator[Problem]:
    if submission.layout == "official":
        return
    paths = [f"{o.key}/{layout.SUBMISSION_POINTS}" for o in observations]
    missing = [path for path in paths if path not in found]
    if len(missing) < len(paths):
        for path in missing:
            yield Problem(
                "error", path, f"missing, but {len(paths) - len(missing)} other observations have one; expected one in "
                "all or in none (a PLY of 0 vertices says that nothing sounds)",
            )  # fmt: skip


# Contents


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
    for _, (count, more) in process_each(look, keys, workers=workers, label="checking", progress=progress):
        files += count
        found += more
    return Report(submission.named, True, len(keys), files, ordered(found))


def _look(
    submission: Submission, root: Path, bad: frozenset[str], points: bool, key: str
) -> tuple[int, tuple[Problem, ...]]:
    """(files read, findings) of one observation."""
    observation = Observation(root, key)
    problems, files = [], 0
    for frame in observation.test:
        path = submission.mask_path(key, frame.name)
        if path.relative_to(submission.root).as_posix() in bad:
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
