"""Problems of a submission, file by file, found before it is scored.

`check_structure` (in `evaluators.reading.structure`) looks at names, kinds and links and opens nothing but folders;
`check_contents` decodes what is left. Scoring runs the first and does the second while it decodes anyway.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from avs3d_bench.commands.report import Problem, Report, ordered
from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.media import png_header
from avs3d_bench.runtime.parallel import advance, process_each
from evaluators.reading.reader import Reader, problem_of
from evaluators.reading.records import InvalidSubmission, Submission
from evaluators.reading.structure import check_structure
from evaluators.reading.submission import open_submission

__all__ = [
    "InvalidSubmission",
    "check",
    "check_contents",
    "check_structure",
    "check_submission",
    "has_categories",
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

    Examples:
        >>> report = check_submission("data/demo-submissions/oracle", "data/demo", workers=1)
        >>> report.valid, report.files
        (True, 5)
        >>> from pathlib import Path
        >>> import shutil
        >>> broken = Path(shutil.copytree("data/demo-submissions/oracle", "broken", dirs_exist_ok=True))
        >>> (broken / "part_1/apartment_1/bathroom/1/masks/frame_008.png").unlink(missing_ok=True)
        >>> for problem in check_submission("broken", "data/demo", workers=1).problems:
        ...     print(problem.path, problem.message)
        part_1/apartment_1/bathroom/1/masks/frame_008.png missing; expected a mask
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


def has_points(submission: Submission, observations: Iterable[Observation]) -> bool:
    """Whether the submission holds any 3D prediction; the released pipeline never writes one."""
    if submission.layout == "official":
        return False
    return any(os.path.lexists(submission.points_path(observation.key)) for observation in observations)


def has_categories(submission: Submission, observations: Iterable[Observation]) -> bool:
    """Whether the submission holds class ids (categories/) of an observation of part_3."""
    if submission.layout == "official":
        return False
    folders = (submission.root / o.key / layout.SUBMISSION_CATEGORIES for o in observations if o.is_part_3)
    return any(folder.is_dir() and any(folder.iterdir()) for folder in folders)


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
    points, categories = has_points(submission, observations), has_categories(submission, observations)
    look = partial(_look, submission, bad, points, categories)
    files = int(submission.layout == "avs3d")
    found = list(problems)
    sizes = [len(observation.test) for observation in observations]
    looked = process_each(look, observations, workers=workers, label="checking frames", progress=progress, sizes=sizes)
    for _, (count, more) in looked:
        files += count
        found += more
    return Report(submission.named, True, len(observations), files, ordered(found))


def _look(
    submission: Submission, bad: frozenset[str], points: bool, categories: bool, observation: Observation
) -> tuple[int, tuple[Problem, ...]]:
    """(files read, findings) of one observation."""
    key = observation.key
    reader = Reader(submission, key)
    # Participants of a competition have no masks of test frames; they have the size of the pictures.
    first = observation.where(layout.SEMANTIC_MASKS) / f"{observation.test[0].name}.png" if observation.test else None
    sized = layout.SEMANTIC_MASKS if first is not None and first.exists() else layout.INPUT
    classes = _class_count(observation) if categories and observation.is_part_3 else None

    def sound(path: Path) -> bool:
        """Whether nothing is known against a file, a folder behind a link, or a part that is missing as a whole."""
        name = path.relative_to(submission.root)
        return bad.isdisjoint((name.as_posix(), name.parent.as_posix(), name.parts[0]))

    for number, frame in enumerate(observation.test):
        advance(number, len(observation.test))
        header = png_header(frame.path(sized))
        size = header.height, header.width
        mask = reader.mask(frame.name, size) if sound(submission.mask_path(key, frame.name)) else None
        if classes is not None and sound(submission.categories_path(key, frame.name)):
            reader.categories(frame.name, size, classes, mask)
    if points and sound(submission.points_path(key)):
        reader.points()
    return reader.files, (*reader.problems, *reader.warnings)


def _class_count(observation: Observation) -> int:
    """The highest class id of an observation of part_3."""
    record = observation.record
    return len(record.class_ids if record else class_ids())
