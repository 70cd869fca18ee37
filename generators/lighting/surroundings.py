"""A lit room as newly placed objects meet it: its light maps, the emitters that reach them, and the sun."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from generators.core.rays import Tracer
from generators.core.scene import F32, I32, Scene
from generators.lighting.direct import shadow_rays
from generators.lighting.emitters import BRIGHT, Emitters, bright_patches, find_emitters
from generators.lighting.lit_scene import LitScene, without_black
from generators.lighting.scan_light import emitters_of, without_emitters
from generators.lighting.scan_sun import beam_of
from generators.lighting.sun import Sun, find_sun
from generators.lighting.surfaces import LitSurfaces
from generators.lighting.texels import Sheet, Texels, rasterise

#: Rays over the hemisphere, and targets on each emitter, per texel.
RAYS = 32
SAMPLES = 16
#: Threads; the result does not depend on them.
WORKERS = 2
#: Surfaces within this distance count as surroundings, metres.
_RANGE = 4.0
#: How many bright patches of them are sampled as emitters.
_PATCHES = 10


@dataclass(frozen=True, eq=False)
class Objects:
    """The new parts.

    Attributes:
        surfaces: their faces.
        sheet: their light maps.
        texels: their texels.
        tracer: over their faces alone.
    """

    surfaces: LitSurfaces
    sheet: Sheet
    texels: Texels
    tracer: Tracer

    @classmethod
    def of(cls, surfaces: LitSurfaces, sheet: Sheet) -> Objects:
        """Objects with these faces and light maps."""
        return cls(surfaces, sheet, rasterise(surfaces, sheet), Tracer(surfaces.triangles))

    def boxes(self) -> list[F32]:
        """(2, 3) bounds of each of them."""
        out = []
        for part in range(len(self.sheet.width)):
            own = self.surfaces.triangles[self.surfaces.part == part].reshape(-1, 3)
            out.append(np.stack([own.min(axis=0), own.max(axis=0)]))
        return out


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A lit room that receives objects.

    Attributes:
        lit: the room with all its light.
        dim: the same without what is sampled as an emitter: the brightest patches of its surfaces.
        texels: of the surfaces near the objects that have a light map.
        emitters: windows, lamps and bright patches.
        sun: the sun, if it shines in.
        scanned: (P,) which parts of the room are a scan; their maps are factors of what is displayed.
        black: (3,) radiance that lies over the scan's pictures; ``lit`` and ``dim`` are without it.
    """

    lit: LitScene
    dim: LitScene
    texels: Texels
    emitters: Emitters
    sun: Sun | None
    scanned: NDArray[np.bool_]
    black: F32

    @property
    def tracer(self) -> Tracer:
        """Over the faces of the room."""
        return self.lit.tracer

    @staticmethod
    def of(scene: Scene, boxes: list[F32]) -> Surroundings:
        """The surroundings of objects with the bounds ``boxes``."""
        scanned = np.array([scene.is_scan(part) for part in scene.parts], dtype=bool)
        lit = LitScene.of(scene.parts, scanned.tolist() if scanned.any() else None)
        black = scene.black
        lit = without_black(lit, scanned, black)
        surfaces = lit.surfaces
        mapped = np.array([part.light is not None for part in scene.parts])
        low, high = surfaces.triangles.min(axis=1), surfaces.triangles.max(axis=1)
        near = np.zeros(len(low), dtype=bool)
        for box in boxes:
            near |= np.all((low < box[1] + _RANGE) & (high > box[0] - _RANGE), axis=1)
        texels = rasterise(surfaces, lit.sheet, near & mapped[surfaces.part])
        emitters = find_emitters(surfaces, SAMPLES)
        if scene.scan_light is not None:
            emitters = emitters.joined(emitters_of(scene.scan_light, SAMPLES, boxes))
            dim = without_emitters(scene.scan_light, lit, scanned)
            sun = beam_of(scene.scan_light, scene.rooms, surfaces, scanned[surfaces.part])
            return Surroundings(lit, dim, texels, emitters, sun, scanned, black)
        light = lit.light
        if len(texels):
            radiance = texels.albedo * light[texels.cell]
            mean = float(np.average(radiance.mean(axis=1), weights=texels.area + 1e-12))
            bright = np.flatnonzero(radiance.max(axis=1) > BRIGHT * mean)
            away = nearest_box(texels.position[bright], boxes)
            patches, used = bright_patches(
                texels.position[bright],
                texels.normal[bright],
                texels.area[bright],
                radiance[bright],
                SAMPLES,
                importance=1.0 / (away**2 + 0.1),
                most=_PATCHES,
            )
            emitters = emitters.joined(patches)
            light = light.copy()
            light[texels.cell[bright[used]]] = 0.0
        return Surroundings(
            lit, replace(lit, light=light), texels, emitters, find_sun(scene.name, surfaces, lit.tracer), scanned, black
        )

    def reach(self, objects: Objects) -> NDArray[np.bool_]:
        """(P, L) which emitters reach which object, judged by rays from some sixty of its texels."""
        emitters = self.emitters
        parts, lights = len(objects.sheet.width), len(emitters)
        reach = np.zeros((parts, lights), dtype=bool)
        owner = objects.surfaces.part[objects.texels.face]
        for part in range(parts):
            own = np.flatnonzero(owner == part)
            if not len(own) or not lights:
                continue
            texel = own[np.linspace(0, len(own) - 1, 64).astype(np.int64)]
            # The way is judged whatever a texel faces: its neighbours may face the light.
            light = np.tile(np.arange(lights), len(texel))
            pair = np.repeat(texel, lights)
            towards = emitters.centre[light] - objects.texels.position[pair]
            towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
            origins, directions, far, weight = shadow_rays(
                emitters,
                np.arange(len(pair)),
                light,
                objects.texels.pattern[pair],
                objects.texels.position[pair],
                towards.astype(np.float32),
                0,
                4,
            )
            free = (weight > 0) & ~self.tracer.occluded(origins, directions, far)
            reach[part] = free.reshape(len(texel), lights, 4).any(axis=(0, 2))
        return reach


def nearest_box(position: F32, boxes: list[F32]) -> F32:
    """(N,) distance of points from the nearest of some boxes, 0 inside."""
    distance = np.full(len(position), np.inf, dtype=np.float32)
    for box in boxes:
        gap = np.maximum(np.maximum(box[0] - position, position - box[1]), 0.0)
        distance = np.minimum(distance, np.linalg.norm(gap, axis=1))
    return distance


def behind(surfaces: LitSurfaces, face: I32, directions: F32) -> NDArray[np.bool_]:
    """Whether rays met the back of a face."""
    along = np.einsum("ij,ij->i", surfaces.face_normal[np.maximum(face, 0)], directions)
    return np.asarray((face >= 0) & (along > 0))
