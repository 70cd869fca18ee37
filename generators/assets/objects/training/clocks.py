"""Clocks for training: round and angular wall clocks, mantel clocks, alarm clocks, digital clocks, cuckoo clocks."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, enamel, plastic, printed, rubber
from generators.assets.objects.forms import rounded_rectangle, slab
from generators.assets.objects.training.draw import (
    GLOWS,
    VIVID,
    between,
    brightness,
    chance,
    clock_time,
    metal,
    pick,
    shade,
    timber,
    tone,
    word,
)
from generators.assets.objects.training.panel import finished, paste
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
Spot = tuple[float, float, float]
_PLAIN = ("#1d1e20", "#2b2d30", "#efefec", "#e6e3da", "#8d9195", "#5b5d60")
_ROMAN = ("XII", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI")


def _case(rng: Generator, name: str = "case") -> Material:
    """Wood, metal or plastic."""
    kind = rng.random()
    if kind < 0.3:
        return timber(rng, name)
    if kind < 0.5:
        return metal(rng, name)
    colour = tone(rng, *VIVID) if kind < 0.68 else tone(rng, *_PLAIN)
    return plastic(name, colour, gloss=between(rng, 0.2, 0.6))


def _paper(rng: Generator) -> tuple[str, str]:
    """Colours of a dial and of its print."""
    kind = rng.random()
    paper = tone(rng, "#f4f3ee", "#f2e8d0", "#e6e8ea", spread=0.02)
    if kind > 0.72:
        paper = tone(rng, "#1d1e20", "#23303f", "#3b2a22", "#37586b", "#7c2a26", "#b9a98a")
    if brightness(paper) > 0.45:
        return paper, tone(rng, "#161616", "#161616", "#3a2414", "#22304a", "#7c2a26", spread=0.03)
    return paper, tone(rng, "#f2f2ee", "#e2c58a", "#d9dcde", spread=0.02)


def _marks(rng: Generator, canvas: decals.Canvas, ink: str, square: bool) -> None:
    """Numerals, ticks, rings and a name on a dial, in any combination."""
    size = canvas.width
    middle = (size / 2, size / 2)
    numerals = ("arabic", "roman", "quarters", "roman quarters", "none", "arabic", "roman")[int(rng.integers(7))]
    ticks = ("both", "hours", "dots", "none" if numerals in ("arabic", "roman") else "hours")[int(rng.integers(4))]
    outer = between(rng, 0.44, 0.475)
    heavy = between(rng, 0.6, 1.7)
    for minute in range(60):
        whole = minute % 5 == 0
        if ticks == "none" or (not whole and ticks != "both"):
            continue
        angle = np.radians(6 * minute)
        stretch = 1 / max(abs(np.sin(angle)), abs(np.cos(angle))) if square else 1.0
        if ticks == "dots":
            at = (
                middle[0] + outer * size * stretch * np.sin(angle),
                middle[1] - outer * size * stretch * np.cos(angle),
            )
            canvas.disc(at, 0.012 * heavy * size, ink)
        else:
            length = (0.055 if whole else 0.025) * stretch
            width = (0.018 if whole else 0.006) * size * heavy
            canvas.ray(middle, 6 * minute, (outer * stretch - length) * size, outer * stretch * size, ink, width)
    radius, high = between(rng, 0.31, 0.36), between(rng, 0.075, 0.13)
    for hour in range(12):
        if numerals == "none" or ("quarters" in numerals and hour % 3):
            continue
        label = _ROMAN[hour] if "roman" in numerals else str(hour or 12)
        angle = np.radians(30 * hour)
        stretch = min(1.18, 1 / max(abs(np.sin(angle)), abs(np.cos(angle)))) if square else 1.0
        at = (size / 2 + radius * stretch * size * np.sin(angle), size / 2 - radius * stretch * size * np.cos(angle))
        canvas.text(
            at, label, (0.8 if "roman" in numerals else 1.0) * high * size, ink, bold=0.004 * size * (heavy - 0.6)
        )
    if chance(rng, 0.5) and not square:
        canvas.disc(middle, between(rng, 0.2, 0.27) * size, None, outline=ink, width=0.004 * size)
    if chance(rng, 0.5):
        canvas.text((size / 2, between(rng, 0.62, 0.68) * size), word(rng), 0.042 * size, ink)


def _face(rng: Generator, square: bool = False) -> tuple[Pixels, str, str]:
    """A dial's picture (384 px), and the colours of its paper and its print."""
    paper, ink = _paper(rng)
    canvas = decals.Canvas(384, 384, paper)
    if chance(rng, 0.2) and not square:
        canvas.disc((192, 192), between(rng, 90, 135), shade(rng, paper, 0.12))
    _marks(rng, canvas, ink, square)
    return canvas.pixels(), paper, ink


def _hands(b: MeshBuilder, rng: Generator, centre: Spot, radius: float, ink: str) -> None:
    """Two or three hands that show any time: bars, tapered, lances or leaves."""
    minutes = float(rng.integers(720))
    dark = metal(rng, "hands") if chance(rng, 0.15) else enamel("hands", ink)
    second = plastic("second_hand", tone(rng, "#c0261f", "#d4772c", "#1f5c9e", ink))
    kind, width, reach = int(rng.integers(4)), between(rng, 0.03, 0.075), between(rng, 0.72, 0.86)
    tail = between(rng, 0.02, 0.2)
    specs = [
        (minutes / 2, reach * between(rng, 0.56, 0.7), width, dark, 0.003),
        (minutes * 6, reach, 0.72 * width, dark, 0.005),
    ]
    if chance(rng, 0.7):
        specs.append((6.0 * float(rng.integers(60)), between(rng, 0.75, 0.88), 0.014, second, 0.007))
    for degrees, far, wide, material, lift in specs:
        w, r, t = wide * radius / 2, far * radius, tail * radius
        shapes = (
            [(-w, -t), (w, -t), (w, r), (-w, r)],
            [(-w, -t), (w, -t), (0.4 * w, r), (-0.4 * w, r)],
            [(-0.4 * w, -t), (0.4 * w, -t), (w, 0.72 * r), (0, r), (-w, 0.72 * r)],
            [(-0.3 * w, -t), (0.3 * w, -t), (1.1 * w, 0.4 * r), (0.1 * w, r), (-0.1 * w, r), (-1.1 * w, 0.4 * r)],
        )
        at = np.asarray(centre) + [0, 0, lift]
        b.extrude(shapes[kind], 0.0012, material, centre=at, rotate=rotation("z", -degrees), acoustic=False)
    x, y, z = centre
    b.cylinder(
        between(rng, 0.03, 0.07) * radius, 0.009, (x, y, z + 0.0055), dark, axis="z", segments=18, acoustic=False
    )


def _dial(b: MeshBuilder, rng: Generator, centre: Spot, radius: float) -> None:
    """A round dial with its hands."""
    pixels, _, ink = _face(rng)
    b.disc(radius, centre, "z", printed("dial", pixels, acoustic="paper", gloss=0.2), segments=48)
    x, y, z = centre
    _hands(b, rng, (x, y, z + 0.0005), radius, ink)


def _bezel(b: MeshBuilder, rng: Generator, centre: Spot, radius: float, width: float, material: Material) -> None:
    """A ring about a dial of ``radius``: flat, rounded or stepped."""
    high = between(rng, 0.006, 0.026)
    kind = int(rng.integers(3))
    outer, inner = radius + width, radius - 0.002
    crown = {
        0: [(outer, 0.8 * high), (outer - 0.1 * width, high), (inner + 0.1 * width, high)],
        1: [(outer - 0.15 * width, 0.6 * high), (outer - 0.5 * width, high), (inner + 0.15 * width, 0.6 * high)],
        2: [
            (outer, 0.4 * high),
            (outer - 0.45 * width, 0.5 * high),
            (outer - 0.5 * width, high),
            (inner + 0.1 * width, high),
        ],
    }[kind]
    profile = [(outer, -0.004), *crown, (inner, 0.0)]
    b.lathe(profile, material, centre=centre, rotate=rotation("x", 90), segments=56, acoustic=False)


def _round_wall(rng: Generator) -> Design:
    """A round wall clock; some have rays or a second, outer ring."""
    b = MeshBuilder({"case": 0.3, "bezel": 0.3})
    radius, depth = between(rng, 0.125, 0.2), between(rng, 0.022, 0.05)
    case = _case(rng)
    bezel = case if chance(rng, 0.6) else _case(rng, "bezel")
    width = between(rng, 0.008, 0.05)
    b.cylinder(radius + 0.8 * width, depth, (0, 0, depth / 2), case, axis="z", segments=56)
    _bezel(b, rng, (0, 0, depth), radius, width, bezel)
    if chance(rng, 0.15):  # a sunburst
        count, reach = int(rng.integers(8, 25)), between(rng, 0.03, 0.09)
        for k in range(count):
            turn = rotation("z", 360 * k / count)
            far = reach * (1.0 if k % 2 else between(rng, 0.6, 1.0))
            at = turn @ np.array([0, radius + width + far / 2 - 0.004, 0]) + [0, 0, 0.4 * depth]
            b.box((0.012, far, 0.008), at, bezel, rotate=turn, acoustic=False)
    _dial(b, rng, (0, 0, depth + 0.0015), radius)
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
        pixels, _, ink = _face(rng, square=True)
        side = 2 * radius - 0.004
        paste(b, pixels, (0, 0, depth + 0.001), (side, side), name="dial", acoustic="paper")
        _hands(b, rng, (0, 0, depth + 0.0015), 0.95 * radius, ink)
    else:
        _bezel(b, rng, (0, 0, depth), radius, between(rng, 0.006, 0.012), metal(rng, "bezel"))
        _dial(b, rng, (0, 0, depth + 0.0015), radius)
    if chance(rng, 0.3):
        _pendulum_box(b, rng, -height / 2, depth, case)
    return finished(b, "wall", 0.6)


def _pendulum_box(b: MeshBuilder, rng: Generator, top: float, depth: float, case: Material) -> None:
    """A glazed box below a wall clock with a pendulum in it; ``top``: height of its upper edge (m)."""
    width, height = between(rng, 0.12, 0.18), between(rng, 0.12, 0.22)
    middle = top - height / 2 + 0.005
    b.box((width, height, depth), (0, middle, depth / 2), case, bevel=0.003)
    back = decals.Canvas(64, 96, tone(rng, "#1d1712", "#e9dfc4", "#2c2f33"))
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
    _bezel(b, rng, (0, y, depth / 2), radius, width, metal(rng, "bezel"))
    _dial(b, rng, (0, y, depth / 2 + 0.0015), radius)
    return finished(b, "surface", y / (y + half))


def _bells(rng: Generator) -> Design:
    """A large alarm clock: a drum on feet with one bell, two bells, a handle or a button on top."""
    b = MeshBuilder({"case": 0.3})
    case, shiny = _case(rng), metal(rng, "bells")
    radius, depth = between(rng, 0.095, 0.12), between(rng, 0.05, 0.1)
    y = radius + between(rng, 0.015, 0.04)
    b.cylinder(radius, depth, (0, y, 0), case, axis="z", segments=48, bevel=between(rng, 0.004, 0.02))
    _bezel(b, rng, (0, y, depth / 2), radius - 0.012, 0.01, shiny if chance(rng, 0.6) else case)
    _dial(b, rng, (0, y, depth / 2 + 0.0015), radius - 0.012)
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
        timber(rng, "case") if kind < 0.3 else plastic("case", tone(rng, *(VIVID if kind < 0.5 else _PLAIN)), gloss=0.4)
    )
    width, height, depth = between(rng, 0.26, 0.36), between(rng, 0.09, 0.17), between(rng, 0.045, 0.11)
    wall = chance(rng, 0.3)
    slab(
        b,
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
    canvas = decals.Canvas(round(900 * w / 0.36), round(900 * h / 0.36), ground)
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
    _bezel(b, rng, (0, y, depth), radius, 0.008, metal(rng, "bezel") if chance(rng, 0.4) else roof)
    _dial(b, rng, (0, y, depth + 0.0015), radius)
    door = plastic("door", tone(rng, "#5d351d", "#2f5d3a", "#9d2323", "#e9dfc4"))
    slab(b, (0.045, 0.05, 0.006), (0, wall + 0.2 * rise, depth + 0.003), door, corner=0.012, bevel=0.002)
    for side in (-1, 1):
        x = side * between(rng, 0.3, 0.36) * width
        slab(
            b,
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
