"""Background sound without a source: stationary noise of a diffuse field, as two ears hear it.

In a diffuse field the coherence of two points at a distance d is sin(kd)/(kd), k = 2πf/c (Cook et al., "Measurement of
correlation coefficients in reverberant sound fields", JASA 27 (1955) 1072–1077). It is real and does not depend on the
direction in which the head looks, so that the noise goes on evenly while the listener walks and turns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS

Kind = Literal["room_tone", "noise"]

#: Distance of the ears (m): the diameter of the spherical head.
EAR_DISTANCE = 2 * HEAD_RADIUS
#: Below this frequency (Hz) the spectrum is flat: loudspeakers and ears hardly reproduce what is lower.
_LOWEST = 50.0
#: Above this frequency (Hz) room tone (ventilation, traffic through walls) falls faster than pink noise.
_ROOM_TONE_CORNER = 250.0
#: Length of the blocks of `diffuse_seconds` (samples): frequencies 10.8 Hz apart.
_BLOCK = 4096

#: Frequencies (n,) in Hz → covariance (n, channels, channels) of a receiver's channels in a diffuse field.
Covariance = Callable[[NDArray[np.floating]], NDArray[np.float64]]


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


def diffuse_seconds(
    kind: Kind, covariance: Covariance, seconds: int, rng: Generator, sample_rate: int = SAMPLE_RATE
) -> Iterator[NDArray[np.float32]]:
    """Noise of a diffuse field as a receiver hears it, second by second; the sound pressure has an RMS of 1.

    Blocks of noise with the wanted covariance at every frequency overlap by half under a window whose squares add up
    to 1 (after Habets and Gannot, "Generating sensor signals in isotropic noise fields", JASA 122 (2007) 3464-3470).

    Args:
        kind: spectrum of the sound pressure; see `amplitude`.
        covariance: of the receiver's channels.
        seconds: how many there are.
        rng: the only source of randomness.
        sample_rate: Hz.

    Yields:
        (channels, sample_rate) float32.
    """
    half = _BLOCK // 2
    frequency = rfftfreq(_BLOCK, 1 / sample_rate)
    shape = amplitude(kind, frequency)
    shape[0] = shape[-1] = 0.0  # a real signal has no free phase there
    # Noise with the independent parts N(0, 1) of its spectrum has this mean square after the inverse transform.
    shape *= _BLOCK / np.sqrt(4.0 * np.sum(shape**2))
    roots = square_roots(covariance(frequency)) * shape[:, None, None]
    window = np.sin(np.pi * (np.arange(_BLOCK) + 0.5) / _BLOCK)
    channels = roots.shape[1]

    def block() -> NDArray[np.float64]:
        white = rng.standard_normal((2, len(frequency), channels, 1))
        spectrum = (roots @ (white[0] + 1j * white[1]))[..., 0]
        return np.asarray(irfft(spectrum, _BLOCK, axis=0).T * window)

    before = block()[:, half:]
    ready = np.zeros((channels, 0))
    for _ in range(seconds):
        pieces = [ready]
        while sum(piece.shape[1] for piece in pieces) < sample_rate:
            now = block()
            pieces.append(before + now[:, :half])
            before = now[:, half:]
        joined = np.concatenate(pieces, axis=1)
        yield joined[:, :sample_rate].astype(np.float32)
        ready = joined[:, sample_rate:]


def square_roots(covariance: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, c, c) symmetric square roots of covariance matrices (n, c, c), which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    scaled = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return np.asarray(scaled @ np.swapaxes(vectors, 1, 2))
