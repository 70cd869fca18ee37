"""Telephones with tone-ringer circuits, and office sets that play a stored waveform."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, resample_poly, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import (
    FRANCE,
    GERMANY,
    NORTH_AMERICA,
    UNITED_KINGDOM,
    Rings,
    cadence,
    gate,
    loudspeaker,
    piezo,
    turning,
    unsteady,
    wave,
)
from generators.assets.sounds.room_tone import over_room_tone, slow_curve
from generators.assets.sounds.signals import Array, add_at, phase_of, time_axis, unit

_NETWORKS = ((UNITED_KINGDOM, 25.0), (NORTH_AMERICA, 20.0), (GERMANY, 25.0), (FRANCE, 50.0))


def _square(rng: Generator, highest: float, duty: float) -> Array:
    """Amplitudes of a pulse wave's harmonics up to 15 kHz, its edges rounded."""
    orders = np.arange(1, max(2, int(15_000.0 / highest)) + 1)
    fall = np.exp(-orders * highest / rng.uniform(12_000.0, 30_000.0))
    return np.asarray(np.abs(np.sin(np.pi * orders * duty)) / orders * fall)


def _switched(count: int, rng: Generator, warble: float, share: float) -> Array:
    """(count,) 1 or 0: a switching oscillator that drifts, high for ``share`` of its period, edges of 1 ms."""
    turn = phase_of(warble * unsteady(count, rng, 0.01, 0.006), count, rng.uniform(0, 6.28)) / (2 * np.pi)
    place = np.mod(turn, 1.0)
    edge = 1e-3 * warble
    return np.clip(np.minimum(place, share - place) / edge + 0.5, 0.0, 1.0)


def _bursts(count: int, rings: Rings) -> list[tuple[int, int]]:
    """(first sample, samples) of each burst within ``count``."""
    found = []
    for a, b in rings.bursts:
        first, last = max(0, round(a * SAMPLE_RATE)), min(count, round(b * SAMPLE_RATE))
        if last - first > 64:
            found.append((first, last - first))
    return found


def ringer_ic_piezo(count: int, rng: Generator) -> Array:
    """A two-tone ringer on a piezo disc: f1 and 0.725 f1 in a fast sequence, fed by the rectified ringing current.

    Unit: f1 (1.05–2.3 kHz), switching rate 750/C1 with C1 of 47–100 nF, duty, disc and cap, network. Take: drift of
    the relaxation oscillators, supply that charges at the start of each burst, ripple at twice the ringing current.
    Source: datasheet of the LS1240A (STMicroelectronics, 1998).
    """
    pattern, current = _NETWORKS[int(rng.integers(0, len(_NETWORKS)))]
    rings = cadence(count, rng, pattern)
    high = np.exp(rng.uniform(np.log(1050.0), np.log(2300.0)))
    ratio = 0.725 * rng.uniform(0.98, 1.02)
    warble = 750.0 / rng.uniform(47.0, 100.0)
    spectrum = _square(rng, high, rng.uniform(0.42, 0.5))
    tilt, ripple, slump = rng.uniform(0.03, 0.12), rng.uniform(0.03, 0.2), rng.uniform(0.01, 0.04)
    out = np.zeros(count)
    for first, length in _bursts(count, rings):
        t = time_axis(length)
        charge = 1 - np.exp(-t / tilt)
        pitch = high * (ratio + (1 - ratio) * _switched(length, rng, warble, 0.5))
        pitch *= (1 - slump * np.exp(-t / tilt)) * unsteady(length, rng, 0.001, 0.0015)
        tone = wave(phase_of(pitch, length), spectrum, rng)
        pulsing = 1 + ripple * np.sin(turning(length, rng, 2 * current, 0.003, 0.002))
        fade = np.minimum(1.0, t[::-1] / 0.012)
        add_at(out, first, charge * pulsing * fade * tone)
    hiss = np.abs(out) * rng.standard_normal(count) * rng.uniform(0.01, 0.05)
    return over_room_tone(piezo(out + hiss, rng, (1700.0, 3400.0)), rng)


def ringer_ic_speaker(count: int, rng: Generator) -> Array:
    """A ringer with divided tones, f0/4 and f0/5, on a loudspeaker; its supply is not smoothed: trains of pulses.

    Unit: f0 (2.4–4.4 kHz, so tones of 480–1100 Hz), warble f0/320 or f0/640, loudspeaker, ringing current, share of
    each half wave in which the supply suffices. Take: drift, level of each half wave.
    Source: datasheet of the MC34012 (Motorola): tones, divisors, thresholds with hysteresis.
    """
    pattern, current = _NETWORKS[int(rng.integers(0, len(_NETWORKS)))]
    rings = cadence(count, rng, pattern, (3, 7))
    clock = rng.uniform(2400.0, 4400.0)
    divisor = float(rng.choice([320.0, 640.0]))
    threshold, uneven = rng.uniform(0.15, 0.55), rng.uniform(0.0, 0.3)
    spectrum = _square(rng, clock / 4, rng.uniform(0.48, 0.5))
    out = np.zeros(count)
    for first, length in _bursts(count, rings):
        drifting = clock * unsteady(length, rng, 0.0015, 0.001)
        high = _switched(length, rng, clock / divisor, 0.5)
        tone = wave(phase_of(drifting * (0.2 + 0.05 * high), length), spectrum, rng)
        ac = np.sin(turning(length, rng, current, 0.004, 0.004))
        supply = np.clip((np.abs(ac) * (1 - uneven * (ac > 0)) - threshold) / (1 - threshold) * 3.0, 0.0, 1.0)
        supply *= 1 + slow_curve(length, rng, 2 * current, 0.06)
        add_at(out, first, tone * supply * np.minimum(1.0, time_axis(length)[::-1] / 0.01))
    return over_room_tone(loudspeaker(unit(out), rng, (380.0, 700.0), (0.02, 0.08)), rng)


def _companded(signal: Array) -> Array:
    """The signal (peak below 1) after 8 bits of µ-law (ITU-T G.711; the continuous curve, µ = 255)."""
    coded = np.sign(signal) * np.log1p(255.0 * np.abs(signal)) / np.log(256.0)
    coded = np.round(coded * 127.0) / 127.0
    return np.asarray(np.sign(coded) * np.expm1(np.abs(coded) * np.log(256.0)) / 255.0)


def _stored(rng: Generator, seconds: float, rate: int = 8000) -> Array:
    """A ring as a set holds it, at 8 kHz: struck mixtures of tones, either trilling or in groups of pulses."""
    t = np.arange(int(seconds * rate)) / rate
    base = rng.uniform(420.0, 900.0)
    tones = base * np.cumprod(np.concatenate([[1.0], rng.uniform(1.12, 1.5, 4)]))
    tones = tones[tones < 3300.0]
    levels = rng.uniform(0.3, 1.0, len(tones))
    trill = rng.uniform(13.0, 24.0)
    place = np.mod(t * trill, 1.0)
    fall = np.exp(-place * rng.uniform(0.6, 2.5)) * np.minimum(1.0, place * rng.uniform(12, 40))
    second = np.floor(t * trill) % 2
    out = np.zeros(len(t))
    for number, (tone, level) in enumerate(zip(tones, levels, strict=True)):
        odd = 1.0 if number == 0 else (second if number % 2 else 1 - second)
        out += level * odd * np.sin(2 * np.pi * tone * t + rng.uniform(0, 6.28))
    if rng.random() < 0.5:
        period = rng.uniform(0.16, 0.32)
        fall = fall * (np.mod(t, period) < rng.uniform(0.5, 0.8) * period)
    fade = np.minimum(1.0, np.minimum(t, t[::-1]) / rng.uniform(0.01, 0.06))
    out *= fall * fade
    return np.asarray(0.8 * out / np.abs(out).max())


def voip_office(count: int, rng: Generator) -> Array:
    """An office set: a stored ring of 8 kHz and 8 bits through the loudspeaker of the hands-free set.

    Unit: the stored waveform (mixtures that trill at 13–24 Hz or pulses), its pauses (no ringing current comes to a set
    on a data network: it repeats the file, with rings that are single for internal calls, double or triple for others,
    and pauses that are shorter than an exchange's), loudspeaker and chassis, volume. Take: which cadence a call has,
    the chassis' rattle, level of each ring, delay of the network's message.
    Source: ITU-T G.711 (1988) companding; the reconstruction filter leaves a little of the images above 4 kHz.
    """
    patterns = ((2.0, 1.0), (0.9, 0.2, 0.9, 0.8), (1.6, 0.8), (0.6, 0.15, 0.6, 0.15, 0.6, 0.8))
    first, other = (patterns[int(k)] for k in rng.choice(len(patterns), 2, replace=False))
    wave = _stored(rng, 2.1)
    leak = rng.uniform(0.01, 0.06)
    # Zero-order hold leaves images; the filter of the converter takes most of them.
    held = np.repeat(_companded(wave), 441)[::80]
    smooth = resample_poly(_companded(wave), 441, 80)
    size = min(len(held), len(smooth))
    played = smooth[:size] + leak * sosfilt(butter(2, 4200.0, "highpass", fs=SAMPLE_RATE, output="sos"), held[:size])
    out = np.zeros(count)
    for a, b in cadence(count, rng, first if rng.random() < 0.6 else other, (2, 5)).bursts:
        length = min(len(played), max(1, int((b - a) * SAMPLE_RATE)))
        fade = np.minimum(1.0, np.arange(length)[::-1] / 200.0)
        add_at(out, round(a * SAMPLE_RATE), np.exp(rng.normal(0.0, 0.03)) * played[:length] * fade)
    sounding = gate(count, [(0.0, count / SAMPLE_RATE)], 0.01, 0.01)
    out = unit(out) * sounding * (1 + slow_curve(count, rng, 6.0, 0.02))
    return over_room_tone(loudspeaker(out, rng, (260.0, 480.0), (0.03, 0.12)), rng)


def warbling_caller(count: int, rng: Generator) -> Array:
    """An electronic tone caller of the 1960s: one oscillator near 2 kHz, gated by the ringing current, that swells.

    The current of 17 to 50 Hz, rectified by half or whole waves, feeds the oscillator, whose pitch follows it a little;
    a capacitor charges in the first second, so each ring grows. Model: the British Telephone No. 712 ("Trimphone",
    1965), whose caller warbled so. Unit: pitch, rectifier, swelling, capsule. Take: cadence, drift, half waves.
    """
    pattern, current = _NETWORKS[int(rng.integers(0, len(_NETWORKS)))]
    current = rng.uniform(0.85, 1.0) * current
    rings = cadence(count, rng, pattern, (3, 7))
    pitch, bend, smooth = rng.uniform(1500.0, 2500.0), rng.uniform(0.005, 0.06), rng.uniform(0.0, 0.6)
    whole, charge = rng.random() < 0.5, rng.uniform(0.3, 2.5)
    spectrum = _square(rng, pitch, rng.uniform(0.3, 0.5))
    out = np.zeros(count)
    for first, length in _bursts(count, rings):
        ac = np.sin(turning(length, rng, current, 0.004, 0.003))
        half = np.abs(ac) if whole else np.maximum(ac, 0.0)
        supply = smooth + (1.0 - smooth) * half * (1 + slow_curve(length, rng, 2 * current, 0.06))
        tone = wave(
            phase_of(pitch * (1.0 + bend * (half - 0.5)) * unsteady(length, rng, 0.001, 0.001), length), spectrum, rng
        )
        swell = 1.0 - 0.7 * np.exp(-time_axis(length) / charge)
        add_at(out, first, tone * supply * swell * np.minimum(1.0, time_axis(length)[::-1] / 0.01))
    if rng.random() < 0.5:
        return over_room_tone(loudspeaker(unit(out), rng, (500.0, 1100.0), (0.01, 0.06)), rng)
    return over_room_tone(piezo(out, rng, (1600.0, 2800.0)), rng)
