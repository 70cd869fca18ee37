"""Windows, door casings and the entrance's leaf, and what varies in them from flat to flat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import Opening, WallFrame
from generators.apartments.roomshell import RoomShell
from generators.core.scene import Material, Texture

#: Radiance of the sky behind a window pane, in the scene's light unit.
SKY_RADIANCE = 16.0
#: How far the panes lie behind the wall's inner surface.
PANE_DEPTH = 0.16
CASING_WIDTH = 0.07
CASING_DEPTH = 0.016
#: A pane is cut into this many strips, each with its own radiance: the blurred view of the outdoors.
SKY_STRIPS = 36
#: The outdoors as the camera sees it: a little brighter than a white wall, short of burning out.
VIEW_BRIGHTNESS = (2.3, 2.3, 2.3)
#: Width of the outdoors that the view's texture spans, metres on the pane.
VIEW_WIDTH = 3.2


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


def casing(shell: RoomShell, wall: WallFrame, along: tuple[float, float], top: float, frame: Material) -> None:
    """Door casing on one side of an opening."""
    s0, s1 = along
    depth, high = (0.0, CASING_DEPTH), top + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (top, high), depth, frame, "front top bottom")


def sky_strips(style: ShellStyle, view: Texture) -> tuple[Material, ...]:
    """Materials of the strips of a pane, from the lowest up: garden, bright haze, sky; the camera sees ``view``."""
    stops = np.array([0.0, 0.22, 0.42, 0.62, 1.0])
    colours = np.array(
        [[0.20, 0.24, 0.15], [0.30, 0.36, 0.24], [0.78, 0.80, 0.76], [1.05, 1.04, 1.0], [0.86, 0.97, 1.14]]
    )
    heights = (np.arange(SKY_STRIPS) + 0.5) / SKY_STRIPS
    radiance = np.stack([np.interp(heights, stops, colours[:, c]) for c in range(3)], axis=1)
    radiance *= SKY_RADIANCE * np.array(style.sky)
    return tuple(
        Material(
            f"sky_{i}",
            "glass",
            (0.04, 0.04, 0.04),
            texture=view,
            emission=(float(r), float(g), float(b)),
            gloss=0.9,
            shown=VIEW_BRIGHTNESS,
        )
        for i, (r, g, b) in enumerate(radiance)
    )


@dataclass(frozen=True, eq=False)
class WindowMaterials:
    """What the parts of a window are made of; ``sky`` are the strips of its panes from the bottom to the top."""

    lining: Material
    frame: Material
    sill: Material
    metal: Material
    sky: tuple[Material, ...]


def window(
    shell: RoomShell,
    wall: WallFrame,
    opening: Opening,
    materials: WindowMaterials,
    style: ShellStyle,
) -> None:
    """Reveal, sill, frame with sashes, and the panes that light the room."""
    frame, sill, metal, sky = materials.frame, materials.sill, materials.metal, materials.sky
    s0, s1 = wall.along(opening.start, opening.stop)
    y0, y1 = opening.bottom, opening.top
    shell.reveal(wall, (s0, s1), (y0, y1), PANE_DEPTH, materials.lining, sill)
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
                    view = (
                        ((low - s0) / VIEW_WIDTH, (high - s0) / VIEW_WIDTH),
                        ((a - y0) / (y1 - y0), (b - y0) / (y1 - y0)),
                    )
                    shell.pane(np.array([wall.point(*c) for c in pane]), material, *view)


def _window_casing(
    shell: RoomShell, wall: WallFrame, along: tuple[float, float], height: tuple[float, float], frame: Material
) -> None:
    (s0, s1), (y0, y1) = along, height
    depth, high = (0.0, CASING_DEPTH), y1 + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (y1, high), depth, frame, "front top bottom")


def entrance(
    shell: RoomShell, wall: WallFrame, opening: Opening, leaf: Material, frame: Material, metal: Material
) -> None:
    """A closed leaf with panels, a handle and a spy hole, in its casing."""
    s0, s1 = wall.along(opening.start, opening.stop)
    casing(shell, wall, (s0, s1), opening.top, frame)
    shell.block(wall, (s0, s1), (0.0, opening.top), (0.0, 0.008), leaf, "front")
    inset = 0.13
    for low, high in ((0.2, 0.85), (1.0, opening.top - 0.16)):
        shell.block(wall, (s0 + inset, s1 - inset), (low, high), (0.008, 0.016), leaf)
        shell.block(wall, (s0 + inset + 0.05, s1 - inset - 0.05), (low + 0.05, high - 0.05), (0.016, 0.022), leaf)
    shell.block(wall, (s1 - 0.09, s1 - 0.05), (0.93, 1.15), (0.008, 0.014), metal)
    shell.block(wall, (s1 - 0.19, s1 - 0.06), (1.04, 1.06), (0.045, 0.06), metal)
    shell.block(wall, (s1 - 0.08, s1 - 0.06), (1.04, 1.06), (0.014, 0.045), metal)
