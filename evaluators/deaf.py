"""Deaf reference submissions: true masks of instances of the sounding category, chosen without any sound.

    deaf_category   every visible instance of the sounding category is marked
    deaf_most_seen  of these instances, the one with the most visible pixels over the test frames is marked

They show whether a score is evidence of listening: a method that segments perfectly gets as much without a sound.
Where the sounding object is the only instance of its category, both mark the truth. They need the instances and their
categories (`observation.json`) and, where there are several, `instance_masks/` of the test frames and no others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evaluators.frames import FrameFigures, Truth, Twin, frame_figures, truth_figures
from evaluators.metrics import FrameCounts


@dataclass(frozen=True)
class DeafFrame:
    """The figures of the deaf predictions of one frame.

    Attributes:
        category: of every visible instance of the category, marked together.
        single: id of a visible instance → the figures of marking it alone.
        nothing: of marking nothing.
    """

    category: FrameFigures
    single: Mapping[int, FrameFigures]
    nothing: FrameFigures


def deaf_frame(truth: Truth, sounding: int) -> DeafFrame:
    """The figures of one frame.

    Args:
        truth: of the frame, with its twins; no twins at all where the sounding object is the only instance.
        sounding: id of the sounding instance.
    """
    itself = truth_figures(truth)
    nothing = FrameFigures(
        FrameCounts(itself.counts.pixels, itself.counts.truth, 0, 0),
        None if truth.contour is None else float(truth.contour.length == 0),
        None if itself.twins is None else tuple(Twin(twin.visible, 0) for twin in itself.twins),
    )
    single = {sounding: itself} if itself.counts.truth else {}
    twins = truth.twins or {}
    if not twins:
        return DeafFrame(itself, single, nothing)
    single |= {number: frame_figures(truth, twin) for number, twin in twins.items()}
    together = truth.mask > 0
    for twin in twins.values():
        together |= twin > 0
    return DeafFrame(frame_figures(truth, together.view(np.uint8)), single, nothing)


def most_seen(frames: Sequence[DeafFrame]) -> int | None:
    """Id of the instance with the most visible pixels over the frames, the lowest of equals; None if none is seen."""
    visible: Counter[int] = Counter()
    for frame in frames:
        visible.update({number: figures.counts.predicted for number, figures in frame.single.items()})
    return min(visible, key=lambda number: (-visible[number], number)) if visible else None


def deaf_references(frames: Sequence[DeafFrame]) -> dict[str, list[FrameFigures]]:
    """Name of the reference → its figures, frame by frame.

    Args:
        frames: the test frames of one observation, all of them.
    """
    chosen = most_seen(frames)
    return {
        "deaf_category": [frame.category for frame in frames],
        "deaf_most_seen": [
            frame.nothing if chosen is None else frame.single.get(chosen, frame.nothing) for frame in frames
        ],
    }
