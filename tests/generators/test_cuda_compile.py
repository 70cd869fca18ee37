"""Every kernel of pictures and rays compiles for CUDA devices; needs numba-cuda, but no device."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: pip install 'avs3d-bench[cuda]'")

import numba
import numba.cuda

from generators.core import device_rays
from generators.core.bvh import STACK
from generators.core.cuda import LEAST_CAPABILITY
from generators.core.tone import srgb_table, tone_table
from generators.vision import device_kernels
from generators.vision.device_kernels import FrameArrays, RayArrays
from generators.vision.microfacet import block_points
from generators.vision.sampling import SUB_PIXELS
from generators.vision.tables import build_tables
from generators.vision.views import trial_scene, view_of

pytestmark = pytest.mark.slow


def arguments() -> dict[str, tuple[Any, ...]]:
    """Kernel → arguments of the types that it is launched with."""
    scene, camera, pose = trial_scene()
    tables, triangles = build_tables(scene)
    view, tree = view_of(camera, pose), device_rays.build_tree(triangles)
    f32, i32, u8 = np.zeros(4, np.float32), np.zeros(4, np.int32), np.zeros(4, np.uint8)
    f32x3 = np.zeros((4, 3), np.float32)
    rays = RayArrays(f32x3, i32, f32, f32, f32, f32x3)
    colours = np.zeros((4, 3), np.uint8)
    lobes = (f32x3, f32x3, f32x3, f32x3, f32, f32, i32)
    frame = FrameArrays(i32, f32, np.zeros(4, np.uint16), colours, np.zeros((2, 4), np.uint8), i32, i32, *lobes)
    tone, points = tone_table(), block_points()
    return {
        "_intersect": (tree, np.zeros((4, 7), np.float32), 4, i32, f32x3),
        "_occluded": (tree, np.zeros((4, 7), np.float32), 4, u8),
        "trace_centres": (view, 0, 2, tree, rays),
        "trace_edges": (view, 0, SUB_PIXELS, 4, tree, rays, frame),
        "write_geometry": (0, 4, rays, tables, frame),
        "shade": (view, 1.0, 4, rays, tables),
        "reflect_centres": (view, 0, 4, tree, rays, tables, points, frame),
        "reflect_edges": (view, 0, 8, 4, tree, rays, tables, points, tone, 4.0, frame),
        "smooth": (True, view, tables, frame),
        "finish": (tables, tone, 4.0, srgb_table(), frame),
        "mark_mirrored": (view, frame),
        "clear": (frame,),
        "mark_edges": (view, tables.surface, tables.normal, frame),
        "mark_thin": (triangles, view, frame),
        "begin_list": (frame,),
        "collect": (True, frame),
        "average": (0, 4, 8, rays, srgb_table(), frame),
    }


def kernels() -> dict[str, Any]:
    """All kernels of both modules, by name."""
    return {
        name: value
        for module in (device_rays, device_kernels)
        for name, value in vars(module).items()
        if hasattr(value, "py_func") and getattr(value, "__module__", "") == module.__name__
        if type(value).__name__ == "CUDADispatcher"
    }


def test_each_kernel_has_arguments_here() -> None:
    assert set(kernels()) == set(arguments())


@pytest.mark.parametrize("capability", [LEAST_CAPABILITY, (9, 0)])
@pytest.mark.parametrize("name", sorted(arguments()))
def test_kernels_compile(name: str, capability: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    from types import SimpleNamespace

    device = SimpleNamespace(compute_capability=capability)
    monkeypatch.setattr("numba.cuda.dispatcher.get_current_device", lambda: device)
    signature = tuple(numba.typeof(value) for value in arguments()[name])
    ptx, _ = numba.cuda.compile_ptx(kernels()[name].py_func, signature, cc=capability)
    assert f".target sm_{capability[0]}{capability[1]}" in ptx
    # Boxes are tested in float32, triangles in float64.
    if name in ("_intersect", "_occluded"):
        assert ".f32" in ptx
        assert "fma.rn.f64" in ptx
        assert f"[{4 * STACK}]" in ptx or ".local" in ptx
