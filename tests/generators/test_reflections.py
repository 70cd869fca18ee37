"""Reflections of the default renderer against closed forms, and against the path tracer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import generators.vision.embree as embree
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.shapes import MeshBuilder
from generators.core.albedos import albedo_table, dielectric_albedo
from generators.core.scene import Material, Mesh, Part, Scene, StageFile, Texture
from generators.lighting.surfaces import LitSurfaces, albedo_at
from generators.vision.embree import EmbreeBackend, EmbreeSession

ORIGIN = Pose.from_yaw((0, 0, 0), 0.0)
BLACK = Material("black", "plaster", colour=(0.0, 0.0, 0.0))
WHITE_GLOW = Material("glow", "glass", colour=(0.0, 0.0, 0.0), emission=(1.0, 1.0, 1.0))


def metal(roughness: float = 0.0, **more: object) -> Material:
    return Material("metal", "metal", roughness=roughness, metallic=1.0, **more)  # type: ignore[arg-type]


def scene(*meshes: Mesh) -> Scene:
    """Part i has instance id i."""
    return Scene("test", tuple(Part(f"p{i}", mesh, instance_id=i) for i, mesh in enumerate(meshes)), (), ())


def opened(what: Scene, size: int = 64, fov: float = 90.0) -> EmbreeSession:
    return EmbreeBackend().open(what, Intrinsics.from_fov(size, fov))


def radiance(what: Scene, pose: Pose = ORIGIN, size: int = 64, fov: float = 90.0) -> NDArray[np.float32]:
    session = opened(what, size, fov)
    try:
        return session.radiance(pose)[0]
    finally:
        session.close()


def wall(material: Material, z: float, half: float = 2.0, *, turn: NDArray[np.float64] | None = None) -> Mesh:
    """A square about (0, 0, z) that faces the origin; ``turn`` (3, 3) turns it about its middle."""
    side = half if z < 0 else -half
    corners = np.array([[-side, -half, 0], [side, -half, 0], [side, half, 0], [-side, half, 0]], dtype=np.float64)
    corners = corners if turn is None else corners @ turn.T
    return MeshBuilder().quad(corners + [0, 0, z], material, fit=True).build()


def uniform(half: float = 6.0, material: Material = WHITE_GLOW) -> Mesh:
    """A box round the origin that shines inwards with 1."""
    mesh = MeshBuilder().box((2 * half,) * 3, (0, 0, 0), material).build()
    return replace(mesh, positions=mesh.positions[:, ::-1].copy(), normals=-mesh.normals)


def test_a_mirror_shows_the_mirrored_point() -> None:
    # A lamp behind the camera, 0.4 to the right and 0.3 up: its image lies as far behind the mirror.
    lamp = MeshBuilder().box((0.1, 0.1, 0.1), (0.4, 0.3, 2.0), WHITE_GLOW).build()
    picture = radiance(scene(wall(metal(), -3.0, 6.0), lamp, wall(BLACK, 9.0, 40.0)), size=256)[..., 0]
    light = np.where(picture > 0.5, picture, 0.0)
    rows, columns = np.nonzero(light)
    # The box's front, at z = 1.95, is at a distance of 3 + 4.95.
    assert columns.mean() + 0.5 == pytest.approx(128 + 128 * 0.4 / 7.95, abs=0.5)
    assert rows.mean() + 0.5 == pytest.approx(128 - 128 * 0.3 / 7.95, abs=0.5)
    assert np.sqrt(len(rows)) == pytest.approx(128 * 0.1 / 7.95, abs=0.5)


def test_smooth_dielectrics_follow_schlick_at_all_angles() -> None:
    floor = [[-5.9, -1, 5.9], [5.9, -1, 5.9], [5.9, -1, -5.9], [-5.9, -1, -5.9]]
    glaze = replace(BLACK, roughness=0.0)
    picture = radiance(scene(uniform(), MeshBuilder().quad(floor, glaze).build()), size=128)[..., 0]
    pixel = (np.arange(128) + 0.5 - 64) / 64
    x, down = np.meshgrid(pixel, pixel)
    seen = (down > 0.2) & (np.abs(x) / down < 5.8) & (1 / down < 5.8)
    cosine = down / np.sqrt(1 + x**2 + down**2)
    expected = 0.04 + 0.96 * (1 - cosine) ** 5
    np.testing.assert_allclose(picture[seen], expected[seen], rtol=0.02)
    below = radiance(
        scene(uniform(), MeshBuilder().quad(floor, glaze).build()), Pose.from_yaw((0, 0, 0), 0.0, -np.pi / 2), size=33
    )
    assert below[16, 16, 0] == pytest.approx(0.04, rel=0.01)


def test_light_that_goes_on_from_a_dielectric_has_its_specular_share() -> None:
    """The mean of Schlick's term over a uniform light is F0 + (1 − F0) / 21."""
    assert dielectric_albedo(0.0) == pytest.approx(0.04 + 0.96 / 21, rel=0.01)
    assert dielectric_albedo(1.0) == 0.0
    matte, glazed, steel = (
        Material("m", "tile", (0.3,) * 3, roughness=r, metallic=m) for r, m in ((1, 0), (0, 0), (0, 1))
    )
    surfaces = LitSurfaces.of([Part("p", wall(material, -1.0)) for material in (matte, glazed, steel)])
    face, middle = np.array([0, 2, 4], dtype=np.int32), np.full(3, 0.3, dtype=np.float32)
    found = albedo_at(surfaces, face, middle, middle)
    np.testing.assert_allclose(found[:, 0], [0.3, 0.3 + dielectric_albedo(0.0), 0.3], rtol=1e-5)


@pytest.mark.parametrize("roughness", [0.0, 0.2])
@pytest.mark.parametrize("rounded", [False, True])
def test_a_white_metal_in_a_uniform_room_cannot_be_seen(roughness: float, rounded: bool) -> None:
    if rounded:
        thing = MeshBuilder().sphere(0.8, (0, 0, -2), metal(roughness), rings=24, segments=48).build()
    else:
        thing = wall(metal(roughness), -2.0, 1.0)
    picture = radiance(scene(uniform(), thing))
    assert np.quantile(np.abs(picture - 1.0), 0.99) < 0.02
    # At the rim of a sphere a lobe loses more: single scattering at grazing angles.
    np.testing.assert_allclose(picture, 1.0, rtol=0.06)


@pytest.mark.parametrize("roughness", [0.5, 0.8])
def test_rough_metals_lose_what_a_microfacet_reflects_to_another(roughness: float) -> None:
    # Above the limit of tracing the mean light stands in for rays: without a light map it is 1.
    ours = radiance(scene(uniform(), wall(metal(roughness), -2.0, 1.0)), size=63)[31, 31, 0]
    table = albedo_table().sum(axis=2)[:, -1]
    assert ours == pytest.approx(np.interp(roughness, np.linspace(0, 1, len(table)), table), rel=0.01)
    assert ours < 0.95


def test_metals_show_no_diffuse_light_and_tint_what_they_reflect() -> None:
    gold = Material("gold", "metal", (1.0, 0.7, 0.3), roughness=0.0, metallic=1.0)
    grey = Material("grey", "plaster", (0.5, 0.5, 0.5))
    ours = radiance(scene(wall(gold, -3.0, 6.0), wall(grey, 4.0, 9.0)), size=33)[16, 16]
    np.testing.assert_allclose(ours, [0.5, 0.35, 0.15], rtol=0.01)


def gradient() -> Material:
    """A wall whose light grows to the right (red) and upwards (green) in display levels."""
    x, y = np.meshgrid(np.arange(256), np.arange(256)[::-1])
    return Material("gradient", "plaster", texture=Texture("g", np.stack([x, y, 0 * x], axis=2).astype(np.uint8)))


def rotation(axis: int, angle: float) -> NDArray[np.float64]:
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[a, a] = out[b, b] = np.cos(angle)
    out[b, a], out[a, b] = np.sin(angle), -np.sin(angle)
    return out


@pytest.mark.parametrize("along", [0, 1])
def test_a_normal_map_tilts_the_reflection_by_twice_its_angle(along: int) -> None:
    # The map leans to +s (right) or +t (up), as a mirror does that is turned about the y or the −x axis.
    texel = np.array([128, 128, 251], dtype=np.float64)
    texel[:2] = 127.5
    texel[along] = 160
    angle = np.arctan2(2 * 160 / 255 - 1, 2 * 251 / 255 - 1)
    pixels = np.rint(np.tile(texel, (4, 4, 1))).astype(np.uint8)
    mapped = wall(metal(normal_map=Texture("n", pixels)), -3.0, 0.5)
    turned = wall(metal(), -3.0, 0.5, turn=rotation(1, angle) if along == 0 else rotation(0, -angle))
    back = wall(gradient(), 4.0, 9.0)
    plain, ours, expected = (
        radiance(scene(mirror, back), size=33, fov=20.0)[16, 16]
        for mirror in (wall(metal(), -3.0, 0.5), mapped, turned)
    )
    # The other component of the map is half a level off.
    np.testing.assert_allclose(ours[:2], expected[:2], rtol=0.04)
    assert abs(expected[along] - plain[along]) > 0.1


@pytest.mark.parametrize(("rows", "columns"), [(2, 8), (128, 64), (16, 16)])
def test_a_normal_map_may_have_another_size_than_the_colour(rows: int, columns: int) -> None:
    """The right half of a mirror leans; the colour has 16 × 16 texels, and is green on the left."""
    colour = np.full((16, 16, 3), 255, dtype=np.uint8)
    colour[:, :8, [0, 2]] = 0
    pixels = np.full((rows, columns, 3), (127, 127, 255), dtype=np.uint8)
    pixels[:, columns // 2 :] = (160, 127, 251)
    angle = np.arctan2(2 * 160 / 255 - 1, 2 * 251 / 255 - 1)
    back, pose, size = wall(gradient(), 4.0, 9.0), ORIGIN, 65

    def seen(mirror: Mesh) -> NDArray[np.float32]:
        return radiance(scene(mirror, back), pose, size=size, fov=20.0)[32, [16, 48]]

    mapped = seen(wall(metal(texture=Texture("c", colour), normal_map=Texture("n", pixels)), -3.0, 0.53))
    plain, turned = seen(wall(metal(), -3.0, 0.53)), seen(wall(metal(), -3.0, 0.53, turn=rotation(1, angle)))
    np.testing.assert_allclose(mapped[0], [0, plain[0, 1], 0], rtol=0.04, atol=0.01)
    # The plane that is turned as a whole also lies 5 cm further back there.
    np.testing.assert_allclose(mapped[1], turned[1], rtol=0.06)
    assert abs(turned[1, 0] - plain[1, 0]) > 0.1


def test_a_roughness_map_scales_roughness_and_metallic() -> None:
    left_rough = np.zeros((64, 64, 3), dtype=np.uint8)
    left_rough[:, :32, 1], left_rough[..., 2] = 255, 255
    lamp = MeshBuilder().box((0.4, 0.4, 0.1), (0, 0, 2.0), WHITE_GLOW).build()
    mirror, dark = wall(metal(0.4, roughness_map=Texture("r", left_rough)), -3.0, 2.0), uniform(9.0, BLACK)
    steps = np.abs(np.diff(radiance(scene(mirror, lamp, dark), size=128, fov=60.0)[64, :, 0]))
    assert steps[66:].max() > 0.9  # a sharp edge on the smooth half
    assert steps[:60].max() < 0.5
    no_metal = np.full((2, 2, 3), (0, 255, 0), dtype=np.uint8)
    matte = radiance(scene(wall(metal(0.9, roughness_map=Texture("r", no_metal)), -3.0, 2.0), lamp, dark), size=33)
    assert matte[16, 16, 0] == pytest.approx(1.0, abs=0.06)  # its colour in light 1, and a few per cent of gloss


@pytest.mark.parametrize("tint", [1.0, 0.5])
def test_a_clear_pane_lets_the_background_through(tint: float) -> None:
    pane = Material("pane", "glass", (tint,) * 3, roughness=0.0, transmission=1.0)
    grey = Material("grey", "plaster", (0.5, 0.5, 0.5))
    behind = wall(grey, -4.0, 9.0)
    one = radiance(scene(behind, wall(pane, -2.0), wall(BLACK, 4.0, 20.0)), size=33)[16, 16, 0]
    two = radiance(scene(behind, wall(pane, -2.0), wall(pane, -2.1), wall(BLACK, 4.0, 20.0)), size=33)[16, 16, 0]
    assert one == pytest.approx(0.5 * tint * 0.96, rel=0.01)
    assert two == pytest.approx(0.5 * tint**2 * 0.96**2, rel=0.01)


def test_two_mirrors_show_each_other() -> None:
    lamp = MeshBuilder().box((0.08, 0.08, 0.02), (0, 0.6, 0.5), replace(WHITE_GLOW, emission=(3.0,) * 3)).build()
    picture = radiance(scene(wall(metal(), -2.0, 9.0), wall(metal(), 2.0, 9.0), lamp), size=512)[..., 0]
    rows = np.flatnonzero(picture[:, 254:258].max(axis=1) > 2.0)
    images = [run.mean() + 0.5 for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)]
    # Its front in the first mirror, its back by way of the second one, and so on: at depths of 4.49, 7.51, 12.49 m.
    for image, depth in zip(images[:2], (4.49, 7.51), strict=True):
        assert image == pytest.approx(256 - 256 * 0.6 / depth, abs=1.0)
    assert len(images) >= 3


def test_objects_in_a_scan_reflect_its_pictures() -> None:
    colour = np.full((4, 4, 3), (180, 120, 60), dtype=np.uint8)
    photograph = Material("photograph", "plaster", texture=Texture("t", colour))
    parts = (
        Part("scan", wall(photograph, 4.0, 30.0)),
        Part("mirror", wall(metal(), -2.0, 2.0), instance_id=1),
    )
    scan = Scene("scan", parts, (), (), stage=StageFile(Path("scan.glb")))
    picture = opened(scan).render(ORIGIN)
    assert np.abs(picture.rgb[32, 32].astype(int) - [180, 120, 60]).max() <= 2


def glossy() -> Scene:
    """Mirrors, glazes, panes and lobes before a room's back wall."""
    pane = Material("pane", "glass", (0.9, 0.9, 0.9), roughness=0.05, transmission=0.9)
    glaze = Material("glaze", "ceramic", (0.3, 0.3, 0.5), roughness=0.3)
    coat = Material("coat", "wood", (0.3, 0.2, 0.1), roughness=0.6, clearcoat=1.0)
    lamp = MeshBuilder().box((1.0, 1.0, 0.1), (0.5, 1.0, 3.0), WHITE_GLOW).build()
    things = [
        MeshBuilder().sphere(0.5, (-0.8, 0, -2.5), metal(0.1), rings=10, segments=16).build(),
        MeshBuilder().box((0.7, 0.7, 0.7), (0.4, 0.1, -3), coat).build(),
        MeshBuilder().box((0.4, 1.6, 0.02), (0.9, 0, -1.8), pane).build(),
        MeshBuilder().quad([[-9, -1, 9], [9, -1, 9], [9, -1, -9], [-9, -1, -9]], glaze).build(),
    ]
    return scene(wall(gradient(), -5.0, 6.0), *things, lamp)


def test_frames_do_not_depend_on_chunks_or_on_the_order_of_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = [Pose.from_yaw((0.1 * k, 0, 0), 0.05 * k) for k in range(3)]
    session = opened(glossy(), 96)
    frames = [session.render(pose).rgb for pose in poses]
    shared = session.share()
    assert all(
        np.array_equal(shared.render(pose).rgb, frame) for pose, frame in zip(poses[::-1], frames[::-1], strict=True)
    )
    monkeypatch.setattr(embree, "CHUNK", 96 * 8)
    assert np.array_equal(opened(glossy(), 96).render(poses[1]).rgb, frames[1])


def test_labels_do_not_depend_on_the_materials() -> None:
    shiny = glossy()
    matte = tuple(
        replace(part, mesh=replace(part.mesh, materials=tuple(BLACK for _ in part.mesh.materials)))
        for part in shiny.parts
    )
    ours, plain = opened(shiny).render(ORIGIN), opened(replace(shiny, parts=matte)).render(ORIGIN)
    assert np.array_equal(ours.instance_ids, plain.instance_ids)
    assert np.array_equal(ours.depth, plain.depth)


def test_edges_in_a_mirror_are_smooth() -> None:
    # A slanted edge of a lamp, seen in a mirror: pixels on it are between dark and bright.
    corners = [[-3, -3, 2], [-3, 3, 2], [1.0, 3, 2], [-1.2, -3, 2]]
    lamp = MeshBuilder().quad(corners, replace(WHITE_GLOW, emission=(9.0,) * 3)).build()
    rgb = opened(scene(wall(metal(), -3.0, 6.0), lamp, wall(BLACK, 5.0, 20.0)), 128).render(ORIGIN).rgb[..., 0]
    between = ((rgb > 20) & (rgb < 235)).sum(axis=1)
    assert (between[42:86] >= 1).mean() > 0.6


@pytest.mark.parametrize("field", ["roughness", "metallic", "transmission", "clearcoat"])
def test_a_share_beyond_one_is_refused(field: str) -> None:
    with pytest.raises(Avs3dError, match="expected numbers from 0 to 1"):
        opened(scene(wall(replace(BLACK, **{field: 1.5}), -2.0)))  # type: ignore[arg-type]


@pytest.mark.parametrize("roughness", [0.2, 0.4])
def test_the_highlight_of_a_lamp_is_as_wide_as_the_path_tracers(roughness: float) -> None:
    pytest.importorskip("mitsuba", reason="the reference renderer is not installed: pip install mitsuba")
    from generators.vision.mitsuba_scene import MitsubaScene, load_mitsuba

    lamp = MeshBuilder().box((0.8, 0.8, 0.05), (0, 0, 1.0), replace(WHITE_GLOW, emission=(4.0,) * 3)).build()
    what = scene(wall(metal(roughness), -2.0, 3.0), lamp, uniform(9.0, BLACK))
    camera = Intrinsics.from_fov(48, 60.0)
    expected = MitsubaScene(load_mitsuba("scalar_rgb"), what).render(ORIGIN, camera, samples=64)[..., 0]
    ours = radiance(what, size=48 * 4, fov=60.0)[..., 0].reshape(48, 4, 48, 4).mean(axis=(1, 3))
    assert ours.sum() == pytest.approx(expected.sum(), rel=0.12)
    row, reference = ours[20:28].mean(axis=0), expected[20:28].mean(axis=0)
    # Where the highlight falls to a half and to a tenth of its height.
    for share in (0.5, 0.1):
        width, wanted = ((each > share * reference.max()).sum() for each in (row, reference))
        assert width == pytest.approx(wanted, abs=2 if share == 0.5 else 0.2 * wanted)


def test_a_small_lamp_leaves_no_dots_on_a_satin_floor_and_a_window_keeps_its_light() -> None:
    """Rare rays that meet a small bright lamp are no dots; where half of the lobe meets a window its light stays."""
    satin = replace(BLACK, roughness=0.4)
    dim = replace(WHITE_GLOW, emission=(0.2,) * 3)

    def floor_under(side: float, radiance_of: float) -> NDArray[np.float32]:
        lit = replace(WHITE_GLOW, emission=(radiance_of,) * 3)
        lamp = MeshBuilder().box((side, side, 0.05), (0, 0, 2.0), lit).build()
        return radiance(scene(wall(satin, -2.0, 3.0), lamp, uniform(9.0, dim)), size=128, fov=60.0)[..., 0]

    plain = np.median(floor_under(0.01, 0.2))
    dots = floor_under(0.04, 60.0)
    assert dots.max() < 2.0 * plain
    window, overexposed = (floor_under(4.0, light)[60:68, 60:68].mean() for light in (3.0, 36.0))
    assert window > 7.0 * plain
    assert overexposed == pytest.approx(12.0 * window, rel=0.1)
