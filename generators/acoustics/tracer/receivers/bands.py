"""Eight octave filters whose magnitudes add up to 1.

The filters are zero-phase: real weights over frequency, raised cosines over its logarithm. That keeps the bank exact
(equal pressures in all octaves give back the bare impulse), linear in the pressures, and free of the dispersion of a
causal bank whose sum is an all-pass. Its price is ringing before an arrival whose octaves differ. Because the flanks
are one octave wide, the ringing at a frequency f lasts about one period, 1/f, which is shorter than the response of
the ear's own filter there, and backward masking hides it (see docs/acoustics.md for the measured envelope).

A causal alternative with exact sum is the minimum-phase low-pass and its complement; the complement falls by only 6 dB
per octave, so that the slowly decaying low octaves of a room would leak into the high ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.acoustics.tracer.arrivals import BANDS

#: Start of the roll-off to 0 at the Nyquist frequency, as a fraction of it (18.7 kHz at 44.1 kHz). A response that ends
#: abruptly there rings for milliseconds at an audible level; with the roll-off the ringing stays within 20 samples.
ROLL_OFF = 0.85


def band_weights(frequencies: ArrayLike) -> NDArray[np.float64]:
    """(8, K) weight of each octave of `BANDS` at ``frequencies`` (K,) in Hz; the weights of a frequency add up to 1.

    The lowest octave reaches down to 0 Hz, the highest up without limit. At its centre an octave has weight 1 and its
    neighbours have 0; at the edges between two octaves both have 1/2.
    """
    octave = np.log2(np.maximum(np.asarray(frequencies, dtype=np.float64), 1.0) / BANDS[0])
    # The nominal centres of BANDS (63, not 62.5) are not exact octaves: places are interpolated between them.
    centres = np.log2(np.array(BANDS) / BANDS[0])
    place = np.interp(octave, centres, np.arange(len(BANDS)))
    distance = np.abs(place[None, :] - np.arange(len(BANDS))[:, None])
    return np.where(distance < 1.0, 0.5 + 0.5 * np.cos(np.pi * distance), 0.0)


def upper_edges(sample_rate: int) -> NDArray[np.float64]:
    """(8,) Hz: the frequency above which each octave's weight is 0; the Nyquist frequency at most.

    An octave whose weight is 0 everywhere below the Nyquist frequency has edge 0.
    """
    nyquist = sample_rate / 2
    edges = np.minimum(np.append(np.array(BANDS[1:], dtype=np.float64), nyquist), nyquist)
    starts = np.append(0.0, np.array(BANDS[:-1], dtype=np.float64))
    # The highest octave that reaches below the Nyquist frequency extends up to it.
    return np.where(starts < nyquist, edges, 0.0)


def roll_off(frequencies: ArrayLike, sample_rate: int) -> NDArray[np.float64]:
    """(K,) gain that falls from 1 at `ROLL_OFF` times the Nyquist frequency to 0 at it, as a raised cosine."""
    place = np.asarray(frequencies, dtype=np.float64) / (sample_rate / 2)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip((place - ROLL_OFF) / (1 - ROLL_OFF), 0.0, 1.0)))
