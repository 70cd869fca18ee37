"""A spherical head: interaural delay after Woodworth, head shadow after Brown and Duda.

The ears sit at the ends of a diameter: the right ear along the head's +X axis, the left along −X. For each ear only the
angle of incidence matters, between the ear's axis and the direction of the sound (0 = straight into the ear).

References:
    R. S. Woodworth, *Experimental Psychology*, Holt 1938, pp. 520–523: ITD = (a/c)·(φ + sin φ) at azimuth φ.
    C. P. Brown, R. O. Duda, "A structural model for binaural sound synthesis", IEEE Trans. Speech and Audio
    Processing 6 (1998) 476–488: eqs. (2)–(4) for the one-pole, one-zero head shadow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from generators.acoustics.geometry import SPEED_OF_SOUND

Array = NDArray[np.float64]

HEAD_RADIUS = 0.0875  # m
#: Smallest zero coefficient and the angle (radians) at which it is reached: the far side has a bright spot at 180°.
_ALPHA_MIN, _THETA_MIN = 0.1, np.radians(150.0)
#: Corner of the head shadow, β = 2c/a in rad/s.
_BETA = 2 * SPEED_OF_SOUND / HEAD_RADIUS
#: x component of the ears' axes in the head's frame: left, right.
EAR_AXES = (-1.0, 1.0)


def incidence(directions: ArrayLike, ear: int) -> Array:
    """(N,) angle of incidence (radians) at ear 0 (left) or 1 (right); directions (N, 3): unit, in its frame."""
    return np.arccos(np.clip(EAR_AXES[ear] * np.asarray(directions, dtype=np.float64)[..., 0], -1.0, 1.0))


def ear_delay(theta: ArrayLike, radius: float = HEAD_RADIUS) -> Array:
    """Arrival at an ear in s, relative to the head's centre if there were no head; negative on the near side.

    −(a/c)·cos θ on the side that sees the source; beyond 90° the wave creeps round: (a/c)·(θ − π/2).
    The difference between both ears is Woodworth's (a/c)·(φ + sin φ).
    """
    angle = np.asarray(theta, dtype=np.float64)
    near = -np.cos(angle)
    return radius / SPEED_OF_SOUND * np.where(angle < np.pi / 2, near, angle - np.pi / 2)


def woodworth_itd(azimuth: ArrayLike) -> Array:
    """ITD in s for azimuths in radians (0 ahead, positive right, |φ| ≤ π/2); positive when the left ear lags."""
    phi = np.asarray(azimuth, dtype=np.float64)
    return HEAD_RADIUS / SPEED_OF_SOUND * (phi + np.sin(phi))


def shadow_coefficient(theta: ArrayLike) -> Array:
    """α(θ) of Brown and Duda, their eq. (4): 2 (+6 dB at high frequencies) at 0, 0.1 (−20 dB) at 150°."""
    angle = np.asarray(theta, dtype=np.float64)
    return np.asarray((1 + _ALPHA_MIN / 2) + (1 - _ALPHA_MIN / 2) * np.cos(angle / _THETA_MIN * np.pi))


def diffuse_shadow_coefficient() -> float:
    """Root mean square of α(θ) over all directions: the head shadow in a diffuse field."""
    # θ is distributed as sin θ over the sphere.
    theta = (np.arange(2000) + 0.5) / 2000 * np.pi
    weight = np.sin(theta)
    return float(np.sqrt(np.sum(weight * shadow_coefficient(theta) ** 2) / np.sum(weight)))


def shadow_bases(frequencies: ArrayLike, sample_rate: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """The two filters of which every head shadow is made.

    H(s, θ) = (α(θ)·s + β)/(s + β) is linear in α: H = β/(s + β) + α(θ)·s/(s + β). So any number of arrivals needs two
    filters only: sum the arrivals once plainly and once weighted with α.

    Args:
        frequencies: (K,) Hz, up to half the sample rate.
        sample_rate: Hz, of the bilinear transform.

    Returns:
        low-pass and high-pass response, (K,) complex each; they add up to 1.
    """
    half_angle = np.pi * np.asarray(frequencies, dtype=np.float64) / sample_rate
    # s = 2·fs·j·tan(ω/2), written with sine and cosine so that the Nyquist frequency is finite.
    s = 2j * sample_rate * np.sin(half_angle)
    one = np.cos(half_angle)
    denominator = s + _BETA * one
    return _BETA * one / denominator, s / denominator
