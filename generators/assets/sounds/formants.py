"""Voices of people and dogs by a source and a filter: pulses of a larynx, resonances of a tract, turbulent noise.

Models: D. H. Klatt, "Software for a cascade/parallel formant synthesizer", JASA 67 (1980) 971–995 (sources, parallel
branch, bandwidths); X. Rodet, "Time-domain formant-wave-function synthesis", Computer Music Journal 8 (1984): each
pulse excites damped waves, one per formant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.room_tone import spectrum_noise
from generators.assets.sounds.signals import Array, add_at, time_axis, upsampled

#: Formants of ten vowels, means of 33 men (G. E. Peterson & H. L. Barney, JASA 24 (1952) 175–184).
VOWELS = np.array(
    [
        (270, 2290, 3010),
        (390, 1990, 2550),
        (530, 1840, 2480),
        (660, 1720, 2410),
        (730, 1090, 2440),
        (570, 840, 2410),
        (440, 1020, 2240),
        (300, 870, 2240),
        (640, 1190, 2390),
        (490, 1350, 1690),
    ],
    dtype=np.float64,
)
#: Where formants head in consonants: lips, teeth, palate.
_LOCI = np.array([(250, 900, 2200), (250, 1800, 2700), (250, 2200, 2600)], dtype=np.float64)
_HIGHER = (3400.0, 4500.0)
_BANDWIDTHS = (70.0, 90.0, 140.0, 220.0, 300.0)
#: Values per second of the curves of pitch, formants and levels.
_CURVES = 245
_GRAIN = int(0.022 * SAMPLE_RATE)
_STEPS = 48


@dataclass(frozen=True)
class Talker:
    """A speaker.

    Attributes:
        pitch: mean fundamental frequency (Hz).
        tract: factor on a man's formants: 1.0, a woman's about 1.17, a child's 1.3 to 1.4.
        rate: syllables per second while talking.
        breath: level of noise in the voice.
        effort: 0 soft to 1 loud: less tilt of the source, more pitch movement.
        share: of the time that is talked.
    """

    pitch: float
    tract: float
    rate: float
    breath: float
    effort: float
    share: float


def talker(rng: Generator, kind: str, share: float) -> Talker:
    """A man, woman or child drawn at random."""
    low, high, tract = {"man": (90, 145, 1.0), "woman": (165, 250, 1.17), "child": (240, 360, 1.35)}[kind]
    return Talker(
        pitch=rng.uniform(low, high),
        tract=tract * rng.uniform(0.94, 1.06),
        rate=rng.uniform(3.6, 6.2),
        breath=rng.uniform(0.02, 0.15),
        effort=rng.uniform(0.1, 1.0),
        share=share,
    )


@dataclass(frozen=True)
class _Score:
    """Curves at `_CURVES` per second: pitch (Hz), level of voicing, formants (n, 3), levels of three noises (n, 3)."""

    pitch: Array
    voiced: Array
    formants: Array
    noises: Array


def _syllables(seconds: float, rng: Generator, who: Talker) -> list[tuple[float, float, int, float]]:
    """(start, length, number in its phrase, place in the phrase from 0 to 1) of each syllable."""
    now, out = -rng.uniform(0.0, 2.0), []
    while now < seconds:
        number = int(rng.integers(3, 16))
        lengths = rng.gamma(9.0, 1 / (9.0 * who.rate), number)
        lengths[-1] *= rng.uniform(1.2, 1.8)
        for index, length in enumerate(lengths):
            out.append((now, float(length), index, index / number))
            now += length
        now += rng.gamma(2.0, 0.5) * float(lengths.sum()) * (1 / who.share - 1)
    return out


def _score(seconds: float, rng: Generator, who: Talker) -> _Score:
    """A text without words: syllables of one or no consonant and a vowel, in phrases whose pitch declines."""
    n = int(seconds * _CURVES) + 2
    knots: list[tuple[float, Array]] = [(-3.0, VOWELS[0])]
    pitch_knots: list[tuple[float, float]] = [(-3.0, who.pitch)]
    voiced, noises = np.zeros(n), np.zeros((n, 3))
    for start, length, number, place in _syllables(seconds, rng, who):
        kind = rng.choice(["fricative", "stop", "sonorant", "none"], p=[0.28, 0.32, 0.28, 0.12])
        onset = length * {"fricative": 0.38, "stop": 0.28, "sonorant": 0.25, "none": 0.08}[str(kind)]
        vowel = VOWELS[int(rng.integers(0, len(VOWELS)))] * rng.uniform(0.93, 1.07)
        knots += [(start + 0.6 * onset, _LOCI[int(rng.integers(0, 3))]), (start + onset + 0.05, vowel)]
        knots.append((start + 0.9 * length, 0.85 * vowel + 0.15 * VOWELS[8]))
        accent = rng.uniform(0.0, 0.12 + 0.25 * who.effort) * (rng.random() < 0.4)
        pitch_knots.append((start + 0.5 * length, who.pitch * (1.12 - 0.25 * place + accent)))
        level = rng.uniform(0.5, 1.0) * (1 - 0.35 * place)
        first, last, middle = (int(t * _CURVES) for t in (start, start + length, start + onset))
        soft = np.interp(np.arange(first, last), [middle - 3, middle + 6, last - 8, last], [0, 1, 0.8, 0.35])
        if kind == "sonorant" or (kind == "none" and number):
            soft = np.maximum(soft, 0.35)
        add_at(voiced, first, level * soft)
        if kind == "fricative":
            add_at(
                noises[:, int(rng.integers(0, 3))],
                first,
                level * rng.uniform(0.4, 1.0) * np.hanning(middle - first + 2),
            )
        elif kind == "stop":
            burst = np.exp(-np.arange(10) / rng.uniform(1.5, 5.0))
            add_at(noises[:, int(rng.integers(0, 3))], middle - 3, level * rng.uniform(0.5, 1.3) * burst)
    t = np.arange(n) / _CURVES
    times = np.array([k for k, _ in knots])
    order = np.argsort(times)
    targets = np.array([f for _, f in knots])[order]
    formants = np.stack([np.interp(t, times[order], targets[:, k]) for k in range(3)], axis=1) * who.tract
    pitch = np.interp(t, [k for k, _ in pitch_knots], [p for _, p in pitch_knots])
    pitch *= np.exp(
        np.interp(t, np.arange(0, seconds + 1, 0.03), rng.normal(0, 0.012, len(np.arange(0, seconds + 1, 0.03))))
    )
    return _Score(pitch, voiced, formants, noises)


def _grains(who: Talker) -> tuple[NDArray[np.float64], list[Array]]:
    """Damped waves: for each formant `_STEPS` log-spaced frequencies; (grid (5, steps), five arrays (steps, n))."""
    t = time_axis(_GRAIN)
    spans = [(200, 1300), (500, 3400), (1200, 4200), *((f * who.tract * 0.97, f * who.tract * 1.03) for f in _HIGHER)]
    grid = np.array([np.geomspace(low, high, _STEPS) for low, high in spans])
    fade = np.minimum(1.0, (t[-1] - t) / 0.003)
    waves = []
    for frequencies, bandwidth in zip(grid, _BANDWIDTHS, strict=True):
        rise = 1 - np.exp(-t / 2.5e-4)
        body = np.exp(-np.pi * bandwidth * who.tract * t) * rise * fade
        waves.append(body * np.sin(2 * np.pi * frequencies[:, None] * t))
    return grid, waves


def _voicing(count: int, rng: Generator, who: Talker, score: _Score) -> Array:
    """The voiced part: one sum of damped waves per pulse of the larynx, with jitter and shimmer."""
    out = np.zeros(count + _GRAIN)
    cycles = np.cumsum(score.pitch) / _CURVES
    places = np.arange(1, int(cycles[-1])) + rng.normal(0.0, 0.008, max(0, int(cycles[-1]) - 1))
    times = np.interp(places, cycles, np.arange(len(cycles)) / _CURVES)
    index = np.minimum((times * _CURVES).astype(int), len(score.voiced) - 1)
    level = score.voiced[index] * np.exp(rng.normal(0.0, 0.06, len(index)))
    heard = level > 0.01
    times, index, level = times[heard], index[heard], level[heard]
    grid, waves = _grains(who)
    higher = np.tile(np.array(_HIGHER) * who.tract, (len(index), 1))
    formants = np.concatenate([score.formants[index], higher], axis=1)
    tilt = 1.25 - 0.5 * who.effort
    gains = level[:, None] * (formants / 500.0) ** -tilt
    gains[:, 1:] *= np.array([0.8, 0.7, 0.6, 0.5])
    steps = np.empty(formants.shape, dtype=int)
    for k in range(formants.shape[1]):
        steps[:, k] = np.clip(np.searchsorted(grid[k], formants[:, k]), 0, _STEPS - 1)
    starts = (times * SAMPLE_RATE).astype(int)
    for start, choice, gain in zip(starts, steps, gains, strict=True):
        piece = gain[0] * waves[0][choice[0]]
        for k in range(1, 5):
            piece = piece + gain[k] * waves[k][choice[k]]
        add_at(out, int(start), piece)
    return out[:count]


def noises(count: int, rng: Generator) -> tuple[Array, Array, Array]:
    """The turbulence of consonants: at the teeth (s), at the palate (sh), at the lips (f), each of unit RMS."""
    shapes = (
        ((300, 2500, 5000, 8000, 14_000), (-40, -18, 0, -2, -22)),
        ((300, 1500, 2800, 5000, 12_000), (-34, -12, 0, -6, -28)),
        ((200, 1000, 4000, 9000, 15_000), (-14, -8, -6, -4, -20)),
    )
    # Consonants are short and far apart: some seconds of noise serve for minutes.
    lengths = (min(count, int(seconds * SAMPLE_RATE)) for seconds in (17.3, 19.1, 23.7))
    stretches = (spectrum_noise(n, rng, *shape) for n, shape in zip(lengths, shapes, strict=True))
    first, second, third = (np.resize(noise, count) for noise in stretches)
    return first, second, third


def speak(count: int, rng: Generator, who: Talker, turbulence: tuple[Array, Array, Array]) -> Array:
    """``count`` samples of a talker without words.

    Args:
        count: samples.
        rng: the only source of randomness.
        who: the talker.
        turbulence: `noises` of that length; talkers may share them, each takes another stretch.
    """
    seconds = count / SAMPLE_RATE
    score = _score(seconds, rng, who)
    out = _voicing(count, rng, who, score)
    shift = int(rng.integers(0, max(1, count)))
    scale = 0.8 * float(np.sqrt(np.mean(np.square(out))) + 1e-9)
    for number, noise in enumerate(turbulence):
        curve = score.noises[:, number] + (who.breath * score.voiced if number == 2 else 0.0)
        level = upsampled(scale * curve, SAMPLE_RATE // _CURVES, count)
        out[shift:] += noise[: count - shift] * level[shift:]
        out[:shift] += noise[count - shift :] * level[:shift]
    return out
