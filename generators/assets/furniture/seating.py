"""Sofa and armchair."""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import (
    wooden_legs,
)
from generators.assets.shapes import rotation


def sofa(kit: Kit, *, length: float | None = None) -> None:
    """A two- or three-seater: boxy with low arms, rounded, or tufted on legs; loose cushions and sometimes a throw."""
    form = str(kit.palette.choose("sofa form", ("boxy", "round", "slim")))
    cloth = kit.m("sofa")
    w = float(length or kit.rng.choice([1.75, 2.1, 2.3]))
    d, arm, legs = (
        0.9,
        {"boxy": 0.17, "round": 0.2, "slim": 0.09}[form],
        {"boxy": 0.07, "round": 0.1, "slim": 0.16}[form],
    )
    seats = 2 if w < 1.9 else 3
    inner = w - 2 * arm
    high = {"boxy": 0.58, "round": 0.6, "slim": 0.6}[form]
    wooden_legs(
        kit,
        (-w / 2 + 0.08, w / 2 - 0.08),
        (0.09, d - 0.09),
        legs + 0.02,
        kit.m("metal" if form == "boxy" else "wood"),
        radius=0.022,
        splay=0.02 if form == "slim" else 0.0,
    )
    base = legs + (0.19 if form != "slim" else 0.12)
    kit.soft((w - 0.02, base - legs, d - 0.04), (0.0, (base + legs) / 2, d / 2), cloth, radius=0.025, cells=2)
    rounding, puff, cells = (0.09, (0.008, 0.01, 0.01), 6) if form == "round" else (0.03, (0.004, 0.004, 0.004), 4)
    for side in (-1, 1):
        at = (side * (w / 2 - arm / 2), (high + legs) / 2, d / 2)
        kit.soft((arm, high - legs, d - 0.02), at, cloth, radius=rounding, puff=puff, cells=cells)
    kit.soft(
        (inner + 0.04, 0.76 - legs, 0.17),
        (0.0, (0.76 + legs) / 2, 0.085),
        cloth,
        radius=0.05,
        puff=(0.0, 0.006, 0.0),
        cells=4,
    )
    top = base + 0.155
    _seat_cushions(kit, seats, inner, d, base)
    _loose_cushions(kit, inner, top)
    if kit.rng.random() < 0.5:
        _throw_over_arm(kit, float(kit.rng.choice([-1, 1])) * (w / 2 - arm / 2), arm, high, d)
    kit.sound((-w / 2, legs, 0.0), (w / 2, top, d), cloth)
    kit.sound((-w / 2, top, 0.0), (w / 2, 0.78, 0.3), cloth)
    for side in (-1, 1):
        x0, x1 = sorted((side * w / 2, side * (w / 2 - arm)))
        kit.sound((x0, top, 0.3), (x1, high, d), cloth)


def _loose_cushions(kit: Kit, inner: float, top: float) -> None:
    """One to three cushions leaning on the back, on seats of height ``top`` (m)."""
    count = int(kit.rng.integers(1, 4))
    for place in kit.rng.permutation(np.array([-0.36, 0.36, 0.15]))[:count]:
        size = float(kit.rng.uniform(0.4, 0.48))
        role = kit.pick("cushion_0", "cushion_1", "cushion_2", "cushion_3", "print_0", "print_1")
        turn = (
            rotation("z", float(kit.rng.uniform(-9, 9)))
            @ rotation("y", float(-np.sign(place) * kit.rng.uniform(0, 16)))
            @ rotation("x", -20)
        )
        kit.pillow((size, size, 0.16), (float(place) * inner, top + 0.46 * size, 0.40), kit.m(role), rotate=turn)


def _seat_cushions(kit: Kit, seats: int, inner: float, d: float, base: float) -> None:
    """Seat and back cushions side by side; ``inner``: width between the arms, ``base``: height of their support (m)."""
    cloth, top = kit.m("sofa"), base + 0.155
    seat_w = inner / seats
    for k in range(seats):
        x = -inner / 2 + (k + 0.5) * seat_w
        kit.soft(
            (seat_w - 0.008, 0.17, d - 0.19),
            (x, base + 0.08, 0.17 + (d - 0.19) / 2),
            cloth,
            radius=0.055,
            puff=(0.0, 0.016, 0.008),
            cells=5,
        )
        tilt = rotation("x", -11)
        kit.soft(
            (seat_w - 0.012, 0.42, 0.17),
            (x, top + 0.2, 0.235),
            cloth,
            radius=0.07,
            puff=(0.0, 0.01, 0.022),
            cells=5,
            rotate=tilt,
        )


def _throw_over_arm(kit: Kit, x: float, arm: float, high: float, depth: float) -> None:
    """A knitted throw over an arm rest: down the outside, over, down the inside to the seat."""
    half = arm / 2 + 0.012
    top = high + 0.016
    line = [
        (-half, 0.24),
        (-half, 0.4),
        (-half, top - 0.03),
        (-half + 0.03, top),
        (half - 0.03, top),
        (half, top - 0.03),
        (half, high - 0.1),
    ]
    sign = float(np.sign(x))
    u = np.linspace(0, 1, 9)
    rows = []
    for k, (px, y) in enumerate(line):
        out = 0.006 * np.sin(u * 14 + k) if k < 2 else 0.0 * u
        rows.append(
            np.stack(
                [
                    x - sign * px + sign * np.abs(out),
                    np.full(9, y) + (0.012 * np.sin(7 * u) if k == 0 else 0.0),
                    depth * (0.38 + 0.44 * u),
                ],
                axis=1,
            )
        )
    kit.shell(np.array(rows), 0.014, kit.m("throw"))


def armchair(kit: Kit) -> None:
    """An armchair: a wing-backed shell on tapered legs, or a wooden frame with loose cushions."""
    form = kit.pick("shell", "frame")
    cloth = kit.m("armchair")
    w, d = kit.near(0.76, 0.04), 0.8
    top = _shell_armchair(kit, w, d) if form == "shell" else _frame_armchair(kit, w, d)
    if kit.rng.random() < 0.7:
        kit.pillow(
            (0.42, 0.34, 0.13),
            (0.0, top + 0.18, 0.36),
            kit.m(kit.pick("cushion_0", "cushion_1", "print_1", "print_2")),
            rotate=rotation("x", -20),
        )
    kit.sound((-w / 2, 0.2, 0.0), (w / 2, top, d), cloth)
    kit.sound((-w / 2, top, 0.0), (w / 2, top + 0.4, 0.2), cloth)


def _frame_armchair(kit: Kit, w: float, d: float) -> float:
    """A wooden frame with loose cushions; returns the height of its seat (m)."""
    cloth, wood = kit.m("armchair"), kit.m("wood")
    bar = 0.036
    for side in (-1, 1):
        x0, x1 = sorted((side * w / 2, side * (w / 2 - bar)))
        kit.panel((x0, 0.0, d - 0.1), (x1, 0.58, d - 0.1 + bar), wood, bevel=0.006)
        kit.panel((x0, 0.0, 0.13), (x1, 0.58, 0.13 + bar), wood, bevel=0.006, rotate=rotation("x", -8))
        kit.panel((x0 - 0.008, 0.57, 0.05), (x1 + 0.008, 0.6, d - 0.04), wood, bevel=0.01)
        kit.panel((x0, 0.25, 0.1), (x1, 0.3, d - 0.08), wood, bevel=0.004)
    kit.panel((-w / 2 + bar, 0.25, d - 0.12), (w / 2 - bar, 0.3, d - 0.09), wood, bevel=0.004)
    for y in (0.42, 0.56, 0.7):
        kit.panel(
            (-w / 2 + bar, y, 0.145 - 0.16 * (y - 0.3)),
            (w / 2 - bar, y + 0.05, 0.167 - 0.16 * (y - 0.3)),
            wood,
            bevel=0.004,
        )
    kit.soft((w - 0.1, 0.14, d - 0.2), (0.0, 0.36, d / 2 + 0.05), cloth, radius=0.05, puff=(0.0, 0.018, 0.008), cells=7)
    kit.soft(
        (w - 0.1, 0.5, 0.14),
        (0.0, 0.63, 0.195),
        cloth,
        radius=0.05,
        puff=(0.0, 0.01, 0.02),
        cells=7,
        rotate=rotation("x", -11),
    )
    return 0.43


def _shell_armchair(kit: Kit, w: float, d: float) -> float:
    """A wing-backed shell on tapered legs; returns the height of its seat (m)."""
    cloth, wood = kit.m("armchair"), kit.m("wood")
    legs = 0.16
    wooden_legs(kit, (-w / 2 + 0.12, w / 2 - 0.12), (0.14, d - 0.14), legs + 0.03, wood, radius=0.02, splay=0.035)
    kit.soft((w - 0.06, 0.16, d - 0.08), (0.0, legs + 0.08, d / 2), cloth, radius=0.05, cells=5)
    kit.soft(
        (w - 0.22, 0.17, d - 0.2),
        (0.0, legs + 0.235, d / 2 + 0.08),
        cloth,
        radius=0.06,
        puff=(0.0, 0.018, 0.01),
        cells=6,
    )
    for side in (-1, 1):
        kit.soft(
            (0.12, 0.42, d - 0.12),
            (side * (w / 2 - 0.06), legs + 0.23, d / 2 + 0.02),
            cloth,
            radius=0.055,
            puff=(0.006, 0.006, 0.006),
            cells=6,
        )
    kit.soft(
        (w - 0.04, 0.66, 0.16),
        (0.0, legs + 0.35, 0.1),
        cloth,
        radius=0.075,
        puff=(0.0, 0.02, 0.012),
        cells=7,
        rotate=rotation("x", -9),
    )
    return legs + 0.32
