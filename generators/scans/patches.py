"""Places for objects in a scanned room: floor, worktops, tables, shelves, free wall, by ray casting.

1. Height layers. On a 5 cm grid over the room's box, rays go down from its top through every surface they meet. Each
   hit has a height, a slope and a clearance: the distance to the surface above it. Where a scan is noisy, the slopes of
   single faces mean little; a hit is level, too, if most of the cells around it have one at its height.
2. Floor: the lowest level (2 cm bins) that at least 15 % of the grid, and half a square metre, sees with half a metre
   free above it.
3. Tops: level hits (within 37° of horizontal, since scans ripple) 0.35–1.7 m above the floor with 25 cm free above
   are taken level by level, the most frequent first; the largest rectangles of cells within ±1.5 cm of a level become
   supports: ``side_table`` below 0.7 m, ``worktop`` to 1.1 m, ``shelf`` above. What is low and larger than a table is
   a bed or a rug on a podium and left out; a hard seat passes for a side table. Single cells that a hole in the scan
   left out are filled.
4. Walls: rays towards each side of the box between 1.3 and 2.1 m, every 2.5 cm; rectangles of at least 40 cm whose
   hits lie within ±1 cm of one plane (more where the scan is noisy), pin-holes filled.

Rectangles are parallel to the axes: a scan whose walls run askew yields few and small ones; turn it first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from generators.core.rays import RayCaster
from generators.core.scene import F32, Room, Support, SupportKind

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rectangle = tuple[int, int, int, int]

CELL = 0.05
#: Finer on walls: a shelf board is 2–3 cm thick.
WALL_CELL = 0.025
LAYERS = 12
#: |cosine| of a level surface's slope.
LEVEL = 0.8
FREE_ABOVE = 0.25
#: Lowest and highest relative height of each kind of top, metres.
KINDS: tuple[tuple[SupportKind, float, float], ...] = (
    ("side_table", 0.35, 0.7),
    ("worktop", 0.7, 1.1),
    ("shelf", 1.1, 1.7),
)
#: A low surface larger than this is a bed, not a table, m².
LARGEST_TABLE = 1.5
WALL_BAND = (1.3, 2.1)
#: Free depth that a patch of wall has before it, metres.
WALL_DEPTH = 0.5
#: A wall's hits scatter about its plane by no more than this (standard deviation, metres).
WALL_NOISE = 0.006
_AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Layers:
    """Surfaces that rays straight down meet: (NX, NZ, LAYERS) arrays, from the top; NaN below the last one.

    Attributes:
        x: (NX,) grid coordinates.
        z: (NZ,) grid coordinates.
        height: y of the hit.
        slope: |cosine| between the surface's normal and the vertical.
        clearance: distance to the surface above, or to the box's top.
    """

    x: Array
    z: Array
    height: Array
    slope: Array
    clearance: Array


def cast_down(caster: RayCaster, triangles: F32, room: Room) -> Layers:
    """Measure the room's height layers."""
    x = np.arange(room.low[0] + CELL / 2, room.high[0], CELL)
    z = np.arange(room.low[2] + CELL / 2, room.high[2], CELL)
    grid = np.stack([g.reshape(-1) for g in np.meshgrid(x, z, indexing="ij")], axis=1)
    count = len(grid)
    height = np.full((count, LAYERS), np.nan)
    slope, clearance = height.copy(), height.copy()
    alive = np.arange(count)
    y = np.full(count, room.high[1] - 0.01)
    above = y.copy()
    lowest = room.low[1] - 0.3
    for layer in range(LAYERS):
        rays = np.stack([grid[alive, 0], y[alive], grid[alive, 1]], axis=1)
        distance, face = caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
        hit = (face >= 0) & (y[alive] - distance >= lowest)
        alive, face = alive[hit], face[hit]
        if not len(alive):
            break
        y[alive] -= distance[hit].astype(np.float64)
        corners = triangles[face].astype(np.float64)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        height[alive, layer] = y[alive]
        slope[alive, layer] = np.abs(cross[:, 1]) / np.maximum(np.linalg.norm(cross, axis=1), 1e-20)
        clearance[alive, layer] = above[alive] - y[alive]
        above[alive] = y[alive]
        y[alive] -= 0.002
    shape = (len(x), len(z), LAYERS)
    height = height.reshape(shape)
    slope = np.where(_among_equals(height), 1.0, slope.reshape(shape))
    return Layers(x, z, height, slope, clearance.reshape(shape))


def _among_equals(height: Array, reach: float = 0.02, least: int = 6) -> Mask:
    """Whether at least ``least`` of the eight cells around a hit have one within ``reach`` metres of its height."""
    padded = np.pad(height, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    count = np.zeros(height.shape, dtype=np.int64)
    with np.errstate(invalid="ignore"):
        for di in range(3):
            for dj in range(3):
                if (di, dj) != (1, 1):
                    other = padded[di : di + height.shape[0], dj : dj + height.shape[1]]
                    near = np.zeros(height.shape, dtype=bool)
                    for layer in range(height.shape[2]):
                        near |= np.abs(height - other[..., layer : layer + 1]) <= reach
                    count += near
    return count >= least


def _filled(mask: Mask) -> Mask:
    """``mask`` with the cells that at least six of their eight neighbours surround."""
    around = ndimage.convolve(mask.astype(np.int64), np.ones((3, 3), dtype=np.int64), mode="constant")
    return np.asarray(mask | (around >= 6))


def find_floor(layers: Layers, name: str) -> float:
    """Height of the floor.

    Raises:
        Avs3dError: if no level is large and free enough.
    """
    good = (layers.slope >= LEVEL) & (layers.clearance >= 0.5)
    heights = layers.height[good]
    columns = layers.height.shape[0] * layers.height.shape[1]
    needed = max(0.15 * columns, 0.5 / CELL**2)
    if len(heights):
        width = 0.02
        low = float(heights.min())
        counts = np.bincount(((heights - low) / width).astype(np.int64))
        wide = np.convolve(counts, [1, 1, 1], mode="same")
        for level in np.flatnonzero(wide >= needed):
            middle = low + (level + 0.5) * width
            return float(np.median(heights[np.abs(heights - middle) <= 1.5 * width]))
    raise Avs3dError(
        f"{name}: no floor found inside the room's box (no level surface of {needed * CELL**2:.1f} m² with 0.5 m free "
        "above it); give the box in metres, Y up, around one room"
    )


def largest_rectangle(mask: Mask) -> Rectangle:
    """First row, first column, rows and columns of the largest all-true rectangle (the histogram algorithm)."""
    best = (0, 0, 0, 0)
    run = np.zeros(mask.shape[1], dtype=np.int64)
    for row in range(mask.shape[0]):
        run = np.where(mask[row], run + 1, 0)
        stack: list[tuple[int, int]] = []  # (first column, height), heights ascending
        for column, tall in enumerate([*run.tolist(), 0]):
            first = column
            while stack and stack[-1][1] >= tall:
                first, high = stack.pop()
                if high * (column - first) > best[2] * best[3]:
                    best = (row - high + 1, first, high, column - first)
            stack.append((first, tall))
    return best


def rectangles(mask: Mask, least: int, most: int) -> Iterator[Rectangle]:
    """Up to ``most`` disjoint rectangles with at least ``least`` cells on both sides, the largest first."""
    left = mask.copy()
    for _ in range(most):
        r, c, rows, columns = largest_rectangle(left)
        if min(rows, columns) < least:
            return
        yield r, c, rows, columns
        left[r : r + rows, c : c + columns] = False


def find_tops(layers: Layers, floor: float, room: Room, caster: RayCaster) -> list[Support]:
    """Worktops, tables and shelves."""
    relative = layers.height - floor
    with np.errstate(invalid="ignore"):
        left = (layers.slope >= LEVEL) & (layers.clearance >= FREE_ABOVE)
        left &= (relative >= KINDS[0][1]) & (relative <= KINDS[-1][2])
    out: list[Support] = []
    while left.any():
        bins = (relative[left] * 100).astype(np.int64)
        counts = np.convolve(np.bincount(bins), [1, 1, 1], mode="same")
        if counts.max() < 16:
            break
        level = (float(np.argmax(counts)) + 0.5) / 100
        with np.errstate(invalid="ignore"):
            near = left & (np.abs(relative - level) <= 0.015)
        mask = _filled(np.asarray(near.any(axis=2)))
        for r, c, rows, columns in rectangles(mask, 4, 6):
            block = (slice(r, r + rows), slice(c, c + columns))
            y = float(np.median(layers.height[block][near[block]]))
            free = float(layers.clearance[block][near[block]].min())
            low = (float(layers.x[r]) - CELL / 2, float(layers.z[c]) - CELL / 2)
            size = (rows * CELL, columns * CELL)
            kind = next(k for k, lowest, highest in KINDS if y - floor <= highest + 0.02)
            if kind == "side_table" and size[0] * size[1] > LARGEST_TABLE:
                continue
            out.append(_top(kind, room.name, low, size, y, free, caster))
        left &= ~near
    return out


def _top(
    kind: SupportKind,
    room: str,
    low: tuple[float, float],
    size: tuple[float, float],
    y: float,
    clearance: float,
    caster: RayCaster,
) -> Support:
    """A level rectangle; it looks where the room is open before it and closed behind it."""
    centre = np.array([low[0] + size[0] / 2, y + min(0.15, clearance / 2), low[1] + size[1] / 2])
    distance = np.minimum(caster.closest(centre, _AXES)[0].astype(np.float64), 5.0)
    open_before = distance - np.roll(distance, 2)
    f = _AXES[int(np.argmax(np.round(open_before, 2)))]
    across, deep = (size[0], size[1]) if f[2] else (size[1], size[0])
    side = np.cross([0.0, 1.0, 0.0], f)
    middle = np.array([centre[0], y, centre[2]])
    origin = middle - side * across / 2 - f * deep / 2
    return Support(
        kind, room, _vector(origin), _vector(side * across), _vector(f * deep), (0.0, 1.0, 0.0), _vector(f), clearance
    )


def find_walls(caster: RayCaster, floor: float, room: Room) -> list[Support]:
    """Free upright patches of the four sides of the room's box."""
    out: list[Support] = []
    low, high = np.asarray(room.low), np.asarray(room.high)
    for inward in _AXES:
        axis, other = (2, 0) if inward[2] else (0, 2)
        edge = low[axis] if inward[axis] > 0 else high[axis]
        along = np.arange(low[other] + WALL_CELL / 2, high[other], WALL_CELL)
        up = np.arange(floor + WALL_BAND[0] + WALL_CELL / 2, min(floor + WALL_BAND[1], high[1]), WALL_CELL)
        if not len(along) or not len(up):
            continue
        starts = np.zeros((len(along), len(up), 3))
        starts[..., other], starts[..., 1] = along[:, None], up
        starts[..., axis] = edge + inward[axis] * WALL_DEPTH
        rays = starts.reshape(-1, 3)
        distance, face = caster.closest(rays, np.broadcast_to(-inward, rays.shape))
        depth = distance.astype(np.float64)
        good = (face >= 0) & (depth <= WALL_DEPTH + 0.3) & (depth >= 0.2)
        if not good.any():
            continue
        counts = np.convolve(np.bincount((depth[good] * 100).astype(np.int64)), [1, 1, 1], mode="same")
        plane = (float(np.argmax(counts)) + 0.5) / 100
        close = good & (np.abs(depth - plane) <= 0.03)
        plane = float(np.median(depth[close]))
        rough = min(1.4826 * float(np.median(np.abs(depth[close] - plane))), WALL_NOISE)
        mask = _filled((good & (np.abs(depth - plane) <= 0.01 + 2.5 * rough)).reshape(len(along), len(up)))
        for r, c, rows, columns in rectangles(mask, 16, 3):
            cells = depth.reshape(mask.shape)[r : r + rows, c : c + columns]
            origin = np.zeros(3)
            origin[other], origin[1] = along[r] - WALL_CELL / 2, up[c] - WALL_CELL / 2
            origin[axis] = edge + inward[axis] * (WALL_DEPTH - float(np.median(cells)))
            u = np.zeros(3)
            u[other] = rows * WALL_CELL
            out.append(
                Support(
                    "wall",
                    room.name,
                    _vector(origin),
                    _vector(u),
                    (0.0, round(columns * WALL_CELL, 4), 0.0),
                    _vector(inward),
                    _vector(inward),
                    round(float(np.percentile(cells, 2)), 4),
                )
            )
    return out


def find_supports(triangles: F32, room: Room, name: str) -> tuple[float, list[Support]]:
    """The floor's height and all supports of one room.

    Args:
        triangles: (F, 3, 3) the scan's surface.
        room: its box.
        name: for messages.

    Raises:
        Avs3dError: if the box holds no floor.
    """
    caster = RayCaster(triangles)
    layers = cast_down(caster, triangles, room)
    floor = find_floor(layers, name)
    low, high = room.low, room.high
    ground = Support(
        "floor",
        room.name,
        (low[0], round(floor, 4) + 0.0, low[2]),
        (0.0, 0.0, high[2] - low[2]),
        (high[0] - low[0], 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
        high[1] - floor,
    )
    tops = find_tops(layers, floor, room, caster)
    return floor, [ground, *tops, *find_walls(caster, floor, room)]


def _vector(values: Array) -> tuple[float, float, float]:
    # Adding zero turns −0 into 0.
    x, y, z = (round(float(v), 4) + 0.0 for v in values)
    return x, y, z
