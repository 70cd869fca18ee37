"""Kettles for training: electric jugs and whistling kettles of any outline, colour and finish."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.modelframe import before_front
from generators.assets.objects.design import Build, Design
from generators.assets.objects.finishes import enamel
from generators.assets.objects.kettle import Jug, Whistler, add_jug, add_whistler, badge
from generators.assets.objects.training.draw import (
    VIVID,
    between,
    chance,
    ink_on,
    metal,
    shell,
    timber,
    tone,
    trim,
    word,
)
from generators.assets.shapes import MeshBuilder


def _electric(rng: Generator) -> Design:
    """A jug on a base: slim or squat, straight or bulging, of plastic, enamel or steel."""
    b = MeshBuilder({"body": 0.3})
    foot = between(rng, 0.062, 0.092)
    colour = tone(rng) if chance(rng, 0.6) else tone(rng, *VIVID)
    one = Jug(
        foot,
        foot * between(rng, 0.62, 0.95),
        between(rng, 0.19, 0.28),
        between(rng, 0.0, 0.018),
        shell(rng, "body", colour, steel=0.4),
        trim(rng, "trim"),
        metal(rng, "accent"),
    )
    add_jug(b, one)
    if chance(rng, 0.5):  # beads round the body
        low, high = 0.03, one.height - 0.03
        for share in np.linspace(0.08, between(rng, 0.15, 0.3), int(rng.integers(2, 5))):
            b.torus(
                one.radius(share) + 0.0005,
                0.002,
                (0, low + (high - low) * share, 0),
                one.accent,
                segments=40,
                minor_segments=6,
            )
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.5))


def _hob(rng: Generator) -> Design:
    """A whistling kettle: flat or tall, round or square-shouldered, enamelled or polished."""
    b = MeshBuilder({"grip": 0.2})
    colour = tone(rng, *VIVID, "#efe9da", "#efefec")
    body = enamel("enamel", colour) if chance(rng, 0.7) else metal(rng, "polished")
    radius, tall, shape = between(rng, 0.085, 0.125), between(rng, 0.10, 0.17), between(rng, 1.8, 3.4)
    grip = timber(rng, "grip") if chance(rng, 0.5) else trim(rng, "grip")
    add_whistler(b, Whistler(radius, tall, shape, between(rng, 0.06, 0.11), body, metal(rng, "metal"), grip))

    def outline(share: float) -> tuple[float, float]:
        return radius * (1 - share**shape) ** (1 / shape), 0.03 + (tall - 0.03) * share

    if chance(rng, 0.6):
        at, y = outline(between(rng, 0.22, 0.4))
        badge(b, word(rng)[:4], between(rng, 0.014, 0.022), (0.0, y, at + 0.003), colour, ink_on(colour))
    band = metal(rng, "band")
    for share in np.linspace(0.6, 0.8, 3)[: int(rng.integers(4))]:
        at, y = outline(float(share))
        b.torus(at, 0.0018, (0, y, 0), band, segments=44, minor_segments=6)
    mesh = b.build()
    return Design(mesh, "surface", before_front(mesh, 0.35))


FAMILIES: dict[str, Build] = {"electric": _electric, "hob": _hob}
