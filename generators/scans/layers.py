"""Height layers of a scanned room: all surfaces that rays straight down meet; its floor; rectangles in masks.

On a grid over the room's box, rays go down from its top through every surface they meet. Each hit has a height and a
clearance: the distance to the surface above it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from generators.core.rays import RayCaster
from generators.core.scene import Room

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
#: First row, first column, number of rows and of columns.
Rectangle = tuple[int, int, int, int]

#: Spacing of the grid (m).
CELL = 0.025
#: Number of surfaces that a ray is followed through.
LAYERS = 12


@dataclass(frozen=True, eq=False)
class Layers:
    """Surfaces that rays straight down meet: (NX, NZ, LAYERS) arrays, from the top; NaN below the last one.

    Attributes:
        x: (NX,) grid coordinates.
        z: (NZ,) grid coordinates.
        height: y of the hit.
        clearance: distance to the surface above, or to the box's top.
    """

    x: Array
    z: Array
    height: Array
    clearance: Array


def cast_down(caster: RayCaster, room: Room) -> Layers:
    """Measure the room's height layers."""
    x = np.arange(room.low[0] + CELL / 2, room.high[0], CELL)
    z = np.arange(room.low[2] + CELL / 2, room.high[2], CELL)
    grid = np.stack([g.reshape(-1) for g in np.meshgrid(x, z, indexing="ij")], axis=1)
    count = len(grid)
    height = np.full((count, LAYERS), np.nan)
    clearance = height.copy()
    alive = np.arange(count)
    y = np.full(count, room.high[1] - 0.01)
    above = y.copy()
    lowest = room.low[1] - 0.3
    for layer in range(LAYERS):
        rays = np.stack([grid[alive, 0], y[alive], grid[alive, 1]], axis=1)
        distance, face = caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
        hit = (face >= 0) & (y[alive] - distance >= lowest)
        alive = alive[hit]
        if not len(alive):
            break
        y[alive] -= distance[hit].astype(np.float64)
        height[alive, layer] = y[alive]
        clearance[alive, layer] = above[alive] - y[alive]
        above[alive] = y[alive]
        y[alive] -= 0.002
    shape = (len(x), len(z), LAYERS)
    return Layers(x, z, height.reshape(shape), clearance.reshape(shape))


def filled(mask: Mask) -> Mask:
    """``mask`` with the cells that at least six of their eight neighbours surround."""
    around = ndimage.convolve(mask.astype(np.int64), np.ones((3, 3), dtype=np.int64), mode="constant")
    return np.asarray(mask | (around >= 6))


def find_floor(layers: Layers, name: str) -> float:
    """Height of the floor.

    Raises:
        Avs3dError: if no level is large and free enough.
    """
    good = layers.clearance >= 0.5
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


def vector(values: Array) -> tuple[float, float, float]:
    """Four decimals of (3,)."""
    # Adding zero turns −0 into 0.
    x, y, z = (round(float(v), 4) + 0.0 for v in values)
    return x, y, z
