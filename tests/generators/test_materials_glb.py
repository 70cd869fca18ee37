"""A scene as glTF with its materials: trimesh, which is not ours, finds them; our own reader gets them back."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from avs3d_bench.errors import Avs3dError
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Scene, StageFile, Texture
from generators.vision.materials_glb import write_materials_glb

SQUARE = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]


def noise(seed: int, *, side: int = 16) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (side, side, 3), dtype=np.uint8)


TILE = Material(
    "tile",
    "tile",
    (0.8, 0.6, 0.4),
    Texture("tile", noise(1)),
    roughness=0.75,
    metallic=0.5,
    normal_map=Texture("n", noise(2, side=8)),  # maps may have another size
    roughness_map=Texture("r", noise(3, side=32)),
    clearcoat=0.25,
)
LAMP = Material("lamp", "glass", (1.0, 1.0, 1.0), emission=(12.0, 9.0, 6.0), roughness=0.2, transmission=0.5)


def square(material: Material) -> Part:
    return Part(material.name, MeshBuilder().quad(SQUARE, material, fit=True).build())


def document(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    found: dict[str, Any] = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    return found


def test_a_reader_of_others_finds_factors_and_maps(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    write_materials_glb(Scene("s", (square(TILE),), (), ()), path)
    material = next(iter(trimesh.load_scene(path).geometry.values())).visual.material
    assert material.name == "tile"
    assert material.roughnessFactor == pytest.approx(0.75)
    assert material.metallicFactor == pytest.approx(0.5)
    assert np.array_equal(np.asarray(material.baseColorTexture.convert("RGB")), noise(1))
    assert np.array_equal(np.asarray(material.normalTexture.convert("RGB")), noise(2, side=8))
    assert np.array_equal(np.asarray(material.metallicRoughnessTexture.convert("RGB")), noise(3, side=32))


def test_all_of_a_material_survives_the_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    scene = Scene("s", (square(TILE), square(LAMP)), (), ())
    write_materials_glb(scene, path)
    back = {material.name: material for material in load_mesh(path).materials}
    assert set(back) == {"tile", "lamp"}
    for expected in (TILE, LAMP):
        found = back[expected.name]
        for name in ("roughness", "metallic", "transmission", "clearcoat", "emission"):
            assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-4), name
        assert found.colour == pytest.approx(expected.colour, abs=0.5 / 255)
        for name in ("texture", "normal_map", "roughness_map"):
            one, two = getattr(found, name), getattr(expected, name)
            assert (one is None) == (two is None), name
            assert one is None or np.array_equal(one.pixels, two.pixels), name
    first = path.read_bytes()
    write_materials_glb(scene, path)
    assert path.read_bytes() == first


def test_textures_that_materials_share_are_written_once_and_scans_are_unlit(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    other = Material("other", "tile", texture=TILE.texture)
    write_materials_glb(Scene("s", (square(TILE), square(other)), (), (), stage=StageFile(tmp_path / "x.glb")), path)
    tree = document(path)
    assert len(tree["images"]) == 1
    assert all("KHR_materials_unlit" in material["extensions"] for material in tree["materials"])
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]
    assert all(material.roughness == 1.0 and material.metallic == 0.0 for material in load_mesh(path).materials)


def test_a_scene_without_faces_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Avs3dError, match="no faces"):
        write_materials_glb(Scene("s", (), (), ()), tmp_path / "a.glb")


# ---- what users' files may hold -------------------------------------------------------------------------------------


def rewrite(path: Path, tree: dict[str, Any]) -> None:
    """Put another JSON into a GLB."""
    data = path.read_bytes()
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + struct.unpack_from("<I", data, 12)[0] :]
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + rest
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def changed(tmp_path: Path, **changes: Any) -> Path:
    """`TILE` on a square in a file whose first material has some of its JSON replaced."""
    path = tmp_path / "a.glb"
    write_materials_glb(Scene("s", (square(TILE),), (), ()), path)
    tree = document(path)
    tree |= changes.pop("tree", {})
    tree["materials"][0]["pbrMetallicRoughness"] |= changes.pop("surface", {})
    tree["materials"][0] |= changes
    rewrite(path, tree)
    return path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"surface": {"roughnessFactor": float("nan")}},
            "'tile': its roughnessFactor is nan; expected a number",
        ),
        ({"surface": {"metallicFactor": 1.5}}, "its metallicFactor is 1.5; expected a number from 0 to 1"),
        ({"surface": {"baseColorFactor": [1, 1, -0.1, 1]}}, "baseColorFactor"),
        ({"emissiveFactor": [0.1, 0.2]}, r"emissiveFactor is \[0.1, 0.2\]; expected 3 numbers"),
        ({"normalTexture": {"index": 1, "scale": float("inf")}}, "scale of normalTexture is inf"),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 2}}}, "transmissionFactor is 2"),
        ({"extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": -1}}}, "emissiveStrength is -1"),
        ({"tree": {"extensionsRequired": ["KHR_materials_frost"]}}, "requires the extension KHR_materials_frost"),
    ],
)
def test_factors_and_extensions_that_make_no_sense_are_one_line(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(Avs3dError, match=words) as error:
        load_mesh(changed(tmp_path, **changes))
    assert "\n" not in str(error.value)


def test_an_unknown_extension_changes_nothing_and_is_noted_on_import(tmp_path: Path) -> None:
    from generators.library.rawmesh import read_raw

    plain = load_mesh(changed(tmp_path)).materials[0]
    path = changed(tmp_path, extensions={"KHR_materials_frost": {"frostFactor": 1.0}})
    found = load_mesh(path).materials[0]
    assert (found.roughness, found.metallic, found.colour) == (plain.roughness, plain.metallic, plain.colour)
    notes = [str(finding) for finding in read_raw(path)[1]]
    assert notes == ["note: 'tile': the extension KHR_materials_frost is not read and changes nothing"]


def test_defaults_are_those_of_gltf(tmp_path: Path) -> None:
    path = changed(tmp_path, pbrMetallicRoughness={}, normalTexture={"index": 0, "texCoord": 0})
    found = load_mesh(path).materials[0]
    assert (found.roughness, found.metallic) == (1.0, 1.0)


def test_the_scale_of_a_normal_map_tilts_it(tmp_path: Path) -> None:
    found = load_mesh(changed(tmp_path, normalTexture={"index": 2, "scale": 0.5})).materials[0].normal_map
    assert found is not None
    given = noise(2, side=8).astype(float) / 127.5 - 1
    scaled = given * (0.5, 0.5, 1)
    expected = scaled / np.linalg.norm(scaled, axis=2, keepdims=True)
    assert np.abs(found.pixels / 127.5 - 1 - expected).max() <= 0.5 / 127.5 + 1e-5


def test_a_map_with_other_coordinates_is_left_out(tmp_path: Path) -> None:
    found = load_mesh(changed(tmp_path, normalTexture={"index": 2, "texCoord": 1})).materials[0]
    assert found.normal_map is None
    assert found.roughness_map is not None


def test_an_emissive_texture_lights_the_faces_that_it_lights(tmp_path: Path) -> None:
    picture = np.zeros((16, 16, 3), dtype=np.uint8)
    rows, columns = np.mgrid[0:16, 0:16]
    picture[rows < columns - 1] = 255  # above the diagonal from the upper left to the lower right
    panel = Material("panel", "glass", texture=Texture("p", picture), emission=(1.0, 0.5, 0.25))
    path = tmp_path / "panel.glb"
    corners = np.array([(0, 2, 0), (2, 0, 0), (2, 2, 0), (0, 0, 0)], dtype=float)
    uv = corners[:, :2] / 2
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    square_mesh = MeshBuilder().add(corners, faces, panel, uv=uv[faces]).build()
    write_materials_glb(Scene("s", (Part("p", square_mesh),), (), ()), path)
    tree = document(path)
    tree["materials"][0]["emissiveTexture"] = {"index": 0}
    rewrite(path, tree)
    mesh = load_mesh(path)
    for face in range(2):
        middle = mesh.positions[face].mean(axis=0)
        emission = np.array(mesh.materials[mesh.face_material[face]].emission)
        if middle[0] + middle[1] > 2:
            assert emission[0] > 0.5
            np.testing.assert_allclose(emission / emission[0], (1, 0.5, 0.25), atol=1e-3)
        else:
            assert (emission == 0).all()


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("Ns 0", {"roughness": 1.0}),
        ("Ns 100", {"roughness": (2 / 102) ** 0.25}),
        ("Ns 100\nPr 0.2\nPm 1", {"roughness": 0.2, "metallic": 1.0}),
        ("Ns 100\nKs 0 0 0", {"roughness": 1.0}),
        ("illum 1\nNs 100", {"roughness": 1.0}),
        ("", {"roughness": 0.64, "metallic": 0.0, "transmission": 0.0}),
        ("d 0.25", {"transmission": 0.75}),
        ("Tr 0.25", {"transmission": 0.25}),
        ("Ke 2 1 0.5", {"emission": (2.0, 1.0, 0.5)}),
    ],
)
def test_statements_of_an_mtl(tmp_path: Path, lines: str, expected: dict[str, Any]) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl paint\nKd 0.5 0.5 0.5\n{lines}\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    material = load_mesh(tmp_path / "a.obj").materials[0]
    for name, value in expected.items():
        assert getattr(material, name) == pytest.approx(value), name


@pytest.mark.parametrize("line", ["Pr nan", "Pm 2", "Ns -1", "d many", "Ke 1 2"])
def test_statements_without_a_meaning_are_one_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl paint\nKd 0.5 0.5 0.5\n{line}\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    with pytest.raises(Avs3dError, match=f"'paint': its {line.split()[0]} is .*; expected"):
        load_mesh(tmp_path / "a.obj")


def test_a_texture_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from generators.assets import gltf, meshcheck

    monkeypatch.setattr(gltf, "LARGEST_TEXTURE", 24)
    with pytest.raises(Avs3dError, match="has 32 × 32 texels; expected at most 24"):
        load_mesh(changed(tmp_path))
    Image.fromarray(noise(1, side=32)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl paint\nmap_Kd a.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    monkeypatch.setattr(meshcheck, "LARGEST_TEXTURE", 24)
    with pytest.raises(Avs3dError, match=r"texture 'a.png' is larger than 24 texels to a side; reduce it"):
        load_mesh(tmp_path / "a.obj")


def test_an_imported_object_keeps_its_maps(tmp_path: Path) -> None:
    from generators.library.mesh_cleaning import clean

    path = tmp_path / "box.glb"
    box = MeshBuilder().box((0.3, 0.3, 0.3), (0, 0, 0), TILE).build()
    write_materials_glb(Scene("s", (Part("b", box),), (), ()), path)
    data, _ = clean(path)
    (tmp_path / "clean.glb").write_bytes(data)
    found = load_mesh(tmp_path / "clean.glb").materials[0]
    assert found.roughness == pytest.approx(0.75, abs=1e-4)
    assert found.metallic == pytest.approx(0.5, abs=1e-4)
    assert found.clearcoat == pytest.approx(0.25, abs=1e-4)
    assert found.normal_map is not None
    assert np.array_equal(found.normal_map.pixels, noise(2, side=8))
    assert found.roughness_map is not None
    assert np.array_equal(found.roughness_map.pixels, noise(3, side=32))
    independent = next(iter(trimesh.load_scene(io.BytesIO(data), file_type="glb").geometry.values()))
    assert isinstance(independent.visual.material.normalTexture, Image.Image)
