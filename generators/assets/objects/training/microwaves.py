"""Microwave ovens for training: controls beside, below or above the door, keys or knobs, any handle and window."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, glass, plastic, rubber
from generators.assets.objects.training.draw import (
    VIVID,
    between,
    chance,
    metal,
    pick,
    shade,
    shell,
    spread_out,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, feet, finished, grip, paste
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material

Size = tuple[float, float, float]
Box = tuple[float, float, float, float]


def window_print(rng: Generator, size: tuple[float, float]) -> Pixels:
    """A door's window: perforated, dark, or dim with the turntable behind it."""
    width, height = round(1000 * size[0]), round(1000 * size[1])
    ground = tone(rng, "#0c0d0e", "#1b1d1f", "#26241f", "#2c3236", spread=0.03)
    kind = rng.random()
    if kind < 0.45:
        pixels = decals.dotted_window(width, height, pitch=int(rng.integers(8, 15)), margin=int(rng.integers(4, 26)))
        return (
            pixels
            if chance(rng, 0.6)
            else np.asarray(np.clip(pixels.astype(int) + rng.integers(5, 40), 0, 255), dtype=np.uint8)
        )
    canvas = decals.DecalCanvas(width, height, ground)
    if kind < 0.8:
        edge = between(rng, 0.05, 0.16) * height
        canvas.box(
            (edge, edge),
            (width - edge, height - edge),
            shade(rng, tone(rng, "#2b2a26", "#45423a", "#15181b"), 0.03),
            radius=between(rng, 0, 0.3) * height,
        )
        y = height - 1.7 * edge
        canvas.box((0.2 * width, y - 6), (0.8 * width, y), tone(rng, "#5d6468", "#8b8f8a"), radius=3)
    return decals.glazed(canvas.pixels(), strength=between(rng, 12, 50))


def _case(b: MeshBuilder, rng: Generator, size: Size, material: Material) -> None:
    """The box, its feet and its vents."""
    width, height, depth = size
    foot = between(rng, 0.008, 0.018)
    bevel = pick(rng, 0.004, 0.008, between(rng, 0.012, 0.035))
    b.box((width, height - foot, depth), (0, (height + foot) / 2, 0), material, bevel=bevel)
    feet(b, (width, depth), between(rng, 0.011, 0.018), foot + 0.003)
    vent = rubber("vent", "#222426")
    tall = chance(rng, 0.5)
    for side in (-1, 1):
        for k in range(int(rng.integers(5, 10))):
            if tall:
                b.box(
                    (0.002, 0.05, 0.005),
                    (side * width / 2, 0.75 * height, -0.38 * depth + 0.013 * k),
                    vent,
                    acoustic=False,
                )
            else:
                b.box(
                    (0.002, 0.005, 0.09),
                    (side * width / 2, 0.85 * height - 0.012 * k, -0.15 * depth),
                    vent,
                    acoustic=False,
                )


def _door(b: MeshBuilder, rng: Generator, box: Box, z: float, frame: Material) -> float:
    """A door over ``box`` (left, bottom, right, top; m) with its window; returns the z of its front."""
    left, bottom, right, top = box
    width, height, thick = right - left, top - bottom, between(rng, 0.014, 0.03)
    x, y = (left + right) / 2, (bottom + top) / 2
    b.slab((width, height, thick), (x, y, z + thick / 2), frame, corner=pick(rng, 0.004, 0.012, 0.03), bevel=0.004)
    rim = between(rng, 0.018, 0.055)
    shift = between(rng, -0.4, 0.4) * (rim - 0.014)
    size = (width - 2 * rim, height - 2 * rim)
    paste(
        b,
        window_print(rng, size),
        (x + shift, y - 0.5 * shift, z + thick + 0.0008),
        size,
        name="window",
        acoustic="glass",
    )
    return z + thick


def _opener(b: MeshBuilder, rng: Generator, box: Box, z: float, hinge: int) -> None:
    """A bar or a grip on the door's free side (``hinge``: −1 left, 1 right), along its top, or none."""
    left, bottom, right, top = box
    kind = rng.random()
    y, reach = (bottom + top) / 2, between(rng, 0.25, 0.42) * (top - bottom)
    x = right - 0.02 if hinge < 0 else left + 0.02
    material = trim(rng, "handle")
    if kind < 0.4:
        grip(
            b,
            ((x, y - reach, z - 0.002), (x, y + reach, z - 0.002)),
            between(rng, 0.025, 0.045),
            between(rng, 0.005, 0.011),
            material,
        )
    elif kind < 0.6:
        b.slab((between(rng, 0.014, 0.028), 2 * reach, 0.02), (x, y, z + 0.008), material, corner=0.008, bevel=0.004)
    elif kind < 0.75:
        span = 0.35 * (right - left)
        middle = (left + right) / 2
        grip(
            b,
            ((middle - span, top - 0.018, z - 0.002), (middle + span, top - 0.018, z - 0.002)),
            0.03,
            between(rng, 0.005, 0.009),
            material,
        )


def _side_controls(panel: Panel) -> None:
    """Display, keypad, knobs and a push button in a column."""
    rng, (width, height) = panel.rng, panel.size
    parts: list[tuple[str, float]] = []
    knobs = int(rng.choice([0, 0, 1, 1, 2, 2]))
    if knobs < 2 or chance(rng, 0.25):
        parts.append(("display", between(rng, 0.12, 0.2) * height))
    parts += [("knob", min(0.3 * height, 0.8 * width))] * knobs
    if knobs == 0 or (knobs == 1 and chance(rng, 0.6)):
        parts.append(("pad" if knobs == 0 or chance(rng, 0.4) else "few", (0.42 if knobs == 0 else 0.26) * height))
    if chance(rng, 0.4):
        parts.append(("button", 0.12 * height))
    # From the top in this order; only the gaps are random.
    free = max(0.0, height - sum(part[1] for part in parts)) / (len(parts) + 1)
    y = height / 2
    raised = chance(rng, 0.4)
    for name, high in parts:
        y -= free + high / 2
        if name == "display":
            panel.display(0, y, (0.85 * width, high))
        elif name == "knob":
            panel.knob(0, y, 0.3 * high, between(rng, 0.016, 0.03), labels=int(rng.choice([0, 0, 4, 6])))
        elif name == "pad":
            panel.keys(0, y, (3, 4), (0.3 * width, high / 4), "123456789C0*", raised=raised)
        elif name == "few":
            columns = int(rng.integers(1, 4))
            panel.keys(0, y, (columns, 3), (0.85 * width / columns, high / 3), raised=raised)
        else:
            button = plastic("opener", shade(rng, panel.colour, 0.1))
            panel.b.slab((0.8 * width, 0.8 * high, 0.012), panel.at(0, y, 0.004), button, corner=0.005, bevel=0.003)
        y -= high / 2
    panel.text(0, 0.47 * height, word(rng), 0.008)
    panel.close()


def _side_panel(rng: Generator) -> Design:
    """Controls to the right of the door, in some to the left."""
    b = MeshBuilder({"body": 0.25, "frame": 0.25})
    colour = tone(rng)
    size = (between(rng, 0.42, 0.58), between(rng, 0.24, 0.34), between(rng, 0.30, 0.42))
    body = shell(rng, "body", colour)
    _case(b, rng, size, body)
    frame = body if chance(rng, 0.5) else shell(rng, "frame", tone(rng), steel=0.3)
    if chance(rng, 0.3):
        frame = glass("frame", tone(rng, "#16171a", "#202327"))
    width, height, depth = size
    z = depth / 2 - 0.002
    column = between(rng, 0.085, 0.15)
    side = 1 if chance(rng, 0.85) else -1
    low, high = 0.02, height - between(rng, 0.004, 0.012)
    seam = side * (width / 2 - column)
    box = (-width / 2 + 0.005, low, seam - 0.002, high) if side > 0 else (seam + 0.002, low, width / 2 - 0.005, high)
    front = _door(b, rng, box, z, frame)
    _opener(b, rng, box, front, -side)
    x = side * (width / 2 - column / 2 - 0.001)
    ground = tone(rng, "#17191b", "#efefec", colour, colour, "#c3c6c8", "#2b2d30")
    thick = front - z - 0.002
    b.slab(
        (column - 0.006, high - low, thick),
        (x, (low + high) / 2, z + thick / 2),
        plastic("fascia", ground, roughness=0.36),
        corner=0.006,
        bevel=0.003,
    )
    _side_controls(Panel(b, rng, (x, (low + high) / 2, z + thick), (column - 0.02, high - low - 0.014), ground))
    return finished(b, "surface", 0.5)


def _strip_panel(rng: Generator) -> Design:
    """Controls in a strip below or above a door of full width."""
    b = MeshBuilder({"body": 0.25, "frame": 0.25})
    colour = tone(rng)
    size = (between(rng, 0.42, 0.58), between(rng, 0.26, 0.36), between(rng, 0.30, 0.42))
    body = shell(rng, "body", colour)
    _case(b, rng, size, body)
    frame = body if chance(rng, 0.4) else shell(rng, "frame", tone(rng), steel=0.4)
    width, height, depth = size
    z = depth / 2 - 0.002
    strip = between(rng, 0.045, 0.08)
    below = chance(rng, 0.6)
    low, high = 0.02, height - 0.008
    box = (-width / 2 + 0.006, low + strip if below else low, width / 2 - 0.006, high if below else high - strip)
    front = _door(b, rng, box, z, frame)
    _opener(b, rng, box, front, -1 if chance(rng, 0.7) else 1)
    y = low + strip / 2 if below else high - strip / 2
    ground = tone(rng, "#17191b", "#efefec", colour, colour, "#c3c6c8")
    b.slab(
        (width - 0.012, strip - 0.004, 0.014),
        (0, y, z + 0.007),
        plastic("fascia", ground, roughness=0.36),
        corner=0.006,
        bevel=0.003,
    )
    panel = Panel(b, rng, (0, y, z + 0.014), (width - 0.03, strip - 0.014), ground)
    tall = strip - 0.014
    knobs = int(rng.integers(0, 3))
    widths = [1.4 * tall] * knobs + [2.2 * tall, 3.2 * tall]
    centres = spread_out(rng, widths, width - 0.03)
    for x in centres[:knobs]:
        panel.knob(x, 0, 0.36 * tall, between(rng, 0.014, 0.024))
    panel.display(centres[knobs], 0, (2.0 * tall, 0.62 * tall))
    columns = int(rng.integers(3, 7))
    panel.keys(
        centres[-1], 0, (columns, int(rng.integers(1, 3))), (3.2 * tall / columns, 0.4 * tall), raised=chance(rng, 0.6)
    )
    panel.close()
    return finished(b, "surface", 0.5)


def _retro(rng: Generator) -> Design:
    """A rounded coloured case with shiny trim and two knobs."""
    b = MeshBuilder()
    colour = tone(rng, *VIVID, "#e9dfc4", "#8fb9a8", "#d99aa0")
    size = (between(rng, 0.42, 0.52), between(rng, 0.25, 0.31), between(rng, 0.30, 0.38))
    width, height, depth = size
    body = plastic("body", colour, roughness=0.16)
    b.box((width, height - 0.02, depth), (0, (height + 0.02) / 2, 0), body, bevel=between(rng, 0.025, 0.06), segments=4)
    feet(b, (width - 0.06, depth - 0.06), 0.014, 0.03)
    z, shiny = depth / 2 - 0.002, metal(rng, "trim")
    column = between(rng, 0.09, 0.13)
    box = (-width / 2 + 0.03, 0.05, width / 2 - column - 0.02, height - 0.03)
    middle = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)
    size2 = (box[2] - box[0], box[3] - box[1])
    corner = between(rng, 0.02, 0.06)
    b.slab((size2[0] + 0.014, size2[1] + 0.014, 0.008), (*middle, z + 0.004), shiny, corner=corner + 0.007, bevel=0.003)
    b.slab((*size2, 0.014), (*middle, z + 0.008), body, corner=corner, bevel=0.004)
    inner = (size2[0] - 0.06, size2[1] - 0.06)
    b.slab((inner[0] + 0.012, inner[1] + 0.012, 0.004), (*middle, z + 0.0165), shiny, corner=0.02, bevel=0.001)
    paste(b, window_print(rng, inner), (*middle, z + 0.0195), inner, name="window", acoustic="glass")
    x, reach = box[2] - 0.014, 0.3 * size2[1]
    grip(
        b,
        ((x, middle[1] - reach, z + 0.014), (x, middle[1] + reach, z + 0.014)),
        0.032,
        between(rng, 0.006, 0.01),
        shiny,
    )
    panel = Panel(b, rng, (width / 2 - column / 2 - 0.012, middle[1], z + 0.003), (0.62 * column, size2[1]), colour)
    count = int(rng.integers(1, 3))
    for k in range(count):
        panel.knob(0, (0.12 - 0.36 * k) * size2[1], between(rng, 0.2, 0.24) * column, 0.026)
    panel.display(0, 0.4 * size2[1], (0.56 * column, 0.12 * size2[1]))
    panel.close()
    return finished(b, "surface", 0.5)


FAMILIES: dict[str, Build] = {"side_panel": _side_panel, "strip_panel": _strip_panel, "retro": _retro}
