"""Free space: every walkable point is far enough from all geometry, and every such point is walkable."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from shapely import distance as distance_between
from shapely import points as plan_points
from shapely.geometry import MultiPoint, Polygon

from avs3d_bench.errors import Avs3dError
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.freespace import (
    AGENT_RADIUS,
    CELL,
    FreeSpace,
    clip_to_band,
    distance_to_polygon,
    rasterise,
)
from generators.core.scene import Part, Room, Scene
from tests.support.rooms import PLAIN, Toy, kitchen

#: The raster's error bound and the distance between cell centres (diagonal).
SLACK = 0.04


def clearances(toy: Toy, points: np.ndarray) -> np.ndarray:
    """Exact plan distance to everything between 5 cm and 1.7 m."""
    return np.asarray(distance_between(toy.ground(), plan_points(points)))


def test_an_empty_room_is_walkable_up_to_the_agents_radius_from_its_walls() -> None:
    toy = Toy(size=(3.0, 2.5, 4.0)).shell()
    space = FreeSpace.of(toy.scene, "kitchen")
    expected = (3.0 - 2 * AGENT_RADIUS) * (4.0 - 2 * AGENT_RADIUS)
    assert space.area == pytest.approx(expected, abs=2 * (3 + 4) * SLACK)
    assert clearances(toy, space.points).min() >= AGENT_RADIUS
    assert space.labels.max() == 1


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(st.floats(0.3, 3.7), st.floats(0.3, 4.7), st.floats(0.02, 1.2), st.floats(0.02, 1.2)),
        min_size=1, max_size=6,
    ),
    st.floats(0.06, 1.5),
)  # fmt: skip
def test_walkable_means_far_from_everything_and_only_that(blocks: list[tuple[float, ...]], height: float) -> None:
    toy = Toy(size=(4.0, 2.5, 5.0)).shell()
    for x, z, w, d in blocks:
        toy.add((x - w / 2, 0.0, z - d / 2), (x + w / 2, height, z + d / 2))
    space = FreeSpace.of(toy.scene, "kitchen")
    if len(space.points):
        assert clearances(toy, space.points).min() >= AGENT_RADIUS
    centres = space.cell_centres()
    inside = ((centres > 0) & (centres < (4.0, 5.0))).all(axis=1)
    roomy = inside & (clearances(toy, centres) >= AGENT_RADIUS + SLACK)
    assert space.walkable.reshape(-1)[roomy].all()


@settings(max_examples=25)
@given(st.floats(-180, 180), st.floats(0.1, 1.0), st.integers(0, 2**32 - 1))
def test_clearance_is_a_close_lower_bound(angle: float, size: float, seed: int) -> None:
    plan = np.array([[-size, -0.1], [size, -0.1], [size, 0.1], [-size, 0.1]]) @ rotation("z", angle)[:2, :2].T + 2.0
    builder = MeshBuilder().quad([(0, 0, 4), (4, 0, 4), (4, 0, 0), (0, 0, 0)], PLAIN)
    builder.extrude(plan, 1.0, PLAIN, rotate=np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]))
    scene = Scene("toy", (Part("room", builder.build()),), (Room("hall", (0, 0, 0), (4, 2.5, 4)),), ())
    space = FreeSpace.of(scene, "hall")
    points = np.random.default_rng(seed).uniform(0, 4, (300, 2))
    exact = distance_to_polygon(points, plan)
    assert exact == pytest.approx(distance_between(Polygon(plan), plan_points(points)), abs=1e-9)
    bound = space.clearance(points)
    assert (bound <= exact + 1e-6).all()
    assert (bound >= exact - SLACK).all()


@pytest.mark.parametrize(
    ("low", "high", "blocks"),
    [
        (0.0, 0.02, False),  # a rug
        (1.72, 2.3, False),  # a wall cupboard, a lamp
        (0.70, 0.75, True),  # a table top
        (1.60, 2.3, True),  # a low lamp
        (0.0, 0.12, True),  # a step
    ],
)  # fmt: skip
def test_what_is_stepped_over_or_walked_under(low: float, high: float, blocks: bool) -> None:
    toy = Toy(size=(3.0, 2.5, 3.0)).shell().add((1.0, low, 1.0), (2.0, high, 2.0))
    space = FreeSpace.of(toy.scene, "kitchen")
    assert bool(space.contains([[1.5, 1.5]])[0]) is not blocks


def test_a_hole_in_the_floor_is_not_walked_over() -> None:
    builder = MeshBuilder().quad([(0, 0, 4), (2, 0, 4), (2, 0, 0), (0, 0, 0)], PLAIN)
    builder.quad([(0, -1, 4), (4, -1, 4), (4, -1, 0), (0, -1, 0)], PLAIN)
    scene = Scene("toy", (Part("floor", builder.build()),), (Room("hall", (0, 0, 0), (4, 2.5, 4)),), ())
    space = FreeSpace.of(scene, "hall")
    assert space.contains([[1.0, 2.0]])[0]
    assert not space.contains([[3.0, 2.0]])[0]


@settings(max_examples=60)
@given(
    st.lists(st.tuples(*[st.integers(-500, 500)] * 3), min_size=3, max_size=3),
    st.floats(-0.8, 0.0),
    st.floats(0.01, 0.8),
)
def test_clipping_a_triangle_to_a_band(corners: list[tuple[int, ...]], low: float, high: float) -> None:
    triangle = np.array(corners) / 500
    whole, outlines = clip_to_band(triangle[None], low, high)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), 4000)
    samples = weights @ triangle
    kept = samples[(samples[:, 1] >= low) & (samples[:, 1] <= high)][:, [0, 2]]
    if not len(whole) + len(outlines):
        assert not len(kept)
        return
    outline = MultiPoint(whole[0] if len(whole) else outlines[0]).convex_hull
    if len(kept):
        assert np.max(distance_between(outline, plan_points(kept))) <= 1e-5
    # … and nothing more: every corner of the outline is a point of the triangle within the band.
    shadow = MultiPoint(triangle[:, [0, 2]]).convex_hull
    assert shadow.buffer(1e-5).covers(outline)


def test_the_raster_is_a_cell_exact_for_large_and_for_tiny_triangles() -> None:
    triangle = np.array([[[0.1, 0.1], [0.9, 0.2], [0.4, 0.8]]])
    fine = triangle
    for _ in range(7):
        a, b, c = (fine[:, k] for k in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        fine = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    cell, shape = 0.0125, (80, 80)
    centres = (np.argwhere(np.ones(shape)) + 0.5) * cell
    samples = np.random.default_rng(0).dirichlet(np.ones(3), 5000) @ triangle[0]
    for mask in (rasterise(t, [], np.zeros(2), shape, cell) for t in (triangle, fine)):
        marked = centres[mask.reshape(-1)]
        assert cKDTree(marked).query(samples)[0].max() <= cell
        assert distance_between(Polygon(triangle[0]), plan_points(marked)).max() <= cell


def test_a_gap_narrower_than_the_agent_parts_the_room() -> None:
    def parted(gap: float) -> FreeSpace:
        toy = Toy(size=(4.0, 2.5, 4.0)).shell()
        toy.add((0, 0, 1.9), (2.0, 2.5, 2.1)).add((2.0 + gap, 0, 1.9), (4.0, 2.5, 2.1))
        return FreeSpace.of(toy.scene, "kitchen")

    narrow, wide = parted(0.38), parted(0.60)
    assert narrow.labels.max() == 2
    assert wide.labels.max() == 1
    assert narrow.largest().area == pytest.approx(narrow.area / 2, rel=0.1)
    with pytest.raises(Avs3dError, match="separate pieces"):
        narrow.paths([[2.0, 0.5], [2.0, 3.5]])
    (path,) = wide.paths([[0.5, 0.5], [0.5, 3.5]])
    assert wide.contains(path).all()
    assert path[:, 0].max() > 2.0


def test_paths_are_nearly_the_shortest_and_stay_in_free_space() -> None:
    toy = Toy(size=(5.0, 2.5, 5.0)).shell().add((1.5, 0, 0.0), (2.0, 2.5, 3.5))
    space = FreeSpace.of(toy.scene, "kitchen")
    ends = np.array([[0.5, 0.5], [4.0, 0.5]])
    (path,) = space.paths(ends)
    corners = np.array([ends[0], [1.3, 3.7], [2.2, 3.7], ends[1]])
    shortest = np.linalg.norm(np.diff(corners, axis=0), axis=1).sum()
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    # Eight directions cost up to 8 %, keeping off the wall a little more.
    assert shortest * 0.98 <= length <= shortest * 1.15
    assert np.linalg.norm(path[[0, -1]] - ends, axis=1).max() <= CELL
    assert space.contains(path).all()


def test_adjoining_rooms_join_through_their_doorway() -> None:
    toy = Toy("kitchen", (4.0, 2.5, 3.0)).shell(door=(1.5, 2.4)).add((0, 0, 6.12), (4.0, 2.5, 6.3))
    toy.add((-0.12, 0, 3), (0, 2.5, 6.2)).add((4, 0, 3), (4.12, 2.5, 6.2)).add((-1, -0.1, 3), (5, 0, 7))
    rooms = (*toy.scene.rooms, Room("hall", (0, 0, 3.12), (4, 2.5, 6.12)))
    scene = Scene("toy", toy.scene.parts, rooms, ())
    alone, both = FreeSpace.of(scene, "kitchen"), FreeSpace.of(scene, "kitchen", adjoining=["hall"])
    assert alone.points[:, 1].max() < 3.0
    assert both.points[:, 1].max() > 5.5
    (path,) = both.paths([[1.0, 1.0], [1.0, 5.0]])
    assert both.contains(path).all()


def test_without_keeps_a_distance_from_rectangles() -> None:
    space = FreeSpace.of(Toy(size=(3.0, 2.5, 3.0)).shell().scene, "kitchen")
    rectangle = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])
    left = space.without([rectangle], 0.35)
    assert distance_to_polygon(left.points, rectangle).min() >= 0.35
    gone = space.area - left.area
    assert gone == pytest.approx(1 + 4 * 0.35 + np.pi * 0.35**2, rel=0.05)


def test_bad_rooms_are_named() -> None:
    scene = kitchen().scene
    with pytest.raises(Avs3dError, match="no room 'attic'"):
        FreeSpace.of(scene, "attic")
    flat = Scene("toy", scene.parts, (Room("flat", (0, 0, 0), (4, 0, 5)),), ())
    with pytest.raises(Avs3dError, match="'flat' measures"):
        FreeSpace.of(flat, "flat")
    away = Scene("toy", scene.parts, (Room("moon", (90, 0, 0), (94, 2, 5)),), ())
    with pytest.raises(Avs3dError, match="no geometry"):
        FreeSpace.of(away, "moon")
