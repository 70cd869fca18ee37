"""Parts of vacuum cleaners: the work of who cleans, motors, floors, hoses, what is picked up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.fans import (
    CONTROL_RATE,
    Signal,
    approach,
    blades,
    cosine,
    decibels,
    expand,
    frames,
    impacts,
    modes,
    noise,
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

Range = tuple[float, float]


@dataclass(frozen=True)
class Habit:
    """How a cleaner is used: ranges of seconds unless said otherwise.

    Attributes:
        on: of a stretch with the motor on.
        off: of a pause with the motor off.
        powers: relative speeds that are chosen from, one per 8 to 30 s of a stretch.
        rise: time constant of the motor's start.
        fall: time constant of its coasting.
        strokes: to and fro movements of the nozzle per second.
        lift: gap between moments with the nozzle in the air.
        seal: gap between moments with the nozzle sucked on.
        load: relative change of the speed by a stroke.
    """

    on: Range = (25.0, 90.0)
    off: Range = (0.4, 1.3)
    powers: tuple[float, ...] = (1.0,)
    rise: Range = (0.25, 0.6)
    fall: Range = (0.7, 1.4)
    strokes: Range = (0.3, 0.65)
    lift: Range = (5.0, 20.0)
    seal: Range = (12.0, 45.0)
    load: Range = (0.004, 0.012)


@dataclass(frozen=True)
class Work:
    """Slow curves of a take: relative speed, nozzle on the floor, its speed, its direction, sucked on; 0 to 1.

    ``switched`` are the samples at which the motor was switched on or off.
    """

    speed: Array
    contact: Array
    motion: Array
    push: Array
    sealed: Array
    switched: NDArray[np.int64]

    @property
    def flow(self) -> Array:
        """Relative flow of air: it follows the speed, falls over a floor and nearly stops where the nozzle seals."""
        return np.asarray(self.speed * (1.0 - 0.12 * self.contact) * (1.0 - 0.42 * self.sealed))


def work(count: int, rng: Generator, habit: Habit) -> Work:
    """A take: switched on and off, strokes, the nozzle lifted or sucked on.

    The motor is a series motor: when the nozzle seals, the fan moves less air, takes less torque and runs up by 6 to
    16 per cent; a push over carpet takes a little speed away.
    """
    segments, total, begin = [], 0.0, rng.random() < 0.75
    start = float(rng.choice(habit.powers)) if begin else 0.0
    if not begin:
        segments.append((rng.uniform(*habit.off) * 0.5, 0.0))
    while total < count / SAMPLE_RATE:
        left = rng.uniform(*habit.on) * (rng.uniform(0.1, 1.0) if total == 0.0 else 1.0)
        total += left
        level = start if begin else float(rng.choice(habit.powers))
        while left > 0:
            part = min(left, rng.uniform(8.0, 30.0))
            segments.append((part, level))
            left, level = left - part, float(rng.choice(habit.powers))
        pause = rng.uniform(*habit.off)
        segments.append((pause, 0.0))
        total, begin = total + pause, False
    speed = approach(count, segments, start, rng.uniform(*habit.rise), rng.uniform(*habit.fall))
    contact = 1.0 - spells(count, rng, habit.lift, (0.6, 2.5), 0.15)
    sealed = spells(count, rng, habit.seal, (0.4, 2.0), 0.12) * contact
    rate = rng.uniform(*habit.strokes) * np.exp(slow(count, rng, 0.4, 0.2))
    stroke = 2 * np.pi * (rng.random() + np.cumsum(rate) / CONTROL_RATE)
    push = np.sin(stroke) * np.clip(1.0 + slow(count, rng, 0.5, 0.3), 0.2, 1.5)
    motion = np.minimum(np.abs(push), 1.0) * (1.0 - 0.8 * sealed)
    load = rng.uniform(*habit.load) * contact * (push - 0.3) - rng.uniform(0.06, 0.16) * sealed
    speed = speed * (1.0 - load + slow(count, rng, 0.5, 0.004) + slow(count, rng, 12.0, 0.0007))
    ends = np.cumsum([seconds for seconds, _ in segments])
    running = np.array([level > 0 for _, level in segments])
    switched = (ends[:-1][running[1:] != running[:-1]] * SAMPLE_RATE).astype(np.int64)
    return Work(np.maximum(speed, 0.004), contact, motion, push, sealed, switched)


def universal_motor(count: int, rng: Generator, speed: Array, impeller: int, rough: float, ripple_db: float) -> Signal:
    """A universal motor with its impeller, at about unit RMS and full speed.

    Orders of the shaft (imbalance, bent vanes), the blade-passing tone, the commutator's bars; the torque pulsates at
    twice the mains frequency, which makes a hum, side bands of the tones, and sparks under the brushes in bursts.

    Model: parts of the spectrum after M. Čudina and J. Prezelj, "Noise generation by vacuum cleaner suction units",
    parts I to III, Applied Acoustics 68 (2007) 491–537.

    Args:
        count: samples.
        rng: the only source of randomness.
        speed: turns per second, a slow curve.
        impeller: number of blades.
        rough: level of the shaft's orders re the blade-passing tone.
        ripple_db: level of the hum at twice the mains frequency (dB re the tones).
    """
    top = float(np.percentile(speed, 95))
    full = expand(np.minimum(speed / top, 1.3) ** 2.5, count)
    turns = turns_of(speed, count, rng.random())
    orders = blades(impeller, rng, rough, 4, rng.uniform(0.3, 0.6))
    orders[1], orders[2] = rough * rng.uniform(0.5, 1.5), rough * rng.uniform(0.2, 0.8)
    bars = int(rng.choice([22, 24, 28]))
    orders[bars] = orders.get(bars, 0.0) + rng.uniform(0.08, 0.3)
    tones = rotor(turns, orders, rng, 1.1 * top)
    mains = float(rng.choice([50.0, 60.0])) * (1.0 + slow(count, rng, 0.3, 4e-4))
    cycle = turns_of(2.0 * mains, count, rng.random())
    torque = rotor(cycle, {1: 1.0, 2: rng.uniform(0.15, 0.7), 3: rng.uniform(0.03, 0.2)}, rng, 130.0, 0.15, 0.05)
    current = 0.5 + 0.5 * cosine(cycle)
    sparks = noise(count, rng, slopes([(1500.0, -14.0), (4500.0, 0.0), (9000.0, -6.0), (16_000.0, -20.0)]))
    return np.asarray(
        full * tones * (1.0 + rng.uniform(0.05, 0.3) * (current - 0.5))
        + full * decibels(ripple_db) * torque
        + full * decibels(rng.uniform(-17.0, -9.0)) * sparks * current**2
    )


def hose(rng: Generator, length: float, strength: float) -> Array:
    """Gains (dB) of hose and tube: resonances of a pipe of that length (m), smeared by its bends."""
    first = 343.0 / (2.0 * length)
    peaks = [
        (first * k * rng.uniform(0.96, 1.04), rng.uniform(6.0, 14.0), strength * rng.uniform(0.3, 1.0))
        for k in range(1, 14)
    ]
    return modes(peaks) + ripple(rng, 1.5)


def housing(rng: Generator, low: float, high: float, strength: float) -> Array:
    """Gains (dB) of a housing of plastic: five panel resonances between ``low`` and ``high`` (Hz)."""
    peaks = [
        (float(np.exp(rng.uniform(np.log(low), np.log(high)))), rng.uniform(3.0, 9.0), strength * rng.uniform(0.3, 1.0))
        for _ in range(5)
    ]
    return modes(peaks) + ripple(rng, 1.5)


def scraping(count: int, rng: Generator, motion: Array, peak: float, fall: float, grain: float) -> Signal:
    """Noise of something drawn over a floor; its level follows the speed, with the grain of the floor (dB)."""
    body = slopes([(peak / 4, -8.0), (peak, 0.0), (4 * peak, -2 * fall), (16 * peak, -5 * fall)]) + ripple(rng, 2.0)
    level = motion**1.3 * np.exp(slow(count, rng, 25.0, grain / 8.7))
    return noise(count, rng, body) * expand(level, count)


def debris(count: int, rng: Generator, busy: Array, rate: float, low: float, high: float) -> Signal:
    """Grit and crumbs that hit tube, hose and bin; they come in bursts while the nozzle moves."""
    bursts = np.maximum(0.0, 0.3 + slow(count, rng, 1.2, 0.7)) ** 2
    middle = float(np.sqrt(low * high))
    body = slopes([(low / 2, -24.0), (low, -3.0), (middle, 0.0), (high, -6.0), (2 * high, -18.0)])
    return impacts(count, rng, rate * busy * bursts, body + ripple(rng, 5.0, 6.0), 0.8, rng.uniform(0.012, 0.04))


def surroundings(count: int, rng: Generator, speed: Array) -> Signal:
    """Heard while the motor is off: handling, wheels, cable and clothes over the noise of the room."""
    idle = np.clip(1.0 - 2.0 * speed, 0.0, 1.0)
    rubbing = np.exp(slow(count, rng, 6.0, 0.6)) * idle
    soft = noise(count, rng, slopes([(60.0, -2.0), (200.0, 0.0), (1500.0, -9.0), (8000.0, -24.0)]) + ripple(rng, 2.0))
    knocks = impacts(count, rng, 2.5 * idle, slopes([(90.0, -4.0), (350.0, 0.0), (2500.0, -14.0)]), 0.7, 0.12)
    return soft * expand(0.06 + 0.10 * rubbing, count) + 0.6 * knocks


def switch(count: int, rng: Generator, at: NDArray[np.int64], force: float) -> Signal:
    """The click of the switch whenever the motor is started or stopped."""
    body = slopes([(300.0, -6.0), (1800.0, 0.0), (5000.0, -4.0), (12_000.0, -16.0)]) + ripple(rng, 4.0)
    return struck(count, rng, at, force * rng.uniform(0.6, 1.2, len(at)), body, 0.03)


def brush_roll(count: int, rng: Generator, spin: Array, strips: int, peak: float) -> tuple[Signal, Signal]:
    """A brush roll on the floor: (noise of the bristles in bursts, knocks of the roll, belt and bearings)."""
    turns = turns_of(spin, count, rng.random())
    beat = rotor(turns, {1: 0.5, strips: 1.0, 2 * strips: 0.4}, rng, 120.0, 0.3, 0.15)
    bristles = noise(count, rng, turbulence(rng, peak, 5.0, 5.0, 2.5)) * np.clip(1.0 + 0.55 * beat, 0.1, 4.0)
    orders = {order: rng.uniform(0.2, 1.0) / order**0.6 for order in range(1, 16)}
    orders[strips] = 1.2
    return bristles, rotor(turns, orders, rng, 120.0, 0.3, 0.2)


def journey(count: int, rng: Generator, go: Range = (2.0, 12.0)) -> tuple[Array, Array, NDArray[np.int64]]:
    """A robot's drive: (speed of the left wheel, of the right one, samples of bumps); speeds re full, slow curves.

    ``go`` are the seconds (least, most) from one bump to the next turn.
    """
    times, left, right, bumps, now = [0.0], [1.0], [1.0], [], -rng.uniform(0.0, 6.0)
    while now < count / SAMPLE_RATE:
        straight = rng.uniform(*go)
        turn = rng.uniform(0.6, 2.4)
        spin = rng.choice([-1.0, 1.0]) * rng.uniform(0.35, 0.6)
        bumps.append(now + straight)
        for seconds, a, b in (
            (straight, 1.0, rng.uniform(0.92, 1.0)),
            (0.3, 0.0, 0.0),
            (0.7, -0.6, -0.6),
            (turn, spin, -spin),
        ):
            times += [now + 0.12, now + seconds]
            left += [a, a]
            right += [b, b]
            now += seconds
    at = np.arange(frames(count)) / CONTROL_RATE
    order = np.maximum.accumulate(times)
    strikes = (np.array(bumps) * SAMPLE_RATE).astype(np.int64)
    return np.interp(at, order, left), np.interp(at, order, right), strikes
