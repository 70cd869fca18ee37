"""Locks on files (flock, which Linux carries over NFS since 2.6.12): the system drops them when the process ends.

The library filelock is not used: it cannot handle file systems without locks, and does not report the holder of a lock.
This module imports nothing else of ours, because the digest of every baked home covers what it imports.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: How often to try again when a holder removes the file that we are about to lock.
TRIES = 50
#: What file systems without locks answer (some of clusters and networks).
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)
#: Time between two looks at whether a lock is free (s).
_PAUSE = 0.2


def try_lock(handle: int) -> bool | None:
    """Lock an open file for this process alone (flock), without waiting.

    Returns:
        True: locked until it is closed or the process ends; False: another holds it; None: there are no locks here.

    Raises:
        OSError: if the system refuses for another reason.
    """
    if sys.platform == "win32":
        return None
    try:
        return lock_now(handle)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        return None


def lock_now(handle: int) -> bool:
    """As `try_lock`, for those who have another way where there are no locks.

    Raises:
        OSError: if the file, or the file system, cannot be locked.
    """
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def open_locked(
    path: Path, refuse: Callable[[int, bool | None], None], *, tries: int = TRIES, mode: int = 0o666
) -> int | None:
    """Open the file ``path``, made with its folder where it is missing, and lock it.

    Args:
        path: of the file.
        refuse: called with the descriptor and what `try_lock` says; raises if the file is held by another.
        tries: how often to try again when a holder removes or renames the file before we have locked it.
        mode: permissions of a new file.

    Returns:
        The descriptor; the lock lasts until it is closed or the process ends. None if ``tries`` were not enough.

    Raises:
        OSError: if the system refuses.
    """
    for _ in range(tries):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, mode)
        except FileNotFoundError:  # the last holder has just cleared the folder away
            continue
        try:
            refuse(handle, try_lock(handle))
            # The last holder may have removed the file, or renamed it, between our opening and locking it.
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    return None


@contextmanager
def wait_for_lock(path: Path, waiting: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Hold the lock file ``path``, after waiting until no other process holds it; the file stays.

    Use it for a result that several processes need and one should make, such as compiled kernels: the others find it
    made when they have waited. If files cannot be written or locked there, the call does not wait.

    Args:
        path: of the file; missing folders are made.
        waiting: called once if another process holds it.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError:
        yield
        return
    try:
        if try_lock(handle) is False:
            waiting()
            while try_lock(handle) is False:
                time.sleep(_PAUSE)
        yield
    finally:
        os.close(handle)
