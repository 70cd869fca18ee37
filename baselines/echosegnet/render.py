"""Masks of the chosen Gaussians in a view: as released (amodal), and visible-only."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.rendering import Rasteriser
from baselines.echosegnet.views import RegisteredView

#: The released mask is where the chosen Gaussians alone are more opaque than this.
AMODAL_THRESHOLD = 0.8
#: The visible-only mask is where at least half of the light comes from the chosen ones.
VISIBLE_THRESHOLD = 0.5

Mask = NDArray[np.bool_]


@torch.no_grad()
def amodal_mask(
    rasteriser: Rasteriser, chosen: Gaussians, view: RegisteredView, threshold: float = AMODAL_THRESHOLD
) -> Mask:
    """(H, W) bool: the chosen Gaussians drawn alone; occlusion by others is ignored."""
    if not len(chosen):
        return np.zeros((view.camera.height, view.camera.width), np.bool_)
    splat = rasteriser.splat(chosen, view, features=torch.ones(len(chosen), 1, device=chosen.device))
    return np.asarray((splat.alpha > threshold).cpu())


@torch.no_grad()
def visible_mask(
    rasteriser: Rasteriser, scene: Gaussians, chosen: Tensor, view: RegisteredView, threshold: float = VISIBLE_THRESHOLD
) -> Mask:
    """(H, W) bool: where the chosen of the scene's Gaussians make up most of the pixel, behind what occludes them.

    Args:
        rasteriser: what draws.
        scene: all N Gaussians.
        chosen: (N,) bool.
        view: from where.
        threshold: least share Σ_chosen T·α.
    """
    if not bool(chosen.any()):
        return np.zeros((view.camera.height, view.camera.width), np.bool_)
    splat = rasteriser.splat(scene, view, features=chosen.to(scene.means)[:, None])
    return np.asarray((splat.image[..., 0] > threshold).cpu())
