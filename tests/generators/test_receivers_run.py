"""`--hrtf`, `--with ambisonics` and `--with array` from the command line to the folders, their records and checks."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from avs3d_bench.cli import avs3d, run
from avs3d_bench.commands.report import Problem
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ArrayRecord, FrameRecord, MicrophoneRecord, ObservationRecord
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from avs3d_bench.validation.receivers import cardioid_level, low_coherence
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.receivers import OWN_HEAD, Receivers, choose_receivers
from generators.backends import acoustic_backend
from generators.cli import generate
from generators.manifest.reading import read_manifest
from generators.observation.regenerate import regenerate
from generators.options import EngineOptions, GenerateOptions
from generators.plan import make_plans
from generators.run.differences import describe_differences
from tests.support.homes import tree_digest, write_manifest
from tests.support.sofa_files import write_sphere

ONE, MOVING, SCENE = "part_1/box/kitchen/1", "part_1/box/kitchen/2", "part_3/box/kitchen/1"
#: A microphone at the centre of the head, and two beside it.
ARRAY = """
microphones:
  - {name: centre, position: [0.0, 0.0, 0.0]}
  - {position: [0.1, 0.0, 0.0]}
  - {name: ahead, position: [0.0, 0.0, -0.2]}
"""
OBSERVATIONS = [
    {"part": "part_1", "scan": "box", "room": "kitchen", "index": 1, "category": "microwave"},
    {
        "part": "part_1", "scan": "box", "room": "kitchen", "index": 2, "category": "vacuum_cleaner",
        "source_motion": "path",
    },
    {
        "part": "part_3", "scan": "box", "room": "kitchen", "index": 1, "instances": {"microwave": 1, "clock": 1},
        "sources": [{"category": "microwave"}, {"category": "clock", "gain_db": -6}],
        "background": {"kind": "noise", "snr_db": 10},
    },
    {"like": SCENE, "index": 2, "sources": []},
    {"like": SCENE, "index": 3, "sources": [{"category": "clock"}]},
]  # fmt: skip


def call(manifest: Path, root: Path, *options: object) -> Result:
    fixed = ["--audio", "tracer", "--frames", "2", "--size", "32", "--workers", "1"]
    return CliRunner().invoke(generate, [str(manifest), "-o", str(root), *fixed, *map(str, options)])


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("manifest")
    (folder / "array.yaml").write_text(ARRAY)
    return write_manifest(folder, observations=OBSERVATIONS)


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("h5py", reason="h5py is not installed: pip install 'avs3d-bench[sofa]'")
    licence = "Creative Commons Attribution 4.0"
    folder = tmp_path_factory.mktemp("head")
    return write_sphere(folder / "sphere.sofa", License=licence, Organization="A laboratory")


@pytest.fixture(scope="module")
def plain(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The engine's own head alone."""
    root = tmp_path_factory.mktemp("plain") / "tree"
    done = call(manifest, root)
    assert done.exit_code == 0, done.output
    return Dataset(root)


@pytest.fixture(scope="module")
def every(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """All receivers beside the engine's own head, with responses and stems."""
    root = tmp_path_factory.mktemp("every") / "tree"
    array = manifest.parent / "array.yaml"
    done = call(manifest, root, "--with", "ambisonics=2", "--with", "array", array, "--with", "rirs", "--with=stems")
    assert done.exit_code == 0, done.output
    return Dataset(root)


@pytest.fixture(scope="module")
def measured(manifest: Path, head: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A measured head, and ambisonics of order 1."""
    root = tmp_path_factory.mktemp("measured") / "tree"
    done = call(manifest, root, "--only", ONE, "--hrtf", head, "--with", "ambisonics")
    assert done.exit_code == 0, done.output
    return Dataset(root)


def record_of(observation: Observation) -> ObservationRecord:
    assert observation.record is not None
    return observation.record


def errors(root: Path, deep: bool = True) -> list[str]:
    return [f"{one.path}: {one.message}" for one in validate(root, deep=deep).problems if one.severity == "error"]


# --- what is written -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_receiver_has_clips_responses_and_stems_of_its_own(every: Dataset) -> None:
    assert errors(every.root) == []
    for observation in every:
        record = record_of(observation)
        assert record.acoustics.ambisonics is not None
        assert record.acoustics.ambisonics.channel_names == tuple("WYZXVTRSU")
        assert record.acoustics.array == ArrayRecord(
            microphones=(
                MicrophoneRecord(name="centre", position=(0, 0, 0)),
                MicrophoneRecord(name="mic_2", position=(0.1, 0, 0)),
                MicrophoneRecord(name="ahead", position=(0, 0, -0.2)),
            )
        )
        for frame in observation.frames:
            assert frame.ambisonics().shape == (9, 44_100)
            assert frame.array().shape == (3, 44_100)
    frame = every[ONE].frames[1]
    for receiver, channels in ((None, 2), ("ambisonics", 9), ("array", 3)):
        assert frame.impulse_response(receiver=receiver).shape[0] == channels
    scene = every[SCENE].frames[1]
    assert scene.impulse_response("source_2", "array").shape[0] == 3
    assert scene.stem("background", "ambisonics").shape == (9, 44_100)


@pytest.mark.slow
def test_the_two_ears_hear_the_same_bytes_whatever_else_is_there(plain: Dataset, every: Dataset) -> None:
    assert list(plain.keys) == list(every.keys)
    for observation in plain:
        for path in sorted(observation.path.rglob("*.wav")) + sorted(observation.path.rglob("*.png")):
            other = every.root / path.relative_to(plain.root)
            assert path.read_bytes() == other.read_bytes(), path
        record, other = record_of(observation), record_of(every[observation.key])
        assert record.frames == other.frames
        assert record.acoustics.settings == other.acoustics.settings
        assert '"ambisonics"' not in (observation.path / layout.OBSERVATION_JSON).read_text()


@pytest.mark.slow
def test_a_microphone_at_the_centre_hears_what_w_is(every: Dataset) -> None:
    """Both are the pressure there; only the background of part_3 is another draw."""
    for key in (ONE, MOVING, "part_3/box/kitchen/3"):
        for frame in every[key].frames:
            pressure, centre = frame.ambisonics()[0], frame.array()[0]
            np.testing.assert_allclose(centre, pressure, atol=2e-3 * np.abs(pressure).max())


def _direct(frame: Frame, entry: FrameRecord, source: str | None) -> np.ndarray:
    """(9, n) the ambisonic response from 0.3 ms before the direct sound arrives to 0.3 ms after it."""
    assert entry.distance is not None
    response = frame.impulse_response(source, "ambisonics").astype(np.float64)
    arrival = entry.distance / SPEED_OF_SOUND
    return response[:, round((arrival - 0.0003) * 44_100) : round((arrival + 0.0003) * 44_100)]


@pytest.mark.slow
def test_the_intensity_of_the_direct_sound_points_to_the_source(every: Dataset) -> None:
    judged = 0
    for key, source in ((ONE, None), (MOVING, None), (SCENE, "source_1"), ("part_3/box/kitchen/3", "source_1")):
        record = record_of(every[key])
        for frame, entry in zip(every[key].frames, record.frames, strict=True):
            if not entry.line_of_sight:
                continue
            direct = _direct(frame, entry, source)
            pressure, left, up, ahead = direct[:4]
            intensity = np.array([pressure @ ahead, pressure @ left, pressure @ up])
            azimuth, elevation = np.radians(-entry.azimuth), np.radians(entry.elevation)
            flat = np.cos(elevation)
            true = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)])
            off = np.degrees(np.arccos(intensity @ true / np.linalg.norm(intensity)))
            assert off < 4, (key, frame.name, off)
            # A band-limited pulse between two samples: its energy is that of amplitude 1 at 1 m, its peak is not.
            assert np.linalg.norm(pressure) == pytest.approx(1 / entry.distance, rel=0.35)
            judged += 1
    assert judged >= 4


@pytest.mark.slow
def test_a_part_3_is_the_sum_of_its_stems(every: Dataset) -> None:
    for frame in every[SCENE].frames:
        for receiver, whole in (("ambisonics", frame.ambisonics()), ("array", frame.array())):
            names = ("source_1", "source_2", "background")
            total = sum(frame.stem(name, receiver).astype(np.float64) for name in names)
            np.testing.assert_allclose(total, whole, atol=1e-6)
    # Silence has the channels of all others.
    for frame in every["part_3/box/kitchen/2"].frames:
        assert not frame.ambisonics().any()
        assert frame.array().shape == (3, 44_100)


@pytest.mark.slow
def test_the_background_has_the_level_and_the_covariance_of_a_diffuse_field(every: Dataset) -> None:
    observation = every[SCENE]
    background = record_of(observation).background
    assert background is not None
    noise = np.concatenate([frame.stem("background", "ambisonics") for frame in observation.frames], axis=1)
    power = np.mean(np.square(noise, dtype=np.float64), axis=1)
    assert 10 * np.log10(power[0]) == pytest.approx(background.level_db, abs=1.0)
    for degree in (1, 2):
        share = power[degree**2 : (degree + 1) ** 2] / power[0]
        np.testing.assert_allclose(share, 1 / (2 * degree + 1), rtol=0.25)


@pytest.mark.slow
def test_frames_can_be_regenerated(every: Dataset, manifest: Path) -> None:
    chosen = {ONE: (1,), MOVING: (0,), SCENE: (1,)}
    assert list(regenerate(every.root, chosen, manifest, lambda _: None)) == []


@pytest.mark.slow
def test_a_changed_clip_differs_from_the_regenerated_one(every: Dataset, manifest: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(every.root, tmp_path / "copy"))
    path = root / SCENE / layout.audio_path(layout.clips_folder("array"), 1)
    media.write_wav(path, media.read_wav(path).samples * np.float32(0.999))
    (problem,) = regenerate(root, {SCENE: (1,)}, manifest, lambda _: None)
    assert problem == Problem("error", f"{SCENE}/audio_clips_array/frame_1.wav", "differs from the regenerated file")


# --- the identity of a run -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_rerun_keeps_what_the_same_receivers_heard_and_refuses_others(
    measured: Dataset, manifest: Path, head: Path, tmp_path: Path
) -> None:
    one = ("--only", ONE, "--with", "ambisonics")
    moved = shutil.copy(head, tmp_path / "elsewhere.sofa")
    before = tree_digest(measured.root)
    assert "0 made, 1 kept" in call(manifest, measured.root, *one, "--hrtf", moved).output
    other = write_sphere(tmp_path / "other.sofa", 901)
    for options in ((*one, "--hrtf", other), one, ("--only", ONE, "--hrtf", head)):
        done = call(manifest, measured.root, *options)
        assert isinstance(done.exception, UsageError)
        assert "was generated with other options or versions: " in str(done.exception)
    assert tree_digest(measured.root) == before
    sha, theirs = media.sha256_file(head)[:12], media.sha256_file(other)[:12]
    refused = call(manifest, measured.root, *one, "--hrtf", other, "--frames", 3, "--size", 48, "--with", "depth")
    assert str(refused.exception) == (
        f"{measured.root / ONE}: was generated with other options or versions: --frames (recorded 2, asked 3), "
        f"--size (recorded 32, asked 48), --hrtf (recorded sphere.sofa, sha256 {sha}…, asked other.sofa, "
        f"sha256 {theirs}…), --with depth (recorded without, asked with); "
        f"choose another folder with -o, or regenerate it with --remake '{ONE}'"
    )
    assert "--hrtf (recorded sphere.sofa, sha256" in str(call(manifest, measured.root, *one).exception)


@pytest.mark.slow
def test_every_option_that_is_recorded_is_named_where_it_differs(every: Dataset, manifest: Path) -> None:
    source, array = read_manifest(manifest), manifest.parent / "array.yaml"
    same: dict[str, Any] = {"audio": "tracer", "frames": 2, "size": 32, "extras": ("rirs", "stems")}
    receivers = choose_receivers("tracer", ambisonics=2, array=array)
    assert receivers.array is not None
    other = ArrayRecord(
        microphones=(MicrophoneRecord(name="centre", position=(0, 0, 0.5)), *receivers.array.microphones[1:])
    )
    cases: list[tuple[str, Receivers, dict[str, Any], str]] = [
        (ONE, receivers, {}, ""),
        ("part_3/box/kitchen/2", receivers, {}, ""),
        (SCENE, receivers, {"extras": ("rirs",)}, "--with stems (recorded with, asked without)"),
        (SCENE, receivers, {"extras": ("stems",)}, "--with rirs (recorded with, asked without)"),
        (ONE, OWN_HEAD, {"audio": "analytic"}, "--audio (recorded tracer, asked analytic), "
         "--with ambisonics (recorded order 2, asked none), --with array (recorded 3 microphones, asked none)"),
        (ONE, Receivers(ambisonics=2, array=other), {},
         "--with array (recorded centre at [0.0, 0.0, 0.0], asked centre at [0.0, 0.0, 0.5])"),
    ]  # fmt: skip
    for key, chosen, change, expected in cases:
        (plan,) = make_plans(source, GenerateOptions(only=[key], receivers=chosen, **same | change))
        record = record_of(every[key])
        assert describe_differences(plan, record) == expected
        assert (plan.digest == record.plan_sha256) == (expected == "")
        if not expected:
            elsewhere = replace(plan, options=replace(plan.options, vision="cuda", device="cuda"), seed=plan.seed + 1)
            elsewhere = replace(elsewhere, backends=plan.backends | {"tracer": "0.0"})
            assert describe_differences(elsewhere, record) == (
                "--vision (recorded embree, asked cuda), --device (recorded cpu, asked cuda), "
                f"seed of the manifest (recorded {plan.seed}, asked {plan.seed + 1}), "
                f"version of tracer (recorded {plan.backends['tracer']}, asked 0.0)"
            )


@pytest.mark.slow
def test_the_measured_head_is_named_by_its_contents_and_its_licence(measured: Dataset, head: Path) -> None:
    assert errors(measured.root) == []
    record = record_of(measured[ONE])
    found = record.acoustics.hrtf
    assert found is not None
    assert (found.asset, found.name, found.author) == ("hrtf:sphere.sofa", "CC-BY-4.0", "A laboratory")
    assert found.sha256 == media.sha256_file(head) == record.acoustics.settings["hrtf_sha256"]
    assert measured.record is not None
    assert found.attribution in measured.record.attributions
    assert measured.record.licence == "Apache-2.0"
    for path in (measured.root / layout.DATASET_JSON, measured[ONE].path / layout.OBSERVATION_JSON):
        assert str(head.parent) not in path.read_text()


@pytest.mark.slow
def test_the_sphere_of_a_file_sounds_as_the_sphere_in_closed_form(measured: Dataset, plain: Dataset) -> None:
    for mine, other in zip(measured[ONE].frames, plain[ONE].frames, strict=True):
        ours, theirs = mine.audio().astype(np.float64), other.audio().astype(np.float64)
        levels = 10 * np.log10(np.mean(ours**2, axis=1) / np.mean(theirs**2, axis=1))
        np.testing.assert_allclose(levels, 0, atol=0.5)


@pytest.mark.slow
def test_regeneration_needs_the_file_of_the_head(measured: Dataset, manifest: Path, head: Path, tmp_path: Path) -> None:
    def made(hrtf: Path | None) -> list[Problem]:
        return list(regenerate(measured.root, {ONE: (0,)}, manifest, lambda _: None, hrtf))

    assert made(head) == []
    assert made(Path(shutil.copy(head, tmp_path / os.fsdecode(b"K\xf6pfe.sofa")))) == []
    with pytest.raises(UsageError, match=r"heard with the head of sphere\.sofa \(sha256 .*name that file with --hrtf"):
        made(None)
    with pytest.raises(UsageError, match=r"other\.sofa: sha256 .*, but part_1/box/kitchen/1 was heard with"):
        made(write_sphere(tmp_path / "other.sofa", 901))


def test_all_that_the_sound_depends_on_is_in_the_digest_of_the_plan(manifest: Path) -> None:
    source = read_manifest(manifest)

    def digest(receivers: Receivers) -> str:
        return make_plans(source, GenerateOptions(only=[ONE], audio="tracer", receivers=receivers))[0].digest

    place = MicrophoneRecord(name="a", position=(0, 0, 0))
    arrays = [ArrayRecord(microphones=(place, place.model_copy(update=change))) for change in (
        {"name": "b"}, {"name": "c"}, {"name": "b", "position": (0.1, 0, 0)}
    )]  # fmt: skip
    choices = [
        OWN_HEAD,
        *(Receivers(ambisonics=order) for order in (1, 2, 3)),
        *(Receivers(array=array) for array in arrays),
        *(Receivers(hrtf=Path("/a.sofa"), hrtf_sha256=sha) for sha in ("1" * 64, "2" * 64)),
    ]
    assert len({digest(choice) for choice in choices}) == len(choices)
    moved = Receivers(hrtf=Path("/b.sofa"), hrtf_sha256="1" * 64)
    assert digest(moved) == digest(choices[-2])
    assert make_plans(source, GenerateOptions(only=[ONE], audio="tracer"))[0].digest == digest(OWN_HEAD)


def test_a_head_that_changes_during_a_run_is_refused(head: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(head, tmp_path / "head.sofa"))
    chosen = choose_receivers("tracer", hrtf=path)
    assert chosen.head() is chosen.head()
    write_sphere(path, 700)
    with pytest.raises(Avs3dError, match=r"head\.sofa: its sha256 is .*, expected .*must not change while a dataset"):
        chosen.head()
    path.unlink()
    with pytest.raises(Avs3dError, match=r"head\.sofa"):
        chosen.head()


# --- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("audio", ["soundspaces", "analytic"])
@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--hrtf", "none.sofa"], "--hrtf"),
        (["--with", "ambisonics"], "--with ambisonics"),
        (["--with", "array", "none.yaml"], "--with array"),
    ],
)
def test_other_engines_have_no_other_receivers(
    manifest: Path, tmp_path: Path, audio: str, options: list[str], what: str
) -> None:
    done = CliRunner().invoke(generate, [str(manifest), "-o", str(tmp_path / "out"), "--audio", audio, *options])
    assert isinstance(done.exception, UsageError)
    assert str(done.exception) == f"{what} needs the engine tracer, found {audio}: add --audio tracer"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [["generate", "demo.yaml", "-o", "out"], ["validate", "out", "--regenerate", "1"]])
def test_an_empty_name_of_a_head_is_one_line(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run(avs3d, [*command, "--hrtf", ""])
    assert ended.value.code == 2
    expected = "avs3d: error: Invalid value for '--hrtf': the name is empty; expected a file or folder\n"
    assert capsys.readouterr().err == expected


def _empty(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("missing.sofa", None, "missing"),
        ("text.sofa", lambda path: path.write_text("no HDF5"), "cannot be read as a SOFA file"),
        ("empty.sofa", _empty, "cannot be read as a SOFA file"),
        ("fir.sofa", lambda path: write_sphere(path, 100, SOFAConventions="GeneralFIR"), "convention is GeneralFIR"),
        ("slow.sofa", lambda path: write_sphere(path, 100, Data_SamplingRate=np.array([100.0])), "SamplingRate"),
        ("mono.sofa", lambda path: write_sphere(path, 100, Data_IR=np.ones((100, 1, 64))), "1 receiver, expected two"),
        ("none.sofa", lambda path: write_sphere(path, 100, Data_IR=None), "has no Data.IR"),
    ],
)
def test_a_bad_head_is_named_before_anything_is_rendered(
    manifest: Path, tmp_path: Path, name: str, make: object, message: str
) -> None:
    pytest.importorskip("h5py", reason="h5py is not installed: pip install 'avs3d-bench[sofa]'")
    path = tmp_path / name
    if callable(make):
        make(path)
    done = call(manifest, tmp_path / "out", "--hrtf", path)
    assert isinstance(done.exception, Avs3dError), done.output
    assert message in str(done.exception)
    assert name in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--with", "ambisonics=4"], "the order of ambisonics is '4', expected 1, 2 or 3"),
        (["--with", "ambisonics="], "the order of ambisonics is ''"),
        (["--with", "smell"], "'smell' is not one of 'depth', 'rirs', 'stems', 'ambisonics', 'array'"),
        (["--with", "depth=2"], "'depth=2' is not one of"),
        (["--with", "array"], "--with array FILE"),
        (["--with="], "'' is not one of"),
    ],
)
def test_a_wrong_value_of_with_gets_one_line(manifest: Path, tmp_path: Path, options: list[str], message: str) -> None:
    done = call(manifest, tmp_path / "out", *options)
    assert done.exit_code == 2
    assert message in done.output
    assert not (tmp_path / "out").exists()


def test_a_bad_array_is_named_before_anything_is_rendered(manifest: Path, tmp_path: Path) -> None:
    path = tmp_path / "far.yaml"
    path.write_text("microphones: [{position: [3, 0, 0]}]")
    for words in (["--with", "array", path], ["--with", f"array={path}"], ["--with=array", path]):
        done = call(manifest, tmp_path / "out", *words)
        assert isinstance(done.exception, Avs3dError)
        assert "far.yaml: microphones.0.position.0" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_options_in_python() -> None:
    with pytest.raises(UsageError, match="unknown folder 'ambisonics'"):
        GenerateOptions(extras=("ambisonics",))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="order is 0"):
        choose_receivers("tracer", ambisonics=0)
    with pytest.raises(UsageError, match="--with ambisonics needs the engine tracer"):
        acoustic_backend(EngineOptions(audio="analytic", receivers=Receivers(ambisonics=1)))


# --- what the validator finds ----------------------------------------------------------------------------------------


def test_cardioids_to_the_sides_tell_the_side_of_a_wave() -> None:
    wave = np.random.default_rng(1).standard_normal(44_100)
    for azimuth in (-170, -90, -20, 20, 45, 90, 135):
        sine = np.sin(np.radians(azimuth))
        found = cardioid_level(np.stack([wave, -sine * wave, 0 * wave, 0 * wave]))  # Y to the left
        assert found is not None
        assert found.db == pytest.approx(
            np.clip(20 * np.log10(max(1 + sine, 1e-9) / max(1 - sine, 1e-9)), -10, 10), abs=0.1
        )


def test_coherence_tells_a_sound_field_from_another() -> None:
    one, other = np.random.default_rng(2).standard_normal((2, 44_100))
    delayed = np.concatenate([np.zeros(20), -0.3 * one[:-20]])
    assert low_coherence(one, delayed) > 0.98
    assert low_coherence(one, other) < 0.3


def _edited(every: Dataset, tmp_path: Path, edit: object) -> list[str]:
    """Errors of a copy of the first observation with edited clips; hashes and sizes of its files are renewed."""
    root = tmp_path / "copy"
    shutil.copytree(every.root / ONE, root / ONE)
    assert callable(edit)
    edit(root / ONE)
    path = root / ONE / layout.OBSERVATION_JSON
    record = json.loads(path.read_text())
    for name in record["files"]:
        if (root / ONE / name).is_file():
            record["files"][name] = media.sha256_file(root / ONE / name)
            record["sizes"][name] = (root / ONE / name).stat().st_size
    path.write_text(json.dumps(record))
    return [each for each in errors(root) if layout.DATASET_JSON not in each]


def _clips(folder: Path, receiver: str, change: object) -> None:
    assert callable(change)
    for index in range(2):
        path = folder / layout.audio_path(layout.clips_folder(receiver), index)
        media.write_wav(path, change(media.read_wav(path).samples.copy()))


def _scaled(samples: np.ndarray, channels: slice, factor: float) -> np.ndarray:
    samples[channels] *= np.float32(factor)
    return samples


def _noise(samples: np.ndarray) -> np.ndarray:
    """Other sound of the same level; the microwave hums, so that another second of it would still be coherent."""
    other = np.random.default_rng(3).standard_normal(samples.shape)
    return np.asarray(other * samples.std(axis=1, keepdims=True), dtype=np.float32)


def _swapped(folder: Path) -> None:
    """The clips of the two frames change places."""
    one, other = (folder / layout.audio_path(layout.clips_folder("ambisonics"), index) for index in (0, 1))
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)


def _without_responses(folder: Path) -> None:
    """As if it was made without `--with rirs`, whose responses find almost everything."""
    record = json.loads((folder / layout.OBSERVATION_JSON).read_text())
    for key in ("files", "sizes"):
        record[key] = {name: value for name, value in record[key].items() if not name.startswith("rirs")}
    (folder / layout.OBSERVATION_JSON).write_text(json.dumps(record))
    for path in folder.glob("rirs*"):
        shutil.rmtree(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: _scaled(x, slice(1, 4), 3**0.5), "channels of degree 1 have +4."),
        (lambda x: _scaled(x, slice(4, 9), 5**0.5), "channels of degree 2 have +"),
        (lambda x: _scaled(x, slice(0, 9), 0.1), "dB re W, expected"),
        (lambda x: _scaled(x, slice(3, 4), 0.0), "silent in channel 3, but not in others"),
        (lambda x: x * np.float32(2 / np.abs(x).max()), "clipped: the peak is 2.000"),
        (lambda x: x[:4], "4 channel(s), expected 9"),
        (_noise, "coherence of W and the mean of both ears is 0."),
        (lambda x: x[:, :1000], "1000 samples, expected 44100"),
    ],
)
def test_a_wrong_ambisonic_clip_is_found_without_its_responses(
    every: Dataset, tmp_path: Path, change: object, message: str
) -> None:
    def edit(folder: Path) -> None:
        _without_responses(folder)
        _clips(folder, "ambisonics", change)

    found = _edited(every, tmp_path, edit)
    assert any(message in each for each in found), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_swapped, "does not explain audio_clips_ambisonics/frame_0.wav"),
        (lambda folder: _clips(folder, "array", lambda x: x[[1, 0, 2]]), "does not explain audio_clips_array/frame_0"),
        (lambda folder: _clips(folder, "array", lambda x: _scaled(x, slice(2, 3), 0.05)), "microphone ahead is -2"),
        (lambda folder: shutil.rmtree(folder / "audio_clips_array"), "audio_clips_array: missing folder; expected 2"),
        (lambda folder: shutil.rmtree(folder / "rirs_array"), "rirs_array: missing folder; expected 2"),
        (lambda folder: (folder / "audio_clips_array/frame_1.wav").unlink(), "frame_1.wav: missing file"),
        (lambda folder: (folder / "audio_clips_array/frame_2.wav").write_bytes(b""), "frame_2.wav: surplus file"),
    ],
)
def test_a_wrong_file_of_a_receiver_is_found(every: Dataset, tmp_path: Path, edit: object, message: str) -> None:
    found = _edited(every, tmp_path, edit)
    assert any(message in each for each in found), found
