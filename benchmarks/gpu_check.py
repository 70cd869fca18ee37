"""Compares plain torch with gsplat on a GPU, and times one whole training. Prints one JSON document.

    python -m benchmarks.gpu_check --dataset ROOT --key part_1/apartment_1/kitchen/1 [--iterations 30000] [--cold]

Without ``--dataset`` only the rasterisers are compared. Exit code 1 if they disagree. ``--cold`` has two processes load
gsplat at the same time with an empty cache of kernels, and counts the builds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from baselines.echosegnet.densify import DensityControl
from baselines.echosegnet.gaussians import Gaussians, write_ply
from baselines.echosegnet.rasteriser.default import GsplatRasteriser, Rasteriser, TorchRasteriser, contributions
from baselines.echosegnet.similarity import ssim
from baselines.echosegnet.train import TrainingSettings, TrainingState, train, view_psnr
from baselines.echosegnet.views import RegisteredView, load_points, load_views, test_views, train_views

_NAMES = ("means", "log_scales", "rotations", "opacities", "sh")
#: Tolerance relative to the reference's norm, for single precision and for pairs on either side of the 1/255 threshold.
TOLERANCE = {"picture": 2e-3, "gradient": 1e-2}


def _scene(count: int, size: int, seed: int) -> tuple[Gaussians, RegisteredView]:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 6.0, count)
    xy = rng.uniform(-1.2, 1.2, (count, 2)) * depth[:, None]
    parts = (
        np.column_stack([xy, depth]), np.log(0.03) + 0.6 * rng.normal(size=(count, 3)), rng.normal(size=(count, 4)),
        rng.normal(0.0, 2.0, count), 0.3 * rng.normal(size=(count, 16, 3)),
    )  # fmt: skip
    camera = Intrinsics(size, size, size / 2, size / 2, size / 2, size / 2)
    view = RegisteredView("frame_001", "train", camera, np.eye(3), np.zeros(3), None)  # type: ignore[arg-type]
    return Gaussians(*(torch.tensor(part, dtype=torch.float32, device="cuda") for part in parts)), view


def _draw(rasteriser: Rasteriser, scene: Gaussians, view: RegisteredView, weights: Tensor) -> dict[str, Tensor]:
    parts = {name: getattr(scene, name).clone().requires_grad_() for name in _NAMES}
    r = rasteriser.render(Gaussians(**parts), view, background=weights.new_tensor([0.2, 0.4, 0.6]))
    loss = (
        (r.rgb * weights[..., :3]).sum() + (r.alpha * weights[..., 3]).sum() + 0.1 * (r.depth * weights[..., 4]).sum()
    )
    torch.autograd.backward(loss)
    out = {"rgb": r.rgb, "alpha": r.alpha, "depth": r.depth}
    for name, part in parts.items():
        assert part.grad is not None
        out[f"gradient of {name}"] = part.grad
    splat = rasteriser.splat(Gaussians(**parts), view)
    splat.means2d.retain_grad()
    torch.autograd.backward((splat.image * weights[..., :3]).sum())
    assert splat.means2d.grad is not None
    out["gradient of means2d"] = torch.where(splat.visible[:, None], splat.means2d.grad.reshape(-1, 2), 0.0)
    out["contributions"] = contributions(rasteriser, scene, view, weights[..., 0].abs())
    return out


def compare(count: int, size: int, seed: int) -> dict[str, Any]:
    """Relative differences ‖gsplat − torch‖ / ‖torch‖ on one random scene."""
    scene, view = _scene(count, size, seed)
    weights = torch.tensor(np.random.default_rng(seed + 100).normal(size=(size, size, 5)), device="cuda").float()
    torch_ones, gsplat_ones = (_draw(r, scene, view, weights) for r in (TorchRasteriser("cuda"), GsplatRasteriser()))
    differences = {name: float((gsplat_ones[name] - value).norm() / value.norm()) for name, value in torch_ones.items()}
    limits = {n: TOLERANCE["gradient" if n.startswith("gradient") else "picture"] for n in differences}
    bad = [name for name, value in differences.items() if not value < limits[name]]
    return {"gaussians": count, "size": size, "seed": seed, "relative_difference": differences, "beyond_tolerance": bad}


def _milliseconds(work: Callable[[], object], repeats: int = 50) -> float:
    """Median time on the device."""
    for _ in range(5):
        work()
    times = []
    for _ in range(repeats):
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))  # type: ignore[no-untyped-call]
        begin.record()
        work()
        end.record()
        torch.cuda.synchronize()
        times.append(begin.elapsed_time(end))
    return round(float(np.median(times)), 3)


def stages(gaussians: Gaussians, view: RegisteredView, rasteriser: Rasteriser) -> dict[str, float]:
    """Milliseconds of the parts of one training step with these Gaussians."""
    parts = [getattr(gaussians, name).clone().requires_grad_() for name in _NAMES]
    moving = Gaussians(*parts)
    target = torch.rand(view.camera.height, view.camera.width, 3, device=gaussians.device)
    picture = torch.rand_like(target).requires_grad_()
    optimiser = torch.optim.Adam(parts, lr=0.0, fused=True)

    def forward() -> Tensor:
        return rasteriser.splat(moving, view).image

    def both() -> None:
        torch.autograd.backward(forward().square().mean())

    def likeness() -> None:
        torch.autograd.backward(ssim(picture, target))

    with torch.no_grad():
        drawing = _milliseconds(forward)
    out = {
        "forward": drawing,
        "forward_and_backward": _milliseconds(both),
        "ssim_and_backward": _milliseconds(likeness),
    }
    out["adam"] = _milliseconds(optimiser.step)
    with torch.no_grad():
        out["render_with_depth"] = _milliseconds(lambda: rasteriser.render(gaussians, view))
    out["contributions"] = _milliseconds(lambda: contributions(rasteriser, gaussians, view, target[..., :2]))
    return out


def cold_start() -> dict[str, Any]:
    """Load gsplat in two processes at once with an empty folder of extensions: both must work, from one build."""
    load = "from avs3d_bench.scheduling.gsplat_kernels import gsplat; gsplat()"
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        pair = [
            subprocess.Popen([sys.executable, "-c", load], env=os.environ | {"TORCH_EXTENSIONS_DIR": folder})
            for _ in range(2)
        ]
        codes = [process.wait() for process in pair]
        libraries = len(list(Path(folder).rglob("gsplat_cuda*.so")))
        return {"exit_codes": codes, "libraries": libraries, "seconds": round(time.perf_counter() - begin, 1)}


def training(
    root: Path, key: str, settings: TrainingSettings, ply: Path | None = None, loud: bool = False
) -> dict[str, Any]:
    """Train one observation and judge it on its test views."""
    iterations = settings.iterations
    observation = Dataset(root)[key]
    views, rasteriser = load_views(observation), GsplatRasteriser()
    points, colours = load_points(observation)
    course: list[dict[str, float | None]] = []
    begin = time.perf_counter()

    def say(report: TrainingState) -> None:
        if report.iteration % max(1, iterations // 30) == 0:
            course.append(
                {
                    "iteration": report.iteration, "seconds": round(time.perf_counter() - begin, 1),
                    "loss": round(report.loss, 5), "psnr": round(report.psnr, 2), "gaussians": report.gaussians,
                    "memory_full_at": report.full_at,
                }
            )  # fmt: skip
            if loud:
                print(course[-1], file=sys.stderr, flush=True)

    gaussians = train(views, points, colours, rasteriser, settings, progress=say)
    torch.cuda.synchronize()
    seconds = time.perf_counter() - begin
    if ply is not None:
        write_ply(ply, gaussians)
    test, seen = (
        view_psnr(gaussians, test_views(views), rasteriser),
        view_psnr(gaussians, train_views(views), rasteriser),
    )
    return {
        "key": key,
        "iterations": iterations,
        "points": len(points),
        "gaussians": len(gaussians),
        "minutes": round(seconds / 60.0, 3),
        "psnr_test": [round(value, 2) for value in test],
        "psnr_test_median": round(float(np.median(test)), 2),
        "psnr_test_mean": round(float(np.mean(test)), 2),
        "psnr_train_median": round(float(np.median(seen)), 2),
        "peak_memory_gib": round(torch.cuda.max_memory_allocated() / 2**30, 2),
        "milliseconds_per_step": stages(gaussians, train_views(views)[0], rasteriser),
        "course": course,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--key", action="append", default=[], help="observation; repeatable; default: the first")
    parser.add_argument("--iterations", type=int, default=30_000)
    parser.add_argument("--max-gaussians", type=int, default=None, help="a cap; default: none")
    parser.add_argument("--screen-pruning", action="store_true", help="apply the limit of 20 px the reference names")
    parser.add_argument("--cold", action="store_true", help="two processes compile gsplat's kernels at once")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ply", type=Path, help="where to write the Gaussians (of the last key)")
    parser.add_argument("--loud", action="store_true", help="report the progress of the training on stderr")
    parser.add_argument("--json", type=Path, help="also write the document here")
    options = parser.parse_args()
    try:
        cold = cold_start() if options.cold else None
        GsplatRasteriser()
        comparisons = [compare(*case) for case in ((500, 64, 0), (3_000, 200, 1), (20_000, 504, 2))]
        trainings = []
        if options.dataset is not None:
            keys = options.key or list(Dataset(options.dataset).keys[:1])
            density = DensityControl(
                max_gaussians=options.max_gaussians, max_screen=20.0 if options.screen_pruning else None
            )
            settings = TrainingSettings(iterations=options.iterations, density=density, seed=options.seed)
            trainings = [training(options.dataset, key, settings, options.ply, options.loud) for key in keys]
    except Avs3dError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    document = {
        "device": torch.cuda.get_device_name(),
        "torch": torch.__version__,
        "cuda": torch.version.cuda,
        "gsplat": version("gsplat"),
        "python": platform.python_version(),
        "cold_start": cold,
        "comparisons": comparisons,
        "trainings": trainings,
    }
    text = json.dumps(document, indent=1)
    print(text)
    if options.json is not None:
        options.json.write_text(text + "\n")
    return 1 if any(case["beyond_tolerance"] for case in comparisons) else 0


if __name__ == "__main__":
    sys.exit(main())
