"""What a recording chain adds to a sound: a response, an end of the spectrum, a floor of noise.

Recordings of one device differ by microphone, distance, codec and room noise at least as much as two devices do. A
source that had none of this would be told from a recording by its silence and its top octave alone; and a network that
is trained on such sources would rely on them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from avs3d_bench.contract.layout import SAMPLE_RATE

Array = NDArray[np.float64]

#: Where spectra end (Hz), drawn evenly: so the quartiles of voices are those of recordings (`benchmarks.bandwidths`).
_END = (4_000.0, 18_000.0)
#: The slope at the end: order of the Butterworth low-pass.
_STEEPNESS = (3, 8)
#: Lower end (Hz), of order 1 or 2: housings of small microphones, and high-passes against wind.
_BEGIN = (35.0, 130.0)
#: Standard deviation (dB) of the smooth response, with a knot per octave.
_RESPONSE_DB = 2.5
#: Level of the floor below the sound (dB), and the slope of its spectrum (dB per octave).
_FLOOR_DB = (35.0, 62.0)
_FLOOR_SLOPE = (-6.0, -1.0)
_KNOTS = 31.25 * 2.0 ** np.arange(11)


@dataclass(frozen=True)
class Capture:
    """One recording chain.

    Attributes:
        response: gains (dB) at `_KNOTS`.
        end: where the spectrum ends (Hz, 3 dB down).
        steep: order of the low-pass there.
        begin: lower end (Hz).
        gentle: order of the high-pass there.
        below: level of the floor below the sound (dB).
        slope: of the floor's spectrum (dB per octave).
    """

    response: Array
    end: float
    steep: int
    begin: float
    gentle: int
    below: float
    slope: float

    @classmethod
    def drawn(cls, rng: Generator) -> Capture:
        """A chain that ``rng`` draws."""
        response = np.cumsum(rng.normal(0.0, _RESPONSE_DB / 2.0, len(_KNOTS)))
        return cls(
            response=response - response.mean(),
            end=float(rng.uniform(*_END)),
            steep=int(rng.integers(*_STEEPNESS, endpoint=True)),
            begin=float(np.exp(rng.uniform(*np.log(_BEGIN)))),
            gentle=int(rng.integers(1, 3)),
            below=float(rng.uniform(*_FLOOR_DB)),
            slope=float(rng.uniform(*_FLOOR_SLOPE)),
        )

    def heard(self, signal: Array, rng: Generator) -> Array:
        """The signal through the chain: coloured, of limited bandwidth, over a floor of noise.

        Args:
            signal: (n,) samples at 44,100 Hz, of any level.
            rng: draws the noise.

        Returns:
            (n,) float64.
        """
        level = float(np.sqrt(np.mean(np.square(signal)))) if len(signal) else 0.0
        floor = _shaped(rng.standard_normal(len(signal)), self.slope * np.log2(_KNOTS / 1000.0))
        scale = float(np.sqrt(np.mean(np.square(floor)))) if len(signal) else 0.0
        heard = _shaped(signal, self.response)
        if scale > 0:
            heard = heard + floor * (level / scale * 10 ** (-self.below / 20))
        heard = sosfilt(butter(self.gentle, self.begin, "highpass", fs=SAMPLE_RATE, output="sos"), heard)
        return np.asarray(sosfilt(butter(self.steep, self.end, "lowpass", fs=SAMPLE_RATE, output="sos"), heard))


def captured(signal: Array, rng: Generator) -> Array:
    """(n,) samples at 44,100 Hz as one recording of them, by a chain that ``rng`` draws (`Capture`)."""
    return Capture.drawn(rng).heard(signal, rng)


def _shaped(signal: Array, gains_db: Array) -> Array:
    """The signal with gains (dB) at `_KNOTS`, interpolated over octaves; zero phase."""
    if not len(signal):
        return signal
    spectrum = np.fft.rfft(signal)
    frequencies = np.fft.rfftfreq(len(signal), 1 / SAMPLE_RATE)
    octaves = np.log2(np.maximum(frequencies, _KNOTS[0]) / _KNOTS[0])
    gains = np.interp(octaves, np.arange(len(_KNOTS)), gains_db)
    return np.fft.irfft(spectrum * 10 ** (gains / 20), len(signal))
