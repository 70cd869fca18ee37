"""The rasteriser on CUDA: gsplat (Ye et al. 2024, arXiv:2409.06765)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.rasteriser.kernels import gsplat
from baselines.echosegnet.rasteriser.rendering import BLUR, NEAR, CameraCache, Rendering, Splat, compose
from baselines.echosegnet.views import View


class GsplatRasteriser:
    """`Rasteriser` on CUDA. Sums are made with atomic additions: runs agree to rounding, not to the bit."""

    def __init__(self, device: torch.device | str = "cuda") -> None:
        """Load gsplat.

        Raises:
            Avs3dError: if there is no CUDA device, or gsplat or its compiled kernels are missing.
        """
        self._device = torch.device(device)
        if self._device.type != "cuda" or not torch.cuda.is_available():
            raise Avs3dError(f"gsplat draws on CUDA, and device {str(device)!r} is none here; use --device cpu")
        self._rasterization = gsplat().rasterization
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
        return self._draw(gaussians, view, features, sh_degree, size, "RGB")

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
        splat = self._draw(gaussians, view, None, sh_degree, size, "RGB+D")
        return compose(splat.image, splat.alpha, background)

    def _draw(
        self,
        gaussians: Gaussians,
        view: View,
        features: Tensor | None,
        sh_degree: int,
        size: tuple[int, int] | None,
        mode: str,
    ) -> Splat:
        camera, matrix = self._cameras.get(view, gaussians.means, size)
        if not len(gaussians):
            channels = (3 if features is None else features.shape[1]) + (mode == "RGB+D")
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
            render_mode=mode,
        )
        visible = (meta["radii"][0] > 0).all(dim=-1)
        return Splat(image[0], alpha[0, ..., 0], meta["means2d"], visible, meta["conics"][0])
