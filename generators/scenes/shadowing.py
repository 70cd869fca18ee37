"""What newly placed objects take from the light of the surfaces around them.

A texel near the objects loses the part of its light that comes along rays the objects are in the way of, and gains
what they reflect. A texel that no such ray leaves keeps its bytes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from generators.scenes.emitters import direct_light
from generators.scenes.gather import CHUNK, hemisphere_rays
from generators.scenes.lit import LitScene
from generators.scenes.scene import F32, Part
from generators.scenes.smoothing import fill, smooth
from generators.scenes.sun import sun_light
from generators.scenes.surfaces import in_chunks
from generators.scenes.surroundings import RAYS, SAMPLES, WORKERS, Objects, Surroundings, behind, bundle

#: How far objects take light from the room's surfaces (metres), fading out over the last part of it.
REACH = 1.2
_FADE = 0.5
#: How far they throw shadows in the sun, metres.
_SUN_REACH = 3.0


def shadowed(parts: tuple[Part, ...], room: Surroundings, objects: Objects, cells: F32) -> tuple[Part, ...]:
    """The room's parts, darkened near the objects.

    Args:
        parts: of the room; they are not changed.
        room: their light.
        objects: what stands in it.
        cells: (cells, 3) light on the objects.

    Returns:
        The parts; those with changed texels have new arrays.
    """
    base, texels = room.lit, room.texels
    if not len(texels):
        return parts
    distance = np.full(len(texels), np.inf, dtype=np.float32)
    for box in objects.boxes():
        gap = np.maximum(np.maximum(box[0] - texels.position, texels.position - box[1]), 0.0)
        distance = np.minimum(distance, np.linalg.norm(gap, axis=1))
    lost, known = _lost_light(room, objects, distance, cells)
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


def _lost_light(room: Surroundings, objects: Objects, distance: F32, cells: F32) -> tuple[F32, NDArray[np.bool_]]:
    """Light (N, 3) that the objects take from the room's texels (negative: give), and which texels they do not bury."""
    base, texels = room.lit, room.texels
    count = len(texels)
    table, narrow = bundle()
    lost, beam = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    noise = np.zeros(count, dtype=np.float32)
    known = np.ones(count, dtype=bool)
    reach = room.reach(objects).any(axis=0)
    near = np.flatnonzero(distance < REACH)
    sunny = np.flatnonzero(distance < _SUN_REACH)
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
        beyond = base.tracer.intersect(origins[rays], directions[rays])
        first_met = hits["tfar"] < beyond["tfar"]
        back = behind(objects.surfaces, hits["primID"], directions[rays]) & first_met
        buried = np.bincount(rays[back] // RAYS, minlength=len(texel)) > 0.5 * RAYS
        weight = (1 - gloss)[:, None] / np.float32(RAYS) + gloss[:, None] * narrow[pattern]
        change = (room.dim.reflected(beyond) - shade.reflected(hits)) * first_met[:, None]
        owner = rays // RAYS
        share = weight.ravel()[rays]
        here = np.stack([np.bincount(owner, share * change[:, c], minlength=len(texel)) for c in range(3)], axis=1)
        square = np.bincount(owner, change.mean(axis=1) ** 2, minlength=len(texel)) / RAYS
        spread_ = np.maximum(square - here.mean(axis=1) ** 2, 0.0) / RAYS
        selected = np.broadcast_to(reach, (len(texel), len(reach)))
        direct, shadow_noise = direct_light(room.emitters, selected, pattern, position, normal, gloss, taken)
        lost[texel] = here + direct
        noise[texel] = spread_ + shadow_noise
        known[texel] = ~buried

    def in_sun(first: int, last: int) -> None:
        part = sunny[first:last]
        if room.sun is not None:
            beam[part] = sun_light(
                room.sun,
                texels.pattern[part],
                texels.position[part],
                texels.normal[part],
                texels.across[part],
                texels.gloss[part],
                base.tracer,
                SAMPLES,
                objects=objects.tracer,
                lost=True,
            )

    in_chunks(around, len(near), CHUNK, WORKERS)
    in_chunks(in_sun, len(sunny), CHUNK * 4, WORKERS)
    noise = np.where(known, noise, np.float32(-1.0))
    lost = smooth(base.surfaces, base.sheet, texels, lost, noise, 3.0, near)
    fade = np.clip((REACH - distance) / (REACH * _FADE), 0.0, 1.0)
    fade = fade * fade * (3 - 2 * fade)
    return lost * fade[:, None] + beam, known
