"""numba, set up for many processes: compiled code is kept in a cache folder that all of them share.

numba writes its cache beside the source unless told otherwise, which fails in a read-only installation. The folder is
``NUMBA_CACHE_DIR`` where that is set, else ``avs3d-bench/numba`` in the user's cache folder.

Kernels are compiled without ``fastmath``: floating-point operations keep the order they are written in, and a frame
its bytes.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from avs3d_bench.errors import Avs3dError
from avs3d_bench.file_lock import turn
from generators.core.folders import user_cache

F = TypeVar("F", bound=Callable[..., Any])


def _cache_folder() -> Path:
    """The first folder that can be written to."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    own = f"avs3d-bench-{os.getuid()}" if hasattr(os, "getuid") else "avs3d-bench"
    candidates = [Path(chosen)] if chosen else []
    with suppress(Avs3dError):  # a user without a home folder
        candidates.append(user_cache() / "numba")
    candidates.append(Path(tempfile.gettempdir()) / own / "numba")
    for folder in candidates:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return folder
    raise Avs3dError(
        f"no folder for compiled kernels can be written: tried {', '.join(map(str, candidates))}; set NUMBA_CACHE_DIR"
    )


CACHE_FOLDER = _cache_folder()
os.environ["NUMBA_CACHE_DIR"] = str(CACHE_FOLDER)
try:
    import numba
except ImportError as _error:
    raise Avs3dError(
        f"rendering needs numba, which cannot be imported ({_error}): pip install 'avs3d-bench[generate]'"
    ) from _error
# numba reads the variable when it is imported, which somebody may have done before.
_config: Any = numba.config
_config.CACHE_DIR = str(CACHE_FOLDER)


def njit(function: F) -> F:
    """Compile ``function`` in nopython mode on its first call, or load it from the cache; releases the GIL.

    The cache notices changes of the kernel's own file only: what comes from other files must be an argument.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inline(function: F) -> F:
    """Compile a small function that only kernels of the same file call: LLVM makes it part of them."""
    return cast(F, numba.njit(error_model="numpy")(function))


@contextmanager
def compile_lock() -> Iterator[None]:
    """Let one process at a time compile; the others then load what it has cached.

    Where the cache folder has no locks nothing is guarded: compiling twice costs time, not correctness.
    """
    with turn(CACHE_FOLDER / "compile.lock"):
        yield
