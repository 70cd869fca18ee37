"""A small furnished and lit apartment for tests of renderers: the kitchen and the bathroom of a procedural flat."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.light_reference import with_matte_materials
from generators.apartments.apartment import build_apartment
from generators.assets.catalogue import build_model
from generators.assets.clutter.catalogue import CLUTTER
from generators.core.scene import Part, Scene
from generators.lighting.bake import bake, insert
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from generators.vision.base import RenderedView, VisionBackend
from tests.support.once import made_once

ROOMS = ("kitchen", "bathroom")
#: Kinds of the small things.
SMALL_THINGS = frozenset(kind.name for kind in CLUTTER)


def textured_flat(seed: int) -> Scene:
    """A flat with its materials, which take ten seconds, and without light."""
    return made_once(f"flat_{seed}", lambda: build_apartment("flat", seed))


@lru_cache(maxsize=8)
def plain_flat(seed: int) -> Scene:
    """The geometry of a flat, in white."""
    return made_once(f"plain_{seed}", lambda: build_apartment("flat", seed, plain=True))


@lru_cache(maxsize=1)
def small_flat() -> Scene:
    """Two lit rooms with their furniture, exposed for the kitchen."""
    return made_once("small_flat", _small_flat)


def _small_flat() -> Scene:
    whole = textured_flat(1)
    parts = [p for p in whole.parts if p.name.split("/")[0] in ROOMS or p.name in {f"shell_{room}" for room in ROOMS}]
    supports = tuple(support for support in whole.supports if support.room in ROOMS)
    rooms = tuple(room for room in whole.rooms if room.name in ROOMS)
    unlit = replace(whole, parts=tuple(parts), rooms=rooms, supports=supports)
    return bake(unlit, quality="preview").for_room("kitchen")


def kind_of(part: Part) -> str:
    """Kind of a piece of furniture or small thing; empty for a shell."""
    return part.name.partition("/")[2].rpartition("_")[0]


def small_things(home: Scene, room: str = "") -> list[Part]:
    """The small things of a room, or of all."""
    return [part for part in home.parts if part.name.startswith(room) and kind_of(part) in SMALL_THINGS]


def without_small_things(home: Scene) -> Scene:
    """The home with its furniture alone."""
    return replace(home, parts=tuple(part for part in home.parts if kind_of(part) not in SMALL_THINGS))


def furnish(home: Scene, room: str = "kitchen") -> tuple[Scene, tuple[Placement, ...]]:
    """The home with a microwave and a clock placed and lit: instances 1 and 2."""
    rng = np.random.default_rng(7)
    models = [build_model(name, variant, rng) for name, variant in (("microwave", "steel"), ("clock", "station"))]
    placements = place(Site.of(home, room), models, rng=rng)
    return insert(home, tuple(p.part(n) for n, p in enumerate(placements, start=1))), tuple(placements)


def looks(home: Scene, target: NDArray[np.float64], room: str = "kitchen", count: int = 5) -> list[Pose]:
    """Poses at eye height in the middle of ``room``: towards ``target`` first, then all round."""
    box = home.room(room)
    eye = (np.asarray(box.low) + np.asarray(box.high)) / 2
    eye[1] = box.low[1] + 1.5
    ahead = np.asarray(target) - eye
    yaw = float(np.arctan2(-ahead[0], -ahead[2]))
    return [Pose.from_yaw(eye, yaw + turn, -0.25) for turn in np.linspace(0, 2 * np.pi, count, endpoint=False)]


def without_reflections(scene: Scene) -> Scene:
    """The scene as files show it that know no reflections: matte, with the views outside as pictures on the panes."""
    plain = with_matte_materials(scene)
    parts = []
    for part in plain.parts:
        materials = tuple(replace(material, view_distance=0.0) for material in part.mesh.materials)
        parts.append(replace(part, mesh=replace(part.mesh, materials=materials)))
    return replace(plain, parts=tuple(parts))


def render(backend: VisionBackend, scene: Scene, poses: list[Pose], camera: Intrinsics) -> list[RenderedView]:
    """Frames of ``scene`` from ``poses``."""
    session = backend.open(scene, camera)
    try:
        return [session.render(pose) for pose in poses]
    finally:
        session.close()


def psnr(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Peak signal-to-noise ratio of two 8-bit pictures, dB."""
    error = np.mean((first.astype(np.float64) - second.astype(np.float64)) ** 2)
    return float(10 * np.log10(255.0**2 / max(float(error), 1e-12)))
