"""The kitchen: a run of base units with tall units at its end, wall cabinets above, and a place to eat."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import LEFT, RIGHT, SIDES, Side, WallFrame
from generators.apartments.interior.arrange import Arranger, Where
from generators.apartments.interior.dining import PENDANT_BOTTOM, dining
from generators.apartments.interior.pieces import Placed
from generators.apartments.interior.walking import free_rectangle, walkable
from generators.apartments.roomshell import RoomShell
from generators.assets.furniture import Furniture

Array = NDArray[np.float64]
COUNTER_DEPTH = 0.65
LONGEST = 3.6
LONGEST_LEG = 1.9
#: Wall cabinets hang this high; below them appliances stand.
CABINET_BOTTOM = 1.45
WORKTOP = 0.9
#: Free floor before the units.
AISLE = 0.8
#: The hood's lower edge.
HOOD_BOTTOM = 1.58
#: Worktop that a kitchen should have in all, metres.
WANTED = 2.6


@dataclass(frozen=True)
class _Layout:
    """Base units on one wall, ``counter`` (from, to), tall units ``tall`` (left ends), and a leg round a corner."""

    wall: WallFrame
    counter: tuple[float, float]
    tall: tuple[tuple[str, float], ...]
    leg_wall: WallFrame | None
    leg: tuple[float, float]

    @property
    def worktop(self) -> float:
        """Metres of worktop."""
        return self.counter[1] - self.counter[0] + self.leg[1] - self.leg[0]


def _size(furniture: Furniture) -> Array:
    bounds = furniture.mesh.bounds.astype(np.float64)
    return np.asarray(bounds[1] - bounds[0])


def _stand(a: Arranger, furniture: Furniture, wall: WallFrame, left: float, height: float = 0.0) -> Placed | None:
    """Put a piece with its left end at ``left``, its back on the wall; a tap may stand before a window."""
    low = furniture.mesh.bounds[0].astype(np.float64)
    at = wall.point(left - float(low[0]), 0.0, -float(low[2]))
    return a.place_free(furniture, at[[0, 2]], wall.yaw, height=height, windows=furniture.kind != "kitchen_counter")


def _layouts(a: Arranger) -> list[_Layout]:
    """All ways to put the units along the room's walls."""
    free = {
        side: [s for s in a.stretches(a.room.wall(side), (0.05, WORKTOP + 0.03), COUNTER_DEPTH) if s[1] - s[0] > 0.5]
        for side in SIDES
    }
    out = []
    for side in SIDES:
        wall = a.room.wall(side)
        for start, stop in free[side]:
            for kinds in (("fridge", "oven_unit"), ("fridge",)):
                for tall_left in (True, False):
                    layout = _layout(a, wall, (start, stop), kinds, tall_left, free)
                    if layout is not None:
                        out.append(layout)
    return out


def _layout(
    a: Arranger,
    wall: WallFrame,
    stretch: tuple[float, float],
    kinds: tuple[str, ...],
    tall_left: bool,
    free: dict[Side, list[tuple[float, float]]],
) -> _Layout | None:
    """Tall units at one end of the stretch, base units beside them, a leg where the other end is a corner."""
    start, stop = stretch[0] + 0.005, stretch[1] - 0.005
    widths = [float(_size(a.model(kind))[0]) + 0.005 for kind in kinds]
    tall = sum(widths)
    length = min(stop - start - tall, LONGEST)
    if length < 1.5:
        return None
    touches = stop > wall.length - 0.03 if tall_left else start < 0.03
    # Slide along the wall: into the corner for the leg, else with the tall units at their end.
    offset = stop - start - tall - length if touches == tall_left else 0.0
    first = start + offset
    ordered = kinds if tall_left else kinds[::-1]
    sizes = widths if tall_left else widths[::-1]
    cursor = first if tall_left else first + length
    places = []
    for kind, width in zip(ordered, sizes, strict=True):
        places.append((kind, cursor))
        cursor += width
    for kind, left in places:
        box = _size(a.model(kind))
        ends = [wall.point(left, 0.0), wall.point(left + float(box[0]), float(box[1]), float(box[2]))]
        if not a.free(np.minimum(*ends)[None], np.maximum(*ends)[None])[0]:
            return None
    counter = (first + tall, first + tall + length) if tall_left else (first, first + length)
    leg_wall, leg = None, (0.0, 0.0)
    if touches:
        other = a.room.wall(RIGHT[wall.side] if tall_left else LEFT[wall.side])
        for low, high in free[other.side]:
            if tall_left and low < 0.03 and high - COUNTER_DEPTH > 0.7:
                leg_wall, leg = other, (COUNTER_DEPTH, min(high - 0.02, COUNTER_DEPTH + LONGEST_LEG))
            if not tall_left and high > other.length - 0.03 and other.length - COUNTER_DEPTH - low > 0.7:
                end = other.length - COUNTER_DEPTH
                leg_wall, leg = other, (max(low + 0.02, end - LONGEST_LEG), end)
    return _Layout(wall, counter, tuple(places), leg_wall, leg)


def _hob(furniture: Furniture) -> float | None:
    """Where along a counter the hob is (local x), if it has one."""
    mesh = furniture.mesh
    names = [m.name for m in mesh.materials]
    if "hob" not in names:
        return None
    points = mesh.positions[mesh.face_material == names.index("hob")].reshape(-1, 3)
    return float(points[:, 0].min() + points[:, 0].max()) / 2


def _main_counter(a: Arranger, layout: _Layout) -> Furniture:
    """Base units with sink and hob; of several, one whose hob has no window and no tall unit beside it."""
    length = round(layout.counter[1] - layout.counter[0], 3)
    built_in = any(kind == "oven_unit" for kind, _ in layout.tall)
    features = ("sink", "hob", "drawers", "dishwasher") if built_in else ("sink", "hob", "oven", "drawers")
    wall = layout.wall
    panes = [wall.along(o.start, o.stop) for o in a.plan.openings_of(a.room.name, wall.side) if o.kind == "window"]
    best: tuple[float, Furniture] | None = None
    for copy in range(6):
        counter = a.model("kitchen_counter", copy, length=length, features=features, splash=False)
        hob = _hob(counter)
        at = layout.counter[0] + length / 2 + (hob or 0.0)
        clash = sum(max(0.0, min(b, at + 0.42) - max(c, at - 0.42)) for c, b in panes)
        value = -clash - 0.3 * (min(at - layout.counter[0], layout.counter[1] - at) < 0.35)
        if best is None or value > best[0] + 1e-9:
            best = (value, counter)
        if value == 0:
            break
    assert best is not None
    return best[1]


def _hood(a: Arranger, wall: WallFrame, counter: Placed) -> None:
    """An extractor hood above the hob, its duct led up to the ceiling."""
    at = _hob(counter.furniture)
    if at is None:
        return
    along = float((counter.position - wall.origin) @ wall.u) + at
    hood = a.model("extractor_hood")
    low, high = hood.mesh.bounds.astype(np.float64)
    height = HOOD_BOTTOM - float(low[1])
    if height + float(high[1]) > a.plan.height:
        height = a.plan.height - float(high[1])
    if _stand(a, hood, wall, along + float(low[0]), height) is None:
        return
    top = height + float(high[1])
    mesh = hood.mesh
    duct = mesh.materials[mesh.face_material[int(np.argmax(mesh.positions[:, :, 1].min(axis=1)))]]
    if a.plan.height - top > 0.01:
        shell = RoomShell()
        shell.block(
            wall, (along - 0.132, along + 0.132), (top - 0.01, a.plan.height), (0.0, 0.242), duct, "front left right"
        )
        a.extras.append(shell.part("duct"))


def _build(a: Arranger, layout: _Layout) -> list[Placed]:
    """Stand the units and keep the floor before them free; returns the counters."""
    wall = layout.wall
    for kind, left in layout.tall:
        _stand(a, a.model(kind), wall, left)
    counters = []
    main = _stand(a, _main_counter(a, layout), wall, layout.counter[0])
    if main is not None:
        counters.append(main)
    if layout.leg_wall is not None:
        length = round(layout.leg[1] - layout.leg[0], 3)
        leg = a.model("kitchen_counter", length=length, features=("drawers",), splash=False)
        placed = _stand(a, leg, layout.leg_wall, layout.leg[0])
        if placed is not None:
            counters.append(placed)
    fronts = [(wall, (min(layout.counter[0], *(left for _, left in layout.tall)), layout.counter[1]))]
    if layout.tall[0][1] > layout.counter[0]:
        fronts = [(wall, (layout.counter[0], layout.tall[0][1] + 0.6 * len(layout.tall)))]
    if layout.leg_wall is not None:
        fronts.append((layout.leg_wall, layout.leg))
    for side, span in fronts:
        low, high = a.volume(side, span, (0.05, WORKTOP), COUNTER_DEPTH + AISLE)
        a.reserve(low, high)
    return counters


def _cabinets(a: Arranger, wall: WallFrame, span: tuple[float, float]) -> None:
    """Wall cabinets over a counter wherever the wall is free."""
    for start, stop in a.stretches(wall, (CABINET_BOTTOM, CABINET_BOTTOM + 0.7), 0.38):
        low, high = max(start, span[0]) + 0.005, min(stop, span[1]) - 0.005
        if high - low >= 0.6:
            length = round(min(high - low, 2.4) - 0.005, 2)
            cabinet = a.model("wall_cabinet", length=length, height=0.7)
            _stand(a, cabinet, wall, low, height=CABINET_BOTTOM - float(cabinet.mesh.bounds[0, 1]))


def _splashback(a: Arranger, spans: list[tuple[WallFrame, tuple[float, float]]]) -> None:
    """Tiles between worktop and wall cabinets, lower below a window."""
    tiles = a.palette.finish("kitchen").wall_tiles
    if tiles is None:
        return
    shell = RoomShell()
    drawn = False
    for wall, (start, stop) in spans:
        panes = [
            (*wall.along(o.start, o.stop), o.bottom)
            for o in a.plan.openings_of(a.room.name, wall.side)
            if o.kind == "window"
        ]
        cuts = sorted({start, stop, *(c for p in panes for c in (p[0] - 0.12, p[1] + 0.12) if start < c < stop)})
        for low, high in itertools.pairwise(cuts):
            middle = (low + high) / 2
            tops = [bottom - 0.035 for p0, p1, bottom in panes if p0 - 0.12 < middle < p1 + 0.12]
            top = min([CABINET_BOTTOM + 0.02, *tops])
            shell.block(wall, (low, high), (WORKTOP - 0.05, top), (0.0, 0.009), tiles, "front left right top")
            drawn = True
    if drawn:
        a.extras.append(shell.part("splashback"))


def furnish_kitchen(a: Arranger) -> float:
    """Furnish a kitchen; returns how well it meets its demands (0 = not at all, 1 = fully)."""
    layouts = a.memory.get("layouts")
    if not isinstance(layouts, list):
        layouts = a.memory["layouts"] = _layouts(a)
    if not layouts:
        return 0.0

    def value(layout: _Layout) -> float:
        return (
            2.0 * min(layout.worktop, WANTED)
            + 0.3 * min(layout.worktop, 5.0)
            + 0.4 * len(layout.tall)
            + float(a.rng.uniform(0, 1.2))
        )

    layout = max(layouts, key=value)
    counters = _build(a, layout)
    if counters:
        _hood(a, layout.wall, counters[0])
    spans = [(layout.wall, layout.counter)]
    if layout.leg_wall is not None:
        near_corner = layout.leg[0] < COUNTER_DEPTH + 0.05 and RIGHT[layout.wall.side] == layout.leg_wall.side
        start, stop = layout.leg
        spans.append((layout.leg_wall, (start - COUNTER_DEPTH, stop) if near_corner else (start, stop + COUNTER_DEPTH)))
    _cabinets(a, layout.wall, layout.counter)
    _splashback(a, spans)
    table = dining(a)
    if layout.leg_wall is not None:
        shelf = a.model("kitchen_shelf")
        for start, stop in a.stretches(layout.leg_wall, (1.4, 1.8), 0.3):
            low, high = max(start, layout.leg[0]), min(stop, layout.leg[1])
            if high - low > _size(shelf)[0] + 0.05:
                left = (low + high - float(_size(shelf)[0])) / 2
                _stand(a, shelf, layout.leg_wall, left, height=1.5)
                break
    if table is not None:
        centre = (table.low + table.high) / 2
        drop = round(a.plan.height - PENDANT_BOTTOM, 2)
        a.place_free(a.model("ceiling_lamp", 1, drop=drop), centre[[0, 2]], 0.0, height=a.plan.height, windows=False)
    a.place("waste_bin", score=lambda s: -2 * min(s.corner, 1.0))
    radiator = a.model("radiator", length=0.8)
    a.place("radiator", options={"length": 0.8}, where=Where(height=0.02 - float(radiator.mesh.bounds[0, 1])))
    a.place("plant", score=lambda s: -2 * min(s.corner, 1.0), options={"height": 0.7})
    a.place("picture", where=Where(height=1.6, margin=0.15))
    if walkable(a) < 2.5 or not free_rectangle(a, 1.3, 1.8):
        return 0.0
    return 0.5 + 0.25 * min(layout.worktop / WANTED, 1.0) + (0.25 if table is not None else 0.0)
