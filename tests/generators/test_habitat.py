"""habitat-sim against the CPU renderer: ids, depth and colour of a furnished flat; and its crashes.

Runs with the interpreter that ``$AVS3D_HABITAT_PYTHON`` names, or ``.habitat/bin/python`` in the repository, which CI
builds. The agreement that was found is printed.
"""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from generators.assets.meshfile import load_mesh
from generators.assets.modelframe import upright
from generators.assets.shapes import MeshBuilder
from generators.core.boxes import yaw_matrix
from generators.core.freespace import CELL, FreeSpace, distance_to_polygon
from generators.core.scene import Material, Part, Scene, StageFile
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.placement import place
from generators.placement.site import Site
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend, warm_up
from generators.vision.glb import write_glb
from generators.vision.habitat import HabitatBackend, HabitatSession, probe
from generators.vision.habitat_process import GPU_VARIABLE, VARIABLE, WorkerTimeouts
from tests.support.flats import furnish, looks, psnr, render, small_flat, without_reflections
from tests.support.rooms import Toy, box_model

ROOT = Path(__file__).parents[2]
BUILT = ROOT / ".habitat" / "bin" / "python"
INTERPRETER = os.environ.get(VARIABLE) or (str(BUILT) if BUILT.exists() else None)
CAMERA = Intrinsics.from_fov(252, 90.0)
GREY = Material("grey", "plaster", colour=(0.5, 0.5, 0.5))
RED = Material("red", "plaster", colour=(0.7, 0.1, 0.1))

pytestmark = pytest.mark.skipif(
    INTERPRETER is None, reason=f"no habitat-sim: {VARIABLE} is not set and {BUILT.relative_to(ROOT)} does not exist"
)


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture(scope="module")
def backend() -> HabitatBackend:
    return HabitatBackend(INTERPRETER)


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """The small flat exported as a GLB and read as a scan."""
    home = small_flat()
    path = tmp_path_factory.mktemp("scan") / "flat.glb"
    write_glb(home, path)
    part = Part("flat", load_mesh(path, twin="surface"))
    return replace(home, parts=(part,), stage=StageFile(path), exposure=1.0)


def agreement(first: list[RenderedView], second: list[RenderedView]) -> tuple[float, float, float]:
    """Over all frames: the share of pixels with equal ids, of those within 2 mm, and the worst frame's PSNR, dB."""
    ids = np.mean([(a.instance_ids == b.instance_ids).mean() for a, b in zip(first, second, strict=True)])
    depth = np.mean([(np.abs(a.depth - b.depth) <= 0.002).mean() for a, b in zip(first, second, strict=True)])
    return float(ids), float(depth), min(psnr(a.rgb, b.rgb) for a, b in zip(first, second, strict=True))


def box_scene(*parts: Part) -> Scene:
    return Scene("boxes", parts, (), ())


def box(centre: tuple[float, float, float], instance: int, size: float = 1.0, material: Material = GREY) -> Part:
    return Part(f"box{instance}", MeshBuilder().box((size,) * 3, centre, material).build(), instance_id=instance)


# --- agreement ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["scan", "lit"])
def test_agrees_with_embree(
    kind: str, scan: Scene, backend: HabitatBackend, capsys: pytest.CaptureFixture[str]
) -> None:
    """``scan``: habitat-sim reads the scan's file itself; ``lit``: everything is exported with its light."""
    scene, placements = furnish(scan if kind == "scan" else small_flat())
    scene = without_reflections(scene)
    poses = looks(scene, np.array(placements[0].source_position), count=6 if kind == "scan" else 3)
    ours, theirs = (render(engine, scene, poses, CAMERA) for engine in (EmbreeBackend(), backend))
    ids, depth, colour = agreement(ours, theirs)
    seen = sum(int((frame.instance_ids > 0).sum()) for frame in ours)
    with capsys.disabled():
        print(
            f"\n  habitat-sim and embree, {kind}, {len(poses)} views of 90°: ids equal on {ids:.4%} of pixels ({seen} "
            f"of placed objects), depth within 2 mm on {depth:.4%}, RGB PSNR ≥ {colour:.1f} dB"
        )
    assert seen > 300
    assert ids >= 0.998
    assert depth >= 0.995
    assert colour >= 30.0


@pytest.mark.slow
def test_both_sides_of_a_face_nothing_behind_it_ids_of_16_bits_and_a_camera_that_is_not_square(
    backend: HabitatBackend,
) -> None:
    corners = np.array([[-1, -1, -3], [1, -1, -3], [1, 1, -3], [-1, 1, -3]])
    front = Part("front", MeshBuilder().quad(corners - [1.5, 0, 0], RED).build(), instance_id=40000)
    back = Part("back", MeshBuilder().quad(corners[::-1] + [1.5, 0, 0], RED).build(), instance_id=9)
    scene, pose = box_scene(front, back), Pose.from_yaw((0.1, 0.2, 0.3), 0.1, 0.05)
    camera = Intrinsics(320, 240, 150.0, 150.0, 160.0, 120.0)
    (ours,), (theirs,) = (render(engine, scene, [pose], camera) for engine in (EmbreeBackend(), backend))
    assert theirs.rgb.shape == (240, 320, 3)
    assert set(np.unique(theirs.instance_ids)) == {0, 9, 40000}
    assert (ours.instance_ids != theirs.instance_ids).mean() < 0.001
    hit = (ours.depth > 0) & (theirs.depth > 0)
    assert np.abs(ours.depth - theirs.depth)[hit].max() < 0.001
    # Where nothing is hit: no depth, and the same colour.
    assert (theirs.depth[theirs.instance_ids == 0] == 0).all()
    assert theirs.instance_ids[0, 0] == 0
    assert np.abs(ours.rgb[0, 0].astype(int) - theirs.rgb[0, 0].astype(int)).max() <= 1
    assert psnr(ours.rgb, theirs.rgb) > 35


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "scale"), [(0.0, 1.0), (25.0, 0.01)])
def test_a_stage_whose_file_has_z_up_stands_upright(
    tmp_path: Path, backend: HabitatBackend, degrees: float, scale: float
) -> None:
    parts = (box((0, -0.05, 0), 0, 4.0), box((1.0, 2.3, -0.5), 0, 0.6, RED))
    turn = yaw_matrix(np.radians(degrees)) @ upright("z", "-y")
    lying = tuple(replace(part, mesh=part.mesh.transformed(turn.T, np.zeros(3), 1 / scale)) for part in parts)
    path = tmp_path / "lying.glb"
    write_glb(box_scene(*lying), path)
    scene = replace(box_scene(*parts), stage=StageFile(path, up="z", front="-y", turn=degrees, scale=scale))
    poses = [Pose.from_yaw((0.3, 3.2, 2.5), 0.1, -0.4), Pose.from_yaw((-1.4, 3.0, -1.2), -2.2, -0.3)]
    ours, theirs = (render(engine, scene, poses, CAMERA) for engine in (EmbreeBackend(), backend))
    for a, b in zip(ours, theirs, strict=True):
        assert (a.depth > 0).mean() > 0.3
        assert (np.abs(a.depth - b.depth) <= 0.002).mean() > 0.995


# --- it dies --------------------------------------------------------------------------------------------------------


def in_mid_render(session: HabitatSession, pose: Pose, how: signal.Signals | None) -> RenderedView:
    """Render while the worker is held, and then send it ``how``; None leaves it held."""
    pid = session.worker_pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    if how is not None:
        threading.Timer(0.5, os.kill, (pid, how)).start()
    return session.render(pose)


def same(first: RenderedView, second: RenderedView) -> bool:
    pairs = ((first.rgb, second.rgb), (first.depth, second.depth), (first.instance_ids, second.instance_ids))
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs)


@pytest.mark.slow
def test_a_worker_killed_in_mid_render_loses_nothing_and_the_second_death_is_one_line() -> None:
    backend = HabitatBackend(INTERPRETER, WorkerTimeouts(render=8.0))
    scene = box_scene(box((0, 0, -3), 1), box((0.5, 0.2, -5), 0, 3.0, RED))
    here, there = Pose.from_yaw((0, 0.1, 0), 0.1), Pose.from_yaw((0.4, 0, 0), -0.2)
    session = backend.open(scene, Intrinsics.from_fov(96))
    try:
        before = [session.render(pose) for pose in (here, there, here)]
        assert same(before[0], before[2]), "the same pose, the same bytes"
        first, folder = session.worker_pid, session._folder
        again = in_mid_render(session, there, signal.SIGKILL)
        assert session.worker_pid != first
        assert same(again, before[1])
        assert same(session.render(here), before[0]), "and from another worker, too"
        second = session.worker_pid
        with pytest.raises(Avs3dError, match=r"a second time.*did not answer within 8 s") as caught:
            in_mid_render(session, here, None)
        assert "\n" not in str(caught.value)
        with pytest.raises(Avs3dError, match="closed"):
            session.render(here)
    finally:
        session.close()
    session.close()
    assert not folder.exists()
    assert not any(Path(f"/proc/{pid}").exists() for pid in (first, second))


@pytest.mark.slow
def test_no_graphics_device_is_explained_in_habitats_own_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GPU_VARIABLE, "77")
    ok, text = probe(INTERPRETER)
    assert not ok
    assert "ended with status 1" in text
    assert "77" in text, "the worker's own last lines"
    assert GPU_VARIABLE in text
    assert "libegl1" in text
    assert "\n" not in text


@pytest.mark.slow
def test_a_stage_that_is_no_mesh_is_one_line(tmp_path: Path, backend: HabitatBackend) -> None:
    path = tmp_path / "broken.glb"
    path.write_bytes(b"not a mesh")
    scene = replace(box_scene(box((0, 0, -3), 0)), stage=StageFile(path))
    with pytest.raises(Avs3dError) as caught:
        backend.open(scene, CAMERA)
    assert "\n" not in str(caught.value)
    assert "habitat-sim" in str(caught.value)


def test_a_stage_that_is_gone_is_one_line(tmp_path: Path, backend: HabitatBackend) -> None:
    scene = replace(box_scene(box((0, 0, -3), 0)), stage=StageFile(tmp_path / "gone.glb"))
    with pytest.raises(Avs3dError, match=r"gone\.glb: no such file"):
        backend.open(scene, CAMERA)


@pytest.mark.slow
def test_the_probe_renders(backend: HabitatBackend) -> None:
    ok, text = probe(INTERPRETER)
    assert ok
    assert f"habitat-sim {backend.version} renders" in text


# --- navigation mesh ------------------------------------------------------------------------------------------------


def room_with_a_hole() -> Toy:
    """5 × 4 m with a block in a corner, and a hole of 1.2 × 1.2 m in the floor."""
    toy = Toy(size=(5.0, 2.5, 4.0)).shell()
    toy.solids = [solid for solid in toy.solids if solid[1][1] > 0.0]
    (x0, z0), (x1, z1) = (2.8, 1.4), (4.0, 2.6)
    for low, high in (((-1, -1), (x0, 5)), ((x1, -1), (6, 5)), ((x0, -1), (x1, z0)), ((x0, z1), (x1, 5))):
        toy.add((low[0], -0.1, low[1]), (high[0], 0.0, high[1]))
    return toy.add((0.0, 0.0, 0.0), (1.5, 0.9, 1.0))


@pytest.mark.slow
def test_the_navigation_mesh_agrees_with_free_space_and_keeps_off_holes(
    backend: HabitatBackend, capsys: pytest.CaptureFixture[str]
) -> None:
    toy = room_with_a_hole()
    space = FreeSpace.of(toy.scene, "kitchen")
    navigable = backend.navigable(toy.scene)
    cut = space.within(navigable)
    share = cut.area / space.area
    plan = np.stack(np.meshgrid(np.arange(0.025, 5.0, 0.05), np.arange(0.025, 4.0, 0.05)), axis=2).reshape(-1, 2)
    inside = navigable(np.insert(plan, 1, 0.0, axis=1))
    mesh_area = inside.sum() * 0.05**2
    with capsys.disabled():
        areas = f"free space {space.area:.2f} m², navigation mesh {mesh_area:.2f} m², both {cut.area:.2f} m²"
        print(f"\n  {areas} ({share:.1%})")
    assert share > 0.85
    assert abs(mesh_area / space.area - 1) < 0.15
    # Nothing over the hole or in the block.
    over = ((plan > (2.85, 1.45)) & (plan < (3.95, 2.55))).all(axis=1)
    block = (plan < (1.45, 0.95)).all(axis=1)
    assert not inside[over | block].any()
    assert not navigable(np.array([[2.0, 1.5, 2.0]])).any(), "in mid-air"
    # And a walk that asks it stays a step away from the hole, where free space alone would go up to its rim.
    rng = np.random.default_rng(4)
    placements = place(Site.of(toy.scene, "kitchen"), [box_model("washing_machine")], rng=rng)
    poses = plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placements, frames=24, navigable=navigable), rng).poses
    track = np.array([(pose.position[0], pose.position[2]) for pose in poses])
    hole = np.array([[2.8, 1.4], [4.0, 1.4], [4.0, 2.6], [2.8, 2.6]])
    assert distance_to_polygon(track, hole).min() > 0.1
    on = navigable(np.insert(track, 1, 0.0, axis=1))
    assert on.mean() > 0.8
    # The centres of the cells it walks through are on the mesh, and it is never farther than that from them.
    corners = 0.5 * CELL * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    near = [navigable(np.insert(track + corner, 1, 0.0, axis=1)) for corner in corners]
    assert (on | np.any(near, axis=0)).all()
