"""Microwave ovens: a door with a dark mesh window, and beside it a keypad or two dials under a lit display."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import (
    Pixels,
    brushed_steel,
    chrome,
    enamel,
    glass,
    plastic,
    printed,
    rubber,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

W, H, D = 0.50, 0.29, 0.37
#: Width of the control panel as a share of the front's.
PANEL = 0.125


def _time(rng: Generator) -> str:
    return f"{int(rng.integers(1, 13)):2d}:{int(rng.integers(60)):02d}"


def _case(b: MeshBuilder, body: Material) -> float:
    """Case, feet and side vents; the z of its front."""
    b.box((W, H - 0.012, D - 0.02), (0, 0.012 + (H - 0.012) / 2, -0.01), body, bevel=0.007)
    for x in (-W / 2 + 0.045, W / 2 - 0.045):
        for z in (-D / 2 + 0.05, D / 2 - 0.06):
            b.cylinder(0.014, 0.016, (x, 0.008, z), rubber("foot"), segments=14, acoustic=False)
    vent = rubber("vent", "#222426")
    for side in (-1, 1):
        for k in range(9):
            b.box((0.002, 0.045, 0.006), (side * W / 2, H - 0.065, -0.13 + 0.014 * k), vent, acoustic=False)
    return D / 2 - 0.02


def _window(b: MeshBuilder, frame: Material, z: float, *, rim: float = 0.022) -> tuple[float, float]:
    """The door with its window; returns the x of its left and right edge."""
    left, right = -W / 2 + 0.004, W / 2 - PANEL - 0.003
    width, height = right - left, H - 0.022
    x, y = (left + right) / 2, 0.012 + (H - 0.012) / 2
    b.slab((width, height, 0.024), (x, y, z + 0.012), frame, corner=0.010, bevel=0.005)
    texture = decals.dotted_window(640, 448, pitch=11)
    w, h = width / 2 - rim, height / 2 - rim
    corners = [
        (x - w, y - h, z + 0.0248),
        (x + w, y - h, z + 0.0248),
        (x + w, y + h, z + 0.0248),
        (x - w, y + h, z + 0.0248),
    ]
    b.quad(corners, printed("mesh_window", texture, acoustic="glass", roughness=0.04), fit=True, acoustic=False)
    return left, right


def _panel(b: MeshBuilder, pixels: Pixels, frame: Material, z: float) -> tuple[float, float]:
    """The control panel and its print; returns its centre."""
    x, y = W / 2 - PANEL / 2 - 0.002, 0.012 + (H - 0.012) / 2
    width, height = PANEL - 0.006, H - 0.022
    b.slab((width, height, 0.022), (x, y, z + 0.011), frame, corner=0.008, bevel=0.004)
    w, h = width / 2 - 0.005, height / 2 - 0.005
    corners = [
        (x - w, y - h, z + 0.0226),
        (x + w, y - h, z + 0.0226),
        (x + w, y + h, z + 0.0226),
        (x - w, y + h, z + 0.0226),
    ]
    b.quad(corners, printed("controls", pixels), fit=True, acoustic=False)
    return x, y


def _handle(b: MeshBuilder, x: float, z: float, material: Material) -> None:
    y, reach = H / 2 + 0.006, 0.085
    bar = [(x, y - reach, z + 0.024), (x, y - reach, z + 0.05), (x, y - reach + 0.012, z + 0.056)]
    bar += [(x, y + reach - 0.012, z + 0.056), (x, y + reach, z + 0.05), (x, y + reach, z + 0.024)]
    b.tube(bar, 0.008, material, segments=14)


def _keypad_print(rng: Generator, background: str, key: str, ink: str, glow: str) -> Pixels:
    canvas = decals.DecalCanvas(256, 576, background)
    canvas.box((18, 22), (238, 112), "#04090a", radius=8)
    canvas.digits((128, 67), _time(rng), 54, glow, "#0f1a19")
    labels = [["POPCORN", "DEFROST"], ["POWER", "TIMER"]]
    for r, row in enumerate(labels):
        for c, label in enumerate(row):
            canvas.box((20 + 112 * c, 132 + 50 * r), (124 + 112 * c, 172 + 50 * r), key, radius=8)
            canvas.text((72 + 112 * c, 152 + 50 * r), label, 18, ink)
    for k, label in enumerate("123456789C0*"):
        x, y = 20 + 74 * (k % 3), 238 + 62 * (k // 3)
        canvas.box((x, y), (x + 66, y + 52), key, radius=10)
        canvas.text((x + 33, y + 26), label, 30, ink, bold=0.4)
    canvas.box((20, 494), (124, 550), "#a83a33", radius=10)
    canvas.text((72, 522), "STOP", 24, "#ffffff")
    canvas.box((132, 494), (236, 550), "#3f8f54", radius=10)
    canvas.text((184, 522), "START", 24, "#ffffff")
    return canvas.pixels()


def _steel(rng: Generator) -> Design:
    """Stainless steel with a keypad and a bar handle."""
    b = MeshBuilder({"steel": 0.25})
    steel = brushed_steel("steel", rng)
    z = _case(b, enamel("case", "#9da1a4"))
    _window(b, steel, z, rim=0.040)
    _panel(b, _keypad_print(rng, "#17191b", "#2c2f33", "#e6e8ea", "#5ff0a8"), plastic("panel", "#17191b"), z)
    _handle(b, W / 2 - PANEL - 0.022, z, chrome("handle"))
    return Design(b.build(), "surface", (-0.06, H / 2, z + 0.055))


def _white(rng: Generator) -> Design:
    """White, with two dials and a push button."""
    b = MeshBuilder()
    white = "#f0f0ec"
    frame = plastic("white_plastic", white)
    z = _case(b, enamel("case", white))
    _window(b, frame, z, rim=0.036)
    canvas = decals.DecalCanvas(256, 576, white)
    canvas.text((128, 34), "wave 800", 30, "#5a5e62", bold=0.4)
    for y, labels in ((160, ("0", "2", "5", "10", "20", "30")), (368, ("LO", "*", "M", "MH", "HI"))):
        for k, label in enumerate(labels):
            angle = np.radians(-135 + 270 * k / (len(labels) - 1))
            canvas.ray((128, y), float(np.degrees(angle)), 66, 78, "#3c4043", 4)
            canvas.text((128 + 100 * np.sin(angle), y - 96 * np.cos(angle)), label, 24, "#3c4043")
    middle, level = _panel(b, canvas.pixels(), frame, z)
    height = H - 0.032
    for row in (160, 368):
        at = level + height * (0.5 - row / 576)
        dial = plastic("dial", "#d5d6d4")
        b.cylinder(0.026, 0.022, (middle, at, z + 0.032), dial, axis="z", top_radius=0.022, bevel=0.003, acoustic=False)
        turn = rotation("z", float(rng.uniform(-120, 120)))
        b.box(
            (0.006, 0.040, 0.007), (middle, at, z + 0.045), plastic("dial_grip", "#8e9296"), rotate=turn, acoustic=False
        )
    b.slab((0.09, 0.030, 0.010), (middle, 0.042, z + 0.026), plastic("opener", "#dcdddb"), corner=0.006, bevel=0.003)
    return Design(b.build(), "surface", (-0.06, H / 2, z + 0.055))


def _black(rng: Generator) -> Design:
    """Black glass front with a chrome-rimmed knob and a blue display."""
    b = MeshBuilder()
    frame = glass("front_glass", "#16171a")
    z = _case(b, enamel("case", "#2a2c2f"))
    _window(b, frame, z, rim=0.030)
    canvas = decals.DecalCanvas(256, 576, "#131416")
    canvas.digits((128, 70), _time(rng), 60, "#56c8ff", "#141d22")
    for k, label in enumerate(("MICRO", "GRILL", "COMBI", "DEFROST")):
        x, y = 24 + 108 * (k % 2), 140 + 58 * (k // 2)
        canvas.box((x, y), (x + 100, y + 46), None, radius=8, outline="#787d82", width=2)
        canvas.text((x + 50, y + 23), label, 18, "#d5d9dc")
    for k in range(24):
        canvas.ray((128, 400), 15 * k, 92, 102, "#8b9095", 3)
    canvas.text((76, 544), "STOP", 20, "#d5d9dc")
    canvas.text((180, 544), "+30 s", 20, "#d5d9dc")
    middle, level = _panel(b, canvas.pixels(), frame, z)
    at = level + (H - 0.032) * (0.5 - 400 / 576)
    b.cylinder(0.034, 0.008, (middle, at, z + 0.025), chrome("knob_ring"), axis="z", bevel=0.002, acoustic=False)
    b.cylinder(0.030, 0.026, (middle, at, z + 0.034), brushed_steel("knob", rng), axis="z", bevel=0.004, acoustic=False)
    b.box(
        (W - PANEL - 0.05, 0.012, 0.010),
        (-PANEL / 2, H - 0.030, z + 0.030),
        chrome("trim"),
        bevel=0.003,
        acoustic=False,
    )
    return Design(b.build(), "surface", (-0.06, H / 2, z + 0.06))


VARIANTS: dict[str, Build] = {"steel": _steel, "white": _white, "black": _black}
