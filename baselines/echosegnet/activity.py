"""Which of several candidates sound in which frames of a part_3 observation, or that none of them does.

`spatial` asks which one candidate always sounds. Here any number may sound, each from time to time, and the sound may
come from none of them: from another room, or from everywhere. The answer is a posterior over hypotheses of this kind:

- A *pool* of sources: up to `LARGEST_POOL` of the candidates, and sources *elsewhere*, at up to two places without a
  candidate that are found in the sound itself (a door through which another room is heard, an object that nobody
  marked). A place that is in the pool twice is one source that is soft at times and loud at others: without that, a
  second object would be blamed for every change of the recording. Beside them there may be a diffuse *background* of
  constant level. Each has a prior probability.
- Every source of the pool is on or off in each frame: a Markov chain of its own, because programmes last for seconds.
- Given the set that is on, each time–frequency bin of the clip is dominated by one of these sources, in the direction
  in which it lies from that pose, or by diffuse sound (`mixture`). How much of a frequency is a source's is a property
  of the source, the same in all frames but for the distance (`sources_of_sound`): a wrong place may fit some frames,
  but not the same frequencies in all. The clip's level in octaves is the sum of the sources' own. A clip that is all
  but silent needs an empty set; one that is not needs a source, or a background of its spectrum.

Pools are compared by the forward algorithm (L. R. Rabiner, Proc. IEEE 77 (1989) 257), so that the evidence for a source
that stays where it is adds up over all frames; the posterior of each frame is that of the forward–backward algorithm,
averaged over the pools, which a beam search finds. Neighbouring bins hear the same reflections: `ActivityWeights`
temper the likelihood to an effective number of independent bins, chosen by cross-entropy on homes that nothing is
reported on (docs/results-choice.md), lest the posterior be too sure.

The clips of test frames are inputs of the task as their pictures are; no truth is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB
from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import cells as cells_of
from baselines.echosegnet import mixture
from baselines.echosegnet.cells import Cells
from baselines.echosegnet.sources_of_sound import Fit, HeardFrames, fit

Array = NDArray[np.float64]

#: Most candidates that sound in one observation.
LARGEST_POOL = 4
#: Most places elsewhere.
_MOST_ELSEWHERE = 2
#: Pools of one size that are extended by one more source, if their posterior odds to the best pool found so far are at
#: least exp(−this): single sources, larger pools.
_BEAM, _HOPELESS_ALONE, _HOPELESS = 3, 30.0, 5.0
#: Grid of places elsewhere: spacing, margin around the walk and the candidates, distance from all candidates (m).
_SPACING, _MARGIN, _CLEARANCE = 0.4, 1.5, 0.6
#: Nearer than this the direct sound grows no further (m): objects are no points.
_LEAST_DISTANCE = 0.7
#: Share of the phases in a frame's effective bins; the rest are level differences.
_PHASE_SHARE = 0.75
#: Posterior from which on a candidate is marked.
DECIDED = 0.5

#: Places of the sources, ascending; a place may be there twice.
Pool = tuple[int, ...]


@dataclass(frozen=True)
class ActivityWeights:
    """How much each kind of evidence counts.

    Attributes:
        bins: effective number of independent time–frequency bins per frame.
        source: natural logarithm of the prior odds of one more source in the pool.
        elsewhere: the same of a source elsewhere.
        louder: the same of a source's being soft at times and loud at others, and of a second place elsewhere.
        on, off: probability that a source of the pool starts, and stops, between two frames.
        octaves: effective number of independent levels of octaves per frame.
    """

    bins: float = 4.0
    source: float = -4.0
    elsewhere: float = -7.0
    louder: float = -2.0
    on: float = 0.07
    off: float = 0.07
    octaves: float = 1.0

    def __post_init__(self) -> None:
        numbers = (self.bins, self.octaves)
        if not all(np.isfinite(numbers)) or min(numbers) < 0:
            raise Avs3dError(f"activity weights {numbers}: expected finite numbers from 0 on")
        if not (0 < self.on < 1 and 0 < self.off < 1):
            raise Avs3dError(f"activity weights: on {self.on}, off {self.off}: expected probabilities between 0 and 1")


@dataclass(frozen=True, eq=False)
class Activity:
    """The answer, frame by frame.

    Attributes:
        posterior: (T, K) probability that each candidate sounds in each frame.
        elsewhere: (T,) probability that a source elsewhere sounds.
        ever: (K,) probability that a candidate is a source at all.
        heard: (T,) whether a frame is loud enough for anything to be audible.
    """

    posterior: Array
    elsewhere: Array
    ever: Array
    heard: NDArray[np.bool_]

    @property
    def active(self) -> NDArray[np.bool_]:
        """(T, K) whether a candidate is said to sound."""
        return np.asarray(self.posterior > DECIDED)


def infer(
    candidates: Sequence[Array],
    rotation: Array,
    position: Array,
    clips: NDArray[np.floating],
    *,
    size: Array | None = None,
    weights: ActivityWeights | None = None,
) -> Activity:
    """Infer which candidates sound in which frames.

    Args:
        candidates: K arrays (P, 3) of points spread over each, metres, OpenCV world of the poses.
        rotation: (T, 3, 3) camera-to-world of all frames in the order of time.
        position: (T, 3) metres.
        clips: (T, 2, n) their sound at 44.1 kHz, channel 0 left.
        size: (K,) of the candidates, in any unit: the prior odds of two are those of their sizes, which settles what
            sound cannot tell apart, an object from the crumbs beside it. None: all are alike.
        weights: of the evidence.

    Raises:
        Avs3dError: if shapes do not fit or a number is NaN or infinite.
    """
    if not len(clips) == len(rotation) == len(position):
        raise Avs3dError(f"{len(clips)} clips for {len(rotation)} poses: expected one each")
    if size is not None and not (size.shape == (len(candidates),) and np.isfinite(size).all() and (size > 0).all()):
        raise Avs3dError(f"sizes {size}: expected {len(candidates)} finite numbers above 0, one for each candidate")
    evidence = gather(candidates, rotation, position, cells_of.observe(clips), size)
    return decide(evidence, weights or ActivityWeights())


@dataclass(frozen=True, eq=False)
class ClipEvidence:
    """Evidence of the clips: the cells and levels of each, and the densities of the cells for each place.

    Attributes:
        count: number of candidates, the first places of ``heard``; the rest are elsewhere.
        heard: see `sources_of_sound`.
        prior: (count,) logarithm of each candidate's prior odds to the largest.
    """

    count: int
    heard: HeardFrames
    prior: Array


def gather(
    candidates: Sequence[Array], rotation: Array, position: Array, cells: Cells, size: Array | None = None
) -> ClipEvidence:
    """The evidence for the candidates and for the likeliest places elsewhere; arguments as of `infer`."""
    for number, points in enumerate(candidates):
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise Avs3dError(f"candidate {number}: points {points.shape}, expected (P, 3) finite metres, P ≥ 1")
    table = mixture.direct_table(cells.frequencies)
    diffuse = mixture.diffuse_density(cells.frequencies)
    bins = mixture.cell_weights(cells, _PHASE_SHARE, 1 - _PHASE_SHARE)
    bins[cells.level_db < AUDIBLE_LEVEL_DB] = 0.0
    densities = mixture.place_densities(table, candidates, rotation, position)
    alone = mixture.set_likelihoods(bins, densities, diffuse, np.eye(len(candidates), dtype=np.bool_))
    grid = _grid(candidates, position)
    profile = mixture.lateral_likelihoods(bins, table, diffuse)
    found = _elsewhere(grid, mixture.at_places(profile, grid, rotation, position), alone)
    places = np.concatenate([densities, mixture.place_densities(table, found, rotation, position)], axis=1)
    bands = mixture.band_starts(cells.frequencies)
    return ClipEvidence(
        len(candidates),
        HeardFrames(
            bins, places / diffuse, bands, cells.level_db >= AUDIBLE_LEVEL_DB, cells.octave_db,
            _nearness([*candidates, *found], position),
        ),
        np.log(size / size.max()) if size is not None and len(size) else np.zeros(len(candidates)),
    )  # fmt: skip


def _nearness(places: Sequence[Array], position: Array) -> Array:
    """(T, J) direct energy of a source at each place, over its geometric mean over the walk."""
    centres = np.stack([points.mean(axis=0) for points in places]) if places else np.zeros((0, 3))
    distance = np.maximum(np.linalg.norm(position[:, None] - centres, axis=2), _LEAST_DISTANCE)
    logarithm = -2 * np.log(distance)
    return np.asarray(np.exp(logarithm - logarithm.mean(axis=0)))


def _prominence(alone: Array) -> Array:
    """(K,) how much a candidate explains, with the third of the frames in which it does so most."""
    best = np.sort(alone, axis=0)[::-1]
    return np.asarray(best[: max(1, len(best) // 3)].sum(axis=0))


def _grid(candidates: Sequence[Array], position: Array) -> Array:
    """(P, 3) places around the walk and the candidates, at the candidates' mean height, clear of all of them."""
    points = np.concatenate([*candidates, position])
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    height = float(np.mean([c[:, 1].mean() for c in candidates])) if len(candidates) else float(position[:, 1].mean())
    x, z = (np.arange(low[axis], high[axis] + _SPACING, _SPACING) for axis in (0, 2))
    places = np.stack([np.repeat(x, len(z)), np.full(len(x) * len(z), height), np.tile(z, len(x))], axis=1)
    clear = np.ones(len(places), np.bool_)
    for points in candidates:
        apart = np.linalg.norm((places[:, None] - points)[:, :, [0, 2]], axis=2)
        clear &= apart.min(axis=1) > _CLEARANCE
    return places[clear]


def _elsewhere(grid: Array, scores: Array, alone: Array) -> list[Array]:
    """The best place elsewhere by itself, and the best beside the best candidate; each (1, 3).

    Args:
        grid: (P, 3) places.
        scores: (T, P) log-likelihood of each.
        alone: (T, K) log-likelihood of each candidate.
    """
    if not len(grid):
        return []
    found = [int(_prominence(scores).argmax())]
    if alone.shape[1] and len(grid) > 1:
        best = int(_prominence(alone).argmax())
        beside = np.maximum(scores - alone[:, [best]], 0.0).sum(axis=0)
        beside[found] = -1.0
        found.append(int(beside.argmax()))
    return [grid[[n]] for n in found]


def decide(evidence: ClipEvidence, weights: ActivityWeights) -> Activity:
    """The posterior, by a beam search over pools."""
    places = range(evidence.heard.places.shape[1])
    found: dict[Pool, tuple[float, Fit]] = {}

    def consider(pool: Pool) -> None:
        if pool not in found and _allowed(pool, evidence.count):
            answer = fit(
                evidence.heard, pool, bins=weights.bins, octaves=weights.octaves, on=weights.on, off=weights.off
            )
            found[pool] = _prior(pool, evidence, weights) + answer.evidence, answer

    layer: list[Pool] = [()]
    consider(())
    for _ in range(LARGEST_POOL + 1 if evidence.heard.frames.any() else 0):
        for pool in layer:
            for place in places:
                consider(tuple(sorted((*pool, place))))
        size = len(layer[0]) + 1
        grown = sorted((pool for pool in found if len(pool) == size), key=lambda pool: -found[pool][0])
        if not grown:
            break
        best = max(score for score, _ in found.values())
        margin = _HOPELESS_ALONE if size == 1 else _HOPELESS
        layer = [pool for pool in grown[:_BEAM] if found[pool][0] > best - margin]
        if not layer:
            break
    return _average(found, evidence)


def _allowed(pool: Pool, count: int) -> bool:
    away = sum(place >= count for place in pool)
    twice = max((pool.count(place) for place in pool), default=0) <= 2
    return twice and away <= _MOST_ELSEWHERE and len({p for p in pool if p < count}) <= LARGEST_POOL


def _prior(pool: Pool, evidence: ClipEvidence, weights: ActivityWeights) -> float:
    """Logarithm of the pool's prior odds to silence."""
    room = [place for place in pool if place < evidence.count]
    away = len(pool) - len(room)
    sources = len(set(room))
    louder = len(room) - sources + max(away - 1, 0)
    of_size = float(evidence.prior[list(set(room))].sum())
    return weights.source * sources + weights.elsewhere * (away > 0) + weights.louder * louder + of_size


def _average(found: dict[Pool, tuple[float, Fit]], evidence: ClipEvidence) -> Activity:
    total = logsumexp([score for score, _ in found.values()])
    posterior = np.zeros((len(evidence.heard.frames), evidence.count + 1))
    ever = np.zeros(evidence.count + 1)
    for pool, (score, answer) in found.items():
        share = float(np.exp(score - total))
        # What lies elsewhere is one, wherever; a place that is there twice is on if either of both is.
        place = np.minimum(np.array(pool, dtype=np.intp), evidence.count)
        silent = np.ones_like(posterior)
        for item, where in enumerate(place):
            silent[:, where] *= 1 - answer.on[:, item]
        posterior += share * (1 - silent)
        ever[np.unique(place)] += share
    posterior, ever = np.minimum(posterior, 1.0), np.minimum(ever, 1.0)
    return Activity(posterior[:, :-1], posterior[:, -1], ever[:-1], evidence.heard.frames)
