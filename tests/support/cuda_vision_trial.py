"""Run by tests/generators/test_cuda_vision.py in processes of their own: the GPU renderer against the CPU's.

python cuda_vision_trial.py simulator | device | memory
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Material, Part, Scene, Texture
from generators.vision import cuda as gpu
from generators.vision.embree import EmbreeBackend


def scene() -> Scene:
    """A lit, textured table with a wire across it, which no ray through a pixel's centre meets everywhere."""
    rng = np.random.default_rng(3)
    texture = Texture("noise", rng.integers(0, 255, (16, 16, 3), dtype=np.uint8))
    table = MeshBuilder().box((1.2, 0.1, 1.0), (0, 0, 0), Material("wood", "wood", texture=texture)).build()
    lamp = (
        MeshBuilder().box((0.3, 0.3, 0.3), (0.2, 0.3, 0), Material("lamp", "glass", emission=(2.0, 1.5, 0.5))).build()
    )
    wire = MeshBuilder().box((1.6, 0.004, 0.004), (0, 0.2, 0.4), Material("steel", "metal", (0.9, 0.1, 0.1))).build()
    uv = rng.uniform(0, 1, table.uv.shape).astype(np.float32)
    light = LightMap(uv, rng.uniform(0.2, 1.5, (8, 9, 3)).astype(np.float16))
    parts = (Part("table", table, light=light), Part("lamp", lamp, instance_id=2), Part("wire", wire, instance_id=7))
    return replace(Scene("trial", parts, (), ()), exposure=0.8)


def views(count: int) -> list[Pose]:
    """Poses round the table."""
    return [Pose.from_yaw((1.6 * np.sin(a), 0.35, 1.6 * np.cos(a)), a) for a in np.linspace(0, 2 * np.pi, count, False)]


def compare(size: int, count: int) -> tuple[float, float, float]:
    """The worst agreement over some views; every frame is rendered twice and has the same bytes."""
    there = gpu.CudaBackend().open(scene(), Intrinsics.from_fov(size))
    here = EmbreeBackend().open(scene(), Intrinsics.from_fov(size))
    found = []
    for pose in views(count):
        frame, again, expected = there.render(pose), there.render(pose), here.render(pose)
        assert frame.rgb.tobytes() == again.rgb.tobytes()
        assert frame.depth.tobytes() == again.depth.tobytes()
        found.append(gpu.agreement(frame, expected))
        assert {0, 2} <= set(np.unique(frame.instance_ids)) <= {0, 2, 7}
    shared = there.share()
    assert shared is not None
    assert shared.render(views(1)[0]).rgb.tobytes() == there.render(views(1)[0]).rgb.tobytes()
    there.close()
    there.close()
    equal, apart, psnr = zip(*found, strict=True)
    return min(equal), max(apart), min(psnr)


if __name__ == "__main__":
    mode = sys.argv[1]
    if mode == "simulator":
        gpu.RAYS = gpu.LEAST_RAYS = 128  # several blocks of rows, and of edges
        print(*compare(20, 1))
    elif mode == "device":
        print(*compare(504, 6))
