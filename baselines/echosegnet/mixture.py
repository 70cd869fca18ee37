"""Likelihood of a clip's cells for every set of sources that may have sounded in it.

Each time–frequency bin is dominated by one component (`cells`): by a source at one of the places, whose cues follow
from its lateral angle, or by diffuse sound, which comes from everywhere: reverberation, background noise, anything
else. With the densities A of the cues (in the cell's band) a set S of places has, in one clip,

    ℓ(S) = max over π of Σ_cells weight · ln(π_0·D(cell) + Σ_{k ∈ S} π_k·A_k(cell)),     π ≥ 0, Σ π = 1,

found with expectation maximisation (Mandel, Weiss, Ellis 2010). The densities:

- direct sound: von Mises around the phase of a rigid sphere (`binaural.sphere_phase`), and a normal distribution
  around the level difference of Brown and Duda's head, compressed by `ILD_GAIN`, because every bin of a room holds
  reflections;
- diffuse sound: von Mises around 0 with the coherence sin(kd)/(kd) of a diffuse field at two points (R. K. Cook et al.,
  JASA 27 (1955) 1072), and a normal distribution around 0 dB.

A source anywhere on an object sounds as a mixture over points spread over it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from baselines.echosegnet import binaural
from baselines.echosegnet.cells import FIRST_OCTAVE, ILD_LEVELS, PHASE_LEVELS, Cells

Array = NDArray[np.float64]

#: Lateral angles at which the densities are tabulated (radians).
_GRID = np.radians(np.arange(-90.0, 91.0, 3.0))
#: Concentration of a bin's phase around that of the direct sound that dominates it.
PHASE_CONCENTRATION = 3.0
#: Level difference of a bin over that of the direct sound alone, and its standard deviation (dB).
ILD_GAIN, ILD_DEVIATION = 0.4, 4.0
#: Standard deviation of the level difference of diffuse sound (dB).
DIFFUSE_ILD_DEVIATION = 3.0
#: Distance of the ears along the path round the head, over its diameter: what the diffuse coherence of a head fits.
_EAR_PATH = 1.2
#: Largest concentration of diffuse phases; share of each density that is uniform, for what no component explains.
_LARGEST_CONCENTRATION, _UNIFORM = 8.0, 0.03
#: Steps of the expectation maximisation; least share of a component.
_STEPS, _LEAST_SHARE = 12, 0.005

_PHASES = -np.pi + (np.arange(PHASE_LEVELS) + 0.5) * 2 * np.pi / PHASE_LEVELS


def _density(logarithm: Array) -> Array:
    """The distribution over the last axis, with a uniform share."""
    value = np.exp(logarithm - logarithm.max(axis=-1, keepdims=True))
    value /= value.sum(axis=-1, keepdims=True)
    return np.asarray((1 - _UNIFORM) * value + _UNIFORM / value.shape[-1])


def direct_table(frequencies: Array) -> Array:
    """(G, C) density of each cell within its band for direct sound from each lateral angle of the grid."""
    phase = binaural.sphere_phase(frequencies, _GRID)
    phases = _density(PHASE_CONCENTRATION * np.cos(_PHASES - phase[..., None]))
    ild = ILD_GAIN * binaural.head_shadow_ild(_GRID)[:, FIRST_OCTAVE:, None]
    ilds = _density(-0.5 * np.square((ILD_LEVELS - ild) / ILD_DEVIATION))
    return np.concatenate([phases.reshape(len(_GRID), -1), ilds.reshape(len(_GRID), -1)], axis=1)


def diffuse_density(frequencies: Array) -> Array:
    """(C,) density of each cell within its band for diffuse sound."""
    spacing = 2 * binaural.HEAD_RADIUS * _EAR_PATH
    coherence = np.abs(np.sinc(2 * frequencies * spacing / binaural.SPEED_OF_SOUND))
    kappa = np.minimum(coherence * (2 - coherence**2) / np.maximum(1 - coherence**2, 0.05), _LARGEST_CONCENTRATION)
    phases = _density(kappa[:, None] * np.cos(_PHASES))
    bands = len(binaural.OCTAVE_EDGES) - 1 - FIRST_OCTAVE
    ilds = np.tile(_density(-0.5 * np.square(ILD_LEVELS / DIFFUSE_ILD_DEVIATION)), (bands, 1))
    return np.concatenate([phases.ravel(), ilds.ravel()])


def place_densities(table: Array, places: Sequence[Array], rotation: Array, position: Array) -> Array:
    """(T, K, C) density of the cells for a source somewhere on each of K objects.

    Args:
        table: from `direct_table`.
        places: K arrays of points (P, 3), metres.
        rotation: (T, 3, 3) camera-to-world, OpenCV axes.
        position: (T, 3) metres.
    """
    out = np.empty((len(position), len(places), table.shape[1]))
    for k, points in enumerate(places):
        lateral = binaural.lateral_angle(np.einsum("tpi,tij->tpj", points - position[:, None], rotation))
        at = (lateral - _GRID[0]) / (_GRID[1] - _GRID[0])
        low = np.clip(at.astype(np.intp), 0, len(_GRID) - 2)
        # The share of each grid angle among the points of the object: a small matrix instead of a large average.
        share = np.zeros((len(position), len(_GRID)))
        rows = np.arange(len(position))[:, None]
        np.add.at(share, (rows, low), (1 - (at - low)) / len(points))
        np.add.at(share, (rows, low + 1), (at - low) / len(points))
        out[:, k] = share @ table
    return out


def lateral_likelihoods(weights: Array, table: Array, diffuse: Array) -> Array:
    """(T, G) log-likelihood of one source at each lateral angle of the grid over that of diffuse sound alone."""
    out = np.zeros((len(weights), len(table)))
    for t, weight in enumerate(weights):
        used = weight > 0
        if not used.any():
            continue
        w, ratio = weight[used], table[:, used] / diffuse[used] - 1.0
        share = np.full((len(table), 1), 0.5)
        for _ in range(_STEPS):
            share = np.clip(share * ((1 + ratio) / (1 + share * ratio)) @ w[:, None] / w.sum(), _LEAST_SHARE, 0.995)
        out[t] = np.log1p(share * ratio) @ w
    return np.maximum(out, 0.0)


def at_places(profile: Array, places: Array, rotation: Array, position: Array) -> Array:
    """(T, P) the values of a profile (T, G) over lateral angles at the angles of places (P, 3)."""
    lateral = binaural.lateral_angle(np.einsum("tpi,tij->tpj", places - position[:, None], rotation))
    at = (lateral - _GRID[0]) / (_GRID[1] - _GRID[0])
    low = np.clip(at.astype(np.intp), 0, len(_GRID) - 2)
    rows = np.arange(len(position))[:, None]
    return np.asarray((1 - (at - low)) * profile[rows, low] + (at - low) * profile[rows, low + 1])


def set_likelihoods(weights: Array, places: Array, diffuse: Array, sets: NDArray[np.bool_]) -> Array:
    """(T, S) log-likelihood of each set of places over that of diffuse sound alone, at least 0.

    Args:
        weights: (T, C) of the cells, scaled to the effective number of independent bins.
        places: (T, K, C) from `place_densities`.
        diffuse: (C,).
        sets: (S, K) which places are in a set.
    """
    out = np.zeros((len(weights), len(sets)))
    member = np.concatenate([np.ones((len(sets), 1), np.bool_), sets], axis=1)
    for t, weight in enumerate(weights):
        used = weight > 0
        if not used.any():
            continue
        w = weight[used]
        density = np.concatenate([diffuse[None, used], places[t][:, used]])
        share = member / member.sum(axis=1, keepdims=True)
        for _ in range(_STEPS):
            count = share * ((w / (share @ density)) @ density.T)
            share = np.maximum(count / w.sum(), _LEAST_SHARE) * member
            share /= share.sum(axis=1, keepdims=True)
        out[t] = np.log(share @ density) @ w - np.log(density[0]) @ w
    return np.maximum(out, 0.0)


def band_starts(frequencies: Array) -> NDArray[np.intp]:
    """(bands,) index of the first cell of each band: of each phase's bin, then of each octave of level differences."""
    phases = np.arange(len(frequencies)) * PHASE_LEVELS
    octaves = len(binaural.OCTAVE_EDGES) - 1 - FIRST_OCTAVE
    return np.concatenate([phases, len(frequencies) * PHASE_LEVELS + np.arange(octaves) * len(ILD_LEVELS)])


def cell_weights(cells: Cells, phase: float, ild: float) -> Array:
    """(T, C) the cells' weights, scaled to ``phase`` and ``ild`` effective independent bins per clip."""
    return np.concatenate(
        [phase * cells.phase.reshape(len(cells), -1), ild * cells.ild.reshape(len(cells), -1)], axis=1
    )
