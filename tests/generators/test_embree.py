"""The CPU renderer against closed forms: geometry exactly, colour to one level, filtering to its mean."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

import generators.vision
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.shapes import MeshBuilder, rotation
from generators.core.scene import LightMap, Material, Mesh, Part, Scene, Texture
from generators.core.tone import WHITE, develop, inverse_tone_curve, srgb_decode, srgb_encode, tone_curve
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend, warm_up
from generators.vision.textures_pool import build_pool, distinct, mip_chain

ROOT = Path(__file__).parents[2]
ORIGIN = Pose.from_yaw((0, 0, 0), 0.0)
GREY = Material("grey", "plaster", colour=(0.5, 0.5, 0.5))
BLACK = Material("black", "plaster", colour=(0.0, 0.0, 0.0))
#: Shown as full white, so that linear display light over black is coverage itself.
LAMP = Material("lamp", "glass", colour=(0.0, 0.0, 0.0), emission=(WHITE, WHITE, WHITE))


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


def _scene(*meshes: Mesh, exposure: float = 1.0) -> Scene:
    """Part i has instance id i."""
    return Scene("test", tuple(Part(f"p{i}", m, instance_id=i) for i, m in enumerate(meshes)), (), (), exposure)


def _render(scene: Scene, pose: Pose = ORIGIN, size: int = 96, camera: Intrinsics | None = None) -> RenderedView:
    session = EmbreeBackend().open(scene, camera or Intrinsics.from_fov(size))
    try:
        return session.render(pose)
    finally:
        session.close()


def _wall(material: Material, z: float = -4.0, half: float = 20.0) -> Mesh:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return MeshBuilder().quad(corners, material, fit=True).build()


def _box(size: ArrayLike, centre: ArrayLike, material: Material = GREY, **options: object) -> Mesh:
    return MeshBuilder().box(np.asarray(size), np.asarray(centre), material, **options).build()  # type: ignore[arg-type]


def _display(frame: RenderedView) -> NDArray[np.float64]:
    return srgb_decode(frame.rgb / 255.0)


# --- geometry -------------------------------------------------------------------------------------------------------


def test_ids_cover_exactly_the_pixel_centres_of_the_projection() -> None:
    camera = Intrinsics(160, 120, 100.0, 110.0, 83.3, 57.7)
    frame = _render(_scene(_wall(GREY), _box((1.0, 0.7, 0.5), (0.2, -0.1, -2.25))), camera=camera)
    # Its front lies at depth 2 and hides the rest of the box.
    left, right = (camera.cx + camera.fx * x / 2.0 for x in (-0.3, 0.7))
    top, bottom = (camera.cy - camera.fy * y / 2.0 for y in (0.25, -0.45))
    column, row = np.arange(160) + 0.5, np.arange(120) + 0.5
    expected = ((top < row) & (row < bottom))[:, None] & ((left < column) & (column < right))[None, :]
    assert expected.sum() > 1000
    assert np.array_equal(frame.instance_ids == 1, expected)
    np.testing.assert_allclose(frame.depth, np.where(expected, 2.0, 4.0), atol=1e-5)


def test_depth_of_a_slanted_plane_at_every_pixel() -> None:
    # y = −1 + 0.3 x − 0.2 z.
    corners = [[x, -1 + 0.3 * x - 0.2 * z, z] for x, z in ((-9, 3), (9, 3), (9, -12), (-9, -12))]
    mesh = MeshBuilder().quad(corners, GREY, subdivide=0.5).build()
    pose = Pose.from_yaw((0.1, 0.8, 0.2), 0.3, -0.5)
    frame = _render(_scene(mesh), pose, size=128)
    pixel = np.arange(128) + 0.5
    u, v = np.meshgrid(pixel, pixel)
    ray = np.stack([(u - 64) / 64, -(v - 64) / 64, -np.ones_like(u)], axis=2) @ pose.rotation_matrix.T
    normal = np.array([-0.3, 1.0, 0.2])
    depth = (-1.0 - normal @ np.array(pose.position)) / (ray @ normal)
    point = np.asarray(pose.position) + depth[..., None] * ray
    hit = (depth > 0) & (np.abs(point[..., 0]) < 8.99) & (point[..., 2] > -11.99) & (point[..., 2] < 2.99)
    assert hit.mean() > 0.5
    np.testing.assert_allclose(frame.depth[hit], depth[hit], atol=1e-4)


def test_nothing_hit_has_depth_0_id_0_and_a_bright_neutral_colour() -> None:
    frame = _render(_scene(_box((1, 1, 1), (0, 0, 5))))
    assert not frame.depth.any()
    assert not frame.instance_ids.any()
    assert (frame.rgb.max(axis=2) == frame.rgb.min(axis=2)).all()
    assert frame.rgb.min() > 200
    assert frame.rgb.shape == (96, 96, 3)
    assert [a.dtype.name for a in (frame.rgb, frame.depth, frame.instance_ids)] == ["uint8", "float32", "uint16"]


@pytest.mark.parametrize(
    ("pose", "where"),
    [
        (ORIGIN, (1, 0)),  # a thing to the right is seen at u > cx
        (Pose.from_yaw((0, 0, 0), 0.1), (1, 0)),  # turning left moves it further right
        (Pose.from_yaw((0, 0, 0), -1.2), (-1, 0)),  # turning right, past it, moves it to the left
        (Pose.from_yaw((0, -1.0, 0), 0.0), (1, -1)),  # from below it is up: a smaller v
        (Pose.from_yaw((1.2, 0, 0), 0.0, 0.4), (0, 1)),  # tilting up moves it down
    ],
)
def test_camera_orientation(pose: Pose, where: tuple[int, int]) -> None:
    mesh = _box((0.2, 0.2, 0.2), (1.2, 0, -2))
    ids = _render(_scene(_wall(GREY, z=-9), mesh), pose).instance_ids
    rows, columns = np.nonzero(ids)
    centre = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
    projected, _ = Intrinsics.from_fov(96).project(pose, np.array([[1.2, 0, -2]]))
    np.testing.assert_allclose(centre, projected[0], atol=1.5)
    assert tuple(np.where(np.abs(centre - 48) < 1.5, 0, np.sign(centre - 48)).astype(int)) == where


def test_masks_are_visible_only() -> None:
    near, far = _box((0.5, 0.5, 0.1), (0.2, 0, -2)), _box((1.0, 1.0, 0.1), (0, 0, -3))
    alone, both = _render(_scene(_wall(GREY), far)), _render(_scene(_wall(GREY), far, near))
    covered = both.instance_ids == 2
    assert covered.any()
    assert np.array_equal(both.instance_ids == 1, (alone.instance_ids == 1) & ~covered)
    assert not _render(_scene(_wall(GREY), far, _wall(GREY, z=-1))).instance_ids.__eq__(1).any()


def test_agrees_with_brute_force_in_float64() -> None:
    # Möller and Trumbore's test of every triangle for every pixel, written for this test alone.
    rng = np.random.default_rng(11)
    triangles = rng.uniform(-2, 2, (120, 1, 3)) + rng.normal(0, 0.4, (120, 3, 3)) + [0, 0, -4]
    faces = np.arange(9).reshape(3, 3)
    meshes = []
    for block in triangles.reshape(40, 9, 3):
        meshes.append(MeshBuilder().add(block, faces, GREY).build())
    pose = Pose.from_yaw((0.3, -0.2, 0.5), 0.1, 0.05)
    frame = _render(_scene(*meshes), pose, size=64)
    pixel = (np.arange(64) + 0.5 - 32) / 32
    x, y = np.meshgrid(pixel, -pixel)
    ray = (np.stack([x, y, -np.ones_like(x)], axis=2) @ pose.rotation_matrix.T).reshape(-1, 1, 3)
    corner = np.concatenate([m.positions for m in meshes]).astype(np.float64)
    e1, e2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    p = np.cross(ray, e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (p * e1).sum(axis=2)
        t0 = np.asarray(pose.position) - corner[:, 0]
        u = (p * t0).sum(axis=2) * inverse
        q = np.cross(t0, e1)
        v = (ray * q).sum(axis=2) * inverse
        t = (q * e2).sum(axis=1) * inverse
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    nearest = t.min(axis=1)
    ids = np.where(np.isfinite(nearest), t.argmin(axis=1) // 3, 0).reshape(64, 64)
    depth = np.where(np.isfinite(nearest), nearest, 0.0).reshape(64, 64)
    assert (ids > 0).sum() > 500
    assert np.array_equal(frame.instance_ids, ids)
    np.testing.assert_allclose(frame.depth, depth, rtol=1e-5)


# --- colour ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("exposure", [0.3, 1.0, 2.5])
def test_colour_of_a_lit_matte_quad(exposure: float) -> None:
    light = np.array([1.3, 0.9, 0.4], dtype=np.float16)
    level, colour, emission = 180, (0.8, 0.5, 0.9), (0.0, 0.02, 0.1)
    texture = Texture("flat", np.full((8, 8, 3), level, dtype=np.uint8))
    mesh = _wall(Material("paint", "plaster", colour=colour, texture=texture, emission=emission))
    lit = LightMap((mesh.uv * 0.5 + 0.25).astype(np.float32), np.broadcast_to(light, (4, 4, 3)).copy())
    scene = Scene("lit", (Part("wall", mesh, light=lit),), (), (), exposure=exposure)
    albedo = np.array(colour) * srgb_decode(level / 255)
    expected = develop(exposure * (albedo * light.astype(np.float64) + np.array(emission)))
    assert np.abs(_render(scene).rgb.astype(int) - expected.astype(int)).max() <= 1


def test_light_map_is_bilinear_between_texel_centres() -> None:
    mesh = _wall(Material("white", "plaster"), half=4.0)  # fills the view at 90°
    texels = np.zeros((1, 4, 3), dtype=np.float16)
    texels[0, :, :] = np.array([0.1, 0.3, 0.9, 0.5])[:, None]
    light = LightMap(mesh.uv, texels)
    found = _render(Scene("ramp", (Part("wall", mesh, light=light),), (), ()), size=128).rgb[64, :, 0]
    position = (np.arange(128) + 0.5) / 128 * 4 - 0.5
    expected = develop(np.interp(position, np.arange(4), texels[0, :, 0].astype(float)))
    assert np.abs(found.astype(int) - expected.astype(int)).max() <= 1


def test_texture_is_upright_and_not_mirrored() -> None:
    red, green, blue, white = (200, 20, 20), (20, 200, 20), (20, 20, 200), (220, 220, 220)
    pixels = np.array([[red, green], [blue, white]], dtype=np.uint8).repeat(32, axis=0).repeat(32, axis=1)
    mesh = _wall(Material("flag", "fabric", texture=Texture("flag", pixels)), half=4.0)
    frame = _render(_scene(mesh))
    for (row, column), colour in (
        ((24, 24), red),
        ((24, 72), green),
        ((72, 24), blue),
        ((72, 72), white),
    ):
        expected = develop(srgb_decode(np.array(colour) / 255))
        assert np.abs(frame.rgb[row, column].astype(int) - expected).max() <= 1


def test_a_back_face_is_shaded_like_its_front() -> None:
    texture = Texture("stripe", np.array([[[200, 40, 40], [40, 40, 200]]], dtype=np.uint8))
    front = _wall(Material("sheet", "fabric", texture=texture), half=4.0)
    back = replace(front, positions=front.positions * np.array([-1, 1, 1], dtype=np.float32))
    seen, mirrored = _render(_scene(front)), _render(_scene(back))
    assert np.abs(seen.rgb.astype(int) - mirrored.rgb[:, ::-1].astype(int)).max() <= 1
    assert np.array_equal(seen.depth, mirrored.depth[:, ::-1])


# --- filtering ------------------------------------------------------------------------------------------------------


def _checker(cells: int, size: int) -> Texture:
    y, x = np.mgrid[0:size, 0:size]
    dark = ((x * cells // size + y * cells // size) % 2)[..., None]
    return Texture("checker", np.where(dark, 30, 230).astype(np.uint8).repeat(3, axis=2))


def _psnr(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    return 10 * math.log10(255**2 / max(float(((a.astype(float) - b) ** 2).mean()), 1e-12))


def _floor(material: Material, tile: float) -> Scene:
    corners = [[-60, -1, 5], [60, -1, 5], [60, -1, -100], [-60, -1, -100]]
    return _scene(MeshBuilder({material.name: tile}).quad(corners, material).build(), exposure=0.7)


def _supersampled(scene: Scene, pose: Pose, size: int) -> NDArray[np.uint8]:
    """64 rays per pixel, averaged in scene light."""
    big = _display(_render(scene, pose, size=8 * size))
    light = inverse_tone_curve(big).reshape(size, 8, size, 8, 3).mean(axis=(1, 3))
    return develop(light)


@pytest.mark.parametrize(("light", "contrast", "levels"), [(0.30, (9, 24), 5), (0.45, (30, 60), 9)])
def test_a_faint_edge_has_steps_of_a_quarter_others_of_an_eighth(
    light: float, contrast: tuple[int, int], levels: int
) -> None:
    shining = [replace(BLACK, name=str(value), emission=(value,) * 3) for value in (0.25, light)]
    corners = [[0.1, -9, -3.9], [9, -9, -3.9], [9, 9, -3.9], [0.7, 9, -3.9]]  # its left edge leans
    frame = _render(_scene(_wall(shining[0]), MeshBuilder().quad(corners, shining[1]).build()))
    dark, bright = int(frame.rgb[..., 0].min()), int(frame.rgb[..., 0].max())
    assert contrast[0] <= bright - dark <= contrast[1]
    assert len(np.unique(frame.rgb)) == levels
    # On the linear scale the steps are equal.
    steps = np.diff(np.unique(_display(frame)))
    assert steps.max() - steps.min() <= 0.01


def test_a_checker_far_away_fades_to_its_mean() -> None:
    scene = _floor(Material("checker", "tile", texture=_checker(2, 256)), tile=0.2)
    pose = Pose.from_yaw((0, 0, 0), 0.4)
    frame = _render(scene, pose, size=128)
    far = frame.rgb[66:68]  # 18 to 26 m away, where a pixel is wider than a cell
    mean = develop(0.7 * srgb_decode(np.array([30, 230]) / 255).mean())
    assert np.abs(far.astype(int) - mean).max() <= 3
    reference = _supersampled(scene, pose, 128)
    assert _psnr(frame.rgb[66:], reference[66:]) >= 35


def test_textures_stay_sharp_where_texels_match_pixels() -> None:
    # Filtering must not blur what a pixel can show: a checker of 4-pixel cells keeps its contrast.
    mesh = _wall(Material("checker", "tile", texture=_checker(24, 96 * 2)), half=4.0)
    frame = _render(_scene(mesh), size=96)
    inside = frame.rgb[1::4, 1::4, 0]  # off the cells' borders
    low, high = develop(srgb_decode(np.array([30, 230]) / 255))
    assert set(np.unique(inside // 8)) <= set(np.unique(np.array([low, high]) // 8))


def test_mip_chain_keeps_the_mean_of_light_for_any_size() -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (37, 50, 3), dtype=np.uint8)
    levels = mip_chain(pixels)
    assert [level.shape[:2] for level in levels] == [(37, 50), (18, 25), (9, 12), (4, 6), (2, 3), (1, 1)]
    mean = srgb_decode(pixels / 255).mean(axis=(0, 1))
    for level in levels:
        np.testing.assert_allclose(srgb_decode(level / 255).mean(axis=(0, 1)), mean, atol=0.004)


def test_levels_of_a_texture_are_rounded_as_the_transfer_function_says() -> None:
    values = np.arange(256, dtype=np.uint8)
    pixels = np.repeat(np.stack([values, np.roll(values, 1)], axis=1)[:, :, None], 3, axis=2)
    light = srgb_decode(pixels / 255).astype(np.float32)
    halved = (light[0::2] + light[1::2]) * np.float32(0.5)
    expected = np.rint(255 * srgb_encode((halved[:, :1] + halved[:, 1:]) * np.float32(0.5)))
    np.testing.assert_array_equal(mip_chain(pixels)[1], expected)


def test_equal_textures_are_stored_once() -> None:
    first, second = _checker(4, 64), _checker(4, 64)
    unique, index = distinct([first, None, second, _checker(2, 64)])
    assert index == [0, -1, 0, 1]
    assert len(unique) == 2
    pool = build_pool(unique)
    assert len(pool.texels) < 2 * 64 * 64 * 3 * 1.4
    assert pool.texels.dtype == np.uint8


# --- edges ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [3.0, 20.0, 45.0, 71.0, 88.0])
def test_an_edge_is_covered_as_it_should_be(degrees: float) -> None:
    turn = rotation("z", degrees)
    lamp = MeshBuilder().add(
        np.array([[-9, -9, -2], [0, -9, -2], [0, 9, -2], [-9, 9, -2]]) @ turn.T, [[0, 1, 2], [0, 2, 3]], LAMP
    )
    found = _display(_render(_scene(_wall(BLACK), lamp.build()), size=64))[..., 0]
    fine = (np.arange(64 * 16) + 0.5) / 16 - 32
    x, y = np.meshgrid(fine, -fine)
    inside = x * math.cos(math.radians(degrees)) + y * math.sin(math.radians(degrees)) < 0
    coverage = inside.reshape(64, 16, 64, 16).mean(axis=(1, 3))
    partial = (coverage > 0.02) & (coverage < 0.98)
    assert partial.sum() >= 60
    assert np.abs(found - coverage).max() <= 0.17
    assert np.abs(found - coverage)[partial].mean() <= 0.07


@pytest.mark.parametrize("degrees", [1.0, 4.0, 89.0])
def test_a_wire_thinner_than_a_pixel_is_not_dashed(degrees: float) -> None:
    width = 0.4 / 48 * 2  # 0.4 pixels at depth 2
    wire = MeshBuilder().box((width, 3.0, width), (0.013, 0, 0), LAMP).build()
    mesh = wire.transformed(rotation("z", degrees), np.array([0.0, 0.0, -2.0]))
    light = _display(_render(_scene(_wall(BLACK), mesh)))[..., 0]
    energy = light.sum(axis=0 if degrees > 45 else 1)[15:-15]  # light per row that the wire crosses
    assert energy.min() > 0.1
    assert energy.mean() == pytest.approx(0.4, rel=0.15)


def test_a_seam_where_the_texture_jumps_is_an_edge_too() -> None:
    # One material and one plane, but the two halves show different texels.
    pixels = np.array([[[255, 255, 255], [0, 0, 0]]], dtype=np.uint8).repeat(32, axis=1)
    sheet = Material("sheet", "fabric", texture=Texture("halves", pixels), colour=(WHITE,) * 3)
    corners = np.array([[-9, -9, -2], [0, -9, -2], [0, 9, -2], [-9, 9, -2]]) @ rotation("z", 20).T
    mesh = MeshBuilder()
    for turn, u in ((0, 0.25), (180, 0.75)):
        place = np.broadcast_to([u, 0.5], (2, 3, 2))
        mesh.add(corners @ rotation("z", turn).T, [[0, 1, 2], [0, 2, 3]], sheet, uv=place)
    row = _display(_render(_scene(mesh.build()), size=64))[8:56, :, 0]
    grey = (row > 0.05) & (row < 0.95)
    assert grey.any(axis=1).mean() > 0.9
    assert row.mean() == pytest.approx(0.5, abs=0.01)


def test_a_hidden_wire_stays_hidden() -> None:
    wire = MeshBuilder().box((0.005, 3.0, 0.005), (0, 0, -5), LAMP).build()
    assert not _render(_scene(_wall(BLACK), wire)).rgb.any()


def test_a_smooth_wall_of_many_faces_shows_no_cracks() -> None:
    lamp_box = _box((8, 5, 8), (0, 0, 0), LAMP, bevel=0.5, segments=6)
    for yaw in np.linspace(0, 6, 7):
        frame = _render(_scene(lamp_box), Pose.from_yaw((0.3, 0.2, 0.1), float(yaw), 0.2))
        assert (frame.depth > 0).all()
        assert (frame.rgb == 255).all()


# --- a session ------------------------------------------------------------------------------------------------------


def _busy() -> Scene:
    rng = np.random.default_rng(4)
    builder = MeshBuilder({"checker": 0.4})
    checker = Material("checker", "tile", texture=_checker(3, 48))
    for i in range(30):
        centre, size = rng.uniform((-2, -2, -6), (2, 2, -2)), rng.uniform(0.05, 0.6, 3)
        material = (GREY, checker, LAMP)[i % 3]
        builder.box(
            size.tolist(), centre.tolist(), material, bevel=0.02, rotate=rotation("y", float(rng.uniform(0, 90)))
        )
    return _scene(_wall(checker, z=-8), builder.build(), exposure=1.7)


def _digest(frame: RenderedView) -> str:
    return hashlib.sha256(frame.rgb.tobytes() + frame.depth.tobytes() + frame.instance_ids.tobytes()).hexdigest()


def test_the_same_pose_gives_the_same_bytes_whatever_came_before_and_in_another_process() -> None:
    session = EmbreeBackend().open(_busy(), Intrinsics.from_fov(120))
    first = _digest(session.render(ORIGIN))
    session.render(Pose.from_yaw((0.5, 0.2, 0.1), 0.6))
    assert _digest(session.render(ORIGIN)) == first
    session.close()
    code = "from tests.generators import test_embree as t; print(t._digest(t._render(t._busy(), size=120)))"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120, cwd=ROOT
    )
    assert run.stdout.strip() == first


@pytest.mark.parametrize("wanted", ["checker", "glossy", "all", "none"])
def test_labels_have_the_depth_and_ids_of_the_picture_and_the_colours_that_are_wanted(wanted: str) -> None:
    scene = _busy()
    glossy = Material("glossy", "tile", colour=(0.5, 0.4, 0.3), roughness=0.2)
    scene = replace(scene, parts=(*scene.parts, Part("glossy", _wall(glossy, z=-3.0, half=0.8), instance_id=7)))
    names = [[wanted in (m.name, "all") for m in part.mesh.materials] for part in scene.parts]
    faces = [np.array(own)[part.mesh.face_material] for own, part in zip(names, scene.parts, strict=True)]
    coloured = np.append(np.concatenate(faces), False)
    session = EmbreeBackend().open(scene, Intrinsics.from_fov(120))
    whole = session.render(ORIGIN)
    session.render(Pose.from_yaw((0.5, 0.2, 0.1), 0.6))
    found = session.labels(ORIGIN, coloured)
    assert np.array_equal(found.depth, whole.depth)
    assert np.array_equal(found.instance_ids, whole.instance_ids)
    inside = ndimage.binary_erosion(coloured[session.faces], np.ones((3, 3), dtype=bool), border_value=1)
    assert (inside.sum() > 500) == (wanted != "none")
    assert np.array_equal(found.rgb[inside], whole.rgb[inside])


def test_a_closed_session_says_so() -> None:
    session = EmbreeBackend().open(_scene(_wall(GREY)), Intrinsics.from_fov(16))
    session.close()
    session.close()
    with pytest.raises(Avs3dError, match="closed"):
        session.render(ORIGIN)


def _with(mesh: Mesh, **fields: object) -> Scene:
    return _scene(replace(mesh, **fields))  # type: ignore[arg-type]


#: A texture without colour channels.
FLAT = Texture("flat", np.zeros((2, 2), dtype=np.uint8))


def _lit(uv: ArrayLike, texels: ArrayLike) -> Scene:
    light = LightMap(np.asarray(uv, dtype=np.float32), np.asarray(texels, dtype=np.float16))
    return Scene("s", (Part("p", _wall(GREY), light=light),), (), ())


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (Scene("void", (), (), ()), "void: the scene has no parts"),
        (_scene(_wall(GREY), exposure=0.0), "exposure"),
        (_with(_wall(GREY), positions=np.full((2, 3, 3), np.nan, dtype=np.float32)), "test/p0: positions has 18"),
        (_with(_wall(GREY), uv=np.zeros((1, 3, 2), np.float32)), "uv has shape"),
        (_with(_wall(GREY), materials=(replace(GREY, colour=(np.nan, 0.0, 0.0)),)), "material 'grey'"),
        (_with(_wall(GREY), materials=(replace(GREY, texture=FLAT),)), "texture 'flat'"),
        (Scene("s", (Part("p", _wall(GREY), instance_id=70000),), (), ()), "s/p: instance id 70000"),
        (_lit(np.zeros((1, 3, 2)), np.ones((2, 2, 3))), "light map's uv has shape"),
        (_lit(np.zeros((2, 3, 2)), np.ones((2, 2))), "light map has shape"),
        (_lit(np.zeros((2, 3, 2)), np.full((2, 2, 3), np.inf)), "NaN or infinite"),
    ],
)
def test_a_bad_scene_is_refused_in_one_line(scene: Scene, message: str) -> None:
    with pytest.raises(Avs3dError, match=message) as caught:
        EmbreeBackend().open(scene, Intrinsics.from_fov(16))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("camera", [Intrinsics(0, 4, 1, 1, 1, 1), Intrinsics(4, 4, math.nan, 1, 1, 1)])
def test_a_bad_camera_is_refused(camera: Intrinsics) -> None:
    with pytest.raises(Avs3dError, match="camera"):
        EmbreeBackend().open(_scene(_wall(GREY)), camera)


@pytest.mark.parametrize("package", ["embreex.rtcore_scene", "numba"])
def test_a_missing_package_names_the_extra_to_install(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("generators.core.jit", "generators.vision.kernels"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.delattr(generators.vision, "kernels", raising=False)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(Avs3dError, match=r"pip install 'avs3d-bench\[generate\]'"):
        EmbreeBackend().open(_scene(_wall(GREY)), Intrinsics.from_fov(16))


def test_display_light_is_averaged_after_the_tone_curve() -> None:
    # An edge between a lamp ten times brighter than white and black must not look jagged: half covered is half lit.
    sun = replace(LAMP, emission=(10 * WHITE,) * 3)
    half = _box((2, 2, 0.1), (-1.0, 0, -2.05), sun)
    row = _display(_render(_scene(_wall(BLACK), half), camera=Intrinsics(33, 33, 30, 30, 16.5, 16.5)))[16, :, 0]
    assert row[16] == pytest.approx(0.5, abs=0.02)
    assert tone_curve(10 * WHITE / 2) == 1.0
