"""The silhouette of a mesh as a pinhole camera sees it, without occluders: the reference that masks are held to."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Array, Intrinsics, Pose

#: Nearer surfaces are cut off, metres.
NEAR = 0.05
#: OpenCV takes fixed-point coordinates with this many fractional bits, and clips them to the picture itself.
_SHIFT = 4
_FAR_OUT = 30_000.0


def _cut_near(triangle: Array) -> Array:
    """A triangle (3, 3) in camera coordinates cut at depth `NEAR` (Sutherland & Hodgman 1974): (0, 3 or 4, 3)."""
    kept: list[Array] = []
    for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        a, b = -start[2] - NEAR, -end[2] - NEAR
        if a >= 0:
            kept.append(start)
        if (a >= 0) != (b >= 0):
            kept.append(start + (end - start) * (a / (a - b)))
    return np.array(kept).reshape(-1, 3)


def silhouette(
    camera: Intrinsics, pose: Pose, vertices: NDArray[np.float32], faces: NDArray[np.int32], margin: int = 0
) -> NDArray[np.bool_]:
    """Pixels that a mesh covers, ignoring occlusion.

    Args:
        camera: the camera.
        pose: camera-to-world.
        vertices: (V, 3) world, metres.
        faces: (F, 3) indices.
        margin: the silhouette is widened by this many pixels.

    Returns:
        (H, W) bool. Pixels that an edge only touches count, so without margin it is up to one pixel too wide.
    """
    picture = np.zeros((camera.height, camera.width), dtype=np.uint8)
    local = pose.to_camera(vertices)
    ahead = (-local[:, 2] >= NEAR)[faces]
    whole, cut = faces[ahead.all(axis=1)], faces[ahead.any(axis=1) & ~ahead.all(axis=1)]

    def pixels(points: Array) -> NDArray[np.int32]:
        depth = -points[..., 2]
        # Fixed point of OpenCV: whole numbers are pixel centres, ours lie at + 0.5.
        u = camera.fx * points[..., 0] / depth + camera.cx - 0.5
        v = -camera.fy * points[..., 1] / depth + camera.cy - 0.5
        fixed = np.clip(np.stack([u, v], axis=-1), -_FAR_OUT, _FAR_OUT) * (1 << _SHIFT)
        return np.rint(fixed).astype(np.int32)

    polygons = pixels(local[whole])
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    size = np.array([camera.width, camera.height]) << _SHIFT
    for polygon in polygons[((high >= 0) & (low <= size)).all(axis=1)]:
        cv2.fillConvexPoly(picture, polygon, 1, cv2.LINE_8, _SHIFT)
    for triangle in local[cut]:
        cv2.fillConvexPoly(picture, pixels(_cut_near(triangle)), 1, cv2.LINE_8, _SHIFT)
    if margin:
        side = 2 * margin + 1
        picture = np.asarray(cv2.dilate(picture, np.ones((side, side), dtype=np.uint8)), dtype=np.uint8)
    return np.asarray(picture > 0, dtype=np.bool_)
