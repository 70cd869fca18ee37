"""Drawing Gaussians: which rasteriser to take, and how much of each pixel a Gaussian accounts for.

`rendering` has the records and the model of the picture, `gsplat_rasterise` the implementation for CUDA,
`torch_rasterise` the one for everything else.
"""

from __future__ import annotations

import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError, UsageError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.gsplat_rasterise import GsplatRasteriser
from baselines.echosegnet.rendering import Rasteriser, Rendering, Splat
from baselines.echosegnet.torch_rasterise import TorchRasteriser
from baselines.echosegnet.views import View

__all__ = [
    "GsplatRasteriser",
    "Rasteriser",
    "Rendering",
    "Splat",
    "TorchRasteriser",
    "contributions",
    "default_rasteriser",
]


def default_rasteriser(device: torch.device | str | None = None) -> Rasteriser:
    """Gsplat on a CUDA device, plain torch on any other.

    Args:
        device: e.g. ``cuda:1`` or ``cpu``; None: CUDA where there is one.

    Raises:
        UsageError: if there is no such device.
        Avs3dError: if the device is a CUDA one and gsplat does not work there.
    """
    try:
        chosen = torch.device(device) if device is not None else torch.device("cuda" if _has_cuda() else "cpu")
    except RuntimeError:
        raise UsageError(f"device {device!r}: expected e.g. cpu, cuda or cuda:1") from None
    if chosen.type != "cuda":
        return TorchRasteriser(chosen)
    count = torch.cuda.device_count() if _has_cuda() else 0
    if (chosen.index or 0) >= count:
        raise UsageError(f"device {str(chosen)!r}: this machine has {count} CUDA devices; use --device cpu")
    return GsplatRasteriser(chosen)


def _has_cuda() -> bool:
    return torch.cuda.is_available()


def contributions(rasteriser: Rasteriser, gaussians: Gaussians, view: View, weights: Tensor) -> Tensor:
    """What each Gaussian contributes to the pixels of a view, occlusion included: Σ over pixels of weight · T · α.

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
