"""Figures of soft masks: counts at many thresholds, and average precision, which needs no threshold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluators.metrics.masks import Ints

Bools = NDArray[np.bool_]
Floats = NDArray[np.float32]


def counts_at(thresholds: Floats, truth: Bools, probability: Floats) -> tuple[Ints, Ints]:
    """Pixels at or above each threshold, and how many of them are true.

    Args:
        thresholds: (L,) ascending.
        truth: (H, W).
        probability: (H, W), without NaN.

    Returns:
        |P| and |P ∩ G|, (L,) each.
    """
    reached = np.searchsorted(thresholds, probability.ravel(), side="right")
    bins = len(thresholds) + 1
    per_level = np.bincount(reached, minlength=bins), np.bincount(reached[truth.ravel()], minlength=bins)
    # A pixel that reaches k thresholds counts at the first k.
    predicted, overlap = (np.cumsum(counts[::-1])[::-1][1:].astype(np.int64) for counts in per_level)
    return predicted, overlap


def average_precision(truth: Bools, probability: Floats) -> float:
    """Area below the curve of precision over recall, as steps: Σ (rₖ − rₖ₋₁) pₖ over falling probabilities.

    Pixels of the same probability form one step, so that their order changes nothing. The definition of scikit-learn's
    `average_precision_score`.

    Args:
        truth: (H, W) bool, not empty.
        probability: (H, W) float32; any increasing function of it gives the same figure.

    Returns:
        In [0, 1]; of a constant prediction the object's share of the image.

    Raises:
        ZeroDivisionError: if the truth is empty.

    Examples:
        >>> truth = np.array([[True, False], [True, False]])
        >>> average_precision(truth, np.array([[0.9, 0.1], [0.6, 0.2]], np.float32))
        1.0
        >>> average_precision(truth, np.full((2, 2), 0.3, np.float32))
        0.5
    """
    values, positives = np.sort(probability, axis=None), np.sort(probability[truth])
    if positives.size == 0:
        raise ZeroDivisionError("average precision of an empty truth")
    # The same sum by true pixels: the mean of the precision at the probability of each.
    found = positives.size - np.searchsorted(positives, positives)
    marked = values.size - np.searchsorted(values, positives)
    return float(np.mean(found / marked))
