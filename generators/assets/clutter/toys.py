"""Small things: toys and games.

Each builder adds one thing to an empty `Kit`: standing or lying on y = 0 about the origin, its front towards +Z.
"""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.materials import PICTURES
from generators.assets.shapes import rotation

PAINTS = ("toy_red", "toy_yellow", "toy_blue", "toy_green", "wood")


def blocks(kit: Kit) -> None:
    """Wooden building blocks: a little tower and some that fell."""
    size = 0.04
    for k in range(3):
        turn = rotation("y", float(kit.rng.uniform(-12, 12)))
        centre = (0.0, size * (k + 0.5) + 0.0004 * k, 0.0)
        kit.box((size, size, size), centre, kit.m(PAINTS[(k + 1) % 5]), rotate=turn)
    for k in range(5):
        a, r = 1.3 * k + 0.5, float(kit.rng.uniform(0.07, 0.13))
        long = 2 * size if k == 0 else size
        centre = (r * np.cos(a), size / 2, r * np.sin(a))
        turn = rotation("y", float(kit.rng.uniform(0, 90)))
        kit.box((long, size, size), centre, kit.m(PAINTS[k % 5]), rotate=turn)


def ball(kit: Kit) -> None:
    """A ball with coloured segments."""
    r = float(kit.rng.choice([0.06, 0.09, 0.11]))
    first = int(kit.rng.integers(4))
    t = np.linspace(-np.pi / 2, np.pi / 2, 10)
    profile = np.stack([r * np.cos(t), r * np.sin(t)], axis=1)
    profile[[0, -1], 0] = 0.0
    for k, (start, stop) in enumerate(((0, 4), (3, 7), (6, 10))):
        role = PAINTS[first] if k == 1 else "plastic_white"
        kit.lathe(profile[start:stop], kit.m(role), centre=(0.0, r, 0.0), segments=16, rotate=rotation("z", 35))


def toy_car(kit: Kit) -> None:
    """A toy car."""
    paint = kit.m(kit.pick("toy_red", "toy_yellow", "toy_blue", "toy_green"))
    kit.panel((-0.06, 0.014, -0.026), (0.06, 0.036, 0.026), paint, bevel=0.006)
    kit.panel((-0.035, 0.036, -0.023), (0.025, 0.056, 0.023), kit.m("black_glass"), bevel=0.008)
    kit.box((0.045, 0.002, 0.034), (-0.005, 0.0568, 0.0), paint)
    for x in (-0.036, 0.036):
        for z in (-0.026, 0.026):
            kit.cylinder(0.014, 0.01, (x, 0.014, z), kit.m("plastic_black"), axis="z", segments=10)


def plush_bear(kit: Kit) -> None:
    """A plush bear that sits."""
    fur = kit.m(kit.pick("cushion_0", "cushion_1", "throw", "wicker"))
    light = kit.m("sheer")
    parts = (
        ((0.07, 0.085, 0.062), (0.0, 0.085, 0.0)),
        ((0.058, 0.052, 0.05), (0.0, 0.205, 0.01)),
        *(((0.022, 0.022, 0.012), (s * 0.046, 0.25, 0.0)) for s in (-1, 1)),
        *(((0.026, 0.055, 0.026), (s * 0.075, 0.11, 0.022)) for s in (-1, 1)),
        *(((0.032, 0.03, 0.058), (s * 0.05, 0.03, 0.068)) for s in (-1, 1)),
    )
    for radii, centre in parts:
        kit.sphere(radii, centre, fur, rings=5, segments=7)
    kit.sphere((0.024, 0.02, 0.016), (0.0, 0.195, 0.055), light, rings=4, segments=6)
    for s in (-1, 1):
        kit.sphere(0.006, (s * 0.022, 0.218, 0.053), kit.m("plastic_black"), rings=3, segments=5)


def stacking_rings(kit: Kit) -> None:
    """A cone of wooden rings."""
    y, high = 0.012, kit.near(0.0245, 0.04)
    kit.cylinder(0.05, 0.012, (0.0, 0.006, 0.0), kit.m("wood"), segments=12)
    for k, r in enumerate((0.045, 0.038, 0.031, 0.024)):
        kit.torus(r - 0.012, 0.012, (0.0, y + 0.012, 0.0), kit.m(PAINTS[k]), segments=10, minor_segments=5)
        y += high
    kit.rod((0.0, 0.012, 0.0), (0.0, y + 0.006, 0.0), 0.008, kit.m("wood"), sides=6)
    kit.sphere(0.016, (0.0, y + 0.014, 0.0), kit.m("toy_red"), rings=4, segments=8)


def board_games(kit: Kit) -> None:
    """Two to four boxes of games on each other."""
    y = 0.0
    for _ in range(int(kit.rng.integers(2, 5))):
        w, d, t = (
            float(kit.rng.uniform(0.24, 0.3)),
            float(kit.rng.uniform(0.2, 0.28)),
            float(kit.rng.uniform(0.04, 0.07)),
        )
        turn = rotation("y", float(kit.rng.uniform(-7, 7)))
        colour = kit.m(kit.pick("tone_0", "tone_1", "tone_2", "tone_3", f"picture_{int(kit.rng.integers(PICTURES))}"))
        kit.panel((-w / 2, y, -d / 2), (w / 2, y + t, d / 2), colour, bevel=0.002, rotate=turn)
        y += t + 0.0004


def wooden_train(kit: Kit) -> None:
    """A wooden train of an engine and two waggons."""
    gap = kit.near(0.108, 0.05)
    for k, x in enumerate((-gap, 0.0, gap)):
        paint = kit.m(PAINTS[k])
        kit.panel((x - 0.045, 0.016, -0.022), (x + 0.045, 0.032, 0.022), kit.m("wood"), bevel=0.003)
        if k == 0:
            kit.cylinder(0.018, 0.06, (x - 0.012, 0.05, 0.0), paint, axis="x", segments=10)
            kit.panel((x + 0.012, 0.032, -0.02), (x + 0.042, 0.078, 0.02), paint, bevel=0.003)
        else:
            kit.panel((x - 0.036, 0.032, -0.02), (x + 0.036, 0.058, 0.02), paint, bevel=0.003)
        for dx in (-0.028, 0.028):
            for z in (-0.023, 0.023):
                kit.cylinder(0.012, 0.008, (x + dx, 0.012, z), kit.m("toy_yellow"), axis="z", segments=6)
