"""`avs3d validate` of WebDataset shards: the index, and every shard that it lists."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from avs3d_bench.commands.report import Problem, Report, ordered
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.observation_index import describe_shard
from avs3d_bench.exports.shard_files import read_samples
from avs3d_bench.exports.shards import SHARDS_JSON, ShardIndex, ShardRecord
from avs3d_bench.exports.webdataset import decode_sample
from avs3d_bench.formats.files import read_record, sha256_bytes, sha256_file
from avs3d_bench.runtime.parallel import process_each

_SHARDS = "*-[0-9]*.tar"


def holds_shards(root: Path) -> bool:
    """Whether a folder has shards, or the index of shards."""
    return (root / SHARDS_JSON).is_file() or next(root.glob(_SHARDS), None) is not None


def check_shards(root: Path, *, deep: bool = False, workers: int | None = None, progress: bool = False) -> Report:
    """Check the index, and of each shard its size, its record, and with ``deep`` its digests and every member.

    Args:
        root: the folder.
        deep: read every shard whole and decode its samples.
        workers: processes of the deep check; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if the folder holds no finished shards of `avs3d generate` or `avs3d export webdataset`.
        Avs3dError: if the index is damaged.
    """
    if not (root / SHARDS_JSON).is_file():
        raise UsageError(f"{root}: shards without {SHARDS_JSON}: run the command that writes them again, it goes on")
    index = read_record(root / SHARDS_JSON, ShardIndex)
    if index.format != "webdataset":
        raise UsageError(
            f"{root}: {SHARDS_JSON} is that of an export of kind {index.format}; the same `avs3d export` command "
            "checks its files"
        )
    problems = []
    listed = {shard.file for shard in index.shards}
    for path in sorted(root.glob(_SHARDS)):
        if path.name not in listed:
            problems.append(Problem("error", path.name, f"not in {SHARDS_JSON}; run the command that wrote it again"))
    entries = {entry.key: entry.digest for entry in index.generated.observations} if index.generated else None
    look = partial(_check_shard, root, deep, entries)
    count = workers if deep else 1
    for _, mine in process_each(look, index.shards, workers=count, label="checking shards", progress=progress):
        problems += mine
    observations = max((split.observations for split in index.splits.values()), default=0)
    return Report(root, deep, observations, len(index.shards) + 1, ordered(problems))


def _check_shard(root: Path, deep: bool, entries: dict[str, str] | None, shard: ShardRecord) -> list[Problem]:
    try:
        return [Problem("error", shard.file, message) for message in _faults(root / shard.file, deep, shard, entries)]
    except Avs3dError as error:
        return [Problem("error", shard.file, str(error).removeprefix(f"{root / shard.file}: "))]


def _faults(path: Path, deep: bool, shard: ShardRecord, entries: dict[str, str] | None) -> Iterator[str]:
    """Yield the faults of a shard. A fault that makes the rest unreadable is the last one."""
    if not path.is_file():
        yield "missing"
        return
    size = path.stat().st_size
    if size != shard.bytes:
        yield f"{size:,} bytes, expected {shard.bytes:,}"
        return
    if entries is not None:
        yield from _record_faults(path, shard, entries)
    if not deep:
        return
    fault = "" if entries is None else observation_tar.find_fault(path)
    if fault:
        yield fault
        return
    if sha256_file(path) != shard.sha256:
        yield f"its sha256 is not the one in {SHARDS_JSON}"
        return
    if entries is not None:
        held = observation_tar.read_tar(path)
        for name, data in held.files.items():
            if sha256_bytes(data) != held.record.files.get(name):
                yield f"{name}: its sha256 is not the one in the record"
    count = 0
    for sample in read_samples(path):
        decode_sample(sample)
        count += 1
    if count != shard.samples:
        yield f"{count:,} samples, expected {shard.samples:,}"


def _record_faults(path: Path, shard: ShardRecord, entries: dict[str, str]) -> Iterator[str]:
    """Yield the faults of the record of a shard that was generated; ``entries`` are digests by observation's key."""
    record, found = observation_tar.read_head(path)
    expected = describe_shard(shard.split, path, record, shard.sha256)
    if expected != shard:
        yield f"its record is not that of {shard.first.rpartition('/')[0]} as {SHARDS_JSON} lists it"
    if record.key not in entries:
        yield f"{record.key} is not in the dataset's record of {SHARDS_JSON}"
    elif found != entries[record.key]:
        yield f"the sha256 of its record is not the one in {SHARDS_JSON}"
