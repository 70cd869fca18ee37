"""Radios, which speech and music could come from and never do: a wooden table set and a portable with a handle."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.forms import smooth_path
from generators.assets.modelframe import before_front
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import Pixels, choose, chrome, plastic, printed, rubber, wood
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

XY = tuple[float, float]


def grille(size: XY, ground: str, hole: str, pitch: float, *, round_: bool = False) -> Pixels:
    """A loudspeaker's face of ``size`` (m): rows of holes ``pitch`` metres apart, or rings of them."""
    scale = 1600.0
    canvas = decals.DecalCanvas(round(size[0] * scale), round(size[1] * scale), ground)
    width, height, step = canvas.width, canvas.height, pitch * scale
    if round_:
        limit = 0.46 * min(width, height)
        for ring in range(int(limit / step) + 1):
            count = max(1, round(2 * np.pi * ring))
            for k in range(count):
                a = 2 * np.pi * k / count
                canvas.disc(
                    (width / 2 + ring * step * np.cos(a), height / 2 + ring * step * np.sin(a)), 0.3 * step, hole
                )
        return canvas.pixels()
    for row, y in enumerate(np.arange(step, height - 0.5 * step, step)):
        for x in np.arange(step + 0.5 * step * (row % 2), width - 0.5 * step, step):
            canvas.disc((float(x), float(y)), 0.3 * step, hole)
    return canvas.pixels()


def cloth(rng: Generator, size: XY, ground: str, thread: str) -> Pixels:
    """A woven loudspeaker cloth of ``size`` (m) with darker threads."""
    scale = 1400.0
    canvas = decals.DecalCanvas(round(size[0] * scale), round(size[1] * scale), ground)
    for x in np.arange(2, canvas.width, 5):
        canvas.line([(float(x), 0), (float(x), canvas.height)], thread, 1.6)
    for y in np.arange(2, canvas.height, 5):
        canvas.line([(0, float(y)), (canvas.width, float(y))], thread, 1.2)
    grain = rng.normal(0, 5, size=(canvas.height, canvas.width, 1))
    return np.asarray(np.clip(canvas.pixels() + grain, 0, 255), dtype=np.uint8)


def scale_print(size: XY, ground: str, ink: str, mark: str, tuned: float) -> Pixels:
    """A tuning scale of ``size`` (m) with FM and AM, its pointer at the share ``tuned``."""
    per = 1600.0
    canvas = decals.DecalCanvas(round(size[0] * per), round(size[1] * per), ground)
    width, height = canvas.width, canvas.height
    left, right = 0.12 * width, 0.95 * width
    for y, name, labels in (
        (0.32, "FM", ("88", "92", "96", "100", "104", "108")),
        (0.72, "AM", ("53", "60", "80", "110", "140", "170")),
    ):
        canvas.text((0.06 * width, y * height), name, 0.2 * height, ink, bold=0.4)
        canvas.line([(left, y * height), (right, y * height)], ink, 1.5)
        for k in range(26):
            x = left + (right - left) * k / 25
            canvas.line([(x, y * height), (x, (y + (0.08 if k % 5 else 0.13)) * height)], ink, 1.5)
        for k, label in enumerate(labels):
            canvas.text((left + (right - left) * k / 5, (y - 0.13) * height), label, 0.17 * height, ink)
    x = left + (right - left) * tuned
    canvas.line([(x, 0.06 * height), (x, 0.94 * height)], mark, 4)
    return canvas.pixels()


def face(
    b: MeshBuilder, name: str, pixels: Pixels, centre: tuple[float, float, float], size: XY, acoustic: str = "plastic"
) -> None:
    """A picture of ``size`` (m) on the front, about ``centre``."""
    x, y, z = centre
    w, h = size[0] / 2, size[1] / 2
    corners = [(x + sx * w, y + sy * h, z) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(
        corners,
        printed(name, pixels, acoustic=acoustic, roughness=0.81 if acoustic == "fabric" else 0.36),
        fit=True,
        acoustic=False,
    )


def dial(
    b: MeshBuilder, x: float, y: float, z: float, radius: float, knob: Material, ring: Material, angle: float
) -> None:
    """A knob on the front with a ring and a mark."""
    b.cylinder(1.18 * radius, 0.004, (x, y, z + 0.002), ring, axis="z", segments=30, acoustic=False)
    b.cylinder(
        radius,
        0.018,
        (x, y, z + 0.010),
        knob,
        axis="z",
        segments=30,
        top_radius=0.9 * radius,
        bevel=0.002,
        acoustic=False,
    )
    turn = rotation("z", angle)
    tip = np.array([x, y, z + 0.0195]) + turn @ [0, 0.55 * radius, 0]
    b.box((0.1 * radius, 0.5 * radius, 0.002), tip, plastic("mark", "#f0f0f0"), rotate=turn, acoustic=False)


def aerial(b: MeshBuilder, foot: tuple[float, float, float], lean: float, length: float, metal: Material) -> None:
    """A telescopic aerial of three tubes that leans to the right by ``lean`` degrees."""
    way = np.array([np.sin(np.radians(lean)), np.cos(np.radians(lean)), 0.0])
    at = np.asarray(foot)
    b.sphere(0.006, at, metal, rings=8, segments=14, acoustic=False)
    for k, radius in enumerate((0.0032, 0.0024, 0.0017)):
        b.tube([at + way * length * k / 3, at + way * length * (k + 1) / 3], radius, metal, segments=10)
    b.sphere(0.0035, at + way * length, metal, rings=8, segments=12, acoustic=False)


def _wooden(rng: Generator) -> Design:
    """A table set in a wooden case: cloth to the left, scale and two knobs to the right."""
    b = MeshBuilder({"wood": 0.4})
    w, h, d = 0.34, 0.19, 0.16
    timber = wood("wood", rng, choose(rng, "#6b4326", "#8a5a34", "#4a2b1a"))
    b.box((w, h - 0.012, d), (0, (h + 0.012) / 2, 0), timber, bevel=0.016, segments=3)
    for x in (-w / 2 + 0.04, w / 2 - 0.04):
        for z in (-d / 2 + 0.035, d / 2 - 0.035):
            b.cylinder(0.012, 0.016, (x, 0.008, z), rubber("foot"), segments=14, acoustic=False)
    z, brass = d / 2, chrome("brass", "#e2b35c")
    b.slab(
        (w - 0.03, h - 0.042, 0.006),
        (0, (h + 0.012) / 2, z + 0.001),
        plastic("front", "#e8dfc8"),
        corner=0.012,
        bevel=0.003,
    )
    z += 0.0046
    mid = (h + 0.012) / 2
    face(b, "cloth", cloth(rng, (0.165, 0.124), "#b29a6c", "#7b6540"), (-0.066, mid, z), (0.165, 0.124), "fabric")
    for y in (mid - 0.062, mid + 0.062):
        b.box((0.168, 0.003, 0.003), (-0.066, y, z + 0.001), brass, acoustic=False)
    for x in (-0.150, 0.018):
        b.box((0.003, 0.127, 0.003), (x, mid, z + 0.001), brass, acoustic=False)
    face(
        b,
        "scale",
        scale_print((0.118, 0.056), "#2a1d14", "#f0d9a0", "#e0452e", float(rng.uniform(0.1, 0.9))),
        (0.086, mid + 0.034, z),
        (0.118, 0.056),
    )
    knob = plastic("knob", "#3a2a1e", roughness=0.25)
    for x in (0.054, 0.118):
        dial(b, x, mid - 0.034, z - 0.001, 0.020, knob, brass, float(rng.uniform(-130, 130)))
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.5))


def _portable(rng: Generator) -> Design:
    """A portable of plastic: a round loudspeaker, a scale, keys on top, a handle and an aerial."""
    b = MeshBuilder()
    w, h, d = 0.27, 0.155, 0.075
    tone = choose(rng, "#26282b", "#a83530", "#dfe0dc", "#3f6b62")
    pale = tone == "#dfe0dc"
    b.box((w, h, d), (0, h / 2, 0), plastic("case", tone, roughness=0.36), bevel=0.014, segments=3)
    z, metal = d / 2, chrome()
    b.slab(
        (w - 0.016, h - 0.018, 0.006),
        (0, h / 2, z),
        plastic("front", "#c9ccce" if not pale else "#3b3f42", roughness=0.25),
        corner=0.012,
        bevel=0.003,
    )
    z += 0.003
    b.cylinder(0.058, 0.006, (-0.062, h / 2, z + 0.002), metal, axis="z", segments=44, bevel=0.002, acoustic=False)
    holes = grille((0.11, 0.11), "#3a3d40", "#0b0c0d", 0.0045, round_=True)
    b.disc(0.053, (-0.062, h / 2, z + 0.0054), "z", printed("grille", holes), segments=44)
    face(
        b,
        "scale",
        scale_print((0.116, 0.052), "#101315", "#d7e6e8", "#ff5a3a", float(rng.uniform(0.1, 0.9))),
        (0.062, h / 2 + 0.030, z + 0.0006),
        (0.116, 0.052),
    )
    knob = plastic("knob", "#1c1d1f", roughness=0.25)
    dial(b, 0.100, h / 2 - 0.036, z, 0.021, knob, metal, float(rng.uniform(-130, 130)))
    for k in range(3):
        b.slab(
            (0.022, 0.012, 0.006),
            (0.012 + 0.027 * k, h / 2 - 0.036, z + 0.002),
            plastic("key", "#8d9195"),
            corner=0.004,
            bevel=0.002,
        )
    for k in range(4):
        b.box(
            (0.024, 0.006, 0.016),
            (-0.09 + 0.032 * k, h + 0.002, 0.008),
            plastic("key", "#8d9195"),
            bevel=0.002,
            acoustic=False,
        )
    x, top = w / 2 - 0.012, h + 0.052
    handle = smooth_path(
        [
            (-x, h - 0.02, 0),
            (-x, h + 0.03, 0),
            (-x + 0.022, top, 0),
            (0, top + 0.002, 0),
            (x - 0.022, top, 0),
            (x, h + 0.03, 0),
            (x, h - 0.02, 0),
        ],
        34,
    )
    b.tube(handle, 0.0065, plastic("handle", "#1c1d1f"), segments=12)
    aerial(b, (w / 2 - 0.03, h + 0.003, -d / 2 + 0.012), 24.0, 0.20, metal)
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.4))


VARIANTS: dict[str, Build] = {"wooden": _wooden, "portable": _portable}
