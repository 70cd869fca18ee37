"""The oracle: the truth as a prediction, perfect or with the errors of `baselines.oracle_errors`.

It looks at the truth of test frames by design, so its scores are bounds, not results: ``sounding`` is perfect,
``category`` is the result of a perfect detector that finds every object of the right category and ignores which of
them sounds.

Any number of instances may be audible in a frame: in part_1 and part_2 the one that sounds, in part_3 several or none
(then nothing is marked). An error means the same for several: a swap takes a silent twin for each sounding instance
that has one; a confused neighbour is marked while something of the room is audible, and named as the category that it
is mistaken for. Class ids, which only submissions of part_3 have, follow the marked instances.

Examples:
    >>> from avs3d_bench import Dataset
    >>> dataset = Dataset("data/demo")
    >>> frame = dataset["part_2/apartment_1/kitchen/1"].frames[4]
    >>> [int(oracle.oracle_mask(frame, instance=which).sum()) for which in ("category", "sounding")]  # pixels
    [118, 60]
    >>> oracle.write_oracle(dataset, "oracle", instance="sounding", overwrite=True).record.method
    'oracle (sounding)'
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord, ObservationRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import Prediction, SubmissionWriter, frame_size
from baselines.oracle_errors import CONFUSABLE, ErrorModel

Instance = Literal["category", "sounding"]
Mask = NDArray[np.bool_]

#: No error at all.
PERFECT = ErrorModel()
#: `truth` of submission.json: leaderboards do not rank such submissions.
TRUTH = "masks of test frames"
#: Points of `--points` per cm² of the true mesh's surface: 100 in a face of a 5 cm voxel. What is missed are voxels of
#: which the surface cuts off a mere tip (1 % of a washing machine's, 6 % of a telephone's).
POINTS_PER_CM2 = 4.0
#: Of an instance.
_HIGHEST_ID = 65_535


def oracle_mask(frame: Frame, *, instance: Instance, errors: ErrorModel = PERFECT) -> Mask:
    """(H, W) bool: the mask of `oracle_prediction`, with its arguments, after a look at whether the data allow it.

    Raises:
        UsageError: if the data lacks what this needs (`check_truth`).
        Avs3dError: if a file of it is damaged.
    """
    check_truth(frame.observation, instance=instance, errors=errors)
    return np.asarray(oracle_prediction(frame, instance=instance, errors=errors).mask, np.bool_)


def oracle_prediction(frame: Frame, *, instance: Instance, errors: ErrorModel = PERFECT) -> Prediction:
    """The prediction of the oracle for a frame, test or train.

    The steps: the audible instances (or all of their categories; or, after a swap, twins), the confusable neighbour
    added, outlines moved, and nothing at all where the frame is dropped.

    Args:
        frame: of any split; its truth is read.
        instance: ``category``: the visible pixels of every instance of the categories that are audible in the frame,
            off-screen ones included; ``sounding``: those of the audible instances alone.
        errors: what goes wrong.

    Returns:
        mask and, in part_3, class ids where the data has some.

    Raises:
        Avs3dError: if a file of the dataset is damaged.
    """
    observation = frame.observation
    classes: NDArray[np.uint8] | None = None
    if errors.happens("drop", observation.key, frame.name):
        classes = np.zeros(frame_size(frame), np.uint8)
        mask = classes > 0
    elif instance == "category" or errors.swap or errors.confuse:
        marked = paint(frame.instance_ids(), _marked(frame, instance=instance, errors=errors))
        mask, classes = _outlined(marked > 0, marked, errors)
    elif observation.is_part_3 and (observation.path / layout.CATEGORY_MASKS).is_dir():
        mask, classes = _outlined(frame.mask(), frame.category_mask(), errors)
    else:
        mask = errors.outline(frame.mask())
    return Prediction(mask, classes if observation.is_part_3 else None)


def paint(instances: NDArray[np.uint16], classes: Mapping[int, int]) -> NDArray[np.uint8]:
    """(H, W) class ids of the instances that ``classes`` names (id → class id), 0 elsewhere."""
    colours = np.zeros(_HIGHEST_ID + 1, np.uint8)
    for number, value in classes.items():
        colours[number] = value
    return colours[instances]


def _outlined(mask: Mask, ids: NDArray[np.uint8], errors: ErrorModel) -> tuple[Mask, NDArray[np.uint8]]:
    """Mask and class ids with their outlines moved; where grown classes meet, the lower id has the new pixels."""
    moved = errors.outline(mask)
    grown = np.where(moved, ids, 0).astype(np.uint8)
    for value in np.unique(ids[ids > 0]) if errors.dilate > 0 else ():
        grown[errors.outline(ids == value) & (grown == 0)] = value
    return moved, grown


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
    """Whether no instance of the room sounds, as may be in part_3: then there is no mesh."""
    return observation.record is not None and not observation.record.sounding_instances


def _marked(frame: Frame, *, instance: Instance, errors: ErrorModel) -> dict[int, int]:
    """Id → class id of the instances that the oracle marks in a frame."""
    observation, record, entry = frame.observation, frame.observation.record, frame.record
    if record is None or entry is None:
        raise UsageError(f"{observation.path}: no {layout.OBSERVATION_JSON}; only --instance sounding works there")
    ids = record.class_ids
    heard = record.audible_instances(entry)
    if instance == "category":
        # A distractor never sounds where it is seen, even while one is heard from another room.
        audible = {source.category for source in record.audible_sources(entry)} & ids.keys()
        chosen = [placed.id for placed in record.instances if placed.category in audible]
    else:
        swapped = _swaps(observation, record, errors)
        chosen = [swapped.get(number, number) for number in heard]
    categories = {placed.id: placed.category for placed in record.instances}
    marked = {number: ids[categories[number]] for number in chosen}
    if heard and (mistaken := _neighbour(observation, record, errors)):
        neighbour, sounding = mistaken
        marked.setdefault(neighbour.id, ids[sounding.category])
    return marked


def _swaps(observation: Observation, record: ObservationRecord, errors: ErrorModel) -> dict[int, int]:
    """Sounding instance → the silent twin that is taken for it, in all frames; no twin is taken twice.

    Drawn evenly from the silent twins that are in sight in some frame of the walk, train or test: nobody mistakes an
    object for another that was never seen. In a frame where that twin is out of sight the mask is black.
    """
    if not errors.swap or not errors.happens("swap", observation.key):
        return {}
    seen = _seen(observation)
    silent = [instance for instance in record.instances if not instance.sounding and instance.id in seen]
    rng = errors.rng("twin", observation.key)
    out: dict[int, int] = {}
    for sounding in record.sounding_instances:
        twins = [i.id for i in silent if i.category == sounding.category and i.id not in out.values()]
        if twins:
            out[sounding.id] = twins[int(rng.integers(len(twins)))]
    return out


@lru_cache(maxsize=4)
def _seen(observation: Observation) -> frozenset[int]:
    """Ids of the instances with a visible pixel in some frame, train or test."""
    ids = (frame.instance_ids() for frame in observation.frames)
    return frozenset(number for picture in ids for number in np.flatnonzero(np.bincount(picture.ravel())).tolist())


def _neighbour(
    observation: Observation, record: ObservationRecord, errors: ErrorModel
) -> tuple[InstanceRecord, InstanceRecord] | None:
    """(object, the sounding instance that it is mistaken for) in this observation; None: no mistake.

    The likeliest category of `CONFUSABLE` that is present, else any other; of several the nearest. Twins are no
    candidates: marking them is what `swap` and ``category`` are about.
    """
    if not errors.confuse or not errors.happens("confuse", observation.key):
        return None
    sounding = record.sounding_instances
    categories = {instance.category for instance in sounding}
    pairs = [(other, one) for other in record.instances if other.category not in categories for one in sounding]

    def rank(pair: tuple[InstanceRecord, InstanceRecord]) -> tuple[int, float, int, int]:
        other, one = pair
        likely = CONFUSABLE.get(one.category, ())  # of a category that the manifest adds nothing is known
        similarity = likely.index(other.category) if other.category in likely else len(CONFUSABLE)
        return similarity, float(np.linalg.norm(_centre(other) - _centre(one))), other.id, one.id

    return min(pairs, key=rank) if pairs else None


def _centre(instance: InstanceRecord) -> NDArray[np.float64]:
    return np.asarray(np.mean(instance.bounds, axis=0))


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


def _masks(instance: Instance, errors: ErrorModel, frames: tuple[Frame, ...]) -> Iterator[Prediction]:
    return (oracle_prediction(frame, instance=instance, errors=errors) for frame in frames)
