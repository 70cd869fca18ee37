"""Who holds a folder: one run at a time, on whatever machine it is.

The holder locks the file ``.avs3d-lock`` in the folder and writes into it who it is. The system drops the lock when the
process ends, however it ends; the file is removed by its holder, and taken over where a killed one has left it.
Where a file system has no locks, the file alone keeps others out.
"""

from __future__ import annotations

import getpass
import json
import os
import secrets
import shlex
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import os_error_line, read_bytes
from avs3d_bench.runtime.file_lock import open_locked


@dataclass(frozen=True)
class Holder:
    """Who holds a folder; ``token`` is new for every run, so that machines can tell that they see the same folder."""

    host: str
    pid: int
    user: str
    command: str
    started: str
    token: str

    @classmethod
    def me(cls) -> Holder:
        """This process."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):  # a container without a passwd entry
            user = str(os.getuid())
        command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
        started = datetime.now().astimezone().isoformat(" ", timespec="seconds")
        return cls(socket.gethostname(), os.getpid(), user, command, started, secrets.token_hex(8))


@contextmanager
def folder_lock(root: Path, what: str = "avs3d generate") -> Iterator[Holder]:
    """Make ``root`` and hold it against others.

    Args:
        root: the folder.
        what: the command that holds folders so, for the message.

    Raises:
        Avs3dError: if another run holds it (who, where and since when), or it cannot be written.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        handle = _hold(root, what)
    except OSError as error:
        held_by = _who(root)  # of another user, whose file we may not open
        raise Avs3dError(
            f"{root}: cannot write there ({error.strerror}); "
            + (f"another {what} is at work in this folder{held_by}, or was killed; " if held_by else "")
            + "choose another folder with -o"
        ) from error
    path = root / layout.LOCK
    try:
        me = Holder.me()
        try:
            os.ftruncate(handle, 0)
            os.pwrite(handle, (json.dumps(asdict(me)) + "\n").encode(), 0)
            os.fsync(handle)  # over NFS, others would see an empty file for half a minute
        except OSError as error:
            raise Avs3dError(os_error_line(error, root, "write")) from error
        yield me
    finally:
        with suppress(OSError):  # while the lock is still held, so that no file of another process is removed
            path.unlink()
        os.close(handle)


def holder_of(root: Path) -> Holder | None:
    """The contents of the lock file in ``root``; None if it cannot be read. Its process may have ended."""
    try:
        found: Any = json.loads(read_bytes(root / layout.LOCK))
        return Holder(**found)
    except (Avs3dError, ValueError, TypeError):
        return None


def _hold(root: Path, what: str) -> int:
    """Open and lock the lock file; the descriptor."""

    def refuse(_: int, locked: bool | None) -> None:
        if locked is False or (locked is None and _said_to_be_held(root)):
            raise Avs3dError(f"{root}: another {what} is at work in this folder{_who(root)}; wait for it")

    handle = open_locked(root / layout.LOCK, refuse, mode=0o644)
    if handle is None:
        raise Avs3dError(f"{root}: others keep working in this folder; choose another with -o")
    return handle


def _said_to_be_held(root: Path) -> bool:
    """Where nothing can be locked: the file counts, unless it is of a process of this machine that has ended."""
    holder = holder_of(root)
    if holder is None:
        return False
    if holder.host != socket.gethostname():
        return True
    try:
        os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _who(root: Path) -> str:
    holder = holder_of(root)
    if holder is None:
        return ""
    return f" since {holder.started} (host {holder.host}, pid {holder.pid}, user {holder.user}: {holder.command})"
