"""Rays from texels into the hemisphere above them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.low_discrepancy import cosine_directions
from generators.core.rays import Tracer
from generators.core.scene import F32, I32
from generators.lighting.blocks import Blocks
from generators.lighting.surfaces import LitSurfaces, in_chunks
from generators.lighting.texels import Sheet, Texels

#: Texels per piece of work.
CHUNK = 2048
#: Blocks per piece of work: about as many texels.
BLOCK_CHUNK = 192
#: A texel of which more than half of the probes end nearer than this (m), some on what shines, is inside of a lamp.
_NEAR = 0.1
#: Rays per texel that tell whether it lies in free space.
_PROBES = 8


@inline
def _frame(x: float, y: float, z: float) -> tuple[float, float, float, float, float, float]:
    """Two tangents of a unit normal (Duff et al., JCGT 2017)."""
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


@njit
def _rays(position: F32, normal: F32, under: F32, pattern: I32, table: F32, origins: F32, directions: F32) -> None:
    count = table.shape[1]
    for i in range(len(position)):
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        tx, ty, tz, bx, by, bz = _frame(nx, ny, nz)
        p = pattern[i]
        for k in range(count):
            a, b, c = table[p, k, 0], table[p, k, 1], table[p, k, 2]
            x, y, z = a * tx + b * bx + c * nx, a * ty + b * by + c * ny, a * tz + b * bz + c * nz
            # A shading normal leans: what would go into the surface is mirrored out of it.
            below = x * under[i, 0] + y * under[i, 1] + z * under[i, 2]
            if below < 0.0:
                x -= 2.0 * below * under[i, 0]
                y -= 2.0 * below * under[i, 1]
                z -= 2.0 * below * under[i, 2]
            row = i * count + k
            directions[row, 0], directions[row, 1], directions[row, 2] = x, y, z
            for c3 in range(3):
                origins[row, c3] = position[i, c3]


def hemisphere_rays(position: F32, normal: F32, under: F32, pattern: I32, table: F32) -> tuple[F32, F32]:
    """Origins and unit directions (N·n, 3) of ``table``'s n directions per point.

    Args:
        position: (N, 3).
        normal: (N, 3) shading normals, the pole of the hemisphere.
        under: (N, 3) geometric normals; no ray goes below them.
        pattern: (N,) which set of directions a point uses.
        table: (16, n, 3) from `cosine_directions`.
    """
    rows = len(position) * table.shape[1]
    origins, directions = np.empty((rows, 3), dtype=np.float32), np.empty((rows, 3), dtype=np.float32)
    _rays(position, normal, under, pattern, table, origins, directions)
    return origins, directions


@njit
def _count_hits(
    found: Any, distance: F32, directions: F32, face_normal: F32, shines: Any, near: float, count: Any, met: I32
) -> None:
    """How many of each point's ``count`` rays meet the back of a face, anything near, what shines near (n, 3)."""
    met[:] = 0
    for i in range(len(met)):
        for row in range(i * count, (i + 1) * count):
            f = found[row]
            if f < 0:
                continue
            side = 0.0
            for c in range(3):
                side += directions[row, c] * face_normal[f, c]
            if side > 0.0:
                met[i, 0] += 1
            if distance[row] < near:
                met[i, 1] += 1
                if shines[f]:
                    met[i, 2] += 1


def open_texels(
    surfaces: LitSurfaces, texels: Texels, tiles: Blocks, tracer: Tracer, workers: int
) -> NDArray[np.bool_]:
    """(N,) which texels lie in free space; the others are inside of something (they mostly see the back of faces).

    A floor texel below a cupboard is such a one. Left in, its darkness would spread over the visible floor by
    interpolation. A texel of the ceiling in the ring of a lamp is another: it sees the lamp close by, and its light
    would spread in bright jags. All texels of a tile shoot a quarter of the probes; if none of them meets a back or a
    lamp, the tile is open.

    Args:
        surfaces: the faces.
        texels: the texels.
        tiles: the texels in blocks; those that are in none are not open.
        tracer: over all faces.
        workers: threads.
    """
    table = cosine_directions(_PROBES, (0x2545F491, 0x4F6CDD1D))
    quarter = _PROBES // 4
    is_open = tiles.of >= 0

    shines = np.any(surfaces.emission > 0, axis=1)[surfaces.material]

    def hits_of(texel: NDArray[np.int64], probes: F32) -> NDArray[np.int32]:
        """(n, 3) how many probes meet the back of a face, anything near, and near what shines."""
        under = surfaces.face_normal[texels.face[texel]]
        origins, directions = hemisphere_rays(
            texels.position[texel], texels.normal[texel], under, texels.pattern[texel], probes
        )
        hits = tracer.intersect(origins, directions)
        met = np.empty((len(texel), 3), dtype=np.int32)
        seen = hits["primID"], hits["tfar"], directions, surfaces.face_normal, shines, _NEAR, probes.shape[1]
        _count_hits(*seen, met)
        return met

    def work(first: int, last: int) -> None:
        texel = tiles.members[tiles.start[first] : tiles.start[last]]
        met = hits_of(texel, np.ascontiguousarray(table[:, :quarter]))
        tile = tiles.of[texel] - first
        unsure = np.flatnonzero((np.bincount(tile, met[:, 0] + met[:, 2]) > 0)[tile])
        met[unsure] += hits_of(texel[unsure], np.ascontiguousarray(table[:, quarter:]))
        back, near, lamp = met.T
        is_open[texel] = (back < 0.5 * _PROBES) & ((lamp == 0) | (near <= 0.5 * _PROBES))

    in_chunks(work, len(tiles), BLOCK_CHUNK * tracer.calls_together, workers)
    return is_open


@njit
def _cells(
    found: I32,
    v: F32,
    w: F32,
    part: I32,
    uv: F32,
    offset: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
    cells: NDArray[np.int64],
) -> None:
    for i in range(len(found)):
        f = found[i]
        if f < 0:
            cells[i] = -1
            continue
        p = part[f]
        a = 1.0 - v[i] - w[i]
        x = int(a * uv[f, 0, 0] + v[i] * uv[f, 1, 0] + w[i] * uv[f, 2, 0])
        y = int(a * uv[f, 0, 1] + v[i] * uv[f, 1, 1] + w[i] * uv[f, 2, 1])
        cells[i] = offset[p] + min(max(y, 0), height[p] - 1) * width[p] + min(max(x, 0), width[p] - 1)


def cells_at(surfaces: LitSurfaces, sheet: Sheet, face: I32, v: F32, w: F32) -> NDArray[np.int64]:
    """(N,) cell of the sheet at points of faces, -1 where ``face`` is negative."""
    cells = np.empty(len(face), dtype=np.int64)
    _cells(face, v, w, surfaces.part, sheet.uv, sheet.offset, sheet.width, sheet.height, cells)
    return cells
