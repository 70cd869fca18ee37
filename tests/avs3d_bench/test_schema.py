"""The records: pinned keys, refusals that name the field, committed JSON Schema without drift."""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from avs3d_bench.contract import schema, taxonomy
from avs3d_bench.contract.schema import CameraSplits, DatasetRecord, ObservationRecord, SubmissionRecord
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports import schema_files
from avs3d_bench.formats import files
from tests.support import tiny
from tests.support.shared import SharedDataset

COMMITTED = Path(schema.__file__).parents[1] / "schemas"


@pytest.fixture(scope="module")
def root(shared_dataset: SharedDataset) -> Path:
    return shared_dataset(frames=3, size=16)


@pytest.fixture
def observation(root: Path) -> dict[str, Any]:
    return json.loads((root / tiny.SINGLE / "observation.json").read_text())


def parse(data: dict[str, Any]) -> ObservationRecord:
    return ObservationRecord.model_validate_json(json.dumps(data))


def test_committed_schemas_have_not_drifted():
    texts = schema_files.schema_texts()
    assert {path.name for path in COMMITTED.glob("*.json")} == set(texts)
    for name, text in texts.items():
        assert (COMMITTED / name).read_text() == text, f"{name} is stale: avs3d schema -o avs3d_bench/contract/schemas"


def test_schema_names_are_those_of_the_taxonomy():
    assert all(re.fullmatch(taxonomy.CATEGORY_PATTERN, name) for name in taxonomy.CATEGORIES + taxonomy.DISTRACTORS)
    assert get_args(schema.Room) == taxonomy.ROOMS
    assert get_args(schema.Part) == taxonomy.PARTS


def test_pinned_keys_of_observation_json(observation: dict[str, Any]):
    assert {"key", "category", "source_position", "frames"} <= set(observation)
    assert len(observation["source_position"]) == 3
    assert len(observation["frames"][0]["position"]) == 3
    # The first pose is turned left by 0.1 rad: (w, x, y, z) = (cos, 0, sin, 0) of half of it.
    assert observation["frames"][0]["rotation"] == pytest.approx([math.cos(0.05), 0, math.sin(0.05), 0])


def test_json_round_trip(root: Path):
    path = root / tiny.SINGLE / "observation.json"
    record = files.read_record(path, ObservationRecord)
    assert files.dump_json(record) == path.read_text()
    assert record.sounding.category == record.category == "microwave"


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda d: d.pop("category"), "category"),
        (lambda d: d.update(extra=1), "extra"),
        (lambda d: d.update(category="microvawe"), "category"),
        (lambda d: d.update(key="part_1/tiny/kitchen/2"), "key"),
        (lambda d: d.update(part="part_2", key=tiny.MULTI), "1 instances of microwave in part_2"),
        (lambda d: d["frames"][1].update(position=[0, math.nan, 0]), "frames.1.position.1"),
        (lambda d: d["frames"][1].update(rotation=[1, 1, 0, 0]), "frames.1.rotation"),
        (lambda d: d["frames"][1].update(rotation=[1, 0, 0]), "frames.1.rotation"),
        (lambda d: d["frames"][1].update(name="frame_1"), "frames.1.name"),
        (lambda d: d["frames"][1].update(name="frame_007"), "frame_001"),
        (lambda d: d["frames"][1].update(visible_pixels=-1), "frames.1.visible_pixels"),
        (lambda d: d["frames"][1].update(azimuth=181), "frames.1.azimuth"),
        (lambda d: d["frames"][1].update(time=0), "times do not increase"),
        (lambda d: d["instances"][1].update(id=1), "not unique"),
        (lambda d: d["instances"][1].update(sounding=True), "2 instances are sounding"),
        (lambda d: d["instances"][0].update(bounds=[[1, 0, 0], [0, 1, 1]]), "instances.0"),
        (lambda d: d["instances"][0].update(category="oven"), "oven"),
        (lambda d: d["files"].update({"../x": "0" * 64}), "files"),
        (lambda d: d["files"].update({"x": "abc"}), "files.x"),
        (lambda d: d["acoustics"].update(gain=0), "acoustics.gain"),
        (lambda d: d.update(frames=[]), "frames"),
    ],
)
def test_a_wrong_field_is_named(observation: dict[str, Any], change: Any, field: str):
    change(observation)
    with pytest.raises(Avs3dError) as caught:
        schema.parse_record(json.dumps(observation), ObservationRecord, "dir/observation.json")
    assert str(caught.value).startswith("dir/observation.json: ")
    assert field in str(caught.value)
    assert "\n" not in str(caught.value)


def test_records_are_frozen(observation: dict[str, Any]):
    with pytest.raises(ValidationError, match="frozen"):
        parse(observation).category = "toilet"  # type: ignore[misc]


def test_dataset_record_checks_its_manifest_and_order(root: Path):
    data = json.loads((root / "dataset.json").read_text())
    assert data["manifest_sha256"] == hashlib.sha256(data["manifest"].encode()).hexdigest()
    for change, message in (
        (lambda d: d.update(manifest="other"), "manifest_sha256"),
        (lambda d: d["observations"].reverse(), "sorted"),
        (lambda d: d["observations"][0].update(scan="other"), "does not fit"),
    ):
        broken = json.loads(json.dumps(data))
        change(broken)
        with pytest.raises(ValidationError, match=message):
            DatasetRecord.model_validate_json(json.dumps(broken))


def test_splits_of_an_observation():
    splits = CameraSplits.of(10)
    assert splits.test == ("frame_000", "frame_008")
    assert splits.train == tuple(f"frame_{i:03d}" for i in (1, 2, 3, 4, 5, 6, 7, 9))


def test_a_submission_needs_three_keys_only():
    record = schema.parse_record('{"method": "m", "dataset": "d", "dataset_version": "1"}', SubmissionRecord, "s")
    assert record.url is None
    with pytest.raises(Avs3dError, match="dataset_version"):
        schema.parse_record('{"method": "m", "dataset": "d"}', SubmissionRecord, "s")


def test_attributions_stand_once_and_in_order():
    a = schema.AttributionRecord(asset="b", name="CC0-1.0", author="x", source="y")
    b = schema.AttributionRecord(asset="a", name="CC0-1.0", author="x", source="y")
    assert schema.unique_attributions([a, b, a]) == (b, a)
