"""Rays against a mesh with numpy alone: the core install has no ray caster, and the checks need few rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Pairs of a ray and a triangle whose directions are compared together.
_AT_ONCE = 2_000_000
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
    corner = np.asarray(vertices, dtype=np.float64)[faces] - np.asarray(origin, dtype=np.float64)
    rays = np.asarray(ends, dtype=np.float64) - np.asarray(origin, dtype=np.float64)
    out = np.full(len(rays), np.inf)
    # Only a ray within the cone round a triangle's ball can meet it.
    middle = corner.mean(axis=1)
    far = np.linalg.norm(middle, axis=1)
    ball = np.linalg.norm(corner - middle[:, None], axis=2).max(axis=1, initial=0.0) * (1 + 10 * _EDGE)
    outside = far > ball
    cosine = np.sqrt(np.maximum(1 - (ball / np.where(outside, far, np.inf)) ** 2, 0.0))
    least = np.where(outside, cosine * far * (1 - _EDGE), -np.inf)
    length = np.maximum(np.linalg.norm(rays, axis=1), 1e-300)
    step = max(1, _AT_ONCE // max(1, len(faces)))
    for at in range(0, len(rays), step):
        some = rays[at : at + step]
        ray, face = np.nonzero((some / length[at : at + step, None]) @ middle.T >= least)
        a, ahead = corner[face, 0], some[ray]
        one, two = corner[face, 1] - a, corner[face, 2] - a
        normal = np.cross(one, two)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / np.einsum("ij,ij->i", ahead, normal)
            t = np.einsum("ij,ij->i", a, normal) * scale
            u = np.einsum("ij,ij->i", ahead, np.cross(two, a)) * scale
            v = np.einsum("ij,ij->i", ahead, np.cross(a, one)) * scale
            inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1 + 2 * _EDGE) & (t > 1e-6)
        np.minimum.at(out, at + ray[inside], t[inside])
    return out
