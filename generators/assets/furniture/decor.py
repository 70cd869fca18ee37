"""Rug, pictures, curtains, radiator and door leaf."""

from __future__ import annotations

import numpy as np

from generators.assets.furniture.common import Kit
from generators.assets.furniture.parts import picture_frame
from generators.assets.materials import PICTURES, RUGS
from generators.assets.shapes import rotation


def rug(kit: Kit, *, length: float | None = None, width: float | None = None) -> None:
    """A flat rug, 3 : 2, with its pattern over the whole of it and fringes on its short sides."""
    k = int(kit.rng.integers(RUGS))
    w = float(length or kit.near(2.3, 0.08))
    d, thick = float(width or w / 1.5), 0.01
    material = kit.m(f"rug_{k}")
    x, z = w / 2, d / 2
    corners = np.array([(-x, thick, z), (x, thick, z), (x, thick, -z), (-x, thick, -z)])
    kit.cloth_quad(corners, material)
    # The rim takes the colour of the pattern's own edge.
    rim = np.array([(-x, 0.0, z), (x, 0.0, z), (x, 0.0, -z), (-x, 0.0, -z)])
    chart = np.array([(0.005, 0.005), (0.995, 0.005), (0.995, 0.995), (0.005, 0.995)])
    for a in range(4):
        b = (a + 1) % 4
        index = np.array([[0, 1, 2], [0, 2, 3]])
        kit.add(np.array([rim[a], rim[b], corners[b], corners[a]]), index, material, uv=chart[[a, b, b, a]][index])
    kit.add(rim[::-1], np.array([[0, 1, 2], [0, 2, 3]]), material, uv=chart[np.array([[0, 1, 2], [0, 2, 3]])])
    if kit.rng.random() < 0.6:
        yarn = kit.m("sheer")
        for side in (-1, 1):
            for pz in np.arange(-z + 0.012, z - 0.005, 0.03):
                jitter = float(kit.rng.uniform(-0.006, 0.006))
                tip = (side * (x + 0.055), 0.002, pz + jitter + 0.008)
                index = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
                points = np.array(
                    [(side * x, 0.001, pz - 0.008), (side * x, 0.001, pz + 0.008), tip, (side * x, 0.008, pz)]
                )
                kit.add(points, index if side < 0 else index[:, ::-1], yarn)
    kit.sound((-x, 0.0, -z), (x, thick, z), material)


def picture(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A framed picture with or without a mount, or a pair or triptych of small ones."""
    kit.mount = "wall"
    frame = kit.m(kit.pick("wood", "wood_alt", "metal", "white", "plastic_black"))
    first = int(kit.rng.integers(PICTURES))
    group = 1 if width is not None else int(kit.rng.choice([1, 1, 2, 3]))
    if group == 1:
        w = float(width or kit.rng.choice([0.5, 0.7, 0.9]))
        h = float(height or w * kit.rng.choice([0.7, 1.0, 1.35]))
    else:
        w, h = 0.4, 0.5
    gap = 0.07
    for k in range(group):
        x = (k - (group - 1) / 2) * (w + gap)
        inner = Kit(kit.palette, kit.rng)
        band = 0.022
        picture_frame(inner, w, h, band, 0.026, frame)
        mount = 0.0 if group == 1 and kit.rng.random() < 0.4 else 0.12 * min(w, h)
        inner.panel(
            (-w / 2 + 0.01, -h / 2 + 0.01, 0.0), (w / 2 - 0.01, h / 2 - 0.01, 0.012), kit.m("mount_board"), bevel=0.0
        )
        pw, ph = w / 2 - band - mount, h / 2 - band - mount
        # The square picture is cropped, not distorted.
        su, sv = min(1.0, pw / ph), min(1.0, ph / pw)
        corners = np.array([(-pw, -ph, 0.0135), (pw, -ph, 0.0135), (pw, ph, 0.0135), (-pw, ph, 0.0135)])
        chart = np.array(
            [
                (0.5 - su / 2, 0.5 - sv / 2),
                (0.5 + su / 2, 0.5 - sv / 2),
                (0.5 + su / 2, 0.5 + sv / 2),
                (0.5 - su / 2, 0.5 + sv / 2),
            ]
        )
        index = np.array([[0, 1, 2], [0, 2, 3]])
        inner.add(corners, index, kit.m(f"picture_{(first + k) % PICTURES}"), uv=chart[index])
        kit.merge(inner.build(), centre=(x, 0.0, 0.0))
        kit.sound((x - w / 2, -h / 2, 0.0), (x + w / 2, h / 2, 0.026), kit.m("mount_board"))


def curtains(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A pair of curtains drawn to the sides of a window, on a rod with finials.

    ``width`` is the rod's length; the window between the curtains is about half of it. The mount is the wall: the
    centre of the back face is the origin.
    """
    kit.mount = "wall"
    w, h = float(width or 2.0), float(height or 2.4)
    cloth, metal = kit.m("curtain"), kit.m("metal")
    top = h / 2 - 0.03
    kit.rod((-w / 2, top, 0.085), (w / 2, top, 0.085), 0.0125, metal, sides=10)
    for side in (-1, 1):
        kit.sphere(0.026, (side * (w / 2 + 0.012), top, 0.085), metal, rings=8, segments=12)
        kit.panel(
            (side * (w / 2 - 0.1) - 0.012, top - 0.03, 0.0),
            (side * (w / 2 - 0.1) + 0.012, top + 0.03, 0.008),
            metal,
            bevel=0.002,
        )
        kit.rod((side * (w / 2 - 0.1), top, 0.004), (side * (w / 2 - 0.1), top, 0.085), 0.008, metal, sides=6)
        reach = min(0.28 * w, 0.62) * float(kit.rng.uniform(0.85, 1.0))
        folds = max(4, round(reach / 0.095))
        count = folds * 7 + 1
        u = np.linspace(0, 1, count)
        phase = float(kit.rng.uniform(0, 6))
        rows = []
        for y in np.linspace(top - 0.02, -h / 2 + 0.012, 6):
            s = (top - y) / h
            deep = 0.028 + 0.016 * s
            swing = 0.35 * np.sin(3.1 * u * folds * 0.37 + phase + 1.2 * s) * s
            z = 0.085 + deep * np.sin(2 * np.pi * folds * u + swing)
            x = side * (w / 2 - 0.03 - reach * (1 - 0.06 * s) * u) + 0.010 * s * np.sin(4 * np.pi * folds * u + phase)
            rows.append(np.stack([x, np.full(count, y), z], axis=1))
        kit.shell(np.array(rows), 0.003, cloth)
        x0, x1 = sorted((side * (w / 2 - 0.03), side * (w / 2 - 0.03 - reach)))
        kit.sound((x0, -h / 2 + 0.012, 0.06), (x1, top, 0.11), cloth)


def radiator(kit: Kit, *, length: float | None = None) -> None:
    """A panel radiator with ribs and a grille, or a column radiator; valve and pipes to the floor side."""
    kit.mount = "wall"
    w, h = float(length or kit.near(1.0, 0.2)), 0.6
    white = kit.m("radiator")
    if kit.rng.random() < 0.5 or w > 1.4:
        kit.panel((-w / 2, 0.0, 0.03), (w / 2, h, 0.1), white, bevel=0.006)
        count = int(w / 0.036)
        for k in range(count):
            x = -w / 2 + 0.02 + (w - 0.04) * (k + 0.5) / count
            kit.panel((x - 0.009, 0.035, 0.1), (x + 0.009, h - 0.035, 0.106), white, bevel=0.003)
        for x in np.linspace(-w / 2 + 0.02, w / 2 - 0.02, max(6, int(w / 0.05))):
            kit.panel(
                (float(x) - 0.004, h, 0.036), (float(x) + 0.004, h + 0.003, 0.094), kit.m("black_metal"), bevel=0.0
            )
    else:
        count = max(4, round(w / 0.06))
        step = w / count
        for k in range(count):
            x = -w / 2 + (k + 0.5) * step
            for z in (0.055, 0.1):
                kit.rod((x, 0.02, z), (x, h - 0.02, z), 0.014, white, sides=8)
            kit.soft((step * 0.92, 0.055, 0.085), (x, 0.027, 0.078), white, radius=0.02, cells=2)
            kit.soft((step * 0.92, 0.055, 0.085), (x, h - 0.027, 0.078), white, radius=0.02, cells=2)
    for x in (-w / 2 + 0.1, w / 2 - 0.1):
        kit.panel((x - 0.015, 0.1, 0.0), (x + 0.015, h - 0.1, 0.032), white, bevel=0.0)
    kit.rod((w / 2 - 0.01, 0.05, 0.065), (w / 2 + 0.035, 0.05, 0.065), 0.011, kit.m("chrome"))
    kit.lathe(
        [(0.0, 0.0), (0.02, 0.0), (0.021, 0.05), (0.017, 0.06), (0.0, 0.061)],
        kit.m("plastic_white"),
        centre=(w / 2 + 0.035, 0.05, 0.065),
        segments=14,
        rotate=rotation("z", -90),
    )
    kit.rod((w / 2 + 0.03, 0.05, 0.065), (w / 2 + 0.03, -0.1, 0.065), 0.0085, kit.m("chrome"))
    kit.sound((-w / 2, 0.0, 0.03), (w / 2, h, 0.105), white)


def door_leaf(kit: Kit, *, width: float | None = None, height: float | None = None) -> None:
    """A room door's leaf with lever handles on both sides, centred on its thickness; hinges on the left."""
    w, h, t = float(width or 0.82), float(height or 2.02), 0.04
    form = str(kit.palette.choose("door form", ("plain", "panels", "two", "lines")))
    skin, metal = kit.m("door"), kit.m("metal")
    with kit.grained("y"):
        if form in ("plain", "lines"):
            kit.panel((-w / 2, 0.0, -t / 2), (w / 2, h, t / 2), skin, bevel=0.003)
            if form == "lines":
                for y in (0.3, 0.5, 0.7):
                    for side in (-1, 1):
                        z0, z1 = sorted((side * t / 2, side * (t / 2 + 0.002)))
                        kit.panel(
                            (-w / 2 + 0.004, y * h - 0.005, z0), (w / 2 - 0.004, y * h + 0.005, z1), metal, bevel=0.0
                        )
        else:
            rail = 0.115
            splits = (0.0, 0.42, 1.0) if form == "panels" else (0.0, 0.36, 0.64, 1.0)
            kit.panel((-w / 2 + 0.02, 0.02, -t / 2 + 0.011), (w / 2 - 0.02, h - 0.02, t / 2 - 0.011), skin, bevel=0.0)
            for x0, x1 in ((-w / 2, -w / 2 + rail), (w / 2 - rail, w / 2)):
                kit.panel((x0, 0.0, -t / 2), (x1, h, t / 2), skin, bevel=0.006)
            with kit.grained("x"):
                for s in splits:
                    middle = min(max(s * h, 0.09), h - 0.06)
                    low, high = (0.0, 0.18) if s == 0 else (middle - 0.06, h if s == 1 else middle + 0.06)
                    kit.panel((-w / 2 + rail, low, -t / 2), (w / 2 - rail, high, t / 2), skin, bevel=0.006)
    for side in (-1, 1):
        x, z = w / 2 - 0.065, side * t / 2
        kit.cylinder(0.026, 0.008, (x, 1.03, z + side * 0.004), metal, axis="z", segments=18)
        kit.cylinder(0.02, 0.006, (x, 0.94, z + side * 0.003), metal, axis="z", segments=14)
        kit.tube(
            [
                (x, 1.03, z),
                (x, 1.03, z + side * 0.05),
                (x - 0.02, 1.03, z + side * 0.058),
                (x - 0.125, 1.03, z + side * 0.058),
            ],
            0.0095,
            metal,
            segments=8,
        )
    for y in (0.22, h - 0.22):
        kit.rod((-w / 2 - 0.003, y - 0.045, t / 2), (-w / 2 - 0.003, y + 0.045, t / 2), 0.008, metal, sides=8)
    kit.sound((-w / 2, 0.0, -t / 2), (w / 2, h, t / 2), skin)
