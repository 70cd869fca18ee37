"""Vacuum cleaners whose brush roll has a motor or a belt of its own, one of little power, and one that sprays water."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.vacuum_cleaner_parts import (
    Habit,
    brush_roll,
    debris,
    hose,
    housing,
    journey,
    scraping,
    surroundings,
    switch,
    universal_motor,
    work,
)
from generators.assets.sounds.fans import (
    blades,
    cosine,
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
    spells,
    struck,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array, bubbles


def stick_brushed(count: int, rng: Generator) -> Array:
    """A cordless stick of the cheap kind: a commutator motor that slows with its battery, one cyclone, a motor roll.

    Model: a direct-current motor of 24 to 42 thousand rpm, whose orders lie at 400 to 700 Hz and above, with slots that
    tug (N. Bianchi and S. Bolognani, IEEE Trans. Industry Applications 38 (2002) 1259–1265); nothing but voltage holds
    its speed, so pushes bend it. The roll turns 25 to 45 times a second on its own motor. Units: motor, cyclone, roll,
    tube of aluminium, battery.
    """
    powers = tuple(rng.choice([0.7, 0.85, 1.0], 2, replace=False))
    take = work(
        count, rng, Habit((5.0, 40.0), (0.3, 1.0), powers, (0.2, 0.5), (0.5, 1.2), (0.4, 0.9), load=(0.006, 0.02))
    )
    top = rng.uniform(400.0, 700.0)
    turns = turns_of(top * take.speed * (1.0 + slow(count, rng, 0.2, 0.01)), count, rng.random())
    number, slots = int(rng.integers(7, 14)), int(rng.choice([5, 7, 12]))
    orders = {**blades(number, rng, rng.uniform(0.2, 0.6), 3, rng.uniform(0.3, 0.6)), 1: rng.uniform(0.4, 1.0)}
    orders[slots] = orders.get(slots, 0.0) + rng.uniform(0.2, 0.5)
    whine = rotor(turns, orders, rng, 1.1 * top, 0.25, 0.2)
    cyclone = modes([(rng.uniform(400.0, 1300.0), rng.uniform(2.0, 6.0), rng.uniform(4.0, 9.0)) for _ in range(2)])
    air = noise(count, rng, turbulence(rng, rng.uniform(700.0, 1700.0), rng.uniform(3.5, 5.0)) + cyclone)
    spin = np.maximum(rng.uniform(25.0, 45.0) * take.speed * (1.0 - 0.1 * take.contact * np.abs(take.push)), 0.2)
    bristles, knocks = brush_roll(count, rng, spin, int(rng.integers(2, 6)), rng.uniform(500.0, 1400.0))
    loud, running = expand(take.flow**2.5, count), expand(np.minimum(take.speed, 1.0), count)
    floor = expand((0.3 + 0.7 * take.contact) * (0.7 + 0.5 * take.motion), count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-9.0, 0.0)) * radiated(whine, housing(rng, 300.0, 3500.0, 9.0)) * loud
        + decibels(rng.uniform(-8.0, -1.0)) * bristles * floor * running
        + decibels(rng.uniform(-9.0, -2.0)) * radiated(knocks, housing(rng, 150.0, 1800.0, 8.0)) * floor * running
        + 0.7 * debris(count, rng, take.motion * np.minimum(take.speed, 1.0), 18.0, 1200.0, 5500.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.2),
        dtype=np.float64,
    )


def upright_bagged(count: int, rng: Generator) -> Array:
    """An upright whose bag hangs before the motor: clean air, a faster and quieter motor, a belt, a roll that hums.

    Model: a bypass motor of 17 to 25 thousand rpm that only filtered air passes (T. A. Brungart, G. C. Lauchle and
    R. K. Ramanujam, Noise Control Eng. J. 47(1) (1999) 3–7, on uprights); a round belt of ratio 4 to 6 slips under
    load; the roll's rows pass the floor 2 to 4 times a turn. The bag of paper takes what lies above 2 to 4 kHz from
    the exhaust. Units: motor, belt, roll, bag, floor under the head.
    """
    take = work(count, rng, Habit(strokes=(0.25, 0.55), lift=(10.0, 40.0), seal=(15.0, 60.0), load=(0.008, 0.025)))
    shaft = rng.uniform(280.0, 420.0) * take.speed
    motor = universal_motor(count, rng, shaft, int(rng.integers(6, 11)), rng.uniform(0.3, 0.8), rng.uniform(-10.0, 0.0))
    slip = 1.0 - 0.05 * take.contact * np.abs(take.push) + slow(count, rng, 3.0, 0.006)
    rows = int(rng.integers(2, 5))
    bristles, knocks = brush_roll(count, rng, shaft * slip / rng.uniform(4.0, 6.0), rows, rng.uniform(350.0, 1100.0))
    corner = rng.uniform(1800.0, 4000.0)
    bag = slopes([(0.5 * corner, 0.0), (corner, -3.0), (4.0 * corner, rng.uniform(-18.0, -10.0))])
    exhaust = noise(count, rng, turbulence(rng, rng.uniform(280.0, 650.0), rng.uniform(3.5, 5.0)))
    head = noise(count, rng, turbulence(rng, rng.uniform(600.0, 1500.0), rng.uniform(4.0, 6.0)) + hose(rng, 0.7, 6.0))
    loud = expand(take.flow**2.5, count)
    pile = expand(np.minimum(take.speed, 1.2) * (0.3 + 0.7 * take.contact) * (0.7 + 0.5 * take.motion), count)
    return np.asarray(
        radiated(exhaust, bag) * loud
        + decibels(rng.uniform(-8.0, 0.0)) * head * loud
        + radiated(
            decibels(rng.uniform(-9.0, -1.0)) * motor + decibels(rng.uniform(-10.0, -3.0)) * knocks * pile,
            housing(rng, 140.0, 2200.0, 10.0),
        )
        + decibels(rng.uniform(-5.0, 2.0)) * bristles * pile
        + 0.5 * debris(count, rng, np.minimum(take.speed, 1.0) * take.motion, 16.0, 800.0, 4000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.8),
        dtype=np.float64,
    )


def robot_mapping(count: int, rng: Generator) -> Array:
    """A robot of the later kind: a stronger fan over two rubber rolls, a turning range finder, a soft bumper.

    Model: kinematics, as `robot`. A brushless fan of 11 to 17 blades turns 200 to 330 times a second; two ribbed rolls,
    geared to each other, turn 8 to 14 times a second, their ribs slap the floor (mesh and ribs: J. D. Smith, Gear Noise
    and Vibration (2nd ed. 2003)); the range finder turns 5 to 6 times a second on a belt. Units: all of these.
    """
    left, right, bumps = journey(count, rng, go=(4.0, 25.0))
    rug = spells(count, rng, (15.0, 60.0), (4.0, 20.0), 0.8)
    boost = (0.8 + 0.2 * rng.random()) * (1.0 + rng.uniform(0.1, 0.35) * rug)
    top = rng.uniform(200.0, 330.0)
    fan = turns_of(top * boost * (1.0 + slow(count, rng, 0.5, 0.003)), count, rng.random())
    tones = rotor(fan, blades(int(rng.integers(11, 18)), rng, 0.25, 2, 0.4), rng, 1.4 * top, 0.2, 0.2)
    inside = modes([(rng.uniform(250.0, 1200.0), rng.uniform(2.0, 5.0), rng.uniform(3.0, 8.0)) for _ in range(3)])
    air = noise(count, rng, turbulence(rng, rng.uniform(450.0, 1100.0), rng.uniform(4.0, 6.0)) + inside)
    roll = turns_of(rng.uniform(8.0, 14.0) * (1.0 - 0.15 * rug + slow(count, rng, 3.0, 0.01)), count, rng.random())
    ribs, teeth = int(rng.integers(5, 9)), int(rng.integers(13, 29))
    slap = rotor(roll, {ribs: 1.0, 2 * ribs: 0.6, 3 * ribs: 0.4, teeth: 0.5, 2 * teeth: 0.3}, rng, 16.0, 0.4, 0.3)
    rubber = noise(count, rng, turbulence(rng, rng.uniform(250.0, 600.0), 5.0)) * np.clip(1.0 + 0.5 * slap, 0.0, 3.0)
    motors = np.zeros(count, dtype=np.float32)
    for wheel in (left, right):
        spin = turns_of(
            np.maximum(rng.uniform(60.0, 100.0) * np.abs(wheel) * (1.0 + slow(count, rng, 6.0, 0.012)), 0.05), count
        )
        pinion = int(rng.integers(9, 15))
        motors += rotor(spin, {1: 0.4, 2: 0.3, pinion: 1.0, 2 * pinion: 0.4}, rng, 110.0, 0.3, 0.35)
    finder = turns_of(rng.uniform(5.0, 6.0) * (1.0 + slow(count, rng, 1.0, 0.01)), count, rng.random())
    ring = rotor(finder, {k: rng.uniform(0.2, 1.0) for k in range(20, 60, 3)}, rng, 6.5, 0.3, 0.4)
    drive, body = np.abs(left + right) / 2, housing(rng, 250.0, 2400.0, 9.0)
    shell = slopes([(90.0, -6.0), (280.0, 0.0), (1500.0, -8.0), (6000.0, -24.0)])
    return np.asarray(
        air * expand(boost**2.5, count)
        + decibels(rng.uniform(-9.0, -1.0)) * radiated(tones, body)
        + decibels(rng.uniform(-8.0, 0.0)) * rubber * expand(0.6 + 0.4 * drive, count)
        + decibels(rng.uniform(-12.0, -4.0)) * radiated(motors, body) * expand(drive, count)
        + decibels(rng.uniform(-24.0, -14.0)) * radiated(ring, body)
        + 1.2 * struck(count, rng, bumps, rng.uniform(0.3, 1.0, len(bumps)), shell + ripple(rng, 3.0), 0.09)
        + 0.5 * debris(count, rng, drive, 8.0, 1500.0, 6000.0),
        dtype=np.float64,
    )


def low_power_canister(count: int, rng: Generator) -> Array:
    """A canister of under 900 W: a large impeller on a slow shaft whose current an electronic switch chops.

    Model: at 11 to 17 thousand rpm the blade tone lies at 1.3 to 2.6 kHz (Čudina and Prezelj 2007); the triac lets
    part of each half wave through, so the torque pulsates at many multiples of twice the mains (A. E. Fitzgerald, C.
    Kingsley and S. D. Umans, Electric Machinery (6th ed. 2003), on series motors and their supply). A sealed nozzle
    leaks little, so that strokes are heard. Units: impeller, current, lining, hose, nozzle.
    """
    powers = tuple(rng.choice([0.7, 0.8, 0.9, 1.0], 2, replace=False))
    take = work(count, rng, Habit(powers=powers, rise=(0.5, 1.2), strokes=(0.3, 0.7), lift=(4.0, 16.0)))
    shaft, vanes = rng.uniform(185.0, 285.0) * take.speed, int(rng.integers(7, 10))
    motor = universal_motor(count, rng, shaft, vanes, rng.uniform(0.15, 0.6), rng.uniform(-6.0, 3.0))
    mains = float(rng.choice([50.0, 60.0])) * (1.0 + slow(count, rng, 0.3, 4e-4))
    cut = {order: rng.uniform(0.3, 1.0) / order for order in range(1, 12)}
    buzz = rotor(turns_of(2.0 * mains, count, rng.random()), cut, rng, 125.0, 0.15, 0.1)
    lining = slopes([(400.0, 0.0), (1600.0, rng.uniform(-8.0, -2.0)), (8000.0, rng.uniform(-22.0, -12.0))])
    air = noise(count, rng, turbulence(rng, rng.uniform(500.0, 1200.0), rng.uniform(4.0, 6.0)) + hose(rng, 2.7, 8.0))
    outlet = noise(count, rng, turbulence(rng, rng.uniform(180.0, 400.0), rng.uniform(4.0, 6.0)))
    strokes = scraping(count, rng, take.motion * take.contact, rng.uniform(400.0, 1500.0), 5.0, 3.0)
    loud, running = expand(take.flow**2.5, count), expand(np.minimum(take.speed, 1.0), count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-6.0, 1.0)) * outlet * loud
        + radiated(
            decibels(rng.uniform(-8.0, 1.0)) * motor + decibels(rng.uniform(-16.0, -6.0)) * buzz * running,
            housing(rng, 160.0, 1800.0, 9.0) + lining,
        )
        + decibels(rng.uniform(-9.0, -1.0)) * strokes
        + 0.5 * debris(count, rng, take.motion * take.contact * np.minimum(take.speed, 1.0), 14.0, 1000.0, 5000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.0),
        dtype=np.float64,
    )


def carpet_extractor(count: int, rng: Generator) -> Array:
    """A cleaner that washes carpets: a pump sprays, a bypass motor draws the water back, a wet nozzle slurps.

    Model: a bypass motor of 17 to 24 thousand rpm (Čudina and Prezelj 2007) over a tank; a pump whose armature moves
    with the mains (ULKA EP5 data sheet: half-wave drive) runs for a stroke; water and air alternate in the nozzle
    and gulp in the hose (bubbles: K. van den Doel, ACM Trans. Appl. Percept. 2 (2005) 534–546). Units: motor, tank,
    pump, spray, hose, pile.
    """
    take = work(
        count,
        rng,
        Habit((20.0, 80.0), (0.5, 1.5), (1.0,), (0.4, 0.9), (1.2, 2.2), (0.12, 0.3), (3.0, 10.0), (5.0, 20.0)),
    )
    shaft = rng.uniform(280.0, 400.0) * take.speed
    motor = universal_motor(
        count, rng, shaft, int(rng.integers(6, 10)), rng.uniform(0.2, 0.6), rng.uniform(-10.0, -1.0)
    )
    tank = modes([(rng.uniform(150.0, 900.0), rng.uniform(3.0, 9.0), rng.uniform(3.0, 9.0)) for _ in range(6)])
    exhaust = noise(count, rng, turbulence(rng, rng.uniform(220.0, 520.0), rng.uniform(3.5, 5.0)) + tank)
    spraying = spells(count, rng, (2.0, 7.0), (1.5, 4.0), 0.15) * np.minimum(take.speed, 1.0)
    mains = float(rng.choice([50.0, 60.0])) * (1.0 + slow(count, rng, 0.3, 4e-4))
    stroke = rotor(
        turns_of(mains, count, rng.random()), {k: rng.uniform(0.3, 1.0) / k for k in range(1, 15)}, rng, 62.0, 0.2, 0.1
    )
    spray = noise(count, rng, turbulence(rng, rng.uniform(2500.0, 4500.0), 5.0, 5.0))
    slugs = np.clip(1.0 + slow(count, rng, rng.uniform(8.0, 20.0), 0.9), 0.0, 3.0) ** 2
    wet = take.contact * take.motion * np.minimum(take.speed, 1.0) * slugs
    slurp = noise(count, rng, turbulence(rng, rng.uniform(600.0, 1500.0), rng.uniform(3.5, 5.0)) + hose(rng, 2.0, 9.0))
    water = bubbles(count, rng, expand(60.0 * wet, count).astype(np.float64), (1.0, 5.0))
    loud = expand(take.flow**2.5, count)
    pump = radiated(stroke, housing(rng, 120.0, 2000.0, 8.0)) * (1.0 + 0.2 * cosine(turns_of(2.0 * mains, count)))
    return np.asarray(
        exhaust * loud
        + decibels(rng.uniform(-7.0, 0.0)) * radiated(motor, housing(rng, 200.0, 2600.0, 8.0) + tank)
        + decibels(rng.uniform(-14.0, -6.0)) * pump * expand(spraying, count)
        + decibels(rng.uniform(-18.0, -10.0)) * spray * expand(spraying, count)
        + decibels(rng.uniform(-6.0, 1.0)) * slurp * expand((0.25 + wet) * np.minimum(take.flow, 1.0) ** 2, count)
        + 0.5 * water
        + 0.6 * impacts(count, rng, 1.2 * take.motion, slopes([(150.0, -3.0), (600.0, 0.0), (4000.0, -16.0)]), 0.7)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.5),
        dtype=np.float64,
    )
