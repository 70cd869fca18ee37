"""Kernels of the camera model (generators/vision/camera.py).

Rows are handled as a whole, channels side by side, so that the compiler uses vector instructions.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import njit
from generators.core.scene import F32

U8 = NDArray[np.uint8]

_ZERO, _TWO, _SIXTEENTH, _WHITE = np.float32(0.0), np.float32(2.0), np.float32(1.0 / 16.0), np.float32(255.0)
#: Weighted sum of 3 × 3 bytes with the weights 1, 2, 1 in both directions: its mean, and the factor that gives it the
#: variance 1, for uniform, independent bytes: their variance is (256² − 1) / 12, the squared weights sum to 36.
_MEAN = np.int32(16 * 255 // 2)
_UNIT = np.float32(1.0 / math.sqrt(36.0 * (256.0**2 - 1.0) / 12.0))


@njit
def expose(
    rgb: U8,
    noise: U8,
    decode: F32,
    encode: F32,
    gains: NDArray[np.float64],
    vignette: float,
    shot: float,
    read: float,
    out: F32,
) -> None:
    """Write sRGB values (H, 3 W), 0 to 255 and not rounded, of what a noisy sensor behind a lens sees of ``rgb``.

    Args:
        rgb: (H, 3 W).
        noise: (H + 2, 3 (W + 2)) uniform, independent bytes. Smoothed over 3 × 3 of them, they are nearly Gaussian: the
            kurtosis is 2.7 in place of 3, and nothing lies beyond 4.6 standard deviations.
        decode: (256,) linear light of 8-bit values.
        encode: (n,) sRGB values of n equal steps of linear light.
        gains: (3,) factors of the channels.
        vignette: share of the light that is missing in the corners.
        shot: variance of the noise over the light.
        read: standard deviation of the noise in the dark.
        out: written.
    """
    height, width = rgb.shape
    last, most = np.float32(len(encode)), np.float32(len(encode) - 1)
    of_light, of_dark = np.float32(shot), np.float32(read * read)
    middle, falloff = np.empty(width, np.float32), np.empty(width, np.float32)
    for c in range(width):
        x = 2.0 * (c // 3) / max(width // 3 - 1, 1) - 1.0
        middle[c] = gains[c % 3] * (1.0 - vignette * x * x / 2.0)
        falloff[c] = gains[c % 3] * vignette / 2.0
    column, light = np.empty(width + 6, np.int32), np.empty(width, np.float32)
    for i in range(height):
        y = 2.0 * i / max(height - 1, 1) - 1.0
        square = np.float32(y * y)
        for c in range(width + 6):
            column[c] = np.int32(noise[i, c]) + 2 * np.int32(noise[i + 1, c]) + np.int32(noise[i + 2, c])
        for c in range(width):
            light[c] = decode[rgb[i, c]]
        for c in range(width):
            value = light[c] * (middle[c] - falloff[c] * square)
            grain = np.float32(column[c] + 2 * column[c + 3] + column[c + 6] - _MEAN) * _UNIT
            value += grain * np.sqrt(of_light * value + of_dark)
            light[c] = min(max(value * last, _ZERO), most)
        for c in range(width):
            out[i, c] = encode[int(light[c])]


@njit
def sharpen(shown: F32, amount: float, out: U8) -> None:
    """Write ``shown`` (H, 3 W) plus ``amount`` of what its 3 × 3 mean lacks of it, rounded to 8 bits."""
    height, width = shown.shape
    share = np.float32(amount)
    column = np.empty(width + 6, np.float32)
    for i in range(height):
        top, bottom = max(i - 1, 0), min(i + 1, height - 1)
        for c in range(width):
            column[c + 3] = shown[top, c] + _TWO * shown[i, c] + shown[bottom, c]
        for k in range(3):  # the picture goes on at its edges as it ends
            column[k], column[width + 3 + k] = column[k + 3], column[width + k]
        for c in range(width):
            value = shown[i, c]
            value += share * (value - (column[c] + _TWO * column[c + 3] + column[c + 6]) * _SIXTEENTH)
            out[i, c] = np.uint8(np.rint(min(max(value, _ZERO), _WHITE)))
