"""Standing new objects in a lit room: the light on the objects themselves.

The room's light is not solved again. The objects gather it, and what they reflect to one another, with rays; what they
take from the room is the work of `shadowing`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from generators.core.low_discrepancy import cosine_directions
from generators.core.scene import F32, I32, LightMap, Part, Scene
from generators.lighting.blocks import make_blocks
from generators.lighting.direct import direct_light
from generators.lighting.gather import CHUNK, cells_at, hemisphere_rays
from generators.lighting.lit_scene import OUTSIDE, LitScene
from generators.lighting.scan_light import with_scan_light
from generators.lighting.scan_shadow import with_shadow_maps
from generators.lighting.shadowing import shadowed
from generators.lighting.smoothing import fill, smooth, spread
from generators.lighting.sun import sun_light
from generators.lighting.surfaces import LitSurfaces, in_chunks
from generators.lighting.surroundings import RAYS, SAMPLES, WORKERS, Objects, Surroundings, behind
from generators.lighting.texels import Sheet
from generators.lighting.unwrap import LightMapLayout, unwrap

#: The objects of one call get about this many texels in all.
_TEXELS = 28000
#: Limits of a texel's side on objects (m).
_FINEST, _COARSEST = 0.008, 0.025
#: Bounces of light between objects; the third carries a few per cent of the light.
_BOUNCES = 3
#: Light above this does not fit float16 (whose largest number is 65504).
_BRIGHTEST = 6e4


def insert(scene: Scene, parts: tuple[Part, ...]) -> Scene:
    """Add unlit parts to a lit scene.

    Args:
        scene: with light maps from `bake`, or scanned parts whose texture holds the light (of a scan from a file,
            `Scene.stage`, the faces near the objects become parts with maps of their shadows). It is not changed.
        parts: meshes in world coordinates; light they may have is replaced.

    Returns:
        The scene with the lit parts at its end; light maps near them are new arrays, all others are shared.
    """
    if not parts:
        return scene
    objects, layouts = _prepare(parts)
    scene = with_shadow_maps(with_scan_light(scene), objects.boxes())
    return light_parts(
        scene, Surroundings.of(scene, objects.boxes()), objects, parts, [uv_of(each) for each in layouts]
    )


def light_parts(scene: Scene, room: Surroundings, objects: Objects, parts: Sequence[Part], uvs: Sequence[F32]) -> Scene:
    """The scene with lit ``parts`` at its end, and its own parts in their shadow.

    Args:
        scene: without the objects.
        room: what the objects find in it.
        objects: the faces and light maps of ``parts``.
        parts: one per light map of ``objects``.
        uvs: for each part (F, 3, 2) places in its light map, 0 to 1.
    """
    gathered = gather_light(objects, room)
    # The objects throw light on the room and take light from it; they stand in what is left of it.
    first = light_on(objects, room.dim, gathered)
    around, ratio = shadowed(scene.parts, room, objects, first)
    cells = light_on(objects, replace(room.dim, light=room.dim.light * ratio), gathered)
    lit = []
    for number, (part, uv) in enumerate(zip(parts, uvs, strict=True)):
        texels = np.minimum(objects.sheet.image(number, cells), _BRIGHTEST).astype(np.float16)
        lit.append(replace(part, light=LightMap(uv, texels)))
    return replace(scene, parts=around + tuple(lit))


def uv_of(layout: LightMapLayout) -> F32:
    """(F, 3, 2) float32 the layout's places in its light map, 0 to 1."""
    return np.asarray((layout.uv / np.array([layout.width, layout.height])).astype(np.float32))


def texel_size(sides: NDArray[np.float64], texels: int) -> float:
    """Side of a texel, metres, with which faces get about ``texels`` texels, within limits.

    Args:
        sides: (F, 2, 3) two sides of each face, metres.
        texels: for all faces together.
    """
    area = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2
    return float(np.clip(np.sqrt(area / texels), _FINEST, _COARSEST))


def _prepare(parts: tuple[Part, ...]) -> tuple[Objects, list[LightMapLayout]]:
    """The parts with their layouts."""
    surfaces = LitSurfaces.of(parts)
    corners = surfaces.triangles.astype(np.float64)
    texel = texel_size(corners[:, 1:] - corners[:, :1], _TEXELS)
    layouts = [unwrap(part.mesh.positions, texel, normals=part.mesh.normals) for part in parts]
    return Objects.of(surfaces, Sheet.of(layouts)), layouts


@dataclass(frozen=True, eq=False)
class Gathered:
    """The view of the objects' texels, before it is known how they shade the room.

    Attributes:
        direct: (N, 3) light of emitters and the sun.
        noise: (N,) variance of the luminance of what rays find.
        face: (N·n,) face of the room that a ray meets, -1 where it meets an object, `OUTSIDE` where nothing.
        v: (N·n,) weight of the face's second corner.
        w: (N·n,) weight of its third corner.
        links: (N, n) texel of the objects that a ray meets, or -1.
        is_open: (N,) whether a texel lies in free space.
    """

    direct: F32
    noise: F32
    face: I32
    v: F32
    w: F32
    links: I32
    is_open: NDArray[np.bool_]


def gather_light(objects: Objects, room: Surroundings) -> Gathered:
    """Gather the surfaces that the objects' texels see, and the light that reaches them directly."""
    texels = objects.texels
    count = len(texels)
    table = cosine_directions(RAYS)
    direct, shadow_noise = np.zeros((count, 3), dtype=np.float32), np.zeros(count, dtype=np.float32)
    noise = np.zeros(count, dtype=np.float32)
    links = np.full((count, RAYS), -1, dtype=np.int32)
    face = np.full(count * RAYS, -1, dtype=np.int32)
    v, w = np.zeros(count * RAYS, dtype=np.float32), np.zeros(count * RAYS, dtype=np.float32)
    buried = np.zeros(count, dtype=bool)
    reach = room.reach(objects)
    tile = make_blocks(objects.surfaces, objects.sheet, texels).of

    def hidden(origins: F32, directions: F32, far: F32) -> NDArray[np.bool_]:
        return room.tracer.occluded(origins, directions, far) | objects.tracer.occluded(origins, directions, far)

    def work(first: int, last: int) -> None:
        part, rays = slice(first, last), slice(first * RAYS, last * RAYS)
        position, normal, pattern = texels.position[part], texels.normal[part], texels.pattern[part]
        across = texels.across[part]
        under = objects.surfaces.face_normal[texels.face[part]]
        origins, directions = hemisphere_rays(position, normal, under, pattern, table)
        hits = room.tracer.intersect(origins, directions)
        near = objects.tracer.intersect(origins, directions, hits["tfar"])
        met = near["primID"] >= 0
        back = np.where(
            met,
            behind(objects.surfaces, near["primID"], directions),
            behind(room.dim.surfaces, hits["primID"], directions),
        )
        buried[part] = back.reshape(-1, RAYS).mean(axis=1) > 0.5
        cells = cells_at(objects.surfaces, objects.sheet, near["primID"], near["u"], near["v"])
        links[part] = np.where(met, texels.index[cells], -1).reshape(-1, RAYS)
        found = np.where(hits["primID"] < 0, OUTSIDE, hits["primID"])
        face[rays], v[rays], w[rays] = np.where(met, -1, found), hits["u"], hits["v"]
        seen = room.dim.reflected(face[rays], v[rays], w[rays]).mean(axis=1)
        noise[part] = seen.reshape(-1, RAYS).var(axis=1) / RAYS
        free = np.flatnonzero(~buried[part])
        free = free[np.argsort(tile[free + first], kind="stable")]
        position, normal, pattern = position[free], normal[free], pattern[free]
        own = free + first
        kind = objects.surfaces.part[texels.face[own]]
        direct[own], shadow_noise[own] = direct_light(
            room.emitters, reach[kind], pattern, position, normal, hidden, block=tile[own], sparing=False
        )
        if room.sun is not None:
            direct[own] += sun_light(
                room.sun, pattern, position, normal, across[free], room.tracer, SAMPLES, objects=objects.tracer
            )

    in_chunks(work, count, CHUNK, WORKERS)
    closed = np.float32(-1.0)
    shadow_noise = np.where(buried, closed, shadow_noise)
    direct = smooth(objects.surfaces, objects.sheet, texels, direct, shadow_noise)
    return Gathered(direct, np.where(buried, closed, noise), face, v, w, links, ~buried)


def light_on(objects: Objects, room: LitScene, gathered: Gathered) -> F32:
    """Light (cells, 3) of the objects in a room that reflects as ``room`` does."""
    texels, count = objects.texels, len(objects.texels)
    arrived = np.zeros((count, 3), dtype=np.float32)

    def work(first: int, last: int) -> None:
        rays = slice(first * RAYS, last * RAYS)
        seen = room.reflected(gathered.face[rays], gathered.v[rays], gathered.w[rays]).reshape(-1, RAYS, 3)
        arrived[first:last] = seen.mean(axis=1)

    in_chunks(work, count, CHUNK, WORKERS)
    light = gathered.direct + arrived
    linked = np.flatnonzero((gathered.links >= 0).any(axis=1) & gathered.is_open)
    links = gathered.links[linked]
    for _ in range(_BOUNCES):
        radiance = np.where(gathered.is_open[:, None], texels.albedo * light, np.float32(0.0))
        bounced = np.where(links[..., None] >= 0, radiance[links], np.float32(0.0))
        light = gathered.direct + arrived
        light[linked] += bounced.mean(axis=1)
    indirect = smooth(objects.surfaces, objects.sheet, texels, light - gathered.direct, gathered.noise)
    filled = fill(objects.surfaces, objects.sheet, texels, gathered.direct + indirect, gathered.is_open)
    return spread(objects.sheet, texels, filled)
