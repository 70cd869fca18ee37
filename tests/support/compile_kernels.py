"""`python -m tests.support.compile_kernels`: compile what most tests need once, not in several processes at once."""

from __future__ import annotations

import tempfile
from pathlib import Path

from generators.core.jit import CACHE_FOLDER, kernel_digest


def main() -> None:
    """Bake a box, and make a small observation with each acoustic engine of numba; nothing if that was done before."""
    done = CACHE_FOLDER / kernel_digest() / "tests.compiled"  # beside what it says: they are deleted together
    if not done.exists():
        _compile()
        done.parent.mkdir(exist_ok=True)
        done.touch()


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


if __name__ == "__main__":
    main()
