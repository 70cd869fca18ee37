"""`avs3d generate --format tar`: the samples of an export, one tar per observation, and what an index says."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from avs3d_bench import files, layout
from avs3d_bench.cli import validate
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import decode_sample, write_webdataset
from avs3d_bench.exports import observation_tar as tars
from avs3d_bench.exports.observation_check import check_tars
from avs3d_bench.exports.observation_index import ObservationShardIndex
from avs3d_bench.exports.shards import SHARDS_JSON
from generators.cli import generate
from generators.observation.tar_output import tar_plan_digest
from tests.homes import tree_digest, write_manifest

pytest.importorskip("embreex", reason="the renderer of the generate extra")

ROOT = Path(__file__).parent.parent
FIRST, SECOND, BOTH, SILENT = (f"part_3/box/kitchen/{number}" for number in (1, 2, 5, 4))
KEYS = ("part_1/box/kitchen/1", "part_2/box/kitchen/1", FIRST, SECOND, SILENT, BOTH)
FRAMES = 9
SCENES = [
    {
        "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 2, "clock": 1},
        "sources": [{"category": "microwave", "instance": 1}],
    },
    {"like": FIRST, "index": 2, "sources": [{"category": "microwave", "instance": 2}]},
    {"like": FIRST, "index": 4, "sources": []},
    {
        "like": FIRST, "index": 5, "background": {"kind": "noise", "snr_db": 12},
        "sources": [{"category": "microwave", "instance": 1}, {"category": "clock", "gain_db": -12}],
    },
]  # fmt: skip
EXTRAS = ("--with", "depth", "--with", "stems", "--with", "rirs")


def write(folder: Path) -> Path:
    """The manifest of all three parts."""
    import yaml

    path = write_manifest(folder)
    document = yaml.safe_load(path.read_text())
    document["camera"] = {"size": 96, "frames": FRAMES}
    document["observations"] += SCENES
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def run(manifest: Path, root: Path, *options: str, form: str = "tar") -> Result:
    arguments = [str(manifest), "-o", str(root), "--audio", "analytic", "--format", form, *options]
    return CliRunner().invoke(generate, arguments)


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("manifest"))


@pytest.fixture(scope="module")
def folders(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same observations as a dataset of folders."""
    root = tmp_path_factory.mktemp("folders") / "tree"
    done = run(manifest, root, "--workers", "1", *EXTRAS, form="folders")
    assert done.exit_code == 0, done.output
    return root


@pytest.fixture(scope="module")
def shards(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("shards") / "tars"
    done = run(manifest, root, "--workers", "1", *EXTRAS)
    assert done.exit_code == 0, done.output
    return root


def samples(*paths: Path) -> dict[str, dict[str, bytes]]:
    """Key of each sample → its members, without those that belong to no sample."""
    found: dict[str, dict[str, bytes]] = {}
    for path in paths:
        with tarfile.open(path) as archive:
            for info in archive:
                if info.name.startswith("__"):
                    continue
                place, _, name = info.name.rpartition("/")
                stem, _, member = name.partition(".")
                stream = archive.extractfile(info)
                assert stream is not None
                found.setdefault(f"{place}/{stem}", {})[member] = stream.read()
    return found


def index_of(root: Path) -> ObservationShardIndex:
    return files.read_record(root / SHARDS_JSON, ObservationShardIndex)


def test_an_observation_is_one_file_and_nothing_else_is_left(shards: Path) -> None:
    there = {path.relative_to(shards).as_posix() for path in shards.rglob("*") if path.is_file()}
    assert there == {SHARDS_JSON, *(f"{key}.tar" for key in KEYS)}


def test_the_samples_are_those_of_an_export(folders: Path, shards: Path, tmp_path: Path) -> None:
    write_webdataset(folders, tmp_path / "export", extras=("depth", "stems", "rirs"), workers=1)
    exported = samples(*sorted((tmp_path / "export").glob("*.tar")))
    generated = samples(*sorted(shards.rglob("*.tar")))
    assert generated.keys() == exported.keys()
    assert len(generated) == FRAMES * len(KEYS)
    for key, members in exported.items():
        assert list(generated[key]) == list(members), key
        assert generated[key] == members, key
    decoded = decode_sample({"__key__": f"{BOTH}/frame_003"} | generated[f"{BOTH}/frame_003"])
    assert decoded["facts"]["group"] == FIRST
    assert set(decoded["stems"]) == {"source_1", "source_2", "background"}
    assert decoded["category_mask"].shape == decoded["mask"].shape == (96, 96)
    np.testing.assert_array_equal(decoded["binaural"], Dataset(folders)[BOTH].frames[3].audio())


def test_the_record_is_that_of_the_folder_with_fewer_files(folders: Path, shards: Path) -> None:
    for key in KEYS:
        record, digest = tars.read_head(shards / f"{key}.tar")
        whole = Dataset(folders)[key].record
        assert whole is not None
        assert record.files.items() < whole.files.items()
        folders_left_out = {name.partition("/")[0] for name in whole.files.keys() - record.files.keys()}
        assert folders_left_out <= {"images", "sparse", "gt_3d", "audio_clips_mono", layout.SPLITS_JSON}
        assert record.plan_sha256 == tar_plan_digest(str(whole.plan_sha256)) != whole.plan_sha256
        same = {name: getattr(whole, name) for name in ("files", "sizes", "plan_sha256")}
        assert record.model_copy(update=same) == whole
        entry = next(entry for entry in index_of(shards).dataset.observations if entry.key == key)
        assert entry.digest == digest


def test_the_index_names_licence_manifest_digests_and_groups(folders: Path, shards: Path, manifest: Path) -> None:
    index = index_of(shards)
    described = Dataset(folders).record
    assert described is not None
    assert index.dataset.manifest == manifest.read_text()
    for field in ("licence", "attributions", "backends", "provenance", "manifest_sha256", "name", "version"):
        assert getattr(index.dataset, field) == getattr(described, field), field
    assert [shard.key for shard in index.shards] == sorted(KEYS)
    assert {shard.key: shard.group for shard in index.shards} == {
        key: FIRST if key.startswith("part_3") else None for key in KEYS
    }
    for shard in index.shards:
        assert (shards / shard.file).stat().st_size == shard.bytes
        assert files.sha256_file(shards / shard.file) == shard.sha256
        assert shard.samples == FRAMES
    assert {"rgb.png", "binaural.wav", "mask.png", "instances.png", "categories.png", "json"} <= set(index.members)


def test_the_webdataset_package_skips_the_record(shards: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    path = shards / f"{SECOND}.tar"
    found = [decode_sample(sample) for sample in webdataset.WebDataset([str(path)], shardshuffle=False)]
    assert [sample["__key__"] for sample in found] == [f"{SECOND}/frame_{number:03d}" for number in range(FRAMES)]
    assert all(sample["rgb"].shape == (3, 96, 96) for sample in found)


def test_siblings_have_the_same_pictures(shards: Path) -> None:
    first, second = (tars.read_tar(shards / f"{key}.tar").files for key in (FIRST, SECOND))
    for name, data in first.items():
        if name.startswith(("input/", "instance_masks/", "depth/")):
            assert second[name] == data
    assert any(second[name] != data for name, data in first.items() if name.startswith("semantic_masks/"))


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_workers_or_on_what_was_there(manifest: Path, shards: Path, tmp_path: Path) -> None:
    assert run(manifest, tmp_path / "two", "--workers", "2", *EXTRAS).exit_code == 0
    assert tree_digest(tmp_path / "two") == tree_digest(shards)
    # A sibling whose first is not there renders the pictures itself.
    assert run(manifest, tmp_path / "alone", "--only", SECOND, *EXTRAS).exit_code == 0
    assert files.sha256_file(tmp_path / "alone" / f"{SECOND}.tar") == files.sha256_file(shards / f"{SECOND}.tar")


def test_a_damaged_tar_is_made_again_and_whole_ones_are_kept(manifest: Path, shards: Path, tmp_path: Path) -> None:
    root = shutil.copytree(shards, tmp_path / "tars")
    (root / SHARDS_JSON).unlink()
    cut, bent = root / f"{FIRST}.tar", root / f"{KEYS[0]}.tar"
    cut.write_bytes(cut.read_bytes()[:-30_000])
    data = bytearray(bent.read_bytes())
    data[len(data) // 2] ^= 1
    bent.write_bytes(data)
    kept = (root / f"{SECOND}.tar").stat().st_ino
    (root / "part_3/box/kitchen/.1.new-host-1-abc.partial").write_bytes(b"half")
    assert "cut short after" in tars.find_fault(cut)
    assert "not those that its digest is of" in tars.find_fault(bent)
    done = run(manifest, root, "--workers", "1", *EXTRAS)
    assert "2 made, 4 kept, 0 failed" in done.output
    assert tree_digest(root) == tree_digest(shards)
    assert (root / f"{SECOND}.tar").stat().st_ino == kept


@pytest.mark.parametrize("at", [0.0, 0.001, 0.2, 0.7, 0.999])
def test_a_tar_cut_anywhere_is_detected(shards: Path, tmp_path: Path, at: float) -> None:
    path, data = tmp_path / "cut.tar", (shards / f"{SECOND}.tar").read_bytes()
    for count in {int(at * len(data)), len(data) - 1, len(data) - tarfile.RECORDSIZE}:
        path.write_bytes(data[:count])
        with pytest.raises(Avs3dError, match=r"cut\.tar: cut short after [0-9,]+ bytes.*run `avs3d generate` again"):
            tars.read_tar(path)
    path.write_bytes(data + bytes(512))
    assert "bytes after its end" in tars.find_fault(path)
    path.write_bytes(data)
    assert tars.find_fault(path) == ""


def test_another_plan_or_another_form_is_refused(manifest: Path, shards: Path, folders: Path, tmp_path: Path) -> None:
    done = run(manifest, shards, "--frames", "8", *EXTRAS)
    assert "1.tar: was generated with other options or versions" in str(done.exception)
    for root, form, name in ((shards, "folders", "shards.json"), (folders, "tar", "dataset.json")):
        done = run(manifest, root, *EXTRAS, form=form)
        assert f"{root}: holds {name}, the index of another --format; choose another folder with -o" in str(
            done.exception
        )
    root = shutil.copytree(shards, tmp_path / "interrupted")
    (root / SHARDS_JSON).unlink()
    done = run(manifest, root, *EXTRAS, form="folders")
    assert "1.tar: was generated with another --format" in str(done.exception)


@pytest.mark.slow
def test_a_run_goes_on_after_kill_9(manifest: Path, shards: Path, tmp_path: Path) -> None:
    root = tmp_path / "tars"
    command = [sys.executable, "-m", "avs3d_bench", "generate", manifest, "-o", root, "--audio", "analytic"]
    command += ["--format", "tar", "--workers", "1", *EXTRAS]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(list(map(str, command)), env=environment, start_new_session=True)
    deadline = time.monotonic() + 240
    while not list(root.glob("part_*/*/*/*.tar")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    there = len(list(root.glob("part_*/*/*/*.tar")))
    assert 0 < there < len(KEYS)
    assert not (root / SHARDS_JSON).exists()
    done = run(manifest, root, "--workers", "1", *EXTRAS)
    assert f"{len(KEYS) - there} made, {there} kept, 0 failed" in done.output
    assert tree_digest(root) == tree_digest(shards)


def check(root: Path, *options: str) -> tuple[int, str]:
    """Exit status of `avs3d validate`, and what it says on one line."""
    done = CliRunner().invoke(validate, [str(root), *options])
    said = done.output if done.exception is None or isinstance(done.exception, SystemExit) else str(done.exception)
    return done.exit_code, " ".join(said.split())


def test_validate_checks_index_and_tars(shards: Path, tmp_path: Path) -> None:
    code, said = check(shards)
    assert code == 0
    assert said.endswith(": 0 errors, 0 warnings, 0 notes in 6 observations (7 files, shallow): valid")
    assert check(shards, "--deep")[0] == 0
    root = shutil.copytree(shards, tmp_path / "tars")
    bent, cut, lost = (root / f"{key}.tar" for key in (KEYS[0], FIRST, SECOND))
    data = bytearray(bent.read_bytes())
    data[-40_000] ^= 1
    bent.write_bytes(data)
    cut.write_bytes(cut.read_bytes()[:-512])
    lost.rename(lost.with_name("77.tar"))
    assert check(root)[0] == 1
    found = {problem.path: problem.message for problem in check_tars(root).problems}
    assert found.pop("part_3/box/kitchen/2.tar") == "missing"
    assert found.pop("part_3/box/kitchen/77.tar").startswith("not in shards.json")
    assert re.fullmatch(r"[0-9,]+ bytes, expected [0-9,]+", found.pop("part_3/box/kitchen/1.tar"))
    assert found == {}, "one bit is seen by the deep check alone"
    deep = {problem.path: problem.message for problem in check_tars(root, deep=True).problems}
    assert deep[f"{KEYS[0]}.tar"].startswith("its bytes are not those that its digest is of")


def test_validate_says_what_else_a_folder_holds(shards: Path, folders: Path, tmp_path: Path) -> None:
    root = shutil.copytree(shards, tmp_path / "tars")
    (root / SHARDS_JSON).unlink()
    assert "tars without shards.json: run the same `avs3d generate` again, it goes on" in check(root)[1]
    write_webdataset(folders, tmp_path / "export", only=(SILENT,), workers=1)
    assert "shards.json is that of an export; the same `avs3d export` command" in check(tmp_path / "export")[1]
    with pytest.raises(UsageError, match=r"holds tar shards \(shards\.json\), no folders of observations"):
        Dataset(shards)


def test_the_benchmark_reads_every_frame_of_tars_and_of_folders(shards: Path, folders: Path) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("webdataset")
    from benchmarks.bench_loading import MEMBERS, measure_stream, tar_loader

    tars_of_all = sorted(shards.rglob("*.tar"))
    assert sum(len(batch["rgb"]) for batch in tar_loader(tars_of_all, 0)) == FRAMES * len(KEYS)
    figures = measure_stream(shards, 0, 1)
    assert {f"decode {name} (ms of a core per frame)" for name in MEMBERS} < figures.keys()
    assert figures["decode rgb.png (ms of a core per frame)"] < figures["decode all of it (ms of a core per frame)"]
    assert measure_stream(folders, 0, 1)["DataLoader over folders, 0 workers (frames/s)"] > 1


def test_facts_are_json_of_a_frame(shards: Path) -> None:
    members: dict[str, Any] = json.loads(samples(shards / f"{SILENT}.tar")[f"{SILENT}/frame_008"]["json"])
    assert (members["key"], members["split"], members["category"]) == (SILENT, "test", None)
    assert members["audible"] == []
    assert members["group"] == FIRST
