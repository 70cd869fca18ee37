"""The path tracer as a renderer: its labels are embree's, its light follows closed forms, its bytes repeat."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from benchmarks import pathtraced_cost
from generators.assets.shapes import MeshBuilder
from generators.core.scene import Material, Part, Room, Scene, StageFile, Texture
from generators.core.tone import develop, inverse_tone_curve, srgb_decode
from generators.scenes.renderer import Renderer
from generators.vision import pathtraced
from generators.vision.embree import EmbreeBackend
from generators.vision.mitsuba_scene import MitsubaScene, load_mitsuba
from tests.generators.test_light import LAMP, SIZE, box_room, ceiling_lamp, matte, scene_of
from tests.support.homes import tree_digest, write_manifest

pytestmark = pytest.mark.slow

CAMERA = Intrinsics.from_fov(24)
AHEAD = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
POSE = Pose.from_yaw((2.0, 1.2, 1.5), 0.4)


@pytest.fixture(scope="module", autouse=True)
def backend() -> pathtraced.PathtracedBackend:
    pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'avs3d-bench[pathtraced]'")
    found = pathtraced.PathtracedBackend()
    try:
        found.warm_up()
    except Avs3dError as error:
        pytest.skip(str(error))
    return found


def room_with_a_block() -> Scene:
    block = MeshBuilder().box((0.6, 0.8, 0.5), (1.0, 0.4, 1.0), matte(0.6)).build()
    scene = scene_of(box_room(matte(0.6)).build(), ceiling_lamp(2.0, 1.5, 0.8, 2.4))
    return replace(scene, parts=(*scene.parts, Part("block", block, instance_id=3)))


def plate(material: Material, distance: float) -> Part:
    """A square of 6 m before a camera at the origin that looks along −Z."""
    z = -distance
    corners = [(-3, -3, z), (3, -3, z), (3, 3, z), (-3, 3, z)]
    return Part(material.name, MeshBuilder().quad(corners, material, fit=True).build())


def picture(backend: pathtraced.PathtracedBackend, scene: Scene, pose: Pose = POSE) -> np.ndarray:
    session = backend.open(scene, CAMERA)
    rgb = session.render(pose).rgb
    session.close()
    return rgb


def test_labels_are_those_of_the_default_renderer_and_bytes_repeat(backend: pathtraced.PathtracedBackend) -> None:
    scene, other = room_with_a_block(), Pose.from_yaw((2.5, 1.4, 2.0), 1.1)
    session = backend.open(scene, CAMERA)
    first = session.render(POSE)
    session.render(other)
    again = session.render(POSE)
    session.close()
    expected = EmbreeBackend().open(scene, CAMERA).render(POSE)
    assert 3 in expected.instance_ids
    assert np.array_equal(first.instance_ids, expected.instance_ids)
    assert np.array_equal(first.depth, expected.depth)
    assert np.array_equal(first.rgb, again.rgb)
    assert np.array_equal(picture(backend, scene), first.rgb)


@pytest.mark.parametrize("pixels", [0.5, 1.0])
def test_denoising_keeps_a_rod_as_thin_as_a_pixel(backend: pathtraced.PathtracedBackend, pixels: float) -> None:
    pytest.importorskip("pyoidn", reason="Open Image Denoise is not installed: pip install 'avs3d-bench[pathtraced]'")
    side = 96
    # A metre before the camera a pixel is 2 m / side wide.
    rod = MeshBuilder().box((pixels * 2.0 / side, 1.2, 0.02), (2.0, 0.6, 1.0), matte(0.15)).build()
    scene = scene_of(box_room(matte(0.6)).build(), ceiling_lamp(2.0, 1.5, 0.8, 2.4))
    session = backend.open(replace(scene, parts=(*scene.parts, Part("rod", rod, 3))), Intrinsics.from_fov(side))
    pose = Pose.from_yaw((2.0, 1.2, 2.0), 0.0)
    sums, labels = session.begin(pose).result(), session.labels(pose)
    missing = []
    for denoise in (False, True):
        light = srgb_decode(session.finish(sums, labels, denoise=denoise) / 255.0)[52:72, :, 1].mean(axis=0)
        wall = np.median(np.concatenate([light[30:42], light[54:66]]))
        missing.append(np.clip(wall - light[44:52], 0.0, None))
    session.close()
    noisy, denoised = missing
    assert denoised.sum() == pytest.approx(noisy.sum(), rel=0.1)
    assert denoised.max() > 0.85 * noisy.max()


def test_frames_in_work_at_the_same_time_have_the_bytes_of_one_after_another(
    backend: pathtraced.PathtracedBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paths are followed for one frame at a time, whichever thread asks; what the threads share is read alone."""
    monkeypatch.setattr(pathtraced, "SAMPLES", 4)
    poses = {second: Pose.from_yaw((2.0, 1.2, 1.5), 0.5 * second) for second in range(7)}
    scene, threads = room_with_a_block(), set[int]()

    def finished(_: int, __: object) -> None:
        threads.add(threading.get_ident())

    with Renderer(scene, backend) as camera:
        together = list(camera.frames(poses, CAMERA, then=finished, cores=lambda: 3))
    assert len(threads) > 1
    with Renderer(scene, backend) as camera:
        for second, view in enumerate(together):
            alone = camera.frame(poses[second], CAMERA)
            assert np.array_equal(view.rgb, alone.rgb)
            assert np.array_equal(view.instance_ids, alone.instance_ids)


def two_rooms() -> Scene:
    """A room with a lamp, and another one, out of sight, with a lamp as large that is thirty times as bright."""
    beside = SIZE[0] + 0.1
    bright = replace(LAMP, name="bright", emission=tuple(30 * value for value in LAMP.emission))
    corners = [(beside + x, 2.4, z) for x, z in ((1.6, 1.1), (2.4, 1.1), (2.4, 1.9), (1.6, 1.9))]
    rooms = tuple(Room(name, (x, 0.0, 0.0), (x + SIZE[0], *SIZE[1:])) for name, x in (("here", 0.0), ("there", beside)))
    walls = box_room(matte(0.6)).build(), box_room(matte(0.6), shift=beside).build()
    return scene_of(*walls, ceiling_lamp(2.0, 1.5, 0.8, 2.4), MeshBuilder().quad(corners, bright).build(), rooms=rooms)


def test_recorded_programs_give_the_bytes_of_those_that_are_traced_anew_in_any_order_of_rooms(
    backend: pathtraced.PathtracedBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    import drjit

    monkeypatch.setattr(pathtraced, "SAMPLES", 4)
    monkeypatch.setattr(pathtraced, "_PATHS", {"llvm": 7 * 24 * 4, "cuda": 7 * 24 * 4})  # four blocks, the last padded
    scene, near, far = two_rooms(), POSE, Pose.from_yaw((SIZE[0] + 2.1, 1.2, 1.5), 0.4)
    session = backend.open(scene, CAMERA)
    found = [session.render(pose).rgb for pose in (near, far, near)]
    session.close()
    assert np.array_equal(found[0], found[2])
    assert not np.array_equal(found[0], found[1])
    with drjit.scoped_set_flag(drjit.JitFlag.KernelFreezing, False):
        assert np.array_equal(picture(backend, scene, near), found[0])


def test_lamps_tried_by_their_light_leave_the_mean_and_lower_the_noise(backend: pathtraced.PathtracedBackend) -> None:
    scene = two_rooms()

    def traced(room: Room | None) -> np.ndarray:
        whole = MitsubaScene(load_mitsuba("llvm_ad_rgb"), scene, room)
        return np.stack([whole.render(POSE, CAMERA, 16, seed=seed) for seed in range(8)])

    by_power, by_light = traced(None), traced(scene.room("here"))
    spread = [float(one.var(axis=0, ddof=1).mean()) for one in (by_power, by_light)]
    assert spread[1] < spread[0] / 5
    error = np.sqrt(sum(spread) / (8 * CAMERA.width * CAMERA.height))  # of the difference of two means of 8 pictures
    assert abs(by_power.mean() - by_light.mean()) < 4 * error


def test_radiance_in_a_furnace(backend: pathtraced.PathtracedBackend) -> None:
    # Everything glows with e and reflects half of what arrives: radiance is 2 e everywhere.
    scene = scene_of(box_room(matte(0.5, emission=(0.2, 0.1, 0.05))).build())
    found = picture(backend, scene).reshape(-1, 3)
    assert np.abs(np.median(found, axis=0) - develop([0.4, 0.2, 0.1])).max() <= 2


def test_more_paths_bring_a_picture_nearer_to_the_reference_of_its_cost(
    backend: pathtraced.PathtracedBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pathtraced, "_denoiser_version", lambda: None)
    off = {}
    for samples in (2, 32):
        monkeypatch.setattr(pathtraced, "SAMPLES", samples)
        monkeypatch.setattr(pathtraced_cost, "SAMPLES", samples)
        session = backend.open(room_with_a_block(), CAMERA)
        off[samples] = pathtraced_cost.error(session, POSE, session.render(POSE).rgb, 128)
        session.close()
    assert {found["paths"] for found in off.values()} == {128}
    # Noise falls by the root of the number of paths; the reference has noise of its own.
    own = [np.sqrt(max(found["rms"] ** 2 - found["of the reference"] ** 2, 0.0)) for found in off.values()]
    assert 2.5 < own[0] / own[1] < 6.0


def test_a_pace_counts_frames_after_the_first_ones(
    backend: pathtraced.PathtracedBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pathtraced, "SAMPLES", 2)
    rooms = (Room("box", (0.0, 0.0, 0.0), SIZE),)
    poses = tuple(Pose.from_yaw((2.0, 1.2, 1.5), 0.1 * step) for step in range(8))
    monkeypatch.setattr(
        pathtraced_cost, "prepared_room", lambda *_, **__: (replace(room_with_a_block(), rooms=rooms), "box", poses)
    )
    encoded, waited = list[int](), list[int]()
    monkeypatch.setattr(pathtraced_cost, "encode", lambda number, _: encoded.append(number))
    start = SimpleNamespace(wait=lambda _: waited.append(len(encoded)))
    pace = pathtraced_cost.render_for(("a key", 24, 2, 0.5), start)
    assert len(waited) == 1
    assert waited[0] >= 4  # two of each of two sessions
    assert 2 <= pace.frames <= len(encoded) - 4
    assert 0.5 <= pace.seconds < 60


@pytest.mark.parametrize("metal", [(0.9, 0.6, 0.3), None])
def test_polished_metal_shows_what_it_reflects(
    backend: pathtraced.PathtracedBackend, metal: tuple[float, float, float] | None
) -> None:
    """A plate before the camera, and a lamp that fills the half space behind the camera."""
    glow = Material("glow", "plaster", (0.0, 0.0, 0.0), emission=(0.5, 0.5, 0.5))
    lamp = MeshBuilder().quad([(-300, -300, 5), (-300, 300, 5), (300, 300, 5), (300, -300, 5)], glow).build()
    front = Material("plate", "metal", metal or (0.0, 0.0, 0.0), roughness=0.0, metallic=float(metal is not None))
    found = picture(backend, scene_of(plate(front, 1.0).mesh, lamp), AHEAD)
    # Metal has its tint as reflectance at normal incidence; a dielectric of index 1.5 has 4 % (Fresnel).
    expected = develop(0.5 * np.asarray(metal or (0.04, 0.04, 0.04)))
    assert np.abs(found[11:13, 11:13].astype(int).mean(axis=(0, 1)) - expected).max() <= 4


def test_a_window_shows_its_view_at_the_rooms_exposure(backend: pathtraced.PathtracedBackend) -> None:
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:4], pixels[4:] = 255, 60
    pane = Material(
        "sky_0",
        "glass",
        (0.04,) * 3,
        Texture("view", pixels),
        emission=(0.4, 0.4, 0.4),
        shown=(0.8,) * 3,
    )
    found = picture(backend, scene_of(plate(pane, 3.0).mesh), AHEAD)
    bright, dark = found[4].mean(), found[-4].mean()
    assert bright > dark
    # 60 of 255 is 4.5 % of white's light.
    expected = develop(0.8 * np.array([1.0, 0.0452]))
    assert np.abs(np.array([bright, dark]) - expected).max() <= 6


def test_a_scan_is_shown_as_it_was_photographed(backend: pathtraced.PathtracedBackend, tmp_path: Path) -> None:
    wall = plate(Material("scan", "plaster", texture=Texture("t", np.full((4, 4, 3), (180, 120, 60), np.uint8))), 2.0)
    scene = replace(scene_of(wall.mesh), stage=StageFile(tmp_path / "scan.glb"), exposure=0.3)
    found = picture(backend, scene, AHEAD)
    assert np.abs(found.astype(int) - (180, 120, 60)).max() <= 1


def test_an_object_in_a_scan_is_lit_by_what_the_scan_shows(
    backend: pathtraced.PathtracedBackend, tmp_path: Path
) -> None:
    """A scan fills the half space behind the camera: a matte object before it reflects ρ times what the scan shows."""
    around = Material("scan", "plaster", texture=Texture("t", np.full((4, 4, 3), 180, np.uint8)))
    corners = [(-300, -300, 5), (-300, 300, 5), (300, 300, 5), (300, -300, 5)]
    scan = Part("scan", MeshBuilder().quad(corners, around, fit=True).build())
    thing = replace(plate(matte(0.5), 1.0), instance_id=3)
    scene = replace(scene_of(), parts=(scan, thing), stage=StageFile(tmp_path / "scan.glb"))
    found = picture(backend, scene, AHEAD)[11:13, 11:13].mean()
    radiance = float(inverse_tone_curve(srgb_decode(180 / 255)))
    # The scan's light is told apart in steps of half a stop.
    low, high = (develop([0.5 * radiance * 2.0**step] * 3).mean() for step in (-0.3, 0.3))
    assert low <= found <= high


def test_what_moves_is_seen_where_it_is_in_each_second(backend: pathtraced.PathtracedBackend) -> None:
    still = room_with_a_block()
    *walls, block = still.parts
    aside = replace(block, mesh=replace(block.mesh, positions=block.mesh.positions + np.float32([0.5, 0.0, 0.3])))
    moved = replace(still, parts=(*walls, aside))
    with Renderer(SimpleNamespace(moves=True, scene=lambda second: (still, moved)[second]), backend) as camera:
        found = [camera.frame(POSE, CAMERA, second) for second in (0, 1, 0)]
    for view, scene in zip(found, (still, moved, still), strict=True):
        np.testing.assert_array_equal(view.rgb, picture(backend, scene))
        np.testing.assert_array_equal(view.instance_ids, EmbreeBackend().open(scene, CAMERA).render(POSE).instance_ids)
    assert (found[0].instance_ids != found[1].instance_ids).any()


def test_two_workers_write_the_same_bytes_as_one(backend: pathtraced.PathtracedBackend, tmp_path: Path) -> None:
    """Two observations in a room of a GLB file, each worker with a GPU or cores of its own to share."""
    manifest, roots = write_manifest(tmp_path), [tmp_path / "one", tmp_path / "two"]
    for number, root in enumerate(roots):
        command = [sys.executable, "-m", "avs3d_bench", "generate", manifest, "-o", root, "--vision", "pathtraced"]
        command += ["--audio", "analytic", "--size", "24", "--frames", "9", "--workers", number + 1]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert tree_digest(roots[0]) == tree_digest(roots[1])


def test_no_variant_that_works_is_one_line() -> None:
    with pytest.raises(Avs3dError, match="no variant 'metal_rgb'; expected some of scalar_rgb"):
        load_mitsuba("metal_rgb")


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("across", "up"), [(0.25, 0.0), (0.0, 0.25)])
def test_a_tilted_normal_map_turns_what_a_mirror_shows(
    backend: pathtraced.PathtracedBackend, mirrored: bool, across: float, up: float
) -> None:
    """A mirror ahead whose map tilts n by atan(t) shows what lies 2·atan(t) off the way back: a lamp of that place."""
    steep = np.array([across, up, 1.0]) / np.sqrt(across**2 + up**2 + 1)
    pixels = np.broadcast_to(np.rint((steep + 1) * 127.5).astype(np.uint8), (4, 4, 3)).copy()
    mirror = Material("mirror", "glass", roughness=0.0, metallic=1.0, normal_map=Texture("tilt", pixels))
    corners = [(-3.0, -3.0, -1.0), (3.0, -3.0, -1.0), (3.0, 3.0, -1.0), (-3.0, 3.0, -1.0)]
    uv = np.array([(1 - x / 3 if mirrored else x / 3, y / 3) for x, y, _ in corners])[[[0, 1, 2], [0, 2, 3]]]
    front = MeshBuilder().add(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), mirror, uv=uv).build()
    # u of a mirrored picture points to the left, and so does the tilt along u.
    sign = -1.0 if mirrored and across else 1.0
    way = np.array([sign * across, up]) / 0.25
    middle = np.array([0.0, 0.0, -1.0]) + 4 * np.array(
        [*(way * np.sin(2 * np.arctan(0.25))), np.cos(2 * np.arctan(0.25))]
    )
    glow = Material("glow", "plaster", (0.0, 0.0, 0.0), emission=(0.5, 0.5, 0.5))
    lamp = MeshBuilder().sphere(0.6, tuple(middle), glow, rings=12, segments=16).build()
    found = picture(backend, scene_of(front, lamp), AHEAD)
    assert np.abs(found[11:13, 11:13].astype(int).mean(axis=(0, 1)) - develop(np.full(3, 0.5))).max() <= 6


def test_a_clear_pane_lets_light_through(backend: pathtraced.PathtracedBackend) -> None:
    """Through a thin pane of index 1.5 go all rays but those reflected: 2F/(1 + F) of them, F = 0.04."""
    glow = Material("glow", "plaster", (0.0, 0.0, 0.0), emission=(0.5, 0.5, 0.5))
    pane = Material("pane", "glass", (1.0, 1.0, 1.0), roughness=0.0, transmission=1.0)
    found = picture(backend, scene_of(plate(pane, 1.0).mesh, plate(glow, 2.0).mesh), AHEAD)
    expected = develop(np.full(3, 0.5 * (1 - 0.08 / 1.04)))
    assert np.abs(found[11:13, 11:13].astype(int).mean(axis=(0, 1)) - expected).max() <= 4


def test_a_roughness_map_is_read_linearly_and_tells_metal_from_paint(backend: pathtraced.PathtracedBackend) -> None:
    """Half of a plate is bare metal (blue 1), half is painted black (blue 0); a lamp fills what it could reflect."""
    glow = Material("glow", "plaster", (0.0, 0.0, 0.0), emission=(0.5, 0.5, 0.5))
    lamp = MeshBuilder().quad([(-300, -300, 5), (-300, 300, 5), (300, 300, 5), (300, -300, 5)], glow).build()
    pixels = np.full((8, 8, 3), 20, np.uint8)
    pixels[:, :4, 2], pixels[:, 4:, 2] = 255, 0
    colour = np.zeros((8, 8, 3), np.uint8)
    colour[:, :4] = 255
    front = Material(
        "plate", "metal", texture=Texture("c", colour), metallic=1.0, roughness_map=Texture("rough", pixels)
    )
    found = picture(backend, scene_of(plate(front, 3.0).mesh, lamp), AHEAD).astype(int)
    left, right = found[11:13, 3:6].mean(axis=(0, 1)), found[11:13, 18:21].mean(axis=(0, 1))
    assert np.abs(left - develop(np.full(3, 0.5))).max() <= 5
    assert np.abs(right - develop(np.full(3, 0.5 * 0.04))).max() <= 8
