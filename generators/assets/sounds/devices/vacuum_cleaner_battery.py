"""The voices of vacuum cleaners that run from a battery."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.vacuum_cleaner_parts import (
    Habit,
    debris,
    housing,
    journey,
    scraping,
    surroundings,
    switch,
    work,
)
from generators.assets.sounds.fans import (
    CONTROL_RATE,
    approach,
    blades,
    cosine,
    decibels,
    expand,
    frames,
    impacts,
    modes,
    noise,
    radiated,
    ripple,
    rotor,
    slopes,
    slow,
    spells,
    struck,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array


def stick(count: int, rng: Generator) -> Array:
    """A cordless stick: a thin whine of the shaft over hiss, a driven roll in its head, power steps, trigger bursts.

    Model: a permanent-magnet motor at 80 to 110 thousand rpm: the shaft's tone lies at 1.3 to 1.9 kHz with its first
    multiples, the blade-passing tone of 9 to 13 blades at 12 to 20 kHz, mostly beyond hearing (that is why makers chose
    such speeds); the electronics holds the speed, so load hardly bends the pitch. A small commutator motor turns the
    roll through a toothed belt. Units: speed, blades, roll, belt, powers.
    """
    powers = tuple(rng.choice([0.62, 0.78, 1.0], 2, replace=False))
    take = work(
        count, rng, Habit((4.0, 35.0), (0.3, 0.9), powers, (0.12, 0.3), (0.35, 0.7), (0.45, 0.9), load=(0.0005, 0.002))
    )
    top = rng.uniform(1300.0, 1850.0)
    turns = turns_of(top * take.speed, count, rng.random())
    number = int(rng.choice([9, 11, 13]))
    orders = {
        1: 1.0,
        2: rng.uniform(0.2, 0.7),
        3: rng.uniform(0.1, 0.4),
        4: 0.2,
        6: 0.15,
        number: rng.uniform(0.2, 0.6),
    }
    whine = rotor(turns, orders, rng, top, 0.2, 0.15)
    air = noise(count, rng, turbulence(rng, rng.uniform(1400.0, 2600.0), rng.uniform(3.5, 5.0), 3.0))
    head = np.maximum(
        rng.uniform(38.0, 60.0) * np.minimum(take.speed, 1.0) * (1.0 - 0.06 * take.contact * np.abs(take.push)), 0.2
    )
    head = head * (1.0 + slow(count, rng, 8.0, 0.004))
    roll = turns_of(head, count, rng.random())
    teeth = int(rng.integers(11, 17))
    belt = rotor(roll, {1: 0.5, 2: 0.4, 3: 0.3, teeth: 1.0, 2 * teeth: 0.6, 3 * teeth: 0.3}, rng, 62.0, 0.3, 0.25)
    sweep = scraping(count, rng, 0.3 + take.contact * (0.4 + 0.6 * take.motion), rng.uniform(500.0, 1100.0), 4.5, 2.5)
    sweep *= 1.0 + 0.35 * cosine(2.0 * roll)
    rumble = noise(count, rng, slopes([(70.0, -6.0), (180.0, 0.0), (700.0, -10.0), (3000.0, -28.0)]) + ripple(rng, 2.0))
    loud = expand(take.flow**2.5, count)
    running = expand(np.minimum(take.speed, 1.0), count)
    floor = expand(0.4 + take.motion * take.contact, count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-11.0, -4.0)) * whine * loud
        + running
        * radiated(
            decibels(rng.uniform(-12.0, -5.0)) * belt + decibels(rng.uniform(-9.0, -3.0)) * sweep,
            housing(rng, 250.0, 2500.0, 8.0),
        )
        + decibels(rng.uniform(-8.0, -2.0)) * rumble * floor * running
        + 0.7 * debris(count, rng, take.motion * np.minimum(take.speed, 1.0), 15.0, 1500.0, 6000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.0),
        dtype=np.float64,
    )


def hand_brushed(count: int, rng: Generator) -> Array:
    """A small hand-held cleaner: bursts of a howling working fan in a thin shell, sagging with the battery.

    Model: the blade-passing tone of the vacuum's working fan is the loudest part of the spectrum; other tones rise
    where blades are unevenly spaced (T. A. Brungart and G. C. Lauchle, "Modifications of a handheld vacuum cleaner for
    noise control", Noise Control Eng. J. 49(2) (2001) 73–78). A commutator motor of 10 to 16 thousand rpm; the
    voltage falls by a tenth over a burst and recovers. Units: blades, spacing, shell, battery.
    """
    take = work(
        count,
        rng,
        Habit((3.0, 14.0), (0.3, 0.8), (1.0,), (0.25, 0.5), (0.25, 0.5), (0.7, 1.5), (2.0, 6.0), (6.0, 20.0)),
    )
    low = np.minimum(take.speed, 1.0)
    fade = np.zeros(frames(count))
    begins = np.flatnonzero(np.diff(low > 0.5, prepend=False) > 0)
    since = np.arange(frames(count)) - np.maximum.accumulate(
        np.where(np.isin(np.arange(frames(count)), begins), np.arange(frames(count)), 0)
    )
    fade = 1.0 - rng.uniform(0.05, 0.12) * (1.0 - np.exp(-since / CONTROL_RATE / rng.uniform(3.0, 7.0)))
    top = rng.uniform(165.0, 270.0)
    turns = turns_of(top * take.speed * fade, count, rng.random())
    number = int(rng.integers(5, 10))
    fan = rotor(
        turns, blades(number, rng, rng.uniform(0.1, 0.45), 6, rng.uniform(0.45, 0.75)), rng, 1.2 * top, 0.25, 0.2
    )
    brushes = rotor(turns, {1: 1.0, 3: 0.5, 6: 0.8, 12: 0.4}, rng, 1.2 * top, 0.3, 0.3)
    air = noise(count, rng, turbulence(rng, rng.uniform(1000.0, 1900.0), rng.uniform(5.0, 7.0), 5.0))
    whistle = noise(
        count, rng, modes([(rng.uniform(2000.0, 3600.0), 25.0, 30.0)]) + slopes([(500.0, -9.0), (8000.0, -9.0)])
    )
    cloth = scraping(count, rng, take.motion * take.contact, rng.uniform(250.0, 600.0), 5.0, 4.0)
    loud = expand((take.flow * fade) ** 2.5, count)
    full = expand((take.speed * fade) ** 2.5, count)
    return np.asarray(
        radiated(
            air * loud
            + decibels(rng.uniform(-3.0, 3.0)) * fan * full
            + decibels(rng.uniform(-14.0, -7.0)) * brushes * full
            + decibels(rng.uniform(-8.0, -3.0)) * cloth,
            housing(rng, 500.0, 4500.0, 10.0),
        )
        + decibels(-4.0) * whistle * expand(take.sealed * low, count)
        + debris(count, rng, take.contact * low, 22.0, 1800.0, 7000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 2.0),
        dtype=np.float64,
    )


def robot(count: int, rng: Generator) -> Array:
    """A robot that drives, bumps, backs and turns: a small fan, two gear motors, a flicking side brush, a roll.

    Model: kinematics. Each wheel motor turns 70 to 110 times a second at full speed; its first pinion of 8 to 12 teeth
    sets the gear whine, two wheels never turn alike; a side brush of 3 to 5 arms turns 2.5 to 4 times a second, and
    each arm flicks the floor; the roll of 2 to 4 rows turns 12 to 20 times a second. The fan of 7 to 11 blades turns
    180 to 300 times a second and speeds up on carpet. Units: all of these; rooms with rugs, joints, bumpers.
    """
    left, right, bumps = journey(count, rng)
    rug = spells(count, rng, (8.0, 40.0), (4.0, 25.0), 0.6)
    boost = approach(count, [(1e3, 1.0)], 1.0, 0.5, 0.5) * (1.0 + rng.uniform(0.1, 0.3) * rug)
    top = rng.uniform(180.0, 300.0)
    fan = turns_of(top * boost * (1.0 + slow(count, rng, 0.5, 0.004)), count, rng.random())
    tones = rotor(fan, blades(int(rng.integers(7, 12)), rng, 0.3, 3, 0.4), rng, 1.4 * top, 0.2, 0.15)
    air = noise(count, rng, turbulence(rng, rng.uniform(700.0, 1300.0), rng.uniform(4.5, 6.5)))
    gears = np.zeros(count, dtype=np.float32)
    pinion = int(rng.integers(8, 13))
    for wheel in (left, right):
        spin = rng.uniform(70.0, 110.0) * np.abs(wheel) * (1.0 + slow(count, rng, 6.0, 0.01) - 0.05 * rug)
        turns = turns_of(np.maximum(spin, 0.05), count, rng.random())
        orders = {1: 0.5, 2: 0.3, 3: 0.2, pinion: 1.0, 2 * pinion: 0.5, 3 * pinion: 0.25, pinion + 1: 0.2}
        gears += rotor(turns, orders, rng, 120.0, 0.3, 0.3) * expand(np.minimum(np.abs(wheel), 1.0), count)
    arms = int(rng.integers(3, 6))
    side = arms * turns_of(rng.uniform(2.5, 4.0) * (1.0 + slow(count, rng, 2.0, 0.03)), count, rng.random())
    flick = np.exp(-5.0 * np.mod(side + expand(slow(count, rng, 6.0, 0.03), count), 1.0).astype(np.float32))
    bristles = noise(count, rng, turbulence(rng, rng.uniform(2200.0, 4500.0), 5.0, 6.0, 2.5)) * flick
    roll = turns_of(rng.uniform(12.0, 20.0) * (1.0 - 0.1 * rug + slow(count, rng, 3.0, 0.01)), count, rng.random())
    drum = rotor(roll, {k: rng.uniform(0.3, 1.0) for k in range(2, 26)}, rng, 20.0, 0.3, 0.3)
    sweep = noise(count, rng, turbulence(rng, rng.uniform(400.0, 800.0), 5.0)) * (1.0 + 0.4 * cosine(2.0 * roll))
    drive = np.abs(left + right) / 2
    wheels = scraping(count, rng, drive, rng.uniform(110.0, 220.0), 6.0, 3.0)
    joints = impacts(
        count, rng, 0.8 * drive * (1.0 - rug), slopes([(90.0, -3.0), (400.0, 0.0), (3000.0, -18.0)]), 0.4, 0.08
    )
    thuds = struck(
        count,
        rng,
        bumps,
        rng.uniform(1.0, 2.5, len(bumps)),
        slopes([(70.0, -4.0), (240.0, 0.0), (1600.0, -12.0), (6000.0, -30.0)]),
        0.12,
        3.0,
    )
    shell = housing(rng, 300.0, 3000.0, 9.0)
    return np.asarray(
        radiated(
            0.8 * air * expand(boost**2.5, count)
            + decibels(rng.uniform(-9.0, -3.0)) * tones * expand(boost**2.5, count)
            + decibels(rng.uniform(-9.0, -2.0)) * gears
            + decibels(rng.uniform(-10.0, -4.0)) * drum,
            shell,
        )
        + decibels(rng.uniform(-3.0, 3.0)) * bristles * expand(1.0 - 0.7 * rug, count)
        + decibels(rng.uniform(-8.0, -2.0)) * sweep * expand(0.5 + rug, count)
        + decibels(rng.uniform(-10.0, -4.0)) * wheels
        + 1.4 * (joints + thuds)
        + 0.5 * debris(count, rng, drive, 12.0, 1500.0, 6000.0),
        dtype=np.float64,
    )


def car_plug_in(count: int, rng: Generator) -> Array:
    """A hand-held cleaner at a car's socket: a magnet motor on a radial wheel, crevice nozzle, a dull steel cavity.

    Model: a permanent-magnet commutator motor at 12 V turns a wheel of 6 to 12 blades 190 to 330 times a second; its
    slots (5 or 7) make torque at multiples of twice their number (N. Bianchi and S. Bolognani, IEEE Trans. Industry
    Applications 38 (2002) 1259–1265: cogging torque has the least common multiple of slots and poles); the supply is
    stiff, so the speed changes with the load of the nozzle alone. Cloth and carpet of the car take what lies above
    some kilohertz, and the cabin booms below 150 Hz. Units: wheel, slots, nozzle, cabin.
    """
    take = work(
        count, rng, Habit((6.0, 40.0), (0.4, 1.2), (1.0,), (0.2, 0.5), (0.4, 0.9), (0.5, 1.3), (3.0, 9.0), (4.0, 14.0))
    )
    top = rng.uniform(190.0, 330.0)
    turns = turns_of(top * take.speed * (1.0 + slow(count, rng, 2.0, 0.004)), count, rng.random())
    number, slots = int(rng.integers(6, 13)), int(rng.choice([5, 7]))
    wheel = rotor(turns, blades(number, rng, rng.uniform(0.1, 0.4), 4, rng.uniform(0.35, 0.65)), rng, 1.2 * top)
    cogging = rotor(turns, {1: 0.6, 2 * slots: 1.0, 4 * slots: 0.4}, rng, 1.2 * top, 0.25, 0.2)
    air = noise(count, rng, turbulence(rng, rng.uniform(600.0, 1800.0), rng.uniform(4.5, 6.5), 3.5))
    cabin = noise(count, rng, slopes([(50.0, 0.0), (150.0, -1.0), (600.0, -12.0), (3000.0, -30.0)]) + ripple(rng, 3.0))
    crevice = noise(
        count, rng, modes([(rng.uniform(900.0, 2600.0), 12.0, 20.0)]) + slopes([(400.0, -9.0), (6e3, -9.0)])
    )
    cloth = scraping(count, rng, take.motion * take.contact, rng.uniform(300.0, 900.0), 5.0, 4.0)
    loud, full = expand(take.flow**2.5, count), expand(np.minimum(take.speed, 1.3) ** 2.5, count)
    lining = slopes([(800.0, 0.0), (3000.0, -3.0), (12_000.0, rng.uniform(-16.0, -8.0))])
    machine = (
        air * loud
        + decibels(rng.uniform(-7.0, 2.0)) * wheel * full
        + decibels(rng.uniform(-16.0, -8.0)) * cogging * full
        + decibels(rng.uniform(-9.0, -3.0)) * cloth
    )
    return np.asarray(
        radiated(machine, housing(rng, 350.0, 3500.0, 9.0) + lining)
        + decibels(rng.uniform(-12.0, -3.0)) * cabin * loud
        + decibels(rng.uniform(-14.0, -6.0)) * crevice * expand(take.flow**2.5 * take.sealed, count)
        + 0.5 * debris(count, rng, take.contact * take.motion * np.minimum(take.speed, 1.0), 25.0, 1000.0, 4500.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.2),
        dtype=np.float64,
    )
