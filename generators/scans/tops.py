"""Tops of a scanned room on which things can stand: tables, worktops, shelves; and what a level patch is instead.

Level hits of `Layers` are taken height by height, the most frequent first. Each connected surface is fitted by a plane,
and the largest rectangles in it, parallel to the room or to the surface itself, are judged one by one (`fault`):

- rigid and flat: tilted by at most `TILT`, waves of at most `STIFF` or `STIFFER` times those of the floor;
- no seat: in the height band of seats, no back rises from it, without a gap, that ends below a wall's height;
- no bed: the surface, with all that continues it nearly level, is not larger than a table of its height;
- no vessel, no lamp: it is open to more than one side, and what is as high as a shelf has something upright close by.

Colour is not used: it tells nothing about what is rigid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from generators.core.rays import RayCaster
from generators.core.scene import Room, Support, SupportKind
from generators.scans.flatness import Flatness, fit_plane, flatness, plane_on
from generators.scans.layers import CELL, Layers, filled, rectangles, vector

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Band:
    """A kind of top: its lowest and highest height above the floor, least width and least free height (m)."""

    kind: SupportKind
    low: float
    high: float
    width: float
    free: float


#: A board may be narrow; what is low and narrow is an arm of a sofa or the rim of a bath or basin. What is low and has
#: less free above it is a seat under a table.
BANDS = (
    Band("side_table", 0.33, 0.7, 0.225, 0.3),
    Band("worktop", 0.7, 1.1, 0.25, 0.25),
    Band("shelf", 1.1, 1.7, 0.175, 0.25),
)
#: Half the range of heights that count as one level (m), and the least area of a surface (m²).
LEVEL, LEAST_AREA = 0.015, 0.04
#: Largest tilt of a top (degrees).
TILT = 2.5
#: Largest wave of a rigid surface (m), as `Flatness.wave`, and the same in those of the floor, which show the scan's
#: own; no top waves more than `STIFFEST`, which is the limit for all that is higher than a bed.
STIFF, STIFFER, STIFFEST = 0.003, 1.6, 0.0045
#: Share of a patch that must lie on its plane.
COVERED = 0.85
#: Spacing of the rays that measure a patch (m).
FINE = 0.01
#: Highest seat (m), how far from the patch its back begins (m), at which heights above the seat it is looked for (m).
SEAT, BACK_REACH, BACK_RISES = 0.6, 0.27, (0.14, 0.18, 0.24, 0.30)
#: A back ends this far above the seat, at least this high above the floor (m): what rises on is a wall, unless it is
#: this far behind the back (m).
BACK_TOP, BACK_TOP_ABOVE_FLOOR, BACK_DEPTH = 0.8, 1.3, 0.12
#: A surface that dips this far below the patch, over this distance, before what rises behind it has a gap (m): that is
#: no back of it. Chairs have a narrow one.
GAP = (0.07, 0.04)
#: Share of a side along which a back rises; the same for a patch of the size of a chair (m), whose back may be bars.
BACKED, CHAIR_BACKED, CHAIR = 0.6, 0.3, 0.5
#: Least depth of a seat before its back, and least free height above it (m).
SEAT_DEPTH, SEAT_FREE = 0.25, 0.45
#: What continues a surface within this height (m) belongs to the same body; a low one of these sides (m) is a bed, and
#: so is a low patch of this area (m²).
BODY, BED, LARGEST_TABLE = 0.08, (0.75, 1.5), 1.5
#: What rises on three sides and has no board this near above it is no compartment of a shelf (m).
NICHE = 0.5
#: What stands behind a shelf is this near, and is looked for this far below its top (m).
SHELF_REACH, SHELF_BELOW = 0.35, 0.12
_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, eq=False)
class Patch:
    """A level rectangle: ``corner`` (3,) + a·``along``[0] + b·``along``[1], 0 ≤ a, b ≤ ``size`` (m).

    Attributes:
        corner: its height is that of the plane fitted to the rectangle, in the middle.
        along: (2, 3) horizontal unit vectors.
        size: (2,) metres.
        clearance: free height above it (m).
        flat: how flat it is.
        body: (2,) the smaller and the larger side of all that continues it nearly level (m).
    """

    corner: Array
    along: Array
    size: Array
    clearance: float
    flat: Flatness
    body: Array

    @property
    def middle(self) -> Array:
        """(3,)."""
        return np.asarray(self.corner + self.size @ self.along / 2)

    def sides(self) -> Iterator[tuple[Array, Array, float, float]]:
        """For each side: its outward normal, its direction, its length, and the depth of the patch before it."""
        for k in (0, 1):
            for sign in (1.0, -1.0):
                yield sign * self.along[k], self.along[1 - k], float(self.size[1 - k]), float(self.size[k])


@dataclass(frozen=True, eq=False)
class ScanRays:
    """What a patch is judged against: rays, the floor's height, and how much the floor waves (m)."""

    caster: RayCaster
    floor: float
    wave: float

    def distance(self, points: Array, direction: Array) -> Array:
        """(...) distance from points (..., 3) along one direction, metres; at most 1 km."""
        flat = points.reshape(-1, 3)
        found, _ = self.caster.closest(flat, np.broadcast_to(direction, flat.shape))
        return np.minimum(found.astype(np.float64), 1e3).reshape(points.shape[:-1])

    @property
    def stiff(self) -> float:
        """Largest wave of a rigid top (m)."""
        return min(max(STIFF, STIFFER * self.wave), STIFFEST)


def find_tops(layers: Layers, around: ScanRays, room: Room) -> list[Support]:
    """Worktops, tables and shelves."""
    return [support_of(patch, around, room.name) for patch in find_patches(layers, around) if not fault(patch, around)]


def band_of(relative: float) -> Band:
    """The kind of a top ``relative`` metres above the floor."""
    return next((band for band in BANDS if relative <= band.high + 0.02), BANDS[-1])


def find_patches(layers: Layers, around: ScanRays) -> Iterator[Patch]:
    """The level rectangles of a room, whatever they belong to."""
    relative = layers.height - around.floor
    with np.errstate(invalid="ignore"):
        reach = (relative >= BANDS[0].low - BODY) & (relative <= BANDS[-1].high + BODY)
        left = (
            (layers.clearance >= min(band.free for band in BANDS))
            & (relative >= BANDS[0].low)
            & (relative <= BANDS[-1].high)
        )
    every = np.where(reach, relative, np.inf)
    least = LEAST_AREA / CELL**2
    while left.any():
        counts = np.convolve(np.bincount((relative[left] * 100).astype(np.int64)), [1, 1, 1], mode="same")
        if counts.max() < least:
            return
        level = (float(np.argmax(counts)) + 0.5) / 100
        with np.errstate(invalid="ignore"):
            near = left & (np.abs(relative - level) <= LEVEL)
        left &= ~near
        body, _ = ndimage.label((np.abs(every - level) <= BODY).any(axis=2), np.ones((3, 3)))
        surfaces, count = ndimage.label(filled(np.asarray(near.any(axis=2))))
        for number in range(1, count + 1):
            mask = np.asarray(surfaces == number)
            if mask.sum() >= least:
                mask, own = _on_plane(relative, left | near, near & mask[..., None])
                left &= ~own
                sides = _sides(body == np.bincount(body[mask]).argmax())
                yield from _patches_in(
                    mask, np.where(own, layers.clearance, np.inf).min(axis=2), layers, level, sides, around
                )


def _on_plane(relative: Array, free: Mask, own: Mask) -> tuple[Mask, Mask]:
    """The surface around hits ``own`` (NX, NZ, L), extended along its plane: a tilted table crosses several levels.

    Returns:
        cells (NX, NZ), and hits (NX, NZ, L).
    """
    known = np.asarray(own.any(axis=2))
    height = np.where(own, relative, -np.inf).max(axis=2)
    plane = fit_plane(height, known, CELL)
    if math.hypot(plane[0], plane[1]) > math.tan(math.radians(TILT)):
        return known, own
    with np.errstate(invalid="ignore"):
        close = np.abs(relative - plane_on(plane, known.shape, CELL)[..., None]) <= LEVEL
    near = np.asarray(free & close)
    surfaces, _ = ndimage.label(filled(np.asarray(near.any(axis=2))))
    ours = np.asarray(surfaces == np.bincount(surfaces[known & (surfaces > 0)], minlength=2).argmax())
    return np.asarray(ours), near & ours[..., None]


def _sides(mask: Mask) -> Array:
    """(2,) smaller and larger side of the smallest rectangle around a mask of cells, metres."""
    (_, sides, _) = cv2.minAreaRect(np.argwhere(mask).astype(np.float32))
    return np.sort(np.asarray(sides, dtype=np.float64) + 1) * CELL


def _patches_in(
    mask: Mask, clearance: Array, layers: Layers, level: float, body: Array, around: ScanRays
) -> Iterator[Patch]:
    """The largest rectangles of one surface, parallel to the axes or, if they are larger, to the surface."""
    least = math.ceil(band_of(level).width / CELL - 1e-6)
    best: tuple[int, float, Array, list[tuple[int, int, int, int]]] | None = None
    angle = math.radians(float(cv2.minAreaRect(np.argwhere(mask).astype(np.float32))[2]) % 90.0)
    for turn in (0.0, angle):
        cells = _turned(mask, turn)
        inside = _lookup(mask, cells)
        found = list(rectangles(inside, least, 6))
        area = found[0][2] * found[0][3] if found else 0
        # Ten per cent more, so that a surface along the axes keeps to them.
        if best is None or area > 1.1 * best[0]:
            best = (area, turn, cells, found)
    assert best is not None
    _, turn, cells, found = best
    first = np.array([math.cos(turn), 0.0, math.sin(turn)])
    along = np.stack([first, np.array([-first[2], 0.0, first[0]])])
    for r, c, rows, columns in found:
        block = cells[r : r + rows, c : c + columns]
        own = _lookup(mask, block)
        free = float(clearance[tuple(np.round(block[own]).astype(np.int64).T)].min())
        x, z = np.array([layers.x[0], layers.z[0]]) + cells[r, c] * CELL
        corner = np.array([x, around.floor + level, z]) - along.sum(axis=0) * CELL / 2
        size = np.array([rows, columns]) * CELL
        yield _measured(corner, along, size, free, body, around)


def _turned(mask: Mask, turn: float) -> Array:
    """(R, C, 2) places, in cells of ``mask``, of a grid that is turned by ``turn`` radians and covers the mask."""
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    places = np.argwhere(mask) @ rotation.T
    low, high = np.floor(places.min(axis=0)), np.ceil(places.max(axis=0))
    grid = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij"), axis=-1)
    return np.asarray(grid @ rotation)


def _lookup(mask: Mask, cells: Array) -> Mask:
    """Whether each of the places (..., 2) lies in ``mask``."""
    index = np.round(cells).astype(np.int64)
    inside = np.asarray(((index >= 0) & (index < mask.shape)).all(axis=-1))
    index = np.where(inside[..., None], index, 0)
    return inside & mask[index[..., 0], index[..., 1]]


def _measured(corner: Array, along: Array, size: Array, clearance: float, body: Array, around: ScanRays) -> Patch:
    """A patch with its flatness, from fine rays, at the height of the plane that they find."""
    start = min(0.08, 0.6 * clearance)
    a, b = (np.arange(FINE / 2, n, FINE) for n in size)
    points = corner + a[:, None, None] * along[0] + b[None, :, None] * along[1]
    height = start - around.distance(points + start * _UP, -_UP)
    flat = flatness(height, np.abs(height) <= 0.06, FINE)
    if math.isfinite(flat.tilt) and flat.covered:
        corner = corner + (flat.offset + flat.slope[0] * size[0] / 2 + flat.slope[1] * size[1] / 2) * _UP
    return Patch(corner, along, size, clearance, flat, body)


def fault(patch: Patch, around: ScanRays) -> str:
    """Why nothing is put on a patch; "" if things can stand there."""
    flat, relative = patch.flat, float(patch.corner[1] - around.floor)
    band = band_of(relative)
    if flat.covered < COVERED:
        return "is not level"
    if flat.tilt > TILT:
        return f"slopes by {flat.tilt:.1f}°"
    if flat.wave > (around.stiff if band is BANDS[0] else STIFFEST):
        return f"is soft or cluttered: it waves by {1000 * flat.wave:.1f} mm"
    if patch.size.min() < band.width - 1e-6:
        return "is narrow"
    if patch.clearance < band.free:
        return "has too little free above it"
    if band is BANDS[0] and (np.prod(patch.size) > LARGEST_TABLE or (patch.body >= BED).all()):
        return "is as large as a bed"
    shares = [(back_share(patch, around, *side[:3]), side[3]) for side in patch.sides()]
    rising = sum(share >= BACKED for share, _ in shares)
    if rising == 4 or (rising == 3 and patch.clearance >= NICHE):
        return "has an edge around it, as a vessel, a lampshade or a seat with arms has"
    needed = CHAIR_BACKED if patch.size.max() <= CHAIR else BACKED
    seat = relative <= SEAT and patch.clearance >= SEAT_FREE
    if seat and any(share >= needed and depth >= SEAT_DEPTH for share, depth in shares):
        return "is a seat: a back rises behind it"
    if band.kind == "shelf" and not _is_held(patch, around):
        return "hangs in the room"
    return ""


def back_share(patch: Patch, around: ScanRays, normal: Array, along: Array, length: float) -> float:
    """Share of one side of a patch along which a back rises from it.

    A back begins within `BACK_REACH`, without a gap between, and ends: where it ends, rays find nothing, or a wall that
    is at least `BACK_DEPTH` farther. A wall, a window's reveal or a tiled splashback is no back.
    """
    depth = float(np.abs(patch.size @ (patch.along @ normal)))
    places = np.arange(-length / 2 + 0.02, length / 2 - 0.019, 0.04)
    edge = patch.middle + normal * (depth / 2 - 0.02) + places[:, None] * along
    near = around.distance(edge[:, None] + np.array(BACK_RISES)[:, None] * _UP, normal).min(axis=1)
    top = max(BACK_TOP, BACK_TOP_ABOVE_FLOOR - float(patch.corner[1] - around.floor))
    behind = around.distance(edge + top * _UP, normal)
    # A back may lean: between the patch and where it is met, the surface is looked for from above it.
    start = min(BACK_RISES[-1], patch.clearance - 0.02)
    steps = np.arange(0.03, BACK_REACH, FINE)
    height = start - around.distance(edge[:, None] + steps[:, None] * normal + start * _UP, -_UP)
    gap = ((height < -GAP[0]) & (steps < near[:, None])).sum(axis=1) * FINE
    return float(((near <= BACK_REACH) & (behind >= near + BACK_DEPTH) & (gap < GAP[1])).mean())


def _is_held(patch: Patch, around: ScanRays) -> bool:
    """Whether a high patch has something upright close by, just below it: a wall, or the sides of its own body.

    Above it, the shade of a lamp would count.
    """
    for normal, along, length, depth in patch.sides():
        places = np.linspace(-0.4, 0.4, 5)[:, None] * length * along
        edge = patch.middle + normal * (depth / 2 - 0.02) + places
        if (around.distance(edge - SHELF_BELOW * _UP, normal) <= SHELF_REACH).mean() >= BACKED:
            return True
    return False


def support_of(patch: Patch, around: ScanRays, room: str) -> Support:
    """A patch as a support; it looks where the room is open before it and closed behind it."""
    centre = patch.middle + min(0.15, patch.clearance / 2) * _UP
    ways = np.stack([patch.along[1], patch.along[0], -patch.along[1], -patch.along[0]])
    distance = np.minimum([float(around.distance(centre[None], way)[0]) for way in ways], 5.0)
    front = ways[int(np.argmax(np.round(distance - np.roll(distance, 2), 2)))]
    across, deep = (patch.size @ np.abs(patch.along @ way) for way in (np.cross(_UP, front), front))
    side = np.cross(_UP, front)
    origin = patch.middle - side * across / 2 - front * deep / 2
    kind = band_of(float(patch.corner[1] - around.floor)).kind
    u, v = vector(side * across), vector(front * deep)
    return Support(kind, room, vector(origin), u, v, (0.0, 1.0, 0.0), vector(front), patch.clearance)
