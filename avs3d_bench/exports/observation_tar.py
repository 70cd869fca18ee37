"""The shards of one observation, as `avs3d generate --format webdataset` writes them: its train and its test frames.

    test-000012.tar
      __avs3d__/observation.json                          the observation's record, the same in both shards
      part_3/apartment_1/kitchen/1/frame_000.rgb.png      the members of `avs3d export webdataset`, frame by frame
      part_3/apartment_1/kitchen/1/frame_000.binaural.wav
      …
      part_3/apartment_1/kitchen/1/frame_000.json
      __avs3d__/sha256                                    of all bytes before this member

The number is the observation's place in the manifest: each worker writes finished shards under their last name, and
nothing is merged. The `webdataset` package skips names that begin with ``__…__/``. The record has the fields of
observation.json; its ``files`` are those that are members of the two shards, under the names that they have in a
dataset's folder. A shard without the last member, or with another digest in it, is not whole.
"""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord, parse_record
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.samples import ALL_KINDS, frame_facts, kinds_among
from avs3d_bench.exports.tar_format import closing, header, padding, pieces, shard_name
from avs3d_bench.formats.files import dump_json, open_regular, read_bytes

#: Splits in the order in which the shards get their names. The first frame is a test frame: the last shard is the one
#: that every observation has, and an observation is there when it is.
SPLITS = ("train", "test")
#: Names of the two members that belong to no sample.
RECORD_MEMBER = "__avs3d__/observation.json"
DIGEST_MEMBER = "__avs3d__/sha256"
#: Kinds of files that become members of samples; the two seconds of mono sound follow from the binaural clips.
KINDS = {name: kind for name, kind in ALL_KINDS.items() if name != "mono"}
_FOLDERS = frozenset(kind.folder for kind in KINDS.values())
#: Bytes hashed at a time.
_BLOCK = 2**20
_DIGEST_BYTES = 65
_DIGEST_HEADER = header(DIGEST_MEMBER, _DIGEST_BYTES)
#: The digest's member and the end of the archive take at most so many bytes.
_TAIL = tarfile.BLOCKSIZE * 4 + tarfile.RECORDSIZE


@dataclass(frozen=True, eq=False)
class ObservationTar:
    """A shard that was read whole.

    Attributes:
        record: of the observation.
        files: of the shard: name of a file in an observation's folder → its bytes.
    """

    record: ObservationRecord
    files: dict[str, bytes]


class _Recorded(Observation):
    """An observation of which only the record is at hand."""

    def __init__(self, record: ObservationRecord) -> None:
        self.place, self.key = layout.parse_key(record.key), record.key
        self._use_record = True
        self.root, self.path = Path(), Path(record.key)
        names = tuple(frame.name for frame in record.frames)
        train, test = layout.split_names(names)
        # The values of cached properties, which would be read from files.
        self.__dict__["record"] = record
        self.__dict__["frame_names"] = names
        self.__dict__["splits"] = dict.fromkeys(train, "train") | dict.fromkeys(test, "test")


def observation_shards(root: Path, number: int) -> dict[str, Path]:
    """The shards of the observation of a number by split, in the order of `SPLITS`."""
    return {split: root / shard_name(split, number) for split in SPLITS}


def count_frames(record: ObservationRecord) -> dict[str, int]:
    """Number of frames by split, of the splits that have any; an observation of one frame has no train frame."""
    train, test = layout.split_names(frame.name for frame in record.frames)
    return {split: len(names) for split, names in zip(SPLITS, (train, test), strict=True) if names}


def is_member(name: str) -> bool:
    """Whether a file of an observation's folder becomes a member of a sample."""
    return name.partition("/")[0] in _FOLDERS


def members_of(record: ObservationRecord, split: str) -> Iterator[tuple[str, str | None]]:
    """Name of each member of the samples of a split in order → the file that it holds; None: the facts.

    Args:
        record: of the observation; its ``files`` are those that the shards hold.
        split: ``train`` or ``test``.
    """
    folders = {name.partition("/")[0] for name in record.files}
    kinds = kinds_among(tuple(KINDS), record, lambda folder: folder in folders)
    for index, frame in enumerate(record.frames):
        if (split == "test") != layout.is_test(index):
            continue
        sample = f"{record.key}/{frame.name}"
        for kind in kinds.values():
            for name, path in kind.files(Path(), frame.name, index).items():
                yield f"{sample}.{name}", path.as_posix()
        yield f"{sample}.json", None


def write_tar(stream: BinaryIO, record: ObservationRecord, split: str, files: Mapping[str, bytes]) -> None:
    """Write a shard of an observation.

    Args:
        stream: where to.
        record: of the observation; its ``files`` are those that the shards hold.
        split: ``train`` or ``test``.
        files: name of a file in an observation's folder → its bytes.
    """
    whole = dump_json(record).encode("utf-8", "backslashreplace")
    # Numbers as they are in the file, so that facts have the same bytes as those of an export.
    written = parse_record(whole, ObservationRecord, record.key)
    facts = (frame_facts(frame) for frame in _Recorded(written).frames if frame.split == split)
    digest, size = hashlib.sha256(), 0

    def add(name: str, data: bytes) -> None:
        nonlocal size
        for piece in pieces(name, data):
            digest.update(piece)
            stream.write(piece)
            size += len(piece)

    add(RECORD_MEMBER, whole)
    for member, name in members_of(written, split):
        add(member, dump_json(next(facts)).encode() if name is None else files[name])
    add(DIGEST_MEMBER, f"{digest.hexdigest()}\n".encode())
    stream.write(closing(size))


def find_fault(path: Path) -> str:
    """The fault of a shard: it is cut short, or its bytes are not those of its digest. Empty if there is none.

    Raises:
        Avs3dError: if it is missing or cannot be read.
    """
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        start = max(0, size - _TAIL)
        stream.seek(start)
        tail = stream.read()
        at = tail.rfind(_DIGEST_HEADER)
        if at < 0:
            return f"cut short after {size:,} bytes, or no shard of `avs3d generate`"
        digest = tail[at + len(_DIGEST_HEADER) :][: _DIGEST_BYTES - 1]
        end = at + len(_DIGEST_HEADER) + _DIGEST_BYTES + len(padding(_DIGEST_BYTES))
        if tail[end:] != closing(start + end):
            return f"cut short after {size:,} bytes, or with bytes after its end"
        stream.seek(0)
        found, left = hashlib.sha256(), start + at
        while left and (block := stream.read(min(left, _BLOCK))):
            found.update(block)
            left -= len(block)
        return "" if found.hexdigest().encode() == digest else "its bytes are not those that its digest is of"


def read_head(path: Path) -> tuple[ObservationRecord, str]:
    """The observation's record and the sha256 of its JSON, from the beginning of a shard.

    Raises:
        Avs3dError: if the shard is missing, or does not begin with the record of an observation.
    """
    with open_regular(path) as stream:
        try:
            with tarfile.open(fileobj=stream, mode="r:") as archive:
                first = archive.next()
                member = archive.extractfile(first) if first is not None and first.name == RECORD_MEMBER else None
                data = member.read() if member is not None else b""
                whole = first is not None and len(data) == first.size
        except tarfile.TarError:
            data, whole = b"", False
    if not data or not whole:
        raise Avs3dError(f"{path}: does not begin with {RECORD_MEMBER}, as shards of `avs3d generate` do; move it away")
    return parse_record(data, ObservationRecord, f"{path}/{RECORD_MEMBER}"), hashlib.sha256(data).hexdigest()


def read_tar(path: Path) -> ObservationTar:
    """Read a shard whole.

    Raises:
        Avs3dError: if it is missing, cut short or damaged.
    """
    fault = find_fault(path)
    if fault:
        raise Avs3dError(f"{path}: {fault}; delete it and run `avs3d generate` again")
    record, _ = read_head(path)
    named = {member: name for split in SPLITS for member, name in members_of(record, split) if name is not None}
    found: dict[str, bytes] = {}
    with tarfile.open(fileobj=io.BytesIO(read_bytes(path)), mode="r:") as archive:
        for info in archive:
            member = archive.extractfile(info) if info.name in named else None
            if member is not None:
                found[named[info.name]] = member.read()
    return ObservationTar(record, found)
