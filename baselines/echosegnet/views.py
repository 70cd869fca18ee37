"""The cameras and pictures that EchoSegnet works on: the registered frames of an observation, from `sparse/0`.

World: COLMAP's, Y down, metres. Cameras: OpenCV (+X right, +Y down, +Z ahead). The pixel centre of column u, row v lies
at (u + 0.5, v + 0.5). Poses always come from `sparse/0`, as for every user of the official release.

Two cameras stand at each pose: that of `sparse/0` (`load_views`), which took the undistorted pictures in `images/` that
Gaussians are trained on, and that of `input/` (`input_views`), whose size masks have, those that are lifted and those
that are submitted. In our trees they are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Observation, Split
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, flip_world

_FLIP = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class RegisteredView:
    """A registered frame.

    Attributes:
        name: e.g. ``frame_007``.
        split: ``train`` or ``test``.
        camera: intrinsics in pixels: of `images/` from `load_views`, of `input/` from `input_views`.
        rotation: (3, 3) float64 camera-to-world; the columns are the camera's right, down and forward axes.
        position: (3,) float64 camera centre in metres.
        frame: pictures and sound.
    """

    name: str
    split: Split
    camera: Intrinsics
    rotation: NDArray[np.float64]
    position: NDArray[np.float64]
    frame: Frame

    @cached_property
    def world_to_camera(self) -> NDArray[np.float64]:
        """(4, 4) float64: homogeneous world coordinates to camera coordinates."""
        out = np.eye(4)
        out[:3, :3] = self.rotation.T
        out[:3, 3] = -self.rotation.T @ self.position
        return out


def load_views(observation: Observation) -> tuple[RegisteredView, ...]:
    """The frames that COLMAP registered and that belong to a split, sorted by name.

    Raises:
        Avs3dError: if there is no sparse model, or a registered image has no picture, or none is left.
    """
    base = observation.path / layout.COLMAP
    if not base.is_dir():
        raise Avs3dError(f"{base}: missing; EchoSegnet needs the sparse model (run COLMAP, or generate it again)")
    frames = {frame.name: frame for frame in observation.frames}
    views = []
    for image in observation.colmap.images:
        name = PurePosixPath(image.name).stem
        split = observation.splits.get(name)
        if split is None:
            continue
        if name not in frames:
            raise Avs3dError(f"{base / 'images.bin'}: {image.name} is registered, but there is no such picture")
        rotation = _FLIP @ image.pose.rotation_matrix @ _FLIP
        camera = observation.colmap.cameras[image.camera]
        views.append(RegisteredView(name, split, camera, rotation, flip_world(image.pose.position), frames[name]))
    if not any(view.split == "train" for view in views):
        raise Avs3dError(f"{base / 'images.bin'}: {len(views)} registered frames with a split, none of them train")
    return tuple(sorted(views, key=lambda view: view.name))


def input_views(views: Sequence[RegisteredView]) -> tuple[RegisteredView, ...]:
    """The same views with the camera of `input/` (`Observation.intrinsics`) in place of that of `sparse/0`.

    Without observation.json a camera of `sparse/0` that has the size of `input/` stays as it is.
    """
    out = []
    for view in views:
        lens, observation = view.camera, view.frame.observation
        own = observation.intrinsics
        same = observation.record is None and (lens.width, lens.height) == (own.width, own.height)
        out.append(view if same else replace(view, camera=own))
    return tuple(out)


def train_views(views: Sequence[RegisteredView]) -> tuple[RegisteredView, ...]:
    """Those of the train split."""
    return tuple(view for view in views if view.split == "train")


def test_views(views: Sequence[RegisteredView]) -> tuple[RegisteredView, ...]:
    """Those of the test split."""
    return tuple(view for view in views if view.split == "test")


# pytest takes a function of this name for a test where a test module imports it.
test_views.__test__ = False  # type: ignore[attr-defined]


def load_points(observation: Observation) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """The sparse points: (N, 3) metres in the Y-down world, and (N, 3) uint8 RGB.

    Raises:
        Avs3dError: if there is no sparse model, it has no points, or a coordinate is not finite.
    """
    base = observation.path / layout.COLMAP
    if not base.is_dir():
        raise Avs3dError(f"{base}: missing; EchoSegnet needs the sparse model (run COLMAP, or generate it again)")
    points = observation.colmap.points
    if not len(points.ids):
        raise Avs3dError(f"{base / 'points3D.bin'}: no points; the Gaussians start from at least two")
    if not np.isfinite(points.positions).all():
        raise Avs3dError(f"{base / 'points3D.bin'}: points hold NaN or infinite coordinates; regenerate it")
    return flip_world(points.positions), points.colours


def picture_folder(observation: Observation) -> str:
    """The folder of the pictures that Gaussians are trained on: `images`, or `input` where there is no such folder."""
    return layout.IMAGES if (observation.path / layout.IMAGES).is_dir() else layout.INPUT


def camera_extent(views: Sequence[RegisteredView]) -> float:
    """1.1 × the largest distance of a camera from the mean of all, metres: the unit of lengths in 3D-GS.

    If all cameras are at one place it would be 0 and nothing could move; then it is 1 m.
    """
    centres = np.stack([view.position for view in views])
    extent = 1.1 * float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max())
    return extent if extent > 1e-3 else 1.0
