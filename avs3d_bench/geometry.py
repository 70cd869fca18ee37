"""Poses, intrinsics and directions.

World: right-handed, metres, Y up. Camera: looks down −Z, +X right, +Y up (OpenGL, Habitat). A pose is the
camera-to-world transform: position (3,) and unit quaternion (w, x, y, z). The centre of pixel (column u, row v) lies
at (u + 0.5, v + 0.5). Depth is metric z along the optical axis. Azimuth: 0 ahead, positive to the right, degrees.

COLMAP (`to_colmap`, `from_colmap`, `flip_world`): OpenCV cameras (+Y down, +Z ahead) in a world turned by 180° about
X, so that Y points down: (x, y, z) → (x, −y, −z). Gravity stays on an axis, because the official pipeline reads the
xz plane as the floor; with Y up its left/right test would come out mirrored. COLMAP's pixel centres are ours.

Examples:
    >>> pose = Pose.from_yaw((0, 1.5, 0), np.pi / 2)  # turned left by 90°: looks along −X
    >>> direction = geometry.direction_to(pose, (0, 1.5, -2))
    >>> round(direction.azimuth, 6), round(direction.elevation, 6), direction.distance  # degrees, degrees, metres
    (90.0, 0.0, 2.0)
    >>> round(geometry.rotation_angle(pose, Pose.from_yaw((0, 0, 0), 0)), 6)  # degrees
    90.0
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A camera-to-world transform.

    Attributes:
        position: (x, y, z) in metres, world frame.
        rotation: unit quaternion (w, x, y, z).

    Examples:
        >>> Pose.from_yaw((4, 1.5, 2), 0.0).rotation  # looks along −Z
        (1.0, 0.0, 0.0, 0.0)
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
        from scipy.spatial.transform import Rotation  # see `_matrix_of`

        x, y, z, w = Rotation.from_euler("YX", [yaw, pitch]).as_quat()
        px, py, pz = (float(c) for c in np.asarray(position, dtype=np.float64))
        return cls((px, py, pz), (float(w), float(x), float(y), float(z)))

    @property
    def rotation_matrix(self) -> Array:
        """(3, 3) camera-to-world rotation; the columns are the camera's right, up and backward axes."""
        return _matrix_of(self.rotation)

    @property
    def matrix(self) -> Array:
        """(4, 4) camera-to-world."""
        out = np.eye(4)
        out[:3, :3] = self.rotation_matrix
        out[:3, 3] = self.position
        return out

    def to_camera(self, points: ArrayLike) -> Array:
        """World points (..., 3) in camera coordinates (+X right, +Y up, −Z ahead)."""
        return times_matrix(np.asarray(points, dtype=np.float64) - np.asarray(self.position), self.rotation_matrix)

    def to_world(self, points: ArrayLike) -> Array:
        """Points (..., 3) in camera coordinates, in the world: the inverse of `to_camera`."""
        turned = times_matrix(np.asarray(points, dtype=np.float64), self.rotation_matrix.T)
        return np.asarray(turned + np.asarray(self.position))


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; all in pixels.

    Attributes:
        width: of the picture.
        height: of the picture.
        fx: horizontal focal length.
        fy: vertical focal length.
        cx: column of the principal point; the left edge of the picture is 0.
        cy: row of the principal point; the upper edge of the picture is 0.

    Examples:
        >>> camera = Intrinsics.from_fov(512)
        >>> round(camera.fx, 6), camera.cx
        (256.0, 256.0)
        >>> pixels, depth = camera.project(Pose.from_yaw((0, 1.5, 0), 0.0), [(1, 1.5, -2)])  # 1 m right, 2 m ahead
        >>> pixels.round(6).tolist(), depth.tolist()  # (column, row), metres
        ([[384.0, 256.0]], [2.0])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_fov(cls, size: int, hfov_degrees: float = 90.0) -> Intrinsics:
        """A square camera of ``size`` pixels, ``hfov_degrees`` wide (1008 and 90° give fx = fy = cx = cy = 504)."""
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
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            u = self.fx * camera[:, 0] / depth + self.cx
            v = -self.fy * camera[:, 1] / depth + self.cy
        pixels = np.stack([u, v], axis=1)
        pixels[depth <= 0] = np.nan
        return pixels, depth

    def unproject(self, pose: Pose, pixels: ArrayLike, depth: ArrayLike) -> Array:
        """World points (N, 3) at continuous ``pixels`` (N, 2) (column, row) and ``depth`` (N,) along the axis."""
        uv, z = np.asarray(pixels, dtype=np.float64), np.asarray(depth, dtype=np.float64)
        camera = np.stack([(uv[:, 0] - self.cx) / self.fx * z, -(uv[:, 1] - self.cy) / self.fy * z, -z], axis=1)
        return pose.to_world(camera)


@dataclass(frozen=True)
class Direction:
    """Where a point lies as heard and seen from a pose: azimuth and elevation in degrees, distance in metres.

    Examples:
        >>> direction_to(Pose.from_yaw((0, 1.5, 0), 0.0), (2, 1.5, 0))  # 2 m to the right
        Direction(azimuth=90.0, elevation=0.0, distance=2.0)
    """

    azimuth: float
    elevation: float
    distance: float


def direction_to(pose: Pose, point: ArrayLike) -> Direction:
    """Direction of ``point`` (3,) from ``pose``: azimuth 0 ahead, positive right; elevation positive up.

    Examples:
        >>> found = direction_to(Pose.from_yaw((0, 1.5, 0), 0.0), (1, 2.5, -1))
        >>> round(found.azimuth, 1), round(found.elevation, 1), round(found.distance, 2)  # degrees, degrees, metres
        (45.0, 35.3, 1.73)
    """
    x, y, z = pose.to_camera(np.asarray(point, dtype=np.float64))
    horizontal = math.hypot(x, z)
    return Direction(
        azimuth=math.degrees(math.atan2(x, -z)),
        elevation=math.degrees(math.atan2(y, horizontal)),
        distance=math.sqrt(x * x + y * y + z * z),
    )


def ambisonic_axes(directions: ArrayLike) -> Array:
    """Directions (..., 3) in the head's frame (x right, y up, z backward) in the axes of AmbiX (forward, left, up).

    Examples:
        >>> (ambisonic_axes([0, 0, -1]) + 0.0).tolist()  # ahead
        [1.0, 0.0, 0.0]
    """
    d = np.asarray(directions, dtype=np.float64)
    return np.stack([-d[..., 2], -d[..., 0], d[..., 1]], axis=-1)


def spherical_harmonics(directions: ArrayLike, order: int) -> Array:
    """(n, (order + 1)²) real spherical harmonics, ACN order and SN3D, of unit vectors (n, 3) in AmbiX axes.

    The squares of the 2l + 1 harmonics of a degree l add up to 1 in every direction. There is no Condon–Shortley phase.

    Examples:
        >>> spherical_harmonics([[1.0, 0.0, 0.0]], order=1).tolist()  # from ahead: W, Y, Z, X
        [[1.0, 0.0, 0.0, 1.0]]
    """
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    terms = [np.ones_like(x), y, z, x]
    if order >= 2:
        r3 = np.sqrt(3.0)
        terms += [r3 * x * y, r3 * y * z, (3 * z * z - 1) / 2, r3 * x * z, r3 / 2 * (x * x - y * y)]
    if order >= 3:
        r58, r38, r15 = np.sqrt(5 / 8), np.sqrt(3 / 8), np.sqrt(15.0)
        terms += [
            r58 * y * (3 * x * x - y * y),
            r15 * x * y * z,
            r38 * y * (5 * z * z - 1),
            z * (5 * z * z - 3) / 2,
            r38 * x * (5 * z * z - 1),
            r15 / 2 * z * (x * x - y * y),
            r58 * x * (x * x - 3 * y * y),
        ]
    return np.stack(terms, axis=-1)


def times_matrix(vectors: Array, matrix: Array) -> Array:
    """The product of row vectors (..., 3) and a matrix (3, 3), with the same bits on every processor.

    BLAS fuses products and sums where the processor can, and orders them by the number of rows; files with such numbers
    would differ between machines.

    Examples:
        >>> times_matrix(np.array([[1.0, 2.0, 3.0]]), np.eye(3)[::-1]).tolist()
        [[3.0, 2.0, 1.0]]
    """
    x, y, z = (vectors[..., axis, None] for axis in range(3))
    return np.asarray(x * matrix[0] + y * matrix[1] + z * matrix[2])


def flip_world(points: ArrayLike) -> Array:
    """Points (..., 3) from our world (Y up) to COLMAP's (Y down) or back: (x, y, z) → (x, −y, −z).

    Examples:
        >>> flip_world([1.0, 2.0, 3.0]).tolist()
        [1.0, -2.0, -3.0]
    """
    # Adding 0 turns −0 into 0: files then hold the same bytes for the same points.
    return np.asarray(np.asarray(points, dtype=np.float64) * np.array([1.0, -1.0, -1.0]) + 0.0)


def canonical(quaternion: ArrayLike) -> Array:
    """The one of q and −q (the same rotation) whose first component that is not 0 is positive; norm 1.

    Examples:
        >>> canonical([-1.0, 0.0, 0.0, 0.0]).tolist()
        [1.0, 0.0, 0.0, 0.0]
    """
    q = np.asarray(quaternion, dtype=np.float64)
    first = q[np.flatnonzero(q)[0]]
    # Not numpy's norm, a product of BLAS (`times_matrix`).
    return np.asarray(q / (math.sqrt(sum(c * c for c in q.tolist())) * np.sign(first)) + 0.0)


def to_colmap(pose: Pose) -> tuple[Array, Array]:
    """Our camera-to-world as COLMAP's world-to-camera.

    With F = diag(1, −1, −1), the camera-to-world rotation becomes F·R·F (F on the left turns the world, on the right
    the camera axes), which maps the quaternion (w, x, y, z) to (w, x, −y, −z); its inverse is (w, −x, y, z).

    Returns:
        qvec (4,) unit (w, x, y, z) with w ≥ 0, and tvec (3,): p_camera = R(qvec) · p_world + tvec, OpenCV axes.

    Examples:
        >>> qvec, tvec = to_colmap(Pose.from_yaw((1, 1.5, 2), 0.0))
        >>> qvec.tolist(), tvec.tolist()
        ([1.0, 0.0, 0.0, 0.0], [-1.0, 1.5, 2.0])
    """
    w, x, y, z = pose.rotation
    qvec = canonical([w, -x, y, z])
    rotation = _matrix_of(qvec)
    return qvec, times_matrix(flip_world(pose.position), -rotation.T) + 0.0


def from_colmap(qvec: ArrayLike, tvec: ArrayLike) -> Pose:
    """The inverse of `to_colmap`.

    Raises:
        Avs3dError: if a number is not finite or the quaternion's norm differs from 1 by more than 1 %.

    Examples:
        >>> pose = Pose.from_yaw((1, 1.5, 2), 0.3)
        >>> [round(metres, 6) for metres in from_colmap(*to_colmap(pose)).position]
        [1.0, 1.5, 2.0]
    """
    q, t = np.asarray(qvec, dtype=np.float64), np.asarray(tvec, dtype=np.float64)
    sound = q.shape == (4,) and t.shape == (3,) and bool(np.isfinite(q).all() and np.isfinite(t).all())
    # COLMAP normalises quaternions when it reads them; a norm far from 1 is damage, not rounding.
    if not sound or np.abs(q).max() > 2 or abs(float(np.linalg.norm(q)) - 1.0) > 0.01:
        raise Avs3dError(f"COLMAP pose {q.tolist()} {t.tolist()}: expected a unit quaternion (w, x, y, z) and (3,)")
    w, x, y, z = (float(c) for c in canonical(q))
    rotation = _matrix_of((w, x, y, z))
    px, py, pz = (float(c) for c in flip_world(times_matrix(t, -rotation)))
    rw, rx, ry, rz = (float(c) for c in canonical([w, -x, y, z]))
    return Pose((px, py, pz), (rw, rx, ry, rz))


def _matrix_of(quaternion: ArrayLike) -> Array:
    """(3, 3) rotation of a unit quaternion (w, x, y, z)."""
    # Half of what every program loads with this module would be for it, and few need it.
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix(), dtype=np.float64)


def rotation_angle(first: Pose, second: Pose) -> float:
    """Degrees between two orientations; the same for q and −q.

    Examples:
        >>> round(rotation_angle(Pose.from_yaw((0, 0, 0), 0.0), Pose.from_yaw((0, 0, 0), np.pi / 6)), 6)
        30.0
    """
    a, b = canonical(first.rotation), canonical(second.rotation)
    # From the chord: arccos of the dot product loses half of the digits near 0.
    chord = min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
    return math.degrees(4.0 * math.asin(min(1.0, chord / 2.0)))
