"""The layout: names sort by time, keys survive a round trip, invalid keys are refused by name."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import PARTS, ROOMS
from avs3d_bench.errors import Avs3dError, UsageError


def test_images_are_padded_and_audio_is_not():
    assert layout.image_path(layout.INPUT, 7) == "input/frame_007.png"
    assert layout.audio_path(layout.BINAURAL, 7) == "audio_clips_binaural/frame_7.wav"
    assert layout.audio_path(layout.MONO, 119) == "audio_clips_mono/frame_119.wav"
    assert layout.rir_path(7) == "rirs/frame_7.npz"


def test_names_sort_in_time():
    names = [layout.frame_name(i) for i in range(layout.MAX_FRAMES)]
    assert names == sorted(names)


@given(st.integers(0, 999))
def test_a_name_gives_its_index_back(index: int):
    assert layout.frame_index(layout.frame_name(index)) == index
    assert layout.frame_index(layout.audio_name(index)) == index


@pytest.mark.parametrize("index", [-1, 1000])
def test_a_name_that_would_not_sort_is_refused(index: int):
    with pytest.raises(Avs3dError, match="frame"):
        layout.frame_name(index)


def test_120_frames_split_15_to_105():
    train, test = layout.split_names(layout.frame_name(i) for i in range(120))
    assert len(test) == 15
    assert len(train) == 105
    assert test[:3] == ("frame_000", "frame_008", "frame_016")
    assert not set(train) & set(test)


@given(
    st.sampled_from(PARTS),
    st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,20}", fullmatch=True),
    st.sampled_from(ROOMS),
    st.integers(1, 99),
)
def test_a_key_survives_a_round_trip(part: str, scan: str, room: str, index: int):
    key = layout.observation_key(part, scan, room, index)
    assert key == f"{part}/{scan}/{room}/{index}"
    assert layout.parse_key(key) == layout.ObservationKey(part, scan, room, index)
    assert str(layout.parse_key(key)) == key


@pytest.mark.parametrize(
    ("key", "names"),
    [
        ("part_4/a/kitchen/1", "part_4"),
        ("part_1/a/ktchen/1", "did you mean 'kitchen'"),
        ("part_1/../kitchen/1", "scan id"),
        ("part_1/a/kitchen/0", "part_1\\|part_2"),
        ("part_1/a/kitchen/01", "part_1\\|part_2"),
        ("part_1/a/kitchen", "part_1\\|part_2"),
        ("part_1/a/kitchen/1/x", "part_1\\|part_2"),
        ("part_1/a\n/kitchen/1", "scan id"),
    ],
)
def test_what_is_no_key_is_refused_by_name(key: str, names: str):
    with pytest.raises(UsageError, match=names):
        layout.parse_key(key)


def test_expected_files_are_the_pinned_layout():
    files = layout.expected_files(1, depth=True, rirs=True)
    assert set(files) == {
        "input/frame_000.png",
        "images/frame_000.png",
        "audio_clips_binaural/frame_0.wav",
        "audio_clips_mono/frame_0.wav",
        "semantic_masks/frame_000.png",
        "instance_masks/frame_000.png",
        "depth/frame_000.png",
        "rirs/frame_0.npz",
        "camera_splits.json",
        "gt_3d/sounding_object.ply",
        "sparse/0/cameras.bin",
        "sparse/0/images.bin",
        "sparse/0/points3D.bin",
    }
    assert list(files) == sorted(files)
    assert len(layout.expected_files(120)) == 6 * 120 + 5
