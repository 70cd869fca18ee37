"""Clocks with an escapement: pendulums, balance wheels, and what they release: gongs, bells, a cuckoo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.machines import (
    CONTROL_RATE,
    VibratingBody,
    bar_or_bell,
    bursts,
    control_count,
    course,
    drummed,
    expand,
    plate,
    sine,
    sloped,
    struck,
    turned,
    wander,
)
from generators.assets.sounds.signals import Array

#: Strokes (s) of one beat after its first, and their forces relative to the drop.
Strokes = tuple[Array, Array]


def beats(count: int, rng: Generator, interval: float, error: float, teeth: int, uneven: float) -> Array:
    """Times (s) of an oscillator's beats.

    Model: intervals alternate by ``error`` (out of beat), the escape wheel's teeth have their own errors (deviation
    ``uneven`` seconds, repeated every turn of ``teeth`` double beats, as its drops are measured by a timing machine),
    the train's force and so the interval wanders, and each release is random by a fifth of ``uneven``.
    """
    number = int(count / SAMPLE_RATE / interval * 1.05) + 4
    index = np.arange(number)
    wheel = rng.normal(0, uneven, 2 * teeth)
    wheel += uneven * np.sin(2 * np.pi * np.arange(2 * teeth) / (2 * teeth) + rng.uniform(0, 6.28))
    slow = np.cumsum(rng.normal(0, 1.0, number)) / np.sqrt(number)
    times = interval * index * (1.0 + 0.0004 * slow) + 0.25 * error * (-1.0) ** index
    times += wheel[(index + int(rng.integers(2 * teeth))) % (2 * teeth)] + rng.normal(0, 0.2 * uneven, number)
    return np.asarray(times + rng.uniform(0.02, 0.9) * interval)


def ticking(
    count: int,
    rng: Generator,
    times: Array,
    strokes: Strokes,
    bodies: Sequence[tuple[VibratingBody, float, float]],
    teeth: int,
    wear: float = 0.12,
) -> Array:
    """Beats as strokes of the escapement into bodies (body, contact in s, gain); tick and tock differ in each stroke.

    The drop falls on another tooth each time, so forces have a pattern (deviation ``wear``, natural logarithm) that
    repeats with the wheel, and a random part.
    """
    delays, forces = strokes
    index = np.arange(len(times))
    pattern = np.exp(rng.normal(0, wear, 2 * teeth))[index % (2 * teeth)]
    sides = np.exp(rng.normal(0, 0.3, (2, len(delays))))[index % 2]
    strength = forces * sides * pattern[:, None] * np.exp(rng.normal(0, 0.13, (len(times), len(delays))))
    moments = times[:, None] + delays * np.exp(rng.normal(0, 0.04, (len(times), len(delays))))
    out = np.zeros(count)
    for body, contact, gain in bodies:
        out += gain * struck(count, rng, body, moments.ravel(), strength.ravel(), contact, 0.3)
    return out


def lever_strokes(rng: Generator, frequency: float, amplitude: float, lift: float) -> Strokes:
    """Unlocking, impulse and drop of a lever or pin-lever escapement.

    The time from the first to the last is that in which a balance of ``amplitude`` (degrees) and ``frequency`` (Hz)
    passes the lift angle: t = 2·asin(lift/2/amplitude)/(2π·frequency), the relation by which timing machines tell the
    amplitude from the sound. The drop is the loudest, the impulse the softest.
    """
    whole = 2.0 * np.arcsin(lift / 2 / amplitude) / (2 * np.pi * frequency)
    delays = whole * np.array([0.0, rng.uniform(0.3, 0.45), 1.0, 1.0 + rng.uniform(0.06, 0.16)])
    return delays, np.array([rng.uniform(0.25, 0.5), rng.uniform(0.12, 0.3), 1.0, rng.uniform(0.2, 0.5)])


def recoil_strokes(rng: Generator, recoil: float) -> Strokes:
    """Drop of a tooth on an anchor's pallet, bounces of the train's backlash, the end of the recoil ``recoil`` s later.

    Source: A. L. Rawlings, The Science of Clocks and Watches (2nd ed. 1948): the wheel drops on the pallet, is pushed
    back while the pendulum goes on, and returns; M. V. Headrick, IEEE Control Systems Magazine 22 (2002) 41–52.
    """
    bounces = np.cumsum(rng.uniform(0.004, 0.012) * np.array([1.0, 0.7, 0.5]))
    delays = np.concatenate([[0.0], bounces, [recoil]])
    return delays, np.array([1.0, 0.35, 0.16, 0.08, rng.uniform(0.06, 0.16)])


def movement_noise(count: int, rng: Generator, low: float, slope: float) -> Array:
    """Faint broadband noise of wheels under load, and of the room in which a clock is heard."""
    return sloped(count, rng, low, 7000, slope) * expand(np.exp(wander(count, rng, 2.0, 0.15)), count)


def scrape(count: int, rng: Generator, times: Array, lasting: float, low: float) -> Array:
    """Noise of sliding between pallet and tooth (or hammer and spring) after each beat."""
    level = np.exp(rng.normal(0, 0.3, len(times)))
    return sloped(count, rng, low, 6000, -3.0) * expand(bursts(count, times, level, 0.01, lasting), count)


def longcase(count: int, rng: Generator) -> Array:
    """Longcase clock: a seconds pendulum with a recoil anchor of 30 teeth in a tall wooden case.

    The drop's click is short and of metal, the case answers as a deep knock; the recoil ends .1–.25 s later with a
    second, soft contact and a scrape.
    """
    interval = rng.uniform(0.96, 1.04)
    times = beats(count, rng, interval, rng.uniform(0.0, 0.08), 30, 0.0012)
    strokes = recoil_strokes(rng, rng.uniform(0.1, 0.25))
    movement = plate(rng, 900, 12_000, 34, 0.014, slope=1.0)
    case = plate(rng, 110, 1500, 26, rng.uniform(0.025, 0.05), slope=-0.8)
    seat = plate(rng, 500, 3200, 18, 0.03)
    # The hood has sound frets, openings behind cloth that let the clicks of the movement out.
    bodies = ((movement, 2.5e-5, 1.9), (case, 7e-4, rng.uniform(0.3, 0.6)), (seat, 1.5e-4, 1.0))
    out = ticking(count, rng, times, strokes, bodies, 30)
    return np.asarray(
        out + 0.02 * scrape(count, rng, times + 0.05, 0.2, 900) + 0.006 * movement_noise(count, rng, 120, -4.5)
    )


def kitchen_timer(count: int, rng: Generator) -> Array:
    """Kitchen timer: a pin-lever movement of 4–5.5 beats a second, thin brass in a plastic shell, loud and uneven.

    Balance of about 2–2.7 Hz with a small amplitude (110–190°); the escape wheel of 10–13 teeth runs out of true, so
    the loudness goes round once in some 5 s; the dial's spring creaks. It never rings within a take.
    """
    rate = rng.uniform(4.0, 5.5)
    teeth = int(rng.integers(10, 14))
    times = beats(count, rng, 1.0 / rate, rng.uniform(0.0, 0.04), teeth, 0.0016)
    strokes = lever_strokes(rng, rate / 2, rng.uniform(110, 190), 60.0)
    works = plate(rng, 1600, 9000, 26, 0.02, slope=0.5)
    shell = plate(rng, 420, 4200, 22, rng.uniform(0.035, 0.06), slope=-0.5)
    out = ticking(count, rng, times, strokes, ((works, 4e-5, 1.0), (shell, 2e-4, rng.uniform(1.0, 2.0))), teeth, 0.25)
    swing = 1.0 + 0.3 * np.sin(2 * np.pi * np.arange(control_count(count)) / CONTROL_RATE * rate / (2 * teeth))
    creaks = np.cumsum(rng.exponential(3.0, count // 44_100 + 8))
    out += 0.25 * struck(count, rng, shell, creaks, np.exp(rng.normal(-1.0, 0.6, len(creaks))), 1e-4, 0.6)
    return np.asarray(out * expand(swing, count) + 0.02 * movement_noise(count, rng, 500, -3.0))


def carriage_lever(count: int, rng: Generator) -> Array:
    """Carriage clock: a jewelled lever platform of 18,000 beats an hour (some 16,200 or 14,400), brass and glass.

    Light, clean strokes of high pitch; glass panes ring faintly; three strokes are apart by 9–16 ms (`lever_strokes`).
    """
    rate = float(rng.choice([5.0, 4.5, 4.0])) * (1.0 + rng.normal(0, 0.0008))
    times = beats(count, rng, 1.0 / rate, rng.uniform(0.0, 0.003), 15, 0.00025)
    strokes = lever_strokes(rng, rate / 2, rng.uniform(200, 290), 52.0)
    platform = plate(rng, 2800, 12_500, 30, 0.01, slope=-0.5)
    frame = plate(rng, 700, 5200, 20, 0.006, slope=-0.5)
    panes = plate(rng, 900, 3800, 10, 0.012)
    bodies = ((platform, 1.5e-5, 1.0), (frame, 8e-5, rng.uniform(0.6, 1.1)), (panes, 1.2e-4, rng.uniform(0.3, 0.6)))
    out = ticking(count, rng, times, strokes, bodies, 15)
    return np.asarray(out + 0.012 * movement_noise(count, rng, 400, -3.0))


def strikes(count: int, rng: Generator, apart: tuple[float, float], spacing: tuple[float, float]) -> list[Array]:
    """Times (s) of the blows of each strike: up to twelve, at an even pace that a fly governs."""
    found: list[Array] = []
    now = rng.uniform(-6.0, 0.5 * apart[1])
    while not found or now < count / SAMPLE_RATE:
        step = rng.uniform(*spacing)
        blows = now + step * np.arange(int(rng.integers(2, 13))) * (1 + 0.004 * rng.normal())
        found.append(blows + rng.normal(0, 0.006, len(blows)))
        now = float(blows[-1]) + rng.uniform(*apart)
    return found


def sounding(count: int, groups: Sequence[Array], edges: tuple[float, float, float, float], soft: float) -> Array:
    """Control curve that rises and falls round each group of times: from and to ``edges`` about its first and last."""
    times = [[g[0] + edges[0], g[0] + edges[1], g[-1] + edges[2], g[-1] + edges[3]] for g in groups]
    return course(count, np.concatenate(times).tolist(), [0.0, 1.0, 1.0, 0.0] * len(groups), soft)


def mantel_striking(count: int, rng: Generator) -> Array:
    """Mantel clock: a short pendulum of 1.6–2.4 beats a second, and an hour strike on a coiled gong or on rods.

    Gong: a clamped rod or wire rings at (k − ½)²-like ratios 1 : 6.27 : 17.5 : 34.4 (N. H. Fletcher, T. D. Rossing,
    The Physics of Musical Instruments, 1998, bars), its fundamental weakly radiated; the coil and clamp add partials in
    between. Before and between the blows the fly whirrs and the hammer's tail is lifted by pins.
    """
    rate = rng.uniform(1.6, 2.4)
    times = beats(count, rng, 1.0 / rate, rng.uniform(0.0, 0.06), 36, 0.001)
    movement = plate(rng, 1100, 11_500, 28, 0.014, slope=0.2)
    case = plate(rng, 200, 2200, 24, rng.uniform(0.02, 0.035), slope=-0.5)
    bodies = ((movement, 3.5e-5, 1.3), (case, 4e-4, 0.8))
    out = ticking(count, rng, times, recoil_strokes(rng, rng.uniform(0.05, 0.12)), bodies, 36)
    base = rng.uniform(55, 90)
    ratios = np.concatenate([[6.27, 17.55, 34.4, 56.8, 84.9], rng.uniform(4.0, 100.0, 15)])
    gong = bar_or_bell(rng, base, np.sort(ratios).tolist(), rng.uniform(7.0, 12.0), 0.45)
    struck_hours = strikes(count, rng, (14.0, 40.0), (1.2, 2.0))
    blows = np.concatenate(struck_hours)
    force = 0.35 * np.exp(rng.normal(0, 0.12, len(blows)))
    out += drummed(count, rng, gong, blows, force, 1.2e-4, 0.3)
    out += struck(count, rng, case, blows, 0.4 * force, 8e-4, 0.3)
    out += struck(count, rng, movement, blows - rng.uniform(0.25, 0.4), 0.5 * force, 1e-4, 0.4)
    whirr = sounding(count, struck_hours, (-0.9, -0.6, 0.0, 0.5), 0.2)
    fly = turned(rng.uniform(9.0, 14.0) * (1.0 + wander(count, rng, 1.0, 0.03)))
    buzz = sloped(count, rng, 900, 5000, -3.0) * expand(whirr * (1.0 + 0.7 * np.sin(2 * np.pi * fly)), count)
    return np.asarray(out + 0.03 * buzz + 0.01 * movement_noise(count, rng, 180, -4.0))


def twin_bell_alarm(count: int, rng: Generator) -> Array:
    """Twin-bell alarm clock: a pin lever of 200 beats a minute (some 240) in a tin case; at times the alarm rings.

    A hammer swings between two bells 11–16 times a second, driven by an escapement of its own whose rate falls as the
    spring unwinds. Bells of spun steel: partials of shallow shells (Fletcher and Rossing 1998), each a doublet.
    """
    rate = float(rng.choice([200.0, 240.0, 212.0])) / 60 * (1.0 + rng.normal(0, 0.002))
    times = beats(count, rng, 1.0 / rate, rng.uniform(0.0, 0.02), 15, 0.0009)
    works = plate(rng, 1300, 9500, 26, 0.012, slope=-0.3)
    tin = plate(rng, 350, 3500, 22, 0.02, slope=-0.5)
    strokes = lever_strokes(rng, rate / 2, rng.uniform(170, 250), 60.0)
    ticks = ticking(count, rng, times, strokes, ((works, 4e-5, 1.0), (tin, 2e-4, 1.0)), 15)
    base = rng.uniform(1300, 1900)
    partials = (1.0, 2.35, 3.1, 4.2, 5.7, 6.6, 8.0)
    pitches = (base, base * rng.uniform(1.04, 1.2))
    shells = [bar_or_bell(rng, pitch, partials, rng.uniform(0.7, 1.4), 0.7) for pitch in pitches]
    blows, force, now = [np.zeros(0)], [np.zeros(0)], rng.uniform(-8.0, 30.0)
    while now < count / SAMPLE_RATE:
        length, first = rng.uniform(7.0, 14.0), rng.uniform(13.0, 16.0)
        pace = first * (1.0 - 0.25 * np.linspace(0, 1, int(length * first)) ** 2)
        moments = now + np.cumsum(np.exp(rng.normal(0, 0.04, len(pace))) / pace)
        blows.append(moments)
        force.append((pace / first) ** 2 * np.exp(rng.normal(0, 0.25, len(pace))))
        now = float(moments[-1]) + rng.uniform(20.0, 45.0)
    all_blows, all_force = np.concatenate(blows), np.concatenate(force)
    out = 2.2 * ticks
    for side, shell in enumerate(shells):
        mine = np.arange(len(all_blows)) % 2 == side
        out += 0.3 * drummed(count, rng, shell, all_blows[mine], all_force[mine], 9e-5, 0.4)
    out += 0.35 * drummed(count, rng, tin, all_blows, all_force, 2e-4, 0.4)
    return np.asarray(out + 0.03 * movement_noise(count, rng, 300, -3.5))


def cuckoo(count: int, rng: Generator) -> Array:
    """Cuckoo clock: a short pendulum in a carved case; each call is two bellows-blown pipes and a blow on a wire gong.

    Stopped wooden pipes (odd harmonics, with breath noise through the same resonance; Fletcher and Rossing 1998) a
    falling third apart. The pressure falls while a bellows closes, so each note sags and fades; its flap clacks.
    """
    rate = rng.uniform(1.15, 1.55) * float(rng.choice([1.0, 2.0], p=[0.65, 0.35]))
    times = beats(count, rng, 1.0 / rate, rng.uniform(0.0, 0.12), 24, 0.002)
    wheels = plate(rng, 1400, 11_000, 26, 0.018, slope=0.5)
    case = plate(rng, 260, 3000, 26, rng.uniform(0.025, 0.045), slope=-0.3)
    bodies = ((wheels, 3.5e-5, 1.1), (case, 3e-4, 0.8))
    out = 1.6 * ticking(count, rng, times, recoil_strokes(rng, rng.uniform(0.08, 0.18)), bodies, 24)
    high, third = rng.uniform(620, 760), 2 ** (-rng.uniform(3.4, 4.4) / 12)
    gong = bar_or_bell(
        rng, rng.uniform(380, 560), (1.0, 1.5, 2.25, 3.1, 4.3, 5.2, 6.9, 8.3), rng.uniform(1.5, 3.0), 0.6
    )
    called = strikes(count, rng, (15.0, 40.0), (1.35, 1.9))
    calls = np.concatenate(called)
    out += 0.5 * drummed(count, rng, gong, calls + rng.uniform(0.9, 1.1), 1.0, 1.5e-4, 0.3)
    breath = sloped(count, rng, 400, 6000, -4.0)
    for start, pitch in ((0.0, high), (rng.uniform(0.3, 0.42), high * third)):
        out += struck(count, rng, case, calls + start - 0.02, 0.5, 4e-4, 0.4)
        length = rng.uniform(0.26, 0.36)
        edges = (calls + start)[:, None] + length * np.array([0.0, 0.12, 0.35, 0.8, 1.0])
        swell = course(count, edges.ravel().tolist(), [0.0, 1.0, 0.9, 0.6, 0.0] * len(calls), 0.03)
        sag = pitch * (0.955 + 0.045 * np.sqrt(np.clip(swell, 0, 1))) * (1.0 + wander(count, rng, 12.0, 0.003))
        turns = turned(sag)
        for harmonic, level in ((1, 0.32), (2, 0.02), (3, 0.07), (5, 0.02), (7, 0.006)):
            out += sine(harmonic * turns, count, level * swell**1.3 * np.exp(wander(count, rng, 9.0, 0.12)))
        out += 0.05 * breath * expand(swell, count)
    return np.asarray(out + 0.015 * movement_noise(count, rng, 200, -4.0))
