"""Vacuum cleaners: a canister with hose and wand, an upright, a drum on castors."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import egg, level, ribbed, smooth_path
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import choose, chrome, glass, plastic, printed, rubber
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


def _hose(b: MeshBuilder, points: list[tuple[float, float, float]], radius: float, count: int = 110) -> None:
    """A corrugated hose through ``points``."""
    b.tube(smooth_path(points, count), ribbed(count, radius, 0.25 * radius), rubber("hose", "#34363a"), segments=10)


def _wheel(b: MeshBuilder, x: float, radius: float, width: float, z: float, hub: Material) -> None:
    b.cylinder(
        radius, width, (x, radius, z), rubber("tyre", "#232427"), axis="x", bevel=0.012, segments=36, acoustic=False
    )
    outside = x + np.sign(x) * (width / 2)
    b.cylinder(radius * 0.68, 0.012, (outside, radius, z), hub, axis="x", bevel=0.004, segments=32, acoustic=False)
    b.cylinder(
        radius * 0.22, 0.018, (outside, radius, z), chrome("hub"), axis="x", bevel=0.004, segments=20, acoustic=False
    )


def _head(b: MeshBuilder, centre: tuple[float, float, float], width: float, material: Material, yaw: float) -> None:
    """A floor head across local x."""
    turn = rotation("y", yaw)
    x, y, z = centre
    outline = egg(width / 2, 0.055, 0.060, squareness=8.0)
    outline[:, 1] = np.clip(outline[:, 1] * 1.3, -0.06, 0.055)
    loops = [
        level(outline * s, h)
        for s, h in ((0.97, 0.0), (1.0, 0.006), (1.0, 0.022), (0.95, 0.034), (0.80, 0.042), (0.35, 0.055))
    ]
    b.loft(np.array(loops), material, centre=(x, y, z), rotate=turn, acoustic=False)
    b.loft(
        np.array([level(outline * 1.015, h) for h in (0.004, 0.014)]),
        rubber("bumper", "#1d1e20"),
        centre=(x, y, z),
        rotate=turn,
        acoustic=False,
    )
    b.cylinder(
        0.022,
        0.06,
        np.array([x, y + 0.042, z]) + turn @ [0, 0, -0.02],
        rubber("joint", "#2a2b2e"),
        axis="x",
        segments=24,
        acoustic=False,
    )


def _canister(rng: Generator) -> Design:
    """A bagless canister towing a hose; the wand leans over its floor head in front."""
    b = MeshBuilder()
    tone = choose(rng, "#b32428", "#1f5fa8", "#d9772b", "#5b3b86")
    body, dark = plastic("body", tone, roughness=0.16), plastic("dark", "#26282b", roughness=0.25)
    _boat(b, body, dark)
    for side in (-1, 1):
        _wheel(b, side * 0.150, 0.090, 0.046, -0.085, body)
    b.cylinder(0.028, 0.036, (0, 0.028, 0.155), rubber("castor"), axis="x", bevel=0.006, segments=24, acoustic=False)
    # Dust bin, carrying handle, buttons.
    b.cylinder(
        0.062, 0.15, (0, 0.225, 0.075), glass("bin", "#5d6b73"), axis="y", bevel=0.01, segments=36, acoustic=False
    )
    b.cylinder(0.030, 0.10, (0, 0.225, 0.075), body, segments=24, acoustic=False)
    b.cylinder(0.066, 0.022, (0, 0.305, 0.075), body, bevel=0.008, segments=36, acoustic=False)
    b.tube(
        smooth_path([(0, 0.225, -0.14), (0, 0.285, -0.12), (0, 0.330, -0.02), (0, 0.325, 0.06)], 24),
        0.013,
        dark,
        segments=12,
    )
    for x in (-0.045, 0.045):
        b.cylinder(
            0.020, 0.012, (x, 0.240, -0.075), plastic("button", "#cfd2d5"), bevel=0.004, segments=24, acoustic=False
        )
    _hose_and_wand(b, dark)
    return Design(b.build(), "floor", (0.0, 0.27, 0.165))


def _hose_and_wand(b: MeshBuilder, dark: Material) -> None:
    """A hose from the nose of a canister up to the handle, and the tube down to the floor head."""
    grip = np.array([0.10, 0.86, 0.06])
    head = np.array([0.17, 0.0, 0.46])
    _hose(
        b,
        [
            (0, 0.110, 0.205),
            (0, 0.125, 0.28),
            (-0.08, 0.20, 0.34),
            (-0.155, 0.42, 0.25),
            (-0.10, 0.72, 0.02),
            (0.02, 0.86, -0.06),
            (0.08, 0.895, 0.0),
            tuple(grip + np.array([0, 0.02, 0.0])),
        ],
        0.021,
    )
    b.cylinder(0.030, 0.035, (0, 0.110, 0.205), dark, axis="z", segments=24, bevel=0.005, acoustic=False)
    base = head + np.array([0.0, 0.055, -0.02])
    along = (base - grip) / np.linalg.norm(base - grip)
    b.tube([grip, base], 0.0165, chrome("wand"), segments=18)
    b.tube([grip + along * 0.36, grip + along * 0.42], 0.022, dark, segments=16)
    b.tube([grip - along * 0.02, grip + along * 0.14], 0.022, dark, segments=16)
    handle = smooth_path(
        [
            grip + along * 0.02,
            grip + np.array([0.0, 0.06, -0.05]),
            grip + np.array([0, 0.07, -0.10]),
            grip + np.array([0, 0.02, -0.12]),
        ],
        16,
    )
    b.tube(handle, 0.015, dark, segments=12)
    _head(b, (float(head[0]), 0.0, float(head[2])), 0.28, dark, 0.0)


def _boat(b: MeshBuilder, body: Material, dark: Material) -> None:
    """The body of a canister: a low boat with a raised dome."""
    loops = []
    for half, front, back, y in (
        (0.085, 0.15, 0.13, 0.030),
        (0.115, 0.195, 0.165, 0.045),
        (0.132, 0.215, 0.185, 0.085),
        (0.130, 0.212, 0.185, 0.120),
    ):
        loops.append(level(egg(half, front, back, squareness=2.6), y))
    b.loft(np.array(loops), dark, acoustic=True)
    loops = []
    for s, y in ((1.0, 0.118), (0.99, 0.150), (0.94, 0.185), (0.82, 0.215), (0.60, 0.235), (0.30, 0.243)):
        loops.append(level(egg(0.130 * s, 0.205 * s, 0.180 * s, squareness=2.6), y))
    b.loft(np.array(loops), body, acoustic=True)


#: An upright's body leans back by 12 degrees about the axle of its wheels (m).
LEAN, PIVOT = rotation("x", -12), np.array([0.0, 0.075, -0.035])


def _leant(x: float, y: float, z: float) -> Array:
    """The place (3,) of a point of an upright's body, given as if the body stood straight on the axle (m)."""
    return np.asarray(PIVOT + LEAN @ np.array([x, y, z]))


def _upright(rng: Generator) -> Design:
    """An upright: motor head on the floor, bin and body leaning back, loop handle."""
    b = MeshBuilder()
    tone = choose(rng, "#6a2c91", "#1f6fb2", "#c8372d", "#e0b02c")
    body, dark = plastic("body", tone, roughness=0.16), plastic("dark", "#2a2c2f", roughness=0.25)
    _motor_head(b, body, dark)
    _leaning_body(b, body, dark)
    _cyclone(b, body, dark)
    # Pole and loop handle.
    b.tube([_leant(0, 0.66, -0.02), _leant(0, 0.86, -0.025)], 0.017, chrome("pole"), segments=16)
    loop = [
        _leant(0, 0.84, -0.025),
        _leant(0, 0.90, -0.01),
        _leant(0, 0.965, 0.020),
        _leant(0, 1.02, 0.005),
        _leant(0, 1.03, -0.05),
        _leant(0, 0.97, -0.075),
        _leant(0, 0.90, -0.050),
        _leant(0, 0.85, -0.028),
    ]
    b.tube(smooth_path(loop, 40), 0.0155, dark, segments=12)
    _hose(
        b,
        [
            tuple(_leant(0.09, 0.10, -0.07)),
            tuple(_leant(0.125, 0.25, -0.09)),
            tuple(_leant(0.118, 0.48, -0.10)),
            tuple(_leant(0.06, 0.68, -0.09)),
            tuple(_leant(0.025, 0.72, -0.05)),
        ],
        0.019,
        80,
    )
    label = decals.DecalCanvas(256, 96, tone)
    label.text((128, 48), "CYCLONE", 44, "#ffffff", bold=1.0)
    spot = [_leant(sx * 0.048, 0.155 + sy * 0.018, 0.0925) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(spot, printed("label", label.pixels()), fit=True, acoustic=False)
    x, y, z = (float(v) for v in _leant(0, 0.10, 0.125))
    return Design(b.build(), "floor", (x, y, z))


def _cyclone(b: MeshBuilder, body: Material, dark: Material) -> None:
    """The dust bin of an upright with its bands, its lid and the ring of cyclones."""
    bin_glass = glass("bin", "#66757d")
    b.lathe(
        [(0.0, -0.13), (0.070, -0.13), (0.078, -0.12), (0.078, 0.12), (0.070, 0.13), (0.0, 0.13)],
        bin_glass,
        centre=_leant(0, 0.375, 0.045),
        rotate=LEAN,
        segments=40,
        acoustic=True,
    )
    for dy, radius in ((-0.125, 0.081), (0.06, 0.0795), (0.125, 0.081)):
        b.lathe(
            [(radius, -0.010), (radius + 0.002, 0.0), (radius, 0.010)],
            body,
            centre=_leant(0, 0.375 + dy, 0.045),
            rotate=LEAN,
            segments=40,
            acoustic=False,
        )
    b.lathe(
        [(0.080, 0.0), (0.070, 0.045), (0.030, 0.062), (0.0, 0.064)],
        body,
        centre=_leant(0, 0.515, 0.045),
        rotate=LEAN,
        segments=40,
        acoustic=False,
    )
    for k in range(8):
        turn = rotation("y", 45 * k)
        offset = turn @ np.array([0, 0.535, 0.062])
        b.sphere(0.012, _leant(offset[0], 0.548, 0.045 + offset[2]), dark, rings=6, segments=10, acoustic=False)


def _leaning_body(b: MeshBuilder, body: Material, dark: Material) -> None:
    """The housing of an upright above its axle, and the back that carries the bin."""
    loops = []
    for half, front, back, y in (
        (0.080, 0.060, 0.070, 0.0),
        (0.120, 0.085, 0.085, 0.05),
        (0.130, 0.090, 0.090, 0.13),
        (0.122, 0.072, 0.085, 0.20),
        (0.105, 0.050, 0.080, 0.26),
    ):
        loops.append(level(egg(half, front, back, squareness=2.8), y))
    b.loft(np.array(loops), body, centre=PIVOT, rotate=LEAN)
    loops = []
    for half, front, back, y in (
        (0.105, -0.005, 0.080, 0.24),
        (0.108, 0.0, 0.082, 0.45),
        (0.100, 0.010, 0.080, 0.56),
        (0.060, 0.010, 0.060, 0.64),
        (0.030, 0.012, 0.040, 0.70),
    ):
        loops.append(level(egg(half, max(front, 0.004), back, squareness=2.8), y))
    b.loft(np.array(loops), dark, centre=PIVOT, rotate=LEAN)


def _motor_head(b: MeshBuilder, body: Material, dark: Material) -> None:
    """The floor head of an upright with its window, bumper and wheels."""
    loops = []
    outline = egg(0.165, 0.15, 0.13, squareness=5.0)
    outline[:, 1] = np.clip(outline[:, 1] * 1.35, -0.13, 0.15)
    for s, y in ((0.96, 0.006), (1.0, 0.016), (1.0, 0.050), (0.95, 0.075), (0.82, 0.098), (0.60, 0.112)):
        loops.append(level(outline * s + [0, 0.06], y))
    b.loft(np.array(loops), dark)
    b.slab(
        (0.22, 0.05, 0.004),
        (0, 0.080, 0.190),
        glass("brush_window", "#4b555c"),
        corner=0.02,
        bevel=0.001,
        rotate=rotation("x", -55),
    )
    b.slab((0.20, 0.018, 0.008), (0, 0.035, 0.209), body, corner=0.008, bevel=0.002)
    for side in (-1, 1):
        _wheel(b, side * 0.135, 0.060, 0.036, -0.055, body)


def _drum(rng: Generator) -> Design:
    """A tub on castors with a domed motor lid, its hose looping to a wand parked at the side."""
    b = MeshBuilder()
    tone = choose(rng, "#c4282b", "#e3b422", "#2f7a4b", "#2a63ad")
    body, dark = plastic("tub", tone, roughness=0.16), plastic("lid", "#1f2022", roughness=0.25)
    _tub(b, body, dark)
    for k in range(4):
        turn = rotation("y", 45 + 90 * k)
        x, _, z = turn @ np.array([0, 0, 0.165])
        b.cylinder(0.024, 0.022, (x, 0.024, z), rubber("castor"), axis="x", segments=20, bevel=0.004, acoustic=False)
    for side in (-1, 1):
        b.box((0.012, 0.075, 0.045), (side * 0.179, 0.262, 0.0), chrome("clip"), bevel=0.004, acoustic=False)
    b.tube(
        smooth_path(
            [
                (-0.085, 0.345, 0),
                (-0.085, 0.395, 0),
                (-0.05, 0.412, 0),
                (0.05, 0.412, 0),
                (0.085, 0.395, 0),
                (0.085, 0.345, 0),
            ],
            30,
        ),
        0.013,
        dark,
        segments=12,
    )
    b.cylinder(
        0.020, 0.012, (0.0, 0.352, 0.075), plastic("switch", "#c8302a"), bevel=0.003, segments=20, acoustic=False
    )
    _parked_wand(b, dark)
    label = decals.DecalCanvas(320, 128, tone)
    label.text((160, 64), "TURBO 15L", 52, "#ffffff" if tone != "#e3b422" else "#1f2022", bold=1.2)
    w, h, z = 0.055, 0.020, 0.1625
    b.quad(
        [(-w, 0.105 - h, z), (w, 0.105 - h, z), (w, 0.105 + h, z + 0.003), (-w, 0.105 + h, z + 0.003)],
        printed("label", label.pixels()),
        fit=True,
        acoustic=False,
    )
    return Design(b.build(), "floor", (0.0, 0.40, 0.10))


def _parked_wand(b: MeshBuilder, dark: Material) -> None:
    """The inlet, the hose and the wand, parked upright on the right."""
    b.cylinder(0.032, 0.05, (0, 0.185, 0.180), dark, axis="z", bevel=0.006, segments=28, acoustic=False)
    top = (0.255, 0.86, 0.03)
    _hose(
        b,
        [
            (0, 0.185, 0.200),
            (-0.02, 0.20, 0.27),
            (-0.13, 0.30, 0.28),
            (-0.19, 0.52, 0.16),
            (-0.10, 0.80, 0.05),
            (0.08, 0.96, 0.0),
            (0.22, 0.955, 0.01),
            top,
        ],
        0.022,
        130,
    )
    wand = chrome("wand")
    b.tube([top, (0.255, 0.055, 0.05)], 0.0165, wand, segments=18)
    b.tube([(0.255, 0.92, 0.026), (0.255, 0.74, 0.033)], 0.023, dark, segments=16)
    b.tube([(0.255, 0.46, 0.04), (0.255, 0.41, 0.041)], 0.021, dark, segments=16)
    b.box((0.06, 0.03, 0.04), (0.215, 0.262, 0.03), dark, bevel=0.006, acoustic=False)
    _head(b, (0.255, 0.0, 0.07), 0.26, dark, 90.0)


def _tub(b: MeshBuilder, body: Material, dark: Material) -> None:
    """The tub with its domed motor lid, a band and the ring of the castors."""
    b.lathe(
        [(0.0, 0.055), (0.145, 0.055), (0.160, 0.065), (0.170, 0.25), (0.174, 0.256), (0.174, 0.268)],
        body,
        segments=48,
    )
    b.lathe(
        [(0.178, 0.258), (0.181, 0.268), (0.178, 0.285), (0.160, 0.310), (0.135, 0.340), (0.115, 0.352), (0.0, 0.358)],
        dark,
        segments=48,
        acoustic=True,
    )
    b.lathe([(0.164, 0.150), (0.1685, 0.160), (0.1685, 0.180), (0.165, 0.190)], dark, segments=48, acoustic=False)
    b.lathe([(0.175, 0.040), (0.190, 0.048), (0.190, 0.070), (0.160, 0.080)], dark, segments=48, acoustic=False)
    b.lathe([(0.0, 0.040), (0.175, 0.040)], dark, segments=48, acoustic=False)


VARIANTS: dict[str, Build] = {"canister": _canister, "upright": _upright, "drum": _drum}
