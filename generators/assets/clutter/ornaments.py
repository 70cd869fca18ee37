"""Small things: vases, candles, frames, sculptures, glasses and other things on tables and shelves.

Each builder adds one thing to an empty `Kit`: standing on y = 0 about the origin, its front towards +Z.
"""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.reading import sheet
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import bowl, picture_frame, vase
from generators.assets.furniture.plants import small_plant
from generators.assets.materials import PICTURES
from generators.assets.shapes import rotation
from generators.core.scene import Material

_ORIGIN = (0.0, 0.0, 0.0)


def _glaze(kit: Kit) -> Material:
    return kit.m(kit.pick("ceramic_accent", "pot_white", "pot", "tone_0", "tone_3"))


def empty_vase(kit: Kit) -> None:
    """A turned vase without flowers."""
    vase(kit, _ORIGIN, _glaze(kit), kit.near(0.2, 0.3))


def vase_with_stems(kit: Kit) -> None:
    """A vase with dry grasses or twigs with buds."""
    tall = kit.near(0.2, 0.2)
    vase(kit, _ORIGIN, _glaze(kit), tall)
    grass = kit.rng.random() < 0.5
    stem, tip = kit.m("stem"), kit.m(kit.pick("paper", "tone_1", "leaf_alt"))
    for k in range(7):
        a = 2.4 * k + float(kit.rng.uniform(-0.4, 0.4))
        out = float(kit.rng.uniform(0.15, 0.4)) * tall
        high = tall * float(kit.rng.uniform(1.5, 2.0))
        end = np.array([out * np.cos(a), high, out * np.sin(a)])
        kit.rod((0.0, 0.78 * tall, 0.0), end, 0.0016, stem, sides=3)
        size = (0.009, 0.035, 0.009) if grass else (0.012, 0.012, 0.012)
        kit.sphere(size, end, tip, rings=4, segments=5)


def flowers(kit: Kit) -> None:
    """Cut flowers in a glass vase."""
    r, tall = 0.04, kit.near(0.18, 0.15)
    outer = [(0.0, 0.0), (0.8 * r, 0.0), (r, 0.4 * tall), (0.75 * r, 0.8 * tall), (1.1 * r, tall)]
    kit.lathe([*outer, (1.02 * r, tall), (0.6 * r, 0.8 * tall), (0.0, 0.7 * tall)], kit.m("glass"), segments=12)
    petal, heart = kit.m(kit.pick("fruit_red", "fruit_orange", "tone_1", "paper", "toy_yellow")), kit.m("toy_yellow")
    for k in range(6):
        a, s = 2.4 * k, 0.25 + 0.75 * k / 6
        lean = np.array([0.09 * s * np.cos(a), tall * (1.75 - 0.3 * s), 0.09 * s * np.sin(a)])
        kit.rod((0.0, 0.75 * tall, 0.0), lean, 0.002, kit.m("leaf_alt"), sides=3)
        kit.sphere((0.026, 0.015, 0.026), lean, petal, rings=4, segments=7)
        kit.sphere(0.009, lean + (0.0, 0.012, 0.0), heart, rings=3, segments=5)


def candles(kit: Kit) -> None:
    """One to three pillar candles that have burned down to different heights."""
    wax = kit.m(kit.pick("paper", "mount_board", "tone_2"))
    for k in range(int(kit.rng.integers(1, 4))):
        r, h = float(kit.rng.uniform(0.026, 0.038)), float(kit.rng.uniform(0.06, 0.16))
        a = 2.1 * k + 0.4
        at = (0.055 * np.cos(a), 0.0, 0.055 * np.sin(a))
        rim = [(0.0, 0.0), (r, 0.0), (r, h), (0.86 * r, h), (0.7 * r, h - 0.006), (0.0, h - 0.006)]
        kit.lathe(rim, wax, centre=at, segments=12)
        top = (at[0], h - 0.006, at[2])
        kit.rod(top, (top[0] + 0.001, h + 0.009, top[2]), 0.0012, kit.m("plastic_black"), sides=3)


def candlestick(kit: Kit) -> None:
    """A turned candlestick with a candle."""
    metal = kit.m(kit.pick("metal", "chrome", "wood"))
    h = kit.near(0.2, 0.3)
    profile = [(0.0, 0.0), (0.048, 0.0), (0.044, 0.01), (0.012, 0.02), (0.008, 0.5 * h), (0.014, 0.55 * h)]
    kit.lathe([*profile, (0.008, 0.6 * h), (0.011, 0.94 * h), (0.022, h), (0.0, h)], metal, segments=12)
    kit.cylinder(0.0105, 0.16, (0.0, h + 0.08, 0.0), kit.m("mount_board"), segments=8)


def tea_light(kit: Kit) -> None:
    """A tea light in a small glass."""
    outer = [(0.0, 0.0), (0.03, 0.0), (0.036, 0.05), (0.037, 0.07)]
    kit.lathe([*outer, (0.034, 0.07), (0.031, 0.02), (0.0, 0.02)], kit.m(kit.pick("glass", "tone_2")), segments=12)
    kit.cylinder(0.019, 0.015, (0.0, 0.0285, 0.0), kit.m("mount_board"), segments=8)


def dish(kit: Kit) -> None:
    """A shallow bowl, sometimes with three pebbles or nuts in it."""
    r = kit.near(0.1, 0.3)
    bowl(kit, _ORIGIN, kit.m(kit.pick("ceramic_accent", "wood", "pot_white", "tone_1")), r, 0.5 * r)
    if kit.rng.random() < 0.5:
        for a in (0.3, 2.5, 4.4):
            at = (0.3 * r * np.cos(a), 0.2 * r, 0.3 * r * np.sin(a))
            kit.sphere((0.18 * r, 0.13 * r, 0.15 * r), at, kit.m("stem"), rings=4, segments=6)


def photo_frame(kit: Kit) -> None:
    """A photograph in a frame that leans back on its strut."""
    w, h = (0.13, 0.18) if kit.rng.random() < 0.6 else (0.2, 0.15)
    scale = float(kit.rng.uniform(0.85, 1.4))
    w, h = w * scale, h * scale
    frame = kit.m(kit.pick("wood", "wood_alt", "metal", "white", "plastic_black"))
    stand = Kit(kit.palette, kit.rng)
    picture_frame(stand, w, h, 0.014, 0.014, frame)
    stand.panel((-w / 2 + 0.005, -h / 2 + 0.005, 0.0), (w / 2 - 0.005, h / 2 - 0.005, 0.006), frame, bevel=0.0)
    pw, ph = w / 2 - 0.014, h / 2 - 0.014
    corners = [(-pw, -ph, 0.0066), (pw, -ph, 0.0066), (pw, ph, 0.0066), (-pw, ph, 0.0066)]
    stand.cloth_quad(corners, kit.m(f"picture_{int(kit.rng.integers(PICTURES))}"))
    lean = 13.0
    c, s = np.cos(np.radians(lean)), np.sin(np.radians(lean))
    kit.merge(stand.build(), centre=(0.0, h / 2 * c, 0.0), rotate=rotation("x", -lean))
    reach = 0.6 * h / 2
    foot = (0.0, 0.003, -0.5 * h)
    kit.rod((0.0, h / 2 * c + reach * c, -reach * s - 0.001), foot, 0.004, frame, sides=4)


def sculpture(kit: Kit) -> None:
    """An abstract sculpture on a plinth: rings, a loop, stacked pebbles, or a standing figure."""
    form = kit.pick("ring", "loop", "pebbles", "figure")
    body = kit.m(kit.pick("pot_white", "metal", "wood_alt", "tone_0", "plastic_black"))
    size = kit.near(1.0, 0.2)
    if form == "pebbles":
        y = 0.0
        for r in (0.06, 0.045, 0.03):
            half = 0.55 * r * size
            kit.sphere((r * size, half, 0.85 * r * size), (0.004, y + half, 0.0), body, rings=6, segments=10)
            y += 1.9 * half
        return
    kit.panel((-0.045, 0.0, -0.035), (0.045, 0.022, 0.035), kit.m(kit.pick("wood", "plastic_black")), bevel=0.002)
    if form == "ring":
        kit.torus(0.065 * size, 0.014, (0.0, 0.022 + 0.079 * size, 0.0), body, axis="z", segments=18, minor_segments=7)
    elif form == "loop":
        t = np.linspace(0, 2 * np.pi, 26, endpoint=False)
        line = np.stack([0.05 * np.sin(2 * t), 0.095 - 0.07 * np.cos(t), 0.03 * np.cos(2 * t + 0.6)], axis=1) * size
        kit.tube(line + (0.0, 0.022, 0.0), 0.011, body, segments=6, closed=True)
    else:
        profile = [(0.0, 0.0), (0.018, 0.0), (0.013, 0.07), (0.026, 0.13), (0.03, 0.165), (0.01, 0.185), (0.0, 0.187)]
        kit.lathe(np.array(profile) * size, body, centre=(0.0, 0.022, 0.0), segments=12, scale=(1.0, 1.0, 0.7))
        kit.sphere(0.021 * size, (0.0, 0.022 + 0.205 * size, 0.0), body, rings=6, segments=10)


def jewellery_box(kit: Kit) -> None:
    """A small box with a lid and a clasp."""
    w, h, d = kit.near(0.17, 0.2), 0.075, 0.12
    box = kit.m(kit.pick("wood_alt", "leather", "tone_3", "wood"))
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, 0.68 * h, d / 2), box, bevel=0.003)
    kit.panel((-w / 2 - 0.002, 0.69 * h, -d / 2 - 0.002), (w / 2 + 0.002, h, d / 2 + 0.002), box, bevel=0.005)
    kit.panel((-0.011, 0.5 * h, d / 2), (0.011, 0.8 * h, d / 2 + 0.005), kit.m("metal"), bevel=0.001)


def tissue_box(kit: Kit) -> None:
    """A box of tissues, one of them pulled half out."""
    w, h, d = 0.22, 0.09, 0.115
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, h, d / 2), kit.m(kit.pick("print_0", "print_1", "tone_2")), bevel=0.002)
    s, t = np.linspace(-1, 1, 7), np.linspace(0, 1, 4)
    phase = float(kit.rng.uniform(0, 6))
    rows = []
    for v in t[::-1]:
        x = (0.035 + 0.025 * v) * s
        z = 0.012 * np.sin(3 * s + phase + 2 * v) * (0.3 + v)
        rows.append(np.stack([x, h - 0.004 + 0.07 * v * (1 - 0.35 * s * s), z], axis=1))
    kit.shell(np.array(rows), 0.0012, kit.m("mount_board"))


def coasters(kit: Kit) -> None:
    """A pile of coasters, one beside it."""
    role = kit.m(kit.pick("wood_alt", "leather", "tone_1", "pot"))
    for k in range(4):
        kit.cylinder(0.047, 0.0046, (0.002 * (k % 2), 0.0025 + 0.005 * k, 0.0), role, segments=14)
    kit.cylinder(0.047, 0.0046, (0.115, 0.0023, 0.03), role, segments=14)


def drinking_glass(kit: Kit) -> None:
    """A tumbler, empty or a third full of water."""
    r, h = kit.near(0.036, 0.1), kit.near(0.11, 0.15)
    outer = [(0.0, 0.0), (0.86 * r, 0.0), (r, h)]
    kit.lathe([*outer, (0.94 * r, h), (0.8 * r, 0.012), (0.0, 0.012)], kit.m("glass"), segments=14)


def mug(kit: Kit) -> None:
    """A mug with its handle."""
    r, h = 0.041, kit.near(0.092, 0.1)
    clay = _glaze(kit)
    outer = [(0.0, 0.0), (0.9 * r, 0.0), (r, 0.08 * h), (r, h)]
    kit.lathe([*outer, (0.92 * r, h), (0.9 * r, 0.7 * h), (0.0, 0.68 * h)], clay, segments=14)
    t = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 7)
    bow = np.stack([0.92 * r + 0.032 * np.cos(t), 0.5 * h + 0.33 * h * np.sin(t), np.zeros(7)], axis=1)
    kit.merge(Kit(kit.palette, kit.rng).tube(bow, 0.0045, clay, segments=6).build(), rotate=rotation("y", 40))


def carafe(kit: Kit) -> None:
    """A glass carafe."""
    outer = [(0.0, 0.0), (0.05, 0.0), (0.056, 0.04), (0.05, 0.11), (0.024, 0.17), (0.024, 0.21), (0.034, 0.24)]
    inner = [(0.03, 0.24), (0.02, 0.21), (0.02, 0.17), (0.0, 0.12)]
    kit.lathe(np.array(outer + inner) * (kit.near(1.0, 0.12), kit.near(1.0, 0.12)), kit.m("glass"), segments=14)


def tray_with_cups(kit: Kit) -> None:
    """A tray with a carafe-like bottle and two cups."""
    w, d = 0.36, 0.24
    wood = kit.m(kit.pick("wood", "wood_alt", "tone_0"))
    kit.panel((-w / 2, 0.0, -d / 2), (w / 2, 0.008, d / 2), wood, bevel=0.002)
    for z in (-d / 2, d / 2 - 0.008):
        kit.panel((-w / 2, 0.008, z), (w / 2, 0.028, z + 0.008), wood, bevel=0.0)
    for x in (-w / 2, w / 2 - 0.008):
        kit.panel((x, 0.008, -d / 2 + 0.008), (x + 0.008, 0.028, d / 2 - 0.008), wood, bevel=0.0)
    pieces = ((carafe, -0.09, -0.03), (mug, 0.04, 0.03), (drinking_glass, 0.12, -0.04))
    for make, x, z in pieces:
        inner = Kit(kit.palette, kit.rng)
        make(inner)
        kit.merge(inner.build(), centre=(x, 0.0084, z))


def pot_plant(kit: Kit) -> None:
    """A small plant in its pot."""
    small_plant(kit, _ORIGIN, kit.near(0.26, 0.3))


def succulents(kit: Kit) -> None:
    """Two or three small pots with round cacti or rosettes."""
    for k in range(int(kit.rng.integers(2, 4))):
        x = 0.085 * (k - 1)
        r = float(kit.rng.uniform(0.028, 0.036))
        outer = [(0.0, 0.0), (0.75 * r, 0.0), (r, 1.7 * r)]
        kit.lathe(
            [*outer, (0.88 * r, 1.7 * r), (0.84 * r, 1.5 * r), (0.0, 1.5 * r)],
            _glaze(kit),
            centre=(x, 0, 0),
            segments=12,
        )
        high = float(kit.rng.uniform(0.7, 1.9)) * r
        leaf = kit.m(kit.pick("leaf", "leaf_alt"))
        kit.sphere((0.66 * r, high, 0.66 * r), (x, 1.5 * r + 0.5 * high, 0.0), leaf, rings=5, segments=8)


def scent_sticks(kit: Kit) -> None:
    """A bottle with scented sticks."""
    kit.panel((-0.028, 0.0, -0.028), (0.028, 0.065, 0.028), kit.m("glass"), bevel=0.006)
    kit.cylinder(0.014, 0.016, (0.0, 0.073, 0.0), kit.m("metal"), segments=10)
    for k in range(6):
        a = 1.05 * k + float(kit.rng.uniform(-0.3, 0.3))
        end = (0.04 * np.cos(a), 0.21 + 0.01 * (k % 3), 0.04 * np.sin(a))
        kit.rod((0.0, 0.08, 0.0), end, 0.0014, kit.m("stem"), sides=3)


def globe(kit: Kit) -> None:
    """A globe on its stand."""
    r = 0.1
    metal = kit.m(kit.pick("metal", "wood"))
    kit.lathe([(0.0, 0.0), (0.07, 0.0), (0.066, 0.012), (0.014, 0.02), (0.01, 0.05), (0.0, 0.05)], metal, segments=14)
    centre = np.array([0.0, 0.05 + 1.08 * r, 0.0])
    kit.sphere(r, centre, kit.m(kit.pick("tone_0", "toy_blue")), rings=8, segments=12)
    t = np.linspace(-np.pi / 2 - 0.4, np.pi / 2 - 0.4, 9)
    arc = centre + 1.07 * r * np.stack([np.cos(t), np.sin(t), np.zeros(9)], axis=1)
    kit.tube(arc, 0.004, metal, segments=5)


def spectacles(kit: Kit) -> None:
    """A pair of glasses, folded."""
    rim = kit.m(kit.pick("plastic_black", "metal", "leather"))
    for side in (-1, 1):
        kit.torus(0.022, 0.0017, (side * 0.033, 0.024, 0.0), rim, axis="z", segments=12, minor_segments=4)
        kit.rod((side * 0.056, 0.03, 0.0), (-side * 0.05, 0.012, -0.012 - 0.006 * side), 0.0017, rim, sides=4)
    kit.rod((-0.011, 0.028, 0.0), (0.011, 0.028, 0.0), 0.0016, rim, sides=4)


def pen_cup(kit: Kit) -> None:
    """A cup with pens and a ruler."""
    outer = [(0.0, 0.0), (0.036, 0.0), (0.038, 0.1)]
    kit.lathe([*outer, (0.034, 0.1), (0.032, 0.01), (0.0, 0.01)], _glaze(kit), segments=12)
    for k in range(5):
        a = 1.26 * k
        role = ("toy_red", "plastic_black", "toy_blue", "wood", "toy_yellow")[k]
        top = (0.035 * np.cos(a), 0.15 + 0.012 * (k % 3), 0.035 * np.sin(a))
        kit.rod((-0.012 * np.cos(a), 0.012, -0.012 * np.sin(a)), top, 0.0036, kit.m(role), sides=5)


def stapler(kit: Kit) -> None:
    """A stapler."""
    body = kit.m(kit.pick("plastic_black", "toy_red", "tone_0"))
    half = kit.near(0.07, 0.1)
    kit.panel((-half, 0.0, -0.018), (half, 0.008, 0.018), body, bevel=0.002)
    turn = rotation("z", 9)
    kit.panel((-0.07, 0.024, -0.015), (0.07, 0.042, 0.015), body, bevel=0.004, rotate=turn)
    kit.box((0.03, 0.02, 0.02), (-0.058, 0.017, 0.0), kit.m("steel"))


def sticky_tape(kit: Kit) -> None:
    """A roll of adhesive tape standing on its rim."""
    r = kit.near(0.028, 0.2)
    kit.torus(r, 0.009, (0.0, r + 0.009, 0.0), kit.m("plastic_white"), axis="z", segments=14, minor_segments=5)


def letter_tray(kit: Kit) -> None:
    """Two trays on each other with papers in them."""
    w, d = 0.25, 0.32
    shell = kit.m(kit.pick("black_metal", "plastic_white", "wood"))
    for y in (0.0, 0.085):
        kit.panel((-w / 2, y, -d / 2), (w / 2, y + 0.005, d / 2), shell, bevel=0.0)
        for x in (-w / 2, w / 2 - 0.004):
            kit.panel((x, y + 0.005, -d / 2), (x + 0.004, y + (0.08 if y == 0.0 else 0.045), d / 2), shell, bevel=0.0)
        kit.panel((-w / 2 + 0.004, y + 0.005, -d / 2), (w / 2 - 0.004, y + 0.045, -d / 2 + 0.004), shell, bevel=0.0)
        pile = float(kit.rng.uniform(0.004, 0.02))
        sheet(kit, (0.21, 0.29), pile, kit.m("paper"), kit.m("page"), at=(0.0, y + 0.0054, 0.0), turn=2.0)


def binders(kit: Kit) -> None:
    """Three to five ring binders side by side."""
    x = -0.16
    for k in range(int(kit.rng.integers(3, 6))):
        colour = kit.m(kit.pick("tone_0", "tone_1", "tone_2", "plastic_black", "mount_board"))
        w = 0.075 if k % 2 else 0.05
        kit.panel((x, 0.0, -0.14), (x + w - 0.003, 0.31, 0.14), colour, bevel=0.004)
        kit.box((w * 0.6, 0.1, 0.002), (x + w / 2, 0.2, 0.1408), kit.m("mount_board"))
        x += w
