"""Writing a submission: one mask per test frame, points where the method has them, all of it or nothing.

    with SubmissionWriter("my-submission", Dataset("open-s34-o7"), method="mine 1.0") as writer:
        for observation in writer.observations:
            for frame in observation.test:
                writer.write_mask(frame, predict(frame.rgb(), frame.audio(), frame.pose))

Files go to a hidden folder beside the target, which takes the target's name when the block ends well and every test
frame has its mask. After an error or Ctrl-C nothing is left; after a kill the next writer clears the rest away.

In part_3, `write_mask` takes class ids as well: ``writer.write_mask(frame, mask, categories=ids)``.

Worker processes write through `SubmissionWriter.folder`, a small record that can be pickled: which files belong to the
submission is a matter of the disk alone, so nothing has to come back from them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ProvenanceRecord, Scalar, SubmissionRecord, describe
from avs3d_bench.contract.taxonomy import PART_3, class_ids
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import write_json
from avs3d_bench.formats.mask_values import NAMED, as_mask
from avs3d_bench.formats.media import png_header, write_ply_points, write_png_categories, write_png_mask
from avs3d_bench.formats.staging import staged_folder

#: `dataset_version` of a submission for data without dataset.json (the official release).
UNVERSIONED = "unversioned"
_OWN_FILE = re.compile(
    rf"part_[123]/[^/]+/[^/]+/[^/]+/(({layout.SUBMISSION_MASKS}|{layout.SUBMISSION_CATEGORIES})/frame_[0-9]+\.png|"
    r"points\.ply)"
)


@dataclass(frozen=True)
class Prediction:
    """A method's prediction for a frame, where it is more than a mask.

    Attributes:
        mask: (H, W) bool, or whole numbers 0 and 1, or 0 and 255.
        categories: (H, W) class ids (`avs3d_bench.contract.taxonomy.class_ids`), 0 for nothing; None for none. In
            part_3 only.

    Examples:
        >>> ids = np.zeros((48, 64), np.uint8)
        >>> ids[10:20, 30:50] = 4  # microwave
        >>> found = Prediction(mask=ids > 0, categories=ids)  # a method of part_3 returns one for each test frame
        >>> int(np.count_nonzero(found.mask)), np.unique(found.categories).tolist()
        (200, [0, 4])
    """

    mask: ArrayLike
    categories: ArrayLike | None = None


def frame_size(frame: Frame) -> tuple[int, int]:
    """(height, width) of a frame in pixels, from its picture's header: nothing is decoded."""
    folder = layout.INPUT if (frame.observation.path / layout.INPUT).is_dir() else layout.IMAGES
    header = png_header(frame.path(folder))
    return header.height, header.width


def as_categories(
    categories: ArrayLike, size: tuple[int, int], names: Mapping[str, int], where: str
) -> NDArray[np.uint8]:
    """A method's class ids as (H, W) uint8.

    Args:
        categories: whole numbers: 0 for nothing, else values of ``names``.
        size: (height, width) that is expected.
        names: category → class id.
        where: what messages name.

    Raises:
        Avs3dError: if the shape, the type or a value is another.
    """
    array = np.asarray(categories)
    if array.shape != size:
        raise Avs3dError(f"{where}: the class ids have shape {array.shape}, expected {size} (height, width)")
    if array.dtype.kind not in "iu":
        raise Avs3dError(f"{where}: the class ids are {array.dtype}, expected integers, 0 for nothing")
    low, high = int(array.min(initial=0)), int(array.max(initial=0))
    if low < 0 or high > len(names):
        known = ", ".join(f"{number} {name}" for name, number in names.items())
        raise Avs3dError(f"{where}: the class id {low if low < 0 else high} is unknown; expected 0, or one of {known}")
    return array.astype(np.uint8)


@dataclass(frozen=True)
class SubmissionFolder:
    """Where the files of a submission go while it is written; can be pickled and used from any process or thread.

    Attributes:
        root: the folder.
        keys: the observations that the submission covers.
    """

    root: Path
    keys: tuple[str, ...]

    def mask_path(self, key: str, frame: str) -> Path:
        """Where the mask of the frame named ``frame`` of the observation ``key`` lies."""
        return self.root / key / layout.SUBMISSION_MASKS / f"{frame}.png"

    def categories_path(self, key: str, frame: str) -> Path:
        """Where the class ids of the frame named ``frame`` of the observation ``key`` lie."""
        return self.root / key / layout.SUBMISSION_CATEGORIES / f"{frame}.png"

    def points_path(self, key: str) -> Path:
        """Where the points of the observation ``key`` lie."""
        return self.root / key / layout.SUBMISSION_POINTS

    def write_mask(self, frame: Frame, mask: ArrayLike, categories: ArrayLike | None = None) -> None:
        """Write the mask of a test frame; a second one for the same frame takes the place of the first.

        Args:
            frame: a test frame of one of the observations.
            mask: (H, W) of the frame's size: bool, or whole numbers 0 and 1, or 0 and 255.
            categories: in part_3, what is marked: (H, W) class ids of the observation's taxonomy
                (`ObservationRecord.class_ids`), 0 for nothing. Either every test frame of part_3 gets them, or none.

        Raises:
            UsageError: if the frame is no test frame, or of another observation, or ``categories`` are given outside of
                part_3.
            Avs3dError: if an array has another size, type or value, or the system refuses.
        """
        key = self._known(frame.observation)
        where = f"{key}/{frame.name}"
        if frame.split != "test":
            raise UsageError(f"{where}: a {frame.split or 'left-out'} frame; a submission holds masks of test frames")
        size = frame_size(frame)
        marked = as_mask(mask, size, where)
        if categories is not None:
            if not frame.observation.is_part_3:
                raise UsageError(f"{where}: class ids belong to {PART_3}; leave out categories")
            record = frame.observation.record
            named = as_categories(categories, size, record.class_ids if record else class_ids(), where)
            write_png_categories(self.categories_path(key, frame.name), named)
        else:
            self.categories_path(key, frame.name).unlink(missing_ok=True)  # of an earlier mask of this frame
        write_png_mask(self.mask_path(key, frame.name), marked)

    def write_points(self, observation: Observation, points: ArrayLike) -> None:
        """Write the 3D prediction of an observation.

        Args:
            observation: one of those covered. Either every one gets points or none does.
            points: (N, 3) metres, world coordinates (Y up); N = 0 means that nothing was found.

        Raises:
            UsageError: if the observation is not covered.
            Avs3dError: if the array has another form, a number is not finite, there are more than
                `layout.MAX_POINTS`, or the system refuses.
        """
        key = self._known(observation)
        try:
            with np.errstate(over="ignore"):
                cloud = np.asarray(points).astype(np.float32)
        except (TypeError, ValueError) as error:
            raise Avs3dError(f"{key}: the points are no numbers ({error}); expected (N, 3) metres") from None
        if cloud.ndim != 2 or cloud.shape[1] != 3:
            raise Avs3dError(f"{key}: the points have shape {cloud.shape}, expected (N, 3) metres")
        if len(cloud) > layout.MAX_POINTS:
            raise Avs3dError(f"{key}: {len(cloud):,} points, expected at most {layout.MAX_POINTS:,}; thin them out")
        if not np.isfinite(cloud).all():
            raise Avs3dError(f"{key}: the points hold NaN or infinite numbers, expected metres; drop those points")
        write_ply_points(self.points_path(key), cloud)

    def _known(self, observation: Observation) -> str:
        if observation.key not in self.keys:
            raise UsageError(f"{observation.key}: not among the {len(self.keys)} observations of this submission")
        return observation.key


class SubmissionWriter:
    """A context in which a submission is written as a whole; see the module's docstring for its use.

    Attributes:
        path: the submission's folder; it appears when the block ends.
        dataset: what the submission is for.
        observations: those it covers, sorted by key.
        record: what submission.json will hold.

    Examples:
        >>> with SubmissionWriter("boxes", Dataset("data/demo"), method="boxes 1.0", overwrite=True) as writer:
        ...     for observation in writer.observations:
        ...         for frame in observation.test:
        ...             mask = np.zeros(frame.rgb().shape[:2], bool)
        ...             mask[16:48, 16:48] = True
        ...             writer.write_mask(frame, mask)
        >>> writer.record.method, len(writer.observations)
        ('boxes 1.0', 2)
    """

    def __init__(
        self,
        path: str | Path,
        dataset: Dataset | str | Path,
        *,
        method: str,
        url: str | None = None,
        authors: str | tuple[str, ...] | None = None,
        notes: str | None = None,
        truth: str | None = None,
        provenance: ProvenanceRecord | None = None,
        only: Iterable[str] = (),
        overwrite: bool = False,
    ) -> None:
        """Describe the submission; nothing is written yet.

        Args:
            path: the folder to make.
            dataset: the dataset, or its root.
            method: the method's name, as tables will show it.
            url: where the method is described.
            authors: one text or several.
            notes: settings and other remarks for readers.
            truth: the ground truth that the masks are made from, None for none; leaderboards do not rank the former.
            provenance: the software that makes the masks, where `avs3d_bench.runtime.provenance` knows it.
            only: shell patterns of observation keys; a submission of a part is scored with the same `--only`.
            overwrite: replace an existing submission.

        Raises:
            UsageError: if no observation matches, or a text is not what submission.json holds.
        """
        self.path = Path(path)
        self.dataset = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
        only = tuple(only)
        self.observations = self.dataset.select(*only)
        if not self.observations:
            what = f"no observation matches {' '.join(only)}" if only else "no observation to write masks for"
            raise UsageError(f"{self.dataset.root}: {what}; expected some of {', '.join(self.dataset.keys[:3])}")
        version = self.dataset.version or UNVERSIONED
        try:
            self.record = SubmissionRecord(
                method=method,
                dataset=self.dataset.name,
                dataset_version=version,
                url=url,
                authors=authors,
                notes=notes,
                truth=truth,
                provenance=provenance,
            )
        except ValidationError as error:
            raise UsageError(f"{layout.SUBMISSION_JSON}: {describe(error)[0]}") from None
        self._overwrite = overwrite
        self._stack = ExitStack()
        self._folder: SubmissionFolder | None = None

    @property
    def folder(self) -> SubmissionFolder:
        """Where files go until the block ends; hand it to worker processes.

        Raises:
            UsageError: outside of the ``with`` block.
        """
        if self._folder is None:
            raise UsageError(f"{self.path}: the writer is not open; use `with SubmissionWriter(…) as writer:`")
        return self._folder

    def write_mask(self, frame: Frame, mask: ArrayLike, categories: ArrayLike | None = None) -> None:
        """See `SubmissionFolder.write_mask`."""
        self.folder.write_mask(frame, mask, categories)

    def write_points(self, observation: Observation, points: ArrayLike) -> None:
        """See `SubmissionFolder.write_points`."""
        self.folder.write_points(observation, points)

    def set_runtime(self, runtime: float | str | dict[str, Scalar]) -> None:
        """Record the cost of the method in submission.json: seconds, a text, or named figures.

        Raises:
            UsageError: if it is none of these, or a figure is not finite.
        """
        try:
            self.record = SubmissionRecord(**{**self.record.model_dump(), "runtime": runtime})
        except ValidationError as error:
            raise UsageError(f"{layout.SUBMISSION_JSON}: {describe(error)[0]}") from None

    def missing(self) -> tuple[Frame, ...]:
        """The test frames that have no mask yet, in order."""
        folder = self.folder
        frames = (frame for observation in self.observations for frame in observation.test)
        return tuple(f for f in frames if not folder.mask_path(f.observation.key, f.name).exists())

    def __enter__(self) -> Self:
        root = self._stack.enter_context(staged_folder(self.path, self._check_target))
        self._folder = SubmissionFolder(root, tuple(observation.key for observation in self.observations))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        stack, self._stack = self._stack, ExitStack()
        try:
            if kind is not None:
                stack.__exit__(kind, error, trace)
                return
            with stack:
                self._finish()
        finally:
            self._folder = None

    def _finish(self) -> None:
        """Raise an error for an incomplete submission; else write submission.json, the last file."""
        missing = self.missing()
        if missing:
            total = sum(len(observation.test) for observation in self.observations)
            names = _some([f"{frame.observation.key}/{frame.name}" for frame in missing])
            raise Avs3dError(f"{self.path}: not written: {len(missing)} of {total} masks are missing: {names}")
        without = [o.key for o in self.observations if not self.folder.points_path(o.key).exists()]
        if 0 < len(without) < len(self.observations):
            raise Avs3dError(
                f"{self.path}: not written: no points for {_some(without)}; expected points for every observation or "
                "none (an empty cloud says that nothing was found)"
            )
        scenes = [frame for o in self.observations if o.is_part_3 for frame in o.test]
        bare = [f for f in scenes if not self.folder.categories_path(f.observation.key, f.name).exists()]
        if 0 < len(bare) < len(scenes):
            names = _some([f"{frame.observation.key}/{frame.name}" for frame in bare])
            raise Avs3dError(
                f"{self.path}: not written: no class ids for {names}; expected categories for every test frame of "
                f"{PART_3} or for none"
            )
        # Only a worker that was killed in the middle of a file can have left one.
        for leftover in self.folder.root.rglob(".*.tmp"):
            leftover.unlink(missing_ok=True)
        write_json(self.folder.root / layout.SUBMISSION_JSON, self.record)

    def _check_target(self, final: Path) -> None:
        """Raise an error for a target that no writer has made.

        Raises:
            UsageError: saying why.
        """
        root = self.dataset.root.resolve()
        if final.is_relative_to(root) or root.is_relative_to(final):
            how = "inside of" if final.is_relative_to(root) else "around"
            raise UsageError(f"{self.path}: lies {how} the dataset {self.dataset.root}; choose another folder")
        if not final.exists():
            return
        if not final.is_dir():
            raise UsageError(f"{self.path}: found a file, expected a folder; choose another name")
        if not any(final.iterdir()):
            return
        if not (final / layout.SUBMISSION_JSON).is_file():
            raise UsageError(f"{self.path}: not empty and no submission; choose another folder")
        if not self._overwrite:
            raise UsageError(
                f"{self.path}: the folder holds a submission; choose another folder, or overwrite it (--overwrite)"
            )
        # The old folder is deleted: only one that a writer has made.
        files = (path.relative_to(final).as_posix() for path in sorted(final.rglob("*")) if not path.is_dir())
        foreign = next((f for f in files if f != layout.SUBMISSION_JSON and not _OWN_FILE.fullmatch(f)), None)
        if foreign is not None:
            raise UsageError(f"{self.path}: cannot overwrite: {foreign} is no part of a submission; move it away")


def _some(names: list[str]) -> str:
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")
