"""Synthesis of the sounds of the seven categories.

A voice is a function (samples, Generator) → signal at `signals.SAMPLE_RATE`, of any level; its variant (speeds,
pitches, timbre, programme) is drawn from the Generator. No voice is ever silent: a pump, a fan, a refill or a ringing
body sounds in every second. Levels inside a voice are relative RMS or peak values, chosen by listening and by the
spectrogram.

Panels of these sizes radiate little sound below 100 Hz. Below 700 Hz the head causes hardly any interaural level
difference, so every machine has a large part of its energy above that frequency, as real machines do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from scipy.signal import fftconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.signals import (
    Array,
    add_at,
    band_noise,
    bubbles,
    drift,
    harmonics,
    phase_of,
    ramp,
    resonance,
    shelf,
    strike,
    time_axis,
    unit,
)


def washing_machine(count: int, rng: Generator) -> Array:
    """Drum turning back and forth: motor whine under load, rumble that beats with the drum, falling laundry, slosh."""
    seconds = count / SAMPLE_RATE
    turns = rng.uniform(0.7, 1.0)  # drum revolutions per second
    drive = rng.uniform(9.0, 13.0)  # motor revolutions per drum revolution
    # The drum runs one way for a few seconds, slows down, and runs the other way.
    times, speeds, now = [0.0], [1.0], 0.0
    while now < seconds + 1:
        run, pause = rng.uniform(6.0, 10.0), rng.uniform(0.5, 0.9)
        times += [now + run, now + run + 0.5, now + run + 0.5 + pause, now + run + 1.1 + pause]
        speeds += [1.0, 0.12, 0.12, 1.0]
        now += run + 1.1 + pause
    speed = ramp(count, times, speeds, soft=0.25)
    angle = phase_of(turns * speed, count)
    beat = 0.5 + 0.5 * np.cos(angle)
    rumble = band_noise(count, rng, 55, 190) * (0.35 + 0.65 * beat) * (0.25 + 0.75 * speed)
    rattle = band_noise(count, rng, 420, 1900) * (0.3 + 0.7 * beat**2) * (0.25 + 0.75 * speed)
    # Three ribs lift the laundry and let it drop.
    falls = np.zeros(count)
    ribs = np.flatnonzero(np.diff(np.floor(3 * angle / (2 * np.pi)))) if count > 1 else np.zeros(0, int)
    for start in ribs:
        weight = rng.uniform(0.3, 1.0) * float(speed[start])
        modes = [
            (f * rng.uniform(0.9, 1.1), d, a)
            for f, d, a in ((84, 0.24, 0.8), (160, 0.18, 0.8), (390, 0.1, 0.6), (920, 0.06, 0.4))
        ]
        add_at(falls, int(start + rng.integers(0, 2500)), weight * strike(modes, 0.4, rng, attack=4e-3))
    slosh_swing = 0.5 + 0.5 * np.cos(angle * 2 + 1.0 + drift(count, rng, 0.7, 0.8))
    slosh = band_noise(count, rng, 600, 3200) * slosh_swing**2.5 * (0.2 + 0.8 * speed)
    splash = bubbles(count, rng, 60.0 * slosh_swing**3 * speed + 3.0, (1.2, 7.0))
    pitch = turns * drive * 12 * speed * (1 + 0.03 * np.cos(angle) + drift(count, rng, 1.0, 0.004))
    motor = harmonics(phase_of(np.maximum(pitch, 12.0), count), [1, 0.5, 0.7, 0.25, 0.35, 0.1, 0.12, 0.06], rng)
    mains = harmonics(phase_of(50.0, count), [0.2, 1.0, 0.1, 0.5, 0.05, 0.2], rng)
    panel = resonance(motor + 0.3 * falls, rng.uniform(380, 620), 6.0)
    hiss = band_noise(count, rng, 900, 6500) * (0.5 + 0.5 * speed)
    return (
        0.55 * rumble
        + 0.40 * rattle
        + 0.80 * falls
        + 0.60 * slosh
        + 0.50 * splash
        + (0.14 * motor + 0.40 * panel) * (0.15 + 0.85 * speed)
        + 0.06 * mains
        + 0.32 * hiss
    )


def toilet(count: int, rng: Generator) -> Array:
    """Repeated flushes: a roar of falling water, the gulp of the siphon, the hiss of the refill."""
    out = np.zeros(count)
    body = rng.uniform(0.85, 1.25)  # bowl and pipe resonances
    now = -rng.uniform(0.0, 0.4)
    while now < count / SAMPLE_RATE:
        flush, refill = rng.uniform(3.5, 5.0), rng.uniform(8.0, 12.0)
        length = int((flush + refill) * SAMPLE_RATE)
        roar_env = ramp(length, [0, 0.25, 0.9, flush - 1.0, flush, flush + 1.2], [0.1, 1.0, 0.9, 0.7, 0.15, 0.0], 0.15)
        flutter = np.exp(drift(length, rng, 9.0, 0.28))
        low = band_noise(length, rng, 120 * body, 650 * body) * np.exp(drift(length, rng, 5.0, 0.4))
        high = band_noise(length, rng, 650 * body, 4800)
        roar = roar_env * flutter * (0.9 * low + 0.6 * high)
        rush = bubbles(length, rng, 160.0 * roar_env, (1.0, 6.0))
        gulp_env = ramp(length, [flush - 1.3, flush - 0.7, flush, flush + 0.9], [0.0, 1.0, 0.8, 0.0], 0.1)
        gulps = bubbles(length, rng, 26.0 * gulp_env, (6.0, 17.0))
        throat = resonance(band_noise(length, rng, 90, 900), 210 * body, 5.0)
        throat *= gulp_env * (0.5 + 0.5 * np.cos(phase_of(7.0 + drift(length, rng, 2.0, 1.2), length)))
        fill_env = ramp(
            length,
            [0.8, 2.0, flush + refill - 2.2, flush + refill - 0.25, flush + refill],
            [0.0, 1.0, 0.85, 0.35, 0.3],
            0.2,
        )
        hiss = band_noise(length, rng, 1700 * body, 8500) * np.exp(drift(length, rng, 12.0, 0.12))
        cistern = band_noise(length, rng, 320 * body, 1500 * body) * np.exp(drift(length, rng, 7.0, 0.2))
        # The float closes the valve: the pipe whistles higher and higher.
        whistle_pitch = ramp(
            length, [0, flush + refill - 3, flush + refill], [820 * body, 900 * body, 1750 * body], 0.3
        )
        whistle = harmonics(phase_of(whistle_pitch + drift(length, rng, 6.0, 9.0), length), [1.0, 0.25, 0.1], rng)
        whistle *= ramp(length, [flush + refill - 3.2, flush + refill - 1.2, flush + refill], [0.0, 1.0, 0.2], 0.2)
        trickle = bubbles(length, rng, 90.0 * fill_env, (0.7, 3.0))
        add_at(
            out,
            int(now * SAMPLE_RATE),
            roar
            + 0.5 * rush
            + 0.9 * gulps
            + 0.5 * throat
            + fill_env * (0.42 * hiss + 0.16 * cistern)
            + 0.06 * whistle
            + 0.4 * trickle,
        )
        now += flush + refill - 0.25
    return out


def vacuum_cleaner(count: int, rng: Generator) -> Array:
    """Universal motor and its fan blades over a roar of air; the pitch sags as the nozzle is pushed and pulled."""
    base = rng.uniform(210.0, 330.0)  # motor revolutions per second
    blades = int(rng.integers(7, 10))
    stroke = phase_of(rng.uniform(0.35, 0.6) * np.exp(drift(count, rng, 0.3, 0.15)), count)
    push = np.cos(stroke)
    pitch = base * (1.0 + 0.012 * push + drift(count, rng, 0.4, 0.006) + drift(count, rng, 14.0, 0.0008))
    phase = phase_of(pitch, count)
    # Universal motors have strong low orders; the impeller adds its blade-passing tone and the octave above.
    orders = np.array([1.0, 0.55, 0.22, 0.3, 0.1, 0.12, 0.05, 0.06])
    motor = harmonics(phase, orders, rng)
    whine = harmonics(phase * blades, [1.0, 0.35, 0.15], rng)
    swing = 1.0 + 0.25 * push
    rush = band_noise(count, rng, 300, 3800)
    hiss = band_noise(count, rng, 2200, 11_000, 1)
    tube = resonance(rush, rng.uniform(480, 760), 4.0) + 0.7 * resonance(rush, rng.uniform(1100, 1700), 5.0)
    floor = band_noise(count, rng, 60, 260) * (0.5 + 0.5 * np.abs(np.sin(stroke)))
    brush = band_noise(count, rng, 900, 2600) * np.abs(np.sin(stroke)) ** 1.5
    return (
        0.30 * motor
        + 0.16 * whine
        + 0.55 * swing * rush
        + 0.30 * (2.0 - swing) * hiss
        + 0.6 * tube
        + 0.25 * floor
        + 0.2 * brush
    )


def microwave(count: int, rng: Generator) -> Array:
    """Transformer and magnetron hum at twice the mains frequency, cooling fan, turntable; it pulses at part power."""
    mains = float(rng.choice([50.0, 60.0]))
    period, share = rng.uniform(9.0, 14.0), rng.uniform(0.6, 0.85)
    seconds = count / SAMPLE_RATE
    times, levels, now = [], [], rng.uniform(-0.4, 0.0) * period
    clicks = np.zeros(count)
    while now < seconds:
        times += [now, now + 0.08, now + share * period, now + share * period + 0.1]
        levels += [0.12, 1.0, 1.0, 0.12]
        for moment, strength in ((now, 1.0), (now + share * period, 0.6)):
            modes = [(180, 0.12, 1.0), (760, 0.05, 0.6), (2300, 0.02, 0.4)]
            add_at(clicks, int(moment * SAMPLE_RATE), strength * strike(modes, 0.2, rng))
        now += period
    power = ramp(count, times, levels, soft=0.06)
    # 100/120 Hz and its harmonics, the even ones stronger: a saturating core on a half-wave doubler.
    core = np.array([1.0, 0.8, 0.45, 0.55, 0.3, 0.42, 0.24, 0.34, 0.18, 0.26, 0.14, 0.2, 0.1, 0.15, 0.08, 0.1])
    levels_of = 0.7 * core * rng.uniform(0.7, 1.3, len(core))
    hum = harmonics(phase_of(2 * mains + drift(count, rng, 0.2, 0.02), count), levels_of, rng)
    half = harmonics(phase_of(mains, count), [0.6, 0.0, 0.35, 0.0, 0.2, 0.0, 0.1], rng)
    buzz = resonance(hum + half, rng.uniform(760, 1250), 3.5)
    fan_turns = rng.uniform(38.0, 46.0)
    fan_phase = phase_of(fan_turns * (1 + drift(count, rng, 0.5, 0.004)), count)
    blade = harmonics(fan_phase * int(rng.integers(5, 8)), [1.0, 0.4, 0.2], rng)
    air = band_noise(count, rng, 350, 2400, 1) * (1 + 0.12 * np.cos(fan_phase))
    hiss = band_noise(count, rng, 2000, 8000, 1)
    table = phase_of(rng.uniform(0.085, 0.1), count)
    rollers = band_noise(count, rng, 700, 2200) * (0.3 + 0.7 * np.abs(np.sin(1.5 * table)) ** 8)
    return (
        power * (0.30 * hum + 0.12 * half + 0.7 * buzz) * (1 + 0.08 * np.cos(table))
        + 0.55 * air
        + 0.45 * hiss
        + 0.14 * blade
        + 0.10 * rollers
        + 0.5 * clicks
    )


def coffee_machine(count: int, rng: Generator) -> Array:
    """Repeated espressos: vibrating pump, dripping and gurgling coffee, steam that froths the milk."""
    out = np.zeros(count)
    mains = float(rng.choice([50.0, 60.0]))
    body, cup = rng.uniform(300.0, 480.0), rng.uniform(1.0, 1.5)
    nozzle = rng.uniform(2600.0, 4200.0)
    now = -rng.uniform(0.0, 2.0)
    while now < count / SAMPLE_RATE:
        pump, drip, steam = rng.uniform(8, 12), rng.uniform(3.5, 5.5), rng.uniform(5, 8)
        total = pump + drip + steam
        length = int((total + 0.6) * SAMPLE_RATE)
        # The plunger is driven by half waves: a buzz with all harmonics, duller as the pressure builds up.
        pump_env = ramp(length, [0, 0.15, 2.5, pump - 0.2, pump], [0, 1.0, 0.75, 0.8, 0], 0.05)
        buzz = harmonics(
            phase_of(mains * (1 + drift(length, rng, 18.0, 0.01)), length), [k**-0.7 for k in range(1, 41)], rng
        )
        case = 0.12 * buzz + 1.6 * resonance(buzz, body, 5.0) + 1.8 * resonance(buzz, 2.6 * body, 6.0)
        chatter = band_noise(length, rng, 1400, 7500) * np.maximum(0, np.sin(phase_of(mains, length))) ** 4
        flow_env = ramp(length, [2.5, 4.0, pump, pump + drip - 1, pump + drip], [0.0, 0.7, 1.0, 0.6, 0.3], 0.2)
        drops = bubbles(length, rng, 45.0 * flow_env, (1.6 * cup, 6.0 * cup))
        gurgle_env = ramp(length, [pump, pump + 0.8, pump + drip, pump + drip + 0.7], [0.0, 1.0, 0.8, 0.0], 0.15)
        sputter = np.maximum(0.0, drift(length, rng, 11.0, 1.0)) ** 1.5
        gurgle = gurgle_env * sputter * resonance(band_noise(length, rng, 400, 4000), 1150 / cup, 1.5)
        plops = bubbles(length, rng, 22.0 * gurgle_env, (1.5 * cup, 7.0 * cup))
        steam_env = ramp(
            length, [pump + drip - 0.6, pump + drip + 0.3, total, total + 0.5], [0.06, 1.0, 0.9, 0.0], 0.12
        )
        hiss = band_noise(length, rng, nozzle, 13_000, 1) + 0.8 * resonance(
            band_noise(length, rng, 800, 9000), 0.6 * nozzle, 2.5
        )
        roll = np.exp(drift(length, rng, 18.0, 0.25))
        froth = band_noise(length, rng, 300, 1400) * np.exp(drift(length, rng, 24.0, 0.5))
        warm = band_noise(length, rng, 150, 900) * ramp(length, [0, 0.2, total, total + 0.5], [0, 1, 1, 0], 0.1)
        add_at(
            out,
            int(now * SAMPLE_RATE),
            pump_env * (0.24 * unit(case) + 0.40 * chatter)
            + 0.5 * drops
            + 0.6 * gurgle
            + 0.6 * plops
            + steam_env * roll * (0.30 * hiss + 0.22 * froth)
            + 0.02 * warm,
        )
        now += total + 0.15
    return out


def clock(count: int, rng: Generator) -> Array:
    """Tick and tock of an escapement in its case: two or three small strokes each, with a faint noise of the wheels."""
    beats = float(rng.choice([2.0, 2.5, 3.0, 4.0]))
    bright, wood = rng.uniform(0.8, 1.3), rng.uniform(0.8, 1.25)
    dry = np.zeros(count)

    def stroke(scale: float) -> Array:
        """Unlocking, impulse and drop of one beat (milliseconds apart), each a click with the case's modes."""
        out = np.zeros(int(0.2 * SAMPLE_RATE))
        for delay, force in ((0.0, 0.45), (0.0042, 0.3), (0.0095, 1.0)):
            modes = [
                (2450 * bright * scale, 0.035, 0.8),
                (3900 * bright * scale, 0.022, 0.7),
                (6100 * bright * scale, 0.012, 0.45),
                (920 * wood * scale, 0.07, 0.55),
                (430 * wood * scale, 0.12, 0.4),
            ]
            add_at(out, int(delay * SAMPLE_RATE), force * strike(modes, 0.16, rng, attack=1e-4))
        return out

    # A few recordings of each stroke, so that no two neighbours are the same to the sample.
    ticks = [stroke(1.0) for _ in range(4)]
    tocks = [stroke(0.86) for _ in range(4)]
    number, now = 0, rng.uniform(0.02, 0.2)
    while now * SAMPLE_RATE < count:
        kind = (ticks if number % 2 == 0 else tocks)[int(rng.integers(0, 4))]
        add_at(dry, int((now + rng.normal(0, 6e-4)) * SAMPLE_RATE), rng.uniform(0.85, 1.0) * kind)
        number += 1
        # The intervals of an escapement that is out of beat alternate slightly.
        now += (1.0 + (0.05 if number % 2 else -0.05)) / beats
    # The movement's plates and the case resonate: a faint diffuse tail that decays fast.
    tail_time = time_axis(int(0.5 * SAMPLE_RATE))
    tail = band_noise(len(tail_time), rng, 350 * wood, 5200 * bright) * np.exp(-6.91 * tail_time / 0.45)
    ringing = fftconvolve(dry, unit(tail) * 0.004)[:count]
    wheels = band_noise(count, rng, 1800, 6000) * (1 + 0.6 * np.cos(phase_of(beats * 7, count)))
    return dry + 0.8 * ringing + 0.0035 * wheels


def telephone(count: int, rng: Generator) -> Array:
    """A two-tone ring in bursts of about 0.7 s every second: an electronic warble or two gongs and a clapper."""
    on, period = rng.uniform(0.66, 0.74), 1.0
    seconds = count / SAMPLE_RATE
    low = rng.uniform(780.0, 1150.0)
    high = low * float(rng.choice([6 / 5, 5 / 4, 4 / 3]))
    out = np.zeros(count)
    start = -rng.uniform(0.0, 0.3)
    if rng.random() < 0.5:  # electronic: a rich tone switched between two pitches, through a piezo disc
        warble, vibrato = rng.uniform(14.0, 22.0), rng.uniform(5.0, 8.0)
        t = time_axis(count)
        square = np.tanh(6.0 * np.sin(2 * np.pi * warble * t))
        pitch = low + (high - low) * (0.5 + 0.5 * square)
        phase = phase_of(pitch * (1 + 0.035 * np.sin(2 * np.pi * vibrato * t)), count)
        tone = harmonics(phase, [0.7, 0.4, 0.6, 0.35, 0.45, 0.3, 0.3, 0.2], rng)
        piezo = rng.uniform(2600.0, 3600.0)
        tone = 0.6 * tone + 0.9 * resonance(tone, piezo, 1.5)
        starts = np.arange(-1, seconds + 1, period) + start
        times = [moment for s in starts for moment in (s, s + 0.012, s + on, s + on + 0.03)]
        gate = ramp(count, times, [0.0, 1.0, 1.0, 0.0] * len(starts), soft=0.004)
        out = gate * tone
        tail_time = time_axis(int(0.35 * SAMPLE_RATE))
        tail = band_noise(len(tail_time), rng, 500, 6000) * np.exp(-6.91 * tail_time / 0.3)
        out += 0.5 * fftconvolve(out, unit(tail) * 0.004)[:count]
    else:  # mechanical: the clapper hits two gongs in turn, each with its clank and its many partials
        rate = rng.uniform(20.0, 25.0)

        def gong(base: float) -> Array:
            modes = [
                (base * ratio * rng.uniform(0.985, 1.015), decay, level)
                for ratio, decay, level in (
                    (1.0, 0.7, 0.6),
                    (1.008, 0.6, 0.3),
                    (1.51, 0.45, 0.35),
                    (2.31, 0.4, 0.7),
                    (2.33, 0.4, 0.4),
                    (3.03, 0.3, 0.4),
                    (3.92, 0.25, 0.6),
                    (4.71, 0.2, 0.4),
                    (5.63, 0.15, 0.5),
                    (7.4, 0.1, 0.35),
                )
            ]
            ring = strike(modes, 0.8, rng)
            clank = band_noise(len(ring), rng, 1500, 9000) * np.exp(-6.91 * time_axis(len(ring)) / 0.02)
            return ring + 0.5 * clank

        # A few recordings of each gong: two strokes never excite the same mixture of partials.
        gongs = [[gong(base) for _ in range(4)] for base in (low, high)]
        for s in np.arange(-1, seconds + 1, period) + start:
            for hit in range(int(on * rate)):
                moment = s + hit / rate + rng.normal(0, 8e-4)
                kind = gongs[hit % 2][int(rng.integers(0, 4))]
                add_at(out, int(moment * SAMPLE_RATE), rng.uniform(0.75, 1.0) * kind)
    return unit(out) + 0.01 * band_noise(count, rng, 200, 4000)


#: Gain (dB) above about 1.5 kHz that is added to each voice, for the radiation of thin sheets and openings.
_BRIGHTNESS = {
    "washing_machine": 7.0,
    "toilet": 3.0,
    "microwave": 4.0,
    "coffee_machine": 7.0,
    "clock": 4.0,
    "telephone": 6.0,
}
VOICES: dict[str, Callable[[int, Generator], Array]] = {
    "washing_machine": washing_machine,
    "toilet": toilet,
    "vacuum_cleaner": vacuum_cleaner,
    "microwave": microwave,
    "coffee_machine": coffee_machine,
    "clock": clock,
    "telephone": telephone,
}


def speak(category: str, count: int, rng: Generator) -> Array:
    """``count`` samples of a category's voice with its brightness."""
    voice = VOICES[category](count, rng)
    gain = _BRIGHTNESS.get(category, 0.0)
    return shelf(voice, 1500.0, gain) if gain else voice
