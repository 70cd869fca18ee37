"""Two more coffee machines: pods with an air pump, and a geared grinder."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.coffee_machine_parts import (
    BOILING,
    SPITTING,
    STANDBY,
    Housing,
    cracks,
    drips,
    first_start,
    motor,
    run_up,
    unrest,
)
from generators.assets.sounds.signals import Array, add_at, band_noise, phase_of, time_axis
from generators.assets.sounds.water import Take, knock, spectrum


def _air_pump(rng: Generator, length: float, strokes: float, housing: Housing, load: float) -> Array:
    """A diaphragm pump: a small direct-current motor with an eccentric, a soft blow and two valves per turn."""
    speed = run_up(length, 0.08, 0.15, 0.5)
    count = len(speed)
    pitch = strokes * speed * (1.0 - 0.25 * load * np.minimum(time_axis(count) / max(length, 0.1), 1.0))
    pitch = pitch * (1.0 + unrest(count, rng, 5.0, 0.01)) + 0.1
    turns = phase_of(pitch, count, rng.uniform(0, 6.28)) / (2 * np.pi)
    whine = motor(rng, pitch, [0.5, 1.0, 0.5, 0.3, 0.3, 0.2, 0.2, 0.15, 0.1, 0.3, 0.1, 0.2], rng.uniform(0.3, 0.7))
    blows = [housing.blow(0.05, 0.35) for _ in range(8)]
    out = 0.5 * whine
    for number, place in enumerate(np.flatnonzero(np.diff(np.floor(2.0 * turns)) > 0)):
        force = speed[place] ** 2 * (1.0 if number % 2 else 0.6) * np.exp(rng.normal(0.0, 0.15))
        add_at(out, int(place + rng.normal(0.0, 8.0)), force * blows[int(rng.integers(0, 8))])
    return out


def pod_air_pump(count: int, rng: Generator) -> Array:
    """A machine for pods that fills a small boiler and presses the hot water through the pod with air.

    A small pump fills the boiler, which simmers louder up to the boil (Aljishi & Tatarkiewicz 1991); a diaphragm pump
    presses for 9 to 18 s, two blows a turn, and slows as the pressure rises; air sputters through the pod at the end.
    Unit: pump of 35 to 70 turns a second, case, boiler.
    """
    take = Take(count, rng)
    housing, strokes = Housing(rng, 150, 3200, 11, 0.04, 0.5), rng.uniform(35.0, 70.0)
    heat, press = rng.uniform(5.0, 11.0), rng.uniform(9.0, 18.0)
    now = first_start(rng, heat + press)
    while now < take.line.seconds:
        take.at(now - 1.2, 1.2, knock(rng, 200, 2400, 0.07, 9))
        take.at(now - 0.9, 1.4, knock(rng, 150, 2000, 0.09, 9, 0.6))
        fill = rng.uniform(1.5, 3.5)
        take.at(now, 0.7, _air_pump(rng, fill, 0.8 * strokes, housing, 0.1))
        begin = now + fill + heat * rng.uniform(0.8, 1.2)
        end = begin + press * rng.uniform(0.9, 1.1)
        take.line.add("boil", (now + fill, 0.08), (begin - 1.0, rng.uniform(0.25, 0.5)), (begin + 2.0, 0.12))
        take.at(begin, 1.0, _air_pump(rng, end - begin, strokes, housing, 1.0))
        drips(take, "cup", begin + 1.5, end - 2.0, 1.0, 4.0)
        take.line.add(
            "sputter", (end - 2.5, 0.0), (end - 1.5, 0.5), (end - 0.2, 0.7), (end + 0.8, 0.15), (end + 1.5, 0.0)
        )
        now = end + rng.uniform(3.5, 8.0)
    power = take.power("boil", spectrum(BOILING, rng, 1.5), 3.0, 16.0, least=0.07)
    power += take.power("sputter", spectrum(SPITTING, rng, 1.0, 2.0, 3), 6.0, 25.0)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.06)
    water = 0.4 * take.bubbles("cup", 60, (0.7, 2.8), 0.5) + 0.3 * take.splashes("cup", 60, 0.5)
    return take.heard(power, water + 0.5 * take.splashes("sputter", 90), 1.2)


def geared_conical_grinder(count: int, rng: Generator) -> Array:
    """A conical grinder behind a planetary gear on a direct-current motor: a gear's whine, slow deep crunching.

    Cones of 350 to 600 turns a minute (6 to 10 a second) behind a gear of 1 to 18 to 30: teeth mesh at 600 to 2,000 Hz
    with side bands of the carrier (P. D. McFadden, J. D. Smith, Proc. IMechE 199 (1985) 65–70: planetary gears). Beans
    break 120 to 320 times a second, in larger pieces than between flat burrs. Unit: gear, motor, hopper, portion.
    """
    take = Take(count, rng)
    cone, ratio, dose = rng.uniform(6.0, 10.0), rng.uniform(18.0, 30.0), rng.uniform(5.0, 16.0)
    mesh = rng.uniform(600.0, 2000.0)
    rate, low = rng.uniform(120.0, 320.0), rng.uniform(250.0, 600.0)
    levels = np.array([0.6, 0.4, 0.15, 0.3, 0.1, 0.2, 0.08, 0.1]) * rng.uniform(0.5, 1.5, 8)
    now = first_start(rng, dose)
    while now < take.line.seconds:
        length = dose * rng.uniform(0.85, 1.15)
        speed = run_up(length, 0.1, rng.uniform(0.1, 0.3), 1.0)
        t = time_axis(len(speed))
        feed = np.interp(t, [0.0, 0.3, 0.8, 0.85 * length, length], [0.0, 0.5, 1.0, 0.9, 0.2])
        feed = np.clip(feed * (1.0 + unrest(len(t), rng, 3.0, 0.3)), 0.0, None) * (t < length)
        load = 1.0 - 0.08 * feed + unrest(len(t), rng, 8.0, 0.006)
        armature = motor(rng, ratio * cone * speed * load + 0.2, levels, rng.uniform(0.3, 0.7))
        carrier = phase_of(cone * speed + 0.01, len(t))
        teeth = np.sin(phase_of(mesh * speed * load + 0.1, len(t))) + 0.4 * np.sin(
            2 * phase_of(mesh * speed * load, len(t))
        )
        teeth *= speed * (1.0 + 0.5 * np.sin(3 * carrier) + unrest(len(t), rng, 10.0, 0.2))
        crush = band_noise(len(t), rng, 250, 4500, 1) * feed * (1.0 + 0.5 * np.sin(2 * carrier))
        grains = cracks(rng, rate * feed, low, 6500, 0.02)
        take.at(now, 1.0, 0.5 * armature + rng.uniform(0.15, 0.5) * teeth + 0.35 * crush + 1.8 * grains)
        take.at(now - 0.02, 0.7, knock(rng, 500, 4500, 0.04, click=0.9))
        late = now + length + rng.uniform(1.0, 2.5)
        for k in range(int(rng.integers(0, 4))):
            take.at(late + 0.3 * k + rng.normal(0, 0.04), rng.uniform(0.8, 1.6), knock(rng, 250, 3200, 0.07, 9, 0.5))
        if rng.random() < 0.5:
            take.line.add("beans", (late + 1.5, 0.0), (late + 1.9, 1.0), (late + 2.8, 0.8), (late + 3.3, 0.0))
            late += 2.0
        now = late + rng.uniform(2.0, 6.0)
    power = take.power("-", spectrum(STANDBY, rng), 1.5, least=0.09)
    return take.heard(power, 0.9 * take.splashes("beans", 130), 1.2)
