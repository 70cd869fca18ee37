"""Files as a whole: plain reading, hashes, JSON with stable bytes. `avs3d_bench.formats.atomic` writes them.

What the operating system refuses becomes one line that names the path, the cause and the way out.
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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from avs3d_bench.contract.schema import Record, parse_record
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.atomic import KINDS, atomic_path, check_writable, is_stream, os_error_line, write_bytes

__all__ = [
    "atomic_path",
    "check_writable",
    "dump_json",
    "is_stream",
    "link_or_copy",
    "open_regular",
    "os_error_line",
    "read_bytes",
    "read_json",
    "read_record",
    "require_regular",
    "sha256_bytes",
    "sha256_file",
    "write_bytes",
    "write_json",
]

_R = TypeVar("_R", bound=Record)

#: Floats in JSON keep nine significant digits (a ten-millionth of a metre in a flat).
JSON_DIGITS = 9
_INLINE = 110
#: Largest JSON file that is read (bytes): ten thousand observations are listed in a tenth of it.
MAX_JSON_BYTES = 128 * 2**20


def require_regular(path: str | Path) -> None:
    """Say what stands under a name without opening it.

    Raises:
        Avs3dError: if it is no regular file, or leads nowhere.
    """
    try:
        kind = stat.S_IFMT(os.stat(path).st_mode)
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "read")) from error
    if kind != stat.S_IFREG:
        raise Avs3dError(f"{path}: {KINDS.get(kind, 'no regular file')}; expected a regular file")


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
            raise Avs3dError(f"{path}: {KINDS[stat.S_IFSOCK]}; expected a regular file") from None
        raise Avs3dError(os_error_line(error, path, "read")) from error
    try:
        kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
        if kind != stat.S_IFREG:
            raise Avs3dError(f"{path}: {KINDS.get(kind, 'no regular file')}; expected a regular file")
        with open(descriptor, "rb", closefd=False) as stream:
            yield stream
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "read")) from error
    finally:
        os.close(descriptor)


def read_bytes(path: str | Path, most: int | None = None) -> bytes:
    """All bytes of a regular file, which may have at most so many.

    Raises:
        Avs3dError: if it is missing, is no regular file, is larger or cannot be read.
    """
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if most is not None and size > most:
            raise Avs3dError(f"{path}: {size:,} bytes, expected at most {most:,}")
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


def _plain(value: object) -> Any:
    """``value`` as JSON types: records in the order of their fields, mappings by key, floats rounded."""
    if isinstance(value, BaseModel):
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        optional = value.omitted() if isinstance(value, Record) else ()
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


def _render(value: object, indent: str) -> str:
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


def dump_json(value: object) -> str:
    """JSON text with stable bytes: see `write_json`.

    Raises:
        Avs3dError: if ``value`` holds a number that is not finite or a type JSON does not know.
    """
    return _render(_plain(value), "") + "\n"


def write_json(path: str | Path, value: object) -> None:
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
        Avs3dError: if it is missing, too large or no JSON.
    """
    data = read_bytes(path, MAX_JSON_BYTES)
    try:
        return json.loads(data)
    except RecursionError:
        raise Avs3dError(f"{path}: JSON that is nested too deeply; expected a file of this toolkit") from None
    except ValueError as error:
        raise Avs3dError(f"{path}: no valid JSON: {error}; the file may be truncated") from None


def read_record(path: str | Path, record: type[_R]) -> _R:
    """Read a JSON file into its record.

    Raises:
        Avs3dError: if it is missing, too large, no JSON or does not fit the schema; the first wrong field is named.
    """
    return parse_record(read_bytes(path, MAX_JSON_BYTES), record, path)
