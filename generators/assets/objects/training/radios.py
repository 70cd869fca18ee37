"""Radios for training: table sets and portables with one or two loudspeakers, any scale, knobs, keys and handle."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.forms import smooth_path
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import printed, rubber
from generators.assets.objects.radio import XY, aerial, cloth, face, grille, scale_print
from generators.assets.objects.training.draw import (
    VIVID,
    between,
    chance,
    ink_on,
    metal,
    pick,
    shade,
    shell,
    timber,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, feet, finished
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material

Point = tuple[float, float, float]


def _speaker(b: MeshBuilder, rng: Generator, name: str, centre: Point, size: XY) -> None:
    """A loudspeaker: woven cloth, a field of holes, or a round grille in a ring."""
    kind, (x, y, z) = rng.random(), centre
    if kind < 0.35:
        ground = tone(rng, "#b29a6c", "#7d6a4c", "#54504a", "#c8bfa8", "#5b3a30")
        face(b, name, cloth(rng, size, ground, shade(rng, ground, 0.12)), centre, size, "fabric")
        return
    ground = tone(rng, "#3a3d40", "#8d9195", "#c9ccce", "#26282b")
    if kind < 0.65:
        face(b, name, grille(size, ground, "#0b0c0d", between(rng, 0.004, 0.007)), centre, size)
        return
    radius = 0.46 * min(size)
    b.cylinder(radius, 0.008, (x, y, z), metal(rng, "ring"), axis="z", segments=40, bevel=0.002, acoustic=False)
    holes = grille((2 * radius, 2 * radius), ground, "#0b0c0d", between(rng, 0.004, 0.006), round_=True)
    b.disc(0.9 * radius, (x, y, z + 0.0045), "z", printed(name, holes), segments=40)


def _controls(b: MeshBuilder, rng: Generator, centre: Point, size: XY, colour: str) -> None:
    """A scale or a display above, knobs and keys below."""
    x, y, z = centre
    width, height = size
    panel = Panel(b, rng, centre, size, colour)
    if chance(rng, 0.7):
        ground = tone(rng, "#101315", "#2a1d14", "#efe6cf", "#dfe2e4")
        picture = scale_print(
            (0.94 * width, 0.42 * height),
            ground,
            ink_on(ground),
            tone(rng, "#e0452e", "#ff9c4a"),
            between(rng, 0.1, 0.9),
        )
        face(b, "scale", picture, (x, y + 0.25 * height, z + 0.002), (0.94 * width, 0.42 * height))
    else:
        panel.display(0, 0.25 * height, (0.8 * width, 0.36 * height))
    knobs = int(rng.integers(1, 4))
    radius = min(0.19 * height, 0.34 * width / knobs)
    for k in range(knobs):
        panel.knob((k - (knobs - 1) / 2) * 0.9 * width / knobs, -0.18 * height, radius, between(rng, 0.012, 0.022))
    if chance(rng, 0.5):
        panel.keys(0, -0.44 * height, (int(rng.integers(3, 6)), 1), (0.16 * width, 0.09 * height), raised=False)
    else:
        panel.text(0, -0.44 * height, word(rng), 0.06 * height)
    panel.close()


def _front(
    b: MeshBuilder, rng: Generator, size: tuple[float, float, float], low: float, colour: str, speakers: int
) -> None:
    """The loudspeakers and the controls on the front of a case of ``size`` whose lower edge is at ``low``."""
    width, height, depth = size
    y, z = low + height / 2, depth / 2 + 0.0008
    room, high = width - 0.04, height - 0.036
    share = between(rng, 0.36, 0.5) if speakers == 1 else between(rng, 0.30, 0.4)
    middle, each = share * room, (1 - share) * room / speakers
    side = 1 if chance(rng, 0.7) else -1
    if speakers == 1:
        _speaker(b, rng, "speaker", (-side * (room - each) / 2, y, z), (each - 0.012, high))
        centre = side * (room - middle) / 2
    else:
        for k, x in enumerate((-(room - each) / 2, (room - each) / 2)):
            _speaker(b, rng, f"speaker_{k}", (x, y, z), (each - 0.012, high))
        centre = 0.0
    _controls(b, rng, (centre, y, z), (middle, high), colour)


def _table_set(rng: Generator) -> Design:
    """A case of wood or plastic on feet."""
    b = MeshBuilder({"case": 0.4})
    width, height, depth = between(rng, 0.22, 0.40), between(rng, 0.12, 0.22), between(rng, 0.11, 0.19)
    case: Material = timber(rng, "case") if chance(rng, 0.6) else shell(rng, "case", tone(rng, *VIVID, "#efefec"))
    foot = between(rng, 0.006, 0.014)
    bevel = pick(rng, 0.004, 0.012, between(rng, 0.015, 0.03))
    b.box(
        (width, height, depth),
        (0, foot + height / 2, 0),
        case,
        bevel=min(bevel, 0.016),
        segments=int(rng.integers(2, 4)),
    )
    feet(b, (width, depth), between(rng, 0.008, 0.013), foot + 0.003)
    _front(b, rng, (width, height, depth), foot, tone(rng, "#e8dfc8", "#26282b", "#c9ccce", "#8d6a48"), 1)
    return finished(b, "surface", 0.5)


def _boombox(rng: Generator) -> Design:
    """A portable with a handle, an aerial, and one or two loudspeakers."""
    b = MeshBuilder({"case": 0.25})
    speakers = int(rng.integers(1, 3))
    width, height = between(rng, 0.20, 0.28) if speakers == 1 else between(rng, 0.32, 0.44), between(rng, 0.11, 0.20)
    depth = between(rng, 0.06, 0.12)
    colour = tone(rng, *VIVID)
    b.box((width, height, depth), (0, height / 2, 0), shell(rng, "case", colour), bevel=between(rng, 0.006, 0.016))
    _front(b, rng, (width, height, depth), 0.0, tone(rng, "#26282b", "#c9ccce", colour), speakers)
    for k in range(int(rng.integers(0, 6))):
        b.box(
            (0.022, 0.006, 0.014),
            (-0.35 * width + 0.028 * k, height + 0.002, 0.2 * depth),
            rubber("key", "#8d9195"),
            bevel=0.002,
            acoustic=False,
        )
    x, top = width / 2 - 0.012, height + between(rng, 0.03, 0.07)
    half = [(x, height - 0.02, 0), (x, 0.6 * height + 0.4 * top, 0), (x - 0.02, top, 0)]
    bow = [*((-u, v, w) for u, v, w in half), (0, top + 0.002, 0), *reversed(half)]
    b.tube(smooth_path(np.array(bow), 30), between(rng, 0.005, 0.009), trim(rng, "handle"), segments=12)
    if chance(rng, 0.7):
        lean = between(rng, -40, 40)
        place = -np.sign(lean) * (0.5 * width - 0.04)
        aerial(
            b, (float(place), height + 0.003, -depth / 2 + 0.014), lean, between(rng, 0.12, 0.25), metal(rng, "aerial")
        )
    return finished(b, "surface", 0.4)


FAMILIES: dict[str, Build] = {"table_set": _table_set, "boombox": _boombox}
