"""Meshes from files: GLB, OBJ and PLY survive a round trip; a fault gives one line."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.acoustic_twin import box_faces, clustered, component_boxes
from generators.assets.meshfile import load_mesh, load_model
from generators.assets.modelframe import upright
from generators.core.scene import Licence
from tests.support.acoustic_rooms import box_scene

LICENCE = Licence("CC-BY-4.0", "someone", "somewhere")
COLOURS = np.array([[200, 40, 30], [30, 160, 60], [20, 60, 200], [240, 230, 90]], dtype=np.uint8)


def textured_quad() -> trimesh.Trimesh:
    """A unit square in the xy plane with a 2 × 2 picture: red, green above blue, yellow."""
    pixels = COLOURS.reshape(2, 2, 3).repeat(8, axis=0).repeat(8, axis=1)
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    material = trimesh.visual.material.SimpleMaterial(image=Image.fromarray(pixels), diffuse=[255, 255, 255, 255])
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.array(corners)[:, :2], material=material)
    return mesh


def sampled(mesh: Any, face: int, weights: tuple[float, float, float]) -> np.ndarray:
    """The texture's sRGB value at a barycentric point of a face, by the convention row 0 at v = 1."""
    texture = mesh.materials[mesh.face_material[face]].texture.pixels
    u, v = np.asarray(weights) @ mesh.uv[face]
    height, width, _ = texture.shape
    return np.asarray(texture[int((1 - v) * height), int(u * width)])


def box(size: tuple[float, float, float], centre: tuple[float, float, float] = (0, 0, 0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(centre)
    return mesh


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj"])
def test_textures_keep_their_place(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"quad.{suffix}"
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(textured_quad())).items():
            (tmp_path / ("quad.gltf" if name.endswith(".gltf") else name)).write_bytes(data)
    else:
        textured_quad().export(path)
    mesh = load_mesh(path)
    assert len(mesh.positions) == 2
    # The picture's top row (red, green) lies at the top: v = 1.
    for face in range(2):
        for weights in ((0.8, 0.15, 0.05), (0.1, 0.8, 0.1), (0.05, 0.15, 0.8)):
            x, y, _ = np.asarray(weights) @ mesh.positions[face]
            row, column = (0 if y > 0.5 else 1), (0 if x < 0.5 else 1)
            assert np.abs(sampled(mesh, face, weights).astype(int) - COLOURS[2 * row + column]).max() <= 2


def test_scene_graphs_are_flattened_and_mirrored_nodes_stay_outside_out(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    cube = box((1, 1, 1))
    scene.add_geometry(cube, geom_name="cube", transform=trimesh.transformations.translation_matrix([2, 0, 0]))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[:3, 3] = [-2, 0, 0]
    scene.graph.update("mirrored", matrix=mirror, geometry="cube")
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert len(mesh.positions) == 24
    assert mesh.bounds == pytest.approx(np.array([[-2.5, -0.5, -0.5], [2.5, 0.5, 0.5]]))
    centre = np.where(mesh.positions.mean(axis=1)[:, :1] > 0, 2.0, -2.0) * np.array([1, 0, 0])
    cross = np.cross(mesh.positions[:, 1] - mesh.positions[:, 0], mesh.positions[:, 2] - mesh.positions[:, 0])
    assert ((mesh.positions.mean(axis=1) - centre) * cross).sum(axis=1).min() > 0
    assert (mesh.normals * cross[:, None]).sum(axis=2).min() > 0
    assert len(mesh.acoustic_positions) == 24  # a box for each
    assert len(mesh.materials) == 1


def test_base_colours_of_gltf_are_linear(tmp_path: Path) -> None:
    cube = box((1, 1, 1))
    material = trimesh.visual.material.PBRMaterial(name="oak_wood", baseColorFactor=[0.5, 0.25, 0.1, 1.0])
    cube.visual = trimesh.visual.TextureVisuals(material=material)
    cube.export(tmp_path / "cube.glb")
    mesh = load_mesh(tmp_path / "cube.glb")
    assert mesh.materials[0].colour == pytest.approx((0.5, 0.25, 0.1), abs=0.003)
    assert mesh.materials[0].acoustic == "wood"  # told by its name
    assert set(mesh.acoustic_labels) == {"wood"}


def test_diffuse_colours_of_obj_are_srgb(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl paint\nKd 0.5 0.5 0.5\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n")
    mesh = load_mesh(tmp_path / "a.obj", acoustic="metal")
    assert mesh.materials[0].colour == pytest.approx((0.214, 0.214, 0.214), abs=0.005)
    assert mesh.materials[0].acoustic == "metal"  # the default


def test_vertex_colours_become_a_palette(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    upper = ball.vertices[:, 1] > 0
    ball.visual.vertex_colors = np.where(upper[:, None], [[200, 30, 30, 255]], [[20, 40, 220, 255]]).astype(np.uint8)
    ball.export(tmp_path / "ball.ply")
    mesh = load_mesh(tmp_path / "ball.ply")
    for face in range(0, len(mesh.positions), 7):
        y = mesh.positions[face, :, 1]
        if (y > 0.01).all():
            assert sampled(mesh, face, (1 / 3, 1 / 3, 1 / 3)).tolist() == [200, 30, 30]
        elif (y < -0.01).all():
            assert sampled(mesh, face, (1 / 3, 1 / 3, 1 / 3)).tolist() == [20, 40, 220]


def test_missing_normals_keep_edges_sharp_and_given_ones_are_kept(tmp_path: Path) -> None:
    faces = "f 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 6\n"
    fold = "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nv 0 1 -1\nv 0 1 0\n"
    (tmp_path / "fold.obj").write_text(fold + faces)
    sharp = load_mesh(tmp_path / "fold.obj")
    assert np.abs(sharp.normals).max(axis=2) == pytest.approx(1)  # each along an axis
    slanted = "".join(f"f {a}//1 {b}//1 {c}//1\n" for a, b, c in ((1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 6)))
    (tmp_path / "given.obj").write_text(f"{fold}vn 0.6 0.8 0\n{slanted}")
    given_normals = load_mesh(tmp_path / "given.obj").normals
    assert given_normals == pytest.approx(np.broadcast_to([0.6, 0.8, 0.0], (4, 3, 3)), abs=1e-5)


def test_degenerate_faces_are_dropped(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\n")
    assert len(load_mesh(tmp_path / "a.obj").positions) == 1


# ---- the acoustic twin --------------------------------------------------------------------------------------------


def test_a_box_stands_for_each_part_that_sound_can_tell(tmp_path: Path) -> None:
    parts = [box((0.5, 0.4, 0.3)), box((0.2, 0.2, 0.2), (1, 0, 0)), box((0.02, 0.02, 0.02), (0, 1, 0))]
    trimesh.Scene(parts).export(tmp_path / "a.glb")
    mesh = load_mesh(tmp_path / "a.glb")
    boxes = mesh.acoustic_positions.reshape(-1, 36, 3)
    assert sorted(np.ptp(b, axis=0).max().round(3) for b in boxes) == pytest.approx([0.2, 0.5])


def test_box_faces_look_outwards() -> None:
    faces = box_faces(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert ((faces.mean(axis=1) - [0.5, 1, 1.5]) * normal).sum(axis=1).min() > 0
    # The divergence theorem gives the volume of a closed surface.
    assert np.einsum("ij,ij->", faces[:, 0], normal) / 6 == pytest.approx(6.0)


def test_many_small_parts_become_one_box() -> None:
    rng = np.random.default_rng(0)
    soup = rng.uniform(0, 2, size=(300, 1, 3)) + rng.uniform(0, 0.3, size=(300, 3, 3))
    out, labels = component_boxes(soup, np.full(300, "wood"))
    assert out.shape == (12, 3, 3)
    assert labels == ("wood",) * 12


@settings(max_examples=20)
@given(st.integers(50, 1000))
def test_decimation_keeps_its_budget_and_the_shape(budget: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    faces, labels = clustered(np.asarray(ball.triangles), np.full(len(ball.faces), "plaster"), budget)
    assert 0 < len(faces) == len(labels) <= budget
    radius = np.linalg.norm(faces, axis=2)
    assert radius.max() <= 2.0 + 1e-9
    assert radius.min() > 1.0


# ---- models -------------------------------------------------------------------------------------------------------


def test_a_model_is_moved_into_the_model_frame(tmp_path: Path) -> None:
    # Z up, front towards −y, somewhere in space.
    trimesh.Scene([box((0.5, 0.4, 0.3), (3, 4, 5)), box((0.04, 0.04, 0.04), (3.1, 3.8, 5.0))]).export(
        tmp_path / "m.glb"
    )
    model = load_model(tmp_path / "m.glb", "microwave", licence=LICENCE, up="z", front="-y")
    low, high = model.mesh.bounds
    assert model.size == pytest.approx((0.5, 0.3, 0.42), abs=1e-5)
    assert low[1] == pytest.approx(0, abs=1e-6)
    assert (low + high)[[0, 2]] == pytest.approx([0, 0], abs=1e-5)
    assert (model.mount, model.licence, model.category) == ("surface", LICENCE, "microwave")
    knob = model.mesh.positions[12:].reshape(-1, 3)
    assert knob[:, 2].max() == pytest.approx(high[2])  # what stuck out towards −y sticks out in front
    assert knob[:, 0].mean() == pytest.approx(0.1, abs=1e-5)


@pytest.mark.parametrize(("scale", "height", "expected"), [(100, None, 0.85), (1, None, 0.9), (1, 0.7, 0.7)])
def test_heights(tmp_path: Path, scale: float, height: float | None, expected: float) -> None:
    # In centimetres, in metres, and as asked.
    box((0.6 * scale, 0.9 * scale, 0.6 * scale)).export(tmp_path / "w.glb")
    model = load_model(tmp_path / "w.glb", "washing_machine", licence=LICENCE, height=height)
    assert model.size[1] == pytest.approx(expected, rel=1e-4)


def test_the_default_source_lies_just_before_the_front(tmp_path: Path) -> None:
    box((0.5, 0.3, 0.4)).export(tmp_path / "m.glb")
    assert load_model(tmp_path / "m.glb", "microwave", licence=LICENCE).source_point == pytest.approx((0, 0.15, 0.23))
    clock = load_model(tmp_path / "m.glb", "clock", licence=LICENCE)
    assert clock.mount == "wall"
    assert clock.source_point == pytest.approx((0, 0, 0.43))


def test_no_acoustic_box_swallows_the_source(tmp_path: Path) -> None:
    # A thin post whose foot reaches forwards: the front surface lies well inside the bounding box.
    post = trimesh.util.concatenate([box((0.3, 0.9, 0.1), (0, 0.45, -0.2)), box((0.3, 0.1, 0.6), (0, 0.05, 0.0))])
    post.export(tmp_path / "v.ply")
    model = load_model(tmp_path / "v.ply", "vacuum_cleaner", licence=LICENCE, source_point=(0.0, 0.6, 0.0))
    for corners in model.mesh.acoustic_positions.reshape(-1, 36, 3):
        inside = (np.asarray(model.source_point) >= corners.min(axis=0)) & (model.source_point <= corners.max(axis=0))
        assert not inside.all()


@given(st.permutations(["x", "y", "z"]), st.sampled_from("+-"), st.sampled_from("+-"))
def test_upright_is_a_rotation(axes: list[str], a: str, b: str) -> None:
    turn = upright(a + axes[0], b + axes[1])
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    up = np.zeros(3)
    up["xyz".index(axes[0])] = 1.0 if a == "+" else -1.0
    assert turn @ up == pytest.approx([0, 1, 0])


# ---- what is said when something is wrong -------------------------------------------------------------------------


def said(path: Path) -> str:
    with pytest.raises(Avs3dError) as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 1
    return str(caught.value)


def test_missing_and_unknown_files(tmp_path: Path) -> None:
    assert "none.glb: no such file; expected a mesh" in said(tmp_path / "none.glb")
    (tmp_path / "a.blend").write_bytes(b"x")
    assert "unknown kind of mesh '.blend'; expected one of .glb, .gltf, .obj, .ply" in said(tmp_path / "a.blend")


def test_truncated_and_garbled_files(tmp_path: Path) -> None:
    box((1, 1, 1)).export(tmp_path / "whole.glb")
    data = (tmp_path / "whole.glb").read_bytes()
    (tmp_path / "half.glb").write_bytes(data[: len(data) // 2])
    assert f"half.glb: is truncated ({len(data) // 2} bytes of {len(data)})" in said(tmp_path / "half.glb")
    (tmp_path / "tiny.glb").write_bytes(data[:9])
    assert "is not a binary glTF" in said(tmp_path / "tiny.glb")
    (tmp_path / "junk.glb").write_bytes(data[:20] + b"#" * (len(data) - 20))
    assert "its JSON is broken" in said(tmp_path / "junk.glb")
    (tmp_path / "junk.gltf").write_text("{")
    assert "its JSON is broken" in said(tmp_path / "junk.gltf")
    (tmp_path / "junk.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\n")
    assert "junk.ply: cannot be read as ply" in said(tmp_path / "junk.ply")
    (tmp_path / "range.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    assert "range.obj: cannot be read as obj" in said(tmp_path / "range.obj")


def test_missing_companions(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "a.obj: its material library 'a.mtl' is missing" in said(tmp_path / "a.obj")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    assert "a.mtl: texture 'skin.png' is missing" in said(tmp_path / "a.obj")
    tree = {"asset": {"version": "2.0"}, "images": [{"uri": "skin%20one.png"}]}
    (tmp_path / "b.gltf").write_text(json.dumps(tree))
    assert "b.gltf: texture 'skin%20one.png' is missing" in said(tmp_path / "b.gltf")
    chunk = json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "b.bin", "byteLength": 4}]}).encode()
    chunk += b" " * (-len(chunk) % 4)
    header = struct.pack("<4sIIII", b"glTF", 2, 20 + len(chunk), len(chunk), 0x4E4F534A)
    (tmp_path / "b.glb").write_bytes(header + chunk)
    assert "b.glb: buffer 'b.bin' is missing" in said(tmp_path / "b.glb")


def test_numbers_that_are_none_and_meshes_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "nan.obj").write_text("v 0 0 0\nv nan 0 0\nv 0 inf 0\nf 1 2 3\n")
    assert "2 vertices of 'nan.obj' are NaN or infinite; repair the mesh" in said(tmp_path / "nan.obj")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    assert "points.obj: has no faces" in said(tmp_path / "points.obj")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    assert "every face of 'flat.obj' is degenerate" in said(tmp_path / "flat.obj")
    (tmp_path / "empty.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "scenes": [{}], "scene": 0}))
    assert "empty.gltf" in said(tmp_path / "empty.gltf")


def test_a_texture_that_cannot_be_decoded(tmp_path: Path) -> None:
    textured_quad().export(tmp_path / "quad.obj")
    (picture,) = tmp_path.glob("*.png")
    picture.write_bytes(picture.read_bytes()[:60])
    assert picture.name.split(".")[0] in said(tmp_path / "quad.obj")
    data = textured_quad().export(file_type="glb")
    at = data.index(b"\x89PNG")
    (tmp_path / "quad.glb").write_bytes(data[:at] + b"\0" * 64 + data[at + 64 :])
    assert "quad.glb: its image" in said(tmp_path / "quad.glb")


def test_bad_orders(tmp_path: Path) -> None:
    box((1, 1, 1)).export(tmp_path / "a.glb")
    with pytest.raises(UsageError, match="two perpendicular axes"):
        load_model(tmp_path / "a.glb", "clock", licence=LICENCE, up="y", front="-y")
    with pytest.raises(UsageError, match=r"up axis 'w': expected one of x, y, z"):
        load_model(tmp_path / "a.glb", "clock", licence=LICENCE, up="w")
    with pytest.raises(UsageError, match=r"unknown category 'klock'.*did you mean 'clock'"):
        load_model(tmp_path / "a.glb", "klock", licence=LICENCE)
    with pytest.raises(Avs3dError, match="height nan is not between"):
        load_model(tmp_path / "a.glb", "clock", licence=LICENCE, height=float("nan"))


@pytest.mark.parametrize("wrong", [-1, 1, 7])
def test_a_face_without_a_material_is_told_by_its_index(wrong: int) -> None:
    mesh = box_scene((4.0, 2.5, 3.0)).parts[0].mesh
    materials = mesh.face_material.copy()
    materials[3] = wrong
    with pytest.raises(Avs3dError, match=f"wall: a face has material index {wrong}; expected 0 to 0"):
        replace(mesh, face_material=materials).check("wall")
