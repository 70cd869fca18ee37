"""Dishwashers for training: full width or slim, any fascia, a recessed grip or a bar across the door."""

from __future__ import annotations

from numpy.random import Generator

from generators.assets.objects.design import Build, Design
from generators.assets.objects.dishwasher import Cabinet, add_cabinet
from generators.assets.objects.training.draw import (
    between,
    brightness,
    chance,
    pick,
    shade,
    shell,
    spread_out,
    tone,
    trim,
    word,
)
from generators.assets.objects.training.panel import Panel, finished
from generators.assets.shapes import MeshBuilder


def _drawn(rng: Generator, size: tuple[float, float, float], bar: bool) -> Design:
    """A dishwasher of that size with the controls in a random order."""
    b = MeshBuilder({"body": 0.25, "door": 0.25, "strip": 0.25})
    colour = tone(rng)
    door = shell(rng, "door", colour if chance(rng, 0.7) else tone(rng, "#efefec", "#b9bcbe", "#232427"), steel=0.3)
    ground = colour if chance(rng, 0.5) else tone(rng, "#1b1d1f", "#efefec", "#8d9195", "#c3c6c8")
    tall = between(rng, 0.075, 0.14)
    one = Cabinet(
        size,
        shell(rng, "body", colour, steel=0.05),
        door,
        shell(rng, "strip", ground, steel=0.0),
        tall,
        between(rng, 0.05, 0.13) * size[1] / 0.85,
        trim(rng, "handle") if bar else None,
    )
    y, z = add_cabinet(b, one)
    panel = Panel(b, rng, (0, y, z), (size[0] - 0.03, tall - 0.018), shade(rng, ground, 0.01))
    width, high = panel.size
    places = spread_out(rng, [0.2 * width, 0.22 * width, 0.34 * width], 0.94 * width)
    panel.text(places[0], 0.0, word(rng), 0.22 * high)
    if chance(rng, 0.75):
        panel.display(places[1], 0.0, (0.16 * width, between(rng, 0.35, 0.6) * high))
    else:
        panel.knob(places[1], 0.0, 0.28 * high, between(rng, 0.014, 0.024))
    count = int(rng.integers(3, 7))
    raised = brightness(ground) > 0.5 or chance(rng, 0.5)
    panel.keys(places[2], 0.0, (count, 1), (0.3 * width / count, pick(rng, 0.25, 0.4) * high), raised=raised)
    for k in range(int(rng.integers(1, 5))):
        panel.lamp(places[2] + 0.03 * width * (k - 2), 0.38 * high, 0.003)
    panel.close()
    return finished(b, "floor", 0.5)


def _grip(rng: Generator) -> Design:
    """A recessed grip below the fascia."""
    return _drawn(
        rng,
        (pick(rng, 0.45, 0.6) * between(rng, 0.97, 1.03), between(rng, 0.80, 0.90), between(rng, 0.54, 0.66)),
        False,
    )


def _bar(rng: Generator) -> Design:
    """A bar across the door."""
    return _drawn(
        rng, (pick(rng, 0.45, 0.6) * between(rng, 0.97, 1.03), between(rng, 0.80, 0.90), between(rng, 0.54, 0.66)), True
    )


FAMILIES: dict[str, Build] = {"grip": _grip, "bar": _bar}
