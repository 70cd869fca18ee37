"""Indirect light: radiosity on blocks of texels, then a final gather at every texel.

Blocks are 4 × 4 texels of one chart. Each block shoots one bundle of rays, once; which block every ray meets is kept,
and the light bounces back and forth along these links until nothing changes (gathering radiosity, Jacobi iteration:
Cohen & Wallace, "Radiosity and Realistic Image Synthesis", 1993, chapter 5). The final gather then looks at the
blocks' radiosity, which is smooth, so that few rays are enough (Reichert 1992): along the same links where all is far
from a block, and else with rays from every texel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import njit
from generators.core.low_discrepancy import PATTERNS, cosine_directions, pattern_of
from generators.core.rays import Tracer
from generators.core.scene import F32, I32
from generators.lighting.blocks import Blocks
from generators.lighting.form_factors import LOBE
from generators.lighting.gather import CHUNK, cells_at, hemisphere_rays
from generators.lighting.interpolation import BlockLight, Slow
from generators.lighting.surfaces import Surfaces, in_chunks
from generators.lighting.texels import Sheet, Texels

#: Blocks per piece of work when links are traced.
_LINK_CHUNK = 512
#: Distances of less than this count as this (metres).
_NEAREST = 1e-3
_MOST_BOUNCES = 64
#: The bounces end when no block changes by more than this part of the brightest one.
_TOLERANCE = 2e-4


@njit
def _bounce(links: Any, direct: Any, albedo: Any, before: Any, after: Any) -> Any:
    """One Jacobi step: ``after`` = albedo · (direct + mean of ``before`` over the links)."""
    for b in range(len(links)):
        red = green = blue = 0.0
        count = 0
        for k in range(links.shape[1]):
            other = links[b, k]
            if other >= 0:
                red += before[other, 0]
                green += before[other, 1]
                blue += before[other, 2]
            if other >= -1:
                count += 1
        count = max(count, 1)
        after[b, 0] = albedo[b, 0] * (direct[b, 0] + red / count)
        after[b, 1] = albedo[b, 1] * (direct[b, 1] + green / count)
        after[b, 2] = albedo[b, 2] * (direct[b, 2] + blue / count)


@dataclass(frozen=True, eq=False)
class Links:
    """Bundles of rays that blocks shoot.

    Attributes:
        block: (B, n) int32 block that each ray meets, -1 for nothing or black, -2 where nobody knows the light.
        colour: (B,) int32 which of the sets of directions a block uses.
        table: (16, n, 3) float32 sets of directions about the normal.
        distance: (B,) float32 harmonic mean of the distances to what the block sees, metres.
    """

    block: I32
    colour: I32
    table: F32
    distance: F32


def trace_links(
    surfaces: Surfaces, sheet: Sheet, texels: Texels, blocks: Blocks, tracer: Tracer, *, rays: int, workers: int
) -> Links:
    """Shoot ``rays`` rays from every block, spread over its texels."""
    closeness = np.zeros(len(blocks), dtype=np.float32)
    colour = pattern_of(blocks.place[:, 2].astype(np.int32), blocks.place[:, 1].astype(np.int32))
    links = np.empty((len(blocks), rays), dtype=np.int32)
    table = cosine_directions(rays, (0x51633E2D, 0x68BC21EB))
    singles = table.reshape(PATTERNS * rays, 1, 3)
    size = np.diff(blocks.start)

    def work(first: int, last: int) -> None:
        block = np.repeat(np.arange(first, last), rays)
        ray = np.tile(np.arange(rays), last - first)
        # Neighbouring blocks use different parts of the sequence; the rays start all over the block.
        pattern = (colour[block] * rays + ray).astype(np.int32)
        texel = blocks.members[blocks.start[block] + (ray * 7 + block) % size[block]]
        under = surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(texels.position[texel], texels.normal[texel], under, pattern, singles)
        hits = tracer.intersect(origins, directions)
        cells = cells_at(surfaces, sheet, hits["primID"], hits["u"], hits["v"])
        links[first:last] = _block_at(cells, texels, blocks).reshape(-1, rays)
        near = (1.0 / np.maximum(hits["tfar"], _NEAREST)).reshape(-1, rays)
        closeness[first:last] = near.mean(axis=1, dtype=np.float64)

    in_chunks(work, len(blocks), _LINK_CHUNK, workers)
    distance = (1.0 / np.maximum(closeness, 1e-30)).astype(np.float32)
    return Links(links, colour, table, distance)


def solve(texels: Texels, blocks: Blocks, links: Links, direct: F32, sampled: F32) -> tuple[F32, BlockLight]:
    """The blocks' reflected radiance (B, 3), without emission and without what is sampled as an emitter, and its light.

    Args:
        texels: the texels.
        blocks: their groups.
        links: what the blocks see.
        direct: (N, 3) direct light of the texels.
        sampled: (N, 3) the part of it that is an emitter itself (see `bright_patches`): its light is in ``direct``.

    Returns:
        The radiance, and the indirect light that comes to the blocks from it.
    """
    albedo = blocks.mean(texels.albedo)
    own = blocks.mean(direct)
    known = albedo * blocks.mean(sampled)
    radiance = albedo * own - known
    # Half of the rays are enough here: what a block reflects is seen together with many others.
    few = np.ascontiguousarray(links.block[:, : links.block.shape[1] // 2])
    for _ in range(_MOST_BOUNCES):
        after = np.empty_like(radiance)
        _bounce(few, own, albedo, radiance, after)
        after -= known
        change = float(np.abs(after - radiance).max(initial=0.0))
        radiance = after
        if change <= _TOLERANCE * float(radiance.max(initial=0.0)):
            break
    lights = []
    for share in (0.0, 1.0):
        gloss = np.full(len(blocks), share, dtype=np.float32)
        light, spread = np.zeros((len(blocks), 3), dtype=np.float32), np.zeros(len(blocks), dtype=np.float32)
        _collect(links.block.reshape(-1), radiance, links.colour, links.table, gloss, light, spread)
        lights.append(light)
    return radiance, BlockLight(*lights)


def _block_at(cells: NDArray[np.int64], texels: Texels, blocks: Blocks) -> I32:
    """Block of each cell; -1 where there is nothing or nothing is baked (black), -2 where nobody knows the light."""
    texel = np.where(cells >= 0, texels.index[cells], -1)
    block = np.where(texel >= 0, blocks.of[texel], -1)
    return np.where((texel >= 0) & (block < 0), -2, block).astype(np.int32)


@njit
def _collect(block: Any, radiance: Any, pattern: Any, table: Any, gloss: Any, light: Any, variance: Any) -> Any:
    count = table.shape[1]
    for i in range(len(light)):
        flat = np.zeros(3)
        lobe = np.zeros(3)
        weight = square = bright = 0.0
        seen = 0
        for k in range(count):
            b = block[i * count + k]
            if b < -1:
                continue
            seen += 1
            narrow = table[pattern[i], k, 2] ** (LOBE - 1.0) if gloss[i] > 0.0 else 0.0
            weight += narrow
            if b < 0:
                continue
            luminance = 0.0
            for c in range(3):
                flat[c] += radiance[b, c]
                lobe[c] += narrow * radiance[b, c]
                luminance += radiance[b, c] / 3.0
            bright += luminance
            square += luminance * luminance
        if seen == 0:
            continue
        g = gloss[i]
        for c in range(3):
            light[i, c] = (1.0 - g) * flat[c] / seen + g * lobe[c] / max(weight, 1e-9)
        variance[i] = max(square / seen - (bright / seen) ** 2, 0.0) / seen


def final_gather(
    surfaces: Surfaces,
    sheet: Sheet,
    texels: Texels,
    blocks: Blocks,
    bounced: tuple[F32, BlockLight],
    slow: Slow,
    tracer: Tracer,
    *,
    rays: int,
    workers: int,
) -> tuple[F32, F32]:
    """Indirect light (N, 3) of the texels and the variance (N,) of its luminance, 0 where it is interpolated.

    Args:
        surfaces: the faces.
        sheet: their light maps.
        texels: the texels.
        blocks: their groups.
        bounced: from `solve`.
        slow: where light varies slowly.
        tracer: over all faces.
        rays: per texel of a block that has something near.
        workers: threads.
    """
    radiance, known = bounced
    light = np.zeros((len(texels), 3), dtype=np.float32)
    variance = np.zeros(len(texels), dtype=np.float32)
    table = cosine_directions(rays, (0x0, 0x0))
    slow.interpolate(texels, known, light)
    is_slow = slow.is_slow[blocks.of[blocks.members]]
    chosen = blocks.members[~is_slow]

    def work(first: int, last: int) -> None:
        texel = chosen[first:last]
        pattern = texels.pattern[texel]
        under = surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(texels.position[texel], texels.normal[texel], under, pattern, table)
        hits = tracer.intersect(origins, directions)
        cells = cells_at(surfaces, sheet, hits["primID"], hits["u"], hits["v"])
        block = _block_at(cells, texels, blocks)
        here, spread = np.zeros((len(texel), 3), dtype=np.float32), np.zeros(len(texel), dtype=np.float32)
        _collect(block, radiance, pattern, table, texels.gloss[texel], here, spread)
        light[texel], variance[texel] = here, spread

    in_chunks(work, len(chosen), CHUNK, workers)
    return light, variance
