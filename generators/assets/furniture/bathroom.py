"""Bathroom: bathtub, shower, washbasin, mirror, towel rail, bath mat, laundry basket, tall cabinet."""

from __future__ import annotations

import numpy as np

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
from generators.assets.shapes import rotation
from generators.scenes.scene import Material


def _hollow(kit: Kit, width: float, depth: float, bottom: float, top: float, *, rim: float, deep: float, corner: float, slope: float, material: Material, foot: float = 1.0, centre: tuple[float, float] = (0.0, 0.0)) -> None:
    """A vessel with a rounded rim: up the outside, over, and down the inside to a floor ``deep`` below the rim."""
    w, d = width - 2 * rim, depth - 2 * rim
    kit.loft(
        ring_stack(
            [
                (width * foot, depth * foot, corner, bottom),
                (width * (0.35 * foot + 0.65), depth * (0.35 * foot + 0.65), corner, bottom + 0.5 * (top - bottom)),
                (width - 0.012, depth - 0.012, corner, top - 0.025),
                (width, depth, corner, top - 0.018),
                (width, depth, corner, top - 0.006),
                (width - 0.012, depth - 0.012, corner, top),
                (w + 0.02, d + 0.02, corner + 0.06, top),
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
        _hollow(kit, width, depth, 0.0, top, rim=0.035, deep=0.44, corner=0.34, slope=0.3, material=enamel, foot=0.78)
        kit.rod((0.0, 0.0, -depth / 2 - 0.07), (0.0, 0.86, -depth / 2 - 0.07), 0.016, metal)
        kit.tube([(0.0, 0.84, -depth / 2 - 0.07), (0.0, 0.86, -depth / 2 + 0.02), (0.0, 0.83, -depth / 2 + 0.1)], 0.014, metal, segments=8)
        kit.cylinder(0.03, 0.02, (0.0, 0.01, -depth / 2 - 0.07), metal, segments=14)
    else:
        apron = kit.m("tiles_bathroom") if form == "tiled" else kit.m("enamel")
        _hollow(kit, width, depth, 0.05, top, rim=0.06, deep=0.42, corner=0.03, slope=0.26, material=enamel)
        kit.panel((-width / 2 + 0.015, 0.0, -depth / 2 + 0.012), (width / 2 - 0.015, 0.045, depth / 2 - 0.03), apron, bevel=0.0)
        edge = depth / 2 - 0.005
        kit.panel((-width / 2 + 0.005, 0.0, edge - 0.02), (width / 2 - 0.005, top - 0.028, edge), apron, bevel=0.002)
        for side in (-1, 1):
            low, high = sorted((side * (width / 2 - 0.005), side * (width / 2 - 0.025)))
            kit.panel((low, 0.0, -depth / 2 + 0.005), (high, top - 0.028, edge - 0.02), apron, bevel=0.0)
        kit.panel((-0.13, top, -depth / 2 + 0.015), (0.13, top + 0.045, -depth / 2 + 0.055), metal, bevel=0.01)
        tap(kit, (0.0, top + 0.04, -depth / 2 + 0.035), metal, style="block", height=0.05, reach=0.14)
    kit.cylinder(0.026, 0.006, (0.0, top - 0.415 - (0.02 if form == "freestanding" else 0.0), 0.0), kit.m("chrome"), segments=14)
    kit.cylinder(0.032, 0.012, (width / 2 - (0.22 if form == "freestanding" else 0.155), top - 0.14, 0.0), kit.m("chrome"), axis="x", segments=14)
    kit.sound((-width / 2, 0.0, -depth / 2), (width / 2, top - 0.42, depth / 2), enamel)
    for side in (-1, 1):
        kit.sound((min(side * width / 2, side * (width / 2 - 0.1)), top - 0.42, -depth / 2), (max(side * width / 2, side * (width / 2 - 0.1)), top, depth / 2), enamel)
        kit.sound((-width / 2 + 0.1, top - 0.42, min(side * depth / 2, side * (depth / 2 - 0.08))), (width / 2 - 0.1, top, max(side * depth / 2, side * (depth / 2 - 0.08))), enamel)


def shower(kit: Kit, *, width: float | None = None) -> None:
    """A shower: tray, two tiled corner walls (back and left), a glass or a curtain on a rail, riser rail and head."""
    w = width or float(kit.rng.choice([0.9, 1.0]))
    d, tall = 0.9, 2.05
    metal, tiles = kit.m("tap"), kit.m("tiles_bathroom")
    form = kit.pick("curtain", "glass")
    _hollow(kit, w, d, 0.0, 0.075, rim=0.04, deep=0.04, corner=0.012, slope=0.05, material=kit.m("ceramic"), centre=(0.0, d / 2))
    kit.cylinder(0.045, 0.006, (0.0, 0.036, d / 2), kit.m("chrome"), segments=18)
    with kit.one_slab():
        kit.panel((-w / 2, 0.075, 0.0), (w / 2, tall, 0.025), tiles, bevel=0.0)
        kit.panel((-w / 2, 0.075, 0.025), (-w / 2 + 0.025, tall, d), tiles, bevel=0.0)
    kit.rod((0.0, 0.95, 0.07), (0.0, 1.98, 0.07), 0.0105, metal, sides=10)
    kit.tube([(0.0, 1.97, 0.07), (0.0, 2.02, 0.1), (0.0, 2.02, 0.36), (0.0, 2.0, 0.38), (0.0, 1.97, 0.38)], 0.0105, metal, segments=8)
    kit.cylinder(0.115, 0.014, (0.0, 1.965, 0.38), metal, segments=24, bevel=0.004)
    kit.rod((-0.13, 1.05, 0.07), (0.13, 1.05, 0.07), 0.021, metal, sides=12)
    for x in (-0.13, 0.13):
        kit.cylinder(0.026, 0.05, (x, 1.05, 0.07), metal, axis="x", segments=12, bevel=0.005)
    for y in (1.05, 1.75):
        kit.rod((0.0, y, 0.02), (0.0, y, 0.07), 0.012, metal)
    kit.rod((0.02, 1.5, 0.1), (0.05, 1.66, 0.15), 0.013, metal, end_radius=0.011)
    kit.cylinder(0.045, 0.018, (0.055, 1.68, 0.155), metal, segments=16, rotate=None, axis="z") if False else kit.lathe(
        [(0.0, -0.009), (0.04, -0.009), (0.045, 0.004), (0.0, 0.009)], metal, centre=(0.055, 1.68, 0.155), segments=16, rotate=rotation("x", 60)
    )
    t = np.linspace(0, 1, 12)
    hose = np.stack([0.02 + 0.13 * np.sin(np.pi * t), 1.5 - 0.75 * np.sin(np.pi * t) * (1 - 0.35 * t) - 0.47 * t, 0.1 + 0.02 * t], axis=1)
    kit.tube(hose, 0.007, kit.m("chrome"), segments=6)
    shelf = w / 2 - 0.2
    kit.panel((shelf, 1.12, 0.025), (shelf + 0.17, 1.13, 0.11), kit.m("chrome"), bevel=0.002)
    for k, role in enumerate(("plastic_white", "ceramic_accent", "plastic_black")[: 2 + int(kit.rng.integers(2))]):
        kit.cylinder(0.024, 0.15 - 0.025 * k, (shelf + 0.035 + 0.055 * k, 1.205 - 0.0125 * k, 0.07), kit.m(role), segments=12, bevel=0.008)
    if form == "glass":
        glass = kit.m("glass")
        kit.panel((w / 2 - 0.01, 0.075, 0.03), (w / 2 - 0.002, 2.0, d - 0.02), glass, bevel=0.0)
        for y in (0.085, 2.0):
            kit.panel((w / 2 - 0.016, y - 0.01, 0.025), (w / 2 + 0.004, y + 0.01, d - 0.015), kit.m("metal"), bevel=0.002)
        kit.panel((w / 2 - 0.016, 0.075, d - 0.03), (w / 2 + 0.004, 2.01, d - 0.01), kit.m("metal"), bevel=0.002)
        kit.sound((w / 2 - 0.012, 0.075, 0.0), (w / 2, 2.0, d), glass)
    else:
        kit.tube([(w / 2 - 0.02, 1.98, 0.02), (w / 2 - 0.02, 1.98, d - 0.08), (w / 2 - 0.05, 1.98, d - 0.03), (w / 2 - 0.1, 1.98, d - 0.02), (-w / 2 + 0.02, 1.98, d - 0.02)], 0.011, kit.m("chrome"), segments=8)
        run = np.linspace(0.06, d - 0.14, 34)
        rows = []
        for y in np.linspace(1.955, 0.12, 7):
            open_ = 0.018 + 0.010 * (1.955 - y) / 1.8
            rows.append(np.stack([w / 2 - 0.022 + open_ * np.sin(run * 62 + 0.6 * np.sin(3 * y)), np.full(34, y), run], axis=1))
        kit.shell(np.array(rows), 0.002, kit.m("towel_1"))
        kit.sound((w / 2 - 0.03, 0.12, 0.05), (w / 2, 1.96, d - 0.1), kit.m("curtain"))
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, 0.05, d), kit.m("ceramic"))
    kit.sound((-w / 2, 0.05, 0.0), (w / 2, tall, 0.025), tiles)
    kit.sound((-w / 2, 0.05, 0.025), (-w / 2 + 0.025, tall, d), tiles)


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
        slab, y0 = kit.m("wood"), top - 0.04
        kit.panel((-w / 2, y0, 0.0), (w / 2, top, d + 0.01), slab, bevel=0.004)
        _hollow(kit, 0.42, 0.36, top, top + 0.13, rim=0.014, deep=0.105, corner=0.16, slope=0.1, material=white, foot=0.72, centre=(0.0, d / 2 + 0.03))
        tap(kit, (0.0, top, 0.055), metal, style="arc", height=0.3, reach=0.17)
        kit.cylinder(0.02, 0.004, (0.0, top + 0.027, d / 2 + 0.03), kit.m("chrome"), segments=12)
    else:
        inner_w, inner_d = min(w - 0.16, 0.56), 0.30
        rings = [
            (w, d, 0.012, under), (w, d, 0.012, top - 0.006), (w - 0.012, d - 0.012, 0.012, top),
        ]
        outer = ring_stack(rings, centre=(0.0, d / 2))
        hole = ring_stack(
            [
                (inner_w + 0.02, inner_d + 0.02, 0.09, top), (inner_w, inner_d, 0.09, top - 0.01),
                (inner_w - 0.03, inner_d - 0.03, 0.09, top - 0.06), (inner_w - 0.12, inner_d - 0.11, 0.07, top - 0.11),
            ],
            centre=(0.0, d / 2 + 0.035),
        )
        kit.loft(np.concatenate([outer, hole]), white)
        tap(kit, (0.0, top, 0.055), metal, style="block", height=0.12, reach=0.13)
        kit.cylinder(0.02, 0.004, (0.0, top - 0.109, d / 2 + 0.035), kit.m("chrome"), segments=12)
    kit.panel((-w / 2 + 0.008, low, 0.0), (w / 2 - 0.008, under, d - 0.03), box, bevel=0.002)
    if hung:
        kit.cylinder(0.018, low, (0.0, low / 2, 0.12), kit.m("chrome"), segments=10)
    else:
        wooden_legs(kit, (-w / 2 + 0.05, w / 2 - 0.05), (0.05, d - 0.08), low, kit.m("metal"), radius=0.016)
    rows = 2 if under - low > 0.3 else 1
    height = (under - low) / rows
    for k in range(rows):
        front(kit, (-w / 2 + 0.008, w / 2 - 0.008), (low + k * height, low + (k + 1) * height), d - 0.03, box, shaker=is_shaker(kit), pull=pull_style(kit, "top", "tap"), grain="x")
    x = w / 2 - 0.09
    base = top
    if w > 0.7:
        kit.cylinder(0.028, 0.13, (-x, base + 0.065, 0.09), kit.m("ceramic_accent"), segments=14, bevel=0.008)
        kit.rod((-x, base + 0.12, 0.09), (-x, base + 0.16, 0.12), 0.005, kit.m("chrome"), sides=6)
        kit.lathe([(0.0, 0.0), (0.034, 0.0), (0.036, 0.09), (0.032, 0.09), (0.03, 0.01), (0.0, 0.01)], kit.m("pot_white"), centre=(x, base, 0.09), segments=16)
        for k, role in enumerate(("plastic_white", "fruit_orange")):
            kit.rod((x + 0.01 * k, base + 0.012, 0.09), (x + 0.035 - 0.06 * k, base + 0.19, 0.08 + 0.03 * k), 0.0045, kit.m(role), sides=6)
    kit.sound((-w / 2, low, 0.0), (w / 2, top, d), kit.m("white"))
    kit.sound((-w / 2, under, 0.0), (w / 2, top, d), white)


def mirror(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A mirror: round, framed rectangle, or a lit cabinet with two doors."""
    form = kit.pick("round", "framed", "cabinet") if width is None else kit.pick("framed", "cabinet")
    kit.mount = "wall"
    w, h = width or kit.near(0.65, 0.15), height or 0.8
    glass, metal = kit.m("mirror"), kit.m("metal")
    if form == "round":
        r = w / 2 + 0.02
        kit.cylinder(r, 0.018, (0.0, 0.0, 0.009), kit.m("plastic_black"), axis="z", segments=40)
        kit.cylinder(r - 0.008, 0.004, (0.0, 0.0, 0.02), glass, axis="z", segments=40)
        kit.torus(r, 0.009, (0.0, 0.0, 0.016), metal, axis="z", segments=40, minor_segments=6)
        kit.sound((-r * 0.85, -r * 0.85, 0.0), (r * 0.85, r * 0.85, 0.02), glass)
    elif form == "framed":
        frame = kit.m(kit.pick("wood", "metal"))
        band = 0.035 if frame.acoustic == "wood" else 0.015
        _frame(kit, w, h, band, 0.028, frame)
        kit.panel((-w / 2 + 0.01, -h / 2 + 0.01, 0.0), (w / 2 - 0.01, h / 2 - 0.01, 0.016), glass, bevel=0.0)
        kit.sound((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.025), glass)
    else:
        h = min(h, 0.7)
        kit.panel((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.13), kit.m("white"), bevel=0.002)
        for side in (-1, 1):
            x0, x1 = sorted((side * 0.001, side * w / 2))
            kit.panel((x0, -h / 2, 0.132), (x1, h / 2, 0.148), glass, bevel=0.004)
        kit.panel((-w / 2 + 0.05, h / 2 + 0.015, 0.02), (w / 2 - 0.05, h / 2 + 0.035, 0.19), kit.m("chrome"), bevel=0.004)
        kit.panel((-w / 2 + 0.07, h / 2 + 0.009, 0.155), (w / 2 - 0.07, h / 2 + 0.0149, 0.185), kit.m("lamp_glass"), bevel=0.0)
        kit.sound((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.15), glass)


def _frame(kit: Kit, w: float, h: float, band: float, depth: float, material: Material) -> None:
    """Four mitre-less strips round a rectangle about the origin, back at z = 0."""
    with kit.grained("y"):
        for side in (-1, 1):
            x0, x1 = sorted((side * w / 2, side * (w / 2 - band)))
            kit.panel((x0, -h / 2, 0.0), (x1, h / 2, depth), material, bevel=0.004)
    with kit.grained("x"):
        for side in (-1, 1):
            y0, y1 = sorted((side * h / 2, side * (h / 2 - band)))
            kit.panel((-w / 2 + band, y0, 0.0), (w / 2 - band, y1, depth), material, bevel=0.004)


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
        _hung_towel(kit, y, z, float(kit.rng.uniform(-0.05, 0.05)), 0.36 if form == "ladder" else 0.26, f"towel_{int(kit.rng.integers(3))}", shift=0.13 * (1 - 2 * k) if form == "bars" else 0.0)


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
    rings = ring_stack([(w, d, r, 0.0), (w + 0.006, d + 0.006, r, 0.006), (w - 0.004, d - 0.004, r, 0.013), (w - 0.03, d - 0.03, r, 0.015)])
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
        kit.loft(ring_stack([(0.36, 0.32, 0.03, 0.0), (0.4, 0.36, 0.04, h), (0.385, 0.345, 0.04, h), (0.38, 0.34, 0.04, h - 0.1)], per_corner=4), cloth)
        kit.soft((0.3, 0.16, 0.24), (0.0, h - 0.06, 0.0), kit.m("towel_1"), radius=0.07, puff=(0.02, 0.03, 0.02), cells=5)
        kit.soft((0.16, 0.1, 0.16), (0.06, h + 0.0, 0.02), kit.m("towel_0"), radius=0.05, puff=(0.01, 0.02, 0.01), cells=4)
        for side in (-1, 1):
            t = np.linspace(0, np.pi, 7)
            kit.tube(np.stack([np.full(7, side * 0.2), h - 0.05 + 0.07 * np.sin(t), 0.06 * np.cos(t)], axis=1), 0.008, kit.m("leather"), segments=6)
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
        kit.soft((0.28, 0.055, 0.24), (0.0, y + 0.0275, d / 2), kit.m(f"towel_{int(kit.rng.integers(3))}"), radius=0.024, puff=(0.0, 0.003, 0.006), cells=4)
        y += 0.056
    shelf = (a + b) / 2 + 0.018
    if kit.rng.random() < 0.5:
        bowl(kit, (-0.08, shelf, d / 2 + 0.02), kit.m("pot_white"), 0.07, 0.06)
    else:
        vase(kit, (-0.08, shelf, d / 2), kit.m("ceramic_accent"), 0.16)
    kit.cylinder(0.032, 0.14, (0.09, shelf + 0.07, d / 2), kit.m("plastic_white"), segments=12, bevel=0.01)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d + 0.02), box)
