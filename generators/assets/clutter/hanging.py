"""Small things on walls: ledges with frames, hooks, plates, hangings, small shelves.

Each builder adds one thing to an empty `Kit` with its back at z = 0, the wall.
"""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.ornaments import photo_frame
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import picture_frame
from generators.assets.materials import PICTURES
from generators.assets.shapes import rotation


def picture_ledge(kit: Kit) -> None:
    """A narrow ledge with three framed pictures that lean on the wall."""
    kit.mount = "wall"
    w = kit.near(0.8, 0.15)
    wood = kit.m(kit.pick("white", "wood", "wood_alt"))
    kit.panel((-w / 2, 0.0, 0.0), (w / 2, 0.015, 0.1), wood, bevel=0.002)
    kit.panel((-w / 2, 0.015, 0.09), (w / 2, 0.035, 0.1), wood, bevel=0.002)
    kit.panel((-w / 2, 0.015, 0.0), (w / 2, 0.05, 0.01), wood, bevel=0.0)
    for x, tall in zip((-0.3 * w, 0.02 * w, 0.32 * w), kit.rng.permutation(np.array([0.2, 0.28, 0.24])), strict=True):
        width = float(tall) * float(kit.rng.choice([0.75, 0.72, 0.6]))
        one = Kit(kit.palette, kit.rng)
        picture_frame(one, width, float(tall), 0.012, 0.012, kit.m(kit.pick("wood", "plastic_black", "white", "metal")))
        pw, ph = width / 2 - 0.012, float(tall) / 2 - 0.012
        one.panel((-pw - 0.004, -ph - 0.004, 0.0), (pw + 0.004, ph + 0.004, 0.004), kit.m("mount_board"), bevel=0.0)
        corners = [(-pw, -ph, 0.0046), (pw, -ph, 0.0046), (pw, ph, 0.0046), (-pw, ph, 0.0046)]
        one.cloth_quad(corners, kit.m(f"picture_{int(kit.rng.integers(PICTURES))}"))
        lean = 8.0
        rise = float(tall) / 2 * np.cos(np.radians(lean)) + 0.0165
        kit.merge(one.build(), centre=(x, rise, 0.05), rotate=rotation("x", -lean))


def hook_rail(kit: Kit) -> None:
    """A rail with hooks and a string bag on one of them."""
    kit.mount = "wall"
    w = kit.near(0.5, 0.15)
    kit.panel((-w / 2, -0.03, 0.0), (w / 2, 0.03, 0.018), kit.m(kit.pick("wood", "white", "wood_alt")), bevel=0.003)
    metal = kit.m("metal")
    hooks = np.linspace(-w / 2 + 0.06, w / 2 - 0.06, 4)
    for x in hooks:
        kit.tube([(x, 0.0, 0.018), (x, -0.01, 0.045), (x, 0.005, 0.06), (x, 0.024, 0.062)], 0.004, metal, segments=5)
    x = float(hooks[int(kit.rng.integers(4))])
    cloth = kit.m(kit.pick("curtain", "tone_0", "cushion_1"))
    kit.soft((0.24, 0.28, 0.05), (x, -0.34, 0.06), cloth, radius=0.024, cells=2)
    kit.tube([(x - 0.07, -0.21, 0.06), (x, 0.006, 0.056), (x + 0.07, -0.21, 0.06)], 0.004, cloth, segments=4)


def woven_hanging(kit: Kit) -> None:
    """A woven wall hanging on a stick, with a fringe."""
    kit.mount = "wall"
    w, h = kit.near(0.42, 0.15), kit.near(0.5, 0.15)
    kit.rod((-w / 2 - 0.05, h / 2, 0.015), (w / 2 + 0.05, h / 2, 0.015), 0.009, kit.m("stem"), sides=6)
    u = np.linspace(-1, 1, 9)
    point = 0.12 * (1 - np.abs(u))
    rows = [
        np.stack([w / 2 * u, h / 2 - (h + point) * t + 0 * u, 0.014 + 0.003 * np.sin(5 * u + 3 * t)], axis=1)
        for t in (0, 0.33, 0.66, 1)
    ]
    kit.shell(np.array(rows), 0.008, kit.m(kit.pick("print_0", "print_1", "throw", "cushion_1")))
    for x, extra in zip(u[:-1] * w / 2 + w / 16, point[:-1], strict=True):
        low = -h / 2 - float(extra)
        kit.rod((x, low, 0.014), (x, low - 0.12, 0.014), 0.006, kit.m("sheer"), sides=4)


def framed_mirror(kit: Kit) -> None:
    """A small upright mirror in a frame."""
    kit.mount = "wall"
    w, h = kit.near(0.34, 0.2), kit.near(0.62, 0.2)
    picture_frame(kit, w, h, 0.02, 0.022, kit.m(kit.pick("metal", "wood", "white", "wood_alt")))
    kit.panel((-w / 2 + 0.01, -h / 2 + 0.01, 0.0), (w / 2 - 0.01, h / 2 - 0.01, 0.008), kit.m("mirror"), bevel=0.0)


def cube_shelf(kit: Kit) -> None:
    """A small open box on the wall with a frame or an ornament in it."""
    kit.mount = "wall"
    s, d, t = 0.26, 0.16, 0.014
    wood = kit.m(kit.pick("wood", "white", "wood_alt", "accent_paint"))
    for y in (-s / 2, s / 2 - t):
        kit.panel((-s / 2, y, 0.0), (s / 2, y + t, d), wood, bevel=0.0015)
    for x in (-s / 2, s / 2 - t):
        kit.panel((x, -s / 2 + t, 0.0), (x + t, s / 2 - t, d), wood, bevel=0.0015)
    inner = Kit(kit.palette, kit.rng)
    photo_frame(inner)
    mesh = inner.build()
    low, high = mesh.bounds.astype(np.float64)
    scale = min(1.0, 0.2 / float(high[1]), 0.12 / float(high[2] - low[2]), 0.22 / float(high[0] - low[0]))
    shrunk = mesh.transformed(np.eye(3), np.zeros(3), scale)
    kit.merge(shrunk, centre=(0.0, -s / 2 + t + 0.0004, 0.012 - scale * float(low[2])))
