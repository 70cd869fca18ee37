"""Measured heads: SOFA files made from the sphere's closed form are heard as that sphere; broken ones get one line."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import dump_json
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.hrtf import HEAD_RADIUS
from generators.acoustics.receivers import choose_receivers
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.receivers.measured import SofaHead, grid_directions
from generators.acoustics.tracer.receivers.sofa import read_hrirs
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.acoustics.tracer.receivers.sphere_mesh import SphereMesh
from generators.backends import acoustic_backend
from generators.observation.record import describe_head
from generators.options import EngineOptions
from tests.support.sofa_files import RATE, fibonacci, sphere_impulses, write, write_sphere
from tests.support.tiers import some

h5py = pytest.importorskip("h5py", reason="h5py is not installed: pip install 'avs3d-bench[sofa]'")


@pytest.fixture(scope="module")
def sphere_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sphere(tmp_path_factory.mktemp("sofa") / "sphere.sofa")


@pytest.fixture(scope="module")
def sphere(sphere_file: Path) -> SofaHead:
    return SofaHead(sphere_file)


def one(direction, time: float = 0.05) -> Arrivals:
    return Arrivals(np.array([time]), np.array([direction], dtype=np.float32), np.ones((1, 8), dtype=np.float32))


def spectrum(response, frequencies, time: float = 0.05, rate: int = RATE) -> np.ndarray:
    n = np.arange(response.shape[1]) / rate - time
    return response.astype(np.float64) @ np.exp(-2j * np.pi * np.outer(n, frequencies))


def compare(head: SofaHead, direction, rate: int = RATE, highest: float = 16_000) -> tuple[np.ndarray, np.ndarray]:
    """Per octave: levels of both ears re the exact sphere (8, 2) in dB, and interaural delays re it (8,) in s."""
    response = head.response(one(direction), np.eye(3), rate)
    levels, delays = [], []
    for middle in BANDS:
        frequencies = np.linspace(middle / math.sqrt(2), min(middle * math.sqrt(2), highest), 30)
        found = spectrum(response, frequencies, rate=rate)
        ka = 2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND
        exact = sphere_response([math.acos(-direction[0]), math.acos(direction[0])], ka)
        levels.append(10 * np.log10(np.mean(np.abs(found) ** 2, axis=1) / np.mean(np.abs(exact) ** 2, axis=1)))
        cross = np.sum(found[0] * np.conj(found[1]) * np.conj(exact[0] * np.conj(exact[1])))
        delays.append(np.angle(cross) / (2 * np.pi * middle))
    return np.array(levels), np.array(delays)


#: Not straight from the side: the bright spot at the averted ear is narrower than the steps of the files.
DIRECTIONS = [(0, 0, -1), (0.8, 0, -0.6), (-0.6, 0, -0.8), (0.36, 0.48, 0.8), (0, 1, 0), (-0.6, -0.8, 0), (0, 0, 1)]


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_measured_sphere_is_heard_as_the_sphere(sphere: SofaHead, direction) -> None:
    levels, delays = compare(sphere, direction)
    # The gain of the file, 0.2, and its time zero are gone.
    assert np.abs(levels).max() < 0.7
    assert np.abs(levels[:, 1] - levels[:, 0]).max() < 0.7
    assert np.abs(delays).max() < 12e-6


def test_straight_from_the_side_the_octaves_up_to_2_khz_agree(sphere: SofaHead) -> None:
    levels, delays = compare(sphere, (1, 0, 0))
    assert np.abs(levels[:6]).max() < 0.3
    assert np.abs(delays[:6]).max() < 10e-6


def test_the_gain_is_told(sphere: SofaHead) -> None:
    told = sphere.describe()
    assert told["hrtf_gain_db"] == pytest.approx(20 * math.log10(5), abs=0.05)
    assert told["hrtf_licence"] == "CC0"
    assert told["head"] == "A rigid sphere"
    assert told["hrtf_sample_rate_hz"] == RATE


def test_the_head_hears_at_the_time_of_its_centre(sphere: SofaHead) -> None:
    # From above both ears are on the same circle of the sphere.
    response = sphere.response(one((0, 1, 0), 0.03), np.eye(3), RATE)
    frequencies = np.array([125.0, 500.0, 2000.0])
    found = spectrum(response, frequencies, 0.03)[0]
    exact = sphere_response([math.pi / 2], 2 * np.pi * frequencies * HEAD_RADIUS / SPEED_OF_SOUND)[0]
    assert np.abs(np.angle(found / exact) / (2 * np.pi * frequencies)).max() < 15e-6


@pytest.mark.parametrize(
    ("stored", "wanted"), some([(48_000, 44_100), (96_000, 44_100), (44_100, 48_000), (32_000, 44_100)], every=4)
)
def test_any_sample_rate_is_resampled(tmp_path: Path, stored: int, wanted: int) -> None:
    points = fibonacci(400)
    head = SofaHead(write(tmp_path / "sphere.sofa", points, sphere_impulses(points, stored), stored))
    for direction in DIRECTIONS[:3]:
        # A file with a sample rate of 32 kHz ends below 16 kHz.
        levels, delays = compare(head, direction, wanted, min(stored / 2 * 0.85, 16_000))
        assert np.abs(levels).max() < 0.9
        assert np.abs(delays).max() < 20e-6


def test_above_the_file_s_nyquist_frequency_the_head_is_silent(tmp_path: Path) -> None:
    points = fibonacci(300)
    head = SofaHead(write(tmp_path / "phone.sofa", points, sphere_impulses(points, 8000), 8000))
    levels, _ = compare(head, (-0.6, 0, -0.8))
    assert np.abs(levels[:5]).max() < 0.5
    found = spectrum(head.response(one((-0.6, 0, -0.8)), np.eye(3), RATE), np.array([5000.0, 8000, 15_000]))
    assert np.abs(found).max() < 0.03


def test_the_right_ear_may_come_first(tmp_path: Path) -> None:
    points = fibonacci(300)
    impulses = sphere_impulses(points, RATE)[:, ::-1]
    swapped = np.array([[0, -0.09, 0], [0, 0.09, 0]])[:, :, None]
    head = SofaHead(write(tmp_path / "swapped.sofa", points, impulses, ReceiverPosition=swapped))
    response = head.response(one((-1, 0, 0)), np.eye(3), RATE)
    assert (response[0] ** 2).sum() > 2 * (response[1] ** 2).sum(), "from the left"


def test_positions_may_be_cartesian_and_the_listener_may_look_elsewhere(tmp_path: Path, sphere_file: Path) -> None:
    points = fibonacci(300)
    impulses = sphere_impulses(points, RATE)
    plain = read_hrirs(write(tmp_path / "plain.sofa", points, impulses))
    # The same set-up with a listener 2 m along x that looks along y: every point turns by 90° and moves.
    turned = np.stack([-points[:, 1], points[:, 0], points[:, 2]], axis=1) * 1.5 + [2, 0, 0]
    other = read_hrirs(
        write(
            tmp_path / "turned.sofa",
            points,
            impulses,
            SourcePosition=(turned, "cartesian"),
            ListenerPosition=np.array([[2.0, 0, 0]]),
            ListenerView=np.array([[0.0, 1, 0]]),
        )
    )
    np.testing.assert_allclose(other.directions, plain.directions, atol=1e-6)
    # x forward, y left, z up became x right, y up, z backward.
    np.testing.assert_allclose(plain.directions, points[:, [1, 2, 0]] * [-1, 1, -1], atol=1e-6)


def test_delays_beside_the_responses_count(tmp_path: Path) -> None:
    points = fibonacci(300)
    impulses = sphere_impulses(points, RATE)
    shift = 20
    early = np.concatenate([impulses[:, :, shift:], np.zeros((300, 2, shift))], axis=2)
    # The left ear's responses begin earlier in the file and have a delay instead.
    mixed = np.stack([early[:, 0], impulses[:, 1]], axis=1)
    head = SofaHead(write(tmp_path / "delay.sofa", points, mixed, Data_Delay=np.array([[shift, 0.0]])))
    _, delays = compare(head, (-0.6, 0, -0.8))
    assert np.abs(delays).max() < 15e-6


def test_a_direction_measured_twice_counts_once(tmp_path: Path) -> None:
    points = fibonacci(300)
    impulses = sphere_impulses(points, RATE)
    twice = write(
        tmp_path / "twice.sofa", np.concatenate([points, points[:50]]), np.concatenate([impulses, impulses[:50]])
    )
    assert len(read_hrirs(twice).directions) == 300


@pytest.mark.slow
def test_a_set_without_what_is_below_is_heard_there_too(tmp_path: Path) -> None:
    points = fibonacci(900)
    points = points[points[:, 2] > -math.sin(math.radians(40))]
    head = SofaHead(write(tmp_path / "cap.sofa", points, sphere_impulses(points, RATE)))
    levels, delays = compare(head, (0.0, -1.0, 0.0))
    assert np.abs(levels[:6]).max() < 1.5
    assert np.abs(delays).max() < 30e-6


def test_the_same_file_gives_the_same_bytes(sphere_file: Path) -> None:
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    arrivals = Arrivals(0.2 * rng.random(200), directions.astype(np.float32), np.ones((200, 8), dtype=np.float32))
    first = SofaHead(sphere_file).response(arrivals, np.eye(3), RATE)
    assert first.tobytes() == SofaHead(sphere_file).response(arrivals, np.eye(3), RATE).tobytes()
    assert np.isfinite(first).all()


# Directions


def test_solid_angles_cover_the_sphere_evenly() -> None:
    mesh = SphereMesh.of(fibonacci(500), "test")
    angles = mesh.solid_angles()
    assert angles.sum() == pytest.approx(4 * np.pi)
    assert angles.std() < 0.1 * angles.mean()


def test_interpolation_is_exact_at_the_points_and_for_linear_functions() -> None:
    points = fibonacci(200)
    mesh = SphereMesh.of(points, "test")
    corners, weights = mesh.interpolation(points)
    np.testing.assert_allclose(np.einsum("nc,nci->ni", weights, points[corners]), points, atol=1e-9)
    corners, weights = mesh.interpolation(grid_directions())
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    mean = np.einsum("nc,nci->ni", weights, points[corners])
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    np.testing.assert_allclose(mean, grid_directions(), atol=1e-9)


# Files that cannot be used


def sphere_of(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    points = fibonacci(count)
    return points, sphere_impulses(points, RATE, 128)


def broken(tmp_path: Path, kind: str) -> Path:
    path = tmp_path / "head.sofa"
    points, impulses = sphere_of()
    if kind == "nan":
        impulses[3, 1, 5] = np.nan
    elif kind == "silent":
        impulses[7, 0] = 0
    elif kind == "one ear":
        impulses = impulses[:, :1]
    elif kind == "half":
        points, impulses = points[points[:, 2] > 0.3], impulses[points[:, 2] > 0.3]
    elif kind == "plane":
        points[:, 2] = 0
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    elif kind == "three":
        points, impulses = points[:3], impulses[:3]
    elif kind == "long":
        impulses = np.concatenate([impulses] * 60, axis=2)
    return write(path, points, impulses)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("nan", "Data.IR has NaN, infinite or missing values"),
        ("silent", "Data.IR of measurement 7, receiver 0 is silent"),
        ("one ear", "Data.IR has 1 receiver, expected two ears"),
        ("half", "leave a hole of"),
        ("plane", "lie in one plane"),
        ("three", "has 3 directions"),
        ("long", "expected at most 100 ms"),
    ],
)
def test_a_file_without_a_head_gets_one_line(tmp_path: Path, kind: str, message: str) -> None:
    path = broken(tmp_path, kind)
    with pytest.raises(Avs3dError) as caught:
        SofaHead(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"Data_SamplingRate": 4000.0}, "Data.SamplingRate is [4000.0]"),
        ({"Data_Delay": np.array([[-1.0, 0]])}, "Data.Delay spans -1 to 0 samples"),
        ({"ListenerView": np.array([[0.0, 0, 1]])}, "ListenerView and ListenerUp are parallel"),
        ({"SourcePosition": np.zeros((60, 3))}, "is at the listener"),
        ({"SourcePosition": np.full((60, 3), np.nan)}, "SourcePosition has NaN"),
        ({"SourcePosition": (np.ones((60, 3)), "polar")}, "the Type of SourcePosition is 'polar'"),
        ({"SourcePosition": np.ones((60, 2))}, "SourcePosition has shape (60, 2), expected (n, 3)"),
        ({"SourcePosition": np.ones((7, 3))}, "SourcePosition has shape (7, 3), expected (60, 3)"),
        ({"SourcePosition": None}, "has no SourcePosition"),
        ({"Data_IR": None}, "has no Data.IR"),
        ({"Data_IR": np.full((60, 2, 64), 9.96921e36)}, "missing values"),
        ({"Data_IR": np.ones((60, 2, 4))}, "Data.IR has 4 samples, expected at least 16"),
        ({"Data_IR": np.zeros((60, 2, 0))}, "Data.IR is empty"),
        ({"Data_IR": np.array([b"a", b"b"])}, "Data.IR is no array of numbers"),
        ({"Data_IR": np.ones((60, 2, 64, 2))}, "Data.IR has shape (60, 2, 64, 2), expected 3 dimensions"),
    ],
)
def test_wrong_fields_get_one_line(tmp_path: Path, fields: dict[str, Any], message: str) -> None:
    points, impulses = sphere_of()
    path = write(tmp_path / "head.sofa", points, impulses, **fields)
    with pytest.raises(Avs3dError) as caught:
        SofaHead(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_and_texts_that_are_no_utf_8_become_readable(tmp_path: Path) -> None:
    path = write(tmp_path / os.fsdecode(b"K\xf6pfe.sofa"), *sphere_of())
    with h5py.File(path, "r+") as file:
        file.attrs["Title"] = np.bytes_(b"K\xf6pfe")
        for name, text in ((b"License", b"CC-BY 4.0 \xff"), (b"Organization", b"Universit\xe4t"), (b"\xfe", b"\xfe")):
            file.attrs.create(name, text, dtype=h5py.string_dtype())
    receivers = choose_receivers("tracer", hrtf=path)
    record = describe_head(receivers)
    assert record is not None
    assert (record.asset, record.title) == ("hrtf:K\N{REPLACEMENT CHARACTER}pfe.sofa", "K\N{REPLACEMENT CHARACTER}pfe")
    assert record.author == "Universit\N{REPLACEMENT CHARACTER}t"
    assert record.name == "CC-BY 4.0 \N{REPLACEMENT CHARACTER}"
    assert record.source == "K\N{REPLACEMENT CHARACTER}pfe.sofa"
    settings = acoustic_backend(EngineOptions(audio="tracer", receivers=receivers)).describe()
    assert settings["hrtf_file"] == record.source
    for document in (record, settings):
        assert "\N{REPLACEMENT CHARACTER}" in dump_json(document).encode().decode()


def test_a_head_without_a_title_has_the_same_name_in_every_file(tmp_path: Path) -> None:
    for name in ("one.sofa", "two.sofa"):
        path = write(tmp_path / name, *sphere_of(), Title=None)
        assert SofaHead(path).hrirs.name == "not stated in the file"


def test_another_convention_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "array.sofa", *sphere_of(), SOFAConventions="GeneralFIR")
    with pytest.raises(Avs3dError, match="its SOFA convention is GeneralFIR, expected SimpleFreeFieldHRIR"):
        SofaHead(path)


def test_what_is_no_sofa_file_gets_one_line(tmp_path: Path) -> None:
    text = tmp_path / "head.sofa"
    text.write_text("no SOFA")
    cut = tmp_path / "cut.sofa"
    cut.write_bytes(write(tmp_path / "whole.sofa", *sphere_of()).read_bytes()[:3000])
    other = tmp_path / "head.wav"
    other.write_bytes(b"RIFF")
    for path, message in (
        (text, "cannot be read as a SOFA file"),
        (cut, "cannot be read as a SOFA file"),
        (other, "cannot be read as a SOFA file"),
        (tmp_path / "none.sofa", "none.sofa"),
        (tmp_path, str(tmp_path)),
    ):
        with pytest.raises(Avs3dError) as caught:
            SofaHead(path)
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


def test_without_h5py_the_extra_is_named(tmp_path: Path, sphere_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(Avs3dError, match=r"h5py is not installed; .*pip install 'avs3d-bench\[sofa\]'"):
        SofaHead(sphere_file)
