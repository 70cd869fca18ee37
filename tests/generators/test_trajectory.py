"""The walk: hard rules on every pose, checked on the room's exact solids; soft rules on rays through pixels."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from shapely import distance as plan_distance
from shapely import points as plan_points
from shapely.geometry import LineString, Polygon

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from generators.assets.shapes import MeshBuilder
from generators.core.rays import RayCaster
from generators.core.scene import Part, Room, Scene
from generators.paths.gaze import Sight, Views
from generators.paths.tours import level_difference
from generators.paths.trajectory import Walk, WalkTask, plan_walk
from generators.paths.watcher import line_of_sight, outer_samples
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from tests.support.rooms import PLAIN, Toy, bathroom, box_model, kitchen, living_room

ROOMS = {"kitchen": kitchen, "bathroom": bathroom, "living_room": living_room}
CASES = [
    ("kitchen", "microwave", 2),
    ("kitchen", "washing_machine", 1),
    ("bathroom", "toilet", 1),
    ("bathroom", "washing_machine", 2),
    ("living_room", "clock", 3),
    ("living_room", "telephone", 2),
    ("living_room", "vacuum_cleaner", 1),
]
RAYS = 48


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@cache
def walked(room: str, category: str, count: int, frames: int) -> tuple[Toy, tuple[Placement, ...], Walk]:
    toy = ROOMS[room]()
    placed = place(Site.of(toy.scene, room), [box_model(category)] * count, rng=rng(1))
    return toy, placed, plan_walk(WalkTask(Site.of(toy.scene, room), placed, frames=frames), rng(2))


def mask_sizes(toy: Toy, placed: tuple[Placement, ...], poses: tuple[Pose, ...]) -> NDArray[np.float64]:
    """(poses, objects) share of a small image's pixels that show each object."""
    caster = RayCaster(toy.scene.with_parts(tuple(p.part(k + 1) for k, p in enumerate(placed))))
    first = len(toy.scene.parts)
    camera = Intrinsics.from_fov(RAYS)
    u, v = np.meshgrid(np.arange(RAYS) + 0.5, np.arange(RAYS) + 0.5)
    x, y = (u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy
    rays = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    shares = []
    for pose in poses:
        _, face = caster.closest(np.asarray(pose.position), rays @ pose.rotation_matrix.T)
        counts = np.bincount(caster.face_part[face[face >= 0]], minlength=first + len(placed))
        shares.append(counts[first:] / len(rays))
    return np.array(shares)


@pytest.mark.slow
@pytest.mark.parametrize("frames", [2, 16, 120])
@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_hard_rules(room: str, category: str, count: int, frames: int) -> None:
    toy, placed, result = walked(room, category, count, frames)
    poses = result.poses
    assert len(poses) == frames
    positions = np.array([pose.position for pose in poses])
    # At the sensor's height, inside the room, 0.2 m from everything solid on the way, 0.35 m from the objects.
    np.testing.assert_allclose(positions[:, 1], 1.5, atol=1e-9)
    ground = positions[:, [0, 2]]
    assert ((ground > 0) & (ground < (toy.size[0], toy.size[2]))).all()
    assert plan_distance(toy.ground(), plan_points(ground)).min() >= 0.20
    for placement in placed:
        assert plan_distance(Polygon(placement.box.footprint), plan_points(ground)).min() >= 0.35
    # Between two poses too (a chord may cut a corner by a few centimetres).
    for one, other in pairwise(ground):
        assert toy.ground().distance(LineString([one, other])) >= 0.15
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() <= 0.5
    assert steps.min() > 0.0
    turns = [Rotation.from_quat(np.roll(pose.rotation, -1)) for pose in poses]
    angles = [math.degrees((a.inv() * b).magnitude()) for a, b in pairwise(turns)]
    assert max(angles) <= 30.0
    assert len({(pose.position, pose.rotation) for pose in poses}) == frames


@pytest.mark.slow
@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_level_cameras_with_a_mild_tilt(room: str, category: str, count: int) -> None:
    _, _, result = walked(room, category, count, 120)
    matrices = np.array([pose.rotation_matrix for pose in result.poses])
    np.testing.assert_allclose(matrices[:, 1, 0], 0.0, atol=1e-9)  # no roll: the right axis is level
    pitch = np.degrees(np.arcsin(-matrices[:, 1, 2]))
    assert np.abs(pitch).max() <= 25.0 + 1e-6
    assert np.abs(np.diff(pitch)).max() <= 15.0


@pytest.mark.parametrize("frames", [16, 120])
@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_both_sides_of_every_candidate_are_passed(room: str, category: str, count: int, frames: int) -> None:
    _, placed, result = walked(room, category, count, frames)
    for placement, report in zip(placed, result.report.candidates, strict=True):
        azimuth = np.array([direction_to(pose, placement.source_position).azimuth for pose in result.poses])
        assert (azimuth >= 20).mean() >= 0.20
        assert (azimuth <= -20).mean() >= 0.20
        assert report.right_share == pytest.approx((azimuth >= 20).mean())
        assert report.left_share == pytest.approx((azimuth <= -20).mean())


@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_every_candidate_is_looked_at_and_looked_away_from(room: str, category: str, count: int) -> None:
    toy, placed, result = walked(room, category, count, 120)
    masks = mask_sizes(toy, placed, result.poses)
    camera = Intrinsics.from_fov(1008)
    for index, (placement, report) in enumerate(zip(placed, result.report.candidates, strict=True)):
        shown = masks[:, index] > 0
        inside = []
        for pose in result.poses:
            pixel, depth = camera.project(pose, placement.box.centre[None])
            inside.append(bool(depth[0] > 0 and (pixel >= 0).all() and (pixel <= 1008).all()))
        assert 0.20 <= shown.mean() <= 0.70
        assert report.view_share == pytest.approx(shown.mean(), abs=0.08)
        assert report.look_share == pytest.approx((shown & np.array(inside)).mean(), abs=0.08)
        assert 3 <= shown[::8].sum() <= 12
    assert result.report.notes == ()


@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_views_differ_for_a_reconstruction(room: str, category: str, count: int) -> None:
    _, placed, result = walked(room, category, count, 120)
    positions = np.array([pose.position for pose in result.poses])[:, [0, 2]]
    # Parallax: in any second of ten frames the agent gets somewhere; over the walk objects are seen from all round.
    for first in range(0, 110, 10):
        assert np.ptp(positions[first : first + 11], axis=0).max() >= 0.15
    for placement in placed:
        offset = positions - np.asarray(placement.source_position)[[0, 2]]
        bearings = np.sort(np.degrees(np.arctan2(*offset.T)) % 360)
        widest_gap = np.diff(np.append(bearings, bearings[0] + 360)).max()
        assert 360 - widest_gap >= 45
        distance = np.linalg.norm(offset, axis=1)
        assert ((distance >= 0.5) & (distance <= 3.2)).mean() >= (0.9 if count == 1 else 0.3)
    headings = np.array([-pose.rotation_matrix[[0, 2], 2] for pose in result.poses])
    sectors = np.unique(np.floor(np.degrees(np.arctan2(*headings.T)) % 360 / 45))
    assert len(sectors) >= 6


@pytest.mark.slow
def test_a_walk_that_is_planned_for_one_shows_it_more_than_its_twins() -> None:
    """What the walk must not be: the twin it is planned for is the one in view most often."""
    toy, placed, fair = walked("living_room", "clock", 3, 120)
    for index in range(3):
        biased = plan_walk(WalkTask(Site.of(toy.scene, "living_room"), placed, frames=120, watched=[index]), rng(2))
        shares = [c.look_share for c in biased.report.candidates]
        assert int(np.argmax(shares)) == index
        assert shares[index] > min(c.look_share for c in fair.report.candidates)


@pytest.mark.slow
def test_the_same_generator_gives_the_same_walk_and_another_gives_another() -> None:
    toy, placed, result = walked("kitchen", "microwave", 2, 120)
    again = plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placed, frames=120), rng(2))
    assert again.poses == result.poses
    assert plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placed, frames=120), rng(3)).poses != result.poses


def test_the_course_of_the_level_of_two_sources_differs_as_their_distances_do() -> None:
    eyes = np.array([[0.0, 1.5, 0.0], [0.0, 1.5, 3.0]])
    beside = np.array([[-1.0, 1.5, 1.0], [1.0, 1.5, 1.0]])
    assert level_difference(eyes, beside) == pytest.approx(0.0, abs=1e-9)
    # From 1 m and 4 m, and from 4 m and 1 m: the levels fall and rise by 20·log10(4) dB around their means.
    behind = np.array([[0.0, 1.5, -1.0], [0.0, 1.5, 4.0]])
    assert level_difference(eyes, behind) == pytest.approx(20 * math.log10(4))
    # A third source does not make the others more alike.
    assert level_difference(eyes, np.concatenate([behind, beside])) == pytest.approx(20 * math.log10(4))


@pytest.mark.slow
def test_a_walk_past_twins_that_are_alike_keeps_their_distances_alike() -> None:
    toy, placed, _ = walked("living_room", "clock", 2, 24)
    site, sources = Site.of(toy.scene, "living_room"), np.array([p.source_position for p in placed])
    found = {
        alike: [
            level_difference(np.array([pose.position for pose in walk.poses]), sources)
            for seed in range(2)
            for walk in [plan_walk(WalkTask(site, placed, frames=24, alike=alike), rng(seed))]
        ]
        for alike in ((), ((0, 1),))
    }
    assert np.mean(found[(0, 1),]) < 0.6 * np.mean(found[()])


def test_notes_tell_what_could_not_be_had() -> None:
    toy = Toy("kitchen", (4.0, 2.6, 4.0)).shell().table("worktop", (0, 0, 0), (1.3, 0.9, 0.6), (0, 0, 1))
    placed = place(Site.of(toy.scene, "kitchen"), [box_model("microwave")] * 2, rng=rng())
    walk = plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placed, frames=2), rng())
    notes = walk.notes
    assert len(walk.poses) == 2
    assert notes[0] == "2 × microwave stand 0.7 m apart: no room for 1.0 m"
    # Two frames cannot have an object on both sides 20° off and turn by at most 30° between them.
    assert any("clearly on the" in note for note in notes[1:])
    # Notes are about all objects alike: nothing that a note names is one of several.
    assert all(note.startswith("every object is ") for note in notes[1:])


def test_one_frame_is_a_walk_too() -> None:
    toy, placed, _ = walked("kitchen", "microwave", 2, 120)
    poses = plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placed, frames=1), rng()).poses
    assert len(poses) == 1


def test_a_room_too_small_to_walk_in() -> None:
    toy, placed, _ = walked("kitchen", "washing_machine", 1, 2)
    tiny = Toy("kitchen", (0.5, 2.5, 0.5)).shell()
    with pytest.raises(Avs3dError, match=r"toy/kitchen: no room to walk: 0\.0\d m² of free floor"):
        plan_walk(WalkTask(Site.of(tiny.scene, "kitchen"), placed, frames=16), rng())
    with pytest.raises(Avs3dError, match="0 objects and 16 frames"):
        plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), (), frames=16), rng())
    with pytest.raises(Avs3dError, match="1 objects and 0 frames"):
        plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), placed, frames=0), rng())


def test_a_corridor_is_walked_within_the_step_limit() -> None:
    """0.9 m wide: half a metre of free floor to walk on, for 120 and for 16 frames."""
    toy = Toy("kitchen", (0.9, 2.5, 4.0)).shell()
    (placement,) = place(Site.of(toy.scene, "kitchen"), [box_model("clock", size=(0.2, 0.2, 0.04))], rng=rng(3))
    for frames in (16, 120):
        result = plan_walk(WalkTask(Site.of(toy.scene, "kitchen"), (placement,), frames=frames), rng())
        ground = np.array([pose.position for pose in result.poses])[:, [0, 2]]
        assert plan_distance(toy.ground(), plan_points(ground)).min() >= 0.20


# Lines of sight.


def between() -> tuple[Scene, Placement]:
    """A telephone on a table, a screen 1 m before it from 0.9 to 1.1 m of height."""
    toy = Toy("kitchen", (4.0, 2.6, 4.0)).shell().table("side_table", (1.7, 0, 0), (2.3, 0.5, 0.5), (0, 0, 1))
    (placement,) = place(Site.of(toy.scene, "kitchen"), [box_model("telephone")], rng=rng())
    builder = MeshBuilder().box((0.6, 0.2, 0.02), (2.0, 1.0, 1.5), PLAIN)
    return toy.scene.with_parts((Part("screen", builder.build()), placement.part(1))), placement


def test_line_of_sight_is_blocked_by_others_but_not_by_the_object_itself() -> None:
    scene, placement = between()
    caster = RayCaster(scene)
    source = np.asarray(placement.source_position)

    def seen(x: float, y: float, z: float) -> bool:
        return line_of_sight(caster, Pose.from_yaw((x, y, z), 0.0), placement)

    assert seen(2.0, 1.5, 0.9)  # nearer than the screen, looking down
    # On the straight line from the source through the middle of the screen and beyond.
    away = source + (np.array([2.0, 1.0, 1.5]) - source) * 1.6
    assert not seen(*away)
    assert seen(away[0] + 1.2, away[1], away[2])
    # From behind, only the telephone's own body is in the way.
    assert seen(source[0], source[1] + 0.4, 0.01)
    assert seen(*(source + (0, 0, 0.01)))


def test_a_screen_hides_what_is_behind_it() -> None:
    builder = MeshBuilder().box((1.0, 2.0, 0.02), (0.5, 1.0, 1.0), PLAIN)
    caster = RayCaster(Scene("toy", (Part("screen", builder.build()),), (Room("r", (0, 0, 0), (1, 1, 1)),), ()))
    line = np.stack([np.linspace(-1, 1, 200), np.full(200, 1.0), np.zeros(200)], axis=1)
    # From z = 2, the screen's edge at x = 0 throws its shadow on x > 0.
    start = np.broadcast_to((0.0, 1.0, 2.0), line.shape)
    assert caster.occluded(start, line - start, 0.999).mean() == pytest.approx(0.5, abs=0.01)


def test_samples_lie_outside_and_never_on_inner_surfaces() -> None:
    builder = MeshBuilder().box((1, 1, 1), (0, 0.5, 0), PLAIN).box((0.4, 0.4, 0.4), (0, 0.5, 0), PLAIN)
    points = outer_samples(builder.build(), 64)
    assert len(points) == 64
    reach = np.abs(points - (0, 0.5, 0)).max(axis=1)
    np.testing.assert_allclose(reach, 0.51, atol=1e-6)
    # All six sides have some.
    axis = np.argmax(np.abs(points - (0, 0.5, 0)), axis=1)
    sign = np.sign((points - (0, 0.5, 0))[np.arange(64), axis])
    assert set(zip(axis.tolist(), sign.tolist(), strict=True)) == set(product(range(3), (-1.0, 1.0)))


coordinate = st.floats(-3, 3)


@settings(max_examples=100)
@given(
    st.tuples(coordinate, coordinate, coordinate), st.tuples(coordinate, coordinate, coordinate),
    st.floats(-7, 7), st.floats(-0.5, 0.5), st.sampled_from([60.0, 90.0, 110.0]),
)  # fmt: skip
def test_planned_views_agree_with_the_camera(
    eye: tuple[float, ...], point: tuple[float, ...], yaw: float, pitch: float, hfov: float
) -> None:
    target = np.asarray(point)
    extent = math.tan(math.radians(hfov) / 2)
    sight = Sight(np.array([eye]), target, target, target[None], np.ones((1, 1), dtype=bool), extent)
    angles = np.array([[yaw]]), np.array([[pitch]])
    pose, camera = Pose.from_yaw(eye, yaw, pitch), Intrinsics.from_fov(1000, hfov)
    pixel, depth = camera.project(pose, target[None])
    margin = np.abs(pixel - 500).max() - 500 if depth[0] > 0.05 else np.inf
    if abs(margin) > 1e-3 and abs(depth[0] - 0.05) > 1e-6:
        assert bool(sight.in_image(target[None], *angles)[0, 0, 0]) is bool(margin < 0)
    if np.linalg.norm(target - eye) > 0.01:
        found = float(Views.of(sight, *angles).azimuth[0, 0])
        expected = direction_to(pose, point)
        if abs(expected.elevation) < 89:
            assert (found - expected.azimuth + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-6)
