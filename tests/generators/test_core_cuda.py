"""`generators.core.cuda` without a device: reasons in one line, running out of memory, kernels in numba's simulator."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from generators.core import cuda, jit
from generators.core.cuda import OutOfDeviceMemoryError, cuda_problem, in_batches, memory_for, require_device

SIMULATOR = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "ignore"}


@pytest.fixture(autouse=True)
def _asked_again() -> Iterator[None]:
    cuda_problem.cache_clear()
    yield
    cuda_problem.cache_clear()


def test_a_missing_package_is_named_with_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(cuda, "find_spec", lambda name: None)
    with pytest.raises(Avs3dError) as caught:
        require_device()
    assert str(caught.value) == (
        "CUDA cannot be used: numba-cuda is not installed: pip install 'avs3d-bench[cuda]'"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("raised", "expected"),
    [
        (
            ImportError("Error at driver init: \n\nCUDA driver library cannot be found.\n"),
            "no NVIDIA driver is installed",
        ),
        (RuntimeError("[100] Call to cuInit results in CUDA_ERROR_NO_DEVICE"), "the NVIDIA driver finds no device"),
        (
            RuntimeError("[804] Call to cuInit results in\nCUDA_ERROR_COMPAT"),
            "CUDA does not start ([804] Call to cuInit",
        ),
        (
            RuntimeError("[2] Call to cuDevicePrimaryCtxRetain results in CUDA_ERROR_OUT_OF_MEMORY"),
            "the device has no memory left for a process ([2] Call to cuDevicePrimaryCtxRetain",
        ),
    ],
)
def test_what_the_driver_says_is_one_line(monkeypatch: pytest.MonkeyPatch, raised: Exception, expected: str) -> None:
    def fail() -> None:
        raise raised

    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(cuda, "find_spec", lambda name: object())
    monkeypatch.setitem(sys.modules, "numba.cuda", SimpleNamespace(get_current_device=fail))
    monkeypatch.setattr("numba.cuda", sys.modules["numba.cuda"], raising=False)
    problem = cuda_problem()
    assert problem is not None
    assert problem.startswith(expected)
    assert "\n" not in problem


def test_an_old_device_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    device = SimpleNamespace(compute_capability=(6, 1), name=b"NVIDIA TITAN Xp")
    context = SimpleNamespace(get_memory_info=lambda: SimpleNamespace(free=1, total=2))
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(cuda, "find_spec", lambda name: object())
    fake = SimpleNamespace(get_current_device=lambda: device, current_context=lambda: context)
    monkeypatch.setitem(sys.modules, "numba.cuda", fake)
    monkeypatch.setattr("numba.cuda", fake, raising=False)
    assert cuda_problem() == "NVIDIA TITAN Xp has compute capability 6.1; expected 7.5 or newer"


class _DriverError(Exception):
    """As numba-cuda's CudaAPIError."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(code, message)
        self.code = code


@pytest.mark.parametrize(
    "error",
    [
        _DriverError(2, "Call to cuMemAlloc results in CUDA_ERROR_OUT_OF_MEMORY"),
        RuntimeError("CUDA_ERROR_OUT_OF_MEMORY"),
    ],
)
def test_running_out_of_memory_names_what_did_not_fit(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    device = cuda.Device("NVIDIA T4", (7, 5), 16 << 30, 100 << 20)
    monkeypatch.setattr(cuda, "require_device", lambda: device)
    with pytest.raises(OutOfDeviceMemoryError) as caught, memory_for("the textures", 3 << 30):
        raise error
    assert str(caught.value) == (
        "CUDA: too little device memory for the textures (3,072.0 MiB): 100 of 16,384 MiB of NVIDIA T4 are free; "
        "end other programs on it, use fewer --workers, or --device cpu"
    )


def test_other_errors_of_the_driver_pass_unchanged() -> None:
    with pytest.raises(_DriverError, match="ILLEGAL_ADDRESS"), memory_for("the textures", 1):
        raise _DriverError(700, "CUDA_ERROR_ILLEGAL_ADDRESS")


@given(count=st.integers(0, 400), batch=st.integers(1, 500), room=st.integers(1, 500))
def test_batches_cover_everything_once_and_in_order(count: int, batch: int, room: int) -> None:
    done: list[int] = []

    def work(first: int, last: int) -> None:
        if last - first > room:
            raise OutOfDeviceMemoryError("full")
        done.extend(range(first, last))

    size = in_batches(work, count, batch)
    assert done == list(range(count))
    assert size == batch or size <= room


def test_a_batch_of_the_least_size_that_does_not_fit_is_an_error() -> None:
    tried = []

    def work(first: int, last: int) -> None:
        tried.append(last - first)
        raise OutOfDeviceMemoryError("full")

    with pytest.raises(OutOfDeviceMemoryError):
        in_batches(work, 100, 64, least=16)
    assert tried == [64, 32, 16]


_PROGRAM = """
import numpy as np
from typing import NamedTuple
from numba import cuda
from generators.core.cuda import allocate, kernel, launch, require_device, upload
from generators.core.jit import inline


class Pair(NamedTuple):
    a: np.ndarray
    b: np.ndarray


@inline
def product(x, y):
    return x * y


@kernel
def multiply(pair, factor, out):
    i = cuda.grid(1)
    if i < out.shape[0]:
        out[i] = factor * product(pair.a[i], pair.b[i])


print(require_device().name)
pair = upload(Pair(np.arange(300.0), np.full(300, 2.0)), "a pair")
out = allocate(300, np.float64)
launch(multiply, 300, pair, 0.5, out)
assert (out.copy_to_host() == np.arange(300.0)).all()
launch(multiply, 0, pair, 0.5, out)
"""


def test_a_kernel_with_a_shared_function_runs_in_the_simulator(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], env=SIMULATOR, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "CUDA simulator"


def test_threads_launch_kernels_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """numba-cuda fails where two threads load the same kernel at once."""
    running, most = 0, 0

    class Kernel:
        def __getitem__(self, shape: object) -> Callable[..., None]:
            def run(*args: object) -> None:
                nonlocal running, most
                running += 1
                most = max(most, running)
                time.sleep(0.005)
                running -= 1

            return run

    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: cuda.launch(Kernel(), 1), range(16)))
    assert most == 1


def test_buffers_on_the_host_that_do_not_fit_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Callers of `pinned` then take fewer rays, as they do where the device's memory is short."""

    def fail(*args: object, **named: object) -> None:
        raise _DriverError(2, "Call to cuMemHostAlloc results in CUDA_ERROR_OUT_OF_MEMORY")

    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.setattr(cuda, "_numba_cuda", lambda: SimpleNamespace(pinned_array=fail))
    monkeypatch.setattr(cuda, "require_device", lambda: cuda.Device("NVIDIA T4", (7, 5), 16 << 30, 1 << 30))
    with pytest.raises(OutOfDeviceMemoryError, match=r"^CUDA: too little .* for buffers on the host \(4\.0 MiB\)"):
        cuda.pinned((1 << 18, 4), "float32")


def test_threads_that_make_kernels_leave_the_cache_folder_as_it_was() -> None:
    try:
        from numba.cuda.core import config as config
    except ImportError:
        from numba.core import config as config
    with cuda._cache_of_source():  # imports what sets the folder of the CPU's kernels
        pass
    before, inside = config.CACHE_DIR, []

    def make(_: int) -> None:
        with cuda._cache_of_source():
            time.sleep(0.002)
            inside.append(config.CACHE_DIR)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(make, range(16)))
    assert before == config.CACHE_DIR
    assert len(set(inside)) == 1
    assert inside[0].endswith(jit.source_digest())


def test_kernels_are_compiled_by_one_and_then_loaded_by_all_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "CACHE_FOLDER", tmp_path)
    together, most, order = [0], [0], []
    lock = threading.Lock()

    def warm_up(number: int) -> None:
        with jit.compile_lock("trial"):
            with lock:
                together[0] += 1
                most[0] = max(most[0], together[0])
                order.append(len(list(tmp_path.glob("trial-*.compiled"))))
            time.sleep(0.3)
            with lock:
                together[0] -= 1

    warm_up(0)
    assert order == [0]
    threads = [threading.Thread(target=warm_up, args=(number,)) for number in range(1, 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert order[1:] == [1] * 4
    assert most[0] > 1


def test_kernels_that_failed_to_compile_do_not_count_as_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jit, "CACHE_FOLDER", tmp_path)
    with pytest.raises(Avs3dError), jit.compile_lock("trial"):
        raise Avs3dError("no compiler")
    assert not list(tmp_path.glob("*.compiled"))
