"""`avs3d scan`: a manifest that generates at once, the page beside it, and one line for what it refuses."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from avs3d_bench.cli import main
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import write_gaussians
from generators.assets.meshfile import load_mesh
from generators.core.boxes import yaw_matrix
from generators.core.scene import Scene
from generators.homes.store import open_home
from generators.manifest.reading import read_manifest
from generators.manifest.schema import ScanSpec
from generators.options import GenerateOptions
from generators.plan import make_plans
from generators.surveying.document import relative_name
from generators.surveying.fitting import ScanFitting
from generators.surveying.page import rows_of
from generators.surveying.unpacking import unpacked
from tests.support import browser
from tests.support.captured import gaussians
from tests.support.made_rooms import ROOMS, flat, write_mesh
from tests.support.scan_like import png


def scan(*words: object) -> int:
    """Exit code of ``avs3d scan``."""
    with pytest.raises(SystemExit) as end:
        main(["scan", *map(str, words)])
    return int(end.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A living room, scanned in millimetres with Z up and turned by 23°, and what `avs3d scan` writes for it."""
    place = tmp_path_factory.mktemp("scan")
    (place / "phone").mkdir()
    room = flat(("living_room",), rng=np.random.default_rng(1)) @ yaw_matrix(np.radians(23)).T
    z_up = np.stack([room[..., 0], -room[..., 2], room[..., 1]], axis=-1) * 1000
    vertices = z_up.reshape(-1, 3)
    colours = np.full((len(vertices), 4), (150, 120, 90, 255), dtype=np.uint8)
    colours[::3, 0] = 200
    faces = np.arange(len(vertices)).reshape(-1, 3)
    trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False).export(place / "phone" / "room.ply")
    assert scan(place / "phone" / "room.ply", "-o", place / "my_room.yaml", "--licence", "CC0 1.0", "Ann") == 0
    return place


@pytest.mark.slow
def test_the_manifest_says_what_was_found_and_how(folder: Path) -> None:
    text = (folder / "my_room.yaml").read_text()
    spec = read_manifest(folder / "my_room.yaml").manifest.scans["my_room"]
    assert (spec.file, spec.up, spec.front, spec.scale) == ("phone/room.ply", "z", "-y", 0.001)
    assert spec.turn is not None
    assert min(abs(spec.turn + 23 - 90 * k) for k in range(-2, 3)) < 1.0
    assert spec.licence is not None
    assert (spec.licence.name, spec.licence.author) == ("CC0 1.0", "Ann")
    for field in ("up", "turn", "scale", "living_room"):
        (line,) = (line for line in text.splitlines() if line.strip().startswith(f"{field}:"))
        assert "  # " in line, f"{field} does not say how it was found"


@pytest.mark.slow
def test_the_home_lies_as_the_manifest_says(folder: Path) -> None:
    plans = make_plans(read_manifest(folder / "my_room.yaml"), GenerateOptions(audio="analytic"))
    home = open_home(plans[0], folder / "cache")
    room = home.room("living_room")
    size = np.sort(np.subtract(room.high, room.low))
    assert size == pytest.approx(sorted(np.subtract(*reversed(ROOMS["living_room"]))), abs=0.05)
    # A table of 1.2 × 0.7 m is found only where its sides are parallel to the axes.
    (table,) = (support for support in home.supports if support.kind == "side_table")
    assert np.prod([np.linalg.norm(table.u), np.linalg.norm(table.v)]) == pytest.approx(1.2 * 0.7, abs=0.2)
    assert table.origin[1] - room.low[1] == pytest.approx(0.55, abs=0.02)


@pytest.mark.slow
def test_every_part_is_in_the_manifest_with_voices_of_the_test_split(folder: Path) -> None:
    manifest = read_manifest(folder / "my_room.yaml").manifest
    assert {entry.part for entry in manifest.observations} == {"part_1", "part_2", "part_3"}
    heard = {name for entry in manifest.observations for name in entry.heard}
    assert heard <= set(manifest.voices)
    assert len(manifest.observations) >= 5


@pytest.mark.slow
def test_it_generates_at_once(folder: Path) -> None:
    words = ["generate", folder / "my_room.yaml", "-o", folder / "data", "--frames", 4, "--size", 64]
    with pytest.raises(SystemExit) as end:
        main([*map(str, words), "--audio", "analytic", "--workers", "1", "--cache", str(folder / "cache")])
    assert not end.value.code
    keys = {entry.key for entry in read_manifest(folder / "my_room.yaml").manifest.observations}
    assert all((folder / "data" / key / "observation.json").is_file() for key in keys)


@pytest.mark.slow
def test_the_same_scan_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "phone").symlink_to(folder / "phone")
    words = [folder / "phone" / "room.ply", "-o", folder / "again.yaml", "--licence", "CC0 1.0", "Ann"]
    assert scan(*words, "--name", "my_room") == 0
    assert (folder / "again.yaml").read_bytes() == (folder / "my_room.yaml").read_bytes()
    page = (folder / "again.html").read_bytes().replace(b"again.yaml -o again", b"my_room.yaml -o my_room")
    assert (
        page.replace(b"view again", b"view my_room").split(b"<h2>Next")[0]
        == ((folder / "my_room.html").read_bytes().split(b"<h2>Next")[0])
    )


def test_another_index_is_tried_where_objects_find_no_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Places are drawn by the key: else the name of the file would decide what a room has."""

    def fault(_: ScanFitting, entry: dict[str, Any]) -> str:
        return "no place" if entry["part"] != "part_1" and entry["index"] == 1 else ""

    monkeypatch.setattr(ScanFitting, "fault", fault)
    home = Scene("mine", (), (), ())
    found = ScanFitting(home, {"scans": {"mine": {}}}, Path()).observations(("kitchen",)).entries
    assert [entry["index"] for entry in found if entry["part"] == "part_2"] == [2, 3, 4]


@pytest.mark.slow
def test_the_page_is_one_file(folder: Path) -> None:
    page = (folder / "my_room.html").read_text()
    assert page.count("data:image/jpeg") == 5, "the plan and four pictures"
    assert "http" not in page.replace("http-equiv", "")
    for text in (
        "What was guessed",
        "--rooms N",
        "--scale METRES",
        "avs3d generate",
        "Rooms",
        "How it sounds",
        "plaster",
    ):
        assert text in page


@pytest.mark.slow
def test_the_page_opens_without_a_complaint(folder: Path) -> None:
    with browser.launch() as chromium:
        for width in (360, 1280):
            with browser.visit(chromium, folder / "my_room.html", width=width) as visit:
                assert not visit.said
                assert not visit.asked
                assert visit.overflow <= 0


@pytest.mark.slow
def test_a_page_alone_is_written_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that found no place for anything, or was interrupted, leaves a page; it holds no work of the user."""
    (folder / "late.html").write_bytes((folder / "my_room.html").read_bytes())
    assert scan(folder / "phone" / "room.ply", "-o", folder / "late.yaml", "--material", "wall=brick") == 0
    assert "living_room: reverberation time 0." in capsys.readouterr().out
    assert read_manifest(folder / "late.yaml").manifest.scans["late"].surfaces == {"wall": "brick"}
    assert "<td>brick</td>" in (folder / "late.html").read_text()


@pytest.mark.slow
def test_nothing_is_replaced_without_a_word(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "my_room.yaml").read_bytes()
    assert scan(folder / "phone" / "room.ply", "-o", folder / "my_room.yaml") == 2
    assert "add --replace" in capsys.readouterr().err
    (folder / "own.html").write_text("mine")
    assert scan(folder / "phone" / "room.ply", "-o", folder / "own.yaml", "--replace") == 2
    assert "this command has not written it" in capsys.readouterr().err
    assert (folder / "own.html").read_text() == "mine"
    assert not (folder / "own.yaml").exists()
    assert (folder / "my_room.yaml").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["missing.glb"], "does not exist; expected a mesh"),
        (["notes.txt"], "unknown kind of mesh '.txt'; expected one of .glb"),
        (["room.usdz"], "export the scan as GLB"),
        ([""], "is a folder; expected a mesh"),
        (["broken.glb"], "broken.glb"),
        (["grey.glb"], "has no colours; expected a texture or vertex colours"),
        (["room.glb", "--rooms", "cellar"], "unknown room 'cellar'"),
        (["room.glb", "--rooms", "99"], "--rooms 99: expected 1 to 50 rooms"),
        (["room.glb", "--rooms", "kitchen,kitchen"], "kitchen is listed twice"),
        (["room.glb", "--rooms", "kitchen=2,bathroom=2"], "room 2 has two names"),
        (["room.glb", "--rooms", "kitchen=5"], "found 1 rooms by size"),
        (["room.glb", "--scale", "0.01"], "expected a floor of at least 2 m²"),
        (["room.glb", "--scale", "50"], "from floor to ceiling there are then 125 m, expected at most 15: --scale 1 "),
        (["room.glb", "--material", "wall"], "--material wall: expected PLACE=NAME"),
        (["room.glb", "--material", "wall=brik"], "unknown acoustic material 'brik'"),
        (["room.glb", "--material", "wal=brick"], "unknown place 'wal'"),
        (["room.glb", "--up", "x"], "units of the file; expected 1.9 to 4.5 m"),
        (["room.glb", "--front", "x"], "--front needs --up"),
        (["room.glb", "--up", "y", "--front", "-y"], "perpendicular"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_one_line_for_what_is_refused(
    words: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(flat(("living_room",)), tmp_path / "room.glb")
    write_mesh(flat(("living_room",)), tmp_path / "grey.glb", coloured=False)
    (tmp_path / "notes.txt").write_text("a room")
    (tmp_path / "room.usdz").write_bytes(b"PK")
    (tmp_path / "broken.glb").write_bytes((tmp_path / "room.glb").read_bytes()[:1000])
    assert scan(tmp_path / words[0], *words[1:], "-o", tmp_path / "out.yaml") != 0
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert line in said[0]
    assert not list(tmp_path.glob("out.*")), "something half-written is left"


def zipped(target: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return target


def test_a_zip_of_an_app_is_unpacked_once(tmp_path: Path) -> None:
    """An OBJ with its MTL and picture in a folder, and what macOS adds."""
    corners = "".join(f"v {x} 0 {z}\nvt {x} {z}\n" for x, z in ((0, 0), (1, 0), (0, 1)))
    members = {
        "my scan/textured.obj": f"mtllib textured.mtl\nusemtl a\n{corners}f 1/1 2/2 3/3\n".encode(),
        "my scan/textured.mtl": b"newmtl a\nmap_Kd textured.png\n",
        "my scan/textured.png": png(np.full((4, 4, 3), 90, dtype=np.uint8)),
        "__MACOSX/my scan/._textured.obj": b"attributes",
    }
    room, place = zipped(tmp_path / "room.zip", members), tmp_path / "new" / "room.scan"
    for _ in range(2):
        with unpacked(room, place) as mesh:
            assert mesh == place / "my scan" / "textured.obj"
            assert load_mesh(mesh).materials[0].texture is not None
    (place / "notes.txt").write_text("mine")
    with pytest.raises(Avs3dError, match=r"room\.scan: holds something else than"), unpacked(room, place):
        pass
    assert (place / "notes.txt").read_text() == "mine"
    assert list(place.parent.iterdir()) == [place]


@pytest.mark.parametrize(
    ("members", "line"),
    [
        ({"a.usdz": b"PK", "b.jpg": b""}, "holds no mesh (.glb, .gltf, .obj, .ply), only .jpg, .usdz"),
        ({"a.obj": b"v 0 0 0", "b/c.obj": b"v 0 0 0"}, "holds 2 meshes ('a.obj', 'b/c.obj'); expected one"),
        ({"a.obj": b"mtllib a.mtl\n"}, "its material library 'a.mtl' is missing"),
        ({"../a.obj": b""}, "points outside of it"),
        ({"a.obj": b"0" * 20_000_000}, "times its size"),
        ({}, "the archive is empty"),
    ],
    ids=["no mesh", "two meshes", "no library", "outside", "bomb", "empty"],
)
def test_a_zip_that_holds_no_scan_is_one_line_and_leaves_nothing(
    members: dict[str, bytes], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room = zipped(tmp_path / "room.zip", members)
    assert scan(room, "-o", tmp_path / "out.yaml") != 0
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert line in said[0]
    assert list(tmp_path.iterdir()) == [room]


def test_turn_and_scale_count_in_a_digest_only_where_they_are_set() -> None:
    plain = ScanSpec(source="scan")
    assert not {"turn", "scale"} & plain.identity().keys()
    assert ScanSpec(source="scan", turn=3.0).identity()["turn"] == 3.0
    with pytest.raises(ValueError, match="an apartment has no turn: only a scan has"):
        ScanSpec(source="apartment", seed=1, turn=3.0)


def test_the_file_is_named_from_where_it_is_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest, file = tmp_path / "lab" / "room.yaml", tmp_path / "phone" / "room.glb"
    monkeypatch.delenv("AVS3D_SCANS", raising=False)
    assert relative_name(file, manifest) == "../phone/room.glb"
    monkeypatch.setenv("AVS3D_SCANS", str(tmp_path / "phone"))
    assert relative_name(file, manifest) == "room.glb"
    monkeypatch.setenv("AVS3D_SCANS", str(tmp_path / "elsewhere"))
    assert relative_name(file, manifest) == file.resolve().as_posix()


def test_rows_cover_their_cells() -> None:
    cells = np.array([[0.025, 0.025], [0.025, 0.075], [0.025, 0.175], [0.075, 0.025]])
    rows = rows_of(cells)
    assert [(round(r.x, 3), round(r.z, 3), round(r.depth, 3)) for r in rows] == [
        (0.0, 0.0, 0.1), (0.0, 0.15, 0.05), (0.05, 0.0, 0.05),
    ]  # fmt: skip


@pytest.mark.slow
def test_splats_of_the_same_place_are_named_and_others_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room = write_mesh(flat(("living_room",)), tmp_path / "room.glb")
    corners = load_mesh(room, acoustic="plaster").positions.reshape(-1, 3).astype(np.float64)
    write_gaussians(tmp_path / "room.ply", gaussians(corners, 0.05, 0.9))
    write_gaussians(tmp_path / "other.ply", gaussians(corners + [20.0, 0.0, 0.0], 0.05, 0.9))
    assert scan(room, "-o", tmp_path / "other.yaml", "--splats", tmp_path / "other.ply") != 0
    assert "expected both in one frame" in capsys.readouterr().err
    assert not list(tmp_path.glob("other.[yh]*"))
    assert scan(room, "-o", tmp_path / "out.yaml", "--splats", tmp_path / "room.ply") == 0
    assert "--vision splats" in next(x for x in capsys.readouterr().out.splitlines() if x.startswith("next: "))
    assert read_manifest(tmp_path / "out.yaml").manifest.scans["out"].splats == "room.ply"
    assert "--splats" in (tmp_path / "out.yaml").read_text().splitlines()[0]


def test_an_output_that_cannot_be_written_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").write_text("a file where a folder is expected")
    assert scan(tmp_path / "missing.glb", "-o", tmp_path / "taken" / "out.yaml") != 0
    assert "taken" in capsys.readouterr().err
