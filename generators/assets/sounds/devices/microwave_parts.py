"""Parts of microwave ovens: supplies of the magnetron, cooling fans, turntables, doors, buzzers, sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

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
    modes,
    noise,
    passages,
    ripple,
    rotor,
    slopes,
    slow,
    struck,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array

Range = tuple[float, float]
Moments = NDArray[np.int64]
#: Highest multiple of the mains frequency.
_ORDERS = 120
#: What an oven's body takes of the sound from its back (dB per octave from 500 Hz on), between units and places.
_SHADOW_DB = (-3.0, -1.5)


@dataclass(frozen=True)
class OvenUse:
    """A kitchen's use of an oven: cooking (slow curve, 0 or 1) and the samples of what happens.

    Attributes:
        cooking: 1 while the oven runs.
        starts: it starts, with the click of a relay.
        ends: it ends by itself.
        opens: the door is opened.
        closes: the door is closed.
        keys: a key is pressed.
        before: seconds of cooking before the first sample.
    """

    cooking: Array
    starts: Moments
    ends: Moments
    opens: Moments
    closes: Moments
    keys: Moments
    before: float

    @property
    def heated(self) -> Array:
        """Slow curve: seconds since the cooking began (0 while the oven rests)."""
        places = np.arange(len(self.cooking))
        resting = np.maximum.accumulate(np.where(self.cooking > 0, -round(self.before * CONTROL_RATE) - 1, places))
        return np.asarray(np.where(self.cooking > 0, places - resting, 0) / CONTROL_RATE)


def session(count: int, rng: Generator, cook: Range, gap: Range) -> OvenUse:
    """Cooking for ``cook`` seconds, then ``gap`` seconds with the door, the dish and the keys, and again."""
    starts, ends, opens, closes, keys = [], [], [], [], []
    edges, levels, now, before = [-1.0], [1.0], 0.0, 0.0
    if rng.random() < 0.85:
        length = rng.uniform(*cook)
        now = rng.uniform(0.05, 1.0) * length
        before = length - now
    else:
        levels[0] = 0.0
    end = count / SAMPLE_RATE
    while True:
        if levels[-1] > 0:
            edges.append(now)
            levels.append(0.0)
            ends.append(now)
            if now > end:
                break
        length = rng.uniform(*gap)
        opens.append(now + 0.25 * length + rng.uniform(0.0, 0.2) * length)
        closes.append(now + rng.uniform(0.6, 0.72) * length)
        pressed = int(rng.integers(1, 5))
        keys += list(now + length * (0.8 + 0.17 * np.sort(rng.random(pressed))))
        now += length
        starts.append(now)
        edges.append(now)
        levels.append(1.0)
        now += rng.uniform(*cook)
    at = np.arange(frames(count)) / CONTROL_RATE
    cooking = np.array(levels)[np.searchsorted(edges, at, side="right") - 1]

    def samples(times: Sequence[float]) -> Moments:
        return (np.array(times, dtype=np.float64) * SAMPLE_RATE).astype(np.int64)

    return OvenUse(cooking, samples(starts), samples(ends), samples(opens), samples(closes), samples(keys), before)


def duty(count: int, rng: Generator, cooking: Array, period: float, share: float) -> tuple[Array, Moments]:
    """Power that a relay switches on for a share of each period: (slow curve 0 or 1, samples of the switching)."""
    clock = np.arange(frames(count)) / CONTROL_RATE / period
    place = np.mod(clock + rng.random() + slow(count, rng, 0.05, 0.008), 1.0)
    power = cooking * (place < share)
    return power, (np.flatnonzero(np.diff(power)) + 1) * int(SAMPLE_RATE / CONTROL_RATE)


def mains(count: int, rng: Generator) -> tuple[float, Array]:
    """(nominal frequency, angle in turns) of the mains: 50 or 60 Hz, whose deviation of some 0.02 Hz wanders."""
    nominal = float(rng.choice([50.0, 60.0]))
    return nominal, turns_of(nominal + slow(count, rng, 0.1, 0.02), count, rng.random())


def _orders(force: Array, nominal: float, corner: float, rng: Generator) -> dict[int, float]:
    """Levels of the multiples of the mains frequency of a force over one period, radiated by sheet metal.

    Panels radiate their velocity; above ``corner`` (Hz) their mass and the feet of the transformer hold them.
    """
    levels = np.abs(np.fft.rfft(force))[: _ORDERS + 1]
    frequency = np.arange(_ORDERS + 1) * nominal
    levels = levels * frequency**1.2 / (1.0 + (frequency / corner) ** 2.0)
    levels /= levels[1:].max()
    return {k: float(levels[k]) * float(np.exp(rng.normal(0.0, 0.35))) for k in range(1, _ORDERS + 1)}


def transformer(count: int, rng: Generator, cycle: Array, nominal: float, power: Array, corner: float) -> Signal:
    """A magnetron's transformer with its half-wave voltage doubler, about unit RMS under load.

    The core stretches with the square of its flux (magnetostriction), so it hums at twice the mains frequency; it is
    driven into saturation, and the magnetizing current's peaks pull at coils and shunts, which adds the even multiples.
    Loose sheets touch near the peaks of the force, which makes its spectrum long. The doubler feeds the magnetron in
    one half wave only: that biases the core and adds odd multiples. For 1.2 to 2.4 s after the relay closes, until the
    filament emits, there is no load.

    Model: M. van der Veen, F. de Leon, B. Gladstone and V. Tatu, "Measuring acoustic noise emitted by power
    transformers", AES 109th convention (2000); the circuit is that of service manuals.
    """
    angle = np.arange(2048) * (2 * np.pi / 2048)
    saturation, bias = rng.uniform(0.1, 0.5), rng.uniform(0.01, 0.04)
    idle = np.sin(angle)
    loaded = 0.92 * np.sin(angle) + bias + 0.06 * np.sin(3 * angle + rng.uniform(0, 6.3))
    magnetron = np.maximum(0.0, np.sin(angle - rng.uniform(0.3, 0.8)) - rng.uniform(0.35, 0.6))
    forces = [flux**2 + saturation * (flux + flux**7) ** 2 for flux in (idle, loaded)]
    forces[1] = forces[1] + rng.uniform(0.1, 0.4) * magnetron
    # Sheets, shunts and feet that are not clamped touch near the force's peaks only.
    play, stiff = rng.uniform(0.75, 0.93), rng.uniform(0.5, 2.5)
    forces = [force / force.max() + stiff * np.maximum(0.0, force / force.max() - play) for force in forces]
    delay = int(rng.uniform(1.2, 2.4) * CONTROL_RATE)
    emitting = power * np.concatenate([np.full(min(delay, len(power)), power[0]), power[:-delay]])[: len(power)]
    out = np.zeros(count, dtype=np.float32)
    for force, level in ((forces[0], power - emitting), (forces[1], emitting)):
        smooth = np.convolve(np.pad(level, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
        out += rotor(cycle, _orders(force, nominal, corner, rng), rng, nominal, 0.10, 0.03) * expand(smooth, count)
    return out


def lamination_noise(count: int, rng: Generator, cycle: Array, power: Array, peak: float) -> Signal:
    """Loose sheets of the core rub in each half wave: bursts of noise at twice the mains frequency."""
    bursts = np.exp(4.0 * (cosine(2.0 * cycle + rng.random()) - 1.0))
    bursts /= np.sqrt(np.mean(np.square(bursts)))
    body = slopes([(peak / 4, -12.0), (peak, 0.0), (3 * peak, -12.0), (12 * peak, -36.0)]) + ripple(rng, 4.0)
    level = expand(power * np.exp(slow(count, rng, 6.0, 0.2)), count)
    return np.asarray(noise(count, rng, body) * bursts * level, dtype=np.float32)


def inverter(count: int, rng: Generator, cycle: Array, nominal: float, power: Array) -> Signal:
    """A magnetron's inverter, about unit RMS at full power (slow curve, 0 to 1).

    The switching at 20 to 40 kHz is not heard; its envelope is: the bus is a rectified sine, and the magnetron only
    conducts above its cut-off voltage, so coils, ferrite and cavity are pushed by 100 or 120 pulses a second, the
    shorter the smaller the power. Ferrite and litz wire add noise inside the pulses.

    Model: C. Bocchiola, "Parametric design guidelines for MW oven inverter" (International Rectifier); Panasonic,
    service manual of NN-H264: 20 to 40 kHz pulse width modulation.
    """
    angle = np.arange(2048) * (2 * np.pi / 2048)
    cut = rng.uniform(0.35, 0.6)
    force = np.maximum(0.0, np.abs(np.sin(angle)) - cut) * (1.0 + rng.uniform(0.0, 0.06) * np.sin(angle))
    tones = rotor(cycle, _orders(force, nominal, rng.uniform(900.0, 2200.0), rng), rng, nominal, 0.15, 0.06)
    pulse = np.maximum(0.0, np.abs(cosine(cycle)) - np.float32(cut))
    pulse /= np.sqrt(np.mean(np.square(pulse)))
    peak = rng.uniform(1800.0, 4500.0)
    hiss = noise(count, rng, slopes([(peak / 4, -18.0), (peak, 0.0), (4 * peak, -20.0)]) + ripple(rng, 4.0))
    buzz = (tones + np.float32(decibels(rng.uniform(-10.0, -3.0))) * hiss * pulse) * expand(power, count)
    return np.asarray(buzz, dtype=np.float32)


def louvres(rng: Generator) -> Array:
    """Gains (dB) of air that leaves by louvres at an oven's back: who stands before it hears it round its body.

    Model: Z. Maekawa, "Noise reduction by screens", Applied Acoustics 1 (1968) 157–173: a detour of some 30 cm takes
    3 dB per octave from 500 Hz on; a wall behind the oven gives a part of it back.
    """
    return slopes([(250.0, 0.0), (500.0, 0.0), (8000.0, 4.0 * rng.uniform(*_SHADOW_DB))])


def shaded_pole_fan(
    count: int, rng: Generator, speed: Array, nominal: float, slip: Range, peak: float
) -> tuple[Signal, Signal]:
    """A cooling fan on a two-pole shaded-pole motor: (broadband noise, tones of blades and motor), both unit RMS.

    The motor turns slower than the mains by its ``slip``; its rotor bars and air gap add tones at twice the mains
    frequency with side bands of the speed. ``speed`` is a slow curve, 1 at full speed.
    """
    turn = nominal * (1.0 - rng.uniform(*slip))
    turns = turns_of(np.maximum(turn * speed * (1.0 + slow(count, rng, 0.4, 0.003)), 0.05), count, rng.random())
    number = int(rng.integers(3, 9))
    orders = blades(number, rng, rng.uniform(0.15, 0.5), 5, rng.uniform(0.4, 0.7))
    tones = rotor(turns, orders, rng, 60.0, 0.2, 0.15)
    air = noise(count, rng, turbulence(rng, peak, rng.uniform(4.0, 6.5), 3.0, 2.5) + louvres(rng))
    air *= 1.0 + np.float32(rng.uniform(0.02, 0.12)) * cosine(turns)
    level = expand(np.minimum(speed, 1.2) ** 2.5, count)
    return air * level, tones * level


def spin_down(count: int, rng: Generator, cooking: Array, run_on: float) -> Array:
    """Slow curve of a fan that starts with the cooking and coasts down ``run_on`` seconds after it."""
    late = np.convolve(cooking, np.ones(max(1, int(run_on * CONTROL_RATE))), mode="full")[: len(cooking)] > 0.5
    edges = np.flatnonzero(np.diff(late.astype(np.int64), prepend=int(late[0])))
    bounds = np.concatenate([[0], edges, [len(late)]])
    segments = [((b - a) / CONTROL_RATE, float(late[a])) for a, b in pairwise(bounds) if b > a]
    return np.maximum(approach(count, segments, segments[0][1], rng.uniform(0.3, 0.8), rng.uniform(0.8, 1.8)), 0.01)


def turntable(count: int, rng: Generator, cooking: Array, rate: float) -> Signal:
    """A glass plate on a ring of three rollers: rolling noise, a bump per roller, creaks of the coupling.

    The plate turns ``rate`` times a minute, as the marking of its synchronous motor says (2.5/3 or 5/6 rpm at
    50/60 Hz); the ring turns half as fast.
    """
    speed = rate / 60.0 * cooking * (1.0 + slow(count, rng, 0.5, 0.02))
    low = np.cumsum(speed) / CONTROL_RATE
    wobble = sum(rng.uniform(0.2, 1.0) * np.cos(2 * np.pi * (k * low / 2 + rng.random())) for k in (1, 2, 3, 6)) / 2.0
    level = cooking * np.exp(0.7 * wobble + slow(count, rng, 15.0, 0.4))
    rolling = noise(
        count, rng, slopes([(150.0, -10.0), (700.0, 0.0), (2500.0, -5.0), (9000.0, -22.0)]) + ripple(rng, 4.0)
    )
    turns = turns_of(speed, count, rng.random())
    bumps = np.concatenate([passages(turns, 1.5, rng), passages(turns, 7.0, rng)])
    glass = slopes([(500.0, -10.0), (1800.0, 0.0), (6000.0, -6.0), (12_000.0, -18.0)])
    glass = glass + modes([(rng.uniform(900.0, 4500.0), 40.0, 16.0) for _ in range(6)])
    force = np.exp(rng.normal(-0.3, 0.7, len(bumps)))
    return rolling * expand(level, count) + 1.5 * struck(count, rng, bumps, force, glass, 0.06)


def clicks(count: int, rng: Generator, at: Moments, low: float, high: float, decay: float = 0.04) -> Signal:
    """Relays, latches and keys: one or two contacts some milliseconds apart, between ``low`` and ``high`` (Hz)."""
    second = at + rng.integers(200, 1800, len(at))
    body = slopes([(low / 2, -14.0), (low, -2.0), (np.sqrt(low * high), 0.0), (high, -4.0), (2 * high, -18.0)])
    both = np.concatenate([at, second])
    force = np.concatenate([rng.uniform(0.7, 1.3, len(at)), rng.uniform(0.0, 0.7, len(at))])
    return struck(count, rng, both, force, body + ripple(rng, 4.0, 6.0), decay)


def door(count: int, rng: Generator, held: OvenUse) -> Signal:
    """The door: latch and spring when it opens, latch and the thud of the cavity when it closes, dishes between."""
    thud = slopes([(70.0, -6.0), (190.0, 0.0), (600.0, -9.0), (3000.0, -26.0)]) + ripple(rng, 4.0)
    force = rng.uniform(1.5, 3.5, len(held.closes))
    slam = struck(count, rng, held.closes, force, thud, 0.25, 2.5)
    pull = struck(count, rng, held.opens, 0.5 * force, thud, 0.18, 3.0)
    latch = clicks(count, rng, np.concatenate([held.opens, held.closes + 200]), 900.0, 5000.0)
    dishes = [b + (e - b) * rng.random(4) for b, e in zip(held.opens, held.closes, strict=True)]
    at = np.sort(np.concatenate(dishes)).astype(np.int64) if dishes else np.zeros(0, dtype=np.int64)
    glass = slopes([(600.0, -12.0), (2200.0, 0.0), (7000.0, -8.0), (14_000.0, -24.0)]) + ripple(rng, 5.0, 6.0)
    clatter = struck(count, rng, at, rng.uniform(0.2, 0.9, len(at)), glass, 0.1)
    return slam + pull + latch + clatter


def beeps(count: int, rng: Generator, at: Moments, pitch: float, on: float, every: float, number: int) -> Signal:
    """A piezo disc driven by a square wave: ``number`` beeps of ``on`` seconds from each sample of ``at``.

    Model: a 2 kHz square wave, as measured at a buzzer (T. Gremalm, "Microwave oven silencer", hackaday.io project
    19760); other makes have 2.5 to 4.1 kHz. The disc passes its resonance and little below it.
    """
    out = np.zeros(count, dtype=np.float32)
    length = int((number * every + on) * SAMPLE_RATE)
    clock = np.arange(frames(length)) / CONTROL_RATE
    gate = np.convolve((np.mod(clock, every) < on) & (clock < number * every), [0.25, 0.5, 0.25], mode="same")
    orders = {1: 1.0, 2: rng.uniform(0.02, 0.2), 3: rng.uniform(0.08, 0.5), 4: 0.03, 5: rng.uniform(0.02, 0.15)}
    for start in at[(at > -length) & (at < count)]:
        turns = turns_of(pitch * (1.0 + slow(length, rng, 8.0, 3e-4)), length, rng.random())
        tone = rotor(turns, orders, rng, pitch, 0.05, 0.05) * expand(gate, length)
        low, high = max(0, int(start)), min(count, int(start) + length)
        out[low:high] += tone[low - start : high - start]
    return out


def kitchen(count: int, rng: Generator, cooking: Array) -> Signal:
    """The residue while the oven rests: noise of the room, handling, a lamp's and a power supply's faint hum."""
    soft = noise(count, rng, slopes([(60.0, -2.0), (250.0, 0.0), (1500.0, -8.0), (8000.0, -26.0)]) + ripple(rng, 2.5))
    return soft * expand(0.08 + (1.0 - cooking) * (0.10 + 0.10 * np.exp(slow(count, rng, 5.0, 0.6))), count)


def sheet_metal(rng: Generator, low: float, high: float, strength: float) -> Array:
    """Gains (dB) of cabinet and cavity: eight lightly damped panel modes between ``low`` and ``high`` (Hz)."""
    peaks = [
        (
            float(np.exp(rng.uniform(np.log(low), np.log(high)))),
            rng.uniform(6.0, 25.0),
            strength * rng.uniform(0.3, 1.0),
        )
        for _ in range(8)
    ]
    return modes(peaks) + ripple(rng, 2.0)


def since_change(state: Array, constant: float) -> Array:
    """Slow curve that jumps to 1 at each change of ``state`` and decays with a time constant (s)."""
    places = np.arange(len(state))
    last = np.maximum.accumulate(np.where(np.diff(state, prepend=state[0]) != 0, places, -10_000))
    return np.exp(-(places - last) / CONTROL_RATE / constant)
