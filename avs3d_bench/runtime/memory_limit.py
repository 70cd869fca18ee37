"""Limits of the address space (``ulimit -v``): reported in one line before a numerical library hangs or crashes.

Observed under such limits, with numpy 2 and OpenCV 4: below 250 MB numpy's OpenBLAS loops for ever while it is
imported; up to 450 MB libraries "failed to map segment"; up to 700 MB OpenBLAS crashes, or interrupts its own process
when it cannot start a thread. Little of it can be caught, so that the limit itself is looked at first.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

from avs3d_bench.errors import Avs3dError

#: Smallest address space in which scoring was seen to work (bytes), with some room.
LEAST_ADDRESS_SPACE = 900 * 2**20
#: Below this (bytes), OpenBLAS gets one thread: each takes some 40 MB of addresses as soon as numpy is imported.
_AMPLE = 16 * 2**30
_NEED_LITTLE = ((), ("-h",), ("--help",), ("--version",))
_SIGNS = ("failed to map segment", "cannot allocate memory", "cannot create shared object descriptor")


def check_address_space(arguments: Sequence[str]) -> None:
    """Refuse to start where the libraries would hang or crash; save memory where there is not much.

    Args:
        arguments: of the command line; help and version need no library.

    Raises:
        Avs3dError: if the limit is too low.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or tuple(arguments) in _NEED_LITTLE:
        return
    if limit < LEAST_ADDRESS_SPACE:
        raise Avs3dError(
            f"the address space of this process is limited to {limit // 2**20} MB (ulimit -v {limit // 1024}), "
            f"expected at least {LEAST_ADDRESS_SPACE // 2**20} MB; raise the limit (ulimit -v unlimited)"
        )
    if limit < _AMPLE:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def out_of_memory(error: BaseException) -> str | None:
    """One line for an error that memory or a limit on it has caused; None for any other."""
    text = str(error)
    if isinstance(error, MemoryError) or (isinstance(error, ImportError) and any(sign in text for sign in _SIGNS)):
        cause = f" ({' '.join(text.split())[:200]})" if text else ""
        return f"out of memory{cause}; free some, use fewer --workers, or raise the limit (ulimit -v unlimited)"
    return None
