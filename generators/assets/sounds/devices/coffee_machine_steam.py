"""Two coffee machines without a pump: one that presses with its boiler's steam, one that whips instant powder."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.coffee_machine_parts import (
    BOILING,
    CONDENSING,
    JET,
    SPITTING,
    STANDBY,
    Housing,
    drips,
    first_start,
    motor,
    run_up,
    slugs,
    unrest,
)
from generators.assets.sounds.signals import Array, band_noise, time_axis
from generators.assets.sounds.water import Spectrum, Take, frame_drift, knock, moving_peak, spectrum


def _froths(take: Take, begin: float, end: float) -> None:
    """The wand in milk: the curve ``froth``, and air that is torn in (``tear``) in its first part."""
    rng = take.rng
    take.line.add("froth", (begin, 0.0), (begin + 0.4, 0.6), (0.6 * begin + 0.4 * end, 0.9))
    take.line.add("froth", (end - 0.5, 0.7), (end, 0.0))
    moment, last = begin + 0.4, begin + 0.4 * (end - begin)
    while moment < last:
        take.line.add("tear", (moment, 0.05), (moment + 0.03, rng.uniform(0.2, 0.8)), (moment + 0.1, 0.05))
        moment += rng.uniform(0.14, 0.4)
    take.line.add("tear", (last + 0.2, 0.0))


def steam_espresso(count: int, rng: Generator) -> Array:
    """A small machine without a pump: its boiler's steam, 1 to 3 bar, presses the water, then the rest froths milk.

    The heater makes the boiler louder up to nucleate boiling (Aljishi & Tatarkiewicz 1991); water comes in a thin
    stream, then in slugs with steam; the steam that follows is a jet (Lighthill 1952) into air or milk, where its
    bubbles condense (Li et al. 2023); opened at the end, the cap lets the pressure go. Unit: boiler of .2 to .4 l with
    modes from 200 Hz, durations, wand, whether milk is frothed.
    """
    take = Take(count, rng)
    boiler, heat = Housing(rng, 200, 4200, 12, 0.06, 0.4), rng.uniform(6.0, 14.0)
    tube, pitch = rng.uniform(350.0, 800.0), rng.uniform(500.0, 1600.0)
    now = -rng.uniform(0.0, 2.5 * heat) if rng.random() < 0.6 else rng.uniform(0.2, 1.0)
    while now < take.line.seconds:
        take.at(now, 0.6, knock(rng, 900, 6000, 0.03, click=1.0))
        flows = now + heat * rng.uniform(0.8, 1.2)
        spits = flows + rng.uniform(5.0, 10.0)
        take.line.add("boil", (now, 0.05), (flows - 1.0, rng.uniform(0.3, 0.6)), (spits, 0.25))
        drips(take, "cup", flows, spits, 0.8, 2.0)
        end = spits + rng.uniform(2.0, 6.0)
        slugs(take, "spit", (spits - 1.0, end), (3.0, rng.uniform(6.0, 10.0)), tube, 0.7)
        take.line.add("wand", (spits, 0.0), (end - 0.5, rng.uniform(0.1, 0.35)), (end, 0.0))
        if rng.random() < 0.75:
            begin = end + rng.uniform(1.0, 2.5)
            take.line.add("wand", (begin - 0.6, 0.0), (begin - 0.5, 0.6), (begin - 0.1, 0.5), (begin, 0.0))
            end = begin + rng.uniform(6.0, 14.0)
            _froths(take, begin, end)
        for _ in range(int(rng.integers(1, 4))):
            take.at(end + rng.uniform(0.3, 1.2), rng.uniform(0.4, 1.0), boiler.blow(0.3, 0.4))
        vent = end + rng.uniform(1.5, 3.0)
        take.line.add("wand", (vent, 0.0), (vent + 0.1, 0.7), (vent + 1.0, 0.3), (vent + rng.uniform(1.5, 3.0), 0.0))
        now = vent + rng.uniform(4.0, 7.0)
    frames = len(take.line.times)
    milk = moving_peak(pitch * np.exp(frame_drift(frames, rng, 3.0, 0.15)), 2.0, 9.0)
    power = take.power("boil", spectrum(BOILING, rng, 1.5), 3.0, 15.0, least=0.06)
    power += take.power("spit", spectrum(SPITTING, rng, 1.0, 2.0, 3), 5.0, 30.0)
    power += take.power("wand", spectrum(JET, rng, 1.0), 2.5, 25.0)
    power += 0.5 * milk * take.power("froth", spectrum(CONDENSING, rng), 3.0, 30.0)
    power += take.power("tear", spectrum(JET, rng, 1.5), 4.0, 45.0)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.05)
    water = 0.4 * take.bubbles("cup", 55, (0.7, 2.8), 0.5) + 0.3 * take.splashes("froth", 60)
    return take.heard(power, water + 0.4 * take.splashes("spit", 60), 1.4)


def _spins(rng: Generator, length: float, turns: float, rough: float, load: float) -> Array:
    """A small direct-current motor that runs up, works against ``load`` (share of its speed) and coasts."""
    speed = run_up(length, 0.06, rng.uniform(0.1, 0.25), 0.6)
    pitch = turns * speed * (1.0 - load * np.clip(time_axis(len(speed)) / 0.6, 0.0, 1.0))
    pitch = pitch * (1.0 + unrest(len(speed), rng, 6.0, 0.012)) + 0.5
    return motor(rng, pitch, np.array([0.8, 0.6, 0.35, 0.5, 0.2, 0.3, 0.1, 0.2]) * rng.uniform(0.5, 1.5, 8), rough)


def instant_whipper(count: int, rng: Generator) -> Array:
    """A machine of an office that mixes powders: augers dose, hot water runs into a bowl, a whipper turns, a cup fills.

    A solenoid valve opens the tank's outlet (no pump: the water falls); an auger of 1 to 3 turns a second behind a
    worm gear pushes powder; the whipper's motor turns 130 to 250 times a second and its disc whips water, whose noise
    follows the tip speed; the tank simmers and its cooling fan runs. Unit: motors, cabinet of sheet metal with modes
    from 90 Hz, recipe.
    """
    take = Take(count, rng)
    cabinet, whip, gear = Housing(rng, 90, 2600, 13, 0.09, 0.5), rng.uniform(130.0, 250.0), rng.uniform(45.0, 90.0)
    bowl, wet = rng.uniform(500.0, 1400.0), rng.uniform(0.3, 0.7)
    now = first_start(rng, 12.0)
    while now < take.line.seconds:
        take.at(now, 0.8, cabinet.blow(0.2, 0.6))
        for powder in range(int(rng.integers(1, 4))):
            dose, at = rng.uniform(0.8, 2.2), now + 0.5 + 3.2 * powder
            run = dose + rng.uniform(1.5, 4.0)
            take.at(at, 0.8, knock(rng, 700, 5000, 0.03, click=1.2))
            take.line.add("bowl", (at, 0.0), (at + 0.2, 0.8), (at + dose + 1.0, 0.7), (at + dose + 1.6, 0.05))
            take.at(at + 0.3, 0.5, _spins(rng, dose, gear, 0.5, 0.1))
            whirl = _spins(rng, run, whip, rng.uniform(0.3, 0.7), 0.12)
            t = time_axis(len(whirl))
            splash = band_noise(len(whirl), rng, 0.5 * bowl, 6.0 * bowl, 1) * np.interp(
                t, [0.0, 0.2, run, run + 0.3], [0.0, 1.0, 0.7, 0.0]
            )
            take.at(at + 0.2, 1.0, 0.6 * whirl + wet * splash * (1.0 + unrest(len(whirl), rng, 12.0, 0.3)))
            take.at(at + dose + 1.0, 0.7, knock(rng, 700, 5000, 0.03, click=1.2))
            now = at + run
        drips(take, "cup", now - 4.0, now + 0.5, 0.8, 4.0)
        now += rng.uniform(3.0, 7.0)
    fan: Spectrum = {63: -8, 125: -3, 250: 0, 500: -3, 1000: -7, 2000: -12, 4000: -19, 8000: -28, 16_000: -42}
    power = take.power("bowl", spectrum(SPITTING, rng), 3.0, 20.0)
    power += take.power("-", spectrum(BOILING, rng), 2.5, 12.0, least=0.06)
    power += take.power("-", spectrum(fan, rng), 0.8, least=rng.uniform(0.05, 0.2))
    water = 0.4 * take.bubbles("cup", 60, (0.7, 3.0), 0.5) + 0.3 * take.splashes("bowl", 70)
    return take.heard(power, water, 1.3)
