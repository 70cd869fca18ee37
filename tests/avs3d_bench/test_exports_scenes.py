"""Exports of part_3 observations: sources, audible, group, background, category masks and stems in every form."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.exports import (
    decode_sample,
    waveform,
    write_card,
    write_croissant,
    write_huggingface,
    write_webdataset,
)
from avs3d_bench.formats import media
from avs3d_bench.inspector.listing import list_dataset
from tests.support import tiny, tiny_scenes
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, GROUP, SECOND, SILENT

FRAMES = 4


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes") / "data"
    return tiny_scenes.write_part_3(folder, frames=FRAMES, stems=True, rirs=True)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All three parts in one tree."""
    root = tmp_path_factory.mktemp("mixed") / "data"
    tiny.write_dataset(root, frames=FRAMES)
    return tiny_scenes.write_part_3(root, frames=FRAMES, keys=(FIRST, SILENT))


def record_of(root: Path, key: str) -> ObservationRecord:
    record = Dataset(root)[key].record
    assert record is not None
    return record


def samples(folder: Path) -> dict[str, dict[str, Any]]:
    """Key of a sample → its members, as the `webdataset` package groups them."""
    out: dict[str, dict[str, Any]] = {}
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as archive:
            for entry in archive:
                head, _, name = entry.name.rpartition("/")
                stem, _, member = name.partition(".")
                stream = archive.extractfile(entry)
                assert stream is not None
                out.setdefault(f"{head}/{stem}", {"__key__": f"{head}/{stem}"})[member] = stream.read()
    return out


# --- WebDataset -----------------------------------------------------------------------------------------------------


def test_a_sample_has_the_files_of_its_scene(scenes: Path, tmp_path: Path):
    index = write_webdataset(scenes, tmp_path / "out", extras=["stems", "rirs"], workers=1)
    found = samples(tmp_path / "out")
    assert len(found) == len(GROUP) * FRAMES
    base, sample = scenes / BOTH, found[f"{BOTH}/frame_003"]
    for member, file in {
        "categories.png": "category_masks/frame_003.png",
        "source_1.stem.wav": "stems/source_1/frame_3.wav",
        "background.stem.wav": "stems/background/frame_3.wav",
        "source_2.rir.npz": "rirs/source_2/frame_3.npz",
    }.items():
        assert sample[member] == (base / file).read_bytes(), member
    assert not any("stem" in name or "rir" in name for name in found[f"{SILENT}/frame_003"])
    assert {"categories.png", "source_*.stem.wav", "source_*.rir.npz"} <= index.members.keys()


def test_decoding_gives_stems_whose_sum_is_the_clip(scenes: Path, tmp_path: Path):
    write_webdataset(scenes, tmp_path / "out", extras=["stems", "rirs"], workers=1)
    sample = decode_sample(samples(tmp_path / "out")[f"{BOTH}/frame_003"])
    frame = Dataset(scenes)[BOTH].frames[3]
    assert sorted(sample["stems"]) == ["background", "source_1", "source_2", "source_3"]
    np.testing.assert_allclose(sum(sample["stems"].values()), sample["binaural"], atol=1e-6)
    np.testing.assert_array_equal(sample["category_mask"], frame.category_mask())
    np.testing.assert_array_equal(sample["impulse_responses"]["source_2"], frame.impulse_response("source_2"))


def test_facts_of_a_scene(scenes: Path, tmp_path: Path):
    write_webdataset(scenes, tmp_path / "out", workers=1)
    found = {key: json.loads(sample["json"]) for key, sample in samples(tmp_path / "out").items()}
    facts = found[f"{BOTH}/frame_003"]
    record = record_of(scenes, BOTH)
    assert facts["group"] == FIRST
    assert [(s["id"], s["instance"], s["category"]) for s in facts["sources"]] == [
        ("source_1", 1, "microwave"), ("source_2", 3, "microwave"), ("source_3", 2, "telephone")
    ]  # fmt: skip
    assert facts["sources"][0]["programme"] == [[0.0, 2.0]]
    assert [entry["source"] for entry in facts["audible"]] == ["source_2", "source_3"]
    assert facts["audible"][0]["snr_db"] == pytest.approx(record.frames[3].audible[0].snr_db, rel=1e-8)  # type: ignore[index]
    assert facts["background"]["kind"] == "noise"
    assert facts["background"]["snr_db"] == 20.0
    assert facts["categories"][3] == "microwave"  # its class id is 4
    silent = found[f"{SILENT}/frame_003"]
    assert silent["sources"] == silent["audible"] == []
    for name in ("category", "azimuth", "distance", "source_position", "sounding_instance", "sounding_position"):
        assert silent[name] is None, name
    away = found[f"{AWAY}/frame_003"]
    assert away["sources"][0]["instance"] is away["sounding_instance"] is None
    assert away["azimuth"] is not None


def test_samples_of_the_other_parts_do_not_depend_on_part_3(mixed: Path, tmp_path: Path):
    write_webdataset(mixed, tmp_path / "mixed", workers=1)
    write_webdataset(mixed, tmp_path / "alone", only=["part_1/*"], workers=1)
    together = samples(tmp_path / "mixed")
    for key, sample in samples(tmp_path / "alone").items():
        assert together[key] == sample
        assert "sources" not in json.loads(sample["json"])


# --- Hugging Face ---------------------------------------------------------------------------------------------------


def test_rows_of_scenes(scenes: Path, tmp_path: Path):
    datasets = pytest.importorskip("datasets", reason="datasets is not installed: pip install 'avs3d-bench[exports]'")
    write_huggingface(scenes, tmp_path / "hub", extras=["stems", "rirs"], workers=1)
    cache = str(tmp_path / "cache")
    rows = datasets.load_dataset(str(tmp_path / "hub"), split="train", cache_dir=cache)
    by_key = {(row["key"], row["frame"]): row for row in rows}
    row = by_key[BOTH, "frame_003"]
    assert row["group"] == FIRST
    assert [source["category"] for source in row["sources"]] == ["microwave", "microwave", "telephone"]
    assert row["sources"][0]["programme"] == [[0.0, 2.0]]
    assert [entry["source"] for entry in row["audible"]] == ["source_2", "source_3"]
    frame = Dataset(scenes)[BOTH].frames[3]
    np.testing.assert_array_equal(np.asarray(row["category_mask"]), frame.category_mask())
    heard = {stem["source"]: waveform(stem["audio"])[0] for stem in row["stems"]}
    np.testing.assert_allclose(sum(heard.values()), frame.audio(), atol=1e-6)
    with np.load(io.BytesIO(row["impulse_responses"][1]["rir"])) as archive:
        np.testing.assert_array_equal(archive["rir"], frame.impulse_response("source_2"))
    silent = by_key[SILENT, "frame_003"]
    assert silent["category"] is silent["azimuth"] is silent["background"] is None
    assert silent["sources"] == silent["audible"] == []
    assert not silent["stems"]
    observations = datasets.load_dataset(
        str(tmp_path / "hub"), "observations", split="observations", cache_dir=cache
    )  # fmt: skip
    table = {row["key"]: row for row in observations}
    assert table[AWAY]["sources"][0]["room"] == "living_room"
    assert table[AWAY]["sources"][0]["licence"] == "CC0-1.0"
    assert table[AWAY]["background"]["snr_db"] == 10.0
    assert table[SECOND]["group"] == FIRST


def test_rows_of_all_parts_have_the_same_columns(mixed: Path, tmp_path: Path):
    datasets = pytest.importorskip("datasets", reason="datasets is not installed: pip install 'avs3d-bench[exports]'")
    write_huggingface(mixed, tmp_path / "hub", workers=1)
    rows = datasets.load_dataset(str(tmp_path / "hub"), split="train", cache_dir=str(tmp_path / "cache"))
    first = next(row for row in rows if row["part"] == "part_1")
    assert first["sources"] is first["group"] is first["category_mask"] is None
    assert first["azimuth"] is not None


# --- Croissant, card, list ------------------------------------------------------------------------------------------


def test_the_description_names_groups_and_sources(scenes: Path):
    mlcroissant = pytest.importorskip("mlcroissant", reason="not installed: pip install 'avs3d-bench[exports]'")
    path = scenes / "croissant.json"
    write_croissant(scenes, path, published="2026-01-01")
    try:
        described = mlcroissant.Dataset(str(path))
        assert not described.metadata.ctx.issues.errors
        groups = {row["groups/observation"]: row["groups/group"] for row in described.records("groups")}
        assert {str(key): str(value) for key, value in groups.items()} == dict.fromkeys(GROUP, FIRST)
        sources = [
            (row["sources/observation"].decode(), row["sources/id"].decode()) for row in described.records("sources")
        ]
        assert len(sources) == 6
        assert (AWAY, "source_1") in sources
        assert len(list(described.records("frames"))) == len(GROUP) * FRAMES
        assert len(list(described.records("category_masks"))) == len(GROUP) * FRAMES
    finally:
        path.unlink()


def test_the_description_of_a_tree_of_all_parts(mixed: Path):
    path = mixed / "croissant.json"
    write_croissant(mixed, path)
    text = media.read_json(path)
    path.unlink()
    sets = {one["name"]: one for one in text["recordSet"]}
    assert {row["groups/observation"] for row in sets["groups"]["data"]} == {FIRST, SILENT}
    assert "stems-files" not in {one["@id"] for one in text["distribution"]}


def test_the_card_counts_scenes(scenes: Path, tmp_path: Path):
    write_card(scenes, tmp_path / "card.md")
    text = (tmp_path / "card.md").read_text()
    for line in (
        "| groups (same pictures, other sound) | 1 |",
        "| observations of a group, least – median – most | 5 – 5 – 5 |",
        "| without a source | 1 |",
        "| with one source | 3 |",
        "| with several sources | 1 |",
        "| with an off-screen source | 1 |",
        "| with a source that pauses | 1 |",
        "| with noise | 2 (SNR 10 to 20 dB) |",
        "| frames with nothing audible | 4 (20%) |",
        "| frames with 1 audible source | 12 (60%) |",
        "| frames with 2 audible sources | 4 (20%) |",
        "| microwave | 0 | 0 | 3 | 3 |",
        "| telephone | 0 | 0 | 2 | 2 |",
    ):
        assert line in text, line
    assert "no\n  second sound" not in text
    assert "- One object sounds in every frame" not in text


def test_a_card_without_part_3_does_not_speak_of_it(tmp_path: Path):
    write_card(tiny.write_dataset(tmp_path / "data", frames=2), tmp_path / "card.md")
    text = (tmp_path / "card.md").read_text()
    assert "part_3" not in text
    assert "| sounding category | part_1 | part_2 | all |" in text
    assert "no\n  second sound, no speech." in text
    assert "- One object sounds in every frame" in text


def test_the_list_says_what_sounds(scenes: Path):
    listing = list_dataset(Dataset(scenes))
    assert [row.sounds for row in listing.observations] == [
        "microwave",
        "microwave",
        "2 × microwave + telephone, noise",
        "silence",
        "telephone (living_room), noise",
    ]
    rows = listing.as_dict()["observations"]
    assert {row["group"] for row in rows} == {FIRST}
    assert rows[3]["category"] is None


def test_the_list_of_the_other_parts_has_the_fields_it_had(mixed: Path):
    rows = list_dataset(Dataset(mixed)).as_dict()["observations"]
    assert set(rows[0]) == {"key", "category", "frames", "seconds", "t30", "instances"}
    assert set(rows[-1]) == set(rows[0]) | {"sounds", "group"}
