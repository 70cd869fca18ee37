"""Direct light of area lights: emissive faces (windows, lamps), and patches of a surface that lie in the sun.

The light of an emitter on a texel is its unoccluded form factor, summed over fine cells without noise, times the
visible share of it, estimated with stratified shadow rays. Where an emitter is fully visible or fully hidden the
result therefore has no sampling noise at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.scenes.sampling import PATTERNS, net, square_points
from generators.scenes.scene import F32, I32
from generators.scenes.surfaces import Surfaces
from generators.vision.jit import njit

#: Cells per emitter for the unoccluded form factor.
CELLS = 256
#: Emissive faces that look the same way and are closer than this are one emitter (the panes of a window), metres.
_JOIN = 0.25
#: More emitters than this are not sampled: the strongest ones are kept.
_MOST = 96
#: A texel stands out if it reflects this many times the mean radiance.
BRIGHT = 5.0
#: Sides of the patches that bright surfaces are cut into, metres; how many at most, and their share of all power.
_PATCH = 1.0
_MOST_PATCHES = 48
_SHARE = 0.97
#: An emitter that could give less than this part of a texel's direct light gets fewer shadow rays.
_FAINT = 0.08
#: Exponent of the lobe round the normal that stands for the reflection of glossy materials.
LOBE = 6.0


@dataclass(frozen=True, eq=False)
class Emitters:
    """Area lights.

    Attributes:
        area: (L,) float32, square metres.
        centre: (L, 3) float32.
        radius: (L,) float32 of a ball round the centre that holds the emitter.
        cells: (L, 256, 9) float32: point, normal and radiance of equal pieces of the area.
        points: (L, 16, n, 9) float32: the same of shadow-ray targets per texel pattern.
    """

    area: F32
    centre: F32
    radius: F32
    cells: F32
    points: F32

    def __len__(self) -> int:
        return len(self.area)

    def joined(self, other: Emitters) -> Emitters:
        """Both sets, with equal numbers of targets."""
        names = ("area", "centre", "radius", "cells", "points")
        return Emitters(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


def face_areas(triangles: F32) -> NDArray[np.float64]:
    edges = triangles.astype(np.float64)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) / 2)


def face_groups(surfaces: Surfaces, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which emitter each emissive face belongs to."""
    corners = np.round(surfaces.triangles[faces].reshape(-1, 3).astype(np.float64) * 1e4).astype(np.int64)
    _, vertex = np.unique(corners, axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    edges = np.concatenate([vertex[:, :2], vertex[:, 1:]])
    size = int(vertex.max()) + 1
    graph = coo_matrix((np.ones(len(edges), dtype=np.int8), (edges[:, 0], edges[:, 1])), shape=(size, size))
    piece = connected_components(graph, directed=False)[1][vertex[:, 0]]
    count = int(piece.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, piece, surfaces.triangles[faces].min(axis=1))
    np.maximum.at(high, piece, surfaces.triangles[faces].max(axis=1))
    normal = np.zeros((count, 3))
    np.add.at(normal, piece, surfaces.face_normal[faces])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.maximum(length, 1e-9)
    near = np.all((low[:, None] - _JOIN < high[None]) & (low[None] - _JOIN < high[:, None]), axis=2)
    near &= normal @ normal.T > 0.9
    joined = connected_components(coo_matrix(near), directed=False)[1]
    return np.asarray(joined[piece], dtype=np.int64)


def _spread(surfaces: Surfaces, faces: NDArray[np.int64], points: NDArray[np.float64]) -> F32:
    """Points (N, 9: position, normal, radiance) on ``faces``, evenly by area, from points (N, 2) in the unit square."""
    triangles = surfaces.triangles[faces]
    share = np.cumsum(face_areas(triangles))
    total = share[-1]
    target = points[:, 0] * total
    pick = np.minimum(np.searchsorted(share, target, side="right"), len(share) - 1)
    before = np.concatenate([[0.0], share])[pick]
    a = np.clip((target - before) / np.maximum(share[pick] - before, 1e-12), 0.0, 1.0)
    b = points[:, 1]
    root = np.sqrt(a)
    corner = triangles[pick].astype(np.float64)
    position = (
        corner[:, 0] * (1 - root)[:, None]
        + corner[:, 1] * (root * (1 - b))[:, None]
        + corner[:, 2] * (root * b)[:, None]
    )
    picked = faces[pick]
    radiance = surfaces.emission[surfaces.material[picked]]
    return np.concatenate([position, surfaces.face_normal[picked], radiance], axis=1).astype(np.float32)


def find_emitters(surfaces: Surfaces, samples: int) -> Emitters:
    """The area lights among ``surfaces``, with ``samples`` shadow-ray targets per texel and emitter."""
    glowing = surfaces.emission[surfaces.material].max(axis=1) > 0
    area = face_areas(surfaces.triangles)
    faces = np.flatnonzero(glowing & (area > 1e-9))
    group = face_groups(surfaces, faces) if len(faces) else np.zeros(0, dtype=np.int64)
    members = [faces[group == g] for g in range(int(group.max()) + 1)] if len(faces) else []
    power = [float(area[m] @ surfaces.emission[surfaces.material[m]].sum(axis=1)) for m in members]
    kept = [members[k] for k in sorted(np.argsort(-np.array(power), kind="stable")[:_MOST].tolist())]
    fine = net(CELLS)
    coarse = square_points(samples, (0x9E3779B9, 0x3C6EF372)).reshape(-1, 2).astype(np.float64)
    cells, points = [], []
    for m in kept:
        cells.append(_spread(surfaces, m, fine))
        points.append(_spread(surfaces, m, coarse).reshape(PATTERNS, samples, 9))
    flat = [surfaces.triangles[m].reshape(-1, 3) for m in kept]
    centres = [(f.min(axis=0) + f.max(axis=0)) / 2 for f in flat]
    return Emitters(
        area=np.array([area[m].sum() for m in kept], dtype=np.float32),
        centre=np.array(centres, dtype=np.float32).reshape(-1, 3),
        radius=np.array(
            [np.linalg.norm(f - c, axis=1).max() for f, c in zip(flat, centres, strict=True)], dtype=np.float32
        ),
        cells=np.array(cells, dtype=np.float32).reshape(-1, CELLS, 9),
        points=np.array(points, dtype=np.float32).reshape(-1, PATTERNS, samples, 9),
    )


def bright_patches(
    position: F32, normal: F32, area: F32, radiance: F32, samples: int
) -> tuple[Emitters, NDArray[np.bool_]]:
    """Turn bright texels into emitters, so that what they light is sampled with shadow rays.

    A patch of sun on a floor is small and bright: found by chance, by rays all over the hemisphere, it makes blotches.

    Args:
        position: (N, 3) of the bright texels.
        normal: (N, 3).
        area: (N,) square metres that each stands for.
        radiance: (N, 3) reflected radiance.
        samples: shadow-ray targets per texel and emitter.

    Returns:
        One emitter per patch of about 1 m, and (N,) which texels are in one; the dimmest patches are left out.
    """
    used = np.zeros(len(position), dtype=bool)
    if not len(position):
        return _emitters([], [], [], samples), used
    voxel = np.floor(position / _PATCH).astype(np.int64)
    axis = np.argmax(np.abs(normal), axis=1)
    facing = axis * 2 + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)
    _, patch = np.unique(np.column_stack([voxel, facing]), axis=0, return_inverse=True)
    patch = patch.reshape(-1)
    power = np.bincount(patch, weights=area * radiance.sum(axis=1))
    order = np.argsort(-power, kind="stable")
    enough = np.searchsorted(np.cumsum(power[order]), _SHARE * power.sum()) + 1
    chosen = np.sort(order[: min(int(enough), _MOST_PATCHES)])
    shares, areas, points = [], [], []
    for number in chosen:
        member = np.flatnonzero(patch == number)
        used[member] = True
        member = member[np.argsort(_morton(position[member]), kind="stable")]
        cumulated = np.cumsum(area[member].astype(np.float64))
        shares.append(cumulated / max(cumulated[-1], 1e-12))
        areas.append(float(cumulated[-1]))
        points.append(np.concatenate([position[member], normal[member], radiance[member]], axis=1))
    return _emitters(shares, areas, points, samples), used


def _morton(position: F32) -> NDArray[np.int64]:
    """Order along a space-filling curve, by centimetres."""
    grid = np.floor((position - position.min(axis=0)) * 100.0).astype(np.int64)
    code = np.zeros(len(position), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((grid[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _emitters(shares: list[NDArray[np.float64]], areas: list[float], points: list[F32], samples: int) -> Emitters:
    """Emitters of points: ``shares`` are cumulated areas that end at 1, ``points`` (n, 9) position, normal, radiance."""
    fine = net(CELLS)[:, 0]
    coarse = square_points(samples, (0x1B56C4E9, 0x7F4A7C15))[..., 0].astype(np.float64)
    count = len(shares)
    cells = np.zeros((count, CELLS, 9), dtype=np.float32)
    targets = np.zeros((count, PATTERNS, samples, 9), dtype=np.float32)
    centre, radius = np.zeros((count, 3), dtype=np.float32), np.zeros(count, dtype=np.float32)
    for k, (share, own) in enumerate(zip(shares, points, strict=True)):
        cells[k] = own[np.minimum(np.searchsorted(share, fine), len(own) - 1)]
        targets[k] = own[np.minimum(np.searchsorted(share, coarse), len(own) - 1)]
        centre[k] = (own[:, :3].min(axis=0) + own[:, :3].max(axis=0)) / 2
        radius[k] = np.linalg.norm(own[:, :3] - centre[k], axis=1).max()
    return Emitters(np.array(areas, dtype=np.float32), centre, radius, cells, targets)


@njit
def _unoccluded(texel, light, position, normal, gloss, area, centre, radius, cells, factor):  # type: ignore[no-untyped-def]
    """Unoccluded light of pairs (texel, light); point-to-disc formula per cell (Wallace et al. 1989, eq. 7)."""
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
        factor[i, 0] = factor[i, 1] = factor[i, 2] = 0.0
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
                cosine = (1.0 - g) * cosine + g * (LOBE + 1.0) / 2.0 * cosine**LOBE
            for c in range(3):
                factor[i, c] += solid * cosine * cells[e, k, 6 + c]


@njit
def _shadow_rays(texel, light, pattern, position, normal, points, first, last, origins, directions, far, weight):  # type: ignore[no-untyped-def]
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
    samples = emitters.points.shape[2]
    # What adds little is worth few rays; the first quarter of the targets is stratified in itself.
    for pairs, rays in ((share >= _FAINT, samples), ((share < _FAINT) & (share > 0), max(samples // 4, 1))):
        own, lamp, bare = texel[pairs], light[pairs], factor[pairs]
        origins, directions, far, weight = shadow_rays(emitters, own, lamp, pattern, position, normal, 0, rays)
        weight = weight.reshape(-1, rays)
        free = ~hidden(origins, directions, far).reshape(-1, rays)
        visible = (weight * free).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-30)
        for channel in range(3):
            arrived[:, channel] += np.bincount(own, bare[:, channel] * visible, minlength=len(position))
        spread = bare.mean(axis=1) ** 2 * visible * (1 - visible) / rays
        variance += np.bincount(own, spread, minlength=len(position)).astype(np.float32)
    return arrived, variance
