"""The catalogue: seven categories and the distractors, as models that can be placed, rendered and heard."""

from __future__ import annotations

import numpy as np
import pytest

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS
from avs3d_bench.errors import UsageError
from generators.acoustics.materials import MATERIALS
from generators.assets.catalogue import Model, build_model, variants
from generators.core.rays import RayCaster

EVERY = [(category, variant) for category in CATEGORIES + DISTRACTORS for variant in variants(category)]
#: Plausible width, height and depth of each category, metres (hose, cord and open lid included).
SIZES = {
    "washing_machine": ((0.58, 0.62), (0.82, 0.90), (0.40, 0.65)),
    "toilet": ((0.34, 0.66), (0.70, 1.16), (0.52, 0.75)),
    "vacuum_cleaner": ((0.25, 0.60), (0.70, 1.20), (0.40, 1.00)),
    "microwave": ((0.43, 0.56), (0.25, 0.34), (0.32, 0.45)),
    "coffee_machine": ((0.11, 0.32), (0.26, 0.42), (0.24, 0.44)),
    "clock": ((0.20, 0.42), (0.25, 0.42), (0.03, 0.16)),
    "telephone": ((0.16, 0.30), (0.10, 0.26), (0.12, 0.30)),
    "oven": ((0.40, 0.52), (0.25, 0.34), (0.32, 0.45)),
    "dishwasher": ((0.44, 0.61), (0.80, 0.90), (0.54, 0.65)),
    "kettle": ((0.20, 0.28), (0.20, 0.30), (0.17, 0.24)),
    "fan": ((0.28, 0.48), (0.38, 1.40), (0.16, 0.45)),
    "radio": ((0.24, 0.38), (0.16, 0.38), (0.08, 0.20)),
}
MOUNTS = {
    "washing_machine": {"floor"},
    "toilet": {"floor"},
    "vacuum_cleaner": {"floor"},
    "clock": {"wall", "surface", "wall_or_surface"},
    "dishwasher": {"floor"},
    "fan": {"floor", "surface"},
}


@pytest.fixture(scope="module")
def models() -> dict[tuple[str, str], Model]:
    return {key: build_model(*key, np.random.default_rng(7)) for key in EVERY}


@pytest.fixture(params=EVERY, ids="/".join)
def model(request: pytest.FixtureRequest, models: dict[tuple[str, str], Model]) -> Model:
    return models[request.param]


@pytest.mark.parametrize("category", CATEGORIES + DISTRACTORS)
def test_every_category_has_at_least_two_variants(category: str) -> None:
    assert len(set(variants(category))) >= 2


def test_sizes_are_those_of_real_goods(model: Model) -> None:
    for size, (least, most) in zip(model.size, SIZES[model.category], strict=True):
        assert least <= size <= most


def test_clocks_can_be_seen_from_across_a_room(models: dict[tuple[str, str], Model]) -> None:
    assert all(max(m.size) >= 0.25 for (category, _), m in models.items() if category == "clock")


@pytest.mark.slow
def test_model_frame(model: Model) -> None:
    low, high = model.mesh.bounds
    middle = (low + high) / 2
    assert model.mount in MOUNTS.get(model.category, {"surface"})
    if model.mount in ("floor", "surface"):
        assert low[1] == pytest.approx(0, abs=1e-5)
        assert middle[[0, 2]] == pytest.approx([0, 0], abs=1e-5)
    if model.mount == "wall":
        assert low[2] == pytest.approx(0, abs=1e-5)
        assert middle[[0, 1]] == pytest.approx([0, 0], abs=1e-5)
    if model.mount == "wall_or_surface":
        assert low[[1, 2]] == pytest.approx([0, 0], abs=1e-5)
        assert middle[0] == pytest.approx(0, abs=1e-5)


def test_the_front_faces_plus_z(model: Model) -> None:
    low, high = model.mesh.bounds.astype(np.float64)
    if model.category == "vacuum_cleaner":
        return  # its front is a convention
    if model.category == "toilet":  # the cistern stands behind the bowl
        corners = model.mesh.positions.reshape(-1, 3)
        assert corners[corners[:, 1] > 0.6][:, 2].mean() < -0.1
        return
    # Rays from the front meet more different materials (glass, print, knobs) than rays from the back.
    x, y = np.meshgrid(np.linspace(low[0], high[0], 60), np.linspace(low[1], high[1], 60))
    caster = RayCaster(model.mesh.positions)
    seen = []
    for z, direction in ((high[2] + 1, -1.0), (low[2] - 1, 1.0)):
        rays = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)
        _, face = caster.closest(rays, np.broadcast_to([0.0, 0.0, direction], rays.shape))
        seen.append(len(np.unique(model.mesh.face_material[face[face >= 0]])))
    assert seen[0] > seen[1]


def test_numbers_are_finite_and_normals_are_unit(model: Model) -> None:
    model.mesh.check(model.name)
    assert np.linalg.norm(model.mesh.normals, axis=2) == pytest.approx(1, abs=1e-4)


def test_triangle_budget(model: Model) -> None:
    assert 500 <= len(model.mesh.positions) <= 12_000
    assert 12 <= len(model.mesh.acoustic_positions) <= 120


def test_no_face_shows_its_back(model: Model) -> None:
    # Seen from all around, a closed or capped body shows only outer sides.
    low, high = model.mesh.bounds.astype(np.float64)
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low))
    rng = np.random.default_rng(0)
    away = rng.normal(size=(6000, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away[:, 1] = np.abs(away[:, 1])  # nobody looks from below the floor
    if model.mount == "wall":
        away[:, 2] = np.abs(away[:, 2])  # or from inside the wall
    targets = centre + rng.uniform(-0.5, 0.5, size=away.shape) * (high - low)
    directions = targets - (centre + radius * away)
    _, face = RayCaster(model.mesh.positions).closest(centre + radius * away, directions)
    corners = model.mesh.positions[face[face >= 0]].astype(np.float64)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    backs = (outward * directions[face >= 0]).sum(axis=1) > 0
    assert backs.mean() < 0.01


def test_colours_are_albedos(model: Model) -> None:
    for material in model.mesh.materials:
        assert min(material.colour) >= 0
        assert max(material.colour) <= 0.95 or material.texture is not None
        assert material.acoustic in MATERIALS
        if material.texture is not None:
            assert material.texture.pixels.dtype == np.uint8
            assert max(material.texture.pixels.shape[:2]) <= 1024


@pytest.mark.slow
def test_the_source_lies_on_the_surface(model: Model) -> None:
    point = np.asarray(model.source_point)
    low, high = model.mesh.bounds
    assert (point >= low - 0.06).all()
    assert (point <= high + 0.06).all()
    assert _distance(point, model.mesh.positions.astype(np.float64)) <= 0.06
    if model.mount in ("wall", "wall_or_surface"):
        assert point[2] > 0.01  # in the room, not in the wall


def test_the_source_is_heard_from_the_front(model: Model) -> None:
    # Ears 1.5 m above the floor, 2 m before it and to both sides: nothing of its own acoustic twin is between.
    heights = {"floor": 1.5, "surface": 0.6, "wall": 0.0, "wall_or_surface": 0.0}
    source = np.asarray(model.source_point)
    ears = np.array([[x, heights[model.mount], 2.0] for x in (-1.5, 0.0, 1.5)])
    caster = RayCaster(model.mesh.acoustic_positions)
    assert not caster.occluded(source, ears - source, 0.999).any()


@pytest.mark.slow
@pytest.mark.parametrize("key", EVERY, ids="/".join)
def test_the_same_generator_gives_the_same_bytes(key: tuple[str, str], models: dict[tuple[str, str], Model]) -> None:
    again, first = build_model(*key, np.random.default_rng(7)), models[key]
    for name in ("positions", "normals", "uv", "face_material", "acoustic_positions"):
        assert getattr(again.mesh, name).tobytes() == getattr(first.mesh, name).tobytes()
    for a, b in zip(again.mesh.materials, first.mesh.materials, strict=True):
        assert (a.name, a.colour, a.emission) == (b.name, b.colour, b.emission)
        if a.texture is not None and b.texture is not None:
            assert a.texture.pixels.tobytes() == b.texture.pixels.tobytes()
    assert again.source_point == first.source_point


def test_clocks_differ_in_the_time_they_show() -> None:
    one, two = (build_model("clock", "station", np.random.default_rng(seed)) for seed in (1, 2))
    assert one.mesh.positions.shape == two.mesh.positions.shape
    assert not np.array_equal(one.mesh.positions, two.mesh.positions)


def test_unknown_names_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(UsageError, match=r"unknown category 'toaster'"):
        variants("toaster")
    with pytest.raises(UsageError, match=r"unknown variant 'pink' of clock: expected one of station, wooden"):
        build_model("clock", "pink", rng)


def _distance(point: np.ndarray, triangles: np.ndarray) -> float:
    """From a point to the nearest of many triangles, by dense samples of those nearby (error below 4 mm)."""
    near = triangles[np.linalg.norm(triangles - point, axis=2).min(axis=1) < 0.6]
    s, t = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 25))
    s, t = s[s + t <= 1], t[s + t <= 1]
    samples = near[:, :1] + s[:, None] * (near[:, 1:2] - near[:, :1]) + t[:, None] * (near[:, 2:3] - near[:, :1])
    return float(np.linalg.norm(samples - point, axis=2).min())
