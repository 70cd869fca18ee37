"""Living room tables: coffee table, side table, television stand, desk."""

from __future__ import annotations

import itertools

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import (
    book_pile,
    bowl,
    carcass,
    front,
    pull_style,
    vase,
    wooden_legs,
)


def coffee_table(kit: Kit) -> None:
    """A low table: slab on legs with a shelf, round on three legs, or a box; a pile of books on one end."""
    form = kit.pick("shelf", "round", "frame")
    top = kit.m(kit.pick("wood", "wood", "wood_alt"))
    if form == "round":
        r, h = kit.near(0.42, 0.1), 0.4
        kit.round_top(r, h - 0.028, h, top)
        leg = kit.m(kit.pick("wood", "metal"))
        for k in range(3):
            a = np.pi / 6 + k * 2 * np.pi / 3
            c, s = float(np.cos(a)), float(np.sin(a))
            kit.rod(
                (0.92 * r * c, 0.0, 0.92 * r * s),
                (0.66 * r * c, h - 0.027, 0.66 * r * s),
                0.012,
                leg,
                end_radius=0.021,
                sides=10,
            )
        book_pile(kit, -0.45 * r, h, -0.42 * r, 2)
        half = 0.5 * r
        kit.support("side_table", (-0.05, 0.1 + half), (-half * 0.2, half + 0.05), h, clearance=1.0)
        kit.sound((-0.8 * r, h - 0.03, -0.8 * r), (0.8 * r, h, 0.8 * r), top)
        return
    w, d, h = kit.near(1.1, 0.08), kit.near(0.6, 0.05), kit.near(0.42, 0.05)
    kit.panel((-w / 2, h - 0.035, -d / 2), (w / 2, h, d / 2), top, bevel=0.006)
    if form == "shelf":
        wooden_legs(
            kit, (-w / 2 + 0.06, w / 2 - 0.06), (-d / 2 + 0.06, d / 2 - 0.06), h - 0.03, top, radius=0.024, splay=0.015
        )
        kit.panel((-w / 2 + 0.08, 0.15, -d / 2 + 0.06), (w / 2 - 0.08, 0.17, d / 2 - 0.06), top, bevel=0.003)
        book_pile(kit, 0.18, 0.17, 0.0, 3)
        kit.soft((0.34, 0.05, 0.26), (-0.22, 0.196, 0.0), kit.m("throw"), radius=0.022, puff=(0.0, 0.006, 0.0), cells=4)
    else:
        metal = kit.m("metal")
        t = 0.025
        for side in (-1, 1):
            x0, x1 = sorted((side * (w / 2 - 0.02), side * (w / 2 - 0.02 - t)))
            for z in (-d / 2 + 0.02, d / 2 - 0.02 - t):
                kit.panel((x0, 0.0, z), (x1, h - 0.036, z + t), metal, bevel=0.002)
            kit.panel((x0, 0.0, -d / 2 + 0.02 + t), (x1, t, d / 2 - 0.02 - t), metal, bevel=0.002)
    book_pile(kit, -w / 2 + 0.2, h, 0.0, 2 + int(kit.rng.integers(2)))
    if kit.rng.random() < 0.5:
        bowl(kit, (-0.06, h, 0.07), kit.m("ceramic_accent"), 0.1, 0.06)
        low = 0.08
    else:
        low = -w / 2 + 0.4
    kit.support("side_table", (low, w / 2 - 0.05), (-d / 2 + 0.05, d / 2 - 0.05), h, clearance=1.0)
    kit.sound((-w / 2, h - 0.035, -d / 2), (w / 2, h, d / 2), top)


def side_table(kit: Kit) -> None:
    """A small table beside a sofa: round on a stem or three legs, or a cube with a drawer."""
    form = kit.pick("tray", "tripod", "drawer")
    h = kit.near(0.55, 0.06)
    if form == "drawer":
        w, d = 0.46, 0.42
        box = kit.m(kit.pick("wood", "white", "accent_paint"))
        wooden_legs(
            kit,
            (-w / 2 + 0.05, w / 2 - 0.05),
            (-d / 2 + 0.05, d / 2 - 0.05),
            h - 0.15,
            kit.m("wood"),
            radius=0.019,
            splay=0.015,
        )
        kit.panel((-w / 2, h - 0.17, -d / 2), (w / 2, h, d / 2 - 0.02), box, bevel=0.004)
        front(
            kit,
            (-w / 2 + 0.012, w / 2 - 0.012),
            (h - 0.155, h - 0.015),
            d / 2 - 0.02,
            box,
            pull=pull_style(kit, "middle"),
            grain="x",
        )
        kit.support("side_table", (-w / 2 + 0.02, w / 2 - 0.02), (-d / 2 + 0.02, d / 2 - 0.03), h, clearance=0.9)
        kit.sound((-w / 2, h - 0.17, -d / 2), (w / 2, h, d / 2), box)
        return
    r = kit.near(0.25, 0.08)
    top = kit.m("wood")
    kit.round_top(r, h - 0.024, h, top)
    if form == "tray":
        metal = kit.m("metal")
        kit.rod((0.0, 0.01, 0.0), (0.0, h - 0.023, 0.0), 0.014, metal, sides=12)
        kit.lathe([(0.0, 0.0), (0.18, 0.0), (0.182, 0.008), (0.05, 0.02), (0.0, 0.022)], metal, segments=32)
        kit.lathe([(0.0, h - 0.045), (0.06, h - 0.026), (0.0, h - 0.0239)], metal, segments=20)
    else:
        for k in range(3):
            a = np.pi / 2 + k * 2 * np.pi / 3
            c, s = float(np.cos(a)), float(np.sin(a))
            kit.rod(
                (0.95 * r * c, 0.0, 0.95 * r * s),
                (0.6 * r * c, h - 0.023, 0.6 * r * s),
                0.011,
                top,
                end_radius=0.018,
                sides=10,
            )
    half = 0.66 * r
    kit.support("side_table", (-half, half), (-half, half), h, clearance=0.9)
    kit.sound((-0.8 * r, h - 0.03, -0.8 * r), (0.8 * r, h, 0.8 * r), top)


def tv_stand(kit: Kit, *, length: float | None = None) -> None:
    """A low board with drawers and an open bay with a player, and a television on it; free tops at both ends."""
    w, d, h = float(length or kit.near(1.7, 0.06)), 0.42, kit.near(0.48, 0.06)
    box = kit.m(kit.pick("wood", "white", "wood_alt"))
    form = kit.pick("legs", "plinth")
    low = 0.14 if form == "legs" else 0.06
    if form == "legs":
        wooden_legs(kit, (-w / 2 + 0.12, w / 2 - 0.12), (0.07, d - 0.07), low + 0.01, kit.m("wood"), splay=0.03)
    else:
        kit.panel((-w / 2 + 0.03, 0.0, 0.02), (w / 2 - 0.03, low, d - 0.04), kit.m("plastic_black"), bevel=0.0)
    third = w / 3
    with kit.one_slab():
        kit.panel((-w / 2, h - 0.025, 0.0), (w / 2, h, d), box, bevel=0.003)
    for side in (-1, 1):
        x0, x1 = sorted((side * w / 2, side * third / 2))
        kit.panel((x0, low, 0.0), (x1, h - 0.025, d - 0.021), box, bevel=0.001)
        front(
            kit,
            (x0, x1),
            (low, h - 0.027),
            d - 0.021,
            kit.m("wood") if kit.rng.random() < 0.3 else box,
            pull=pull_style(kit, "top"),
            grain="x",
        )
    carcass(kit, (-third / 2, low, 0.0), (third / 2, h - 0.025, d - 0.004), box)
    mid = (low + h) / 2 - 0.01
    kit.panel((-third / 2 + 0.018, mid, 0.01), (third / 2 - 0.018, mid + 0.014, d - 0.03), box, bevel=0.0)
    kit.panel((-0.19, low + 0.018, 0.08), (0.19, low + 0.078, d - 0.06), kit.m("plastic_black"), bevel=0.003)
    kit.cylinder(0.012, 0.008, (0.14, low + 0.048, d - 0.057), kit.m("chrome"), axis="z", segments=12)
    diagonal = w * 0.62 if w < 1.75 else 1.12
    tw, th = min(1.25, diagonal), min(1.25, diagonal) * 0.575
    y0 = h + 0.075
    black = kit.m("plastic_black")
    kit.panel((-tw / 2, y0, 0.15), (tw / 2, y0 + th, 0.172), black, bevel=0.004)
    kit.panel((-tw / 3, y0 + 0.08, 0.115), (tw / 3, y0 + th * 0.7, 0.15), black, bevel=0.01)
    e = 0.008
    kit.cloth_quad(
        [
            (-tw / 2 + e, y0 + 2 * e, 0.1724),
            (tw / 2 - e, y0 + 2 * e, 0.1724),
            (tw / 2 - e, y0 + th - e, 0.1724),
            (-tw / 2 + e, y0 + th - e, 0.1724),
        ],
        kit.m("screen"),
    )
    for side in (-1, 1):
        x = side * tw * 0.36
        kit.rod((x, y0 + 0.01, 0.16), (x, h + 0.006, 0.27), 0.009, black)
        kit.rod((x, y0 + 0.01, 0.16), (x, h + 0.006, 0.07), 0.009, black)
    gap = (w - tw) / 2 - 0.03
    if gap > 0.18:
        kit.support("side_table", (tw / 2 + 0.02, w / 2 - 0.02), (0.03, d - 0.03), h, clearance=1.0)
        vase(kit, (-w / 2 + gap / 2 + 0.02, h, d / 2), kit.m(kit.pick("ceramic_accent", "pot_white", "pot")), 0.26)
    kit.sound((-w / 2, low, 0.0), (w / 2, h, d), box)
    kit.sound((-tw / 2, y0, 0.15), (tw / 2, y0 + th, 0.172), kit.m("screen"))


def desk(kit: Kit) -> None:
    """A writing desk with drawers on one side, or a thin one on trestle legs; part of its top is free."""
    w, d, h = kit.near(1.3, 0.08), 0.62, 0.74
    top = kit.m("wood")
    kit.panel((-w / 2, h - 0.028, 0.0), (w / 2, h, d), top, bevel=0.004)
    if kit.rng.random() < 0.5:
        box = kit.m(kit.pick("wood", "white"))
        x0 = w / 2 - 0.42
        kit.panel((x0, 0.05, 0.03), (w / 2 - 0.02, h - 0.028, d - 0.04), box, bevel=0.0015)
        cuts = np.linspace(0.05, h - 0.03, 4)
        for a, b in itertools.pairwise(cuts):
            front(kit, (x0, w / 2 - 0.02), (float(a), float(b)), d - 0.04, box, pull=pull_style(kit, "top"), grain="x")
        for z in (0.06, d - 0.06):
            kit.rod(
                (-w / 2 + 0.05, 0.0, z), (-w / 2 + 0.05, h - 0.027, z), 0.016, kit.m("metal"), end_radius=0.02, sides=10
            )
        kit.sound((x0, 0.0, 0.0), (w / 2, h - 0.03, d), box)
    else:
        metal = kit.m(kit.pick("metal", "wood_alt"))
        for side in (-1, 1):
            x = side * (w / 2 - 0.14)
            for z0, z1 in ((0.06, 0.2), (d - 0.06, d - 0.2)):
                kit.rod((x, 0.0, z0), (x, h - 0.027, z1), 0.016, metal, sides=8)
            kit.rod((x, 0.24, 0.105), (x, 0.24, d - 0.105), 0.011, metal, sides=8)
    book_pile(kit, -w / 2 + 0.2, h, 0.2, 3)
    kit.lathe(
        [(0.0, 0.0), (0.036, 0.0), (0.038, 0.1), (0.033, 0.1), (0.031, 0.01), (0.0, 0.01)],
        kit.m("ceramic_accent"),
        centre=(-w / 2 + 0.42, h, 0.12),
        segments=16,
    )
    for k in range(4):
        kit.rod(
            (-w / 2 + 0.41 + 0.006 * k, h + 0.012, 0.12),
            (-w / 2 + 0.39 + 0.02 * k, h + 0.17, 0.1 + 0.012 * k),
            0.0035,
            kit.m(("fruit_orange", "plastic_black", "fruit_red", "wood")[k]),
            sides=6,
        )
    kit.support("side_table", (-w / 2 + 0.52, w / 2 - 0.04), (0.04, d - 0.04), h, clearance=1.0)
    kit.sound((-w / 2, h - 0.028, 0.0), (w / 2, h, d), top)
