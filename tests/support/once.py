"""What several files of tests need and takes long to make, such as a lit flat: made once in a run of the tests."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

from avs3d_bench.formats.atomic import atomic_path
from avs3d_bench.runtime.file_lock import wait_for_lock

T = TypeVar("T")
#: The folder of a run, which `tests/conftest.py` makes and removes; processes of pytest-xdist share it.
FOLDER = "AVS3D_TEST_RUN"


def made_once(name: str, make: Callable[[], T]) -> T:
    """What ``make`` returns: by the first process that asks for ``name`` in this run of the tests, read by the others.

    Args:
        name: for a file; each stands for one thing.
        make: returns something that can be pickled and that nobody changes.
    """
    if FOLDER not in os.environ:  # not under pytest
        return make()
    folder = Path(os.environ[FOLDER])
    path = folder / f"{name}.pickle"
    with wait_for_lock(folder / f"{name}.lock"):
        if not path.exists():
            made = make()
            # Whole or not at all: the lock of a process that was killed is free.
            with atomic_path(path) as temporary:
                temporary.write_bytes(pickle.dumps(made, protocol=pickle.HIGHEST_PROTOCOL))
            return made
    return cast(T, pickle.loads(path.read_bytes()))
