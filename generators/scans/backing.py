"""Holes of a scan closed for sound alone: patches in the sides of its rooms, and a shell behind everything.

A scan has holes: behind furniture, where the phone did not look, in windows and mirrors; often the whole ceiling is
missing. Sound would leave by them as through open windows.

1. Plan: the columns of a 5 cm grid in which the scan has a surface, and those of the rooms' boxes. Gaps up to 40 cm are
   closed, areas that are surrounded filled, parts that no room touches left out. If the scan shows but one room, the
   plan ends 35 cm outside the room's box: what was scanned through a door or a window is no room.
2. Patches: on each side of a room's box, at the median distance of what was scanned of it, a tile of 5 cm wherever no
   surface is within 15 cm before and 20 cm behind. None where a surface follows within 80 cm (a bay, an alcove), and
   none where the plan goes on behind a wall: doorways between the rooms of a flat stay open. In a single room every
   opening is closed, a doorway, too: most openings of a scan are places that were not scanned.
3. Shell: upright 20 cm outside the plan, level 20 cm below the lowest and above the highest surface. It keeps what
   leaves by other ways. It is farther from a room than what `generators.acoustics.geometry.faces_of_room` takes for
   the room's own, so that it does not count in mean absorptions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.core.rays import RayCaster
from generators.core.scene import Room
from generators.scans.ray_walk import escaped_share

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Side of a column of the plan (m).
CELL = 0.05
#: Distance between the scanned surfaces and the shell (m).
BEHIND = 0.2
#: Gaps of the plan that are closed (m).
_GAP = 0.4
#: A plan of one room ends this far outside its box (m), if the scan has less than this share of the box outside that.
_OUTSIDE, _ALONE = 0.35, 0.5
#: Share of the heights of a scan's surfaces that are below or above all others: strays (%).
_STRAY = 0.2
#: A surface this far before or behind a side covers a tile of it; what is less deep than the last is a bay (m).
_BEFORE, _AFTER, _BAY = 0.15, 0.2, 0.8
#: Thickness of a wall between two rooms (m): less than what is looked for behind it.
_WALL = 0.2
#: Share of a side that must be scanned for its distance to count instead of the box's.
_SEEN = 0.1


class Backing(NamedTuple):
    """The shell of a scan.

    Attributes:
        triangles: (N, 3, 3) metres.
        places: (N,) ``floor``, ``wall`` or ``ceiling``.
        escaped: share of the flights of sound from surface to surface that leave the scan without it.
    """

    triangles: Array
    places: NDArray[np.str_]
    escaped: float


def backing_of(triangles: Array, rooms: Sequence[Room]) -> Backing:
    """The shell around a scan; none if no ray finds a hole.

    Args:
        triangles: (A, 3, 3) all its surfaces.
        rooms: those that are known; without one there is no shell.
    """
    none = Backing(np.zeros((0, 3, 3)), np.zeros(0, dtype="<U8"), 0.0)
    if not rooms or not len(triangles):
        return none
    caster = RayCaster(triangles)
    escaped = escaped_share(caster, triangles, rooms)
    if escaped == 0:
        return none
    low, high = _bounds(triangles, rooms)
    plan = _plan(caster, rooms, low, high)
    quads, places = _shell(plan, low, high)
    for room in rooms:
        for axis in range(3):
            for outward in (-1.0, 1.0):
                found = _patches(caster, room, axis, outward, plan, low)
                quads = np.concatenate([quads, found])
                places += [("wall", "floor" if outward < 0 else "ceiling", "wall")[axis]] * len(found)
    halves = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    return Backing(halves, np.repeat(np.array(places), 2), escaped)


def _patches(caster: RayCaster, room: Room, axis: int, outward: float, plan: Mask, corner: Array) -> Array:
    """(N, 4, 3) rectangles that close one side of a room's box.

    Args:
        caster: of the scan.
        room: its box.
        axis: normal to the side.
        outward: 1 for the side at the room's ``high``, −1 for that at its ``low``.
        plan: (X, Z) the columns inside the shell.
        corner: (3,) where the plan begins.
    """
    low, high = np.asarray(room.low), np.asarray(room.high)
    one, two = (k for k in range(3) if k != axis)
    count = np.ceil((high - low) / CELL).astype(np.int64)
    step = (high - low) / count
    edges = [low[k] + step[k] * np.arange(count[k] + 1) for k in (one, two)]
    start = np.empty((count[one], count[two], 3))
    start[..., one], start[..., two] = np.meshgrid(*((e[:-1] + e[1:]) / 2 for e in edges), indexing="ij")
    side = (high if outward > 0 else low)[axis]
    start[..., axis] = side - outward * _BEFORE
    way = np.broadcast_to(outward * np.eye(3)[axis], start.shape)
    distance, face = caster.closest(start.reshape(-1, 3), np.ascontiguousarray(way).reshape(-1, 3))
    depth = np.where(face >= 0, distance.astype(np.float64) - _BEFORE, np.inf).reshape(start.shape[:2])
    covered = depth <= _AFTER
    open_ = ~covered & ~(depth <= _BAY)
    if axis != 1:
        beyond = start + way * (_BEFORE + BEHIND + 3 * CELL + _WALL)
        column = np.floor((beyond - corner) / CELL).astype(np.int64)[..., [0, 2]]
        inside = ((column >= 0) & (column < plan.shape)).all(axis=-1)
        column = np.clip(column, 0, np.array(plan.shape) - 1)
        open_ &= ~(inside & plan[column[..., 0], column[..., 1]])
    at = side + outward * (float(np.median(depth[covered])) if covered.mean() >= _SEEN else 0.0)
    out = np.empty((0, 4, 3))
    found = rectangles_of(open_)
    if found:
        r, e, s, t = np.array(found).T
        out = np.empty((len(found), 4, 3))
        out[..., axis] = at
        out[..., one] = edges[0][np.stack([r, e, e, r], axis=1)]
        out[..., two] = edges[1][np.stack([s, s, t, t], axis=1)]
    return out


def _shell(plan: Mask, low: Array, high: Array) -> tuple[Array, list[str]]:
    """(N, 4, 3) rectangles around the columns of ``plan``, and the place of each."""
    x, z = (low[axis] + CELL * np.arange(plan.shape[k] + 1) for k, axis in enumerate((0, 2)))
    quads: list[list[list[float]]] = []
    for y in (low[1], high[1]):
        quads += [[[x[a], y, z[b]] for a, b in ((r, s), (e, s), (e, t), (r, t))] for r, e, s, t in rectangles_of(plan)]
    slabs = len(quads) // 2
    for axis, grid in ((0, plan), (2, plan.T)):
        turns = np.diff(np.pad(grid, ((1, 1), (0, 0))).astype(np.int8), axis=0) != 0
        lines, along = (x, z) if axis == 0 else (z, x)
        for line in range(len(turns)):
            for _, _, first, last in rectangles_of(turns[line][None]):
                ends = [along[k] for k in (first, last, last, first)]
                heights = [low[1], low[1], high[1], high[1]]
                points = zip(ends, heights, strict=True)
                quads.append([[lines[line], y, c] if axis == 0 else [c, y, lines[line]] for c, y in points])
    return np.array(quads), ["floor"] * slabs + ["ceiling"] * slabs + ["wall"] * (len(quads) - 2 * slabs)


def _bounds(triangles: Array, rooms: Sequence[Room]) -> tuple[Array, Array]:
    """Lowest and highest corner: the shell's height, in plan with a margin."""
    points = triangles.reshape(-1, 3)
    boxes = np.array([[room.low, room.high] for room in rooms])
    floor, ceiling = float(boxes[..., 1].min()), float(boxes[..., 1].max())
    bottom, top = np.percentile(points[:, 1], [_STRAY, 100 - _STRAY])
    margin = _GAP + BEHIND + 2 * CELL
    low = np.minimum(points.min(axis=0), boxes[:, 0].min(axis=0)) - margin
    high = np.maximum(points.max(axis=0), boxes[:, 1].max(axis=0)) + margin
    low[1], high[1] = min(floor, bottom) - BEHIND, max(ceiling, top) + BEHIND
    return low, high


def _plan(caster: RayCaster, rooms: Sequence[Room], low: Array, high: Array) -> Mask:
    """(X, Z) the columns inside the shell, from the corner ``low``."""
    count = np.ceil((high - low) / CELL).astype(np.int64)[[0, 2]]
    x, z = (low[axis] + CELL * (np.arange(number) + 0.5) for axis, number in zip((0, 2), count, strict=True))
    at = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1).reshape(-1, 2)
    start = np.insert(at, 1, high[1] + 1.0, axis=1)
    _, face = caster.closest(start, np.broadcast_to([0.0, -1.0, 0.0], start.shape))
    found = (face >= 0).reshape(len(x), len(z))

    def boxes(margin: float) -> Mask:
        out = np.zeros(found.shape, dtype=bool)
        for room in rooms:
            inside = [(c >= room.low[k] - margin) & (c <= room.high[k] + margin) for c, k in ((x, 0), (z, 2))]
            out |= inside[0][:, None] & inside[1]
        return out

    own, around = boxes(0.0), boxes(_OUTSIDE)
    if len(rooms) == 1 and (found & ~around).sum() < _ALONE * own.sum():
        found &= around
    closed = ndimage.binary_closing(found | own, np.ones((3, 3), dtype=bool), iterations=round(_GAP / 2 / CELL))
    parts, number = ndimage.label(ndimage.binary_fill_holes(closed | own))
    kept = np.zeros(number + 1, dtype=bool)
    kept[np.unique(parts[own])] = True
    kept[0] = False
    return np.asarray(
        ndimage.binary_dilation(kept[parts], np.ones((3, 3), dtype=bool), iterations=round(BEHIND / CELL))
    )


def rectangles_of(mask: Mask) -> list[tuple[int, int, int, int]]:
    """Disjoint rectangles [first, last) × [first, last) that cover ``mask`` (R, C) exactly.

    Runs along each row; equal runs of consecutive rows are one rectangle.
    """
    done: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(mask.shape[0] + 1):
        line = mask[row] if row < mask.shape[0] else np.zeros(mask.shape[1], dtype=bool)
        turns = np.flatnonzero(np.diff(np.pad(line, 1).astype(np.int8))).reshape(-1, 2)
        runs = {(int(a), int(b)) for a, b in turns}
        done += [(first, row, *run) for run, first in sorted(growing.items()) if run not in runs]
        growing = {run: growing.get(run, row) for run in runs}
    return done
