"""Geometry against closed forms, and COLMAP there and back, also through pycolmap."""

from __future__ import annotations

import contextlib
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import colmap
from avs3d_bench.formats.colmap import ColmapModel, read_model, write_model
from avs3d_bench.geometry import (
    Intrinsics,
    Pose,
    canonical,
    direction_to,
    flip_world,
    from_colmap,
    rotation_angle,
    to_colmap,
)

coordinate = st.floats(-50, 50, allow_nan=False)
points = st.tuples(coordinate, coordinate, coordinate)
quaternions = (
    st.tuples(*[st.floats(-1, 1, allow_nan=False)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple(c / math.hypot(*q) for c in q))
)
poses = st.builds(Pose, points, quaternions)


def test_the_identity_looks_down_minus_z():
    pose = Pose((0, 0, 0), (1, 0, 0, 0))
    ahead = direction_to(pose, (0, 0, -2))
    assert (ahead.azimuth, ahead.elevation, ahead.distance) == (0, 0, 2)
    assert direction_to(pose, (1, 0, -1)).azimuth == pytest.approx(45)  # right is positive
    assert direction_to(pose, (-1, 0, 0)).azimuth == pytest.approx(-90)
    assert direction_to(pose, (0, 1, -1)).elevation == pytest.approx(45)


def test_positive_yaw_turns_left_and_pitch_up():
    pose = Pose.from_yaw((0, 0, 0), math.radians(90))
    assert pose.rotation_matrix @ [0, 0, -1] == pytest.approx([-1, 0, 0])
    assert direction_to(pose, (-3, 0, 0)).azimuth == pytest.approx(0)
    up = Pose.from_yaw((0, 0, 0), 0.0, math.radians(30))
    assert direction_to(up, (0, math.tan(math.radians(30)), -1)).elevation == pytest.approx(0, abs=1e-9)


def test_projection_of_the_benchmark_camera():
    camera = Intrinsics.from_fov(1008)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((504, 504, 504, 504))
    pixels, depth = camera.project(
        Pose((0, 1.5, 0), (1, 0, 0, 0)), [[0, 1.5, -3], [1, 1.5, -2], [0, 2.0, -1], [0, 1.5, 1]]
    )
    assert pixels[0] == pytest.approx([504, 504])
    assert pixels[1] == pytest.approx([504 + 252, 504])  # right is +u
    assert pixels[2] == pytest.approx([504, 252])  # up is −v
    assert np.isnan(pixels[3]).all()
    assert depth == pytest.approx([3, 2, 1, -1])


@given(poses, st.floats(1, 1000), st.floats(1, 1000), st.floats(0.1, 50))
def test_unproject_inverts_project(pose: Pose, u: float, v: float, z: float):
    camera = Intrinsics(1000, 1000, 480.0, 520.0, 490.0, 510.0)
    world = camera.unproject(pose, [[u, v]], [z])
    pixels, depth = camera.project(pose, world)
    assert depth[0] == pytest.approx(z, rel=1e-6)
    assert pixels[0] == pytest.approx([u, v], abs=1e-4)


@pytest.mark.parametrize("rotation", [(1, 1, 0, 0), (0, 0, 0, 0), (math.nan, 0, 0, 1)])
def test_a_pose_refuses_what_is_no_rotation(rotation: Any):
    with pytest.raises(Avs3dError, match="unit quaternion"):
        Pose((0, 0, 0), rotation)


def test_colmap_world_has_y_down():
    assert flip_world([1, 2, 3]).tolist() == [1, -2, -3]
    # Identity: a camera at height 1.5 that looks along −Z (ours) looks along +Z there, its own axes are the world's.
    qvec, tvec = to_colmap(Pose((0, 1.5, 0), (1, 0, 0, 0)))
    assert qvec.tolist() == [1, 0, 0, 0]
    assert tvec == pytest.approx([0, 1.5, 0])  # camera at (0, −1.5, 0), Y down
    # Yaw left by 90° about our up axis is a right-handed turn by −90° about Y down, camera-to-world.
    qvec, _ = to_colmap(Pose.from_yaw((0, 0, 0), math.pi / 2))
    assert qvec == pytest.approx([math.cos(math.pi / 4), 0, math.sin(math.pi / 4), 0])


@given(poses, points)
def test_colmap_projects_where_we_project(pose: Pose, point: Any):
    camera = Intrinsics.from_fov(1008)
    qvec, tvec = to_colmap(pose)
    w, x, y, z = qvec
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = rotation @ flip_world(point) + tvec
    (pixel,), (depth,) = camera.project(pose, [point])
    assert seen[2] == pytest.approx(depth, abs=1e-6)
    if depth > 0.1:
        ours = [camera.fx * seen[0] / seen[2] + camera.cx, camera.fy * seen[1] / seen[2] + camera.cy]
        assert ours == pytest.approx(pixel, rel=1e-6, abs=1e-3)


@given(poses)
def test_colmap_pose_round_trip(pose: Pose):
    qvec, tvec = to_colmap(pose)
    assert qvec[0] >= 0
    assert np.linalg.norm(qvec) == pytest.approx(1)
    back = from_colmap(qvec, tvec)
    assert back.position == pytest.approx(pose.position, abs=1e-9)
    assert rotation_angle(back, pose) < 1e-5
    assert from_colmap(-qvec, tvec) == back  # q and −q are one rotation


@given(quaternions)
def test_canonical_picks_one_of_two_signs(q: Any):
    assert canonical(q).tolist() == canonical([-c for c in q]).tolist()


@given(st.floats(0.01, 179.9))
def test_rotation_angle(degrees: float):
    a, b = Pose.from_yaw((0, 0, 0), 0.3), Pose.from_yaw((0, 0, 0), 0.3 + math.radians(degrees))
    assert rotation_angle(a, b) == pytest.approx(degrees, rel=1e-6)
    assert rotation_angle(a, Pose(a.position, tuple(-c for c in a.rotation))) == 0  # type: ignore[arg-type]


def make_model(frames: int = 4, count: int = 60, seed: int = 0, noise: float = 0.0) -> ColmapModel:
    rng = np.random.default_rng(seed)
    camera = Intrinsics(640, 480, 500.0, 510.0, 320.5, 239.25)
    path = [Pose.from_yaw((0.2 * i, 1.5, 0), 0.1 * i - 0.1, 0.05) for i in range(frames)]
    xyz = rng.uniform([-1, 0.8, -5], [1.5, 2.2, -3], (count, 3))
    tracks = []
    for frame, pose in enumerate(path):
        pixels, _ = camera.project(pose, xyz)
        inside = np.flatnonzero(((pixels > 0) & (pixels < [640, 480])).all(axis=1))
        tracks += [(p, frame, *(pixels[p] + rng.normal(0, noise, 2))) for p in inside]
    table = np.array(tracks)
    rgb = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    names = [f"frame_{i:03d}.png" for i in range(frames)]
    return ColmapModel.from_poses(camera, names, path, xyz, rgb, table[:, 0], table[:, 1], table[:, 2:])


def test_model_round_trip(tmp_path: Path):
    model = make_model(noise=0.2)
    write_model(tmp_path / "sparse/0", model)
    back = read_model(tmp_path / "sparse/0")
    assert dict(back.cameras) == dict(model.cameras)
    for a, b in zip(model.images, back.images, strict=True):
        assert (a.id, a.name, a.camera) == (b.id, b.name, b.camera)
        assert b.pose.position == pytest.approx(a.pose.position, abs=1e-12)
        np.testing.assert_array_equal(a.pixels, b.pixels)
        np.testing.assert_array_equal(a.point_ids, b.point_ids)
    for name in ("ids", "positions", "colours", "errors", "offsets", "track_image", "track_index"):
        np.testing.assert_array_equal(getattr(model.points, name), getattr(back.points, name))


def test_points_carry_the_mean_error_of_their_tracks():
    model = make_model(noise=0.3)
    errors = model.reprojection_errors()
    first, last = model.points.offsets[0], model.points.offsets[1]
    assert model.points.errors[0] == pytest.approx(errors[first:last].mean())
    assert make_model().reprojection_errors().max() < 1e-9


def test_pycolmap_reads_the_model(tmp_path: Path):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap comes with the extra 'dev'")
    model = make_model(frames=6, count=200)
    write_model(tmp_path, model)
    there = pycolmap.Reconstruction(str(tmp_path))
    assert there.num_images() == 6
    assert there.num_points3D() == 200
    k = there.cameras[1]
    assert (k.model.name, k.width, k.height) == ("PINHOLE", 640, 480)
    assert k.params.tolist() == [500.0, 510.0, 320.5, 239.25]
    errors = []
    for point_id, point in there.points3D.items():
        ours = model.points.positions[point_id - 1]
        assert point.xyz.tolist() == [ours[0], -ours[1], -ours[2]]  # Y down
        assert point.color.tolist() == model.points.colours[point_id - 1].tolist()
        for element in point.track.elements:
            image = there.images[element.image_id]
            sighting = image.points2D[element.point2D_idx]
            assert sighting.point3D_id == point_id
            errors.append(np.linalg.norm(image.project_point(point.xyz) - sighting.xy))
    assert len(errors) == len(model.points.track_image) > 400
    assert max(errors) < 1e-6
    for image in model.images:
        centre = there.images[image.id].projection_center()
        assert centre == pytest.approx(flip_world(image.pose.position), abs=1e-9)


def test_we_read_what_pycolmap_writes(tmp_path: Path):
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap comes with the extra 'dev'")
    model = make_model()
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    write_model(tmp_path / "a", model)
    pycolmap.Reconstruction(str(tmp_path / "a")).write_binary(str(tmp_path / "b"))
    back = read_model(tmp_path / "b")
    assert [image.name for image in back.images] == [image.name for image in model.images]
    np.testing.assert_allclose(back.points.positions, model.points.positions, atol=1e-12)
    assert back.reprojection_errors().max() < 1e-9


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_truncated_model_names_the_file(tmp_path: Path, name: str):
    write_model(tmp_path, make_model())
    path = tmp_path / name
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(Avs3dError, match=f"{name}: truncated"):
        read_model(tmp_path)
    path.unlink()
    with pytest.raises(Avs3dError, match=f"{name}: missing"):
        read_model(tmp_path)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=100)
@given(st.data())
def test_a_damaged_model_never_crashes(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject):
    folder = tmp_path_factory.mktemp("damaged")
    write_model(folder, make_model(frames=2, count=4))
    path = folder / data.draw(st.sampled_from(["cameras.bin", "images.bin", "points3D.bin"]))
    raw = bytearray(path.read_bytes())
    raw[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
    path.write_bytes(raw)
    # Either the damage is harmless (a colour, a digit) or it is reported; nothing else may come out.
    with contextlib.suppress(Avs3dError):
        read_model(folder).reprojection_errors()


def test_lens_distortion_is_refused(tmp_path: Path):
    path = tmp_path / "cameras.bin"
    path.write_bytes(struct.pack("<QiiQQ8d", 1, 1, 4, 64, 64, 32, 32, 32, 32, 0.1, 0, 0, 0))
    with pytest.raises(Avs3dError, match="distortion"):
        colmap.read_cameras(path)
    path.write_bytes(struct.pack("<QiiQQ3d", 1, 1, 0, 64, 48, 30, 32, 24))
    assert colmap.read_cameras(path) == {1: Intrinsics(64, 48, 30, 30, 32, 24)}


def test_tracks_that_name_nothing_are_refused():
    camera, pose = Intrinsics.from_fov(64), Pose((0, 0, 0), (1, 0, 0, 0))
    with pytest.raises(Avs3dError, match="point 1 of 1"):
        ColmapModel.from_poses(camera, ["a.png"], [pose], [[0, 0, -1]], [[0, 0, 0]], [1], [0], [[32, 32]])
