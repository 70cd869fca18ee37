"""Rays against a mesh with numpy alone: the core install has no ray caster, and the checks need few rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Pairs of a ray and a triangle that are looked at together.
_AT_ONCE = 400_000
#: A ray that passes a triangle's edge by this share of its size counts as a hit: no gaps between triangles.
_EDGE = 1e-7


def first_hits(
    vertices: NDArray[np.floating], faces: NDArray[np.int32], origin: NDArray[np.floating], ends: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Where rays from one point meet a mesh first (Möller & Trumbore 1997, both sides count).

    Args:
        vertices: (V, 3).
        faces: (F, 3) indices.
        origin: (3,) of all rays.
        ends: (N, 3) points that the rays go through.

    Returns:
        (N,) multiples of the way from ``origin`` to the point; infinite where nothing is met.
    """
    corner = np.asarray(vertices, dtype=np.float64)[faces]
    a, one, two = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    start = np.asarray(origin, dtype=np.float64) - a  # (F, 3)
    # Of t = (one × two)·… only the direction depends on the ray.
    normal = np.cross(one, two)
    height = -np.einsum("fi,fi->f", normal, start)
    left, right = np.cross(start, two), np.cross(one, start)
    rays = np.asarray(ends, dtype=np.float64) - np.asarray(origin, dtype=np.float64)
    out = np.full(len(rays), np.inf)
    step = max(1, _AT_ONCE // max(1, len(faces)))
    for at in range(0, len(rays), step):
        some = rays[at : at + step]
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (some @ normal.T)
            t = height * scale
            u = (some @ left.T) * scale
            v = (some @ right.T) * scale
            inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1 + 2 * _EDGE) & (t > 1e-6)
        out[at : at + step] = np.where(inside, t, np.inf).min(axis=1, initial=np.inf)
    return out
