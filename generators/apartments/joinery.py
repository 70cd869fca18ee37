"""Windows, door casings and the entrance's leaf, and what varies in them from flat to flat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from generators.apartments.floorplan import WallFrame, WallOpening
from generators.apartments.roomshell import RoomShell
from generators.core.scene import Material, Texture

#: Radiance of the sky behind a window pane, in the scene's light unit.
SKY_RADIANCE = 16.0
#: Distance of the panes behind the wall's inner surface (m).
PANE_DEPTH = 0.16
#: Width of the casings round doors and windows, and how far they stand out from the wall (m).
CASING_WIDTH, CASING_DEPTH = 0.07, 0.016
#: Number of strips into which a pane is cut, each with its own radiance: the blurred view of the outdoors.
SKY_STRIPS = 36
#: Radiance of the outdoors as the camera sees it: a little brighter than a white wall, not overexposed.
VIEW_BRIGHTNESS = (2.3, 2.3, 2.3)
#: Width of the outdoors that the view's texture spans, on the pane (m).
VIEW_WIDTH = 3.2

#: Shares of a window's height, from its lower edge up, and the colour of the light that comes from there (linear RGB):
#: dark and light garden, haze over the horizon, bright and blue sky. Between them, colours are interpolated.
_OUTDOORS = (
    (0.0, (0.20, 0.24, 0.15)),
    (0.22, (0.30, 0.36, 0.24)),
    (0.42, (0.78, 0.80, 0.76)),
    (0.62, (1.05, 1.04, 1.0)),
    (1.0, (0.86, 0.97, 1.14)),
)
#: Tints of the daylight (linear RGB): white, warm, cool.
_SKIES = ((1.0, 1.0, 1.0), (1.03, 1.0, 0.95), (0.95, 0.99, 1.06))
#: What a pane itself reflects (linear RGB), and its roughness.
_PANE_COLOUR, _PANE_ROUGHNESS = (0.04, 0.04, 0.04), 0.01

#: Depth of a window's frame before its panes (m).
FRAME_DEPTH = 0.055
#: Width of the frame round a window, and of the bars between its sashes (m).
_FRAME_WIDTH, _BAR_WIDTH = 0.065, 0.09
#: Width of a sash (m), about: a window has as many as fit best.
_SASH_WIDTH = 0.8
#: The window sill: how much longer it is than the opening on each side, beside a casing if there is one, its thickness,
#: and how far it stands out from the wall (m).
_SILL_NOSE, _SILL_THICK, SILL_DEPTH = 0.04, 0.03, 0.045
#: Windows up to this height have no transom (m); half the height of a transom, and how much less deep than the frame it
#: is (m).
_LOW_WINDOW, _TRANSOM_HALF, _TRANSOM_INSET = 1.1, 0.03, 0.01
#: Height of a window's handle: share of the window's height.
_HANDLE_SHARE = 0.45
#: The handle's plate: half its width, half its height, its thickness (m).
_PLATE_HALF_WIDTH, _PLATE_HALF_HEIGHT, _PLATE_THICK = 0.011, 0.03, 0.012
#: The handle's lever, which points down: half its width, its lower and upper end from the plate's middle, and how far
#: it stands out from the frame (m).
_LEVER_HALF_WIDTH, _LEVER_LOW, _LEVER_HIGH, _LEVER_DEPTH = 0.009, 0.11, 0.015, 0.035
#: Shortest piece of pane that is drawn (m).
_LEAST_PANE = 1e-4

#: The entrance's leaf: how far it stands out from the wall, and where the two steps of its raised panels end (m).
_LEAF_DEPTH, _PANEL_DEPTHS = 0.008, (0.016, 0.022)
#: Distance of the panels from the leaf's sides, and of a panel's second step from its first (m).
_PANEL_INSET, _PANEL_STEP = 0.13, 0.05
#: Heights of the lower panel, and of the upper panel's lower edge, above the floor; distance of its upper edge from the
#: leaf's top (m).
_LOWER_PANEL, _UPPER_PANEL, _PANEL_TOP = (0.2, 0.85), 1.0, 0.16


class _Fitting(NamedTuple):
    """A metal block on the entrance's leaf; metres.

    Attributes:
        sides: distances of its left and right side from the leaf's right edge.
        heights: of its lower and upper side above the floor; 1.05 m is the usual height of a handle.
        depths: distances of its back and front from the wall.
    """

    sides: tuple[float, float]
    heights: tuple[float, float]
    depths: tuple[float, float]


#: What is on the entrance's leaf.
_LOCK_PLATE = _Fitting((0.09, 0.05), (0.93, 1.15), (_LEAF_DEPTH, 0.014))
_HANDLE_LEVER = _Fitting((0.19, 0.06), (1.04, 1.06), (0.045, 0.06))
_HANDLE_NECK = _Fitting((0.08, 0.06), (1.04, 1.06), (0.014, 0.045))


@dataclass(frozen=True)
class ShellStyle:
    """Dimensions that vary in the joinery of a flat (m).

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
        """`MODERN` or `CLASSIC`, with one of the tints of daylight."""
        style = CLASSIC if rng.integers(2) else MODERN
        return replace(style, sky=_SKIES[int(rng.integers(len(_SKIES)))])


#: With mouldings, and without.
CLASSIC = ShellStyle(skirting=0.11, cornice=0.06, transom=0.72, window_casing=True, sky=_SKIES[0])
MODERN = ShellStyle(skirting=0.07, cornice=0.0, transom=0.0, window_casing=False, sky=_SKIES[0])


def casing(shell: RoomShell, wall: WallFrame, along: tuple[float, float], top: float, frame: Material) -> None:
    """Door casing on one side of an opening."""
    s0, s1 = along
    depth, high = (0.0, CASING_DEPTH), top + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (0.0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (top, high), depth, frame, "front top bottom")


def sky_strips(style: ShellStyle, view: Texture) -> tuple[Material, ...]:
    """Materials of the strips of a pane, from the lowest up: garden, bright haze, sky; the camera sees ``view``."""
    stops = np.array([share for share, _ in _OUTDOORS])
    colours = np.array([colour for _, colour in _OUTDOORS])
    heights = (np.arange(SKY_STRIPS) + 0.5) / SKY_STRIPS
    radiance = np.stack([np.interp(heights, stops, colours[:, c]) for c in range(3)], axis=1)
    radiance *= SKY_RADIANCE * np.array(style.sky)
    return tuple(
        Material(
            f"sky_{i}",
            "glass",
            _PANE_COLOUR,
            texture=view,
            emission=(float(r), float(g), float(b)),
            roughness=_PANE_ROUGHNESS,
            shown=VIEW_BRIGHTNESS,
        )
        for i, (r, g, b) in enumerate(radiance)
    )


@dataclass(frozen=True, eq=False)
class WindowMaterials:
    """Materials of the parts of a window; ``sky`` are the strips of its panes from the bottom to the top."""

    lining: Material
    frame: Material
    sill: Material
    metal: Material
    sky: tuple[Material, ...]


def window(
    shell: RoomShell,
    wall: WallFrame,
    opening: WallOpening,
    materials: WindowMaterials,
    style: ShellStyle,
) -> None:
    """Reveal, sill, frame with sashes, and the panes that light the room."""
    frame, sill, metal, sky = materials.frame, materials.sill, materials.metal, materials.sky
    s0, s1 = wall.along(opening.start, opening.stop)
    y0, y1 = opening.bottom, opening.top
    shell.reveal(wall, (s0, s1), (y0, y1), PANE_DEPTH, materials.lining, sill)
    back, front = -PANE_DEPTH, -PANE_DEPTH + FRAME_DEPTH
    if style.window_casing:
        _window_casing(shell, wall, (s0, s1), (y0, y1), frame)
    nose = _SILL_NOSE + (CASING_WIDTH if style.window_casing else 0.0)
    shell.block(wall, (s0 - nose, s1 + nose), (y0 - _SILL_THICK, y0), (0.0, SILL_DEPTH), sill)
    corners = ((s0, y0, back), (s1, y0, back), (s1, y1, back), (s0, y1, back))
    shell.sound(np.array([wall.point(*c) for c in corners]), sky[0])

    border, bar = _FRAME_WIDTH, _BAR_WIDTH
    sashes = max(1, round((s1 - s0) / _SASH_WIDTH))
    edges = [s0, *(s0 + (s1 - s0) * k / sashes for k in range(1, sashes)), s1]
    for k in range(sashes + 1):
        low = s0 if k == 0 else edges[k] - (border if k == sashes else bar / 2)
        high = s1 if k == sashes else edges[k] + (border if k == 0 else bar / 2)
        shell.block(wall, (low, high), (y0, y1), (back, front), frame, "front left right")
        if 0 < k < sashes or sashes == 1 == k:
            middle = edges[k] if k < sashes else s1 - border / 2
            _window_handle(shell, wall, (middle, y0 + _HANDLE_SHARE * (y1 - y0)), front, metal)
    rows = [(y0 + border, y1 - border)]
    if style.transom and y1 - y0 > _LOW_WINDOW:
        cross = y0 + style.transom * (y1 - y0)
        rows = [(y0 + border, cross - _TRANSOM_HALF), (cross + _TRANSOM_HALF, y1 - border)]
    for k in range(sashes):
        low = s0 + border if k == 0 else edges[k] + bar / 2
        high = s1 - border if k == sashes - 1 else edges[k + 1] - bar / 2
        shell.block(wall, (low, high), (y0, rows[0][0]), (back, front), frame, "front top")
        shell.block(wall, (low, high), (rows[-1][1], y1), (back, front), frame, "front bottom")
        if len(rows) == 2:
            depth = (back, front - _TRANSOM_INSET)
            shell.block(wall, (low, high), (rows[0][1], rows[1][0]), depth, frame, "front top bottom")
        for bottom, top in rows:
            cuts = np.linspace(y0, y1, len(sky) + 1)
            for material, first, last in zip(sky, cuts[:-1], cuts[1:], strict=True):
                a, b = max(float(first), bottom), min(float(last), top)
                if b - a > _LEAST_PANE:
                    pane = ((low, a, back), (high, a, back), (high, b, back), (low, b, back))
                    view = (
                        ((low - s0) / VIEW_WIDTH, (high - s0) / VIEW_WIDTH),
                        ((a - y0) / (y1 - y0), (b - y0) / (y1 - y0)),
                    )
                    shell.pane(np.array([wall.point(*c) for c in pane]), material, *view)


def _window_handle(
    shell: RoomShell, wall: WallFrame, middle: tuple[float, float], front: float, metal: Material
) -> None:
    """A handle on a sash whose surface is at the depth ``front``; ``middle`` of its plate: along the wall, height."""
    along, height = middle
    plate = front + _PLATE_THICK
    shell.block(
        wall,
        (along - _PLATE_HALF_WIDTH, along + _PLATE_HALF_WIDTH),
        (height - _PLATE_HALF_HEIGHT, height + _PLATE_HALF_HEIGHT),
        (front, plate),
        metal,
    )
    shell.block(
        wall,
        (along - _LEVER_HALF_WIDTH, along + _LEVER_HALF_WIDTH),
        (height - _LEVER_LOW, height + _LEVER_HIGH),
        (plate, front + _LEVER_DEPTH),
        metal,
    )


def _window_casing(
    shell: RoomShell, wall: WallFrame, along: tuple[float, float], height: tuple[float, float], frame: Material
) -> None:
    (s0, s1), (y0, y1) = along, height
    depth, high = (0.0, CASING_DEPTH), y1 + CASING_WIDTH
    shell.block(wall, (s0 - CASING_WIDTH, s0), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s1, s1 + CASING_WIDTH), (y0, high), depth, frame, "front left right top")
    shell.block(wall, (s0, s1), (y1, high), depth, frame, "front top bottom")


def entrance(
    shell: RoomShell, wall: WallFrame, opening: WallOpening, leaf: Material, frame: Material, metal: Material
) -> None:
    """A closed leaf with two panels, a lock plate and a handle, in its casing."""
    s0, s1 = wall.along(opening.start, opening.stop)
    casing(shell, wall, (s0, s1), opening.top, frame)
    shell.block(wall, (s0, s1), (0.0, opening.top), (0.0, _LEAF_DEPTH), leaf, "front")
    inset, step, (first, second) = _PANEL_INSET, _PANEL_STEP, _PANEL_DEPTHS
    for low, high in (_LOWER_PANEL, (_UPPER_PANEL, opening.top - _PANEL_TOP)):
        shell.block(wall, (s0 + inset, s1 - inset), (low, high), (_LEAF_DEPTH, first), leaf)
        shell.block(wall, (s0 + inset + step, s1 - inset - step), (low + step, high - step), (first, second), leaf)
    for (left, right), heights, depths in (_LOCK_PLATE, _HANDLE_LEVER, _HANDLE_NECK):
        shell.block(wall, (s1 - left, s1 - right), heights, depths, metal)
