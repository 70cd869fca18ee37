"""Errors found before generation: values that dataset.json cannot store, an unwritable cache, file names and sizes."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
import trimesh
import yaml

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.runtime.user_path import user_path
from generators.acoustics.materialfile import read_material_file
from generators.assets.meshfile import load_model
from generators.core.folders import default_cache
from generators.core.scene import Licence, Scene
from generators.homes import cache as cache
from generators.library.mesh_cleaning import clean
from generators.library.store import default_store
from generators.manifest.reading import ManifestFile, read_manifest
from generators.manifest.schema import LicenceSpec, ScanSpec
from generators.options import GenerateOptions
from generators.plan import make_plans, resolve_file
from generators.run.dataset_record import check
from generators.run.generation import generate
from generators.run.runner import RunSettings, run
from generators.scans import scan
from tests.support.homes import write_manifest

TERMS = {"name": "CC0-1.0", "author": "somebody"}


def source(tmp_path: Path, **changes: object) -> ManifestFile:
    """A readable manifest, changed afterwards: what a program may hand over that no YAML file can."""
    found = read_manifest(write_manifest(tmp_path))
    return dataclasses.replace(found, manifest=found.manifest.model_copy(update=changes))


def refuses_to_run(manifest: ManifestFile, tmp_path: Path, folder: Path | None = None) -> str:
    """What `run` says; nothing must be built, and nothing be left."""
    plans = make_plans(manifest, GenerateOptions(audio="analytic", frames=2, size=32))
    root, events = tmp_path / "data", []
    with pytest.raises(Avs3dError) as caught:
        run(manifest, plans, root, RunSettings(folder or tmp_path / "cache"), events.append)
    assert events == []
    assert not list(root.glob("part_*"))
    assert str(caught.value).isprintable()
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"version": ""}, ["version", "at least 1 character"]), ({"version": "1\ud800"}, ["version", "unicode"])],
    ids=["empty", "surrogate"],
)
def test_what_dataset_json_cannot_hold_is_refused_before_the_first_home(
    tmp_path: Path, changes: dict[str, object], words: list[str]
) -> None:
    said = refuses_to_run(source(tmp_path, **changes), tmp_path)
    assert "dataset.json cannot hold" in said
    for word in words:
        assert word in said


def test_a_licence_of_a_scan_that_is_empty_is_refused_and_one_without_source_takes_the_file(tmp_path: Path) -> None:
    found = source(tmp_path)
    (name, home), *_ = found.manifest.scans.items()
    for terms, fits in (
        (LicenceSpec(**TERMS), True),
        (LicenceSpec.model_construct(name="", author="x", source=""), False),
    ):
        scans = {name: home.model_copy(update={"source": "scan", "file": "flat.glb", "licence": terms})}
        manifest = source(tmp_path, scans=scans)
        if fits:
            check(manifest)
        else:
            with pytest.raises(UsageError, match=r"dataset\.json cannot hold name"):
                check(manifest)


def test_a_cache_that_takes_nothing_is_noticed_before_a_home_is_built(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    manifest = source(tmp_path, scans={"box": ScanSpec(source="apartment", seed=1)})
    said = refuses_to_run(manifest, tmp_path, tmp_path / "file" / "cache")
    assert "scene cache" in said
    assert "--cache" in said

    def build() -> Scene:
        raise AssertionError("built in vain")

    with pytest.raises(Avs3dError, match="cannot store 'a'"):
        cache.cached_scene(tmp_path / "file" / "cache", "a", build)


def test_a_home_folder_is_spelled_out_and_an_unknown_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "bell.wav").write_bytes(b"ding")
    assert user_path("~/bell.wav") == tmp_path / "bell.wav"
    assert user_path("a~b/~") == Path("a~b/~")
    with pytest.raises(UsageError, match="the name of a file or folder is empty"):
        user_path("")
    assert resolve_file(tmp_path / "else", "~/bell.wav", "sound") == tmp_path / "bell.wav"
    monkeypatch.setenv("AVS3D_CACHE", "~/homes")
    monkeypatch.setenv("AVS3D_ASSETS", "~/models")
    assert (default_cache(), default_store()) == (tmp_path / "homes", tmp_path / "models")
    with pytest.raises(UsageError, match=r"~nobody-here/bell\.wav: no home folder is known for '~nobody-here'"):
        resolve_file(tmp_path, "~nobody-here/bell.wav", "sound")
    with pytest.raises(UsageError, match="too long"):
        resolve_file(tmp_path, "a" * 300, "sound")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems keep caches elsewhere")
def test_caches_lie_where_xdg_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AVS3D_CACHE", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert default_cache() == tmp_path / ".cache" / "avs3d-bench"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_cache() == tmp_path / "xdg" / "avs3d-bench"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr("os.path.expanduser", str)  # a user whom the system does not know
    with pytest.raises(Avs3dError, match="set AVS3D_CACHE or XDG_CACHE_HOME"):
        default_cache()


def test_the_content_of_a_file_below_a_home_folder_decides_the_digest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    text = (write_manifest(tmp_path)).read_text()
    manifest = tmp_path / "own.yaml"
    (spec, *_) = read_manifest(write_manifest(tmp_path)).manifest.observations
    manifest.write_text(f"{text}\nsounds: {{{spec.category}: [{{file: ~/bell.wav, licence: {TERMS}}}]}}\n")
    digests = set()
    for content in (b"ding", b"dong"):
        (tmp_path / "bell.wav").write_bytes(content)
        digests.add(make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))[0].digest)
    assert len(digests) == 2


@pytest.mark.parametrize("suffix", ["obj", "ply"])
@pytest.mark.parametrize("factor", [1e300, 1e13])
def test_a_mesh_beyond_all_measure_is_one_line(tmp_path: Path, suffix: str, factor: float) -> None:
    path = tmp_path / f"huge.{suffix}"
    box = trimesh.creation.box()
    if suffix == "obj":
        lines = [f"v {x * factor:.9g} {y * factor:.9g} {z * factor:.9g}" for x, y, z in box.vertices.tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces.tolist()]
        path.write_text("\n".join(lines))
    else:
        box.vertices = np.asarray(box.vertices) * min(factor, 1e38)
        box.export(path)
    licence = Licence("MIT", "x", "y")
    for use in (
        lambda: load_model(path, "clock", licence=licence),
        lambda: clean(path),
        lambda: scan.load_scan("flat", path, {"kitchen": [[0, 0, 0], [1, 1, 1]]}),
    ):
        with pytest.raises(Avs3dError, match=r"coordinates up to .*e\+.*; expected at most 1e\+12") as caught:
            use()
        assert str(caught.value).isprintable()


def test_a_scan_in_millimetres_is_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "flat.ply"
    trimesh.creation.box((9000, 2600, 25_000)).export(path)
    with pytest.raises(Avs3dError, match=r"reaches 12,500 m .* millimetres"):
        scan.load_scan("flat", path, {"kitchen": [[0, 0, 0], [1, 1, 1]]})


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"materials": [{"name": "a", "labels": ["b"], "absorption": [125, 1' + "0" * 5000 + "]}]}"],
    ids=["deep", "digits"],
)
def test_material_files_that_would_crash_the_reader_are_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "materials.json"
    path.write_text(text)
    with pytest.raises(Avs3dError) as caught:
        read_material_file(path)
    assert str(caught.value).isprintable()


# ---- the files that a run reads --------------------------------------------------------------------------------------


def with_files(tmp_path: Path, objects: dict[str, list[str]], sounds: dict[str, list[str]], **home: str) -> Path:
    """The manifest of a microwave (part_1) and three clocks (part_2) with these files."""
    path = write_manifest(tmp_path)
    document = yaml.safe_load(path.read_text())
    for field, table in (("objects", objects), ("sounds", sounds)):
        document[field] = {name: [{"file": file, "licence": TERMS} for file in names] for name, names in table.items()}
    document["scans"]["box"] |= home
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    (tmp_path / "text.glb").write_text("no mesh")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    soundfile.write(tmp_path / "silent.wav", np.zeros(44_100), 44_100)
    soundfile.write(tmp_path / "good.wav", np.random.default_rng(0).normal(0, 0.1, 44_100), 44_100)
    (tmp_path / "cut.wav").write_bytes((tmp_path / "good.wav").read_bytes()[:3000])
    (tmp_path / "materials.json").write_text("{")
    return path


def refuse_to_build(*_: object, **__: object) -> None:
    raise AssertionError("a home was opened")


@pytest.fixture
def nothing_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("generators.run.runner._make", refuse_to_build)


@pytest.mark.usefixtures("nothing_is_built")
def test_every_file_is_read_before_the_first_home_is_built(tmp_path: Path) -> None:
    objects = {"microwave": ["gone.glb", "text.glb"], "clock": ["flat.obj"], "toilet": ["of no observation.glb"]}
    sounds = {"microwave": ["good.wav", "cut.wav", "~nobody-here/x.wav"], "clock": ["silent.wav"]}
    path = with_files(tmp_path, objects, sounds, materials="materials.json")
    with pytest.raises(Avs3dError) as caught:
        generate(path, tmp_path / "data", audio="analytic", workers=1)
    lines = path.read_text().splitlines()
    expected = {
        "objects.microwave.0": "gone.glb",
        "objects.microwave.1": "text.glb",
        "objects.clock.0": "flat.obj",
        "sounds.microwave.1": "cut.wav",
        "sounds.microwave.2": "~nobody-here/x.wav",
        "sounds.clock.0": "silent.wav",
        "scans.box.materials": "materials.json",
    }
    found = {}
    for message in caught.value.args:
        assert message.isprintable()
        where, place, said = message.split(": ", 2)
        number = int(where.removeprefix(f"{path}, line "))
        found[place] = next(name for name in expected.values() if name in said)
        assert found[place] in lines[number - 1], "the line is that of the file"
    assert found == expected
    assert not (tmp_path / "data").exists()


@pytest.mark.usefixtures("nothing_is_built")
def test_an_unknown_home_folder_leaves_no_empty_folder(tmp_path: Path) -> None:
    path = with_files(tmp_path, {}, {"clock": ["~nobody-here/x.wav"]})
    with pytest.raises(UsageError, match="no home folder is known for '~nobody-here'"):
        generate(path, tmp_path / "data", audio="analytic", workers=1)
    assert not (tmp_path / "data").exists()


@pytest.mark.slow
def test_files_that_the_chosen_observations_do_not_use_block_nothing(tmp_path: Path) -> None:
    path = with_files(tmp_path, {"clock": ["gone.glb"]}, {"clock": ["cut.wav"], "microwave": ["good.wav"]})
    small = {"audio": "analytic", "frames": 1, "size": 32, "workers": 1}
    outcome = generate(path, tmp_path / "data", **small, only=["part_1/*"])  # type: ignore[arg-type]
    assert (len(outcome.made), outcome.failed) == (1, ())


def test_an_asset_of_another_category_may_be_missing_from_the_lock_file(tmp_path: Path) -> None:
    path = write_manifest(tmp_path)
    path.write_text(path.read_text() + "\nobjects: {clock: [{asset: folder/typo}]}\n")
    assert len(make_plans(read_manifest(path), GenerateOptions(audio="analytic", only=["part_1/*"]))) == 1
    with pytest.raises(UsageError, match="no asset 'folder/typo'"):
        make_plans(read_manifest(path), GenerateOptions(audio="analytic"))


def test_a_file_that_has_gone_since_is_named(tmp_path: Path) -> None:
    """Its observation has another digest then; that it is from another manifest would be wrong."""
    path = with_files(tmp_path, {}, {"microwave": ["good.wav"]})
    (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic", only=["part_1/*"]))
    plan.check_files()
    (tmp_path / "good.wav").unlink()
    with pytest.raises(Avs3dError, match=r"good\.wav: sound for microwave not found"):
        plan.check_files()


@pytest.mark.slow
def test_a_failure_is_printed_once(tmp_path: Path) -> None:
    path = write_manifest(tmp_path)
    document = yaml.safe_load(path.read_text())
    document["observations"] = [document["observations"][0] | {"room": "bathroom"}]
    path.write_text(yaml.safe_dump(document))
    command = [sys.executable, "-m", "avs3d_bench", "generate", path, "-o", tmp_path / "data"]
    command += ["--audio", "analytic", "--frames", "1", "--size", "32", "--workers", "1"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=240)
    assert done.returncode == 1
    assert (done.stdout + done.stderr).count("no room 'bathroom'") == 1
    assert "avs3d: error: part_1/box/bathroom/1: " in done.stderr
    assert str(tmp_path / "data/failures.jsonl") in done.stdout
