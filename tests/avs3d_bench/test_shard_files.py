"""Folders of shards as readers meet them: whole, empty ones, damaged ones; each a clear line."""

from __future__ import annotations

import json
import re
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import shard_paths, write_webdataset
from avs3d_bench.exports.shard_files import list_shards, read_samples
from baselines.listener import shards as listener
from tests.support import tiny_scenes


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset and its shards, one for each split."""
    place = tmp_path_factory.mktemp("shards")
    tiny_scenes.write_part_3(place / "data", frames=9, size=32)
    write_webdataset(place / "data", place / "shards", workers=1)
    return place


@pytest.fixture
def folder(source: Path, tmp_path: Path) -> Path:
    return shutil.copytree(source / "shards", tmp_path / "shards")


def test_shards_are_found_by_split(folder: Path) -> None:
    assert [Path(path).name for path in shard_paths(folder, "train")] == ["train-000000.tar"]
    assert [Path(path).name for path in shard_paths(folder, "test")] == ["test-000000.tar"]
    assert sorted(shard_paths(folder)) == sorted([*shard_paths(folder, "train"), *shard_paths(folder, "test")])
    (folder / "shards.json").unlink()
    assert [Path(path).name for path in shard_paths(folder, "train")] == ["train-000000.tar"], "by its name alone"
    shutil.copytree(folder, folder / "another-run")
    assert len(shard_paths(folder, "train")) == 2, "of several runs, each in a folder of its own"


def test_tars_whose_names_do_not_tell_the_split_are_not_guessed(tmp_path: Path, folder: Path) -> None:
    tar = tmp_path / "tars" / "part_3" / "flat" / "kitchen" / "1.tar"
    tar.parent.mkdir(parents=True)
    shutil.copy(folder / "train-000000.tar", tar)
    assert shard_paths(tmp_path / "tars") == [str(tar)]
    with pytest.raises(UsageError, match=r"names do not tell the split; expected train-000000\.tar"):
        shard_paths(tmp_path / "tars", "train")


def test_samples_are_those_of_an_independent_reader(folder: Path) -> None:
    """Grouped as the `webdataset` package does: the key is the path up to the first point of its last part."""
    for path in sorted(folder.glob("*.tar")):
        expected: dict[str, dict[str, bytes]] = {}
        with tarfile.open(path) as archive:
            for info in archive:
                match = re.fullmatch(r"((?:.*/)?[^/.]+)\.([^/]*)", info.name)
                stream = archive.extractfile(info)
                assert match is not None
                assert stream is not None
                expected.setdefault(match[1], {"__key__": match[1]})[match[2]] = stream.read()  # type: ignore[dict-item]
        assert list(read_samples(path)) == list(expected.values())
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(Avs3dError, match=r"cannot be read as a shard|cut short"):
            list(read_samples(path))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda place, source: place / "missing", "no such folder"),
        (
            lambda place, source: place / "train-*.tar",
            "no such folder; expected the folder of the shards, not a file or a",
        ),
        (lambda place, source: place, "no shards"),
        (lambda place, source: source / "data", "but a dataset of folders; write them: avs3d export webdataset"),
    ],
)
def test_where_there_are_none_a_line_says_what_to_do(
    tmp_path: Path, source: Path, make: Callable[[Path, Path], Path], says: str
) -> None:
    for read in (shard_paths, list_shards):
        with pytest.raises(UsageError, match=re.escape(says)):
            read(make(tmp_path, source))
    (tmp_path / "only").mkdir()
    shutil.copy(source / "shards" / "train-000000.tar", tmp_path / "only")
    with pytest.raises(UsageError, match="no shards of split test"):
        shard_paths(tmp_path / "only", "test")


def truncated_index(folder: Path) -> None:
    text = (folder / "shards.json").read_text()
    (folder / "shards.json").write_text(text[: len(text) // 2])


def nested_index(folder: Path) -> None:
    (folder / "shards.json").write_text("[" * 100_000)


def empty_index(folder: Path) -> None:
    (folder / "shards.json").write_text("{}")


def listed_twice(folder: Path) -> None:
    index = json.loads((folder / "shards.json").read_text())
    index["shards"] *= 2
    (folder / "shards.json").write_text(json.dumps(index))


def elsewhere(folder: Path) -> None:
    index = json.loads((folder / "shards.json").read_text())
    index["shards"][0]["file"] = "../train-000000.tar"
    (folder / "shards.json").write_text(json.dumps(index))


def lost(folder: Path) -> None:
    (folder / "train-000000.tar").unlink()


def surplus(folder: Path) -> None:
    shutil.copy(folder / "train-000000.tar", folder / "train-000001.tar")


def cut(folder: Path) -> None:
    path = folder / "train-000000.tar"
    path.write_bytes(path.read_bytes()[:-4096])


def one_bit(folder: Path) -> None:
    path = folder / "train-000000.tar"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (truncated_index, "shards.json"), (nested_index, "shards.json"), (empty_index, "shards.json"),
        (elsewhere, "shards.json"), (listed_twice, "lists .* twice"), (lost, "train-000000.tar: missing"),
        (surplus, "train-000001.tar: not listed"), (cut, r"train-000000.tar: .* bytes, expected"),
        (one_bit, r"train-000000.tar: sha256 .* as in shards.json"),
    ],
)  # fmt: skip
def test_the_training_does_not_start_on_a_damaged_folder(
    folder: Path, tmp_path: Path, damage: Callable[[Path], None], says: str
) -> None:
    damage(folder)
    with pytest.raises(Avs3dError, match=says) as caught:
        listener.read_store(folder, tmp_path / "cache", workers=1)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "cache").exists()


def rewritten(source: Path, target: Path, *, twice: str = "", zeros: bool = False) -> None:
    """A tar without an index: with a member twice, or whose last member is silence and whose end is cut off."""
    with tarfile.open(source) as old, tarfile.open(target, "w") as new:
        for member in old:
            copies = 2 if twice and member.name.endswith(twice) else 1
            for _ in range(copies):
                new.addfile(member, old.extractfile(member))
        if zeros:
            silence = tarfile.TarInfo("part_3/flat/kitchen/9/frame_000.silence")
            silence.size = 4096
            with open("/dev/zero", "rb") as stream:
                new.addfile(silence, stream)
            end = new.offset
    if zeros:
        with target.open("r+b") as stream:
            stream.truncate(end)


def test_a_member_that_is_there_twice_is_refused(source: Path, tmp_path: Path) -> None:
    (tmp_path / "shards").mkdir()
    rewritten(source / "shards" / "train-000000.tar", tmp_path / "shards" / "train-000000.tar", twice="mask.png")
    with pytest.raises(Avs3dError, match=r"train-000000.tar: .*mask.png is in the shard twice"):
        listener.read_store(tmp_path / "shards", tmp_path / "cache", workers=1)


def test_a_frame_in_two_shards_is_refused(source: Path, tmp_path: Path) -> None:
    (tmp_path / "shards").mkdir()
    for number in range(2):
        shutil.copy(source / "shards" / "train-000000.tar", tmp_path / "shards" / f"train-00000{number}.tar")
    with pytest.raises(Avs3dError, match=r"train-000001.tar: .* is in .*train-000000.tar as well"):
        listener.read_store(tmp_path / "shards", tmp_path / "cache", workers=1)


def test_silence_is_no_end_of_a_shard(source: Path, tmp_path: Path) -> None:
    (tmp_path / "shards").mkdir()
    rewritten(source / "shards" / "train-000000.tar", tmp_path / "shards" / "train-000000.tar", zeros=True)
    with pytest.raises(Avs3dError, match=r"cut short, its end mark is missing"):
        listener.read_store(tmp_path / "shards", tmp_path / "cache", workers=1)


def test_an_interrupted_export_is_named(folder: Path) -> None:
    (folder / "shards.json").unlink()
    (folder / ".partial").mkdir()
    with pytest.raises(UsageError, match="interrupted; run the same command again"):
        list_shards(folder)


def test_the_store_of_a_run_replaces_no_other_folder(source: Path, tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "letters.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"cache: holds letters.txt, which is no part"):
        listener.read_store(source / "shards", tmp_path / "cache", workers=1)
    assert (tmp_path / "cache" / "letters.txt").read_text() == "mine"
