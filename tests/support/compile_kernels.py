"""`python -m tests.support.compile_kernels`: compile what most tests need once, not in several processes at once.

With ``--device cuda``: the kernels of the GPU, each time; a process of its own can do it at the same time.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
from pathlib import Path

from avs3d_bench.geometry import Intrinsics
from avs3d_bench.runtime.provenance import source_files
from generators import Home, Renderer, objects
from generators.core.jit import CACHE_FOLDER, kernel_digest


def main() -> None:
    """What was asked for on the command line."""
    parser = argparse.ArgumentParser(prog="compile_kernels", description="Compile kernels once.")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    if parser.parse_args().device == "cuda":
        _compile_cuda()
    else:
        _compile_once()


def _compile_cuda() -> None:
    from generators.backends import warm_up
    from generators.options import EngineOptions

    for engine in ("analytic", "tracer"):
        warm_up(EngineOptions(audio=engine, device="cuda"))


def _compile_once() -> None:
    """Bake a box, make a small observation with each acoustic engine of numba, and see, hear and export a home.

    Nothing if that was done before. The home is that of README.md and of the examples, which find it lit.
    """
    # Beside what it says: they are deleted together.
    done = CACHE_FOLDER / kernel_digest() / f"tests-{_checkout()}.compiled"
    if not done.exists():
        _compile()
        done.parent.mkdir(exist_ok=True)
        done.touch()


def _checkout() -> str:
    """Digest of the paths and dates of the files with kernels: numba compiles again for another of either."""
    digest = hashlib.sha256()
    for _, file in source_files("generators"):
        if b"core.jit" in file.read_bytes():
            digest.update(f"{file}\0{file.stat().st_mtime_ns}\0".encode())
    return digest.hexdigest()[:16]


def _compile() -> None:
    from generators.backends import warm_up
    from generators.lighting.bake import bake
    from generators.observation.generate import generate_observation
    from generators.options import EngineOptions, GenerateOptions
    from generators.plan import make_plans, read_manifest
    from generators.vision.embree import trial_scene
    from tests.support.homes import write_manifest

    bake(trial_scene()[0], quality="preview")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = read_manifest(write_manifest(folder))
        for engine in ("analytic", "tracer"):
            warm_up(EngineOptions(audio=engine))
            options = GenerateOptions(audio=engine, frames=2, size=64, only=("part_2/*",), extras=("rirs",))
            for plan in make_plans(source, options):
                generate_observation(plan, folder / engine, folder / "cache")
        _show_home(folder)


def _show_home(folder: Path) -> None:
    """What examples/hello_home.py and its notebook do, with a small picture and a short sound."""
    scene = Home.apartment(seed=7, light="preview").place(objects.build("microwave", seed=3), room="kitchen", rng=1)
    pose = scene.look_at(1)
    with Renderer(scene) as renderer:
        renderer.frame(pose, Intrinsics.from_fov(32))
    scene.hear(pose, sounding=1, seconds=1)
    scene.export(folder / "home.glb")


if __name__ == "__main__":
    main()
