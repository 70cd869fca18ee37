"""Small things of bathrooms: what one washes with, towels, paper, laundry and its detergents."""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.forms import (
    CAN,
    CLOTHS,
    GLASSES,
    GLAZES,
    JAR,
    PLASTICS,
    SQUAT_BOTTLE,
    TUMBLER,
    WOODS,
    Turned,
    banded,
    carton,
    coloured,
    folded,
    hanging,
    lid,
    vessel,
)
from generators.assets.clutter.kitchen import soap_dispenser
from generators.assets.clutter.record import ClutterKind
from generators.assets.furniture.common import Kit
from generators.assets.materials import TOWELS
from generators.assets.shapes import rotation
from generators.core.scene import Material


def _towel(kit: Kit) -> Material:
    return kit.m(f"towel_{int(kit.rng.integers(TOWELS))}")


def toothbrushes(kit: Kit) -> None:
    """A cup with toothbrushes and a tube."""
    vessel(kit, TUMBLER, kit.near(0.036, 0.1), 0.1, coloured(kit, "pot_white", GLAZES))
    for side in (-1, 1, 0)[: int(kit.rng.integers(1, 4))]:
        colour = coloured(kit, "plastic_white", PLASTICS)
        top = np.array([0.042 * side, 0.185, 0.012 if side else -0.03])
        kit.rod((-0.012 * side, 0.014, 0.0), top, 0.0042, colour, sides=5)
        kit.box((0.011, 0.026, 0.014), top + (0.0, 0.004, 0.006), kit.m("plastic_white"), acoustic=False)


def toothpaste(kit: Kit) -> None:
    """A tube that lies, its cap to one side."""
    colour = coloured(kit, "plastic_white", PLASTICS)
    loops = []
    for x, thick, wide in ((-0.075, 0.002, 0.026), (-0.04, 0.009, 0.022), (0.04, 0.015, 0.018), (0.055, 0.012, 0.013)):
        a = np.linspace(0, 2 * np.pi, 10, endpoint=False)
        loops.append(np.stack([np.full(10, x), 0.0155 + thick * np.sin(a), wide * np.cos(a)], axis=1))
    kit.loft(loops, colour, crease=60.0)
    kit.cylinder(0.012, 0.022, (0.066, 0.0155, 0.0), kit.m("plastic_white"), axis="x", segments=10)


def soap_dish(kit: Kit) -> None:
    """A bar of soap on a dish."""
    kit.slab(
        (0.12, 0.085, 0.016),
        (0, 0.008, 0),
        coloured(kit, "pot_white", (*GLAZES, *WOODS)),
        corner=0.03,
        steps=3,
        rotate=rotation("x", -90),
    )
    soap = kit.palette.tinted("pot_white", kit.pick("#e8dfc8", "#c9d8c0", "#d9b8b0", "#b8a37c"))
    kit.soft((0.075, 0.026, 0.05), (0, 0.028, 0), soap, radius=0.012, cells=3)


def tissue_box(kit: Kit) -> None:
    """A box of tissues, one of which stands out."""
    w, h = kit.near(0.21, 0.15), kit.near(0.075, 0.2)
    carton(kit, (-w / 2, 0, -0.06), (w / 2, h, 0.06))
    kit.pillow((0.08, 0.07, 0.03), (0, h + 0.02, 0), kit.m("paper"), cells=3, rotate=rotation("y", 20))


def cotton_jar(kit: Kit) -> None:
    """A glass jar with a lid."""
    r, h = kit.near(0.045, 0.12), kit.near(0.09, 0.15)
    vessel(kit, JAR, r, h, kit.palette.tinted("glass", "#dfe3e2"))
    lid(kit, 0.92 * r, 0.95 * h, h + 0.008, kit.m("chrome") if kit.rng.random() < 0.5 else coloured(kit, "stem", WOODS))
    kit.sphere(0.011, (0, h + 0.016, 0), kit.m("chrome"), rings=4, segments=8)


def hair_brush(kit: Kit) -> None:
    """A brush that lies on its back."""
    body = coloured(kit, "stem", (*WOODS, "#3a3a3b", "#b58fb0"))
    kit.soft((0.05, 0.018, 0.1), (0, 0.009, 0.06), body, radius=0.009, cells=2)
    kit.panel((-0.019, 0.018, 0.02), (0.019, 0.034, 0.1), kit.m("plastic_black"), bevel=0.006)
    kit.rod((0, 0.0105, 0.012), (0, 0.0105, -0.11), 0.01, body, sides=7)


def toilet_rolls(kit: Kit) -> None:
    """Spare rolls of paper, standing on one another or in a row."""
    paper = kit.palette.tinted("paper", "#e9e7e1")
    for k in range(int(kit.rng.integers(2, 5))):
        column, row = divmod(k, 2)
        kit.lathe(
            [(0.02, 0.0), (0.054, 0.0), (0.055, 0.004), (0.055, 0.096), (0.054, 0.1), (0.02, 0.1), (0.02, 0.06)],
            paper,
            centre=(0.112 * column, 0.1 * row, 0.0),
            segments=14,
        )


def roll_holder(kit: Kit) -> None:
    """A holder with a roll, an end of the paper hanging down."""
    kit.mount = "wall"
    metal = kit.m(kit.pick("chrome", "metal", "black_metal"))
    kit.cylinder(0.024, 0.008, (-0.075, 0.0, 0.004), metal, axis="z", segments=12)
    kit.tube([(-0.075, 0, 0.006), (-0.075, 0, 0.06), (-0.068, 0, 0.066), (0.06, 0, 0.066)], 0.006, metal, segments=6)
    paper = kit.palette.tinted("paper", "#e9e7e1")
    r = float(kit.rng.uniform(0.035, 0.055))
    kit.lathe(
        [(0.018, -0.05), (r, -0.05), (r, 0.05), (0.018, 0.05)],
        paper,
        centre=(0, -0.01, 0.066),
        segments=14,
        rotate=rotation("z", -90),
    )
    drop = float(kit.rng.uniform(0.05, 0.11))
    z = 0.066 + r
    kit.panel((-0.05, -0.01 - drop, z - 0.0015), (0.05, -0.01, z + 0.0003), paper, bevel=0.0)


def towel_pile(kit: Kit) -> None:
    """Folded towels, one on the other."""
    y, w, d = 0.0, kit.near(0.3, 0.12), kit.near(0.22, 0.1)
    for _ in range(int(kit.rng.integers(2, 5))):
        h = kit.near(0.05, 0.2)
        folded(
            kit, (kit.near(w, 0.04), h, kit.near(d, 0.04)), (float(kit.rng.uniform(-0.006, 0.006)), y, 0), _towel(kit)
        )
        y += 0.97 * h
    kit.sound((-w / 2, 0, -d / 2), (w / 2, y, d / 2), kit.m("towel_0"))


def face_cloths(kit: Kit) -> None:
    """Rolled or folded small towels."""
    cloth = _towel(kit)
    if kit.rng.random() < 0.5:
        folded(kit, (0.16, 0.028, 0.12), (0, 0, 0), cloth)
        folded(kit, (0.155, 0.026, 0.115), (0.003, 0.027, 0), _towel(kit))
        return
    for k in range(3):
        x, y = ((-0.04, 0.035), (0.04, 0.035), (0.0, 0.098))[k]
        kit.cylinder(0.036, 0.2, (x, y, 0), cloth, axis="z", segments=11)


def towel_hook(kit: Kit) -> None:
    """A towel on a hook."""
    kit.mount = "wall"
    metal = kit.m(kit.pick("chrome", "metal", "black_metal"))
    kit.panel((-0.014, -0.022, 0.0), (0.014, 0.022, 0.006), metal, bevel=0.002)
    kit.tube([(0, 0, 0.006), (0, -0.004, 0.036), (0, 0.02, 0.044)], 0.005, metal, segments=6)
    w, drop = kit.near(0.3, 0.15), kit.near(0.62, 0.2)
    cloth = _towel(kit)
    hanging(kit, w, 0.004, drop, 0.026, cloth, pinch=0.16)
    kit.sound((-w / 2, 0.004 - drop, 0.02), (w / 2, -0.06, 0.04), cloth)


def towel_ring(kit: Kit) -> None:
    """A hand towel drawn through a ring beside the basin."""
    kit.mount = "wall"
    metal = kit.m(kit.pick("chrome", "metal"))
    kit.cylinder(0.022, 0.01, (0, 0, 0.005), metal, axis="z", segments=12)
    kit.rod((0, 0, 0.01), (0, 0, 0.04), 0.006, metal, sides=6)
    kit.torus(0.075, 0.005, (0, -0.075, 0.04), metal, axis="z", segments=18, minor_segments=5)
    hanging(kit, kit.near(0.2, 0.1), -0.14, kit.near(0.34, 0.1), 0.03, _towel(kit), pinch=0.6)


def bathrobe(kit: Kit) -> None:
    """A bathrobe on a hook."""
    kit.mount = "wall"
    cloth = _towel(kit)
    kit.tube([(0, 0, 0), (0, -0.004, 0.05), (0, 0.02, 0.06)], 0.005, kit.m("chrome"), segments=6)
    hanging(kit, kit.near(0.44, 0.08), 0.0, kit.near(1.0, 0.06), 0.04, cloth, pinch=0.2)
    for side in (-1, 1):
        kit.soft(
            (0.11, 0.5, 0.05), (side * 0.15, -0.42, 0.06), cloth, radius=0.025, cells=2, rotate=rotation("z", side * 5)
        )
    kit.sound((-0.2, -1.0, 0.02), (0.2, -0.1, 0.08), cloth)


def shower_caddy(kit: Kit) -> None:
    """A wire basket on the wall with bottles."""
    kit.mount = "wall"
    metal = kit.m(kit.pick("chrome", "black_metal", "plastic_white"))
    w, d = kit.near(0.27, 0.15), 0.11
    for y in (0.0, 0.055):
        kit.tube(
            [(-w / 2, y, 0.004), (w / 2, y, 0.004), (w / 2, y, d), (-w / 2, y, d)],
            0.003,
            metal,
            segments=4,
            closed=True,
        )
    for x in np.linspace(-w / 2, w / 2, 8):
        kit.rod((x, 0.0, 0.004), (x, 0.0, d), 0.002, metal, sides=4)
    for x in np.arange(-w / 2 + 0.045, w / 2 - 0.035, 0.075):
        h = float(kit.rng.uniform(0.12, 0.2))
        vessel(kit, SQUAT_BOTTLE, 0.029, h, coloured(kit, "plastic_white", PLASTICS), at=(x, 0.003, d / 2), segments=10)
        lid(kit, 0.018, 0.97 * h, h + 0.02, coloured(kit, "plastic_white", PLASTICS), (x, 0.003, d / 2))


def bath_sponge(kit: Kit) -> None:
    """A round sponge."""
    r = kit.near(0.05, 0.15)
    kit.sphere((1.15 * r, 0.85 * r, r), (0, 0.85 * r, 0), kit.m("bath_mat"), rings=7, segments=10)


def toy_boat(kit: Kit) -> None:
    """A bath toy: a little boat."""
    hull = coloured(kit, "plastic_white", ("#c65d4a", "#3f7fa3", "#e0b94f"))
    low, high = 0.6, 1.0
    loops = [
        [(x * s, y, z * s) for x, z in ((-0.06, -0.03), (0.04, -0.03), (0.075, 0.0), (0.04, 0.03), (-0.06, 0.03))]
        for s, y in ((low, 0.0), (high, 0.03))
    ]
    kit.loft(loops, hull, crease=20.0)
    kit.panel((-0.04, 0.03, -0.018), (0.01, 0.052, 0.018), kit.m("plastic_white"), bevel=0.003)
    kit.cylinder(0.008, 0.03, (-0.02, 0.066, 0.0), coloured(kit, "plastic_white", PLASTICS), segments=8)


def cleaning_bucket(kit: Kit) -> None:
    """A bucket with a cloth over its rim and a bottle in it."""
    plastic = coloured(kit, "plastic_white", PLASTICS)
    r, h = kit.near(0.14, 0.08), kit.near(0.26, 0.1)
    kit.lathe([(0, 0), (0.75 * r, 0), (r, h), (0.96 * r, h), (0.72 * r, 0.012), (0, 0.01)], plastic, segments=18)
    t = np.linspace(0.15, np.pi - 0.15, 9)
    kit.tube(
        np.stack([r * np.cos(t), h - 0.02 + 0.09 * np.sin(t), 0.1 * np.sin(t)], axis=1),
        0.003,
        kit.m("metal"),
        segments=4,
    )
    vessel(kit, SQUAT_BOTTLE, 0.04, 0.24, coloured(kit, "plastic_white", PLASTICS), at=(0.03, 0.02, -0.03), segments=10)
    kit.panel((-0.09, h - 0.1, 0.9 * r), (0.03, h + 0.008, 0.9 * r + 0.012), kit.m("print_1"), bevel=0.003)
    kit.sound((-r, 0, -r), (r, h, r), plastic)


def scales(kit: Kit) -> None:
    """Flat bathroom scales."""
    glass = kit.palette.tinted("glass", kit.pick("#3a3d40", "#cfd6d6", "#8aa0a8"))
    kit.slab((0.3, 0.3, 0.012), (0, 0.018, 0), glass, corner=0.03, bevel=0.003, steps=3, rotate=rotation("x", -90))
    for x in (-0.12, 0.12):
        for z in (-0.12, 0.12):
            kit.cylinder(0.015, 0.012, (x, 0.006, z), kit.m("plastic_black"), segments=8)
    kit.panel((-0.035, 0.0242, -0.13), (0.035, 0.025, -0.095), kit.m("plastic_black"), bevel=0.0)


def detergent(kit: Kit) -> None:
    """A can of detergent with a handle, or a box of powder."""
    if kit.rng.random() < 0.4:
        w, h, d = kit.near(0.2, 0.1), kit.near(0.26, 0.15), kit.near(0.1, 0.1)
        carton(kit, (-w / 2, 0, -d / 2), (w / 2, h, d / 2))
        return
    plastic = coloured(kit, "plastic_white", PLASTICS)
    w, h, d = kit.near(0.17, 0.12), kit.near(0.24, 0.12), 0.09
    kit.soft((w, h, d), (0, h / 2, 0), plastic, radius=0.022, cells=3)
    kit.tube(
        [(-0.02, h - 0.01, 0), (-0.02, h + 0.035, 0), (0.05, h + 0.035, 0), (0.06, h - 0.01, 0)],
        0.011,
        plastic,
        segments=6,
    )
    kit.cylinder(0.024, 0.045, (-0.05, h + 0.02, 0), coloured(kit, "plastic_white", PLASTICS), segments=12)
    carton(kit, (-0.32 * w, 0.2 * h, -d / 2 - 0.001), (0.32 * w, 0.7 * h, d / 2 + 0.001))


def peg_basket(kit: Kit) -> None:
    """A small tub of clothes pegs."""
    r = kit.near(0.08, 0.1)
    vessel(kit, TUMBLER, r, 0.11, coloured(kit, "plastic_white", PLASTICS))
    for k in range(7):
        a = 2.4 * k
        at = (0.5 * r * np.cos(a), 0.1, 0.5 * r * np.sin(a))
        kit.box(
            (0.012, 0.07, 0.01),
            at,
            coloured(kit, "stem", (*WOODS, "#c65d4a", "#3f7fa3")),
            rotate=rotation("z", 50 * np.sin(3 * a)),
            acoustic=False,
        )


def laundry(kit: Kit) -> None:
    """A shallow tub of laundry on the floor."""
    plastic = coloured(kit, "plastic_white", PLASTICS)
    w, d, h = kit.near(0.52, 0.08), kit.near(0.36, 0.08), 0.22
    low = np.array([(-w / 2, 0, d / 2), (w / 2, 0, d / 2), (w / 2, 0, -d / 2), (-w / 2, 0, -d / 2)])
    out = low * (0.86, 1, 0.86)
    kit.loft(
        [out, low + (0, h, 0), low * (0.95, 1, 0.94) + (0, h, 0), out * (0.97, 1, 0.97) + (0, 0.02, 0)],
        plastic,
        crease=20.0,
    )
    for k in range(4):
        size = (kit.near(0.24, 0.2), 0.13, kit.near(0.2, 0.2))
        at = (0.11 * (-1) ** k, 0.13 + 0.035 * k, 0.06 * (1 - k % 3))
        kit.soft(
            size,
            at,
            coloured(kit, "sheet", CLOTHS) if k % 2 else _towel(kit),
            radius=0.06,
            puff=(0.02, 0.02, 0.02),
            cells=3,
            rotate=rotation("y", 40.0 * k),
        )
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h + 0.06, d / 2), kit.m("towel_1"))


def slippers(kit: Kit) -> None:
    """A pair of slippers."""
    cloth, sole = coloured(kit, "sheet", CLOTHS), kit.m("plastic_black")
    for side in (-1, 1):
        turn = rotation("y", side * float(kit.rng.uniform(2, 14)))
        x = side * 0.065
        kit.slab(
            (0.095, 0.26, 0.018),
            (x, 0.009, 0),
            sole,
            corner=0.045,
            bevel=0.002,
            steps=3,
            rotate=turn @ rotation("x", -90),
        )
        kit.soft(
            (0.1, 0.055, 0.12),
            np.array([x, 0.042, 0.0]) + turn @ np.array([0, 0, 0.06]),
            cloth,
            radius=0.027,
            cells=3,
            rotate=turn,
        )


def toilet_brush(kit: Kit) -> None:
    """A brush for cleaning in its holder."""
    r = kit.near(0.05, 0.12)
    vessel(kit, TUMBLER, r, kit.near(0.2, 0.4), coloured(kit, "pot_white", ("#e4e0d6", "#3f4447", "#b6b9bb")))
    kit.rod((0, 0.05, 0), (0, kit.near(0.39, 0.05), 0), 0.007, kit.m("chrome"), sides=8)


def candle(kit: Kit) -> None:
    """A candle in a glass."""
    r = kit.near(0.038, 0.15)
    vessel(kit, CAN, r, kit.near(0.085, 0.15), coloured(kit, "glass", GLASSES))
    banded(kit, 1.01 * r, 0.02, 0.055)


#: Colours of bottles in bathrooms.
_SOFT = ("#e6e4df", "#d8d3c6", "#a9c4cf", "#d9b8c0", "#b9c9a8", "#6f8fa8", "#e3cfae")

SHAMPOO = Turned(
    SQUAT_BOTTLE,
    (0.03, 0.038),
    (0.16, 0.22),
    "plastic_white",
    _SOFT,
    label=(0.15, 0.68),
    cap=(0.6, 0.03),
    squash=0.7,
)
LOTION = Turned(SQUAT_BOTTLE, (0.024, 0.03), (0.12, 0.18), "plastic_white", _SOFT, label=(0.2, 0.65), cap=(0.55, 0.035))
CREAM = Turned(JAR, (0.026, 0.038), (0.035, 0.055), "pot_white", ("#e4e0d6", "#3f4447", "#c9b79c"), cap=(0.98, 0.012))
PERFUME = Turned(
    SQUAT_BOTTLE,
    (0.022, 0.03),
    (0.07, 0.11),
    "glass",
    (*GLASSES, "#d7a8a0", "#d8b25a"),
    cap=(0.42, 0.022),
    cap_role="chrome",
    cap_codes=("#c3c6c9", "#c9a44a", "#3a3a3b"),
    squash=0.6,
)
SPRAY = Turned(CAN, (0.022, 0.027), (0.11, 0.17), "enamel", _SOFT, label=(0.1, 0.85), cap=(0.9, 0.025))
CUPFUL = Turned(TUMBLER, (0.032, 0.04), (0.085, 0.11), "pot_white", GLAZES)

_CLEANER = Turned(
    SQUAT_BOTTLE,
    (0.038, 0.046),
    (0.2, 0.27),
    "plastic_white",
    _SOFT,
    label=(0.15, 0.65),
    cap=(0.5, 0.035),
    squash=0.62,
)

KINDS = (
    ClutterKind("bathrobe", bathrobe, ("wall",), {"bathroom": (0, 1)}, height=(1.15, 1.25)),
    ClutterKind("towel_hook", towel_hook, ("tub_wall", "wall"), {"bathroom": (2, 3)}, height=(1.25, 1.4)),
    ClutterKind("towel_ring", towel_ring, ("basin_wall",), {"bathroom": (1, 1)}, height=(1.16, 1.3)),
    ClutterKind("roll_holder", roll_holder, ("wall",), {"bathroom": (1, 1)}, height=(0.66, 0.72)),
    ClutterKind("shower_caddy", shower_caddy, ("tub_wall",), {"bathroom": (1, 1)}, height=(0.95, 1.2)),
    ClutterKind("laundry", laundry, ("floor",), {"bathroom": (0, 1)}, turn=4),
    ClutterKind("cleaning_bucket", cleaning_bucket, ("floor",), {"bathroom": (0, 1)}, turn=40),
    ClutterKind("scales", scales, ("floor",), {"bathroom": (0, 1)}, turn=4),
    ClutterKind("slippers", slippers, ("floor",), {"bathroom": (0, 1), "bedroom": (0, 1)}, turn=50),
    ClutterKind("detergent", detergent, ("floor", "cabinet_top"), {"bathroom": (1, 2)}, turn=12),
    ClutterKind("peg_basket", peg_basket, ("cabinet_top", "floor"), {"bathroom": (0, 1)}, turn=90),
    ClutterKind("toilet_rolls", toilet_rolls, ("floor", "cabinet_top"), {"bathroom": (1, 2)}, turn=4),
    ClutterKind("toilet_brush", toilet_brush, ("floor",), {"bathroom": (1, 1)}, turn=90),
    ClutterKind("towel_pile", towel_pile, ("cabinet_top", "board"), {"bathroom": (1, 2)}, turn=4),
    ClutterKind("soap_pump", soap_dispenser, ("basin", "tub"), {"bathroom": (1, 1)}, turn=40, rear=True),
    ClutterKind("toothbrushes", toothbrushes, ("basin", "board"), {"bathroom": (1, 2)}, turn=180, rear=True),
    ClutterKind("toothpaste", toothpaste, ("basin", "board"), {"bathroom": (1, 2)}, turn=60),
    ClutterKind("soap_dish", soap_dish, ("basin", "tub"), {"bathroom": (1, 2)}, turn=10),
    ClutterKind("cotton_jar", cotton_jar, ("basin", "board", "sill"), {"bathroom": (1, 2)}, turn=180, rear=True),
    ClutterKind("cream", CREAM, ("basin", "board", "sill"), {"bathroom": (4, 6)}, turn=180),
    ClutterKind("perfume", PERFUME, ("basin", "board", "sill"), {"bathroom": (3, 5)}, turn=60),
    ClutterKind("spray", SPRAY, ("basin", "board", "sill"), {"bathroom": (2, 4)}, turn=180, rear=True),
    ClutterKind("lotion", LOTION, ("tub", "board", "basin", "sill"), {"bathroom": (4, 6)}, turn=60, rear=True),
    ClutterKind("hair_brush", hair_brush, ("board", "basin"), {"bathroom": (1, 2)}, turn=60),
    ClutterKind("tooth_glass", CUPFUL, ("basin", "board"), {"bathroom": (0, 1)}, turn=180),
    ClutterKind("shampoo", SHAMPOO, ("tub", "board", "sill"), {"bathroom": (4, 6)}, turn=60),
    ClutterKind("bath_sponge", bath_sponge, ("tub",), {"bathroom": (0, 1)}, turn=180),
    ClutterKind("toy_boat", toy_boat, ("tub",), {"bathroom": (0, 2)}, turn=180),
    ClutterKind("candle", candle, ("tub", "sill", "board"), {"bathroom": (1, 3)}, turn=180),
    ClutterKind("face_cloths", face_cloths, ("board", "cabinet_top", "sill"), {"bathroom": (1, 2)}, turn=6),
    ClutterKind("tissue_box", tissue_box, ("board", "sill"), {"bathroom": (0, 1), "hall": (0, 1)}, turn=20),
    ClutterKind("bath_cleaner", _CLEANER, ("floor", "cabinet_top"), {"bathroom": (1, 2)}, turn=40),
)  # fmt: skip
