"""Kernels of the camera model (generators/vision/camera.py)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.scene import F32

U8 = NDArray[np.uint8]

_ONE, _TWO, _FOUR, _SIXTEENTH = np.float32(1.0), np.float32(2.0), np.float32(4.0), np.float32(1.0 / 16.0)
#: Sum of the squares of the weights of `_binomial`: the variance that it leaves of white noise.
NOISE_LEFT = (1.0 + 4.0 + 1.0) ** 2 / 256.0


@inline
def _binomial(values: F32, top: int, row: int, bottom: int, left: int, column: int, right: int, k: int) -> np.float32:
    """The 3 × 3 mean with the weights 1, 2, 1 in both directions."""
    corners = values[top, left, k] + values[top, right, k] + values[bottom, left, k] + values[bottom, right, k]
    sides = values[top, column, k] + values[bottom, column, k] + values[row, left, k] + values[row, right, k]
    return np.float32((corners + _TWO * sides + _FOUR * values[row, column, k]) * _SIXTEENTH)


@njit
def expose(
    rgb: U8,
    noise: F32,
    decode: F32,
    encode: F32,
    gains: NDArray[np.float64],
    vignette: float,
    shot: float,
    read: float,
    out: F32,
) -> None:
    """Write sRGB values (H, W, 3), 0 to 255 and not rounded, of what a noisy sensor behind a lens sees of ``rgb``.

    Args:
        rgb: (H, W, 3).
        noise: (H + 2, W + 2, 3) white noise of variance 1; it is smoothed.
        decode: (256,) linear light of 8-bit values.
        encode: (n,) sRGB values of n equal steps of linear light.
        gains: (3,) factors of the channels.
        vignette: share of the light that is missing in the corners.
        shot: variance of the noise over the light.
        read: standard deviation of the noise in the dark.
        out: written.
    """
    height, width = rgb.shape[:2]
    last = np.float32(len(encode))
    of_light, of_dark = np.float32(shot / NOISE_LEFT), np.float32(read * read / NOISE_LEFT)
    for i in range(height):
        y = 2.0 * i / max(height - 1, 1) - 1.0
        for j in range(width):
            x = 2.0 * j / max(width - 1, 1) - 1.0
            falloff = 1.0 - vignette * (x * x + y * y) / 2.0
            for k in range(3):
                light = np.float32(decode[rgb[i, j, k]] * np.float32(falloff * gains[k]))
                grain = _binomial(noise, i, i + 1, i + 2, j, j + 1, j + 2, k)
                light += grain * np.float32(math.sqrt(of_light * light + of_dark))
                out[i, j, k] = encode[int(min(max(light * last, np.float32(0.0)), last - _ONE))]


@njit
def sharpen(shown: F32, amount: float, out: U8) -> None:
    """Write ``shown`` (H, W, 3) plus ``amount`` of what its 3 × 3 mean lacks of it, rounded to 8 bits."""
    height, width = shown.shape[:2]
    share = np.float32(amount)
    for i in range(height):
        top, bottom = max(i - 1, 0), min(i + 1, height - 1)
        for j in range(width):
            left, right = max(j - 1, 0), min(j + 1, width - 1)
            for k in range(3):
                value = shown[i, j, k]
                value += share * (value - _binomial(shown, top, i, bottom, left, j, right, k))
                out[i, j, k] = np.uint8(np.rint(min(max(value, np.float32(0.0)), np.float32(255.0))))
