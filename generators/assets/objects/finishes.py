"""Materials of household goods: enamel, plastics, chrome, steel, glass, ceramic, rubber, wood, and printed faces.

Colours are given as sRGB and stored linear. Plain finishes are cached, because a mesh distinguishes its materials by
identity.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.textures.maps import Surface, surfaced
from generators.core.scene import Material, Texture

Pixels = NDArray[np.uint8]
Array = NDArray[np.float64]
Colour = tuple[float, float, float]

#: Metres per repeat of a texture on goods, which have no sizes of their own (`MeshBuilder`).
_REPEAT = 1.0
#: Height (m) of the streaks of brushed steel, about their standard deviation.
_STREAK = 5e-4


def hex_rgb(srgb: str) -> Array:
    """``"#rrggbb"`` as (3,) sRGB values 0–255."""
    return np.array([int(srgb[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)


def to_linear(values: Array) -> Array:
    """SRGB 0–255 as linear light in [0, 1] (IEC 61966-2-1)."""
    v = np.asarray(values, dtype=np.float64) / 255
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def to_srgb(light: Array) -> Pixels:
    """Linear light as uint8 sRGB."""
    v = np.clip(light, 0.0, 1.0)
    return np.round(255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.uint8)


def linear(srgb: str) -> Colour:
    """``"#rrggbb"`` as linear-light albedo."""
    r, g, b = (float(v) for v in to_linear(hex_rgb(srgb)))
    return r, g, b


def choose(rng: Generator, *options: str) -> str:
    """One of ``options``."""
    return options[int(rng.integers(len(options)))]


@cache
def enamel(name: str, srgb: str) -> Material:
    """Painted or enamelled sheet steel."""
    return Material(name, "metal", linear(srgb), roughness=0.25)


@cache
def plastic(name: str, srgb: str, *, roughness: float = 0.4) -> Material:
    """Moulded plastic."""
    return Material(name, "plastic", linear(srgb), roughness=roughness)


@cache
def rubber(name: str = "rubber", srgb: str = "#2b2c2e") -> Material:
    """Rubber (feet, gaskets, tyres, hoses); sounds like plastic."""
    return Material(name, "plastic", linear(srgb), roughness=0.9)


@cache
def ceramic(name: str = "ceramic", srgb: str = "#f3f3ef") -> Material:
    """Glazed sanitary ware and china."""
    return Material(name, "ceramic", linear(srgb), roughness=0.16)


@cache
def glass(name: str = "dark_glass", srgb: str = "#15181b") -> Material:
    """Glass in front of something dark."""
    return Material(name, "glass", linear(srgb), roughness=0.04)


@cache
def paint(name: str, acoustic: str, srgb: str, *, roughness: float = 0.64) -> Material:
    """Any other plain material."""
    return Material(name, acoustic, linear(srgb), roughness=roughness)


@cache
def lamp(name: str, srgb: str, radiance: float) -> Material:
    """A pilot light; ``radiance`` in the scene's light unit (about 1 = a white wall in daylight)."""
    r, g, b = (0.8 * v for v in linear(srgb))
    return Material(name, "plastic", (r, g, b), emission=(r * radiance, g * radiance, b * radiance))


def printed(name: str, pixels: Pixels, *, acoustic: str = "plastic", roughness: float = 0.49) -> Material:
    """A face with a picture on it, for quads and discs that fit the texture once."""
    return Material(name, acoustic, texture=Texture(name, pixels), roughness=roughness)


@cache
def chrome(name: str = "chrome", tint: str = "#dcdee0") -> Material:
    """Polished metal (``tint``: brass, copper …)."""
    return Material(name, "metal", linear(tint), roughness=0.01, metallic=1.0)


def brushed_steel(name: str, rng: Generator, srgb: str = "#b9bcbe", *, contrast: float = 7.0) -> Material:
    """Brushed stainless steel: fine streaks along u."""
    streaks = rng.normal(size=(256, 1)) * contrast * 0.6 + rng.normal(size=(256, 64)) * contrast * 0.25
    smooth = (streaks + np.roll(streaks, 1, axis=1) + np.roll(streaks, -1, axis=1)) / 3
    pixels = np.clip(np.round(hex_rgb(srgb) + smooth[..., None]), 0, 255).astype(np.uint8)
    surface = Surface(pixels, _STREAK * smooth / contrast)
    return surfaced(name, "metal", surface, 0.16, _REPEAT * smooth.shape[1] / len(smooth), metallic=1.0)


def wood(name: str, rng: Generator, srgb: str = "#6b4326") -> Material:
    """Polished hardwood: grain along u; seamless, because all its frequencies are whole."""
    v, u = (k / 256 for k in np.mgrid[0:256, 0:256])
    phase = rng.uniform(0, 2 * np.pi, size=3)
    warp = 0.02 * np.sin(2 * np.pi * (u + v) + phase[0]) + 0.012 * np.sin(2 * np.pi * (2 * u - v) + phase[1])
    rings = 0.55 * np.sin(2 * np.pi * 9 * (v + warp) + phase[2]) + 0.25 * np.sin(2 * np.pi * 31 * (v + warp))
    pores = rng.normal(size=(256, 1)) * 0.25 + rng.normal(size=(256, 256)) * 0.05
    shade = 1.0 + 0.13 * (rings + pores)
    pixels = np.clip(np.round(hex_rgb(srgb) * shade[..., None]), 0, 255).astype(np.uint8)
    return Material(name, "wood", texture=Texture(name, pixels), roughness=0.3)
