"""`avs3d export acoustics`: responses, positions, meshes and pictures as other readers find them."""

from __future__ import annotations

import csv
import io
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
import yaml

from avs3d_bench import __version__
from avs3d_bench.cli import main
from avs3d_bench.contract.schema import DatasetRecord
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import acoustics
from avs3d_bench.exports.acoustics import AcousticsSettings, ResponsesRecord, read_responses
from avs3d_bench.formats.files import sha256_bytes, sha256_file, write_json
from avs3d_bench.measures.decay import SPEED_OF_SOUND
from evaluators import metrics
from generators.core.freespace import CELL, FreeSpace
from generators.responses.spaces import draw_positions, draw_sources, grid, held_out, split_names
from generators.responses.write import write_acoustics
from tests.support.homes import ROOM, write_manifest

SMALL = AcousticsSettings(spacing=1.0, sources=2, pictures=2, size=64, workers=1)
#: No pictures, one material, one source.
LEAST = replace(SMALL, sources=1, pictures=0, absorption=(1.0,), spacing=1.6)


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_manifest(tmp_path_factory.mktemp("home"))


@pytest.fixture(scope="module")
def export(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "rirs"
    write_acoustics(manifest, folder, SMALL)
    return folder


def record_of(folder: Path) -> ResponsesRecord:
    return acoustics.read_acoustics(folder)


def table(folder: Path) -> list[dict[str, str]]:
    with open(folder / "responses.csv", newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def hashes(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): sha256_file(p) for p in sorted(folder.rglob("*")) if p.is_file()}


def test_webdataset_reads_the_responses_where_the_table_says(export: Path) -> None:
    webdataset = pytest.importorskip("webdataset", reason="not installed: pip install 'avs3d-bench[exports]'")
    rows = table(export)
    assert len(rows) == record_of(export).count > 20
    found = {}
    for shard in sorted({row["shard"] for row in rows}):
        for sample in webdataset.WebDataset(str(export / shard), shardshuffle=False):
            samples = np.load(io.BytesIO(sample["npy"]))
            found[shard, sample["__key__"]] = samples, json.loads(sample["json"])
    assert len(found) == len(rows)
    for row in rows:
        samples, described = found[row["shard"], row["key"]]
        assert samples.dtype == np.float32
        assert len(samples) == 1
        for name in ("source", "listener"):
            place = described["source"] if name == "source" else described["listener"]["position"]
            assert place == pytest.approx([float(row[f"{name}_{axis}"]) for axis in "xyz"], abs=1e-6)
        assert described["sample_rate"] == 16_000


def test_the_direct_sound_comes_after_the_way_and_figures_are_those_of_the_metrics(export: Path) -> None:
    rows = table(export)
    responses = list(read_responses(export))
    assert len(responses) == len(rows)
    for row, (samples, source, listener, space) in zip(rows, responses, strict=True):
        assert (space.room, space.material) == (row["room"], row["material"])
        distance = float(np.linalg.norm(source - listener))
        assert float(row["distance"]) == pytest.approx(distance, abs=1e-3)
        first = int(np.argmax(np.abs(samples[0]) > 0.3 * np.abs(samples[0]).max()))
        assert first >= distance / SPEED_OF_SOUND * 16_000 - 3
    one, other = responses[0].samples, responses[-1].samples
    errors = metrics.rir.evaluate(one, other, 16_000)
    assert errors["EDT"] == pytest.approx(abs(float(rows[0]["EDT"]) - float(rows[-1]["EDT"])), abs=2e-4)
    assert errors["C50"] == pytest.approx(abs(float(rows[0]["C50"]) - float(rows[-1]["C50"])), abs=2e-4)


def test_twice_the_exponent_of_all_materials_is_half_the_reverberation(export: Path) -> None:
    times = {
        material: np.mean([float(row["T30"]) for row in table(export) if row["material"] == material])
        for material in ("absorption_1", "absorption_2")
    }
    # Eyring: T ∝ 1 / exponent; the air and a room that is not diffuse leave some tolerance.
    assert times["absorption_2"] / times["absorption_1"] == pytest.approx(0.5, abs=0.08)


def test_splits_are_by_position_home_and_material(export: Path) -> None:
    record, rows = record_of(export), table(export)
    first, second = record.spaces
    assert first.test_listeners == second.test_listeners
    assert len(first.test_listeners) == round(0.2 * len(first.listeners))
    assert (first.material_split, second.material_split) == ("train", "test")
    assert {space.home_split for space in record.spaces} == {"train"}, "there is no other home"
    for by in ("position", "material"):
        for split in ("train", "test"):
            found = list(read_responses(export, split, by))  # type: ignore[arg-type]
            assert len(found) == sum(row[f"split_by_{by}"] == split for row in rows) > 0
    held = {tuple(one.listener) for one in read_responses(export, "test")}
    assert not held & {tuple(one.listener) for one in read_responses(export, "train")}


def test_a_fifth_is_held_out_and_never_all() -> None:
    rng = np.random.default_rng(1)
    assert [int(held_out(count, rng).sum()) for count in (0, 1, 2, 5, 10, 32)] == [0, 0, 1, 1, 2, 6]
    names = [f"home_{number}" for number in range(10)]
    splits = [split_names(names, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert splits[0] == splits[1] != splits[2]
    assert list(splits[0].values()).count("test") == 2


def test_one_of_two_homes_is_held_out(manifest: Path, tmp_path: Path) -> None:
    document = yaml.safe_load(manifest.read_text())
    document["scans"]["other"] = document["scans"]["box"]
    document["observations"][1]["scan"] = "other"
    (manifest.parent / "two.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    record = write_acoustics(manifest.parent / "two.yaml", tmp_path / "rirs", LEAST)
    assert [space.home for space in record.spaces] == ["box", "other"] == sorted(record.meshes)
    assert sorted(space.home_split for space in record.spaces) == ["test", "train"]
    held = {one.space.home for one in read_responses(tmp_path / "rirs", "test", "home")}
    assert held == {space.home for space in record.spaces if space.home_split == "test"}
    first, second = record.spaces
    assert first.listeners == second.listeners, "the same room"
    assert first.sources != second.sources, "drawn for each home"


def floor(width: float, depth: float) -> FreeSpace:
    """A free floor of that size, with a square hole of a metre in the middle."""
    shape = round(width / CELL), round(depth / CELL)
    walkable = np.ones(shape, dtype=bool)
    middle, half = np.array(shape) // 2, round(0.5 / CELL)
    walkable[middle[0] - half : middle[0] + half, middle[1] - half : middle[1] + half] = False
    far = np.full((shape[0] * 10, shape[1] * 10), 5.0, dtype=np.float32)
    return FreeSpace(0.2, np.zeros(2), walkable, far)


def test_listeners_stand_on_a_grid_of_the_free_floor() -> None:
    points = grid(floor(4, 3), 0.5)
    assert set(np.round(np.diff(np.unique(points[:, 0])), 6)) == {0.5}
    assert not (np.abs(points - (2, 1.5)).max(axis=1) < 0.45).any(), "none in the hole"
    assert len(points) == 8 * 6 - 4
    assert len(grid(floor(4, 3), 9.0)) <= 1


def test_sources_are_far_from_one_another_and_from_listeners() -> None:
    space = floor(4, 3)
    listeners = np.insert(grid(space, 1.0), 1, 1.7, axis=1)
    sources = draw_sources(space, listeners, 4, np.random.default_rng(0))
    assert sources.shape == (4, 3)
    assert np.linalg.norm(sources[:, None] - listeners[None], axis=2).min() >= 0.3
    between = np.linalg.norm(sources[:, None] - sources[None], axis=2)[np.triu_indices(4, 1)]
    assert between.min() > 1.5
    assert ((sources[:, 1] >= 0.6) & (sources[:, 1] <= 1.8)).all(), "0.4 to 1.6 m above the floor at 0.2 m"


def test_a_floor_that_is_too_small_is_one_line() -> None:
    nothing = replace(floor(1, 1), walkable=np.zeros((round(1 / CELL),) * 2, dtype=bool))
    with pytest.raises(UsageError, match=r"a/kitchen: no listener fits on a grid of 0.5 m"):
        draw_positions(nothing, "a/kitchen", AcousticsSettings(), np.random.default_rng(0))
    dense = replace(SMALL, spacing=0.25, sources=1000)
    with pytest.raises(UsageError, match="sources fit between the listeners, 1000 are asked for"):
        draw_positions(floor(1.2, 1.2), "a/kitchen", dense, np.random.default_rng(0))


def test_trimesh_reads_the_mesh_and_every_face_has_its_material(export: Path) -> None:
    mesh = trimesh.load(export / "box/mesh.ply", process=False)
    assert mesh.bounds == pytest.approx(np.array(ROOM), abs=1e-3)
    described = json.loads((export / "box/materials.json").read_text())
    ends = [(one["first_face"], one["first_face"] + one["faces"]) for one in described["faces"]]
    assert [first for first, _ in ends] == [0, *(end for _, end in ends[:-1])]
    assert ends[-1][1] == len(mesh.faces)
    for one in described["faces"]:
        built, damped = (np.array(one["absorption"][name]) for name in ("absorption_1", "absorption_2"))
        assert damped == pytest.approx(1 - (1 - built) ** 2, abs=1e-3)
        assert len(built) == len(described["octaves"]) == 6


def test_pictures_are_taken_by_listeners_with_the_cameras_of_nerf(export: Path) -> None:
    folder = export / "box/kitchen/pictures"
    cameras = json.loads((folder / "transforms.json").read_text())
    assert (cameras["w"], cameras["fl_x"], cameras["cx"]) == (64, 32, 32)
    listeners = record_of(export).spaces[0].listeners
    for frame in cameras["frames"]:
        picture = cv2.imread(str(folder / frame["file_path"]))
        assert picture.shape == (64, 64, 3)
        assert picture.std() > 1, "a picture of a room"
        matrix = np.array(frame["transform_matrix"])
        assert matrix[:3, 3] == pytest.approx(listeners[frame["listener"]])
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
        assert matrix[:3, 1] == pytest.approx([0, 1, 0]), "up is Y"


def dataset_of(folder: Path, manifest: Path) -> Path:
    """The dataset.json of a dataset that was made from a manifest."""
    text = manifest.read_text()
    record = DatasetRecord(
        name="tiny", version="1.0.0", toolkit_version=__version__, manifest=text,
        manifest_sha256=sha256_bytes(text.encode()), backends={}, licence="CC0-1.0", observations=(),
    ).sealed()  # fmt: skip
    write_json(folder / "dataset.json", record)
    return folder


def test_a_dataset_is_exported_from_its_manifest_with_the_same_bytes(manifest: Path, tmp_path: Path) -> None:
    root = dataset_of(tmp_path / "data", manifest)
    with pytest.raises(UsageError, match="its manifest names files beside it; name its file with --manifest"):
        write_acoustics(root, tmp_path / "a", LEAST)
    write_acoustics(root, tmp_path / "a", replace(LEAST, manifest=manifest))
    write_acoustics(manifest, tmp_path / "b", replace(LEAST, workers=2))
    assert hashes(tmp_path / "a") == hashes(tmp_path / "b")


def test_first_order_ambisonics_have_four_channels_with_the_omni_first(manifest: Path, tmp_path: Path) -> None:
    record = write_acoustics(manifest, tmp_path / "foa", replace(LEAST, receiver="foa", spacing=2.5))
    assert record.channels == ("W", "Y", "Z", "X")
    for samples, *_ in read_responses(tmp_path / "foa"):
        assert len(samples) == 4
        assert np.square(samples[0]).sum() > np.square(samples[1:]).sum(axis=1).max() / 1.01


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spacing": 0.01}, "--spacing 0.01: expected 0.1 to 10"),
        ({"spacing": float("nan")}, "--spacing nan"),
        ({"sources": 0}, "--sources 0: expected 1 to 1000"),
        ({"absorption": (1.0, 1.0)}, "--absorption .*: expected different factors"),
        ({"absorption": (100.0,)}, "--absorption 100: expected 0.05 to 20"),
        ({"sample_rate": 100}, "--sample-rate 100: expected 8000 to 192000"),
        ({"manifest": Path("other.yaml")}, "--manifest belongs to a dataset; .* is a manifest itself"),
        ({"only": ("part_9/*",)}, "--only 'part_9/.*' matches no observation"),
    ],
)
def test_settings_out_of_range_are_one_line(
    change: dict[str, Any], message: str, manifest: Path, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=message):
        write_acoustics(manifest, tmp_path / "rirs", replace(SMALL, **change))
    assert not list(tmp_path.iterdir())


def test_nothing_is_left_of_an_export_that_fails(
    manifest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise Avs3dError("no sound")

    monkeypatch.setattr("generators.responses.write.write_webdataset", fail)
    with pytest.raises(Avs3dError, match="no sound"):
        write_acoustics(manifest, tmp_path / "rirs", LEAST)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_kept(export: Path, manifest: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("x")
    with pytest.raises(UsageError, match="exists and is no export of responses"):
        write_acoustics(manifest, tmp_path / "mine", LEAST)
    shutil.copytree(export, tmp_path / "rirs")
    for strange in ("thesis.tex", "box/kitchen/thesis.tex"):
        (tmp_path / "rirs" / strange).write_text("x")
        with pytest.raises(UsageError, match=rf"rirs/{strange}: no file that this command writes"):
            write_acoustics(manifest, tmp_path / "rirs", LEAST)
        (tmp_path / "rirs" / strange).unlink()
    renamed = yaml.safe_load(manifest.read_text()) | {"name": "other"}
    (manifest.parent / "other.yaml").write_text(yaml.safe_dump(renamed))
    with pytest.raises(UsageError, match="holds the responses of tiny"):
        write_acoustics(manifest.parent / "other.yaml", tmp_path / "rirs", LEAST)
    assert hashes(tmp_path / "rirs") == hashes(export)


def test_what_cannot_be_read_is_one_line(export: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"acoustics.json: missing; expected a folder that `avs3d export acoustics`"):
        list(read_responses(tmp_path))
    with pytest.raises(UsageError, match="by: 'room', expected"):
        list(read_responses(export, "train", "room"))  # type: ignore[arg-type]
    shutil.copytree(export, tmp_path / "rirs")
    shard = next((tmp_path / "rirs").rglob("*.tar"))
    shard.write_bytes(shard.read_bytes()[:5000])
    with pytest.raises(Avs3dError, match=r"rir-000000.tar: .*export again"):
        list(read_responses(tmp_path / "rirs"))
    shard.unlink()
    with pytest.raises(Avs3dError, match=r"rir-000000.tar: missing"):
        list(read_responses(tmp_path / "rirs"))


def test_without_the_generator_one_line_says_what_to_install(
    manifest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("avs3d_bench.exports.acoustics.metadata.entry_points", lambda **_: ())
    with pytest.raises(UsageError, match=r"acoustics needs the generator: pip install 'avs3d-bench\[generate\]'"):
        acoustics.write_acoustics(manifest, tmp_path / "rirs", LEAST)


def test_the_command_says_what_it_wrote(manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--spacing", "1.6", "--sources", "1", "--pictures", "0", "--workers", "1"]
    with pytest.raises(SystemExit) as ended:
        main(["export", "acoustics", str(manifest), "-o", str(tmp_path / "rirs"), *options])
    assert not ended.value.code
    lines = capsys.readouterr().out.splitlines()
    count = record_of(tmp_path / "rirs").count
    assert lines[0].startswith("box/kitchen/absorption_1: 1 sources × ")
    assert lines[2] == f"{count} responses"
    assert lines[5] == f"by material: {count // 2} train, {count // 2} test"


def test_a_sealed_test_has_no_manifest_to_export(tmp_path: Path) -> None:
    record = DatasetRecord(
        name="tiny", version="1", toolkit_version=__version__, manifest="", manifest_sha256=sha256_bytes(b""),
        sealed_test=True, backends={}, licence="CC0-1.0", observations=(),
    ).sealed()  # fmt: skip
    write_json(tmp_path / "public/dataset.json", record)
    with pytest.raises(UsageError, match="a sealed test, whose manifest is secret"):
        write_acoustics(tmp_path / "public", tmp_path / "rirs", LEAST)
