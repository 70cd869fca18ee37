"""Mesh cleaning: every fault of downloaded models, on small meshes with only that fault."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.meshfile import load_mesh, load_model
from generators.assets.modelframe import upright
from generators.core.scene import Licence, Mesh
from generators.library import simplify
from generators.library.mesh_cleaning import MeshFinding, clean
from generators.library.orientation import find_winding

Array = NDArray[np.float64]

#: A unit cube on the ground, quads counter-clockwise from outside.
CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (0.0, 1.0) for z in (-0.5, 0.5)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
MATERIALS = "newmtl body\nKd 0.5 0.5 0.5\nnewmtl glass\nKd 0.6 0.6 0.6\nd 0.4\nnewmtl dial\nKd 1 0 0\n"


def obj(vertices: object, faces: Sequence[Sequence[int]], *, head: str = "", per_face: Sequence[str] = ()) -> str:
    """An OBJ: ``per_face`` lines (usemtl) stand before the face of the same number."""
    lines = [head] + [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.asarray(vertices)]
    for number, face in enumerate(faces):
        if number < len(per_face):
            lines.append(per_face[number])
        lines.append("f " + " ".join(str(k + 1) for k in face))
    return "\n".join(lines) + "\n"


def cleaned(
    folder: Path, text: str, mtl: str | None = None, **how: object
) -> tuple[Mesh, tuple[MeshFinding, ...], bytes]:
    """The clean mesh as the rest of the toolkit reads it, the findings, and the GLB."""
    folder.mkdir(exist_ok=True)
    (folder / "a.obj").write_text(text)
    if mtl is not None:
        (folder / "a.mtl").write_text(mtl)
    data, findings = clean(folder / "a.obj", **how)  # type: ignore[arg-type]
    (folder / "clean.glb").write_bytes(data)
    return load_mesh(folder / "clean.glb"), findings, data


def said(findings: tuple[MeshFinding, ...], *parts: str) -> bool:
    """Whether one finding holds all the parts; every finding is one line."""
    assert all("\n" not in str(finding) for finding in findings)
    return any(all(part in str(finding) for part in parts) for finding in findings)


def volume(mesh: Mesh) -> float:
    """Signed: positive if the faces look outwards (divergence theorem)."""
    a, b, c = (mesh.positions[:, k].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


# ---- units and axes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "scale"), [("metres", 1), ("centimetres", 0.01), ("millimetres", 0.001), ("inches", 0.0254)]
)
def test_a_known_size_tells_the_unit(tmp_path: Path, unit: str, scale: float) -> None:
    box = CUBE * (0.6, 0.85, 0.55) / scale
    for how in ({"size": (0.6, 0.85, 0.55)}, {"height": 0.85}):
        mesh, findings, _ = cleaned(tmp_path, obj(box, QUADS), **how)
        np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), (0.6, 0.85, 0.55), rtol=1e-5)
        assert said(findings, "mended", unit) == (unit != "metres")


@pytest.mark.parametrize(("longest", "metres", "unit"), [(85, 0.85, "centimetres"), (850, 0.85, "millimetres")])
def test_an_unknown_size_is_guessed_and_the_guess_is_told(
    tmp_path: Path, longest: float, metres: float, unit: str
) -> None:
    mesh, findings, _ = cleaned(tmp_path, obj(CUBE * longest, QUADS))
    assert np.ptp(mesh.bounds, axis=0).max() == pytest.approx(metres, rel=1e-5)
    assert said(findings, "warning", unit)
    kept, findings, _ = cleaned(tmp_path, obj(CUBE * 0.4, QUADS))
    assert np.ptp(kept.bounds, axis=0).max() == pytest.approx(0.4, rel=1e-5)
    assert not said(findings, "warning")


def test_other_proportions_than_the_catalogue_says_are_a_warning(tmp_path: Path) -> None:
    _, findings, _ = cleaned(tmp_path, obj(CUBE * 100, QUADS), size=(1.0, 1.0, 1.4))
    assert said(findings, "warning", "1.000 × 1.000 × 1.000", "1.000 × 1.000 × 1.400")


@pytest.mark.parametrize(("up", "front"), [("y", "+z"), ("z", "-y"), ("-x", "+y"), ("z", "+x"), ("-y", "-z")])
def test_up_and_front_stand_right(tmp_path: Path, up: str, front: str) -> None:
    # A box with a red nose on its front, high up; turned into the file's axes and back.
    nose = CUBE * 0.1 + (0, 0.8, 0.54)
    points = np.concatenate([CUBE, nose]) @ upright(up, front)
    faces = [*QUADS, *(tuple(k + 8 for k in q) for q in QUADS)]
    lines = ["usemtl body"] + [""] * 5 + ["usemtl dial"]
    text = obj(points, faces, head="mtllib a.mtl", per_face=lines)
    mesh, _, _ = cleaned(tmp_path, text, MATERIALS, up=up, front=front)
    red = [k for k, m in enumerate(mesh.materials) if m.name == "dial"]
    middle = mesh.positions[np.isin(mesh.face_material, red)].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(middle - mesh.bounds[0], (0.5, 0.85, 1.04), atol=1e-5)
    turned, _, _ = cleaned(tmp_path, text, MATERIALS, up=up, front=front, yaw=90.0)
    middle = turned.positions[np.isin(turned.face_material, red)].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(middle - turned.bounds[0], (1.04, 0.85, 0.5), atol=1e-5)  # to its left: +x


def test_the_origin_is_below_the_middle(tmp_path: Path) -> None:
    mesh, _, _ = cleaned(tmp_path, obj(CUBE + (3, -2, 7), QUADS))
    np.testing.assert_allclose(mesh.bounds, [(-0.5, 0, -0.5), (0.5, 1, 0.5)], atol=1e-6)


# ---- faces ---------------------------------------------------------------------------------------------------------


def test_broken_and_double_faces_go(tmp_path: Path) -> None:
    faces = [*QUADS, (0, 1, 1), QUADS[0], (1, 3, 7, 5)]
    mesh, findings, _ = cleaned(tmp_path, obj(CUBE, faces))
    assert len(mesh.positions) == 12
    assert said(findings, "mended", "1 faces without area")
    assert said(findings, "mended", "4 duplicate faces")
    assert volume(mesh) == pytest.approx(1, rel=1e-5)


@settings(max_examples=15)
@given(st.sets(st.integers(0, 11)))
def test_any_mixture_of_windings_ends_outwards(turned: set[int]) -> None:
    triangles = CUBE[np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])]
    flip = np.isin(np.arange(12), list(turned))
    mixed = np.where(flip[:, None, None], triangles[:, [0, 2, 1]], triangles)
    winding = find_winding(mixed)
    np.testing.assert_array_equal(winding.flip, flip)
    assert not winding.sheet.any()
    assert (winding.shared, winding.open_edges) == (0, 0)


def test_a_part_that_is_inside_out_is_turned(tmp_path: Path) -> None:
    mesh, findings, _ = cleaned(tmp_path, obj(CUBE, [q[::-1] for q in QUADS]))
    assert volume(mesh) == pytest.approx(1, rel=1e-5)
    assert said(findings, "mended", "12 faces of parts that were inside out")
    outward = mesh.positions.mean(axis=1) - (0, 0.5, 0)
    assert (np.einsum("fc,fkc->fk", outward, mesh.normals) > 0).all()


def test_an_inner_wall_keeps_looking_into_the_cavity(tmp_path: Path) -> None:
    # A cup: the inside is seen from above, so its faces look inwards.
    inner = (CUBE - (0, 0.5, 0)) * (0.8, 0.8, 0.8) + (0, 0.6, 0)  # floor of the cavity at 0.2, rim at 1.0
    points = np.concatenate([CUBE, inner])
    outside = [q for q in QUADS if q != (2, 3, 7, 6)]
    inside = [tuple(k + 8 for k in q) for q in QUADS if q != (2, 3, 7, 6)]
    rim = [(2, 3, 11, 10), (3, 7, 15, 11), (7, 6, 14, 15), (6, 2, 10, 14)]
    mesh, _, _ = cleaned(tmp_path, obj(points, [*outside, *inside, *rim]))
    assert volume(mesh) == pytest.approx(1 - 0.8**3, rel=1e-4)


def test_edges_with_three_faces_and_moebius_strips_are_survived(tmp_path: Path) -> None:
    fin = np.concatenate([CUBE, [(-0.5, 2, -0.5), (-0.5, 2, 0.5)]])
    mesh, findings, _ = cleaned(tmp_path, obj(fin, [*QUADS, (2, 3, 9, 8)]))
    assert said(findings, "note", "non-manifold", "1 edges")
    assert mesh.bounds[1, 1] == pytest.approx(2)
    angle = np.linspace(0, 2 * np.pi, 25)[:-1]
    radial = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    side = 0.3 * (np.cos(angle / 2)[:, None] * radial + np.sin(angle / 2)[:, None] * (0, 1, 0))
    strip = np.stack([radial - side, radial + side], axis=1).reshape(-1, 3)
    faces = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(23)] + [(46, 47, 0, 1)]
    mesh, _, _ = cleaned(tmp_path, obj(strip, faces))
    assert len(mesh.positions) >= 48


def test_a_sheet_seen_from_both_sides_gets_a_back(tmp_path: Path) -> None:
    sheet = [(-0.5, 0, 0), (0.5, 0, 0), (0.5, 1, 0.0), (-0.5, 1, 0.0)]
    mesh, findings, _ = cleaned(tmp_path, obj(np.array(sheet) @ rotated(60), [(0, 1, 2, 3)]))
    assert said(findings, "mended", "2 faces of thin sheets")
    assert len(mesh.positions) == 4
    assert abs(volume(mesh)) < 0.001  # two sides, less than a millimetre apart
    normals = mesh.normals[:, 0]
    np.testing.assert_allclose(normals.sum(axis=0), 0, atol=1e-5)
    closed, findings, _ = cleaned(tmp_path, obj(CUBE, QUADS))
    assert len(closed.positions) == 12
    assert not said(findings, "sheets")


def rotated(degrees: float) -> Array:
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_a_dented_polygon_keeps_its_dent(tmp_path: Path) -> None:
    # A frame round a door as one polygon, with a slit to the hole, as modellers export it.
    ring = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
    points = [(x / 4 - 0.5, y / 4, 0.0) for x, y in ring]
    mesh, findings, _ = cleaned(tmp_path, obj(points, [tuple(range(10))]))
    front = mesh.positions[mesh.normals[:, 0, 2] > 0]
    area = np.linalg.norm(np.cross(front[:, 1] - front[:, 0], front[:, 2] - front[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(0.75, rel=1e-5)
    assert said(findings, "note", "1 concave polygons")


def test_too_many_faces_are_simplified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fast_simplification", reason="the package fast-simplification is not installed")
    monkeypatch.setattr(simplify, "MAX_FACES", 1500)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    ball.export(tmp_path / "ball.ply")
    data, findings = clean(tmp_path / "ball.ply")
    (tmp_path / "clean.glb").write_bytes(data)
    mesh = load_mesh(tmp_path / "clean.glb")
    assert len(mesh.positions) <= 1500
    assert said(findings, "warning", "5120 faces were simplified")
    radius = np.linalg.norm(mesh.positions - np.array([0, 0.5, 0]), axis=2)
    assert np.abs(radius - 0.5).max() < 0.01
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi / 8, rel=0.02)


def test_simplified_textures_stay_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fast_simplification", reason="the package fast-simplification is not installed")
    monkeypatch.setattr(simplify, "MAX_FACES", 400)
    side = np.linspace(0, 1, 31)
    x, y = np.meshgrid(side, side, indexing="ij")
    vertices = np.stack([x, y, 0.05 * np.sin(6 * x)], axis=2).reshape(-1, 3)
    at = np.arange(31 * 31).reshape(31, 31)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=2).reshape(-1, 4) + 1
    lines = [f"v {a} {b} {c}\nvt {a} {b}" for a, b, c in vertices]
    lines += ["f " + " ".join(f"{k}/{k}" for k in quad) for quad in quads]
    Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8)).save(tmp_path / "t.png")
    text = "mtllib a.mtl\nusemtl t\n" + "\n".join(lines) + "\n"
    mesh, _, _ = cleaned(tmp_path, text, "newmtl t\nmap_Kd t.png\n")
    assert len(mesh.positions) <= 2 * 420  # the sheet is seen from both sides
    np.testing.assert_allclose(mesh.uv[..., 0], mesh.positions[..., 0] + 0.5, atol=0.04)
    np.testing.assert_allclose(mesh.uv[..., 1], mesh.positions[..., 1], atol=0.04)


def test_without_the_package_too_many_faces_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simplify, "MAX_FACES", 4)
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    with pytest.raises(Avs3dError, match=r"a\.obj: it has 12 faces, more than 4; pip install fast-simplification"):
        cleaned(tmp_path, obj(CUBE, QUADS))


# ---- looks ---------------------------------------------------------------------------------------------------------


def clock(gap: float) -> str:
    """A body with a dial on its front and a pane of glass ``gap`` metres before it."""
    body = CUBE * (0.3, 0.3, 0.05)
    dial = np.array([(-0.1, 0.05, 0), (0.1, 0.05, 0), (0.1, 0.25, 0), (-0.1, 0.25, 0)]) + (0, 0, 0.026)
    faces = [*QUADS, (8, 9, 10, 11), (12, 13, 14, 15)]
    lines = ["usemtl body"] + [""] * 5 + ["usemtl dial", "usemtl glass"]
    return obj(np.concatenate([body, dial, dial + (0, 0, gap)]), faces, head="mtllib a.mtl", per_face=lines)


def test_glass_before_a_dial_is_left_out(tmp_path: Path) -> None:
    mesh, findings, _ = cleaned(tmp_path, clock(0.01), MATERIALS)
    assert "glass" not in {material.name for material in mesh.materials}
    assert "dial" in {material.name for material in mesh.materials}
    assert said(findings, "mended", "'glass'", "cm in front of a surface", "left out")


def test_glass_before_a_cavity_stays_opaque_and_dark(tmp_path: Path) -> None:
    door = np.array([(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 1, 0.5), (-0.5, 1, 0.5)])
    faces = [*(q for q in QUADS if q != (1, 5, 7, 3)), (8, 9, 10, 11)]
    lines = ["usemtl body"] + [""] * 4 + ["usemtl glass"]
    text = obj(np.concatenate([CUBE, door]), faces, head="mtllib a.mtl", per_face=lines)
    mesh, findings, _ = cleaned(tmp_path, text, MATERIALS)
    assert said(findings, "mended", "'glass'", "opaque and dark")
    colours = {material.name: max(material.colour) for material in mesh.materials}
    assert 0 < colours["glass"] < 0.5 * colours["body"]
    assert mesh.materials[[m.name for m in mesh.materials].index("glass")].acoustic == "glass"


def test_lettering_on_clear_film_is_taken_for_a_pane(tmp_path: Path) -> None:
    tmp_path.mkdir(exist_ok=True)
    pixels = np.zeros((32, 32, 4), dtype=np.uint8)
    pixels[10:12, :, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "film.png")
    text = clock(0.002).replace("f 13 14 15 16", "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 13/1 14/2 15/3 16/4")
    mesh, findings, _ = cleaned(tmp_path, text, MATERIALS.replace("d 0.4", "d 1\nmap_Kd film.png"))
    assert said(findings, "note", "94% transparent")
    assert {material.name for material in mesh.materials} == {"body", "dial"}


def test_a_missing_material_library_is_grey_with_a_warning(tmp_path: Path) -> None:
    mesh, findings, _ = cleaned(tmp_path, obj(CUBE, QUADS, head="mtllib none.mtl\nusemtl oak"))
    assert said(findings, "warning", "'none.mtl' is missing")
    assert all(0.1 < channel < 0.8 for material in mesh.materials for channel in material.colour)


def test_a_missing_texture_leaves_the_plain_colour_with_a_warning(tmp_path: Path) -> None:
    text = obj(CUBE, QUADS, head="mtllib a.mtl\nusemtl oak")
    mesh, findings, _ = cleaned(tmp_path, text, "newmtl oak\nKd 1 0 0\nmap_Kd gone.png\n")
    assert said(findings, "warning", "'gone.png'", "'oak'", "missing")
    (tmp_path / "gone.png").write_bytes(b"no picture")
    assert said(cleaned(tmp_path, text)[1], "warning", "'gone.png'", "broken")
    (material,) = mesh.materials
    assert material.texture is None
    assert material.colour[0] > 0.8 > 0.01 > max(material.colour[1:])
    assert material.acoustic == "wood"


def test_a_material_that_its_library_lacks_is_grey_with_a_warning(tmp_path: Path) -> None:
    text = obj(CUBE, QUADS, head="mtllib a.mtl", per_face=["usemtl body", "", "", "usemtl oak"])
    _, findings, _ = cleaned(tmp_path, text, MATERIALS)
    assert said(findings, "warning", "lacks 'oak'")


def test_names_in_latin_1_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_bytes("newmtl fa\xefence\nKd 1 0 0\n".encode("latin-1"))
    (tmp_path / "a.obj").write_bytes(obj(CUBE, QUADS, head="mtllib a.mtl\nusemtl fa\xefence").encode("latin-1"))
    data, findings = clean(tmp_path / "a.obj")
    (tmp_path / "clean.glb").write_bytes(data)
    (material,) = load_mesh(tmp_path / "clean.glb").materials
    assert findings == ()
    assert (material.name, max(material.colour[1:])) == ("fa\xefence", 0)


def test_a_texture_without_coordinates_gives_way_to_a_plain_colour(tmp_path: Path) -> None:
    tmp_path.mkdir(exist_ok=True)
    Image.new("RGB", (8, 8), (0, 255, 0)).save(tmp_path / "t.png")
    text = obj(CUBE, QUADS, head="mtllib a.mtl\nusemtl t")
    mesh, findings, _ = cleaned(tmp_path, text, "newmtl t\nKd 1 1 1\nmap_Kd t.png\n")
    assert said(findings, "warning", "'t' has a texture but no texture coordinates")
    assert mesh.materials[0].texture is None
    np.testing.assert_allclose(mesh.materials[0].colour, (0, 0.86, 0), atol=0.01)


def textured_quad(folder: Path, size: tuple[int, int], flip: bool = False) -> tuple[Mesh, tuple[MeshFinding, ...]]:
    """A standing quad whose picture is red at its lower left."""
    folder.mkdir(exist_ok=True)
    pixels = np.full((size[1], size[0], 3), 255, dtype=np.uint8)
    pixels[size[1] // 2 :, : size[0] // 2] = (255, 0, 0)
    Image.fromarray(pixels).save(folder / "t.png")
    face = "f 4/4 3/3 2/2 1/1" if flip else "f 1/1 2/2 3/3 4/4"
    text = (
        "mtllib a.mtl\nusemtl t\nv -0.5 0 0\nv 0.5 0 0\nv 0.5 1 0\nv -0.5 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        f"{face}\nv -0.5 0 -0.2\nv 0.5 0 -0.2\nv 0.5 1 -0.2\nv -0.5 1 -0.2\nusemtl body\nf 6 5 8 7\nf 5 1 4 8\n"
        "f 2 6 7 3\nf 4 3 7 8\nf 5 6 2 1\n"
    )
    mesh, findings, _ = cleaned(folder, text, MATERIALS + "newmtl t\nKd 0.1 0.1 0.1\nmap_Kd t.png\n")
    return mesh, findings


@pytest.mark.parametrize("flip", [False, True])
def test_pictures_stay_the_right_way_round(tmp_path: Path, flip: bool) -> None:
    mesh, _ = textured_quad(tmp_path, (16, 16), flip)
    index = next(k for k, material in enumerate(mesh.materials) if material.texture is not None)
    faces = mesh.face_material == index
    np.testing.assert_allclose(mesh.uv[faces][..., 0], mesh.positions[faces][..., 0] + 0.5, atol=1e-6)
    np.testing.assert_allclose(mesh.uv[faces][..., 1], mesh.positions[faces][..., 1], atol=1e-6)
    assert (mesh.normals[faces][..., 2] > 0.99).all()
    texture = mesh.materials[index].texture
    assert texture is not None
    assert texture.pixels[-1, 0].tolist() == [255, 0, 0]
    assert mesh.materials[index].colour == (1.0, 1.0, 1.0)  # Kd beside a picture is not meant


def test_a_huge_texture_is_reduced(tmp_path: Path) -> None:
    mesh, findings = textured_quad(tmp_path, (4096, 1024))
    (texture,) = [material.texture for material in mesh.materials if material.texture is not None]
    assert texture.pixels.shape == (512, 2048, 3)
    assert said(findings, "mended", "4096 × 1024", "2048 × 512")


def test_foreign_words_tell_the_material(tmp_path: Path) -> None:
    text = obj(CUBE, QUADS, head="mtllib a.mtl", per_face=["usemtl fayence", "", "", "usemtl inox"])
    mesh, _, _ = cleaned(tmp_path, text, "newmtl fayence\nKd .9 .9 .9\nnewmtl inox\nKd .7 .7 .7\n")
    assert {material.name.split()[0]: material.acoustic for material in mesh.materials} == {
        "fayence": "ceramic", "inox": "metal",
    }  # fmt: skip


# ---- the whole -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("category", CATEGORIES)
def test_a_clean_object_is_a_model_of_its_category(tmp_path: Path, category: str) -> None:
    cleaned(tmp_path, clock(0.01), MATERIALS)
    model = load_model(tmp_path / "clean.glb", category, licence=Licence("CC0-1.0", "a", "b"))
    model.mesh.check(category)
    assert len(model.mesh.acoustic_positions) > 0
    assert model.source_point[2] > float(model.mesh.bounds[1, 2]) - 0.01  # before the front
    assert model.size == pytest.approx((0.3, 0.3, 0.051), abs=1e-4)


@pytest.mark.slow
def test_the_same_file_gives_the_same_bytes_in_any_process(tmp_path: Path) -> None:
    _, _, first = cleaned(tmp_path, clock(0.01), MATERIALS)
    assert cleaned(tmp_path, clock(0.01), MATERIALS)[2] == first
    code = "import sys, pathlib; from generators.library.mesh_cleaning import clean; " \
        "sys.stdout.buffer.write(clean(pathlib.Path(sys.argv[1]))[0])"  # fmt: skip
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    other = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a.obj")], env=environment, capture_output=True, check=True
    )
    assert other.stdout == first


def test_a_mesh_of_several_primitives_is_read_in_the_same_order_every_time(tmp_path: Path) -> None:
    # The reader makes up random names for its nodes.
    _, _, data = cleaned(tmp_path, clock(0.01), MATERIALS)
    size = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + size])
    primitives = [mesh["primitives"][0] for mesh in tree["meshes"]]
    tree |= {"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    (tmp_path / "joined.glb").write_bytes(head + text + rest)
    assert len(primitives) == 2
    assert len({load_mesh(tmp_path / "joined.glb").positions.tobytes() for _ in range(8)}) == 1
    assert len({clean(tmp_path / "joined.glb")[0] for _ in range(4)}) == 1


def test_files_outside_the_folder_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl m\nKd 1 0 0\n")
    mesh, findings, _ = cleaned(tmp_path / "in", obj(CUBE, QUADS, head="mtllib ../secret.mtl\nusemtl m"))
    assert said(findings, "warning", "'../secret.mtl' is missing")
    assert mesh.materials[0].colour[0] == pytest.approx(mesh.materials[0].colour[1])


def test_a_gltf_that_refers_elsewhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}, "images": [{"uri": "../%2e%2e/secret.png"}]}')
    with pytest.raises(Avs3dError, match="outside of its folder"):
        clean(tmp_path / "a.gltf")


def test_a_clean_object_is_clean(tmp_path: Path) -> None:
    _, _, first = cleaned(tmp_path, clock(0.01), MATERIALS)
    again, findings = clean(tmp_path / "clean.glb")
    assert findings == ()
    (tmp_path / "again.glb").write_bytes(again)
    one, two = load_mesh(tmp_path / "clean.glb"), load_mesh(tmp_path / "again.glb")
    np.testing.assert_allclose(one.positions, two.positions, atol=1e-6)
    assert len(first) > 2000


@pytest.mark.parametrize(
    ("text", "how", "part"),
    [
        ("v 0 0 0\n", {}, "has no faces"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", {}, "no area"),
        ("v 0 0 0\nv nan 0 0\nv 2 1 0\nf 1 2 3\n", {}, "NaN"),
        (obj(CUBE * (1, 0, 1), QUADS[2:3]), {"height": 1.0}, "flat along its up axis"),
        (obj(CUBE * 1e9, QUADS), {}, "name its height"),
        (obj(CUBE, QUADS), {"height": float("nan")}, "height nan"),
        (obj(CUBE, QUADS), {"yaw": float("inf")}, "yaw inf"),
    ],
)
def test_what_cannot_be_mended_is_refused_in_a_line(
    tmp_path: Path, text: str, how: dict[str, object], part: str
) -> None:
    with pytest.raises(Avs3dError) as caught:
        cleaned(tmp_path, text, **how)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_meshes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.3ds").write_bytes(b"M")
    (tmp_path / "a.glb").write_bytes(b"glTF")
    (tmp_path / "a.stl").write_bytes(b"\0" * 90)
    for name in ("none.obj", "a.3ds", "a.glb", "a.stl"):
        with pytest.raises(Avs3dError, match=name.replace(".", r"\.")):
            clean(tmp_path / name)
    (tmp_path / "a.obj").write_text(obj(CUBE, QUADS))
    with pytest.raises(UsageError, match="perpendicular"):
        clean(tmp_path / "a.obj", up="y", front="y")
