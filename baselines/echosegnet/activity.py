"""Which of several candidates sound in which frames of a sound scene, or that none of them does.

`spatial` asks which one candidate always sounds. Here any number may sound, each from time to time, and the sound may
come from none of them: from another room, or from everywhere. The answer is a posterior over hypotheses of this kind:

- A *pool* of sources: up to `LARGEST_POOL` of the candidates, and at most one source *elsewhere*, at a place without a
  candidate that is found in the sound itself (a door through which another room is heard, an object that nobody
  marked). Beside it there may be a diffuse *background* of constant level. Each has a prior probability.
- Every source of the pool is on or off in each frame: a Markov chain of its own, because programmes last for seconds.
- The frame's clip, given the set that is on, has the likelihood of `mixture`: each time–frequency bin is dominated by
  one of the sources, in the direction in which it lies from that pose, or by diffuse sound. A clip that is all but
  silent needs an empty set. One that is not needs a source, or a background of its level.

All pools are compared by the forward algorithm (L. R. Rabiner, Proc. IEEE 77 (1989) 257), so that the evidence for a
source that stays where it is adds up over all frames; the posterior of each frame is that of the forward–backward
algorithm, averaged over the pools. Neighbouring bins hear the same reflections: `ActivityWeights` temper the likelihood
to an effective number of independent bins, chosen by cross-entropy on homes that nothing is reported on
(`benchmarks/listen_choice.py`), lest the posterior be too sure.

The clips of test frames are inputs of the task as their pictures are; no truth is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from avs3d_bench.errors import Avs3dError
from avs3d_bench.schema import AUDIBLE_LEVEL_DB
from baselines.echosegnet import binaural, mixture
from baselines.echosegnet import cells as cells_of
from baselines.echosegnet.cells import Cells
from baselines.echosegnet.chains import Chains

Array = NDArray[np.float64]

#: Most candidates that sound in one observation.
LARGEST_POOL = 4
#: Candidates that are considered in sets: the likeliest ones by themselves.
_SHORTLIST = 6
#: Grid of places elsewhere: spacing, margin around the walk and the candidates, distance from all candidates (m).
_SPACING, _MARGIN, _CLEARANCE = 0.4, 1.5, 0.6
#: Share of the phases in a frame's effective bins; the rest are level differences.
_PHASE_SHARE = 0.75
#: Posterior from which on a candidate is marked.
DECIDED = 0.5


@dataclass(frozen=True)
class ActivityWeights:
    """How much each kind of evidence counts.

    Attributes:
        bins: effective number of independent time–frequency bins per frame.
        source: natural logarithm of the prior odds of one more source in the pool.
        elsewhere: the same of a source elsewhere.
        background: the same of a background, at one of the levels tried.
        on, off: probability that a source of the pool starts, and stops, between two frames.
        steadiness: effective number of independent octaves in which a background is told by its constant level.
    """

    bins: float = 16.0
    source: float = -3.0
    elsewhere: float = -10.0
    background: float = -2.0
    on: float = 0.1
    off: float = 0.1
    steadiness: float = 3.0

    def __post_init__(self) -> None:
        numbers = (self.bins, self.steadiness)
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
    weights: ActivityWeights | None = None,
) -> Activity:
    """Infer which candidates sound in which frames.

    Args:
        candidates: K arrays (P, 3) of points spread over each, metres, OpenCV world of the poses.
        rotation: (T, 3, 3) camera-to-world of all frames in the order of time.
        position: (T, 3) metres.
        clips: (T, 2, n) their sound at 44.1 kHz, channel 0 left.
        weights: of the evidence.

    Raises:
        Avs3dError: if shapes do not fit or a number is NaN or infinite.
    """
    return judge(candidates, rotation, position, cells_of.observe(clips), weights=weights)


def judge(
    candidates: Sequence[Array],
    rotation: Array,
    position: Array,
    cells: Cells,
    *,
    weights: ActivityWeights | None = None,
) -> Activity:
    """`infer` with the cells already read."""
    weights = weights or ActivityWeights()
    if not len(cells) == len(rotation) == len(position):
        raise Avs3dError(f"{len(cells)} clips for {len(rotation)} poses: expected one each")
    return decide(gather(candidates, rotation, position, cells), weights)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the clips say for every set of places.

    Attributes:
        count: number of candidates, K.
        shortlist: indices of the candidates that occur in sets; places from len(shortlist) on are elsewhere.
        sets: places of each set, in the order of the columns of ``likelihood``; the first is empty.
        likelihood: (T, S) log-likelihood over that of diffuse sound alone, of one effective bin.
        level_db: (T,) RMS level, dB re full scale.
        octave_db: (T, B) the same in octaves.
    """

    count: int
    shortlist: tuple[int, ...]
    sets: tuple[tuple[int, ...], ...]
    likelihood: Array
    level_db: Array
    octave_db: Array


def gather(candidates: Sequence[Array], rotation: Array, position: Array, cells: Cells) -> Evidence:
    """The likelihoods of all sets of the shortlist and of places elsewhere."""
    for number, points in enumerate(candidates):
        if points.ndim != 2 or points.shape[1] != 3 or not len(points) or not np.isfinite(points).all():
            raise Avs3dError(f"candidate {number}: points {points.shape}, expected (P, 3) finite metres, P ≥ 1")
    table = mixture.direct_table(cells.frequencies)
    diffuse = mixture.diffuse_density(cells.frequencies)
    bins = mixture.cell_weights(cells, _PHASE_SHARE, 1 - _PHASE_SHARE)
    bins[cells.level_db < AUDIBLE_LEVEL_DB] = 0.0
    densities = mixture.place_densities(table, candidates, rotation, position)
    alone = mixture.set_likelihoods(bins, densities, diffuse, np.eye(len(candidates), dtype=np.bool_))
    shortlist = tuple(sorted(np.argsort(-_prominence(alone), kind="stable")[:_SHORTLIST].tolist()))
    grid = _grid(candidates, position)
    profile = mixture.lateral_likelihoods(bins, table, diffuse)
    found = _elsewhere(grid, mixture.at_places(profile, grid, rotation, position), alone)
    places = np.concatenate(
        [densities[:, shortlist], mixture.place_densities(table, found, rotation, position)], axis=1
    )
    sets = tuple(_sets(len(shortlist), len(found)))
    member = np.zeros((len(sets), places.shape[1]), np.bool_)
    for row, chosen in enumerate(sets):
        member[row, list(chosen)] = True
    likelihood = mixture.set_likelihoods(bins, places, diffuse, member)
    return Evidence(len(candidates), shortlist, sets, likelihood, cells.level_db, cells.octave_db)


def _prominence(alone: Array) -> Array:
    """(K,) how much a candidate explains, with the third of the frames in which it does so most."""
    best = np.sort(alone, axis=0)[::-1]
    return np.asarray(best[: max(1, len(best) // 3)].sum(axis=0))


def _sets(candidates: int, elsewhere: int) -> list[tuple[int, ...]]:
    """All sets of up to `LARGEST_POOL` candidates, each without and with one of the places elsewhere."""
    sets = [chosen for size in range(LARGEST_POOL + 1) for chosen in combinations(range(candidates), size)]
    return sets + [(*chosen, candidates + place) for place in range(elsewhere) for chosen in sets]


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


def decide(evidence: Evidence, weights: ActivityWeights) -> Activity:
    """The posterior, given the likelihoods of the sets."""
    heard = evidence.level_db >= AUDIBLE_LEVEL_DB
    frames, local = len(heard), len(evidence.shortlist)
    column = {chosen: n for n, chosen in enumerate(evidence.sets)}
    backgrounds = _backgrounds(evidence.level_db, evidence.octave_db, heard)
    empty = _empty_set(evidence.octave_db, heard, backgrounds, weights.steadiness)
    levels = backgrounds
    prior_empty = np.concatenate([[0.0], np.full(len(levels), weights.background - np.log(max(1, len(levels))))])
    found: list[tuple[Array, tuple[int, ...], Chains, Array]] = []
    for pool in evidence.sets:
        chains = Chains(len(pool), weights.on, weights.off)
        emission = np.empty((frames, len(chains.states)))
        for state, on in enumerate(chains.states):
            chosen = tuple(p for p, sounds in zip(pool, on, strict=True) if sounds)
            emission[:, state] = np.where(
                heard, weights.bins * evidence.likelihood[:, column[chosen]], _UNLIKELY if chosen else 0.0
            )
        elsewhere = bool(pool) and pool[-1] >= local
        prior = weights.source * (len(pool) - elsewhere) + weights.elsewhere * elsewhere
        found.append((prior + prior_empty, pool, chains, emission))
    return _average(found, empty, evidence, heard)


#: Log-likelihood of a source that is on in silence, and of sound without a source or a background.
_UNLIKELY = -30.0
#: Spacing of the levels of a background that are tried (dB), and how far frames of one level may differ from it.
_LEVEL_STEP, _LEVEL_WIDTH = 1.0, 1.0
#: Level of an octave of stationary Gaussian noise of bandwidth B in T seconds: its standard deviation is 4.34/√(BT) dB
#: (J. S. Bendat, A. G. Piersol, *Random Data*, Wiley 2010, §8.2); what no background falls below.
_NOISE_DB, _LEAST_ERROR = 10 / np.log(10), 0.15
#: Deviation of the level of an octave from that spectrum in frames that hold something else (dB).
_SOURCE_ERROR = 3.0
#: Octaves this far below the loudest do not count (dB).
_OCTAVE_FLOOR = 50.0


def _backgrounds(level_db: Array, octave_db: Array, heard: NDArray[np.bool_]) -> Array:
    """(L, B) spectra in octaves that a background may have: medians over the frames of about the same level."""
    found = []
    if heard.any():
        for level in np.arange(level_db[heard].min(), level_db[heard].max() + _LEVEL_STEP, _LEVEL_STEP):
            near = heard & (np.abs(level_db - level) <= _LEVEL_WIDTH)
            if near.any():
                found.append(np.median(octave_db[near], axis=0))
    return np.array(found).reshape(len(found), octave_db.shape[1])


def _empty_set(octave_db: Array, heard: NDArray[np.bool_], backgrounds: Array, steadiness: float) -> Array:
    """(T, 1 + L) log-likelihood of the levels if nothing is on, over that if something is: no, and each background.

    Without a background, a clip that is not silent has a source. A background has the same spectrum in all frames.
    """
    out = np.zeros((len(octave_db), 1 + len(backgrounds)))
    out[heard, 0] = _UNLIKELY
    for n, spectrum in enumerate(backgrounds, start=1):
        used = np.isfinite(spectrum) & (spectrum >= spectrum.max() - _OCTAVE_FLOOR)
        error = np.maximum(octave_db[heard][:, used], -200.0) - spectrum[used]
        steady = np.hypot(_NOISE_DB / np.sqrt(np.diff(binaural.OCTAVE_EDGES)), _LEAST_ERROR)[used]
        ratio = _student(error / steady) - _student(error / _SOURCE_ERROR) + np.log(_SOURCE_ERROR / steady)
        out[heard, n] = np.maximum(steadiness * ratio.mean(axis=1), _UNLIKELY)
    return out


def _student(error: Array) -> Array:
    """Logarithm of Student's t density, 4 degrees of freedom, without its constant."""
    return np.asarray(-2.5 * np.log1p(np.square(error) / 4))


def _average(
    found: list[tuple[Array, tuple[int, ...], Chains, Array]],
    empty: Array,
    evidence: Evidence,
    heard: NDArray[np.bool_],
) -> Activity:
    scores = []
    for prior, _, chains, emission in found:
        scores.append(prior + chains.evidence(_with(emission, empty)))
    total = logsumexp(np.concatenate(scores))
    posterior = np.zeros((len(heard), evidence.count))
    elsewhere, ever = np.zeros(len(heard)), np.zeros(evidence.count)
    for score, (_, pool, chains, emission) in zip(scores, found, strict=True):
        for hypothesis in np.flatnonzero(score > total - _NEGLIGIBLE):
            share = float(np.exp(score[hypothesis] - total))
            on = chains.smooth(_with(emission, empty[:, [hypothesis]])[:, :, 0])
            for item, place in enumerate(pool):
                if place < len(evidence.shortlist):
                    posterior[:, evidence.shortlist[place]] += share * on[:, item]
                    ever[evidence.shortlist[place]] += share
                else:
                    elsewhere += share * on[:, item]
    return Activity(np.minimum(posterior, 1.0), np.minimum(elsewhere, 1.0), np.minimum(ever, 1.0), heard)


#: Hypotheses whose posterior is less than exp(−this) do not count.
_NEGLIGIBLE = 7.0


def _with(emission: Array, empty: Array) -> Array:
    """(T, states, H) emissions under each of H hypotheses on the background; the first state is the empty set."""
    out = np.repeat(emission[:, :, None], empty.shape[1], axis=2)
    out[:, 0, :] += empty
    return out
