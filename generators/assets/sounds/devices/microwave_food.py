"""More voices of microwave ovens: popcorn, a clockwork timer, a quiet oven with sizzling food, a commercial one."""

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
    louvres,
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
    blades,
    cosine,
    decibels,
    expand,
    impacts,
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
from generators.assets.sounds.signals import Array, add_at, bubbles, strike


def popcorn(count: int, rng: Generator) -> Array:
    """A bag of popcorn over a hum: single pops, a crackling crowd of them, single ones again; the bag rustles.

    Model: kernels burst at about 180 °C, and the sound is the release of vapour (E. Virot and A. Ponomarenko, "Popcorn:
    critical temperature, jump and sound", J. R. Soc. Interface 12 (2015) 20141247): temperatures of kernels spread, so
    the rate of pops is a bell over the heating time (3 to 7 per second at its peak, 12 to 20 s wide). Each pop is a
    burst of 5 to 20 ms, muffled by bag and door; the crowd lifts the bag against the plate.
    """
    held = session(count, rng, (60.0, 130.0), (6.0, 9.0))
    nominal, cycle = mains(count, rng)
    hum = transformer(count, rng, cycle, nominal, held.cooking, rng.uniform(350.0, 700.0))
    rub = lamination_noise(count, rng, cycle, held.cooking, rng.uniform(500.0, 900.0))
    speed = spin_down(count, rng, held.cooking, rng.uniform(0.1, 2.0))
    air, tones = shaded_pole_fan(count, rng, speed, nominal, (0.10, 0.18), rng.uniform(500.0, 850.0))
    heated = held.heated
    bell = np.exp(-0.5 * np.square((heated - rng.uniform(40.0, 75.0)) / rng.uniform(12.0, 20.0)))
    rate = held.cooking * (rng.uniform(3.0, 7.0) * bell + 0.02)
    muffled = slopes([(150.0, -12.0), (500.0, -3.0), (1500.0, 0.0), (4500.0, -8.0), (12_000.0, -28.0)])
    pops = impacts(count, rng, rate, muffled + ripple(rng, 3.0), 0.45, rng.uniform(0.012, 0.04))
    sharp = impacts(count, rng, 0.6 * rate, slopes([(800.0, -10.0), (3500.0, 0.0), (9000.0, -12.0)]), 0.6, 0.01)
    paper = noise(
        count, rng, slopes([(800.0, -8.0), (3000.0, 0.0), (7000.0, -7.0), (14_000.0, -24.0)]) + ripple(rng, 3.0)
    )
    rustle = paper * expand(held.cooking * (0.15 + bell) * np.exp(slow(count, rng, 18.0, 0.9)), count)
    return np.asarray(
        radiated(
            decibels(rng.uniform(4.0, 9.0)) * hum + decibels(rng.uniform(-6.0, 0.0)) * rub,
            sheet_metal(rng, 180.0, 2600.0, 8.0),
        )
        + 0.9 * air
        + decibels(rng.uniform(-12.0, -6.0)) * tones
        + rng.uniform(8.0, 16.0) * (pops + 0.4 * sharp)
        + 0.2 * rustle
        + decibels(rng.uniform(-12.0, -5.0)) * turntable(count, rng, held.cooking, nominal / 10.0)
        + 1.5 * clicks(count, rng, held.starts, 600.0, 4000.0)
        + 2.5 * door(count, rng, held)
        + 0.8 * beeps(count, rng, held.ends + 9000, rng.uniform(2050.0, 2200.0), 0.3, 0.6, 4)
        + 1.8 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


#: Partials of a small gong: ratio of frequency, seconds to fall by 60 dB, amplitude.
_GONG = ((1.0, 2.6, 0.7), (1.86, 1.8, 0.5), (2.72, 1.3, 0.6), (3.9, 0.8, 0.35), (5.2, 0.4, 0.2))


def _bell(count: int, rng: Generator, at: Moments) -> Array:
    """A small gong that a hammer strikes once: pairs of partials that beat, high ones that die first."""
    base = rng.uniform(1700.0, 2600.0)
    out = np.zeros(count)
    for start in at:
        partials = []
        for ratio, decay, level in (
            (1.0, 2.6, 0.7),
            (1.86, 1.8, 0.5),
            (2.72, 1.3, 0.6),
            (3.9, 0.8, 0.35),
            (5.2, 0.4, 0.2),
        ):
            frequency = base * ratio * rng.uniform(0.999, 1.001)
            length = decay * rng.uniform(0.8, 1.2)
            partials += [
                (frequency, length, level),
                (frequency * 1.0015, 0.8 * length, 0.5 * level * rng.uniform(0.5, 1.5)),
            ]
        add_at(out, int(start), rng.uniform(0.8, 1.2) * strike(partials, 3.0, rng))
    return out


def timer_bell(count: int, rng: Generator) -> Array:
    """An old oven with a dial: the timer's escapement patters over a rough hum; a bell rings and all is quiet.

    Model: an escapement of 4 to 7 beats a second, out of beat, with a gear whirr; each beat is an unlocking and a drop
    5 to 9 ms apart in a plastic dial and a sheet-metal panel; the dial is wound at the start (a ratchet of 15 to 30
    clicks); no beeps. The supply is `transformer` with strong rubbing sheets; the fan a big two-pole one.
    """
    held = session(count, rng, (25.0, 110.0), (7.0, 10.0))
    nominal, cycle = mains(count, rng)
    power, relay = duty(count, rng, held.cooking, rng.uniform(18.0, 24.0), rng.uniform(0.6, 1.0))
    hum = transformer(count, rng, cycle, nominal, power, rng.uniform(160.0, 300.0))
    rub = lamination_noise(count, rng, cycle, power, rng.uniform(1500.0, 3000.0))
    speed = spin_down(count, rng, held.cooking, 0.1)
    air, tones = shaded_pole_fan(count, rng, speed, nominal, (0.03, 0.08), rng.uniform(220.0, 380.0))
    rate = rng.uniform(4.0, 7.0) * (1.0 + slow(count, rng, 0.5, 0.01)) * np.maximum(held.cooking, 1e-3)
    beats = passages(turns_of(rate, count, rng.random()), 1.0, rng)
    lame = int(rng.uniform(0.0, 0.018) * SAMPLE_RATE)
    beats = beats + lame * (np.arange(len(beats)) % 2) + rng.normal(0.0, 30.0, len(beats)).astype(np.int64)
    panel = sheet_metal(rng, 600.0, 4500.0, 12.0) + slopes([(400.0, -10.0), (2500.0, 0.0), (9000.0, -14.0)])
    both = np.concatenate([beats, beats + int(rng.uniform(0.005, 0.009) * SAMPLE_RATE)])
    force = np.concatenate([rng.uniform(0.3, 0.6, len(beats)), rng.uniform(0.7, 1.2, len(beats))])
    ticks = struck(count, rng, both, force, panel, 0.03)
    whirr = rotor(turns_of(rate * 3.0, count), {k: rng.uniform(0.2, 1.0) for k in range(9, 60, 4)}, rng, 22.0, 0.4, 0.5)
    windings = [start - int(rng.uniform(0.9, 1.3) * SAMPLE_RATE) for start in held.starts]
    steps = [w + np.cumsum(rng.uniform(900, 1900, int(rng.integers(15, 30)))).astype(np.int64) for w in windings]
    ratchet = clicks(count, rng, np.concatenate(steps) if steps else held.starts, 1200.0, 5000.0, 0.02)
    return np.asarray(
        radiated(
            decibels(rng.uniform(3.0, 8.0)) * hum + decibels(rng.uniform(-6.0, 0.0)) * rub,
            sheet_metal(rng, 120.0, 1500.0, 9.0),
        )
        + air
        + decibels(rng.uniform(-8.0, -2.0)) * tones
        + rng.uniform(1.0, 2.0) * ticks
        + 0.1 * whirr * expand(held.cooking, count)
        + 1.2 * ratchet
        + rng.uniform(1.0, 2.0) * _bell(count, rng, held.ends)
        + 3.0 * clicks(count, rng, relay, 350.0, 3000.0, 0.06)
        + 3.0 * door(count, rng, held)
        + 1.6 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def _sizzle(count: int, rng: Generator, heat: Array) -> Signal:
    """Food under microwaves: simmering bubbles, spitting fat that bursts in flurries, knocks of a lid."""
    flurry = np.maximum(0.0, 0.2 + slow(count, rng, 1.5, 0.6)) ** 2 * heat
    spit = impacts(count, rng, 40.0 * flurry, slopes([(900.0, -12.0), (3500.0, 0.0), (9000.0, -9.0)]), 0.9, 0.008)
    pop = impacts(count, rng, 1.2 * flurry, slopes([(200.0, -6.0), (900.0, 0.0), (5000.0, -16.0)]), 0.6, 0.03)
    simmer = bubbles(count, rng, np.asarray(expand(60.0 * heat * (0.3 + flurry), count), dtype=np.float64), (1.5, 5.0))
    lid = impacts(count, rng, 0.5 * flurry, slopes([(900.0, -8.0), (2600.0, 0.0), (8000.0, -12.0)]), 0.4, 0.09)
    return np.asarray(0.7 * spit + 1.5 * pop + 0.25 * simmer + 0.8 * lid, dtype=np.float32)


def inverter_quiet(count: int, rng: Generator) -> Array:
    """A built-in oven with an inverter and electronic fans: little of the oven, much of the food in it.

    Model: `inverter` behind lined walls; a brushless fan of 7 blades whose speed is stepped with the temperature (28 to
    48 turns a second, four poles: a tone at twice the number of pole pairs), and runs on for 10 s; the food simmers,
    spits and pops at a rate that grows over the heating (time constant 15 to 40 s). A chime of two notes instead of
    beeps, a damped door.
    """
    held = session(count, rng, (45.0, 160.0), (6.0, 9.0))
    nominal, cycle = mains(count, rng)
    power = held.cooking * np.clip(0.85 + slow(count, rng, 0.15, 0.15), 0.4, 1.0)
    buzz = inverter(
        count, rng, cycle, nominal, np.convolve(np.pad(power, 20, mode="edge"), np.full(41, 1 / 41), "valid")
    )
    speed = spin_down(count, rng, held.cooking, 10.0)
    heated = held.heated
    turn = rng.uniform(28.0, 36.0) * speed * (1.0 + 0.3 * (heated > 20.0))
    lag = int(0.8 * CONTROL_RATE)
    turn = np.convolve(np.pad(turn, lag, mode="edge"), np.full(2 * lag + 1, 1.0 / (2 * lag + 1)), mode="valid")
    turns = turns_of(turn * (1.0 + slow(count, rng, 1.0, 0.002)) + 0.05, count, rng.random())
    tones = rotor(turns, {**blades(7, rng, 0.3, 4, 0.5), 4: 0.5, 8: 0.4, 16: 0.2}, rng, 60.0, 0.2, 0.12)
    air = noise(count, rng, turbulence(rng, rng.uniform(380.0, 800.0), rng.uniform(4.5, 6.5), 3.0, 2.5) + louvres(rng))
    loud = expand((turn / 40.0) ** 2.5, count)
    heat = held.cooking * (1.0 - np.exp(-heated / rng.uniform(15.0, 40.0)))
    lined = sheet_metal(rng, 200.0, 2000.0, 7.0) + slopes([(500.0, 0.0), (4000.0, -12.0), (16_000.0, -26.0)])
    low = rng.uniform(900.0, 1300.0)
    chime = beeps(count, rng, held.ends + 6000, low, 0.35, 1.0, 1) + beeps(
        count, rng, held.ends + 22_000, low * float(rng.choice([1.25, 1.3333, 1.5])), 0.5, 1.0, 1
    )
    return np.asarray(
        air * loud
        + decibels(rng.uniform(-12.0, -6.0)) * tones * loud
        + radiated(decibels(rng.uniform(-9.0, -3.0)) * buzz, lined)
        + rng.uniform(1.0, 3.0) * radiated(_sizzle(count, rng, heat), lined)
        + decibels(rng.uniform(-16.0, -10.0)) * turntable(count, rng, held.cooking, nominal / 16.0)
        + 1.2 * door(count, rng, held)
        + 0.6 * chime
        + 0.3 * beeps(count, rng, held.keys, 2.0 * low, 0.04, 1.0, 1)
        + kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )


def commercial_twin(count: int, rng: Generator) -> Array:
    """An oven of a canteen: two supplies and two strong blowers, a turning antenna, short runs, a heavy door.

    Model: two transformers whose doublers conduct in opposite half waves, so odd multiples of the mains frequency are
    weak and the even ones beat slowly where the cores differ; two centrifugal blowers (slip 3 to 8 %, 11 to 17 blades)
    that beat; an antenna under the ceiling, geared with a whine, 1 to 2 turns a second; a contactor instead of a relay.
    """
    held = session(count, rng, (12.0, 45.0), (4.5, 7.5))
    nominal, cycle = mains(count, rng)
    pair = [
        transformer(count, rng, cycle + half, nominal, held.cooking, rng.uniform(300.0, 650.0)) for half in (0.0, 0.5)
    ]
    speed = spin_down(count, rng, held.cooking, rng.uniform(2.0, 6.0)) * (1.0 + slow(count, rng, 0.4, 0.002))
    blow = noise(
        count, rng, turbulence(rng, rng.uniform(600.0, 1200.0), rng.uniform(3.5, 5.0), 3.0, 2.5) + louvres(rng)
    )
    tones = np.zeros(count, dtype=np.float32)
    wheel = int(rng.integers(11, 18))
    for _ in range(2):
        turns = turns_of(nominal * (1.0 - rng.uniform(0.03, 0.08)) * speed, count, rng.random())
        tones += rotor(turns, blades(wheel, rng, 0.25, 4, 0.55), rng, 60.0, 0.2, 0.12)
    arm = turns_of(rng.uniform(1.0, 2.0) * np.maximum(held.cooking, 1e-3), count, rng.random())
    gear = rotor(arm, {k: rng.uniform(0.2, 1.0) for k in range(90, 420, 30)}, rng, 2.0, 0.4, 0.4)
    gear *= (1.0 + 0.3 * cosine(arm)) * expand(held.cooking, count)
    wide = sheet_metal(rng, 100.0, 1100.0, 8.0)
    contactor = struck(
        count,
        rng,
        np.sort(np.concatenate([held.starts, held.ends])),
        rng.uniform(0.8, 1.4, len(held.starts) + len(held.ends)),
        slopes([(120.0, -4.0), (500.0, 0.0), (3000.0, -9.0), (9000.0, -24.0)]) + ripple(rng, 3.0),
        0.1,
        1.0,
    )
    loud = expand(speed**2.5, count)
    clatter = impacts(count, rng, 0.4, slopes([(700.0, -9.0), (2500.0, 0.0), (9000.0, -14.0)]), 0.7, 0.1)
    return np.asarray(
        1.3 * blow * loud
        + decibels(rng.uniform(-9.0, -2.0)) * tones * loud
        + radiated(decibels(rng.uniform(-2.0, 4.0)) * (pair[0] + pair[1]), wide)
        + decibels(rng.uniform(-14.0, -8.0)) * gear
        + 4.0 * contactor
        + 3.5 * door(count, rng, held)
        + 0.4 * clatter
        + 1.2 * beeps(count, rng, held.ends + 4000, rng.uniform(2850.0, 3050.0), rng.uniform(0.5, 0.9), 1.3, 2)
        + 0.7 * beeps(count, rng, held.keys, 2900.0, 0.12, 1.0, 1)
        + 1.5 * kitchen(count, rng, held.cooking),
        dtype=np.float64,
    )
