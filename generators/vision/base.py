"""The protocol of a vision backend: open a scene once, render it from many poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.scene import Scene

if TYPE_CHECKING:
    from generators.core.freespace import Navigable


@dataclass(frozen=True, eq=False)
class RenderedView:
    """One rendered view.

    Attributes:
        rgb: (H, W, 3) uint8, sRGB.
        depth: (H, W) float32, metres along the optical axis; 0 where nothing was hit.
        instance_ids: (H, W) uint16 at pixel centres; 0 = scan or nothing.

    Examples:
        >>> home = Home.from_scan("room.glb", rooms={"kitchen": [[0, 0, 0], [4, 2.6, 3.6]]})
        >>> view = home.picture(size=64)
        >>> view
        <RenderedView 64×64, depth up to 5.09 m, instances none>
        >>> view.rgb.shape, view.depth.dtype.name, view.instance_ids.dtype.name
        ((64, 64, 3), 'float32', 'uint16')
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    instance_ids: NDArray[np.uint16]

    def __repr__(self) -> str:
        height, width = self.depth.shape
        ids = ", ".join(map(str, np.unique(self.instance_ids[self.instance_ids > 0]).tolist()))
        return f"<RenderedView {width}×{height}, depth up to {self.depth.max():.2f} m, instances {ids or 'none'}>"

    def _repr_jpeg_(self) -> bytes:
        """The picture as a notebook shows it."""
        return cv2.imencode(".jpg", self.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


class VisionSession(Protocol):
    """An open scene."""

    def render(self, pose: Pose) -> RenderedView:
        """Render the scene from ``pose``; the same pose gives the same bytes. For one thread at a time."""
        ...

    def share(self) -> VisionSession | None:
        """A session of the same open scene for another thread at the same time; None if the renderer has none.

        It is valid while this one is open.
        """
        ...

    def close(self) -> None:
        """Free the resources of the session."""
        ...


class VisionBackend(Protocol):
    """A renderer."""

    @property
    def name(self) -> str:
        """The backend's name on the command line."""
        ...

    @property
    def version(self) -> str:
        """Version of what computes the pixels."""
        ...

    def warm_up(self) -> None:
        """Compile or load everything that is slow the first time; called once, before worker processes start."""
        ...

    def open(self, scene: Scene, intrinsics: Intrinsics) -> VisionSession:
        """Load ``scene`` for a camera with ``intrinsics``."""
        ...

    def navigable(self, home: Scene) -> Navigable | None:
        """Where an agent can stand in ``home`` by the backend's own navigation mesh; None if it has none."""
        ...


def frames_at_once(backend: VisionBackend) -> int:
    """How many frames a renderer works on at a time even where there is one core, by its attribute of this name.

    It is more than one where a device draws one frame while the CPU finishes those before it.
    """
    return getattr(backend, "frames_at_once", 1)
