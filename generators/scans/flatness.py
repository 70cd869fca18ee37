"""How flat a scanned surface is: its tilt, and how much it waves, measured on a grid of distances.

Two scales tell a rigid board from a cushion, a duvet or a heap: the noise of a scanner is short (a vertex, a few
centimetres) and averages out over `WINDOW`; what is left over larger distances are the waves of the surface itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Side of the square over which noise is averaged (m).
WINDOW = 0.09
#: Points farther than this from the plane count as this far: an object on the surface is no wave (m).
FARTHEST = 0.03
#: A normal distribution's standard deviation over its median absolute deviation.
NORMAL = 1.4826
#: A fit leaves out what is farther from it than three standard deviations, and keeps what is nearer than this (m).
_LEAST_SCATTER = 0.0005
_ROUNDS = 10


@dataclass(frozen=True)
class Flatness:
    """Of a grid of heights.

    Attributes:
        slope: rise along the grid's first and second axis (m/m).
        offset: height of the plane at the grid's first point (m).
        wave: robust standard deviation of the distances to the plane, averaged over `WINDOW` (m).
        scatter: the same without averaging (m).
        covered: share of the grid that lies on the surface.
    """

    slope: tuple[float, float]
    offset: float
    wave: float
    scatter: float
    covered: float

    @property
    def tilt(self) -> float:
        """Angle between the plane and the level from which heights are measured, degrees."""
        return math.degrees(math.atan(math.hypot(*self.slope)))


def flatness(height: Array, known: Mask, spacing: float) -> Flatness:
    """Fit a plane to ``height`` (N, M), metres, where ``known`` (N, M), on a grid with ``spacing`` metres.

    The plane is refitted without what is farther than three robust standard deviations, so that an object on a table
    does not tilt it.
    """
    if int(known.sum()) < 9:
        return Flatness((math.inf, math.inf), 0.0, math.inf, math.inf, 0.0)
    plane = fit_plane(height, known, spacing)
    rest = height - plane_on(plane, height.shape, spacing)
    own = rest[known]
    near = known & (np.abs(rest) <= FARTHEST)
    size = max(3, 2 * round(WINDOW / spacing / 2) + 1)
    # Averaged over the known points of each window alone.
    share = ndimage.uniform_filter(known.astype(np.float64), size, mode="constant")
    total = ndimage.uniform_filter(np.where(known, np.clip(rest, -FARTHEST, FARTHEST), 0.0), size, mode="constant")
    smooth = (total / np.maximum(share, 1e-9))[known]
    return Flatness(
        (float(plane[0]), float(plane[1])),
        float(plane[2]),
        NORMAL * float(np.median(np.abs(smooth))),
        NORMAL * float(np.median(np.abs(own))),
        float(near.mean()),
    )


def fit_plane(height: Array, known: Mask, spacing: float) -> Array:
    """(3,) rise per metre along both axes of the grid, and height at its first point: trimmed least squares."""
    i, j = np.nonzero(known)
    terms = np.column_stack([i * spacing, j * spacing, np.ones(len(i))])
    values = height[known]
    kept = np.ones(len(values), dtype=bool)
    plane = np.array([0.0, 0.0, float(np.median(values))])
    for turn in range(_ROUNDS):
        rest = values - terms @ plane
        scatter = max(NORMAL * float(np.median(np.abs(rest))), _LEAST_SCATTER)
        now = np.abs(rest) <= 3 * scatter
        if turn and (now == kept).all():
            break
        kept = now
        plane = np.linalg.lstsq(terms[kept], values[kept], rcond=None)[0]
    return plane


def plane_on(plane: Array, shape: tuple[int, ...], spacing: float) -> Array:
    """Heights (N, M) of a ``plane`` (3,) of `fit_plane` on a grid."""
    i, j = np.indices(shape) * spacing
    return np.asarray(plane[0] * i + plane[1] * j + plane[2])
