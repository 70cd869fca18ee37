"""Fans and rotors: slow curves at a control rate, turbulent noise, tones of rotating parts, bodies that radiate.

Slow curves (speeds, envelopes) have one value per `HOP` samples; `expand` gives them a value per sample. Spectra are
in dB at `GRID`, as sums of `slopes`, `modes` and `ripple`; filters made of them have minimum phase. Signals are
float32, which halves the time of a voice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.signals import Array, drift, upsampled

#: Samples of a signal.
Signal = NDArray[np.float32]

#: Samples per value of a slow curve, and values per second.
HOP = 64
CONTROL_RATE = SAMPLE_RATE / HOP
#: Length of filters (samples), and the frequencies (Hz) of spectra.
_TAPS = 8192
GRID: Array = np.linspace(0.0, SAMPLE_RATE / 2, _TAPS + 1)
#: Points per turn of a rotor's table, and the highest frequency of a tone (Hz).
_TABLE = 1 << 16
_HIGHEST = 16_000.0
#: Up to this number, impacts are added one by one, which is faster than a convolution.
_FEW = 1500


def frames(count: int) -> int:
    """Number of values of a slow curve for ``count`` samples."""
    return count // HOP + 2


def expand(curve: Array, count: int) -> Signal:
    """(count,) samples of a slow curve, interpolated linearly."""
    return upsampled(curve.astype(np.float32), HOP, count)


def slow(count: int, rng: Generator, rate: float, depth: float) -> Array:
    """`signals.drift` as a slow curve; ``rate`` at most about 150 values per second."""
    return drift(frames(count), rng, rate * HOP, depth)


def turns_of(speed: Array, count: int, start: float = 0.0) -> Array:
    """(count,) angle in turns of a rotor whose speed (turns per second) is a slow curve."""
    turns = np.cumsum(expand(speed, count), dtype=np.float64)
    turns *= 1.0 / SAMPLE_RATE
    turns += start
    return np.asarray(turns)


def cosine(turns: Array) -> Signal:
    """(n,) cosine of an angle in turns."""
    return np.cos((np.mod(turns, 1.0) * (2 * np.pi)).astype(np.float32))


def spells(count: int, rng: Generator, gap: tuple[float, float], length: tuple[float, float], soft: float) -> Array:
    """Slow curve that is 1 during spells of random length (s), 0 in the random gaps (s) between them.

    The edges take about ``soft`` seconds. The curve begins anywhere in a gap or a spell.
    """
    end = count / SAMPLE_RATE
    times, levels = [], []
    now = -rng.uniform(0.0, gap[1] + length[1])
    while now < end:
        begin = now + rng.uniform(*gap)
        stop = begin + rng.uniform(*length)
        times += [begin - soft / 2, begin + soft / 2, stop - soft / 2, stop + soft / 2]
        levels += [0.0, 1.0, 1.0, 0.0]
        now = stop
    line = np.interp(np.arange(frames(count)) / CONTROL_RATE, np.maximum.accumulate(times), levels)
    return np.asarray(line * line * (3.0 - 2.0 * line))


def approach(count: int, segments: Sequence[tuple[float, float]], start: float, rise: float, fall: float) -> Array:
    """Slow curve of a speed that approaches the targets of (seconds, target) with time constants (s).

    A motor runs up with its torque over its inertia, and coasts down with the drag of its fan.
    """
    out = np.empty(frames(count))
    place, value, clock = 0, start, 0.0
    for seconds, target in [*segments, (1e9, segments[-1][1] if segments else start)]:
        clock += seconds
        stop = min(len(out), int(min(clock, 1e6) * CONTROL_RATE))
        if stop > place:
            t = np.arange(1, stop - place + 1) / CONTROL_RATE
            out[place:stop] = target + (value - target) * np.exp(-t / (rise if target > value else fall))
            place, value = stop, float(out[stop - 1])
    return out


def slopes(points: Sequence[tuple[float, float]]) -> Array:
    """Gains (dB) at `GRID`, linear in octaves between (frequency, dB); beyond the ends the last slope goes on."""
    octaves = np.log2(np.maximum(GRID, 10.0))
    at = np.log2([frequency for frequency, _ in points])
    levels = np.array([level for _, level in points])
    gains = np.interp(octaves, at, levels)
    first, last = (levels[1] - levels[0]) / (at[1] - at[0]), (levels[-1] - levels[-2]) / (at[-1] - at[-2])
    gains = np.where(octaves < at[0], levels[0] + first * (octaves - at[0]), gains)
    return np.asarray(np.where(octaves > at[-1], levels[-1] + last * (octaves - at[-1]), gains))


def modes(peaks: Sequence[tuple[float, float, float]]) -> Array:
    """Gains (dB) at `GRID` of resonances (frequency, quality, dB at the peak) beside an unfiltered path."""
    gain = np.ones(len(GRID), dtype=np.complex128)
    for frequency, quality, level in peaks:
        ratio = GRID / frequency
        gain += (10 ** (level / 20) - 1.0) * (1j * ratio / quality) / (1.0 - ratio**2 + 1j * ratio / quality)
    return np.asarray(20 * np.log10(np.abs(gain) + 1e-4))


def ripple(rng: Generator, depth: float, per_octave: float = 3.0) -> Array:
    """Random smooth gains (dB) at `GRID`, of standard deviation ``depth``: ducts, grilles and panels."""
    octaves = np.log2(np.maximum(GRID, 20.0) / 20.0)
    knots = np.arange(0.0, octaves[-1] + 2.0, 1.0 / per_octave)
    return np.asarray(np.interp(octaves, knots, rng.normal(0.0, depth, len(knots))))


def filter_of(gains_db: Array) -> Array:
    """(8192,) impulse response of minimum phase with those gains at `GRID` (homomorphic method).

    Model: A. V. Oppenheim and R. W. Schafer, "Discrete-Time Signal Processing", chapter on cepstrum analysis.
    """
    floor = float(gains_db.max()) - 90.0
    cepstrum = np.fft.irfft(np.maximum(gains_db, floor) * (np.log(10) / 20))
    cepstrum[1:_TAPS] *= 2.0
    cepstrum[_TAPS + 1 :] = 0.0
    response = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)))[:_TAPS]
    return np.asarray(response * np.hanning(2 * _TAPS)[_TAPS:])


def radiated(signal: NDArray[np.floating[Any]], gains_db: Array) -> Signal:
    """The signal through a body with those gains at `GRID`."""
    taps = filter_of(gains_db).astype(np.float32)
    return np.asarray(oaconvolve(signal.astype(np.float32), taps)[: len(signal)], dtype=np.float32)


def noise(count: int, rng: Generator, gains_db: Array) -> Signal:
    """Gaussian noise of unit RMS with that power spectrum (dB at `GRID`)."""
    taps = filter_of(gains_db)
    taps = (taps / np.sqrt(np.sum(np.square(taps)))).astype(np.float32)
    white = rng.standard_normal(count + _TAPS, dtype=np.float32)
    return np.asarray(oaconvolve(white, taps)[_TAPS : _TAPS + count], dtype=np.float32)


def turbulence(rng: Generator, peak: float, fall: float, rise: float = 4.0, rough: float = 1.5) -> Array:
    """Spectrum (dB at `GRID`) of the broadband noise of a fan: a wide hump at ``peak`` (Hz).

    Rises with ``rise`` and falls with ``fall`` dB per octave, steeper by a half above three octaves: the loading noise
    of blades in turbulent flow. Filters, linings and the air take 12 dB more at 16 kHz. Model: A. Guédel, "Fan
    Acoustics: Noise Generation and Control Methods", AMCA (2007), chapter 1: broadband spectra of centrifugal and axial
    fans are humps under the tones of the blades.
    """
    points = [
        (peak / 16, -4.0 * rise),
        (peak / 2, -0.8 * rise),
        (peak, 0.0),
        (2 * peak, -0.8 * fall),
        (8 * peak, -2.8 * fall),
        (32 * peak, -5.8 * fall),
    ]
    return slopes(points) + ripple(rng, rough) - 12.0 * np.square(GRID / 16_000.0)


def rotor(
    turns: Array, orders: Mapping[int, float], rng: Generator, top: float, wander: float = 0.25, rough: float = 0.12
) -> Signal:
    """Tones at multiples of a rotor's speed, with levels that nothing holds constant.

    Two patterns over a turn, with phases of their own, are mixed by slow curves, so each order's amplitude and phase
    moves by itself; a fast part of the curves widens the lines to narrow bands, as turbulent inflow does.

    Args:
        turns: (n,) angle in turns.
        orders: amplitude of each multiple of the speed.
        rng: the only source of randomness.
        top: highest speed (turns per second); orders above 16 kHz at this speed are left out.
        wander: depth of the slow curves (1 to 3 values per second).
        rough: depth of the fast ones (20 to 60 values per second).

    Returns:
        (n,) of about unit RMS, or silence if no order remains.
    """
    heard = {order: level for order, level in orders.items() if order * top < _HIGHEST}
    if not heard:
        return np.zeros(len(turns), dtype=np.float32)
    place = (turns * _TABLE).astype(np.int64) & (_TABLE - 1)
    scale = np.sqrt(2.0 / sum(level**2 for level in heard.values()))
    out = np.zeros(len(turns), dtype=np.float32)
    for mean in (1.0, 0.0):
        spectrum = np.zeros(_TABLE // 2 + 1, dtype=np.complex128)
        for order, level in heard.items():
            spectrum[order] = level * rng.uniform(0.6, 1.4) * np.exp(2j * np.pi * rng.random())
        table = (np.fft.irfft(spectrum) * (_TABLE / 2 * scale)).astype(np.float32)
        weight = mean + slow(len(turns), rng, rng.uniform(1.0, 3.0), wander)
        weight += slow(len(turns), rng, rng.uniform(20.0, 60.0), rough)
        out += table[place] * expand(weight, len(turns))
    return out


def blades(number: int, rng: Generator, uneven: float, harmonics: int = 4, fall: float = 0.5) -> dict[int, float]:
    """Orders of a fan: blade passing and its harmonics, and weaker orders beside them because no two blades agree.

    Args:
        number: of blades.
        rng: the only source of randomness.
        uneven: level of the other orders re the blade-passing tone.
        harmonics: how many multiples of the blade-passing frequency.
        fall: ratio of a harmonic to the one before it.
    """
    out = {order: uneven * rng.uniform(0.2, 1.0) * fall ** (order / number) for order in range(1, number * harmonics)}
    for k in range(1, harmonics + 1):
        out[k * number] = fall ** (k - 1) * rng.uniform(0.7, 1.3)
    return out


def moments(count: int, rng: Generator, rate: Array | float) -> NDArray[np.int64]:
    """Sample numbers of a Poisson process with a rate (per second) that may be a slow curve."""
    expected = np.broadcast_to(np.maximum(np.asarray(rate, dtype=np.float64), 0.0), frames(count)) / CONTROL_RATE
    found = np.repeat(np.arange(frames(count)) * HOP, rng.poisson(expected))
    found += rng.integers(0, HOP, len(found))
    return np.asarray(found[found < count], dtype=np.int64)


def impacts(
    count: int, rng: Generator, rate: Array | float, body: Array, spread: float = 1.0, decay: float = 0.06
) -> Signal:
    """Small impacts on a body: peak about 1, levels log-normal.

    Args:
        count: samples.
        rng: the only source of randomness.
        rate: impacts per second, may be a slow curve.
        body: gains (dB) at `GRID` of what is struck.
        spread: standard deviation of the logarithm of the force.
        decay: seconds to fall by 60 dB.
    """
    at = moments(count, rng, rate)
    if not len(at):
        return np.zeros(count, dtype=np.float32)
    return struck(count, rng, at, np.exp(rng.normal(-0.5, spread, len(at))), body, decay)


def struck(
    count: int, rng: Generator, at: NDArray[np.int64], force: Array, body: Array, decay: float, click: float = 0.4
) -> Signal:
    """Impacts at given samples: the ringing of ``body``, begun by a contact of about ``click`` milliseconds."""
    inside = (at >= 0) & (at < count)
    places = at[inside]
    forces = (force[inside] * rng.choice([-1.0, 1.0], len(places))).astype(np.float32)
    out = np.zeros(count, dtype=np.float32)
    if not len(places):
        return out
    length = min(_TAPS, int(decay * 2 * SAMPLE_RATE))
    ringing = noise(length, rng, body) * np.exp(-6.91 * np.arange(length) / (decay * SAMPLE_RATE))
    contact = np.hanning(max(3, int(click * SAMPLE_RATE / 1000)) + 2)
    ringing = np.convolve(ringing, contact / contact.sum())
    piece = (ringing / np.abs(ringing).max()).astype(np.float32)
    if len(places) > _FEW:
        np.add.at(out, places, forces)
        return np.asarray(oaconvolve(out, piece)[:count], dtype=np.float32)
    for place, strength in zip(places, forces, strict=True):
        stop = min(count, place + len(piece))
        out[place:stop] += strength * piece[: stop - place]
    return out


def passages(turns: Array, per_turn: float, rng: Generator) -> NDArray[np.int64]:
    """Samples (within 1.5 ms) at which a rotor passes each of ``per_turn`` evenly spaced marks."""
    marks = np.flatnonzero(np.diff(np.floor(turns[::HOP] * per_turn + rng.random())))
    return np.asarray(marks * HOP + rng.integers(0, HOP, len(marks)), dtype=np.int64)


def decibels(level: float) -> float:
    """The amplitude of a level in dB."""
    return float(10 ** (level / 20))
