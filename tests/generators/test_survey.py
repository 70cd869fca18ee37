"""The survey of a scan: up, turn, unit and rooms of flats whose truth is known, and what it refuses."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError
from generators.assets.meshfile import load_mesh
from generators.assets.modelframe import upright
from generators.core.boxes import yaw_matrix
from generators.surveying.cloud import SurfaceCloud, main_part
from generators.surveying.frame import FRONT, find_scale, find_turn
from generators.surveying.survey import KnownFrame, RoomChoice, Survey, survey
from tests.support.made_rooms import ROOMS, flat, quad, shell, solid
from tests.support.tiers import some

Array = NDArray[np.float64]

#: Largest error of a box's side (m) and of the turn (degrees).
BOX, TURN = 0.10, 1.0


NOTHING = KnownFrame()


def look(triangles: Array, known: KnownFrame = NOTHING, *, gltf: bool = False) -> Survey:
    return survey("room.ply", triangles.astype(np.float32), known, gltf=gltf)


def errors(found: Survey, rotation: Array) -> dict[str, float]:
    """Room → the largest error of a side of its box; ``rotation``: from the truth to the file, in metres."""
    world = yaw_matrix(np.radians(found.turn)) @ upright(found.up, found.front) @ rotation
    # The walls may end up parallel to either axis: the rest of the turn is its error.
    heading = np.degrees(np.arctan2(world[0, 2], world[0, 0]))
    assert abs(heading - 90 * round(heading / 90)) <= TURN
    out = {}
    for name, number in found.rooms.items():
        corners = np.array(list(product(*zip(*ROOMS[name], strict=True)))) @ world.T
        box = found.boxes[number]
        out[name] = float(
            max(np.abs(corners.min(axis=0) - box.low).max(), np.abs(corners.max(axis=0) - box.high).max())
        )
    return out


@pytest.mark.parametrize("up", some(FRONT, every=3))
def test_the_axis_that_points_up_is_found(up: str) -> None:
    rotation = upright(up, FRONT[up]).T
    found = look(flat(rng=np.random.default_rng(1)) @ rotation.T)
    assert found.up == up
    assert max(errors(found, rotation).values()) <= BOX


@pytest.mark.parametrize(
    ("yaw", "unit", "ceiling"),
    some(
        [(-37.5, 0.3048, False), (23.0, 0.001, True), (0.0, 1.0, True), (44.0, 0.01, True), (8.0, 0.0254, False)],
        every=5,
    ),
)
def test_turn_unit_and_boxes_are_found(yaw: float, unit: float, ceiling: bool) -> None:
    rotation = yaw_matrix(np.radians(yaw))
    found = look(flat(ceiling=ceiling, rng=np.random.default_rng(2)) @ rotation.T / unit)
    assert found.scale == unit
    assert found.levels.has_ceiling == ceiling
    assert found.rooms == {"living_room": 0, "kitchen": 1, "bathroom": 2}
    assert len(found.boxes) == 3
    assert max(errors(found, rotation).values()) <= BOX


def test_the_winding_of_faces_does_not_matter_to_rooms() -> None:
    found = look(flat()[:, ::-1], gltf=True)
    assert max(errors(found, np.eye(3)).values()) <= BOX


@pytest.mark.slow
def test_junk_far_from_the_room_is_left_out() -> None:
    rng = np.random.default_rng(3)
    clumps = [centre + rng.normal(0, 0.05, (60, 3, 3)) for centre in ((2.0, 6.0, 2.0), (-4.0, -3.0, 9.0))]
    stray = np.array([[[300.0, 200.0, 10.0], [300.1, 200.0, 10.0], [300.0, 200.1, 10.0]]])
    found = look(np.concatenate([flat(), *clumps, stray]))
    assert any("floating pieces" in line for line in found.warnings)
    assert max(errors(found, np.eye(3)).values()) <= BOX
    assert not any("floating pieces" in line for line in look(flat()).warnings)


def test_a_stray_face_kilometres_away_changes_nothing() -> None:
    room = flat(("kitchen",))
    stray = np.array([[[3000.0, 0, 0], [3000.01, 0, 0], [3000, 0, 0.01]]])
    found = look(np.concatenate([room, stray]), KnownFrame(rooms=RoomChoice((("kitchen", 1),))))
    assert max(errors(found, np.eye(3)).values()) <= BOX


def test_pieces_are_told_apart_by_the_gap_between_them() -> None:
    near = SurfaceCloud.of(np.concatenate([solid(((0, 0, 0), (3, 2, 3))), solid(((3.02, 0, 0), (3.2, 0.2, 0.2)))]), 0.1)
    assert main_part(near).all()
    far = SurfaceCloud.of(np.concatenate([solid(((0, 0, 0), (3, 2, 3))), solid(((4.0, 0, 0), (4.2, 0.2, 0.2)))]), 0.1)
    assert (main_part(far) == (far.points[:, 0] < 3.5)).all()


def test_the_area_of_a_cloud_is_that_of_the_surface() -> None:
    triangles = quad((0, 0, 0), (3, 0, 0), (0, 2, 0), 10.0)
    cloud = SurfaceCloud.of(triangles, 0.07)
    assert cloud.area.sum() == pytest.approx(6.0)
    assert len(cloud.points) >= 6.0 / 0.07**2
    moved = cloud.moved(yaw_matrix(0.3), 2.0)
    assert moved.area.sum() == pytest.approx(24.0)
    assert find_turn(moved)[0] == pytest.approx(-np.degrees(0.3), abs=0.3)


@pytest.mark.parametrize(
    ("height", "unit"), [(2.5, 1.0), (2500.0, 0.001), (250.0, 0.01), (8.2, 0.3048), (98.4, 0.0254), (0.5, None)]
)
def test_the_unit_is_told_by_the_height_of_the_ceiling(height: float, unit: float | None) -> None:
    found = find_scale(height)
    assert (found[0] if found else None) == unit


@pytest.mark.slow
def test_rooms_can_be_chosen() -> None:
    triangles = flat()
    by_number = look(triangles, KnownFrame(rooms=RoomChoice((("kitchen", 1), ("bathroom", 3)))))
    assert by_number.rooms == {"kitchen": 0, "bathroom": 2}
    with pytest.raises(UsageError, match=r"--rooms kitchen=4: found 3 rooms by size: 1 \(20 m²\)"):
        look(triangles, KnownFrame(rooms=RoomChoice((("kitchen", 4),))))
    too_many = look(triangles, KnownFrame(rooms=RoomChoice(count=9)))
    assert any("--rooms 9: found" in line for line in too_many.warnings)


def test_a_wide_opening_joins_rooms_unless_their_number_is_given() -> None:
    """Above the opening there is no lintel, and it is wider than a door."""
    triangles = np.concatenate([shell(ROOMS["living_room"]), shell(ROOMS["kitchen"])])
    middle = triangles.mean(axis=1)
    opening = (np.abs(middle[:, 0] - 5.06) < 0.2) & (middle[:, 2] > 1.2) & (middle[:, 2] < 2.7)
    bridge = [
        quad((5.0, y, 1.2), u, v) for y, u, v in ((0.0, (0, 0, 1.5), (0.12, 0, 0)), (2.5, (0.12, 0, 0), (0, 0, 1.5)))
    ]
    triangles = np.concatenate([triangles[~opening], *bridge])
    assert len(look(triangles).boxes) == 1
    found = look(triangles, KnownFrame(rooms=RoomChoice(count=2)))
    assert max(errors(found, np.eye(3)).values()) <= BOX


def test_an_angular_room_becomes_its_largest_rectangle() -> None:
    """An L of 5 × 4 m without its corner of 2.5 × 2 m: the largest rectangle in it has 2.5 × 4 m."""
    corner = ((2.5, 0.0, 2.0), (5.0, 2.5, 4.0))
    triangles = shell(((0.0, 0.0, 0.0), (5.0, 2.5, 4.0)))
    middle = triangles.mean(axis=1)
    triangles = triangles[~((middle[:, 0] > 2.5) & (middle[:, 2] > 2.0))]
    walls = [quad((2.5, 0, 2.0), (0, 0, 2), (0, 2.5, 0)), quad((2.5, 0, 2.0), (0, 2.5, 0), (2.5, 0, 0))]
    found = look(np.concatenate([triangles, *walls]), gltf=True)
    assert [box.part for box in found.boxes] == [True]
    assert found.boxes[0].area == pytest.approx(10.0, abs=0.5)
    inside = np.mean(corner, axis=0)
    assert not ((inside > found.boxes[0].low) & (inside < found.boxes[0].high)).all()


def test_worktops_are_no_second_floor() -> None:
    worktops = [solid(((0, 0, 0), (0.9, 0.9, 4))), solid(((2.1, 0, 0), (3, 0.9, 4)))]
    found = look(np.concatenate([shell(((0, 0, 0), (3, 2.5, 4))), *worktops]), gltf=True)
    assert found.levels.storeys == 1
    assert found.boxes[0].area == pytest.approx(12.0, abs=0.5)


def test_a_beam_on_a_pillar_is_no_wall() -> None:
    beam = [solid(((2.9, 2.1, 0), (3.2, 2.5, 4))), solid(((2.95, 0, 1.9), (3.15, 2.1, 2.1)))]
    (box,) = look(np.concatenate([shell(((0, 0, 0), (5, 2.5, 4))), *beam]), gltf=True).boxes
    assert box.area == pytest.approx(20.0, abs=0.5)


def test_things_on_wardrobes_are_no_wall() -> None:
    """Boxes of unequal depth up to the ceiling, in a row along a wall."""
    room = ((0.0, 0.0, 0.0), (3.0, 2.5, 4.0))
    wardrobe = solid(((0.0, 0.0, 3.4), (3.0, 2.05, 4.0)))
    depths = (0.6, 0.4, 0.55, 0.3, 0.5, 0.58)
    boxes = [solid(((0.5 * k, 2.05, 3.98 - d), (0.5 * k + 0.45, 2.46, 3.98))) for k, d in enumerate(depths)]
    for triangles in (whole := np.concatenate([shell(room), wardrobe, *boxes]), whole[:, ::-1]):
        (box,) = look(triangles, gltf=True).boxes
        assert box.low == pytest.approx(room[0], abs=0.02)
        assert box.high == pytest.approx(room[1], abs=0.02)


def test_what_is_seen_through_a_door_is_no_room() -> None:
    rooms = flat(("living_room", "kitchen"))
    assert len(look(rooms, gltf=True).boxes) == 2
    middle = rooms.mean(axis=1)
    unseen = (middle[:, 0] > 5.3) & (middle[:, 1] < 2.0) & (middle[:, 2] > 1.8)
    (box,) = look(rooms[~unseen], gltf=True).boxes
    assert box.area == pytest.approx(20.0, abs=0.5)


def test_a_real_room_is_found_where_it_is() -> None:
    """A phone's scan (CC0); its box was measured by hand, with the closet on one side."""
    file = Path(__file__).parents[2] / ".." / "shared" / "scans" / "tatami_room.glb"
    if not file.is_file():
        pytest.skip(f"{file} is not there: the scan is not part of the project")
    mesh = load_mesh(file, twin="surface", max_acoustic_faces=10**7, textures=False)
    found = survey(file.name, mesh.positions, gltf=True)
    assert (found.up, found.turn, found.scale, found.rooms) == ("y", 0.0, 1.0, {"living_room": 0})
    (box,) = found.boxes
    low, high = (-1.38, -1.65, -2.0), (1.29, 0.95, 1.74)
    assert (np.asarray(box.low) > np.asarray(low) - 0.1).all()
    assert (np.asarray(box.high) < np.asarray(high) + 0.1).all()
    assert box.area > 7.5


CHAIR = np.concatenate([solid(((0, 0.4, 0), (0.5, 0.45, 0.5))), solid(((0, 0.45, 0), (0.5, 0.9, 0.05)))])
STOREYS = np.concatenate([shell(ROOMS["living_room"]), shell(ROOMS["living_room"]) + [0.0, 2.8, 0.0]])
TILTED = flat() @ np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]]).T


@pytest.mark.parametrize(
    ("triangles", "known", "line"),
    [
        (CHAIR, KnownFrame(), r"is it an object.*--scale"),
        (CHAIR, KnownFrame(scale=1.0), r"expected a floor of at least 2 m²"),
        (flat(("bathroom",)) * [0.3, 1.0, 0.3], KnownFrame(up="y"), r"expected a floor of at least 2 m²"),
        (flat() * 7.0, KnownFrame(), r"17\.5 units of the file.*--scale 0\.143 makes it 2\.5 m"),
        (STOREYS, KnownFrame(), r"two floors one above the other.*one file per storey"),
        (TILTED, KnownFrame(), r"tilted by 5\.\d°; expected at most 3°"),
        (quad((0, 0, 0), (0, 0, 5), (4, 0, 0)), KnownFrame(), r"lies in one plane"),
        (quad((0, 0, 0), (4, 0, 0), (0, 2.5, 0)), KnownFrame(up="y"), r"expected a floor of at least 2 m²"),
        (flat(("kitchen",)), KnownFrame(scale=10.0), r"--scale 10: from floor to ceiling there are then 25 m"),
    ],
    ids=["chair", "chair of a given scale", "cupboard", "unit", "storeys", "tilt", "plane", "wall", "large scale"],
)
def test_what_is_no_room_is_refused_in_one_line(triangles: Array, known: KnownFrame, line: str) -> None:
    with pytest.raises(Avs3dError, match=line) as caught:
        look(triangles, known, gltf=True)
    assert len(str(caught.value).splitlines()) == 1
