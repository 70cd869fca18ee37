"""Handsets, cords, sloping cases, rotary dials and the faces of telephones."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import coil, grip_loops, rounded_rectangle
from generators.assets.objects import decals
from generators.assets.objects.finishes import Pixels, plastic, printed, rubber
from generators.assets.objects.training.draw import (
    between,
    chance,
    clock_time,
    ink_on,
    metal,
    tone,
    trim,
)
from generators.assets.objects.training.panel import Panel, paste
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


KEYS = "123456789*0#"


def add_handset(b: MeshBuilder, rng: Generator, length: float, material: Material, centre: Array, turn: Array) -> None:
    """A handset along local x, its ear and mouth pieces facing down (−y): arched or straight, round or square ends."""
    half, arch = length / 2, between(rng, 0.008, 0.03)
    square, slim = chance(rng, 0.4), between(rng, 0.8, 1.2)
    x = np.linspace(-0.98 * half, 0.98 * half, 23)
    s = x / half
    y = arch * (1 - s**4)
    grow = between(rng, 0.2, 0.9)
    width = slim * 0.017 * (1 + grow * np.abs(s) ** 3)
    thick = slim * 0.012 * (1 + 0.5 * grow * np.abs(s) ** 3)
    outline = rounded_rectangle(2.0, 2.0, between(rng, 0.3, 0.95), steps=4)
    loops = grip_loops(np.stack([x, y], 1), np.stack([width, thick], 1), outline)
    b.loft(loops, material, centre=centre, rotate=turn, crease=50, acoustic=False)
    big, deep = between(rng, 0.023, 0.031), between(rng, 0.010, 0.018)
    cups = material if chance(rng, 0.75) else trim(rng, "cups")
    for side in (-1, 1):
        cup = centre + turn @ np.array([side * (half - big), -0.012, 0.0])
        if square:
            b.box(
                (2 * big, deep + 0.016, 2 * big * 0.85),
                cup - turn @ [0, deep / 2 - 0.008, 0],
                cups,
                bevel=0.006,
                rotate=turn,
                acoustic=False,
            )
            continue
        profile = [(0.0, -deep), (0.75 * big, -deep), (big, -0.5 * deep), (big, 0.0), (0.8 * big, 0.018), (0.0, 0.022)]
        b.lathe(profile, cups, centre=cup, rotate=turn, segments=24, acoustic=False)


def add_cord(b: MeshBuilder, rng: Generator, path: list[Array] | list[tuple[float, float, float]]) -> None:
    """A coiled cord, of few or many turns."""
    material = rubber("cord", tone(rng, "#1d1e20", "#c9c5ba", "#8d9195", "#5d4a3c"))
    turns = int(rng.integers(18, 32))
    b.tube(coil(np.array(path), between(rng, 0.005, 0.0075), turns), 0.0022, material, segments=5)


def add_wedge(
    b: MeshBuilder, rng: Generator, size: tuple[float, float], rise: tuple[float, float], material: Material
) -> tuple[float, Array]:
    """A sloping case of ``size`` (width, depth) and heights at its front and back; returns slope (°) and top centre."""
    width, depth = size
    front, back = rise
    outline, bevel = rounded_rectangle(width, depth, between(rng, 0.004, 0.045)), between(rng, 0.002, 0.011)
    flare = between(rng, 0.0, 0.012)

    def loop(inset: float, below: float, base: bool = False) -> Array:
        p = outline * [(width - 2 * inset) / width, (depth - 2 * inset) / depth]
        y = np.zeros(len(p)) if base else front + (back - front) * (0.5 + p[:, 1] / depth) - below
        return np.stack([p[:, 0], y, -p[:, 1]], axis=1)

    loops = [loop(0.004 - flare, 0, base=True), loop(-flare, 0, base=True) + [0, 0.006, 0]]
    loops += [loop(bevel * (1 - np.cos(t)), bevel * (1 - np.sin(t))) for t in np.linspace(0, np.pi / 2, 4)]
    b.loft(np.array(loops), material, crease=50)
    return float(np.degrees(np.arctan2(back - front, depth))), np.array([0.0, (front + back) / 2, 0.0])


def fill_desk_panel(panel: Panel) -> None:
    """Digits, function keys, a display or a paper label, a loudspeaker."""
    rng, (width, high) = panel.rng, panel.size
    block = min(width, between(rng, 0.5, 0.62) * high)
    show, y = chance(rng, 0.55), -0.5 * high + 0.5 * block
    pitch = (between(rng, 0.85, 1.0) * min(width, 1.1 * block) / 3, block / 4)
    panel.keys(0, y, (3, 4), pitch, KEYS, raised=chance(rng, 0.85))
    rest = high - block
    if show:
        size = (0.9 * width, 0.5 * rest)
        bezel = plastic("bezel", tone(rng, "#17181a", "#3a3d40", panel.colour))
        at = 0.5 * high - 0.3 * rest
        panel.b.slab((size[0], size[1], 0.008), panel.at(0, at, 0.002), bezel, corner=0.005, rotate=panel.turn)
        ground = tone(rng, "#9fb59a", "#b9cfd8", "#c8ccb8", "#10161a")
        lcd = decals.DecalCanvas(240, max(40, round(240 * size[1] / size[0])), ground)
        lcd.digits((120, lcd.height / 2), clock_time(rng), min(0.5 * lcd.height, 60), ink_on(ground))
        paste(
            panel.b,
            lcd.pixels(),
            panel.at(0, at, 0.0066),
            (size[0] - 0.01, size[1] - 0.008),
            name="lcd",
            turn=panel.turn,
        )
    elif chance(rng, 0.6):
        panel.grille(0, 0.5 * high - 0.4 * rest, (0.6 * width, 0.35 * rest))
    else:
        panel.canvas.box(
            panel.px(-0.4 * width, 0.46 * high), panel.px(0.4 * width, 0.5 * high - 0.5 * rest), "#f1efe6", radius=4
        )
    panel.lamp(0.45 * width, 0.46 * high, 0.003)
    panel.close()


def dial_print(rng: Generator, paper: str) -> Pixels:
    """The ring of numbers under a finger wheel."""
    canvas = decals.DecalCanvas(256, 256, paper)
    for k in range(10):
        a = np.radians(60 - 30 * k)
        canvas.text((128 + 86 * np.cos(a), 128 - 86 * np.sin(a)), str((k + 1) % 10), 34, ink_on(paper), bold=0.8)
    return canvas.pixels()


def add_dial(b: MeshBuilder, rng: Generator, at: Array, face: Array, radius: float) -> None:
    """A rotary dial of ``radius`` at ``at``; local z looks out of the set."""
    axle = face @ rotation("x", 90)
    paper = tone(rng, "#f3efe2", "#1d1e20", "#d8dadb", "#e9dfc4", spread=0.02)
    plate = plastic("number_plate", paper)
    b.lathe(
        [(1.04 * radius, -0.02), (1.04 * radius, 0.006), (0.98 * radius, 0.008), (0.0, 0.008)],
        plate,
        centre=at,
        rotate=axle,
        segments=40,
        acoustic=False,
    )
    ring = np.linspace(0, 2 * np.pi, 41)[:-1]
    circle = np.stack([np.cos(ring), np.sin(ring)], axis=1)
    flat = np.concatenate([[[0.0, 0.0]], circle])
    fan = np.stack([np.zeros(40, dtype=int), 1 + np.arange(40), 1 + (np.arange(40) + 1) % 40], axis=1)
    print_ = printed("numbers", dial_print(rng, paper))
    b.add(
        np.concatenate([flat * radius, np.full((41, 1), 0.0086)], axis=1),
        fan,
        print_,
        centre=at,
        rotate=face,
        uv=((flat + 1) / 2)[fan],
        acoustic=False,
    )
    where, hole = between(rng, 0.68, 0.74) * radius, between(rng, 0.15, 0.175) * radius
    holes = [
        where * np.array([np.cos(a), np.sin(a)]) + hole * circle[::3]
        for a in np.radians([60 - 30 * k for k in range(10)])
    ]
    wheel = (
        metal(rng, "finger_wheel")
        if chance(rng, 0.6)
        else plastic("finger_wheel", tone(rng, "#1d1e20", "#e9e2d0", "#b1302c"), roughness=0.25)
    )
    b.extrude(
        circle * 0.95 * radius, 0.003, wheel, holes=holes, centre=at + face @ [0, 0, 0.011], rotate=face, acoustic=False
    )
    b.lathe(
        [(0.4 * radius, 0.0), (0.39 * radius, 0.003), (0.0, 0.004)],
        plate,
        centre=at + face @ [0, 0, 0.0135],
        rotate=axle,
        segments=24,
        acoustic=False,
    )


def fill_base_face(panel: Panel) -> None:
    """Loudspeaker, and a counter or keys, of an answering machine."""
    rng, (w, h) = panel.rng, panel.size
    if chance(rng, 0.7):
        panel.grille(0, 0.16 * h, (0.7 * w, 0.45 * h))
    if chance(rng, 0.6):
        panel.display(0, -0.34 * h, (0.35 * w, 0.2 * h), str(int(rng.integers(10))))
    else:
        panel.keys(0, -0.32 * h, (2, 1), (0.35 * w, 0.2 * h))
    panel.close()


def fill_phone_face(panel: Panel) -> None:
    """A display above keys, as a handset has."""
    rng, (w, h) = panel.rng, panel.size
    show = between(rng, 0.2, 0.34) * h
    ground = tone(rng, "#bfe0ec", "#9fb59a", "#f2a84a", "#10161a", "#d8e2e6")
    (cx, cy), half = panel.px(0, 0.42 * h - show / 2), (0.44 * w * panel.scale, 0.5 * show * panel.scale)
    panel.canvas.box((cx - half[0], cy - half[1]), (cx + half[0], cy + half[1]), ground, radius=3)
    panel.canvas.digits((cx, cy), clock_time(rng), min(0.9 * half[1], 0.5 * half[0]), ink_on(ground))
    panel.canvas.box(panel.px(-0.2 * w, 0.49 * h), panel.px(0.2 * w, 0.475 * h), "#0a0a0a", radius=1)
    rest = 0.9 * h - show - 0.06 * h
    calls = chance(rng, 0.7)
    keys = rest * (0.78 if calls else 0.95)
    panel.keys(0, -0.48 * h + keys / 2, (3, 4), (0.31 * w, keys / 4), KEYS, raised=chance(rng, 0.75))
    if calls:
        y = -0.48 * h + keys + 0.1 * rest
        for x, colour in ((-0.28, "#2f9a4c"), (0.28, "#c2362e")):
            panel.b.slab(
                (0.26 * w, 0.14 * rest, 0.004),
                panel.at(x * w, y, 0.0),
                plastic("call_key", colour),
                corner=0.003,
                bevel=0.001,
                rotate=panel.turn,
            )
    panel.close()
