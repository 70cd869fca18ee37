"""Scans from files: a box room with a worktop, a side table and a shelf, exported and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from avs3d_bench.errors import Avs3dError
from generators.core.scene import Scene, Support
from generators.lighting.surfaces import LitSurfaces
from generators.scans.layers import largest_rectangle, rectangles
from generators.scans.scan import Axes, ScanAcoustics, load_scan
from tests.support.tiers import some

BOX = [[-2.0, 0.0, -1.5], [2.0, 2.5, 1.5]]


def furnished_room() -> trimesh.Scene:
    """4 × 2.5 × 3 m, seen from inside; its floor ripples by a few millimetres, as a scan's does."""
    shell = trimesh.creation.box([4, 2.5, 3])
    shell.invert()
    shell = shell.subdivide_to_size(0.4)
    rng = np.random.default_rng(0)
    ground = shell.vertices[:, 1] < -1.2
    shell.vertices[ground, 1] += rng.uniform(-0.004, 0.004, int(ground.sum()))
    shell.apply_translation([0, 1.25, 0])
    pieces = {
        "worktop": ([1.8, 0.9, 0.6], [0, 0.45, -1.2]),
        "table": ([0.6, 0.45, 0.6], [-1.7, 0.225, 1.0]),
        "shelf": ([0.8, 0.03, 0.3], [1.2, 1.4, -1.35]),
        "bed": ([1.4, 0.5, 1.4], [1.3, 0.25, 0.8]),
    }
    scene = trimesh.Scene({"shell": shell})
    for name, (size, centre) in pieces.items():
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(centre)
        scene.add_geometry(mesh, geom_name=name)
    return scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("scans")
    (root / "flat-abcDEF").mkdir()
    furnished_room().export(root / "flat-abcDEF" / "abcDEF.glb")
    return root


@pytest.fixture(scope="module")
def scan(folder: Path) -> Scene:
    return load_scan("abcDEF", folder, {"kitchen": BOX})


def only(scan: Scene, kind: str) -> Support:
    (support,) = (s for s in scan.supports if s.kind == kind)
    return support


def test_a_scan_is_one_part_that_brings_its_own_light(scan: Scene) -> None:
    (part,) = scan.parts
    assert (part.name, part.instance_id, part.category, part.light) == ("abcDEF", 0, None, None)
    assert scan.room("kitchen").low == (-2.0, 0.0, -1.5)


@pytest.mark.parametrize("kind", some(["glb", "obj", "ply"], every=3))
def test_a_scan_is_its_pictures_and_neither_reflects_nor_shines(tmp_path: Path, kind: str) -> None:
    room = furnished_room()
    if kind == "ply":
        mesh = room.to_mesh()
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.full((len(mesh.vertices), 4), 200, np.uint8))
        mesh.export(tmp_path / "a.ply")
    elif kind == "obj":
        (tmp_path / "m.mtl").write_text("newmtl gloss\nKd 0.5 0.5 0.5\nKs 1 1 1\nNs 200\nKe 1 1 1\n")
        text = trimesh.exchange.obj.export_obj(room.to_mesh(), include_texture=False, include_color=False)
        (tmp_path / "a.obj").write_text(f"mtllib m.mtl\nusemtl gloss\n{text}")
    else:
        glow = trimesh.visual.material.PBRMaterial(emissiveFactor=[1, 1, 1], roughnessFactor=0.3, metallicFactor=0.0)
        for mesh in room.geometry.values():
            mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)), material=glow)
        room.export(tmp_path / "a.glb")
    (part,) = load_scan("a", tmp_path / f"a.{kind}", {"kitchen": BOX}).parts
    surfaces = LitSurfaces.of((part,))
    assert (surfaces.emission.max(), surfaces.specular.max()) == (0.0, 0.0)
    assert surfaces.colour.max() > 0


def test_the_floor_is_found(scan: Scene) -> None:
    floor = only(scan, "floor")
    assert floor.origin[1] == pytest.approx(0, abs=0.005)
    assert floor.normal == (0, 1, 0)
    area = np.linalg.norm(np.cross(floor.u, floor.v))
    assert area == pytest.approx(12)


@pytest.mark.parametrize(
    ("kind", "height", "low", "high", "front"),
    [
        ("worktop", 0.9, (-0.9, -1.5), (0.9, -0.9), (0, 0, 1)),
        ("side_table", 0.45, (-2.0, 0.7), (-1.4, 1.3), (1, 0, 0)),
        ("shelf", 1.415, (0.8, -1.5), (1.6, -1.2), (0, 0, 1)),
    ],
)
def test_tops_are_found_where_they_are_and_look_into_the_room(
    scan: Scene, kind: str, height: float, low: tuple[float, float], high: tuple[float, float], front: tuple[int, ...]
) -> None:
    top = only(scan, kind)
    corners = np.array(
        [np.array(top.origin) + a * np.array(top.u) + b * np.array(top.v) for a in (0, 1) for b in (0, 1)]
    )
    assert corners[:, 1] == pytest.approx(height, abs=0.002)
    # A 5 cm grid finds an edge to within one cell.
    assert corners.min(axis=0)[[0, 2]] == pytest.approx(low, abs=0.055)
    assert corners.max(axis=0)[[0, 2]] == pytest.approx(high, abs=0.055)
    assert top.front == front
    assert top.clearance >= 0.25
    assert top.room == "kitchen"


def test_a_bed_is_no_table(scan: Scene) -> None:
    assert all(abs(s.origin[1] - 0.5) > 0.02 for s in scan.supports)


def test_free_walls_point_into_the_room(scan: Scene) -> None:
    walls = [s for s in scan.supports if s.kind == "wall"]
    assert {s.normal for s in walls} == {(0, 0, 1), (1, 0, 0), (0, 0, -1), (-1, 0, 0)}
    for wall in walls:
        normal = np.array(wall.normal)
        assert normal @ np.array(wall.origin) == pytest.approx(-2.0 if normal[0] else -1.5, abs=0.002)
        assert wall.origin[1] >= 1.3 - 1e-6
        assert wall.origin[1] + wall.v[1] <= 2.1 + 1e-6
        assert wall.clearance >= 0.2
    # Where the shelf hangs, the wall is not free.
    behind = [s for s in walls if s.normal == (0, 0, 1)]
    assert not any(
        s.origin[0] < 1.2 < s.origin[0] + s.u[0] and s.origin[1] < 1.4 < s.origin[1] + s.v[1] for s in behind
    )


def test_surfaces_sound_by_where_they_are(folder: Path) -> None:
    plain = ScanAcoustics(furnished=False)
    mesh = load_scan("abcDEF", folder, {"kitchen": BOX}, acoustics=plain).parts[0].mesh
    middle = mesh.acoustic_positions.mean(axis=1)
    labels = np.array(mesh.acoustic_labels)
    assert set(labels[np.abs(middle[:, 1]) < 0.004]) == {"parquet"}
    assert set(labels[np.abs(middle[:, 1] - 0.9) < 0.004]) == {"wood"}
    assert set(labels[np.abs(middle[:, 1] - 2.5) < 0.004]) == {"plaster"}


def test_a_scan_with_z_up_is_turned(tmp_path: Path, scan: Scene) -> None:
    scene = furnished_room()
    # Y up, Z front → Z up, −Y front: x stays, y → z, z → −y.
    turn = np.eye(4)
    turn[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    scene.apply_transform(turn)
    scene.export(tmp_path / "z.glb")
    turned = load_scan("z", tmp_path / "z.glb", {"kitchen": BOX}, axes=Axes("z", "-y"))
    for kind in ("floor", "worktop", "side_table"):
        assert only(turned, kind).origin == pytest.approx(only(scan, kind).origin, abs=0.002)


def test_the_same_file_gives_the_same_scene(folder: Path, scan: Scene) -> None:
    again = load_scan("abcDEF", folder, {"kitchen": BOX})
    assert again.supports == scan.supports
    assert again.parts[0].mesh.positions.tobytes() == scan.parts[0].mesh.positions.tobytes()
    assert again.parts[0].mesh.acoustic_labels == scan.parts[0].mesh.acoustic_labels


def test_largest_rectangle_against_brute_force() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        mask = rng.random((7, 9)) < 0.7
        best = 0
        for r0 in range(7):
            for r1 in range(r0 + 1, 8):
                for c0 in range(9):
                    for c1 in range(c0 + 1, 10):
                        if mask[r0:r1, c0:c1].all():
                            best = max(best, (r1 - r0) * (c1 - c0))
        r, c, rows, columns = largest_rectangle(mask)
        assert rows * columns == best
        assert mask[r : r + rows, c : c + columns].all()


def test_rectangles_are_disjoint_and_large_enough() -> None:
    mask = np.random.default_rng(1).random((30, 30)) < 0.97
    cover = np.zeros_like(mask, dtype=int)
    for r, c, rows, columns in rectangles(mask, 4, 6):
        assert min(rows, columns) >= 4
        cover[r : r + rows, c : c + columns] += 1
    assert cover.max() == 1


@pytest.mark.parametrize(
    ("rooms", "message"),
    [
        ({}, "scan abcDEF: no rooms given"),
        ({"kitchen": [[0, 0, 0]]}, r"room kitchen: its box .* expected the lowest and highest corner"),
        ({"kitchen": [[0, 0, float("nan")], [1, 1, 1]]}, "expected the lowest and highest corner"),
        ({"kitchen": "here"}, "expected the lowest and highest corner"),
        ({"kitchen": [BOX[1], BOX[0]]}, r"thinner than 0.5 m"),
        ({"kitchen": [[50, 0, 50], [54, 3, 54]]}, r"lies outside the scan, which spans"),
        ({"kitchen": [[-2, 1.6, -1.5], [2, 2.4, 1.5]]}, "no floor found inside the room's box"),
    ],
)
def test_bad_rooms_are_named(folder: Path, rooms: dict[str, object], message: str) -> None:
    with pytest.raises(Avs3dError, match=message) as caught:
        load_scan("abcDEF", folder, rooms)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_unknown_scans_and_missing_files(folder: Path) -> None:
    with pytest.raises(Avs3dError, match=r"unknown scan 'xyz': no xyz\.glb .* below"):
        load_scan("xyz", folder, {"kitchen": BOX})
    with pytest.raises(Avs3dError, match=r"scan xyz: .*gone\.glb does not exist"):
        load_scan("xyz", folder / "gone.glb", {"kitchen": BOX})
