"""Files as a whole: atomic writing, plain reading, hashes, JSON with stable bytes.

A file appears under its final name only when all of its bytes are there: they go to a temporary file in the same
folder, which is then renamed (no fsync: a crash of the machine may lose a file, a crash of the program cannot halve
one). A device or FIFO under that name is written to instead. What the operating system refuses becomes one line that
names the path, the cause and the way out.
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
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from avs3d_bench.contract.schema import Record, parse_record
from avs3d_bench.errors import Avs3dError, UsageError

_R = TypeVar("_R", bound=Record)

#: Floats in JSON keep nine significant digits (a ten-millionth of a metre in a flat).
JSON_DIGITS = 9
_INLINE = 110
#: Largest JSON file that is read (bytes): ten thousand observations are listed in a tenth of it.
MAX_JSON_BYTES = 128 * 2**20
#: Symbolic links that are followed from one name, as Linux does.
_MAX_LINKS = 40
#: Bytes copied at a time.
_BLOCK = 2**20

_WAY_OUT = {
    errno.ENOSPC: "free some space and run again",
    errno.EDQUOT: "free some of your quota and run again",
    errno.EFBIG: "the file is larger than the system's limit",
    errno.EACCES: "choose another folder or change its permissions",
    errno.EPERM: "choose another folder or change its permissions",
    errno.EROFS: "choose a folder that can be written to",
    errno.ENOTDIR: "a part of the path is a file, expected a folder",
    errno.EISDIR: "found a folder, expected a file",
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
    """A temporary path that takes the name of ``path`` when the block ends well, and vanishes otherwise.

    Missing parent folders are made. A symbolic link is followed: its target is replaced and the link stays. A character
    device, a FIFO or an open descriptor (``/dev/stdout``) is never renamed over: the bytes are written to it when the
    block has ended.

    Raises:
        Avs3dError: if the system refuses (full disk, read-only folder, …), ``path`` is a folder, socket or block
            device, or it is a FIFO without a reader.
    """
    final = Path(path)
    with contextlib.ExitStack() as cleanup:
        try:
            if is_stream(final):
                folder = Path(cleanup.enter_context(tempfile.TemporaryDirectory(prefix="avs3d-output-")))
                yield folder / "output"
                _write_through(final, folder / "output")
                return
            target = Path(os.path.realpath(final))
            temporary = target.with_name(f".{target.name}.{os.getpid()}-{threading.get_ident()}.tmp")
            cleanup.callback(_remove, temporary)
            target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, target)
        except OSError as error:
            raise Avs3dError(os_error_line(error, final, "write")) from error


def check_writable(path: str | Path) -> None:
    """Refuse a file that could not be written, before any work is done for it; nothing is left behind.

    Raises:
        UsageError: if the path is a folder, a socket or a block device.
        Avs3dError: if the system would refuse to make a file there.
    """
    if is_stream(path):
        return
    folder = Path(os.path.realpath(path)).parent
    while not os.path.lexists(folder):
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder, prefix=".avs3d-"):
            pass
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "write")) from error


def is_stream(path: str | Path) -> bool:
    """Whether an output is written through what stands under the name: a character device, a FIFO, a descriptor.

    Raises:
        UsageError: if the path is a folder, a socket or a block device.
        Avs3dError: if a link leads in a circle, or the name holds a NUL character.
    """
    try:
        if _descriptor(path) is not None:
            return True
        kind = stat.S_IFMT(os.stat(path).st_mode)
    except FileNotFoundError:
        return False
    except ValueError as error:
        raise Avs3dError(f"{str(path)!r}: cannot write: {error}; expected the path of a file") from None
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "write")) from error
    if kind in (stat.S_IFREG, stat.S_IFCHR, stat.S_IFIFO):
        return kind != stat.S_IFREG
    found = "a block device" if kind == stat.S_IFBLK else _KINDS.get(kind, "no file")
    raise UsageError(f"{path}: cannot write: found {found}, expected a file; choose another name")


def _descriptor(path: str | Path) -> int | None:
    """The number of this process's open file that a path such as ``/dev/stdout`` or ``/dev/fd/5`` means, else None."""
    place = Path(path)
    own = f"/proc/{os.getpid()}/fd"
    for _ in range(_MAX_LINKS):
        if not place.is_symlink():
            return None
        parent = os.path.realpath(place.parent)
        if parent == own and place.name.isdecimal():
            return int(place.name)
        place = Path(parent) / os.readlink(place)
    return None


def _write_through(path: Path, source: Path) -> None:
    """Copy a file's bytes to a device, a FIFO or an open descriptor.

    Raises:
        Avs3dError: if no process reads from the FIFO.
        OSError: if the system refuses.
    """
    number = _descriptor(path)
    if number is not None:
        for printed in (sys.stdout, sys.stderr):
            if printed is not None:
                printed.flush()  # what was printed before comes before
        descriptor = os.dup(number)
    else:
        try:
            # Without O_NONBLOCK, opening a FIFO waits for a reader, for ever if there is none.
            descriptor = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            raise Avs3dError(f"{path}: cannot write: nobody reads from this FIFO; start its reader first") from None
        os.set_blocking(descriptor, True)
    with open(descriptor, "wb", buffering=0) as stream, open(source, "rb") as contents:
        while block := contents.read(_BLOCK):
            _write_all(stream, block)


def _write_all(stream: io.RawIOBase, data: bytes | bytearray | memoryview) -> None:
    view = memoryview(data).cast("B")
    while view:
        # An unbuffered write may take only a part, e.g. just before the disk is full.
        view = view[stream.write(view) or 0 :]


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def write_bytes(path: str | Path, data: bytes | bytearray | memoryview) -> None:
    """Write ``data`` atomically; through a device or FIFO, see `atomic_path`.

    Raises:
        Avs3dError: if the system refuses.
    """
    with atomic_path(path) as temporary, open(temporary, "wb", buffering=0) as stream:
        _write_all(stream, data)


_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
}


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
        raise Avs3dError(f"{path}: {_KINDS.get(kind, 'no regular file')}; expected a regular file")


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
