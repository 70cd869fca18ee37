"""Dining: table, chair, stool; and the waste bin."""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.core.scene import Material


def dining_table(kit: Kit, *, length: float | None = None) -> None:
    """A table: straight or tapered legs under a rectangle, a trestle, or a round top on a column."""
    form = kit.pick("tapered", "square", "round") if length is None else kit.pick("tapered", "square")
    h = 0.75
    top = kit.m("wood")
    if form == "round":
        r = kit.near(0.55, 0.08)
        kit.round_top(r, h - 0.032, h, top)
        leg = kit.m(kit.pick("wood", "metal", "white"))
        profile = [
            (0.0, 0.0),
            (0.29, 0.0),
            (0.3, 0.012),
            (0.2, 0.03),
            (0.06, 0.1),
            (0.045, 0.3),
            (0.05, h - 0.1),
            (0.16, h - 0.035),
            (0.0, h - 0.034),
        ]
        kit.lathe(profile, leg, segments=24)
        half = 0.68 * r
        kit.support("side_table", (-half, half), (-half, half), h, clearance=0.9)
        kit.sound((-0.85 * r, h - 0.032, -0.85 * r), (0.85 * r, h, 0.85 * r), top)
        return
    w, d = float(length or kit.rng.choice([1.4, 1.6, 1.8])), kit.near(0.85, 0.05)
    with kit.one_slab(), kit.grained("x"):
        kit.panel((-w / 2, h - 0.032, -d / 2), (w / 2, h, d / 2), top, bevel=0.006)
    apron = kit.m(kit.pick("wood", "white")) if form == "square" else top
    inset = 0.06 if form == "square" else 0.1
    x, z = w / 2 - inset, d / 2 - inset
    for side in (-1, 1):
        kit.panel((-x, h - 0.115, side * z - 0.011), (x, h - 0.032, side * z + 0.011), apron, bevel=0.0)
        kit.panel((side * x - 0.011, h - 0.115, -z), (side * x + 0.011, h - 0.032, z), apron, bevel=0.0)
        for front_ in (-1, 1):
            if form == "square":
                kit.panel(
                    (side * x - 0.033, 0.0, front_ * z - 0.033),
                    (side * x + 0.033, h - 0.033, front_ * z + 0.033),
                    apron,
                    bevel=0.004,
                )
            else:
                kit.rod(
                    (side * (x + 0.05), 0.0, front_ * (z + 0.04)),
                    (side * x, h - 0.033, front_ * z),
                    0.017,
                    apron,
                    end_radius=0.032,
                    sides=12,
                )
    kit.support("side_table", (-w / 2 + 0.05, w / 2 - 0.05), (-d / 2 + 0.05, d / 2 - 0.05), h, clearance=0.9)
    kit.sound((-w / 2, h - 0.06, -d / 2), (w / 2, h, d / 2), top)


def chair(kit: Kit) -> None:
    """A chair: spindle-backed, upholstered shell, or bentwood with a curved back rest."""
    form = str(kit.palette.choose("chair", ("spindle", "shell", "bent")))
    wood = kit.m(str(kit.palette.choose("chair wood", ("wood", "wood_alt", "black_metal", "accent_paint"))))
    seat, w, d = 0.455, 0.43, 0.42
    z = d / 2 - 0.045
    if form == "shell":
        _shell_chair(kit, wood)
        return
    build = _spindle_chair if form == "spindle" else _bentwood_chair
    back = build(kit, wood, seat, w, d)
    kit.sound((-w / 2, seat - 0.05, -d / 2), (w / 2, seat, d / 2), wood)
    kit.sound((-w / 2, 0.68, -z - back), (w / 2, 0.86, -z - 0.05), wood)


def _bentwood_chair(kit: Kit, wood: Material, seat: float, w: float, d: float) -> float:
    """A padded seat of width ``w`` and depth ``d`` with a curved rest; returns how far the back leans (m)."""
    x, z = w / 2 - 0.045, d / 2 - 0.045
    kit.soft(
        (w, 0.05, d),
        (0.0, seat - 0.02, 0.0),
        kit.m("chair_fabric"),
        radius=0.024,
        puff=(0.004, 0.008, 0.004),
        cells=6,
    )
    kit.panel(
        (-w / 2 + 0.015, seat - 0.075, -d / 2 + 0.015),
        (w / 2 - 0.015, seat - 0.035, d / 2 - 0.015),
        wood,
        bevel=0.004,
    )
    for sx in (-1, 1):
        kit.rod((sx * (x + 0.015), 0.0, z + 0.01), (sx * x, seat - 0.04, z), 0.013, wood, end_radius=0.019, sides=9)
        kit.tube(
            [
                (sx * (x + 0.015), 0.0, -z - 0.05),
                (sx * x, seat - 0.04, -z),
                (sx * x, 0.62, -z - 0.03),
                (sx * x, 0.82, -z - 0.085),
            ],
            [0.012, 0.019, 0.017, 0.012],
            wood,
            segments=9,
        )
    t = np.linspace(-1, 1, 9)
    rows = [
        np.stack([t * (x + 0.03), np.full(9, y), -z - 0.03 - lean - 0.045 * (1 - t**2)], axis=1)
        for y, lean in ((0.83, 0.055), (0.79, 0.05), (0.73, 0.036), (0.69, 0.028))
    ]
    kit.shell(np.array(rows), 0.02, wood)
    return 0.07


def _spindle_chair(kit: Kit, wood: Material, seat: float, w: float, d: float) -> float:
    """A wooden seat of width ``w`` and depth ``d`` with a back of spindles; returns how far the back leans (m)."""
    x, z = w / 2 - 0.045, d / 2 - 0.045
    kit.soft((w, 0.035, d), (0.0, seat - 0.0175, 0.0), wood, radius=0.017, puff=(0.004, 0.0, 0.006), cells=6)
    for sx in (-1, 1):
        kit.rod((sx * (x + 0.04), 0.0, z + 0.035), (sx * x, seat - 0.02, z), 0.012, wood, end_radius=0.018, sides=9)
        kit.rod((sx * (x + 0.03), 0.0, -z - 0.06), (sx * x, seat - 0.02, -z), 0.012, wood, end_radius=0.018, sides=9)
        kit.rod(
            (sx * (x - 0.0), seat - 0.01, -z),
            (sx * (x + 0.01), 0.87, -z - 0.09),
            0.014,
            wood,
            end_radius=0.011,
            sides=9,
        )
        kit.rod((sx * (x + 0.02), 0.2, z + 0.02), (sx * (x + 0.016), 0.2, -z - 0.03), 0.009, wood, sides=7)
    kit.rod((-x - 0.02, 0.2, 0.0), (x + 0.02, 0.2, 0.0), 0.009, wood, sides=7)
    for px in np.linspace(-0.11, 0.11, 5):
        kit.rod((px, seat - 0.01, -z), (px * 1.1, 0.84, -z - 0.085), 0.0075, wood, sides=6)
    t = np.linspace(-1, 1, 7)
    rail = np.stack([t * (x + 0.035), np.full(7, 0.865), -z - 0.088 - 0.03 * (1 - t**2)], axis=1)
    kit.tube(rail, np.where(np.abs(t) > 0.9, 0.02, 0.026), wood, segments=9)
    return 0.09


def _shell_chair(kit: Kit, legs: Material) -> None:
    """An upholstered shell on four splayed legs."""
    fabric = kit.m("chair_fabric")
    rows = []
    line = [
        (0.47, 0.23),
        (0.478, 0.16),
        (0.465, 0.02),
        (0.462, -0.1),
        (0.49, -0.175),
        (0.58, -0.21),
        (0.7, -0.23),
        (0.8, -0.245),
        (0.835, -0.25),
    ]
    u = np.linspace(-1, 1, 11)
    for k, (y, depth) in enumerate(line):
        s = k / (len(line) - 1)
        half = 0.235 * (1 - 0.35 * max(0.0, s - 0.8) / 0.2 * 0.6) * (1 - 0.1 * max(0.0, 0.15 - s) / 0.15)
        curl = 0.035 * np.abs(u) ** 3
        rows.append(
            np.stack([u * half, y + curl * (1 if s < 0.5 else 0.2), depth + curl * (1.6 if s >= 0.5 else 0.0)], axis=1)
        )
    kit.shell(np.array(rows), 0.035, fabric)
    for sx in (-1, 1):
        for sz in (-1, 1):
            kit.rod((sx * 0.22, 0.0, sz * 0.2), (sx * 0.13, 0.455, sz * 0.11), 0.009, legs, end_radius=0.015, sides=9)
    kit.sound((-0.22, 0.43, -0.2), (0.22, 0.48, 0.22), fabric)
    kit.sound((-0.22, 0.5, -0.27), (0.22, 0.83, -0.21), fabric)


def stool(kit: Kit) -> None:
    """A low stool or a bar stool with a foot ring."""
    tall = kit.pick("low", "bar") == "bar"
    h = 0.68 if tall else 0.45
    wood = kit.m("wood")
    leg = kit.m(kit.pick("wood", "metal"))
    kit.round_top(0.165, h - 0.035, h, wood)
    for k in range(4):
        a = np.pi / 4 + k * np.pi / 2
        c, s = float(np.cos(a)), float(np.sin(a))
        kit.rod((0.19 * c, 0.0, 0.19 * s), (0.11 * c, h - 0.034, 0.11 * s), 0.011, leg, end_radius=0.016, sides=9)
    ring = 0.28 if tall else 0.16
    kit.torus(0.19 - 0.08 * ring / h, 0.008, (0.0, ring, 0.0), leg, segments=24, minor_segments=6)
    kit.sound((-0.15, h - 0.035, -0.15), (0.15, h, 0.15), wood)


def waste_bin(kit: Kit) -> None:
    """A pedal bin or an open paper basket."""
    if kit.rng.random() < 0.6:
        skin = kit.m(kit.pick("steel", "enamel", "black_metal"))
        h = kit.near(0.42, 0.1)
        kit.lathe([(0.0, 0.0), (0.128, 0.0), (0.13, 0.02), (0.13, h - 0.06), (0.0, h - 0.06)], skin, segments=28)
        kit.lathe(
            [(0.0, h - 0.058), (0.133, h - 0.058), (0.133, h - 0.035), (0.1, h - 0.01), (0.0, h)],
            kit.m("plastic_black"),
            segments=28,
        )
        kit.panel((-0.04, 0.006, 0.11), (0.04, 0.022, 0.175), kit.m("chrome"), bevel=0.004)
    else:
        h = 0.32
        kit.lathe(
            [(0.0, 0.0), (0.11, 0.0), (0.145, h), (0.138, h), (0.105, 0.012), (0.0, 0.012)],
            kit.m(kit.pick("wicker", "accent_paint", "black_metal")),
            segments=28,
        )
    kit.sound((-0.12, 0.0, -0.12), (0.12, h, 0.12), kit.m("plastic_black"))
