"""The tracer on a CUDA device against the CPU: the same arrivals, the same responses, the same bytes in any batch.

Without a device the kernels run in numba's simulator, in a process of its own, on tiny scenes.
"""

import json
import os
import subprocess
import sys
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from generators.acoustics import hrtf
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.device.ears import GRID, BinauralReceiver
from generators.acoustics.tracer.receivers.ambisonics import Ambisonics
from generators.acoustics.tracer.receivers.gridding import grids_for
from generators.acoustics.tracer.receivers.measured import nearest_node, plane_delay
from generators.acoustics.tracer.receivers.spherical import STEPS, SphericalHead
from generators.acoustics.tracer.receivers.synthesis import ReceiverPort, checked, synthesise
from generators.acoustics.tracer.settings import TraceSettings
from generators.core.cuda import cuda_problem
from tests.support.tracer_rooms import SOURCE, box

PROBLEM = cuda_problem()
on_device = pytest.mark.skipif(PROBLEM is not None, reason=f"no CUDA device: {PROBLEM}")
FEW = TraceSettings(
    arrivals=1, least_rays=6, most_rays=6, rain_rays=3, most_reflections=12, early_order=2, exact_scattering=3
)
POSES = [
    Pose.from_yaw((4.2, 2.1, 1.9), 0.3),
    Pose.from_yaw((4.0, 1.1, 1.5), 1.3),
    Pose.from_yaw((2.0, 0.4, 0.8), -2.0),
]
ROOM = box()


def small_ears(kind):
    """Ears whose filters are so short that a transform of 60 samples holds them."""
    ears = SphericalHead().ears(8000)
    impulses = ears.basis.impulses
    ears = replace(ears, basis=replace(ears.basis, impulses=np.concatenate([impulses[:, :20], impulses[:, -20:]], 1)))
    if kind != GRID:
        return ears
    nodes = 180 * 91
    rows = np.random.default_rng(3).normal(size=(2 * nodes, ears.basis.rows.shape[1])).astype(np.float32)
    residual = np.random.default_rng(4).uniform(-2e-4, 2e-4, size=(2, nodes))
    return replace(ears, kind=GRID, basis=replace(ears.basis, rows=rows), first_row=nodes, residual=residual)


def some_arrivals(count=6):
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    pressure = rng.normal(size=(count, 8)).astype(np.float32)
    return Arrivals(rng.uniform(0, 0.004, count), direction.astype(np.float32), pressure)


def on_host(ears, arrivals, rotation, grids, samples):
    """What the CPU's receivers do with these ears."""
    directions = checked(arrivals, rotation, 8000)
    ports = []
    for ear in (0, 1):
        if ears.kind == GRID:
            nodes = nearest_node(directions)
            delay, index = plane_delay(directions, ear) + ears.residual[ear, nodes], nodes + ear * ears.first_row
        else:
            theta = hrtf.incidence(directions, ear)
            delay, index = hrtf.ear_delay(theta), np.rint(theta * (STEPS / np.pi))
        ports.append(
            ReceiverPort(delay, index.astype(np.int32), ears.basis.rows, ears.basis.columns, ears.basis.filters(grids))
        )
    return synthesise(arrivals, ports, grids, samples)


def simulated_receivers():
    """Runs in the simulator: largest error of both kinds of ears, relative to the largest sample."""
    from generators.acoustics.tracer.device.binaural import DeviceEars, DeviceRecords

    errors = {}
    for kind in (0, GRID):
        ears, arrivals, grids = small_ears(kind), some_arrivals(), grids_for(60, 8000)
        rotations = np.stack([Pose.from_yaw((0, 0, 0), yaw).rotation_matrix for yaw in (0.4, -2.1)])
        # Two listeners of three are asked for, each hears every other record.
        owner = (np.arange(len(arrivals)) % 2 * 2).astype(np.int32)
        heard = DeviceRecords(owner, arrivals.time * 343.0, arrivals.direction, arrivals.pressure, len(arrivals), 343.0)
        # Those of both ears at once, or of one after the other.
        parts = [heard] if kind else [heard._replace(last_ear=1), heard._replace(first_ear=1)]
        found = DeviceEars(ears, 8000)._of_one_length(parts, grids, 3, [2, 0], rotations, [50, 48])
        for row, listener, rotation in zip(found, (2, 0), rotations, strict=True):
            own = owner == listener
            part = Arrivals(arrivals.time[own], arrivals.direction[own], arrivals.pressure[own])
            expected = on_host(ears, part, rotation, grids, row.shape[1])
            errors[f"{kind} {listener}"] = float(np.abs(row - expected).max() / np.abs(expected).max())
    return errors


def simulated_near():
    """Runs in the simulator: whether the records of each ear are the arrivals that the CPU gives to it."""
    from generators.acoustics.tracer.device.trace import DeviceTrace
    from generators.acoustics.tracer.receivers.near_field import diametral_near_field
    from generators.acoustics.tracer.tables import Records

    late, near = some_arrivals(), some_arrivals(6)
    near = Arrivals(near.time + 0.002, near.direction, near.pressure, np.ones(6, dtype=np.bool_))
    records = Records(np.zeros(len(late), dtype=np.int32), late.time * 343.0, late.direction, late.pressure)
    trace = DeviceTrace(records, np.arange(len(late)), len(late), np.full(2, 0.004), [Arrivals.none(), near])
    rotation, got = Pose.from_yaw((0, 0, 0), 0.4).rotation_matrix, []

    def responses(heard, latest, listeners, rotations):
        got.extend(heard)
        return []

    field = diametral_near_field()
    trace.responses(SimpleNamespace(near=field, responses=responses), [1], [rotation])
    said = [(got[0].first_ear, got[0].last_ear) == (0, 2), len(got) == 3]
    for ear, part in enumerate(got[1:]):
        expected, _ = field.heard(near, checked(near, rotation, 8000), ear)
        said.append((part.first_ear, part.last_ear, part.records) == (ear, ear + 1, 48) and (part.listener == 1).all())
        said.append(np.array_equal(part.pressure, expected.pressure) and np.allclose(part.path, expected.time))
    return [bool(each) for each in said]


def simulated_arrivals():
    """Runs in the simulator: the arrivals of a tiny trace."""
    from generators.acoustics.tracer import early

    early._SEARCH_RAYS = 8
    session = TracerBackend(settings=FEW, device="cuda").open(ROOM, tuple(SOURCE), room=ROOM.rooms[0].name)
    session.prepare(POSES)
    return [
        [found.time.tolist(), found.direction.tolist(), found.pressure.tolist()]
        for found in map(session.arrivals, POSES)
    ]


def simulated_shortage():
    """Runs in the simulator: sizes of the batches that were tried if one listener fits; what is said if none does."""
    from generators.acoustics.tracer import early
    from generators.acoustics.tracer.device.trace import DeviceScene
    from generators.core.cuda import OutOfDeviceMemoryError

    early._SEARCH_RAYS = 8
    session = TracerBackend(settings=FEW, device="cuda").open(ROOM, tuple(SOURCE), room=ROOM.rooms[0].name)
    session.prepare(POSES)
    tried, room, trace = [], [1], DeviceScene.trace

    def limited(scene, images, listeners, others):
        tried.append(len(listeners))
        if len(listeners) > room[0]:
            raise OutOfDeviceMemoryError("CUDA: too little device memory for arrivals")
        return trace(scene, images, listeners, others)

    DeviceScene.trace = limited
    counts = [len(session.arrivals(pose)) for pose in POSES[:2]]
    room[0] = 0
    try:
        session.arrivals(POSES[2])
    except OutOfDeviceMemoryError as error:
        return [tried, counts, str(error)]
    return None


def simulated_batches():
    """Runs in the simulator: sizes of batches of 10 responses, with room for all, for 4, for less than it seemed."""
    from generators.acoustics.tracer.device import binaural
    from generators.core.cuda import OutOfDeviceMemoryError

    ears = binaural.DeviceEars(small_ears(0), 8000)
    tried, fitting = [], [0]

    def of_one_length(heard, grids, heads, listeners, rotations, samples):
        tried[-1].append(len(listeners))
        if len(listeners) > fitting[0]:
            raise OutOfDeviceMemoryError("full")
        return [np.full((2, 5), listener, dtype=np.float32) for listener in listeners]

    ears._tables = lambda grids: SimpleNamespace(memory=1000)
    ears._of_one_length, ears._together = of_one_length, 128
    for binaural._MEMORY, fitting[0] in ((1 << 30, 128), (4500, 128), (4500, 3), (4500, 128), (500, 128)):
        tried.append([])
        found = ears.responses([], np.full(10, 0.05), list(range(10)), [np.eye(3)] * 10)
        assert [int(each[0, 0]) for each in found] == list(range(10))
    return tried


def simulated(function):
    """The result of one of the functions above, run in the simulator."""
    root = Path(__file__).parents[2]
    code = (
        f"import json; from tests.generators import test_tracer_cuda as t; print(json.dumps(t.{function.__name__}()))"
    )
    env = os.environ | {
        "NUMBA_ENABLE_CUDASIM": "1",
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]),
    }
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_the_kernels_find_the_arrivals_of_the_cpu_in_the_same_order(monkeypatch):
    from generators.acoustics.tracer import early

    monkeypatch.setattr(early, "_SEARCH_RAYS", 8)
    session = TracerBackend(settings=FEW).open(ROOM, tuple(SOURCE), room=ROOM.rooms[0].name)
    session.prepare(POSES)
    for pose, (time, direction, pressure) in zip(POSES, simulated(simulated_arrivals), strict=True):
        expected = session.arrivals(pose)
        assert len(time) == len(expected) > 20
        assert np.array(time) == pytest.approx(expected.time, abs=1e-12)
        assert np.array(direction) == pytest.approx(expected.direction, abs=1e-6)
        assert np.array(pressure) == pytest.approx(expected.pressure, rel=1e-6)


@pytest.mark.slow
def test_the_kernels_make_the_responses_of_the_cpu():
    errors = simulated(simulated_receivers)
    assert len(errors) == 4
    assert max(errors.values()) < 2e-6, errors


@pytest.mark.slow
def test_too_little_memory_makes_batches_smaller_and_then_is_one_line(monkeypatch):
    from generators.acoustics.tracer import early

    tried, counts, said = simulated(simulated_shortage)
    assert tried == [3, 2, 1, 1, 1]
    monkeypatch.setattr(early, "_SEARCH_RAYS", 8)
    session = TracerBackend(settings=FEW).open(ROOM, tuple(SOURCE), room=ROOM.rooms[0].name)
    assert counts == [len(session.arrivals(pose)) for pose in POSES[:2]]
    assert said == "CUDA: too little device memory for arrivals"


@pytest.mark.slow
def test_a_batch_of_responses_keeps_to_the_memory_of_a_process():
    # What did not fit once is not tried again; a single response is always tried.
    assert simulated(simulated_batches) == [[10], [4, 4, 2], [4, 2, 2, 2, 2, 2], [2] * 5, [1] * 10]


def test_a_thread_keeps_its_last_heads_at_each_sample_rate(monkeypatch):
    from generators.acoustics.tracer.device import session

    monkeypatch.setattr(session, "DeviceEars", lambda ears, rate: (ears, rate))
    monkeypatch.setattr(session, "_heads", OrderedDict())
    heads = [SimpleNamespace(basis=object()) for _ in range(session._HEADS + 1)]
    first = session._on_device(heads[0], 44_100)
    assert session._on_device(heads[0], 48_000)[1] == 48_000
    for head in heads[1:-1]:
        session._on_device(head, 44_100)
        assert session._on_device(heads[0], 44_100) is first  # the last ones used are kept
    assert len(session._heads) == session._HEADS


@pytest.mark.slow
def test_each_ear_of_the_device_hears_near_sources_as_on_the_cpu():
    assert simulated(simulated_near) == [True] * 6


def test_heads_are_binaural_receivers_and_ambisonics_are_not():
    assert isinstance(SphericalHead(), BinauralReceiver)
    assert not isinstance(Ambisonics(1), BinauralReceiver)


def test_an_unknown_device_is_one_line():
    with pytest.raises(Avs3dError, match=r"^tracer: device is 'tpu', expected cpu or cuda$"):
        TracerBackend(device="tpu")


@pytest.mark.skipif(PROBLEM is None, reason="there is a CUDA device")
def test_without_cuda_there_is_one_line():
    with pytest.raises(Avs3dError, match=r"^CUDA cannot be used: .") as error:
        TracerBackend(device="cuda")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("length", [1, 2, 60, 640, 1125, 40960, 57344])
def test_factors_multiply_to_the_length(length):
    from generators.acoustics.tracer.device.fft import factors

    assert np.prod(factors(length), dtype=int) == length
    with pytest.raises(ValueError, match="expected a product of 2, 3, 5 and 7"):
        factors(11 * length)


@pytest.fixture(scope="module")
def sessions():
    """The furnished flat of the benchmarks: a session of each device."""
    from benchmarks.bench_acoustics import EAR_HEIGHT, LISTENER, ROOMS, SOURCE_HEIGHT, _place
    from benchmarks.bench_acoustics import SOURCE as SHARE
    from tests.support.flats import textured_flat

    scene = textured_flat(1)
    source = _place(scene, ROOMS[0], SHARE, SOURCE_HEIGHT)
    x, y, z = _place(scene, ROOMS[0], LISTENER, EAR_HEIGHT)
    poses = [Pose.from_yaw((x + 0.01 * k, y, z - 0.01 * k), 0.3 * k) for k in range(20)]

    def opened(device, receiver=None):
        return TracerBackend(receiver, device=device, threads=4 if device == "cpu" else 1).open(
            scene, source, room=ROOMS[0]
        )

    return opened, poses


@on_device
def test_a_furnished_room_has_the_arrivals_of_the_cpu(sessions):
    opened, poses = sessions
    cpu, cuda = opened("cpu"), opened("cuda")
    for session in (cpu, cuda):
        session.prepare(poses)
    for pose in poses:
        expected, found = cpu.arrivals(pose), cuda.arrivals(pose)
        assert len(found) == len(expected)
        assert found.time == pytest.approx(expected.time, abs=1e-9)
        assert found.direction == pytest.approx(expected.direction, abs=1e-5)
        assert found.pressure == pytest.approx(expected.pressure, rel=1e-5, abs=1e-9)


@on_device
@pytest.mark.parametrize("receiver", [None, Ambisonics(1)])
def test_a_furnished_room_has_the_responses_of_the_cpu(sessions, receiver):
    opened, poses = sessions
    expected, found = (opened(device, receiver).impulse_response(poses[3]) for device in ("cpu", "cuda"))
    assert found.shape == expected.shape
    # −80 dB: the CPU's grids are sums of float32.
    assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected)


@on_device
def test_bytes_do_not_depend_on_batch_order_or_calls(sessions):
    opened, poses = sessions
    together, backwards, alone = (opened("cuda") for _ in range(3))
    together.prepare(poses)
    backwards.prepare(poses[::-1], together=7)
    one = [together.impulse_response(pose).tobytes() for pose in poses]
    two = [backwards.impulse_response(pose).tobytes() for pose in poses[::-1]][::-1]
    assert one == two
    assert alone.impulse_response(poses[4]).tobytes() == one[4]
    assert together.impulse_response(poses[4]).tobytes() == one[4]
