"""A smartphone that vibrates on a hard table: its actuator swings on a spring, and the case chatters."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import Mode, case_modes, resonator, turning, wave
from generators.assets.sounds.room_tone import over_room_tone, slow_curve
from generators.assets.sounds.signals import Array

#: Least drive (share of the largest) at which the case leaves the table.
_LIFT = 0.45


def _pattern(count: int, rng: Generator) -> Array:
    """(count,) swing of a linear resonant actuator, 0 to 1, in a pattern of pulses that is repeated with rests.

    The sprung mass follows its drive with a time constant of 12 to 35 ms (model: Precision Microdrives AB-020).
    """
    number = int(rng.integers(2, 6))
    lengths = np.exp(rng.uniform(np.log(0.15), np.log(1.1), number))
    gaps = np.append(rng.uniform(0.05, 0.18, number - 1), rng.uniform(0.12, 0.36) * lengths.sum() + 0.05)
    levels = rng.uniform(0.65, 1.0, number)
    drive = np.zeros(count)
    now = -rng.uniform(0.0, lengths.sum() + gaps.sum())
    while now * SAMPLE_RATE < count:
        for length, gap, level in zip(lengths, gaps, levels, strict=True):
            begin, end = round(now * SAMPLE_RATE), round((now + length) * SAMPLE_RATE)
            drive[max(begin, 0) : max(end, 0)] = level * rng.uniform(0.97, 1.0)
            now += length + gap + rng.normal(0.0, 0.002)
    lag = rng.uniform(0.012, 0.035) * SAMPLE_RATE
    return np.asarray(lfilter([1 / lag], [1.0, 1 / lag - 1.0], drive + 1e-9))


def _landings(rng: Generator, swing: Array, frequency: float, excess: float) -> Array:
    """Impulses where one corner of the case lands on the table.

    Model: the map of a ball on a shaken plate, P. J. Holmes, Journal of Sound and Vibration 84 (1982) 173–189: phase
    θ' = θ + φ and speed φ' = αφ − γ cos(θ + φ), restitution α. A corner that has come to rest waits for the next swing.
    ``excess`` is the table's acceleration re gravity at the largest swing.
    """
    out = np.zeros(len(swing))
    restitution = rng.uniform(0.25, 0.55)
    gamma = 2.0 * (1.0 + restitution) * excess
    rate = 2 * np.pi * frequency / SAMPLE_RATE
    phase, speed = rng.uniform(0.0, 2 * np.pi), 3.0
    while (place := int(phase / rate)) < len(swing):
        level = float(swing[place])
        if level < _LIFT or speed < 0.6:
            # At rest until about the same point of the next period.
            phase += 2 * np.pi * rng.uniform(0.85, 1.15)
            speed = rng.uniform(0.3, 0.9) * gamma * level if level >= _LIFT else 0.0
            continue
        out[place] += speed * rng.choice([0.9, 1.0]) * np.exp(rng.normal(0.0, 0.12))
        phase += speed
        speed = restitution * rng.uniform(0.9, 1.1) * speed - gamma * level * float(np.cos(phase))
        speed = min(speed, 9.0)
    return out


def _table(rng: Generator) -> tuple[list[Mode], float]:
    """Resonances (frequency, quality, gain) of what lies under the telephone, and the time (s) of a contact with it.

    A stone slab has few, damped ones; a pane of glass on a frame many that ring; a tray or plate of ceramics a few high
    ones. A soft case lengthens the contact.
    """
    kind = int(rng.integers(0, 3))
    low, high, number, quality = ((350, 2200, 4, (3, 9)), (180, 3800, 9, (15, 45)), (700, 5200, 6, (12, 40)))[kind]
    places = np.exp(rng.uniform(np.log(low), np.log(high), number))
    found = [(float(f), float(rng.uniform(*quality)), float(rng.uniform(0.3, 1.0) * (low / f) ** 0.3)) for f in places]
    return found, float(np.exp(rng.uniform(np.log(1.0e-4), np.log(6.0e-4))))


def smartphone_on_stone(count: int, rng: Generator) -> Array:
    """A silent smartphone on stone, glass or ceramics: a linear resonant actuator of 150–235 Hz makes it chatter.

    Unlike an unbalanced motor, the actuator keeps its frequency and is there and gone within some hundredths of a
    second; the hard table answers with sharp landings (`_landings`) of two or three corners instead of a hum.
    Unit: actuator, pattern of pulses, corners, case, table. Take: landings, the telephone's slow turning on the table
    (the corners' shares), a spoon, coin or key that jingles beside it.
    """
    frequency, swing = rng.uniform(150.0, 235.0), _pattern(count, rng)
    table, contact = _table(rng)
    hum = swing * wave(turning(count, rng, frequency, 5e-4, 3e-4), [1.0, 0.35, 0.25, 0.12, 0.1, 0.06, 0.05, 0.04], rng)
    edge = np.exp(-1.0 / (contact * SAMPLE_RATE))
    blows, clatter = np.zeros(count), np.zeros(count)
    for _ in range(int(rng.integers(2, 4))):
        landed = _landings(rng, swing, frequency, rng.uniform(1.1, 2.2))
        landed = landed * np.exp(slow_curve(count, rng, 0.8, 0.35) + slow_curve(count, rng, 25.0, 0.15))
        soft = lfilter([1.0 - edge], [1.0, -edge], landed + 1e-15)
        shell = [(f, rng.uniform(8, 28), a) for f, _, a in case_modes(rng, 800.0, 6500.0, 4)]
        blows += soft
        clatter += resonator(soft, shell, 0.03)
    out = resonator(blows, table, 0.05) + rng.uniform(0.4, 1.3) * clatter
    scale = float(np.std(out)) + 1e-12
    grit = sosfilt(butter(1, [1000.0, 8000.0], "bandpass", fs=SAMPLE_RATE, output="sos"), rng.standard_normal(count))
    tail = np.exp(-1.0 / (rng.uniform(0.001, 0.003) * SAMPLE_RATE))
    rubbing = lfilter([1.0], [1.0, -tail], blows + 1e-15) * grit
    out = out + rng.uniform(0.1, 0.35) * scale * rubbing / (float(np.std(rubbing)) + 1e-12)
    if rng.random() < 0.4:
        ringing = [(f, rng.uniform(40, 120), 1.0) for f in np.exp(rng.uniform(np.log(2200), np.log(8500), 4))]
        beside = blows * (rng.random(count) < rng.uniform(0.1, 0.5)) * np.exp(slow_curve(count, rng, 3.0, 0.6))
        jingle = resonator(beside, ringing, 0.0)
        out = out + rng.uniform(0.15, 0.5) * scale * jingle / (float(np.std(jingle)) + 1e-12)
    out = out + rng.uniform(0.25, 0.9) * scale * hum / (float(np.std(hum)) + 1e-12)
    band = butter(1, [110.0, rng.uniform(6000.0, 11_000.0)], "bandpass", fs=SAMPLE_RATE, output="sos")
    return over_room_tone(sosfilt(band, out), rng)
