"""Coffee machines for training: portafilter, drip, pod, fully automatic, and stove-top pots."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import rounded_rectangle, smooth_path
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import glass, paint, plastic
from generators.assets.objects.training.coffee_parts import (
    add_cup,
    add_jug,
    add_portafilter,
    add_stack,
    add_tray,
    draw_colour,
)
from generators.assets.objects.training.draw import (
    VIVID,
    between,
    chance,
    metal,
    pick,
    shell,
    spread_out,
    timber,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, feet, finished
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


def _espresso_bar(rng: Generator) -> Design:
    """A boxy espresso machine: one or two groups, knobs, a gauge, a steam wand, a water tank or cups on top."""
    b = MeshBuilder({"shell": 0.25})
    colour = draw_colour(rng)
    body = shell(rng, "shell", colour, steel=0.4)
    shiny, dark = (
        metal(rng, "shiny"),
        timber(rng, "grip") if chance(rng, 0.25) else plastic("grip", tone(rng, "#1c1d1f", "#2b2d30", "#e9e2d0")),
    )
    width, depth, height = between(rng, 0.18, 0.33), between(rng, 0.26, 0.34), between(rng, 0.28, 0.38)
    base, top = between(rng, 0.04, 0.075), between(rng, 0.085, 0.13)
    b.box((width, base, depth), (0, 0.01 + base / 2, 0), body, bevel=between(rng, 0.004, 0.014))
    feet(b, (width, depth), 0.012, 0.014)
    column = between(rng, 0.36, 0.5) * depth
    b.box(
        (width * pick(rng, 1.0, 1.0, 0.8), height - base - top + 0.03, column),
        (0, (height + base - top) / 2 + 0.005, -(depth - column) / 2),
        body,
        bevel=0.006,
    )
    head = between(rng, 0.78, 0.95) * depth
    b.box((width, top, head), (0, height - top / 2, -(depth - head) / 2), body, bevel=between(rng, 0.005, 0.025))
    tray = depth - column - 0.02
    z = -depth / 2 + column + tray / 2 + 0.005
    add_tray(b, 0.86 * width, tray, 0.016 + base, z, shiny)
    under = height - top
    groups = 2 if width > 0.3 and chance(rng, 0.5) else 1
    off = 0.0 if chance(rng, 0.6) or groups == 2 else between(rng, -0.12, 0.12) * width
    for k in range(groups):
        x = off + (k - (groups - 1) / 2) * 0.42 * width
        add_portafilter(b, rng, (x, under - 0.006, z), shiny, dark)
        if chance(rng, 0.7):
            add_cup(b, rng, (x, 0.016 + base, z), between(rng, 0.045, 0.062))
    side = 1 if chance(rng, 0.65) else -1
    front = -depth / 2 + head
    start = np.array([side * 0.42 * width, under + 0.01, min(front - 0.02, z)])
    wand = smooth_path(
        [
            start,
            start + [side * 0.004, -0.03, 0.02],
            start + [side * 0.008, -0.09, 0.035],
            start + [side * 0.012, -0.14, 0.045],
        ],
        14,
    )
    b.tube(wand, 0.005, shiny, segments=8)
    _espresso_front(Panel(b, rng, (0, height - top / 2, front), (width - 0.05, top - 0.03), colour))
    _on_top(b, rng, (width, depth, height), shiny)
    return finished(b, "surface", (height - 0.5 * top) / (height + 0.03))


def _espresso_front(panel: Panel) -> None:
    """Knobs, keys, lamps or a gauge across the head."""
    rng, (width, high) = panel.rng, panel.size
    knobs, gauge, keys = int(rng.integers(0, 4)), chance(rng, 0.5), int(rng.integers(0, 4))
    if knobs + keys == 0:
        keys = 3
    widths = [0.6 * high] * knobs + ([0.75 * high] if gauge else []) + [0.4 * high] * keys
    centres = spread_out(rng, widths, width)
    for x in centres[:knobs]:
        panel.knob(x, 0, 0.22 * high, between(rng, 0.018, 0.032))
    if gauge:
        x = centres[knobs]
        (px, py), r = panel.px(x, 0), 0.36 * high * panel.scale
        panel.canvas.disc((px, py), r, "#f4f2ea", outline="#3a3c3f", width=0.1 * r)
        for k in range(11):
            panel.canvas.ray((px, py), -120 + 24 * k, 0.66 * r, 0.84 * r, "#202020", 0.06 * r)
        panel.canvas.ray((px, py), between(rng, -100, 60), -0.15 * r, 0.7 * r, "#c2241d", 0.08 * r)
    for x in centres[knobs + gauge :]:
        panel.keys(x, 0, (1, 1), (0.4 * high, 0.4 * high))
        panel.lamp(x, 0.36 * high)
    panel.text(between(rng, -0.2, 0.2) * width, -0.42 * high, word(rng), 0.009)
    panel.close()


def _on_top(b: MeshBuilder, rng: Generator, size: tuple[float, float, float], shiny: Material) -> None:
    """Cups inside a rail, a bean hopper, a tank, or nothing."""
    width, depth, height = size
    kind = rng.random()
    if kind < 0.4:
        x, back, ahead = 0.44 * width, -0.42 * depth, 0.22 * depth
        rail = [
            (-x, height + 0.022, ahead),
            (x, height + 0.022, ahead),
            (x, height + 0.022, back),
            (-x, height + 0.022, back),
        ]
        b.tube(rail, 0.003, shiny, segments=8, closed=True)
        for px, _, pz in rail:
            b.tube([(px, height - 0.002, pz), (px, height + 0.022, pz)], 0.003, shiny, segments=8)
        for px in np.linspace(-0.5, 0.5, int(rng.integers(1, 4))) * x:
            add_cup(b, rng, (float(px), height, -0.1 * depth), 0.045)
    elif kind < 0.6:
        clear = glass("hopper", tone(rng, "#5c4a3c", "#8fa0a5", "#3a2c22"))
        radius = between(rng, 0.05, 0.07)
        b.cylinder(
            0.7 * radius,
            0.06,
            (0.2 * width, height + 0.03, -0.15 * depth),
            clear,
            top_radius=radius,
            segments=28,
            acoustic=False,
        )
        b.cylinder(
            1.04 * radius,
            0.01,
            (0.2 * width, height + 0.064, -0.15 * depth),
            plastic("hopper_lid", "#1d1e20"),
            segments=28,
            bevel=0.002,
            acoustic=False,
        )
    elif kind < 0.8:
        b.slab(
            (0.7 * width, 0.5 * depth, 0.012),
            (0, height + 0.004, -0.12 * depth),
            plastic("tank_lid", tone(rng, "#1d1e20", "#8d9195", "#e9eaec")),
            corner=0.012,
            rotate=rotation("x", -90),
        )


def _drip(rng: Generator) -> Design:
    """A filter machine: base with hotplate, column or tank behind, basket above the jug; round or square."""
    b = MeshBuilder({"body": 0.25})
    colour = draw_colour(rng)
    body = shell(rng, "body", colour, steel=0.15)
    band = trim(rng, "band")
    width, depth, height = between(rng, 0.16, 0.24), between(rng, 0.22, 0.30), between(rng, 0.29, 0.4)
    round_ = between(rng, 0.006, 0.085)
    outline = rounded_rectangle(width, depth, round_)
    base, head = between(rng, 0.028, 0.055), between(rng, 0.09, 0.14)
    add_stack(b, outline, [(0.97, 0.0), (1.0, 0.006), (1.0, base - 0.006), (0.97, base)], 0.0, body)
    deep = between(rng, 0.32, 0.42) * depth
    tower = rounded_rectangle(0.96 * width, deep, min(round_, 0.45 * deep))
    see = glass("tank", tone(rng, "#6f8790", "#4b5a61")) if chance(rng, 0.35) else body
    add_stack(b, tower, [(1.0, base - 0.004), (1.0, height - head + 0.01)], -depth / 2 + deep / 2 + 0.006, see)
    tilt = between(rng, 0.8, 0.98)
    add_stack(
        b,
        outline,
        [
            (0.95, height - head),
            (1.0, height - head + 0.008),
            (1.0, height - 0.018),
            (tilt, height - 0.004),
            (tilt - 0.1, height),
        ],
        0.0,
        body,
    )
    if chance(rng, 0.6):
        y = height - head + between(rng, 0.01, 0.03)
        add_stack(b, outline, [(1.005, y), (1.005, y + between(rng, 0.004, 0.012))], 0.0, band)
    z = -depth / 2 + deep + 0.5 * (depth - deep)
    room = height - head - base
    radius = min(0.46 * (depth - deep), 0.42 * width, between(rng, 0.06, 0.085))
    b.cylinder(
        1.05 * radius,
        0.006,
        (0, base + 0.002, z),
        paint("hotplate", "metal", "#2d2e30", roughness=0.36),
        segments=32,
        acoustic=False,
    )
    cone = between(rng, 0.02, 0.05)
    b.cylinder(
        0.6 * radius,
        cone,
        (0, height - head - cone / 2 + 0.004, z),
        body,
        top_radius=0.9 * radius,
        segments=28,
        acoustic=False,
    )
    add_jug(b, rng, base + 0.005, z, (radius, room - cone - 0.012))
    at_top = chance(rng, 0.5)
    y, tall = (height - head / 2 + 0.004, 0.55 * head) if at_top else (base / 2, 0.7 * base)
    size = (max(0.06, width - 2 * round_ - 0.01), tall)
    _drip_front(Panel(b, rng, (0, y, depth / 2 + 0.0002), size, colour), at_top)
    return finished(b, "surface", 0.86)


def _drip_front(panel: Panel, at_top: bool) -> None:
    """Name or display, keys and a lamp, on the head (``at_top``) or on the base."""
    rng, tall = panel.rng, panel.size[1]
    if chance(rng, 0.45) and at_top:
        panel.display(0.1 * panel.size[0], 0.1 * tall, (0.5 * panel.size[0], 0.5 * tall))
    else:
        panel.text(0, 0.2 * tall, word(rng), 0.2 * min(tall, 0.06))
    panel.keys(
        -0.3 * panel.size[0] if at_top else 0, -0.2 * tall, (int(rng.integers(1, 3)), 1), (0.022, min(0.4 * tall, 0.02))
    )
    panel.lamp(0.4 * panel.size[0], -0.25 * tall, 0.003)
    panel.close()


def _pod(rng: Generator) -> Design:
    """A slim capsule machine: an arched or upright body, a lever or a button, a tank behind or at the side."""
    b = MeshBuilder()
    colour = draw_colour(rng)
    body, dark = (
        plastic("body", colour, roughness=0.16),
        plastic("second", tone(rng, "#191a1c", "#8d9195", "#e9eaec", "#3a3d40"), roughness=0.25),
    )
    shiny = metal(rng, "shiny")
    width, height, reach = between(rng, 0.10, 0.17), between(rng, 0.23, 0.32), between(rng, 0.1, 0.15)
    back, neck = -between(rng, 0.12, 0.16), between(rng, 0.35, 0.55)
    chin, nose = between(rng, 0.6, 0.7) * height, between(rng, 0.012, 0.05)
    side = [(back, 0.0), (0.02, 0.0), (0.02, 0.024), (-0.03, 0.05), (-0.035, neck * height), (-0.01, chin)]
    t = np.linspace(0, np.pi / 2, 6)
    side += [(reach - nose + nose * np.sin(a), chin + nose - nose * np.cos(a)) for a in t]
    brow = between(rng, 0.02, min(0.09, height - chin - nose))
    side += [(reach - brow + brow * np.cos(a), height - brow + brow * np.sin(a)) for a in t]
    tail = between(rng, 0.015, 0.08)
    side += [(back + tail - tail * np.sin(a), height - tail + tail * np.cos(a)) for a in t]
    outline = np.array([(-z, y) for z, y in side])[::-1]
    b.extrude(outline, width, body, centre=(-width / 2, 0, 0), rotate=rotation("y", 90))
    stand = min(reach - 0.005, 0.12)
    b.slab(
        (width, 0.13, 0.024),
        (0, 0.012, stand - 0.05),
        dark,
        corner=between(rng, 0.01, 0.06),
        bevel=0.004,
        rotate=rotation("x", -90),
    )
    add_tray(b, 0.65 * width, 0.085, 0.03, stand - 0.05, shiny)
    z = stand - 0.045
    b.cylinder(0.02, 0.03, (0, chin - 0.008, z), dark, top_radius=0.026, segments=24, acoustic=False)
    b.cylinder(0.007, 0.016, (0, chin - 0.03, z), shiny, segments=14, acoustic=False)
    if chance(rng, 0.75):
        add_cup(b, rng, (0, 0.031, z), between(rng, 0.05, min(0.085, chin - 0.075)))
    _pod_top(b, rng, (width, height, reach), shiny)
    tank = glass("tank", tone(rng, "#6f8790", "#4b5a61", "#8fa0a5"))
    high, radius = between(rng, 0.6, 0.9) * height, between(rng, 0.042, 0.06)
    if chance(rng, 0.7):
        b.cylinder(radius, high, (0, 0.008 + high / 2, back - 0.5 * radius), tank, segments=28)
    else:
        s = 1 if chance(rng, 0.5) else -1
        b.box((0.06, high, 0.13), (s * (width / 2 + 0.029), 0.008 + high / 2, back + 0.07), tank, bevel=0.012)
    front = height - brow - chin - nose
    at = (0, chin + nose + 0.45 * front, reach + 0.0004)
    panel = Panel(b, rng, at, (0.6 * width, max(0.016, 0.8 * front)), colour)
    panel.text(0, 0, word(rng), 0.011)
    panel.close()
    return finished(b, "surface", 0.84)


def _pod_top(b: MeshBuilder, rng: Generator, size: tuple[float, float, float], shiny: Material) -> None:
    """A lever and buttons on a machine of ``size`` (width, height, reach of its head; m)."""
    width, height, reach = size
    if chance(rng, 0.55):
        x, up = 0.4 * width, between(rng, 0.02, 0.06)
        bow = [
            (-x, height - 0.03, -0.03),
            (-x, height + up, 0.02),
            (-0.8 * x, height + up, 0.6 * reach),
            (0.8 * x, height + up, 0.6 * reach),
            (x, height + up, 0.02),
            (x, height - 0.03, -0.03),
        ]
        b.tube(smooth_path(bow, 30), between(rng, 0.005, 0.009), shiny, segments=10)
    for k in range(int(rng.integers(1, 4))):
        b.cylinder(
            between(rng, 0.008, 0.014),
            0.006,
            ((k - 1) * 0.032, height + 0.001, 0.0),
            shiny,
            segments=18,
            bevel=0.002,
            acoustic=False,
        )


def _automatic(rng: Generator) -> Design:
    """A bean-to-cup machine: a tall block with a recess, a spout, a display and a bean hopper."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng, "#232427", "#232427", "#c3c6c8", "#8d9195", "#efefec", "#7c1f22")
    body = shell(rng, "body", colour, steel=0.15)
    dark, shiny = plastic("dark", tone(rng, "#16171a", "#2b2d30")), metal(rng, "shiny")
    width, depth, height = between(rng, 0.2, 0.3), between(rng, 0.32, 0.42), between(rng, 0.31, 0.4)
    base, top = between(rng, 0.045, 0.07), between(rng, 0.11, 0.16)
    recess = between(rng, 0.1, 0.15)
    b.box((width, base, depth), (0, 0.006 + base / 2, 0), body, bevel=0.006)
    feet(b, (width, depth), 0.012, 0.01)
    b.box(
        (width, height - base, depth - recess),
        (0, (height + base) / 2, -recess / 2),
        body,
        bevel=between(rng, 0.004, 0.02),
    )
    b.box(
        (width, top, depth - 0.3 * recess), (0, height - top / 2, -0.15 * recess), body, bevel=between(rng, 0.004, 0.02)
    )
    z = depth / 2 - recess
    back = height - top - base
    b.slab((0.86 * width, back, 0.004), (0, base + back / 2, z + 0.002), dark, corner=0.01, bevel=0.001)
    add_tray(b, 0.84 * width, recess - 0.016, 0.012 + base, z + recess / 2, shiny)
    drop = between(rng, 0.3, 0.7) * back
    spout = dark if chance(rng, 0.5) else shiny
    b.box(
        (between(rng, 0.05, 0.08), drop, 0.045),
        (0, height - top - drop / 2 + 0.01, z + 0.035),
        spout,
        bevel=0.008,
        acoustic=False,
    )
    for s in (-1, 1):
        b.cylinder(
            0.006, 0.016, (s * 0.014, height - top - drop + 0.004, z + 0.035), spout, segments=12, acoustic=False
        )
    if chance(rng, 0.7):
        add_cup(b, rng, (0, 0.012 + base, z + 0.045), min(0.07, back - drop - 0.03) if back - drop > 0.07 else 0.035)
    ground = tone(rng, "#0e0f11", colour, "#1d2023")
    front = depth / 2 - 0.3 * recess
    panel = Panel(b, rng, (0, height - top / 2, front), (0.86 * width, 0.74 * top), ground)
    w, h = panel.size
    if chance(rng, 0.8):
        panel.display(between(rng, -0.2, 0.2) * w, 0.12 * h, (0.4 * w, 0.4 * h))
    if chance(rng, 0.5):
        panel.knob((1 if chance(rng, 0.5) else -1) * 0.36 * w, 0.05 * h, 0.13 * h + 0.006, 0.02)
    panel.keys(0, -0.32 * h, (int(rng.integers(3, 7)), 1), (0.13 * w, 0.2 * h), raised=chance(rng, 0.4))
    panel.text(-0.3 * w, 0.42 * h, word(rng), 0.009)
    panel.close()
    clear = glass("hopper", tone(rng, "#4a3a2e", "#3a3c3f", "#6b7a80"))
    b.slab(
        (0.7 * width, 0.4 * depth, between(rng, 0.012, 0.05)),
        (0, height + 0.006, -0.15 * depth),
        clear,
        corner=0.03,
        bevel=0.005,
        rotate=rotation("x", -90),
    )
    return finished(b, "surface", 0.75)


def _stove_pot(rng: Generator) -> Design:
    """A stove-top pot: a faceted or round waisted body with spout, lid knob and handle, on an electric base."""
    b = MeshBuilder({"base": 0.25})
    sides = int(rng.choice([8, 8, 10, 40]))
    body = metal(rng, "pot") if chance(rng, 0.65) else plastic("pot", tone(rng, *VIVID), roughness=0.16)
    dark = (
        timber(rng, "grip")
        if chance(rng, 0.2)
        else plastic("grip", tone(rng, "#1c1d1f", "#1c1d1f", "#8c1f22", "#e9e2d0"))
    )
    radius, low, high = between(rng, 0.052, 0.07), between(rng, 0.075, 0.10), between(rng, 0.08, 0.115)
    plate = between(rng, 0.03, 0.05)
    b.cylinder(
        1.25 * radius,
        plate,
        (0, plate / 2, 0),
        shell(rng, "base", tone(rng, "#232427", "#c3c6c8", "#efefec")),
        segments=40,
        bevel=0.006,
    )
    waist = between(rng, 0.66, 0.8)
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (0.98 * radius, 0.012),
        (waist * radius, low),
        (waist * radius, low + 0.008),
        (between(rng, 0.82, 1.0) * radius, low + high),
    ]
    b.lathe(profile, body, centre=(0, plate, 0), segments=sides, crease=30.0, acoustic=True)
    b.lathe(
        [(0.84 * radius, low - 0.012), (0.9 * radius, low - 0.004), (0.84 * radius, low + 0.008)],
        body,
        centre=(0, plate, 0),
        segments=40,
        acoustic=False,
    )
    _pot_fittings(b, rng, (plate + low + high, high, profile[-1][0], sides), (body, dark))
    panel = Panel(b, rng, (0, plate / 2, 1.25 * radius + 0.0005), (0.03, 0.6 * plate), "#26282b")
    panel.keys(0, 0, (1, 1), (0.02, 0.4 * plate))
    panel.lamp(0.011, 0, 0.002)
    panel.close()
    at = (0, plate / 2, 1.25 * radius - 0.0098)
    b.slab((0.03, 0.7 * plate, 0.02), at, plastic("socket", "#26282b"), corner=0.004, bevel=0.001)
    return finished(b, "surface", 0.55)


def _pot_fittings(
    b: MeshBuilder, rng: Generator, size: tuple[float, float, float, int], materials: tuple[Material, Material]
) -> None:
    """Lid, knob, spout and handle; ``size``: height of the rim, height and radius of the upper part, its sides."""
    (top, high, rim, sides), (body, dark) = size, materials
    b.lathe(
        [(1.03 * rim, -0.003), (1.03 * rim, 0.003), (0.3 * rim, 0.024), (0.0, 0.026)],
        body,
        centre=(0, top, 0),
        segments=sides,
        crease=30.0,
        acoustic=False,
    )
    b.lathe(
        [(0.006, 0.02), (0.008, 0.034), (0.013, 0.044), (0.009, 0.054), (0.0, 0.056)],
        dark,
        centre=(0, top, 0),
        segments=20,
        acoustic=False,
    )
    turn = rotation("y", between(rng, 15, 75) * pick(rng, -1, 1))
    lip = [(0.0, top - 0.055, 0.74 * rim), (0.0, top - 0.02, 1.1 * rim), (0.0, top - 0.001, 1.34 * rim)]
    b.tube(np.array(lip) @ turn.T, [0.012, 0.014, 0.009], body, segments=10)
    bow = [
        (0, top - 0.012, -0.9 * rim),
        (0, top - 0.004, -1.25 * rim),
        (0, top - 0.02, -1.75 * rim),
        (0, top - 0.5 * high, -1.85 * rim),
        (0, top - 0.95 * high, -1.75 * rim),
    ]
    b.tube(smooth_path(bow, 18) @ turn.T, between(rng, 0.008, 0.012), dark, segments=10)


FAMILIES: dict[str, Build] = {
    "espresso_bar": _espresso_bar,
    "drip": _drip,
    "pod": _pod,
    "automatic": _automatic,
    "stove_pot": _stove_pot,
}
