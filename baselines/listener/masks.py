"""From the network's logits to masks: several looks, the picture's edges, specks, class ids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

#: Smallest component that stays marked, as a share of the picture.
LEAST_AREA = 2e-4
#: Share of the peak's probability that a component must reach somewhere, to be marked.
SEED = 0.95
#: Radius of the guided filter as a share of the picture's width, and its smoothness (of pictures of 0 to 1).
RADIUS, SMOOTHNESS = 0.006, 1e-3
#: Logits are cut here before the filter: beyond, they are certain.
MOST_LOGIT = 6.0


@dataclass(frozen=True)
class Answer:
    """The network's answer for a frame, in n × n cells: half of the side of the finest look.

    Attributes:
        mask: (n, n) float32 logits: what sounds.
        classes: (8, n, n) float32: probability of each class at each pixel, from the picture alone.
        audible: (7,) float32: probability of each category, from the sound alone.
        unknown: probability that something is heard which has no name.
    """

    mask: NDArray[np.float32]
    classes: NDArray[np.float32]
    audible: NDArray[np.float32]
    unknown: float = 0.0

    @property
    def heard(self) -> NDArray[np.float32]:
        """(7,) how probable it is of each category that it is what is heard: by name, or as what has no name."""
        return heard_of(self.audible, self.unknown)


def heard_of(audible: NDArray[np.float32], unknown: NDArray[np.float32] | float) -> NDArray[np.float32]:
    """Probabilities that categories are heard by name, or as what has no name; see `Answer.heard`."""
    return np.asarray(1 - (1 - audible) * (1 - unknown), np.float32)


def guided(values: NDArray[np.float32], picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Values (H, W) whose edges follow those of the picture's brightness: the guided filter, equations 5 and 6.

    Args:
        values: float32.
        picture: (H, W, 3) uint8 RGB.
    """
    guide = cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    radius = max(1, round(RADIUS * picture.shape[1]))

    def mean(x: Any) -> Any:
        return cv2.blur(x, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT)

    average, middle = mean(guide), mean(values)
    slope = (mean(guide * values) - average * middle) / (mean(guide * guide) - average * average + SMOOTHNESS)
    offset = middle - slope * average
    return np.asarray(mean(slope) * guide + mean(offset), np.float32)


def without_specks(mask: NDArray[np.bool_], share: float) -> NDArray[np.bool_]:
    """The mask without components (8-connected) that are smaller than a share of the picture."""
    if not mask.any():
        return mask
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= share * mask.size
    large[0] = False
    return np.asarray(large[labels])


def highest(odds: NDArray[np.float32]) -> float:
    """Log-odds that a component of the smallest size (`LEAST_AREA`) could have everywhere: a frame's peak, less specks.

    Args:
        odds: (H, W).
    """
    rank = max(1, math.ceil(LEAST_AREA * odds.size))
    return float(np.partition(odds, odds.size - rank, axis=None)[odds.size - rank])


def marked(odds: NDArray[np.float32], threshold: float, share: float | None) -> NDArray[np.bool_]:
    """(H, W) what is marked of a frame: nothing unless its peak is above a threshold, then what reaches up to it.

    As in the edge detector of J. Canny (IEEE Trans. PAMI 8 (1986) 679-698) two levels decide, here both relative to the
    frame's peak: components above the lower one are marked if they contain a pixel above the upper one, `SEED`.

    Args:
        odds: (H, W) log-odds of the pixels.
        threshold: probability above which the peak must be.
        share: of the peak's probability, the lower level; None: marked is each pixel above the threshold.

    Examples:
        >>> odds = np.full((8, 8), -9, np.float32)
        >>> odds[2:4, 2:5] = [0, -1, -3]  # probabilities .5, .27, .05
        >>> odds[6, 6] = -1  # apart from the peak
        >>> [int(marked(odds, *rule).sum()) for rule in ((0.3, 0.4), (0.3, None), (0.6, 0.4))]
        [4, 2, 0]
    """
    if share is None:
        return without_specks(np.asarray(odds > logit(threshold)), LEAST_AREA)
    peak = highest(odds)
    if peak <= logit(threshold):
        return np.zeros(odds.shape, np.bool_)
    lower, upper = (logit(each * float(expit(peak))) for each in (share, SEED))
    _, labels = cv2.connectedComponents((odds > lower).astype(np.uint8), connectivity=8)
    return without_specks(np.isin(labels, np.setdiff1d(labels[odds > upper], 0)), LEAST_AREA)


def marked_where(threshold: float, share: float | None) -> str:
    """The rule of `marked` in words."""
    if share is None:
        return f"marked where > {threshold:g}"
    return f"marked where > {share:g} of the frame's peak, around {SEED:g} of it, if it is > {threshold:g}"


def class_map(mask: NDArray[np.bool_], answer: Answer) -> NDArray[np.uint8]:
    """(H, W) class ids of what is marked, rule 4: one per component."""
    out = np.zeros(mask.shape, np.uint8)
    if not mask.any():
        return out
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    likely = answer.classes[1:] * answer.heard[:, None, None]
    ids = np.zeros(count, np.uint8)
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        cells = rows * likely.shape[1] // mask.shape[0], columns * likely.shape[2] // mask.shape[1]
        ids[label] = 1 + int(likely[:, cells[0], cells[1]].sum(axis=-1).argmax())
    return np.asarray(ids[labels])


def logit(share: float) -> float:
    """Of a probability."""
    return float(np.log(share / (1 - share)))


def log_odds(shares: NDArray[np.float32], least: float = 1e-6) -> NDArray[np.float32]:
    """Of probabilities, which are cut at ``least`` on both sides."""
    cut = np.clip(shares, least, 1 - least)
    return np.asarray(np.log(cut / (1 - cut)), np.float32)


def agreed(answers: Sequence[Answer]) -> Answer:
    """The mean of the probabilities of several looks at a frame, in the cells of the finest."""
    size = max(answer.mask.shape for answer in answers)[::-1]

    def cells(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), np.float32)

    masks = [cells(expit(answer.mask)) for answer in answers]
    classes = [np.stack([cells(each) for each in answer.classes]) for answer in answers]
    audible = [answer.audible for answer in answers]
    unknown = float(np.mean([answer.unknown for answer in answers]))
    return Answer(log_odds(np.mean(masks, axis=0)), np.mean(classes, axis=0), np.mean(audible, axis=0), unknown)
