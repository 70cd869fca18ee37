"""Rays of the validator against a mesh: the triangles that it leaves out are never hit (witness: all pairs)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.validation.rays import first_hits


def all_pairs(vertices: NDArray, faces: NDArray, origin: NDArray, ends: NDArray) -> NDArray:
    """Solve origin + t·ray = a + u·one + v·two for every pair."""
    out = np.full(len(ends), np.inf)
    for number, ray in enumerate(ends - origin):
        for face in faces:
            a, b, c = vertices[face]
            system = np.stack([ray, a - b, a - c], axis=1)
            if abs(np.linalg.det(system)) < 1e-12:
                continue
            t, u, v = np.linalg.solve(system, a - origin)
            if t > 1e-6 and u >= 0 and v >= 0 and u + v <= 1:
                out[number] = min(out[number], t)
    return out


@pytest.mark.parametrize("origin", [(3.0, 1.0, 2.0), (0.0, 0.0, 0.0), (0.9, 0.1, 0.0)])
def test_every_hit_of_a_soup_of_triangles_is_found(origin: tuple[float, float, float]):
    """Large and small ones, before, behind and around the origin."""
    rng = np.random.default_rng(4)
    middle, size = rng.normal(0, 1, (40, 1, 3)), rng.choice([0.05, 0.5, 3.0], (40, 1, 1))
    vertices = (middle + size * rng.normal(0, 1, (40, 3, 3))).reshape(-1, 3)
    faces = np.arange(120, dtype=np.int32).reshape(-1, 3)
    start, ends = np.array(origin), rng.normal(0, 2, (60, 3))
    expected = all_pairs(vertices, faces, start, ends)
    assert np.isfinite(expected).sum() > 20
    np.testing.assert_allclose(first_hits(vertices, faces, start, ends), expected, rtol=1e-6)


def test_a_mesh_without_faces_is_never_hit():
    none = np.zeros((0, 3), dtype=np.int32)
    assert np.isinf(first_hits(np.zeros((1, 3)), none, np.zeros(3), np.ones((2, 3)))).all()
