"""The kitchen: a run of base units with tall units at its end, wall cabinets above, and a place to eat."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from generators.apartments.floorplan import LEFT, RIGHT, SIDES, Side, WallFrame
from generators.apartments.interior.arrange import WINDOW_SIDE, Arranger, Where
from generators.apartments.interior.dining import PENDANT_BOTTOM, dining
from generators.apartments.interior.fittings import RADIATOR_BOTTOM, cornered
from generators.apartments.interior.pieces import Placed, origin_height
from generators.apartments.interior.walking import FloorDemand
from generators.apartments.roomshell import RoomShell
from generators.assets.furniture import Furniture
from generators.assets.furniture.counter import TOP as WORKTOP

Array = NDArray[np.float64]

#: Distance that base units reach into the room (m): cabinets of the usual 0.60 m, 0.02 m more of worktop, and handles.
COUNTER_DEPTH = 0.65
#: Width of a tall unit (m): one step of the usual cabinet grid, which the base units follow too.
UNIT_WIDTH = 0.6
#: Longest and shortest row of base units (m): six steps of the grid; sink and hob with some worktop beside them.
LONGEST_ROW, SHORTEST_ROW = 3.6, 1.5
#: Longest and shortest leg round a corner (m), without the corner itself: three steps of the grid, or one.
LONGEST_LEG, SHORTEST_LEG = 1.9, 0.7
#: Free floor before the units (m): lets a person pass or a cupboard door open. Planning guides ask for 1.20 m, for
#: which small kitchens have no space.
AISLE = 0.8
#: Height of the lower edge of wall cabinets above the floor (m): leaves 0.55 m above the worktop for appliances.
CABINET_BOTTOM = 1.45
#: Height of wall cabinets, and distance that they reach into the room with their handles (m).
CABINET_HEIGHT, CABINET_DEPTH = 0.7, 0.38
#: Shortest and longest run of wall cabinets (m): one to four steps of the grid.
CABINET_SHORTEST, CABINET_LONGEST = 0.6, 2.4
#: Height of the hood's lower edge above the floor (m): 0.68 m above the hob; hoods ask for about 0.65 m or more.
HOOD_BOTTOM = 1.58
#: Worktop that a kitchen should have in all (m), and the length beyond which more does not make a layout better (m).
WORKTOP_WANTED, WORKTOP_ENOUGH = 2.6, 5.0
#: Score of a layout: per metre of worktop up to `WORKTOP_WANTED`, per metre up to `WORKTOP_ENOUGH`, per tall unit, and
#: the upper limit of the random part.
_WANTED_WEIGHT, _ENOUGH_WEIGHT, _TALL_WEIGHT, _JITTER = 2.0, 0.3, 0.4, 1.2

#: Tall units to choose from.
_TALL_UNITS = (("fridge", "oven_unit"), ("fridge",))
#: Features of the base units (`counter.FEATURES`) beside an oven in a tall unit, without one, and in a leg.
_BESIDE_OVEN, _WITH_OVEN = ("sink", "hob", "drawers", "dishwasher"), ("sink", "hob", "oven", "drawers")
_LEG_FEATURES = ("drawers",)
#: Height at which the volumes of units and of the floor before them begin (m): above what lies flat on the floor.
_FLOOR_EDGE = 0.05
#: Height above the worktop that must be free at the wall too (m): windows begin above it.
_UPSTAND = 0.03
#: Free stretches of wall up to this length are too short for any unit (m).
_SHORT_STRETCH = 0.5
#: Joint between units, and between them and the ends of their stretch of wall (m).
_JOINT = 0.005
#: A stretch of wall that ends this near to a corner reaches into it (m).
_CORNER = 0.03
#: Tolerance in recognising a leg that begins where the other row ends, at the left end of its wall (m).
_CORNER_SLACK = 0.05
#: Gap between the free end of a leg and the end of its stretch of wall (m).
_LEG_GAP = 0.02
#: Variants of the base units (the order of sink, hob, drawers) that are tried for one whose hob stands well.
_VARIANTS = 6
#: Half the width of wall that a hob needs free of windows (m): half a hood (0.30 m) and `WINDOW_SIDE`.
_HOB_REACH = 0.42
#: A hob (0.60 m wide) whose middle is nearer than this to the end of the units has no worktop on that side (m); the
#: score that this costs, in metres of window behind the hob.
_HOB_END, _HOB_END_COST = 0.35, 0.3
#: Half the width, and depth, of the duct above a hood (m): 8 mm less than the hood's own, which it slides into by
#: `_DUCT_OVERLAP` (m).
_DUCT_HALF, _DUCT_DEPTH, _DUCT_OVERLAP = 0.132, 0.242, 0.01
#: Tiles on the wall begin this far below the top of the worktop and end this far above the lower edge of the wall
#: cabinets (m), so that no joint shows paint.
_TILES_BELOW, _TILES_ABOVE = 0.05, 0.02
#: Tiles below a window end this far below its opening (m): the sill is 0.03 m thick.
_TILES_SILL = 0.035
#: How far the tiles stand out from the wall (m).
_TILES_THICK = 0.009
#: The open shelf over the leg: height of its lower end above the floor, the band of wall that must be free for it, its
#: depth with some play, and how much longer than itself the free stretch must be (m).
_SHELF_BOTTOM, _SHELF_BAND, _SHELF_DEPTH, _SHELF_PLAY = 1.38, (1.4, 1.8), 0.3, 0.05
#: Length of the radiator and height of the plant (m): smaller than elsewhere, for the units take most of the walls.
_RADIATOR_LENGTH, _PLANT_HEIGHT = 0.8, 0.7
#: Height of the picture's middle above the floor, and free wall on both sides of it (m).
_PICTURE_HEIGHT, _PICTURE_MARGIN = 1.6, 0.15
#: Floor that must remain free.
_FLOOR = FloorDemand(area=2.5, rectangle=(1.3, 1.8))
#: Quality of a kitchen that has its units and its free floor, what a worktop of `WORKTOP_WANTED` adds, and what a table
#: adds.
_BASE_QUALITY, _WORKTOP_QUALITY, _TABLE_QUALITY = 0.5, 0.25, 0.25


@dataclass(frozen=True)
class _KitchenLayout:
    """A way to put the units along the walls; lengths in metres, along their wall.

    Attributes:
        wall: the wall of the base units and the tall units.
        counter: where the base units begin and end.
        tall: kind and left end of each tall unit.
        leg_wall: the wall round the corner with further base units; None: there is none.
        leg: where those begin and end.
    """

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
    """Place a piece with its left end at ``left`` and its back on the wall; a counter's tap may be before a window."""
    low = furniture.mesh.bounds[0].astype(np.float64)
    at = wall.point(left - float(low[0]), 0.0, -float(low[2]))
    return a.place_free(furniture, at[[0, 2]], wall.yaw, height=height, windows=furniture.kind != "kitchen_counter")


def _layouts(a: Arranger) -> list[_KitchenLayout]:
    """All ways to put the units along the room's walls."""
    band = (_FLOOR_EDGE, WORKTOP + _UPSTAND)
    free = {
        side: [s for s in a.stretches(a.room.wall(side), band, COUNTER_DEPTH) if s[1] - s[0] > _SHORT_STRETCH]
        for side in SIDES
    }
    out = []
    for side in SIDES:
        wall = a.room.wall(side)
        for start, stop in free[side]:
            for kinds in _TALL_UNITS:
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
) -> _KitchenLayout | None:
    """Tall units at one end of the stretch, base units beside them, a leg where the other end is a corner."""
    start, stop = stretch[0] + _JOINT, stretch[1] - _JOINT
    widths = [float(_size(a.model(kind))[0]) + _JOINT for kind in kinds]
    tall = sum(widths)
    length = min(stop - start - tall, LONGEST_ROW)
    if length < SHORTEST_ROW:
        return None
    touches = stop > wall.length - _CORNER if tall_left else start < _CORNER
    # The units may be shorter than the stretch: then they reach into the corner where a leg can follow, or else the
    # tall units are at their end of the stretch.
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
            if tall_left and low < _CORNER and high - COUNTER_DEPTH > SHORTEST_LEG:
                leg_wall, leg = other, (COUNTER_DEPTH, min(high - _LEG_GAP, COUNTER_DEPTH + LONGEST_LEG))
            if not tall_left and high > other.length - _CORNER and other.length - COUNTER_DEPTH - low > SHORTEST_LEG:
                end = other.length - COUNTER_DEPTH
                leg_wall, leg = other, (max(low + _LEG_GAP, end - LONGEST_LEG), end)
    return _KitchenLayout(wall, counter, tuple(places), leg_wall, leg)


def _hob(furniture: Furniture) -> float | None:
    """Where along a counter the hob is (local x), if it has one."""
    mesh = furniture.mesh
    names = [m.name for m in mesh.materials]
    if "hob" not in names:
        return None
    points = mesh.positions[mesh.face_material == names.index("hob")].reshape(-1, 3)
    return float(points[:, 0].min() + points[:, 0].max()) / 2


def _main_counter(a: Arranger, layout: _KitchenLayout) -> Furniture:
    """Base units with sink and hob; of several, one whose hob has no window and no tall unit beside it."""
    length = round(layout.counter[1] - layout.counter[0], 3)
    built_in = any(kind == "oven_unit" for kind, _ in layout.tall)
    features = _BESIDE_OVEN if built_in else _WITH_OVEN
    wall = layout.wall
    panes = [wall.along(o.start, o.stop) for o in a.plan.openings_of(a.room.name, wall.side) if o.kind == "window"]
    best: tuple[float, Furniture] | None = None
    for copy in range(_VARIANTS):
        counter = a.model("kitchen_counter", copy, length=length, features=features, splash=False)
        hob = _hob(counter)
        at = layout.counter[0] + length / 2 + (hob or 0.0)
        clash = sum(max(0.0, min(b, at + _HOB_REACH) - max(c, at - _HOB_REACH)) for c, b in panes)
        value = -clash - _HOB_END_COST * (min(at - layout.counter[0], layout.counter[1] - at) < _HOB_END)
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
    if a.plan.height - top > _DUCT_OVERLAP:
        shell = RoomShell()
        span, rise = (along - _DUCT_HALF, along + _DUCT_HALF), (top - _DUCT_OVERLAP, a.plan.height)
        shell.block(wall, span, rise, (0.0, _DUCT_DEPTH), duct, "front left right")
        a.extras.append(shell.part("duct"))


def _build(a: Arranger, layout: _KitchenLayout) -> list[Placed]:
    """Place the units and keep the floor before them free; returns the counters."""
    wall = layout.wall
    for kind, left in layout.tall:
        _stand(a, a.model(kind), wall, left)
    counters = []
    main = _stand(a, _main_counter(a, layout), wall, layout.counter[0])
    if main is not None:
        counters.append(main)
    if layout.leg_wall is not None:
        length = round(layout.leg[1] - layout.leg[0], 3)
        leg = a.model("kitchen_counter", length=length, features=_LEG_FEATURES, splash=False)
        placed = _stand(a, leg, layout.leg_wall, layout.leg[0])
        if placed is not None:
            counters.append(placed)
    fronts = [(wall, (min(layout.counter[0], *(left for _, left in layout.tall)), layout.counter[1]))]
    if layout.tall[0][1] > layout.counter[0]:
        fronts = [(wall, (layout.counter[0], layout.tall[0][1] + UNIT_WIDTH * len(layout.tall)))]
    if layout.leg_wall is not None:
        fronts.append((layout.leg_wall, layout.leg))
    for side, span in fronts:
        low, high = a.volume(side, span, (_FLOOR_EDGE, WORKTOP), COUNTER_DEPTH + AISLE)
        a.reserve(low, high)
    return counters


def _cabinets(a: Arranger, wall: WallFrame, span: tuple[float, float]) -> None:
    """Wall cabinets over a counter wherever the wall is free."""
    for start, stop in a.stretches(wall, (CABINET_BOTTOM, CABINET_BOTTOM + CABINET_HEIGHT), CABINET_DEPTH):
        low, high = max(start, span[0]) + _JOINT, min(stop, span[1]) - _JOINT
        if high - low >= CABINET_SHORTEST:
            length = round(min(high - low, CABINET_LONGEST) - _JOINT, 2)
            cabinet = a.model("wall_cabinet", length=length, height=CABINET_HEIGHT)
            _stand(a, cabinet, wall, low, height=origin_height(cabinet, CABINET_BOTTOM))


def _splashback(a: Arranger, spans: list[tuple[WallFrame, tuple[float, float]]]) -> None:
    """Tiles between worktop and wall cabinets; below a window they end at its sill."""
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
        edges = [edge for p in panes for edge in (p[0] - WINDOW_SIDE, p[1] + WINDOW_SIDE)]
        cuts = sorted({start, stop, *(edge for edge in edges if start < edge < stop)})
        for low, high in itertools.pairwise(cuts):
            middle = (low + high) / 2
            tops = [b - _TILES_SILL for p0, p1, b in panes if p0 - WINDOW_SIDE < middle < p1 + WINDOW_SIDE]
            rise = (WORKTOP - _TILES_BELOW, min([CABINET_BOTTOM + _TILES_ABOVE, *tops]))
            shell.block(wall, (low, high), rise, (0.0, _TILES_THICK), tiles, "front left right top")
            drawn = True
    if drawn:
        a.extras.append(shell.part("splashback"))


def _shelf(a: Arranger, wall: WallFrame, span: tuple[float, float]) -> None:
    """An open shelf in the first free stretch of wall that is long enough for it."""
    shelf = a.model("kitchen_shelf")
    for start, stop in a.stretches(wall, _SHELF_BAND, _SHELF_DEPTH):
        low, high = max(start, span[0]), min(stop, span[1])
        if high - low > _size(shelf)[0] + _SHELF_PLAY:
            left = (low + high - float(_size(shelf)[0])) / 2
            _stand(a, shelf, wall, left, height=origin_height(shelf, _SHELF_BOTTOM))
            break


def furnish_kitchen(a: Arranger) -> float:
    """Furnish a kitchen; returns how well it meets its demands (0 = not at all, 1 = fully)."""
    layouts = a.memory.get("layouts")
    if not isinstance(layouts, list):
        layouts = a.memory["layouts"] = _layouts(a)
    if not layouts:
        return 0.0

    def value(layout: _KitchenLayout) -> float:
        return (
            _WANTED_WEIGHT * min(layout.worktop, WORKTOP_WANTED)
            + _ENOUGH_WEIGHT * min(layout.worktop, WORKTOP_ENOUGH)
            + _TALL_WEIGHT * len(layout.tall)
            + float(a.rng.uniform(0, _JITTER))
        )

    layout = max(layouts, key=value)
    counters = _build(a, layout)
    if counters:
        _hood(a, layout.wall, counters[0])
    spans = [(layout.wall, layout.counter)]
    if layout.leg_wall is not None:
        near_corner = layout.leg[0] < COUNTER_DEPTH + _CORNER_SLACK and RIGHT[layout.wall.side] == layout.leg_wall.side
        start, stop = layout.leg
        spans.append((layout.leg_wall, (start - COUNTER_DEPTH, stop) if near_corner else (start, stop + COUNTER_DEPTH)))
    _cabinets(a, layout.wall, layout.counter)
    _splashback(a, spans)
    table = dining(a)
    if layout.leg_wall is not None:
        _shelf(a, layout.leg_wall, layout.leg)
    if table is not None:
        centre = (table.low + table.high) / 2
        drop = round(a.plan.height - PENDANT_BOTTOM, 2)
        a.place_free(a.model("ceiling_lamp", 1, drop=drop), centre[[0, 2]], 0.0, height=a.plan.height, windows=False)
    a.place("waste_bin", score=cornered)
    low = origin_height(a.model("radiator", length=_RADIATOR_LENGTH), RADIATOR_BOTTOM)
    a.place("radiator", options={"length": _RADIATOR_LENGTH}, where=Where(height=low))
    a.place("plant", score=cornered, options={"height": _PLANT_HEIGHT})
    a.place("picture", where=Where(height=_PICTURE_HEIGHT, margin=_PICTURE_MARGIN))
    if not _FLOOR.met(a):
        return 0.0
    worktop = _WORKTOP_QUALITY * min(layout.worktop / WORKTOP_WANTED, 1.0)
    return _BASE_QUALITY + worktop + (_TABLE_QUALITY if table is not None else 0.0)
