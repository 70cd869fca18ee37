"""A piece of furniture in its place (`Placed`), and a candidate place for one (`WallSpot`).

Furniture is turned by multiples of 90° (chairs by a few degrees more), so axis-aligned world boxes describe it.
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

#: Things of at most this height (m) are rugs and mats: people walk on them and furniture stands on them.
FLAT = 0.04
#: Boxes that overlap by less than this (m) only touch.
TOUCH = 2e-3
#: Corners of the acoustic twin's triangles for one box: 12 triangles.
_BOX_CORNERS = 36
#: Curtains that extend less than this (m) along an axis hang on a wall across it; rod and folds are 0.1 m deep.
_CURTAIN_DEPTH = 0.3


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
        corners = turned.acoustic_positions.reshape(-1, _BOX_CORNERS, 3).astype(np.float64)
        out = [(c.min(axis=0), c.max(axis=0)) for c in corners]
        for axis in (0, 2):
            if self.high[axis] - self.low[axis] < _CURTAIN_DEPTH:
                for low, high in out:
                    low[axis], high[axis] = self.low[axis], self.high[axis]
        return out


@dataclass(frozen=True, eq=False)
class WallSpot:
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


def turned_bounds(furniture: Furniture, yaw: Array) -> tuple[Array, Array]:
    """Lowest and highest corners (K, 3) of a piece at the origin that is turned by ``yaw`` (K,) degrees."""
    low, high = furniture.mesh.bounds.astype(np.float64)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    turned = corners @ rotation("y", yaw).transpose(0, 2, 1)
    return turned.min(axis=1), turned.max(axis=1)


def world_box(furniture: Furniture, position: Array, yaw: float) -> tuple[Array, Array]:
    """Axis-aligned world bounds of a turned piece."""
    low, high = turned_bounds(furniture, np.array([yaw], dtype=np.float64))
    return low[0] + position, high[0] + position


def origin_height(furniture: Furniture, bottom: float) -> float:
    """Height of a piece's origin above the floor that brings its lowest point to the height ``bottom``."""
    return bottom - float(furniture.mesh.bounds[0, 1])


def overlaps(low: Array, high: Array, lows: Array, highs: Array) -> NDArray[np.bool_]:
    """(K, N): which of K boxes meet which of N boxes by more than a touch."""
    inside = (low[:, None] < highs[None] - TOUCH) & (high[:, None] > lows[None] + TOUCH)
    return np.asarray(inside.all(axis=2))
