"""What household goods are made of: enamel, plastics, chrome, steel, glass, ceramic, rubber, wood, and printed faces.

Light is baked into the scene and does not depend on the view, so what a mirror or a glass would show is painted: chrome
carries soft dark and bright bands, dark glass a pale sheen. Colours are given as sRGB and stored linear.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.scenes.scene import Material, Texture

Pixels = NDArray[np.uint8]
Colour = tuple[float, float, float]


def linear(srgb: str) -> Colour:
    """``"#rrggbb"`` (sRGB, IEC 61966-2-1) as linear-light albedo."""
    values = [int(srgb[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    r, g, b = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return r, g, b


def choose(rng: Generator, *options: str) -> str:
    """One of ``options``."""
    return options[int(rng.integers(len(options)))]


def enamel(name: str, srgb: str) -> Material:
    """Painted or enamelled sheet steel."""
    return Material(name, "metal", linear(srgb), gloss=0.5)


def plastic(name: str, srgb: str, *, gloss: float = 0.3) -> Material:
    """Moulded plastic."""
    return Material(name, "plastic", linear(srgb), gloss=gloss)


def rubber(name: str = "rubber", srgb: str = "#2b2c2e") -> Material:
    """Black or grey rubber (feet, gaskets, tyres); sounds like plastic."""
    return Material(name, "plastic", linear(srgb), gloss=0.05)


def ceramic(name: str = "ceramic", srgb: str = "#f3f3ef") -> Material:
    """Glazed sanitary ware."""
    return Material(name, "ceramic", linear(srgb), gloss=0.6)


def glass(name: str = "dark_glass", srgb: str = "#15181b") -> Material:
    """Glass in front of something dark."""
    return Material(name, "glass", linear(srgb), gloss=0.8)


def paint(name: str, acoustic: str, srgb: str, *, gloss: float = 0.2) -> Material:
    """Any other plain material."""
    return Material(name, acoustic, linear(srgb), gloss=gloss)


def printed(name: str, pixels: Pixels, *, acoustic: str = "plastic", gloss: float = 0.3) -> Material:
    """A face with a picture on it; use it on quads and discs that fit the texture once."""
    return Material(name, acoustic, texture=Texture(name, pixels), gloss=gloss)


def lamp(name: str, srgb: str, radiance: float) -> Material:
    """A pilot light."""
    r, g, b = linear(srgb)
    return Material(name, "plastic", (r, g, b), emission=(r * radiance, g * radiance, b * radiance))


def _bands(stops: list[tuple[float, str]], size: int = 128) -> NDArray[np.float64]:
    """(size, 3) sRGB ramp 0–255 through ``stops`` (position in [0, 1], colour), smooth between them."""
    at = np.array([s for s, _ in stops])
    colours = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for _, c in stops], dtype=np.float64)
    x = (np.arange(size) + 0.5) / size
    return np.stack([np.interp(x, at, colours[:, k]) for k in range(3)], axis=1)


def chrome(name: str = "chrome") -> Material:
    """Polished metal; the texture's v runs through a horizon (dark below, bright above), as chrome mirrors a room."""
    ramp = _bands(
        [
            (0.0, "#d9dce0"),
            (0.18, "#f4f5f6"),
            (0.34, "#a9aeb4"),
            (0.46, "#6f757c"),
            (0.52, "#8d949b"),
            (0.62, "#dfe2e5"),
            (0.80, "#f7f8f8"),
            (1.0, "#d9dce0"),
        ]
    )
    pixels = np.repeat(ramp[::-1, None, :], 8, axis=1)
    return Material(name, "metal", texture=Texture(name, np.round(pixels).astype(np.uint8)), gloss=0.9)


def brushed_steel(name: str, rng: Generator, srgb: str = "#b9bcbe", *, contrast: float = 7.0) -> Material:
    """Brushed stainless steel: fine streaks along u."""
    base = np.array([int(srgb[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)
    streaks = rng.normal(size=(256, 1)) * contrast * 0.6 + rng.normal(size=(256, 64)) * contrast * 0.25
    smooth = (streaks + np.roll(streaks, 1, axis=1) + np.roll(streaks, -1, axis=1)) / 3
    pixels = np.clip(base + smooth[..., None], 0, 255)
    return Material(name, "metal", texture=Texture(name, np.round(pixels).astype(np.uint8)), gloss=0.6)


def wood(name: str, rng: Generator, srgb: str = "#6b4326") -> Material:
    """Polished hardwood: grain along u, one repeat per ``tile``."""
    base = np.array([int(srgb[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)
    v = np.arange(256)[:, None] / 256
    u = np.arange(256)[None, :] / 256
    phase = rng.uniform(0, 2 * np.pi, size=4)
    # Integer frequencies along both axes keep the texture seamless.
    warp = 0.02 * np.sin(2 * np.pi * (u + v) + phase[0]) + 0.012 * np.sin(2 * np.pi * (2 * u - v) + phase[1])
    rings = np.sin(2 * np.pi * 9 * (v + warp) + phase[2]) * 0.55 + np.sin(2 * np.pi * 31 * (v + warp)) * 0.25
    pores = rng.normal(size=(256, 1)) * 0.25 + rng.normal(size=(256, 256)) * 0.05
    shade = 1.0 + 0.13 * (rings + pores)
    pixels = np.clip(base * shade[..., None], 0, 255)
    return Material(name, "wood", texture=Texture(name, np.round(pixels).astype(np.uint8)), gloss=0.45)
