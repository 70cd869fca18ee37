"""A piece of furniture in its place, and a place where one could stand.

Furniture stands at yaws of 90° (or slightly off), so axis-aligned world boxes describe it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import WallFrame
from generators.assets.furniture import Furniture
from generators.assets.shapes import rotation

Array = NDArray[np.float64]

#: Things lower than this are lain or stood upon (rugs, mats).
FLAT = 0.04
#: Boxes that meet by less than this touch, metres.
TOUCH = 2e-3


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece of furniture in its place.

    Attributes:
        furniture: the piece in its own frame.
        position: (3,) its origin in the world.
        yaw: degrees about +Y.
        low: (3,) lowest corner of its world box.
        high: (3,) highest corner.
    """

    furniture: Furniture
    position: Array
    yaw: float
    low: Array
    high: Array

    @property
    def flat(self) -> bool:
        """Whether other things may stand on it (a rug)."""
        return self.furniture.mount == "floor" and bool(self.high[1] <= FLAT)

    @cached_property
    def boxes(self) -> list[tuple[Array, Array]]:
        """World boxes that nothing may enter: one, or for curtains the two bunches of cloth at the window's sides."""
        if self.furniture.kind != "curtains":
            return [(self.low, self.high)]
        turned = self.furniture.mesh.transformed(rotation("y", self.yaw), self.position)
        corners = turned.acoustic_positions.reshape(-1, 36, 3).astype(np.float64)
        out = [(c.min(axis=0), c.max(axis=0)) for c in corners]
        for axis in (0, 2):
            if self.high[axis] - self.low[axis] < 0.3:
                for low, high in out:
                    low[axis], high[axis] = self.low[axis], self.high[axis]
        return out


@dataclass(frozen=True, eq=False)
class Spot:
    """A candidate place at a wall: the middle of the piece is ``along`` the wall."""

    wall: WallFrame
    along: float
    position: Array
    yaw: float
    low: Array
    high: Array

    @property
    def corner(self) -> float:
        """Metres between the piece and the nearer end of its wall."""
        a, b = self.extent
        return max(0.0, min(a, self.wall.length - b))

    @property
    def extent(self) -> tuple[float, float]:
        """The interval of the wall that the piece covers."""
        axis = int(np.argmax(np.abs(self.wall.u)))
        return self.wall.along(self.low[axis], self.high[axis])

    @property
    def centre(self) -> Array:
        """(3,) middle of its box."""
        return (self.low + self.high) / 2


def world_box(furniture: Furniture, position: Array, yaw: float) -> tuple[Array, Array]:
    """Axis-aligned world bounds of a turned piece."""
    low, high = furniture.mesh.bounds.astype(np.float64)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    moved = corners @ rotation("y", yaw).T + position
    return moved.min(axis=0), moved.max(axis=0)


def overlaps(low: Array, high: Array, lows: Array, highs: Array) -> NDArray[np.bool_]:
    """(K, N): which of K boxes meet which of N boxes by more than a touch."""
    inside = (low[:, None] < highs[None] - TOUCH) & (high[:, None] > lows[None] + TOUCH)
    return np.asarray(inside.all(axis=2))
