"""Files as a whole: atomic writing, plain reading, hashes, JSON with stable bytes.

A file appears under its final name only when all of its bytes are there: they go to a temporary file in the same
folder, which is then renamed (no fsync: a crash of the machine may lose a file, a crash of the program cannot halve
one). What the operating system refuses becomes one line that names the path, the cause and the way out.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import io
import json
import math
import os
import stat
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from avs3d_bench.errors import Avs3dError, UsageError, excerpt
from avs3d_bench.schema import Record, parse_record

_R = TypeVar("_R", bound=Record)

#: Floats in JSON keep nine significant digits (a ten-millionth of a metre in a flat).
JSON_DIGITS = 9
_INLINE = 110

_WAY_OUT = {
    errno.ENOSPC: "free some space and run again",
    errno.EDQUOT: "free some of your quota and run again",
    errno.EFBIG: "the file is larger than the system's limit",
    errno.EACCES: "choose another folder or change its permissions",
    errno.EPERM: "choose another folder or change its permissions",
    errno.EROFS: "choose a folder that can be written to",
    errno.ENOTDIR: "a part of the path is a file, expected a folder",
    errno.EISDIR: "a folder stands there, expected a file",
    errno.ENAMETOOLONG: "choose a shorter path",
}


def os_error_line(error: OSError, path: str | os.PathLike[str] | None = None, action: str = "use") -> str:
    """One line for an error of the operating system: path, cause, way out."""
    where = path if path is not None else error.filename
    cause = (error.strerror or str(error) or type(error).__name__).lower()
    hint = _WAY_OUT.get(error.errno or 0)
    tail = f"; {hint}" if hint else ""
    return f"{os.fspath(where)}: cannot {action}: {cause}{tail}" if where is not None else f"{cause}{tail}"


@contextlib.contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its name when the block ends well, and vanishes otherwise.

    Missing parent folders are made.

    Raises:
        Avs3dError: if the system refuses (full disk, read-only folder, …).
    """
    final = Path(path)
    temporary = final.with_name(f".{final.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, final)
    except OSError as error:
        raise Avs3dError(os_error_line(error, final, "write")) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def write_bytes(path: str | Path, data: bytes | bytearray | memoryview) -> None:
    """Write ``data`` atomically.

    Raises:
        Avs3dError: if the system refuses.
    """
    with atomic_path(path) as temporary, open(temporary, "wb", buffering=0) as stream:
        view = memoryview(data).cast("B")
        while view:
            # An unbuffered write may take only a part, e.g. just before the disk is full.
            view = view[stream.write(view) :]


_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


def user_path(name: str | os.PathLike[str]) -> Path:
    """A path as users write it: ``~`` and ``~user`` at its beginning stand for home folders.

    Raises:
        UsageError: if nothing is known of that home folder.
    """
    text = os.fspath(name)
    expanded = os.path.expanduser(text)
    if text.startswith("~") and expanded == text:
        home = text.partition("/")[0]
        raise UsageError(f"{text}: no home folder is known for {excerpt(home)}; write the whole path")
    return Path(expanded)


@contextlib.contextmanager
def open_regular(path: str | Path) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading in binary.

    Opening a FIFO would wait for a writer, and reading a device may never end: both are refused. Errors of the system
    inside the block are reported in the same way.

    Raises:
        Avs3dError: if it is missing, is no regular file or cannot be read.
    """
    try:
        # O_NONBLOCK: opening a FIFO returns at once. It means nothing for a regular file.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise Avs3dError(f"{path}: missing; expected a file") from None
    except ValueError as error:  # a NUL in the name
        raise Avs3dError(f"{str(path)!r}: cannot read: {error}; expected the path of a file") from None
    except OSError as error:
        if error.errno == errno.ENXIO:
            raise Avs3dError(f"{path}: {_KINDS[stat.S_IFSOCK]}; expected a regular file") from None
        raise Avs3dError(os_error_line(error, path, "read")) from error
    try:
        kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
        if kind != stat.S_IFREG:
            raise Avs3dError(f"{path}: {_KINDS.get(kind, 'no regular file')}; expected a regular file")
        with open(descriptor, "rb", closefd=False) as stream:
            yield stream
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "read")) from error
    finally:
        os.close(descriptor)


def read_bytes(path: str | Path) -> bytes:
    """All bytes of a regular file.

    Raises:
        Avs3dError: if it is missing, is no regular file or cannot be read.
    """
    with open_regular(path) as stream:
        return stream.read()


def sha256_bytes(data: bytes) -> str:
    """Hexadecimal sha256."""
    return hashlib.sha256(data).hexdigest()


def sha256_file(path: str | Path) -> str:
    """Hexadecimal sha256 of a file.

    Raises:
        Avs3dError: if it is missing, is no regular file or cannot be read.
    """
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Make ``target`` the same file as ``source`` (hard link), or a copy where the file system has no links.

    Raises:
        Avs3dError: if the system refuses both.
    """
    with atomic_path(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            temporary.write_bytes(Path(source).read_bytes())


def _plain(value: Any) -> Any:
    """``value`` as JSON types: records in the order of their fields, mappings by key, floats rounded."""
    if isinstance(value, BaseModel):
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        optional = value.left_out if isinstance(value, Record) else ()
        return {name: _plain(item) for name, item in fields.items() if item is not None or name not in optional}
    if isinstance(value, Mapping):
        return {str(key): _plain(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            raise Avs3dError(f"JSON cannot hold {value}: expected finite numbers")
        rounded = float(f"{float(value):.{JSON_DIGITS}g}")
        return rounded + 0.0  # −0.0 → 0.0
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise Avs3dError(f"JSON cannot hold a {type(value).__name__}: expected records, numbers, text, lists or mappings")


def _render(value: Any, indent: str) -> str:
    inline = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, dict | list) or len(inline) + len(indent) <= _INLINE or not value:
        return inline
    deeper = indent + " "
    if isinstance(value, dict):
        items = [f"{json.dumps(key, ensure_ascii=False)}: {_render(item, deeper)}" for key, item in value.items()]
        opening, closing = "{", "}"
    else:
        items = [_render(item, deeper) for item in value]
        opening, closing = "[", "]"
    return f"{opening}\n{deeper}" + f",\n{deeper}".join(items) + f"\n{indent}{closing}"


def dump_json(value: Any) -> str:
    """JSON text with stable bytes: see `write_json`.

    Raises:
        Avs3dError: if ``value`` holds a number that is not finite or a type JSON does not know.
    """
    return _render(_plain(value), "") + "\n"


def write_json(path: str | Path, value: Any) -> None:
    """Write a record or plain data as JSON, atomically.

    Records keep the order of their fields, mappings are sorted by key, floats are rounded to nine significant digits;
    what fits a line stays on one.

    Raises:
        Avs3dError: if the system refuses, or a number is not finite.
    """
    # File names may hold bytes that are no UTF-8: JSON has escapes for the code points that stand for them.
    write_bytes(path, dump_json(value).encode("utf-8", "backslashreplace"))


def read_json(path: str | Path) -> Any:
    """Parse a JSON file.

    Raises:
        Avs3dError: if it is missing or is no JSON.
    """
    data = read_bytes(path)
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise Avs3dError(f"{path}: no valid JSON: {error}; the file may be truncated") from None


def read_record(path: str | Path, record: type[_R]) -> _R:
    """Read a JSON file into its record.

    Raises:
        Avs3dError: if it is missing, is no JSON or does not fit the schema; the first wrong field is named.
    """
    return parse_record(read_bytes(path), record, path)
