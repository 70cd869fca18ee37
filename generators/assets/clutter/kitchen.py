"""Small things of kitchens: crockery, pots, food and its packaging, washing-up, papers on the fridge."""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.forms import (
    BOTTLE,
    BOWL,
    CAN,
    CLOTHS,
    CUP,
    GLASSES,
    GLAZES,
    JAR,
    MUG,
    PLASTICS,
    POT,
    SQUAT_BOTTLE,
    TUMBLER,
    WOODS,
    Turned,
    banded,
    carton,
    coloured,
    folded,
    hanging,
    label_cell,
    lid,
    sheet,
    vessel,
)
from generators.assets.clutter.record import ClutterKind
from generators.assets.furniture.common import Kit
from generators.assets.furniture.plants import small_plant
from generators.assets.shapes import rotation

_FRUITS = ("#dd8a35", "#8aa843", "#b23a32", "#e3c04a", "#6d8a3c")


def plates(kit: Kit) -> None:
    """A pile of plates, sometimes of two sizes."""
    glaze = coloured(kit, "pot_white", GLAZES)
    r, y = kit.near(0.118, 0.12), 0.0
    for _ in range(int(kit.rng.integers(3, 8))):
        kit.lathe(
            [(0, y), (0.6 * r, y), (r, y + 0.014), (r, y + 0.018), (0.62 * r, y + 0.006), (0, y + 0.005)],
            glaze,
            centre=(float(kit.rng.uniform(-0.002, 0.002)), 0.0, 0.0),
            segments=18,
        )
        y += 0.0075
    if kit.rng.random() < 0.4:
        vessel(kit, BOWL, 0.55 * r, 0.05, coloured(kit, "pot_white", GLAZES), at=(0, y, 0))


def bowls(kit: Kit) -> None:
    """Bowls in one another."""
    glaze = coloured(kit, "pot_white", GLAZES)
    r, h = kit.near(0.075, 0.15), kit.near(0.06, 0.15)
    for k in range(int(kit.rng.integers(1, 5))):
        vessel(kit, BOWL, r, h, glaze, at=(0, 0.32 * h * k, 0))


def mug(kit: Kit) -> None:
    """A mug with a handle."""
    glaze = coloured(kit, "pot_white", GLAZES)
    r, h = kit.near(0.04, 0.12), kit.near(0.092, 0.15)
    vessel(kit, MUG if kit.rng.random() < 0.6 else CUP, r, h, glaze)
    t = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 6)
    loop = np.stack([0.86 * r + 0.028 * np.cos(t), 0.52 * h + 0.33 * h * np.sin(t), np.zeros(6)], axis=1)
    kit.tube(loop, 0.0045, glaze, segments=5)


def cutlery(kit: Kit) -> None:
    """A jar of cutlery or of cooking spoons."""
    r, h = kit.near(0.05, 0.12), kit.near(0.13, 0.1)
    vessel(kit, POT, r, h, coloured(kit, "pot_white", GLAZES))
    tool = kit.m("steel") if kit.rng.random() < 0.5 else coloured(kit, "stem", WOODS)
    for k in range(int(kit.rng.integers(4, 8))):
        a = 2 * np.pi * k / 7 + float(kit.rng.uniform(0, 0.5))
        side = np.array([np.cos(a), 0.0, np.sin(a)])
        head = side * 0.9 * r + (0.0, h + float(kit.rng.uniform(0.05, 0.14)), 0.0)
        kit.rod(0.4 * r * side + (0.0, 0.02, 0.0), head, 0.0035, tool, sides=5)
        kit.sphere((0.016, 0.026, 0.006), head, tool, rings=4, segments=7)


def knife_block(kit: Kit) -> None:
    """A slanting block with the handles of knives."""
    wood = coloured(kit, "stem", WOODS)
    tilt = rotation("x", -22)
    kit.panel((-0.05, 0.02, -0.06), (0.05, 0.22, 0.04), wood, bevel=0.004, rotate=tilt)
    kit.panel((-0.045, 0.0, -0.06), (0.045, 0.06, 0.05), wood, bevel=0.002)
    for k in range(int(kit.rng.integers(3, 7))):
        x, y = -0.032 + 0.032 * (k % 3), 0.226 - 0.006 * (k // 3)
        top = tilt @ np.array([0.0, 0.115, -0.03 + 0.05 * (k // 3)]) + (x, 0.12, -0.01)
        along = tilt @ np.array([0.0, 0.1, 0.0])
        kit.rod(top, top + along * kit.near(1 - 0.1 * k, 0.1) * y / 0.226, 0.009, kit.m("plastic_black"), sides=6)


def chopping_boards(kit: Kit) -> None:
    """Boards of different sizes that lean on what is behind them."""
    z = 0.0
    for _ in range(int(kit.rng.integers(1, 4))):
        w, h, t = kit.near(0.24, 0.25), kit.near(0.33, 0.2), kit.near(0.018, 0.3)
        x = float(kit.rng.uniform(-0.05, 0.05))
        tilt = rotation("x", -8)
        board = Kit(kit.palette, kit.rng)
        board.slab(
            (w, h, t),
            (0, h / 2, 0),
            kit.m("butcher") if kit.rng.random() < 0.5 else coloured(kit, "stem", WOODS),
            corner=0.03,
            bevel=0.003,
            steps=2,
        )
        mesh = board.build().transformed(tilt, np.zeros(3))
        kit.merge(mesh, centre=(x, -float(mesh.bounds[0, 1]), z))
        z += t + 0.004


def kitchen_roll(kit: Kit) -> None:
    """A roll of paper on a stand."""
    kit.cylinder(0.075, 0.012, (0, 0.006, 0), coloured(kit, "stem", WOODS), segments=14)
    r = float(kit.rng.uniform(0.035, 0.06))
    kit.lathe([(0.02, 0.014), (r, 0.014), (r, 0.24), (0.02, 0.24)], kit.m("paper"), segments=14)
    kit.rod((0, 0.01, 0), (0, 0.29, 0), 0.008, coloured(kit, "stem", WOODS), sides=8)


def fruit(kit: Kit) -> None:
    """A bowl of fruit of one or two kinds."""
    r, h = kit.near(0.13, 0.15), kit.near(0.075, 0.2)
    vessel(kit, BOWL, r, h, coloured(kit, "ceramic_accent", GLAZES + WOODS))
    skins = [coloured(kit, "fruit_orange", _FRUITS) for _ in range(2)]
    for k in range(int(kit.rng.integers(4, 8))):
        a, out = 2 * np.pi * k / 5, (0.5 * r if k < 5 else 0.1 * r)
        size = kit.near(0.036, 0.15)
        kit.sphere(
            (size, kit.near(size, 0.15), size),
            (out * np.cos(a), 0.55 * h + (0.02 if k < 5 else 0.055), out * np.sin(a)),
            skins[k % 2],
            rings=6,
            segments=9,
        )


def bread(kit: Kit) -> None:
    """A loaf on a board, sometimes cut."""
    kit.panel((-0.17, 0, -0.11), (0.17, 0.018, 0.11), kit.m("butcher"), bevel=0.004)
    crust = kit.palette.tinted("leather", kit.pick("#a8713c", "#8d5a2c"))
    length = float(kit.rng.uniform(0.16, 0.26))
    kit.soft((length, 0.085, 0.11), (0, 0.06, 0), crust, radius=0.04, puff=(0, 0.012, 0.004), cells=4)


def dish_rack(kit: Kit) -> None:
    """A wire rack with plates standing in it and a glass or two."""
    metal = kit.m(kit.pick("chrome", "black_metal", "metal"))
    w, d = 0.36, 0.27
    for y in (0.012, 0.09):
        kit.tube(
            [(-w / 2, y, -d / 2), (w / 2, y, -d / 2), (w / 2, y, d / 2), (-w / 2, y, d / 2)],
            0.003,
            metal,
            segments=4,
            closed=True,
        )
    for x in np.linspace(-w / 2 + 0.03, w / 2 - 0.03, 7):
        kit.rod((x, 0.012, -d / 2), (x, 0.012, d / 2), 0.0025, metal, sides=4)
    for x, z in ((-w / 2, -d / 2), (w / 2, -d / 2), (w / 2, d / 2), (-w / 2, d / 2)):
        kit.rod((x, 0.0, z), (x, 0.09, z), 0.003, metal, sides=4)
    glaze = coloured(kit, "pot_white", GLAZES)
    r = 0.105
    for x in np.arange(-0.13, float(kit.rng.uniform(-0.05, 0.05)), 0.028):
        kit.lathe(
            [(0, 0), (0.6 * r, 0), (r, 0.012), (r, 0.016), (0.6 * r, 0.006), (0, 0.006)],
            glaze,
            centre=(x, 0.016 + r, 0.0),
            segments=16,
            rotate=rotation("z", -80),
        )
    for z in (-0.06, 0.05):
        vessel(kit, MUG, 0.038, 0.09, coloured(kit, "pot_white", GLAZES), at=(0.11, 0.016, z), segments=10)


def sponge(kit: Kit) -> None:
    """A sponge with a scouring side, sometimes on a dish."""
    y = 0.0
    if kit.rng.random() < 0.4:
        y = 0.008
        kit.panel((-0.065, 0.0, -0.045), (0.065, y, 0.045), coloured(kit, "pot_white", GLAZES), bevel=0.003)
    soft = kit.palette.tinted("plastic_white", kit.pick("#e0c94f", "#d88aa0", "#7fb3c8"))
    rough = kit.palette.tinted("plastic_white", "#3f6b4a")
    kit.panel((-0.05, y, -0.033), (0.05, y + 0.022, 0.033), soft, bevel=0.004)
    kit.panel((-0.05, y + 0.022, -0.033), (0.05, y + 0.029, 0.033), rough, bevel=0.002)


def dish_brush(kit: Kit) -> None:
    """Brushes standing in a cup."""
    vessel(kit, TUMBLER, 0.036, 0.1, coloured(kit, "pot_white", GLAZES))
    for side in (-1, 1)[: int(kit.rng.integers(1, 3))]:
        shaft = coloured(kit, "stem", WOODS)
        kit.rod((0.0, 0.015, 0.0), (side * 0.045, 0.2, 0.0), 0.005, shaft, sides=6)
        kit.cylinder(0.022, 0.03, (side * 0.048, 0.215, 0.0), coloured(kit, "plastic_white", PLASTICS), segments=9)


def soap_dispenser(kit: Kit) -> None:
    """A bottle with a pump."""
    r, h = kit.near(0.033, 0.12), kit.near(0.13, 0.15)
    body = coloured(kit, "glass", GLASSES) if kit.rng.random() < 0.4 else coloured(kit, "pot_white", GLAZES)
    vessel(kit, SQUAT_BOTTLE, r, h, body)
    if kit.rng.random() < 0.6:
        banded(kit, r * 1.015, 0.18 * h, 0.6 * h, segments=12)
    pump = kit.m(kit.pick("chrome", "plastic_black", "plastic_white"))
    kit.cylinder(0.4 * r, 0.014, (0, h + 0.003, 0), pump, segments=10)
    kit.rod((0, h, 0), (0, h + 0.04, 0), 0.004, pump, sides=6)
    kit.tube(
        [(0, h + 0.042, -0.008), (0, h + 0.043, 0.02), (0, h + 0.036, 0.036)], [0.006, 0.005, 0.0035], pump, segments=6
    )


def cloth(kit: Kit) -> None:
    """A folded tea towel."""
    folded(kit, (kit.near(0.17), 0.018, kit.near(0.13)), (0, 0, 0), kit.m(kit.pick("print_0", "print_1", "towel_2")))


def carton_box(kit: Kit) -> None:
    """A box of cereal, pasta, tea or rice."""
    w, h, d = float(kit.rng.uniform(0.07, 0.2)), float(kit.rng.uniform(0.1, 0.29)), float(kit.rng.uniform(0.045, 0.07))
    carton(kit, (-w / 2, 0, -d / 2), (w / 2, h, d / 2))


def drink_carton(kit: Kit) -> None:
    """A carton of milk or juice with a gable or a screw cap."""
    w, h = kit.near(0.07, 0.08), kit.near(0.2, 0.08)
    cell = label_cell(kit)
    carton(kit, (-w / 2, 0, -w / 2), (w / 2, h, w / 2), cell=cell)
    if kit.rng.random() < 0.6:
        ridge = np.array(
            [
                (-w / 2, h, w / 2),
                (w / 2, h, w / 2),
                (w / 2, h, -w / 2),
                (-w / 2, h, -w / 2),
                (-w / 2, h + 0.035, 0),
                (w / 2, h + 0.035, 0),
            ]
        )
        kit.add(ridge, np.array([[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4]]), kit.m("paper"))
    else:
        kit.cylinder(0.014, 0.014, (0.0, h + 0.007, 0.0), coloured(kit, "plastic_white", PLASTICS), segments=10)


def tin(kit: Kit) -> None:
    """A tin with a paper label; sometimes two, one on the other."""
    r, h = kit.near(0.038, 0.15), kit.near(0.1, 0.25)
    for k in range(2 if h < 0.1 and kit.rng.random() < 0.5 else 1):
        vessel(kit, CAN, r, h, kit.palette.tinted("chrome", "#b6b9bb"), at=(0, h * k, 0))
        banded(kit, r * 1.004, h * k + 0.07 * h, h * k + 0.93 * h)


def egg_box(kit: Kit) -> None:
    """A carton of eggs, open or closed."""
    grey = kit.palette.tinted("paper", kit.pick("#a7a49c", "#c2b49a"))
    kit.panel((-0.075, 0, -0.05), (0.075, 0.04, 0.05), grey, bevel=0.008)
    if kit.rng.random() < 0.5:
        shell = kit.palette.tinted("pot_white", kit.pick("#d9b48f", "#e9e2d4"))
        for x in (-0.048, 0.0, 0.048):
            for z in (-0.024, 0.024):
                kit.sphere((0.02, 0.026, 0.02), (x, 0.045, z), shell, rings=5, segments=8)
    else:
        kit.panel((-0.073, 0.04, -0.048), (0.073, 0.066, 0.048), grey, bevel=0.01)


def food_box(kit: Kit) -> None:
    """Plastic boxes with lids, one on the other."""
    y = 0.0
    lids = coloured(kit, "plastic_white", PLASTICS)
    for k in range(int(kit.rng.integers(1, 4))):
        w, d, h = kit.near(0.18 - 0.02 * k, 0.05), kit.near(0.13 - 0.015 * k, 0.05), kit.near(0.06, 0.2)
        kit.panel(
            (-w / 2, y, -d / 2), (w / 2, y + h, d / 2), kit.palette.tinted("plastic_white", "#dfe3e2"), bevel=0.01
        )
        kit.panel(
            (-w / 2 - 0.004, y + h, -d / 2 - 0.004), (w / 2 + 0.004, y + h + 0.01, d / 2 + 0.004), lids, bevel=0.004
        )
        y += h + 0.01


def spice_rack(kit: Kit) -> None:
    """A small shelf with spice jars."""
    kit.mount = "wall"
    w = kit.near(0.36, 0.15)
    board = coloured(kit, "stem", WOODS) if kit.rng.random() < 0.6 else kit.m("metal")
    kit.panel((-w / 2, 0, 0), (w / 2, 0.01, 0.062), board, bevel=0.001)
    kit.panel((-w / 2, 0.03, 0.058), (w / 2, 0.042, 0.062), board, bevel=0.0)
    for side in (-1, 1):
        x0, x1 = sorted((side * w / 2, side * (w / 2 - 0.008)))
        kit.panel((x0, 0.0, 0.0), (x1, 0.07, 0.062), board, bevel=0.0)
    for x in np.arange(-w / 2 + 0.035, w / 2 - 0.03, 0.048):
        spice = kit.palette.tinted("glass", kit.pick("#8a4a24", "#7d7a3c", "#b58a3a", "#4a3a30", "#c9b79c"))
        kit.cylinder(0.02, 0.07, (float(x), 0.045, 0.031), spice, segments=9)
        lid(kit, 0.0205, 0.08, 0.098, kit.m("plastic_black"), (float(x), 0.0, 0.031))


def utensil_rail(kit: Kit) -> None:
    """A rail with ladles, a turner and a sieve."""
    kit.mount = "wall"
    metal = kit.m(kit.pick("chrome", "black_metal"))
    w = kit.near(0.42, 0.2)
    kit.rod((-w / 2, 0.0, 0.03), (w / 2, 0.0, 0.03), 0.006, metal, sides=7)
    for side in (-1, 1):
        kit.rod((side * (w / 2 - 0.03), 0, 0), (side * (w / 2 - 0.03), 0, 0.03), 0.007, metal, sides=6)
    tool = kit.m("steel") if kit.rng.random() < 0.6 else coloured(kit, "stem", WOODS)
    for x in np.linspace(-w / 2 + 0.06, w / 2 - 0.06, int(kit.rng.integers(3, 6))):
        low = -float(kit.rng.uniform(0.16, 0.25))
        kit.rod((x, 0.006, 0.04), (x, low, 0.03), 0.004, tool, sides=5)
        if kit.rng.random() < 0.5:
            kit.sphere((0.032, 0.034, 0.014), (x, low - 0.03, 0.03), tool, rings=5, segments=9)
        else:
            kit.panel((x - 0.03, low - 0.075, 0.026), (x + 0.03, low, 0.03), tool, bevel=0.001)


def oven_glove(kit: Kit) -> None:
    """An oven glove on a hook."""
    kit.mount = "wall"
    kit.panel((-0.012, -0.02, 0.0), (0.012, 0.02, 0.006), kit.m("metal"), bevel=0.002)
    kit.rod((0, 0.0, 0.006), (0, 0.006, 0.034), 0.004, kit.m("metal"), sides=6)
    padded = kit.m(kit.pick("print_0", "print_1", "print_2", "cushion_1"))
    kit.soft((0.15, 0.26, 0.028), (0, -0.15, 0.026), padded, radius=0.014, puff=(0.012, 0.02, 0.004), cells=4)
    kit.soft((0.06, 0.1, 0.024), (0.085, -0.13, 0.026), padded, radius=0.012, cells=2, rotate=rotation("z", -35))


def tea_towel(kit: Kit) -> None:
    """A tea towel that hangs from a hook."""
    kit.mount = "wall"
    kit.panel((-0.012, -0.016, 0.0), (0.012, 0.016, 0.006), kit.m("metal"), bevel=0.002)
    kit.rod((0, 0.0, 0.006), (0, 0.006, 0.03), 0.004, kit.m("metal"), sides=6)
    hanging(
        kit,
        kit.near(0.26, 0.1),
        0.004,
        kit.near(0.42, 0.15),
        0.022,
        kit.m(kit.pick("print_0", "print_1", "print_2", "towel_0")),
        pinch=0.2,
    )


def calendar(kit: Kit) -> None:
    """A calendar or planner: a picture over a sheet of days."""
    kit.mount = "wall"
    w, h = kit.near(0.22, 0.15), kit.near(0.34, 0.1)
    kit.panel((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.0035), kit.m("paper"), bevel=0.0)
    for y0, y1, paper in ((-h / 2 + 0.006, -0.01, True), (0.0, h / 2 - 0.012, False)):
        x = w / 2 - 0.006
        sheet(kit, [(-x, y0, 0.0039), (x, y0, 0.0039), (x, y1, 0.0039), (-x, y1, 0.0039)], paper=paper)


def magnet(kit: Kit) -> None:
    """A magnet: a coloured disc or a small picture."""
    kit.mount = "wall"
    if kit.rng.random() < 0.5:
        kit.cylinder(
            kit.near(0.016, 0.2), 0.007, (0, 0, 0.0035), coloured(kit, "plastic_white", PLASTICS), axis="z", segments=12
        )
    else:
        w, h = kit.near(0.05, 0.3), kit.near(0.045, 0.3)
        kit.panel((-w / 2, -h / 2, 0), (w / 2, h / 2, 0.003), kit.m("plastic_black"), bevel=0.0)
        sheet(
            kit,
            [(-w / 2, -h / 2, 0.0034), (w / 2, -h / 2, 0.0034), (w / 2, h / 2, 0.0034), (-w / 2, h / 2, 0.0034)],
            paper=False,
        )


def note(kit: Kit) -> None:
    """A note or drawing under a magnet."""
    kit.mount = "wall"
    w, h = kit.near(0.11, 0.35), kit.near(0.15, 0.3)
    bow = 0.004 + 0.003 * float(kit.rng.random())
    kit.panel((-w / 2, -h / 2, 0.0), (w / 2, h / 2, 0.0006), kit.m("paper"), bevel=0.0)
    sheet(kit, [(-w / 2, -h / 2, bow), (w / 2, -h / 2, bow), (w / 2, h / 2, 0.001), (-w / 2, h / 2, 0.001)])
    kit.cylinder(
        0.011,
        0.006,
        (float(kit.rng.uniform(-0.2, 0.2)) * w, 0.42 * h, 0.004),
        coloured(kit, "plastic_white", PLASTICS),
        axis="z",
        segments=10,
    )


def frying_pan(kit: Kit) -> None:
    """A pan with a long handle."""
    metal = kit.palette.tinted("black_metal", kit.pick("#3a3a3b", "#2c2d30", "#4a4c4f"))
    r = kit.near(0.12, 0.12)
    kit.lathe([(0, 0), (0.8 * r, 0), (r, 0.042), (0.97 * r, 0.042), (0.78 * r, 0.005), (0, 0.005)], metal, segments=20)
    side = float(kit.rng.choice([-1, 1]))
    end = (side * 0.7 * (r + 0.17), 0.075, 0.7 * (r + 0.17))
    kit.tube(
        [(side * 0.67 * r, 0.034, 0.67 * r), (side * 0.8 * r, 0.05, 0.8 * r), end],
        [0.008, 0.009, 0.011],
        kit.m("plastic_black"),
        segments=7,
    )


def saucepan(kit: Kit) -> None:
    """A pot with two grips, with or without its lid."""
    r, h = kit.near(0.095, 0.15), kit.near(0.11, 0.25)
    metal = (
        kit.m("steel")
        if kit.rng.random() < 0.5
        else coloured(kit, "enamel", ("#a63c32", "#e6e6e3", "#3d5a80", "#3a3a3b"))
    )
    vessel(kit, POT, r, h, metal, segments=20)
    for side in (-1, 1):
        kit.tube(
            [
                (side * 0.98 * r, 0.75 * h, -0.03),
                (side * (r + 0.03), 0.8 * h, -0.02),
                (side * (r + 0.03), 0.8 * h, 0.02),
                (side * 0.98 * r, 0.75 * h, 0.03),
            ],
            0.005,
            kit.m("plastic_black"),
            segments=5,
        )
    if kit.rng.random() < 0.6:
        kit.lathe([(r * 1.02, h), (0.6 * r, h + 0.014), (0, h + 0.018)], metal, segments=20)
        kit.sphere((0.016, 0.012, 0.016), (0, h + 0.028, 0), kit.m("plastic_black"), rings=4, segments=8)


def herb(kit: Kit) -> None:
    """A pot of herbs."""
    small_plant(kit, (0, 0, 0), kit.near(0.2, 0.2))


def basket(kit: Kit) -> None:
    """A basket of wicker, empty or with boxes and cloths."""
    w, d, h = kit.near(0.28, 0.15), kit.near(0.2, 0.1), kit.near(0.15, 0.2)
    wicker = kit.m("wicker")
    for lo, hi in (
        ((-w / 2, 0, -d / 2), (w / 2, 0.01, d / 2)),
        ((-w / 2, 0, d / 2 - 0.012), (w / 2, h, d / 2)),
        ((-w / 2, 0, -d / 2), (w / 2, h, -d / 2 + 0.012)),
        ((-w / 2, 0, -d / 2 + 0.012), (-w / 2 + 0.012, h, d / 2 - 0.012)),
        ((w / 2 - 0.012, 0, -d / 2 + 0.012), (w / 2, h, d / 2 - 0.012)),
    ):
        kit.panel(lo, hi, wicker, bevel=0.0)
    kit.tube(
        [(-w / 2, h, -d / 2), (w / 2, h, -d / 2), (w / 2, h, d / 2), (-w / 2, h, d / 2)],
        0.009,
        wicker,
        segments=5,
        closed=True,
    )
    if kit.rng.random() < 0.7:
        folded(kit, (0.8 * w, 0.5 * h, 0.75 * d), (0, 0.55 * h, 0), kit.m(kit.pick("throw", "towel_0", "print_1")))
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2), wicker)


def storage_box(kit: Kit) -> None:
    """A plain or printed box with a lid."""
    w, d, h = kit.near(0.3, 0.2), kit.near(0.22, 0.15), kit.near(0.16, 0.25)
    if kit.rng.random() < 0.5:
        carton(kit, (-w / 2, 0, -d / 2), (w / 2, h, d / 2))
    else:
        body = coloured(kit, "paper", CLOTHS)
        kit.panel((-w / 2, 0, -d / 2), (w / 2, h, d / 2), body, bevel=0.003)
        kit.panel(
            (-w / 2 - 0.004, h - 0.035, -d / 2 - 0.004), (w / 2 + 0.004, h + 0.004, d / 2 + 0.004), body, bevel=0.003
        )
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2), kit.m("paper"))


def crate(kit: Kit) -> None:
    """A crate of bottles on the floor."""
    body = coloured(kit, "plastic_white", ("#a63c32", "#3f6b4a", "#3d5a80", "#56423a"))
    w, d, h = 0.36, 0.27, 0.2
    kit.panel((-w / 2, 0, -d / 2), (w / 2, 0.02, d / 2), body, bevel=0.0)
    for z in (-d / 2, d / 2 - 0.012):
        kit.panel((-w / 2, 0.02, z), (w / 2, h, z + 0.012), body, bevel=0.003)
    for x in (-w / 2, w / 2 - 0.012):
        kit.panel((x, 0.02, -d / 2 + 0.012), (x + 0.012, h, d / 2 - 0.012), body, bevel=0.003)
    glass = coloured(kit, "glass", GLASSES)
    for x in (-0.11, 0.0, 0.11):
        for z in (-0.07, 0.06):
            if kit.rng.random() < 0.75:
                vessel(kit, BOTTLE, 0.038, 0.29, glass, at=(x, 0.021, z), segments=8)
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2), body)


def paper_bag(kit: Kit) -> None:
    """A paper bag for shopping or waste paper."""
    w, d, h = kit.near(0.28, 0.1), kit.near(0.15, 0.1), kit.near(0.34, 0.15)
    brown = kit.palette.tinted("paper", kit.pick("#b08a5a", "#c6a880", "#e2dccb"))
    low = np.array([(-w / 2, 0, d / 2), (w / 2, 0, d / 2), (w / 2, 0, -d / 2), (-w / 2, 0, -d / 2)])
    flare = np.array([1.02, 1.0, float(kit.rng.uniform(0.7, 1.0))])
    top = low * flare + (0, h, 0)
    inner = top * (0.97, 1.0, 0.95)
    kit.loft([low, top, inner, low * (0.95, 1.0, 0.9) + (0, 0.6 * h, 0)], brown, crease=20.0)
    if kit.rng.random() < 0.6:
        carton(kit, (-0.06, 0.6 * h, -0.03), (0.05, h + 0.04, 0.03))
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2), brown)


def broom(kit: Kit) -> None:
    """A broom that leans at the wall."""
    stick = coloured(kit, "stem", (*WOODS, "#a63c32", "#3d5a80"))
    kit.rod((0, 0.07, 0.1), (0, 1.28, -0.02), 0.011, stick, sides=8)
    kit.panel((-0.14, 0.05, 0.07), (0.14, 0.085, 0.13), coloured(kit, "stem", WOODS), bevel=0.006)
    kit.panel((-0.135, 0.0, 0.072), (0.135, 0.05, 0.128), kit.palette.tinted("paper", "#8d7446"), bevel=0.0)


def bread_bag(kit: Kit) -> None:
    """A bag of crisps, flour or rice: a stuffed pillow that stands."""
    w, h, d = kit.near(0.13, 0.2), kit.near(0.2, 0.2), kit.near(0.06, 0.2)
    code = kit.pick("#d9a441", "#a63c32", "#2f5d50", "#e8e3d6", "#3d5a80")
    kit.soft(
        (w, h, d), (0, h / 2, 0), kit.palette.tinted("plastic_white", code), radius=0.02, puff=(0, 0, 0.012), cells=3
    )
    x, y = 0.36 * w, 0.7 * h
    z = d / 2 + 0.0125
    sheet(kit, [(-x, 0.3 * h, z), (x, 0.3 * h, z), (x, y, z), (-x, y, z)], paper=False)


OIL = Turned(
    BOTTLE, (0.03, 0.038), (0.22, 0.3), "glass", GLASSES, label=(0.1, 0.5), cap=(0.36, 0.006), cap_role="plastic_black"
)
SAUCE = Turned(
    SQUAT_BOTTLE, (0.028, 0.036), (0.14, 0.2), "plastic_white", PLASTICS, label=(0.12, 0.66), cap=(0.5, 0.03)
)
CLEANER = Turned(
    SQUAT_BOTTLE,
    (0.04, 0.048),
    (0.2, 0.26),
    "plastic_white",
    PLASTICS,
    label=(0.15, 0.65),
    cap=(0.5, 0.035),
    squash=0.62,
)
PRESERVE = Turned(
    JAR,
    (0.033, 0.045),
    (0.08, 0.13),
    "glass",
    ("#8a3a2a", "#b5702a", "#7a7a3a", "#c9d6cf"),
    label=(0.2, 0.65),
    cap=(0.95, 0.012),
    cap_role="plastic_white",
    cap_codes=("#b6b9bb", "#a63c32", "#e6e4df"),
)
CANISTER = Turned(
    JAR, (0.045, 0.062), (0.13, 0.22), "pot_white", GLAZES, cap=(0.97, 0.02), cap_role="stem", cap_codes=WOODS
)
MILL = Turned(
    ((0, 0), (1, 0), (1, 0.08), (0.62, 0.35), (0.95, 0.62), (0.9, 0.72), (0.5, 0.76), (0.85, 0.88), (0, 1)),
    (0.024, 0.03),
    (0.12, 0.24),
    "stem",
    (*WOODS, "#3a3a3b", "#e6e4df"),
)
GLASS = Turned(TUMBLER, (0.032, 0.042), (0.09, 0.14), "glass", GLASSES[:1])

KINDS = (
    ClutterKind("spice_rack", spice_rack, ("worktop_wall",), {"kitchen": (1, 1)}, height=(1.14, 1.32)),
    ClutterKind("utensil_rail", utensil_rail, ("worktop_wall",), {"kitchen": (1, 1)}, height=(1.15, 1.28)),
    ClutterKind("oven_glove", oven_glove, ("worktop_wall", "wall"), {"kitchen": (1, 1)}, height=(1.18, 1.25)),
    ClutterKind("frying_pan", frying_pan, ("hob",), {"kitchen": (0, 1)}, turn=20),
    ClutterKind("saucepan", saucepan, ("hob", "cabinet_top"), {"kitchen": (1, 3)}, turn=30),
    ClutterKind("dish_rack", dish_rack, ("worktop",), {"kitchen": (0, 1)}, turn=4),
    ClutterKind("chopping_boards", chopping_boards, ("worktop",), {"kitchen": (1, 1)}, turn=2, rear=True),
    ClutterKind("knife_block", knife_block, ("worktop",), {"kitchen": (0, 1)}, rear=True),
    ClutterKind("tea_towel_folded", cloth, ("worktop", "table"), {"kitchen": (1, 1)}, turn=20),
    ClutterKind("kitchen_roll", kitchen_roll, ("worktop", "cabinet_top"), {"kitchen": (1, 1)}, turn=90, rear=True),
    ClutterKind("bread", bread, ("worktop", "table"), {"kitchen": (0, 1)}, turn=25),
    ClutterKind("fruit", fruit, ("table", "worktop"), {"kitchen": (0, 1)}, turn=90),
    ClutterKind("basket", basket, ("cabinet_top", "board"), {"kitchen": (1, 3), "bathroom": (0, 2), "hall": (1, 1)}),
    ClutterKind("storage_box", storage_box, ("cabinet_top",), {"kitchen": (1, 2), "bathroom": (0, 1), "hall": (1, 1)}),
    ClutterKind("cutlery", cutlery, ("worktop", "board"), {"kitchen": (1, 2)}, turn=90, rear=True),
    ClutterKind("soap_dispenser", soap_dispenser, ("worktop", "basin"), {"kitchen": (1, 2)}, turn=40, rear=True),
    ClutterKind("dish_brush", dish_brush, ("worktop",), {"kitchen": (1, 1)}, turn=90, rear=True),
    ClutterKind("sponge", sponge, ("worktop",), {"kitchen": (1, 2)}, turn=60),
    ClutterKind("washing_up", CLEANER, ("worktop",), {"kitchen": (1, 1)}, turn=40, rear=True),
    ClutterKind("herb", herb, ("sill", "worktop"), {"kitchen": (1, 3)}, turn=180),
    ClutterKind("oil", OIL, ("worktop", "board"), {"kitchen": (1, 3)}, turn=180, rear=True),
    ClutterKind("canister", CANISTER, ("worktop", "board", "sill"), {"kitchen": (2, 4)}, turn=180, rear=True),
    ClutterKind("mill", MILL, ("table", "worktop"), {"kitchen": (1, 2)}, turn=180),
    ClutterKind("sauce", SAUCE, ("worktop", "board", "table"), {"kitchen": (1, 3)}, turn=60, rear=True),
    ClutterKind("carton_box", carton_box, ("worktop", "cabinet_top", "board"), {"kitchen": (2, 4)}, turn=25, rear=True),
    ClutterKind("drink_carton", drink_carton, ("worktop", "table"), {"kitchen": (1, 2)}, turn=40),
    ClutterKind("food_bag", bread_bag, ("worktop", "cabinet_top"), {"kitchen": (0, 2)}, turn=30, rear=True),
    ClutterKind("egg_box", egg_box, ("worktop", "cabinet_top"), {"kitchen": (0, 1)}, turn=30),
    ClutterKind("food_box", food_box, ("worktop", "cabinet_top", "board"), {"kitchen": (1, 2)}, turn=15),
    ClutterKind("plates", plates, ("board", "worktop", "table"), {"kitchen": (1, 3)}, turn=90),
    ClutterKind("bowls", bowls, ("board", "worktop", "table"), {"kitchen": (1, 3)}, turn=90),
    ClutterKind("mug", mug, ("board", "worktop", "table"), {"kitchen": (3, 6)}, turn=180),
    ClutterKind("drinking_glass", GLASS, ("board", "worktop", "table"), {"kitchen": (2, 4)}, turn=180),
    ClutterKind("tin", tin, ("board", "worktop", "cabinet_top"), {"kitchen": (2, 4)}, turn=180),
    ClutterKind("preserve", PRESERVE, ("board", "worktop", "sill"), {"kitchen": (2, 4)}, turn=180),
    ClutterKind("tea_towel", tea_towel, ("wall",), {"kitchen": (1, 2)}, height=(1.0, 1.15)),
    ClutterKind("note", note, ("fridge",), {"kitchen": (2, 4)}, height=(1.1, 1.6)),
    ClutterKind("magnet", magnet, ("fridge",), {"kitchen": (4, 7)}, height=(1.05, 1.7)),
    ClutterKind("calendar", calendar, ("wall",), {"kitchen": (1, 1), "hall": (1, 1)}, height=(1.35, 1.6)),
    ClutterKind("crate", crate, ("floor",), {"kitchen": (0, 1)}, turn=3),
    ClutterKind("paper_bag", paper_bag, ("floor",), {"kitchen": (1, 1), "hall": (1, 1)}, turn=15),
    ClutterKind("broom", broom, ("floor",), {"kitchen": (0, 1), "hall": (0, 1)}, turn=4, rear=True),
)  # fmt: skip
