"""`generators.core.arrays` against numpy, and shading normals against a loop over single vertices, to the last bit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from generators.assets.shapes import corner_normals
from generators.core.arrays import cross, distinct_rows, dot_rows


@given(
    rows=st.lists(st.tuples(*[st.integers(-3, 3)] * 3), max_size=40),
    step=st.sampled_from((1, 2**30)),
    shift=st.sampled_from((0, 2**40, -(2**62))),
)
def test_distinct_rows_are_those_of_numpy(rows: list[tuple[int, int, int]], step: int, shift: int) -> None:
    keys = np.array(rows, dtype=np.int64).reshape(-1, 3) * step + shift
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    found = distinct_rows(keys)
    np.testing.assert_array_equal(found[0], first)
    np.testing.assert_array_equal(found[1], inverse.reshape(-1))


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_cross_products_are_those_of_numpy(count: int) -> None:
    a, b = np.random.default_rng(3).normal(size=(2, count, 3))
    assert cross(a, b).tobytes() == np.cross(a, b).tobytes()


@pytest.mark.parametrize("count", [1, 7, 193, 4096, 100_003])
def test_products_of_rows_do_not_depend_on_the_rows_around(count: int) -> None:
    """`@` fails this: with 100,003 rows the last bit of every fifth changes when they are given in pieces."""
    rng = np.random.default_rng(count)
    rows, other = rng.normal(size=(count, 3)).astype(np.float32), rng.normal(size=3).astype(np.float32)
    whole = dot_rows(rows, other)
    assert whole.dtype == np.float32
    np.testing.assert_allclose(whole, rows.astype(np.float64) @ other, rtol=0, atol=2e-6)
    for piece in (1, 192, 768, 3072):
        parts = [dot_rows(rows[k : k + piece], other) for k in range(0, min(count, 40 * piece), piece)]
        assert np.concatenate(parts).tobytes() == whole[: sum(map(len, parts))].tobytes()


def one_vertex_at_a_time(triangles: np.ndarray, crease: float) -> np.ndarray:
    """Shading normals as `corner_normals` defines them."""
    area = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    face = area / np.linalg.norm(area, axis=1, keepdims=True)
    _, inverse = np.unique(np.round(triangles.reshape(-1, 3) * 1e5).astype(np.int64), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    order = np.argsort(inverse, kind="stable")
    out = np.repeat(face, 3, axis=0)
    owner = np.repeat(np.arange(len(triangles)), 3)
    for first, last in pairwise(np.searchsorted(inverse[order], np.arange(inverse.max() + 2))):
        faces = owner[order[first:last]]
        if len(faces) > 1:
            near = face[faces] @ face[faces].T >= np.cos(np.radians(crease)) - 1e-6
            out[order[first:last]] = near.astype(float) @ area[faces]
    return (out / np.linalg.norm(out, axis=1, keepdims=True)).reshape(-1, 3, 3)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box((0.3, 1.1, 0.7)),
        trimesh.creation.uv_sphere(0.37, count=[12, 20]),
        trimesh.creation.cylinder(0.13, 0.9, sections=33),
        trimesh.creation.torus(0.4, 0.07, 24, 10),
    ],
    ids=["box", "sphere", "cylinder", "torus"],
)
@pytest.mark.parametrize("crease", [20.0, 40.0])
def test_normals_of_all_vertices_at_once_are_those_of_one_at_a_time(mesh: trimesh.Trimesh, crease: float) -> None:
    triangles = np.array(mesh.triangles) + [0.123, 0.0, 4.56]
    assert corner_normals(triangles, crease).tobytes() == one_vertex_at_a_time(triangles, crease).tobytes()
