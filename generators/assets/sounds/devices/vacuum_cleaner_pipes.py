"""The voices of vacuum cleaners whose pipes or drum are heard: a wet-dry cleaner, the inlet of a central one."""

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
    CONTROL_RATE,
    Signal,
    blades,
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
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array, bubbles


def wet_dry(count: int, rng: Generator) -> Array:
    """A wet-dry cleaner of a workshop: a roar through a drum, an open cooling fan, chips, slugs of water.

    Model: a bypass motor, whose own fan cools it apart from the working air and sings at its blade rate in the open;
    the drum of 20 to 50 litres is a Helmholtz resonator with the hose (40 to 75 Hz) and has modes from 250 Hz; water
    travels up the hose in slugs, 3 to 7 a second. Motor (two stages, shared shaft) after Čudina and Prezelj (2007).
    Units: drum, fans, what is picked up, exhaust.
    """
    take = work(
        count,
        rng,
        Habit((12.0, 60.0), (0.4, 1.2), (1.0,), (0.4, 0.9), (1.4, 2.4), (0.15, 0.4), (2.0, 8.0), (4.0, 15.0)),
    )
    shaft = rng.uniform(270.0, 340.0) * take.speed
    stages = int(rng.integers(6, 8))
    motor = universal_motor(count, rng, shaft, stages, rng.uniform(0.3, 0.6), rng.uniform(-4.0, 3.0))
    cooling = int(rng.integers(12, 19))
    turns = turns_of(shaft, count, rng.random())
    sing = rotor(turns, {**blades(cooling, rng, 0.25, 3, 0.45), stages: 0.3}, rng, 380.0, 0.2, 0.12)
    drum = [(rng.uniform(40.0, 75.0), 4.0, 12.0)]
    drum += [(rng.uniform(240.0, 1100.0), rng.uniform(4.0, 12.0), rng.uniform(3.0, 9.0)) for _ in range(7)]
    exhaust = noise(count, rng, turbulence(rng, rng.uniform(180.0, 380.0), rng.uniform(3.0, 4.2)) + modes(drum))
    wet = spells(count, rng, (6.0, 25.0), (1.5, 6.0), 0.3) * np.minimum(take.speed, 1.0)
    slugs = np.clip(1.0 + slow(count, rng, rng.uniform(6.0, 14.0), 1.0), 0.0, 3.0) ** 2
    gurgle = noise(count, rng, turbulence(rng, rng.uniform(500.0, 1100.0), 4.0) + hose(rng, 2.2, 8.0))
    chips = debris(count, rng, np.minimum(take.speed, 1.0) * take.contact * (1.0 - wet), 45.0, 500.0, 3500.0)
    scrape = scraping(count, rng, take.motion * take.contact, rng.uniform(700.0, 1600.0), 4.0, 4.0)
    loud = expand(take.flow**2.5, count)
    full = expand(np.minimum(take.speed, 1.3) ** 2.5, count)
    flow = expand(90.0 * wet * slugs, count).astype(np.float64)
    water = 0.5 * gurgle * expand(wet * slugs, count) + 1.2 * bubbles(count, rng, flow, (1.2, 7.0))
    return np.asarray(
        1.1 * exhaust * loud
        + radiated(
            decibels(rng.uniform(-6.0, -1.0)) * motor + decibels(rng.uniform(-8.0, -2.0)) * sing * full,
            modes(drum[1:]) + ripple(rng, 2.0),
        )
        + 0.5 * water
        + decibels(rng.uniform(-14.0, -7.0)) * scrape
        + 1.2 * radiated(chips, modes(drum[1:]))
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 2.0),
        dtype=np.float64,
    )


def _singing(count: int, rng: Generator, flow: Array, length: float) -> Signal:
    """Tones of a corrugated hose: vortices of the corrugations lock on one mode of the hose after another.

    Model: Strouhal number of 0.4 to 0.6 by the pitch of the corrugations; the frequency stays at a mode c/2L·n while
    the flow changes, then jumps (B. Rajavel and M. G. Prasad, "Acoustics of corrugated pipes: a review", Applied
    Mechanics Reviews 65 (2013); G. Nakiboğlu et al., J. Fluid Mech. (2011)).
    """
    spacing = 343.0 / (2.0 * length)
    wanted = rng.uniform(0.4, 0.6) * rng.uniform(26.0, 42.0) / rng.uniform(0.0075, 0.011) * flow
    wanted = wanted * (1.0 + slow(count, rng, 1.5, 0.01))
    nearest = np.round(wanted / (3.0 * spacing)) * 3.0 * spacing
    width = int(0.03 * CONTROL_RATE)
    locked = np.convolve(
        np.pad(nearest, width, mode="edge"), np.full(2 * width + 1, 1.0 / (2 * width + 1)), mode="valid"
    )
    near = np.exp(-np.square((wanted - nearest) / spacing)) * np.maximum(0.0, 0.6 + slow(count, rng, 0.8, 0.6))
    turns = turns_of(np.maximum(0.85 * locked + 0.15 * wanted, 1.0), count, rng.random())
    tones = rotor(turns, {1: 1.0, 2: 0.25, 3: 0.06}, rng, 2800.0, 0.2, 0.25)
    return tones * expand(near * flow**3, count)


def central(count: int, rng: Generator) -> Array:
    """The nozzle and hose of a central cleaner: rush of air and a singing hose; the motor is a hum from afar.

    Model: the pressure source stands in the cellar, so the noise in the room is that of flow: turbulent noise of the
    inlet and nozzle, resonances of a hose of 6 to 10 m, tones of its corrugations; through metres of duct only the
    lowest orders of the motor arrive. Cut off at the wall, the flow dies within a second. Units: hose, corrugations,
    duct, nozzle.
    """
    take = work(
        count,
        rng,
        Habit((20.0, 80.0), (0.4, 1.0), (1.0,), (0.5, 1.2), (0.5, 0.9), (0.25, 0.5), (3.0, 10.0), (5.0, 18.0)),
    )
    length = rng.uniform(6.0, 10.0)
    rush = noise(
        count, rng, turbulence(rng, rng.uniform(700.0, 1600.0), rng.uniform(3.5, 5.0), 3.0) + hose(rng, length / 8, 9.0)
    )
    inlet = noise(
        count, rng, turbulence(rng, rng.uniform(160.0, 320.0), rng.uniform(5.0, 7.0)) + hose(rng, length / 4, 8.0)
    )
    hiss = noise(count, rng, turbulence(rng, rng.uniform(3500.0, 6000.0), rng.uniform(5.0, 7.0), 6.0))
    shaft = turns_of(rng.uniform(290.0, 360.0) * take.speed, count, rng.random())
    motor = rotor(shaft, {1: 1.0, 2: 0.4, 3: 0.15, 6: 0.2}, rng, 420.0, 0.3, 0.1)
    singing = _singing(count, rng, take.flow, rng.uniform(6.0, 10.0))
    strokes = scraping(count, rng, take.motion * take.contact, rng.uniform(300.0, 900.0), 4.0, 3.0)
    flaps = impacts(count, rng, 1.5 * take.motion, slopes([(150.0, -3.0), (600.0, 0.0), (4000.0, -15.0)]), 0.7, 0.06)
    loud = take.flow**2.5
    return np.asarray(
        rush * expand(loud * np.exp(slow(count, rng, 12.0, 0.12)), count)
        + decibels(rng.uniform(-6.0, 0.0)) * inlet * expand(loud * np.exp(slow(count, rng, 6.0, 0.2)), count)
        + decibels(rng.uniform(-16.0, -9.0)) * hiss * expand(loud * (0.6 + take.contact + 3.0 * take.sealed), count)
        + decibels(rng.uniform(-14.0, -7.0)) * motor * expand(np.minimum(take.speed, 1.3) ** 2.5, count)
        + decibels(rng.uniform(-9.0, -1.0)) * singing
        + decibels(rng.uniform(-10.0, -4.0)) * strokes
        + 0.8 * flaps
        + 0.6 * debris(count, rng, take.contact * np.minimum(take.speed, 1.0), 25.0, 900.0, 5000.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.0),
        dtype=np.float64,
    )


def stretch_hose(count: int, rng: Generator) -> Array:
    """A compact cleaner on a stretch hose: the hose sings while it is drawn out, a motor close by roars over it.

    Model: as `central`, with a hose of 1.5 to 3.5 m whose corrugations sit beside the listener, and a universal motor
    of 18 to 28 thousand rpm in the room (Čudina and Prezelj 2007). Drawing out the hose lengthens the pitch of the
    corrugations, so tones jump more often than over a fixed one. Units: hose, motor, case, nozzle.
    """
    take = work(count, rng, Habit((15.0, 60.0), strokes=(0.3, 0.8), lift=(3.0, 10.0), seal=(6.0, 25.0)))
    length = rng.uniform(1.5, 3.5)
    shaft = rng.uniform(300.0, 470.0) * take.speed
    motor = universal_motor(count, rng, shaft, int(rng.integers(6, 10)), rng.uniform(0.2, 0.6), rng.uniform(-9.0, 0.0))
    air = noise(
        count, rng, turbulence(rng, rng.uniform(450.0, 1300.0), rng.uniform(3.5, 5.5), 3.0) + hose(rng, length, 9.0)
    )
    case = noise(count, rng, turbulence(rng, rng.uniform(150.0, 350.0), rng.uniform(4.0, 6.0)))
    drawn = np.clip(1.0 + 0.12 * take.push + slow(count, rng, 0.7, 0.05), 0.7, 1.3)
    singing = _singing(count, rng, take.flow / drawn, length)
    strokes = scraping(count, rng, take.motion * take.contact, rng.uniform(300.0, 1200.0), 4.5, 3.0)
    loud = expand(take.flow**2.5, count)
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-8.0, 0.0)) * case * loud
        + decibels(rng.uniform(-9.0, 0.0)) * radiated(motor, housing(rng, 200.0, 2600.0, 9.0))
        + decibels(rng.uniform(-14.0, -4.0)) * singing
        + decibels(rng.uniform(-12.0, -5.0)) * strokes
        + 0.5 * debris(count, rng, take.contact * np.minimum(take.speed, 1.0), 20.0, 900.0, 4500.0)
        + surroundings(count, rng, take.speed)
        + switch(count, rng, take.switched, 1.2),
        dtype=np.float64,
    )
