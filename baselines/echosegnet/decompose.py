"""Gaussian decomposition (SAGD: Hu et al. 2024), vectorised: splats that reach over a mask's edge are cut back to it.

In every k-th train view, a Gaussian whose 3σ long axis has one end inside the mask and one outside is shrunk: the long
axis to (its share inside the mask) × 0.8, and the centre moves by half of what was cut off, towards the end inside. The
released code loops over Gaussians; here each view is one pass over all of them.

The share is taken along the axis itself, at `_SAMPLES` places from the inner end to the first one that lies outside the
mask. An end behind the camera has no pixel: such Gaussians are left alone. An end beyond the image's edge is outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.lift import Camera, Mask, pixels_of

#: Half the long axis, in standard deviations.
SIGMAS = 3.0
#: What is left of the part inside.
SHRINK = 0.8
_SAMPLES = 32
#: Closer than this to the camera's plane an end has no pixel, metres.
_NEAR = 1e-6


def decompose(gaussians: Gaussians, views: Sequence[Camera], masks: Sequence[Mask], *, every: int = 4) -> Gaussians:
    """Cut Gaussians back to the masks of every ``every``-th view, one view after the other.

    Args:
        gaussians: the labelled ones.
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
    means = gaussians.means.detach().cpu().numpy().astype(np.float64)
    logs = gaussians.log_scales.detach().cpu().numpy().astype(np.float64)
    axes = _long_axes(gaussians.rotations, gaussians.log_scales)
    longest = logs.argmax(axis=1)
    rows = np.arange(len(means))
    for view, mask in zip(views[::every], masks[::every], strict=True):
        reach = SIGMAS * np.exp(logs[rows, longest])[:, None] * axes
        first, second = _inside(means - reach, view, mask), _inside(means + reach, view, mask)
        ahead = (_depth(means - reach, view) > _NEAR) & (_depth(means + reach, view) > _NEAR)
        crossing = np.flatnonzero(ahead & (first != second))
        if not len(crossing):
            continue
        # From the end inside (start) to the one outside.
        towards = np.where(second[crossing], -1.0, 1.0)[:, None] * reach[crossing]
        start = means[crossing] - towards
        share = _share_inside(start, 2.0 * towards, view, mask)
        # Half of what is cut off, (1 − share) of the axis, whose half is `towards`.
        means[crossing] -= (1.0 - share)[:, None] * towards
        logs[crossing, longest[crossing]] += np.log(share * SHRINK)
    like = gaussians.means
    return replace(
        gaussians,
        means=torch.as_tensor(means, dtype=like.dtype, device=like.device),
        log_scales=torch.as_tensor(logs, dtype=like.dtype, device=like.device),
    )


def _long_axes(rotations: Tensor, log_scales: Tensor) -> np.ndarray:
    """(N, 3) float64 unit vectors along the longest axes, in the world."""
    w, x, y, z = torch.nn.functional.normalize(rotations.detach().double().cpu(), dim=1).unbind(1)
    columns = torch.stack(
        [
            torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], dim=1),
            torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], dim=1),
            torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1),
        ],
        dim=1,
    )
    longest = log_scales.detach().cpu().argmax(dim=1)
    out: np.ndarray = columns[torch.arange(len(columns)), longest].numpy()
    return out


def _depth(points: np.ndarray, view: Camera) -> np.ndarray:
    out: np.ndarray = (points - view.position) @ view.rotation[:, 2]
    return out


def _inside(points: np.ndarray, view: Camera, mask: Mask) -> np.ndarray:
    u, v, seen = pixels_of(points, view)
    out: np.ndarray = seen & mask[v, u]
    return out


def _share_inside(start: np.ndarray, axis: np.ndarray, view: Camera, mask: Mask) -> np.ndarray:
    """(n,) in (0, 1): how far along ``start + t·axis`` the mask reaches before the first place outside it."""
    inside = np.ones(len(start), np.bool_)
    count = np.zeros(len(start))
    for step in range(_SAMPLES):
        inside &= _inside(start + (step + 0.5) / _SAMPLES * axis, view, mask)
        count += inside
    return np.clip(count, 0.5, _SAMPLES - 0.5) / _SAMPLES
