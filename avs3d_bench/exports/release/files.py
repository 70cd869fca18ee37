"""The files of a dataset that a release has, and how they are cut into archives.

A release has the files that the dataset's records name with their sha256, and no other: notes of a run, exports and
whatever else lies about is left out. Of a sealed test it takes the public side alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.codabench_files import require_no_truth
from avs3d_bench.exports.tar_format import closing, header, link, padding
from avs3d_bench.formats.files import sha256_file
from avs3d_bench.sealing.seal import DRAWS, OPENING_KEY, PUBLIC, check_public, read_seal


@dataclass(frozen=True)
class ReleasedFile:
    """A file: its path below the root, its size (bytes) and the sha256 that a record names."""

    path: str
    size: int
    sha256: str


@dataclass
class PlannedArchive:
    """An archive that is not written yet.

    Attributes:
        files: in order.
        room: bytes of their members.
        known: sha256 → path of the files that are in it already: others of the same content become links to these.
    """

    files: list[ReleasedFile] = field(default_factory=list)
    room: int = 0
    known: dict[str, str] = field(default_factory=dict)

    def room_for(self, files: Sequence[ReleasedFile]) -> int:
        """Bytes that some more files would take."""
        known, room = dict(self.known), 0
        for file in files:
            same = known.setdefault(file.sha256, file.path)
            if same == file.path:
                room += len(header(file.path, file.size)) + file.size + len(padding(file.size))
            else:
                room += len(link(file.path, same))
        return room

    def add(self, files: Sequence[ReleasedFile]) -> None:
        """Add files at the end."""
        self.room += self.room_for(files)
        self.files += files
        for file in files:
            self.known.setdefault(file.sha256, file.path)

    @property
    def size(self) -> int:
        """Bytes of the archive."""
        return self.room + len(closing(self.room))

    @property
    def unpacked(self) -> int:
        """Bytes of its files, equal ones counted once."""
        return sum(file.size for file in self.files if self.known[file.sha256] == file.path)


def check_releasable(dataset: Dataset) -> None:
    """Refuse what must not or cannot be released.

    Raises:
        UsageError: if there is no dataset of this toolkit, or it is the private side of a sealed test.
        Avs3dError: if the public side of a sealed test is not as its seal says, or tells the truth.
    """
    root = dataset.root
    if dataset.record is None:
        raise UsageError(
            f"{root}: no {layout.DATASET_JSON}; expected a dataset that `avs3d generate` or `avs3d seal` made "
            "(the official release is its authors' to publish)"
        )
    if not dataset.keys:
        raise UsageError(f"{root}: no observation; expected at least one")
    marks = [name for name in (layout.SEAL_JSON, OPENING_KEY, DRAWS) if (root / name).exists()]
    if marks and not dataset.record.sealed_test:
        raise UsageError(
            f"{root / marks[0]}: this is the private side of a sealed test, which holds its truth; release the public "
            f"side: avs3d release {root.parent / PUBLIC} -o DIR"
        )
    if dataset.record.sealed_test:
        problem = next(check_public(root, read_seal(root)), None)
        if problem is not None:
            raise Avs3dError(f"{root / problem.path}: {problem.message}; nothing is released")
        require_no_truth(dataset)


def released_files(dataset: Dataset) -> Iterator[list[ReleasedFile]]:
    """The files at the root, then those of each observation; siblings, which share pictures, come one after the other.

    Raises:
        Avs3dError: if a file is missing, or a record is damaged.
    """
    assert dataset.record is not None
    names = [layout.DATASET_JSON, *([layout.SEAL_JSON] if dataset.is_sealed else [])]
    yield [_file(dataset.root, name, sha256_file(dataset.root / name)) for name in names]
    digests = {entry.key: entry.digest for entry in dataset.record.observations}
    for observation in sorted(dataset, key=lambda each: (each.group or each.key, each.key)):
        if observation.key not in digests:
            raise Avs3dError(
                f"{observation.path}: not listed in {dataset.root / layout.DATASET_JSON}; "
                "generate the dataset to its end, or move the folder away"
            )
        yield _files_of(dataset, observation, digests.pop(observation.key))
    if digests:
        raise Avs3dError(f"{dataset.root / min(digests)}: missing; {layout.DATASET_JSON} lists it")


def _files_of(dataset: Dataset, observation: Observation, digest: str) -> list[ReleasedFile]:
    found = observation.published if dataset.is_sealed else observation.record
    if found is None:
        raise Avs3dError(f"{observation.path / layout.OBSERVATION_JSON}: missing; expected the observation's record")
    own = layout.POSES_JSON if dataset.is_sealed else layout.OBSERVATION_JSON
    named = {own: digest, **found.files}
    return [_file(dataset.root, f"{observation.key}/{name}", named[name]) for name in sorted(named)]


def _file(root: Path, path: str, digest: str) -> ReleasedFile:
    try:
        size = (root / path).stat().st_size
    except OSError:
        raise Avs3dError(f"{root / path}: missing; the dataset's records name it") from None
    return ReleasedFile(path, size, digest)


def cut(units: Iterator[list[ReleasedFile]], limit: int) -> list[PlannedArchive]:
    """Archives of at most ``limit`` bytes.

    An observation is cut in two only if it is larger than the limit.

    Raises:
        UsageError: if one file is larger than the limit.
    """
    archives = [PlannedArchive()]
    for unit in units:
        whole = _fits(PlannedArchive(), unit, limit)
        for part in [unit] if whole else [[file] for file in unit]:
            if not _fits(archives[-1], part, limit):
                if not _fits(PlannedArchive(), part, limit):
                    raise UsageError(
                        f"{part[0].path}: {part[0].size:,} bytes do not fit into an archive of {limit:,} bytes; "
                        "give a larger --archive-size"
                    )
                archives.append(PlannedArchive())
            archives[-1].add(part)
    return archives


def _fits(archive: PlannedArchive, files: Sequence[ReleasedFile], limit: int) -> bool:
    room = archive.room + archive.room_for(files)
    return room + len(closing(room)) <= limit
