"""`avs3d generate --remake`: named observations are regenerated, whole or not at all, and nothing else is touched."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import yaml

from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.shard_check import check_shards
from avs3d_bench.formats.files import sha256_file
from avs3d_bench.validate import validate
from generators.manifest.reading import read_manifest
from generators.observation.output import FolderOutput, sweep
from generators.options import GenerateOptions
from generators.plan import make_plans
from generators.run.formats import FOLDERS, DatasetFormat, WebdatasetFormat, is_of_plan
from generators.run.generation import generate
from tests.support.homes import tree_digest, write_manifest

ONE, TWO = "part_1/box/kitchen/1", "part_2/box/kitchen/1"
LICENCE = {"name": "CC0-1.0", "author": "avs3d-bench"}
#: The options of every run here: two frames of 32 × 32 pixels.
SMALL: dict[str, Any] = {"audio": "analytic", "frames": 2, "size": 32, "workers": 1}


def write(folder: Path, **changes: Any) -> Path:
    """The manifest of a microwave (part_1) and three clocks (part_2), each category with a recording of its own."""
    path = write_manifest(folder)
    for name, pitch in (("hum", 120), ("tick", 900), ("tock", 700)):
        wave = 0.3 * np.sin(2 * np.pi * pitch * np.arange(44_100) / 44_100)
        soundfile.write(folder / f"{name}.wav", wave, 44_100)
    sounds = {"microwave": ["hum.wav"], "clock": ["tick.wav"]} | changes.pop("sounds", {})
    document = yaml.safe_load(path.read_text()) | changes
    document["sounds"] = {
        name: [{"file": file, "licence": LICENCE} for file in files] for name, files in sounds.items()
    }
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def inodes(folder: Path) -> dict[str, int]:
    return {path.relative_to(folder).as_posix(): path.stat().st_ino for path in folder.rglob("*")}


def form_of(name: str) -> DatasetFormat:
    """The form of a dataset of two observations."""
    return FOLDERS if name == "folders" else WebdatasetFormat({ONE: 0, TWO: 1})


def own_files(root: Path, form: str, key: str) -> dict[str, tuple[int, str]]:
    """Inode and sha256 of each file of an observation."""
    paths = (root / key).rglob("*") if form == "folders" else root.glob(f"*-{[ONE, TWO].index(key):06d}.tar")
    found = {path.name: (path.stat().st_ino, sha256_file(path)) for path in paths if path.is_file()}
    assert found
    return found


def listed(root: Path, form: str) -> list[str]:
    return [entry.key for entry in form_of(form).read_index(root).observations]


def errors_of(root: Path, form: str) -> list[str]:
    report = validate(root) if form == "folders" else check_shards(root)
    return [str(problem) for problem in report.problems if problem.severity == "error"]


# ---- what an observation uses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("digest", ["digest", "pictures_digest"])
def test_a_declaration_of_another_category_changes_no_digest(tmp_path: Path, digest: str) -> None:
    def digests(**changes: Any) -> tuple[str, ...]:
        plans = make_plans(read_manifest(write(tmp_path, **changes)), GenerateOptions(audio="analytic"))
        return tuple(getattr(plan, digest) for plan in plans)

    one, two = digests()
    height = {"file": "room.glb", "licence": LICENCE, "height": 0.3}
    # part_1 has a microwave, which sounds, and no clock; part_2 has clocks alone.
    assert digests(sounds={"clock": ["no such file.wav"]})[0] == one
    assert digests(objects={"clock": [height]})[0] == one
    assert digests(objects={"clock": [height]})[1] != two
    assert digests(objects={"toilet": [height]}) == (one, two)
    assert digests(objects={"clock": [], "microwave": []}) == (one, two)
    other = digests(sounds={"clock": ["tick.wav", "tock.wav"]})
    assert (other[1] == two) == (digest == "pictures_digest"), "a sound is no part of the pictures"


@pytest.mark.slow
def test_a_wrong_file_name_of_one_category_does_not_block_the_others(tmp_path: Path) -> None:
    root = tmp_path / "data"
    wrong = write(tmp_path, sounds={"clock": ["tikc.wav"]})
    assert generate(wrong, root, **SMALL, only=["part_1/*"]).made == (ONE,)
    before = inodes(root / ONE)
    outcome = generate(write(tmp_path), root, **SMALL)
    assert (outcome.made, outcome.kept, outcome.failed) == ((TWO,), (ONE,), ())
    assert inodes(root / ONE) == before
    assert errors_of(root, "folders") == []


# ---- a changed declaration ------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("form", ["folders", "webdataset"])
def test_remake_replaces_the_named_observations_and_touches_no_other(tmp_path: Path, form: Any) -> None:
    root = tmp_path / "data"
    chosen = SMALL | {"format": form}
    generate(write(tmp_path), root, **chosen)
    before, kept = tree_digest(root), own_files(root, form, ONE)
    changed = write(tmp_path, sounds={"clock": ["tock.wav"]})
    with pytest.raises(UsageError, match=rf"from another manifest.* --remake '{TWO}'") as caught:
        generate(changed, root, **chosen)
    assert str(form_of(form).path(root, TWO)) in str(caught.value)
    assert tree_digest(root) == before
    outcome = generate(changed, root, **chosen, remake=["*2/*"])
    assert (outcome.made, outcome.kept, outcome.failed) == ((TWO,), (ONE,), ())
    assert own_files(root, form, ONE) == kept
    assert not [*root.glob("part_*/*/*/.*"), *root.glob(".*")], "nothing temporary is left"
    assert errors_of(root, form) == []
    fresh = tmp_path / "fresh"
    generate(changed, fresh, **chosen)
    assert tree_digest(root) == tree_digest(fresh)
    assert generate(changed, root, **chosen).kept == (ONE, TWO)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["folders", "webdataset"])
def test_an_observation_stays_as_it_was_if_it_cannot_be_made_again(tmp_path: Path, form: Any) -> None:
    root = tmp_path / "data"
    chosen = SMALL | {"format": form}
    generate(write(tmp_path), root, **chosen)
    before, whole = own_files(root, form, TWO), tree_digest(root)
    (tmp_path / "slab.obj").write_text("v 0 0 0\nv 3 0 0\nv 0 9 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    slab = {"file": "slab.obj", "licence": LICENCE, "height": 4.5}  # taller than the room
    outcome = generate(write(tmp_path, objects={"clock": [slab]}), root, **chosen, remake=[TWO])
    assert outcome.kept == (ONE,)
    ((key, message),) = outcome.failed
    assert key == TWO
    assert "the earlier observation is left as it was" in message
    assert own_files(root, form, TWO) == before
    assert listed(root, form) == [ONE], "the index is whole"
    generate(write(tmp_path), root, **chosen)  # with the manifest that it is from, it is listed again
    assert tree_digest(root) == whole


@pytest.mark.slow
def test_a_damage_that_sizes_do_not_show_is_made_good(tmp_path: Path) -> None:
    root, manifest = tmp_path / "data", write(tmp_path)
    generate(manifest, root, **SMALL)
    whole = tree_digest(root)
    picture = root / ONE / "input/frame_000.png"
    picture.write_bytes(picture.read_bytes()[:-1] + b"x")
    assert generate(manifest, root, **SMALL).kept == (ONE, TWO)
    assert generate(manifest, root, **SMALL, remake=[ONE]).made == (ONE,)
    assert tree_digest(root) == whole


def test_remake_needs_a_pattern_that_matches(tmp_path: Path) -> None:
    manifest = write(tmp_path)
    for pattern, only, words in (("part_9/*", (), "--remake 'part_9/\\*' matches no"), ("part_2/*", [ONE], "--only")):
        with pytest.raises(UsageError, match=words):
            generate(manifest, tmp_path / "data", **SMALL, remake=[pattern], only=only)
    with pytest.raises(UsageError, match="expected a list of patterns"):
        generate(manifest, tmp_path / "data", **SMALL, remake="part_2/*")
    assert not (tmp_path / "data").exists()


# ---- the folder that takes another's place --------------------------------------------------------------------------


class Killed(BaseException):
    """Stands for the end of the process."""


def folder_with(root: Path, text: str) -> Path:
    place = root / ONE
    place.mkdir(parents=True)
    (place / "observation.json").write_text(text)
    return place


@pytest.mark.parametrize("step", [0, 1, 2])
def test_a_kill_between_two_steps_loses_neither_the_old_nor_the_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    place = folder_with(tmp_path, "old")
    output = FolderOutput(place, replaces=True)
    output.open()
    steps = iter(range(10))
    rename, remove = Path.rename, "generators.observation.output.remove"

    def dying(self: Path, target: Path) -> Path:
        if next(steps) == step:
            raise Killed
        return rename(self, target)

    def dies(_: Path) -> None:
        raise Killed

    monkeypatch.setattr("avs3d_bench.formats.files.write_json", lambda path, _: path.write_text("new"))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", dying)
        patch.setattr(remove, dies)
        with pytest.raises(Killed):
            output.finish(None)  # type: ignore[arg-type]  # nothing of it is read
    sweep(tmp_path)
    assert (place / "observation.json").read_text() == ("old" if step < 2 else "new")
    assert [path.name for path in place.parent.iterdir()] == ["1"]


def test_a_folder_that_replaces_nothing_refuses_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = folder_with(tmp_path, "old")
    monkeypatch.setattr("avs3d_bench.formats.files.write_json", lambda path, _: path.write_text("new"))
    output = FolderOutput(place)
    output.open()
    with pytest.raises(Avs3dError, match="kitchen/1"):
        output.finish(None)  # type: ignore[arg-type]  # nothing of it is read
    assert (place / "observation.json").read_text() == "old"


# ---- datasets of other versions -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_dataset_of_other_software_is_refused_with_the_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, manifest = tmp_path / "data", write(tmp_path)
    generate(manifest, root, **SMALL)
    before = tree_digest(root)
    source = read_manifest(manifest)
    monkeypatch.setattr("generators.plan.json.dumps", lambda *_, **__: "as another version computes it")
    monkeypatch.setattr("generators.run.differences.__version__", "9.0.0")
    monkeypatch.setattr("generators.run.differences.observation_provenance", other_software)
    assert not is_of_plan(FOLDERS, root, make_plans(source, GenerateOptions(audio="analytic", frames=2, size=32))[0])
    with pytest.raises(UsageError, match=r"by other software \(version .*, not 9\.0\.0\); .* --remake"):
        generate(manifest, root, **SMALL)
    assert tree_digest(root) == before


def other_software(*_: object) -> Any:
    from avs3d_bench.runtime.provenance import Provenance

    return Provenance({"generators/observation/generate.py": "0" * 64}, {}, "3.11")
