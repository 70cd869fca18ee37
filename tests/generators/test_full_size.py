"""One furnished flat at the benchmark's full size: what the tiny scenes of the other tests cannot show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.geometry import Intrinsics, Pose
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.lighting.bake import bake, insert
from generators.observation.arrangement import choose_models, draw_sounding
from generators.options import GenerateOptions
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from generators.plan import make_plans, read_manifest
from generators.vision.base import RenderedView
from generators.vision.embree import EmbreeBackend
from tests.support.flats import textured_flat

MANIFEST = Path(__file__).parents[2] / "scenes_manifest" / "demo.yaml"
CAMERA = Intrinsics.from_fov(1008)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def view() -> tuple[Scene, tuple[Placement, ...], Pose, RenderedView]:
    """The demo's kitchen in quickly baked light, from the pose that sees most of the sounding microwave."""
    (plan,) = make_plans(read_manifest(MANIFEST), GenerateOptions(only=["part_2/*/kitchen/1"], audio="analytic"))
    assert plan.scan.seed is not None
    home = bake(textured_flat(plan.scan.seed), quality="preview").for_room(plan.spec.room)
    placed = place(Site.of(home, plan.spec.room), choose_models(plan), rng=plan.rng("placement"))
    poses = plan_walk(WalkTask(Site.of(home, plan.spec.room), placed, frames=120), plan.rng("path")).poses
    scene = insert(home, tuple(p.part(number) for number, p in enumerate(placed, start=1)))
    source = placed[draw_sounding(plan, placed) - 1]
    ahead = [float(pose.rotation_matrix[:, 2] @ (np.array(pose.position) - source.source_position)) for pose in poses]
    pose = poses[int(np.argmin(np.abs(np.array(ahead) - 1.5)))]
    return scene, placed, pose, EmbreeBackend().open(scene, CAMERA).render(pose)


def test_a_room_is_closed_and_exposed_like_a_photograph(
    view: tuple[Scene, tuple[Placement, ...], Pose, RenderedView],
) -> None:
    frame = view[3]
    assert frame.rgb.shape == (1008, 1008, 3)
    assert (frame.depth > 0).all()
    brightness = frame.rgb.mean(axis=2)
    assert 70 < np.median(brightness) < 205
    assert (brightness >= 254).mean() < 0.15
    assert (brightness < 4).mean() < 0.05
    # Light, not flat colour: neighbouring blocks of the picture differ gently almost everywhere.
    blocks = brightness.reshape(63, 16, 63, 16).mean(axis=(1, 3))
    assert (np.abs(np.diff(blocks, axis=1)) > 0.05).mean() > 0.9


def test_ids_and_depth_are_those_of_the_rays_through_the_pixel_centres(
    view: tuple[Scene, tuple[Placement, ...], Pose, RenderedView],
) -> None:
    scene, placed, pose, frame = view
    caster = RayCaster(scene)
    rng = np.random.default_rng(3)
    row, column = rng.integers(0, 1008, (2, 40_000))
    ray = np.stack([(column + 0.5 - 504) / 504, -(row + 0.5 - 504) / 504, -np.ones(len(row))], axis=1)
    distance, face = caster.closest(pose.position, ray @ pose.rotation_matrix.T)
    ids = np.array([part.instance_id for part in scene.parts])[caster.face_part[face]]
    assert (ids == frame.instance_ids[row, column]).mean() > 0.9999
    assert np.median(np.abs(distance - frame.depth[row, column])) < 1e-5
    assert set(np.unique(frame.instance_ids)) <= set(range(len(placed) + 1))
    assert (frame.instance_ids > 0).sum() > 5000


def test_the_same_pose_gives_the_same_bytes(view: tuple[Scene, tuple[Placement, ...], Pose, RenderedView]) -> None:
    scene, _, pose, frame = view
    again = EmbreeBackend().open(scene, CAMERA).render(pose)
    assert np.array_equal(again.rgb, frame.rgb)
    assert np.array_equal(again.depth, frame.depth)
    assert np.array_equal(again.instance_ids, frame.instance_ids)
