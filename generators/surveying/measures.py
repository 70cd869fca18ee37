"""What a loaded scan offers in each room: walkable floor, doorways, supports, holes; and pictures of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.freespace import CELL, SENSOR_HEIGHT
from generators.core.low_discrepancy import fibonacci_directions
from generators.core.rays import RayCaster
from generators.core.scene import Room, Scene, Support
from generators.placement.site import Site
from generators.scans.patches import RefusedTop, refused_tops
from generators.vision.embree import EmbreeBackend

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

#: Rays that look for holes around a room, and how far below its ceiling the rays down begin (m).
_RAYS, _BELOW = 4000, 0.3
#: Side of a picture at eye height (pixels), and how far it looks down (degrees).
SIDE, DOWN = 480, 12.0
#: Headings of the pictures (degrees); each shows a part of the room that the others do not.
_HEADINGS = (45.0, 135.0, 225.0, 315.0)


@dataclass(frozen=True, eq=False)
class RoomMeasures:
    """A room as the generator will use it.

    Attributes:
        room: its name and box, on the floor that was found.
        supports: level tops and free patches of wall.
        refused: level tops on which nothing is put.
        doors: (D, 2) x and z of points across each doorway.
        walkable: (N, 2) x and z of the middles of walkable floor cells, 5 cm wide.
        holes: (H, 2) of cells of the floor through which one looks out of the scan.
        hole_share: of all cells of the floor.
        open_share: of the directions from the middle of the room in which there is no surface.
        stand: (3,) the eye at the walkable place that is farthest from everything.
    """

    room: Room
    supports: tuple[Support, ...]
    refused: tuple[RefusedTop, ...]
    doors: tuple[Array, ...]
    walkable: Array
    holes: Array
    hole_share: float
    open_share: float
    stand: Array

    @property
    def area(self) -> float:
        """Walkable floor, m²."""
        return len(self.walkable) * CELL**2

    def tops(self) -> list[Support]:
        """Supports on which things stand, the floor left out."""
        return [support for support in self.supports if support.kind not in ("floor", "wall")]

    def walls(self) -> list[Support]:
        """Free patches of wall."""
        return [support for support in self.supports if support.kind == "wall"]


def measure(site: Site) -> RoomMeasures:
    """Measure a room of a scan."""
    home, room = site.scene, site.room
    low, high = np.asarray(room.low), np.asarray(room.high)
    space = site.space.largest()
    clearance = space.clearance(space.points)
    # Without any walkable floor, the middle of the room has to do.
    spot = space.points[int(np.argmax(clearance))] if len(space.points) else (low + high)[[0, 2]] / 2
    stand = np.array([spot[0], low[1] + min(SENSOR_HEIGHT, 0.8 * (high[1] - low[1])), spot[1]])
    x, z = np.arange(low[0] + CELL / 2, high[0], CELL), np.arange(low[2] + CELL / 2, high[2], CELL)
    grid = np.stack([axis.reshape(-1) for axis in np.meshgrid(x, z, indexing="ij")], axis=1)
    start = np.insert(grid, 1, high[1] - _BELOW, axis=1)
    # All of the scan: what is missing in the room may be closed by the wall behind it.
    caster = RayCaster(home)
    _, face = caster.closest(start, np.broadcast_to([0.0, -1.0, 0.0], start.shape))
    _, around = caster.closest(stand, fibonacci_directions(_RAYS))
    holes = grid[face < 0]
    return RoomMeasures(
        room,
        tuple(site.supports("floor") + site.supports("wall") + _all_tops(site)),
        tuple(refused_tops(home.parts[0].mesh.positions, room, room.name)),
        site.doors,
        space.points,
        holes,
        len(holes) / max(len(grid), 1),
        float((around < 0).mean()),
        stand,
    )


def _all_tops(site: Site) -> tuple[Support, ...]:
    return site.supports("side_table") + site.supports("worktop") + site.supports("shelf")


def eye_pictures(home: Scene, measures: Sequence[RoomMeasures], count: int = 4) -> list[tuple[str, float, Picture]]:
    """Pictures at eye height, ``count`` in all: (room, heading in degrees, (SIDE, SIDE, 3) sRGB)."""
    session = EmbreeBackend().open(home, Intrinsics.from_fov(SIDE, 90.0))
    out = []
    try:
        for number in range(count):
            each = measures[number % len(measures)]
            heading = _HEADINGS[(number // len(measures)) % len(_HEADINGS)] if len(measures) > 1 else _HEADINGS[number]
            pose = Pose.from_yaw(each.stand, np.radians(heading), -np.radians(DOWN))
            out.append((each.room.name, heading, session.render(pose).rgb))
    finally:
        session.close()
    return out
