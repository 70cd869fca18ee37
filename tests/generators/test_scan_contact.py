"""How objects rest on scanned surfaces: touching, not cutting in, tilted a little, on surfaces of known shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from generators.assets.catalogue import build_model, variants
from generators.core.boxes import yaw_matrix
from generators.core.scene import Material, Mesh, Part, Room, Scene, StageFile, Support
from generators.placement.contact import FLOAT, LEAN, Sole, _supporting_plane, settle
from generators.placement.placement import place
from generators.placement.site import Site
from generators.placement.spots import Spot
from tests.support.resting import gaps_below
from tests.support.tiers import some

FLOOR = Support("floor", "hall", (-1.5, 0.0, -1.5), (3.0, 0.0, 0.0), (0.0, 0.0, 3.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
WALL = Support("wall", "hall", (-1.5, 1.3, -1.5), (3.0, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))


def site(height, *, stage: bool = True, wall=lambda x, y: 0.0 * x, hole: float = 0.0) -> Site:
    """A hall of 3 × 3 m with a floor of ``height``(x, z) and a wall ``wall``(x, y) before z = −1.5, metres.

    ``hole`` is the radius of a hole in the middle of the floor.
    """
    side = np.linspace(-1.5, 1.5, 61)
    p, q = (g.reshape(-1) for g in np.meshgrid(side, side, indexing="ij"))
    index = np.arange(61 * 61).reshape(61, 61)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, b), (a, d, c))])
    ground = np.stack([p, height(p, q), q], axis=1)[faces]
    ground = ground[np.linalg.norm(ground[..., [0, 2]].mean(axis=1), axis=1) >= hole]
    upright = np.stack([p, q + 1.5, wall(p, q + 1.5) - 1.5], axis=1)[faces]
    box = trimesh.creation.box([3.0, 3.0, 3.0])
    sides = box.triangles[np.abs(box.face_normals[:, 1]) < 0.5] + [0.0, 1.5, 0.0]
    sides = sides[sides[:, :, 2].max(axis=1) > -1.4]
    triangles = np.concatenate([ground, upright, sides]).astype(np.float32)
    count = len(triangles)
    mesh = Mesh(
        triangles,
        np.zeros_like(triangles),
        np.zeros((count, 3, 2), dtype=np.float32),
        np.zeros(count, dtype=np.int32),
        (Material("plaster", "plaster"),),
        triangles[:1],
        ("plaster",),
    )
    room = Room("hall", (-1.5, 0.0, -1.5), (1.5, 3.0, 1.5))
    file = StageFile(Path("scan.glb")) if stage else None
    return Site.of(Scene("scan", (Part("scan", mesh),), (room,), (FLOOR, WALL), stage=file), "hall")


def noise(seed: int, scale: float):
    """Independent heights of the vertices."""
    return lambda p, q: np.random.default_rng(seed).normal(0.0, scale, p.shape)


def model(category: str):
    return build_model(category, variants(category)[0], np.random.default_rng(1))


def posed(mesh: Mesh, spot: Spot) -> Mesh:
    """The model at a spot, world coordinates."""
    turn = Rotation.from_rotvec(spot.tilt).as_matrix() @ yaw_matrix(spot.yaw)
    return mesh.transformed(turn, spot.position)


@pytest.mark.parametrize("category", some(["washing_machine", "kettle", "fan", "telephone"], every=4))
@pytest.mark.parametrize("scale", [0.0, 0.001, 0.003])
def test_objects_touch_a_noisy_floor_and_never_cut_into_it(category: str, scale: float) -> None:
    where, mesh = site(noise(3, scale)), model(category).mesh
    sole = Sole.of(mesh, wall=False)
    for number in range(8):
        x, z = np.random.default_rng(number).uniform(-0.8, 0.8, 2)
        start = np.array([x, -float(mesh.bounds[0, 1]), z])
        spot = settle(where, sole, Spot(FLOOR, start, 0.3 * number, 0.0))
        if isinstance(spot, str):
            assert scale == 0.003, "refused on a smooth floor"
            continue
        gap, height = gaps_below(posed(mesh, spot), where.caster)
        assert gap.min() > -0.0003 - 0.15 * scale, "cuts in between the measured points"
        assert gap.min() < 0.001, "touches nothing"
        assert np.median(gap[height < 0.01]) < FLOAT + scale + 0.003
        assert np.degrees(np.linalg.norm(spot.tilt)) <= LEAN + 1e-6


@pytest.mark.parametrize("slope", [0.01, 0.02])
def test_an_object_leans_with_the_floor(slope: float) -> None:
    where, mesh = site(lambda p, q: slope * p), model("washing_machine").mesh
    start = np.array([0.2, slope * 0.2, 0.1])
    spot = settle(where, Sole.of(mesh, wall=False), Spot(FLOOR, start, 0.7, 0.0))
    assert isinstance(spot, Spot)
    # Up to the right: turned about +Z.
    assert spot.tilt == pytest.approx((0.0, 0.0, np.arctan(slope)), abs=1e-4)
    gap, height = gaps_below(posed(mesh, spot), where.caster)
    assert np.abs(gap[height < 0.02]).min() < 0.0005
    assert gap.min() > -0.0005


def test_a_floor_that_slopes_too_much_a_step_and_a_hole_are_refused() -> None:
    mesh = model("washing_machine").mesh
    sole = Sole.of(mesh, wall=False)
    spot = Spot(FLOOR, np.array([0.0, 0.0, 0.0]), 0.0, 0.0)
    for height in (lambda p, q: 0.12 * p, lambda p, q: 0.03 * (p > 0.15), lambda p, q: 0.05 * ((p > 0.1) & (q > 0.1))):
        assert settle(site(height), sole, spot) == "float above a surface that is not flat"
    assert settle(site(noise(0, 0.0), hole=0.45), sole, spot) == "lie over a hole of the scan"
    assert isinstance(settle(site(noise(0, 0.0)), sole, spot), Spot)


def test_a_clock_hangs_on_the_wall_and_not_in_it() -> None:
    mesh = model("clock").mesh
    bumps = lambda x, y: 0.002 * np.sin(x * 9) * np.cos(y * 7) + 0.01 * x  # noqa: E731
    where = site(noise(0, 0.0), wall=bumps)
    low = float(mesh.bounds[0, 2])
    spot = settle(where, Sole.of(mesh, wall=True), Spot(WALL, np.array([0.3, 1.7, -1.495 - low]), 0.0, 0.0))
    assert isinstance(spot, Spot)
    gap, _ = gaps_below(posed(mesh, spot), where.caster, (0.0, 0.0, 1.0))
    assert -0.0005 < gap.min() < 0.001


def test_the_plane_of_rest_is_the_lowest_over_the_middle() -> None:
    """Against brute force over all planes through three points."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        places = rng.uniform(-0.3, 0.3, (12, 2))
        height = rng.uniform(0.0, 0.004, 12)
        found = _supporting_plane(places, height)
        assert found is not None
        above = (height - places @ found).max()
        best = np.inf
        for i in range(12):
            for j in range(i):
                for k in range(j):
                    rows = np.column_stack([places[[i, j, k]], np.ones(3)])
                    if abs(np.linalg.det(rows)) < 1e-6:
                        continue
                    plane = np.linalg.solve(rows, height[[i, j, k]])
                    over = (places @ plane[:2] + plane[2] >= height - 1e-9).all()
                    if over and np.abs(plane[:2]).max() <= np.tan(np.radians(LEAN)) / np.sqrt(2):
                        best = min(best, plane[2])
        assert above <= best + 1e-7
        if np.abs(found).max() < np.tan(np.radians(LEAN)) / np.sqrt(2) - 1e-9:
            assert above == pytest.approx(best, abs=1e-7)


def test_only_scans_tilt_objects() -> None:
    clean, scan = (site(lambda p, q: 0.008 * p, stage=stage) for stage in (False, True))
    for where, tilted in ((clean, False), (scan, True)):
        (placed,) = place(where, [model("vacuum_cleaner")], rng=np.random.default_rng(0))
        assert any(placed.tilt) == tilted
        turn = placed.rotation
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-9)
        if not tilted:
            assert turn.tobytes() == yaw_matrix(placed.yaw).tobytes()
        moved = placed.model.mesh.transformed(turn, np.asarray(placed.position))
        assert placed.mesh.positions.tobytes() == moved.positions.tobytes()
