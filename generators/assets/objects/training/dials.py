"""Dials, hands and bezels of any look, for clocks."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.objects import decals
from generators.assets.objects.finishes import Pixels, enamel, plastic, printed
from generators.assets.objects.training.draw import (
    between,
    brightness,
    chance,
    metal,
    shade,
    tone,
    word,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
Spot = tuple[float, float, float]


ROMAN = ("XII", "I", "II", "III", "IV", "V", "VI", "VII", "VIII", "IX", "X", "XI")


def draw_paper(rng: Generator) -> tuple[str, str]:
    """Colours of a dial and of its print."""
    kind = rng.random()
    paper = tone(rng, "#f4f3ee", "#f2e8d0", "#e6e8ea", spread=0.02)
    if kind > 0.72:
        paper = tone(rng, "#1d1e20", "#23303f", "#3b2a22", "#37586b", "#7c2a26", "#b9a98a")
    if brightness(paper) > 0.45:
        return paper, tone(rng, "#161616", "#161616", "#3a2414", "#22304a", "#7c2a26", spread=0.03)
    return paper, tone(rng, "#f2f2ee", "#e2c58a", "#d9dcde", spread=0.02)


def draw_marks(rng: Generator, canvas: decals.DecalCanvas, ink: str, square: bool) -> None:
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
        label = ROMAN[hour] if "roman" in numerals else str(hour or 12)
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


def draw_face(rng: Generator, square: bool = False) -> tuple[Pixels, str, str]:
    """A dial's picture (384 px), and the colours of its paper and its print."""
    paper, ink = draw_paper(rng)
    canvas = decals.DecalCanvas(384, 384, paper)
    if chance(rng, 0.2) and not square:
        canvas.disc((192, 192), between(rng, 90, 135), shade(rng, paper, 0.12))
    draw_marks(rng, canvas, ink, square)
    return canvas.pixels(), paper, ink


def add_hands(b: MeshBuilder, rng: Generator, centre: Spot, radius: float, ink: str) -> None:
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


def add_dial(b: MeshBuilder, rng: Generator, centre: Spot, radius: float) -> None:
    """A round dial with its hands."""
    pixels, _, ink = draw_face(rng)
    b.disc(radius, centre, "z", printed("dial", pixels, acoustic="paper", roughness=0.64), segments=48)
    x, y, z = centre
    add_hands(b, rng, (x, y, z + 0.0005), radius, ink)


def add_bezel(b: MeshBuilder, rng: Generator, centre: Spot, radius: float, width: float, material: Material) -> None:
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
