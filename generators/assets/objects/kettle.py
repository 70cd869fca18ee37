"""Kettles, silent beside the coffee machine: an electric jug on its base, and an enamelled whistling kettle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import smooth_path
from generators.assets.modelframe import before_front
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import (
    brushed_steel,
    choose,
    chrome,
    enamel,
    glass,
    lamp,
    plastic,
    printed,
    rubber,
)
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Jug:
    """An electric kettle; lengths in metres.

    Attributes:
        foot: radius of the body's bottom.
        mouth: radius of its mouth.
        height: of all, with base and lid.
        belly: how far the body bulges between them.
        body: of the vessel.
        trim: of base, lid, handle and spout.
        accent: of the ring and the knob on the lid.
    """

    foot: float
    mouth: float
    height: float
    belly: float
    body: Material
    trim: Material
    accent: Material

    def radius(self, share: float) -> float:
        """Radius of the vessel at a share of its height."""
        return float(self.foot + (self.mouth - self.foot) * share + self.belly * np.sin(np.pi * share))


#: Height of an electric kettle's base, and of its lid (m).
_BASE, _LID = 0.024, 0.022


def add_jug(b: MeshBuilder, one: Jug) -> None:
    """The vessel on its base, lid, spout to the left, handle with its switch to the right, gauge in front."""
    low, high = _BASE + 0.004, one.height - _LID
    b.lathe(_rounded(one.foot + 0.012, 0.0, _BASE, 0.006), one.trim, segments=44, acoustic=False)
    shares = np.linspace(0, 1, 12)
    wall = [(one.radius(s), low + (high - low) * s) for s in shares]
    b.lathe([(0.0, low), *wall, (0.0, high)], one.body, segments=48)
    b.torus(one.radius(0.0), 0.004, (0, low + 0.003, 0), one.accent, segments=44, minor_segments=8)
    m = one.mouth
    b.lathe(
        [
            (0.0, high - 0.002),
            (m + 0.002, high - 0.002),
            (m + 0.002, high + 0.006),
            (0.7 * m, high + 0.016),
            (0.0, high + 0.020),
        ],
        one.trim,
        segments=40,
        acoustic=False,
    )
    b.cylinder(0.012, 0.012, (0.25 * m, one.height - 0.004, 0), one.accent, bevel=0.003, segments=20, acoustic=False)
    near = one.radius(0.86)
    spout = [
        (-0.72 * near, low + 0.78 * (high - low), 0),
        (-near - 0.010, high - 0.018, 0),
        (-near - 0.026, high - 0.001, 0),
    ]
    b.tube(spout, [0.030, 0.020, 0.012], one.trim, segments=18)
    bow = [
        (0.8 * m, high - 0.002, 0),
        (m + 0.035, high + 0.004, 0),
        (m + 0.062, high - 0.03, 0),
        (one.radius(0.4) + 0.058, low + 0.45 * (high - low), 0),
        (one.radius(0.15) + 0.030, low + 0.10 * (high - low), 0),
        (0.9 * one.radius(0.12), low + 0.12 * (high - low), 0),
    ]
    b.tube(smooth_path(bow, 30), 0.0125, one.trim, segments=14)
    x, y = one.radius(0.15) + 0.040, low + 0.08 * (high - low)
    b.box((0.030, 0.008, 0.022), (x, y, 0), one.accent, bevel=0.003, acoustic=False)
    _gauge(b, one, low, high)
    cord = rubber("cord", "#1d1e20")
    b.tube(
        smooth_path([(0.02, 0.008, -one.foot), (0.03, 0.005, -one.foot - 0.03), (0.06, 0.005, -one.foot - 0.035)], 10),
        0.004,
        cord,
        segments=8,
    )


def _gauge(b: MeshBuilder, one: Jug, low: float, high: float) -> None:
    """The window on the front that shows the water, and the pilot light on the base below it."""
    long = 0.52 * (high - low)
    slope = np.degrees(np.arctan2(one.radius(0.75) - one.radius(0.25), 0.5 * (high - low)))
    at = np.array([0.0, low + 0.5 * (high - low), max(one.radius(s) for s in (0.25, 0.5, 0.75)) - 0.001])
    turn = rotation("x", float(slope))
    b.slab((0.024, long, 0.006), at, glass("gauge", "#33454c"), corner=0.011, bevel=0.002, rotate=turn)
    canvas = decals.DecalCanvas(64, 320, "#41565e")
    canvas.box((4, 120), (60, 316), "#6f8d97", radius=16)
    for k, label in enumerate(("MAX", "1.5", "1.0", "0.5")):
        canvas.line([(6, 30 + 74 * k), (24, 30 + 74 * k)], "#eef2f3", 3)
        canvas.text((43, 30 + 74 * k), label, 15, "#eef2f3")
    w, h = 0.008, long / 2 - 0.008
    corners = [at + turn @ [sx * w, sy * h, 0.0034] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(corners, printed("level", canvas.pixels(), acoustic="glass", roughness=0.04), fit=True, acoustic=False)
    b.cylinder(
        0.005,
        0.004,
        (0, _BASE / 2, one.foot + 0.0122),
        lamp("pilot", "#4aa8ff", 0.5),
        axis="z",
        segments=12,
        acoustic=False,
    )


def _rounded(radius: float, low: float, high: float, edge: float) -> list[tuple[float, float]]:
    """A closed profile: a disc of that radius between two heights, its upper edge rounded."""
    arc = np.linspace(0, np.pi / 2, 5)
    return [
        (0.0, low),
        (radius, low),
        *((radius - edge * (1 - np.cos(t)), high - edge * (1 - np.sin(t))) for t in arc),
        (0.0, high),
    ]


@dataclass(frozen=True)
class Whistler:
    """A kettle for the hob; lengths in metres.

    Attributes:
        radius: of the vessel at its widest.
        tall: height of the vessel, without lid and handle.
        shape: exponent of its outline: 2 a half ellipsoid, larger ones squarer.
        arch: height of the handle above the vessel.
        body: of vessel and lid.
        metal: of bottom, spout's cap and handle.
        grip: of the handle's middle and the lid's knob.
    """

    radius: float
    tall: float
    shape: float
    arch: float
    body: Material
    metal: Material
    grip: Material


def add_whistler(b: MeshBuilder, one: Whistler) -> None:
    """The vessel with its lid, spout and cap to the left, handle over all."""
    r, top = one.radius, one.tall
    b.lathe([(0.0, 0.0), (0.92 * r, 0.0), (0.97 * r, 0.008), (0.97 * r, 0.014), (0.0, 0.014)], one.metal, segments=48)
    # A superellipse from the widest place up to the lid.
    share = np.linspace(0, 0.94, 14)
    outline = [(r * (1 - s**one.shape) ** (1 / one.shape), 0.03 + (top - 0.03) * s) for s in share]
    b.lathe(
        [(0.0, 0.013), (0.955 * r, 0.013), (0.99 * r, 0.022), *outline, (0.0, outline[-1][1])], one.body, segments=52
    )
    mouth, y = outline[-1]
    lid = min(mouth, 0.55 * r)
    b.lathe(
        [
            (0.0, y - 0.002),
            (lid, y - 0.002),
            (lid, y + 0.004),
            (0.75 * lid, y + 0.013),
            (0.3 * lid, y + 0.019),
            (0.0, y + 0.020),
        ],
        one.body,
        segments=40,
        acoustic=False,
    )
    b.torus(lid, 0.003, (0, y + 0.001, 0), one.metal, segments=40, minor_segments=8)
    b.cylinder(0.005, 0.014, (0, y + 0.024, 0), one.metal, segments=12, acoustic=False)
    b.sphere(0.013, (0, y + 0.036, 0), one.grip, rings=10, segments=20, acoustic=False)
    spout = smooth_path([(-0.80 * r, 0.45 * top, 0), (-1.08 * r, 0.62 * top, 0), (-1.22 * r, 0.92 * top, 0)], 9)
    b.tube(spout, np.linspace(0.026, 0.014, 9), one.body, segments=18)
    along = spout[-1] - spout[-2]
    along /= np.linalg.norm(along)
    b.tube(
        [spout[-1] - 0.004 * along, spout[-1] + 0.016 * along, spout[-1] + 0.020 * along],
        [0.0165, 0.0165, 0.010],
        one.metal,
        segments=18,
    )
    foot, peak = 0.62 * r, top + one.arch
    at = 0.03 + (top - 0.03) * (1 - 0.62**one.shape) ** (1 / one.shape) - 0.006
    bow = smooth_path(
        [
            (-foot, at, 0),
            (-foot - 0.012, at + 0.4 * one.arch, 0),
            (-0.45 * r, peak - 0.006, 0),
            (0, peak, 0),
            (0.45 * r, peak - 0.006, 0),
            (foot + 0.012, at + 0.4 * one.arch, 0),
            (foot, at, 0),
        ],
        42,
    )
    b.tube(bow, 0.006, one.metal, segments=12)
    b.tube(bow[14:28], np.concatenate([[0.009], np.full(12, 0.0125), [0.009]]), one.grip, segments=14)


def badge(b: MeshBuilder, name: str, radius: float, at: tuple[float, float, float], ground: str, ink: str) -> None:
    """A round enamelled badge on the front, its face at ``at``."""
    canvas = decals.DecalCanvas(192, 192, ground)
    canvas.disc((96, 96), 86, None, outline=ink, width=5)
    canvas.text((96, 96), name, 44, ink, bold=0.8)
    x, y, z = at
    b.cylinder(
        radius, 0.016, (x, y, z - 0.008), chrome("badge_rim"), axis="z", segments=36, bevel=0.001, acoustic=False
    )
    b.disc(0.92 * radius, (x, y, z + 0.0006), "z", printed("badge", canvas.pixels()), segments=36)


def _jug(rng: Generator) -> Design:
    """A jug of brushed steel with black or white parts."""
    b = MeshBuilder({"steel": 0.3})
    steel = brushed_steel("steel", rng, "#c2c5c7")
    trim = plastic("trim", choose(rng, "#1c1d1f", "#ecebe6"), roughness=0.25)
    add_jug(b, Jug(0.078, 0.058, 0.245, 0.004, steel, trim, chrome("accent")))
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.5))


def _whistling(rng: Generator) -> Design:
    """An enamelled kettle for the hob, with a wooden grip."""
    b = MeshBuilder()
    tone = choose(rng, "#b3302b", "#2d5d73", "#efe9da", "#2b4a38")
    one = Whistler(
        0.105, 0.135, 2.3, 0.085, enamel("enamel", tone), chrome(), plastic("grip", "#2a1c14", roughness=0.36)
    )
    add_whistler(b, one)
    ink, ground = ("#5a3a2a", "#f3efe4") if tone == "#efe9da" else ("#f3efe4", tone)
    badge(b, "1924", 0.022, (0.0, 0.062, 0.107), ground, ink)
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.35))


VARIANTS: dict[str, Build] = {"jug": _jug, "whistling": _whistling}
