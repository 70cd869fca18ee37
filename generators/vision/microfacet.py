"""The microfacet model of reflections: GGX normals, Smith's shadowing, Schlick's Fresnel term.

What a surface of roughness r reflects towards the eye is split in two factors (B. Karis, "Real Shading in Unreal Engine
4", SIGGRAPH 2013 courses): the mean radiance L over its lobe, which rays find, and its directional albedo, which is
F0 · A(cos θ, r) + B(cos θ, r) and is tabulated. In a uniform surrounding the product is exact.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from generators.core.albedos import COSINES, ROUGHNESSES
from generators.core.jit import inline
from generators.core.low_discrepancy import PATTERNS, TILE, net, pattern_of
from generators.core.scene import F32

#: Side of the square of pixels whose rays are stratified together.
BLOCK = 8 * TILE
#: Of the scrambling of the tiles' points.
_SEED = 35

_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_TINY = np.float32(1e-7)


@lru_cache(maxsize=1)
def block_points() -> F32:
    """(2, `BLOCK`, `BLOCK`, 2) float32: the point in the unit disc of each pixel of a block.

    The points of each aligned 4 × 4 pixels are a (0, 2)-net, with digits scrambled anew for each. The second set is the
    same for the even pixels of a chessboard, (x + y) % 2 = 0, of 4 × 4. The square is mapped to the disc by area.
    """
    masks = np.random.default_rng(_SEED).integers(2**32, size=(BLOCK // TILE, BLOCK // TILE, 2), dtype=np.uint32)
    y, x = np.mgrid[0:TILE, 0:TILE].astype(np.int32)
    number = pattern_of(x, y)
    out = np.empty((2, BLOCK, BLOCK, 2), dtype=np.float32)
    for row, column in np.ndindex(BLOCK // TILE, BLOCK // TILE):
        tile = slice(row * TILE, (row + 1) * TILE), slice(column * TILE, (column + 1) * TILE)
        points = net(PATTERNS, tuple(masks[row, column].tolist()))
        out[0][tile], out[1][tile] = points[number], points[number % (PATTERNS // 2)]
    radius, angle = np.sqrt(out[..., 0]), 2.0 * np.pi * out[..., 1].astype(np.float64)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).astype(np.float32)


@inline
def directional_albedo(table: F32, roughness: np.float32, cosine: np.float32) -> tuple[np.float32, np.float32]:
    """A and B of `albedos.albedo_table`, bilinear."""
    y = min(max(roughness, _ZERO), _ONE) * np.float32(ROUGHNESSES - 1)
    x = min(max(cosine * np.float32(COSINES) - np.float32(0.5), _ZERO), np.float32(COSINES - 1))
    j, i = min(int(y), ROUGHNESSES - 2), min(int(x), COSINES - 2)
    fy, fx = y - np.float32(j), x - np.float32(i)
    wd = fx * fy
    wb, wc = fx - wd, fy - wd
    wa = _ONE - fx - wc
    return (
        wa * table[j, i, 0] + wb * table[j, i + 1, 0] + wc * table[j + 1, i, 0] + wd * table[j + 1, i + 1, 0],
        wa * table[j, i, 1] + wb * table[j, i + 1, 1] + wc * table[j + 1, i, 1] + wd * table[j + 1, i + 1, 1],
    )


@inline
def schlick(f0: np.float32, cosine: np.float32) -> np.float32:
    """Fresnel reflectance at an angle to the normal (C. Schlick, Computer Graphics Forum 13(3), 1994)."""
    rest = _ONE - min(max(cosine, _ZERO), _ONE)
    square = rest * rest
    return f0 + (_ONE - f0) * square * square * rest


@inline
def lobe_normal(
    vx: np.float32,
    vy: np.float32,
    vz: np.float32,
    nx: np.float32,
    ny: np.float32,
    nz: np.float32,
    alpha: np.float32,
    t1: np.float32,
    t2: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:
    """A GGX normal about n that is visible from the unit direction v, for the point (t1, t2) of the unit disc."""
    # A frame about n (Duff et al., JCGT 6(1), 2017).
    sign = _ONE if nz >= _ZERO else -_ONE
    p = -_ONE / (sign + nz)
    q = nx * ny * p
    tx, ty, tz = _ONE + sign * nx * nx * p, sign * q, -sign * nx
    bx, by, bz = q, sign + ny * ny * p, -ny
    x, y = alpha * (vx * tx + vy * ty + vz * tz), alpha * (vx * bx + vy * by + vz * bz)
    z = max(vx * nx + vy * ny + vz * nz, np.float32(1e-3))
    scale = _ONE / np.float32(math.sqrt(x * x + y * y + z * z))
    x, y, z = x * scale, y * scale, z * scale
    flat = x * x + y * y
    c, s = _ONE, _ZERO
    if flat > _TINY:
        root = _ONE / np.float32(math.sqrt(flat))
        c, s = x * root, y * root
    half = np.float32(0.5) * (_ONE + z)
    t2 = (_ONE - half) * np.float32(math.sqrt(max(_ONE - t1 * t1, _ZERO))) + half * t2
    up = np.float32(math.sqrt(max(_ONE - t1 * t1 - t2 * t2, _ZERO)))
    lean = np.float32(math.sqrt(flat))
    # In the plane of v: (c, s) is its heading; T1 = (−s, c, 0), T2 = v × T1.
    ahead, aside, high = alpha * (lean * up - z * t2), alpha * t1, max(z * up + lean * t2, np.float32(1e-6))
    hx, hy = c * ahead - s * aside, s * ahead + c * aside
    scale = _ONE / np.float32(math.sqrt(hx * hx + hy * hy + high * high))
    hx, hy, high = hx * scale, hy * scale, high * scale
    return hx * tx + hy * bx + high * nx, hx * ty + hy * by + high * ny, hx * tz + hy * bz + high * nz
