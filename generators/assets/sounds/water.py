"""Water and what carries it: turbulent flows, clouds of bubbles, gulps, whistling valves, knocks of pipes and lids.

A flow is Gaussian noise whose power per band and moment is given: overlapping frames of white noise are weighted in
the frequency domain and added up. Independent sources add in power, so any number of them costs one synthesis. Clouds
of many small bubbles are such noise as well (the limit of a dense Poisson process); single audible bubbles are not and
are added one by one (`bubble_cloud`).

Levels of a source are RMS amplitudes; spectra are given in dB per octave band.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.signal import lfilter, oaconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.signals import Array, add_at, bubble, drift, phase_of, strike, time_axis

#: Length and spacing of the frames (samples): levels change within 12 ms, bins are 43 Hz wide.
FRAME, HOP = 1024, 512
#: Centres of the bands (Hz) in which powers are given; about six an octave.
BANDS = np.geomspace(31.5, 20_000.0, 56)
#: Frames that are synthesised at once, for memory.
_CHUNK = 4096
#: Spectrum of an event or of a source: octave centre (Hz) → level (dB per octave).
Spectrum = Mapping[float, float]


def _to_bins() -> NDArray[np.float32]:
    """(bands, bins) weights that interpolate powers over the logarithm of frequency."""
    bins = np.maximum(np.fft.rfftfreq(FRAME, 1 / SAMPLE_RATE), BANDS[0])
    place = np.interp(np.log(bins), np.log(BANDS), np.arange(len(BANDS)))
    weights = np.maximum(0.0, 1.0 - np.abs(np.arange(len(BANDS))[:, None] - place[None, :]))
    # A window of a frame has no use for a constant.
    weights[:, 0] = 0.0
    weights[:, bins > BANDS[-1]] = 0.0
    return np.asarray(weights, dtype=np.float32)


_WEIGHTS = _to_bins()


def frame_times(count: int) -> Array:
    """(frames,) moments (s) at which the levels of flows are given."""
    return np.arange(-(-count // HOP) + 1, dtype=np.float64) * (HOP / SAMPLE_RATE)


def frame_drift(frames: int, rng: Generator, rate: float, depth: float) -> Array:
    """(frames,) `signals.drift` at the moments of `frame_times`."""
    return drift(frames, rng, rate * HOP, depth)


def slow_phase(count: int, frequency: Array) -> Array:
    """(count,) phase (radians) of an oscillator whose frequency (frames,) changes little within a frame."""
    turns = np.concatenate([[0.0], np.cumsum(frequency[1:])]) * (HOP / SAMPLE_RATE)
    return np.asarray(2 * np.pi * np.interp(np.arange(count), np.arange(len(turns)) * HOP, turns))


class Timeline:
    """Levels of named sources over the frames, as piecewise linear curves whose corners accumulate."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.seconds = count / SAMPLE_RATE
        self.times = frame_times(count)
        self._points: dict[str, list[tuple[float, float]]] = {}

    def add(self, name: str, *points: tuple[float, float]) -> None:
        """Append corners (seconds, level) to a curve, in the order of time."""
        self._points.setdefault(name, []).extend(points)

    def level(self, name: str, otherwise: float = 0.0) -> Array:
        """(frames,) the curve; ``otherwise`` where it has no corner at all."""
        points = self._points.get(name)
        if not points:
            return np.full(len(self.times), otherwise)
        moments, levels = np.array(points).T
        return np.asarray(np.interp(self.times, np.maximum.accumulate(moments), levels))


def spectrum(octaves: Spectrum, rng: Generator, tilt: float = 1.0, wiggle: float = 2.0, peaks: int = 2) -> Array:
    """(bands,) dB per octave of one unit: the table, tilted (dB per octave, SD), waved (dB, SD), with resonances."""
    place = np.log2(BANDS / 1000.0)
    out = np.interp(place, np.log2(np.array(list(octaves)) / 1000.0), list(octaves.values()))
    out = out + rng.normal(0.0, tilt) * np.clip(place, -4.0, 3.5)
    knots = np.arange(-5.0, 5.0)
    out += np.interp(place, knots, rng.normal(0.0, wiggle, len(knots)))
    for _ in range(peaks):
        centre = np.log2(rng.uniform(0.2, 2.5)) + rng.normal(0.0, 0.4)
        out += rng.uniform(2.0, 6.0) * np.exp(-np.square((place - centre) / rng.uniform(0.15, 0.35)))
    return np.asarray(out)


def source(shape: Array, level: Array, rng: Generator, unrest: float = 2.0, pace: float = 9.0) -> Array:
    """(frames, bands) power density of a source of that spectrum (dB per octave) and RMS level.

    Turbulence makes every band fluctuate by itself: by ``unrest`` dB (SD), ``pace`` times a second.
    """
    density = 10 ** (shape / 10) / BANDS
    density /= float((density @ _WEIGHTS).mean())
    power = np.square(level)[:, None] * density
    if unrest > 0:
        power *= 10 ** (_field(len(level), rng, unrest, pace) / 10)
    return np.asarray(power)


def _field(frames: int, rng: Generator, depth: float, pace: float) -> Array:
    """(frames, bands) random curves of that SD, smooth in time and over neighbouring bands."""
    keep = float(np.exp(-pace * HOP / SAMPLE_RATE))
    noise = rng.standard_normal((frames + 40, len(BANDS) + 4))
    spread = (0.3, 0.75, 1.0, 0.75, 0.3)
    near = np.sum([w * noise[:, k : k + len(BANDS)] for k, w in enumerate(spread)], axis=0) / 1.52
    smooth = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], near, axis=0)[40:]
    # What all bands share: lumps of water, and the slow wandering of the flow.
    lumps = 0.8 * frame_drift(frames, rng, 0.8 * pace, 1.0) + 0.5 * frame_drift(frames, rng, 0.7, 1.0)
    return np.asarray(2.0 * depth * np.tanh(0.5 * (smooth + lumps[:, None])))


def moving_peak(frequency: Array, quality: float, gain_db: float) -> Array:
    """(frames, bands) factor on power of a resonance whose frequency (frames,) moves."""
    ratio = BANDS[None, :] / np.maximum(frequency, 20.0)[:, None]
    return np.asarray(1.0 + 10 ** (gain_db / 10) / (1.0 + np.square(quality * (ratio - 1 / ratio))))


def flow(count: int, rng: Generator, power: Array) -> Array:
    """(count,) noise of that power density (frames, bands)."""
    window = np.sin(np.pi * (np.arange(FRAME, dtype=np.float32) + 0.5) / FRAME)
    out = np.zeros((len(power) + 1, HOP))
    for begin in range(0, len(power), _CHUNK):
        part = power[begin : begin + _CHUNK].astype(np.float32)
        noise = rng.standard_normal((len(part) + 1) * HOP, dtype=np.float32)
        bins = rfft(sliding_window_view(noise, FRAME)[::HOP] * window, axis=1)
        bins *= np.sqrt(part @ _WEIGHTS)
        pieces = irfft(bins, FRAME, axis=1) * window
        out[begin : begin + len(part)] += pieces[:, :HOP]
        out[begin + 1 : begin + len(part) + 1] += pieces[:, HOP:]
    return np.asarray(out.ravel()[HOP : HOP + count])


def bubble_cloud(
    count: int, rng: Generator, rate: Array, radii_mm: tuple[float, float], slope: float = -1.5, rise: float = 0.06
) -> Array:
    """Single bubbles: ``rate`` (frames,) per second, radii with density r^slope, of about unit peak.

    Sizes: G. B. Deane, M. D. Stokes, Nature 418 (2002) 839–844 (slope −3/2 below a millimetre, −10/3 above); the
    sound of one: `signals.bubble`. The initial amplitude grows with the radius, and differs from bubble to bubble by
    the depth and by how it was pinched off.
    """
    out = np.zeros(count)
    radii = np.geomspace(*radii_mm, 40) * np.exp(rng.normal(0, 0.02, 40))
    odds = radii ** (slope + 1.0)
    kinds = []
    for radius in radii:
        metres = radius * 1e-3
        fall = 0.13 / metres + 0.0072 * metres**-1.5
        size = (radius / radii_mm[1]) ** 0.5
        kinds.append(size * bubble(radius, rng.uniform(0.3, 1.7) * rise, min(0.2, 6.0 / fall)))
    number = rng.poisson(np.maximum(rate, 0.0) * (HOP / SAMPLE_RATE))
    starts = np.repeat(np.arange(len(rate)) * HOP, number) + rng.integers(0, HOP, int(number.sum()))
    choice = rng.choice(len(kinds), len(starts), p=odds / odds.sum())
    gains = rng.choice([-1.0, 1.0], len(starts)) * rng.uniform(0.1, 1.0, len(starts)) ** 2
    for start, kind, gain in zip(starts, choice, gains, strict=True):
        add_at(out, int(start), gain * kinds[kind])
    return out


def splashes(count: int, rng: Generator, rate: Array, slow: float = 12.0) -> Array:
    """Impacts of lumps of water: ``rate`` (frames,) a second, bursts of 1 to ``slow`` ms, of about unit peak.

    Most are small: levels are log-normal (impact and entrained bubble of drops: G. J. Franz, J. Acoust. Soc. Am. 31
    (1959) 1080–1096).
    """
    kinds = []
    for _ in range(40):
        t = time_axis(int(0.06 * SAMPLE_RATE))
        fall = 1e3 / np.exp(rng.uniform(0.0, np.log(slow)))
        dull = rng.uniform(0.3, 0.93)
        burst = lfilter([1.0, -0.6], [1.0, -dull], rng.standard_normal(len(t))) * np.exp(-fall * t)
        burst *= np.minimum(1.0, t * rng.uniform(500.0, 3000.0)) * np.minimum(1.0, 200.0 * (t[-1] - t))
        kinds.append(burst / np.abs(burst).max())
    out = np.zeros(count)
    number = rng.poisson(np.maximum(rate, 0.0) * (HOP / SAMPLE_RATE))
    starts = np.repeat(np.arange(len(rate)) * HOP, number) + rng.integers(0, HOP, int(number.sum()))
    gains = rng.choice([-1.0, 1.0], len(starts)) * np.minimum(np.exp(rng.normal(-1.3, 1.0, len(starts))), 2.0)
    for start, kind, gain in zip(starts, rng.integers(0, len(kinds), len(starts)), gains, strict=True):
        add_at(out, int(start), gain * kinds[kind])
    return out


def cavity(signal: Array, rng: Generator, low: float, high: float, modes: int, gain: float) -> Array:
    """The signal in a hollow body (pan, cistern, housing): modes of quality 10 to 40, of about that peak gain."""
    t = time_axis(int(0.2 * SAMPLE_RATE))
    ringing = np.zeros(len(t))
    for pitch in np.exp(rng.uniform(np.log(low), np.log(high), modes)):
        fall = np.pi * pitch / rng.uniform(10.0, 40.0)
        peak = gain * rng.uniform(0.3, 1.4) * (low / pitch) ** 0.3 * 2.0 * fall / SAMPLE_RATE
        ringing += peak * np.exp(-fall * t) * np.sin(2 * np.pi * pitch * t + rng.uniform(0, 2 * np.pi))
    ringing *= np.minimum(1.0, 100.0 * (t[-1] - t))
    ringing[0] += 1.0
    return np.asarray(oaconvolve(signal, ringing)[: len(signal)])


def gulps(rng: Generator, number: int, pitch: float, rate: float, noisy: float = 0.5) -> Array:
    """Air that enters a draining trap in slugs, of about unit peak.

    Each slug is a Helmholtz resonance of the air behind the throat, excited as the water closes again; its pitch rises
    as the slug shrinks, and the slugs come slower and weaker as the head is spent. Model: C. Clanet, G. Searby,
    J. Fluid Mech. 510 (2004) 145–168 (glug-glug of a bottle).
    """
    gaps = np.exp(rng.normal(0.0, 0.22, number)) / (rate * np.linspace(1.15, 0.7, number))
    out = np.zeros(int((gaps.sum() + 0.6) * SAMPLE_RATE))
    moment = 0.0
    for k, gap in enumerate(gaps):
        fall = rng.uniform(14.0, 30.0)
        t = time_axis(int(4.6 / fall * SAMPLE_RATE))
        own = pitch * np.exp(rng.normal(0.0, 0.16)) * (1.0 + 0.25 * k / number)
        swell = (1.0 - np.exp(-t / rng.uniform(0.008, 0.025))) * (np.exp(-fall * t) - 0.01)
        phase = phase_of(own * (1.0 + rng.uniform(0.2, 0.9) * np.minimum(1.0, 4.0 * t)), len(t))
        tone = np.sin(phase) + 0.35 * np.sin(2.02 * phase + 1.0) + 0.15 * np.sin(3.05 * phase)
        noise = lfilter([0.25], [1.0, -0.75], rng.standard_normal(len(t)))
        level = rng.uniform(0.45, 1.0) * (1.0 - 0.5 * k / number)
        add_at(out, int(moment * SAMPLE_RATE), level * swell * (0.75 * tone + noisy * noise))
        moment += gap
    return out


def knock(rng: Generator, low: float, high: float, decay: float, modes: int = 7, click: float = 0.4) -> Array:
    """A struck lid, lever or housing of unit peak: random modes between ``low`` and ``high`` Hz, and its contact.

    The lowest mode falls by 60 dB in ``decay`` seconds, higher ones faster; ``click`` is the peak of the contact noise.
    """
    pitches = np.exp(rng.uniform(np.log(low), np.log(high), modes))
    table = [
        (f, decay * (low / f) ** 0.6 * rng.uniform(0.6, 1.4), rng.uniform(0.3, 1.0) * (low / f) ** 0.4) for f in pitches
    ]
    out = strike(table, 1.3 * decay + 0.02, rng, attack=rng.uniform(2e-4, 1.2e-3))
    t = time_axis(len(out))
    contact = lfilter([1.0, 0.6], [1.0, -0.4], rng.standard_normal(len(out))) * np.exp(-t / rng.uniform(0.0012, 0.004))
    out = out / np.abs(out).max() + click * contact / np.abs(contact).max()
    fade = np.minimum(1.0, (len(out) - np.arange(len(out))) / (0.2 * len(out)))
    return np.asarray(out * fade / np.abs(out).max())


def hammer(rng: Generator, length: float, decay: float) -> Array:
    """Water hammer of unit peak: a closed valve makes the column in ``length`` metres of pipe ring and the pipe knock.

    The pressure oscillates at c/4L with c ≈ 1,250 m/s (N. Joukowsky 1898; V. L. Streeter, E. B. Wylie, "Fluid
    Transients", 1978).
    """
    pitch = 1250.0 / (4.0 * length)
    out = np.zeros(int((decay + 0.4) * SAMPLE_RATE))
    moment, level = 0.0, 1.0
    while moment < decay and level > 0.02:
        add_at(out, int(moment * SAMPLE_RATE), level * knock(rng, 70.0, 900.0, rng.uniform(0.08, 0.2), click=0.15))
        moment += rng.uniform(0.93, 1.07) / pitch
        level *= float(np.exp(-4.0 / (pitch * decay))) * rng.uniform(0.75, 1.1)
    return out


def whistle(rng: Generator, pitch: Array, level: Array, rough: float = 0.02) -> Array:
    """A valve that sings: a limit cycle of washer, lever and pipe, unsteady in pitch and level.

    ``pitch`` (Hz) and ``level`` (peak) are curves of (n,) samples; ``rough`` is the SD of the relative pitch.
    """
    count = len(pitch)
    wander = drift(count, rng, 5.0, 0.7 * rough) + drift(count, rng, 90.0, 0.5 * rough)
    phase = phase_of(pitch * (1.0 + wander), count, rng.uniform(0, 6.28))
    grip = np.clip(0.75 + drift(count, rng, 3.0, 0.4) + drift(count, rng, 40.0, 0.2), 0.0, 1.5)
    tone = np.sin(phase) + rng.uniform(0.1, 0.45) * np.sin(2 * phase + 0.7) + rng.uniform(0.02, 0.2) * np.sin(3 * phase)
    breath = np.sin(phase + drift(count, rng, 400.0, 1.2)) * drift(count, rng, 250.0, 0.5)
    return np.asarray(level * grip * (tone + 0.5 * breath))


def pipe(signal: Array, metres: float, loss: float, terms: int = 8) -> Array:
    """The signal through a pipe that is open at both ends: echoes after 2L/c, each weaker by ``loss``."""
    delay = 2.0 * metres / 343.0 * SAMPLE_RATE
    out = signal.copy()
    for k in range(1, terms):
        shift = round(k * delay)
        if shift < len(signal):
            out[shift:] += loss**k * signal[: len(signal) - shift]
    return out


def placed(count: int, events: Iterable[tuple[float, Array]]) -> Array:
    """(count,) the events at their moments (s)."""
    out = np.zeros(count)
    for moment, piece in events:
        add_at(out, round(moment * SAMPLE_RATE), piece)
    return out


@dataclass
class Take:
    """One take under way: the curves of its sources, and its events."""

    count: int
    rng: Generator
    line: Timeline = field(init=False)
    events: list[tuple[float, Array]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.line = Timeline(self.count)

    def at(self, moment: float, level: float, piece: Array) -> None:
        """Add an event of that peak."""
        self.events.append((moment, level * piece))

    def power(self, name: str, shape: Array, unrest: float = 2.0, pace: float = 9.0, least: float = 0.0) -> Array:
        """(frames, bands) power of the source of that name, never below the level ``least``."""
        level = np.maximum(self.line.level(name), least)
        return source(shape, level, self.rng, unrest, pace)

    def bubbles(self, name: str, rate: float, radii_mm: tuple[float, float], least: float = 0.0) -> Array:
        """Single bubbles, ``rate`` a second where the curve is 1."""
        return bubble_cloud(self.count, self.rng, rate * self.line.level(name) + least, radii_mm)

    def splashes(self, name: str, rate: float, least: float = 0.0) -> Array:
        """Lumps of water that fall, ``rate`` a second where the curve is 1; fewer of them are weaker as well."""
        return splashes(self.count, self.rng, rate * self.line.level(name) + least)

    def heard(self, power: Array, water: Array, gain: float = 1.6) -> Array:
        """The flow of that power and single drops and bubbles in pan and cistern, with all events."""
        inside = flow(self.count, self.rng, power) + water
        low, modes = self.rng.uniform(150.0, 320.0), int(self.rng.integers(9, 18))
        return cavity(inside, self.rng, low, 7000.0, modes, gain) + placed(self.count, self.events)
