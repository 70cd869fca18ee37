"""gsplat's pictures beside those of our rasteriser, on one GPU.

    python -m benchmarks.splats_gpu SCAN.glb --eye X Y Z -o FILE.json

The splats are discs sampled on the scan's surface (`tests.support.captured`), with a box among them. For each number of
splats and size of picture: PSNR of gsplat's frames to ours, whether instance ids and depth are the same, whether gsplat
gives the same bytes twice, and milliseconds. Where gsplat does not work, the file says why, and the exit code is 1.
``--device cpu`` compares our rasteriser with itself: a trial of the script where there is no GPU.
"""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_json
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.splats import CASES, PITCH, YAWS, cloud_of
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Scene, StageFile
from generators.vision.splats.backend import SplatsBackend, SplatsSession, camera_of
from generators.vision.splats.cloud import SplatCloud
from generators.vision.splats.gsplat_painter import GsplatPainter, gsplat_problem, gsplat_version
from generators.vision.splats.painter import NumbaPainter, Painter
from tests.support.captured import captured

#: Seed of the splats; frames of which the median time is taken; side of the box and its distance ahead (m).
SEED, REPEATS, BOX, AHEAD = 7, 20, 0.2, 0.8


def painter(cloud: SplatCloud, device: str) -> Painter:
    """What draws on ``device``."""
    return NumbaPainter(cloud) if device == "cpu" else GsplatPainter(cloud, device)


def milliseconds(work: Callable[[], object]) -> float:
    """Median wall time of a call that ends on the CPU."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return round(1000 * float(np.median(times[1:])), 2)


def scene_of(path: Path, eye: np.ndarray) -> Scene:
    """The scan with a box before the camera's first view."""
    mesh = load_mesh(path, acoustic="plaster", twin="surface", max_acoustic_faces=10**9)
    ahead = np.array([-np.sin(YAWS[0]) * np.cos(PITCH), np.sin(PITCH), -np.cos(YAWS[0]) * np.cos(PITCH)])
    box = MeshBuilder().box((BOX, BOX, BOX), eye + AHEAD * ahead, Material("grey", "plaster")).build()
    return Scene(path.stem, (Part("scan", mesh), Part("box", box, instance_id=1)), (), (), stage=StageFile(path))


def compare(scene: Scene, eye: np.ndarray, case: tuple[int, int], device: str, pictures: Path) -> dict[str, Any]:
    """Figures of one number of splats and one size of picture; both pictures of the first view go to ``pictures``."""
    count, size = case
    table = captured(scene.parts[0].mesh, count, np.random.default_rng(SEED))
    # Harmonics of degree 3, as captured scenes have them, of some strength: their evaluation is compared, too.
    bands = np.random.default_rng(SEED).normal(0, 0.02, (count, 15, 3)).astype(np.float32)
    cloud = cloud_of(replace(table, sh=np.concatenate([table.sh, bands], axis=1)))
    camera = Intrinsics.from_fov(size)
    fast = painter(cloud, device)
    ours, theirs = (SplatsSession(scene, camera, cloud, each) for each in (painter(cloud, "cpu"), fast))
    decibels, most, same, again = [], [], [], []
    for number, yaw in enumerate(YAWS):
        pose = Pose.from_yaw(eye, yaw, PITCH)
        one, other = ours.render(pose), theirs.render(pose)
        error = np.abs(one.rgb.astype(float) - other.rgb)
        decibels.append(round(10 * float(np.log10(255**2 / max((error**2).mean(), 1e-9))), 1))
        most.append(float(np.quantile(error.max(axis=2), 0.999)))
        same.append(bool((one.instance_ids == other.instance_ids).all() and (one.depth == other.depth).all()))
        again.append(bool((theirs.render(pose).rgb == other.rgb).all()))
        if number == 0:
            cv2.imwrite(str(pictures / f"splats-{count}-{size}.png"), np.hstack([one.rgb, other.rgb])[..., ::-1])
    pose = Pose.from_yaw(eye, YAWS[0], PITCH)
    empty = np.zeros((size, size), dtype=np.float32)
    view = camera_of(camera, pose)
    return {
        "splats": count,
        "size": size,
        "PSNR to our rasteriser (dB)": decibels,
        "error that 0.1 % of the pixels exceed (of 255)": most,
        "same ids and depth": same,
        "same bytes twice": again,
        "ms of a frame": {
            "ours": milliseconds(lambda: ours.render(pose)),
            device: milliseconds(lambda: theirs.render(pose)),
        },
        "ms of the splats alone, without objects": milliseconds(lambda: fast.paint(view, empty)),
    }


def tools() -> dict[str, Any]:
    """What compiles gsplat's kernels at their first use, and where it is."""
    from torch.utils import cpp_extension

    found: dict[str, Any] = {name: shutil.which(name) for name in ("nvcc", "ninja", "c++", "g++")}
    named = {name: os.environ.get(name) for name in ("CUDA_HOME", "TORCH_CUDA_ARCH_LIST", "TORCH_EXTENSIONS_DIR")}
    return found | named | {"torch's CUDA_HOME": cpp_extension.CUDA_HOME, "python": platform.python_version()}


@click.command()
@click.argument("scan", type=click.Path(exists=True, path_type=Path))
@click.option("--eye", type=float, nargs=3, required=True, help="Where the camera stands: x, y, z of the file, Y up.")
@click.option("--device", type=click.Choice(["cuda", "cpu"]), default="cuda", show_default=True)
@click.option("--small", is_flag=True, help="One small case only.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
def main(scan: Path, eye: tuple[float, float, float], device: str, small: bool, output: Path) -> None:
    """Write OUTPUT (JSON), and pictures beside it."""
    output.parent.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Any] = {"device": device, "tools": tools()}
    start = time.perf_counter()
    problem = gsplat_problem() if device == "cuda" else None
    figures |= {"seconds to load gsplat": round(time.perf_counter() - start, 1), "problem": problem}
    if problem is None:
        figures["version"] = gsplat_version() if device == "cuda" else "our rasteriser"
        try:
            SplatsBackend(device).warm_up()
            where = np.array(eye)
            scene = scene_of(scan, where)
            cases = ((20_000, 126),) if small else CASES
            figures["cases"] = []
            for case in cases:
                figures["cases"].append(compare(scene, where, case, device, output.parent))
                print(figures["cases"][-1], flush=True)
        except (Avs3dError, RuntimeError) as error:
            figures["problem"] = f"{type(error).__name__}: {error}"
    write_json(output, figures)
    print(figures["problem"] or f"{output}: written", flush=True)
    raise SystemExit(figures["problem"] is not None)


if __name__ == "__main__":
    main()
