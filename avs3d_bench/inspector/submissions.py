"""The submissions whose masks a page lays beside the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import UsageError
from avs3d_bench.schema import SubmissionRecord

#: Keys 1 to 9 of the keyboard.
MOST = 9


@dataclass(frozen=True)
class ShownSubmission:
    """A submission on a page; can be pickled.

    Attributes:
        number: 1 … 9, its key on the keyboard and its place in addresses.
        name: the method's, as the page shows it.
        root: its folder.
    """

    number: int
    name: str
    root: Path

    def mask_path(self, frame: Frame) -> Path | None:
        """Where its mask of a test frame lies, in our layout or the released pipeline's; None where it has none."""
        if frame.split != "test":
            return None
        for folder in (layout.SUBMISSION_MASKS, *layout.RELEASED_MASKS):
            path = self.root / frame.observation.key / folder / f"{frame.name}.png"
            if path.is_file():
                return path
        return None


@dataclass(frozen=True)
class Agreement:
    """How a mask agrees with the truth in one frame: pixels hit, missed and falsely marked."""

    hit: int
    missed: int
    false: int

    @cached_property
    def iou(self) -> float | None:
        """Intersection over union of this frame alone; None where neither marks anything."""
        union = self.hit + self.missed + self.false
        return self.hit / union if union else None

    @classmethod
    def of(cls, truth: NDArray[np.bool_], mask: NDArray[np.bool_]) -> Agreement:
        """Of two masks (H, W)."""
        return cls(int((truth & mask).sum()), int((truth & ~mask).sum()), int((mask & ~truth).sum()))


def open_submissions(dataset: Dataset, folders: Sequence[Path]) -> tuple[ShownSubmission, ...]:
    """The submissions in these folders, in this order; two of one name are told apart by their folders' names.

    Raises:
        UsageError: if there are more than nine, one is no folder, or none of its folders is one of the dataset's.
        Avs3dError: if a submission.json is damaged.
    """
    if len(folders) > MOST:
        raise UsageError(f"{len(folders)} submissions: expected at most {MOST}, one for each key from 1 on")
    names = []
    for folder in folders:
        if not folder.is_dir():
            hint = "; unpack the archive first" if folder.is_file() else ""
            raise UsageError(f"{folder}: no such folder; expected a submission{hint}")
        if not any((folder / key).is_dir() for key in dataset.keys):
            raise UsageError(
                f"{folder}: no masks for {dataset.root}; expected {layout.SUBMISSION_JSON} and folders such as "
                f"{dataset.keys[0]}/{layout.SUBMISSION_MASKS}"
            )
        file = folder / layout.SUBMISSION_JSON
        record = media.read_record(file, SubmissionRecord) if file.exists() else None
        names.append(record.method if record else folder.resolve().name)
    return tuple(
        ShownSubmission(
            number, f"{name} ({folder.resolve().name})" if names.count(name) > 1 else name, folder.resolve()
        )
        for number, (name, folder) in enumerate(zip(names, folders, strict=True), start=1)
    )
