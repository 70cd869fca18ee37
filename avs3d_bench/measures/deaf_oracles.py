"""Deaf oracles of part_3 observations: predictions made of true instance masks, the same for all siblings of a group.

    deaf_all     every visible instance that can sound is marked
    deaf_single  one instance is marked: the one with the highest mean IoU over the frames of all siblings in which
                 something audible is visible

The siblings of a group differ in sound alone, so that a method that does not use the sound gives the same answer to
all of them. The oracles are two such answers, made of perfect masks; ``deaf_single`` is chosen with the truth. The
evaluator prints their scores as reference rows, `avs3d baseline oracle --deaf` writes them as submissions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord, ObservationRecord
from avs3d_bench.dataset import Frame
from avs3d_bench.errors import Avs3dError

#: Pixels per instance and label; see `instance_table`.
Table = NDArray[np.int64]
_HIGHEST_ID = 65_535


def can_sound(record: ObservationRecord) -> tuple[InstanceRecord, ...]:
    """The instances of a category that can sound, whether they sound here or not, by id: all but distractors."""
    found = (instance for instance in record.instances if instance.category in record.class_ids)
    return tuple(sorted(found, key=lambda instance: instance.id))


def instance_ids_of(frame: Frame, size: tuple[int, int]) -> NDArray[np.uint16]:
    """(H, W) instance ids of a frame.

    Args:
        frame: to read.
        size: (height, width) of its masks.

    Raises:
        Avs3dError: if the file is missing, damaged or of another size.
    """
    ids = frame.instance_ids()
    if ids.shape != size:
        path = frame.path(layout.INSTANCE_MASKS)
        raise Avs3dError(f"{path}: shape {ids.shape}, expected that of the mask, {size}; regenerate the dataset")
    return ids


def instance_table(ids: NDArray[np.uint16], numbers: Sequence[int], labels: NDArray[np.uint8], count: int) -> Table:
    """Count the pixels of a frame by instance and label.

    Args:
        ids: (H, W) instance ids, 0 where there is none.
        numbers: the ids to count.
        labels: (H, W) truth: 0 for nothing, else at most ``count``; with ``count`` 1 a mask of 0 and 1.
        count: the highest label.

    Returns:
        (1 + len(numbers), 1 + count): row 0 counts the pixels of everything else, row i those of ``numbers[i - 1]``;
        column 0 the pixels without truth.

    Raises:
        Avs3dError: if the shapes differ or a label is above ``count``.
    """
    if ids.shape != labels.shape:
        raise Avs3dError(f"instance ids have shape {ids.shape}, expected that of the truth, {labels.shape}")
    if labels.max(initial=0) > count:
        raise Avs3dError(f"the truth holds the label {labels.max()}, expected at most {count}")
    rows = np.zeros(_HIGHEST_ID + 1, np.intp)
    rows[list(numbers)] = np.arange(1, len(numbers) + 1)
    cells = np.bincount((rows[ids] * (count + 1) + labels).ravel(), minlength=(len(numbers) + 1) * (count + 1))
    return cells.reshape(len(numbers) + 1, count + 1).astype(np.int64)


def best_single(tables: Iterable[Table]) -> int | None:
    """Row of the instance with the highest mean IoU over the frames with a truth.

    Args:
        tables: one of `instance_table` for each test frame of each sibling of a group, all for the same instances.

    Returns:
        The row, from 1 on; the first of equals; None if no frame has a truth, or there is no instance.
    """
    ious: list[NDArray[np.float64]] = []
    for table in tables:
        truth = int(table[:, 1:].sum())
        if truth and len(table) > 1:
            overlap = table[1:, 1:].sum(axis=1)
            ious.append(overlap / (table[1:].sum(axis=1) + truth - overlap))
    if not ious:
        return None
    # Exactly rounded sums: the order of frames and siblings does not matter.
    means = [math.fsum(values) / len(ious) for values in zip(*ious, strict=True)]
    return 1 + max(range(len(means)), key=lambda row: (means[row], -row))
