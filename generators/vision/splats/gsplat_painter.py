"""Splats on CUDA: gsplat (Ye et al. 2024, arXiv:2409.06765; Apache-2.0) draws them, our rasteriser what objects cut."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.imports import needing
from avs3d_bench.scheduling.gsplat_kernels import gsplat
from generators.core.scene import F32
from generators.vision.splats import kernels
from generators.vision.splats.cloud import SplatCloud
from generators.vision.splats.kernels import SplatCamera
from generators.vision.splats.painter import NumbaPainter, SplatLayers


def gsplat_problem() -> str | None:
    """Why gsplat cannot draw here, in one line; None if it can. Its kernels are compiled or loaded for that."""
    try:
        _require()
    except Avs3dError as error:
        return str(error)
    return None


def gsplat_version() -> str:
    """Versions of gsplat and torch, and the kind of device: a frame's bytes depend on all three.

    Raises:
        Avs3dError: if gsplat is missing or does not work.
    """
    torch = _require()
    return f"gsplat {version('gsplat')}, torch {torch.__version__}, {torch.cuda.get_device_name()}"


def _require() -> Any:
    """The package torch, with gsplat ready.

    Raises:
        Avs3dError: if there is no CUDA device, or gsplat or its compiled kernels are missing.
    """
    with needing("--vision splats --device cuda", "pip install 'avs3d-bench[baselines]'"):
        import torch
    if not torch.cuda.is_available():
        raise Avs3dError("gsplat draws on CUDA, and torch finds no device here; use --device cpu")
    gsplat()
    return torch


class GsplatPainter:
    """Draws on an NVIDIA GPU. Tiles with an object are drawn once more on the CPU, up to the object's depth.

    Frames differ from the CPU's by rounding. Sums of the forward pass have a fixed order, so that one kind of device
    gives the same bytes.
    """

    def __init__(self, cloud: SplatCloud, device: str = "cuda") -> None:
        """Copy the cloud to the device.

        Raises:
            Avs3dError: if there is no CUDA device, or gsplat or its compiled kernels are missing.
        """
        self._torch = _require()
        self._device = device
        self._cpu = NumbaPainter(cloud)
        full = cloud.covariances[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
        parts = (cloud.means, full, cloud.opacities, cloud.sh)
        self._means, self._covariances, self._opacities, self._sh = (self._upload(part) for part in parts)
        self._degree = int(cloud.sh.shape[1] ** 0.5) - 1

    def _upload(self, values: Any) -> Any:
        return self._torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self._device)

    def paint(self, camera: SplatCamera, cut: F32) -> SplatLayers:
        """See `generators.vision.splats.painter.Painter`."""
        layers = self._cpu.paint_tiles(camera, cut, tiles_with(cut))
        rotation = np.array([camera.right, camera.down, camera.ahead])
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rotation, -rotation @ np.array(camera.origin)
        matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        with self._torch.no_grad():
            image, alpha, _ = gsplat().rasterization(
                means=self._means,
                quats=None,
                scales=None,
                covars=self._covariances,
                opacities=self._opacities,
                colors=self._sh,
                viewmats=self._upload(view)[None],
                Ks=self._upload(matrix)[None],
                width=camera.width,
                height=camera.height,
                near_plane=kernels.NEAR,
                eps2d=kernels.BLUR,
                sh_degree=self._degree,
                packed=False,
                render_mode="RGB+D",
            )
        whole = layers.whole
        whole[..., :3] = image[0, ..., :3].cpu().numpy()
        light = alpha[0, ..., 0].cpu().numpy()
        whole[..., 3] = 1.0 - light
        # gsplat sums up depth, not its inverse; for the expected depth that is the same but for the spread.
        depth = image[0, ..., 3].cpu().numpy()
        whole[..., 4] = np.divide(light * light, depth, out=np.zeros_like(depth), where=depth > 0)
        return layers


def tiles_with(cut: F32) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    """(tiles,) 1 where a pixel of the tile has an object."""
    height, width = cut.shape
    tall, wide = -(-height // kernels.TILE), -(-width // kernels.TILE)
    padded = np.zeros((tall * kernels.TILE, wide * kernels.TILE), dtype=bool)
    padded[:height, :width] = cut > 0
    return padded.reshape(tall, kernels.TILE, wide, kernels.TILE).any(axis=(1, 3)).reshape(-1).astype(np.uint8)
