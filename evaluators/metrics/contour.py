"""How well outlines agree: the boundary F-measure.

After Martin, Fowlkes, Malik, "Learning to detect natural image boundaries", PAMI 2004, in the form of Perazzi et al.,
"A benchmark dataset and evaluation methodology for video object segmentation", CVPR 2016 (DAVIS): a boundary pixel
counts as found if the other mask has a boundary pixel within 0.8 % of the image diagonal. Distances here are
Euclidean and exact, and the image's edge is no boundary: an object that it cuts off ends there in truth and prediction
alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from evaluators.metrics.masks import U8

#: Tolerance, as a share of the image diagonal.
TOLERANCE = 0.008
#: Largest tolerance (pixels) for which dilating by a disc is faster than a distance transform; both are exact.
DISC_LIMIT = 20
_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def tolerance(height: int, width: int) -> int:
    """Tolerance in pixels, rounded up: 12 at 1008²."""
    return math.ceil(TOLERANCE * math.hypot(height, width))


def _dilate(boundary: U8, reach: int) -> U8:
    """(h, w) uint8: non-zero where a non-zero pixel lies within ``reach`` pixels, in Euclidean distance.

    The disc is a union of rows, the widest in its middle: each row follows from the next narrower one, which takes
    half as long as a dilation by the disc as a whole.
    """
    height = boundary.shape[0]
    near, wide, width = boundary.copy(), boundary, 0
    for away in range(reach, -1, -1):
        half = math.isqrt(reach**2 - away**2)
        if half > width:
            wide = np.asarray(cv2.dilate(wide, np.ones((1, 2 * (half - width) + 1), np.uint8)), np.uint8)
        width = half
        if away < height:
            cv2.max(near[away:], wide[: height - away], dst=near[away:])
            cv2.max(near[: height - away], wide[away:], dst=near[: height - away])
    return near


@dataclass(frozen=True, eq=False)
class Contour:
    """The boundary of a mask and its surroundings, cropped to where they are.

    Attributes:
        top: row of the crop's first pixel in the image.
        left: its column.
        boundary: (h, w) uint8, 255 on boundary pixels, 0 elsewhere.
        length: number of boundary pixels.
        reach: the tolerance, pixels.
    """

    top: int
    left: int
    boundary: U8
    length: int
    reach: int

    @cached_property
    def near(self) -> U8:
        """(h, w) uint8, non-zero within the tolerance of a boundary pixel. Costs the most of all, so only on demand."""
        if self.reach <= DISC_LIMIT:
            return _dilate(self.boundary, self.reach)
        distance = cv2.distanceTransform(cv2.bitwise_not(self.boundary), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        # Squared distances are whole numbers: half a thousandth decides no tie.
        return (distance < self.reach + 5e-4).view(np.uint8)


_EMPTY = Contour(0, 0, np.zeros((0, 0), np.uint8), 0, 0)


def contour(mask: U8) -> Contour:
    """The boundary of a mask: its pixels with a 4-neighbour inside the image that is not marked.

    Args:
        mask: (H, W) uint8, 0 and one other value.

    Examples:
        >>> mask = np.zeros((9, 9), np.uint8)
        >>> mask[2:7, 2:7] = 1
        >>> contour(mask).length
        16
    """
    left, top, width, height = cv2.boundingRect(mask)
    if width == 0:
        return _EMPTY
    reach = tolerance(*mask.shape)
    top, bottom = max(0, top - reach), min(mask.shape[0], top + height + reach)
    left, right = max(0, left - reach), min(mask.shape[1], left + width + reach)
    crop = mask[top:bottom, left:right]
    # Beyond its border OpenCV erodes nothing: there the crop ends with the image (or has zeros within).
    inside = cv2.erode(crop, _CROSS)
    away = cv2.compare(crop, inside, cv2.CMP_EQ)  # 0 on the boundary, 255 elsewhere
    length = away.size - cv2.countNonZero(away)
    if length == 0:
        return _EMPTY
    return Contour(top, left, np.asarray(cv2.bitwise_not(away), np.uint8), length, reach)


def found(of: Contour, by: Contour) -> int:
    """How many boundary pixels of one contour lie near the other."""
    top, left = max(of.top, by.top), max(of.left, by.left)
    bottom = min(of.top + of.boundary.shape[0], by.top + by.boundary.shape[0])
    right = min(of.left + of.boundary.shape[1], by.left + by.boundary.shape[1])
    if bottom <= top or right <= left:
        return 0
    mine = of.boundary[top - of.top : bottom - of.top, left - of.left : right - of.left]
    there = slice(top - by.top, bottom - by.top), slice(left - by.left, right - by.left)
    # A pixel of both boundaries is near without a look at distances; often that is all of them.
    if cv2.countNonZero(cv2.min(mine, by.boundary[there])) == of.length:
        return of.length
    return cv2.countNonZero(cv2.min(mine, by.near[there]))


def boundary_f(truth: Contour, prediction: Contour) -> float:
    """2pr / (p + r): p the share of predicted boundary pixels near a true one, r the other way round.

    1 where both have no boundary, 0 where only one has.

    Examples:
        >>> mask = np.zeros((9, 9), np.uint8)
        >>> mask[2:7, 2:7] = 1
        >>> boundary_f(contour(mask), contour(np.roll(mask, 1, axis=1)))  # one pixel is within the tolerance
        1.0
    """
    if truth.length == 0 or prediction.length == 0:
        return float(truth.length == prediction.length)
    precision = found(prediction, truth) / prediction.length
    recall = found(truth, prediction) / truth.length
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0
