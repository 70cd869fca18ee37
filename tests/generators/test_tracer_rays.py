"""The tracer's foundations: random numbers, air, the tree of triangles, distances to surfaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from generators.acoustics.tracer.air import attenuation_db
from generators.acoustics.tracer.clearance import clearance
from generators.acoustics.tracer.philox import words
from generators.acoustics.tracer.rays import ray_directions
from generators.core.bvh import STACK, build
from generators.core.jit import njit
from generators.core.low_discrepancy import fibonacci_directions
from tests.support.tracer_rooms import SIZE, box, surfaces


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_gives_the_known_answers_of_its_authors(counter, key, expected):
    # Random123, tests/kat_vectors: philox4x32 10.
    from generators.acoustics.tracer.philox import philox4x32

    assert words(counter, key) == expected
    compiled = philox4x32(*(np.uint64(word) for word in (*counter, *key)))
    assert tuple(int(word) for word in compiled) == expected


@pytest.mark.parametrize(
    ("humidity", "per_km"),
    # ISO 9613-1:1993, table 1 at 20 °C, dB/km at 125, 250, 500, 1000, 2000, 4000, 8000 Hz.
    [
        (50.0, (0.445, 1.32, 2.73, 4.66, 9.86, 29.4, 104.0)),
        (70.0, (0.338, 1.13, 2.80, 4.98, 9.02, 22.9, 76.6)),
    ],
)
def test_air_absorbs_as_the_standard_tabulates(humidity, per_km):
    exact = 1000.0 * 2.0 ** np.arange(-3, 4)  # the standard's exact mid-band frequencies
    assert 1000 * attenuation_db(exact, humidity=humidity) == pytest.approx(per_km, rel=0.02)


def test_ray_directions_are_even_and_turn_with_the_seed():
    plain, turned = fibonacci_directions(2000), ray_directions(2000, 3, 0)
    for directions in (plain, turned):
        assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0, abs=1e-12)
        assert directions.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-3)
        assert directions.T @ directions / len(directions) == pytest.approx(np.eye(3) / 3, abs=1e-3)
    assert np.array_equal(turned, ray_directions(2000, 3, 0))
    assert not np.allclose(turned, ray_directions(2000, 4, 0))
    assert not np.allclose(turned, ray_directions(2000, 3, 1))


def brute_force(triangles, origin, direction):
    """Distance to the nearest triangle by solving o + t·d = v + a·e1 + b·e2 for each."""
    nearest = np.inf
    for v, p, q in triangles:
        matrix = np.stack([-direction, p - v, q - v], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        t, a, b = np.linalg.solve(matrix, origin - v)
        if t > 0 and a >= 0 and b >= 0 and a + b <= 1:
            nearest = min(nearest, t)
    return nearest


def soup(seed, count):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, (count, 1, 3)) + rng.normal(0, 0.5, (count, 3, 3))


class Soup:
    """Triangles as an acoustic mesh of one material."""

    def __new__(cls, triangles):
        from generators.acoustics.geometry import AcousticMesh
        from generators.acoustics.tracer.surfaces import surfaces_of

        faces = np.arange(3 * len(triangles)).reshape(-1, 3)
        return surfaces_of(AcousticMesh(triangles.reshape(-1, 3), {"wood": faces}))


@given(st.integers(0, 10_000), st.integers(1, 60))
@settings(max_examples=30)
def test_the_tree_finds_the_first_hit_that_brute_force_finds(seed, count):
    triangles = soup(seed, count)
    rng = np.random.default_rng(seed + 1)
    origins, directions = rng.uniform(-3, 3, (20, 3)), rng.normal(size=(20, 3))
    directions[:3] = np.eye(3)  # along the axes: reciprocal directions are infinite
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = Soup(triangles).first_hits(origins, directions)
    expected = [brute_force(triangles, o, d) for o, d in zip(origins, directions, strict=True)]
    assert found == pytest.approx(np.array(expected), rel=1e-9)


@pytest.mark.parametrize("kind", ["scattered", "coincident", "line"])
def test_the_tree_holds_every_triangle_once_and_is_shallow(kind):
    triangles = soup(5, 3000)
    if kind == "coincident":
        triangles = np.repeat(triangles[:1], 3000, axis=0)  # no split tells them apart
    if kind == "line":
        triangles = triangles[:1] + (1.4 ** np.arange(200))[:, None, None] * [1.0, 0.0, 0.0]  # splits peel off one
    tree = build(triangles)
    assert sorted(tree.order) == list(range(len(triangles)))
    leaves = tree.links[:, 1] > 0
    covered = np.concatenate([np.arange(first, first + count) for first, count in tree.links[leaves]])
    assert sorted(covered) == list(range(len(triangles)))
    depth = np.zeros(len(tree.links), dtype=int)
    for node, (child, count) in enumerate(tree.links):
        if count == 0:
            depth[child : child + 2] = depth[node] + 1
            for inner in tree.bounds[child : child + 2]:
                assert np.all(inner[:3] >= tree.bounds[node, :3])
                assert np.all(inner[3:] <= tree.bounds[node, 3:])
    assert depth.max() < STACK - 1
    assert tree.links[leaves, 1].max() <= 8


def test_a_tree_of_a_broken_mesh_is_refused_in_one_line():
    triangles = soup(1, 10)
    triangles[3, 1, 2] = np.nan
    with pytest.raises(Avs3dError, match="1 of 10 triangles are NaN or infinite; repair the mesh"):
        build(triangles)


def test_nothing_is_hit_without_triangles():
    tree = Soup(np.zeros((0, 3, 3)))
    assert np.all(np.isinf(tree.first_hits(np.zeros((5, 3)), fibonacci_directions(5))))


def test_no_ray_leaves_a_closed_box():
    # Aimed at edges and corners above all, where a ray might slip between two triangles.
    found = surfaces(box())
    rng = np.random.default_rng(0)
    targets = rng.uniform(0, 1, (60_000, 3)) * SIZE
    targets[:20_000] = np.round(targets[:20_000] / SIZE) * SIZE
    targets[20_000:40_000, :2] = np.round(targets[20_000:40_000, :2] / SIZE[:2]) * SIZE[:2]
    origins = rng.uniform(0.1, 0.9, (60_000, 3)) * SIZE
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.isfinite(found.first_hits(origins, directions)).all()


@pytest.mark.slow
@given(st.integers(0, 10_000))
@settings(max_examples=25)
def test_clearance_is_the_distance_to_the_nearest_point_of_a_triangle(seed):
    triangles = soup(seed, 6)
    rng = np.random.default_rng(seed)
    points = rng.uniform(-3, 3, (5, 3))
    a, b = rng.uniform(0, 1, (2, 40_000))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    edge = np.linspace(0, 1, 400)
    share = np.concatenate([[a, b], [edge, 0 * edge], [0 * edge, edge], [edge, 1 - edge]], axis=1)
    v, p, q = triangles.transpose(1, 0, 2)
    on = v[:, None] + share[0][None, :, None] * (p - v)[:, None] + share[1][None, :, None] * (q - v)[:, None]
    nearest = [np.linalg.norm(on - point, axis=2).min() for point in points]
    corners = np.concatenate([v, p - v, q - v], axis=1)
    # The samples lie about 5 mm apart; none is nearer than the nearest point.
    found = clearance(corners, points, 10.0)
    assert np.all(found <= np.array(nearest) + 1e-12)
    assert found == pytest.approx(nearest, abs=0.02)
    assert clearance(corners, points, 0.5) == pytest.approx(np.minimum(found, 0.5))


def test_reflections_follow_lambert_and_the_mirror():
    from generators.acoustics.tracer.kernels import reflected

    @njit
    def many(normal, u, v, diffuse, out):
        for i in range(len(u)):
            out[i] = reflected(0.6, -0.8, 0.0, normal[0], normal[1], normal[2], diffuse, u[i], v[i])

    rng = np.random.default_rng(1)
    u, v = rng.uniform(size=(2, 200_000))
    out = np.empty((len(u), 3))
    for normal in (np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, -1.0]), np.array([-0.48, 0.64, 0.6])):
        many(normal, u, v, True, out)
        cosine = out @ normal
        assert np.linalg.norm(out, axis=1) == pytest.approx(1.0, abs=1e-12)
        # Lambert: cos² is uniform over (0, 1), and no side is preferred.
        assert np.histogram(cosine**2, 10, (0, 1))[0] / len(u) == pytest.approx(0.1, abs=0.004)
        assert out.mean(axis=0) == pytest.approx(2 / 3 * normal, abs=0.005)
    many(np.array([0.0, 1.0, 0.0]), u[:1], v[:1], False, out)
    assert out[0] == pytest.approx([0.6, 0.8, 0.0])


def test_rounding_does_not_decide_which_of_two_surfaces_in_one_place_is_met():
    from generators.acoustics.geometry import AcousticMesh
    from generators.acoustics.tracer.kernels import closest_hits
    from generators.acoustics.tracer.surfaces import scratch, surfaces_of

    # One oblique rectangle, cut along either diagonal, of two materials.
    a, b = np.array([1.0, 0.1, 0.3]), np.array([0.2, 1.1, -0.7])
    corners = np.array([0 * a, a, a + b, b]) + [0.3, 0.7, 0.9]
    groups = {"wood": np.array([[0, 1, 2], [0, 2, 3]]), "carpet": np.array([[1, 2, 3], [1, 3, 0]])}
    mesh = surfaces_of(AcousticMesh(corners, groups)).mesh
    rng = np.random.default_rng(2)
    inside = rng.uniform(0.05, 0.95, (500, 2))
    inside = inside[np.abs(inside[:, 0] - inside[:, 1]) > 0.01]
    inside = inside[np.abs(inside.sum(axis=1) - 1) > 0.01]
    target = corners[0] + inside @ np.stack([a, b])
    found = []
    for shift in (0.0, 1e-15, -1e-14, 3e-13):
        origin = np.array([2.0 + shift, -1.0, 1.5 - shift])
        directions = target - origin
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        distance, triangle = np.empty(len(target)), np.empty(len(target), dtype=np.int32)
        origins = np.broadcast_to(origin, target.shape).copy()
        closest_hits(mesh, origins, directions, distance, triangle, *scratch())
        assert (triangle >= 0).all()
        found.append(triangle)
    assert all((each == found[0]).all() for each in found)
