"""The names in a submission: missing, surplus, misplaced and special files. Only folders are opened."""

from __future__ import annotations

import stat
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from avs3d_bench.commands.report import Problem, printable
from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import PART_3, PARTS
from avs3d_bench.dataset import Dataset, Observation
from evaluators.reading.records import Submission
from evaluators.reading.tree import SubmissionTree

#: Files that are allowed at the top beside submission.json.
_COMPANIONS = ("README", "LICENCE", "LICENSE", "CITATION")
#: Entries of a folder tree that are looked at beyond those expected.
_SURPLUS = 100_000
#: What an observation adds to that at most: its test frames, its folders, its points.
_ENTRIES = layout.MAX_FRAMES // layout.TEST_EVERY + 6


def check_structure(submission: Submission, dataset: Dataset, observations: Sequence[Observation]) -> list[Problem]:
    """Missing, surplus and misplaced files, and what is no plain file; nothing is decoded.

    Args:
        submission: the opened submission.
        dataset: that the submission is for.
        observations: those of the dataset that are asked for; the rest is neither missed nor surplus.
    """
    problems = list(submission.problems)
    problems += _check_record(submission, dataset)
    problems += _check_folders(submission, observations)
    expected, categories = _expected(submission, observations), _categories(submission, observations)
    others = {*dataset.keys}.difference(observation.key for observation in observations)
    # Observations of part_3 may have as many files again.
    entries = sum(_ENTRIES * (2 if key.startswith(f"{PART_3}/") else 1) for key in others)
    tree = _walk(submission, observations, {**expected, **categories}, _SURPLUS + entries)
    problems += tree.problems
    misplaced = _wrong_parts(dataset, observations, tree.found)
    problems += misplaced
    apart = {problem.path for problem in misplaced}
    found = {path: kind for path, kind in tree.found.items() if path.split("/")[0] not in apart}
    asked = [observation for observation in observations if observation.place.part not in apart]
    problems += _check_entries(submission, dataset, asked, found, {**expected, **categories})
    missing = (path for path in expected if path not in found and path.split("/")[0] not in apart)
    problems += [Problem("error", path, "missing; expected a mask") for path in missing]
    problems += _check_points(submission, asked, found)
    problems += _check_categories(categories, found)
    return problems


def _wrong_parts(dataset: Dataset, observations: Sequence[Observation], found: Collection[str]) -> list[Problem]:
    """One line for each part of a submission that was made for the other kind of dataset.

    Parts 1 and 2 (one source) and part 3 are two kinds of benchmark: masks for one are no submission to
    the other.
    """
    parts = {key.split("/")[0] for key in dataset.keys}
    asked = sorted({observation.place.part for observation in observations})
    there = [part for part in PARTS if part in found]
    foreign = [part for part in there if part not in parts and (part == PART_3) not in _kinds(parts)]
    absent = [part for part in asked if (part == PART_3) not in _kinds(there)] if foreign else []
    problems = [
        Problem("error", part, f"masks of {part}, but the dataset has only {' and '.join(sorted(parts))}")
        for part in foreign
    ]
    for part in absent:
        some = [observation for observation in observations if observation.place.part == part]
        masks = sum(len(observation.test) for observation in some)
        plural = "" if len(some) == 1 else "s"
        problems.append(Problem("error", part, f"missing; expected {masks} masks of {len(some)} observation{plural}"))
    return problems


def _kinds(parts: Iterable[str]) -> set[bool]:
    """Whether part_3 observations, other observations or both are among the parts."""
    return {part == PART_3 for part in parts}


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


def _categories(submission: Submission, observations: Iterable[Observation]) -> dict[str, None]:
    """Paths of class ids, relative, which a submission may have."""
    if submission.layout == "official":
        return {}
    return {
        submission.categories_path(o.key, frame.name).relative_to(submission.root).as_posix(): None
        for o in observations
        if o.is_part_3
        for frame in o.test
    }


def _walk(
    submission: Submission, observations: Sequence[Observation], expected: Collection[str], surplus: int
) -> SubmissionTree:
    """Everything in the submission, up to ``surplus`` entries that are not expected.

    In the official layout the folder is the pipeline's own: only the masks' folders are looked at. In ours the
    parts come first, so that other contents of the top folder (a virtual environment, a .git) cannot hide them.
    """
    tree = SubmissionTree(submission.root, len(expected) + len(observations) * _ENTRIES + surplus, _SURPLUS)
    points = [f"{o.key}/{layout.SUBMISSION_POINTS}" for o in observations]
    if submission.layout == "official":
        folders = [f"{o.key}/{submission.masks}" for o in observations]
        whole = all(tree.walk(folder, "error") for folder in folders if (tree.root / folder).is_dir())
    else:
        for part in PARTS:
            tree.look_up(part)
        whole = all(tree.walk(part, "error") for part in PARTS if tree.found.get(part) == "folder")
        tree.left = _SURPLUS
        tree.walk("", "warning", skip=PARTS)
    if not whole:
        for path in (*expected, *points):
            if path not in tree.found:
                tree.look_up(path)
    return tree


# Judging what was found


def _check_entries(
    submission: Submission,
    dataset: Dataset,
    observations: Sequence[Observation],
    found: dict[str, str],
    expected: Collection[str],
) -> Iterator[Problem]:
    root = submission.root.resolve()
    asked = {o.key: o for o in observations}
    known = {problem.path for problem in submission.problems if problem.severity == "error"}
    for path, kind in sorted(found.items()):
        name = printable(path)
        if path in known:
            continue
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
            elif len(pieces) > 4 and key in asked and not _leads_to(inside, submission.masks):
                yield from _surplus_folder(asked[key], submission, name, inside)
        elif key in asked and not asked[key].is_part_3 and pieces[4] == layout.SUBMISSION_CATEGORIES:
            continue  # one line for the folder is enough
        elif key in asked:
            yield Problem("error", name, _surplus(asked[key], submission, inside))
        elif key not in dataset.keys:
            yield Problem("error", name, "surplus file; no such observation in the dataset")


def _surplus_folder(observation: Observation, submission: Submission, name: str, inside: str) -> Iterator[Problem]:
    categories = layout.SUBMISSION_CATEGORIES
    if inside == categories and submission.layout == "avs3d":
        if not observation.is_part_3:
            part = observation.place.part
            yield Problem("error", name, f"class ids belong to part_3; expected {submission.masks}/ only in {part}")
        return
    expected = f"{submission.masks}/ and {categories}/" if observation.is_part_3 else f"{submission.masks}/"
    yield Problem("error", name, f"surplus folder; expected {expected} only")


def _leads_to(inside: str, masks: str) -> bool:
    return f"{masks}/".startswith(f"{inside}/")


def _at_the_top(name: str, kind: str) -> Iterator[Problem]:
    if not (name.upper().startswith(_COMPANIONS) or name.lower().endswith(".md")):
        what = "folder" if kind == "folder" else "file"
        yield Problem("warning", name, f"not looked at: no {what} of a submission")


def _surplus(observation: Observation, submission: Submission, inside: str) -> str:
    folder, _, name = inside.rpartition("/")
    stem = name.removesuffix(".png")
    known = {submission.masks: "a mask", layout.SUBMISSION_CATEGORIES: "class ids"}
    if folder in known and name.endswith(".png") and observation.splits.get(stem) == "train":
        return f"{known[folder]} of a train frame; expected test frames only"
    if folder == submission.masks:
        return "surplus file; expected one mask per test frame, named as the frame (frame_000.png)"
    files = [f"{submission.masks}/frame_000.png", layout.SUBMISSION_POINTS]
    if observation.is_part_3:
        files.insert(1, f"{layout.SUBMISSION_CATEGORIES}/frame_000.png")
    return f"surplus file; expected {', '.join(files[:-1])} and {files[-1]} only"


def _link_fault(root: Path, path: Path) -> str | None:
    """The fault of a symbolic link; None for one to a file inside the submission."""
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
    submission: Submission, observations: Sequence[Observation], found: Collection[str]
) -> Iterator[Problem]:
    if submission.layout == "official":
        return
    paths = [f"{o.key}/{layout.SUBMISSION_POINTS}" for o in observations]
    missing = [path for path in paths if path not in found]
    if len(missing) < len(paths):
        for path in missing:
            yield Problem(
                "error", path, f"missing, but {len(paths) - len(missing)} other observations have one; expected one in "
                "all or in none (a PLY of 0 vertices means that nothing sounds)",
            )  # fmt: skip


def _check_categories(categories: Collection[str], found: Mapping[str, str]) -> Iterator[Problem]:
    """Class ids of some frames only: one line for a folder without any, else one for each frame."""
    there: dict[str, list[str]] = {}
    missing: dict[str, list[str]] = {}
    for path in categories:
        (there if path in found else missing).setdefault(path.rpartition("/")[0], []).append(path)
    count = sum(map(len, there.values()))
    if not count:
        return
    expected = "expected class ids of every test frame of part_3 or of none; 0 everywhere if there is nothing to mark"
    others = f"{count} other frame{' has' if count == 1 else 's have'} class ids"
    for folder, paths in missing.items():
        if folder in there:
            yield from (Problem("error", path, f"missing, but {others}; {expected}") for path in paths)
        elif found.get(folder, "folder") == "folder":  # Else it is named already, as a file or a link.
            yield Problem("error", folder, f"missing or empty, but {others}; {expected}")
