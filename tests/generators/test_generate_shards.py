"""`avs3d generate --format webdataset`: the shards of an export, two per observation, and what an index says."""

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

from avs3d_bench.cli import validate
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import decode_sample, write_webdataset
from avs3d_bench.exports import observation_tar as tars
from avs3d_bench.exports.shard_check import check_shards
from avs3d_bench.exports.shard_files import list_shards, read_samples, shard_paths
from avs3d_bench.exports.shards import SHARDS_JSON, ShardIndex
from avs3d_bench.formats import files
from generators.cli import generate
from generators.observation.tar_output import tar_plan_digest
from tests.support.homes import tree_digest, write_manifest

pytestmark = pytest.mark.slow

pytest.importorskip("embreex", reason="the renderer of the generate extra")

ROOT = Path(__file__).parents[2]
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


def run(manifest: Path, root: Path, *options: str, form: str = "webdataset") -> Result:
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


def index_of(root: Path) -> ShardIndex:
    return files.read_record(root / SHARDS_JSON, ShardIndex)


def shard(root: Path, key: str, split: str = "test") -> Path:
    """The shard of an observation: its number is the observation's place in the manifest."""
    return root / f"{split}-{KEYS.index(key):06d}.tar"


def test_an_observation_is_two_files_and_nothing_else_is_left(shards: Path) -> None:
    there = {path.relative_to(shards).as_posix() for path in shards.rglob("*")}
    assert there == {SHARDS_JSON, *(shard(shards, key, split).name for key in KEYS for split in ("train", "test"))}


def test_the_samples_are_those_of_an_export(folders: Path, shards: Path, tmp_path: Path) -> None:
    write_webdataset(folders, tmp_path / "export", extras=("depth", "stems", "rirs"), workers=1)
    exported = samples(*sorted((tmp_path / "export").glob("*.tar")))
    generated = samples(*sorted(shards.glob("*.tar")))
    assert generated.keys() == exported.keys()
    assert len(generated) == FRAMES * len(KEYS)
    for split in ("train", "test"):  # every reader meets the same frames in the same order
        read = [
            [sample["__key__"] for path in shard_paths(root, split) for sample in read_samples(Path(path))]
            for root in (shards, tmp_path / "export")
        ]
        assert sorted(read[0]) == read[1]
        assert list(samples(*map(Path, shard_paths(shards, split)))) == read[0]
        assert {json.loads(generated[key]["json"])["split"] for key in read[0]} == {split}
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
        record, digest = tars.read_head(shard(shards, key))
        assert tars.read_head(shard(shards, key, "train")) == (record, digest)
        whole = Dataset(folders)[key].record
        assert whole is not None
        assert record.files.items() < whole.files.items()
        folders_left_out = {name.partition("/")[0] for name in whole.files.keys() - record.files.keys()}
        assert folders_left_out <= {
            "images",
            "sparse",
            "gt_3d",
            "audio_clips_mono",
            layout.SPLITS_JSON,
            layout.TOP_VIEW,
        }
        assert record.plan_sha256 == tar_plan_digest(str(whole.plan_sha256)) != whole.plan_sha256
        same = {name: getattr(whole, name) for name in ("files", "sizes", "plan_sha256")}
        assert record.model_copy(update=same) == whole
        generated = index_of(shards).generated
        assert generated is not None
        entry = next(entry for entry in generated.observations if entry.key == key)
        assert entry.digest == digest


def test_the_index_names_licence_manifest_and_digests(folders: Path, shards: Path, manifest: Path) -> None:
    index = index_of(shards)
    described = Dataset(folders).record
    assert described is not None
    assert index.generated is not None
    assert index.generated.manifest == manifest.read_text()
    for field in ("licence", "attributions", "backends", "provenance", "manifest_sha256", "name", "version"):
        assert getattr(index.generated, field) == getattr(described, field), field
    assert (index.dataset, index.dataset_version, index.licence) == (
        described.name, described.version, described.licence,
    )  # fmt: skip
    assert [(found.split, found.first) for found in index.shards] == [
        *(("train", f"{key}/frame_001") for key in KEYS), *(("test", f"{key}/frame_000") for key in KEYS),
    ]  # fmt: skip
    for found in index.shards:
        assert (shards / found.file).stat().st_size == found.bytes
        assert files.sha256_file(shards / found.file) == found.sha256
        assert found.samples == {"train": FRAMES - 2, "test": 2}[found.split]
    assert {name: (s.shards, s.samples, s.observations) for name, s in index.splits.items()} == {
        "train": (6, 6 * (FRAMES - 2), 6), "test": (6, 12, 6),
    }  # fmt: skip
    assert {"rgb.png", "binaural.wav", "mask.png", "instances.png", "categories.png", "json"} <= set(index.members)


def test_the_webdataset_package_skips_the_record(shards: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    path = shard(shards, SECOND, "train")
    found = [decode_sample(sample) for sample in webdataset.WebDataset([str(path)], shardshuffle=False)]
    assert [sample["__key__"] for sample in found] == [f"{SECOND}/frame_{number:03d}" for number in range(1, 8)]
    assert all(sample["rgb"].shape == (3, 96, 96) for sample in found)


def test_siblings_have_the_same_pictures(shards: Path) -> None:
    first, second = (
        {k: v for split in tars.SPLITS for k, v in tars.read_tar(shard(shards, key, split)).files.items()}
        for key in (FIRST, SECOND)
    )
    assert sum(name.startswith("input/") for name in first) == FRAMES
    for name, data in first.items():
        if name.startswith(("input/", "instance_masks/", "depth/")):
            assert second[name] == data
    assert any(second[name] != data for name, data in first.items() if name.startswith("semantic_masks/"))


def test_the_bytes_do_not_depend_on_workers_or_on_what_was_there(manifest: Path, shards: Path, tmp_path: Path) -> None:
    assert run(manifest, tmp_path / "two", "--workers", "2", *EXTRAS).exit_code == 0
    assert tree_digest(tmp_path / "two") == tree_digest(shards)
    # A sibling whose first is not there renders the pictures itself.
    assert run(manifest, tmp_path / "alone", "--only", SECOND, "--workers", "1", *EXTRAS).exit_code == 0
    for split in tars.SPLITS:
        alone = shard(tmp_path / "alone", SECOND, split)
        assert files.sha256_file(alone) == files.sha256_file(shard(shards, SECOND, split))


def test_a_damaged_tar_is_made_again_and_whole_ones_are_kept(manifest: Path, shards: Path, tmp_path: Path) -> None:
    root = shutil.copytree(shards, tmp_path / "tars")
    (root / SHARDS_JSON).unlink()
    cut, bent = shard(root, FIRST), shard(root, KEYS[0], "train")
    cut.write_bytes(cut.read_bytes()[:-30_000])
    data = bytearray(bent.read_bytes())
    data[len(data) // 2] ^= 1
    bent.write_bytes(data)
    kept = shard(root, SECOND).stat().st_ino
    shard(root, BOTH, "train").unlink()
    (root / ".test-000002.new-host-1-abc.partial").write_bytes(b"half")
    assert "cut short after" in tars.find_fault(cut)
    assert "not those that its digest is of" in tars.find_fault(bent)
    done = run(manifest, root, "--workers", "1", *EXTRAS)
    assert "3 made, 3 kept, 0 failed" in done.output
    assert tree_digest(root) == tree_digest(shards)
    assert shard(root, SECOND).stat().st_ino == kept


@pytest.mark.parametrize("at", [0.0, 0.001, 0.2, 0.7, 0.999])
def test_a_tar_cut_anywhere_is_detected(shards: Path, tmp_path: Path, at: float) -> None:
    path, data = tmp_path / "cut.tar", shard(shards, SECOND).read_bytes()
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
    assert "test-000000.tar: was generated with other options or versions" in str(done.exception)
    for root, form, name in ((shards, "folders", "shards.json"), (folders, "webdataset", "dataset.json")):
        done = run(manifest, root, *EXTRAS, form=form)
        assert f"{root}: holds {name}, which is of another --format; choose another folder with -o" in str(
            done.exception
        )
    root = shutil.copytree(shards, tmp_path / "interrupted")
    (root / SHARDS_JSON).unlink()
    done = run(manifest, root, *EXTRAS, form="folders")
    assert "holds test-000000.tar, which is of another --format" in str(done.exception)


def test_shards_of_an_export_and_of_the_generator_do_not_replace_each_other(
    manifest: Path, shards: Path, folders: Path, tmp_path: Path
) -> None:
    before = tree_digest(shards)
    with pytest.raises(UsageError, match="holds the shards of `avs3d generate`; choose another folder"):
        write_webdataset(folders, shards, workers=1)
    assert tree_digest(shards) == before
    write_webdataset(folders, tmp_path / "export", only=(SILENT,), workers=1)
    exported = tree_digest(tmp_path / "export")
    assert "shards.json: exists, and this command has not written it" in str(
        run(manifest, tmp_path / "export", *EXTRAS).exception
    )
    assert tree_digest(tmp_path / "export") == exported
    (tmp_path / "export" / SHARDS_JSON).unlink()
    (tmp_path / "export" / "test-000000.tar").unlink()
    done = run(manifest, tmp_path / "export", "--workers", "1", *EXTRAS)
    assert "train-000000.tar: does not begin with __avs3d__/observation.json" in str(done.exception)


def test_a_manifest_grows_at_its_end(manifest: Path, shards: Path, tmp_path: Path) -> None:
    import yaml

    root = shutil.copytree(shards, tmp_path / "tars")
    document = yaml.safe_load(manifest.read_text())
    document["observations"] = document["observations"][1:]
    other = manifest.with_name("fewer.yaml")
    other.write_text(yaml.safe_dump(document, sort_keys=False))
    done = run(other, root, *EXTRAS)
    assert f"test-000000.tar: holds {KEYS[0]}, but {KEYS[1]} has this number in the manifest" in str(done.exception)
    assert tree_digest(root) == tree_digest(shards)


def test_the_rest_of_an_attempt_is_removed(manifest: Path, shards: Path, tmp_path: Path) -> None:
    """The train shard gets its name first: without the test shard there is no observation."""
    root = shutil.copytree(shards, tmp_path / "tars")
    (root / SHARDS_JSON).unlink()
    shard(root, KEYS[0]).unlink()
    assert run(manifest, root, "--workers", "1", "--only", "part_3/*", *EXTRAS).exit_code == 0
    assert not shard(root, KEYS[0], "train").exists()
    assert len(list_shards(root)) == 10


def test_a_run_goes_on_after_kill_9(manifest: Path, shards: Path, tmp_path: Path) -> None:
    root = tmp_path / "tars"
    command = [sys.executable, "-m", "avs3d_bench", "generate", manifest, "-o", root, "--audio", "analytic"]
    command += ["--format", "webdataset", "--workers", "1", *EXTRAS]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(list(map(str, command)), env=environment, start_new_session=True)
    deadline = time.monotonic() + 240
    while not list(root.glob("test-*.tar")) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    there = len(list(root.glob("test-*.tar")))
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
    assert said.endswith(": 0 errors, 0 warnings, 0 notes in 6 observations (13 files, shallow): valid")
    assert check(shards, "--deep")[0] == 0
    root = shutil.copytree(shards, tmp_path / "tars")
    bent, cut, lost = (shard(root, key) for key in (KEYS[0], FIRST, SECOND))
    data = bytearray(bent.read_bytes())
    data[-40_000] ^= 1
    bent.write_bytes(data)
    cut.write_bytes(cut.read_bytes()[:-512])
    lost.rename(lost.with_name("test-000077.tar"))
    assert check(root)[0] == 1
    found = {problem.path: problem.message for problem in check_shards(root).problems}
    assert found.pop(lost.name) == "missing"
    assert found.pop("test-000077.tar").startswith("not in shards.json")
    assert re.fullmatch(r"[0-9,]+ bytes, expected [0-9,]+", found.pop(cut.name))
    assert found == {}, "one bit is seen by the deep check alone"
    deep = {problem.path: problem.message for problem in check_shards(root, deep=True).problems}
    assert deep[bent.name].startswith("its bytes are not those that its digest is of")


def test_validate_says_what_else_a_folder_holds(shards: Path, folders: Path, tmp_path: Path) -> None:
    root = shutil.copytree(shards, tmp_path / "tars")
    (root / SHARDS_JSON).unlink()
    assert "shards without shards.json: run the command that writes them again, it goes on" in check(root)[1]
    (tmp_path / "hub").mkdir()
    index = json.loads((shards / SHARDS_JSON).read_text()) | {"format": "huggingface"}
    (tmp_path / "hub" / SHARDS_JSON).write_text(json.dumps(index))
    assert "that of an export of kind huggingface; the same `avs3d export` command" in check(tmp_path / "hub")[1]
    with pytest.raises(UsageError, match=r"holds tar shards \(shards\.json\), no folders of observations"):
        Dataset(shards)


def test_validate_checks_the_shards_of_an_export(folders: Path, tmp_path: Path) -> None:
    root = tmp_path / "export"
    write_webdataset(folders, root, only=(SILENT, FIRST), workers=1)
    assert check(root, "--deep")[1].endswith("0 notes in 2 observations (3 files, deep): valid")
    path = root / "train-000000.tar"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert check(root)[0] == 0
    code, said = check(root, "--deep")
    assert code == 1
    assert "train-000000.tar: its sha256 is not the one in shards.json" in said


def test_the_benchmark_reads_every_frame_of_tars_and_of_folders(shards: Path, folders: Path) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("webdataset")
    from benchmarks.bench_loading import MEMBERS, measure_stream, tar_loader

    tars_of_all = sorted(shards.glob("*.tar"))
    assert sum(len(batch["rgb"]) for batch in tar_loader(tars_of_all, 0)) == FRAMES * len(KEYS)
    figures = measure_stream(shards, 0, 1)
    assert {f"decode {name} (ms of a core per frame)" for name in MEMBERS} < figures.keys()
    assert figures["decode rgb.png (ms of a core per frame)"] < figures["decode all of it (ms of a core per frame)"]
    assert measure_stream(folders, 0, 1)["DataLoader over folders, 0 workers (frames/s)"] > 1


def test_facts_are_json_of_a_frame(shards: Path) -> None:
    members: dict[str, Any] = json.loads(samples(shard(shards, SILENT))[f"{SILENT}/frame_008"]["json"])
    assert (members["key"], members["split"], members["category"]) == (SILENT, "test", None)
    assert members["audible"] == []
    assert members["group"] == FIRST
