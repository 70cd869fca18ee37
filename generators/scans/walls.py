"""Free upright patches of the four sides of a scanned room: rays sideways, a plane, and what lies flat on it.

Rays towards each side of the room's box between 1.3 and 2.1 m above the floor meet walls, but also curtains and the
fronts of shelves and wardrobes. On each side the most frequent depth is fitted by a plane, which may be turned a little
from the box's side; rectangles of its cells are walls if they are as flat as a wall: folds and backs of books are not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.core.scene import Room, Support
from generators.scans.flatness import fit_plane, flatness, plane_on
from generators.scans.layers import filled, rectangles, vector
from generators.scans.tops import ScanRays

Array = NDArray[np.float64]

#: Spacing of the rays (m): a shelf board is 2–3 cm thick.
CELL = 0.025
#: Heights above the floor between which a wall is looked for (m).
BAND = (1.3, 2.1)
#: Free depth that a patch of wall has before it (m).
DEPTH = 0.5
#: Least side of a patch (m).
LEAST = 0.4
#: Largest distance from the plane (m), and largest difference between neighbouring rays (m); the latter grows with what
#: is usual on the wall, up to `SCATTER`.
ROUGH_PLANE, STEP, SCATTER = 0.03, 0.008, 0.006
#: Largest slope of a wall against its side of the box: 10°, sideways, and 3°, upwards.
TURN, LEAN = 0.18, 0.05
#: Largest wave of a wall (m), as `Flatness.wave`, or in those of the floor: books' backs and folds wave more.
STIFF, STIFFER, STIFFEST = 0.003, 1.7, 0.005
#: Least share of a patch that is near its plane; the rest are sockets and pin-holes.
COVERED = 0.9


def find_walls(around: ScanRays, room: Room) -> list[Support]:
    """Free upright patches of the four sides of the room's box."""
    out: list[Support] = []
    for inward in np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]):
        out += _on_side(around, room, inward)
    return out


def _on_side(around: ScanRays, room: Room, inward: Array) -> list[Support]:
    low, high = np.asarray(room.low), np.asarray(room.high)
    axis, other = (2, 0) if inward[2] else (0, 2)
    edge = low[axis] if inward[axis] > 0 else high[axis]
    along = np.arange(low[other] + CELL / 2, high[other], CELL)
    up = np.arange(around.floor + BAND[0] + CELL / 2, min(around.floor + BAND[1], high[1]), CELL)
    if not len(along) or not len(up):
        return []
    starts = np.zeros((len(along), len(up), 3))
    starts[..., other], starts[..., 1] = along[:, None], up
    starts[..., axis] = edge + inward[axis] * DEPTH
    depth = around.distance(starts, -inward)
    good = (depth <= DEPTH + 0.3) & (depth >= 0.2)
    if good.sum() < (LEAST / CELL) ** 2:
        return []
    counts = np.convolve(np.bincount((depth[good] * 100).astype(np.int64)), [1, 1, 1], mode="same")
    common = (float(np.argmax(counts)) + 0.5) / 100
    plane = fit_plane(depth, good & (np.abs(depth - common) <= ROUGH_PLANE), CELL)
    if abs(plane[0]) > TURN or abs(plane[1]) > LEAN:
        return []
    rest = depth - plane_on(plane, depth.shape, CELL)
    near = good & (np.abs(rest) <= ROUGH_PLANE)
    # A large wall bows, so that it is compared with itself nearby; a frame or a shelf's edge is a step.
    step = ndimage.maximum_filter(rest, 3) - ndimage.minimum_filter(rest, 3)
    scatter = min(float(np.median(step[near])) / 2, SCATTER)
    mask = filled(filled(near & (step <= STEP + 3 * scatter)))
    stiff = min(max(STIFF, STIFFER * around.wave), STIFFEST)
    out = []
    for r, c, rows, columns in rectangles(mask, round(LEAST / CELL), 3):
        block = (slice(r, r + rows), slice(c, c + columns))
        if near[block].mean() < COVERED or _wave(depth[block], near[block]) > stiff:
            continue
        flat = flatness(depth[block], near[block], CELL)
        # From its lower corner, along the wall as it is turned, upright. Depth grows away from ``inward``.
        sideways = np.eye(3)[other]
        u = sideways - inward * flat.slope[0]
        origin = starts[r, c] - inward * flat.offset - (u + np.array([0.0, 1.0, 0.0])) * CELL / 2
        facing = vector((inward + flat.slope[0] * sideways) / np.linalg.norm(u))
        clearance = round(float(np.percentile(depth[block], 2)), 4)
        rise = (0.0, round(columns * CELL, 4), 0.0)
        out.append(Support("wall", room.name, vector(origin), vector(u * rows * CELL), rise, facing, facing, clearance))
    return out


def _wave(depth: Array, known: NDArray[np.bool_]) -> float:
    """Median wave of the squares of side `LEAST` of a patch (N, M), metres: what an object on it would meet."""
    side = round(LEAST / CELL)
    pieces = [
        (slice(i, i + side), slice(j, j + side))
        for i in range(0, depth.shape[0] - side + 1, side)
        for j in range(0, depth.shape[1] - side + 1, side)
    ]
    return float(np.median([flatness(depth[piece], known[piece], CELL).wave for piece in pieces]))
