"""IoU of categories: from the pixels of predicted and true class ids, summed over the frames of an observation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError

#: Pixels by true (row) and predicted (column) class id; 0 is nothing.
Confusion = NDArray[np.int64]


def confusion(truth: NDArray[np.uint8], prediction: NDArray[np.uint8], count: int) -> Confusion:
    """Count the pixels of a frame by true and predicted class id.

    Args:
        truth: (H, W) class ids, 0 … ``count``.
        prediction: likewise, of the same shape.
        count: the highest class id.

    Returns:
        (1 + count, 1 + count) int64.

    Raises:
        Avs3dError: if the shapes differ or an id is above ``count``.
    """
    if truth.shape != prediction.shape:
        raise Avs3dError(f"the prediction has shape {prediction.shape}, expected that of the truth, {truth.shape}")
    highest = max(int(truth.max(initial=0)), int(prediction.max(initial=0)))
    if highest > count:
        raise Avs3dError(f"class id {highest}, expected at most {count}")
    cells = np.bincount((truth.astype(np.intp) * (count + 1) + prediction).ravel(), minlength=(count + 1) ** 2)
    return cells.reshape(count + 1, count + 1).astype(np.int64)


def class_ious(counts: Confusion, first: int = 1) -> dict[int, float]:
    """Class id → IoU, of every class that occurs in truth or prediction.

    Args:
        counts: of `confusion`, summed over frames.
        first: the lowest id that is a class: those below stand for nothing.
    """
    both = np.diagonal(counts)
    union = counts.sum(axis=1) + counts.sum(axis=0) - both
    return {number: float(both[number] / union[number]) for number in range(first, len(counts)) if union[number]}
