"""Renders a picture of an object with the same background, light and lens for all objects, so that faults are visible.

The studio is a grey room with a large soft light above on the camera's left and a weak one on its right. The object is
scaled to one metre, because the resolution of the light maps is chosen for rooms.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Mesh, Part, Room, Scene
from generators.lighting.bake import bake, insert
from generators.vision.embree import EmbreeBackend

#: Side of a thumbnail, pixels.
SIDE = 256
#: Direction of the camera: degrees to the object's left, and above it.
VIEW = (-32.0, 20.0)
_HFOV = 28.0
_SUPERSAMPLING = 2


def thumbnail(file: Path, side: int = SIDE) -> bytes:
    """PNG of a clean mesh file, seen from its front left; the same file gives the same bytes.

    Raises:
        Avs3dError: if the file cannot be read (see `generators.assets.meshfile.load_mesh`).
    """
    (pixels,) = render_views(load_mesh(file), [VIEW], side)
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG", compress_level=9)
    return buffer.getvalue()


def render_views(mesh: Mesh, views: Sequence[tuple[float, float]], side: int = SIDE) -> list[NDArray[np.uint8]]:
    """Pictures (side, side, 3) of a mesh (metres, Y up, front +Z) from several directions.

    Args:
        mesh: the object.
        views: directions of the camera: degrees to the left of its front, and above.
        side: side of each picture, pixels.
    """
    low, high = mesh.bounds.astype(np.float64)
    # From any direction, an object's silhouette is no larger than its diagonal.
    scale = 1.25 / float(np.linalg.norm(high - low))
    anchor = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    placed = mesh.transformed(np.eye(3), -anchor * scale, scale)
    middle = np.array([0.0, (high[1] - low[1]) * scale / 2, 0.0])
    scene = insert(_studio(), (Part("object", placed, instance_id=1),))
    camera = Intrinsics.from_fov(side * _SUPERSAMPLING, _HFOV)
    session = EmbreeBackend().open(scene.for_room("living_room"), camera)
    distance = 0.74 / np.tan(np.radians(_HFOV / 2))
    pictures = []
    try:
        for yaw, pitch in views:
            pose = _towards(middle, np.radians(yaw), np.radians(pitch), distance)
            pixels = Image.fromarray(session.render(pose).rgb)
            pictures.append(np.asarray(pixels.resize((side, side), Image.Resampling.BOX)))
    finally:
        session.close()
    return pictures


def _towards(target: NDArray[np.float64], yaw: float, pitch: float, distance: float) -> Pose:
    """A camera at ``distance`` from the target and facing it, turned about it by ``yaw`` and raised by ``pitch``."""
    offset = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    half_yaw, half_pitch = yaw / 2, -pitch / 2
    cy, sy, cp, sp = np.cos(half_yaw), np.sin(half_yaw), np.cos(half_pitch), np.sin(half_pitch)
    x, y, z = (float(v) for v in target + distance * offset)
    return Pose((x, y, z), (float(cy * cp), float(cy * sp), float(sy * cp), float(-sy * sp)))


@lru_cache(maxsize=1)
def _studio() -> Scene:
    grey = Material("studio", "plaster", colour=(0.55, 0.55, 0.55))
    key = Material("key_light", "plaster", emission=(9.0, 9.0, 9.0))
    fill = Material("fill_light", "plaster", emission=(2.2, 2.2, 2.2))
    shell = MeshBuilder()
    x, y, z = 4.0, 3.6, 4.0
    shell.quad(_corners((-x, 0, z), (2 * x, 0, 0), (0, 0, -2 * z)), grey)
    shell.quad(_corners((-x, y, -z), (2 * x, 0, 0), (0, 0, 2 * z)), grey)
    shell.quad(_corners((-x, 0, -z), (2 * x, 0, 0), (0, y, 0)), grey)
    shell.quad(_corners((x, 0, z), (-2 * x, 0, 0), (0, y, 0)), grey)
    shell.quad(_corners((-x, 0, z), (0, 0, -2 * z), (0, y, 0)), grey)
    shell.quad(_corners((x, 0, -z), (0, 0, 2 * z), (0, y, 0)), grey)
    lights = MeshBuilder()
    lights.quad(_corners((-2.6, y - 0.05, 0.2), (2.6, 0, 0), (0, 0, 2.4)), key)
    lights.quad(_corners((x - 0.05, 1.6, 0.6), (0, 0, 2.4), (0, 1.6, 0)), fill)
    room = Room("living_room", (-x, 0.0, -z), (x, y, z))
    parts = (Part("shell", shell.build()), Part("lights", lights.build()))
    return bake(Scene("studio", parts, (room,), ()), quality="preview", workers=1)


def _corners(origin: Sequence[float], u: Sequence[float], v: Sequence[float]) -> NDArray[np.float64]:
    """(4, 3) corners of the rectangle at ``origin`` along ``u`` and ``v``."""
    o, a, b = (np.asarray(each, dtype=np.float64) for each in (origin, u, v))
    return np.stack([o, o + a, o + a + b, o + b])
