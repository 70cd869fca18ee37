"""Washing machines for training: front loaders of any layout, top loaders, and machines behind a cabinet's face."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.forms import housing_loops
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import chrome, glass, plastic, printed
from generators.assets.objects.training.draw import (
    between,
    brightness,
    chance,
    metal,
    shell,
    spread_out,
    timber,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, feet, finished, grip
from generators.assets.objects.training.washing_parts import DoorPort, add_door, add_front_panel, add_plinth
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material


def _front_door(rng: Generator) -> Design:
    """A front loader; the panel above the door, the door anywhere below it."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng)
    body = shell(rng, "body", colour)
    width, height, depth = between(rng, 0.52, 0.68), between(rng, 0.78, 0.95), between(rng, 0.42, 0.68)
    top = between(rng, 0.0, 0.035) if chance(rng, 0.7) else 0.0
    shelf = height - top
    face = depth / 2
    band = between(rng, 0.085, 0.15)
    room = shelf - band - 0.10
    radius = min(between(rng, 0.135, 0.21), 0.5 * room - 0.045, 0.5 * width - 0.06)
    ring = min(between(rng, 0.022, 0.075), 0.5 * room - radius - 0.005, 0.5 * width - radius - 0.012)
    slack = 0.5 * room - radius - ring
    port = DoorPort(between(rng, -0.02, 0.02), 0.10 + room / 2 + between(rng, -1, 1) * slack, face, radius, ring)
    middle = (0.0, (0.018 + shelf) / 2, 0.0)
    b.loft(
        housing_loops((width, shelf - 0.018, depth), (port.x, port.y - middle[1]), radius, 0.03),
        body,
        caps="first",
        centre=middle,
    )
    if top:
        cover = body if chance(rng, 0.6) else trim(rng, "worktop")
        b.box(
            (width, top, depth + between(rng, -0.01, 0.03)),
            (0, height - top / 2, 0),
            cover,
            bevel=0.3 * top,
            acoustic=False,
        )
    feet(b, (width, depth), 0.022, 0.022)
    add_plinth(b, rng, width, face, body)
    panel_y = shelf - band / 2 - 0.004
    same = chance(rng, 0.5)
    ground = colour if same else tone(rng, "#232427", "#efefec", "#c3c6c8", "#4b4e52")
    if chance(rng, 0.5):
        b.slab(
            (width - 0.016, band - 0.012, 0.012),
            (0, panel_y, face),
            plastic("fascia", ground),
            corner=0.012,
            bevel=0.004,
        )
        add_front_panel(b, rng, (0, panel_y, face + 0.006), (width - 0.045, band - 0.03), ground)
    else:
        b.box(
            (width - 0.012, 0.003, 0.002), (0, panel_y - band / 2, face), plastic("gap_line", "#3a3c3f"), acoustic=False
        )
        add_front_panel(b, rng, (0, panel_y, face), (width - 0.035, band - 0.02), ground)
    add_door(b, rng, port, body, colour)
    return finished(b, "floor", max(0.06, (port.y - radius) / height))


def _top_lid(rng: Generator) -> Design:
    """A top loader: a lid in the top, controls on a console behind it or along its front."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng)
    body = shell(rng, "body", colour)
    width, height, depth = between(rng, 0.40, 0.70), between(rng, 0.82, 0.98), between(rng, 0.52, 0.68)
    face = depth / 2
    bottom = between(rng, 0.015, 0.06)
    b.box((width, height - bottom, depth), (0, (height + bottom) / 2, 0), body, bevel=between(rng, 0.006, 0.02))
    feet(b, (width, depth), 0.024, bottom + 0.004)
    lid = body if chance(rng, 0.5) else plastic("lid", tone(rng, "#efefec", "#2b2d30", "#c9cccf"), roughness=0.25)
    flat = rotation("x", -90)
    console = between(rng, 0.09, 0.15)
    behind = chance(rng, 0.6)
    span = depth - console - 0.05
    z = (console / 2 if behind else -console / 2) + (0.0 if behind else 0.01)
    b.slab(
        (width - between(rng, 0.03, 0.09), span, 0.022),
        (0, height + 0.008, z),
        lid,
        corner=between(rng, 0.012, 0.05),
        bevel=0.006,
        rotate=flat,
    )
    if chance(rng, 0.45):
        window = glass("lid_glass", tone(rng, "#15181b", "#2b3338", "#4b555c"))
        b.slab(
            (0.6 * width, 0.6 * span, 0.004),
            (0, height + 0.0205, z),
            window,
            corner=between(rng, 0.01, 0.09),
            bevel=0.001,
            rotate=flat,
        )
    handle = trim(rng, "lid_grip")
    b.slab(
        (between(rng, 0.1, 0.24), 0.022, 0.012),
        (0, height + 0.018, z + span / 2 - 0.02),
        handle,
        corner=0.008,
        bevel=0.003,
        rotate=flat,
    )
    ground = colour if chance(rng, 0.5) else tone(rng, "#232427", "#efefec", "#c3c6c8")
    _console(b, rng, (width, height, face, console), behind, (body, ground))
    _front_marks(b, rng, (width, height), face)
    add_plinth(b, rng, width, face, body, bottom)
    return finished(b, "floor", between(rng, 0.6, 0.8))


def _console(
    b: MeshBuilder,
    rng: Generator,
    size: tuple[float, float, float, float],
    behind: bool,
    finish: tuple[Material, str],
) -> None:
    """The controls of a top loader on its back (``behind``) or along its front edge.

    Args:
        b: receives the parts.
        rng: draws the rise, the slope and the controls.
        size: width, height and half depth of the machine, depth of the console (m).
        behind: whether it stands behind the lid.
        finish: the case's material, and the colour of the print (sRGB).
    """
    (width, height, face, console), (body, ground) = size, finish
    if behind:
        rise = between(rng, 0.09, 0.17)
        lean = rotation("x", -between(rng, 5, 30))
        b.box(
            (width, rise + 0.06, 0.05),
            (0, height + rise / 2 - 0.045, -face + console / 2),
            body,
            bevel=0.012,
            rotate=lean,
        )
        at = np.array([0, height + rise / 2 - 0.045, -face + console / 2]) + lean @ [0, 0.02, 0.025]
        _top_controls(Panel(b, rng, at, (width - 0.05, rise - 0.02), ground, lean, "controls"))
    else:
        lean = rotation("x", -between(rng, 50, 75))
        at = np.array([0, height + 0.004, face - console / 2 - 0.01])
        b.box((width - 0.01, console, 0.03), at, body, bevel=0.006, rotate=lean, acoustic=False)
        _top_controls(
            Panel(b, rng, at + lean @ [0, 0, 0.015], (width - 0.04, console - 0.02), ground, lean, "controls")
        )


def _front_marks(b: MeshBuilder, rng: Generator, size: tuple[float, float], face: float) -> None:
    """Add a seam, a name plate or a stripe to the plain front of a top loader."""
    width, height = size
    gap = plastic("seam", "#55585c")
    b.box((width - 0.01, 0.003, 0.002), (0, height - between(rng, 0.05, 0.14), face), gap, acoustic=False)
    if chance(rng, 0.5):
        b.box(
            (width - 0.004, between(rng, 0.008, 0.03), 0.004),
            (0, height - between(rng, 0.02, 0.04), face),
            metal(rng, "stripe"),
            acoustic=False,
        )
    plate = decals.DecalCanvas(256, 64, "#d9dbdd")
    plate.text((128, 32), word(rng), 36, "#25282b", bold=0.8)
    x, y = between(rng, -0.25, 0.25) * width, between(rng, 0.82, 0.9) * height
    corners = [(x + sx * 0.06, y + sy * 0.015, face + 0.0012) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(corners, printed("plate", plate.pixels()), fit=True, acoustic=False)


def _top_controls(panel: Panel) -> None:
    """One to four knobs, a display and keys along a console."""
    rng, (width, high) = panel.rng, panel.size
    knobs = int(rng.integers(0, 5))
    radius = min(between(rng, 0.28, 0.36) * high, 0.4 * width / max(1, knobs), 0.035)
    widths = [2.4 * radius] * knobs
    show = chance(rng, 0.5)
    widths += [min(0.12, 0.25 * width)] if show else []
    keys = chance(rng, 0.6) or knobs == 0
    widths += [0.25 * width] if keys else []
    centres = spread_out(rng, widths, width * 0.95)
    for x in centres[:knobs]:
        panel.knob(x, 0, radius, between(rng, 0.015, 0.028))
    if show:
        panel.display(
            centres[knobs], 0, (widths[knobs], 0.4 * high), f"{int(rng.integers(4))}:{int(rng.integers(60)):02d}"
        )
    if keys:
        columns = int(rng.integers(3, 7))
        panel.keys(
            centres[-1],
            0,
            (columns, int(rng.integers(1, 3))),
            (0.25 * width / columns, 0.3 * high),
            raised=chance(rng, 0.7),
        )
    panel.text(between(rng, -0.3, 0.3) * width, 0.4 * high, word(rng), 0.012)
    panel.close()


def _built_in(rng: Generator) -> Design:
    """A machine in a cabinet: wide timber or painted sides, a thin control strip, a flush round door."""
    b = MeshBuilder({"cabinet": 0.4, "body": 0.25})
    colour = tone(rng)
    body = shell(rng, "body", colour)
    cabinet = timber(rng, "cabinet") if chance(rng, 0.5) else plastic("cabinet", tone(rng))
    width, height, depth = between(rng, 0.55, 0.63), between(rng, 0.76, 0.86), between(rng, 0.46, 0.58)
    wall = between(rng, 0.016, 0.028)
    face = depth / 2
    b.box((width + 2 * wall, wall * 1.4, depth + 0.03), (0, height + wall * 0.7, 0.012), cabinet, bevel=0.003)
    for x in (-1, 1):
        b.box((wall, height, depth + 0.02), (x * (width + wall) / 2, height / 2, 0.005), cabinet, bevel=0.002)
    kick = between(rng, 0.07, 0.14)
    b.box(
        (width, kick, 0.02),
        (0, kick / 2, face - 0.06),
        plastic("kick", tone(rng, "#2b2d30", "#8d9195", "#d9dadb")),
        acoustic=False,
    )
    radius = between(rng, 0.14, 0.19)
    port = DoorPort(
        0.0, kick + between(rng, 0.45, 0.55) * (height - kick - 0.08), face, radius, between(rng, 0.02, 0.05)
    )
    middle = (0.0, (kick + height) / 2, 0.0)
    b.loft(
        housing_loops((width - 0.004, height - kick, depth), (0, port.y - middle[1]), radius, 0.03),
        body,
        caps="first",
        centre=middle,
    )
    band = between(rng, 0.05, 0.085)
    dark = brightness(colour) < 0.5
    ground = tone(rng, "#232427", "#3a3d40") if not dark or chance(rng, 0.5) else tone(rng, "#efefec", "#c3c6c8")
    b.slab(
        (width - 0.02, band, 0.010),
        (0, height - band / 2 - 0.008, face),
        plastic("strip", ground),
        corner=0.006,
        bevel=0.002,
    )
    add_front_panel(b, rng, (0, height - band / 2 - 0.008, face + 0.005), (width - 0.05, band - 0.012), ground)
    if chance(rng, 0.4):
        y = height - band - 0.03
        grip(b, ((-0.35 * width, y, face), (0.35 * width, y, face)), 0.035, 0.006, chrome("bar"))
    add_door(b, rng, port, body, colour)
    return finished(b, "floor", max(0.08, (port.y - radius) / height))


FAMILIES: dict[str, Build] = {"front_door": _front_door, "top_lid": _top_lid, "built_in": _built_in}
