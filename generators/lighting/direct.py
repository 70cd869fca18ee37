"""Direct light of emitters on texels.

The light of an emitter on a texel is its unoccluded form factor, in closed form or summed over fine cells, times the
visible share of it, estimated with stratified shadow rays. Where an emitter is fully visible or fully hidden the
result therefore has no sampling noise at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.scene import F32, I32
from generators.lighting.emitters import Emitters

#: An emitter that could give less than this part of a texel's direct light gets fewer shadow rays.
_FAINT = 0.08
#: The closed form is used up to this many radii from an emitter of at most this many faces.
_NEAR = 4.0
_FEW = 128
#: Exponent of the lobe round the normal that stands for the reflection of glossy materials.
LOBE = 6.0


@inline
def _polygon(x: Any, y: Any, z: Any, nx: Any, ny: Any, nz: Any, face: Any, corners: Any) -> Any:
    """Form factor from a point to the front of a triangle, cut off at the horizon (Lambert 1760).

    ``corners`` (5, 3) is working memory.
    """
    ax, ay, az = face[0, 0] - x, face[0, 1] - y, face[0, 2] - z
    e1x, e1y, e1z = face[1, 0] - face[0, 0], face[1, 1] - face[0, 1], face[1, 2] - face[0, 2]
    e2x, e2y, e2z = face[2, 0] - face[0, 0], face[2, 1] - face[0, 1], face[2, 2] - face[0, 2]
    side = ax * (e1y * e2z - e1z * e2y) + ay * (e1z * e2x - e1x * e2z) + az * (e1x * e2y - e1y * e2x)
    if side >= 0.0:
        return 0.0
    count = 0
    for k in range(3):
        j = (k + 1) % 3
        px, py, pz = face[k, 0] - x, face[k, 1] - y, face[k, 2] - z
        qx, qy, qz = face[j, 0] - x, face[j, 1] - y, face[j, 2] - z
        p, q = px * nx + py * ny + pz * nz, qx * nx + qy * ny + qz * nz
        if p > 0.0:
            corners[count, 0], corners[count, 1], corners[count, 2] = px, py, pz
            count += 1
        if p * q < 0.0:
            t = p / (p - q)
            corners[count, 0] = px + t * (qx - px)
            corners[count, 1] = py + t * (qy - py)
            corners[count, 2] = pz + t * (qz - pz)
            count += 1
    total = 0.0
    for k in range(count):
        j = (k + 1) % count
        px, py, pz = corners[k, 0], corners[k, 1], corners[k, 2]
        qx, qy, qz = corners[j, 0], corners[j, 1], corners[j, 2]
        cx, cy, cz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        sine = np.sqrt(cx * cx + cy * cy + cz * cz)
        if sine > 1e-12:
            total += np.arctan2(sine, px * qx + py * qy + pz * qz) * (cx * nx + cy * ny + cz * nz) / sine
    # Seen from its front the corners run clockwise about the normal.
    return max(-total / (2.0 * np.pi), 0.0)


@njit
def _unoccluded(
    texel: Any,
    light: Any,
    position: Any,
    normal: Any,
    gloss: Any,
    area: Any,
    centre: Any,
    radius: Any,
    cells: Any,
    faces: Any,
    glow: Any,
    start: Any,
    factor: Any,
) -> Any:
    """Unoccluded light of pairs (texel, light).

    Near an emitter of few faces: Lambert's polygon formula; else the point-to-disc formula per cell (Wallace et al.
    1989, eq. 7), which is wrong near large cells.
    """
    corners = np.empty((5, 3))
    for i in range(len(texel)):
        t, e = texel[i], light[i]
        x, y, z = position[t, 0], position[t, 1], position[t, 2]
        nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
        far = np.sqrt((centre[e, 0] - x) ** 2 + (centre[e, 1] - y) ** 2 + (centre[e, 2] - z) ** 2)
        number = cells.shape[1]
        if far > 4.0 * radius[e]:
            number //= 16
        elif far > 2.0 * radius[e]:
            number //= 4
        piece = area[e] / number
        g = gloss[t]
        matte = 1.0 - g
        factor[i, 0] = factor[i, 1] = factor[i, 2] = 0.0
        if far < _NEAR * radius[e] and 0 < start[e + 1] - start[e] <= _FEW:
            for f in range(start[e], start[e + 1]):
                share = matte * _polygon(x, y, z, nx, ny, nz, faces[f], corners)
                for c in range(3):
                    factor[i, c] += share * glow[f, c]
            matte = 0.0
            if g == 0.0:
                continue
        for k in range(number):
            dx, dy, dz = cells[e, k, 0] - x, cells[e, k, 1] - y, cells[e, k, 2] - z
            here = dx * nx + dy * ny + dz * nz
            there = -(dx * cells[e, k, 3] + dy * cells[e, k, 4] + dz * cells[e, k, 5])
            if here <= 0.0 or there <= 0.0:
                continue
            square = dx * dx + dy * dy + dz * dz
            cosine = here / np.sqrt(square)
            solid = there / np.sqrt(square) * piece / (np.pi * square + piece)
            if g > 0.0:
                cosine = matte * cosine + g * (LOBE + 1.0) / 2.0 * cosine**LOBE
            for c in range(3):
                factor[i, c] += solid * cosine * cells[e, k, 6 + c]


@njit
def _shadow_rays(
    texel: Any,
    light: Any,
    pattern: Any,
    position: Any,
    normal: Any,
    points: Any,
    first: Any,
    last: Any,
    origins: Any,
    directions: Any,
    far: Any,
    weight: Any,
) -> Any:
    row = 0
    for i in range(len(texel)):
        t, e = texel[i], light[i]
        p = pattern[t]
        for k in range(first, last):
            here = there = square = 0.0
            for c in range(3):
                d = points[e, p, k, c] - position[t, c]
                origins[row, c] = position[t, c]
                directions[row, c] = d
                here += d * normal[t, c]
                there -= d * points[e, p, k, 3 + c]
                square += d * d
            if here > 0.0 and there > 0.0:
                glow = points[e, p, k, 6] + points[e, p, k, 7] + points[e, p, k, 8]
                weight[row] = glow * here * there / (square * (square + 1e-4))
                # The ray ends 2 mm before the emitter, which would stop it.
                far[row] = max(1.0 - 0.002 / np.sqrt(square), 0.5)
            else:
                weight[row] = 0.0
                far[row] = 0.0
            row += 1


def shadow_rays(
    emitters: Emitters,
    texel: NDArray[np.int64],
    light: NDArray[np.int64],
    pattern: I32,
    position: F32,
    normal: F32,
    first: int,
    last: int,
) -> tuple[F32, F32, F32, F32]:
    """Rays from texels to emitters: origins, directions (to the target), far limits, weights; last − first per pair."""
    count = len(texel) * (last - first)
    origins, directions = np.empty((count, 3), dtype=np.float32), np.empty((count, 3), dtype=np.float32)
    far, weight = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    _shadow_rays(
        texel, light, pattern, position, normal, emitters.points, first, last, origins, directions, far, weight
    )
    return origins, directions, far, weight


def unoccluded_light(
    emitters: Emitters, texel: NDArray[np.int64], light: NDArray[np.int64], position: F32, normal: F32, gloss: F32
) -> F32:
    """(pairs, 3) float32 light of an emitter on a white surface if nothing hid it."""
    factor = np.zeros((len(texel), 3), dtype=np.float32)
    _unoccluded(
        texel,
        light,
        position,
        normal,
        gloss,
        emitters.area,
        emitters.centre,
        emitters.radius,
        emitters.cells,
        emitters.faces,
        emitters.glow,
        emitters.start,
        factor,
    )
    return factor


#: Says for N rays (origins, directions, far) which of them meet something.
Occlusion = Callable[[F32, F32, F32], NDArray[np.bool_]]


def direct_light(
    emitters: Emitters,
    reach: NDArray[np.bool_],
    pattern: I32,
    position: F32,
    normal: F32,
    gloss: F32,
    hidden: Occlusion,
    besides: F32 | None = None,
    rays: int | None = None,
) -> tuple[F32, F32]:
    """Light of all emitters on some texels.

    Args:
        emitters: the lights.
        reach: (N, L) whether the emitter may be seen from the texel.
        pattern: (N,) int32.
        position: (N, 3).
        normal: (N, 3).
        gloss: (N,).
        hidden: says which of a number of rays do not count.
        besides: (N, 3) light from elsewhere, against which an emitter may be faint.
        rays: shadow rays per texel and emitter; as many as the emitters have targets if missing.

    Returns:
        (N, 3) light and (N,) the variance of its luminance.
    """
    texel, light = np.nonzero(reach)
    factor = unoccluded_light(emitters, texel, light, position, normal, gloss)
    strength = factor.max(axis=1, initial=0.0)
    arrived = np.zeros((len(position), 3), dtype=np.float32)
    variance = np.zeros(len(position), dtype=np.float32)
    if not len(texel):
        return arrived, variance
    total = np.bincount(texel, strength, minlength=len(position))
    if besides is not None:
        total += besides.max(axis=1)
    share = strength / np.maximum(total, 1e-20)[texel]
    samples = emitters.points.shape[2] if rays is None else rays
    # What adds little is worth few rays; the first quarter of the targets is stratified in itself.
    for pairs, number in ((share >= _FAINT, samples), ((share < _FAINT) & (share > 0), max(samples // 4, 1))):
        own, lamp, bare = texel[pairs], light[pairs], factor[pairs]
        origins, directions, far, weight = shadow_rays(emitters, own, lamp, pattern, position, normal, 0, number)
        weight = weight.reshape(-1, number)
        free = ~hidden(origins, directions, far).reshape(-1, number)
        whole = weight.sum(axis=1)
        # An emitter of which only a sliver looks over the horizon may have no target there: it counts as visible.
        visible = np.where(whole > 0, (weight * free).sum(axis=1) / np.maximum(whole, 1e-30), 1.0)
        for channel in range(3):
            arrived[:, channel] += np.bincount(own, bare[:, channel] * visible, minlength=len(position))
        # Unequal weights are worth fewer rays (Kish's effective sample size).
        worth = np.maximum(whole**2 / np.maximum((weight**2).sum(axis=1), 1e-30), 1.0)
        spread = bare.mean(axis=1) ** 2 * visible * (1 - visible) / worth
        variance += np.bincount(own, spread, minlength=len(position)).astype(np.float32)
    return arrived, variance
