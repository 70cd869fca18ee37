"""Grey pictures: soft masks, and masks of any kind that others wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.media import decode_png


def read_probability(path: Path) -> NDArray[np.float32]:
    """(H, W) the grey levels of a soft mask as probabilities: 255, or 65535 with 16 bits, is 1.

    Raises:
        Avs3dError: if the file is damaged, or has colours.
    """
    pixels = read_grey(path)
    return np.asarray(pixels / np.float32(np.iinfo(pixels.dtype).max), dtype=np.float32)


def read_grey(path: Path) -> NDArray[Any]:
    """The pixels of a picture without colour, (H, W) uint8 or uint16; of three equal channels one.

    Raises:
        Avs3dError: if it is damaged, or has colours.
    """
    pixels = decode_png(path, cv2.IMREAD_UNCHANGED)
    if pixels.ndim == 3:
        colours = pixels[..., :3]
        if (colours != colours[..., :1]).any():
            raise Avs3dError(f"{path}: a coloured picture, expected a grey one")
        pixels = colours[..., 0]
    return np.asarray(pixels)
