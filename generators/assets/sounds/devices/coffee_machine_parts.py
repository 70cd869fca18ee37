"""Parts of coffee machines: housings, vibration pumps, motors, grinders, boiling water, steam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.signals import Array, add_at, band_noise, drift, harmonics, phase_of, strike, time_axis
from generators.assets.sounds.water import Spectrum, Take, gulps

#: Water that boils at a wall of metal: bubbles that collapse (S. Aljishi, J. Tatarkiewicz, Am. J. Phys. 59 (1991) 628).
BOILING: Spectrum = {63: -22, 125: -10, 250: -3, 500: -2, 1000: -4, 2000: -5, 4000: -5, 8000: -9, 16_000: -22}
#: Steam out of a hole of a few millimetres into air: a jet, its peak at about 0.2·speed/diameter (Lighthill 1952).
JET: Spectrum = {63: -50, 250: -34, 500: -25, 1000: -15, 2000: -7, 4000: -1, 8000: 0, 12_000: -5, 16_000: -14}
#: Steam that condenses in water or milk.
CONDENSING: Spectrum = {63: -10, 125: -4, 250: 0, 500: -1, 1000: -3, 2000: -7, 4000: -12, 8000: -18, 16_000: -30}
#: Steam and water that spit out of a tube.
SPITTING: Spectrum = {63: -26, 125: -15, 250: -6, 500: -2, 1000: 0, 2000: -2, 4000: -5, 8000: -9, 16_000: -22}
#: A flame, a fan or a transformer at rest, and the room.
STANDBY: Spectrum = {63: -8, 125: -4, 250: -2, 500: -2, 1000: -3, 2000: -5, 4000: -8, 8000: -13, 16_000: -26}


def first_start(rng: Generator, longest: float) -> float:
    """Moment (s) at which the first programme of a take began: half of them are under way, for ``longest`` at most."""
    return -rng.uniform(0.0, longest) if rng.random() < 0.5 else rng.uniform(0.2, 1.0)


def unrest(count: int, rng: Generator, rate: float, depth: float) -> Array:
    """`signals.drift` for rates far below 100 per second: every 64th sample, and straight lines between."""
    coarse = drift(count // 64 + 2, rng, 64.0 * rate, depth)
    return np.asarray(np.interp(np.arange(count) / 64.0, np.arange(len(coarse)), coarse))


class Housing:
    """The modes of a housing with what is mounted in it.

    Blows at one place excite the modes with the same phases and nearly the same levels, so that regular blows add up
    to lines; what varies is how hard and how squarely each of them lands.
    """

    def __init__(self, rng: Generator, low: float, high: float, modes: int, decay: float, slope: float = 0.4) -> None:
        self._rng = rng
        self._pitch = np.sort(np.exp(rng.uniform(np.log(low), np.log(high), modes)))
        self._fall = 6.91 / (decay * (low / self._pitch) ** 0.5 * rng.uniform(0.5, 1.5, modes))
        self._level = (low / self._pitch) ** slope * np.exp(rng.normal(0.0, 0.4, modes))
        self._phase = rng.uniform(0.0, 2 * np.pi, modes)

    def blow(self, seconds: float, hard: float = 0.3) -> Array:
        """One blow of about unit peak; ``hard`` is the peak of the contact noise."""
        rng = self._rng
        t = time_axis(int(seconds * SAMPLE_RATE))
        level = self._level * np.exp(rng.normal(0.0, 0.2, len(self._level)))
        phase = self._phase + rng.normal(0.0, 0.2, len(self._phase))
        waves = np.sin(2 * np.pi * self._pitch[:, None] * t + phase[:, None])
        out = level @ (waves * np.exp(-self._fall[:, None] * t)) * (1.0 - np.exp(-t / 3e-4))
        contact = rng.standard_normal(len(t)) * np.exp(-t / rng.uniform(4e-4, 2e-3))
        out = out / np.abs(out).max() + hard * contact / np.abs(contact).max()
        out *= np.minimum(1.0, 8.0 * (1.0 - t / seconds))
        return np.asarray(out / np.abs(out).max())


@dataclass(frozen=True)
class VibrationPump:
    """A solenoid pump: the half wave that a diode lets through pulls the plunger, a spring throws it back.

    Model: one stroke per mains cycle (ULKA EP5: 48 W at 230 V 50 Hz, 41 W at 120 V 60 Hz, with a diode in the coil).
    The force goes with the square of the current, so it has all harmonics of the mains frequency. Without back
    pressure the plunger strikes its stop; at 9 to 15 bar the stroke shortens, the blow is soft and the valves' blows
    and the force on the mounts remain. Strokes alternate a little (a weakly non-linear oscillator near half the
    frequency).

    Attributes:
        mains: Hz.
        housing: what is struck.
        hard: peak of the contact noise of a blow.
        hum: level of the coil's force.
        chatter: level of the water's noise.
        skip: every so many strokes one is left out (burst control); 0: none.
    """

    mains: float
    housing: Housing
    hard: float
    hum: float
    chatter: float
    skip: int = 0

    def runs(self, rng: Generator, length: float, pressure: Sequence[tuple[float, float]]) -> Array:
        """A run of ``length`` seconds; ``pressure`` is a curve of (s, share of the largest)."""
        count = int((length + 0.08) * SAMPLE_RATE)
        turns = 2 * np.pi * self.mains * (time_axis(count) + 0.0006 * unrest(count, rng, 3.0, 1.0))
        beats = np.arange(int(length * self.mains))
        moments = (beats + 0.3) / self.mains
        course = np.array(pressure).T
        load = np.interp(moments, *course)
        swing = np.interp(moments, time_axis(count), unrest(count, rng, 1.0, 0.15))
        odd = 1.0 + np.clip(0.12 + swing, 0.0, 0.4) * (-1.0) ** beats
        force = (1.0 - 0.72 * load) * odd * np.exp(rng.normal(0, 0.09, len(beats)))
        valve = (0.25 + 0.2 * load) * odd
        drawn = (beats % self.skip != 0) if self.skip else np.ones(len(beats), dtype=bool)
        force, valve = force * drawn, valve * drawn
        blows = [self.housing.blow(0.05, self.hard) for _ in range(10)]
        valves = [self.housing.blow(0.03, 1.2) for _ in range(10)]
        out = np.zeros(count)
        which = rng.integers(0, 10, (2, len(beats)))
        times = moments + rng.normal(0, 1.6e-4, len(beats)) - 0.0012 * load
        later = times + (0.36 + 0.05 * load) / self.mains + rng.normal(0, 2.5e-4, len(beats))
        for k in range(len(beats)):
            add_at(out, int(times[k] * SAMPLE_RATE), force[k] * blows[which[0, k]])
            add_at(out, int(later[k] * SAMPLE_RATE), valve[k] * valves[which[1, k]])
        # A core near saturation: pulses of force narrower than those of the current's square.
        pull = np.maximum(0.0, np.sin(turns)) ** 2
        pull *= np.append(drawn, False)[np.clip((turns // (2 * np.pi)).astype(np.int64), 0, len(beats))]
        coil = 2.0 * (pull + 0.6 * pull**4)
        coil -= coil.mean()
        rush = band_noise(count, rng, 900, 7000, 1) * (0.25 + pull)
        level = np.interp(time_axis(count), [0.0, 0.04, length - 0.03, length + 0.05], [0.0, 1.0, 1.0, 0.0])
        pressed = np.interp(time_axis(count), *course)
        flowing = self.hum * (0.7 + 0.5 * pressed) * coil + self.chatter * (1.0 - 0.4 * pressed) * rush
        return np.asarray(out + level * flowing)


def run_up(length: float, up: float, down: float, tail: float) -> Array:
    """Speed of a motor that starts with time constant ``up``, is switched off at ``length`` and coasts (``down``)."""
    t = time_axis(int((length + tail) * SAMPLE_RATE))
    top = 1.0 - np.exp(-length / up)
    # The coasting rotor is braked by friction as well: it stands still at the end.
    coast = np.exp(-np.maximum(t - length, 0.0) / down) * np.clip((length + tail - t) / (0.4 * tail), 0.0, 1.0)
    return np.asarray(np.where(t < length, 1.0 - np.exp(-t / up), top * coast))


def motor(rng: Generator, pitch: Array, orders: Sequence[float] | Array, rough: float) -> Array:
    """A motor's tones at multiples of ``pitch`` (n,) Hz, unsteady, over noise of brushes and bearings of RMS ``rough``.

    All levels go with the speed's power 1.5 relative to its largest.
    """
    count = len(pitch)
    top = float(pitch.max())
    shake = 1.0 + unrest(count, rng, 12.0, 0.003) + unrest(count, rng, 1.0, 0.006)
    phase = phase_of(pitch * shake, count, rng.uniform(0, 6.28))
    tones = harmonics(phase, orders, rng) * (1.0 + unrest(count, rng, 6.0, 0.15))
    noise = band_noise(count, rng, 700, 8000, 1) * (1.0 + 0.35 * np.sin(phase) + unrest(count, rng, 15.0, 0.15))
    return np.asarray((pitch / top) ** 1.5 * (tones + rough * noise))


def cracks(rng: Generator, rate: Array, low: float, high: float, decay: float) -> Array:
    """Beans that break: ``rate`` (n,) a second, each a burst of random modes; sizes are heavy-tailed as in fracture."""
    kinds = []
    for _ in range(24):
        modes = np.exp(rng.uniform(np.log(low), np.log(high), 5))
        levels = (low / modes) ** 0.35 * rng.uniform(0.2, 1.0, 5)
        table = [(float(f), decay * rng.uniform(0.3, 1.5), float(a)) for f, a in zip(modes, levels, strict=True)]
        piece = strike(table, 2.0 * decay + 0.004, rng, attack=1.5e-4)
        piece += 0.4 * rng.standard_normal(len(piece)) * np.exp(-time_axis(len(piece)) / (0.12 * decay))
        piece *= np.linspace(1.0, 0.0, len(piece)) ** 0.5
        kinds.append(piece / np.abs(piece).max())
    step = 441
    number = rng.poisson(np.maximum(rate[::step], 0.0) * step / SAMPLE_RATE)
    starts = np.repeat(np.arange(len(number)) * step, number) + rng.integers(0, step, int(number.sum()))
    gains = rng.choice([-1.0, 1.0], len(starts)) * np.minimum(0.12 * rng.pareto(1.8, len(starts)) + 0.05, 2.0)
    out = np.zeros(len(rate))
    for start, kind, gain in zip(starts, rng.integers(0, len(kinds), len(starts)), gains, strict=True):
        add_at(out, int(start), gain * kinds[kind])
    return out


def slugs(
    take: Take, name: str, span: tuple[float, float], rate: tuple[float, float], pitch: float, level: float
) -> None:
    """Steam lifts slugs of water up a tube and spits them out: events of the take, and corners of the curve ``name``.

    A bubble pump: the tube fills through a check valve, boils, and empties; ``rate`` (per second) goes from the first
    to the second value. Each slug gurgles at the tube's ``pitch`` and ends in a spurt.
    """
    rng = take.rng
    begin, end = span
    moment = begin
    while moment < end:
        share = (moment - begin) / max(end - begin, 0.1)
        pause = np.exp(rng.normal(0.0, 0.35)) / (rate[0] + (rate[1] - rate[0]) * share)
        force = float(np.exp(rng.normal(-0.2, 0.4)))
        number = int(rng.integers(1, 4))
        take.at(moment, 0.8 * level * force, gulps(rng, number, pitch * np.exp(rng.normal(0, 0.12)), 11.0, 0.7))
        spurt = min(rng.uniform(0.08, 0.3), 0.6 * pause)
        peak = level * force
        take.line.add(name, (moment, 0.12 * peak), (moment + 0.25 * spurt, peak), (moment + 0.6 * spurt, 0.5 * peak))
        take.line.add(name, (moment + spurt, 0.1 * peak))
        moment += pause
    take.line.add(name, (end, 0.0))


def drips(take: Take, name: str, begin: float, end: float, level: float, tail: float) -> None:
    """A stream into a vessel that thins out to drops over ``tail`` seconds: corners of the curve ``name``."""
    take.line.add(name, (begin, 0.0), (begin + 0.6, level), (end, level), (end + 0.3 * tail, 0.25 * level))
    take.line.add(name, (end + tail, 0.03 * level))
