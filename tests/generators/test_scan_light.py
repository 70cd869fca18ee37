"""Light and shadows of objects in a scan, against the lit room that the scan was made from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.meshfile import load_mesh
from generators.assets.shapes import MeshBuilder
from generators.core.boxes import UprightBox
from generators.core.low_discrepancy import PATTERNS, cosine_directions
from generators.core.scene import DenseMesh, Material, Mesh, Part, Room, Scene, StageFile
from generators.core.tone import develop, inverse_tone_curve, srgb_decode, tone_curve
from generators.lighting.bake import bake, insert
from generators.lighting.direct import direct_light
from generators.lighting.emitters import find_emitters
from generators.lighting.gather import cells_at, hemisphere_rays
from generators.lighting.lit_scene import LitScene
from generators.lighting.moving_light import MovingLight
from generators.lighting.scan_light import CLIPPED, with_scan_light
from generators.lighting.scan_shadow import displayed, layout_of
from generators.scans.scan import load_scan
from generators.vision.embree import EmbreeBackend
from generators.vision.glb import write_glb
from tests.support import scan_like

SIZE = (4.0, 2.5, 3.0)
ROOM = Room("living_room", (0.0, 0.0, 0.0), SIZE)
#: Where the lamp hangs, its side and radiance.
LAMP, SIDE, GLOW = (3.4, 2.3, 1.0), 0.4, 60.0
#: Where an object stands.
PLACE = (1.6, 0.0, 1.7)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
FACES = {"top": (0, 1, 0), "+x": (1, 0, 0), "-x": (-1, 0, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}


def matte(*albedo: float) -> Material:
    return Material("matte", "plaster", (albedo[0], albedo[-1], albedo[-1]))


def room_mesh() -> Mesh:
    """Light walls, a reddish floor and a white ceiling, seen from inside."""
    x, y, z = SIZE
    wall, floor, ceiling = matte(0.6), matte(0.4, 0.25), matte(0.75)
    builder = MeshBuilder()
    builder.quad([(0, 0, z), (x, 0, z), (x, 0, 0), (0, 0, 0)], floor)
    builder.quad([(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)], ceiling)
    for corners in (
        [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)],
        [(x, 0, z), (0, 0, z), (0, y, z), (x, y, z)],
        [(0, 0, z), (0, 0, 0), (0, y, 0), (0, y, z)],
        [(x, 0, 0), (x, 0, z), (x, y, z), (x, y, 0)],
    ):
        builder.quad(corners, wall)
    return builder.build()


def lamp_mesh() -> Mesh:
    x, y, z = LAMP
    h = SIDE / 2
    corners = [(x - h, y, z - h), (x + h, y, z - h), (x + h, y, z + h), (x - h, y, z + h)]
    lamp = Material("lamp", "plastic", (0.0, 0.0, 0.0), emission=(GLOW, GLOW, GLOW))
    return MeshBuilder().quad(corners, lamp).build()


def block(at: tuple[float, float, float] = PLACE, instance: int = 1) -> Part:
    """A grey box of 30 cm that stands there."""
    x, y, z = at
    mesh = MeshBuilder().box((0.3, 0.3, 0.3), (x, y + 0.15, z), matte(0.5)).build()
    return Part("block", mesh, instance_id=instance)


@pytest.fixture(scope="module")
def truth() -> Scene:
    """The lit room; a white poster hangs beside the lamp and is overexposed, though it does not shine."""
    shelf = MeshBuilder().box((0.5, 1.2, 0.4), (0.4, 0.6, 0.3), matte(0.4)).build()
    poster = MeshBuilder().box((0.02, 0.6, 0.6), (SIZE[0] - 0.01, 1.8, 1.0), matte(0.9)).build()
    meshes = (room_mesh(), shelf, poster, lamp_mesh())
    names = ("shell_living_room", "living_room/shelf", "living_room/poster", "living_room/lamp")
    parts = tuple(Part(name, mesh) for name, mesh in zip(names, meshes, strict=True))
    return bake(Scene("room", parts, (ROOM,), ()), quality="standard")


@pytest.fixture(scope="module")
def scan(truth: Scene, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    fused = scan_like.fuse(truth, np.random.default_rng(3), noise=0.003, edge=0.12, texel=0.015, holes=20)
    path = scan_like.write_glb(fused, tmp_path_factory.mktemp("scan") / "room.glb")
    return load_scan("room", path, {"living_room": [ROOM.low, ROOM.high]})


def light_on_faces(part: Part) -> np.ndarray:
    """(5, 3) mean light of the block's faces, in the order of `FACES`."""
    assert part.light is not None
    height, width = part.light.texels.shape[:2]
    corner = part.mesh.positions.astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), 200)
    uv = np.einsum("kc,fcx->fkx", weights, part.light.uv.astype(np.float64))
    column = np.clip((uv[..., 0] * width).astype(int), 0, width - 1)
    row = np.clip((uv[..., 1] * height).astype(int), 0, height - 1)
    light = part.light.texels[row, column].astype(np.float64).mean(axis=1)
    return np.array([light[normal @ np.array(side) > 0.95].mean(axis=0) for side in FACES.values()])


def main_direction(light: np.ndarray) -> np.ndarray:
    """Where the light comes from: its net flux through the faces."""
    top, right, left, front, back = light @ LUMINANCE
    vector = np.array([right - left, top, front - back])
    return vector / np.linalg.norm(vector)


def test_the_lamp_is_as_bright_as_it_is_and_the_overexposed_poster_is_not(truth: Scene, scan: Scene) -> None:
    light = with_scan_light(scan).scan_light
    assert light is not None
    down = (light.normal[:, 1] < -0.9) & (np.abs(light.position[:, [0, 2]] - [LAMP[0], LAMP[2]]).max(axis=1) < SIDE / 2)
    wall = light.position[:, 0] > SIZE[0] - 0.1
    true = GLOW * truth.rooms[0].exposure
    assert true > 5 * CLIPPED
    assert wall.any(), "nothing is overexposed: the test's room proves nothing"
    assert light.radiance[down].mean() == pytest.approx(true, rel=0.35)
    assert light.radiance[wall].mean() < 0.25 * true
    assert light.glow.max() < 0.5


def test_an_object_gets_the_light_that_it_gets_in_the_room(truth: Scene, scan: Scene) -> None:
    true = light_on_faces(insert(truth, (block(),)).parts[-1]) * truth.rooms[0].exposure
    found = light_on_faces(insert(scan, (block(),)).parts[-1])
    stops = np.log2((found @ LUMINANCE) / (true @ LUMINANCE))
    assert np.abs(stops).max() < 0.4
    angle = np.degrees(np.arccos(main_direction(found) @ main_direction(true)))
    assert angle < 8
    tint = np.log2(found.mean(axis=0) / true.mean(axis=0))
    assert np.ptp(tint) < 0.15


def floor_points(count: int = 21, half: float = 0.6) -> np.ndarray:
    """Points 3 cm over the floor round the block, not under it."""
    x, z = np.meshgrid(*[np.linspace(-half, half, count)] * 2)
    free = np.maximum(np.abs(x), np.abs(z)) > 0.17
    at = np.stack([PLACE[0] + x[free], np.full(free.sum(), 0.03), PLACE[2] + z[free]], axis=1)
    return at.astype(np.float32)


def received(lit: LitScene, points: np.ndarray) -> np.ndarray:
    """Light on level points by many rays: no light map of the floor is used there."""
    up = np.tile(np.float32([[0, 1, 0]]), (len(points), 1))
    pattern = (np.arange(len(points)) % PATTERNS).astype(np.int32)
    origins, directions = hemisphere_rays(points, up, up, pattern, cosine_directions(512))
    hits = lit.tracer.intersect(origins, directions)
    light = lit.reflected(hits["primID"], hits["u"], hits["v"]).reshape(len(points), -1, 3).mean(axis=1)
    lamps = find_emitters(lit.surfaces, 64)
    every = np.ones((len(points), len(lamps)), dtype=bool)
    return light + direct_light(lamps, every, pattern, points, up, lit.tracer.occluded)[0]


def shadow_on_scan(scene: Scene, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) factor of what is displayed below points, and (N,) how far below the scan lies."""
    lit = LitScene.of(scene.parts, [scene.is_scan(part) for part in scene.parts])
    hits = lit.tracer.intersect(points, np.tile(np.float32([[0, -1, 0]]), (len(points), 1)))
    return lit.light[cells_at(lit.surfaces, lit.sheet, hits["primID"], hits["u"], hits["v"])], hits["tfar"]


def test_it_darkens_the_floor_as_it_does_in_the_room(truth: Scene, scan: Scene) -> None:
    points = floor_points()
    ground = points - np.float32([0, 0.027, 0])
    albedo = np.float32([0.4, 0.25, 0.25]) * truth.rooms[0].exposure
    with_block = received(LitScene.of(insert(truth, (block(),)).parts), ground)
    without = received(LitScene.of(truth.parts), ground)
    true = (tone_curve(albedo * with_block) / tone_curve(albedo * without)).mean(axis=1)
    found, below = shadow_on_scan(insert(scan, (block(),)), points)
    kept = np.abs(below - 0.03) < 0.015
    assert kept.mean() > 0.8
    found, true = found.mean(axis=1)[kept], true[kept]
    assert true.min() < 0.6, "the block throws no shadow: the test proves nothing"
    error = np.abs(np.log2(found / true))
    assert error.mean() < 0.06
    assert error.mean() < 0.35 * np.abs(np.log2(true)).mean()
    assert np.corrcoef(found, true)[0, 1] > 0.95


@pytest.mark.slow
def test_far_from_the_object_nothing_changes(scan: Scene) -> None:
    placed = insert(scan, (block(),))
    far = [part for part in placed.parts if placed.is_scan(part) and part.light is None]
    near = [part for part in placed.parts if placed.is_scan(part) and part.light is not None]
    assert len(far) == len(near) == 1
    assert len(far[0].mesh.positions) + len(near[0].mesh.positions) == len(scan.parts[0].mesh.positions)
    assert far[0].mesh.acoustic_labels == scan.parts[0].mesh.acoustic_labels
    camera = Intrinsics.from_fov(160)
    pose = Pose.from_yaw((1.6, 0.9, 2.9), 0.0)
    empty = EmbreeBackend().open(scan, camera).render(pose)
    shown = EmbreeBackend().open(placed, camera).render(pose)
    background = shown.instance_ids == 0
    np.testing.assert_array_equal(shown.depth[background], empty.depth[background])
    change = np.abs(shown.rgb.astype(int) - empty.rgb).max(axis=2)
    points = _world(camera, pose, shown.depth)
    distant = background & (np.linalg.norm(points - np.array(PLACE), axis=2) > 1.3)
    assert distant.sum() > 1000
    assert np.quantile(change[distant], 0.99) == 0
    beside = background & (np.linalg.norm(points - np.array(PLACE), axis=2) < 0.35)
    assert beside.sum() > 50
    assert shown.rgb[beside].mean() < 0.9 * empty.rgb[beside].mean()


def _world(camera: Intrinsics, pose: Pose, depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) world points of a level camera that looks along −Z."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    x = (columns - camera.cx) / camera.fx * depth
    y = -(rows - camera.cy) / camera.fy * depth
    return np.stack([x, y, -depth], axis=2) + np.array(pose.position)


@pytest.mark.slow
def test_a_dense_scan_shows_all_its_faces_with_the_shadow_that_its_copy_has(scan: Scene) -> None:
    (part,) = scan.parts
    mesh = part.mesh
    # The same surface in four times as many faces: each is cut at the middles of its sides.
    fine = replace(
        mesh,
        positions=_quartered(mesh.positions),
        normals=np.repeat(mesh.normals, 4, axis=0),
        uv=_quartered(mesh.uv),
        face_material=np.repeat(mesh.face_material, 4),
        acoustic_positions=mesh.acoustic_positions[:0],
        acoustic_labels=(),
    )
    dense = insert(replace(scan, parts=(replace(part, dense=DenseMesh(fine)),)), (block(),))
    assert sum(len(each.mesh.positions) for each in dense.shown.parts if dense.is_scan(each)) == 4 * len(mesh.positions)
    camera, pose = Intrinsics.from_fov(120), Pose.from_yaw((1.6, 0.9, 2.9), 0.0)
    one, other = (EmbreeBackend().open(each, camera).render(pose) for each in (insert(scan, (block(),)), dense))
    np.testing.assert_array_equal(one.instance_ids, other.instance_ids)
    empty = EmbreeBackend().open(scan, camera).render(pose).rgb.astype(int)
    shade = (empty - one.rgb).mean(axis=2)[one.instance_ids == 0]
    error = (one.rgb.astype(int) - other.rgb).mean(axis=2)[one.instance_ids == 0]
    assert shade.max() > 40
    assert np.abs(error).mean() < 0.03 * np.abs(shade).mean() + 0.02
    assert np.quantile(np.abs(error), 0.999) < 4


def _quartered(corners: np.ndarray) -> np.ndarray:
    """(4 F, 3, K) the four parts of each of the faces (F, 3, K)."""
    a, b, c = corners.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return (
        np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
        .transpose(2, 0, 1, 3)
        .reshape(-1, *corners.shape[1:])
    )


def test_the_same_object_gives_the_same_bytes(scan: Scene) -> None:
    one, other = (insert(scan, (block(),)) for _ in range(2))
    for first, second in zip(one.parts, other.parts, strict=True):
        if first.light is not None and second.light is not None:
            assert first.light.texels.tobytes() == second.light.texels.tobytes()


@pytest.mark.slow
def test_the_shadow_moves_with_the_object(scan: Scene) -> None:
    places = [PLACE, (2.4, 0.0, 1.7)]
    boxes = [UprightBox((x, y + 0.15, z), (0.3, 0.3, 0.3), 0.0) for x, y, z in places]
    mesh = block((0.0, -0.15, 0.0)).mesh
    light = MovingLight(scan, [mesh], [boxes])
    beside = np.float32([[x - 0.19, 0.03, z] for x, _, z in places])
    for here, there, place in ((0, 1, places[0]), (1, 0, places[1])):
        factor = shadow_on_scan(light.at((block(place),)), beside)[0].mean(axis=1)
        assert factor[here] < 0.75
        assert factor[there] > 0.9
    both = MovingLight(scan, [mesh, mesh], [boxes, boxes]).at((block(places[0]), block(places[1])))
    assert (shadow_on_scan(both, beside)[0].mean(axis=1) < 0.75).all()


@pytest.mark.slow
def test_an_exported_shadow_looks_as_it_is_rendered(scan: Scene, tmp_path: Path) -> None:
    # Renderers that read files get the scan with the shadows in its textures.
    placed = insert(scan, (block(),))
    home = tuple(part for part in placed.parts if placed.is_scan(part))
    path = tmp_path / "shaded.glb"
    write_glb(placed, path, parts=home)
    back = replace(placed, parts=(Part("scan", load_mesh(path)),), stage=StageFile(path))
    camera, pose = Intrinsics.from_fov(120), Pose.from_yaw((1.6, 0.9, 2.9), 0.0)
    direct = EmbreeBackend().open(replace(placed, parts=home), camera).render(pose).rgb.astype(int)
    exported = EmbreeBackend().open(back, camera).render(pose).rgb.astype(int)
    assert np.abs(direct - exported).mean() < 1.5


def test_a_scan_that_another_program_draws_keeps_its_file(scan: Scene) -> None:
    # Its colours were not read, so that no shadow can be put into them.
    mesh = scan.parts[0].mesh
    grey = replace(mesh, materials=tuple(replace(m, texture=None, colour=(0.4, 0.4, 0.4)) for m in mesh.materials))
    placed = insert(replace(scan, parts=(replace(scan.parts[0], mesh=grey),)), (block(),))
    assert placed.parts[0].light is None
    assert placed.parts[0].mesh is grey


def lifted(scan: Scene, black: np.ndarray) -> Scene:
    """The scan through fog: its texels show the radiance ``black`` more."""
    (part,) = scan.parts
    materials = []
    for material in part.mesh.materials:
        assert material.texture is not None
        light = inverse_tone_curve(srgb_decode(material.texture.pixels / 255)) + black
        materials.append(replace(material, texture=replace(material.texture, pixels=develop(light))))
    return replace(scan, parts=(replace(part, mesh=replace(part.mesh, materials=tuple(materials))),))


def coal(at: tuple[float, float, float] = PLACE) -> Part:
    """A box of 30 cm that stands there, nearly black."""
    x, y, z = at
    return Part("coal", MeshBuilder().box((0.3, 0.3, 0.3), (x, y + 0.15, z), matte(0.02)).build(), instance_id=1)


@pytest.mark.slow
def test_objects_are_as_dark_as_the_fog_over_a_scan_lets_them_be(scan: Scene) -> None:
    black = np.array([0.05, 0.045, 0.04])
    clear, foggy = (insert(each, (coal(),)) for each in (scan, lifted(scan, black)))
    assert clear.scan_light is not None
    assert foggy.scan_light is not None
    assert not clear.scan_light.black.any()
    np.testing.assert_allclose(foggy.scan_light.black, black, atol=0.008)
    camera, pose = Intrinsics.from_fov(96), Pose.from_yaw((1.6, 0.7, 2.9), 0.0)
    one, other = (EmbreeBackend().open(each, camera).render(pose) for each in (clear, foggy))
    own = one.instance_ids == 1
    true = develop(inverse_tone_curve(srgb_decode(one.rgb[own] / 255)) + black).astype(int)
    assert true.mean() > one.rgb[own].mean() + 20, "the fog is not seen: the test proves nothing"
    assert np.abs(other.rgb[own] - true).mean() < 6
    # And its shadow is as deep as fog over the shadow in the clear room.
    beside = (one.instance_ids == 0) & (np.linalg.norm(_world(camera, pose, one.depth) - np.array(PLACE), axis=2) < 0.4)
    true = develop(inverse_tone_curve(srgb_decode(one.rgb[beside] / 255)) + black).astype(int)
    assert np.abs(other.rgb[beside] - true).mean() < 3


def test_what_is_displayed_changes_as_the_radiance_does_under_the_tone_curve() -> None:
    radiance = np.float32([[0.02, 0.18, 1.0], [0.5, 0.5, 0.5]])
    ratio = np.float32([[0.5, 0.5, 0.5], [1.0, 0.1, 1.2]])
    factor = displayed(radiance, ratio)
    np.testing.assert_allclose(tone_curve(radiance) * factor, tone_curve(radiance * ratio), rtol=1e-5)


def test_charts_do_not_share_texels(scan: Scene) -> None:
    triangles = scan.parts[0].mesh.positions[:8000]
    layout = layout_of(triangles)
    low, high = layout.uv.min(axis=1), layout.uv.max(axis=1)
    assert low.min() >= 1.0
    assert (high <= [layout.width - 1.0, layout.height - 1.0]).all()
    owner = np.full((layout.height, layout.width), -1)
    for chart in np.unique(layout.chart):
        own = layout.chart == chart
        (left, top), (right, bottom) = np.floor(low[own].min(axis=0) - 0.5), np.ceil(high[own].max(axis=0) + 0.5)
        box = owner[int(top) : int(bottom), int(left) : int(right)]
        assert (box == -1).all()
        box[:] = chart


def test_no_face_of_a_scan_is_charted_edge_on() -> None:
    """The sides of a window's niche share corners with a far larger wall, and keep texels of their own."""

    def quad(*corner: tuple[float, float, float]) -> list[list[tuple[float, float, float]]]:
        a, b, c, d = corner
        return [[a, b, c], [a, c, d]]

    wall = quad((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)) + quad((2, 0, 0), (3, 0, 0), (3, 1, 0), (2, 1, 0))
    wall += quad((0, 1, 0), (3, 1, 0), (3, 2, 0), (0, 2, 0))
    side = quad((1, 0, 0), (1, 0, -0.15), (1, 1, -0.15), (1, 1, 0))
    triangles = np.array(wall + side, dtype=np.float32)
    edges = layout_of(triangles, 0.01).uv
    edges = (edges[:, 1:] - edges[:, :1]) * 0.01
    laid_out = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    across = triangles[:, 1:] - triangles[:, :1]
    true = np.linalg.norm(np.cross(across[:, 0], across[:, 1]), axis=1)
    np.testing.assert_allclose(laid_out, true, rtol=1e-4)


@pytest.mark.slow
def test_a_room_without_anything_dark_tells_no_black_level(scan: Scene) -> None:
    """Grey walls and things are no fog: what is placed there keeps its own colours."""
    (part,) = scan.parts
    materials = []
    for material in part.mesh.materials:
        assert material.texture is not None
        grey = np.full_like(material.texture.pixels, 190)
        grey[::2] = 140
        materials.append(replace(material, texture=replace(material.texture, pixels=grey)))
    pale = insert(replace(scan, parts=(replace(part, mesh=replace(part.mesh, materials=tuple(materials))),)), (coal(),))
    assert pale.scan_light is not None
    assert not pale.scan_light.black.any()
