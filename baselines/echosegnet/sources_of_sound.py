"""A pool of sources fitted to all clips: what each sounds like, and when it is on.

Every source k of the pool has a share s_kf of each band f, the same in all frames, and a level E_kb in each octave b.
While the set S is on, the cells of band f have the density

    p(cell | S) = (s_0f·D + Σ_{k ∈ S} s_kf·n_k·A_k) / (s_0f + Σ_{k ∈ S} s_kf·n_k)

with the densities of `mixture` and the nearness n_k ∝ 1/distance², because a room's diffuse sound is equally loud
everywhere and direct sound is not (H. Kuttruff, *Room Acoustics*, 6th ed., CRC 2016, §5.5): a source at a wrong place
would have to be direct where it is far. The level of octave b is 10·lg(B_b + Σ_{k ∈ S} E_kb) with an error of Student's
t distribution (4 degrees of freedom), because sources fluctuate and the listener moves. B is the background: a spectrum
that some frames have so exactly that nothing but stationary noise is left as their explanation. Shares, levels and the
probabilities of the sets are found in turn (expectation maximisation with a hidden Markov chain per source). Half of
the prior probability is that of a pool whose sources always sound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from baselines.echosegnet import binaural
from baselines.echosegnet.chains import Chains

Array = NDArray[np.float64]
Single = NDArray[np.float32]

#: Log-likelihood of a source that is on in silence, and of sound without a source or a background.
_UNLIKELY = -30.0
#: Steps of the shares for a pool whose sources always sound.
_ALWAYS_STEPS = 12
#: Steps of the shares, which converge slowest, in each round of expectation maximisation: few before it is known when
#: the sources are on.
_STEPS = (1, 1, 1, 2, 4, 4)
#: Cells with less of a frame's weight count for nothing: three quarters of them, which hold a twentieth of the weight.
_LEAST_CELL = 5e-4
#: Weight of cells that each component of a band has beforehand, so that none dies out.
_LEAST_WEIGHT = 1e-3
#: Spacing of the levels of a background that are tried (dB), and how far frames of one level may differ from it.
_LEVEL_STEP, _LEVEL_WIDTH = 1.0, 1.0
#: Level of an octave of stationary Gaussian noise of bandwidth B in T seconds: its standard deviation is 4.34/√(BT) dB
#: (J. S. Bendat, A. G. Piersol, *Random Data*, Wiley 2010, §8.2); what no background falls below.
_NOISE_DB, _LEAST_ERROR = 10 / np.log(10), 0.15
#: Deviation of an octave's level from that of the sources that are on (dB).
_SOURCE_ERROR = 3.0
#: Octaves this far below the loudest of a background do not count (dB); level of an octave without sound (dB).
_OCTAVE_FLOOR, _NO_SOUND = 50.0, -150.0
#: Frames that must have the spectrum of a background; how far below it a frame may be (standard deviations), and the
#: share of frames that may be farther.
_LEAST_FRAMES, _MOST_BELOW, _MOST_CONTRADICTIONS = 3, 5.0, 0.02


@dataclass(frozen=True, eq=False)
class PoolCells:
    """The N cells that count, of all T frames, and their densities for the m sources of a pool.

    Attributes:
        frame, band: (N,) of each cell.
        start: (T + 1,) where the cells of each frame begin.
        weight: (N,) of each cell.
        amount: (T, bands) sum of the weights.
        by_band: (bands, N) 1 for each cell of a band.
        densities: (m, N) for each source, over those of diffuse sound, times its nearness.
        nearness: (T, m) see `HeardFrames`.
    """

    frame: NDArray[np.intp]
    band: NDArray[np.intp]
    start: NDArray[np.intp]
    weight: Single
    amount: Array
    by_band: csr_array
    densities: Single
    nearness: Array

    def parts(self, share: Array) -> tuple[Single, Single]:
        """(N,) the diffuse part and (m, N) those of the sources in the cells, with shares (1 + m, bands)."""
        single: Single = share.astype(np.float32)[:, self.band]
        return single[0], single[1:] * self.densities


@dataclass(frozen=True, eq=False)
class HeardFrames:
    """Cells and levels of the sound in T frames.

    Attributes:
        weights: (T, C) of the cells; one effective bin per frame.
        places: (T, J, C) densities of the cells for a source at each of J places, over that of diffuse sound.
        bands: (bands,) index of the first cell of each band.
        frames: (T,) whether a frame is loud enough for anything to be audible.
        octave_db: (T, B) levels, dB re full scale.
        nearness: (T, J) direct over diffuse energy of a source at each place, over its mean in dB: 1/distance².
    """

    weights: Array
    places: Array
    bands: NDArray[np.intp]
    frames: NDArray[np.bool_]
    octave_db: Array
    nearness: Array

    @cached_property
    def _every(self) -> PoolCells:
        """The cells of all places."""
        frame, cell = np.nonzero(self.weights > _LEAST_CELL * self.weights.sum(axis=1, keepdims=True))
        band = np.searchsorted(self.bands, cell, side="right") - 1
        weight, number = self.weights[frame, cell].astype(np.float32), np.arange(len(cell))
        start = np.searchsorted(frame, np.arange(len(self.weights) + 1))
        by_band = csr_array((np.ones(len(cell), np.float32), (band, number)), shape=(len(self.bands), len(cell)))
        amount = np.zeros((len(self.weights), len(self.bands)))
        np.add.at(amount, (frame, band), weight)
        densities = (self.nearness[frame] * self.places[frame, :, cell]).T.astype(np.float32, order="C")
        return PoolCells(frame, band, start, weight, amount, by_band, densities, self.nearness)

    def of(self, pool: tuple[int, ...]) -> PoolCells:
        """What the likelihood of a pool needs."""
        places = list(pool)
        return replace(self._every, densities=self._every.densities[places], nearness=self.nearness[:, places])

    @cached_property
    def levels(self) -> Array:
        """(T, B) levels of the octaves, finite."""
        return np.maximum(self.octave_db, _NO_SOUND)

    @cached_property
    def loudness(self) -> Array:
        """(T,) level of all octaves together, dB."""
        return np.asarray(10 * np.log10((10 ** (self.levels / 10)).sum(axis=1)))

    @cached_property
    def background(self) -> Array | None:
        """(B,) the spectrum that most frames have exactly, dB; None if there is none."""
        best, found = 0.0, None
        heard = self.loudness[self.frames]
        for level in np.arange(heard.min(), heard.max() + _LEVEL_STEP, _LEVEL_STEP) if len(heard) else ():
            near = self.frames & (np.abs(self.loudness - level) <= _LEVEL_WIDTH)
            if near.sum() < _LEAST_FRAMES:
                continue
            spectrum = np.median(self.levels[near], axis=0)
            if _contradicted(self.levels, spectrum):
                continue
            gain = steady(self.levels[near], spectrum) - _density(self.levels[near] - spectrum, _SOURCE_ERROR)
            if (gain > 0).sum() >= _LEAST_FRAMES and (support := float(np.maximum(gain, 0.0).sum())) > best:
                best, found = support, spectrum
        return found


def steady(levels: Array, spectrum: Array) -> Array:
    """(T,) mean log-density over octaves of levels (T, B) of stationary noise with a spectrum (B,)."""
    used = spectrum >= spectrum.max() - _OCTAVE_FLOOR
    return _density((levels - spectrum)[:, used], _steady_error()[used])


def _steady_error() -> Array:
    """(B,) standard deviation of the levels of stationary noise, dB."""
    return np.asarray(np.hypot(_NOISE_DB / np.sqrt(np.diff(binaural.OCTAVE_EDGES)), _LEAST_ERROR))


def _contradicted(levels: Array, spectrum: Array) -> bool:
    """Whether frames are quieter than a background that is always there can be."""
    used = spectrum >= spectrum.max() - _OCTAVE_FLOOR
    below = ((levels - spectrum)[:, used] < -_MOST_BELOW * _steady_error()[used]).any(axis=1)
    return bool(below.mean() > _MOST_CONTRADICTIONS)


def _density(error: Array, scale: Array | float) -> Array:
    """Mean over the last axis of the logarithm of Student's t density, 4 degrees of freedom, without its constant."""
    return np.asarray((-2.5 * np.log1p(np.square(error / scale) / 4) - np.log(scale)).mean(axis=-1))


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted pool of m sources.

    Attributes:
        evidence: log-likelihood of all frames, without the pool's prior.
        on: (T, m) probability that each source is on.
    """

    evidence: float
    on: Array


def fit(heard: HeardFrames, pool: tuple[int, ...], *, bins: float, octaves: float, on: float, off: float) -> Fit:
    """Fit a pool.

    Args:
        heard: what was heard.
        pool: places of its sources.
        bins: effective number of independent bins per frame.
        octaves: effective number of independent levels per frame.
        on: probability that a source that is off starts between two frames.
        off: probability that a source that is on stops.
    """
    chains = Chains(len(pool), on, off)
    states = np.array(chains.states, dtype=np.bool_).reshape(len(chains.states), len(pool))
    empty = _empty(heard, octaves)
    if not pool:
        return Fit(float(empty.sum()), np.zeros((len(heard.frames), 0)))
    cells = heard.of(pool)
    share = np.full((1 + len(pool), len(heard.bands)), 1.0 / (1 + len(pool)))
    typical = np.median(heard.levels[heard.frames], axis=0) if heard.frames.any() else heard.levels[0]
    level = np.tile(typical - 10 * np.log10(len(pool)), (len(pool), 1))
    start = np.zeros((len(heard.frames), len(states)))
    start[:, -1] = 1.0

    def improve(steps: int, probability: Array, share: Array, level: Array) -> tuple[Array, Array, Array]:
        for _ in range(steps):
            share = _counts(cells, states, share, probability, _LEAST_WEIGHT)
            share /= share.sum(axis=0)
        level = _levels(heard, states, level, probability)
        emission = bins * _sets(cells, states, share) + octaves * _level_likelihoods(heard, states, level)
        emission[~heard.frames] = _UNLIKELY
        emission[:, 0] = empty
        return share, level, emission

    *_, emission = improve(_ALWAYS_STEPS, start, share, level)
    always = float(emission[:, -1].sum())
    probability = start
    if len(set(pool)) < len(pool):
        probability, level = _two_levels(heard, pool, states, level)
    for steps in _STEPS:
        share, level, emission = improve(steps, probability, share, level)
        probability = chains.posterior(emission)
    evidence = float(np.logaddexp(always, chains.evidence(emission[:, :, None])[0]))
    share_always = float(np.exp(always - evidence))
    return Fit(evidence - np.log(2), share_always + (1 - share_always) * (probability @ states))


def _two_levels(
    heard: HeardFrames, pool: tuple[int, ...], states: NDArray[np.bool_], level: Array
) -> tuple[Array, Array]:
    """(T, S) probabilities and (m, B) levels to start from where a place is in the pool twice: soft, and loud."""
    again = np.array([place in pool[:item] for item, place in enumerate(pool)])
    low, high = np.percentile(heard.loudness[heard.frames], [10, 90]) if heard.frames.any() else (0.0, 0.0)
    loud = heard.loudness > (low + high) / 2
    probability = np.zeros((len(loud), len(states)))
    probability[loud, -1] = 1.0
    probability[~loud, int(np.flatnonzero((states == ~again).all(axis=1))[0])] = 1.0
    if loud.any() and (~loud & heard.frames).any():
        soft = np.median(heard.levels[~loud & heard.frames], axis=0)
        level = np.where(again[:, None], np.median(heard.levels[loud], axis=0), soft - 10 * np.log10((~again).sum()))
    return probability, level


def _empty(heard: HeardFrames, octaves: float) -> Array:
    """(T,) log-likelihood of each frame if nothing is on."""
    out = np.where(heard.frames, _UNLIKELY, 0.0)
    if heard.background is not None:
        noise = octaves * steady(heard.levels, heard.background)
        out[heard.frames] = np.maximum(noise, _UNLIKELY)[heard.frames]
    return out


def _totals(sound: PoolCells, states: NDArray[np.bool_], share: Array) -> Array:
    """(T, S, bands) sum of the components' weights while each set of sources sounds."""
    return np.asarray(share[0] + states.astype(np.float64) @ (sound.nearness[:, :, None] * share[1:]))


def _sets(sound: PoolCells, states: NDArray[np.bool_], share: Array) -> Array:
    """(T, S) log-likelihood of the cells while each set of states (S, m) of sources sounds; see `fit`."""
    diffuse, parts = sound.parts(share)
    mixed = states.astype(np.float32) @ parts
    mixed += diffuse
    totals = np.einsum("tb,tsb->ts", sound.amount, np.log(_totals(sound, states, share)))
    np.log(mixed, out=mixed)
    return np.asarray([mixed[:, a:b] @ sound.weight[a:b] for a, b in pairwise(sound.start)] - totals)


def _counts(sound: PoolCells, states: NDArray[np.bool_], share: Array, probability: Array, least: float) -> Array:
    """(1 + m, bands) the next shares from the probabilities (T, S) of the states (S, m).

    Minorisation and maximisation (D. R. Hunter, Annals of Statistics 32 (2004) 384, eq. 6): a component's share is its
    count of cells over the count that a share of 1 would be due.
    """
    used = (probability >= least).any(axis=0) & states.any(axis=1)
    on, probability = states[used], np.where(probability < least, 0.0, probability)[:, used]
    diffuse, parts = sound.parts(share)
    alike = on.astype(np.float32)
    mixed = alike @ parts
    mixed += diffuse
    ratio = np.divide(probability.T.astype(np.float32)[:, sound.frame], mixed, out=mixed)
    ratio *= sound.weight
    count = np.vstack([diffuse * ratio.sum(axis=0), parts * (alike.T @ ratio)])
    part = probability[:, :, None] * sound.amount[:, None] / _totals(sound, on, share)
    due = (sound.nearness[:, :, None] * (on.T.astype(np.float64) @ part)).sum(axis=0)
    return np.asarray((least + (sound.by_band @ count.T).T) / (least + np.vstack([part.sum(axis=(0, 1)), due])))


def _predicted(heard: HeardFrames, states: NDArray[np.bool_], level: Array) -> Array:
    """(S, B) levels of the octaves in each state, dB."""
    floor = heard.background if heard.background is not None else np.full(level.shape[1], _NO_SOUND)
    return np.asarray(10 * np.log10(states @ 10 ** (level / 10) + 10 ** (floor / 10)))


def _levels(heard: HeardFrames, states: NDArray[np.bool_], level: Array, probability: Array) -> Array:
    """(m, B) the next levels: each source takes its part of the error of the states in which it is on."""
    predicted = _predicted(heard, states, level)
    error = heard.levels[:, None] - predicted
    weight = probability[:, :, None] / (1 + np.square(error / _SOURCE_ERROR) / 4) * heard.frames[:, None, None]
    out = level.copy()
    for item in range(len(level)):
        part = states[:, [item]] * 10 ** ((level[item] - predicted) / 10)
        total = (weight * part).sum(axis=(0, 1))
        out[item] += (weight * part * error).sum(axis=(0, 1)) / np.maximum(total, 1e-9)
    return out


def _level_likelihoods(heard: HeardFrames, states: NDArray[np.bool_], level: Array) -> Array:
    """(T, S) log-likelihood of the levels of each frame in each state; 0 in the first, in which nothing is on."""
    predicted = _predicted(heard, states, level)
    out = _density(heard.levels[:, None] - predicted, _SOURCE_ERROR)
    out[:, ~states.any(axis=1)] = 0.0
    return out
