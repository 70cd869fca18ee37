"""Standing new objects in a lit room: their own light, and what they take from the surfaces around them.

The room's light is not solved again. The objects gather it (and what they reflect to one another) with rays; the
room's texels near by lose the part of their light that comes along rays the objects are in the way of. A texel that
no such ray leaves keeps its bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from generators.scenes.emitters import LOBE, Emitters, direct_light, find_emitters, shadow_rays
from generators.scenes.gather import CHUNK, hemisphere_rays, cells_at
from generators.scenes.lit import LitScene
from generators.scenes.sampling import cosine_directions
from generators.scenes.scene import F32, LightMap, Part, Scene
from generators.scenes.smoothing import fill, smooth, spread
from generators.scenes.sun import Sun, find_sun, sun_light
from generators.scenes.surfaces import Surfaces, Tracer, in_chunks
from generators.scenes.texels import Sheet, Texels, rasterise
from generators.scenes.unwrap import unwrap

#: The objects of one call get about this many texels in all, within the limits of size that follow (metres).
_TEXELS = 45000
_FINEST, _COARSEST = 0.008, 0.02
#: How far objects take light from the room's surfaces (metres), fading out over the last part of it.
REACH = 1.2
_FADE = 0.5
#: How far they throw shadows in the sun, metres.
_SUN_REACH = 3.0
_RAYS = 32
_SAMPLES = 16
_BOUNCES = 3
_WORKERS = 2


@dataclass(frozen=True, eq=False)
class _Objects:
    """The new parts, ready to be lit; fields as in `LitScene`, ``radiance`` (cells, 3) what they reflect."""

    surfaces: Surfaces
    sheet: Sheet
    texels: Texels
    tracer: Tracer


@dataclass(frozen=True, eq=False)
class _Sky:
    """What lights the room: area lights that reach the objects, and the sun."""

    emitters: Emitters
    sun: Sun | None


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
    base = LitScene.of(scene.parts)
    objects, layouts = _prepare(parts)
    sky = _Sky(find_emitters(base.surfaces, _SAMPLES), find_sun(scene.name, base.surfaces, base.tracer))
    light, is_open = _light_objects(base, objects, sky)
    filled = fill(objects.surfaces, objects.sheet, objects.texels, light, is_open)
    cells = spread(objects.sheet, objects.texels, filled)
    lit = []
    for number, (part, layout) in enumerate(zip(parts, layouts, strict=True)):
        uv = layout.uv / np.array([layout.width, layout.height], dtype=np.float32)
        texels = np.minimum(objects.sheet.image(number, cells), 6e4).astype(np.float16)
        lit.append(replace(part, light=LightMap(uv, texels)))
    return replace(scene, parts=_shadowed(scene.parts, base, objects, cells, sky) + tuple(lit))


def _prepare(parts: tuple[Part, ...]):  # type: ignore[no-untyped-def]
    surfaces = Surfaces.of(parts)
    corners = surfaces.triangles.astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    texel = float(np.clip(np.sqrt(area / _TEXELS), _FINEST, _COARSEST))
    layouts = [unwrap(part.mesh.positions, texel) for part in parts]
    sheet = Sheet.of(layouts)
    return _Objects(surfaces, sheet, rasterise(surfaces, sheet), Tracer(surfaces.triangles)), layouts


def _light_objects(base: LitScene, objects: _Objects, sky: _Sky) -> tuple[F32, NDArray[np.bool_]]:
    """Light (N, 3) of the objects' texels, and which of them are open."""
    texels = objects.texels
    count = len(texels)
    table = cosine_directions(_RAYS)
    narrow = table[..., 2] ** np.float32(LOBE - 1.0)
    narrow /= narrow.sum(axis=1, keepdims=True)
    gathered, direct = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    noise, shadow_noise = np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.float32)
    links = np.full((count, _RAYS), -1, dtype=np.int32)
    buried = np.zeros(count, dtype=bool)
    reach = _reach(sky.emitters, objects, base.tracer)

    def hidden(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        return base.tracer.occluded(origins, directions, far) | objects.tracer.occluded(origins, directions, far)

    def work(first: int, last: int) -> None:
        part = slice(first, last)
        position, normal, pattern = texels.position[part], texels.normal[part], texels.pattern[part]
        gloss, across = texels.gloss[part], texels.across[part]
        under = objects.surfaces.face_normal[texels.face[part]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = base.tracer.intersect(origins, directions)
        near = objects.tracer.intersect(origins, directions, hits["tfar"])
        own = near["primID"] >= 0
        back = np.where(
            own,
            _behind(objects.surfaces, near["primID"], directions),
            _behind(base.surfaces, hits["primID"], directions),
        )
        buried[part] = back.reshape(-1, _RAYS).mean(axis=1) > 0.5
        cells = cells_at(objects.surfaces, objects.sheet, near["primID"], near["u"], near["v"])
        links[part] = np.where(own, texels.index[cells], -1).reshape(-1, _RAYS)
        seen = np.where(own[:, None], np.float32(0.0), base.reflected(hits)).reshape(-1, _RAYS, 3)
        weight = (1 - gloss)[:, None] / np.float32(_RAYS) + gloss[:, None] * narrow[pattern]
        gathered[part] = np.einsum("ik,ikc->ic", weight, seen)
        noise[part] = seen.mean(axis=2).var(axis=1) / _RAYS
        kind = objects.surfaces.part[texels.face[part]]
        direct[part], shadow_noise[part] = direct_light(
            sky.emitters, reach[kind], pattern, position, normal, gloss, hidden
        )
        if sky.sun is not None:
            direct[part] += sun_light(
                sky.sun, pattern, position, normal, across, gloss, base.tracer, _SAMPLES, objects=objects.tracer
            )

    in_chunks(work, count, CHUNK, _WORKERS)
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


def _behind(surfaces: Surfaces, face: NDArray[np.int32], directions: F32) -> NDArray[np.bool_]:
    """Whether rays met the back of a face."""
    along = np.einsum("ij,ij->i", surfaces.face_normal[np.maximum(face, 0)], directions)
    return np.asarray((face >= 0) & (along > 0))


def _reach(emitters: Emitters, objects: _Objects, room: Tracer) -> NDArray[np.bool_]:
    """(P, L) which emitters reach which object, judged by rays from some sixty of its texels."""
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
        free = (weight > 0) & ~room.occluded(origins, directions, far)
        reach[part] = free.reshape(len(texel), lights, 4).any(axis=(0, 2))
    return reach


def _shadowed(
    parts: tuple[Part, ...], base: LitScene, objects: _Objects, cells: F32, sky: _Sky
) -> tuple[Part, ...]:
    """The room's parts, darkened near the objects."""
    boxes = _boxes(objects)
    far = _SUN_REACH if sky.sun is not None else REACH
    lit = np.array([part.light is not None for part in parts])
    low, high = base.surfaces.triangles.min(axis=1), base.surfaces.triangles.max(axis=1)
    wanted = np.zeros(len(low), dtype=bool)
    for box in boxes:
        wanted |= np.all((low < box[1] + far) & (high > box[0] - far), axis=1)
    wanted &= lit[base.surfaces.part]
    if not wanted.any():
        return parts
    texels = rasterise(base.surfaces, base.sheet, wanted)
    distance = np.full(len(texels), np.inf, dtype=np.float32)
    for box in boxes:
        gap = np.maximum(np.maximum(box[0] - texels.position, texels.position - box[1]), 0.0)
        distance = np.minimum(distance, np.linalg.norm(gap, axis=1))
    lost, known = _lost_light(base, objects, texels, distance, cells, sky)
    old = base.light[texels.cell]
    ratio = np.clip(1.0 - lost / np.maximum(old, 1e-6), 0.02, 4.0).astype(np.float32)
    # Texels that the objects bury take the shade of those beside them, or a bright rim would show round the contact.
    ratio = fill(base.surfaces, base.sheet, texels, ratio, known, rings=3)
    changed = np.any(ratio != 1.0, axis=1)
    new = (old * ratio)[changed]
    cell = texels.cell[changed]
    out = list(parts)
    for number in range(len(parts)):
        first, last = base.sheet.offset[number : number + 2]
        own = (cell >= first) & (cell < last)
        light = parts[number].light
        if light is None or not own.any():
            continue
        image = light.texels.copy()
        image.reshape(-1, 3)[cell[own] - first] = np.minimum(new[own], 6e4).astype(np.float16)
        out[number] = replace(parts[number], light=replace(light, texels=image))
    return tuple(out)


def _boxes(objects: _Objects) -> list[F32]:
    """(2, 3) bounds of each object."""
    out = []
    for part in range(len(objects.sheet.width)):
        own = objects.surfaces.triangles[objects.surfaces.part == part].reshape(-1, 3)
        out.append(np.stack([own.min(axis=0), own.max(axis=0)]))
    return out


def _lost_light(
    base: LitScene, objects: _Objects, texels: Texels, distance: F32, cells: F32, sky: _Sky
) -> tuple[F32, NDArray[np.bool_]]:
    """Light (N, 3) that the objects take from the room's texels (negative: give), and which texels they do not bury."""
    count = len(texels)
    table = cosine_directions(_RAYS)
    narrow = table[..., 2] ** np.float32(LOBE - 1.0)
    narrow /= narrow.sum(axis=1, keepdims=True)
    lost, beam = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    noise = np.zeros(count, dtype=np.float32)
    known = np.ones(count, dtype=bool)
    reach = _reach(sky.emitters, objects, base.tracer).any(axis=0)
    near = np.flatnonzero(distance < REACH)
    shade = LitScene(objects.surfaces, objects.sheet, cells, objects.tracer)

    def taken(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        """Whether a ray is not one of those that the objects alone stop."""
        stopped = objects.tracer.occluded(origins, directions, far)
        rays = np.flatnonzero(stopped)
        stopped[rays] = ~base.tracer.occluded(origins[rays], directions[rays], far[rays])
        return ~stopped

    def around(first: int, last: int) -> None:
        texel = near[first:last]
        position, normal, pattern = texels.position[texel], texels.normal[texel], texels.pattern[texel]
        gloss = texels.gloss[texel]
        under = base.surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = objects.tracer.intersect(origins, directions)
        rays = np.flatnonzero(hits["primID"] >= 0)
        hits = {key: value[rays] for key, value in hits.items()}
        behind = base.tracer.intersect(origins[rays], directions[rays])
        first_met = hits["tfar"] < behind["tfar"]
        back = _behind(objects.surfaces, hits["primID"], directions[rays]) & first_met
        buried = np.bincount(rays[back] // _RAYS, minlength=len(texel)) > 0.5 * _RAYS
        weight = (1 - gloss)[:, None] / np.float32(_RAYS) + gloss[:, None] * narrow[pattern]
        change = (base.reflected(behind) - shade.reflected(hits)) * first_met[:, None]
        owner = rays // _RAYS
        share = weight.ravel()[rays]
        here = np.stack([np.bincount(owner, share * change[:, c], minlength=len(texel)) for c in range(3)], axis=1)
        square = np.bincount(owner, change.mean(axis=1) ** 2, minlength=len(texel)) / _RAYS
        spread_ = np.maximum(square - here.mean(axis=1) ** 2, 0.0) / _RAYS
        selected = np.broadcast_to(reach, (len(texel), len(reach)))
        direct, shadow_noise = direct_light(sky.emitters, selected, pattern, position, normal, gloss, taken)
        lost[texel] = here + direct
        noise[texel] = spread_ + shadow_noise
        known[texel] = ~buried

    def in_sun(first: int, last: int) -> None:
        part = slice(first, last)
        if sky.sun is not None:
            beam[part] = sun_light(
                sky.sun,
                texels.pattern[part],
                texels.position[part],
                texels.normal[part],
                texels.across[part],
                texels.gloss[part],
                base.tracer,
                _SAMPLES,
                objects=objects.tracer,
                lost=True,
            )

    in_chunks(around, len(near), CHUNK, _WORKERS)
    in_chunks(in_sun, count, CHUNK * 4, _WORKERS)
    noise = np.where(known, noise, np.float32(-1.0))
    lost = smooth(base.surfaces, base.sheet, texels, lost, noise, 3.0)
    fade = np.clip((REACH - distance) / (REACH * _FADE), 0.0, 1.0)
    fade = fade * fade * (3 - 2 * fade)
    return lost * fade[:, None] + beam, known
