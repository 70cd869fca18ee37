"""Reverberation time and clarity from impulse responses, and Eyring's formula to compare with.

T30 after ISO 3382-2: the octave-filtered response is squared and integrated backwards (Schroeder 1965); a straight line
through the decay from −5 to −35 dB, extrapolated to 60 dB.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

#: Speed of sound at 20 °C (m/s).
SPEED_OF_SOUND = 343.0
#: Octaves whose mean is quoted as "the" reverberation time (ISO 3382-2: 500 Hz and 1 kHz).
MID_BANDS = (500.0, 1000.0)
_FIT_FROM, _FIT_TO = -5.0, -35.0
#: Early sound of the clarity C50 (s, ISO 3382-1).
EARLY = 0.05
#: The direct sound begins where a response comes within so many dB of its largest value (ISO 3382-1, 5.3.4).
_ONSET = -20.0
#: Window in which the level of a clap is measured (s), and the percentile of the levels that is its noise.
_CLAP_WINDOW, _CLAP_NOISE = 0.01, 20.0
#: Distance of the end of the fit from the noise (dB): 10 to the cut, which bends the decay over 7 more.
_CLAP_MARGIN = 17.0


def octave_filtered(response: NDArray[np.floating], sample_rate: int, centre: float) -> NDArray[np.float64]:
    """The response (..., n) in the octave about ``centre`` Hz; forward and backward, so that no decay is added."""
    low, high = centre / math.sqrt(2), min(centre * math.sqrt(2), 0.49 * sample_rate)
    from scipy.signal import butter, sosfiltfilt

    sections = butter(3, [low, high], btype="bandpass", fs=sample_rate, output="sos")
    # Room for the filter's own ringing at both ends.
    pad = int(4 * sample_rate / low)
    widths = [(0, 0)] * (np.ndim(response) - 1) + [(pad, pad)]
    return np.asarray(sosfiltfilt(sections, np.pad(np.asarray(response, dtype=np.float64), widths), axis=-1))


def decay_curve(response: NDArray[np.floating]) -> NDArray[np.float64]:
    """Schroeder's backward integration of a response (n,): dB below its whole energy, −inf after its end."""
    remaining = remaining_energy(response)
    if len(remaining) == 0 or not remaining[0] > 0:
        return np.full(len(remaining), -np.inf)
    return _decibels(remaining)


def remaining_energy(response: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n,) energy of a response (n,) from each sample on."""
    return np.asarray(np.cumsum(np.square(np.asarray(response, dtype=np.float64))[::-1])[::-1])


def energy_ratio_db(early: NDArray[np.floating], late: NDArray[np.floating]) -> float:
    """Energy of one sound over that of another, dB; of any shape. −inf, inf or NaN where one or both are silent."""
    first, second = (float(np.square(np.asarray(sound, dtype=np.float64)).sum()) for sound in (early, late))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(10 * np.log10(np.divide(first, second)))


def onset(response: NDArray[np.floating]) -> int:
    """The sample of a response (n,) at which the direct sound begins; 0 for silence."""
    size = np.abs(response)
    return int(np.argmax(size >= size.max(initial=0.0) * 10 ** (_ONSET / 20))) if size.size else 0


def decay_figures(response: NDArray[np.floating], rate: float, first: int | None = None) -> dict[str, float | None]:
    """Figures of one response (n,) over all frequencies, as papers on acoustic fields report them.

    Args:
        response: finite.
        rate: samples per second.
        first: the sample at which EDT and C50 begin; None: where the direct sound does.

    Returns:
        ``T60`` (s, from −5 to −25 dB, which ISO 3382-1 calls T20), ``T30`` (s, to −35 dB), ``EDT`` (s), ``C50`` (dB);
        None where one cannot be measured.
    """
    start = onset(response) if first is None else first
    remaining = remaining_energy(response)
    boundary = start + math.ceil(EARLY * rate)
    clarity = energy_ratio_db(response[start:boundary], response[boundary:])
    return {
        "T60": fit_decay(remaining, rate, last=-25.0),
        "T30": fit_decay(remaining, rate),
        "EDT": fit_decay(remaining[start:], rate, 0.0, -10.0),
        "C50": clarity if math.isfinite(clarity) else None,
    }


def t30(response: NDArray[np.floating], sample_rate: int) -> float | None:
    """Reverberation time in s of one (filtered) response (n,).

    Returns:
        None if it cannot be measured: silence, numbers that are not finite, or a response that does not fall by 35 dB
        over at least 20 samples.
    """
    if not np.isfinite(response).all():
        return None
    return _fit(decay_curve(response), sample_rate)


def fit_decay(
    remaining: NDArray[np.floating], rate: float, first: float = _FIT_FROM, last: float = _FIT_TO
) -> float | None:
    """T30 in s of the energy that remains (n,), any unit, at ``rate`` values per second; None as in `t30`.

    From ``first`` = 0 to ``last`` = −10 dB it is the early decay time, EDT (ISO 3382-1).
    """
    if len(remaining) == 0 or not remaining[0] > 0:
        return None
    return _fit(_decibels(remaining), rate, last, first)


def _decibels(remaining: NDArray[np.floating]) -> NDArray[np.float64]:
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(np.maximum(remaining / remaining[0], 0.0)))


def _fit(
    curve: NDArray[np.float64], sample_rate: float, last: float = _FIT_TO, first: float = _FIT_FROM
) -> float | None:
    """The time of 60 dB at the slope of ``curve`` (n,), dB, between ``first`` and ``last`` dB."""
    inside = np.flatnonzero((curve <= first) & (curve >= last))
    if len(inside) < 20 or not np.any(curve < last):
        return None
    slope = float(np.polyfit(inside / sample_rate, curve[inside], 1)[0])
    return -60.0 / slope if slope < 0 else None


def reverberation_time(
    responses: Iterable[NDArray[np.floating]], sample_rate: int, bands: tuple[float, ...] = MID_BANDS
) -> float | None:
    """Mean T30 in s over responses (channels, n), their channels and ``bands``; None if none can be measured.

    A few poses spread over the room are enough: T30 hardly depends on the place.
    """
    times = [
        time
        for response in responses
        for band in bands
        if np.isfinite(response).all()
        for channel in octave_filtered(np.atleast_2d(response), sample_rate, band)
        if (time := t30(channel, sample_rate)) is not None
    ]
    return float(np.mean(times)) if times else None


def clap_time(recording: NDArray[np.floating], sample_rate: int) -> float | None:
    """Reverberation time in s, mean of `MID_BANDS`, of a recorded hand clap; the loudest one counts.

    The recording is cut where the decay comes within 10 dB of the noise, and the line is fitted from −5 to −35 dB, or
    to −25 or −15 dB where the noise leaves no more.

    Args:
        recording: (n,) or (channels, n), with at least half a second of silence somewhere.
        sample_rate: Hz.

    Returns:
        None if the clap is less than 32 dB above the noise in one of the octaves.
    """
    sound = np.atleast_2d(np.asarray(recording, dtype=np.float64)).mean(axis=0)
    window = max(1, round(_CLAP_WINDOW * sample_rate))
    found = []
    for band in MID_BANDS:
        power = np.square(octave_filtered(sound, sample_rate, band))
        level = np.convolve(power, np.ones(window) / window, mode="same")
        start = int(np.argmax(level))
        noise = float(np.percentile(level, _CLAP_NOISE))
        quiet = np.flatnonzero(level[start:] <= 10 * noise)
        end = start + int(quiet[0]) if len(quiet) else len(power)
        curve = decay_curve(np.sqrt(power[start:end]))
        room = 10 * math.log10(max(float(level[start]) / max(noise, 1e-30), 1.0)) - _CLAP_MARGIN
        last = next((fall for fall in (_FIT_TO, -25.0, -15.0) if room >= -fall), None)
        time = None if last is None else _fit(curve, sample_rate, last)
        if time is None:
            return None
        found.append(time)
    return float(np.mean(found))


def eyring(volume: float, surface: float, absorption: float) -> float:
    """Eyring's reverberation time in s: 24·ln 10·V / (−c·S·ln(1 − ᾱ)), without absorption in the air.

    Args:
        volume: m³.
        surface: m².
        absorption: area-weighted mean absorption coefficient, in (0, 1).
    """
    return 24 * math.log(10) * volume / (-SPEED_OF_SOUND * surface * math.log1p(-absorption))
