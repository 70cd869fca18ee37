"""The 3D figures: voxels of meshes against closed forms and exact clipping, scores of clouds, limits."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from evaluators.metrics.volume import VOXEL_SIZE, TrueVolume, _overlaps, score_points, true_volume

H = VOXEL_SIZE

# --- Meshes -----------------------------------------------------------------------------------------------------------

#: Corners of the unit cube, number = 4x + 2y + z, and its twelve triangles, seen counter-clockwise from outside.
CUBE = np.array(list(itertools.product([0.0, 1.0], repeat=3)))
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(low) + CUBE * (np.array(high) - np.array(low)), CUBE_FACES


def sphere(radius: float, centre: tuple[float, float, float], rings: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Latitudes and longitudes; the poles' triangles have no area."""
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    unit = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=-1)
    number = np.arange(polar.size).reshape(polar.shape)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return unit.reshape(-1, 3) * radius + centre, faces


def centres(marked: np.ndarray, truth: TrueVolume) -> np.ndarray:
    """(N, 3) metres: centres of the marked voxels of the grid."""
    return (np.argwhere(marked) + np.array(truth.origin) + 0.5) * truth.size


def on_surface(vertices: np.ndarray, faces: np.ndarray, step: float) -> np.ndarray:
    """Points on every triangle, at most ``step`` apart in either direction, its edges included."""
    out = []
    for a, b, c in vertices[faces]:
        count = max(1, math.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / step))
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        u, v = i[i + j <= count] / count, j[i + j <= count] / count
        out.append(a + u[:, None] * (b - a) + v[:, None] * (c - a))
    return np.concatenate(out)


# --- Surface and interior against closed forms ------------------------------------------------------------------------


def test_a_cube_between_the_planes_has_a_shell_and_a_core():
    # From within voxel 1 to within voxel 5 along each axis.
    truth = true_volume(*box((0.06, 0.06, 0.06), (0.29, 0.29, 0.29)))
    assert truth.origin == (1, 1, 1)
    assert truth.surface.shape == (5, 5, 5)
    assert truth.surface.sum() == 5**3 - 3**3
    assert truth.interior.sum() == 3**3
    assert truth.interior[1:4, 1:4, 1:4].all()
    assert truth.centroid == pytest.approx((0.175, 0.175, 0.175))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shift", [-40, -3, 0, 7, 130])
def test_a_face_on_a_plane_between_voxels_belongs_to_the_upper_one(shift: int, dtype: type):
    # 0.05 is no binary fraction: 0.15 / 0.05 is below 3, and float32 errs either way. None of that may decide.
    low, high = shift * H, (shift + 4) * H
    vertices, faces = box((low,) * 3, (high,) * 3)
    truth = true_volume(vertices.astype(dtype), faces)
    # Faces at `shift` and at `shift + 4`: five voxels along each axis.
    assert truth.origin == (shift,) * 3
    assert truth.surface.shape == (5, 5, 5)
    assert truth.surface.sum() == 5**3 - 3**3
    dense = on_surface(vertices.astype(dtype).astype(np.float64), faces, 0.01)
    assert score_points(dense.astype(np.float32), truth).iou == 1.0
    assert score_points(dense, truth).iou == 1.0


@pytest.mark.parametrize(("radius", "centre"), [(0.5, (0.0, 0.0, 0.0)), (0.613, (3.21, 1.234, -7.77))])
def test_a_sphere_encloses_its_volume_to_within_a_voxel(radius: float, centre: tuple[float, float, float]):
    truth = true_volume(*sphere(radius, centre))
    inside, all_ = truth.interior.sum() * H**3, (truth.interior | truth.surface).sum() * H**3

    def ball(r: float) -> float:
        return 4 / 3 * math.pi * r**3

    # A voxel with a point of the surface reaches at most its diagonal to either side; the mesh lies 1 mm within.
    reach = H * math.sqrt(3) + 0.001
    assert ball(radius - reach) < inside < ball(radius) < all_ < ball(radius + reach)
    # A plane with the unit normal n meets |n_x| + |n_y| + |n_z| voxels per area of a voxel's side, the width of a voxel
    # along n. Over all directions that is 3/2 in the mean.
    area = 4 * math.pi * radius**2
    assert truth.surface.sum() * H**2 / area == pytest.approx(1.5, rel=0.04)
    assert truth.centroid == pytest.approx(centre, abs=0.002)
    assert not (truth.interior & truth.surface).any()


def test_an_open_mesh_encloses_nothing():
    vertices, faces = box((0.01, 0.01, 0.01), (0.34, 0.34, 0.34))
    closed = true_volume(vertices, faces)
    without_lid = true_volume(vertices, faces[[f for f in range(12) if f not in (6, 7)]])
    assert closed.interior.sum() == 5**3
    assert without_lid.interior.sum() == 0
    # What the lid alone held is missing; its rim belongs to the walls.
    assert closed.surface.sum() - without_lid.surface.sum() == 5 * 5
    assert score_points(centres(without_lid.surface, without_lid), without_lid).iou == 1.0


def test_the_centroid_is_that_of_the_voxels_however_the_mesh_is_cut():
    vertices, faces = box((0.0, 0.0, 0.0), (1.0, 2.0, 0.5))
    # One wall made of many triangles, some of them without area, and vertices that no face names.
    extra = np.array([[0.0, 0.5, 0.25], [99.0, 99.0, 99.0]])
    a, b, c = faces[0]
    split = [[a, b, 8], [b, c, 8], [c, a, 8], [a, a, b], [c, c, c]]
    truth = true_volume(np.concatenate([vertices, extra]), np.concatenate([faces[1:], split]))
    # Faces on planes between voxels belong to the upper ones: 21 × 41 × 11 voxels, half a voxel up.
    assert truth.centroid == pytest.approx((0.525, 1.025, 0.275))
    assert truth.centroid == true_volume(vertices, faces).centroid
    perfect = on_surface(vertices, faces, 0.01)
    assert score_points(perfect, truth).centroid_error == pytest.approx(0, abs=1e-9)


def test_a_triangle_without_area_counts_as_the_segment_it_is():
    vertices, faces = box((0.01, 0.01, 0.01), (0.04, 0.04, 0.04))
    needle = np.array([[0.02, 0.02, 0.02], [0.02, 0.02, 0.52], [0.02, 0.02, 0.27]])
    truth = true_volume(np.concatenate([vertices, needle]), np.concatenate([faces, [[8, 9, 10]]]))
    assert truth.surface.shape == (1, 1, 11)
    assert truth.surface.all()
    assert truth.centroid == pytest.approx((0.025, 0.025, 0.275))


# --- The overlap test against exact clipping --------------------------------------------------------------------------


def clipped(triangle: np.ndarray, edge: int) -> bool:
    """Whether a triangle holds a point of [0, edge)³: clip it by the closed box (Sutherland & Hodgman), in fractions.

    What remains is a convex polygon. It has a point off an open side if one of its corners is off that side; the mean
    of the corners is then off all open sides that any corner is off.
    """
    polygon = [[Fraction(int(c)) for c in corner] for corner in triangle]
    for axis in range(3):
        for sign, bound in ((1, 0), (-1, -edge)):
            kept = []
            for now, after in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                d0, d1 = sign * now[axis] - bound, sign * after[axis] - bound
                if d0 >= 0:
                    kept.append(now)
                if (d0 > 0 > d1) or (d0 < 0 < d1):
                    t = d0 / (d0 - d1)
                    kept.append([p + t * (q - p) for p, q in zip(now, after, strict=True)])
            polygon = kept
    return bool(polygon) and all(any(corner[axis] < edge for corner in polygon) for axis in range(3))


@pytest.mark.slow
@given(st.lists(st.tuples(*[st.integers(-7, 11)] * 3), min_size=3, max_size=3))
@settings(max_examples=1500)
def test_the_overlap_of_triangle_and_half_open_box_is_exact(corners: list[tuple[int, int, int]]):
    # A box of 4 units: corners, edges and sides are met all the time, and triangles without area too.
    triangle = np.array(corners, dtype=np.int64)
    assert bool(_overlaps(triangle[None], 4)[0]) is clipped(triangle, 4)


def test_the_overlap_test_survives_the_largest_triangles():
    # Three corners of the largest cube, off a box in its middle by one unit of 10 µm, or on it.
    size = 600_000
    for offset, expected in ((0, True), (-1, False)):
        plane = np.array([[size, 0, 0], [0, size, 0], [0, 0, size]], dtype=np.int64)
        corner = np.array([size // 4, size // 4, size // 2 - offset], dtype=np.int64)
        # The plane x + y + z = size touches the box in its lowest corner.
        assert bool(_overlaps((plane - corner)[None], 5_000)[0]) is expected


@given(st.lists(st.tuples(*[st.integers(-40, 40)] * 3), min_size=3, max_size=3), st.sampled_from([0.02, 0.05]))
@settings(max_examples=100)
def test_points_of_a_triangle_lie_in_its_voxels(corners: list[tuple[int, int, int]], size: float):
    vertices, faces = np.array(corners) / 100, np.array([[0, 1, 2]])
    if len(np.unique(vertices, axis=0)) < 3 or np.linalg.matrix_rank(vertices[1:] - vertices[0]) < 2:
        return
    truth = true_volume(vertices, faces, size=size)
    dense = on_surface(vertices, faces, 0.005)
    local = np.floor(np.round(dense / size, 6)).astype(int) - truth.origin
    # A point off its triangle by rounding may land on the other side of a plane that it is near, not on.
    clear = (np.abs(dense / size - np.round(dense / size)) > 1e-3).all(axis=1)
    assert truth.surface[tuple(local[clear].T)].all()


# --- Scores -----------------------------------------------------------------------------------------------------------

BOX = true_volume(*box((0.06, 0.06, 0.06), (0.44, 0.44, 0.44)))


def test_the_surface_the_solid_and_anything_between_score_one():
    surface, solid = centres(BOX.surface, BOX), centres(BOX.surface | BOX.interior, BOX)
    assert score_points(surface, BOX).iou == 1.0
    assert score_points(solid, BOX).iou == 1.0
    assert score_points(np.concatenate([surface, solid[::7]]), BOX).iou == 1.0
    assert score_points(surface, BOX).centroid_error == pytest.approx(0, abs=1e-9)


def test_the_inside_alone_is_neither_right_nor_wrong():
    score = score_points(centres(BOX.interior, BOX), BOX)
    assert score.iou == 0.0
    assert score.centroid_error == pytest.approx(0, abs=1e-9)


def test_half_of_a_surface_scores_half():
    points = centres(BOX.surface, BOX)
    half = points[points[:, 0] < 0.25]
    assert score_points(half, BOX).iou == len(half) / len(points) == 0.5
    # Half of a box is a U: its centroid lies nearer to the base than a quarter of the depth.
    assert score_points(half, BOX).centroid_error == pytest.approx(0.25 - half[:, 0].mean())


def test_what_lies_outside_widens_the_union():
    surface = centres(BOX.surface, BOX)
    stray = np.array([[2.0, 2.0, 2.0], [-3.0, 0.0, 0.0]])
    assert score_points(np.concatenate([surface, stray]), BOX).iou == len(surface) / (len(surface) + 2)


def test_one_point():
    count = int(BOX.surface.sum())
    assert score_points([[0.06, 0.06, 0.06]], BOX).iou == 1 / count
    assert score_points([[5.0, 5.0, 5.0]], BOX).iou == 0.0
    # The voxel's centre stands for the point.
    assert score_points([[0.251, 0.251, 1.251]], BOX).centroid_error == pytest.approx(math.hypot(0.025, 0.025, 1.025))


def test_shifted_by_a_metre_it_is_off_by_a_metre():
    score = score_points(centres(BOX.surface, BOX) + [1.0, 0.0, 0.0], BOX)
    assert score.iou == 0.0
    assert score.centroid_error == pytest.approx(1.0, abs=1e-9)


def test_nothing_predicted():
    score = score_points(np.zeros((0, 3), np.float32), BOX)
    assert (score.iou, score.centroid_error) == (0.0, None)


def test_a_dense_sampling_of_a_sphere_scores_nearly_one():
    vertices, faces = sphere(0.4, (1.0, 1.0, 1.0))
    truth = true_volume(vertices, faces)
    # Voxels of which the surface cuts only a corner may get no point; none lies elsewhere.
    score = score_points(on_surface(vertices, faces, 0.004), truth)
    assert 0.98 < score.iou <= 1.0
    assert score.centroid_error is not None
    assert score.centroid_error < 0.002


#: In whole millimetres.
clouds = st.lists(st.tuples(*[st.integers(-200, 700).map(lambda mm: mm / 1000)] * 3), min_size=1, max_size=60)


@given(clouds, st.randoms(use_true_random=False))
def test_order_and_repetition_of_points_change_nothing(cloud: list[tuple[float, float, float]], random):
    shuffled = cloud + random.choices(cloud, k=len(cloud))
    random.shuffle(shuffled)
    assert score_points(shuffled, BOX) == score_points(cloud, BOX)


@pytest.mark.slow
@given(st.tuples(*[st.integers(-200, 200)] * 3), clouds)
def test_moving_all_by_whole_voxels_changes_nothing(steps: tuple[int, int, int], cloud):
    vertices, faces = box((0.03, -0.02, 0.0), (0.31, 0.4, 0.25))
    points = np.array(cloud)
    here, there = true_volume(vertices, faces), true_volume(vertices + np.array(steps) * H, faces)
    assert np.array_equal(here.surface, there.surface)
    assert np.array_equal(here.interior, there.interior)
    before, after = score_points(points, here), score_points(points + np.array(steps) * H, there)
    assert after.iou == before.iou
    assert after.centroid_error == pytest.approx(before.centroid_error, abs=1e-9)


@given(st.permutations(range(12)), st.integers(0, 2))
@settings(max_examples=30)
def test_the_order_of_faces_and_of_their_corners_changes_no_voxel(order: list[int], turn: int):
    vertices, faces = box((0.013, 0.02, 0.0), (0.31, 0.4, 0.25))
    here, there = true_volume(vertices, faces), true_volume(vertices, np.roll(faces[order], turn, axis=1))
    assert np.array_equal(here.surface, there.surface)
    assert there.centroid == pytest.approx(here.centroid, abs=1e-12)


@given(clouds, clouds)
def test_points_inside_change_no_iou(cloud, inside):
    core = 0.1 + (np.array(inside) + 0.2) / 0.9 * 0.299
    assert score_points([*cloud, *core.tolist()], BOX).iou == score_points(cloud, BOX).iou


# --- Limits -----------------------------------------------------------------------------------------------------------


def test_points_far_away_count_once_per_voxel_and_cost_nothing():
    surface = centres(BOX.surface, BOX)
    far = np.array([[1e30, 0, 0], [1e300, 0, 0], [-1e30, 1e18, 4e9], [0, 0, 3.4e38]])
    score = score_points(np.concatenate([surface, far]), BOX)
    # Beyond the limit the first two fall on the same voxel.
    assert score.iou == len(surface) / (len(surface) + 3)
    assert score.centroid_error is not None
    assert math.isfinite(score.centroid_error)
    assert score_points(np.full((1, 3), np.finfo(np.float64).max), BOX).centroid_error == pytest.approx(
        math.sqrt(3) * 2**20 * H, rel=1e-4
    )


def test_two_million_points_all_in_voxels_of_their_own_stay_below_100_mb():
    points = np.stack(np.meshgrid(*[np.arange(126, dtype=np.float32)] * 3), axis=-1).reshape(-1, 3)[:2_000_000]
    tracemalloc.start()
    try:
        score = score_points(points, BOX)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # None of the points, whole metres, is a voxel of the box but for the origin's neighbour.
    assert score.iou == 0.0
    assert peak < 100e6 - points.nbytes


def test_the_largest_mesh_stays_below_100_mb():
    e = 5.99
    vertices = np.array([[0, 0, 0], [e, e, 0], [0, e, e], [e, 0, e]])
    tracemalloc.start()
    try:
        truth = true_volume(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    volume = (truth.interior.sum() + truth.surface.sum() / 2) * H**3
    assert volume == pytest.approx(e**3 / 3, rel=0.01)
    assert peak < 100e6


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite_are_refused(bad: float):
    with pytest.raises(Avs3dError, match="NaN or infinite"):
        score_points([[0, 0, 0], [0, bad, 0]], BOX)


@pytest.mark.parametrize("shape", [(3,), (4, 2), (2, 2, 3), (0,)])
def test_points_of_another_shape_are_refused(shape: tuple[int, ...]):
    with pytest.raises(Avs3dError, match=r"expected \(N, 3\)"):
        score_points(np.zeros(shape), BOX)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (CUBE * 6.01, CUBE_FACES, r"measures 6.01 × 6.01 × 6.01 m: expected at most 6 m"),
        (CUBE * 1000, CUBE_FACES, "check its unit"),
        (CUBE * 1e12, CUBE_FACES, "beyond 50 km"),
        (CUBE * np.nan, CUBE_FACES, "not finite"),
        (CUBE + np.inf, CUBE_FACES, "not finite"),
        (CUBE, CUBE_FACES[:0], "no face"),
        (CUBE[:4], CUBE_FACES, "outside of its 4"),
        (CUBE, -CUBE_FACES, "outside of its 8"),
        (CUBE, CUBE_FACES.astype(float), "outside of its 8"),
        (CUBE, np.array([[0, 0, 1], [3, 3, 3]]), "no area"),
        (CUBE[:, :2], CUBE_FACES, r"expected \(V, 3\)"),
        (CUBE, CUBE_FACES[:, :2], r"\(F, 3\)"),
    ],
)
def test_meshes_that_make_no_sense_are_refused_in_one_line(vertices: np.ndarray, faces: np.ndarray, message: str):
    with pytest.raises(Avs3dError, match=message) as caught:
        true_volume(vertices, faces)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("size", [0.0, -0.05, 1e-4, 0.050001, 2.0, math.nan, math.inf])
def test_sizes_of_voxels_are_checked(size: float):
    with pytest.raises(Avs3dError, match="voxel size"):
        true_volume(CUBE, CUBE_FACES, size=size)


def test_a_finer_grid_than_memory_bears_is_refused():
    with pytest.raises(Avs3dError, match="million voxels"):
        true_volume(CUBE * 5, CUBE_FACES, size=0.001)
