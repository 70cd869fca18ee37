"""Background sound without a source: stationary noise of a diffuse field, as two ears hear it.

In a diffuse field the coherence of two points at a distance d is sin(kd)/(kd), k = 2πf/c (Cook et al., "Measurement of
correlation coefficients in reverberant sound fields", JASA 27 (1955) 1072–1077). It is real and does not depend on the
direction in which the head looks, so that the noise goes on evenly while the listener walks and turns.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from avs3d_bench.layout import SAMPLE_RATE
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS

Kind = Literal["room_tone", "noise"]

#: Distance of the ears (m): the diameter of the spherical head.
EAR_DISTANCE = 2 * HEAD_RADIUS
#: Below this frequency (Hz) the spectrum is flat: loudspeakers and ears hardly reproduce what is lower.
_LOWEST = 50.0
#: Above this frequency (Hz) room tone (ventilation, traffic through walls) falls faster than pink noise.
_ROOM_TONE_CORNER = 250.0


def coherence(frequency: NDArray[np.floating], distance: float = EAR_DISTANCE) -> NDArray[np.float64]:
    """Coherence of the sound pressure at two points of a diffuse field: sin(kd)/(kd).

    Args:
        frequency: any shape, Hz.
        distance: metres.
    """
    return np.asarray(np.sinc(2 * np.asarray(frequency, dtype=np.float64) * distance / SPEED_OF_SOUND))


def amplitude(kind: Kind, frequency: NDArray[np.floating]) -> NDArray[np.float64]:
    """Amplitude spectrum without a scale: pink noise (−3 dB per octave); room tone: −9 dB per octave above 250 Hz."""
    above = np.maximum(np.asarray(frequency, dtype=np.float64), _LOWEST)
    pink = np.sqrt(_LOWEST / above)
    return pink if kind == "noise" else pink / np.maximum(above / _ROOM_TONE_CORNER, 1.0)


def diffuse_noise(kind: Kind, seconds: int, rng: Generator, sample_rate: int = SAMPLE_RATE) -> NDArray[np.float32]:
    """Noise at both ears with an RMS of 1 over all its samples.

    Args:
        kind: its spectrum; see `amplitude`.
        seconds: length.
        rng: the only source of randomness.
        sample_rate: Hz.

    Returns:
        (2, seconds · sample_rate) float32; both ears have the same power spectrum and the coherence of `coherence`.
    """
    count = seconds * sample_rate
    length = next_fast_len(count, real=True)
    frequency = rfftfreq(length, 1 / sample_rate)
    shape, shared = amplitude(kind, frequency), coherence(frequency)
    # The sum and the difference of the ears are independent, with the powers (1 ± γ)/2.
    middle = rfft(rng.standard_normal(length)) * shape * np.sqrt((1 + shared) / 2)
    side = rfft(rng.standard_normal(length)) * shape * np.sqrt((1 - shared) / 2)
    ears = np.stack([irfft(middle + side, length)[:count], irfft(middle - side, length)[:count]])
    return np.asarray(ears / np.sqrt(np.mean(np.square(ears))), dtype=np.float32)
