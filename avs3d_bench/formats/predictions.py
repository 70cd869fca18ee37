"""Reading a submission's masks, class ids and points: nothing is decoded before its size is known to be right."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes
from avs3d_bench.formats.media import PngHeader, decode_png, is_binary
from avs3d_bench.formats.ply import read_ply
from avs3d_bench.formats.ply_reader import read_header

#: Size of the largest submission.json (bytes); it holds a few lines.
MAX_JSON_BYTES = 2**20
#: Size of the largest points.ply (bytes).
MAX_POINTS_BYTES = 64 * 2**20
#: Text takes longer to read than binary: this much, some seconds.
MAX_ASCII_BYTES = 8 * 2**20
#: No home is as large as this, metres: points beyond are in another unit.
MAX_COORDINATE = 1000.0
_GREY, _RGB = 0, 2
#: Values named in a message.
_NAMED = 4


def check_file(path: Path, most: int) -> None:
    """Raise an error if the path is no plain file (a pipe would wait for ever) or the file is too large."""
    try:
        found = os.stat(path)
    except FileNotFoundError:
        raise Avs3dError(f"{path}: missing; expected a file") from None
    except OSError as error:
        raise Avs3dError(f"{path}: cannot be opened ({error.strerror}); expected a file") from None
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "no plain file"
        raise Avs3dError(f"{path}: {kind}; expected a file")
    if found.st_size > most:
        raise Avs3dError(f"{path}: {found.st_size:,} bytes, expected at most {most:,}")


def _check_size(path: Path, header: PngHeader, width: int, height: int) -> None:
    if (header.width, header.height) != (width, height):
        raise Avs3dError(
            f"{path}: {header.width}×{header.height} pixels, expected {width}×{height}, the size of the frame"
        )


def read_mask(
    path: Path, width: int, height: int, *, released: bool, seen: Callable[[bytes], None] | None = None
) -> NDArray[np.uint8]:
    """A predicted mask.

    Args:
        path: a PNG file, grey with 8 bits or 1.
        width: that it must have, pixels.
        height: likewise.
        released: accept what the released pipeline writes as well: RGB with three equal channels.
        seen: called with the bytes of the file.

    Returns:
        (H, W) uint8, exactly 0 or 255.

    Raises:
        Avs3dError: if the file is missing, no plain file, damaged, of another size or mode, or holds other values.
    """
    check_file(path, 4 * width * height + 65_536)

    def check(header: PngHeader) -> None:
        _check_size(path, header, width, height)
        grey = header.colour_type == _GREY and header.bits in (1, 8)
        if not grey and not (released and header.colour_type == _RGB and header.bits == 8):
            raise Avs3dError(f"{path}: {header.mode}; expected a mask: grey, 8 bit, 0 or 255")

    pixels = decode_png(path, cv2.IMREAD_UNCHANGED, check, plain=True, data=_read(path, seen))
    if pixels.ndim == 3:
        first, second, third = cv2.split(pixels)
        if cv2.norm(first, second, cv2.NORM_INF) or cv2.norm(first, third, cv2.NORM_INF):
            raise Avs3dError(f"{path}: a coloured picture; expected a mask: grey, 8 bit, 0 or 255")
        pixels = first
    if not is_binary(pixels):
        raise Avs3dError(f"{path}: {_values(pixels)}")
    return np.asarray(pixels, dtype=np.uint8)


def read_categories(
    path: Path, width: int, height: int, classes: int, *, seen: Callable[[bytes], None] | None = None
) -> NDArray[np.uint8]:
    """The predicted class ids of a frame of part_3.

    Args:
        path: a PNG file, grey with 8 bits.
        width: that it must have, pixels.
        height: likewise.
        classes: the highest class id of the dataset.
        seen: called with the bytes of the file.

    Returns:
        (H, W) uint8: 0 for nothing, else a class id (see `avs3d_bench.contract.taxonomy.class_ids`).

    Raises:
        Avs3dError: if the file is missing, no plain file, damaged, of another size or mode, or holds other values.
    """
    check_file(path, 4 * width * height + 65_536)

    def check(header: PngHeader) -> None:
        _check_size(path, header, width, height)
        if header.colour_type != _GREY or header.bits != 8:
            raise Avs3dError(f"{path}: {header.mode}; expected class ids: grey, 8 bit, 0 to {classes}")

    pixels = decode_png(path, cv2.IMREAD_UNCHANGED, check, plain=True, data=_read(path, seen))
    highest = int(pixels.max(initial=0))
    if highest > classes:
        hint = ": 0 and 255 make a mask, which belongs in masks/" if highest == 255 else ""
        raise Avs3dError(
            f"{path}: holds the value {highest}; expected class ids, 0 for nothing and 1 to {classes}{hint}"
        )
    return np.asarray(pixels, dtype=np.uint8)


def _read(path: Path, seen: Callable[[bytes], None] | None) -> bytes:
    data = read_bytes(path)
    if seen is not None:
        seen(data)
    return data


def _values(pixels: NDArray[np.uint8]) -> str:
    values = [int(value) for value in np.unique(pixels) if value not in (0, 255)]
    if values == [1] and pixels.max() == 1:
        return "holds 0 and 1; expected 0 and 255: multiply by 255"
    named = ", ".join(map(str, values[:_NAMED])) + (", …" if len(values) > _NAMED else "")
    return f"holds grey values ({named}); expected 0 and 255 only: threshold the prediction"


def read_points(path: Path) -> NDArray[np.float32]:
    """A predicted cloud, (N, 3) float32, metres, world coordinates (Y up); N = 0 means that nothing sounds.

    Raises:
        Avs3dError: if the file is missing, no plain file, no PLY, damaged, too large, or holds NaN.
    """
    check_file(path, MAX_POINTS_BYTES)
    header = read_header(path, most=layout.MAX_POINTS)
    if header.form == "ascii" and header.size > MAX_ASCII_BYTES:
        raise Avs3dError(
            f"{path}: {header.size:,} bytes of ASCII PLY, expected at most {MAX_ASCII_BYTES:,}: write it as binary"
        )
    points = read_ply(path).vertices
    furthest = float(np.abs(points).max(initial=0.0))
    if furthest > MAX_COORDINATE:
        raise Avs3dError(
            f"{path}: points {furthest:.3g} m from the origin, expected world coordinates in metres, within "
            f"{MAX_COORDINATE:g} m"
        )
    return points
