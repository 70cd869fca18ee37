"""Standing new objects in a lit room: the light on the objects themselves.

The room's light is not solved again. The objects gather it, and what they reflect to one another, with rays; what they
take from the room is the work of `shadowing`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from generators.scenes.emitters import direct_light
from generators.scenes.gather import CHUNK, cells_at, hemisphere_rays
from generators.scenes.scene import F32, LightMap, Part, Scene
from generators.scenes.shadowing import shadowed
from generators.scenes.smoothing import fill, smooth, spread
from generators.scenes.sun import sun_light
from generators.scenes.surfaces import Surfaces, Tracer, in_chunks
from generators.scenes.surroundings import RAYS, SAMPLES, WORKERS, Objects, Surroundings, behind, bundle
from generators.scenes.texels import Sheet, rasterise
from generators.scenes.unwrap import Layout, unwrap

#: The objects of one call get about this many texels in all, within the limits of size that follow (metres).
_TEXELS = 45000
_FINEST, _COARSEST = 0.008, 0.02
_BOUNCES = 3


def insert(scene: Scene, parts: tuple[Part, ...]) -> Scene:
    """Add unlit parts to a lit scene.

    Args:
        scene: with light maps from `bake`, or scanned parts whose texture holds the light. It is not changed.
        parts: meshes in world coordinates; light they may have is replaced.

    Returns:
        The scene with the lit parts at its end; light maps near them are new arrays, all others are shared.
    """
    if not parts:
        return scene
    objects, layouts = _prepare(parts)
    room = Surroundings.of(scene, objects.boxes())
    light, is_open = _light_objects(objects, room)
    filled = fill(objects.surfaces, objects.sheet, objects.texels, light, is_open)
    cells = spread(objects.sheet, objects.texels, filled)
    lit = []
    for number, (part, layout) in enumerate(zip(parts, layouts, strict=True)):
        uv = layout.uv / np.array([layout.width, layout.height], dtype=np.float32)
        texels = np.minimum(objects.sheet.image(number, cells), 6e4).astype(np.float16)
        lit.append(replace(part, light=LightMap(uv, texels)))
    return replace(scene, parts=shadowed(scene.parts, room, objects, cells) + tuple(lit))


def _prepare(parts: tuple[Part, ...]) -> tuple[Objects, list[Layout]]:
    """The parts with their layouts."""
    surfaces = Surfaces.of(parts)
    corners = surfaces.triangles.astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    texel = float(np.clip(np.sqrt(area / _TEXELS), _FINEST, _COARSEST))
    layouts = [unwrap(part.mesh.positions, texel) for part in parts]
    sheet = Sheet.of(layouts)
    return Objects(surfaces, sheet, rasterise(surfaces, sheet), Tracer(surfaces.triangles)), layouts


def _light_objects(objects: Objects, room: Surroundings) -> tuple[F32, NDArray[np.bool_]]:
    """Light (N, 3) of the objects' texels, and which of them are open."""
    texels = objects.texels
    count = len(texels)
    table, narrow = bundle()
    gathered, direct = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    noise, shadow_noise = np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.float32)
    links = np.full((count, RAYS), -1, dtype=np.int32)
    buried = np.zeros(count, dtype=bool)
    reach = room.reach(objects)

    def hidden(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        return room.tracer.occluded(origins, directions, far) | objects.tracer.occluded(origins, directions, far)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        position, normal, pattern = texels.position[part], texels.normal[part], texels.pattern[part]
        gloss, across = texels.gloss[part], texels.across[part]
        under = objects.surfaces.face_normal[texels.face[part]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = room.tracer.intersect(origins, directions)
        near = objects.tracer.intersect(origins, directions, hits["tfar"])
        own = near["primID"] >= 0
        back = np.where(
            own,
            behind(objects.surfaces, near["primID"], directions),
            behind(room.dim.surfaces, hits["primID"], directions),
        )
        buried[part] = back.reshape(-1, RAYS).mean(axis=1) > 0.5
        cells = cells_at(objects.surfaces, objects.sheet, near["primID"], near["u"], near["v"])
        links[part] = np.where(own, texels.index[cells], -1).reshape(-1, RAYS)
        seen = np.where(own[:, None], np.float32(0.0), room.dim.reflected(hits)).reshape(-1, RAYS, 3)
        weight = (1 - gloss)[:, None] / np.float32(RAYS) + gloss[:, None] * narrow[pattern]
        gathered[part] = np.einsum("ik,ikc->ic", weight, seen)
        noise[part] = seen.mean(axis=2).var(axis=1) / RAYS
        kind = objects.surfaces.part[texels.face[part]]
        direct[part], shadow_noise[part] = direct_light(
            room.emitters, reach[kind], pattern, position, normal, gloss, hidden
        )
        if room.sun is not None:
            direct[part] += sun_light(
                room.sun, pattern, position, normal, across, gloss, room.tracer, SAMPLES, objects=objects.tracer
            )

    in_chunks(work, count, CHUNK, WORKERS)
    is_open = ~buried
    closed = np.float32(-1.0)
    surfaces, sheet = objects.surfaces, objects.sheet
    direct = smooth(surfaces, sheet, texels, direct, np.where(is_open, shadow_noise, closed), 2.0)
    gathered = smooth(surfaces, sheet, texels, gathered, np.where(is_open, noise, closed), 3.0)
    light = direct + gathered
    linked = np.flatnonzero((links >= 0).any(axis=1) & is_open)
    used = links[linked]
    for _ in range(_BOUNCES):
        radiance = np.where(is_open[:, None], texels.albedo * light, np.float32(0.0))
        bounced = np.where(used[..., None] >= 0, radiance[used], np.float32(0.0)).mean(axis=1)
        own_light = np.zeros_like(light)
        own_light[linked] = bounced
        light = direct + gathered + smooth(surfaces, sheet, texels, own_light, np.where(is_open, noise, closed), 3.0)
    return light, is_open
