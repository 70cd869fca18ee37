"""Table-top ovens for training: a drop-down door with a bar along its top, rack and elements, dials beside or below."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, plastic, rubber
from generators.assets.objects.training.draw import between, chance, pick, shell, tone, trim, word
from generators.assets.objects.training.panel import Panel, feet, finished, grip, paste
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material

Box = tuple[float, float, float, float]


def _window(rng: Generator, size: tuple[float, float]) -> Pixels:
    """Glass with one or two racks and heating elements behind it."""
    width, height = round(1200 * size[0]), round(1200 * size[1])
    canvas = decals.DecalCanvas(width, height, tone(rng, "#101112", "#1c1a18", "#2a2622", spread=0.02))
    hot = tone(rng, "#8a3e20", "#c05a2a", "#5a4a40", "#6d6f70")
    for share in rng.uniform(0.06, 0.14, size=int(rng.integers(1, 3))):
        for y in (share * height, (1 - share) * height):
            canvas.line([(0.06 * width, y), (0.94 * width, y)], hot, between(rng, 3, 8))
    wire = tone(rng, "#8f9192", "#b9bbbd", "#6a6c6e")
    for share in rng.uniform(0.35, 0.8, size=int(rng.integers(1, 3))):
        y = share * height
        for x in np.arange(0.06 * width, 0.94 * width, between(rng, 14, 34)):
            canvas.line([(float(x), y), (float(x), y + 0.05 * height)], wire, 2.5)
        canvas.line([(0.03 * width, y), (0.97 * width, y)], wire, 4)
    return decals.glazed(canvas.pixels(), strength=between(rng, 14, 40))


def _case(b: MeshBuilder, rng: Generator, size: tuple[float, float, float], material: Material) -> None:
    width, height, depth = size
    foot = between(rng, 0.012, 0.024)
    b.box((width, height - foot, depth), (0, (height + foot) / 2, 0), material, bevel=pick(rng, 0.004, 0.01, 0.02))
    feet(b, (width, depth), between(rng, 0.012, 0.02), foot + 0.003)
    vent = rubber("vent", "#222426")
    for side in (-1, 1):
        for k in range(int(rng.integers(4, 9))):
            b.box(
                (0.002, 0.006, between(rng, 0.08, 0.14)),
                (side * width / 2, 0.86 * height - 0.014 * k, -0.1 * depth),
                vent,
                acoustic=False,
            )


def _door(b: MeshBuilder, rng: Generator, box: Box, z: float, frame: Material) -> None:
    """A door hinged below, with its window and the bar along its top."""
    left, bottom, right, top = box
    width, height, thick = right - left, top - bottom, between(rng, 0.014, 0.024)
    x, y = (left + right) / 2, (bottom + top) / 2
    b.slab((width, height, thick), (x, y, z + thick / 2), frame, corner=pick(rng, 0.004, 0.012), bevel=0.004)
    rim, head = between(rng, 0.012, 0.03), between(rng, 0.036, 0.055)
    size = (width - 2 * rim, height - rim - head)
    paste(
        b,
        _window(rng, size),
        (x, bottom + rim + size[1] / 2, z + thick + 0.0008),
        size,
        name="window",
        acoustic="glass",
    )
    span, bar_y = between(rng, 0.3, 0.46) * width, top - head / 2
    grip(
        b,
        ((x - span, bar_y, z + thick - 0.002), (x + span, bar_y, z + thick - 0.002)),
        between(rng, 0.025, 0.042),
        between(rng, 0.005, 0.01),
        trim(rng, "handle"),
    )


def _dial_side(rng: Generator) -> Design:
    """Two to four dials in a column beside the door."""
    b = MeshBuilder({"body": 0.25, "frame": 0.25})
    width, height, depth = between(rng, 0.40, 0.54), between(rng, 0.24, 0.34), between(rng, 0.28, 0.40)
    colour = tone(rng)
    _case(b, rng, (width, height, depth), shell(rng, "body", colour))
    frame = shell(rng, "frame", tone(rng, colour, "#26282a", "#b4b6b8"), steel=0.4)
    z, column = depth / 2 - 0.002, between(rng, 0.09, 0.14)
    side = 1 if chance(rng, 0.85) else -1
    seam = side * (width / 2 - column)
    low, high = 0.026, height - 0.01
    _door(
        b,
        rng,
        (-width / 2 + 0.006, low, seam - 0.002, high) if side > 0 else (seam + 0.002, low, width / 2 - 0.006, high),
        z,
        frame,
    )
    x, ground = side * (width / 2 - column / 2 - 0.001), tone(rng, colour, "#26282a", "#b4b6b8", "#efefec")
    b.slab(
        (column - 0.006, high - low, 0.014),
        (x, (low + high) / 2, z + 0.007),
        plastic("fascia", ground),
        corner=0.005,
        bevel=0.003,
    )
    panel = Panel(b, rng, (x, (low + high) / 2, z + 0.014), (column - 0.02, high - low - 0.014), ground)
    count = int(rng.integers(2, 5))
    step = panel.size[1] / count
    for k in range(count):
        panel.knob(
            0,
            (k - (count - 1) / 2) * step,
            min(0.28 * step, 0.022),
            between(rng, 0.016, 0.026),
            labels=int(rng.choice([0, 4])),
        )
    panel.lamp(0.4 * panel.size[0], -0.46 * panel.size[1])
    panel.text(0, 0.48 * panel.size[1], word(rng), 0.008)
    panel.close()
    return finished(b, "surface", 0.5)


def _dial_row(rng: Generator) -> Design:
    """Dials in a row below or above a door of full width."""
    b = MeshBuilder({"body": 0.25, "frame": 0.25})
    width, height, depth = between(rng, 0.40, 0.54), between(rng, 0.25, 0.34), between(rng, 0.28, 0.40)
    colour = tone(rng)
    _case(b, rng, (width, height, depth), shell(rng, "body", colour))
    frame = shell(rng, "frame", tone(rng, colour, "#26282a", "#b4b6b8"), steel=0.4)
    z, strip = depth / 2 - 0.002, between(rng, 0.05, 0.08)
    low, high = 0.026, height - 0.01
    below = chance(rng, 0.55)
    _door(
        b,
        rng,
        (-width / 2 + 0.006, low + strip if below else low, width / 2 - 0.006, high if below else high - strip),
        z,
        frame,
    )
    y, ground = low + strip / 2 if below else high - strip / 2, tone(rng, colour, "#26282a", "#b4b6b8", "#efefec")
    b.slab(
        (width - 0.012, strip - 0.004, 0.014),
        (0, y, z + 0.007),
        plastic("fascia", ground),
        corner=0.005,
        bevel=0.003,
    )
    panel = Panel(b, rng, (0, y, z + 0.014), (width - 0.03, strip - 0.012), ground)
    count = int(rng.integers(2, 6))
    step = panel.size[0] / count
    for k in range(count):
        panel.knob((k - (count - 1) / 2) * step, 0, min(0.3 * panel.size[1], 0.2 * step), between(rng, 0.016, 0.026))
    panel.lamp(-0.47 * panel.size[0], 0.3 * panel.size[1])
    panel.close()
    return finished(b, "surface", 0.5)


FAMILIES: dict[str, Build] = {"dial_side": _dial_side, "dial_row": _dial_row}
