"""A machine without Mitsuba, or whose LLVM is too old for it: one line that says what to install, or the slow variant.

Mitsuba itself is not imported: a module of its name stands for it, which ends the process where LLVM 15 does.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from avs3d_bench.errors import Avs3dError
from generators.core.cuda import OutOfDeviceMemoryError
from generators.run.doctor import checks
from generators.vision.mitsuba_scene import device_memory, load_mitsuba

STAND_IN = """
import os

class LogLevel:
    Error = 0

def variants():
    return ["scalar_rgb", "llvm_ad_rgb", "cuda_ad_rgb"]

def set_variant(name):
    global chosen
    if name != "scalar_rgb":
        os._exit(134)
    chosen = name

def set_log_level(level):
    pass
"""


@pytest.fixture
def old_llvm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every variant but the scalar one ends its process, as ``LLVM ERROR: Cannot select …`` does."""
    (tmp_path / "mitsuba.py").write_text(STAND_IN, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)
    # Set first: so that a Mitsuba that was imported comes back, and the stand-in goes.
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    del sys.modules["mitsuba"]


def test_no_mitsuba_is_one_line_with_the_extra_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(Avs3dError, match=r"pip install 'avs3d-bench\[pathtraced\]'") as caught:
        load_mitsuba()
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("old_llvm")
def test_too_old_an_llvm_is_one_line_that_names_the_version_and_the_variable() -> None:
    with pytest.raises(Avs3dError, match="cuda_ad_rgb, llvm_ad_rgb works here") as caught:
        load_mitsuba("cuda_ad_rgb", "llvm_ad_rgb")
    message = str(caught.value)
    assert "\n" not in message
    for told in ("LLVM library of version 16 or newer", "apt install libllvm19", "$DRJIT_LIBLLVM_PATH", "NVIDIA GPU"):
        assert told in message


@pytest.mark.parametrize(
    "said", ["jit_malloc(): out of memory! Could not allocate 4096 bytes", "CUDA_ERROR_OUT_OF_MEMORY"]
)
def test_a_gpu_without_memory_is_one_line_and_no_slower_variant(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, old_llvm: None, said: str
) -> None:
    full = STAND_IN.replace(
        'if name != "scalar_rgb":', f'if name == "cuda_ad_rgb":\n        raise RuntimeError({said!r})'
    )
    (tmp_path / "mitsuba.py").write_text(full, encoding="utf-8")
    with pytest.raises(
        OutOfDeviceMemoryError, match=r"too little free memory.*--workers.*CUDA_VISIBLE_DEVICES"
    ) as caught:
        load_mitsuba("cuda_ad_rgb", "llvm_ad_rgb")
    assert "\n" not in str(caught.value)


def test_memory_that_runs_out_while_paths_are_followed_is_the_same_line() -> None:
    with pytest.raises(OutOfDeviceMemoryError, match="too little free memory"), device_memory():
        raise RuntimeError("jit_malloc(): out of memory! Could not allocate 268435456 bytes of device memory.")
    with pytest.raises(RuntimeError, match="another"), device_memory():
        raise RuntimeError("another failure")


@pytest.mark.usefixtures("old_llvm")
def test_doctor_says_that_the_llvm_is_too_old_and_what_to_install() -> None:
    (check,) = (check for check in checks() if check.name == "mitsuba")
    (found,) = check.run()
    assert (found.state, found.name) == ("broken", "mitsuba")
    assert "LLVM library of version 16 or newer" in found.found
    assert "apt install libllvm19" in found.fix
    assert "\n" not in found.found


@pytest.mark.usefixtures("old_llvm")
def test_the_reference_falls_back_to_the_scalar_variant() -> None:
    assert load_mitsuba().chosen == "scalar_rgb"
