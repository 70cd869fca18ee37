"""Atomic writing; imports nothing but the standard library, for the parts of the toolkit that load fast.

A file appears under its final name only when all of its bytes are there: they go to a temporary file in the same
folder, which is then renamed (no fsync: a crash of the machine may lose a file, a crash of the program cannot halve
one). A device or FIFO under that name is written to instead. What the operating system refuses becomes one line that
names the path, the cause and the way out.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import stat
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError

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

#: What stands under a name that is no regular file.
KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a folder",
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
    found = "a block device" if kind == stat.S_IFBLK else KINDS.get(kind, "no file")
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
