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
from generators.lighting.gather import CHUNK, cells_at, hemisphere_rays
from generators.lighting.interpolation import Slow
from generators.lighting.surfaces import LitSurfaces, in_chunks
from generators.lighting.texels import Sheet, Texels

#: Blocks per piece of work when links are traced.
_LINK_CHUNK = 512
#: Distances of less than this count as this (metres).
_NEAREST = 1e-3
#: A block is enclosed if all of its first rays but one meet something nearer than this (metres).
_ENCLOSED = 0.25
_MOST_BOUNCES = 64
#: Blocks per piece of work when the bounces are added up.
_SOLVE_CHUNK = 1 << 13
#: The bounces end when no block changes by more than this part of their mean: a block beside a bulb is no measure.
_TOLERANCE = 1e-3


@njit
def _bounce(links: I32, direct: F32, albedo: F32, before: F32, after: F32) -> None:
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
        block: (B, n) int32 block that each ray meets, -1 for nothing or black, -2 where nobody knows the light or the
            ray was not shot.
        colour: (B,) int32 which of the sets of directions a block uses.
        table: (16, n, 3) float32 sets of directions about the normal.
        distance: (B,) float32 harmonic mean of the distances to what the first half of the rays meets, metres.
        is_enclosed: (B,) bool, whether the block lies in a gap or a closed box (see `_ENCLOSED`).
    """

    block: I32
    colour: I32
    table: F32
    distance: F32
    is_enclosed: NDArray[np.bool_]


@njit
def _block_rays(
    chosen: NDArray[np.int64],
    rays: int,
    first: int,
    start: NDArray[np.int64],
    members: NDArray[np.int64],
    colour: I32,
    whole: Any,
    texel: NDArray[np.int64],
    pattern: I32,
) -> None:
    """Which texel each of ``rays`` rays of the blocks ``chosen`` starts from, and its direction's number.

    Neighbouring blocks use different parts of the sequence of ``whole`` directions; the rays start all over the block.
    """
    row = 0
    for b in chosen:
        size = start[b + 1] - start[b]
        for ray in range(first, first + rays):
            texel[row] = members[start[b] + (ray * 7 + b) % size]
            pattern[row] = colour[b] * whole + ray
            row += 1


@dataclass(frozen=True, eq=False)
class LinkTracer:
    """Shoots the bundles of rays of blocks.

    Attributes:
        surfaces: the faces.
        sheet: their light maps.
        texels: the texels.
        blocks: their groups.
        tracer: over all faces.
        workers: threads.
    """

    surfaces: LitSurfaces
    sheet: Sheet
    texels: Texels
    blocks: Blocks
    tracer: Tracer
    workers: int

    def trace(self, rays: int) -> Links:
        """Links of bundles of ``rays`` rays, of which every block shoots the first half here."""
        place = self.blocks.place
        colour = pattern_of(place[:, 2].astype(np.int32), place[:, 1].astype(np.int32))
        links = Links(
            np.full((len(self.blocks), rays), -2, dtype=np.int32),
            colour,
            cosine_directions(rays, (0x51633E2D, 0x68BC21EB)),
            np.empty(len(self.blocks), dtype=np.float32),
            np.zeros(len(self.blocks), dtype=bool),
        )
        self._shoot(links, np.arange(len(self.blocks)), 0, rays // 2)
        return links

    def complete(self, links: Links, chosen: NDArray[np.int64]) -> None:
        """Shoot the other half of the rays of the blocks ``chosen``, and write what they meet into ``links``."""
        rays = links.block.shape[1]
        self._shoot(links, chosen, rays // 2, rays)

    def _shoot(self, links: Links, chosen: NDArray[np.int64], first: int, last: int) -> None:
        count, rays = last - first, links.block.shape[1]
        blocks, texels = self.blocks, self.texels
        singles = links.table.reshape(PATTERNS * rays, 1, 3)

        def work(begin: int, end: int) -> None:
            own = chosen[begin:end]
            texel = np.empty(len(own) * count, dtype=np.int64)
            pattern = np.empty(len(own) * count, dtype=np.int32)
            _block_rays(own, count, first, blocks.start, blocks.members, links.colour, rays, texel, pattern)
            under = self.surfaces.face_normal[texels.face[texel]]
            origins, directions = hemisphere_rays(texels.position[texel], texels.normal[texel], under, pattern, singles)
            hits = self.tracer.intersect(origins, directions)
            met = _blocks_met(self.surfaces, self.sheet, texels, blocks, hits)
            links.block[own, first:last] = met.reshape(-1, count)
            if first == 0:
                far = hits["tfar"].reshape(-1, count)
                links.is_enclosed[own] = (far > _ENCLOSED).sum(axis=1) <= 1
                near = 1.0 / np.maximum(far, _NEAREST)
                links.distance[own] = 1.0 / np.maximum(near.mean(axis=1, dtype=np.float64), 1e-30)

        in_chunks(work, len(chosen), _LINK_CHUNK * self.tracer.calls_together, self.workers)


def solve(texels: Texels, blocks: Blocks, links: Links, direct: F32, sampled: F32, workers: int = 1) -> tuple[F32, F32]:
    """The blocks' reflected radiance (B, 3), without emission and without what is sampled as an emitter, and its light.

    Args:
        texels: the texels.
        blocks: their groups.
        links: what the blocks see.
        direct: (N, 3) direct light of the texels.
        sampled: (N, 3) the part of it that is an emitter itself (see `bright_patches`): its light is in ``direct``.
        workers: threads; the result does not depend on them.

    Returns:
        The radiance, and the indirect light (B, 3) that comes to the blocks from it.
    """
    albedo = blocks.mean(texels.albedo, workers=workers)
    own = blocks.mean(direct, workers=workers)
    known = albedo * blocks.mean(sampled, workers=workers)
    radiance = albedo * own - known
    # The half of the rays that all blocks shot: what a block reflects is seen together with many others.
    few = np.ascontiguousarray(links.block[:, : links.block.shape[1] // 2])
    for _ in range(_MOST_BOUNCES):
        after = np.empty_like(radiance)

        def bounce(first: int, last: int, before: F32 = radiance, after: F32 = after) -> None:
            _bounce(few[first:last], own[first:last], albedo[first:last], before, after[first:last])

        in_chunks(bounce, len(few), _SOLVE_CHUNK, workers)
        after -= known
        change = float(np.abs(after - radiance).max(initial=0.0))
        radiance = after
        if not len(blocks) or change <= _TOLERANCE * float(radiance.mean(dtype=np.float64)):
            break
    light, spread = np.zeros((len(blocks), 3), dtype=np.float32), np.zeros(len(blocks), dtype=np.float32)

    def collect(first: int, last: int) -> None:
        part = slice(first, last)
        _collect(links.block[part].reshape(-1), radiance, links.block.shape[1], light[part], spread[part])

    in_chunks(collect, len(blocks), _SOLVE_CHUNK, workers)
    return radiance, light


@njit
def _block_at(cells: NDArray[np.int64], index: I32, of: I32, out: I32) -> None:
    for i in range(len(cells)):
        texel = index[cells[i]] if cells[i] >= 0 else -1
        if texel < 0:
            out[i] = -1
        else:
            out[i] = of[texel] if of[texel] >= 0 else -2


def _blocks_met(surfaces: LitSurfaces, sheet: Sheet, texels: Texels, blocks: Blocks, hits: dict[str, Any]) -> I32:
    """Block that each ray met; -1 where there is nothing or nothing is baked (black), -2 where its light is unknown."""
    cells = cells_at(surfaces, sheet, hits["primID"], hits["u"], hits["v"])
    out = np.empty(len(cells), dtype=np.int32)
    _block_at(cells, texels.index, blocks.of, out)
    return out


@njit
def _collect(block: I32, radiance: F32, count: int, light: F32, variance: F32) -> None:
    """Mean of the radiance that ``count`` rays of each point meet, and the variance of this mean."""
    for i in range(len(light)):
        flat = np.zeros(3)
        square = bright = 0.0
        seen = 0
        for k in range(count):
            b = block[i * count + k]
            if b < -1:
                continue
            seen += 1
            if b < 0:
                continue
            luminance = 0.0
            for c in range(3):
                flat[c] += radiance[b, c]
                luminance += radiance[b, c] / 3.0
            bright += luminance
            square += luminance * luminance
        if seen == 0:
            continue
        for c in range(3):
            light[i, c] = flat[c] / seen
        variance[i] = max(square / seen - (bright / seen) ** 2, 0.0) / seen


def final_gather(
    surfaces: LitSurfaces,
    sheet: Sheet,
    texels: Texels,
    blocks: Blocks,
    bounced: tuple[F32, F32],
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
    slow.interpolate(texels, known, light, workers=workers)
    chosen = blocks.members[slow.measured_apart()[blocks.members]]

    def work(first: int, last: int) -> None:
        texel = chosen[first:last]
        pattern = texels.pattern[texel]
        under = surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(texels.position[texel], texels.normal[texel], under, pattern, table)
        block = _blocks_met(surfaces, sheet, texels, blocks, tracer.intersect(origins, directions))
        here, spread = np.zeros((len(texel), 3), dtype=np.float32), np.zeros(len(texel), dtype=np.float32)
        _collect(block, radiance, rays, here, spread)
        light[texel], variance[texel] = here, spread

    in_chunks(work, len(chosen), CHUNK * tracer.calls_together, workers)
    slow.fill_between(light, variance)
    return light, variance
