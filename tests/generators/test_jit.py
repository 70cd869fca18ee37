"""Compiled kernels in the cache are those of the present sources."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from generators.core import jit

KERNEL = """
from typing import NamedTuple

import numpy as np

from generators.core.jit import njit


class {name}(NamedTuple):
    values: np.ndarray


@njit
def total(box):
    return {factor} * box.values.sum()


print(total({name}(np.ones(3))))
"""


def run(folder: Path, cache: Path, *, name: str, factor: int) -> str:
    """What a copy of the generator prints whose kernel takes a type of some name; all files keep one date."""
    target = folder / "generators/core/summing.py"
    target.write_text(KERNEL.format(name=name, factor=factor))
    os.utime(target, (10**9, 10**9))
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(cache)}
    # Without Python's own compiled files: they, too, would take a source of the same date and length for the same.
    command = [sys.executable, "-B", "-m", "generators.core.summing"]
    done = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_kernels_whose_types_or_sources_changed_are_compiled_again(tmp_path: Path) -> None:
    source = Path(jit.__file__).parents[2]
    shutil.copytree(source / "generators/core", tmp_path / "generators/core")
    for face in source.glob("generators/__init__.py*"):
        shutil.copy(face, tmp_path / "generators")
    (tmp_path / "avs3d_bench").symlink_to(source / "avs3d_bench")
    cache = tmp_path / "cache"
    assert run(tmp_path, cache, name="Box", factor=2) == "6.0"
    assert run(tmp_path, cache, name="Bag", factor=2) == "6.0"
    assert run(tmp_path, cache, name="Bag", factor=5) == "15.0"
    assert len(list(cache.iterdir())) == 3
    # A file without kernels leaves the compiled code as it is.
    (tmp_path / "generators/core/other.py").write_text("EDITED = 1")
    assert run(tmp_path, cache, name="Bag", factor=5) == "15.0"
    assert len(list(cache.iterdir())) == 3


@jit.inline
def _halved(value: float, rounded: bool) -> float:
    return float(value // 2) if rounded else value / 2


@jit.njit
def _both(value: float) -> float:
    return _halved(value, True) + _halved(value, False) + _halved(3.0, False)


def test_constant_arguments_are_no_further_versions_of_a_function() -> None:
    """Each version is compiled, which is most of the time that a first response takes."""
    was = gc.isenabled()
    assert _both(5.0) == 2.0 + 2.5 + 1.5
    assert gc.isenabled() == was
    if hasattr(_halved, "overloads"):  # not with NUMBA_DISABLE_JIT
        assert len(_halved.overloads) <= 1  # none if `_both` was compiled by an earlier run
    assert _halved(5.0, True) == 2.0  # from Python, the function as it is written
