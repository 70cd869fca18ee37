"""The tar files of a folder of shards, held against its `shards.json`: where a reader starts.

Two commands write such folders. `avs3d export webdataset` writes ``train-000000.tar``, …: one split in each.
`avs3d generate --format tar` writes ``part_1/<scan>/<room>/<index>.tar``: one observation in each, its train and test
frames together.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avs3d_bench import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.observation_index import FORMAT, ObservationShardIndex
from avs3d_bench.exports.samples import check_split
from avs3d_bench.exports.shards import PARTIAL, SHARDS_JSON, ShardIndex
from avs3d_bench.files import read_json, read_record

_SPLITS = ("train", "test", "unlisted")


@dataclass(frozen=True)
class ShardFile:
    """A tar file of samples.

    Attributes:
        path: of the file.
        split: of its frames; None if it holds train and test frames.
        sha256: as `shards.json` says; None where there is no such file.
    """

    path: Path
    split: str | None = None
    sha256: str | None = None


def shard_paths(root: str | Path, split: str = "all") -> list[str]:
    """The paths of the tars below a folder, as `webdataset.WebDataset` takes them.

    Args:
        root: a folder of `avs3d export webdataset` or of `avs3d generate --format tar`.
        split: ``train``, ``test`` or ``all``.

    Raises:
        UsageError: if there are none, or tars do not keep the splits apart.
        Avs3dError: if the folder is not what its `shards.json` says.
    """
    wanted, found = check_split(split), list_shards(root)
    if wanted != "all" and any(shard.split is None for shard in found):
        raise UsageError(
            f"{root}: its tars hold train and test frames together, as avs3d generate --format tar writes them; take "
            f'all and the samples with facts["split"] == "{wanted}", or export shards by split: avs3d export webdataset'
        )
    chosen = [str(shard.path) for shard in found if wanted in ("all", shard.split)]
    if not chosen:
        raise UsageError(f"{root}: no shards of split {wanted}; the export may have been made with another --split")
    return chosen


def list_shards(root: str | Path) -> tuple[ShardFile, ...]:
    """The tars below a folder, in order of their names. Contents are not read.

    Without `shards.json` every tar is taken; with it, those that it lists, and it must list all.

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
    split = name.partition("-")[0]
    return split if split in _SPLITS else None


def _listed(folder: Path, names: list[str]) -> tuple[ShardFile, ...]:
    index = folder / SHARDS_JSON
    found = read_json(index)
    kind = found.get("format") if isinstance(found, dict) else None
    if kind == "huggingface":
        raise UsageError(
            f"{folder}: Parquet files of avs3d export huggingface, expected tars of avs3d export webdataset"
        )
    shards: list[Any] = (
        list(read_record(index, ObservationShardIndex).shards)
        if kind == FORMAT
        else list(read_record(index, ShardIndex).shards)
    )
    counts = Counter(shard.file for shard in shards)
    for name in sorted({*counts, *names}):
        if counts[name] > 1:
            raise Avs3dError(f"{index}: lists {name} twice; write the shards again")
        if not counts[name]:
            raise Avs3dError(f"{folder / name}: not listed in {SHARDS_JSON}; move it away, or write the shards again")
        if name not in names:
            raise Avs3dError(f"{folder / name}: missing, though {SHARDS_JSON} lists it; copy it, or write it again")
    for shard in shards:
        size = (folder / shard.file).stat().st_size
        if size != shard.bytes:
            raise Avs3dError(
                f"{folder / shard.file}: {size:,} bytes, expected {shard.bytes:,}; copy it again, or write it again"
            )
    ordered = sorted(shards, key=lambda shard: str(shard.file))
    return tuple(ShardFile(folder / one.file, getattr(one, "split", None), one.sha256) for one in ordered)
