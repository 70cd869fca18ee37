"""Measurements of a finished walk for each candidate, and the notes on relaxed constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.core.curves import arc_length
from generators.core.freespace import FreeSpace
from generators.paths import gaze
from generators.paths.gaze import Sight, Views
from generators.paths.tours import horizontal_distance, spread_degrees

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CandidateReport:
    """Views of one candidate along a walk.

    Attributes:
        look_share: share of frames in which it is looked at (in line of sight, its middle inside the image).
        view_share: share of frames with any part of it in the image.
        left_share, right_share: shares of frames in which it is at least 20° to the left, or to the right.
        filled_tests, empty_tests: numbers of test frames (index % 8 == 0) with and without it in the image.
        distance: mean horizontal distance to it, metres.
        spread: angular width of the viewing positions, seen from the candidate, degrees.
    """

    look_share: float
    view_share: float
    left_share: float
    right_share: float
    filled_tests: int
    empty_tests: int
    distance: float
    spread: float

    @classmethod
    def of(cls, sight: Sight, yaw: Array, pitch: Array) -> CandidateReport:
        """Evaluate one gaze, yaw and pitch (n,)."""
        views = Views.of(sight, yaw[None], pitch[None])
        filled, empty = views.tests
        return cls(
            look_share=float(views.look_share[0]),
            view_share=float(views.view_share[0]),
            left_share=float(views.left_share[0]),
            right_share=float(views.right_share[0]),
            filled_tests=int(filled[0]),
            empty_tests=int(empty[0]),
            distance=float(horizontal_distance(sight).mean()),
            spread=spread_degrees(sight),
        )


@dataclass(frozen=True)
class WalkReport:
    """Measurements of a finished walk.

    Attributes:
        candidates: one report per placed object, in their order.
        clearance: lower bound of the horizontal distance to anything within the agent's height, metres.
        length: length of the walk, metres.
    """

    candidates: tuple[CandidateReport, ...]
    clearance: float
    length: float

    @classmethod
    def of(cls, sights: Sequence[Sight], yaw: Array, pitch: Array, space: FreeSpace) -> WalkReport:
        """Evaluate a walk with one gaze, yaw and pitch (n,)."""
        ground = sights[0].eyes[:, [0, 2]]
        return cls(
            candidates=tuple(CandidateReport.of(sight, yaw, pitch) for sight in sights),
            clearance=float(space.clearance(ground).min()),
            length=float(arc_length(ground)[-1]),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """The soft constraints that are not met, one line each; no line identifies an object."""
        low, high = gaze.VIEW_ALLOWED
        least, most = min(c.view_share for c in self.candidates), max(c.view_share for c in self.candidates)
        out = []
        if least < low or most > high:
            found = f"between {least:.0%} and {most:.0%}"
            out.append(f"every object is in view in {found} of the frames; wanted {low:.0%}–{high:.0%}")
        side = min(min(c.left_share, c.right_share) for c in self.candidates)
        if side < gaze.SIDE_SHARE:
            out.append(
                f"every object is clearly on the left, and clearly on the right, in ≥ {side:.0%} of the frames; wanted "
                f"≥ {gaze.SIDE_SHARE:.0%}"
            )
        filled, empty = min(c.filled_tests for c in self.candidates), min(c.empty_tests for c in self.candidates)
        if filled + empty and min(filled, empty) == 0:
            out.append(f"every object is in ≥ {filled} test frames and missing from ≥ {empty}; wanted ≥ 1 and ≥ 1")
        return tuple(out)
