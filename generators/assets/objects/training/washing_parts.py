"""Round doors, control panels and plinths of washing machines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from generators.assets.forms import rounded_rectangle
from generators.assets.objects.finishes import Pixels, plastic, printed, rubber
from generators.assets.objects.training.draw import (
    between,
    chance,
    pick,
    shade,
    spread_out,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, grip
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import Material

PROGRAMMES = ("ECO", "20", "30", "40", "60", "90", "WOOL", "MIX", "SPIN", "FAST")


@dataclass(frozen=True)
class DoorPort:
    """The round door of a front loader: centre and radius of the opening, width of the ring around it (m)."""

    x: float
    y: float
    z: float
    radius: float
    ring: float


def glass_print(rng: Generator) -> Pixels:
    """The glass of a door seen from the front: a drum with holes, rings, or dark glass; a reflection."""
    side = 256
    y, x = np.mgrid[0:side, 0:side] / side * 2 - 1
    r, angle = np.hypot(x, y), np.arctan2(x, y)
    kind = rng.random()
    dark, light = between(rng, 8, 40), between(rng, 30, 110)
    value = dark + (light - dark) * np.exp(-(((r - between(rng, 0.3, 0.75)) / between(rng, 0.15, 0.35)) ** 2))
    if kind < 0.55:  # the drum shows
        for at in np.linspace(0.25, 0.75, int(rng.integers(3, 7))):
            count = round(50 * at)
            near = np.cos(count * angle + 9 * at) > 0.55
            value[near & (np.abs(r - at) < 0.022)] *= 0.45
        start = between(rng, 0, 6.28)
        for k in range(3):
            turn = np.angle(np.exp(1j * (angle - start - k * 2.094)))
            value[(np.abs(turn) * r < 0.06) & (r > 0.3) & (r < 0.8)] = light * 1.1
    elif kind < 0.75:  # moulded rings
        value += 10 * np.cos(r * between(rng, 12, 40))
    reflection = np.exp(-(((x + between(rng, 0.2, 0.5)) / 0.16) ** 4) - (((y + between(rng, 0.2, 0.5)) / 0.22) ** 4))
    value = value + between(rng, 40, 150) * reflection + 14 * (1 - y) * (r > 0.8)
    tint = np.array([1.0, 1.0, 1.0]) + rng.uniform(-0.06, 0.08, size=3)
    return np.asarray(np.clip(np.round(value[..., None] * tint), 0, 255), dtype=np.uint8)


def add_door(b: MeshBuilder, rng: Generator, port: DoorPort, body: Material, colour: str) -> None:
    """Ring or square frame, glass that bulges out or in, gasket, hinge and grip."""
    turn = rotation("x", 90)
    centre = (port.x, port.y, port.z)
    ring = trim(rng, "door_ring") if chance(rng, 0.7) else body
    inner, outer = port.radius - 0.012, port.radius + port.ring
    out = between(rng, 0.014, 0.042)
    if chance(rng, 0.2):  # a frame with rounded corners
        t = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        hole = port.radius * np.stack([np.cos(t), np.sin(t)], axis=1)
        side = 2 * outer
        frame = rounded_rectangle(side, side, between(rng, 0.15, 0.45) * side)
        b.extrude(frame, out, ring, holes=[hole], centre=centre, acoustic=False)
    else:
        crown = between(rng, 0.2, 0.8)
        profile = [(outer, -0.001), (outer, 0.5 * out), (outer - 0.15 * port.ring, 0.85 * out)]
        profile += [(port.radius + crown * port.ring, out), (port.radius, between(rng, 0.5, 1.0) * out)]
        b.lathe(profile, ring, centre=centre, rotate=turn, segments=56, acoustic=False)
    lip = plastic("door_lip", tone(rng, "#2a2c2f", "#55585c", "#d9dadb"), roughness=0.25)
    b.lathe(
        [(port.radius + 0.001, 0.9 * out), (inner, 0.7 * out), (inner, -0.025)],
        lip,
        centre=centre,
        rotate=turn,
        segments=56,
        acoustic=False,
    )
    bulge = pick(rng, -0.07, -0.04, 0.0, 0.012, 0.03)
    s = np.linspace(0, 1, 8)
    radii = inner * np.cos(s * np.pi / 2) ** 0.8
    glazing = np.stack([np.maximum(radii, 0.0), 0.25 * out + bulge * np.sin(s * np.pi / 2)], axis=1)
    add_flat_lathe(b, glazing, printed("port_glass", glass_print(rng), acoustic="glass", roughness=0.02), centre)
    side = 1 if chance(rng, 0.7) else -1
    b.box(
        (0.03, between(rng, 0.07, 0.16), 0.018),
        (port.x - side * (outer - 0.004), port.y, port.z + 0.008),
        ring,
        bevel=0.004,
        acoustic=False,
    )
    kind = rng.random()
    at = (port.x + side * (port.radius + 0.45 * port.ring), port.y, port.z + out)
    if kind < 0.5:
        size = (min(0.03, 0.7 * port.ring), between(rng, 0.08, 0.15), 0.012)
        b.slab(size, at, trim(rng, "grip"), corner=0.012, bevel=0.003)
    elif kind < 0.75:
        high = between(rng, 0.05, 0.09)
        grip(
            b,
            ((at[0], at[1] - high, port.z + 0.5 * out), (at[0], at[1] + high, port.z + 0.5 * out)),
            0.035,
            0.008,
            trim(rng, "grip"),
        )


def add_flat_lathe(b: MeshBuilder, profile: np.ndarray, material: Material, centre: tuple[float, float, float]) -> None:
    """A lathe about Z with the picture of ``material`` projected onto it from the front."""
    segments = 48
    t = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    x, y = (profile[:, :1] * f(t) for f in (np.cos, np.sin))
    vertices = np.stack([x, y, np.repeat(profile[:, 1:], segments, axis=1)], axis=2).reshape(-1, 3)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij"))
    n = (j + 1) % segments
    a, c, d, e = i * segments + j, i * segments + n, (i + 1) * segments + n, (i + 1) * segments + j
    faces = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, e], axis=1)])
    flat = vertices[:, :2] / (2 * float(profile[:, 0].max())) * 0.99 + 0.5
    b.add(vertices, faces, material, centre=centre, uv=flat[faces], acoustic=False)


def add_front_panel(
    b: MeshBuilder, rng: Generator, centre: tuple[float, float, float], size: tuple[float, float], colour: str
) -> None:
    """Drawer, knob, display, keys and name, each perhaps, in any order across the panel."""
    panel = Panel(b, rng, centre, size, colour, name="controls")
    high = size[1]
    parts = {"drawer": between(rng, 0.13, 0.19) if chance(rng, 0.75) else 0.0}
    parts["knob"] = min(high, 0.10) * 0.95 if chance(rng, 0.8) else 0.0
    parts["display"] = between(rng, 0.07, 0.13) if chance(rng, 0.65) else 0.0
    parts["keys"] = between(rng, 0.08, 0.16) if chance(rng, 0.75) or not parts["knob"] else 0.0
    parts["name"] = 0.06 if chance(rng, 0.4) else 0.0
    parts = {name: width for name, width in parts.items() if width > 0}
    if "drawer" in parts and chance(rng, 0.8):  # mostly at the left end
        names = [name for name in parts if name != "drawer"]
        rest = size[0] - parts["drawer"] - 0.02
        centres = dict(zip(names, spread_out(rng, [parts[n] for n in names], rest), strict=True))
        centres = {n: x + (parts["drawer"] + 0.02) / 2 for n, x in centres.items()}
        centres["drawer"] = -size[0] / 2 + parts["drawer"] / 2 + 0.006
    else:
        centres = dict(zip(parts, spread_out(rng, list(parts.values()), size[0]), strict=True))
    for name, x in centres.items():
        width = parts[name]
        if name == "drawer":
            drawer = plastic("drawer", shade(rng, colour, 0.03), roughness=0.36)
            b.slab((width, 0.85 * high, 0.012), panel.at(x, 0, 0.004), drawer, corner=0.008, bevel=0.004)
            gap = rubber("drawer_grip", "#303336")
            b.slab(
                (0.6 * width, 0.16 * high, 0.004),
                panel.at(x, between(rng, -0.3, 0.25) * high, 0.0095),
                gap,
                corner=0.006,
                bevel=0.001,
            )
        elif name == "knob":
            panel.knob(x, 0, between(rng, 0.26, 0.36) * min(high, 0.11), between(rng, 0.014, 0.03))
            for k, text in enumerate(PROGRAMMES[: int(rng.integers(4, 11))]):
                side = 1 if k % 2 else -1
                panel.text(x + side * 0.55 * min(high, 0.11), (0.4 - 0.2 * (k // 2)) * high, text, 0.007)
        elif name == "display":
            panel.display(
                x,
                0.1 * high,
                (width * 0.9, between(rng, 0.3, 0.5) * high),
                f"{int(rng.integers(4))}:{int(rng.integers(60)):02d}",
            )
        elif name == "keys":
            columns = int(rng.integers(2, 6))
            panel.keys(
                x,
                between(rng, -0.25, 0.15) * high,
                (columns, int(rng.integers(1, 3))),
                (width / columns, 0.24 * high),
                raised=chance(rng, 0.7),
            )
        else:
            panel.text(x, between(rng, -0.2, 0.3) * high, word(rng), 0.014)
    panel.close()


def add_plinth(
    b: MeshBuilder, rng: Generator, width: float, face: float, material: Material, bottom: float = 0.018
) -> None:
    """A line above the plinth and a flap for the filter, both perhaps; ``bottom``: lower edge of the case (m)."""
    gap = plastic("gap_line", "#3a3c3f")
    if chance(rng, 0.6):
        b.box((width - 0.012, 0.003, 0.002), (0, bottom + between(rng, 0.075, 0.11), face), gap, acoustic=False)
    kind = rng.random()
    x = (1 if chance(rng, 0.6) else -1) * between(rng, 0.28, 0.38) * width
    if kind < 0.55:
        b.slab(
            (between(rng, 0.07, 0.12), 0.06, 0.006),
            (x, bottom + 0.038, face + 0.002),
            material,
            corner=0.01,
            bevel=0.003,
        )
        b.box((0.045, 0.007, 0.004), (x, bottom + 0.057, face + 0.004), gap, acoustic=False)
    elif kind < 0.75:
        b.cylinder(
            0.028,
            0.006,
            (x, bottom + 0.042, face + 0.002),
            material,
            axis="z",
            segments=24,
            bevel=0.002,
            acoustic=False,
        )
