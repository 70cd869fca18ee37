"""Small things of halls: shoes, coats, bags, umbrellas, post, keys."""

from __future__ import annotations

import numpy as np

from generators.assets.clutter.forms import (
    CLOTHS,
    GLAZES,
    LEATHERS,
    PLASTICS,
    TUMBLER,
    WOODS,
    carton,
    coloured,
    hanging,
    sheet,
    vessel,
)
from generators.assets.clutter.record import ClutterKind
from generators.assets.forms import egg, level
from generators.assets.furniture.common import Kit
from generators.assets.shapes import rotation
from generators.core.scene import Material


def _upper(kit: Kit) -> Material:
    """Leather, canvas or rubber of shoes and bags."""
    return coloured(kit, "leather", LEATHERS) if kit.rng.random() < 0.5 else coloured(kit, "sheet", CLOTHS)


def _shoe(kit: Kit, x: float, turn: float, upper: Material, sole: Material, shaft: float) -> None:
    """One shoe with its toe towards +Z; ``shaft``: height of its opening (m)."""
    outline = [(0.0, 0.0, 1.0), (0.022, 0.0, 1.02)]
    loops = [level(egg(0.046 * s, 0.15 * s, 0.125 * s, points=14), y) for y, _, s in outline]
    turned = rotation("y", turn)
    kit.loft(loops, sole, centre=(x, 0, 0), rotate=turned, crease=30.0)
    top = max(shaft, 0.075)
    body = [
        level(egg(0.045, 0.147, 0.122, points=14), 0.022),
        level(egg(0.043, 0.13, 0.118, points=14), 0.05),
        level(egg(0.037, 0.05, 0.112, points=14), 0.075),
        level(egg(0.036, 0.0, 0.108, points=14) + (0.0, -0.002), top + 0.01),
        level(egg(0.03, -0.008, 0.1, points=14), top + 0.008),
        level(egg(0.03, -0.006, 0.098, points=14), 0.05),
    ]
    kit.loft(body, upper, centre=(x, 0, 0), rotate=turned, crease=50.0)


def shoes(kit: Kit) -> None:
    """A pair of shoes, set down a little carelessly."""
    upper, sole = _upper(kit), kit.palette.tinted("plastic_black", kit.pick("#2c2d30", "#d8d3c6", "#8c6a45"))
    for side in (-1, 1):
        _shoe(kit, side * 0.06, side * float(kit.rng.uniform(0, 9)), upper, sole, 0.0)


def boots(kit: Kit) -> None:
    """A pair of boots."""
    upper, tall = _upper(kit), kit.near(0.24, 0.25)
    for side in (-1, 1):
        _shoe(kit, side * 0.065, side * float(kit.rng.uniform(0, 6)), upper, kit.m("plastic_black"), tall)
    kit.sound((-0.11, 0, -0.12), (0.11, tall, 0.12), upper)


def coat(kit: Kit) -> None:
    """A coat or jacket on a hook."""
    kit.mount = "wall"
    cloth = coloured(kit, "sheet", CLOTHS) if kit.rng.random() < 0.7 else coloured(kit, "leather", LEATHERS)
    drop, w = kit.near(0.85, 0.2), kit.near(0.44, 0.1)
    kit.tube([(0, 0.0, 0), (0, -0.006, 0.05), (0, 0.02, 0.07)], 0.006, kit.m("metal"), segments=6)
    u = np.linspace(-1, 1, 9)
    phase = float(kit.rng.uniform(0, 6))
    loops = []
    for t in np.linspace(0, 1, 6):
        half = w / 2 * min(1.0, 0.22 + 2.2 * t)
        deep = 0.02 + 0.055 * min(1.0, 2 * t)
        front = deep * (1 - 0.6 * u**2) + 0.012 * t * np.sin(7 * u + phase)
        loops.append(
            np.stack(
                [
                    np.concatenate([half * u, half * u[::-1]]),
                    np.full(18, 0.005 - drop * t),
                    np.concatenate([np.full(9, 0.006), 0.012 + front[::-1]]),
                ],
                axis=1,
            )
        )
    kit.loft(loops, cloth, crease=60.0)
    for side in (-1, 1):
        kit.soft(
            (0.12, 0.62 * drop, 0.06),
            (side * 0.4 * w, -0.5 * drop, 0.065),
            cloth,
            radius=0.03,
            cells=3,
            rotate=rotation("z", side * 6),
        )
    for y in np.arange(-0.3, -drop + 0.1, -0.14):
        kit.cylinder(0.009, 0.005, (0.02, y, 0.085), kit.m("plastic_black"), axis="z", segments=7)
    kit.sound((-w / 2, -drop, 0.01), (w / 2, -0.1, 0.09), kit.m("sheet"))


def shoulder_bag(kit: Kit) -> None:
    """A bag that hangs by its strap."""
    kit.mount = "wall"
    stuff = _upper(kit)
    kit.tube([(0, 0, 0), (0, -0.006, 0.04), (0, 0.015, 0.055)], 0.006, kit.m("metal"), segments=6)
    w, h = kit.near(0.3, 0.2), kit.near(0.24, 0.2)
    strap = float(kit.rng.uniform(0.28, 0.5))
    kit.soft((w, h, 0.09), (0, -strap - h / 2, 0.055), stuff, radius=0.03, puff=(0, 0.004, 0.014), cells=4)
    kit.panel((-0.48 * w, -strap - 0.55 * h, 0.1), (0.48 * w, -strap - 0.01, 0.112), stuff, bevel=0.005)
    t = np.linspace(0, np.pi, 9)
    line = np.stack(
        [0.46 * w * np.cos(t) * (1 - 0.9 * np.sin(t)), -strap - 0.02 + (strap + 0.02) * np.sin(t), np.full(9, 0.045)],
        axis=1,
    )
    kit.tube(line, 0.007, stuff, segments=5)
    kit.sound((-w / 2, -strap - h, 0.01), (w / 2, -strap, 0.1), stuff)


def hat(kit: Kit) -> None:
    """A hat on a hook, or a cap."""
    kit.mount = "wall"
    cloth = coloured(kit, "sheet", CLOTHS)
    lying = rotation("x", 78)
    kit.rod((0, 0.07, 0), (0, 0.078, 0.05), 0.005, kit.m("metal"), sides=6)
    r = kit.near(0.145, 0.12)
    kit.lathe(
        [(0.09, 0.012), (r, 0.0), (r, 0.005), (0.094, 0.02), (0.082, 0.1), (0.05, 0.118), (0, 0.116)],
        cloth,
        centre=(0, 0, 0.03),
        segments=18,
        rotate=lying,
    )


def backpack(kit: Kit) -> None:
    """A rucksack on the floor."""
    cloth = coloured(kit, "sheet", CLOTHS)
    w, h, d = kit.near(0.3, 0.1), kit.near(0.42, 0.1), kit.near(0.17, 0.1)
    kit.soft((w, h, d), (0, h / 2, 0), cloth, radius=0.06, puff=(0.004, 0.01, 0.02), cells=5)
    kit.soft((0.8 * w, 0.45 * h, 0.07), (0, 0.3 * h, d / 2 + 0.02), cloth, radius=0.03, puff=(0, 0, 0.01), cells=3)
    kit.tube(
        [(-0.04, h - 0.01, 0), (-0.035, h + 0.035, 0), (0.035, h + 0.035, 0), (0.04, h - 0.01, 0)],
        0.008,
        kit.m("plastic_black"),
        segments=5,
    )
    kit.rod(
        (-0.34 * w, 0.44 * h, d / 2 + 0.06), (0.34 * w, 0.44 * h, d / 2 + 0.06), 0.004, kit.m("plastic_black"), sides=4
    )
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2 + 0.05), cloth)


def umbrella_stand(kit: Kit) -> None:
    """A stand with one to three closed umbrellas."""
    r = kit.near(0.1, 0.15)
    vessel(kit, TUMBLER, r, kit.near(0.42, 0.15), coloured(kit, "ceramic", (*GLAZES, "#3a3a3b")))
    for k in range(int(kit.rng.integers(1, 4))):
        a = 2.1 * k
        lean = np.array([np.cos(a), 0.0, np.sin(a)])
        foot, top = 0.45 * r * lean + (0, 0.06, 0), -0.55 * r * lean + (0, 0.62, 0)
        kit.tube(
            [foot, foot + 0.25 * (top - foot), top], [0.01, 0.032, 0.018], coloured(kit, "sheet", CLOTHS), segments=8
        )
        grip = top + 0.2 * (top - foot)
        kit.tube(
            [top, grip, grip + 0.05 * lean + (0, 0.03, 0), grip + 0.085 * lean - (0, 0.01, 0)],
            0.009,
            coloured(kit, "stem", WOODS),
            segments=6,
        )
    kit.sound((-r, 0, -r), (r, 0.42, r), kit.m("ceramic"))


def doormat(kit: Kit) -> None:
    """A mat of coir or rubber before the entrance."""
    w, d = kit.near(0.68, 0.08), kit.near(0.42, 0.08)
    brown = kit.palette.tinted("soil", kit.pick("#8a6b45", "#5b5047", "#6a6a66"))
    kit.panel((-w / 2, 0, -d / 2), (w / 2, 0.014, d / 2), brown, bevel=0.004)
    dark = kit.palette.tinted("plastic_black", kit.pick("#3a3330", "#30302f"))
    for z in (-d / 2 + 0.05, d / 2 - 0.05):
        kit.panel((-w / 2 + 0.04, 0.014, z - 0.008), (w / 2 - 0.04, 0.0148, z + 0.008), dark, bevel=0.0)
    kit.sound((-w / 2, 0, -d / 2), (w / 2, 0.014, d / 2), kit.m("bath_mat"))


def post(kit: Kit) -> None:
    """Letters and leaflets in a loose pile."""
    y = 0.0
    for k in range(int(kit.rng.integers(2, 6))):
        w, d = kit.near(0.2, 0.2), kit.near(0.13, 0.2)
        turn = rotation("y", float(kit.rng.uniform(-18, 18)))
        kit.panel(
            (-w / 2, y, -d / 2),
            (w / 2, y + 0.003, d / 2),
            kit.palette.tinted("paper", kit.pick("#e6e3da", "#d9cdb0", "#e9e9ea")),
            bevel=0.0,
            rotate=turn,
        )
        if k % 2 == 0:
            corners = np.array(
                [
                    (-w / 2, y + 0.0034, d / 2),
                    (w / 2, y + 0.0034, d / 2),
                    (w / 2, y + 0.0034, -d / 2),
                    (-w / 2, y + 0.0034, -d / 2),
                ]
            )
            sheet(kit, corners @ turn.T)
        y += 0.0038


def keys(kit: Kit) -> None:
    """A bunch of keys with a tag."""
    metal = kit.m("chrome")
    kit.torus(0.014, 0.0015, (0, 0.0016, 0), metal, segments=12, minor_segments=4)
    for angle in (20, 75, 140):
        turn = rotation("y", angle)
        kit.panel((0.014, 0.0, -0.004), (0.062, 0.0025, 0.004), metal, bevel=0.0, rotate=turn)
    kit.panel(
        (-0.07, 0.0, -0.014),
        (-0.016, 0.004, 0.014),
        coloured(kit, "leather", (*LEATHERS, "#a63c32", "#3d5a80")),
        bevel=0.001,
    )


def key_board(kit: Kit) -> None:
    """A board with hooks and keys."""
    kit.mount = "wall"
    w = kit.near(0.26, 0.2)
    kit.panel((-w / 2, -0.03, 0), (w / 2, 0.05, 0.012), coloured(kit, "stem", WOODS), bevel=0.003)
    metal = kit.m("chrome")
    for k, x in enumerate(np.linspace(-w / 2 + 0.035, w / 2 - 0.035, 5)):
        kit.tube([(x, 0, 0.012), (x, -0.006, 0.028), (x, 0.006, 0.034)], 0.003, metal, segments=5)
        if (k + int(kit.rng.integers(3))) % 2:
            kit.torus(0.012, 0.0014, (x, -0.016, 0.026), metal, axis="z", segments=10, minor_segments=4)
            kit.panel((x - 0.005, -0.085, 0.024), (x + 0.004, -0.028, 0.027), metal, bevel=0.0)
            if kit.rng.random() < 0.5:
                kit.panel(
                    (x - 0.004, -0.1, 0.028),
                    (x + 0.016, -0.03, 0.032),
                    coloured(kit, "plastic_white", PLASTICS),
                    bevel=0.001,
                )


def parcel(kit: Kit) -> None:
    """A cardboard parcel with tape and a label."""
    w, h, d = kit.near(0.34, 0.3), kit.near(0.2, 0.35), kit.near(0.24, 0.2)
    brown = kit.palette.tinted("paper", kit.pick("#b08a5a", "#a37c4e"))
    kit.panel((-w / 2, 0, -d / 2), (w / 2, h, d / 2), brown, bevel=0.002)
    tape = kit.palette.tinted("plastic_white", "#c9b184")
    kit.panel((-0.024, h, -d / 2), (0.024, h + 0.0006, d / 2), tape, bevel=0.0)
    kit.panel((-0.024, 0.7 * h, d / 2), (0.024, h, d / 2 + 0.0006), tape, bevel=0.0)
    x, y, z = 0.1 * w, 0.15 * h, d / 2 + 0.0006
    sheet(kit, [(x, y, z), (0.42 * w, y, z), (0.42 * w, 0.6 * h, z), (x, 0.6 * h, z)])
    kit.sound((-w / 2, 0, -d / 2), (w / 2, h, d / 2), brown)


def ball(kit: Kit) -> None:
    """A ball."""
    r = kit.near(0.105, 0.1)
    kit.sphere(
        r,
        (0, r, 0),
        coloured(kit, "plastic_white", ("#e6e4df", "#c65d4a", "#b5652f", "#3f7fa3")),
        rings=10,
        segments=16,
    )


def shoe_horn(kit: Kit) -> None:
    """A long shoehorn on a hook."""
    kit.mount = "wall"
    wood = coloured(kit, "stem", WOODS)
    kit.rod((0, 0, 0), (0, 0.004, 0.025), 0.004, kit.m("metal"), sides=6)
    kit.tube([(0, 0.02, 0.02), (0, -0.35, 0.018), (0, -0.5, 0.014)], [0.011, 0.009, 0.02], wood, segments=7)


def lead(kit: Kit) -> None:
    """A dog's lead or a cord on a hook."""
    kit.mount = "wall"
    kit.panel((-0.013, -0.02, 0.0), (0.013, 0.02, 0.006), kit.m("metal"), bevel=0.002)
    cord = coloured(kit, "sheet", ("#a63c32", "#35405a", "#2c2a29", "#4d5d52"))
    t = np.linspace(0, 2 * np.pi, 14)
    kit.tube(
        np.stack([0.05 * np.sin(t), -0.28 + 0.28 * np.cos(t), 0.02 + 0.004 * np.sin(3 * t)], axis=1),
        0.0055,
        cord,
        segments=5,
    )
    kit.rod((0.0, 0.002, 0.006), (0.0, 0.004, 0.03), 0.004, kit.m("metal"), sides=6)


def scarf(kit: Kit) -> None:
    """A scarf over a hook."""
    kit.mount = "wall"
    wool = kit.m(kit.pick("throw", "cushion_0", "cushion_2", "cushion_3"))
    kit.tube([(0, 0, 0), (0, -0.006, 0.04), (0, 0.015, 0.055)], 0.005, kit.m("metal"), segments=6)
    hanging(kit, kit.near(0.17, 0.15), 0.0, kit.near(0.7, 0.15), 0.02, wool, pinch=0.4)


def gloves(kit: Kit) -> None:
    """A pair of gloves, one on the other."""
    wool = coloured(kit, "sheet", CLOTHS)
    for k in range(2):
        turn = rotation("y", 35.0 * k)
        kit.soft((0.09, 0.022, 0.19), (0, 0.012 + 0.021 * k, 0), wool, radius=0.01, cells=3, rotate=turn)
        kit.soft(
            (0.03, 0.02, 0.07),
            np.array([0.0, 0.012 + 0.021 * k, 0.0]) + turn @ np.array([0.055, 0, 0.02]),
            wool,
            radius=0.009,
            cells=2,
            rotate=turn @ rotation("y", 30),
        )


def shoe_box(kit: Kit) -> None:
    """A printed box for shoes."""
    carton(kit, (-0.17, 0, -0.1), (0.17, 0.11, 0.1))
    kit.panel((-0.173, 0.085, -0.103), (0.173, 0.116, 0.103), coloured(kit, "paper", CLOTHS), bevel=0.0)
    kit.sound((-0.17, 0, -0.1), (0.17, 0.116, 0.1), kit.m("paper"))


KINDS = (
    ClutterKind("doormat", doormat, ("entrance",), {"hall": (1, 1)}),
    ClutterKind("umbrella_stand", umbrella_stand, ("floor",), {"hall": (1, 1)}, turn=180),
    ClutterKind("backpack", backpack, ("floor",), {"hall": (1, 2)}, turn=15),
    ClutterKind("boots", boots, ("floor",), {"hall": (2, 3)}, turn=10),
    ClutterKind("shoes", shoes, ("floor",), {"hall": (5, 8)}, turn=20),
    ClutterKind("parcel", parcel, ("floor", "cabinet_top"), {"hall": (1, 2)}, turn=8),
    ClutterKind("ball", ball, ("floor",), {"hall": (0, 1)}, turn=180),
    ClutterKind("coat", coat, ("wall",), {"hall": (3, 5)}, height=(1.2, 1.3)),
    ClutterKind("shoulder_bag", shoulder_bag, ("wall",), {"hall": (2, 3)}, height=(1.1, 1.3)),
    ClutterKind("hat", hat, ("wall",), {"hall": (2, 4)}, height=(1.6, 1.75)),
    ClutterKind("scarf_hook", scarf, ("wall",), {"hall": (1, 2)}, height=(1.15, 1.3)),
    ClutterKind("lead", lead, ("wall",), {"hall": (1, 1)}, height=(1.2, 1.35)),
    ClutterKind("shoe_horn", shoe_horn, ("wall",), {"hall": (1, 1)}, height=(1.0, 1.2)),
    ClutterKind("key_board", key_board, ("door_side", "wall"), {"hall": (1, 1)}, height=(1.45, 1.55)),
    ClutterKind("shoe_box", shoe_box, ("floor", "sideboard"), {"hall": (2, 3)}, turn=5),
    ClutterKind("post", post, ("sideboard",), {"hall": (2, 3)}, turn=25),
    ClutterKind("keys", keys, ("sideboard",), {"hall": (1, 2)}, turn=180),
    ClutterKind("gloves", gloves, ("sideboard", "cabinet_top"), {"hall": (1, 2)}, turn=60),
)  # fmt: skip
