"""A room, measured for placement: its triangles, free floor, doorways and supports.

A scene may list its supports (the procedural apartments do). If it lists none in a room, as a scan, they are measured:
the floor and the sides of the room's box, and level patches of a height map as tables and worktops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.errors import Avs3dError
from generators.core.boxes import UprightBox
from generators.core.freespace import CELL, FreeSpace, triangles_near
from generators.core.rays import RayCaster
from generators.core.scene import F32, Room, Scene, Support, SupportKind

Array = NDArray[np.float64]

#: Upper limit of the measured roughness of a scan's surface (m); nothing is placed on a rougher one.
NOISIEST = 0.008
#: The four horizontal axes.
AXES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False)
class Site:
    """A measured room.

    Attributes:
        scene: the scene.
        room: the room.
        triangles: (F, 3, 3) all triangles in and near the room.
        caster: rays against them.
        space: the free floor before anything is placed.
        doors: for each of the room's doorways (D, 2) x and z of points every 5 cm across it.
    """

    scene: Scene
    room: Room
    triangles: F32
    caster: RayCaster
    space: FreeSpace
    doors: tuple[Array, ...]

    @classmethod
    def of(cls, scene: Scene, room: str) -> Site:
        """Measure ``room``.

        Raises:
            Avs3dError: if the room does not exist or holds no geometry.
        """
        box = scene.room(room)
        triangles = triangles_near(scene, [(box.low, box.high)])
        if not len(triangles):
            raise Avs3dError(f"{scene.name}/{room}: no geometry inside the room's box {box.low}–{box.high}; correct it")
        caster = RayCaster(triangles)
        space = FreeSpace.of(scene, room, triangles=triangles, caster=caster)
        return cls(scene, box, triangles, caster, space, find_doors(caster, box))

    @cached_property
    def _extents(self) -> tuple[F32, F32]:
        return (
            np.ascontiguousarray(self.triangles.min(axis=1).T),
            np.ascontiguousarray(self.triangles.max(axis=1).T),
        )

    @property
    def scanned(self) -> bool:
        """Whether the scene is a scan, whose surfaces ripple and have holes."""
        return self.scene.stage is not None

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a scan's surface about the true surface, metres; 0 for a scene that is not a scan.

        Measured on the free floor: heights on a 2.5 cm grid against the median of the 30 cm around each.
        """
        if not self.scanned or not len(self.space.points):
            return 0.0
        low, high = self.space.points.min(axis=0), self.space.points.max(axis=0)
        x, z = (np.arange(a, b + 1e-9, 0.025) for a, b in zip(low, high, strict=True))
        grid = np.stack([g.reshape(-1) for g in np.meshgrid(x, z, indexing="ij")], axis=1)
        start = self.space.floor + 0.1
        rays = np.stack([grid[:, 0], np.full(len(grid), start), grid[:, 1]], axis=1)
        distance, _ = self.caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
        height = 0.1 - np.minimum(distance.astype(np.float64), 1e3)
        flat = np.where(np.abs(height) <= 0.05, height, 0.0).reshape(len(x), len(z))
        rest = (flat - ndimage.median_filter(flat, size=13, mode="nearest")).reshape(-1)
        rest = rest[self.space.contains(grid) & (np.abs(height) <= 0.05)]
        return float(min(1.4826 * np.median(np.abs(rest)), NOISIEST)) if len(rest) >= 50 else 0.0

    def collides(self, box: UprightBox, tilt: Array | None = None) -> bool:
        """Whether the solid box meets a triangle of the room; ``tilt`` (3, 3) turns the box about its centre first."""
        low, high = self._extents
        near = np.ones(len(self.triangles), dtype=bool)
        reach = (
            box if tilt is None else box.grown(float(np.linalg.norm(box.half) * np.linalg.norm(tilt - np.eye(3), 2)))
        )
        for axis, (least, most) in enumerate(reach.bounds.T):
            near &= (low[axis] <= most) & (high[axis] >= least)
        triangles = self.triangles[near]
        if tilt is not None:
            triangles = ((triangles.astype(np.float64) - box.centre) @ tilt + box.centre).astype(np.float32)
        return bool(box.hits_triangles(triangles).any())

    @property
    def name(self) -> str:
        """``scan/room``."""
        return f"{self.scene.name}/{self.room.name}"

    def supports(self, kind: SupportKind) -> tuple[Support, ...]:
        """The room's supports of one kind: those that the scene lists, or measured ones if it lists none."""
        named = tuple(s for s in self.scene.supports if s.room == self.room.name)
        return tuple(s for s in named or self.measured if s.kind == kind)

    @cached_property
    def measured(self) -> tuple[Support, ...]:
        """Supports measured on the room's geometry."""
        return (_floor_of(self.room), *_walls_of(self.room), *find_surfaces(self))


def find_doors(caster: RayCaster, room: Room) -> tuple[Array, ...]:
    """The doorways in the room's outline, where rays leave the room at every height: (D, 2) points every 5 cm of each.

    An opening wider than 2.4 m is not a door: it belongs to an open plan, or the room's box is too large.
    """
    low, high = np.asarray(room.low, dtype=np.float64), np.asarray(room.high, dtype=np.float64)
    inset, beyond = 0.3, 0.3
    levels = low[1] + np.array([0.3, 1.0, 1.7])
    found: list[Array] = []
    for normal in AXES:
        axis, other = (0, 2) if normal[0] else (2, 0)
        edge = high[axis] if normal[axis] > 0 else low[axis]
        along = np.arange(low[other] + 0.05, high[other], CELL)
        starts = np.zeros((len(along), len(levels), 3))
        starts[..., other] = along[:, None]
        starts[..., axis] = edge - inset * normal[axis]
        starts[..., 1] = levels
        rays = starts.reshape(-1, 3)
        distance, _ = caster.closest(rays, np.broadcast_to(normal, rays.shape))
        free = (distance.reshape(len(along), -1) > inset + beyond).all(axis=1)
        runs, count = ndimage.label(free)
        for run in range(1, count + 1):
            members = along[runs == run]
            if 0.5 <= len(members) * CELL <= 2.4:
                points = np.zeros((len(members), 2))
                points[:, 0 if other == 0 else 1] = members
                points[:, 1 if other == 0 else 0] = edge
                found.append(points)
    return tuple(found)


def _floor_of(room: Room) -> Support:
    low, high = room.low, room.high
    size = (high[0] - low[0], high[2] - low[2])
    return Support("floor", room.name, low, (size[0], 0, 0), (0, 0, size[1]), (0, 1, 0), (0, 0, 1), high[1] - low[1])


def _walls_of(room: Room) -> tuple[Support, ...]:
    """The four sides of the room's box; an infinite clearance marks that the wall itself must still be found."""
    (x0, y0, z0), (x1, _, z1) = room.low, room.high
    w, d = x1 - x0, z1 - z0
    rise = (0.0, 2.1, 0.0)
    sides: Sequence[tuple[tuple[float, float, float], ...]] = (
        ((x0, y0, z0), (w, 0, 0), (0, 0, 1)),
        ((x1, y0, z0), (0, 0, d), (-1, 0, 0)),
        ((x0, y0, z1), (w, 0, 0), (0, 0, -1)),
        ((x0, y0, z0), (0, 0, d), (1, 0, 0)),
    )
    return tuple(Support("wall", room.name, o, u, rise, n, n, math.inf) for o, u, n in sides)


def find_surfaces(site: Site) -> list[Support]:
    """Table tops and worktops of a scene that lists none, from a height map of the room.

    Rays straight down on a 5 cm grid from 1.35 m, below wall cupboards; level patches 0.35–1.25 m high become supports
    (their bounding rectangle; later, models are lowered onto the real surface). High and deep ones count as worktops.
    """
    centres = site.space.cell_centres()
    shape = site.space.walkable.shape
    start = 1.35
    rays = np.stack([centres[:, 0], np.full(len(centres), site.space.floor + start), centres[:, 1]], axis=1)
    distance, _ = site.caster.closest(rays, np.broadcast_to([0.0, -1.0, 0.0], rays.shape))
    height = (start - np.minimum(distance.astype(np.float64), 1e3)).reshape(shape)
    low, high = np.asarray(site.room.low)[[0, 2]], np.asarray(site.room.high)[[0, 2]]
    inside = ((centres > low) & (centres < high)).all(axis=1).reshape(shape)
    free = site.space.points
    out: list[Support] = []
    step = 0.02
    for level in np.arange(0.35, 1.25, step):
        patches, count = ndimage.label(inside & (np.abs(height - level - step / 2) <= step / 2))
        for patch in range(1, count + 1):
            cells = np.argwhere(patches == patch)
            if len(cells) < 20 or not len(free):
                continue
            a = site.space.origin + cells.min(axis=0) * CELL
            b = site.space.origin + (cells.max(axis=0) + 1) * CELL
            y = site.space.floor + float(np.median(height[cells[:, 0], cells[:, 1]]))
            middle = (a + b) / 2
            near = free[np.argsort(((free - middle) ** 2).sum(axis=1))[:40]].mean(axis=0) - middle
            along_x = abs(near[0]) > abs(near[1])
            sign = 1.0 if near[0 if along_x else 1] >= 0 else -1.0
            front = (sign, 0.0, 0.0) if along_x else (0.0, 0.0, sign)
            kind: SupportKind = "worktop" if level >= 0.8 and (b - a).min() >= 0.4 else "side_table"
            corner = (float(a[0]), y, float(a[1]))
            across, deep = (float(b[0] - a[0]), 0.0, 0.0), (0.0, 0.0, float(b[1] - a[1]))
            out.append(Support(kind, site.room.name, corner, across, deep, (0, 1, 0), front, 1.0))
    return out
