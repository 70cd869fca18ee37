"""What telephones ring with: cadences, gongs and their clapper, piezo discs, small loudspeakers.

Times are in seconds, frequencies in hertz; all sounds are float64 at `SAMPLE_RATE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, iirpeak, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.room_tone import slow_curve
from generators.assets.sounds.signals import Array, add_at, period, strike, time_axis, upsampled

#: A mode of a struck body: frequency, time to fall by 60 dB, amplitude.
Mode = tuple[float, float, float]
#: Ringing cadences, seconds on and off in turn: United Kingdom, North America, Germany, France.
UNITED_KINGDOM = (0.4, 0.2, 0.4, 2.0)
NORTH_AMERICA = (2.0, 4.0)
GERMANY = (1.0, 4.0)
FRANCE = (1.5, 3.5)


def cadence(count: int, rng: Generator, pattern: Sequence[float], calls: tuple[int, int] = (4, 9)) -> Rings:
    """Bursts of ringing over ``count`` samples, from anywhere in the programme on.

    Args:
        count: samples.
        rng: the only source of randomness.
        pattern: seconds on and off in turn. The exchange's clock is off by up to 3 %, its relays by some milliseconds.
        calls: least and largest number of patterns until the caller gives up or somebody answers; then a pause.
    """
    pace = rng.uniform(0.97, 1.03)
    end = count / SAMPLE_RATE
    now = -rng.uniform(0.0, 0.85) * sum(pattern)
    bursts: list[tuple[float, float]] = []
    pauses: list[float] = []
    left = int(rng.integers(*calls, endpoint=True))
    while now < end:
        for step in range(0, len(pattern), 2):
            on, off = (pace * seconds + rng.normal(0.0, 0.006) for seconds in pattern[step : step + 2])
            bursts.append((now, now + on))
            now += on + off
        left -= 1
        if left == 0:
            pauses.append(now - 0.4 * pattern[-1])
            now += rng.uniform(0.2, 2.0)
            left = int(rng.integers(*calls, endpoint=True))
    return Rings(tuple(bursts), tuple(pauses))


@dataclass(frozen=True)
class Rings:
    """When a telephone rings: (start, end) of each burst, and when the handset is lifted or a caller gives up."""

    bursts: tuple[tuple[float, float], ...]
    ends: tuple[float, ...]


def shell_ratio(order: int) -> float:
    """Frequency of the ring mode with ``order`` nodal diameters re that with two: m(m² − 1)/√(m² + 1).

    Inextensional bending of rings and, within a few per cent, of hemispherical shells (Rayleigh, The Theory of Sound,
    vol. 1, chapter X A).
    """
    return float(order * (order**2 - 1) / np.sqrt(order**2 + 1) / (6 / np.sqrt(5)))


def gong(rng: Generator, lowest: float, decay: float, shallow: float) -> list[Mode]:
    """The modes of a shell that is held in its centre.

    Args:
        rng: the only source of randomness.
        lowest: frequency of the mode with two nodal diameters.
        decay: seconds for it to fall by 60 dB.
        shallow: exponent below 1 of the spacing: a membrane's stiffness of shallow shells draws the modes together.
    """
    radius_sound = 343.0 / (2 * np.pi * 0.028 * (1000.0 / lowest) ** 0.5)
    modes = []
    for order in range(2, 9):
        base = lowest * shell_ratio(order) ** shallow * rng.uniform(0.985, 1.015)
        if base > 14_500:
            break
        # A shell smaller than the wavelength radiates badly.
        radiated = (base / radius_sound) ** 2 / (1 + (base / radius_sound) ** 2)
        fall = decay * (base / lowest) ** -rng.uniform(0.3, 0.65)
        # No shell is quite round: each mode is a pair, and the pair beats.
        split = rng.uniform(0.0006, 0.006)
        level = radiated * np.exp(rng.normal(0.0, 0.35))
        modes += [(base * (1 - split), fall, level), (base * (1 + split), fall * rng.uniform(0.7, 1.0), 0.7 * level)]
    for _ in range(int(rng.integers(4, 8))):
        # Modes with a nodal circle, and those of the stud and the clapper's wire.
        base = lowest * rng.uniform(1.6, 9.0)
        if base < 14_500:
            modes.append((base, 0.4 * decay * rng.uniform(0.3, 1.0) * (lowest / base) ** 0.5, rng.uniform(0.08, 0.4)))
    return modes


def stroke(modes: Sequence[Mode], contact: float, seconds: float, rng: Generator) -> Array:
    """One blow of the clapper: a half-sine of force of ``contact`` seconds, on another place of the rim each time."""
    struck = []
    for frequency, fall, level in modes:
        turn = frequency * contact
        force = abs(np.cos(np.pi * turn) / (1 - 4 * turn**2)) if abs(turn - 0.5) > 0.02 else np.pi / 4
        struck.append((frequency, fall, level * force * np.exp(rng.normal(0.0, 0.3))))
    return strike(struck, seconds, rng, attack=0.6 * contact)


def click(rng: Generator, seconds: float, low: float, high: float) -> Array:
    """A burst of noise of unit energy that falls by 60 dB in ``seconds``."""
    t = time_axis(int(seconds * SAMPLE_RATE))
    sections = butter(2, [low, high], "bandpass", fs=SAMPLE_RATE, output="sos")
    burst = sosfilt(sections, rng.standard_normal(len(t))) * np.exp(-6.91 * t / seconds)
    return np.asarray(burst / np.sqrt(np.sum(np.square(burst)) + 1e-12))


def case_modes(rng: Generator, low: float, high: float, number: int = 7) -> list[Mode]:
    """The well damped modes of a housing, log-uniform between ``low`` and ``high``."""
    places = np.exp(rng.uniform(np.log(low), np.log(high), number))
    return [(float(f), float(rng.uniform(6.0, 16.0) / f + 0.004), float(rng.uniform(0.3, 1.0))) for f in places]


@dataclass(frozen=True)
class Ringer:
    """A polarised ringer: a clapper that the ringing current throws from one gong to the other.

    Attributes:
        gongs: sounds of strokes of each gong, some of each.
        current: frequency of the ringing current; each gong is struck once per period.
        bias: by how much of half a period the stroke on the second gong is early or late.
        unsteady: standard deviation of the times of strokes (seconds).
        missed: share of strokes that do not reach the gong.
    """

    gongs: tuple[tuple[Array, ...], ...]
    current: float
    bias: float
    unsteady: float
    missed: float


def blows(ringer: Ringer, burst: tuple[float, float], rng: Generator) -> tuple[Array, NDArray[np.int64], Array]:
    """Times, gongs (index) and strengths of the strokes of one burst; the clapper swings up and swings out."""
    start, stop = burst
    half = 0.5 / (ringer.current * (1 + rng.normal(0.0, 0.004)))
    number = max(2, int((stop - start) / half) + 1)
    index = np.arange(number + 2)
    which = (index + rng.integers(0, 2)) % len(ringer.gongs)
    times = (
        start
        + half * (index + 0.7 + np.where(index % 2, ringer.bias, 0.0))
        + rng.normal(0, ringer.unsteady, len(index))
    )
    strength = (1 - 0.8 * np.exp(-index / rng.uniform(0.7, 2.5))) * np.exp(rng.normal(0.0, 0.16, len(index)))
    strength[number:] *= rng.uniform(0.05, 0.35)
    heard = rng.uniform(size=len(index)) > ringer.missed
    return times[heard], which[heard], strength[heard]


def ring(count: int, rng: Generator, ringer: Ringer, rings: Rings) -> Array:
    """The bursts of a ringer over ``count`` samples; some blows bounce."""
    out = np.zeros(count)
    for burst in rings.bursts:
        loud = np.exp(rng.normal(0.0, 0.05))
        for moment, which, strength in zip(*blows(ringer, burst, rng), strict=True):
            kinds = ringer.gongs[int(which)]
            sound = kinds[int(rng.integers(0, len(kinds)))]
            add_at(out, round(moment * SAMPLE_RATE), loud * strength * sound)
            if rng.random() < 0.12:
                again = moment + rng.uniform(0.002, 0.006)
                add_at(out, round(again * SAMPLE_RATE), loud * strength * rng.uniform(0.08, 0.3) * sound)
    return out


def handset(rng: Generator) -> Array:
    """A handset is lifted or put down: a few knocks of plastic on its rest within a quarter of a second."""
    out = np.zeros(int(0.6 * SAMPLE_RATE))
    modes = case_modes(rng, 350.0, 3200.0, 9)
    for moment in np.sort(rng.uniform(0.0, 0.25, int(rng.integers(2, 5)))):
        knock = strike(modes, 0.15, rng) * rng.uniform(0.2, 1.0)
        add_at(out, int(moment * SAMPLE_RATE), knock)
        add_at(out, int(moment * SAMPLE_RATE), 0.5 * click(rng, 0.02, 900.0, 6000.0))
    return out


def resonator(signal: Array, peaks: Sequence[tuple[float, float, float]], direct: float) -> Array:
    """``direct`` times the signal plus resonances of (frequency, quality, gain)."""
    out = direct * signal
    # A resonator that is fed exact zeros ends in denormal numbers, which are slow.
    signal = signal + 1e-15
    for frequency, quality, gain in peaks:
        b, a = iirpeak(frequency, quality, fs=SAMPLE_RATE)
        out += lfilter(gain * b, a, signal)
    return out


def piezo(signal: Array, rng: Generator, lowest: tuple[float, float]) -> Array:
    """A piezo disc in its plastic cap, driven by a voltage: bending modes above the hole's Helmholtz resonance.

    A supported disc bends at 1 : 2.80 : 5.15 (modes 0,1; 1,1 and 2,1: Fletcher & Rossing, The Physics of Musical
    Instruments, 1998, section 3.6); the cap's resonance is put beside the first to widen the band.
    """
    first = rng.uniform(*lowest)
    peaks = [
        (first, rng.uniform(5, 12), 1.0),
        (first * rng.uniform(0.55, 0.8), rng.uniform(2.5, 5), rng.uniform(0.4, 0.8)),
        (first * rng.uniform(2.6, 3.0), rng.uniform(9, 20), rng.uniform(0.25, 0.6)),
        (min(first * rng.uniform(4.7, 5.4), 14_000.0), rng.uniform(10, 25), rng.uniform(0.1, 0.3)),
    ]
    wide = butter(1, [0.35 * first, 12_000.0], "bandpass", fs=SAMPLE_RATE, output="sos")
    return resonator(sosfilt(wide, signal + 1e-15), peaks, rng.uniform(0.08, 0.2))


def loudspeaker(signal: Array, rng: Generator, lowest: tuple[float, float], rub: tuple[float, float]) -> Array:
    """A small loudspeaker in plastic: its fundamental resonance, the cone's breaking up, overload, a rubbing coil.

    Args:
        signal: (n,) of about unit RMS while it sounds.
        rng: the only source of randomness.
        lowest: range of the fundamental resonance, below which the sound falls by 12 dB/octave.
        rub: range of the noise (RMS re the signal's envelope).
    """
    base = rng.uniform(*lowest)
    sections = butter(2, [base, rng.uniform(6000, 12_000)], "bandpass", fs=SAMPLE_RATE, output="sos")
    drive = rng.uniform(0.3, 1.3)
    moved = np.tanh(drive * sosfilt(sections, signal + 1e-15) + 0.12) / drive
    envelope = np.sqrt(np.maximum(lfilter([0.004], [1.0, -0.996], np.square(moved)), 0.0))
    moved = moved + rng.uniform(*rub) * envelope * rng.standard_normal(len(signal))
    peaks = [(base * rng.uniform(1.0, 1.3), rng.uniform(1.2, 3.0), rng.uniform(0.3, 0.9))]
    peaks += [(rng.uniform(2200, 7500), rng.uniform(3, 9), rng.uniform(0.2, 0.9)) for _ in range(4)]
    out = resonator(moved, peaks, 0.6)
    return np.asarray(sosfilt(butter(1, rng.uniform(30.0, 60.0), "highpass", fs=SAMPLE_RATE, output="sos"), out))


def gate(count: int, bursts: Sequence[tuple[float, float]], rise: float, fall: float) -> Array:
    """(count,) 1 within bursts and 0 between, with linear edges of ``rise`` and ``fall`` seconds."""
    times = [
        moment for a, b in bursts for moment in (a, a + rise, max(b, a + rise + 1e-4), max(b, a + rise + 1e-4) + fall)
    ]
    if not times:
        return np.zeros(count)
    return np.interp(time_axis(count), times, [0.0, 1.0, 1.0, 0.0] * len(bursts))


def unsteady(count: int, rng: Generator, slow: float, fast: float) -> Array:
    """(count,) factor near 1 of an oscillator's frequency: a slow drift and a quick one (standard deviations)."""
    return 1.0 + slow_curve(count, rng, 0.4, slow) + slow_curve(count, rng, 45.0, fast)


def turning(count: int, rng: Generator, frequency: float, slow: float, fast: float) -> Array:
    """(count,) phase (radians) of an oscillator whose frequency is `unsteady`, from a random start."""
    step = 441
    curve = unsteady((count // step + 2) * step, rng, slow, fast)[::step]
    cycles = np.cumsum(np.concatenate([[rng.uniform()], curve * (frequency * step / SAMPLE_RATE)]))
    return 2 * np.pi * upsampled(cycles, step, count)


def wave(phase: Array, amplitudes: Sequence[float] | Array, rng: Generator) -> Array:
    """Sum of harmonics as `signals.harmonics`, from a table without interpolation (error −80 dB): for long signals."""
    size = 1 << 15
    table = period(size, amplitudes, rng)
    return np.asarray(table[(phase * (size / (2 * np.pi))).astype(np.int64) & (size - 1)])
