"""Where the files of an observation go while it is made: a folder, or (see `tar_output`) a tar file.

`ObservationWriter` encodes the files and hands them over; an output stores them and, when the observation is whole,
gives it its name. Every attempt writes under a temporary name of its own, since an attempt that a scheduler
believes lost may still run on another machine. The attempt that ends second finds the same bytes there already.
"""

from __future__ import annotations

import os
import secrets
import shutil
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import files


class ObservationOutput(Protocol):
    """Takes the files of one observation; names are relative to its folder, as in `avs3d_bench.contract.layout`."""

    def open(self) -> None:
        """Prepare the temporary place.

        Raises:
            Avs3dError: if the system refuses.
        """

    def close(self) -> None:
        """Remove what is temporary; after `finish` there is nothing left to remove."""

    def keeps(self, name: str) -> bool:
        """Whether a file of that name is part of the output; one that is not must not be handed over."""

    def where(self, name: str) -> Path:
        """The path that messages name; files of a folder are there."""

    def put(self, name: str, data: bytes) -> None:
        """Store a file; several threads may store different ones.

        Raises:
            Avs3dError: if the system refuses.
        """

    def get(self, name: str) -> bytes:
        """The bytes of a stored file."""

    def repeat(self, name: str, copy: str) -> None:
        """Store a file under a second name."""

    def share(self, sibling: Path) -> dict[str, str]:
        """Take over the files that siblings share from a finished one: name → sha256.

        Args:
            sibling: the folder that it has, or would have.
        """

    def size(self, name: str) -> int:
        """Bytes of a stored file."""

    def digest(self, name: str) -> str:
        """sha256 of a stored file."""

    def finish(self, record: ObservationRecord) -> None:
        """Add observation.json, and give the observation its name.

        Raises:
            Avs3dError: if the system refuses.
        """


#: End of the name that a folder has while another takes its place.
_EARLIER = ".earlier"


def hidden_name(place: Path, what: str) -> Path:
    """A name beside ``place`` that no other process or attempt uses."""
    stem = place.name.strip(".").partition(".")[0]
    host = socket.gethostname().partition(".")[0]
    return place.with_name(f".{stem}.{what}-{host}-{os.getpid()}-{secrets.token_hex(4)}.partial")


def sweep(root: Path) -> None:
    """Remove what interrupted attempts left below a dataset's folder; put back what one was about to replace.

    Each is renamed before it is deleted: an attempt that still runs somewhere can then no longer give its name to a
    folder that is half gone.
    """
    for earlier in root.glob(f"part_*/*/*/.*{_EARLIER}"):
        place = earlier.with_name(earlier.name.removeprefix(".").removesuffix(_EARLIER))
        with suppress(OSError):
            earlier.rename(hidden_name(place, "replaced") if place.exists() else place)
    for partial in (*root.glob("part_*/*/*/.*.partial"), *root.glob(".*-*.partial")):
        doomed = hidden_name(partial, "swept")
        with suppress(OSError):
            partial.rename(doomed)
        remove(doomed)


def remove(path: Path) -> None:
    """Remove a file, or a folder with all it has, as far as the system lets it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


class FolderOutput:
    """An observation as a folder of files: it lies in ``.<index>.<attempt>.partial`` until it is whole.

    Args:
        place: the observation's final folder.
        replaces: whether it takes the place of a finished observation; that one stays until this one is whole.
    """

    def __init__(self, place: Path, *, replaces: bool = False) -> None:
        self._final = place
        self._replaces = replaces
        self.folder = hidden_name(place, "new")

    def open(self) -> None:
        """Make the temporary folder."""
        try:
            self.folder.mkdir(parents=True)
        except OSError as error:
            raise Avs3dError(files.os_error_line(error, self._final, "write")) from error

    def close(self) -> None:
        """Remove the temporary folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def keeps(self, name: str) -> bool:
        """Every file."""
        return True

    def where(self, name: str) -> Path:
        """The file in the temporary folder."""
        return self.folder / name

    def put(self, name: str, data: bytes) -> None:
        """Write the file, atomically."""
        files.write_bytes(self.folder / name, data)

    def get(self, name: str) -> bytes:
        """Read the file."""
        return files.read_bytes(self.folder / name)

    def repeat(self, name: str, copy: str) -> None:
        """Make a hard link, or a copy where the file system has none."""
        files.link_or_copy(self.folder / name, self.folder / copy)

    def share(self, sibling: Path) -> dict[str, str]:
        """Hard links of the sibling's files, or copies where the file system has none."""
        record = files.read_record(sibling / layout.OBSERVATION_JSON, ObservationRecord)
        shared = shared_files(record.files)
        for name in shared:
            files.link_or_copy(sibling / name, self.folder / name)
        return shared

    def size(self, name: str) -> int:
        """Bytes of the file."""
        return (self.folder / name).stat().st_size

    def digest(self, name: str) -> str:
        """sha256 of the file."""
        return files.sha256_file(self.folder / name)

    def finish(self, record: ObservationRecord) -> None:
        """Write observation.json and rename the folder."""
        files.write_json(self.folder / layout.OBSERVATION_JSON, record)
        try:
            if self._replaces and self._final.exists():
                self._replace()
            else:
                self.folder.rename(self._final)
        except OSError as error:
            if not self._is_there(record):
                raise Avs3dError(files.os_error_line(error, self._final, "write")) from error

    def _replace(self) -> None:
        """Take the place of the earlier folder, of which `sweep` knows the name in between."""
        earlier = self._final.with_name(f".{self._final.name}{_EARLIER}")
        self._final.rename(earlier)
        try:
            self.folder.rename(self._final)
        except OSError:
            with suppress(OSError):
                earlier.rename(self._final)
            raise
        remove(earlier)

    def _is_there(self, record: ObservationRecord) -> bool:
        """Whether another attempt at the same plan has come first."""
        path = self._final / layout.OBSERVATION_JSON
        try:
            return files.read_record(path, ObservationRecord) == record
        except Avs3dError:
            return False


def shared_files(digests: Mapping[str, str]) -> dict[str, str]:
    """Those of an observation's files that have the same bytes in all siblings, with their sha256."""
    shared = tuple(f"{folder}/" for folder in layout.SIBLING_FOLDERS)
    return {name: digest for name, digest in digests.items() if name.startswith(shared)}


class MemoryOutput:
    """The part of an output that keeps the files of an observation in memory until it is whole."""

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}

    def open(self) -> None:
        """Nothing is written yet."""

    def close(self) -> None:
        """Forget the files."""
        self._files.clear()

    def put(self, name: str, data: bytes) -> None:
        """Keep the bytes."""
        self._files[name] = data

    def get(self, name: str) -> bytes:
        """The bytes."""
        return self._files[name]

    def repeat(self, name: str, copy: str) -> None:
        """Keep the same bytes twice."""
        self._files[copy] = self._files[name]

    def size(self, name: str) -> int:
        """Their number."""
        return len(self._files[name])

    def digest(self, name: str) -> str:
        """sha256 of the bytes."""
        return files.sha256_bytes(self._files[name])
