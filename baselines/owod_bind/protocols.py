"""The interfaces of the three networks of OWOD-BIND; a test can use other implementations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.networks.pixels import Picture

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Detections:
    """Proposals of one picture, the likeliest first.

    Attributes:
        boxes: (N, 4) float64, x0 y0 x1 y1 in pixels; x1 and y1 are the far edges, inside of the picture.
        scores: (N,) float64 in [0, 1], descending.
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.boxes)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Detections:
        """The proposals at ``index``."""
        return Detections(self.boxes[index], self.scores[index])


class BoxProposer(Protocol):
    """Finds objects of any class."""

    @property
    def name(self) -> str:
        """Which network, for submission.json."""

    def propose(self, pictures: Sequence[Picture]) -> list[Detections]:
        """Boxes of each of the pictures (H, W, 3) uint8 RGB."""


class MaskPredictor(Protocol):
    """Segments the object in a box."""

    @property
    def name(self) -> str:
        """Which network, for submission.json."""

    def segment(self, picture: Picture, boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N, H, W) bool: one mask for each of the boxes (N, 4) of the picture (H, W, 3)."""


class AudioVisualSimilarity(Protocol):
    """Says how well a sound fits pictures."""

    @property
    def name(self) -> str:
        """Which network, for submission.json."""

    def logits(self, crops: Sequence[Picture], clip: NDArray[np.float32], rate: int) -> NDArray[np.float64]:
        """How well each crop fits the clip: a similarity times the network's logit scale, ready for a softmax.

        Args:
            crops: N pictures (h, w, 3) uint8 RGB of any sizes, N ≥ 1.
            clip: (n,) mono samples.
            rate: samples per second.

        Returns:
            (N,) finite.
        """
