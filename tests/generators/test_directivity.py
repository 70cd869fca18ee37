"""Directivities against closed forms: patterns and levels, the free field, images, edges, reverberation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import octave_filtered
from generators.acoustics.analytic import AnalyticBackend, Box, image_sources
from generators.acoustics.directivity import Directivity, unit_vectors
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.radiators import RADIATORS, Radiator, modelled
from generators.acoustics.soundspaces import SoundSpacesBackend
from generators.acoustics.tracer.air import energy_exponents
from generators.acoustics.tracer.arrivals import BANDS, Arrivals
from generators.acoustics.tracer.diffraction import diffracted, lit_edges
from generators.acoustics.tracer.settings import TraceSettings
from generators.core.scene import Room, Scene
from tests.generators.test_tracer_diffraction import half_plane
from tests.support.acoustic_rooms import box_scene
from tests.support.sofa_files import fibonacci
from tests.support.tracer_rooms import KHZ, LISTENER, SIZE, SOURCE, backend, box

#: A room without a surface.
NOWHERE = Scene("nowhere", (), (Room("kitchen", (-9.0, -9.0, -9.0), (9.0, 9.0, 9.0)),), ())
FEW = TraceSettings(arrivals=500, least_rays=500, rain_rays=50)
AZIMUTHS, ELEVATIONS = np.arange(-180, 180, 10.0), np.arange(-90, 91, 10.0)
CARDIOID = Directivity.cardioid()


def decibels(energy: Any) -> Any:
    return 10 * np.log10(energy)


def by_octave() -> Directivity:
    """A table whose octaves differ: (p + (1 − p)·cos θ) with p from 1 at 63 Hz to 0.5 at 8 kHz."""
    cosine = unit_vectors(AZIMUTHS[:, None], ELEVATIONS[None])[..., 2]
    shares = np.linspace(1.0, 0.5, len(BANDS))[:, None, None]
    return Directivity.table(3.0 * (shares + (1 - shares) * cosine), AZIMUTHS, ELEVATIONS, BANDS)


def random_directions(count: int) -> np.ndarray:
    found = np.random.default_rng(1).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize("order", [0, 1, 2, 5])
def test_a_cardioid_of_order_n_has_an_index_of_2n_plus_1(order: int):
    """The mean of ((1 + cos θ)/2)²ⁿ over the sphere is 1/(2n + 1)."""
    found = Directivity.cardioid(order, axis=(1, 2, -2)).index()
    assert list(found) == list(BANDS)
    assert list(found.values()) == pytest.approx([decibels(2 * order + 1)] * len(BANDS), abs=1e-3)


@pytest.mark.parametrize(("share", "index"), [(0.37, 5.70), (0.25, 6.02), (0.0, 4.77)])
def test_the_family_has_the_indices_of_the_text_books(share: float, index: float):
    """Super- and hypercardioid and dipole (J. Eargle, *The Microphone Book*, table 5-1): 5.7, 6.0 and 4.8 dB."""
    found = Directivity.cardioid(omni_share=share)
    assert found.index()[1000] == pytest.approx(index, abs=0.02)
    assert found.amplitudes([0, 0, -1])[0, KHZ] == pytest.approx(2 * share - 1)


def test_azimuth_is_positive_to_the_sources_right_and_elevation_upwards():
    # Whoever looks along +Z with Y up has −X to the right.
    angles = [(0, 0), (90, 0), (180, 0), (0, 90)]
    found = [unit_vectors(np.array(float(a)), np.array(float(e))).round(12).tolist() for a, e in angles]
    assert found == [[0, 0, 1], [-1, 0, 0], [0, 0, -1], [0, 1, 0]]


def test_a_table_is_linear_between_its_directions_and_0_db_on_its_axis():
    found = by_octave()
    directions = random_directions(2000)
    expected = np.linspace(1, 0.5, 8) + np.linspace(0, 0.5, 8) * directions[:, 2:]
    # A chord of 10° is off the cosine by 1 − cos 5° at most.
    assert np.abs(found.amplitudes(directions) - expected).max() < 0.5 * 2 * (1 - np.cos(np.radians(5)))
    assert found.amplitudes([0, 0, 7])[0] == pytest.approx(np.ones(8))
    to_the_side = Directivity.table(
        found.amplitudes(unit_vectors(AZIMUTHS[:, None], ELEVATIONS[None]).reshape(-1, 3)).T.reshape(8, 36, 19),
        AZIMUTHS,
        ELEVATIONS,
        BANDS,
        axis=(5, 0, 0),
    )
    assert to_the_side.amplitudes([1, 0, 0])[0] == pytest.approx(np.ones(8))


def test_a_table_without_poles_and_outer_octaves_goes_on_to_both():
    values = np.ones((6, 4, 3)) * np.arange(1, 7)[:, None, None]
    values[:, :, 2] *= [[2.0, 4.0, 2.0, 4.0]]
    found = Directivity.table(values, [0, 90, 180, 270], [-60, 0, 60])
    assert found.amplitudes([0, -1, 0])[0] == pytest.approx(np.ones(8)), "the outer octaves repeat the nearest"
    assert found.amplitudes([0, 1, 0])[0] == pytest.approx(np.full(8, 3.0)), "the mean over all azimuths"


@pytest.fixture
def sofa(tmp_path: Path):
    """A writer of directivities: a cardioid to the file's left, with changes."""

    def write(**changes: Any) -> Path:
        points = fibonacci(300)
        angles = np.degrees([np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2])])
        frequencies = np.array([100.0, 125, 160, 250, 500, 1000, 2000, 4000])
        response = (0.5 + 0.5 * points[:, 1])[None, :, None] * 7 * np.exp(1j * frequencies / 100)
        values: dict[str, Any] = {
            "Data.Real": response.real,
            "Data.Imag": response.imag,
            "N": frequencies,
            "ReceiverPosition": np.stack([*angles, np.full(300, 2.0)], axis=1)[:, :, None],
            "SourceView": np.array([[0.0, 1, 0]]),
            "SourceUp": np.array([[0.0, 0, 1]]),
            "SOFAConventions": "FreeFieldDirectivityTF",
            "Title": "a cardioid",
        } | changes
        path = tmp_path / "source.sofa"
        with h5py.File(path, "w") as file:
            for name, value in values.items():
                if isinstance(value, str):
                    file.attrs[name] = value
                elif value is not None:
                    file[name] = value
                    file[name].attrs["Type"] = "spherical" if name == "ReceiverPosition" else "cartesian"
        return path

    return write


def test_a_sofa_file_is_read_in_the_frame_of_its_source(sofa: Any):
    found = Directivity.sofa(sofa())
    assert found.name == "a cardioid"
    directions = random_directions(500)
    assert np.abs(found.amplitudes(directions) - CARDIOID.amplitudes(directions)).max() < 0.006
    assert found.index()[8000] == pytest.approx(4.77, abs=0.02), "above the file's frequencies the nearest octave"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"SOFAConventions": "SimpleFreeFieldHRIR"}, "its SOFA convention is SimpleFreeFieldHRIR, expected FreeFieldD"),
        ({"Data.Real": np.full((1, 300, 8), np.nan)}, "Data.Real has NaN"),
        ({"Data.Imag": None}, "has no Data.Imag"),
        ({"N": np.array([100.0, 125, 160, 250, 500, 500, 2000, 4000])}, "no frequency in the octave of 1000 Hz"),
        ({"SourceUp": np.array([[0.0, 2, 0]])}, "SourceView and SourceUp are parallel"),
        ({"ReceiverPosition": np.zeros((300, 3, 1))}, "is at the source"),
        ({"ReceiverPosition": np.tile([[[10.0], [20], [1]]], (300, 1, 1))}, "has 1 directions"),
    ],
)
def test_a_bad_sofa_file_is_one_line(sofa: Any, changes: dict[str, Any], message: str):
    with pytest.raises(Avs3dError, match=message) as caught:
        Directivity.sofa(sofa(**changes))
    assert "source.sofa" in str(caught.value)
    assert "\n" not in str(caught.value)


ONES = np.ones((6, 4, 3))
AROUND, ACROSS = [0, 90, 180, 270], [-60, 0, 60]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Directivity.cardioid(axis=(0, 0, 0)), r"axis is \(0, 0, 0\), expected three numbers"),
        (lambda: Directivity.cardioid(axis=(0, float("nan"), 1)), "axis is"),
        (lambda: Directivity.cardioid(axis=(0, 1)), "axis is"),
        (lambda: Directivity.cardioid(17), "order of the cardioid is 17, expected 0 to 16"),
        (lambda: Directivity.cardioid(1.5), "order of the cardioid is 1.5"),  # type: ignore[arg-type]
        (lambda: Directivity.cardioid(omni_share=float("nan")), "omni_share is nan, expected 0 to 1"),
        (lambda: Directivity.table([], [], []), r"amplitudes have shape \(0,\), expected \(6, 0, 0\)"),
        (lambda: Directivity.table(ONES * np.nan, AROUND, ACROSS), "amplitudes have NaN"),
        (lambda: Directivity.table(ONES, [0, 90, np.inf, 270], ACROSS), "azimuths have NaN or infinite"),
        (lambda: Directivity.table(ONES[:5], AROUND, ACROSS, [125, 250, 500, 2000, 4000]), "octave 1000 Hz is missing"),
        (lambda: Directivity.table(ONES, AROUND, ACROSS, [125, 250, 500, 1000, 2000, 4001]), "octave 4000 Hz is miss"),
        (lambda: Directivity.table(ONES, AROUND[::-1], ACROSS), "azimuths do not increase"),
        (lambda: Directivity.table(ONES, [0, 90, 180, 360], ACROSS), "leave a gap or are listed twice"),
        (lambda: Directivity.table(ONES[:, :3], [0, 90, 180], ACROSS), "leave a gap"),
        (lambda: Directivity.table(ONES[:, :, :1], AROUND, [20]), "elevations from 20° to 20°, expected −90° to 90°"),
        (lambda: Directivity.table(ONES, AROUND, [-60, 0, 95]), "elevations from -60° to 95°"),
        (lambda: Directivity.table(ONES * [[1e-9], [1], [1], [1]], AROUND, ACROSS), "all but silent on its axis"),
        (lambda: CARDIOID.amplitudes([[0, 0, 0]]), "directions have NaN, no length"),
        (lambda: CARDIOID.amplitudes([1, 2]), "expected .n, 3. vectors"),
    ],
)
def test_bad_input_is_one_line(make: Any, message: str):
    with pytest.raises(Avs3dError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_listener_who_walks_round_a_turned_source_hears_each_octave_of_each_angle():
    """The tracer in a free field: 1/r times the amplitude for the listener's direction in the source's frame."""
    found = by_octave()
    source = Pose.from_yaw((0.3, 1.0, -0.2), 0.7, -0.4)
    session = backend(FEW).open(NOWHERE, source, room="kitchen", directivity=found)
    directions = random_directions(60)
    listeners = [Pose.from_yaw(source.position + 2.0 * source.rotation_matrix @ each, 0.1) for each in directions]
    session.prepare(listeners)
    air = np.exp(-0.5 * 2.0 * energy_exponents())
    shares = np.linspace(1.0, 0.5, 8)
    for direction, listener in zip(directions, listeners, strict=True):
        heard = session.arrivals(listener)
        assert len(heard) == 1
        expected = (shares + (1 - shares) * direction[2]) * air / 2
        # Below −20 dB, linear interpolation over 10° is off by more.
        loud = expected > 0.05
        assert 2 * decibels(heard.pressure[0, loud] / expected[loud]) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("angle", [0, 60, 100, 140])
def test_the_closed_form_engine_has_a_cardioid_in_the_free_field(angle: float):
    """Walls that absorb all but a trace; the listener's head is the same, so that only the cardioid differs."""
    wide, room = box_scene((40, 40, 40), label="plaster"), "kitchen"
    engine = AnalyticBackend(absorption=1 - 1e-12, images=1, tail=False)
    listener = Pose.from_yaw((20, 20, 20), 0.0)
    plain = engine.open(wide, (20, 20, 17), room=room).impulse_response(listener)
    source = Pose.from_yaw((20, 20, 17), np.radians(angle))
    heard = engine.open(wide, source, room=room, directivity=CARDIOID).impulse_response(listener)
    for octave in (125, 500, 2000, 4000):
        one, other = (np.square(octave_filtered(each[0], 44_100, octave)).sum() for each in (plain, heard))
        expected = 20 * np.log10(0.5 + 0.5 * np.cos(np.radians(angle)))
        assert decibels(other / one) == pytest.approx(expected, abs=0.3)


def flipped(source: np.ndarray, listener: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The direction in which sound left the source of an image in the box, from the parity of the image's cell."""
    odd = np.floor(image / np.array(SIZE)).astype(int) % 2 == 1
    return np.where(odd, -1.0, 1.0) * (listener - image)


def test_each_image_of_a_box_is_as_loud_as_the_direction_in_which_its_sound_left():
    """Up to the third order, as Allen and Berkley's lattice has it."""
    pattern = Directivity.cardioid(2, axis=(1, -2, 0.5))
    pose = Pose.from_yaw(SOURCE, 0.4, 0.2)
    scene = box(0.3, 0.0)
    plain = backend(FEW).open(scene, tuple(SOURCE), room="kitchen").arrivals(Pose.from_yaw(LISTENER, 0))
    heard = backend(FEW).open(scene, pose, room="kitchen", directivity=pattern).arrivals(Pose.from_yaw(LISTENER, 0))
    early = np.flatnonzero(plain.is_spherical)
    assert len(early) > 40
    assert heard.time[early] == pytest.approx(plain.time[early], abs=0)
    images, _ = image_sources(Box((0, 0, 0), SIZE, ()), SOURCE, LISTENER, 40.0)
    for i in early:
        place = LISTENER + plain.direction[i] * plain.time[i] * SPEED_OF_SOUND
        image = images[np.linalg.norm(images - place, axis=1).argmin()]
        left = flipped(SOURCE, LISTENER, image) @ pose.rotation_matrix
        expected = pattern.amplitudes(left)[0] * plain.pressure[i]
        assert heard.pressure[i] == pytest.approx(expected, abs=2e-5 * float(plain.pressure.max()))


def test_the_closed_form_engine_hears_a_wall_that_the_source_faces_and_not_the_source():
    """The listener is behind the source: no direct sound; of images as far as that in the wall, what each sends."""
    source, place = np.array([3.0, 2.2, 1.5]), np.array([5.0, 2.0, 1.5])
    listener, pose = Pose.from_yaw(place, 0.0), Pose.from_yaw(source, -np.pi / 2)
    engine, pattern = AnalyticBackend(absorption=0.3, images=300, tail=False), Directivity.cardioid(8)
    plain = engine.open(box(0.3, 0.0), tuple(source), room="kitchen").impulse_response(listener)
    session = engine.open(box(0.3, 0.0), pose, room="kitchen", directivity=pattern)
    heard = session.impulse_response(listener)
    images, bounces = image_sources(Box((0, 0, 0), SIZE, ()), source, place, 12.0)
    distance = np.linalg.norm(images - place, axis=1)
    gain = pattern.amplitudes(np.stack([flipped(source, place, one) for one in images]) @ pose.rotation_matrix)[:, KHZ]
    levels = []
    for at in (2.01, 8.0):
        first, count = round((at / SPEED_OF_SOUND - 0.0004) * 44_100), 60
        inside = np.abs(distance - at - 0.1) < 0.2
        each = (0.7**bounces / distance**2)[inside]
        one, other = (np.square(response[:, first : first + count]).sum() for response in (plain, heard))
        levels.append((decibels(other / one), decibels((each * gain[inside] ** 2).sum() / each.sum())))
    assert levels[0][0] < -50
    assert levels[1][0] == pytest.approx(levels[1][1], abs=1.0)
    assert levels[1][1] > -6


def test_sound_round_an_edge_left_towards_the_edge():
    source, listener, found = np.array([-3.0, -1.0, 0.0]), np.array([2.0, -1.5, 1.0]), half_plane()
    plain = diffracted(found, lit_edges(found.edges, source), listener)
    heard = diffracted(found, lit_edges(found.edges, source, CARDIOID.pattern), listener)
    # Where each arrival's line from the listener meets the sheet's plane x = 0, in which all of its edges lie.
    towards = plain.direction.astype(float)
    point = listener - towards * (listener[:1] / towards[:, :1])
    assert heard.pressure == pytest.approx(CARDIOID.amplitudes(point - source) * plain.pressure, rel=1e-4)


def test_diffuse_sound_left_towards_the_place_that_scatters_it():
    """First-order rain is the integral over Lambert walls of (1 − α)·g²·cos θs/(4π ds²)·4·cos θl/dl²."""
    pattern, pose, steps, expected = Directivity.cardioid(3), Pose.from_yaw(SOURCE, 0.5, 0.3), 100, np.zeros(2)
    settings = TraceSettings(rain_order=1, rain_rays=5000, most_reflections=1, least_rays=1, arrivals=1, early_order=0)
    air = energy_exponents()[KHZ]
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        u, v = ((np.arange(steps) + 0.5) / steps * SIZE[k] for k in others)
        grid = np.zeros((steps, steps, 3))
        grid[..., others[0]], grid[..., others[1]] = u[:, None], v[None, :]
        for side in (0.0, SIZE[axis]):
            grid[..., axis] = side
            left, right = (grid - SOURCE).reshape(-1, 3), (grid - LISTENER).reshape(-1, 3)
            ds, dl = np.linalg.norm(left, axis=1), np.linalg.norm(right, axis=1)
            each = np.abs(left[:, axis]) / ds**3 * np.abs(right[:, axis]) / dl**3 * np.exp(-air * (ds + dl))
            gain = pattern.amplitudes(left @ pose.rotation_matrix)[:, KHZ]
            area = SIZE[others[0]] * SIZE[others[1]] / steps**2
            expected += 0.6 / np.pi * area * np.array([each.sum(), (each * gain**2).sum()])
    found = []
    for directed in ({}, {"directivity": pattern}):
        session = backend(settings).open(box(0.4, 1.0), pose, room="kitchen", **directed)
        heard = session.arrivals(Pose.from_yaw(LISTENER, 0))
        found.append(np.square(heard.pressure[~heard.is_spherical, KHZ], dtype=float).sum())
    assert decibels(found[1] / found[0]) == pytest.approx(decibels(expected[1] / expected[0]), abs=0.3)


def late_energy(arrivals: Arrivals, after: float) -> np.ndarray:
    late = arrivals.time > after
    return np.square(arrivals.pressure[late], dtype=float).sum(axis=0)


def test_the_reverberation_is_lower_by_the_directivity_index():
    """Diffuse walls, the mean over turns of the source and places: −10·lg(2n + 1) in every octave."""
    scene, settings = box(0.2, 1.0), TraceSettings(arrivals=4000, least_rays=4000, rain_order=0)
    listeners = [Pose.from_yaw(place, 0) for place in (LISTENER, (2.0, 3.0, 1.0), (5.0, 1.0, 1.2))]

    def level(source: Any, **directed: Any) -> np.ndarray:
        session = backend(settings).open(scene, source, room="kitchen", **directed)
        session.prepare(listeners)
        return sum(late_energy(session.arrivals(one), 0.05) for one in listeners)

    plain = level(tuple(SOURCE))
    turned = [Pose.from_yaw(SOURCE, yaw, 0.3) for yaw in (0.3, 1.9, 3.4, 5.0)]
    for pattern in (CARDIOID, by_octave()):
        heard = np.mean([level(pose, directivity=pattern) for pose in turned], axis=0)
        assert decibels(heard / plain) == pytest.approx(-np.array(list(pattern.index().values())), abs=0.3)


def test_the_tail_of_the_closed_form_engine_is_lower_by_the_directivity_index():
    scene, listener = box(0.2, 1.0), Pose.from_yaw(LISTENER, 0)
    engine = AnalyticBackend(images=50)
    plain = engine.open(scene, tuple(SOURCE), room="kitchen").impulse_response(listener)[:, 4000:]
    session = engine.open(scene, Pose.from_yaw(SOURCE, 1.0), room="kitchen", directivity=by_octave())
    heard = session.impulse_response(listener)[:, 4000:]
    for octave, index in list(by_octave().index().items())[1:-1]:
        one, other = (np.square(octave_filtered(each[0], 44_100, octave)).sum() for each in (plain, heard))
        assert decibels(other / one) == pytest.approx(-index, abs=0.3)


def bytes_of(arrivals: Arrivals) -> bytes:
    return b"".join(getattr(arrivals, name).tobytes() for name in ("time", "direction", "pressure"))


def test_without_a_directivity_nothing_depends_on_the_turn_and_order_0_changes_no_bit():
    listener, room = Pose.from_yaw(LISTENER, 0.0), {"room": "kitchen"}
    plain = backend(FEW).open(box(), tuple(SOURCE), **room)
    reference = bytes_of(plain.arrivals(listener))
    plain.move_source(Pose.from_yaw(SOURCE, 2.0))
    assert bytes_of(plain.arrivals(listener)) == reference
    same = backend(FEW).open(box(), Pose.from_yaw(SOURCE, 2.0), **room, directivity=Directivity.cardioid(0))
    assert bytes_of(same.arrivals(listener)) == reference


def test_a_source_that_turns_on_the_spot_is_heard_as_one_that_was_opened_so():
    listener, turns = Pose.from_yaw(LISTENER, 0.0), [Pose.from_yaw(SOURCE, yaw) for yaw in (0.0, 1.0, 2.0)]
    moved = backend(FEW).open(box(), turns[0], room="kitchen", directivity=CARDIOID)
    found = {}
    for pose in (*turns, turns[0]):
        moved.move_source(pose)
        found.setdefault(pose, set()).add(bytes_of(moved.arrivals(listener)))
    for pose in turns:
        fresh = backend(FEW).open(box(), pose, room="kitchen", directivity=CARDIOID)
        assert found[pose] == {bytes_of(fresh.arrivals(listener))}
    assert len(set().union(*found.values())) == 3


def test_each_of_the_seven_categories_has_a_model():
    from avs3d_bench.contract.taxonomy import CATEGORIES

    assert set(RADIATORS) == set(CATEGORIES)
    for category, radiator in RADIATORS.items():
        found = modelled(category)
        assert found is not None
        front, back = found.amplitudes([radiator.axis, np.negative(radiator.axis)])
        assert front == pytest.approx(np.ones(8), abs=1e-6)
        assert (np.diff(back) < 0.01).all(), "the shadow behind grows with frequency"
        assert 20 * np.log10(back[-1]) < -5
        # Half of the sphere: a surface whose patches are all on one side sends no more than 3 dB more to the front.
        assert max(found.index().values()) < 3.2
    assert modelled("dishwasher") is None


def test_a_body_that_radiates_all_over_is_alike_in_all_directions_and_a_small_one_too():
    angles = np.linspace(0, np.pi, 7)
    whole = Radiator("all of it", (0.5, 0.5, 0.5), 4 * np.pi * 0.3102**2, (0, 0, 1)).profile(angles)
    assert decibels(whole / whole[0]) == pytest.approx(0, abs=0.1)
    # ka = 0.006 at 63 Hz.
    small = Radiator("one side", (0.01, 0.01, 0.01), 1e-5, (0, 0, 1)).profile(angles)
    assert decibels(small / small[0])[:, 0] == pytest.approx(0, abs=0.05)


def test_the_engine_without_directivities_says_so():
    engine = SoundSpacesBackend.__new__(SoundSpacesBackend)  # the package need not be installed
    with pytest.raises(
        Avs3dError, match="nowhere: the soundspaces engine has only sources that are alike in all direct"
    ):
        engine.open(NOWHERE, (0, 0, 0), room="kitchen", directivity=CARDIOID)
