"""Hoses, wheels, wands and floor heads of vacuum cleaners."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import egg, level, ribbed, smooth_path
from generators.assets.objects.finishes import plastic, rubber
from generators.assets.objects.training.draw import VIVID, between, chance, metal, tone
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
Spot = tuple[float, float, float]


def draw_two_tones(rng: Generator) -> tuple[str, Material, Material]:
    """The colour of the body, its material, and a second, mostly dark one."""
    colour = tone(rng, *VIVID)
    body = plastic("body", colour, roughness=between(rng, 0.09, 0.49))
    return (
        colour,
        body,
        plastic("second", tone(rng, "#26282b", "#26282b", "#8d9195", "#e9eaec", "#3a3f46"), roughness=0.25),
    )


def add_hose(b: MeshBuilder, rng: Generator, points: list[Array], count: int = 100) -> None:
    """A corrugated hose through ``points``."""
    radius = between(rng, 0.016, 0.024)
    material = rubber("hose", tone(rng, "#34363a", "#1d1e20", "#8d9195", "#b9bcbe"))
    b.tube(smooth_path(points, count), ribbed(count, radius, between(rng, 0.12, 0.28) * radius), material, segments=10)


def add_wheel(b: MeshBuilder, at: Spot, radius: float, width: float, hub: Material) -> None:
    """A wheel that stands at the height 0, about the axle x; ``at``: (x, 0, z)."""
    x, _, z = at
    b.cylinder(
        radius,
        width,
        (x, radius, z),
        rubber("tyre", "#232427"),
        axis="x",
        bevel=0.25 * width,
        segments=32,
        acoustic=False,
    )
    outside = x + np.sign(x) * width / 2
    b.cylinder(0.66 * radius, 0.01, (outside, radius, z), hub, axis="x", bevel=0.003, segments=28, acoustic=False)


def add_floor_head(b: MeshBuilder, rng: Generator, centre: Spot, material: Material, yaw: float = 0.0) -> None:
    """A floor head across local x."""
    turn, width, deep = rotation("y", yaw), between(rng, 0.22, 0.32), between(rng, 0.035, 0.06)
    high = between(rng, 0.035, 0.055)
    outline = egg(width / 2, deep, 1.1 * deep, squareness=between(rng, 4, 10))
    outline[:, 1] = np.clip(outline[:, 1] * 1.3, -1.1 * deep, deep)
    rings = [(0.97, 0.0), (1.0, 0.1), (1.0, 0.4), (0.94, 0.65), (between(rng, 0.5, 0.85), 0.85), (0.3, 1.0)]
    loops = np.array([level(outline * s, h * high) for s, h in rings])
    b.loft(loops, material, centre=centre, rotate=turn, acoustic=False)
    joint = np.asarray(centre) + [0, 0.85 * high, 0] + turn @ [0, 0, -0.015]
    b.cylinder(0.021, 0.055, joint, rubber("joint", "#2a2b2e"), axis="x", segments=20, acoustic=False)


def add_wand(b: MeshBuilder, rng: Generator, top: Array, foot: Array, dark: Material) -> None:
    """A tube from its handle at ``top`` to its head on the floor at ``foot``, with a sleeve or two."""
    along = foot - top
    tube = metal(rng, "wand") if chance(rng, 0.6) else dark
    b.tube([top, foot], between(rng, 0.014, 0.019), tube, segments=16)
    for share in rng.uniform(0.3, 0.7, size=int(rng.integers(0, 3))):
        b.tube([top + share * along, top + (share + 0.06) * along], 0.022, dark, segments=14)
    b.tube([top - 0.02 * along, top + between(rng, 0.12, 0.2) * along], 0.023, dark, segments=14)
