"""What a walk turned out to be, for each candidate, and the notes on constraints that were relaxed."""

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
    """What a walk shows of one candidate.

    Attributes:
        look_share: share of frames that look at it (in line of sight, its middle inside the image).
        view_share: share of frames with something of it in the image.
        left_share, right_share: shares of frames with it at least 20° to the left, to the right.
        filled_tests, empty_tests: test frames (index % 8 == 0) with and without it in the image.
        distance: mean horizontal distance to it, metres.
        spread: angle over which the viewing positions spread, seen from it, degrees.
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
    """What a walk turned out to be.

    Attributes:
        candidates: one per placed object, in their order.
        clearance: least horizontal distance to anything within the agent's height, metres (a lower bound).
        length: metres walked.
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
        """The soft constraints that are not met, one line each; no line tells which object it is about."""
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
