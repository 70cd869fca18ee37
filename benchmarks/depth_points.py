"""Points on the surfaces that depth pictures show, and the votes of masks for them.

They stand for the centres of trained Gaussians where a question does not depend on how well Gaussians were trained: a
dataset made `--with depth` has them in seconds, on a CPU.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.echosegnet.lift import pixels_of
from baselines.echosegnet.views import RegisteredView

Array = NDArray[np.float64]

#: Points are this far apart (m), as Gaussians on an object are.
VOXEL = 0.02
#: Every so many pixels of a row and of a column of a depth picture become a point.
_STRIDE = 2
#: A point is visible if its depth is its pixel's, to this share of it (surfaces seen at a slant) and half a voxel.
_TOLERANCE = 0.03


def surface_points(views: Sequence[RegisteredView]) -> Array:
    """(N, 3) metres, Y down: the centre of each cube of `VOXEL` in which a depth picture shows a surface."""
    found: set[tuple[int, int, int]] = set()
    for view in views:
        lens, depth = view.camera, view.frame.depth()
        row, column = (index.reshape(-1) for index in np.mgrid[0 : lens.height : _STRIDE, 0 : lens.width : _STRIDE])
        z = depth[row, column].astype(np.float64)
        x, y = (column + 0.5 - lens.cx) / lens.fx * z, (row + 0.5 - lens.cy) / lens.fy * z
        world = np.stack([x, y, z], axis=-1)[z > 0] @ view.rotation.T + view.position
        found.update(map(tuple, np.unique(np.floor(world / VOXEL).astype(np.int64), axis=0).tolist()))
    return (np.array(sorted(found), np.float64).reshape(-1, 3) + 0.5) * VOXEL


def visible_votes(points: Array, views: Iterable[tuple[RegisteredView, NDArray[np.float32]]]) -> NDArray[np.float64]:
    """(N, C) sums over the views of the values of (H, W, C) pictures at each point, where nothing hides it.

    A point counts for as many pixels as its cube covers, so that sums compare with the contributions of a Gaussian.
    """
    total: NDArray[np.float64] | None = None
    for view, values in views:
        column, row, inside = pixels_of(points, view)
        depth = ((points - view.position) @ view.rotation)[:, 2]
        there = view.frame.depth()[row, column]
        seen = inside & (depth > 0) & (np.abs(depth - there) <= _TOLERANCE * depth + VOXEL / 2)
        weight = np.zeros(len(points))
        weight[seen] = view.camera.fx * view.camera.fy * (VOXEL / depth[seen]) ** 2
        added = weight[:, None] * values[row, column]
        total = added if total is None else total + added
    return np.zeros((len(points), 0)) if total is None else total
