"""Siblings of a group side by side in a report: the same picture, and under each what sounds, truth and prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avs3d_bench.dataset import Dataset
from evaluators.metrics.masks import frame_counts
from evaluators.metrics.pairs import is_right
from evaluators.reading.records import SiblingFrame, Submission
from evaluators.reporting.pictures import (
    SMALL,
    Picture,
    error_picture,
    error_words,
    frame_of,
    picture,
    read_masks,
    resized,
)
from evaluators.reporting.sounds import sounds_in


@dataclass(frozen=True)
class SiblingCell:
    """One sibling in one frame.

    Attributes:
        key: of the observation.
        sounds: what is audible in the frame, in words.
        picture: hit, missed and false pixels, with the outline of the truth.
        right: whether the prediction is right by itself.
        note: what went on, in a few words.
    """

    key: str
    sounds: str
    picture: Picture
    right: bool
    note: str


@dataclass(frozen=True)
class Siblings:
    """A group in one frame.

    Attributes:
        shown: which group and frame.
        frame: the camera's picture, the same for all siblings.
        siblings: in the order of their keys.
    """

    shown: SiblingFrame
    frame: Picture
    siblings: tuple[SiblingCell, ...]


def draw_siblings(shown: SiblingFrame, dataset: Dataset, submission: Submission) -> Siblings:
    """Draw the pictures of a frame of a group.

    Raises:
        Avs3dError: if a picture cannot be read, or a mask has another size than the frame.
    """
    frames = [frame_of(dataset, key, shown.name) for key in shown.keys]
    rgb = frames[0].rgb()
    siblings = []
    for frame in frames:
        key = frame.observation.key
        truth, prediction = read_masks(frame, submission, rgb)
        counts = frame_counts(truth.view(np.uint8), prediction.view(np.uint8))
        sounds = sounds_in(frame)
        alt = f"{key}, {frame.name}: {sounds}; {error_words(truth, prediction)}"
        drawn = picture(error_picture(rgb, truth, prediction, [], SMALL), alt)
        if counts.truth:
            note = f"IoU {counts.overlap / counts.union:.2f}"
        else:
            note = "nothing to mark" + (f", {counts.predicted:,} pixels marked" if counts.predicted else "")
        siblings.append(SiblingCell(key, sounds, drawn, is_right(counts), note))
    alt = f"Camera frame {shown.name}, the same for all siblings of {shown.group}"
    return Siblings(shown, picture(resized(rgb, SMALL), alt), tuple(siblings))
