"""Clocks with an electric drive: quartz steppers, synchronous motors, falling leaves."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.machines import (
    CONTROL_RATE,
    VibratingBody,
    bursts,
    control_count,
    driven,
    drummed,
    expand,
    mains_turns,
    plate,
    sloped,
    struck,
    tones,
    turned,
    wander,
)
from generators.assets.sounds.signals import Array


def step_strokes(rng: Generator, swing: float, damping: float, pulse: float) -> tuple[Array, Array]:
    """Times (s) and forces of the contacts in one step of a Lavet motor.

    Model: a pulse of ``pulse`` seconds turns the rotor by 180°; it overshoots and swings about its new rest as
    1 − exp(−damping·ω·t)·cos(ωt) with ω = 2π·``swing``; teeth take up their backlash wherever the speed changes sign,
    with forces as the speeds between; when the pulse ends, the rest position shifts and a small contact follows.
    Source: M. Lavet, patent FR 823 395 (1936).
    """
    turning = (np.arange(6) + 1) / (2 * swing)
    delays = np.concatenate([[0.0], turning, [pulse]])
    forces = np.concatenate(
        [[rng.uniform(0.35, 0.7)], np.exp(-damping * np.pi * np.arange(6)), [rng.uniform(0.1, 0.3)]]
    )
    return delays, forces


def stepping(
    count: int,
    rng: Generator,
    times: Array,
    strokes: tuple[Array, Array],
    bodies: list[tuple[VibratingBody, float, float]],
) -> Array:
    """Steps of alternate polarity (two kinds of step), whose force changes over the wheel's turns."""
    delays, forces = strokes
    index = np.arange(len(times))
    polarity = np.exp(rng.normal(0, 0.22, (2, len(delays))))[index % 2]
    turn = 1.0 + 0.2 * np.cos(2 * np.pi * index / 60 + rng.uniform(0, 6.28)) + 0.1 * np.cos(2 * np.pi * index / 7.5)
    strength = forces * polarity * turn[:, None] * np.exp(rng.normal(0, 0.15, (len(times), len(delays))))
    moments = times[:, None] + delays * np.exp(rng.normal(0, 0.05, (len(times), len(delays))))
    out = np.zeros(count)
    for body, contact, gain in bodies:
        out += gain * struck(count, rng, body, moments.ravel(), strength.ravel(), contact, 0.3)
    return out


def wall_quartz(count: int, rng: Generator) -> Array:
    """Wall clock with a quartz stepper, one step a second; dial and pane are a drum for the plastic movement."""
    times = rng.uniform(0.0, 1.0) + np.arange(count // SAMPLE_RATE + 2) * (1.0 + rng.normal(0, 1e-5))
    times = times + rng.normal(0, 4e-4, len(times))
    strokes = step_strokes(rng, rng.uniform(38, 75), rng.uniform(0.12, 0.3), rng.uniform(0.028, 0.05))
    gears = plate(rng, 1700, 9500, 24, 0.03, slope=0.0)
    dial = plate(rng, 380, 3600, 26, rng.uniform(0.02, 0.045), slope=-1.5)
    out = stepping(count, rng, times, strokes, [(gears, 5e-5, 1.0), (dial, 2.5e-4, rng.uniform(0.8, 1.6))])
    # The seconds hand trembles after each step: a faint rattle of its tube.
    rattle = sloped(count, rng, 1200, 5000, -3.0) * expand(bursts(count, times, 1.0, 0.004, 0.18), count)
    return np.asarray(out + 0.03 * rattle + 0.008 * sloped(count, rng, 250, 6000, -4.5))


def sweep_quartz(count: int, rng: Generator) -> Array:
    """Sweep-second quartz clock: a stepper with 8 or 16 steps a second, so gentle that gears only whirr.

    Each step excites the train below 2 kHz; wheels mesh with tooth rates between the steps' rate and some 50 Hz;
    worn wheels grind once per turn of a few seconds.
    """
    rate = float(rng.choice([8.0, 16.0])) * (1.0 + rng.normal(0, 1e-4))
    number = int(count / SAMPLE_RATE * rate) + 2
    times = (np.arange(number) + rng.uniform()) / rate + rng.normal(0, 0.05 / rate, number)
    turns = turned(np.full(control_count(count), rng.uniform(0.2, 0.5)))
    wear = (
        1.0 + 0.3 * np.sin(2 * np.pi * turns) + 0.15 * np.sin(6 * np.pi * turns + 1.0) + wander(count, rng, 3.0, 0.12)
    )
    wear = np.clip(wear, 0.2, None)
    force = np.exp(rng.normal(0, 0.35, number)) * np.where(np.arange(number) % 2 == 0, 1.0, rng.uniform(0.6, 0.9))
    force *= np.interp(times, np.arange(len(wear)) / CONTROL_RATE, wear)
    gears = plate(rng, 500, 10_500, 34, 0.05, slope=0.0)
    dial = plate(rng, 260, 2400, 18, 0.04, slope=-1.0)
    whirr = driven(sloped(count, rng, 500, 9000, -2.5), gears) * expand(wear**1.5, count)
    shake = 1.0 + 0.35 * np.sin(2 * np.pi * turned(np.full(control_count(count), rate)))
    return np.asarray(
        0.5 * drummed(count, rng, gears, times, force, 6e-5, 0.4)
        + 0.4 * drummed(count, rng, dial, times, force, 4e-4, 0.4)
        + 0.10 * whirr * expand(shake, count)
        + 0.03 * sloped(count, rng, 300, 7000, -3.5)
    )


def synchronous_hum(count: int, rng: Generator, mains: float, body: VibratingBody) -> Array:
    """A synchronous clock motor: coil and rotor at twice the mains frequency and overtones, a buzz of loose iron."""
    pulse = mains_turns(count, rng, mains)
    levels = {
        1: 0.12,
        2: 1.0,
        3: 0.06,
        4: 0.6,
        5: 0.04,
        6: 0.45,
        8: 0.35,
        10: 0.25,
        12: 0.2,
        14: 0.15,
        16: 0.1,
        20: 0.08,
    }
    hum = tones(pulse, count, levels, rng, 0.3)
    buzz = sloped(count, rng, 1500, 6000, -3.0) * expand(np.exp(wander(count, rng, 1.0, 0.3)), count)
    buzz = buzz * np.maximum(0.0, tones(pulse, count, {2: 1.0}, rng, 0.05)) ** 2
    return np.asarray(0.2 * hum + driven(hum, body) + 0.5 * buzz)


def synchronous(count: int, rng: Generator) -> Array:
    """Electric mains clock: a self-starting synchronous motor (H. E. Warren's, 1918) and a train of gears in a can.

    The rotor turns 300–600 times a minute (or 3600 at 60 Hz in a sealed can); its pinion's backlash rattles at the
    tooth rate, in groups as wheels go round; hum at twice the mains frequency.
    """
    mains = float(rng.choice([50.0, 60.0]))
    case = plate(rng, 160, 2600, 24, 0.03, slope=-0.8)
    train = plate(rng, 700, 10_500, 32, 0.03, slope=0.0)
    hum = synchronous_hum(count, rng, mains, case)
    rotor = mains / float(rng.choice([5.0, 6.0, 10.0, 1.0]))
    teeth = turned(np.full(control_count(count), rotor * (rng.integers(6, 11) if rotor < 20 else 1.0)))
    marks = np.arange(0.0, teeth[-1])
    wheel, slow = rng.uniform(16, 50), rng.uniform(120, 400)
    force = 0.7 + 1.0 * np.sin(2 * np.pi * marks / wheel) + 0.3 * np.sin(2 * np.pi * marks / slow)
    force = np.clip(force, 0.0, None) * np.exp(rng.normal(0, 0.5, len(marks)))
    times = np.interp(marks + rng.normal(0, 0.08, len(marks)), teeth, np.arange(len(teeth)) / CONTROL_RATE)
    rattle = drummed(count, rng, train, times, force, 6e-5, 0.4)
    bearing = sloped(count, rng, 600, 9000, -2.5) * expand(np.exp(wander(count, rng, min(rotor, 10.0), 0.3)), count)
    return np.asarray(0.06 * hum + rng.uniform(0.2, 0.4) * rattle / max(float(rattle.std()), 1e-9) + 0.08 * bearing)


def flip(count: int, rng: Generator) -> Array:
    """Flip clock: a synchronous motor hums, and each minute a leaf of plastic falls, oftener while it is set.

    A leaf is pressed by a catch, slips (a rising scrape), turns in about .1–.2 s under gravity and claps on the pile,
    with one or two rebounds. The wheel of leaves moves on by a ratchet of some ticks a second.
    """
    mains = float(rng.choice([50.0, 60.0]))
    box = plate(rng, 240, 3000, 28, 0.045, slope=-0.7)
    hum = synchronous_hum(count, rng, mains, box)
    first = rng.uniform(0.0, 60.0)
    falls = first + 60.0 * np.arange(count // (60 * SAMPLE_RATE) + 1)
    # A clock that is being set, or shows seconds, drops leaves oftener.
    if rng.random() < 0.7:
        falls = np.sort(
            np.concatenate([falls, rng.uniform(0, count / SAMPLE_RATE, rng.poisson(count / SAMPLE_RATE / 9))])
        )
    fallen = falls + rng.uniform(0.1, 0.2, len(falls))
    rebound = fallen + rng.uniform(0.03, 0.06, len(falls))
    claps = np.concatenate([fallen, rebound, rebound + rng.uniform(0.012, 0.03, len(falls))])
    force = np.repeat([1.0, 0.3, 0.12], len(falls)) * np.exp(rng.normal(0, 0.25, len(claps)))
    leaf = plate(rng, 800, 12_000, 38, 0.06, slope=1.0)
    slip = sloped(count, rng, 1500, 7000, -2.0) * expand(bursts(count, falls, 1.0, 0.03, 0.12), count)
    rate = rng.uniform(1.8, 5.0)
    ticks = np.cumsum(1 / rate + rng.normal(0, 0.02 / rate, int(rate * count / SAMPLE_RATE * 1.1) + 4))
    ratchet = struck(count, rng, leaf, ticks, np.exp(rng.normal(0, 0.3, len(ticks))), 5e-5, 0.4)
    gears = turned(np.full(control_count(count), rng.uniform(60.0, 110.0)) * (1.0 + wander(count, rng, 8.0, 0.01)))
    mesh = tones(gears, count, {1: 1.0, 2: 0.3, 3: 0.5, 5: 0.2}, rng, 3.0) * expand(
        np.exp(wander(count, rng, 4.0, 0.4)), count
    )
    # The motor sits on rubber, so that hum and gears are no louder than the room.
    return np.asarray(
        0.015 * hum
        + 0.5 * struck(count, rng, leaf, claps, force, 5e-5, 0.5)
        + 0.5 * struck(count, rng, box, claps, force, 4e-4, 0.4)
        + 0.15 * slip
        + 1.8 * ratchet
        + 0.01 * driven(mesh, box)
        + 0.02 * sloped(count, rng, 300, 9000, -1.5)
    )


def bedside_quartz(count: int, rng: Generator) -> Array:
    """Quartz alarm clock at arm's length: soft steps in a plastic box, over the low noise of a room or a street.

    Steps as in `wall_quartz`; small boxes have no dial to drum on. Recordings of such clocks are quiet and turned up:
    their floor lies 8 to 30 dB below the ticks, and falls by 3 to 8 dB per octave from 60 Hz on. Units: box, motor,
    room.
    """
    times = rng.uniform(0.0, 1.0) + np.arange(count // SAMPLE_RATE + 2) * (1.0 + rng.normal(0, 1e-5))
    times = times + rng.normal(0, 5e-4, len(times))
    strokes = step_strokes(rng, rng.uniform(45, 90), rng.uniform(0.15, 0.4), rng.uniform(0.02, 0.045))
    gears = plate(rng, 1300, rng.uniform(5000, 9500), 22, 0.035, slope=rng.uniform(-2.0, 0.0))
    box = plate(rng, 500, 3200, 16, rng.uniform(0.03, 0.06), slope=-0.8)
    out = stepping(count, rng, times, strokes, [(gears, 6e-5, 1.0), (box, 3e-4, rng.uniform(0.5, 2.0))])
    room = sloped(count, rng, rng.uniform(45, 200), 6000, rng.uniform(-8.0, -3.0))
    room = room * expand(np.exp(wander(count, rng, 1.0, 0.2)), count)
    return np.asarray(out / max(float(out.std()), 1e-9) + 10 ** (rng.uniform(-30.0, -8.0) / 20) * room)


def buzzer_alarm(count: int, rng: Generator) -> Array:
    """Electric alarm clock: a synchronous motor whose leaking field shakes a steel reed once the alarm lets it go.

    The reed lies over the coil's air gap and strikes the frame 100 or 120 times a second, missing some; it is held away
    until the hour (a vibro-impact, as `rattling_compact` of the microwaves). Hum and gears as in `synchronous`, softer.
    Units: reed, frame, gears, mains.
    """
    mains = float(rng.choice([50.0, 60.0]))
    # Hard steel on steel touches for less than .1 ms: thin parts of the frame ring up to 10 kHz.
    frame = plate(rng, 220, 10_000, 40, 0.025, slope=rng.uniform(-1.0, 0.0))
    hum = synchronous_hum(count, rng, mains, plate(rng, 160, 2600, 20, 0.04, slope=-0.8))
    pulse = mains_turns(count, rng, mains)
    beats = np.flatnonzero(np.diff(np.floor(2.0 * pulse)) > 0) / CONTROL_RATE
    edges = np.cumsum(rng.uniform(4.0, 14.0, count // (4 * SAMPLE_RATE) + 3)) - rng.uniform(0.0, 12.0)
    let_go = np.searchsorted(edges, beats) % 2 == int(rng.integers(0, 2))
    kept = beats[let_go & (rng.random(len(beats)) > rng.uniform(0.02, 0.25))]
    force = np.exp(rng.normal(0.0, 0.2, len(kept)))
    reed = drummed(count, rng, frame, kept, force, rng.uniform(4e-5, 1.0e-4), 0.3)
    rate = rng.uniform(4.0, 16.0)
    meshing = np.cumsum(np.exp(rng.normal(0, 0.15, int(rate * count / SAMPLE_RATE * 1.2) + 4)) / rate)
    train = plate(rng, 900, 11_000, 30, 0.03)
    gears = drummed(count, rng, train, meshing, np.exp(rng.normal(0, 0.5, len(meshing))), 4e-5, 0.4)
    level = max(float(gears.std()), 1e-9)
    loud = max(float(reed.std()), 1e-9)
    return np.asarray(
        rng.uniform(0.04, 0.2) * hum / max(float(hum.std()), 1e-9)
        + 0.25 * gears / level
        + rng.uniform(0.3, 0.9) * reed / loud
        + 0.03 * sloped(count, rng, 200, 7000, -3.5)
    )


def kitchen_quartz(count: int, rng: Generator) -> Array:
    """Wall clock with a quartz stepper in a kitchen: steps over the noise of a room, the hum of a refrigerator.

    Steps as in `wall_quartz`. Rooms at night have 20 to 30 dB(A), a clock's steps at 1 m as much: the floor lies 2 to
    24 dB below the ticks in rms; it is broad (L. L. Beranek, "Balanced noise-criterion (NCB) curves", J. Acoust. Soc.
    Am. 86 (1989) 650–664: about −5 dB per octave), with the hum of a compressor at times. Units: movement, dial, room.
    """
    period = 1.0 + rng.normal(0, 1e-5)
    times = rng.uniform(0.0, 1.0) + np.arange(count // SAMPLE_RATE + 2) * period
    times = times + rng.normal(0, 4e-4, len(times))
    strokes = step_strokes(rng, rng.uniform(35, 85), rng.uniform(0.12, 0.4), rng.uniform(0.02, 0.05))
    gears = plate(rng, rng.uniform(900, 2000), rng.uniform(5000, 11_000), 24, 0.03, slope=rng.uniform(-1.5, 0.5))
    dial = plate(rng, 300, 3000, 22, rng.uniform(0.02, 0.05), slope=-1.2)
    out = stepping(count, rng, times, strokes, [(gears, 6e-5, 1.0), (dial, 3e-4, rng.uniform(0.4, 2.0))])
    room = sloped(count, rng, rng.uniform(50, 300), rng.uniform(4000, 12_000), rng.uniform(-6.0, -2.0))
    room = room / max(float(room.std()), 1e-9) * expand(np.exp(wander(count, rng, 1.0, 0.15)), count)
    pulse = mains_turns(count, rng, float(rng.choice([50.0, 60.0])))
    hum = tones(pulse, count, {1: 0.4, 2: 1.0, 3: 0.2, 4: 0.3, 6: 0.15}, rng, 0.3)
    hum = hum / max(float(hum.std()), 1e-9) * 10 ** (rng.uniform(-20.0, -2.0) / 20)
    floor = room + hum if rng.random() < 0.4 else room
    return np.asarray(out / max(float(out.std()), 1e-9) + 10 ** (rng.uniform(-24.0, -2.0) / 20) * floor)
