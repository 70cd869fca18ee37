"""From the network's logits to masks: the picture's edges, closer looks, specks, class ids. Numpy and OpenCV alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Smallest component that stays marked, as a share of the picture.
LEAST_AREA = 2e-4
#: Radius of the guided filter as a share of the picture's width, and its smoothness (of pictures of 0 to 1).
RADIUS, SMOOTHNESS = 0.006, 1e-3
#: Logits are cut here before the filter: beyond, they are certain.
MOST_LOGIT = 6.0
#: Closer looks: probability above which a component gets one; its window over its size; smallest and largest side of a
#: window as a share of the picture (training enlarges up to three times); the most windows of a picture.
LOOKED_AT, MARGIN, SMALLEST, LARGEST, MOST_WINDOWS = 0.25, 3.0, 1 / 3, 0.7, 3
#: Weight of a closer look over the first one inside of its window, and the share of the window in which it fades in.
CLOSER_WEIGHT, FADE = 0.7, 0.1


@dataclass(frozen=True)
class Answer:
    """What the network says of a frame, in n × n cells: 126 of one look at 252², 252 with one at 504².

    Attributes:
        mask: (n, n) float32 logits: what sounds.
        classes: (8, n, n) float32: probability of each class at each pixel, from the picture alone.
        audible: (7,) float32: probability of each category, from the sound alone.
    """

    mask: NDArray[np.float32]
    classes: NDArray[np.float32]
    audible: NDArray[np.float32]


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


def class_map(mask: NDArray[np.bool_], answer: Answer) -> NDArray[np.uint8]:
    """(H, W) class ids of what is marked, rule 4: one per component."""
    out = np.zeros(mask.shape, np.uint8)
    if not mask.any():
        return out
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    likely = answer.classes[1:] * answer.audible[:, None, None]
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

    masks = [cells(np.asarray(1 / (1 + np.exp(-answer.mask)), np.float32)) for answer in answers]
    classes = [np.stack([cells(each) for each in answer.classes]) for answer in answers]
    audible = [answer.audible for answer in answers]
    return Answer(log_odds(np.mean(masks, axis=0)), np.mean(classes, axis=0), np.mean(audible, axis=0))


@dataclass(frozen=True)
class Window:
    """A part of a picture that is looked at closer, in shares of its width and height.

    Attributes:
        left: its left edge.
        top: its upper edge.
        side: its width and height.
    """

    left: float
    top: float
    side: float

    def camera(self, camera: Sequence[float]) -> tuple[float, float, float, float]:
        """The camera (fx, fy, cx, cy as shares) of the part."""
        fx, fy, cx, cy = camera
        return fx / self.side, fy / self.side, (cx - self.left) / self.side, (cy - self.top) / self.side

    def pixels(self, size: tuple[int, ...]) -> tuple[slice, slice]:
        """Rows and columns in a picture of a size (height, width)."""
        height, width = size[:2]
        rows = slice(round(self.top * height), round((self.top + self.side) * height))
        return rows, slice(round(self.left * width), round((self.left + self.side) * width))


def windows(mask: NDArray[np.float32]) -> list[Window]:
    """Windows around what may be marked and is small, the largest first.

    Args:
        mask: (n, n) logits.
    """
    marked = (mask > logit(LOOKED_AT)).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(marked, connectivity=8)
    found: list[Window] = []
    for label in sorted(range(1, count), key=lambda number: -stats[number, cv2.CC_STAT_AREA]):
        left, top, width, height = (stats[label, : cv2.CC_STAT_AREA] / len(mask)).tolist()
        side = max(SMALLEST, MARGIN * max(width, height))
        middle = left + width / 2, top + height / 2
        inside = any(w.left < middle[0] < w.left + w.side and w.top < middle[1] < w.top + w.side for w in found)
        if side <= LARGEST and not inside and len(found) < MOST_WINDOWS:
            corner = [min(max(x - side / 2, 0.0), 1 - side) for x in middle]
            found.append(Window(corner[0], corner[1], side))
    return found


def pasted(large: NDArray[np.float32], closer: NDArray[np.float32], window: Window) -> None:
    """Blend the logits of a closer look into those of the picture, in place.

    Args:
        large: (H, W) logits of the picture.
        closer: (n, n) logits of the window.
        window: where it is.
    """
    rows, columns = window.pixels(large.shape)
    part = large[rows, columns]
    height, width = part.shape

    def fade(length: int) -> NDArray[np.float32]:
        near = (np.minimum(np.arange(length), np.arange(length)[::-1]) + 0.5) / (FADE * length)
        return np.clip(near, 0, 1).astype(np.float32)

    weight = CLOSER_WEIGHT * np.minimum(fade(height)[:, None], fade(width))
    fine = cv2.resize(closer, (width, height), interpolation=cv2.INTER_LINEAR)
    large[rows, columns] = part + weight * (np.clip(fine, -MOST_LOGIT, MOST_LOGIT) - part)
