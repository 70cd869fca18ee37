"""Washing machines for training: front loaders of any layout, top loaders, and machines behind a cabinet's face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, chrome, glass, plastic, printed, rubber
from generators.assets.objects.forms import housing_with_port, rounded_rectangle, slab
from generators.assets.objects.training.draw import (
    between,
    brightness,
    chance,
    metal,
    pick,
    shade,
    shell,
    spread_out,
    timber,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, feet, finished, grip
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

_PROGRAMMES = ("ECO", "20", "30", "40", "60", "90", "WOOL", "MIX", "SPIN", "FAST")


@dataclass(frozen=True)
class _Port:
    """The round door of a front loader: centre and radius of the opening, width of the ring around it (m)."""

    x: float
    y: float
    z: float
    radius: float
    ring: float


def _glass_print(rng: Generator) -> Pixels:
    """The glass of a door seen from the front: a drum with holes, rings, or dark glass; a reflection."""
    side = 256
    y, x = np.mgrid[0:side, 0:side] / side * 2 - 1
    r, angle = np.hypot(x, y), np.arctan2(x, y)
    kind = rng.random()
    dark, light = between(rng, 8, 40), between(rng, 30, 110)
    value = dark + (light - dark) * np.exp(-(((r - between(rng, 0.3, 0.75)) / between(rng, 0.15, 0.35)) ** 2))
    if kind < 0.55:  # the drum shows
        for at in np.linspace(0.25, 0.75, int(rng.integers(3, 7))):
            count = round(50 * at)
            near = np.cos(count * angle + 9 * at) > 0.55
            value[near & (np.abs(r - at) < 0.022)] *= 0.45
        start = between(rng, 0, 6.28)
        for k in range(3):
            turn = np.angle(np.exp(1j * (angle - start - k * 2.094)))
            value[(np.abs(turn) * r < 0.06) & (r > 0.3) & (r < 0.8)] = light * 1.1
    elif kind < 0.75:  # moulded rings
        value += 10 * np.cos(r * between(rng, 12, 40))
    reflection = np.exp(-(((x + between(rng, 0.2, 0.5)) / 0.16) ** 4) - (((y + between(rng, 0.2, 0.5)) / 0.22) ** 4))
    value = value + between(rng, 40, 150) * reflection + 14 * (1 - y) * (r > 0.8)
    tint = np.array([1.0, 1.0, 1.0]) + rng.uniform(-0.06, 0.08, size=3)
    return np.asarray(np.clip(np.round(value[..., None] * tint), 0, 255), dtype=np.uint8)


def _door(b: MeshBuilder, rng: Generator, port: _Port, body: Material, colour: str) -> None:
    """Ring or square frame, glass that bulges out or in, gasket, hinge and grip."""
    turn = rotation("x", 90)
    centre = (port.x, port.y, port.z)
    ring = trim(rng, "door_ring") if chance(rng, 0.7) else body
    inner, outer = port.radius - 0.012, port.radius + port.ring
    out = between(rng, 0.014, 0.042)
    if chance(rng, 0.2):  # a frame with rounded corners
        t = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        hole = port.radius * np.stack([np.cos(t), np.sin(t)], axis=1)
        side = 2 * outer
        frame = rounded_rectangle(side, side, between(rng, 0.15, 0.45) * side)
        b.extrude(frame, out, ring, holes=[hole], centre=centre, acoustic=False)
    else:
        crown = between(rng, 0.2, 0.8)
        profile = [(outer, -0.001), (outer, 0.5 * out), (outer - 0.15 * port.ring, 0.85 * out)]
        profile += [(port.radius + crown * port.ring, out), (port.radius, between(rng, 0.5, 1.0) * out)]
        b.lathe(profile, ring, centre=centre, rotate=turn, segments=56, acoustic=False)
    lip = plastic("door_lip", tone(rng, "#2a2c2f", "#55585c", "#d9dadb"), gloss=0.5)
    b.lathe(
        [(port.radius + 0.001, 0.9 * out), (inner, 0.7 * out), (inner, -0.025)],
        lip,
        centre=centre,
        rotate=turn,
        segments=56,
        acoustic=False,
    )
    bulge = pick(rng, -0.07, -0.04, 0.0, 0.012, 0.03)
    s = np.linspace(0, 1, 8)
    radii = inner * np.cos(s * np.pi / 2) ** 0.8
    profile = np.stack([np.maximum(radii, 0.0), 0.25 * out + bulge * np.sin(s * np.pi / 2)], axis=1)
    _flat_lathe(b, profile, printed("port_glass", _glass_print(rng), acoustic="glass", gloss=0.85), centre)
    side = 1 if chance(rng, 0.7) else -1
    b.box(
        (0.03, between(rng, 0.07, 0.16), 0.018),
        (port.x - side * (outer - 0.004), port.y, port.z + 0.008),
        ring,
        bevel=0.004,
        acoustic=False,
    )
    kind = rng.random()
    at = (port.x + side * (port.radius + 0.45 * port.ring), port.y, port.z + out)
    if kind < 0.5:
        size = (min(0.03, 0.7 * port.ring), between(rng, 0.08, 0.15), 0.012)
        slab(b, size, at, trim(rng, "grip"), corner=0.012, bevel=0.003)
    elif kind < 0.75:
        high = between(rng, 0.05, 0.09)
        grip(
            b,
            ((at[0], at[1] - high, port.z + 0.5 * out), (at[0], at[1] + high, port.z + 0.5 * out)),
            0.035,
            0.008,
            trim(rng, "grip"),
        )


def _flat_lathe(b: MeshBuilder, profile: np.ndarray, material: Material, centre: tuple[float, float, float]) -> None:
    """A lathe about Z with the picture of ``material`` projected onto it from the front."""
    segments = 48
    t = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    x, y = (profile[:, :1] * f(t) for f in (np.cos, np.sin))
    vertices = np.stack([x, y, np.repeat(profile[:, 1:], segments, axis=1)], axis=2).reshape(-1, 3)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij"))
    n = (j + 1) % segments
    a, c, d, e = i * segments + j, i * segments + n, (i + 1) * segments + n, (i + 1) * segments + j
    faces = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, e], axis=1)])
    flat = vertices[:, :2] / (2 * float(profile[:, 0].max())) * 0.99 + 0.5
    b.add(vertices, faces, material, centre=centre, uv=flat[faces], acoustic=False)


def _front_panel(
    b: MeshBuilder, rng: Generator, centre: tuple[float, float, float], size: tuple[float, float], colour: str
) -> None:
    """Drawer, knob, display, keys and name, each perhaps, in any order across the panel."""
    panel = Panel(b, rng, centre, size, colour, name="controls")
    high = size[1]
    parts = {"drawer": between(rng, 0.13, 0.19) if chance(rng, 0.75) else 0.0}
    parts["knob"] = min(high, 0.10) * 0.95 if chance(rng, 0.8) else 0.0
    parts["display"] = between(rng, 0.07, 0.13) if chance(rng, 0.65) else 0.0
    parts["keys"] = between(rng, 0.08, 0.16) if chance(rng, 0.75) or not parts["knob"] else 0.0
    parts["name"] = 0.06 if chance(rng, 0.4) else 0.0
    parts = {name: width for name, width in parts.items() if width > 0}
    if "drawer" in parts and chance(rng, 0.8):  # mostly at the left end
        names = [name for name in parts if name != "drawer"]
        rest = size[0] - parts["drawer"] - 0.02
        centres = dict(zip(names, spread_out(rng, [parts[n] for n in names], rest), strict=True))
        centres = {n: x + (parts["drawer"] + 0.02) / 2 for n, x in centres.items()}
        centres["drawer"] = -size[0] / 2 + parts["drawer"] / 2 + 0.006
    else:
        centres = dict(zip(parts, spread_out(rng, list(parts.values()), size[0]), strict=True))
    for name, x in centres.items():
        width = parts[name]
        if name == "drawer":
            drawer = plastic("drawer", shade(rng, colour, 0.03), gloss=0.4)
            slab(b, (width, 0.85 * high, 0.012), panel.at(x, 0, 0.004), drawer, corner=0.008, bevel=0.004)
            gap = rubber("drawer_grip", "#303336")
            slab(
                b,
                (0.6 * width, 0.16 * high, 0.004),
                panel.at(x, between(rng, -0.3, 0.25) * high, 0.0095),
                gap,
                corner=0.006,
                bevel=0.001,
            )
        elif name == "knob":
            panel.knob(x, 0, between(rng, 0.26, 0.36) * min(high, 0.11), between(rng, 0.014, 0.03))
            for k, text in enumerate(_PROGRAMMES[: int(rng.integers(4, 11))]):
                side = 1 if k % 2 else -1
                panel.text(x + side * 0.55 * min(high, 0.11), (0.4 - 0.2 * (k // 2)) * high, text, 0.007)
        elif name == "display":
            panel.display(
                x,
                0.1 * high,
                (width * 0.9, between(rng, 0.3, 0.5) * high),
                f"{int(rng.integers(4))}:{int(rng.integers(60)):02d}",
            )
        elif name == "keys":
            columns = int(rng.integers(2, 6))
            panel.keys(
                x,
                between(rng, -0.25, 0.15) * high,
                (columns, int(rng.integers(1, 3))),
                (width / columns, 0.24 * high),
                raised=chance(rng, 0.7),
            )
        else:
            panel.text(x, between(rng, -0.2, 0.3) * high, word(rng), 0.014)
    panel.close()


def _plinth(b: MeshBuilder, rng: Generator, width: float, face: float, material: Material) -> None:
    """A line above the plinth and a flap for the filter, both perhaps."""
    gap = plastic("gap_line", "#3a3c3f")
    if chance(rng, 0.6):
        b.box((width - 0.012, 0.003, 0.002), (0, between(rng, 0.09, 0.13), face), gap, acoustic=False)
    kind = rng.random()
    x = (1 if chance(rng, 0.6) else -1) * between(rng, 0.28, 0.38) * width
    if kind < 0.55:
        slab(b, (between(rng, 0.07, 0.12), 0.06, 0.006), (x, 0.055, face + 0.002), material, corner=0.01, bevel=0.003)
        b.box((0.045, 0.007, 0.004), (x, 0.074, face + 0.004), gap, acoustic=False)
    elif kind < 0.75:
        b.cylinder(0.028, 0.006, (x, 0.06, face + 0.002), material, axis="z", segments=24, bevel=0.002, acoustic=False)


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
    port = _Port(between(rng, -0.02, 0.02), 0.10 + room / 2 + between(rng, -1, 1) * slack, face, radius, ring)
    middle = (0.0, (0.018 + shelf) / 2, 0.0)
    housing_with_port(
        b,
        (width, shelf - 0.018, depth),
        body,
        port=(port.x, port.y - middle[1]),
        radius=radius,
        depth=0.03,
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
    _plinth(b, rng, width, face, body)
    panel_y = shelf - band / 2 - 0.004
    same = chance(rng, 0.5)
    ground = colour if same else tone(rng, "#232427", "#efefec", "#c3c6c8", "#4b4e52")
    if chance(rng, 0.5):
        slab(
            b,
            (width - 0.016, band - 0.012, 0.012),
            (0, panel_y, face),
            plastic("fascia", ground),
            corner=0.012,
            bevel=0.004,
        )
        _front_panel(b, rng, (0, panel_y, face + 0.006), (width - 0.045, band - 0.03), ground)
    else:
        b.box(
            (width - 0.012, 0.003, 0.002), (0, panel_y - band / 2, face), plastic("gap_line", "#3a3c3f"), acoustic=False
        )
        _front_panel(b, rng, (0, panel_y, face), (width - 0.035, band - 0.02), ground)
    _door(b, rng, port, body, colour)
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
    lid = body if chance(rng, 0.5) else plastic("lid", tone(rng, "#efefec", "#2b2d30", "#c9cccf"), gloss=0.5)
    flat = rotation("x", -90)
    console = between(rng, 0.09, 0.15)
    behind = chance(rng, 0.6)
    span = depth - console - 0.05
    z = (console / 2 if behind else -console / 2) + (0.0 if behind else 0.01)
    slab(
        b,
        (width - between(rng, 0.03, 0.09), span, 0.022),
        (0, height + 0.008, z),
        lid,
        corner=between(rng, 0.012, 0.05),
        bevel=0.006,
        rotate=flat,
    )
    if chance(rng, 0.45):
        window = glass("lid_glass", tone(rng, "#15181b", "#2b3338", "#4b555c"))
        slab(
            b,
            (0.6 * width, 0.6 * span, 0.004),
            (0, height + 0.0205, z),
            window,
            corner=between(rng, 0.01, 0.09),
            bevel=0.001,
            rotate=flat,
        )
    handle = trim(rng, "lid_grip")
    slab(
        b,
        (between(rng, 0.1, 0.24), 0.022, 0.012),
        (0, height + 0.018, z + span / 2 - 0.02),
        handle,
        corner=0.008,
        bevel=0.003,
        rotate=flat,
    )
    ground = colour if chance(rng, 0.5) else tone(rng, "#232427", "#efefec", "#c3c6c8")
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
        at = (0, height + 0.004, face - console / 2 - 0.01)
        b.box((width - 0.01, console, 0.03), at, body, bevel=0.006, rotate=lean, acoustic=False)
        _top_controls(
            Panel(
                b, rng, np.asarray(at) + lean @ [0, 0, 0.015], (width - 0.04, console - 0.02), ground, lean, "controls"
            )
        )
    _front_marks(b, rng, (width, height), face)
    _plinth(b, rng, width, face, body)
    return finished(b, "floor", between(rng, 0.6, 0.8))


def _front_marks(b: MeshBuilder, rng: Generator, size: tuple[float, float], face: float) -> None:
    """What the plain front of a top loader has: a seam, a name plate or a stripe."""
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
    plate = decals.Canvas(256, 64, "#d9dbdd")
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
    port = _Port(0.0, kick + between(rng, 0.45, 0.55) * (height - kick - 0.08), face, radius, between(rng, 0.02, 0.05))
    middle = (0.0, (kick + height) / 2, 0.0)
    housing_with_port(
        b,
        (width - 0.004, height - kick, depth),
        body,
        port=(0, port.y - middle[1]),
        radius=radius,
        depth=0.03,
        centre=middle,
    )
    band = between(rng, 0.05, 0.085)
    dark = brightness(colour) < 0.5
    ground = tone(rng, "#232427", "#3a3d40") if not dark or chance(rng, 0.5) else tone(rng, "#efefec", "#c3c6c8")
    slab(
        b,
        (width - 0.02, band, 0.010),
        (0, height - band / 2 - 0.008, face),
        plastic("strip", ground),
        corner=0.006,
        bevel=0.002,
    )
    _front_panel(b, rng, (0, height - band / 2 - 0.008, face + 0.005), (width - 0.05, band - 0.012), ground)
    if chance(rng, 0.4):
        y = height - band - 0.03
        grip(b, ((-0.35 * width, y, face), (0.35 * width, y, face)), 0.035, 0.006, chrome("bar"))
    _door(b, rng, port, body, colour)
    return finished(b, "floor", max(0.08, (port.y - radius) / height))


FAMILIES: dict[str, Build] = {"front_door": _front_door, "top_lid": _top_lid, "built_in": _built_in}
