"""Clocks: a printed dial under metal hands, in a round rim, a square frame, a mantel case or an alarm clock's drum."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import choose, chrome, enamel, plastic, printed, rubber, wood
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


def _hands(b: MeshBuilder, centre: tuple[float, float, float], radius: float, ink: Material, rng: Generator) -> None:
    """Hour, minute and second hand on a dial of ``radius`` metres that faces +Z."""
    minutes = float(rng.integers(720))
    red = plastic("second_hand", "#c0261f")
    specs = (
        (minutes / 2, 0.50, 0.060, 0.12, ink, 0.003),
        (minutes * 6, 0.78, 0.042, 0.14, ink, 0.005),
        (float(rng.integers(60)) * 6, 0.82, 0.014, 0.22, red, 0.007),
    )
    for degrees, reach, width, tail, material, lift in specs:
        turn = rotation("z", -degrees)
        w, r, t = width * radius / 2, reach * radius, tail * radius
        blade = [(-w, -t), (w, -t), (w * 0.55, r), (-w * 0.55, r)]
        at = np.asarray(centre) + np.array([0, 0, lift])
        b.extrude(blade, 0.0012, material, centre=at, rotate=turn, acoustic=False)
    x, y, z = centre
    b.cylinder(0.05 * radius, 0.009, (x, y, z + 0.0055), ink, axis="z", segments=20, bevel=0.001, acoustic=False)


def _dial(b: MeshBuilder, centre: tuple[float, float, float], radius: float, pixels: np.ndarray) -> None:
    b.disc(radius, centre, "z", printed("dial", pixels, acoustic="paper", roughness=0.64), segments=64)


def _rim(
    b: MeshBuilder, profile: list[tuple[float, float]], material: Material, centre: tuple[float, float, float]
) -> None:
    b.lathe(profile, material, centre=centre, rotate=rotation("x", 90), segments=72, acoustic=False)


def _station(rng: Generator) -> Design:
    """A wall clock in the style of railway stations: bars instead of minute numerals, bold figures."""
    b = MeshBuilder()
    radius = 0.19
    case = plastic("rim", choose(rng, "#1d1e20", "#9d2323", "#29465c", "#3c4a3e"), roughness=0.25)
    b.cylinder(radius, 0.032, (0, 0, 0.016), case, axis="z", segments=64)
    _rim(
        b,
        [(radius, 0.0), (radius, 0.038), (radius - 0.005, 0.045), (radius - 0.013, 0.046), (radius - 0.019, 0.036)],
        case,
        (0, 0, 0),
    )
    _dial(b, (0, 0, 0.0335), radius - 0.018, decals.clock_face(512, heavy=1.3, brand="QUARTZ"))
    _hands(b, (0, 0, 0.034), radius - 0.018, enamel("hands", "#151515"), rng)
    return Design(b.build(), "wall", (0.0, 0.0, 0.065))


def _wooden(rng: Generator) -> Design:
    """A wall clock in a wooden ring with Roman numerals."""
    b = MeshBuilder({"ring_wood": 0.3})
    radius = 0.175
    ring = wood("ring_wood", rng, choose(rng, "#7a4a28", "#53301c", "#a8794a"))
    b.cylinder(radius - 0.01, 0.03, (0, 0, 0.015), ring, axis="z", segments=64)
    _rim(
        b,
        [
            (radius, 0.0),
            (radius, 0.024),
            (radius - 0.006, 0.036),
            (radius - 0.020, 0.044),
            (radius - 0.032, 0.040),
            (radius - 0.038, 0.031),
        ],
        ring,
        (0, 0, 0),
    )
    brass = chrome("brass", "#e2b35c")
    b.torus(radius - 0.039, 0.0035, (0, 0, 0.034), brass, axis="z", segments=64, minor_segments=8)
    _dial(b, (0, 0, 0.0325), radius - 0.036, decals.clock_face(512, paper="#f3e9d2", ink="#2b1d12", numerals="roman"))
    _hands(b, (0, 0, 0.033), radius - 0.040, enamel("hands", "#20160e"), rng)
    return Design(b.build(), "wall", (0.0, 0.0, 0.065))


def _square(rng: Generator) -> Design:
    """A modern square frame without numerals; hangs on a wall or leans on a shelf."""
    b = MeshBuilder()
    side = 0.30
    tone = choose(rng, "#202124", "#e8e6e0", "#37586b")
    frame = plastic("frame", tone, roughness=0.36)
    b.slab((side, side, 0.045), (0, side / 2, 0.0225), frame, corner=0.03, bevel=0.010, acoustic=True)
    dark = tone != "#e8e6e0"
    pixels = decals.clock_face(
        512, paper="#f5f3ed" if dark else "#2c2e30", ink="#1a1a1a" if dark else "#f2f2ee", numerals="quarters"
    )
    b.lathe(
        [(0.136, 0.0), (0.136, 0.004), (0.131, 0.006), (0.128, 0.002)],
        chrome("bezel"),
        centre=(0, side / 2, 0.045),
        rotate=rotation("x", 90),
        segments=64,
        acoustic=False,
    )
    _dial(b, (0, side / 2, 0.0462), 0.130, pixels)
    _hands(b, (0, side / 2, 0.0466), 0.128, enamel("hands", "#151515" if dark else "#f4f4f0"), rng)
    return Design(b.build(), "wall_or_surface", (0.0, side / 2, 0.075))


def _mantel(rng: Generator) -> Design:
    """A mantel clock: an arched wooden case on a plinth, a dial with a brass rim."""
    b = MeshBuilder({"case_wood": 0.3})
    tone = choose(rng, "#5d351d", "#7b4a2a", "#3d2417")
    case = wood("case_wood", rng, tone)
    half, shoulder = 0.115, 0.175
    t = np.linspace(0, np.pi, 21)
    arch = np.stack([half * np.cos(t), shoulder + half * np.sin(t)], axis=1)
    outline = np.concatenate([[[-half, 0.045], [half, 0.045]], arch])
    b.extrude(outline, 0.10, case, centre=(0, 0, -0.05))
    edge = np.concatenate(
        [
            [[half - 0.012, 0.06]],
            np.stack([(half - 0.012) * np.cos(t), shoulder + (half - 0.012) * np.sin(t)], axis=1),
            [[-half + 0.012, 0.06]],
        ]
    )
    b.tube(np.concatenate([edge, np.full((len(edge), 1), 0.05)], axis=1), 0.004, case, segments=8)
    b.box((0.29, 0.020, 0.135), (0, 0.020, 0), case, bevel=0.005)
    b.box((0.262, 0.020, 0.122), (0, 0.038, 0), case, bevel=0.007, acoustic=False)
    brass = chrome("brass", "#e2b35c")
    for x in (-0.12, 0.12):
        for z in (-0.05, 0.05):
            b.sphere((0.012, 0.010, 0.012), (x, 0.010, z), brass, rings=8, segments=14, acoustic=False)
    at = (0.0, shoulder, 0.05)
    b.lathe(
        [(0.096, 0.0), (0.096, 0.006), (0.091, 0.011), (0.085, 0.008), (0.083, 0.002)],
        brass,
        centre=at,
        rotate=rotation("x", 90),
        segments=56,
        acoustic=False,
    )
    _dial(b, (0, shoulder, 0.0522), 0.085, decals.clock_face(512, paper="#f6eed9", ink="#22170e", numerals="roman"))
    _hands(b, (0, shoulder, 0.0526), 0.083, enamel("hands", "#1c130b"), rng)
    return Design(b.build(), "surface", (0.0, shoulder, 0.08))


def _alarm(rng: Generator) -> Design:
    """A large twin-bell alarm clock."""
    b = MeshBuilder()
    shell = enamel("shell", choose(rng, "#b3302b", "#2f6f73", "#e3ddcd", "#26282b"))
    steel = chrome("bells")
    y, radius = 0.135, 0.105
    b.cylinder(radius, 0.085, (0, y, 0), shell, axis="z", segments=56, bevel=0.012)
    b.lathe(
        [(radius, -0.004), (radius + 0.003, 0.004), (radius - 0.002, 0.012), (radius - 0.012, 0.008)],
        steel,
        centre=(0, y, 0.038),
        rotate=rotation("x", 90),
        segments=56,
        acoustic=False,
    )
    _dial(b, (0, y, 0.0445), radius - 0.010, decals.clock_face(512, paper="#f4f0e4", heavy=1.1))
    _hands(b, (0, y, 0.045), radius - 0.012, enamel("hands", "#151515"), rng)
    for side in (-1, 1):
        turn = rotation("z", -side * 33)
        base = np.array([0, y, 0]) + turn @ np.array([0, radius + 0.020, 0])
        s = np.linspace(0, np.pi / 2, 8)
        dome = np.stack([0.050 * np.cos(s), 0.040 * np.sin(s)], axis=1)
        b.lathe(
            [(0.0, 0.006), (0.044, 0.004), (0.050, 0.0), *dome[1:]],
            steel,
            centre=base,
            rotate=turn,
            segments=36,
            acoustic=False,
        )
        b.cylinder(0.006, 0.03, base - turn @ np.array([0, 0.012, 0]), steel, segments=12, acoustic=False)
        b.sphere(0.008, base + turn @ np.array([0, 0.043, 0]), steel, rings=8, segments=14, acoustic=False)
        foot = np.array([side * 0.062, 0.0, 0.0])
        b.tube([foot + np.array([0, 0.006, 0.012]), np.array([side * 0.05, 0.055, 0.0])], 0.008, steel, segments=10)
        b.sphere(0.011, foot + np.array([0, 0.011, 0.012]), rubber("foot"), rings=8, segments=12, acoustic=False)
    b.tube([(0, y + radius - 0.005, 0), (0, y + radius + 0.045, 0)], 0.004, steel, segments=8)
    b.box((0.014, 0.018, 0.012), (0, y + radius + 0.050, 0), steel, bevel=0.003, acoustic=False)
    s = np.linspace(0.15, np.pi - 0.15, 13)
    arch = np.stack([0.07 * np.cos(s), y + radius + 0.045 + 0.055 * np.sin(s), np.zeros(13)], axis=1)
    b.tube(arch, 0.004, steel, segments=8)
    return Design(b.build(), "surface", (0.0, y, 0.075))


VARIANTS: dict[str, Build] = {
    "station": _station,
    "wooden": _wooden,
    "square": _square,
    "mantel": _mantel,
    "alarm": _alarm,
}
