"""The pictures of the pages: small frames and thumbnails (WebP), masks as transparent PNG of the dataset's own size.

Masks are not resampled: a clock of twenty pixels stays one. A page colours them itself, so they hold one bit a pixel.
"""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError

U8 = NDArray[np.uint8]
Mask = NDArray[np.bool_]

#: Longer side of the player's frames and of thumbnails, pixels.
PLAYER_SIDE, THUMB_SIDE = 720, 384
#: A thumbnail is at most this large: 34 of them load at once.
THUMB_BYTES = 20_000
PLAYER_QUALITY = 80
#: Colours of instances by their place in the sorted ids (after Okabe & Ito 2008); the sounding one has `SOUNDING`.
INSTANCE_COLOURS = ((0, 158, 115), (86, 180, 233), (240, 228, 66), (204, 121, 167), (0, 114, 178), (230, 159, 0))
SOUNDING = (228, 87, 46)


def hexadecimal(colour: tuple[int, int, int]) -> str:
    """``#e4572e``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def player_frame(rgb: U8) -> bytes:
    """A frame (H, W, 3) as the player shows it: WebP, at most `PLAYER_SIDE` pixels a side."""
    # Small pictures are shown enlarged, which shows what WebP takes away.
    return _webp(shrunk(rgb, PLAYER_SIDE), PLAYER_QUALITY if max(rgb.shape) > PLAYER_SIDE // 2 else 95)


def thumbnail(rgb: U8) -> bytes:
    """A frame (H, W, 3) as the gallery shows it: WebP of at most `THUMB_BYTES`."""
    small = shrunk(rgb, THUMB_SIDE)
    for quality in (80, 70, 60, 45, 30):
        data = _webp(small, quality)
        if len(data) <= THUMB_BYTES:
            return data
    return _webp(shrunk(rgb, THUMB_SIDE // 2), 60)


def mask_png(mask: Mask) -> bytes:
    """A mask (H, W): white where it is set, transparent elsewhere."""
    packed = np.packbits(mask, axis=1)
    return _palette_png(packed, mask.shape[1], 1, ((0, 0, 0), (255, 255, 255)))


def instances_png(ids: NDArray[np.uint16], colours: dict[int, tuple[int, int, int]]) -> bytes:
    """Instance ids (H, W): each instance in its colour, the scan and unknown ids transparent."""
    known = sorted(colours)[:255]
    lookup = np.zeros(65536, dtype=np.uint8)
    lookup[known] = np.arange(1, len(known) + 1)
    return _palette_png(lookup[ids], ids.shape[1], 8, ((0, 0, 0), *(colours[number] for number in known)))


def audible_png(mask: Mask, ids: NDArray[np.uint16], colours: dict[int, tuple[int, int, int]]) -> bytes:
    """A mask (H, W) of several instances: each in its colour, transparent where it is not set.

    Args:
        mask: what is audible and visible.
        ids: instance ids (H, W).
        colours: instance id → RGB; other pixels of the mask (there are none in a valid dataset) are white.

    Raises:
        Avs3dError: if the two are not of one size.
    """
    if mask.shape != ids.shape:
        raise Avs3dError(f"a semantic mask of {mask.shape} beside an instance mask of {ids.shape}; regenerate them")
    known = sorted(colours)[:254]
    lookup = np.ones(65536, dtype=np.uint8)
    lookup[known] = np.arange(2, len(known) + 2)
    rows = np.where(mask, lookup[ids], 0).astype(np.uint8)
    return _palette_png(rows, ids.shape[1], 8, ((0, 0, 0), (255, 255, 255), *(colours[number] for number in known)))


def instance_colours(ids: list[int], sounding: int | None) -> dict[int, tuple[int, int, int]]:
    """The colour of each instance id."""
    silent = [number for number in sorted(ids) if number != sounding]
    out = {number: INSTANCE_COLOURS[i % len(INSTANCE_COLOURS)] for i, number in enumerate(silent)}
    return out if sounding is None else {**out, sounding: SOUNDING}


def outline_path(mask: Mask, tolerance: float = 0.002) -> str:
    """The outline of a mask (H, W) as an SVG path in a square of 1000 × 1000; empty where nothing is set.

    Args:
        mask: what is outlined, holes included (fill rule: even-odd).
        tolerance: how far the path may leave the outline, in sides of the picture.
    """
    height, width = mask.shape
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    pieces = []
    for contour in found:
        simple = cv2.approxPolyDP(contour, tolerance * max(height, width), True)[:, 0].astype(float)
        if len(simple) < 3:
            continue
        points = np.rint((simple + 0.5) * (1000 / width, 1000 / height)).astype(int)
        pieces.append("M" + "L".join(f"{x},{y}" for x, y in points) + "Z")
    return "".join(pieces)


def shrunk(rgb: U8, side: int) -> U8:
    """A picture (H, W, 3), at most ``side`` pixels a side."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    if scale >= 1:
        return rgb
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)


def _webp(rgb: U8, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise Avs3dError(f"OpenCV could not encode a picture of {rgb.shape} as WebP; reinstall opencv-python-headless")
    return bytes(data)


def rgba_png(rgba: U8) -> bytes:
    """(H, W, 4) RGBA as PNG."""
    done, data = cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise Avs3dError(f"OpenCV could not encode a picture of {rgba.shape} as PNG; reinstall opencv-python-headless")
    return bytes(data)


def _palette_png(rows: U8, width: int, bits: int, palette: tuple[tuple[int, int, int], ...]) -> bytes:
    """An indexed PNG whose first colour is transparent (OpenCV writes no palettes).

    Args:
        rows: (H, bytes per row), pixels packed.
        width: pixels.
        bits: per pixel.
        palette: RGB.
    """

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    filtered = np.concatenate([np.zeros((len(rows), 1), np.uint8), rows], axis=1)
    return b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, len(rows), bits, 3, 0, 0, 0)),
            chunk(b"PLTE", bytes(value for colour in palette for value in colour)),
            chunk(b"tRNS", b"\x00"),
            chunk(b"IDAT", zlib.compress(filtered.tobytes(), 6)),
            chunk(b"IEND", b""),
        )
    )
