"""Which candidate sounds? The likelihood of what both ears heard, frame by frame, for a source at each of them.

The published refinement (`aisrm`) keeps one bit of a clip, which ear was louder, and lets a cluster's size overrule it.
Here every cluster gets the likelihood of three cues (`binaural`), given where it lies from each pose:

1. **Interaural phase.** The phasor of bin f in view v has the phase 2πf·s·ITD(φ) plus an error with von Mises'
   distribution (K. V. Mardia, P. E. Jupp, *Directional Statistics*, Wiley 2000, §3.5): ℓ = N·κ·Σ_v R_v with the
   resultant R_v = ⟨Re(phasor · exp(−j·2πf·s·ITD))⟩. Its cosine is bounded: a frame in which a reflection wins, or the
   source is hidden, costs little. κ is fitted to the observation, for the best resultant found. The head scale s (what
   this head's delay is to Woodworth's) is integrated out over `HEAD_SCALES`.
2. **Interaural level**, per octave: ILD = g·ILD_sphere(φ) + error with Student's t distribution, 4 degrees of freedom.
   Reverberation compresses level differences: g ≥ 0 and the error's scale are fitted in closed form, reweighted
   iteratively (K. L. Lange, R. J. A. Little, J. M. G. Taylor, JASA 84 (1989) 881–896), for each point and octave.
   Reflections bias it more than the phase of onsets, and low-frequency delays dominate where there are any
   (F. L. Wightman, D. J. Kistler, JASA 91 (1992) 1648–1661): it counts for 1/(1 + (N·κ)²) of its weight.
3. **Loudness over distance**: level = a − b·20·log10(distance), 0 ≤ b ≤ 1, with the same error model. The fit takes a
   fluctuating source for what it is, a large error, and then the cue says little.

Neighbouring frames, bins and octaves hear the same reflections, so their errors are far from independent. Therefore the
cues are tempered to an effective number of independent observations, `CueWeights`, lest the posterior be too sure.

A sound may come from anywhere on an object: a cluster's likelihood is the mean over points spread over it (not their
maximum, which would favour large ones). Its prior is its share of the points, which settles what sound cannot tell
apart: an object from the crumbs beside it. Front and back, above and below sound alike from one pose (Blauert's cone of
confusion); the agent's turning tells them apart. ``chosen`` names the best cluster even if its posterior is low.

Nothing is learned, and only train views are let in. docs/results-choice.md says how often it is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import binaural, clusters
from baselines.echosegnet.clusters import candidates, merge_fragments

__all__ = ["CueWeights", "SpatialChoice", "ViewPose", "candidates", "choose", "merge_fragments"]

Array = NDArray[np.float64]

#: This head's ITD over that of Woodworth's sphere of 8.75 cm: the spread of human heads, and of HRTFs in use.
HEAD_SCALES = (0.7, 0.8, 0.9, 1.0, 1.1)
#: Degrees of freedom of Student's t.
_FREEDOM = 4.0
_ITERATIONS = 8
#: Standard deviation of levels is at least this (dB): the error of a spherical head as a model of a real one.
_SMALLEST_ERROR = 0.3
#: Largest gain of a fitted level difference over the sphere's.
_LARGEST_GAIN = 1.5
#: Lateral angles at which a frame's resultant is tabulated.
_GRID = np.radians(np.arange(-90.0, 91.0))


class ViewPose(Protocol):
    """The used part of a `views.View`: its name and split, rotation (3, 3) camera-to-world and position (3,)."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def split(self) -> str: ...  # noqa: D102
    @property
    def rotation(self) -> Array: ...  # noqa: D102
    @property
    def position(self) -> Array: ...  # noqa: D102


@dataclass(frozen=True)
class CueWeights:
    """How much each cue counts; 0 leaves it out.

    The defaults were chosen on the homes of scenes_manifest/cue-weights.yaml, which nothing else is measured on: the
    smallest weights whose cross-entropy is within one standard error of the least (docs/results-choice.md).

    Attributes:
        phase: independent phases per frame (of 31 bins), N.
        ild: independent level differences per octave and frame where the phase is not informative.
        level: independent levels per frame.
    """

    phase: float = 6.0
    ild: float = 0.1
    level: float = 0.0

    def ild_beside(self, concentration: float) -> float:
        """Weight of the level differences beside phases of a concentration κ."""
        return self.ild / (1 + (self.phase * concentration) ** 2)

    def __post_init__(self) -> None:
        weights = (self.phase, self.ild, self.level)
        if not all(np.isfinite(weights)) or min(weights) < 0:
            raise Avs3dError(f"cue weights {weights}: expected finite numbers from 0 on")


@dataclass(frozen=True, eq=False)
class SpatialChoice:
    """The answer, and how sure it is. Clusters are in the order of their labels (K of them).

    Attributes:
        chosen: (N,) bool, the points of the likeliest cluster.
        labels: (K,) the clusters' labels, ascending.
        scores: (K,) log-likelihood of each cluster, without its prior; comparable within an observation only.
        posterior: (K,) probability of each cluster, prior included; sums to 1.
        best: index (not label) of the likeliest cluster; −1 if there is none.
        head_scale: fitted ITD over Woodworth's, posterior mean for the best cluster; NaN if no phase was heard.
        ild_gain: fitted ILD over the sphere's, mean over the octaves for the best cluster (what reverberation leaves).
        concentration: κ of the interaural phase; about 0.5 in a reverberant room, above 5 in the open.
        heard: number of views with sound.
    """

    chosen: NDArray[np.bool_]
    labels: NDArray[np.int64]
    scores: Array
    posterior: Array
    best: int
    head_scale: float
    ild_gain: float
    concentration: float
    heard: int


def choose(
    points: NDArray[np.floating],
    labels: NDArray[np.integer],
    views: Sequence[ViewPose],
    clips: NDArray[np.floating],
    *,
    weights: CueWeights | None = None,
) -> SpatialChoice:
    """Choose the cluster that sounds.

    Args:
        points: (N, 3) metres, world of `sparse/0` (Y down).
        labels: (N,) clusters; negative ones are no candidates.
        views: T train views.
        clips: (T, 2, n) their sound at 44.1 kHz, channel 0 left.
        weights: of the cues.

    Returns:
        The choice. Without any cluster nothing is chosen; without any sound the largest cluster is.

    Raises:
        Avs3dError: if shapes do not fit, a number is NaN or infinite, or a view is no train view.
    """
    rotation, position, clips = _listeners(views, clips)
    return judge(points, labels, rotation, position, binaural.observe(clips), weights=weights)


def judge(
    points: NDArray[np.floating],
    labels: NDArray[np.integer],
    rotation: Array,
    position: Array,
    cues: binaural.Cues,
    *,
    weights: CueWeights | None = None,
) -> SpatialChoice:
    """`choose` with the cues already read: camera-to-world rotations (V, 3, 3) and positions (V, 3) of their views."""
    points, labels = clusters.checked(points, labels)
    evidence = gather(points, labels, rotation, position, cues)
    if not len(evidence.labels):
        empty = np.zeros(0)
        chosen = np.zeros(len(points), np.bool_)
        return SpatialChoice(chosen, evidence.labels, empty, empty, -1, np.nan, np.nan, 0.0, 0)
    joint, posterior = evidence.weigh(weights or CueWeights())
    best = int(posterior.argmax())
    scale_weight = np.exp(joint[:, best] - logsumexp(joint[:, best]))
    gain = evidence.gain[evidence.start[best] : evidence.start[best + 1]]
    return SpatialChoice(
        chosen=labels == evidence.labels[best],
        labels=evidence.labels,
        scores=_log_mean(joint.T),
        posterior=posterior,
        best=best,
        head_scale=float(scale_weight @ HEAD_SCALES) if cues.phasors.any() else np.nan,
        ild_gain=float(gain.mean()) if gain.size else np.nan,
        concentration=evidence.concentration,
        heard=int(cues.heard.sum()),
    )


@dataclass(frozen=True, eq=False)
class CueEvidence:
    """The likelihoods of each cue before they are weighed, at P points spread over K clusters.

    Attributes:
        labels: (K,) the clusters' labels, ascending.
        count: (K,) points of each cluster.
        start: (K + 1,) where each cluster's points begin among the P.
        resultant: (S, P) sum over the views of the phasors' resultants, for every head scale.
        concentration: κ of the interaural phase.
        ild: (P,) log-likelihood of the level differences.
        level: (P,) log-likelihood of the loudness.
        gain: (P, B) fitted ILD over the sphere's.
    """

    labels: NDArray[np.int64]
    count: NDArray[np.int64]
    start: NDArray[np.int64]
    resultant: Array
    concentration: float
    ild: Array
    level: Array
    gain: Array

    def weigh(self, weights: CueWeights) -> tuple[Array, Array]:
        """Joint log-likelihood of every head scale and cluster (S, K), and the clusters' posterior (K,)."""
        phase = weights.phase * self.concentration * self.resultant
        rest = weights.ild_beside(self.concentration) * self.ild + weights.level * self.level
        joint = np.stack([_log_mean(phase[:, a:b] + rest[a:b]) for a, b in pairwise(self.start)], axis=1)
        log_posterior = _log_mean(joint.T) + np.log(self.count)
        return joint, np.exp(log_posterior - logsumexp(log_posterior))


def gather(
    points: NDArray[np.floating], labels: NDArray[np.integer], rotation: Array, position: Array, cues: binaural.Cues
) -> CueEvidence:
    """The evidence of ``cues`` for every cluster; shapes as in `judge`."""
    found, count = np.unique(labels[labels >= 0], return_counts=True)
    if not len(found):
        none = np.zeros(0)
        return CueEvidence(found, count, np.zeros(1, np.int64), none, 0.0, none, none, none)
    spread = [clusters.representatives(points[labels == label]) for label in found]
    start = np.concatenate([[0], np.cumsum([len(s) for s in spread])])
    offset = np.concatenate(spread)[:, None, :] - position
    lateral = binaural.lateral_angle(np.einsum("pvi,vij->pvj", offset, rotation))
    distance = np.linalg.norm(offset, axis=-1)
    resultant, kappa = _resultants(cues, lateral)
    ild, gain = _ild_likelihood(cues, lateral)
    return CueEvidence(found, count, start, resultant, kappa, ild, _level_likelihood(cues, distance), gain)


def _listeners(views: Sequence[ViewPose], clips: NDArray[np.floating]) -> tuple[Array, Array, NDArray[np.floating]]:
    """(T, 3, 3), (T, 3), (T, 2, n) in the order of the views' names, so that sums do not depend on the order given."""
    clips = np.asarray(clips)
    if not len(views) or len(clips) != len(views):
        raise Avs3dError(f"{len(views)} views and {len(clips)} clips: expected at least one view and a clip for each")
    for view in views:
        if view.split != "train":
            raise Avs3dError(f"{view.name}: a {view.split} view; only train views may be listened to")
        if not (np.isfinite(view.rotation).all() and np.isfinite(view.position).all()):
            raise Avs3dError(f"{view.name}: its pose is NaN or infinite; regenerate the sparse model")
    order = sorted(range(len(views)), key=lambda v: views[v].name)
    rotation = np.stack([np.asarray(views[v].rotation, dtype=np.float64) for v in order])
    position = np.stack([np.asarray(views[v].position, dtype=np.float64) for v in order])
    return rotation, position, clips[order]


def _resultants(cues: binaural.Cues, lateral: Array) -> tuple[Array, float]:
    """(S, P) sum of the resultants for every head scale and point (lateral (P, V)), and the concentration κ."""
    place = (lateral - _GRID[0]) / (_GRID[1] - _GRID[0])
    left = np.clip(place.astype(np.intp), 0, len(_GRID) - 2)
    share = place - left
    view = np.arange(lateral.shape[1])
    resultants = []
    for scale in HEAD_SCALES:
        turn = np.exp(-2j * np.pi * scale * cues.frequencies[:, None] * binaural.woodworth_itd(_GRID))
        table = (cues.phasors @ turn).real / len(cues.frequencies)
        resultants.append(((1 - share) * table[view, left] + share * table[view, left + 1]).sum(axis=1))
    resultant = np.stack(resultants)
    frames = max(1, int(cues.phasors.any(axis=1).sum()))
    kappa = _concentration(float(resultant.max()) / frames)
    return resultant, kappa


def _concentration(mean_resultant: float) -> float:
    """Von Mises' κ for a mean resultant in [0, 1]: nearly the maximum likelihood, R(2 − R²)/(1 − R²).

    A. Banerjee et al., "Clustering on the unit hypersphere using von Mises–Fisher distributions", JMLR 6 (2005) 1345.
    """
    r = min(max(mean_resultant, 0.0), 0.95)  # a few percent of error are always there: κ stays below 10
    return r * (2 - r * r) / (1 - r * r)


def _ild_likelihood(cues: binaural.Cues, lateral: Array) -> tuple[Array, Array]:
    """(P,) log-likelihood of the level differences, summed over octaves, and (P, B) the fitted gains."""
    heard = cues.heard
    if not heard.any() or not len(cues.bands):
        return np.zeros(len(lateral)), np.zeros((len(lateral), 0))
    table = binaural.head_shadow_ild(_GRID)[:, cues.bands]
    gains, total = [], np.zeros(len(lateral))
    for b in range(len(cues.bands)):
        predicted = np.interp(lateral[:, heard], _GRID, table[:, b])
        likelihood, gain = student_fit(cues.ild[heard, b], predicted, largest=_LARGEST_GAIN)
        total += likelihood
        gains.append(gain)
    return total, np.stack(gains, axis=1)


def _level_likelihood(cues: binaural.Cues, distance: Array) -> Array:
    """(P,) log-likelihood of the levels over the distances (P, V)."""
    heard = cues.heard
    if heard.sum() < 3:
        return np.zeros(len(distance))
    decibel = -20 * np.log10(np.maximum(distance[:, heard], 0.1))
    level = cues.level[heard]
    # The source's own level is unknown and common to all points: medians take it out.
    return student_fit(level - np.median(level), decibel - np.median(decibel, axis=1, keepdims=True), largest=1.0)[0]


def student_fit(observed: Array, predicted: Array, *, largest: float) -> tuple[Array, Array]:
    """Profile log-likelihood of ``observed`` (V,) = gain · ``predicted`` (P, V) + t-distributed error, for each of P.

    Gain (0 to ``largest``) and error scale are the maximum-likelihood ones, by iteratively reweighted least squares.

    Returns:
        log-likelihood (P,) without constants, and gain (P,).
    """
    weight = np.ones_like(predicted)
    for _ in range(_ITERATIONS):
        power = (weight * predicted * predicted).sum(axis=1)
        gain = (weight * predicted * observed).sum(axis=1) / np.maximum(power, 1e-12)
        gain = np.clip(gain, 0.0, largest)
        error = np.square(observed - gain[:, None] * predicted)
        variance = np.maximum((weight * error).mean(axis=1), _SMALLEST_ERROR**2)
        weight = (_FREEDOM + 1) / (_FREEDOM + error / variance[:, None])
    tail = np.log1p(error / (_FREEDOM * variance[:, None])).sum(axis=1)
    return -0.5 * len(observed) * np.log(variance) - 0.5 * (_FREEDOM + 1) * tail, gain


def _log_mean(values: Array) -> Array:
    """Logarithm of the mean of exp(values) along the last axis."""
    return np.asarray(logsumexp(values, axis=-1) - np.log(values.shape[-1]))
