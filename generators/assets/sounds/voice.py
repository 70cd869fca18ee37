"""A voice: one device that makes the sound of a category."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.core.limits import SoundSplit

Kind = Literal["synthesised", "recorded"]


@dataclass(frozen=True)
class Voice:
    """A device of a category, from which units and takes are drawn.

    Attributes:
        category: what it is, e.g. ``vacuum_cleaner``.
        name: of the device, unique in its category, e.g. ``canister_carpet``.
        split: where it may be used; never in two of them.
        mechanism: what makes the sound, one of a few of its category, e.g. ``universal motor with impeller``.
        source: of the model: a paper, a standard, a measured spectrum.
        play: (samples, Generator) → (samples,) float64 at 44,100 Hz, of any level. Everything that differs between
            two units of the device and between two takes is drawn from the Generator.
    """

    category: str
    name: str
    split: SoundSplit
    mechanism: str
    source: str
    play: Callable[[int, Generator], NDArray[np.float64]]
    kind: Kind = "synthesised"

    @classmethod
    def of(
        cls,
        category: str,
        play: Callable[[int, Generator], NDArray[np.float64]],
        split: SoundSplit,
        mechanism: str,
        source: str,
    ) -> Voice:
        """The voice that a function plays, with its name."""
        return cls(category, play.__name__, split, mechanism, source, play)
