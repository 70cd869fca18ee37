"""The files that come with scans: HM3D's table, Matterport3D's house file, SoundSpaces' materials, KTX2 textures."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from generators.acoustics.materialfile import read_material_file
from generators.acoustics.materials import OCTAVE_BANDS, engine_json, material_for, spectral_label
from generators.assets import gltf
from generators.assets.meshfile import load_mesh
from generators.assets.modelframe import upright
from generators.homes.store import open_home
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from generators.scans.annotations import AnnotatedObject, Annotations, Region, spread_over
from generators.scans.hm3d import read_hm3d, read_table
from generators.scans.mp3d import read_mp3d
from generators.scans.rooms import find_rooms, missing_room
from generators.scans.scan import PLAIN, load_scan
from generators.scans.sound import label_of_category
from tests.support import scan_like

TURN = upright("z", "-y")
#: A square metre on the ground, Z up.
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


# ---- HM3D ---------------------------------------------------------------------------------------------------------


def table(path: Path, *rows: str) -> Path:
    path.write_text("\n".join(["HM3D Semantic Annotations", *rows]) + "\n")
    return path


def test_the_table_of_hm3d(tmp_path: Path) -> None:
    file = table(tmp_path / "a.semantic.txt", '1,FF0080,"Kitchen, old",3', "", "2,00ff00,door,-1")
    assert read_table(file) == [(0xFF0080, "kitchen, old", 3), (0x00FF00, "door", -1)]


def test_names_with_quotes_and_commas_and_lines_of_windows(tmp_path: Path) -> None:
    file = tmp_path / "a.semantic.txt"
    rows = [
        "HM3D Semantic Annotations",
        '1,FF0001,"tv, 32"" wide",0',
        '2,FF0002,"tv 32" wide",1',
        "3,FF0003,lamp, tall,2",
        '4,FF0004,"",3',
        '5,FF0005,"wall"  ,4',
    ]
    file.write_bytes("\r\n".join(rows).encode("utf-8-sig") + b"\r\n")
    names = ['tv, 32" wide', "tv 32 wide", "lamp, tall", "unknown", "wall"]
    assert read_table(file) == [(0xFF0001 + n, name, n) for n, name in enumerate(names)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "does not start with 'HM3D Semantic Annotations'"),
        ("hello\n1,FF0000,wall,0\n", "does not start with"),
        ("HM3D Semantic Annotations\n", "has no objects"),
        ("HM3D Semantic Annotations\n1,FF0000,wall\n", "line 2 is '1,FF0000,wall'; expected id,RRGGBB"),
        ("HM3D Semantic Annotations\n1,GG0000,wall,0\n", "line 2"),
        ("HM3D Semantic Annotations\n1,FF0000,wall,0\n2,FF,door,0\n", "line 3"),
        ("HM3D Semantic Annotations\n1,FF0000,wall,x\n", "line 2"),
        ("HM3D Semantic Annotations\n1,FF0000,wall,99999999999999\n", "line 2"),
        # A quote that is not closed ends with its line.
        ('HM3D Semantic Annotations\n1,FF0000,wall,0\n2,FF0001,"door,0\n' + "3,FF0002,wall,0\n" * 20_000, "line 3"),
    ],
)
def test_a_broken_table_is_named_by_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.semantic.txt").write_text(text)
    with pytest.raises(Avs3dError, match=message) as caught:
        read_table(tmp_path / "a.semantic.txt")
    assert "a.semantic.txt" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("coloured_by", ["texture", "vertices"])
def test_colours_say_which_object_is_where(tmp_path: Path, coloured_by: str) -> None:
    rows = table(tmp_path / "a.semantic.txt", '1,FF0080,"rug",0', '2,00FF00,"floor",0')
    mesh = tmp_path / "a.semantic.glb"
    codes = np.array([[0xFF, 0, 0x80], [0, 0xFF, 0]], dtype=np.uint8)
    if coloured_by == "texture":
        # One face may hold several objects: the left half is the rug.
        image = np.repeat(codes[None].repeat(8, axis=1), 16, axis=0)
        mesh.write_bytes(scan_like.mesh_glb(SQUARE, FACES, uv=SQUARE[:, :2], image=("image/png", scan_like.png(image))))
        split = 0.5
    else:
        mesh.write_bytes(scan_like.mesh_glb(SQUARE, FACES, colours=codes[[0, 1, 1, 0]]))
        split = None
    found = read_hm3d(rows, mesh, TURN)
    assert found.points[:, 1] == pytest.approx(0)
    assert (found.points[:, 2] <= 0).all()
    rug = found.points[found.owner == 0]
    ground = found.points[found.owner == 1]
    assert len(rug)
    assert len(ground)
    if split:
        assert rug[:, 0].max() < split < ground[:, 0].min()
        assert [found.objects[k].category for k in found.owners(np.array([[0.2, 0.0, -0.5], [0.8, 0.1, -0.5]]))] == [
            "rug",
            "floor",
        ]
        assert found.owners(np.array([[0.2, 2.0, -0.5]]))[0] == -1


def test_the_box_of_a_region_is_its_inside(tmp_path: Path) -> None:
    # A floor of 1 m², a lamp that stands on it, a wall seen through a door, 5 m away.
    rows = ['1,0000FF,"floor",4', '2,00FF00,"floor lamp",4', '3,FF0000,"wall /other room",4']
    lamp = SQUARE[:, [0, 2, 1]] * [0.1, 1, 1.8] + [0.5, 0.5, 0]
    vertices = np.concatenate([SQUARE, lamp, SQUARE + [5, 0, 0]])
    colours = np.repeat(np.array([[0, 0, 255], [0, 255, 0], [255, 0, 0]], dtype=np.uint8), 4, axis=0)
    mesh = tmp_path / "a.semantic.glb"
    mesh.write_bytes(scan_like.mesh_glb(vertices, np.concatenate([FACES, FACES + 4, FACES + 8]), colours=colours))
    (region,) = read_hm3d(table(tmp_path / "a.semantic.txt", *rows), mesh, TURN).regions
    assert region.index == 4
    assert region.box == pytest.approx(np.array([[0, 0, -1], [1, 1.8, 0]]), abs=0.15)
    assert region.box[0, 1] == pytest.approx(0, abs=1e-6)


def test_a_mesh_of_another_scan_is_noticed(tmp_path: Path) -> None:
    rows = table(tmp_path / "a.semantic.txt", '1,123456,"rug",0')
    mesh = tmp_path / "a.semantic.glb"
    mesh.write_bytes(scan_like.mesh_glb(SQUARE, FACES, colours=np.full((4, 3), 9, np.uint8)))
    with pytest.raises(Avs3dError, match=r"none of its colours stands in a\.semantic\.txt"):
        read_hm3d(rows, mesh, TURN)


def test_points_are_spread_evenly_and_once_per_small_face() -> None:
    triangles = np.stack([SQUARE[FACES[0]], 0.01 * SQUARE[FACES[1]]])
    weight, face, points = spread_over(triangles, 0.1, 400)
    assert weight.sum(axis=1) == pytest.approx(1)
    assert (weight > 0).all()
    assert (face == 0).sum() == 64
    assert (face == 1).sum() == 1
    # The mean of the sub-triangles' centres is the centre.
    assert points[face == 0].mean(axis=0) == pytest.approx(triangles[0].mean(axis=0))


# ---- Matterport3D -------------------------------------------------------------------------------------------------

HOUSE = """ASCII 1.1
H x - 1 1 0 0 0 2 2 2 0 1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0
L 0 2 - 0 0 0 0 0 0 9 9 3 0 0 0 0 0
R 0 0 0 0 a  1 1 1  0 0 0  2 3 2.5  2.5 0 0 0 0
R 1 0 0 0 k  4 4 1  2 0 0  7 4 2.5  2.5 0 0 0 0
C 0 7 shower#curtain 12 curtain 0 0 0 0 0
C 1 9 toilet 18 toilet 0 0 0 0 0
O 4 0 1  1 2 0.4  0 1 0  0 0 1  0.2 0.4 0.3  0 0 0 0 0 0 0 0
O 9 1 0  5 3 1.0  0.8 0.6 0  -0.6 0.8 0  1.0 0.1 1.0  0 0 0 0 0 0 0 0
"""


def test_the_house_file_of_matterport3d(tmp_path: Path) -> None:
    (tmp_path / "x.house").write_text(HOUSE)
    found = read_mp3d(tmp_path / "x.house", None, TURN)
    toilet, curtain = found.objects
    assert (toilet.category, toilet.group, toilet.region) == ("toilet", "toilet", 0)
    assert curtain.words == {"shower curtain", "curtain"}
    # (x, y, z) → (x, z, −y); the box's axes come in any order.
    assert toilet.centre == pytest.approx([1, 0.4, -2])
    assert toilet.bounds == pytest.approx(np.array([[0.7, 0.0, -2.2], [1.3, 0.8, -1.8]]))
    assert found.regions[1].label == "k"
    assert found.regions[1].box == pytest.approx(np.array([[2, 0, -4], [7, 2.5, 0]]))
    # A turned box holds what lies along its own axis.
    along = curtain.centre + 0.9 * np.array([0.8, 0, -0.6])
    across = curtain.centre + 0.5 * np.array([0.6, 0, 0.8])
    assert found.owners(np.stack([along, across, toilet.centre])).tolist() == [1, -1, 0]


@pytest.mark.parametrize("name", ["object_id", "face_segment"])
def test_the_mesh_with_object_ids_decides_where_it_lies_beside(tmp_path: Path, name: str) -> None:
    (tmp_path / "x.house").write_text(HOUSE)
    properties = "\n".join(f"property float {axis}" for axis in "xyz")
    head = (
        f"ply\nformat ascii 1.0\nelement vertex 4\n{properties}\nelement face 2\n"
        f"property list uchar int vertex_indices\nproperty int {name}\nend_header\n"
    )
    body = "\n".join(" ".join(map(str, v)) for v in SQUARE) + "\n3 0 1 2 9\n3 0 2 3 77\n"
    (tmp_path / "x_semantic.ply").write_text(head + body)
    found = read_mp3d(tmp_path / "x.house", tmp_path / "x_semantic.ply", TURN)
    assert found.points == pytest.approx(np.array([[2 / 3, 0, -1 / 3]]))
    assert found.objects[int(found.owner[0])].category == "shower curtain"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing\n", "does not start with 'ASCII'"),
        ("ASCII 1.1\nH x\n", "neither regions nor objects"),
        ("ASCII 1.1\nR 0 0 0 0 a 1 1\n", "line 2 .* is no record R"),
        (HOUSE.replace("O 4 0 1  1 2", "O 4 0 1  one 2"), "line 8"),
    ],
)
def test_a_broken_house_file_is_named_by_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.house").write_text(text)
    with pytest.raises(Avs3dError, match=message) as caught:
        read_mp3d(tmp_path / "x.house", None, TURN)
    assert "\n" not in str(caught.value)


# ---- rooms --------------------------------------------------------------------------------------------------------


def room(index: int, label: str = "", size: tuple[float, float] = (3.0, 3.0)) -> Region:
    low = np.array([10.0 * index, 0.0, 0.0])
    return Region(index, label, np.stack([low, low + [size[0], 2.5, size[1]]]))


def things(region: int, *words: str) -> list[AnnotatedObject]:
    return [AnnotatedObject(word, region) for word in words]


def found(regions: list[Region], objects: list[AnnotatedObject]) -> dict[str, int]:
    boxes = find_rooms(Annotations(Path("x"), tuple(objects), tuple(regions)))
    return {name: int(box[0, 0] // 10) for name, box in boxes.items()}


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("toilet",), "bathroom"),
        (("oven",), "kitchen"),
        (("oven and stove",), "kitchen"),
        (("sink", "refrigerator"), "kitchen"),
        (("couch", "tv"), "living_room"),
        (("sofa", "television"), "living_room"),
    ],
)
def test_objects_make_a_room(words: tuple[str, ...], name: str) -> None:
    assert found([room(0)], things(0, *words)) == {name: 0}


@pytest.mark.parametrize(
    "words", [("sink",), ("sofa",), ("tv",), ("toilet paper", "toilet brush"), ("tv stand", "sofa")]
)
def test_and_others_do_not(words: tuple[str, ...]) -> None:
    assert found([room(0)], things(0, *words)) == {}


def test_labels_come_first_and_the_larger_of_two_wins() -> None:
    regions = [room(0, "b"), room(1, "a", (2, 2)), room(2, "a", (3, 3)), room(3, "t", (4, 4)), room(4, "f")]
    assert found(regions, things(0, "toilet", "oven")) == {"bathroom": 2, "living_room": 4}
    assert found([room(0, "t"), room(1, "n"), room(2, "l", (2, 2))], []) == {"bathroom": 0, "living_room": 2}
    assert found([room(0, "a", (0.6, 4.0))], []) == {}


def test_an_open_plan_is_two_rooms_only_where_there_is_no_other() -> None:
    objects = things(0, "oven", "couch", "tv") + things(1, "couch", "tv")
    assert found([room(0, size=(6, 6)), room(1)], objects) == {"kitchen": 0, "living_room": 1}
    assert found([room(0)], objects[:3]) == {"kitchen": 0, "living_room": 0}


def test_the_line_for_a_missing_room() -> None:
    nothing = Annotations(Path("x.house"), (), (room(0, "b"),))
    message = str(missing_room("x", "kitchen", ["bathroom"], nothing))
    assert message.startswith("scan x: no room 'kitchen'; it has bathroom by the manifest, none by x.house (1 regions")
    assert "labelled b" in message
    assert "scans.x.rooms.kitchen" in message


# ---- materials ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "label"),
    [
        (["wall"], "plaster"),
        (["white kitchen cabinet"], "wood"),
        (["sofa chair"], "upholstery"),
        (["shower curtain", "curtain"], "fabric"),
        (["unknown thing", "sofa"], "upholstery"),
        (["bathroom floor"], "tile"),
        (["floor"], "floor"),
        (["floor /other room"], "floor"),
        (["floor lamp"], "metal"),
        (["unknown"], None),
    ],
)
def test_categories_have_labels(words: list[str], label: str | None) -> None:
    assert label_of_category(words) == label


def write_materials(path: Path, *entries: object) -> Path:
    path.write_text(json.dumps({"materials": list(entries)}))
    return path


def test_soundspaces_material_file(tmp_path: Path) -> None:
    file = write_materials(
        tmp_path / "m.json",
        {"name": "Carpet", "labels": ["rug", "Carpet"], "absorption": [125, 0.1, 2000, 0.5], "scattering": [1000, 0.3]},
        {"name": "wall", "labels": ["wall", "kitchen_wall"], "absorption": [500, 0.2], "density": 3},
        {"name": "rest", "labels": ["default"], "absorption": [1000, 0.05]},
    )
    found = read_material_file(file)
    carpet = material_for(found.label_for(["carpet"]) or "")
    # Linear over the logarithm of frequency: four octaves from 0.1 to 0.5; constant beyond.
    assert carpet.in_situ == pytest.approx((0.1, 0.2, 0.3, 0.4, 0.5, 0.5))
    assert carpet.scattering == pytest.approx((0.3,) * 6)
    assert found.label_for(["unknown", "dirty rug"]) == found.label_for(["rug"])
    assert found.label_for(["old kitchen wall"]) == found.label_for(["kitchen wall"])
    assert found.label_for(["wallet"]) == found.default != found.label_for(["wall"])


def test_labels_with_coefficients_stay_apart_in_the_engine() -> None:
    one = spectral_label((0.1,) * 6, (0.2,) * 6)
    other = spectral_label((0.1,) * 5 + (0.1001,), (0.2,) * 6)
    assert len(one) == len(other)
    assert one != other
    document = json.loads(engine_json([material_for(one), material_for("carpet")]))
    assert [entry["labels"][0] for entry in document["materials"]] == [one, "carpet"]
    assert document["materials"][0]["absorption"][1::2] == pytest.approx([0.1] * 6)
    assert len(document["materials"][0]["absorption"]) == 2 * len(OCTAVE_BANDS)
    assert material_for("given:0.1/0.2").label == "default"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read as JSON"),
        ("[]", "has no materials"),
        ('{"materials": []}', "has no materials"),
        ('{"materials": [3]}', r"materials\[0\]: is 3"),
        ('{"materials": [{"name": "x", "absorption": [1, 0.5]}]}', r"materials\[0\] \(x\): labels is None"),
        ('{"materials": [{"name": "x", "labels": ["a"]}]}', "has no absorption"),
        ('{"materials": [{"labels": ["a"], "absorption": [1, 0.5, 2]}]}', "expected pairs"),
        ('{"materials": [{"labels": ["a"], "absorption": [1, true]}]}', "expected pairs"),
        ('{"materials": [{"labels": ["a"], "absorption": [1, NaN]}]}', "expected pairs"),
        ('{"materials": [{"labels": ["a"], "absorption": [1' + "0" * 400 + ", 0.1]}]}", "expected pairs"),
        ('{"materials": [{"labels": ["a"], "absorption": [2, 0.5, 1, 0.5]}]}', "that ascend"),
        ('{"materials": [{"labels": ["a"], "absorption": [1, 1.5]}]}', r"values in \[0, 1\]"),
    ],
)
def test_a_bad_material_file_is_one_clear_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(Avs3dError, match=message) as caught:
        read_material_file(tmp_path / "m.json")
    assert "m.json" in str(caught.value)
    assert "\n" not in str(caught.value)


# ---- compressed files ---------------------------------------------------------------------------------------------

#: 4 × 4 pixels of sRGB (200, 40, 40), ETC1S in KTX2.
KTX2 = base64.b64decode(
    "q0tUWCAyMLsNChoKAAAAAAEAAAAEAAAABAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAACwAAACUAAAAJAAAALgAAAAAAAAAgQAAAAAAAAA5AQAA"
    "AAAAAAEAAAAAAAAAAAAAAAAAAAAsAAAAAAAAAAIAKACjAQIAAwMAAAgAAAAAAAAAAAA/AAAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMg"
    "VW5pdmVyc2FsIDIuMTAAAAEAAQApAAAABQAAACsAAAAAAAAAAAAAAAAAAAABAAAAAAAAAAAAAAABwAQAAAAAAADiApgSAAAAAABAsgMCgAkAAAAA"
    "AABEADABAAAAAACAwAQAAAAAAMFEAAAAAAAA8l8tAJgAAAAAAABACAATAAIAAAAAiAHABAAAAAAAAAIIAAA="
)
needs_decoder = pytest.mark.skipif(not gltf.can_decode_basis(), reason="opengl_basisu is not installed (extra basis)")


@pytest.fixture
def basis(tmp_path: Path) -> Path:
    file = tmp_path / "00001-abc" / "abc.basis.glb"
    file.parent.mkdir()
    uv = SQUARE[:, :2]
    file.write_bytes(scan_like.mesh_glb(4 * SQUARE, FACES, uv=uv, image=("image/ktx2", KTX2), basisu=True))
    return file


@needs_decoder
def test_ktx2_textures_are_decoded_where_a_decoder_is_installed(basis: Path) -> None:
    (material,) = load_mesh(basis).materials
    assert material.texture is not None
    assert material.texture.pixels.reshape(-1, 3).mean(axis=0) == pytest.approx([200, 40, 40], abs=3)


@needs_decoder
def test_a_broken_ktx2_image_is_named(tmp_path: Path) -> None:
    file = tmp_path / "bad.glb"
    bad = KTX2[:60] + b"\xff" * 40 + KTX2[100:]
    file.write_bytes(scan_like.mesh_glb(SQUARE, FACES, uv=SQUARE[:, :2], image=("image/ktx2", bad), basisu=True))
    with pytest.raises(Avs3dError, match=r"bad\.glb: KTX2 image 0 cannot be decoded"):
        load_mesh(file)


def test_without_a_decoder_colour_is_refused_with_ways_out(basis: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "can_decode_basis", lambda: False)
    with pytest.raises(Avs3dError, match="KTX2") as caught:
        load_mesh(basis)
    message = str(caught.value)
    assert "ktxdecompress abc.basis.glb abc.glb" in message
    assert "--vision habitat" in message
    assert "\n" not in message


def test_the_geometry_of_a_basis_file_needs_no_decoder(basis: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "can_decode_basis", lambda: False)
    box = [[0.0, -0.2, -4.0], [4.0, 2.5, 0.0]]
    scan = load_scan("abc", basis.parent.parent, {"kitchen": box}, textures=False)
    (material,) = scan.parts[0].mesh.materials
    assert (material.texture, material.colour) == (None, PLAIN)
    assert scan.parts[0].mesh.bounds.tolist() == [[0, 0, -4], [4, 0, 0]]
    assert scan.stage is not None
    assert scan.stage.path == basis


def test_habitat_decodes_them_itself_embree_cannot(basis: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "can_decode_basis", lambda: False)
    monkeypatch.setenv("AVS3D_SCANS", str(basis.parent.parent))
    manifest = basis.parent.parent / "m.yaml"
    manifest.write_text(
        "{name: tiny, seed: 1, scans: {abc: {source: scan, rooms: {kitchen: [[0, -0.2, -4], [4, 2.5, 0]]}}},"
        " observations: [{part: part_1, scan: abc, room: kitchen, index: 1, category: clock}]}"
    )
    (plan,) = make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))
    home = open_home(replace(plan, options=replace(plan.options, vision="habitat")), basis.parent)
    assert home.stage is not None
    assert (home.stage.path, home.stage.up, home.stage.front) == (basis, "z", "-y")
    with pytest.raises(Avs3dError, match="KTX2"):
        open_home(plan, basis.parent)


@pytest.mark.parametrize(
    ("extension", "name"),
    [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshopt")],
)
def test_compressed_geometry_is_refused_with_the_command_that_unpacks_it(
    tmp_path: Path, extension: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gltf, "can_decode_draco", lambda: False)
    file = tmp_path / "small.glb"
    file.write_bytes(scan_like.glb({"extensionsUsed": [extension], "meshes": []}, [b"data"]))
    with pytest.raises(Avs3dError, match=f"compressed with {name}") as caught:
        load_mesh(file)
    assert "gltf-transform/cli copy small.glb small.plain.glb" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ['{"images": 3}', '{"textures": [null]}', '{"extensionsUsed": null}', "[" * 99_999])
def test_a_document_that_is_no_gltf_is_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "odd.glb"
    body = text.encode()
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(body)) + struct.pack("<I4s", len(body), b"JSON")
    file.write_bytes(head + body)
    with pytest.raises(Avs3dError, match=r"odd\.glb: cannot be read as glb") as caught:
        load_mesh(file)
    assert "\n" not in str(caught.value)


def test_a_face_of_a_vertex_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "odd.glb"
    file.write_bytes(scan_like.mesh_glb(SQUARE, FACES + 2))
    with pytest.raises(Avs3dError, match=r"odd\.glb: faces of .* refer to vertex 5, it has 4"):
        load_mesh(file)
