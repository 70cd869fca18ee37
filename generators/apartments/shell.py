"""The shell of a flat: floors, walls with thickness, ceilings, windows, frames and skirting, one part per room.

Surfaces are single-sided, seen from inside; every room is closed by its own floor, ceiling, walls, reveals and panes,
and rooms join only through door openings, so that neither light nor sound leaks. Nothing lies outside: a ray that
starts behind a pane meets the sun. The acoustic twin holds the large surfaces exactly and leaves out the mouldings.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import INNER_WALL, SIDES, FloorPlan, RoomPlan, Side, WallFrame
from generators.apartments.joinery import (
    CASING_WIDTH,
    ShellStyle,
    WindowMaterials,
    casing,
    entrance,
    sky_strips,
    window,
)
from generators.apartments.roomshell import RoomShell
from generators.assets.materials import Palette, RoomFinish
from generators.assets.styles import STYLES
from generators.core.scene import Material, Part

#: Depth of the skirting boards (m); their height is the style's.
SKIRTING_DEPTH = 0.014
#: Depth of their upper edge, where it is thinner (m).
_MOULDING_DEPTH = 0.008
#: Shortest skirting board (m): between a door's casing and a corner there may be less wall.
_SHORTEST_SKIRTING = 0.02
#: How much more than its own width an opening counts against a wall that may get the accent colour: little of the
#: colour shows between openings.
_OPENING_WEIGHT = 1.5


def accent_side(plan: FloorPlan, room: RoomPlan) -> Side:
    """The wall for the accent colour: the one with the greatest length left beside its openings."""

    def free(side: Side) -> float:
        taken = sum(o.stop - o.start for o in plan.openings_of(room.name, side))
        return room.wall(side).length - _OPENING_WEIGHT * taken

    return max(SIDES, key=lambda side: (round(free(side), 3), side))


def _room(
    plan: FloorPlan, room: RoomPlan, finish: RoomFinish, palette: Palette, style: ShellStyle, sky: tuple[Material, ...]
) -> Part:
    shell = RoomShell()
    height = plan.height
    metal, leaf = palette.material("metal"), palette.material("door")
    glazing = WindowMaterials(
        finish.ceiling, palette.material("window_frame"), palette.material("window_sill"), metal, sky
    )
    door_frame = palette.material("door_frame")
    tiles = finish.wall_tiles if finish.tile_height > 0 else None
    x0, z0, x1, z1 = room.x0, room.z0, room.x1, room.z1
    floor = np.array([[x0, 0, z1], [x1, 0, z1], [x1, 0, z0], [x0, 0, z0]], dtype=float)
    shell.quad(floor, finish.floor, sound=True)
    shell.quad(floor[::-1] + np.array([0, height, 0]), finish.ceiling, sound=True)
    accent = accent_side(plan, room)
    for side in SIDES:
        wall = room.wall(side)
        openings = plan.openings_of(room.name, side)
        holes = [(*wall.along(o.start, o.stop), o.bottom, o.top) for o in openings if o.kind != "entrance"]
        paint = finish.accent_wall if side == accent else finish.wall
        shell.wall(wall, height, holes, paint, tiles, finish.tile_height)
        for opening in openings:
            along = wall.along(opening.start, opening.stop)
            if opening.kind == "window":
                window(shell, wall, opening, glazing, style)
            elif opening.kind == "entrance":
                entrance(shell, wall, opening, leaf, door_frame, metal)
            else:
                casing(shell, wall, along, opening.top, door_frame)
                if opening.room == room.name:
                    shell.reveal(wall, along, (0.0, opening.top), INNER_WALL, door_frame, finish.floor)
        if tiles is None:
            doors = sorted(wall.along(o.start, o.stop) for o in openings if o.bottom == 0.0)
            ends = [0.0, *(v for a, b in doors for v in (a - CASING_WIDTH, b + CASING_WIDTH)), wall.length]
            for start, stop in zip(ends[::2], ends[1::2], strict=True):
                if stop - start > _SHORTEST_SKIRTING:
                    _skirting(shell, wall, (start, stop), style, finish.skirting)
        if style.cornice and tiles is None:
            c, length = style.cornice, wall.length
            corners = ((0, height - c, 0), (length, height - c, 0), (length - c, height, c), (c, height, c))
            shell.quad(np.array([wall.point(*corner) for corner in corners]), finish.ceiling)
    return shell.part(f"shell_{room.name}")


def _skirting(
    shell: RoomShell, wall: WallFrame, along: tuple[float, float], style: ShellStyle, board: Material
) -> None:
    """A skirting board, with a thinner upper edge in some styles."""
    step = style.skirting - style.moulding
    faces = "front left right top"
    shell.block(wall, along, (0.0, step), (0.0, SKIRTING_DEPTH), board, faces)
    if style.moulding:
        shell.block(wall, along, (step, style.skirting), (0.0, _MOULDING_DEPTH), board, faces)


def build_shell(plan: FloorPlan, palette: Palette, rng: Generator) -> tuple[Part, ...]:
    """One part per room, ``shell_<room>``."""
    style = ShellStyle.from_rng(rng, STYLES[palette.style].joinery)
    view = palette.material("window_view").texture
    assert view is not None
    sky = sky_strips(style, view)
    return tuple(_room(plan, room, palette.finish(room.name), palette, style, sky) for room in plan.rooms)
