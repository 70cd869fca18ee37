"""Figures of masks, as pure functions of counted pixels.

Every figure of a frame but the boundary's follows from four counts (`FrameCounts`), so a frame is looked at once,
whatever is computed from it. Protocols: `evaluators.protocols`. Means over observations: `evaluators.summary`. Formulas
with worked examples: docs/metrics.md.

`official_miou` and `official_f` equal the released scoring (that of AVSBench: Zhou et al., "Audio-Visual
Segmentation", ECCV 2022), to 1e-6. Its F sweeps 255 thresholds over the sigmoid of the prediction; of a binary mask the
sigmoid has two values, 0.5 and 0.731, so the sweep has two levels: everything marked (thresholds up to 0.5), and the
mask itself (up to 0.731). Above, nothing is marked and F is 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError

U8 = NDArray[np.uint8]
Ints = NDArray[np.int64]

#: β² = 3/10 of the F-measure: precision weighs more (Achanta et al. 2009, and AVSBench). Whole numbers keep F exact.
_BETA_SQUARED = (3, 10)
#: The released IoU adds this to the union.
_EPSILON = 1e-7


@dataclass(frozen=True)
class FrameCounts:
    """Pixels of a frame.

    Attributes:
        pixels: of the image, N.
        truth: where the sounding object is visible, |G|.
        predicted: marked, |P|.
        overlap: both, |P ∩ G|.

    Examples:
        >>> FrameCounts(pixels=32, truth=8, predicted=7, overlap=6).union
        9
    """

    pixels: int
    truth: int
    predicted: int
    overlap: int

    @property
    def union(self) -> int:
        """|P ∪ G|."""
        return self.truth + self.predicted - self.overlap


def as_bytes(mask: NDArray[np.bool_] | U8) -> U8:
    """The mask as (H, W) uint8, non-zero where marked; nothing is copied."""
    return mask.view(np.uint8) if mask.dtype == np.bool_ else mask.astype(np.uint8, copy=False)


def frame_counts(truth: NDArray[np.bool_] | U8, prediction: NDArray[np.bool_] | U8) -> FrameCounts:
    """Count the pixels of a frame.

    Args:
        truth: (H, W) bool, or uint8 with one non-zero value.
        prediction: likewise, of the same shape.

    Raises:
        Avs3dError: if the shapes differ.

    Examples:
        >>> frame_counts(np.eye(4, dtype=bool), np.ones((4, 4), bool))
        FrameCounts(pixels=16, truth=4, predicted=16, overlap=4)
    """
    if truth.shape != prediction.shape or truth.ndim != 2:
        raise Avs3dError(f"the prediction has shape {prediction.shape}, expected that of the truth, {truth.shape}")
    g, p = as_bytes(truth), as_bytes(prediction)
    # The smaller of two values is zero unless both are marked, whatever value stands for marked.
    both = cv2.countNonZero(cv2.min(g, p))
    return FrameCounts(g.size, cv2.countNonZero(g), cv2.countNonZero(p), both)


def iou(frame: FrameCounts) -> float:
    """|P ∩ G| / |P ∪ G|.

    Raises:
        ZeroDivisionError: if truth and prediction are both empty.

    Examples:
        >>> iou(FrameCounts(pixels=32, truth=8, predicted=7, overlap=6)) == 6 / 9
        True
    """
    return frame.overlap / frame.union


def f_measure(frame: FrameCounts) -> float:
    """(1 + β²) p r / (β² p + r) of the mask as given, with p = |P ∩ G| / |P| and r = |P ∩ G| / |G|; 0 without overlap.

    Multiplied out, (1 + β²) |P ∩ G| / (β² |G| + |P|).

    Examples:
        >>> f_measure(FrameCounts(pixels=32, truth=8, predicted=7, overlap=6)) == 7.8 / 9.4
        True
    """
    if frame.overlap == 0:
        return 0.0
    three, ten = _BETA_SQUARED
    return (ten + three) * frame.overlap / (three * frame.truth + ten * frame.predicted)


def mean(values: Iterable[float]) -> float | None:
    """Plain mean, None of nothing; exactly rounded, so that the order does not matter.

    Examples:
        >>> mean([0.1] * 10), mean([])
        (0.1, None)
    """
    numbers = list(values)
    return math.fsum(numbers) / len(numbers) if numbers else None


def official_miou(frames: Sequence[FrameCounts]) -> float:
    """The released mIoU of an observation.

    A frame with an empty truth scores the share of pixels left unmarked; the others score their IoU.

    Raises:
        Avs3dError: if there is no frame.

    Examples:
        >>> round(official_miou([FrameCounts(32, 8, 7, 6), FrameCounts(32, 0, 2, 0)]), 4)
        0.8021
    """
    scores = []
    for frame in frames:
        if frame.truth:
            scores.append(frame.overlap / (frame.union + _EPSILON))
        else:
            scores.append((frame.pixels - frame.predicted) / (frame.pixels + _EPSILON))
    value = mean(scores)
    if value is None:
        raise Avs3dError("no frame to score: expected at least one test frame")
    return value


def official_f(frames: Sequence[FrameCounts]) -> float:
    """The released F of an observation: the better of two means over the frames whose truth is not empty.

    One is the F of the mask, the other that of an all-white mask, 1.3 p / (0.3 p + 1) with p the object's share of the
    image. No such frame: 0.

    Raises:
        Avs3dError: if there is no frame at all.

    Examples:
        >>> round(official_f([FrameCounts(pixels=32, truth=8, predicted=0, overlap=0)]), 4)  # that of an all-white mask
        0.3023
    """
    if not frames:
        raise Avs3dError("no frame to score: expected at least one test frame")
    return best_mean_f(
        np.array([frame.truth for frame in frames]),
        np.array([(frame.pixels, frame.predicted) for frame in frames]),
        np.array([(frame.truth, frame.overlap) for frame in frames]),
    )


def best_mean_f(truth: Ints, predicted: Ints, overlap: Ints) -> float:
    """The F of AVSBench's code: at each threshold the mean over frames, then the best of these means.

    Frames with an empty truth are left out; 0 if there is no other. Means are exactly rounded: the order of frames
    changes nothing.

    Args:
        truth: (N,) true pixels of each frame, |G|.
        predicted: (N, L) marked pixels at each of L thresholds, |P|.
        overlap: (N, L) both, |P ∩ G|.
    """
    seen = truth > 0
    if not seen.any():
        return 0.0
    three, ten = _BETA_SQUARED
    both = overlap[seen]
    # As `f_measure`; the denominator is above 0 where the truth is not empty.
    scores = (ten + three) * both / (three * truth[seen, None] + ten * predicted[seen])
    return max(math.fsum(column) / len(column) for column in scores.T.tolist())


def mask_figures(frames: Iterable[FrameCounts]) -> dict[str, float | None]:
    """The figures that need only counts, as protocols ``strict`` and ``listen`` define them.

    Returns:
        IoU and F (β² = 0.3), means over the frames whose truth is not empty; FP_rate and FP_area, the share of frames
        with a mark and the mean share of marked pixels over the others. None where there is no such frame.
    """
    visible: list[FrameCounts] = []
    absent: list[FrameCounts] = []
    for frame in frames:
        (visible if frame.truth else absent).append(frame)
    return {
        "IoU": mean(iou(frame) for frame in visible),
        "F": mean(f_measure(frame) for frame in visible),
        "FP_rate": mean(float(frame.predicted > 0) for frame in absent),
        "FP_area": mean(frame.predicted / frame.pixels for frame in absent),
    }
