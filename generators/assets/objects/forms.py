"""Shapes of moulded goods other than boxes and lathes: lofts, rounded slabs, housings with a port, coils."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material

Array = NDArray[np.float64]

#: Which ends of a loft are closed.
Caps = Literal["both", "first", "none"]
#: Housing of enamelled sheet steel: radius of its edges along z, and of the edges of its front (m).
EDGE, BEVEL = 0.012, 0.008


def loft(
    builder: MeshBuilder,
    loops: ArrayLike,
    material: Material,
    *,
    caps: Caps = "both",
    centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
    rotate: Array | None = None,
    crease: float = 40.0,
    acoustic: bool | str = True,
) -> None:
    """Add the skin over a stack of closed loops.

    Args:
        builder: receives the faces.
        loops: (L, N, 3); loop k's point j is joined to loop k+1's point j. Seen from the end of the stack, the loops
            run counter-clockwise, so that the skin faces outwards.
        material: of all faces.
        caps: ends to close, with a fan around the mean of the loop (the loop must be star-shaped about it).
        centre: added after the rotation.
        rotate: (3, 3).
        crease: smoothing angle, degrees.
        acoustic: see `MeshBuilder.add`.
    """
    stack = np.asarray(loops, dtype=np.float64)
    count, points, _ = stack.shape
    i, j = np.meshgrid(np.arange(count - 1), np.arange(points), indexing="ij")
    n = (j + 1) % points
    a, b, c, d = i * points + j, i * points + n, (i + 1) * points + n, (i + 1) * points + j
    faces = [np.stack([a, b, c], axis=2).reshape(-1, 3), np.stack([a, c, d], axis=2).reshape(-1, 3)]
    vertices = [stack.reshape(-1, 3), stack[0].mean(axis=0)[None], stack[-1].mean(axis=0)[None]]
    ring, ahead = np.arange(points), (np.arange(points) + 1) % points
    if caps != "none":
        faces.append(np.stack([np.full(points, count * points), ahead, ring], axis=1))
    if caps == "both":
        last = (count - 1) * points
        faces.append(np.stack([np.full(points, count * points + 1), last + ring, last + ahead], axis=1))
    builder.add(
        np.concatenate(vertices),
        np.concatenate(faces),
        material,
        centre=centre,
        rotate=rotate,
        crease=crease,
        acoustic=acoustic,
    )


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


def slab(
    builder: MeshBuilder,
    size: Sequence[float],
    centre: Sequence[float] | Array,
    material: Material,
    *,
    corner: float = 0.02,
    bevel: float = 0.004,
    steps: int = 5,
    rotate: Array | None = None,
    acoustic: bool | str = False,
) -> None:
    """A plate of ``size`` (x, y, z) about ``centre``: corners rounded in x–y, the edge of its +Z face bevelled."""
    width, height, depth = size
    edge = min(bevel, 0.9 * depth, 0.45 * min(width, height))
    loops = [_flat(rounded_rectangle(width, height, corner, steps=steps), -depth / 2)]
    for t in np.linspace(0, np.pi / 2, 4) if edge > 0 else [np.pi / 2]:
        inset, z = edge * (1 - np.cos(t)), depth / 2 - edge * (1 - np.sin(t))
        outline = rounded_rectangle(width - 2 * inset, height - 2 * inset, max(corner - inset, 1e-3), steps=steps)
        loops.append(_flat(outline, z))
    loft(builder, np.array(loops), material, centre=centre, rotate=rotate, acoustic=acoustic)


def grip(
    builder: MeshBuilder,
    line: Array,
    section: Array,
    outline: Array,
    material: Material,
    *,
    centre: Sequence[float] | Array,
    rotate: Array | None,
) -> None:
    """A bar along x with tapered ends: the grip of a handset.

    Args:
        builder: receives the faces.
        line: (K, 2) x and y of its middle, in the order of x.
        section: (K, 2) half its width (along z) and half its thickness (along y).
        outline: (N, 2) of a section, between −1 and 1.
        material: of all faces.
        centre: added after the rotation.
        rotate: (3, 3).
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
    loft(builder, np.array(loops), material, centre=centre, rotate=rotate, crease=50, acoustic=False)


def _flat(outline: Array, z: float) -> Array:
    return np.concatenate([outline, np.full((len(outline), 1), z)], axis=1)


def housing_with_port(
    builder: MeshBuilder,
    size: Sequence[float],
    material: Material,
    *,
    port: Sequence[float],
    radius: float,
    depth: float,
    centre: Sequence[float] | Array = (0.0, 0.0, 0.0),
) -> None:
    """A box of ``size`` about ``centre`` whose front (+Z) has a round hole: the case of a washing machine.

    Args:
        builder: receives the faces.
        size: x, y, z extents.
        material: of the case.
        port: (x, y) of the hole's centre, relative to ``centre``.
        radius: of the hole.
        depth: of the hole's wall.
        centre: of the box.
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
    loft(builder, np.array(loops), material, caps="first", centre=centre, acoustic=True)


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
