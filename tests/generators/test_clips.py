"""Clips: the source's past, the leak-free two-second window, levels; and reverberation times."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.contract.layout import MONO_SAMPLES, is_test
from avs3d_bench.errors import Avs3dError
from avs3d_bench.measures.decay import decay_curve, eyring, reverberation_time, t30
from avs3d_bench.measures.levels import ild_db
from generators.acoustics.clips import (
    GAIN,
    binaural_clip,
    check_clip,
    joined,
    mono_clip,
    mono_window,
    moving_clip,
    receiver_clip,
    rms,
)

SR = 44_100
RNG = np.random.default_rng(7)


def test_clip_is_the_second_of_the_whole_convolution_with_its_past():
    rate = 400
    source, response = RNG.standard_normal(10 * rate), RNG.standard_normal((2, 3 * rate))
    for index in (0, 1, 5, 9):
        whole = np.stack([np.convolve(source, h)[index * rate : (index + 1) * rate] for h in response])
        clip = binaural_clip(source, response, index, rate)
        assert clip.dtype == np.float32
        np.testing.assert_allclose(clip, GAIN * whole, atol=1e-5)


def test_the_tail_is_what_the_same_pose_hears_next():
    rate = 400
    source, response = RNG.standard_normal(4 * rate), RNG.standard_normal((2, rate))
    longer = receiver_clip(source, response, 1, rate, tail=30)
    assert longer.shape == (2, rate + 30)
    np.testing.assert_allclose(longer[:, :rate], receiver_clip(source, response, 1, rate), atol=1e-5)
    np.testing.assert_allclose(longer[:, rate:], receiver_clip(source, response, 2, rate)[:, :30], atol=1e-5)
    # Of a moving source that in truth stands still, and where the source has ended: silence is all that follows.
    still = moving_clip(source, [response] * 3, [2.0] * 3, 1, rate, tail=30)
    np.testing.assert_allclose(still, longer, atol=1e-5)
    last = receiver_clip(source, response, 3, rate, tail=30)
    ended = np.stack([np.convolve(source, h)[4 * rate : 4 * rate + 30] for h in response])
    np.testing.assert_allclose(last[:, rate:], GAIN * ended, atol=1e-5)


def test_a_joined_clip_goes_from_the_pose_before_to_its_own():
    clip, before = (RNG.standard_normal((2, size)).astype(np.float32) for size in (50, 21))
    found = joined(clip, before)
    assert (found.dtype, found.shape) == (np.float32, clip.shape)
    np.testing.assert_array_equal(found[:, 21:], clip[:, 21:])
    np.testing.assert_allclose(found[:, 10], (clip + np.pad(before, ((0, 0), (0, 29))))[:, 10] / 2, rtol=1e-6)
    np.testing.assert_allclose(found[:, 0], before[:, 0], atol=0.02)  # sin²(π / 84) of the way
    np.testing.assert_allclose(joined(clip, clip[:, :21]), clip, rtol=1e-6)  # poses that hear alike


def test_reverberation_of_the_second_before_is_there():
    source = np.zeros(3 * SR)
    source[SR - 10] = 1.0
    response = np.zeros((2, SR // 2))
    response[:, 100] = 0.5
    clip = binaural_clip(source, response, 1, gain=1.0)
    assert clip[0, 90] == pytest.approx(0.5)
    assert np.abs(clip).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("source", "response", "index", "message"),
    [
        (np.zeros(SR), np.zeros((2, 10)), 1, "has 44100 samples, expected at least 88200"),
        (np.zeros(SR), np.zeros((2, 10)), -1, "expected at least"),
        (np.zeros((2, SR)), np.zeros((2, 10)), 0, r"expected \(n,\) and \(channels, m\)"),
        (np.zeros(SR), np.zeros((2, 0)), 0, r"expected \(n,\) and \(channels, m\)"),
        (np.zeros(SR), np.zeros((4, 10)), 0, r"expected \(2, m\) of two ears"),
        (np.full(SR, np.nan), np.zeros((2, 10)), 0, "NaN"),
        (np.zeros(SR), np.full((2, 10), np.inf), 0, "NaN or infinite"),
    ],
)
def test_bad_input_of_a_clip_is_named(source, response, index, message):
    with pytest.raises(Avs3dError, match=message):
        binaural_clip(source, response, index)


def test_window_in_the_middle_beside_a_test_frame_and_at_the_ends():
    assert mono_window(4, 120) == [(3, 22_050, SR), (4, 0, SR), (5, 0, 22_050)]
    assert mono_window(7, 120) == [(6, 0, SR), (7, 0, SR)]
    assert mono_window(9, 120) == [(9, 0, SR), (10, 0, SR)]
    assert mono_window(8, 120) == [(7, 22_050, SR), (8, 0, SR), (9, 0, 22_050)]
    assert mono_window(0, 120) == [(0, 0, SR), (1, 0, SR)]
    assert mono_window(119, 120) == [(118, 0, SR), (119, 0, SR)]
    assert mono_window(1, 2) == [(1, 22_050, SR), (1, 0, SR), (1, 0, 22_050)]
    assert mono_window(0, 1) == [(0, 22_050, SR), (0, 0, SR), (0, 0, 22_050)]


@given(st.integers(1, 200).flatmap(lambda count: st.tuples(st.integers(0, count - 1), st.just(count))))
def test_window_is_whole_leak_free_and_contiguous(case):
    index, count = case
    pieces = mono_window(index, count)
    assert sum(stop - start for _, start, stop in pieces) == MONO_SAMPLES
    assert (index, 0, SR) in pieces
    assert all(0 <= frame < count and 0 <= start < stop <= SR for frame, start, stop in pieces)
    if not is_test(index):
        assert not any(is_test(frame) for frame, _, _ in pieces)
    if {frame for frame, _, _ in pieces} != {index}:
        times = [(frame * SR + start, frame * SR + stop) for frame, start, stop in pieces]
        assert all(before[1] == after[0] for before, after in itertools.pairwise(times))


def test_frame_that_does_not_exist_is_refused():
    with pytest.raises(Avs3dError, match="frame 5 of 5"):
        mono_window(5, 5)


def test_mono_clip_is_the_mean_of_both_channels_over_the_window():
    clips = [np.stack([np.full(SR, i), np.full(SR, i + 1)]).astype(np.float32) for i in range(5)]
    mono = mono_clip(clips, 3)
    assert mono.shape == (MONO_SAMPLES,)
    assert mono.dtype == np.float32
    assert mono[[0, 22_049, 22_050, 66_149, 66_150, -1]].tolist() == [2.5, 2.5, 3.5, 3.5, 4.5, 4.5]
    with pytest.raises(Avs3dError, match="shape"):
        mono_clip([np.zeros((2, 10))], 0)


def test_ild_is_right_minus_left():
    clip = np.stack([np.full(100, 0.1), np.full(100, 0.2)])
    assert rms(clip) == pytest.approx([0.1, 0.2])
    assert ild_db(*rms(clip)) == pytest.approx(20 * np.log10(2))
    assert ild_db(*rms(np.zeros((2, 10)))) == 0.0


@pytest.mark.parametrize(("value", "message"), [(1.3, "1.30 of full scale"), (np.nan, "NaN"), (0.0, "silent")])
def test_clipping_nan_and_silence_are_named(value, message):
    with pytest.raises(Avs3dError, match=f"frame_3.*{message}"):
        check_clip(np.full((2, 10), value), "frame_3")


@pytest.mark.parametrize("time", [0.2, 0.5, 1.2])
def test_t30_of_exponentially_decaying_noise(time):
    t = np.arange(int(1.5 * time * SR)) / SR
    noise = RNG.standard_normal((2, len(t))) * 10 ** (-3 * t / time)
    assert reverberation_time([noise], SR) == pytest.approx(time, rel=0.08)


def test_t30_of_what_does_not_decay_is_none():
    assert t30(np.zeros(1000), SR) is None
    assert t30(np.full(1000, np.nan), SR) is None
    assert t30(np.ones(50), SR) is None
    assert reverberation_time([np.zeros((2, 5000)), np.full((2, 5000), np.nan)], SR) is None


def test_schroeder_curve_of_an_exponential_is_a_straight_line():
    curve = decay_curve(np.exp(-np.arange(5000) / 200))
    assert curve[0] == 0.0
    assert curve[1000] == pytest.approx(10 * np.log10(np.exp(-10)), abs=1e-6)


def test_eyring_of_a_known_room():
    # Sabine's constant: 24·ln 10 / c = 0.1611 s/m
    assert eyring(72.0, 108.0, 0.2) == pytest.approx(0.1611 * 72 / (108 * 0.22314), rel=1e-3)
