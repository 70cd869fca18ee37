"""The family of parametric heads: what is drawn for one, and which heads are for training and which for testing.

Radius: the least squares fits of spheres to the interaural delays of 25 listeners span 7.9 to 9.5 cm (V. R. Algazi,
C. Avendano, R. O. Duda, "Estimation of a spherical-head model from anthropometry", JAES 49 (2001) 472–479); ears lie
behind and below the diameter there, too. Pinna: the notches of 1 to 3 reflections, which rise with elevation
(V. C. Raykar, R. Duraiswami, B. Yegnanarayana, "Extracting the frequencies of the pinna spectral notches in measured
head related impulse responses", JASA 118 (2005) 364–374; S. Spagnol, M. Geronazzo, F. Avanzini, "On the relation
between pinna reflection patterns and head-related transfer function features", IEEE Trans. Audio, Speech, Lang. Proc.
21 (2013) 508–519), and the resonances of the concha (P. Satarzadeh, V. R. Algazi, R. O. Duda, "Physical and filter
pinna models based on anthropometry", AES convention paper 7098, 2007). There is no torso.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from avs3d_bench.contract.schema import HeadRecord, ResonanceRecord

Split = Literal["train", "test"]

#: Words of `--hrtf` and of a manifest's ``hrtf`` for a family → its heads.
FAMILIES: dict[str, Split] = {"family": "train", "family-test": "test"}
#: Range of the radius (m), and of the frequency of the first notch straight ahead (Hz): both are cut into this many
#: bands; training has the even ones and testing the odd ones, so that no head of one is among those of the other.
RADIUS, FIRST_NOTCH, BANDS = (0.075, 0.098), (6300.0, 8900.0), 10
#: Ranges of the place of the ears: azimuth from straight ahead and elevation (degrees).
EAR_AZIMUTH, EAR_ELEVATION = (95.0, 115.0), (-20.0, -5.0)
#: The second and third notch, in frequencies of the first.
_HIGHER = ((1.35, 1.55), (1.70, 1.95))
#: Depth straight ahead (dB), width as a share of the frequency, rise from straight ahead to overhead.
_DEPTH, _WIDTH, _RISE = (12.0, 28.0), (0.08, 0.16), (0.15, 0.40)
#: Resonances: range of frequency (Hz), of gain (dB) and of width as a share of the frequency.
_RESONANCES = (((3800.0, 4900.0), (7.0, 11.0), (0.7, 1.1)), ((10_500.0, 14_000.0), (2.0, 6.0), (0.25, 0.45)))
#: Shift of the notches' frequencies from ahead to behind, and loss behind above about 4 kHz (dB).
_BACK_SHIFT, _BACK_LOSS = (-0.12, 0.12), (4.0, 10.0)


def draw_head(split: Split, rng: np.random.Generator) -> HeadRecord:
    """Draw one head of the family.

    Args:
        split: ``train`` or ``test``: no radius and no first notch of one is within the bands of the other.
        rng: of the observation and everything that shares its head.
    """

    def between(limits: tuple[float, float], digits: int) -> float:
        return round(float(rng.uniform(*limits)), digits)

    def in_bands(limits: tuple[float, float], digits: int) -> float:
        step = (limits[1] - limits[0]) / BANDS
        band = 2 * int(rng.integers(BANDS // 2)) + (split == "test")
        # A little inside of its band, so that rounding does not leave it.
        return round(limits[0] + step * (band + float(rng.uniform(0.05, 0.95))), digits)

    radius, first = in_bands(RADIUS, 5), in_bands(FIRST_NOTCH, 0)
    middles = (first, *(round(first * float(rng.uniform(*ratio))) for ratio in _HIGHER))
    notches = tuple(
        ResonanceRecord(frequency=middle, gain_db=-between(_DEPTH, 1), width=between(_WIDTH, 3), rise=between(_RISE, 3))
        for middle in middles
    )
    peaks = tuple(
        ResonanceRecord(frequency=between(middle, 0), gain_db=between(gain, 1), width=between(width, 3), rise=0.0)
        for middle, gain, width in _RESONANCES
    )
    return HeadRecord(
        family=split,
        radius=radius,
        ear_azimuth=between(EAR_AZIMUTH, 1),
        ear_elevation=between(EAR_ELEVATION, 1),
        notches=notches,
        peaks=peaks,
        back_shift=between(_BACK_SHIFT, 3),
        back_loss_db=between(_BACK_LOSS, 1),
    )


def is_of(head: HeadRecord, split: Split) -> bool:
    """Whether the radius and the first notch of a head are those of a split."""

    def band(value: float, limits: tuple[float, float]) -> int:
        return int((value - limits[0]) / (limits[1] - limits[0]) * BANDS)

    odd = split == "test"
    return band(head.radius, RADIUS) % 2 == odd and band(head.notches[0].frequency, FIRST_NOTCH) % 2 == odd
