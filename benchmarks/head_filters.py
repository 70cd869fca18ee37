"""Filters by which the viewer turns first-order ambisonics into the sound at two ears: a rigid sphere.

    python -m benchmarks.head_filters        writes avs3d_bench/inspector/templates/filters.js

The pressure at a point e of a rigid sphere is Σ (2l + 1)·b_l(ka)·P_l(cos γ), γ the angle between e and the source. Of
first-order ambisonics there are l = 0 (W) and l = 1, of which an ear at the left needs Y alone: left = c₀ ∗ W + c₁ ∗ Y,
and right = c₀ ∗ W − c₁ ∗ Y. Below `CUT_ON`, c₀ = b₀ and c₁ = 3·b₁ exactly, so that delays between the ears are right.
Above, where more orders would be needed and delays are no cue, the magnitudes are fitted and the phases continued
(magnitude least squares: Schörkhuber, Zaunschirm and Höldrich, DAGA 2018).
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import tukey

from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from generators.acoustics.tracer.receivers.sphere import sphere_response

F64 = NDArray[np.float64]

TARGET = Path(__file__).parents[1] / "avs3d_bench/inspector/templates/filters.js"
RATE = 44_100
#: Length of the filters (samples); the sphere's response has faded within 3 ms. Half of it is their delay.
TAPS = 256
#: Frequency above which the phase is given up (Hz): ka = 1.1, the limit of the first order.
CUT_ON = 700.0
#: Length of the transform (samples), and directions of the fit.
_RESOLUTION, _DIRECTIONS = 2048, 128
#: Digits of the file.
_DIGITS = 6


def decoder(rate: int = RATE) -> tuple[F64, NDArray[np.complex128]]:
    """Frequencies (F,) in Hz, and the spectra (2, F) of c₀ and c₁ without delay."""
    frequency = np.asarray(np.fft.rfftfreq(_RESOLUTION, 1 / rate), dtype=np.float64)
    toward, weight = np.polynomial.legendre.leggauss(_DIRECTIONS)
    wanted = sphere_response(np.arccos(toward), 2 * np.pi * frequency * HEAD_RADIUS / SPEED_OF_SOUND)
    # Both basis functions are orthogonal over the sphere.
    basis = np.stack([np.ones_like(toward), toward])
    fit = basis * weight / np.sum(basis**2 * weight, axis=1, keepdims=True)
    found = np.empty((2, len(frequency)), dtype=np.complex128)
    for number, each in enumerate(frequency):
        target = wanted[:, number]
        if each > CUT_ON:
            before = basis.T @ found[:, number - 1]
            target = np.abs(target) * np.exp(1j * np.angle(before))
        found[:, number] = fit @ target
    return frequency, found


def filters(rate: int = RATE) -> F64:
    """(2, TAPS) impulse responses of c₀ and c₁, delayed by half their length."""
    frequency, spectra = decoder(rate)
    spectra = spectra * np.exp(-2j * np.pi * frequency * (TAPS // 2) / rate)
    spectra[:, -1] = spectra[:, -1].real
    return np.asarray(np.fft.irfft(spectra, _RESOLUTION)[:, :TAPS] * tukey(TAPS, 0.25))


def script() -> str:
    """The file that the page loads."""
    rows = ",\n  ".join(json.dumps([round(float(value), _DIGITS) for value in row]) for row in filters())
    return (
        '"use strict";\n'
        "// Filters of W and Y for an ear of a rigid sphere at 44.1 kHz: written by benchmarks/head_filters.py.\n"
        "window.AVS3D = window.AVS3D ?? {};\n"
        f"window.AVS3D.earFilters = [\n  {rows},\n];\n"
    )


if __name__ == "__main__":
    TARGET.write_text(script(), encoding="utf-8")
