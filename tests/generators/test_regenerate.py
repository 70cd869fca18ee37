"""`avs3d validate --regenerate`: the same bytes again, falsifications that `--deep` cannot find, one-line errors."""

from __future__ import annotations

import hashlib
import json
import tomllib
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench import cli
from avs3d_bench.commands.report import Problem
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.seld import panorama
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from avs3d_bench.validation import regenerate as module
from avs3d_bench.validation.regenerate import GROUP, choose_frames, find_maker, regenerate
from generators import backends
from generators.cli import generate
from generators.run.panorama import render_faces
from tests.support import tampering, tiny
from tests.support.here import forget_arrangements
from tests.support.homes import write_manifest
from tests.support.tampering import MUTATIONS, Tree

KEY = "part_2/box/kitchen/1"
FRAMES = 4


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("manifest"))


def generated(manifest: Path, root: Path, *more: str) -> Path:
    options = ["--workers", "1", "--audio", "analytic", "--frames", str(FRAMES), "--size", "64", "--with", "depth"]
    done = CliRunner().invoke(generate, [str(manifest), "-o", str(root), *options, *more], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return root


@pytest.fixture(scope="module")
def root(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generated(manifest, tmp_path_factory.mktemp("dataset") / "data")


@pytest.fixture(scope="module")
def alone(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One observation: to make the others again would show nothing more."""
    return generated(manifest, tmp_path_factory.mktemp("alone") / "data", "--only", KEY)


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The entry point of this checkout, whatever is installed."""
    project = Path(cli.__file__).parents[1] / "pyproject.toml"
    points = tomllib.loads(project.read_text())["project"]["entry-points"]
    known = [metadata.EntryPoint(name, value, GROUP) for name, value in points[GROUP].items()]
    monkeypatch.setattr(module, "entry_points", lambda: tuple(known))


def _changed(root: Path, target: Path, group: str, name: str) -> tuple[Path, tuple[Problem, ...]]:
    one = next(one for one in MUTATIONS if (one.group, one.name) == (group, name))
    return target, tampering.tampered(root, target, one, KEY)


@pytest.mark.slow
def test_the_faces_about_a_listener_show_what_the_pictures_show(tmp_path: Path, manifest: Path):
    """What `avs3d export seld --video` resamples, looked at through the ideal camera, as faces are."""
    root = generated(manifest, tmp_path / "data", "--only", KEY, "--camera", "ideal")
    observation = Dataset(root)[KEY]
    camera = panorama.face_camera(96)
    faces = render_faces(panorama.FaceRequest(root, KEY, camera, manifest))
    own = observation.intrinsics
    v, u = np.mgrid[0 : own.height, 0 : own.width] + 0.5
    rays = np.stack([(u - own.cx) / own.fx, -(v - own.cy) / own.fy, -np.ones_like(u)], axis=-1)
    for frame in (observation.frames[0], observation.frames[3]):
        world = rays @ frame.pose.rotation_matrix.T
        shown = panorama.CubeSampler(world, camera).sample(faces(frame.index))
        # Edges are sampled in other places; a wrong face, axis or place differs everywhere.
        assert np.median(np.abs(shown.astype(int) - frame.rgb())) <= 1
    with pytest.raises(UsageError, match="and name it with --manifest"):
        render_faces(panorama.FaceRequest(root, KEY, camera))


def test_the_entry_point_of_panoramas_is_the_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    project = Path(cli.__file__).parents[1] / "pyproject.toml"
    points = tomllib.loads(project.read_text())["project"]["entry-points"][panorama.GROUP]
    known = [metadata.EntryPoint(name, value, panorama.GROUP) for name, value in points.items()]
    monkeypatch.setattr(panorama, "entry_points", lambda: known)
    assert panorama.find_renderer() is render_faces
    monkeypatch.setattr(panorama, "entry_points", lambda: ())
    with pytest.raises(UsageError, match="--video needs the generator: pip install"):
        panorama.find_renderer()


@pytest.mark.slow
def test_untouched_frames_are_the_same_bytes(root: Path, manifest: Path):
    said: list[str] = []
    forget_arrangements()
    assert regenerate(root, 2 * FRAMES, seed=1, manifest=manifest, say=said.append) == ()
    assert said == [f"{key}: frames 0, 1, 2, 3" for key in ("part_1/box/kitchen/1", KEY)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("group", "name", "file"),
    [
        ("pictures", "one pixel changed", "input/frame_"),
        ("sound", "one louder by 2 dB", "audio_clips_binaural/frame_"),
        ("mesh", "corners moved by less than 1 mm", "gt_3d/sounding_object.ply"),
        ("record", "notes", "observation.json"),
        ("record", "settings of the engine", "observation.json"),
        ("record", "rotation of a silent instance", "observation.json"),
    ],
)
def test_what_deep_cannot_see_is_found(alone: Path, manifest: Path, tmp_path: Path, group: str, name: str, file: str):
    target, seen = _changed(alone, tmp_path / "data", group, name)
    assert seen == ()
    found = regenerate(target, FRAMES, seed=1, manifest=manifest)
    assert any(p.severity == "error" and p.path.startswith(f"{KEY}/{file}") for p in found), found
    assert all("differ" in p.message for p in found)


@pytest.mark.slow
def test_deep_finds_no_fault_in_generated_trees_and_falsified_ones_are_named(root: Path, tmp_path: Path):
    assert [p for p in validate(root, deep=True).problems if p.severity != "note"] == []
    for number, name in enumerate(("all in reverse order", "mirrored left to right", "noise")):
        _, seen = _changed(root, tmp_path / str(number), "pictures", name)
        assert any("/input/" in p.path for p in seen)
    _, seen = _changed(root, tmp_path / "m", "masks", "one eroded by 1 pixel (with depth)")
    assert any("semantic_masks" in p.path for p in seen)


@pytest.mark.slow
def test_every_field_of_the_whole_observation_is_compared(root: Path, manifest: Path, tmp_path: Path):
    target = tiny.clone(root, tmp_path / "data")
    tiny.edit_record(target, KEY, lambda record: record.update(seed=record["seed"] + 1))
    found = regenerate(target, 2 * FRAMES, seed=1, manifest=manifest)
    assert [(p.path, p.message) for p in found] == [
        (f"{KEY}/observation.json", "seed differs from the regenerated value")
    ]


@pytest.mark.slow
def test_a_missing_file_is_named(root: Path, manifest: Path, tmp_path: Path):
    target = tiny.clone(root, tmp_path / "data")
    (target / KEY / "depth/frame_002.png").unlink()
    found = regenerate(target, 2 * FRAMES, seed=1, manifest=manifest)
    assert [(p.path, p.message) for p in found] == [(f"{KEY}/depth/frame_002.png", "missing; expected a file")]


@pytest.mark.slow
def test_frames_are_chosen_by_the_seed(root: Path):
    assert choose_frames(root, 3, seed=1) == choose_frames(root, 3, seed=1)
    assert len({json.dumps(choose_frames(root, 3, seed=seed)) for seed in range(8)}) > 1
    assert sum(map(len, choose_frames(root, 999, seed=1).values())) == 2 * FRAMES


def _why(target: Path, manifest: Path | None) -> str:
    with pytest.raises(UsageError) as error:
        regenerate(target, 2 * FRAMES, seed=1, manifest=manifest)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.slow
def test_other_software_is_the_only_cause_that_is_named(root: Path, manifest: Path, monkeypatch: pytest.MonkeyPatch):
    installed = backends.backend_versions
    monkeypatch.setattr(backends, "backend_versions", lambda *names: {**installed(*names), "embree": "1.2.3"})
    text = _why(root, manifest)
    assert "was made by other software (embree " in text
    assert ", installed: 1.2.3)" in text
    assert "manifest" not in text
    assert "files" not in text


@pytest.mark.slow
def test_other_files_are_the_only_cause_that_is_named(root: Path, manifest: Path, tmp_path: Path):
    for name in ("tiny.yaml", "room.glb"):
        (tmp_path / name).write_bytes((manifest.parent / name).read_bytes())
    with (tmp_path / "room.glb").open("ab") as file:
        file.write(b"edited")
    text = _why(root, tmp_path / "tiny.yaml")
    assert "with other files than those that the manifest names here (room.glb);" in text
    assert "software" not in text


@pytest.mark.slow
def test_another_manifest_is_the_only_cause_that_is_named(root: Path, tmp_path: Path):
    target = tiny.clone(root, tmp_path / "data")
    tree = Tree(target, KEY)
    text = write_manifest(tmp_path, scans={"box": {"source": "apartment", "seed": 3}}).read_text()
    tree.dataset.update(manifest=text, manifest_sha256=hashlib.sha256(text.encode()).hexdigest())
    tree.finish()
    said = _why(target, None)
    assert "was made from another manifest than the one in dataset.json" in said
    assert "software" not in said


@pytest.mark.slow
def test_a_manifest_that_names_files_is_asked_for(root: Path, manifest: Path, tmp_path: Path):
    with pytest.raises(UsageError, match="--manifest"):
        regenerate(root, 1, seed=1)
    other = tmp_path / "other.yaml"
    other.write_text(manifest.read_text() + "# edited\n")
    with pytest.raises(UsageError, match="is not the manifest from which the dataset was made"):
        regenerate(root, 1, seed=1, manifest=other)


@pytest.mark.slow
def test_the_command_prints_the_seed_and_gives_exit_codes(root: Path, manifest: Path, tmp_path: Path):
    def call(*arguments: object) -> tuple[int, str]:
        done = CliRunner().invoke(cli.avs3d, ["validate", *map(str, arguments)])
        return done.exit_code, done.output

    code, text = call(root, "--regenerate", 1, "--manifest", manifest)
    assert code == 0, text
    assert "regenerating 1 random frames (--seed " in text
    target = tiny.clone(root, tmp_path / "data")
    for index in range(FRAMES):
        tiny.replace(target / KEY / f"input/frame_{index:03d}.png", b"")
        media.write_png_rgb(target / KEY / f"input/frame_{index:03d}.png", np.zeros((64, 64, 3), np.uint8))
    code, text = call(target, "--regenerate", 2 * FRAMES, "--seed", 3, "--manifest", manifest, "--json", tmp_path / "j")
    assert code == 1, text
    named = [
        p["path"]
        for p in json.loads((tmp_path / "j").read_text())["problems"]
        if "differs from the regenerated file" in p["message"]
    ]
    assert named == [f"{KEY}/input/frame_{index:03d}.png" for index in range(FRAMES)]


def test_the_release_and_a_missing_generator_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    release = tiny.write_release(tmp_path / "data", frames=2, size=16)
    with pytest.raises(UsageError, match="official release cannot be regenerated"):
        choose_frames(release, 1, seed=1)
    monkeypatch.setattr(module, "entry_points", lambda: ())
    with pytest.raises(UsageError, match=r"pip install 'avs3d-bench\[generate\]'"):
        find_maker()
