"""The floor plan under the maps, and the labels on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.formats import media
from avs3d_bench.inspector.contact_sheet import chosen_frames, draw_contact_sheet
from avs3d_bench.inspector.floorplan import (
    FLOOR_COLOUR,
    FURNITURE_COLOUR,
    WALL_COLOUR,
    Bounds,
    PlanOutlines,
    paint_plan,
    plan_picture,
    trace_plan,
)
from avs3d_bench.inspector.labels import LabelBox, place_labels
from tests.support import tiny

BOUNDS = Bounds(-1.0, -1.0, 6.0, 5.0)


def sheet(x: Any, y: Any, z: Any) -> NDArray[np.float64]:
    """Points 4 cm apart on a rectangle, which has no extent along one axis."""
    axes = [np.arange(low, high + 1e-9, 0.04) if high > low else np.array([low]) for low, high in (x, y, z)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes)], axis=1)


@pytest.fixture(scope="module")
def room() -> NDArray[np.float64]:
    """A room of 4 m × 3 m with a door of 1 m in the wall z = 0, a table, a lamp, and 2.5 m below its ceiling."""
    walls = [
        sheet((0, 1.5), (0, 2.5), (0, 0)), sheet((2.5, 4), (0, 2.5), (0, 0)), sheet((1.5, 2.5), (2.05, 2.5), (0, 0)),
        sheet((0, 4), (0, 2.5), (3, 3)), sheet((0, 0), (0, 2.5), (0, 3)), sheet((4, 4), (0, 2.5), (0, 3)),
    ]  # fmt: skip
    table = [sheet((1, 2), (0.75, 0.75), (1.2, 1.8)), sheet((1, 2), (0.7, 0.75), (1.2, 1.2))]
    lamp = sheet((3.0, 3.3), (2.0, 2.2), (2.0, 2.0))
    return np.concatenate([sheet((0, 4), (0, 0), (0, 3)), sheet((0, 4), (2.5, 2.5), (0, 3)), *walls, *table, lamp])


@pytest.fixture(scope="module")
def plan(room: NDArray[np.float64]) -> PlanOutlines:
    return trace_plan(room, BOUNDS, 0.0)


def inside(outlines: tuple[NDArray[np.float64], ...], x: float, z: float) -> bool:
    """Even–odd rule."""
    winding = (cv2.pointPolygonTest(line.astype(np.float32)[:, None], (x, z), False) > 0 for line in outlines)
    return sum(winding) % 2 == 1


def test_walls_are_walls_and_the_door_is_open(plan: PlanOutlines) -> None:
    for x, z in ((0.7, 0.0), (3.3, 0.0), (2.0, 3.0), (0.0, 1.5), (4.0, 1.5)):
        assert inside(plan.walls, x, z), (x, z)
    for x, z in ((2.0, 0.0), (2.0, 1.0), (1.5, 1.5), (3.15, 2.0), (-0.5, 1.0)):
        assert not inside(plan.walls, x, z), (x, z)
    corners = np.concatenate(plan.walls)
    assert corners.min(axis=0) == pytest.approx((0, 0), abs=0.08)
    assert corners.max(axis=0) == pytest.approx((4, 3), abs=0.08)
    assert len(corners) < 40, "walls are straight"


def test_furniture_is_outlined_and_lamps_and_ceilings_are_left_out(plan: PlanOutlines) -> None:
    (table,) = plan.furniture
    assert table.min(axis=0) == pytest.approx((1.0, 1.2), abs=0.06)
    assert table.max(axis=0) == pytest.approx((2.0, 1.8), abs=0.06)


def test_the_floor_ends_at_the_walls(plan: PlanOutlines) -> None:
    assert inside(plan.floor, 3.5, 2.5)
    assert inside(plan.floor, 1.5, 1.5), "below the table, too"
    assert not any(inside(plan.floor, x, z) for x, z in ((-0.4, 1.0), (4.4, 1.0), (2.0, 3.5), (2.0, -0.4)))


def test_a_painted_plan_shows_each_where_it_is(plan: PlanOutlines) -> None:
    picture = paint_plan(plan, BOUNDS, (600, 500))
    assert picture.shape == (500, 600, 4)

    def at(x: float, z: float) -> tuple[int, ...]:
        return tuple(picture[round((z + 1) * 100), round((x + 1) * 100)].tolist())

    assert at(3.0, 1.0) == (*FLOOR_COLOUR, 255)
    assert at(1.5, 1.5) == (*FURNITURE_COLOUR, 255)
    assert at(0.7, 0.0) == (*WALL_COLOUR, 255)
    assert at(-0.6, 1.0)[3] == 0


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.array([[1.0, 0.0, 1.0]]), np.full((5, 3), 90.0)])
def test_a_plan_of_hardly_any_points_is_empty(points: NDArray[np.float64]) -> None:
    plan = trace_plan(points, BOUNDS, 0.0)
    assert plan.walls == plan.furniture == ()
    assert not paint_plan(plan, BOUNDS, (60, 50))[..., 3].any()


@settings(max_examples=60, deadline=None)
@example([(0.0, 39.0, 4), (0.0, 32.9921875, 4), (4.0, 67.0, 2), (0.0, 0.0, 2)])  # where a sliver was free to cover
@given(st.lists(st.tuples(st.floats(0, 560), st.floats(0, 360), st.integers(2, 18)), min_size=1, max_size=8))
def test_labels_are_inside_and_do_not_overlap(objects: list[tuple[float, float, int]]) -> None:
    area = LabelBox(0, 0, 600, 400)
    marks = [LabelBox(x, y, x + 40, y + 40) for x, y, _ in objects]
    places = place_labels(marks, [(7.0 * letters, 15.0) for *_, letters in objects], area)
    for number, place in enumerate(places):
        assert place.left >= -1e-6
        assert place.top >= -1e-6
        assert place.right <= 600 + 1e-6
        assert place.bottom <= 400 + 1e-6
        assert all(place.shared(other) < 1e-6 for other in places[:number])


def test_a_label_is_below_its_mark_and_not_where_something_is() -> None:
    (place,) = place_labels([LabelBox(100, 100, 140, 140)], [(50, 15)], LabelBox(0, 0, 300, 300))
    assert 140 < place.top < 150
    assert (place.left + place.right) / 2 == pytest.approx(120)
    (moved,) = place_labels([LabelBox(100, 100, 140, 140)], [(50, 15)], LabelBox(0, 0, 300, 300), taken=[place])
    assert moved.bottom < 100


@pytest.mark.slow
def test_names_on_a_contact_sheet_do_not_overlap_and_keep_off_the_legend(tmp_path: Path) -> None:
    root = tiny.write_dataset(tmp_path / "d", size=32)

    def side_by_side(record: dict[str, Any]) -> None:
        for number, instance in enumerate(record["instances"]):
            low, high = [0.6 * number - 1.0, 0.8, -1.0], [0.6 * number - 0.5, 1.0, -0.6]
            instance |= {"category": record["category"], "bounds": [low, high], "position": low}

    tiny.edit_record(root, tiny.MULTI, side_by_side, rehash=False)
    figure = draw_contact_sheet(Dataset(root), tiny.MULTI, columns=3)
    figure.draw_without_rendering()
    plan = next(
        a for half in figure.subfigs for sub in half.subfigs for a in sub.get_axes() if a.get_xlabel() == "x (m)"
    )
    names = [text.get_window_extent() for text in plan.texts if text.get_text()]
    assert len(names) == 3, "and that of the scale"
    boxes = [*names, plan.get_legend().get_window_extent()]
    for number, one in enumerate(boxes):
        assert all(not one.overlaps(other) for other in boxes[:number])
    assert not plan.get_legend().get_window_extent().overlaps(plan.get_window_extent()), "the plan is not hidden"


def test_a_contact_sheet_opens_on_a_frame_that_shows_the_object() -> None:
    assert chosen_frames([0] * 10 + [5] * 40, 8)[0] == 10
    assert len(set(chosen_frames([0] * 10 + [5] * 40, 8))) == 8
    some = chosen_frames([0, 0, 0, 7, 0, 0], 4)
    assert some[0] == 3
    assert sorted(set(some)) == sorted(some)
    assert len(some) == 4
    assert chosen_frames([0, 0, 0], 8) == [0, 1, 2], "where it is never in view: the first"


# ---- a scan's picture from above ------------------------------------------------------------------------------------

#: What the picture shows: 4 m × 2 m at 10 pixels a metre, of which the right quarter is unknown.
AREA = {"left": -1.0, "top": 0.0, "width": 4.0, "height": 2.0}
RED, BLUE = (200, 40, 0), (0, 80, 200)


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Observation:
    root = tmp_path_factory.mktemp("scanned") / "data"
    tiny.write_dataset(root, frames=9)
    rgb = np.zeros((20, 40, 3), dtype=np.uint8)
    rgb[:10, :30], rgb[10:, :30] = RED, BLUE
    media.write_png_rgb(root / tiny.SINGLE / layout.TOP_VIEW, rgb)
    tiny.edit_record(root, tiny.SINGLE, lambda record: record.update(top_view=AREA))
    return Dataset(root)[tiny.SINGLE]


def paler(colour: tuple[int, int, int]) -> list[int]:
    return [round(c + 0.25 * (255 - c)) for c in colour] + [255]


@pytest.mark.parametrize("scale", [10, 25, 6])
def test_a_scan_is_shown_from_above_where_it_is(scanned: Observation, scale: int) -> None:
    bounds = Bounds(-2.0, -1.0, 6.0, 4.0)
    picture = plan_picture(scanned, bounds, (6 * scale, 4 * scale))
    assert picture.shape == (4 * scale, 6 * scale, 4)

    def at(x: float, z: float) -> list[int]:
        found: list[int] = picture[int((z - bounds.top) * scale), int((x - bounds.left) * scale)].tolist()
        return found

    for x in (-0.7, 1.7):
        assert at(x, 0.4) == paler(RED)
        assert at(x, 1.6) == paler(BLUE)
    # Unknown, and outside of the picture on each side.
    assert all(at(x, z)[3] == 0 for x, z in ((2.6, 1.0), (-1.4, 1.0), (3.6, 1.0), (0.0, -0.5), (0.0, 2.6)))


def test_a_map_may_show_a_part_of_the_scan(scanned: Observation) -> None:
    picture = plan_picture(scanned, Bounds(0.0, 0.5, 1.0, 1.0), (40, 40))
    assert (picture[:19] == paler(RED)).all()
    assert (picture[21:] == paler(BLUE)).all()


@pytest.mark.slow
def test_a_sheet_of_a_scan_shows_its_colours(scanned: Observation) -> None:
    figure = draw_contact_sheet(Dataset(scanned.path.parents[3]), scanned.key, columns=3)
    canvas: Any = figure.canvas
    canvas.draw()
    pixels = np.array(canvas.buffer_rgba())[..., :3].astype(int)
    assert (np.abs(pixels - paler(BLUE)[:3]).max(axis=2) <= 2).sum() > 1000
