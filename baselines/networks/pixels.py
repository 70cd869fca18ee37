"""Pictures as input of a network: resized, normalised, channels first.

With Pillow's filters, which widen where a picture shrinks: the networks were trained on pictures resized so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: (H, W, 3), RGB.
Picture = NDArray[np.uint8]
#: Pillow's numbers, which preprocessor configurations use too.
BILINEAR, BICUBIC = 2, 3
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CLIP_MEAN, CLIP_STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


def shorter_side(size: tuple[int, int], target: int) -> tuple[int, int]:
    """(height, width) with the shorter side ``target`` and the longer one in proportion, rounded down."""
    height, width = size
    if height <= width:
        return target, target * width // height
    return target * height // width, target


def resize(picture: Picture, size: tuple[int, int], resample: int = BILINEAR) -> Picture:
    """(h, w, 3) uint8 of ``size`` (height, width) from (H, W, 3) uint8."""
    if picture.shape[:2] == size:
        return picture
    from PIL import Image

    return np.asarray(Image.fromarray(np.ascontiguousarray(picture)).resize(size[::-1], Image.Resampling(resample)))


def centre_crop(picture: Picture, side: int) -> Picture:
    """The middle (side, side, 3) of a picture that is not smaller."""
    top, left = (round((length - side) / 2) for length in picture.shape[:2])
    return picture[top : top + side, left : left + side]


def normalise(picture: Picture, mean: Sequence[float], std: Sequence[float]) -> NDArray[np.float32]:
    """(3, h, w) float32, (value / 255 − mean) / std for each channel, from (h, w, 3) uint8 RGB."""
    scaled = (picture.astype(np.float32) / 255 - np.asarray(mean, np.float32)) / np.asarray(std, np.float32)
    return np.ascontiguousarray(scaled.transpose(2, 0, 1))
