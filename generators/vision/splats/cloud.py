"""A file of splats in the world's frame: read, cleaned, turned, moved and scaled."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import GaussianTable, read_gaussians
from avs3d_bench.geometry import times_matrix
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.scene import F32, SplatFile

Array = NDArray[np.float64]

#: Most Gaussians of a file: with harmonics of degree 3, each takes 232 bytes in every worker process.
MOST_GAUSSIANS = 8_000_000
#: Largest share of Gaussians that may hold NaN or infinite numbers; those are left out.
MOST_BROKEN = 0.01
#: Less opacity than this is never seen: the rasteriser skips α below 1/255.
LEAST_OPACITY = 1.0 / 255.0
#: Standard deviations are at most this (m): one Gaussian then fills the picture whatever it was meant to be.
_LARGEST = 1e4
#: Share of the splats along each axis that counts for where a scene is.
_INNER = (0.05, 0.95)
#: Gaussians that are turned at once: bounds the memory for matrices in double precision.
_CHUNK = 1 << 18
#: Directions from which the rotation of spherical harmonics is found: more than the 7 functions of degree 3.
_DIRECTIONS = 64


@dataclass(frozen=True, eq=False)
class SplatCloud:
    """N Gaussians in the world; all arrays are float32.

    Attributes:
        means: (N, 3) centres, metres.
        covariances: (N, 6) xx, xy, xz, yy, yz, zz, m².
        opacities: (N,) 0 to 1.
        sh: (N, K, 3) spherical harmonics of the colour, by direction in the world.
    """

    means: F32
    covariances: F32
    opacities: F32
    sh: F32

    def __len__(self) -> int:
        return len(self.means)

    @cached_property
    def inner_box(self) -> Array:
        """(2, 3) lowest and highest corner (m) of most of the splats: captures have stray ones far outside."""
        return np.quantile(self.means.astype(np.float64), _INNER, axis=0)


def load_cloud(file: SplatFile) -> SplatCloud:
    """Read a file of splats.

    Raises:
        Avs3dError: if it is missing, no plain PLY of splats, too large, empty, or damaged.
    """
    table = read_gaussians(file.path, MOST_GAUSSIANS)
    with np.errstate(over="ignore"):  # of an infinite logit
        opacities = 1.0 / (1.0 + np.exp(-table.opacities.astype(np.float64)))
    whole = _is_whole(table) & np.isfinite(opacities)
    broken, count = len(table) - int(whole.sum()), len(table)
    if broken > MOST_BROKEN * count:
        raise Avs3dError(
            f"{file.path}: {broken:,} of {count:,} Gaussians hold NaN or infinite numbers; expected at most "
            f"{MOST_BROKEN:.0%}; export the scene again"
        )
    seen = whole & (opacities >= LEAST_OPACITY)
    if not seen.any():
        raise Avs3dError(f"{file.path}: none of its {count:,} Gaussians is opaque enough to be seen; export it again")
    kept = GaussianTable(*(getattr(table, field.name)[seen] for field in fields(table)))
    return transformed(kept, opacities[seen].astype(np.float32), file.to_world)


def _is_whole(table: GaussianTable) -> NDArray[np.bool_]:
    """(N,) whether all numbers but the opacity can be used; a disc's standard deviation of 0 has the logarithm −∞."""
    whole: NDArray[np.bool_] = (table.rotations != 0).any(axis=1) & (table.log_scales < np.log(_LARGEST)).all(axis=1)
    for values in (table.means, table.rotations, table.sh):
        whole &= np.isfinite(values).reshape(len(table), -1).all(axis=1)
    return whole


def transformed(table: GaussianTable, opacities: F32, to_world: Array) -> SplatCloud:
    """Gaussians after a similarity.

    Args:
        table: N of them.
        opacities: (N,) 0 to 1.
        to_world: (4, 4) rotation times a scale, and a translation.
    """
    scale = float(np.cbrt(np.linalg.det(to_world[:3, :3])))
    rotation = to_world[:3, :3] / scale
    turns = [rotation_of_harmonics(rotation, degree).astype(np.float32) for degree in range(1, 4)]
    means, sh = np.empty_like(table.means), table.sh.copy()
    covariances = np.empty((len(table), 6), dtype=np.float32)
    for first in range(0, len(table), _CHUNK):
        own = slice(first, first + _CHUNK)
        means[own] = times_matrix(table.means[own].astype(np.float64), to_world[:3, :3].T) + to_world[:3, 3]
        quaternions = table.rotations[own].astype(np.float64)
        axes = rotation @ Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_matrix()
        axes *= scale * np.exp(table.log_scales[own].astype(np.float64))[:, None, :]
        full = axes @ axes.transpose(0, 2, 1)
        covariances[own] = full[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        for degree, turn in enumerate(turns, start=1):
            band = slice(degree**2, (degree + 1) ** 2)
            if sh.shape[1] >= band.stop:
                sh[own, band] = turn @ table.sh[own, band]
    return SplatCloud(means, covariances, opacities, sh)


def rotation_of_harmonics(rotation: Array, degree: int) -> Array:
    """The (2l + 1, 2l + 1) matrix by which coefficients of degree l change when a function on the sphere is turned.

    A turned function f'(d) = f(R⁻¹d) of degree l has coefficients c' with Σ c'_m Y_m(d) = Σ c_m Y_m(R⁻¹d) for every
    d, which more than 2l + 1 directions determine (Wigner's matrix of the real harmonics).

    Args:
        rotation: (3, 3).
        degree: l, 1 to 3.
    """
    from generators.vision.splats.kernels import harmonics

    directions = fibonacci_directions(_DIRECTIONS)
    turned, still = np.empty((2, _DIRECTIONS, (degree + 1) ** 2))
    harmonics(np.ascontiguousarray(directions @ rotation), turned)
    harmonics(directions, still)
    band = slice(degree**2, None)
    return np.asarray(np.linalg.lstsq(still[:, band], turned[:, band], rcond=None)[0])
