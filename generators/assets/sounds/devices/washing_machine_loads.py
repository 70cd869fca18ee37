"""Front loaders of which one hears the load rather than the motor: wet laundry that falls, and one that is uneven."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.washing_machine_parts import (
    cabinet,
    gate,
    laundry,
    programme,
    residual,
    reversing,
    roar,
    slosh,
    spinning,
    thumps,
)
from generators.assets.sounds.fans import modes, radiated, ripple, slopes
from generators.assets.sounds.machines import (
    bursts,
    driven,
    drummed,
    expand,
    induction_motor,
    passages,
    plate,
    read_at,
    rolling,
    sloped,
    struck,
    switched,
    tones,
    turned,
    unbalance,
    wander,
)
from generators.assets.sounds.signals import Array


def _landings(count: int, rng: Generator, speed: Array, bundles: int) -> tuple[Array, Array]:
    """Moments (s) at which bundles of laundry land, and their forces.

    A bundle leaves the drum where the centripetal force no longer holds it (M. E. Roberts et al., ANZIAM Journal 59
    (2019) M30–M62) and falls for .2 to .35 s. It keeps its place on the drum for some turns, so bundles have weights of
    their own, and it slips: no two turns are alike.
    """
    moments = passages(turned(speed) + 0.07 * wander(count, rng, 0.8, 1.0), bundles)
    weights = np.exp(rng.normal(0, 0.4, bundles))[np.arange(len(moments)) % bundles]
    # Below a third of the usual speed, the load slides instead of falling.
    force = weights * np.exp(rng.normal(0, 0.3, len(moments))) * (np.abs(read_at(speed, moments)) > 0.3)
    return moments + rng.uniform(0.2, 0.35) + rng.normal(0, 0.04, len(moments)), force


def wet_tumble(count: int, rng: Generator) -> Array:
    """Front loader that washes a heavy wet load at 43 to 53 rpm: thuds of cloth, splashes, a faint motor, long pauses.

    Model: an induction motor of twelve poles turns the drum by a belt (1 : 9–11 at 50, 1 : 11–13 at 60 Hz); two to four
    bundles fall each turn (`_landings`), soft on the drum and loud on the water in it; ribs pour out what they lifted.
    In the pauses the laundry drips. The closed tub and suds dull all of it. Units: motor, belt, tub, dullness, door,
    bundles, depth of the water.
    """
    run = reversing(count, rng, (8, 24), (1.5, 4.5), 0.6)
    mains = float(rng.choice([50.0, 60.0]))
    ratio = rng.uniform(9.0, 11.0) * mains / 50.0
    wash = run * mains / 6 * 0.95 / ratio
    bundles = int(rng.integers(2, 5))
    moments, force = _landings(count, rng, wash, bundles)
    body = cabinet(rng, rng.uniform(42, 70), rng.uniform(600, 1100), 0.07)
    glass = plate(rng, rng.uniform(280, 500), 3200, 14, 0.05, slope=-1.0)
    motor = induction_motor(count, rng, mains, int(rng.choice([36, 44, 48])), 6, 1.0 + wander(count, rng, 1.6, 0.2))
    on = expand(np.clip(2.0 * np.abs(run), 0.0, 1.0), count)
    relay = switched(np.abs(run) > 0.15)
    thuds = struck(count, rng, body, moments, force, rng.uniform(4e-3, 9e-3), spread=0.5)
    slaps = roar(count, rng, rng.uniform(250, 450), -5.0) * expand(bursts(count, moments, force, 0.015, 0.22), count)
    deep = rng.uniform(0.4, 1.0)
    thrown = bursts(count, moments + 0.03, deep * force, 0.04, rng.uniform(0.35, 0.7)) + 0.15 * deep * np.abs(run)
    water = slosh(count, rng, thrown, (1.2, 9.0), 90.0)
    poured = slosh(count, rng, 0.5 * deep * np.abs(run) * np.exp(wander(count, rng, 2.5, 0.5)), (0.9, 5.0), 60.0)
    drip = slosh(count, rng, 0.12 * np.exp(wander(count, rng, 0.7, 0.5)), (0.9, 4.0), 90.0)
    inside = (
        rng.uniform(0.03, 0.07) * driven(motor, body) * on
        + rng.uniform(0.02, 0.05) * motor * on
        + 0.5 * rolling(count, rng, wash, 0.9, roar(count, rng, rng.uniform(70, 130), -6.0, rng.uniform(2500, 7000)))
        + rng.uniform(0.8, 1.4) * thuds
        + rng.uniform(0.5, 1.1) * slaps
        + 0.7 * (water + poured)
        + 0.5 * driven(water + 0.5 * poured, glass)
        + 0.3 * laundry(count, rng, wash, body, 3, 0.1)
        + 0.35 * struck(count, rng, plate(rng, 600, 4500, 14, 0.04), relay, 1.0, 2e-4)
        + 0.5 * drip
        + 0.3 * residual(count, rng, 70.0)
    )
    tub = slopes([(500, 0.0), (2000, rng.uniform(-5.0, 0.0)), (8000, rng.uniform(-14.0, -4.0))])
    return np.asarray(radiated(inside, tub + ripple(rng, 1.5)), dtype=np.float64)


def _asynchronous(count: int, rng: Generator, speed: Array, top: float) -> Array:
    """A two-pole induction motor on an inverter: what turns and what the field does beat at twice the slip.

    Source: P. L. Timár (ed.), Noise and Vibration of Electrical Machines (1989): forces at twice the supply's
    frequency, mechanical ones at orders of the shaft.
    """
    slip = rng.uniform(0.015, 0.04) * (1.0 + wander(count, rng, 1.0, 0.15))
    field = tones(turned(speed / (1.0 - slip)), count, {2: 1.0, 4: 0.3, 6: 0.4, 12: 0.15}, rng)
    shaft = tones(turned(speed), count, {1: 1.0, 2: 0.5, 3: 0.2, 4: 0.12}, rng)
    return np.asarray((field + rng.uniform(0.4, 1.2) * shaft) * expand(np.sqrt(speed / top), count))


def built_in_spin(count: int, rng: Generator) -> Array:
    """Final spin at 1,200 to 1,400 rpm of a machine behind the door of a kitchen unit: hum of an uneven load.

    Model: the tub's force at the drum's speed and its overtones (non-linear suspension and panels) is what a balancer
    leaves, and wanders as water leaves the load (S. Bae et al., Journal of Sound and Vibration 257 (2002) 3–18). Panels
    near an order ring; what stands on the worktop may chatter. The door passes sound by the mass law (L. Cremer 1942),
    gaps leak. Units: speed, motor, panels, balance, door, whether something chatters.
    """
    spans = programme(count, rng, (("spin", 40, 90), ("spread", 9, 16)))
    top, ratio = rng.uniform(19.5, 23.6), rng.uniform(10.5, 13.0)
    speed = np.maximum(spinning(count, rng, spans, "spin", (0.45 * top, top, top)), rng.uniform(1.3, 1.6))
    turns = turned(speed * (1.0 + wander(count, rng, 3.0, 0.0015)))
    body = plate(rng, 38, rng.uniform(700, 1400), 30, 0.03, slope=-1.2)
    load = unbalance(speed, rng.uniform(3.2, 5.0), 0.25) * (speed / top) * np.exp(wander(count, rng, 0.5, 0.25))
    orders = {k: rng.uniform(0.5, 1.5) * k**-0.9 for k in range(1, 15)}
    hum = tones(turns, count, orders, rng, 0.4) * expand(load, count)
    motor = _asynchronous(count, rng, ratio * speed, ratio * top)
    noise = rolling(count, rng, speed, top, roar(count, rng, rng.uniform(90, 190), rng.uniform(-6.0, -4.5), 6000))
    air = rolling(count, rng, speed, top, sloped(count, rng, rng.uniform(250, 600), 5000, -4.0, below=6.0))
    once = passages(turns + 0.08 * wander(count, rng, 6.0, 1.0), 1)
    at = read_at(load, once)
    # It chatters in spells, where the worktop's swing lifts it.
    lifted = np.clip(at - rng.uniform(0.7, 1.1), 0.0, 1.0) * np.exp(rng.normal(0, 0.5, len(once)))
    chatter = drummed(count, rng, plate(rng, 700, 6500, 16, 0.02), once + rng.normal(0, 0.004, len(once)), lifted, 3e-4)
    inside = (
        rng.uniform(0.3, 0.7) * driven(hum, body)
        + 0.25 * hum
        + 0.1 * 6.0 ** rng.random() * driven(motor, plate(rng, 120, 3000, 30, 0.03, slope=-1.5))
        + 0.05 * motor
        + 0.9 * noise
        + rng.uniform(0.2, 0.5) * air
        + 0.5 * thumps(count, rng, speed * (speed < 9.0), body, rng.uniform(3.2, 5.0), 0.25)
        + 0.4 * laundry(count, rng, speed * gate(count, spans, "spread"), body, 2, 0.1)
    )
    corner, leak = rng.uniform(180.0, 400.0), rng.uniform(-22.0, -11.0)
    door = slopes([(corner / 4, -1.0), (corner, 0.0), (4 * corner, 0.55 * leak), (16 * corner, leak), (20_000.0, leak)])
    panels = modes([(150.0 * 30.0 ** rng.random(), rng.uniform(4.0, 14.0), rng.uniform(3.0, 10.0)) for _ in range(8)])
    return np.asarray(
        radiated(inside, door + panels + ripple(rng, 2.0))
        + rng.uniform(0.0, 0.25) * chatter
        + 0.12 * residual(count, rng, 70.0),
        dtype=np.float64,
    )
