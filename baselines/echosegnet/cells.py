"""The binaural cues of a clip, bin by bin: what a mixture of several sources is told apart by.

`binaural` sums a clip's bins, which names one direction. Where several sources sound at once, each of them dominates
some time–frequency bins (they are sparse there: Ö. Yılmaz, S. Rickard, IEEE Trans. Signal Processing 52 (2004) 1830),
and the sum names none of them. Here the bins' cues are kept as weighted histograms, because the likelihood of a bin
depends on its band and its cue alone (M. I. Mandel, R. J. Weiss, D. P. W. Ellis, "Model-based expectation-maximization
source separation and localization", IEEE Trans. Audio, Speech and Language Processing 18 (2010) 382):

- *interaural phase* of STFT bins in `PHASE_BAND`, `PHASE_LEVELS` values from −π to π;
- *interaural level* of each octave from 707 Hz on in each window of the STFT, `ILD_LEVELS` values.

A bin's weight is that of `binaural`: bins just after an onset count most, because there the direct sound has arrived
and its reflections have not (precedence). A bin's phase counts for the more the higher the interaural coherence around
it: where it is high, one wavefront dominates (C. Faller, J. Merimaa, JASA 116 (2004) 3075). Bins that are too quiet to
be more than leakage do not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfftfreq
from scipy.signal import lfilter

from avs3d_bench.contract.layout import SAMPLE_RATE
from baselines.echosegnet import binaural

Array = NDArray[np.float64]

#: The phases' band (Hz). Above 1.5 kHz one phase fits several directions, but the bins together fit only one, more
#: narrowly than those below: a source 10° aside has a phase of 37° at 1 kHz and of 130° at 4 kHz.
PHASE_BAND = (150.0, 4000.0)
#: Every so many bins of the STFT: with Hann's window, neighbours say the same.
_BIN_STEP = 2
#: Number of values of the interaural phase: 15° each.
PHASE_LEVELS = 24
#: Centres of the values of the interaural level difference (dB); what lies beyond counts as the outermost.
ILD_LEVELS = np.arange(-30.0, 30.1, 1.5)
#: The first octave of `binaural.OCTAVE_EDGES` whose level differences are used: below, the head casts no shadow.
FIRST_OCTAVE = 2
#: Memory of the running mean over which the interaural coherence is measured (s), and its power in a bin's weight.
_COHERENCE_MEMORY, _COHERENCE_POWER = 0.01, 10.0
#: Bins this far below the loudest of their band within the clip do not count (dB).
QUIET_DB = 40.0


@dataclass(frozen=True, eq=False)
class Cells:
    """Histograms of T clips. The cells of one clip have a total weight of 1 in each of both, or 0 if there is no sound.

    Attributes:
        frequencies: (F,) Hz, of the phase's bins.
        phase: (T, F, PHASE_LEVELS) weights; level q is the phase −π + (q + ½)·2π/PHASE_LEVELS, right minus left.
        ild: (T, B, len(ILD_LEVELS)) weights, right minus left, in the octaves from `FIRST_OCTAVE` on.
        octave_db: (T, 7) level of both ears together in each octave, dB re full scale; −inf for silence.
        level_db: (T,) RMS over both ears and all samples, dB re full scale; −inf for silence.
    """

    frequencies: Array
    phase: Array
    ild: Array
    octave_db: Array
    level_db: Array

    def __len__(self) -> int:
        return len(self.level_db)

    @property
    def flat(self) -> Array:
        """(T, C) all weights, the phase's cells first."""
        return np.concatenate([self.phase.reshape(len(self), -1), self.ild.reshape(len(self), -1)], axis=1)


def observe(clips: NDArray[np.floating]) -> Cells:
    """The cells of clips (T, 2, n) at 44.1 kHz, channel 0 left.

    Raises:
        Avs3dError: as `binaural.observe`.
    """
    clips = binaural.checked(clips)
    frequencies = rfftfreq(binaural.WINDOW, 1 / SAMPLE_RATE)
    used = np.flatnonzero((frequencies >= PHASE_BAND[0]) & (frequencies < PHASE_BAND[1]))[::_BIN_STEP]
    edges = np.searchsorted(frequencies, binaural.OCTAVE_EDGES)
    octaves = len(binaural.OCTAVE_EDGES) - 1
    phase = np.zeros((len(clips), len(used), PHASE_LEVELS))
    ild = np.zeros((len(clips), octaves - FIRST_OCTAVE, len(ILD_LEVELS)))
    octave = np.zeros((len(clips), octaves))
    window_power = float(np.square(np.hanning(binaural.WINDOW + 1)[: binaural.WINDOW]).sum())
    for t, clip in enumerate(clips):
        spectrum = binaural.spectrogram(clip)
        power = np.square(np.abs(spectrum))
        energy = np.add.reduceat(power, edges, axis=2)[..., :-1]
        # Both halves of the spectrum, the mean over windows and ears: the mean square of the samples of the octave.
        octave[t] = energy.mean(axis=(0, 1)) * 2 / (window_power * binaural.WINDOW)
        phase[t] = _phase_cells(spectrum[..., used], power[..., used].sum(axis=0))
        ild[t] = _ild_cells(energy[..., FIRST_OCTAVE:])
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.mean(np.square(clips, dtype=np.float64), axis=(1, 2)))
        return Cells(frequencies[used], _normalised(phase), _normalised(ild), 10 * np.log10(octave), level)


def _normalised(cells: Array) -> Array:
    total = cells.sum(axis=(1, 2), keepdims=True)
    return np.asarray(np.divide(cells, total, out=np.zeros_like(cells), where=total > 0))


def _loud(power: Array) -> NDArray[np.bool_]:
    """(frames, bands) whether a bin is within `QUIET_DB` of the loudest of its band."""
    return np.asarray((power > 0) & (power >= power.max(axis=0, initial=0.0) * 10 ** (-QUIET_DB / 10)))


def _phase_cells(spectrum: NDArray[np.complex128], power: Array) -> Array:
    """(F, PHASE_LEVELS) weights of the phase of right against left (2, frames, F)."""
    cross = spectrum[1] * np.conj(spectrum[0])
    phase = np.angle(cross)
    level = np.clip(((phase + np.pi) * (PHASE_LEVELS / (2 * np.pi))).astype(np.intp), 0, PHASE_LEVELS - 1)
    weight = binaural.onset_weights(power) * _loud(power) * _coherence(spectrum, cross) ** _COHERENCE_POWER
    bins = np.arange(power.shape[1])
    cell = (bins * PHASE_LEVELS + level).ravel()
    count = np.bincount(cell, weight.ravel(), power.shape[1] * PHASE_LEVELS)
    return np.asarray(count, np.float64).reshape(-1, PHASE_LEVELS)


def _coherence(spectrum: NDArray[np.complex128], cross: NDArray[np.complex128]) -> Array:
    """(frames, F) running interaural coherence in [0, 1] of a spectrum (2, frames, F) with its cross spectrum."""
    forget = np.exp(-binaural.HOP / SAMPLE_RATE / _COHERENCE_MEMORY)

    def smooth(values: NDArray[np.floating] | NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(lfilter([1 - forget], [1, -forget], values, axis=0))

    left, right = (np.abs(smooth(np.square(np.abs(ear)))) for ear in spectrum)
    loudness = np.sqrt(left * right)
    return np.asarray(np.divide(np.abs(smooth(cross)), loudness, out=np.zeros_like(loudness), where=loudness > 0))


def _ild_cells(energy: Array) -> Array:
    """(B, len(ILD_LEVELS)) weights of the level differences of octaves (2, frames, B)."""
    total = energy.sum(axis=0)
    floor = 1e-6 * total + np.finfo(float).tiny
    ild = 10 * np.log10((energy[1] + floor) / (energy[0] + floor))
    step = ILD_LEVELS[1] - ILD_LEVELS[0]
    level = np.clip(np.rint((ild - ILD_LEVELS[0]) / step).astype(np.intp), 0, len(ILD_LEVELS) - 1)
    # An octave far below the loudest holds leakage; one that is quiet for a while holds the reverberation of before.
    present = total.sum(axis=0) >= total.sum(axis=0).max(initial=0.0) * 10 ** (-QUIET_DB / 10)
    weight = binaural.onset_weights(total) * _loud(total) * present
    cell = (np.arange(total.shape[1]) * len(ILD_LEVELS) + level).ravel()
    count = np.bincount(cell, weight.ravel(), total.shape[1] * len(ILD_LEVELS))
    return np.asarray(count, np.float64).reshape(-1, len(ILD_LEVELS))
