"""numba, set up for many processes: compiled code is kept in a cache folder that all processes share.

By default numba writes its cache beside the source, which fails in a read-only installation. Here the folder is
``NUMBA_CACHE_DIR`` if that is set, else ``avs3d-bench/numba`` in the user's cache folder.

Kernels are compiled without ``fastmath``: floating-point operations keep their written order, so that the bytes of a
frame do not change.
"""

from __future__ import annotations

import gc
import hashlib
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

from avs3d_bench.errors import Avs3dError
from avs3d_bench.runtime.file_lock import wait_for_lock
from avs3d_bench.runtime.imports import needing
from avs3d_bench.runtime.provenance import source_files
from generators.core.folders import user_cache

F = TypeVar("F", bound=Callable[..., Any])


def _cache_folder() -> Path:
    """The first folder that can be written to."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    own = f"avs3d-bench-{os.getuid()}" if hasattr(os, "getuid") else "avs3d-bench"
    candidates = []
    if chosen:  # by the user, or below by the process that started this one
        folder = Path(chosen)
        candidates.append(folder.parent if folder.name == kernel_digest() else folder)
    with suppress(Avs3dError):  # the user has no home folder
        candidates.append(user_cache() / "numba")
    candidates.append(Path(tempfile.gettempdir()) / own / "numba")
    for folder in candidates:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return folder
    raise Avs3dError(
        f"no writable folder for compiled kernels: tried {', '.join(map(str, candidates))}; set NUMBA_CACHE_DIR"
    )


@lru_cache(maxsize=1)
def kernel_digest() -> str:
    """Digest of the source files with kernels, or with named tuples that kernels take.

    numba compares the date of a kernel's own file alone, and fails at compiled code whose types have new names.
    """
    return _digest(lambda text: b"core.jit" in text or b"NamedTuple" in text)


def _digest(counts: Callable[[bytes], bool]) -> str:
    """Digest of source files of the generator, by name and content."""
    digest = hashlib.sha256()
    for path, file in source_files("generators"):
        text = file.read_bytes()
        if counts(text):
            digest.update(path.encode() + b"\0" + text)
    return digest.hexdigest()[:16]


CACHE_FOLDER = _cache_folder()
_KERNELS = str(CACHE_FOLDER / kernel_digest())
# numba reads the variable again now and then, and so do other processes.
os.environ["NUMBA_CACHE_DIR"] = _KERNELS
with needing("rendering", "pip install 'avs3d-bench[generate]'"):
    import numba
    from numba.core import types
    from numba.core.registry import CPUDispatcher

# numba reads the variable when it is imported, which may have happened already.
_config: Any = numba.config
_config.CACHE_DIR = _KERNELS


_unliteral: Callable[[Any], Any] = types.unliteral


class _Kernel(CPUDispatcher):
    """A kernel that compiles without the garbage collector, which would take a tenth of the time and find nothing."""

    def compile(self, sig: Any) -> Any:
        """Compile, or load, the function for the types ``sig``."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if collects:
                gc.enable()


class _Inlined(CPUDispatcher):
    """A function for kernels alone, compiled once for numbers of one type and without an entry from Python.

    numba would compile it once more for each constant argument, with two wrappers each time: a third of the time that
    all kernels take. Called from Python, it is the function as it is written.
    """

    def __call__(self, *args: Any, **named: Any) -> Any:
        return self.py_func(*args, **named)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The types of a call from a kernel; a constant is a number of its type."""
        return super().get_call_template(tuple(_unliteral(each) for each in args), kws)


def njit(function: F) -> F:
    """Compile ``function`` in nopython mode on its first call, or load it from the cache; releases the GIL.

    The cache detects changes of the files of `kernel_digest` only: values from others must be passed as arguments.
    """
    if _config.DISABLE_JIT:
        return function
    options = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    kernel = _Kernel(function, targetoptions=options)
    kernel.enable_caching()
    return cast(F, kernel)


def inline(function: F) -> F:
    """Compile a small function that kernels call, and have LLVM inline it: to pass it arrays would take time."""
    if _config.DISABLE_JIT:
        return function
    options = {"nopython": True, "error_model": "numpy", "forceinline": True}
    return cast(F, _Inlined(function, targetoptions=options | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}))


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Digest of all source files of the generator, by name and content."""
    return _digest(lambda _: True)


@contextmanager
def compile_lock(what: str) -> Iterator[None]:
    """Let one process at a time compile; the others then load its result from the cache, all at once.

    A file in the cache folder says that ``what`` has been compiled. It may be wrong (compiled code was deleted, or is
    for another kind of processor), and the folder's file system may have no locks: then several processes may compile,
    which costs only time.

    Args:
        what: which kernels, a name for files; others are compiled at the same time.
    """
    software = f"{source_digest()} {numba.__version__} {sys.version} {platform.machine()}"
    version = hashlib.sha256(software.encode()).hexdigest()[:16]
    done = CACHE_FOLDER / f"{what}-{version}.compiled"
    if not done.exists():
        with wait_for_lock(CACHE_FOLDER / f"{what}.lock"):
            if not done.exists():
                yield
                with suppress(OSError):
                    done.touch()
                return
    yield
