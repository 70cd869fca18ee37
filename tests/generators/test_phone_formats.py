"""Files as phone apps and their optimisers write them: each is read, or ends in one line that says what to do."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets import gltf, meshfile
from generators.assets.meshfile import load_mesh
from generators.core.scene import Material, Mesh, Part, Scene, Texture
from generators.scans.files import find_scan_files, scan_files_of
from generators.vision.embree import EmbreeBackend
from tests.support import scan_like

#: A square metre that faces +Z, its texture's corners where the picture's are.
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
#: Red, green above blue, yellow.
COLOURS = np.array([[[200, 40, 30], [30, 160, 60]], [[20, 60, 200], [240, 230, 90]]], dtype=np.uint8)
PICTURE = COLOURS.repeat(8, axis=0).repeat(8, axis=1)
needs_draco = pytest.mark.skipif(not gltf.can_decode_draco(), reason="DracoPy is not installed (extra draco)")


def encoded(format_name: str) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(PICTURE).save(stream, format_name, quality=95)
    return stream.getvalue()


def document(data: bytes) -> tuple[dict[str, Any], bytes]:
    size = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def textured(**changes: Any) -> tuple[dict[str, Any], list[bytes]]:
    """The square as a document and its buffer views: positions, faces, coordinates, picture."""
    tree, binary = document(
        scan_like.mesh_glb(SQUARE, FACES, uv=SQUARE[:, :2], image=("image/png", scan_like.png(PICTURE)))
    )
    blobs = [binary[v["byteOffset"] : v["byteOffset"] + v["byteLength"]] for v in tree["bufferViews"]]
    return {**tree, **changes}, blobs


def written(path: Path, tree: dict[str, Any], blobs: list[bytes]) -> Mesh:
    path.write_bytes(scan_like.glb(tree, blobs))
    return load_mesh(path, twin="surface")


def shown(mesh: Mesh, at: tuple[float, float]) -> list[int]:
    """The texture's value at a point (x, y) of the square."""
    for corners, uv, material in zip(mesh.positions, mesh.uv, mesh.face_material, strict=True):
        a, b, c = corners[:, :2].astype(np.float64)
        v, w = np.linalg.solve(np.stack([b - a, c - a], axis=1), np.asarray(at) - a)
        if min(v, w, 1 - v - w) >= -1e-9:
            s, t = np.array([1 - v - w, v, w]) @ uv
            pixels = mesh.materials[material].texture.pixels
            height, width = pixels.shape[:2]
            return pixels[int((1 - t) % 1 * height) % height, int(s % 1 * width) % width].tolist()
    raise AssertionError(at)


QUADRANTS = {(0.25, 0.75): (0, 0), (0.75, 0.75): (0, 1), (0.25, 0.25): (1, 0), (0.75, 0.25): (1, 1)}


def picture_in_place(mesh: Mesh, tolerance: float = 6) -> None:
    for at, (row, column) in QUADRANTS.items():
        assert shown(mesh, at) == pytest.approx(COLOURS[row, column].tolist(), abs=tolerance)


# ---- glTF ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_pictures_of_every_kind(tmp_path: Path, kind: str) -> None:
    tree, blobs = textured()
    blobs[3] = encoded(kind)
    tree["images"][0]["mimeType"] = f"image/{kind.lower()}"
    if kind == "WEBP":
        tree["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
        tree["extensionsUsed"] = tree["extensionsRequired"] = ["EXT_texture_webp"]
    mesh = written(tmp_path / "a.glb", tree, blobs)
    for at, (row, column) in QUADRANTS.items():  # the middle of a quadrant: compression blurs its rim
        assert shown(mesh, at) == pytest.approx(COLOURS[row, column].tolist(), abs=20)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_quantised_attributes(tmp_path: Path, dtype: Any) -> None:
    """Positions in signed shorts under a node that scales them; coordinates as shares of the largest integer."""
    tree, blobs = textured()
    most, component = np.iinfo(dtype).max, {np.uint8: 5121, np.uint16: 5123}[dtype]
    blobs[0] = np.pad(np.round(32767 * SQUARE).astype("<i2"), ((0, 0), (0, 1))).tobytes()
    tree["bufferViews"] = None  # written anew by `glb`
    tree["accessors"][0] |= {"componentType": 5122, "normalized": True, "min": [0, 0, 0], "max": [1, 1, 0]}
    padding = 4 - 2 * np.dtype(dtype).itemsize
    uv = np.round(most * np.stack([SQUARE[:, 0], 1 - SQUARE[:, 1]], axis=1)).astype(dtype)
    blobs[2] = np.pad(uv, ((0, 0), (0, max(padding, 0)))).tobytes()
    tree["accessors"][2] |= {"componentType": component, "normalized": True}
    tree["nodes"] = [{"mesh": 0, "scale": [2, 2, 2], "translation": [1, 0, 0]}]
    tree["extensionsUsed"] = tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    data = scan_like.glb(tree, blobs)
    head, binary = document(data)
    head["bufferViews"][0]["byteStride"] = 8
    if padding > 0:
        head["bufferViews"][2]["byteStride"] = 4
    path = tmp_path / "q.glb"
    path.write_bytes(gltf.pack_glb(head, binary))
    mesh = load_mesh(path, twin="surface")
    assert mesh.bounds.tolist() == pytest.approx(np.array([[1, 0, 0], [3, 2, 0]]), abs=1e-4)
    moved = Mesh(
        (mesh.positions - [1, 0, 0]) / 2, mesh.normals, mesh.uv, mesh.face_material, mesh.materials,
        mesh.acoustic_positions, mesh.acoustic_labels,
    )  # fmt: skip
    picture_in_place(moved)


def test_texture_transforms(tmp_path: Path) -> None:
    """The upper right quarter of the picture is spread over the square; turned by 90°, its corners change places."""
    tree, blobs = textured()
    texture = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [0.5, 0.5]}}
    mesh = written(tmp_path / "a.glb", tree, blobs)
    assert {tuple(shown(mesh, at)) for at in QUADRANTS} == {tuple(COLOURS[0, 1].tolist())}
    # Coordinates turn counter-clockwise as seen: the square's lower left shows what lay clockwise of it.
    texture["extensions"] = {"KHR_texture_transform": {"rotation": np.pi / 2, "offset": [0.0, 1.0]}}
    turned = written(tmp_path / "b.glb", tree, blobs)
    assert shown(turned, (0.25, 0.75)) == COLOURS[1, 0].tolist()
    assert shown(turned, (0.75, 0.75)) == COLOURS[0, 0].tolist()


def test_the_second_set_of_coordinates(tmp_path: Path) -> None:
    tree, blobs = textured()
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = attributes["TEXCOORD_0"]
    attributes["TEXCOORD_0"] = len(tree["accessors"])
    tree["accessors"].append({"bufferView": 4, "componentType": 5126, "count": 4, "type": "VEC2"})
    blobs.append(np.zeros((4, 2), "<f4").tobytes())
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1
    picture_in_place(written(tmp_path / "a.glb", tree, blobs))


def test_unlit_materials_several_nodes_and_only_the_scene_that_is_shown(tmp_path: Path) -> None:
    tree, blobs = textured(
        nodes=[
            {"mesh": 0, "children": [1], "translation": [0, 1, 0]},
            {"mesh": 0, "rotation": [0, 0.70710678, 0, 0.70710678]},
            {"mesh": 0, "translation": [50, 0, 0]},
        ],
        scenes=[{"nodes": [2]}, {"nodes": [0]}],
        scene=1,
    )
    tree["materials"][0]["extensions"] = {"KHR_materials_unlit": {}}
    tree["extensionsUsed"] = ["KHR_materials_unlit"]
    mesh = written(tmp_path / "a.glb", tree, blobs)
    assert len(mesh.positions) == 4
    assert mesh.bounds.tolist() == pytest.approx(np.array([[0, 1, -1], [1, 2, 0]]), abs=1e-6)


def test_the_same_in_a_gltf_with_files_beside_it(tmp_path: Path) -> None:
    tree, blobs = textured()
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
        "KHR_texture_transform": {"offset": [0.5, 0.0], "scale": [0.5, 0.5]}
    }
    (tmp_path / "my picture.png").write_bytes(scan_like.png(PICTURE))
    head, binary = document(scan_like.glb(tree, blobs[:3]))
    head["images"] = [{"uri": "my%20picture.png"}]
    head["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.bin").write_bytes(binary)
    (tmp_path / "a.gltf").write_text(json.dumps(head))
    mesh = load_mesh(tmp_path / "a.gltf", twin="surface")
    assert {tuple(shown(mesh, at)) for at in QUADRANTS} == {tuple(COLOURS[0, 1].tolist())}


@needs_draco
def test_draco(tmp_path: Path) -> None:
    quad = trimesh.Trimesh(SQUARE, FACES, process=False)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(PICTURE))
    quad.visual = trimesh.visual.TextureVisuals(uv=SQUARE[:, :2], material=material)
    data = trimesh.exchange.gltf.export_glb(trimesh.Scene(quad), extension_draco=True)
    assert b"KHR_draco_mesh_compression" in data
    (tmp_path / "a.glb").write_bytes(data)
    mesh = load_mesh(tmp_path / "a.glb", twin="surface")
    assert mesh.bounds.tolist() == pytest.approx(np.array([[0, 0, 0], [1, 1, 0]]), abs=1e-3)
    picture_in_place(mesh)


def test_a_huge_picture_is_refused_and_a_large_one_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 50)  # Pillow's limit, which scans exceed
    tree, blobs = textured()
    picture_in_place(written(tmp_path / "a.glb", tree, blobs))
    monkeypatch.setattr(gltf, "LARGEST_TEXTURE", 15)
    with pytest.raises(Avs3dError, match=r"its image 0 has 16 × 16 texels; expected at most 15 to a side; reduce it"):
        load_mesh(tmp_path / "a.glb")


def test_a_degenerate_mesh_beside_a_good_one_is_left_out(tmp_path: Path) -> None:
    good, flat = trimesh.Trimesh(SQUARE, FACES, process=False), trimesh.Trimesh(0 * SQUARE, FACES, process=False)
    trimesh.Scene({"flat": flat, "good": good}).export(tmp_path / "a.glb")
    assert len(load_mesh(tmp_path / "a.glb").positions) == 2


# ---- vertex colours -----------------------------------------------------------------------------------------------


def with_colours(path: Path, suffix: str, colours: np.ndarray) -> Path:
    file = path / f"c.{suffix}"
    if suffix == "glb with a material":
        tree, binary = document(scan_like.mesh_glb(SQUARE, FACES, colours=colours))
        tree["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0}, "name": "scan"}]
        tree["meshes"][0]["primitives"][0]["material"] = 0
        file = path / "c.glb"
        file.write_bytes(gltf.pack_glb(tree, binary))
    elif suffix == "glb":
        file.write_bytes(scan_like.mesh_glb(SQUARE, FACES, colours=colours))
    else:
        quad = trimesh.Trimesh(SQUARE, FACES, process=False, vertex_colors=colours)
        quad.export(file)
    return file


@pytest.mark.parametrize("suffix", ["glb", "glb with a material", "ply", "obj"])
def test_vertex_colours_run_over_the_faces(tmp_path: Path, suffix: str) -> None:
    """Rendered, the colour of any point is the mean of the corners' by weight, in linear light."""
    colours = np.array([[230, 0, 170], [170, 0, 230], [170, 0, 230], [230, 0, 170]], dtype=np.uint8)
    low, high = (170 / 255, 230 / 255) if suffix.startswith("glb") else (0.402, 0.791)  # linear light, or sRGB
    mesh = load_mesh(with_colours(tmp_path, suffix, colours), twin="surface")
    # Without what the surface reflects besides its colour.
    mesh = replace(mesh, materials=tuple(replace(material, roughness=1.0) for material in mesh.materials))
    scene = Scene("c", (Part("c", mesh),), (), ())
    camera = Intrinsics.from_fov(64, 60.0)
    light, face = EmbreeBackend().open(scene, camera).radiance(Pose.from_yaw((0.5, 0.5, 1.2), 0.0))
    assert (face[32] >= 0).sum() > 40
    columns = np.flatnonzero(face[32] >= 0)
    x = 0.5 + (columns + 0.5 - 32) / camera.fx * 1.2
    assert light[32, columns, 0] == pytest.approx(high - (high - low) * x, abs=0.01)
    assert light[32, columns, 2] == pytest.approx(low + (high - low) * x, abs=0.01)


@pytest.mark.parametrize("most", [300_000, 100])
def test_neighbours_do_not_bleed_into_one_another(tmp_path: Path, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Faces about as small as pixels: left stays red and right blue, by corners or by a colour per face."""
    monkeypatch.setattr(meshfile, "_SHADED_MOST", most)
    steps = np.linspace(0, 1, 31)
    x, y = (g.reshape(-1) for g in np.meshgrid(steps, steps, indexing="ij"))
    corner = (np.arange(30)[:, None] * 31 + np.arange(30)).reshape(-1)
    faces = (corner[:, None, None] + np.array([[0, 31, 32], [0, 32, 1]])).reshape(-1, 3)
    colours = np.where((x < 0.5)[:, None], [250, 10, 10], [10, 10, 250]).astype(np.uint8)
    points = np.stack([x, y, 0 * x], axis=1)
    trimesh.Trimesh(points, faces, vertex_colors=colours, process=False).export(tmp_path / "a.ply")
    mesh = load_mesh(tmp_path / "a.ply", twin="surface")
    view = EmbreeBackend().open(Scene("c", (Part("c", mesh),), (), ()), Intrinsics.from_fov(32, 60.0))
    rgb = view.radiance(Pose.from_yaw((0.5, 0.5, 1.2), 0.0))[0]
    assert (rgb[8:24, 5:13, 0] > 5 * rgb[8:24, 5:13, 2]).all()
    assert (rgb[8:24, 19:27, 2] > 5 * rgb[8:24, 19:27, 0]).all()


def test_a_scan_turned_inside_out_looks_and_stands_the_same() -> None:
    """Whichever way the faces wind, the camera sees the same."""
    texture = Texture("t", PICTURE)

    def square(order: list[int]) -> Scene:
        faces = FACES[:, order]
        uv = SQUARE[faces][..., :2].astype(np.float32)
        normals = np.tile(np.float32([0, 0, 1 if order == [0, 1, 2] else -1]), (2, 3, 1))
        corners = SQUARE[faces].astype(np.float32)
        material = (Material("m", "plaster", texture=texture),)
        mesh = Mesh(corners, normals, uv, np.zeros(2, np.int32), material, corners, ("plaster",) * 2)
        return Scene("s", (Part("s", mesh),), (), ())

    pictures = [
        EmbreeBackend().open(square(order), Intrinsics.from_fov(32, 60.0)).render(Pose.from_yaw((0.5, 0.5, 1), 0)).rgb
        for order in ([0, 1, 2], [0, 2, 1])
    ]
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 1


# ---- OBJ and PLY --------------------------------------------------------------------------------------------------


def test_an_obj_whose_names_have_spaces(tmp_path: Path) -> None:
    (tmp_path / "my room.jpg").write_bytes(scan_like.png(PICTURE))
    (tmp_path / "my room.mtl").write_text("newmtl material 0\nKd 1 1 1\nmap_Kd my room.jpg\n")
    lines = [f"v {x} {y} {z}" for x, y, z in SQUARE] + [f"vt {x} {y}" for x, y, _ in SQUARE]
    text = ["mtllib my room.mtl", *lines, "usemtl material 0", "f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]
    (tmp_path / "my room.obj").write_text("\n".join(text) + "\n")
    picture_in_place(load_mesh(tmp_path / "my room.obj", twin="surface"))
    assert set(scan_files_of(tmp_path / "my room.obj").digests()) == {"my room.obj", "my room.mtl", "my room.jpg"}


def ply(faces: str, *, extra: str = "", count: int = 2, comments: str = "", vertex: str = "") -> str:
    axes = "\n".join(f"property float {axis}" for axis in "xyz")
    return (
        f"ply\nformat ascii 1.0\n{comments}element vertex 4\n{axes}\n{vertex}element face {count}\n"
        f"property list uchar int vertex_indices\n{extra}end_header\n"
        + "".join(f"{x} {y} {z}\n" for x, y, z in SQUARE)
        + faces
    )


def test_a_ply_with_coordinates_at_its_faces(tmp_path: Path) -> None:
    (tmp_path / "room 1.png").write_bytes(scan_like.png(PICTURE))
    rows = [f"3 {a} {b} {c} 6 " + " ".join(f"{SQUARE[k, 0]} {SQUARE[k, 1]}" for k in (a, b, c)) for a, b, c in FACES]
    text = ply(
        "\n".join(rows) + "\n",
        extra="property list uchar float texcoord\n",
        comments="comment TextureFile room 1.png\n",
    )
    (tmp_path / "a.ply").write_text(text)
    picture_in_place(load_mesh(tmp_path / "a.ply", twin="surface"))
    (tmp_path / "room 1.png").unlink()
    with pytest.raises(Avs3dError, match=r"a\.ply: texture 'room 1\.png' is missing; put it beside the file"):
        load_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(("vertex", "what"), [("", "a point cloud"), ("property float f_dc_0\n", "3D Gaussian splats")])
def test_points_are_told_from_a_mesh(tmp_path: Path, vertex: str, what: str) -> None:
    text = ply("", count=0, vertex=vertex)
    (tmp_path / "a.ply").write_text(text)
    with pytest.raises(Avs3dError, match=rf"holds {what} \(4 points\), no faces; export the scan as a mesh"):
        load_mesh(tmp_path / "a.ply")


def test_a_ply_with_several_textures_is_one_line(tmp_path: Path) -> None:
    names = "comment TextureFile a.png\ncomment TextureFile b.png\n"
    (tmp_path / "a.ply").write_text(ply("3 0 1 2\n3 0 2 3\n", comments=names))
    with pytest.raises(Avs3dError, match="has 2 textures, of which only one could be read"):
        load_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("suffix", "way"), [("usdz", "export the scan as GLB"), ("zip", "unpack it"), ("spz", "splats"), ("las", "points")]
)
def test_other_files_of_the_apps_are_one_line(tmp_path: Path, suffix: str, way: str) -> None:
    file = tmp_path / f"room.{suffix}"
    file.write_bytes(b"PK\3\4")
    with pytest.raises(Avs3dError, match=rf"room\.{suffix}: \.{suffix} is not read; .*{way}") as caught:
        load_mesh(file)
    assert "\n" not in str(caught.value)
    with pytest.raises(Avs3dError, match=rf"room\.{suffix} is there: .*{way}"):
        find_scan_files("room", tmp_path)
