"""The rasteriser in plain torch: exact, differentiable, for any device; for small scenes and as gsplat's reference."""

from __future__ import annotations

import torch
from torch import Tensor

from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.compositing import composite
from baselines.echosegnet.rasteriser.projection import colours, project
from baselines.echosegnet.rasteriser.rendering import CameraCache, Rendering, Splat, compose
from baselines.echosegnet.views import View


class TorchRasteriser:
    """`Rasteriser` in plain torch. On a CPU the same input gives the same bits."""

    def __init__(self, device: torch.device | str = "cpu") -> None:
        self._device = torch.device(device)
        self._cameras = CameraCache()

    @property
    def device(self) -> torch.device:
        """Where it draws."""
        return self._device

    def splat(
        self,
        gaussians: Gaussians,
        view: View,
        *,
        features: Tensor | None = None,
        sh_degree: int = 3,
        size: tuple[int, int] | None = None,
    ) -> Splat:
        """See `Rasteriser.splat`."""
        camera, _ = self._cameras.get(view, gaussians.means, size)
        projected = project(gaussians, camera)
        values = colours(gaussians, camera, sh_degree) if features is None else features
        image, alpha = composite(projected, gaussians.alphas, values, camera.width, camera.height)
        return Splat(image, alpha, projected.means, projected.visible, projected.conics)

    def render(
        self,
        gaussians: Gaussians,
        view: View,
        *,
        sh_degree: int = 3,
        background: Tensor | None = None,
        size: tuple[int, int] | None = None,
    ) -> Rendering:
        """See `Rasteriser.render`."""
        camera, _ = self._cameras.get(view, gaussians.means, size)
        projected = project(gaussians, camera)
        values = torch.cat([colours(gaussians, camera, sh_degree), projected.depths[:, None]], dim=1)
        image, alpha = composite(projected, gaussians.alphas, values, camera.width, camera.height)
        return compose(image, alpha, background)
