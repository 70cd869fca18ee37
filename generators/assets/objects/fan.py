"""Fans: blades behind a cage of wire, on a table's foot or on a pole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design, Mount
from generators.assets.objects.finishes import choose, chrome, enamel, lamp, plastic, printed, rubber
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Head:
    """The part with the blades; lengths in metres.

    Attributes:
        radius: of the cage.
        blades: their number.
        spokes: number of wires from the hub to the rim, on each side.
        rings: number of rings between them, on each side.
        turn: angle at which the blades stand (degrees).
        wire: of the cage.
        blade: of the blades.
        housing: of the motor.
    """

    radius: float
    blades: int
    spokes: int
    rings: int
    turn: float
    wire: Material
    blade: Material
    housing: Material


#: Depth of half a cage as a share of its radius.
_DEEP = 0.26


def add_head(b: MeshBuilder, one: Head, centre: tuple[float, float, float], brand: str, ink: str, ground: str) -> None:
    """Cage, blades, motor behind them, and the badge in the middle of the front, about ``centre``."""
    r, at = one.radius, np.asarray(centre)
    deep = _DEEP * r
    b.torus(r, 0.0045, at, one.wire, axis="z", segments=44, minor_segments=6)
    hub = 0.24 * r
    for side in (1.0, -1.0):
        shares = np.linspace(0.24, 0.94, one.rings)
        for share in shares:
            z = side * deep * float(np.sqrt(1 - share**2))
            b.torus(share * r, 0.0014, at + [0, 0, z], one.wire, axis="z", segments=36, minor_segments=4)
        for k in range(one.spokes):
            # The wires are bent along the rim, so that they cross the blades at a slant.
            angles = 2 * np.pi * k / one.spokes + side * np.array([0.0, 0.10, 0.25, 0.42])
            path = [
                at + [s * r * np.cos(a), s * r * np.sin(a), side * deep * np.sqrt(max(0.0, 1 - s * s))]
                for s, a in zip((0.22, 0.5, 0.78, 0.998), angles, strict=True)
            ]
            b.tube(path, 0.0013, one.wire, segments=4)
    for k in range(one.blades):
        spin = rotation("z", one.turn + 360 * k / one.blades)
        b.loft(_blade(0.86 * r, hub), one.blade, centre=at, rotate=spin, acoustic=False)
    b.cylinder(0.9 * hub, 0.8 * deep, at, one.blade, axis="z", segments=28, bevel=0.006, acoustic=False)
    back = 0.55 * r + deep
    profile = [
        (0.0, 0.0),
        (0.55 * hub, 0.0),
        (0.95 * hub, 0.012),
        (1.12 * hub, 0.04),
        (1.12 * hub, back - deep),
        (0.0, back - deep),
    ]
    b.lathe(profile, one.housing, centre=at - [0, 0, back], rotate=rotation("x", 90), segments=32)
    front = at + [0, 0, deep * 0.97]
    b.cylinder(hub, 0.008, front, one.housing, axis="z", segments=32, bevel=0.003, acoustic=False)
    canvas = decals.DecalCanvas(192, 192, ground)
    canvas.text((96, 96), brand, 40, ink, bold=0.8)
    b.disc(0.88 * hub, front + [0, 0, 0.0046], "z", printed("badge", canvas.pixels()), segments=32)


def _blade(reach: float, root: float) -> Array:
    """(L, N, 3) sections of one blade along x, wide in the middle of its length and twisted."""
    outline = np.array([[1.0, 0.0], [0.5, 0.05], [-0.5, 0.05], [-1.0, 0.0], [-0.5, -0.05], [0.5, -0.05]])
    loops = []
    for share in np.linspace(0, 1, 7):
        x = 0.7 * root + (reach - 0.7 * root) * share
        half = reach * (0.16 + 0.24 * np.sin(np.pi * (0.18 + 0.66 * share)))
        lean = np.radians(38 - 20 * share)
        chord = outline * [half, 0.05 * reach]
        y = chord[:, 0] * np.cos(lean) - chord[:, 1] * np.sin(lean) + 0.16 * reach * share
        z = chord[:, 0] * np.sin(lean) * 0.5 + chord[:, 1] * np.cos(lean)
        loops.append(np.stack([np.full(len(outline), x), y, z], axis=1))
    return np.array(loops)


def sounding(b: MeshBuilder, mount: Mount, head: Head, y: float, z: float) -> Design:
    """The design; the sound leaves in front of the badge."""
    return Design(b.build(), mount, (0.0, y, z + _DEEP * head.radius + 0.035))


def add_foot(b: MeshBuilder, radius: float, height: float, material: Material, *, scale: float = 1.0) -> None:
    """A round domed foot; ``scale`` is its depth as a share of its width."""
    profile = [
        (0.0, 0.0),
        (radius, 0.0),
        (radius, 0.35 * height),
        (0.93 * radius, 0.6 * height),
        (0.5 * radius, 0.86 * height),
        (0.0, height),
    ]
    b.lathe(profile, material, scale=(1.0, 1.0, scale), segments=44)


def add_keys(
    b: MeshBuilder, at: tuple[float, float, float], count: int, pitch: float, key: Material, turn: Array
) -> None:
    """A row of keys on the foot or the column, the first of them with a pilot light."""
    for k in range(count):
        place = np.asarray(at) + turn @ [(k - (count - 1) / 2) * pitch, 0.0, 0.0]
        b.slab((0.72 * pitch, 0.6 * pitch, 0.01), place, key, corner=0.003, bevel=0.002, rotate=turn)
    side = np.asarray(at) + turn @ [-(count + 0.6) / 2 * pitch, 0.0, 0.005]
    b.sphere(0.0035, side, lamp("pilot", "#44d05a", 0.4), rings=6, segments=10, acoustic=False)


def _desk(rng: Generator) -> Design:
    """A small fan for a table, in one of three colours."""
    b = MeshBuilder()
    tone = choose(rng, "#e9e8e2", "#7fa8a4", "#2a2c2f")
    body = plastic("body", tone, roughness=0.25)
    head = Head(
        0.15, 3, 26, 6, float(rng.uniform(0, 120)), chrome("wire"), plastic("blade", "#8fa3ad", roughness=0.16), body
    )
    y, z = 0.275, 0.035
    add_foot(b, 0.105, 0.045, body, scale=0.86)
    b.tube(
        [(0, 0.03, -0.012), (0, 0.12, -0.030), (0, y - 0.06, -0.038), (0, y - 0.005, -0.034)],
        [0.026, 0.021, 0.019, 0.022],
        body,
        segments=20,
        acoustic=True,
    )
    add_keys(
        b,
        (0, 0.0335, 0.062),
        4,
        0.024,
        plastic("key", "#d9dbdc" if tone == "#2a2c2f" else "#3c4043"),
        rotation("x", -62),
    )
    ink, ground = ("#f0f0ee", tone) if tone == "#2a2c2f" else ("#35393c", tone)
    add_head(b, head, (0, y, z), "brisa", ink, ground)
    return sounding(b, "surface", head, y, z)


def _pedestal(rng: Generator) -> Design:
    """A fan on a pole with a round foot."""
    b = MeshBuilder()
    tone = choose(rng, "#232427", "#eceae4")
    body, pole = plastic("body", tone, roughness=0.36), enamel("pole", "#b9bcbe")
    blade = plastic("blade", "#4e555a" if tone == "#232427" else "#a9c3cf", roughness=0.16)
    head = Head(0.20, 5, 30, 7, float(rng.uniform(0, 72)), enamel("wire", tone), blade, body)
    y, z = 1.12, 0.06
    add_foot(b, 0.20, 0.035, body)
    for radius, low, high in ((0.017, 0.03, 0.62), (0.012, 0.60, 0.93)):
        b.cylinder(radius, high - low, (0, (low + high) / 2, 0), pole, segments=20)
    b.cylinder(0.024, 0.05, (0, 0.62, 0), body, segments=24, bevel=0.006, acoustic=False)
    b.box((0.075, 0.15, 0.06), (0, 0.95, 0), body, bevel=0.014)
    b.tube([(0, 1.0, -0.005), (0, y - 0.05, -0.02), (0, y, -0.03)], [0.026, 0.022, 0.024], body, segments=18)
    add_keys(b, (0, 0.955, 0.029), 4, 0.015, plastic("key", "#c9cccf"), np.eye(3))
    b.cylinder(
        0.016, 0.02, (0, 0.915, 0.034), rubber("timer", "#55595c"), axis="z", segments=22, bevel=0.003, acoustic=False
    )
    add_head(b, head, (0, y, z), "AURA", "#e6e8ea" if tone == "#232427" else "#3a3d40", tone)
    return sounding(b, "floor", head, y, z)


VARIANTS: dict[str, Build] = {"desk": _desk, "pedestal": _pedestal}
