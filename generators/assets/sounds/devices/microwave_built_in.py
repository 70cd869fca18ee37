"""Three ovens that are built into kitchens: a cross-flow fan, a defrosting inverter, a drawer under the counter."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices.microwave_parts import (
    Moments,
    beeps,
    clicks,
    door,
    duty,
    inverter,
    kitchen,
    lamination_noise,
    mains,
    session,
    shaded_pole_fan,
    sheet_metal,
    spin_down,
    transformer,
    turntable,
)
from generators.assets.sounds.fans import (
    CONTROL_RATE,
    Signal,
    approach,
    decibels,
    expand,
    frames,
    impacts,
    modes,
    noise,
    passages,
    radiated,
    ripple,
    rotor,
    slopes,
    slow,
    struck,
    turbulence,
    turns_of,
)
from generators.assets.sounds.signals import Array


def _niche(rng: Generator) -> Array:
    """Gains (dB) of a cupboard round an oven: two or three broad modes of its air, and a front that dulls the rest."""
    peaks = [(rng.uniform(90.0, 420.0), rng.uniform(2.0, 5.0), rng.uniform(2.0, 6.0)) for _ in range(3)]
    return modes(peaks) + slopes([(400.0, 0.0), (2000.0, rng.uniform(-5.0, -1.0)), (8000.0, rng.uniform(-16.0, -8.0))])


def _cross_flow_fan(count: int, rng: Generator, speed: Array, nominal: float) -> tuple[Signal, Signal]:
    """A cross-flow fan on a weak two-pole motor (slip 12 to 28 %): (noise, tones), both about unit RMS at full speed.

    The vortex inside the wheel lies beside its axis and sways, so that the flow swells 2 to 8 times a second. The 24
    to 38 blades pass the tongue; their pitch is uneven, which spreads the tone over the neighbouring orders.
    """
    turn = nominal * (1.0 - rng.uniform(0.12, 0.28)) * (1.0 + slow(count, rng, 0.5, 0.005))
    turns = turns_of(np.maximum(turn * speed, 0.05), count, rng.random())
    number = int(rng.integers(24, 39))
    orders = {1: rng.uniform(0.3, 1.0), 2: rng.uniform(0.2, 0.6), 3: 0.2}
    orders |= {number + k: rng.uniform(0.2, 0.6) / (1.0 + 0.5 * abs(k)) for k in range(-4, 5)}
    sway = np.exp(slow(count, rng, rng.uniform(2.0, 8.0), rng.uniform(0.06, 0.16)))
    level = expand(np.minimum(speed, 1.2) ** 2.5 * sway, count)
    slit = modes([(rng.uniform(250.0, 900.0), rng.uniform(1.5, 3.0), rng.uniform(2.0, 6.0)) for _ in range(2)])
    air = noise(count, rng, turbulence(rng, rng.uniform(140.0, 340.0), rng.uniform(4.8, 6.4), 3.5, 2.0) + slit)
    return air * level, rotor(turns, orders, rng, 60.0, 0.4, 0.4) * level


def crossflow_built_in(count: int, rng: Generator) -> Array:
    """A large oven in a cupboard: a cross-flow fan over its whole width, a deep hum, and air long after the cooking.

    Model: `_cross_flow_fan`, after Y. Cho and Y. J. Moon, "Discrete noise prediction of variable pitch cross-flow
    fans", J. Fluids Eng. 125 (2003) 543–550; `transformer`, held by a heavy chassis; the fan runs on for 8 to 90 s and
    a lighter one cools the magnetron. Units: fan, slit, cupboard, core, plate, buzzer.
    """
    held = session(count, rng, (40.0, 160.0), (6.0, 10.0))
    nominal, cycle = mains(count, rng)
    share = 1.0 if rng.random() < 0.5 else rng.uniform(0.4, 0.85)
    power, relay = duty(count, rng, held.cooking, rng.uniform(24.0, 34.0), share)
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(170.0, 380.0))
    rub = lamination_noise(count, rng, cycle, power, rng.uniform(600.0, 1500.0))
    air, tones = _cross_flow_fan(count, rng, spin_down(count, rng, held.cooking, rng.uniform(8.0, 90.0)), nominal)
    tube, blades = shaded_pole_fan(
        count, rng, spin_down(count, rng, held.cooking, 0.3), nominal, (0.08, 0.18), rng.uniform(300.0, 700.0)
    )
    chassis = sheet_metal(rng, 110.0, 1300.0, 7.0)
    pitch = rng.uniform(2150.0, 2750.0)
    inside = (
        decibels(rng.uniform(0.0, 7.0)) * hum
        + decibels(rng.uniform(-12.0, -5.0)) * rub
        + decibels(rng.uniform(-10.0, -3.0)) * tube
        + decibels(rng.uniform(-16.0, -9.0)) * blades
        + decibels(rng.uniform(-16.0, -9.0)) * turntable(count, rng, held.cooking, nominal / 20.0)
    )
    return np.asarray(
        radiated(inside, chassis + _niche(rng))
        + air
        + decibels(rng.uniform(-15.0, -7.0)) * tones
        + 1.8 * clicks(count, rng, relay, 400.0, 3200.0)
        + 2.2 * door(count, rng, held)
        + 0.7 * beeps(count, rng, held.ends + 9000, pitch, rng.uniform(0.2, 0.5), rng.uniform(0.7, 1.1), 3)
        + 0.4 * beeps(count, rng, held.keys, pitch, 0.07, 1.0, 1)
        + 1.5 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def inverter_defrost(count: int, rng: Generator) -> Array:
    """An oven with an inverter that defrosts: pulses of some seconds in which hum and fan swell, and lulls between.

    Model: `inverter` starts softly (.3 to .9 s) in pulses of 2 to 9 s every 5 to 21 s (Panasonic, NN-H264: cycles of
    22 s at low power); the fan's triac cuts the sine between pulses, so its motor slows to 60 to 85 % and growls with
    many multiples of twice the mains frequency (phase control: A. E. Fitzgerald, C. Kingsley, S. D. Umans, Electric
    Machinery, 6th ed. 2003, chapter 10); a choke hums with the power. Units: pulses, fan, triac's angle, case.
    """
    held = session(count, rng, (60.0, 200.0), (5.0, 9.0))
    nominal, cycle = mains(count, rng)
    on, off = rng.uniform(2.0, 9.0), rng.uniform(3.0, 12.0)
    pulse, _ = duty(count, rng, held.cooking, on + off, on / (on + off))
    switched = np.flatnonzero(np.diff(pulse) > 0).astype(np.int64) * int(SAMPLE_RATE / CONTROL_RATE)
    soft = approach(
        count, [(1.0 / CONTROL_RATE, level) for level in pulse], float(pulse[0]), rng.uniform(0.1, 0.3), 0.06
    )
    power = np.clip(rng.uniform(0.55, 0.9) * soft * np.exp(slow(count, rng, 0.6, 0.04)), 0.0, 1.0)
    buzz = inverter(count, rng, cycle, nominal, power)
    choke = rotor(cycle, {2: 1.0, 4: rng.uniform(0.2, 0.6), 6: rng.uniform(0.05, 0.3), 8: 0.1}, rng, nominal, 0.1, 0.04)
    lull = rng.uniform(0.6, 0.85)
    wanted = spin_down(count, rng, held.cooking, rng.uniform(2.0, 30.0))
    reached = approach(
        count, [(1.0 / CONTROL_RATE, level) for level in lull + (1.0 - lull) * pulse], lull, rng.uniform(0.4, 0.9), 1.5
    )
    air, tones = shaded_pole_fan(count, rng, wanted * reached, nominal, (0.06, 0.16), rng.uniform(230.0, 480.0))
    steep = rng.uniform(0.9, 1.5)
    growl = rotor(cycle, {2 * k: rng.uniform(0.5, 1.0) / k**steep for k in range(1, 17)}, rng, nominal, 0.15, 0.05)
    growl *= expand(np.clip(wanted, 0.0, 1.0) * (1.2 - reached), count)
    lining = slopes([(600.0, 0.0), (4000.0, rng.uniform(-14.0, -6.0)), (16_000.0, rng.uniform(-32.0, -20.0))])
    case = sheet_metal(rng, 160.0, 1700.0, 8.0) + lining
    pitch = rng.uniform(2400.0, 3600.0)
    return np.asarray(
        1.1 * radiated(air, 0.5 * lining)
        + radiated(
            decibels(rng.uniform(-8.0, -1.0)) * buzz
            + decibels(rng.uniform(-5.0, 2.0)) * choke * expand(power, count)
            + decibels(rng.uniform(-5.0, 3.0)) * growl
            + decibels(rng.uniform(-12.0, -6.0)) * tones,
            case,
        )
        + decibels(rng.uniform(-13.0, -6.0)) * turntable(count, rng, held.cooking, nominal / 10.0)
        + 1.4 * clicks(count, rng, switched, 700.0, 5000.0, 0.03)
        + 2.2 * door(count, rng, held)
        + 0.7 * beeps(count, rng, held.ends + 7000, pitch, rng.uniform(0.1, 0.3), rng.uniform(0.4, 0.8), 4)
        + 0.4 * beeps(count, rng, held.keys, pitch, 0.05, 1.0, 1)
        + 1.3 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def _from_each(count: int, at: Moments, seconds: float, levels: Array | float) -> Array:
    """Slow curve that has a level for ``seconds`` from each of the samples ``at``, else 0."""
    out = np.zeros(frames(count))
    for start, level in zip(at, np.broadcast_to(levels, at.shape), strict=True):
        begin = int(start / SAMPLE_RATE * CONTROL_RATE)
        out[max(begin, 0) : max(begin + int(seconds * CONTROL_RATE), 0)] = level
    return out


def _drawer(count: int, rng: Generator, at: Moments) -> Signal:
    """A drawer that a geared motor moves on rails from each of the samples ``at``: about unit RMS while it moves.

    A brushed motor of 60 to 130 turns a second, a worm and a rack, whose teeth are passed 20 to 60 times a second;
    balls in the rails; it starts and stops softly and arrives with a thump. Two journeys differ by their load.
    """
    travel = rng.uniform(1.6, 2.6)
    motion = _from_each(count, at, travel, rng.uniform(0.88, 1.0, len(at)))
    width = int(rng.uniform(0.12, 0.3) * CONTROL_RATE) | 1
    motion = np.convolve(np.pad(motion, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
    speed = motion * (1.0 + slow(count, rng, 3.0, 0.02)) + 1e-4
    shaft = turns_of(rng.uniform(60.0, 130.0) * speed, count, rng.random())
    bars = int(rng.choice([5, 7, 8, 10, 12]))
    orders = {1: 0.6, 2: 0.5, 3: 0.3, 4: 0.25, bars: 0.8, 2 * bars: 0.4, 3 * bars: 0.2}
    whirr = rotor(shaft, {k: level * rng.uniform(0.5, 1.5) for k, level in orders.items()}, rng, 130.0, 0.3, 0.25)
    teeth = passages(turns_of(rng.uniform(20.0, 60.0) * speed, count), 1.0, rng)
    rack = slopes([(150.0, -8.0), (600.0, 0.0), (3000.0, -10.0), (9000.0, -28.0)]) + ripple(rng, 4.0)
    mesh = struck(count, rng, teeth, np.exp(rng.normal(-0.4, 0.4, len(teeth))), rack, 0.03)
    balls = noise(count, rng, slopes([(120.0, -4.0), (400.0, 0.0), (2500.0, -9.0), (9000.0, -26.0)]) + ripple(rng, 3.0))
    thump = slopes([(60.0, -4.0), (160.0, 0.0), (700.0, -12.0), (3000.0, -28.0)]) + ripple(rng, 3.0)
    ends = at + int(travel * SAMPLE_RATE)
    arrival = struck(count, rng, ends, rng.uniform(2.0, 4.0, len(ends)), thump, 0.2, 3.0)
    level = expand(motion**1.3, count)
    return np.asarray((0.6 * whirr + 0.6 * balls) * level + 0.8 * mesh + arrival, dtype=np.float32)


def drawer_oven(count: int, rng: Generator) -> Array:
    """A drawer under the counter that a motor opens and closes; above its food an antenna turns, the fan runs on.

    Model: `_drawer` (worm and rack: J. D. Smith, Gear Noise and Vibration, 2nd ed. 2003); `transformer` in a closed
    cupboard, which gives its lowest multiples; a slow antenna on a synchronous motor, geared to 6 to 15 turns a minute,
    that scrapes once a turn; a fan of four poles (slip 5 to 12 %) that cools for 12 to 60 s more. Dishes clink as the
    drawer starts and stops. Units: drawer, motor, core, cupboard, fan, buzzer.
    """
    held = session(count, rng, (25.0, 110.0), (15.0, 20.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(20.0, 32.0), rng.choice([1.0, rng.uniform(0.5, 0.9)]))
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(150.0, 450.0))
    speed = spin_down(count, rng, held.cooking, rng.uniform(12.0, 60.0))
    air, tones = shaded_pole_fan(count, rng, speed, nominal / 2.0, (0.05, 0.12), rng.uniform(160.0, 420.0))
    arm = held.cooking * rng.uniform(0.1, 0.25) * (1.0 + slow(count, rng, 0.5, 0.03))
    angle = 2 * np.pi * (np.cumsum(arm) / CONTROL_RATE + rng.random())
    scrape = noise(count, rng, slopes([(300.0, -8.0), (1100.0, 0.0), (5000.0, -14.0)]) + ripple(rng, 4.0))
    scrape *= expand(held.cooking * np.exp(3.0 * (np.cos(angle) - 1.0) + slow(count, rng, 12.0, 0.5)), count)
    moved = np.sort(np.concatenate([held.opens, held.closes]))
    dishes = slopes([(700.0, -12.0), (2400.0, 0.0), (7000.0, -8.0), (14_000.0, -26.0)]) + ripple(rng, 5.0, 6.0)
    clink = impacts(count, rng, rng.uniform(2.0, 7.0) * _from_each(count, moved, 0.5, 1.0), dishes, 0.6, 0.09)
    pitch = rng.uniform(1900.0, 2500.0)
    return np.asarray(
        air
        + radiated(
            decibels(rng.uniform(0.0, 7.0)) * hum + decibels(rng.uniform(-12.0, -5.0)) * tones,
            sheet_metal(rng, 100.0, 1200.0, 8.0) + _niche(rng),
        )
        + decibels(rng.uniform(-18.0, -10.0)) * scrape
        + rng.uniform(0.5, 1.1) * _drawer(count, rng, moved)
        + 0.5 * clink
        + 2.0 * clicks(count, rng, relay, 450.0, 3600.0)
        + 0.7 * beeps(count, rng, held.ends + 9000, pitch, rng.uniform(0.3, 0.6), rng.uniform(0.8, 1.3), 4)
        + 0.4 * beeps(count, rng, held.keys, 1.5 * pitch, 0.06, 1.0, 1)
        + 1.6 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )
