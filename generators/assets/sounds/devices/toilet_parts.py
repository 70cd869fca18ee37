"""Spectra of what is heard in toilets, curves of flows from cisterns and valves, and a seat that falls."""

from __future__ import annotations

import numpy as np

from generators.assets.sounds.signals import Array
from generators.assets.sounds.water import Spectrum, Take, knock

#: Water that falls into a pan: a plume of bubbles, broad, with a slope of −4 to −6 dB per octave above 4 kHz.
PLUME: Spectrum = {63: -24, 125: -14, 250: -5, 500: -3, 1000: -3, 2000: -4, 4000: -6, 8000: -10, 16_000: -22}
#: Thin sheets and jets under the rim.
RIM: Spectrum = {63: -40, 250: -20, 500: -11, 1000: -5, 2000: -1, 4000: 0, 8000: -4, 16_000: -17}
#: A trap that draws air.
SUCTION: Spectrum = {63: -17, 125: -5, 250: 0, 500: -3, 1000: -8, 2000: -12, 4000: -16, 8000: -22, 16_000: -36}
#: A throttling valve at mains pressure: cavitation (IEC 60534-8-4), radiated by the pipe and the cistern.
VALVE: Spectrum = {63: -34, 125: -26, 250: -17, 500: -10, 1000: -6, 2000: -2, 4000: 0, 8000: -4, 16_000: -16}
#: A valve behind a diaphragm and a filter: slow flow, little cavitation.
QUIET_VALVE: Spectrum = {63: -30, 125: -18, 250: -8, 500: -1, 1000: 0, 2000: -4, 4000: -8, 8000: -14, 16_000: -28}
#: The room and the pipes when nothing runs.
RESIDUE: Spectrum = {63: -11, 125: -6, 250: -3, 500: -2, 1000: -2, 2000: -4, 4000: -7, 8000: -12, 16_000: -24}


def cistern_flow(start: float, length: float, rise: float = 0.25) -> list[tuple[float, float]]:
    """Flow out of a cistern: it falls linearly as the head is spent (Torricelli), noise with its power 1.5."""
    shares = np.array([0.0, 0.25, 0.5, 0.75, 0.92, 1.0])
    levels = np.maximum(1.0 - 0.8 * shares, 0.0) ** 1.5
    corners = [(start, 0.0), (start + 0.35 * rise, 0.55)]
    corners += [(start + rise + s * (length - rise), float(v)) for s, v in zip(shares, levels, strict=True)]
    return [*corners, (start + length + 0.5, 0.02), (start + length + 2.5, 0.0)]


def valve_flow(start: float, length: float, level: float, closing: float) -> list[tuple[float, float]]:
    """A fill valve that opens with the falling float and closes over the last ``closing`` seconds."""
    end = start + length
    return [
        (start, 0.0),
        (start + 0.5, level),
        (end - closing, 0.92 * level),
        (end - 0.4 * closing, 0.6 * level),
        (end - 0.08 * closing, 0.3 * level),
        (end, 0.0),
    ]


def drop_seat(take: Take, moment: float, level: float) -> None:
    """A seat or lid that falls and bounces once."""
    rng = take.rng
    take.at(moment, level, knock(rng, 110, 1500, rng.uniform(0.1, 0.25), 9))
    take.at(moment + rng.uniform(0.07, 0.16), 0.35 * level, knock(rng, 130, 1800, 0.12, 8))


def filling_resonance(take: Take, low: float, high: float, spans: list[tuple[float, float]]) -> Array:
    """(frames,) resonance (Hz) of the air in a vessel that fills (P. A. Cabe, J. B. Pittenger 2000)."""
    corners = [(m, v) for begin, end in spans for m, v in ((begin, low), (end, high), (end + 0.5, low))]
    moments, values = np.array(corners or [(0.0, low)]).T
    return np.asarray(np.interp(take.line.times, moments, values))
