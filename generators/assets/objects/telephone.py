"""Telephones: a desk set with keypad, a rotary set, a cordless handset in its base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import coil, grip_loops, rounded_rectangle
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import choose, chrome, plastic, printed, rubber
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]

#: The darker colour of a cordless set; with it, the prints are light.
DARK = "#1d1f22"


def _handset(b: MeshBuilder, length: float, material: Material, centre: Array, turn: Array) -> None:
    """A handset along local x with its ear and mouth pieces facing down (−y) and an arched grip above them."""
    half = length / 2
    x = np.linspace(-half * 0.98, half * 0.98, 25)
    s = x / half
    y = 0.026 * (1 - s**4)
    width = 0.017 + 0.010 * np.abs(s) ** 3
    thick = 0.012 + 0.004 * np.abs(s) ** 3
    outline = rounded_rectangle(2.0, 2.0, 0.85, steps=4)
    loops = grip_loops(np.stack([x, y], 1), np.stack([width, thick], 1), outline)
    b.loft(loops, material, centre=centre, rotate=turn, crease=50, acoustic=False)
    for side in (-1, 1):
        cup = np.array([side * (half - 0.030), -0.014, 0.0])
        b.lathe(
            [(0.0, -0.016), (0.022, -0.016), (0.029, -0.010), (0.030, 0.0), (0.024, 0.020), (0.0, 0.026)],
            material,
            centre=centre + turn @ cup,
            rotate=turn,
            segments=28,
            acoustic=False,
        )


@dataclass(frozen=True)
class _Keys:
    """A block of keys.

    Attributes:
        labels: one character a key, row by row.
        columns: keys in a row.
        pitch: distances from key to key, across and up (m).
        size: size of a key: across, up, out (m).
        key: colour of the keys (sRGB).
        ink: colour of the print (sRGB).
    """

    labels: str
    columns: int
    pitch: tuple[float, float]
    size: tuple[float, float, float]
    key: str
    ink: str


def _add_keys(b: MeshBuilder, keys: _Keys, at: Array, turn: Array) -> None:
    """Raised keys with printed tops; local x right, y up the slope, z out of it; ``at`` is the block's centre."""
    labels, columns, pitch, size = keys.labels, keys.columns, keys.pitch, keys.size
    rows = (len(labels) + columns - 1) // columns
    material = plastic("key", keys.key)
    for k, label in enumerate(labels):
        dx = (k % columns - (columns - 1) / 2) * pitch[0]
        dy = ((rows - 1) / 2 - k // columns) * pitch[1]
        centre = at + turn @ np.array([dx, dy, size[2] / 2])
        b.slab(size, centre, material, corner=0.003, bevel=0.0015, steps=2, rotate=turn)
        canvas = decals.DecalCanvas(64, 48, keys.key)
        canvas.text((32, 24), label, 38, keys.ink, bold=0.5)
        w, h = size[0] / 2 - 0.002, size[1] / 2 - 0.002
        top = at + turn @ np.array([dx, dy, size[2] + 0.0004])
        corners = [top + turn @ np.array([sx * w, sy * h, 0]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        b.quad(corners, printed(f"key_{k}", canvas.pixels()), fit=True, acoustic=False)


def _wedge(b: MeshBuilder, width: float, depth: float, front: float, back: float, material: Material) -> float:
    """A desk set's sloping case; returns the slope in degrees."""
    corner, bevel = 0.022, 0.008
    outline = rounded_rectangle(width, depth, corner)

    def loop(inset: float, below: float, base: bool = False) -> Array:
        scale = np.array([(width - 2 * inset) / width, (depth - 2 * inset) / depth])
        p = outline * scale
        z = -p[:, 1]
        y = np.zeros(len(p)) if base else front + (back - front) * (0.5 - z / depth) - below
        return np.stack([p[:, 0], y, z], axis=1)

    loops = [loop(0.006, 0, base=True), loop(0.0, 0, base=True) + np.array([0, 0.006, 0])]
    loops += [loop(bevel * (1 - np.cos(t)), bevel * (1 - np.sin(t))) for t in np.linspace(0, np.pi / 2, 4)]
    b.loft(np.array(loops), material, crease=50)
    return float(np.degrees(np.arctan2(back - front, depth)))


def _desk(rng: Generator) -> Design:
    """A push-button desk set: handset on the left, display and keys on the right, coil cord."""
    b = MeshBuilder()
    dark = choose(rng, "#2a2c30", "#e6e3da", "#7c1f22")
    body = plastic("body", dark, roughness=0.36)
    pale = dark == "#e6e3da"
    width, depth = 0.215, 0.225
    slope = _wedge(b, width, depth, 0.035, 0.088, body)
    turn = rotation("x", slope - 90)
    middle = np.array([0.0, (0.035 + 0.088) / 2, 0.0])

    def on_top(x: float, along: float, lift: float) -> Array:
        return np.asarray(middle + turn @ np.array([x, along, lift]))

    key, ink = ("#4a4d50", "#ffffff") if pale else ("#e9e9e6", "#1b1c1e")
    digits = _Keys("123456789*0#", 3, (0.031, 0.026), (0.024, 0.019, 0.006), key, ink)
    _add_keys(b, digits, on_top(0.042, -0.032, 0.0), turn)
    others = _Keys("RM", 2, (0.031, 0.026), (0.024, 0.010, 0.005), "#8d9093", ink)
    _add_keys(b, others, on_top(0.042, 0.030, 0.0), turn)
    b.slab((0.108, 0.046, 0.010), on_top(0.042, 0.070, 0.005), plastic("bezel", "#17181a"), corner=0.006, rotate=turn)
    canvas = decals.DecalCanvas(320, 128, "#9fb59a")
    canvas.digits((160, 74), f"{int(rng.integers(24)):02d}:{int(rng.integers(60)):02d}", 62, "#20281f", "#93a98f")
    canvas.text((64, 20), "LINE 1", 24, "#20281f")
    top = [on_top(0.042 + sx * 0.046, 0.070 + sy * 0.0175, 0.0106) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(top, printed("lcd", canvas.pixels()), fit=True, acoustic=False)
    # Cradle and handset along the left side.
    well = plastic("well", "#1c1d1f" if not pale else "#bdb9ae")
    b.slab((0.062, 0.200, 0.003), on_top(-0.066, 0.0, 0.0015), well, corner=0.014, bevel=0.001, rotate=turn)
    along = turn @ rotation("x", 90) @ rotation("y", 90)
    _handset(b, 0.235, body, on_top(-0.066, 0.0, 0.036), along)
    cord = [
        (-0.070, 0.055, 0.118),
        (-0.085, 0.028, 0.150),
        (-0.110, 0.011, 0.155),
        (-0.135, 0.011, 0.11),
        (-0.142, 0.011, 0.04),
        (-0.135, 0.011, -0.03),
        (-0.112, 0.016, -0.05),
        (-0.104, 0.030, -0.05),
    ]
    b.tube(coil(cord, 0.0065, 34), 0.0022, rubber("cord", "#1d1e20" if not pale else "#c9c5ba"), segments=6)
    return Design(b.build(), "surface", (0.03, 0.105, 0.06))


def _rotary(rng: Generator) -> Design:
    """The classic set: a flared case, a dial with ten finger holes, the handset across a raised cradle."""
    b = MeshBuilder()
    tone = choose(rng, "#1c1c1e", "#8f1d1f", "#e9e2cf", "#2f5d50")
    body = plastic("bakelite", tone, roughness=0.16)
    _flared_case(b, body)
    for x in (-0.052, 0.052):
        b.slab((0.020, 0.050, 0.034), (x, 0.128, -0.044), body, corner=0.008, bevel=0.004, rotate=rotation("x", -90))
        b.box((0.018, 0.026, 0.012), (x, 0.146, -0.068), body, bevel=0.004, acoustic=False)
        b.box((0.018, 0.026, 0.012), (x, 0.146, -0.020), body, bevel=0.004, acoustic=False)
    _handset(b, 0.245, body, np.array([0.0, 0.158, -0.044]), np.eye(3))
    _dial(b)
    cord = [
        (-0.112, 0.145, -0.044),
        (-0.135, 0.10, -0.05),
        (-0.152, 0.035, -0.045),
        (-0.150, 0.012, 0.0),
        (-0.140, 0.011, 0.05),
        (-0.130, 0.011, 0.075),
        (-0.112, 0.012, 0.080),
    ]
    b.tube(coil(cord, 0.0065, 30), 0.0022, rubber("cord", "#1d1e20"), segments=6)
    return Design(b.build(), "surface", (0.0, 0.130, -0.005))


def _dial(b: MeshBuilder) -> None:
    """A dial with ten finger holes on the front slope, between (y .022, z .098) and (y .095, z .0165)."""
    slope = float(np.degrees(np.arctan2(0.095 - 0.022, 0.098 - 0.0165)))
    face = rotation("x", slope - 90)
    at = np.array([0.0, 0.058, 0.062])
    axle = face @ rotation("x", 90)

    def out(x: float, y: float, z: float) -> Array:
        return np.asarray(at + face @ np.array([x, y, z]))

    pale = plastic("number_plate", "#f3efe2")
    b.lathe(
        [(0.050, -0.02), (0.050, 0.006), (0.047, 0.008), (0.0, 0.008)],
        pale,
        centre=at,
        rotate=axle,
        segments=48,
        acoustic=False,
    )
    canvas = decals.DecalCanvas(320, 320, "#f3efe2")
    angles = [60 - 30 * k for k in range(10)]
    for k, angle in enumerate(angles):
        a = np.radians(angle)
        canvas.text((160 + 108 * np.cos(a), 160 - 108 * np.sin(a)), str((k + 1) % 10), 44, "#17171a", bold=0.8)
    ring = np.linspace(0, 2 * np.pi, 49)[:-1]
    flat = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(ring), np.sin(ring)], axis=1)])
    fan = np.stack([np.zeros(48, dtype=int), 1 + np.arange(48), 1 + (np.arange(48) + 1) % 48], axis=1)
    b.add(
        np.concatenate([flat * 0.049, np.full((49, 1), 0.0086)], axis=1),
        fan,
        printed("numbers", canvas.pixels()),
        centre=at,
        rotate=face,
        uv=((flat + 1) / 2)[fan],
        acoustic=False,
    )
    circle = np.stack([np.cos(ring), np.sin(ring)], axis=1)
    holes = [
        np.array([0.0335 * np.cos(np.radians(a)), 0.0335 * np.sin(np.radians(a))])
        + 0.0078 * np.stack([np.cos(ring[::3]), np.sin(ring[::3])], axis=1)
        for a in angles
    ]
    b.extrude(
        circle * 0.046, 0.003, chrome("finger_wheel"), holes=holes, centre=out(0, 0, 0.011), rotate=face, acoustic=False
    )
    b.lathe(
        [(0.0205, 0.0), (0.020, 0.003), (0.0, 0.004)],
        pale,
        centre=out(0, 0, 0.0135),
        rotate=axle,
        segments=28,
        acoustic=False,
    )


def _flared_case(b: MeshBuilder, body: Material) -> None:
    """The case of a rotary set, wide at its foot."""
    loops = []
    for w, d, y, z, r in (
        (0.225, 0.205, 0.0, 0.0, 0.030),
        (0.230, 0.210, 0.006, 0.0, 0.032),
        (0.222, 0.200, 0.022, -0.002, 0.034),
        (0.190, 0.160, 0.060, -0.014, 0.036),
        (0.150, 0.105, 0.095, -0.036, 0.034),
        (0.128, 0.080, 0.112, -0.044, 0.030),
        (0.118, 0.070, 0.116, -0.044, 0.028),
    ):
        p = rounded_rectangle(w, d, r)
        loops.append(np.stack([p[:, 0], np.full(len(p), y), z - p[:, 1]], axis=1))
    b.loft(np.array(loops), body, crease=55)


def _cordless(rng: Generator) -> Design:
    """A cordless handset upright in an answering-machine base."""
    b = MeshBuilder()
    tone = choose(rng, DARK, "#eceae6")
    dark = tone == DARK
    body, trim = plastic("body", tone, roughness=0.25), chrome("trim")
    slope = _wedge(b, 0.190, 0.135, 0.026, 0.060, body)
    lean = rotation("x", -14)
    foot = np.array([-0.042, 0.050, -0.012])

    def on_set(x: float, y: float, z: float) -> Array:
        return np.asarray(foot + lean @ np.array([x, y, z]))

    b.slab((0.072, 0.032, 0.046), on_set(0, -0.002, 0.002), body, corner=0.010, bevel=0.005, rotate=lean)
    b.slab((0.056, 0.185, 0.020), on_set(0, 0.090, 0.0), body, corner=0.018, bevel=0.008, rotate=lean, acoustic=True)
    b.slab((0.056, 0.185, 0.008), on_set(0, 0.090, -0.013), trim, corner=0.018, bevel=0.003, rotate=lean)
    b.tube([on_set(0.018, 0.178, -0.004), on_set(0.018, 0.205, -0.004)], 0.006, body, segments=12)
    canvas = decals.DecalCanvas(256, 256, "#bfe0ec")
    canvas.text((70, 30), "12 Nov", 34, "#163642")
    canvas.text((208, 30), "|||", 30, "#163642", bold=1.0)
    canvas.digits((128, 132), f"{int(rng.integers(24)):02d}:{int(rng.integers(60)):02d}", 62, "#12303c")
    canvas.text((66, 226), "MENU", 32, "#163642")
    canvas.text((200, 226), "CALL", 32, "#163642")
    w, h = 0.0205, 0.0225
    lcd = [on_set(sx * w, 0.136 + sy * h, 0.0106) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(lcd, printed("lcd", canvas.pixels(), roughness=0.25), fit=True, acoustic=False)
    b.slab(
        (0.022, 0.003, 0.002),
        on_set(0, 0.172, 0.0105),
        rubber("earpiece", "#0a0a0a"),
        corner=0.001,
        bevel=0,
        rotate=lean,
    )
    colours = ("#f0f1f2", "#17181a") if dark else ("#3c3f43", "#ffffff")
    digits = _Keys("123456789*0#", 3, (0.0155, 0.0135), (0.0125, 0.0095, 0.0025), *colours)
    _add_keys(b, digits, on_set(0, 0.055, 0.010), lean)
    for x, colour in ((-0.015, "#2f9a4c"), (0.015, "#c2362e")):
        b.slab(
            (0.014, 0.010, 0.003),
            on_set(x, 0.098, 0.0112),
            plastic("call_key", colour),
            corner=0.004,
            bevel=0.001,
            rotate=lean,
        )
    _answering_machine(b, rng, slope, tone, trim)
    return Design(b.build(), "surface", (0.045, 0.075, 0.01))


def _answering_machine(b: MeshBuilder, rng: Generator, slope: float, tone: str, trim: Material) -> None:
    """Speaker grille, counter and two keys on a base that slopes by ``slope`` degrees."""
    dark = tone == DARK
    turn = rotation("x", slope - 90)
    middle = np.array([0.0, (0.026 + 0.060) / 2, 0.0])

    def on_top(x: float, along: float, lift: float) -> Array:
        return np.asarray(middle + turn @ np.array([x, along, lift]))

    grille = decals.DecalCanvas(192, 192, tone)
    for gx in range(12, 190, 14):
        for gy in range(12, 190, 14):
            if np.hypot(gx - 96, gy - 96) < 90:
                grille.disc((gx, gy), 4.4, "#050505" if dark else "#55585c")
    at = [on_top(0.045 + sx * 0.026, 0.020 + sy * 0.026, 0.0006) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(at, printed("speaker", grille.pixels()), fit=True, acoustic=False)
    counter = printed(
        "counter", decals.display(96, 72, str(int(rng.integers(10))), ink="#ff4a3d", background="#160607")
    )
    at = [on_top(0.022 + sx * 0.009, -0.030 + sy * 0.007, 0.0008) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(at, counter, fit=True, acoustic=False)
    for k in range(2):
        b.lathe(
            [(0.008, 0.0), (0.008, 0.003), (0.0, 0.004)],
            trim,
            centre=on_top(0.050 + 0.022 * k, -0.030, 0),
            rotate=turn @ rotation("x", 90),
            segments=18,
            acoustic=False,
        )


VARIANTS: dict[str, Build] = {"desk": _desk, "rotary": _rotary, "cordless": _cordless}
