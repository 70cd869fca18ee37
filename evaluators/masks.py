"""Reading a submission's clouds of points (its masks: `avs3d_bench.predictions`), sizes first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.ply import read_ply
from avs3d_bench.ply_reader import read_header
from avs3d_bench.predictions import check_file, read_mask
from avs3d_bench.submission import MAX_POINTS

MAX_POINTS_BYTES = 64 * 2**20
#: Text takes longer to read than binary: this much, some seconds.
MAX_ASCII_BYTES = 8 * 2**20
#: No home is as large as this, metres: points beyond are in another unit.
MAX_COORDINATE = 1000.0

__all__ = ["MAX_POINTS_BYTES", "check_file", "read_mask", "read_points"]


def read_points(path: Path) -> NDArray[np.float32]:
    """A predicted cloud, (N, 3) float32, metres, world coordinates (Y up); N = 0 says that nothing sounds.

    Raises:
        Avs3dError: if the file is missing, no plain file, no PLY, damaged, too large, or holds NaN.
    """
    check_file(path, MAX_POINTS_BYTES)
    header = read_header(path, most=MAX_POINTS)
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
