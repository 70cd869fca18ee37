"""Telephones with mechanical bells."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.signal import fftconvolve

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.assets.sounds.bells import (
    FRANCE,
    GERMANY,
    NORTH_AMERICA,
    UNITED_KINGDOM,
    Mode,
    Ringer,
    Rings,
    cadence,
    case_modes,
    click,
    gong,
    handset,
    loudspeaker,
    resonator,
    ring,
    stroke,
)
from generators.assets.sounds.room_tone import over_room_tone
from generators.assets.sounds.signals import Array, add_at, strike, unit


def _strokes(
    rng: Generator, modes: list[Mode], contact: float, seconds: float, clank: tuple[float, float], number: int = 6
) -> tuple[Array, ...]:
    """Sounds of a gong's strokes: its modes, the clapper's clank (of that level), a thud of the housing (of that)."""
    kinds = []
    housing = case_modes(rng, 220.0, 1600.0)
    for _ in range(number):
        sound = stroke(modes, contact * np.exp(rng.normal(0.0, 0.12)), seconds, rng)
        level = float(np.sqrt(np.sum(np.square(sound[: SAMPLE_RATE // 20]))))
        add_at(sound, 0, clank[0] * level * click(rng, rng.uniform(0.006, 0.018), 2200.0, 9000.0))
        thud = strike([(f * rng.uniform(0.97, 1.03), fall, a) for f, fall, a in housing], 0.1, rng, attack=8e-4)
        add_at(sound, 0, clank[1] * level * thud / np.sqrt(np.sum(np.square(thud))))
        kinds.append(sound)
    return tuple(kinds)


def _answered(out: Array, rings: Rings, rng: Generator, level: float) -> Array:
    """Add the handset's knocks where a call ends (somebody answers, or the ringing just stops)."""
    peak = float(np.percentile(np.abs(out), 99.5)) if len(out) else 0.0
    for moment in rings.ends:
        if rng.random() < 0.5:
            add_at(out, round(moment * SAMPLE_RATE), level * peak * handset(rng))
            add_at(out, round((moment + rng.uniform(0.7, 2.0)) * SAMPLE_RATE), 0.8 * level * peak * handset(rng))
    return out


def uk_desk_bell(count: int, rng: Generator) -> Array:
    """A desk set of the British kind: two small bright gongs, 25 Hz, two short rings and a pause.

    Unit: gongs (two nodal diameters at 1.0–1.35 kHz, the second a minor third to a fourth higher), their roundness,
    the clapper's contact and bias, the housing. Take: cadence, strength and times of the blows, handset knocks.
    Model: shells' ring modes (`bells.gong`), each gong struck once per period of the ringing current.
    """
    low = rng.uniform(1000.0, 1350.0)
    contact = rng.uniform(3e-5, 7e-5)
    pair = []
    for lowest in (low, low * rng.uniform(1.15, 1.36)):
        # Brass that is held in its centre loses little: the gongs ring on through the pauses.
        modes = gong(rng, lowest, rng.uniform(3.4, 6.0), rng.uniform(0.78, 0.92))
        pair.append(_strokes(rng, modes, contact, 3.4, (rng.uniform(0.3, 0.7), rng.uniform(0.03, 0.15))))
    ringer = Ringer(
        gongs=tuple(pair),
        current=rng.uniform(24.0, 26.5),
        bias=rng.uniform(-0.18, 0.18),
        unsteady=rng.uniform(6e-4, 1.3e-3),
        missed=rng.uniform(0.0, 0.03),
    )
    rings = cadence(count, rng, UNITED_KINGDOM)
    out = ring(count, rng, ringer, rings)
    return over_room_tone(_answered(out, rings, rng, 0.25), rng)


def us_desk_bell(count: int, rng: Generator) -> Array:
    """A desk set of the American kind: larger gongs over a resonator, 20 Hz, two seconds of ringing, four of pause.

    Unit: gongs at 680–930 Hz, thicker and longer ringing; a cavity under each gong that lifts the lowest mode
    (E. R. Morton, Resonator for telephone bells, US patent 2 216 956, 1940); volume wheel: one gong may be damped.
    Take: as `uk_desk_bell`; the ring starts slowly when the volume is low.
    """
    low = rng.uniform(680.0, 930.0)
    contact = rng.uniform(5e-5, 1e-4)
    pair, cavities = [], []
    for lowest in (low, low * rng.uniform(1.19, 1.28)):
        modes = gong(rng, lowest, rng.uniform(2.2, 5.0), rng.uniform(0.86, 0.98))
        pair.append(_strokes(rng, modes, contact, 2.8, (rng.uniform(0.15, 0.4), rng.uniform(0.1, 0.35)), 4))
        cavities.append((lowest * rng.uniform(0.95, 1.08), rng.uniform(6.0, 14.0), rng.uniform(0.8, 2.2)))
    if rng.random() < 0.35:
        muffled = rng.uniform(0.25, 0.6)
        pair[1] = tuple(muffled * sound for sound in pair[1])
    ringer = Ringer(
        gongs=tuple(pair),
        current=rng.uniform(19.3, 20.7),
        bias=rng.uniform(-0.3, 0.3),
        unsteady=rng.uniform(8e-4, 1.8e-3),
        missed=rng.uniform(0.0, 0.06),
    )
    rings = cadence(count, rng, NORTH_AMERICA, (3, 6))
    out = resonator(ring(count, rng, ringer, rings), cavities, 1.0)
    return over_room_tone(_answered(out, rings, rng, 0.35), rng)


def wall_single_gong(count: int, rng: Generator) -> Array:
    """A wall set with one large gong; the clapper sits inside and hits it on both sides, again before it has calmed.

    Unit: gong at 430–640 Hz with many modes, current of 25 or 50 Hz with a German or French cadence, wear of the
    clapper. Take: the blows meet a vibrating rim, so strengths are log-normal and some blows are missed; the clapper
    stays in touch after the ring and damps the gong, until it lets go.
    Model: shells' ring modes; the decay while the clapper chatters is a third to a half of the free one.
    """
    french = rng.random() < 0.5
    modes = gong(rng, rng.uniform(430.0, 640.0), rng.uniform(1.5, 3.5), rng.uniform(0.82, 0.95))
    choked = [(f, fall * rng.uniform(0.3, 0.55), level) for f, fall, level in modes]
    contact = rng.uniform(5e-5, 1.1e-4)
    clank = (rng.uniform(0.25, 0.7), rng.uniform(0.05, 0.25))
    near, far = (_strokes(rng, choked, contact * wear, 0.9, clank) for wear in (1.0, rng.uniform(1.2, 1.7)))
    ringer = Ringer(
        gongs=(near, tuple(rng.uniform(0.5, 0.9) * sound for sound in far)),
        current=rng.uniform(48.5, 51.0) if french else rng.uniform(23.5, 26.5),
        bias=rng.uniform(-0.35, 0.35),
        unsteady=rng.uniform(5e-4, 1.4e-3),
        missed=rng.uniform(0.06, 0.22),
    )
    rings = cadence(count, rng, FRANCE if french else GERMANY, (3, 8))
    out = ring(count, rng, ringer, rings)
    free = _strokes(rng, modes, contact, 2.6, (0.1, 0.05), 3)
    for _, stop in rings.bursts:
        moment = stop + rng.uniform(0.01, 0.06)
        add_at(out, round(moment * SAMPLE_RATE), rng.uniform(0.4, 0.9) * free[int(rng.integers(0, len(free)))])
    return over_room_tone(out, rng)


def sampled_bell(count: int, rng: Generator) -> Array:
    """A mobile telephone that plays the recording of an old bell: one ring, repeated, through a small loudspeaker.

    The ring is a `Ringer` of two gongs in a room of the recording; the loudspeaker cuts below 500 to 1,000 Hz and above
    6 to 12 kHz and is overdriven. Unit: the recording (gongs, rate, length), loudspeaker, pause. Model: shells' ring
    modes (`bells.gong`), as in `uk_desk_bell`.
    """
    low, contact = rng.uniform(700.0, 1500.0), rng.uniform(4e-5, 1.2e-4)
    pair = []
    for lowest in (low, low * rng.uniform(1.08, 1.3)):
        modes = gong(rng, lowest, rng.uniform(0.6, 2.0), rng.uniform(0.75, 0.95))
        pair.append(_strokes(rng, modes, contact, 1.2, (rng.uniform(0.1, 0.5), rng.uniform(0.02, 0.1))))
    ringer = Ringer(
        gongs=tuple(pair),
        current=rng.uniform(14.0, 27.0),
        bias=rng.uniform(-0.15, 0.15),
        unsteady=rng.uniform(4e-4, 1.2e-3),
        missed=rng.uniform(0.0, 0.02),
    )
    length, pause = rng.uniform(0.8, 2.2), rng.uniform(0.6, 2.2)
    size = int((length + 0.9) * SAMPLE_RATE)
    phrase = ring(size, rng, ringer, Rings(((0.0, length),), ()))
    time = np.arange(SAMPLE_RATE // 3) / SAMPLE_RATE
    tail = rng.standard_normal(len(time)) * np.exp(-6.91 * time / rng.uniform(0.2, 0.6))
    tail *= rng.uniform(0.0, 0.5) / np.sqrt(np.sum(np.square(tail)))
    tail[0] += 1.0
    phrase = unit(fftconvolve(phrase, tail)[:size]) * np.minimum(1.0, np.arange(size)[::-1] / 2000.0)
    out = np.zeros(count)
    now = -rng.uniform(0.0, 0.85) * (length + pause)
    while now * SAMPLE_RATE < count:
        add_at(out, round(now * SAMPLE_RATE), np.exp(rng.normal(0.0, 0.03)) * phrase)
        now += length + pause
    return over_room_tone(loudspeaker(out, rng, (500.0, 1000.0), (0.01, 0.05)), rng)
