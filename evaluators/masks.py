"""Reading a submission's clouds of points (its masks: `avs3d_bench.predictions`), sizes first."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.ply import read_ply
from avs3d_bench.predictions import check_file, read_mask
from avs3d_bench.report import printable
from avs3d_bench.submission import MAX_POINTS

MAX_POINTS_BYTES = 64 * 2**20
#: A PLY of text takes some twenty times its size in memory while it is read.
MAX_ASCII_BYTES = 8 * 2**20
#: A header of a PLY is shorter than this.
_HEADER_BYTES = 64 * 2**10
_END = re.compile(rb"^end_header\r?$", re.MULTILINE)
_VERTICES = re.compile(rb"^element[ \t]+vertex[ \t]+(\d{1,18})\s*$", re.MULTILINE)
#: No home is as large as this, metres: points beyond are in another unit.
MAX_COORDINATE = 1000.0

__all__ = ["MAX_POINTS_BYTES", "check_file", "read_mask", "read_points"]


def read_points(path: Path) -> NDArray[np.float32]:
    """A predicted cloud, (N, 3) float32, metres, world coordinates (Y up); N = 0 says that nothing sounds.

    Raises:
        Avs3dError: if the file is missing, no plain file, no PLY, damaged, too large, or holds NaN.
    """
    check_file(path, MAX_POINTS_BYTES)
    _check_announced(path)
    try:
        with np.errstate(all="ignore"):  # doubles beyond float32 become infinite, which is found below
            points = read_ply(path).vertices
    except (ValueError, OverflowError) as error:
        raise Avs3dError(
            f"{path}: a PLY whose header contradicts itself ({printable(str(error))}); expected vertices with x, y, z"
        ) from None
    furthest = float(np.abs(points).max(initial=0.0))
    if furthest > MAX_COORDINATE:
        raise Avs3dError(
            f"{path}: points {furthest:.3g} m from the origin, expected world coordinates in metres, within "
            f"{MAX_COORDINATE:g} m"
        )
    return points


def _check_announced(path: Path) -> None:
    """Refuse from the header alone what would take too much memory to read."""
    try:
        with open(path, "rb") as stream:
            head = stream.read(_HEADER_BYTES)
    except OSError as error:
        raise Avs3dError(f"{path}: cannot be opened ({error.strerror}); expected a file") from None
    end = _END.search(head)
    if not head.startswith(b"ply") or (len(head) < _HEADER_BYTES and end is None):
        return  # the reader says what is wrong
    if end is None:
        raise Avs3dError(f"{path}: no end_header in its first {_HEADER_BYTES:,} bytes; expected a PLY of points")
    head = head[: end.start()]
    for count in _VERTICES.findall(head):
        if int(count) > MAX_POINTS:
            raise Avs3dError(f"{path}: {int(count):,} points, expected at most {MAX_POINTS:,}")
    size = path.stat().st_size
    if size > MAX_ASCII_BYTES and b"ascii" in head:
        raise Avs3dError(
            f"{path}: {size:,} bytes of ASCII PLY, expected at most {MAX_ASCII_BYTES:,}: write it as binary"
        )
