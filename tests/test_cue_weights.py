"""The choice of the weights of the spatial cues: the data collected from a dataset, and the minimised loss."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baselines.echosegnet.spatial import CueWeights, gather, judge
from benchmarks.cue_weights import Trial, cross_entropy, load, save
from benchmarks.instance_selection import simulated


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    out = []
    for seed in range(3):
        heard, (case,) = simulated(seed, 1.0, count=24)
        labels = np.repeat(np.arange(len(case.candidates)), [len(c) for c in case.candidates])
        points = np.concatenate(case.candidates)
        evidence = gather(points, labels, heard.rotation, heard.position, heard.cues)
        weights = CueWeights(phase=1.5, ild=0.1, level=0.2)
        choice = judge(points, labels, heard.rotation, heard.position, heard.cues, weights=weights)
        np.testing.assert_allclose(evidence.weigh(weights)[1], choice.posterior, rtol=1e-12)
        out.append(Trial(f"room {seed}", case.experiment, 1.0, evidence))
    return out


@pytest.mark.slow
def test_trials_come_back_as_they_were_saved(trials: list[Trial], tmp_path: Path) -> None:
    save(trials, tmp_path / "trials.npz")
    back = load(tmp_path / "trials.npz")
    assert [(t.key, t.experiment, t.share) for t in back] == [(t.key, t.experiment, t.share) for t in trials]
    for weights in (CueWeights(), CueWeights(phase=0.5, ild=0.3, level=0.0)):
        for was, now in zip(trials, back, strict=True):
            np.testing.assert_allclose(now.evidence.weigh(weights)[1], was.evidence.weigh(weights)[1], atol=1e-4)


def test_weights_of_nothing_leave_the_prior(trials: list[Trial]) -> None:
    """Without any cue the posterior is a cluster's share of the points: the cross-entropy has a closed form."""
    shares = [trial.evidence.count[0] / trial.evidence.count.sum() for trial in trials]
    assert cross_entropy(trials, CueWeights(0.0, 0.0, 0.0)) == pytest.approx(float(-np.log(shares).mean()))
    assert cross_entropy(trials, CueWeights()) < 0.5 * cross_entropy(trials, CueWeights(0.0, 0.0, 0.0))


def test_every_observation_counts_once(trials: list[Trial]) -> None:
    weights = CueWeights(phase=0.5, ild=0.0, level=0.0)
    alone = [cross_entropy([trial], weights) for trial in trials]
    assert cross_entropy([*trials, trials[0], trials[0]], weights) == pytest.approx(float(np.mean(alone)))
