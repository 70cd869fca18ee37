"""Direct light: emissive faces (windows, lamps) as area lights, and the sun's beam through the windows.

The light of an emitter on a texel is its unoccluded form factor, summed over fine cells without noise, times the
visible share of it, estimated with stratified shadow rays. Where an emitter is fully visible or fully hidden the
result therefore has no sampling noise at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.scenes.sampling import PATTERNS, net, square_points
from generators.scenes.scene import F32, I32
from generators.scenes.surfaces import Surfaces, Tracer
from generators.vision.jit import njit

#: Cells per emitter for the unoccluded form factor.
CELLS = 256
#: Emissive faces that look the same way and are closer than this are one emitter (the panes of a window), metres.
_JOIN = 0.25
#: More emitters than this are not sampled: the strongest ones are kept.
_MOST = 96
#: Exponent of the lobe round the normal that stands for the reflection of glossy materials.
LOBE = 6.0
#: Radiance of a white surface that faces the sun, over that of the brightest window pane.
_SUN_STRENGTH = 2.2
_SUN_COLOUR = np.array([1.0, 0.86, 0.68])
#: Radius of the sun's disc, radians: wider than the true 0.0047, so that a texel can resolve its soft edge.
_SUN_RADIUS = 0.012
#: Texels over which the sun's rays of one texel start: interpolation then shows no steps along the beam's edge.
_SUN_BLUR = 1.7
_LARGE_PANE = 0.3


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


@dataclass(frozen=True, eq=False)
class Sun:
    """A parallel beam that enters through window panes.

    Attributes:
        direction: (3,) float64 unit vector towards the sun.
        radiance: (3,) float32, reflected radiance of a white surface that faces the sun.
        pane: (F,) bool, the faces that let the beam in.
    """

    direction: NDArray[np.float64]
    radiance: F32
    pane: NDArray[np.bool_]


def _face_areas(triangles: F32) -> NDArray[np.float64]:
    edges = triangles.astype(np.float64)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) / 2)


def _groups(surfaces: Surfaces, faces: NDArray[np.int64]) -> NDArray[np.int64]:
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
    share = np.cumsum(_face_areas(triangles))
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
    area = _face_areas(surfaces.triangles)
    faces = np.flatnonzero(glowing & (area > 1e-9))
    group = _groups(surfaces, faces) if len(faces) else np.zeros(0, dtype=np.int64)
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


def _outside(surfaces: Surfaces, tracer: Tracer, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether nothing that looks towards the face lies behind it: a window, rather than a screen before a wall."""
    outward = np.ascontiguousarray(-surfaces.face_normal[faces])
    origin = surfaces.triangles[faces].mean(axis=1) + 0.005 * outward
    free = np.ones(len(faces), dtype=bool)
    ahead = np.arange(len(faces))
    for _ in range(8):
        hits = tracer.intersect(origin[ahead], outward[ahead])
        met = hits["primID"] >= 0
        ahead, face, distance = ahead[met], hits["primID"][met], hits["tfar"][met]
        facing = np.einsum("ij,ij->i", surfaces.face_normal[face], outward[ahead]) < 0
        free[ahead[facing]] = False
        origin[ahead] += (distance + 0.005)[:, None] * outward[ahead]
        ahead = ahead[~facing]
        if not len(ahead):
            break
    return free


def find_sun(name: str, surfaces: Surfaces, tracer: Tracer) -> Sun | None:
    """The sun of a flat: on one façade, its direction drawn from the scene's ``name``.

    A window is an upright emitter of glass, of 0.3 m² and more, with nothing of the scene behind it. The façade with the most
    glass gets the sun, at 28-42° above the horizon and 12-40° to a side, so that patches of light reach floor and walls.

    Returns:
        The sun, or None where the scene has no window.
    """
    area = _face_areas(surfaces.triangles)
    glowing = surfaces.emission[surfaces.material].max(axis=1) > 0
    faces = np.flatnonzero(glowing & surfaces.glass[surfaces.material] & (np.abs(surfaces.face_normal[:, 1]) < 0.1) & (area > 1e-6))
    if not len(faces):
        return None
    faces = faces[_outside(surfaces, tracer, faces)]
    if not len(faces):
        return None
    group = _groups(surfaces, faces)
    faces = faces[np.bincount(group, weights=area[faces])[group] >= _LARGE_PANE]
    if not len(faces):
        return None
    heading = np.arctan2(-surfaces.face_normal[faces, 0], -surfaces.face_normal[faces, 2])
    quarter = np.round(heading / (np.pi / 2)).astype(int) % 4
    glass = np.bincount(quarter, weights=area[faces], minlength=4)
    side = float(np.argmax(np.round(glass, 3)) * np.pi / 2)
    digest = hashlib.sha256(f"sun of {name}".encode()).digest()
    turn, lift = (int.from_bytes(digest[k : k + 4], "little") / 2**32 for k in (0, 4))
    sign = 1.0 if digest[8] & 1 else -1.0
    azimuth = side + sign * np.radians(12.0 + 28.0 * turn)
    height = np.radians(28.0 + 14.0 * lift)
    direction = np.array([np.cos(height) * np.sin(azimuth), np.sin(height), np.cos(height) * np.cos(azimuth)])
    brightest = float(surfaces.emission[surfaces.material[faces]].max())
    pane = np.zeros(len(area), dtype=bool)
    pane[faces] = True
    return Sun(direction=direction, radiance=(_SUN_STRENGTH * brightest * _SUN_COLOUR).astype(np.float32), pane=pane)


@njit
def _unoccluded(texel, light, position, normal, gloss, area, centre, radius, cells, factor):  # type: ignore[no-untyped-def]
    """Unoccluded light of pairs (texel, light); point-to-disc formula per cell (Wallace et al. 1989, eq. 7)."""
    for i in range(len(texel)):
        t, e = texel[i], light[i]
        x, y, z = position[t, 0], position[t, 1], position[t, 2]
        nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
        far = np.sqrt((centre[e, 0] - x) ** 2 + (centre[e, 1] - y) ** 2 + (centre[e, 2] - z) ** 2)
        number = cells.shape[1] if far < 3.0 * radius[e] else cells.shape[1] // 4
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

    Returns:
        (N, 3) light and (N,) the variance of its luminance.
    """
    texel, light = np.nonzero(reach)
    factor = unoccluded_light(emitters, texel, light, position, normal, gloss)
    useful = factor.max(axis=1, initial=0.0) > 0
    texel, light, factor = texel[useful], light[useful], factor[useful]
    samples = emitters.points.shape[2]
    arrived = np.zeros((len(position), 3), dtype=np.float32)
    variance = np.zeros(len(position), dtype=np.float32)
    if not len(texel):
        return arrived, variance
    origins, directions, far, weight = shadow_rays(emitters, texel, light, pattern, position, normal, 0, samples)
    weight = weight.reshape(-1, samples)
    free = ~hidden(origins, directions, far).reshape(-1, samples)
    visible = (weight * free).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-30)
    for channel in range(3):
        arrived[:, channel] = np.bincount(texel, factor[:, channel] * visible, minlength=len(position))
    spread = factor.mean(axis=1) ** 2 * visible * (1 - visible) / samples
    variance[:] = np.bincount(texel, spread, minlength=len(position))
    return arrived, variance


@njit
def _sun_rays(pattern, position, normal, across, direction, side, top, disc, jitter, origins, directions):  # type: ignore[no-untyped-def]
    count = disc.shape[1]
    for i in range(len(position)):
        p = pattern[i]
        for k in range(count):
            row = i * count + k
            a, b = _SUN_BLUR * (jitter[p, k, 0] - 0.5), _SUN_BLUR * (jitter[p, k, 1] - 0.5)
            for c in range(3):
                origins[row, c] = position[i, c] + a * across[i, 0, c] + b * across[i, 1, c]
                directions[row, c] = direction[c] + disc[p, k, 0] * side[c] + disc[p, k, 1] * top[c]


def sun_light(
    sun: Sun,
    pattern: I32,
    position: F32,
    normal: F32,
    across: F32,
    gloss: F32,
    tracer: Tracer,
    samples: int,
    *,
    objects: Tracer | None = None,
    lost: bool = False,
) -> F32:
    """Light (N, 3) of the sun: the share of rays to it that leave through a window pane.

    Args:
        sun: the sun; ``sun.pane`` refers to the faces of ``tracer``.
        pattern: (N,) int32.
        position: (N, 3) float32.
        normal: (N, 3) float32.
        across: (N, 2, 3) float32; the rays start all over the texel.
        gloss: (N,) float32.
        tracer: the room.
        samples: rays per texel.
        objects: things that are in the way besides.
        lost: return the light that ``objects`` take away instead of what arrives.
    """
    light = np.zeros((len(position), 3), dtype=np.float32)
    cosine = normal @ sun.direction.astype(np.float32)
    facing = np.flatnonzero(cosine > 1e-3)
    if not len(facing):
        return light
    side = np.cross(sun.direction, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    top = np.cross(side, sun.direction)
    square = net(PATTERNS * samples, (0x7F4A7C15, 0x94D049BB))
    radius = _SUN_RADIUS * np.sqrt(square[:, 0])
    disc = np.stack([radius * np.cos(2 * np.pi * square[:, 1]), radius * np.sin(2 * np.pi * square[:, 1])], axis=1)
    origins, directions = (np.empty((len(facing) * samples, 3), dtype=np.float32) for _ in range(2))
    _sun_rays(
        pattern[facing],
        position[facing],
        normal[facing],
        across[facing],
        sun.direction,
        side,
        top,
        disc.reshape(PATTERNS, samples, 2),
        square_points(samples, (0xBF58476D, 0x1CE4E5B9)),
        origins,
        directions,
    )
    rays = np.arange(len(origins))
    if objects is not None:
        blocked = objects.occluded(origins, directions, np.full(len(origins), 1e4, dtype=np.float32))
        rays = np.flatnonzero(blocked == lost)
    found = tracer.intersect(origins[rays], directions[rays])["primID"]
    lit = np.zeros(len(origins), dtype=bool)
    lit[rays] = (found >= 0) & sun.pane[np.maximum(found, 0)]
    share = lit.reshape(-1, samples).mean(axis=1, dtype=np.float64)
    g, c = gloss[facing], cosine[facing]
    light[facing] = (share * ((1 - g) * c + g * (LOBE + 1) / 2 * c**LOBE))[:, None] * sun.radiance
    return light
