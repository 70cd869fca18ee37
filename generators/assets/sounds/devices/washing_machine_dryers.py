"""A washer-dryer that dries, and a top loader whose drum lies on a horizontal axis."""

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
from generators.assets.sounds.machines import (
    driven,
    drummed,
    induction_motor,
    passages,
    plate,
    read_at,
    rolling,
    sloped,
    struck,
    tones,
    turned,
    universal_motor,
    wander,
)
from generators.assets.sounds.signals import Array


def washer_dryer(count: int, rng: Generator) -> Array:
    """Washer-dryer that dries: the drum tumbles, a blower drives air over a heater, water trickles through a condenser.

    Model: a forward-curved blower on a two-pole induction motor (slip 3–10 %): a broad hump under its blade tone (A.
    Guédel, Fan Acoustics, AMCA 2007, chapter 1). Dry laundry falls softly; buttons and zips click on the drum. Units:
    blower, its duct, how much of it passes the door, drum, thermostat.
    """
    run = reversing(count, rng, (22, 60), (1.5, 3.0))
    wash = rng.uniform(0.75, 0.95) * run
    body = cabinet(rng, 60, 1400, 0.05)
    mains = float(rng.choice([50.0, 60.0]))
    motor = induction_motor(count, rng, mains, int(rng.choice([22, 28, 34])), 1)
    turns = turned(mains * rng.uniform(0.9, 0.97) * (1.0 + wander(count, rng, 0.5, 0.003)))
    blades = int(rng.integers(22, 41))
    sing = tones(turns, count, {1: 0.5, 2: 0.3, blades - 1: 0.3, blades: 1.0, 2 * blades: 0.25}, rng, 3.0)
    rush = sloped(count, rng, rng.uniform(130, 420), rng.uniform(2500, 6000), rng.uniform(-5.5, -3.0), below=6.0)
    duct = driven(rush, plate(rng, 150, 2500, 12, 0.1))
    relay = np.cumsum(rng.exponential(9.0, count // 200_000 + 3))
    return np.asarray(
        10 ** (rng.uniform(-9.0, -1.0) / 20) * (rush + 0.5 * duct)
        + 10 ** (rng.uniform(-26.0, -14.0) / 20) * sing
        + 0.1 * driven(motor, body)
        + 1.1 * rolling(count, rng, wash, 0.9, roar(count, rng, rng.uniform(60, 120), -6.0, rng.uniform(3000, 8000)))
        + 0.8 * laundry(count, rng, wash, body, 3, 0.05)
        + 0.3 * struck(count, rng, plate(rng, 600, 5000, 14, 0.03), relay, 1.0, 2e-4)
        + 0.25 * slosh(count, rng, np.full_like(wash, 0.3), (0.8, 4.0), 60.0)
        + 0.2 * residual(count, rng)
    )


def toploader_hatch(count: int, rng: Generator) -> Array:
    """Narrow top loader whose drum lies between two bearings: its hatch and its tub's lid clatter with each turn.

    Model: commutator motor and belt as in front loaders (ratio 13–17); the hatch's play strikes once a turn while it
    passes the top, at washing speed by its weight and at low spin speed by the unbalance; higher, it is pressed outward
    and stays quiet (centripetal against gravity). Units: hatch, play, tub, motor.
    """
    spans = programme(count, rng, (("wash", 25, 50), ("spin", 12, 24)))
    top, ratio = rng.uniform(9.0, 14.0), rng.uniform(13.0, 17.0)
    wash = rng.uniform(0.8, 1.0) * reversing(count, rng, (7, 13), (1.5, 3.0)) * gate(count, spans, "wash")
    speed = np.abs(wash) + spinning(count, rng, spans, "spin", (1.8, 0.5 * top, top))
    body = cabinet(rng, 75, 1700, 0.05)
    motor = universal_motor(count, rng, ratio * speed, ratio * top, int(rng.choice([20, 22, 24])), 50.0)
    once = passages(turned(speed) + 0.02 * wander(count, rng, 2.0, 1.0), 1)
    now = read_at(speed, once)
    # Beyond about two turns a second the hatch is pressed on its rim.
    force = np.clip(1.0 - (now / rng.uniform(1.6, 2.6)) ** 2, 0.0, 1.0) * np.exp(rng.normal(0, 0.4, len(once)))
    hatch = drummed(count, rng, plate(rng, 380, 4200, 18, 0.03, -0.8), once, force, 4e-4, 0.4)
    return np.asarray(
        0.14 * driven(motor, body)
        + 0.06 * motor
        + 1.4 * rolling(count, rng, speed, top, roar(count, rng, rng.uniform(80, 150), -6.0, rng.uniform(3000, 8000)))
        + rng.uniform(0.2, 0.6) * hatch
        + 0.9 * laundry(count, rng, wash, body, 3, 0.12)
        + 0.5 * thumps(count, rng, speed, body, rng.uniform(3.0, 5.0), 0.2)
        + 1.0 * slosh(count, rng, 0.4 * np.abs(wash), (1.2, 7.0), 55.0)
        + 0.18 * residual(count, rng)
    )
