"""Plain geometry of models: faces of grids and skins, outlines, loops for lofts, paths. Lengths in metres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Housing of enamelled sheet steel: radius of its edges along z, and of the edges of its front (m).
EDGE, BEVEL = 0.012, 0.008


def _chamfered_cube() -> tuple[Array, Array, NDArray[np.int64], Array]:
    """Topology of a box with chamfered edges: signs (24, 3), in-face mask (24, 3), faces (44, 3), normals (24, 3).

    Each corner has one vertex per adjacent face, and that face's normal; the chamfers between them so shade as
    rounded edges at 44 triangles a box.
    """
    corners = [(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    signs = np.array([c for c in corners for _ in range(3)])
    axes = np.tile(np.arange(3), 8)
    inset = np.ones((24, 3))
    inset[np.arange(24), axes] = 0.0
    normals = np.zeros((24, 3))
    normals[np.arange(24), axes] = signs[np.arange(24), axes]
    at = {(c, a): 3 * k + a for k, c in enumerate(corners) for a in range(3)}
    polygons: list[list[int]] = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for s in (-1.0, 1.0):
            loop = []
            for p, q in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
                corner = [0.0, 0.0, 0.0]
                corner[a], corner[b], corner[c] = s, p, q
                loop.append(at[(corner[0], corner[1], corner[2]), a])
            polygons.append(loop)
            for t in (-1.0, 1.0):
                lo, hi = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
                lo[a], lo[b], lo[c] = s, t, -1.0
                hi[a], hi[b], hi[c] = s, t, 1.0
                low, high = (lo[0], lo[1], lo[2]), (hi[0], hi[1], hi[2])
                polygons.append([at[low, a], at[low, b], at[high, b], at[high, a]])
    polygons += [[at[c, 0], at[c, 1], at[c, 2]] for c in corners]
    place = signs - 0.3 * signs * inset
    faces = []
    for polygon in polygons:
        corner3 = place[polygon]
        turned = np.cross(corner3[1] - corner3[0], corner3[2] - corner3[0]) @ corner3.mean(axis=0) < 0
        loop = polygon[::-1] if turned else polygon
        faces += [[loop[0], loop[k], loop[k + 1]] for k in range(1, len(loop) - 1)]
    return signs, inset, np.array(faces), normals


#: The parts of `_chamfered_cube`.
SIGNS, INSET, CHAMFER_FACES, CHAMFER_NORMALS = _chamfered_cube()


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """(F, 3) triangles of a grid of rows × columns vertices in row-major order."""
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij"))
    a, b, c, d = i * columns + j, i * columns + j + 1, (i + 1) * columns + j + 1, (i + 1) * columns + j
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def skin_faces(loops: int, points: int, *, closed: bool = False) -> NDArray[np.int64]:
    """(F, 3) triangles between each of ``loops`` closed loops of ``points`` vertices and the next one.

    Args:
        loops: their number.
        points: of each loop; point j of a loop is joined to point j of the next.
        closed: whether the last loop is joined to the first.
    """
    i, j = np.meshgrid(np.arange(loops if closed else loops - 1), np.arange(points), indexing="ij")
    n, ahead = (i + 1) % loops, (j + 1) % points
    a, b, c, d = i * points + j, i * points + ahead, n * points + ahead, n * points + j
    return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3)


def cap_faces(loops: int, points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(points, 3) fans that close the first and the last loop of a skin about the two vertices after the loops."""
    ring, ahead = np.arange(points), (np.arange(points) + 1) % points
    tip, last = np.full(points, loops * points), (loops - 1) * points
    return np.stack([tip, ahead, ring], axis=1), np.stack([tip + 1, last + ring, last + ahead], axis=1)


def outward(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """The faces of a closed solid, turned so that its signed volume is positive."""
    p = vertices[faces] - vertices.mean(axis=0)
    volume = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum()
    return faces if volume > 0 else faces[:, ::-1]


def rounded_rectangle(width: float, height: float, radius: float, *, steps: int = 5) -> Array:
    """(N, 2) outline about the origin, counter-clockwise, ``steps`` segments per corner of ``radius`` metres."""
    r = min(radius, 0.499 * width, 0.499 * height)
    arc = np.linspace(0, np.pi / 2, steps + 1)
    corners = []
    for quarter, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = arc + quarter * np.pi / 2
        middle = np.array([sx * (width / 2 - r), sy * (height / 2 - r)])
        corners.append(middle + r * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(corners)


def slab_loops(size: Sequence[float], *, corner: float, bevel: float, steps: int) -> Array:
    """(L, N, 3) loops of a plate about the origin: see `MeshBuilder.slab`."""
    width, height, depth = size
    edge = min(bevel, 0.9 * depth, 0.45 * min(width, height))
    loops = [_flat(rounded_rectangle(width, height, corner, steps=steps), -depth / 2)]
    for t in np.linspace(0, np.pi / 2, 4) if edge > 0 else [np.pi / 2]:
        inset, z = edge * (1 - np.cos(t)), depth / 2 - edge * (1 - np.sin(t))
        outline = rounded_rectangle(width - 2 * inset, height - 2 * inset, max(corner - inset, 1e-3), steps=steps)
        loops.append(_flat(outline, z))
    return np.array(loops)


def grip_loops(line: Array, section: Array, outline: Array) -> Array:
    """(K, N, 3) loops of a bar along x with tapered ends: the grip of a handset.

    Args:
        line: (K, 2) x and y of its middle, in the order of x.
        section: (K, 2) half its width (along z) and half its thickness (along y).
        outline: (N, 2) of a section, between −1 and 1.
    """
    ends = np.ones(len(line))
    ends[[0, -1]], ends[[1, -2]] = 0.55, 0.92
    # Loops run counter-clockwise seen from +x.
    loops = [
        np.stack(
            [
                np.full(len(outline), x),
                y + outline[:, 1] * thick * end,
                -outline[:, 0] * width * end,
            ],
            axis=1,
        )
        for (x, y), (width, thick), end in zip(line, section, ends, strict=True)
    ]
    return np.array(loops)


def _flat(outline: Array, z: float) -> Array:
    return np.concatenate([outline, np.full((len(outline), 1), z)], axis=1)


def housing_loops(size: Sequence[float], port: Sequence[float], radius: float, depth: float) -> Array:
    """(L, N, 3) loops of a box about the origin whose front (+Z) has a round hole: the case of a washing machine.

    Args:
        size: x, y, z extents.
        port: (x, y) of the hole's centre.
        radius: of the hole.
        depth: of the hole's wall.
    """
    width, height, length = size
    outline = rounded_rectangle(width, height, EDGE)
    away = outline - np.asarray(port)
    # The long sides need points between the corners; otherwise the front's triangles become slivers across the hole.
    pieces = []
    for first, second in zip(away, np.roll(away, -1, axis=0), strict=True):
        cuts = max(1, int(np.linalg.norm(second - first) / 0.08))
        pieces.append(first + (second - first) * (np.arange(cuts) / cuts)[:, None])
    outline = np.concatenate(pieces)
    circle = radius * outline / np.linalg.norm(outline, axis=1, keepdims=True)
    shift = np.asarray(port)
    outline, circle = outline + shift, circle + shift
    half = np.array([width / 2, height / 2])
    loops = [_flat(outline, -length / 2)]
    for t in np.linspace(0, np.pi / 2, 4):
        shrink = (half - BEVEL * (1 - np.cos(t))) / half
        loops.append(_flat(outline * shrink, length / 2 - BEVEL * (1 - np.sin(t))))
    loops.append(_flat(circle, length / 2))
    loops.append(_flat(circle, length / 2 - depth))
    return np.array(loops)


def egg(half_width: float, front: float, back: float, *, points: int = 36, squareness: float = 2.0) -> Array:
    """(N, 2: x, z) closed outline reaching ``front`` towards +Z and ``back`` towards −Z, counter-clockwise from above.

    A superellipse of exponent ``squareness`` (2 = ellipse) on the back half; the front half is an ellipse.
    """
    t = np.linspace(0, 2 * np.pi, points, endpoint=False)
    s, c = np.sin(t), np.cos(t)
    power = np.where(c >= 0, 1.0, 2.0 / squareness)
    x = half_width * np.sign(s) * np.abs(s) ** power
    z = np.where(c >= 0, front * c, -back * np.abs(c) ** power)
    return np.stack([x, z], axis=1)


def level(outline: Array, y: float) -> Array:
    """(N, 3) loop at height ``y`` from an (N, 2: x, z) outline."""
    return np.stack([outline[:, 0], np.full(len(outline), y), outline[:, 1]], axis=1)


def smooth_path(points: ArrayLike, count: int) -> Array:
    """(count, 3) Catmull–Rom curve through ``points`` (N, 3), its ends included; evenly spaced in the parameter."""
    p = np.asarray(points, dtype=np.float64)
    padded = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    s = np.linspace(0, len(p) - 1, count)
    k = np.minimum(s.astype(int), len(p) - 2)
    t = (s - k)[:, None]
    a, b, c, d = padded[k], padded[k + 1], padded[k + 2], padded[k + 3]
    return np.asarray(0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3))


def coil(path: ArrayLike, radius: float, turns: int, *, per_turn: int = 8) -> Array:
    """(N, 3) helix of ``radius`` metres winding ``turns`` times about ``path`` (M, 3): a telephone's cord."""
    line = smooth_path(path, turns * per_turn + 1)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    up = np.where(np.abs(tangent[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(tangent, up)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    angle = 2 * np.pi * np.arange(len(line))[:, None] / per_turn
    # The ends run into the axis, where the cord enters its sockets.
    fade = np.minimum(1.0, np.minimum(np.arange(len(line)), np.arange(len(line))[::-1])[:, None] / per_turn)
    return np.asarray(line + radius * fade * (side * np.cos(angle) + other * np.sin(angle)))


def ribbed(count: int, radius: float, depth: float) -> Array:
    """(count,) radii of a corrugated hose: every second ring is ``depth`` metres thinner."""
    return np.asarray(radius - depth * (np.arange(count) % 2), dtype=np.float64)
