"""Drawing Gaussians: which rasteriser to take.

`contributions` says how much of each pixel a Gaussian accounts for. `rendering` has the records, the base class and
the model of the picture, `gsplat_rasteriser` the implementation for CUDA, `torch_rasteriser` the one for everything
else.
"""

from __future__ import annotations

import torch

from avs3d_bench.errors import UsageError
from baselines.echosegnet.rasteriser.contributions import contributions
from baselines.echosegnet.rasteriser.gsplat_rasteriser import GsplatRasteriser
from baselines.echosegnet.rasteriser.rendering import Rasteriser, Rendering, Splat
from baselines.echosegnet.rasteriser.torch_rasteriser import TorchRasteriser

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
