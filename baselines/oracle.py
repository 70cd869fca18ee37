"""The oracle: the truth as a prediction, perfect or with the errors of `baselines.oracle_errors`.

It looks at the truth of test frames by design, so its scores are bounds, not results: ``sounding`` is perfect,
``category`` is the result of a perfect detector that finds every object of the right category and ignores which of
them sounds.

In part_3 (`baselines.oracle_scenes`) several instances may be audible in a frame, or none; there it writes class ids as
well.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.schema import InstanceRecord, ObservationRecord
from avs3d_bench.submission import Prediction, SubmissionWriter, frame_size
from baselines.oracle_errors import CONFUSABLE, ErrorModel
from baselines.oracle_scenes import scene_prediction

Instance = Literal["category", "sounding"]
Mask = NDArray[np.bool_]

#: No error at all.
PERFECT = ErrorModel()
#: `truth` of submission.json: leaderboards do not rank such submissions.
TRUTH = "masks of test frames"
#: Points of `--points` per cm² of the true mesh's surface: 100 in a face of a 5 cm voxel. What is missed are voxels of
#: which the surface cuts off a mere tip (1 % of a washing machine's, 6 % of a telephone's).
POINTS_PER_CM2 = 4.0


def oracle_mask(frame: Frame, *, instance: Instance, errors: ErrorModel = PERFECT) -> Mask:
    """The prediction of the oracle for a frame, test or train.

    The steps: the true mask (or the union over the category; or, after a swap, a twin's), the confusable neighbour
    added, outlines moved, and nothing at all where the frame is dropped.

    Args:
        frame: of any split; its truth is read.
        instance: ``category``: the visible pixels of every instance of the sounding category; ``sounding``: those of
            the sounding instance alone. In part_3: of the categories, or instances, that are audible in the frame.
        errors: what goes wrong.

    Returns:
        (H, W) bool.

    Raises:
        UsageError: if the data lacks what this needs (`check_truth`).
        Avs3dError: if a file of it is damaged.
    """
    observation = frame.observation
    check_truth(observation, instance=instance, errors=errors)
    if observation.is_sound_scene:
        return np.asarray(scene_prediction(frame, category=instance == "category", errors=errors).mask, np.bool_)
    if errors.happens("drop", observation.key, frame.name):
        return np.zeros(frame_size(frame), dtype=np.bool_)
    twin, neighbour = _twin(observation, errors), _neighbour(observation, errors)
    if instance == "category":
        mask = _visible(frame, _category_ids(_record(observation)))
    else:
        mask = frame.mask() if twin is None else _visible(frame, (twin,))
    if neighbour is not None:
        mask = mask | _visible(frame, (neighbour,))
    return errors.outline(mask)


def _visible(frame: Frame, ids: Sequence[int]) -> Mask:
    """(H, W) True where an instance with one of the ``ids`` is seen."""
    return np.isin(frame.instance_ids(), ids)


def check_truth(
    observation: Observation, *, instance: Instance, errors: ErrorModel = PERFECT, points: bool = False
) -> None:
    """Raise an error for predictions that the data, or the truth itself, do not allow.

    Raises:
        UsageError: in one line.
    """
    if instance not in ("category", "sounding"):
        raise UsageError(f"instance {instance!r}: expected category or sounding")
    if instance == "category" and errors.swap:
        raise UsageError("swap needs --instance sounding: the union over the category holds every twin already")
    asked = {"--instance category": instance == "category", "--swap": errors.swap, "--confuse": errors.confuse}
    needs = [name for name, wanted in asked.items() if wanted]
    if needs and (observation.record is None or not (observation.path / layout.INSTANCE_MASKS).is_dir()):
        sealed = observation.published is not None
        lacks = "a sealed test does not publish" if sealed else "the official release does not have"
        hint = "" if sealed else "; only --instance sounding works there"
        raise UsageError(
            f"{observation.path}: {needs[0]} needs {layout.OBSERVATION_JSON} and {layout.INSTANCE_MASKS}/, which "
            f"{lacks}{hint}"
        )
    if not points:
        return
    if instance == "category":
        raise UsageError("--points needs --instance sounding: only the sounding object's mesh is known")
    if errors.swap or errors.confuse:
        raise UsageError("--points cannot be had with --swap or --confuse: only the sounding object's mesh is known")
    if not (observation.path / layout.SOUNDING_OBJECT).exists() and not _is_silent(observation):
        raise UsageError(f"{observation.path}: --points needs {layout.SOUNDING_OBJECT}, which is missing")


def _is_silent(observation: Observation) -> bool:
    """Whether it is an observation of part_3 in which no instance of the room sounds: then there is no mesh."""
    record = observation.record
    return observation.is_sound_scene and record is not None and not record.sounding_instances


def _record(observation: Observation) -> ObservationRecord:
    record = observation.record
    if record is None:
        raise UsageError(f"{observation.path}: no {layout.OBSERVATION_JSON}; only --instance sounding works there")
    return record


def _category_ids(record: ObservationRecord) -> tuple[int, ...]:
    return tuple(i.id for i in record.instances if i.category == record.category)


def _twin(observation: Observation, errors: ErrorModel) -> int | None:
    """The id of the twin that is mistaken for the sounding instance in this observation; None: no mistake.

    Drawn evenly from the silent twins that are in sight in some frame of the walk, train or test: nobody mistakes an
    object for another that was never seen. In a frame where that twin is out of sight the mask is black.
    """
    if not errors.swap or observation.record is None or not errors.happens("swap", observation.key):
        return None
    candidates = _seen_twins(observation)
    if not candidates:
        return None
    return candidates[int(errors.rng("twin", observation.key).integers(len(candidates)))]


@lru_cache(maxsize=4)
def _seen_twins(observation: Observation) -> tuple[int, ...]:
    """Ids of the silent twins with a visible pixel in some frame, in the order of the record."""
    record = _record(observation)
    twins = [i for i in _category_ids(record) if i != record.sounding.id]
    seen: set[int] = set()
    for frame in observation.frames:
        if seen.issuperset(twins):
            break
        seen |= set(np.flatnonzero(np.bincount(frame.instance_ids().ravel())).tolist())
    return tuple(i for i in twins if i in seen)


def _neighbour(observation: Observation, errors: ErrorModel) -> int | None:
    """The id of the object that is mistaken for one of the category in this observation; None: no mistake.

    The likeliest category of `CONFUSABLE` that is present, else any other; of several the nearest. Twins are no
    candidates: marking them is what `swap` and ``category`` are about.
    """
    if not errors.confuse or observation.record is None or not errors.happens("confuse", observation.key):
        return None
    record = observation.record
    others = [i for i in record.instances if i.category != record.category]
    likely = CONFUSABLE.get(record.category or "", ())  # of a category that the manifest adds nothing is known

    def rank(other: InstanceRecord) -> tuple[int, float, int]:
        similarity = likely.index(other.category) if other.category in likely else len(likely)
        return similarity, float(np.linalg.norm(_centre(other) - _centre(record.sounding))), other.id

    return min(others, key=rank).id if others else None


def _centre(instance: InstanceRecord) -> NDArray[np.float64]:
    low, high = np.asarray(instance.bounds, dtype=np.float64)
    return np.asarray(0.5 * (low + high))


def oracle_points(observation: Observation) -> NDArray[np.float32]:
    """Points on the surface of the sounding instance's true mesh, spread evenly by area.

    Systematic sampling: point i of N lies in the triangle at (i + ½)/N of the cumulated area, at the place in it that
    the i-th member of the plane's R₂ sequence names (M. Roberts, "The unreasonable effectiveness of quasirandom
    sequences", 2018), so that no random number is needed.

    Returns:
        (N, 3) metres, world coordinates; N = `POINTS_PER_CM2` × the area, at least 1; 0 where no instance sounds.
    """
    if _is_silent(observation):
        return np.zeros((0, 3), dtype=np.float32)
    mesh = observation.mesh()
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    origin, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cumulated = np.cumsum(0.5 * np.linalg.norm(np.cross(first, second), axis=1))
    area = float(cumulated[-1]) if len(cumulated) else 0.0
    if not area > 0:
        raise UsageError(f"{observation.path / layout.SOUNDING_OBJECT}: a mesh without area; regenerate the dataset")
    count = max(1, round(area * 1e4 * POINTS_PER_CM2))
    step = np.arange(count)
    face = np.minimum(np.searchsorted(cumulated, (step + 0.5) / count * area, side="right"), len(cumulated) - 1)
    plastic = 1.32471795724474602596  # the real root of x³ = x + 1
    u, v = (0.5 + step / plastic) % 1.0, (0.5 + step / plastic**2) % 1.0
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    return (origin[face] + u[:, None] * first[face] + v[:, None] * second[face]).astype(np.float32)


def describe(instance: Instance, errors: ErrorModel, points: bool) -> tuple[str, str]:
    """(method, notes) of submission.json: that this is the truth, and every setting."""
    wrong = "".join(f", {name} {value:g}" for name, value in errors.settings.items())
    notes = (
        f"uses the ground truth of test frames; instance {instance}; errors: {errors} (dilate in pixels at "
        f"{layout.IMAGE_SIZE}); points {f'{POINTS_PER_CM2:g} per cm² of the true mesh' if points else 'none'}"
    )
    return f"oracle ({instance}{wrong})", notes


def write_oracle(
    dataset: Dataset,
    path: str | Path,
    *,
    instance: Instance = "category",
    errors: ErrorModel = PERFECT,
    points: bool = False,
    only: Iterable[str] = (),
    overwrite: bool = False,
    workers: int | None = 1,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the oracle's submission; the same bytes for any number of workers.

    Args:
        dataset: what to look at.
        path: the submission's folder.
        instance: see `oracle_mask`.
        errors: the errors to make in the masks; points, if asked for, are those of the true mesh.
        points: write points.ply as well.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        workers: processes; None: one per core.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if the data lacks what this needs, or the target is not free.
        Avs3dError: if the dataset is damaged or the system refuses.
    """
    only = tuple(only)
    for observation in dataset.select(*only):
        check_truth(observation, instance=instance, errors=errors, points=points)
    name, notes = describe(instance, errors, points)
    method = Method(
        name,
        partial(_masks, instance, errors),
        points=oracle_points if points else None,
        notes=notes,
        truth=TRUTH,
        entry="baselines.oracle:write_oracle",
    )
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, workers=workers, progress=progress)


def _masks(instance: Instance, errors: ErrorModel, frames: tuple[Frame, ...]) -> Iterator[Mask | Prediction]:
    for frame in frames:
        if frame.observation.is_sound_scene:
            yield scene_prediction(frame, category=instance == "category", errors=errors)
        else:
            yield oracle_mask(frame, instance=instance, errors=errors)
