"""Toilets: a hollow bowl with seat and lid; close-coupled with a cistern, skirted, or hung on a wall panel."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from generators.assets.forms import egg, level
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import ceramic, chrome, paint, plastic
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

Array = NDArray[np.float64]
#: Height of the bowl's rim above the floor, metres.
RIM = 0.40


def _shifted(outline: Array, z: float) -> Array:
    return np.asarray(outline + np.array([0.0, z]))


def _bowl(b: MeshBuilder, outer: list[Array], rim: tuple[float, float, float], z: float, material: Material) -> None:
    """The ceramic: ``outer`` loops up to the rim's edge, over the rim (half width, front, back) and down inside."""
    half, front, back = rim
    loops = list(outer)
    for inset, y in ((0.004, RIM), (0.030, RIM), (0.040, RIM - 0.006)):
        loops.append(level(_shifted(egg(half - inset, front - inset, back - inset), z), y))
    for part, y in ((0.93, RIM - 0.03), (0.86, RIM - 0.08), (0.70, RIM - 0.14), (0.50, RIM - 0.185)):
        inside = egg((half - 0.04) * part, (front - 0.04) * part, (back - 0.04) * part)
        loops.append(level(_shifted(inside, z), y))
    b.loft(np.array(loops), material, acoustic=True)
    water = paint("water", "water", "#9fb4bd", roughness=0.01)
    loop = level(_shifted(egg((half - 0.04) * 0.56, (front - 0.04) * 0.56, (back - 0.04) * 0.56), z), RIM - 0.168)
    b.loft(np.array([loop, loop + np.array([0, 0.001, 0])]), water, acoustic=False)


def _seat(b: MeshBuilder, rim: tuple[float, float, float], z: float, material: Material) -> None:
    half, front, back = (v + 0.004 for v in rim)
    y = RIM + 0.004
    loops = []
    for inset, dy in ((0.0, 0.0), (-0.002, 0.008), (0.006, 0.017), (0.03, 0.020), (0.056, 0.016), (0.062, 0.0)):
        loops.append(level(_shifted(egg(half - inset, front - inset, back - inset, squareness=3.0), z), y + dy))
    b.loft(np.array([*loops, loops[0]]), material, caps="none", crease=60, acoustic=False)


def _lid(b: MeshBuilder, rim: tuple[float, float, float], z: float, material: Material, degrees: float) -> None:
    """The lid, hinged at the rim's back and opened by ``degrees``."""
    half, front, back = (v + 0.002 for v in rim)
    hinge = np.array([0.0, RIM + 0.03, z - back + 0.012])
    loops = []
    for inset, dy in ((0.004, 0.0), (0.0, 0.006), (0.004, 0.014), (0.02, 0.019), (0.07, 0.0225)):
        outline = _shifted(egg(half - inset, front - inset, back - inset, squareness=3.0), back - 0.012)
        loops.append(level(outline, dy))
    turn = rotation("x", -degrees)
    b.loft(np.array(loops), material, centre=hinge, rotate=turn, acoustic=False)
    for x in (-0.075, 0.075):
        b.cylinder(
            0.011, 0.04, (x, RIM + 0.02, hinge[2] - 0.004), chrome("hinge"), axis="x", segments=16, acoustic=False
        )


def _close_coupled(rng: Generator) -> Design:
    """Cistern on the bowl, lid up."""
    b = MeshBuilder()
    white, seat = ceramic(), plastic("seat", "#f4f4f1", roughness=0.25)
    rim, z = (0.182, 0.27, 0.20), 0.10
    heights = [0.0, 0.012, 0.05, 0.16, 0.25, 0.31, 0.355, 0.385, RIM]
    halves = [0.112, 0.115, 0.105, 0.098, 0.115, 0.15, 0.176, 0.183, 0.182]
    fronts = [0.15, 0.155, 0.145, 0.14, 0.17, 0.22, 0.26, 0.272, 0.270]
    backs = [0.30, 0.305, 0.30, 0.29, 0.275, 0.245, 0.215, 0.203, 0.200]
    outer = [
        level(_shifted(egg(h, f, r, squareness=3.5), z), y)
        for h, f, r, y in zip(halves, fronts, backs, heights, strict=True)
    ]
    _bowl(b, outer, rim, z, white)
    # The shelf that carries the cistern.
    b.box((0.34, 0.075, 0.25), (0, RIM - 0.037, -0.190), white, bevel=0.02, acoustic=False)
    b.box((0.385, 0.335, 0.165), (0, RIM + 0.17, -0.235), white, bevel=0.028, segments=3)
    b.box((0.40, 0.035, 0.182), (0, RIM + 0.349, -0.233), white, bevel=0.012, acoustic=False)
    _flush_button(b, (0.0, RIM + 0.367, -0.233))
    _seat(b, rim, z, seat)
    _lid(b, rim, z, seat, 95.0)
    return Design(b.build(), "floor", (0.0, RIM + 0.045, z + rim[1] - 0.03))


def _flush_button(b: MeshBuilder, at: tuple[float, float, float]) -> None:
    x, y, z = at
    b.cylinder(0.034, 0.006, (x, y + 0.002, z), chrome("flush_ring"), bevel=0.002, acoustic=False)
    b.cylinder(0.028, 0.006, (x, y + 0.005, z), chrome("flush_button"), bevel=0.002, acoustic=False)
    b.box((0.002, 0.002, 0.056), (x, y + 0.0085, z), plastic("flush_gap", "#4b4e52"), acoustic=False)


def _skirted(rng: Generator) -> Design:
    """A smooth floor-standing pan with a slim cistern, lid closed."""
    b = MeshBuilder()
    white, seat = ceramic("ceramic", "#f1f0ec"), plastic("seat", "#f3f3f0", roughness=0.25)
    rim, z = (0.180, 0.265, 0.19), 0.07
    outer = []
    for half, front, back, y in (
        (0.112, 0.120, 0.30, 0.0),
        (0.118, 0.130, 0.31, 0.015),
        (0.128, 0.150, 0.31, 0.12),
        (0.148, 0.195, 0.31, 0.22),
        (0.170, 0.245, 0.31, 0.31),
        (0.179, 0.263, 0.31, 0.36),
        (0.180, 0.265, 0.31, RIM),
    ):
        outer.append(level(_shifted(egg(half, front, back, squareness=7.0), z), y))
    _bowl(b, outer, rim, z, white)
    b.box((0.37, 0.36, 0.15), (0, RIM + 0.18, -0.235), white, bevel=0.016, segments=3)
    b.box((0.38, 0.030, 0.160), (0, RIM + 0.372, -0.234), white, bevel=0.010, acoustic=False)
    _flush_button(b, (0.0, RIM + 0.386, -0.234))
    _seat(b, rim, z, seat)
    _lid(b, rim, z, seat, 0.0)
    return Design(b.build(), "floor", (0.0, RIM + 0.08, z + 0.06))


def _wall_hung(rng: Generator) -> Design:
    """A pan hung on a tiled panel that hides the cistern, with a flush plate; lid up."""
    b = MeshBuilder()
    white, seat = ceramic("ceramic", "#f6f6f3"), plastic("seat", "#f5f5f2", roughness=0.25)
    panel = paint("panel", "tile", "#8f979b", roughness=0.49)
    b.box((0.62, 1.12, 0.13), (0, 0.56, -0.30), panel, bevel=0.004)
    b.box((0.635, 0.022, 0.145), (0, 1.131, -0.295), paint("panel_top", "tile", "#e9e7e2"), bevel=0.004, acoustic=False)
    joint = paint("joint", "tile", "#6f777b")
    for y in (0.30, 0.60, 0.90):
        b.box((0.618, 0.003, 0.002), (0, y, -0.235), joint, acoustic=False)
    b.box((0.003, 1.11, 0.002), (0, 0.56, -0.2352), joint, acoustic=False)
    rim, z = (0.180, 0.275, 0.20), 0.04
    outer = []
    for half, front, back, y in (
        (0.080, 0.06, 0.262, 0.085),
        (0.115, 0.11, 0.272, 0.105),
        (0.135, 0.155, 0.276, 0.16),
        (0.160, 0.215, 0.278, 0.25),
        (0.178, 0.262, 0.278, 0.34),
        (0.182, 0.278, 0.278, 0.385),
        (0.180, 0.275, 0.278, RIM),
    ):
        outer.append(level(_shifted(egg(half, front, back, squareness=6.0), z), y))
    _bowl(b, outer, rim, z, white)
    _seat(b, rim, z, seat)
    _lid(b, rim, z, seat, 92.0)
    b.slab((0.246, 0.164, 0.012), (0, 1.00, -0.229), plastic("plate", "#f4f4f2", roughness=0.25), corner=0.012)
    for x, size in ((-0.052, 0.115), (0.066, 0.075)):
        b.slab((size, 0.12, 0.008), (x, 1.00, -0.2205), chrome("flush_key"), corner=0.006, bevel=0.003)
    return Design(b.build(), "floor", (0.0, RIM + 0.045, z + rim[1] - 0.03))


VARIANTS: dict[str, Build] = {
    "close_coupled": _close_coupled,
    "skirted": _skirted,
    "wall_hung": _wall_hung,
}
