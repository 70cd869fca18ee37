"""The selection rule of OWOD-BIND as released: boxes, cut-outs, and the masks that are kept.

Pure functions of arrays; `run` puts the networks between them. The order is `keep_boxes`, `cut_out`, `softmax`,
`choose`, `union`.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from baselines.networks.pixels import Picture
from baselines.owod_bind.protocols import Detections, Mask

#: The released settings.
MIN_SCORE = 0.15
MAX_SIDE = 0.98
BLUR = 21
AUDIO_LOGIT_SCALE = 20.0
THRESHOLD = 0.2


def clip_boxes(detections: Detections, size: tuple[int, int]) -> Detections:
    """Boxes cut at the edges of a picture of ``size`` (height, width), without those that have less than a pixel left.

    A box of another form (NaN, right of its right edge) has nothing left either.
    """
    height, width = size
    boxes = np.clip(detections.boxes, 0.0, [width, height, width, height])
    sides = boxes[:, 2:] - boxes[:, :2]
    whole = (sides >= 1.0).all(axis=1) & np.isfinite(detections.scores)
    return Detections(boxes[whole], detections.scores[whole])


def keep_boxes(
    detections: Detections, size: tuple[int, int], *, min_score: float = MIN_SCORE, max_side: float = MAX_SIDE
) -> Detections:
    """The first box, and those with a score above ``min_score`` and both sides below ``max_side`` of the height.

    The released code's fallback (keep the first of the list if nothing is kept yet) stands inside the loop over
    detections. After the first detection something is therefore always kept: the first, whatever its score and size.

    Args:
        detections: of one picture, the likeliest first.
        size: (height, width) of the picture.
        min_score: strict.
        max_side: share of the picture's height, for both sides, strict: a box around everything is no object.

    Returns:
        Those, in order; none where there was none.
    """
    sides = (detections.boxes[:, 2:] - detections.boxes[:, :2]) / size[0]
    keep = (detections.scores > min_score) & (sides < max_side).all(axis=1)
    keep[:1] = True
    return detections.take(keep)


def suppress(detections: Detections, *, iou: float, at_most: int) -> Detections:
    """Greedy non-maximum suppression: of boxes that overlap by more than ``iou`` only the likeliest stays.

    Detectors with one box per patch (OWLv2) find every object many times; each copy would take its share of the
    softmax.

    Args:
        detections: in any order.
        iou: intersection over union.
        at_most: the number of boxes after which to stop.

    Returns:
        What stays, the likeliest first; of equal scores the earlier.
    """
    order = np.argsort(-detections.scores, kind="stable")
    boxes = detections.boxes[order]
    areas = (boxes[:, 2:] - boxes[:, :2]).clip(min=0.0).prod(axis=1)
    open_ = np.ones(len(boxes), dtype=np.bool_)
    kept: list[int] = []
    while open_.any() and len(kept) < at_most:
        best = int(open_.argmax())
        kept.append(best)
        low = np.maximum(boxes[best, :2], boxes[:, :2])
        high = np.minimum(boxes[best, 2:], boxes[:, 2:])
        shared = (high - low).clip(min=0.0).prod(axis=1)
        # As a product: boxes without area overlap nothing.
        open_ &= shared <= iou * (areas[best] + areas - shared)
        open_[best] = False
    return detections.take(order[kept])


def blur(picture: Picture, kernel: int = BLUR) -> Picture:
    """The picture under a Gaussian of ``kernel`` × ``kernel`` pixels (σ = 3.5 for 21, OpenCV's rule for the size)."""
    return np.asarray(cv2.GaussianBlur(picture, (kernel, kernel), 0), dtype=np.uint8)


def cut_out(picture: Picture, blurred: Picture, mask: Mask, box: NDArray[np.float64]) -> Picture:
    """The object in its box: sharp inside of the mask, blurred outside.

    Args:
        picture: (H, W, 3) uint8 RGB.
        blurred: what `blur` makes of it.
        mask: (H, W) bool.
        box: (4,) x0 y0 x1 y1 in pixels; rounded outwards.

    Returns:
        (h, w, 3) uint8 with h, w ≥ 1.
    """
    height, width = mask.shape
    x0, y0 = (min(max(math.floor(v), 0), limit - 1) for v, limit in zip(box[:2], (width, height), strict=True))
    x1, y1 = min(max(math.ceil(box[2]), x0 + 1), width), min(max(math.ceil(box[3]), y0 + 1), height)
    part = np.s_[y0:y1, x0:x1]
    return np.asarray(np.where(mask[part][..., None], picture[part], blurred[part]), dtype=np.uint8)


def softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scores (N,) of the proposals of one frame, from their logits (N,): positive, with the sum 1.

    Raises:
        Avs3dError: if a logit is not finite: the network or its input is broken.
    """
    if not np.isfinite(logits).all():
        raise Avs3dError("the similarity network gave numbers that are not finite; check its checkpoint and the clip")
    powers = np.exp(logits - logits.max(initial=-np.inf))
    return np.asarray(powers / powers.sum()) if len(powers) else powers


def choose(scores: NDArray[np.float64], threshold: float = THRESHOLD) -> NDArray[np.bool_]:
    """(N,) which of the proposals stay: a score above ``threshold`` (strict), so fewer than 1 / ``threshold`` of them.

    A lone proposal has the score 1. Of five or more that are all alike none stays: the mask is empty.
    """
    return np.asarray(scores > threshold)


def union(masks: NDArray[np.bool_], size: tuple[int, int]) -> Mask:
    """(H, W) where any of the masks (N, H, W) is; nothing for none."""
    return np.asarray(masks.any(axis=0)) if len(masks) else np.zeros(size, dtype=np.bool_)
