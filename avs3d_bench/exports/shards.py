"""Shards: a dataset cut into files of about one size, written in parallel, resumable, the same bytes every time.

While an export is under way, ``DIR/.partial/`` holds a lock, the files being written and a receipt per finished
shard. `shards.json` is written last: a folder without it is not a whole export. A rerun keeps a shard whose receipt
(or whose entry in `shards.json`) says that it was made of the same frames, files and options, and whose sha256 is
still the recorded one; every other shard of an export of the same dataset is written again. A folder with the shards
of another dataset, or with a file of a shard's name that no export of this dataset has written, is refused.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, BinaryIO, ClassVar, Literal

from pydantic import Field

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AttributionRecord, DatasetRecord, Record, Sha256, Text
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.samples import UNLISTED, Sample, SplitChoice, samples_of
from avs3d_bench.formats import media
from avs3d_bench.formats.files import os_error_line
from avs3d_bench.formats.staging import hold
from avs3d_bench.runtime.parallel import advance, process_each

SHARDS_JSON = layout.SHARDS_JSON
_SOURCE = re.compile(r"^(source_[0-9]+|background)\.")
PARTIAL = ".partial"
#: What an export that is under way is an export of, in `PARTIAL`.
_SUBJECT = "export.json"
Format = Literal["webdataset", "huggingface"]
Count = Annotated[int, Field(ge=0)]


class ShardRecord(Record):
    """One file of an export; ``plan`` is the sha256 of all that decides its contents."""

    file: Annotated[str, Field(pattern=r"^(data/)?[a-z]+-[0-9][0-9a-z.-]*$", description="below the folder")]
    split: Text
    samples: Count
    bytes: Count
    sha256: Sha256
    plan: Sha256
    first: Text = Field(description="key of the first sample")
    last: Text = Field(description="key of the last sample")


class SplitRecord(Record):
    """A split in sums."""

    shards: Count
    samples: Count
    bytes: Count
    observations: Count


class ShardIndex(Record):
    """`shards.json`; it is written last."""

    left_out: ClassVar[frozenset[str]] = frozenset({"generated"})

    format: Format
    toolkit_version: Text
    dataset: Text
    dataset_version: Text | None
    licence: Text | None
    attributions: tuple[AttributionRecord, ...]
    members: dict[str, str] = Field(description="possible members of a sample: name → description")
    splits: dict[str, SplitRecord]
    shards: tuple[ShardRecord, ...]
    generated: DatasetRecord | None = Field(
        default=None, description="only of `avs3d generate`: the record that a dataset of folders has in dataset.json"
    )


class Subject(Record):
    """The dataset, split and choice that an export holds; one folder holds one export."""

    format: Format
    dataset: Text
    dataset_version: Text | None


@dataclass(frozen=True)
class Planned:
    """A sample as far as planning needs it: its room in a shard, the sha256 of its contents, what it holds."""

    key: str
    frame: str
    split: str
    size: int
    digest: str
    members: tuple[str, ...]


@dataclass(frozen=True)
class Shard:
    """A file to be written: its name below the folder, its split, (observation, frames) in order, and its plan."""

    file: str
    split: str
    runs: tuple[tuple[str, tuple[str, ...]], ...]
    plan: str

    @property
    def samples(self) -> int:
        """How many."""
        return sum(len(frames) for _, frames in self.runs)

    @property
    def ends(self) -> tuple[str, str]:
        """Keys of the first and of the last sample."""
        (first, names), (last, others) = self.runs[0], self.runs[-1]
        return f"{first}/{names[0]}", f"{last}/{others[-1]}"


@dataclass(frozen=True)
class ShardFormat:
    """How a format cuts and writes.

    Attributes:
        format: its name in the index.
        revision: goes into every plan; it changes when the same frames shall give other bytes.
        room: bytes that a sample takes in a shard.
        write: writes samples to a stream (a function of a module: it is sent to other processes by name).
        name: file name of shard ``number`` of ``count`` of a split.
    """

    format: Format
    revision: str
    room: Callable[[Sample], int]
    write: Callable[[BinaryIO, Iterator[Sample]], None]
    name: Callable[[str, int, int], str]


def plan_observation(
    root: Path, split: SplitChoice, extras: tuple[str, ...], room: Callable[[Sample], int], key: str
) -> list[Planned]:
    """Plan the samples of an observation."""
    out = []
    for sample in samples_of(Observation(root, key), split, extras):
        digest = hashlib.sha256(sample.json)
        for member in sample.members:
            digest.update(f"{member.name} {member.sha256}\n".encode())
        names = tuple(member.name for member in sample.members)
        frame = sample.key.rpartition("/")[2]
        out.append(Planned(key, frame, sample.split, room(sample), digest.hexdigest(), names))
    return out


def cut(planned: Sequence[Planned], limit: int, style: ShardFormat) -> tuple[Shard, ...]:
    """Shards of at most ``limit`` bytes (a larger sample gets its own), never across splits, in order."""
    out: list[Shard] = []
    for split in ("train", "test", UNLISTED):
        groups: list[list[Planned]] = []
        filled = 0
        for sample in planned:
            if sample.split != split:
                continue
            if not groups or filled + sample.size > limit:
                groups.append([])
                filled = 0
            groups[-1].append(sample)
            filled += sample.size
        for number, group in enumerate(groups):
            runs: dict[str, list[str]] = {}
            for sample in group:
                runs.setdefault(sample.key, []).append(sample.frame)
            text = "\n".join([style.revision, *(f"{s.key}/{s.frame} {s.digest}" for s in group)])
            name = style.name(split, number, len(groups))
            ordered = tuple((key, tuple(frames)) for key, frames in runs.items())
            out.append(Shard(name, split, ordered, media.sha256_bytes(text.encode())))
    return tuple(out)


class _Hashing:
    """A binary stream that hashes and counts what passes; unbuffered writes may take only a part."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._hash, self.size, self.closed = stream, hashlib.sha256(), 0, False

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        self._hash.update(view)
        self.size += len(view)
        self._stream.write(view)
        return len(view)

    def tell(self) -> int:
        return self.size

    def flush(self) -> None:
        self._stream.flush()

    def close(self) -> None:
        self.closed = True

    def readable(self) -> bool:
        return False

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return False

    def hexdigest(self) -> str:
        return self._hash.hexdigest()


def write_shard(
    root: Path, folder: Path, split: SplitChoice, extras: tuple[str, ...], style: ShardFormat, shard: Shard
) -> ShardRecord:
    """Write one shard and leave its receipt.

    Raises:
        Avs3dError: if a file of the dataset is missing or damaged, or the system refuses.
    """
    partial_folder, final = folder / PARTIAL, folder / shard.file
    flat = shard.file.replace("/", "-")
    # The process in the name: one that a killed run left behind may be at the same shard for a moment.
    temporary = partial_folder / f"{flat}.{os.getpid()}"
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "wb") as raw:
            stream = _Hashing(raw)
            style.write(stream, _samples(root, split, extras, shard))  # type: ignore[arg-type]
        first, last = shard.ends
        record = ShardRecord(
            file=shard.file, split=shard.split, samples=shard.samples, bytes=stream.size, sha256=stream.hexdigest(),
            plan=shard.plan, first=first, last=last,
        )  # fmt: skip
        # The receipt first: then every file under a shard's name is known, and removed when it is no longer wanted.
        media.write_json(partial_folder / f"{flat}.json", record)
        os.replace(temporary, final)
    except OSError as error:
        raise Avs3dError(os_error_line(error, final, "write")) from error
    finally:
        with suppress(OSError):
            temporary.unlink()
    return record


def _samples(root: Path, split: SplitChoice, extras: tuple[str, ...], shard: Shard) -> Iterator[Sample]:
    done = 0
    for key, frames in shard.runs:
        for sample in samples_of(Observation(root, key), split, extras, frozenset(frames)):
            yield sample
            done += 1
            advance(done, shard.samples)


@contextmanager
def _under_way(folder: Path) -> Iterator[None]:
    """Hold ``DIR/.partial``; it stays if a run is interrupted that the next one can continue."""
    partial_folder = folder / PARTIAL
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: a file; expected a folder for the export")
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    begun = SHARDS_JSON in there or (partial_folder / _SUBJECT).is_file()
    if there - {PARTIAL} and not begun:
        raise UsageError(f"{folder}: not empty and no export of ours; choose another folder")
    try:
        lock = hold(partial_folder, folder)
    except OSError as error:
        raise Avs3dError(os_error_line(error, folder, "write")) from error
    try:
        for rest in partial_folder.iterdir():
            # Halves that killed runs left: they would fill the disk, kill by kill.
            if rest.name != "lock" and rest.suffix != ".json":
                _remove(rest)
        yield
        shutil.rmtree(partial_folder, ignore_errors=True)
    finally:
        if not any(partial_folder.glob("*.json")):
            shutil.rmtree(partial_folder, ignore_errors=True)
        os.close(lock)


def _known(folder: Path, subject: Subject) -> dict[str, ShardRecord]:
    """Receipts and index entries of an earlier export of the same, by file; receipts that cannot be read do not count.

    Raises:
        UsageError: if the folder holds an export of something else.
        Avs3dError: if its index cannot be read.
    """
    found: dict[str, ShardRecord] = {}
    if (folder / SHARDS_JSON).exists():
        index = media.read_record(folder / SHARDS_JSON, ShardIndex)
        if index.generated is not None:
            raise UsageError(f"{folder}: holds the shards of `avs3d generate`; choose another folder")
        earlier = Subject(format=index.format, dataset=index.dataset, dataset_version=index.dataset_version)
        _refuse_other(folder, earlier, subject)
        found = {shard.file: shard for shard in index.shards}
    receipts = [path for path in sorted((folder / PARTIAL).glob("*.json")) if path.name != _SUBJECT]
    if receipts:
        _refuse_other(folder, media.read_record(folder / PARTIAL / _SUBJECT, Subject), subject)
    for path in receipts:
        with suppress(Avs3dError):
            shard = media.read_record(path, ShardRecord)
            found[shard.file] = shard
    return found


def _refuse_other(folder: Path, found: Subject, wanted: Subject) -> None:
    if found != wanted:
        kind, version = found.format, "" if found.dataset_version is None else f" {found.dataset_version}"
        raise UsageError(
            f"{folder}: holds an export of kind {kind} of the dataset {found.dataset}{version}; choose another folder"
        )


def _keep_or_write(
    root: Path,
    folder: Path,
    split: SplitChoice,
    extras: tuple[str, ...],
    style: ShardFormat,
    pair: tuple[Shard, ShardRecord | None],
) -> ShardRecord:
    """The record of a shard, which is written unless the one on disk is the one that the plan asks for."""
    shard, known = pair
    path = folder / shard.file
    same = known is not None and known.plan == shard.plan and path.is_file() and path.stat().st_size == known.bytes
    if known is not None and same and media.sha256_file(path) == known.sha256:
        return known
    return write_shard(root, folder, split, extras, style, shard)


def export_shards(
    dataset: Dataset,
    keys: Sequence[str],
    folder: str | Path,
    style: ShardFormat,
    *,
    split: SplitChoice,
    limit: int,
    extras: tuple[str, ...],
    members: dict[str, str],
    workers: int | None = None,
    progress: bool = False,
    finish: Callable[[Path, ShardIndex], None] | None = None,
) -> ShardIndex:
    """Write (or complete) an export.

    Args:
        dataset: where from.
        keys: observations, sorted.
        folder: where to.
        style: the format.
        split: which frames.
        limit: bytes of a shard.
        extras: of `EXTRA_KINDS`.
        members: what the index says of the members.
        workers: processes; None: one per core.
        progress: show bars on stderr.
        finish: writes what stands beside the shards, before the index.

    Raises:
        UsageError: if ``folder`` holds something else, such as the shards of another dataset, or the split is empty.
        Avs3dError: if a file is missing or damaged, another process writes ``folder``, or the system refuses.
    """
    target = Path(folder).resolve()
    if target.is_relative_to(dataset.root.resolve()):
        raise UsageError(f"{folder}: lies inside the dataset; choose a folder outside of {dataset.root}")
    ask = partial(plan_observation, dataset.root, split, extras, style.room)
    sizes = [len(dataset[key]) for key in keys]
    found = dict(process_each(ask, keys, workers=workers, label="plan", progress=progress, sizes=sizes))
    planned = [sample for key in keys for sample in found[key]]
    if not planned:
        raise UsageError(f"{dataset.root}: no frames in split {split}; expected at least one")
    shards = cut(planned, limit, style)
    subject = Subject(format=style.format, dataset=dataset.name, dataset_version=dataset.version)
    with _under_way(target):
        known = _known(target, subject)
        foreign = next((s.file for s in shards if s.file not in known and os.path.lexists(target / s.file)), None)
        if foreign is not None:
            raise UsageError(
                f"{target / foreign}: exists, and no export of {subject.dataset} has written it; move it away"
            )
        media.write_json(target / PARTIAL / _SUBJECT, subject)
        for shard_record in known.values():
            # Receipts survive a second interruption; the index must go before the first shard changes.
            media.write_json(target / PARTIAL / f"{shard_record.file.replace('/', '-')}.json", shard_record)
        _remove(target / SHARDS_JSON)
        pairs = [(shard, known.get(shard.file)) for shard in shards]
        work = partial(_keep_or_write, dataset.root, target, split, extras, style)
        sizes = [shard.samples for shard in shards]
        made = process_each(work, pairs, workers=workers, label="write", progress=progress, sizes=sizes)
        done = {shard.file: record for (shard, _), record in made}
        for name in sorted(set(known) - set(done)):
            _remove(target / name)
        index = _index(dataset, style, [done[shard.file] for shard in shards], shards, planned, members)
        if finish is not None:
            finish(target, index)
        media.write_json(target / SHARDS_JSON, index)
    return index


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "remove")) from error


def _index(
    dataset: Dataset,
    style: ShardFormat,
    records: list[ShardRecord],
    shards: Sequence[Shard],
    planned: Sequence[Planned],
    members: dict[str, str],
) -> ShardIndex:
    keys: dict[str, set[str]] = {}
    for shard in shards:
        keys.setdefault(shard.split, set()).update(key for key, _ in shard.runs)
    # Members of one source are described together, e.g. source_*.stem.wav.
    held = Counter(_SOURCE.sub("source_*.", name) for sample in planned for name in sample.members)
    record = dataset.record
    return ShardIndex(
        format=style.format, toolkit_version=__version__, dataset=dataset.name,
        dataset_version=dataset.version, licence=record.licence if record else None,
        attributions=record.attributions if record else (),
        members={name: what for name, what in members.items() if held[name] or name == "json"},
        splits=sum_splits(records, {split: len(mine) for split, mine in keys.items()}), shards=tuple(records),
    )  # fmt: skip


def sum_splits(records: Sequence[ShardRecord], observations: Mapping[str, int]) -> dict[str, SplitRecord]:
    """The sums of each split, in the order of the records.

    Args:
        records: the shards.
        observations: their number by split.
    """
    splits: dict[str, list[ShardRecord]] = {}
    for record in records:
        splits.setdefault(record.split, []).append(record)
    return {
        split: SplitRecord(
            shards=len(mine),
            samples=sum(record.samples for record in mine),
            bytes=sum(record.bytes for record in mine),
            observations=observations[split],
        )
        for split, mine in splits.items()
    }
