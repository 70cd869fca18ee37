"""Small rooms made of axis-aligned boxes, so that tests can check placement and paths in closed form.

`Toy.solids` lists every box as (low, high); walls, floor and ceiling too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from shapely.geometry import Polygon, box
from shapely.ops import unary_union

from generators.assets.catalogue import Model
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, Scene, Support, SupportKind

PLAIN = Material("plain", "plaster")
Vector = tuple[float, float, float]
Solid = tuple[Vector, Vector]
THICK = 0.12
#: Width, height, depth and mount of a plain box of each category.
SIZES: dict[str, tuple[Vector, str]] = {
    "washing_machine": ((0.60, 0.85, 0.60), "floor"),
    "toilet": ((0.37, 0.78, 0.68), "floor"),
    "vacuum_cleaner": ((0.30, 0.30, 0.45), "floor"),
    "microwave": ((0.48, 0.28, 0.36), "surface"),
    "oven": ((0.46, 0.30, 0.38), "surface"),
    "dishwasher": ((0.60, 0.85, 0.60), "floor"),
    "kettle": ((0.24, 0.24, 0.20), "surface"),
    "fan": ((0.40, 1.30, 0.40), "floor"),
    "radio": ((0.30, 0.18, 0.14), "surface"),
    "coffee_machine": ((0.25, 0.38, 0.35), "surface"),
    "clock": ((0.30, 0.30, 0.05), "wall"),
    "telephone": ((0.20, 0.10, 0.20), "surface"),
}


@dataclass
class Toy:
    """A room with its inside at the origin: ``size`` = x, y, z extents."""

    name: str = "kitchen"
    size: Vector = (4.0, 2.6, 5.0)
    solids: list[Solid] = field(default_factory=list)
    supports: list[Support] = field(default_factory=list)

    def add(self, low: Vector, high: Vector) -> Toy:
        self.solids.append((low, high))
        return self

    def shell(self, *, door: tuple[float, float] | None = None) -> Toy:
        """Floor, ceiling and four walls; ``door`` = start and end of an opening (2.05 m high) along x at z = depth."""
        w, h, d = self.size
        t = THICK
        self.add((-1, -0.1, -1), (w + 1, 0, d + 1)).add((-1, h, -1), (w + 1, h + 0.1, d + 1))
        self.add((-t, 0, -t), (0, h, d + t)).add((w, 0, -t), (w + t, h, d + t)).add((0, 0, -t), (w, h, 0))
        if door:
            self.add((0, 0, d), (door[0], h, d + t)).add((door[1], 0, d), (w, h, d + t))
            self.add((door[0], 2.05, d), (door[1], h, d + t))
        else:
            self.add((0, 0, d), (w, h, d + t))
        self._support("floor", (0, 0, 0), (w, 0, 0), (0, 0, d), (0, 0, 1), h)
        for origin, u, normal in (
            ((0, 1.2, 0), (w, 0, 0), (0, 0, 1)),
            ((0, 1.2, 0), (0, 0, d), (1, 0, 0)),
            ((w, 1.2, 0), (0, 0, d), (-1, 0, 0)),
        ):
            self.supports.append(Support("wall", self.name, origin, u, (0, 0.9, 0), normal, normal, 0.3))
        return self

    def table(self, kind: SupportKind, low: Vector, high: Vector, front: Vector, clearance: float = 0.5) -> Toy:
        """A solid block whose top is a support."""
        (x0, _, z0), (x1, y, z1) = low, high
        self.add(low, high)
        self._support(kind, (x0, y, z0), (x1 - x0, 0, 0), (0, 0, z1 - z0), front, clearance)
        return self

    def _support(self, kind: SupportKind, origin: Vector, u: Vector, v: Vector, front: Vector, clear: float) -> None:
        self.supports.append(Support(kind, self.name, origin, u, v, (0, 1, 0), front, clear))

    @property
    def scene(self) -> Scene:
        builder = MeshBuilder()
        for low, high in self.solids:
            size, centre = np.subtract(high, low), np.add(high, low) / 2
            builder.box(size.tolist(), centre.tolist(), PLAIN)
        room = Room(self.name, (0.0, 0.0, 0.0), self.size)
        return Scene("toy", (Part("room", builder.build()),), (room,), tuple(self.supports))

    @property
    def scan(self) -> Scene:
        """The same geometry without supports, as a scan comes."""
        return replace(self.scene, supports=())

    def ground(self, low: float = 0.05, high: float = 1.7) -> Polygon:
        """The plan of everything solid strictly between two heights, exactly."""
        plans = [box(a[0], a[2], b[0], b[2]) for a, b in self.solids if a[1] < high and b[1] > low]
        return unary_union(plans)

    def tops(self, height: float) -> Polygon:
        """The plan of all upper faces at ``height`` (within a millimetre)."""
        return unary_union([box(a[0], a[2], b[0], b[2]) for a, b in self.solids if abs(b[1] - height) < 1e-3])


def kitchen() -> Toy:
    """4 × 5 m with a door: a worktop with cupboards over it, a side table and a shelf."""
    toy = Toy("kitchen").shell(door=(2.4, 3.3))
    toy.table("worktop", (0, 0, 0), (3.0, 0.9, 0.6), (0, 0, 1)).add((0, 1.45, 0), (3.0, 2.05, 0.35))
    toy.table("side_table", (3.5, 0, 2.3), (4.0, 0.5, 2.7), (-1, 0, 0))
    return toy.table("shelf", (0, 0, 1.8), (0.3, 0.8, 3.2), (1, 0, 0))


def bathroom() -> Toy:
    """2.2 × 2.9 m, a bath along one wall, no surfaces."""
    return Toy("bathroom", (2.2, 2.5, 2.9)).shell(door=(0.2, 1.0)).add((1.5, 0, 0.4), (2.2, 0.55, 2.1))


def living_room() -> Toy:
    """5 × 4.5 m: a sofa, a low table in the middle, a sideboard and a side table."""
    toy = Toy("living_room", (5.0, 2.7, 4.5)).shell(door=(3.6, 4.5))
    toy.add((1.2, 0, 0), (3.2, 0.42, 0.9)).add((1.2, 0.42, 0), (3.2, 0.8, 0.2))
    toy.table("side_table", (1.7, 0, 1.6), (2.7, 0.4, 2.2), (0, 0, 1))
    toy.table("side_table", (3.4, 0, 0.1), (3.9, 0.55, 0.6), (0, 0, 1), 1.5)
    return toy.table("shelf", (0, 0, 2.6), (0.4, 0.75, 4.2), (1, 0, 0), 1.0)


def box_model(category: str, mount: str | None = None, size: Vector | None = None) -> Model:
    """A box of the category's size in the model frame, sounding in the middle of its front."""
    usual, where = SIZES[category]
    (x, y, z), mount = size or usual, mount or where
    centre = {"wall": (0, 0, z / 2), "wall_or_surface": (0, y / 2, z / 2)}.get(mount, (0, y / 2, 0))
    mesh = MeshBuilder().box((x, y, z), centre, PLAIN).build()
    return Model(f"{category}/box", category, mesh, mount, source_point=(0.0, centre[1], centre[2] + z / 2))  # type: ignore[arg-type]
