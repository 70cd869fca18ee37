"""Area lights: emissive faces (windows, lamps), and patches of a surface that lie in the sun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from generators.core.low_discrepancy import PATTERNS, net, square_points
from generators.core.scene import F32
from generators.lighting.surfaces import LitSurfaces

#: Cells per emitter for the unoccluded form factor.
CELLS = 256
#: Emissive faces that look the same way and are closer than this are one emitter (the panes of a window), metres.
_JOIN = 0.25
#: More emitters than this are not sampled: the strongest ones are kept.
_MOST = 96
#: A texel stands out if it reflects this many times the mean radiance.
BRIGHT = 5.0
#: An emitter whose mean normal is shorter than this shines to several sides.
_ONE_SIDED = 0.9
#: Sides of the patches that bright surfaces are cut into, metres, and the share of all power that they hold.
_PATCH = 1.0
_SHARE = 0.97


@dataclass(frozen=True, eq=False)
class Emitters:
    """Area lights.

    Attributes:
        area: (L,) float32, square metres.
        centre: (L, 3) float32.
        radius: (L,) float32 of a ball round the centre that holds the emitter.
        cells: (L, `CELLS`, 9) float32: point, normal and radiance of equal pieces of the area. The first quarter and
            the first sixteenth are spread over the emitter too.
        coarse: (L,) float32 distance (m) from its centre beyond which a quarter of its cells is enough, and a sixteenth
            beyond twice this distance. Infinite for lamps that shine to several sides: of their cells only those count
            that face a point, too few for a mean.
        balance: (L, 3, 3) float32: factors of the radiance (last axis: colours) with which all cells, their first
            quarter and their first sixteenth have the same mean.
        points: (L, 16, n, 9) float32: the same of shadow-ray targets per texel pattern.
        faces: (T, 3, 3) float32 triangles of the emitters that have any.
        glow: (T, 3) float32 their radiance.
        start: (L + 1,) int64, emitter l owns ``faces[start[l]:start[l + 1]]``.
    """

    area: F32
    centre: F32
    radius: F32
    cells: F32
    coarse: F32
    balance: F32
    points: F32
    faces: F32
    glow: F32
    start: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.area)

    def joined(self, other: Emitters) -> Emitters:
        """Both sets, with equal numbers of targets."""
        names = ("area", "centre", "radius", "cells", "coarse", "balance", "points", "faces", "glow")
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names}
        return Emitters(**arrays, start=np.concatenate([self.start, self.start[-1] + other.start[1:]]))


def _balance(cells: F32) -> F32:
    """`Emitters.balance` of ``cells``."""
    mean = cells[..., 6:].mean(axis=1, dtype=np.float64)
    levels = [cells[:, : CELLS >> (2 * level), 6:].mean(axis=1, dtype=np.float64) for level in range(3)]
    factors = [np.where(own > 0, mean / np.where(own > 0, own, 1.0), 1.0) for own in levels]
    return np.stack(factors, axis=1).astype(np.float32)


def face_areas(triangles: F32) -> NDArray[np.float64]:
    """(F,) areas of (F, 3, 3) triangles."""
    edges = triangles.astype(np.float64)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) / 2)


def face_groups(surfaces: LitSurfaces, faces: NDArray[np.int64]) -> NDArray[np.int64]:
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


def _tiles(triangles: F32) -> list[tuple[int, bool]]:
    """(first face, whether it and the next one are the halves of a parallelogram) of every tile of the faces."""
    a, b, c = triangles[:-1].astype(np.float64).transpose(1, 0, 2)
    d, e, f = triangles[1:].astype(np.float64).transpose(1, 0, 2)
    close = 1e-4 * (np.linalg.norm(c - a, axis=1) + 1e-9)
    pairs = np.all([np.linalg.norm(gap, axis=1) < close for gap in (d - a, e - c, a + c - b - f)], axis=0).tolist()
    pairs.append(False)
    tiles: list[tuple[int, bool]] = []
    face = 0
    while face < len(triangles):
        tiles.append((face, pairs[face]))
        face += 2 if pairs[face] else 1
    return tiles


def _spread(surfaces: LitSurfaces, faces: NDArray[np.int64], points: NDArray[np.float64]) -> F32:
    """Points (N, 9: position, normal, radiance) on ``faces``, evenly by area, from points (N, 2) in the unit square.

    The first coordinate runs through the tiles and, within a rectangle, along its shorter side; the second runs along
    its longer side. So the strips of a window's pane, one above the other, are sampled like one large rectangle, and
    points that are stratified in the unit square are stratified on the pane.
    """
    triangles = surfaces.triangles[faces]
    tiles = _tiles(triangles)
    first = np.array([tile[0] for tile in tiles])
    whole = np.array([tile[1] for tile in tiles])
    share = np.cumsum(face_areas(triangles[first]) * np.where(whole, 2.0, 1.0))
    target = points[:, 0] * share[-1]
    tile = np.minimum(np.searchsorted(share, target, side="right"), len(share) - 1)
    before = np.concatenate([[0.0], share])[tile]
    s = np.clip((target - before) / np.maximum(share[tile] - before, 1e-12), 0.0, 1.0)
    t = points[:, 1]
    pick = first[tile]
    a, b, c = (triangles[pick, k].astype(np.float64) for k in range(3))
    one, other = b - a, c - b
    longer = (np.linalg.norm(one, axis=1) >= np.linalg.norm(other, axis=1))[:, None]
    s, t = s[:, None], t[:, None]
    rectangle = a + np.where(longer, t, s) * one + np.where(longer, s, t) * other
    root = np.sqrt(s)
    triangle = a * (1 - root) + b * (root * (1 - t)) + c * (root * t)
    position = np.where(whole[tile][:, None], rectangle, triangle)
    picked = faces[pick]
    radiance = surfaces.emission[surfaces.material[picked]]
    return np.concatenate([position, surfaces.face_normal[picked], radiance], axis=1).astype(np.float32)


def find_emitters(surfaces: LitSurfaces, samples: int) -> Emitters:
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
    own = np.concatenate(kept) if kept else np.zeros(0, dtype=np.int64)
    fine_cells = np.array(cells, dtype=np.float32).reshape(-1, CELLS, 9)
    radius = np.array(
        [np.linalg.norm(f - c, axis=1).max() for f, c in zip(flat, centres, strict=True)], dtype=np.float32
    )
    facing = np.linalg.norm(fine_cells[..., 3:6].mean(axis=1, dtype=np.float64), axis=1)
    return Emitters(
        area=np.array([area[m].sum() for m in kept], dtype=np.float32),
        centre=np.array(centres, dtype=np.float32).reshape(-1, 3),
        radius=radius,
        cells=fine_cells,
        coarse=np.where(facing < _ONE_SIDED, np.inf, 2.0 * radius).astype(np.float32),
        balance=_balance(fine_cells),
        points=np.array(points, dtype=np.float32).reshape(-1, PATTERNS, samples, 9),
        faces=surfaces.triangles[own],
        glow=surfaces.emission[surfaces.material[own]],
        start=np.cumsum([0] + [len(m) for m in kept]).astype(np.int64),
    )


def bright_patches(
    position: F32,
    normal: F32,
    area: F32,
    radiance: F32,
    samples: int,
    *,
    importance: F32 | None = None,
    most: int = 48,
) -> tuple[Emitters, NDArray[np.bool_]]:
    """Turn bright texels into emitters, so that what they light is sampled with shadow rays.

    A patch of sun on a floor is small and bright: found by chance, by rays all over the hemisphere, it makes blotches.

    Args:
        position: (N, 3) of the bright texels.
        normal: (N, 3).
        area: (N,) square metres that each stands for.
        radiance: (N, 3) reflected radiance.
        samples: shadow-ray targets per texel and emitter.
        importance: (N,) factor of a texel's power when patches are chosen.
        most: how many patches at most.

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
    worth = area * radiance.sum(axis=1) * (1.0 if importance is None else importance)
    power = np.bincount(patch, weights=worth)
    order = np.argsort(-power, kind="stable")
    enough = np.searchsorted(np.cumsum(power[order]), _SHARE * power.sum()) + 1
    chosen = np.sort(order[: min(int(enough), most)])
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
    """Emitters of points: ``shares`` are cumulated areas that end at 1, ``points`` (n, 9) as `Emitters.cells`."""
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
    nothing = np.zeros((0, 3, 3), dtype=np.float32)
    start = np.zeros(count + 1, dtype=np.int64)
    return Emitters(
        area=np.array(areas, dtype=np.float32),
        centre=centre,
        radius=radius,
        cells=cells,
        coarse=radius,
        balance=_balance(cells),
        points=targets,
        faces=nothing,
        glow=nothing[:, 0],
        start=start,
    )
