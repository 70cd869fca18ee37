"""Gaussians: their start from points, their PLY files, and the views of an observation."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import plyfile
import pytest
import torch

from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import flip_world
from baselines.echosegnet import views as viewing
from baselines.echosegnet.gaussians import SH_C0, Gaussians, from_points, read_audio_intensity, read_ply, write_ply
from tests.support import tiny
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset()


def _some(count: int = 7, bands: int = 16, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, bands, 3))
    return Gaussians(*(torch.from_numpy(rng.normal(size=shape).astype(np.float32)) for shape in shapes))


# --- start from points


def test_initial_scale_is_the_rms_distance_to_the_three_nearest_others() -> None:
    rng = np.random.default_rng(1)
    xyz, rgb = rng.uniform(-2, 2, (40, 3)), rng.integers(0, 256, (40, 3), dtype=np.uint8)
    distance = np.linalg.norm(xyz[:, None] - xyz[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    expected = np.sqrt((np.sort(distance, axis=1)[:, :3] ** 2).mean(axis=1))
    gaussians = from_points(xyz, rgb)
    np.testing.assert_allclose(gaussians.scales.numpy(), np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)


def test_initial_colour_opacity_and_rotation_are_the_references() -> None:
    rgb = np.array([[0, 128, 255], [255, 0, 51], [10, 20, 30]], dtype=np.uint8)
    gaussians = from_points(np.eye(3), rgb)
    np.testing.assert_allclose((0.5 + SH_C0 * gaussians.sh[:, 0]).numpy(), rgb / 255.0, atol=1e-6)
    assert not gaussians.sh[:, 1:].any()
    assert gaussians.sh.shape == (3, 16, 3)
    np.testing.assert_allclose(gaussians.alphas.numpy(), 0.1, rtol=1e-6)
    np.testing.assert_array_equal(gaussians.rotations.numpy(), [[1, 0, 0, 0]] * 3)


def test_coincident_points_keep_a_size() -> None:
    gaussians = from_points(np.zeros((5, 3)), np.full((5, 3), 0.5))
    assert (gaussians.scales > 1e-4).all()


@pytest.mark.parametrize(
    ("xyz", "rgb", "words"),
    [
        (np.zeros((1, 3)), np.zeros((1, 3)), "1 initial points, expected at least 2"),
        (np.zeros((0, 3)), np.zeros((0, 3)), "0 initial points"),
        (np.array([[0, 0, np.nan], [1, 1, 1]]), np.zeros((2, 3)), "NaN"),
        (np.zeros((2, 3)), np.full((2, 3), np.inf), "NaN or infinite"),
        (np.zeros((2, 2)), np.zeros((2, 2)), "expected (N, 3)"),
    ],
)
def test_points_that_cannot_start_are_named(xyz: np.ndarray, rgb: np.ndarray, words: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        from_points(xyz, rgb)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


# --- the record


def test_select_takes_a_mask_or_indices_in_order() -> None:
    gaussians = _some()
    by_mask = gaussians.select(np.array([True, False, True, False, False, False, False]))
    np.testing.assert_array_equal(by_mask.means.numpy(), gaussians.means[[0, 2]].numpy())
    by_index = gaussians.select(torch.tensor([5, 1]))
    np.testing.assert_array_equal(by_index.sh.numpy(), gaussians.sh[[5, 1]].numpy())
    assert len(gaussians.select(torch.zeros(7, dtype=torch.bool))) == 0


def test_tensors_that_do_not_fit_together_are_named() -> None:
    good = _some()
    with pytest.raises(Avs3dError, match=r"rotations has shape \(6, 4\), expected \(7, 4\)"):
        Gaussians(good.means, good.log_scales, good.rotations[:6], good.opacities, good.sh)
    with pytest.raises(Avs3dError, match="5 spherical harmonics"):
        Gaussians(good.means, good.log_scales, good.rotations, good.opacities, good.sh[:, :5])


# --- PLY


@pytest.mark.parametrize("bands", [1, 4, 9, 16])
def test_ply_round_trip_is_exact(tmp_path: Path, bands: int) -> None:
    gaussians = _some(bands=bands)
    write_ply(tmp_path / "a.ply", gaussians)
    back = read_ply(tmp_path / "a.ply")
    for name in ("means", "log_scales", "rotations", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(back, name).numpy(), getattr(gaussians, name).numpy())
    assert read_audio_intensity(tmp_path / "a.ply") is None


def test_ply_has_the_reference_layout_for_another_reader(tmp_path: Path) -> None:
    gaussians, intensity = _some(), np.linspace(0, 1, 7)
    write_ply(tmp_path / "a.ply", gaussians, intensity)
    (vertex,) = plyfile.PlyData.read(str(tmp_path / "a.ply")).elements
    names = [p.name for p in vertex.properties]
    assert names == [
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"), *(f"f_rest_{i}" for i in range(45)),
        *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "audio_intensity"),
    ]  # fmt: skip
    assert {p.val_dtype for p in vertex.properties} == {"f4"}
    np.testing.assert_array_equal(vertex["y"], gaussians.means[:, 1])
    np.testing.assert_array_equal(vertex["f_dc_2"], gaussians.sh[:, 0, 2])
    # Channel-major: the fifteen upper bands of red come first, then green's, then blue's.
    np.testing.assert_array_equal(vertex["f_rest_3"], gaussians.sh[:, 4, 0])
    np.testing.assert_array_equal(vertex["f_rest_15"], gaussians.sh[:, 1, 1])
    np.testing.assert_array_equal(vertex["f_rest_44"], gaussians.sh[:, 15, 2])
    np.testing.assert_array_equal(vertex["rot_0"], gaussians.rotations[:, 0])
    np.testing.assert_allclose(vertex["audio_intensity"], intensity, rtol=1e-6)
    np.testing.assert_allclose(read_audio_intensity(tmp_path / "a.ply"), intensity, rtol=1e-6)


def test_ply_of_another_writer_is_read(tmp_path: Path) -> None:
    gaussians = _some(bands=4)
    write_ply(tmp_path / "a.ply", gaussians)
    plyfile.PlyData.read(str(tmp_path / "a.ply")).write(str(tmp_path / "b.ply"))
    np.testing.assert_array_equal(read_ply(tmp_path / "b.ply").sh.numpy(), gaussians.sh.numpy())


def test_ply_bytes_are_stable(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_ply(tmp_path / name, _some())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_ply_faults_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, _some())
    whole = path.read_bytes()
    for content, words in (
        (b"", "expected Gaussians"),
        (whole[:-3], "regenerate it"),
        (whole.replace(b"property float opacity\n", b"property float opacify\n"), "no property opacity"),
        (whole.replace(b"float opacity", b"uchar opacity"), "float properties only"),
        (whole[:-4] + np.float32(np.nan).tobytes(), "NaN"),
    ):
        path.write_bytes(content)
        with pytest.raises(Avs3dError, match=words):
            read_ply(path)
    with pytest.raises(Avs3dError, match="missing"):
        read_ply(tmp_path / "none.ply")
    bad = _some()
    bad.log_scales[3, 1] = float("nan")
    with pytest.raises(Avs3dError, match="scale_1 holds NaN"):
        write_ply(path, bad)
    with pytest.raises(Avs3dError, match="audio_intensity has shape"):
        write_ply(path, _some(), np.zeros(3))


# --- views


def test_views_are_the_registered_frames_with_their_opencv_poses(root: Path) -> None:
    observation = Dataset(root)[tiny.SINGLE]
    views = viewing.load_views(observation)
    assert [view.name for view in views] == sorted(frame.name for frame in observation.frames)
    assert [view.name for view in viewing.test_views(views)] == ["frame_000", "frame_008"]
    assert len(viewing.train_views(views)) == len(views) - 2
    point = np.array([[0.1, 1.2, -2.4]])  # Y up
    for view in views:
        assert view.frame.name == view.name
        x, y, z = view.world_to_camera[:3, :3] @ flip_world(point)[0] + view.world_to_camera[:3, 3]
        (pixel,), (depth,) = view.camera.project(view.frame.pose, point)
        assert z == pytest.approx(depth, abs=1e-7)  # JSON keeps nine digits
        if z > 0:
            found = (view.camera.fx * x / z + view.camera.cx, view.camera.fy * y / z + view.camera.cy)
            np.testing.assert_allclose(found, pixel, atol=1e-6)


def test_poses_come_from_sparse_not_from_the_record(tmp_path: Path, root: Path) -> None:
    target = tiny.clone(root, tmp_path / "copy")

    def lie(record: dict) -> None:
        for frame in record["frames"]:
            frame["position"] = [0.0, 0.0, 0.0]

    tiny.edit_record(target, tiny.SINGLE, lie)
    honest, lied = (viewing.load_views(Dataset(path)[tiny.SINGLE]) for path in (root, target))
    for a, b in zip(honest, lied, strict=True):
        np.testing.assert_array_equal(a.position, b.position)


def test_frames_without_registration_or_split_are_no_views(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    observation = Dataset(root)[tiny.SINGLE]
    splits = {name: split for name, split in observation.splits.items() if name != "frame_003"}
    monkeypatch.setitem(observation.__dict__, "splits", splits)
    assert "frame_003" not in {view.name for view in viewing.load_views(observation)}


def test_points_are_in_the_y_down_world(root: Path) -> None:
    observation = Dataset(root)[tiny.SINGLE]
    xyz, rgb = viewing.load_points(observation)
    np.testing.assert_array_equal(xyz, flip_world(observation.colmap.points.positions))
    assert rgb.dtype == np.uint8
    assert xyz[:, 1].max() <= 1e-6  # nothing below the floor


def test_extent_is_the_references(root: Path) -> None:
    views = viewing.load_views(Dataset(root)[tiny.SINGLE])
    assert viewing.camera_extent(views) == pytest.approx(1.1 * 1.8, rel=0.02)
    assert viewing.camera_extent(views[:1]) == 1.0


def test_missing_sparse_model_and_points_are_named(tmp_path: Path, root: Path) -> None:
    shutil.copytree(root, tmp_path / "copy")
    observation = Observation(tmp_path / "copy", tiny.SINGLE)
    (observation.path / "sparse/0/points3D.bin").write_bytes(np.uint64(0).tobytes())
    with pytest.raises(Avs3dError, match="no points"):
        viewing.load_points(observation)
    shutil.rmtree(observation.path / "sparse")
    for load in (viewing.load_views, viewing.load_points):
        with pytest.raises(Avs3dError, match=r"sparse/0: missing; EchoSegnet needs the sparse model"):
            load(Observation(tmp_path / "copy", tiny.SINGLE))
