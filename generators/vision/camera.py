"""A camera instead of an ideal picture: exposure, vignette, sensor noise, sharpening; on colour alone.

What a camera adds to a rendered frame, in the order in which light meets it: the lens darkens the corners, exposure and
white balance are slightly off, photons and the sensor's electronics bring noise, the phone smooths it a little and
sharpens edges. Depth and instance ids stay as they are.

Each observation has a camera of its own, drawn within `RANGES`; each pose has noise of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.scene import Scene
from generators.core.tone import SRGB_ENTRIES, decode_table, srgb_encode
from generators.vision.base import RenderedView, VisionBackend, VisionSession, frames_at_once
from generators.vision.views import pose_number

if TYPE_CHECKING:
    from generators.core.freespace import Navigable

#: Camera → parameter → least and greatest value that is drawn.
RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "mild": {
        "exposure": (-0.1, 0.1),  # stops
        "warmth": (-0.012, 0.012),  # share by which red is raised and blue lowered
        "vignette": (0.03, 0.12),  # share of the light that is missing in the corners
        "shot": (1e-5, 5e-5),  # variance of the noise over the light
        "read": (0.0003, 0.001),  # standard deviation of the noise in the dark
        "sharpening": (0.1, 0.25),  # share of the detail that is added again
    },
    "phone": {
        "exposure": (-0.25, 0.25),
        "warmth": (-0.04, 0.04),
        "vignette": (0.05, 0.25),
        "shot": (2e-5, 1.5e-4),
        "read": (0.0005, 0.002),
        "sharpening": (0.1, 0.5),
    },
}


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
    def drawn(rng: np.random.Generator, kind: str) -> PhoneCamera:
        """A camera within the `RANGES` of ``kind``."""
        return PhoneCamera(**{name: float(rng.uniform(low, high)) for name, (low, high) in RANGES[kind].items()})

    def photograph(self, rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
        """The picture that the camera takes of what ``rgb`` (H, W, 3) shows; both are 8-bit sRGB."""
        from generators.vision import camera_kernels as kernels

        height, width = rgb.shape[:2]
        gains = 2.0**self.exposure * np.array([1.0 + self.warmth, 1.0, 1.0 - self.warmth])
        noise = np.frombuffer(rng.bytes((height + 2) * (width + 2) * 3), dtype=np.uint8).reshape(height + 2, -1)
        shown, out = np.empty((height, width * 3), dtype=np.float32), np.empty((height, width * 3), dtype=np.uint8)
        rows, decode, encode = rgb.reshape(height, -1), decode_table(), _encoded()
        kernels.expose(rows, noise, decode, encode, gains, self.vignette, self.shot, self.read, shown)
        kernels.sharpen(shown, self.sharpening, out)
        return out.reshape(rgb.shape)


@cache
def _encoded() -> NDArray[np.float32]:
    """SRGB values, 0 to 255, of `SRGB_ENTRIES` equal steps of linear light; of the middle of each step."""
    return (255.0 * srgb_encode((np.arange(SRGB_ENTRIES) + 0.5) / SRGB_ENTRIES)).astype(np.float32)


class CameraBackend:
    """A renderer whose pictures are taken by a camera.

    Args:
        renderer: draws what the camera sees.
        rng: the camera and the noise of its pictures are drawn from it.
        kind: a key of `RANGES`.
    """

    def __init__(self, renderer: VisionBackend, rng: np.random.Generator, kind: str) -> None:
        self._renderer = renderer
        self._camera, self._seed = PhoneCamera.drawn(rng, kind), int(rng.integers(2**62))
        self.name, self.version = renderer.name, renderer.version
        self.frames_at_once = frames_at_once(renderer)

    def warm_up(self) -> None:
        """As the renderer's; the camera's kernels are compiled too."""
        self._renderer.warm_up()
        warm_up()

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


def warm_up() -> None:
    """Compile the camera's kernels, or wait for another process that does."""
    from generators.core.jit import compile_lock

    with compile_lock("camera"):
        camera = PhoneCamera(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        camera.photograph(np.zeros((2, 2, 3), dtype=np.uint8), np.random.default_rng(0))
