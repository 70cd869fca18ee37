"""What carries things in a scanned room, on meshes whose truth is known: tables, seats, cushions, slopes, walls."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from generators.core.rays import RayCaster
from generators.core.scene import Room, Support
from generators.scans.flatness import flatness
from generators.scans.layers import cast_down, find_floor
from generators.scans.patches import find_supports, scan_rays
from generators.scans.tops import fault, find_patches
from tests.support.tiers import some

ROOM = Room("living_room", (-2.0, 0.0, -1.5), (2.0, 2.5, 1.5))
#: A vertex of a scan every 5 cm.
EDGE = 0.05


def shell() -> trimesh.Trimesh:
    """4 × 2.5 × 3 m, seen from inside."""
    box = trimesh.creation.box([4.0, 2.5, 3.0])
    box.invert()
    box.apply_translation([0.0, 1.25, 0.0])
    return box


def box(size: tuple[float, float, float], at: tuple[float, float, float], *, yaw: float = 0.0, tilt: float = 0.0):
    """A box with the middle of its lower side at ``at``, turned about the vertical, then tilted about X (degrees)."""
    mesh = trimesh.creation.box(list(size))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(yaw), [0, 1, 0]))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(tilt), [1, 0, 0]))
    mesh.apply_translation([at[0], at[1] + size[1] / 2, at[2]])
    return mesh


def scanned(*pieces: trimesh.Trimesh, noise: float = 0.0) -> NDArray[np.float32]:
    """(F, 3, 3) the pieces in the room, with noise of every vertex."""
    mesh = trimesh.util.concatenate([shell(), *pieces])
    mesh.merge_vertices()
    mesh = mesh.subdivide_to_size(EDGE, max_iter=20)
    mesh.merge_vertices()
    moved = mesh.vertices + np.random.default_rng(0).normal(0.0, noise, mesh.vertices.shape)
    return np.asarray(moved[mesh.faces], dtype=np.float32)


def tops(triangles: NDArray[np.float32]) -> list[Support]:
    _, supports = find_supports(triangles, ROOM, "test")
    return [s for s in supports if s.kind not in ("floor", "wall")]


def faults(triangles: NDArray[np.float32]) -> list[str]:
    """Of the patches that are found, whatever they are."""
    caster = RayCaster(triangles)
    layers = cast_down(caster, ROOM)
    around = scan_rays(caster, layers, find_floor(layers, "test"))
    return [fault(patch, around) for patch in find_patches(layers, around)]


TABLE = box((1.0, 0.45, 0.6), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("noise", some([0.002, 0.0, 0.004], every=3))
def test_a_table_is_found_whatever_the_noise(noise: float) -> None:
    (top,) = tops(scanned(TABLE, noise=noise))
    assert top.kind == "side_table"
    assert top.origin[1] == pytest.approx(0.45, abs=max(0.001, noise))
    assert np.linalg.norm(top.u) * np.linalg.norm(top.v) > 0.85 * 0.6


@pytest.mark.parametrize(("height", "kind"), some([(0.4, "side_table"), (0.75, "worktop"), (0.9, "worktop")], every=3))
def test_tables_are_named_by_their_height(height: float, kind: str) -> None:
    (top,) = tops(scanned(box((1.0, height, 0.6), (0.0, 0.0, 0.0))))
    assert top.kind == kind


def test_a_table_that_stands_askew_is_as_large_as_one_that_does_not() -> None:
    (top,) = tops(scanned(box((1.0, 0.45, 0.6), (0.0, 0.0, 0.0), yaw=30.0)))
    u, v = np.asarray(top.u), np.asarray(top.v)
    assert np.linalg.norm(u) * np.linalg.norm(v) > 0.85 * 0.6
    assert u @ v == pytest.approx(0.0, abs=1e-3)
    turn = np.degrees(np.arctan2(u[2], u[0])) % 90
    assert min(abs(turn - 60), abs(turn - 30)) < 2
    corners = np.array([np.asarray(top.origin) + a * u + b * v for a in (0, 1) for b in (0, 1)])
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    local = corners[:, [0, 2]] @ np.array([[c, s], [-s, c]])
    assert (np.abs(local) <= np.array([0.5, 0.3]) + 0.03).all()


@pytest.mark.parametrize(("tilt", "found"), some([(1.5, 1), (0.0, 1), (4.0, 0), (8.0, 0)], every=2))
def test_a_slope_carries_nothing(tilt: float, found: int) -> None:
    assert len(tops(scanned(box((1.0, 0.45, 0.6), (0.0, 0.0, 0.0), tilt=tilt)))) == found


def waving(height: float) -> trimesh.Trimesh:
    """A block with a top that waves by ``height`` metres every 30 cm, as a cushion does."""
    mesh = box((1.0, 0.45, 0.6), (0.0, 0.0, 0.0)).subdivide_to_size(EDGE, max_iter=20)
    x, y, z = mesh.vertices.T
    up = y > 0.44
    mesh.vertices[up, 1] += height * (np.sin(x * 2 * np.pi / 0.3) * np.cos(z * 2 * np.pi / 0.3))[up]
    return mesh


@pytest.mark.parametrize(("height", "found"), some([(0.012, 0), (0.002, 1)], every=2))
def test_a_cushion_carries_nothing_even_without_a_back(height: float, found: int) -> None:
    assert len(tops(scanned(waving(height)))) == found


def test_waves_are_told_from_noise() -> None:
    rng = np.random.default_rng(0)
    x = np.arange(60) * 0.01
    wave = np.broadcast_to(0.006 * np.sin(x * 2 * np.pi / 0.3)[:, None], (60, 60))
    noise = rng.normal(0.0, 0.006, (60, 60))
    known = np.ones((60, 60), dtype=bool)
    assert flatness(noise, known, 0.01).wave < 0.0015
    assert flatness(wave, known, 0.01).wave > 0.0035
    both = flatness(wave + noise + 0.02 * x, known, 0.01)
    assert both.wave > 0.0035
    assert both.tilt == pytest.approx(np.degrees(np.arctan(0.02)), abs=0.35)


def seat(width: float, *, back: float, lean: float = 0.0) -> trimesh.Trimesh:
    """A hard seat 0.45 m high and 0.5 m deep, with a back that rises ``back`` metres above it."""
    base = box((width, 0.45, 0.5), (0.0, 0.0, 0.0))
    if not back:
        return base
    return trimesh.util.concatenate([base, box((width, 0.45 + back, 0.1), (0.0, 0.0, -0.31), tilt=-lean)])


@pytest.mark.parametrize("width", some([0.45, 1.6], every=2))
@pytest.mark.parametrize("lean", some([15.0, 0.0], every=2))
def test_a_seat_is_known_by_its_back(width: float, lean: float) -> None:
    assert tops(scanned(seat(width, back=0.4, lean=lean), noise=0.002)) == []
    assert "is a seat: a back rises behind it" in faults(scanned(seat(width, back=0.4, lean=lean), noise=0.002))


def test_without_a_back_the_same_bench_is_a_table() -> None:
    assert len(tops(scanned(seat(1.6, back=0.0), noise=0.002))) == 1


def test_a_table_against_a_wall_has_no_back() -> None:
    (top,) = tops(scanned(box((1.0, 0.45, 0.5), (0.0, 0.0, -1.25)), noise=0.002))
    assert top.front == pytest.approx((0.0, 0.0, 1.0), abs=0.05)


def test_a_sofa_beside_a_table_makes_it_no_seat() -> None:
    # The arm is 20 cm higher than the table, and there is a gap between them.
    sofa = box((0.8, 0.65, 0.6), (0.0, 0.0, -0.72))
    found = tops(scanned(box((0.6, 0.45, 0.6), (0.0, 0.0, 0.0)), sofa, noise=0.002))
    assert [s for s in found if abs(s.origin[1] - 0.45) < 0.01]


@pytest.mark.slow
def test_a_bed_is_none_however_flat() -> None:
    assert tops(scanned(box((1.4, 0.5, 2.0), (1.2, 0.0, 0.3)))) == []
    assert tops(scanned(box((0.85, 0.5, 1.6), (1.2, 0.0, 0.3)))) == []


@pytest.mark.slow
def test_a_board_at_a_wall_is_a_shelf_and_one_that_hangs_is_none() -> None:
    at_wall = box((0.8, 0.03, 0.3), (0.0, 1.4, -1.35))
    hanging = box((0.5, 0.03, 0.5), (0.0, 1.5, 0.0))
    (shelf,) = tops(scanned(at_wall))
    assert shelf.kind == "shelf"
    assert tops(scanned(hanging)) == []
    assert "hangs in the room" in faults(scanned(hanging))


def test_the_inside_of_a_tub_carries_nothing() -> None:
    sides = [
        box((0.05, 0.75, 0.6), (0.4, 0.0, 0.0)),
        box((0.05, 0.75, 0.6), (-0.4, 0.0, 0.0)),
        box((0.85, 0.75, 0.05), (0.0, 0.0, 0.3)),
        box((0.85, 0.75, 0.05), (0.0, 0.0, -0.3)),
    ]
    tub = [box((0.75, 0.45, 0.55), (0.0, 0.0, 0.0)), *sides]
    assert all(abs(s.origin[1] - 0.45) > 0.02 for s in tops(scanned(*tub)))


# ---- walls --------------------------------------------------------------------------------------------------------


def front(depth: NDArray[np.float64]) -> trimesh.Trimesh:
    """A surface before the wall at z = −1.5: ``depth`` (X, Y) metres before it, from floor to ceiling, 2 cm apart."""
    x, y = np.linspace(-1.99, 1.99, depth.shape[0]), np.linspace(0.02, 2.48, depth.shape[1])
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), depth - 1.5], axis=-1).reshape(-1, 3)
    index = np.arange(depth.size).reshape(depth.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return trimesh.Trimesh(points, faces, process=False)


def behind(triangles: NDArray[np.float32]) -> list[Support]:
    """The walls found on the side of z = −1.5."""
    _, supports = find_supports(triangles, ROOM, "test")
    return [s for s in supports if s.kind == "wall" and s.normal[2] > 0.9]


X = np.linspace(-2.0, 2.0, 200)


@pytest.mark.slow
def test_a_curtain_and_the_backs_of_books_are_no_wall() -> None:
    folds = 0.08 + 0.025 * np.sin(X * 2 * np.pi / 0.16)
    rng = np.random.default_rng(0)
    books = np.repeat(rng.uniform(0.18, 0.24, (100, 8)), 2, axis=0)
    assert behind(scanned(front(np.broadcast_to(folds[:, None], (200, 120))))) == []
    assert behind(scanned(front(np.repeat(books, 15, axis=1)))) == []


@pytest.mark.slow
def test_a_wall_that_bows_and_one_that_is_turned_are_walls() -> None:
    bowed = 0.05 + 0.01 * np.cos(X * np.pi / 2)
    turned = 0.2 + np.tan(np.radians(4)) * X
    for depth in (bowed, turned):
        walls = behind(scanned(front(np.broadcast_to(depth[:, None], (200, 120))), noise=0.001))
        assert max(np.linalg.norm(s.u) for s in walls) > 1.5
    # The support is turned with the wall.
    (wall, *_) = walls
    assert np.degrees(np.arctan2(wall.normal[0], wall.normal[2])) == pytest.approx(-4.0, abs=0.5)
    places = np.asarray(wall.origin) + np.linspace(0, 1, 5)[:, None] * np.asarray(wall.u)
    assert places[:, 2] == pytest.approx(-1.3 + np.tan(np.radians(4)) * places[:, 0], abs=0.003)
