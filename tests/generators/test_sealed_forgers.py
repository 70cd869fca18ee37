"""An organiser who forges a sealed test before it is published and computes every commitment again: found at once."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from avs3d_bench.contract import layout
from avs3d_bench.formats import files, media
from avs3d_bench.formats.colmap import write_model
from avs3d_bench.geometry import Intrinsics
from avs3d_bench.sealing.seal import open_sealed
from avs3d_bench.sealing.secret import read_secret
from generators.plan import derive_rng
from generators.sealing.cli import unseal
from generators.sealing.unseal import unseal as open_seal
from tests.support import sealed_trees, tiny
from tests.support.sealed_trees import MULTI, SECRET, SINGLE, recommit, write_seal

EXTRA = "part_1/home_1/kitchen/9"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seal(tmp_path_factory.mktemp("sealed"))


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seal(tmp_path_factory.mktemp("scenes"), scenes=True)


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    """A sealed test whose files may be replaced."""
    return tiny.clone(made, tmp_path / "copy")


def found(folder: Path, secret: bytes = SECRET) -> list[str]:
    return [f"{problem.path}: {problem.message}" for problem in open_seal(folder, secret).problems]


def assert_found(folder: Path, *expected: str) -> None:
    """Every expected text is that of a problem, and nothing else is said."""
    texts = found(folder)
    for text in expected:
        assert any(text in line for line in texts), (text, texts)
    assert all(any(text in line for text in expected) for line in texts), texts


def edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change a JSON file by hand."""
    data = files.read_json(path)
    change(data)
    tiny.replace(path, files.dump_json(data).encode())


def truth(folder: Path, key: str, name: str = layout.OBSERVATION_JSON) -> Path:
    return folder / "private" / key / name


def mask_path(index: int, folder: str = layout.SEMANTIC_MASKS) -> str:
    return layout.image_path(folder, index)


def name_again(folder: Path, key: str) -> None:
    """Give observation.json the sha256 of the private files that are there."""

    def change(data: dict[str, Any]) -> None:
        for name in data["files"]:
            if truth(folder, key, name).exists():
                data["files"][name] = files.sha256_file(truth(folder, key, name))

    edit(truth(folder, key), change)


def test_honest_tests_are_confirmed(made: Path, scenes: Path) -> None:
    for folder in (made, scenes):
        opened = open_seal(folder, SECRET)
        assert (opened.problems, opened.notes) == ((), ())


def test_committing_again_alone_changes_nothing(copy: Path) -> None:
    """The forger's tool is none by itself: what is found below is the forgery."""
    before = files.read_json(copy / "public/seal.json")["commitments"]
    recommit(copy)
    assert files.read_json(copy / "public/seal.json")["commitments"] == before
    assert found(copy) == []


# Observations


def test_an_observation_that_was_dropped_before_the_seal(tmp_path: Path) -> None:
    def drop(work: Path) -> None:
        shutil.rmtree(work / MULTI)
        data = files.read_json(work / "dataset.json")
        data["observations"] = [entry for entry in data["observations"] if entry["key"] != MULTI]
        tiny.write_sealed(work, data)

    assert_found(write_seal(tmp_path, change=drop), f"{MULTI}: dropped: manifest.yaml has this observation")


def test_an_observation_that_was_added_before_the_seal(tmp_path: Path) -> None:
    def add(work: Path) -> None:
        shutil.copytree(work / SINGLE, work / EXTRA)
        data = files.read_json(work / "dataset.json")
        entry = next(entry for entry in data["observations"] if entry["key"] == SINGLE)
        data["observations"] = sorted([*data["observations"], {**entry, "key": EXTRA}], key=lambda entry: entry["key"])
        tiny.write_sealed(work, data)
        tiny.edit_record(work, EXTRA, lambda record: record.update(key=EXTRA, index=9))

    assert_found(
        write_seal(tmp_path, change=add),
        f"{EXTRA}: added: seal.json commits to this observation",
        f"dataset.json: private: {EXTRA} is not in the manifest in it",
    )


def test_an_observation_without_truth(made: Path, copy: Path) -> None:
    """Kept in public/, but gone from seal.json: participants would be asked what nobody is bound to."""
    edit(copy / "public/seal.json", lambda data: data["commitments"]["truth"].pop(MULTI))
    tiny.replace(copy / "private/seal.json", (copy / "public/seal.json").read_bytes())
    texts = found(copy)
    assert f"{MULTI}: listed in dataset.json, but seal.json has no commitments to it" in texts
    assert any(line.startswith(f"{MULTI}: dropped: ") for line in texts)


def _exchange_truth(folder: Path, one: str, other: str) -> None:
    """Two siblings whose pictures are the same get one another's truth; keys and plans are edited."""
    aside = folder / "aside"
    truth(folder, one, "").rename(aside)
    truth(folder, other, "").rename(truth(folder, one, ""))
    aside.rename(truth(folder, other, ""))
    records = {key: files.read_json(truth(folder, key)) for key in (one, other)}
    for key, wrong in ((one, other), (other, one)):
        poses = files.read_json(folder / "public" / key / layout.POSES_JSON)
        record = {**records[key]}
        record |= {name: records[wrong][name] for name in ("key", "index", "plan_sha256")}
        # `key` and its likes are those of the place, the sha256 of public files those of the place as well.
        record |= {"key": key, "index": int(key.rpartition("/")[2])}
        record["files"] = {**record["files"], **poses["files"]}
        tiny.replace(truth(folder, key), files.dump_json(record).encode())
    edit(
        folder / "private/dataset.json",
        lambda data: [e.update(category=files.read_json(truth(folder, e["key"]))["category"])
                      for e in data["observations"]],
    )  # fmt: skip


def test_siblings_whose_truth_was_exchanged(scenes: Path, tmp_path: Path) -> None:
    copy = tiny.clone(scenes, tmp_path / "copy")
    keys = [key for key in _keys(copy) if len(files.read_json(truth(copy, key))["sources"]) == 1]
    one, other = [key for key in keys if files.read_json(truth(copy, key))["background"] is None]
    _exchange_truth(copy, one, other)
    recommit(copy)
    for key in (one, other):
        assert any(line.startswith(f"{key}/observation.json: the sounding instances are [") for line in found(copy)), (
            found(copy)
        )


def test_siblings_whose_truth_was_exchanged_without_another_edit(scenes: Path, tmp_path: Path) -> None:
    copy = tiny.clone(scenes, tmp_path / "copy")
    one, other, *_ = _keys(copy)
    aside = copy / "aside"
    truth(copy, one, "").rename(aside)
    truth(copy, other, "").rename(truth(copy, one, ""))
    aside.rename(truth(copy, other, ""))
    recommit(copy)
    texts = found(copy)
    assert f"{one}/observation.json: is that of {other}: observations were exchanged" in texts
    assert f"{other}/observation.json: is that of {one}: observations were exchanged" in texts


def _keys(folder: Path) -> list[str]:
    return [entry["key"] for entry in files.read_json(folder / "public/dataset.json")["observations"]]


def test_pictures_of_another_seed(tmp_path: Path) -> None:
    """An observation that was generated with a chosen seed, or is another one of the test under this key."""

    def swap(work: Path) -> None:
        rng = derive_rng(1, SINGLE, "points")
        model = tiny.colmap_model(
            Intrinsics.from_fov(64), tiny.path_of(9), tiny.BOXES[tiny.SINGLE],
            draw=lambda: tuple(rng.integers(0, 64, (2, 12))),
        )  # fmt: skip
        write_model(work / SINGLE / layout.COLMAP, model)
        tiny.edit_record(work, SINGLE, lambda _: None)

    assert_found(
        write_seal(tmp_path, change=swap), f"{SINGLE}/sparse/0: its points are not the pixels that the secret draws"
    )


# Truth


def test_a_chosen_twin(tmp_path: Path) -> None:
    """The silent twin is declared the sounding one, in every file."""

    def choose(work: Path) -> None:
        folder, box = work / MULTI, tiny.BOXES[tiny.MULTI][0]
        areas = []
        for index in range(9):
            mask = media.read_png_ids(folder / mask_path(index, layout.INSTANCE_MASKS)) == box.id
            areas.append(int(mask.sum()))
            (folder / mask_path(index)).unlink()
            media.write_png_mask(folder / mask_path(index), mask)

        def change(data: dict[str, Any]) -> None:
            for instance in data["instances"]:
                instance["sounding"] = instance["id"] == box.id
            data["source_position"] = list(box.source)
            for frame, area in zip(data["frames"], areas, strict=True):
                frame |= {"visible_pixels": area, "line_of_sight": True}

        tiny.edit_record(work, MULTI, change)

    assert_found(
        write_seal(tmp_path, change=choose),
        f"{MULTI}/observation.json: the sounding instances are [1], the secret draws [2]",
    )


def test_masks_that_were_exchanged(copy: Path) -> None:
    """Masks of two frames change places; commitments and observation.json follow."""
    one, other = (truth(copy, SINGLE, mask_path(index)) for index in (0, 4))
    first, second = one.read_bytes(), other.read_bytes()
    tiny.replace(one, second)
    tiny.replace(other, first)
    name_again(copy, SINGLE)
    recommit(copy)
    texts = found(copy)
    for index in (0, 4):
        assert any(f"{mask_path(index)}: " in line and "pixels differ from id 1" in line for line in texts), texts
        assert any("pixels are marked, visible_pixels of" in line for line in texts)


def test_masks_ids_and_areas_that_were_exchanged(copy: Path) -> None:
    """All of the truth of two frames: only the published sparse points contradict it."""
    for folder in (layout.SEMANTIC_MASKS, layout.INSTANCE_MASKS):
        one, other = (truth(copy, SINGLE, mask_path(index, folder)) for index in (0, 4))
        first, second = one.read_bytes(), other.read_bytes()
        tiny.replace(one, second)
        tiny.replace(other, first)

    def change(data: dict[str, Any]) -> None:
        a, b = data["frames"][0], data["frames"][4]
        a["visible_pixels"], b["visible_pixels"] = b["visible_pixels"], a["visible_pixels"]
        for frame in (a, b):
            frame["line_of_sight"] = True

    edit(truth(copy, SINGLE), change)
    name_again(copy, SINGLE)
    recommit(copy)
    assert any("sparse points are on" in line for line in found(copy)), found(copy)


def test_other_test_frames(tmp_path: Path) -> None:
    def split(work: Path) -> None:
        names = [layout.frame_name(index) for index in range(9)]
        data = {"train": names[2:], "test": names[:2]}
        tiny.replace(work / SINGLE / layout.SPLITS_JSON, files.dump_json(data).encode())
        tiny.edit_record(work, SINGLE, lambda _: None)

    assert_found(write_seal(tmp_path, change=split), "camera_splits.json: another split than every eighth frame")


#: What a record says otherwise than the manifest → the text.
RECORDS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "seed": (lambda data: data.update(seed=7), "seed 7, expected"),
    "level": (lambda data: data["sound"].update(gain_db=-3.0), "level -3.0, expected 0.0"),
    "objects": (lambda data: data["instances"][1].update(category="clock"), "objects {"),
    "plan": (lambda data: data.update(plan_sha256="0" * 64), "plan_sha256 is not that of the manifest"),
    "poses": (lambda data: data["frames"][2].update(position=[0.0, 1.5, 0.0]), "has other poses, intrinsics"),
    "picture": (lambda data: data["files"].update({"input/frame_001.png": "0" * 64}), "another sha256 of input"),
    "no picture": (lambda data: data["files"].pop("input/frame_001.png"), "no sha256 of input/frame_001.png"),
    "mask": (lambda data: data["files"].update({"semantic_masks/frame_001.png": "0" * 64}),
             "semantic_masks/frame_001.png: not the file that observation.json names: its sha256"),
    "response": (lambda data: data["files"].update({"rirs/frame_1.npz": "0" * 64}), "rirs/frame_1.npz: not the file"),
    "no mask": (lambda data: data["files"].pop("semantic_masks/frame_001.png"), "does not name semantic_masks"),
    "lost": (lambda data: data["files"].update({"rirs/frame_99.npz": "0" * 64}), "frame_99.npz: missing"),
    "size": (lambda data: data.update(sizes=dict.fromkeys(data["files"], 5)), "another size of gt_3d"),
}  # fmt: skip


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_that_contradicts_files_or_manifest(copy: Path, name: str) -> None:
    change, text = RECORDS[name]
    edit(truth(copy, SINGLE), change)
    recommit(copy)
    texts = found(copy)
    assert any(text in line for line in texts), texts
    assert all(line.startswith((SINGLE, "dataset.json")) for line in texts), texts


def test_the_private_record_of_the_dataset(copy: Path) -> None:
    """Changed after the seal, and before it."""
    data = files.read_json(copy / "private/dataset.json")
    data["name"] = "another"
    tiny.write_sealed(copy / "private", data)
    assert any("dataset.json: not what seal.json commits to" in line for line in found(copy))
    recommit(copy)
    assert_found(copy, "dataset.json: private: name is 'another', the manifest in it says 'tiny'")


@pytest.mark.parametrize("name", ["template.yaml", "draws.json"])
def test_what_the_manifest_was_drawn_from_is_committed_to(copy: Path, name: str) -> None:
    path = copy / "private" / name
    tiny.replace(path, path.read_bytes() + b"\n")
    assert_found(copy, f"{name}: not what seal.json commits to")


# Files that nothing names


def test_folders_and_files_that_nothing_commits_to(copy: Path) -> None:
    for path in ("private/more/a/b.txt", f"private/{EXTRA}/observation.json", f"private/{SINGLE}/old/mask.png",
                 "private/notes.txt", f"private/{SINGLE}/notes.txt", f"private/{SINGLE}/semantic_masks/x.png",
                 "public/part_1/more/b.txt", "public/notes.txt", f"public/{SINGLE}/notes.txt"):  # fmt: skip
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        (copy / path).write_text("x")
    (copy / "private/linked").symlink_to(copy / "public")
    recommit(copy)
    assert_found(
        copy,
        "more: surplus folder in private/ with 1 files",
        f"{EXTRA}: surplus folder in private/ with 1 files",
        f"{SINGLE}/old: surplus folder in private/ with 1 files",
        "linked: surplus folder in private/",
        "notes.txt: surplus file in private/",
        f"{SINGLE}/notes.txt: surplus file in private/",
        f"{SINGLE}/semantic_masks/x.png: surplus file in private/",
        "part_1/more: surplus folder in public/ with 1 files",
        "notes.txt: surplus file in public/",
        f"{SINGLE}/notes.txt: surplus file: poses.json does not name it",
    )


def test_thousands_of_problems_are_counted(copy: Path) -> None:
    for number in range(300):
        (copy / f"private/note_{number}.txt").touch()
    result = CliRunner().invoke(unseal, [str(copy), "--secret", str(copy / "secret")])
    assert result.exit_code == 1
    assert result.output.count("surplus file") == 200
    assert "… and 100 more errors" in result.output
    assert "300 not as committed to" in result.output


# The secret


def test_a_commitment_that_was_published_before_the_template(copy: Path) -> None:
    record = files.read_json(copy / "public/seal.json")["commitments"]["secret"]
    (copy / "commitment.json").write_text(files.dump_json(record))
    assert found(copy) == []
    edit(copy / "commitment.json", lambda data: data.update(digest="0" * 64))
    assert_found(copy, "commitment.json: not the commitment in seal.json: the test was made with another secret")


def test_a_test_of_the_earlier_format_is_opened(tmp_path: Path) -> None:
    """Schema 1.0: the sha256 of the secret, which is the working key itself; no commitments to dataset.json."""
    old = write_seal(tmp_path, old=True)
    data = files.read_json(old / "public/seal.json")
    secret = read_secret(old / "secret")
    assert data["schema_version"] == "1.0"
    assert data["commitments"]["secret"] == hashlib.sha256(secret).hexdigest()
    assert found(old, secret) == []
    assert found(old, SECRET)[0].startswith("secret: not the secret that seal.json commits to")
    open_sealed(old / "public", old / "private")
    name = truth(old, SINGLE, mask_path(3))
    tiny.replace(name, truth(old, SINGLE, mask_path(8)).read_bytes())
    assert any("frame_003.png: not what seal.json commits to" in line for line in found(old, secret))


def test_draws_are_compared_only_with_the_software_of_the_seal(copy: Path) -> None:
    """Other versions may draw otherwise; then --regenerate with the right ones tells, and a note says so."""
    edit(copy / "public/seal.json", lambda data: data["provenance"].update(digest="0" * 64))
    tiny.replace(copy / "private/seal.json", (copy / "public/seal.json").read_bytes())
    opened = open_seal(copy, SECRET)
    assert opened.problems == ()
    assert any("sealed with other software" in note for note in opened.notes)
    assert any("not compared with the draws of the secret" in note for note in opened.notes)


def test_the_points_of_a_sealed_test_are_drawn(made: Path) -> None:
    """The hand-made tree is not confirmed because it has too few points to be judged."""
    from avs3d_bench.dataset import Dataset
    from avs3d_bench.validation.sightings import sightings_by_frame

    observation = Dataset(made / "public")[SINGLE]
    seen = sightings_by_frame(observation.colmap, observation.intrinsics)
    assert sum(int(np.sum(one.origin)) for one in seen.values()) > sealed_trees._POINTS * 5
