"""Engines for rooms of one's own: one protocol, the generator's own sessions, the same bytes again."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tarfile
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
import trimesh

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Pose
from avs3d_bench.measures.decay import octave_filtered
from generators import acoustics
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.tracer.backend import TracerBackend
from generators.acoustics.tracer.settings import TraceSettings
from generators.acoustics.tracer.transmission import wall_loss_db

ROOT = Path(__file__).parents[2]
SIZE, SOURCE, LISTENER = (6.0, 2.7, 4.0), (1.0, 1.5, 2.0), (4.0, 1.4, 2.3)
FEW = TraceSettings(arrivals=500, least_rays=200, most_rays=400, rain_rays=50)
RATE = 16_000


@pytest.fixture(scope="module")
def room() -> acoustics.Room:
    return acoustics.Room.shoebox(SIZE, {"floor": "parquet", "*": 0.2})


@pytest.fixture(scope="module")
def tracer() -> acoustics.Tracer:
    return acoustics.Tracer(seed=3, settings=FEW)


@pytest.fixture(scope="module")
def traced(room: acoustics.Room) -> acoustics.Rir:
    return acoustics.Tracer(seed=3).response(room, SOURCE, LISTENER, acoustics.Omni(), sample_rate=RATE)


def one_line(error: pytest.ExceptionInfo[Avs3dError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


@pytest.mark.slow
def test_responses_are_those_of_the_generators_backend(room: acoustics.Room, tracer: acoustics.Tracer) -> None:
    pose = Pose.from_yaw(LISTENER, 0.4)
    rir = tracer.response(room, SOURCE, pose, sample_rate=RATE)
    session = TracerBackend(None, FEW, seed=3).open(room.scene, SOURCE, room="room", sample_rate=RATE)
    np.testing.assert_array_equal(rir.samples, session.impulse_response(pose))
    assert (rir.channel_names, rir.provenance["seed"], rir.receiver["head"]) == (("left", "right"), 3, "rigid sphere")
    np.testing.assert_array_equal(tracer.response(room, SOURCE, pose, sample_rate=RATE).samples, rir.samples)
    other = acoustics.Tracer(seed=4, settings=FEW).response(room, SOURCE, pose, sample_rate=RATE)
    assert not np.array_equal(other.samples[:, :500], rir.samples[:, :500]) or other.samples.shape != rir.samples.shape


def test_figures_follow_the_closed_forms_of_a_box(traced: acoustics.Rir, room: acoustics.Room) -> None:
    x, y, z = SIZE
    surface = 2 * (x * y + y * z + x * z)
    floor = np.array(room.materials_used()[0].absorption)
    alpha = (floor * x * z + 0.2 * (surface - x * z)) / surface
    eyring = 0.161 * room.volume / (-surface * np.log(1 - alpha))
    found = traced.t30()
    assert list(found) == [125, 250, 500, 1000, 2000, 4000]
    assert [found[f] for f in (250, 500, 1000)] == pytest.approx(eyring[1:4], rel=0.25)
    assert all(0.6 < traced.edt()[f] / found[f] < 1.4 for f in (500, 1000))
    # What the arrivals say, each octave by itself.
    assert traced.arrivals is not None
    energy = np.square(traced.arrivals.pressure[:, 4:7], dtype=np.float64)
    direct = energy[traced.arrivals.time.argmin()]
    wanted = 10 * np.log10(direct / (energy.sum(axis=0) - direct))
    assert [traced.drr()[f] for f in (1000, 2000, 4000)] == pytest.approx(list(wanted), abs=1.5)
    decay = traced.energy_decay(1000)
    assert decay[0] == 0
    assert (np.diff(decay[np.isfinite(decay)]) <= 0).all()


@pytest.mark.slow
def test_figures_of_a_decay_of_known_form() -> None:
    """Noise that decays in T: T30 = EDT = T, C50 = 10·lg(exp(13.8·0.05/T) − 1); with an impulse before it, its DRR."""
    time_60, seconds = 0.6, np.arange(RATE) / RATE
    noise = np.random.default_rng(0).standard_normal((24, RATE)) * 10 ** (-3 * seconds / time_60)
    samples = noise.astype(np.float32)
    pose = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    rir = acoustics.Rir(samples, RATE, tuple(map(str, range(24))), (0.0, 0.0, 0.0), pose)
    for octave in (1000, 2000, 4000):
        assert rir.t30()[octave] == pytest.approx(time_60, rel=0.03)
        assert rir.edt()[octave] == pytest.approx(time_60, rel=0.08)
        assert rir.c50()[octave] == pytest.approx(10 * np.log10(np.exp(6 * np.log(10) * 0.05 / time_60) - 1), abs=0.3)
    impulse, late = np.zeros_like(samples), samples.copy()
    impulse[:, 0], late[:, : RATE // 50] = 100.0, 0.0
    drr = replace(rir, samples=impulse + late).drr()
    for octave in (500, 1000, 2000):
        ratio = [np.square(octave_filtered(part, RATE, octave)).sum() for part in (impulse, late)]
        assert drr[octave] == pytest.approx(10 * np.log10(ratio[0] / ratio[1]), abs=0.01)
    assert replace(rir, samples=impulse).drr()[1000] == np.inf


def test_arrivals_are_public(traced: acoustics.Rir) -> None:
    assert traced.arrivals is not None
    first = traced.arrivals.time.argmin()
    assert traced.arrivals.time[first] == pytest.approx(traced.distance / SPEED_OF_SOUND)
    towards = np.subtract(SOURCE, LISTENER) / traced.distance
    np.testing.assert_allclose(traced.arrivals.direction[first], towards, atol=1e-6)
    assert traced.arrivals.pressure[first, 3] == pytest.approx(1 / traced.distance, rel=0.01)


def test_many_responses_are_the_single_ones_in_any_number_of_processes(
    room: acoustics.Room, tracer: acoustics.Tracer
) -> None:
    sources, listeners = [SOURCE, (2.0, 1.0, 1.0)], [LISTENER, Pose.from_yaw((3.0, 1.5, 3.0), 1.0), (5.0, 1.2, 1.0)]
    many = list(tracer.responses(room, sources, listeners, receiver=acoustics.Omni(), sample_rate=RATE))
    assert [(rir.source, rir.listener.position) for rir in many[2:4]] == [
        (SOURCE, (5.0, 1.2, 1.0)),
        (sources[1], LISTENER),
    ]
    alone = tracer.response(room, sources[1], listeners[1], acoustics.Omni(), sample_rate=RATE)
    np.testing.assert_array_equal(many[4].samples, alone.samples)
    first = next(iter(tracer.responses(room, sources, listeners, receiver=acoustics.Omni(), sample_rate=RATE)))
    np.testing.assert_array_equal(first.samples, many[0].samples)


@pytest.mark.slow
def test_processes_change_nothing(room: acoustics.Room) -> None:
    engine, places = acoustics.Analytic(), [(x, 1.5, 1.0) for x in (1.0, 2.0, 3.0)]
    here = list(engine.responses(room, places, [LISTENER], sample_rate=RATE))
    there = list(engine.responses(room, places, [LISTENER], sample_rate=RATE, processes=2))
    assert [rir.source for rir in there] == places
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a.samples, b.samples)


def test_the_analytic_engine_agrees_on_the_direct_sound(room: acoustics.Room, tracer: acoustics.Tracer) -> None:
    ours, closed = (
        engine.response(room, SOURCE, LISTENER, sample_rate=RATE) for engine in (tracer, acoustics.Analytic())
    )
    assert closed.arrivals is None
    window = slice(0, round((ours.distance / SPEED_OF_SOUND + 0.002) * RATE))
    levels = [10 * np.log10(np.square(rir.samples[:, window]).sum()) for rir in (ours, closed)]
    assert levels[0] == pytest.approx(levels[1], abs=1.0)


def test_soundspaces_speaks_the_same_protocol(room: acoustics.Room) -> None:
    pytest.importorskip("rlr_audio_propagation", reason="needs the [soundspaces] extra")
    engine = acoustics.SoundSpaces()
    rir = engine.response(room, SOURCE, LISTENER, acoustics.Omni(), sample_rate=RATE)
    assert rir.samples.shape[0] == 1
    onset = np.flatnonzero(np.abs(rir.samples[0]) > 0.3 * np.abs(rir.samples).max())[0]
    assert onset / RATE == pytest.approx(rir.distance / SPEED_OF_SOUND, abs=3 / RATE)
    listeners = [LISTENER, (3.0, 1.5, 3.0)]
    again = [list(engine.responses(room, [SOURCE], listeners, sample_rate=RATE)) for _ in range(2)]
    np.testing.assert_array_equal(again[0][1].samples, again[1][1].samples)


def test_transmission_of_a_material_passes_a_wall() -> None:
    around, wall = trimesh.creation.box((8.0, 42.0, 42.0)), trimesh.creation.box((0.1, 40.0, 40.0))
    mesh = trimesh.util.concatenate([around, wall])
    tau, listener = [0.5, 0.2, 0.1, 0.05, 0.02, 0.01], (2.0, 0.1, 0.2)
    settings = TraceSettings(arrivals=1, least_rays=1, most_rays=1, rain_rays=0, early_order=0, diffraction=False)

    def direct(material: object) -> np.ndarray:
        room = acoustics.Room.from_mesh(mesh, material)
        rir = acoustics.Tracer(settings=settings).response(room, (-2.0, 0.0, 0.0), listener, acoustics.Omni())
        assert rir.arrivals is not None
        return np.square(rir.arrivals.pressure[0, 1:7] * rir.distance)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        usual, own = direct("plaster"), direct({"absorption": 0.1, "transmission": tau})
    np.testing.assert_allclose(usual[:4], 10 ** (-wall_loss_db()[1:5] / 10), rtol=0.05)
    np.testing.assert_allclose(own, tau, rtol=0.2)  # 4 m of air at 4 kHz


def test_a_mesh_turned_inside_out_sounds_the_same(tracer: acoustics.Tracer) -> None:
    box = trimesh.creation.box((5, 2.5, 4))
    turned = trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False)
    a, b = (
        tracer.response(acoustics.Room.from_mesh(one, 0.2), (-1, 0, 0), (1, 0.3, 0.5), sample_rate=RATE)
        for one in (box, turned)
    )
    assert a.arrivals is not None
    assert b.arrivals is not None
    early = [found.pressure[found.is_spherical] for found in (a.arrivals, b.arrivals)]
    assert len(early[0]) > 30
    np.testing.assert_allclose(early[0], early[1], rtol=1e-4)
    np.testing.assert_allclose(a.arrivals.energy, b.arrivals.energy, rtol=0.1)


def test_holes_are_told_and_sound_is_lost_through_them(tracer: acoustics.Tracer) -> None:
    box = trimesh.creation.box((5, 2.5, 4))
    holes = trimesh.Trimesh(box.vertices, box.faces[:-1], process=False)
    with pytest.warns(UserWarning, match=r"mesh: \d+\.\d % of the directions from the source at .* through holes"):
        rir = tracer.response(acoustics.Room.from_mesh(holes, 0.1), (-1, 0, 0), (1, 0.3, 0.5), sample_rate=RATE)
    whole = tracer.response(acoustics.Room.from_mesh(box, 0.1), (-1, 0, 0), (1, 0.3, 0.5), sample_rate=RATE)
    assert np.square(rir.samples).sum() < 0.9 * np.square(whole.samples).sum()


def test_a_source_in_a_wall_is_refused_but_not_one_in_a_corner(tracer: acoustics.Tracer) -> None:
    outer, inner = trimesh.creation.box((8.4, 3.0, 6.4)), trimesh.creation.box((8.0, 2.6, 6.0))
    wall = trimesh.creation.box((0.2, 2.6, 6.0))
    mesh = trimesh.util.concatenate([outer, inner, wall])
    room = acoustics.Room.from_mesh(mesh, 0.2)
    with pytest.raises(Avs3dError, match=r"mesh: the source at .* is in a wall or another closed body"):
        tracer.response(room, (0.03, 0.2, 0.5), (2, 0, 0), sample_rate=RATE)
    corner = (3.95, -1.25, 2.95)
    assert tracer.response(room, corner, (2, 0, 0), sample_rate=RATE).samples.any()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"source": (9, 1, 1)}, "source position (9.0, 1.0, 1.0) lies outside the scene"),
        ({"listener": (1, 1)}, "listener: (1, 1); expected (x, y, z) in metres, a Pose"),
        ({"listener": (1, np.nan, 1)}, "listener: (1, nan, 1) is NaN or infinite"),
        ({"source": "door"}, "source: 'door'; expected (x, y, z)"),
        ({"sample_rate": 7999}, "sample rate 7999 Hz, expected 8000 to 192000"),
        ({"sample_rate": 192_001}, "sample rate 192001 Hz, expected 8000 to 192000"),
        ({"sample_rate": 44_100.5}, "sample_rate is 44100.5, expected a whole number of Hz"),
        ({"room": "flat.glb"}, "room: got 'flat.glb', expected Room.shoebox"),
    ],
)
@pytest.mark.parametrize("engine", [acoustics.Tracer, acoustics.Analytic])
def test_bad_input_is_said_in_one_line(engine: type, change: dict[str, object], text: str) -> None:
    asked: dict[str, object] = {"room": acoustics.Room.shoebox(SIZE, 0.2), "source": SOURCE, "listener": LISTENER}
    with pytest.raises(Avs3dError) as error:
        engine().response(**(asked | change))
    assert text in one_line(error)


@pytest.mark.parametrize("rate", [8000, 192_000])
def test_the_lowest_and_the_highest_rate_sound(room: acoustics.Room, tracer: acoustics.Tracer, rate: int) -> None:
    rir = tracer.response(room, SOURCE, LISTENER, acoustics.Omni(), sample_rate=rate)
    peak = np.abs(rir.samples[0, : round(0.02 * rate)]).argmax()
    assert peak / rate == pytest.approx(rir.distance / SPEED_OF_SOUND, abs=1 / 8000)
    assert max(rir.octaves) == (2000 if rate == 8000 else 4000)


def test_what_an_engine_lacks_is_said(room: acoustics.Room) -> None:
    for receiver in (acoustics.Ambisonics(1), acoustics.Omni(), acoustics.SphericalHead(0.1)):
        with pytest.raises(Avs3dError, match=f"Analytic has no {type(receiver).__name__}; leave the receiver out"):
            acoustics.Analytic().response(room, SOURCE, LISTENER, receiver)
    with pytest.raises(Avs3dError, match="Analytic has no free field"):
        acoustics.Analytic().response(acoustics.Room.free_field(), SOURCE, LISTENER)
    for positions in ([(0, 0)], [], [(0, 0, 2)], [(0, 0, np.nan)], "front"):
        with pytest.raises(Avs3dError):
            acoustics.Array(positions)


@pytest.mark.parametrize("engine", ["tracer", "analytic"])
def test_a_directional_source_is_quieter_behind(engine: str, room: acoustics.Room, tracer: acoustics.Tracer) -> None:
    """A cardioid with the listener in front (0 dB), beside (−6 dB) and behind (silence), before all reflections."""
    made = tracer if engine == "tracer" else acoustics.Analytic()
    beside = Pose.from_yaw(SOURCE, 0.0)  # faces +Z; the listener is along +X
    levels = []
    for source in (Pose.from_yaw(SOURCE, np.pi / 2), beside, Pose.from_yaw(SOURCE, -np.pi / 2)):
        listener = (4.0, SOURCE[1], SOURCE[2])
        rir = made.response(room, source, listener, directivity=acoustics.Directivity.cardioid(), sample_rate=RATE)
        direct = rir.samples[:, : round((rir.distance / SPEED_OF_SOUND + 0.0018) * RATE)]
        levels.append(10 * np.log10(np.square(direct).sum()))
    assert rir.provenance["directivity"] == acoustics.Directivity.cardioid().name
    assert levels[0] - levels[1] == pytest.approx(6.0, abs=0.5)
    assert levels[0] - levels[2] > 20
    many = list(
        made.responses(
            room, [SOURCE, beside], [LISTENER], directivity=acoustics.Directivity.cardioid(), sample_rate=RATE
        )
    )
    np.testing.assert_array_equal(many[0].samples, many[1].samples)


def test_the_radius_of_a_head_scales_its_interaural_delay(tracer: acoustics.Tracer) -> None:
    itd = []
    for radius in (0.07, 0.105):
        head = acoustics.SphericalHead(radius)
        rir = tracer.response(acoustics.Room.free_field(), (3.0, 0.0, 0.0), (0.0, 0.0, 0.0), head, sample_rate=48_000)
        left, right = rir.samples
        lags = np.arange(-100, 101)
        itd.append(lags[np.argmax([np.dot(np.roll(right, lag), left) for lag in lags])] / 48_000)
    assert itd == pytest.approx([radius * (1 + np.pi / 2) / SPEED_OF_SOUND for radius in (0.07, 0.105)], rel=0.15)
    assert itd[1] / itd[0] == pytest.approx(1.5, rel=0.1)


def test_responses_are_saved_and_drawn(tmp_path: Path, traced: acoustics.Rir) -> None:
    samples, rate = soundfile.read(traced.save(tmp_path / "a.wav"), dtype="float32", always_2d=True)
    assert rate == RATE
    np.testing.assert_array_equal(samples.T, traced.samples)
    with np.load(traced.save(tmp_path / "a.npz")) as file:
        np.testing.assert_array_equal(file["samples"], traced.samples)
        assert len(file["arrival_time"]) == len(file["arrival_pressure"])
        assert json.loads(str(file["metadata"]))["source"] == list(SOURCE)
    with pytest.raises(Avs3dError, match=r"unknown ending '.mp3'; expected .wav, .sofa, .npz"):
        traced.save(tmp_path / "a.mp3")
    with pytest.raises(Avs3dError, match="cannot write"):
        traced.save(tmp_path / "a.wav" / "b.wav")
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    figure = traced.plot()
    assert [len(axes.lines) for axes in figure.axes] == [1, len(traced.octaves)]


def test_sofa_files_hold_the_response(tmp_path: Path, traced: acoustics.Rir) -> None:
    sofar = pytest.importorskip("sofar", reason="SOFA files are written by sofar")
    file = sofar.read_sofa(str(traced.save(tmp_path / "a.sofa")))
    assert file.GLOBAL_SOFAConventions == "SingleRoomMIMOSRIR"
    np.testing.assert_allclose(np.squeeze(file.Data_IR), traced.samples[0])
    assert file.Data_SamplingRate == RATE
    x, y, z = np.squeeze(file.SourcePosition)
    assert (-y, z, -x) == pytest.approx(SOURCE)
    ears = replace(traced, samples=np.concatenate([traced.samples, -traced.samples]), channel_names=("left", "right"))
    file = sofar.read_sofa(str(ears.save(tmp_path / "ears.sofa")))
    np.testing.assert_allclose(np.squeeze(file.Data_IR), ears.samples)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.sofa", "ears.sofa"]


def test_shards_are_read_as_webdatasets_are(tmp_path: Path, room: acoustics.Room) -> None:
    engine, places = acoustics.Analytic(tail=False, images=50), [(1.0, 1.5, z) for z in (1.0, 2.0, 3.0)]
    rirs = list(engine.responses(room, places, [LISTENER], sample_rate=RATE))
    shards = acoustics.write_webdataset(iter(rirs), tmp_path / "rirs", per_shard=2)
    assert [path.name for path in shards] == ["rir-000000.tar", "rir-000001.tar"]
    with tarfile.open(shards[1]) as tar:
        assert tar.getnames() == ["00000002.npy", "00000002.json"]
        np.testing.assert_array_equal(np.load(io.BytesIO(tar.extractfile("00000002.npy").read())), rirs[2].samples)  # type: ignore[arg-type]
        assert json.load(tar.extractfile("00000002.json"))["source"] == list(places[2])  # type: ignore[arg-type]
    acoustics.write_webdataset(rirs, tmp_path / "again", per_shard=2)
    assert (tmp_path / "again/rir-000000.tar").read_bytes() == shards[0].read_bytes()
    with pytest.raises(Avs3dError, match="has shards already"):
        acoustics.write_webdataset(rirs, tmp_path / "rirs")

    def interrupted() -> Iterator[acoustics.Rir]:
        yield from rirs
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        acoustics.write_webdataset(interrupted(), tmp_path / "part", per_shard=2)
    assert [path.name for path in (tmp_path / "part").iterdir()] == ["rir-000000.tar"]


def test_the_import_is_light_and_a_response_needs_no_more_than_numpy_scipy_and_numba() -> None:
    heavy = {"pandas", "cv2", "pydantic", "rich", "click", "jinja2", "matplotlib", "trimesh", "soundfile", "torch"}
    code = "import sys\nimport generators.acoustics as acoustics\n"
    code += "print([m for m in ('numpy', 'scipy', 'numba') if m in sys.modules])\n"
    code += "room = acoustics.Room.shoebox((6, 2.7, 4), 'plaster')\n"
    code += (
        "acoustics.Tracer().response(room, (1, 1.5, 2), (4, 1.5, 2), acoustics.Array([(0, 0, 0)]), sample_rate=8000)\n"
    )
    code += f"print(sorted({heavy!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines() == ["[]", "[]"]
