"""A camera instead of an ideal picture: exposure, vignette, sensor noise, sharpening; on colour alone.

What a phone adds to a rendered frame, in the order in which light meets it: the lens darkens the corners, exposure and
white balance are slightly off, photons and the sensor's electronics bring noise, the phone smooths it a little and
sharpens edges. Depth and instance ids stay as they are.

Each observation has a camera of its own, drawn within `RANGES`; each pose has noise of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.freespace import Navigable
from generators.core.scene import Scene
from generators.core.tone import SRGB_ENTRIES, decode_table, srgb_encode
from generators.vision.base import RenderedView, VisionBackend, VisionSession
from generators.vision.views import pose_number

#: Parameter → least and greatest value that is drawn.
RANGES = {
    "exposure": (-0.25, 0.25),  # stops
    "warmth": (-0.04, 0.04),  # share by which red is raised and blue lowered
    "vignette": (0.05, 0.25),  # share of the light that is missing in the corners
    "shot": (2e-5, 1.5e-4),  # variance of the noise over the light
    "read": (0.0005, 0.002),  # standard deviation of the noise in the dark
    "sharpening": (0.1, 0.5),  # share of the detail that is added again
}
#: A row of the smoothing of the noise and of the blur whose complement is sharpened.
_BLUR = np.array([0.25, 0.5, 0.25], dtype=np.float32)
#: Root of the sum of squares of `_BLUR` in two dimensions: by so much it lowers white noise.
_LEFT = float(np.square(_BLUR).sum())


@dataclass(frozen=True)
class PhoneCamera:
    """A camera's parameters; see `RANGES` for their units.

    The noise of a value x of linear light (1: white) has the variance shot · x + read² (A. Foi, M. Trimeche, V.
    Katkovnik and K. Egiazarian, "Practical Poissonian-Gaussian noise modeling and fitting for single-image raw-data",
    IEEE Transactions on Image Processing 17(10), 2008, equation 2).
    """

    exposure: float
    warmth: float
    vignette: float
    shot: float
    read: float
    sharpening: float

    @staticmethod
    def drawn(rng: np.random.Generator) -> PhoneCamera:
        """A camera within `RANGES`."""
        return PhoneCamera(**{name: float(rng.uniform(low, high)) for name, (low, high) in RANGES.items()})

    def photograph(self, rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
        """The picture that the camera takes of what ``rgb`` (H, W, 3) shows; both are 8-bit sRGB."""
        height, width = rgb.shape[:2]
        x, y = (np.linspace(-1.0, 1.0, count, dtype=np.float32) for count in (width, height))
        falloff = 1.0 - self.vignette * (np.square(x) + np.square(y)[:, None]) / 2.0
        gains = 2.0**self.exposure * np.array([1.0 + self.warmth, 1.0, 1.0 - self.warmth])
        light = decode_table()[rgb] * falloff[..., None] * gains.astype(np.float32)
        noise = rng.standard_normal(rgb.shape, dtype=np.float32)
        light += _blurred(noise) * np.sqrt(self.shot / _LEFT**2 * light + (self.read / _LEFT) ** 2, dtype=np.float32)
        shown = _encoded()[(light * len(_encoded())).clip(0, len(_encoded()) - 1).astype(np.int32)]
        shown += self.sharpening * (shown - _blurred(shown))
        return np.asarray(np.rint(shown.clip(0.0, 255.0)), dtype=np.uint8)


@cache
def _encoded() -> NDArray[np.float32]:
    """SRGB values, 0 to 255, of `SRGB_ENTRIES` equal steps of linear light; of the middle of each step."""
    return (255.0 * srgb_encode((np.arange(SRGB_ENTRIES) + 0.5) / SRGB_ENTRIES)).astype(np.float32)


def _blurred(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """``picture`` (H, W, 3) convolved with `_BLUR` in both directions."""
    rows = ndimage.convolve1d(picture, _BLUR, axis=0, mode="nearest")
    return np.asarray(ndimage.convolve1d(rows, _BLUR, axis=1, mode="nearest"), dtype=np.float32)


class CameraBackend:
    """A renderer whose pictures are taken by a camera.

    Args:
        renderer: draws what the camera sees.
        rng: the camera and the noise of its pictures are drawn from it.
    """

    def __init__(self, renderer: VisionBackend, rng: np.random.Generator) -> None:
        self._renderer = renderer
        self._camera, self._seed = PhoneCamera.drawn(rng), int(rng.integers(2**62))
        self.name, self.version = renderer.name, renderer.version

    def warm_up(self) -> None:
        """As the renderer's."""
        self._renderer.warm_up()

    def open(self, scene: Scene, intrinsics: Intrinsics) -> CameraSession:
        """As the renderer's."""
        return CameraSession(self._renderer.open(scene, intrinsics), self._camera, self._seed)

    def navigable(self, home: Scene) -> Navigable | None:
        """As the renderer's."""
        return self._renderer.navigable(home)


class CameraSession:
    """An open scene before a camera."""

    def __init__(self, session: VisionSession, camera: PhoneCamera, seed: int) -> None:
        self._session, self._camera, self._seed = session, camera, seed

    def render(self, pose: Pose) -> RenderedView:
        """The view from ``pose``, photographed; the same pose gives the same bytes."""
        view = self._session.render(pose)
        rng = np.random.default_rng([self._seed, pose_number(pose)])
        return replace(view, rgb=self._camera.photograph(view.rgb, rng))

    def share(self) -> CameraSession | None:
        """As the renderer's."""
        other = self._session.share()
        return None if other is None else CameraSession(other, self._camera, self._seed)

    def close(self) -> None:
        """As the renderer's."""
        self._session.close()
