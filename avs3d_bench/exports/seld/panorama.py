"""Films of a recording: panoramas of 360° × 180° and perspective views, resampled from the six faces of a cube.

The faces are rendered in the axes of the world, so that a head that turns needs no new ones: only where the listener is
at another place, or an object has moved, are six pictures rendered. That is at full seconds, as in the dataset; the
rotation of the head is renewed every 100 ms. The generator renders; it offers itself through an entry point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.outputs import DRAWN_BY
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.seld.events import LABELS_PER_SECOND, Array, TurningHead
from avs3d_bench.exports.seld.labels import HALF_HEIGHT, HALF_WIDTH
from avs3d_bench.exports.seld.recordings import SeldClip, SeldFormat
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.formats.film import RATE, encode_film
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.runtime.imports import needing

U8 = NDArray[np.uint8]
#: (6, side, side, 3) RGB: the faces at the listener's position in a second, in the order of `face_poses`.
Faces = Callable[[int], U8]

#: Entry points that render the faces of an observation: called with `FaceRequest`, they give `Faces`.
GROUP = "avs3d.panorama"
_INSTALL = "pip install 'avs3d-bench[generate]'"
#: Pixels by which a face is larger than 90° on each side, so that no interpolation ends at its border.
MARGIN = 2
#: Least and greatest width of a film (pixels).
WIDTHS = (64, 3840)
#: Width of a film if none is given: that at which DCASE 2026 takes panoramas, and that of the films of DCASE 2025.
USUAL_WIDTH: dict[SeldFormat, int] = {"foa": 360, "stereo": 640, "binaural": 640}
#: Camera-to-world rotations of the six faces, quaternions (w, x, y, z): −Z, −X, +Z, +X, +Y, −Y.
_H = math.sqrt(0.5)
_ROTATIONS = (
    (1.0, 0.0, 0.0, 0.0),
    (_H, 0.0, _H, 0.0),
    (0.0, 0.0, 1.0, 0.0),
    (_H, 0.0, -_H, 0.0),
    (_H, _H, 0.0, 0.0),
    (_H, -_H, 0.0, 0.0),
)


@dataclass(frozen=True)
class FaceRequest:
    """What a renderer of faces is asked for.

    Attributes:
        root: the dataset.
        key: of the observation.
        camera: of each face, see `face_camera`.
        manifest: the manifest's file, if it names files beside it.
        hrtf: the SOFA file of the head with which the dataset was made, if it was made with one.
    """

    root: Path
    key: str
    camera: Intrinsics
    manifest: Path | None = None
    hrtf: Path | None = None


def face_poses(position: tuple[float, float, float]) -> tuple[Pose, ...]:
    """The poses of the six faces at a place."""
    return tuple(Pose(position, rotation) for rotation in _ROTATIONS)


def face_camera(side: int) -> Intrinsics:
    """The camera of a face whose 90° are ``side`` pixels wide, with its margin."""
    whole = side + 2 * MARGIN
    return Intrinsics(whole, whole, side / 2, side / 2, whole / 2, whole / 2)


def face_side(width: int, form: SeldFormat) -> int:
    """Width of 90° of a face, at which its middle is as fine as the middle of a film of this width."""
    focal = width / (2 * math.pi) if form == "foa" else width / (2 * HALF_WIDTH)
    return 2 * math.ceil(focal)


def entry_points() -> tuple[metadata.EntryPoint, ...]:
    """The installed functions that render faces."""
    return tuple(metadata.entry_points(group=GROUP))


def find_renderer() -> Callable[[FaceRequest], Faces]:
    """The function of the generator behind the entry point.

    Raises:
        UsageError: if it is not installed.
    """
    for point in entry_points():
        with needing("--video", _INSTALL, kind=UsageError):
            found: Callable[[FaceRequest], Faces] = point.load()
        return found
    raise UsageError(f"--video needs the generator: {_INSTALL}")


def check_width(width: int) -> None:
    """Refuse a width of a film that is odd or out of range.

    Raises:
        UsageError: one line.
    """
    if width % 4 or not WIDTHS[0] <= width <= WIDTHS[1]:
        raise UsageError(f"--video-width {width}: expected a multiple of 4 from {WIDTHS[0]} to {WIDTHS[1]} pixels")


def panorama_rays(width: int) -> Array:
    """(width / 2, width, 3) directions of the pixels of a panorama; x right, y up, z back.

    Columns go from azimuth +180° (left edge) to −180°, ahead is in the middle; rows from +90° to −90°.
    """
    height = width // 2
    azimuth = np.radians(180 - (np.arange(width) + 0.5) * 360 / width)
    elevation = np.radians(90 - (np.arange(height) + 0.5) * 180 / height)[:, None]
    level = np.cos(elevation)
    rays = (-np.sin(azimuth) * level, np.sin(elevation) * np.ones(width), -np.cos(azimuth) * level)
    return np.stack(rays, axis=-1)


def perspective_rays(width: int, view: int) -> Array:
    """(height, width, 3) directions of a picture of 16 : 9, 100° wide, that looks ``view`` degrees to the right."""
    height = 4 * round(width * 9 / 64)
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * HALF_WIDTH
    y = (1 - (np.arange(height) + 0.5) / height * 2)[:, None] * HALF_HEIGHT
    x, y = np.broadcast_arrays(x, y)
    angle = math.radians(view)
    # The camera, turned to the right about the head's upward axis.
    return np.stack([x * math.cos(angle) + math.sin(angle), y, x * math.sin(angle) - math.cos(angle)], axis=-1)


class CubeSampler:
    """Looks up directions in the faces of a cube.

    Args:
        rays: (H, W, 3) directions in the axes of the world, of any length.
        camera: of the faces.
    """

    def __init__(self, rays: Array, camera: Intrinsics) -> None:
        depth = np.full(rays.shape[:2], -np.inf)
        self._x, self._y = (np.zeros(rays.shape[:2], dtype=np.float32) for _ in range(2))
        for number, pose in enumerate(face_poses((0.0, 0.0, 0.0))):
            seen = pose.to_camera(rays)
            nearer = -seen[..., 2] > depth
            depth[nearer] = -seen[..., 2][nearer]
            u = camera.cx + camera.fx * seen[..., 0][nearer] / depth[nearer] - 0.5
            v = camera.cy - camera.fy * seen[..., 1][nearer] / depth[nearer] - 0.5
            self._x[nearer], self._y[nearer] = u, v + number * camera.height

    def sample(self, faces: U8) -> U8:
        """(H, W, 3) the picture, from faces (6, side, side, 3)."""
        import cv2

        atlas = np.ascontiguousarray(faces.reshape(-1, *faces.shape[2:]))
        return np.asarray(cv2.remap(atlas, self._x, self._y, cv2.INTER_LINEAR), dtype=np.uint8)


def clip_pictures(clip: SeldClip, rays: Array, faces: Faces, head: TurningHead, camera: Intrinsics) -> Iterator[U8]:
    """The pictures of a clip, one every 100 ms.

    Args:
        clip: which seconds.
        rays: (H, W, 3) of the film's pixels, in the axes of the head.
        faces: renders.
        head: the listener's.
        camera: of the faces.
    """
    for second in range(clip.start, clip.start + clip.seconds):
        found, still, turns = faces(second), None, bool(head.turn(second).any())
        for part in range(LABELS_PER_SECOND):
            if turns or still is None:
                turned = head.turned_since(second, (part + 0.5) / LABELS_PER_SECOND)
                # A vector of the turned head in the axes of the world: back to the frame's head first.
                world = (rays @ turned) @ head.poses[second].rotation_matrix.T
                still = CubeSampler(world, camera).sample(found)
            yield still


def write_film(path: Path, pictures: Iterator[U8], size: tuple[int, int]) -> None:
    """Write pictures of 100 ms each as an MP4 of 30 a second, without sound.

    Args:
        path: the MP4.
        pictures: (height, width, 3) each.
        size: (width, height).

    Raises:
        Avs3dError: if PyAV is missing, or the system refuses.
    """
    with needing("--video", "pip install 'avs3d-bench[inspect]'"):
        import av
    try:
        with atomic_path(path) as temporary:
            encode_film(av, temporary, pictures, size, comment=DRAWN_BY, repeat=RATE // LABELS_PER_SECOND)
    except av.FFmpegError as error:
        raise Avs3dError(f"{path}: cannot write the film: {_cause(error)}; free some space") from error


def _cause(error: Any) -> str:
    return str(error.strerror or error)
