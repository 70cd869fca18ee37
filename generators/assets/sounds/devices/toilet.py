"""The voices of toilets: what drives the water (a head, the mains, compressed air, vacuum), the trap, and the refill.

Each voice repeats its programme (somebody flushes, the cistern fills, a pause) with other durations each time, and
begins somewhere in it. Levels are RMS re the loudest part of a flush. The pauses are shorter than in a home; in them
runs the residue of the device: a weeping valve, a trickle down the pan, a fan of the room.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.random import Generator

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.devices import toilet_siphons as siphons
from generators.assets.sounds.devices.toilet_parts import (
    PLUME,
    QUIET_VALVE,
    RESIDUE,
    RIM,
    SUCTION,
    VALVE,
    cistern_flow,
    drop_seat,
    filling_resonance,
    valve_flow,
)
from generators.assets.sounds.signals import Array, band_noise, drift, harmonics, phase_of
from generators.assets.sounds.voice import Voice
from generators.assets.sounds.water import (
    BANDS,
    HOP,
    Spectrum,
    Take,
    flow,
    frame_drift,
    gulps,
    hammer,
    knock,
    moving_peak,
    pipe,
    slow_phase,
    spectrum,
    whistle,
)


def washdown_close_coupled(count: int, rng: Generator) -> Array:
    """Close-coupled cistern, wash-down pan, side-entry ball-cock that whistles as it closes.

    Unit: volume (flush of 3 to 5 s), lever, pitch of the valve 700 to 1,900 Hz. The pan is emptied by the momentum of
    the water (EN 997, type 5/6), with one short draught at the end; the valve follows the float and throttles over
    several seconds (EN 14124), at a level about 12 dB below the flush.
    """
    take = Take(count, rng)
    flush, refill = rng.uniform(3.0, 5.0), rng.uniform(16.0, 30.0)
    pitch, sings = rng.uniform(700.0, 1900.0), rng.uniform(0.03, 0.12)
    lever = rng.uniform(300.0, 700.0)
    spans = []
    now = -rng.uniform(0.0, 20.0) if rng.random() < 0.45 else rng.uniform(0.2, 0.6)
    while now < take.line.seconds:
        length, fill = flush * rng.uniform(0.9, 1.1), refill * rng.uniform(0.92, 1.08)
        end = now + 0.8 + fill
        take.at(now - 0.12, 0.9, knock(rng, lever, 5200, 0.06))
        take.at(now + rng.uniform(0.25, 0.45), 0.7, knock(rng, lever, 4200, 0.05))
        take.line.add("flush", *cistern_flow(now, length))
        take.line.add("draught", (now + length - 1.3, 0.0), (now + length - 0.5, 0.7), (now + length + 0.3, 0.0))
        take.line.add("fill", *valve_flow(now + 0.8, fill, rng.uniform(0.13, 0.2), rng.uniform(4.0, 8.0)))
        take.line.add("rim", (now, 0.0), (now + 0.4, 1.0), (now + length, 0.3), (now + length + 5.0, 0.0))
        take.at(now + length - 0.1, 0.5, knock(rng, 90, 900, 0.12))
        size = int(rng.uniform(4.0, 7.0) * SAMPLE_RATE)
        bend = np.linspace(0.0, 1.0, size)
        song = whistle(rng, pitch * (1 + 0.5 * bend**2), sings * np.sin(np.pi * bend) ** 0.7 * (0.3 + bend))
        take.at(end - size / SAMPLE_RATE, 1.0, song)
        if rng.random() < 0.35:
            drop_seat(take, now - rng.uniform(0.8, 1.6), rng.uniform(0.8, 2.0))
        spans.append((now + 0.8, end))
        now = end + rng.uniform(1.0, 6.0)
    power = take.power("flush", spectrum(PLUME, rng), 3.0, 12.0)
    power += 0.25 * take.power("rim", spectrum(RIM, rng), 1.5)
    power += take.power("draught", spectrum(SUCTION, rng), 4.0, 16.0)
    power += take.power("fill", spectrum(VALVE, rng), 2.0, 8.0) * moving_peak(
        filling_resonance(take, 260, 620, spans), 3.0, 5.0
    )
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.075)
    water = 0.5 * take.bubbles("rim", 90, (0.8, 5.0), 3.0) + 0.25 * take.bubbles("fill", 200, (0.7, 4.0))
    water += 1.8 * take.splashes("flush", 60, 0.3) + 0.5 * take.splashes("fill", 120)
    return take.heard(power, water)


def siphonic_gulp(count: int, rng: Generator) -> Array:
    """Siphonic pan: the pan fills, the trap runs full and sucks, air breaks the siphon in gulps; a tube dribbles.

    Unit: trap resonance 85 to 190 Hz, 4 to 9 gulps at 4 to 8 Hz (`water.gulps`). The suction is deep (its length of
    trap), the rise of the water in the pan is heard as a rising resonance (ASME A112.19.2 siphon-jet pans). The fill
    valve feeds a tube that refills the pan: hiss over bubbles.
    """
    take = Take(count, rng)
    trap, rate = rng.uniform(85.0, 190.0), rng.uniform(4.0, 8.0)
    prime, suck, refill = rng.uniform(1.3, 2.4), rng.uniform(1.6, 3.0), rng.uniform(12.0, 24.0)
    pans, tanks = [], []
    now = -rng.uniform(0.0, 12.0) if rng.random() < 0.45 else rng.uniform(0.2, 0.8)
    while now < take.line.seconds:
        full, over = now + prime * rng.uniform(0.9, 1.1), now + prime + suck * rng.uniform(0.85, 1.15)
        end = over + refill * rng.uniform(0.9, 1.1)
        take.at(now - 0.1, 0.7, knock(rng, 260, 3600, 0.07))
        take.line.add("rush", (now, 0.0), (now + 0.3, 0.55), (full, 0.8), (over, 0.35), (over + 1.2, 0.0))
        take.line.add("suck", (full - 0.5, 0.0), (full, 0.5), (over - 0.6, 1.0), (over, 0.8), (over + 0.5, 0.0))
        number = int(rng.integers(4, 10))
        take.at(over - 0.5, rng.uniform(1.6, 2.6), gulps(rng, number, trap, rate, rng.uniform(0.3, 0.8)))
        take.line.add("slurp", (over - 0.6, 0.0), (over - 0.2, 0.9), (over + 0.4, 0.5), (over + number / rate, 0.0))
        take.line.add("fill", *valve_flow(over - 1.0, end - over + 1.0, rng.uniform(0.11, 0.18), rng.uniform(0.8, 2.0)))
        take.at(over - rng.uniform(0.5, 1.2), 0.6, knock(rng, 120, 800, 0.1))
        if rng.random() < 0.3:
            drop_seat(take, now - rng.uniform(0.7, 1.4), rng.uniform(0.8, 1.8))
        pans.append((now, full))
        tanks.append((over, end))
        now = end + rng.uniform(0.8, 6.0)
    power = take.power("rush", spectrum(PLUME, rng), 2.5, 10.0) * moving_peak(
        filling_resonance(take, 180, 480, pans), 3.0, 7.0
    )
    power += take.power("suck", spectrum(SUCTION, rng), 3.0, 14.0)
    throat = trap * 4.0 * np.exp(frame_drift(len(take.line.times), rng, 6.0, 0.25))
    power += 0.3 * take.power("slurp", spectrum(PLUME, rng), 5.0, 22.0) * moving_peak(throat, 2.0, 10.0)
    power += take.power("fill", spectrum(VALVE, rng, 1.5), 1.8, 8.0) * moving_peak(
        filling_resonance(take, 220, 450, tanks), 2.0, 4.0
    )
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.06)
    water = 0.7 * take.bubbles("rush", 110, (1.2, 8.0), 1.0) + 0.4 * take.bubbles("fill", 220, (1.0, 6.0))
    water += 1.2 * take.splashes("rush", 30) + 1.4 * take.splashes("slurp", 30)
    return take.heard(power, water)


def _flush_valve(take: Take, now: float, length: float, close: float, sings: float, pitch: float) -> None:
    """One flush from the mains: opening, plateau, a throttling end with a rising note, a knock of the pipe."""
    rng = take.rng
    end = now + length
    swell = rng.uniform(0.85, 1.0)
    take.line.add("jet", (now, 0.0), (now + 0.12, 0.8), (now + 0.5, swell), (end - close, 0.85 * swell))
    take.line.add("jet", (end - 0.3 * close, 0.5), (end - 0.05, 0.3), (end, 0.0))
    take.line.add("pan", (now + 0.1, 0.0), (now + 0.7, 0.9), (end - close, 0.75), (end, 0.25), (end + 2.5, 0.0))
    take.line.add("squeeze", (end - close, 0.0), (end - 0.2 * close, 1.0), (end, 0.2), (end + 0.05, 0.0))
    size = int(close * SAMPLE_RATE)
    bend = np.linspace(0.0, 1.0, size)
    song = whistle(rng, pitch * (1.0 + 0.8 * bend**1.5), sings * np.sin(np.pi * bend**1.4), 0.03)
    take.at(end - close, 1.0, song)


def flushometer_diaphragm(count: int, rng: Generator) -> Array:
    """Diaphragm flush valve without a cistern, in a public lavatory: the mains drive the pan for a few seconds.

    Unit: 3.5 to 6 s at about 1.5 l/s (ASSE 1037), handle, pipe of 3 to 9 m. The valve's noise goes with the pressure
    drop and moves up in frequency while the diaphragm sinks onto its seat; its closure is a small water hammer.
    """
    take = Take(count, rng)
    length, close = rng.uniform(3.5, 6.0), rng.uniform(0.5, 1.1)
    pitch, sings = rng.uniform(900.0, 2200.0), rng.uniform(0.02, 0.1)
    metres, trap = rng.uniform(3.0, 9.0), rng.uniform(110.0, 220.0)
    ends = []
    now = -rng.uniform(0.0, 9.0) if rng.random() < 0.45 else rng.uniform(0.2, 1.0)
    while now < take.line.seconds:
        own = length * rng.uniform(0.92, 1.08)
        take.at(now - 0.09, 1.1, knock(rng, 500, 6000, 0.07, click=0.7))
        take.at(now + rng.uniform(0.4, 0.8), 0.6, knock(rng, 450, 6000, 0.06, click=0.7))
        _flush_valve(take, now, own, close, sings, pitch)
        take.at(now + own - 0.02, rng.uniform(0.9, 1.8), hammer(rng, metres, rng.uniform(0.2, 0.5)))
        take.at(
            now + own * 0.7, rng.uniform(0.8, 1.4), gulps(rng, int(rng.integers(2, 6)), trap, rng.uniform(5, 9), 0.7)
        )
        ends.append((now + own - close, now + own))
        now += own + rng.uniform(4.0, 11.0)
    note = filling_resonance(take, 1500.0, 4200.0, ends)
    power = 0.5 * take.power("jet", spectrum(VALVE, rng, 1.5, 2.5, 3), 1.2, 14.0)
    power += 0.7 * take.power("pan", spectrum(PLUME, rng, 0.8, 2.0, 3), 3.0, 14.0)
    power += 0.12 * take.power("squeeze", spectrum(VALVE, rng), 2.0, 14.0) * moving_peak(note, 3.0, 12.0)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.1)
    water = 0.6 * take.bubbles("pan", 130, (0.8, 6.0), 4.0) + 1.2 * take.splashes("pan", 40, 0.3)
    return take.heard(power, water, 2.2)


def vacuum_marine(count: int, rng: Generator) -> Array:
    """Vacuum toilet of a ship or coach: rinse, a valve that opens onto half an atmosphere, its closing; a vacuum pump.

    Three stages, as measured on aircraft toilets: a peak when the valve opens, a plateau while it is open, a peak when
    it closes; radiated sound mainly from 300 Hz to 2 kHz (M. Rose et al., "Noise Reduction of a Vacuum-Assisted
    Toilet", NOISE-CON 2018, 4726–4735; "Noise control of a vacuum-assisted toilet", Proc. Mtgs. Acoust. 33, 030002).
    Unit: open for 0.9 to 2.2 s, pipe resonances, a pump of 23 to 29 revolutions per second.
    """
    take = Take(count, rng)
    opening, rinse = rng.uniform(0.9, 2.2), rng.uniform(0.8, 2.0)
    metres, turns = rng.uniform(0.5, 1.6), rng.uniform(23.0, 29.0)
    now = rng.uniform(-6.0, 1.5)
    while now < take.line.seconds:
        up = now + rinse * rng.uniform(0.9, 1.1)
        down = up + opening * rng.uniform(0.9, 1.1)
        late = down + rng.uniform(1.5, 3.0)
        take.at(now - 0.1, 0.5, knock(rng, 700, 6000, 0.04, click=0.8))
        take.line.add("rinse", (now, 0.0), (now + 0.1, 0.2), (up, 0.2), (late, 0.16), (late + 0.15, 0.0))
        take.line.add("air", (up, 0.0), (up + 0.05, 1.25), (up + 0.3, 0.6), (down - 0.25, 0.42))
        take.line.add("air", (down - 0.06, 1.0), (down + 0.06, 0.0))
        take.line.add("drain", (up + 0.05, 0.0), (up + 0.2, 0.5), (up + 0.6, 0.1), (down, 0.0))
        take.at(up - 0.03, 1.6, knock(rng, 90, 2500, 0.14, 9))
        take.at(down - 0.02, 2.0, knock(rng, 80, 2200, 0.18, 9))
        take.line.add("pump", (up, 0.55), (up + 0.5, 1.0), (late + 4.0, 0.9), (late + 9.0, 0.55))
        now = late + rng.uniform(5.0, 12.0)
    shape: Spectrum = {63: -20, 125: -12, 250: -4, 500: 0, 1000: -1, 2000: -4, 4000: -8, 8000: -13, 16_000: -24}
    air = flow(count, rng, take.power("air", spectrum(shape, rng, 0.8, 2.0, 3), 2.6, 25.0))
    power = take.power("rinse", spectrum(RIM, rng), 2.5, 14.0) + take.power("drain", spectrum(SUCTION, rng), 5.0, 20.0)
    power += take.power("-", spectrum(RESIDUE, rng), 2.0, least=0.04)
    power += 0.004 * take.power("pump", spectrum({63: -6, 250: 0, 1000: -2, 4000: -10, 16_000: -26}, rng), 2.5, 18.0)
    phase = slow_phase(count, turns * (1.0 + frame_drift(len(take.line.times), rng, 0.6, 0.004)))
    level = np.interp(np.arange(count) / SAMPLE_RATE, take.line.times, take.line.level("pump", 0.55))
    hum = harmonics(phase, [0.3, 1.0, 0.5, 0.7, 0.3, 0.5, 0.2, 0.4, 0.15, 0.3], rng)
    water = (
        0.8 * take.splashes("rinse", 200)
        + 1.5 * take.splashes("drain", 60)
        + 0.1 * take.bubbles("rinse", 150, (0.6, 3.0))
    )
    return pipe(air, metres, rng.uniform(0.3, 0.55), 5) + take.heard(power, water, 1.2) + 0.028 * level * hum


def rimless_dual_flush(count: int, rng: Generator) -> Array:
    """Rimless pan with two buttons: flushes whose water circles; a quiet diaphragm valve; a soft-close lid.

    Unit: the water circles 1.4 to 2.6 times a second and swells as it passes the outlet; half flushes of 1.5 to 2.2 s
    (3 l), full ones of 2.6 to 3.6 s (6 l). The diaphragm valve opens late and shuts at once (EN 14124, low noise group:
    ISO 3822-4), with a knock in the pipe.
    """
    take = Take(count, rng)
    half, whole, turns = rng.uniform(1.5, 2.2), rng.uniform(2.6, 3.6), rng.uniform(1.4, 2.6)
    refill, metres = rng.uniform(9.0, 16.0), rng.uniform(2.0, 7.0)
    spans = []
    now = -rng.uniform(0.0, 9.0) if rng.random() < 0.45 else rng.uniform(0.2, 1.0)
    while now < take.line.seconds:
        full = rng.random() < 0.5
        length = (whole if full else half) * rng.uniform(0.95, 1.05)
        end = now + length + refill * (1.0 if full else 0.6) * rng.uniform(0.9, 1.1)
        take.at(now - 0.2, 0.5, knock(rng, 600, 5000, 0.03, click=0.9))
        take.at(now - 0.02, 0.5, knock(rng, 180, 1500, 0.06))
        take.line.add("flush", *cistern_flow(now, length, 0.18))
        take.line.add("fill", *valve_flow(now + 0.5 * length, end - now - 0.5 * length, rng.uniform(0.09, 0.14), 0.25))
        take.at(end - 0.05, rng.uniform(0.15, 0.5), hammer(rng, metres, 0.25))
        take.line.add("drip", (now + length, 1.0), (now + length + 4.0, 0.1), (end, 0.05))
        if rng.random() < 0.4:
            moment = now - rng.uniform(1.0, 2.0)
            take.at(moment, 0.25, knock(rng, 140, 1000, 0.1))
            take.line.add("hinge", (moment - 1.2, 0.0), (moment - 0.9, 0.09), (moment - 0.1, 0.12), (moment, 0.0))
        spans.append((now + 0.5 * length, end))
        now = end + rng.uniform(0.8, 6.0)
    frames = len(take.line.times)
    phase = 2 * np.pi * np.cumsum(turns * np.exp(frame_drift(frames, rng, 0.8, 0.15))) * (HOP / SAMPLE_RATE)
    swirl = 1.0 + 0.45 * np.sin(phase) + 0.12 * np.sin(2 * phase + 1.0)
    shape: Spectrum = {63: -26, 125: -17, 250: -9, 500: -3, 1000: 0, 2000: -2, 4000: -5, 8000: -10, 16_000: -23}
    power = take.power("flush", spectrum(shape, rng, 0.8), 2.5, 10.0) * swirl[:, None]
    power += take.power("fill", spectrum(QUIET_VALVE, rng), 1.5, 6.0) * moving_peak(
        filling_resonance(take, 300, 800, spans), 4.0, 6.0
    )
    power += take.power("hinge", spectrum(QUIET_VALVE, rng), 3.0, 20.0)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.045)
    water = 0.5 * take.bubbles("flush", 160, (0.7, 4.0)) + 0.5 * take.bubbles("drip", 28, (0.8, 4.5), 1.5)
    water += 1.7 * take.splashes("flush", 60) + 0.4 * take.splashes("drip", 12) + 0.3 * take.splashes("fill", 150)
    return take.heard(power, water)


def running_ballcock(count: int, rng: Generator) -> Array:
    """A toilet that runs: water trickles past the flapper into the pan, and a worn ball-cock tops the cistern up.

    No flush at all: a steady trickle with single bubbles (van den Doel 2005), and every 8 to 20 s the float opens the
    valve for some seconds; the washer chatters at 25 to 60 Hz or sings at 450 to 1,300 Hz (a self-excited valve).
    """
    take = Take(count, rng)
    every, lasts = rng.uniform(8.0, 20.0), rng.uniform(2.5, 6.0)
    pitch, sings = rng.uniform(450.0, 1300.0), rng.uniform(0.25, 0.9)
    chatter = rng.uniform(25.0, 60.0)
    chatters = rng.random() < 0.5
    now = -rng.uniform(0.0, every)
    while now < take.line.seconds:
        length = lasts * rng.uniform(0.7, 1.3)
        take.line.add("fill", *valve_flow(now, length, rng.uniform(0.8, 1.1), 0.6 * length))
        size = int(length * SAMPLE_RATE)
        bend = np.linspace(0.0, 1.0, size)
        level = sings * np.sin(np.pi * np.clip(bend * 1.15 - 0.1, 0, 1)) ** 0.6
        take.at(now, 1.0, whistle(rng, pitch * (1.0 + rng.uniform(-0.1, 0.35) * bend), level, 0.025))
        if chatters:
            grip = np.maximum(0.0, np.sin(phase_of(chatter * np.exp(drift(size, rng, 2.0, 0.08)), size))) ** 3
            noise = band_noise(size, rng, 150, 2500, 1)
            take.at(now, rng.uniform(0.5, 1.0), grip * noise * np.clip(bend * 3 - 1.4, 0, 1))
        take.at(now + length, rng.uniform(0.2, 0.8), knock(rng, 200, 2500, 0.08))
        now += max(length + 2.0, every * rng.uniform(0.75, 1.25))
    power = take.power("fill", spectrum(VALVE, rng, 1.5), 2.2, 10.0)
    # A thin jet breaks into drops (Rayleigh), which strike the water in lumps some ten times a second.
    power += take.power("-", spectrum(RIM, rng, 1.5), 5.0, 10.0, least=rng.uniform(0.2, 0.4))
    power += take.power("-", spectrum(PLUME, rng, 1.0, 2.0, 3), 5.0, 10.0, least=rng.uniform(0.3, 0.5))
    trickle = rng.uniform(40.0, 90.0)
    water = 0.9 * take.bubbles("fill", 40, (0.9, 5.0), trickle) + 2.2 * take.splashes("fill", 25, 0.3 * trickle)
    return take.heard(power, water)


def high_level_cistern(count: int, rng: Generator) -> Array:
    """High-level iron cistern with a bell and a chain: a down pipe of 1.6 to 2 m, which resonates, and a cough of air.

    The bell lifts water over the stand pipe until a siphon runs; the flush arrives through the pipe about 0.5 s later
    with a head of two metres (louder and faster than close-coupled). Pipe: open at both ends, modes at c/2L. When the
    siphon breaks, the bell draws air in gulps and the pipe empties. The ball valve hisses above, undamped by a lid.
    """
    take = Take(count, rng)
    metres, flush, refill = rng.uniform(1.6, 2.0), rng.uniform(4.0, 6.5), rng.uniform(20.0, 38.0)
    pitch, sings = rng.uniform(1300.0, 3200.0), rng.uniform(0.02, 0.09)
    bell = rng.uniform(60.0, 105.0)
    now = -rng.uniform(0.0, 20.0) if rng.random() < 0.45 else rng.uniform(0.8, 1.2)
    while now < take.line.seconds:
        length, fill = flush * rng.uniform(0.92, 1.08), refill * rng.uniform(0.95, 1.05)
        over, end = now + length, now + 1.0 + fill
        for moment in now - 0.7 + np.sort(rng.uniform(0.0, 0.8, int(rng.integers(5, 14)))):
            take.at(moment, rng.uniform(0.1, 0.5), knock(rng, 1800, 9000, 0.05, click=0.5))
        take.at(now - 0.35, 1.3, knock(rng, 140, 2600, 0.35, 10))
        take.at(now + rng.uniform(0.5, 0.9), 1.0, knock(rng, 140, 2600, 0.35, 10))
        take.line.add(
            "pipe", (now - 0.2, 0.0), (now + 0.2, 0.5), (now + 0.6, 0.9), (over - 0.8, 0.7), (over + 0.3, 0.0)
        )
        take.line.add("flush", *cistern_flow(now + 0.25, length, 0.5))
        take.at(
            over - 0.4, rng.uniform(1.4, 2.2), gulps(rng, int(rng.integers(3, 7)), bell, rng.uniform(3.0, 5.5), 1.0)
        )
        take.line.add("cough", (over - 0.5, 0.0), (over - 0.2, 0.9), (over + 0.3, 0.4), (over + 1.0, 0.0))
        take.line.add("fill", *valve_flow(now + 1.0, fill, rng.uniform(0.16, 0.25), rng.uniform(5.0, 10.0)))
        size = int(rng.uniform(3.0, 8.0) * SAMPLE_RATE)
        bend = np.linspace(0.0, 1.0, size)
        take.at(end - size / SAMPLE_RATE, sings, whistle(rng, pitch * (1.0 - 0.2 * bend), np.sin(np.pi * bend), 0.02))
        now = end + rng.uniform(2.0, 7.0)
    shape: Spectrum = {63: -10, 125: -4, 250: -1, 500: 0, 1000: -3, 2000: -6, 4000: -11, 8000: -18, 16_000: -32}
    falling = flow(count, rng, take.power("pipe", spectrum(shape, rng), 2.0, 14.0))
    power = take.power("flush", spectrum(PLUME, rng, 0.8), 3.0, 13.0)
    power += take.power("cough", spectrum(SUCTION, rng), 5.0, 18.0)
    power += take.power("fill", spectrum(VALVE, rng, 1.5, 2.0, 3), 1.2)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.055)
    water = (
        0.6 * take.bubbles("flush", 120, (0.9, 7.0), 3.0)
        + 1.4 * take.splashes("flush", 50)
        + 0.4 * take.splashes("fill", 90)
    )
    return 0.5 * pipe(falling, metres, rng.uniform(0.45, 0.65), 7) + take.heard(power, water)


def concealed_wall(count: int, rng: Generator) -> Array:
    """Wall-hung pan whose cistern, valve and soil pipe are behind plasterboard: the wall filters all but the pan.

    The board passes sound by the mass law (−6 dB per octave above its resonance) with a coincidence at 2.2 to 3.2 kHz
    (L. Cremer, Akust. Z. 7 (1942); 12.5 mm board); its cavity resonates at 70 to 130 Hz. The soil stack (EN 14366)
    patters for seconds after the flush. A pneumatic plate clicks.
    """
    take = Take(count, rng)
    flush, refill, dip = rng.uniform(2.2, 3.4), rng.uniform(14.0, 26.0), rng.uniform(2200.0, 3200.0)
    cavity = rng.uniform(70.0, 130.0)
    spans = []
    now = -rng.uniform(0.0, 14.0) if rng.random() < 0.45 else rng.uniform(0.2, 0.6)
    while now < take.line.seconds:
        length, fill = flush * rng.uniform(0.93, 1.07), refill * rng.uniform(0.93, 1.07)
        end = now + 1.0 + fill
        take.at(now - 0.25, 0.8, knock(rng, 350, 3000, 0.05, click=0.5))
        take.at(now + rng.uniform(0.1, 0.3), 0.5, knock(rng, 300, 2600, 0.05, click=0.4))
        take.line.add("flush", *cistern_flow(now, length, 0.3))
        take.line.add("stack", (now + 0.8, 0.0), (now + 1.5, 0.7), (now + length, 0.6), (now + length + 3.5, 0.08))
        take.line.add("stack", (end, 0.04))
        take.line.add("fill", *valve_flow(now + 0.7, fill, rng.uniform(0.13, 0.2), rng.uniform(0.3, 1.5)))
        take.at(end - 0.3, rng.uniform(0.1, 0.5), hammer(rng, rng.uniform(4.0, 12.0), 0.3))
        if rng.random() < 0.4:
            take.at(now + length, rng.uniform(0.6, 1.2), gulps(rng, int(rng.integers(2, 5)), cavity * 1.6, 4.0, 0.4))
        spans.append((now + 0.7, end))
        now = end + rng.uniform(1.0, 6.0)
    place = np.log2(BANDS)
    wall = -6.0 * np.maximum(0.0, place - np.log2(180.0)) + 9.0 * np.exp(-np.square((place - np.log2(dip)) / 0.35))
    wall += 4.0 * np.exp(-np.square((place - np.log2(cavity)) / 0.3))
    shape: Spectrum = {63: -28, 125: -17, 250: -7, 500: -2, 1000: 0, 2000: -2, 4000: -4, 8000: -4, 16_000: -17}
    power = take.power("flush", spectrum(shape, rng, 0.8), 2.5, 11.0)
    power += take.power("fill", spectrum(VALVE, rng) + wall, 1.0) * moving_peak(
        filling_resonance(take, 200, 520, spans), 3.0, 6.0
    )
    power += take.power("stack", spectrum(PLUME, rng) + 0.8 * wall, 5.0, 25.0)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.045)
    water = 0.5 * take.bubbles("flush", 130, (0.8, 5.0), 2.0) + 1.8 * take.splashes("flush", 60, 0.3)
    return take.heard(power, water)


def pressure_assisted(count: int, rng: Generator) -> Array:
    """Sealed vessel with compressed air in the cistern: one burst of water and air, then the mains charge the vessel.

    The air at 1.4 to 2.4 bar above the room expands as p = p0·(V0/V)^1.4 and pushes 4 to 6 l out within 1 to 1.9 s
    (ASSE 1037); the jet's noise goes with about p^1.75 and its peak frequency with the jet's speed, √p (Lighthill
    1952). The last air escapes in a puff. While the vessel is charged the difference of pressure falls exponentially:
    the hiss grows weaker and higher, and a check valve ticks.
    """
    take = Take(count, rng)
    tau, burst = rng.uniform(0.35, 0.7), rng.uniform(1.0, 1.9)
    charge, high = rng.uniform(14.0, 26.0), rng.uniform(1600.0, 3000.0)
    speed = np.full(len(take.line.times), high)
    rising = np.full(len(take.line.times), 1800.0)
    now = -rng.uniform(0.0, 14.0) if rng.random() < 0.45 else rng.uniform(0.2, 0.8)
    while now < take.line.seconds:
        length, fill = burst * rng.uniform(0.92, 1.08), charge * rng.uniform(0.9, 1.1)
        end = now + length + fill
        take.at(now - 0.1, 0.9, knock(rng, 240, 3500, 0.08))
        take.at(now - 0.01, 2.2, knock(rng, 60, 900, 0.2, 9, 0.2))
        moments = np.linspace(0.0, length, 9)
        pressure = (1.0 + moments / tau) ** -1.4
        take.line.add("jet", (now - 0.01, 0.0), *zip(now + 0.03 + moments, 1.3 * pressure**0.875, strict=True))
        puff = now + length
        take.line.add("jet", (puff + 0.05, 0.15), (puff + 0.3, 0.0))
        take.line.add("puff", (puff - 0.1, 0.0), (puff, 0.7), (puff + rng.uniform(0.1, 0.2), 0.2), (puff + 0.7, 0.0))
        take.line.add("pan", (now, 0.0), (now + 0.15, 0.8), (puff, 0.5), (puff + 1.6, 0.05), (puff + 4.0, 0.0))
        take.at(puff - 0.1, rng.uniform(0.8, 1.5), gulps(rng, int(rng.integers(2, 4)), rng.uniform(120, 260), 7.0, 1.0))
        steps = np.linspace(0.0, fill, 8)
        take.line.add("charge", (puff, 0.0), *zip(puff + 0.4 + steps, 0.24 * np.exp(-1.6 * steps / fill), strict=True))
        take.line.add("charge", (end + 0.45, 0.0))
        take.at(end + 0.42, 0.4, knock(rng, 500, 4000, 0.05))
        since = np.maximum(take.line.times - now, 0.0)
        speed = np.where(take.line.times >= now, high * (1.0 + since / tau) ** -0.7, speed)
        rising = np.where(take.line.times >= puff, 1500.0 + 2200.0 * np.minimum(1.0, since / fill), rising)
        now = end + rng.uniform(1.0, 5.0)
    power = take.power("jet", spectrum(VALVE, rng, 0.8), 2.0, 25.0) * moving_peak(speed, 1.2, 9.0) * 0.35
    power += take.power("pan", spectrum(PLUME, rng), 3.5, 18.0)
    power += take.power("puff", spectrum(RIM, rng), 6.0, 30.0)
    power += take.power("charge", spectrum(VALVE, rng), 2.2, 10.0) * moving_peak(rising, 3.0, 8.0)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.05)
    water = (
        0.5 * take.bubbles("pan", 120, (0.8, 6.0), 2.0)
        + 1.8 * take.splashes("pan", 70)
        + 0.6 * take.splashes("charge", 80)
    )
    return take.heard(power, water)


def flushometer_piston(count: int, rng: Generator) -> Array:
    """Piston flush valve with a sensor: a slow piston that chatters on its film of water, over a blow-out pan.

    Unit: 6 to 9.5 s, chatter at 9 to 22 Hz that grows as the piston sinks (a self-excited valve with a long pipe:
    D. S. Weaver, S. Ziada, J. Pressure Vessel Technol. 102 (1980) 146), a solenoid's double click, a low singing
    note of 280 to 650 Hz, strong water hammer.
    """
    take = Take(count, rng)
    length, close = rng.uniform(6.0, 9.5), rng.uniform(1.6, 3.0)
    pitch, sings = rng.uniform(280.0, 650.0), rng.uniform(0.05, 0.25)
    chatter, metres = rng.uniform(9.0, 22.0), rng.uniform(8.0, 20.0)
    now = -rng.uniform(0.0, 12.0) if rng.random() < 0.45 else rng.uniform(0.2, 1.0)
    while now < take.line.seconds:
        own = length * rng.uniform(0.92, 1.08)
        for delay in (0.0, rng.uniform(0.08, 0.2)):
            take.at(now - 0.3 + delay, 0.5, knock(rng, 900, 7000, 0.03, click=1.0))
        _flush_valve(take, now, own, close, sings, pitch)
        moment = now + own - 1.3 * close
        while moment < now + own:
            near = (moment - now - own + 1.3 * close) / (1.3 * close)
            take.at(moment, 1.2 * near * rng.uniform(0.5, 1.0), knock(rng, 70, 1100, 0.09, 6, 0.2))
            moment += np.exp(rng.normal(0.0, 0.12)) / (chatter * (0.8 + 0.4 * near))
        take.at(now + own, rng.uniform(1.5, 2.6), hammer(rng, metres, rng.uniform(0.5, 1.0)))
        now += own + rng.uniform(3.0, 10.0)
    beat = 1.0 + 0.35 * frame_drift(len(take.line.times), rng, 2.0 * chatter, 1.0)
    shape: Spectrum = {63: -14, 125: -8, 250: -3, 500: 0, 1000: -1, 2000: -3, 4000: -6, 8000: -11, 16_000: -24}
    power = 0.5 * take.power("jet", spectrum(shape, rng, 1.0, 2.5, 3), 1.5, 14.0) * np.square(beat)[:, None]
    power += 0.8 * take.power("pan", spectrum(PLUME, rng, 1.0, 2.0, 3), 2.5, 12.0)
    power += 0.2 * take.power("squeeze", spectrum(VALVE, rng), 2.0, 14.0)
    power += take.power("-", spectrum(RESIDUE, rng), 1.0, least=0.095)
    water = 0.7 * take.bubbles("pan", 70, (1.5, 9.0), 2.0) + 1.3 * take.splashes("pan", 30, 0.3)
    return take.heard(power, water, 2.2)


def washout_shelf(count: int, rng: Generator) -> Array:
    """Washout pan with a shelf: the water spreads over it as a thin sheet and falls over its edge into the trap.

    Unit: flush of 5 to 8 s (older cisterns of 9 l), sheet, fall of 10 to 20 cm whose air resonates at 150 to 420 Hz,
    a float valve under water that is a soft rush. No siphon and no draught; it ends in a trickle.
    """
    take = Take(count, rng)
    flush, refill, fall = rng.uniform(5.0, 8.0), rng.uniform(18.0, 40.0), rng.uniform(150.0, 420.0)
    sheet, lever = rng.uniform(0.35, 0.8), rng.uniform(250.0, 600.0)
    now = -rng.uniform(0.0, 20.0) if rng.random() < 0.5 else rng.uniform(0.2, 0.8)
    while now < take.line.seconds:
        length, fill = flush * rng.uniform(0.9, 1.1), refill * rng.uniform(0.9, 1.1)
        take.at(now - 0.15, 0.8, knock(rng, lever, 4800, 0.07))
        take.line.add("sheet", *cistern_flow(now, length, 0.4))
        take.line.add("fall", *cistern_flow(now + 0.3, length, 0.7))
        take.line.add("trickle", (now + length, 0.0), (now + length + 0.6, 1.0), (now + length + 9.0, 0.1))
        take.line.add("fill", *valve_flow(now + 1.0, fill, rng.uniform(0.06, 0.14), rng.uniform(1.0, 5.0)))
        if rng.random() < 0.35:
            drop_seat(take, now - rng.uniform(0.9, 1.6), rng.uniform(0.8, 2.0))
        now += 1.0 + fill + rng.uniform(1.0, 5.0)
    throat = fall * np.exp(frame_drift(len(take.line.times), rng, 4.0, 0.12))
    power = sheet * take.power("sheet", spectrum(RIM, rng, 1.5), 2.0, 8.0)
    power += take.power("fall", spectrum(PLUME, rng, 1.5, 2.5, 3), 4.0, 14.0) * moving_peak(throat, 2.5, 8.0)
    power += take.power("fill", spectrum(QUIET_VALVE, rng, 1.5), 1.8, 7.0)
    power += take.power("-", spectrum(RESIDUE, rng, 1.5), 1.0, least=rng.uniform(0.04, 0.08))
    water = 0.7 * take.bubbles("fall", 140, (1.0, 7.0), 1.0) + 0.5 * take.bubbles("trickle", 40, (0.8, 5.0))
    water += 1.8 * take.splashes("fall", 60, 0.3) + 0.7 * take.splashes("trickle", 25)
    return take.heard(power, water, 1.6)


def silent_refill(count: int, rng: Generator) -> Array:
    """Deep-trap pan and a fill valve with a submerged outlet: a short loud flush, then nearly nothing until the next.

    Recordings of flushes are 17 to 19 dB quieter in their quiet moments than in the mean, cisterns that run 4: this one
    leaves out the running. Unit: flush of 2.4 to 4.5 s, trap of 90 to 260 Hz with 2 to 6 gulps (`water.gulps`),
    valve (group I of ISO 3822: 10 dB below group II), room.
    """
    take = Take(count, rng)
    flush, refill, trap = rng.uniform(2.4, 4.5), rng.uniform(12.0, 25.0), rng.uniform(90.0, 260.0)
    bright, room = rng.uniform(0.1, 0.7), rng.uniform(0.055, 0.08)
    now = -rng.uniform(0.0, 6.0) if rng.random() < 0.5 else rng.uniform(0.2, 2.0)
    while now < take.line.seconds:
        length = flush * rng.uniform(0.9, 1.1)
        take.at(now - 0.1, rng.uniform(0.8, 1.6), knock(rng, 350, 5000, 0.05, click=0.7))
        take.line.add("flush", *cistern_flow(now, length, 0.15))
        take.line.add("draught", (now + length - 1.2, 0.0), (now + length - 0.4, 0.9), (now + length + 0.3, 0.0))
        number = int(rng.integers(2, 7))
        take.at(now + length - 0.3, rng.uniform(1.0, 2.4), gulps(rng, number, trap, rng.uniform(4.0, 8.0), 0.6))
        take.line.add("rest", (now + length, 0.0), (now + length + 0.5, 1.0), (now + length + 4.0, 0.0))
        take.line.add("fill", *valve_flow(now + 0.8, refill, rng.uniform(0.015, 0.045), 0.5))
        now += length + rng.uniform(5.0, 14.0)
        if rng.random() < 0.4:
            drop_seat(take, now - rng.uniform(1.2, 2.4), rng.uniform(1.0, 2.5))
    power = take.power("flush", spectrum(PLUME, rng, 1.5, 2.5, 3), 3.0, 12.0)
    power += bright * take.power("flush", spectrum(RIM, rng, 1.5), 2.5, 12.0)
    power += take.power("draught", spectrum(SUCTION, rng), 4.0, 16.0)
    power += take.power("fill", spectrum(QUIET_VALVE, rng, 1.5), 1.5, 6.0)
    power += take.power("-", spectrum(RESIDUE, rng, 1.5), 1.0, least=room)
    water = 0.6 * take.bubbles("flush", 130, (0.8, 6.0), 1.0) + 0.6 * take.bubbles("rest", 35, (0.8, 5.0))
    water += 2.0 * take.splashes("flush", 60, 0.3) + 0.6 * take.splashes("rest", 20)
    return take.heard(power, water, 1.6)


_GRAVITY = "gravity cistern, wash-down pan"
_MAINS = "flush valve on the mains"


_voice = partial(Voice.of, "toilet")

VOICES: tuple[Voice, ...] = (
    _voice(washdown_close_coupled, "train", _GRAVITY, "EN 997, EN 14124; bubbles: van den Doel 2005"),
    _voice(siphonic_gulp, "train", "siphon", "ASME A112.19.2; Clanet & Searby 2004 (gulps)"),
    _voice(flushometer_diaphragm, "train", _MAINS, "ASSE 1037; IEC 60534-8-4; Joukowsky 1898"),
    _voice(vacuum_marine, "train", "vacuum", "Rose et al., NOISE-CON 2018, 4726–4735"),
    _voice(rimless_dual_flush, "train", _GRAVITY, "EN 997, EN 14124, ISO 3822-4"),
    _voice(running_ballcock, "train", "leaking fill valve", "van den Doel 2005; EN 14124"),
    _voice(
        high_level_cistern, "validation", "high-level siphon with down pipe", "Clanet & Searby 2004; pipe modes c/2L"
    ),
    _voice(concealed_wall, "test", _GRAVITY, "Cremer 1942 (mass law, coincidence); EN 14366"),
    _voice(pressure_assisted, "test", "compressed-air vessel", "ASSE 1037; Lighthill 1952"),
    _voice(flushometer_piston, "test", _MAINS, "ASSE 1037; IEC 60534-8-4; Weaver & Ziada 1980"),
    _voice(washout_shelf, "train", "gravity cistern, washout shelf", "EN 997; bubbles: van den Doel 2005"),
    _voice(silent_refill, "train", _GRAVITY, "EN 997, ISO 3822-4; Clanet & Searby 2004 (gulps)"),
    _voice(siphons.lever_siphon, "train", "lever-primed siphon", "Richert & Binder 2011; Clanet & Searby 2004 (gulps)"),
    _voice(siphons.squat_pan, "train", "self-siphoning trap", "French & Eaton 1951; Clanet & Searby 2004 (gulps)"),
)
