"""Reading the files of one observation of a submission, while noting what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import sha256_bytes, sha256_file
from avs3d_bench.formats.predictions import read_categories, read_mask, read_points
from evaluators.reading.records import Submission

_Found = TypeVar("_Found")


def problem_of(submission: Submission, path: Path, error: Avs3dError) -> Problem:
    """An error about one of the submission's files as a finding."""
    return Problem("error", path.relative_to(submission.root).as_posix(), str(error).removeprefix(f"{path}: "))


@dataclass
class Reader:
    """Reads the files of one observation of a submission, each once.

    Attributes:
        submission: where they lie.
        key: the observation's.
        problems: errors in the files that were read.
        files: how many were read.
        digests: path relative to the submission → sha256, of the files that were read.
        unmarked: frame → pixels that have a category in categories/ and are not marked in masks/.
    """

    submission: Submission
    key: str
    problems: list[Problem] = field(default_factory=list)
    files: int = 0
    digests: dict[str, str] = field(default_factory=dict)
    unmarked: dict[str, int] = field(default_factory=dict)

    def mask(self, frame: str, size: tuple[int, int]) -> NDArray[np.uint8] | None:
        """The mask of a frame of ``size`` (height, width), 0 and 255; None if the file is bad."""
        height, width = size
        released = self.submission.layout == "official"
        path = self.submission.mask_path(self.key, frame)
        return self._read(path, lambda: read_mask(path, width, height, released=released, seen=self._note(path)))

    def categories(
        self, frame: str, size: tuple[int, int], classes: int, mask: NDArray[np.uint8] | None
    ) -> NDArray[np.uint8] | None:
        """The class ids of a frame, at most ``classes``; None if the file is bad.

        Args:
            frame: its name.
            size: (height, width).
            classes: the highest class id.
            mask: of the frame, to count what it does not mark; None: not counted.
        """
        height, width = size
        path = self.submission.categories_path(self.key, frame)
        found = self._read(path, lambda: read_categories(path, width, height, classes, seen=self._note(path)))
        if found is not None and mask is not None:
            outside = cv2.countNonZero(found) - cv2.countNonZero(cv2.min(found, mask))
            if outside:
                self.unmarked[frame] = outside
        return found

    def points(self) -> NDArray[np.float32] | None:
        """The 3D prediction, (N, 3) metres; None if the file is bad."""
        path = self.submission.points_path(self.key)
        cloud = self._read(path, lambda: read_points(path))
        if cloud is not None:
            self.digests[self._name(path)] = sha256_file(path)
        return cloud

    @property
    def warnings(self) -> tuple[Problem, ...]:
        """Says so if categories/ marks what masks/ does not: one finding for the observation."""
        if not self.unmarked:
            return ()
        first, *more = self.unmarked
        frames = f"{1 + len(more)} frames ({first}, …)" if more else first
        message = f"{sum(self.unmarked.values()):,} pixels in {frames} have a category but are not marked in masks/"
        return (Problem("warning", f"{self.key}/{layout.SUBMISSION_CATEGORIES}", message),)

    def _name(self, path: Path) -> str:
        return path.relative_to(self.submission.root).as_posix()

    def _note(self, path: Path) -> Callable[[bytes], None]:
        """A function that keeps the digest of the bytes of a file."""

        def note(data: bytes) -> None:
            self.digests[self._name(path)] = sha256_bytes(data)

        return note

    def _read(self, path: Path, read: Callable[[], _Found]) -> _Found | None:
        self.files += 1
        try:
            return read()
        except Avs3dError as error:
            self.problems.append(problem_of(self.submission, path, error))
            return None
