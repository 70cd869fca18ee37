"""Parts of machines: bodies that ring, motors of four kinds, rolling bearings, pumps, moving loads.

Slow quantities (speeds, loads, envelopes) are computed at `CONTROL_RATE` and expanded to samples; impacts are impulses
into a body's modes. All levels are relative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import firwin2, lfilter, oaconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.signals import Array, add_at, upsampled

#: Samples per control value, and control values per second.
CONTROL_STEP = 100
CONTROL_RATE = SAMPLE_RATE / CONTROL_STEP
#: Length of the kernels that colour noise; resolution about 22 Hz.
_TAPS = 2047
#: Entries of a tabulated period (a power of two); read without interpolation, error about order/10,000.
_TABLE = 65_536


def control_count(count: int) -> int:
    """Number of control values for ``count`` samples."""
    return -(-count // CONTROL_STEP) + 1


def expand(curve: Array, count: int) -> Array:
    """(count,) samples of a control curve, linearly interpolated, of its type."""
    return upsampled(curve, CONTROL_STEP, count)


def wander(count: int, rng: Generator, rate: float, depth: float) -> Array:
    """A smooth random control curve, about ``rate`` independent values per second, mean 0, deviation ``depth``."""
    size = control_count(count)
    knots = max(6, int(np.ceil(size / CONTROL_RATE * rate)) + 4)
    spline = CubicSpline(np.arange(knots), rng.standard_normal(knots))
    return np.asarray(depth * spline(np.arange(size) / CONTROL_RATE * rate + 1.0))


def course(count: int, times: Sequence[float], levels: Sequence[float], soft: float = 0.1) -> Array:
    """A control curve through (time in s, level), its corners rounded over ``soft`` seconds."""
    size = control_count(count)
    width = max(1, int(soft * CONTROL_RATE))
    line = np.interp((np.arange(size + width) - width / 2) / CONTROL_RATE, times, levels)
    total = np.concatenate([[0.0], np.cumsum(line)])
    return np.asarray((total[width:] - total[:-width])[:size] / width)


def turned(speed: Array) -> Array:
    """Control curve of the turns made so far at a (control) speed in turns per second; direction does not matter."""
    return np.asarray(np.cumsum(np.abs(speed)) / CONTROL_RATE)


def passages(turns: Array, each: float) -> Array:
    """Times (s) at which a turning part passes one of ``each`` marks per turn."""
    return np.flatnonzero(np.diff(np.floor(turns * each)) > 0) / CONTROL_RATE


def read_at(curve: Array, times: Array) -> Array:
    """Values of a control curve at times (s); beyond its end, its last value."""
    return np.asarray(curve[np.minimum((times * CONTROL_RATE).astype(np.int64), len(curve) - 1)])


def switched(on: NDArray[np.bool_], *, rising: bool = False) -> Array:
    """Times (s) at which a condition along control curves begins or ends to hold; ``rising``: begins to."""
    steps = np.diff(on.astype(int))
    return np.flatnonzero(steps > 0 if rising else steps) / CONTROL_RATE


def bursts(count: int, times: ArrayLike, levels: ArrayLike, rise: float, fall: float) -> Array:
    """A control curve of events: each rises within ``rise`` and falls by 60 dB within ``fall`` seconds; peak ~level."""
    size = control_count(count)
    pulses = np.zeros(size)
    index = np.rint(np.asarray(times, dtype=np.float64) * CONTROL_RATE).astype(np.int64)
    kept = (index >= 0) & (index < size)
    np.add.at(pulses, index[kept], np.broadcast_to(np.asarray(levels, dtype=np.float64), index.shape)[kept])
    late, early = np.exp(-6.91 / (fall * CONTROL_RATE)), np.exp(-2.2 / max(1.0, rise * CONTROL_RATE))
    return np.asarray(lfilter([1 - early], [1.0, -early], lfilter([1.0], [1.0, -late], pulses)))


def coloured(count: int, rng: Generator, octaves: Mapping[float, float]) -> Array:
    """Gaussian noise of unit RMS with power densities (dB) at frequencies (Hz), interpolated over octaves."""
    knots = sorted(octaves)
    grid = np.concatenate([[0.0], np.geomspace(15.0, SAMPLE_RATE / 2, 160)])
    levels = np.interp(np.log2(np.maximum(grid, 1.0)), np.log2(knots), [octaves[k] for k in knots])
    gains = 10 ** (levels / 20)
    gains[0] = gains[-1] = 0.0
    kernel = firwin2(_TAPS, grid, gains, fs=SAMPLE_RATE)
    kernel /= np.sqrt(np.sum(np.square(kernel)))
    noise = rng.standard_normal(count + _TAPS - 1, dtype=np.float32)
    return np.asarray(oaconvolve(noise, kernel.astype(np.float32), mode="valid"))


def sloped(
    count: int, rng: Generator, low: float, high: float, slope: float, below: float = 9.0, beyond: float = -14.0
) -> Array:
    """Noise with a density that falls by ``slope`` dB/octave between ``low`` and ``high``, and faster outside."""
    reach = np.log2(high / low)
    ends = {low / 8: -3 * below, low: 0.0, high: slope * reach}
    top = max(22_000.0, 2 * high)
    return coloured(count, rng, ends | {top: slope * reach + beyond * np.log2(top / high)})


def sine(turns: Array, count: int, level: Array) -> Array:
    """(count,) float32 sine of control curves of turns and of amplitude."""
    phase = expand(turns, count)
    phase -= np.floor(phase)
    wave = np.sin(phase.astype(np.float32) * np.float32(2 * np.pi))
    wave *= expand(level.astype(np.float32), count)
    return np.asarray(wave)


def tones(turns: Array, count: int, levels: Mapping[int, float], rng: Generator, restless: float = 0.5) -> Array:
    """Tones at integer orders of a rotation whose amplitudes and phases wander.

    Args:
        turns: control curve of turns.
        count: samples.
        levels: order → amplitude.
        rng: randomness.
        restless: changes per second of the mixture of two sets of phases.

    Returns:
        (count,) float32.
    """
    angle = np.arange(_TABLE) * (2 * np.pi / _TABLE)
    tables = np.zeros((2, _TABLE))
    for order, level in levels.items():
        # Phases about a quarter apart, so the mixture of both never vanishes.
        phase = rng.uniform(0, 2 * np.pi)
        tables[0] += level * rng.uniform(0.6, 1.4) * np.sin(order * angle + phase)
        phase += rng.choice([-1, 1]) * np.pi / 2 + rng.uniform(-0.9, 0.9)
        tables[1] += level * rng.uniform(0.6, 1.4) * np.sin(order * angle + phase)
    tables = tables.astype(np.float32)
    index = expand(turns * _TABLE, count).astype(np.int64)
    index &= _TABLE - 1
    mixture = wander(count, rng, restless, 0.8) + rng.uniform(0, 2 * np.pi)
    out = expand(np.cos(mixture).astype(np.float32), count)
    out *= tables[0].take(index)
    other = expand(np.sin(mixture).astype(np.float32), count)
    other *= tables[1].take(index)
    out += other
    return out


@dataclass(frozen=True)
class VibratingBody:
    """A part that rings when struck: (modes,) frequencies (Hz), times to fall by 60 dB (s), gains, phases (rad)."""

    frequencies: Array
    decays: Array
    gains: Array
    phases: Array

    def waves(self) -> Array:
        """(modes, samples) decaying sines, until the longest has fallen by 36 dB."""
        t = np.arange(int(min(4.0, self.decays.max() * 0.6) * SAMPLE_RATE) + 64) / SAMPLE_RATE
        ring = np.exp(-6.91 * t / self.decays[:, None])
        ring *= np.sin(2 * np.pi * self.frequencies[:, None] * t + self.phases[:, None])
        return np.asarray(ring * (1.0 - np.exp(-t / 8e-5)))

    def joined(self, other: VibratingBody, gain: float = 1.0) -> VibratingBody:
        """Both as one body; the other's gains are multiplied by ``gain``."""
        pairs = zip(
            (self.frequencies, self.decays, self.gains, self.phases),
            (other.frequencies, other.decays, gain * other.gains, other.phases),
            strict=True,
        )
        return VibratingBody(*(np.concatenate(pair) for pair in pairs))


def plate(rng: Generator, low: float, high: float, number: int, loss: float, slope: float = 0.0) -> VibratingBody:
    """Modes of a thin-walled part: even density in Hz, as for bending waves of plates.

    Source: L. Cremer, M. Heckl, B. A. T. Petersson, Structure-Borne Sound, 3rd ed. (2005): modal density of plates, and
    decay time 2.2/(f·loss factor). Wood has a loss of about .01–.03, plastics .02–.06, assembled metal .003–.02.

    Args:
        rng: randomness: each unit has its own modes.
        low: least frequency of the modes (Hz).
        high: largest frequency of the modes (Hz).
        number: of modes.
        loss: loss factor.
        slope: of the gains (dB per octave).
    """
    frequencies = low + (high - low) * (np.arange(number) + rng.uniform(0, 1, number)) / number
    losses = loss * np.exp(rng.normal(0, 0.35, number))
    decays = np.clip(2.2 / (frequencies * losses), 0.003, 1.6)
    gains = 10 ** ((slope * np.log2(frequencies / low) + rng.normal(0, 4.0, number)) / 20)
    return VibratingBody(frequencies, decays, gains, rng.uniform(-0.6, 0.6, number))


def bar_or_bell(rng: Generator, base: float, ratios: ArrayLike, decay: float, fall: float = 1.0) -> VibratingBody:
    """A tuned part: partials at ``ratios`` of ``base``, decays ``decay``·ratio^−fall, each with a twin (beats)."""
    partials = np.asarray(ratios, dtype=np.float64)
    exact = base * partials * np.exp(rng.normal(0, 0.006, len(partials)))
    frequencies = np.concatenate([exact, exact * (1 + rng.uniform(0.0006, 0.004, len(partials)))])
    decays = np.tile(decay * np.asarray(ratios) ** -fall, 2) * np.exp(rng.normal(0, 0.15, 2 * len(partials)))
    gains = np.exp(rng.normal(0, 0.4, 2 * len(partials))) * np.repeat([1.0, 0.5], len(partials))
    kept = frequencies < 15_000
    return VibratingBody(frequencies[kept], decays[kept], gains[kept], rng.uniform(-0.6, 0.6, int(kept.sum())))


def struck(
    count: int,
    rng: Generator,
    body: VibratingBody,
    times: ArrayLike,
    forces: ArrayLike,
    contact: float,
    spread: float = 0.25,
) -> Array:
    """A body struck at times (s) with forces by contacts that last ``contact`` seconds.

    A harder stroke has a shorter contact (∝ force^−1/5), so it is brighter: Hertz's law for spheres, W. Goldsmith,
    Impact (1960). No two strokes are the same: the point of contact, and so each mode's share, varies by ``spread``.
    """
    out = np.zeros(count)
    waves = body.waves()
    moments, strengths = np.asarray(times, dtype=np.float64), np.broadcast_to(forces, np.shape(times))
    moments, strengths = moments[strengths > 0], strengths[strengths > 0]
    usual = float(np.median(strengths)) if len(moments) else 1.0
    for moment, force in zip(moments, strengths, strict=True):
        lasting = contact * (force / usual) ** -0.2 * np.exp(rng.normal(0, 0.08))
        shares = body.gains * np.exp(rng.normal(0, spread, len(body.gains)))
        shares /= 1.0 + (2 * body.frequencies * lasting) ** 2
        add_at(out, round(moment * SAMPLE_RATE), np.einsum("m,mn->n", force * shares, waves))
    return out


def drummed(
    count: int,
    rng: Generator,
    body: VibratingBody,
    times: ArrayLike,
    forces: ArrayLike,
    contact: float,
    spread: float = 0.25,
) -> Array:
    """Like `struck`, for thousands of blows: each is one of three points of contact, of a fixed duration."""
    index = np.rint(np.asarray(times, dtype=np.float64) * SAMPLE_RATE).astype(np.int64)
    strengths = np.broadcast_to(np.asarray(forces, dtype=np.float64), index.shape)
    kept = (index >= 0) & (index < count) & (strengths > 0)
    index, strengths = index[kept], strengths[kept]
    points = rng.integers(0, 3, len(index))
    waves = body.waves().astype(np.float32)
    out = np.zeros(count, dtype=np.float32)
    for point in range(3):
        shares = body.gains * np.exp(rng.normal(0, spread, len(body.gains)))
        shares /= 1.0 + (2 * body.frequencies * contact) ** 2
        train = np.zeros(count, dtype=np.float32)
        np.add.at(train, index[points == point], strengths[points == point].astype(np.float32))
        out += oaconvolve(train, np.einsum("m,mn->n", shares.astype(np.float32), waves))[:count]
    return np.asarray(out)


def driven(signal: Array, body: VibratingBody) -> Array:
    """A body driven by a force signal (its modes' response at unit energy)."""
    response = np.einsum("m,mn->n", body.gains, body.waves())
    response /= np.sqrt(np.sum(np.square(response)))
    return np.asarray(oaconvolve(signal.astype(np.float32), response.astype(np.float32))[: len(signal)])


def mains_turns(count: int, rng: Generator, mains: float) -> Array:
    """Control curve of mains periods; grids wander by some hundredths of a hertz."""
    return turned(mains + rng.normal(0, 0.02) + wander(count, rng, 0.1, 0.015))


def induction_motor(
    count: int, rng: Generator, mains: float, slots: int, pairs: int, load: Array | None = None
) -> Array:
    """An induction motor: hum at twice the mains frequency with overtones, and slot harmonics that depend on the slip.

    Source: P. L. Timár (ed.), Noise and Vibration of Electrical Machines (1989): rotor-slot forces at
    f·(slots·(1 − slip)/pairs + 0, ± 2).

    Args:
        count: samples.
        rng: randomness.
        mains: frequency (Hz).
        slots: of the rotor.
        pairs: of poles.
        load: control curve about 1; the slip is 2–6 % times it.
    """
    pulse = mains_turns(count, rng, mains)
    out = tones(pulse, count, {1: 0.05, 2: 1.0, 3: 0.03, 4: 0.4, 6: 0.22, 8: 0.13, 10: 0.07, 12: 0.05}, rng, 0.3)
    slip = rng.uniform(0.02, 0.06) * (1.0 + wander(count, rng, 1.5, 0.1)) * (1.0 if load is None else load)
    passing = slots * turned(mains / pairs * (1.0 - slip))
    for shift, level in ((-2, 0.12), (0, 0.2), (2, 0.16)):
        out += sine(
            passing + shift * pulse, count, level * rng.uniform(0.4, 1.6) * np.exp(wander(count, rng, 1.0, 0.3))
        )
    return out


def permanent_magnet_motor(
    count: int, rng: Generator, speed: Array, top: float, pairs: int, teeth: int, carrier: float | None = None
) -> Array:
    """An inverter-fed synchronous motor: radial forces at even electrical orders, torque ripple at the sixth, cogging.

    Source: J. F. Gieras, C. Wang, J. C. Lai, Noise of Polyphase Electric Motors (2006): magnetic forces at twice the
    electrical frequency and its multiples, six-fold ripple of the inverter, cogging at lcm(slots, poles) per turn,
    carrier with side bands at even electrical orders.

    Args:
        count: samples.
        rng: randomness.
        speed: control curve (turns per second).
        top: its largest value, where the level is 1.
        pairs: of poles.
        teeth: slots of the stator.
        carrier: frequency (Hz) of the pulse width modulation, where it can be heard.
    """
    electrical = pairs * turned(speed * (1.0 + wander(count, rng, 6.0, 0.002)))
    ripple = np.lcm(teeth, 2 * pairs) / pairs
    levels = {2: 1.0, 4: 0.25, 6: 0.8, 8: 0.1, 12: 0.35, 18: 0.1, 24: 0.06}
    levels[round(ripple)] = levels.get(round(ripple), 0.0) + 0.3
    power = np.abs(speed) / top
    out = tones(electrical, count, levels, rng) * expand(np.sqrt(power), count)
    if carrier is not None:
        base = turned(carrier + wander(count, rng, 8.0, 3.0))
        for side in (-2, 2):
            out += sine(base + side * electrical, count, 0.05 * np.minimum(1.0, 8 * power))
    return out


def universal_motor(count: int, rng: Generator, speed: Array, top: float, bars: int, mains: float) -> Array:
    """A phase-controlled commutator motor: shaft orders, bar passing, brush noise, torque at twice the mains frequency.

    Model: brushes strike each of ``bars`` commutator bars; the brush force and so the noise fluctuates with the shaft
    (eccentricity) and with the torque, which pulses at twice the mains frequency in single-phase series motors.

    Args:
        count: samples.
        rng: randomness.
        speed: control curve (turns per second) of the motor.
        top: its largest value, where the level is 1.
        bars: of the commutator.
        mains: frequency (Hz).
    """
    turns = turned(speed * (1.0 + wander(count, rng, 5.0, 0.004)))
    fast = np.sqrt(np.abs(speed) / top)
    shaft = tones(turns, count, {1: 1.0, 2: 0.5, 3: 0.2, 4: 0.25, 6: 0.1, bars: 0.3, 2 * bars: 0.1}, rng)
    pulse = tones(mains_turns(count, rng, mains), count, {2: 1.0, 4: 0.5, 6: 0.3, 8: 0.2}, rng)
    brushes = sloped(count, rng, 1200, 6000, -3.0)
    swing = 1.0 + 0.35 * tones(turns, count, {1: 0.7, 2: 0.5}, rng) + 0.2 * pulse
    return np.asarray((shaft + 0.35 * pulse + 0.4 * brushes * swing) * expand(fast, count))


def rolling(count: int, rng: Generator, speed: Array, top: float, noise: Array) -> Array:
    """Noise of bearings, belts and air round a turning part: level ∝ √speed, modulated once and twice per turn.

    Measured levels rise faster (washing about 55, spinning 75 dB(A)); whoever records or listens follows with the gain,
    and no second of a source may be silent, so all machines here have half the range in decibels.
    """
    turns = turned(speed)
    swing = (
        1.0 + 0.1 * np.sin(2 * np.pi * turns + wander(count, rng, 0.5, 0.5)) + 0.05 * np.sin(4 * np.pi * turns + 1.0)
    )
    swing = swing * np.exp(wander(count, rng, 2.0, 0.05))
    return np.asarray(noise * expand(np.sqrt(np.abs(speed) / top) * swing, count))


def bearing_defect(count: int, rng: Generator, speed: Array, top: float, balls: int, body: VibratingBody) -> Array:
    """Impacts of balls on a pit in the outer ring, at .4·balls per turn with slip, heavier in the loaded half-turn.

    Source: P. D. McFadden, J. D. Smith, Model for the vibration produced by a single point defect in a rolling element
    bearing, Journal of Sound and Vibration 96 (1984) 69–82; slip of some per cent makes the period irregular. The level
    is ∝ √(speed/top).
    """
    turns = turned(speed)
    size = int(turns[-1] * 0.4 * balls) + 1
    marks = np.cumsum(1.0 + rng.normal(0, 0.02, size)) / (0.4 * balls)
    marks = marks[marks < turns[-1]]
    times = np.interp(marks, turns, np.arange(len(turns)) / CONTROL_RATE)
    index = np.minimum((times * SAMPLE_RATE).astype(np.int64), count - 1)
    fast = np.interp(times, np.arange(len(speed)) / CONTROL_RATE, np.abs(speed))
    force = np.sqrt(fast / top) * (1.0 + 0.6 * np.cos(2 * np.pi * marks))
    force *= np.exp(rng.normal(0, 0.3, len(marks)))
    train = np.zeros(count)
    np.add.at(train, index, force)
    return driven(train, body)


def synchronous_pump(count: int, rng: Generator, mains: float, body: VibratingBody, air: Array) -> Array:
    """A drain pump with a two-pole permanent-magnet rotor: it swings at mains frequency, its coupling rattles.

    Model: torque and radial force at twice the mains frequency; the impeller's dog hits its stop once or twice per
    turn, at irregular strength, the more so with air in the pump. Source: H. Schemmann, Theoretische und experimentelle
    Untersuchungen über das dynamische Verhalten eines Einphasen-Synchronmotors mit dauermagnetischem Läufer (Eindhoven
    1971): the rotor's speed fluctuates at twice the supply frequency.

    Args:
        count: samples.
        rng: randomness.
        mains: frequency (Hz).
        body: the pump's housing and sump.
        air: control curve 0–1, share of air in the water.
    """
    turns = mains_turns(count, rng, mains)
    hum = tones(turns, count, {1: 0.5, 2: 1.0, 3: 0.25, 4: 0.5, 5: 0.12, 6: 0.3, 8: 0.15, 10: 0.08}, rng, 0.8)
    marks = np.arange(0.0, turns[-1], 0.5)
    times = np.interp(marks + rng.normal(0, 0.03, len(marks)), turns, np.arange(len(turns)) / CONTROL_RATE)
    index = np.clip((times * SAMPLE_RATE).astype(np.int64), 0, count - 1)
    force = np.where(np.arange(len(marks)) % 2 == 0, 1.0, rng.uniform(0.3, 0.8)) * np.exp(
        rng.normal(0, 0.35, len(marks))
    )
    force *= 0.5 + read_at(air, times)
    train = np.zeros(count)
    np.add.at(train, index, force)
    flow = sloped(count, rng, 250, 6000, -4.5, beyond=-9.0)
    return 0.35 * hum + 1.6 * driven(train, body) + 0.45 * flow * expand(0.6 + air, count)


def unbalance(speed: Array, resonance: float, damping: float) -> Array:
    """Control curve of a suspended tub's swing over its unbalance.

    Model: r²/√((1 − r²)² + (2·damping·r)²) with r = speed/resonance.
    Source: D. C. Conrad, W. Soedel, On the problem of oscillatory walk of automatic washing machines, Journal of Sound
    and Vibration 188 (1995) 301–314; textbook response of a rotating unbalance.
    """
    ratio = np.square(np.abs(speed) / resonance)
    return np.asarray(ratio / np.sqrt((1 - ratio) ** 2 + (2 * damping) ** 2 * ratio))
