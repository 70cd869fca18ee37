"""Small things: passive devices and their cables. None looks like a category that sounds.

Each builder adds one thing to an empty `Kit`: standing or lying on y = 0 about the origin, its front towards +Z.
"""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.reading import sheet
from generators.assets.forms import smooth_path
from generators.assets.furniture.common import Kit
from generators.assets.shapes import rotation
from generators.core.scene import Material


def remote_control(kit: Kit) -> None:
    """A slim remote control: a ring of keys in the middle, a few round ones below and above."""
    w, t, d = 0.042, 0.014, float(kit.rng.uniform(0.17, 0.21))
    shell, keys = kit.m(kit.pick("plastic_black", "plastic_black", "steel")), kit.m("steel")
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, t, d / 2), shell, bevel=0.004)
    kit.cylinder(0.0145, 0.0016, (0.0, t + 0.0006, -0.022), keys, segments=12)
    kit.cylinder(0.006, 0.003, (0.0, t + 0.0008, -0.022), shell, segments=8)
    for z in (0.012, 0.03):
        for x in (-0.01, 0.01):
            kit.cylinder(0.0042, 0.0018, (x, t + 0.0006, z), keys, segments=6)
    kit.cylinder(0.004, 0.0018, (0.0, t + 0.0006, -d / 2 + 0.018), kit.m("toy_red"), segments=6)


def game_controller(kit: Kit) -> None:
    """A controller for games: two grips, two sticks, a cross and four keys."""
    shell, dark = kit.m(kit.pick("plastic_white", "plastic_black", "tone_2")), kit.m("plastic_black")
    kit.soft((kit.near(0.12, 0.06), 0.034, 0.06), (0.0, 0.026, -0.012), shell, radius=0.015, cells=2)
    for side in (-1, 1):
        turn = rotation("y", side * 24)
        kit.soft((0.042, 0.036, 0.1), (side * 0.056, 0.021, 0.022), shell, radius=0.017, cells=2, rotate=turn)
        kit.cylinder(0.009, 0.014, (side * 0.026, 0.049, 0.008), dark, segments=8)
        kit.box((0.012, 0.004, 0.012), (side * 0.05, 0.044, -0.016), dark)


def laptop_closed(kit: Kit) -> None:
    """A closed laptop."""
    metal = kit.m(kit.pick("steel", "plastic_black", "plastic_white"))
    w = kit.near(0.16, 0.06)
    kit.panel((-w, 0.003, -0.11), (w, 0.011, 0.11), metal, bevel=0.003)
    kit.panel((-w, 0.0118, -0.11), (w, 0.018, 0.11), metal, bevel=0.0025)
    for x in (-0.13, 0.13):
        for z in (-0.09, 0.09):
            kit.box((0.02, 0.003, 0.008), (x, 0.0015, z), kit.m("plastic_black"))


def laptop_open(kit: Kit) -> None:
    """An open laptop with a dark screen."""
    metal = kit.m(kit.pick("steel", "plastic_black"))
    sheet_w, sheet_d = 0.32, 0.22
    kit.panel((-0.16, 0.0, -0.11), (0.16, 0.012, 0.11), metal, bevel=0.003)
    keys = np.array([(-0.14, 0.0124, 0.02), (0.14, 0.0124, 0.02), (0.14, 0.0124, -0.09), (-0.14, 0.0124, -0.09)])
    kit.cloth_quad(keys, kit.m("keyboard"))
    kit.box((0.1, 0.0006, 0.06), (0.0, 0.0122, 0.065), kit.m("plastic_black"))
    lean = float(kit.rng.uniform(12, 28))
    lid = Kit(kit.palette, kit.rng)
    lid.panel((-sheet_w / 2, 0.0, -0.006), (sheet_w / 2, sheet_d, 0.0), metal, bevel=0.002)
    face = np.array([(-0.152, 0.012, 0.0004), (0.152, 0.012, 0.0004), (0.152, 0.212, 0.0004), (-0.152, 0.212, 0.0004)])
    lid.cloth_quad(face, kit.m("screen"))
    kit.merge(lid.build(), centre=(0.0, 0.013, -0.107), rotate=rotation("x", -lean))


def tablet(kit: Kit) -> None:
    """A tablet computer lying on its back, sometimes in a sleeve."""
    rim = kit.m(kit.pick("plastic_black", "plastic_white"))
    turn = float(kit.rng.uniform(-20, 20))
    if kit.rng.random() < 0.4:
        sheet(kit, (0.27, 0.19), 0.004, kit.m("leather"), kit.m("leather"), turn=turn)
        sheet(kit, (0.25, 0.17), 0.007, rim, kit.m("screen"), at=(0.0, 0.0045, 0.0), turn=turn)
    else:
        sheet(kit, (0.25, 0.17), 0.007, rim, kit.m("screen"), turn=turn)


def headphones(kit: Kit) -> None:
    """Headphones lying on their side."""
    shell, pad = kit.m(kit.pick("plastic_black", "plastic_white", "tone_1")), kit.m("plastic_black")
    t = np.linspace(np.radians(-20), np.radians(200), 11)
    arc = np.stack([0.078 * np.cos(t), np.full(11, 0.035), -0.085 * np.sin(t)], axis=1)
    kit.tube(arc, 0.0085, shell, segments=6)
    for side in (-1, 1):
        centre = (side * 0.068, 0.036, 0.03)
        kit.cylinder(0.035, 0.022, centre, shell, axis="x", segments=12, bevel=0.005)
        kit.cylinder(0.033, 0.016, (side * 0.05, 0.036, 0.03), pad, axis="x", segments=12)


def loudspeaker(kit: Kit) -> None:
    """A passive bookshelf loudspeaker."""
    w, h, d = kit.near(0.17, 0.1), kit.near(0.28, 0.1), 0.19
    box = kit.m(kit.pick("wood", "plastic_black", "white"))
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, h, d / 2), box, bevel=0.004)
    cone = kit.m("plastic_black")
    for y, r in ((0.32 * h, 0.36 * w), (0.75 * h, 0.17 * w)):
        ring = [(0.0, 0.004), (0.35 * r, 0.004), (0.8 * r, 0.002), (r, 0.006), (1.08 * r, 0.006), (1.08 * r, 0.0)]
        kit.lathe(ring[::-1], cone, centre=(0.0, y, d / 2), segments=14, rotate=rotation("x", 90))


def monitor(kit: Kit) -> None:
    """A computer's monitor on its foot, switched off."""
    w, h, y = kit.near(0.57, 0.08), 0.335, kit.near(0.11, 0.15)
    black = kit.m("plastic_black")
    kit.panel((-0.12, 0.0, -0.09), (0.12, 0.012, 0.09), black, bevel=0.004)
    kit.panel((-0.022, 0.012, -0.045), (0.022, y + 0.14, -0.03), black, bevel=0.003)
    kit.panel((-w / 2, y, -0.03), (w / 2, y + h, 0.0), black, bevel=0.005)
    e = 0.008
    kit.cloth_quad(
        [
            (-w / 2 + e, y + 1.8 * e, 0.0004),
            (w / 2 - e, y + 1.8 * e, 0.0004),
            (w / 2 - e, y + h - e, 0.0004),
            (-w / 2 + e, y + h - e, 0.0004),
        ],
        kit.m("screen"),
    )


def keyboard(kit: Kit) -> None:
    """A computer's keyboard."""
    shell = kit.m(kit.pick("plastic_black", "steel", "plastic_white"))
    sheet(kit, (0.43, 0.13), 0.014, shell, kit.m("keyboard"), turn=float(kit.rng.uniform(-4, 4)))


def mouse(kit: Kit) -> None:
    """A computer's mouse."""
    shell = kit.m(kit.pick("plastic_black", "plastic_white"))
    kit.soft((0.06, 0.034, 0.105), (0.0, 0.017, 0.0), shell, radius=0.016, puff=(0.0, 0.004, 0.0), cells=3)


def cable(kit: Kit, points: list[tuple[float, float, float]], material: Material, *, radius: float = 0.0035) -> None:
    """A cable along a smooth line through points."""
    kit.tube(smooth_path(np.array(points), 4 * len(points)), radius, material, segments=5)


def power_strip(kit: Kit) -> None:
    """A power strip with two plugs; its cable runs over the floor in loose bends."""
    shell = kit.m(kit.pick("plastic_white", "plastic_black"))
    kit.panel((-0.14, 0.0, -0.027), (0.14, 0.038, 0.027), shell, bevel=0.006)
    for x in (-0.1, -0.05, 0.0, 0.05):
        kit.cylinder(0.018, 0.0012, (x, 0.0386, 0.0), kit.m("plastic_black"), segments=8)
    plugs = kit.rng.permutation(np.array([-0.1, -0.05, 0.0, 0.05]))[:2]
    for x in plugs:
        kit.panel((x - 0.016, 0.039, -0.016), (x + 0.016, 0.07, 0.016), kit.m("plastic_white"), bevel=0.004)
    kit.box((0.018, 0.004, 0.012), (0.105, 0.039, 0.0), kit.m("toy_red"))
    bend = float(kit.rng.uniform(-0.08, 0.08))
    line = [
        (0.139, 0.018, 0.0),
        (0.19, 0.006, 0.01),
        (0.26, 0.005, bend),
        (0.34, 0.005, 0.02 - bend),
        (0.4, 0.005, 0.0),
    ]
    cable(kit, line, shell)


def charging_cable(kit: Kit) -> None:
    """A charger's cable lying in loose loops, with its plug."""
    white = kit.m(kit.pick("plastic_white", "plastic_black"))
    kit.panel((-0.1, 0.0, -0.014), (-0.06, 0.028, 0.014), white, bevel=0.004)
    t = np.linspace(0, 2.4 * np.pi, 22)
    r = 0.045 + 0.012 * np.sin(1.7 * t + float(kit.rng.uniform(0, 6)))
    line = np.stack([0.02 + r * np.sin(t - 2.2), 0.003 + 0.0012 * t / 2, r * np.cos(t - 2.2)], axis=1)
    kit.tube(np.concatenate([[[-0.06, 0.012, 0.0]], line]), 0.0018, white, segments=4)


def games_console(kit: Kit) -> None:
    """A games console lying flat."""
    w, h, d = kit.near(0.29, 0.08), kit.near(0.055, 0.2), kit.near(0.21, 0.08)
    kit.panel(
        (-w / 2, 0.004, -d / 2), (w / 2, h, d / 2), kit.m(kit.pick("plastic_black", "plastic_white")), bevel=0.006
    )
    kit.box((w - 0.03, 0.004, d - 0.03), (0.0, 0.002, 0.0), kit.m("plastic_black"))
    kit.box((0.1, 0.003, 0.002), (0.03, 0.6 * h, d / 2 + 0.0005), kit.m("black_glass"))


def desk_lamp(kit: Kit) -> None:
    """A reading lamp that is off: foot, two arms with a joint, and a conical shade."""
    metal = kit.m(kit.pick("metal", "black_metal", "accent_paint"))
    kit.lathe([(0.0, 0.0), (0.08, 0.0), (0.078, 0.016), (0.012, 0.022), (0.0, 0.022)], metal, segments=16)
    elbow = (-0.06, 0.23, -0.03)
    head = (0.08, 0.39, 0.05)
    kit.rod((0.0, 0.02, 0.0), elbow, 0.006, metal, sides=6)
    kit.rod(elbow, head, 0.006, metal, sides=6)
    kit.sphere(0.013, elbow, metal, rings=4, segments=6)
    outer = [(0.0, 0.085), (0.02, 0.08), (0.03, 0.06), (0.07, 0.0)]
    inner = [(0.065, 0.0), (0.026, 0.056), (0.0, 0.07)]
    turn = rotation("z", 14)
    kit.lathe([*inner[::-1], *outer[::-1]], metal, centre=(0.09, 0.325, 0.055), segments=12, rotate=turn)
    cable(kit, [(-0.03, 0.006, -0.06), (-0.08, 0.004, -0.1), (-0.14, 0.004, -0.09), (-0.2, 0.004, -0.12)], metal)
