"""Talkers and dogs."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import loudspeaker, turning, unsteady, wave
from generators.assets.sounds.formants import Talker, noises, speak, talker
from generators.assets.sounds.room_tone import over_room_tone, slow_curve, spectrum_noise
from generators.assets.sounds.signals import Array, add_at, phase_of, strike, time_axis, unit


def room_talk(count: int, rng: Generator) -> Array:
    """Two or three people in a room who talk in turn and over each other, without words.

    Unit: men, women, children; pitch, tract, rate, effort. Take: syllables, phrases, pauses, who is near.
    """
    turbulence = noises(count, rng)
    number = int(rng.integers(2, 4))
    out = np.zeros(count)
    for _ in range(number):
        who = talker(rng, str(rng.choice(["man", "woman", "woman", "child"])), rng.uniform(0.3, 0.6))
        out += rng.uniform(0.35, 1.0) * unit(speak(count, rng, who, turbulence))
    return over_room_tone(out, rng)


def one_sided_call(count: int, rng: Generator) -> Array:
    """One half of a telephone call: one person who walks about, speaks, listens, and says a word in between.

    Unit: who it is. Take: phrases, long pauses of listening, how near and how turned away the mouth is; steps.
    """
    kind = str(rng.choice(["man", "woman"]))
    speech = unit(speak(count, rng, talker(rng, kind, rng.uniform(0.6, 0.85)), noises(count, rng)))
    away = np.clip(0.5 + slow_curve(count, rng, 0.25, 0.35), 0.0, 1.0)
    dull = np.asarray(lfilter(*butter(1, rng.uniform(900.0, 1800.0), fs=SAMPLE_RATE), speech))
    out = (1 - 0.6 * away) * ((1 - away) * speech + away * dull)
    floor = [(rng.uniform(70, 260), rng.uniform(0.05, 0.15), 1.0) for _ in range(4)]
    now, pace = rng.uniform(0.0, 2.0), rng.uniform(0.5, 0.75)
    while now * SAMPLE_RATE < count:
        for _ in range(int(rng.integers(3, 9))):
            add_at(out, int(now * SAMPLE_RATE), rng.uniform(0.1, 0.35) * strike(floor, 0.2, rng, attack=3e-3))
            now += pace * rng.uniform(0.92, 1.08)
        now += rng.uniform(1.0, 5.0)
    return over_room_tone(out, rng)


def radio_talk(count: int, rng: Generator) -> Array:
    """One announcer after the other on a small radio: compressed, of narrow band, over hiss and hum of the set."""
    turbulence = noises(count, rng)
    first, second = (talker(rng, kind, 0.88) for kind in rng.permutation(["man", "woman"]))
    one, two = unit(speak(count, rng, first, turbulence)), unit(speak(count, rng, second, turbulence))
    change = np.clip(8.0 * slow_curve(count, rng, 0.08, 1.0), -0.5, 0.5) + 0.5
    voice = change * one + (1 - change) * two
    follow = np.sqrt(np.maximum(lfilter([0.0004], [1.0, -0.9996], np.square(voice)), 0.0))
    voice = voice / (follow + 0.25)
    band = butter(3, [rng.uniform(120, 250), rng.uniform(3800, 7500)], "bandpass", fs=SAMPLE_RATE, output="sos")
    hiss = spectrum_noise(count, rng, [100, 600, 3000, 9000], [-6, -3, 0, -14])
    sent = unit(sosfilt(band, voice)) + rng.uniform(0.01, 0.05) * hiss
    return loudspeaker(sent, rng, (180.0, 380.0), (0.01, 0.05)) + 0.012 * hiss


def crowd(count: int, rng: Generator) -> Array:
    """Many people far away: noise with the long-term spectrum of speech in four independently modulated groups.

    Unit: spectrum (Byrne et al. 1994, within 3 dB per octave band), rate of syllables (envelopes of 3–6 Hz), size of
    the crowd. Take: swells, two talkers who stand out, laughter-like trains of syllables.
    """
    knots = [63, 125, 250, 500, 1000, 2000, 4000, 8000, 16_000]
    levels = np.array([-14, -2, 0, 0, -8, -14, -19, -24, -42]) + rng.normal(0, 1.5, 9)
    out = np.zeros(count)
    for low, high in ((90, 450), (450, 1100), (1100, 2600), (2600, 9000)):
        inside = [level if low <= knot <= 1.6 * high else level - 25 for knot, level in zip(knots, levels, strict=True)]
        group = spectrum_noise(count, rng, knots, inside) * 10 ** (np.max(inside) / 20)
        depth = rng.uniform(0.25, 0.6)
        out += group * np.exp(slow_curve(count, rng, rng.uniform(7.0, 12.0), depth) + slow_curve(count, rng, 0.5, 0.12))
    turbulence = noises(count, rng)
    out = unit(out)
    for _ in range(2):
        kind = str(rng.choice(["man", "woman", "child"]))
        out += rng.uniform(0.15, 0.6) * unit(speak(count, rng, talker(rng, kind, rng.uniform(0.3, 0.7)), turbulence))
    laughing = Talker(rng.uniform(220, 380), rng.uniform(1.0, 1.25), rng.uniform(4.8, 6.0), 0.4, 1.0, 0.12)
    return out + rng.uniform(0.1, 0.35) * unit(speak(count, rng, laughing, turbulence))


def _tract(signal: Array, formants: list[tuple[float, float]]) -> Array:
    """The signal through formants of (frequency, bandwidth) in series, each of unit gain at 0 Hz (Klatt 1980)."""
    out = signal
    for frequency, bandwidth in formants:
        radius = np.exp(-np.pi * bandwidth / SAMPLE_RATE)
        a1, a2 = -2 * radius * np.cos(2 * np.pi * frequency / SAMPLE_RATE), radius**2
        out = np.asarray(lfilter([1 + a1 + a2], [1.0, a1, a2], out))
    return np.diff(out, prepend=0.0)


def _bark(rng: Generator, pitch: float, seconds: float, harsh: float, formants: list[tuple[float, float]]) -> Array:
    """One bark: the pitch rises and falls; irregular larynx and turbulence by ``harsh``; the mouth opens and closes."""
    n = int(seconds * SAMPLE_RATE)
    t = np.linspace(0.0, 1.0, n)
    top = rng.uniform(0.25, 0.5)
    arch = np.interp(t, [0, top, 1], [0.75, 1.0, rng.uniform(0.5, 0.75)])
    wild = np.cumsum(rng.normal(0.0, harsh * 0.002, n))
    phase = phase_of(pitch * arch * np.exp(np.clip(wild, -0.3, 0.3)), n)
    orders = np.arange(1.0, max(4, int(9000 / pitch)))
    source = wave(phase, orders ** -rng.uniform(0.9, 1.4), rng)
    # Subharmonics, as of two folds that do not swing together.
    source = source * (1 + harsh * rng.uniform(0.3, 0.9) * np.sin(0.5 * phase))
    breath = rng.standard_normal(n) * harsh * (0.5 + 0.5 * np.abs(np.sin(0.5 * phase)))
    envelope = np.interp(t, [0, 0.06, 0.35, 0.8, 1], [0, 1, 0.85, 0.25, 0])
    opened = [(f * rng.uniform(0.95, 1.05), b) for f, b in formants]
    return _tract(envelope * (source + breath), opened)


def _dog_formants(rng: Generator, length: float) -> list[tuple[float, float]]:
    """Formants of a tube of ``length`` (m), closed at the larynx: odd multiples of c/4L (Riede & Fitch 1999)."""
    base = 350.0 / (4 * length)
    return [
        (base * (2 * k - 1) * rng.uniform(0.92, 1.08), 60 + 0.08 * base * (2 * k - 1))
        for k in range(1, int(5000.0 / base) + 2)
    ]


def _series(rng: Generator, seconds: float, within: tuple[float, float], between: tuple[float, float]) -> list[float]:
    """Moments of barks: groups of 1 to 7, ``within`` seconds apart, groups ``between`` seconds apart."""
    now, out = -rng.uniform(0.0, 1.0), []
    while now < seconds:
        step = rng.uniform(*within)
        for _ in range(int(rng.integers(1, 8))):
            out.append(now)
            now += step * rng.uniform(0.8, 1.3)
        now += rng.uniform(*between)
    return out


def large_bark(count: int, rng: Generator) -> Array:
    """A large dog at the door: low, harsh, unmodulated barks in quick series, panting between.

    Unit: pitch (190–420 Hz), tract of 17–24 cm, harshness. Take: series, lengths (0.12–0.28 s), levels. Disturbance
    barks are longer, lower and harsher than others (Yin & McCowan 2004).
    """
    pitch, harsh = rng.uniform(190.0, 420.0), rng.uniform(0.5, 1.1)
    formants = _dog_formants(rng, rng.uniform(0.17, 0.24))
    out = np.zeros(count)
    for moment in _series(rng, count / SAMPLE_RATE, (0.35, 0.7), (0.8, 2.5)):
        bark = _bark(rng, pitch * rng.uniform(0.88, 1.12), rng.uniform(0.12, 0.28), harsh, formants)
        add_at(out, int(moment * SAMPLE_RATE), rng.uniform(0.6, 1.0) * bark)
    return over_room_tone(_panting(unit(out), rng, formants, 0.08), rng)


def _panting(out: Array, rng: Generator, formants: list[tuple[float, float]], level: float) -> Array:
    """Add breathing at 2 to 5 Hz: noise through the tract, in and out unlike."""
    count = len(out)
    rate = rng.uniform(2.0, 5.0) * (1 + slow_curve(count, rng, 0.5, 0.1))
    breath = np.clip(np.sin(phase_of(rate, count)), -0.6, 1.0) ** 2
    noise = _tract(rng.standard_normal(count), [(f, 3 * b) for f, b in formants[1:4]])
    return np.asarray(out + level * unit(noise) * breath * np.clip(0.6 + slow_curve(count, rng, 0.3, 0.5), 0.05, 1.5))


def small_yap(count: int, rng: Generator) -> Array:
    """A small dog at play: short tonal yaps of 600–1200 Hz that rise or fall steeply, in irregular groups."""
    pitch, harsh = rng.uniform(600.0, 1200.0), rng.uniform(0.08, 0.35)
    formants = _dog_formants(rng, rng.uniform(0.075, 0.11))
    out = np.zeros(count)
    for moment in _series(rng, count / SAMPLE_RATE, (0.2, 0.45), (0.5, 1.8)):
        seconds = rng.uniform(0.06, 0.14)
        yap = _bark(rng, pitch * rng.uniform(0.8, 1.2), seconds, harsh, formants)
        add_at(out, int(moment * SAMPLE_RATE), rng.uniform(0.4, 1.0) * yap)
        if rng.random() < 0.25:
            squeal = _bark(rng, 1.5 * pitch, 2.2 * seconds, 0.5 * harsh, formants)
            add_at(out, int((moment + seconds) * SAMPLE_RATE), rng.uniform(0.1, 0.4) * squeal)
    return over_room_tone(_panting(unit(out), rng, formants, 0.06), rng)


def whine_and_bark(count: int, rng: Generator) -> Array:
    """A dog that is left alone: whines that slide, growls, now and then single barks.

    Whines are nearly pure tones of 400–1000 Hz whose second harmonic is weak; growls are pulses of the larynx at
    30–80 Hz; both through a tract of 12–17 cm.
    """
    formants = _dog_formants(rng, rng.uniform(0.12, 0.17))
    pitch = rng.uniform(400.0, 800.0)
    out, now = np.zeros(count), -rng.uniform(0.0, 1.0)
    while now * SAMPLE_RATE < count:
        kind = rng.choice(["whine", "growl", "bark"], p=[0.55, 0.15, 0.3])
        seconds = {"whine": rng.uniform(0.4, 1.6), "growl": rng.uniform(0.8, 2.5), "bark": rng.uniform(0.1, 0.2)}[
            str(kind)
        ]
        n = int(seconds * SAMPLE_RATE)
        t = np.linspace(0, 1, n)
        if kind == "bark":
            piece = 1.6 * unit(_bark(rng, 0.8 * pitch, seconds, rng.uniform(0.3, 0.8), formants))
        elif kind == "whine":
            slide = pitch * np.interp(t, np.linspace(0, 1, 5), np.exp(rng.normal(0.0, 0.14, 5)))
            tone = wave(phase_of(slide * unsteady(n, rng, 0.003, 0.006), n), [1.0, 0.2, 0.1, 0.04], rng)
            piece = 0.5 * np.sin(np.pi * t) ** 0.6 * (tone + 0.08 * rng.standard_normal(n))
        else:
            pulses = wave(turning(n, rng, rng.uniform(30, 80), 0.05, 0.06), np.ones(60), rng)
            piece = 0.5 * np.sin(np.pi * t) ** 0.4 * unit(_tract(pulses + rng.standard_normal(n), formants))
        add_at(out, int(now * SAMPLE_RATE), rng.uniform(0.5, 1.0) * piece)
        now += seconds + rng.uniform(0.15, 1.4)
    quiet = sosfilt(butter(1, 7000.0, fs=SAMPLE_RATE, output="sos"), out)
    t_all = time_axis(count)
    scratching = spectrum_noise(count, rng, [300, 1500, 4000, 9000], [-20, -3, 0, -20])
    scratching *= np.clip(slow_curve(count, rng, 9.0, 0.5), 0, 1) * (np.sin(0.3 * t_all + rng.uniform(0, 6)) > 0.5)
    return over_room_tone(quiet + 0.08 * scratching, rng)


def howl_and_bay(count: int, rng: Generator) -> Array:
    """A hound that howls: long tones that rise, stay and sink, between them bays, long low barks.

    Unit: pitch (280–600 Hz), tract of 15–22 cm. Take: howls of 1 to 4 s, breaks of the voice (a step to 3/2 or 2 of the
    pitch), bays, breathing.
    """
    pitch, harsh = rng.uniform(280.0, 600.0), rng.uniform(0.2, 0.6)
    formants = _dog_formants(rng, rng.uniform(0.15, 0.22))
    out, now = np.zeros(count), -rng.uniform(0.0, 2.0)
    while now * SAMPLE_RATE < count:
        if rng.random() < 0.45:
            seconds = rng.uniform(0.3, 0.6)
            piece = 1.2 * unit(_bark(rng, 0.7 * pitch * rng.uniform(0.9, 1.1), seconds, 1.3 * harsh, formants))
        else:
            seconds = rng.uniform(1.0, 4.0)
            n = int(seconds * SAMPLE_RATE)
            t = np.linspace(0, 1, n)
            course = np.interp(t, [0, 0.2, 0.4, 0.8, 1], [0.65, 0.95, 1.0, rng.uniform(0.85, 1.0), 0.6])
            if rng.random() < 0.4:
                course = course * np.where(t > rng.uniform(0.3, 0.7), 1.0, float(rng.choice([2 / 3, 0.5])))
            tone = wave(
                phase_of(pitch * course * unsteady(n, rng, 0.004, 0.004), n), [1.0, 0.7, 0.35, 0.2, 0.1, 0.05], rng
            )
            mouth = np.sin(np.pi * np.clip(t * rng.uniform(0.95, 1.05), 0, 1)) ** 0.5
            piece = 0.8 * unit(mouth * _tract(tone + 0.05 * rng.standard_normal(n), formants))
        add_at(out, int(now * SAMPLE_RATE), rng.uniform(0.5, 1.0) * piece)
        now += seconds + rng.uniform(0.2, 1.5)
    return over_room_tone(_panting(out, rng, formants, 0.05), rng)
