"""CPU time of one full-size frame (RGB, ids, depth) in a furnished, lit flat, photographed by the default camera.

As a script, it prints a table.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.light_reference import with_matte_materials
from generators.core.cuda import cuda_problem
from generators.core.scene import Scene
from generators.options import GenerateOptions
from generators.vision.camera import CameraBackend
from generators.vision.embree import EmbreeBackend

#: Headings from the middle of each room, degrees.
HEADINGS = (0.0, 75.0, 160.0, 250.0)


def _cpu(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _flat() -> Scene:
    from generators.apartments.apartment import build_apartment
    from generators.lighting.bake import bake

    return bake(build_apartment("bench", 1), quality="preview")


def camera_backend() -> CameraBackend:
    """The default renderer before the default camera, as datasets are made."""
    return CameraBackend(EmbreeBackend(), np.random.default_rng(0), GenerateOptions().camera)


def _views(flat: Scene, camera: Intrinsics, repeats: int) -> list[float]:
    """CPU time of each view, the median of its repetitions (s)."""
    session = camera_backend().open(flat, camera)
    views: list[float] = []
    for room in flat.rooms:
        x, _, z = (np.array(room.low) + np.array(room.high)) / 2
        for heading in HEADINGS:
            pose = Pose.from_yaw((x, 1.5, z), np.radians(heading))
            views.append(float(np.median([_cpu(partial(session.render, pose)) for _ in range(repeats)])))
    session.close()
    return views


def bench_vision(scene: Scene | None = None, size: int = 1008, repeats: int = 5) -> dict[str, float]:
    """Medians over all views of all rooms, each rendered ``repeats`` times.

    Args:
        scene: the scene; default: an apartment with quickly baked light (the resolution of light maps does not change
            the time).
        size: side of a picture, pixels.
        repeats: number of runs per view, whose median is taken.

    Returns:
        ``open_cpu_s``, ``frame_cpu_s`` (median of the views), ``frame_cpu_s_worst`` (slowest view),
        ``frame_cpu_s_matte`` (median with matte materials, which need no reflections), ``faces``, ``views``.
    """
    camera_backend().warm_up()
    flat = scene or _flat()
    camera = Intrinsics.from_fov(size)
    opening = float(np.median([_cpu(lambda: EmbreeBackend().open(flat, camera)) for _ in range(repeats)]))
    views = _views(flat, camera, repeats)
    matte = _views(with_matte_materials(flat), camera, repeats)
    return {
        "open_cpu_s": opening,
        "frame_cpu_s": float(np.median(views)),
        "frame_cpu_s_worst": max(views),
        "frame_cpu_s_matte": float(np.median(matte)),
        "faces": float(sum(len(part.mesh.positions) for part in flat.parts)),
        "views": float(len(views)),
    }


def cuda_frame(flat: Scene, size: int = 1008, repeats: int = 5) -> float:
    """Wall time of a frame on the CUDA device, copies to the host included: median over all views (s)."""
    from generators.vision.cuda import CudaBackend

    session = CudaBackend().open(flat, Intrinsics.from_fov(size))
    taken = []
    for room in flat.rooms:
        x, _, z = (np.array(room.low) + np.array(room.high)) / 2
        for heading in HEADINGS:
            pose = Pose.from_yaw((x, 1.5, z), np.radians(heading))
            session.render(pose)  # compiles
            for _ in range(repeats):
                start = time.perf_counter()
                session.render(pose)
                taken.append(time.perf_counter() - start)
    session.close()
    return float(np.median(taken))


def run_all(repeats: int = 5) -> dict[str, float]:
    """Figures for `make bench`, in an apartment of the open benchmark."""
    from benchmarks.bench_pipeline import MANIFEST
    from generators.core.folders import default_cache
    from generators.homes.store import open_home
    from generators.plan import make_plans, read_manifest

    flat = open_home(
        make_plans(read_manifest(MANIFEST), GenerateOptions(audio="analytic"))[0], default_cache(), workers=2
    )
    figures = bench_vision(flat, repeats=repeats)
    on_device = {} if cuda_problem() else {"RGB + ids + depth, 1008², on CUDA (s)": cuda_frame(flat, repeats=repeats)}
    return on_device | {
        "RGB + ids + depth, 1008² (CPU s)": figures["frame_cpu_s"],
        "RGB + ids + depth, slowest view (CPU s)": figures["frame_cpu_s_worst"],
        "RGB + ids + depth, matte materials (CPU s)": figures["frame_cpu_s_matte"],
        "opening the scene (CPU s)": figures["open_cpu_s"],
        "triangles of the flat": figures["faces"],
        "views": figures["views"],
    }


if __name__ == "__main__":
    print(json.dumps(bench_vision(), indent=2))
