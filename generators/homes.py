"""Opens the home of an observation: a procedural apartment, built and baked once per seed, or a scan from a file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from avs3d_bench.errors import Avs3dError
from generators.plan import ObservationPlan, resolve_file, scans_root
from generators.scenes.cache import cached_scene
from generators.scenes.scene import Scene


def default_cache() -> Path:
    """``$AVS3D_CACHE``, else ``avs3d-bench`` in the user's cache folder."""
    named = os.environ.get("AVS3D_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "avs3d-bench"


def prepare_home(plan: ObservationPlan, folder: Path, *, workers: int = 1) -> None:
    """Build and light the plan's home into the cache ``folder`` unless it lies there already."""
    open_home(plan, folder, workers=workers)


def open_home(plan: ObservationPlan, folder: Path, *, workers: int = 1) -> Scene:
    """The plan's home with its light.

    Raises:
        Avs3dError: if a scan's file is missing or broken, or the room is not in it.
    """
    spec = plan.scan
    if spec.source == "scan":
        from generators.scenes.scan import load_scan

        if not spec.rooms:
            raise Avs3dError(
                f"scan {plan.spec.scan}: the manifest gives no rooms; add scans.{plan.spec.scan}.rooms with the lowest "
                "and highest corner of each room (metres, Y up)"
            )
        path = resolve_file(scans_root(plan.base), spec.file or "", f"scan {plan.spec.scan}")
        scene = load_scan(plan.spec.scan, path, {name: np.asarray(box) for name, box in spec.rooms.items()})
    else:

        def build() -> Scene:
            from generators.scenes.apartment import build_apartment
            from generators.scenes.light import bake

            assert spec.seed is not None
            return bake(build_apartment(plan.spec.scan, spec.seed), quality=plan.light, workers=workers)

        scene = cached_scene(folder, plan.home_digest, build)
    scene.room(plan.spec.room)
    return scene
