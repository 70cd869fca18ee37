"""Figures of what the network sees: IoU of classes over all pixels, average precision of frames that show the sound."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from avs3d_bench.contract.taxonomy import CATEGORIES
from benchmarks.listener_classes import ClassFigures

CLOCK, TOILET = (CATEGORIES.index(name) for name in ("clock", "toilet"))


def frame(clock: slice, *, sounds: bool) -> Any:
    """A frame of 8 × 8 with a clock in some columns, and a toilet, behind something, in none."""
    ids = np.zeros((8, 8), np.uint16)
    ids[:, clock] = 1
    instances = [SimpleNamespace(id=1, category="clock"), SimpleNamespace(id=2, category="toilet")]
    record = SimpleNamespace(instances=instances)
    return SimpleNamespace(
        instance_ids=lambda: ids, mask=lambda: (ids == 1) & sounds, observation=SimpleNamespace(record=record)
    )


def says(clock: slice) -> np.ndarray[Any, np.dtype[np.float32]]:
    """(8, 8, 8) probabilities of a network that sees a clock in some columns."""
    classes = np.zeros((1 + len(CATEGORIES), 8, 8), np.float32)
    classes[0] = 0.6
    classes[1 + CLOCK][:, clock] = 0.9
    return classes


def test_iou_of_a_class_is_over_the_pixels_of_all_frames() -> None:
    found = ClassFigures()
    nothing = np.zeros((8, 8), np.float32)
    found.add(says(slice(0, 4)), nothing, frame(slice(0, 4), sounds=False))  # all 32 pixels
    found.add(says(slice(0, 2)), nothing, frame(slice(1, 3), sounds=False))  # 8 of 24
    summary = found.summary()
    assert summary["class_iou"]["clock"] == round((32 + 8) / (32 + 24), 4)
    assert summary["class_iou"]["toilet"] is None  # neither there nor seen
    assert summary["average_precision"] is None


def test_average_precision_is_of_frames_that_show_what_sounds() -> None:
    found = ClassFigures()
    right = np.zeros((8, 8), np.float32)
    right[:, :4] = 0.3  # below any usual threshold, and yet the ranking is right
    found.add(says(slice(0, 4)), right, frame(slice(0, 4), sounds=True))
    found.add(says(slice(0, 4)), 1 - right, frame(slice(0, 4), sounds=True))  # 32 true pixels below 32 others
    found.add(says(slice(0, 4)), right, frame(slice(0, 4), sounds=False))
    assert found.summary()["frames_with_sound_in_view"] == 2
    assert found.summary()["average_precision"] == 0.75
