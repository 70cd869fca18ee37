"""Scoring a submission, from its folder to the record of scores: the story of this package.

    open the submission → check names, sizes, headers → decode and count, observation by observation, in parallel
    → any bad file: no score, every bad file named → else means, intervals, reference rows

Each mask is decoded once: its contents are checked while it is scored. Results do not depend on the number of
processes: every observation is computed whole in one of them, and means are exactly rounded sums.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from heapq import nsmallest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__, layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.files import sha256_file
from avs3d_bench.parallel import advance, process_each
from avs3d_bench.predictions import read_mask, read_points
from avs3d_bench.provenance import provenance
from avs3d_bench.report import Problem, Report, ordered
from avs3d_bench.schema import ProvenanceRecord
from avs3d_bench.scores import (
    BLIND_REFERENCES,
    PROTOCOLS,
    REFERENCES,
    Evaluator,
    GroupScores,
    ObservationScores,
    Protocol,
    ScoredDataset,
    ScoredSubmission,
    Scores,
)
from avs3d_bench.taxonomy import CATEGORIES, PARTS, ROOMS
from evaluators import bootstrap
from evaluators.deaf import DeafFrame, deaf_frame, deaf_references
from evaluators.frames import FrameFigures, Truth, frame_figures, reference_figures
from evaluators.metrics import as_bytes
from evaluators.protocols import (
    MOVING,
    NO_INSTANCE_MASKS,
    NO_MESH,
    NO_POINTS,
    ONE_INSTANCE,
    official_observation,
    strict_observation,
    summarise,
)
from evaluators.reading.checks import check_contents, check_structure, has_points, problem_of, select
from evaluators.reading.submission import open_submission
from evaluators.records import Evaluation, FrameScore, InvalidSubmission, Submission
from evaluators.volume import VOXEL_SIZE, VolumeScore, score_points, true_volume

#: What computes the figures (see `avs3d_bench.provenance`).
SCORING = "evaluators.score:evaluate"
#: Frames that the report shows: so many of each kind, and at most so many of one observation.
SHOWN_FRAMES = 12
SHOWN_PER_OBSERVATION = 2


@dataclass(frozen=True)
class Outcome:
    """What scoring one observation gave.

    Attributes:
        scores: of the submission; None if a file of it is bad.
        references: name of the reference → its scores; without the deaf ones where the instances are not known.
        worst: its worst frames.
        best: its best frames.
        problems: of the submission's files.
        files: how many files of the submission were read.
    """

    scores: ObservationScores | None
    references: Mapping[str, ObservationScores]
    worst: tuple[FrameScore, ...]
    best: tuple[FrameScore, ...]
    problems: tuple[Problem, ...]
    files: int


def evaluate(
    submission: str | Path,
    dataset: str | Path,
    *,
    protocols: Sequence[Protocol] = ("official", "strict"),
    only: Iterable[str] = (),
    aisrm: bool | None = None,
    workers: int | None = 1,
    progress: bool = False,
) -> Evaluation:
    """Score the submission at a path (a folder or a .zip) against the dataset at a path.

    Args:
        submission: its folder or archive.
        dataset: the dataset's root; ours or the official release.
        protocols: which to compute.
        only: shell patterns of observation keys; the others are left out.
        aisrm: which folder of the released pipeline's output to read; see `open_submission`.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        InvalidSubmission: if anything is wrong with a file of the submission; its report names every one.
        UsageError: if a path is neither submission nor dataset, or no observation matches ``only``.
        Avs3dError: if the dataset itself is damaged.
    """
    data = Dataset(dataset)
    with open_submission(Path(submission), aisrm=aisrm) as opened:
        return score(opened, data, protocols=protocols, only=only, workers=workers, progress=progress)


def score(
    submission: Submission,
    dataset: Dataset,
    *,
    protocols: Sequence[Protocol] = ("official", "strict"),
    only: Iterable[str] = (),
    workers: int | None = 1,
    progress: bool = False,
) -> Evaluation:
    """Score an opened submission; arguments and errors as for `evaluate`."""
    observations = select(dataset, only)
    problems = check_structure(submission, dataset, observations)
    if any(problem.severity == "error" for problem in problems):
        # Nothing will be scored: now report problems inside the files as well.
        raise InvalidSubmission(check_contents(submission, observations, problems, workers=workers, progress=progress))
    points = has_points(submission, observations)
    job = partial(score_observation, dataset.root, submission, tuple(protocols), points)
    outcomes: dict[str, Outcome] = {}
    worst: tuple[FrameScore, ...] = ()
    best: tuple[FrameScore, ...] = ()
    keys = [observation.key for observation in observations]
    sizes = [len(observation.test) for observation in observations]
    scored = process_each(job, keys, workers=workers, label="scoring frames", progress=progress, sizes=sizes)
    for key, outcome in scored:
        worst = _worst((*worst, *outcome.worst), SHOWN_FRAMES)
        best = _best((*best, *outcome.best), 2 * SHOWN_FRAMES)
        outcomes[key] = replace(outcome, worst=(), best=())
    bad = [problem for outcome in outcomes.values() for problem in outcome.problems]
    if bad:
        files = sum(outcome.files for outcome in outcomes.values())
        raise InvalidSubmission(Report(submission.named, True, len(keys), files, ordered([*problems, *bad])))
    done = [(o.scores, o.references) for key in keys if (o := outcomes[key]).scores is not None]
    best = tuple(frame for frame in best if frame not in worst)[:SHOWN_FRAMES]
    return Evaluation(_record(submission, dataset, protocols, points, done), worst, best)


def score_observation(
    root: Path, submission: Submission, wanted: Sequence[Protocol], points: bool, key: str
) -> Outcome:
    """Score one observation: every mask decoded once, one frame in memory at a time.

    Args:
        root: the dataset's.
        submission: where its files lie.
        wanted: the protocols.
        points: whether the submission has 3D predictions.
        key: the observation's.

    Raises:
        Avs3dError: if the dataset is damaged.
    """
    observation = Observation(root, key)
    strict = "strict" in wanted
    twin_ids = _twin_ids(observation) if strict else None
    figures: list[FrameFigures] = []
    references: dict[str, list[FrameFigures]] = {name: [] for name in BLIND_REFERENCES}
    frames, problems, files = [], [], 0
    deaf: list[DeafFrame] = []
    for number, frame in enumerate(observation.test):
        advance(number, len(observation.test))
        truth = _truth(frame, twin_ids, strict)
        height, width = truth.mask.shape
        path = submission.mask_path(key, frame.name)
        files += 1
        try:
            prediction = read_mask(path, width, height, released=submission.layout == "official")
        except Avs3dError as error:
            problems.append(problem_of(submission, path, error))
            continue
        found = frame_figures(truth, prediction)
        figures.append(found)
        for name, reference in reference_figures(truth).items():
            references[name].append(reference)
        if strict and observation.record is not None:
            deaf.append(deaf_frame(truth, observation.record.sounding.id))
        frames.append(_frame_score(key, frame.name, found))
    if not figures and not problems:
        raise Avs3dError(f"{observation.path}: no test frame; expected some in {layout.SPLITS_JSON}")
    volume: VolumeScore | None = None
    if points:
        files += 1
        volume, bad = _score_points(submission, observation, strict)
        problems += bad
    if problems:
        return Outcome(None, {}, (), (), tuple(problems), files)
    scored = _observation_scores(observation, figures, volume, wanted, points)
    references |= deaf_references(deaf) if deaf else {}
    beside = {
        name: _observation_scores(observation, frames_, None, wanted, False) for name, frames_ in references.items()
    }
    few = SHOWN_PER_OBSERVATION
    return Outcome(scored, beside, _worst(frames, few), _best(frames, few), (), files)


def _score_points(
    submission: Submission, observation: Observation, strict: bool
) -> tuple[VolumeScore | None, tuple[Problem, ...]]:
    """The score of a 3D prediction, or what is wrong with its file."""
    path = submission.points_path(observation.key)
    try:
        # Always read it: a submission with a bad file gets no score under any protocol.
        cloud = read_points(path)
    except Avs3dError as error:
        return None, (problem_of(submission, path, error),)
    return (_volume(observation, cloud) if strict else None), ()


def _twin_ids(observation: Observation) -> tuple[int, ...] | None:
    """Ids of the silent instances of the sounding category; None where they are not known."""
    record = observation.record
    if record is None or observation.place.part == "part_1":
        return None
    return tuple(i.id for i in record.instances if i.category == record.category and not i.sounding)


def _truth(frame: Frame, twin_ids: tuple[int, ...] | None, strict: bool) -> Truth:
    mask = as_bytes(frame.mask())
    ids = None
    if twin_ids is not None:
        ids = frame.instance_ids()
        if ids.shape != mask.shape:
            path = frame.path(layout.INSTANCE_MASKS)
            raise Avs3dError(
                f"{path}: shape {ids.shape}, expected that of the mask, {mask.shape}; regenerate the dataset"
            )
    return Truth.of(mask, ids, twin_ids or (), outlines=strict)


def _volume(observation: Observation, cloud: NDArray[np.float32]) -> VolumeScore | None:
    """The 3D figures of a predicted cloud (N, 3); None where the dataset has no mesh, or the object moves."""
    if _moves(observation) or not (observation.path / layout.SOUNDING_OBJECT).exists():
        return None
    mesh = observation.mesh()
    return score_points(cloud, true_volume(mesh.vertices, mesh.faces))


def _moves(observation: Observation) -> bool:
    """Whether the sounding object moves: then gt_3d holds it at the first frame, and points have no one truth."""
    return observation.record is not None and observation.record.moves


def _frame_score(key: str, name: str, figures: FrameFigures) -> FrameScore:
    counts = figures.counts
    iou = counts.overlap / counts.union if counts.truth else None
    marked = counts.predicted / counts.pixels
    wrong = (counts.union - counts.overlap) / counts.pixels
    return FrameScore(key, name, counts.truth > 0, iou, marked, figures.twins_marked, wrong)


def _observation_scores(
    observation: Observation,
    frames: Sequence[FrameFigures],
    volume: VolumeScore | None,
    wanted: Sequence[Protocol],
    points: bool,
) -> ObservationScores:
    place = observation.place
    unavailable = {}
    if place.part == "part_1":
        unavailable["wrong_instance_rate"] = ONE_INSTANCE
    elif observation.record is None:
        unavailable["wrong_instance_rate"] = NO_INSTANCE_MASKS
    if volume is None:
        reason = NO_POINTS if not points else MOVING if _moves(observation) else NO_MESH
        unavailable |= {"IoU_3D": reason, "centroid_error": reason}
    return ObservationScores.model_validate(
        {
            "key": observation.key,
            "part": place.part,
            "scan": place.scan,
            "room": place.room,
            "category": observation.category,
            "frames": len(frames),
            "official": official_observation(frames) if "official" in wanted else None,
            "strict": strict_observation(frames, volume, unavailable) if "strict" in wanted else None,
        }
    )


def _worst(frames: Iterable[FrameScore], count: int) -> tuple[FrameScore, ...]:
    """The frames with the largest badness; of equal ones those with more wrong pixels."""
    bad = (frame for frame in frames if frame.badness > 0)
    return tuple(nsmallest(count, bad, key=lambda f: (-f.badness, -f.wrong, f.key, f.name)))


def _best(frames: Iterable[FrameScore], count: int) -> tuple[FrameScore, ...]:
    """The frames with the object in sight and the highest IoU above 0; ties by name."""
    seen = (frame for frame in frames if frame.iou)
    return tuple(nsmallest(count, seen, key=lambda f: (f.badness, f.key, f.name)))


def _record(
    submission: Submission,
    dataset: Dataset,
    wanted: Sequence[Protocol],
    points: bool,
    outcomes: Sequence[tuple[ObservationScores, Mapping[str, ObservationScores]]],
) -> Scores:
    """The record of scores: observations, and their means over parts, categories and rooms."""
    scored = [scores for scores, _ in outcomes]
    record = dataset.record
    # A row covers all observations or is left out, because it is printed beside means over all of them.
    known = [name for name in REFERENCES if all(name in beside for _, beside in outcomes)]
    missing = [name for name in REFERENCES if name not in known]
    return Scores(
        avs3d_eval=Evaluator(
            version=__version__,
            protocols={name: version for name, version in PROTOCOLS.items() if name in wanted},
            bootstrap_resamples=bootstrap.RESAMPLES,
            bootstrap_seed=bootstrap.SEED,
            voxel_size=VOXEL_SIZE,
            provenance=ProvenanceRecord.of(provenance(SCORING)),
        ),
        submission=ScoredSubmission(
            **submission.record.model_dump(), layout=submission.layout, masks=submission.masks, points=points
        ),
        dataset=ScoredDataset(
            name=dataset.name,
            version=record.version if record else None,
            sha256=sha256_file(dataset.root / layout.DATASET_JSON) if record else None,
            observations=len(dataset),
            scored=len(scored),
            provenance=record.provenance if record else None,
        ),
        observations=tuple(scored),
        overall=summarise(scored),
        parts=_grouped(scored, PARTS, "part"),
        categories=_grouped(scored, CATEGORIES, "category"),
        rooms=_grouped(scored, ROOMS, "room"),
        references={name: _reference([beside[name] for _, beside in outcomes]) for name in known},
        references_unavailable=dict.fromkeys(missing, NO_INSTANCE_MASKS) if "strict" in wanted else {},
    )


def _grouped(scored: Sequence[ObservationScores], names: Iterable[str], field: str) -> dict[Any, GroupScores]:
    """Group → its means, in the order of ``names``, without those that have no observation."""
    groups = {name: [scores for scores in scored if getattr(scores, field) == name] for name in names}
    return {name: summarise(group) for name, group in groups.items() if group}


def _reference(scored: Sequence[ObservationScores]) -> dict[str, GroupScores]:
    """A reference's means; without intervals, because no reference is compared by them."""
    groups = {part: [scores for scores in scored if scores.part == part] for part in PARTS}
    parts = {part: summarise(group, intervals=False) for part, group in groups.items() if group}
    return parts | {"overall": summarise(scored, intervals=False)}
