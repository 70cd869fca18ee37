"""gsplat's CUDA kernels, compiled once however many processes need them at the same time.

gsplat compiles them when it is first imported, into torch's folder of extensions. It clears a folder that holds no
finished library, and torch's own lock as well; so of two processes that begin with an empty cache each would delete the
other's build. Here the process that imports gsplat holds a lock beside that folder: one compiles, the others wait.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

from avs3d_bench.runtime.file_lock import wait_for_lock
from avs3d_bench.runtime.parallel import available_cores
from avs3d_bench.scheduling.errors import UnfitError

#: Compilers at a time: each takes 1 to 2 GiB.
_COMPILERS = 16


@cache
def gsplat() -> Any:
    """The package gsplat with its kernels compiled and loaded.

    Raises:
        UnfitError: if it is not installed, or its kernels are missing and cannot be compiled.
    """
    os.environ.setdefault("MAX_JOBS", str(min(_COMPILERS, available_cores())))
    with wait_for_lock(lock_file(), _say_waiting):
        try:
            import gsplat as package
            from gsplat.cuda import _backend
        except ImportError as error:
            raise UnfitError(f"gsplat cannot be imported ({error}); pip install gsplat, or use --device cpu") from None
        except Exception as error:  # a compiler that fails, a full disk: torch raises many kinds of errors
            line = " ".join(str(error).split())[:200] or type(error).__name__
            raise UnfitError(f"gsplat's kernels cannot be compiled ({line}); VERBOSE=1 shows why") from None
    if _backend._C is None:
        raise UnfitError("gsplat has no CUDA kernels: install a CUDA toolkit and gsplat again, or use --device cpu")
    return package


def lock_file() -> Path:
    """The file that is locked while gsplat is imported, in torch's folder of extensions."""
    named = os.environ.get("TORCH_EXTENSIONS_DIR")
    if not named:
        from torch.utils.cpp_extension import get_default_build_root

        named = get_default_build_root()
    return Path(named) / "avs3d-gsplat.lock"


def _say_waiting() -> None:
    print("waiting for another process to compile gsplat's kernels", file=sys.stderr, flush=True)
