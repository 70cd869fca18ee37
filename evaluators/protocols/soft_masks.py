"""Average precision of soft masks, beside the figures of a protocol: how well probabilities rank the pixels.

Soft masks are no part of a submission: ``FOLDER/KEY/masks/frame_000.png`` for each test frame, grey levels as
probabilities (255, or 65535 with 16 bits, is 1), as ``avs3d baseline listener --soft-masks`` writes them. An
observation's figure is the mean over its test frames that show what sounds, a part's the mean over observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from avs3d_bench.contract.scores import Scores, SoftScores, SoftSummary
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.parallel import process_each
from avs3d_bench.submission import SubmissionFolder
from evaluators.metrics.masks import mean
from evaluators.metrics.soft import average_precision
from evaluators.reading.grey_pictures import read_probability
from evaluators.statistics.bootstrap import interval


def soft_mask_path(folder: Path, frame: Frame) -> Path:
    """Where the soft mask of a test frame lies in a folder of soft masks."""
    return SubmissionFolder(folder, ()).mask_path(frame.observation.key, frame.name)


def soft_scores(
    scores: Scores, dataset: Dataset, folder: Path, *, workers: int | None = 1, progress: bool = False
) -> SoftScores:
    """The average precision of soft masks for the observations that were scored.

    Args:
        scores: of the submission; its observations are taken.
        dataset: the truth.
        folder: of the soft masks.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if there is no such folder.
        Avs3dError: if a soft mask is missing, damaged, coloured, or of another size than its frame.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; expected soft masks, KEY/masks/frame_000.png")
    keys = [row.key for row in scores.observations]
    frames = [frame for key in keys for frame in dataset[key].test]
    missing = [path for frame in frames if not (path := soft_mask_path(folder, frame)).is_file()]
    if missing:
        raise Avs3dError(f"{folder}: {len(missing)} of {len(frames)} soft masks are missing, the first: {missing[0]}")
    work = partial(_observation, dataset, folder)
    found = dict(process_each(work, keys, workers=workers, label="soft masks", progress=progress))
    parts = {part: [row for row in scores.observations if row.part == part] for part in PARTS}
    groups = {part: rows for part, rows in parts.items() if rows} | {"overall": scores.observations}
    means = {
        name: _summary([(value, row.scan) for row in rows if (value := found[row.key]) is not None])
        for name, rows in groups.items()
    }
    return SoftScores.model_validate({"overall": means.pop("overall"), "parts": means, "observations": found})


def _observation(dataset: Dataset, folder: Path, key: str) -> float | None:
    """The mean over the test frames that show what sounds; None without any."""
    values = []
    for frame in dataset[key].test:
        path = soft_mask_path(folder, frame)
        truth, probability = frame.mask(), read_probability(path)
        if probability.shape != truth.shape:
            size, wanted = (f"{shape[1]}×{shape[0]}" for shape in (probability.shape, truth.shape))
            raise Avs3dError(f"{path}: {size} pixels, expected {wanted}, those of its frame")
        if truth.any():
            values.append(average_precision(truth, probability))
    return mean(values)


def _summary(found: Sequence[tuple[float, str]]) -> SoftSummary:
    """The mean of values in homes."""
    values, homes = [value for value, _ in found], [home for _, home in found]
    return SoftSummary(AP=mean(values), interval=interval(values, homes=homes) if values else None, count=len(values))
