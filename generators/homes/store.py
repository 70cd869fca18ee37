"""Opens the home of an observation: a procedural apartment, built and baked once per seed, or a scan from a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from generators.core.scene import Scene
from generators.homes.cache import cached_scene
from generators.plan import ObservationPlan

if TYPE_CHECKING:
    from generators.scans.files import ScanFiles
    from generators.scans.scan import ScanAcoustics

#: The scan that this process opened last, by its digest.
_scan_cache: dict[str, Scene] = {}


def prepare_home(plan: ObservationPlan, folder: Path, *, workers: int = 1) -> None:
    """Build and light the plan's home and store it in the cache ``folder``, unless it is there already."""
    open_home(plan, folder, workers=workers)


def open_home(plan: ObservationPlan, folder: Path, *, workers: int = 1) -> Scene:
    """The plan's home with its light.

    Raises:
        Avs3dError: if a scan's file is missing or broken, or has no such room.
    """
    if plan.scan.source == "scan":
        scene = _open_scan(plan)
    else:
        assert plan.scan.seed is not None
        scene = lit_apartment(
            plan.spec.scan,
            plan.scan.seed,
            plan.light,
            folder,
            key=plan.home_digest,
            device=plan.options.device,
            workers=workers,
        )
    scene.room(plan.spec.room)
    return scene


def lit_apartment(
    name: str, seed: int, light: str, folder: Path, *, key: str, device: str = "cpu", workers: int = 1
) -> Scene:
    """A procedural flat with its light, from the cache ``folder``; built, lit and stored there if it is missing.

    Args:
        name: of the flat; the direction of the sun is drawn from it.
        seed: of the flat.
        light: quality of its light.
        folder: the cache.
        key: of the flat in the cache: `generators.plan.home_digest`.
        device: what bakes the light.
        workers: threads; the flat does not depend on them.

    Raises:
        Avs3dError: if the cache cannot be written, or CUDA cannot be used.
    """

    def build() -> Scene:
        from generators.apartments.apartment import build_apartment
        from generators.lighting.bake import bake

        return bake(build_apartment(name, seed, workers), quality=light, workers=workers, device=device)

    return cached_scene(folder, key, build, device)


def _acoustics(plan: ObservationPlan) -> ScanAcoustics:
    """How the surfaces of the plan's scan sound, as far as the manifest says."""
    from generators.scans.scan import ScanAcoustics

    files, surfaces, spec = plan.material_file, plan.scan.surfaces, plan.scan.acoustics
    if spec is None:
        return ScanAcoustics(files, surfaces)
    t30 = {str(room): time for room, time in spec.t30.items()} if isinstance(spec.t30, dict) else spec.t30
    return ScanAcoustics(files, surfaces, t30, spec.furnished)


def _open_scan(plan: ObservationPlan) -> Scene:
    """The plan's scan; the last one opened is kept, since a manifest's observations often share it."""
    from generators.assets.gltf import can_decode_basis, has_basis
    from generators.scans.scan import Axes, load_scan

    spec, room = plan.scan, plan.spec.room
    files, digest = plan.scan_files, plan.home_digest
    known = _scan_cache.get(digest)
    if known and known.stage and room in (each.name for each in known.rooms):
        return _moved(known, files)
    # Habitat reads the stage file itself, with its compressed textures.
    textures = plan.options.renderer != "habitat" or can_decode_basis() or not has_basis(files.mesh)
    scene = load_scan(
        plan.spec.scan,
        files,
        {name: np.asarray(box) for name, box in spec.rooms.items()},
        licence=plan.scan_licence,
        axes=Axes(spec.up, spec.front, spec.turn or 0.0, 1.0 if spec.scale is None else spec.scale),
        textures=textures,
        acoustics=_acoustics(plan),
        need=(room,),
    )
    _scan_cache.clear()
    _scan_cache[digest] = scene
    return scene


def _moved(scene: Scene, files: ScanFiles) -> Scene:
    """The scan: a moved folder holds the same one, but a renderer may need the new paths of its files."""
    if scene.stage is None or scene.stage.path == files.mesh:
        return scene
    splats = scene.splats
    if splats is not None and files.splats is not None:
        splats = replace(splats, path=files.splats)
    return replace(scene, stage=replace(scene.stage, path=files.mesh), splats=splats)
