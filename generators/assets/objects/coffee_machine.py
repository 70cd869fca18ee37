"""Coffee machines: an espresso machine with portafilter, a filter machine with its jug, a capsule machine."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.forms import rounded_rectangle, smooth_path
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import (
    brushed_steel,
    ceramic,
    choose,
    chrome,
    enamel,
    glass,
    lamp,
    paint,
    plastic,
    printed,
    rubber,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material


def _cup(b: MeshBuilder, x: float, y: float, z: float, scale: float, material: Material) -> None:
    """A cup standing at (x, y, z) with coffee in it; ``scale`` is its height in metres."""
    s = scale
    b.lathe(
        [
            (0.0, 0.0),
            (0.30 * s, 0.0),
            (0.32 * s, 0.06 * s),
            (0.46 * s, 0.45 * s),
            (0.55 * s, 1.0 * s),
            (0.51 * s, 1.0 * s),
            (0.43 * s, 0.5 * s),
            (0.38 * s, 0.35 * s),
            (0.0, 0.34 * s),
        ],
        material,
        centre=(x, y, z),
        segments=28,
        acoustic=False,
    )
    coffee = paint("coffee", "water", "#3a2113", roughness=0.25)
    b.cylinder(0.485 * s, 0.004, (x, y + 0.80 * s, z), coffee, segments=24, acoustic=False)
    t = np.linspace(-np.pi / 2, np.pi / 2, 9)
    loop = np.stack([x + 0.47 * s + 0.26 * s * np.cos(t), y + 0.56 * s + 0.24 * s * np.sin(t), np.full(9, z)], axis=1)
    b.tube(loop, 0.05 * s, material, segments=8)


def _tray(b: MeshBuilder, width: float, depth: float, y: float, z: float, frame: Material) -> None:
    """A drip tray with its slotted grid; ``y`` is its top, ``z`` its centre."""
    b.box((width, 0.004, depth), (0, y - 0.006, z), rubber("tray_dark", "#151617"), acoustic=False)
    bars = max(4, round(width / 0.016))
    for k in range(bars):
        x = -width / 2 + width * (k + 0.5) / bars
        b.box((0.005, 0.004, depth - 0.01), (x, y - 0.002, z), frame, acoustic=False)
    for side in (-1, 1):
        b.box((width, 0.006, 0.006), (0, y - 0.002, z + side * depth / 2), frame, acoustic=False)
        b.box((0.006, 0.006, depth), (side * width / 2, y - 0.002, z), frame, acoustic=False)


def _espresso(rng: Generator) -> Design:
    """A pump espresso machine: group head, portafilter with its handle, gauge, steam wand, cup on the tray."""
    b = MeshBuilder({"steel": 0.25})
    steel, dark = brushed_steel("steel", rng, "#c0c3c5"), plastic("black", "#1c1d1f")
    tone = choose(rng, "#c0c3c5", "#b52a28", "#f0e6cf", "#2b2d30")
    shell = steel if tone == "#c0c3c5" else enamel("shell", tone)
    w, d, h = 0.28, 0.31, 0.34
    b.box((w, 0.055, d), (0, 0.0375, 0), shell, bevel=0.008)
    for x in (-0.11, 0.11):
        for z in (-0.12, 0.12):
            b.cylinder(0.014, 0.012, (x, 0.006, z), rubber("foot"), segments=14, acoustic=False)
    b.box((w, 0.20, 0.13), (0, 0.155, -0.09), shell, bevel=0.006)
    b.box((w, 0.105, 0.27), (0, 0.2875, -0.02), shell, bevel=0.012)
    back = brushed_steel("splash", rng, "#9a9da0")
    b.quad(
        [(-0.125, 0.066, -0.0245), (0.125, 0.066, -0.0245), (0.125, 0.232, -0.0245), (-0.125, 0.232, -0.0245)],
        back,
        acoustic=False,
    )
    _tray(b, 0.24, 0.145, 0.070, 0.068, chrome("grid"))
    # Group head and portafilter.
    z = 0.060
    metal = chrome()
    _portafilter(b, z, metal, dark)
    _cup(b, 0.0, 0.070, z, 0.056, ceramic("cup", "#f4f2ec"))
    # Steam wand and its knob.
    wand = smooth_path([(0.105, 0.238, 0.075), (0.108, 0.215, 0.095), (0.112, 0.16, 0.105), (0.116, 0.098, 0.118)], 16)
    b.tube(wand, 0.005, metal, segments=10)
    b.tube(wand[6:12], 0.008, dark, segments=10)
    _gauge_and_switches(b, rng, metal, dark)
    # Cups warming on top, inside the gallery rail.
    rail = [
        (-0.125, h + 0.022, 0.095),
        (0.125, h + 0.022, 0.095),
        (0.125, h + 0.022, -0.135),
        (-0.125, h + 0.022, -0.135),
    ]
    b.tube(rail, 0.0035, metal, segments=8, closed=True)
    for x, _, zz in rail:
        b.tube([(x, h - 0.002, zz), (x, h + 0.022, zz)], 0.003, metal, segments=8)
    for x, zz in ((-0.07, 0.03), (0.0, 0.0), (0.06, 0.04)):
        _cup(b, x, h, zz, 0.05, ceramic("cup", "#f4f2ec"))
    return Design(b.build(), "surface", (0.0, 0.262, 0.150))


def _gauge_and_switches(b: MeshBuilder, rng: Generator, metal: Material, dark: Material) -> None:
    """On the front: the steam knob, the pressure gauge, three switches with their lamps."""
    face = 0.116
    b.cylinder(0.021, 0.026, (0.105, 0.295, face + 0.012), dark, axis="z", bevel=0.004, acoustic=False)
    gauge = decals.DecalCanvas(256, 256, "#f4f2ea")
    gauge.disc((128, 128), 122, None, outline="#202020", width=6)
    for k in range(16):
        gauge.ray((128, 128), -120 + 16 * k, 86, 108, "#2c7d46" if 8 <= k <= 11 else "#202020", 6)
    gauge.text((128, 182), "bar", 34, "#202020")
    gauge.ray((128, 128), float(rng.uniform(0, 40)), -24, 88, "#c2241d", 8)
    b.cylinder(0.030, 0.010, (0.0, 0.295, face + 0.004), metal, axis="z", bevel=0.003, acoustic=False)
    b.disc(0.026, (0.0, 0.295, face + 0.0096), "z", printed("gauge", gauge.pixels(), acoustic="glass"), segments=32)
    for k, x in enumerate((-0.115, -0.085, -0.055)):
        b.cylinder(0.010, 0.008, (x, 0.295, face + 0.002), metal, axis="z", segments=20, bevel=0.002, acoustic=False)
        b.cylinder(
            0.004,
            0.003,
            (x, 0.318, face + 0.001),
            lamp("pilot", "#ff7a2a" if k == 0 else "#b9bcc0", 0.4 if k == 0 else 0.0),
            axis="z",
            segments=10,
            acoustic=False,
        )


def _portafilter(b: MeshBuilder, z: float, metal: Material, dark: Material) -> None:
    """The group head at depth ``z`` with the portafilter in it and its handle."""
    b.cylinder(0.041, 0.030, (0, 0.225, z), metal, bevel=0.004, acoustic=False)
    b.cylinder(0.034, 0.028, (0, 0.199, z), metal, bevel=0.003, acoustic=False)
    b.cylinder(0.026, 0.012, (0, 0.181, z), metal, top_radius=0.033, acoustic=False)
    for x in (-0.010, 0.010):
        b.tube([(0, 0.178, z), (x, 0.168, z), (x, 0.158, z)], 0.0045, metal, segments=8)
    b.tube([(0, 0.197, z + 0.030), (0, 0.193, z + 0.060)], 0.007, metal, segments=10)
    b.tube(
        [(0, 0.193, z + 0.058), (0, 0.188, z + 0.085), (0, 0.180, z + 0.150), (0, 0.178, z + 0.158)],
        [0.010, 0.0125, 0.0135, 0.009],
        dark,
        segments=16,
    )


def _filter(rng: Generator) -> Design:
    """A drip machine: water tank behind, filter basket above, a glass jug of coffee on the hotplate."""
    b = MeshBuilder()
    tone = choose(rng, "#232427", "#eceae4", "#8c1f22")
    body = plastic("body", tone, roughness=0.36)
    accent = chrome("band")
    outline = rounded_rectangle(0.21, 0.27, 0.06)

    def stack(
        levels: list[tuple[float, float]], material: Material, shape: np.ndarray = outline, z: float = 0.0
    ) -> None:
        loops = [np.stack([shape[:, 0] * s, np.full(len(shape), y), z - shape[:, 1] * s], axis=1) for s, y in levels]
        b.loft(np.array(loops), material)

    stack([(0.97, 0.0), (1.0, 0.006), (1.0, 0.036), (0.975, 0.044)], body)
    tower = rounded_rectangle(0.205, 0.105, 0.045)
    stack([(1.0, 0.04), (1.0, 0.26)], body, tower, -0.082)
    stack([(0.96, 0.235), (1.0, 0.243), (1.0, 0.335), (0.97, 0.352), (0.86, 0.360)], body)
    stack([(1.004, 0.246), (1.004, 0.252)], accent)
    zc = 0.042
    b.cylinder(
        0.078, 0.006, (0, 0.046, zc), paint("hotplate", "metal", "#2d2e30", roughness=0.36), segments=40, acoustic=False
    )
    b.cylinder(0.060, 0.030, (0, 0.226, zc), body, segments=36, top_radius=0.075, acoustic=False)
    _jug(b, zc, accent)
    # Front: switch, window of the water gauge, name.
    name = decals.DecalCanvas(320, 96, tone)
    ink = "#3a3d40" if tone == "#eceae4" else "#e8e8e6"
    name.text((160, 48), "AROMA 12", 46, ink, bold=0.8)
    front = 0.135
    at = [(sx * 0.045, 0.300 + sy * 0.0135, front + 0.0006) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(at, printed("name", name.pixels()), fit=True, acoustic=False)
    b.slab((0.030, 0.016, 0.006), (0.0, 0.020, front + 0.002), plastic("switch", "#141517"), corner=0.004, bevel=0.002)
    b.cylinder(
        0.003,
        0.003,
        (0.007, 0.020, front + 0.005),
        lamp("pilot", "#ff5a2a", 0.6),
        axis="z",
        segments=10,
        acoustic=False,
    )
    return Design(b.build(), "surface", (0.0, 0.275, front + 0.03))


def _jug(b: MeshBuilder, zc: float, accent: Material) -> None:
    """A jug standing at depth ``zc``: coffee below, clear glass above it."""
    coffee = glass("coffee_in_glass", "#23120a")
    clear = glass("glass", "#8fa0a5")
    b.lathe(
        [(0.0, 0.0), (0.058, 0.0), (0.068, 0.008), (0.076, 0.040), (0.074, 0.072)],
        coffee,
        centre=(0, 0.050, zc),
        segments=40,
        acoustic=True,
    )
    b.lathe(
        [(0.074, 0.072), (0.070, 0.095), (0.058, 0.124), (0.054, 0.134)],
        clear,
        centre=(0, 0.050, zc),
        segments=40,
        acoustic=False,
    )
    b.lathe(
        [(0.0545, 0.130), (0.058, 0.132), (0.058, 0.146), (0.050, 0.156), (0.0, 0.160)],
        plastic("lid", "#1b1c1e"),
        centre=(0, 0.050, zc),
        segments=36,
        acoustic=False,
    )
    b.torus(0.0745, 0.0022, (0, 0.124, zc), accent, axis="y", segments=40, minor_segments=8)
    handle = smooth_path(
        [
            (0.0, 0.196, zc + 0.052),
            (0.0, 0.198, zc + 0.082),
            (0.0, 0.178, zc + 0.104),
            (0.0, 0.125, zc + 0.104),
            (0.0, 0.100, zc + 0.078),
        ],
        20,
    )
    turn = rotation("y", 38)
    handle = (handle - [0, 0, zc]) @ turn.T + [0, 0, zc]
    b.tube(handle, 0.0095, plastic("jug_handle", "#1b1c1e"), segments=12)


def _capsule(rng: Generator) -> Design:
    """A capsule machine: a slim arched body with a lever, a spout and a cup on its stand."""
    b = MeshBuilder()
    tone = choose(rng, "#b8262b", "#26282b", "#ece9e2", "#2d6a6a")
    body, dark = plastic("body", tone, roughness=0.16), plastic("black", "#191a1c")
    metal = chrome()
    width = 0.125
    profile = _arched_side()
    # Extruded along x: (x, y) of the outline are (−z, y) turned about Y.
    b.extrude(
        np.stack([-profile[:, 0], profile[:, 1]], axis=1)[::-1],
        width,
        body,
        centre=(-width / 2, 0, 0),
        rotate=rotation("y", 90),
    )
    for s in (-1, 1):
        b.extrude(
            np.stack([-profile[:, 0] * 0.93 - 0.002, profile[:, 1] * 0.93 + 0.008], axis=1)[::-1],
            0.004,
            dark,
            centre=(s * (width / 2 + 0.0005) - 0.002, 0, 0),
            rotate=rotation("y", 90),
            acoustic=False,
        )
    b.slab((0.13, 0.145, 0.026), (0, 0.013, 0.080), dark, corner=0.035, bevel=0.005, rotate=rotation("x", -90))
    _tray(b, 0.088, 0.088, 0.030, 0.080, metal)
    b.cylinder(0.022, 0.030, (0, 0.176, 0.075), dark, top_radius=0.026, segments=28, acoustic=False)
    b.cylinder(0.008, 0.018, (0, 0.153, 0.075), metal, segments=16, acoustic=False)
    _cup(b, 0.0, 0.031, 0.078, 0.062, ceramic("cup", "#f6f4ef"))
    lever = smooth_path(
        [
            (-0.05, 0.245, -0.02),
            (-0.05, 0.285, 0.03),
            (-0.048, 0.298, 0.09),
            (0.0, 0.300, 0.118),
            (0.048, 0.298, 0.09),
            (0.05, 0.285, 0.03),
            (0.05, 0.245, -0.02),
        ],
        40,
    )
    b.tube(lever, 0.007, metal, segments=10)
    for k, x in enumerate((-0.022, 0.022)):
        b.cylinder(0.0095 + 0.003 * k, 0.006, (x, 0.268, 0.03), metal, segments=20, bevel=0.002, acoustic=False)
    # Water tank at the back.
    tank = glass("tank", "#6f8790")
    b.cylinder(0.058, 0.225, (0, 0.1325, -0.185), tank, segments=36)
    b.cylinder(0.060, 0.014, (0, 0.250, -0.185), dark, segments=36, bevel=0.004, acoustic=False)
    b.cylinder(0.060, 0.020, (0, 0.010, -0.185), dark, segments=36, acoustic=False)
    name = decals.DecalCanvas(256, 96, tone)
    name.text((128, 48), "ristretto", 46, "#33363a" if tone == "#ece9e2" else "#f2f2f0", bold=0.6)
    at = [(sx * 0.036, 0.222 + sy * 0.0135, 0.1184) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(at, printed("name", name.pixels()), fit=True, acoustic=False)
    return Design(b.build(), "surface", (0.0, 0.20, 0.145))


def _arched_side() -> np.ndarray:
    """(N, 2) outline of the body from the side, (z, y) in metres: foot, column at the back, head reaching forwards."""
    t = np.linspace(0, np.pi / 2, 7)
    side = [
        (-0.15, 0.0),
        (0.02, 0.0),
        (0.02, 0.030),
        (-0.02, 0.045),
        (-0.035, 0.075),
        (-0.030, 0.150),
        (-0.005, 0.178),
        (0.075, 0.182),
    ]
    side += [(0.100 + 0.018 * np.sin(a), 0.205 - 0.018 * np.cos(a)) for a in t]
    side += [(0.085 + 0.030 * np.cos(a), 0.235 + 0.032 * np.sin(a)) for a in t]
    side += [(-0.12 - 0.030 * np.sin(a), 0.235 + 0.032 * np.cos(a)) for a in t]
    return np.array(side)


VARIANTS: dict[str, Build] = {"espresso": _espresso, "filter": _filter, "capsule": _capsule}
