"""Vacuum cleaners for training: sledges with hose and wand, uprights, tubs, sticks, robots."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import egg, level, smooth_path
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import enamel, glass, plastic, rubber
from generators.assets.objects.training.draw import between, chance, metal, pick, tone, word
from generators.assets.objects.training.panel import Panel, finished, finished_at
from generators.assets.objects.training.vacuum_parts import (
    add_floor_head,
    add_hose,
    add_wand,
    add_wheel,
    draw_two_tones,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
Spot = tuple[float, float, float]


def _sledge(rng: Generator) -> Design:
    """A canister on wheels with a hose to a wand that stands before or beside it."""
    b = MeshBuilder()
    colour, body, dark = draw_two_tones(rng)
    half, front, back = between(rng, 0.105, 0.15), between(rng, 0.17, 0.25), between(rng, 0.15, 0.22)
    lift, low, high = between(rng, 0.02, 0.05), between(rng, 0.08, 0.13), between(rng, 0.18, 0.29)
    square = between(rng, 2.2, 4.5)
    lower = [
        level(egg(half * s, front * s, back * s, squareness=square), y)
        for s, y in ((0.72, lift), (0.92, 0.7 * lift + 0.3 * low), (1.0, low))
    ]
    b.loft(np.array(lower), dark)
    dome = between(rng, 1.6, 3.5)
    upper = []
    for t in (0.0, 0.3, 0.6, 0.8, 0.93, 1.0):
        s = max(0.25, (1 - t**dome) ** (1 / dome)) if t < 1 else 0.2
        upper.append(
            level(
                egg(0.985 * half * s, 0.96 * front * s, 0.97 * back * s, squareness=square),
                low - 0.003 + t * (high - low),
            )
        )
    b.loft(np.array(upper), body)
    wheel = between(rng, 0.04, 0.1)
    for side in (-1, 1):
        add_wheel(
            b, (side * (half + 0.01), 0.0, -between(rng, 0.25, 0.5) * back), wheel, between(rng, 0.025, 0.05), body
        )
    b.cylinder(
        0.026, 0.034, (0, 0.026, 0.7 * front), rubber("castor"), axis="x", bevel=0.006, segments=20, acoustic=False
    )
    _sledge_top(b, rng, (half, front, back, high), colour, body, dark)
    side = 1 if chance(rng, 0.5) else -1
    top = np.array([side * between(rng, 0.04, 0.16), between(rng, 0.72, 0.98), between(rng, 0.0, 0.1)])
    foot = np.array([side * between(rng, 0.1, 0.24), 0.05, front + between(rng, 0.14, 0.3)])
    nose = np.array([0, 0.5 * (low + high), 0.86 * front])
    b.cylinder(0.030, 0.05, nose, dark, axis="z", segments=20, bevel=0.005, acoustic=False)
    loop = between(rng, 0.12, 0.2)
    path = [
        nose,
        nose + [0, 0.015, 0.07],
        np.array([-side * 0.5 * loop, 0.25, front + 0.11]),
        np.array([-side * loop, 0.48, 0.2]),
    ]
    path += [
        np.array([-side * 0.6 * loop, 0.83 * top[1], -0.02]),
        np.array([0.2 * top[0], top[1] + 0.02, -0.08]),
        top + [-0.2 * top[0], 0.05, -0.03],
        top,
    ]
    add_hose(b, rng, path)
    add_wand(b, rng, top, foot, dark)
    add_floor_head(b, rng, (float(foot[0]), 0.0, float(foot[2]) + 0.02), dark)
    return finished_at(b, "floor", 0.0, 0.5 * (low + high))


def _sledge_top(
    b: MeshBuilder, rng: Generator, size: tuple[float, float, float, float], colour: str, body: Material, dark: Material
) -> None:
    """Handle, buttons, and a see-through bin or the lid of a bag; ``size``: half width, front, back, height (m)."""
    half, front, back, high = size
    if chance(rng, 0.45):
        radius, tall = between(rng, 0.045, 0.065), between(rng, 0.08, 0.16)
        z = between(rng, 0.1, 0.35) * front
        bin_glass = glass("bin", tone(rng, "#5d6b73", "#8fa0a5", "#6b5d63"))
        b.cylinder(radius, tall, (0, high - 0.04 + tall / 2, z), bin_glass, bevel=0.008, segments=32, acoustic=False)
        b.cylinder(radius + 0.004, 0.02, (0, high - 0.036 + tall, z), body, bevel=0.007, segments=32, acoustic=False)
    else:
        outline = egg(0.55 * half, 0.4 * front, 0.3 * back, squareness=3.0)
        b.loft(
            np.array([level(outline * s, high + dy) for s, dy in ((1.0, -0.03), (1.0, 0.004), (0.9, 0.01))]),
            dark,
            centre=(0, 0, 0.15 * front),
            acoustic=False,
        )
    rise = between(rng, 0.03, 0.07)
    path = [
        (0, 0.86 * high, -0.75 * back),
        (0, high + rise, -0.6 * back),
        (0, high + rise, -0.15 * back),
        (0, high - 0.01, 0.0),
    ]
    b.tube(smooth_path(path, 20), between(rng, 0.009, 0.014), dark, segments=10)
    button = plastic("button", tone(rng, "#cfd2d5", "#d4772c", "#b4282c", "#1c1d1f"))
    for x in (-0.4, 0.4)[: int(rng.integers(1, 3))]:
        b.cylinder(
            0.018, 0.05, (x * half, high - 0.035, -0.35 * back), button, bevel=0.004, segments=20, acoustic=False
        )


def _tilted(rng: Generator, b: MeshBuilder, body: Material, dark: Material) -> tuple[Array, Array]:
    """The motor head of an upright; returns its lean (3, 3) and pivot (3,)."""
    half, front, back = between(rng, 0.135, 0.18), between(rng, 0.12, 0.17), between(rng, 0.11, 0.15)
    high = between(rng, 0.07, 0.13)
    outline = egg(half, front, back, squareness=between(rng, 3, 7))
    outline[:, 1] = np.clip(outline[:, 1] * 1.3, -back, front)
    rings = [(0.96, 0.05), (1.0, 0.15), (1.0, 0.45), (0.94, 0.7), (0.8, 0.88), (0.55, 1.0)]
    b.loft(np.array([level(outline * s + [0, 0.06], t * high) for s, t in rings]), body if chance(rng, 0.4) else dark)
    b.slab((1.2 * half, 0.018, 0.008), (0, 0.35 * high, 0.06 + front), body, corner=0.008, bevel=0.002)
    if chance(rng, 0.4):
        lamp = enamel("headlamp", tone(rng, "#e6ecef", "#d8e6ea", spread=0.01))
        b.slab((0.06, 0.018, 0.006), (0, 0.62 * high, 0.055 + front), lamp, corner=0.008, bevel=0.002)
    wheel = between(rng, 0.04, 0.07)
    for side in (-1, 1):
        add_wheel(b, (side * 0.8 * half, 0.0, -0.055), wheel, between(rng, 0.025, 0.04), body)
    return rotation("x", -between(rng, 4, 16)), np.array([0.0, 0.7 * high, -0.02])


def _stand_up(rng: Generator) -> Design:
    """An upright: a motor head, a body with a bag or a bin that leans back, a handle."""
    b = MeshBuilder()
    _, body, dark = draw_two_tones(rng)
    lean, pivot = _tilted(rng, b, body, dark)

    def at(x: float, y: float, z: float) -> Array:
        return np.asarray(pivot + lean @ np.array([x, y, z]))

    half, deep, tall = between(rng, 0.095, 0.14), between(rng, 0.06, 0.095), between(rng, 0.48, 0.7)
    waist, bag = between(rng, 0.7, 1.0), chance(rng, 0.45)
    rings = [(0.7, 0.0), (1.0, 0.08), (1.0, 0.22), (waist, 0.34), (waist, 0.8), (0.7 * waist, 0.95), (0.3, 1.0)]
    shift = 0.0 if bag else -0.35 * deep
    loops = []
    for s, t in rings:
        front = deep * s * (1.0 if bag or t < 0.3 else 0.5)
        loops.append(level(egg(half * s, front, deep * s, squareness=2.8) + [0, shift], t * tall))
    b.loft(np.array(loops), body if bag else dark, centre=pivot, rotate=lean)
    if bag:
        puff = [(0.5, 0.3), (0.86, 0.36), (0.92, 0.6), (0.84, 0.85), (0.4, 0.92)]
        cloth = plastic("bag", tone(rng, "#55585c", "#8c2f2c", "#2b3f5c", "#b9ab8e", "#232427"), roughness=0.9)
        b.loft(
            np.array(
                [level(egg(half * s, deep * 0.6 * s, deep * 0.3 * s) + [0, 0.75 * deep], t * tall) for s, t in puff]
            ),
            cloth,
            centre=pivot,
            rotate=lean,
            acoustic=False,
        )
    else:
        radius, high = between(rng, 0.058, 0.085), between(rng, 0.18, 0.28)
        see = glass("bin", tone(rng, "#66757d", "#8fa0a5", "#7b6870"))
        middle = at(0, 0.56 * tall, 0.45 * deep)
        profile = [(0.0, -0.5), (0.9, -0.5), (1.0, -0.46), (1.0, 0.46), (0.9, 0.5), (0.0, 0.5)]
        b.lathe(
            [(r * radius, h * high) for r, h in profile], see, centre=middle, rotate=lean, segments=32, acoustic=False
        )
        lid = [(1.04 * radius, -0.005), (1.04 * radius, 0.02), (0.7 * radius, 0.05), (0.0, 0.055)]
        b.lathe(lid, body, centre=at(0, 0.56 * tall + high / 2, 0.45 * deep), rotate=lean, segments=32, acoustic=False)
    _upright_handle(b, rng, (lean, pivot), (tall, deep), dark)
    if chance(rng, 0.5):
        x = half + 0.02
        path = [at(0.8 * x, 0.1, -deep), at(x, 0.3, -deep - 0.01), at(0.8 * x, 0.85 * tall, -deep)]
        add_hose(b, rng, [*path, at(0.02, 0.93 * tall, -0.5 * deep)], 70)
    return finished_at(b, "floor", 0.0, 0.26)


def _upright_handle(
    b: MeshBuilder, rng: Generator, frame: tuple[Array, Array], size: tuple[float, float], dark: Material
) -> None:
    """The pole and the grip of an upright that leans by ``frame``; ``size``: height and half depth of its body (m)."""
    (lean, pivot), (tall, deep) = frame, size

    def at(x: float, y: float, z: float) -> Array:
        return np.asarray(pivot + lean @ np.array([x, y, z]))

    end = between(rng, 0.92, 1.12)
    b.tube(
        [at(0, 0.9 * tall, -0.4 * deep), at(0, end - 0.14, -0.4 * deep)],
        between(rng, 0.013, 0.02),
        metal(rng, "pole") if chance(rng, 0.5) else dark,
        segments=14,
    )
    if chance(rng, 0.6):
        loop = [
            (0, end - 0.16, 0.0),
            (0, end - 0.08, 0.035),
            (0, end, 0.02),
            (0, end + 0.01, -0.04),
            (0, end - 0.06, -0.07),
            (0, end - 0.15, -0.02),
        ]
    else:
        loop = [(0, end - 0.15, 0.0), (0, end - 0.06, 0.0), (0, end, 0.03), (0, end + 0.01, 0.09)]
    b.tube(
        smooth_path([at(x, y, z - 0.4 * deep) for x, y, z in loop], 30), between(rng, 0.012, 0.017), dark, segments=10
    )


def _tub(rng: Generator) -> Design:
    """A drum on castors with a motor lid, a hose, and a wand parked beside it."""
    b = MeshBuilder()
    colour, body, dark = draw_two_tones(rng)
    radius, high = between(rng, 0.14, 0.2), between(rng, 0.2, 0.34)
    lift, taper, cap = between(rng, 0.03, 0.07), between(rng, 0.84, 1.05), between(rng, 0.05, 0.14)
    tub = metal(rng, "drum") if chance(rng, 0.2) else body
    b.lathe(
        [
            (0.0, lift),
            (taper * radius - 0.012, lift),
            (taper * radius, lift + 0.012),
            (radius, high),
            (radius, high + 0.012),
        ],
        tub,
        segments=44,
    )
    dome = between(rng, 0.45, 0.9)
    lid = [
        (1.02 * radius, high),
        (1.04 * radius, high + 0.012),
        (1.02 * radius, high + 0.3 * cap),
        (dome * radius + 0.02, high + 0.9 * cap),
        (dome * radius, high + cap),
        (0.0, high + 1.04 * cap),
    ]
    b.lathe(lid, dark, segments=44, acoustic=True)
    count = int(rng.integers(3, 6))
    for k in range(count):
        x, _, z = rotation("y", 30 + 360 * k / count) @ np.array([0, 0, 0.92 * taper * radius])
        b.cylinder(
            lift * 0.55,
            0.022,
            (x, lift * 0.55, z),
            rubber("castor"),
            axis="x",
            segments=16,
            bevel=0.004,
            acoustic=False,
        )
        b.box((0.03, 0.6 * lift, 0.03), (x, lift, z), dark, bevel=0.004, acoustic=False)
    _tub_top(b, rng, (radius, high, cap), dark)
    if chance(rng, 0.35):  # a band
        band = [(radius * taper + 0.003, 0.45 * high), (radius + 0.004, 0.62 * high)]
        b.lathe(band, dark, segments=44, acoustic=False)
    at = (0, 0.3 * high + 0.03, radius * (0.5 + 0.5 * taper) + 0.002)
    panel = Panel(b, rng, at, (0.12, 0.05), colour, name="label")
    panel.text(0, 0, word(rng), 0.02)
    panel.close()
    z = 0.4 * dome * radius
    switch = plastic("switch", tone(rng, "#c8302a", "#e9eaec", "#44a050"))
    b.cylinder(0.018, 0.012, (0, high + 0.98 * cap, z), switch, bevel=0.003, segments=18, acoustic=False)
    _parked_wand(b, rng, (radius, high), dark)
    return finished_at(b, "floor", 0.0, high + 0.4 * cap)


def _tub_top(b: MeshBuilder, rng: Generator, size: tuple[float, float, float], dark: Material) -> None:
    """Clips and the carrying handle of a tub of ``size`` (radius, height, height of its lid; m)."""
    radius, high, cap = size
    for side in (-1, 1):
        b.box((0.012, 0.07, 0.045), (side * 1.03 * radius, high, 0.0), metal(rng, "clip"), bevel=0.004, acoustic=False)
    rise, reach = between(rng, 0.04, 0.09), 0.5 * radius
    path = [
        (-reach, high + 0.8 * cap, 0),
        (-0.9 * reach, high + cap + rise, 0),
        (0.9 * reach, high + cap + rise, 0),
        (reach, high + 0.8 * cap, 0),
    ]
    b.tube(smooth_path(path, 24), between(rng, 0.009, 0.014), dark, segments=10)


def _parked_wand(b: MeshBuilder, rng: Generator, size: tuple[float, float], dark: Material) -> None:
    """The hose of a tub of ``size`` (radius, height; m), and its wand, upright at one side."""
    radius, high = size
    side = 1 if chance(rng, 0.5) else -1
    inlet = np.array([0, 0.68 * high, radius * 1.0])
    b.cylinder(0.031, 0.05, inlet, dark, axis="z", bevel=0.006, segments=24, acoustic=False)
    x = side * (radius + between(rng, 0.06, 0.1))
    top, foot = np.array([x, between(rng, 0.76, 0.98), between(rng, 0.0, 0.06)]), np.array([x, 0.05, 0.05])
    out = [
        inlet,
        inlet + [0, 0.01, 0.07],
        np.array([-side * 0.12, 0.32, radius + 0.1]),
        np.array([-side * 0.2, 0.55, 0.15]),
    ]
    out += [
        np.array([-side * 0.1, 0.95 * top[1], 0.05]),
        np.array([0.3 * x, top[1] + 0.1, 0.0]),
        np.array([0.85 * x, top[1] + 0.08, 0.0]),
        top,
    ]
    add_hose(b, rng, out, 120)
    add_wand(b, rng, top, foot, dark)
    add_floor_head(b, rng, (x, 0.0, 0.07), dark, 90.0)


def _stick(rng: Generator) -> Design:
    """A cordless stick, leaning a little: motor and bin at the top or at the bottom."""
    b = MeshBuilder()
    _, body, dark = draw_two_tones(rng)
    lean, pivot = rotation("x", -between(rng, 3, 14)), np.array([0.0, 0.05, 0.0])

    def at(y: float, z: float = 0.0) -> Array:
        return np.asarray(pivot + lean @ np.array([0.0, y, z]))

    end, high = between(rng, 0.92, 1.12), chance(rng, 0.65)
    tube = metal(rng, "pole") if chance(rng, 0.4) else (body if chance(rng, 0.5) else dark)
    b.tube([at(0.0), at(end - 0.1)], between(rng, 0.014, 0.021), tube, segments=16, acoustic=True)
    add_floor_head(b, rng, (0.0, 0.0, 0.03), dark)
    y = end - between(rng, 0.16, 0.22) if high else between(rng, 0.2, 0.34)
    radius, tall = between(rng, 0.045, 0.068), between(rng, 0.14, 0.26)
    see = glass("bin", tone(rng, "#66757d", "#8fa0a5", "#7b6870"))
    profile = [(0.0, -0.5), (0.9, -0.5), (1.0, -0.44), (1.0, 0.44), (0.9, 0.5), (0.0, 0.5)]
    tilt = lean @ rotation("x", pick(rng, 0.0, 0.0, 60.0) if high else 0.0)
    b.lathe(
        [(r * radius, h * tall) for r, h in profile], see, centre=at(y, 0.055), rotate=tilt, segments=28, acoustic=True
    )
    motor = [
        (0.0, -0.02),
        (radius, -0.02),
        (1.06 * radius, 0.0),
        (1.06 * radius, 0.05),
        (0.7 * radius, 0.075),
        (0.0, 0.08),
    ]
    b.lathe(motor, body, centre=at(y, 0.055) + tilt @ [0, tall / 2, 0], rotate=tilt, segments=28, acoustic=False)
    b.box((0.05, 0.12, 0.06), at(y, 0.0), dark, bevel=0.012, rotate=lean, acoustic=False)
    back = -between(rng, 0.07, 0.12)
    loop = [at(end - 0.26), at(end - 0.2, back), at(end - 0.02, back), at(end, -0.02), at(end - 0.1)]
    b.tube(smooth_path(loop, 28), between(rng, 0.012, 0.017), body if chance(rng, 0.5) else dark, segments=10)
    b.box((0.045, 0.09, 0.05), at(end - 0.24, back * 0.5), dark, bevel=0.01, rotate=lean, acoustic=False)
    return finished(b, "floor", 0.3)


def _robot(rng: Generator) -> Design:
    """A robot: a flat disc or a D, with a bumper, a turret, buttons and a brush."""
    b = MeshBuilder()
    colour = tone(rng, "#232427", "#efefec", "#8d9195", "#4b4e52", "#b9bcbe")
    body, dark = (
        plastic("body", colour, roughness=0.25),
        plastic("bumper", tone(rng, "#26282b", "#3a3d40", "#8d9195"), roughness=0.36),
    )
    radius, high = between(rng, 0.155, 0.19), between(rng, 0.075, 0.105)
    outline = egg(radius, radius, radius, points=56, squareness=2.0)
    if chance(rng, 0.3):
        outline[:, 1] = np.minimum(outline[:, 1], 0.72 * radius)
    rings = [(0.94, 0.012), (1.0, 0.022), (1.0, 0.8 * high), (0.985, 0.93 * high), (0.95, high)]
    b.loft(np.array([level(outline * s, y) for s, y in rings]), dark)
    lid = [(0.94, high - 0.002), (0.94, high + 0.002), (0.9, high + 0.004)]
    b.loft(np.array([level(outline * s, y) for s, y in lid]), body, acoustic=False)
    if chance(rng, 0.65):
        x, z = between(rng, -0.1, 0.1) * radius, -between(rng, 0.1, 0.5) * radius
        b.cylinder(
            between(rng, 0.035, 0.055), 0.03, (x, high + 0.012, z), dark, bevel=0.004, segments=32, acoustic=False
        )
    key = metal(rng, "key")
    for k in range(int(rng.integers(1, 4))):
        b.cylinder(
            between(rng, 0.012, 0.024),
            0.006,
            ((k - 1) * 0.055, high + 0.005, 0.35 * radius),
            key,
            bevel=0.002,
            segments=20,
            acoustic=False,
        )
    for side in (-1, 1):
        b.cylinder(0.03, 0.02, (side * 0.6 * radius, 0.03, 0), rubber("tyre"), axis="x", segments=20, acoustic=False)
    hub = np.array([0.7 * radius, 0.008, 0.55 * radius])
    for k in range(3):
        turn = rotation("y", 120 * k + between(rng, 0, 60))
        b.tube([hub, hub + turn @ [0.0, 0.0, 0.07]], 0.003, plastic("brush", "#d8d8d4"), segments=6)
    return finished(b, "floor", 0.5)


FAMILIES: dict[str, Build] = {"sledge": _sledge, "stand_up": _stand_up, "tub": _tub, "stick": _stick, "robot": _robot}
