"""Small flats as triangle soups whose truth is known: walls, floors, ceilings, doors, a few boxes for furniture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.acoustic_twin import box_faces
from tests.support.scan_like import mesh_glb

Array = NDArray[np.float64]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]

HEIGHT, WALL, DOOR = 2.5, 0.12, (0.8, 2.05)
#: Insides of three rooms around one corner, living room, kitchen and bathroom by their size.
ROOMS: dict[str, Box] = {
    "living_room": ((0.0, 0.0, 0.0), (5.0, HEIGHT, 4.0)),
    "kitchen": ((5.12, 0.0, 0.0), (8.12, HEIGHT, 4.0)),
    "bathroom": ((0.0, 0.0, 4.12), (2.6, HEIGHT, 6.12)),
}
#: A table, a worktop and a wardrobe that ends below the ceiling.
FURNITURE: tuple[Box, ...] = (
    ((1.5, 0.0, 1.2), (2.7, 0.55, 1.9)),
    ((5.12, 0.0, 0.0), (5.72, 0.9, 2.4)),
    ((4.3, 0.0, 2.2), (5.0, 2.05, 3.6)),
    ((0.0, 0.0, 5.5), (0.6, 0.85, 6.12)),
)


def quad(corner: Sequence[float], u: Sequence[float], v: Sequence[float], edge: float = 0.12) -> Array:
    """(F, 3, 3) triangles of a rectangle with sides ``u`` and ``v``, normal u × v, no edge longer than ``edge``."""
    a, b, c = (np.asarray(one, dtype=np.float64) for one in (corner, u, v))
    n, m = (max(1, int(np.ceil(np.linalg.norm(side) / edge))) for side in (b, c))
    i, j = (g.reshape(-1, 1) for g in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    p, q, r, s = (a + (i + di) / n * b + (j + dj) / m * c for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.concatenate([np.stack([p, q, r], axis=1), np.stack([p, r, s], axis=1)])


def shell(box: Box, *, ceiling: bool = True) -> Array:
    """The inside of a room: its faces look into it."""
    (x0, y0, z0), (x1, y1, z1) = box
    w, h, d = x1 - x0, y1 - y0, z1 - z0
    faces = [
        quad((x0, y0, z0), (0, 0, d), (w, 0, 0)),
        quad((x0, y0, z0), (w, 0, 0), (0, h, 0)),
        quad((x0, y0, z0), (0, h, 0), (0, 0, d)),
        quad((x0, y0, z1), (0, h, 0), (w, 0, 0)),
        quad((x1, y0, z0), (0, 0, d), (0, h, 0)),
    ]
    return np.concatenate([*faces, quad((x0, y1, z0), (w, 0, 0), (0, 0, d))] if ceiling else faces)


def solid(box: Box) -> Array:
    """A box seen from outside."""
    low, high = np.asarray(box[0]), np.asarray(box[1])
    corners = box_faces(low, high)
    out = []
    for a, b, c in corners[::2]:
        out.append(quad(a, b - a, c - b, 0.1))
    return np.concatenate(out)


def without_door(triangles: Array, low: Sequence[float], high: Sequence[float]) -> Array:
    """The triangles whose middle is outside a box."""
    middle = triangles.mean(axis=1)
    return triangles[~((middle > np.asarray(low)) & (middle < np.asarray(high))).all(axis=1)]


def flat(rooms: Sequence[str] = tuple(ROOMS), *, ceiling: bool = True, rng: Generator | None = None) -> Array:
    """(F, 3, 3) triangles of some of `ROOMS` with doors between them; ``rng``: noise of 3 mm on every vertex."""
    pieces = [shell(ROOMS[name], ceiling=ceiling) for name in rooms]
    inside = [box for box in FURNITURE if any(_within(box, ROOMS[name]) for name in rooms)]
    whole = np.concatenate(pieces)
    whole = without_door(whole, (4.9, -0.1, 1.0), (5.3, DOOR[1], 1.0 + DOOR[0]))
    whole = without_door(whole, (1.2, -0.1, 3.9), (1.2 + DOOR[0], DOOR[1], 4.2))
    whole = np.concatenate([whole, *(solid(box) for box in inside)])
    if rng is None:
        return whole
    keys, vertex = np.unique(np.round(whole.reshape(-1, 3) * 1e4).astype(np.int64), axis=0, return_inverse=True)
    return (keys / 1e4 + rng.normal(0.0, 0.003, keys.shape))[vertex.reshape(-1)].reshape(-1, 3, 3)


def _within(box: Box, room: Box) -> bool:
    middle = (np.asarray(box[0]) + np.asarray(box[1])) / 2
    return bool((middle > np.asarray(room[0])).all() and (middle < np.asarray(room[1])).all())


def write_mesh(triangles: Array, path: Path, *, coloured: bool = True) -> Path:
    """A GLB with a colour at every vertex, or without any."""
    vertices = triangles.reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    stripes = (np.floor(vertices * 4).astype(np.int64).sum(axis=1) % 3 * 40 + 120).astype(np.uint8)
    colours = np.stack([stripes, stripes, np.full_like(stripes, 140)], axis=1)
    path.write_bytes(mesh_glb(vertices, faces, colours=colours if coloured else None))
    return path
