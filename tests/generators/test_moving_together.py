"""Several objects of part_3 that move at once: their paths, what siblings share, and what is written about them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from shapely.geometry import Polygon

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.exports.samples import frame_facts
from avs3d_bench.exports.seld.events import TurningHead, events_of
from avs3d_bench.inspector.facts import read_facts
from avs3d_bench.inspector.floor_map import FloorMap
from avs3d_bench.inspector.view3d_data import read_scene
from avs3d_bench.validate import validate
from generators.cli import generate
from generators.manifest.reading import read_manifest
from generators.options import GenerateOptions
from generators.paths.motion import FLOOR_SPEED, RATE, Motion, movable, plan_motions
from generators.paths.tours import OBJECT_DISTANCE, distances
from generators.placement.placement import Placement, place
from generators.placement.site import Site
from generators.plan import make_plans
from tests.support.homes import write_manifest
from tests.support.rooms import box_model, kitchen, living_room
from tests.support.tiny import clone, edit_record

SECONDS = 30


@cache
def together(room: str, category: str) -> tuple[tuple[Placement, ...], tuple[Motion, ...]]:
    """Two objects of a category that move, and one more that stands."""
    site = Site.of({"kitchen": kitchen, "living_room": living_room}[room]().scene, room)
    placed = place(site, [movable(box_model(category))] * 3, rng=np.random.default_rng(1))
    return placed, plan_motions(site, placed, [0, 2], seconds=SECONDS, rng=np.random.default_rng(2))


@pytest.mark.parametrize(("room", "category"), [("living_room", "vacuum_cleaner"), ("kitchen", "coffee_machine")])
def test_what_moves_at_once_touches_nothing_at_any_time(room: str, category: str) -> None:
    placed, motions = together(room, category)
    assert [motion.index for motion in motions] == [0, 2]
    assert all(motion.length > 0.3 for motion in motions)
    for second in np.arange(0, SECONDS, 1 / RATE):
        outlines = [Polygon(motion.outline(float(second))) for motion in motions]
        outlines.append(Polygon(placed[1].box.footprint))
        assert min(one.distance(other) for one, other in combinations(outlines, 2)) > 0.02


def test_one_waits_for_the_other_and_is_never_faster_for_it() -> None:
    _, motions = together("living_room", "vacuum_cleaner")
    steps = [np.linalg.norm(np.diff(motion.positions, axis=0), axis=1) * RATE for motion in motions]
    assert max(step.max() for step in steps) <= FLOOR_SPEED[1] + 1e-6


# --- a generated group -----------------------------------------------------------------------------------------------

FIRST = "part_3/box/kitchen/1"
TWO, ONE = (f"part_3/box/kitchen/{number}" for number in (1, 2))
ENTRIES: list[dict[str, Any]] = [
    {"part": "part_3", "scan": "box", "room": "kitchen", "index": 1,
     "instances": {"vacuum_cleaner": 2, "coffee_machine": 1}, "moving": ["vacuum_cleaner", "coffee_machine"],
     "sources": [{"category": "vacuum_cleaner", "instance": 1}, {"category": "coffee_machine"}]},
    {"like": FIRST, "index": 2, "sources": [{"category": "vacuum_cleaner", "instance": 2}]},
]  # fmt: skip


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("manifest")
    return write_manifest(folder, camera={"size": 64, "frames": 6}, observations=ENTRIES)


@pytest.fixture(scope="module")
def root(manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("dataset") / "together"
    extras = ["--with", "stems", "--with", "depth", "--with", "rirs"]
    done = CliRunner().invoke(
        generate, [str(manifest), "-o", str(root), "--workers", "1", "--audio", "analytic", *extras]
    )
    assert done.exit_code == 0, done.output
    return root


def opened(root: Path, key: str) -> tuple[Observation, ObservationRecord]:
    observation = Dataset(root)[key]
    assert observation.record is not None
    return observation, observation.record


def errors(root: Path) -> list[str]:
    return [str(p) for p in validate(root, deep=True).problems if p.severity == "error"]


@pytest.mark.slow
def test_the_tree_is_valid_to_the_last_file(root: Path) -> None:
    assert errors(root) == []


@pytest.mark.slow
def test_siblings_share_the_motion_and_what_is_silent_moves_too(root: Path) -> None:
    _, two = opened(root, TWO)
    _, one = opened(root, ONE)
    assert [frame.moved for frame in two.frames] == [frame.moved for frame in one.frames]
    assert len(two.moving_instances) == 3
    assert len(one.sounding_instances) == 1
    for number in two.moving_instances:
        ways = [two.pose_at(frame, number).position for frame in two.frames]
        assert np.linalg.norm(np.diff(ways, axis=0), axis=1).max() > 0.01, number


def test_the_motion_does_not_depend_on_the_sources(tmp_path: Path) -> None:
    """Two manifests that differ in what sounds alone: the pictures have one digest, and so one motion."""
    digests = set()
    for number, sources in enumerate(([], [{"category": "coffee_machine"}], ENTRIES[0]["sources"])):
        (tmp_path / str(number)).mkdir()
        path = write_manifest(tmp_path / str(number), observations=[ENTRIES[0] | {"sources": sources}])
        (plan,) = make_plans(read_manifest(path), GenerateOptions(audio="analytic"))
        digests.add(plan.pictures_digest)
    assert len(digests) == 1


@pytest.mark.slow
def test_masks_and_depth_are_where_each_object_is_then(root: Path) -> None:
    """Each pixel of an object, lifted by its depth, is on the object's mesh where the record says it is."""
    observation, record = opened(root, TWO)
    mesh, seen = observation.mesh(), set()
    assert mesh.instances is not None
    for frame, entry in zip(observation.frames, record.frames, strict=True):
        for number in record.audible_instances(entry):
            shown = frame.mask() & (frame.instance_ids() == number)
            rows, columns = np.nonzero(shown)
            if not len(rows):
                continue
            centres = np.stack([columns, rows], axis=1) + 0.5
            world = observation.intrinsics.unproject(frame.pose, centres, frame.depth()[shown].astype(float))
            vertices = frame.mesh().vertices[mesh.instances == number]
            assert (world > vertices.min(axis=0) - 0.005).all()
            assert (world < vertices.max(axis=0) + 0.005).all()
            seen.add(number)
    assert seen


@pytest.mark.slow
def test_labels_follow_two_sources_that_move_at_once(root: Path) -> None:
    _, record = opened(root, TWO)
    events = events_of(record, record.class_ids, TurningHead.of(record.frames, turns=False))
    by_source = {number: [event for event in events if event.source == number] for number in (0, 1)}
    assert {event.frame for event in by_source[0]} & {event.frame for event in by_source[1]}
    for number, source in enumerate(record.sound_sources):
        offset = np.subtract(source.position, record.instance(source.instance or 0).position)
        for event in by_source[number][5::10]:
            second = event.frame // 10
            ends = [record.pose_at(record.frames[k], source.instance or 0) for k in (second, second + 1)]
            start = record.instance(source.instance or 0)
            turn = [(end.rotation_matrix @ _matrix(start.rotation).T) @ offset + end.position for end in ends]
            share = (event.frame % 10 + 0.5) / 10
            x, _, z = record.frames[second].pose.to_camera(turn[0] + share * (turn[1] - turn[0]))
            assert event.azimuth == pytest.approx(np.degrees(np.arctan2(-x, -z)), abs=1e-6)


def _matrix(rotation: tuple[float, float, float, float]) -> np.ndarray:
    from avs3d_bench.geometry import Pose

    return Pose((0.0, 0.0, 0.0), rotation).rotation_matrix


@pytest.mark.slow
def test_the_agent_keeps_its_distance_from_all_of_them(manifest: Path) -> None:
    from generators.homes.store import open_home
    from generators.observation.arrangement import arrange

    (plan, _) = make_plans(read_manifest(manifest), GenerateOptions(audio="analytic"))
    home = open_home(plan, manifest.parent / "cache").for_room("kitchen")
    found = arrange(plan, home)
    ground = np.array([pose.position for pose in found.poses])[:, [0, 2]]
    assert distances(ground, found.motions).shape[0] == 3
    assert distances(ground, found.motions).min() >= OBJECT_DISTANCE


@pytest.mark.slow
def test_exports_and_viewers_have_the_places_of_each_moment(root: Path) -> None:
    observation, record = opened(root, TWO)
    facts = frame_facts(observation.frames[4])
    entry = record.frames[4]
    assert [one["position"] for one in facts["sources"]] == [
        pytest.approx(record.source_at(entry, source)) for source in record.sound_sources
    ]
    assert [one["position"] for one in facts["instances"]] == [
        pytest.approx(record.pose_at(entry, one.id).position) for one in record.instances
    ]
    scene = read_scene(observation)
    assert scene.moving == record.moving_instances
    assert scene.mesh is not None
    for number in {one.id for one in record.sounding_instances}:
        moved = scene.frames[4].moved[number]
        own = scene.mesh.instances == number
        shown = scene.mesh.vertices[own] @ moved.rotation_matrix.T + np.array(moved.position)
        assert shown == pytest.approx(observation.frames[4].mesh().vertices[own], abs=1e-5)
    drawing = FloorMap.of(read_facts(Dataset(root), observation))
    assert drawing is not None
    assert len([shape for shape in drawing.ground() if shape.kind == "way"]) == 2
    assert drawing.sources(4)[0].at == pytest.approx(drawing.place(record.source_at(entry, record.sound_sources[0])))


def _shift(data: dict[str, Any]) -> None:
    for frame in data["frames"][2:]:
        frame["moved"][0]["position"][0] += 0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_shift, "lie outside the projected sounding object"),
        (lambda d: d["frames"][2]["moved"].pop(), "moved names"),
        (lambda d: d["frames"][4]["moved"][1].update(position=[0.0, 9.0, 0.0]), "was one frame before"),
        (lambda d: [f.pop("moved") for f in d["frames"]], "lie outside the projected sounding object"),
    ],
)
def test_a_record_that_does_not_fit_the_motion_is_named(
    root: Path, tmp_path: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    copy = clone(root, tmp_path / "copy")
    edit_record(copy, TWO, change)
    found = errors(copy)
    assert any(words in line for line in found), found


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"moving": ["toilet"]}, "moving: no toilet stands in this kitchen"),
        ({"moving": ["vacuum_cleaner", "vacuum_cleaner"]}, "vacuum_cleaner is listed twice"),
        ({"twins": "alike"}, "moving and twins: alike exclude each other"),
        ({"source_motion": "path"}, "in part_3 name the categories that move"),
    ],
)
def test_what_cannot_move_is_one_line(tmp_path: Path, entry: dict[str, Any], words: str) -> None:
    path = write_manifest(tmp_path, observations=[ENTRIES[0] | entry])
    with pytest.raises(UsageError, match=words):
        read_manifest(path)


def test_a_part_with_one_source_has_its_own_option(tmp_path: Path) -> None:
    entry = {"part": "part_1", "scan": "box", "room": "kitchen", "index": 1, "category": "clock", "moving": ["clock"]}
    with pytest.raises(UsageError, match="moving does not belong to part_1"):
        read_manifest(write_manifest(tmp_path, observations=[entry]))
