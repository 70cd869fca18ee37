"""`avs3d export seld`: a reader of the challenge's formats, angle conventions, refusals.

The tiny dataset's head looks 5.7° to the left, but 126° to the left in its last two frames, so that it turns by 120° in
one second; sources stand still.
"""

from __future__ import annotations

import importlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench import cli
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import MovedRecord, ObservationRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.cli import export
from avs3d_bench.exports.seld import panorama
from avs3d_bench.exports.seld.events import TurningHead, events_of
from avs3d_bench.exports.seld.maps import energy_maps, grid
from avs3d_bench.exports.seld.recordings import SeldClip, plan_scenes
from avs3d_bench.exports.seld.sound import turned
from avs3d_bench.exports.seld.write import SeldIndex, SeldSettings, write_seld
from avs3d_bench.formats import media
from avs3d_bench.geometry import Pose, ambisonic_axes
from tests.support import tiny, tiny_scenes
from tests.support.markdown_code import ROOT, blocks
from tests.support.shared import SharedDatasets
from tests.support.tiny_receivers import plane_wave
from tests.support.tiny_seld import CLASSES, LABEL, accdoa, add_foa, angle, intensity, labels_of, sound_of, vector

FRAMES = 10
STEREO_HEADER = "frame,class,source,azimuth,distance,onscreen"
TRAIN = "dev-train-avs3d"
#: Labels have whole degrees: half a degree each way, in azimuth and in elevation.
ROUNDING = 0.75


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return add_foa(tiny_scenes.write_part_3(tmp_path_factory.mktemp("seld") / "tiny", frames=FRAMES, stems=True))


@pytest.fixture(scope="module")
def foa(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("foa") / "out"
    write_seld(root, folder, SeldSettings(maps=True), workers=1)
    return folder


@pytest.fixture(scope="module")
def stereo(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stereo") / "out"
    write_seld(root, folder, SeldSettings(form="stereo"), workers=1)
    return folder


def name_of(folder: Path, key: str, start: int = 0) -> str:
    index = json.loads((folder / "seld.json").read_text())
    return str(next(one["name"] for one in index["recordings"] if (one["observation"], one["start"]) == (key, start)))


def test_a_baseline_reads_every_recording(foa: Path) -> None:
    names = sorted(path.stem for path in (foa / f"foa_dev/{TRAIN}").iterdir())
    assert names == [f"fold3_room1_mix{number:03d}" for number in range(1, 6)]
    assert names == sorted(path.stem for path in (foa / f"metadata_dev/{TRAIN}").iterdir())
    for name in names:
        sound = sound_of(foa / f"foa_dev/{TRAIN}/{name}.wav")
        assert sound.shape == (FRAMES * 24_000, 4)
        labels = labels_of(foa / f"metadata_dev/{TRAIN}/{name}.csv")
        assert set(labels) <= set(range(len(sound) // LABEL))
        assert list(labels) == sorted(labels)
        for class_index, source, azimuth, elevation, distance in (row for rows in labels.values() for row in rows):
            assert class_index in range(CLASSES)
            assert source in range(3)
            assert -180 <= azimuth <= 180
            assert -90 <= elevation <= 90
            assert 10 < distance < 1000, "centimetres"
        norms = np.linalg.norm(accdoa(labels, len(sound) // LABEL), axis=1)
        np.testing.assert_allclose(norms[norms > 0], 1.0)


def test_a_source_is_labelled_while_its_programme_lasts(foa: Path) -> None:
    labels = labels_of(foa / f"metadata_dev/{TRAIN}/{name_of(foa, tiny_scenes.BOTH)}.csv")
    active = {source: {frame for frame, rows in labels.items() if any(row[1] == source for row in rows)}
              for source in range(3)}  # fmt: skip
    assert active[0] == {*range(20), *range(45, 60)}
    assert active[1] == {*range(20, 45), *range(60, 100)}
    assert active[2] == set(range(100))
    kinds = {row[1]: row[0] for rows in labels.values() for row in rows}
    assert kinds == {0: 3, 1: 3, 2: 6}, "two microwaves and a telephone"


def test_silence_and_a_source_in_another_room_have_no_labels(foa: Path) -> None:
    for key in (tiny_scenes.SILENT, tiny_scenes.AWAY):
        assert (foa / f"metadata_dev/{TRAIN}/{name_of(foa, key)}.csv").read_text() == ""
    assert not sound_of(foa / f"foa_dev/{TRAIN}/{name_of(foa, tiny_scenes.SILENT)}.wav").any()
    assert sound_of(foa / f"foa_dev/{TRAIN}/{name_of(foa, tiny_scenes.AWAY)}.wav").any()


@pytest.mark.parametrize("key", [tiny_scenes.FIRST, tiny_scenes.SECOND])
def test_the_sound_comes_from_where_the_labels_say(foa: Path, key: str) -> None:
    name = name_of(foa, key)
    sound, labels = sound_of(foa / f"foa_dev/{TRAIN}/{name}.wav"), labels_of(foa / f"metadata_dev/{TRAIN}/{name}.csv")
    assert len(labels) == 10 * FRAMES
    directions = {frame: vector(*rows[0][2:4]) for frame, rows in labels.items()}
    off = [angle(intensity(sound, frame), directions[frame]) for frame in labels]
    # While the head turns by 12° within a label frame, its label is that of the middle; the energy is not even.
    assert max(off) < ROUNDING + 0.5
    assert angle(directions[70], directions[79]) > 90, "the head turns within this second"


@pytest.mark.parametrize(
    ("place", "azimuth", "elevation"),
    [((0, 1.5, -2), 0, 0), ((-2, 1.5, 0), 90, 0), ((2, 1.5, 0), -90, 0), ((0.0, 1.5, 2), 180, 0),
     ((0, 3.5, 0), 0, 90), ((0, 0.5, -1), 0, -45), ((-1, 1.5, -1), 45, 0)],
)  # fmt: skip
def test_azimuth_is_positive_to_the_left(
    root: Path, place: tuple[float, float, float], azimuth: int, elevation: int
) -> None:
    record = Dataset(root)[tiny_scenes.FIRST].record
    assert record is not None
    event = events_of(moved(record, place), record.class_ids, head_of(record))[0]
    assert abs(event.azimuth) == pytest.approx(180) if azimuth == 180 else True
    assert angle(vector(event.azimuth, event.elevation), vector(azimuth, elevation)) < 1e-4
    assert event.distance == pytest.approx(np.linalg.norm(np.subtract(place, (0, 1.5, 0))))


def moved(record: ObservationRecord, place: tuple[float, float, float], **frame: object) -> ObservationRecord:
    """The record with its only source at a place, and a listener at (0, 1.5, 0) who looks down −Z."""
    still = {"position": (0.0, 1.5, 0.0), "rotation": (1.0, 0.0, 0.0, 0.0)} | frame
    frames = tuple(one.model_copy(update=still) for one in record.frames)
    sources = tuple(one.model_copy(update={"position": place}) for one in record.sources or ())
    return record.model_copy(update={"frames": frames, "sources": sources, "source_position": place})


def head_of(record: ObservationRecord, *, turns: bool = True) -> TurningHead:
    still = Pose((0.0, 1.5, 0.0), (1.0, 0.0, 0.0, 0.0))
    return TurningHead((still,) * len(record.frames), turns)


def test_moving_sources_go_in_straight_lines_and_their_last_second_is_left_out(root: Path) -> None:
    """Two at once: one goes to the right ahead of the listener, the other ahead on the right."""
    record = Dataset(root)[tiny_scenes.BOTH].record
    assert record is not None
    places, steps = ((0.0, 1.5, -2.0), (2.0, 1.5, 0.0)), ((0.4, 0.0, 0.0), (0.0, 0.0, -0.2))
    at_rest = moved(record, places[0])
    sources = tuple(
        one.model_copy(update={"position": place})
        for one, place in zip(at_rest.sound_sources, (*places, at_rest.sound_sources[2].position), strict=True)
    )
    frames = [
        one.model_copy(update={"moved": ways_of(at_rest, steps, number)}) for number, one in enumerate(at_rest.frames)
    ]
    moving = at_rest.model_copy(update={"sources": sources, "frames": tuple(frames)})
    events = events_of(moving, record.class_ids, head_of(record))
    assert max(event.frame for event in events) == 10 * (FRAMES - 1) - 1
    for event in events:
        way = (event.frame + 0.5) / 10
        if event.source == 0:
            assert np.tan(np.radians(-event.azimuth)) == pytest.approx(0.4 * way / 2)
        if event.source == 1:
            assert np.tan(np.radians(90 + event.azimuth)) == pytest.approx(0.2 * way / 2)
    assert {event.source for event in events} == {0, 1, 2}


def ways_of(
    record: ObservationRecord, steps: tuple[tuple[float, float, float], ...], number: int
) -> tuple[MovedRecord, ...]:
    """Where the instances of the first sources are after a number of steps."""
    ways = []
    for source, step in zip(record.sound_sources, steps, strict=False):
        assert source.instance is not None
        own = record.instance(source.instance)
        x, y, z = (np.asarray(own.position) + np.multiply(number, step)).tolist()
        ways.append(MovedRecord(instance=own.id, position=(x, y, z), rotation=own.rotation))
    return tuple(sorted(ways, key=lambda one: one.instance))


def test_the_engine_is_heard_from_where_the_labels_say(tmp_path: Path, root: Path) -> None:
    """The tracer's own ambisonics in a room with absorbing walls, through the whole export."""
    from generators import acoustics

    room = acoustics.Room.shoebox((6, 4, 6), materials=[0.95] * 6)
    engine, listener = acoustics.Tracer(seed=1), Pose((3.0, 1.5, 3.0), (1.0, 0.0, 0.0, 0.0))
    noise = np.random.default_rng(0).uniform(-0.3, 0.3, layout.BINAURAL_SAMPLES)
    places = {"ahead": (3.0, 1.5, 1.5), "left": (1.5, 1.5, 3.0), "behind": (3.0, 1.5, 4.5), "above": (3.0, 3.0, 3.0)}
    tree = tmp_path / "tree"
    shutil.copytree(root / tiny_scenes.FIRST, tree / tiny_scenes.FIRST)
    for name, place in places.items():
        record = Dataset(tree)[tiny_scenes.FIRST].record
        assert record is not None
        one = moved(record, place, position=listener.position)
        media.write_json(tree / tiny_scenes.FIRST / layout.OBSERVATION_JSON, one)
        heard = engine.render(room, noise, place, listener, receiver=acoustics.Ambisonics(1))
        for second in range(FRAMES):
            path = layout.audio_path(layout.clips_folder(layout.AMBISONICS), second)
            media.write_wav(tree / tiny_scenes.FIRST / path, heard[:, : layout.BINAURAL_SAMPLES] * 0.1)
        write_seld(tree, tmp_path / name, workers=1)
        stem = f"{TRAIN}/fold3_room1_mix001"
        (_, _, azimuth, elevation, distance), *_ = labels_of(tmp_path / name / f"metadata_dev/{stem}.csv")[5]
        found = intensity(sound_of(tmp_path / name / f"foa_dev/{stem}.wav"), 5)
        expected = {"ahead": vector(0), "left": vector(90), "behind": vector(180), "above": vector(0, 90)}[name]
        assert angle(found, expected) < 3.0, "what the walls send back"
        assert angle(vector(azimuth, elevation), expected) < ROUNDING
        assert distance == 150


def test_ambisonics_turn_against_the_head() -> None:
    quarter = np.array([0.0, 0.0, np.pi / 2])  # to the left about the upward axis, in the axes of AmbiX
    ahead = plane_wave(np.ones(1000, dtype=np.float32), 0.0, 0.0)
    out = turned(ahead, quarter)
    np.testing.assert_array_equal(out[0], ahead[0])
    np.testing.assert_allclose(out[:, 0], ahead[:, 0], atol=1e-6)
    np.testing.assert_allclose(out[[3, 1, 2], 500], vector(45), atol=1e-6)


def test_a_map_is_brightest_where_the_source_is(foa: Path) -> None:
    name = name_of(foa, tiny_scenes.FIRST)
    labels = labels_of(foa / f"metadata_dev/{TRAIN}/{name}.csv")
    with np.load(foa / f"maps_dev/{TRAIN}/{name}.npz") as maps:
        assert maps["energy"].shape == (10 * FRAMES, 36, 72)
        for frame in (0, 35, 75, 95):
            row, column = np.unravel_index(maps["energy"][frame].argmax(), (36, 72))
            there = vector(maps["azimuth"][column], maps["elevation"][row])
            assert angle(there, vector(*labels[frame][0][2:4])) < 4.5, "cells of 5°"


def test_a_map_has_the_energy_of_a_wave_and_its_left_edge_is_behind(tmp_path: Path, root: Path) -> None:
    observation = Dataset(root)[tiny_scenes.FIRST]
    record = observation.record
    assert record is not None
    maps = energy_maps(observation, 1, TurningHead.of(record.frames, turns=True))
    loudest = observation.frames[0].ambisonics()[0].astype(float).reshape(10, -1)
    np.testing.assert_allclose(maps.max(axis=(1, 2)), np.mean(loudest**2, axis=1), rtol=0.01)
    azimuth, elevation = grid()
    assert (azimuth[0], azimuth[-1], elevation[0], elevation[-1]) == (177.5, -177.5, 87.5, -87.5)


def test_stereo_clips_are_those_of_the_challenge(stereo: Path) -> None:
    paths = sorted((stereo / f"stereo_dev/{TRAIN}").iterdir())
    assert len(paths) == 5 * FRAMES // 5
    for path in paths:
        assert re.fullmatch(r"fold3_room1_mix00[1-5]_deg[0-3][0-9]{2}_start00[05]0", path.stem)
        assert sound_of(path).shape == (5 * 24_000, 2)
        labels = labels_of(stereo / f"metadata_dev/{TRAIN}/{path.stem}.csv", STEREO_HEADER)
        assert set(labels) <= set(range(50))
        for class_index, _, azimuth, distance, onscreen in (row for rows in labels.values() for row in rows):
            assert class_index in range(CLASSES)
            assert -90 <= azimuth <= 90
            assert 10 < distance < 1000
            assert onscreen in (0, 1)


@pytest.mark.parametrize("key", [tiny_scenes.FIRST, tiny_scenes.SECOND])
@pytest.mark.parametrize("start", [0, 5])
def test_stereo_is_a_pair_that_looks_where_the_name_says(foa: Path, stereo: Path, key: str, start: int) -> None:
    name = name_of(stereo, key, start)
    sound = sound_of(stereo / f"stereo_dev/{TRAIN}/{name}.wav")
    labels = labels_of(stereo / f"metadata_dev/{TRAIN}/{name}.csv", STEREO_HEADER)
    whole = labels_of(foa / f"metadata_dev/{TRAIN}/{name_of(foa, key)}.csv")
    view = int(re.search(r"_deg(\d+)_", name)[1])  # type: ignore[index]
    for frame, ((_, _, azimuth, distance, onscreen),) in labels.items():
        (_, _, before, elevation, far) = whole[frame + 10 * start][0]
        ahead, left, up = vector(before + view, elevation)
        assert distance == far
        assert azimuth == pytest.approx(np.degrees(np.arctan2(left, abs(ahead))), abs=1.01)
        shown = ahead > 0 and abs(left / ahead) < np.tan(np.radians(50)) and abs(up / ahead) < 0.6704
        margin = abs(abs(left / ahead) - np.tan(np.radians(50)))
        assert onscreen == shown or margin < 0.05, "labels are rounded"
        side, mid = (sound[frame * LABEL : (frame + 1) * LABEL] @ [[1, 1], [-1, 1]]).T
        ratio = (side @ mid) / (mid @ mid)
        assert ratio == pytest.approx(left, abs=0.025), "W ± Y: louder on the left if azimuth is positive"


def test_binaural_clips_are_the_ears(root: Path, tmp_path: Path) -> None:
    write_seld(root, tmp_path / "out", SeldSettings(form="binaural", only=("part_3/*/1",), gain_db=6.0), workers=1)
    name = name_of(tmp_path / "out", tiny_scenes.FIRST, 5)
    assert name == "fold3_room1_mix001_deg000_start0050"
    sound = sound_of(tmp_path / f"out/stereo_dev/{TRAIN}/{name}.wav")
    frames = Dataset(root)[tiny_scenes.FIRST].frames[5:]
    clips = np.concatenate([frame.audio() for frame in frames], axis=1) * 10 ** (6 / 20)
    # Below 10 kHz both hold the same spectrum.
    before, after = np.fft.rfft(clips)[:, :50_000] / clips.shape[1], np.fft.rfft(sound.T)[:, :50_000] / len(sound)
    np.testing.assert_allclose(after, before, atol=1e-4 * np.abs(before).max() + 2e-6)
    # The two ears cannot be turned: labels keep the head of their frame, also where it turns in the next second.
    labels = labels_of(tmp_path / f"out/metadata_dev/{TRAIN}/{name}.csv", STEREO_HEADER)
    assert {rows[0][2] for frame, rows in labels.items() if 20 <= frame < 30} == {labels[20][0][2]}


def test_homes_are_for_training_or_for_testing() -> None:
    keys = [f"part_1/home_{n}/kitchen/{k}" for n in range(11) for k in (1, 2)]
    scenes = plan_scenes(keys)
    splits: dict[str, set[str]] = {}
    for scene in scenes:
        splits.setdefault(scene.key.split("/")[1], set()).add(scene.split)
        assert scene.name.startswith("fold3" if "train" in scene.split else "fold4")
    assert all(len(found) == 1 for found in splits.values())
    assert sum("dev-test-avs3d" in found for found in splits.values()) == 2
    assert len({scene.name for scene in scenes}) == len(keys)
    assert {scene.split for scene in plan_scenes(keys[:2])} == {TRAIN}, "a single home"
    chosen = plan_scenes(keys, ["home_3", "home_1*"])
    tested = {scene.key.split("/")[1] for scene in chosen if "test" in scene.split}
    assert tested == {"home_1", "home_10", "home_3"}
    with pytest.raises(UsageError, match="--test-home cave: matches none of the homes home_0"):
        plan_scenes(keys, ["cave"])


def test_the_same_dataset_gives_the_same_bytes_and_says_where_it_is_from(root: Path, foa: Path, tmp_path: Path) -> None:
    write_seld(root, tmp_path / "again", SeldSettings(maps=True), workers=1)
    for path in (path for path in foa.rglob("*") if path.is_file()):
        assert (tmp_path / "again" / path.relative_to(foa)).read_bytes() == path.read_bytes(), path
    index = media.read_record(foa / "seld.json", SeldIndex)
    record = Dataset(root).record
    assert record is not None
    assert (index.dataset, index.dataset_digest) == (record.name, record.digest)
    assert index.classes["washing_machine"] == 0
    assert index.classes["telephone"] == 6
    assert {one.group for one in index.recordings} == {tiny_scenes.FIRST}
    named = {name: digest for one in index.recordings for name, digest in one.files.items()}
    assert {str(path.relative_to(foa)) for path in foa.rglob("*") if path.is_file()} == {*named, "seld.json"}
    assert all(media.sha256_file(foa / name) == digest for name, digest in named.items())


def test_refusals(root: Path, tmp_path: Path, shared_dataset: SharedDatasets) -> None:
    plain = shared_dataset(frames=3, size=16)
    with pytest.raises(UsageError, match=r"has no ambisonic clips; make the dataset again.*--audio tracer --with ambi"):
        write_seld(plain, tmp_path / "out")
    with pytest.raises(UsageError, match="3 s, expected at least 5 s for a clip of binaural"):
        write_seld(plain, tmp_path / "out", SeldSettings(form="binaural"))
    release = tiny.write_release(tmp_path / "release")
    with pytest.raises(UsageError, match=r"no observation\.json, as in the official release, so that no event can be"):
        write_seld(release, tmp_path / "out")
    for key in Dataset(release).keys:
        (release / key / layout.POSES_JSON).touch()
    with pytest.raises(UsageError, match="its truth is sealed, so that no event can be labelled"):
        write_seld(release, tmp_path / "out")
    with pytest.raises(UsageError, match=r"none of 5 observations matches part_9/\*"):
        write_seld(root, tmp_path / "out", SeldSettings(only=("part_9/*",)))
    (tmp_path / "full").mkdir()
    (tmp_path / "full/mine.txt").write_text("mine")
    with pytest.raises(UsageError, match="full: exists already; choose another folder"):
        write_seld(root, tmp_path / "full")
    with pytest.raises(UsageError, match=r"reaches .* of full scale; export all of it with --gain-db -?\d+"):
        write_seld(root, tmp_path / "out", SeldSettings(gain_db=40), workers=1)
    for settings, said in (
        (SeldSettings(form="stereo", maps=True), "--maps belongs to --format foa"),
        (SeldSettings(video_width=360), "--video-width belongs to --video"),
        (SeldSettings(manifest=tmp_path), "--manifest belongs to --video"),
        (SeldSettings(hrtf=tmp_path), "--hrtf belongs to --video"),
        (SeldSettings(video=True, video_width=90), "--video-width 90: expected a multiple of 4 from 64"),
    ):
        with pytest.raises(UsageError, match=re.escape(said)):
            write_seld(root, tmp_path / "out", settings)
    assert not (tmp_path / "out").exists()


def test_a_submission_is_no_dataset(tmp_path: Path) -> None:
    (tmp_path / "sub/part_1/flat/kitchen/1/masks").mkdir(parents=True)
    (tmp_path / "sub/submission.json").write_text("{}")
    with pytest.raises(UsageError, match="a submission, no dataset"):
        write_seld(tmp_path / "sub", tmp_path / "out")


def test_a_damaged_clip_leaves_nothing_behind(root: Path, tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    shutil.copytree(root / tiny_scenes.FIRST, tree / tiny_scenes.FIRST)
    clip = tree / tiny_scenes.FIRST / "audio_clips_ambisonics/frame_7.wav"
    clip.write_bytes(clip.read_bytes()[:1000])
    with pytest.raises(Avs3dError, match=r"frame_7\.wav: truncated"):
        write_seld(tree, tmp_path / "out", workers=1)
    assert not list(tmp_path.glob("*out*"))


def test_the_command_says_what_it_has_written(root: Path, tmp_path: Path) -> None:
    options = ["-o", str(tmp_path / "out"), "--format", "stereo", "--only", "part_3/*/1", "--workers", "1"]
    done = CliRunner().invoke(export, ["seld", str(root), *options], catch_exceptions=False)
    assert done.output == f"{TRAIN}: 2 recordings, 10 s, 100 labels\n{tmp_path / 'out'}\n"
    with pytest.raises(SystemExit) as ended:
        cli.run(cli.avs3d, ["export", "seld", str(root), "-o", str(tmp_path / "out")])
    assert ended.value.code == 2


def colour_of(rays: np.ndarray) -> np.ndarray:
    """(…, 3) a smooth colour of each direction."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.asarray(np.rint(127 + 100 * unit), dtype=np.uint8)


def coloured_faces(side: int) -> np.ndarray:
    """(6, …) faces whose pixels have the colour of their direction in the world."""
    camera = panorama.face_camera(side)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    local = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], axis=-1)
    return np.stack([colour_of(pose.to_world(local)) for pose in panorama.face_poses((0.0, 0.0, 0.0))])


@pytest.mark.parametrize("form", ["foa", "stereo"])
def test_films_show_every_direction_where_it_belongs(form: str) -> None:
    rays = panorama.panorama_rays(64) if form == "foa" else panorama.perspective_rays(64, 90)
    side = panorama.face_side(64, form)  # type: ignore[arg-type]
    poses = tuple(Pose.from_yaw((0, 0, 0), yaw) for yaw in (0.3, 1.3))
    head = TurningHead(poses, turns=True)
    pictures = panorama.clip_pictures(
        SeldClip("one", 0, 1, 0), rays, lambda _: coloured_faces(side), head, panorama.face_camera(side)
    )
    shown = list(pictures)
    assert len(shown) == 10
    for part, picture in enumerate(shown):
        pose = Pose.from_yaw((0, 0, 0), 0.3 + (part + 0.5) / 10)
        assert np.abs(picture.astype(int) - colour_of(pose.to_world(rays))).max() <= 4
    middle = rays[rays.shape[0] // 2, rays.shape[1] // 2]
    expected = [0, 0, -1] if form == "foa" else [1, 0, 0]
    assert angle(middle / np.linalg.norm(middle), np.array(expected)) < 5
    if form == "foa":
        assert ambisonic_axes(rays[16, 16])[1] > 0.99, "a quarter from the left edge is the left"


def test_a_film_has_thirty_pictures_a_second_and_is_shared_by_siblings(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    av = pytest.importorskip("av", reason="PyAV is not installed: pip install 'avs3d-bench[inspect]'")
    asked: list[str] = []

    def render(request: panorama.FaceRequest) -> panorama.Faces:
        asked.append(request.key)
        return lambda _: coloured_faces(panorama.face_side(64, "foa"))

    monkeypatch.setattr("avs3d_bench.exports.seld.write.find_renderer", lambda: render)
    settings = SeldSettings(video=True, video_width=64, only=("part_3/*/[12]",))
    write_seld(root, tmp_path / "out", settings, workers=1)
    assert asked == [tiny_scenes.FIRST]
    first, second = sorted((tmp_path / f"out/video_dev/{TRAIN}").iterdir())
    assert first.read_bytes() == second.read_bytes()
    with av.open(str(first)) as container:
        pictures = [picture.to_ndarray(format="rgb24") for picture in container.decode(video=0)]
    assert len(pictures) == 30 * FRAMES
    assert pictures[0].shape == (32, 64, 3)
    # The head looks 5.7° to the left: in the middle is what is there in the world.
    there = colour_of(Pose.from_yaw((0, 0, 0), 0.1).to_world(np.array([0.0, 0.0, -1.0])))
    assert np.abs(pictures[0][15:17, 31:33].mean(axis=(0, 1)) - there).max() < 6


@pytest.mark.slow
def test_the_recipe_of_the_page_is_short_and_learns(
    foa: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    loader, recipe = [block for block in blocks(ROOT / "docs/export-seld.md") if block.language == "python"]
    assert len(recipe.code.splitlines()) <= 15
    assert loader.file is not None
    (tmp_path / loader.file).write_text(loader.code)
    (tmp_path / "seld").symlink_to(foa)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    torch.manual_seed(0)
    exec(compile(recipe.code, "recipe", "exec"), {})
    losses = [float(line.split()[-1]) for line in capsys.readouterr().out.splitlines()]
    assert len(losses) == 4
    assert losses[-1] < 0.8 * losses[0]
    # What the loader of the page makes of the labels is what the reader of this test does.
    spectra, targets = next(importlib.import_module("read_seld").read("seld", TRAIN))
    assert spectra.shape == (7, 257, 50 * FRAMES)
    labels = labels_of(foa / f"metadata_dev/{TRAIN}/fold3_room1_mix001.csv")
    expected = accdoa(labels, 10 * FRAMES)[:, :, :7]
    np.testing.assert_allclose(targets.numpy(), expected.reshape(len(expected), -1), atol=1e-6)
