"""Fans for training: table and floor fans with any number of blades, and towers with a slotted front."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.forms import rounded_rectangle
from generators.assets.objects.design import Build, Design
from generators.assets.objects.fan import Head, add_foot, add_head, add_keys, sounding
from generators.assets.objects.finishes import plastic, rubber
from generators.assets.objects.training.coffee_parts import add_stack
from generators.assets.objects.training.draw import VIVID, between, chance, ink_on, metal, pick, shade, tone, trim, word
from generators.assets.objects.training.panel import Panel, finished
from generators.assets.shapes import MeshBuilder


def _caged(rng: Generator) -> Design:
    """Blades in a cage on a table's foot or on a pole."""
    b = MeshBuilder()
    colour = tone(rng) if chance(rng, 0.7) else tone(rng, *VIVID)
    body = plastic("body", colour, roughness=between(rng, 0.16, 0.64))
    wire = metal(rng, "wire") if chance(rng, 0.5) else plastic("wire", shade(rng, colour), roughness=0.36)
    blade = plastic("blade", tone(rng, "#8fa3ad", "#4e555a", "#c9d6da", "#2b2d30", colour), roughness=0.16)
    floor = chance(rng, 0.4)
    radius = between(rng, 0.17, 0.24) if floor else between(rng, 0.10, 0.18)
    head = Head(
        radius,
        int(rng.integers(3, 7)),
        int(rng.integers(16, 30)),
        int(rng.integers(3, 7)),
        between(rng, 0, 120),
        wire,
        blade,
        body,
    )
    y = between(rng, 0.85, 1.25) if floor else radius + between(rng, 0.08, 0.16)
    z = between(rng, 0.02, 0.07)
    foot, high = radius * between(rng, 0.62, 1.0), between(rng, 0.025, 0.05)
    add_foot(b, foot, high, body, scale=between(rng, 0.8, 1.0))
    thick = between(rng, 0.012, 0.022)
    if floor:
        b.cylinder(thick, y - 0.2 - 0.5 * high, (0, (y - 0.2 + 0.5 * high) / 2, -0.01), trim(rng, "pole"), segments=18)
        b.box((0.07, 0.14, 0.055), (0, y - 0.20, -0.005), body, bevel=0.012)
        add_keys(b, (0, y - 0.2, 0.0215), 4, 0.014, plastic("key", tone(rng, "#c9cccf", "#3c4043")), np.eye(3))
    b.tube(
        [(0, y - 0.22 if floor else 0.5 * high, -0.01), (0, y - 0.06, -0.03), (0, y, -0.034)],
        [1.5 * thick, 1.2 * thick, thick],
        body,
        segments=16,
        acoustic=True,
    )
    add_head(b, head, (0, y, z), word(rng)[:5], ink_on(colour), colour)
    return sounding(b, "floor" if floor else "surface", head, y, z)


def _tower(rng: Generator) -> Design:
    """A slim column with slots, on a round foot; its controls are above the slots."""
    b = MeshBuilder()
    colour = tone(rng, "#232427", "#efefec", "#c3c6c8", "#8d9195")
    body = plastic("body", colour, roughness=between(rng, 0.16, 0.64))
    floor = chance(rng, 0.7)
    width, depth = between(rng, 0.13, 0.20), between(rng, 0.12, 0.20)
    height = between(rng, 0.75, 1.1) if floor else between(rng, 0.30, 0.42)
    foot = between(rng, 0.02, 0.035)
    add_foot(b, between(rng, 0.62, 0.85) * width, foot, trim(rng, "foot"))
    outline = rounded_rectangle(width, depth, between(rng, 0.2, 0.48) * min(width, depth), steps=8)
    taper = between(rng, 0.88, 1.0)
    low = 0.6 * foot
    add_stack(b, outline, [(0.96, low), (1.0, low + 0.012), (taper, height - 0.014), (0.94 * taper, height)], 0.0, body)
    z = depth / 2
    span, bottom, top = 0.62 * width, 0.14 * height, 0.80 * height
    dark = rubber("dark", "#141516")
    b.slab((span, top - bottom, 0.012), (0, (top + bottom) / 2, z - 0.003), dark, corner=0.02, bevel=0.002)
    bars = plastic("bars", shade(rng, colour), roughness=0.36)
    if chance(rng, 0.5):
        for x in np.linspace(-0.44, 0.44, int(rng.integers(5, 10))) * span:
            b.box((0.004, top - bottom - 0.012, 0.008), (float(x), (top + bottom) / 2, z + 0.004), bars, acoustic=False)
    else:
        for y in np.arange(bottom + 0.012, top - 0.006, between(rng, 0.011, 0.02)):
            b.box((span - 0.008, 0.004, 0.008), (0, float(y), z + 0.004), bars, acoustic=False)
    high = 0.13 * height if floor else 0.15 * height
    panel = Panel(
        b, rng, (0, 0.885 * height, z - 0.001), (pick(rng, 0.5, 0.58) * width, high), shade(rng, colour, 0.01)
    )
    panel.display(0, 0.26 * high, (0.8 * panel.size[0], 0.34 * high), f"{int(rng.integers(18, 32))}")
    panel.keys(0, -0.12 * high, (3, 1), (0.3 * panel.size[0], 0.2 * high), raised=False)
    panel.text(0, -0.38 * high, word(rng), 0.1 * high)
    # A flat plate carries the print before the rounded body.
    b.slab(
        (panel.size[0] + 0.008, high + 0.008, 0.02), (0, 0.885 * height, z - 0.0112), bars, corner=0.006, bevel=0.002
    )
    panel.close()
    return finished(b, "floor" if floor else "surface", 0.5)


FAMILIES: dict[str, Build] = {"caged": _caged, "tower": _tower}
