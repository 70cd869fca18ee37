"""Rays on CUDA: the traversal, compiled for the CPU, against Embree; the kernels in numba's simulator."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from generators.core.bvh import STACK
from generators.core.device_rays import FAR, build_tree, first_hit
from generators.core.jit import njit
from generators.core.rays import Tracer

F32 = np.float32


@njit
def _trace(boxes, children, corners, origins, directions, far, any_hit, place, distance, weights):
    stack, entries = np.empty(STACK, dtype=np.int32), np.empty(STACK, dtype=np.float32)
    for i in range(len(directions)):
        place[i], distance[i], weights[i, 0], weights[i, 1] = first_hit(
            boxes, children, corners, origins[i, 0], origins[i, 1], origins[i, 2],
            directions[i, 0], directions[i, 1], directions[i, 2], far[i], any_hit, stack, entries,
        )  # fmt: skip


def trace(triangles, origins, directions, far=FAR, any_hit=False):
    """Face (−1 without a hit), distance and weights of the corners 1 and 2 of rays, by the device's functions."""
    tree = build_tree(triangles)
    count = len(directions)
    place, distance, weights = np.empty(count, dtype=np.int32), np.empty(count), np.empty((count, 2))
    origins, directions = np.ascontiguousarray(origins, dtype=F32), np.ascontiguousarray(directions, dtype=F32)
    limit = np.broadcast_to(np.asarray(far, dtype=F32), count).copy()
    _trace(tree.boxes, tree.children, tree.corners, origins, directions, limit, any_hit, place, distance, weights)
    return np.where(place >= 0, tree.face[place], -1), distance, weights


def soup(rng: np.random.Generator, count: int) -> np.ndarray:
    """Small triangles all over a box of 4 m."""
    middle = rng.uniform(-2, 2, (count, 1, 3))
    return (middle + rng.normal(0, 0.25, (count, 3, 3))).astype(F32)


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), count=st.sampled_from([1, 2, 3, 9, 60, 800]))
def test_first_hits_are_embrees(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = soup(rng, count)
    origins, directions = rng.uniform(-3, 3, (400, 3)).astype(F32), rng.normal(size=(400, 3)).astype(F32)
    face, distance, weights = trace(triangles, origins, directions)
    hit = Tracer(triangles).intersect(origins, directions)
    # A ray through an edge to within float32's rounding may count as a hit for one of them only.
    rim = np.minimum(np.minimum(hit["u"], hit["v"]), 1 - hit["u"] - hit["v"]) < 1e-4
    clear = (face == hit["primID"]) | ~rim
    assert (face == hit["primID"])[clear].all()
    assert (face == hit["primID"]).mean() > 0.99
    met = (face >= 0) & (face == hit["primID"])
    np.testing.assert_allclose(distance[met], hit["tfar"][met], rtol=2e-5, atol=1e-6)
    np.testing.assert_allclose(weights[met, 0], hit["u"][met], atol=2e-3)
    np.testing.assert_allclose(weights[met, 1], hit["v"][met], atol=2e-3)
    assert (distance[face < 0] == FAR).all()


@settings(max_examples=10)
@given(seed=st.integers(0, 1000))
def test_occlusion_is_a_first_hit_nearer_than_the_limit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles = soup(rng, 300)
    origins, directions = rng.uniform(-3, 3, (300, 3)), rng.normal(size=(300, 3))
    far = rng.uniform(0, 4, 300).astype(F32)
    face, distance, _ = trace(triangles, origins, directions)
    hidden = trace(triangles, origins, directions, far, any_hit=True)[0] >= 0
    assert (hidden == ((face >= 0) & (distance < far))).all()


def test_no_ray_slips_between_triangles_that_share_an_edge() -> None:
    """A closed ball of 1,280 triangles, rays from its middle through every edge's points and every corner."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=3)
    triangles = ball.triangles.astype(F32)
    ends = triangles.reshape(-1, 3, 3)
    share = np.linspace(0, 1, 33)[:, None, None, None]
    points = (1 - share) * ends + share * np.roll(ends, 1, axis=1)
    directions = points.reshape(-1, 3).astype(F32)
    face, distance, _ = trace(triangles, np.zeros_like(directions), directions)
    assert (face >= 0).all()
    np.testing.assert_allclose(distance, 1.0, atol=1e-6)


def test_rays_along_the_axes_in_the_plane_of_a_box_are_finite() -> None:
    """A zero component of the direction with the origin on a box's side: 0 · ∞ must not spread."""
    triangles = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]], dtype=F32)
    origins = np.array([[0.2, 0.2, -1], [0.0, 0.0, 2], [0.25, 0.0, 0.5], [5, 0, 0]], dtype=F32)
    directions = np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, 1]], dtype=F32)
    face, distance, _ = trace(triangles, origins, directions)
    assert face.tolist() == [0, 1, 1, -1]
    np.testing.assert_allclose(distance[:3], [1, 1, 0.5], atol=1e-7)


def test_bad_triangles_are_refused_in_one_line() -> None:
    with pytest.raises(Avs3dError, match=r"1 of 2 triangles are NaN or infinite"):
        build_tree(np.array([np.zeros((3, 3)), np.full((3, 3), np.nan)]))
    with pytest.raises(Avs3dError, match=r"shape \(0, 3, 3\), expected \(F, 3, 3\)"):
        build_tree(np.zeros((0, 3, 3)))


class _Traversal:
    """The device's traversal, compiled for the CPU, in the place of Embree."""

    calls_together = 16

    def __init__(self, triangles: np.ndarray) -> None:
        self._triangles = triangles

    def intersect(self, origins, directions, far=FAR):
        face, distance, weights = trace(self._triangles, origins, directions, far)
        weights = weights.astype(F32)
        return {"primID": face, "tfar": distance.astype(F32), "u": weights[:, 0].copy(), "v": weights[:, 1].copy()}

    def occluded(self, origins, directions, far):
        return trace(self._triangles, origins, directions, far, any_hit=True)[0] >= 0


@pytest.mark.slow
def test_light_baked_with_the_devices_rays_is_that_of_embree(monkeypatch: pytest.MonkeyPatch) -> None:
    """A room with a lamp and a table, in which no two faces lie in one place: only rounding differs."""
    from generators.assets.shapes import MeshBuilder
    from generators.lighting import bake as baking
    from tests.generators.test_light import box_room, ceiling_lamp, matte, scene_of

    table = MeshBuilder().box((0.8, 0.4, 0.6), (1.0, 0.6, 1.1), matte(0.4)).build()
    scene = scene_of(box_room(matte(0.6)).build(), ceiling_lamp(1.2, 1.0, 0.6, 2.0), table)
    expected = baking.bake(scene, quality="preview")
    monkeypatch.setattr(baking, "open_tracer", lambda triangles, device: _Traversal(triangles))
    found = baking.bake(scene, quality="preview")
    for one, other in zip(found.parts, expected.parts, strict=True):
        assert one.light is not None
        assert other.light is not None
        here, there = one.light.texels.astype(float), other.light.texels.astype(float)
        assert np.quantile(np.abs(here - there), 0.99) < 0.01 * there.mean()
        assert here.mean() == pytest.approx(there.mean(), rel=1e-3)


_PROGRAM = """
import numpy as np
from generators.core.device_rays import DeviceTracer
from generators.core.rays import Tracer, repeated

rng = np.random.default_rng(1)
triangles = (rng.uniform(-2, 2, (12, 1, 3)) + rng.normal(0, 1.5, (12, 3, 3))).astype(np.float32)
there, here = DeviceTracer(triangles), Tracer(triangles)
origins, directions = (rng.normal(size=(40, 3)).astype(np.float32) for _ in range(2))
far = rng.uniform(0, 3, 40).astype(np.float32)
for start in (origins, repeated(origins[0], 40)):
    for limit in (None, far):
        a = there.intersect(start, directions, limit)
        b = here.intersect(start, directions, limit)
        assert (a["primID"] == b["primID"]).all()
        np.testing.assert_allclose(a["tfar"], b["tfar"], rtol=1e-5)
        met = a["primID"] >= 0
        np.testing.assert_allclose(a["u"][met], b["u"][met], atol=1e-4)
        np.testing.assert_allclose(a["v"][met], b["v"][met], atol=1e-4)
    assert (there.occluded(start, directions, far) == here.occluded(start, directions, far)).all()
print("equal", int((here.intersect(origins, directions)["primID"] >= 0).sum()))
"""


def test_the_kernels_agree_with_embree_in_the_simulator() -> None:
    env = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([sys.executable, "-c", _PROGRAM], env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    word, hits = done.stdout.split()
    assert word == "equal"
    assert int(hits) > 5
