"""Cues of a binaural clip for the direction of its source, and their prediction for a spherical head.

Two cues, one per half of Rayleigh's duplex theory (J. Blauert, *Spatial Hearing*, MIT Press 1997, §2.4), both functions
of the **lateral angle** alone: the angle φ between the source and the head's median plane, positive to the right.
Sources on one cone of confusion (in front and behind, above and below) sound alike; a listener who moves tells them
apart.

- *Interaural phase*, 150 Hz to 1.5 kHz, where it is unambiguous: the left ear lags by Woodworth's ITD (a/c)(φ + sin φ).
  Each time–frequency bin gives a phasor of unit length (the phase transform: Knapp and Carter 1976); a clip's phasor is
  their sum over the *onsets*, which arrive before their reflections do (the precedence effect: Blauert §3.1). In its
  length stands its reliability: reflections scatter the phases (the interaural coherence of Faller and Merimaa 2004).
- *Interaural level*, octaves from 250 Hz on, after Brown and Duda's head shadow, a one-pole fit of the rigid sphere.

Conventions: channel 0 is left; ILD in dB = level(right) − level(left); ITD in s is positive where the left ear lags. So
all cues of a source on the right are positive.

References:
    R. S. Woodworth, *Experimental Psychology*, Holt 1938, pp. 520–523.
    C. P. Brown, R. O. Duda, IEEE Trans. Speech and Audio Processing 6 (1998) 476–488, eqs. (2)–(4).
    R. O. Duda, W. L. Martens, "Range dependence of the response of a spherical head model", JASA 104 (1998) 3048–3058.
    C. H. Knapp, G. C. Carter, IEEE Trans. ASSP 24 (1976) 320–327.
    C. Faller, J. Merimaa, JASA 116 (2004) 3075–3089.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import rfft, rfftfreq
from scipy.signal import lfilter
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import Avs3dError

Array = NDArray[np.float64]

HEAD_RADIUS = 0.0875  # m, Brown and Duda's
SPEED_OF_SOUND = 343.0  # m/s
#: Interaural phase is read between these; above, a period is shorter than twice the largest delay.
PHASE_BAND = (150.0, 1500.0)
#: Edges of the octaves in which level differences are read, Hz (the last one ends where the air begins to absorb).
OCTAVE_EDGES = np.array([177.0, 354.0, 707.0, 1414.0, 2828.0, 5657.0, 11314.0, 18000.0])
#: Octaves this far below the loudest are ignored (dB): they hold leakage and quantisation noise.
_BAND_FLOOR_DB = 30.0
WINDOW, HOP = 1024, 256  # 23 ms and 6 ms
#: A bin is an onset if it is this much louder (3 dB) than the mean of its past, forgotten with this time constant (s).
_ONSET, _MEMORY = 2.0, 0.05
#: Weight of a bin that is no onset, so that a steady tone counts as well.
_STEADY = 0.02
#: Brown and Duda's smallest zero coefficient and the angle (radians) at which it is reached, their eq. (4).
_ALPHA_MIN, _THETA_MIN = 0.1, np.radians(150.0)


@dataclass(frozen=True, eq=False)
class Cues:
    """The cues of V clips.

    Attributes:
        frequencies: (F,) Hz, of the phasors.
        phasors: (V, F) complex: the right ear's phase minus the left's. A frame's lengths are its bins' reliability and
            have mean 1, or are all 0 if nothing was heard.
        ild: (V, B) dB, right minus left, in the octaves of `bands`; 0 in a silent frame.
        level: (V,) dB, of both ears together; −inf for silence.
        bands: (B,) indices into the octaves of `OCTAVE_EDGES`: those that hold sound.
    """

    frequencies: Array
    phasors: NDArray[np.complex128]
    ild: Array
    level: Array
    bands: NDArray[np.intp]

    @property
    def heard(self) -> NDArray[np.bool_]:
        """(V,) whether a frame has sound at both ears."""
        return np.isfinite(self.level)

    def select(self, views: NDArray[np.intp] | NDArray[np.bool_]) -> Cues:
        """The cues of some of the views."""
        return Cues(self.frequencies, self.phasors[views], self.ild[views], self.level[views], self.bands)


def observe(clips: NDArray[np.floating]) -> Cues:
    """Read the cues of clips (V, 2, n) at 44.1 kHz, channel 0 left.

    Raises:
        Avs3dError: if the shape is another, a clip is shorter than 23 ms, or a sample is NaN or infinite.
    """
    clips = checked(clips)
    frequencies = rfftfreq(WINDOW, 1 / SAMPLE_RATE)
    phase_bins = (frequencies >= PHASE_BAND[0]) & (frequencies < PHASE_BAND[1])
    edges = np.searchsorted(frequencies, OCTAVE_EDGES)
    phasors = np.zeros((len(clips), int(phase_bins.sum())), dtype=np.complex128)
    energy = np.zeros((len(clips), 2, len(OCTAVE_EDGES) - 1))
    for v, clip in enumerate(clips):
        spectrum = spectrogram(clip)
        power = np.square(np.abs(spectrum))
        energy[v] = np.add.reduceat(power.sum(axis=1), edges, axis=1)[:, :-1]
        phasors[v] = _phasor(spectrum[..., phase_bins], power[..., phase_bins].sum(axis=0))
    return _cues(frequencies[phase_bins], phasors, energy)


def checked(clips: NDArray[np.floating]) -> NDArray[np.floating]:
    """The clips (V, 2, n), or a clear line.

    Raises:
        Avs3dError: if the shape is another, a clip is shorter than 23 ms, or a sample is NaN or infinite.
    """
    clips = np.asarray(clips)
    if clips.ndim != 3 or clips.shape[1] != 2 or clips.shape[2] < WINDOW:
        raise Avs3dError(f"binaural clips: shape {clips.shape}, expected (views, 2, samples ≥ {WINDOW})")
    bad = np.flatnonzero(~np.isfinite(clips).all(axis=(1, 2)))
    if len(bad):
        raise Avs3dError(f"binaural clips: clip {bad[0]} holds NaN or infinite samples; regenerate the audio")
    return clips


def _cues(frequencies: Array, phasors: NDArray[np.complex128], energy: Array) -> Cues:
    # One deaf ear is a defect of a file, not a direction.
    heard = (energy.sum(axis=2) > 0).all(axis=1)
    total = energy.sum(axis=(0, 1))
    bands = np.flatnonzero((total > 0) & (total >= total.max(initial=0.0) * 10 ** (-_BAND_FLOOR_DB / 10)))
    # A floor far below any sound: an octave that is silent at one ear of one frame must not weigh infinitely.
    floor = 1e-6 * energy.sum(axis=1, keepdims=True) + np.finfo(float).tiny
    ild = 10 * np.log10((energy[:, 1] + floor[:, 0]) / (energy[:, 0] + floor[:, 0]))[:, bands]
    length = np.abs(phasors).mean(axis=1)
    phasors = np.where((heard & (length > 0))[:, None], phasors / np.where(length > 0, length, 1.0)[:, None], 0.0)
    with np.errstate(divide="ignore"):
        level = np.where(heard, 10 * np.log10(energy.sum(axis=(1, 2))), -np.inf)
    return Cues(frequencies, phasors, np.where(heard[:, None], ild, 0.0), level, bands)


def spectrogram(clip: NDArray[np.floating]) -> NDArray[np.complex128]:
    """(2, frames, bins) short-time spectrum with a periodic Hann window."""
    window = np.hanning(WINDOW + 1)[:WINDOW]
    framed = np.lib.stride_tricks.sliding_window_view(clip.astype(np.float64), WINDOW, axis=-1)[:, ::HOP]
    return np.asarray(rfft(framed * window, axis=-1), dtype=np.complex128)


def _phasor(spectrum: NDArray[np.complex128], power: Array) -> NDArray[np.complex128]:
    """(F,) sum of the unit phasors of right against left (2, frames, F), onsets (from ``power`` (frames, F)) first."""
    cross = spectrum[1] * np.conj(spectrum[0])
    unit = cross / np.maximum(np.abs(cross), np.finfo(float).tiny)
    return np.asarray((onset_weights(power) * unit).sum(axis=0))


def onset_weights(power: Array) -> Array:
    """(frames, F) weights of bins of a power (frames, F): those that follow an onset count most."""
    forget = np.exp(-HOP / SAMPLE_RATE / _MEMORY)
    # Before the clip the past is taken to have been like its first frame: a clip's beginning is no onset.
    smooth, _ = lfilter([1 - forget], [1, -forget], power, axis=0, zi=forget * power[:1])
    past = np.concatenate([power[:1], smooth[:-1]])
    return np.asarray(_STEADY + (power > _ONSET * past))


def lateral_angle(directions: ArrayLike) -> Array:
    """(...) radians from the median plane, positive right; directions (..., 3) in OpenCV camera axes, any length."""
    vectors = np.asarray(directions, dtype=np.float64)
    right, rest = vectors[..., 0], np.linalg.norm(vectors[..., 1:], axis=-1)
    # The arctangent keeps its digits near ±90°, and a source at the head's centre is no error but straight ahead.
    return np.asarray(np.arctan2(right, rest))


def woodworth_itd(lateral: ArrayLike) -> Array:
    """ITD in s of a far source at ``lateral`` radians: (a/c)(φ + sin φ), positive on the right (Woodworth 1938)."""
    phi = np.asarray(lateral, dtype=np.float64)
    return np.asarray(HEAD_RADIUS / SPEED_OF_SOUND * (phi + np.sin(phi)))


def sphere_phase(frequencies: ArrayLike, lateral: ArrayLike) -> Array:
    """(L, F) interaural phase (radians) of a far source for a rigid sphere with ears at ±90°, positive right.

    Duda and Martens's series for a source at infinity. Its delay is half as large again as Woodworth's at the lowest
    frequencies and falls towards it above 1 kHz (G. F. Kuhn, JASA 62 (1977) 157, fig. 2).
    """
    size = (2 * np.pi * HEAD_RADIUS / SPEED_OF_SOUND * np.asarray(frequencies, dtype=np.float64))[:, None]
    order = np.arange(int(1.5 * size.max(initial=0.0)) + 12)
    slope = spherical_jn(order, size, derivative=True) + 1j * spherical_yn(order, size, derivative=True)
    terms = (2 * order + 1) * 1j**order / slope
    right, left = (
        eval_legendre(order, np.cos(np.pi / 2 + side * np.asarray(lateral, dtype=np.float64)[:, None])) @ terms.T
        for side in (-1, 1)
    )
    return np.asarray(np.angle(right * np.conj(left)))


def shadow_power(frequency: ArrayLike, incidence: ArrayLike) -> Array:
    """|H|² at an ear: the sound at ``frequency`` (Hz) under ``incidence`` (radians; 0 = into the ear), 1 = no head.

    H = (α(θ)·jω + β)/(jω + β), β = 2c/a, α = 1.05 + 0.95·cos(180°·θ/150°) (Brown and Duda, eqs. 2–4).
    """
    omega = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
    theta = np.asarray(incidence, dtype=np.float64)
    alpha = (1 + _ALPHA_MIN / 2) + (1 - _ALPHA_MIN / 2) * np.cos(theta / _THETA_MIN * np.pi)
    beta = 2 * SPEED_OF_SOUND / HEAD_RADIUS
    return np.asarray((np.square(alpha * omega) + beta**2) / (np.square(omega) + beta**2))


def head_shadow_ild(lateral: ArrayLike) -> Array:
    """ILD in dB of each octave of `OCTAVE_EDGES`, anechoic, for ``lateral`` (radians, any shape): shape (..., 7).

    The power at each ear is averaged over the octave's logarithmic frequency axis.
    """
    phi = np.asarray(lateral, dtype=np.float64)[..., None, None]
    steps = (np.arange(8) + 0.5) / 8
    grid = OCTAVE_EDGES[:-1, None] * (OCTAVE_EDGES[1:] / OCTAVE_EDGES[:-1])[:, None] ** steps
    right = shadow_power(grid, np.pi / 2 - phi).mean(axis=-1)
    left = shadow_power(grid, np.pi / 2 + phi).mean(axis=-1)
    return np.asarray(10 * np.log10(right / left))
