"""The tracer as a backend: the same bytes in any order, and clear answers to bad input."""

import multiprocessing

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import eyring
from generators.acoustics.materials import spectral_label
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.settings import TraceSettings
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, Scene
from tests.support.acoustic_rooms import box_scene, solid
from tests.support.tracer_rooms import (
    LISTENER,
    SIZE,
    SOURCE,
    Omni,
    backend,
    box,
    decay_time,
    energies,
    label,
    without_air,
)

FEW = TraceSettings(arrivals=500, least_rays=500, rain_rays=50)
SOURCE_ = tuple(SOURCE.tolist())
POSES = [Pose.from_yaw(LISTENER + (0, 0, -0.1 * k), 0.3 * k) for k in range(6)]


def opened(scene=None, source=SOURCE_, settings=FEW, **kwargs):
    return backend(settings, **kwargs).open(scene or box(), source, room="kitchen")


def bytes_of(arrivals):
    return b"".join(getattr(arrivals, name).tobytes() for name in ("time", "direction", "pressure"))


def test_bytes_do_not_depend_on_order_batch_or_threads():
    reference = [bytes_of(opened().arrivals(pose)) for pose in POSES]
    assert len(set(reference)) == len(POSES)
    forward = opened()
    assert [bytes_of(forward.arrivals(pose)) for pose in POSES] == reference
    backward = opened(threads=3)
    backward.prepare(POSES)
    assert [bytes_of(backward.arrivals(pose)) for pose in POSES[::-1]] == reference[::-1]
    moved = opened(source=(2.0, 2.0, 2.0))
    moved.arrivals(POSES[0])
    moved.move_source(SOURCE_)
    assert bytes_of(moved.arrivals(POSES[0])) == reference[0]
    # An unannounced pose between announced ones.
    mixed = opened()
    mixed.prepare(POSES[:2])
    assert [bytes_of(mixed.arrivals(POSES[k])) for k in (0, 5, 1)] == [reference[k] for k in (0, 5, 1)]


def test_announced_poses_share_a_trace(monkeypatch):
    from generators.acoustics.tracer import session as module

    traces = []
    plain = module.trace
    monkeypatch.setattr(module, "trace", lambda *given: traces.append(len(given[2])) or plain(*given))
    monkeypatch.setattr(module, "_BATCH", 4)
    session = opened()
    session.prepare(POSES)
    for pose in (*POSES, POSES[-1]):
        session.arrivals(pose)
    assert traces == [4, 2]


def test_a_moving_source_is_traced_once_per_place(monkeypatch):
    """Each pose hears three places, those of the second before, of this one and of the next (see `moving_clip`)."""
    from generators.acoustics.tracer import session as module

    traces = []
    plain = module.trace
    monkeypatch.setattr(module, "trace", lambda *given: traces.append(len(given[2])) or plain(*given))
    places = [(1.0 + 0.1 * k, 1.2, 1.3) for k in range(7)]
    session = opened(source=places[0])
    session.prepare(POSES, together=3)
    heard = {}
    for index, pose in enumerate(POSES):
        for place in range(max(index - 1, 0), index + 2):
            session.move_source(places[place])
            heard[place, index] = bytes_of(session.arrivals(pose))
    assert len(traces) == 7
    assert heard[3, 4] == bytes_of(opened(source=places[3]).arrivals(POSES[4]))


def test_rotation_is_the_receivers_business():
    session = opened()
    here = tuple(LISTENER.tolist())
    assert session.arrivals(Pose.from_yaw(here, 0.0)) is session.arrivals(Pose.from_yaw(here, 1.0))


def test_the_response_is_the_receivers():
    seen = []

    class Receiver(Omni):
        def response(self, arrivals, rotation, sample_rate):
            seen.append((arrivals, rotation, sample_rate))
            return np.ones((4, 7), dtype=np.float32)

    session = TracerBackend(Receiver(), FEW).open(box(), SOURCE_, room="kitchen", sample_rate=48_000)
    assert session.impulse_response(POSES[2]).shape == (4, 7)
    arrivals, rotation, rate = seen[0]
    assert bytes_of(arrivals) == bytes_of(session.arrivals(POSES[2]))
    assert np.array_equal(rotation, POSES[2].rotation_matrix)
    assert rate == 48_000


def test_another_seed_is_another_draw_of_the_same_room():
    a, b = (opened(settings=TraceSettings(seed=seed)).arrivals(POSES[0]) for seed in (0, 1))
    assert bytes_of(a) != bytes_of(b)
    assert 10 * np.log10(a.energy / b.energy) == pytest.approx(np.zeros(8), abs=0.2)


@pytest.mark.slow
def test_default_settings_are_quiet():
    """The level of a response in the octave of 1 kHz: a standard deviation below 0.08 dB over seeds."""
    levels = [10 * np.log10(opened(settings=TraceSettings(seed=s)).arrivals(POSES[0]).energy[4]) for s in range(8)]
    assert np.std(levels, ddof=1) < 0.08


def test_the_absorption_scale_is_that_of_eyrings_exponent():
    reference = opened(box(1 - 0.9**2)).arrivals(POSES[0])
    scaled = opened(box(0.1), absorption_scale=2.0).arrivals(POSES[0])
    early = slice(0, 20)
    assert scaled.pressure[early] == pytest.approx(reference.pressure[early], rel=1e-3)


def test_a_livelier_room_rings_on():
    """Absorption 0.1 with a quarter of its exponent: 0.026, 4.5 s by Eyring; no limit cuts the decay."""
    settings = TraceSettings(least_rays=1000, most_rays=1000, most_reflections=150, seconds=1.5, rain_rays=0)
    found = opened(box(0.1, 0.5, (5.0, 5.0, 5.0)), settings=settings, absorption_scale=0.25).arrivals(POSES[0])
    time = decay_time(found.time, without_air(energies(found), found.time, 4))
    assert time == pytest.approx(eyring(125.0, 150.0, 1 - 0.9**0.25), rel=0.05)


def test_the_record_says_how_it_was_made():
    record = backend(FEW, absorption_scale=1.5).describe()
    assert record["licence"] == "Apache-2.0"
    assert record["backend"] == "tracer"
    assert record["receiver"] == "omni"
    assert record["arrivals"] == 500
    assert record["absorption_scale"] == 1.5
    assert all(isinstance(value, str | int | float | bool) for value in record.values())


# Bad input


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ((np.nan, 1.0, 1.0), "source position .* is not finite"),
        ((1.0, np.inf, 1.0), "source position .* is not finite"),
        ((1.0, 1.0, 30.0), "source position .* lies outside the scene, which spans"),
    ],
)
def test_a_bad_source_is_one_clear_line(position, message):
    with pytest.raises(Avs3dError, match=message) as error:
        opened(source=position)
    assert "\n" not in str(error.value)


def test_a_bad_listener_is_one_clear_line():
    session = opened()
    with pytest.raises(Avs3dError, match="not finite"):
        session.arrivals(Pose.from_yaw((np.nan, 1.0, 1.0), 0.0))
    for ask in (session.arrivals, session.impulse_response, lambda pose: session.prepare([pose])):
        with pytest.raises(Avs3dError, match=r"box: listener position .* lies outside the scene"):
            ask(Pose.from_yaw((1.0, 1.5, 30.0), 0.0))


def with_mesh(scene, corners, name="shard"):
    builder = MeshBuilder()
    builder.box((1, 1, 1), (3, 2, 1), Material(name, "wood"), acoustic="exact")
    mesh = builder.build()
    object.__setattr__(mesh, "acoustic_positions", np.asarray(corners, dtype=np.float32))
    object.__setattr__(mesh, "acoustic_labels", ("wood",) * len(corners))
    return Scene(scene.name, (*scene.parts, Part(name, mesh)), scene.rooms, ())


def test_a_mesh_with_nan_is_refused():
    broken = with_mesh(box(), [[[1, 1, 1], [2, 1, np.nan], [1, 2, 1]]])
    with pytest.raises(Avs3dError, match="part 'shard' has acoustic vertices that are NaN or infinite; repair it"):
        opened(broken)


@pytest.mark.parametrize("far", [1e5, 1e30])
def test_a_mesh_too_far_away_is_refused(far):
    distant = with_mesh(box(), [[[1, 1, 1], [2, 1, 1], [1, far, 1]]])
    with pytest.raises(
        Avs3dError, match=r"part 'shard' has acoustic vertices 1e?[+0]+\d* m from the origin, expected at most"
    ):
        opened(distant)


def test_degenerate_triangles_are_dropped():
    needle = with_mesh(box(), [[[1, 1, 1], [1, 1, 1], [1, 1, 1]], [[0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    assert bytes_of(opened(needle).arrivals(POSES[0])) == bytes_of(opened().arrivals(POSES[0]))


def test_an_open_mesh_loses_what_escapes():
    """Without its ceiling a room is quieter and decays faster; nothing hangs."""
    shell = box()
    mesh = shell.parts[0].mesh
    keep = ~np.all(mesh.acoustic_positions[:, :, 1] > SIZE[1] - 0.01, axis=1)
    assert keep.sum() == 10
    labels = tuple(np.array(mesh.acoustic_labels)[keep].tolist())
    roofless = with_mesh(Scene("box", (), shell.rooms, ()), mesh.acoustic_positions[keep])
    object.__setattr__(roofless.parts[0].mesh, "acoustic_labels", labels)
    settings = TraceSettings()
    under, closed = (opened(s, settings=settings).arrivals(POSES[0]) for s in (roofless, shell))
    assert np.all(under.energy < closed.energy)
    above = under.direction[:, 1] > 0.99
    assert energies(under)[above].sum() < 0.02 * energies(under).sum()
    late = [energies(x)[x.time > 0.1].sum() / energies(x).sum() for x in (under, closed)]
    assert late[0] < 0.5 * late[1]


def test_a_scene_without_faces_is_a_free_field():
    free = Scene("free", (), (Room("kitchen", (0, 0, 0), (5, 5, 5)),), ())
    arrivals = opened(free, (0.0, 0.0, 0.0)).arrivals(Pose.from_yaw((0.0, 3.0, 4.0), 0.0))
    assert len(arrivals) == 1
    assert arrivals.pressure[0, 0] == pytest.approx(0.2, rel=1e-3)
    assert arrivals.direction[0] == pytest.approx([0, -0.6, -0.8])


def test_a_room_without_absorption_rings_until_the_longest_response():
    arrivals = opened(
        box(0.0), settings=TraceSettings(least_rays=500, most_rays=500, seconds=1.0, most_reflections=4000)
    )
    found = arrivals.arrivals(POSES[0])
    # The last flight may end a little later.
    assert 0.95 < found.time.max() < 1.03
    assert np.isfinite(found.pressure).all()


def test_a_room_that_absorbs_all_has_the_direct_sound_alone():
    found = opened(box(1.0)).arrivals(POSES[0])
    heard = found.pressure.any(axis=1)
    assert heard.sum() == 1
    assert found.pressure[heard][0, 4] == pytest.approx(1 / np.linalg.norm(LISTENER - SOURCE), rel=0.01)


@pytest.mark.parametrize("scattering", [0.0, 1.0, (0.0, 0.0, 1.0, 1.0, 0.0, 0.5)])
def test_extreme_scattering_is_finite(scattering):
    found = opened(box(0.2, scattering), settings=TraceSettings()).arrivals(POSES[0])
    assert np.isfinite(found.pressure).all()
    assert np.all(found.energy > 0.5)


def walled(extra):
    return box_scene(SIZE, label=label(0.2), extra=extra)


def test_in_a_body_that_transmits_a_listener_hears_what_comes_through_it():
    """Inside a solid, nothing arrives but the direct sound through its face."""
    tau = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
    material = spectral_label((0.2,) * 6, (0.3,) * 6, tau)
    wall = solid("wall", (0.4, 4.0, 3.0), (3.0, 2.0, 1.5), label=material)
    found = opened(walled((wall,))).arrivals(Pose.from_yaw((3.0, 2.0, 1.5), 0.0))
    assert len(found) == 1
    way = SOURCE - (3.0, 2.0, 1.5)
    assert found.direction[0] @ way > 0
    assert np.square(found.pressure[0, 1:5]) * (way @ way) == pytest.approx(tau[:4], rel=0.05)


def test_a_listener_behind_three_walls_is_one_clear_line():
    walls = tuple(solid(f"wall {x}", (0.1, 4.0, 3.0), (x, 2.0, 1.5), label=label(0.2)) for x in (2.0, 2.8, 3.6))
    with pytest.raises(Avs3dError, match=r"no sound reaches listener \(4.2, .*enclosed by faces without an opening"):
        opened(walled(walls)).arrivals(POSES[0])


def test_a_source_that_is_walled_in_is_one_clear_line():
    crate = solid("crate", (0.6, 0.6, 0.6), SOURCE, label=label(0.2))
    with pytest.raises(Avs3dError, match=r"the source at \(1.0, 1.2, 1.3\) is in a wall or another closed body"):
        opened(walled((crate,))).arrivals(POSES[0])
    session = opened(walled((solid("crate", (0.6, 0.6, 0.6), SOURCE + (0, 1.5, 0), label=label(0.2)),)))
    session.move_source(tuple((SOURCE + (0, 1.5, 0)).tolist()))
    session.prepare(POSES)
    with pytest.raises(Avs3dError, match="the listener is not; move it out of the body"):
        session.arrivals(POSES[0])
    session.move_source(SOURCE_)
    assert len(session.arrivals(POSES[0])) > 0


def test_the_body_of_the_sounding_object_is_no_wall():
    crate = solid("crate", (0.6, 0.6, 0.6), SOURCE, label=label(0.2), instance_id=1)
    assert bytes_of(opened(walled((crate,))).arrivals(POSES[0])) == bytes_of(opened(walled(())).arrivals(POSES[0]))


def test_source_and_listener_in_one_place():
    """As loud as at 10 cm; the reflections stay what they are."""
    session = TracerBackend(settings=FEW).open(box(0.2), SOURCE_, room="kitchen")
    pose = Pose.from_yaw(SOURCE_, 0.3)
    found = session.arrivals(pose)
    assert found.time[0] == 0.0
    assert found.pressure[0] == pytest.approx(10.0)
    assert np.isfinite(found.pressure).all()
    response = session.impulse_response(pose)
    assert np.isfinite(response).all()
    assert response.any()


#: Scenes and places with a documented meaning or one clear line; whatever they give, they give it soon.
ODD = {
    "empty part": lambda: opened(with_mesh(box(), np.zeros((0, 3, 3)))),
    "one triangle": lambda: opened(with_mesh(Scene("box", (), box().rooms, ()), [[[0, 0, 0], [6, 0, 0], [0, 0, 3]]])),
    "needles": lambda: opened(with_mesh(box(), [[[0, 1, 1], [6, 1, 1], [6, 1, 1 + 1e-6 * k]] for k in range(1, 9)])),
    "every face twice": lambda: opened(Scene("box", box().parts * 2, box().rooms, ())),
    "a million times as large": lambda: opened(box(0.2, 0.3, (6e6, 4e6, 3e6))),
    "large hall": lambda: opened(box(0.01, 0.3, (900.0, 400.0, 300.0))),
    "tiny box": lambda: opened(box(0.01, 0.3, (0.02, 0.02, 0.02)), (0.01, 0.01, 0.01)),
    "no absorption": lambda: opened(box(0.0, 0.0)),
    "all absorbed": lambda: opened(box(1.0, 1.0)),
    "source on a wall": lambda: opened(source=(0.0, 1.2, 1.3)),
    "source in a corner": lambda: opened(source=(0.0, 0.0, 0.0)),
}


#: Those that are refused, and what the line says; in the tiny box, listeners outside it.
REFUSED = {
    "one triangle": "source position .* lies outside the scene",
    "a million times as large": "expected at most 10000 m",
    "tiny box": "listener position .* lies outside the scene",
}


def _respond(name, places):
    for place in places:
        inside = name == "tiny box" and max(place) < 0.02
        if name in REFUSED and not inside:
            with pytest.raises(Avs3dError, match=REFUSED[name]) as caught:
                ODD[name]().impulse_response(Pose.from_yaw(place, 0.0))
            assert "\n" not in str(caught.value)
        else:
            response = ODD[name]().impulse_response(Pose.from_yaw(place, 0.0))
            assert np.isfinite(response).all()
            assert response.any()


@pytest.mark.slow
def test_no_odd_scene_hangs():
    """Each gives finite numbers or one line, in a process that is ended if it takes long."""
    places = [POSES[0].position, (0.01, 0.01, 0.01), (0.0, 0.0, 0.0), (6.0, 4.0, 3.0), SOURCE_]
    context = multiprocessing.get_context("fork")
    for name in ODD:
        process = context.Process(target=_respond, args=(name, places))
        process.start()
        process.join(60)
        hung = process.is_alive()
        process.kill()
        process.join()
        assert not hung, f"{name}: no answer after a minute"
        assert process.exitcode == 0, name


def test_a_closed_session_says_so():
    session = opened()
    session.close()
    for ask in (session.arrivals, session.impulse_response):
        with pytest.raises(Avs3dError, match="box: the acoustic session is closed; open a new one"):
            ask(POSES[0])
    with pytest.raises(Avs3dError, match="closed"):
        session.move_source(SOURCE_)


@pytest.mark.parametrize("rate", [0, 7999, 200_000])
def test_an_impossible_sample_rate_is_refused(rate):
    with pytest.raises(Avs3dError, match=f"sample rate {rate} Hz, expected 8000 to 192000"):
        backend().open(box(), SOURCE_, room="kitchen", sample_rate=rate)


@pytest.mark.parametrize(
    "given",
    [
        {"arrivals": 0},
        {"radius": 0.0},
        {"most_rays": 1},
        {"early_order": 5},
        {"rain_order": 5},
        {"seconds": 1e9},
        {"seed": -1},
    ],
)
def test_settings_out_of_range_are_named(given):
    with pytest.raises(Avs3dError, match=f"trace settings: {next(iter(given))} is .*, expected"):
        TraceSettings(**given)


def test_threads_and_scale_are_checked():
    with pytest.raises(Avs3dError, match="tracer: threads is 0, expected 1 to"):
        backend(threads=0)
    with pytest.raises(Avs3dError, match="absorption_scale is 0"):
        backend(absorption_scale=0.0)


def test_arrivals_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"arrivals: time \(2,\)"):
        Arrivals(np.zeros(2), np.zeros((1, 3), dtype=np.float32), np.zeros((2, 8), dtype=np.float32))
    assert len(Arrivals.joined([])) == 0


def test_warming_up_compiles_every_kernel():
    from generators.acoustics.tracer import clearance, diffraction, kernels
    from generators.core import bvh

    backend().warm_up()
    entered = [
        function
        for module in (bvh, clearance, diffraction, kernels)
        for function in vars(module).values()
        # Kernels that Python calls are cached; what they inline is compiled with them.
        if hasattr(function, "signatures") and function.__module__ == module.__name__ and has_cache(function)
    ]
    assert len(entered) >= 9
    assert not [function.__name__ for function in entered if not function.signatures]


def has_cache(function):
    return type(function._cache).__name__ != "NullCache"
