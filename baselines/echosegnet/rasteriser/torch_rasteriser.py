"""The rasteriser in plain torch: exact, differentiable, for any device; for small scenes and as gsplat's reference."""

from __future__ import annotations

import torch
from torch import Tensor

from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.compositing import composite
from baselines.echosegnet.rasteriser.projection import colours, project
from baselines.echosegnet.rasteriser.rendering import Camera, Rasteriser, Splat


class TorchRasteriser(Rasteriser):
    """`Rasteriser` in plain torch. On a CPU the same input gives the same bits."""

    def __init__(self, device: torch.device | str = "cpu") -> None:
        super().__init__(device)

    def _draw(
        self,
        gaussians: Gaussians,
        camera: Camera,
        matrix: Tensor,
        features: Tensor | None,
        sh_degree: int,
        *,
        depth: bool,
    ) -> Splat:
        projected = project(gaussians, camera)
        values = colours(gaussians, camera, sh_degree) if features is None else features
        if depth:
            values = torch.cat([values, projected.depths[:, None]], dim=1)
        image, alpha = composite(projected, gaussians.alphas, values, camera.width, camera.height)
        return Splat(image, alpha, projected.means, projected.visible, projected.conics)
