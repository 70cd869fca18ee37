"""What bounds numerical libraries to one thread a process.

The environment variables must be set before numpy is imported, so this module imports nothing of the kind.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

#: Variable → value: OpenMP, OpenBLAS, numba and OpenCV use one thread. Parallel work is spread over processes, and
#: results are the same on any machine.
ONE_THREAD = {
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1",
}  # fmt: skip


@contextmanager
def one_core() -> Iterator[None]:
    """This thread, and threads that begin meanwhile, stay on one core; other processes take others.

    For libraries that begin a thread for each core and read no variable, as Embree does where it makes its device.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[os.getpid() % len(cores)]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
