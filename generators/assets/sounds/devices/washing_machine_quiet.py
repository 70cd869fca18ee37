"""Front loaders that wash and do not spin: a small load in deep water, and an old one with brushes and a long belt."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices.washing_machine_parts import (
    cabinet,
    gate,
    laundry,
    programme,
    residual,
    reversing,
    roar,
    slosh,
)
from generators.assets.sounds.fans import radiated, ripple, slopes
from generators.assets.sounds.machines import (
    VibratingBody,
    bursts,
    driven,
    drummed,
    expand,
    passages,
    permanent_magnet_motor,
    plate,
    read_at,
    rolling,
    sine,
    sloped,
    struck,
    switched,
    turned,
    universal_motor,
    wander,
)
from generators.assets.sounds.signals import Array


def _poured(count: int, rng: Generator, wash: Array, ribs: int) -> Array:
    """Water that the ribs lift and pour out, and that washes to and fro in the tub: a control curve about .5."""
    lifted = 0.5 + 0.5 * np.cos(2 * np.pi * (ribs * turned(wash) + 0.25 * wander(count, rng, 1.5, 1.0)))
    surge = np.exp(wander(count, rng, rng.uniform(1.2, 2.5), 0.4))
    return np.asarray(np.abs(wash) / 0.85 * (0.3 + 0.7 * lifted**2) * surge)


def half_load_splash(count: int, rng: Generator) -> Array:
    """Front loader with a small load in plenty of water, heard at its door: splashes, slaps on water, a soft whine.

    Model: one or two bundles at 40 to 56 rpm leave the drum and fall into the water once a turn (M. E. Roberts et al.,
    ANZIAM Journal 59 (2019) M30–M62): a slap, drops and bubbles (K. van den Doel, ACM Trans. Appl. Percept. 2 (2005)
    534–546) behind a bowl of glass. An inverter's motor with magnets whines at even electrical orders (J. F. Gieras, C.
    Wang, J. C. Lai (2006)). In the pauses the water settles and drips. Units: motor, belt or none, tub, bowl, bundles,
    depth, suds.
    """
    run = reversing(count, rng, (8, 24), (1.2, 3.5), rng.uniform(0.6, 1.3))
    wash = rng.uniform(0.67, 0.93) * run
    ratio = 1.0 if rng.random() < 0.4 else rng.uniform(9.0, 11.5)
    pairs = 24 if ratio == 1.0 else int(rng.choice([4, 5]))
    motor = permanent_magnet_motor(count, rng, ratio * wash, ratio, pairs, 3 * pairs // (2 if ratio == 1.0 else 1))
    body = plate(rng, rng.uniform(50, 90), rng.uniform(1500, 3200), 30, 0.09, slope=-1.5)
    bowl = plate(rng, rng.uniform(280, 600), rng.uniform(3500, 6000), 22, 0.11, slope=0.5)
    bundles, ribs = int(rng.integers(1, 3)), int(rng.choice([3, 3, 4]))
    falls = passages(turned(wash) + 0.08 * wander(count, rng, 0.9, 1.0), bundles)
    swift = np.abs(read_at(wash, falls))
    force = (swift > 0.25) * np.exp(rng.normal(0, 0.5, len(falls)))
    falls = falls + rng.uniform(0.2, 0.35) + rng.normal(0, 0.05, len(falls))
    depth = rng.uniform(0.6, 1.3)
    slap = sloped(count, rng, rng.uniform(260, 520), rng.uniform(2500, 5000), rng.uniform(-5.0, -3.5), 6.0, -9.0)
    slaps = slap * expand(bursts(count, falls, force, 0.008, rng.uniform(0.12, 0.28)), count)
    thrown = depth * bursts(count, falls + 0.04, force, 0.04, rng.uniform(0.4, 0.9))
    splash = slosh(count, rng, thrown, (0.9, 7.0), 110.0)
    poured = slosh(count, rng, 0.7 * depth * _poured(count, rng, wash, ribs), (0.9, 5.0), 80.0)
    settling = np.convolve(np.abs(run), np.exp(-np.arange(900) / 260.0) / 260.0)[: len(run)] + 0.15
    drip = slosh(count, rng, 0.35 * settling * np.exp(wander(count, rng, 1.0, 0.4)), (0.9, 4.5), 90.0)
    water = rng.uniform(0.6, 1.2) * splash + poured + rng.uniform(0.5, 1.0) * slaps
    inside = (
        0.7 * water
        + rng.uniform(0.3, 0.6) * driven(water, bowl)
        + rng.uniform(0.3, 0.8) * struck(count, rng, body, falls, force, rng.uniform(4e-3, 8e-3), spread=0.5)
        + 0.2 * laundry(count, rng, wash, body, ribs, 0.1)
        + rng.uniform(0.03, 0.1) * driven(motor, plate(rng, rng.uniform(170, 300), 3200, 26, 0.06, slope=-1.0))
        + 0.02 * motor
        + 0.4 * rolling(count, rng, wash, 0.9, roar(count, rng, rng.uniform(70, 140), -6.0, rng.uniform(2500, 6000)))
        + 0.7 * drip
        + 0.4 * residual(count, rng, 70.0)
    )
    suds = slopes([(600, 0.0), (2400, rng.uniform(-3.0, 1.0)), (9600, rng.uniform(-10.0, -2.0))])
    return np.asarray(radiated(inside, suds + ripple(rng, 1.5)), dtype=np.float64)


def _filling(count: int, rng: Generator, filling: Array, mains: float) -> Array:
    """Water through a solenoid valve: armature and hum at twice the mains, hiss of the orifice, a jet into the tub.

    ISO 3822-1 measures such valves: broad noise with most energy at 1–4 kHz. The mains pressure wanders.
    """
    flowing = filling * np.exp(wander(count, rng, 0.5, 0.1) + wander(count, rng, 6.0, 0.06))
    hiss = sloped(count, rng, rng.uniform(600, 1300), 6500, rng.uniform(-4.0, -2.5), below=5.0, beyond=-14.0)
    hiss = 0.5 * hiss + 0.5 * driven(hiss, plate(rng, 250, 3200, 12, 0.07))
    edges = switched(filling > 0.5)
    armature = struck(count, rng, plate(rng, 120, 3200, 18, 0.04, -1.0), edges, rng.uniform(0.7, 1.4, len(edges)), 6e-4)
    cycle = turned(2.0 * mains * (1.0 + wander(count, rng, 0.1, 3e-4)))
    hum = sine(cycle, count, filling * np.exp(wander(count, rng, 0.7, 0.15))) + sine(2 * cycle, count, 0.5 * filling)
    jet = slosh(count, rng, 0.7 * flowing, (0.9, 6.0), 90.0)
    return np.asarray(hiss * expand(flowing, count) + 0.7 * jet + 0.12 * hum + 0.8 * armature)


def _belt(count: int, rng: Generator, wash: Array, radius: float, body: VibratingBody) -> Array:
    """A long worn belt: its joint knocks on both pulleys, its slack span flaps, it slips as the drum starts.

    Model: the joint passes each pulley once per length of the belt (1.1 to 1.4 m; drum's pulley of ``radius`` m); the
    span is a string of .3 to .45 m whose first mode, some 25 to 60 Hz, the joint and the motor's torque excite.
    """
    passed = turned(wash) * 2 * np.pi * radius / rng.uniform(1.1, 1.4)
    parts = []
    for late in (0.0, rng.uniform(0.3, 0.5)):
        times = passages(passed + late + 0.01 * wander(count, rng, 2.0, 1.0), 1)
        swift = np.abs(read_at(wash, times))
        parts.append((times, swift * rng.uniform(0.5, 1.2) * np.exp(rng.normal(0, 0.35, len(times)))))
    times, force = np.concatenate([each for each, _ in parts]), np.concatenate([each for _, each in parts])
    knocks = drummed(count, rng, body, times, force, 2e-3, 0.4)
    # Between the knocks the span goes on flapping, now more, now less.
    flapping = np.clip(bursts(count, times, force, 0.03, 0.6) + wander(count, rng, 1.5, 0.4), 0.0, 2.0) * np.abs(wash)
    span = turned(rng.uniform(25.0, 60.0) * np.exp(wander(count, rng, 3.0, 0.05)))
    beats = passages(span, 1)
    height = read_at(flapping, beats) * np.exp(rng.normal(0, 0.4, len(beats)))
    flaps = drummed(count, rng, plate(rng, 150, 2600, 20, 0.08, -1.0), beats, height, 1e-3, 0.4)
    starts = switched(np.abs(wash) > 0.2, rising=True)
    slip = driven(sloped(count, rng, 500, 3000, -2.0), plate(rng, 500, 1600, 4, 0.01))
    slipping = bursts(count, starts, rng.uniform(0.0, 1.0, len(starts)), 0.05, rng.uniform(0.3, 0.8))
    return np.asarray(knocks + 0.5 * flaps + 0.2 * slip * expand(slipping, count))


def _timer(count: int, rng: Generator) -> Array:
    """A timer with a synchronous motor: its pawl ticks unevenly, now and then a cam drops a contact."""
    period = 1.0 / rng.uniform(1.2, 6.0)
    ticks = np.cumsum(period * np.exp(rng.normal(0, 0.05, int(count / SAMPLE_RATE / period * 1.2) + 9)))
    force = np.exp(rng.normal(0, 0.2, len(ticks))) * np.where(np.arange(len(ticks)) % 2 == 0, 1.0, rng.uniform(0.5, 1))
    cams = np.cumsum(rng.exponential(7.0, count // (5 * SAMPLE_RATE) + 4))
    case = plate(rng, rng.uniform(600, 1200), 6500, 18, 0.05)
    return np.asarray(
        struck(count, rng, case, ticks, force, 1.5e-4) + struck(count, rng, case, cams, rng.uniform(1.5, 5.0), 3e-4)
    )


def old_gear_wash(count: int, rng: Generator) -> Array:
    """Front loader of the 1980s that washes: a brushed motor growls, a long belt flaps, a timer ticks, a valve fills.

    Model: a series motor runs 10 to 16 times as fast as the drum (its gear is the belt, `_belt`); phase control makes
    its torque pulse at twice the mains, its brushes strike 24 to 36 bars a turn (`machines.universal_motor`). The tub
    hangs on springs in a cabinet that radiates (D. C. Conrad and W. Soedel, Journal of Sound and Vibration 188 (1995)
    301–314). Filling as `_filling`. Units: motor, belt, bearings, timer, valve, drum, cabinet, load.
    """
    spans = programme(count, rng, (("wash", 14, 45), ("fill", 4, 12)))
    run = reversing(count, rng, (8, 18), (1.2, 2.8), rng.uniform(0.4, 0.9))
    wash = rng.uniform(0.78, 0.98) * run * (1.0 - rng.choice([0.0, 1.0]) * gate(count, spans, "fill", 0.5))
    ratio, mains = rng.uniform(10.0, 16.0), float(rng.choice([50.0, 60.0]))
    body = cabinet(rng, rng.uniform(50, 80), rng.uniform(1200, 2200), 0.05)
    motor = universal_motor(count, rng, ratio * np.abs(wash), ratio, int(rng.choice([24, 28, 32, 36])), mains)
    growl = driven(motor, plate(rng, rng.uniform(130, 220), 2400, 22, 0.06, slope=-1.0))
    noise = roar(count, rng, rng.uniform(90, 170), rng.uniform(-6.0, -4.5), rng.uniform(2500, 6000))
    belt = _belt(count, rng, wash, rng.uniform(0.13, 0.17), body.joined(plate(rng, 300, 2600, 16, 0.04), 0.6))
    filling = gate(count, spans, "fill", 0.12)
    relay = switched(np.abs(run) > 0.15)
    water = 0.5 * _poured(count, rng, wash, 3)
    return np.asarray(
        rng.uniform(0.2, 0.45) * growl
        + 0.12 * driven(motor, body)
        + 0.05 * motor
        + rng.uniform(0.4, 0.8) * rolling(count, rng, wash, 0.9, noise)
        + rng.uniform(1.5, 4.0) * belt
        + rng.uniform(0.9, 1.5) * laundry(count, rng, wash, body, 3, 0.12)
        + rng.uniform(0.5, 0.9) * slosh(count, rng, water, (1.2, 7.0), 55.0)
        + rng.uniform(0.3, 0.8) * _filling(count, rng, filling, mains)
        + 0.4 * struck(count, rng, plate(rng, 700, 5000, 14, 0.03), relay, 1.0, 2e-4)
        + rng.uniform(0.08, 0.25) * _timer(count, rng)
        + 0.35 * residual(count, rng, 70.0),
        dtype=np.float64,
    )
