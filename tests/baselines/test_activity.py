"""Which candidates sound in which frames: chains in closed form, mixtures by hand, free field, silence, background."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import cells, mixture, sources_of_sound
from baselines.echosegnet.activity import ActivityWeights, infer
from baselines.echosegnet.binaural import lateral_angle, sphere_phase
from baselines.echosegnet.chains import Chains
from baselines.echosegnet.sources_of_sound import HeardFrames
from tests.baselines.test_spatial import Listener, free_field, looking

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


@settings(max_examples=25)
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


@pytest.mark.slow
@pytest.mark.parametrize("sounding", range(3))
def test_one_source_is_found_in_every_frame(sounding: int):
    walk = listeners()
    found = infer(SPOTS, *poses(walk), free_field(SPOTS[sounding][0], walk, samples=22_050))
    assert found.active[:, sounding].all()
    assert not np.delete(found.active, sounding, axis=1).any()


def around_a_sphere(source: np.ndarray, walk: list[Listener], samples: int = 22_050) -> np.ndarray:
    """Clips of noise from 100 Hz to 6 kHz with the phases of a rigid sphere."""
    frequency = np.fft.rfftfreq(samples, 1 / SAMPLE_RATE)
    used = (frequency > 100) & (frequency < 6000)
    noise = np.fft.rfft(np.random.default_rng(0).standard_normal(samples))[used]
    spectrum = np.zeros((len(walk), 2, len(frequency)), np.complex128)
    for of_one, one in zip(spectrum, walk, strict=True):
        offset = source - one.position
        phase = sphere_phase(frequency[used], [lateral_angle(offset @ one.rotation)])[0]
        of_one[:, used] = noise * np.exp(0.5j * np.stack([-phase, phase])) / np.linalg.norm(offset)
    return np.fft.irfft(spectrum, samples)


@pytest.mark.slow
@pytest.mark.parametrize("sounding", range(2))
def test_twins_near_to_each_other_are_told_apart_in_noise(sounding: int):
    """They are 0.5 m apart, 4 m away and 6 dB below diffuse noise; phases below 1.5 kHz alone take both or neither."""
    walk = listeners()
    twins = [np.array([[-0.25, -1.0, 4.0]]), np.array([[0.25, -1.0, 4.0]])]
    clips = around_a_sphere(twins[sounding][0], walk)
    noise = np.random.default_rng(1).standard_normal(clips.shape) * 2 * np.sqrt(np.mean(np.square(clips)))
    found = infer(twins, *poses(walk), clips + noise)
    assert (found.posterior[:, sounding] > 0.9).all()
    assert (found.posterior[:, 1 - sounding] < 0.1).all()


@pytest.mark.slow
def test_two_sources_at_once_are_both_found():
    walk = listeners()
    first, second = (free_field(SPOTS[k][0], walk, seed=k, samples=22_050) for k in (0, 1))
    # Sources of everyday life are sparse: in turn, each is the louder one for some milliseconds.
    turn = np.repeat(np.arange(22) % 2, 1024)[:22_050]
    found = infer(SPOTS, *poses(walk), first * (turn + 0.1) + second * (1.1 - turn))
    assert found.active[:, :2].mean() > 0.9
    assert not found.active[:, 2].any()


@pytest.mark.slow
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


def test_an_object_wins_over_the_crumbs_beside_it():
    walk = listeners()
    clips = free_field(SPOTS[0][0], walk, samples=22_050)
    beside = [SPOTS[0], SPOTS[0] + [0.03, 0.0, 0.03], SPOTS[1]]
    found = infer(beside, *poses(walk), clips, size=np.array([5000.0, 100.0, 3000.0]))
    assert found.active[:, 0].all()
    assert not found.active[:, 1:].any()
    swapped = infer(beside, *poses(walk), clips, size=np.array([100.0, 5000.0, 3000.0]))
    assert swapped.active[:, 1].mean() > 0.7
    assert not swapped.active[:, [0, 2]].any()


@pytest.mark.parametrize("size", [[1.0, 2.0], [1.0, 2.0, 0.0], [1.0, 2.0, np.nan]])
def test_sizes_are_numbers_above_0(size: list[float]):
    walk = listeners(4)
    with pytest.raises(Avs3dError, match="expected 3 finite numbers above 0"):
        infer(SPOTS, *poses(walk), np.zeros((4, 2, 22_050)), size=np.array(size))


@pytest.mark.slow
def test_a_source_that_grows_loud_is_one_source():
    """Its louder part has another spectrum, as that of an appliance that heats for a while."""
    walk = listeners(30)
    soft = free_field(SPOTS[0][0], walk, seed=1, samples=22_050)
    hum = free_field(SPOTS[0][0], walk, seed=2, samples=22_050)
    hum = lfilter([0.02], [1, -0.98], hum, axis=-1) * 20
    hum[:10], hum[20:] = 0, 0
    found = infer(SPOTS, *poses(walk), soft + 3 * hum)
    assert found.active[:, 0].all()
    assert not found.active[:, 1:].any()


@pytest.mark.parametrize("seed", range(3))
def test_mixtures_are_those_of_the_formula(seed: int):
    """p = (s_0 + Σ s_k·n_k·A_k) / (s_0 + Σ s_k·n_k) in every cell, over that of diffuse sound."""
    rng = np.random.default_rng(seed)
    frames, places, bands, width = 5, 3, 4, 6
    heard = HeardFrames(
        weights=rng.uniform(0.05, 1.0, (frames, bands * width)) * (rng.random((frames, bands * width)) > 0.3),
        places=rng.uniform(0.1, 3.0, (frames, places, bands * width)),
        bands=np.arange(bands) * width,
        frames=np.ones(frames, np.bool_),
        octave_db=np.full((frames, 7), -30.0),
        nearness=rng.uniform(0.3, 3.0, (frames, places)),
    )
    states = np.array(list(itertools.product((False, True), repeat=2)))
    share = rng.dirichlet(np.ones(3), bands).T
    pool = (2, 0)
    found = sources_of_sound._sets(heard.of(pool), states, share)
    band = np.repeat(np.arange(bands), width)
    for s, state in enumerate(states):
        part = share[1:, band] * (state[:, None] * heard.nearness[:, list(pool)][:, :, None]).transpose(0, 1, 2)
        mixed = share[0, band] + (part * heard.places[:, list(pool)]).sum(axis=1)
        expected = (heard.weights * np.log(mixed / (share[0, band] + part.sum(axis=1)))).sum(axis=1)
        np.testing.assert_allclose(found[:, s], expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_every_step_of_the_shares_raises_the_likelihood(seed: int):
    rng = np.random.default_rng(seed)
    frames, places, bands, width = 6, 2, 3, 8
    heard = HeardFrames(
        weights=rng.random((frames, bands * width)),
        places=rng.uniform(0.1, 3.0, (frames, places, bands * width)),
        bands=np.arange(bands) * width,
        frames=np.ones(frames, np.bool_),
        octave_db=np.full((frames, 7), -30.0),
        nearness=rng.uniform(0.3, 3.0, (frames, places)),
    )
    states = np.array(list(itertools.product((False, True), repeat=2)))
    probability = rng.dirichlet(np.ones(4), frames)
    share = np.full((3, bands), 1 / 3)
    before = -np.inf
    for _ in range(20):
        value = float((probability * sources_of_sound._sets(heard.of((0, 1)), states, share)).sum())
        assert value >= before - 1e-6
        before = value
        share = sources_of_sound._counts(heard.of((0, 1)), states, share, probability, 1e-9)
        share /= share.sum(axis=0)
