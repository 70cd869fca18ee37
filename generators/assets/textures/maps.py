"""Normal and roughness maps of the procedural textures, from the height field that their colours come from.

Both are glTF 2.0's (3.9.2, 3.9.3): a normal map is in the tangent space of ``uv``, x along u, y along v (green up), and
stores (n + 1)/2; a roughness map has the roughness in green and the metallic in blue, each a factor of the material's
own. Neither is sRGB.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np

from generators.assets.textures.noise import Field, Image
from generators.core.scene import F32, Material, Texture

#: Longest side of a map (texels): a texture of 1024² has maps of a quarter of its size.
LARGEST_MAP = 512


class Surface(NamedTuple):
    """A texture with its relief.

    Attributes:
        pixels: (H, W, 3) uint8 sRGB, the colour.
        height: (H, W) metres, of any zero; None for a flat surface.
        tilt: (H, W, 2) slopes dh/du and dh/dv (v up) in addition to those of ``height``, for pieces that are not level
            (tiles, boards), whose height itself would jump from one to the next.
        matte: (H, W) in [0, 1]: 0 is as rough as the material, 1 is the roughness 1; None for an even surface.
    """

    pixels: Image
    height: Field | None = None
    tilt: Field | None = None
    matte: Field | None = None


def normal_map(height: Field, metres: float, tilt: Field | None = None) -> Image:
    """(h, w, 3) uint8 normals of a height field that repeats, at most `LARGEST_MAP` to a side.

    The normal is (−dh/du, −dh/dv, 1), normalised; slopes are central differences. x and y are dithered.

    Args:
        height: (H, W) metres, row 0 at the top.
        metres: size of the W columns; the rows have the same pitch.
        tilt: (H, W, 2) further slopes (see `Surface`).
    """
    small = _reduced(height)
    pitch = metres / small.shape[1]
    wide = np.pad(small, 1, mode="wrap")
    x = (wide[1:-1, :-2] - wide[1:-1, 2:]) / (2 * pitch)
    y = (wide[2:, 1:-1] - wide[:-2, 1:-1]) / (2 * pitch)
    if tilt is not None:
        further = _reduced(tilt)
        x -= further[..., 0]
        y -= further[..., 1]
    length = np.sqrt(x * x + y * y + 1)
    dither = _dither(*small.shape) - 0.5
    pixels = np.empty((*small.shape, 3), dtype=np.uint8)
    pixels[..., 0] = np.rint((x / length + 1) * 127.5 + dither)
    pixels[..., 1] = np.rint((y / length + 1) * 127.5 + dither)
    pixels[..., 2] = np.rint((1 / length + 1) * 127.5)
    return pixels


@lru_cache(maxsize=4)
def _dither(height: int, width: int) -> F32:
    """(H, W) in [0, 1): a step of a byte is .45°, which a polished tile would show as facets; so neighbours differ.

    The sequence R2 (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018): means over a few
    texels are nearly exact.
    """
    rows, columns = np.arange(height)[:, None], np.arange(width)[None, :]
    return np.asarray((0.7548776662 * columns + 0.5698402910 * rows) % 1.0, dtype=np.float32)


def roughness_map(matte: Field, roughness: float) -> tuple[float, Image]:
    """The material's roughness factor, and the map whose product with it is ``roughness`` where ``matte`` is 0.

    Args:
        matte: (H, W), see `Surface`.
        roughness: of the material.
    """
    rough = roughness + (1 - roughness) * np.clip(_reduced(matte), 0, 1)
    factor = float(rough.max())
    pixels = np.full((*rough.shape, 3), 255, dtype=np.uint8)
    pixels[..., 1] = np.rint(255 * rough / factor)
    return factor, pixels


def _reduced(values: Field) -> F32:
    """``values`` as float32 with at most `LARGEST_MAP` rows and columns, each the mean of those that it replaces."""
    largest = max(values.shape[:2])
    small = values.astype(np.float32)
    if largest <= LARGEST_MAP:
        return small
    height, width = (round(side * LARGEST_MAP / largest) for side in values.shape[:2])
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)


def surfaced(
    role: str, acoustic: str, surface: Surface | Image, roughness: float, metres: float, **more: Any
) -> Material:
    """A material with the maps that its surface has.

    Args:
        role: name of the material and its textures.
        acoustic: label of its acoustic material.
        surface: with its relief, or only its colour.
        roughness: where the surface is not ``matte``.
        metres: size of the texture's width.
        more: further attributes of `Material`.
    """
    if not isinstance(surface, Surface):
        surface = Surface(surface)
    if surface.height is not None:
        more["normal_map"] = Texture(f"{role}_normal", normal_map(surface.height, metres, surface.tilt))
    if surface.matte is not None:
        roughness, pixels = roughness_map(surface.matte, roughness)
        more["roughness_map"] = Texture(f"{role}_roughness", pixels)
    return Material(role, acoustic, texture=Texture(role, surface.pixels), roughness=roughness, **more)
