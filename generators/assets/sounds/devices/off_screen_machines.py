"""Dishwashers, fans and kettles, which belong to no category of the benchmark."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import butter, iirpeak, lfilter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import case_modes, click, gate, resonator, turning, unsteady, wave
from generators.assets.sounds.room_tone import over_room_tone, slow_curve, spectrum_noise
from generators.assets.sounds.signals import Array, add_at, bubbles, phase_of, strike, time_axis, unit

_TUB = (60, 125, 250, 500, 1000, 2000, 4000, 8000, 16_000)


def _jets(count: int, rng: Generator, rate: Array, dull: float) -> Array:
    """Water jets that sweep the tub: noise whose level and colour change with the angle of the arm.

    Args:
        count: samples.
        rng: the only source of randomness.
        rate: (count,) revolutions per second of the arm.
        dull: tilt of the spectrum (dB per octave) by the door.
    """
    angle = phase_of(rate, count, rng.uniform(0, 6.28))
    turns = angle / (2 * np.pi) * 64
    # Dishes differ from place to place: levels by angle, the same in each revolution but for a tenth.
    pattern = np.exp(rng.normal(0.0, 0.35, 65))
    pattern[-1] = pattern[0]
    near = np.interp(np.mod(turns, 64), np.arange(65), pattern)
    body = spectrum_noise(count, rng, _TUB, [-20, -8, -3, 0, -3, -8 + dull, -14 + 2 * dull, -22 + 3 * dull, -45])
    splash = spectrum_noise(count, rng, _TUB, [-40, -30, -18, -8, -2, 0, -5 + dull, -14 + 2 * dull, -40])
    beat = np.exp(slow_curve(count, rng, 22.0, 0.22))
    return np.asarray(near * body + 0.6 * near[::-1] * splash * beat + 0.5 * (near - near.mean()) * splash)


def _pump(count: int, rng: Generator, turns: Array, blades: int, motor: tuple[float, ...]) -> Array:
    """A pump: orders of the shaft, the blade passing, and the water's noise round it."""
    phase = phase_of(turns, count)
    shaft = wave(phase, motor, rng)
    passing = wave(blades * phase, [1.0, 0.4, 0.2], rng) * (1 + slow_curve(count, rng, 12.0, 0.2))
    return unit(shaft + 0.5 * passing)


def spray_arms(count: int, rng: Generator) -> Array:
    """A dishwasher that washes: an induction motor of two poles, an impeller, two arms of jets behind a door.

    Unit: slip (2–6 %), mains 50 or 60 Hz, blades, speed of the arms (20–45 turns per minute), door. Take: what the
    jets hit, pauses of the pump, dishes that knock.
    """
    mains = float(rng.choice([50.0, 60.0]))
    turns = mains * (1 - rng.uniform(0.02, 0.06)) * unsteady(count, rng, 0.002, 0.001)
    pump = _pump(count, rng, turns, int(rng.integers(5, 9)), (1.0, 0.6, 0.2, 0.15))
    hum = wave(turning(count, rng, 2 * mains, 1e-4, 5e-5), [1.0, 0.35, 0.25, 0.1, 0.08], rng)
    arm = rng.uniform(0.33, 0.75) * (1 + slow_curve(count, rng, 0.3, 0.05))
    jets = _jets(count, rng, arm, -rng.uniform(0.0, 2.0))
    knocks = np.zeros(count)
    for _ in range(rng.poisson(0.5 * count / SAMPLE_RATE)):
        dish = [(f, 0.3 * rng.uniform(0.3, 1.0), a) for f, _, a in case_modes(rng, 900.0, 5500.0, 4)]
        add_at(knocks, int(rng.integers(0, count)), rng.uniform(0.2, 1.0) ** 2 * strike(dish, 0.3, rng))
    on, now, bursts = rng.uniform(20.0, 60.0), -rng.uniform(0.0, 40.0), []
    while now * SAMPLE_RATE < count:
        bursts.append((now, now + on))
        now += on * rng.uniform(0.9, 1.1) + rng.uniform(2.0, 5.0)
    level = 0.25 + 0.75 * gate(count, bursts, 0.8, 0.6)
    drip = bubbles(count, rng, 6.0, (1.5, 6.0))
    return level * (jets + 0.25 * pump + rng.uniform(0.1, 0.3) * hum + 0.3 * knocks) + 0.1 * drip


def inverter_two_arms(count: int, rng: Generator) -> Array:
    """A quiet dishwasher: a brushless pump changes its speed every few seconds and feeds the arms in turn."""
    seconds = count / SAMPLE_RATE
    times = np.cumsum(rng.uniform(6.0, 22.0, int(seconds / 6) + 3))
    speeds = rng.uniform(28.0, 55.0, len(times) + 1)
    knots = np.concatenate([[0.0], np.ravel(np.stack([times, times + rng.uniform(0.6, 2.0, len(times))], axis=1))])
    turns = np.interp(time_axis(count), knots, np.repeat(speeds, 2)[: len(knots)]) * unsteady(count, rng, 0.002, 0.001)
    pump = _pump(count, rng, turns, int(rng.integers(5, 8)), (0.6, 0.3, 0.2))
    # Six steps of current per electrical period, four pole pairs.
    whine = wave(phase_of(24 * turns, count), [1.0, 0.3, 0.2], rng)
    arm = rng.uniform(0.25, 0.5) * (turns / 40.0) ** 2
    jets = _jets(count, rng, arm, -rng.uniform(1.5, 3.5)) * (turns / 45.0) ** 2
    valve = np.zeros(count)
    for moment in times:
        add_at(
            valve, int(moment * SAMPLE_RATE), rng.uniform(0.4, 1.5) * strike(case_modes(rng, 180.0, 1500.0), 0.2, rng)
        )
    return jets + 0.35 * pump * (turns / 45.0) + rng.uniform(0.03, 0.12) * whine + 0.6 * valve


def drain_and_fill(count: int, rng: Generator) -> Array:
    """A dishwasher that pumps out and fills: a synchronous pump that slaps, air in the hose, an inlet valve's hiss."""
    mains = float(rng.choice([50.0, 60.0]))
    seconds = count / SAMPLE_RATE
    now, drains, fills = -rng.uniform(0.0, 15.0), [], []
    while now < seconds:
        drain, fill = rng.uniform(8.0, 20.0), rng.uniform(10.0, 25.0)
        drains.append((now, now + drain))
        fills.append((now + drain + 1.0, now + drain + 1.0 + fill))
        now += drain + fill + rng.uniform(1.5, 4.0)
    pumping, filling = gate(count, drains, 0.05, 0.1), gate(count, fills, 0.15, 0.1)
    phase = turning(count, rng, mains, 2e-4, 2e-4)
    slap = wave(phase, np.array([0.3, 1, 0.25, 0.8, 0.2, 0.6, 0.2, 0.4, 0.15, 0.3, 0.1, 0.2]), rng)
    air = np.clip(0.5 + slow_curve(count, rng, 6.0, 0.5), 0.0, 1.2)
    rush = spectrum_noise(count, rng, _TUB, [-25, -12, -5, 0, -2, -6, -12, -20, -42])
    gulps = bubbles(count, rng, 45.0 * pumping * air + 0.5, (3.0, 14.0))
    hiss = spectrum_noise(count, rng, _TUB, [-35, -22, -12, -6, -2, 0, -3, -10, -32])
    whistle = lfilter(*iirpeak(rng.uniform(900, 2600), rng.uniform(15, 40), fs=SAMPLE_RATE), hiss)
    splash = bubbles(count, rng, 90.0 * filling + 1.0, (0.8, 4.0))
    panel = [(float(f), 8.0, 1.0) for f in rng.uniform(150, 700, 3)]
    pump = pumping * (1 + 0.3 * air) * resonator(unit(slap), panel, 0.3)
    water = filling * (0.25 * hiss + rng.uniform(0.5, 2.0) * whistle) + 0.3 * splash
    return over_room_tone(0.5 * pump + pumping * air * 0.35 * rush + 0.3 * gulps + water + 0.02 * rush, rng)


def tabletop_one_arm(count: int, rng: Generator) -> Array:
    """A small dishwasher on the worktop: a synchronous pump, one quick arm, a thin door, a heater with its relay.

    Unit: mains, speed of the arm (0.7–1.4 turns per second), door, panel. Take: dishes, spells of heating, when the
    pump rests. The pump turns in step with the mains, so that it has no slip and its noise is beaten at 50 or 60 Hz.
    """
    mains = float(rng.choice([50.0, 60.0]))
    phase = turning(count, rng, mains, 2e-4, 2e-4)
    panel = [(float(f), rng.uniform(5.0, 12.0), rng.uniform(0.4, 1.0)) for f in rng.uniform(200, 1300, 4)]
    pump = resonator(unit(wave(phase, np.arange(1.0, 21.0) ** -rng.uniform(0.5, 0.9), rng)), panel, 0.25)
    jets = _jets(count, rng, rng.uniform(0.7, 1.4) * (1 + slow_curve(count, rng, 0.4, 0.04)), rng.uniform(0.0, 1.5))
    beaten = 1 + rng.uniform(0.1, 0.3) * np.sin(phase)
    on, rests, now = rng.uniform(12.0, 30.0), [], -rng.uniform(0.0, 20.0)
    while now * SAMPLE_RATE < count:
        rests.append((now, now + on))
        now += on * rng.uniform(0.8, 1.2) + rng.uniform(1.0, 3.0)
    washing = 0.12 + 0.88 * gate(count, rests, 0.4, 0.3)
    heater = np.clip(8.0 * slow_curve(count, rng, 0.1, 1.0), 0.0, 1.0)
    hum = wave(2 * phase, [1.0, 0.3, 0.2, 0.1], rng)
    relay = np.zeros(count)
    for place in np.flatnonzero(np.diff((heater > 0.5).astype(np.int8))):
        add_at(relay, int(place), 4.0 * strike(case_modes(rng, 600.0, 5000.0), 0.1, rng))
    simmer = bubbles(count, rng, 4.0 + 25.0 * heater, (1.5, 7.0))
    drawn = washing * (beaten * jets + rng.uniform(0.3, 0.6) * pump) + rng.uniform(0.03, 0.1) * heater * hum
    return over_room_tone(drawn + 0.15 * simmer + 0.2 * relay, rng)


def _blades(count: int, rng: Generator, turns: Array, blades: int, uneven: float) -> Array:
    """Blade passing: a pulse per blade, blades unlike by ``uneven``, so that orders of the shaft lie between."""
    orders = np.arange(1, 8 * blades + 1)
    level = np.where(orders % blades == 0, 1.0, uneven) * (orders / blades + 0.3) ** -1.3
    return wave(phase_of(turns, count), level * np.exp(rng.normal(0.0, 0.4, len(orders))), rng)


def desk_axial(count: int, rng: Generator) -> Array:
    """A desk fan that swings: axial blades on a shaded-pole motor, the grille's vortices, the swing's gear.

    Unit: 900–1400 turns per minute, 3–5 blades, grille, mains hum. Take: swing of the head (6–12 s), where the noise of
    the blades is turned away; clicks at its ends.
    """
    turns = rng.uniform(15.0, 23.0) * unsteady(count, rng, 0.004, 0.002)
    swing = np.sin(phase_of(1 / rng.uniform(6.0, 12.0), count, rng.uniform(0, 6.28)))
    facing = 1 - rng.uniform(0.15, 0.5) * np.abs(swing - rng.uniform(-0.6, 0.6))
    air = spectrum_noise(count, rng, _TUB, [-4, 0, -1, -2, -4, -9, -16, -25, -45])
    hiss = spectrum_noise(count, rng, _TUB, [-40, -30, -20, -10, -3, 0, -4, -13, -36])
    puffs = 1 + 0.35 * np.clip(unit(_blades(count, rng, turns, int(rng.integers(3, 6)), 0.2)), -2, 2)
    tone = unit(_blades(count, rng, turns, 4, 0.15))
    mains = 2 * float(rng.choice([50.0, 60.0]))
    hum = wave(turning(count, rng, mains, 1e-4, 5e-5), [1.0, 0.5, 0.3, 0.15], rng)
    gear = np.zeros(count)
    for turn in np.flatnonzero(np.diff(np.sign(np.diff(swing)))):
        add_at(gear, int(turn), rng.uniform(0.3, 1.0) * strike(case_modes(rng, 300.0, 2500.0), 0.15, rng))
    return (
        facing * puffs * (air + rng.uniform(0.25, 0.6) * hiss)
        + 0.25 * tone
        + rng.uniform(0.05, 0.3) * hum
        + 0.15 * gear
    )


def ceiling_slow(count: int, rng: Generator) -> Array:
    """A ceiling fan: broad slow blades, puffs of air two to seven times a second, a mount that ticks and creaks."""
    turns = rng.uniform(1.2, 2.6) * unsteady(count, rng, 0.01, 0.002)
    blades = int(rng.integers(3, 6))
    passing = np.cos(phase_of(blades * turns, count)) + 0.4 * np.cos(phase_of(turns, count) + 1.0)
    air = spectrum_noise(count, rng, _TUB, [0, -1, -4, -8, -13, -20, -27, -36, -55])
    hiss = spectrum_noise(count, rng, _TUB, [-30, -18, -8, -2, 0, -4, -12, -22, -45])
    out = (1 + 0.3 * passing) * (air + rng.uniform(0.3, 0.7) * hiss)
    mains = 2 * float(rng.choice([50.0, 60.0]))
    out += rng.uniform(0.1, 0.4) * wave(turning(count, rng, mains, 1e-4, 5e-5), [1, 0.4, 0.4, 0.2], rng)
    once = np.flatnonzero(np.diff(np.floor(phase_of(turns, count) / (2 * np.pi))) > 0)
    kinds = [strike(case_modes(rng, 250.0, 3500.0), 0.1, rng) for _ in range(4)]
    for place in once:
        at = int(place + rng.normal(0, 0.006 * SAMPLE_RATE))
        add_at(out, at, rng.uniform(0.1, 1.2) * kinds[int(rng.integers(0, 4))])
    return out


def duct_extractor(count: int, rng: Generator) -> Array:
    """An extractor fan of a bathroom or hob: a centrifugal wheel in a housing, a duct that rings, a flap that rattles.

    Unit: wheel (9–14 blades, 18–40 turns a second), length of the duct (0.6–2.5 m, closed at the wheel), motor hum.
    Take: gusts outside that load the wheel and lift the flap.
    """
    gust = slow_curve(count, rng, 0.5, 0.4)
    turns = rng.uniform(18.0, 40.0) * (1 - 0.02 * gust) * unsteady(count, rng, 0.003, 0.001)
    passing = unit(_blades(count, rng, turns, int(rng.integers(9, 15)), 0.25))
    air = spectrum_noise(count, rng, _TUB, [-12, -5, 0, -1, -4, -9, -15, -24, -46])
    base = 343.0 / (4 * rng.uniform(0.6, 2.5))
    ringing = [(base * (2 * k - 1), rng.uniform(6.0, 14.0), 1 / k) for k in range(1, 7) if base * (2 * k - 1) < 4000]
    ducted = unit(resonator(air * np.exp(slow_curve(count, rng, 18.0, 0.12)) + 0.3 * passing, ringing, 0.35))
    mains = 2 * float(rng.choice([50.0, 60.0]))
    hum = wave(turning(count, rng, mains, 1e-4, 5e-5), [1.0, 0.6, 0.3, 0.2, 0.1], rng)
    flap, plate = np.zeros(count), case_modes(rng, 350.0, 3500.0)
    for start in np.sort(rng.integers(0, count, rng.poisson(1.5 * count / SAMPLE_RATE))):
        add_at(flap, int(start), max(0.0, 0.3 + float(gust[start])) * rng.uniform(0.1, 0.8) * strike(plate, 0.12, rng))
    return (1 + 0.15 * gust) * ducted + 0.2 * passing + rng.uniform(0.05, 0.25) * hum + 0.25 * flap


def tower_crossflow(count: int, rng: Generator) -> Array:
    """A tower fan: a long impeller of some thirty blades near a tongue; broad noise, a faint tone, a bearing."""
    turns = rng.uniform(14.0, 21.0) * unsteady(count, rng, 0.004, 0.001)
    blades = int(rng.integers(27, 39))
    passing = wave(phase_of(blades * turns, count), [1.0, 0.25, 0.1], rng) * np.exp(slow_curve(count, rng, 15.0, 0.5))
    slot = rng.uniform(220.0, 480.0)
    air = spectrum_noise(
        count,
        rng,
        [50, 0.5 * slot, slot, 2 * slot, 1500, 3000, 6000, 16_000],
        [-10, -5, 0, -3, -7, -11, -19, -48],
    )
    gusts = np.exp(slow_curve(count, rng, 1.5, 0.08) + slow_curve(count, rng, 25.0, 0.06))
    bearing = spectrum_noise(count, rng, [200, 1500, 3500, 9000], [-30, -8, 0, -25])
    bearing *= 1 + 0.6 * np.sin(phase_of(turns * rng.uniform(2.5, 3.6), count))
    return gusts * air + rng.uniform(0.08, 0.25) * passing + rng.uniform(0.03, 0.12) * bearing


def _collapses(count: int, rng: Generator, rate: Array, low: float, high: float) -> Array:
    """Steam bubbles that collapse in colder water: short impulses, rung by the vessel between ``low`` and ``high``."""
    peak = float(rate.max())
    starts = np.sort(rng.integers(0, count, rng.poisson(peak * count / SAMPLE_RATE)))
    kept = starts[rng.uniform(0, peak, len(starts)) < rate[starts]]
    weights = rng.lognormal(0.0, 0.9, len(kept)) * rng.choice([-1.0, 1.0], len(kept))
    impulses = np.asarray(np.bincount(kept, weights, count), dtype=np.float64)
    peaks = [(f, rng.uniform(1.5, 6.0), rng.uniform(0.4, 1)) for f in np.exp(rng.uniform(np.log(low), np.log(high), 6))]
    heard = lfilter(*butter(2, rng.uniform(5000.0, 9000.0), fs=SAMPLE_RATE), resonator(impulses, peaks, 0.12))
    return unit(heard)


def electric_jug(count: int, rng: Generator) -> Array:
    """An electric jug: it sings as bubbles collapse on the element, goes quieter, then boils in large bubbles; again.

    Unit: vessel, length of the stages (a boil takes 40–90 s here), switch. Take: rates, noise, when it is filled
    again. Model: impulses of collapsing bubbles at a rate that grows with heat and ends as the water is hot; then
    Minnaert's bubbles.
    """
    seconds = count / SAMPLE_RATE
    boil = rng.uniform(40.0, 90.0)
    now, times, sing, roll = -rng.uniform(0.05, 0.7) * boil, [-200.0], [0.15], [0.05]
    clicks = np.zeros(count)
    while now < seconds:
        for share, a, b in ((0.0, 0.12, 0.03), (0.15, 0.2, 0.04), (0.45, 1.0, 0.05), (0.7, 0.7, 0.1), (0.8, 0.3, 0.5)):
            times.append(now + share * boil)
            sing.append(a)
            roll.append(b)
        times += [now + boil, now + boil + 1.5]
        sing += [0.2, 0.1]
        roll += [1.0, 0.25]
        add_at(clicks, int((now + boil) * SAMPLE_RATE), 3.0 * strike(case_modes(rng, 500.0, 4000.0), 0.15, rng))
        now += boil + rng.uniform(3.0, 7.0)
    t = time_axis(count)
    singing, rolling = np.interp(t, times, sing), np.interp(t, times, roll)
    hiss = _collapses(count, rng, 200.0 + 4000.0 * singing**2, 250.0, 4500.0)
    steam = spectrum_noise(count, rng, [80, 250, 700, 2000, 6000, 14_000], [-12, -2, 0, -7, -16, -40])
    plops = bubbles(count, rng, 25.0 + 140.0 * rolling, (3.0, 13.0))
    flutter = np.exp(slow_curve(count, rng, 9.0, 0.25))
    return singing * hiss * flutter + rolling * (0.5 * steam * flutter + 0.8 * plops) + 0.05 * steam + 0.3 * clicks


def pan_with_lid(count: int, rng: Generator) -> Array:
    """A pan at a rolling boil: large bubbles, a lid that lifts and drops with the steam, a hob that cycles."""
    period = rng.uniform(8.0, 20.0)
    power = np.clip(
        0.6 + 0.5 * np.sin(phase_of(1 / period, count, rng.uniform(0, 6))) + slow_curve(count, rng, 0.8, 0.1), 0.2, 1.2
    )
    plops = bubbles(count, rng, 90.0 * power, (2.5, 12.0))
    fizz = _collapses(count, rng, 500.0 * (1.3 - power), 300.0, 2500.0)
    steam = spectrum_noise(count, rng, [80, 300, 900, 2500, 7000, 15_000], [-14, -3, 0, -6, -15, -40])
    rattle = np.zeros(count)
    plate = [(f, rng.uniform(0.08, 0.5), a) for f, _, a in case_modes(rng, 600.0, 6000.0, 9)]
    kinds = [strike([(f, d, a * rng.uniform(0.4, 1.6)) for f, d, a in plate], 0.35, rng) for _ in range(6)]
    now, beat = 0.0, rng.uniform(4.0, 9.0)
    while now * SAMPLE_RATE < count:
        strength = float(power[int(now * SAMPLE_RATE)]) ** 3
        add_at(rattle, int(now * SAMPLE_RATE), strength * rng.uniform(0.1, 1.0) * kinds[int(rng.integers(0, 6))])
        now += rng.gamma(3.0, 1 / (3.0 * beat))
    return power * (0.9 * plops + 0.15 * steam) + 0.15 * fizz + rng.uniform(0.1, 0.4) * rattle


def urn_simmering(count: int, rng: Generator) -> Array:
    """An urn that is kept hot: its thermostat switches every few seconds, bubbles collapse on the plate and die away.

    Unit: vessel, power, thermostat. Take: spells of heating, drips from the lid and hisses where they fall.
    """
    seconds, now = count / SAMPLE_RATE, -rng.uniform(0.0, 6.0)
    on, off, spells = rng.uniform(3.0, 8.0), rng.uniform(4.0, 9.0), []
    clicks, modes = np.zeros(count), case_modes(rng, 800.0, 4500.0)
    while now < seconds:
        spells.append((now, now + on * rng.uniform(0.7, 1.3)))
        for moment in spells[-1]:
            add_at(clicks, int(moment * SAMPLE_RATE), rng.uniform(0.6, 1.2) * strike(modes, 0.1, rng))
        now = spells[-1][1] + off * rng.uniform(0.7, 1.3)
    heat = gate(count, spells, 1.8, 2.4)
    singing = _collapses(count, rng, 60.0 + 2500.0 * heat**2, 400.0, 3200.0)
    plops = bubbles(count, rng, 5.0 + 50.0 * heat, (3.0, 10.0))
    steam = spectrum_noise(count, rng, [100, 400, 1200, 3500, 8000, 15_000], [-14, -4, 0, -7, -18, -42])
    hiss = np.zeros(count)
    for start in rng.integers(0, count, rng.poisson(0.8 * count / SAMPLE_RATE)):
        n = int(rng.uniform(0.08, 0.4) * SAMPLE_RATE)
        spit = rng.standard_normal(n) * np.exp(-4.0 * np.linspace(0, 1, n)) * np.minimum(1, np.arange(n) / 300)
        add_at(hiss, int(start), rng.uniform(0.3, 1.0) * spit)
    hiss = np.asarray(lfilter(*butter(2, [1500.0, 7000.0], "bandpass", fs=SAMPLE_RATE), hiss))
    warm = 0.15 + 0.85 * heat
    return over_room_tone(warm * singing + 0.6 * plops + 0.25 * warm * steam + 0.8 * hiss + 0.4 * clicks, rng)


def stove_whistle(count: int, rng: Generator) -> Array:
    """A kettle that whistles: steam through two plates with holes; the tone rises with the flow and jumps in steps.

    Unit: whistle (1.6–3.4 kHz), its share of noise, second hole, pace. Take: puffs of the boil, how long it is left on
    the fire. Model: at low flow the cavity's Helmholtz resonance, at higher flow vortices whose frequency follows the
    flow (Henrywood & Agarwal 2013).
    """
    seconds = count / SAMPLE_RATE
    cycle = rng.uniform(20.0, 45.0)
    now, times, flows = -rng.uniform(0.1, 0.8) * cycle, [-100.0], [0.1]
    while now < seconds:
        times += [now, now + 0.3 * cycle, now + 0.5 * cycle, now + 0.95 * cycle, now + 0.97 * cycle]
        flows += [0.1, 0.25, rng.uniform(0.7, 1.0), 1.0, 0.15]
        now += cycle * rng.uniform(1.0, 1.2)
    flow = np.interp(time_axis(count), times, flows) + slow_curve(count, rng, 7.0, 0.03)
    base = rng.uniform(1600.0, 3400.0)
    pitch = base * np.where(flow < 0.45, 0.86 + 0.05 * flow, 0.8 + 0.22 * flow) * unsteady(count, rng, 0.002, 0.004)
    sounding = np.clip((flow - 0.3) / 0.25, 0.0, 1.0) ** 1.5 * (1 + slow_curve(count, rng, 14.0, 0.12))
    phase = phase_of(pitch, count)
    tone = wave(phase, [1.0, 0.12, 0.04], rng) + rng.uniform(0.0, 0.6) * wave(
        phase * rng.uniform(1.13, 1.4), [1, 0.1], rng
    )
    steam = spectrum_noise(count, rng, [200, 800, 2500, 6000, 15_000], [-18, -6, 0, -3, -28])
    rumble = _collapses(count, rng, 300.0 + 900.0 * np.clip(flow, 0, 1), 120.0, 900.0)
    plops = bubbles(count, rng, 30.0 + 50.0 * np.clip(flow, 0, 1), (4.0, 13.0))
    hole = sosfilt(butter(1, [0.6 * base, 1.7 * base], "bandpass", fs=SAMPLE_RATE, output="sos"), steam)
    first = click(rng, 0.01, 800.0, 5000.0)
    out = 0.8 * sounding * tone + np.clip(flow, 0, 1.2) * (0.3 * steam + 0.5 * hole) + 0.2 * rumble + 0.3 * plops
    add_at(out, int(rng.integers(0, count)), first)
    return over_room_tone(out, rng)
