"""How much of each pixel a Gaussian accounts for, with any rasteriser."""

from __future__ import annotations

import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.views import RegisteredView


def contributions(rasteriser: Rasteriser, gaussians: Gaussians, view: RegisteredView, weights: Tensor) -> Tensor:
    """Contribution of each Gaussian to the pixels of a view, occlusion included: Σ over pixels of weight · T · α.

    The derivative of Σ weight · image by a feature of the Gaussian is exactly that sum, so one backward pass
    gives it for all of them, with any rasteriser.

    Args:
        rasteriser: the one to draw with.
        gaussians: N of them.
        view: from where.
        weights: (H, W), or (H, W, C) for several sums at once; the picture is drawn at this resolution.

    Returns:
        (N,), or (N, C).

    Raises:
        Avs3dError: if ``weights`` has another number of axes.
    """
    if weights.ndim not in (2, 3):
        raise Avs3dError(f"weights have shape {tuple(weights.shape)}, expected (H, W) or (H, W, C)")
    planes = weights.to(gaussians.means).reshape(*weights.shape[:2], -1)
    with torch.enable_grad():
        frozen = Gaussians(*(part.detach() for part in _parts(gaussians)))
        features = planes.new_zeros(len(gaussians), planes.shape[2], requires_grad=True)
        size = (weights.shape[0], weights.shape[1])
        splat = rasteriser.splat(frozen, view, features=features, size=size)
        if not len(gaussians):
            return features.detach().reshape(0, *weights.shape[2:])
        (sums,) = torch.autograd.grad(splat.image, features, grad_outputs=planes)
    return sums if weights.ndim == 3 else sums[:, 0]


def _parts(gaussians: Gaussians) -> tuple[Tensor, ...]:
    return (gaussians.means, gaussians.log_scales, gaussians.rotations, gaussians.opacities, gaussians.sh)
