"""The closed-form renderer: delays, levels, the head, image sources, reverberation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.measures.decay import eyring, octave_filtered, reverberation_time
from avs3d_bench.measures.levels import ild_db
from generators.acoustics import hrtf
from generators.acoustics.analytic import AnalyticBackend, Box, band_weights, image_sources, screen_gain
from generators.acoustics.clips import rms
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.core.scene import Room
from tests.support.acoustic_rooms import box_scene, solid, with_absorption

SR = 44_100
LISTENER = np.array([20.0, 20.0, 20.0])
FREE_FIELD = box_scene((40, 40, 40), label="plaster")


def direct(offset, yaw=0.0, pitch=0.0):
    """The direct sound alone: walls that absorb everything but a trace, no tail."""
    backend = AnalyticBackend(absorption=1 - 1e-12, images=1, tail=False)
    session = backend.open(FREE_FIELD, tuple(LISTENER + offset), room="kitchen")
    return session.impulse_response(Pose.from_yaw(LISTENER, yaw, pitch)).astype(float)


def delay_of(response):
    """Delay in samples from the phase slope below 500 Hz."""
    spectrum = np.fft.rfft(response, 1 << 17)
    frequency = np.fft.rfftfreq(1 << 17, 1 / SR)
    used = (frequency > 50) & (frequency < 500)
    slope = np.polyfit(2 * np.pi * frequency[used], np.unwrap(np.angle(spectrum))[used], 1)[0]
    return -slope * SR


@pytest.mark.parametrize("distance", [1.0, 2.345, 6.0, 9.87])
def test_direct_sound_is_delayed_by_r_over_c_and_falls_as_1_over_r(distance):
    response = direct((0, 0, -distance))
    reference = direct((0, 0, -3.0))
    # The head adds one delay for all distances.
    assert delay_of(response[0]) - delay_of(reference[0]) == pytest.approx(
        (distance - 3) / SPEED_OF_SOUND * SR, abs=0.05
    )
    energy = np.sum(response**2) / np.sum(reference**2)
    assert 10 * np.log10(energy) == pytest.approx(20 * np.log10(3 / distance), abs=0.15)


def test_low_frequencies_pass_the_head_with_amplitude_1_over_r():
    response = direct((2.0, 0, 0))
    assert response.sum(axis=1) == pytest.approx([0.5, 0.5], rel=0.01)


@pytest.mark.parametrize("azimuth", [-90, -50, -20, 0, 10, 35, 60, 90])
def test_interaural_delay_is_woodworths(azimuth):
    a = np.radians(azimuth)
    # The head shadow delays low frequencies of its own accord; Woodworth's law is the onset's.
    theta = [hrtf.incidence([[np.sin(a), 0.0, -np.cos(a)]], ear)[0] for ear in (0, 1)]
    itd = hrtf.ear_delay(theta[0]) - hrtf.ear_delay(theta[1])
    assert itd == pytest.approx(float(hrtf.woodworth_itd(a)), abs=1e-9)
    response = direct((3 * np.sin(a), 0, -3 * np.cos(a)))
    onset = [int(np.argmax(np.abs(h) > 0.3 * np.abs(h).max())) for h in response]
    assert (onset[0] - onset[1]) / SR == pytest.approx(itd, abs=2.5 / SR)


@given(st.floats(-179, 179), st.floats(-60, 60), st.floats(-3, 3), st.floats(-0.5, 0.5))
@settings(max_examples=40)
def test_louder_ear_is_on_the_sources_side(azimuth, elevation, yaw, pitch):
    a, e = np.radians(azimuth), np.radians(elevation)
    offset = 2 * np.array([np.sin(a) * np.cos(e), np.sin(e), -np.cos(a) * np.cos(e)])
    side = -Pose.from_yaw(LISTENER, yaw, pitch).rotation_matrix[:, 0] @ offset / -2
    heard = direction_to(Pose.from_yaw(LISTENER, yaw, pitch), LISTENER + offset)
    ild = ild_db(*rms(direct(offset, yaw, pitch)))
    if abs(side) > 0.05:
        assert np.sign(ild) == np.sign(side) == np.sign(heard.azimuth)
    else:
        assert abs(ild) < 2.0


def test_head_shadow_of_brown_and_duda():
    assert hrtf.shadow_coefficient(0.0) == pytest.approx(2.0)
    assert hrtf.shadow_coefficient(np.radians(150)) == pytest.approx(0.1)
    frequency = np.array([0.0, 1000.0, SR / 2])
    low, high = hrtf.shadow_bases(frequency, SR)
    np.testing.assert_allclose(low + high, 1.0, atol=1e-12)
    assert abs(low[0]) == pytest.approx(1.0)
    assert abs(low[2]) == pytest.approx(0.0, abs=1e-9)


def test_octave_weights_add_up_to_one():
    weights = band_weights(np.linspace(0, SR / 2, 5000))
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(band_weights(np.array([125.0, 250, 500, 1000, 2000, 4000])), np.eye(6), atol=1e-12)


def test_image_sources_of_a_box():
    box = Box((0, 0, 0), (6, 3, 4), (0.2,) * 6)
    positions, bounces = image_sources(box, np.array([1.0, 1.0, 1.0]), np.array([4.0, 1.5, 2.5]), 40.0)
    first = sorted(map(tuple, positions[bounces == 1].tolist()))
    assert first == sorted([(-1, 1, 1), (11, 1, 1), (1, -1, 1), (1, 5, 1), (1, 1, -1), (1, 1, 7)])
    # One image per cell: their number is the sphere's volume over the room's.
    assert len(positions) == pytest.approx(4 / 3 * np.pi * 40**3 / 72, rel=0.03)
    assert (bounces == 0).sum() == 1
    assert [int((bounces == n).sum()) for n in (1, 2, 3)] == [6, 18, 38]


def test_diffuse_tail_goes_on_where_the_image_sources_end(monkeypatch):
    """The same room with few images and a tail, or with many images: the late energy is the same.

    In octaves from 500 Hz on: below, image sources of one sign add up coherently, and modes are few. A specular box
    does not quite follow Eyring (Lehmann and Johansson 2010), which leaves 1 to 2 dB.
    """
    with_absorption(monkeypatch, 0.2)
    pose = Pose.from_yaw((4.0, 1.5, 2.5), 0.5)
    late = []
    for images, tail in ((500, True), (60_000, False)):
        session = AnalyticBackend(images=images, tail=tail).open(box_scene((6, 3, 4)), (1.2, 1.0, 0.9), room="kitchen")
        response = session.impulse_response(pose).astype(float)
        octaves = [octave_filtered(response, SR, band) for band in (500.0, 1000.0, 2000.0, 4000.0)]
        late.append([10 * np.log10((x[:, int(0.1 * SR) : int(0.25 * SR)] ** 2).sum()) for x in octaves])
    assert np.mean(late[0]) == pytest.approx(np.mean(late[1]), abs=1.5)
    np.testing.assert_allclose(late[0], late[1], atol=2.5)


@pytest.mark.parametrize("alpha", [0.1, 0.3])
def test_reverberation_time_follows_eyring(monkeypatch, alpha):
    with_absorption(monkeypatch, alpha)
    session = AnalyticBackend().open(box_scene((6, 3, 4)), (1.0, 1.0, 1.0), room="kitchen")
    response = session.impulse_response(Pose.from_yaw((4.0, 1.5, 2.5), 0.3))
    assert reverberation_time([response], SR) == pytest.approx(eyring(72.0, 108.0, alpha), rel=0.15)


def test_furniture_and_openings_count_in_the_absorption(monkeypatch):
    with_absorption(monkeypatch, 0.1)
    empty = AnalyticBackend().open(box_scene((6, 3, 4)), (1.0, 1.0, 1.0), room="kitchen").box_for((4.0, 1.5, 2.0))
    sofa = solid("sofa", (2, 0.8, 0.9), (3, 0.4, 3), label="upholstery")
    soft = AnalyticBackend().open(box_scene((6, 3, 4), extra=(sofa,)), (1.0, 1.0, 1.0), room="kitchen")
    assert np.allclose(empty.absorption, 0.1, atol=1e-6)
    assert min(soft.box_for((4.0, 1.5, 2.0)).absorption) > 0.12


def test_an_obstacle_weakens_the_direct_sound_as_maekawas_screen():
    position, source = (4.0, 1.5, 2.0), (1.0, 1.5, 2.0)
    responses = []
    for extra in ((), (solid("screen", (0.1, 2.9, 3.0), (2.5, 1.5, 2.0)),)):
        scene = box_scene((6, 3, 4), label="plaster", extra=extra)
        session = AnalyticBackend(absorption=1 - 1e-12, images=1, tail=False).open(scene, source, room="kitchen")
        responses.append(session.impulse_response(Pose.from_yaw(position, 0.0)).astype(float))
    spectrum = [np.abs(np.fft.rfft(r[0], SR))[1000] for r in responses]
    assert spectrum[1] / spectrum[0] == pytest.approx(screen_gain()[3], rel=0.02)
    assert -20 * np.log10(screen_gain()[3]) == pytest.approx(11.7, abs=0.2)


def test_a_listener_in_the_next_room_hears_through_the_common_box():
    scene = box_scene((6, 3, 4), label="plaster")
    scene = type(scene)(scene.name, scene.parts, (*scene.rooms, Room("hall", (6.0, 0.0, 0.0), (9.0, 3.0, 4.0))), ())
    session = AnalyticBackend().open(scene, (1.0, 1.0, 2.0), room="kitchen")
    assert session.box_for((5.0, 1.5, 2.0)).high == (6.0, 3.0, 4.0)
    assert session.box_for((6.3, 1.5, 2.0)).high == (9.0, 3.0, 4.0)
    response = session.impulse_response(Pose.from_yaw((6.3, 1.5, 2.0), 0.0))
    assert np.isfinite(response).all()
    assert ild_db(*rms(response)) < 0, "the source is on the left"


def test_responses_depend_on_the_pose_alone():
    poses = [Pose.from_yaw((x, 1.5, 2.0), x) for x in (2.0, 3.0, 4.0)]
    scene = box_scene((6, 3, 4), label="wood")

    def heard(order):
        session = AnalyticBackend().open(scene, (1.0, 1.0, 1.0), room="kitchen")
        return {k: session.impulse_response(poses[k]).tobytes() for k in order}

    assert heard([0, 1, 2]) == heard([2, 1, 0])


@pytest.mark.parametrize("source", [(np.nan, 1.0, 1.0), (50.0, 1.0, 1.0)])
def test_bad_source_is_refused(source):
    with pytest.raises(Avs3dError, match="source position"):
        AnalyticBackend().open(box_scene((6, 3, 4), label="wood"), source, room="kitchen")


def test_bad_settings_are_refused():
    with pytest.raises(Avs3dError, match=r"absorption is 1\.5"):
        AnalyticBackend(absorption=1.5)
    with pytest.raises(Avs3dError, match="images is 0"):
        AnalyticBackend(images=0)
