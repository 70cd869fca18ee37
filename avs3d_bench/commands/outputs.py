"""Outputs of commands: none replaces what its command reads, or what its command has not written.

An option for an output has the type `OutputFile` or `OutputFolder` instead of `click_options.PATH`, the type of
inputs. Their values are compared with each other before the command begins:

- an output must not be an input, by whatever name (symbolic or hard link), nor another output of the command;
- in a folder that is read, it must not take the name of an index or lie among the observations;
- a file that is there already is replaced only if its content says that the same command has written it: see
  `Signature`. An empty file holds nothing that could be lost.

Folders are checked by the function that writes them, which knows their files; `write_outputs` does it for files of
known names.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import click

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import PARTS
from avs3d_bench.errors import UsageError

#: Bytes at the beginning and at the end of a file among which the marks of a signature are looked for.
_LOOK = 2**18
#: Files that make a folder what it is: no output takes one of these names in a folder that is read.
_INDICES = (layout.DATASET_JSON, layout.SUBMISSION_JSON, layout.SEAL_JSON, layout.SHARDS_JSON)


@dataclass(frozen=True)
class Signature:
    """Marks in the content of a file that tell which command wrote it. At least one attribute has to be given.

    Attributes:
        start: the first bytes of the file.
        marks: byte strings that are all near its beginning or its end.
        keys: names that the JSON object has.
        exactly: whether it must have no others.
        values: names of the JSON object with their values.
    """

    start: bytes = b""
    marks: tuple[bytes, ...] = ()
    keys: tuple[str, ...] = ()
    exactly: bool = True
    values: tuple[tuple[str, Any], ...] = ()

    def matches(self, path: Path) -> bool:
        """Whether a regular file has it.

        Raises:
            Avs3dError: if it cannot be read.
        """
        from avs3d_bench.formats.files import MAX_JSON_BYTES, open_regular

        with open_regular(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            head = stream.read(_LOOK)
            if not head.startswith(self.start):
                return False
            if self.marks:
                stream.seek(max(len(head), size - _LOOK))
                around = head + stream.read()
                if not all(mark in around for mark in self.marks):
                    return False
            if not self.keys and not self.values:
                return True
            if size > MAX_JSON_BYTES:
                return False
            stream.seek(0)
            try:
                found = json.loads(stream.read())
            except (ValueError, RecursionError):
                return False
        if not isinstance(found, dict) or any(found.get(name, self) != value for name, value in self.values):
            return False
        names = set(self.keys)
        return names == found.keys() if self.keys and self.exactly else names <= found.keys()


#: Pictures that matplotlib draws for this project name it (pass `PNG_METADATA`, `SVG_METADATA` to ``savefig``).
DRAWN_BY = "avs3d-bench"
PNG_METADATA = {"Software": DRAWN_BY}
SVG_METADATA = {"Date": None, "Creator": DRAWN_BY}
PNG_OF_OURS = Signature(start=b"\x89PNG", marks=(f"Software\0{DRAWN_BY}".encode(),))
SVG_OF_OURS = Signature(start=b"<?xml", marks=(f"<dc:title>{DRAWN_BY}</dc:title>".encode(),))


def check_replaceable(path: str | Path, signatures: Sequence[Signature]) -> None:
    """Refuse to replace a file that has none of the signatures; one that is missing, empty or a device is no matter.

    Raises:
        UsageError: naming the file.
        Avs3dError: if it cannot be read.
    """
    from avs3d_bench.formats.files import is_stream

    place = Path(path)
    if is_stream(place) or not place.exists() or not place.stat().st_size:
        return
    if not any(signature.matches(place) for signature in signatures):
        raise UsageError(
            f"{path}: exists, and this command has not written it; choose another name, or move the file away"
        )


def write_outputs(files: Mapping[Path, bytes], signatures: Mapping[str, Sequence[Signature]]) -> list[Path]:
    """Write files of known names into a folder that may hold others; all or, if one must not be replaced, none.

    Args:
        files: path → content.
        signatures: name of a file, or suffix of a name → what a file of that suffix must say to be replaced.

    Returns:
        The paths.

    Raises:
        UsageError: if there is a file with other content that has no such signature.
        Avs3dError: if the system refuses.
    """
    from avs3d_bench.formats.files import write_bytes

    for path, data in files.items():
        if not _holds(path, data):
            check_replaceable(path, signatures.get(path.name) or signatures.get(path.suffix, ()))
    for path, data in files.items():
        write_bytes(path, data)
    return list(files)


def _holds(path: Path, data: bytes) -> bool:
    try:
        found = path.stat()
        return stat.S_ISREG(found.st_mode) and found.st_size == len(data) and path.read_bytes() == data
    except OSError:
        return False


def check_apart(output: Path, inputs: Iterable[Path], *, folder: bool = False) -> None:
    """Refuse an output that is an input, or lies where it would change one.

    Args:
        output: a file or, with ``folder``, a folder.
        inputs: files and folders that are read.
        folder: whether the output is a folder.

    Raises:
        UsageError: naming both.
    """
    place = Path(os.path.realpath(output))
    for source in inputs:
        home = Path(os.path.realpath(source))
        if place == home or _same_file(place, home):
            raise UsageError(f"{output}: would overwrite {source}, which is read; choose another name")
        if not (home.is_dir() and place.is_relative_to(home)):
            continue
        first, *deeper = place.relative_to(home).parts
        if first in PARTS or (not deeper and not folder and first in _INDICES):
            raise UsageError(f"{output}: would change {source}, which is read; choose another name")


def _same_file(one: Path, other: Path) -> bool:
    try:
        return os.path.samefile(one, other)
    except OSError:
        return False


class NamedPath(click.Path):
    """A path that is not empty: `Path("")` is the current folder, which an empty text does not mean.

    Alone, it is an input.
    """

    _PATHS: ClassVar[str] = f"{__name__}.paths"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As click does it, and compared with the other paths of the command.

        Raises:
            click.BadParameter: if the text is empty.
            UsageError: if an output must not be written.
            Avs3dError: if the system would refuse to write it.
        """
        if value == "":
            self.fail("the name is empty; expected a file or folder", param, ctx)
        path: Any = super().convert(value, param, ctx)
        if ctx is not None and not ctx.resilient_parsing:
            self._compare(Path(path), ctx.meta.setdefault(self._PATHS, []))
        return path

    def _compare(self, path: Path, others: list[tuple[NamedPath, Path]]) -> None:
        for kind, other in others:
            if isinstance(self, OutputPath) and isinstance(kind, OutputPath):
                if os.path.realpath(path) == os.path.realpath(other):
                    raise UsageError(f"{path}: named twice; expected a name of its own for each output")
            elif isinstance(self, OutputPath):
                self.keep_apart(path, other)
            elif isinstance(kind, OutputPath):
                kind.keep_apart(other, path)
        others.append((self, path))


class OutputPath(NamedPath):
    """A path that a command writes to."""

    folder: ClassVar[bool]

    def keep_apart(self, path: Path, source: Path) -> None:
        """See `check_apart`."""
        check_apart(path, (source,), folder=self.folder)


class OutputFolder(OutputPath):
    """A folder; whether it may be written to is up to the function that writes it."""

    folder = True


class OutputFile(OutputPath):
    """A file that is replaced only if it has one of the signatures."""

    folder = False

    def __init__(self, *signatures: Signature) -> None:
        """``signatures``: of files that the command writes; without any, no file is ever replaced."""
        super().__init__(path_type=Path)
        self.signatures = signatures

    def _compare(self, path: Path, others: list[tuple[NamedPath, Path]]) -> None:
        from avs3d_bench.formats.files import check_writable, is_stream

        if is_stream(path):
            return
        super()._compare(path, others)
        check_writable(path)
        check_replaceable(path, self.signatures)


#: Type of an option or argument that names a file or folder to be read.
PATH: Any = NamedPath(path_type=Path)
#: Type of an option that names a folder to be written to.
OUTPUT_FOLDER: Any = OutputFolder(path_type=Path)
