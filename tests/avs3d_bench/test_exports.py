"""Exports: WebDataset shards, a folder for `datasets`, a Croissant description, a dataset card."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import random
import signal
import subprocess
import sys
import tarfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import (
    decode_sample,
    shards,
    waveform,
    write_card,
    write_croissant,
    write_huggingface,
    write_webdataset,
)
from avs3d_bench.exports.card import CardFacts, card_text, gather, hub_licence
from avs3d_bench.exports.cli import export
from avs3d_bench.exports.samples import Sample, samples_of
from avs3d_bench.exports.shards import SHARDS_JSON, ShardIndex
from avs3d_bench.exports.webdataset import header, room
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from tests.support import tiny
from tests.support.shared import SharedDataset

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def ours(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(extras=True)


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_release(tmp_path_factory.mktemp("exports") / "release", style="files")


def tree(folder: Path) -> dict[str, str]:
    """sha256 of everything below a folder, hidden things too."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def members(folder: Path) -> dict[str, bytes]:
    """Every member of every shard."""
    out: dict[str, bytes] = {}
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as archive:
            for entry in archive:
                stream = archive.extractfile(entry)
                assert stream is not None
                assert (entry.uid, entry.gid, entry.uname, entry.gname, entry.mtime) == (0, 0, "", "", 0)
                out[entry.name] = stream.read()
    return out


# --- WebDataset -----------------------------------------------------------------------------------------------------


def test_members_are_the_files_themselves(ours: Path, tmp_path: Path):
    write_webdataset(ours, tmp_path / "out", extras=["depth", "mono", "rirs"], workers=1)
    held = members(tmp_path / "out")
    base, stem = ours / tiny.MULTI, f"{tiny.MULTI}/frame_003"
    for member, file in {
        "rgb.png": "input/frame_003.png",
        "mask.png": "semantic_masks/frame_003.png",
        "instances.png": "instance_masks/frame_003.png",
        "depth.png": "depth/frame_003.png",
        "binaural.wav": "audio_clips_binaural/frame_3.wav",
        "mono.wav": "audio_clips_mono/frame_3.wav",
        "rir.npz": "rirs/frame_3.npz",
    }.items():
        assert held[f"{stem}.{member}"] == (base / file).read_bytes(), member
    assert len(held) == 2 * tiny.FRAMES * 8


def test_facts_are_those_of_the_frame(ours: Path, tmp_path: Path):
    write_webdataset(ours, tmp_path / "out", workers=1)
    facts = json.loads(members(tmp_path / "out")[f"{tiny.SINGLE}/frame_004.json"])
    frame = Dataset(ours)[tiny.SINGLE].frames[4]
    assert frame.record is not None
    assert facts["category"] == "microwave"
    assert facts["split"] == "train"
    assert facts["azimuth"] == pytest.approx(frame.record.azimuth, rel=1e-8)
    np.testing.assert_allclose(facts["camera_to_world"], frame.pose.matrix, atol=1e-8)
    np.testing.assert_allclose(facts["intrinsics"], [[32, 0, 32], [0, 32, 32], [0, 0, 1]])
    assert [(i["id"], i["category"], i["sounding"]) for i in facts["instances"]] == [
        (1, "microwave", True),
        (2, "oven", False),
    ]


def test_the_release_has_what_it_has(release: Path, tmp_path: Path):
    index = write_webdataset(release, tmp_path / "out", extras=["depth"], workers=1)
    held = members(tmp_path / "out")
    assert {name.partition(".")[2] for name in held} == {"rgb.png", "binaural.wav", "mask.png", "json"}
    facts = json.loads(held[f"{tiny.SINGLE}/frame_004.json"])
    assert facts["category"] is None
    assert facts["azimuth"] is None
    np.testing.assert_allclose(facts["position"], tiny.path_of()[4].position, atol=1e-9)
    assert index.licence is None
    assert set(index.members) == {"rgb.png", "binaural.wav", "mask.png", "json"}


def test_shards_keep_to_their_size_split_and_order(ours: Path, tmp_path: Path):
    index = write_webdataset(ours, tmp_path / "out", shard_mb=1.2, workers=1)
    assert len(index.shards) > 4
    order: list[str] = []
    for shard in index.shards:
        path = tmp_path / "out" / shard.file
        with tarfile.open(path) as archive:
            keys = list(dict.fromkeys(name.partition(".")[0] for name in archive.getnames()))
        assert shard.file.startswith(f"{shard.split}-")
        assert (keys[0], keys[-1], len(keys)) == (shard.first, shard.last, shard.samples)
        assert path.stat().st_size == shard.bytes
        assert shard.bytes <= 1.2e6 + tarfile.RECORDSIZE + 2 * tarfile.BLOCKSIZE
        assert media.sha256_file(path) == shard.sha256
        order += keys
    train, test = order[:16], order[16:]
    assert train == sorted(train)
    assert test == [f"{key}/frame_{i:03d}" for key in (tiny.SINGLE, tiny.MULTI) for i in (0, 8)]
    assert index.splits["train"].samples == 16
    assert index.splits["test"].observations == 2
    assert index.attributions[0].asset == "box"


def test_a_split_alone(ours: Path, tmp_path: Path):
    index = write_webdataset(ours, tmp_path / "out", split="test", only=["part_2/*"], workers=1)
    assert [shard.file for shard in index.shards] == ["test-000000.tar"]
    assert index.splits["test"].samples == 2


def test_the_plan_knows_the_room_of_a_sample(ours: Path):
    for sample in samples_of(Dataset(ours)[tiny.SINGLE], "all"):
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
            for name, data in [*((m.name, m.read()) for m in sample.members), ("json", sample.json)]:
                info = tarfile.TarInfo(f"{sample.key}.{name}")
                info.size = len(data)
                archive.addfile(info, io.BytesIO(data))
            assert archive.offset == room(sample)


def test_long_names_get_a_header_of_their_own():
    name = f"part_1/{'a' * 140}/kitchen/1/frame_000.rgb.png"
    data = header(name, 0) + bytes(1024)
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        assert archive.getnames() == [name]
    assert header(name, 0) == header(name, 0)


@pytest.mark.slow
def test_bytes_do_not_depend_on_workers_or_on_the_day(ours: Path, tmp_path: Path):
    write_webdataset(ours, tmp_path / "one", shard_mb=2, workers=1)
    copy = tiny.clone(ours, tmp_path / "copy")
    write_webdataset(copy, tmp_path / "two", shard_mb=2, workers=2)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "one").glob("*.tar")}
    write_webdataset(ours, tmp_path / "one", shard_mb=2, workers=1)
    assert {path: path.stat().st_mtime_ns for path in before} == before, "whole shards are not written again"
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_what_is_not_whole_is_made_again(ours: Path, tmp_path: Path):
    out = tmp_path / "out"
    write_webdataset(ours, out, shard_mb=1.2, workers=1)
    want = tree(out)
    shards = sorted(out.glob("train-*.tar"))
    shards[0].unlink()
    shards[1].write_bytes(shards[1].read_bytes()[:1000])
    flipped = bytearray(shards[2].read_bytes())
    flipped[5000] ^= 1
    shards[2].write_bytes(flipped)
    write_webdataset(ours, out, shard_mb=1.2, workers=1)
    assert tree(out) == want


def test_shards_of_another_cut_are_removed(ours: Path, tmp_path: Path):
    write_webdataset(ours, tmp_path / "want", shard_mb=50, workers=1)
    write_webdataset(ours, tmp_path / "out", shard_mb=1, workers=1)
    write_webdataset(ours, tmp_path / "out", shard_mb=50, workers=1)
    assert tree(tmp_path / "out") == tree(tmp_path / "want")


def test_a_changed_dataset_changes_its_shards_alone(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data")
    write_webdataset(root, tmp_path / "out", shard_mb=1.2, workers=1)
    before = tree(tmp_path / "out")
    tiny.edit_record(root, tiny.MULTI, lambda data: data["frames"][9].update(rms_left=0.5))
    write_webdataset(root, tmp_path / "out", shard_mb=1.2, workers=1)
    after = tree(tmp_path / "out")
    changed = {name for name in before if before[name] != after[name]}
    last = max(name for name in before if name.startswith("train-"))
    assert changed == {SHARDS_JSON, last}


def test_a_damaged_file_is_named(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data")
    path = root / tiny.SINGLE / "semantic_masks/frame_002.png"
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    tiny.replace(path, bytes(data))
    with pytest.raises(Avs3dError, match=r"frame_002\.png: its sha256 is not .* validate --deep"):
        write_webdataset(root, tmp_path / "out", workers=1)
    assert not (tmp_path / "out" / SHARDS_JSON).exists(), "an export without its index is not whole"
    path.unlink()
    with pytest.raises(Avs3dError, match=r"frame_002\.png: missing"):
        write_webdataset(root, tmp_path / "out", workers=1)


@pytest.mark.parametrize("kind", ["ours", "release"])
def test_a_listed_frame_without_its_picture_is_no_export(tmp_path: Path, kind: str):
    """It would come out one frame short, and nobody would know."""
    write = tiny.write_dataset if kind == "ours" else tiny.write_release
    root = write(tmp_path / "data")
    (root / tiny.SINGLE / "input/frame_003.png").unlink()
    with pytest.raises(Avs3dError, match=r"camera_splits\.json: lists frame_003, whose picture is missing"):
        write_webdataset(root, tmp_path / "out", workers=1)
    assert not (tmp_path / "out").exists()


def test_halves_of_killed_runs_do_not_pile_up(ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    out, seen = tmp_path / "out", []
    (out / ".partial").mkdir(parents=True)
    half = out / ".partial/train-000000.tar.1"
    half.write_bytes(b"half")
    write = shards.write_shard

    def watched(*given: Any) -> shards.ShardRecord:
        seen.append(half.exists())
        return write(*given)

    monkeypatch.setattr(shards, "write_shard", watched)
    write_webdataset(ours, out, workers=1)
    assert seen == [False, False], "they are gone before anything is written"


def test_an_index_names_nothing_outside_of_its_folder(ours: Path, tmp_path: Path):
    """What an index lists and the plan does not is removed: only ever shards."""
    write_webdataset(ours, tmp_path / "out", workers=1)
    (tmp_path / "diary.txt").write_text("dear")
    path = tmp_path / "out" / SHARDS_JSON
    for name in ("../diary.txt", str(tmp_path / "diary.txt")):
        data = media.read_json(path)
        data["shards"][0]["file"] = name
        path.write_text(json.dumps(data))
        with pytest.raises(Avs3dError, match=r"shards\.json: .*file"):
            write_webdataset(ours, tmp_path / "out", workers=1)
    assert (tmp_path / "diary.txt").read_text() == "dear"


def test_foreign_folders_are_left_alone(ours: Path, tmp_path: Path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/diary.txt").write_text("dear")
    with pytest.raises(UsageError, match="not empty and no export of ours"):
        write_webdataset(ours, tmp_path / "mine", workers=1)
    with pytest.raises(UsageError, match="lies inside the dataset"):
        write_webdataset(ours, ours / "shards", workers=1)
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="a file; expected a folder"):
        write_webdataset(ours, tmp_path / "file", workers=1)
    assert (tmp_path / "mine/diary.txt").read_text() == "dear"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "val"}, "split 'val': expected one of train, test, all"),
        ({"extras": ["smell"]}, "--with smell: expected one of depth, mono, rirs"),
        ({"only": ["part_9/*"]}, "none of 2 observations matches part_9"),
        ({"shard_mb": float("nan")}, "--shard-size nan"),
        ({"shard_mb": 0}, "--shard-size 0"),
    ],
)
def test_arguments_that_mean_nothing(ours: Path, tmp_path: Path, options: dict[str, Any], message: str):
    with pytest.raises(UsageError, match=message):
        write_webdataset(ours, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


PROGRAM = """
from avs3d_bench.cli import run
from avs3d_bench.exports.cli import export
run(export, program="avs3d export")
"""


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-c", PROGRAM, *map(str, arguments)]


@pytest.mark.slow
def test_killed_at_any_time_and_run_again(ours: Path, tmp_path: Path):
    """The same bytes as an undisturbed run, whatever the moment; shards that were done are kept."""
    rng, out = random.Random(3), tmp_path / "out"
    line = command("webdataset", ours, "-o", out, "--shard-size", "0.4", "--workers", "1")
    start = time.perf_counter()
    subprocess.run(line, check=True, capture_output=True, cwd=ROOT)
    usual, want = time.perf_counter() - start, tree(out)
    killed = 0
    for _ in range(5):
        subprocess.run(["rm", "-rf", str(out)], check=True)
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT)
        # The interpreter starts for most of the time; the moments lie where files are written.
        begin = time.perf_counter()
        while not out.exists() and process.poll() is None and time.perf_counter() - begin < 20 * usual:
            time.sleep(0.001)
        time.sleep(rng.uniform(0, 0.25 * usual))
        process.send_signal(signal.SIGKILL)
        killed += process.wait() == -signal.SIGKILL
        write_webdataset(ours, out, shard_mb=0.4, workers=1)
        assert tree(out) == want
    assert killed >= 2, "the moments were too late to mean anything"


def test_a_full_disk_is_one_line(ours: Path, tmp_path: Path):
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))\n"
    ignore = "import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    out = tmp_path / "out"
    line = [sys.executable, "-c", limit + ignore + PROGRAM, "webdataset", str(ours), "-o", str(out), "--workers", "1"]
    done = subprocess.run(line, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "train-000000.tar: cannot write: file too large" in done.stderr
    assert not [path for path in out.rglob("*") if path.suffix == ".tar"]
    write_webdataset(ours, out, workers=1)
    write_webdataset(ours, tmp_path / "want", workers=1)
    assert tree(out) == tree(tmp_path / "want")


def test_two_at_once_on_one_folder(ours: Path, tmp_path: Path):
    from avs3d_bench.formats.staging import hold

    lock = hold(tmp_path / "out/.partial", tmp_path / "out")
    try:
        with pytest.raises(Avs3dError, match=rf"process {os.getpid()} on .* is writing it"):
            write_webdataset(ours, tmp_path / "out", workers=1)
    finally:
        os.close(lock)
    write_webdataset(ours, tmp_path / "out", workers=1)


def test_a_damaged_index_is_named_and_another_format_refused(ours: Path, tmp_path: Path):
    write_webdataset(ours, tmp_path / "out", workers=1)
    index = media.read_record(tmp_path / "out" / SHARDS_JSON, ShardIndex)
    media.write_json(tmp_path / "out" / SHARDS_JSON, index.model_copy(update={"format": "huggingface"}))
    with pytest.raises(UsageError, match="holds an export of kind huggingface"):
        write_webdataset(ours, tmp_path / "out", workers=1)
    (tmp_path / "out" / SHARDS_JSON).write_text("{")
    with pytest.raises(Avs3dError, match=r"shards\.json: .*expected a ShardIndex"):
        write_webdataset(ours, tmp_path / "out", workers=1)


def test_the_webdataset_package_reads_them(ours: Path, tmp_path: Path):
    webdataset = pytest.importorskip("webdataset", reason="webdataset is not installed: pip install webdataset")
    index = write_webdataset(ours, tmp_path / "out", shard_mb=1.2, extras=["depth", "mono", "rirs"], workers=1)
    urls = [str(tmp_path / "out" / shard.file) for shard in index.shards if shard.split == "train"]
    samples = list(webdataset.WebDataset(urls, shardshuffle=False, empty_check=False).map(decode_sample))
    assert len(samples) == 16
    for sample in samples:
        key, _, name = sample["__key__"].rpartition("/")
        frame = next(f for f in Dataset(ours)[key].frames if f.name == name)
        np.testing.assert_array_equal(sample["rgb"], frame.rgb().transpose(2, 0, 1))
        np.testing.assert_array_equal(sample["mask"], frame.mask())
        np.testing.assert_array_equal(sample["instance_ids"], frame.instance_ids())
        np.testing.assert_array_equal(sample["binaural"], frame.audio())
        np.testing.assert_array_equal(sample["mono"], frame.mono())
        np.testing.assert_array_equal(sample["depth"], frame.depth())
        np.testing.assert_array_equal(sample["impulse_response"], frame.impulse_response())
        assert sample["facts"]["frame"] == name
    with pytest.raises(Avs3dError, match=r"k\.rgb\.png: cannot be decoded"):
        decode_sample({"__key__": "k", "rgb.png": b"no"})


def test_a_sample_changed_between_plan_and_writing_is_caught(ours: Path):
    sample: Sample = samples_of(Dataset(ours)[tiny.SINGLE], "test")[0]
    member = sample.members[0]
    assert hashlib.sha256(member.read()).hexdigest() == member.sha256
    assert member.size == len(member.read())


# --- Hugging Face ---------------------------------------------------------------------------------------------------


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """`datasets`, offline."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'avs3d-bench[exports]'")
    for name, value in {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "HF_HOME": str(tmp_path / "hub")}.items():
        monkeypatch.setenv(name, value)
    datasets = pytest.importorskip("datasets", reason="datasets is not installed: pip install 'avs3d-bench[exports]'")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True, raising=False)
    datasets.disable_progress_bars()
    return datasets


@pytest.mark.slow
def test_datasets_loads_the_folder_offline(ours: Path, tmp_path: Path, hub: Any):
    write_huggingface(ours, tmp_path / "out", shard_mb=2, extras=["depth", "mono", "rirs"], workers=1)
    loaded = hub.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    assert {split: len(rows) for split, rows in loaded.items()} == {"train": 16, "test": 4}
    for row in loaded["train"]:
        frame = next(f for f in Dataset(ours)[row["key"]].frames if f.name == row["frame"])
        assert frame.record is not None
        np.testing.assert_array_equal(np.asarray(row["rgb"]), frame.rgb())
        np.testing.assert_array_equal(np.asarray(row["mask"]) == 255, frame.mask())
        np.testing.assert_array_equal(np.asarray(row["instance_ids"]), frame.instance_ids())
        np.testing.assert_array_equal(np.asarray(row["depth"]) / np.float32(1000), frame.depth())
        samples, rate = waveform(row["binaural"])
        assert rate == 44_100
        np.testing.assert_array_equal(samples, frame.audio())
        np.testing.assert_allclose(row["camera_to_world"], frame.pose.matrix)
        assert row["azimuth"] == frame.record.azimuth
        assert row["split"] == "train"
    table = hub.load_dataset(str(tmp_path / "out"), "observations", cache_dir=str(tmp_path / "cache"))["observations"]
    assert table["key"][:] == [tiny.SINGLE, tiny.MULTI]
    assert table[1]["instances"][1]["licence"] == "CC0-1.0"
    assert table[1]["instances"][1]["sounding"]


def test_the_release_loads_with_nothing_in_place_of_what_it_lacks(release: Path, tmp_path: Path, hub: Any):
    write_huggingface(release, tmp_path / "out", split="test", workers=1)
    rows = hub.load_dataset(str(tmp_path / "out"), split="test", cache_dir=str(tmp_path / "cache"))
    assert len(rows) == 4
    assert rows[0]["instance_ids"] is None
    assert rows[0]["category"] is None
    assert rows[0]["rgb"].size == (64, 64)


@pytest.mark.slow
def test_parquet_files_have_the_same_bytes_for_any_number_of_workers(ours: Path, tmp_path: Path, hub: Any):
    write_huggingface(ours, tmp_path / "one", shard_mb=3, workers=1)
    write_huggingface(ours, tmp_path / "two", shard_mb=3, workers=2)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")
    assert {"README.md", "observations.parquet", "data/train-00001-of-00002.parquet"} <= tree(tmp_path / "one").keys()
    card = (tmp_path / "one/README.md").read_text(encoding="utf-8")
    assert "`audio_clips_binaural/`" in card
    assert "`audio_clips_mono/`" not in card, "the dataset has it, this export has not"
    (tmp_path / "one/data/train-00001-of-00002.parquet").write_bytes(b"")
    write_huggingface(ours, tmp_path / "one", shard_mb=3, workers=1)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_waveform_says_what_it_cannot_read():
    with pytest.raises(Avs3dError, match="expected a mapping with bytes"):
        waveform({"path": "x.wav"})
    with pytest.raises(Avs3dError, match=r"x\.wav: damaged sound"):
        waveform({"path": "x.wav", "bytes": b"RIFF"})


# --- Croissant ------------------------------------------------------------------------------------------------------


def croissant(root: Path, folder: Path) -> Path:
    """A copy of the dataset with its description."""
    copy = tiny.clone(root, folder)
    write_croissant(copy, copy / "croissant.json", url="https://example.org/data", published="2026-01-31")
    return copy / "croissant.json"


@pytest.fixture
def mlc() -> Any:
    return pytest.importorskip("mlcroissant", reason="mlcroissant is not installed: pip install 'avs3d-bench[exports]'")


def test_mlcroissant_finds_nothing_wrong(ours: Path, release: Path, tmp_path: Path, mlc: Any):
    for name, root in (("ours", ours), ("release", release)):
        issues = mlc.Dataset(str(croissant(root, tmp_path / name))).metadata.ctx.issues
        assert not issues.errors
        assert not issues.warnings, issues.report()


def test_records_come_out_of_the_description(ours: Path, tmp_path: Path, mlc: Any):
    dataset = mlc.Dataset(str(croissant(ours, tmp_path / "data")))
    entries = list(dataset.records("observations"))
    assert [row["observations/key"].decode() for row in entries] == [tiny.SINGLE, tiny.MULTI]
    frames = list(dataset.records("frames"))
    assert len(frames) == 2 * tiny.FRAMES
    truth = Dataset(ours)[tiny.MULTI].frames[3]
    assert truth.record is not None
    row = frames[tiny.FRAMES + 3]
    assert row["frames/observation"].decode() == tiny.MULTI
    assert row["frames/name"].decode() == "frame_003"
    assert row["frames/azimuth"] == pytest.approx(truth.record.azimuth)
    assert row["frames/position"] == pytest.approx(truth.record.position)
    picture = list(dataset.records("rgb"))[tiny.FRAMES + 3]
    assert (picture["rgb/observation"].decode(), picture["rgb/frame"].decode()) == (tiny.MULTI, "frame_003")
    np.testing.assert_array_equal(np.asarray(picture["rgb/content"]), truth.rgb())
    mask = list(dataset.records("masks"))[tiny.FRAMES + 3]
    np.testing.assert_array_equal(np.asarray(mask["masks/content"])[..., 0] == 255, truth.mask())


def test_records_of_the_release(release: Path, tmp_path: Path, mlc: Any):
    dataset = mlc.Dataset(str(croissant(release, tmp_path / "data")))
    assert [row["observations/key"] for row in dataset.records("observations")] == [tiny.SINGLE, tiny.MULTI]
    assert len(list(dataset.records("rgb"))) == 2 * tiny.FRAMES
    assert {record.uuid for record in dataset.metadata.record_sets} == {
        "observations", "rgb", "masks", "binaural", "mono",
    }  # fmt: skip


def test_mlcroissant_notices_a_changed_dataset_json(ours: Path, tmp_path: Path, mlc: Any):
    path = croissant(ours, tmp_path / "data")
    file = path.parent / "dataset.json"
    tiny.replace(file, file.read_bytes() + b" ")
    with pytest.raises(mlc.GenerationError, match=r"dataset\.json"):
        list(mlc.Dataset(str(path)).records("observations"))


def test_the_description_names_licence_authors_and_paper(ours: Path, tmp_path: Path):
    data = json.loads(croissant(ours, tmp_path / "data").read_text())
    assert data["license"] == ["https://spdx.org/licenses/CC0-1.0.html", "CC0-1.0"]
    assert "Sokolov" in data["citeAs"]
    assert "2411.02236" in data["citeAs"]
    assert data["version"] == "1.0.0"
    assert data["isBasedOn"][0]["name"] == "box"
    assert [key for key in data if key.startswith("rai:")]


def test_descriptions_are_companions_not_parts(ours: Path, tmp_path: Path):
    """Beside the data, neither changes what `avs3d validate` says; over the data, neither is written."""
    root = croissant(ours, tmp_path / "data").parent
    write_card(root, root / "README.md")
    report = validate(root)
    assert report.valid
    assert not report.problems
    for write in (write_card, write_croissant):
        for name in ("dataset.json", f"{tiny.SINGLE}/observation.json", "part_1/README.md"):
            with pytest.raises(UsageError, match=r"would change .*, which is read|this command has not written it"):
                write(root, root / name)
        with pytest.raises(UsageError, match="found a folder, expected a file"):
            write(root, tmp_path)


def test_words_that_are_no_address_and_no_date(ours: Path, tmp_path: Path):
    root = tiny.clone(ours, tmp_path / "data")
    with pytest.raises(UsageError, match="--url 'example': expected http"):
        write_croissant(root, root / "c.json", url="example")
    for date in ("yesterday", "2026-02-30", "20260131"):
        with pytest.raises(UsageError, match="expected YYYY-MM-DD"):
            write_croissant(root, root / "c.json", published=date)


# --- Dataset card ---------------------------------------------------------------------------------------------------


def split_card(text: str) -> tuple[dict[str, Any], str]:
    _, head, body = text.split("---\n", 2)
    return yaml.safe_load(head), body


def test_the_card_counts_what_is_there(ours: Path, tmp_path: Path):
    write_card(ours, tmp_path / "README.md")
    head, body = split_card((tmp_path / "README.md").read_text(encoding="utf-8"))
    assert head["license"] == "cc0-1.0"
    assert head["size_categories"] == ["n<1K"]
    assert "configs" not in head
    frames = [frame.record for frame in Dataset(ours)[tiny.MULTI].frames]
    visible = sum(record.visible_pixels > 0 for record in frames if record)
    assert f"| `part_2`: several identical instances, one sounds | 1 | 10 | 8 | 2 | {visible} |" in body
    assert "| microwave | 1 | 1 | 2 |" in body
    assert "Silent objects that stand by: microwave (1), oven (1)." in body
    assert "| box | CC0-1.0 | avs3d-bench | procedural |" in body
    assert "2411.02236" in body
    pictures = sum(path.stat().st_size for path in ours.glob("*/*/*/*/input/*.png"))
    assert f"| `input/`: RGB picture, 8 bit | 20 | {pictures / 1e6:,.1f} |" in body


@pytest.mark.parametrize(
    ("licence", "identifier"),
    [
        ("CC0-1.0", "cc0-1.0"),
        ("CC-BY-NC-4.0 (the sound was computed with an engine for research)", "cc-by-nc-4.0"),
        ("CC-BY-NC-4.0 (the sound); CC-BY-SA-4.0 asks for the same licence", "other"),
        ("Apache-2.0; CC-BY-NC-4.0 forbids commercial use", "other"),
        ("CC0-1.0 AND CC-BY-NC-4.0", "other"),
        ("Apache-2.0 (homes) and CC-BY-NC-4.0 (sound)", "other"),
        ("unknown", "other"),
        ("", "other"),
        (None, "other"),
    ],
)
def test_a_licence_with_more_terms_is_not_shortened_to_its_first(licence: str | None, identifier: str):
    assert hub_licence(licence) == identifier


@pytest.mark.parametrize(
    ("frames", "name"),
    [(999, "n<1K"), (1000, "1K<n<10K"), (4080, "1K<n<10K"), (999_999, "100K<n<1M"), (12_000_000, "10M<n<100M")],
)
def test_sizes_are_those_the_hub_knows(ours: Path, frames: int, name: str):
    facts = gather(Dataset(ours), [tiny.SINGLE])
    one = dataclasses.replace(facts.observations[0], frames=frames)
    head, _ = split_card(card_text(CardFacts(facts.name, facts.record, (one,), facts.sizes)))
    assert head["size_categories"] == [name]


def test_the_card_of_the_release_claims_no_licence(release: Path, tmp_path: Path):
    write_card(release, tmp_path / "README.md")
    head, body = split_card((tmp_path / "README.md").read_text(encoding="utf-8"))
    assert head["license"] == "other"
    assert "states no licence" in body
    assert "sounding category" not in body


# --- The command line -----------------------------------------------------------------------------------------------


def test_the_four_commands(ours: Path, tmp_path: Path, hub: Any):
    runner = CliRunner()
    for name, output in (
        ("webdataset", "shards"), ("huggingface", "hub"), ("card", "README.md"),
    ):  # fmt: skip
        more = ["--workers", "1"] if name in ("webdataset", "huggingface") else []
        result = runner.invoke(export, [name, str(ours), "-o", str(tmp_path / output), *more])
        assert result.exit_code == 0, result.output
        assert str(tmp_path / output) in result.output
        assert (tmp_path / output).exists()


def test_a_croissant_description_belongs_into_the_dataset(ours: Path, tmp_path: Path):
    """Readers take its paths as relative to its own folder: elsewhere nothing would be found."""
    root = tiny.clone(ours, tmp_path / "data")
    runner = CliRunner()
    there = runner.invoke(export, ["croissant", str(root), "-o", str(root / "croissant.json")])
    assert (there.exit_code, there.output) == (0, f"{root / 'croissant.json'}\n")
    elsewhere = runner.invoke(export, ["croissant", str(root), "-o", str(tmp_path / "c.json")])
    assert isinstance(elsewhere.exception, UsageError)
    assert f"write it into the dataset's root: {root / 'croissant.json'}" in str(elsewhere.exception)
    assert not (tmp_path / "c.json").exists()


def test_the_package_loads_without_its_extras(ours: Path):
    code = """
import sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("torch", "datasets", "pyarrow", "mlcroissant", "webdataset"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Block())
import avs3d_bench.exports, avs3d_bench.exports.cli, avs3d_bench.exports.huggingface
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports import decode_sample, waveform, write_card, write_croissant, write_huggingface
for use in (lambda: avs3d_bench.exports.AVS3DDataset, lambda: write_huggingface(sys.argv[1], sys.argv[2])):
    try:
        use()
    except Avs3dError as error:
        print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(ours), "unused"], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "torch is not installed; this export needs it: pip install torch",
        "datasets is not installed; this export needs it: pip install 'avs3d-bench[exports]'",
    ]
