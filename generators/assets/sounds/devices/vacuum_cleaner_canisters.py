"""Two more canisters: cyclones without a bag, and the straight-through cylinder of the 1950s to 1970s."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.vacuum_cleaner_parts import (
    Habit,
    debris,
    hose,
    housing,
    scraping,
    surroundings,
    switch,
    universal_motor,
    work,
)
from generators.assets.sounds.fans import (
    decibels,
    expand,
    impacts,
    modes,
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


def bagless_canister(count: int, rng: Generator) -> Array:
    """A canister with many small cyclones behind a strong motor: swirling air, a rush from its filter, grit in the bin.

    Model: each cyclone's core precesses at a frequency that follows the flow (T. A. Grimble and M. P. Juniper, J. Fluid
    Mech. (2017)); small ones of a row do so at 700 to 2,200 Hz, unlike each other, so that they add to a wide hump.
    Motor of 27 to 36 thousand rpm (Čudina and Prezelj 2007) in a lined case. Units: cyclones, filter, motor, nozzle.
    """
    take = work(count, rng, Habit(strokes=(0.3, 0.6), lift=(6.0, 20.0), seal=(15.0, 50.0), fall=(1.0, 2.0)))
    shaft = rng.uniform(450.0, 600.0) * take.speed
    motor = universal_motor(
        count, rng, shaft, int(rng.integers(7, 12)), rng.uniform(0.2, 0.6), rng.uniform(-10.0, -2.0)
    )
    swirl = rng.uniform(700.0, 2200.0)
    humps = [(swirl * rng.uniform(0.85, 1.15), rng.uniform(3.0, 9.0), rng.uniform(4.0, 10.0)) for _ in range(5)]
    air = noise(
        count,
        rng,
        turbulence(rng, rng.uniform(500.0, 1200.0), rng.uniform(3.5, 5.5)) + modes(humps) + hose(rng, 2.8, 6.0),
    )
    filtered = noise(count, rng, turbulence(rng, rng.uniform(250.0, 500.0), rng.uniform(4.0, 6.0)))
    loud = take.flow**2.5
    nozzle = scraping(count, rng, take.motion * take.contact, rng.uniform(400.0, 1800.0), 4.5, 3.0)
    bin_body = slopes([(500.0, -8.0), (1300.0, 0.0), (4200.0, -4.0), (12_000.0, -20.0)]) + ripple(rng, 5.0, 5.0)
    crumbs = 40.0 * np.maximum(0.0, slow(count, rng, 0.3, 1.0)) * np.minimum(take.speed, 1.0)
    return np.asarray(
        air * expand(loud * np.exp(slow(count, rng, 20.0, 0.08)), count)
        + decibels(rng.uniform(-6.0, 0.0)) * filtered * expand(loud, count)
        + decibels(rng.uniform(-8.0, 1.0)) * radiated(motor, housing(rng, 220.0, 3000.0, 9.0))
        + decibels(rng.uniform(-12.0, -5.0)) * nozzle
        + 0.5 * impacts(count, rng, crumbs, bin_body, 0.6, 0.02)
        + 0.6 * debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 18.0, 1200.0, 5000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.3),
        dtype=np.float64,
    )


def straight_through(count: int, rng: Generator) -> Array:
    """A cylinder on runners of the old kind: a slow two-stage motor in the air stream, a cloth bag, a dull roar.

    Model: the exhaust leaves through bag and end cap, which take what lies above 1 to 2 kHz (a porous layer: M. E.
    Delany and E. N. Bazley, Applied Acoustics 3 (1970) 105–116); two stages of 6 to 9 blades at 9 to 14 thousand rpm
    (Čudina and Prezelj 2007), brushes that spark, a hum of the field. Units: motor, bag, tube of steel, brush nozzle.
    """
    take = work(count, rng, Habit(rise=(0.5, 1.0), fall=(1.2, 2.6), strokes=(0.3, 0.7), seal=(15.0, 60.0)))
    shaft = rng.uniform(150.0, 235.0) * take.speed
    stages = int(rng.integers(6, 10))
    motor = universal_motor(count, rng, shaft, stages, rng.uniform(0.4, 1.0), rng.uniform(-9.0, -1.0))
    second = rotor(turns_of(shaft, count, rng.random()), {stages + 1: 1.0, 2 * stages + 2: 0.4}, rng, 250.0, 0.25, 0.12)
    corner = rng.uniform(900.0, 2200.0)
    bag = slopes([(0.5 * corner, 0.0), (corner, -3.0), (4.0 * corner, rng.uniform(-22.0, -13.0))])
    air = noise(count, rng, turbulence(rng, rng.uniform(280.0, 700.0), rng.uniform(3.5, 5.0)) + hose(rng, 2.4, 8.0))
    brush = scraping(count, rng, take.motion * take.contact, rng.uniform(400.0, 1200.0), 5.0, 3.0)
    loud = expand(take.flow**2.5, count)
    full = expand(np.minimum(take.speed, 1.3) ** 2.5, count)
    machine = decibels(rng.uniform(-4.0, 4.0)) * radiated(motor, housing(rng, 160.0, 1500.0, 9.0))
    machine = machine + decibels(rng.uniform(-10.0, -3.0)) * second * full
    return np.asarray(
        radiated(air * loud + machine, bag)
        + decibels(rng.uniform(-14.0, -7.0)) * brush
        + 0.4 * debris(count, rng, take.motion * np.minimum(take.speed, 1.0), 10.0, 700.0, 3000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 2.0),
        dtype=np.float64,
    )
