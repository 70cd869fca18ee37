"""Reading: our trees and the official release through the same three classes."""

from __future__ import annotations

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Observation, parse_splits
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import write_model
from avs3d_bench.geometry import Intrinsics, direction_to, rotation_angle
from tests.support import tiny, tiny_scenes
from tests.support.shared import SharedDataset


@pytest.fixture(scope="module")
def ours(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(extras=True)


@pytest.fixture(scope="module", params=["names", "files", "cameras", "absent"])
def release(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write_release(tmp_path_factory.mktemp("tiny") / "release", style=request.param)


def test_iterating_gives_observations_in_order(ours: Path):
    dataset = Dataset(ours)
    assert [observation.key for observation in dataset] == [tiny.SINGLE, tiny.MULTI]
    assert dataset.keys == (tiny.SINGLE, tiny.MULTI)
    assert len(dataset) == 2
    assert dataset[tiny.MULTI].place.part == "part_2"
    assert dataset.name == "tiny"
    assert [o.key for o in dataset.select("part_2/*")] == [tiny.MULTI]
    assert repr(dataset) == f"Dataset({str(ours)!r}, 2 observations)"
    assert repr(dataset[tiny.SINGLE]) == "Observation(part_1/tiny/kitchen/1, 10 frames)"
    assert repr(dataset[tiny.SINGLE].frames[3]) == "Frame(part_1/tiny/kitchen/1, frame_003)"


def test_a_frame_gives_all_it_has(ours: Path):
    frame = Dataset(ours)[tiny.SINGLE].frames[1]
    camera, pose = Intrinsics.from_fov(tiny.SIZE), tiny.path_of()[1]
    rgb, ids, depth = tiny.render(camera, pose, tiny.BOXES[tiny.SINGLE])
    np.testing.assert_array_equal(frame.rgb(), rgb)
    np.testing.assert_array_equal(frame.instance_ids(), ids)
    np.testing.assert_array_equal(frame.mask(), ids == 1)
    np.testing.assert_allclose(frame.depth(), depth, atol=5.1e-4)
    assert frame.audio().shape == (2, 44100)
    assert frame.audio().dtype == np.float32
    assert frame.mono().shape == (88200,)
    assert frame.impulse_response().shape == (2, 8)
    assert frame.pose.position == pytest.approx(pose.position)
    assert frame.record.visible_pixels == frame.mask().sum()


@pytest.mark.parametrize("key", [tiny.SINGLE, tiny.MULTI])
def test_one_source_that_always_sounds_reads_as_those_of_part_3_do(ours: Path, key: str):
    observation = Dataset(ours)[key]
    record = observation.record
    assert record is not None
    assert record.sources is None, "the file is as it was"
    (source,) = record.sound_sources
    assert (source.id, source.instance, source.category) == ("source_1", record.sounding.id, record.category)
    assert (source.position, source.room) == (record.source_position, record.room)
    assert record.first_instance == record.sounding
    assert record.source("source_1") == source
    assert observation.group_key == key
    ((start, end),) = source.programme
    for frame, entry in zip(observation.frames, record.frames, strict=True):
        assert start <= entry.time < entry.time + 1 <= end
        assert record.audible_sources(entry) == (source,)
        assert record.audible_instances(entry) == (source.instance,)
        value = record.class_ids[source.category]
        kinds = frame.category_mask()
        assert kinds.dtype == np.uint8
        np.testing.assert_array_equal(kinds, np.where(frame.instance_ids() == source.instance, value, 0))


def test_the_sources_of_part_3_are_those_of_the_file(tmp_path: Path):
    data = Dataset(tiny_scenes.write_part_3(tmp_path / "data", frames=9))
    for key in tiny_scenes.GROUP:
        record = data[key].record
        assert record is not None
        assert record.sound_sources == record.sources
        for entry in record.frames:
            assert [source.id for source in record.audible_sources(entry)] == [
                one.source for one in entry.audible or ()
            ]
        assert data[key].group_key == tiny_scenes.FIRST
    assert data[tiny_scenes.SILENT].record.first_instance is None  # no source
    assert data[tiny_scenes.AWAY].record.first_instance is None  # its source is in another room


def test_dataset_json_names_what_the_sources_of_each_observation_play(ours: Path):
    for entry in Dataset(ours).record.observations:
        record = Dataset(ours)[entry.key].record
        sources = [record.sound] if record.sound else record.sources
        assert entry.sounds == tuple(source.asset for source in sources)


def test_the_split_is_seven_to_one(ours: Path):
    observation = Dataset(ours)[tiny.SINGLE]
    assert [frame.name for frame in observation.test] == ["frame_000", "frame_008"]
    assert len(observation.train) == 8
    assert observation.frames[8].split == "test"


@pytest.mark.slow
def test_the_release_reads_alike(release: Path, ours: Path):
    for there, here in zip(Dataset(release), Dataset(ours), strict=True):
        assert there.record is None
        assert there.category is None
        assert "official release" in repr(there)
        assert [f.name for f in there.test] == [f.name for f in here.test]
        assert astuple(there.intrinsics) == pytest.approx(astuple(here.intrinsics))
        for a, b in zip(there.frames, here.frames, strict=True):
            np.testing.assert_array_equal(a.rgb(), b.rgb())
            np.testing.assert_array_equal(a.mask(), b.mask())
            np.testing.assert_allclose(a.audio(), b.audio(), atol=2e-5)  # 16 bits there
            assert a.record is None
            assert a.has_pose
            assert a.pose.position == pytest.approx(b.pose.position, abs=1e-9)
            assert rotation_angle(a.pose, b.pose) < 1e-5


def test_poses_of_the_release_keep_left_and_right(release: Path):
    """The model's world has Y down; read back, the source must be on the side where it is louder."""
    for observation in Dataset(release):
        source = next(box for box in tiny.BOXES[observation.key] if box.sounding).source
        for frame in observation.frames:
            azimuth = direction_to(frame.pose, source).azimuth
            if 20 < abs(azimuth) < 160:
                left, right = (frame.audio().astype(float) ** 2).mean(axis=1)
                assert (right > left) == (azimuth > 0)


def test_what_the_release_lacks_is_said(release: Path):
    frame = Dataset(release)[tiny.SINGLE].frames[0]
    with pytest.raises(Avs3dError, match="instance_masks: missing"):
        frame.instance_ids()
    with pytest.raises(Avs3dError, match="depth: missing"):
        frame.depth()


def test_images_stand_in_for_input(release: Path, tmp_path: Path):
    root = tiny.clone(release, tmp_path / "copy")
    folder = root / tiny.SINGLE / "input"
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    observation = Observation(root, tiny.SINGLE)
    assert len(observation) == tiny.FRAMES
    assert observation.frames[0].rgb().shape == (tiny.SIZE, tiny.SIZE, 3)


def test_input_and_images_each_have_their_own_camera(release: Path, tmp_path: Path):
    """The release as COLMAP undistorts it: `images/` and `sparse/0` are smaller than `input/` and the masks."""
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap comes with the extra 'dev'")
    root = tiny.clone(release, tmp_path / "copy")
    observation = Observation(root, tiny.SINGLE)
    model, camera = observation.colmap, observation.intrinsics
    lens = pycolmap.Camera(
        model="OPENCV", width=tiny.SIZE, height=tiny.SIZE,
        params=[camera.fx, camera.fy, camera.cx, camera.cy, 0.05, -0.01, 0.001, 0.0005],
    )  # fmt: skip
    flat = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), lens)
    assert (flat.width, flat.height) != (tiny.SIZE, tiny.SIZE)
    smaller = Intrinsics(flat.width, flat.height, *flat.params)
    for path in (root / tiny.SINGLE / "sparse/0").iterdir():
        path.unlink()
    write_model(root / tiny.SINGLE / "sparse/0", replace(model, cameras={1: smaller}))
    for frame in observation.frames:
        path = frame.path("images")
        path.unlink()
        media.write_png_rgb(path, np.zeros((flat.height, flat.width, 3), np.uint8))

    observation = Observation(root, tiny.SINGLE)
    frame = observation.frames[0]
    assert astuple(observation.intrinsics) == pytest.approx(astuple(camera))
    assert frame.rgb().shape[:2] == (observation.intrinsics.height, observation.intrinsics.width)
    assert frame.mask().shape == frame.rgb().shape[:2]
    assert observation.undistorted_intrinsics == smaller
    assert frame.undistorted_rgb().shape[:2] == (smaller.height, smaller.width)


def test_our_pictures_have_no_distortion(ours: Path):
    observation = Dataset(ours)[tiny.SINGLE]
    assert observation.undistorted_intrinsics == observation.intrinsics
    np.testing.assert_array_equal(observation.frames[0].undistorted_rgb(), observation.frames[0].rgb())


def test_an_unregistered_frame_has_no_pose(release: Path, tmp_path: Path):
    root = tiny.clone(release, tmp_path / "copy")
    folder = root / tiny.SINGLE
    (folder / "input/frame_010.png").write_bytes((folder / "input/frame_009.png").read_bytes())
    frame = Observation(root, tiny.SINGLE).frames[10]
    assert not frame.has_pose
    with pytest.raises(Avs3dError, match="frame_010 is not registered"):
        _ = frame.pose


def test_opening_reads_nothing(ours: Path, tmp_path: Path):
    root = tiny.clone(ours, tmp_path / "copy")
    tiny.replace(root / tiny.SINGLE / "observation.json", b"{")
    observation = Dataset(root)[tiny.SINGLE]
    assert len(observation.frames) == tiny.FRAMES
    with pytest.raises(Avs3dError, match=r"observation\.json: .*Invalid JSON"):
        _ = observation.record


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({}, "no list of frame names under 'train'"),
        ([], "no list of frame names"),
        ({"train": [1], "test": []}, "'train'"),
        ({"train": ["frame_001.png"], "test": ["frame_001"]}, "frame_001 is listed twice"),
    ],
)
def test_broken_splits_are_named(data: object, says: str):
    with pytest.raises(Avs3dError, match=says):
        parse_splits(data, "camera_splits.json")


def test_a_folder_that_is_no_dataset_is_named(tmp_path: Path):
    with pytest.raises(UsageError, match="no such folder"):
        Dataset(tmp_path / "nowhere")
    with pytest.raises(UsageError, match="no dataset"):
        Dataset(tmp_path)


def test_an_unknown_observation_is_named(ours: Path):
    with pytest.raises(UsageError, match="did you mean 'part_1/tiny/kitchen/1'"):
        Dataset(ours)["part_1/tiny/kitchen/2"]
    assert "part_1/tiny/kitchen/2" not in Dataset(ours)
    assert layout.parse_key(tiny.SINGLE).room == "kitchen"


def test_observations_are_had_by_place_and_by_slice(ours: Path):
    dataset = Dataset(ours)
    assert [dataset[0].key, dataset[1].key, dataset[-1].key, dataset[np.int64(0)].key] == [
        *(tiny.SINGLE, tiny.MULTI),
        *(tiny.MULTI, tiny.SINGLE),
    ]
    assert [observation.key for observation in dataset[:]] == list(dataset.keys)
    assert [observation.key for observation in dataset[::-1]] == [tiny.MULTI, tiny.SINGLE]
    assert isinstance(dataset[1:], list)
    assert dataset[5:] == []
    assert dataset._ipython_key_completions_() == list(dataset.keys)


@pytest.mark.parametrize("place", [2, -3])
def test_a_place_that_does_not_exist_is_told(ours: Path, place: int):
    with pytest.raises(IndexError) as caught:
        Dataset(ours)[place]
    assert isinstance(caught.value, UsageError)
    assert str(caught.value) == f"{ours}: no observation at {place} among 2; expected -2 to 1, or a key"


def test_a_text_that_is_no_key_is_told_with_near_keys_and_their_number(ours: Path):
    dataset = Dataset(ours)
    with pytest.raises(KeyError) as caught:
        dataset["kitchen"]
    assert isinstance(caught.value, UsageError)
    assert str(caught.value) == (
        f"{ours}: no observation 'kitchen' among 2; did you mean '{tiny.SINGLE}' or '{tiny.MULTI}'?"
    )
    with pytest.raises(KeyError) as caught:
        dataset["xyz"]
    assert str(caught.value) == f"{ours}: no observation 'xyz' among 2; keys look like '{tiny.SINGLE}'"
    with pytest.raises(KeyError) as caught:
        dataset["a\n" * 5000]
    assert len(str(caught.value)) < len(str(ours)) + 200
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", [1.5, None, ("part_1", 0)])
def test_what_is_no_key_is_a_type_error(ours: Path, key: object):
    with pytest.raises(TypeError):
        Dataset(ours)[key]  # type: ignore[call-overload]


def test_an_empty_dataset_says_so(ours: Path, tmp_path: Path):
    (tmp_path / "dataset.json").write_bytes((ours / "dataset.json").read_bytes())
    for key in (0, "kitchen"):
        with pytest.raises(UsageError, match="among 0"):
            Dataset(tmp_path)[key]


def test_a_clip_at_another_rate_is_refused(ours: Path, tmp_path: Path):
    import io

    import soundfile

    root = tiny.clone(ours, tmp_path / "copy")
    stream = io.BytesIO()
    soundfile.write(stream, np.zeros((100, 2)), 48000, format="WAV")
    tiny.replace(root / tiny.SINGLE / "audio_clips_binaural/frame_0.wav", stream.getvalue())
    with pytest.raises(Avs3dError, match=r"frame_0\.wav: 48000 Hz, expected 44100 Hz"):
        Dataset(root)[tiny.SINGLE].frames[0].audio()
