"""Materials of household goods: enamel, plastics, chrome, steel, glass, ceramic, rubber, wood, and printed faces.

Light is baked into the scene and does not depend on the view, so reflections of polished surfaces are painted: metal
has a texture of a room's reflection, looked up by its normals (see `mirrored`), dark glass a pale sheen. Colours are
given as sRGB and stored linear. Plain finishes are cached, because a mesh distinguishes its materials by identity.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.core.scene import Material, Mesh, Texture

Pixels = NDArray[np.uint8]
Array = NDArray[np.float64]
Colour = tuple[float, float, float]

#: Part of the specular reflection that is added to the diffuse albedo. Smooth dielectrics reflect 4 % at normal
#: incidence (Fresnel, n = 1.5), more at other angles; without it, black plastic would look like a hole.
SHEEN = 0.022
#: Prefix of the texture names that `mirrored` recognises.
_MIRROR = "mirror:"


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


def linear(srgb: str, sheen: float = 0.0) -> Colour:
    """``"#rrggbb"`` as linear-light albedo, lifted by ``sheen``."""
    r, g, b = (float(v) for v in sheen + (1 - sheen) * to_linear(hex_rgb(srgb)))
    return r, g, b


def choose(rng: Generator, *options: str) -> str:
    """One of ``options``."""
    return options[int(rng.integers(len(options)))]


@cache
def enamel(name: str, srgb: str) -> Material:
    """Painted or enamelled sheet steel."""
    return Material(name, "metal", linear(srgb, SHEEN), gloss=0.5)


@cache
def plastic(name: str, srgb: str, *, gloss: float = 0.3) -> Material:
    """Moulded plastic."""
    return Material(name, "plastic", linear(srgb, SHEEN), gloss=gloss)


@cache
def rubber(name: str = "rubber", srgb: str = "#2b2c2e") -> Material:
    """Rubber (feet, gaskets, tyres, hoses); sounds like plastic."""
    return Material(name, "plastic", linear(srgb, SHEEN / 2), gloss=0.05)


@cache
def ceramic(name: str = "ceramic", srgb: str = "#f3f3ef") -> Material:
    """Glazed sanitary ware and china."""
    return Material(name, "ceramic", linear(srgb), gloss=0.6)


@cache
def glass(name: str = "dark_glass", srgb: str = "#15181b") -> Material:
    """Glass in front of something dark."""
    return Material(name, "glass", linear(srgb, SHEEN), gloss=0.8)


@cache
def paint(name: str, acoustic: str, srgb: str, *, gloss: float = 0.2) -> Material:
    """Any other plain material."""
    return Material(name, acoustic, linear(srgb), gloss=gloss)


@cache
def lamp(name: str, srgb: str, radiance: float) -> Material:
    """A pilot light; ``radiance`` in the scene's light unit (about 1 = a white wall in daylight)."""
    r, g, b = (0.8 * v for v in linear(srgb))
    return Material(name, "plastic", (r, g, b), emission=(r * radiance, g * radiance, b * radiance))


def printed(name: str, pixels: Pixels, *, acoustic: str = "plastic", gloss: float = 0.3) -> Material:
    """A face with a picture on it, for quads and discs that fit the texture once; its sheen is that of plastic."""
    levels = to_srgb(SHEEN + (1 - SHEEN) * to_linear(np.arange(256, dtype=np.float64)))
    return Material(name, acoustic, texture=Texture(name, levels[pixels]), gloss=gloss)


@cache
def _room_reflection(tint: str) -> Texture:
    """A polished ball in a room seen from the front (128²): floor, dark horizon, walls, ceiling, a window at left."""
    size = 128
    y, x = np.mgrid[0:size, 0:size]
    nx, ny = (x + 0.5) / size * 2 - 1, 1 - (y + 0.5) / size * 2
    at = [-1.0, -0.7, -0.4, -0.2, -0.1, 0.0, 0.15, 0.38, 0.55, 0.75, 1.0]
    value = [0.28, 0.36, 0.40, 0.16, 0.20, 0.50, 0.60, 0.88, 0.82, 0.66, 0.78]
    light = np.interp(ny, at, value)
    light *= 1 - 0.45 * np.clip((np.abs(nx) - 0.62) / 0.38, 0, 1) ** 1.5
    window = np.exp(-(((nx + 0.42) / 0.20) ** 4) - (((ny - 0.26) / 0.24) ** 4))
    light = light + (0.97 - light) * window
    return Texture(f"{_MIRROR}{tint}", to_srgb(light[..., None] * to_linear(hex_rgb(tint))))


@cache
def chrome(name: str = "chrome", tint: str = "#fbfcfd") -> Material:
    """Polished metal (``tint``: brass, copper …); `mirrored` must be applied to the finished mesh."""
    return Material(name, "metal", texture=_room_reflection(tint), gloss=0.9, metal=linear(tint))


def mirrored(mesh: Mesh) -> Mesh:
    """The mesh with polished faces looked up by their shading normals: u, v = (1 + n_x)/2, (1 + n_y)/2."""
    shiny = [m.texture is not None and m.texture.name.startswith(_MIRROR) for m in mesh.materials]
    faces = np.asarray(shiny)[mesh.face_material]
    uv = mesh.uv.copy()
    # 0.49: half a texel inside, because textures repeat.
    uv[faces] = 0.5 + 0.49 * mesh.normals[faces][..., :2]
    return replace(mesh, uv=uv)


def brushed_steel(name: str, rng: Generator, srgb: str = "#b9bcbe", *, contrast: float = 7.0) -> Material:
    """Brushed stainless steel: fine streaks along u."""
    streaks = rng.normal(size=(256, 1)) * contrast * 0.6 + rng.normal(size=(256, 64)) * contrast * 0.25
    smooth = (streaks + np.roll(streaks, 1, axis=1) + np.roll(streaks, -1, axis=1)) / 3
    pixels = np.clip(np.round(hex_rgb(srgb) + smooth[..., None]), 0, 255).astype(np.uint8)
    return Material(name, "metal", texture=Texture(name, pixels), gloss=0.6, metal=linear(srgb))


def wood(name: str, rng: Generator, srgb: str = "#6b4326") -> Material:
    """Polished hardwood: grain along u; seamless, because all its frequencies are whole."""
    v, u = (k / 256 for k in np.mgrid[0:256, 0:256])
    phase = rng.uniform(0, 2 * np.pi, size=3)
    warp = 0.02 * np.sin(2 * np.pi * (u + v) + phase[0]) + 0.012 * np.sin(2 * np.pi * (2 * u - v) + phase[1])
    rings = 0.55 * np.sin(2 * np.pi * 9 * (v + warp) + phase[2]) + 0.25 * np.sin(2 * np.pi * 31 * (v + warp))
    pores = rng.normal(size=(256, 1)) * 0.25 + rng.normal(size=(256, 256)) * 0.05
    shade = 1.0 + 0.13 * (rings + pores)
    pixels = np.clip(np.round(hex_rgb(srgb) * shade[..., None]), 0, 255).astype(np.uint8)
    return Material(name, "wood", texture=Texture(name, pixels), gloss=0.45)
