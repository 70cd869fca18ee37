"""Directional albedos of the microfacet model: the part of a uniform light that a surface reflects towards the eye."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from generators.core.low_discrepancy import net
from generators.core.scene import F32

#: Reflectance at normal incidence of dielectrics with an index of refraction of 1.5.
DIELECTRIC = np.float32(0.04)
#: Entries of the table along the roughness and along cos θ.
ROUGHNESSES, COSINES = 32, 32
#: Samples of each entry.
_SAMPLES = 1024


@lru_cache(maxsize=1)
def albedo_table() -> F32:
    """(`ROUGHNESSES`, `COSINES`, 2) float32: A and B at roughness i / (n − 1) and cos θ (j + 0.5) / n.

    The albedo of a surface that reflects F0 at normal incidence is F0 · A + B.

    Integrated with samples of the visible normals (E. Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT
    7(4), 2018) and the height-correlated Smith term; light is reflected once.
    """
    points = net(_SAMPLES)
    table = np.empty((ROUGHNESSES, COSINES, 2))
    cosine = (np.arange(COSINES)[:, None] + 0.5) / COSINES
    view = np.stack([np.sqrt(1.0 - cosine**2), 0.0 * cosine, cosine], axis=-1)
    for row, roughness in enumerate(np.linspace(0.0, 1.0, ROUGHNESSES)):
        alpha = max(roughness**2, 1e-4)
        half = visible_normals(view, alpha, points)
        along = np.einsum("ijk,ijk->ij", np.broadcast_to(view, half.shape), half)
        out = 2.0 * along * half[..., 2] - cosine
        seen, lit = smith_lambda(cosine, alpha), smith_lambda(np.clip(out, 1e-6, 1.0), alpha)
        weight = np.where(out > 0.0, (1.0 + seen) / (1.0 + seen + lit), 0.0)
        rest = grazing(along)
        table[row, :, 0] = (weight * (1.0 - rest)).mean(axis=1)
        table[row, :, 1] = (weight * rest).mean(axis=1)
    return table.astype(np.float32)


@lru_cache(maxsize=256)
def dielectric_albedo(roughness: float) -> float:
    """Share of a uniform light that the surface of a dielectric reflects in all directions; 0 of a matte one."""
    if roughness >= 1.0:
        return 0.0
    cosine = (np.arange(COSINES) + 0.5) / COSINES
    rows = np.arange(ROUGHNESSES) / (ROUGHNESSES - 1)
    towards = albedo_table() @ np.array([DIELECTRIC, 1.0], dtype=np.float32)
    return float(np.interp(roughness, rows, (towards * 2.0 * cosine).mean(axis=1)))


def grazing(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of 1 − F0 that a surface reflects besides F0, by Schlick's Fresnel term, at an angle to the normal."""
    return np.asarray((1.0 - np.clip(cosine, 0.0, 1.0)) ** 5)


def smith_lambda(cosine: NDArray[np.float64], alpha: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Smith's Λ of GGX at an angle to the normal."""
    return np.asarray((np.sqrt(1.0 + alpha**2 * (1.0 / cosine**2 - 1.0)) - 1.0) / 2.0)


def visible_normals(
    view: NDArray[np.float64], alpha: float | NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(C, S, 3) normals that are visible from ``view`` (C, 1, 3), x–z plane, of a lobe ``alpha`` or (C, 1).

    ``points`` (S, 2) or (C, S, 2) lie in the unit square.
    """
    v = view * np.stack(np.broadcast_arrays(alpha, alpha, 1.0), axis=-1)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    x, z = v[..., 0], v[..., 2]
    radius, angle = np.sqrt(points[..., 0]), 2.0 * np.pi * points[..., 1]
    t1, t2 = radius * np.cos(angle), radius * np.sin(angle)
    s = 0.5 * (1.0 + z)
    t2 = (1.0 - s) * np.sqrt(1.0 - t1**2) + s * t2
    up = np.sqrt(np.maximum(1.0 - t1**2 - t2**2, 0.0))
    # The basis is T1 = y and T2 = v × T1 = (−z, 0, x).
    half = np.stack([alpha * (-z * t2 + x * up), alpha * (t1 + 0.0 * z), np.maximum(x * t2 + z * up, 1e-9)], axis=-1)
    return np.asarray(half / np.linalg.norm(half, axis=-1, keepdims=True))
