"""The tracer's kernels with many arguments compile for CUDA devices; needs numba-cuda, but no device."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install 'avs3d-bench[cuda]'")

import numba
import numba.cuda

from generators.acoustics.geometry import AcousticMesh
from generators.acoustics.tracer.device import binaural, kernels
from generators.acoustics.tracer.early import images_of
from generators.acoustics.tracer.receivers.gridding import window_table
from generators.acoustics.tracer.surfaces import surfaces_of
from generators.core.cuda import LEAST_CAPABILITY


def visibility() -> tuple[Any, ...]:
    """Arguments of the types that the kernel of image sources is launched with."""
    corners = np.array([[0.0, 0.0, -3.0], [0.0, 0.0, 3.0], [0.0, -4.0, 0.0]])
    surfaces = surfaces_of(AcousticMesh(corners, {"wood": np.array([[0, 1, 2]])}))
    images = images_of(surfaces, np.array([-1.0, -0.5, 0.0]), 1, 0)
    found = np.zeros((1, 1), np.bool_), np.zeros((1, 1, 8), np.float32)
    where = np.zeros((1, 3)), images.source, images.sequences, images.positions
    return surfaces.mesh, surfaces.rims, surfaces.plane_equation, *where, *found


def between() -> tuple[Any, ...]:
    """Arguments of the kernel that counts walls."""
    mesh, rims, _, listeners, source, *_ = visibility()
    return mesh, rims, listeners, source, 5, np.zeros(1, np.int64), np.zeros((1, 8))


def spread() -> tuple[Any, ...]:
    """Arguments of the kernel that adds arrivals to the grids of both ears."""
    layout = binaural._OctaveLayout(*(np.zeros(8, np.int64) for _ in range(8)))
    pressure, owner = np.zeros((2, 8), np.float32), np.zeros(2, np.int32)
    heard = binaural.DeviceRecords(owner, np.zeros(2), np.zeros((2, 3), np.float32), pressure, 2, 1.0)
    rows = np.zeros((3, 4), np.float32)
    turns, residual, grids = np.zeros((1, 3, 3)), np.zeros((2, 1)), np.zeros((1, 2, 9), np.int64)
    return heard, np.zeros(1, np.int32), turns, 0, 0, residual, rows, window_table(), layout, 0.1, grids


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kernel", "arguments"),
    [(kernels.visibility, visibility), (kernels.walls_between, between), (binaural._spread, spread)],
)
def test_a_kernel_of_the_tracer_compiles(kernel: Any, arguments: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    device = SimpleNamespace(compute_capability=LEAST_CAPABILITY)
    monkeypatch.setattr("numba.cuda.dispatcher.get_current_device", lambda: device)
    signature = tuple(numba.typeof(value) for value in arguments())
    ptx, _ = numba.cuda.compile_ptx(kernel.py_func, signature, cc=LEAST_CAPABILITY)
    assert f".target sm_{LEAST_CAPABILITY[0]}{LEAST_CAPABILITY[1]}" in ptx
