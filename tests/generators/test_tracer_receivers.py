"""Receivers of the tracer, held to closed forms: octaves, times, rigid sphere, ambisonics, arrays, diffuse fields."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import sph_harm_y
from threadpoolctl import threadpool_limits

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose, ambisonic_axes, spherical_harmonics
from benchmarks.receivers import near_pressure
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS, woodworth_itd
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.ambisonics import Ambisonics
from generators.acoustics.tracer.receivers.bands import band_weights, roll_off, upper_edges
from generators.acoustics.tracer.receivers.gridding import RANKS, fft_length
from generators.acoustics.tracer.receivers.microphones import Array
from generators.acoustics.tracer.receivers.sphere import diffuse_coherence, sphere_response
from generators.acoustics.tracer.receivers.spherical import SphericalHead, sphere_basis

RATE = 44_100
AHEAD, LEFT, UP = (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
UPRIGHT = np.eye(3)


def one(direction=AHEAD, time: float = 0.02, pressure=1.0) -> Arrivals:
    """A single arrival."""
    amplitude = np.broadcast_to(np.asarray(pressure, dtype=np.float32), (1, len(BANDS)))
    return Arrivals(np.array([time]), np.array([direction], dtype=np.float32), np.array(amplitude))


def from_azimuth(degrees: float, elevation: float = 0.0) -> tuple[float, float, float]:
    """Direction in the head's frame; azimuth positive to the right."""
    a, e = math.radians(degrees), math.radians(elevation)
    return math.cos(e) * math.sin(a), math.sin(e), -math.cos(e) * math.cos(a)


def isotropic(count: int, seconds: float, seed: int, pressure=1.0) -> Arrivals:
    """Arrivals with random signs from random directions at random times."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    signs = rng.choice([-1.0, 1.0], (count, 1))
    times = 0.02 + seconds * rng.random(count)
    return Arrivals(times, directions.astype(np.float32), (signs * np.ones(8) * pressure).astype(np.float32))


def spectrum(response, frequencies, time: float = 0.0) -> np.ndarray:
    """(channels, K) Fourier transform of a response at any frequencies, ``time`` taken out."""
    n = np.arange(response.shape[1]) / RATE - time
    return response.astype(np.float64) @ np.exp(-2j * np.pi * np.outer(n, frequencies))


def noise_spectrum(response, frequencies) -> np.ndarray:
    """(channels, K) as `spectrum`, for long responses: at the nearest multiples of 0.5 Hz."""
    padded = np.fft.rfft(response.astype(np.float64), 2 * RATE)
    return padded[:, np.rint(2 * np.asarray(frequencies)).astype(int)]


def decibels(ratio) -> np.ndarray:
    return 20 * np.log10(np.abs(ratio))


@pytest.fixture
def centre(tmp_path: Path) -> Array:
    """One microphone in the centre: nothing but times and octaves."""
    path = tmp_path / "centre.yaml"
    path.write_text("microphones: [{position: [0, 0, 0]}]\n")
    return Array(path)


# Octave filters


@given(st.floats(0, 96_000))
def test_the_weights_of_every_frequency_add_up_to_one(frequency: float) -> None:
    weights = band_weights([frequency])
    assert weights.sum() == pytest.approx(1, abs=1e-12)
    assert weights.min() >= 0
    assert np.count_nonzero(weights) <= 2, "only neighbouring octaves overlap"


def test_an_octave_has_its_centre_to_itself_and_shares_its_edges() -> None:
    np.testing.assert_allclose(band_weights(BANDS), np.eye(8), atol=1e-12)
    edges = np.sqrt(np.array(BANDS[:-1]) * BANDS[1:])
    shares = band_weights(edges)
    for band in range(7):
        assert shares[band, band] == pytest.approx(0.5)
        assert shares[band + 1, band] == pytest.approx(0.5)


def test_the_outer_octaves_reach_to_0_hz_and_without_limit() -> None:
    outside = band_weights([0, 10, 40, 62, 8001, 12_000, 22_050, 96_000])
    assert outside[0, :4].tolist() == [1, 1, 1, 1]
    assert outside[7, 4:].tolist() == [1, 1, 1, 1]


def test_octaves_above_the_nyquist_frequency_are_left_out() -> None:
    assert upper_edges(44_100).tolist() == [125, 250, 500, 1000, 2000, 4000, 8000, 22_050]
    # 4 kHz is the centre and the end of the 4 kHz octave; that of 8 kHz would begin there.
    assert upper_edges(8000).tolist() == [125, 250, 500, 1000, 2000, 4000, 4000, 0]


def test_equal_pressures_have_a_flat_spectrum(centre: Array) -> None:
    response = centre.response(one(time=0.0201234), UPRIGHT, RATE)
    frequencies = np.geomspace(40, 16_000, 400)
    assert np.abs(decibels(spectrum(response, frequencies, 0.0201234))).max() < 0.1


@pytest.mark.parametrize("band", range(8))
def test_an_octave_sounds_in_its_own_octave_alone(centre: Array, band: int) -> None:
    response = centre.response(one(time=0.2, pressure=np.eye(8)[band]), UPRIGHT, RATE)
    gains = np.abs(spectrum(response, np.array(BANDS)))[0]
    np.testing.assert_allclose(gains, np.eye(8)[band], atol=7e-3)


@settings(max_examples=30)
@given(st.lists(st.floats(0.01, 2), min_size=8, max_size=8), st.floats(0.1, 0.3))
def test_pressures_are_the_gains_at_the_centres_of_the_octaves(pressures: list[float], time: float) -> None:
    response = Ambisonics(1).response(one(time=time, pressure=pressures), UPRIGHT, RATE)
    found = spectrum(response[:1], np.array(BANDS), time)[0]
    np.testing.assert_allclose(found, pressures, atol=0.02)


def test_the_ringing_before_a_reflection_is_inaudible(centre: Array) -> None:
    # A thick carpet: √(1 − α) of each octave.
    carpet = np.sqrt(1 - np.array([0.05, 0.05, 0.06, 0.1, 0.2, 0.35, 0.45, 0.45]))
    response = np.abs(centre.response(one(time=0.1, pressure=carpet), UPRIGHT, RATE)[0])
    start = round(0.1 * RATE)
    assert response.argmax() == pytest.approx(start, abs=1)
    for milliseconds, level in ((1, -65), (2, -75), (5, -90)):
        before = response[: start - round(milliseconds * RATE / 1000)].max()
        assert decibels(before / response.max()) < level


def test_random_arrivals_have_the_energy_of_their_octaves(centre: Array) -> None:
    pressure = np.array([0.5, 1.0, 0.25, 2.0, 1.0, 0.5, 0.1, 0.3])
    count, seconds, trials = 4000, 1.0, 12
    power = np.zeros(8)
    for seed in range(trials):
        response = centre.response(isotropic(count, seconds, seed, pressure), UPRIGHT, RATE)
        for band, middle in enumerate(BANDS):
            # A sixth of an octave, one frequency for each independent one.
            frequencies = np.arange(middle * 2 ** (-1 / 12), middle * 2 ** (1 / 12), 1 / seconds)[:200]
            power[band] += np.mean(np.abs(noise_spectrum(response, frequencies)) ** 2) / trials / count
    free = np.array([min(middle * 0.116 * seconds, 200) * trials for middle in BANDS])
    tolerance = 10 * np.log10(1 + 3.5 / np.sqrt(free)) + 0.1
    # Near the centre of an octave its neighbours add next to nothing.
    frequencies = [np.geomspace(m * 2 ** (-1 / 12), m * 2 ** (1 / 12), 50) for m in BANDS]
    wanted = [np.mean((pressure @ band_weights(f)) ** 2) for f in frequencies]
    assert np.all(np.abs(10 * np.log10(power / wanted)) < tolerance)


# Times


@settings(max_examples=30)
@given(st.floats(0.005, 0.4))
def test_a_time_is_kept_to_a_fraction_of_a_sample(time: float) -> None:
    response = Ambisonics(1).response(one(time=time), UPRIGHT, RATE)
    frequencies = np.geomspace(40, 18_000, 60)
    found = spectrum(response[:1], frequencies, time)[0]
    np.testing.assert_allclose(found, roll_off(frequencies, RATE), atol=5e-3)
    assert response.shape[1] >= time * RATE


@pytest.mark.parametrize("rate", [8000, 16_000, 44_100, 48_000, 96_000, 192_000])
def test_every_sample_rate_keeps_time_and_level(rate: int) -> None:
    response = Ambisonics(1).response(one(time=0.0333), UPRIGHT, rate)[0].astype(np.float64)
    frequencies = np.array([100.0, 1000, 3000])
    n = np.arange(len(response)) / rate - 0.0333
    np.testing.assert_allclose(response @ np.exp(-2j * np.pi * np.outer(n, frequencies)), 1, atol=5e-3)


def test_arrivals_add_up(centre: Array) -> None:
    first, second = one(time=0.02, pressure=0.7), one(time=0.0312, pressure=np.linspace(1, 0.1, 8))
    both = centre.response(Arrivals.joined([first, second]), UPRIGHT, RATE)
    alone = centre.response(second, UPRIGHT, RATE).astype(np.float64)
    shorter = centre.response(first, UPRIGHT, RATE)  # ends 30 ms after its arrival
    alone[:, : shorter.shape[1]] += shorter
    np.testing.assert_allclose(both, alone, atol=1.5e-3)


def test_nothing_arrives_and_nothing_sounds() -> None:
    response = SphericalHead().response(Arrivals.none(), UPRIGHT, RATE)
    assert response.shape[0] == 2
    assert response.shape[1] > 0
    assert not response.any()


@given(st.integers(1, 10**7))
def test_lengths_of_the_transforms_are_few_and_not_much_too_long(least: int) -> None:
    length = fft_length(least)
    assert least <= length <= max(1.25 * least, 1024)


def test_same_arrivals_same_bytes_whatever_came_before() -> None:
    head = SphericalHead()
    arrivals = isotropic(500, 0.3, 1)
    first = head.response(arrivals, UPRIGHT, RATE).tobytes()
    head.response(isotropic(700, 0.6, 2), UPRIGHT, RATE)
    assert head.response(arrivals, UPRIGHT, RATE).tobytes() == first
    assert SphericalHead().response(arrivals, UPRIGHT, RATE).tobytes() == first


def test_tables_have_the_same_bytes_for_any_number_of_blas_threads() -> None:
    found = []
    for threads in (1, 2, 3):
        with threadpool_limits(limits=threads, user_api="blas"):
            basis = sphere_basis.__wrapped__(RATE)
        found.append((basis.rows.tobytes(), basis.impulses.tobytes()))
    assert found[0] == found[1] == found[2]


def test_components_are_as_many_as_the_kernel_has_functions_for() -> None:
    assert {count for _, count in sphere_basis(RATE).columns} <= set(RANKS)


# Spherical head


def duda_martens(theta: float, mu: float, rho: float) -> complex:
    """The recursion of Duda and Martens (1998), appendix A: pressure relative to the free field at the centre.

    ``rho`` is the source's distance in radii. Time dependence exp(−iωt) there; conjugated here.
    """
    x = math.cos(theta)
    zr, za = 1 / (1j * mu * rho), 1 / (1j * mu)
    qr2, qr1, qa2, qa1 = zr, zr * (1 - zr), za, za * (1 - za)
    p2, p1 = 1.0, x
    total = zr / (za * (za - 1))
    term = 3 * x * zr * (zr - 1) / (za * (2 * za * za - 2 * za + 1))
    total += term
    m, ratio, last = 2, abs(term) / abs(total), 1.0
    while (ratio > 1e-14 or last > 1e-14) and m < 400:
        qr = -(2 * m - 1) * zr * qr1 + qr2
        qa = -(2 * m - 1) * za * qa1 + qa2
        p = ((2 * m - 1) * x * p1 - (m - 1) * p2) / m
        term = (2 * m + 1) * p * qr / ((m + 1) * za * qa - qa1)
        total += term
        m += 1
        qr2, qr1, qa2, qa1, p2, p1 = qr1, qr, qa1, qa, p1, p
        last, ratio = ratio, abs(term) / abs(total)
    return complex(np.conj(rho * np.exp(-1j * mu) * total / (1j * mu)))


@pytest.mark.parametrize("theta", [0, 40, 90, 130, 150, 170, 180])
@pytest.mark.parametrize("mu", [0.1, 1.0, 5.0, 20.0])
def test_the_sphere_is_that_of_duda_and_martens(theta: float, mu: float) -> None:
    far = 1e6
    exact = duda_martens(math.radians(theta), mu, far)
    found = sphere_response([math.radians(theta)], [mu])[0, 0]
    assert abs(found) == pytest.approx(abs(exact), rel=1e-4)
    # The phase of the source's distance is common to all angles.
    ahead = duda_martens(0.0, mu, far) / sphere_response([0.0], [mu])[0, 0]
    assert exact / found == pytest.approx(ahead / abs(ahead), abs=2e-4)


def test_the_sphere_at_the_ends_of_the_spectrum() -> None:
    theta = np.radians([0, 45, 90, 135, 180])
    np.testing.assert_allclose(sphere_response(theta, [0.0])[:, 0], 1)
    # Kuhn (1977): 3/2 of the free field's phase.
    ka = 0.02
    np.testing.assert_allclose(np.angle(sphere_response(theta, [ka])[:, 0]), 1.5 * ka * np.cos(theta), atol=2e-5)
    # A hard wall doubles the pressure.
    assert abs(sphere_response([0.0], [60.0])[0, 0]) == pytest.approx(2, abs=0.02)
    # Creeping waves from all sides meet behind the sphere.
    shadow = np.abs(sphere_response(np.radians([150, 165, 180]), [20.0])[:, 0])
    assert shadow[2] > 2 * shadow[0]


@pytest.mark.parametrize("distance", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(("azimuth", "frequency"), [(30, 250), (90, 250), (60, 8000), (90, 2000)])
def test_the_near_field_of_the_page_is_that_of_duda_and_martens(
    distance: float, azimuth: float, frequency: float
) -> None:
    """The series of the benchmark against the recursion of the paper's appendix."""
    left, right = near_pressure(distance, azimuth, [frequency])[:, 0]
    mu, rho = 2 * math.pi * frequency * HEAD_RADIUS / SPEED_OF_SOUND, distance / HEAD_RADIUS
    exact = [duda_martens(math.radians(90 + side * azimuth), mu, rho) for side in (1, -1)]
    assert right / left == pytest.approx(np.conj(exact[1] / exact[0]), rel=1e-6)


@pytest.mark.parametrize("theta", [10, 75, 120, 165])
@pytest.mark.parametrize("rho", [1.8, 4.0, 30.0])
def test_the_series_of_a_near_source_is_that_of_duda_and_martens(theta: float, rho: float) -> None:
    """With the phase: relative to the free field at the centre, as a plane wave."""
    for mu in (0.1, 1.0, 12.0):
        exact = duda_martens(math.radians(theta), mu, rho)
        found = sphere_response([math.radians(theta)], [mu], 1 / rho)[0, 0]
        assert abs(found) == pytest.approx(abs(exact), rel=1e-5)
        ahead = duda_martens(0.0, mu, rho) / sphere_response([0.0], [mu], 1 / rho)[0, 0]
        assert exact / found == pytest.approx(ahead, abs=1e-5)


def near_one(distance: float, azimuth: float) -> Arrivals:
    """The direct sound of a point source."""
    plain = one(from_azimuth(azimuth), time=distance / SPEED_OF_SOUND, pressure=1 / distance)
    return Arrivals(plain.time, plain.direction, plain.pressure, np.array([True]))


@pytest.mark.parametrize("distance", [0.3, 0.42, 1.0, 2.9, 7.0])
def test_near_sources_reach_both_ears_as_those_of_a_rigid_sphere(distance: float) -> None:
    rho = distance / HEAD_RADIUS
    for azimuth in (-90, -35, 0, 20, 65, 130):
        response = SphericalHead().response(near_one(distance, azimuth), UPRIGHT, RATE)
        for middle in BANDS[2:]:
            frequencies = np.linspace(middle / math.sqrt(2), middle * math.sqrt(2), 12)
            found = spectrum(response, frequencies) * distance
            exact = np.empty((2, len(frequencies)), dtype=np.complex128)
            for ear, side in enumerate((1, -1)):
                for k, mu in enumerate(2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND):
                    common = sphere_response([0.0], [mu], 1 / rho)[0, 0] / duda_martens(0.0, mu, rho)
                    at = duda_martens(math.radians(90 + side * azimuth), mu, rho) * common
                    exact[ear, k] = at * np.exp(-1j * mu * rho)
            level = 10 * np.log10(np.mean(np.abs(found) ** 2, axis=1) / np.mean(np.abs(exact) ** 2, axis=1))
            assert np.abs(level).max() < (0.3 if middle < 8000 else 0.45), f"{azimuth}°, {middle} Hz: {level.round(2)}"
            late = np.angle(np.sum(exact * np.conj(found), axis=1)) / (2 * np.pi * middle)
            assert np.abs(late).max() < 6e-6, f"{azimuth}°, {middle} Hz: off by {late * 1e6} µs"


def test_no_step_at_any_distance_and_a_far_source_is_a_plane_wave() -> None:
    distances = np.array([0.1, 0.149, 0.151, *np.geomspace(0.2, 12, 200)])
    levels = []
    for distance in distances:
        response = SphericalHead().response(near_one(distance, 70), UPRIGHT, RATE)
        levels.append(10 * np.log10(np.sum(response.astype(np.float64) ** 2, axis=1)) + 20 * np.log10(distance))
    steps = np.abs(np.diff(levels, axis=0))
    assert steps[3:].max() < 0.2
    assert steps[1].max() < 0.2  # below a head's width nothing more changes
    far, plane = near_one(400.0, 70), one(from_azimuth(70), time=400 / SPEED_OF_SOUND, pressure=1 / 400)
    heard, expected = (SphericalHead().response(each, UPRIGHT, RATE) for each in (far, plane))
    assert np.linalg.norm(heard - expected) < 0.01 * np.linalg.norm(expected)


ANGLES = [(azimuth, 0) for azimuth in range(-180, 180, 15)] + [(20, 35), (-65, -40), (100, 60), (0, 90), (0, -90)]


@pytest.mark.parametrize(("azimuth", "elevation"), ANGLES)
def test_both_ears_hear_the_sphere(azimuth: float, elevation: float) -> None:
    direction = from_azimuth(azimuth, elevation)
    response = SphericalHead().response(one(direction, time=0.05), UPRIGHT, RATE)
    for middle in BANDS:
        frequencies = np.linspace(middle / math.sqrt(2), min(middle * math.sqrt(2), 16_000), 30)
        found = spectrum(response, frequencies, 0.05)
        ka = 2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND
        exact = sphere_response([math.acos(-direction[0]), math.acos(direction[0])], ka)
        level = 10 * np.log10(np.mean(np.abs(found) ** 2, axis=1) / np.mean(np.abs(exact) ** 2, axis=1))
        assert np.abs(level).max() < 0.35, f"{middle} Hz: level of the ears off by {level.round(2)} dB"
        assert abs(level[1] - level[0]) < 0.35, f"{middle} Hz: ILD off"
        # Interaural delay of the octave: phase of the cross-spectrum.
        cross = np.sum(found[0] * np.conj(found[1]) * np.conj(exact[0] * np.conj(exact[1])))
        off = np.angle(cross) / (2 * np.pi * middle)
        assert abs(off) < 8e-6, f"{middle} Hz: ITD off by {off * 1e6:.1f} µs"


def test_itd_is_kuhns_at_low_and_woodworths_at_high_frequencies() -> None:
    azimuth = 60
    response = SphericalHead().response(one(from_azimuth(azimuth), time=0.15), UPRIGHT, RATE)
    low = spectrum(response, np.array([100.0]), 0.15)[:, 0]
    kuhn = 3 * HEAD_RADIUS / SPEED_OF_SOUND * math.sin(math.radians(azimuth))
    assert np.angle(low[1] * np.conj(low[0])) / (2 * np.pi * 100) == pytest.approx(kuhn, abs=10e-6)
    # Group delay from 3 to 5 kHz.
    frequencies = np.linspace(3000, 5000, 401)
    high = spectrum(response, frequencies, 0.15)
    phase = np.unwrap(np.angle(high[1] * np.conj(high[0])))
    group = np.polyfit(2 * np.pi * frequencies, phase, 1)[0]
    assert group == pytest.approx(woodworth_itd(math.radians(azimuth)), rel=0.1)


def test_channel_0_is_left_and_the_head_turns() -> None:
    head = SphericalHead()
    east = (1.0, 0.0, 0.0)
    facing_north = head.response(one(east), UPRIGHT, RATE)
    assert (facing_north[1] ** 2).sum() > 2 * (facing_north[0] ** 2).sum()
    assert np.abs(facing_north[1]).argmax() < np.abs(facing_north[0]).argmax()
    # Half a turn: east is on the left.
    south = Pose.from_yaw((0, 0, 0), math.pi).rotation_matrix
    np.testing.assert_allclose(head.response(one(east), south, RATE), facing_north[::-1], atol=1e-5)
    # A quarter to the right: east is ahead.
    right = Pose.from_yaw((0, 0, 0), -math.pi / 2).rotation_matrix
    np.testing.assert_allclose(
        head.response(one(east), right, RATE), head.response(one(AHEAD), UPRIGHT, RATE), atol=1e-4
    )


def test_the_coherence_of_a_diffuse_field_at_the_ears() -> None:
    frequencies = np.arange(100.0, 4000.0, 2.0)
    cross, power = np.zeros(len(frequencies), dtype=np.complex128), np.zeros((2, len(frequencies)))
    for seed in range(6):
        found = noise_spectrum(SphericalHead().response(isotropic(3000, 0.5, seed), UPRIGHT, RATE), frequencies)
        cross += found[0] * np.conj(found[1])
        power += np.abs(found) ** 2
    parts = np.array_split(np.arange(len(frequencies)), 13)  # 300 Hz: 150 values in 6 fields each
    measured = np.array([cross[p].sum() / np.sqrt(power[0, p].sum() * power[1, p].sum()) for p in parts])
    closed = diffuse_coherence(2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND)
    wanted = np.array([closed[p].mean() for p in parts])
    assert wanted.max() > 0.7
    assert wanted.min() < -0.1
    # 900 independent values: a standard deviation of 0.03.
    assert np.abs(measured - wanted).max() < 0.12


def test_the_coherence_of_a_diffuse_field_at_two_microphones(tmp_path: Path) -> None:
    path = tmp_path / "pair.json"
    path.write_text(json.dumps({"microphones": [{"position": [-0.1, 0, 0]}, {"position": [0.1, 0, 0]}]}))
    pair = Array(path)
    frequencies = np.arange(100.0, 3000.0, 2.0)
    cross, power = np.zeros(len(frequencies), dtype=np.complex128), np.zeros((2, len(frequencies)))
    for seed in range(6):
        found = noise_spectrum(pair.response(isotropic(3000, 0.5, seed), UPRIGHT, RATE), frequencies)
        cross += found[0] * np.conj(found[1])
        power += np.abs(found) ** 2
    parts = np.array_split(np.arange(len(frequencies)), 10)
    measured = np.array([cross[p].sum() / np.sqrt(power[0, p].sum() * power[1, p].sum()) for p in parts])
    wanted = np.array([np.mean(np.sinc(2 * frequencies[p] * 0.2 / SPEED_OF_SOUND)) for p in parts])
    assert np.abs(measured - wanted).max() < 0.12


# Ambisonics

unit_vectors = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: math.hypot(*v) > 0.1)


@given(unit_vectors)
def test_harmonics_of_a_degree_have_energy_one(vector: tuple[float, float, float]) -> None:
    harmonics = spherical_harmonics(np.array([vector]) / math.hypot(*vector), 3)[0]
    for degree in range(4):
        assert np.sum(harmonics[degree**2 : (degree + 1) ** 2] ** 2) == pytest.approx(1, abs=1e-12)


@given(unit_vectors)
def test_harmonics_are_those_of_acn_and_sn3d(vector: tuple[float, float, float]) -> None:
    x, y, z = np.array(vector) / math.hypot(*vector)
    found = spherical_harmonics(np.array([[x, y, z]]), 3)[0]
    polar, azimuth = math.atan2(math.hypot(x, y), z), math.atan2(y, x)
    for degree in range(4):
        for m in range(-degree, degree + 1):
            # scipy has complex ones with the Condon–Shortley phase and norm 1 over the sphere.
            value = complex(sph_harm_y(degree, abs(m), polar, azimuth)) * (-1) ** m
            value *= math.sqrt(4 * math.pi / (2 * degree + 1))
            real = value.real if m == 0 else math.sqrt(2) * (value.real if m > 0 else value.imag)
            assert found[degree * (degree + 1) + m] == pytest.approx(real, abs=1e-9)


@pytest.mark.parametrize(("direction", "gains"), [(AHEAD, (1, 0, 0, 1)), (LEFT, (1, 1, 0, 0)), (UP, (1, 0, 1, 0))])
def test_channels_are_w_y_z_x_with_y_to_the_left(direction, gains) -> None:
    receiver = Ambisonics(1)
    assert receiver.channel_names == ("W", "Y", "Z", "X")
    found = spectrum(receiver.response(one(direction, time=0.1), UPRIGHT, RATE), np.array([1000.0]), 0.1)[:, 0]
    np.testing.assert_allclose(found, gains, atol=3e-3)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_turning_the_head_turns_the_harmonics(order: int) -> None:
    rng = np.random.default_rng(5)
    points = rng.standard_normal((200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    turn = Pose.from_yaw((0, 0, 0), 0.7, 0.3).rotation_matrix
    straight = spherical_harmonics(ambisonic_axes(points), order)
    turned = spherical_harmonics(ambisonic_axes(points @ turn), order)
    # One matrix turns the harmonics of all points: block by block orthogonal.
    matrix = np.linalg.lstsq(straight, turned, rcond=None)[0]
    np.testing.assert_allclose(straight @ matrix, turned, atol=1e-9)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye((order + 1) ** 2), atol=1e-9)
    arrivals = isotropic(50, 0.1, 3)
    receiver = Ambisonics(order)
    world = receiver.response(arrivals, UPRIGHT, RATE)
    np.testing.assert_allclose(receiver.response(arrivals, turn, RATE), matrix.T @ world, atol=1e-4)


@pytest.mark.parametrize("order", [0, 4, True, 1.0, "3", None])
def test_another_order_is_refused(order) -> None:
    with pytest.raises(UsageError, match=r"ambisonics: order is .*, expected 1 to 3"):
        Ambisonics(order)


# Arrays


def test_a_plane_wave_passes_the_microphones(tmp_path: Path) -> None:
    path = tmp_path / "array.yaml"
    path.write_text(
        "microphones:\n"
        "  - {name: front, position: [0.0, 0.0, -0.05]}\n"
        "  - {position: [0.031, 0.02, 0.01]}\n"
        "  - {name: left, position: [-0.5, 0.0, 0.0]}\n"
    )
    array = Array(path)
    assert array.channel_names == ("front", "mic_2", "left")
    assert array.channels == 3
    for azimuth, elevation in ((0, 0), (-90, 0), (37, -20), (180, 60)):
        direction = np.array(from_azimuth(azimuth, elevation))
        response = array.response(one(direction, time=0.05), UPRIGHT, RATE)
        for channel, position in enumerate(([0, 0, -0.05], [0.031, 0.02, 0.01], [-0.5, 0, 0])):
            arrival = 0.05 - direction @ position / SPEED_OF_SOUND
            frequencies = np.array([200.0, 2000.0, 9000.0])
            found = spectrum(response[channel : channel + 1], frequencies, arrival)[0]
            np.testing.assert_allclose(found, 1, atol=3e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected microphones"),
        ("[1, 2]", "expected microphones"),
        ("microphones: []", "microphones: "),
        ("microphones: [{position: [0, 0]}]", "microphones.0.position"),
        ("microphones: [{position: [0, 0, .nan]}]", "microphones.0.position.2"),
        ("microphones: [{position: [0, 0, 1.5]}]", "less than or equal to 1"),
        ("microphones: [{position: [0, 0, '0']}]", "microphones.0.position.2"),
        ("microphones: [{place: [0, 0, 0]}]", "microphones.0"),
        ("microphones: [{name: a, position: [0, 0, 0]}, {name: a, position: [0, 0, 0]}]", "'a' is given to more than"),
        ("microphones: [{name: mic_2, position: [0, 0, 0]}, {position: [0, 0, 0]}]", "'mic_2' is given to more than"),
        ("microphones: [", "not valid YAML"),
    ],
)
def test_a_wrong_array_file_gets_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "array.yaml"
    path.write_text(text)
    with pytest.raises(Avs3dError) as caught:
        Array(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_array_file_gets_one_line(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"none\.yaml"):
        Array(tmp_path / "none.yaml")


# What is refused

RECEIVERS = [SphericalHead(), Ambisonics(2)]


@pytest.mark.parametrize("receiver", RECEIVERS)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["time", "direction", "pressure"])
def test_numbers_that_are_not_finite_are_refused(receiver, field: str, value: float) -> None:
    arrivals = isotropic(20, 0.1, 1)
    getattr(arrivals, field).reshape(20, -1)[7, 0] = value
    with pytest.raises(Avs3dError, match=f"{field} of arrival 7 of 20 is NaN or infinite"):
        receiver.response(arrivals, UPRIGHT, RATE)


@pytest.mark.parametrize(
    ("arrivals", "rotation", "rate", "message"),
    [
        (one(time=-0.001), UPRIGHT, RATE, "arrival times"),
        (one(time=1e6), UPRIGHT, RATE, "expected 0 to 60"),
        (one((0.0, 0.0, -2.0)), UPRIGHT, RATE, "direction of arrival 0 has length 2, expected 1"),
        (one((0.0, 0.0, 0.0)), UPRIGHT, RATE, "has length 0"),
        (one(), 2 * UPRIGHT, RATE, "rotation"),
        (one(), np.full((3, 3), np.nan), RATE, "rotation"),
        (one(), np.eye(2), RATE, "rotation"),
        (one(), UPRIGHT, 4000, "sample rate 4000 Hz"),
        (one(), UPRIGHT, 400_000, "sample rate 400000 Hz"),
    ],
)
def test_input_out_of_range_is_refused(arrivals: Arrivals, rotation, rate: int, message: str) -> None:
    with pytest.raises(Avs3dError, match=message):
        SphericalHead().response(arrivals, rotation, rate)
