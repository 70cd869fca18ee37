"""Small things: baskets, boxes, bins and stands that hold things.

Each builder adds one thing to an empty `Kit`: standing on y = 0 about the origin, its front towards +Z.
"""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.reading import crumpled_ball
from generators.assets.clutter.soft import heap
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import ring_stack
from generators.assets.shapes import rotation


def basket(kit: Kit) -> None:
    """A round wicker basket with a blanket or wool in it."""
    r, h = float(kit.rng.uniform(0.15, 0.21)), float(kit.rng.uniform(0.2, 0.3))
    outer = [(0.0, 0.0), (0.85 * r, 0.0), (0.97 * r, 0.3 * h), (r, 0.75 * h), (0.95 * r, h)]
    kit.lathe([*outer, (0.88 * r, h), (0.9 * r, 0.6 * h), (0.0, 0.55 * h)], kit.m("wicker"), segments=18)
    for side in (-1, 1):
        t = np.linspace(0, np.pi, 7)
        bow = np.stack([np.full(7, side * 0.95 * r), h - 0.012 + 0.05 * np.sin(t), 0.05 * np.cos(t)], axis=1)
        kit.tube(bow, 0.007, kit.m("wicker"), segments=5)
    filling = Kit(kit.palette, kit.rng)
    heap(filling, 0.72 * r, 0.55 * h, filling.m(filling.pick("throw", "cushion_0", "cushion_3", "sheet")))
    kit.merge(filling.build(), centre=(0.0, 0.56 * h, 0.0))
    kit.sound((-0.75 * r, 0.0, -0.75 * r), (0.75 * r, h, 0.75 * r), kit.m("wicker"))


def storage_box(kit: Kit) -> None:
    """A box with a lid and a label holder."""
    w, h, d = kit.near(0.3, 0.2), kit.near(0.16, 0.25), kit.near(0.24, 0.12)
    skin = kit.m(kit.pick("tone_0", "tone_1", "curtain", "mount_board", "cushion_1"))
    kit.panel((-w / 2 + 0.003, 0.0, -d / 2 + 0.003), (w / 2 - 0.003, h - 0.03, d / 2 - 0.003), skin, bevel=0.003)
    kit.panel((-w / 2, h - 0.05, -d / 2), (w / 2, h, d / 2), skin, bevel=0.003)
    kit.box((0.07, 0.03, 0.002), (0.0, 0.45 * h, d / 2 - 0.002), kit.m("metal"))
    kit.box((0.058, 0.02, 0.001), (0.0, 0.45 * h, d / 2 - 0.0005), kit.m("paper"))


def cardboard_box(kit: Kit) -> None:
    """A parcel of cardboard, taped shut or with its flaps open."""
    w, h, d = kit.near(0.36, 0.25), kit.near(0.24, 0.3), kit.near(0.28, 0.2)
    board = kit.m("cardboard")
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, h, d / 2), board, bevel=0.002)
    if kit.rng.random() < 0.5:
        kit.box((0.048, 0.0008, d + 0.001), (0.0, h + 0.0002, 0.0), kit.m("stem"))
        kit.box((0.1, 0.0008, 0.07), (0.25 * w, h + 0.0002, 0.15 * d), kit.m("paper"))
        return
    for side in (-1, 1):
        turn = rotation("x", side * float(kit.rng.uniform(35, 65)))
        flap = Kit(kit.palette, kit.rng)
        flap.box((w - 0.006, 0.004, 0.42 * d), (0.0, 0.0, side * 0.21 * d), board)
        kit.merge(flap.build(), centre=(0.0, h + 0.002, side * d / 2), rotate=turn)


def magazine_rack(kit: Kit) -> None:
    """A V-shaped stand with magazines."""
    w, h = 0.32, 0.28
    wood = kit.m(kit.pick("wood", "metal", "leather"))
    for side in (-1, 1):
        kit.panel((-w / 2, 0.02, -0.004), (w / 2, h, 0.004), wood, bevel=0.002, rotate=rotation("x", side * 22))
    for x in (-w / 2 + 0.02, w / 2 - 0.02):
        for z in (-0.07, 0.07):
            kit.rod((x, 0.0, z), (x, 0.12, 0.3 * z), 0.007, wood, sides=5)
    for k in range(4):
        turn = rotation("x", 16 - 10 * k)
        role = ("tone_0", "picture_0", "paper", "tone_1")[k]
        kit.panel((-0.11, 0.05, -0.003), (0.11, h + 0.035 - 0.012 * k, 0.003), kit.m(role), bevel=0.0, rotate=turn)


def waste_basket(kit: Kit) -> None:
    """A waste-paper basket with crumpled paper in it."""
    r, h = 0.13, kit.near(0.28, 0.1)
    skin = kit.m(kit.pick("black_metal", "wicker", "plastic_white", "tone_0"))
    outer = [(0.0, 0.0), (0.78 * r, 0.0), (r, h)]
    kit.lathe([*outer, (0.95 * r, h), (0.82 * r, 0.5 * h), (0.0, 0.5 * h)], skin, segments=16)
    for k in range(4):
        inner = Kit(kit.palette, kit.rng)
        crumpled_ball(inner, 0.036, inner.m("paper"))
        a = 1.6 * k
        kit.merge(inner.build(), centre=(0.055 * np.cos(a), 0.5 * h + 0.001, 0.055 * np.sin(a)))
    kit.sound((-0.1, 0.0, -0.1), (0.1, h, 0.1), skin)


def crate(kit: Kit) -> None:
    """A wooden crate of slats."""
    w, h, d, t = 0.36, 0.24, 0.26, 0.011
    wood = kit.m(kit.pick("wood", "wood_alt"))
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, t, d / 2), wood, bevel=0.0)
    for y in (0.02, 0.095, 0.17):
        for z in (-d / 2, d / 2 - t):
            kit.panel((-w / 2, y, z), (w / 2, y + 0.06, z + t), wood, bevel=0.0)
        for x in (-w / 2, w / 2 - t):
            kit.panel((x, y, -d / 2 + t), (x + t, y + 0.06, d / 2 - t), wood, bevel=0.0)
    for k, role in enumerate(("tone_0", "cushion_1", "plastic_white")):
        kit.panel((-0.15 + 0.1 * k, t, -0.1), (-0.06 + 0.1 * k, h - 0.03 * k, 0.1), kit.m(role), bevel=0.004)


def suitcase(kit: Kit) -> None:
    """A suitcase that stands on its long side."""
    skin = kit.m(kit.pick("leather", "tone_0", "plastic_black", "tone_3"))
    kit.soft((0.52, 0.38, 0.19), (0.0, 0.19, 0.0), skin, radius=0.03, cells=3)
    for x in (-0.16, 0.16):
        kit.box((0.03, 0.382, 0.193), (x, 0.191, 0.0), kit.m("leather"))
    t = np.linspace(0, np.pi, 7)
    kit.tube(
        np.stack([0.06 * np.cos(t), 0.38 + 0.028 * np.sin(t), 0 * t], axis=1), 0.008, kit.m("plastic_black"), segments=5
    )
    kit.sound((-0.26, 0.0, -0.095), (0.26, 0.38, 0.095), kit.m("leather"))


def paper_roll_vase(kit: Kit) -> None:
    """A tall vase with rolls of paper."""
    r, h = 0.11, 0.42
    outer = [(0.0, 0.0), (0.85 * r, 0.0), (r, 0.2 * h), (0.92 * r, h)]
    kit.lathe(
        [*outer, (0.84 * r, h), (0.8 * r, 0.6 * h), (0.0, 0.6 * h)],
        kit.m(kit.pick("pot", "wicker", "ceramic_accent")),
        segments=16,
    )
    for k in range(3):
        a = 2.1 * k
        start = (0.03 * np.cos(a), 0.605 * h, 0.03 * np.sin(a))
        kit.rod(start, (0.06 * np.cos(a), 1.4 * h + 0.03 * k, 0.06 * np.sin(a)), 0.022, kit.m("paper"), sides=8)


def tray_box(kit: Kit) -> None:
    """A flat storage box on castors for the space below a bed."""
    skin = kit.m(kit.pick("curtain", "tone_0", "cardboard"))
    kit.panel((-0.34, 0.02, -0.24), (0.34, 0.15, 0.24), skin, bevel=0.006)
    for x in (-0.3, 0.3):
        for z in (-0.2, 0.2):
            kit.cylinder(0.012, 0.02, (x, 0.01, z), kit.m("plastic_black"), segments=6)
    kit.box((0.12, 0.02, 0.004), (0.0, 0.09, 0.242), kit.m("leather"))


def ring_basket(kit: Kit) -> None:
    """A rectangular fabric bin with rope handles and toys or socks in it."""
    rings = ring_stack(
        [
            (0.28, 0.2, 0.03, 0.0),
            (0.3, 0.22, 0.035, 0.1),
            (0.31, 0.23, 0.04, 0.2),
            (0.29, 0.21, 0.04, 0.2),
            (0.28, 0.2, 0.035, 0.12),
        ],
        per_corner=3,
    )
    rings *= (kit.near(1.0, 0.1), 1.0, kit.near(1.0, 0.06))
    kit.loft(rings, kit.m(kit.pick("curtain", "cushion_0", "wicker", "print_2")), crease=50.0)
    for k in range(3):
        at = (-0.07 + 0.07 * k, 0.145, 0.03 * (-1) ** k)
        kit.sphere((0.05, 0.035, 0.05), at, kit.m(("toy_red", "toy_blue", "sheet")[k]), rings=5, segments=8)
