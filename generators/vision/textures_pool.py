"""All textures of a scene in one flat buffer, each with its mip chain.

Texels stay 8-bit sRGB (a quarter of float32's memory) and are decoded through a 256-entry table as they are read.
Levels are filtered in linear light: a fine black-and-white pattern fades to the grey that emits the mean of its light.
"""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.jit import inline, njit
from generators.core.scene import F32, I32, Texture
from generators.core.tone import decode_table, srgb_encode

#: Rows of a level that are filtered at a time.
_STRIP = 256
#: Number of steps of linear light for which the 8-bit value is tabulated.
_STARTS = 4096


class TexturePool(NamedTuple):
    """Textures and their mip levels (a named tuple, for kernels take it as it is).

    Attributes:
        texels: flat uint8; a level is (height, width, 3), row 0 at v = 1.
        offset: (L,) int64, where each level begins in ``texels``.
        size: (L, 2) int32, height and width of each level.
        first: (T + 1,) int32, the level 0 of each texture; its levels end where the next texture's begin.
        decode: (256,) float32, linear light of an 8-bit sRGB value, or the value itself in [0, 1] of plain numbers.
    """

    texels: NDArray[np.uint8]
    offset: NDArray[np.int64]
    size: I32
    first: I32
    decode: F32


#: The last pool, with the textures it was built of: a scene in which something moves is opened once per frame.
_last: tuple[tuple[Texture, ...], TexturePool] | None = None


def build_pool(textures: Sequence[Texture]) -> TexturePool:
    """Put ``textures`` and their mip chains in one buffer; texture i of the pool is ``textures[i]``.

    The same textures as the last time give the same pool.

    Raises:
        Avs3dError: if a texture is not (H, W, 3) uint8.
    """
    global _last
    if _last is not None and len(_last[0]) == len(textures) and all(map(operator.is_, _last[0], textures)):
        return _last[1]
    pool = _pool(textures, mip_chain, decode_table())
    _last = (tuple(textures), pool)
    return pool


def build_plain_pool(textures: Sequence[Texture]) -> TexturePool:
    """The same of textures that are plain numbers, not sRGB: normals, roughness.

    Raises:
        Avs3dError: if a texture is not (H, W, 3) uint8.
    """
    return _pool(textures, plain_chain, (np.arange(256) / 255.0).astype(np.float32))


def _pool(
    textures: Sequence[Texture], chain: Callable[[NDArray[np.uint8]], list[NDArray[np.uint8]]], decode: F32
) -> TexturePool:
    levels: list[NDArray[np.uint8]] = []
    first = [0]
    for texture in textures:
        pixels = texture.pixels
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
            raise Avs3dError(
                f"texture {texture.name!r}: pixels are {pixels.dtype} of shape {pixels.shape}, expected uint8 (H, W, 3)"
            )
        levels.extend(chain(pixels))
        first.append(len(levels))
    if not levels:  # kernels want arrays of their type even where nothing is textured
        levels.append(np.full((1, 1, 3), 255, dtype=np.uint8))
    sizes = np.array([level.shape[:2] for level in levels], dtype=np.int32)
    counts = [level.size for level in levels]
    return TexturePool(
        texels=np.concatenate([level.reshape(-1) for level in levels]),
        offset=np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
        size=sizes,
        first=np.array(first, dtype=np.int32),
        decode=decode,
    )


def distinct(textures: Sequence[Texture | None]) -> tuple[list[Texture], list[int]]:
    """Textures without repetition (by their pixels), and for each given one its index among them (−1: none)."""
    unique: list[Texture] = []
    by_identity: dict[int, int] = {}
    by_content: dict[bytes, int] = {}
    index: list[int] = []
    for texture in textures:
        if texture is None:
            index.append(-1)
            continue
        known = by_identity.get(id(texture))
        if known is None:
            digest = hashlib.blake2b(repr(texture.pixels.shape).encode())
            digest.update(np.ascontiguousarray(texture.pixels).data)
            known = by_content.setdefault(digest.digest(), len(unique))
            if known == len(unique):
                unique.append(texture)
            by_identity[id(texture)] = known
        index.append(known)
    return unique, index


def mip_chain(pixels: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """The texture and its halvings down to 1×1, sRGB uint8, box-filtered in linear light.

    Filtering goes on from float32, so that rounding to 8 bits does not add up over the levels.
    """
    levels = [np.ascontiguousarray(pixels)]
    linear: F32 | None = None
    while max(levels[-1].shape[:2]) > 1:
        linear = _halved_light(levels[0]) if linear is None else _halved(linear)
        level = np.empty(linear.shape, dtype=np.uint8)
        _encode(linear.reshape(-1), *_encoding(), level.reshape(-1))
        levels.append(level)
    return levels


def plain_chain(pixels: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """The texture of plain numbers and its halvings down to 1×1, uint8, box-filtered."""
    levels = [np.ascontiguousarray(pixels)]
    values: F32 = pixels.astype(np.float32)
    while max(levels[-1].shape[:2]) > 1:
        values = _halved(values)
        levels.append(np.rint(values).astype(np.uint8))
    return levels


def _halved_light(image: NDArray[np.uint8]) -> F32:
    """Halve both axes of 8-bit sRGB in linear light; in strips, since a scan's texture has 10⁸ texels."""
    # OpenCV's look-up takes a tenth of numpy's time.
    height = len(image)
    step = height if height % 2 else 2 * _STRIP
    strips = [_halved(np.asarray(cv2.LUT(image[at : at + step], decode_table()))) for at in range(0, height, step)]
    return np.concatenate(strips)


def _halved(image: F32) -> F32:
    """Halve both axes (rounded down, 1 stays 1) with a box filter."""
    height, width = image.shape[:2]
    out = np.empty((max(height // 2, 1), max(width // 2, 1), 3), dtype=np.float32)
    _halve(image, np.empty((width, 3), dtype=np.float32), out)
    return out


@inline
def _blend(a: Any, b: Any, c: Any, i: int, length: int) -> Any:
    """Texel i of a halved axis, from the three from 2·i on.

    An odd length 2n + 1 is shared out among n texels by three taps each (S. Guthe, P. Heckbert, "Non-Power-of-Two
    Mipmapping", NVIDIA 2005).
    """
    if length == 1:
        return a
    if length % 2 == 0:
        return (a + b) * np.float32(0.5)
    n, total = length // 2, np.float32(length)
    return np.float32(n - i) / total * a + np.float32(n) / total * b + np.float32(i + 1) / total * c


@njit
def _halve(image: F32, line: F32, out: F32) -> None:
    """Halve both axes of ``image`` (H, W, 3), first the rows; ``line`` (W, 3) is scratch."""
    height, width = image.shape[:2]
    for y in range(len(out)):
        first, second, third = image[2 * y], image[min(2 * y + 1, height - 1)], image[min(2 * y + 2, height - 1)]
        for x in range(width):
            for k in range(3):
                line[x, k] = _blend(first[x, k], second[x, k], third[x, k], y, height)
        for x in range(out.shape[1]):
            at, after = min(2 * x + 1, width - 1), min(2 * x + 2, width - 1)
            for k in range(3):
                out[y, x, k] = _blend(line[2 * x, k], line[at, k], line[after, k], x, width)


@lru_cache(maxsize=1)
def _encoding() -> tuple[F32, NDArray[np.uint8]]:
    """(255,) the least linear light that is shown as 1, 2, … of 255, and (`_STARTS` + 1,) what i / `_STARTS` is."""
    low, high = np.zeros(255, dtype=np.int32), np.full(255, np.float32(1.0).view(np.int32))
    wanted = np.arange(1, 256)
    while (high - low).max() > 1:  # numbers from 0 on are in the order of their bits
        middle = (low + high) // 2
        reached = np.rint(255.0 * srgb_encode(middle.view(np.float32))) >= wanted
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    limits = high.view(np.float32)
    starts = np.arange(_STARTS + 1, dtype=np.float32) / np.float32(_STARTS)
    return limits, np.searchsorted(limits, starts, side="right").astype(np.uint8)


@njit
def _encode(linear: F32, limits: F32, starts: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """8-bit sRGB of linear light (N,), rounded to the nearest: `srgb_encode` without its powers."""
    last = np.float32(len(starts) - 1)
    for i in range(len(linear)):
        light = linear[i]
        value = int(starts[int(min(max(light, np.float32(0.0)), np.float32(1.0)) * last)])
        while value < 255 and light >= limits[value]:
            value += 1
        out[i] = value
