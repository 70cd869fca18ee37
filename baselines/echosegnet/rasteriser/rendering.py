"""Inputs and outputs of a rasteriser: `Camera`, `Splat`, `Rendering`, and the base class `Rasteriser`.

The model of the picture (both implementations; that of gsplat 1.5): EWA splatting (Zwicker et al. 2002) as in 3D-GS. A
Gaussian's covariance goes through the local affine approximation of the perspective (its centre clamped to 1.3 times
the field of view), 0.3 px² is added to the diagonal, α = min(0.999, opacity · exp(−σ)) at pixel centres (u + 0.5,
v + 0.5), an alpha below 1/255 is skipped, and front to back a pixel ends before its transmittance would fall to 1e-4.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from baselines.echosegnet.gaussians import Gaussians
from baselines.echosegnet.views import RegisteredView

#: px² added to the variance in the image.
BLUR = 0.3
#: No α is above this, so that light always passes a little.
MAX_ALPHA = 0.999
#: Contributions below this are skipped.
MIN_ALPHA = 1.0 / 255.0
#: A pixel ends before its transmittance reaches this.
MIN_TRANSMITTANCE = 1e-4
#: Centres nearer than this, in metres along the axis, are not drawn: floaters in front of the lens.
NEAR = 0.05
#: Expected depth divides by alpha, but by no less than this.
MIN_WEIGHT = 1e-10


@dataclass(frozen=True, eq=False)
class Camera:
    """A view at some resolution, on a device.

    Attributes:
        width: pixels.
        height: pixels.
        fx: focal length in pixels; also fy, cx, cy.
        world_to_camera: (4, 4), OpenCV.
        centre: (3,) in the world.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    world_to_camera: Tensor
    centre: Tensor

    @property
    def matrix(self) -> Tensor:
        """(3, 3) intrinsic matrix."""
        rows = [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]
        return torch.tensor(rows, dtype=self.centre.dtype, device=self.centre.device)

    @classmethod
    def of(cls, view: RegisteredView, like: Tensor, size: tuple[int, int] | None = None) -> Camera:
        """The camera of ``view`` at (height, width) ``size``, or at its own; dtype and device of ``like``."""
        intrinsics = view.camera
        height, width = size or (intrinsics.height, intrinsics.width)
        x, y = width / intrinsics.width, height / intrinsics.height
        return cls(
            width, height, intrinsics.fx * x, intrinsics.fy * y, intrinsics.cx * x, intrinsics.cy * y,
            torch.as_tensor(view.world_to_camera, dtype=like.dtype, device=like.device),
            torch.as_tensor(view.position, dtype=like.dtype, device=like.device),
        )  # fmt: skip


class CameraCache:
    """Cameras of views, made once: copying a pose to a GPU makes the program wait for it."""

    def __init__(self) -> None:
        self._cameras: WeakKeyDictionary[RegisteredView, dict[object, tuple[Camera, Tensor]]] = WeakKeyDictionary()

    def get(self, view: RegisteredView, like: Tensor, size: tuple[int, int] | None) -> tuple[Camera, Tensor]:
        """The camera and its intrinsic matrix."""
        mine = self._cameras.setdefault(view, {})
        key = (size, like.dtype, like.device)
        if key not in mine:
            camera = Camera.of(view, like, size)
            mine[key] = (camera, camera.matrix)
        return mine[key]


@dataclass(frozen=True, eq=False)
class Splat:
    """Composited features of one view, with what densification needs.

    Attributes:
        image: (H, W, C) Σ T·α·feature, on black.
        alpha: (H, W) Σ T·α = 1 − transmittance.
        means2d: (N, 2) or (1, N, 2) projected centres in pixels; part of the graph, so that its gradient can be
            retained.
        visible: (N,) bool: the Gaussian's footprint meets the image.
        conics: (N, 3) inverse covariance in the image (xx, xy, yy), 1/px²; arbitrary where not visible.
    """

    image: Tensor
    alpha: Tensor
    means2d: Tensor
    visible: Tensor
    conics: Tensor

    @torch.no_grad()
    def radii(self) -> Tensor:
        """(N,) three standard deviations along the long axis in the image, in pixels, as 3D-GS measures it.

        0 where not visible.
        """
        xx, xy, yy = self.conics.detach().reshape(-1, 3).unbind(-1)
        # The long axis belongs to the smaller eigenvalue of the inverse.
        least = 0.5 * (xx + yy) - (0.25 * (xx - yy).square() + xy.square()).sqrt()
        return torch.where(self.visible, 3.0 * least.clamp(min=1e-12).rsqrt(), torch.zeros_like(least))


@dataclass(frozen=True, eq=False)
class Rendering:
    """A picture.

    Attributes:
        rgb: (H, W, 3), from 0 on; overexposed values above 1 are kept.
        alpha: (H, W) opacity in [0, 1].
        depth: (H, W) expected metric z along the optical axis; 0 where nothing is.
    """

    rgb: Tensor
    alpha: Tensor
    depth: Tensor


class Rasteriser(ABC):
    """Draws Gaussians, differentiably in all their parameters and in the features."""

    def __init__(self, device: torch.device | str) -> None:
        self._device = torch.device(device)
        self._cameras = CameraCache()

    @property
    def device(self) -> torch.device:
        """Where it draws; Gaussians must be there."""
        return self._device

    def splat(
        self,
        gaussians: Gaussians,
        view: RegisteredView,
        *,
        features: Tensor | None = None,
        sh_degree: int = 3,
        size: tuple[int, int] | None = None,
    ) -> Splat:
        """Composite ``features`` (N, C), or the colours of spherical harmonics up to ``sh_degree``.

        Args:
            gaussians: what to draw.
            view: from where.
            features: (N, C) one vector per Gaussian; None: RGB.
            sh_degree: bands above it are left out (and none are beyond what the Gaussians have).
            size: (height, width) instead of the view's own.
        """
        return self._draw(gaussians, *self._cameras.get(view, gaussians.means, size), features, sh_degree, depth=False)

    def render(
        self,
        gaussians: Gaussians,
        view: RegisteredView,
        *,
        sh_degree: int = 3,
        background: Tensor | None = None,
        size: tuple[int, int] | None = None,
    ) -> Rendering:
        """Colour, alpha and expected depth.

        Args:
            gaussians: what to draw.
            view: from where.
            sh_degree: as in `splat`.
            background: (3,) RGB; black if None.
            size: (height, width) instead of the view's own.
        """
        splat = self._draw(gaussians, *self._cameras.get(view, gaussians.means, size), None, sh_degree, depth=True)
        return compose(splat.image, splat.alpha, background)

    @abstractmethod
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
        """Composite features or colours and, with ``depth``, z as one more channel.

        Args:
            gaussians: what to draw.
            camera: from where.
            matrix: (3, 3) its intrinsic matrix, on the device.
            features: as in `splat`.
            sh_degree: as in `splat`.
            depth: whether the depth along the axis follows the channels.
        """


def compose(image: Tensor, alpha: Tensor, background: Tensor | None) -> Rendering:
    """A `Rendering` of composited (H, W, 4) RGB and depth."""
    rgb = image[..., :3]
    if background is not None:
        rgb = rgb + (1.0 - alpha)[..., None] * background.to(rgb)
    return Rendering(rgb, alpha, image[..., 3] / alpha.clamp(min=MIN_WEIGHT))
