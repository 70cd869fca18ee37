"""Deaf reference submissions: true masks of instances of the sounding category, chosen without any sound.

    deaf_category   every visible instance of the sounding category is marked
    deaf_most_seen  of these instances, the one with the most visible pixels over the test frames is marked

They show whether a score is evidence of listening: a method that segments perfectly gets as much without a sound.
Where the sounding object is the only instance of its category, both mark the truth. They need the instances and their
categories (`observation.json`) and, where there are several, `instance_masks/` of the test frames and no others.

Under ``listen`` (part_3) the references are the deaf oracles of `avs3d_bench.measures.deaf_oracles`, the same for all
siblings of a group: `DeafOracles` counts them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.scores import DEAF_ORACLES
from avs3d_bench.measures.deaf_oracles import Table, best_single, instance_table
from evaluators.metrics.classes import Confusion
from evaluators.metrics.frames import FrameFigures, Truth, Twin, frame_figures, truth_figures
from evaluators.metrics.masks import FrameCounts


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


@dataclass
class DeafOracles:
    """Counts the deaf oracles of a group of siblings, frame by frame.

    Attributes:
        instances: id of an instance that can sound → its class id.
        labels: the highest label of the truths that `add` gets: class ids, or 1 for masks.
        tables: of each frame that was added, one `instance_table` per sibling.
    """

    instances: Mapping[int, int]
    labels: int
    tables: list[list[Table]] = field(default_factory=list)

    def add(self, ids: NDArray[np.uint16], truths: Sequence[NDArray[np.uint8]]) -> None:
        """Count a frame.

        Args:
            ids: (H, W) its instance ids, the same for all siblings.
            truths: of each sibling, (H, W) labels of what is audible and visible.
        """
        numbers = tuple(self.instances)
        self.tables.append([instance_table(ids, numbers, truth, self.labels) for truth in truths])

    def rows(self) -> dict[str, list[int]]:
        """Name of the oracle → rows of the tables that it marks."""
        chosen = best_single(table for frame in self.tables for table in frame)
        found = (list(range(1, len(self.instances) + 1)), [] if chosen is None else [chosen])
        return dict(zip(DEAF_ORACLES, found, strict=True))

    def counts(self, rows: Sequence[int]) -> list[list[FrameCounts]]:
        """For each frame and sibling, the counts of marking the instances of ``rows``."""
        return [[_table_counts(table, rows) for table in frame] for frame in self.tables]

    def classes(self, rows: Sequence[int], count: int) -> list[Confusion]:
        """Of each sibling, pixels by true and predicted class (1 + count, 1 + count), over all frames."""
        ids = (0, *self.instances.values())
        out = []
        for frames in zip(*self.tables, strict=True):
            found = np.zeros((count + 1, count + 1), np.int64)
            for row, pixels in enumerate(np.sum(frames, axis=0)):
                found[:, ids[row] if row in rows else 0] += pixels
            out.append(found)
        return out


def _table_counts(table: Table, rows: Sequence[int]) -> FrameCounts:
    marked = table[list(rows)]
    return FrameCounts(int(table.sum()), int(table[:, 1:].sum()), int(marked.sum()), int(marked[:, 1:].sum()))
