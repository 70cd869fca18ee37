"""Storage: bookshelf, sideboard, shelf board, shoe cabinet, coat rack, wardrobe."""

from __future__ import annotations

import itertools

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import (
    book_pile,
    book_row,
    bowl,
    front,
    is_shaker,
    pull_style,
    vase,
    wooden_legs,
)
from generators.assets.furniture.plants import small_plant


def bookshelf(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A bookcase of one or two bays: books, boxes, ornaments; two compartments at hand height stay free."""
    w, d, tall = width or float(kit.rng.choice([0.82, 1.2])), 0.31, height or kit.near(1.95, 0.04)
    bays, board = (1 if w < 1.0 else 2), 0.024
    box = kit.m(kit.pick("wood", "white", "wood_alt"))
    rows = max(2, round((tall - 0.1) / 0.36))
    step = (tall - 0.06 - board) / rows
    kit.panel((-w / 2 + 0.004, 0.0, 0.02), (w / 2 - 0.004, 0.06, d - 0.02), box, bevel=0.0)
    for k in range(bays + 1):
        x = -w / 2 + k * (w - board) / bays
        kit.panel((x, 0.0, 0.0), (x + board, tall, d), box, bevel=0.002)
    kit.panel((-w / 2 + board, 0.06, 0.0), (w / 2 - board, tall, 0.008), box, bevel=0.0)
    span = (w - board) / bays
    free = {(1 + int(kit.rng.integers(2)), int(kit.rng.integers(bays)))}
    free.add((rows - 2 if rows > 4 else rows - 1, int(kit.rng.integers(bays))))
    for r in range(rows + 1):
        for b in range(bays):
            x0 = -w / 2 + b * span + board
            x1 = x0 + span - board
            y = 0.06 + r * step
            kit.panel((x0, y, 0.008), (x1, y + board, d - 0.004), box, bevel=0.0015)
            if r < rows:
                if (r, b) in free:
                    kit.support(
                        "shelf", (x0 + 0.02, x1 - 0.02), (0.02, d - 0.015), y + board, clearance=step - board - 0.02
                    )
                else:
                    _fill(kit, (x0 + 0.006, x1 - 0.006), y + board, d, step - board - 0.03, low=r == 0)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, 0.02), box)
    for k in range(bays + 1):
        x = -w / 2 + k * (w - board) / bays
        kit.sound((x, 0.0, 0.02), (x + board, tall, d), box)
    for r in range(rows):
        for b in range(bays):
            x0 = -w / 2 + b * span + board
            if (r, b) not in free:
                y = 0.06 + r * step
                kit.sound((x0, y, 0.02), (x0 + span - board, y + 0.24, d - 0.05), kit.m("books"))


def _fill(kit: Kit, x: tuple[float, float], y: float, depth: float, clear: float, *, low: bool) -> None:
    """The contents of one compartment."""
    choice = "boxes" if low and kit.rng.random() < 0.5 else kit.pick("books", "books", "books", "mixed", "ornament")
    front_z = depth - 0.035
    if choice == "boxes":
        count = max(1, round((x[1] - x[0]) / 0.38))
        step = (x[1] - x[0]) / count
        for k in range(count):
            a = x[0] + k * step
            role = "wicker" if k % 2 == 0 else "curtain"
            kit.panel(
                (a + 0.012, y, 0.03), (a + step - 0.012, y + min(0.24, clear), depth - 0.02), kit.m(role), bevel=0.008
            )
    elif choice == "books":
        book_row(kit, x, y, front_z, min(clear, 0.29), most=13)
    elif choice == "mixed":
        middle = (x[0] + x[1]) / 2
        end = book_row(kit, (x[0], middle + 0.02), y, front_z, min(clear, 0.28), most=9)
        centre = (end + x[1]) / 2
        if x[1] - end > 0.26:
            top = book_pile(kit, centre, y, depth / 2 + 0.02, 3)
            if clear - (top - y) > 0.1:
                bowl(kit, (centre, top, depth / 2 + 0.02), kit.m("pot_white"), 0.05, 0.045)
        else:
            vase(kit, (centre, y, depth / 2), kit.m("ceramic_accent"), min(0.2, clear))
    else:
        third = (x[1] - x[0]) / 3
        vase(kit, (x[0] + 0.5 * third, y, depth / 2), kit.m(kit.pick("ceramic_accent", "pot_white")), min(0.24, clear))
        if kit.rng.random() < 0.5:
            small_plant(kit, (x[0] + 2 * third, y, depth / 2 + 0.02), min(0.26, clear))
        else:
            book_row(kit, (x[0] + 1.25 * third, x[1]), y, front_z, min(clear, 0.27), most=8)


def sideboard(kit: Kit, *, length: float | None = None) -> None:
    """A sideboard with doors and a stack of drawers; a vase or plant and books leave most of its top free."""
    w, d, h = float(length or kit.near(1.6, 0.08)), 0.43, kit.near(0.78, 0.05)
    box = kit.m(kit.pick("wood", "wood_alt", "white"))
    face = kit.m("wood") if kit.rng.random() < 0.5 else box
    low = 0.15
    if kit.rng.random() < 0.7:
        wooden_legs(
            kit,
            (-w / 2 + 0.14, w / 2 - 0.14),
            (0.07, d - 0.08),
            low + 0.01,
            kit.m(kit.pick("wood", "metal")),
            splay=0.035,
            radius=0.02,
        )
    else:
        low = 0.07
        kit.panel((-w / 2 + 0.03, 0.0, 0.02), (w / 2 - 0.03, low, d - 0.05), kit.m("plastic_black"), bevel=0.0)
    kit.panel((-w / 2, low, 0.0), (w / 2, h, d - 0.021), box, bevel=0.003)
    count = 3 if w < 1.7 else 4
    step = (w - 0.036) / count
    stack = int(kit.rng.integers(count))
    for k in range(count):
        span = (-w / 2 + 0.018 + k * step, -w / 2 + 0.018 + (k + 1) * step)
        if k == stack:
            cuts = np.linspace(low + 0.018, h - 0.018, 4)
            for a, b in itertools.pairwise(cuts):
                front(kit, span, (float(a), float(b)), d - 0.021, face, pull=pull_style(kit, "middle"), grain="x")
        else:
            front(
                kit,
                span,
                (low + 0.018, h - 0.018),
                d - 0.021,
                face,
                shaker=is_shaker(kit),
                pull=pull_style(kit, "right" if k < stack else "left"),
            )
    side = float(kit.rng.choice([-1, 1]))
    x = side * (w / 2 - 0.16)
    if kit.rng.random() < 0.5:
        vase(kit, (x, h, d / 2 - 0.02), kit.m(kit.pick("ceramic_accent", "pot", "pot_white")), 0.3)
    else:
        small_plant(kit, (x, h, d / 2 - 0.02), 0.34)
    reach = w - 0.36
    lo, hi = (-w / 2 + 0.04, -w / 2 + 0.04 + reach - 0.04) if side > 0 else (w / 2 - reach, w / 2 - 0.04)
    kit.support("side_table", (lo, hi), (0.03, d - 0.05), h, clearance=1.0)
    kit.sound((-w / 2, low, 0.0), (w / 2, h, d), box)


def shelf_board(kit: Kit, *, length: float | None = None) -> None:
    """One board on the wall, on brackets or floating, with something at one end and the rest free."""
    kit.mount = "wall"
    w, d = float(length or kit.near(0.85, 0.12)), 0.22
    board = kit.m(kit.pick("wood", "white", "wood_alt"))
    thick = 0.038
    kit.panel((-w / 2, 0.0, 0.0), (w / 2, thick, d), board, bevel=0.003)
    if kit.rng.random() < 0.5:
        metal = kit.m("metal")
        for x in (-w / 2 + 0.13, w / 2 - 0.13):
            kit.panel((x - 0.011, -0.15, 0.0), (x + 0.011, -0.0001, 0.006), metal, bevel=0.0)
            kit.tube([(x, -0.14, 0.006), (x, -0.09, 0.07), (x, -0.008, d - 0.04)], 0.006, metal, segments=6)
    side = float(kit.rng.choice([-1, 1]))
    x = side * (w / 2 - 0.12)
    if kit.rng.random() < 0.5:
        small_plant(kit, (x, thick, d / 2), 0.24)
    else:
        lo = x - 0.1
        book_row(kit, (lo, lo + 0.2), thick, d - 0.02, 0.26, most=6, depth=0.16)
    lo, hi = (-w / 2 + 0.03, w / 2 - 0.28) if side > 0 else (-w / 2 + 0.28, w / 2 - 0.03)
    kit.support("shelf", (lo, hi), (0.01, d - 0.01), thick, clearance=0.6)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, thick, d), board)


def shoe_cabinet(kit: Kit) -> None:
    """A slim cabinet with tilting fronts."""
    w, d, h = kit.near(0.8, 0.08), 0.3, kit.near(0.92, 0.06)
    box = kit.m(kit.pick("white", "wood", "accent_paint"))
    top = kit.m("wood")
    kit.panel((-w / 2, 0.06, 0.0), (w / 2, h - 0.024, d - 0.021), box, bevel=0.002)
    kit.panel((-w / 2 + 0.02, 0.0, 0.01), (w / 2 - 0.02, 0.06, d - 0.04), kit.m("plastic_black"), bevel=0.0)
    kit.panel((-w / 2 - 0.008, h - 0.024, 0.0), (w / 2 + 0.008, h, d + 0.005), top, bevel=0.003)
    half = (h - 0.09) / 2
    for k in range(2):
        front(
            kit,
            (-w / 2, w / 2),
            (0.062 + k * half, 0.062 + (k + 1) * half),
            d - 0.021,
            box,
            shaker=is_shaker(kit),
            pull=pull_style(kit, "top"),
            grain="x",
        )
    bowl(kit, (-w / 2 + 0.13, h, d / 2), kit.m("ceramic_accent"), 0.085, 0.05)
    kit.support("side_table", (-w / 2 + 0.26, w / 2 - 0.02), (0.02, d - 0.02), h, clearance=0.9)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, h, d), box)


def coat_rack(kit: Kit) -> None:
    """A board with hooks, a scarf, a bag and a shelf for hats."""
    kit.mount = "wall"
    w = kit.near(0.8, 0.1)
    wood, metal = kit.m("wood"), kit.m("metal")
    kit.panel((-w / 2, 1.0, 0.0), (w / 2, 1.1, 0.022), wood, bevel=0.004)
    kit.panel((-w / 2, 1.22, 0.0), (w / 2, 1.242, 0.24), wood, bevel=0.003)
    for x in (-w / 2 + 0.06, w / 2 - 0.06):
        kit.panel((x - 0.011, 1.08, 0.0), (x + 0.011, 1.22, 0.2), wood, bevel=0.002)
    hooks = np.linspace(-w / 2 + 0.12, w / 2 - 0.12, 5)
    for x in hooks:
        kit.tube([(x, 1.05, 0.02), (x, 1.04, 0.055), (x, 1.055, 0.08), (x, 1.085, 0.085)], 0.006, metal, segments=6)
    _scarf(kit, float(hooks[1]), kit.pick("throw", "cushion_1", "cushion_2"))
    _bag(kit, float(hooks[3]), kit.pick("leather", "curtain", "cushion_0"))
    kit.soft(
        (0.3, 0.11, 0.2), (w / 2 - 0.24, 1.297, 0.12), kit.m("throw"), radius=0.05, puff=(0.01, 0.02, 0.01), cells=5
    )
    kit.sound((-w / 2, 1.22, 0.0), (w / 2, 1.242, 0.24), wood)


def _scarf(kit: Kit, x: float, role: str) -> None:
    """A scarf laid over a hook: gathered at the top, two ends hanging in folds."""
    u = np.linspace(-1, 1, 15)
    for length, shift in ((0.8, -0.035), (0.68, 0.04)):
        rows = []
        for t in np.linspace(0, 1, 8):
            half = 0.028 + 0.075 * min(1.0, 1.8 * t)
            fold = (0.006 + 0.010 * t) * np.sin(7 * u + 2 * shift * 60)
            rows.append(
                np.stack(
                    [x + shift * (0.3 + t) + half * u, np.full(15, 1.075 - length * t), 0.075 - 0.01 * t + fold], axis=1
                )
            )
        kit.shell(np.array(rows), 0.008, kit.m(role))
    kit.sound((x - 0.12, 0.32, 0.05), (x + 0.14, 1.07, 0.1), kit.m("throw"))


def _bag(kit: Kit, x: float, role: str) -> None:
    """A shopper with two straps over a hook."""
    cloth = kit.m(role)
    kit.soft((0.36, 0.36, 0.1), (x, 0.56, 0.085), cloth, radius=0.03, puff=(0.0, 0.006, 0.012), cells=4)
    for z in (0.062, 0.1):
        t = np.linspace(0, np.pi, 9)
        strap = np.stack(
            [x + 0.1 * np.cos(t) * (1 - 0.75 * np.sin(t)), 0.72 + 0.335 * np.sin(t), np.full(9, z)], axis=1
        )
        kit.tube(strap, 0.007, cloth, segments=6)
    kit.sound((x - 0.18, 0.38, 0.03), (x + 0.18, 0.74, 0.14), kit.m("throw"))


def wardrobe(kit: Kit, *, width: float | None = None) -> None:
    """A wardrobe with hinged doors (framed or plain) or two sliding ones, some with drawers."""
    form = kit.pick("hinged", "hinged", "sliding")
    w, d, tall = width or float(kit.rng.choice([1.2, 1.6, 1.8])), 0.6, kit.near(2.1, 0.03)
    box = kit.m(kit.pick("white", "wood", "wood_alt"))
    kit.panel((-w / 2 + 0.02, 0.0, 0.02), (w / 2 - 0.02, 0.07, d - 0.05), kit.m("plastic_black"), bevel=0.0)
    if form == "sliding":
        kit.panel((-w / 2, 0.07, 0.0), (w / 2, tall, d - 0.06), box, bevel=0.003)
        for y0, y1 in ((0.07, 0.1), (tall - 0.05, tall)):
            kit.panel((-w / 2, y0, d - 0.06), (w / 2, y1, d), box, bevel=0.002)
        for k, (x0, x1) in enumerate(((-w / 2 + 0.004, 0.02), (-0.02, w / 2 - 0.004))):
            z = d - 0.055 + 0.026 * k
            kit.panel((x0, 0.102, z), (x1, tall - 0.052, z + 0.022), box, bevel=0.002)
            for x in (x0, x1 - 0.022):
                kit.panel((x, 0.102, z + 0.022), (x + 0.022, tall - 0.052, z + 0.027), kit.m("metal"), bevel=0.001)
    else:
        kit.panel((-w / 2, 0.07, 0.0), (w / 2, tall, d - 0.021), box, bevel=0.003)
        count = max(2, round(w / 0.5))
        step = w / count
        low = 0.07
        if kit.rng.random() < 0.5:
            low = 0.34
            half = w / 2
            for k in range(2):
                front(
                    kit,
                    (-w / 2 + k * half, -w / 2 + (k + 1) * half),
                    (0.07, low),
                    d - 0.021,
                    box,
                    pull=pull_style(kit, "middle"),
                    grain="x",
                )
        for k in range(count):
            span = (-w / 2 + k * step, -w / 2 + (k + 1) * step)
            front(kit, span, (low, tall - 0.004), d - 0.021, box, shaker=is_shaker(kit), pull=None)
            metal = kit.m("metal")
            side = span[1] - 0.05 if k % 2 == 0 and k < count - 1 else span[0] + 0.05
            kit.rod((side, 0.98, d + 0.024), (side, 1.22, d + 0.024), 0.006, metal)
            for y in (1.0, 1.2):
                kit.rod((side, y, d - 0.003), (side, y, d + 0.024), 0.005, metal, sides=6)
        kit.panel((-w / 2 - 0.012, tall, 0.0), (w / 2 + 0.012, tall + 0.024, d + 0.012), box, bevel=0.006)
    kit.sound((-w / 2, 0.0, 0.0), (w / 2, tall, d), box)
