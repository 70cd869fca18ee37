"""The oracle on sound scenes (part_3): any number of audible instances per frame, none under silence.

The errors mean the same as in parts 1 and 2, for several instances: a swap takes a silent twin for each sounding
instance that has one; a confused neighbour is marked, and named as the category that it is mistaken for, while
something of the room is audible. Class ids follow the marked instances.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.schema import InstanceRecord, ObservationRecord
from avs3d_bench.submission import Prediction, frame_size
from baselines.oracle_errors import CONFUSABLE, ErrorModel

_HIGHEST_ID = 65_535


def scene_prediction(frame: Frame, *, category: bool, errors: ErrorModel) -> Prediction:
    """The prediction of the oracle for a frame of part_3.

    Args:
        frame: of any split; its truth is read.
        category: mark every instance of the categories that are audible in the frame, off-screen ones included; else
            the audible instances alone.
        errors: what goes wrong.

    Returns:
        mask and class ids; no class ids where the data has none.

    Raises:
        Avs3dError: if a file of the dataset is damaged.
    """
    observation = frame.observation
    if errors.happens("drop", observation.key, frame.name):
        empty = np.zeros(frame_size(frame), np.uint8)
        return Prediction(empty > 0, empty)
    if category or errors.swap or errors.confuse:
        ids = paint(frame.instance_ids(), _marked(frame, category=category, errors=errors))
        return Prediction(*_outlined(ids > 0, ids, errors))
    mask = frame.mask()
    if not (observation.path / layout.CATEGORY_MASKS).is_dir():
        return Prediction(errors.outline(mask))
    return Prediction(*_outlined(mask, frame.category_mask(), errors))


def paint(instances: NDArray[np.uint16], classes: Mapping[int, int]) -> NDArray[np.uint8]:
    """(H, W) class ids of the instances that ``classes`` names (id → class id), 0 elsewhere."""
    colours = np.zeros(_HIGHEST_ID + 1, np.uint8)
    for number, value in classes.items():
        colours[number] = value
    return colours[instances]


def _outlined(
    mask: NDArray[np.bool_], ids: NDArray[np.uint8], errors: ErrorModel
) -> tuple[NDArray[np.bool_], NDArray[np.uint8]]:
    """Mask and class ids with their outlines moved; where grown classes meet, the lower id has the new pixels."""
    moved = errors.outline(mask)
    grown = np.where(moved, ids, 0).astype(np.uint8)
    for value in np.unique(ids[ids > 0]) if errors.dilate > 0 else ():
        grown[errors.outline(ids == value) & (grown == 0)] = value
    return moved, grown


def _marked(frame: Frame, *, category: bool, errors: ErrorModel) -> dict[int, int]:
    """Id → class id of the instances that the oracle marks in a frame."""
    observation, record, entry = frame.observation, frame.observation.record, frame.record
    if record is None or entry is None:
        raise UsageError(f"{observation.path}: no {layout.OBSERVATION_JSON}; only --instance sounding works there")
    ids = record.class_ids
    heard = record.audible_instances(entry)
    if category:
        audible = {record.source(one.source).category for one in entry.audible or ()}
        chosen = [instance.id for instance in record.instances if instance.category in audible]
    else:
        swapped = _swaps(observation, record, errors)
        chosen = [swapped.get(number, number) for number in heard]
    categories = {instance.id: instance.category for instance in record.instances}
    marked = {number: ids[categories[number]] for number in chosen}
    if heard and (mistaken := _neighbour(observation, record, errors)):
        neighbour, sounding = mistaken
        marked.setdefault(neighbour.id, ids[sounding.category])
    return marked


def _swaps(observation: Observation, record: ObservationRecord, errors: ErrorModel) -> dict[int, int]:
    """Sounding instance → the silent twin that is taken for it, in all frames; no twin is taken twice."""
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
    return frozenset(
        number for frame in observation.frames for number in np.unique(frame.instance_ids()).tolist() if number
    )


def _neighbour(
    observation: Observation, record: ObservationRecord, errors: ErrorModel
) -> tuple[InstanceRecord, InstanceRecord] | None:
    """(neighbour, the sounding instance that it is mistaken for): the likeliest category, then the nearest."""
    if not errors.confuse or not errors.happens("confuse", observation.key):
        return None
    sounding = record.sounding_instances
    categories = {instance.category for instance in sounding}
    pairs = [(other, one) for other in record.instances if other.category not in categories for one in sounding]

    def rank(pair: tuple[InstanceRecord, InstanceRecord]) -> tuple[int, float, int, int]:
        other, one = pair
        likely = CONFUSABLE.get(one.category, ())
        similarity = likely.index(other.category) if other.category in likely else len(CONFUSABLE)
        distance = float(np.linalg.norm(np.mean(other.bounds, axis=0) - np.mean(one.bounds, axis=0)))
        return similarity, distance, other.id, one.id

    return min(pairs, key=rank) if pairs else None
