"""Gaussian decomposition (SAGD: Hu et al. 2024) as released: splats that reach over a mask's edge are cut back to it.

In every k-th train view, with the released constants:

1. The covariance is projected to the image (EWA splatting without the low-pass filter). The end points lie 1.5 σ to
   either side of the projected centre along the long axis of the 2D covariance, clipped to the image and rounded to
   pixels (half to even).
2. Where one end is inside the mask and the other outside, the ratio is the share of the pixels of the line between the
   ends that lie inside.
3. All three scales are multiplied by ratio · 0.8.
4. The centre moves by 0.5 · (1 − ratio) · 3σ₃ along the longest 3D axis (σ₃: its standard deviation before the step)
   towards the end inside.

Two slips of the released code make its result depend on the arbitrary sign of an eigenvector: a line that runs to the
left is sampled as if it were vertical, and the 3D axis is projected as if it were a point. They are not reproduced.
Here a line has the same pixels in both directions (one per step along its longer side), and "towards the end inside" is
the sign of the 3D axis' direction in the image (the projection's Jacobian at the centre) along the vector to that end.

The released code loops over Gaussians; here each view is one pass over all of them. A Gaussian whose centre is behind
the camera has no pixel in that view and is left alone by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.lift import LiftCamera, Mask
from baselines.echosegnet.rasteriser.projection import MARGIN, rotation_matrices

Array = NDArray[np.float64]

#: Distance of an end point from the projected centre, in standard deviations along the long axis in the image.
END_SIGMAS = 1.5
#: The length of the 3D long axis that the centre's move is measured in, in standard deviations.
AXIS_SIGMAS = 3.0
#: Factor on the size of the part inside.
SHRINK = 0.8
#: Nearer to the camera's plane than this a centre has no pixel, metres.
_NEAR = 1e-6
#: Lines that are looked at together: bounds memory.
_BLOCK = 50_000


def decompose(gaussians: Gaussians, views: Sequence[LiftCamera], masks: Sequence[Mask], *, every: int = 4) -> Gaussians:
    """Cut Gaussians back to the masks of every ``every``-th view, one view after the other.

    Args:
        gaussians: the chosen ones.
        views: train views, sorted by name.
        masks: (H, W) bool, one per view.
        every: 4 as released; the first view is the first one used.

    Returns:
        As many Gaussians, on the same device; only means and log_scales differ.

    Raises:
        Avs3dError: if ``every`` is below 1, or masks do not fit the views.
    """
    if every < 1 or len(views) != len(masks):
        raise Avs3dError(
            f"decomposition: every {every} of {len(views)} views with {len(masks)} masks; expected one each"
        )
    if not len(gaussians):
        return gaussians
    means, logs = _numpy(gaussians.means), _numpy(gaussians.log_scales)
    turns = _numpy(rotation_matrices(gaussians.rotations.detach().double().cpu()))
    for view, mask in zip(views[::every], masks[::every], strict=True):
        if mask.shape != (view.camera.height, view.camera.width):
            expected = (view.camera.height, view.camera.width)
            raise Avs3dError(f"{view.name}: a mask of shape {mask.shape}, expected {expected}, the picture's")
        cut = _crossing(means, logs, turns, view, mask)
        longest = logs[cut.index].argmax(axis=1)
        deviation = np.exp(logs[cut.index, longest])
        axis = turns[cut.index, :, longest]
        step = 0.5 * (1.0 - cut.ratio) * AXIS_SIGMAS * deviation * _sign(axis, cut)
        means[cut.index] += step[:, None] * axis
        logs[cut.index] += np.log(cut.ratio * SHRINK)[:, None]
    like = gaussians.means
    return replace(
        gaussians,
        means=torch.as_tensor(means, dtype=like.dtype, device=like.device),
        log_scales=torch.as_tensor(logs, dtype=like.dtype, device=like.device),
    )


@dataclass(frozen=True, eq=False)
class _Crossing:
    """The n Gaussians of a view that have one end point inside the mask and one outside.

    Attributes:
        index: (n,) which of the Gaussians.
        ratio: (n,) in (0, 1): share of the pixels between the ends that lie inside.
        towards: (n, 2) from the projected centre to the end inside, as (column, row).
        jacobian: (n, 2, 3) of the projection at the centre, by world coordinates; pixels per metre.
    """

    index: NDArray[np.int64]
    ratio: Array
    towards: Array
    jacobian: Array


def _crossing(means: Array, logs: Array, turns: Array, view: LiftCamera, mask: Mask) -> _Crossing:
    local = (means - view.position) @ view.rotation
    index = np.flatnonzero(local[:, 2] > _NEAR)
    centre, jacobian = _project(local[index], view)
    spread = jacobian @ (turns[index] * np.exp(logs[index])[:, None, :])  # (n, 2, 3): a root of the covariance
    variance, axes = np.linalg.eigh(spread @ spread.transpose(0, 2, 1))
    reach = END_SIGMAS * np.sqrt(np.maximum(variance[:, 1], 0.0))[:, None] * axes[:, :, 1]
    ends = np.stack([_pixel(centre + reach, mask), _pixel(centre - reach, mask)])
    inside = mask[ends[..., 1], ends[..., 0]]
    crossing = np.flatnonzero(inside[0] != inside[1])
    first = inside[0, crossing]
    place = np.arange(len(crossing))
    chosen = ends[:, crossing]
    ratio = _shares(mask, chosen[np.where(first, 0, 1), place], chosen[np.where(first, 1, 0), place])
    towards = np.where(first, 1.0, -1.0)[:, None] * reach[crossing]
    return _Crossing(index[crossing], ratio, towards, jacobian[crossing])


def _project(local: Array, view: LiftCamera) -> tuple[Array, Array]:
    """(n, 2) pixels as (column, row) counted from pixel centres, and the Jacobian (n, 2, 3) by world coordinates.

    As everywhere in 3D-GS the Jacobian is taken no further out than 1.3 times the field of view.
    """
    lens, depth = view.camera, local[:, 2]
    slope = local[:, :2] / depth[:, None]
    focal, middle = np.array([lens.fx, lens.fy]), np.array([lens.cx, lens.cy])
    size = np.array([lens.width, lens.height])
    margin = MARGIN * 0.5 * size / focal
    edge = np.clip(slope, -middle / focal - margin, (size - middle) / focal + margin)
    by_camera = np.zeros((len(local), 2, 3))
    by_camera[:, [0, 1], [0, 1]] = focal / depth[:, None]
    by_camera[:, :, 2] = -focal * edge / depth[:, None]
    return focal * slope + middle - 0.5, by_camera @ view.rotation.T


def _pixel(points: Array, mask: Mask) -> NDArray[np.int64]:
    """(n, 2) points clipped to the image and rounded, half to even."""
    height, width = mask.shape
    return np.rint(np.clip(points, 0, [width - 1, height - 1])).astype(np.int64)


def _shares(mask: Mask, start: NDArray[np.int64], end: NDArray[np.int64]) -> Array:
    """(n,) share of the pixels of each line that lie inside the mask: one pixel per step along its longer side.

    Args:
        mask: (H, W).
        start: (n, 2) pixels as (column, row).
        end: (n, 2), other ones.
    """
    out = np.empty(len(start))
    for low in range(0, len(start), _BLOCK):
        part = np.s_[low : low + _BLOCK]
        steps = np.abs(end[part] - start[part]).max(axis=1)
        owner = np.repeat(np.arange(len(steps)), steps + 1)
        step = np.arange(len(owner)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
        stride = (end[part] - start[part]) / steps[:, None]
        line = np.rint(start[part][owner] + step[:, None] * stride[owner]).astype(np.int64)
        out[part] = np.bincount(owner, mask[line[:, 1], line[:, 0]], len(steps)) / (steps + 1)
    return out


def _sign(axis: Array, cut: _Crossing) -> Array:
    """(n,) 1 where the 3D axis (n, 3) points to the end inside, −1 where away from it, 0 at right angles."""
    seen = np.einsum("nij,nj->ni", cut.jacobian, axis)
    return np.asarray(np.sign((seen * cut.towards).sum(axis=1)))


def _numpy(tensor: Tensor) -> Array:
    return tensor.detach().cpu().numpy().astype(np.float64)
