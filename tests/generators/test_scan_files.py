"""Scans found by their id in the layouts of HM3D, Matterport3D and plain folders, and what goes into digests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from avs3d_bench.errors import Avs3dError
from generators.options import GenerateOptions
from generators.plan import check_scans, make_plans, read_manifest, scans_root
from generators.run.runner import RunSettings, run
from generators.scans import files as scanfiles
from generators.scans.files import digest, find_scan_files, scan_files_of


def touch(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(name.encode())


@pytest.mark.parametrize("folder", ["", "val", "minival", "hm3d/val", "scene_datasets/hm3d/train"])
@pytest.mark.parametrize("scan", ["00800-TEEsavR23oF", "TEEsavR23oF"])
def test_hm3d_by_either_id_wherever_it_lies(tmp_path: Path, folder: str, scan: str) -> None:
    own = Path(folder) / "00800-TEEsavR23oF"
    stem = str(own / "TEEsavR23oF")
    touch(
        tmp_path, f"{stem}.basis.glb", f"{stem}.glb", f"{stem}.semantic.glb", f"{stem}.semantic.txt", f"{stem}.navmesh"
    )
    touch(tmp_path, f"{folder}/00801-other/other.glb")
    found = find_scan_files(scan, tmp_path)
    assert found.kind == "hm3d"
    assert found.mesh == tmp_path / f"{stem}.glb"
    assert (found.semantic_txt, found.semantic_mesh) == (
        tmp_path / f"{stem}.semantic.txt",
        tmp_path / f"{stem}.semantic.glb",
    )
    assert (found.up, found.front, found.house) == ("z", "-y", None)


def test_a_basis_file_is_taken_where_there_is_no_plain_one(tmp_path: Path) -> None:
    touch(tmp_path, "00800-TEEsavR23oF/TEEsavR23oF.basis.glb")
    assert find_scan_files("TEEsavR23oF", tmp_path).mesh.name == "TEEsavR23oF.basis.glb"
    touch(tmp_path, "00800-TEEsavR23oF/TEEsavR23oF.glb")
    scanfiles._index.cache_clear()
    assert find_scan_files("TEEsavR23oF", tmp_path).mesh.name == "TEEsavR23oF.glb"


def test_the_archives_of_hm3d_may_be_unpacked_side_by_side(tmp_path: Path) -> None:
    touch(tmp_path, "hm3d-val-glb/00800-TEEsavR23oF/TEEsavR23oF.glb")
    touch(tmp_path, "hm3d-val-semantic-annots/00800-TEEsavR23oF/TEEsavR23oF.semantic.txt")
    found = find_scan_files("TEEsavR23oF", tmp_path)
    assert found.semantic_txt == tmp_path / "hm3d-val-semantic-annots/00800-TEEsavR23oF/TEEsavR23oF.semantic.txt"


@pytest.mark.parametrize("folder", ["", "scans", "v1/tasks/mp3d"])
def test_matterport3d(tmp_path: Path, folder: str) -> None:
    stem = str(Path(folder) / "17DRP5sb8fy" / "17DRP5sb8fy")
    touch(tmp_path, f"{stem}.glb", f"{stem}.house", f"{stem}_semantic.ply", f"{stem}.navmesh")
    found = find_scan_files("17DRP5sb8fy", tmp_path)
    assert found.kind == "mp3d"
    assert (found.house, found.semantic_mesh) == (tmp_path / f"{stem}.house", tmp_path / f"{stem}_semantic.ply")
    assert (found.up, found.front, found.semantic_txt) == ("z", "-y", None)


@pytest.mark.parametrize("suffix", [".glb", ".GLB", ".gltf", ".obj", ".ply"])
def test_any_file_that_is_called_like_the_scan(tmp_path: Path, suffix: str) -> None:
    touch(tmp_path, f"a/b/flat.v2{suffix}")
    found = find_scan_files("flat.v2", tmp_path)
    assert (found.kind, found.up, found.front) == ("file", "y", "+z")
    assert found.mesh == tmp_path / f"a/b/flat.v2{suffix}"


def test_a_file_named_in_the_manifest_brings_the_annotations_beside_it(tmp_path: Path) -> None:
    touch(tmp_path, "x/q.glb", "x/q.house", "x/other.house")
    found = scan_files_of(tmp_path / "x/q.glb")
    assert (found.kind, found.house) == ("mp3d", tmp_path / "x/q.house")


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match=r"unknown scan 'nope': no nope\.glb .* below"):
        find_scan_files("nope", tmp_path)
    with pytest.raises(Avs3dError, match=r"gone is no folder; name the one that holds your scans with --scans"):
        find_scan_files("nope", tmp_path / "gone")
    touch(tmp_path, "00800-nope/nope.semantic.txt")
    with pytest.raises(Avs3dError, match="only its annotations are there"):
        find_scan_files("nope", tmp_path)


def test_two_different_files_of_one_name_are_ambiguous(tmp_path: Path) -> None:
    touch(tmp_path, "a/flat.glb", "b/flat.glb")
    with pytest.raises(Avs3dError, match=r"2 different files are called flat\.glb"):
        find_scan_files("flat", tmp_path)
    (tmp_path / "b/flat.glb").write_bytes((tmp_path / "a/flat.glb").read_bytes())
    assert find_scan_files("flat", tmp_path).mesh == tmp_path / "a/flat.glb"


def test_a_link_in_a_circle_is_followed_once(tmp_path: Path) -> None:
    touch(tmp_path, "a/flat.glb")
    os.symlink(tmp_path, tmp_path / "a" / "again")
    assert find_scan_files("flat", tmp_path).mesh.name == "flat.glb"


def test_a_link_to_itself_and_a_link_to_nowhere_are_passed_over(tmp_path: Path) -> None:
    touch(tmp_path, "a/flat.glb")
    os.symlink("loop", tmp_path / "loop")
    os.symlink("gone", tmp_path / "flat.obj")
    assert find_scan_files("flat", tmp_path).mesh.name == "flat.glb"


def test_a_file_is_read_once_for_its_digest_until_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "big.glb"
    file.write_bytes(b"one")
    read: list[Path] = []
    real = scanfiles.files.sha256_file
    monkeypatch.setattr(scanfiles.files, "sha256_file", lambda path: read.append(path) or real(path))
    first = [digest(file) for _ in range(34)]
    assert len(set(first)) == 1
    assert read == [file]
    file.write_bytes(b"other")
    assert digest(file) != first[0]
    assert len(read) == 2


def test_what_a_mesh_refers_to_is_part_of_the_scan(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib my a.mtl\nv 0 0 0\n")
    (tmp_path / "my a.mtl").write_text("newmtl m\nmap_Kd -s 1 1 1 wall.png\nmap_Kd gone.png\n")
    (tmp_path / "wall.png").write_bytes(b"png")
    (tmp_path / "b.gltf").write_text(
        '{"buffers": [{"uri": "b%201.bin"}], "images": [{"uri": "data:image/png;base64,"}]}'
    )
    (tmp_path / "b 1.bin").write_bytes(b"bin")
    assert [path.name for path in find_scan_files("a", tmp_path).all] == ["a.obj", "my a.mtl", "wall.png"]
    assert [path.name for path in find_scan_files("b", tmp_path).all] == ["b.gltf", "b 1.bin"]


def test_the_texture_that_a_ply_names_is_part_of_the_scan(tmp_path: Path) -> None:
    (tmp_path / "c.ply").write_bytes(b"ply\nformat ascii 1.0\ncomment TextureFile my wall.png\nend_header\n\xff")
    (tmp_path / "my wall.png").write_bytes(b"png")
    assert [path.name for path in find_scan_files("c", tmp_path).all] == ["c.ply", "my wall.png"]


def test_files_of_one_name_in_different_folders_all_count(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text('{"images": [{"uri": "walls/0.png"}, {"uri": "floors/0.png"}]}')
    touch(tmp_path, "walls/0.png", "floors/0.png")
    before = find_scan_files("a", tmp_path).digests()
    assert {"walls/0.png", "floors/0.png"} < set(before)
    for name in ("walls/0.png", "floors/0.png"):
        old = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(b"changed " + old)
        assert find_scan_files("a", tmp_path).digests() != before, name
        (tmp_path / name).write_bytes(old)


# ---- plans --------------------------------------------------------------------------------------------------------


def plan(folder: Path, **scan: object):
    document = {
        "name": "tiny",
        "seed": 1,
        "scans": {"flat": {"source": "scan", **scan}},
        "observations": [{"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "clock"}],
    }
    (folder / "m.yaml").write_text(yaml.safe_dump(document))
    (one,) = make_plans(read_manifest(folder / "m.yaml"), GenerateOptions(audio="analytic"))
    return one


def test_every_file_of_the_scan_decides_the_digests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "scans"
    touch(root, "flat/flat.glb", "flat/flat.house")
    touch(tmp_path, "materials.json")
    monkeypatch.setenv("AVS3D_SCANS", str(root))
    before = plan(tmp_path, materials="materials.json")
    assert before.scan_files.kind == "mp3d"
    assert before.digest
    home = before.home_digest
    for name in ("scans/flat/flat.glb", "scans/flat/flat.house", "materials.json"):
        path = tmp_path / name
        old = path.read_bytes()
        path.write_bytes(old + b" ")
        after = plan(tmp_path, materials="materials.json")
        assert after.digest != before.digest, name
        assert after.home_digest != home, name
        path.write_bytes(old)
        os.utime(path, ns=(1, 1))
        assert plan(tmp_path, materials="materials.json").digest == before.digest


def test_where_the_scan_lies_decides_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    digests = []
    for name in ("here", "there/deeper"):
        touch(tmp_path / name, "flat.glb")
        monkeypatch.setenv("AVS3D_SCANS", str(tmp_path / name))
        one = plan(tmp_path)
        digests.append((one.digest, one.home_digest))
    assert digests[0] == digests[1]


def test_a_missing_scan_is_named_when_it_is_opened_not_before(tmp_path: Path) -> None:
    one = plan(tmp_path)
    assert one.digest
    with pytest.raises(Avs3dError, match="unknown scan 'flat'"):
        _ = one.scan_files
    with pytest.raises(Avs3dError, match=r"m\.json: material file of scan flat not found"):
        _ = plan(tmp_path, materials="m.json").material_file


def test_all_scans_missing_is_one_line_before_anything_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = read_manifest(Path(__file__).parents[2] / "scenes_manifest" / "3davs-s34-o7.yaml")
    root = tmp_path / "scans"
    touch(root, "other.glb")
    monkeypatch.setenv("AVS3D_SCANS", str(root))
    plans = make_plans(source, GenerateOptions(audio="analytic"))
    with pytest.raises(Avs3dError, match="none of the scans") as caught:
        run(source, plans, tmp_path / "out", RunSettings(tmp_path), lambda event: pytest.fail(str(event)))
    message = str(caught.value)
    assert all(scan in message for scan in source.manifest.scans)
    assert str(root) in message
    assert "--scans" in message
    assert "\n" not in message
    assert not (tmp_path / "out").exists()
    # With one of four the others fail one by one, and it goes on.
    touch(root, "wc2JMjhGNzB/wc2JMjhGNzB.glb")
    check_scans(plans)


def test_the_root_may_lie_below_ones_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("AVS3D_SCANS", "~/scans")
    assert scans_root(Path("elsewhere")) == tmp_path / "scans"
