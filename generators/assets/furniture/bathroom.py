"""Bathroom: washbasin, wall cabinet, towel rail, bath mat, laundry basket, tall cabinet."""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.bath import Vessel, hollow
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import (
    bowl,
    carcass,
    front,
    is_shaker,
    pull_style,
    ring_stack,
    tap,
    vase,
    wooden_legs,
)
from generators.core.scene import Material


def washbasin(kit: Kit, *, width: float | None = None) -> None:
    """A basin on a vanity with drawers (wall-hung or on legs), or a bowl standing on a wooden top."""
    form = kit.pick("inset", "inset", "vessel")
    w = width or float(kit.rng.choice([0.6, 0.8, 1.0]))
    d, top = 0.47, 0.85
    box, metal, white = kit.m("bath_front"), kit.m("tap"), kit.m("ceramic")
    hung = kit.rng.random() < 0.6
    low = 0.32 if hung else 0.16
    under = top - (0.14 if form == "inset" else 0.04)
    if form == "vessel":
        _vessel(kit, w, d, top, metal)
    else:
        _inset_basin(kit, w, d, under, top, metal)
    kit.panel((-w / 2 + 0.008, low, 0.0), (w / 2 - 0.008, under, d - 0.03), box, bevel=0.002)
    if hung:
        kit.cylinder(0.018, low, (0.0, low / 2, 0.12), kit.m("chrome"), segments=10)
    else:
        wooden_legs(kit, (-w / 2 + 0.05, w / 2 - 0.05), (0.05, d - 0.08), low, kit.m("metal"), radius=0.016)
    rows = 2 if under - low > 0.3 else 1
    height = (under - low) / rows
    for k in range(rows):
        front(
            kit,
            (-w / 2 + 0.008, w / 2 - 0.008),
            (low + k * height, low + (k + 1) * height),
            d - 0.03,
            box,
            shaker=is_shaker(kit),
            pull=pull_style(kit, "top", "tap"),
            grain="x",
        )
    if w > 0.7:
        _toiletries(kit, w / 2 - 0.09, top)
    kit.sound((-w / 2, low, 0.0), (w / 2, top, d), kit.m("white"))
    kit.sound((-w / 2, under, 0.0), (w / 2, top, d), white)


def _toiletries(kit: Kit, x: float, base: float) -> None:
    """A soap dispenser on the left and a cup of brushes on the right, ``x`` metres from the middle."""
    kit.cylinder(0.028, 0.13, (-x, base + 0.065, 0.09), kit.m("ceramic_accent"), segments=14, bevel=0.008)
    kit.rod((-x, base + 0.12, 0.09), (-x, base + 0.16, 0.12), 0.005, kit.m("chrome"), sides=6)
    kit.lathe(
        [(0.0, 0.0), (0.034, 0.0), (0.036, 0.09), (0.032, 0.09), (0.03, 0.01), (0.0, 0.01)],
        kit.m("pot_white"),
        centre=(x, base, 0.09),
        segments=16,
    )
    for k, role in enumerate(("plastic_white", "fruit_orange")):
        kit.rod(
            (x + 0.01 * k, base + 0.012, 0.09),
            (x + 0.035 - 0.06 * k, base + 0.19, 0.08 + 0.03 * k),
            0.0045,
            kit.m(role),
            sides=6,
        )


def _inset_basin(kit: Kit, w: float, d: float, under: float, top: float, metal: Material) -> None:
    """A basin as wide as its vanity, from ``under`` to ``top`` above the floor (m)."""
    inner_w, inner_d = min(w - 0.16, 0.56), 0.30
    rings = [
        (w, d, 0.012, under),
        (w, d, 0.012, top - 0.006),
        (w - 0.012, d - 0.012, 0.012, top),
    ]
    outer = ring_stack(rings, centre=(0.0, d / 2))
    hole = ring_stack(
        [
            (inner_w + 0.02, inner_d + 0.02, 0.09, top),
            (inner_w, inner_d, 0.09, top - 0.01),
            (inner_w - 0.03, inner_d - 0.03, 0.09, top - 0.06),
            (inner_w - 0.12, inner_d - 0.11, 0.07, top - 0.11),
        ],
        centre=(0.0, d / 2 + 0.035),
    )
    kit.loft(np.concatenate([outer, hole]), kit.m("ceramic"), crease=45.0)
    tap(kit, (0.0, top, 0.055), metal, style="block", height=0.12, reach=0.13)
    kit.cylinder(0.02, 0.004, (0.0, top - 0.109, d / 2 + 0.035), kit.m("chrome"), segments=12)


def _vessel(kit: Kit, w: float, d: float, top: float, metal: Material) -> None:
    """A bowl standing on a wooden top."""
    slab, y0 = kit.m("wood"), top - 0.04
    kit.panel((-w / 2, y0, 0.0), (w / 2, top, d + 0.01), slab, bevel=0.004)
    shape = Vessel(0.42, 0.36, top, top + 0.13, rim=0.014, deep=0.105, corner=0.16, slope=0.1, foot=0.72)
    hollow(kit, shape, kit.m("ceramic"), centre=(0.0, d / 2 + 0.03))
    tap(kit, (0.0, top, 0.055), metal, style="arc", height=0.3, reach=0.17)
    kit.cylinder(0.02, 0.004, (0.0, top + 0.027, d / 2 + 0.03), kit.m("chrome"), segments=12)


def vanity_cabinet(kit: Kit) -> None:
    """A wall cabinet with two doors, mirrors or of wood, and a lamp over them."""
    kit.mount = "wall"
    w, h = kit.near(0.65, 0.15), 0.7
    doors, metal = kit.m(kit.pick("mirror", "mirror", "wood")), kit.m("metal")
    kit.panel((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.13), kit.m("white"), bevel=0.002)
    for side in (-1, 1):
        x0, x1 = sorted((side * 0.001, side * w / 2))
        kit.panel((x0, -h / 2, 0.132), (x1, h / 2, 0.148), doors, bevel=0.004)
        kit.rod((side * 0.025, -h / 2 + 0.05, 0.155), (side * 0.025, -h / 2 + 0.17, 0.155), 0.005, metal, sides=8)
    kit.panel((-w / 2 + 0.05, h / 2 + 0.015, 0.02), (w / 2 - 0.05, h / 2 + 0.035, 0.19), kit.m("chrome"), bevel=0.004)
    kit.panel(
        (-w / 2 + 0.07, h / 2 + 0.009, 0.155), (w / 2 - 0.07, h / 2 + 0.0149, 0.185), kit.m("lamp_glass"), bevel=0.0
    )
    kit.sound((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.15), kit.m("white"))


def towel_rail(kit: Kit) -> None:
    """A heated ladder rail or a plain double bar, hung with folded towels."""
    kit.mount = "wall"
    form = kit.pick("ladder", "bars")
    w = 0.5 if form == "ladder" else 0.6
    if form == "ladder":
        white = kit.m(kit.pick("radiator", "tap"))
        tall = 1.15
        for x in (-w / 2 + 0.015, w / 2 - 0.015):
            kit.rod((x, 0.0, 0.06), (x, tall, 0.06), 0.015, white)
            for y in (0.12, tall - 0.12):
                kit.rod((x, y, 0.0), (x, y, 0.06), 0.01, white, sides=6)
        levels = [y for k, y in enumerate(np.linspace(0.05, tall - 0.05, 15)) if k not in (4, 9)]
        for y in levels:
            kit.rod((-w / 2 + 0.015, y, 0.06), (w / 2 - 0.015, y, 0.06), 0.010, white, sides=6)
        bars = [(levels[-1], 0.06), (levels[6], 0.06)]
        kit.sound((-w / 2, 0.0, 0.03), (w / 2, tall, 0.07), white)
    else:
        metal = kit.m("tap")
        bars = [(0.62, 0.11), (0.62, 0.055)]
        for x in (-w / 2 + 0.01, w / 2 - 0.01):
            kit.panel((x - 0.012, 0.60, 0.0), (x + 0.012, 0.64, 0.125), metal, bevel=0.004)
        for y, z in bars:
            kit.rod((-w / 2, y, z), (w / 2, y, z), 0.008, metal)
    for k, (y, z) in enumerate(bars):
        if k == 1 and kit.rng.random() < 0.35:
            continue
        _hung_towel(
            kit,
            y,
            z,
            float(kit.rng.uniform(-0.05, 0.05)),
            0.36 if form == "ladder" else 0.26,
            f"towel_{int(kit.rng.integers(3))}",
            shift=0.13 * (1 - 2 * k) if form == "bars" else 0.0,
        )


def _hung_towel(kit: Kit, y: float, z: float, skew: float, width: float, role: str, shift: float = 0.0) -> None:
    """A towel over a bar: down the back, over the bar, longer down the front, with soft folds."""
    arc = np.linspace(0, np.pi, 6)
    # The back stays off the wall and off the next bar.
    line = [(y - 0.22, z - 0.016)] + [(y + 0.004 + 0.016 * np.sin(t), z - 0.016 * np.cos(t)) for t in arc]
    line += [(y - h, z + 0.017) for h in (0.08, 0.2, 0.32, 0.42)]
    u = np.linspace(-0.5, 0.5, 9)
    rows = []
    for k, (py, pz) in enumerate(line):
        drop = max(0.0, (y - py) / 0.42) if k > 6 else 0.0
        wave = 0.006 * drop * np.sin(u * 13 + skew * 40) * (1 - 0.3 * drop)
        rows.append(np.stack([shift + skew + u * width * (1 - 0.05 * drop), np.full(9, py), pz + np.abs(wave)], axis=1))
    kit.shell(np.array(rows), 0.009, kit.m(role))
    x0 = shift + skew
    kit.sound((x0 - width / 2, y - 0.42, z + 0.005), (x0 + width / 2, y, z + 0.025), kit.m(role))


def bath_mat(kit: Kit) -> None:
    """A tufted mat with rounded corners, or a round one."""
    mat = kit.m("bath_mat")
    w, d, r = (0.75, 0.75, 0.37) if kit.rng.random() < 0.3 else (kit.near(0.8), 0.5, 0.06)
    rings = ring_stack(
        [
            (w, d, r, 0.0),
            (w + 0.006, d + 0.006, r, 0.006),
            (w - 0.004, d - 0.004, r, 0.013),
            (w - 0.03, d - 0.03, r, 0.015),
        ]
    )
    kit.loft(rings, mat, crease=60.0)
    kit.sound((-w / 2, 0.0, -d / 2), (w / 2, 0.015, d / 2), mat)


def laundry_basket(kit: Kit) -> None:
    """A wicker basket with a lid, or an open cloth bin with laundry in it."""
    form = kit.pick("round", "square")
    wicker = kit.m("wicker")
    if form == "round":
        h = kit.near(0.55)
        kit.lathe([(0.0, 0.0), (0.175, 0.0), (0.2, h * 0.5), (0.215, h), (0.0, h)], wicker, segments=24)
        kit.lathe([(0.0, h), (0.225, h), (0.228, h + 0.03), (0.2, h + 0.045), (0.0, h + 0.055)], wicker, segments=24)
        kit.torus(0.216, 0.009, (0.0, h - 0.01, 0.0), wicker, segments=24, minor_segments=6)
        kit.sphere(0.02, (0.0, h + 0.065, 0.0), kit.m("wood"), rings=6, segments=10)
        kit.sound((-0.2, 0.0, -0.2), (0.2, h + 0.04, 0.2), wicker)
    else:
        h = kit.near(0.5)
        cloth = kit.m("curtain")
        kit.loft(
            ring_stack(
                [(0.36, 0.32, 0.03, 0.0), (0.4, 0.36, 0.04, h), (0.385, 0.345, 0.04, h), (0.38, 0.34, 0.04, h - 0.1)],
                per_corner=4,
            ),
            cloth,
            crease=45.0,
        )
        kit.soft(
            (0.3, 0.16, 0.24), (0.0, h - 0.06, 0.0), kit.m("towel_1"), radius=0.07, puff=(0.02, 0.03, 0.02), cells=5
        )
        kit.soft(
            (0.16, 0.1, 0.16), (0.06, h + 0.0, 0.02), kit.m("towel_0"), radius=0.05, puff=(0.01, 0.02, 0.01), cells=4
        )
        for side in (-1, 1):
            t = np.linspace(0, np.pi, 7)
            kit.tube(
                np.stack([np.full(7, side * 0.2), h - 0.05 + 0.07 * np.sin(t), 0.06 * np.cos(t)], axis=1),
                0.008,
                kit.m("leather"),
                segments=6,
            )
        kit.sound((-0.2, 0.0, -0.18), (0.2, h, 0.18), cloth)


def bathroom_cabinet(kit: Kit) -> None:
    """A tall narrow cabinet with a door below, open shelves with towels in the middle and a door above."""
    w, d, tall = 0.4, 0.34, kit.near(1.72, 0.04)
    box = kit.m("bath_front")
    low, a, b = 0.06, 0.72, 1.2
    kit.panel((-w / 2 + 0.02, 0.0, 0.02), (w / 2 - 0.02, low, d - 0.05), kit.m("plastic_black"), bevel=0.0)
    kit.panel((-w / 2, low, 0.0), (w / 2, a, d), box, bevel=0.002)
    kit.panel((-w / 2, b, 0.0), (w / 2, tall, d), box, bevel=0.002)
    carcass(kit, (-w / 2, a, 0.0), (w / 2, b, d), box)
    kit.panel((-w / 2 + 0.018, (a + b) / 2, 0.01), (w / 2 - 0.018, (a + b) / 2 + 0.018, d - 0.02), box, bevel=0.001)
    front(kit, (-w / 2, w / 2), (low, a), d, box, shaker=is_shaker(kit), pull=pull_style(kit, "left", "tap"))
    front(kit, (-w / 2, w / 2), (b, tall), d, box, shaker=is_shaker(kit), pull=pull_style(kit, "left_low", "tap"))
    y = a + 0.018
    for _ in range(3):
        kit.soft(
            (0.28, 0.055, 0.24),
            (0.0, y + 0.0275, d / 2),
            kit.m(f"towel_{int(kit.rng.integers(3))}"),
            radius=0.024,
            puff=(0.0, 0.003, 0.006),
            cells=4,
        )
        y += 0.056
    shelf = (a + b) / 2 + 0.018
    if kit.rng.random() < 0.5:
        bowl(kit, (-0.08, shelf, d / 2 + 0.02), kit.m("pot_white"), 0.07, 0.06)
    else:
        vase(kit, (-0.08, shelf, d / 2), kit.m("ceramic_accent"), 0.16)
    kit.cylinder(0.032, 0.14, (0.09, shelf + 0.07, d / 2), kit.m("plastic_white"), segments=12, bevel=0.01)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d + 0.02), box)
