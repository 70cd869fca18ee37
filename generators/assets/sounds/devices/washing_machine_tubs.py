"""Top loaders: tubs on a vertical axis with an agitator, an impeller or a pulsator."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.washing_machine_parts import (
    cabinet,
    gate,
    programme,
    residual,
    reversing,
    roar,
    slosh,
    spinning,
    thumps,
)
from generators.assets.sounds.machines import (
    CONTROL_RATE,
    bursts,
    coloured,
    driven,
    expand,
    induction_motor,
    permanent_magnet_motor,
    plate,
    rolling,
    sloped,
    struck,
    switched,
    turned,
    wander,
)
from generators.assets.sounds.signals import Array


def agitator_gearcase(count: int, rng: Generator) -> Array:
    """Top loader with an agitator: an induction motor turns a gearcase that swings the agitator to and fro.

    60–72 double strokes per minute; backlash is taken up with a clack at each reversal, teeth rattle in between, water
    surges with every stroke; 120 Hz hum and slot harmonics of a four- or six-pole motor at 60 Hz.
    """
    spans = programme(count, rng, (("agitate", 30, 60), ("spin", 16, 28)))
    agitating = gate(count, spans, "agitate", 0.3)
    rate = rng.uniform(0.95, 1.2) * np.exp(wander(count, rng, 0.3, 0.01))
    strokes = turned(rate)
    motion = np.abs(np.sin(2 * np.pi * strokes)) * agitating
    reversals = np.flatnonzero(np.diff(np.floor(2 * strokes)) > 0) / CONTROL_RATE
    reversals = reversals + rng.normal(0, 0.006, len(reversals))
    active = agitating[np.clip((reversals * CONTROL_RATE).astype(np.int64), 0, len(agitating) - 1)]
    force = active * np.where(np.arange(len(reversals)) % 2 == 0, 1.0, rng.uniform(0.5, 0.9))
    force = force * np.exp(rng.normal(0, 0.3, len(reversals))) + 1e-4
    case = plate(rng, 140, 2400, 26, 0.05, slope=-1.5)
    spin = spinning(count, rng, spans, "spin", (rng.uniform(9.0, 11.0),))
    body = cabinet(rng, 60, 1200, 0.05)
    motor = induction_motor(
        count, rng, 60.0, int(rng.choice([34, 44, 48])), int(rng.choice([2, 3])), 0.8 + 0.4 * motion
    )
    teeth = driven(roar(count, rng, 150, -5.0), case) * expand(0.35 * agitating + 0.25 * motion, count)
    surge = 0.12 * agitating + 0.4 * motion**2
    return np.asarray(
        0.12 * driven(motor, body)
        + 0.07 * motor
        + 0.25 * teeth
        + 2.0 * struck(count, rng, case, reversals, force, 1.5e-3, 0.4)
        + 0.9 * rolling(count, rng, spin + 2.5 * agitating, 10.0, roar(count, rng, 58, -5.0, 7000))
        + 1.5 * slosh(count, rng, surge, (2.0, 10.0), 50.0)
        + 0.5 * thumps(count, rng, spin, body, 2.5, 0.2)
        + 0.2 * residual(count, rng)
    )


def impeller_direct(count: int, rng: Generator) -> Array:
    """Top loader with a low impeller on a direct-drive motor: strokes of one to two seconds either way, with pauses.

    The motor (12 or 20 pole pairs) accelerates within .3 s, so its tones are chirps; the water goes on turning in the
    pauses. Between washes it spins.
    """
    spans = programme(count, rng, (("wash", 40, 70), ("spin", 15, 25)))
    run = reversing(count, rng, (0.9, 1.9), (0.35, 0.7), 0.3) * gate(count, spans, "wash", 0.3)
    top, pairs = rng.uniform(11.0, 14.0), int(rng.choice([12, 20]))
    speed = rng.uniform(1.8, 2.6) * np.abs(run) + spinning(count, rng, spans, "spin", (2.0, 0.6 * top, top))
    body = plate(rng, 80, 2600, 30, 0.05, slope=-2.0)
    motor = permanent_magnet_motor(count, rng, speed, top, pairs, 3 * pairs // 2, rng.uniform(5500, 7000))
    starts = switched(np.abs(run) > 0.25)
    swirl = np.convolve(np.abs(run), np.exp(-np.arange(1400) / 350.0) / 350.0)[: len(run)]
    wash = gate(count, spans, "wash", 0.5)
    return np.asarray(
        0.2 * driven(motor, body)
        + 0.10 * motor
        + 0.9 * rolling(count, rng, speed + 1.5 * wash, top, roar(count, rng, 90, -5.2, 7000))
        + 1.5 * struck(count, rng, cabinet(rng, 50, 900, 0.07), starts, np.exp(rng.normal(0, 0.4, len(starts))), 4e-3)
        + 2.5 * slosh(count, rng, 0.25 * swirl + 0.12 * np.abs(run), (3.0, 13.0), 60.0)
        + 0.3 * residual(count, rng)
    )


#: Level of falling drops (re the machine's noise), and how much of it detergent leaves.
_DRIZZLE, _SUDS = (0.03, 0.12), 0.15


def _drizzle(count: int, rng: Generator, thrown: Array) -> Array:
    """Drops of about a millimetre that a vortex or a basket throws, back in the water; ``thrown``: how many (control).

    Source: H. C. Pumphrey, L. A. Crum, L. Bjørnø, Underwater sound produced by individual drop impacts and rainfall,
    JASA 85 (1989) 1518–1526: each such drop leaves a bubble of one size, whose ringing is a peak at 14–16 kHz, steeper
    below than above; what lowers the surface tension takes it away. Larger drops ring lower (8–12 kHz). That the bubble
    is what is heard in the air, too: S. Phillips, A. Agarwal, P. Jordan, Scientific Reports 8 (2018) 9515.
    """
    small = coloured(
        count, rng, {4000: -36.0, 9000: -22.0, 12_500: -5.0, rng.uniform(13_500, 15_500): 0.0, 22_000: -9.0}
    )
    large = coloured(count, rng, {2000: -24.0, rng.uniform(7000, 11_000): 0.0, 22_000: -16.0})
    falling = np.abs(thrown) * np.exp(wander(count, rng, 12.0, 0.3) + wander(count, rng, 0.8, 0.3))
    return (small + rng.uniform(0.2, 0.7) * large) * expand(falling, count)


def twin_tub(count: int, rng: Generator) -> Array:
    """Twin tub: a capacitor motor turns a pulsator one way for long, a clockwork timer ticks, a spinner wobbles.

    The pulsator (6–8 turns per second) draws a vortex whose surface noise is steady and whose core gulps air; the
    belt slips as it starts. The spinner's basket precesses below its turning speed (a whirling shaft), so its rattle
    beats at the difference. The timer's escapement makes some 5–8 ticks a second. Motor and shafts run in plain
    bearings, so nothing that rolls hisses; the lid is open, and drops are heard that fall into the water (`_drizzle`).
    """
    spans = programme(count, rng, (("wash", 25, 50), ("spin", 18, 35)))
    run = reversing(count, rng, (14, 26), (2.0, 3.5), 0.8) * gate(count, spans, "wash", 0.3)
    mains = float(rng.choice([50.0, 60.0]))
    spinner = spinning(count, rng, spans, "spin", (rng.uniform(21.0, 24.0),))
    on = np.clip(2.0 * np.abs(run) + spinner / 10.0, 0.0, 1.0)
    motor = induction_motor(count, rng, mains, int(rng.choice([30, 38])), 2, 1.6 - 0.6 * on)
    tub = plate(rng, 90, 1900, 24, 0.09, slope=-1.0)
    vortex = 0.45 * np.abs(run) * np.exp(wander(count, rng, 1.2, 0.2))
    gulps = bursts(count, np.cumsum(rng.exponential(0.8, int(count / 35_280) + 8)), 0.8, 0.05, 0.35) * np.abs(run)
    whirl = spinner * rng.uniform(0.55, 0.7)
    beat = 1.0 + 0.5 * np.cos(2 * np.pi * (turned(spinner) - turned(whirl))) * np.exp(-spinner / 12.0)
    squeal = driven(sloped(count, rng, 600, 3000, -2.0), plate(rng, 700, 1500, 3, 0.006))
    starting = bursts(count, switched(on > 0.1, rising=True), 1.0, 0.05, 0.7)
    ticks = np.cumsum(1.0 / rng.uniform(5.0, 8.0) + rng.normal(0, 0.003, int(9 * count / 44_100) + 9))
    force = np.exp(rng.normal(0, 0.15, len(ticks)))
    noise = rolling(count, rng, spinner + 4.0 * np.abs(run), 22.0, roar(count, rng, 75, -5.2, rng.uniform(2500, 7000)))
    thrown = np.square(run) * (_SUDS if rng.random() < 0.5 else 1.0) + spinner / 40.0
    return np.asarray(
        (0.14 * driven(motor, tub) + 0.10 * motor) * expand(on, count)
        + 0.8 * noise * expand(beat, count)
        + 1.5 * slosh(count, rng, vortex + gulps, (1.8, 12.0), 55.0)
        + rng.uniform(*_DRIZZLE) * _drizzle(count, rng, thrown)
        + 0.3 * squeal * expand(starting, count)
        + 0.25 * struck(count, rng, plate(rng, 900, 6000, 18, 0.05), ticks, force, 1.5e-4)
        + 0.35 * residual(count, rng)
    )
