"""The submissions whose masks a page shows together with the truth."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.errors import UsageError
from avs3d_bench.formats.files import read_record
from avs3d_bench.formats.predictions import MAX_JSON_BYTES, check_file, read_mask
from avs3d_bench.inspector.links import check_link
from avs3d_bench.submission import frame_size

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
            # Also names that are no plain files: reading them reports that.
            if os.path.lexists(path):
                return path
        return None

    def mask(self, frame: Frame) -> NDArray[np.bool_] | None:
        """Its mask (H, W) of a frame, within the limits of `avs3d check`; None where it has none.

        Raises:
            Avs3dError: if the file leads out of the submission, is no plain file, is damaged, or has another size than
                the frame; nothing of another size is decoded.
        """
        path = self.mask_path(frame)
        if path is None:
            return None
        check_link(path, self.root, "the submission")
        height, width = frame_size(frame)
        released = path.parent.name != layout.SUBMISSION_MASKS
        return np.asarray(read_mask(path, width, height, released=released) != 0)


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
    """The submissions in these folders, in this order; two with one name are distinguished by their folders' names.

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
        masks = (layout.SUBMISSION_MASKS, *layout.RELEASED_MASKS)
        found = [key for key in dataset.keys if (folder / key).is_dir()]
        # A dataset into which the released pipeline wrote its masks is a submission as well.
        if found and not any((folder / key / name).is_dir() for key in found for name in masks):
            if any((folder / key / layout.SEMANTIC_MASKS).is_dir() for key in found):
                raise UsageError(f"{folder}: a dataset, expected a submission (a folder of predicted masks)")
            found = []
        if not found:
            raise UsageError(
                f"{folder}: no masks for {dataset.root}; expected {layout.SUBMISSION_JSON} and folders such as "
                f"{dataset.keys[0]}/{layout.SUBMISSION_MASKS}"
            )
        file = folder / layout.SUBMISSION_JSON
        record = _read_about(file) if os.path.lexists(file) else None
        names.append(record.method if record else folder.resolve().name)
    return tuple(
        ShownSubmission(
            number, f"{name} ({folder.resolve().name})" if names.count(name) > 1 else name, folder.resolve()
        )
        for number, (name, folder) in enumerate(zip(names, folders, strict=True), start=1)
    )


def _read_about(file: Path) -> SubmissionRecord:
    check_link(file, file.parent, "the submission")
    check_file(file, MAX_JSON_BYTES)
    return read_record(file, SubmissionRecord)
