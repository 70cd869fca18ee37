"""The background of part_3: a diffuse sound field has a known coherence between two points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.measures.decay import SPEED_OF_SOUND

#: Spacings of the ears that are tried (m): the effective one of a head is larger than its width, as sound bends round.
SPACINGS = tuple(np.arange(0.14, 0.261, 0.01).tolist())
#: Band in which the formula is compared (Hz): above it the head shadows, below it there are few values.
BAND = (100.0, 1000.0)
#: Length of the segments of Welch's method (samples): values 22 Hz apart.
SEGMENT = 2048
#: Fewer frames are no sample.
LEAST_FRAMES = 2
#: Largest mean difference from the formula. Independent noise at both ears and equal noise at both differ by 0.4.
MOST_OFF = 0.2


def diffuse_coherence(frequency: NDArray[np.floating], spacing: float) -> NDArray[np.float64]:
    """Coherence of a diffuse field at two points: sin(kd) / (kd), with k = 2πf/c (Cook et al., JASA 27, 1955).

    Args:
        frequency: (n,) in Hz.
        spacing: distance d of the points (m).

    Returns:
        (n,) real, −0.22 to 1.

    Examples:
        >>> diffuse_coherence(np.array([0.0, 343.0 / 2]), 1.0).round(6).tolist()
        [1.0, 0.0]
    """
    return np.asarray(np.sinc(2.0 * np.asarray(frequency, dtype=np.float64) * spacing / SPEED_OF_SOUND))


@dataclass
class Coherence:
    """The coherence of the ears, pooled over clips (Welch 1967: Hann windows that overlap by half).

    Attributes:
        frames: clips that were added.
        cross: (f,) sum of the cross spectra of the ears.
        left: (f,) sum of the power spectra of the left ear.
        right: (f,) the same of the right ear.
    """

    frames: int = 0
    cross: NDArray[np.complex128] | float = 0.0
    left: NDArray[np.float64] | float = 0.0
    right: NDArray[np.float64] | float = 0.0

    def add(self, samples: NDArray[np.float32]) -> None:
        """Add a clip, (2, n) at 44.1 kHz."""
        window = np.hanning(SEGMENT)
        starts = range(0, samples.shape[1] - SEGMENT + 1, SEGMENT // 2)
        pieces = np.stack([samples[:, at : at + SEGMENT] for at in starts], axis=1) * window
        spectra = np.fft.rfft(pieces, axis=-1)
        self.frames += 1
        self.cross = self.cross + (spectra[0] * np.conj(spectra[1])).sum(axis=0)
        self.left = self.left + (np.abs(spectra[0]) ** 2).sum(axis=0)
        self.right = self.right + (np.abs(spectra[1]) ** 2).sum(axis=0)

    def value(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies in Hz, and the real part of the coherence at them, both (n,), within `BAND`."""
        frequency = np.asarray(np.fft.rfftfreq(SEGMENT, 1.0 / layout.SAMPLE_RATE), dtype=np.float64)
        inside = (frequency >= BAND[0]) & (frequency <= BAND[1])
        power = np.sqrt(np.asarray(self.left) * np.asarray(self.right))
        coherence = np.real(np.asarray(self.cross)) / np.maximum(power, 1e-30)
        return frequency[inside], np.asarray(coherence[inside])

    def problem(self) -> str | None:
        """The problem of the coherence, with the spacing that fits best; None if it is that of a diffuse field."""
        if self.frames < LEAST_FRAMES:
            return None
        frequency, found = self.value()
        off = {spacing: float(np.abs(found - diffuse_coherence(frequency, spacing)).mean()) for spacing in SPACINGS}
        best = min(off, key=off.__getitem__)
        if off[best] <= MOST_OFF:
            return None
        return (
            f"the coherence of the ears from {BAND[0]:g} to {BAND[1]:g} Hz is {off[best]:.2f} off that of a diffuse "
            f"field (sin(kd)/(kd), d = {best:.2f} m) in the mean; expected at most {MOST_OFF:g}"
        )
