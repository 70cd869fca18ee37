"""Spots: places on a support where a model could stand or hang in a room.

Everything is measured on the room's triangles by ray casting, so that modelled flats and noisy scans are treated alike.
A spot already touches its support (the gap is `CONTACT`); on a scan, where it touches a few measured points, it is
settled later (generators/placement/contact.py). generators/placement/fitting.py tests whether it collides, blocks the
way or is hidden.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.core.boxes import yaw_matrix
from generators.core.freespace import CELL
from generators.core.scene import Mesh, Support
from generators.placement.site import AXES, Site

Array = NDArray[np.float64]

#: Gap (m) between an object and its support: contact, without coincident faces.
CONTACT = 0.0002
#: Largest deviation of the support from a plane under the footprint (m); scanned floors deviate by a centimetre.
FLATNESS = 0.010
#: Largest deviation of a wall from a plane behind an appliance (m): more than a skirting board, less than a pipe.
BACK_FLATNESS = 0.030
#: Largest step back of a wall above an appliance (m): a ledge, a tiled front wall, a recessed window.
RECESS = 0.12
#: Largest distance of a wall from the side of the room's box (m); a scan's box is drawn by hand.
BOX_SLACK = 0.25
#: Extra distances from the wall (m) that are tried; more on a scan, whose wall is rougher than the few rays show.
_EASE, _SCAN_EASE = (0.0, 0.006, 0.012), (0.0, 0.006, 0.012, 0.02, 0.03)
#: On a scan, whose surface is rough, this many of its standard deviations are added to all of these tolerances.
ROUGH = 5.0
#: On a scan, share of the measuring rays that may go through holes.
HOLES = 0.16
#: Spacing of the candidate spots (m).
SPACING = 0.04


@dataclass(frozen=True, eq=False)
class Spot:
    """One candidate place: the model's origin and yaw on a support; spots are tried in ascending ``rank``.

    ``tilt`` is a rotation vector (radians, world axes), applied after the yaw: a scanned surface is not quite level.
    """

    support: Support
    position: Array
    yaw: float
    rank: float
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Contact:
    """The contact rectangle of a model with its support: ``low`` and ``high`` (2,) along two of the model's axes."""

    low: Array
    high: Array

    @classmethod
    def below(cls, mesh: Mesh) -> Contact:
        """Extent along x and z of the geometry within 2 cm of the model's lowest point."""
        return cls._near(mesh, 1, [0, 2], 0.02)

    @classmethod
    def behind(cls, mesh: Mesh) -> Contact:
        """Extent along x and y of the geometry within 2 cm of the model's rearmost point."""
        return cls._near(mesh, 2, [0, 1], 0.02)

    @classmethod
    def _near(cls, mesh: Mesh, axis: int, others: list[int], depth: float) -> Contact:
        points = mesh.positions.reshape(-1, 3).astype(np.float64)
        touching = points[points[:, axis] <= points[:, axis].min() + depth][:, others]
        return cls(touching.min(axis=0), touching.max(axis=0))

    def grid(self, count: int) -> Array:
        """(count², 2) points on a grid over the rectangle, with its corners."""
        edge = np.minimum(0.002, (self.high - self.low) / 4)
        x, y = (np.linspace(a, b, count) for a, b in zip(self.low + edge, self.high - edge, strict=True))
        return np.stack([g.reshape(-1) for g in np.meshgrid(x, y, indexing="ij")], axis=1)


def standing(
    site: Site, mesh: Mesh, origins: Array, yaws: Array, tolerance: float = 0.03
) -> tuple[NDArray[np.intp], Array]:
    """Lower a model onto the surface below it.

    Args:
        site: the room.
        mesh: the model.
        origins: (N, 3) the model's origin, y at the expected height of the support.
        yaws: (N,) radians.
        tolerance: how far the support may be from the expected height.

    Returns:
        indices (M,) of the origins at which the model stands fully on one level surface, and these origins (M, 3)
        in contact.
    """
    grid = Contact.below(mesh).grid(5)
    lowest = float(mesh.bounds[0, 1])
    sin, cos = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
    x = origins[:, :1] + cos * grid[:, 0] + sin * grid[:, 1]
    z = origins[:, 2:] - sin * grid[:, 0] + cos * grid[:, 1]
    start = 0.10
    y = np.broadcast_to(origins[:, 1:2] + start, x.shape)
    rays = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    distance, _ = site.caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
    height = (start - np.minimum(distance.astype(np.float64), 1e3)).reshape(x.shape)
    top, flat = _level(height, site.noise)
    good = flat & (np.abs(top) <= tolerance)
    keep = np.flatnonzero(good)
    out = origins[keep].copy()
    out[:, 1] += top[keep] + CONTACT - lowest
    return keep, out


def _level(height: Array, noise: float) -> tuple[Array, NDArray[np.bool_]]:
    """Find the height (N,) of first contact from the hits of rays (N, K), and whether the surface is flat (N,).

    The K rays form a square grid. On modelled geometry the surface is also level: no point may be more than `FLATNESS`
    lower than the highest. On a scan it may be tilted, for objects are, too (generators/placement/contact.py),
    and a few rays may go through holes.
    """
    top = height.max(axis=1)
    if noise <= 0:
        return top, top - height.min(axis=1) <= FLATNESS
    middle = np.median(height, axis=1, keepdims=True)
    holes = height < middle - 0.05
    known = np.where(holes, middle, height)
    side = math.isqrt(height.shape[1])
    terms = np.column_stack([*(index.reshape(-1) for index in np.indices((side, side))), np.ones(side * side)])
    rest = np.where(holes, 0.0, known - known @ (terms @ np.linalg.pinv(terms)).T)
    rough = np.ptp(rest, axis=1) <= FLATNESS + ROUGH * noise
    return known.max(axis=1), rough & (holes.mean(axis=1) <= HOLES)


def on_top(site: Site, mesh: Mesh, support: Support, rng: Generator, *, jitter: float, rear: float) -> list[Spot]:
    """Spots on a worktop, shelf or table top; the model faces the support's front, turned by up to ``jitter`` radians.

    ``rear`` (0–1) prefers spots at the back of the support.
    """
    origin, u, v = (np.asarray(c, dtype=np.float64) for c in (support.origin, support.u, support.v))
    length = np.array([np.linalg.norm(u), np.linalg.norm(v)])
    low, high = mesh.bounds.astype(np.float64)
    if (length < 0.05).any() or high[1] - low[1] > support.clearance:
        return []
    front = np.asarray(support.front, dtype=np.float64)
    a, b = (_centred(n, SPACING / 2 if n < 0.6 else SPACING) for n in length)
    ab = np.stack([g.reshape(-1) for g in np.meshgrid(a, b, indexing="ij")], axis=1)
    # A model that is not turned may fit where a turned one does not.
    turns = np.concatenate([rng.uniform(-jitter, jitter, len(ab)), np.zeros(len(ab))])
    late = np.repeat([0.0, 1.0], len(ab))
    ab = np.tile(ab, (2, 1))
    centres = origin + ab[:, :1] * u + ab[:, 1:] * v
    yaws = math.atan2(front[0], front[2]) + turns
    ranks = rng.uniform(0.0, 0.9, len(ab))
    depth = (centres - origin) @ front
    span = max(float(np.ptp(depth)), 1e-6)
    ranks = (1 - rear) * ranks + rear * 0.9 * (depth - depth.min()) / span + late
    # The footprint's centre goes to the sample; its corners must lie on the rectangle.
    contact = Contact.below(mesh)
    middle = (contact.low + contact.high) / 2
    half = (contact.high - contact.low) / 2
    sin, cos = np.sin(yaws)[:, None], np.cos(yaws)[:, None]
    origins = centres.copy()
    origins[:, 0] -= (cos * middle[0] + sin * middle[1])[:, 0]
    origins[:, 2] -= (-sin * middle[0] + cos * middle[1])[:, 0]
    inside = np.ones(len(ab), dtype=bool)
    for sx in (-1, 1):
        for sz in (-1, 1):
            corner = centres.copy()
            corner[:, 0] += (cos * sx * half[0] + sin * sz * half[1])[:, 0]
            corner[:, 2] += (-sin * sx * half[0] + cos * sz * half[1])[:, 0]
            for axis, n in ((u, length[0]), (v, length[1])):
                t = (corner - origin) @ axis / n
                inside &= (t >= -0.005) & (t <= n + 0.005)
    kept = np.flatnonzero(inside)
    stands, settled = standing(site, mesh, origins[kept], yaws[kept])
    return [Spot(support, p, float(yaws[kept[i]]), float(ranks[kept[i]])) for i, p in zip(stands, settled, strict=True)]


def _centred(length: float, spacing: float) -> Array:
    """Fractions (K,) of ``length`` metres, ``spacing`` apart, symmetric about the middle."""
    steps = math.floor(length / 2 / spacing)
    return np.asarray(0.5 + np.arange(-steps, steps + 1) * spacing / length)


def against_wall(site: Site, mesh: Mesh, support: Support, rng: Generator, *, gap: tuple[float, float]) -> list[Spot]:
    """Spots on the floor with the back to a wall, ``gap`` (least, most) metres in front of the first surface behind.

    A wall is a surface that is flat behind the whole model and continues above it, up to 1.9 m (a window may be
    recessed). The side of the room's box is preferred; any other surface as tall and flat is used only if those spots
    fail.
    """
    low, high = mesh.bounds.astype(np.float64)
    width, height, depth = high - low
    cells = site.space.points
    cells = cells[np.unique(np.round(cells / (2 * CELL)).astype(np.int64), axis=0, return_index=True)[1]]
    floor = site.space.floor
    outline = ((site.room.low[0], site.room.low[2]), (site.room.high[0], site.room.high[2]))
    levels = floor + np.concatenate([np.array([0.06, 0.3, 0.6, 0.95]) * height, [1.3, 1.6, 1.9]])
    if not len(cells):
        return []
    walls = {(round(s.normal[0], 3), 0.0, round(s.normal[2], 3)) for s in site.supports("wall")}
    spots: list[Spot] = []
    for normal in (*AXES, *sorted(walls - set(AXES))):
        n = np.array([normal[0], normal[2]]) / math.hypot(normal[0], normal[2])
        side = np.array([n[1], -n[0]])
        offsets = np.array([-0.49, 0.0, 0.49]) * width
        starts = cells[:, None, None, :] + offsets[:, None] * side
        starts = np.broadcast_to(starts, (len(cells), len(levels), 3, 2))
        y = np.broadcast_to(levels[:, None], starts.shape[:-1])
        rays = np.stack([starts[..., 0], y, starts[..., 1]], axis=-1).reshape(-1, 3)
        distance, _ = site.caster.closest(rays, np.broadcast_to([-n[0], 0.0, -n[1]], rays.shape))
        distance = np.minimum(distance.astype(np.float64), 1e3).reshape(len(cells), len(levels), 3)
        behind, above = np.asarray(distance[:, :4], dtype=np.float64).reshape(len(cells), -1), distance[:, 4:, 1]
        nearest = behind.min(axis=1)
        if site.noise > 0:
            behind = _patched(behind)
        wall = (np.abs(above - nearest[:, None] - RECESS / 2) <= RECESS / 2 + BACK_FLATNESS).sum(axis=1) >= 2
        flat = behind.max(axis=1) - nearest <= BACK_FLATNESS + ROUGH * site.noise
        good = wall & flat & (nearest <= depth + 1.0)
        if not good.any():
            continue
        gaps = rng.uniform(*gap, size=len(cells))
        middle = cells - n * (nearest - gaps - depth / 2)[:, None]
        yaw = math.atan2(n[0], n[1])
        centre = yaw_matrix(yaw) @ ((low + high) / 2)
        origins = np.stack([middle[:, 0] - centre[0], np.full(len(cells), floor), middle[:, 1] - centre[2]], axis=1)
        picked = np.flatnonzero(good)
        along = np.round(middle[picked] @ side / (2 * CELL)).astype(np.int64)
        back = np.round((middle[picked] @ n) / 0.02).astype(np.int64)
        picked = picked[np.unique(np.stack([along, back], axis=1), axis=0, return_index=True)[1]]
        faces = (cells[picked] - n * nearest[picked, None]) @ n
        side_of_box = max(np.array(corner) @ -n for corner in itertools.product(*zip(*outline, strict=True)))
        ranks = rng.uniform(0.0, 0.9, len(picked)) + (side_of_box + faces > BOX_SLACK)
        for rank, ease in enumerate(_SCAN_EASE if site.scanned else _EASE):
            eased = origins[picked] + ease * np.array([n[0], 0.0, n[1]])
            stands, settled = standing(site, mesh, eased, np.full(len(picked), yaw))
            spots += [Spot(support, p, yaw, float(ranks[i]) + 2.0 * rank) for i, p in zip(stands, settled, strict=True)]
    return spots


def _patched(distance: Array) -> Array:
    """Distances (N, K) to a scanned wall, without those of a few rays that went through holes."""
    holes = distance > np.median(distance, axis=1, keepdims=True) + 0.3
    few = holes.mean(axis=1, keepdims=True) <= HOLES
    return np.where(holes & few, distance.min(axis=1, keepdims=True), distance)


def open_floor(site: Site, mesh: Mesh, support: Support, rng: Generator, *, jitter: float) -> list[Spot]:
    """Spots on the free floor, near a wall first, facing the middle of the room within ``jitter`` radians."""
    every = site.space.cell_centres()
    low, high = np.asarray(site.room.low)[[0, 2]], np.asarray(site.room.high)[[0, 2]]
    # Anything nearer than half the footprint's smaller side would be inside it; every second cell is dense enough.
    width, _, depth = np.diff(mesh.bounds.astype(np.float64), axis=0)[0]
    even = (site.space.index(every) % 2 == 0).all(axis=1)
    fits = site.space.clearance(every) > 0.4 * min(width, depth) - 0.02
    every = every[((every > low) & (every < high)).all(axis=1) & fits & even]
    if not len(every):
        return []
    yaws = np.arctan2(*((low + high) / 2 - every).T) + rng.uniform(-jitter, jitter, len(every))
    to_wall = np.minimum(every - low, high - every).min(axis=1)
    ranks = rng.uniform(0.0, 0.3, len(every)) + 0.6 * np.minimum(to_wall, 1.0)
    bottom = mesh.bounds.astype(np.float64)
    middle = (bottom[0] + bottom[1]) / 2
    sin, cos = np.sin(yaws), np.cos(yaws)
    x = every[:, 0] - (cos * middle[0] + sin * middle[2])
    z = every[:, 1] - (-sin * middle[0] + cos * middle[2])
    origins = np.stack([x, np.full(len(every), site.space.floor), z], axis=1)
    stands, settled = standing(site, mesh, origins, yaws)
    return [Spot(support, p, float(yaws[i]), float(ranks[i])) for i, p in zip(stands, settled, strict=True)]


def on_wall(site: Site, mesh: Mesh, support: Support, rng: Generator, *, heights: tuple[float, float]) -> list[Spot]:
    """Spots on a wall with the middle of the model between two ``heights`` above the floor, metres."""
    origin, u, v = (np.asarray(c, dtype=np.float64) for c in (support.origin, support.u, support.v))
    normal = np.asarray(support.normal, dtype=np.float64)
    normal = normal * (1, 0, 1) / math.hypot(normal[0], normal[2])
    yaw = math.atan2(normal[0], normal[2])
    length = np.array([np.linalg.norm(u), np.linalg.norm(v)])
    a, b = (np.arange(0.0, n + 1e-9, SPACING) / max(n, 1e-9) for n in length)
    ab = np.stack([g.reshape(-1) for g in np.meshgrid(a, b, indexing="ij")], axis=1)
    if site.scanned and math.isfinite(support.clearance):
        # Beyond the patch the wall is not free, or none: the whole model hangs on the patch.
        half = (mesh.bounds[1] - mesh.bounds[0])[:2].astype(np.float64) / 2
        ab = ab[(np.minimum(ab, 1 - ab) * length >= half - 0.005).all(axis=1)]
    centres = origin + ab[:, :1] * u + ab[:, 1:] * v
    above = centres[:, 1] - site.space.floor
    centres = centres[(above >= heights[0]) & (above <= heights[1])]
    ranks = rng.uniform(0.0, 0.9, len(centres))
    low, high = mesh.bounds.astype(np.float64)
    grid = Contact.behind(mesh).grid(3)
    right = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
    local = grid - ((low + high) / 2)[:2]
    ahead = 0.25
    points = centres[:, None] + local[:, :1] * right + local[:, 1:] * np.array([0.0, 1.0, 0.0]) + ahead * normal
    distance, _ = site.caster.closest(points.reshape(-1, 3), np.broadcast_to(-normal, (points.size // 3, 3)))
    out = ahead - np.minimum(distance.astype(np.float64), 1e3).reshape(points.shape[:2])
    top, flat = _level(out, site.noise)
    # The side of a scan's box only gives the approximate position of the wall.
    reach = 0.03 if math.isfinite(support.clearance) else ahead
    good = flat & (np.abs(top) <= reach + ROUGH * site.noise)
    rotation = yaw_matrix(yaw)
    anchor = rotation @ np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return [
        Spot(support, centres[i] + normal * (top[i] + CONTACT) - anchor, yaw, float(ranks[i]))
        for i in np.flatnonzero(good)
    ]
