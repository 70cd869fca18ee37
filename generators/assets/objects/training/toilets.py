"""Toilets for training: a pan of any outline with a tank on it, above it, in a box or behind a panel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import level, smooth_path
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import chrome, paint, plastic
from generators.assets.objects.training.draw import (
    between,
    chance,
    china,
    metal,
    pick,
    shade,
    shell,
    timber,
    tone,
    trim,
)
from generators.assets.objects.training.panel import finished
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Pan:
    """The rim of a bowl: half width, reach forwards and backwards from its middle, height (m); corner exponents."""

    half: float
    front: float
    back: float
    rim: float
    nose: float
    heel: float

    def loop(self, inset: float, y: float, scale: float = 1.0) -> Array:
        """(N, 3) the rim's outline, moved inwards by ``inset`` and scaled, at height ``y``."""
        return level(
            _oval(
                (self.half - inset) * scale,
                (self.front - inset) * scale,
                (self.back - inset) * scale,
                (self.nose, self.heel),
            ),
            y,
        )


def _oval(half: float, front: float, back: float, power: tuple[float, float]) -> Array:
    """(N, 2: x, z) superellipse with one exponent for the front half and one for the back half, as `forms.egg`."""
    t = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    s, c = np.sin(t), np.cos(t)
    p = np.where(c >= 0, 2 / power[0], 2 / power[1])
    return np.stack([half * np.sign(s) * np.abs(s) ** p, np.where(c >= 0, front, -back) * np.abs(c) ** p], axis=1)


def _pan(rng: Generator) -> _Pan:
    half = between(rng, 0.165, 0.205)
    return _Pan(
        half,
        between(rng, 0.22, 0.31),
        between(rng, 0.17, 0.23),
        between(rng, 0.37, 0.46),
        between(rng, 1.9, 3.2),
        between(rng, 2.4, 5.0),
    )


def _bowl(b: MeshBuilder, pan: _Pan, outer: list[Array], material: Material) -> None:
    """``outer`` loops up to the rim, over the rim and down inside, with water."""
    loops = list(outer)
    for inset, y in ((0.0, pan.rim - 0.012), (0.004, pan.rim), (0.032, pan.rim), (0.042, pan.rim - 0.006)):
        loops.append(pan.loop(inset, y))
    for part, dy in ((0.93, 0.03), (0.86, 0.08), (0.70, 0.14), (0.50, 0.185)):
        loops.append(pan.loop(0.042, pan.rim - dy, part))
    b.loft(np.array(loops), material)
    loop = pan.loop(0.042, pan.rim - 0.168, 0.56)
    b.loft(
        np.array([loop, loop + np.array([0, 0.001, 0])]),
        paint("water", "water", "#9fb4bd", roughness=0.01),
        acoustic=False,
    )


def _pedestal(b: MeshBuilder, rng: Generator, pan: _Pan, material: Material, *, reach: float) -> None:
    """A bowl on a foot: waisted or straight down; the foot reaches ``reach`` metres behind the rim's middle."""
    waist, foot = between(rng, 0.42, 0.8), between(rng, 0.5, 0.85)
    bulge = between(rng, 0.55, 0.8)
    loops = []
    for t in (0.0, 0.03, 0.2, 0.45, 0.62, 0.78, 0.9):
        share = np.interp(t, [0.0, 0.2, 0.45, bulge, 1.0], [foot, 0.97 * foot, waist, 0.6 * (waist + 1.05), 1.0])
        ahead = np.interp(t, [0.0, 0.3, 1.0], [0.52 + 0.2 * foot, 0.5 + 0.15 * waist, 1.0])
        behind = np.interp(t, [0.0, 0.4, 0.75, 1.0], [reach, reach, 0.5 * (reach + pan.back), pan.back])
        loops.append(level(_oval(pan.half * share, pan.front * ahead, behind, (pan.nose, 4.0)), t * pan.rim))
    _bowl(b, pan, loops, material)


def _skirt(b: MeshBuilder, rng: Generator, pan: _Pan, material: Material, *, reach: float, start: float = 0.0) -> None:
    """A smooth pan whose sides run back to the wall, from the height ``start`` (0: it stands on the floor)."""
    low, ahead = between(rng, 0.55, 0.9), between(rng, 0.4, 0.85)
    loops = []
    for t in (0.0, 0.04, 0.3, 0.6, 0.85):
        share, front = low + (1 - low) * t**0.8, ahead + (1 - ahead) * t**0.7
        if start:
            share, front = share * (0.75 + 0.25 * t), front * (0.55 + 0.45 * t)
        y = start + t * (pan.rim - start)
        loops.append(level(_oval(pan.half * share, pan.front * front, reach, (pan.nose, 7.0)), y))
    loops.append(level(_oval(pan.half, pan.front, reach, (pan.nose, 7.0)), pan.rim - 0.03))
    _bowl(b, pan, loops, material)


def _seat_and_lid(b: MeshBuilder, rng: Generator, pan: _Pan) -> None:
    """A seat with its lid, up, down or half up; without a lid in few."""
    kind = rng.random()
    if kind < 0.7:
        seat: Material = plastic("seat", tone(rng, "#f3f3f0", "#ebe9e2", spread=0.012), roughness=0.25)
    elif kind < 0.85:
        seat = timber(rng, "seat")
    else:
        seat = plastic("seat", tone(rng, "#232427", "#8d9195", "#3b6b8f", "#c9a7a4", "#5d3b2a"), roughness=0.25)
    y, thick = pan.rim + 0.004, between(rng, 0.014, 0.026)
    width = between(rng, 0.05, 0.075)
    wide = between(rng, -0.004, 0.006)
    rings = [
        (-wide, 0.0),
        (-wide - 0.002, 0.4 * thick),
        (0.006, 0.85 * thick),
        (0.4 * width, thick),
        (0.9 * width, 0.8 * thick),
        (width, 0.0),
    ]
    loops = [pan.loop(inset, y + dy) for inset, dy in rings]
    b.loft(np.array([*loops, loops[0]]), seat, caps="none", crease=60, acoustic=False)
    hinge = np.array([0.0, y + thick + 0.006, -pan.back + 0.012])
    for x in (-0.075, 0.075):
        at = (x, y + 0.6 * thick, hinge[2] - 0.004)
        b.cylinder(0.011, 0.04, at, chrome("hinge"), axis="x", segments=14, acoustic=False)
    if chance(rng, 0.08):
        return
    degrees = 0.0 if chance(rng, 0.45) else between(rng, 86, 92)
    dome = between(rng, 0.016, 0.034)
    rings = [(0.004, 0.0), (-wide, 0.3 * dome), (0.004, 0.65 * dome), (0.02, 0.85 * dome), (0.07, dome)]
    loops = [pan.loop(inset, dy) + np.array([0.0, 0.0, pan.back - 0.012]) for inset, dy in rings]
    b.loft(np.array(loops), seat, centre=hinge, rotate=rotation("x", -degrees), acoustic=False)


def _tank(b: MeshBuilder, rng: Generator, bottom: float, span: tuple[float, float], material: Material) -> None:
    """A tank between the depths ``span`` (m): straight or tapered, rounded or sharp, with a lid and a flush."""
    width, height, deep = between(rng, 0.33, 0.46), between(rng, 0.32, 0.42), span[1] - span[0]
    taper, round_ = between(rng, 0.8, 1.02), between(rng, 2.5, 14.0)
    loops = []
    for t in (0.0, 0.03, 0.5, 0.97, 1.0):
        grow = taper + (1 - taper) * t - (0.03 if t in (0.0, 1.0) else 0.0)
        outline = _oval(width / 2 * grow, deep * 0.62 * grow, deep * 0.38, (round_, 12.0))
        loops.append(level(outline, bottom + t * height))
    z = span[0] + deep * 0.38
    b.loft(np.array(loops), material, centre=(0, 0, z))
    over = between(rng, 0.004, 0.016)
    thick = between(rng, 0.016, 0.045)
    top = bottom + height
    rings = [(0.0, 0.0), (over, 0.2 * thick), (over, 0.7 * thick), (0.3 * over, thick)]
    cover = [
        level(_oval(width / 2 + out, deep * 0.62 + out, deep * 0.38 + 0.3 * out, (round_, 12.0)), top + dy)
        for out, dy in rings
    ]
    b.loft(np.array(cover), material, centre=(0, 0, z), acoustic=False)
    _flush(b, rng, (0.0, top + thick, z + 0.1 * deep), (width / 2 * 0.96, deep * 0.62))


def _flush(b: MeshBuilder, rng: Generator, top: tuple[float, float, float], reach: tuple[float, float]) -> None:
    """A button on top, a lever on the front, or a knob that is pulled."""
    x, y, z = top
    kind = rng.random()
    shiny = metal(rng, "flush") if chance(rng, 0.7) else trim(rng, "flush")
    if kind < 0.45:
        b.cylinder(0.034, 0.006, (x, y + 0.002, z), shiny, bevel=0.002, segments=28, acoustic=False)
        b.cylinder(0.027, 0.006, (x, y + 0.006, z), chrome("button"), bevel=0.002, segments=28, acoustic=False)
    elif kind < 0.6:
        b.slab((0.07, 0.045, 0.008), (x, y + 0.003, z), shiny, corner=0.008, bevel=0.002, rotate=rotation("x", -90))
    elif kind < 0.9:
        side = 1 if chance(rng, 0.3) else -1
        front = z - 0.01 + reach[1] * 0.84
        at = (side * reach[0] * 0.68, y - 0.09, front)
        b.cylinder(0.016, 0.03, at, shiny, axis="z", segments=18, bevel=0.003, acoustic=False)
        b.slab(
            (0.085, 0.018, 0.010),
            (at[0] - side * 0.03, at[1] - 0.004, front + 0.016),
            shiny,
            corner=0.008,
            bevel=0.003,
        )
    else:
        b.cylinder(0.006, 0.03, (x, y + 0.012, z), shiny, segments=12, acoustic=False)
        b.sphere(0.017, (x, y + 0.035, z), shiny, rings=8, segments=16, acoustic=False)


def _with_tank(rng: Generator) -> Design:
    """A tank that stands on the pan."""
    b = MeshBuilder({"seat": 0.3})
    pan, white = _pan(rng), china(rng, "china")
    behind = pan.back + between(rng, 0.17, 0.23)
    if chance(rng, 0.6):
        _pedestal(b, rng, pan, white, reach=between(rng, 0.7, 1.0) * behind)
        b.box(
            (1.7 * pan.half, 0.08, behind - 0.1),
            (0, pan.rim - 0.042, -0.1 - (behind - 0.1) / 2),
            white,
            bevel=0.02,
            acoustic=False,
        )
    else:
        _skirt(b, rng, pan, white, reach=behind)
    _tank(b, rng, pan.rim - 0.006, (-behind, -pan.back - 0.03), white)
    _seat_and_lid(b, rng, pan)
    return finished(b, "floor", between(rng, 0.45, 0.55))


def _low_level(rng: Generator) -> Design:
    """A tank on the wall, joined to the pan by a pipe."""
    b = MeshBuilder({"seat": 0.3})
    pan, white = _pan(rng), china(rng, "china")
    behind = pan.back + between(rng, 0.16, 0.21)
    _pedestal(b, rng, pan, white, reach=between(rng, 0.8, 1.0) * behind)
    b.box(
        (between(rng, 0.9, 1.5) * pan.half, 0.07, behind - 0.12),
        (0, pan.rim - 0.038, -0.10 - (behind - 0.12) / 2),
        white,
        bevel=0.018,
        acoustic=False,
    )
    gap = between(rng, 0.14, 0.34)
    tank = plastic("tank", tone(rng, "#efefec", "#e4e3dd", spread=0.012), roughness=0.25) if chance(rng, 0.4) else white
    _tank(b, rng, pan.rim + gap, (-behind, -pan.back - 0.03), tank)
    pipe = metal(rng, "pipe") if chance(rng, 0.6) else plastic("pipe", "#ececea")
    z = -behind + 0.06
    path = smooth_path(
        [
            (0, pan.rim + gap + 0.01, z),
            (0, pan.rim + 0.06, z),
            (0, pan.rim + 0.01, z + 0.02),
            (0, pan.rim - 0.04, z + 0.04),
        ],
        14,
    )
    b.tube(path, between(rng, 0.016, 0.026), pipe, segments=14)
    _seat_and_lid(b, rng, pan)
    return finished(b, "floor", between(rng, 0.36, 0.42))


def _plate(b: MeshBuilder, rng: Generator, y: float, z: float) -> None:
    """A flush plate on a face at depth ``z``: a rectangle or a disc with one or two keys."""
    frame = (
        trim(rng, "plate")
        if chance(rng, 0.5)
        else plastic("plate", tone(rng, "#f0f0ee", "#e4e3dd", spread=0.01), roughness=0.25)
    )
    width, height = between(rng, 0.19, 0.27), between(rng, 0.12, 0.18)
    corner = pick(rng, 0.004, 0.012, 0.03, 0.08)
    b.slab((width, height, 0.012), (0, y, z + 0.005), frame, corner=corner, bevel=0.003)
    key = trim(rng, "flush_key")
    if chance(rng, 0.5):
        for x, share in ((-0.2, 0.46), (0.24, 0.32)):
            b.slab((share * width, 0.62 * height, 0.008), (x * width, y, z + 0.0125), key, corner=0.005, bevel=0.002)
    else:
        for x, radius in ((-0.2, 0.27), (0.24, 0.2)):
            b.cylinder(
                radius * height,
                0.008,
                (x * width, y, z + 0.013),
                key,
                axis="z",
                segments=28,
                bevel=0.002,
                acoustic=False,
            )


def _boxed(rng: Generator) -> Design:
    """The tank in a box of furniture behind a pan on the floor or hung on the box."""
    b = MeshBuilder({"seat": 0.3, "unit": 0.5})
    pan, white = _pan(rng), china(rng, "china")
    height, width, deep = between(rng, 0.78, 1.2), between(rng, 0.36, 0.66), between(rng, 0.12, 0.19)
    colour = (
        tone(rng) if chance(rng, 0.4) else tone(rng, "#efefec", "#c3c6c8", "#d8d0c0", "#8d9195", "#9fb0b4", "#5b6064")
    )
    unit = (
        timber(rng, "unit")
        if chance(rng, 0.35)
        else paint("unit", "tile" if chance(rng, 0.5) else "wood", shade(rng, colour), roughness=0.49)
    )
    reach = pan.back + between(rng, 0.02, 0.08)
    z = -reach - deep / 2 + 0.004
    b.box((width, height, deep), (0, height / 2, z), unit, bevel=0.004)
    if chance(rng, 0.7):
        cover = shell(rng, "cover", tone(rng), steel=0.0)
        b.box((width + 0.015, 0.022, deep + 0.015), (0, height + 0.011, z), cover, bevel=0.004, acoustic=False)
    joint = plastic("joint", shade(rng, "#6f777b", 0.1))
    step = between(rng, 0.15, 0.4)
    for y in np.arange(step, height - 0.05, step):
        b.box((width - 0.004, 0.003, 0.002), (0, float(y), z + deep / 2), joint, acoustic=False)
    if chance(rng, 0.5):
        _skirt(b, rng, pan, white, reach=reach)
    else:
        _skirt(b, rng, pan, white, reach=reach, start=between(rng, 0.06, 0.15))
    plate_y = between(rng, 0.86, 1.02)
    if height > plate_y + 0.12:
        _plate(b, rng, plate_y, z + deep / 2)
    else:
        _flush(b, rng, (0.0, height + 0.022, z), (0.4 * width, deep / 2))
    _seat_and_lid(b, rng, pan)
    return finished(b, "floor", between(rng, 0.34, 0.4))


FAMILIES: dict[str, Build] = {"with_tank": _with_tank, "low_level": _low_level, "boxed": _boxed}
