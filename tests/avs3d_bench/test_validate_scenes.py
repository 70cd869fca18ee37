"""The checks of part_3 observations that are formulas, and valid trees of unusual kinds."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AudibleRecord, DatasetRecord, FrameRecord, ObservationRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.formats import media
from avs3d_bench.validate import check_observation, validate
from avs3d_bench.validation import background, sources
from avs3d_bench.validation.catalogue import read_facts
from avs3d_bench.validation.interaural import hearings
from avs3d_bench.validation.sound import BinauralClip
from tests.support import tiny, tiny_scenes
from tests.support.shared import SharedDataset
from tests.support.tiers import some
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT


@pytest.fixture(scope="module")
def root(shared_part_3: SharedDataset) -> Path:
    return shared_part_3(stems=True, frames=6)


def record_of(root: Path, key: str) -> ObservationRecord:
    record = Observation(root, key).record
    assert record is not None
    return record


# --- formulas -------------------------------------------------------------------------------------------------------


def test_coherence_of_a_diffuse_field():
    """sin(kd)/(kd): 1 at 0 Hz, 2/π where kd = π/2, 0 where kd = π."""
    quarter = 343.0 / 4 / 0.175
    found = background.diffuse_coherence(np.array([0.0, quarter, 2 * quarter]), 0.175)
    np.testing.assert_allclose(found, [1.0, 2 / math.pi, 0.0], atol=1e-12)


@pytest.mark.parametrize("spacing", [0.15, 0.175, 0.2, 0.24])
def test_a_diffuse_background_passes_whatever_the_head(spacing: float):
    pooled = background.Coherence()
    for clip in tiny_scenes.diffuse_noise(4, spacing):
        pooled.add(clip)
    frequency, found = pooled.value()
    assert np.abs(found - background.diffuse_coherence(frequency, spacing)).mean() < 0.1
    assert pooled.problem() is None


@pytest.mark.parametrize("kind", ["equal", "independent", "opposite"])
def test_a_background_that_is_not_diffuse_is_named(kind: str):
    pooled = background.Coherence()
    rng = np.random.default_rng(3)
    for _ in range(4):
        left, right = rng.normal(size=(2, tiny.RATE)).astype(np.float32)
        pooled.add(np.stack([left, {"equal": left, "independent": right, "opposite": -left}[kind]]))
    problem = pooled.problem()
    assert problem is not None
    assert "diffuse field" in problem


def test_one_second_of_background_is_not_judged():
    pooled = background.Coherence()
    pooled.add(np.zeros((2, tiny.RATE), dtype=np.float32))
    assert pooled.problem() is None


@given(
    stem=st.floats(-55, 0), rest=st.floats(-100, 0), angle=st.floats(-1, 1)
)  # levels in dB; the cosine between stem and rest
def test_the_level_of_a_clip_lies_between_difference_and_sum(stem: float, rest: float, angle: float):
    """Of any stem and rest (closed form: |a|² + |b|² + 2·cos·|a|·|b|), what the entry says of the clip holds."""
    a, b = 10 ** (stem / 20), 10 ** (rest / 20)
    clip = math.sqrt(max(a * a + b * b + 2 * angle * a * b, 0.0))
    assume(clip > 1e-9)
    low, high = sources._range(AudibleRecord(source="source_1", level_db=stem, drr_db=None, snr_db=stem - rest))
    assert low - 1e-6 <= sources.decibels(clip) <= high + 1e-6


def test_a_source_alone_is_the_clip():
    low, high = sources._range(AudibleRecord(source="source_1", level_db=-20.0, drr_db=None, snr_db=None))
    assert low == pytest.approx(-20.0)
    assert high == pytest.approx(-20.0)


@pytest.mark.parametrize(
    ("start", "end", "tail", "expected"),
    [(0, 1, 0, True), (1.9, 2.9, 0, True), (2, 3, 0, False), (2, 3, 0.5, True), (3.9, 4.4, 2, True), (4, 4.5, 2, False),
     (4, 5, 0, True)],
)  # fmt: skip
def test_when_a_source_can_be_heard(root: Path, start: float, end: float, tail: float, expected: bool):
    """Of the programme [0, 2), [4.5, 6)."""
    source = record_of(root, BOTH).source("source_1")
    assert source.programme[:2] == ((0.0, 2.0), (4.5, 6.0))
    assert sources.sounds_during(source, start, end, tail) is expected


def test_the_tail_follows_the_reverberation_time(root: Path):
    record = record_of(root, BOTH)
    source = record.source("source_1")
    away = source.model_copy(update={"instance": None})

    def with_t30(t30: float | None) -> ObservationRecord:
        return record.model_copy(update={"acoustics": record.acoustics.model_copy(update={"t30": t30})})

    assert sources.tail_of(with_t30(None), source) == 2.0
    assert sources.tail_of(with_t30(0.5), source) == pytest.approx(1.5)
    assert sources.tail_of(with_t30(0.1), source) == 1.0
    assert sources.tail_of(with_t30(5.0), source) == 2.0
    assert sources.tail_of(with_t30(0.1), away) == 2.0  # of another room nothing is known


# --- by which source a clip is judged -------------------------------------------------------------------------------


def heard_azimuths(root: Path, key: str, change: dict[str, object] | None = None) -> dict[str, float]:
    observation = Observation(root, key)
    record = record_of(root, key)
    if change is not None:
        record = record.model_copy(update=change)
    frames = observation.frames
    clips = [BinauralClip(frame.audio(), np.array([0.1, 0.1])) for frame in frames]
    visible = {frame.name: frozenset({1, 2, 3}) for frame in frames}
    return {one.frame.name: one.azimuth for one in hearings(record, frames, clips, visible)}


def test_a_clip_is_judged_by_its_only_source(root: Path):
    record = record_of(root, SECOND)
    expected = {f.name: pytest.approx(f.azimuth) for f in record.frames if f.line_of_sight}
    assert heard_azimuths(root, SECOND) == expected


def test_clips_of_several_sources_or_of_none_are_not_judged(root: Path):
    assert heard_azimuths(root, BOTH) == {}
    assert heard_azimuths(root, SILENT) == {}


def test_a_clip_is_not_judged_by_the_reverberation_of_a_source(root: Path):
    source = record_of(root, FIRST).source("source_1").model_copy(update={"programme": ((1.5, 4.0),)})
    found = heard_azimuths(root, FIRST, {"sources": (source,)})
    assert set(found) <= {"frame_002", "frame_003"}


def test_a_clip_with_a_loud_background_is_not_judged(root: Path):
    def quieter(frame: FrameRecord) -> FrameRecord:
        (heard,) = frame.audible or ()
        return frame.model_copy(update={"audible": (heard.model_copy(update={"snr_db": 10.0}),)})

    observation = Observation(root, FIRST)
    record = record_of(root, FIRST)
    noisy = record.model_copy(update={"frames": tuple(quieter(frame) for frame in record.frames)})
    observation.__dict__["record"] = noisy
    clips = [BinauralClip(frame.audio(), np.array([0.1, 0.1])) for frame in observation.frames]
    assert hearings(noisy, observation.frames, clips, {}) == ()


# --- trees ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("deep", [False, True])
def test_a_part_of_a_group_has_one_warning_per_sibling(tmp_path: Path, deep: bool):
    """As made with --only: the first of the group is not there."""
    whole = tiny_scenes.write_part_3(tmp_path / "data", frames=2, keys=(FIRST, SECOND, SILENT))
    shutil.rmtree(whole / FIRST)
    data = media.read_json(whole / "dataset.json")
    data["observations"] = data["observations"][1:]
    tiny.write_sealed(whole, data)
    report = validate(whole, deep=deep)
    assert [(p.severity, p.path) for p in report.problems] == [
        ("warning", f"{key}/observation.json") for key in (SECOND, SILENT)
    ]
    assert all(f"group {FIRST} is not in this dataset" in p.message for p in report.problems)
    assert report.valid


@pytest.mark.parametrize("stems", [False, True])
@pytest.mark.parametrize("key", GROUP)
def test_an_unreadable_record_is_one_problem(tmp_path: Path, root: Path, stems: bool, key: str):
    """Its files are still read, and not called surplus."""
    copy = tiny.clone(root, tmp_path / "data")
    tiny.replace(copy / key / "observation.json", b"{")
    if not stems:
        for path in sorted((copy / key / "stems").rglob("*.wav")) if (copy / key / "stems").exists() else ():
            path.unlink()
    found = {(p.path, p.message.split(" ")[0]) for p in check_observation(copy, key, deep=True)}
    assert found == {(f"{key}/observation.json", "Invalid")}


def test_copies_of_the_pictures_are_as_good_as_links(tmp_path: Path, root: Path):
    copy = tiny.clone(root, tmp_path / "data")
    for path in sorted((copy / SECOND / "input").iterdir()):
        tiny.replace(path, path.read_bytes())
    assert validate(copy, deep=True).problems == ()


@pytest.mark.parametrize(
    "path",
    some(
        ["input/frame_002.png", "instance_masks/frame_002.png", "sparse/0/points3D.bin", "camera_splits.json"], every=4
    ),
)
def test_damage_to_a_file_that_siblings_share_is_named_once(tmp_path: Path, root: Path, path: str):
    """With the first of the group; a sibling that is checked alone is checked whole."""
    copy = tiny.clone(root, tmp_path / "data")
    content = bytearray((copy / FIRST / path).read_bytes())
    content[-20] ^= 0xFF
    tiny.replace(copy / FIRST / path, bytes(content))
    for key in GROUP:
        if key != FIRST:
            (copy / key / path).unlink()
            (copy / key / path).hardlink_to(copy / FIRST / path)
    changed = {p.path for p in validate(copy, deep=True).problems if "file changed" in p.message}
    assert changed == {f"{FIRST}/{path}"}
    assert f"{SECOND}/{path}" in {p.path for p in check_observation(copy, SECOND, deep=True)}


def with_the_clip_of_the_first(root: Path, frame: int, **changes: object) -> None:
    """Give the second sibling a clip of the first, in its records too."""
    name = layout.audio_path(layout.BINAURAL, frame)
    clip = (root / FIRST / name).read_bytes()
    tiny.replace(root / SECOND / name, clip)
    record = media.read_json(root / SECOND / "observation.json")
    first = media.read_json(root / FIRST / "observation.json")
    record["files"][name] = hashlib.sha256(clip).hexdigest()
    for side in ("rms_left", "rms_right"):
        record["frames"][frame][side] = first["frames"][frame][side]
    media.write_json(root / SECOND / "observation.json", record | changes)


def shared_takes(root: Path) -> list[tuple[str, str]]:
    return [(p.severity, p.path) for p in validate(root).problems if "same bytes as a clip of its sibling" in p.message]


def test_siblings_that_share_a_clip_are_named(tmp_path: Path, root: Path):
    copy = tiny.clone(root, tmp_path / "data")
    with_the_clip_of_the_first(copy, 3)
    assert shared_takes(copy) == [("warning", f"{SECOND}/{layout.audio_path(layout.BINAURAL, 3)}")]


def test_variants_may_share_a_clip_and_silent_clips_are_no_takes(tmp_path: Path, root: Path):
    assert shared_takes(root) == []
    copy = tiny.clone(root, tmp_path / "data")
    with_the_clip_of_the_first(copy, 3, variant_of=FIRST)
    assert shared_takes(copy) == []
    silent = tiny_scenes.write_part_3(tmp_path / "silent", frames=2, keys=(FIRST, SILENT))
    shutil.copytree(silent / SILENT, silent / AWAY)
    record = media.read_json(silent / AWAY / "observation.json") | {"key": AWAY, "index": 5}
    media.write_json(silent / AWAY / "observation.json", record)
    assert shared_takes(silent) == []


def test_a_damaged_copy_in_a_sibling_is_named(tmp_path: Path, root: Path):
    copy = tiny.clone(root, tmp_path / "data")
    path = copy / SECOND / "input" / "frame_002.png"
    content = bytearray(path.read_bytes())
    content[-20] ^= 0xFF
    tiny.replace(path, bytes(content))
    assert f"{SECOND}/input/frame_002.png" in {p.path for p in validate(copy, deep=True).problems}


def test_a_source_whose_programme_was_cut_off_is_silent(tmp_path: Path, root: Path):
    """Bursts may all begin after the last frame: the source is listed, and never sounds."""
    copy = tiny.clone(root, tmp_path / "data")
    for index in range(6):
        for name in ("stems/source_1", "audio_clips_binaural"):
            media.write_wav(copy / FIRST / f"{name}/frame_{index}.wav", np.zeros((2, tiny.RATE)))
        media.write_wav(copy / FIRST / f"audio_clips_mono/frame_{index}.wav", np.zeros((1, 2 * tiny.RATE)))
        for folder in ("semantic_masks", "category_masks"):
            path = copy / FIRST / folder / f"frame_{index:03d}.png"
            blank = np.zeros((tiny.SIZE, tiny.SIZE), np.uint8)
            (media.write_png_mask if folder == "semantic_masks" else media.write_png_categories)(path, blank)

    def silence(data: dict) -> None:
        data["sources"][0]["programme"] = []
        for frame in data["frames"]:
            frame.update(audible=[], visible_pixels=0, rms_left=0.0, rms_right=0.0)

    tiny.edit_record(copy, FIRST, silence)
    assert validate(copy, deep=True).problems == ()


# --- dataset.json against the manifest in it ------------------------------------------------------------------------

MANIFEST = """
name: tiny-scenes
version: "1"
seed: 1
categories:
  hair_dryer: {stands_on: [table, worktop], height: [0.15, 0.3]}
  fan:
    stands_on: [floor]
    height: [1.0, 1.4]
scans: {tiny: {seed: 1}}
observations:
  - {part: part_3, scan: tiny, room: kitchen, index: 1, instances: {microwave: 2}, sources: [{category: microwave}]}
  - {like: part_3/tiny/kitchen/1, index: 2, sources: [{category: microwave, instance: 2, programme: [[0, 1]]}]}
  - {part: part_1, scan: tiny, room: kitchen, index: 7, category: hair_dryer}
"""


def test_what_is_read_of_a_manifest():
    facts = read_facts(MANIFEST)
    assert facts is not None
    assert facts.own == ("hair_dryer", "fan")
    assert facts.like == {SECOND: FIRST}
    assert facts.categories == {FIRST: "", SECOND: "", "part_1/tiny/kitchen/7": "hair_dryer"}
    assert facts.scalars == {"name": "tiny-scenes", "version": "1", "seed": "1"}


def test_groups_and_categories_are_those_of_the_manifest(tmp_path: Path):
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=2, keys=(FIRST, SECOND))

    def manifest(text: str) -> list[str]:
        data = media.read_json(root / "dataset.json")
        data.update(manifest=text, manifest_sha256=hashlib.sha256(text.encode()).hexdigest())
        tiny.write_sealed(root, data)
        return [f"{p.path}: {p.message}" for p in validate(root).problems]

    own = MANIFEST[MANIFEST.index("categories:") : MANIFEST.index("scans:")]
    assert manifest(MANIFEST.replace(own, "")) == []
    assert manifest(MANIFEST) == [
        "dataset.json: categories of the manifest's own are none, the manifest in it adds hair_dryer, fan"
    ]
    alone = MANIFEST.replace(own, "").replace(f"like: {FIRST}", "part: part_3, scan: tiny, room: kitchen")
    assert manifest(alone) == [
        f"dataset.json: {SECOND} is in the group {FIRST}, in the manifest in it in that of {SECOND}"
    ]


def test_what_sources_play_is_that_of_the_observations(tmp_path: Path):
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=2, keys=(FIRST, SECOND))

    def playing(sounds: list[str] | None) -> list[str]:
        data = media.read_json(root / "dataset.json")
        data["observations"][1].pop("sounds", None)
        data["observations"][1] |= {} if sounds is None else {"sounds": sounds}
        tiny.write_sealed(root, data)
        return [f"{p.path}: {p.message}" for p in validate(root).problems]

    assert playing(None) == [], "older versions do not say it"
    assert playing(["noise"]) == []
    assert playing([]) == [f"dataset.json: {SECOND} plays nothing here, noise in its observation.json"]


def test_a_sealed_test_does_not_say_what_its_sources_play(tmp_path: Path):
    root = tiny_scenes.write_part_3(tmp_path / "data", frames=2, keys=(FIRST, SECOND))
    data = media.read_json(root / "dataset.json")
    data |= {"sealed_test": True, "manifest": "", "manifest_sha256": hashlib.sha256(b"").hexdigest()}
    data.pop("digest")
    for entry in data["observations"]:
        entry["category"] = None
    with pytest.raises(ValueError, match=f"{FIRST}: names its sounds, but the test is sealed"):
        DatasetRecord.model_validate_json(json.dumps(data))
    for entry in data["observations"]:
        del entry["sounds"]
    DatasetRecord.model_validate_json(json.dumps(data))
