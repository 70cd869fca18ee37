"""Traces of use in base colours: stains, yellowed paint, scratches, scuffs at the skirting. All are faint.

``wear`` is 0 for what is new and 1 for what is old (`generators.assets.styles.Style.wear`).
"""

from __future__ import annotations

import cv2
import numpy as np

from generators.assets.textures.noise import Field, Image, blur, smoothstep, spectral, to_image

#: Share of green and blue that white paint has lost when it is old: oil and dispersion paints yellow.
_YELLOWING = np.array([0.0, 0.012, 0.05])
#: Colour of dirt, relative to the surface, and of scratches in varnish.
_DIRT, _SCRATCH = np.array([0.80, 0.76, 0.70]), np.array([1.07, 1.06, 1.04])
#: Stains are drawn at this fraction of the resolution.
_COARSE = 4
#: Scratches per texture of an old floor.
_SCRATCHES = 70


def yellowed(colour: Field, wear: float) -> Field:
    """The sRGB colour (3,) of paint after years of light and smoke."""
    return np.asarray(colour * (1 - wear * _YELLOWING))


def _broad(rng: np.random.Generator, shape: tuple[int, int], slope: float) -> Field:
    """Smooth noise (H, W) that wraps round, unit variance, drawn at a quarter of the resolution."""
    small = spectral(rng, (shape[0] // _COARSE, shape[1] // _COARSE), slope, finest=2)
    wide = np.pad(small, 2, mode="wrap")
    large = cv2.resize(wide, None, fx=_COARSE, fy=_COARSE, interpolation=cv2.INTER_CUBIC)
    edge = 2 * _COARSE
    return np.asarray(large[edge:-edge, edge:-edge], dtype=np.float64)


def stained(rng: np.random.Generator, pixels: Image, wear: float) -> Image:
    """A wall or tiles with clouds of dirt: a few per cent darker and warmer in patches."""
    if wear <= 0:
        return pixels
    shape = (pixels.shape[0], pixels.shape[1])
    amount = 0.09 * wear * smoothstep(0.1, 2.4, _broad(rng, shape, 1.5))
    amount += 0.03 * wear * smoothstep(0.4, 2.2, _broad(rng, shape, 0.9))
    return to_image(pixels / 255 * (1 - amount[..., None] * (1 - _DIRT) * 3))


def trodden(rng: np.random.Generator, pixels: Image, wear: float) -> Image:
    """A floor: dirt in patches, lanes that are worn lighter, and fine scratches in all directions."""
    if wear <= 0:
        return pixels
    height, width = pixels.shape[:2]
    dirty = stained(rng, pixels, wear) / 255
    lane = 0.05 * wear * smoothstep(0.2, 2.0, _broad(rng, (height, width), 1.8))
    marks = np.zeros((height, width), dtype=np.float32)
    for _ in range(round(_SCRATCHES * wear)):
        x, y, length = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0.01, 0.06) * width
        angle, bend = rng.uniform(0, np.pi), rng.uniform(-0.3, 0.3)
        t = np.linspace(0, 1, 8)
        line = np.stack([x + length * t * np.cos(angle + bend * t), y + length * t * np.sin(angle + bend * t)], axis=1)
        strength = float(rng.uniform(0.3, 1.0))
        cv2.polylines(marks, [np.rint(line * 8).astype(np.int32)], False, strength, 1, cv2.LINE_AA, shift=3)
    shade = dirty * (1 + lane[..., None])
    return to_image(shade * (1 + 0.5 * wear * marks[..., None] * (_SCRATCH - 1) * 2))


def scuffed(rng: np.random.Generator, pixels: Image, wear: float, *, metres: float = 1.0) -> Image:
    """A skirting board, whose lower edge is the image's: dust above the floor, dark marks of shoes and brooms.

    ``metres``: height of the image.
    """
    if wear <= 0:
        return pixels
    height, width = pixels.shape[:2]
    above = (height - 0.5 - np.arange(height))[:, None] / height * metres
    streaks = spectral(rng, (height, width), 0.8, stretch=(1.0, 6.0), finest=2)
    dust = np.exp(-above / 0.022) * (0.6 + 0.25 * streaks)
    marks = np.zeros((height, width))
    for _ in range(round(14 * wear)):
        x, y = rng.uniform(0, width), height * (1 - rng.uniform(0.015, 0.1) / metres)
        long, thin = rng.uniform(0.008, 0.04) * width, rng.uniform(0.6, 1.8)
        u = (np.arange(width) - x + width / 2) % width - width / 2
        tilt = rng.uniform(-0.15, 0.15)
        away = (np.arange(height)[:, None] - y - tilt * u[None, :]) / thin
        marks += rng.uniform(0.2, 0.7) * np.exp(-((u[None, :] / long) ** 2) - away**2)
    amount = np.clip(wear * (0.55 * np.clip(dust, 0, 1) + 0.6 * blur(marks, 0.5)), 0, 1)
    return to_image(pixels / 255 * (1 - amount[..., None] * (1 - _DIRT)))
