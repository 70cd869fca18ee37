"""Kitchen: wall cabinets, fridge, oven cabinet, extractor hood, open shelf."""

from __future__ import annotations

import numpy as np

from avs3d_bench.errors import UsageError
from generators.assets.furniture.common import Kit
from generators.assets.furniture.counter import DEPTH, PLINTH, oven_front
from generators.assets.furniture.parts import (
    book_row,
    bowl,
    carcass,
    front,
    handle,
    is_shaker,
    pull_style,
    vase,
)


def wall_cabinet(kit: Kit, *, length: float | None = None, height: float | None = None) -> None:
    """Wall cabinets with equal doors, sometimes with one open compartment."""
    kit.mount = "wall"
    width, h, d = float(length or 1.8), height or 0.7, 0.33
    if not 0.3 <= width <= 6.0:
        raise UsageError(f"wall_cabinet: length is {width} m, expected 0.3 to 6")
    count = max(1, round(width / 0.6))
    step, box, shaker = width / count, kit.m("front_upper"), is_shaker(kit)
    opened = int(kit.rng.integers(count)) if count > 1 and kit.rng.random() < 0.5 else -1
    for k in range(count):
        x0, x1 = -width / 2 + k * step, -width / 2 + (k + 1) * step
        if k == opened:
            carcass(kit, (x0, 0.0, 0.0), (x1, h, d), box)
            kit.panel((x0 + 0.018, h * 0.5, 0.008), (x1 - 0.018, h * 0.5 + 0.018, d - 0.02), box, bevel=0.001)
            _crockery(kit, (x0 + 0.02, x1 - 0.02), 0.018, d)
            _crockery(kit, (x0 + 0.02, x1 - 0.02), h * 0.5 + 0.018, d)
        else:
            kit.panel((x0, 0.0, 0.0), (x1, h, d), box, bevel=0.0)
            front(
                kit,
                (x0, x1),
                (0.0, h),
                d,
                box,
                shaker=shaker,
                pull=pull_style(kit, "right_low" if k % 2 == 0 else "left_low"),
            )
    kit.sound((-width / 2, 0.0, 0.0), (width / 2, h, d + 0.019), box)


def _crockery(kit: Kit, x: tuple[float, float], y: float, depth: float) -> None:
    """Plates, mugs or bowls on a shelf between ``x``."""
    kind = kit.pick("plates", "mugs", "bowls")
    white = kit.m(kit.pick("pot_white", "ceramic_accent"))
    z = depth * 0.5
    if kind == "plates":
        at = x[0] + 0.13
        for k in range(6):
            kit.cylinder(0.105, 0.009, (at, y + 0.005 + 0.012 * k, z), white, segments=20)
        bowl(kit, (x[1] - 0.12, y, z), kit.m("pot_white"), 0.085, 0.08)
    elif kind == "mugs":
        for at in np.arange(x[0] + 0.07, x[1] - 0.06, 0.105):
            kit.lathe(
                [(0.0, 0.0), (0.037, 0.0), (0.04, 0.09), (0.036, 0.09), (0.033, 0.01), (0.0, 0.01)],
                white,
                centre=(at, y, z),
                segments=12,
            )
    else:
        for at in np.arange(x[0] + 0.1, x[1] - 0.09, 0.19):
            for k in range(3):
                bowl(kit, (at, y + 0.022 * k, z), white, 0.075, 0.06)


def fridge(kit: Kit) -> None:
    """A fridge-freezer: steel or white with two doors, or a rounded retro one in the flat's accent colour."""
    form = kit.pick("steel", "white", "retro")
    w, d, tall = 0.6, 0.62, kit.near(1.85, 0.03)
    skin = kit.m({"steel": "steel", "white": "enamel", "retro": "ceramic_accent"}[form])
    chrome = kit.m("chrome" if form != "white" else "steel")
    kit.panel((-w / 2 + 0.02, 0.0, 0.03), (w / 2 - 0.02, 0.05, d - 0.06), kit.m("plastic_black"), bevel=0.0)
    round_ = 0.05 if form == "retro" else 0.006
    split = tall * (0.72 if form == "retro" else 0.36)
    with kit.grained("y"):
        if form == "retro":
            kit.soft(
                (w, tall - 0.03, d - 0.06), (0.0, 0.03 + (tall - 0.03) / 2, (d - 0.06) / 2), skin, radius=0.05, cells=6
            )
        else:
            kit.panel((-w / 2, 0.04, 0.0), (w / 2, tall, d - 0.055), skin, bevel=0.004)
        for y0, y1 in ((0.045, split - 0.004), (split + 0.004, tall)):
            centre = (0.0, (y0 + y1) / 2, d - 0.02)
            if form == "retro":
                kit.soft((w, y1 - y0, 0.075), centre, skin, radius=round_ * 0.7, puff=(0.0, 0.0, 0.008), cells=6)
            else:
                kit.panel((-w / 2, y0, d - 0.05), (w / 2, y1, d + 0.005), skin, bevel=0.006)
    face = d + (0.018 if form == "retro" else 0.005)
    for y0, y1 in ((split - 0.35, split - 0.06), (split + 0.06, split + 0.42)):
        low, high = max(y0, 0.15), min(y1, tall - 0.1)
        handle(kit, (-w / 2 + 0.055, (low + high) / 2, face), chrome, style="bar", length=high - low, axis="y")
    if form != "retro":
        kit.panel((-0.045, tall - 0.14, d + 0.005), (0.045, tall - 0.12, d + 0.007), kit.m("chrome"), bevel=0.0)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), kit.m("enamel"))


def oven_unit(kit: Kit, *, height: float | None = None) -> None:
    """A built-in oven: in a tall cabinet at working height, or (``height`` below 1 m) in a base cabinet."""
    tall = float(height or 2.1)
    w, d = 0.6, DEPTH
    box, shaker = kit.m("front"), is_shaker(kit)
    back = d - 0.022
    kit.panel((-w / 2, PLINTH, 0.0), (w / 2, tall - (0.04 if tall < 1 else 0.0), back), box, bevel=0.001)
    kit.panel((-w / 2, 0.0, 0.02), (w / 2, PLINTH, d - 0.07), kit.m("plastic_black"), bevel=0.0)
    if tall < 1.0:
        with kit.grained("x"):
            kit.panel((-w / 2, tall - 0.04, 0.0), (w / 2, tall, d + 0.02), kit.m("worktop"), bevel=0.003)
        front(kit, (-w / 2, w / 2), (PLINTH, PLINTH + 0.14), back, box)
        oven_front(kit, (-w / 2, w / 2), (PLINTH + 0.14, tall - 0.045), back)
        kit.support("worktop", (-w / 2 + 0.03, w / 2 - 0.03), (0.03, d - 0.02), tall, clearance=0.5)
        kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), box)
        return
    low = 0.68
    half = (low - PLINTH) / 2
    for k in range(2):
        front(
            kit,
            (-w / 2, w / 2),
            (PLINTH + k * half, PLINTH + (k + 1) * half),
            back,
            box,
            shaker=shaker,
            pull=pull_style(kit, "top"),
            grain="x",
        )
    oven_front(kit, (-w / 2, w / 2), (low, low + 0.6), back)
    front(kit, (-w / 2, w / 2), (low + 0.6, tall), back, box, shaker=shaker, pull=pull_style(kit, "left_low"))
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), box)
    kit.sound((-w / 2 + 0.05, low + 0.05, d - 0.02), (w / 2 - 0.05, low + 0.45, d + 0.003), kit.m("black_glass"))


def extractor_hood(kit: Kit) -> None:
    """A chimney hood: pyramid or box canopy with a duct, lit below."""
    kit.mount = "wall"
    form = kit.pick("pyramid", "box")
    w, d, duct = 0.6, 0.48, kit.near(0.5, 0.1)
    steel = kit.m(kit.pick("steel", "steel", "black_metal"))
    with kit.grained("x"):
        kit.panel((-w / 2, 0.0, 0.0), (w / 2, 0.05, d), steel, bevel=0.003)
    if form == "pyramid":
        rings = []
        for s, y in ((1.0, 0.05), (0.97, 0.055), (0.5, 0.2), (0.46, 0.22)):
            ww, dd = w * s if s > 0.6 else 0.29 * s / 0.46, d * s if s > 0.6 else 0.26 * s / 0.46
            rings.append([(-ww / 2, y, 0.0), (-ww / 2, y, dd), (ww / 2, y, dd), (ww / 2, y, 0.0)])
        kit.loft(rings, steel, crease=30.0)
        base = 0.21
    else:
        base = 0.05
    with kit.grained("y"):
        kit.panel((-0.14, base, 0.0), (0.14, base + duct, 0.25), steel, bevel=0.003)
    for x in (-0.17, 0.17):
        kit.cylinder(0.03, 0.004, (x, -0.001, d * 0.62), kit.m("hood_light"), segments=14)
    kit.panel((-0.22, -0.004, 0.08), (0.22, 0.0, d * 0.48), kit.m("black_metal"), bevel=0.0)
    for k in range(4):
        kit.cylinder(0.007, 0.006, (-0.05 + 0.033 * k, 0.025, d + 0.002), kit.m("chrome"), axis="z", segments=10)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, 0.12, d), steel)
    kit.sound((-0.14, 0.12, 0.0), (0.14, base + duct, 0.25), steel)


def kitchen_shelf(kit: Kit, *, length: float | None = None) -> None:
    """Two boards on brackets with jars, mugs and a cookery book or two; one end of the lower board is free."""
    kit.mount = "wall"
    w, d = float(length or 0.9), 0.24
    board, metal = kit.m("wood"), kit.m("metal")
    levels = (0.0, 0.36)
    for y in levels:
        kit.panel((-w / 2, y, 0.0), (w / 2, y + 0.028, d), board, bevel=0.003)
        for x in (-w / 2 + 0.12, w / 2 - 0.12):
            kit.panel((x - 0.012, y - 0.14, 0.0), (x + 0.012, y, 0.006), metal, bevel=0.0)
            kit.rod((x, y - 0.125, 0.004), (x, y - 0.006, d - 0.05), 0.006, metal, sides=6)
    top = levels[1] + 0.028
    _crockery(kit, (-w / 2 + 0.02, -w / 2 + 0.34), top, d)
    book_row(kit, (w / 2 - 0.3, w / 2 - 0.06), top, d - 0.02, 0.26, most=5)
    vase(kit, (0.02, top, d / 2), kit.m("ceramic_accent"), 0.17)
    low = levels[0] + 0.028
    for k in range(3):
        x = -w / 2 + 0.08 + 0.11 * k
        kit.cylinder(
            0.043, 0.13, (x, low + 0.065, d / 2), kit.m(("glass", "fruit_orange", "paper")[k]), segments=16, bevel=0.006
        )
        kit.cylinder(0.044, 0.022, (x, low + 0.141, d / 2), kit.m("wood_alt"), segments=16, bevel=0.003)
    free = -w / 2 + 0.38
    if w / 2 - free > 0.2:
        kit.support("shelf", (free, w / 2 - 0.03), (0.01, d - 0.01), low, clearance=levels[1] - low - 0.15)
    for y in levels:
        kit.sound((-w / 2, y, 0.0), (w / 2, y + 0.028, d), board)
