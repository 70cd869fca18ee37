"""Two more ovens: a grill of quartz tubes beside the magnetron, and a heavy oven of the 1970s."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.microwave_parts import (
    beeps,
    clicks,
    door,
    duty,
    kitchen,
    lamination_noise,
    mains,
    session,
    shaded_pole_fan,
    sheet_metal,
    spin_down,
    transformer,
    turntable,
)
from generators.assets.sounds.fans import (
    decibels,
    expand,
    impacts,
    noise,
    radiated,
    ripple,
    rotor,
    slopes,
    slow,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array


def quartz_grill(count: int, rng: Generator) -> Array:
    """An oven that grills: coils in quartz tubes sing while they are hot, in turn with the magnetron; fat spits.

    Model: adjacent turns of a coil attract each other with the square of its current, so tubes and reflector are pushed
    at twice the mains frequency and its multiples; a grill of two tubes is switched by a relay against the magnetron
    (combination programme, cycle of 20 to 36 s). Fat: sparse small bursts. Units: coils, reflector, fan, how fat.
    """
    held = session(count, rng, (40.0, 150.0), (6.0, 10.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(20.0, 36.0), rng.uniform(0.3, 0.6))
    heat = held.cooking * (1.0 - power)
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(250.0, 700.0))
    orders = {2 * k: rng.uniform(0.4, 1.0) / k ** rng.uniform(0.7, 1.3) for k in range(1, 25)}
    coils = rotor(cycle, orders, rng, nominal, 0.15, 0.05) * expand(heat * np.exp(slow(count, rng, 1.0, 0.1)), count)
    speed = spin_down(count, rng, held.cooking, rng.uniform(0.2, 2.0))
    air, fan = shaded_pole_fan(count, rng, speed, nominal, (0.06, 0.16), rng.uniform(350.0, 900.0))
    spits = np.maximum(0.0, 0.3 + slow(count, rng, 0.5, 0.5)) * rng.uniform(2.0, 14.0) * heat
    fat = impacts(
        count, rng, spits, slopes([(500.0, -8.0), (2500.0, 0.0), (9000.0, -8.0)]) + ripple(rng, 3.0), 0.9, 0.02
    )
    sheet = sheet_metal(rng, 170.0, 2600.0, 9.0)
    return np.asarray(
        air
        + radiated(decibels(rng.uniform(1.0, 8.0)) * hum + decibels(rng.uniform(-4.0, 5.0)) * coils, sheet)
        + decibels(rng.uniform(-12.0, -4.0)) * fan
        + decibels(rng.uniform(-14.0, -7.0)) * turntable(count, rng, held.cooking, nominal / 20.0)
        + 0.5 * fat
        + 2.2 * clicks(count, rng, relay, 500.0, 4500.0)
        + 2.5 * door(count, rng, held)
        + 0.9 * beeps(count, rng, held.ends + 8000, rng.uniform(2050.0, 2600.0), 0.5, 1.0, 3)
        + 1.6 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def heavy_stirrer(count: int, rng: Generator) -> Array:
    """A heavy oven of the 1970s: a large transformer in a steel case, a slow blower, a mode stirrer on a belt.

    Model: `transformer` with a low corner, because its core of some kilograms and the thick case follow no high force;
    `lamination_noise`; a squirrel-cage blower on four poles (turns: half the mains frequency less 6 to 14 %) behind
    ducts; the stirrer's belt slaps once a turn of .5 to 1.1 s. Its clockwork ends with a clack. Units:
    core, blower, belt.
    """
    held = session(count, rng, (45.0, 160.0), (6.0, 10.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(
        count, rng, held.cooking, rng.uniform(15.0, 30.0), rng.choice([1.0, 1.0, rng.uniform(0.4, 0.9)])
    )
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(150.0, 330.0))
    rub = lamination_noise(count, rng, cycle, power, rng.uniform(500.0, 1300.0))
    speed = spin_down(count, rng, held.cooking, 0.2)
    cages = int(rng.integers(18, 31))
    turns = turns_of(0.5 * nominal * rng.uniform(0.86, 0.94) * np.maximum(speed, 0.01), count, rng.random())
    blades = rotor(turns, {1: 0.7, 2: 0.4, cages: 0.8, cages + 1: 0.2, 2 * cages: 0.2}, rng, 30.0, 0.3, 0.3)
    blow = noise(count, rng, turbulence(rng, rng.uniform(160.0, 420.0), rng.uniform(4.5, 6.5), 3.0))
    level = expand(np.minimum(speed, 1.2) ** 2.5, count)
    slap = impacts(
        count,
        rng,
        held.cooking / rng.uniform(0.5, 1.1),
        slopes([(120.0, -4.0), (420.0, 0.0), (2500.0, -16.0)]) + ripple(rng, 3.0),
        0.4,
        0.06,
    )
    return np.asarray(
        radiated(
            decibels(rng.uniform(4.0, 11.0)) * hum + rub * decibels(rng.uniform(-9.0, 0.0)),
            sheet_metal(rng, 110.0, 1200.0, 8.0),
        )
        + blow * level
        + decibels(rng.uniform(-12.0, -5.0)) * blades * level
        + 0.5 * slap
        + 3.0 * clicks(count, rng, held.ends, 400.0, 3500.0, 0.08)
        + 2.5 * clicks(count, rng, relay, 350.0, 3000.0)
        + 3.0 * door(count, rng, held)
        + 2.0 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )
