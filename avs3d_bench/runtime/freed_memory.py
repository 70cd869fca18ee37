"""Freed memory stays with the process."""

from __future__ import annotations

import ctypes

# Of malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
#: Bytes: the most that an int holds.
_MOST = 2**31 - 1


def keep_freed_memory() -> bool:
    """Have the C library keep what is freed, until the process ends; whether it does.

    glibc gives blocks of more than 32 MiB back at once, and every array of that size is fresh memory, each page of
    which costs a fault. The layers of a network on a CPU are such arrays.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library, or none that ctypes opens by None
        return False
    return all([mallopt(_MMAP_THRESHOLD, _MOST // 2 + 1), mallopt(_TRIM_THRESHOLD, _MOST)])
