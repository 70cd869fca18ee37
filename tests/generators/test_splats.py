"""Splats as pictures: the model of the picture by closed forms, and what objects do among splats."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.gaussian_ply import GaussianTable, write_gaussians
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Material, Part, Scene, SplatFile, StageFile, Texture
from generators.core.tone import srgb_decode, srgb_encode
from generators.vision.embree import EmbreeBackend
from generators.vision.splats.backend import TOLERANCE, SplatsBackend, SplatsSession, camera_of
from generators.vision.splats.cloud import SplatCloud, rotation_of_harmonics, transformed
from generators.vision.splats.gsplat_painter import GsplatPainter, gsplat_problem, tiles_with
from generators.vision.splats.kernels import BLUR, harmonics
from generators.vision.splats.painter import NumbaPainter, SplatLayers
from tests.support.captured import captured, gaussians

CAMERA = Intrinsics.from_fov(64)
AHEAD = Pose.from_yaw((0.0, 0.0, 0.0), 0.0)  # looks along −Z
SCAN = Path(__file__).parents[3] / "shared" / "scans" / "tatami_room.glb"


def cloud_of(table: GaussianTable, to_world: np.ndarray | None = None) -> SplatCloud:
    alpha = 1.0 / (1.0 + np.exp(-table.opacities.astype(np.float64)))
    return transformed(table, alpha.astype(np.float32), np.eye(4) if to_world is None else to_world)


def paint(
    table: GaussianTable, pose: Pose = AHEAD, camera: Intrinsics = CAMERA, cut: np.ndarray | None = None
) -> SplatLayers:
    nothing = np.zeros((camera.height, camera.width), dtype=np.float32)
    return NumbaPainter(cloud_of(table)).paint(camera_of(camera, pose), nothing if cut is None else cut)


def centres(camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the pixel centres."""
    return np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)


# --- the model of the picture


def test_a_ball_ahead_is_the_gaussian_of_ewa_splatting() -> None:
    sigma, depth, opacity, colour = 0.1, 2.0, 0.8, np.array([0.9, 0.5, 0.1])
    layers = paint(gaussians([[0, 0, -depth]], sigma, opacity, colours=colour))
    u, v = centres(CAMERA)
    variance = (CAMERA.fx * sigma / depth) ** 2 + BLUR
    alpha = opacity * np.exp(-((u - CAMERA.cx) ** 2 + (v - CAMERA.cy) ** 2) / (2 * variance))
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(1 - layers.whole[..., 3], alpha, atol=2e-6)
    np.testing.assert_allclose(layers.whole[..., :3], alpha[..., None] * colour, atol=2e-6)
    np.testing.assert_allclose(layers.depth()[alpha > 0], depth, rtol=1e-5)


def projected(point: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Column and row of a point in camera coordinates (−Z ahead)."""
    x, y, z = point
    return np.array([camera.cx + camera.fx * x / -z, camera.cy - camera.fy * y / -z])


def test_an_ellipsoid_aside_has_the_covariance_of_the_linearised_projection() -> None:
    centre, scales = np.array([0.5, -0.4, -2.0]), np.array([0.15, 0.05, 0.1])
    turn = Rotation.from_euler("xyz", [0.4, -0.8, 1.1])
    layers = paint(gaussians([centre], [scales], 0.9, rotations=[np.roll(turn.as_quat(), 1)]))
    step = 1e-6
    jacobian = np.stack(
        [(projected(centre + d, CAMERA) - projected(centre - d, CAMERA)) / (2 * step) for d in np.eye(3) * step], axis=1
    )
    axes = turn.as_matrix() * scales
    covariance = jacobian @ axes @ axes.T @ jacobian.T + BLUR * np.eye(2)
    offset = np.stack(centres(CAMERA), axis=-1) - projected(centre, CAMERA)
    power = np.einsum("hwi,ij,hwj->hw", offset, np.linalg.inv(covariance), offset)
    alpha = 0.9 * np.exp(-power / 2)
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(1 - layers.whole[..., 3], alpha, atol=1e-5)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_nearer_splats_cover_farther_ones_whatever_their_order(order: tuple[int, ...]) -> None:
    alphas, colours = np.array([0.3, 0.6, 0.9]), np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    means = np.array([[0, 0, -1.0], [0, 0, -2.0], [0, 0, -3.0]])
    pick = list(order)
    camera = Intrinsics.from_fov(65)  # the axis goes through the centre of a pixel
    layers = paint(gaussians(means[pick], 0.3, alphas[pick], colours=colours[pick]), camera=camera)
    red, green, blue = 0.3, 0.7 * 0.6, 0.7 * 0.4 * 0.9
    np.testing.assert_allclose(layers.whole[32, 32, :4], [red, green, blue, 0.7 * 0.4 * 0.1], atol=1e-6)


def test_of_equally_deep_splats_the_first_of_the_file_is_in_front() -> None:
    camera = Intrinsics.from_fov(65)
    two = gaussians([[0, 0, -1.0]] * 2, 0.3, 0.5, colours=[[1.0, 0, 0], [0, 1.0, 0]])
    np.testing.assert_allclose(paint(two, camera=camera).whole[32, 32, :2], [0.5, 0.25], atol=1e-6)


def test_a_pixel_ends_before_nothing_is_left_of_the_light() -> None:
    camera = Intrinsics.from_fov(65)
    layers = paint(gaussians([[0, 0, -1.0 - 0.1 * i] for i in range(6)], 0.3, 0.99), camera=camera)
    # 0.01² is 1e-4: the second splat would bring the transmittance there.
    assert layers.whole[32, 32, 3] == pytest.approx(0.01, rel=1e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_harmonics_of_degree_1_change_colour_with_the_direction(axis: int) -> None:
    sh = np.zeros((1, 4, 3))
    band, sign = {0: (3, -1), 1: (1, -1), 2: (2, 1)}[axis]  # −y, z, −x
    sh[0, band] = 0.4
    camera = Intrinsics.from_fov(65)
    for side in (-1.0, 1.0):
        eye = side * np.eye(3)[axis]
        backward = eye
        up = np.eye(3)[(axis + 1) % 3]
        matrix = np.stack([np.cross(up, backward), up, backward], axis=1)
        x, y, z, w = Rotation.from_matrix(matrix).as_quat()
        pose = Pose(tuple(2 * eye), (w, x, y, z))
        layers = paint(gaussians([[0, 0, 0]], 0.2, 0.5, sh=sh), pose, camera)
        # The direction is from the eye to the splat.
        expected = 0.5 + sign * -side * 0.4886025119029199 * 0.4
        np.testing.assert_allclose(layers.whole[32, 32, :3], 0.5 * expected, atol=1e-6)


def test_colours_below_black_are_black() -> None:
    camera = Intrinsics.from_fov(65)
    layers = paint(gaussians([[0, 0, -1.0]], 0.3, 0.9, colours=[[-0.5, 0.2, 1.4]]), camera=camera)
    np.testing.assert_allclose(layers.whole[32, 32, :3], [0, 0.18, 1.26], atol=1e-6)


def test_splats_behind_and_at_the_lens_are_not_drawn() -> None:
    layers = paint(gaussians([[0, 0, 1.0], [0, 0, -0.04], [0, 0, 0]], 0.3, 0.9))
    assert (layers.whole[..., 3] == 1).all()


def random_table(rng: np.random.Generator, count: int, degree: int) -> GaussianTable:
    sh = np.concatenate(
        [rng.normal(0, 0.6, (count, 1, 3)), rng.normal(0, 0.2, (count, (degree + 1) ** 2 - 1, 3))], axis=1
    )
    return gaussians(
        rng.normal(0, 0.5, (count, 3)), rng.uniform(0.02, 0.2, (count, 3)), rng.uniform(0.05, 0.95, count),
        rotations=rng.normal(size=(count, 4)), sh=sh,
    )  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.floats(0.2, 5.0))
def test_a_turned_and_scaled_scene_looks_the_same_to_a_camera_that_went_along(
    seed: int, degree: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    table = random_table(rng, 30, degree)
    turn, shift = Rotation.random(random_state=seed % 1000), rng.normal(size=3)
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = scale * turn.as_matrix(), shift
    pose = Pose.from_yaw((0.3, 0.2, 2.5), 0.1, -0.1)
    x, y, z, w = (turn * Rotation.from_matrix(pose.rotation_matrix)).as_quat()
    went = Pose(tuple(scale * turn.apply(pose.position) + shift), (w, x, y, z))
    nothing = np.zeros((64, 64), dtype=np.float32)
    still = NumbaPainter(cloud_of(table)).paint(camera_of(CAMERA, pose), nothing)
    along = NumbaPainter(cloud_of(table, moved)).paint(camera_of(CAMERA, went), nothing)
    # Rounding may move an α across 1/255.
    np.testing.assert_allclose(along.whole[..., :4], still.whole[..., :4], atol=6e-3)
    assert np.abs(along.whole[..., :4] - still.whole[..., :4]).mean() < 1e-4


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 3))
def test_the_rotation_of_harmonics_is_orthogonal_and_turns_functions(seed: int, degree: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    matrix = rotation_of_harmonics(turn, degree)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(2 * degree + 1), atol=1e-12)
    direction = Rotation.random(5, random_state=seed + 1).apply([0.0, 0, 1])
    values, turned = np.empty((2, 5, (degree + 1) ** 2))
    harmonics(direction, values)
    harmonics(np.ascontiguousarray(direction @ turn.T), turned)
    # f'(R d) = f(d) for every basis function f of the degree.
    np.testing.assert_allclose(turned[:, degree**2 :] @ matrix, values[:, degree**2 :], atol=1e-12)


def test_pictures_are_those_of_the_rasteriser_of_echosegnet() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed; it draws the pictures to compare with")
    from baselines.echosegnet.gaussians import Gaussians
    from baselines.echosegnet.rasteriser.default import TorchRasteriser
    from baselines.echosegnet.views import RegisteredView

    table, pose = random_table(np.random.default_rng(3), 400, 3), Pose.from_yaw((0.3, 0.2, 2.5), 0.1, -0.1)
    opencv = pose.rotation_matrix @ np.diag([1.0, -1.0, -1.0])
    view = RegisteredView("frame_000", "train", CAMERA, opencv, np.array(pose.position), None)  # type: ignore[arg-type]
    parts = (table.means, table.log_scales, table.rotations, table.opacities, table.sh)
    theirs = TorchRasteriser().render(Gaussians(*(torch.from_numpy(part) for part in parts)), view)
    ours = paint(table, pose)
    np.testing.assert_allclose(ours.whole[..., :3], theirs.rgb.numpy(), atol=6e-3)
    assert np.abs(ours.whole[..., :3] - theirs.rgb.numpy()).mean() < 2e-5
    np.testing.assert_allclose(1 - ours.whole[..., 3], theirs.alpha.numpy(), atol=6e-3)


def test_the_depth_of_a_slanted_disc_is_that_of_its_plane() -> None:
    # A large disc that is turned by 60° about the vertical axis.
    turn = Rotation.from_euler("y", 60, degrees=True)
    disc = gaussians([[0, 0, -3.0]], [[0.5, 0.5, 1e-4]], 0.99, rotations=[np.roll(turn.as_quat(), 1)])
    camera = Intrinsics.from_fov(256)
    layers = paint(disc, camera=camera)
    u, v = centres(camera)
    direction = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], axis=-1)
    normal = turn.apply([0.0, 0, 1])
    plane = (normal @ [0, 0, -3.0]) / (direction @ normal)
    seen = layers.whole[..., 3] < 0.8
    assert seen.sum() > 1000
    np.testing.assert_allclose(layers.depth()[seen], plane[seen], rtol=2e-3)


# --- objects among splats

GREY = Material("grey", "plaster", colour=(0.5, 0.5, 0.5))


def scene_with_box(box_at: tuple[float, float, float] = (0.0, 0.0, -2.0)) -> Scene:
    """A wall of a scan at z = −4, and a lit white box of 0.6 m before it."""
    picture = Texture("wall", np.full((4, 4, 3), 90, dtype=np.uint8))
    wall = MeshBuilder().box((8, 8, 0.1), (0, 0, -4.05), Material("wall", "plaster", texture=picture)).build()
    box = MeshBuilder().box((0.6, 0.6, 0.6), box_at, Material("white", "plaster", colour=(0.8, 0.8, 0.8))).build()
    light = LightMap(np.zeros_like(box.uv), np.full((2, 2, 3), 0.7, dtype=np.float16))
    parts = (Part("wall", wall), Part("box", box, instance_id=1, category="microwave", light=light))
    return Scene("room", parts, (), (), stage=StageFile(Path("room.glb")))


def session_of(scene: Scene, table: GaussianTable, camera: Intrinsics = CAMERA) -> SplatsSession:
    cloud = cloud_of(table)
    return SplatsSession(scene, camera, cloud, NumbaPainter(cloud))


WALL = gaussians([[x, y, -4.0] for x in np.arange(-4, 4, 0.2) for y in np.arange(-4, 4, 0.2)],
                 [[0.2, 0.2, 1e-3]], 0.95, colours=[0.2, 0.6, 0.3])  # fmt: skip


def join(*tables: GaussianTable) -> GaussianTable:
    """All of them, with the harmonics of the first one's degree."""
    names, bands = ("means", "log_scales", "rotations", "opacities"), tables[0].sh.shape[1]
    sh = np.concatenate([table.sh[:, :bands] for table in tables])
    return GaussianTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in names), sh)


def deep(table: GaussianTable) -> GaussianTable:
    """The same with room for harmonics of degree 3."""
    sh = np.zeros((len(table), 16, 3), dtype=np.float32)
    sh[:, :1] = table.sh[:, :1]
    return replace(table, sh=sh)


def test_depth_and_ids_are_those_of_embree_and_objects_look_the_same() -> None:
    scene = scene_with_box()
    ours, theirs = session_of(scene, WALL).render(AHEAD), EmbreeBackend().open(scene, CAMERA).render(AHEAD)
    np.testing.assert_array_equal(ours.depth, theirs.depth)
    np.testing.assert_array_equal(ours.instance_ids, theirs.instance_ids)
    inside = np.zeros((64, 64), dtype=bool)
    inside[28:36, 28:36] = True
    assert (theirs.instance_ids[inside] == 1).all()
    np.testing.assert_allclose(ours.rgb[inside].astype(int), theirs.rgb[inside], atol=1)
    np.testing.assert_allclose(ours.rgb[4, 4], [51, 153, 77], atol=2)  # the splats' wall, not the mesh's
    assert theirs.rgb[4, 4].tolist() == [90, 90, 90]


def test_a_splat_before_an_object_dims_it_and_one_behind_does_not() -> None:
    scene, camera = scene_with_box(), Intrinsics.from_fov(65)
    bare = session_of(scene, WALL, camera).render(AHEAD).rgb[32, 32] / 255.0
    before = gaussians([[0, 0, -1.0]], 0.3, 0.4, colours=[1.0, 0.1, 0.1])
    seen = session_of(scene, join(WALL, before), camera).render(AHEAD).rgb[32, 32] / 255.0
    np.testing.assert_allclose(seen, 0.4 * np.array([1.0, 0.1, 0.1]) + 0.6 * bare, atol=1 / 255)
    behind = gaussians([[0, 0, -2.2]], 0.3, 0.9, colours=[1.0, 0.1, 0.1])
    np.testing.assert_array_equal(session_of(scene, join(WALL, behind), camera).render(AHEAD).rgb[32, 32] / 255.0, bare)


def test_what_touches_an_object_is_not_before_it() -> None:
    scene, camera = scene_with_box(), Intrinsics.from_fov(65)
    bare = session_of(scene, WALL, camera).render(AHEAD).rgb[32, 32].astype(int)
    front = -1.7  # of the box
    for gap, dims in ((0.5 * TOLERANCE, False), (2 * TOLERANCE, True)):
        skin = gaussians([[0, 0, front + gap]], [[0.3, 0.3, 1e-3]], 0.9, colours=[1.0, 0.0, 0.0])
        seen = session_of(scene, join(WALL, skin), camera).render(AHEAD).rgb[32, 32].astype(int)
        assert (np.abs(seen - bare).max() > 30) == dims


def test_a_wide_disc_covers_only_where_it_is_before_the_object() -> None:
    """A floor's disc whose centre is before the box reaches behind the box: there it does not cover it."""
    scene = scene_with_box((0.0, 0.3, -2.0))  # stands on y = 0
    turn = Rotation.from_euler("x", 90, degrees=True)
    floor = gaussians(
        [[0, 0, -1.3]], [[0.6, 0.6, 1e-4]], 0.95, rotations=[np.roll(turn.as_quat(), 1)], colours=[1.0, 0, 0]
    )
    pose = Pose.from_yaw((0, 1.2, 0.0), 0.0, -0.5)
    camera = Intrinsics.from_fov(128)
    bare, seen = (session_of(scene, table, camera).render(pose) for table in (WALL, join(WALL, floor)))
    on_box = bare.instance_ids == 1
    changed = np.abs(bare.rgb.astype(int) - seen.rgb).max(axis=-1) > 4
    assert changed[~on_box].sum() > 500  # the floor before the box is red
    # Its own edges are mixed with what is behind them.
    whole = binary_erosion(on_box, np.ones((3, 3)))
    assert whole.sum() > 300
    assert not (changed & whole).any()


def test_the_edge_of_an_object_is_mixed_in_linear_light() -> None:
    scene = scene_with_box((0.01, 0.013, -2.0))
    view, reference = session_of(scene, WALL).render(AHEAD), EmbreeBackend().open(scene, CAMERA).render(AHEAD)
    inner, outer = srgb_decode(reference.rgb[32, 32] / 255), srgb_decode(reference.rgb[32, 2] / 255)
    row = srgb_decode(reference.rgb[32] / 255)
    share = ((row - outer) / (inner - outer)).mean(axis=-1)
    column = int(np.argmin(np.abs(share - 0.5)))
    assert 0.1 < share[column] < 0.9
    wall = srgb_decode(np.array([0.2, 0.6, 0.3]))
    expected = srgb_encode(share[column] * srgb_decode(view.rgb[32, 32] / 255) + (1 - share[column]) * wall)
    np.testing.assert_allclose(view.rgb[32, column] / 255, expected, atol=0.02)


def test_holes_between_splats_show_the_mesh() -> None:
    scene = scene_with_box()
    one = gaussians([[3.0, 3.0, -4.0]], 0.05, 0.9)
    view, reference = session_of(scene, one).render(AHEAD), EmbreeBackend().open(scene, CAMERA).render(AHEAD)
    np.testing.assert_allclose(view.rgb[4:60, 4:40].astype(int), reference.rgb[4:60, 4:40], atol=1)


def test_the_shade_of_objects_on_the_mesh_dims_the_splats_as_much() -> None:
    scene = scene_with_box()
    wall = scene.parts[0]
    half = LightMap(np.zeros_like(wall.mesh.uv), np.full((2, 2, 3), 0.5, dtype=np.float16))
    shaded = Scene("room", (Part("wall", wall.mesh, light=half), scene.parts[1]), (), (), stage=scene.stage)
    session = session_of(shaded, WALL)
    # A map on a picture of a scan holds the factor of what is displayed.
    session._tables = session._tables._replace(developed=np.array([1, 0], dtype=np.uint8))
    session._unshaded = session._without_shade()
    dim, bright = session.render(AHEAD), session_of(scene, WALL).render(AHEAD)
    np.testing.assert_allclose(srgb_decode(dim.rgb[4, 4] / 255), 0.5 * srgb_decode(bright.rgb[4, 4] / 255), atol=6e-3)
    np.testing.assert_array_equal(dim.rgb[32, 32], bright.rgb[32, 32])  # the box has its own light


def test_the_same_pose_gives_the_same_bytes_from_any_thread() -> None:
    rng = np.random.default_rng(0)
    session = session_of(scene_with_box(), join(random_table(rng, 300, 3), deep(WALL)))
    poses = [Pose.from_yaw((0, 0, 0.5), yaw) for yaw in (0.0, 0.1, 0.2, 0.0)]
    first = [session.render(pose).rgb for pose in poses]
    with ThreadPoolExecutor(4) as pool:
        again = list(pool.map(lambda pose: session.share().render(pose).rgb, poses))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)


# --- scenes


def test_splats_of_another_place_are_refused(tmp_path: Path) -> None:
    scene = scene_with_box()
    path = tmp_path / "away.ply"
    moved = WALL.means + np.float32([30, 0, 0])
    write_gaussians(path, GaussianTable(moved, WALL.log_scales, WALL.rotations, WALL.opacities, WALL.sh))
    away = Scene(scene.name, scene.parts, (), (), stage=scene.stage, splats=SplatFile(path, np.eye(4)))
    with pytest.raises(Avs3dError, match="expected both in one frame"):
        SplatsBackend().open(away, CAMERA)
    back = np.eye(4)
    back[0, 3] = -30
    here = Scene(scene.name, scene.parts, (), (), stage=scene.stage, splats=SplatFile(path, back))
    assert SplatsBackend().open(here, CAMERA).render(AHEAD).rgb[4, 4].tolist() == pytest.approx([51, 153, 77], abs=2)


def test_a_scene_without_splats_is_one_line() -> None:
    with pytest.raises(Avs3dError, match=r"room: has no splats to draw; give the scan `splats: FILE\.ply`"):
        SplatsBackend().open(scene_with_box(), CAMERA)


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(10 * np.log10(255.0**2 / np.mean((one.astype(float) - other) ** 2)))


@pytest.mark.slow
def test_a_captured_room_looks_like_its_mesh() -> None:
    if not SCAN.is_file():
        pytest.skip(f"{SCAN} is not there: the scan of a real room")
    from generators.scans.scan import load_scan

    scene = load_scan("tatami", SCAN, {"living_room": [[-1.38, -1.65, -2.0], [1.29, 0.95, 1.74]]})
    camera = Intrinsics.from_fov(252)
    session = session_of(scene, captured(scene.parts[0].mesh, 400_000, np.random.default_rng(7)), camera)
    reference = EmbreeBackend().open(scene, camera)
    for yaw in (0.0, 1.6, 3.1, 4.6):
        pose = Pose.from_yaw((-0.1, -0.15, 0.1), yaw, -0.3)
        assert psnr(session.render(pose).rgb, reference.render(pose).rgb) > 22.0


# --- CUDA


def test_tiles_with_objects_are_found() -> None:
    cut = np.zeros((20, 40), dtype=np.float32)
    cut[17, 39] = 0.5
    assert tiles_with(cut).tolist() == [0, 0, 0, 0, 0, 1]


@pytest.mark.gpu
def test_gsplat_draws_the_same_picture_on_cuda() -> None:
    if problem := gsplat_problem():
        pytest.skip(problem)
    cloud = cloud_of(join(random_table(np.random.default_rng(0), 300, 3), deep(WALL)))
    scene, camera = scene_with_box(), Intrinsics.from_fov(252)
    ours, theirs = (SplatsSession(scene, camera, cloud, each) for each in (NumbaPainter(cloud), GsplatPainter(cloud)))
    one, other = ours.render(AHEAD), theirs.render(AHEAD)
    assert psnr(one.rgb, other.rgb) > 45.0
    np.testing.assert_array_equal(theirs.render(AHEAD).rgb, other.rgb)
