"""The counts of one frame: of the prediction and of the reference predictions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.measures.centre_box import centre_box
from evaluators.metrics.contour import Contour, boundary_f, contour
from evaluators.metrics.masks import U8, FrameCounts, frame_counts


@dataclass(frozen=True)
class Twin:
    """A silent instance of the sounding category in one frame.

    Attributes:
        visible: its visible pixels.
        covered: how many of them are marked.
    """

    visible: int
    covered: int

    @property
    def marked(self) -> bool:
        """Whether the prediction covers more than half of what is visible of it."""
        return 2 * self.covered > self.visible


@dataclass(frozen=True)
class FrameFigures:
    """The counts of one prediction in one frame.

    Attributes:
        counts: pixels.
        boundary_f: None where the object is not visible, or where it was not asked for.
        twins: the silent twins visible in the frame; None where nothing is known about twins.
    """

    counts: FrameCounts
    boundary_f: float | None = None
    twins: tuple[Twin, ...] | None = None

    @property
    def twins_marked(self) -> int:
        """How many silent twins the prediction marks."""
        return sum(twin.marked for twin in self.twins or ())


@dataclass(frozen=True)
class Truth:
    """The truth of one frame.

    Attributes:
        mask: (H, W) uint8, non-zero where the sounding object is visible.
        twins: id → (H, W) uint8 mask of the silent twins that are visible, in the order of ids asked for; None where
            nothing is known about twins.
        contour: the outline of ``mask``; None where the protocol asks for none or the mask is empty.
    """

    mask: U8
    twins: Mapping[int, U8] | None
    contour: Contour | None

    @classmethod
    def of(cls, mask: U8, ids: NDArray[np.uint16] | None, twin_ids: Iterable[int], *, outlines: bool) -> Truth:
        """From the mask and, where there are any, the instance ids (H, W) of the frame.

        Args:
            mask: (H, W) uint8.
            ids: (H, W) uint16, or None where the data has none.
            twin_ids: ids of the silent instances of the sounding category.
            outlines: whether boundaries are asked for.
        """
        twins = None
        if ids is not None:
            masks = ((number, (ids == number).view(np.uint8)) for number in twin_ids)
            twins = {number: twin for number, twin in masks if cv2.countNonZero(twin)}
        visible = outlines and cv2.countNonZero(mask) > 0
        return cls(mask, twins, contour(mask) if visible else None)


def frame_figures(truth: Truth, prediction: U8) -> FrameFigures:
    """The figures of a prediction, (H, W) uint8, non-zero where marked.

    Raises:
        Avs3dError: if it has another shape than the truth.
    """
    counts = frame_counts(truth.mask, prediction)
    outline = boundary_f(truth.contour, contour(prediction)) if truth.contour is not None else None
    return FrameFigures(counts, outline, _twins(truth, prediction))


def truth_figures(truth: Truth) -> FrameFigures:
    """The figures of the truth as a prediction: `frame_figures(truth, truth.mask)` without looking for its outline."""
    visible = cv2.countNonZero(truth.mask)
    outline = None if truth.contour is None else 1.0
    return FrameFigures(FrameCounts(truth.mask.size, visible, visible, visible), outline, _twins(truth, truth.mask))


def _twins(truth: Truth, prediction: U8) -> tuple[Twin, ...] | None:
    if truth.twins is None:
        return None
    masks = truth.twins.values()
    return tuple(Twin(cv2.countNonZero(twin), cv2.countNonZero(cv2.min(twin, prediction))) for twin in masks)


@lru_cache(maxsize=4)
def _box(height: int, width: int) -> tuple[U8, Contour]:
    mask = np.zeros((height, width), np.uint8)
    mask[centre_box(height, width)] = 255
    return mask, contour(mask)


def reference_figures(truth: Truth) -> dict[str, FrameFigures]:
    """The figures of the predictions all black, all white and centre box, without making the first two."""
    pixels, visible = truth.mask.size, cv2.countNonZero(truth.mask)
    twins = None if truth.twins is None else [cv2.countNonZero(twin) for twin in truth.twins.values()]

    def uniform(marked: bool) -> FrameFigures:
        counts = FrameCounts(pixels, visible, pixels * marked, visible * marked)
        found = None if twins is None else tuple(Twin(size, size * marked) for size in twins)
        # A uniform mask has no boundary.
        outline = None if truth.contour is None else float(truth.contour.length == 0)
        return FrameFigures(counts, outline, found)

    box, box_contour = _box(*truth.mask.shape)
    rows, columns = centre_box(*truth.mask.shape)
    inside = cv2.countNonZero(np.ascontiguousarray(truth.mask[rows, columns]))
    box_area = (rows.stop - rows.start) * (columns.stop - columns.start)
    outline = None if truth.contour is None else boundary_f(truth.contour, box_contour)
    return {
        "all_black": uniform(False),
        "all_white": uniform(True),
        "centre_box": FrameFigures(FrameCounts(pixels, visible, box_area, inside), outline, _twins(truth, box)),
    }


def visible_only(frames: Sequence[FrameFigures]) -> list[FrameFigures]:
    """The frames in which the object is visible."""
    return [frame for frame in frames if frame.counts.truth]
