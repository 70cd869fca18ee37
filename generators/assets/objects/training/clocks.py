"""Clocks for training: round and angular wall clocks, mantel clocks, alarm clocks, digital clocks, cuckoo clocks."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import rounded_rectangle
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import enamel, plastic, rubber
from generators.assets.objects.training.dials import add_bezel, add_dial, add_hands, draw_face
from generators.assets.objects.training.draw import (
    GLOWS,
    VIVID,
    between,
    chance,
    clock_time,
    metal,
    pick,
    shade,
    timber,
    tone,
)
from generators.assets.objects.training.panel import finished, paste
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
Spot = tuple[float, float, float]
_PLAIN = ("#1d1e20", "#2b2d30", "#efefec", "#e6e3da", "#8d9195", "#5b5d60")


def _case(rng: Generator, name: str = "case") -> Material:
    """Wood, metal or plastic."""
    kind = rng.random()
    if kind < 0.3:
        return timber(rng, name)
    if kind < 0.5:
        return metal(rng, name)
    colour = tone(rng, *VIVID) if kind < 0.68 else tone(rng, *_PLAIN)
    return plastic(name, colour, roughness=between(rng, 0.16, 0.64))


def _round_wall(rng: Generator) -> Design:
    """A round wall clock; some have rays or a second, outer ring."""
    b = MeshBuilder({"case": 0.3, "bezel": 0.3})
    radius, depth = between(rng, 0.125, 0.2), between(rng, 0.022, 0.05)
    case = _case(rng)
    bezel = case if chance(rng, 0.6) else _case(rng, "bezel")
    width = between(rng, 0.008, 0.05)
    b.cylinder(radius + 0.8 * width, depth, (0, 0, depth / 2), case, axis="z", segments=56)
    add_bezel(b, rng, (0, 0, depth), radius, width, bezel)
    if chance(rng, 0.15):  # a sunburst
        count, reach = int(rng.integers(8, 25)), min(between(rng, 0.03, 0.09), 0.285 - radius - width)
        for k in range(count):
            turn = rotation("z", 360 * k / count)
            far = reach * (1.0 if k % 2 else between(rng, 0.6, 1.0))
            at = turn @ np.array([0, radius + width + far / 2 - 0.004, 0]) + [0, 0, 0.4 * depth]
            b.box((0.012, far, 0.008), at, bezel, rotate=turn, acoustic=False)
    add_dial(b, rng, (0, 0, depth + 0.0015), radius)
    return finished(b, "wall", 0.5)


def _angular_wall(rng: Generator) -> Design:
    """A wall clock with a square, oblong, hexagonal or octagonal outline; some have a pendulum box below."""
    b = MeshBuilder({"case": 0.3})
    case = _case(rng)
    depth, radius = between(rng, 0.025, 0.06), between(rng, 0.10, 0.16)
    border = between(rng, 0.012, 0.045)
    sides = int(rng.choice([4, 4, 6, 8, 12]))
    if sides == 4:
        width, height = 2 * (radius + border), 2 * (radius + border) * pick(rng, 1.0, 1.0, between(rng, 1.05, 1.4))
        outline = rounded_rectangle(width, height, between(rng, 0.002, 0.05))
    else:
        turn = np.pi / sides * (1 if chance(rng, 0.7) else 0)
        t = np.linspace(0, 2 * np.pi, sides, endpoint=False) + turn
        outline = (radius + border) / np.cos(np.pi / sides) * np.stack([np.cos(t), np.sin(t)], axis=1)
        height = float(np.ptp(outline[:, 1]))
    b.extrude(outline, depth, case)
    if sides == 4 and chance(rng, 0.45):
        pixels, _, ink = draw_face(rng, square=True)
        side = 2 * radius - 0.004
        paste(b, pixels, (0, 0, depth + 0.001), (side, side), name="dial", acoustic="paper")
        add_hands(b, rng, (0, 0, depth + 0.0015), 0.95 * radius, ink)
    else:
        add_bezel(b, rng, (0, 0, depth), radius, between(rng, 0.006, 0.012), metal(rng, "bezel"))
        add_dial(b, rng, (0, 0, depth + 0.0015), radius)
    if chance(rng, 0.3):
        _pendulum_box(b, rng, -height / 2, depth, case)
    return finished(b, "wall", 0.6)


def _pendulum_box(b: MeshBuilder, rng: Generator, top: float, depth: float, case: Material) -> None:
    """A glazed box below a wall clock with a pendulum in it; ``top``: height of its upper edge (m)."""
    width, height = between(rng, 0.12, 0.18), min(between(rng, 0.12, 0.22), 0.58 + 2 * top)
    middle = top - height / 2 + 0.005
    b.box((width, height, depth), (0, middle, depth / 2), case, bevel=0.003)
    back = decals.DecalCanvas(64, 96, tone(rng, "#1d1712", "#e9dfc4", "#2c2f33"))
    paste(b, back.pixels(), (0, middle, depth + 0.0008), (0.8 * width, 0.85 * height), name="pane", acoustic="glass")
    shiny = metal(rng, "pendulum")
    swing = rotation("z", between(rng, -9, 9))
    start, end = np.array([0, middle + 0.42 * height, depth + 0.003]), swing @ np.array([0, -0.66 * height, 0])
    b.tube([start, start + end], 0.0022, shiny, segments=6)
    b.cylinder(0.14 * width, 0.004, start + end, shiny, axis="z", segments=24, acoustic=False)


def _mantelpiece(rng: Generator) -> Design:
    """A clock to stand on a shelf: arched, gabled, square or drum-shaped on a plinth."""
    b = MeshBuilder({"case": 0.3})
    case = _case(rng)
    radius, depth = between(rng, 0.09, 0.125), between(rng, 0.06, 0.12)
    border, foot = between(rng, 0.012, 0.035), between(rng, 0.012, 0.06)
    half, y = radius + border, foot + radius + border
    kind = int(rng.integers(4))
    t = np.linspace(0, np.pi, 19)
    if kind == 0:
        top = np.stack([half * np.cos(t), y + half * np.sin(t)], axis=1)
    elif kind == 1:
        top = np.array([[half, y + 0.6 * half], [0.0, y + between(rng, 1.3, 1.7) * half], [-half, y + 0.6 * half]])
    elif kind == 2:
        top = np.array([[half, y + half], [-half, y + half]])
    else:  # shoulders that run down to the sides
        x = np.linspace(1, -1, 25)
        half *= between(rng, 1.5, 1.9)
        top = np.stack(
            [half * x, foot + 0.03 + (y - foot + radius + border - 0.03) * np.exp(-((2.1 * x) ** 4) / 4)], axis=1
        )
    outline = np.concatenate([[[-half, foot - 0.004], [half, foot - 0.004]], top])
    b.extrude(outline, depth, case, centre=(0, 0, -depth / 2))
    plinth = case if chance(rng, 0.7) else _case(rng, "plinth")
    b.box((2 * half + 0.03, foot, depth + 0.025), (0, foot / 2, 0), plinth, bevel=between(rng, 0.002, 0.01))
    width = between(rng, 0.004, min(0.014, border))
    add_bezel(b, rng, (0, y, depth / 2), radius, width, metal(rng, "bezel"))
    add_dial(b, rng, (0, y, depth / 2 + 0.0015), radius)
    return finished(b, "surface", y / (y + half))


def _bells(rng: Generator) -> Design:
    """A large alarm clock: a drum on feet with one bell, two bells, a handle or a button on top."""
    b = MeshBuilder({"case": 0.3})
    case, shiny = _case(rng), metal(rng, "bells")
    radius, depth = between(rng, 0.095, 0.12), between(rng, 0.05, 0.1)
    y = radius + between(rng, 0.015, 0.04)
    b.cylinder(radius, depth, (0, y, 0), case, axis="z", segments=48, bevel=between(rng, 0.004, 0.02))
    add_bezel(b, rng, (0, y, depth / 2), radius - 0.012, 0.01, shiny if chance(rng, 0.6) else case)
    add_dial(b, rng, (0, y, depth / 2 + 0.0015), radius - 0.012)
    spread = between(rng, 25, 42)
    for side in (-1, 1):
        turn = rotation("z", side * (180 - spread))
        start, end = (
            np.array([0, y, 0.0]) + turn @ [0, 0.95 * radius, 0],
            np.array([0, y, 0.0]) + turn @ [0, y / np.cos(np.radians(spread)) - 0.008, 0],
        )
        b.tube([start, end], 0.008, shiny, segments=10)
        b.sphere(0.011, end, rubber("foot"), rings=6, segments=12, acoustic=False)
    bells = int(rng.choice([0, 1, 2, 2]))
    size = between(rng, 0.032, 0.052)
    s = np.linspace(0, np.pi / 2, 7)[1:]
    dome = [
        (0.0, 0.004),
        (0.9 * size, 0.003),
        (size, 0.0),
        *np.stack([size * np.cos(s), 0.8 * size * np.sin(s)], axis=1),
    ]
    for angle in {0: (), 1: (0.0,), 2: (-34.0, 34.0)}[bells]:
        turn = rotation("z", angle)
        at = np.array([0, y, 0]) + turn @ [0, radius + 0.018, 0]
        b.lathe(dome, shiny, centre=at, rotate=turn, segments=28, acoustic=False)
        b.tube([at - turn @ [0, 0.025, 0], at + turn @ [0, 0.01, 0]], 0.005, shiny, segments=8)
    if bells != 1:
        s = np.linspace(0.1, np.pi - 0.1, 13)
        reach, rise = between(rng, 0.04, 0.075), between(rng, 0.04, 0.1)
        arch = np.stack([reach * np.cos(s), y + radius - 0.006 + rise * np.sin(s), np.zeros(13)], axis=1)
        b.tube(arch, between(rng, 0.003, 0.007), shiny, segments=8)
    return finished(b, "surface", 0.5)


def _digital(rng: Generator) -> Design:
    """A box with large lit digits: a block, a wedge or a rounded bar."""
    b = MeshBuilder({"case": 0.3})
    kind = rng.random()
    case = (
        timber(rng, "case")
        if kind < 0.3
        else plastic("case", tone(rng, *(VIVID if kind < 0.5 else _PLAIN)), roughness=0.36)
    )
    width, height, depth = between(rng, 0.26, 0.36), between(rng, 0.09, 0.17), between(rng, 0.045, 0.11)
    wall = chance(rng, 0.3)
    b.slab(
        (width, height, depth),
        (0, height / 2, 0),
        case,
        corner=between(rng, 0.004, 0.45 * height),
        bevel=0.006,
        acoustic=True,
    )
    dark = chance(rng, 0.8)
    ground = tone(rng, "#07090b", "#10161a") if dark else tone(rng, "#aab59f", "#b9c0b2", "#d5d8d4")
    glow = tone(rng, *GLOWS, spread=0.03) if dark else "#1a201a"
    w, h = width - between(rng, 0.03, 0.06), height * between(rng, 0.55, 0.78)
    canvas = decals.DecalCanvas(round(900 * w / 0.36), round(900 * h / 0.36), ground)
    high = min(0.8 * canvas.height, canvas.width / 3.6)
    canvas.digits(
        (canvas.width / 2, canvas.height * between(rng, 0.45, 0.52)),
        clock_time(rng),
        high,
        glow,
        shade(rng, ground, 0.03),
    )
    if chance(rng, 0.4):
        canvas.text((0.09 * canvas.width, 0.13 * canvas.height), "AM", 0.12 * canvas.height, glow)
    paste(b, canvas.pixels(), (0, height / 2, depth / 2 + 0.0008), (w, h), name="digits", acoustic="glass")
    keys = plastic("keys", tone(rng, "#c9cccf", "#2b2d30", "#d4772c"))
    count = int(rng.integers(1, 6))
    for k in range(count):
        x = (k - (count - 1) / 2) * 0.12 * width
        size = (0.09 * width, 0.012, 0.3 * depth)
        b.box(size, (x, height + 0.002, 0), keys, bevel=0.003, acoustic=False)
    for x in (-1, 1):
        b.box((0.03, 0.008, 0.8 * depth), (x * 0.3 * width, 0.001, 0), rubber("foot"), bevel=0.002, acoustic=False)
    return finished(b, "wall" if wall else "surface", 0.5)


def _chalet(rng: Generator) -> Design:
    """A cuckoo clock: a house with a gable roof, a small door, a dial, a pendulum and weights."""
    b = MeshBuilder({"case": 0.25, "roof": 0.25})
    case, roof = timber(rng, "case"), timber(rng, "roof")
    width, wall, depth = between(rng, 0.16, 0.23), between(rng, 0.15, 0.2), between(rng, 0.06, 0.1)
    rise = between(rng, 0.06, 0.12)
    half = width / 2
    b.extrude([(-half, 0), (half, 0), (half, wall), (0, wall + rise), (-half, wall)], depth, case)
    slope = float(np.degrees(np.arctan2(rise, half)))
    over = between(rng, 0.03, 0.06)
    length = float(np.hypot(half, rise)) + over
    for side in (-1, 1):
        turn = rotation("z", -side * slope)
        at = (
            np.array([0, wall + rise, 0])
            + turn @ np.array([side * (length / 2 - 0.002), 0.006, 0])
            + [0, 0, depth / 2 + 0.01]
        )
        b.box((length, 0.014, depth + 0.05 * over + 0.02), at, roof, rotate=turn, acoustic=False)
    radius = min(between(rng, 0.045, 0.065), 0.36 * width)
    y = 0.4 * wall
    add_bezel(b, rng, (0, y, depth), radius, 0.008, metal(rng, "bezel") if chance(rng, 0.4) else roof)
    add_dial(b, rng, (0, y, depth + 0.0015), radius)
    door = plastic("door", tone(rng, "#5d351d", "#2f5d3a", "#9d2323", "#e9dfc4"))
    b.slab((0.045, 0.05, 0.006), (0, wall + 0.2 * rise, depth + 0.003), door, corner=0.012, bevel=0.002)
    for side in (-1, 1):
        x = side * between(rng, 0.3, 0.36) * width
        b.slab(
            (0.026, between(rng, 0.03, 0.06), 0.006),
            (x, between(rng, 0.7, 0.8) * wall, depth + 0.003),
            door,
            corner=0.004,
            bevel=0.002,
        )
    shiny = metal(rng, "pendulum")
    z, low = 0.5 * depth, between(rng, 0.08, 0.16)
    b.tube([(0.0, 0.004, z), (0.012, -low, z)], 0.003, shiny, segments=6)
    b.cylinder(
        between(rng, 0.016, 0.028),
        0.005,
        (0.012, -low, z),
        shiny if chance(rng, 0.5) else case,
        axis="z",
        segments=20,
        acoustic=False,
    )
    for side in (-1, 1):
        x, drop = side * 0.028, between(rng, 0.05, 0.2)
        b.tube([(x, 0.004, 0.3 * depth), (x, -drop, 0.3 * depth)], 0.0016, shiny, segments=6)
        b.lathe(
            [(0.0, -0.055), (0.011, -0.04), (0.012, -0.01), (0.004, 0.0), (0.0, 0.002)],
            enamel("weight", "#4a2f1c"),
            centre=(x, -drop, 0.3 * depth),
            segments=14,
            acoustic=False,
        )
    b.box((width + 0.02, 0.014, depth + 0.012), (0, 0.002, (depth + 0.012) / 2), roof, bevel=0.004, acoustic=False)
    return finished(b, "wall", 0.5)


FAMILIES: dict[str, Build] = {
    "round_wall": _round_wall,
    "angular_wall": _angular_wall,
    "mantelpiece": _mantelpiece,
    "bells": _bells,
    "digital": _digital,
    "chalet": _chalet,
}
