"""Vacuum cleaners of which one hears the air rather than the motor, and a corded one for the hand without a hose."""

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
    slopes,
    slow,
    turbulence,
)
from generators.assets.sounds.signals import Array


def quiet_canister(count: int, rng: Generator) -> Array:
    """A canister of the silent kind: a lined case that leaves little of the motor, and the nozzle as loudest source.

    Model: the motor hangs in foam behind bends, whose insertion loss grows with frequency (a porous layer: M. E. Delany
    and E. N. Bazley, Applied Acoustics 3 (1970) 105–116); what remains is the air at the nozzle's slot and its bristles
    on the floor, louder as the slot is narrowed by the floor. Units: motor, lining, nozzle, hose, wheels.
    """
    take = work(count, rng, Habit(strokes=(0.3, 0.7), lift=(5.0, 18.0), seal=(20.0, 80.0), rise=(0.6, 1.4)))
    shaft = rng.uniform(380.0, 540.0) * take.speed
    vanes, rough, ripple_db = int(rng.integers(7, 12)), rng.uniform(0.2, 0.4), rng.uniform(-18.0, -9.0)
    motor = universal_motor(count, rng, shaft, vanes, rough, ripple_db)
    corner = rng.uniform(300.0, 600.0)
    lining = slopes([(corner, 0.0), (4.0 * corner, rng.uniform(-20.0, -12.0)), (16.0 * corner, -34.0)])
    slot = rng.uniform(600.0, 1500.0)
    rush = noise(count, rng, turbulence(rng, slot, rng.uniform(4.0, 6.0)) + hose(rng, 2.8, 9.0))
    outlet = noise(count, rng, turbulence(rng, rng.uniform(150.0, 320.0), rng.uniform(4.5, 6.5)))
    bristles = scraping(count, rng, take.motion * take.contact, rng.uniform(700.0, 1800.0), 4.5, 3.0)
    wheels = scraping(count, rng, take.motion, rng.uniform(120.0, 300.0), 6.0, 4.0)
    loud = take.flow**2.5
    narrowed = 0.55 + 0.45 * take.contact * (0.7 + 0.6 * take.motion)
    return np.asarray(
        rush * expand(loud * narrowed * np.exp(slow(count, rng, 9.0, 0.12)), count)
        + decibels(rng.uniform(-7.0, -1.0)) * outlet * expand(loud, count)
        + decibels(rng.uniform(-12.0, -4.0)) * radiated(motor, housing(rng, 220.0, 1400.0, 9.0) + lining)
        + decibels(rng.uniform(-9.0, -2.0)) * bristles
        + decibels(rng.uniform(-15.0, -8.0)) * wheels
        + 0.6 * debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 14.0, 1200.0, 5500.0)
        + surroundings(count, rng, take.speed),
        dtype=np.float64,
    )


def backpack(count: int, rng: Generator) -> Array:
    """Carried on the back by those who clean offices: a steady two-stage fan in foam, a short hose, few strokes.

    Model: a bypass motor of 16 to 22 thousand rpm with two stages whose blade rates differ, so that they beat (Čudina
    and Prezelj 2007), behind a filter cone and foam; hose of 1.2 to 1.6 m and tube of aluminium, a nozzle of 35 cm that
    sweeps from side to side. Worn, its case is damped by the body: broad low modes. Units: fan, foam, tube, floor.
    """
    take = work(
        count,
        rng,
        Habit((30.0, 120.0), (0.5, 1.4), (1.0,), (0.4, 0.9), (1.0, 2.2), (0.5, 1.1), (4.0, 14.0), (30.0, 90.0)),
    )
    shaft, stages = rng.uniform(265.0, 365.0) * take.speed, int(rng.integers(6, 9))
    motor = universal_motor(count, rng, shaft, stages, rng.uniform(0.25, 0.5), rng.uniform(-14.0, -5.0))
    second = universal_motor(count, rng, shaft, stages + 1, rng.uniform(0.1, 0.3), -20.0)
    foam = slopes([(400.0, 0.0), (1600.0, rng.uniform(-9.0, -4.0)), (8000.0, rng.uniform(-24.0, -15.0))])
    case = modes([(rng.uniform(110.0, 700.0), rng.uniform(1.5, 4.0), rng.uniform(3.0, 9.0)) for _ in range(4)])
    exhaust = noise(count, rng, turbulence(rng, rng.uniform(220.0, 450.0), rng.uniform(3.5, 5.0)) + case)
    tube = noise(count, rng, turbulence(rng, rng.uniform(700.0, 1800.0), rng.uniform(3.5, 5.5)) + hose(rng, 1.4, 10.0))
    sweep = scraping(count, rng, take.motion * take.contact, rng.uniform(500.0, 1500.0), 5.0, 2.5)
    turns = impacts(
        count, rng, 1.6 * take.motion * take.contact, slopes([(200.0, -4.0), (900.0, 0.0), (6000.0, -14.0)])
    )
    loud = expand(take.flow**2.5, count)
    return np.asarray(
        exhaust * loud
        + decibels(rng.uniform(-6.0, 1.0)) * tube * loud
        + radiated(decibels(rng.uniform(-7.0, 0.0)) * motor + decibels(rng.uniform(-13.0, -6.0)) * second, case + foam)
        + decibels(rng.uniform(-10.0, -3.0)) * sweep
        + 0.5 * turns
        + 0.8 * debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 22.0, 1800.0, 7000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.0),
        dtype=np.float64,
    )


def corded_handheld(count: int, rng: Generator) -> Array:
    """A small one for stairs and sofas on the mains: an open series motor, its fan at the hand, no hose, short strokes.

    Model: a fan of 5 to 9 blades that the dirt passes, on a series motor of 16 to 26 thousand rpm (Brungart and
    Lauchle, Noise Control Eng. J. 49(2) (2001) 73–78, on handheld cleaners: tones at the blade rate over wide
    noise); the torque pulses at twice the mains; cloth that is sucked on stalls the air for a moment. Units: motor,
    fan, mouth, bag of cloth.
    """
    take = work(
        count,
        rng,
        Habit(
            (8.0, 40.0), (0.4, 1.6), (1.0,), (0.15, 0.4), (0.6, 1.5), (0.6, 1.4), (2.0, 8.0), (3.0, 12.0), (0.01, 0.03)
        ),
    )
    shaft, vanes = rng.uniform(265.0, 430.0) * take.speed, int(rng.integers(5, 10))
    motor = universal_motor(count, rng, shaft, vanes, rng.uniform(0.3, 0.8), rng.uniform(-12.0, -3.0))
    mouth = modes([(rng.uniform(350.0, 1100.0), rng.uniform(2.0, 5.0), rng.uniform(4.0, 9.0)) for _ in range(3)])
    air = noise(count, rng, turbulence(rng, rng.uniform(500.0, 1400.0), rng.uniform(3.5, 5.0)) + mouth)
    bag = slopes([(500.0, 0.0), (2500.0, rng.uniform(-5.0, 0.0)), (10_000.0, rng.uniform(-18.0, -10.0))])
    exhaust = radiated(noise(count, rng, turbulence(rng, rng.uniform(300.0, 600.0), 4.5)), bag)
    cloth = scraping(count, rng, take.motion * take.contact, rng.uniform(400.0, 1200.0), 5.5, 3.0)
    loud = take.flow**2.5
    return np.asarray(
        air * expand(loud * (1.0 + 0.8 * take.sealed), count)
        + decibels(rng.uniform(-5.0, 1.0)) * exhaust * expand(loud, count)
        + decibels(rng.uniform(-5.0, 3.0)) * radiated(motor, housing(rng, 400.0, 4000.0, 8.0) + ripple(rng, 2.0) + bag)
        + decibels(rng.uniform(-10.0, -3.0)) * cloth
        + 0.8 * debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 30.0, 900.0, 4500.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.8),
        dtype=np.float64,
    )
