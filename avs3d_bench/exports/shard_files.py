"""The tar files of a folder of shards, held against its `shards.json`: where a reader starts.

`avs3d export webdataset` and `avs3d generate --format webdataset` write ``train-000000.tar``, …: one split in each.
"""

from __future__ import annotations

import tarfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.samples import check_split
from avs3d_bench.exports.shards import PARTIAL, SHARDS_JSON, ShardIndex
from avs3d_bench.formats.files import open_regular, read_record

_SPLITS = ("train", "test", "unlisted")


@dataclass(frozen=True)
class ShardFile:
    """A tar file of samples.

    Attributes:
        path: of the file.
        split: of its frames; None if neither the index nor its name tells.
        sha256: as `shards.json` says; None where there is no such file.
    """

    path: Path
    split: str | None = None
    sha256: str | None = None


def shard_paths(root: str | Path, split: str = "all") -> list[str]:
    """The paths of the tars below a folder, as `webdataset.WebDataset` takes them.

    Args:
        root: a folder of `avs3d export webdataset` or of `avs3d generate --format webdataset`.
        split: ``train``, ``test`` or ``all``.

    Raises:
        UsageError: if there are none, or the names of tars without an index do not tell the split.
        Avs3dError: if the folder is not what its `shards.json` says.

    Examples:
        >>> _ = write_webdataset("data/demo", "tars", workers=1)
        >>> shard_paths("tars"), shard_paths("tars", split="test")
        (['tars/test-000000.tar', 'tars/train-000000.tar'], ['tars/test-000000.tar'])
    """
    wanted, found = check_split(split), list_shards(root)
    if wanted != "all" and any(shard.split is None for shard in found):
        raise UsageError(
            f"{root}: has no {SHARDS_JSON}, and tars whose names do not tell the split; expected {wanted}-000000.tar, …"
        )
    chosen = [str(shard.path) for shard in found if wanted in ("all", shard.split)]
    if not chosen:
        raise UsageError(f"{root}: no shards of split {wanted}; the export may have been made with another --split")
    return chosen


def list_shards(root: str | Path) -> tuple[ShardFile, ...]:
    """The tars below a folder, in order of their names. Contents are not read.

    Without `shards.json` every tar is taken, as where several runs have folders of their own; with it, those that it
    lists, and it must list all.

    Raises:
        UsageError: if there are none; the message says what is there instead.
        Avs3dError: if `shards.json` is damaged, or does not list just the tars that are there, with their sizes.
    """
    folder = Path(root)
    if not folder.is_dir():
        raise UsageError(f"{root}: no such folder; expected the folder of the shards, not a file or a pattern")
    below = [path.relative_to(folder) for path in folder.rglob("*.tar")]
    names = sorted(name.as_posix() for name in below if not any(part.startswith(".") for part in name.parts))
    if (folder / SHARDS_JSON).exists():
        return _listed(folder, names)
    if (folder / PARTIAL).is_dir():
        raise UsageError(f"{root}: an export that was interrupted; run the same command again, it goes on")
    if not names:
        dataset = (folder / layout.DATASET_JSON).exists()
        found, source = ("a dataset of folders", root) if dataset else ("another folder", "DATASET")
        raise UsageError(f"{root}: no shards (*.tar), but {found}; write them: avs3d export webdataset {source} -o DIR")
    return tuple(ShardFile(folder / name, _split_of(name)) for name in names)


def _split_of(name: str) -> str | None:
    split = name.rpartition("/")[2].partition("-")[0]
    return split if split in _SPLITS else None


def _listed(folder: Path, names: list[str]) -> tuple[ShardFile, ...]:
    path = folder / SHARDS_JSON
    index = read_record(path, ShardIndex)
    if index.format == "huggingface":
        raise UsageError(
            f"{folder}: Parquet files of avs3d export huggingface, expected tars of avs3d export webdataset"
        )
    counts = Counter(shard.file for shard in index.shards)
    for name in sorted({*counts, *names}):
        if counts[name] > 1:
            raise Avs3dError(f"{path}: lists {name} twice; write the shards again")
        if not counts[name]:
            raise Avs3dError(f"{folder / name}: not listed in {SHARDS_JSON}; move it away, or write the shards again")
        if name not in names:
            raise Avs3dError(f"{folder / name}: missing, though {SHARDS_JSON} lists it; copy it, or write it again")
    for shard in index.shards:
        size = (folder / shard.file).stat().st_size
        if size != shard.bytes:
            raise Avs3dError(
                f"{folder / shard.file}: {size:,} bytes, expected {shard.bytes:,}; copy it again, or write it again"
            )
    ordered = sorted(index.shards, key=lambda shard: shard.file)
    return tuple(ShardFile(folder / shard.file, shard.split, shard.sha256) for shard in ordered)


def read_samples(path: Path) -> Iterator[dict[str, Any]]:
    """The samples of a shard, undecoded, as the `webdataset` package yields them: ``__key__`` and bytes by member name.

    Raises:
        Avs3dError: if the file is missing or no tar, or a member is cut short or there twice.
    """
    with open_regular(path) as stream:
        try:
            with tarfile.open(fileobj=stream, mode="r:") as archive:
                files = ((info.name, archive.extractfile(info)) for info in archive if not info.name.startswith("__"))
                members = ((name, data.read()) for name, data in files if data is not None)
                for key, group in groupby(members, key=lambda member: _key_and_name(member[0])[0]):
                    sample: dict[str, Any] = {"__key__": key}
                    for full, data in group:
                        name = _key_and_name(full)[1]
                        if name in sample:
                            raise Avs3dError(f"{path}: {full} is in the shard twice; write it again")
                        sample[name] = data
                    yield sample
        except (OSError, tarfile.TarError) as error:
            raise Avs3dError(f"{path}: cannot be read as a shard ({error}); it may be cut short") from None


def _key_and_name(full: str) -> tuple[str, str]:
    """The sample's key and the member's name: everything before and after the first point of the last part."""
    folder, _, last = full.rpartition("/")
    stem, _, name = last.partition(".")
    return f"{folder}/{stem}", name
