"""The interfaces of the networks of the foundation baseline; a test can use other implementations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.networks.pixels import Picture


@dataclass(frozen=True, eq=False)
class TextMasks:
    """The instances of one text in one picture, the likeliest first.

    Attributes:
        masks: (N, H, W) bool; none of them is empty.
        scores: (N,) in [0, 1], descending.
    """

    masks: NDArray[np.bool_]
    scores: NDArray[np.float64]


class SoundTagger(Protocol):
    """Compares sounds with texts."""

    @property
    def name(self) -> str:
        """Which network, for submission.json."""

    def posterior(self, clips: Sequence[NDArray[np.float32]], rate: int, texts: Sequence[str]) -> NDArray[np.float64]:
        """(clips, texts) the probability of each text for each mono clip (n,); rows sum to 1."""


class TextSegmenter(Protocol):
    """Segments every instance that a text names."""

    @property
    def name(self) -> str:
        """Which network, for submission.json."""

    def segment(self, picture: Picture, texts: Sequence[str]) -> list[TextMasks]:
        """For each text its instances in the picture (H, W, 3)."""
