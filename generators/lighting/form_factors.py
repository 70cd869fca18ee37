"""Unoccluded light of emitters: closed forms where an emitter is near and simple, else sums over its cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.scene import F32
from generators.lighting.emitters import Emitters

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
    balance: Any,
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
        # Cells of a patch all face about the same way: fewer are enough than of a lamp.
        wide = radius[e] if start[e + 1] == start[e] else 2.0 * radius[e]
        level = 0
        if far > 2.0 * wide:
            level = 2
        elif far > wide:
            level = 1
        number = cells.shape[1] >> (2 * level)
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
        red = green = blue = 0.0
        for k in range(number):
            dx, dy, dz = cells[e, k, 0] - x, cells[e, k, 1] - y, cells[e, k, 2] - z
            here = dx * nx + dy * ny + dz * nz
            there = -(dx * cells[e, k, 3] + dy * cells[e, k, 4] + dz * cells[e, k, 5])
            if here <= 0.0 or there <= 0.0:
                continue
            square = dx * dx + dy * dy + dz * dz
            share = matte * here * there * piece / (square * (np.pi * square + piece))
            if g > 0.0:
                lean = here * here / square  # cos², of which LOBE needs the third power
                solid = there * piece / (np.sqrt(square) * (np.pi * square + piece))
                share += g * (LOBE + 1.0) / 2.0 * lean * lean * lean * solid
            red += share * cells[e, k, 6]
            green += share * cells[e, k, 7]
            blue += share * cells[e, k, 8]
        factor[i, 0] += red * balance[e, level, 0]
        factor[i, 1] += green * balance[e, level, 1]
        factor[i, 2] += blue * balance[e, level, 2]


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
        emitters.balance,
        emitters.faces,
        emitters.glow,
        emitters.start,
        factor,
    )
    return factor
