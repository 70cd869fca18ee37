"""Scoring a submission, from its folder to the record of scores: the story of this package.

    open the submission → check names, sizes, headers → decode and count, observation by observation, in parallel
    → any bad file: no score, every bad file named → else means, intervals, reference rows

Each mask is decoded once: its contents are checked while it is scored. Results do not depend on the number of
processes: every observation is computed whole in one of them, and means are exactly rounded sums.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, cast
from typing import Protocol as TypingProtocol

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.report import Report, ordered
from avs3d_bench.contract.schema import ProvenanceRecord
from avs3d_bench.contract.scores import PROTOCOL_PARTS, PROTOCOLS, Protocol
from avs3d_bench.dataset import Dataset, Frame, Observation, by_pictures, sibling_frames
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.method import Method
from avs3d_bench.runtime.parallel import advance, process_each
from avs3d_bench.runtime.provenance import provenance
from avs3d_bench.sealing.seal import open_sealed
from evaluators.protocols.conditions import with_conditions
from evaluators.protocols.sibling_counts import SiblingCounts
from evaluators.protocols.soft_masks import soft_scores
from evaluators.protocols.source_counts import SourceCounts
from evaluators.reading.checks import check_contents, check_structure, has_categories, has_points, select
from evaluators.reading.in_memory import Predictions, written
from evaluators.reading.origin import observation_digests
from evaluators.reading.reader import Reader
from evaluators.reading.records import (
    Evaluation,
    FrameScore,
    GroupFigures,
    GroupOutcome,
    InvalidSubmission,
    ScoredObservation,
    Submission,
    best_frames,
    worst_frames,
)
from evaluators.reading.submission import open_submission
from evaluators.summary import score_record

#: Frames that the report shows, of each kind.
SHOWN_FRAMES = 12
#: Most processes, as ``--workers`` takes them.
MOST_WORKERS = 256


@dataclass(frozen=True)
class ScoringJob:
    """Observations that one process scores at a time: one, or the siblings of a group of part_3.

    Attributes:
        group: key of the group; of an observation that is alone its own.
        keys: of the observations.
        frames: number of their test frames.
    """

    group: str
    keys: tuple[str, ...]
    frames: int


def evaluate(
    submission: str | Path | Predictions | Method,
    dataset: str | Path | Dataset,
    truth: str | Path | None = None,
    *,
    protocols: Protocol | Literal["all"] | Sequence[Protocol] | None = None,
    only: str | Iterable[str] = (),
    aisrm: bool | None = None,
    workers: int | None = 1,
    progress: bool = False,
) -> Evaluation:
    """Score a submission, or predictions in memory, against a dataset.

    Args:
        submission: path of a folder or a .zip; or predictions: observation key → masks of its test frames, (T, H, W) in
            their order or frame name → (H, W), bool or integers 0 and 1 or 0 and 255, or `Prediction` records; or a
            `Method`, which is run. These are written to a temporary folder and checked as every submission is.
        dataset: its root, or the opened dataset; ours or the official release.
        truth: of a sealed test, the folder with its truth, which is checked against the commitments.
        protocols: which to compute: ``official``, ``strict``, ``listen`` or several of these; None or ``all``: those
            that fit the observations (see `fitting`).
        only: shell patterns of observation keys; the others are left out.
        aisrm: which folder of the released pipeline's output to read; see `open_submission`.
        workers: processes, 1 to 256; None: one per core.
        progress: show a bar on stderr.

    Returns:
        The evaluation; its ``scores`` are what `avs3d-eval --json` writes, and ``scores.to_frame()`` is their table.

    Raises:
        InvalidSubmission: if anything is wrong with a file of the submission; its report names every one.
        UsageError: if a path is neither submission nor dataset, an argument has another type or value than expected,
            the truth of a sealed test is not given, no observation matches ``only``, or one has no prediction.
        Avs3dError: if the dataset itself is damaged, the truth is not what was committed to, or a mask in memory has
            another size, type or values.

    Examples:
        >>> scores = evaluate("data/demo-submissions/oracle", "data/demo").scores
        >>> round(scores.parts["part_2"].official.mIoU, 3)
        0.992
        >>> from avs3d_bench import Dataset
        >>> dataset = Dataset("data/demo")
        >>> white = {o.key: [np.ones(f.rgb().shape[:2], bool) for f in o.test] for o in dataset}  # masks in memory
        >>> print(evaluate(white, dataset, protocols="strict").scores)
        'in memory' on demo 1, 2 observations: strict IoU 0.015, strict F 0.019
                                    part_1 (1)  part_2 (1)  overall (2)
        strict.IoU                       0.015           –        0.015
        strict.F                         0.019           –        0.019
        strict.boundary_F                0.000           –        0.000
        strict.FP_rate                   1.000       1.000        1.000
        strict.FP_area                   1.000       1.000        1.000
        strict.wrong_instance_rate           –       1.000        1.000
    """
    patterns = (only,) if isinstance(only, str) else tuple(only)
    wanted = _known_protocols(protocols)
    _check_options(patterns, aisrm, workers)
    data = open_dataset(dataset, truth, patterns)
    with ExitStack() as stack:
        if isinstance(submission, Mapping | Method):
            if aisrm is not None:
                raise UsageError("aisrm: chooses a folder of the released pipeline; leave it out for masks in memory")
            select(data, patterns)
            submission = stack.enter_context(written(submission, data, patterns))
        if not isinstance(submission, str | Path):
            raise UsageError(
                f"submission: a {type(submission).__name__}; expected the path of a folder or a .zip, or predictions: "
                "observation key → masks"
            )
        opened = stack.enter_context(open_submission(Path(submission), aisrm=aisrm))
        return score(opened, data, protocols=wanted, only=patterns, workers=workers, progress=progress)


def _known_protocols(asked: str | Sequence[str] | None) -> tuple[Protocol, ...] | None:
    """Protocols in the words of the command line; None: those that fit."""
    if asked is None or asked == "all":
        return None
    names = (asked,) if isinstance(asked, str) else asked
    words = (*PROTOCOLS, "all")
    if not isinstance(names, Sequence) or not names:
        raise UsageError(f"protocols: {excerpt(asked)}, expected one or more of {', '.join(words)}")
    for name in names:
        if name not in PROTOCOLS:
            raise UsageError(f"protocols: {excerpt(name)}, expected {', '.join(words)}{did_you_mean(name, words)}")
    return tuple(name for name in PROTOCOLS if name in names)


def _check_options(only: Sequence[object], aisrm: object, workers: object) -> None:
    """Refuse values that the command line refuses.

    Raises:
        UsageError: naming the option and what was expected.
    """
    for pattern in only:
        if not isinstance(pattern, str):
            raise UsageError(f"only: {excerpt(pattern)}, expected shell patterns of observation keys, as 'part_2/*'")
    if not isinstance(aisrm, bool | None):
        raise UsageError(f"aisrm: {excerpt(aisrm)}, expected True, False or None")
    whole = isinstance(workers, int) and not isinstance(workers, bool)
    if workers is not None and not (whole and 1 <= cast(int, workers) <= MOST_WORKERS):
        raise UsageError(f"workers: {excerpt(workers)}, expected 1 to {MOST_WORKERS}, or None for one per core")


def fitting(parts: Collection[str], asked: Sequence[Protocol] | None, where: str) -> tuple[Protocol, ...]:
    """The protocols to compute, in the order of `PROTOCOLS`.

    Args:
        parts: those that the observations belong to.
        asked: protocols that were asked for; None: those that fit.
        where: what messages name.

    Raises:
        UsageError: if one was asked for that scores none of the parts, or none fits.
    """
    fit = [name for name in PROTOCOLS if not {*PROTOCOL_PARTS[name]}.isdisjoint(parts)]
    for name in asked or ():
        if name not in fit:
            scored = " and ".join(PROTOCOL_PARTS[name])
            raise UsageError(
                f"{where}: protocol {name} scores {scored}; found only {' and '.join(sorted(parts))}, which "
                f"{' and '.join(fit)} score{'s' if len(fit) == 1 else ''}: leave out --protocol"
            )
    return tuple(name for name in fit if asked is None or name in asked)


def open_dataset(dataset: str | Path | Dataset, truth: str | Path | None = None, only: Sequence[str] = ()) -> Dataset:
    """The dataset to score against; of a sealed test with its truth, checked against the commitments.

    Args:
        dataset: its root, or the opened dataset.
        truth: of a sealed test, the folder with its truth; not needed where the dataset was opened with it.
        only: shell patterns of the keys of the observations whose truth is checked; none: all.

    Raises:
        UsageError: if ``dataset`` is none, the truth of a sealed test is not given, or belongs to another one.
        Avs3dError: if the truth is not what was committed to.
    """
    if not isinstance(dataset, str | Path | Dataset):
        raise UsageError(f"dataset: a {type(dataset).__name__}; expected the path of its root, or a Dataset")
    if not isinstance(truth, str | Path | None):
        raise UsageError(f"truth: a {type(truth).__name__}; expected the path of the folder with the truth")
    data = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    if truth is not None:
        return open_sealed(data.root, truth, only=only)
    if data.is_sealed and data.truth is None:
        raise UsageError(
            f"{data.root}: a sealed test; expected its truth as well: --truth PRIVATE (in Python truth=…), which its "
            "organiser has"
        )
    return data


def score(
    submission: Submission,
    dataset: Dataset,
    *,
    protocols: Sequence[Protocol] | None = None,
    only: Iterable[str] = (),
    workers: int | None = 1,
    progress: bool = False,
) -> Evaluation:
    """Score an opened submission; arguments and errors as for `evaluate`."""
    observations = select(dataset, only)
    wanted = fitting({o.place.part for o in observations}, protocols, str(dataset.root))
    observations = tuple(o for o in observations if any(o.place.part in PROTOCOL_PARTS[name] for name in wanted))
    problems = check_structure(submission, dataset, observations)
    if any(problem.severity == "error" for problem in problems):
        # Nothing will be scored: now report problems inside the files as well.
        raise InvalidSubmission(check_contents(submission, observations, problems, workers=workers, progress=progress))
    points, categories = has_points(submission, observations), has_categories(submission, observations)
    score_job = partial(_score_job, dataset.open, submission, wanted, points, categories)
    outcomes: dict[str, ScoredObservation] = {}
    groups: dict[str, GroupOutcome] = {}
    worst: tuple[FrameScore, ...] = ()
    best: tuple[FrameScore, ...] = ()
    jobs = _jobs(observations)
    sizes = [job.frames for job in jobs]
    found = process_each(score_job, jobs, workers=workers, label="scoring frames", progress=progress, sizes=sizes)
    for job, done in found:
        groups[job.group] = done
        for key, outcome in done.outcomes.items():
            worst = worst_frames((*worst, *outcome.worst), SHOWN_FRAMES)
            best = best_frames((*best, *outcome.best), 2 * SHOWN_FRAMES)
            outcomes[key] = replace(outcome, worst=(), best=())
    bad = [problem for outcome in outcomes.values() for problem in outcome.problems]
    warnings = [problem for outcome in outcomes.values() for problem in outcome.warnings]
    if bad:
        files = sum(outcome.files for outcome in outcomes.values())
        named = ordered([*problems, *bad, *warnings])
        raise InvalidSubmission(Report(submission.named, True, len(observations), files, named))
    best = tuple(frame for frame in best if frame not in worst)[:SHOWN_FRAMES]
    ordered_outcomes = [outcomes[observation.key] for observation in observations]
    ordered_groups = [groups[job.group] for job in jobs]
    software = ProvenanceRecord.of(provenance("scores"))
    record = score_record(submission, dataset, wanted, points, ordered_outcomes, ordered_groups, software)
    record = with_conditions(record, observations)
    shown = sorted(
        (group.shown for group in ordered_groups if group.shown is not None),
        key=lambda one: (one.right - one.pairs, one.group),
    )
    tallies = {observation.key: outcomes[observation.key].frames for observation in observations}
    return Evaluation(record, worst, best, tuple(shown), tuple(ordered([*problems, *warnings])), tallies)


def with_soft_masks(
    evaluation: Evaluation, dataset: Dataset, folder: Path, *, workers: int | None = 1, progress: bool = False
) -> Evaluation:
    """The evaluation with the average precision of soft masks; see `evaluators.protocols.soft_masks.soft_scores`.

    Examples:
        >>> from avs3d_bench import Dataset
        >>> dataset, found = Dataset("data/demo"), evaluate("data/demo-submissions/oracle", "data/demo")
        >>> soft = with_soft_masks(found, dataset, Path("data/demo-submissions/oracle")).scores.soft
        >>> round(soft.parts["part_1"].AP, 3)
        1.0
    """
    found = soft_scores(evaluation.scores, dataset, folder, workers=workers, progress=progress)
    return replace(evaluation, scores=evaluation.scores.model_copy(update={"soft": found}))


def _jobs(observations: Iterable[Observation]) -> list[ScoringJob]:
    """Group the observations that are scored together, in the order of the first one of each."""
    return [
        ScoringJob(name, tuple(o.key for o in some), sum(len(o.test) for o in some))
        for name, some in by_pictures(observations).items()
    ]


class _Counts(TypingProtocol):
    """The counts of observations that are scored together: `SourceCounts` or `SiblingCounts`."""

    def add(self, siblings: Sequence[Frame], readers: Sequence[Reader]) -> None: ...

    def figures(self, clouds: Sequence[NDArray[np.float32] | None]) -> GroupFigures: ...


def _score_job(
    opener: Callable[[str], Observation],
    submission: Submission,
    wanted: Sequence[Protocol],
    points: bool,
    categories: bool,
    job: ScoringJob,
) -> GroupOutcome:
    """Score observations together: every mask decoded once, one frame of each in memory at a time.

    Args:
        opener: opens the observation of a key.
        submission: where its files lie.
        wanted: the protocols.
        points: whether the submission has 3D predictions.
        categories: whether it has categories/.
        job: which observations.

    Raises:
        Avs3dError: if the dataset is damaged.
    """
    observations = [opener(key) for key in job.keys]
    readers = [Reader(submission, key) for key in job.keys]
    listens = observations[0].place.part in PROTOCOL_PARTS["listen"]
    counts: _Counts
    counts = SiblingCounts(observations, categories=categories) if listens else SourceCounts(observations[0], wanted)
    frames = sibling_frames(observations)
    for number, siblings in enumerate(frames):
        advance(number, len(frames))
        counts.add(siblings, readers)
    # Points are always read: a submission with a bad file gets no score under any protocol.
    clouds = [reader.points() if points else None for reader in readers]
    if any(reader.problems for reader in readers):
        return GroupOutcome(
            {r.key: ScoredObservation(None, problems=tuple(r.problems), files=r.files) for r in readers}
        )
    figures = counts.figures(clouds)
    outcomes = {}
    for observation, reader, found in zip(observations, readers, figures.observations, strict=True):
        digests = observation_digests(observation, reader.digests)
        outcomes[observation.key] = ScoredObservation(
            found.scores.model_copy(update={"digests": digests}),
            found.references,
            worst_frames(found.frames),
            best_frames(found.frames),
            warnings=reader.warnings,
            files=reader.files,
            frames=found.tallies,
        )
    return GroupOutcome(outcomes, figures.siblings, figures.references, figures.shown)
