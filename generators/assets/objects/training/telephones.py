"""Telephones for training: desk sets with keys or a dial, cordless sets, wall sets, candlesticks."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import rounded_rectangle, smooth_path
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import plastic, rubber
from generators.assets.objects.training.draw import (
    between,
    chance,
    metal,
    pick,
    shade,
    timber,
    tone,
    trim,
)
from generators.assets.objects.training.panel import Panel, finished
from generators.assets.objects.training.telephone_parts import (
    KEYS,
    add_cord,
    add_dial,
    add_handset,
    add_wedge,
    fill_base_face,
    fill_desk_panel,
    fill_phone_face,
)
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


def _keypad_desk(rng: Generator) -> Design:
    """A desk set with keys: the handset at the left, at the right, or across the back."""
    b = MeshBuilder()
    colour = tone(rng, *_COLOURS)
    body = plastic("body", colour, roughness=between(rng, 0.16, 0.64))
    across = chance(rng, 0.3)
    width, depth = (
        (between(rng, 0.19, 0.24), between(rng, 0.18, 0.23))
        if across
        else (between(rng, 0.18, 0.26), between(rng, 0.19, 0.25))
    )
    rise = (between(rng, 0.02, 0.045), between(rng, 0.055, 0.105))
    slope, middle = add_wedge(b, rng, (width, depth), rise, body)
    turn = rotation("x", slope - 90)
    side = -1 if chance(rng, 0.75) else 1
    grip = body if chance(rng, 0.75) else plastic("grip", tone(rng, "#232427", "#e6e3da", "#4b4e52"), roughness=0.25)
    length = between(rng, 0.19, 0.235)
    well = plastic("well", shade(rng, colour, 0.12))
    if across:
        z = between(rng, 0.3, 0.36) * depth
        b.slab(
            (0.9 * width, 0.055, 0.003), middle + turn @ [0, z, 0.0015], well, corner=0.012, bevel=0.001, rotate=turn
        )
        add_handset(b, rng, length, grip, middle + turn @ [0, z, 0.034], turn @ rotation("x", 90))
        panel_at, size = middle + turn @ [0, -0.16 * depth, 0.0], (0.8 * width, 0.56 * depth)
    else:
        x = side * (width / 2 - 0.042)
        b.slab((0.06, 0.9 * depth, 0.003), middle + turn @ [x, 0, 0.0015], well, corner=0.012, bevel=0.001, rotate=turn)
        add_handset(
            b,
            rng,
            min(length, 1.02 * depth),
            grip,
            middle + turn @ [x, 0, 0.034],
            turn @ rotation("x", 90) @ rotation("y", 90),
        )
        panel_at, size = middle + turn @ [-side * 0.034, 0, 0.0], (width - 0.095, 0.88 * depth)
    fill_desk_panel(Panel(b, rng, panel_at, size, shade(rng, colour, 0.01), turn, "face"))
    edge = -width / 2 if side < 0 else width / 2
    out = -1 if side < 0 else 1
    y, z = rise[0], depth / 2
    add_cord(
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


def _dial_desk(rng: Generator) -> Design:
    """A set with a dial (in some, keys) on its front slope and the handset across a cradle."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng, *_COLOURS)
    body = timber(rng, "body") if chance(rng, 0.12) else plastic("body", colour, roughness=0.16)
    width, depth, high = between(rng, 0.19, 0.26), between(rng, 0.18, 0.23), between(rng, 0.095, 0.14)
    round_, step = between(rng, 0.012, 0.05), between(rng, 0.5, 0.78)
    back = -between(rng, 0.34, 0.42) * depth / 2
    bulge = between(rng, 0.8, 1.7)
    loops = []
    for t in (0.0, 0.05, 0.2, 0.5, 0.8, 0.96, 1.0):
        share = t**bulge
        w, d = width * (1 - (1 - step) * share), depth * (1 - 0.62 * share)
        p = rounded_rectangle(w - (0.008 if t == 1.0 else 0.0), d - (0.008 if t == 1.0 else 0.0), round_)
        loops.append(np.stack([p[:, 0], np.full(len(p), t * high), back * share - p[:, 1]], axis=1))
    b.loft(np.array(loops), body, crease=50)
    for side in (-1, 1):
        x = side * 0.42 * step * width
        b.box((0.02, between(rng, 0.02, 0.035), 0.05), (x, high + 0.008, back), body, bevel=0.004, acoustic=False)
        for dz in (-0.024, 0.024):
            b.box((0.018, 0.03, 0.011), (x, high + 0.026, back + dz), body, bevel=0.004, acoustic=False)
    grip = body if chance(rng, 0.75) else plastic("grip", tone(rng, "#232427", "#e6e3da"), roughness=0.25)
    length = max(between(rng, 0.2, 0.26), step * width + 0.07)
    add_handset(b, rng, length, grip, np.array([0, high + 0.045, back]), np.eye(3))
    low_z, high_z = (
        depth / 2 * (1 - 0.62 * 0.15**bulge) + back * 0.15**bulge,
        depth / 2 * (1 - 0.62 * 0.9**bulge) + back * 0.9**bulge,
    )
    slope = float(np.degrees(np.arctan2(0.75 * high, low_z - high_z)))
    face = rotation("x", slope - 90)
    middle = np.array([0.0, 0.52 * high, 0.5 * (low_z + high_z)]) + face @ [0, 0, between(rng, 0.003, 0.008)]
    radius = min(between(rng, 0.036, 0.05), 0.3 * width, 0.52 * float(np.hypot(0.75 * high, low_z - high_z)))
    if chance(rng, 0.78):
        add_dial(b, rng, middle, face, radius)
    else:
        plate = plastic("plate", tone(rng, "#1d1e20", "#d8dadb", "#e9dfc4"))
        b.slab((2 * radius, 2 * radius, 0.01), middle, plate, corner=0.01, rotate=face)
        panel = Panel(
            b,
            rng,
            middle + face @ [0, 0, 0.005],
            (1.85 * radius, 1.85 * radius),
            shade(rng, colour, 0.02),
            face,
            "face",
        )
        panel.keys(0, 0, (3, 4), (0.6 * radius, 0.45 * radius), KEYS)
        panel.close()
    s = -1 if chance(rng, 0.7) else 1
    add_cord(
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
    body = plastic("body", colour, roughness=0.25)
    second = trim(rng, "second")
    width, depth = between(rng, 0.085, 0.2), between(rng, 0.09, 0.14)
    slope, middle = add_wedge(
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
    _phone(b, rng, foot, lean, (colour, body, second))
    if wide:
        at = middle + turn @ [-np.sign(x) * 0.038, 0.0, 0.0]
        fill_base_face(Panel(b, rng, at, (width - 0.1, 0.7 * depth), shade(rng, colour, 0.01), turn, "base_face"))
    return finished(b, "surface", 0.5)


def _phone(b: MeshBuilder, rng: Generator, foot: Array, lean: Array, finish: tuple[str, Material, Material]) -> None:
    """A cordless handset that stands in its socket at ``foot``, turned by ``lean``; ``finish``: of the set."""
    colour, body, second = finish
    length, broad, thick = between(rng, 0.14, 0.19), between(rng, 0.042, 0.056), between(rng, 0.016, 0.026)
    corner = between(rng, 0.006, 0.5 * broad)
    b.slab(
        (broad + 0.018, 0.035, thick + 0.026),
        foot + lean @ [0, 0.004, 0],
        second if chance(rng, 0.5) else body,
        corner=0.01,
        bevel=0.005,
        rotate=lean,
    )
    phone = body if chance(rng, 0.7) else plastic("phone", tone(rng, "#232427", "#c3c6c8", "#efefec"), roughness=0.25)
    b.slab(
        (broad, length, thick),
        foot + lean @ [0, length / 2 + 0.004, 0],
        phone,
        corner=corner,
        bevel=0.4 * thick,
        rotate=lean,
        acoustic=True,
    )
    back = plastic("phone_back", shade(rng, colour, 0.1), roughness=0.36)
    b.slab(
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
    fill_phone_face(panel)


def _wall_set(rng: Generator) -> Design:
    """A set for the wall: the handset hangs along or beside a plate with keys or a dial."""
    b = MeshBuilder({"body": 0.25})
    colour = tone(rng, *_COLOURS)
    body = timber(rng, "body") if chance(rng, 0.15) else plastic("body", colour, roughness=0.25)
    width, height, depth = between(rng, 0.11, 0.19), between(rng, 0.2, 0.26), between(rng, 0.035, 0.07)
    b.slab(
        (width, height, depth), (0, 0, depth / 2), body, corner=between(rng, 0.006, 0.03), bevel=0.008, acoustic=True
    )
    side = 0 if width < 0.14 and chance(rng, 0.4) else (-1 if chance(rng, 0.8) else 1)
    grip = body if chance(rng, 0.7) else plastic("grip", tone(rng, "#232427", "#e6e3da"), roughness=0.25)
    length = between(rng, 0.19, 0.23)
    if side == 0:  # across the top
        at, way = np.array([0, height / 2 - 0.02, depth + 0.03]), rotation("x", 90)
        for x in (-0.035, 0.035):
            b.box((0.016, 0.03, 0.036), (x, height / 2 - 0.024, depth + 0.012), body, bevel=0.004, acoustic=False)
        low, room = 0.012 - 0.5 * height, 0.64 * height
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
    add_handset(b, rng, length, grip, at, way)
    if chance(rng, 0.4):
        radius = min(0.46 * space, 0.42 * room, 0.05)
        add_dial(b, rng, middle + [0, between(rng, -0.1, 0.1) * room * (side != 0), 0.002], np.eye(3), radius)
    else:
        panel = Panel(b, rng, middle, (space, room), shade(rng, colour, 0.02), None, "face")
        block = min(room, 1.25 * space) * between(rng, 0.72, 0.9)
        panel.keys(0, between(rng, -0.45, 0.2) * (room - block), (3, 4), (0.31 * space, block / 4), KEYS)
        panel.lamp(0.42 * space, 0.46 * room, 0.003)
        panel.close()
    end = at + way @ [-0.46 * length if side else 0.46 * length, -0.01, 0.0]
    if end[1] > 0:
        end = at + way @ [0.46 * length, -0.01, 0.0]
    hang = -height / 2 - between(rng, 0.06, 0.14)
    s = side or 1
    add_cord(
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
    dark = plastic("dark", tone(rng, "#1c1c1e", "#1c1c1e", "#3d2417", "#8f1d1f"), roughness=0.16)
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
    _mouthpiece(b, rng, high, dark)
    _hung_receiver(b, rng, (high, radius, base), shiny, dark)
    if chance(rng, 0.65):
        size = min(0.5 * radius, 0.038)
        slope = rotation("x", -between(rng, 35, 60))
        add_dial(b, rng, np.array([0, 0.62 * base + 0.004, 0.62 * radius]) + slope @ [0, 0, 0.006], slope, size)
    return finished(b, "surface", 0.86)


def _mouthpiece(b: MeshBuilder, rng: Generator, high: float, dark: Material) -> None:
    """The bell to speak into, on a column of height ``high`` (m)."""
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


def _hung_receiver(
    b: MeshBuilder, rng: Generator, size: tuple[float, float, float], shiny: Material, dark: Material
) -> None:
    """A receiver on its hook beside a column, with its cord; ``size``: height, radius and height of the foot (m)."""
    high, radius, base = size
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
    material = rubber("cord", tone(rng, "#3a2c22", "#1d1e20", "#6b4f2a"))
    path = [
        (1.1 * x, hook - 0.112, 0),
        (1.2 * x, 0.5 * hook, -0.03),
        (1.0 * x, 0.06, -0.06),
        (0.4 * x, 0.5 * base, -0.8 * radius),
    ]
    b.tube(smooth_path(path, 26), 0.0028, material, segments=6)


FAMILIES: dict[str, Build] = {
    "keypad_desk": _keypad_desk,
    "dial_desk": _dial_desk,
    "cordless_set": _cordless_set,
    "wall_set": _wall_set,
    "candlestick": _candlestick,
}
