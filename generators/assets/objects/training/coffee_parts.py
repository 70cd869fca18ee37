"""Cups, drip trays, jugs, group heads and colours of coffee machines."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import smooth_path
from generators.assets.objects.finishes import ceramic, glass, paint, plastic, rubber
from generators.assets.objects.training.draw import (
    VIVID,
    between,
    chance,
    metal,
    tone,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


def draw_colour(rng: Generator) -> str:
    """The colour of a case: mostly dark, grey or white."""
    return (
        tone(rng, "#232427", "#232427", "#c3c6c8", "#efefec", "#8d9195")
        if chance(rng, 0.6)
        else tone(rng, *VIVID, "#e9dfc4")
    )


def add_cup(b: MeshBuilder, rng: Generator, at: tuple[float, float, float], height: float) -> None:
    """A cup or a glass of coffee."""
    s, wide = height, between(rng, 0.38, 0.6)
    material = ceramic("cup", tone(rng, "#f4f2ec", "#d8d2c4", "#3b6b8f", "#b4282c", "#232427"))
    profile = [
        (0.0, 0.0),
        (0.6 * wide * s, 0.0),
        (0.85 * wide * s, 0.4 * s),
        (wide * s, s),
        (0.92 * wide * s, s),
        (0.75 * wide * s, 0.4 * s),
        (0.0, 0.34 * s),
    ]
    b.lathe(profile, material, centre=at, segments=24, acoustic=False)
    x, y, z = at
    b.cylinder(
        0.86 * wide * s,
        0.003,
        (x, y + 0.78 * s, z),
        paint("coffee", "water", "#3a2113", roughness=0.25),
        segments=20,
        acoustic=False,
    )
    if chance(rng, 0.7):
        t = np.linspace(-np.pi / 2, np.pi / 2, 8)
        loop = np.stack(
            [x + 0.9 * wide * s + 0.22 * s * np.cos(t), y + 0.55 * s + 0.22 * s * np.sin(t), np.full(8, z)], axis=1
        )
        b.tube(loop, 0.045 * s, material, segments=8)


def add_tray(b: MeshBuilder, width: float, depth: float, y: float, z: float, frame: Material) -> None:
    """A drip tray with bars; ``y``: height of its top, ``z``: its middle."""
    b.box((width, 0.004, depth), (0, y - 0.006, z), rubber("tray_dark", "#151617"), acoustic=False)
    count = max(4, round(width / 0.018))
    for k in range(count):
        b.box((0.005, 0.004, depth), ((k + 0.5) / count * width - width / 2, y - 0.002, z), frame, acoustic=False)
    for side in (-1, 1):
        b.box((width, 0.007, 0.006), (0, y - 0.002, z + side * depth / 2), frame, acoustic=False)


def add_portafilter(
    b: MeshBuilder, rng: Generator, at: tuple[float, float, float], shiny: Material, dark: Material
) -> None:
    """A group head whose underside is at ``at``, with the filter holder in it and its handle."""
    x, y, z = at
    radius = between(rng, 0.03, 0.042)
    b.cylinder(radius + 0.006, 0.03, (x, y + 0.012, z), shiny, bevel=0.003, segments=28, acoustic=False)
    b.cylinder(radius, 0.026, (x, y - 0.014, z), shiny, bevel=0.003, segments=28, acoustic=False)
    b.cylinder(0.7 * radius, 0.012, (x, y - 0.032, z), shiny, top_radius=radius, segments=24, acoustic=False)
    for side in (-1, 1):
        b.tube(
            [(x, y - 0.034, z), (x + side * 0.011, y - 0.044, z), (x + side * 0.011, y - 0.054, z)],
            0.0045,
            shiny,
            segments=8,
        )
    turn = rotation("y", between(rng, -35, 35))
    start = np.array([x, y - 0.016, z])
    along = turn @ np.array([0, -between(rng, 0.02, 0.12), 1.0])
    b.tube([start + 0.8 * radius * along, start + (radius + 0.03) * along], 0.007, shiny, segments=10)
    far = radius + between(rng, 0.1, 0.13)
    b.tube(
        [start + (radius + 0.025) * along, start + (radius + 0.05) * along, start + far * along],
        [0.010, 0.0125, 0.0135],
        dark,
        segments=14,
    )


def add_stack(b: MeshBuilder, outline: Array, levels: list[tuple[float, float]], z: float, material: Material) -> None:
    """A loft of ``outline`` (N, 2: x, z) about depth ``z`` through (scale, height) ``levels``."""
    loops = [np.stack([outline[:, 0] * s, np.full(len(outline), y), z - outline[:, 1] * s], axis=1) for s, y in levels]
    b.loft(np.array(loops), material)


def add_jug(b: MeshBuilder, rng: Generator, y: float, z: float, size: tuple[float, float]) -> None:
    """A glass or steel jug of ``size`` (radius, height; m) that stands at (y, z)."""
    radius, high = size
    lid = plastic("jug_lid", tone(rng, "#1b1c1e", "#2b2d30", "#8d9195", "#e9eaec"))
    fill = between(rng, 0.25, 0.6)
    belly = between(rng, 0.3, 0.6)
    shape = [(0.0, 0.0), (0.8, 0.0), (0.92, 0.06), (1.0, belly), (0.86, 0.8), (0.72, 0.92)]
    profile = np.array([(r * radius, h * high) for r, h in shape])
    if chance(rng, 0.25):
        b.lathe(profile, metal(rng, "jug"), centre=(0, y, z), segments=32, acoustic=False)
    else:
        cut = fill * high
        rim = float(np.interp(cut, profile[1:, 1], profile[1:, 0]))
        lower = [*profile[profile[:, 1] < cut], (rim, cut)]
        upper = [(rim, cut), *profile[profile[:, 1] > cut]]
        b.lathe(lower, glass("coffee_in_glass", "#23120a"), centre=(0, y, z), segments=32, acoustic=False)
        b.lathe(
            upper, glass("jug_glass", tone(rng, "#8fa0a5", "#a5b0b3")), centre=(0, y, z), segments=32, acoustic=False
        )
    b.lathe(
        [(0.7 * radius, 0.9 * high), (0.78 * radius, 0.93 * high), (0.74 * radius, 0.99 * high), (0.0, high)],
        lid,
        centre=(0, y, z),
        segments=28,
        acoustic=False,
    )
    turn = rotation("y", between(rng, -70, 70))
    bow = [
        (0, 0.93 * high, 0.7 * radius),
        (0, 0.97 * high, 1.15 * radius),
        (0, 0.75 * high, 1.5 * radius),
        (0, 0.35 * high, 1.4 * radius),
        (0, 0.25 * high, 0.98 * radius),
    ]
    b.tube(smooth_path(bow, 18) @ turn.T + [0, y, z], between(rng, 0.007, 0.011), lid, segments=10)
