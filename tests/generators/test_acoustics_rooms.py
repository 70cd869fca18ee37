"""Rooms of one's own: shoeboxes, meshes of all formats, their materials; what is wrong with one is said in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from avs3d_bench.errors import Avs3dError
from generators import acoustics
from generators.acoustics import rooms
from generators.acoustics.materials import MATERIALS, material_for
from generators.acoustics.surface_materials import surface_materials


def flat(*, scale: float = 1.0) -> trimesh.Scene:
    """A room of 5 × 2.5 × 4 m with a floor, walls and a table, as three meshes with materials."""
    scene = trimesh.Scene()
    walls = trimesh.creation.box((5 * scale, 2.5 * scale, 4 * scale))
    up = walls.face_normals[:, 1]
    for name, faces, material in (("Floor_01", up < -0.5, "oak"), ("shell", up >= -0.5, "wall paint")):
        part = walls.submesh([np.flatnonzero(faces)], append=True)
        part.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name=material))
        scene.add_geometry(part, node_name=name, geom_name=name)
    table = trimesh.creation.box((1.2 * scale, 0.1 * scale, 0.8 * scale))
    place = trimesh.transformations.translation_matrix(np.array((1.0, -0.5, 0.0)) * scale)
    scene.add_geometry(table, node_name="table", geom_name="table", transform=place)
    return scene


MATERIALS_OF_FLAT = {"*": "plaster", "floor*": "parquet", "table": {"absorption": 0.1, "scattering": 0.4}}


def one_line(error: pytest.ExceptionInfo[Avs3dError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


def test_a_shoebox_has_the_area_and_the_materials_of_its_faces() -> None:
    room = acoustics.Room.shoebox(
        (6, 2.7, 4), {"walls": "plaster", "west": "curtain", "floor": "parquet", "ceiling": 0.2}
    )
    areas = {use.pattern: use.area for use in room.materials_used()}
    assert areas == pytest.approx({"walls": 2 * 6 * 2.7 + 4 * 2.7, "west": 4 * 2.7, "floor": 24.0, "ceiling": 24.0})
    assert room.bounds is not None
    np.testing.assert_array_equal(room.bounds, [[0, 0, 0], [6, 2.7, 4]])
    centre = room.triangles.mean(axis=(0, 1))
    normals = np.cross(room.triangles[:, 1] - room.triangles[:, 0], room.triangles[:, 2] - room.triangles[:, 0])
    assert (((centre - room.triangles[:, 0]) * normals).sum(axis=1) > 0).all()  # into the room


@pytest.mark.parametrize("ending", ["glb", "obj", "ply", "stl"])
def test_files_of_all_formats_are_the_same_room(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"flat.{ending}"
    flat().export(path) if ending in ("glb", "obj") else flat().to_mesh().export(path)
    room = acoustics.Room.from_mesh(path, "plaster")
    assert len(room.triangles) == 24
    assert room.bounds is not None
    np.testing.assert_allclose(room.bounds, [[-2.5, -1.25, -2], [2.5, 1.25, 2]], atol=1e-6)
    (use,) = room.materials_used()
    assert use.area == pytest.approx(2 * (5 * 2.5 + 5 * 4 + 2.5 * 4) + 2 * (1.2 * 0.8 + 1.2 * 0.1 + 0.8 * 0.1))


def test_materials_match_meshes_their_materials_and_labels_of_faces(tmp_path: Path) -> None:
    flat().export(tmp_path / "flat.glb")
    lines = {**MATERIALS_OF_FLAT, "wall*": "brick", "sofa*": "fabric"}
    with pytest.warns(UserWarning, match="'sofa[*]': no surface has such a name"):
        room = acoustics.Room.from_mesh(tmp_path / "flat.glb", lines)
    used = {use.pattern: use for use in room.materials_used()}
    assert (used["floor*"].names, used["floor*"].faces, used["floor*"].area) == (("Floor_01",), 2, pytest.approx(20.0))
    assert (used["wall*"].names, used["wall*"].material, used["wall*"].faces) == (("wall paint",), "brick", 10)
    assert (used["table"].material, used["sofa*"].faces, used["*"].faces) == ("given", 0, 0)
    assert used["table"].absorption == pytest.approx([0.1] * 6)
    box = trimesh.creation.box((5, 2.5, 4))
    labels = ["window" if n[0] > 0.5 else "wall" for n in box.face_normals]
    by_face = acoustics.Room.from_mesh(box, {"window": "glass", "wall": "concrete"}, labels=labels)
    assert {use.material: use.faces for use in by_face.materials_used()} == {"glass": 2, "concrete": 10}
    box.face_attributes["object_id"] = np.array([7 if one == "window" else 3 for one in labels])
    by_id = acoustics.Room.from_mesh(box, {"7": "glass", "*": "concrete"})
    assert by_id.labels == by_face.labels


def test_a_table_of_ones_own_has_octaves_scattering_and_transmission(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "materials:\n  rug: {absorption: {125: 0.1, 4000: 0.6}, scattering: 0.3,"
        " transmission: [0.1, 0, 0, 0, 0, 0.5]}\n"
        'surfaces:\n  "*": plaster\n  "floor*": rug\n'
    )
    (plaster, _, _), (_, label, name) = surface_materials(path).lines
    rug = material_for(label)
    assert (plaster, name, rug.scattering) == ("*", "rug", (0.3,) * 6)
    assert rug.absorption == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], abs=1e-4)
    assert rug.transmission == pytest.approx([0.1, 0, 0, 0, 0, 0.5])
    assert rug.in_situ == pytest.approx(rug.absorption)
    assert surface_materials("wood").lines == (("*", "wood", "wood"),)
    soundspaces = tmp_path / "mp3d.json"
    soundspaces.write_text('{"materials": [{"name": "Rug", "labels": ["rug", "carpet"], "absorption": [125, 0.5]}]}')
    found = surface_materials(soundspaces).match(("blue_carpet_2",))
    assert found == (1, "blue_carpet_2")


@pytest.mark.parametrize(
    ("materials", "text"),
    [
        ({"*": "plastr"}, "'*': unknown material 'plastr'; did you mean 'plaster'?"),
        ({"*": 1.5}, "'*' is 1.5; expected a name"),
        ({"*": [0.1, 0.2]}, "'*' is [0.1, 0.2]; expected a name"),
        ({"*": {"absorption": 0.1, "colour": 3}}, "has 'colour'; expected a name"),
        ({"*": float("nan")}, "'*' is nan; expected"),
        ({"flor*": "parquet", "shell": "plaster", "table": 0.1}, "no material for Floor_01 / oak; the patterns are"),
        ({}, "materials: no line; expected GLOB: MATERIAL"),
        ("mine.yaml", "mine.yaml"),
    ],
)
def test_wrong_materials_are_said_in_one_line(materials: object, text: str) -> None:
    with pytest.raises(Avs3dError) as error:
        acoustics.Room.from_mesh(flat(), materials)
    assert text in one_line(error)


def test_a_surface_without_a_material_names_the_nearest_pattern() -> None:
    with pytest.raises(Avs3dError, match=r"did you mean 'florr_01\*'\? Add one, or '\*' for all others"):
        acoustics.Room.from_mesh(flat(), {"florr_01*": "parquet", "shell": "plaster", "table": "wood"})


def test_bad_meshes_are_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(mesh: object, **options: object) -> str:
        with pytest.raises(Avs3dError) as error:
            acoustics.Room.from_mesh(mesh, "plaster", **options)  # type: ignore[arg-type]
        return one_line(error)

    millimetres = flat(scale=1000)
    assert "spans 5000 × 2500 × 4000 m, expected 0.3 to 500 m; if its unit is no metre, give scale=0.001" in refused(
        millimetres
    )
    room = acoustics.Room.from_mesh(millimetres, "plaster", scale=0.001)
    assert room.bounds is not None
    np.testing.assert_allclose(np.ptp(room.bounds, axis=0), [5, 2.5, 4])
    broken = trimesh.creation.box((5, 2.5, 4))
    broken.vertices[0] = np.nan
    assert "NaN or infinite; repair it" in refused(trimesh.Trimesh(broken.vertices, broken.faces, process=False))
    assert "no such file" in refused(tmp_path / "missing.glb")
    (tmp_path / "text.glb").write_text("no mesh")
    assert "text.glb: cannot be read as a mesh" in refused(tmp_path / "text.glb")
    assert "unknown format" in refused(tmp_path / "flat.blend")
    assert "got int, expected a path" in refused(7)
    assert "has no faces" in refused(trimesh.Scene())
    assert "3 labels for the 12 faces" in refused(trimesh.creation.box((5, 2.5, 4)), labels=["a"] * 3)
    assert "up is 'x'" in refused(flat(), up="x")
    monkeypatch.setattr(rooms, "MOST_FACES", 11)
    assert "12 faces, expected at most 11; simplify it" in refused(trimesh.creation.box((5, 2.5, 4)))


def test_z_up_meshes_are_turned() -> None:
    room = acoustics.Room.from_mesh(trimesh.creation.box((5, 4, 2.5)), "plaster", up="z")
    assert room.bounds is not None
    np.testing.assert_allclose(np.ptp(room.bounds, axis=0), [5, 2.5, 4])


@pytest.mark.parametrize("size", [(6, 2.7), (6, 0, 4), (6, np.nan, 4), "large", (6, 2.7, 4000)])
def test_shoeboxes_of_no_size_are_refused(size: object) -> None:
    with pytest.raises(Avs3dError, match=r"shoebox: size is .* expected \(x, y, z\), each 0.1 to 500 m"):
        acoustics.Room.shoebox(size)  # type: ignore[arg-type]


def test_names_of_the_table_are_materials_in_situ() -> None:
    (use,) = acoustics.Room.shoebox((6, 2.7, 4), "carpet").materials_used()
    assert use.absorption == MATERIALS["carpet"].in_situ


def test_a_pattern_without_a_surface_and_a_mesh_in_centimetres_warn() -> None:
    box = trimesh.creation.box((5, 2.5, 4))
    with pytest.warns(UserWarning, match="'flor[*]': no surface has such a name; the names are 'mesh'"):
        acoustics.Room.from_mesh(box, {"*": "plaster", "flor*": "parquet"})
    with pytest.warns(UserWarning, match="spans 500 × 250 × 400 m; if its unit is the centimetre, give scale=0.01"):
        acoustics.Room.from_mesh(box.apply_scale(100), "plaster")


@pytest.mark.parametrize("place", [(0.0, 1.0, 2.0), (6.0, 1.0, 2.0), (3.0, -0.2, 2.0)])
def test_a_place_in_a_wall_of_a_shoebox_is_refused(place: tuple[float, float, float]) -> None:
    room, inside = acoustics.Room.shoebox((6, 2.7, 4), 0.2), (3.0, 1.0, 2.0)
    engine = acoustics.Analytic(images=50, tail=False)
    for ends, what in (((place, inside), "source"), ((inside, place), "listener")):
        with pytest.raises(Avs3dError, match=f"{what} position .* lies outside the scene or in a wall"):
            engine.response(room, *ends)
        with pytest.raises(Avs3dError, match=f"{what} position .* lies outside the scene or in a wall"):
            engine.render(room, np.ones(100), *([(0.0, inside), (1.0, end)] for end in ends))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"receiver": "head"}, "receiver: got 'head', expected one of"),
        ({"receiver": acoustics.Omni}, "receiver: got <class .*, expected one of"),
        ({"directivity": "cardioid"}, "directivity: got 'cardioid', expected Directivity.cardioid"),
    ],
)
def test_what_is_no_receiver_or_directivity_is_said_in_one_line(change: dict[str, object], text: str) -> None:
    room = acoustics.Room.shoebox((6, 2.7, 4), 0.2)
    with pytest.raises(Avs3dError, match=text):
        acoustics.Tracer().response(room, (1, 1, 2), (4, 1, 2), **change)  # type: ignore[arg-type]
    with pytest.raises(Avs3dError, match=r"seed is 1.5, expected a whole number"):
        acoustics.Tracer(seed=1.5)  # type: ignore[arg-type]
