"""A seeded model of the errors that segmentation methods make, to see what each does to the scores.

| error      | mistake of the method                                        | decided per |
|------------|--------------------------------------------------------------|-------------|
| ``drop``   | it missed the object                                         | frame       |
| ``swap``   | it chose the wrong one of several identical objects          | observation |
| ``confuse``| it took a similar object for one of the category, beside it  | observation |
| ``dilate`` | its outlines lie too far outside (or, below 0, inside)       | everywhere  |

A wrong choice in 3D shows in every picture, therefore `swap` and `confuse` hold for a whole observation. Every decision
has a random generator of its own, derived from the seed and the names of its subject: it does not depend on the
order of frames, on the number of processes, or on the other settings. With a higher probability the same frames fail,
and more.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.errors import UsageError

#: Radii beyond this are no outline errors.
MAX_DILATE = 500.0

#: For each category the ones that are mistaken for it, the likeliest first: appliances with a door and a window in the
#: front, appliances of a worktop, white things of a bathroom, small things on a shelf or a wall. `vacuum_cleaner`
#: resembles nothing here. Distractors never sound.
CONFUSABLE: dict[str, tuple[str, ...]] = {
    "microwave": ("oven", "washing_machine", "coffee_machine"),
    "washing_machine": ("dishwasher", "oven", "microwave", "toilet"),
    "coffee_machine": ("kettle", "microwave"),
    "toilet": ("washing_machine",),
    "clock": ("telephone",),
    "telephone": ("clock", "radio"),
    "vacuum_cleaner": (),
}


@dataclass(frozen=True)
class ErrorModel:
    """How often and how far a prediction is wrong; by default never.

    Attributes:
        drop: probability that a frame's mask is all black.
        swap: probability that in an observation a silent twin is marked instead of the sounding instance.
        dilate: pixels by which outlines are moved outwards (below 0: inwards) in a picture of 1008 pixels; in
            others in proportion.
        confuse: probability that in an observation a similar object is marked as well.
        seed: of all decisions.
    """

    drop: float = 0.0
    swap: float = 0.0
    dilate: float = 0.0
    confuse: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("drop", "swap", "confuse"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise UsageError(f"{name} {value}: expected a probability from 0 to 1")
        if not abs(self.dilate) <= MAX_DILATE:
            raise UsageError(f"dilate {self.dilate}: expected pixels from {-MAX_DILATE:g} to {MAX_DILATE:g}")
        if self.seed < 0:
            raise UsageError(f"seed {self.seed}: expected a whole number from 0 on")

    def __str__(self) -> str:
        """E.g. ``drop 0.1, swap 0, dilate 3, confuse 0, seed 0``."""
        rates = (f"{name} {getattr(self, name):g}" for name in ("drop", "swap", "dilate", "confuse"))
        return ", ".join((*rates, f"seed {self.seed}"))

    @property
    def settings(self) -> dict[str, float]:
        """The errors that occur, by name."""
        return {name: value for name in ("drop", "swap", "dilate", "confuse") if (value := getattr(self, name))}

    def rng(self, purpose: str, key: str, frame: str = "") -> np.random.Generator:
        """The generator of one decision, from a stable hash of the names (never the global state)."""
        digest = hashlib.sha256("\0".join((purpose, key, frame)).encode()).digest()
        words = np.frombuffer(digest, dtype="<u4")
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, *map(int, words)])))

    def happens(self, error: str, key: str, frame: str = "") -> bool:
        """Whether ``drop`` (of a frame), ``swap`` or ``confuse`` (of an observation) happens."""
        return bool(self.rng(error, key, frame).random() < getattr(self, error))

    def outline(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """``mask`` (H, W) with its outlines moved by `dilate`."""
        return move_outline(mask, self.dilate * max(mask.shape) / layout.IMAGE_SIZE)


def move_outline(mask: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Dilate a mask (H, W) with a disc of ``radius`` pixels, or erode it where the radius is negative.

    The disc holds the pixel centres at a distance of at most ``radius``, so that a radius below 1 changes nothing. The
    image's edge is no outline: nothing is eroded from there.
    """
    if abs(radius) < 1.0 or not mask.any() or mask.all():
        return mask
    inside = mask if radius < 0 else ~mask
    # Exact Euclidean distance to the other side: dilation with a disc of any radius in linear time.
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    near = distance <= math.fabs(radius)
    return np.asarray(near if radius > 0 else ~near)
