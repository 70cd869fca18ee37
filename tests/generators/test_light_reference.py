"""The comparison of baked light with a path tracer: what is compared, and the reference against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks.light_reference import (
    CLASSES,
    KINDS,
    Comparison,
    agreement,
    compare,
    face_kinds,
    face_labels,
    figures_of,
    load_earlier,
    overall,
    pooled,
    save,
    sheet,
    with_matte_materials,
    without_fireflies,
)
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Material, Part, Scene
from generators.core.tone import WHITE, develop
from generators.lighting.bake import bake
from generators.vision.embree import EmbreeBackend
from tests.generators.test_light import LAMP, box_room, ceiling_lamp, matte, parallel_form_factor, scene_of, window_room

UP = np.array([0.0, 1.0, 0.0, 0.0], dtype=np.float32)


def flat_view(ours: np.ndarray, reference: np.ndarray, label: np.ndarray | None = None) -> Comparison:
    """One plane all over the picture, and a reference without noise."""
    shape = ours.shape[:2]
    return Comparison(
        ours.astype(np.float32),
        np.stack([reference, reference]).astype(np.float32),
        np.zeros(shape, np.int8) if label is None else label,
        np.zeros(shape, np.int8),
        np.broadcast_to(UP, (*shape, 4)),
    )


@pytest.mark.parametrize("light", [0.25, 3.0, 40.0])
def test_radiance_is_albedo_times_light_plus_emission_beyond_white_too(light: float) -> None:
    wall = Material("wall", "plaster", (0.5, 0.25, 0.75), emission=(0.0, 1.0, 10.0))
    mesh = MeshBuilder().quad([(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)], wall).build()
    lit = LightMap(np.zeros_like(mesh.uv), np.full((2, 2, 3), light, np.float16))
    scene = Scene("wall", (Part("wall", mesh, light=lit),), (), (), exposure=2.0)
    session = EmbreeBackend().open(scene, Intrinsics.from_fov(8))
    radiance, face = session.radiance(Pose.from_yaw((0, 0, 1), 0.0))
    session.close()
    expected = 2.0 * (np.array(wall.colour) * light + np.array(wall.emission))
    assert expected.max() > WHITE
    assert np.abs(radiance / expected - 1).max() < 1e-4
    assert set(np.unique(face)) <= {0, 1}


def test_agreement_of_pictures_whose_difference_is_known() -> None:
    reference = np.full((10, 10, 3), 0.5)
    ours = reference.copy()
    ours[:5] *= 1.1
    label = np.zeros((10, 10), np.int8)
    label[:, 0] = -1  # counts nowhere, however wrong
    ours[:, 0] = 9.0
    view = flat_view(ours, reference, label)
    found = agreement([view])
    assert found.pixels == 90
    assert found.p90 == pytest.approx(0.1, rel=1e-4)
    assert found.ratio == pytest.approx(1.05, rel=1e-4)
    assert found.noise == 0.0
    assert agreement([view], CLASSES.index("floor")).pixels == 0


def test_kinds_of_material_have_figures_of_their_own() -> None:
    reference = np.full((10, 10, 3), 0.5)
    ours = reference.copy()
    ours[:, 6:] *= 1.2
    kind = np.zeros((10, 10), np.int8)
    kind[:, 6:] = KINDS.index("metal")
    label = np.zeros((10, 10), np.int8)
    label[:, 9] = -1
    view = replace(flat_view(ours, reference, label), kind=kind)
    found = figures_of([view])
    assert found["diffuse"].pixels == 60
    assert found["metal"].pixels == 30
    assert found["metal"].median == pytest.approx(0.2, rel=1e-4)
    assert overall([[view], [view]]) == pytest.approx({"diffuse": 0.0, "metal": 0.2, "all": 0.0}, abs=1e-4)
    # Neither kind gets light of the other.
    assert (pooled(view).ours == view.ours).all()


def test_materials_are_sorted_by_how_they_reflect() -> None:
    materials = {
        "diffuse": [matte(0.5), matte(0.5, roughness=0.95)],
        "glossy": [matte(0.5, roughness=0.64), matte(0.5, clearcoat=1.0)],
        "metal": [matte(0.5, roughness=0.4, metallic=1.0), matte(0.5, roughness=0.9, metallic=1.0)],
        "glass": [matte(0.5, roughness=0.1, transmission=0.9)],
    }
    for name, own in materials.items():
        for material in own:
            mesh = MeshBuilder().quad([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], material).build()
            assert {KINDS[kind] for kind in face_kinds(Scene("t", (Part("p", mesh),), (), ()))} == {name}


def test_a_sheet_shows_an_earlier_run_from_the_same_poses_in_front(tmp_path: Path) -> None:
    grey = np.full((8, 8, 3), 0.18)
    poses = [Pose.from_yaw((1, 2, 3), 0.5, 0.1)]
    save(tmp_path / "room.npz", [flat_view(2 * grey, grey)], poses, np.ones(3))
    earlier = load_earlier(tmp_path / "room.npz")
    assert np.allclose(earlier.poses[0].matrix, poses[0].matrix)
    picture = sheet([flat_view(grey, grey)], 1.0, earlier.pictures)
    columns = [picture[6, 6 + 12 * n, 0] for n in range(4)]
    assert columns == [int(develop(0.36)), 118, 118, 255]  # before, now, reference, no difference
    with pytest.raises(Avs3dError, match="expected the folder of an earlier run"):
        load_earlier(tmp_path / "kitchen.npz")


def test_noise_is_the_standard_error_of_the_mean_of_both_halves() -> None:
    rng = np.random.default_rng(3)
    halves = 1.0 + 0.1 * rng.standard_normal((2, 200, 200, 1)) * np.ones(3)
    view = replace(flat_view(np.ones((200, 200, 3)), np.ones((200, 200, 3))), halves=halves.astype(np.float32))
    assert agreement([view]).noise == pytest.approx(0.1 / np.sqrt(2), rel=0.05)
    # 49 pixels together have a seventh of the noise; at the rim there are fewer.
    assert agreement([pooled(view)]).noise == pytest.approx(0.1 / np.sqrt(2) / 7, rel=0.1)


def test_a_few_bright_paths_are_left_out_and_noise_is_not() -> None:
    rng = np.random.default_rng(5)
    parts = (1.0 + 0.2 * rng.standard_normal((8, 40, 40, 1)) * np.ones(3)).astype(np.float32)
    assert np.allclose(without_fireflies(parts), parts.reshape(2, 4, 40, 40, 3).mean(axis=1))
    parts[3, :10] = (500.0, 400.0, 300.0)
    halves = without_fireflies(parts)
    assert halves[0, :10].max() < 2.5
    assert np.allclose(halves[1], parts[4:].mean(axis=0))


def test_pooling_mixes_neither_planes_nor_classes() -> None:
    ours = np.zeros((12, 12, 3))
    ours[:, 6:] = 1.0
    label = np.zeros((12, 12), np.int8)
    label[:, 6:] = 1
    apart = pooled(flat_view(ours, ours, label))
    assert (apart.ours == ours).all()
    plane = np.tile(UP, (12, 12, 1))
    plane[:, 6:, 3] = 0.5
    apart = pooled(replace(flat_view(ours, ours), plane=plane))
    assert (apart.ours == ours).all()
    together = pooled(flat_view(ours, ours))
    assert 0.3 < together.ours[6, 6, 0] < 0.7


def test_faces_are_sorted_by_what_they_are_part_of() -> None:
    room = Part("shell_hall", box_room(matte(0.5)).build())
    shelf = Part("hall/shelf_0", MeshBuilder().box((1, 1, 1), (2, 0.5, 1), matte(0.5)).build())
    thing = Part("clock", MeshBuilder().box((0.1, 0.1, 0.1), (2, 1.05, 1), matte(0.5)).build(), instance_id=1)
    lamp = Part("hall/lamp", ceiling_lamp(1.0, 1.0, 0.4, 2.4))
    labels = face_labels(Scene("t", (room, shelf, thing, lamp), (), ()))
    names = [CLASSES[label] if label >= 0 else "" for label in labels]
    assert names[:12] == ["floor"] * 2 + ["ceiling"] * 2 + ["walls"] * 8
    assert names[12:] == ["furniture"] * 12 + ["objects"] * 12 + [""] * 2
    glossy = Part("g", MeshBuilder().box((1, 1, 1), (0, 0, 0), matte(0.5, roughness=0.36)).build())
    assert with_matte_materials(Scene("t", (glossy,), (), ())).parts[0].mesh.materials[0].roughness == 1.0


@pytest.fixture(scope="module")
def reference() -> object:
    pytest.importorskip("mitsuba", reason="the reference renderer is not installed: pip install mitsuba")
    from generators.vision.mitsuba_scene import load_mitsuba

    return load_mitsuba("scalar_rgb")


@pytest.mark.parametrize("albedo", [0.0, 0.5])
def test_reference_in_a_furnace(reference: object, albedo: float) -> None:
    from generators.vision.mitsuba_scene import MitsubaScene

    # Everything glows with e and reflects ρ of what arrives: radiance is e / (1 − ρ) everywhere.
    scene = scene_of(box_room(matte(albedo, emission=(1.0, 0.5, 0.25))).build())
    picture = MitsubaScene(reference, scene).render(
        Pose.from_yaw((2.0, 1.2, 1.5), 0.4), Intrinsics.from_fov(12), samples=64
    )
    expected = np.array([1.0, 0.5, 0.25]) / (1 - albedo)
    assert np.abs(picture.mean(axis=(0, 1)) / expected - 1).max() < 0.02


def test_reference_shows_the_form_factor_of_a_lamp(reference: object) -> None:
    from generators.vision.mitsuba_scene import MitsubaScene

    floor = MeshBuilder().quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], matte(0.5)).build()
    scene = scene_of(floor, ceiling_lamp(0.0, 0.0, 1.0, 2.0))
    # From just below the lamp straight down: the middle of the picture shows the floor's middle.
    pose = Pose((0.0, 1.9, 0.0), (np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0))
    picture = MitsubaScene(reference, scene).render(pose, Intrinsics.from_fov(16), samples=128)
    expected = 0.5 * LAMP.emission[0] * parallel_form_factor(np.zeros(2), 0.5, 2.0)
    assert picture[7:9, 7:9].mean() == pytest.approx(expected, rel=0.02)


def block_room() -> Scene:
    """A grey box with a block on its floor and a lamp below its ceiling."""
    block = MeshBuilder().box((0.6, 0.8, 0.5), (1.0, 0.4, 1.0), matte(0.6), bevel=0.01).build()
    return scene_of(box_room(matte(0.6)).build(), block, ceiling_lamp(2.0, 1.5, 0.8, 2.4))


def ball_room() -> Scene:
    """A grey box with a ball of light."""
    glass = Material("glass", "glass", (0.0, 0.0, 0.0), emission=(8.0, 8.0, 8.0))
    ball = MeshBuilder().sphere(0.15, (1.2, 1.7, 1.0), glass, segments=32, rings=24).build()
    return scene_of(box_room(matte(0.6)).build(), ball)


@pytest.mark.slow
@pytest.mark.parametrize("room", [block_room, ball_room, window_room])
def test_baked_light_agrees_with_the_reference(reference: object, room: Callable[[], Scene]) -> None:
    baked = bake(room(), quality="standard")
    poses = [Pose.from_yaw((2.0, 1.3, 2.6), 0.0), Pose.from_yaw((0.5, 1.3, 2.5), np.radians(-45))]
    found = agreement([pooled(view) for view in compare(reference, baked, None, poses, size=48, samples=16)])
    assert found.noise < 0.03
    assert found.median < 0.03
    assert found.ratio == pytest.approx(1.0, abs=0.02)
