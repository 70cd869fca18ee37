"""What is seen through windows, and the white balance: both against closed forms and in a furnished flat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from avs3d_bench.geometry import Intrinsics, Pose
from generators.apartments.joinery import VIEW_SHARE
from generators.assets.shapes import MeshBuilder
from generators.core.scene import LightMap, Material, Mesh, Part, Scene, StageFile, Texture
from generators.core.tone import LUMINANCE, MID_GREY, develop, srgb_decode
from generators.lighting.bake import insert
from generators.vision.embree import EmbreeBackend, warm_up
from tests.support.flats import looks, render, small_flat

CAMERA = Intrinsics.from_fov(96)
GREY_CARD = Material("grey card", "paper", (0.18, 0.18, 0.18))
#: Sides of the plane that the test's view covers (m), and its distance behind the pane.
SPAN, AWAY = 40.0, 10.0


@pytest.fixture(autouse=True, scope="module")
def _compiled() -> None:
    warm_up()


def pane(material: Material, half: float = 1.0) -> Mesh:
    """An upright square at z = −2 that faces +z; its uv counts `SPAN`, the middle at (0.5, 0.5)."""
    builder = MeshBuilder()
    builder.quad([(-half, -half, -2), (half, -half, -2), (half, half, -2), (-half, half, -2)], material)
    mesh = builder.build()
    return replace(mesh, uv=(0.5 + mesh.positions[..., :2] / SPAN).astype(np.float32))


def ramp() -> Texture:
    """Red grows with u, green with v."""
    levels = np.linspace(0, 255, 256).astype(np.uint8)
    pixels = np.zeros((256, 256, 3), dtype=np.uint8)
    pixels[..., 0], pixels[..., 1] = levels, levels[::-1, None]
    return Texture("ramp", pixels)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 0.0), (0.6, -0.4, 0.5)])
def test_a_view_lies_on_a_plane_behind_the_pane(eye: tuple[float, float, float]) -> None:
    view = Material("view", "glass", texture=ramp(), shown=(1.0, 1.0, 1.0), view_distance=AWAY)
    scene = Scene("view", (Part("pane", pane(view)),), (), (), exposure=0.5)
    frame = render(EmbreeBackend(), scene, [Pose.from_yaw(eye, 0.0)], CAMERA)[0]
    row, column = np.nonzero(frame.depth > 0)
    reach = eye[2] + 2 + AWAY
    x = eye[0] + (column + 0.5 - CAMERA.cx) / CAMERA.fx * reach
    y = eye[1] - (row + 0.5 - CAMERA.cy) / CAMERA.fy * reach
    expected = develop(0.5 * srgb_decode(np.stack([0.5 + x / SPAN, 0.5 + y / SPAN], axis=1).clip(0, 1)))
    inner = (np.abs(frame.rgb[row, column, :2].astype(int) - expected.astype(int)) <= 3).all(axis=1)
    assert len(row) > 1000
    assert inner.mean() > 0.9, "all but the pixels at the pane's edges, which mix with what is beside it"
    np.testing.assert_allclose(frame.depth[row, column], eye[2] + 2, rtol=1e-5)


def test_a_mirror_shows_the_view_behind_a_window() -> None:
    """A mirror beside the eye shows the pane behind it, and through it the plane of the view, turned left to right."""
    view = Material("view", "glass", texture=ramp(), shown=(1.0, 1.0, 1.0), view_distance=AWAY)
    builder = MeshBuilder()
    metal = Material("metal", "metal", (1.0, 1.0, 1.0), roughness=0.0, metallic=1.0)
    builder.quad([(3, -3, 1), (-3, -3, 1), (-3, 3, 1), (3, 3, 1)], metal)
    scene = Scene("view", (Part("pane", pane(view, 0.7)), Part("mirror", builder.build())), (), (), exposure=0.5)
    frame = render(EmbreeBackend(), scene, [Pose.from_yaw((0.0, 0.0, -1.9), np.pi)], CAMERA)[0]
    y, x = np.mgrid[0:96, 0:96]
    across, up = (x + 0.5 - CAMERA.cx) / CAMERA.fx, -(y + 0.5 - CAMERA.cy) / CAMERA.fy
    met = (np.abs(across) * 5.9 < 0.65) & (np.abs(up) * 5.9 < 0.65)
    place = np.stack([0.5 - across * (5.9 + AWAY) / SPAN, 0.5 + up * (5.9 + AWAY) / SPAN], axis=-1)[met]
    expected = develop(0.5 * srgb_decode(place.clip(0, 1)))
    assert met.sum() > 60
    np.testing.assert_allclose(frame.rgb[met][:, :2].astype(int), expected.astype(int), atol=3)


def test_above_and_below_the_view_its_edges_go_on() -> None:
    view = Material("view", "glass", texture=ramp(), shown=(1.0, 1.0, 1.0), view_distance=60.0)
    scene, camera = Scene("view", (Part("pane", pane(view)),), (), ()), Intrinsics.from_fov(384)
    frame = render(EmbreeBackend(), scene, [Pose.from_yaw((0.0, 0.0, 0.0), 0.0)], camera)[0]
    # 31 m above and below the horizon at the pane's edges: the view ends after 20 m.
    top, bottom = frame.rgb[98:120, 100:280, 1], frame.rgb[264:286, 100:280, 1]
    assert top.min() >= develop(0.98)
    assert bottom.max() <= develop(0.03)


def test_white_balance_scales_the_channels_of_light_and_leaves_photographs() -> None:
    lit = LightMap(np.full((2, 3, 2), 0.5, np.float32), np.full((2, 2, 3), 0.5, np.float16))
    scene = Scene("card", (Part("card", pane(GREY_CARD), light=lit),), (), (), exposure=2.0, white=(0.5, 1.0, 1.5))
    pose = [Pose.from_yaw((0.0, 0.0, 0.0), 0.0)]
    middle = render(EmbreeBackend(), scene, pose, CAMERA)[0].rgb[48, 48]
    assert middle.tolist() == develop(2.0 * 0.5 * 0.18 * np.array([0.5, 1.0, 1.5])).tolist()
    photograph = Part(
        "scan",
        pane(Material("scan", "paint", (1.0, 1.0, 1.0), texture=Texture("grey", np.full((4, 4, 3), 118, np.uint8)))),
    )
    scan = replace(scene, parts=(photograph,), stage=StageFile(__file__))  # type: ignore[arg-type]
    assert render(EmbreeBackend(), scan, pose, CAMERA)[0].rgb[48, 48].tolist() == [118, 118, 118]


def card(centre: np.ndarray, yaw: float) -> Part:
    """A grey card of 20 cm that looks in the direction ``yaw`` (rad)."""
    builder = MeshBuilder()
    builder.box((0.2, 0.2, 0.004), (0.0, 0.0, 0.0), GREY_CARD)
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    return Part("card", builder.build().transformed(turn, centre), instance_id=1)


@pytest.mark.slow
@pytest.mark.parametrize("room", ["kitchen", "bathroom"])
def test_a_grey_card_that_turns_to_all_sides_is_neutral(room: str) -> None:
    home = small_flat().for_room(room)
    box = home.room(room)
    centre = (np.array(box.low) + np.array(box.high)) / 2
    centre[1] = box.low[1] + 1.3
    light = []
    for yaw in np.arange(8) * np.pi / 4:
        scene = insert(home, (card(centre, yaw),))
        eye = centre + 0.4 * np.array([np.sin(yaw), 0.0, np.cos(yaw)])
        session = EmbreeBackend().open(scene, CAMERA)
        light.append(session.radiance(Pose.from_yaw(tuple(map(float, eye)), yaw))[0][40:56, 40:56].mean(axis=(0, 1)))
    red, green, blue = np.mean(light, axis=0)
    assert red / green == pytest.approx(1.0, abs=0.05)
    assert blue / green == pytest.approx(1.0, abs=0.05)
    assert np.abs(small_flat().room(room).white - np.ones(3)).max() > 0.05, "the light was neutral: nothing is proved"


@pytest.mark.slow
def test_windows_are_overexposed_in_part_and_walls_are_not() -> None:
    home = small_flat()
    panes = [m for part in home.parts for m in part.mesh.materials if m.shown is not None]
    view = panes[0].texture
    assert view is not None
    assert panes[0].shown is not None
    band = srgb_decode(view.pixels[256:768] / 255.0).mean(axis=(0, 1)) * panes[0].shown
    # What lights the room is what is seen outside, but for the share that the camera takes off.
    emitted = np.mean([m.emission for m in {m.name: m for m in panes}.values()], axis=0)
    assert band @ LUMINANCE == pytest.approx(VIEW_SHARE * (emitted @ LUMINANCE), rel=0.15)
    stops = np.log2(home.exposure * float(band @ LUMINANCE) / MID_GREY)
    assert 2.0 < stops < 5.0
    session = EmbreeBackend().open(home, CAMERA)
    names = [(m.shown is not None, max(m.emission) > 0) for part in home.parts for m in part.mesh.materials]
    first = np.cumsum([0, *(len(part.mesh.materials) for part in home.parts)])
    surface = np.concatenate([part.mesh.face_material + first[k] for k, part in enumerate(home.parts)])
    is_pane, glows = np.array(names)[surface].T
    through, walls = [], []
    for pose in looks(home, np.array([0.0, 1.5, 0.0]), count=8):
        rgb = session.render(pose).rgb
        face = session.faces
        through.append((rgb.max(axis=2) >= 250)[is_pane[face]])
        walls.append((rgb.min(axis=2) >= 253)[~glows[face]])
    assert np.concatenate(walls).mean() < 0.01
    clipped = np.concatenate(through).mean()  # in one channel at least
    assert 0.02 < clipped < 0.8, clipped
