"""Dishwashers, the washing machine's look-alike: a plain door below a strip of controls, in the same white or steel."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.random import Generator

from generators.assets.modelframe import before_front
from generators.assets.objects import decals
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import (
    Pixels,
    brushed_steel,
    chrome,
    enamel,
    lamp,
    plastic,
    printed,
    rubber,
)
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material


@dataclass(frozen=True)
class Cabinet:
    """What dishwashers have in common; lengths in metres.

    Attributes:
        size: width, height and depth of all.
        body: case and worktop.
        door: the door.
        strip: the fascia above the door.
        tall: height of the fascia.
        plinth: height of the recessed plinth.
        bar: the material of a bar handle across the door; None: a recessed grip below the fascia.
    """

    size: tuple[float, float, float]
    body: Material
    door: Material
    strip: Material
    tall: float
    plinth: float
    bar: Material | None = None


#: Thickness of the door, the worktop, and of how far the fascia stands out before the door (m).
_DOOR, _TOP, _LIP = 0.022, 0.028, 0.006


def add_cabinet(b: MeshBuilder, one: Cabinet) -> tuple[float, float]:
    """Everything but the print of the fascia; returns height and depth (y, z) of the middle of the fascia's face."""
    width, height, depth = one.size
    back, face = -depth / 2, depth / 2 - _DOOR - _LIP
    middle = (back + face) / 2
    foot = 0.014
    b.box((width, height - foot - _TOP, face - back), (0, (height + foot - _TOP) / 2, middle), one.body, bevel=0.004)
    b.box((width, _TOP, depth - 0.004), (0, height - _TOP / 2, -0.002), one.body, bevel=0.006)
    dark = rubber("plinth", "#25272a")
    b.slab(
        (width - 0.008, one.plinth - foot, 0.004),
        (0, (one.plinth + foot) / 2, face + 0.002),
        dark,
        corner=0.004,
        bevel=0.001,
    )
    for x in (-width / 2 + 0.05, width / 2 - 0.05):
        for z in (back + 0.05, face - 0.04):
            b.cylinder(0.018, foot + 0.002, (x, foot / 2, z), plastic("foot", "#3b3e41"), segments=16, acoustic=False)
    top = height - _TOP - 0.004
    bottom = top - one.tall
    reach = _DOOR + _LIP
    b.slab(
        (width - 0.006, one.tall, reach),
        (0, (top + bottom) / 2, face + reach / 2),
        one.strip,
        corner=0.006,
        bevel=0.004,
    )
    # A shadow gap, then the door down to the plinth.
    high, low = bottom - 0.004, one.plinth + 0.004
    b.slab(
        (width - 0.006, high - low, _DOOR), (0, (high + low) / 2, face + _DOOR / 2), one.door, corner=0.006, bevel=0.005
    )
    if one.bar is None:
        grip = min(0.46 * width, 0.24)
        b.slab((grip, 0.034, 0.004), (0, high - 0.020, face + _DOOR), dark, corner=0.012, bevel=0.002)
        b.slab((grip - 0.014, 0.006, 0.008), (0, high - 0.036, face + _DOOR), one.door, corner=0.003, bevel=0.002)
    else:
        y, reach_x, z = high - 0.055, width / 2 - 0.05, face + _DOOR
        bar = [(-reach_x, y, z - 0.002), (-reach_x, y, z + 0.030), (-reach_x + 0.012, y, z + 0.038)]
        bar += [(-x, y_, z_) for x, y_, z_ in reversed(bar)]
        b.tube(bar, 0.009, one.bar, segments=14)
    return (top + bottom) / 2, face + reach


def _print(size: tuple[float, float], ground: str, ink: str, brand: str, glow: str, minutes: int) -> Pixels:
    """The fascia: name, programmes with their lamps, a display with the time that is left, keys."""
    scale = 1600.0
    canvas = decals.DecalCanvas(round(size[0] * scale), round(size[1] * scale), ground)
    width, y = canvas.width, canvas.height / 2
    canvas.text((0.10 * width, y), brand, 40, ink, bold=0.7)
    for k, name in enumerate(("ECO 50", "AUTO", "70", "GLASS", "30 MIN")):
        x = (0.24 + 0.075 * k) * width
        canvas.disc((x, y - 24), 10, None, outline=ink, width=2)
        canvas.text((x, y + 10), name, 15, ink)
        canvas.disc((x, y + 34), 4, glow if k == 1 else ink)
    canvas.box((0.63 * width, y - 38), (0.78 * width, y + 38), "#05090b", radius=8)
    canvas.digits((0.705 * width, y), f"{minutes // 60}:{minutes % 60:02d}", 46, glow, "#10191b")
    for k, name in enumerate(("DELAY", "HALF", "START")):
        x = (0.83 + 0.055 * k) * width
        canvas.box((x - 17, y - 26), (x + 17, y + 2), None, radius=8, outline=ink, width=2)
        canvas.text((x, y + 22), name, 12, ink)
    return canvas.pixels()


def _finish(b: MeshBuilder, one: Cabinet, pixels: Pixels, y: float, z: float) -> Design:
    w, h = one.size[0] / 2 - 0.014, one.tall / 2 - 0.008
    corners = [(sx * w, y + sy * h, z + 0.0006) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    b.quad(corners, printed("fascia", pixels), fit=True, acoustic=False)
    b.cylinder(
        0.004,
        0.003,
        (0.46 * one.size[0], y - 0.012, z + 0.001),
        lamp("pilot", "#44d05a", 0.5),
        axis="z",
        segments=12,
        acoustic=False,
    )
    mesh = b.build()
    return Design(mesh, "floor", before_front(mesh, 0.5))


def _white(rng: Generator) -> Design:
    """White, 60 cm wide, with a recessed grip."""
    b = MeshBuilder()
    white = "#f1f1ee"
    one = Cabinet(
        (0.60, 0.85, 0.60), enamel("body", white), enamel("door", white), plastic("strip", white), 0.115, 0.09
    )
    y, z = add_cabinet(b, one)
    size = (one.size[0] - 0.028, one.tall - 0.016)
    return _finish(b, one, _print(size, white, "#3d4144", "lavelle", "#ff9c4a", int(rng.integers(15, 190))), y, z)


def _slim_steel(rng: Generator) -> Design:
    """Brushed steel, 45 cm wide, a black fascia, and a bar across the door."""
    b = MeshBuilder({"steel": 0.25})
    steel = brushed_steel("steel", rng, "#b6b9bb")
    body, strip = enamel("body", "#8f9397"), plastic("strip", "#1b1d1f", roughness=0.25)
    one = Cabinet((0.45, 0.84, 0.58), body, steel, strip, 0.10, 0.10, chrome("handle"))
    y, z = add_cabinet(b, one)
    size = (one.size[0] - 0.028, one.tall - 0.016)
    return _finish(b, one, _print(size, "#1b1d1f", "#dfe2e4", "NORD", "#6fe3ff", int(rng.integers(15, 190))), y, z)


VARIANTS: dict[str, Build] = {"white": _white, "slim_steel": _slim_steel}
