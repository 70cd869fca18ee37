"""Furniture: plausible sizes, the origin and front conventions, closed and outward surfaces, supports that hold."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from avs3d_bench.errors import UsageError
from generators.apartments.plain import PlainPalette
from generators.assets import styles
from generators.assets.furniture import KINDS, Furniture, build_furniture, options_of
from generators.assets.furniture.common import Kit
from generators.assets.materials import Palette
from generators.core.rays import RayCaster
from generators.core.scene import Mesh

#: (width, height, depth) ranges in metres, and the mount.
SIZES: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float], str]] = {
    "bathtub": ((1.5, 1.9), (0.5, 0.9), (0.7, 0.95), "floor"),
    "shower": ((0.85, 1.1), (1.9, 2.2), (0.85, 1.0), "floor"),
    "washbasin": ((0.55, 1.1), (0.85, 1.3), (0.42, 0.55), "floor"),
    "vanity_cabinet": ((0.4, 1.0), (0.6, 0.9), (0.1, 0.25), "wall"),
    "towel_rail": ((0.4, 0.7), (0.4, 1.3), (0.06, 0.2), "wall"),
    "bath_mat": ((0.6, 0.9), (0.008, 0.02), (0.4, 0.9), "floor"),
    "laundry_basket": ((0.3, 0.5), (0.4, 0.8), (0.3, 0.5), "floor"),
    "bathroom_cabinet": ((0.3, 0.5), (1.5, 1.9), (0.3, 0.45), "floor"),
    "kitchen_counter": ((2.3, 2.5), (0.9, 1.5), (0.6, 0.7), "floor"),
    "wall_cabinet": ((1.7, 1.9), (0.6, 0.8), (0.3, 0.42), "wall"),
    "fridge": ((0.55, 0.7), (1.6, 2.0), (0.55, 0.75), "floor"),
    "oven_unit": ((0.55, 0.65), (2.0, 2.2), (0.55, 0.7), "floor"),
    "extractor_hood": ((0.55, 0.95), (0.4, 0.9), (0.4, 0.55), "wall"),
    "kitchen_shelf": ((0.8, 1.0), (0.5, 1.0), (0.2, 0.3), "wall"),
    "dining_table": ((0.95, 1.9), (0.72, 0.78), (0.75, 1.25), "floor"),
    "chair": ((0.38, 0.55), (0.78, 0.95), (0.42, 0.62), "floor"),
    "stool": ((0.3, 0.45), (0.42, 0.75), (0.3, 0.45), "floor"),
    "waste_bin": ((0.22, 0.35), (0.28, 0.5), (0.22, 0.4), "floor"),
    "sofa": ((1.6, 2.45), (0.7, 1.05), (0.8, 1.05), "floor"),
    "armchair": ((0.65, 0.9), (0.75, 1.0), (0.65, 0.95), "floor"),
    "coffee_table": ((0.7, 1.3), (0.35, 0.6), (0.5, 1.0), "floor"),
    "side_table": ((0.4, 0.6), (0.45, 0.65), (0.4, 0.6), "floor"),
    "tv_stand": ((1.5, 1.9), (0.9, 1.4), (0.38, 0.5), "floor"),
    "desk": ((1.1, 1.5), (0.74, 1.0), (0.55, 0.7), "floor"),
    "bookshelf": ((0.75, 1.3), (1.8, 2.1), (0.25, 0.36), "floor"),
    "sideboard": ((1.4, 1.85), (0.7, 1.25), (0.38, 0.5), "floor"),
    "shelf_board": ((0.7, 1.0), (0.1, 0.6), (0.2, 0.26), "wall"),
    "shoe_cabinet": ((0.7, 0.95), (0.8, 1.1), (0.25, 0.4), "floor"),
    "coat_rack": ((0.65, 0.95), (0.6, 1.3), (0.15, 0.3), "wall"),
    "wardrobe": ((1.1, 1.9), (1.95, 2.25), (0.55, 0.7), "floor"),
    "bed": ((1.4, 2.0), (0.8, 1.1), (2.0, 2.25), "floor"),
    "nightstand": ((0.38, 0.52), (0.45, 0.6), (0.35, 0.46), "floor"),
    "rug": ((2.0, 2.7), (0.005, 0.02), (1.3, 1.75), "floor"),
    "plant": ((0.25, 1.5), (0.6, 1.9), (0.25, 1.5), "floor"),
    "picture": ((0.4, 1.45), (0.3, 1.25), (0.015, 0.05), "wall"),
    "curtains": ((1.9, 2.2), (2.3, 2.45), (0.08, 0.2), "wall"),
    "floor_lamp": ((0.28, 1.2), (1.3, 1.8), (0.25, 0.6), "floor"),
    "ceiling_lamp": ((0.3, 0.5), (0.4, 0.75), (0.3, 0.5), "ceiling"),
    "radiator": ((0.75, 1.35), (0.55, 0.75), (0.08, 0.16), "wall"),
    "door_leaf": ((0.8, 0.86), (2.0, 2.05), (0.04, 0.2), "floor"),
}
SEEDS = range(6)
STYLES = ("scandinavian", "warm_classic", "modern_dark", "mediterranean", "industrial")
BUDGET = 4000

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def palettes() -> list[Palette]:
    """Without textures, which no shape depends on (test_apartment)."""
    return [PlainPalette.from_seed(np.random.default_rng(k), style) for k, style in enumerate(STYLES)]


@pytest.fixture(scope="module")
def pieces(palettes: list[Palette]) -> dict[str, list[Furniture]]:
    return {
        kind: [build_furniture(kind, palettes[s % len(palettes)], np.random.default_rng(s)) for s in SEEDS]
        for kind in KINDS
    }


def _scene(mesh: Mesh) -> rtcore_scene.EmbreeScene:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.positions))
    return scene


def test_the_table_of_sizes_is_complete() -> None:
    assert set(SIZES) == set(KINDS)
    assert len(KINDS) >= 25


@pytest.mark.parametrize("kind", SIZES)
def test_sizes_are_plausible(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    for piece in pieces[kind]:
        extent = np.ptp(piece.mesh.bounds, axis=0)
        for axis, (low, high) in enumerate(SIZES[kind][:3]):
            assert low <= extent[axis] <= high, f"{kind}: {['width', 'height', 'depth'][axis]} is {extent[axis]:.3f} m"


@pytest.mark.parametrize("kind", SIZES)
def test_origin_and_mount(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    for piece in pieces[kind]:
        low, high = piece.mesh.bounds
        assert piece.kind == kind
        assert piece.mount == SIZES[kind][3]
        assert (low + high)[0] == pytest.approx(0, abs=1e-5)
        if piece.mount == "floor":
            assert low[1] == pytest.approx(0, abs=1e-5)
            assert (low + high)[2] == pytest.approx(0, abs=1e-5)
        elif piece.mount == "wall":
            assert low[2] == pytest.approx(0, abs=1e-5)
            assert (low + high)[1] == pytest.approx(0, abs=1e-5)
        else:
            assert high[1] == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("kind", SIZES)
def test_meshes_are_sound(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    for piece in pieces[kind]:
        mesh = piece.mesh
        mesh.check(kind)
        assert 12 <= len(mesh.positions) <= BUDGET
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=2), 1.0, atol=1e-4)
        face = np.cross(mesh.positions[:, 1] - mesh.positions[:, 0], mesh.positions[:, 2] - mesh.positions[:, 0])
        assert np.linalg.norm(face, axis=1).min() > 0
        # Shading normals are smoothed, never turned over.
        assert ((face[:, None] * mesh.normals).sum(axis=2) > 0).mean() > 0.99


@pytest.mark.parametrize("kind", SIZES)
def test_surfaces_look_outwards(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    """Rays from a sphere round the piece meet front faces: nothing is inside out, no open sheet shows its back."""
    for piece in pieces[kind]:
        mesh = piece.mesh
        low, high = mesh.bounds.astype(np.float64)
        rng = np.random.default_rng(1)
        around = rng.standard_normal((6000, 3))
        around[:, 1] = np.abs(around[:, 1]) if piece.mount == "floor" else around[:, 1]
        around[:, 2] = np.abs(around[:, 2]) if piece.mount == "wall" else around[:, 2]
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        origin = ((low + high) / 2 + around * np.linalg.norm(high - low)).astype(np.float32)
        target = low + rng.random((6000, 3)) * (high - low)
        direction = (target - origin).astype(np.float32)
        hit = _scene(mesh).run(origin, direction, query="INTERSECT", output=True)["primID"]
        seen = hit >= 0
        p = mesh.positions[hit[seen]]
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        back = (normal * direction[seen]).sum(axis=1) > 0
        assert seen.sum() > 100
        assert back.mean() < 0.004, f"{kind}: {back.mean():.2%} of the rays meet the back of a face"


def test_what_has_a_front_shows_it_towards_plus_z(pieces: dict[str, list[Furniture]]) -> None:
    """Handles, screens and oven doors lie in the front half; backs of seats in the rear half."""
    for kind, role in (("tv_stand", "screen"), ("oven_unit", "oven_panel"), ("kitchen_counter", "oven_panel")):
        for piece in pieces[kind]:
            index = [m.name for m in piece.mesh.materials].index(role)
            faces = piece.mesh.positions[piece.mesh.face_material == index]
            normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
            assert (normal[:, 2] > 0).all()
    for kind in ("sofa", "armchair", "chair", "bed"):
        for piece in pieces[kind]:
            points = piece.mesh.positions.reshape(-1, 3)
            # The highest quarter of a seat is its back rest (a cushion may lean on it).
            high = points[points[:, 1] > 0.8 * points[:, 1].max()]
            assert high[:, 2].mean() < 0.0, kind


def test_kinds_that_carry_objects_have_supports(pieces: dict[str, list[Furniture]]) -> None:
    expected = {
        "kitchen_counter": "worktop",
        "dining_table": "side_table",
        "coffee_table": "side_table",
        "side_table": "side_table",
        "sideboard": "side_table",
        "nightstand": "side_table",
        "shoe_cabinet": "side_table",
        "desk": "side_table",
        "bookshelf": "shelf",
        "shelf_board": "shelf",
        "kitchen_shelf": "shelf",
    }
    for kind, support in expected.items():
        for piece in pieces[kind]:
            assert piece.supports, kind
            assert {s.kind for s in piece.supports} == {support}
            assert any(s.u[0] >= 0.2 and s.v[2] >= 0.18 for s in piece.supports), kind


@pytest.mark.parametrize("kind", SIZES)
def test_supports_are_free_and_lie_on_the_geometry(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    """Rays from the clearance height straight down meet the support's plane everywhere on it, within 2 mm."""
    grid = np.stack(np.meshgrid(np.linspace(0.02, 0.98, 9), np.linspace(0.02, 0.98, 9)), axis=-1).reshape(-1, 2)
    for piece in pieces[kind]:
        scene = _scene(piece.mesh) if piece.supports else None
        for support in piece.supports:
            assert support.normal == (0.0, 1.0, 0.0)
            assert support.front == (0.0, 0.0, 1.0)
            assert support.clearance >= 0.15
            points = np.array(support.origin) + grid[:, :1] * np.array(support.u) + grid[:, 1:] * np.array(support.v)
            origin = (points + np.array([0.0, support.clearance - 0.005, 0.0])).astype(np.float32)
            down = np.broadcast_to(np.array([0, -1, 0], np.float32), origin.shape).copy()
            distance = scene.run(origin, down, query="DISTANCE")
            np.testing.assert_allclose(distance, support.clearance - 0.005, atol=2e-3, err_msg=kind)


@pytest.mark.parametrize("kind", SIZES)
def test_sound_meets_few_boxes_that_stand_for_the_piece(kind: str, pieces: dict[str, list[Furniture]]) -> None:
    for piece in pieces[kind]:
        mesh = piece.mesh
        assert 0 < len(mesh.acoustic_positions) <= 12 * 14
        low, high = mesh.bounds
        points = mesh.acoustic_positions.reshape(-1, 3)
        assert (points >= low - 0.06).all(), kind
        assert (points <= high + 0.06).all(), kind
        p = mesh.acoustic_positions.astype(np.float64)
        volume = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).reshape(-1, 12).sum(axis=1) / 6
        assert (volume > 0).all(), "acoustic boxes are closed and outward"


@pytest.mark.parametrize("kind", SIZES)
def test_variants(kind: str, palettes: list[Palette]) -> None:
    prints = set()
    for seed in range(8):
        mesh = build_furniture(kind, palettes[0], np.random.default_rng(seed)).mesh
        prints.add(hashlib.sha256(mesh.positions.tobytes() + mesh.uv.tobytes()).hexdigest())
    assert len(prints) >= 2


@pytest.mark.parametrize("kind", SIZES)
def test_same_seed_same_bytes(kind: str, palettes: list[Palette]) -> None:
    one, two = (build_furniture(kind, palettes[1], np.random.default_rng(3)) for _ in range(2))
    for name in ("positions", "normals", "uv", "face_material", "acoustic_positions"):
        assert getattr(one.mesh, name).tobytes() == getattr(two.mesh, name).tobytes()
    assert one.supports == two.supports


@pytest.mark.parametrize("length", [0.6, 1.2, 1.85, 3.0, 4.2])
def test_a_counter_is_as_long_as_asked(length: float, palettes: list[Palette]) -> None:
    features = ("sink", "hob", "oven") if length > 1 else ("drawers",)
    for seed in range(4):
        piece = build_furniture(
            "kitchen_counter", palettes[0], np.random.default_rng(seed), length=length, features=features, splash=False
        )
        assert np.ptp(piece.mesh.bounds[:, 0]) == pytest.approx(length, abs=1e-4)
        names = {m.name for m in piece.mesh.materials}
        assert ("hob" in names) == ("hob" in features)
        assert ("oven_panel" in names) == ("oven" in features)
        index = {m.name: k for k, m in enumerate(piece.mesh.materials)}
        for support in piece.supports:
            low, high = support.origin[0], support.origin[0] + support.u[0]
            if "hob" in index:
                x = piece.mesh.positions[piece.mesh.face_material == index["hob"]][..., 0]
                assert high <= x.min() or low >= x.max()


@pytest.mark.parametrize(
    ("kind", "options", "axis", "expected"),
    [
        ("wall_cabinet", {"length": 1.0}, 0, 1.0),
        ("wall_cabinet", {"height": 0.9}, 1, 0.9),
        ("curtains", {"width": 1.4}, 0, 1.4),
        ("curtains", {"height": 1.6}, 1, 1.6),
        ("door_leaf", {"width": 0.7}, 0, 0.7),
        ("door_leaf", {"height": 1.95}, 1, 1.95),
        ("sofa", {"length": 1.5}, 0, 1.5),
        ("bed", {"width": 0.9}, 0, 0.96),
        ("rug", {"length": 3.0}, 0, 3.0),
        ("oven_unit", {"height": 0.9}, 1, 0.9),
        ("tv_stand", {"length": 1.4}, 0, 1.4),
        ("plant", {"height": 1.2}, 1, 1.2),
        ("ceiling_lamp", {"drop": 0.8}, 1, 0.8),
        ("ceiling_lamp", {"drop": 0}, 1, 0.075),
    ],
)
def test_options_set_sizes(
    kind: str, options: dict[str, float], axis: int, expected: float, palettes: list[Palette]
) -> None:
    tolerance = {"curtains": 0.09, "rug": 0.12, "plant": 0.35, "sofa": 0.05, "bed": 0.07}.get(kind, 0.03)
    for seed in range(5):
        piece = build_furniture(kind, palettes[2], np.random.default_rng(seed), **options)
        assert np.ptp(piece.mesh.bounds[:, axis]) == pytest.approx(expected, abs=tolerance)


def test_bad_requests_are_refused_in_one_line(palettes: list[Palette]) -> None:
    rng = np.random.default_rng(0)
    for match, kind, options in (
        ("did you mean 'sofa'", "sofaa", {}),
        ("no option 'colour'", "sofa", {"colour": "red"}),
        ("expected metres", "sofa", {"length": -1.0}),
        ("expected metres", "rug", {"width": float("nan")}),
        ("unknown feature 'jacuzzi'", "kitchen_counter", {"features": ("jacuzzi",)}),
        ("too short", "kitchen_counter", {"length": 0.6, "features": ("sink", "hob")}),
        ("length is 9.0 m", "kitchen_counter", {"length": 9.0}),
        ("length is 7.0 m", "wall_cabinet", {"length": 7.0}),
    ):
        with pytest.raises(UsageError, match=match) as error:
            build_furniture(kind, palettes[0], rng, **options)
        assert "\n" not in str(error.value)


def test_options_are_named() -> None:
    assert set(options_of("kitchen_counter")) == {"length", "features", "splash", "decor"}
    assert options_of("chair") == ()


def _volume(mesh: Mesh) -> float:
    p = mesh.positions.astype(np.float64)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def test_solids_of_the_kit_are_closed_and_outward(palettes: list[Palette]) -> None:
    """Their signed volumes are those of the solids they stand for."""
    wood = palettes[0].material("wood")

    def kit() -> Kit:
        return Kit(palettes[0], np.random.default_rng(0))

    assert _volume(kit().panel((0, 0, 0), (1, 0.5, 0.25), wood, bevel=0.0).build()) == pytest.approx(0.125, rel=1e-5)
    # Chamfers of r along edges of total length 4(a + b + c) take r²/2 each, less what their ends share; r is the bevel
    # times a factor of the home's style.
    chamfered = _volume(kit().panel((0, 0, 0), (1, 0.5, 0.25), wood, bevel=0.01).build())
    factor = np.sqrt((0.125 - chamfered) / (4 * 1.75 * 0.01**2 / 2))
    assert 0.79 < factor / styles.STYLES[palettes[0].style].edge < 1.26
    twice = _volume(kit().panel((0, 0, 0), (1, 0.5, 0.25), wood, bevel=0.02).build())
    assert 0.125 - twice == pytest.approx(4 * (0.125 - chamfered), rel=0.03)
    soft = _volume(kit().soft((0.6, 0.2, 0.6), (0, 0, 0), wood, radius=0.03, cells=8).build())
    assert 0.9 * 0.072 < soft < 0.072
    assert _volume(kit().soft((0.6, 0.2, 0.6), (0, 0, 0), wood, radius=0.03, puff=(0, 0.02, 0)).build()) > soft
    assert 0.25 * 0.16 * 0.15 < _volume(kit().pillow((0.4, 0.4, 0.15), (0, 0, 0), wood).build()) < 0.8 * 0.16 * 0.15
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rings = [np.stack([np.cos(angle), np.full(64, y), np.sin(angle)], axis=1) for y in (0.0, 0.5)]
    assert _volume(kit().loft(rings, wood).build()) == pytest.approx(np.pi / 2, rel=5e-3)
    assert _volume(kit().loft(rings[::-1], wood).build()) == pytest.approx(np.pi / 2, rel=5e-3)
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2, 9))
    sheet = np.stack([x, y, np.zeros_like(x)], axis=2)
    assert _volume(kit().shell(sheet, 0.01, wood).build()) == pytest.approx(0.02, rel=1e-3)


def test_grain_follows_the_longest_side(palettes: list[Palette]) -> None:
    wood = palettes[0].material("wood")
    for high, axis in (((2.0, 0.1, 0.3), 0), ((0.1, 2.0, 0.3), 1), ((0.3, 0.1, 2.0), 2)):
        kit = Kit(palettes[0], np.random.default_rng(0))
        mesh = kit.panel((0, 0, 0), high, wood, bevel=0.0).build()
        along = mesh.positions[..., axis]
        long_ = np.ptp(along, axis=1) > 1.9
        u = mesh.uv[long_][..., 0] * 0.8
        np.testing.assert_allclose(np.ptp(u, axis=1), 2.0, rtol=1e-4)


def test_no_gap_shows_between_the_rim_of_a_built_in_bath_and_its_apron(palettes: list[Palette]) -> None:
    """Rays from before it, a little downwards, end within 2 cm of its front at every height below the rim."""
    for seed in range(8):
        mesh = build_furniture("bathtub", palettes[0], np.random.default_rng(seed)).mesh
        _, front = mesh.bounds[:, 2]
        # The rim is the highest level surface at the front; the freestanding bath has no apron.
        heights = np.linspace(0.3, 0.6, 601)
        starts = np.stack([np.full(601, 0.2), heights, np.full(601, float(front) + 0.5)], axis=1)
        distance, _ = RayCaster(mesh.positions).closest(starts, np.broadcast_to([0.0, -0.1, -1.0], starts.shape))
        behind = distance - 0.5
        rim = np.flatnonzero(behind < 0.02)[-1]
        if behind[0] < 0.02:
            assert behind[: rim + 1].max() < 0.02
