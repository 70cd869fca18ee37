"""`RayCaster`: closest hits and occlusion, against closed forms."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.assets.shapes import MeshBuilder
from generators.core import rays
from generators.core.rays import RayCaster, Tracer
from generators.core.scene import Material, Part, Scene

GREY = Material("grey", "plaster")


def _scene() -> Scene:
    near = MeshBuilder().sphere(0.5, (0, 0, -2), GREY, rings=64, segments=128).build()
    wall = MeshBuilder().quad([[-5, -5, -4], [5, -5, -4], [5, 5, -4], [-5, 5, -4]], GREY).build()
    return Scene("two", (Part("wall", wall), Part("ball", near, instance_id=1)), (), ())


def test_closest_measures_in_lengths_of_the_direction_and_numbers_faces_through_the_parts() -> None:
    caster = RayCaster(_scene())
    distance, face = caster.closest((0, 0, 0), [[0, 0, -1], [0, 0, -2], [1, 0, -1], [0, 0, 1]])
    np.testing.assert_allclose(distance, [1.5, 0.75, 4.0, np.inf], atol=1e-3)
    assert face[3] == -1
    assert caster.face_part[face[:3]].tolist() == [1, 1, 0]
    assert caster.first_face[1] == 2
    assert distance.dtype == np.float32
    assert face.dtype == np.int32


def test_occluded_stops_at_the_distance() -> None:
    caster = RayCaster(_scene())
    ray = [[0, 0, -1]] * 3
    assert caster.occluded((0, 0, 0), ray, [1.4, 1.6, np.inf]).tolist() == [False, True, True]
    assert caster.occluded([[0, 0, -1.4]], [[0, 0, 1]]).tolist() == [False]


def test_what_was_built_last_is_found_again_for_equal_triangles_alone() -> None:
    near = np.array([[[-1.0, -1.0, -1.0], [3.0, -1.0, -1.0], [-1.0, 3.0, -1.0]]])
    triangles = [near, near.copy(), near * 2, near]
    found = [RayCaster(each).closest([0.0, 0.0, 0.0], [[0.0, 0.0, -1.0]])[0][0] for each in triangles]
    # Embree's last bit depends on the vector unit of the processor.
    np.testing.assert_allclose(found, [1.0, 1.0, 2.0, 1.0], rtol=1e-6)


def test_a_query_leaves_its_limits_as_they_were() -> None:
    tracer = Tracer(_scene().parts[0].mesh.positions)
    origins, directions = np.zeros((2, 3), dtype=np.float32), np.array([[0, 0, -1], [0, 0, 1]], dtype=np.float32)
    far = np.full(2, 5, dtype=np.float32)
    assert tracer.intersect(origins, directions, far)["tfar"].tolist() == [4, 5]
    assert tracer.occluded(origins, directions, far).tolist() == [True, False]
    assert far.tolist() == [5, 5]


def test_any_chunking_gives_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    caster = RayCaster(_scene())
    directions = np.random.default_rng(3).normal(size=(1000, 3))
    whole = caster.closest((0, 0, 0), directions)
    blocked = caster.occluded((0, 0, 0), directions, 3.0)
    monkeypatch.setattr(rays, "CHUNK", 7)
    for expected, found in zip(whole, caster.closest((0, 0, 0), directions), strict=True):
        assert expected.tobytes() == found.tobytes()
    assert np.array_equal(blocked, caster.occluded((0, 0, 0), directions, 3.0))
    assert np.array_equal(blocked, whole[0] < 3.0)


def test_no_ray_slips_between_triangles_that_share_an_edge() -> None:
    box = MeshBuilder().box((2, 2, 2), (0, 0, 0), GREY, bevel=0.3, segments=4).build()
    directions = np.random.default_rng(5).normal(size=(20000, 3))
    corners = box.positions.reshape(-1, 3)
    along_edges = (box.positions + np.roll(box.positions, 1, axis=1)).reshape(-1, 3)
    _, face = RayCaster(box.positions).closest((0, 0, 0), np.concatenate([directions, corners, along_edges]))
    assert (face >= 0).all()


@pytest.mark.parametrize(
    ("origins", "directions", "message"),
    [
        ((0, 0, np.nan), [[0, 0, 1]], "not finite"),
        ((0, 0, 0), [[0, 0, np.inf]], "not finite"),
        ((0, 0, 0), [[0, 0, 0]], "length 0"),
        ((0, 0, 0), [0, 0, 1], "shape"),
        (np.zeros((2, 3)), [[0, 0, 1]], "shape"),
    ],
)
def test_bad_rays_are_refused_in_one_line(origins: object, directions: object, message: str) -> None:
    with pytest.raises(Avs3dError, match=message) as caught:
        RayCaster(_scene()).closest(origins, directions)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_bad_triangles_are_refused() -> None:
    with pytest.raises(Avs3dError, match="no parts"):
        RayCaster(Scene("empty", (), (), ()))
    with pytest.raises(Avs3dError, match="shape"):
        RayCaster(np.zeros((0, 3, 3)))
    with pytest.raises(Avs3dError, match="1 of 2 triangles are not finite"):
        RayCaster(np.stack([np.eye(3), np.full((3, 3), np.nan)]))


def test_an_empty_list_of_rays_is_fine() -> None:
    distance, face = RayCaster(_scene()).closest((0, 0, 0), np.zeros((0, 3)))
    assert distance.shape == face.shape == (0,)


_COUNTED = """
import os
import numpy as np
from generators.core.rays import Tracer

cores, before = os.sched_getaffinity(0), len(os.listdir("/proc/self/task"))
Tracer(np.random.default_rng(0).normal(size=(20_000, 3, 3)).astype(np.float32))
print(len(os.listdir("/proc/self/task")) - before, os.sched_getaffinity(0) == cores)
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc, which Linux has")
def test_a_tracer_begins_no_thread_and_leaves_the_process_its_cores() -> None:
    variables = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found = subprocess.run([sys.executable, "-c", _COUNTED], capture_output=True, text=True, check=True, env=variables)
    assert found.stdout.split() == ["0", "True"]
