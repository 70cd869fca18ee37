"""Records of the evaluator: a submission on disk, the figures of a frame, the result of an evaluation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from heapq import nsmallest
from pathlib import Path
from typing import Literal

from avs3d_bench.commands.report import Problem, Report
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.contract.scores import ObservationScores, Scores, SiblingScores
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from evaluators.metrics.masks import FrameCounts

Layout = Literal["avs3d", "official"]


@dataclass(frozen=True)
class Submission:
    """Where a submission's files lie.

    Attributes:
        root: its folder; below it one folder per observation, named by its key.
        layout: ``avs3d`` (`masks/`, `points.ply`) or ``official`` (the folders the released pipeline writes).
        masks: the folder of masks below an observation's folder.
        record: submission.json; made up from the folder's name where there is none, or none that can be read.
        source: the folder or archive as the user named it, where that is not ``root``.
        problems: found when the submission was opened.
    """

    root: Path
    layout: Layout
    masks: str
    record: SubmissionRecord
    source: Path | None = None
    problems: tuple[Problem, ...] = ()

    @property
    def named(self) -> Path:
        """Its name in messages."""
        return self.source or self.root

    def mask_path(self, key: str, frame: str) -> Path:
        """Where the mask of the frame named ``frame`` (``frame_000``) of the observation ``key`` lies."""
        return self.root / key / self.masks / f"{frame}.png"

    def categories_path(self, key: str, frame: str) -> Path:
        """Where the class ids of a frame of the observation ``key`` lie, if there are any; in part_3 only."""
        return self.root / key / layout.SUBMISSION_CATEGORIES / f"{frame}.png"

    def points_path(self, key: str) -> Path:
        """Where the 3D prediction of the observation ``key`` lies, if there is one."""
        return self.root / key / layout.SUBMISSION_POINTS


#: Frames of one observation that a report shows at most, of each kind.
SHOWN_PER_OBSERVATION = 2


@dataclass(frozen=True)
class FrameScore:
    """One frame, for the picture part of a report.

    Attributes:
        key: the observation's.
        name: e.g. ``frame_008``.
        visible: whether the sounding object is visible in it.
        iou: of prediction and truth; None where the object is not visible.
        marked: marked share of the image.
        twins_marked: how many silent twins are marked.
        wrong: share of the image that is marked and should not be, or the other way round.
    """

    key: str
    name: str
    visible: bool
    iou: float | None
    marked: float
    twins_marked: int = 0
    wrong: float = 0.0

    @property
    def badness(self) -> float:
        """0 (perfect) to 1: 1 − IoU where the object is visible; elsewhere 0, or 0.5 and more with a mark."""
        if self.iou is not None:
            return 1.0 - self.iou
        return 0.5 + 0.5 * self.marked if self.marked else 0.0

    @classmethod
    def of(cls, key: str, name: str, counts: FrameCounts, twins_marked: int = 0) -> FrameScore:
        """From the counts of the frame."""
        iou = counts.overlap / counts.union if counts.truth else None
        wrong = (counts.union - counts.overlap) / counts.pixels
        return cls(key, name, counts.truth > 0, iou, counts.predicted / counts.pixels, twins_marked, wrong)


def worst_frames(frames: Iterable[FrameScore], count: int = SHOWN_PER_OBSERVATION) -> tuple[FrameScore, ...]:
    """The frames with the largest badness; of equal ones those with more wrong pixels."""
    bad = (frame for frame in frames if frame.badness > 0)
    return tuple(nsmallest(count, bad, key=lambda f: (-f.badness, -f.wrong, f.key, f.name)))


def best_frames(frames: Iterable[FrameScore], count: int = SHOWN_PER_OBSERVATION) -> tuple[FrameScore, ...]:
    """The frames with the object in sight and the highest IoU above 0; ties by name."""
    seen = (frame for frame in frames if frame.iou)
    return tuple(nsmallest(count, seen, key=lambda f: (f.badness, f.key, f.name)))


@dataclass(frozen=True)
class FrameTally:
    """The counts of one frame of the submission, from which its row in the table of frames is made.

    Attributes:
        name: e.g. ``frame_008``.
        counts: pixels.
        boundary_f: None where nothing is to be marked, and in part_3.
        twins: silent twins in view and how many of them are marked; None where nothing is known about twins.
        pairs: siblings whose truth differs, and how many of these pairs are right; None but in part_3.
    """

    name: str
    counts: FrameCounts
    boundary_f: float | None = None
    twins: tuple[int, int] | None = None
    pairs: tuple[int, int] | None = None


@dataclass(frozen=True)
class SiblingFrame:
    """A frame of a group of part_3 that a report shows for all siblings side by side.

    Attributes:
        group: key of the group.
        keys: of the siblings.
        name: of the frame.
        pairs: how many pairs of siblings have truths that differ in it.
        right: how many of these pairs are right.
    """

    group: str
    keys: tuple[str, ...]
    name: str
    pairs: int
    right: int


@dataclass(frozen=True)
class ScoredObservation:
    """The scores of one observation.

    Attributes:
        scores: of the submission; None if a file of it is bad.
        references: name of the reference → its scores; without the deaf ones where the instances are not known.
        worst: its worst frames.
        best: its best frames.
        problems: errors in the submission's files.
        warnings: what is odd about them.
        files: how many files of the submission were read.
        frames: the counts of its test frames.
    """

    scores: ObservationScores | None
    references: Mapping[str, ObservationScores] = field(default_factory=dict)
    worst: tuple[FrameScore, ...] = ()
    best: tuple[FrameScore, ...] = ()
    problems: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()
    files: int = 0
    frames: tuple[FrameTally, ...] = ()


@dataclass(frozen=True)
class ObservationFigures:
    """What the counts of one observation come to.

    Attributes:
        scores: of the submission.
        references: name of the reference → its scores.
        frames: the test frames, for the pictures of a report.
        tallies: their counts.
    """

    scores: ObservationScores
    references: Mapping[str, ObservationScores]
    frames: Sequence[FrameScore]
    tallies: tuple[FrameTally, ...]


@dataclass(frozen=True)
class GroupFigures:
    """What the counts of observations that were scored together come to.

    Attributes:
        observations: one for each, in their order.
        siblings: the pairs; None but in part_3.
        references: name of the reference → its pairs.
        shown: a frame for the report; None if the truths of no pair differ.
    """

    observations: Sequence[ObservationFigures]
    siblings: SiblingScores | None = None
    references: Mapping[str, SiblingScores] = field(default_factory=dict)
    shown: SiblingFrame | None = None


@dataclass(frozen=True)
class GroupOutcome:
    """The scores of observations that were scored together: the siblings of a group of part_3, else one alone.

    Attributes:
        outcomes: of each observation, by key.
        siblings: the pairs; None but in part_3, and if a file of the submission is bad.
        references: name of the reference → its pairs.
        shown: a frame for the report; None if the truths of no pair differ.
    """

    outcomes: Mapping[str, ScoredObservation]
    siblings: SiblingScores | None = None
    references: Mapping[str, SiblingScores] = field(default_factory=dict)
    shown: SiblingFrame | None = None


def observation_scores(observation: Observation, frames: int, **protocols: object) -> ObservationScores:
    """The record of scores of an observation.

    Args:
        observation: that was scored.
        frames: number of its test frames.
        protocols: fields of `ObservationScores` that depend on the protocol.
    """
    place = observation.place
    about = {"key": observation.key, "part": place.part, "scan": place.scan, "room": place.room}
    return ObservationScores.model_validate(about | {"category": observation.category, "frames": frames} | protocols)


@dataclass(frozen=True, repr=False)
class Evaluation:
    """The outcome of scoring.

    Attributes:
        scores: the record that `--json` writes.
        worst: frames with the largest badness, worst first, at most two per observation.
        best: frames with the object visible and the highest IoU, best first, at most two per observation, none of the
            worst.
        groups: a frame of each group of part_3 in which truths differ, the groups with the most wrong pairs first.
        warnings: what is odd about the submission's files, though it can be scored.
        frames: key of an observation → the counts of its test frames.

    Examples:
        >>> evaluation = evaluate("data/demo-submissions/centre-box", "data/demo", protocols="strict")
        >>> evaluation
        Evaluation('centre-box' on demo 1, 2 observations: strict IoU 0.000, strict F 0.000)
        >>> evaluation.scores.parts["part_1"].strict.FP_rate
        1.0
        >>> worst = evaluation.worst[0]
        >>> worst.key, worst.name, worst.iou
        ('part_1/apartment_1/bathroom/1', 'frame_000', 0.0)
    """

    scores: Scores
    worst: tuple[FrameScore, ...] = ()
    best: tuple[FrameScore, ...] = ()
    groups: tuple[SiblingFrame, ...] = ()
    warnings: tuple[Problem, ...] = ()
    frames: Mapping[str, tuple[FrameTally, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        count = len(self.warnings)
        warnings = f"; {count} warning{'' if count == 1 else 's'}" if count else ""
        return f"Evaluation({self.scores.headline()}{warnings})"

    def __str__(self) -> str:
        return str(self.scores)

    def _repr_html_(self) -> str:
        return self.scores._repr_html_()


class InvalidSubmission(Avs3dError):  # noqa: N818 - the word that users know from the exit status
    """Something is wrong with a submission's files: there is no score. `report` names every one.

    Examples:
        >>> import shutil
        >>> from pathlib import Path
        >>> broken = Path(shutil.copytree("data/demo-submissions/oracle", "broken", dirs_exist_ok=True))
        >>> (broken / "part_1/apartment_1/bathroom/1/masks/frame_008.png").unlink(missing_ok=True)
        >>> try:
        ...     evaluate("broken", "data/demo")
        ... except InvalidSubmission as error:
        ...     print([problem.path for problem in error.report.problems])
        ['part_1/apartment_1/bathroom/1/masks/frame_008.png']
    """

    def __init__(self, report: Report) -> None:
        self.report = report
        first = next(problem for problem in report.problems if problem.severity == "error")
        count = report.count("error")
        more = f" (and {count - 1} more)" if count > 1 else ""
        super().__init__(f"{report.root}: {first.path}: {first.message}{more}")
