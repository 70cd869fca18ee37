"""Bedroom: bed and nightstand."""

from __future__ import annotations

import numpy as np

from generators.assets.forms import Array
from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import book_pile, front, pull_style, wooden_legs
from generators.assets.shapes import rotation


def bed(kit: Kit, *, width: float | None = None) -> None:
    """A double bed: wooden or upholstered headboard, mattress, duvet with a turned-down end, pillows, a throw."""
    w, long_ = float(width or kit.rng.choice([1.4, 1.6, 1.8])), 2.06
    form = kit.pick("wood", "upholstered", "slats")
    frame = kit.m("wood" if form != "upholstered" else "armchair")
    rail, top = 0.28, 0.5
    if form == "upholstered":
        kit.soft((w + 0.08, 0.92, 0.11), (0.0, 0.5, 0.055), frame, radius=0.04, puff=(0.0, 0.0, 0.006), cells=6)
        count = round(w / 0.3)
        for k in range(count):
            x = (k - (count - 1) / 2) * w / count
            kit.soft(
                (w / count - 0.006, 0.5, 0.06), (x, 0.7, 0.115), frame, radius=0.028, puff=(0.0, 0.0, 0.012), cells=4
            )
    elif form == "wood":
        kit.panel((-w / 2 - 0.03, 0.0, 0.0), (w / 2 + 0.03, kit.near(0.92), 0.045), frame, bevel=0.008)
    else:
        for x in (-w / 2, w / 2):
            kit.panel((x - 0.03, 0.0, 0.0), (x + 0.03, 0.98, 0.05), frame, bevel=0.008)
        for y in (0.42, 0.56, 0.7, 0.84):
            kit.panel((-w / 2 + 0.03, y, 0.012), (w / 2 - 0.03, y + 0.1, 0.036), frame, bevel=0.004)
    for side in (-1, 1):
        x0, x1 = sorted((side * (w / 2 + 0.03), side * (w / 2 + 0.002)))
        kit.panel((x0, rail - 0.14, 0.04), (x1, rail + 0.02, long_ + 0.06), frame, bevel=0.006)
    kit.panel((-w / 2 - 0.03, rail - 0.14, long_ + 0.06), (w / 2 + 0.03, rail + 0.02, long_ + 0.09), frame, bevel=0.006)
    kit.panel((-w / 2, rail - 0.1, 0.05), (w / 2, rail - 0.06, long_ + 0.06), kit.m("wood_alt"), bevel=0.0)
    wooden_legs(kit, (-w / 2 + 0.05, w / 2 - 0.05), (0.15, long_), rail - 0.1, kit.m("wood"), radius=0.03)
    kit.soft(
        (w - 0.02, top - rail + 0.08, long_ - 0.06),
        (0.0, (top + rail - 0.08) / 2, 0.06 + long_ / 2),
        kit.m("sheet"),
        radius=0.05,
        puff=(0.0, 0.008, 0.0),
        cells=6,
    )
    kit.shell(_duvet(kit, w, long_, top), 0.035, kit.m("bedding"))
    for side in (-1, 1):
        turn = rotation("x", -58) @ rotation("z", float(kit.rng.uniform(-3, 3)))
        kit.pillow((0.48 * w - 0.06, 0.5, 0.2), (side * w * 0.24, top + 0.16, 0.32), kit.m("sheet"), rotate=turn)
    if kit.rng.random() < 0.6:
        turn = rotation("x", -50)
        kit.pillow(
            (0.45, 0.42, 0.16),
            (float(kit.rng.uniform(-0.2, 0.2)), top + 0.2, 0.52),
            kit.m(kit.pick("cushion_0", "cushion_2", "print_0", "print_2")),
            rotate=turn,
        )
    kit.sound((-w / 2 - 0.03, rail - 0.14, 0.04), (w / 2 + 0.03, top + 0.05, long_ + 0.09), kit.m("bedding"))
    kit.sound((-w / 2 - 0.03, 0.0, 0.0), (w / 2 + 0.03, 0.92, 0.06), frame)


def _duvet(kit: Kit, w: float, long_: float, top: float) -> Array:
    """(R, C, 3) points of a duvet from below the pillows to over the foot, hanging down both sides, softly rumpled."""
    across = np.array([-1.0, -0.97, -0.92, -0.85, -0.7, -0.5, -0.25, 0.0, 0.25, 0.5, 0.7, 0.85, 0.92, 0.97, 1.0])
    along = np.linspace(0, 1, 15)
    s, t = np.meshgrid(across, along)
    x = np.sign(s) * np.minimum(np.abs(s) / 0.92, 1.0) * (w / 2 + 0.018)
    drop = np.clip((np.abs(s) - 0.92) / 0.08, 0, 1)
    z = 0.62 + (long_ - 0.52) * t
    phase = kit.rng.uniform(0, 6, 4)
    rumple = (
        0.010 * np.sin(3.1 * s + 7 * t + phase[0])
        + 0.008 * np.sin(6.3 * s - 11 * t + phase[1])
        + 0.005 * np.sin(13 * t + 9 * s + phase[2])
    )
    y = (
        top
        + 0.05
        + 0.025 * np.cos(s * np.pi / 2)
        + rumple * (1 - drop)
        - 0.2 * drop
        - 0.03 * np.clip((np.abs(s) - 0.85) / 0.07, 0, 1)
    )
    # The end nearest the pillows is thick and rolled back; the foot end falls a little.
    y = y + 0.03 * np.exp(-((t / 0.07) ** 2)) * (1 - drop) - 0.05 * np.clip((t - 0.93) / 0.07, 0, 1)
    x = x + 0.014 * drop * np.sin(17 * t + phase[3]) + 0.01 * np.sign(s) * drop
    return np.stack([x, y, z], axis=2)


def nightstand(kit: Kit) -> None:
    """A bedside cabinet with two drawers, or a drawer over an open bay; books below leave the top free."""
    w, d, h = kit.near(0.45, 0.06), 0.4, kit.near(0.52, 0.06)
    box = kit.m(kit.pick("wood", "wood_alt", "white"))
    form = kit.pick("drawers", "open")
    low = 0.14 if form == "drawers" else 0.1
    wooden_legs(
        kit, (-w / 2 + 0.05, w / 2 - 0.05), (0.05, d - 0.05), low + 0.01, kit.m("wood"), radius=0.017, splay=0.012
    )
    if form == "drawers":
        kit.panel((-w / 2, low, 0.0), (w / 2, h, d - 0.02), box, bevel=0.004)
        half = (h - low - 0.024) / 2
        for k in range(2):
            front(
                kit,
                (-w / 2 + 0.012, w / 2 - 0.012),
                (low + 0.012 + k * half, low + 0.012 + (k + 1) * half),
                d - 0.02,
                box,
                pull=pull_style(kit, "middle"),
                grain="x",
            )
    else:
        split = h - 0.17
        kit.panel((-w / 2, split, 0.0), (w / 2, h, d - 0.02), box, bevel=0.004)
        front(
            kit,
            (-w / 2 + 0.01, w / 2 - 0.01),
            (split + 0.012, h - 0.014),
            d - 0.02,
            box,
            pull=pull_style(kit, "middle"),
            grain="x",
        )
        for x in (-w / 2, w / 2 - 0.018):
            kit.panel((x, low, 0.0), (x + 0.018, split, d - 0.02), box, bevel=0.002)
        kit.panel((-w / 2 + 0.018, low, 0.0), (w / 2 - 0.018, low + 0.018, d - 0.02), box, bevel=0.001)
        kit.panel((-w / 2 + 0.018, low + 0.018, 0.0), (w / 2 - 0.018, split, 0.008), box, bevel=0.0)
        book_pile(kit, 0.0, low + 0.018, d / 2, 3)
    kit.support("side_table", (-w / 2 + 0.02, w / 2 - 0.02), (0.02, d - 0.03), h, clearance=0.8)
    kit.sound((-w / 2, low, 0.0), (w / 2, h, d), box)
