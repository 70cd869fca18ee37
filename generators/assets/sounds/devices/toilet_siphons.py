"""Toilets in which a siphon runs and breaks: one in the cistern, one in the trap under the floor."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from generators.assets.sounds.devices.toilet_parts import (
    PLUME,
    QUIET_VALVE,
    RESIDUE,
    RIM,
    SUCTION,
    VALVE,
    drop_seat,
    filling_resonance,
    valve_flow,
)
from generators.assets.sounds.signals import Array
from generators.assets.sounds.water import Spectrum, Take, frame_drift, gulps, knock, moving_peak, spectrum

#: A fan of water that strikes bare ceramic: no pool, so few large bubbles.
_SHEET: Spectrum = {63: -30, 125: -20, 250: -11, 500: -5, 1000: -2, 2000: 0, 4000: -3, 8000: -8, 16_000: -21}


def _stroke(take: Take, moment: float, level: float, lever: float) -> None:
    """A pull at the lever: the linkage knocks, a plate lifts water over the siphon's crest, the lever falls back."""
    rng = take.rng
    take.at(moment, 0.8 * level, knock(rng, lever, 4500, 0.06, click=0.5))
    take.line.add("lift", (moment, 0.0), (moment + 0.12, 0.6 * level), (moment + 0.3, 0.3 * level), (moment + 0.5, 0.0))
    take.at(moment + rng.uniform(0.35, 0.8), rng.uniform(0.3, 0.7), knock(rng, 0.8 * lever, 3500, 0.06))


def lever_siphon(count: int, rng: Generator) -> Array:
    """Low cistern with a siphon that a lever primes, as in British homes: it runs evenly, breaks with a gasp, dribbles.

    Model: a siphon's flow goes with the root of the height between the level and its outlet (A. Richert, P.-M. Binder,
    The Physics Teacher 49 (2011) 78–80), which changes little, so the flush hardly fades until air enters under the
    bell: slugs in its legs (`water.gulps`), the rest falls back. A weak first stroke primes nothing. A ball valve above
    the water fills a vessel whose air resonates ever higher. Units: lever, bell, cistern, pan, valve, skill.
    """
    take = Take(count, rng)
    flush, fill, bell = rng.uniform(3.6, 6.0), rng.uniform(14.0, 34.0), rng.uniform(130.0, 330.0)
    lever, fails = rng.uniform(220.0, 600.0), rng.uniform(0.0, 0.5)
    rush, hiss, fade = rng.uniform(4.5, 9.0), rng.uniform(0.03, 0.1), rng.uniform(0.6, 0.85)
    spans = []
    now = -rng.uniform(0.0, 0.9) * flush if rng.random() < 0.5 else rng.uniform(0.3, 2.4)
    while now < take.line.seconds:
        if rng.random() < 0.3:
            drop_seat(take, now - rng.uniform(1.6, 2.6), rng.uniform(0.8, 1.8))
        if rng.random() < fails:
            failed = now - rng.uniform(0.8, 1.3)
            _stroke(take, failed, rng.uniform(0.4, 0.9), lever)
            take.line.add("pan", (failed + 0.2, 0.0), (failed + 0.4, rng.uniform(0.15, 0.35)), (now, 0.05))
        _stroke(take, now - 0.2, 1.0, lever)
        length = flush * rng.uniform(0.92, 1.08)
        over, end = now + length, now + length + fill * rng.uniform(0.92, 1.08)
        take.line.add("pan", (now, 0.1), (now + 0.25, 0.9), (now + 0.9, 1.0), (over - 0.3, fade))
        take.line.add("pan", (over + 0.3, 0.25), (over + 1.2, 0.08), (over + 3.0, 0.0))
        take.line.add("rim", (now + 0.15, 0.0), (now + 0.6, 1.0), (over, 0.7), (over + 0.6, 0.2), (over + 4.0, 0.0))
        take.line.add("gasp", (over - 0.35, 0.0), (over, 1.0), (over + 0.25, 0.5), (over + 1.1, 0.0))
        take.at(over - 0.2, rng.uniform(0.9, 2.0), gulps(rng, int(rng.integers(2, 7)), bell, rush, 0.8))
        take.line.add("dribble", (over, 0.0), (over + 0.6, 1.0), (over + 6.0, 0.15))
        take.line.add("fill", *valve_flow(now + 1.2, end - now - 1.2, hiss, rng.uniform(3.0, 9.0)))
        spans.append((over, end))
        now = end + rng.uniform(2.0, 6.0)
    throat = bell * 2.0 * np.exp(frame_drift(len(take.line.times), rng, 6.0, 0.2))
    power = take.power("pan", spectrum(PLUME, rng, 1.5, 2.5, 3), 2.5, 12.0)
    power += rng.uniform(0.05, 0.4) * take.power("rim", spectrum(RIM, rng, 1.5), 2.0, 10.0)
    power += 0.3 * take.power("lift", spectrum(SUCTION, rng), 3.0, 15.0)
    power += 0.35 * take.power("gasp", spectrum(PLUME, rng, 1.5), 4.0, 20.0) * moving_peak(throat, 2.5, 9.0)
    power += take.power("fill", spectrum(VALVE, rng, 1.5), 1.8, 8.0) * moving_peak(
        filling_resonance(take, rng.uniform(230, 330), rng.uniform(480, 760), spans), 3.0, 6.0
    )
    power += take.power("-", spectrum(RESIDUE, rng, 1.5), 1.0, least=rng.uniform(0.05, 0.08))
    water = 0.6 * take.bubbles("pan", 120, (0.9, 7.0), 1.0) + 0.5 * take.bubbles("dribble", 35, (0.9, 5.0))
    water += 1.8 * take.splashes("pan", 50, 0.3) + 0.5 * take.splashes("fill", 200) + 0.6 * take.splashes("dribble", 18)
    return take.heard(power, water, 1.6)


def squat_pan(count: int, rng: Generator) -> Array:
    """Squatting pan in the floor: a flush pipe spits its air, a sheet runs over bare ceramic, the trap runs dry.

    Model: the water strikes no pool but a plate, so it is bright, and reaches the trap as a plug that fills the drain
    and draws the trap after it: self-siphonage (J. L. French, H. N. Eaton, Self-siphonage of Fixture Traps, National
    Bureau of Standards, BMS 126, 1951), which ends in slugs of air far below (`water.gulps`). A tail of the
    flush fills it again. Units: pipe, plate, opening of the trap, drain, a valve that is hardly heard, dripping.
    """
    take = Take(count, rng)
    flush, drain, opening = rng.uniform(2.6, 5.0), rng.uniform(65.0, 150.0), rng.uniform(140.0, 380.0)
    handle, spits, tail = rng.uniform(350.0, 900.0), rng.uniform(0.2, 0.8), rng.uniform(3.0, 9.0)
    plate, late = rng.uniform(0.4, 1.0), rng.uniform(0.6, 1.4)
    now = -rng.uniform(0.0, 0.9) * flush if rng.random() < 0.5 else rng.uniform(0.2, 2.4)
    while now < take.line.seconds:
        length = flush * rng.uniform(0.88, 1.12)
        over = now + length
        take.at(now - 0.2, rng.uniform(0.5, 1.1), knock(rng, handle, 5500, 0.05, click=0.7))
        take.line.add("spit", (now - 0.1, 0.0), (now, spits), (now + 0.35, 0.6 * spits), (now + 0.8, 0.0))
        take.line.add("sheet", (now, 0.0), (now + 0.3, 0.8), (now + 0.7, 1.0), (over - 0.8, 0.6), (over, 0.2))
        take.line.add("sheet", (over + 0.4 * tail, 0.06), (over + tail, 0.0))
        take.line.add("trap", (now + 0.3, 0.0), (now + 0.9, 0.9), (over - 0.3, 0.8), (over + 0.8, 0.15))
        take.line.add("trap", (over + tail, 0.0))
        sucked = over - late * rng.uniform(0.7, 1.1)
        take.line.add("suck", (sucked - 0.7, 0.0), (sucked - 0.1, 0.9), (sucked + 0.3, 0.6), (sucked + 0.8, 0.0))
        number = int(rng.integers(2, 6))
        take.at(sucked, rng.uniform(0.8, 2.2), gulps(rng, number, drain, rng.uniform(3.0, 6.5), 0.7))
        take.line.add("drops", (over, 0.2), (over + 0.8, 1.0), (over + tail, 0.25), (over + tail + 6.0, 0.08))
        take.line.add("fill", *valve_flow(now + 0.6, rng.uniform(10.0, 18.0), rng.uniform(0.01, 0.04), 2.0))
        now += length + tail + rng.uniform(2.0, 8.0)
    mouth = opening * np.exp(frame_drift(len(take.line.times), rng, 4.0, 0.1))
    power = plate * take.power("sheet", spectrum(_SHEET, rng, 1.5, 2.5, 3), 2.5, 10.0)
    power += take.power("spit", spectrum(RIM, rng, 1.5), 4.5, 22.0)
    power += 0.7 * take.power("trap", spectrum(PLUME, rng, 1.5, 2.5), 4.0, 14.0) * moving_peak(mouth, 2.5, 8.0)
    power += 0.8 * take.power("suck", spectrum(SUCTION, rng), 4.0, 15.0)
    power += take.power("fill", spectrum(QUIET_VALVE, rng, 1.5), 1.5, 6.0)
    power += take.power("-", spectrum(RESIDUE, rng, 1.5), 1.0, least=rng.uniform(0.08, 0.12))
    water = 0.5 * take.bubbles("trap", 110, (1.0, 8.0)) + 0.6 * take.bubbles("drops", 16, (0.9, 5.0), 0.5)
    water += 1.6 * take.splashes("sheet", 90, 0.3) + 2.0 * take.splashes("spit", 70) + 0.6 * take.splashes("drops", 9)
    return take.heard(power, water, 1.4)
