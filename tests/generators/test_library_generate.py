"""Assets from folders, ESC-50 and furniture libraries, and an observation of them: pinned, credited, deterministic."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import soundfile
import trimesh
from click.testing import CliRunner, Result
from PIL import Image

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.validate import validate
from generators.cli import generate
from generators.library import LOCK_NAME, Store, open_asset, read_lock, update_lock
from generators.library.cli import assets
from generators.library.folder import mesh_files
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from tests.support.homes import tree_digest, write_manifest
from tests.support.library_server import Reply as Answer
from tests.support.library_server import box, glb, serving, wav

OBJ = """mtllib box.mtl
v -20 0 -12
v 20 0 -12
v 20 30 -12
v -20 30 -12
v -20 0 12
v 20 0 12
v 20 30 12
v -20 30 12
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl paint
f 4/1 3/2 2/3 1/4
f 5/1 6/2 7/3 8/4
f 1/1 2/2 6/3 5/4
f 3/1 4/2 8/3 7/4
f 1/1 5/2 8/3 4/4
f 2/1 3/2 7/3 6/4
"""


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / "store"))
    monkeypatch.delenv("AVS3D_SCANS", raising=False)
    return Store(tmp_path / "store")


def run(*args: object) -> Result:
    return CliRunner().invoke(assets, [str(arg) for arg in args], catch_exceptions=True)


def text_of(done: Result) -> str:
    return f"{done.output} {done.exception or ''}"


def microwaves(folder: Path) -> Path:
    """A folder with a box in centimetres (OBJ, MTL, a texture in its own folder), a GLB, a recording, a stranger."""
    (folder / "obj" / "maps").mkdir(parents=True)
    (folder / "obj" / "box.obj").write_text(OBJ)
    (folder / "obj" / "box.mtl").write_text("newmtl paint\nKd 1 1 1\nmap_Kd maps/paint.png\n")
    pixels = np.zeros((8, 8, 3), dtype=np.uint8)
    pixels[:4] = (200, 40, 30)
    Image.fromarray(pixels).save(folder / "obj" / "maps" / "paint.png")
    (folder / "plain.glb").write_bytes(glb())
    (folder / "hum.wav").write_bytes(wav(1.5))
    (folder / "notes.txt").write_text("nothing")
    return folder


def import_folder(folder: Path, lock: Path, *more: object) -> Result:
    return run(
        "import", "folder", folder, "--licence", "CC BY 4.0", "--author", "A. Maker", "--url", "https://example.org/box",
        "--category", "microwave", "--lock", lock, *more,
    )  # fmt: skip


# ---- folders --------------------------------------------------------------------------------------------------------


def test_a_folder_becomes_entries_that_say_everything(tmp_path: Path, store: Store) -> None:
    lock = tmp_path / LOCK_NAME
    done = import_folder(microwaves(tmp_path / "Mike's waves"), lock, "--height", 0.3)
    assert done.exit_code == 0, text_of(done)
    table = {entry.id: entry for entry in read_lock(lock).assets}
    assert list(table) == ["folder/Mike-s-waves/hum", "folder/Mike-s-waves/obj/box", "folder/Mike-s-waves/plain"]
    obj = table["folder/Mike-s-waves/obj/box"]
    assert (obj.kind, obj.file, obj.licence, obj.author, obj.up, obj.front, obj.height) == (
        "object", "model.zip", "CC-BY-4.0", "A. Maker", "y", "+z", 0.3,
    )  # fmt: skip
    assert (table["folder/Mike-s-waves/hum"].kind, table["folder/Mike-s-waves/hum"].height) == ("sound", None)
    with zipfile.ZipFile(store.path(obj)) as archive:
        assert archive.namelist() == ["box.mtl", "box.obj", "maps/paint.png"]
    path, entry = open_asset(lock, obj.id)
    assert entry == obj
    low, high = trimesh.load_scene(path).bounds
    assert high - low == pytest.approx((0.4, 0.3, 0.24), abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("hair_dryer", ""),
        ("microwave", ""),
        ("mircowave", "mircowave is no category of the benchmark, so manifests must declare it in categories; did you "
                      "mean 'microwave'?"),
    ],
)  # fmt: skip
def test_a_category_of_ones_own_is_taken_and_a_likely_slip_is_noted(tmp_path: Path, name: str, hint: str) -> None:
    lock = tmp_path / LOCK_NAME
    done = import_folder(microwaves(tmp_path / "waves"), lock, "--category", name)
    assert done.exit_code == 0, text_of(done)
    assert {entry.category for entry in read_lock(lock).assets} == {name}
    assert (f"note: {hint}" in done.output) if hint else ("note: " not in done.output)
    listed = run("list", "--lock", lock, "--category", name)
    assert listed.output.count(name) >= 3
    run("list", "--lock", lock, "--html", tmp_path / "page")
    page = (tmp_path / "page" / "index.html").read_text()
    assert name.replace("_", " ") in page
    assert page.count("folder/waves/hum") >= 1


@pytest.mark.parametrize("name", ["Hair dryer", "hair-dryer", "9", "a" * 65])
def test_a_category_that_is_no_name_is_refused(tmp_path: Path, name: str) -> None:
    done = import_folder(microwaves(tmp_path / "waves"), tmp_path / LOCK_NAME, "--category", name)
    assert done.exit_code == 2
    assert "expected lower-case letters, digits and underscores" in " ".join(text_of(done).split())
    assert not (tmp_path / LOCK_NAME).exists()


def test_the_same_folder_gives_the_same_bytes_wherever_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    locks, trees = [], []
    for name in ("one", "two"):
        monkeypatch.setenv("AVS3D_ASSETS", str(tmp_path / name / "store"))
        lock = tmp_path / name / LOCK_NAME
        assert import_folder(microwaves(tmp_path / name / "waves"), lock).exit_code == 0
        locks.append(lock.read_bytes())
        trees.append(tree_digest(tmp_path / name / "store"))
    assert locks[0] == locks[1]
    assert trees[0] == trees[1]


def test_a_bundle_holds_what_the_mesh_names_and_nothing_from_outside(tmp_path: Path) -> None:
    root = tmp_path / "root"
    for folder in ("models", "maps"):
        (root / folder).mkdir(parents=True)
    (tmp_path / "secret.png").write_bytes(b"secret")
    (root / "maps" / "a.png").write_bytes(b"picture")
    (root / "models" / "x.mtl").write_text(
        "newmtl m\nmap_Kd -s 1 1 1 ../maps/a.png\nmap_Kd ../../secret.png\nmap_Kd no.png\n"
    )
    (root / "models" / "x.obj").write_text("mtllib x.mtl\nmtllib /etc/hostname\nv 0 0 0\n")
    assert sorted(mesh_files(root / "models" / "x.obj", root)) == ["maps/a.png", "models/x.mtl", "models/x.obj"]
    (root / "models" / "y.gltf").write_text(
        json.dumps({"buffers": [{"uri": "b%20c.bin"}], "images": [{"uri": "data:,"}]})
    )
    (root / "models" / "b c.bin").write_bytes(b"buffer")
    assert sorted(mesh_files(root / "models" / "y.gltf", root)) == ["b c.bin", "y.gltf"]


def test_files_and_licences_that_cannot_be_used(tmp_path: Path, store: Store) -> None:
    lock, folder = tmp_path / LOCK_NAME, tmp_path / "odd"
    folder.mkdir()
    (folder / "broken.glb").write_bytes(glb()[:50])
    (folder / "silent.wav").write_bytes(b"RIFF")
    (folder / "fine.wav").write_bytes(wav())
    done = import_folder(folder, lock)
    assert done.exit_code == 1
    for name in ("broken", "silent"):
        lines = [line for line in done.output.splitlines() if f"folder/odd/{name}: " in line]
        assert len(lines) == 1, done.output
        assert str(tmp_path / "store") not in lines[0]
    assert [entry.id for entry in read_lock(lock).assets] == ["folder/odd/fine"]
    assert {path.name for path in store.root.rglob("*") if path.is_file()} == {"sound.wav"}
    refused = import_folder(folder, lock, "--licence", "all rights reserved")
    assert "refused, its licence all rights reserved is not known to allow" in refused.output
    taken = import_folder(
        folder / "fine.wav", lock, "--licence", "all rights reserved", "--allow-licence", "all rights reserved"
    )
    assert taken.exit_code == 0, text_of(taken)


# ---- ESC-50 ---------------------------------------------------------------------------------------------------------


def clone(folder: Path) -> Path:
    """Four clips as a clone of ESC-50 has them."""
    (folder / "meta").mkdir(parents=True)
    (folder / "audio").mkdir()
    rows = ["filename,fold,target,category,esc10,src_file,take"]
    credits = ["## Licensing/attribution details for individual clips:", ""]
    for name, category, esc10, licence in (
        ("1-100-A-38", "clock_tick", "True", "CC0"),
        ("1-200-B-35", "washing_machine", "False", "CC-BY"),
        ("1-300-A-37", "clock_alarm", "False", "CC-Sampling+"),
        ("1-400-A-0", "dog", "True", "CC0"),
    ):
        fold, source, take, target = name.split("-")
        rows.append(f"{name}.wav,{fold},{target},{category},{esc10},{source},{take}")
        credits.append(
            f"- [{fold}-{source}-{take}.ogg]: clip derived from rec (old) {source}.wav (http://www.freesound.org/people/"
            f"jo%20e/sounds/{source}/) by jo e [{licence}]"
        )
        (folder / "audio" / f"{name}.wav").write_bytes(wav(1.0 + int(source) / 1000))
    (folder / "meta" / "esc50.csv").write_text("\n".join(rows) + "\n")
    (folder / "LICENSE").write_text("\n".join(credits) + "\n")
    return folder


def test_esc50_is_entered_under_the_stricter_licence_with_each_author(tmp_path: Path) -> None:
    lock, folder = tmp_path / LOCK_NAME, clone(tmp_path / "ESC-50")
    done = run("import", "esc50", folder, "--lock", lock)
    assert done.exit_code == 0, text_of(done)
    assert "2 clips left out: CC-BY-NC-3.0 forbids commercial use" in done.output
    (entry,) = read_lock(lock).assets
    assert (entry.id, entry.category, entry.licence, entry.author, entry.title, entry.url) == (
        "esc50/1-100-A-38", "clock", "CC-BY-3.0", "jo e", "rec (old) 100.wav",
        "http://www.freesound.org/people/jo%20e/sounds/100/",
    )  # fmt: skip
    done = run(
        "import", "esc50", folder, "--category", "washing_machine", "--allow-licence", "CC-BY-NC-3.0", "--lock", lock
    )
    assert done.exit_code == 0, text_of(done)
    assert [(one.id, one.licence) for one in read_lock(lock).assets][1] == ("esc50/1-200-B-35", "CC-BY-NC-3.0")
    assert "no clip has a licence" in text_of(run("import", "esc50", folder, "--category", "clock_alarm"))
    assert "ESC-50 has no sound of 'microwave'" in text_of(run("import", "esc50", folder, "--category", "microwave"))


def test_a_class_of_esc50_that_is_no_category_of_the_benchmark_keeps_its_name(tmp_path: Path) -> None:
    lock, folder = tmp_path / LOCK_NAME, clone(tmp_path / "ESC-50")
    done = run("import", "esc50", folder, "--category", "dog", "--lock", lock)
    assert done.exit_code == 0, text_of(done)
    (entry,) = read_lock(lock).assets
    assert (entry.id, entry.category) == ("esc50/1-400-A-0", "dog")


def test_a_clip_is_fetched_again_from_the_repository(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, folder = tmp_path / LOCK_NAME, clone(tmp_path / "ESC-50")
    run("import", "esc50", folder, "--lock", lock)
    (entry,) = read_lock(lock).assets
    store.drop(entry)
    with serving() as server:
        monkeypatch.setenv("AVS3D_ESC50_URL", server.url)
        server.on("/audio/1-100-A-38.wav", Answer((folder / "audio" / "1-100-A-38.wav").read_bytes()))
        done = run("fetch", "--lock", lock)
    assert done.exit_code == 0, text_of(done)
    assert store.problem(entry) == ""


def test_a_clone_that_is_none_is_named(tmp_path: Path) -> None:
    folder = clone(tmp_path / "ESC-50")
    (folder / "LICENSE").write_text("nothing")
    assert "has no entry for 1-100-A-38.wav" in text_of(run("import", "esc50", folder))
    (folder / "meta" / "esc50.csv").write_text("name,label\na,b\n")
    assert "has no column 'filename'" in text_of(run("import", "esc50", folder))


# ---- furniture libraries --------------------------------------------------------------------------------------------


def furniture(path: Path, colour: str = "paint") -> Path:
    """An .sh3f with a clock, a microwave and a bed."""
    lines = ["id=Tests", "name=Tests", "license=Creative Commons Attribution 3.0 Unported license"]
    for number, (name, title, elevation) in enumerate(
        (("wall", "Wall clock", "150"), ("wave", "Microwave", "0"), ("bed", "Bed", "0")), start=1
    ):
        lines += [
            f"id#{number}=Tests#{name}", f"name#{number}={title}", f"category#{number}=Kitchen",
            f"creator#{number}=Tester",
            f"model#{number}=/m/{name}.obj", f"width#{number}=40", f"depth#{number}=24", f"height#{number}=30",
            f"elevation#{number}={elevation}",
        ]  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("PluginFurnitureCatalog.properties", "\n".join(lines))
        archive.writestr("m/box.mtl", f"newmtl {colour}\nKd 0.8 0.1 0.1\n")
        for name in ("wall", "wave", "bed"):
            archive.writestr(f"m/{name}.obj", OBJ.replace("paint", colour))
    return path


def test_furniture_is_told_by_its_name_and_found_again(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, library = tmp_path / LOCK_NAME, furniture(tmp_path / "lib" / "Tests.sh3f")
    done = run("import", "sh3f", library.parent, "--lock", lock)
    assert done.exit_code == 0, text_of(done)
    table = {entry.id: entry for entry in read_lock(lock).assets}
    assert {name: entry.category for name, entry in table.items()} == {
        "sh3d/tests/wall": "clock",
        "sh3d/tests/wave": "microwave",
    }
    wave = table["sh3d/tests/wave"]
    assert (wave.ref, wave.height, wave.licence, wave.author) == ("Tests#wave", 0.3, "CC-BY-3.0", "Tester")
    assert "its name does not determine a category" in text_of(
        run("import", "sh3f", library, "--id", "bed", "--lock", lock)
    )
    assert "expected one model's id" in text_of(run("import", "sh3f", library, "--id", "sofa", "--lock", lock))

    store.drop(wave)
    monkeypatch.setenv("AVS3D_SH3F", str(tmp_path / "nowhere"))
    missing = run("fetch", "--lock", lock)
    assert "apt install sweethome3d-furniture" in missing.output
    monkeypatch.setenv("AVS3D_SH3F", str(library.parent))
    assert run("fetch", "--lock", lock).exit_code == 0
    assert store.problem(wave) == ""

    store.drop(wave)
    furniture(library, "other")
    other = run("fetch", "--lock", lock)
    assert other.exit_code == 1
    assert "holds another version of it" in other.output
    assert "avs3d assets import sh3f" in other.output


# ---- manifests and generation ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ({}, "expected exactly one of file (with its licence) and asset"),
        ({"file": "x.glb", "asset": "a/b", "licence": {"name": "MIT", "author": "x"}}, "expected exactly one of"),
        ({"file": "x.glb"}, "needs its licence"),
        (
            {"asset": "a/b", "licence": {"name": "MIT", "author": "x"}},
            "licence of asset 'a/b' comes from the lock file",
        ),
        ({"asset": "a/b", "height": 0.3}, "height of asset 'a/b' comes from the lock file"),
    ],
)
def test_a_manifest_names_a_file_or_an_asset(tmp_path: Path, spec: dict[str, object], words: str) -> None:
    manifest = write_manifest(tmp_path, objects={"microwave": [spec]})
    with pytest.raises(UsageError) as caught:
        read_manifest(manifest)
    assert words in str(caught.value)
    assert "objects.microwave.0" in str(caught.value)


def small_manifest(folder: Path, asset: str = "folder/waves/obj/box", sound: str = "folder/waves/hum") -> Path:
    """One observation of a microwave, from the folder's box and recording."""
    return write_manifest(
        folder,
        camera={"size": 64, "frames": 3},
        light="preview",
        objects={"microwave": [{"asset": asset}]},
        sounds={"microwave": [{"asset": sound}]},
        observations=[
            {
                "part": "part_1",
                "scan": "box",
                "room": "kitchen",
                "index": 1,
                "category": "microwave",
                "silent": ["oven"],
            }
        ],
    )


def test_plans_refuse_assets_that_are_not_there(tmp_path: Path, store: Store) -> None:
    lock = tmp_path / LOCK_NAME
    assert import_folder(microwaves(tmp_path / "waves"), lock, "--height", 0.3).exit_code == 0

    def plans(**names: str) -> object:
        return make_plans(read_manifest(small_manifest(tmp_path, **names)), GenerateOptions(audio="analytic"))

    with pytest.raises(UsageError, match=r"no asset 'folder/waves/obj/bax'; did you mean 'folder/waves/obj/box'\?"):
        plans(asset="folder/waves/obj/bax")
    with pytest.raises(
        UsageError, match=r"is the sound of a microwave, but the manifest needs the object of a microwave"
    ):
        plans(asset="folder/waves/hum")
    entry = read_lock(lock).find("folder/waves/hum")
    assert entry is not None
    store.drop(entry)
    with pytest.raises(Avs3dError, match=r"folder/waves/hum not in the store; run: avs3d assets fetch --lock"):
        plans()
    done = run("fetch", "--manifest", tmp_path / "tiny.yaml")
    assert done.exit_code == 1
    assert "came from a folder (hum.wav) and has no address; run: avs3d assets fetch --from DIR" in done.output


@pytest.mark.slow
def test_an_observation_made_of_assets_credits_them_and_is_deterministic(tmp_path: Path) -> None:
    lock = tmp_path / LOCK_NAME
    assert import_folder(microwaves(tmp_path / "waves"), lock, "--height", 0.3).exit_code == 0
    manifest = small_manifest(tmp_path)

    def make(root: Path) -> Path:
        args = [
            str(manifest),
            "-o",
            str(root),
            "--workers",
            "1",
            "--audio",
            "analytic",
            "--cache",
            str(tmp_path / "cache"),
        ]
        done = CliRunner().invoke(generate, args, catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return root

    root = make(tmp_path / "one")
    assert [str(p) for p in validate(root, deep=True).problems if p.severity == "error"] == []
    (observation,) = Dataset(root)
    record = observation.record
    assert record is not None
    sounding = record.sounding
    assert sounding.asset == "folder/waves/obj/box"
    assert sounding.licence.model_dump() == {
        "name": "CC-BY-4.0", "author": "A. Maker", "source": "https://example.org/box",
    }  # fmt: skip
    low, high = np.array(sounding.bounds)
    assert (high - low)[1] == pytest.approx(0.3, abs=1e-3), "the height that the lock file says"
    assert record.sound is not None
    assert record.sound.asset == "folder/waves/hum"
    credited = {item["asset"]: item for item in json.loads((root / "dataset.json").read_text())["attributions"]}
    assert credited["folder/waves/obj/box"] | {"asset": ""} == {
        "asset": "", "name": "CC-BY-4.0", "author": "A. Maker", "source": "https://example.org/box",
    }  # fmt: skip
    assert "folder/waves/hum" in credited
    level = [np.sqrt((observation.frames[i].audio() ** 2).mean()) for i in range(3)]
    assert min(level) > 1e-4

    assert tree_digest(make(tmp_path / "two")) == tree_digest(root)

    # Another author in the lock file is another dataset: the old observation is not passed off as the new one.
    entry = read_lock(lock).find("folder/waves/hum")
    assert entry is not None
    update_lock(lock, (entry.model_copy(update={"author": "Someone Else"}),))
    done = CliRunner().invoke(generate, [str(manifest), "-o", str(root), "--audio", "analytic"], catch_exceptions=True)
    assert "was generated from another manifest" in str(done.exception)


def test_a_sound_in_any_format_that_is_delivered_can_be_played(tmp_path: Path) -> None:
    from generators.assets.sounds import load_sound

    for kind in ("WAV", "FLAC", "OGG", "MP3", "AIFF"):
        if kind not in soundfile.available_formats():
            pytest.skip(f"this libsndfile has no {kind}")
        path = tmp_path / f"x.{kind.lower()}"
        path.write_bytes(wav(2.0, kind))
        assert load_sound(path, 3.0).shape == (3 * 44100,), kind


def test_the_model_of_the_tests_is_what_it_says() -> None:
    assert box().extents == pytest.approx((0.4, 0.3, 0.25))
