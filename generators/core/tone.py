"""Conversion of scene radiance to 8 bits: a photographic tone curve, then the sRGB transfer function.

The curve is the Naka-Rushton/Hill sigmoid that filmic operators are built from (T. Lottes, "Advanced Techniques and
Optimization of HDR Color Pipelines", GDC 2016, with shoulder 1)::

    f(x) = x^a / (b·x^a + c),      f(0) = 0,   f(MID_GREY) = MID_GREY,   f(WHITE) = 1

a is the contrast in the shadows, where f ~ x^a; the two conditions f(MID_GREY) and f(WHITE) determine b and c. At
mid-grey the slope on a log-log plot is a·(1 − b·MID_GREY) ≈ 1.1. A diffuse white (x = 1) is shown at 0.68 (sRGB 216 of
255). Radiance from `WHITE` on, 5.5 stops above mid-grey, is shown as pure white, similar to a phone's camera. The curve
is applied to each channel separately, so that bright colours lose saturation towards white, as on film.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Luminance of linear sRGB (IEC 61966-2-1).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
#: Fixed point of the curve, as radiance times exposure: 18 % grey, sRGB 118 of 255.
MID_GREY = 0.18
#: The smallest radiance (times exposure) that is shown as pure white.
WHITE = 8.0
#: Exponent of the toe.
CONTRAST = 1.3

_B = (WHITE**CONTRAST - MID_GREY ** (CONTRAST - 1)) / (WHITE**CONTRAST - MID_GREY**CONTRAST)
_C = WHITE**CONTRAST * (1.0 - _B)

#: Sizes of the tables. Radiance is looked up by its square root, with interpolation; display light directly.
TONE_ENTRIES = 4096
SRGB_ENTRIES = 65536


def tone_curve(radiance: ArrayLike) -> Array:
    """Display light in [0, 1], linear, of exposed scene radiance; below 0 counts as 0, above `WHITE` as `WHITE`."""
    x = np.clip(np.asarray(radiance, dtype=np.float64), 0.0, WHITE) ** CONTRAST
    return np.asarray(np.minimum(x / (_B * x + _C), 1.0))


def inverse_tone_curve(display: ArrayLike) -> Array:
    """The exposed radiance in [0, `WHITE`] that is shown as linear ``display`` light (clipped to [0, 1])."""
    y = np.clip(np.asarray(display, dtype=np.float64), 0.0, 1.0)
    return np.asarray((_C * y / (1.0 - _B * y)) ** (1.0 / CONTRAST))


def srgb_encode(linear: ArrayLike) -> Array:
    """SRGB value in [0, 1] of linear light (IEC 61966-2-1), clipped to [0, 1]."""
    x = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: ArrayLike) -> Array:
    """Linear light in [0, 1] of an sRGB value in [0, 1]."""
    x = np.clip(np.asarray(encoded, dtype=np.float64), 0.0, 1.0)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def develop(radiance: ArrayLike) -> NDArray[np.uint8]:
    """8-bit sRGB of exposed scene radiance: tone curve, transfer function, rounding."""
    return np.asarray(np.rint(255.0 * srgb_encode(tone_curve(radiance))), dtype=np.uint8)


def tone_table() -> NDArray[np.float32]:
    """(`TONE_ENTRIES`,) float32: the tone curve at radiance `WHITE`·(i / (n − 1))²; both ends are exact."""
    root = np.linspace(0.0, 1.0, TONE_ENTRIES)
    return tone_curve(WHITE * root * root).astype(np.float32)


def srgb_table() -> NDArray[np.uint8]:
    """(`SRGB_ENTRIES`,) uint8: the 8-bit sRGB value of linear light i / (n − 1)."""
    return np.rint(255.0 * srgb_encode(np.linspace(0.0, 1.0, SRGB_ENTRIES))).astype(np.uint8)


def decode_table() -> NDArray[np.float32]:
    """(256,) float32: linear light of each 8-bit sRGB value."""
    return srgb_decode(np.arange(256) / 255.0).astype(np.float32)
