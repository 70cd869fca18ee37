"""Dense scans: what is found on the decimated copy is what is found on all faces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError
from generators.assets.acoustic_twin import weld
from generators.core.rays import RayCaster
from generators.core.scene import Material, Mesh, Room, Support, Texture
from generators.scans import decimation
from generators.scans.patches import find_supports
from generators.surveying.survey import survey
from tests.support.made_rooms import flat

ROOM = Room("living_room", (-2.0, 0.0, -1.5), (2.0, 2.5, 1.5))
FACES = 12_000


@pytest.fixture(autouse=True)
def _limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decimation, "DENSE", 2 * FACES)
    monkeypatch.setattr(decimation, "RAY_FACES", FACES)


def finely(triangles: NDArray[np.floating], edge: float, noise: float) -> NDArray[np.float32]:
    """(F, 3, 3) the surface in small faces, with noise of every vertex (m)."""
    mesh = trimesh.Trimesh(*weld(triangles.astype(np.float64)), process=False).subdivide_to_size(edge, max_iter=20)
    vertices, faces = weld(np.asarray(mesh.triangles))
    moved = vertices + np.random.default_rng(0).normal(0.0, noise, vertices.shape)
    return np.asarray(moved[faces], dtype=np.float32)


def mesh_of(triangles: NDArray[np.float32]) -> Mesh:
    """A mesh whose colour is bright to the right of the middle (x > 0)."""
    texture = Texture("halves", np.array([[[40, 40, 40], [200, 200, 200]]], dtype=np.uint8))
    middle = triangles.mean(axis=1)
    uv = np.full((len(triangles), 3, 2), 0.5, dtype=np.float32)
    uv[..., 0] = np.where(middle[:, :1] > 0, 0.75, 0.25)
    zero = np.zeros(len(triangles), dtype=np.int32)
    material = Material("photograph", "plaster", texture=texture)
    return Mesh(triangles, np.zeros_like(triangles), uv, zero, (material,), triangles, ("plaster",) * len(triangles))


@pytest.fixture(scope="module")
def furnished() -> NDArray[np.float32]:
    """A room with a table, a thin board on its wall and a low table."""
    shell = trimesh.creation.box([4.0, 2.5, 3.0])
    shell.invert()
    shell.apply_translation([0.0, 1.25, 0.0])
    pieces = [shell]
    for size, at in (
        ((1.2, 0.74, 0.7), (0.8, 0, 0.9)),
        ((0.9, 0.018, 0.28), (-0.5, 1.3, -1.36)),
        ((0.8, 0.45, 0.5), (-1, 0, 0.3)),
    ):
        piece = trimesh.creation.box(size)
        piece.apply_translation(np.add(at, (0, size[1] / 2, 0)))
        pieces.append(piece)
    return finely(np.asarray(trimesh.util.concatenate(pieces).triangles), 0.035, 0.001)


def tops(triangles: NDArray[np.float32]) -> list[Support]:
    found = [s for s in find_supports(triangles, ROOM, "test")[1] if s.kind not in ("floor", "wall")]
    return sorted(found, key=lambda support: support.origin[1])


@pytest.mark.slow
def test_supports_are_where_they_are_on_all_faces(furnished: NDArray[np.float32]) -> None:
    loaded = decimation.for_rays(mesh_of(furnished))
    assert loaded.dense is not None
    assert len(loaded.dense.positions) == len(furnished) > 2 * FACES
    assert FACES / 2 < len(loaded.mesh.positions) < 1.5 * FACES
    true, found = tops(furnished), tops(loaded.mesh.positions)
    assert [top.kind for top in found] == [top.kind for top in true] == ["side_table", "worktop", "shelf"]
    for one, other in zip(true, found, strict=True):
        assert abs(one.origin[1] - other.origin[1]) < 0.001
        sides = [[np.linalg.norm(top.u), np.linalg.norm(top.v)] for top in (one, other)]
        assert np.abs(np.subtract(*sides)).max() < 0.06


@pytest.mark.slow
def test_rays_meet_the_copy_where_they_meet_the_scan(furnished: NDArray[np.float32]) -> None:
    copy = decimation.for_rays(mesh_of(furnished)).mesh.positions
    rng = np.random.default_rng(1)
    points = rng.uniform((-1.9, 1.4, -1.0), (1.9, 2.4, 1.4), (2000, 3))
    rays = rng.normal(size=points.shape)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    one, other = (RayCaster(each).closest(points, rays)[0] for each in (furnished, copy))
    assert np.isfinite(one).all()
    assert np.isfinite(other).mean() > 0.999
    error = np.abs(one - other)
    assert np.median(error) < 0.001
    assert np.quantile(error, 0.95) < 0.005


@pytest.mark.slow
def test_a_face_of_the_copy_has_the_colour_of_the_scan_there(furnished: NDArray[np.float32]) -> None:
    copy = decimation.for_rays(mesh_of(furnished)).mesh
    middle = copy.positions.mean(axis=1)[:, 0]
    clear = np.abs(middle) > 0.04
    np.testing.assert_array_equal((copy.uv[:, 0, 0] > 0.5)[clear], (middle > 0)[clear])


def test_plain_walls_keep_small_faces() -> None:
    # Without noise, each wall would become two faces of one colour.
    shell = trimesh.creation.box([4.0, 2.5, 3.0])
    copy = decimation.for_rays(mesh_of(finely(np.asarray(shell.triangles), 0.04, 0.0))).mesh
    edges = np.linalg.norm(copy.positions[:, 0] - copy.positions[:, 1], axis=1)
    assert edges.max() < 0.35


@pytest.mark.slow
def test_the_copy_does_not_depend_on_the_unit_of_the_file(furnished: NDArray[np.float32]) -> None:
    metres, millimetres = (decimation.for_rays(mesh_of(scale * furnished)).mesh for scale in (1.0, 1000.0))
    assert abs(len(metres.positions) / len(millimetres.positions) - 1) < 0.01


@pytest.mark.slow
def test_rooms_are_found_as_on_all_faces() -> None:
    whole = finely(flat(("living_room", "kitchen"), rng=np.random.default_rng(1)), 0.07, 0.002)
    copy = decimation.for_rays(mesh_of(whole))
    assert copy.dense is not None
    one, other = (survey("test", each) for each in (whole, copy.mesh.positions))
    assert (one.up, one.scale, one.rooms) == (other.up, other.scale, other.rooms)
    assert abs(one.turn - other.turn) < 0.1
    for first, second in zip(one.boxes, other.boxes, strict=True):
        np.testing.assert_allclose((first.low, first.high), (second.low, second.high), atol=0.02)


def test_a_scan_below_the_limit_stays_as_it_is(furnished: NDArray[np.float32]) -> None:
    mesh = mesh_of(furnished[: 2 * FACES])
    loaded = decimation.for_rays(mesh)
    assert loaded.mesh is mesh
    assert loaded.dense is None


def test_a_process_that_cannot_decimate_gives_one_clear_line(
    furnished: NDArray[np.float32], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decimation, "_PROGRAM", "raise MemoryError('no room left')")
    with pytest.raises(
        Avs3dError, match=r"faces cannot be decimated \(MemoryError: no room left\); give it more memory"
    ):
        decimation.for_rays(mesh_of(furnished))
