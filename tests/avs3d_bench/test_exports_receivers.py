"""Exports of ambisonics and arrays: the same bytes, and what their channels are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import decode_sample
from avs3d_bench.exports.card import write_card
from avs3d_bench.exports.croissant import write_croissant
from avs3d_bench.exports.samples import samples_of
from avs3d_bench.validate import validate
from tests.support import tiny
from tests.support.tiny_receivers import ARRAY, add_receivers

KEY = tiny.SINGLE
BOTH = ("ambisonics", "array")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return add_receivers(tiny.write_dataset(tmp_path_factory.mktemp("receivers") / "tiny", frames=3, keys=(KEY,)))


def test_the_dataset_is_valid(root: Path) -> None:
    assert [problem.message for problem in validate(root, deep=True).problems if problem.severity == "error"] == []


def test_a_sample_has_the_clips_that_are_asked_for_and_says_what_they_are(root: Path) -> None:
    observation = Dataset(root)[KEY]
    plain, both = (samples_of(observation, "all", extras)[1] for extras in ((), BOTH))
    assert [member.name for member in both.members if member not in plain.members] == ["ambisonics.wav", "array.wav"]
    decoded = decode_sample({member.name: member.read() for member in both.members})
    frame = observation.frames[1]
    np.testing.assert_array_equal(decoded["ambisonics"], frame.ambisonics())
    np.testing.assert_array_equal(decoded["array"], frame.array())
    assert both.facts["receivers"] == {
        "ambisonics": {"order": 1, "channel_order": "ACN", "normalisation": "SN3D"},
        "array": ARRAY.model_dump(mode="json"),
    }


def test_other_datasets_have_the_samples_that_they_had(root: Path, tmp_path: Path) -> None:
    plain = Dataset(tiny.write_dataset(tmp_path / "plain", frames=3, keys=(KEY,)))[KEY]
    for mine, other in zip(samples_of(Dataset(root)[KEY], "all"), samples_of(plain, "all", BOTH), strict=True):
        assert [member.name for member in mine.members] == [member.name for member in other.members]
        assert "receivers" not in other.facts
        assert {name: value for name, value in mine.facts.items() if name != "receivers"} == other.facts


def test_torch_items(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed")
    from avs3d_bench.exports import AVS3DDataset

    item = AVS3DDataset(root, split="all", ambisonics=True, array=True)[2]
    frame = Dataset(root)[KEY].frames[2]
    np.testing.assert_array_equal(item["ambisonics"].numpy(), frame.ambisonics())
    np.testing.assert_array_equal(item["array"].numpy(), frame.array())
    plain = tiny.write_dataset(tmp_path / "plain", frames=3, keys=(KEY,))
    with pytest.raises(Avs3dError, match="audio_clips_ambisonics: missing; load with ambisonics=False"):
        AVS3DDataset(plain, split="all", ambisonics=True)


def test_huggingface_rows(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("datasets", reason="datasets is not installed: pip install 'avs3d-bench[exports]'")
    import datasets

    from avs3d_bench.exports.huggingface import waveform, write_huggingface

    write_huggingface(root, tmp_path / "out", extras=BOTH, workers=1)
    cache = str(tmp_path / "cache")
    rows = datasets.load_dataset(str(tmp_path / "out"), "frames", cache_dir=cache)
    for row in (*rows["train"], *rows["test"]):
        frame = next(one for one in Dataset(root)[KEY].frames if one.name == row["frame"])
        np.testing.assert_array_equal(waveform(row["ambisonics"])[0], frame.ambisonics())
        np.testing.assert_array_equal(waveform(row["array"])[0], frame.array())
    (observation,) = datasets.load_dataset(str(tmp_path / "out"), "observations", cache_dir=cache)["observations"]
    assert json.loads(observation["receivers"])["array"] == ARRAY.model_dump(mode="json")


def test_the_description_and_the_card_name_the_folders(root: Path, tmp_path: Path) -> None:
    write_croissant(root, root / "croissant.json")
    description: dict[str, Any] = json.loads((root / "croissant.json").read_text())
    (root / "croissant.json").unlink()
    patterns = {one["@id"]: one.get("includes") for one in description["distribution"]}
    assert patterns["ambisonics-files"] == "part_*/*/*/*/audio_clips_ambisonics/frame_*.wav"
    assert patterns["array-files"] == "part_*/*/*/*/audio_clips_array/frame_*.wav"
    assert {"ambisonics", "array"} <= {one["@id"] for one in description["recordSet"]}
    write_card(root, tmp_path / "README.md")
    card = (tmp_path / "README.md").read_text()
    assert "`audio_clips_ambisonics/`: one second of ambisonics, 44.1 kHz, ACN, SN3D" in card


def test_a_receiver_that_is_not_there_is_named(root: Path, tmp_path: Path) -> None:
    plain = Dataset(tiny.write_dataset(tmp_path / "plain", frames=1, keys=(KEY,)))[KEY]
    with pytest.raises(UsageError, match="not made with the receiver 'array'; it has the two ears alone"):
        plain.frames[0].impulse_response(receiver="array")
    assert plain.channels() == 2
    assert Dataset(root)[KEY].channels("array") == 3
    with pytest.raises(UsageError, match="receiver 'omni'; it has ambisonics, array"):
        Dataset(root)[KEY].channels("omni")
    with pytest.raises(Avs3dError, match=r"audio_clips_array/frame_0\.wav"):
        plain.frames[0].array()
    assert layout.clips_folder() == layout.BINAURAL
