"""The SoundSpaces engine: closed forms, determinism, and the check that stops invalid numbers before the engine."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import eyring, reverberation_time
from avs3d_bench.measures.levels import ild_db
from generators.acoustics.clips import rms
from generators.acoustics.geometry import acoustic_mesh, blocked, reflections_to_decay
from generators.core.scene import Part, Room, Scene
from tests.support.acoustic_rooms import box_scene, solid, with_absorption

pytest.importorskip("rlr_audio_propagation", reason="the acoustic engine (extra soundspaces) is not installed")
from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend

ROOT = Path(__file__).resolve().parents[2]
CENTRE = np.array([20.0, 20.0, 20.0])
#: Few rays: in an absorbing box only the direct sound is left.
DIRECT = RaySettings(reflections=1000, min_rays=50, max_rays=50)
#: notes of the engine: azimuth to the right in degrees → ILD in dB in an absorbing box at 1.5 m.
ILD_TABLE = {0: 0.0, 15: 5.0, 30: 9.4, 45: 12.4, 60: 12.9, 75: 11.9, 90: 11.5}


@pytest.fixture
def free_field(monkeypatch):
    """A session in a 40 m box that absorbs everything, the source at an offset from the middle."""
    with_absorption(monkeypatch, 1.0)
    scene = box_scene((40, 40, 40))

    def respond(offset, yaw=0.0):
        session = SoundSpacesBackend(DIRECT).open(scene, tuple(CENTRE + offset), room="kitchen")
        response = session.impulse_response(Pose.from_yaw(CENTRE, yaw)).astype(float)
        session.close()
        return response

    return respond


def at_azimuth(degrees, distance=1.5):
    a = np.radians(degrees)
    return np.array([distance * np.sin(a), 0.0, -distance * np.cos(a)])


@pytest.mark.parametrize(("azimuth", "expected"), ILD_TABLE.items())
def test_ild_follows_the_measured_table_and_is_antisymmetric(free_field, azimuth, expected):
    right, left = ild_db(*rms(free_field(at_azimuth(azimuth)))), ild_db(*rms(free_field(at_azimuth(-azimuth))))
    assert right == pytest.approx(expected, abs=1.0)
    assert left == pytest.approx(-right, abs=0.1)


def test_turning_left_moves_a_source_ahead_to_the_right_ear(free_field):
    assert ild_db(*rms(free_field(at_azimuth(0), yaw=np.radians(45)))) == pytest.approx(ILD_TABLE[45], abs=1.0)


def test_direct_level_falls_with_distance_and_arrives_at_r_over_c(free_field):
    distances = np.array([1.5, 3.0, 5.0, 10.0])
    responses = [free_field((0, 0, -r)) for r in distances]
    level = np.array([10 * np.log10((h**2).sum()) for h in responses]) + 20 * np.log10(distances)
    assert np.ptp(level) < 0.3
    for r, response in zip(distances[:3], responses, strict=False):
        onset = int(np.argmax(np.abs(response).max(axis=0) > 1e-4 * np.abs(response).max()))
        assert abs(onset - r / 343 * 44_100) <= 2


def test_an_omnidirectional_listener_hears_1_over_r():
    """Softened below 1 m by the engine."""
    free = Scene("free", (), (Room("kitchen", (0, 0, 0), (5, 5, 5)),), ())
    backend = SoundSpacesBackend(DIRECT, omni=True)
    assert backend.describe()["hrtf"] == "none"
    session = backend.open(free, (0.0, 0.0, 0.0), room="kitchen")
    for r in (2.0, 4.0):
        response = session.impulse_response(Pose.from_yaw((0.0, 0.0, r), 1.0))
        assert response.shape[0] == 1
        assert 20 * np.log10(np.linalg.norm(response.astype(float)) * r) == pytest.approx(0, abs=0.1)


def test_reverberation_time_follows_eyring(monkeypatch):
    with_absorption(monkeypatch, 0.2)
    session = SoundSpacesBackend().open(box_scene((6, 3, 4)), (1.0, 1.0, 1.0), room="kitchen")
    responses = [session.impulse_response(Pose.from_yaw(p, 0.3)) for p in ((4, 1.5, 2.5), (2.5, 1.5, 3.2))]
    expected = eyring(72.0, 2 * (18 + 12 + 24), 0.2)
    assert reverberation_time(responses, 44_100) == pytest.approx(expected, rel=0.15)


def test_broadband_level_is_steady_within_two_tenths_of_a_decibel():
    session = SoundSpacesBackend().open(box_scene((4, 2.7, 3.2), label="plaster"), (0.8, 0.9, 0.6), room="kitchen")
    pose = Pose.from_yaw((3.0, 1.5, 2.2), 0.4)
    levels = [10 * np.log10((session.impulse_response(pose).astype(float) ** 2).sum()) for _ in range(8)]
    assert np.std(levels) <= 0.2


DIGEST = """
import hashlib
from tests.support.acoustic_rooms import box_scene
from avs3d_bench.geometry import Pose
from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend
session = SoundSpacesBackend(RaySettings(reflections=5000, min_rays=100)).open(
    box_scene((5, 3, 4), label="wood"), (1.0, 1.0, 1.0), room="kitchen")
digest = hashlib.sha256()
for x in (2.0, 3.0, 4.0):
    digest.update(session.impulse_response(Pose.from_yaw((x, 1.5, 2.0), 0.1 * x)).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_same_sequence_gives_the_same_bytes_in_another_process_and_prints_nothing_else():
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    runs = [
        subprocess.run(
            [sys.executable, "-c", DIGEST], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
    assert len(runs[0].split()) == 1, "the engine's own output leaked"
    session = SoundSpacesBackend(RaySettings(reflections=5000, min_rays=100)).open(
        box_scene((5, 3, 4), label="wood"), (1.0, 1.0, 1.0), room="kitchen"
    )
    digest = hashlib.sha256()
    for x in (2.0, 3.0, 4.0):
        digest.update(session.impulse_response(Pose.from_yaw((x, 1.5, 2.0), 0.1 * x)).tobytes())
    assert digest.hexdigest() == runs[0].strip()


def test_descriptor_1_is_quiet_and_comes_back(capfd):
    SoundSpacesBackend(DIRECT).open(box_scene((3, 3, 3), label="tile"), (1.0, 1.0, 1.0), room="kitchen")
    os.write(1, b"still here\n")
    assert capfd.readouterr().out == "still here\n"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ((float("nan"), 1.0, 1.0), "source position .* is not finite"),
        ((1.0, float("inf"), 1.0), "source position .* is not finite"),
        ((99.0, 1.0, 1.0), r"source position .* lies outside the scene, which spans"),
    ],
)
def test_bad_source_never_reaches_the_engine(source, message):
    with pytest.raises(Avs3dError, match=message):
        SoundSpacesBackend(DIRECT).open(box_scene((3, 3, 3), label="tile"), source, room="kitchen")


@pytest.mark.parametrize("rate", [0, 8001, 96_000])
def test_sample_rates_that_abort_the_engine_are_refused(rate):
    with pytest.raises(Avs3dError, match="sample rate"):
        SoundSpacesBackend(DIRECT).open(
            box_scene((3, 3, 3), label="tile"), (1.0, 1.0, 1.0), room="kitchen", sample_rate=rate
        )


def test_listener_outside_and_closed_session_are_refused():
    session = SoundSpacesBackend(DIRECT).open(box_scene((3, 3, 3), label="tile"), (1.0, 1.0, 1.0), room="kitchen")
    with pytest.raises(Avs3dError, match=r"listener position .* outside the scene"):
        session.impulse_response(Pose.from_yaw((1.0, 1.5, 30.0), 0.0))
    with pytest.raises(Avs3dError, match="not finite"):
        Pose((float("nan"), 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    session.close()
    with pytest.raises(Avs3dError, match="closed"):
        session.impulse_response(Pose.from_yaw((1.0, 1.5, 2.0), 0.0))


def test_nan_in_a_mesh_is_named():
    part = solid("broken", (1, 1, 1), (1, 1, 1))
    part.mesh.acoustic_positions[3, 1, 2] = np.nan
    with pytest.raises(Avs3dError, match="part 'broken' has acoustic vertices that are NaN"):
        SoundSpacesBackend(DIRECT).open(box_scene((3, 3, 3), extra=(part,)), (2.0, 1.0, 2.0), room="kitchen")


def test_ray_settings_out_of_range_are_refused():
    with pytest.raises(Avs3dError, match="reflections is 0"):
        RaySettings(reflections=0)


def test_missing_package_names_the_extra_and_the_alternative(monkeypatch):
    monkeypatch.setitem(sys.modules, "rlr_audio_propagation", None)
    with pytest.raises(Avs3dError, match=r"pip install 'avs3d-bench\[soundspaces\]', or use --audio tracer"):
        SoundSpacesBackend()


def test_the_sounding_object_does_not_wall_its_source_in():
    body = solid("washing machine", (0.6, 0.85, 0.6), (1.0, 0.425, 1.0), label="metal", instance_id=1)
    scene = box_scene((4, 3, 4), label="plaster", extra=(body,))
    session = SoundSpacesBackend(DIRECT).open(scene, (1.0, 0.5, 1.0), room="kitchen")
    assert np.abs(session.impulse_response(Pose.from_yaw((3.0, 1.5, 3.0), 0.0))).max() > 0.1
    cupboard = Part("cupboard", body.mesh)
    scene = box_scene((4, 3, 4), label="plaster", extra=(cupboard,))
    session = SoundSpacesBackend(DIRECT).open(scene, (1.0, 0.5, 1.0), room="kitchen")
    with pytest.raises(Avs3dError, match=r"source at \(1.0, 0.5, 1.0\) is in a wall or another closed body"):
        session.impulse_response(Pose.from_yaw((3.0, 1.5, 3.0), 0.0))


def test_faces_are_welded_and_grouped_by_label():
    extra = (solid("a", (1, 1, 1), (1, 1, 1), label="wood"), solid("b", (1, 1, 1), (2, 1, 1), label="unheard of"))
    mesh = acoustic_mesh(box_scene((4, 3, 4), label="plaster", extra=extra), (3.0, 1.0, 3.0))
    assert {label: len(faces) for label, faces in mesh.groups.items()} == {"default": 12, "plaster": 12, "wood": 12}
    assert len(mesh.vertices) == 8 + 12, "the two boxes share four corners"
    assert all(faces.max() < len(mesh.vertices) for faces in mesh.groups.values())


def test_depth_follows_the_absorption(monkeypatch):
    with_absorption(monkeypatch, 0.2)
    scene = box_scene((6, 3, 4))
    mesh = acoustic_mesh(scene, (1.0, 1.0, 1.0))
    # 10·lg(1 / 0.8) = 0.969 dB per reflection
    assert reflections_to_decay(mesh, scene.rooms[0], 60.0, 500) == 62
    assert reflections_to_decay(mesh, scene.rooms[0], 60.0, 40) == 40


def test_line_of_sight():
    wall = solid("wall", (0.1, 2.0, 2.0), (2.0, 1.0, 2.0)).mesh.acoustic_positions.astype(float)
    assert blocked(wall, np.array([0.5, 1.0, 2.0]), np.array([3.5, 1.0, 2.0]))
    assert not blocked(wall, np.array([0.5, 2.5, 2.0]), np.array([3.5, 2.5, 2.0]))
    assert not blocked(wall, np.array([0.5, 1.0, 2.0]), np.array([1.5, 1.0, 2.0]))
    assert not blocked(np.zeros((0, 3, 3)), np.zeros(3), np.ones(3))
