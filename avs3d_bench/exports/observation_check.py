"""`avs3d validate` of what `avs3d generate --format tar` wrote: the index, and every tar that it lists."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.observation_index import FORMAT, ObservationShard, ObservationShardIndex
from avs3d_bench.exports.shards import SHARDS_JSON
from avs3d_bench.exports.webdataset import decode_sample
from avs3d_bench.files import read_json, read_record, sha256_bytes, sha256_file
from avs3d_bench.parallel import process_each
from avs3d_bench.report import Problem, Report, ordered

_TARS = f"part_*/*/*/*{observation_tar.SUFFIX}"


def holds_tars(root: Path) -> bool:
    """Whether a folder has tars of observations, or the index of shards."""
    return (root / SHARDS_JSON).is_file() or next(root.glob(_TARS), None) is not None


def check_tars(root: Path, *, deep: bool = False, workers: int | None = None, progress: bool = False) -> Report:
    """Check the index, and of each tar its size, its record, and with ``deep`` its digests and every member.

    Args:
        root: the folder.
        deep: read every tar whole and decode its samples.
        workers: processes of the deep check; None: one per core.
        progress: show a bar on stderr.

    Raises:
        UsageError: if the folder is no finished output of `avs3d generate --format tar`.
        Avs3dError: if the index is damaged.
    """
    if not (root / SHARDS_JSON).is_file():
        raise UsageError(f"{root}: tars without {SHARDS_JSON}: run the same `avs3d generate` again, it goes on")
    found = read_json(root / SHARDS_JSON)
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise UsageError(
            f"{root}: {SHARDS_JSON} is that of an export; the same `avs3d export` command checks its shards"
        )
    index = read_record(root / SHARDS_JSON, ObservationShardIndex)
    entries = {entry.key: entry.digest for entry in index.dataset.observations}
    problems = [
        Problem("error", shard.file, f"{shard.key} is not in the dataset's record of {SHARDS_JSON}")
        for shard in index.shards
        if shard.key not in entries
    ]
    listed = {shard.file for shard in index.shards}
    for path in sorted(root.glob(_TARS)):
        if (name := path.relative_to(root).as_posix()) not in listed:
            problems.append(Problem("error", name, f"not in {SHARDS_JSON}; run the same `avs3d generate` again"))
    pairs = [(shard, entries.get(shard.key, "")) for shard in index.shards]
    look = partial(_check_tar, root, deep)
    for _, mine in process_each(look, pairs, workers=workers if deep else 1, label="checking tars", progress=progress):
        problems += mine
    return Report(root, deep, len(index.shards), len(index.shards) + 1, ordered(problems))


def _check_tar(root: Path, deep: bool, pair: tuple[ObservationShard, str]) -> list[Problem]:
    shard, digest = pair
    try:
        return [Problem("error", shard.file, message) for message in _faults(root / shard.file, deep, shard, digest)]
    except Avs3dError as error:
        return [Problem("error", shard.file, str(error).removeprefix(f"{root / shard.file}: "))]


def _faults(path: Path, deep: bool, shard: ObservationShard, digest: str) -> Iterator[str]:
    """Yield the faults of a tar. A fault that makes the rest unreadable is the last one."""
    if not path.is_file():
        yield "missing"
        return
    size = path.stat().st_size
    if size != shard.bytes:
        yield f"{size:,} bytes, expected {shard.bytes:,}"
        return
    record, found = observation_tar.read_head(path)
    if (record.key, record.group, len(record.frames)) != (shard.key, shard.group, shard.samples):
        yield f"its record is not that of {shard.key} as {SHARDS_JSON} lists it"
    if found != digest:
        yield f"the sha256 of its record is not the one in {SHARDS_JSON}"
    if not deep:
        return
    fault = observation_tar.find_fault(path)
    if fault:
        yield fault
        return
    if sha256_file(path) != shard.sha256:
        yield f"its sha256 is not the one in {SHARDS_JSON}"
    held = observation_tar.read_tar(path)
    for name, data in held.files.items():
        if sha256_bytes(data) != record.files.get(name):
            yield f"{name}: its sha256 is not the one in the record"
    samples: dict[str, dict[str, bytes]] = {}
    for member, file in observation_tar.members_of(record):
        place, _, last = member.rpartition("/")
        stem, _, kind = last.partition(".")
        if file is not None:
            samples.setdefault(f"{place}/{stem}", {})[kind] = held.files.get(file, b"")
    for key, members in samples.items():
        decode_sample({"__key__": key} | members)
