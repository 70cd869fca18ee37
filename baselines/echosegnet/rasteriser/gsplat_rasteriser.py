"""The rasteriser on CUDA: gsplat (Ye et al. 2024, arXiv:2409.06765)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from avs3d_bench.scheduling.gsplat_kernels import gsplat
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.rendering import BLUR, NEAR, Camera, Rasteriser, Splat


class GsplatRasteriser(Rasteriser):
    """`Rasteriser` on CUDA. Sums are made with atomic additions: runs agree to rounding, not to the bit."""

    def __init__(self, device: torch.device | str = "cuda") -> None:
        """Load gsplat.

        Raises:
            Avs3dError: if there is no CUDA device, or gsplat or its compiled kernels are missing.
        """
        super().__init__(device)
        if self._device.type != "cuda" or not torch.cuda.is_available():
            raise Avs3dError(f"gsplat draws on CUDA, and device {str(device)!r} is none here; use --device cpu")
        self._rasterization = gsplat().rasterization

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
        if not len(gaussians):
            channels = (3 if features is None else features.shape[1]) + depth
            black = gaussians.means.new_zeros(camera.height, camera.width, channels)
            return Splat(black, black[..., 0], gaussians.means[:, :2], gaussians.means[:, 0] > 0, gaussians.means)
        meta: dict[str, Any]
        image, alpha, meta = self._rasterization(
            means=gaussians.means,
            quats=gaussians.rotations,
            scales=gaussians.scales,
            opacities=gaussians.alphas,
            colors=gaussians.sh if features is None else features,
            viewmats=camera.world_to_camera[None],
            Ks=matrix[None],
            width=camera.width,
            height=camera.height,
            near_plane=NEAR,
            eps2d=BLUR,
            sh_degree=min(sh_degree, gaussians.sh_degree) if features is None else None,
            # One camera sees most of a room: packing the visible Gaussians would cost more than it saves.
            packed=False,
            render_mode="RGB+D" if depth else "RGB",
        )
        visible = (meta["radii"][0] > 0).all(dim=-1)
        return Splat(image[0], alpha[0, ..., 0], meta["means2d"], visible, meta["conics"][0])
