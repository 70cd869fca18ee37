"""Common parts of the renderers: the camera as kernels read it, its checks, and a scene to warm up with."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.scene import LightMap, Material, Part, Scene, Texture

if TYPE_CHECKING:
    from generators.vision.kernels import PinholeView

#: Largest picture side; pixel numbers must fit 32 bits with room to spare.
MAX_SIDE = 16384


def check_camera(camera: Intrinsics) -> None:
    """Refuse a camera that cannot be rendered.

    Raises:
        Avs3dError: naming what is wrong.
    """
    if not (0 < camera.width <= MAX_SIDE and 0 < camera.height <= MAX_SIDE):
        raise Avs3dError(f"camera: {camera.width}×{camera.height} pixels; expected 1 to {MAX_SIDE} on each side")
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not (np.isfinite(numbers).all() and camera.fx > 0 and camera.fy > 0):
        raise Avs3dError(f"camera: fx, fy, cx, cy are {numbers}; expected finite numbers, focal lengths > 0")


def view_of(camera: Intrinsics, pose: Pose) -> PinholeView:
    """A camera at a pose."""
    from generators.vision.kernels import PinholeView

    right, up, backward = pose.rotation_matrix.T
    return PinholeView(
        origin=pose.position,
        right=_vector(right / camera.fx),
        down=_vector(-up / camera.fy),
        ahead=_vector(-backward),
        corner=_vector(-backward - right * (camera.cx / camera.fx) + up * (camera.cy / camera.fy)),
        width=camera.width,
        height=camera.height,
    )


def pose_number(pose: Pose) -> int:
    """A number of 32 bits that another pose hardly ever has: seed of what is random in its picture."""
    return zlib.crc32(np.array([*pose.position, *pose.rotation], dtype="<f8").tobytes())


def trial_scene() -> tuple[Scene, Intrinsics, Pose]:
    """A textured and lit box of clear steel seen on 16 × 16 pixels: rendering it takes every kernel."""
    from generators.assets.shapes import MeshBuilder

    texture = Texture("grey", np.full((4, 4, 3), 128, dtype=np.uint8))
    steel = Material("steel", "metal", texture=texture, roughness=0.2, metallic=0.5, transmission=0.5)
    mesh = MeshBuilder().box((1, 1, 1), (0, 0, 0), steel).build()
    light = LightMap(np.zeros_like(mesh.uv), np.ones((2, 2, 3), dtype=np.float16))
    scene = Scene("warm-up", (Part("box", mesh, light=light),), (), ())
    return scene, Intrinsics.from_fov(16), Pose.from_yaw((0.2, 0.1, 2.0), 0.0)


def _vector(xyz: np.ndarray) -> tuple[float, float, float]:
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


def room_at(scene: Scene, pose: Pose) -> str:
    """The room of ``scene`` in which a camera stands: the nearest box; "" where the scene has no rooms."""
    x, y, z = pose.position

    def distance(low: tuple[float, float, float], high: tuple[float, float, float]) -> float:
        outside = (max(a - p, p - b, 0.0) for a, p, b in zip(low, (x, y, z), high, strict=True))
        return sum(each * each for each in outside)

    nearest = min(scene.rooms, key=lambda room: distance(room.low, room.high), default=None)
    return nearest.name if nearest else ""
