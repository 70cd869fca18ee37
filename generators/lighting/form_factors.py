"""Unoccluded light of emitters: closed forms where an emitter is near and simple, else sums over its cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from generators.core.jit import inline, njit
from generators.core.scene import F32
from generators.lighting.emitters import Emitters

#: The closed form is used up to this many radii from an emitter of at most this many faces.
_NEAR = 2.0
_FEW = 128
#: Points that are computed together.
_LANES = 64


@inline
def _polygon(
    x: float, y: float, z: float, nx: float, ny: float, nz: float, face: F32, corners: NDArray[np.float64]
) -> float:
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


@inline
def _matte(
    lanes: tuple[F32, ...], count: int, cells: F32, number: int, piece: np.float32, red: F32, green: F32, blue: F32
) -> None:
    """Add the light of an emitter's first ``number`` cells to ``count`` matte points: disc formula per cell.

    ``lanes`` are six arrays: position and normal of the points. The loop over points is inside, without branches and
    in single precision, so that the compiler computes several points at once; each adds up its cells in order.
    """
    x, y, z, nx, ny, nz = lanes
    nothing, pi, tiny = np.float32(0.0), np.float32(np.pi), np.float32(1e-20)
    for k in range(number):
        cx, cy, cz = cells[k, 0], cells[k, 1], cells[k, 2]
        mx, my, mz = cells[k, 3], cells[k, 4], cells[k, 5]
        glow_red, glow_green, glow_blue = cells[k, 6], cells[k, 7], cells[k, 8]
        for i in range(count):
            dx, dy, dz = cx - x[i], cy - y[i], cz - z[i]
            here = dx * nx[i] + dy * ny[i] + dz * nz[i]
            there = -(dx * mx + dy * my + dz * mz)
            here = here if here > nothing else nothing
            there = there if there > nothing else nothing
            square = dx * dx + dy * dy + dz * dz + tiny
            share = here * there * piece / (square * (pi * square + piece))
            red[i] += share * glow_red
            green[i] += share * glow_green
            blue[i] += share * glow_blue


@njit
def _unoccluded(
    texel: NDArray[np.int64],
    light: NDArray[np.int64],
    position: F32,
    normal: F32,
    area: F32,
    centre: F32,
    radius: F32,
    cells: F32,
    coarse: F32,
    balance: F32,
    faces: F32,
    glow: F32,
    start: NDArray[np.int64],
    factor: F32,
) -> None:
    """Unoccluded light of pairs (texel, light).

    Near an emitter of few faces: Lambert's polygon formula; else the point-to-disc formula per cell (Wallace et al.
    1989, eq. 7), which is wrong near large cells. Consecutive pairs of one emitter are computed together: fastest if
    the pairs are ordered by emitter.
    """
    corners = np.empty((5, 3))
    kind, chosen = np.empty(_LANES, dtype=np.int64), np.empty(_LANES, dtype=np.int64)
    x, y, z = np.empty(_LANES, dtype=np.float32), np.empty(_LANES, dtype=np.float32), np.empty(_LANES, dtype=np.float32)
    nx, ny, nz = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    red, green, blue = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    first = 0
    while first < len(texel):
        e = light[first]
        count = 1
        while first + count < len(texel) and count < _LANES and light[first + count] == e:
            count += 1
        few = 0 < start[e + 1] - start[e] <= _FEW
        wide = coarse[e]
        for i in range(count):
            t = texel[first + i]
            far = np.sqrt(
                (centre[e, 0] - position[t, 0]) ** 2
                + (centre[e, 1] - position[t, 1]) ** 2
                + (centre[e, 2] - position[t, 2]) ** 2
            )
            factor[first + i, 0] = factor[first + i, 1] = factor[first + i, 2] = 0.0
            kind[i] = 2 if far > 2.0 * wide else (1 if far > wide and not few else 0)
            if few and far < _NEAR * radius[e]:
                kind[i] += 4
                for f in range(start[e], start[e + 1]):
                    share = _polygon(
                        position[t, 0],
                        position[t, 1],
                        position[t, 2],
                        normal[t, 0],
                        normal[t, 1],
                        normal[t, 2],
                        faces[f],
                        corners,
                    )
                    for c in range(3):
                        factor[first + i, c] += share * glow[f, c]
        for level in range(3):
            number = 0
            for i in range(count):
                t = texel[first + i]
                if kind[i] == level:
                    chosen[number] = i
                    x[number], y[number], z[number] = position[t, 0], position[t, 1], position[t, 2]
                    nx[number], ny[number], nz[number] = normal[t, 0], normal[t, 1], normal[t, 2]
                    red[number] = green[number] = blue[number] = 0.0
                    number += 1
            if number == 0:
                continue
            parts = cells.shape[1] >> (2 * level)
            piece = np.float32(area[e] / parts)
            points = (x, y, z, nx, ny, nz)
            _matte(points, number, cells[e], parts, piece, red, green, blue)
            for k in range(number):
                i = chosen[k]
                factor[first + i, 0] += red[k] * balance[e, level, 0]
                factor[first + i, 1] += green[k] * balance[e, level, 1]
                factor[first + i, 2] += blue[k] * balance[e, level, 2]
        first += count


def unoccluded_light(
    emitters: Emitters, texel: NDArray[np.int64], light: NDArray[np.int64], position: F32, normal: F32
) -> F32:
    """(pairs, 3) float32 light of an emitter on a white surface if nothing hid it."""
    factor = np.zeros((len(texel), 3), dtype=np.float32)
    _unoccluded(
        texel,
        light,
        position,
        normal,
        emitters.area,
        emitters.centre,
        emitters.radius,
        emitters.cells,
        emitters.coarse,
        emitters.balance,
        emitters.faces,
        emitters.glow,
        emitters.start,
        factor,
    )
    return factor
