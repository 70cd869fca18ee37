"""Light that newly placed objects take from the surfaces around them.

A texel near the objects loses the part of its light that comes along rays the objects are in the way of, and gains
what they reflect. A texel that no such ray leaves keeps its bytes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.arrays import dot_rows
from generators.core.low_discrepancy import cosine_directions
from generators.core.scene import F32, Part
from generators.lighting.direct import direct_light
from generators.lighting.emitters import Emitters
from generators.lighting.gather import CHUNK, hemisphere_rays
from generators.lighting.lit_scene import OUTSIDE, LitScene
from generators.lighting.scan_shadow import beyond_bumps, displayed, received, scaled_distance
from generators.lighting.scan_sun import BUMPS
from generators.lighting.smoothing import fill, smooth
from generators.lighting.sun import Sun, sun_light
from generators.lighting.surfaces import in_chunks
from generators.lighting.surroundings import RAYS, SAMPLES, WORKERS, Objects, Surroundings, behind, nearest_box
from generators.lighting.texels import Texels

#: How far objects take light from the room's surfaces (metres), fading out over the last part of it.
REACH = 1.2
#: Shadow rays per texel and emitter.
_SHADOW_RAYS = 8
_FADE = 0.5
#: How far they throw shadows in the sun, metres.
_SUN_REACH = 3.0
#: A texel whose light is less than this part of full sunlight is not in the sun.
_SUNNY = 0.04


def shadowed(parts: tuple[Part, ...], room: Surroundings, objects: Objects, cells: F32) -> tuple[tuple[Part, ...], F32]:
    """The room's parts, darkened near the objects.

    Args:
        parts: of the room; they are not changed.
        room: their light.
        objects: what stands in it.
        cells: (cells, 3) light on the objects.

    Returns:
        The parts, those with changed texels with new arrays, and the factor (cells, 3) by which light changes.
    """
    base, texels = room.lit, room.texels
    factors = np.ones_like(base.light)
    if not len(texels):
        return parts, factors
    distance = nearest_box(texels.position, objects.boxes())
    on_scan = room.scanned[base.surfaces.part[texels.face]]
    if on_scan.any():
        distance[on_scan] = scaled_distance(texels.position[on_scan], objects.boxes(), REACH)
    lost, known = _lost_light(room, objects, distance, cells)
    old = base.light[texels.cell]
    unlit = np.flatnonzero(on_scan & (lost != 0).any(axis=1))
    if len(unlit):
        old = old.copy()
        old[unlit] = received(room, unlit)
    ratio = np.clip(1.0 - lost / np.maximum(old, 1e-6), 0.02, 4.0).astype(np.float32)
    # Texels that the objects bury take the shade of those beside them, or a bright rim would show round the contact.
    ratio = fill(base.surfaces, base.sheet, texels, ratio, known, rings=3)
    factors[texels.cell] = ratio
    changed = np.any(ratio != 1.0, axis=1)
    shaded = np.flatnonzero(on_scan & changed)
    if len(shaded):
        # A scan's map holds factors of what is displayed.
        before = base.light[texels.cell[shaded]]
        old[shaded] = before
        shown = displayed(texels.albedo[shaded] * before, ratio[shaded], room.black)
        new = old * ratio
        new[shaded] = before * shown
        new = new[changed]
    else:
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
    return tuple(out), factors


def _reflected(room: LitScene, hits: dict[str, Any]) -> F32:
    """(N, 3) radiance that rays meet."""
    face = np.where(hits["primID"] < 0, OUTSIDE, hits["primID"])
    return room.reflected(face, hits["u"], hits["v"])


def _before(position: F32, normal: F32, boxes: list[F32]) -> NDArray[np.bool_]:
    """(N,) whether any part of some box lies before the plane of a texel."""
    out = np.zeros(len(position), dtype=bool)
    for box in boxes:
        # The corner of the box that lies farthest along the normal.
        farthest = np.where(normal > 0, box[1], box[0])
        out |= np.einsum("ij,ij->i", farthest - position, normal) > 0
    return out


def _between(emitters: Emitters, reach: NDArray[np.bool_], position: F32, boxes: list[F32]) -> NDArray[np.bool_]:
    """(N, L) whether some box may stand between a point and an emitter, judged by the balls round both.

    Not before emitters that do not ``reach`` (L,) the boxes.
    """
    every = np.zeros((len(position), len(emitters)), dtype=bool)
    lights = np.flatnonzero(reach)
    out = np.zeros((len(position), len(lights)), dtype=bool)
    way = emitters.centre[lights] - position[:, None]
    length = np.maximum(np.sqrt(np.einsum("ilc,ilc->il", way, way)), 1e-6)
    for box in boxes:
        radius = float(np.linalg.norm(box[1] - box[0])) / 2
        to = (box[0] + box[1]) / 2 - position
        share = np.clip(np.einsum("ilc,ic->il", way, to) / length**2, 0.0, 1.0)
        aside = share[..., None] * way - to[:, None]
        beside = np.sqrt(np.einsum("ilc,ilc->il", aside, aside))
        # The beam from a point to the emitter widens along its way.
        out |= beside < radius + np.minimum(share + radius / length, 1.0) * emitters.radius[lights]
    every[:, lights] = out
    return every


def _lost_light(room: Surroundings, objects: Objects, distance: F32, cells: F32) -> tuple[F32, NDArray[np.bool_]]:
    """Light (N, 3) that the objects take from the room's texels (negative: give), and which texels they do not bury."""
    base, texels = room.lit, room.texels
    count = len(texels)
    table = cosine_directions(RAYS)
    lost, beam = np.zeros((count, 3), dtype=np.float32), np.zeros((count, 3), dtype=np.float32)
    noise = np.zeros(count, dtype=np.float32)
    known = np.ones(count, dtype=bool)
    reach = np.asarray(room.reach(objects).any(axis=0))
    boxes = objects.boxes()
    near = np.flatnonzero(distance < REACH)
    near = near[_before(texels.position[near], texels.normal[near], boxes)]
    sunny = np.zeros(0, dtype=np.int64)
    if room.sun is not None:
        cosine = dot_rows(texels.normal, room.sun.direction.astype(np.float32))
        enough = base.light[texels.cell].max(axis=1) > _SUNNY * room.sun.radiance.max() * cosine
        sunny = np.flatnonzero((distance < _SUN_REACH) & (cosine > 0) & enough)
    shade = LitScene(objects.surfaces, objects.sheet, cells, objects.tracer)
    rough = bool(room.scanned.any())
    bumps = np.float32(BUMPS if rough else 0.0)

    def taken(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        """Whether a ray is not one of those that the objects alone stop."""
        stopped = objects.tracer.occluded(origins, directions, far)
        rays = np.flatnonzero(stopped)
        origins, directions, far = origins[rays], directions[rays], far[rays]
        if rough:
            ahead = beyond_bumps(directions)
            origins, far = origins + ahead * directions, far - ahead[:, 0]
        stopped[rays] = ~base.tracer.occluded(origins, directions, far)
        return ~stopped

    def around(first: int, last: int) -> None:
        texel = near[first:last]
        position, normal, pattern = texels.position[texel], texels.normal[texel], texels.pattern[texel]
        under = base.surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = objects.tracer.intersect(origins, directions)
        rays = np.flatnonzero(hits["primID"] >= 0)
        hits = {key: value[rays] for key, value in hits.items()}
        beyond = base.tracer.intersect(origins[rays] + bumps * directions[rays], directions[rays])
        first_met = hits["tfar"] < beyond["tfar"] + bumps
        back = behind(objects.surfaces, hits["primID"], directions[rays]) & first_met
        buried = np.bincount(rays[back] // RAYS, minlength=len(texel)) > 0.5 * RAYS
        change = (_reflected(room.dim, beyond) - _reflected(shade, hits)) * first_met[:, None]
        owner = rays // RAYS
        here = np.stack([np.bincount(owner, change[:, c], minlength=len(texel)) for c in range(3)], axis=1) / RAYS
        square = np.bincount(owner, change.mean(axis=1) ** 2, minlength=len(texel)) / RAYS
        spread_ = np.maximum(square - here.mean(axis=1) ** 2, 0.0) / RAYS
        selected = _between(room.emitters, reach, position, boxes)
        direct, shadow_noise = direct_light(
            room.emitters, selected, pattern, position, normal, taken, rays=_SHADOW_RAYS
        )
        lost[texel] = here + direct
        noise[texel] = spread_ + shadow_noise
        known[texel] = ~buried

    def in_sun(first: int, last: int) -> None:
        part = sunny[first:last]
        if room.sun is not None:
            at = texels.pattern[part], texels.position[part], texels.normal[part], texels.across[part]
            beam[part] = sun_light(room.sun, *at, base.tracer, SAMPLES, objects=objects.tracer, lost=True)

    in_chunks(around, len(near), CHUNK, WORKERS)
    in_chunks(in_sun, len(sunny), CHUNK * 4, WORKERS)
    noise = np.where(known, noise, np.float32(-1.0))
    lost = smooth(base.surfaces, base.sheet, texels, lost, noise, near)
    fade = np.clip((REACH - distance) / (REACH * _FADE), 0.0, 1.0)
    fade = fade * fade * (3 - 2 * fade)
    # A scan's map holds no light.
    own = sunny[~room.scanned[base.surfaces.part[texels.face[sunny]]]]
    if room.sun is not None and beam[own].any():
        beam[own] = _in_proportion(base, texels, room.sun, own, beam[own])
    return lost * fade[:, None] + beam, known


def _in_proportion(base: LitScene, texels: Texels, sun: Sun, sunny: NDArray[np.int64], taken: F32) -> F32:
    """Sunlight (n, 3) that objects take from texels: of what their map has, the share of the rays that they stop.

    The map is smoothed, so that beside the edge of a patch it has less or more than the rays bring: what they bring,
    taken as it is, would leave dark dots.

    Args:
        base: the room without the objects.
        texels: of its map.
        sun: of the room.
        sunny: (n,) which of them may lose sunlight.
        taken: (n, 3) sunlight of the rays that the objects stop.
    """
    has, arriving = base.light[texels.cell], np.zeros((len(texels), 3), dtype=np.float32)

    def arrive(first: int, last: int) -> None:
        part = sunny[first:last]
        at = texels.pattern[part], texels.position[part], texels.normal[part], texels.across[part]
        arriving[part] = sun_light(sun, *at, base.tracer, SAMPLES)

    in_chunks(arrive, len(sunny), CHUNK * 4, WORKERS)
    noise = np.full(len(texels), -1.0, dtype=np.float32)
    noise[sunny] = 1e6  # a mean over all around that are known
    rest = smooth(base.surfaces, base.sheet, texels, has - arriving, noise, sunny)[sunny]
    share = np.minimum(taken / np.maximum(arriving[sunny], 1e-6), 1.0)
    return np.asarray(share * np.maximum(has[sunny] - rest, 0.0))
