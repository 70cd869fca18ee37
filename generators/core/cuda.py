"""CUDA through numba-cuda: is there a usable device, its memory, kernels, arrays on the device, running out of memory.

Nothing here imports numba-cuda before it is asked for: the CPU path works without it. A module with kernels does
``from numba import cuda`` at its top and is imported after `require_device`. Its kernels call the same functions that
the CPU's loops call (`generators.core.jit.inline`), which numba compiles for both.

With ``NUMBA_ENABLE_CUDASIM=1`` numba runs kernels in Python: slow, without a device, good for tests of tiny sizes. Set
``NUMBA_DISABLE_JIT=1`` as well, since compiled functions do not take the simulator's arrays.

Examples:
    A kernel over a million numbers::

        from numba import cuda

        @kernel
        def double(values):
            i = cuda.grid(1)
            if i < values.shape[0]:
                values[i] *= 2.0

        require_device()
        values = upload(np.ones(1_000_000))
        launch(double, len(values), values)
        values.copy_to_host()
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from avs3d_bench.errors import Avs3dError

T = TypeVar("T")

#: Threads per block: a multiple of the 32 of a warp; kernels that need many registers still fit twice on a processor.
BLOCK = 128
#: The oldest devices that CUDA 13 supports (Turing, 2018).
LEAST_CAPABILITY = (7, 5)
#: Error code of CUDA's driver: out of memory (CUDA_ERROR_OUT_OF_MEMORY).
_OUT_OF_MEMORY = 2
#: Device memory of a worker process (bytes): CUDA's context and kernels, a home, a picture, the rays of a batch.
WORKER_MEMORY = 2 << 30
_INSTALL = "pip install 'avs3d-bench[cuda]'"
#: One launch at a time: numba-cuda 0.30 loads a kernel on its first one, and fails where two threads do so at once.
_LAUNCHING = threading.Lock()
#: One thread at a time changes numba's settings.
_SETTING = threading.Lock()


class OutOfDeviceMemoryError(Avs3dError):
    """The device has too little free memory. Callers halve their batch and try again (`in_batches`)."""


@dataclass(frozen=True)
class Device:
    """The CUDA device in use.

    Attributes:
        name: e.g. ``NVIDIA H200``.
        capability: compute capability, e.g. (9, 0).
        memory: bytes in all.
        free: bytes that were free when it was looked at.
    """

    name: str
    capability: tuple[int, int]
    memory: int
    free: int

    def __str__(self) -> str:
        """``NVIDIA H200 (compute capability 9.0, 139.8 GiB, 139.2 GiB free)``."""
        major, minor = self.capability
        return (
            f"{self.name} (compute capability {major}.{minor}, {self.memory / 2**30:.1f} GiB, "
            f"{self.free / 2**30:.1f} GiB free)"
        )


def is_simulated() -> bool:
    """Whether numba runs kernels in Python instead of on a device."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


@lru_cache(maxsize=1)
def cuda_problem() -> str | None:
    """One line why CUDA cannot be used, and what to do; None if it can. The first call takes seconds."""
    if is_simulated():
        return None
    if find_spec("numba_cuda") is None:
        return f"numba-cuda is not installed: {_INSTALL}"
    try:
        cuda = _numba_cuda()
        device = cuda.get_current_device()
        capability = tuple(device.compute_capability)
        cuda.current_context().get_memory_info()
    except Exception as error:  # the driver, the libraries or the device: each has exceptions of its own
        said = _one_line(error)
        if _is_out_of_memory(error):
            return f"the device has no memory left for a process ({said}); end other programs, or use fewer --workers"
        if "driver library cannot be found" in said:
            return "no NVIDIA driver is installed (libcuda.so.1 is missing); without one, use --device cpu"
        if "NO_DEVICE" in said or "no CUDA-capable device" in said or "No CUDA GPUs" in said:
            return f"the NVIDIA driver finds no device ({said}); check nvidia-smi and CUDA_VISIBLE_DEVICES"
        return f"CUDA does not start ({said}); check nvidia-smi, and that the driver suits CUDA of {_INSTALL}"
    if capability < LEAST_CAPABILITY:
        least = ".".join(map(str, LEAST_CAPABILITY))
        return f"{_text(device.name)} has compute capability {capability[0]}.{capability[1]}; expected {least} or newer"
    return None


def require_device() -> Device:
    """The device in use.

    Raises:
        Avs3dError: one line why there is none.
    """
    problem = cuda_problem()
    if problem is not None:
        raise Avs3dError(f"CUDA cannot be used: {problem}")
    if is_simulated():
        return Device("CUDA simulator", (0, 0), 0, 0)
    cuda = _numba_cuda()
    device = cuda.get_current_device()
    info = cuda.current_context().get_memory_info()
    return Device(_text(device.name), tuple(device.compute_capability), int(info.total), int(info.free))


def visible_devices() -> tuple[str, ...]:
    """The devices that this process sees and that are of the kind in use, as CUDA_VISIBLE_DEVICES names them.

    A frame has the same bytes on devices of one kind alone. Empty in the simulator.

    Raises:
        Avs3dError: if CUDA cannot be used.
    """
    mine = require_device().name
    if is_simulated():
        return ()
    found = [_text(device.name) for device in _numba_cuda().list_devices()]
    named = [name.strip() for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name.strip()]
    names = named or [str(number) for number in range(len(found))]
    return tuple(name for name, kind in zip(names, found, strict=False) if kind == mine)


def most_workers() -> int:
    """How many worker processes the free memory of the device has room for, at least 1.

    Raises:
        Avs3dError: if CUDA cannot be used.
    """
    return max(1, require_device().free // WORKER_MEMORY)


def cuda_version() -> str:
    """The versions that decide a kernel's bytes: numba-cuda and the kind of device.

    Raises:
        Avs3dError: if CUDA cannot be used.
    """
    device = require_device()
    try:
        own = version("numba-cuda")
    except PackageNotFoundError:
        own = "missing"
    return f"numba-cuda {own} on {device.name}"


def kernel(function: Callable[..., None]) -> Any:
    """Compile ``function`` for CUDA on its first launch, or load it from the cache; see `launch`.

    Without ``fastmath``: operations keep their written order. (A product and the sum that takes it may be fused, which
    a device always does in the same way.) The cache belongs to this version of the source: numba would notice changes
    of the kernel's own file only, and its functions come from others, too.
    """
    cuda = _numba_cuda()
    if is_simulated():
        return cuda.jit(function)
    with _cache_of_source():
        return cuda.jit(cache=True)(function)


def launch(kernel: Any, count: int, *args: Any, stream: Any = 0, block: int = BLOCK) -> None:
    """Run ``kernel`` with at least ``count`` threads in blocks of ``block``; 0 threads are no launch.

    Args:
        kernel: made by `kernel`; it returns at once in threads from ``count`` on (``cuda.grid(1)``).
        count: number of threads.
        args: device arrays, named tuples of them, numbers.
        stream: CUDA stream; 0: the default one.
        block: threads per block; fewer than `BLOCK` spread few long threads over more processors.

    Raises:
        OutOfDeviceMemoryError: the kernel's own memory (stacks) does not fit.
    """
    if count <= 0:
        return
    block = min(block, count) if is_simulated() else block
    with memory_for(f"a kernel of {count:,} threads"), _LAUNCHING:
        kernel[(count + block - 1) // block, block, stream](*args)


def upload(value: T, what: str = "data", stream: Any = 0) -> T:
    """Copy an array, or the arrays of a (named) tuple, to the device; numbers stay as they are.

    Raises:
        OutOfDeviceMemoryError: naming ``what`` and its size.
    """
    moved: Any = value
    if isinstance(value, np.ndarray):
        cuda = _numba_cuda()
        with memory_for(what, value.nbytes):
            moved = cuda.to_device(np.ascontiguousarray(value), stream=stream)
    elif isinstance(value, tuple):
        # The simulator's kernels take the arrays of a tuple as they are.
        parts = value if is_simulated() else [upload(each, what, stream) for each in value]
        moved = type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return moved  # type: ignore[no-any-return]


def allocate(shape: int | tuple[int, ...], dtype: DTypeLike, what: str = "results", stream: Any = 0) -> Any:
    """An array on the device, not initialised.

    Raises:
        OutOfDeviceMemoryError: naming ``what`` and its size.
    """
    cuda = _numba_cuda()
    with memory_for(what, int(np.prod(shape)) * np.dtype(dtype).itemsize):
        return cuda.device_array(shape, dtype=dtype, stream=stream)


def pinned(shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """An array of the host's memory that the device reads and writes at full speed; use it again and again.

    Raises:
        OutOfDeviceMemoryError: if the host cannot spare so much for the device.
    """
    cuda = _numba_cuda()
    if is_simulated():
        return np.empty(shape, dtype=dtype)
    with memory_for("buffers on the host", int(np.prod(shape)) * np.dtype(dtype).itemsize):
        return np.asarray(cuda.pinned_array(shape, dtype=dtype))


@contextmanager
def memory_for(what: str, size: int | None = None) -> Iterator[None]:
    """Turn CUDA's out-of-memory error into `OutOfDeviceMemoryError`, which names ``what`` and its ``size`` (bytes)."""
    try:
        yield
    except Exception as error:
        if not _is_out_of_memory(error):
            raise
        raise OutOfDeviceMemoryError(f"CUDA: too little device memory for {what}{_sizes(size)}") from error


def in_batches(work: Callable[[int, int], None], count: int, batch: int, least: int = 1) -> int:
    """Call ``work(first, last)`` for pieces of 0 … ``count``, smaller ones when the device runs out of memory.

    Args:
        work: does one piece; a piece that ran out of memory is done again in halves.
        count: of all.
        batch: size of the pieces at first.
        least: pieces are not made smaller than this.

    Returns:
        the size that fitted, with which the next call may begin.

    Raises:
        OutOfDeviceMemoryError: if a piece of ``least`` does not fit.
    """
    first = 0
    while first < count:
        last = min(first + batch, count)
        try:
            work(first, last)
        except OutOfDeviceMemoryError:
            if last - first <= least:
                raise
            batch = max((last - first + 1) // 2, least)
            continue
        first = last
    return batch


def _is_out_of_memory(error: Exception) -> bool:
    if isinstance(error, OutOfDeviceMemoryError):
        return False
    code = getattr(error, "code", None)
    return (isinstance(code, int) and int(code) == _OUT_OF_MEMORY) or "CUDA_ERROR_OUT_OF_MEMORY" in str(error)


def _sizes(size: int | None) -> str:
    own = "" if size is None else f" ({size / 2**20:,.1f} MiB)"
    try:
        device = require_device()
    except Exception:  # a context that has failed cannot be asked
        return f"{own}; use a larger device, or --device cpu"
    return (
        f"{own}: {device.free / 2**20:,.0f} of {device.memory / 2**20:,.0f} MiB of {device.name} are free; end other "
        "programs on it, use fewer --workers, or --device cpu"
    )


@contextmanager
def _cache_of_source() -> Iterator[None]:
    """Have numba-cuda keep what it compiles in a folder of this version of the source."""
    from generators.core.jit import CACHE_FOLDER, source_digest

    try:
        from numba.cuda.core import config as config
    except ImportError:  # the module that comes with numba itself, where numba-cuda is not installed
        from numba.core import config as config
    settings: Any = config
    with _SETTING:  # modules with kernels may be imported by several threads
        before = settings.CACHE_DIR
        settings.CACHE_DIR = str(CACHE_FOLDER / "cuda" / source_digest())
        try:
            yield
        finally:
            settings.CACHE_DIR = before


def _numba_cuda() -> Any:
    # numba-cuda 0.30 names this function as it compiles; numpy 2.5 has removed it.
    np.__dict__.setdefault("row_stack", np.vstack)
    # A warning for each launch of few threads, which a small picture or the last rays of a batch are.
    os.environ.setdefault("NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS", "0")
    from numba import cuda

    return cuda


def _one_line(error: Exception) -> str:
    return re.sub(r"\s+", " ", str(error)).strip(" :.") or type(error).__name__


def _text(name: str | bytes) -> str:
    return name.decode() if isinstance(name, bytes) else str(name)
