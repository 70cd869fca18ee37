"""Programmes of washing machines, and what moves in them: drum, laundry, water."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.machines import (
    CONTROL_RATE,
    VibratingBody,
    bursts,
    coloured,
    control_count,
    course,
    drummed,
    expand,
    passages,
    plate,
    read_at,
    sloped,
    struck,
    turned,
    unbalance,
    wander,
)
from generators.assets.sounds.signals import Array, bubbles

#: (name, start, end) of a phase of the programme, in seconds.
Span = tuple[str, float, float]


def programme(count: int, rng: Generator, phases: Sequence[tuple[str, float, float]]) -> list[Span]:
    """Phases with (name, least, longest seconds) in turn, entered somewhere in one of them, until the end."""
    seconds, spans = count / SAMPLE_RATE, []
    number = int(rng.integers(len(phases)))
    now = -rng.uniform(0.0, 0.7) * phases[number][1]
    while now < seconds:
        name, least, longest = phases[number % len(phases)]
        spans.append((name, now, now + rng.uniform(least, longest)))
        now, number = spans[-1][2], number + 1
    return spans


def gate(count: int, spans: Sequence[Span], name: str, soft: float = 0.6) -> Array:
    """Control curve that is 1 within the phases of that name."""
    times, levels = [-1e3], [0.0]
    for each, start, end in spans:
        if each == name:
            times += [start - 1e-3, start, end, end + 1e-3]
            levels += [0.0, 1.0, 1.0, 0.0]
    return course(count, [*times, 1e9], [*levels, 0.0], soft)


def reversing(
    count: int, rng: Generator, run: tuple[float, float], pause: tuple[float, float], rise: float = 0.7
) -> Array:
    """Control curve of a speed that runs one way, stops, and runs the other way: −1 to 1."""
    seconds, now, way = count / SAMPLE_RATE, -rng.uniform(0, run[1]), 1.0
    times, levels = [now - 1.0], [0.0]
    while now < seconds + 1:
        length, still = rng.uniform(*run), rng.uniform(*pause)
        level = way * rng.uniform(0.94, 1.06)
        times += [now, now + rise, now + length, now + length + 0.8 * rise]
        levels += [0.0, level, level, 0.0]
        now, way = now + length + 0.8 * rise + still, -way
    return course(count, times, levels, 0.25 * rise) * (1.0 + wander(count, rng, 1.0, 0.015))


def spinning(count: int, rng: Generator, spans: Sequence[Span], name: str, steps: tuple[float, ...]) -> Array:
    """Control curve of spin speeds: in each phase of that name a ramp with plateaus at ``steps``, then coasting."""
    times, levels = [-1e3], [0.0]
    for each, start, end in spans:
        if each != name:
            continue
        length = end - start
        coast = 0.22 * length
        edges = start + (length - coast) * np.linspace(0, 1, len(steps) + 1) ** rng.uniform(0.8, 1.1)
        times.append(start)
        levels.append(0.0)
        for step, begin, stop in zip(steps, edges[:-1], edges[1:], strict=True):
            level = step * rng.uniform(0.97, 1.03)
            times += [begin + rng.uniform(0.4, 0.7) * (stop - begin), stop]
            levels += [level, level * rng.uniform(0.99, 1.0)]
        times += [stop + 0.5 * coast, end]
        levels += [0.4 * levels[-1], 0.0]
    return course(count, [*times, 1e9], [*levels, 0.0], 0.4) * (1.0 + wander(count, rng, 0.6, 0.003))


def cabinet(rng: Generator, low: float, high: float, loss: float) -> VibratingBody:
    """Sheet-steel cabinet with its tub: modes from ``low`` to ``high`` (Hz), the deep ones louder."""
    return plate(rng, low, high, 26, loss, slope=-1.5)


def roar(count: int, rng: Generator, low: float, slope: float, high: float = 5000.0) -> Array:
    """Broad noise of a running machine through its panels; less steep above 1 kHz, where openings leak."""
    middle = slope * np.log2(1000 / low)
    upper = middle + (slope + 1.5) * np.log2(high / 1000)
    octaves = {low / 8: -15.0, low: 0.0, 1000: middle, high: upper, 4 * high: upper - 18.0}
    return coloured(count, rng, octaves)


def laundry(count: int, rng: Generator, speed: Array, body: VibratingBody, ribs: int, wet: float) -> Array:
    """Laundry that ribs lift and let drop: soft thuds of the drum and flaps of wet cloth, while gravity beats the spin.

    Model: a load leaves the drum where gravity exceeds the centripetal force, and lands a fall later (about .2–.35 s);
    contacts of cloth last some ms, so only the deepest modes are excited well. ``wet`` raises the flaps. Buttons and
    buckles click on the drum now and then.
    """
    moments = passages(turned(speed), ribs)
    fast = np.abs(read_at(speed, moments))
    moments = moments[(fast > 0.2) & (fast < 1.25)]
    moments = moments + rng.uniform(0.18, 0.3) + rng.normal(0, 0.06, len(moments))
    force = np.exp(rng.normal(0, 0.55, len(moments)))
    thuds = struck(count, rng, body, moments, force, rng.uniform(2e-3, 5e-3), spread=0.5)
    flaps = bursts(count, moments + rng.normal(0, 0.02, len(moments)), force, 0.02, rng.uniform(0.2, 0.4))
    lifted = rng.poisson(rng.uniform(0.2, 1.2) * count / SAMPLE_RATE)
    buttons = np.sort(rng.uniform(0, count / SAMPLE_RATE, lifted))
    moving = np.abs(read_at(speed, buttons)) > 0.3
    clicks = struck(
        count,
        rng,
        plate(rng, 1200, 10_000, 18, 0.02),
        buttons[moving],
        np.exp(rng.normal(0, 0.8, moving.sum())),
        4e-5,
        0.5,
    )
    return thuds + wet * roar(count, rng, 350, -5.0) * expand(flaps, count) + 1.6 * clicks


def slosh(count: int, rng: Generator, swing: Array, radii_mm: tuple[float, float], rate: float) -> Array:
    """Water that is stirred: noise of the surface with the square of the motion, and bubbles (per second)."""
    lively = np.clip(swing, 0.0, 2.0) * np.exp(wander(count, rng, 4.0, 0.3))
    noise = sloped(count, rng, 500, 5000, -4.5, below=5.0, beyond=-8.0)
    return noise * expand(lively, count) + 0.5 * bubbles(count, rng, rate * expand(lively, count), radii_mm)


def thumps(count: int, rng: Generator, speed: Array, body: VibratingBody, resonance: float, damping: float) -> Array:
    """Blows of an unbalanced tub, once per turn, largest while the spin passes the suspension's resonance."""
    turns = turned(speed)
    moments = passages(turns + 0.03 * wander(count, rng, 2.0, 1.0), 1)
    index = np.minimum((moments * CONTROL_RATE).astype(np.int64), control_count(count) - 1)
    force = unbalance(speed, resonance, damping)[index] * np.exp(rng.normal(0, 0.25, len(moments)))
    return drummed(count, rng, body, moments, force, 4e-3, spread=0.35)


def residual(count: int, rng: Generator, low: float = 90.0) -> Array:
    """Faint sound of a machine that stands: dripping and settling water, cooling fan of the electronics, the room."""
    drops = bubbles(count, rng, rng.uniform(3.0, 12.0), (1.0, 5.0))
    return sloped(count, rng, low, 2500, -6.0) + 0.6 * drops
