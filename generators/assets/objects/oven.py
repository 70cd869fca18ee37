"""Table-top mini ovens, the silent distractor: a microwave's shape, but a drop-down door and three dials."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, brushed_steel, chrome, enamel, plastic, printed, rubber
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

W, H, D = 0.47, 0.29, 0.36
PANEL = 0.115


def _window() -> Pixels:
    """Dark glass with the rack and two glowing elements behind it."""
    canvas = decals.DecalCanvas(640, 400, "#101112")
    canvas.box((22, 22), (618, 378), "#1e1c1a", radius=16)
    for y in (70, 330):
        canvas.line([(50, y), (590, y)], "#7a3d22", 7)
        canvas.line([(50, y - 1), (590, y - 1)], "#b5623a", 2)
    for x in range(60, 590, 26):
        canvas.line([(x, 212), (x + (x - 320) * 0.06, 232)], "#7b7d7e", 3)
    canvas.line([(44, 212), (596, 212)], "#8f9192", 4)
    canvas.line([(34, 234), (606, 234)], "#8f9192", 5)
    return decals.glazed(canvas.pixels(), strength=26)


def _dials(background: str, ink: str, brand: str) -> Pixels:
    canvas = decals.DecalCanvas(256, 640, background)
    scales = (("100", "150", "200", "230"), ("OFF", "_", "^", "="), ("0", "15", "30", "60"))
    for row, labels in enumerate(scales):
        y = 120 + 190 * row
        for k in range(13):
            canvas.ray((128, y), -135 + 22.5 * k, 66, 76 if k % 4 else 82, ink, 4)
        for k, label in enumerate(labels):
            angle = np.radians(-135 + 90 * k)
            canvas.text((128 + 102 * np.sin(angle), y - 96 * np.cos(angle)), label, 22, ink)
    canvas.text((128, 612), brand, 24, ink, bold=0.4)
    return canvas.pixels()


def _mini_oven(rng: Generator, case: Material, front: Material, background: str, ink: str, brand: str) -> Design:
    b = MeshBuilder({"steel": 0.25})
    b.box((W, H - 0.018, D - 0.02), (0, 0.018 + (H - 0.018) / 2, -0.01), case, bevel=0.010)
    for x in (-W / 2 + 0.04, W / 2 - 0.04):
        for z in (-D / 2 + 0.05, D / 2 - 0.06):
            b.cylinder(0.016, 0.022, (x, 0.011, z), rubber("foot"), segments=14, acoustic=False)
    vent = rubber("vent", "#222426")
    for side in (-1, 1):
        for k in range(7):
            b.box((0.002, 0.006, 0.10), (side * W / 2, H - 0.05 - 0.014 * k, -0.04), vent, acoustic=False)
    z = D / 2 - 0.02
    left, right = -W / 2 + 0.006, W / 2 - PANEL - 0.002
    x, y = (left + right) / 2, 0.018 + (H - 0.018) / 2
    width, height = right - left, H - 0.034
    b.slab((width, height, 0.020), (x, y, z + 0.010), front, corner=0.008, bevel=0.004)
    w, low, high = width / 2 - 0.020, y - height / 2 + 0.022, y + height / 2 - 0.052
    corners = [(x - w, low, z + 0.0208), (x + w, low, z + 0.0208), (x + w, high, z + 0.0208), (x - w, high, z + 0.0208)]
    b.quad(corners, printed("oven_window", _window(), acoustic="glass", roughness=0.04), fit=True, acoustic=False)
    bar_y = y + height / 2 - 0.026
    bar = [(x - w + 0.02, bar_y, z + 0.018), (x - w + 0.02, bar_y, z + 0.048), (x - w + 0.032, bar_y, z + 0.054)]
    bar += [(-p[0] + 2 * x, p[1], p[2]) for p in reversed(bar)]
    b.tube(bar, 0.008, chrome("handle"), segments=14)
    px = W / 2 - PANEL / 2 - 0.002
    b.slab((PANEL - 0.006, height, 0.016), (px, y, z + 0.008), front, corner=0.006, bevel=0.003)
    pw, ph = PANEL / 2 - 0.008, height / 2 - 0.006
    corners = [
        (px - pw, y - ph, z + 0.0166),
        (px + pw, y - ph, z + 0.0166),
        (px + pw, y + ph, z + 0.0166),
        (px - pw, y + ph, z + 0.0166),
    ]
    b.quad(corners, printed("dials", _dials(background, ink, brand)), fit=True, acoustic=False)
    for row in range(3):
        at = y + ph - 2 * ph * (120 + 190 * row) / 640
        b.cylinder(0.021, 0.005, (px, at, z + 0.019), chrome("dial_ring"), axis="z", segments=28, acoustic=False)
        b.cylinder(
            0.018,
            0.022,
            (px, at, z + 0.030),
            plastic("dial", "#1b1c1e"),
            axis="z",
            top_radius=0.016,
            bevel=0.002,
            segments=28,
            acoustic=False,
        )
        turn = rotation("z", float(rng.integers(-6, 7)) * 22.5)
        b.box(
            (0.003, 0.014, 0.002),
            np.array([px, at, z + 0.0415]) + turn @ [0, 0.007, 0],
            plastic("mark", "#f0f0f0"),
            rotate=turn,
            acoustic=False,
        )
    return Design(b.build(), "surface", (x, y, z + 0.055))


def _steel(rng: Generator) -> Design:
    steel = brushed_steel("steel", rng, "#b4b6b8")
    return _mini_oven(rng, enamel("case", "#3a3c3f"), steel, "#b4b6b8", "#202224", "FORNO")


def _black(rng: Generator) -> Design:
    return _mini_oven(rng, enamel("case", "#1e1f21"), plastic("front", "#26282a"), "#26282a", "#e4e5e6", "bakker")


VARIANTS: dict[str, Build] = {"steel": _steel, "black": _black}
