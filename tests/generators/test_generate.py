"""`avs3d generate` from end to end on a tiny scan: validity, exact masks, determinism, resumption, one-line errors."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
import trimesh
import yaml
from click.testing import CliRunner

from avs3d_bench.cli import main
from avs3d_bench.dataset import Dataset
from avs3d_bench.geometry import direction_to
from avs3d_bench.scheduling.failures import read_failures
from avs3d_bench.validate import validate
from generators.cli import generate
from tests.support.here import generated_here
from tests.support.homes import tree_digest, write_manifest

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap reads the sparse model back; it is in the dev extra")

KEYS = ["part_1/box/kitchen/1", "part_2/box/kitchen/1"]
#: Exit code and output of `avs3d generate` with these arguments.
Call = Callable[..., tuple[int, str]]
COMMAND = [sys.executable, "-m", "avs3d_bench", "generate"]


def call(*args: object) -> tuple[int, str]:
    """Exit code and output of `avs3d generate`, as a user meets them."""
    done = subprocess.run([*COMMAND, *map(str, args)], capture_output=True, text=True, check=False, timeout=240)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def here(capfd: pytest.CaptureFixture[str]) -> Call:
    """The same in the process of the test, without the seconds that a start takes."""

    def call_here(*args: object) -> tuple[int, str]:
        capfd.readouterr()
        with generated_here(), pytest.raises(SystemExit) as end:
            main(["generate", *map(str, args)])
        return int(end.value.code or 0), "".join(capfd.readouterr())

    return call_here


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("manifest"))


@pytest.fixture(scope="module")
def root(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset, made in one process, with depth and impulse responses."""
    root = tmp_path_factory.mktemp("dataset") / "tiny"
    done = CliRunner().invoke(
        generate,
        [str(manifest), "-o", str(root), "--workers", "1", "--audio", "analytic", "--with", "depth", "--with", "rirs"],
        catch_exceptions=False,
    )
    assert done.exit_code == 0, done.output
    return root


def test_the_process_that_hands_out_the_work_loads_nothing_that_only_workers_need() -> None:
    heavy = ("scipy.signal", "scipy.spatial", "scipy.ndimage", "trimesh", "networkx", "numba", "matplotlib", "pandas")
    code = "import sys, generators.run.generation, generators.surveying.cli\n"
    code += f"print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_the_tree_is_valid_to_the_last_file(root: Path) -> None:
    report = validate(root, deep=True)
    assert [str(problem) for problem in report.problems if problem.severity == "error"] == []
    assert [observation.key for observation in Dataset(root)] == KEYS


@pytest.mark.slow
def test_masks_are_the_visible_pixels_of_the_sounding_instance(root: Path) -> None:
    for observation in Dataset(root):
        record = observation.record
        assert record is not None
        for frame, info in zip(observation.frames, record.frames, strict=True):
            mask = frame.mask()
            assert np.array_equal(mask, frame.instance_ids() == record.sounding.id)
            assert mask.sum() == info.visible_pixels


@pytest.mark.slow
def test_projected_surface_points_fall_inside_the_mask_where_depth_says_they_are_visible(root: Path) -> None:
    inside = hits = own_pixels = foreign_pixels = 0
    for observation in Dataset(root):
        mesh, camera = observation.mesh(), observation.intrinsics
        rng = np.random.default_rng(0)
        triangles = mesh.vertices[mesh.faces].astype(float)
        area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
        face = rng.choice(len(area), 4000, p=area / area.sum())
        a, b = np.sort(rng.random((2, 4000)), axis=0)
        points = np.einsum("nk,nkd->nd", np.stack([a, b - a, 1 - b], axis=1), triangles[face])
        low, high = mesh.vertices.min(axis=0) - 0.01, mesh.vertices.max(axis=0) + 0.01
        centres = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).reshape(-1, 2) + 0.5
        for frame in observation.frames:
            mask, depth = frame.mask(), frame.depth()
            pixels, distance = camera.project(frame.pose, points)
            with np.errstate(invalid="ignore"):
                seen = (distance > 0.05) & (pixels >= 0).all(axis=1) & (pixels < camera.width).all(axis=1)
            column, row = np.floor(pixels[seen]).astype(int).T
            visible = np.abs(depth[row, column] - distance[seen]) < 0.01 + 0.005 * distance[seen]
            # A silhouette may pass between a point and the centre of its pixel: judge where the neighbours agree.
            for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                near = np.clip([row + step[0], column + step[1]], 0, camera.width - 1)
                visible &= mask[tuple(near)] == mask[row, column]
            hits += int(mask[row, column][visible].sum())
            inside += int(visible.sum())
            # The other way round: what the mask marks is the object, and nothing that hides it is marked.
            world = camera.unproject(frame.pose, centres, depth.reshape(-1).astype(float))
            within = ((world > low) & (world < high)).all(axis=1).reshape(mask.shape)
            own_pixels += int(mask.sum())
            foreign_pixels += int((mask & ~within).sum())
    assert inside > 2000
    assert hits / inside >= 0.995
    assert own_pixels > 1000
    assert foreign_pixels == 0


@pytest.mark.slow
def test_pycolmap_reads_the_model_and_its_points_reproject(root: Path) -> None:
    for observation in Dataset(root):
        model = pycolmap.Reconstruction(str(observation.path / "sparse/0"))
        names = sorted(image.name for image in model.images.values())
        assert names == [f"{frame.name}.png" for frame in observation.frames]
        assert len(model.points3D) > 200
        errors = []
        for point in model.points3D.values():
            for element in point.track.elements:
                image = model.images[element.image_id]
                pixel = model.cameras[image.camera_id].img_from_cam(image.cam_from_world() * point.xyz)
                errors.append(np.linalg.norm(pixel - image.points2D[element.point2D_idx].xy))
        assert max(errors) <= 0.5
        # Y points down: the floor lies below the cameras, at larger y.
        centres = np.array([image.projection_center() for image in model.images.values()])
        heights = np.array([point.xyz[1] for point in model.points3D.values()])
        assert heights.max() > centres[:, 1].max() + 0.5


@pytest.mark.slow
def test_the_sounds_are_where_and_as_long_as_the_official_tools_expect(root: Path) -> None:
    for observation in Dataset(root):
        for index in range(len(observation.frames)):
            binaural = soundfile.info(observation.path / f"audio_clips_binaural/frame_{index}.wav")
            mono = soundfile.info(observation.path / f"audio_clips_mono/frame_{index}.wav")
            assert (binaural.channels, binaural.frames, binaural.samplerate) == (2, 44_100, 44_100)
            assert (mono.channels, mono.frames, mono.samplerate) == (1, 88_200, 44_100)
        split = json.loads((observation.path / "camera_splits.json").read_text())
        assert split["test"] == ["frame_000", "frame_008"]


@pytest.mark.slow
def test_directions_agree_with_the_poses_and_the_ears(root: Path) -> None:
    for observation in Dataset(root):
        record = observation.record
        assert record is not None
        for frame in record.frames:
            direction = direction_to(frame.pose, record.source_position)
            assert frame.azimuth == pytest.approx(direction.azimuth, abs=1e-3)
            assert frame.distance == pytest.approx(direction.distance, abs=1e-5)
            left, right = np.sqrt((observation.frames[int(frame.name[-3:])].audio() ** 2).mean(axis=1))
            assert (frame.rms_left, frame.rms_right) == pytest.approx((left, right), rel=1e-4)


@pytest.mark.slow
def test_two_workers_write_the_same_bytes_and_a_rerun_keeps_them(
    root: Path, manifest: Path, tmp_path: Path, here: Call
) -> None:
    again = tmp_path / "again"
    args = [manifest, "-o", again, "--audio", "analytic", "--with", "depth", "--with", "rirs"]
    code, output = call(*args, "--workers", 2)
    assert code == 0, output
    assert "2 made, 0 kept, 0 failed" in output
    assert tree_digest(again) == tree_digest(root)
    code, output = here(*args, "--workers", 1)
    assert code == 0, output
    assert "0 made, 2 kept" in output
    assert tree_digest(again) == tree_digest(root)


@pytest.mark.slow
@pytest.mark.parametrize("moment", [0, 6])
def test_a_run_killed_with_signal_9_goes_on_to_the_same_bytes(
    root: Path, manifest: Path, tmp_path: Path, here: Call, moment: int
) -> None:
    cut = tmp_path / "cut"
    args = [manifest, "-o", cut, "--audio", "analytic", "--with", "depth", "--with", "rirs", "--workers"]
    process = subprocess.Popen([*COMMAND, *map(str, args), "2"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    deadline = time.monotonic() + 120
    while not list(cut.glob(f"part_*/*/*/.*.partial/input/frame_{moment:03d}.png")):
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < deadline, "no frame appeared"
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not (cut / "dataset.json").exists()
    code, output = here(*args, 1)
    assert code == 0, output
    assert tree_digest(cut) == tree_digest(root)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_and_sigterm_stop_all_workers_and_the_next_run_goes_on(
    root: Path, manifest: Path, tmp_path: Path, here: Call, number: signal.Signals, code: int
) -> None:
    cut = tmp_path / "cut"
    args = [manifest, "-o", cut, "--audio", "analytic", "--with", "depth", "--with", "rirs", "--workers"]
    for _ in range(5):
        process = subprocess.Popen(
            [*COMMAND, *map(str, args), "2"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        )
        while not list(cut.glob("part_*/*/*/.*.partial/input/frame_000.png")):
            assert process.poll() is None, process.communicate()[0]
            time.sleep(0.002)
        # Ctrl-C reaches every process of the terminal, a job scheduler's signal the first one.
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
        output = process.communicate(timeout=30)[0]
        if process.returncode != 0:
            break
        shutil.rmtree(cut)  # on a busy machine the short run may end before the signal comes
    assert process.returncode == code
    assert b"Traceback" not in output
    assert not list(cut.rglob(".*.partial"))
    code, text = here(*args, 1)
    assert code == 0, text
    assert tree_digest(cut) == tree_digest(root)


@pytest.mark.slow
def test_a_second_run_in_the_same_folder_is_refused_and_the_first_goes_on(
    root: Path, manifest: Path, tmp_path: Path, here: Call
) -> None:
    out = tmp_path / "out"
    args = [manifest, "-o", out, "--audio", "analytic", "--with", "depth", "--with", "rirs", "--workers", 1]
    first = subprocess.Popen([*COMMAND, *map(str, args)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    while not list(out.glob("part_*/*/*/.*.partial/input/frame_000.png")):
        assert first.poll() is None, first.communicate()[0]
        time.sleep(0.002)
    os.kill(first.pid, signal.SIGSTOP)
    try:
        for _ in range(2):
            refused(*here(*args), 1, "another avs3d generate is at work")
    finally:
        os.kill(first.pid, signal.SIGCONT)
    assert first.wait(timeout=120) == 0
    assert tree_digest(out) == tree_digest(root)


@pytest.mark.slow
def test_one_bad_home_does_not_stop_the_others(manifest: Path, tmp_path: Path, here: Call) -> None:
    def change(document: dict) -> None:
        document["scans"]["gone"] = document["scans"]["box"] | {"file": "nowhere.glb"}
        document["observations"][1]["scan"] = "gone"

    out = tmp_path / "out"
    path = changed(manifest, tmp_path / "m", change)
    code, output = here(path, "-o", out, "--audio", "analytic", "--frames", 3, "--workers", 1)
    refused(code, output, 1, "nowhere.glb", "part_2/gone/kitchen/1")
    assert "1 made, 0 kept, 1 failed" in output
    assert [observation.key for observation in Dataset(out)] == [KEYS[0]]


@pytest.mark.slow
def test_observations_of_other_options_are_never_mixed(manifest: Path, tmp_path: Path, here: Call) -> None:
    out = tmp_path / "out"
    small = ["--audio", "analytic", "--frames", 3, "--workers", 1]
    assert here(manifest, "-o", out, "--only", "part_1/*", *small, "--size", 32)[0] == 0
    refused(
        *here(manifest, "-o", out, "--only", "part_2/*", *small, "--size", 48),
        2,
        "--size (recorded 32, asked 48);",
        KEYS[0],
    )
    code, output = here(manifest, "-o", out, "--only", "part_2/*", *small, "--size", 32)
    assert code == 0, output
    assert len(Dataset(out)) == 2


@pytest.mark.slow
def test_another_manifest_or_other_options_do_not_overwrite(root: Path, manifest: Path, here: Call) -> None:
    before = tree_digest(root)
    code, output = here(manifest, "-o", root, "--audio", "analytic", "--workers", 1)
    assert code == 2
    assert output.strip().splitlines()[-1].startswith("avs3d: error:")
    assert "--with rirs (recorded with, asked without)" in output
    assert tree_digest(root) == before


def refused(code: int, output: str, expected: int, *words: str) -> None:
    lines = [line for line in output.splitlines() if line.startswith("avs3d: error:")]
    assert "Traceback" not in output
    assert code == expected, output
    assert len(lines) == 1, output
    for word in words:
        assert word in lines[0]


def changed(manifest: Path, folder: Path, change) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    document = yaml.safe_load(manifest.read_text())
    change(document)
    document["scans"]["box"]["file"] = str(manifest.parent / document["scans"]["box"]["file"])
    path = folder / "changed.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.mark.slow
def test_bad_input_is_one_line_and_leaves_nothing_half_written(manifest: Path, tmp_path: Path, here: Call) -> None:
    out = tmp_path / "out"
    truncated = tmp_path / "short.wav"
    soundfile.write(truncated, np.random.default_rng(0).normal(0, 0.1, 44_100), 44_100)
    truncated.write_bytes(truncated.read_bytes()[:3000])
    nan = tmp_path / "nan.obj"
    nan.write_text("v 0 0 0\nv 0.5 0 nan\nv 0 0.3 0\nv 0.2 0.2 0.4\nf 1 2 3\nf 1 2 4\n")
    bare = tmp_path / "bare.obj"
    bare.write_text("mtllib bare.mtl\nusemtl a\nv 0 0 0\nv 0.5 0 0\nv 0 0.3 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (tmp_path / "bare.mtl").write_text("newmtl a\nmap_Kd missing.png\n")
    licence = {"name": "CC0-1.0", "author": "x"}

    def sound(name: Path):
        return lambda d: d.update(sounds={"microwave": [{"file": str(name), "licence": licence}]})

    def mesh(name: Path):
        return lambda d: d.update(objects={"microwave": [{"file": str(name), "licence": licence}]})

    slab = tmp_path / "slab.obj"
    slab.write_text("v 0 0 0\nv 3 0 0\nv 0 9 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")

    def tall(d: dict) -> None:
        d["observations"][0].update(category="washing_machine")
        d.update(objects={"washing_machine": [{"file": str(slab), "licence": licence, "height": 4.5}]})

    cases = [
        (lambda d: d["observations"][0].update(category="microwve"), 2, ["did you mean 'microwave'"]),
        (lambda d: d["observations"][0].update(scan="castle"), 2, ["unknown scan 'castle'"]),
        (lambda d: d["scans"]["box"].update(file="nowhere.glb"), 1, ["nowhere.glb"]),
        (lambda d: d["observations"][0].update(room="bathroom"), 1, ["no room 'bathroom'", "kitchen"]),
        (tall, 1, ["washing_machine", "kitchen"]),
        (sound(truncated), 1, ["short.wav"]),
        (sound(tmp_path / "gone.wav"), 1, ["gone.wav"]),
        (mesh(nan), 1, ["nan.obj"]),
        (mesh(bare), 1, ["missing.png"]),
    ]
    for number, (change, expected, words) in enumerate(cases):
        path = changed(manifest, tmp_path / str(number), change)
        args = [str(path), "-o", str(out), "--workers", "1", "--audio", "analytic", "--only", "part_1/*"]
        refused(*here(*args), expected, *words)
        assert not list(out.rglob("*.png"))
        assert not list(out.rglob(".*.partial"))


@pytest.mark.slow
def test_a_folder_that_cannot_be_is_one_line(manifest: Path, tmp_path: Path, here: Call) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    code, output = here(manifest, "-o", in_the_way / "data", "--audio", "analytic", "--workers", 1)
    refused(code, output, 1, str(in_the_way / "data"))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders, so nothing can be refused")
def test_a_read_only_folder_is_one_line(manifest: Path, tmp_path: Path, here: Call) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    code, output = here(manifest, "-o", folder / "data", "--audio", "analytic", "--workers", 1)
    refused(code, output, 1, "ermission", str(folder))


@pytest.mark.slow
def test_files_take_the_place_of_objects_and_sounds(manifest: Path, tmp_path: Path, here: Call) -> None:
    box = trimesh.creation.box(extents=(0.5, 0.3, 0.36))
    box.visual.face_colors = np.tile((200, 30, 30, 255), (12, 1))
    box.export(tmp_path / "red.glb")
    tone = 0.2 * np.sin(2 * np.pi * 997 * np.arange(5 * 22_050) / 22_050)
    soundfile.write(tmp_path / "tone.flac", np.stack([tone, tone], axis=1), 22_050)
    licence = {"name": "CC-BY-4.0", "author": "Jane Doe", "source": "example.org/1"}

    def change(document: dict) -> None:
        document["objects"] = {"microwave": [{"file": str(tmp_path / "red.glb"), "height": 0.3, "licence": licence}]}
        document["sounds"] = {"microwave": [{"file": str(tmp_path / "tone.flac"), "licence": licence}]}

    path, out = changed(manifest, tmp_path / "m", change), tmp_path / "out"
    code, output = here(path, "-o", out, "--audio", "analytic", "--only", "part_1/*", "--workers", 1)
    assert code == 0, output
    dataset = Dataset(out)
    (observation,) = dataset
    assert observation.record is not None
    assert observation.record.sounding.licence.author == "Jane Doe"
    assert dataset.record is not None
    assert {a.asset for a in dataset.record.attributions if a.author == "Jane Doe"} >= {str(tmp_path / "tone.flac")}
    colour = np.concatenate([frame.rgb()[frame.mask()] for frame in observation.frames]).mean(axis=0)
    assert colour[0] > 2 * colour[1]
    clip = observation.frames[3].audio()[0]
    peak = np.abs(np.fft.rfft(clip)).argmax()
    assert peak == pytest.approx(997, abs=2)


#: Python runs this in every process that finds it: writing fails once a process has written 1 MB.
FULL_DISK = """
import errno, avs3d_bench.formats.files as files, avs3d_bench.formats.media as media
written, original = 0, files.write_bytes
def full(path, data):
    global written
    written += len(data)
    if written > 1_000_000:
        raise files.Avs3dError(files.os_error_line(OSError(errno.ENOSPC, "No space left on device"), path, "write"))
    original(path, data)
files.write_bytes = media.write_bytes = full
"""


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_the_next_run_goes_on(
    root: Path, manifest: Path, tmp_path: Path, here: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "full"
    args = [manifest, "-o", out, "--workers", "1", "--audio", "analytic", "--with", "depth", "--with", "rirs"]
    (tmp_path / "full-disk").mkdir()
    (tmp_path / "full-disk" / "sitecustomize.py").write_text(FULL_DISK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "full-disk"))
    code, output = call(*args)
    assert code == 1
    assert output.lower().count("no space left") >= 2
    assert not list(out.rglob("*.png"))
    assert [line["key"] for line in read_failures(out / "failures.jsonl")] == KEYS
    monkeypatch.delenv("PYTHONPATH")
    assert here(*args)[0] == 0
    assert tree_digest(out) == tree_digest(root)


@pytest.mark.slow
def test_frames_and_size_make_small_ones(manifest: Path, tmp_path: Path, here: Call) -> None:
    out = tmp_path / "small"
    code, output = here(
        manifest, "-o", out, "--audio", "analytic", "--only", "part_1/*", "--frames", 5, "--size", 48, "--workers", 1
    )
    assert code == 0, output
    (observation,) = Dataset(out)
    assert len(observation.frames) == 5
    assert observation.frames[0].rgb().shape == (48, 48, 3)
    code, output = here(manifest, "-o", out, "--only", "part_9/*", "--audio", "analytic")
    refused(code, output, 2, "matches no observation")
