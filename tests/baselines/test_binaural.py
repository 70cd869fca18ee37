"""Binaural cues: signs, closed forms of the spherical head, phasors and levels of a clip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import eval_legendre, spherical_jn, spherical_yn

from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import binaural
from baselines.echosegnet.binaural import (
    HEAD_RADIUS,
    SPEED_OF_SOUND,
    head_shadow_ild,
    observe,
    sphere_phase,
    woodworth_itd,
)

SR = 44_100


def delayed(signal, seconds):
    """``signal`` shifted circularly by a fraction of a sample."""
    spectrum = np.fft.rfft(signal)
    return np.fft.irfft(spectrum * np.exp(-2j * np.pi * np.fft.rfftfreq(len(signal), 1 / SR) * seconds), len(signal))


def noise(seed=0, count=SR):
    return np.random.default_rng(seed).standard_normal(count) * 0.1


def clip(itd, ild=0.0, seed=0):
    """White noise whose left ear lags by ``itd`` s and is softer by ``ild`` dB."""
    source = noise(seed)
    return np.stack([delayed(source, itd / 2) * 10 ** (-ild / 40), delayed(source, -itd / 2) * 10 ** (ild / 40)])


def rigid_sphere(frequency, incidence, terms=60):
    """|H| at a point on a rigid sphere under a plane wave (Duda and Martens 1998, eq. 4, source at infinity)."""
    mu = 2 * np.pi * frequency * HEAD_RADIUS / SPEED_OF_SOUND
    n = np.arange(min(terms, int(1.5 * mu) + 20))
    hankel = spherical_jn(n, mu, True) - 1j * spherical_yn(n, mu, True)
    return abs(np.sum(1j**n * (2 * n + 1) * eval_legendre(n, np.cos(incidence)) / hankel) / mu**2)


@pytest.mark.parametrize("itd", [-6e-4, -2e-4, 0.0, 1.3e-4, 5e-4])
def test_phasors_have_the_phase_of_the_delay(itd):
    cues = observe(clip(itd)[None])
    expected = np.exp(2j * np.pi * cues.frequencies * itd)
    assert np.mean(np.real(cues.phasors[0] * np.conj(expected))) > 0.99
    assert np.abs(cues.phasors[0]).mean() == pytest.approx(1.0)


def test_ild_is_right_minus_left_in_every_octave():
    cues = observe(clip(0.0, ild=6.0)[None])
    assert cues.ild[0] == pytest.approx(6.0, abs=0.01)


def test_swapped_ears_give_the_opposite_cues():
    heard = clip(3e-4, ild=4.0)
    one, other = observe(heard[None]), observe(heard[::-1][None])
    np.testing.assert_allclose(other.phasors, np.conj(one.phasors), atol=1e-12)
    np.testing.assert_allclose(other.ild, -one.ild, atol=1e-9)


def test_cues_do_not_depend_on_the_gain_but_the_level_does():
    heard = clip(3e-4, ild=4.0)[None]
    one, louder = observe(heard), observe(2 * heard)
    np.testing.assert_allclose(louder.phasors, one.phasors, atol=1e-12)
    np.testing.assert_allclose(louder.ild, one.ild, atol=1e-9)
    assert louder.level - one.level == pytest.approx(20 * np.log10(2))


def test_the_onset_wins_over_the_reflection_that_follows_it():
    burst = np.zeros(SR)
    for start in range(2000, SR - 8000, 8000):
        burst[start : start + 4000] = noise(start, 4000)
    direct, late = 4e-4, -4e-4
    echo = np.roll(burst, round(0.012 * SR))  # as loud, from the other side, 12 ms later
    heard = np.stack(
        [delayed(burst, direct / 2) + delayed(echo, late / 2), delayed(burst, -direct / 2) + delayed(echo, -late / 2)]
    )
    cues = observe(heard[None])

    def agreement(itd):
        return np.mean(np.real(cues.phasors[0] * np.exp(-2j * np.pi * cues.frequencies * itd)))

    assert agreement(direct) > agreement(late) + 0.15


def test_a_steady_tone_is_heard_though_it_has_no_onset():
    t = np.arange(SR) / SR
    itd = 4e-4
    heard = np.stack([np.sin(2 * np.pi * 689.0625 * (t - itd)), np.sin(2 * np.pi * 689.0625 * t)])[None]
    cues = observe(heard)
    peak = np.argmin(np.abs(cues.frequencies - 689.0625))
    assert np.angle(cues.phasors[0, peak]) == pytest.approx(2 * np.pi * 689.0625 * itd, abs=0.01)


def test_octaves_without_sound_are_left_out():
    t = np.arange(SR) / SR
    cues = observe(np.stack([np.sin(2 * np.pi * 1000 * t)] * 2)[None])
    assert [binaural.OCTAVE_EDGES[b] for b in cues.bands] == [707.0]


@pytest.mark.parametrize("silent", [(0, 1), (0,), (1,)])
def test_a_silent_or_one_eared_clip_says_nothing(silent):
    heard = np.stack([clip(3e-4), clip(3e-4)])
    heard[1, list(silent)] = 0.0
    cues = observe(heard)
    assert cues.heard.tolist() == [True, False]
    assert not cues.phasors[1].any()
    assert not cues.ild[1].any()
    assert np.isfinite(cues.ild).all()


def test_woodworth():
    assert woodworth_itd(np.pi / 2) == pytest.approx(HEAD_RADIUS / SPEED_OF_SOUND * (np.pi / 2 + 1))
    assert woodworth_itd(0.0) == 0.0
    assert woodworth_itd(-0.3) == -woodworth_itd(0.3)


@given(st.floats(-np.pi / 2, np.pi / 2))
def test_the_sphere_is_antisymmetric(lateral):
    np.testing.assert_allclose(head_shadow_ild(-lateral), -head_shadow_ild(lateral), atol=1e-9)


def test_the_phase_of_the_rigid_sphere_has_kuhns_limits():
    """A delay of 3·(a/c)·sin φ at low frequencies, and of about Woodworth's 2·(a/c)·φ in front at high ones."""
    lateral = np.radians([-70.0, -20.0, 0.0, 5.0, 20.0, 90.0])
    low = sphere_phase([30.0], lateral)[:, 0]
    np.testing.assert_allclose(
        low, 2 * np.pi * 30 * 3 * HEAD_RADIUS / SPEED_OF_SOUND * np.sin(lateral), rtol=0.01, atol=1e-9
    )
    front = np.radians(5.0)
    delay = sphere_phase([4000.0, 8000.0], [front])[0] / (2 * np.pi * np.array([4000.0, 8000.0]))
    np.testing.assert_allclose(delay, woodworth_itd(front), rtol=0.1)


@given(st.floats(-np.pi / 2, np.pi / 2))
def test_the_phase_of_the_rigid_sphere_is_antisymmetric(lateral):
    both = sphere_phase([150.0, 1000.0, 4000.0], [lateral, -lateral])
    np.testing.assert_allclose(np.exp(1j * both[0]), np.exp(-1j * both[1]), atol=1e-9)


def test_ild_grows_with_frequency_and_towards_the_side():
    ild = head_shadow_ild(np.radians([0, 20, 40, 60]))
    assert ild[0] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(ild, axis=0) > 0).all()
    assert (np.diff(ild[1:], axis=1) > 0).all()


@pytest.mark.parametrize("octave", range(7))
def test_brown_and_duda_have_the_course_of_the_rigid_sphere_of_duda_and_martens(octave):
    """Up to a gain, which is fitted to what is heard anyway, and up to 60°, where the far ear's bright spot begins."""
    low, high = binaural.OCTAVE_EDGES[octave : octave + 2]
    grid = low * (high / low) ** ((np.arange(8) + 0.5) / 8)
    lateral = np.radians(np.arange(-50, 51, 10))
    near, far = (
        np.array([np.mean([rigid_sphere(f, np.pi / 2 - s * phi) ** 2 for f in grid]) for phi in lateral])
        for s in (1, -1)
    )
    exact, ours = 10 * np.log10(near / far), head_shadow_ild(lateral)[:, octave]
    gain = (exact @ ours) / (ours @ ours)
    assert np.linalg.norm(exact - gain * ours) < 0.25 * np.linalg.norm(exact)
    if octave >= 2:  # below, no head shades much: the two differ by fractions of a decibel
        assert 0.5 < gain < 1.3


@pytest.mark.parametrize(
    ("direction", "degrees"),
    [
        ((1, 0, 0), 90),
        ((-1, 0, 0), -90),
        ((0, 0, 1), 0),
        ((0, 0, -1), 0),
        ((1, 0, 1), 45),
        ((1, 0, -1), 45),
        ((0, 1, 0), 0),
    ],
)
def test_lateral_angle_in_camera_axes(direction, degrees):
    """Right is positive; front and back, above and below are alike."""
    assert np.degrees(binaural.lateral_angle(np.array(direction, float))) == pytest.approx(degrees)


def test_a_source_at_the_ears_is_no_error():
    assert binaural.lateral_angle(np.zeros(3)) == 0.0


def test_selected_views_keep_their_cues():
    cues = observe(np.stack([clip(3e-4), clip(-2e-4), clip(0.0)]))
    part = cues.select(np.array([2, 0]))
    np.testing.assert_array_equal(part.phasors, cues.phasors[[2, 0]])
    np.testing.assert_array_equal(part.level, cues.level[[2, 0]])


@pytest.mark.parametrize(
    ("clips", "message"),
    [
        (np.zeros((2, SR)), "expected"),
        (np.zeros((3, 1, SR)), "expected"),
        (np.zeros((3, 2, 100)), "expected"),
        (np.full((1, 2, SR), np.nan), "clip 0 holds NaN"),
    ],
)
def test_what_is_no_sound_is_refused_in_one_line(clips, message):
    with pytest.raises(Avs3dError, match=message) as caught:
        observe(clips)
    assert "\n" not in str(caught.value)
