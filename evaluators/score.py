"""Scoring a submission, from its folder to the record of scores: the story of this package.

    open the submission → check names, sizes, headers → decode and count, observation by observation, in parallel
    → any bad file: no score, every bad file named → else means, intervals, reference rows

Each mask is decoded once: its contents are checked while it is scored. Results do not depend on the number of
processes: every observation is computed whole in one of them, and means are exactly rounded sums.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.parallel import advance, process_each
from avs3d_bench.provenance import provenance
from avs3d_bench.report import Report, ordered
from avs3d_bench.schema import ProvenanceRecord
from avs3d_bench.scores import (
    BLIND_REFERENCES,
    PROTOCOL_PARTS,
    ObservationScores,
    Protocol,
)
from avs3d_bench.sealed import open_sealed
from evaluators.conditions import with_conditions
from evaluators.deaf import DeafFrame, deaf_frame, deaf_references
from evaluators.frames import FrameFigures, Truth, frame_figures, reference_figures
from evaluators.metrics import as_bytes
from evaluators.origin import observation_digests
from evaluators.protocols import (
    MOVING,
    NO_INSTANCE_MASKS,
    NO_MESH,
    NO_POINTS,
    ONE_INSTANCE,
    fitting,
    official_observation,
    strict_observation,
)
from evaluators.reading.checks import check_contents, check_structure, has_categories, has_points, select
from evaluators.reading.reader import Reader
from evaluators.reading.submission import open_submission
from evaluators.records import (
    Evaluation,
    FrameScore,
    FrameTally,
    InvalidSubmission,
    ScoredObservation,
    Submission,
    best_frames,
    worst_frames,
)
from evaluators.sound_scenes import GroupOutcome, score_group
from evaluators.summary import score_record
from evaluators.volume import VolumeScore, score_points, true_volume

#: Frames that the report shows, of each kind.
SHOWN_FRAMES = 12


@dataclass(frozen=True)
class ScoringJob:
    """Observations that one process scores at a time: one, or the siblings of a group of part_3.

    Attributes:
        keys: of the observations.
        frames: number of their test frames.
        group: key of the group; None of an observation of part_1 or part_2.
    """

    keys: tuple[str, ...]
    frames: int
    group: str | None = None


def evaluate(
    submission: str | Path,
    dataset: str | Path | Dataset,
    truth: str | Path | None = None,
    *,
    protocols: Sequence[Protocol] | None = None,
    only: Iterable[str] = (),
    aisrm: bool | None = None,
    workers: int | None = 1,
    progress: bool = False,
) -> Evaluation:
    """Score the submission at a path (a folder or a .zip) against a dataset.

    Args:
        submission: its folder or archive.
        dataset: its root, or the opened dataset; ours or the official release.
        truth: of a sealed test, the folder with its truth, which is checked against the commitments.
        protocols: which to compute; None: those that fit the observations (`evaluators.protocols.fitting`).
        only: shell patterns of observation keys; the others are left out.
        aisrm: which folder of the released pipeline's output to read; see `open_submission`.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Raises:
        InvalidSubmission: if anything is wrong with a file of the submission; its report names every one.
        UsageError: if a path is neither submission nor dataset, an argument is of another type, the truth of a sealed
            test is not given, or no observation matches ``only``.
        Avs3dError: if the dataset itself is damaged, or the truth is not what was committed to.
    """
    patterns = (only,) if isinstance(only, str) else tuple(only)
    data = open_dataset(dataset, truth, patterns)
    if not isinstance(submission, str | Path):
        raise UsageError(f"submission: a {type(submission).__name__}; expected the path of a folder or a .zip")
    with open_submission(Path(submission), aisrm=aisrm) as opened:
        return score(opened, data, protocols=protocols, only=patterns, workers=workers, progress=progress)


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
    job = partial(_score_unit, dataset.open, submission, wanted, points, categories)
    outcomes: dict[str, ScoredObservation] = {}
    groups: dict[str, GroupOutcome] = {}
    worst: tuple[FrameScore, ...] = ()
    best: tuple[FrameScore, ...] = ()
    units = _units(observations)
    sizes = [unit.frames for unit in units]
    for unit, done in process_each(job, units, workers=workers, label="scoring frames", progress=progress, sizes=sizes):
        for key, outcome in done.outcomes.items():
            worst = worst_frames((*worst, *outcome.worst), SHOWN_FRAMES)
            best = best_frames((*best, *outcome.best), 2 * SHOWN_FRAMES)
            outcomes[key] = replace(outcome, worst=(), best=())
        if unit.group is not None:
            groups[unit.group] = done
    bad = [problem for outcome in outcomes.values() for problem in outcome.problems]
    warnings = [problem for outcome in outcomes.values() for problem in outcome.warnings]
    if bad:
        files = sum(outcome.files for outcome in outcomes.values())
        found = ordered([*problems, *bad, *warnings])
        raise InvalidSubmission(Report(submission.named, True, len(observations), files, found))
    best = tuple(frame for frame in best if frame not in worst)[:SHOWN_FRAMES]
    ordered_outcomes = [outcomes[observation.key] for observation in observations]
    ordered_groups = [groups[unit.group] for unit in units if unit.group is not None]
    software = ProvenanceRecord.of(provenance("scores"))
    record = score_record(submission, dataset, wanted, points, ordered_outcomes, ordered_groups, software)
    record = with_conditions(record, observations)
    shown = sorted(
        (group.shown for group in ordered_groups if group.shown is not None),
        key=lambda one: (one.right - one.pairs, one.group),
    )
    tallies = {observation.key: outcomes[observation.key].frames for observation in observations}
    return Evaluation(record, worst, best, tuple(shown), tuple(ordered([*problems, *warnings])), tallies)


def _units(observations: Sequence[Observation]) -> list[ScoringJob]:
    """Group the observations that are scored together, in the order of the first one of each."""
    found: dict[tuple[bool, str], list[Observation]] = {}
    for o in observations:
        group = o.group if o.is_sound_scene else None  # which reads observation.json
        found.setdefault((o.is_sound_scene, group or o.key), []).append(o)
    return [
        ScoringJob(tuple(o.key for o in some), sum(len(o.test) for o in some), name if is_scene else None)
        for (is_scene, name), some in found.items()
    ]


def _score_unit(
    opener: Callable[[str], Observation],
    submission: Submission,
    wanted: Sequence[Protocol],
    points: bool,
    categories: bool,
    unit: ScoringJob,
) -> GroupOutcome:
    observations = [opener(key) for key in unit.keys]
    if unit.group is not None:
        return score_group(observations, submission, points, categories, unit.group)
    return GroupOutcome({o.key: score_observation(o, submission, wanted, points) for o in observations})


def score_observation(
    observation: Observation, submission: Submission, wanted: Sequence[Protocol], points: bool
) -> ScoredObservation:
    """Score one observation of part_1 or part_2: every mask decoded once, one frame in memory at a time.

    Args:
        observation: of the dataset.
        submission: where its files lie.
        wanted: the protocols.
        points: whether the submission has 3D predictions.

    Raises:
        Avs3dError: if the dataset is damaged.
    """
    key = observation.key
    strict = "strict" in wanted
    twin_ids = _twin_ids(observation) if strict else None
    figures: list[FrameFigures] = []
    references: dict[str, list[FrameFigures]] = {name: [] for name in BLIND_REFERENCES}
    frames: list[FrameScore] = []
    tallies: list[FrameTally] = []
    reader = Reader(submission, key)
    deaf: list[DeafFrame] = []
    test = observation.test
    for number, frame in enumerate(test):
        advance(number, len(test))
        truth = _truth(frame, twin_ids, strict)
        height, width = truth.mask.shape
        prediction = reader.mask(frame.name, (height, width))
        if prediction is None:
            continue
        found = frame_figures(truth, prediction)
        figures.append(found)
        for name, reference in reference_figures(truth).items():
            references[name].append(reference)
        if strict and observation.record is not None:
            deaf.append(deaf_frame(truth, observation.record.sounding.id))
        frames.append(FrameScore.of(key, frame.name, found.counts, found.twins_marked))
        seen = None if found.twins is None else (len(found.twins), found.twins_marked)
        tallies.append(FrameTally(frame.name, found.counts, found.boundary_f, seen))
    if not figures and not reader.problems:
        raise Avs3dError(f"{observation.path}: no test frame; expected some in {layout.SPLITS_JSON}")
    # Points are always read: a submission with a bad file gets no score under any protocol.
    cloud = reader.points() if points else None
    volume = _volume(observation, cloud) if strict and cloud is not None else None
    if reader.problems:
        return ScoredObservation(None, problems=tuple(reader.problems), files=reader.files)
    scored = _observation_scores(observation, figures, volume, wanted, points)
    references |= deaf_references(deaf) if deaf else {}
    beside = {
        name: _observation_scores(observation, frames_, None, wanted, False) for name, frames_ in references.items()
    }
    scored = scored.model_copy(update={"digests": observation_digests(observation, reader.digests)})
    best = best_frames(frames)
    return ScoredObservation(scored, beside, worst_frames(frames), best, files=reader.files, frames=tuple(tallies))


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
    if _moves(observation) or not observation.where(layout.SOUNDING_OBJECT).exists():
        return None
    mesh = observation.mesh()
    return score_points(cloud, true_volume(mesh.vertices, mesh.faces))


def _moves(observation: Observation) -> bool:
    """Whether the sounding object moves: then gt_3d holds it at the first frame, and points have no one truth."""
    return observation.record is not None and observation.record.moves


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
