"""Telephones for training: desk sets with keys or a dial, cordless sets, wall sets, candlesticks."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, plastic, printed, rubber
from generators.assets.objects.forms import coil, loft, rounded_rectangle, slab, smooth_path
from generators.assets.objects.training.draw import (
    between,
    chance,
    clock_time,
    ink_on,
    metal,
    pick,
    shade,
    timber,
    tone,
    trim,
)
from generators.assets.objects.training.panel import Panel, finished, paste
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
_COLOURS = (
    "#232427",
    "#232427",
    "#efefec",
    "#e6e3da",
    "#8d9195",
    "#4b4e52",
    "#b1302c",
    "#2f5d50",
    "#3b6b8f",
    "#d8b02d",
    "#e9dfc4",
    "#d99aa0",
)
_KEYS = "123456789*0#"


def _handset(b: MeshBuilder, rng: Generator, length: float, material: Material, centre: Array, turn: Array) -> None:
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
    ends = np.ones(len(x))
    ends[[0, -1]], ends[[1, -2]] = 0.55, 0.92
    loops = [
        np.stack(
            [
                np.full(len(outline), x[k]),
                y[k] + outline[:, 1] * thick[k] * ends[k],
                -outline[:, 0] * width[k] * ends[k],
            ],
            axis=1,
        )
        for k in range(len(x))
    ]
    loft(b, np.array(loops), material, centre=centre, rotate=turn, crease=50, acoustic=False)
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


def _cord(b: MeshBuilder, rng: Generator, path: list[Array] | list[tuple[float, float, float]]) -> None:
    """A coiled cord, of few or many turns."""
    material = rubber("cord", tone(rng, "#1d1e20", "#c9c5ba", "#8d9195", "#5d4a3c"))
    turns = int(rng.integers(18, 32))
    b.tube(coil(np.array(path), between(rng, 0.005, 0.0075), turns), 0.0022, material, segments=5)


def _wedge(
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
    loft(b, np.array(loops), material, crease=50)
    return float(np.degrees(np.arctan2(back - front, depth))), np.array([0.0, (front + back) / 2, 0.0])


def _keypad_desk(rng: Generator) -> Design:
    """A desk set with keys: the handset at the left, at the right, or across the back."""
    b = MeshBuilder()
    colour = tone(rng, *_COLOURS)
    body = plastic("body", colour, gloss=between(rng, 0.2, 0.6))
    across = chance(rng, 0.3)
    width, depth = (
        (between(rng, 0.19, 0.24), between(rng, 0.18, 0.23))
        if across
        else (between(rng, 0.18, 0.26), between(rng, 0.19, 0.25))
    )
    rise = (between(rng, 0.02, 0.045), between(rng, 0.055, 0.105))
    slope, middle = _wedge(b, rng, (width, depth), rise, body)
    turn = rotation("x", slope - 90)
    side = -1 if chance(rng, 0.75) else 1
    grip = body if chance(rng, 0.75) else plastic("grip", tone(rng, "#232427", "#e6e3da", "#4b4e52"), gloss=0.5)
    length = between(rng, 0.19, 0.235)
    well = plastic("well", shade(rng, colour, 0.12))
    if across:
        z = between(rng, 0.3, 0.36) * depth
        slab(
            b, (0.9 * width, 0.055, 0.003), middle + turn @ [0, z, 0.0015], well, corner=0.012, bevel=0.001, rotate=turn
        )
        _handset(b, rng, length, grip, middle + turn @ [0, z, 0.034], turn @ rotation("x", 90))
        panel_at, size = middle + turn @ [0, -0.16 * depth, 0.0], (0.8 * width, 0.56 * depth)
    else:
        x = side * (width / 2 - 0.042)
        slab(
            b, (0.06, 0.9 * depth, 0.003), middle + turn @ [x, 0, 0.0015], well, corner=0.012, bevel=0.001, rotate=turn
        )
        _handset(
            b,
            rng,
            min(length, 1.02 * depth),
            grip,
            middle + turn @ [x, 0, 0.034],
            turn @ rotation("x", 90) @ rotation("y", 90),
        )
        panel_at, size = middle + turn @ [-side * 0.034, 0, 0.0], (width - 0.095, 0.88 * depth)
    _desk_panel(Panel(b, rng, panel_at, size, shade(rng, colour, 0.01), turn, "face"))
    edge = -width / 2 if side < 0 else width / 2
    out = -1 if side < 0 else 1
    y, z = rise[0], depth / 2
    _cord(
        b,
        rng,
        [
            (edge * 0.85, y + 0.01, 0.9 * z),
            (edge + out * 0.012, 0.02, z + 0.008),
            (edge + out * 0.03, 0.010, 0.5 * z),
            (edge + out * 0.026, 0.010, -0.3 * z),
            (edge, 0.02, -0.5 * z),
        ],
    )
    return finished(b, "surface", 0.55)


def _desk_panel(panel: Panel) -> None:
    """Digits, function keys, a display or a paper label, a loudspeaker."""
    rng, (width, high) = panel.rng, panel.size
    block = min(width, between(rng, 0.5, 0.62) * high)
    show, y = chance(rng, 0.55), -0.5 * high + 0.5 * block
    pitch = (between(rng, 0.85, 1.0) * min(width, 1.1 * block) / 3, block / 4)
    panel.keys(0, y, (3, 4), pitch, _KEYS, raised=chance(rng, 0.85))
    rest = high - block
    if show:
        size = (0.9 * width, 0.5 * rest)
        bezel = plastic("bezel", tone(rng, "#17181a", "#3a3d40", panel.colour))
        at = 0.5 * high - 0.3 * rest
        slab(panel.b, (size[0], size[1], 0.008), panel.at(0, at, 0.002), bezel, corner=0.005, rotate=panel.turn)
        ground = tone(rng, "#9fb59a", "#b9cfd8", "#c8ccb8", "#10161a")
        lcd = decals.Canvas(240, max(40, round(240 * size[1] / size[0])), ground)
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


def _dial_print(rng: Generator, paper: str) -> Pixels:
    """The ring of numbers under a finger wheel."""
    canvas = decals.Canvas(256, 256, paper)
    for k in range(10):
        a = np.radians(60 - 30 * k)
        canvas.text((128 + 86 * np.cos(a), 128 - 86 * np.sin(a)), str((k + 1) % 10), 34, ink_on(paper), bold=0.8)
    return canvas.pixels()


def _dial(b: MeshBuilder, rng: Generator, at: Array, face: Array, radius: float) -> None:
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
    print_ = printed("numbers", _dial_print(rng, paper))
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
        else plastic("finger_wheel", tone(rng, "#1d1e20", "#e9e2d0", "#b1302c"), gloss=0.5)
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


def _dial_desk(rng: Generator) -> Design:
    """A set with a dial (in some, keys) on its front slope and the handset across a cradle."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng, *_COLOURS)
    body = timber(rng, "body") if chance(rng, 0.12) else plastic("body", colour, gloss=0.6)
    width, depth, high = between(rng, 0.19, 0.26), between(rng, 0.18, 0.23), between(rng, 0.095, 0.14)
    round_, step = between(rng, 0.012, 0.05), between(rng, 0.5, 0.62)
    back = -between(rng, 0.34, 0.42) * depth / 2
    bulge = between(rng, 0.8, 1.3)
    loops = []
    for t in (0.0, 0.05, 0.2, 0.5, 0.8, 0.96, 1.0):
        share = t**bulge
        w, d = width * (1 - (1 - step) * share), depth * (1 - 0.62 * share)
        p = rounded_rectangle(w - (0.008 if t == 1.0 else 0.0), d - (0.008 if t == 1.0 else 0.0), round_)
        loops.append(np.stack([p[:, 0], np.full(len(p), t * high), back * share - p[:, 1]], axis=1))
    loft(b, np.array(loops), body, crease=50)
    for side in (-1, 1):
        x = side * 0.42 * step * width
        b.box((0.02, between(rng, 0.02, 0.035), 0.05), (x, high + 0.008, back), body, bevel=0.004, acoustic=False)
        for dz in (-0.024, 0.024):
            b.box((0.018, 0.03, 0.011), (x, high + 0.026, back + dz), body, bevel=0.004, acoustic=False)
    grip = body if chance(rng, 0.75) else plastic("grip", tone(rng, "#232427", "#e6e3da"), gloss=0.5)
    length = max(between(rng, 0.2, 0.26), step * width + 0.07)
    _handset(b, rng, length, grip, np.array([0, high + 0.045, back]), np.eye(3))
    low_z, high_z = (
        depth / 2 * (1 - 0.62 * 0.15**bulge) + back * 0.15**bulge,
        depth / 2 * (1 - 0.62 * 0.9**bulge) + back * 0.9**bulge,
    )
    slope = float(np.degrees(np.arctan2(0.75 * high, low_z - high_z)))
    face = rotation("x", slope - 90)
    middle = np.array([0.0, 0.52 * high, 0.5 * (low_z + high_z)]) + face @ [0, 0, between(rng, 0.003, 0.008)]
    radius = min(between(rng, 0.036, 0.05), 0.3 * width, 0.52 * float(np.hypot(0.75 * high, low_z - high_z)))
    if chance(rng, 0.78):
        _dial(b, rng, middle, face, radius)
    else:
        plate = plastic("plate", tone(rng, "#1d1e20", "#d8dadb", "#e9dfc4"))
        slab(b, (2 * radius, 2 * radius, 0.01), middle, plate, corner=0.01, rotate=face)
        panel = Panel(
            b,
            rng,
            middle + face @ [0, 0, 0.005],
            (1.85 * radius, 1.85 * radius),
            shade(rng, colour, 0.02),
            face,
            "face",
        )
        panel.keys(0, 0, (3, 4), (0.6 * radius, 0.45 * radius), _KEYS)
        panel.close()
    s = -1 if chance(rng, 0.7) else 1
    _cord(
        b,
        rng,
        [
            (s * length * 0.45, high + 0.03, back),
            (s * (width / 2 + 0.02), 0.6 * high, back),
            (s * (width / 2 + 0.03), 0.014, back + 0.03),
            (s * (width / 2 + 0.02), 0.010, 0.05),
            (s * 0.46 * width, 0.014, 0.35 * depth),
        ],
    )
    return finished(b, "surface", 0.55)


def _cordless_set(rng: Generator) -> Design:
    """A cordless handset that stands or lies in its base; the base may have a grille, keys and a counter."""
    b = MeshBuilder()
    colour = tone(rng, *_COLOURS)
    body = plastic("body", colour, gloss=0.5)
    second = trim(rng, "second")
    width, depth = between(rng, 0.085, 0.2), between(rng, 0.09, 0.14)
    slope, middle = _wedge(
        b,
        rng,
        (width, depth),
        (between(rng, 0.018, 0.034), between(rng, 0.034, 0.065)),
        body if chance(rng, 0.6) else second,
    )
    turn = rotation("x", slope - 90)
    wide = width > 0.14
    x = pick(rng, -1, 1) * (width / 2 - 0.045) if wide else 0.0
    lean = rotation("x", -between(rng, 6, 32))
    foot = np.array([x, middle[1] + 0.004, -0.08 * depth])
    length, broad, thick = between(rng, 0.14, 0.19), between(rng, 0.042, 0.056), between(rng, 0.016, 0.026)
    corner = between(rng, 0.006, 0.5 * broad)
    slab(
        b,
        (broad + 0.018, 0.035, thick + 0.026),
        foot + lean @ [0, 0.004, 0],
        second if chance(rng, 0.5) else body,
        corner=0.01,
        bevel=0.005,
        rotate=lean,
    )
    phone = body if chance(rng, 0.7) else plastic("phone", tone(rng, "#232427", "#c3c6c8", "#efefec"), gloss=0.5)
    slab(
        b,
        (broad, length, thick),
        foot + lean @ [0, length / 2 + 0.004, 0],
        phone,
        corner=corner,
        bevel=0.4 * thick,
        rotate=lean,
        acoustic=True,
    )
    back = plastic("phone_back", shade(rng, colour, 0.1), gloss=0.4)
    slab(
        b,
        (0.98 * broad, 0.98 * length, 0.008),
        foot + lean @ [0, length / 2 + 0.004, -thick / 2 - 0.0035],
        back,
        corner=corner,
        bevel=0.002,
        rotate=lean @ rotation("y", 180),
    )
    if chance(rng, 0.35):
        s = pick(rng, -1, 1) * 0.3 * broad
        b.tube(
            [foot + lean @ [s, length - 0.005, -0.002], foot + lean @ [s, length + between(rng, 0.02, 0.06), -0.002]],
            0.0055,
            phone,
            segments=10,
        )
    panel = Panel(
        b,
        rng,
        foot + lean @ [0, length / 2 + 0.012, thick / 2],
        (0.84 * broad, 0.82 * length),
        shade(rng, colour, 0.02),
        lean,
        "phone_face",
    )
    _phone_face(panel)
    if wide:
        far = Panel(
            b,
            rng,
            middle + turn @ [-np.sign(x) * 0.038 if x else 0.0, 0.0, 0.0],
            (width - 0.1, 0.7 * depth),
            shade(rng, colour, 0.01),
            turn,
            "base_face",
        )
        w, h = far.size
        if chance(rng, 0.7):
            far.grille(0, 0.16 * h, (0.7 * w, 0.45 * h))
        if chance(rng, 0.6):
            far.display(0, -0.34 * h, (0.35 * w, 0.2 * h), str(int(rng.integers(10))))
        else:
            far.keys(0, -0.32 * h, (2, 1), (0.35 * w, 0.2 * h))
        far.close()
    return finished(b, "surface", 0.5)


def _phone_face(panel: Panel) -> None:
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
    panel.keys(0, -0.48 * h + keys / 2, (3, 4), (0.31 * w, keys / 4), _KEYS, raised=chance(rng, 0.75))
    if calls:
        y = -0.48 * h + keys + 0.1 * rest
        for x, colour in ((-0.28, "#2f9a4c"), (0.28, "#c2362e")):
            slab(
                panel.b,
                (0.26 * w, 0.14 * rest, 0.004),
                panel.at(x * w, y, 0.0),
                plastic("call_key", colour),
                corner=0.003,
                bevel=0.001,
                rotate=panel.turn,
            )
    panel.close()


def _wall_set(rng: Generator) -> Design:
    """A set for the wall: the handset hangs along or beside a plate with keys or a dial."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng, *_COLOURS)
    body = timber(rng, "body") if chance(rng, 0.15) else plastic("body", colour, gloss=0.5)
    width, height, depth = between(rng, 0.11, 0.19), between(rng, 0.2, 0.26), between(rng, 0.035, 0.07)
    slab(
        b, (width, height, depth), (0, 0, depth / 2), body, corner=between(rng, 0.006, 0.04), bevel=0.008, acoustic=True
    )
    side = 0 if width < 0.14 and chance(rng, 0.4) else (-1 if chance(rng, 0.8) else 1)
    grip = body if chance(rng, 0.7) else plastic("grip", tone(rng, "#232427", "#e6e3da"), gloss=0.5)
    length = between(rng, 0.19, 0.23)
    if side == 0:  # across the top
        at, way = np.array([0, height / 2 - 0.02, depth + 0.03]), rotation("x", 90)
        for x in (-0.035, 0.035):
            b.box((0.016, 0.03, 0.036), (x, height / 2 - 0.024, depth + 0.012), body, bevel=0.004, acoustic=False)
        low, room = -0.5 * height, 0.68 * height
        middle = np.array([0.0, low + room / 2 + 0.005, depth])
        space = 0.86 * width
    else:
        at, way = np.array([side * (width / 2 - 0.012), 0.0, depth + 0.028]), rotation("x", 90) @ rotation("y", 90)
        b.box(
            (0.05, 0.02, 0.03),
            (side * (width / 2 - 0.03), height / 2 - 0.055, depth + 0.01),
            body,
            bevel=0.004,
            acoustic=False,
        )
        middle, room, space = np.array([-side * 0.02, 0.0, depth]), 0.86 * height, width - 0.055
    _handset(b, rng, length, grip, at, way)
    if chance(rng, 0.4):
        radius = min(0.46 * space, 0.42 * room, 0.05)
        _dial(b, rng, middle + [0, between(rng, -0.1, 0.1) * room * (side != 0), 0.002], np.eye(3), radius)
    else:
        panel = Panel(b, rng, middle, (space, room), shade(rng, colour, 0.02), None, "face")
        block = min(room, 1.25 * space) * between(rng, 0.72, 0.9)
        panel.keys(0, between(rng, -0.45, 0.2) * (room - block), (3, 4), (0.31 * space, block / 4), _KEYS)
        panel.lamp(0.42 * space, 0.46 * room, 0.003)
        panel.close()
    end = at + way @ [-0.46 * length if side else 0.46 * length, -0.01, 0.0]
    if end[1] > 0:
        end = at + way @ [0.46 * length, -0.01, 0.0]
    hang = -height / 2 - between(rng, 0.06, 0.14)
    s = side or 1
    _cord(
        b,
        rng,
        [
            end,
            end + [s * 0.008, -0.04, 0.004],
            np.array([s * 0.05, hang, 0.5 * depth]),
            np.array([s * 0.01, hang + 0.02, 0.45 * depth]),
            np.array([0.0, -height / 2 - 0.002, 0.4 * depth]),
        ],
    )
    return finished(b, "wall", 0.6)


def _candlestick(rng: Generator) -> Design:
    """An old set: a column with a mouthpiece on top, a receiver on a hook, a foot with a dial or plain."""
    b = MeshBuilder({"foot": 0.2})
    shiny = metal(rng, "column")
    dark = plastic("dark", tone(rng, "#1c1c1e", "#1c1c1e", "#3d2417", "#8f1d1f"), gloss=0.6)
    foot = timber(rng, "foot") if chance(rng, 0.35) else (shiny if chance(rng, 0.5) else dark)
    radius, high, base = between(rng, 0.062, 0.085), between(rng, 0.23, 0.3), between(rng, 0.03, 0.06)
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, 0.012),
        (0.9 * radius, 0.6 * base),
        (0.45 * radius, base),
        (0.02, 1.15 * base),
        (0.016, 1.3 * base),
    ]
    b.lathe(profile, foot, segments=44)
    thin = between(rng, 0.010, 0.016)
    b.lathe(
        [
            (1.4 * thin, 1.25 * base),
            (thin, 1.5 * base),
            (thin, high - 0.03),
            (1.5 * thin, high - 0.015),
            (1.2 * thin, high),
            (0.0, high),
        ],
        shiny if chance(rng, 0.6) else dark,
        segments=24,
        acoustic=True,
    )
    mouth = rotation("x", 90 - between(rng, 0, 25))
    at = np.array([0, high - 0.005, 0.005])
    bell = between(rng, 0.026, 0.036)
    b.lathe(
        [
            (0.0, -0.03),
            (0.026, -0.028),
            (0.028, 0.0),
            (0.014, 0.012),
            (0.016, 0.03),
            (bell, 0.062),
            (bell - 0.003, 0.063),
            (0.012, 0.03),
            (0.0, 0.028),
        ],
        dark,
        centre=at,
        rotate=mouth,
        segments=28,
        acoustic=False,
    )
    side = -1 if chance(rng, 0.7) else 1
    hook = high - between(rng, 0.07, 0.1)
    x = side * between(rng, 0.048, 0.062)
    b.tube([(0, hook, 0), (0.8 * x, hook, 0), (x, hook + 0.008, 0)], 0.005, shiny, segments=10)
    for z in (-0.016, 0.016):
        b.tube([(0.6 * x, hook, 0), (x, hook + 0.004, z), (1.15 * x, hook + 0.008, z)], 0.003, shiny, segments=8)
    ear = between(rng, 0.024, 0.03)
    receiver = [
        (0.0, -0.115),
        (0.012, -0.112),
        (0.016, -0.06),
        (0.018, 0.0),
        (0.02, 0.012),
        (ear, 0.03),
        (ear, 0.04),
        (0.01, 0.044),
        (0.0, 0.044),
    ]
    b.lathe(
        receiver,
        dark,
        centre=(1.1 * x, hook + 0.002, 0.0),
        rotate=rotation("z", -side * between(rng, 0, 8)),
        segments=26,
        acoustic=False,
    )
    if chance(rng, 0.65):
        size = min(0.55 * radius, 0.042)
        slope = rotation("x", -between(rng, 35, 60))
        _dial(b, rng, np.array([0, 0.6 * base + 0.008, 0.66 * radius]) + slope @ [0, 0, 0.006], slope, size)
    material = rubber("cord", tone(rng, "#3a2c22", "#1d1e20", "#6b4f2a"))
    path = [
        (1.1 * x, hook - 0.112, 0),
        (1.2 * x, 0.5 * hook, -0.03),
        (1.0 * x, 0.06, -0.06),
        (0.4 * x, 0.5 * base, -0.8 * radius),
    ]
    b.tube(smooth_path(path, 26), 0.0028, material, segments=6)
    return finished(b, "surface", 0.86)


FAMILIES: dict[str, Build] = {
    "keypad_desk": _keypad_desk,
    "dial_desk": _dial_desk,
    "cordless_set": _cordless_set,
    "wall_set": _wall_set,
    "candlestick": _candlestick,
}
