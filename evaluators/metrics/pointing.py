"""Angular error, for methods that only point: where a sound comes from, as a direction or a place in the picture.

Directions are (x, y, z) in the camera's frame, of any length: x to the right, y up, −z ahead. Angles are in degrees.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from evaluators.metrics.inputs import as_array, truth_mask

if TYPE_CHECKING:
    from avs3d_bench.geometry import Intrinsics

Floats = NDArray[np.float64]

#: Errors up to these count as found, in degrees. DCASE's task of localisation and detection counts up to 20°.
WITHIN = (5, 10, 20)


def evaluate(truth: ArrayLike, prediction: ArrayLike) -> dict[str, float]:
    """The angular errors of a set of directions.

    Args:
        truth: (N, 3) true directions.
        prediction: (N, 3) predicted ones.

    Returns:
        ``mean`` and ``median`` in degrees; ``within_5``, ``within_10`` and ``within_20``: the share of errors up to so
        many degrees; ``directions``: their number.

    Raises:
        Avs3dError: if an array has another shape, or a direction is 0 or not finite, or there is none.

    Examples:
        >>> evaluate([[0, 0, -1], [1, 0, 0]], [[0, 0, -2], [1, 0, -1]])["mean"]
        22.5
    """
    errors = angular_error(truth, prediction)
    if errors.size == 0:
        raise Avs3dError("truth: no direction; expected at least one")
    shares = {f"within_{limit}": float(np.mean(errors <= limit)) for limit in WITHIN}
    return {"mean": float(errors.mean()), "median": float(np.median(errors)), **shares, "directions": len(errors)}


def angular_error(truth: ArrayLike, prediction: ArrayLike) -> Floats:
    """(N,) angles in degrees, 0 to 180, between two lists of directions (N, 3).

    From the arctangent of sine and cosine: the arccosine of the product loses half of the digits near 0 (Kahan, "How
    futile are mindless assessments of roundoff", 2006).

    Args:
        truth: (N, 3) of any length.
        prediction: (N, 3) of any length.

    Raises:
        Avs3dError: if an array has another shape, or a direction is 0 or not finite.

    Examples:
        >>> angular_error([[0, 0, -1]], [[0, 2, 0]])
        array([90.])
    """
    a, b = _directions(truth, "truth"), _directions(prediction, "prediction")
    if len(a) != len(b):
        raise Avs3dError(f"prediction: {len(b)} directions, expected as many as of the truth, {len(a)}")
    sines = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.degrees(np.arctan2(sines, np.sum(a * b, axis=1))))


def from_angles(azimuth: ArrayLike, elevation: ArrayLike = 0.0) -> Floats:
    """(N, 3) unit directions from angles in degrees.

    Args:
        azimuth: (N,) 0 ahead, positive to the right.
        elevation: (N,) or one number, positive up.

    Raises:
        Avs3dError: if there are no numbers, or not as many of both.

    Examples:
        >>> from_angles([90.0]).round(3).tolist()
        [[1.0, 0.0, -0.0]]
    """
    angles = (as_array(values, name) for name, values in (("azimuth", azimuth), ("elevation", elevation)))
    try:
        a, e = np.broadcast_arrays(*(np.radians(np.atleast_1d(some)) for some in angles))
    except ValueError:
        raise Avs3dError("elevation: as many as azimuths, or one; found another number") from None
    return np.stack([np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)], axis=1)


def from_pixels(pixels: ArrayLike, camera: Intrinsics) -> Floats:
    """(N, 3) unit directions of places in the picture.

    Args:
        pixels: (N, 2) as (column, row), continuous: the centre of the first pixel is (0.5, 0.5).
        camera: of the picture.

    Raises:
        Avs3dError: if the array has another shape, or a number is not finite.

    Examples:
        >>> from avs3d_bench.geometry import Intrinsics
        >>> from_pixels([[32, 32]], Intrinsics.from_fov(64, 90)).tolist()
        [[0.0, -0.0, -1.0]]
    """
    uv = as_array(pixels, "pixels").astype(np.float64)
    if uv.ndim != 2 or uv.shape[1] != 2:
        raise Avs3dError(f"pixels: shape {uv.shape}, expected (N, 2) as (column, row)")
    x, y = (uv[:, 0] - camera.cx) / camera.fx, -(uv[:, 1] - camera.cy) / camera.fy
    return _directions(np.stack([x, y, -np.ones(len(uv))], axis=1), "pixels")


def error_to_mask(mask: ArrayLike, prediction: ArrayLike, camera: Intrinsics) -> float:
    """Degrees from a predicted direction to the nearest pixel of a true mask; 0 inside of it.

    Args:
        mask: (H, W) true mask of the camera's size, not empty.
        prediction: (3,) direction.
        camera: of the picture.

    Raises:
        Avs3dError: if the mask is empty or has another size, or the direction is 0 or not finite.

    Examples:
        >>> from avs3d_bench.geometry import Intrinsics
        >>> mask = np.zeros((64, 64), bool)
        >>> mask[:, 48:] = True
        >>> round(error_to_mask(mask, [0, 0, -1], Intrinsics.from_fov(64, 90)), 2)
        27.29
    """
    true = truth_mask(as_array(mask, "truth"), "mask")
    if true.shape != (camera.height, camera.width):
        raise Avs3dError(f"truth, mask: shape {true.shape}, expected that of the camera, {camera.height, camera.width}")
    rows, columns = np.nonzero(true)
    if rows.size == 0:
        raise Avs3dError("truth, mask: empty; expected a frame in which the object is visible")
    x, y, z = _directions(np.asarray(prediction)[None], "prediction")[0].tolist()
    if z < 0:
        column, row = camera.cx - camera.fx * x / z, camera.cy + camera.fy * y / z
        if 0 <= column < camera.width and 0 <= row < camera.height and true[int(row), int(column)]:
            return 0.0
    centres = from_pixels(np.stack([columns + 0.5, rows + 0.5], axis=1), camera)
    return float(angular_error(centres, np.broadcast_to((x, y, z), centres.shape)).min())


def _directions(values: Any, name: str) -> Floats:
    """(N, 3) unit vectors, checked."""
    vectors = as_array(values, name).astype(np.float64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise Avs3dError(f"{name}: shape {vectors.shape}, expected (N, 3) directions (x, y, z)")
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    bad = np.flatnonzero(~np.isfinite(lengths[:, 0]) | (lengths[:, 0] == 0))
    if bad.size:
        raise Avs3dError(f"{name}: direction {bad[0]} is {vectors[bad[0]].tolist()}, expected a finite vector, not 0")
    return np.asarray(vectors / lengths)
