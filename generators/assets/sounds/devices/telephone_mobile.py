"""Cordless and mobile telephones: polyphonic and simple melodies, a vibration motor."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import case_modes, gate, loudspeaker, resonator, turning, unsteady, wave
from generators.assets.sounds.room_tone import over_room_tone, slow_curve
from generators.assets.sounds.signals import Array, add_at, phase_of, strike, time_axis, unit

_SCALES = ((0, 2, 4, 7, 9), (0, 2, 4, 5, 7, 9, 11), (0, 3, 5, 7, 10), (0, 2, 3, 7, 8))


def tune(rng: Generator, notes: int) -> list[tuple[int, float]]:
    """A melody of (semitones above its root, length in beats): a random walk on a scale, with leaps and repeats."""
    scale = _SCALES[int(rng.integers(0, len(_SCALES)))]
    place = int(rng.integers(0, len(scale)))
    lengths = rng.choice([0.5, 1.0, 1.0, 1.5, 2.0], notes)
    out = []
    for length in lengths:
        out.append((scale[place % len(scale)] + 12 * (place // len(scale)), float(length)))
        place = int(np.clip(place + rng.choice([-2, -1, -1, 0, 1, 1, 2, 4]), 0, 2 * len(scale) - 1))
    return out


def _placed(count: int, rng: Generator, phrases: list[Array], pause: tuple[float, float], wander: float) -> Array:
    """Phrases one after the other with pauses, from somewhere in one on; levels wander (standard deviation)."""
    out = np.zeros(count)
    rest = rng.uniform(*pause)
    now = -rng.uniform(0.0, 0.7) * len(phrases[0]) / SAMPLE_RATE
    while now * SAMPLE_RATE < count:
        phrase = phrases[int(rng.integers(0, len(phrases)))]
        add_at(out, round(now * SAMPLE_RATE), np.exp(rng.normal(0.0, wander)) * phrase)
        now += len(phrase) / SAMPLE_RATE + rest * (1 + rng.normal(0.0, 0.01))
    return out


def _fm_note(rng: Generator, pitch: float, seconds: float, ratio: float, index: float, fall: float) -> Array:
    """A tone of two operators (Chowning 1973): the index falls with the level."""
    t = time_axis(int(seconds * SAMPLE_RATE))
    level = np.exp(-t / fall) * np.minimum(1.0, t / 0.004) * np.minimum(1.0, t[::-1] / 0.02)
    turn = 2 * np.pi * pitch * (1 + rng.normal(0, 8e-4)) * t
    return np.asarray(level * np.sin(turn + index * level * np.sin(ratio * turn + rng.uniform(0, 6.28))))


def cordless_polyphonic(count: int, rng: Generator) -> Array:
    """A cordless set: handset and base play a melody with chords, a little apart and through unlike loudspeakers.

    Unit: melody, tempo, timbres (ratios and indices of two operators), loudspeakers, delay of the base (30–180 ms).
    Take: start, levels, which of some renderings is played. Source: Chowning's frequency modulation (1973).
    """
    root, beat = rng.uniform(420.0, 760.0), rng.uniform(0.13, 0.26)
    melody = tune(rng, int(rng.integers(8, 15)))
    ratio, index = float(rng.choice([1.0, 2.0, 3.0, 3.5, 1.41])), rng.uniform(0.6, 3.0)
    total = sum(length for _, length in melody) * beat
    phrases = []
    for _ in range(2):
        phrase, now = np.zeros(int((total + 0.5) * SAMPLE_RATE)), 0.0
        for number, (step, length) in enumerate(melody):
            pitch = root * 2 ** (step / 12)
            start = int((now + rng.normal(0, 0.002)) * SAMPLE_RATE)
            add_at(phrase, start, _fm_note(rng, pitch, length * beat + 0.2, ratio, index, 0.35))
            if number % 2 == 0:
                for interval in (-12, -5, -8):
                    below = _fm_note(rng, pitch * 2 ** (interval / 12), 2 * beat + 0.3, 1.0, 0.5 * index, 0.5)
                    add_at(phrase, start, 0.35 * below)
            now += length * beat
        phrases.append(phrase)
    handset = _placed(count, rng, phrases, (0.4, 1.6), 0.04)
    base = np.zeros(count)
    late = int(rng.uniform(0.03, 0.18) * SAMPLE_RATE)
    if late < count:
        base[late:] = handset[: count - late]
    heard = loudspeaker(unit(handset), rng, (450.0, 850.0), (0.02, 0.07))
    heard = heard + rng.uniform(0.0, 0.6) * loudspeaker(unit(base), rng, (300.0, 500.0), (0.02, 0.07))
    return over_room_tone(heard * (1 + slow_curve(count, rng, 5.0, 0.03)), rng)


def mobile_buzzer_melody(count: int, rng: Generator) -> Array:
    """An early mobile telephone: one square tone at a time on a magnetic buzzer; a melody, a trill or a rising run.

    Unit: melody and style, tempo, buzzer (resonance 2.0–3.1 kHz, quality 6–12), asymmetry of its diaphragm, case. Take:
    pauses between melodies, drift of the clock, rattle. Harmonics decrease as 1/k; the even ones come from the
    diaphragm, which is pulled only.
    """
    # The lowest note of ring tones that were sent as text (RTTTL) is 440 Hz.
    root, beat = rng.uniform(520.0, 1000.0), rng.uniform(0.07, 0.14)
    style = int(rng.integers(0, 3))
    if style == 0:
        steps = [(s, n * beat) for s, n in tune(rng, int(rng.integers(8, 16)))]
    elif style == 1:
        pair = (0, int(rng.choice([3, 4, 5, 7])))
        steps = [(pair[k % 2], rng.uniform(0.98, 1.02) * 0.55 * beat) for k in range(int(rng.integers(14, 30)))]
    else:
        steps = [(s, 0.7 * beat) for _ in range(int(rng.integers(2, 5))) for s in (0, 4, 7, 12)]
    pieces = [np.full(int(n * SAMPLE_RATE), root * 2 ** (s / 12)) for s, n in steps]
    # Each note begins on a full capacitor, which the coil's current empties until the cell alone feeds it.
    sag, empty = rng.uniform(0.5, 1.2), rng.uniform(0.012, 0.035) * SAMPLE_RATE
    gaps = [
        np.minimum(1.0, np.minimum(np.arange(len(p)), len(p) - 1 - np.arange(len(p))) / 30.0)
        * (1.0 + sag * np.exp(-np.arange(len(p)) / empty))
        for p in pieces
    ]
    pitch, level = np.concatenate(pieces), np.concatenate(gaps)
    orders = np.arange(1, 9)
    spectrum = np.where(orders % 2, 1.0 / orders, rng.uniform(0.1, 0.4) / orders)
    phrases = []
    for _ in range(2):
        turn = phase_of(pitch * unsteady(len(pitch), rng, 0.001, 0.001), len(pitch))
        # A transistor drives the coil one way only: with each note the mean pull moves armature and case by a step.
        phrases.append(level * (wave(turn, spectrum, rng) + rng.uniform(0.5, 1.0)))
    out = _placed(count, rng, phrases, (0.3, 1.2), 0.05)
    rattle = np.abs(out) * rng.standard_normal(count) * rng.uniform(0.03, 0.12)
    buzzer = rng.uniform(2000.0, 3100.0)
    peaks = [
        (buzzer, rng.uniform(6, 12), 1.0),
        (buzzer * rng.uniform(1.7, 2.4), rng.uniform(4, 10), rng.uniform(0.1, 0.4)),
        (rng.uniform(900, 1500), rng.uniform(1.5, 3.0), rng.uniform(0.2, 0.5)),
        (rng.uniform(380, 650), rng.uniform(2.0, 4.0), rng.uniform(0.2, 0.5)),
    ]
    heard = resonator(out + rattle, peaks, rng.uniform(0.1, 0.25))
    band = butter(1, [500.0, rng.uniform(7000, 11_000)], "bandpass", fs=SAMPLE_RATE, output="sos")
    return over_room_tone(sosfilt(band, heard), rng)


def _spun(count: int, rng: Generator, bursts: list[tuple[float, float]], top: float) -> Array:
    """Speed (revolutions per second) of a small motor that is switched on and off: it takes 40 to 110 ms to follow."""
    lag = rng.uniform(0.04, 0.11) * SAMPLE_RATE
    drive = gate(count, bursts, 0.001, 0.001) * top
    speed = np.asarray(lfilter([1 / lag], [1.0, 1 / lag - 1.0], drive + 1e-9))
    return speed * (1 + slow_curve(count, rng, 2.0, 0.01) + slow_curve(count, rng, 30.0, 0.004))


def _hops(rng: Generator, turn: Array, speed: Array, top: float) -> NDArray[np.float64]:
    """Impulses where the telephone lands: once in one or two revolutions, of chaotic strength, none at low speed."""
    landed = np.flatnonzero(np.diff(np.floor(turn / (2 * np.pi) + 0.15 * np.sin(0.137 * turn))) > 0)
    out = np.zeros(len(turn))
    if not len(landed):
        return out
    # The force grows with the square of the speed; below some speed the telephone stays on the table.
    force = np.maximum(0.0, (speed[landed] / top) ** 2 - 0.25)
    strength, state = np.empty(len(landed)), rng.uniform(0.2, 0.8)
    parameter = rng.uniform(3.45, 3.95)
    for number, noise in enumerate(rng.normal(0.0, 0.03, len(landed))):
        state = float(np.clip(parameter * state * (1 - state) + noise, 0.02, 0.98))
        strength[number] = state
    shifted = np.clip(landed + rng.normal(0, 0.0004 * SAMPLE_RATE, len(landed)).astype(int), 0, len(turn) - 1)
    np.add.at(out, shifted, force * strength)
    return out


def mobile_vibration_wood(count: int, rng: Generator) -> Array:
    """A silent mobile telephone on a wooden table: an unbalanced mass turns at 130–200 Hz and lets it hop.

    Unit: motor (speed, lag), table (modes 90–900 Hz), housing (modes 0.7–5 kHz), programme of the vibration. Take:
    chaotic strengths of the landings (logistic map near its period doublings, as a ball on a shaken plate), wandering
    over the table, keys or a cup beside it. The force of the unbalance grows with the square of the speed.
    """
    on, off = rng.uniform(0.5, 1.6), rng.uniform(0.5, 1.8)
    pulses = int(rng.integers(1, 4))
    bursts, now = [], -rng.uniform(0.0, on)
    while now * SAMPLE_RATE < count:
        for _ in range(pulses):
            bursts.append((now, now + on * rng.uniform(0.98, 1.02)))
            now += on + (0.25 if pulses > 1 else 0.0)
        now += off
    top = rng.uniform(130.0, 200.0)
    speed = _spun(count, rng, bursts, top)
    turn = phase_of(speed, count)
    shaken = (speed / top) ** 2
    hum = shaken * wave(turn, [1.0, 0.5, 0.3, 0.2, 0.15, 0.1, 0.08, 0.05], rng)
    hops = _hops(rng, turn, speed, top) * (1 + slow_curve(count, rng, 3.0, 0.3))
    table = [(f, rng.uniform(4, 10), 1.0 / np.sqrt(f / 200)) for f in np.exp(rng.uniform(np.log(90), np.log(900), 5))]
    shell = [(f, rng.uniform(8, 25), rng.uniform(0.3, 1.0)) for f, _, _ in case_modes(rng, 700.0, 5000.0, 6)]
    rattle = lfilter([1.0], [1.0, -np.exp(-1 / (rng.uniform(0.0006, 0.0018) * SAMPLE_RATE))], np.abs(hops))
    noise = sosfilt(butter(1, [1200.0, 8000.0], "bandpass", fs=SAMPLE_RATE, output="sos"), rng.standard_normal(count))
    brush = shaken * noise * rng.uniform(0.003, 0.012)
    out = resonator(0.03 * hum + hops, table, 0.05) + rng.uniform(0.6, 1.8) * resonator(hops, shell, 0.02)
    out = out + rng.uniform(0.05, 0.2) * rattle * noise + brush * float(np.std(out)) / 0.02
    band = butter(2, [90.0, rng.uniform(5000.0, 9000.0)], "bandpass", fs=SAMPLE_RATE, output="sos")
    return over_room_tone(sosfilt(band, out), rng)


def _bar(rng: Generator, pitch: float, seconds: float, hard: float) -> Array:
    """A tuned bar with its resonator: modes 1 : 4 : 9.5, the first rings longest; a soft mallet."""
    modes = [
        (pitch, rng.uniform(0.5, 0.9), 1.0),
        (pitch * rng.uniform(3.95, 4.05), rng.uniform(0.12, 0.25), 0.5 * hard),
        (pitch * rng.uniform(9.2, 10.0), rng.uniform(0.04, 0.09), 0.3 * hard),
    ]
    return strike([m for m in modes if m[0] < 14_000], seconds, rng, attack=1.5e-3 / hard)


def smartphone_marimba(count: int, rng: Generator) -> Array:
    """A smartphone: struck tuned bars in a lively pattern with a bass, and the vibration's hum on the table.

    Unit: pattern, tempo, mallet, loudspeaker, linear resonant actuator (150–235 Hz, in step with the pattern or not).
    Take: velocities of the notes, start, pauses, table. Source: Fletcher & Rossing (1998), chapter 19, bars.
    """
    root, beat = rng.uniform(300.0, 560.0), rng.uniform(0.1, 0.17)
    pattern = tune(rng, int(rng.integers(9, 17)))
    hard = rng.uniform(0.5, 1.4)
    phrases = []
    for _ in range(3):
        total = sum(length for _, length in pattern) * beat
        phrase, now = np.zeros(int((total + 0.3) * SAMPLE_RATE)), 0.0
        for number, (step, length) in enumerate(pattern):
            pitch = root * 2 ** (step / 12)
            start = int(now * SAMPLE_RATE)
            add_at(phrase, start, rng.uniform(0.7, 1.0) * _bar(rng, pitch, 0.7, hard))
            if number % 3 == 0:
                add_at(phrase, start, rng.uniform(0.4, 0.7) * _bar(rng, 2 * pitch, 0.5, hard))
                add_at(phrase, start, rng.uniform(0.3, 0.6) * _bar(rng, pitch / 2, 0.7, 0.6 * hard))
            now += length * beat
        phrases.append(phrase)
    sound = _placed(count, rng, phrases, (0.0, 0.9), 0.05)
    heard = loudspeaker(unit(sound), rng, (600.0, 1000.0), (0.005, 0.03))
    period = float(rng.choice([len(phrases[0]) / SAMPLE_RATE, 1.0, 1.5]))
    starts = np.arange(-1, count / SAMPLE_RATE / period + 1) * period + rng.uniform(0, period)
    buzz = gate(count, [(s, s + 0.5 * period) for s in starts], 0.02, 0.04)
    buzz *= wave(
        turning(count, rng, rng.uniform(150.0, 235.0), 0.003, 0.002),
        [1.0, 0.4, 0.3, 0.25, 0.2, 0.12, 0.1, 0.08],
        rng,
    )
    buzz = resonator(buzz, [(f, rng.uniform(4, 10), 1.0) for f in rng.uniform(250, 1400, 3)], 0.2)
    return over_room_tone(heard + rng.uniform(0.0, 0.25) * unit(buzz) * float(np.std(heard)), rng)
