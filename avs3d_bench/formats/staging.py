"""Writes a folder under a temporary name and renames it when it is complete.

While a process writes the target ``NAME``, ``.NAME.partial/`` is beside it. It has the new folder, a lock that ends
with its process, and, during the exchange, the old folder. The next process that finds the lock free deletes these
remains, and restores the old folder if the exchange was interrupted.
"""

from __future__ import annotations

import fnmatch
import os
import shutil
import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import os_error_line
from avs3d_bench.runtime.file_lock import open_locked


@contextmanager
def staged_folder(path: str | Path, check: Callable[[Path], None]) -> Iterator[Path]:
    """An empty folder that takes the name ``path`` when the block ends well, and vanishes otherwise.

    Args:
        path: the folder to make; missing parents are made.
        check: called with the resolved ``path`` before anything is made and again before the exchange; it raises if
            the existing folder must not be replaced (and deleted).

    Raises:
        Avs3dError: if another process is writing the same folder, or the system refuses.
    """
    final = Path(path).resolve()
    check(final)
    partial = final.with_name(f".{final.name}.partial")
    fresh, previous = partial / "new", partial / "previous"
    with _one_line(path):
        lock = hold(partial, path)
    try:
        with _one_line(path):
            _put_back(previous, final)
            for rest in (fresh, previous):
                shutil.rmtree(rest, ignore_errors=True)
            fresh.mkdir()
        yield fresh
        check(final)
        with _one_line(path):
            if final.exists():
                os.replace(final, previous)
            os.replace(fresh, final)
    finally:
        _put_back(previous, final)
        shutil.rmtree(partial, ignore_errors=True)
        os.close(lock)


@contextmanager
def _one_line(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise Avs3dError(os_error_line(error, path, "write")) from error


def refuse_strange(folder: Path, own: Iterable[str]) -> None:
    """Refuse to replace a folder with a file in it that its command has not written.

    Args:
        folder: is there.
        own: shell patterns of the paths of its files, relative to it.

    Raises:
        UsageError: naming the first such file.
    """
    patterns = tuple(own)
    for path in sorted(path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()):
        name = path.relative_to(folder).as_posix()
        if not any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns):
            raise UsageError(f"{path}: no file that this command writes; move it away, or choose another folder")


def _put_back(previous: Path, final: Path) -> None:
    if previous.exists() and not final.exists():
        os.replace(previous, final)


def hold(partial: Path, path: str | Path) -> int:
    """Make and lock the folder ``partial``; the lock lasts until the descriptor is closed or the process ends."""

    def refuse(handle: int, locked: bool | None) -> None:
        if locked is False:  # without locks, two writers of one folder are not kept apart
            holder = os.read(handle, 200).decode(errors="replace").strip() or "another process"
            raise Avs3dError(f"{path}: {holder} is writing it; wait for that to end or choose another folder")

    handle = open_locked(partial / "lock", refuse)
    if handle is None:
        raise Avs3dError(f"{path}: others keep writing it; choose another folder")
    os.ftruncate(handle, 0)
    os.write(handle, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
    return handle
