"""Lifting 2D masks to points: the released voting (SAGD's, changed).

Every point is projected into every train view. Where it lies in front of the camera and inside the image it votes with
the mask's value at the pixel round(f·x/z + W/2 − 0.5), round(f·y/z + H/2 − 0.5) (half to even); elsewhere it does not
vote. A point is labelled if more than a share of its votes is for it. Nothing is tested for occlusion: what stands in
front of an object, or behind it, votes as the object does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics

Mask = NDArray[np.bool_]
#: Points with at most this share of their votes are not marked: crumbs at the edges of masks.
MARKED = 0.1
#: Quantile of the marked points' shares that says how well masks recognise an object (docs/listener-trials.md).
_WELL_MARKED = 0.85
#: A point that a view does not see has this in place of a vote.
NO_VOTE = -1


class LiftCamera(Protocol):
    """The used part of a `views.View`: name, intrinsics, rotation (3, 3) camera-to-world and position (3,), OpenCV."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def camera(self) -> Intrinsics: ...  # noqa: D102
    @property
    def rotation(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def position(self) -> NDArray[np.float64]: ...  # noqa: D102


def pixels_of(
    points: NDArray[np.float64], view: LiftCamera
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Column, row and whether the view has the point in its picture; column and row are 0 where it has not.

    Args:
        points: (N, 3) metres, Y-down world.
        view: the camera.
    """
    local = (points - view.position) @ view.rotation
    depth = local[:, 2]
    lens = view.camera
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.rint(lens.fx * local[:, 0] / depth + lens.cx - 0.5)
        v = np.rint(lens.fy * local[:, 1] / depth + lens.cy - 0.5)
        seen = (depth >= 0) & (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
    return np.where(seen, u, 0).astype(np.int64), np.where(seen, v, 0).astype(np.int64), seen


def _check(mask: Mask, view: LiftCamera) -> Mask:
    expected = (view.camera.height, view.camera.width)
    if mask.shape != expected:
        raise Avs3dError(f"{view.name}: a mask of shape {mask.shape}, expected {expected}, the picture's")
    return mask


def _points(points: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise Avs3dError(f"points have shape {array.shape}, expected (N, 3)")
    if not np.isfinite(array).all():
        raise Avs3dError("points hold NaN or infinite numbers; train again")
    return array


def votes(points: ArrayLike, views: Sequence[LiftCamera], masks: Sequence[Mask]) -> NDArray[np.int8]:
    """(N, V) int8: each view's vote on each point, 1 or 0; −1 where the view does not have it in its picture.

    Raises:
        Avs3dError: if there are not as many masks as views, a mask has another size than its picture, or points are
            not finite.
    """
    if len(views) != len(masks):
        raise Avs3dError(f"{len(masks)} masks for {len(views)} views, expected one each")
    array = _points(points)
    out = np.full((len(array), len(views)), NO_VOTE, np.int8)
    for column, (view, mask) in enumerate(zip(views, masks, strict=True)):
        u, v, seen = pixels_of(array, view)
        out[:, column] = np.where(seen, _check(mask, view)[v, u], NO_VOTE)
    return out


def vote_counts(
    points: ArrayLike, views_and_masks: Iterable[tuple[LiftCamera, Mask]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(N,) votes for each point, and (N,) votes in all; one view in memory at a time.

    Raises:
        Avs3dError: as `votes`.
    """
    array = _points(points)
    inside, total = np.zeros(len(array), np.int64), np.zeros(len(array), np.int64)
    for view, mask in views_and_masks:
        u, v, seen = pixels_of(array, view)
        total += seen
        inside += seen & _check(mask, view)[v, u]
    return inside, total


def vote_share(inside: NDArray[Any], total: NDArray[Any]) -> NDArray[np.float64]:
    """(N,) share of each point's votes that are for it; 0 for points without votes."""
    inside, total = inside.astype(np.float64), total.astype(np.float64)
    return np.asarray(np.divide(inside, total, out=np.zeros_like(inside), where=total > 0))


def marked_share(share: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """The share of the votes of well-marked points: the 85 % quantile over all marked points; 1 if none is marked.

    It is near 1 where masks recognise an object in nearly all frames, and low where they do in a few.

    Args:
        share: (N,) of each point's votes, as of `vote_share`.
        weight: (N,) how much each point counts: what hardly shows, such as a splat behind a surface, says little.

    Examples:
        >>> marked_share(np.array([0.0, 0.2, 0.3, 0.4]), np.array([9.0, 1.0, 8.0, 1.0]))
        0.3
        >>> marked_share(np.array([0.0, 0.05]), np.ones(2))
        1.0
    """
    marked = np.flatnonzero((share > MARKED) & (weight > 0))
    if not len(marked):
        return 1.0
    order = marked[np.argsort(share[marked], kind="stable")]
    below = np.cumsum(weight[order])
    return float(share[order[np.searchsorted(below, _WELL_MARKED * below[-1])]])


def label(ballots: NDArray[np.int8], threshold: float = 0.3) -> NDArray[np.bool_]:
    """(N,) whether more than ``threshold`` (strict) of a point's votes are for it; without votes it is not labelled."""
    share = vote_share((ballots == 1).sum(axis=1), (ballots >= 0).sum(axis=1))
    return np.asarray(share > threshold)
