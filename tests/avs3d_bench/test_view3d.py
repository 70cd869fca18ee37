"""`avs3d view-3d`: the collected geometry, its position, and the contents of a recording."""

from __future__ import annotations

import io
import math
import re
import socket
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import SubmissionRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.geometry import Pose
from avs3d_bench.inspector.floorplan import EYES, HEAD
from avs3d_bench.inspector.view3d import room_note, save_view, scene_title
from avs3d_bench.inspector.view3d_data import MOST_PREDICTED, moved_from, read_prediction, read_scene
from avs3d_bench.inspector.view3d_stage import PREDICTED, box_edges, legend, opencv_rotation, textured_glb
from avs3d_bench.inspector.view3d_surfaces import BELOW_FLOOR, LONGEST, MOST_FRAMES, Patches, VisibleSurface
from tests.support.browser import launch, visit
from tests.support.shared import SharedDataset
from tests.support.tiny import MULTI, SINGLE, edit_record, write_dataset, write_release

FRAMES = 9


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=FRAMES, size=48, extras=True)


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("submission")
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    media.write_ply_points(folder / SINGLE / layout.SUBMISSION_POINTS, points)
    media.write_json(folder / "submission.json", SubmissionRecord(method="mine", dataset="tiny", dataset_version="1"))
    return folder


def viser() -> object:
    return pytest.importorskip("viser", reason="the package viser is not installed: pip install 'avs3d-bench[inspect]'")


# ------------------------------------------------------------------------------------------------------ what is shown


def test_the_picture_of_a_scan_from_above_lies_on_its_floor(tmp_path: Path) -> None:
    write_dataset(tmp_path / "data", frames=FRAMES)
    observation = Dataset(tmp_path / "data")[SINGLE]
    floor = min(frame.pose.position[1] for frame in observation.frames) - EYES
    assert all(surface.name != "floor" for surface in read_scene(observation).surfaces)
    # 4 m × 2 m, whose right quarter is unknown.
    rgb = np.zeros((40, 80, 3), dtype=np.uint8)
    rgb[:, :60] = (200, 40, 0)
    media.write_png_rgb(observation.path / layout.TOP_VIEW, rgb)
    area = {"left": -1.0, "top": 2.0, "width": 4.0, "height": 2.0}
    edit_record(tmp_path / "data", SINGLE, lambda record: record.update(top_view=area))
    surface = read_scene(Dataset(tmp_path / "data")[SINGLE]).surfaces[-1]
    assert surface.name == "floor"
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    assert (low[0], high[0], low[2], high[2]) == pytest.approx((-1.0, 2.0, 2.0, 4.0), abs=1e-6)
    assert (low[1], high[1]) == pytest.approx((floor - BELOW_FLOOR,) * 2, abs=1e-6)
    # The picture is not mirrored: its left side is at the lowest x, its upper side at the lowest z.
    assert np.allclose(surface.pixels[:, 0] * 4.0 - 1.0, surface.vertices[:, 0], atol=1e-6)
    assert np.allclose(surface.pixels[:, 1] * 2.0 + 2.0, surface.vertices[:, 2], atol=1e-6)
    # Faces look upwards, and none shows what is unknown.
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()
    assert surface.pixels[:, 0].max() <= 0.75 + 1e-6


def test_points_of_depth_lie_on_the_walls_and_boxes(root: Path) -> None:
    scene = read_scene(Dataset(root)[SINGLE])
    assert scene.dense is not None
    points = scene.dense.points
    assert len(points) > 1000
    low, high = np.array([-3.0, 0.0, -4.0]), np.array([3.0, 2.6, 3.0])
    wall = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1)
    boxes = [np.array([instance.bounds[0], instance.bounds[1]]) for instance in scene.instances]
    outside = [np.linalg.norm(np.maximum(np.maximum(b[0] - points, points - b[1]), 0), axis=1) for b in boxes]
    # Depth is whole millimetres along the axis, hence up to a few millimetres across it.
    assert np.min([wall, *outside], axis=0).max() < 0.005


@pytest.fixture(scope="module")
def dotted(shared_dataset: SharedDataset) -> Path:
    """A dataset with many sparse points."""
    return shared_dataset(frames=FRAMES, size=96, points=24, keys=(SINGLE,))


def corners_of(surfaces: tuple[VisibleSurface, ...]) -> NDArray[np.float64]:
    return np.concatenate([surface.vertices[surface.faces] for surface in surfaces]).astype(float)


def test_surfaces_lie_on_the_walls_and_boxes_and_cover_the_points(dotted: Path) -> None:
    scene = read_scene(Dataset(dotted)[SINGLE])
    assert 1 < len(scene.surfaces) <= MOST_FRAMES
    room, boxes = (np.array([-3.0, 0.0, -4.0]), np.array([3.0, 2.6, 3.0])), [i.bounds for i in scene.instances]
    corners = corners_of(scene.surfaces)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    # All three corners of a shard between two surfaces do not lie on one of them.
    off = np.minimum(np.abs(corners - room[0]), np.abs(corners - room[1])).max(axis=1).min(axis=1)
    for low, high in boxes:
        beside = np.linalg.norm(np.maximum(np.maximum(low - corners, corners - high), 0), axis=2).max(axis=1)
        off = np.minimum(off, beside)
    assert area[off < 0.07].sum() > 0.97 * area.sum()
    middles = np.concatenate([surface.vertices.reshape(-1, 4, 3).mean(axis=1) for surface in scene.surfaces])
    away, _ = KDTree(middles).query(scene.room.points)
    assert (away < LONGEST).mean() > 0.95
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    assert sides.max() <= 2 * LONGEST * math.sqrt(2) + 1e-5


def test_walls_end_in_a_straight_edge_below_the_ceiling(dotted: Path) -> None:
    scene = read_scene(Dataset(dotted)[SINGLE])
    top = min(moment.pose.position[1] for moment in scene.frames) + HEAD
    heights = np.concatenate([surface.vertices[:, 1] for surface in scene.surfaces])
    assert heights.max() == pytest.approx(top, abs=0.02)
    assert (np.abs(heights - top) < 1e-4).sum() > 20


def grid(step: float = 0.05) -> NDArray[np.float64]:
    x, z = np.meshgrid(np.arange(0, 1.01, step), np.arange(0, 1.01, step))
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)


def test_patches_of_a_table_and_the_floor_below_it_span_no_gap_between_them() -> None:
    floor, table = grid(), grid() * (0.4, 1, 0.4) + (0.3, 0.7, 0.3)
    points = np.concatenate([floor, table])
    patches = Patches.around(points)
    assert (np.abs(patches.normals[:, 1]) > 0.999).all()
    corners = patches.corners(np.arange(len(points)), np.array([0.5, 3.0, 0.5]), top=9.0)
    assert np.ptp(corners[..., 1], axis=1).max() < 1e-6, "each lies at the height of the floor or of the table"
    assert corners[len(floor) :, :, [0, 2]].min() > 0.3 - 0.07, "and ends where its surface ends"
    assert corners[len(floor) :, :, [0, 2]].max() < 0.7 + 0.07
    # The floor is covered without holes.
    spots = np.random.default_rng(0).uniform(0, 1, (400, 2))
    low, high = corners[: len(floor), :, [0, 2]].min(axis=1), corners[: len(floor), :, [0, 2]].max(axis=1)
    assert all(((low <= spot) & (spot <= high)).all(axis=1).any() for spot in spots)


def test_patches_turn_counter_clockwise_towards_the_camera_and_end_at_a_height() -> None:
    wall = grid()[:, [0, 2, 1]]  # x and y from 0 to 1, z = 0
    patches = Patches.around(wall)
    for side in (1.0, -1.0):
        camera = np.array([0.5, 0.5, side])
        corners = patches.corners(np.flatnonzero(wall[:, 1] <= 0.8), camera, top=0.8)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (normals[:, 2] * side >= -1e-12).all()
        assert (normals[:, 2] * side > 0).any()
        assert corners[..., 1].max() == pytest.approx(0.8)


def test_surfaces_face_their_camera_and_have_its_colours(dotted: Path) -> None:
    observation = Dataset(dotted)[SINGLE]
    points = observation.colmap.points
    nearest = KDTree(points.positions)
    right = total = 0
    for surface in read_scene(observation).surfaces:
        frame = next(f for f in observation.frames if f.name == surface.name)
        corners = surface.vertices[surface.faces].astype(float)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        towards = np.asarray(frame.pose.position) - corners.mean(axis=1)
        assert ((normal * towards).sum(axis=1) >= -1e-9).all()
        assert (surface.picture == frame.undistorted_rgb()).all(), "small pictures stay as they are"
        # In the middle of a patch, about where its point is, the picture has the colour of the point.
        middle, place = (v.reshape(-1, 4, v.shape[1]).mean(axis=1) for v in (surface.vertices, surface.pixels))
        away, row = nearest.query(middle)
        column, line = np.minimum(np.floor(place * 96).astype(int), 95).T
        near = away < 0.03
        known = points.colours[row].astype(int)
        error = np.abs(surface.picture[line, column].astype(int) - known).max(axis=1)
        right += int((error[near] < 40).sum())
        total += int(near.sum())
    assert total > 500
    assert right > 0.95 * total


def test_a_textured_surface_is_read_as_it_was(dotted: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="the package trimesh is not installed")
    surface = read_scene(Dataset(dotted)[SINGLE]).surfaces[0]
    data = textured_glb(surface)
    assert textured_glb(surface) == data
    (mesh,) = trimesh.load(io.BytesIO(data), file_type="glb").geometry.values()
    assert mesh.vertices == pytest.approx(surface.vertices)
    assert (mesh.faces == surface.faces).all()
    # trimesh counts v from the bottom of the picture, glTF from the top.
    assert mesh.visual.uv == pytest.approx(surface.pixels * (1, -1) + (0, 1), abs=1e-6)
    assert (np.asarray(mesh.visual.material.emissiveTexture.convert("RGB")) == surface.picture).all()


@pytest.mark.parametrize("count", [0, 1, 2, 30])
def test_few_points_and_points_on_a_line_make_small_squares_that_face_the_camera(count: int) -> None:
    line = np.stack([np.linspace(0, 1, count), np.zeros(count), np.zeros(count)], axis=1)
    patches = Patches.around(line)
    corners = patches.corners(np.arange(count), np.array([0.5, 0.0, 2.0]), top=5.0)
    assert corners.shape == (count, 4, 3)
    assert np.isfinite(corners).all()
    if count:
        assert np.abs(corners - line[:, None]).max() < 0.2


def test_the_ceiling_is_apart(root: Path) -> None:
    scene = read_scene(Dataset(root)[SINGLE])
    eyes = min(moment.pose.position[1] for moment in scene.frames)
    assert scene.room.points[:, 1].max() <= eyes + 0.4 < scene.ceiling.points[:, 1].min()
    assert len(scene.room.points) + len(scene.ceiling.points) == len(Dataset(root)[SINGLE].colmap.points.ids)


def test_without_depth_and_without_records(tmp_path: Path) -> None:
    scene = read_scene(Dataset(write_release(tmp_path, frames=3, size=48))[MULTI])
    assert (scene.dense, scene.mesh, scene.instances, scene.category) == (None, None, (), None)
    assert [moment.sources for moment in scene.frames] == [{}] * 3
    assert scene.vertical_fov == pytest.approx(math.pi / 2)
    assert scene.frames[1].caption == "frame_001 · train"


def test_a_moving_object_is_where_the_record_says(root: Path, tmp_path: Path) -> None:
    moving = write_dataset(tmp_path / "d", frames=3, size=32)
    turn = Pose.from_yaw((0.0, 0.0, 0.0), 0.5).rotation

    def change(data: dict) -> None:
        data["source_motion"] = "path"
        for i, frame in enumerate(data["frames"]):
            frame["source_position"] = [0.1 * i, 1.0, -2.0]
            frame["instance_position"] = [0.1 * i, 1.0, -2.0]
            frame["instance_rotation"] = list(turn)

    edit_record(moving, SINGLE, change)
    observation = Dataset(moving)[SINGLE]
    scene = read_scene(observation)
    (number,) = scene.moving
    assert scene.mesh is not None
    for frame, moment in zip(observation.frames, scene.frames, strict=True):
        moved = moment.moved[number]
        shown = scene.mesh.vertices @ moved.rotation_matrix.T + np.array(moved.position)
        assert shown == pytest.approx(frame.mesh().vertices, abs=1e-5)
        assert moment.sources["source_1"] == pytest.approx((0.1 * moment.frame.index, 1.0, -2.0))
    assert read_scene(Dataset(root)[SINGLE]).frames[3].moved == {}


def test_moved_from_is_now_after_undoing_first() -> None:
    first, now = Pose.from_yaw((1.0, 2.0, 3.0), 0.3), Pose.from_yaw((-1.0, 0.5, 2.0), -1.2, 0.4)
    local = np.random.default_rng(1).normal(size=(5, 3))
    before, after = (local @ pose.rotation_matrix.T + np.array(pose.position) for pose in (first, now))
    moved = moved_from(first, now)
    assert before @ moved.rotation_matrix.T + np.array(moved.position) == pytest.approx(after)


def test_predicted_points(submission: Path, tmp_path: Path) -> None:
    found = read_prediction(submission, SINGLE)
    assert (found.method, len(found.points)) == ("mine", 500)
    with pytest.raises(UsageError, match=r"points\.ply: missing; expected a submission with 3D points of part_2/"):
        read_prediction(submission, MULTI)
    with pytest.raises(UsageError, match="no such folder"):
        read_prediction(tmp_path / "none", SINGLE)
    media.write_ply_points(tmp_path / SINGLE / layout.SUBMISSION_POINTS, np.zeros((MOST_PREDICTED + 1, 3)))
    assert len(read_prediction(tmp_path, SINGLE).points) <= MOST_PREDICTED
    media.write_ply_points(tmp_path / SINGLE / layout.SUBMISSION_POINTS, np.full((3, 3), 1e6))
    with pytest.raises(Avs3dError, match="expected world coordinates in metres"):
        read_prediction(tmp_path, SINGLE)


def test_cameras_look_along_plus_z_with_y_down() -> None:
    pose = Pose.from_yaw((0.0, 0.0, 0.0), 0.7, 0.2)
    ours, theirs = pose.rotation_matrix, Pose((0.0, 0.0, 0.0), opencv_rotation(pose)).rotation_matrix
    assert theirs == pytest.approx(ours @ np.diag([1.0, -1.0, -1.0]))


def test_a_box_has_twelve_edges_each_once() -> None:
    edges = box_edges(np.array([0, 0, 0], np.float32), np.array([1, 2, 3], np.float32))
    lengths = sorted(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).tolist())
    assert lengths == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    assert len({tuple(map(tuple, edge.tolist())) for edge in edges}) == 12


# ---------------------------------------------------------------------------------------------------------- recordings


@pytest.fixture(scope="module")
def recording(root: Path, submission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    viser()
    return save_view(Dataset(root), SINGLE, tmp_path_factory.mktemp("saved") / "v.html", [submission])


def contents(path: Path) -> dict:
    """What a .viser file holds: eight bytes of length, then zstd of (length, msgpack, buffers)."""
    import msgspec
    import zstandard

    inner = zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes()[8:])
    length = int.from_bytes(inner[:8], "little")
    return msgspec.msgpack.decode(inner[8 : 8 + length])


def test_a_recording_holds_all_that_is_to_be_seen(root: Path, submission: Path, tmp_path: Path) -> None:
    viser()
    data = contents(save_view(Dataset(root), SINGLE, tmp_path / "v.viser", [submission]))
    nodes = {message["name"] for _, message in data["messages"] if "name" in message}
    assert any(name.startswith("/room/surfaces/frame_") for name in nodes)
    assert {"/room/dense", "/room/sparse", "/object/mesh", "/source", "/predicted/0", "/now/camera"} <= nodes
    assert {f"/path/frame_{i:03d}" for i in range(FRAMES)} <= nodes
    assert {"/instances/1/box", "/instances/2/box"} <= nodes
    texts = {message["props"]["text"] for _, message in data["messages"] if "text" in message.get("props", {})}
    assert texts == {"microwave (sounding)", "oven"}
    assert data["durationSeconds"] == pytest.approx(0.4 * FRAMES)
    # The camera goes along the path as the recording plays.
    spots = [
        (at, message["position"])
        for at, message in data["messages"]
        if message["type"] == "SetPositionMessage" and message["name"] == "/now/camera"
    ]
    poses = [frame.pose.position for frame in Dataset(root)[SINGLE].frames]
    for at, spot in spots:
        assert spot == pytest.approx(poses[round(at / 0.4)], abs=1e-6)
    assert len({round(at / 0.4) for at, _ in spots}) >= FRAMES - 1


def test_a_recording_has_a_title_and_a_legend(root: Path, submission: Path, recording: Path) -> None:
    scene = read_scene(Dataset(root)[SINGLE], [submission])
    page = recording.read_text(encoding="utf-8")
    assert re.findall(r"<title>([^<]*)</title>", page) == [scene_title(scene)] == [f"Microwave · {SINGLE}"]
    panel = page[page.rindex("<details open") : page.rindex("</details>")]
    assert [text for _, text in legend(scene)] == re.findall(r"</i>([^<]*)</li>", panel)
    assert [text for _, text in legend(scene)] == [
        "microwave (sounding)", "silent objects", "predicted: mine", "camera now", "path", "test cameras",
    ]  # fmt: skip
    assert f"rgb{PREDICTED[0]}" in panel, "in the colour of its points"


def test_text_of_others_in_the_legend_is_text(root: Path, tmp_path: Path) -> None:
    viser()
    folder = tmp_path / "s"
    media.write_ply_points(folder / SINGLE / layout.SUBMISSION_POINTS, np.zeros((3, 3)))
    record = SubmissionRecord(method="<script>bad()</script>", dataset="tiny", dataset_version="1")
    media.write_json(folder / "submission.json", record)
    page = save_view(Dataset(root), SINGLE, tmp_path / "v.html", [folder]).read_text(encoding="utf-8")
    assert "<script>bad" not in page
    assert "&lt;script&gt;bad()" in page


def test_same_bytes_twice(root: Path, submission: Path, recording: Path, tmp_path: Path) -> None:
    again = save_view(Dataset(root), SINGLE, tmp_path / "v.html", [submission])
    assert again.read_bytes() == recording.read_bytes()


@pytest.mark.slow
def test_the_page_opens_from_disk_without_a_network(recording: Path) -> None:
    with launch() as browser, visit(browser, recording, width=640) as opened:
        opened.page.wait_for_selector("canvas", timeout=20_000)
        opened.page.wait_for_timeout(1500)
        assert opened.page.title() == f"Microwave · {SINGLE}"
        assert opened.page.is_visible("details li")
        assert not [address for address in opened.asked if not address.startswith("blob:")]
        said = " ".join(opened.said)
        assert "Embedded data loaded" in said
        assert not re.search(r"Uncaught|TypeError|ReferenceError", said)


def test_wrong_use_is_told_in_one_line_and_leaves_nothing(root: Path, tmp_path: Path) -> None:
    viser()
    dataset = Dataset(root)
    with pytest.raises(UsageError, match=r"expected a name that ends with \.html"):
        save_view(dataset, SINGLE, tmp_path / "v.rrd")
    with pytest.raises(UsageError, match="no observation"):
        save_view(dataset, "part_1/tiny/kitchen/9", tmp_path / "v.html")
    with pytest.raises(UsageError, match="no such folder"):
        save_view(dataset, SINGLE, tmp_path / "v.html", [tmp_path / "none"])
    assert not list(tmp_path.iterdir())


def test_without_the_package_the_line_says_what_to_install(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(Avs3dError, match=r"viser is not installed.*pip install 'avs3d-bench\[inspect\]'"):
        save_view(Dataset(root), SINGLE, tmp_path / "v.html")
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------------------------------------------------- serving


def command(root: Path, *options: str) -> list[str]:
    code = "from avs3d_bench.cli import run; from avs3d_bench.inspector.media_cli import view_3d; run(view_3d)"
    return [sys.executable, "-c", code, SINGLE, "--dataset", str(root), *options]


@pytest.mark.slow
def test_serves_on_the_loopback_address_alone_until_interrupted(root: Path) -> None:
    viser()
    process = subprocess.Popen(command(root, "--port", "0"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        match = re.match(r"http://127\.0\.0\.1:(\d+)", line)
        assert match, line
        port = int(match[1])
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(f"http://127.0.0.1:{port}/", timeout=10) as answer:
            assert b"<html" in answer.read(2000)
        table = Path("/proc/net/tcp")
        if table.exists():  # local addresses are hexadecimal, in the byte order of the machine
            listening = [row.split()[1] for row in table.read_text().splitlines()[1:] if row.split()[3] == "0A"]
            assert [a for a in listening if a.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]
    finally:
        process.send_signal(2)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 0
    assert said.strip() == ""


def test_the_page_says_what_the_room_is_drawn_from(root: Path, tmp_path: Path) -> None:
    plain = read_scene(Dataset(write_release(tmp_path, frames=3, size=48))[MULTI])
    assert plain.dense is None
    assert "--with depth" in room_note(replace(plain, surfaces=()))
    deep = read_scene(Dataset(root)[SINGLE])
    assert deep.dense is not None
    assert deep.surfaces
    assert "pictures of some frames on patches" in room_note(deep)
    assert "Points from the depth" in room_note(deep)
    assert "switched on" not in room_note(deep, recorded=True), "a recording has no switches"
    assert "Points from the depth" not in room_note(replace(deep, dense=None))
    assert "no mesh of it" in room_note(replace(deep, surfaces=()))


def test_a_port_that_is_taken_is_told(root: Path) -> None:
    viser()
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        done = subprocess.run(command(root, "--port", str(port)), capture_output=True, text=True, timeout=30)
    assert done.returncode == 2, "as avs3d view"
    assert done.stderr == f"avs3d: error: port {port} is taken; choose another with --port, or 0 for any free one\n"
