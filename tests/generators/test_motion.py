"""Sounding objects that move: the path, the agent that keeps its distance, the sound, and what is written about it."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from shapely.geometry import Polygon

from avs3d_bench.contract.schema import FrameRecord, ObservationRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats import media
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.inspector.contact_sheet import draw_contact_sheet
from avs3d_bench.validate import validate
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.sightings import Sightings
from avs3d_bench.validation.solid import Boxes
from evaluators.protocols import strict as protocols
from evaluators.score import evaluate
from generators.acoustics.analytic import AnalyticBackend
from generators.acoustics.clips import binaural_clip, delayed, moving_clip
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.cli import generate
from generators.core.scene import Texture
from generators.paths.motion import FLOOR_SPEED, RATE, TOP_SPEED, TURN_RATE, Motion, movable, plan_motions
from generators.paths.pacing import pace
from generators.paths.tours import OBJECT_DISTANCE, distances
from generators.paths.trajectory import MOST_STEP, MOST_TURN, WalkTask, plan_walk
from generators.placement.fitting import SKIN
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from generators.vision.textures_pool import build_pool, mip_chain
from tests.support import tiny
from tests.support.acoustic_rooms import box_scene
from tests.support.homes import tree_digest, write_manifest
from tests.support.rooms import Toy, box_model, kitchen, living_room

SECONDS = 60
RATE_HZ = 44_100


@cache
def moved(room: str, category: str, count: int = 1) -> tuple[Toy, tuple[Placement, ...], Motion]:
    toy = {"kitchen": kitchen, "living_room": living_room}[room]()
    model = movable(box_model(category))
    placed = place(Site.of(toy.scene, room), [model] * count, rng=np.random.default_rng(1))
    (motion,) = plan_motions(Site.of(toy.scene, room), placed, [0], seconds=SECONDS, rng=np.random.default_rng(2))
    return toy, placed, motion


CASES = [("living_room", "vacuum_cleaner", 1), ("living_room", "vacuum_cleaner", 2), ("kitchen", "coffee_machine", 2)]


@pytest.mark.parametrize(("room", "category", "count"), CASES)
def test_a_path_is_slow_continuous_and_touches_nothing(room: str, category: str, count: int) -> None:
    toy, placed, motion = moved(room, category, count)
    step = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
    fastest = FLOOR_SPEED[1] if category == "vacuum_cleaner" else TOP_SPEED[1]
    assert step.max() * RATE <= fastest + 1e-6
    assert np.degrees(np.abs(np.diff(motion.yaws))).max() * RATE <= TURN_RATE + 1e-6
    assert motion.length > 1.0
    assert len(motion.seconds) == SECONDS + 1
    box = motion.start.box
    bottom, top = box.bounds[:, 1]
    solid = toy.ground(bottom + 0.01, top)
    others = [Polygon(p.box.footprint) for p in placed[1:]]
    for second in np.arange(0, SECONDS, 0.25):
        outline = Polygon(motion.outline(float(second)))
        assert outline.buffer(-SKIN - 1e-4).intersection(solid).area < 1e-9
        assert all(outline.distance(other) > 0.02 for other in others)
        np.testing.assert_allclose(motion.outline(float(second)), motion.at(float(second)).box.footprint, atol=1e-6)


def test_over_the_floor_the_front_goes_first_and_the_bottom_stays_down() -> None:
    _, _, motion = moved("living_room", "vacuum_cleaner")
    bottoms = [motion.at(s).bounds[0, 1] for s in np.arange(0, SECONDS, 2.5)]
    assert max(bottoms) < 0.001
    assert min(bottoms) > 0
    way = np.diff(motion.positions, axis=0)[:, [0, 2]]
    moving = np.linalg.norm(way, axis=1) * RATE > 0.08
    front = np.stack([np.sin(motion.yaws), np.cos(motion.yaws)], axis=1)
    forward = (way * (front[1:] + front[:-1]) / 2).sum(axis=1) / np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    assert np.median(forward[moving]) > 0.98
    assert (forward[moving] > 0.5).mean() > 0.97


def test_on_a_worktop_it_slides_to_and_fro_without_turning() -> None:
    toy, _, motion = moved("kitchen", "coffee_machine", 2)
    assert np.ptp(motion.yaws) == 0
    assert np.ptp(motion.positions[:, 1]) == 0
    top = toy.tops(float(motion.start.bounds[0, 1]) - 0.0002)
    for second in range(SECONDS):
        assert Polygon(motion.outline(second)).within(top.buffer(0.006))
    along = motion.positions[:, 0] - motion.positions[0, 0]
    assert np.ptp(along) > 0.12
    # Smooth at its turning points too: no step of speed beyond a pendulum's.
    assert np.abs(np.diff(along, n=2)).max() * RATE**2 < 0.1


def test_a_path_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    toy, placed, motion = moved("living_room", "vacuum_cleaner")
    site = Site.of(toy.scene, "living_room")
    (again,) = plan_motions(site, placed, [0], seconds=SECONDS, rng=np.random.default_rng(2))
    assert (again.positions == motion.positions).all()
    assert (again.yaws == motion.yaws).all()
    (other,) = plan_motions(site, placed, [0], seconds=SECONDS, rng=np.random.default_rng(3))
    assert not (other.positions == motion.positions).all()


def test_what_hangs_on_a_wall_is_refused_and_what_may_stand_is_stood() -> None:
    toy = living_room()
    hung = place(Site.of(toy.scene, "living_room"), [box_model("clock", "wall")], rng=np.random.default_rng(1))
    with pytest.raises(Avs3dError, match=r"clock .* hangs on the wall: choose another"):
        plan_motions(Site.of(toy.scene, "living_room"), hung, [0], seconds=5, rng=np.random.default_rng(0))
    assert movable(box_model("clock", "wall_or_surface")).mount == "surface"
    assert movable(box_model("clock", "wall")).mount == "wall"


def test_a_room_without_room_is_refused_in_one_line() -> None:
    toy = living_room()
    placed = place(Site.of(toy.scene, "living_room"), [box_model("vacuum_cleaner")], rng=np.random.default_rng(1))
    for x in np.arange(0.3, 5.0, 0.5):
        for z in np.arange(0.3, 4.5, 0.5):
            toy.add((x, 0, z), (x + 0.05, 1.0, z + 0.05))
    with pytest.raises(Avs3dError, match=r"no room for the vacuum_cleaner .* to move") as caught:
        plan_motions(Site.of(toy.scene, "living_room"), placed, [0], seconds=5, rng=np.random.default_rng(0))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(("room", "category", "count"), CASES[1:])
def test_the_agent_keeps_its_distance_at_every_time(room: str, category: str, count: int) -> None:
    toy, placed, motion = moved(room, category, count)
    poses = plan_walk(
        WalkTask(Site.of(toy.scene, room), placed, frames=SECONDS, motions=[motion]), np.random.default_rng(3)
    ).poses
    ground = np.array([pose.position for pose in poses])[:, [0, 2]]
    assert distances(ground, [motion]).min() >= OBJECT_DISTANCE
    for index, pose in enumerate(poses):
        x, _, z = pose.position
        body = Polygon(motion.seconds[index].box.footprint)
        assert body.distance(Polygon([(x, z), (x + 1e-6, z), (x, z + 1e-6)])) >= OBJECT_DISTANCE - 1e-6
    assert np.linalg.norm(np.diff(ground, axis=0), axis=1).max() <= MOST_STEP
    for a, b in pairwise(poses):
        cosine = (np.trace(a.rotation_matrix.T @ b.rotation_matrix) - 1) / 2
        assert math.degrees(math.acos(min(1.0, cosine))) <= MOST_TURN
    # The gaze follows the source: it is looked at, and heard from both sides.
    azimuth = [direction_to(p, motion.seconds[i].source_position).azimuth for i, p in enumerate(poses)]
    assert np.mean(np.abs(azimuth) < 45) > 0.35
    assert min(np.mean(np.array(azimuth) > 20), np.mean(np.array(azimuth) < -20)) > 0.1


def test_a_walk_waits_for_what_crosses_its_path() -> None:
    # Ten metres in steps of a centimetre, ten seconds; metres 2 to 3 are blocked in the first five of them.
    free = np.ones((21, 1001), dtype=bool)
    free[:11, 200:301] = False
    steps = pace(free, np.full(10, 0.5), 0.01, most=0.8, back=0.1)
    assert steps is not None
    halves = np.interp(np.arange(21) / 2, np.arange(11), steps)
    assert all(free[k, round(at)] for k, at in enumerate(halves) if k % 2 == 0)
    assert steps[-1] > 300
    free[:, 200:301] = False
    stuck = pace(free, np.full(10, 0.5), 0.01, most=0.8, back=0.1)
    assert stuck is not None
    assert stuck.max() < 200
    free[7] = False
    assert pace(free, np.full(10, 0.5), 0.01, most=0.8, back=0.1) is None


def test_a_source_that_stays_sounds_as_a_still_one() -> None:
    rng = np.random.default_rng(0)
    source, response = rng.normal(size=4 * RATE_HZ), rng.normal(size=(2, 9000))
    still = binaural_clip(source, response, 2)
    np.testing.assert_allclose(moving_clip(source, (response, response), (1.5, 1.5), 2), still, atol=1e-6)


def test_delays_that_change_are_those_of_a_sine() -> None:
    time = np.arange(4410) / RATE_HZ
    for frequency in (200.0, 3000.0, 12_000.0):
        delay = 3.7 + 20 * np.linspace(0, 1, 2000)
        found = delayed(np.sin(2 * np.pi * frequency * time), delay, 1500)
        truth = np.sin(2 * np.pi * frequency * (np.arange(1500, 3500) - delay) / RATE_HZ)
        np.testing.assert_allclose(found, truth, atol=2e-3)


def direct(distance: float) -> np.ndarray:
    """(2, n) of a point source in free space: 1/r, r/c late."""
    at = distance / SPEED_OF_SOUND * RATE_HZ
    lag = np.arange(int(at) + 40) - at
    return np.tile(np.sinc(lag) * np.where(np.abs(lag) < 30, np.cos(np.pi * lag / 60) ** 2, 0) / distance, (2, 1))


@pytest.mark.parametrize(("near", "far"), [(1.0, 1.2), (2.0, 1.8)])
def test_a_moving_source_in_free_space_is_not_coloured(near: float, far: float) -> None:
    """A plain cross-fade of two responses 0.6 ms apart would cancel 860 Hz in the middle of the second."""
    frequency = SPEED_OF_SOUND / (2 * abs(far - near))
    time = np.arange(4 * RATE_HZ) / RATE_HZ
    source = np.sin(2 * np.pi * frequency * time)
    clip = moving_clip(source, (direct(near), direct(far)), (near, far), 2, gain=1.0)
    heard = time[2 * RATE_HZ : 3 * RATE_HZ]
    left_at = heard - (near + (far - near) * (heard - 2)) / SPEED_OF_SOUND
    distance = near + (far - near) * (left_at - 2)
    late = slice(400, None)  # what left the source before the second began
    truth = np.sin(2 * np.pi * frequency * (heard - distance / SPEED_OF_SOUND)) / distance
    np.testing.assert_allclose(clip[0, late], truth[late], atol=0.02)


def test_there_is_no_click_between_the_seconds() -> None:
    """One listener who stands, a source that passes: the clips join as if they were one."""
    time = np.arange(6 * RATE_HZ) / RATE_HZ
    source = np.sin(2 * np.pi * 150 * time) + 0.5 * np.sin(2 * np.pi * 333 * time)
    session = AnalyticBackend(images=200).open(box_scene((5, 2.6, 4), label="plaster"), (1.0, 1.0, 1.0), room="kitchen")
    pose = Pose.from_yaw((3.0, 1.5, 2.5), 0.2)
    way = [(1.0 + 0.2 * k, 1.0, 1.0) for k in range(5)]
    responses = []
    for position in way:
        session.move_source(position)
        responses.append(session.impulse_response(pose))
    metres = [math.dist(position, pose.position) for position in way]
    clips = [
        moving_clip(source, responses[max(k - 1, 0) : k + 2], metres[max(k - 1, 0) : k + 2], k + 2, gain=1.0)
        for k in range(4)
    ]
    joined = np.concatenate(clips, axis=1)
    jump = np.abs(np.diff(joined, n=2))
    for seam in range(1, 4):
        at = seam * RATE_HZ
        assert (jump[:, at - 3 : at + 2].max(axis=1) <= 1.5 * jump[:, at - 4000 : at - 100].max(axis=1)).all()


def test_a_source_moved_in_an_open_session_sounds_as_one_opened_there() -> None:
    scene, pose = box_scene((5, 2.6, 4), label="plaster"), Pose.from_yaw((3.0, 1.5, 2.5), 0.2)
    session = AnalyticBackend(images=200).open(scene, (1.0, 1.0, 1.0), room="kitchen")
    session.impulse_response(pose)
    session.move_source((2.0, 0.8, 1.5))
    there = AnalyticBackend(images=200).open(scene, (2.0, 0.8, 1.5), room="kitchen")
    assert (session.impulse_response(pose) == there.impulse_response(pose)).all()
    with pytest.raises(Avs3dError, match="source position"):
        session.move_source((50.0, 0.0, 0.0))


def test_the_engine_hears_a_source_that_was_moved() -> None:
    pytest.importorskip("rlr_audio_propagation", reason="the acoustic engine (extra soundspaces) is not installed")
    from avs3d_bench.measures.levels import ild_db
    from generators.acoustics.clips import rms
    from generators.acoustics.soundspaces import RaySettings, SoundSpacesBackend

    few = RaySettings(reflections=10_000, min_rays=100, max_rays=100)
    scene, pose = box_scene((5, 2.6, 4), label="carpet"), Pose.from_yaw((2.5, 1.5, 2.0), 0.0)
    session = SoundSpacesBackend(few).open(scene, (1.0, 1.5, 2.0), room="kitchen")
    left = ild_db(*rms(session.impulse_response(pose)))
    session.move_source((4.0, 1.5, 2.0))
    right = ild_db(*rms(session.impulse_response(pose)))
    session.close()
    assert left < -3 < 3 < right
    with pytest.raises(Avs3dError, match="closed"):
        session.move_source((1.0, 1.0, 1.0))


def test_the_same_textures_make_one_pool() -> None:
    rng = np.random.default_rng(0)
    textures = [Texture(str(k), rng.integers(0, 255, (8, 8, 3), dtype=np.uint8)) for k in range(3)]
    pool = build_pool(textures[:2])
    assert build_pool(textures[:2]) is pool
    other = build_pool(textures[1:])
    assert other is not pool
    levels = mip_chain(textures[1].pixels) + mip_chain(textures[2].pixels)
    assert (other.texels == np.concatenate([level.reshape(-1) for level in levels])).all()


# --- a generated observation -----------------------------------------------------------------------------------------


def arguments(path: Path, root: Path, workers: int) -> list[str]:
    return [str(path), "-o", str(root), "--workers", str(workers), "--audio", "analytic", "--with", "depth"]


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    common = {"part": "part_1", "scan": "box", "room": "kitchen"}
    return write_manifest(
        tmp_path_factory.mktemp("manifest"),
        camera={"size": 64, "frames": 5},
        source_motion="path",
        observations=[
            common | {"index": 1, "category": "vacuum_cleaner", "variant": "canister"},
            common | {"index": 2, "category": "coffee_machine"},
        ],
    )


@pytest.fixture(scope="module")
def root(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("dataset") / "moving"
    done = CliRunner().invoke(generate, arguments(manifest, root, 1), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return root


def errors(root: Path) -> list[str]:
    return [str(p) for p in validate(root, deep=True).problems if p.severity == "error"]


def record_of(root: Path, index: int = 1) -> ObservationRecord:
    record = Dataset(root)[f"part_1/box/kitchen/{index}"].record
    assert record is not None
    return record


@pytest.mark.parametrize("moves", [False, True])
def test_points_inside_an_objects_bounds_need_not_be_on_it_where_something_moves(tmp_path: Path, moves: bool) -> None:
    root = tiny.write_dataset(tmp_path / "d", frames=4, size=32)
    observation = next(o for o in Dataset(root) if o.record and len(o.record.instances) > 1)
    if moves:
        tiny.edit_record(root, observation.key, start_moving)
    observation = Dataset(root)[observation.key]
    record = observation.record
    assert record is not None
    assert record.moves == moves
    silent = next(instance for instance in record.instances if not instance.sounding)
    count = 40  # points on the worktop, say, within what the bounds of the object that stands on it are widened by
    zeros = np.zeros(count, dtype=np.int64)
    sightings = Sightings(
        zeros, np.tile(np.mean(silent.bounds, axis=0), (count, 1)), np.zeros((count, 3), np.uint8), zeros, zeros,
        np.ones(count, dtype=bool),
    )  # fmt: skip
    boxes, findings = Boxes(record), Findings(observation)
    boxes.add(observation.frames[0], sightings, np.zeros((32, 32), dtype=np.uint16), findings)
    boxes.finish(findings)
    expected = f"of 40 sparse points within the bounds of instance {silent.id}, masks show it in 0: missing, or its"
    assert [p.message for p in findings.problems] == ([] if moves else [f"{expected} bounds are wrong"])


def start_moving(record: dict[str, Any]) -> None:
    """Let the sounding object of a tiny observation go to the right."""
    record["source_motion"] = "path"
    for index, frame in enumerate(record["frames"]):
        frame["source_position"] = [0.1 * index, 1.2, -2.2]
        frame["instance_position"], frame["instance_rotation"] = [0.1 * index, 1.0, -2.4], [1, 0, 0, 0]


@pytest.mark.slow
def test_what_moves_is_valid_to_the_last_file(root: Path) -> None:
    assert errors(root) == []


@pytest.mark.slow
@pytest.mark.parametrize("index", [1, 2])
def test_every_frame_says_where_the_source_is(root: Path, index: int) -> None:
    record = record_of(root, index)
    assert record.source_motion == "path"
    assert record.frames[0].source_position == record.source_position
    ways = []
    for frame in record.frames:
        found = direction_to(frame.pose, record.source_at(frame))
        assert frame.azimuth == pytest.approx(found.azimuth, abs=1e-3)
        assert frame.distance == pytest.approx(found.distance, abs=1e-5)
        ways.append(record.source_at(frame))
    assert np.linalg.norm(np.diff(ways, axis=0), axis=1).max() > 0.02


@pytest.mark.slow
def test_masks_follow_and_depth_agrees_with_the_mesh_where_it_is_then(root: Path) -> None:
    moved_away = 0
    for observation in Dataset(root):
        for frame in observation.frames:
            mask, depth = frame.mask(), frame.depth()
            if not mask.any():
                continue
            rows, columns = np.nonzero(mask)
            centres = np.stack([columns, rows], axis=1) + 0.5
            world = observation.intrinsics.unproject(frame.pose, centres, depth[mask].astype(float))
            vertices = frame.mesh().vertices
            low, high = vertices.min(axis=0) - 0.005, vertices.max(axis=0) + 0.005
            assert ((world > low) & (world < high)).all()
            start = observation.mesh().vertices
            outside = (world < start.min(axis=0) - 0.005) | (world > start.max(axis=0) + 0.005)
            moved_away += int(outside.any(axis=1).sum())
    assert moved_away > 50


@pytest.mark.slow
def test_no_point_of_the_model_is_on_what_moves(root: Path) -> None:
    for observation in Dataset(root):
        points = observation.colmap.points.positions
        assert len(points) > 200
        for frame in observation.frames:
            vertices = frame.mesh().vertices
            low, high = vertices.min(axis=0) + 0.01, vertices.max(axis=0) - 0.01
            assert not ((points > low) & (points < high)).all(axis=1).any()


@pytest.mark.slow
def test_two_workers_write_the_same_bytes(root: Path, manifest: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    done = CliRunner().invoke(generate, arguments(manifest, again, 2), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert tree_digest(again) == tree_digest(root)


def shift(data: dict, frames: slice, field: str, by: float) -> None:
    for frame in data["frames"][frames]:
        frame[field][0] += by


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: shift(d, slice(2, None), "source_position", 0.3), "off its place on the sounding instance"),
        (lambda d: shift(d, slice(2, None), "instance_position", 0.3), "lie outside the projected sounding object"),
        (lambda d: d.update(source_position=[9.0, 9.0, 9.0]), "expected the same"),
        (lambda d: d["frames"][3].pop("source_position"), "belong together"),
        (lambda d: d.pop("source_motion"), "source_motion is not"),
        (lambda d: [f.update(azimuth=-f["azimuth"]) for f in d["frames"]], "azimuth is"),
    ],
)
def test_a_record_that_does_not_fit_the_motion_is_named(root: Path, tmp_path: Path, change, words: str) -> None:
    copy = tiny.clone(root, tmp_path / "copy")
    tiny.edit_record(copy, "part_1/box/kitchen/1", change)
    assert any(words in line for line in errors(copy)), errors(copy)


@pytest.mark.slow
def test_a_model_with_points_on_what_moves_is_named(root: Path, tmp_path: Path) -> None:
    from avs3d_bench.validation.motion import moving_points

    observation = Dataset(root)["part_1/box/kitchen/1"]
    assert moving_points(observation, observation.colmap)[0] <= 2
    copy = tiny.clone(root, tmp_path / "copy")
    for name in ("frame_000.png", "frame_001.png"):
        path = copy / "part_1/box/kitchen/1/semantic_masks" / name
        everywhere = np.ones_like(media.read_png_mask(path))
        path.unlink()
        media.write_png_mask(path, everywhere)
    changed = Dataset(copy)["part_1/box/kitchen/1"]
    assert moving_points(changed, changed.colmap)[0] > 50


def test_a_still_observation_says_nothing_of_motion(tmp_path: Path) -> None:
    base = tiny.write_dataset(tmp_path / "tiny", frames=2)
    for path in base.rglob("observation.json"):
        text = path.read_text()
        assert not any(word in text for word in ("source_motion", "instance_position", "variant_of"))
    fields = FrameRecord.model_json_schema()["required"]
    assert not FrameRecord.left_out & set(fields)


@pytest.mark.slow
def test_points_of_something_that_moves_are_not_scored_and_it_is_said_why(root: Path, tmp_path: Path) -> None:
    dataset = Dataset(root)
    submission = tmp_path / "submission"
    said = {"method": "test", "dataset": dataset.name, "dataset_version": dataset.record.version}
    media.write_json(submission / "submission.json", said)
    for observation in dataset:
        for frame in observation.test:
            media.write_png_mask(submission / observation.key / "masks" / f"{frame.name}.png", frame.mask())
        media.write_ply_points(submission / observation.key / "points.ply", observation.mesh().vertices)
    scores = evaluate(submission, root).scores
    for observation in scores.observations:
        assert observation.official.mIoU == pytest.approx(1, abs=1e-6)
        assert observation.strict.IoU_3D is observation.strict.centroid_error is None
        assert observation.strict.unavailable["IoU_3D"] == protocols.MOVING
    assert scores.overall.strict.unavailable["centroid_error"] == protocols.MOVING


@pytest.mark.slow
def test_the_contact_sheet_draws_the_path_of_the_source(root: Path) -> None:
    figure = draw_contact_sheet(Dataset(root), "part_1/box/kitchen/1", columns=3)
    labels = {line.get_label(): line for axes in figure.axes for line in axes.lines}
    way = labels["way"]
    record = record_of(root)
    np.testing.assert_allclose(way.get_xdata(), [record.source_at(frame)[0] for frame in record.frames])
    legends = [axes.get_legend() for axes in figure.axes if axes.get_xlabel() == "x (m)"]
    assert {"path of the source", "source at the first frame"} <= {text.get_text() for text in legends[0].get_texts()}
