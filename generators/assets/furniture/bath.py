"""Bathtub and shower."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import (
    ring_stack,
    tap,
)
from generators.assets.shapes import rotation
from generators.core.scene import Material


@dataclass(frozen=True)
class Vessel:
    """Sizes of a basin, tub or tray, in metres; ``foot`` is a ratio.

    Attributes:
        width, depth: outer size of the rim.
        bottom, top: heights of the underside and of the rim.
        rim: width of the rim.
        deep: depth of the inside, from the rim to its floor.
        corner: radius of the corners.
        slope: difference in width of the inside between rim and floor.
        foot: width of the underside, relative to the rim's.
        inset: distance by which the outside is set back from the rim.
    """

    width: float
    depth: float
    bottom: float
    top: float
    rim: float
    deep: float
    corner: float
    slope: float
    foot: float = 1.0
    inset: float = 0.0


def hollow(kit: Kit, size: Vessel, material: Material, *, centre: tuple[float, float] = (0.0, 0.0)) -> None:
    """A vessel with a rounded rim: one surface from the outside over the rim to the floor inside."""
    width, depth, bottom, top = size.width, size.depth, size.bottom, size.top
    rim, deep, corner, slope, foot, inset = size.rim, size.deep, size.corner, size.slope, size.foot, size.inset
    w, d = width - 2 * rim, depth - 2 * rim
    middle = 0.35 * foot + 0.65
    lip = min(0.012, 0.6 * rim)
    kit.loft(
        ring_stack(
            [
                (width * foot - inset, depth * foot - inset, corner, bottom),
                (width * middle - inset, depth * middle - inset, corner, bottom + 0.5 * (top - bottom)),
                (width - 0.012 - inset, depth - 0.012 - inset, corner, top - 0.026),
                (width - 0.012, depth - 0.012, corner, top - 0.025),
                (width, depth, corner, top - 0.018),
                (width, depth, corner, top - 0.006),
                (width - lip, depth - lip, corner, top),
                (w + lip, d + lip, corner + 0.06, top),
                (w, d, corner + 0.06, top - 0.012),
                (w - 0.3 * slope, d - 0.3 * slope * 0.6, corner + 0.06, top - 0.4 * deep),
                (w - 0.75 * slope, d - 0.75 * slope * 0.6, corner + 0.05, top - 0.85 * deep),
                (w - 1.25 * slope, d - 1.0 * slope * 0.8, corner + 0.02, top - deep),
            ],
            centre=centre,
            per_corner=6,
        ),
        material,
        crease=50.0,
    )


def bathtub(kit: Kit, *, length: float | None = None) -> None:
    """A bath: built in with a panel or tiled apron (against a wall), or freestanding."""
    form = kit.pick("panel", "tiled", "freestanding")
    width = length or float(kit.rng.choice([1.6, 1.7, 1.75]))
    depth, top = (0.76, 0.58) if form == "freestanding" else (0.75, 0.56)
    enamel, metal = kit.m("ceramic"), kit.m("tap")
    if form == "freestanding":
        hollow(kit, Vessel(width, depth, 0.0, top, rim=0.035, deep=0.44, corner=0.34, slope=0.3, foot=0.78), enamel)
        kit.rod((0.0, 0.0, -depth / 2 - 0.07), (0.0, 0.86, -depth / 2 - 0.07), 0.016, metal)
        kit.tube(
            [(0.0, 0.84, -depth / 2 - 0.07), (0.0, 0.86, -depth / 2 + 0.02), (0.0, 0.83, -depth / 2 + 0.1)],
            0.014,
            metal,
            segments=8,
        )
        kit.cylinder(0.03, 0.02, (0.0, 0.01, -depth / 2 - 0.07), metal, segments=14)
    else:
        apron = kit.m("tiles_bathroom") if form == "tiled" else kit.m("enamel")
        hollow(kit, Vessel(width, depth, 0.05, top, rim=0.06, deep=0.42, corner=0.03, slope=0.26, inset=0.06), enamel)
        kit.panel(
            (-width / 2 + 0.015, 0.0, -depth / 2 + 0.012),
            (width / 2 - 0.015, 0.045, depth / 2 - 0.03),
            apron,
            bevel=0.0,
        )
        # The apron ends in the underside of the rim: a gap of 2 mm would be seen as dark dashes.
        edge, under = depth / 2 - 0.005, top - 0.024
        kit.panel((-width / 2 + 0.005, 0.0, edge - 0.02), (width / 2 - 0.005, under, edge), apron, bevel=0.002)
        for side in (-1, 1):
            low, high = sorted((side * (width / 2 - 0.005), side * (width / 2 - 0.025)))
            kit.panel((low, 0.0, -depth / 2 + 0.005), (high, under, edge - 0.02), apron, bevel=0.0)
        kit.panel((-0.13, top, -depth / 2 + 0.015), (0.13, top + 0.045, -depth / 2 + 0.055), metal, bevel=0.01)
        tap(kit, (0.0, top + 0.04, -depth / 2 + 0.035), metal, style="block", height=0.05, reach=0.14)
    kit.cylinder(
        0.026, 0.006, (0.0, top - 0.415 - (0.02 if form == "freestanding" else 0.0), 0.0), kit.m("chrome"), segments=14
    )
    kit.cylinder(
        0.032,
        0.012,
        (width / 2 - (0.22 if form == "freestanding" else 0.155), top - 0.14, 0.0),
        kit.m("chrome"),
        axis="x",
        segments=14,
    )
    kit.sound((-width / 2, 0.0, -depth / 2), (width / 2, top - 0.42, depth / 2), enamel)
    for side in (-1, 1):
        kit.sound(
            (min(side * width / 2, side * (width / 2 - 0.1)), top - 0.42, -depth / 2),
            (max(side * width / 2, side * (width / 2 - 0.1)), top, depth / 2),
            enamel,
        )
        kit.sound(
            (-width / 2 + 0.1, top - 0.42, min(side * depth / 2, side * (depth / 2 - 0.08))),
            (width / 2 - 0.1, top, max(side * depth / 2, side * (depth / 2 - 0.08))),
            enamel,
        )


def shower(kit: Kit, *, width: float | None = None) -> None:
    """A shower: tray, two tiled corner walls (back and left), a glass or a curtain on a rail, riser rail and head."""
    w = width or float(kit.rng.choice([0.9, 1.0]))
    d, tall = 0.9, 2.05
    metal, tiles = kit.m("tap"), kit.m("tiles_bathroom")
    form = kit.pick("curtain", "glass")
    tray = Vessel(w, d, 0.0, 0.075, rim=0.04, deep=0.04, corner=0.012, slope=0.05)
    hollow(kit, tray, kit.m("ceramic"), centre=(0.0, d / 2))
    kit.cylinder(0.045, 0.006, (0.0, 0.036, d / 2), kit.m("chrome"), segments=18)
    with kit.one_slab():
        kit.panel((-w / 2, 0.075, 0.0), (w / 2, tall, 0.025), tiles, bevel=0.0)
        kit.panel((-w / 2, 0.075, 0.025), (-w / 2 + 0.025, tall, d), tiles, bevel=0.0)
    _riser(kit, metal)
    _bottles(kit, w)
    if form == "glass":
        _glass_side(kit, w, d)
    else:
        _curtain_side(kit, w, d)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, 0.05, d), kit.m("ceramic"))
    kit.sound((-w / 2, 0.05, 0.0), (w / 2, tall, 0.025), tiles)
    kit.sound((-w / 2, 0.05, 0.025), (-w / 2 + 0.025, tall, d), tiles)


def _curtain_side(kit: Kit, w: float, d: float) -> None:
    """A rail round the corner and a curtain on the right side of a shower of width ``w`` and depth ``d`` (m)."""
    kit.tube(
        [
            (w / 2 - 0.02, 1.98, 0.02),
            (w / 2 - 0.02, 1.98, d - 0.08),
            (w / 2 - 0.05, 1.98, d - 0.03),
            (w / 2 - 0.1, 1.98, d - 0.02),
            (-w / 2 + 0.02, 1.98, d - 0.02),
        ],
        0.011,
        kit.m("chrome"),
        segments=8,
    )
    run = np.linspace(0.06, d - 0.14, 34)
    rows = []
    for y in np.linspace(1.955, 0.12, 7):
        open_ = 0.018 + 0.010 * (1.955 - y) / 1.8
        rows.append(
            np.stack([w / 2 - 0.022 + open_ * np.sin(run * 62 + 0.6 * np.sin(3 * y)), np.full(34, y), run], axis=1)
        )
    kit.shell(np.array(rows), 0.002, kit.m("towel_1"))
    kit.sound((w / 2 - 0.03, 0.12, 0.05), (w / 2, 1.96, d - 0.1), kit.m("curtain"))


def _glass_side(kit: Kit, w: float, d: float) -> None:
    """A framed pane on the right side of a shower of width ``w`` and depth ``d`` (m)."""
    glass = kit.m("clear_glass")
    kit.panel((w / 2 - 0.01, 0.075, 0.03), (w / 2 - 0.002, 2.0, d - 0.02), glass, bevel=0.0)
    for y in (0.085, 2.0):
        kit.panel((w / 2 - 0.016, y - 0.01, 0.025), (w / 2 + 0.004, y + 0.01, d - 0.015), kit.m("metal"), bevel=0.002)
    kit.panel((w / 2 - 0.016, 0.075, d - 0.03), (w / 2 + 0.004, 2.01, d - 0.01), kit.m("metal"), bevel=0.002)
    kit.sound((w / 2 - 0.012, 0.075, 0.0), (w / 2, 2.0, d), glass)


def _bottles(kit: Kit, w: float) -> None:
    """A shelf on the back wall with two or three bottles; ``w``: width of the shower (m)."""
    shelf = w / 2 - 0.2
    kit.panel((shelf, 1.12, 0.025), (shelf + 0.17, 1.13, 0.11), kit.m("chrome"), bevel=0.002)
    for k, role in enumerate(("plastic_white", "ceramic_accent", "plastic_black")[: 2 + int(kit.rng.integers(2))]):
        kit.cylinder(
            0.024,
            0.15 - 0.025 * k,
            (shelf + 0.035 + 0.055 * k, 1.205 - 0.0125 * k, 0.07),
            kit.m(role),
            segments=12,
            bevel=0.008,
        )


def _riser(kit: Kit, metal: Material) -> None:
    """Riser rail with the overhead shower, the mixer and the hand shower on its hose."""
    kit.rod((0.0, 0.95, 0.07), (0.0, 1.98, 0.07), 0.0105, metal, sides=10)
    kit.tube(
        [(0.0, 1.97, 0.07), (0.0, 2.02, 0.1), (0.0, 2.02, 0.36), (0.0, 2.0, 0.38), (0.0, 1.97, 0.38)],
        0.0105,
        metal,
        segments=8,
    )
    kit.cylinder(0.115, 0.014, (0.0, 1.965, 0.38), metal, segments=24, bevel=0.004)
    kit.rod((-0.13, 1.05, 0.07), (0.13, 1.05, 0.07), 0.021, metal, sides=12)
    for x in (-0.13, 0.13):
        kit.cylinder(0.026, 0.05, (x, 1.05, 0.07), metal, axis="x", segments=12, bevel=0.005)
    for y in (1.05, 1.75):
        kit.rod((0.0, y, 0.02), (0.0, y, 0.07), 0.012, metal)
    kit.rod((0.02, 1.5, 0.1), (0.05, 1.66, 0.15), 0.013, metal, end_radius=0.011)
    head = [(0.0, -0.009), (0.04, -0.009), (0.045, 0.004), (0.0, 0.009)]
    kit.lathe(head, metal, centre=(0.055, 1.68, 0.155), segments=16, rotate=rotation("x", 60))
    t = np.linspace(0, 1, 12)
    hose = np.stack(
        [0.02 + 0.13 * np.sin(np.pi * t), 1.5 - 0.75 * np.sin(np.pi * t) * (1 - 0.35 * t) - 0.47 * t, 0.1 + 0.02 * t],
        axis=1,
    )
    kit.tube(hose, 0.007, kit.m("chrome"), segments=6)
