"""Music of the next room, generated: chords, drums, plucked and struck strings."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import click, wave
from generators.assets.sounds.room_tone import over_room_tone, slow_curve
from generators.assets.sounds.signals import Array, add_at, phase_of, strike, time_axis, unit

_CHORDS = ((0, 4, 7), (0, 3, 7), (0, 4, 7, 11), (0, 3, 7, 10), (0, 5, 7))


def _progression(rng: Generator) -> list[tuple[int, ...]]:
    """Four to six chords as semitones above a root: roots by fourths, fifths and seconds."""
    root, out = 0, []
    for _ in range(int(rng.integers(4, 7))):
        out.append(tuple(root + step for step in _CHORDS[int(rng.integers(0, len(_CHORDS)))]))
        root = (root + int(rng.choice([5, 7, 2, 9, 10]))) % 12
    return out


def _beats(count: int, rng: Generator, beat: float, wander: float) -> Array:
    """Times of beats (s) of a player: the tempo drifts, each beat is some milliseconds off."""
    number = int(count / SAMPLE_RATE / beat * 1.2) + 4
    lengths = beat * np.exp(np.cumsum(rng.normal(0, 0.002, number)) + rng.normal(0, wander, number))
    times = np.cumsum(lengths) - rng.uniform(0.0, 4.0) * beat
    return times[times < count / SAMPLE_RATE]


def organ_chords(count: int, rng: Generator) -> Array:
    """An organ-like instrument: chords of sines in drawbar ratios, a turning loudspeaker, bass, a soft beat.

    Unit: root, registration (eight drawbars), speed of the turning horn (0.7 or 6–7 Hz). Take: chords, tempo, voicing.
    """
    root, beat = 110.0 * 2 ** (rng.uniform(0, 12) / 12), rng.uniform(0.45, 0.8)
    bars = rng.uniform(0.0, 1.0, 8) ** 1.5
    chords = _progression(rng)
    ratios = np.array([0.5, 1.5, 1, 2, 3, 4, 5, 8])
    out = np.zeros(count)
    times = _beats(count, rng, beat, 0.01)
    for number, moment in enumerate(times[::4]):
        seconds = 4 * beat * rng.uniform(0.85, 1.02)
        n = int(seconds * SAMPLE_RATE)
        t = time_axis(n)
        edge = np.minimum(1.0, np.minimum(t / 0.015, t[::-1] / 0.06))
        tones = np.zeros(n)
        for step in chords[number % len(chords)]:
            pitch = root * 2 ** ((step % 17) / 12) * (1 + rng.normal(0, 4e-4))
            for ratio, level in zip(ratios, bars, strict=True):
                if level > 0.1:
                    tones += level * np.sin(2 * np.pi * ratio * pitch * t + rng.uniform(0, 6.28))
        bass = wave(phase_of(0.5 * root * 2 ** (chords[number % len(chords)][0] % 12 / 12), n), [1, 0.5, 0.2], rng)
        add_at(out, int(moment * SAMPLE_RATE), edge * (tones + 0.8 * bass * np.exp(-t / 0.6)))
        add_at(out, int(moment * SAMPLE_RATE), 2.0 * click(rng, 0.01, 500.0, 4000.0))
    for moment in times[1::2]:
        add_at(out, int(moment * SAMPLE_RATE), 25.0 * rng.uniform(0.5, 1.0) * click(rng, 0.12, 3000.0, 9000.0))
    rotor = phase_of(float(rng.choice([0.7, rng.uniform(5.8, 7.0)])) * (1 + slow_curve(count, rng, 0.3, 0.03)), count)
    return over_room_tone(unit(out) * (1 + 0.25 * np.sin(rotor)), rng)


def drums_and_bass(count: int, rng: Generator) -> Array:
    """Drums and a bass: membranes with the modes of an ideal one (1, 1.59, 2.14, 2.30, 2.65), snares, cymbals."""
    beat = rng.uniform(0.22, 0.36)
    size = rng.uniform(50.0, 75.0)
    t = time_axis(int(0.45 * SAMPLE_RATE))
    kick = np.exp(-t / 0.11) * np.sin(2 * np.pi * np.cumsum(size * (1 + 2.2 * np.exp(-t / 0.02))) / SAMPLE_RATE)
    skin = [(rng.uniform(170, 230) * r, 0.25 / r, 1 / r) for r in (1, 1.59, 2.14, 2.30, 2.65, 2.92)]
    snare = [strike(skin, 0.3, rng) for _ in range(3)]
    metal = [(f, rng.uniform(0.1, 0.9), 0.2) for f in rng.uniform(2500, 11_000, 24)]
    out = np.zeros(count)
    pattern = rng.uniform(size=(3, 16)) < np.array([[0.25], [0.12], [0.75]])
    pattern[0, [0, 8]] = pattern[1, [4, 12]] = True
    walk = rng.choice([0, 3, 5, 7, 10, 12], 16)
    root = rng.uniform(41.0, 65.0)
    for number, moment in enumerate(_beats(count, rng, beat, 0.008)):
        place, start = number % 16, int(moment * SAMPLE_RATE)
        if number % 64 == 0:
            pattern ^= rng.uniform(size=pattern.shape) < 0.06
        if pattern[0, place]:
            add_at(out, start, rng.uniform(0.8, 1.1) * kick)
        if pattern[1, place]:
            hit = rng.uniform(0.5, 0.9) * snare[int(rng.integers(0, 3))]
            add_at(hit, 0, 18.0 * click(rng, 0.16, 1200.0, 8000.0))
            add_at(out, start, hit)
        if pattern[2, place]:
            add_at(out, start, rng.uniform(3.0, 9.0) * click(rng, rng.uniform(0.03, 0.1), 6000.0, 12_000.0))
        if place % 2 == 0:
            n = int(1.8 * beat * SAMPLE_RATE)
            tone = wave(phase_of(root * 2 ** (int(walk[place]) / 12), n), [1, 0.7, 0.5, 0.3, 0.2, 0.1], rng)
            add_at(out, start, 0.5 * tone * np.exp(-time_axis(n) / 0.25) * np.minimum(1, time_axis(n)[::-1] / 0.02))
        if place == 0 and rng.random() < 0.3:
            add_at(out, start, rng.uniform(0.1, 0.4) * strike(metal, 1.2, rng))
    return over_room_tone(out, rng)


def _string(rng: Generator, pitch: float, seconds: float, soft: float) -> Array:
    """A plucked string by a delay line with a filter (Karplus & Strong 1983; tuning by Jaffe & Smith 1983)."""
    period = SAMPLE_RATE / pitch
    delay = int(period - 0.5)
    fraction = period - 0.5 - delay
    n = int(seconds * SAMPLE_RATE)
    burst = np.zeros(n)
    pick = np.asarray(lfilter([1 - soft], [1.0, -soft], rng.uniform(-1, 1, delay)))
    place = int(delay * rng.uniform(0.1, 0.35))
    burst[:delay] = pick - np.roll(pick, place)
    # Loop: an average of two samples, loss, and a linear interpolation for the tuning.
    loss = 10 ** (-3 / (pitch * rng.uniform(1.5, 4.0)))
    loop = np.convolve([0.5 * loss, 0.5 * loss], [1 - fraction, fraction])
    denominator = np.zeros(delay + 3)
    denominator[0] = 1.0
    denominator[delay : delay + 3] -= loop
    return np.asarray(lfilter([1.0], denominator, burst)) * np.minimum(1.0, np.arange(n)[::-1] / 800.0)


def plucked_strings(count: int, rng: Generator) -> Array:
    """A guitar-like instrument: arpeggios of plucked strings and a wooden body with its air resonance.

    Unit: root, body (modes at 90–120, 170–230 and 350–900 Hz), pick. Take: chords, order of the strings, tempo.
    """
    root, beat = 98.0 * 2 ** (rng.uniform(0, 7) / 12), rng.uniform(0.17, 0.32)
    chords, soft = _progression(rng), rng.uniform(0.2, 0.7)
    steps = sorted({step % 24 + octave for chord in chords for step in chord for octave in (0, 12)})
    bank = {
        s: [_string(rng, root * 2 ** (s / 12) * (1 + rng.normal(0, 6e-4)), 1.6, soft) for _ in range(2)] for s in steps
    }
    order = rng.permutation(6)
    out = np.zeros(count)
    for number, moment in enumerate(_beats(count, rng, beat, 0.015)):
        chord = chords[number // 8 % len(chords)]
        notes = [step % 24 + octave for octave in (0, 12) for step in chord]
        chosen = [notes[int(order[number % 6]) % len(notes)]]
        if number % 8 == 0:
            chosen = notes[: int(rng.integers(2, 5))]
        for late, note in enumerate(chosen):
            start = int((moment + 0.012 * late) * SAMPLE_RATE)
            add_at(out, start, rng.uniform(0.5, 1.0) * bank[note][int(rng.integers(0, 2))])
    body = np.zeros(count)
    for frequency in (rng.uniform(90, 120), rng.uniform(170, 230), *rng.uniform(350, 900, 3)):
        sections = butter(1, [0.95 * frequency, 1.05 * frequency], "bandpass", fs=SAMPLE_RATE, output="sos")
        body += sosfilt(sections, out)
    dull = lfilter(*butter(2, rng.uniform(4500.0, 8000.0), fs=SAMPLE_RATE), out + 1.5 * body)
    return over_room_tone(np.asarray(dull), rng)


def _struck_string(rng: Generator, pitch: float, seconds: float, stiffness: float, hard: float) -> Array:
    """A struck stiff string: partials k·f·√(1 + B·k²) (Fletcher 1964), each of two that beat and fall off unlike."""
    t = time_axis(int(seconds * SAMPLE_RATE))
    out = np.zeros(len(t))
    for k in range(1, 31):
        frequency = k * pitch * np.sqrt((1 + stiffness * k**2) / (1 + stiffness))
        if frequency > 9000:
            break
        # A hammer that strikes at an eighth of the string leaves out every eighth partial.
        level = abs(np.sin(np.pi * k / 8)) * k**-hard + 1e-3
        for decay, share in ((rng.uniform(0.25, 0.5), 0.7), (rng.uniform(1.0, 2.5), 0.3)):
            rate = (1 + 0.12 * k) / decay
            near = frequency * (1 + rng.normal(0, 3e-4))
            out += share * level * np.exp(-rate * t) * np.sin(2 * np.pi * near * t + rng.uniform(0, 6.28))
    return out * np.minimum(1.0, np.minimum(t / 0.002, t[::-1] / 0.05))


def struck_strings(count: int, rng: Generator) -> Array:
    """A piano-like instrument: struck stiff strings, a melody over broken chords, a soundboard that dulls.

    Unit: root, stiffness B (2·10⁻⁴ to 10⁻³), hammers, tuning. Take: chords, melody, tempo, touch.
    """
    root, beat = 110.0 * 2 ** (rng.uniform(-3, 5) / 12), rng.uniform(0.25, 0.5)
    chords, hard = _progression(rng), rng.uniform(0.7, 1.3)
    stiffness = 10 ** rng.uniform(-3.7, -3.0)
    bank: dict[int, Array] = {}
    out, step = np.zeros(count), int(rng.integers(0, 5))
    for number, moment in enumerate(_beats(count, rng, beat, 0.012)):
        chord = chords[number // 8 % len(chords)]
        notes = [chord[number % len(chord)] % 12]
        if rng.random() < 0.55:
            step = int(np.clip(step + rng.integers(-2, 3), 0, 5))
            notes.append(12 + chord[step % len(chord)] % 12 + 12 * (step // 3))
        if number % 8 == 0:
            notes.append(chord[0] % 12 - 12)
        for note in notes:
            if note not in bank:
                bank[note] = _struck_string(
                    rng, root * 2 ** (note / 12) * (1 + rng.normal(0, 5e-4)), 1.8, stiffness, hard
                )
            add_at(out, int((moment + rng.normal(0, 0.006)) * SAMPLE_RATE), rng.uniform(0.4, 1.0) * bank[note])
            add_at(out, int(moment * SAMPLE_RATE), 0.6 * click(rng, 0.02, 120.0, 900.0))
    dull = lfilter(*butter(2, rng.uniform(4000.0, 7500.0), fs=SAMPLE_RATE), out)
    return over_room_tone(np.asarray(dull), rng)
