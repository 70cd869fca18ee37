"""The shell of a flat: floors, walls with thickness, ceilings, windows, frames and skirting, one part per room.

Surfaces are single-sided, seen from inside; every room is closed by its own floor, ceiling, walls, reveals and panes,
and rooms join only through door openings, so that neither light nor sound leaks. Nothing lies outside: a ray that starts
behind a pane meets the sun. The acoustic twin holds the large surfaces exactly and leaves out the mouldings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.materials import TILES, Palette, RoomFinish
from generators.assets.shapes import MeshBuilder
from generators.scenes.floorplan import INNER_WALL, SIDES, FloorPlan, Opening, RoomPlan, Side, WallFrame
from generators.scenes.scene import Material, Part

Array = NDArray[np.float64]

#: Radiance of the sky behind a window pane, in the scene's light unit.
SKY_RADIANCE = 16.0
#: How far the panes lie behind the wall's inner surface.
PANE_DEPTH = 0.16
CASING_WIDTH = 0.07
CASING_DEPTH = 0.016
SKIRTING_DEPTH = 0.014
#: A pane is cut into this many strips, each with its own radiance: the blurred view of the outdoors.
SKY_STRIPS = 20


@dataclass(frozen=True)
class ShellStyle:
    """What varies in the joinery of a flat (metres).

    Attributes:
        skirting: height of the skirting boards.
        cornice: leg of the cornice's triangle, 0 = none.
        transom: share of the window's height at which a bar crosses it, 0 = none.
        window_casing: whether windows have a casing on the wall like doors.
        sky: tint of the daylight (linear RGB).
    """

    skirting: float
    cornice: float
    transom: float
    window_casing: bool
    sky: tuple[float, float, float]

    @classmethod
    def from_rng(cls, rng: Generator) -> ShellStyle:
        """A style: plain and modern, or with mouldings."""
        classic = bool(rng.integers(2))
        skies = ((1.0, 1.0, 1.0), (1.03, 1.0, 0.95), (0.95, 0.99, 1.06))
        return cls(
            skirting=0.11 if classic else 0.07,
            cornice=0.06 if classic else 0.0,
            transom=0.72 if classic else 0.0,
            window_casing=classic,
            sky=skies[int(rng.integers(len(skies)))],
        )


class RoomShell:
    """Draws the surfaces of one room, in the coordinates of its walls (along, height, depth into the room)."""

    def __init__(self) -> None:
        self.builder = MeshBuilder(TILES)
        self._acoustic: list[Array] = []
        self._labels: list[str] = []

    def quad(self, corners: Array, material: Material, *, sound: bool = False, fit: bool = False) -> None:
        """A rectangle, counter-clockwise from its lower left; ``sound``: it is in the acoustic twin too."""
        self.builder.quad(corners, material, acoustic=False, fit=fit)
        if sound:
            self.sound(corners, material)

    def sound(self, corners: Array, material: Material) -> None:
        """A rectangle of the acoustic twin alone."""
        p = np.asarray(corners, dtype=np.float64)
        self._acoustic.append(p[[[0, 1, 2], [0, 2, 3]]])
        self._labels += [material.acoustic] * 2

    def block(
        self,
        wall: WallFrame,
        along: tuple[float, float],
        height: tuple[float, float],
        depth: tuple[float, float],
        material: Material,
        faces: str = "front left right top bottom",
    ) -> None:
        """A box on a wall without its back; ``faces`` names the faces that show."""
        (s0, s1), (y0, y1), (d0, d1) = along, height, depth
        at = wall.point
        sides = {
            "front": ((s0, y0, d1), (s1, y0, d1), (s1, y1, d1), (s0, y1, d1)),
            "left": ((s0, y0, d0), (s0, y0, d1), (s0, y1, d1), (s0, y1, d0)),
            "right": ((s1, y0, d1), (s1, y0, d0), (s1, y1, d0), (s1, y1, d1)),
            "top": ((s0, y1, d1), (s1, y1, d1), (s1, y1, d0), (s0, y1, d0)),
            "bottom": ((s0, y0, d0), (s1, y0, d0), (s1, y0, d1), (s0, y0, d1)),
        }
        for face in faces.split():
            self.quad(np.array([at(*corner) for corner in sides[face]]), material)

    def reveal(
        self,
        wall: WallFrame,
        along: tuple[float, float],
        height: tuple[float, float],
        depth: float,
        lining: Material,
        base: Material,
    ) -> None:
        """The four inner faces of a hole that reaches ``depth`` behind the wall's surface; ``base`` is the lowest."""
        (s0, s1), (y0, y1), d = along, height, -depth
        faces = (
            (((s0, y0, 0), (s0, y0, d), (s0, y1, d), (s0, y1, 0)), lining),
            (((s1, y0, d), (s1, y0, 0), (s1, y1, 0), (s1, y1, d)), lining),
            (((s0, y1, d), (s1, y1, d), (s1, y1, 0), (s0, y1, 0)), lining),
            (((s0, y0, 0), (s1, y0, 0), (s1, y0, d), (s0, y0, d)), base),
        )
        for corners, material in faces:
            self.quad(np.array([wall.point(*corner) for corner in corners]), material, sound=True)

    def wall(
        self,
        wall: WallFrame,
        room_height: float,
        holes: list[tuple[float, float, float, float]],
        paint: Material,
        tiles: Material | None,
        tile_height: float,
    ) -> None:
        """A wall with rectangular ``holes`` (along from, to, height from, to), tiled up to ``tile_height``.

        Its cells share their corners, so that it unwraps into one chart; the acoustic twin has fewer, larger ones.
        """
        split = [tile_height] if tiles is not None else []
        along = np.unique([0.0, wall.length, *(v for h in holes for v in h[:2])])
        heights = np.unique([0.0, room_height, *split, *(v for h in holes for v in h[2:])])

        def inside(s: float, y: float) -> bool:
            return any(h[0] < s < h[1] and h[2] < y < h[3] for h in holes)

        def covering(y: float) -> Material:
            return tiles if tiles is not None and y < tile_height else paint

        for material in (paint, tiles):
            if material is None:
                continue
            corners, faces = [], []
            for s0, s1 in zip(along[:-1], along[1:], strict=True):
                for y0, y1 in zip(heights[:-1], heights[1:], strict=True):
                    middle = ((s0 + s1) / 2, (y0 + y1) / 2)
                    if inside(*middle) or covering(middle[1]) is not material:
                        continue
                    first = len(corners)
                    corners += [(s0, y0), (s1, y0), (s1, y1), (s0, y1)]
                    faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
            if faces:
                flat, index = np.array(corners), np.array(faces)
                uv = flat[index] / TILES.get(material.name, 1.0)
                points = np.array([wall.point(s, y) for s, y in corners])
                self.builder.add(points, index, material, uv=uv, acoustic=False)
        for s0, s1 in zip(along[:-1], along[1:], strict=True):
            centre = (s0 + s1) / 2
            cuts = sorted({0.0, room_height, *split, *(v for h in holes if h[0] < centre < h[1] for v in h[2:])})
            for y0, y1 in zip(cuts[:-1], cuts[1:], strict=True):
                if not inside(centre, (y0 + y1) / 2):
                    corner = ((s0, y0), (s1, y0), (s1, y1), (s0, y1))
                    self.sound(np.array([wall.point(*c) for c in corner]), covering((y0 + y1) / 2))

    def part(self, name: str) -> Part:
        """The finished part with its own acoustic twin."""
        mesh = self.builder.build()
        acoustic = np.concatenate([np.zeros((0, 3, 3)), *self._acoustic]).astype(np.float32)
        return Part(name, replace(mesh, acoustic_positions=acoustic, acoustic_labels=tuple(self._labels)))


def _casing(shell: RoomShell, wall: WallFrame, along: tuple[float, float], top: float, frame: Material) -> None:
    """Door casing on one side of an opening."""
    s0, s1 = along
    depth, high = (0.0, CASING_DEPTH), top + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (top, high), depth, frame, "front top bottom")


def _sky(style: ShellStyle) -> tuple[Material, ...]:
    """Materials of the strips of a pane, from the lowest up: garden, bright haze, sky."""
    stops = np.array([0.0, 0.22, 0.42, 0.62, 1.0])
    colours = np.array(
        [[0.20, 0.24, 0.15], [0.30, 0.36, 0.24], [0.78, 0.80, 0.76], [1.05, 1.04, 1.0], [0.86, 0.97, 1.14]]
    )
    heights = (np.arange(SKY_STRIPS) + 0.5) / SKY_STRIPS
    radiance = np.stack([np.interp(heights, stops, colours[:, c]) for c in range(3)], axis=1)
    radiance *= SKY_RADIANCE * np.array(style.sky)
    return tuple(
        Material(f"sky_{i}", "glass", (0.04, 0.04, 0.04), emission=(float(r), float(g), float(b)), gloss=0.9)
        for i, (r, g, b) in enumerate(radiance)
    )


def _window(
    shell: RoomShell,
    wall: WallFrame,
    opening: Opening,
    lining: Material,
    frame: Material,
    sill: Material,
    metal: Material,
    sky: tuple[Material, ...],
    style: ShellStyle,
) -> None:
    """Reveal, sill, frame with sashes, and the panes that light the room."""
    s0, s1 = wall.along(opening.start, opening.stop)
    y0, y1 = opening.bottom, opening.top
    shell.reveal(wall, (s0, s1), (y0, y1), PANE_DEPTH, lining, sill)
    back, front = -PANE_DEPTH, -PANE_DEPTH + 0.055
    if style.window_casing:
        _window_casing(shell, wall, (s0, s1), (y0, y1), frame)
    nose = 0.04 + (CASING_WIDTH if style.window_casing else 0.0)
    shell.block(wall, (s0 - nose, s1 + nose), (y0 - 0.03, y0), (0.0, 0.045), sill)
    corners = ((s0, y0, back), (s1, y0, back), (s1, y1, back), (s0, y1, back))
    shell.sound(np.array([wall.point(*c) for c in corners]), sky[0])

    border, bar = 0.065, 0.09
    sashes = max(1, round((s1 - s0) / 0.8))
    edges = [s0, *(s0 + (s1 - s0) * k / sashes for k in range(1, sashes)), s1]
    for k in range(sashes + 1):
        low = s0 if k == 0 else edges[k] - (border if k == sashes else bar / 2)
        high = s1 if k == sashes else edges[k] + (border if k == 0 else bar / 2)
        shell.block(wall, (low, high), (y0, y1), (back, front), frame, "front left right")
        if 0 < k < sashes or sashes == 1 == k:
            middle = (edges[k] if k < sashes else s1 - border / 2, y0 + 0.45 * (y1 - y0))
            along = (middle[0] - 0.011, middle[0] + 0.011)
            shell.block(wall, along, (middle[1] - 0.03, middle[1] + 0.03), (front, front + 0.012), metal)
            along = (middle[0] - 0.009, middle[0] + 0.009)
            shell.block(wall, along, (middle[1] - 0.11, middle[1] + 0.015), (front + 0.012, front + 0.035), metal)
    rows = [(y0 + border, y1 - border)]
    if style.transom and y1 - y0 > 1.1:
        cross = y0 + style.transom * (y1 - y0)
        rows = [(y0 + border, cross - 0.03), (cross + 0.03, y1 - border)]
    for k in range(sashes):
        low = s0 + border if k == 0 else edges[k] + bar / 2
        high = s1 - border if k == sashes - 1 else edges[k + 1] - bar / 2
        shell.block(wall, (low, high), (y0, rows[0][0]), (back, front), frame, "front top")
        shell.block(wall, (low, high), (rows[-1][1], y1), (back, front), frame, "front bottom")
        if len(rows) == 2:
            shell.block(wall, (low, high), (rows[0][1], rows[1][0]), (back, front - 0.01), frame, "front top bottom")
        for bottom, top in rows:
            cuts = np.linspace(y0, y1, len(sky) + 1)
            for material, first, last in zip(sky, cuts[:-1], cuts[1:], strict=True):
                a, b = max(float(first), bottom), min(float(last), top)
                if b - a > 1e-4:
                    pane = ((low, a, back), (high, a, back), (high, b, back), (low, b, back))
                    shell.quad(np.array([wall.point(*c) for c in pane]), material, fit=True)


def _window_casing(
    shell: RoomShell, wall: WallFrame, along: tuple[float, float], height: tuple[float, float], frame: Material
) -> None:
    (s0, s1), (y0, y1) = along, height
    depth, high = (0.0, CASING_DEPTH), y1 + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (y1, high), depth, frame, "front top bottom")


def _entrance(shell: RoomShell, wall: WallFrame, opening: Opening, leaf: Material, frame: Material, metal: Material) -> None:
    """A closed leaf with panels, a handle and a spy hole, in its casing."""
    s0, s1 = wall.along(opening.start, opening.stop)
    _casing(shell, wall, (s0, s1), opening.top, frame)
    shell.block(wall, (s0, s1), (0.0, opening.top), (0.0, 0.008), leaf, "front")
    inset = 0.13
    for low, high in ((0.2, 0.85), (1.0, opening.top - 0.16)):
        shell.block(wall, (s0 + inset, s1 - inset), (low, high), (0.008, 0.016), leaf)
        shell.block(wall, (s0 + inset + 0.05, s1 - inset - 0.05), (low + 0.05, high - 0.05), (0.016, 0.022), leaf)
    shell.block(wall, (s1 - 0.09, s1 - 0.05), (0.93, 1.15), (0.008, 0.014), metal)
    shell.block(wall, (s1 - 0.19, s1 - 0.06), (1.04, 1.06), (0.045, 0.06), metal)
    shell.block(wall, (s1 - 0.08, s1 - 0.06), (1.04, 1.06), (0.014, 0.045), metal)


def accent_side(plan: FloorPlan, room: RoomPlan) -> Side:
    """The wall for the accent colour: the longest free of openings."""

    def free(side: Side) -> float:
        taken = sum(o.stop - o.start for o in plan.openings_of(room.name, side))
        return room.wall(side).length - 1.5 * taken

    return max(SIDES, key=lambda side: (round(free(side), 3), side))


def _room(
    plan: FloorPlan, room: RoomPlan, finish: RoomFinish, palette: Palette, style: ShellStyle, sky: tuple[Material, ...]
) -> Part:
    shell = RoomShell()
    height = plan.height
    frame, sill = palette.material("window_frame"), palette.material("window_sill")
    metal, leaf = palette.material("metal"), palette.material("door")
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
        holes = [
            (*wall.along(o.start, o.stop), o.bottom, o.top) for o in openings if o.kind != "entrance"
        ]
        paint = finish.accent_wall if side == accent else finish.wall
        shell.wall(wall, height, holes, paint, tiles, finish.tile_height)
        for opening in openings:
            along = wall.along(opening.start, opening.stop)
            if opening.kind == "window":
                _window(shell, wall, opening, finish.ceiling, frame, sill, metal, sky, style)
            elif opening.kind == "entrance":
                _entrance(shell, wall, opening, leaf, door_frame, metal)
            else:
                _casing(shell, wall, along, opening.top, door_frame)
                if opening.room == room.name:
                    shell.reveal(wall, along, (0.0, opening.top), INNER_WALL, door_frame, finish.floor)
        if tiles is None:
            doors = sorted(wall.along(o.start, o.stop) for o in openings if o.bottom == 0.0)
            ends = [0.0, *(v for a, b in doors for v in (a - CASING_WIDTH, b + CASING_WIDTH)), wall.length]
            for start, stop in zip(ends[::2], ends[1::2], strict=True):
                if stop - start > 0.02:
                    depth = (0.0, SKIRTING_DEPTH)
                    shell.block(wall, (start, stop), (0.0, style.skirting), depth, finish.skirting, "front left right top")
        if style.cornice and tiles is None:
            c, length = style.cornice, wall.length
            corners = ((0, height - c, 0), (length, height - c, 0), (length - c, height, c), (c, height, c))
            shell.quad(np.array([wall.point(*corner) for corner in corners]), finish.ceiling)
    return shell.part(f"shell_{room.name}")


def build_shell(plan: FloorPlan, palette: Palette, rng: Generator) -> tuple[Part, ...]:
    """One part per room, ``shell_<room>``."""
    style = ShellStyle.from_rng(rng)
    sky = _sky(style)
    return tuple(_room(plan, room, palette.finish(room.name), palette, style, sky) for room in plan.rooms)
