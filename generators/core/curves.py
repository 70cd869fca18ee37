"""Curves in the xz plane of a room: arc length, equidistant sampling, smoothing within free space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.core.freespace import FreeSpace

Array = NDArray[np.float64]

#: Spacing of the points of a smoothed curve, metres.
SPACING = 0.02


def arc_length(path: Array) -> Array:
    """(M,) arc length of a polyline (M, 2) up to each of its points, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def resample(line: Array, spacing: float) -> Array:
    """The polyline (M, 2) resampled at equal distances of about ``spacing`` metres; both ends are kept."""
    arc = arc_length(line)
    count = max(2, int(arc[-1] / spacing) + 1)
    at = np.linspace(0.0, float(arc[-1]), count)
    return np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=1)


def smooth(space: FreeSpace, line: Array) -> Array:
    """``line`` (M, 2) resampled every 2 cm and smoothed wherever it then stays in free space."""
    path = resample(line, SPACING)
    for _ in range(14):
        if len(path) < 3:
            break
        target = ndimage.gaussian_filter1d(path, 6.0, axis=0, mode="nearest")
        for share in (1.0, 0.5, 0.25):
            moved = path + share * (target - path)
            fits = space.contains(moved)
            path = np.where(fits[:, None], moved, path)
            target = np.where(fits[:, None], path, target)
    return path
