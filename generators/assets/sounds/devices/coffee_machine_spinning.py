"""A coffee machine that brews by spinning its capsule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices.coffee_machine_parts import (
    BOILING,
    SPITTING,
    STANDBY,
    Housing,
    drips,
    first_start,
    motor,
    run_up,
    unrest,
)
from generators.assets.sounds.machines import unbalance
from generators.assets.sounds.signals import Array, band_noise, harmonics, phase_of, time_axis
from generators.assets.sounds.water import Take, knock, spectrum


@dataclass(frozen=True)
class _Drive:
    """A machine's motor, capsule holder and collector.

    Attributes:
        top: highest speed (turns per second).
        orders: levels of the motor's multiples of the speed.
        rough: level of its bearings.
        critical: share of the highest speed at which the suspended holder resonates.
        damping: of that resonance, re the critical one.
        shake: level of the unbalance's vibration.
        spray: lower end of the spray's band (Hz).
        splash: level of the spray.
    """

    top: float
    orders: Array
    rough: float
    critical: float
    damping: float
    shake: float
    spray: float
    splash: float

    @classmethod
    def drawn(cls, rng: Generator) -> _Drive:
        """One unit: a brushless motor of two to four pairs of poles, a holder on rubber, a collector."""
        pairs = int(rng.integers(2, 5))
        orders = np.zeros(6 * pairs + 1)
        for order, level in ((1, 0.5), (2, 0.3), (pairs, 0.3), (2 * pairs, 0.6), (3, 0.2), (6 * pairs, 0.5)):
            orders[order - 1] += level * rng.uniform(0.4, 1.6)
        return cls(
            top=rng.uniform(62.0, 118.0),
            orders=orders,
            rough=rng.uniform(0.3, 0.7),
            critical=rng.uniform(0.2, 0.5),
            damping=rng.uniform(0.12, 0.3),
            shake=rng.uniform(0.15, 0.45),
            spray=rng.uniform(500.0, 1100.0),
            splash=rng.uniform(0.25, 0.6),
        )


def _course(rng: Generator, brew: float, slow: float) -> tuple[list[tuple[float, float]], float, float]:
    """Corners (s, share of the highest speed) of one capsule's spinning, and when the coffee begins and ends.

    Its code is read at ``slow`` speed, the powder soaks, the speed climbs in steps to the brewing speeds, rises once
    more to wring the powder out, and coasts.
    """
    read, soak = rng.uniform(1.2, 2.2), rng.uniform(1.5, 3.5)
    corners = [(0.0, 0.0), (0.5, slow), (read, slow), (read + 0.6, 1.6 * slow), (read + soak, 1.6 * slow)]
    now = begin = read + soak
    for _ in range(int(rng.integers(2, 5))):
        level = rng.uniform(0.5, 0.92)
        corners.append((now + rng.uniform(0.5, 1.6), level))
        now = corners[-1][0] + brew * rng.uniform(0.2, 0.45)
        corners.append((now, level * rng.uniform(0.97, 1.03)))
    corners += [(now + 0.8, 1.0), (now + rng.uniform(1.6, 3.2), 1.0)]
    end = corners[-1][0]
    corners += [(end + 0.6, 0.5), (end + 1.4, 0.2), (end + rng.uniform(2.2, 3.2), 0.0)]
    return corners, begin, end


def _spinning(rng: Generator, corners: list[tuple[float, float]], unit: _Drive, wet: tuple[float, float]) -> Array:
    """The capsule, its motor and the liquid that its rim throws at the wall from the first to the second of ``wet``."""
    t = time_axis(int((corners[-1][0] + 0.2) * SAMPLE_RATE))
    speed = np.interp(t, *np.array(corners).T)
    # The rotor's inertia rounds the steps of its controller.
    width = int(0.25 * SAMPLE_RATE)
    total = np.cumsum(np.pad(speed, (width // 2, width - width // 2), mode="edge"))
    speed = (total[width:] - total[:-width]) / width
    pitch = unit.top * speed * (1.0 + unrest(len(t), rng, 4.0, 0.004)) + 0.2
    whine = motor(rng, pitch, unit.orders, unit.rough)
    phase = phase_of(pitch, len(t), rng.uniform(0.0, 6.28))
    swing = np.minimum(unbalance(speed, unit.critical, unit.damping), 3.0) * speed**0.5
    shake = swing * harmonics(phase, [1.0, 0.5, 0.3, 0.2, 0.12, 0.1], rng) * (1.0 + unrest(len(t), rng, 3.0, 0.15))
    thrown = np.interp(t, [wet[0], wet[0] + 1.0, wet[1] - 0.5, wet[1] + 0.5], [0.0, 1.0, 0.8, 0.0])
    spray = band_noise(len(t), rng, unit.spray, 7.0 * unit.spray, 1) * speed**1.5 * (0.25 + thrown)
    spray *= 1.0 + 0.35 * np.sin(phase) + unrest(len(t), rng, 14.0, 0.2)
    windage = band_noise(len(t), rng, 150.0, 1200.0, 1) * speed**2.5
    return np.asarray(0.65 * whine + unit.shake * shake + unit.splash * spray + 0.25 * windage)


def centrifugal_pod(count: int, rng: Generator) -> Array:
    """A machine that spins its capsule at up to 3,700 to 7,100 turns a minute: the rim sprays coffee at a collector.

    The head is locked by a geared motor, the capsule turns slowly while its code is read and it soaks, then climbs in
    steps, passes the resonance of its rubber mount (`machines.unbalance`: J. P. Den Hartog, Mechanical Vibrations,
    4th ed. 1956, chapter 2), sprays, is wrung out and coasts. A small pump feeds it without pressure. Sequence: Nestec,
    US patent 8 813 634, brewing by centrifugal force. Unit: `_Drive`, head, pump, length of a cup.
    """
    take = Take(count, rng)
    unit, head = _Drive.drawn(rng), Housing(rng, 160, 2600, 10, 0.06, 0.5)
    brew, slow, gear = rng.uniform(7.0, 15.0), rng.uniform(0.06, 0.14), rng.uniform(40.0, 80.0)
    feed = rng.uniform(35.0, 60.0)
    now = first_start(rng, brew + 4.0)
    while now < take.line.seconds:
        lock = rng.uniform(0.9, 1.8)
        turn = gear * run_up(lock, 0.06, 0.08, 0.3)
        take.at(now - lock - 0.6, 0.45, motor(rng, turn + 0.3, [0.5, 0.4, 0.3, 0.5, 0.2, 0.3, 0.2, 0.3], 0.5))
        take.at(now - 0.55, rng.uniform(0.6, 1.2), head.blow(0.12, 0.5))
        corners, begin, end = _course(rng, brew, slow)
        take.at(now, 1.0, _spinning(rng, corners, unit, (begin, end)))
        pumped = feed * run_up(end - begin, 0.1, 0.12, 0.4)
        pumped = pumped * (1.0 + unrest(len(pumped), rng, 3.0, 0.02)) + 0.3
        take.at(now + begin - 0.5, 0.3, motor(rng, pumped, [0.6, 1.0, 0.5, 0.6, 0.3, 0.2, 0.2, 0.1], 0.3))
        drips(take, "cup", now + begin + 2.0, now + end, 1.0, 5.0)
        take.line.add("foam", (now + begin + 1.5, 0.0), (now + begin + 3.0, 0.25), (now + end, 0.35))
        take.line.add("foam", (now + end + 1.2, 0.05), (now + end + 2.5, 0.0))
        heat = now + corners[-1][0]
        take.at(heat + rng.uniform(0.5, 1.5), 0.5, knock(rng, 600, 5000, 0.03, click=0.8))
        for moment in (2.0, 2.0 + rng.uniform(0.15, 0.4)):
            take.at(heat + moment, rng.uniform(0.7, 1.5), head.blow(0.2, 0.5))
        now = heat + lock + rng.uniform(3.5, 7.0)
    power = take.power("foam", spectrum(SPITTING, rng), 4.0, 22.0)
    power += take.power("-", spectrum(BOILING, rng, 1.5), 2.5, 12.0, least=0.06)
    power += take.power("-", spectrum(STANDBY, rng), 1.0, least=0.06)
    water = 0.4 * take.bubbles("cup", 60, (0.7, 2.8), 0.5) + 0.25 * take.splashes("cup", 50, 0.5)
    return take.heard(power, water, 1.3)
