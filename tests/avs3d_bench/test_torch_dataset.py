"""`AVS3DDataset`: contents of an item, for our datasets and the release; workers, transforms, stacks, damaged files."""

from __future__ import annotations

import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.colmap import ColmapModel, read_model, write_model
from tests.support import tiny, tiny_scenes
from tests.support.shared import SharedDataset
from tests.support.tiny_scenes import FIRST, GROUP, SILENT

torch = pytest.importorskip("torch", reason="torch is not installed: pip install torch")

from torch.utils.data import DataLoader, Dataset as TorchDataset  # noqa: E402, I001

from avs3d_bench.exports import AVS3DDataset  # noqa: E402


@pytest.fixture(scope="module")
def ours(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(extras=True)


def test_an_item_is_the_frame(ours: Path):
    dataset = AVS3DDataset(ours, "all", instances=True, depth=True)
    assert isinstance(dataset, TorchDataset)
    assert len(dataset) == 2 * tiny.FRAMES
    for number, frame in enumerate(frame for observation in Dataset(ours) for frame in observation.frames):
        item = dataset[number]
        assert frame.record is not None
        assert item["rgb"].dtype == torch.uint8
        np.testing.assert_array_equal(item["rgb"].numpy(), frame.rgb().transpose(2, 0, 1))
        assert item["rgb"].is_contiguous()
        assert item["binaural"].shape == (2, 44_100)
        np.testing.assert_array_equal(item["binaural"].numpy(), frame.audio())
        assert item["mask"].dtype == torch.bool
        np.testing.assert_array_equal(item["mask"].numpy(), frame.mask())
        np.testing.assert_array_equal(item["instance_ids"].numpy(), frame.instance_ids())
        np.testing.assert_array_equal(item["depth"].numpy(), frame.depth())
        np.testing.assert_allclose(item["camera_to_world"].numpy(), frame.pose.matrix, atol=1e-6)
        assert item["camera_to_world"].dtype == item["intrinsics"].dtype == torch.float32
        assert item["azimuth"] == pytest.approx(frame.record.azimuth, rel=1e-6)
        assert item["visible_pixels"] == frame.record.visible_pixels
        assert CATEGORIES[item["category_index"]] == item["category"] == "microwave"
        assert (item["key"], item["frame"], item["split"]) == (frame.observation.key, frame.name, frame.split)
        assert (item["frame_index"], item["item"]) == (frame.index, number)
        # The pose projects the source to the side that the azimuth says.
        local = torch.linalg.inv(item["camera_to_world"]) @ torch.cat([item["source_position"], torch.ones(1)])
        assert torch.rad2deg(torch.atan2(local[0], -local[2])) == pytest.approx(frame.record.azimuth, abs=1e-3)


def test_splits_and_choices(ours: Path):
    assert len(AVS3DDataset(ours)) == 16
    assert [AVS3DDataset(ours, "test")[n]["frame"] for n in range(4)] == ["frame_000", "frame_008"] * 2
    assert AVS3DDataset(ours, only=["part_2/*"]).keys == (tiny.MULTI,)
    item = AVS3DDataset(ours, frames=False, audio=False, mask=False)[0]
    assert not {"rgb", "binaural", "mask", "instance_ids", "depth"} & item.keys()
    assert AVS3DDataset(ours)[-1]["item"] == 15
    with pytest.raises(IndexError):
        AVS3DDataset(ours)[16]
    assert repr(AVS3DDataset(ours, stack=3)).endswith("train: 4 stacks of 3 frames, 2 observations)")


@pytest.mark.parametrize("style", ["names", "files", "cameras", "absent"])
def test_the_release_lacks_what_it_lacks(tmp_path: Path, style: str):
    root = tiny.write_release(tmp_path / "release", style=style)
    item = AVS3DDataset(root, "test")[1]
    assert set(item) == {
        "rgb", "binaural", "mask", "intrinsics", "camera_to_world", "key", "frame", "split", "frame_index", "item",
    }  # fmt: skip
    np.testing.assert_allclose(item["camera_to_world"].numpy(), tiny.path_of()[8].matrix, atol=1e-6)
    with pytest.raises(Avs3dError, match=r"instance_masks: missing; load with instances=False"):
        AVS3DDataset(root, instances=True)


def test_frames_that_colmap_did_not_register_collate_with_the_others(tmp_path: Path):
    root = tiny.write_release(tmp_path / "release")
    sparse = root / tiny.SINGLE / "sparse/0"
    camera, poses = next(iter(read_model(sparse).cameras.values())), dict(enumerate(tiny.path_of()))
    del poses[2]
    names = [f"frame_{number:03d}.png" for number in poses]
    none = np.empty(0, dtype=np.int64)
    shutil.rmtree(sparse)
    write_model(
        sparse,
        ColmapModel.from_poses(
            camera, names, list(poses.values()), np.empty((0, 3)), np.empty((0, 3)), none, none, np.empty((0, 2))
        ),
    )
    batch = next(iter(DataLoader(AVS3DDataset(root, "all"), batch_size=2 * tiny.FRAMES)))
    unknown = batch["camera_to_world"].isnan().flatten(1).any(dim=1)
    assert unknown.nonzero().flatten().tolist() == [2]


def test_a_picture_that_is_listed_but_gone_is_named(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data")
    (root / tiny.SINGLE / "input/frame_003.png").unlink()
    with pytest.raises(Avs3dError, match=r"camera_splits\.json: lists frame_003, whose picture is missing"):
        AVS3DDataset(root)


def test_a_moving_source_is_where_it_is_at_the_frames_time(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data")

    def move(data: dict[str, Any]) -> None:
        data["source_motion"] = "path"
        for number, frame in enumerate(data["frames"]):
            frame["source_position"] = [0.1 * number, 1.2, -2.2]
            frame["instance_position"] = [0.1 * number - 0.3, 1.0, -2.6]
            frame["instance_rotation"] = [1, 0, 0, 0]

    tiny.edit_record(root, tiny.SINGLE, move)
    dataset = AVS3DDataset(root, "all")
    positions = torch.stack([dataset[n]["source_position"] for n in range(tiny.FRAMES)])
    np.testing.assert_allclose(positions[:, 0].numpy(), 0.1 * np.arange(tiny.FRAMES), atol=1e-6)
    assert dataset[tiny.FRAMES]["source_position"][0] == pytest.approx(0.7), "the other source stands still"


@pytest.mark.slow
def test_batches_are_the_same_for_any_number_and_kind_of_workers(ours: Path):
    dataset = AVS3DDataset(ours, transform=half)

    def batches(**options: Any) -> list[dict[str, Any]]:
        order = torch.Generator().manual_seed(5)
        return list(DataLoader(dataset, batch_size=5, shuffle=True, generator=order, **options))

    want = batches()
    for options in ({"num_workers": 2}, {"num_workers": 1, "multiprocessing_context": "spawn"}):
        for expected, found in zip(want, batches(**options), strict=True):
            assert expected.keys() == found.keys()
            for name, value in expected.items():
                assert torch.equal(value, found[name]) if torch.is_tensor(value) else value == found[name], name
    assert want[0]["rgb"].shape == (5, 3, 32, 32)
    assert want[0]["mask"].shape == (5, 32, 32)
    assert want[0]["item"].dtype == torch.int64


def half(item: dict[str, Any]) -> dict[str, Any]:
    """A joint transform: every second pixel of the picture and of its mask, and the camera that belongs to it."""
    scale = torch.tensor([[0.5, 1, 0.5], [1, 0.5, 0.5], [1, 1, 1]])
    return item | {
        "rgb": item["rgb"][:, ::2, ::2],
        "mask": item["mask"][::2, ::2],
        "intrinsics": item["intrinsics"] * scale,
    }


def test_transforms_may_write_into_what_they_get(ours: Path):
    def spoil(item: dict[str, Any]) -> dict[str, Any]:
        for value in item.values():
            if torch.is_tensor(value):
                value.zero_()
        return item

    spoiled, clean = AVS3DDataset(ours, transform=spoil), AVS3DDataset(ours)
    assert spoiled[0]["camera_to_world"].abs().sum() == 0
    spoiled.transform = None
    assert torch.equal(spoiled[0]["camera_to_world"], clean[0]["camera_to_world"])
    assert spoiled[0]["camera_to_world"].abs().sum() > 0


def test_pickled_it_is_the_same(ours: Path):
    dataset = AVS3DDataset(ours, stack=2)
    dataset[0]
    again = pickle.loads(pickle.dumps(dataset))
    assert torch.equal(again[3]["rgb"], dataset[3]["rgb"])


def test_no_file_stays_open(ours: Path):
    handles = Path("/proc/self/fd")
    if not handles.is_dir():
        pytest.skip("open files are counted in /proc, which this system lacks")
    dataset = AVS3DDataset(ours, instances=True, depth=True)
    dataset[0]
    before = len(list(handles.iterdir()))
    for number in range(len(dataset)):
        dataset[number]
    assert len(list(handles.iterdir())) == before


def test_stacks_follow_time_and_stay_in_their_observation(ours: Path):
    dataset = AVS3DDataset(ours, stack=3)
    assert len(dataset) == 4, "eight train frames an observation: two windows of three, the rest is dropped"
    item = dataset[1]
    assert item["rgb"].shape == (3, 3, 64, 64)
    assert item["binaural"].shape == (3, 2, 44_100)
    assert item["camera_to_world"].shape == (3, 4, 4)
    assert item["frame"] == ["frame_004", "frame_005", "frame_006"]
    assert item["frame_index"].tolist() == [4, 5, 6]
    assert item["key"] == tiny.SINGLE
    assert dataset[2]["key"] == tiny.MULTI
    assert dataset.locate(2)[0] == (tiny.MULTI, "frame_001", 1)
    batch = next(iter(DataLoader(dataset, batch_size=2)))
    assert batch["rgb"].shape == (2, 3, 3, 64, 64)


@pytest.mark.parametrize(
    ("file", "data", "message"),
    [
        ("input/frame_001.png", b"", r"input/frame_001\.png: empty file"),
        ("input/frame_001.png", None, r"input/frame_001\.png: missing"),
        ("semantic_masks/frame_001.png", b"\x89PNG\r\n\x1a\n", r"semantic_masks/frame_001\.png: truncated"),
        ("audio_clips_binaural/frame_1.wav", b"RIFF", r"frame_1\.wav: "),
    ],
)
def test_a_damaged_sample_is_named_by_its_file(tmp_path: Path, file: str, data: bytes | None, message: str):
    root = tiny.write_dataset(tmp_path / "data")
    path = root / tiny.SINGLE / file
    dataset = AVS3DDataset(root)
    path.unlink()
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(Avs3dError, match=message):
        dataset[0]
    assert dataset[1]["frame"] == "frame_002"


def test_workers_pass_the_name_of_the_damaged_file_on(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data")
    tiny.replace(root / tiny.MULTI / "input/frame_002.png", b"\x89PNG")
    with pytest.raises(Avs3dError, match=r"input/frame_002\.png: "):
        list(DataLoader(AVS3DDataset(root), batch_size=4, num_workers=2))


@pytest.mark.slow
def test_a_clip_of_another_length_is_refused(tmp_path: Path):
    from avs3d_bench.formats import media

    root = tiny.write_dataset(tmp_path / "data")
    path = root / tiny.SINGLE / "audio_clips_binaural/frame_1.wav"
    path.unlink()
    media.write_wav(path, np.zeros((2, 100)))
    with pytest.raises(Avs3dError, match=r"frame_1\.wav: sound \(2, 100\) at 44100 Hz, expected \(2, 44100\)"):
        AVS3DDataset(root)[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "val"}, "expected one of train, test, all"),
        ({"only": ["part_7/*"]}, "none of 2 observations matches part_7"),
        ({"stack": 0}, "stack=0: expected a number of frames"),
        ({"stack": 9}, "no stack of 9 frames in split train; expected at least one"),
    ],
)
def test_arguments_that_mean_nothing(ours: Path, options: dict[str, Any], message: str):
    with pytest.raises(UsageError, match=message):
        AVS3DDataset(ours, **options)


# --- part_3 observations ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("loading") / "scenes"
    return tiny_scenes.write_part_3(folder, frames=4, stems=True)


@pytest.fixture(scope="module")
def all_parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("loading") / "all"
    tiny.write_dataset(root, frames=4)
    return tiny_scenes.write_part_3(root, frames=4, stems=True, keys=GROUP)


def test_an_item_of_a_scene(scenes: Path):
    dataset = AVS3DDataset(scenes, "all", stems=True)
    seen = set()
    for number, frame in enumerate(frame for observation in Dataset(scenes) for frame in observation.frames):
        item, record, entry = dataset[number], frame.observation.record, frame.record
        assert record is not None
        assert entry is not None
        np.testing.assert_array_equal(item["mask"].numpy(), frame.mask())
        np.testing.assert_array_equal(item["category_mask"].numpy(), frame.category_mask())
        assert item["category_mask"].dtype == torch.uint8
        heard = {record.source(heard.source).category for heard in entry.audible or ()}
        assert {CATEGORIES[c] for c in torch.nonzero(item["audible"]).flatten().tolist()} == heard
        assert item["audible"].shape == (7,)
        assert item["group"] == FIRST
        assert item["stems"].shape == (3, 2, 44_100)
        np.testing.assert_allclose((item["stems"].sum(dim=0) + item["background"]).numpy(), frame.audio(), atol=1e-6)
        expected = [CATEGORIES.index(source.category) + 1 for source in record.sources or ()]
        assert item["stem_classes"].tolist() == expected + [0] * (3 - len(expected))
        seen.add((item["category_index"].item(), item["category"], item["sounding_instance"].item()))
    assert seen == {(3, "microwave", 1), (3, "microwave", 3), (-1, "", -1), (6, "telephone", -1)}


def test_nothing_sounds(scenes: Path):
    item = AVS3DDataset(scenes, "all", only=[SILENT])[0]
    assert item["category_index"] == -1
    assert not item["audible"].any()
    assert not item["mask"].any()
    assert not item["binaural"].any()
    for name in ("azimuth", "elevation", "distance", "source_position"):
        assert torch.isnan(item[name]).all()
    assert item["source_position"].shape == (3,)


def test_items_of_all_parts_are_in_one_batch(all_parts: Path):
    dataset = AVS3DDataset(all_parts, "all", stems=True)
    batch = next(iter(DataLoader(dataset, batch_size=len(dataset))))
    assert batch["audible"].shape == (len(dataset), 7)
    assert batch["stems"].shape == (len(dataset), 3, 2, 44_100)
    # An observation of part_1 is a scene of one source that is always audible.
    assert batch["group"][0] == batch["key"][0] == tiny.SINGLE
    assert torch.nonzero(batch["audible"][0]).flatten().tolist() == [CATEGORIES.index("microwave")]
    torch.testing.assert_close(batch["stems"][0, 0], batch["binaural"][0])
    torch.testing.assert_close(batch["category_mask"][0] == 4, batch["mask"][0])


def test_stacks_of_scenes(scenes: Path):
    item = AVS3DDataset(scenes, "all", stack=2, stems=True)[0]
    assert item["stems"].shape == (2, 3, 2, 44_100)
    assert item["group"] == FIRST
    assert item["audible"].shape == (2, 7)


def test_items_of_the_other_parts_alone_have_no_scene(all_parts: Path):
    item = AVS3DDataset(all_parts, only=["part_1/*"], stems=True)[0]
    assert not {"category_mask", "audible", "group", "stems", "background"} & item.keys()


def test_what_is_not_read_is_not_there(scenes: Path):
    item = AVS3DDataset(scenes, categories=False)[0]
    assert not {"category_mask", "stems"} & item.keys()
    assert item["audible"].shape == (7,)


def test_stems_that_were_not_kept_are_one_line(tmp_path: Path):
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=2)
    with pytest.raises(Avs3dError, match=r"stems: missing; load with stems=False$"):
        AVS3DDataset(root, "all", stems=True)


def test_a_category_of_the_manifests_own_has_the_next_class(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=2, keys=(tiny.SINGLE,))

    def own(data: dict[str, Any]) -> None:
        data.update(schema_version="1.1", categories=["fan", "hair_dryer"], category="hair_dryer")
        data["instances"][0]["category"] = "hair_dryer"

    tiny.edit_record(root, tiny.SINGLE, own)
    item = AVS3DDataset(root, "all")[0]
    assert item["category"] == "hair_dryer"
    assert item["category_index"] == 8  # after the seven of the paper and the fan
