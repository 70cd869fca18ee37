"""Baking global illumination into light maps.

    unwrap → texels → which of them are open → direct light → bounces on blocks → final gather → smooth → fill

Light is stored as the radiance that a white matte surface would reflect there (irradiance / π), so that a renderer
shows albedo · light + emission.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.core.rays import Tracer, open_tracer
from generators.core.scene import F32, LightMap, Part, Scene
from generators.lighting.blocks import Blocks, make_blocks
from generators.lighting.direct import direct_light, emitter_pairs, shadow_rays
from generators.lighting.emitters import BRIGHT, Emitters, bright_patches, find_emitters
from generators.lighting.exposure import expose
from generators.lighting.gather import BLOCK_CHUNK, CHUNK, open_texels
from generators.lighting.glints import glints
from generators.lighting.insertion import insert
from generators.lighting.interpolation import Slow
from generators.lighting.lit_scene import LitScene
from generators.lighting.radiosity import LinkTracer, final_gather, solve
from generators.lighting.resolution import Fineness, lay_out, rims
from generators.lighting.smoothing import despeckle, fill, smooth, spread
from generators.lighting.sun import Sun, find_sun, sun_light
from generators.lighting.surfaces import LitSurfaces, in_chunks, rows_in_chunks
from generators.lighting.texels import Sheet, Texels, rasterise
from generators.lighting.unwrap import LightMapLayout

__all__ = ["QUALITIES", "Quality", "bake", "insert"]


@dataclass(frozen=True)
class Quality:
    """How finely light is baked.

    Attributes:
        fineness: of the texels.
        shadow_rays: per texel and emitter.
        sun_rays: per texel.
        block_rays: per 4 × 4 texels, for the bounces.
        gather_rays: per texel, for the last bounce.
    """

    fineness: Fineness
    shadow_rays: int
    sun_rays: int
    block_rays: int
    gather_rays: int


QUALITIES = {
    "preview": Quality(Fineness(0.10, 0.05, 1.0), 8, 8, 64, 16),
    "standard": Quality(Fineness(0.04, 0.015, 2.0), 16, 32, 128, 32),
    "high": Quality(Fineness(0.025, 0.01, 2.0), 32, 32, 256, 128),
}
#: An emitter that could give less than this part of a texel's direct light gets fewer shadow rays.
_FAINT = 0.08
#: The same of a patch of sunlight, which is large and soft.
_FAINT_PATCH = 0.16
#: Parts that are unwrapped at once: xatlas starts a thread per core for each, and more parts get into each other's way.
_UNWRAPPERS = 4


def bake(scene: Scene, *, quality: str = "standard", workers: int = 2, device: str = "cpu") -> Scene:
    """Light a scene by its emissive faces and, through its windows, by the sun (see `find_sun`).

    Args:
        scene: closed rooms. Parts that have light keep it; they are in the way of light, and else black.
        quality: "preview", "standard" or "high".
        workers: threads; the result does not depend on them.
        device: what casts the rays: ``cpu``, or ``cuda``, whose light differs by rounding.

    Returns:
        The scene with a light map in every part and an exposure in every room.

    Raises:
        Avs3dError: if the quality is unknown, the scene has no parts, or CUDA cannot be used.
    """
    if quality not in QUALITIES:
        raise Avs3dError(f"bake {scene.name}: no quality {quality!r}; expected one of {', '.join(QUALITIES)}")
    if not scene.parts:
        raise Avs3dError(f"bake {scene.name}: the scene has no parts; expected at least one")
    preset = QUALITIES[quality]
    with ThreadPoolExecutor(min(workers, _UNWRAPPERS)) as pool:
        unwrapped = [pool.submit(lay_out, part, scene.rooms, scene.supports, preset.fineness) for part in scene.parts]
        # What needs no light maps, meanwhile.
        surfaces = LitSurfaces.of(scene.parts)
        tracer = open_tracer(surfaces.triangles, device)
        emitters = find_emitters(surfaces, preset.shadow_rays)
        beam = find_sun(scene.name, surfaces, tracer)
        layouts = [each.result() for each in unwrapped]
    sheet = Sheet.of(layouts)
    dark = np.array([part.light is None for part in scene.parts])
    texels = rasterise(surfaces, sheet, dark[surfaces.part], workers)
    part_of = surfaces.part[texels.face]
    tiles = make_blocks(surfaces, sheet, texels, workers).where(~rims(scene.parts, sheet, texels, part_of))
    is_open = open_texels(surfaces, texels, tiles, tracer, workers)
    blocks = tiles.where(is_open)
    bare, variance = _direct(texels, blocks, emitters, tracer, workers)
    sunlight = _sunlight(texels, blocks, beam, tracer, preset, workers)
    bare += sunlight
    if beam is not None:
        thrown, noise, sends = glints(surfaces, sheet, texels, blocks, sunlight, beam, tracer)
        # What has been thrown is not handed on diffusely as well.
        texels = _without_specular(surfaces, texels, sends, sunlight, bare)
        bare, variance = bare + thrown, variance + noise
    patches, sampled = _patches(texels, blocks, bare, preset, workers)
    link_tracer = LinkTracer(surfaces, sheet, texels, blocks, tracer, workers)
    links = link_tracer.trace(preset.block_rays)
    slow = Slow.of(sheet, part_of, texels, blocks, links.distance, links.is_enclosed, workers)
    link_tracer.complete(links, np.flatnonzero(slow.is_slow & ~links.is_enclosed))
    again, more = _direct(texels, blocks, patches, tracer, workers, (bare, slow))
    direct = _smoothed(surfaces, sheet, texels, blocks, (bare + again, variance + more), workers)
    bounced = solve(texels, blocks, links, direct, sampled, workers)
    gathered = final_gather(
        surfaces, sheet, texels, blocks, bounced, slow, tracer, rays=preset.gather_rays, workers=workers
    )
    light = direct + _smoothed(surfaces, sheet, texels, blocks, gathered, workers)
    cells = spread(sheet, texels, fill(surfaces, sheet, texels, light, is_open, workers=workers), workers)
    for number, part in enumerate(scene.parts):
        if part.light is not None:
            sheet.image(number, cells)[:] = part.light.texels
    lit = replace(scene, parts=with_light(scene.parts, layouts, sheet, cells))
    return expose(lit, LitScene(surfaces, sheet, cells, tracer), workers)


def with_light(parts: tuple[Part, ...], layouts: list[LightMapLayout], sheet: Sheet, cells: F32) -> tuple[Part, ...]:
    """The parts, those without light with the light maps in ``cells`` (cells, 3)."""
    out = []
    for number, (part, layout) in enumerate(zip(parts, layouts, strict=True)):
        if part.light is not None:
            out.append(part)
            continue
        uv = (layout.uv / np.array([layout.width, layout.height])).astype(np.float32)
        texels = np.minimum(sheet.image(number, cells), 6e4).astype(np.float16)
        out.append(replace(part, light=LightMap(uv=uv, texels=texels)))
    return tuple(out)


def _sunlight(texels: Texels, blocks: Blocks, beam: Sun | None, tracer: Tracer, preset: Quality, workers: int) -> F32:
    """Sunlight (N, 3) on the open texels."""
    light = np.zeros((len(texels), 3), dtype=np.float32)
    if beam is None:
        return light

    def work(first: int, last: int) -> None:
        own = blocks.members[blocks.start[first] : blocks.start[last]]
        light[own] = sun_light(
            beam,
            texels.pattern[own],
            texels.position[own],
            texels.normal[own],
            texels.across[own],
            tracer,
            preset.sun_rays,
            block=blocks.of[own],
        )

    in_chunks(work, len(blocks), BLOCK_CHUNK * tracer.calls_together, workers)
    return light


def _without_specular(surfaces: LitSurfaces, texels: Texels, sends: NDArray[np.bool_], part: F32, whole: F32) -> Texels:
    """Texels that reflect of ``part`` (N, 3) of their light ``whole`` diffusely alone, where it ``sends`` the rest."""
    rows = np.flatnonzero(sends)
    share = part[rows].mean(axis=1) / np.maximum(whole[rows].mean(axis=1), 1e-12)
    albedo = texels.albedo.copy()
    albedo[rows] -= (share * surfaces.specular[surfaces.material[texels.face[rows]]])[:, None]
    return replace(texels, albedo=np.maximum(albedo, np.float32(0.0)))


def _patches(texels: Texels, blocks: Blocks, direct: F32, preset: Quality, workers: int) -> tuple[Emitters, F32]:
    """Patches of strong direct light as emitters, and the light (N, 3) of the texels in them."""

    def average(rows: slice) -> F32:
        own = blocks.members[rows]
        return np.asarray((texels.albedo[own] * direct[own]).mean(axis=1))

    def strongest(rows: slice) -> F32:
        return np.asarray((texels.albedo[rows] * direct[rows]).max(axis=1))

    own = blocks.members
    averages = rows_in_chunks(average, len(own), workers)
    mean = float(np.average(averages, weights=texels.area[own] + 1e-12)) if len(own) else 0.0
    bright = np.flatnonzero(rows_in_chunks(strongest, len(texels), workers) > BRIGHT * mean)
    radiance = texels.albedo[bright] * direct[bright]
    patches, used = bright_patches(
        texels.position[bright], texels.normal[bright], texels.area[bright], radiance, preset.shadow_rays
    )
    sampled = np.zeros_like(direct)
    sampled[bright[used]] = direct[bright[used]]
    return patches, sampled


def _direct(
    texels: Texels,
    blocks: Blocks,
    emitters: Emitters,
    tracer: Tracer,
    workers: int,
    besides: tuple[F32, Slow] | None = None,
) -> tuple[F32, F32]:
    """Light (N, 3) of the emitters on the open texels and its variance (N,).

    With ``besides`` (light from elsewhere; where light varies slowly) the emitters are large and soft: in slow blocks
    their light is measured at some texels only, with all rays, and interpolated.
    """
    light = np.zeros((len(texels), 3), dtype=np.float32)
    variance = np.zeros(len(texels), dtype=np.float32)
    reach = _reach(texels, blocks, emitters, tracer, workers)

    def shade(texel: NDArray[np.int64], *, sparing: bool) -> None:
        light[texel], variance[texel] = direct_light(
            emitters,
            reach[blocks.of[texel]],
            texels.pattern[texel],
            texels.position[texel],
            texels.normal[texel],
            tracer.occluded,
            None if besides is None else besides[0][texel],
            block=blocks.of[texel],
            sparing=sparing,
            faint=_FAINT if besides is None else _FAINT_PATCH,
        )

    def everywhere(first: int, last: int) -> None:
        shade(blocks.members[blocks.start[first] : blocks.start[last]], sparing=True)

    if besides is None:
        in_chunks(everywhere, len(blocks), BLOCK_CHUNK * tracer.calls_together, workers)
        return light, variance
    slow = besides[1]
    sites, apart = slow.sites(texels), slow.measured_apart()

    def partly(first: int, last: int) -> None:
        own = blocks.members[blocks.start[first] : blocks.start[last]]
        shade(own[apart[own]], sparing=True)
        shade(own[sites[own]], sparing=False)

    in_chunks(partly, len(blocks), BLOCK_CHUNK * tracer.calls_together, workers)
    slow.fill_between(light, variance)
    measured = sites | ~slow.is_slow[blocks.of]
    mean = blocks.mean(light, measured, workers)
    slow.interpolate(texels, mean, light, measured, workers)
    variance[slow.is_slow[blocks.of]] = 0.0
    return light, variance


def _reach(texels: Texels, blocks: Blocks, emitters: Emitters, tracer: Tracer, workers: int) -> NDArray[np.bool_]:
    """(B, L) whether any of a few rays from a block, or from a block beside it, reaches the emitter."""
    seen = np.zeros((len(blocks), len(emitters)), dtype=bool)
    if not len(emitters):
        return seen
    size = np.diff(blocks.start)

    def work(first: int, last: int) -> None:
        own = np.arange(first, last)
        here = seen[first:last]
        for turn in range(2):
            # Blocks beside one another look from texels of different patterns, hence at different targets.
            texel = blocks.members[blocks.start[own] + (7 * own + (turn * size[own]) // 2) % size[own]]
            here |= _sees(emitters, texels, texel, ~here, tracer, turn)

    in_chunks(work, len(blocks), CHUNK * tracer.calls_together, workers)
    # Blocks at the rim of a shadow may just miss the emitter: they inherit from blocks near by.
    centre = texels.position[blocks.members[blocks.start[:-1]]]
    voxel = np.floor(centre / 0.4).astype(np.int64)
    voxel -= voxel.min(axis=0) - 1
    shape = tuple(voxel.max(axis=0) + 2)
    grid = np.zeros((*shape, len(emitters)), dtype=bool)
    block, light = np.nonzero(seen)
    grid[(*voxel[block].T, light)] = True
    near = np.zeros_like(grid)
    for x, y, z in np.ndindex(3, 3, 3):
        near[1:-1, 1:-1, 1:-1] |= grid[x : shape[0] - 2 + x, y : shape[1] - 2 + y, z : shape[2] - 2 + z]
    return rows_in_chunks(lambda rows: near[tuple(voxel[rows].T)], len(voxel), workers)


def _sees(
    emitters: Emitters,
    texels: Texels,
    texel: NDArray[np.int64],
    wanted: NDArray[np.bool_],
    tracer: Tracer,
    target: int,
) -> NDArray[np.bool_]:
    """(n, L) whether a texel sees the emitter's target number ``target``; False where it is not ``wanted`` (n, L)."""
    position, normal = texels.position[texel], texels.normal[texel]
    pair, light = emitter_pairs(emitters, wanted, position, normal)
    origins, directions, far, weight = shadow_rays(
        emitters, pair, light, texels.pattern[texel], position, normal, target, target + 1
    )
    use = np.flatnonzero(weight > 0)
    use = use[~tracer.occluded(origins[use], directions[use], far[use])]
    free = np.zeros(wanted.shape, dtype=bool)
    free[pair[use], light[use]] = True
    return free


def _smoothed(
    surfaces: LitSurfaces, sheet: Sheet, texels: Texels, blocks: Blocks, baked: tuple[F32, F32], workers: int
) -> F32:
    light, variance = baked
    light = despeckle(surfaces, sheet, texels, light, blocks.of >= 0, workers)
    variance = np.where(blocks.of >= 0, variance, -1.0).astype(np.float32)
    return smooth(surfaces, sheet, texels, light, variance, workers=workers)
