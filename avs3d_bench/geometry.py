"""Poses, intrinsics and directions.

World: right-handed, metres, Y up. Camera: looks down −Z, +X right, +Y up (OpenGL, Habitat). A pose is the
camera-to-world transform: position (3,) and unit quaternion (w, x, y, z). The centre of pixel (column u, row v) lies
at (u + 0.5, v + 0.5). Depth is metric z along the optical axis. Azimuth: 0 ahead, positive to the right, degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.errors import Avs3dError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A camera-to-world transform.

    Attributes:
        position: (x, y, z) in metres, world frame.
        rotation: unit quaternion (w, x, y, z).
    """

    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        """Refuse numbers that would hang the acoustic engine.

        Raises:
            Avs3dError: if a number is not finite or the quaternion's norm differs from 1 by more than 1e-4.
        """
        numbers = (*self.position, *self.rotation)
        if not all(math.isfinite(number) for number in numbers):
            raise Avs3dError(f"pose {numbers} is not finite: expected three coordinates and a unit quaternion")
        norm = math.sqrt(sum(q * q for q in self.rotation))
        if abs(norm - 1.0) > 1e-4:
            raise Avs3dError(
                f"pose rotation {self.rotation} has norm {norm:.4f}: expected a unit quaternion (w, x, y, z)"
            )

    @classmethod
    def from_yaw(cls, position: ArrayLike, yaw: float, pitch: float = 0.0) -> Pose:
        """Pose at ``position`` turned left by ``yaw`` and tilted up by ``pitch`` (radians)."""
        x, y, z, w = Rotation.from_euler("YX", [yaw, pitch]).as_quat()
        px, py, pz = (float(c) for c in np.asarray(position, dtype=np.float64))
        return cls((px, py, pz), (float(w), float(x), float(y), float(z)))

    @property
    def rotation_matrix(self) -> Array:
        """(3, 3) camera-to-world rotation; the columns are the camera's right, up and backward axes."""
        w, x, y, z = self.rotation
        return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)

    @property
    def matrix(self) -> Array:
        """(4, 4) camera-to-world."""
        out = np.eye(4)
        out[:3, :3] = self.rotation_matrix
        out[:3, 3] = self.position
        return out

    def to_camera(self, points: ArrayLike) -> Array:
        """World points (..., 3) in camera coordinates (+X right, +Y up, −Z ahead)."""
        delta = np.asarray(points, dtype=np.float64) - np.asarray(self.position)
        return np.asarray(delta @ self.rotation_matrix)


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; all in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_fov(cls, size: int, hfov_degrees: float = 90.0) -> Intrinsics:
        """A square camera of ``size`` pixels (1008 and 90° give fx = fy = cx = cy = 504)."""
        focal = size / 2 / math.tan(math.radians(hfov_degrees) / 2)
        return cls(size, size, focal, focal, size / 2, size / 2)

    def project(self, pose: Pose, points: ArrayLike) -> tuple[Array, Array]:
        """Project world points.

        Args:
            pose: camera-to-world.
            points: (N, 3) world coordinates.

        Returns:
            pixels (N, 2) as (column, row), continuous, and depth (N,) along the optical axis; points at depth ≤ 0 are
            behind the camera and their pixels are NaN.
        """
        camera = pose.to_camera(points)
        depth = -camera[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            u = self.fx * camera[:, 0] / depth + self.cx
            v = -self.fy * camera[:, 1] / depth + self.cy
        pixels = np.stack([u, v], axis=1)
        pixels[depth <= 0] = np.nan
        return pixels, depth


@dataclass(frozen=True)
class Direction:
    """Where a point lies as heard and seen from a pose: azimuth and elevation in degrees, distance in metres."""

    azimuth: float
    elevation: float
    distance: float


def direction_to(pose: Pose, point: ArrayLike) -> Direction:
    """Direction of ``point`` (3,) from ``pose``: azimuth 0 ahead, positive right; elevation positive up."""
    x, y, z = pose.to_camera(np.asarray(point, dtype=np.float64))
    horizontal = math.hypot(x, z)
    return Direction(
        azimuth=math.degrees(math.atan2(x, -z)),
        elevation=math.degrees(math.atan2(y, horizontal)),
        distance=math.sqrt(x * x + y * y + z * z),
    )
