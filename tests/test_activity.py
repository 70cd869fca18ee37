"""Which candidates sound in which frames: chains in closed form, mixtures by hand, free field, silence, background."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_spatial import Listener, free_field, looking

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import cells, mixture
from baselines.echosegnet.activity import ActivityWeights, infer
from baselines.echosegnet.chains import Chains

SPOTS = [np.array([[2.0, -0.9, 1.0]]), np.array([[-1.8, -0.5, 2.0]]), np.array([[0.3, -1.0, -2.5]])]


def listeners(count: int = 16, seed: int = 0) -> list[Listener]:
    rng = np.random.default_rng(seed)
    yaw = np.cumsum(rng.uniform(-1, 1, count)) + rng.uniform(0, 6)
    place = np.stack([rng.uniform(-1, 1, count), np.full(count, -1.5), rng.uniform(-1, 1, count)], axis=1)
    return [Listener(f"frame_{i:03d}", looking(yaw[i]), place[i]) for i in range(count)]


def poses(walk: list[Listener]) -> tuple[np.ndarray, np.ndarray]:
    return np.stack([one.rotation for one in walk]), np.stack([one.position for one in walk])


def test_the_chain_is_the_sum_over_all_paths():
    rng = np.random.default_rng(1)
    chains = Chains(2, 0.2, 0.4)
    emission = rng.normal(size=(3, 4))
    total, marginal = 0.0, np.zeros((3, 4))
    for path in itertools.product(range(4), repeat=3):
        probability = 1.0
        for t, state in enumerate(path):
            probability *= np.exp(emission[t, state])
            for k in range(2):
                now = chains.states[state][k]
                if t == 0:
                    probability *= 0.5
                elif chains.states[path[t - 1]][k]:
                    probability *= 0.6 if now else 0.4
                else:
                    probability *= 0.2 if now else 0.8
        total += probability
        for t, state in enumerate(path):
            marginal[t, state] += probability
    assert chains.evidence(emission[:, :, None])[0] == pytest.approx(np.log(total))
    np.testing.assert_allclose(chains.posterior(emission), marginal / total, atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 3))
def test_posteriors_of_chains_are_probabilities(seed: int, count: int):
    emission = np.random.default_rng(seed).normal(scale=20, size=(9, 2**count))
    posterior = Chains(count, 0.05, 0.1).posterior(emission)
    assert (posterior >= 0).all()
    np.testing.assert_allclose(posterior.sum(axis=1), 1)


def test_the_likelihood_of_sets_by_hand():
    # Two cells of one band: the place has densities (0.9, 0.1), diffuse sound (0.5, 0.5); all weight in the first cell.
    weights, places = np.array([[1.0, 0.0]]), np.array([[[0.9, 0.1]]])
    found = mixture.set_likelihoods(weights, places, np.array([0.5, 0.5]), np.array([[False], [True]]))
    assert found[0, 0] == 0
    assert found[0, 1] == pytest.approx(np.log(0.9 / 0.5), abs=0.02)  # the share of diffuse sound is kept above 0


def test_cells_of_a_clip_weigh_one_and_silence_nothing():
    walk = listeners(4)
    clips = free_field(SPOTS[0][0], walk)
    clips[2] = 0
    found = cells.observe(clips)
    np.testing.assert_allclose(found.phase.sum(axis=(1, 2)), [1, 1, 0, 1])
    np.testing.assert_allclose(found.ild.sum(axis=(1, 2)), [1, 1, 0, 1])
    assert found.level_db[2] == -np.inf
    power = np.mean(np.square(clips[0], dtype=np.float64))
    assert found.level_db[0] == pytest.approx(10 * np.log10(power))


@pytest.mark.parametrize("sounding", range(3))
def test_one_source_is_found_in_every_frame(sounding: int):
    walk = listeners()
    found = infer(SPOTS, *poses(walk), free_field(SPOTS[sounding][0], walk, samples=22_050))
    assert found.active[:, sounding].all()
    assert not np.delete(found.active, sounding, axis=1).any()


def test_two_sources_at_once_are_both_found():
    walk = listeners()
    first, second = (free_field(SPOTS[k][0], walk, seed=k, samples=22_050) for k in (0, 1))
    # Sources of everyday life are sparse: in turn, each is the louder one for some milliseconds.
    turn = np.repeat(np.arange(22) % 2, 1024)[:22_050]
    found = infer(SPOTS, *poses(walk), first * (turn + 0.1) + second * (1.1 - turn))
    assert found.active[:, :2].mean() > 0.9
    assert not found.active[:, 2].any()


def test_each_frame_has_the_source_that_sounds_in_it():
    walk = listeners(24)
    first, second = (free_field(SPOTS[k][0], walk, seed=k, samples=22_050) for k in (0, 1))
    first[12:], second[:12] = 0, 0
    truth = np.zeros((24, 3), np.bool_)
    truth[:12, 0] = truth[12:, 1] = True
    found = infer(SPOTS, *poses(walk), first + second)
    assert (found.active == truth).all(axis=1).mean() > 0.9


def test_silence_and_what_is_too_quiet_mark_nothing():
    walk = listeners()
    clips = free_field(SPOTS[0][0], walk)
    for quiet in (0.0 * clips, 1e-4 * clips):
        found = infer(SPOTS, *poses(walk), quiet)
        assert not found.posterior.any()
        assert not found.heard.any()


def test_a_constant_background_marks_nothing():
    walk = listeners()
    noise = 0.01 * np.random.default_rng(3).standard_normal((16, 2, 44_100)).astype(np.float32)
    found = infer(SPOTS, *poses(walk), noise)
    assert not found.active.any()


def test_a_source_elsewhere_marks_nothing():
    walk = listeners(24)
    found = infer(SPOTS, *poses(walk), free_field(np.array([-3.5, -1.0, -3.0]), walk, samples=22_050))
    assert found.active.mean() < 0.1
    assert found.elsewhere.mean() > 0.8


def test_bad_input_is_said_in_one_line():
    walk = listeners(3)
    clips = free_field(SPOTS[0][0], walk)
    with pytest.raises(Avs3dError, match="2 clips for 3 poses"):
        infer(SPOTS, *poses(walk), clips[:2])
    with pytest.raises(Avs3dError, match="candidate 1: points"):
        infer([SPOTS[0], np.full((1, 3), np.nan)], *poses(walk), clips)
    with pytest.raises(Avs3dError, match="probabilities between 0 and 1"):
        ActivityWeights(on=0.0)
    clips[1, 0, 5] = np.nan
    with pytest.raises(Avs3dError, match="clip 1 holds NaN"):
        infer(SPOTS, *poses(walk), clips)
