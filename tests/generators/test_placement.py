"""Placement: every rule checked in closed form, in rooms made of boxes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from shapely.geometry import MultiPoint, Point, Polygon

from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS
from avs3d_bench.errors import Avs3dError
from generators.assets.catalogue import Model, build_model, training_variants, variants
from generators.core.boxes import UprightBox, yaw_matrix
from generators.core.freespace import FreeSpace
from generators.core.scene import Mesh, Part, Room, Scene, SupportKind
from generators.placement.placement import RULES, TWIN_DISTANCES, TWIN_SPAN, WALL_HEIGHTS, Placement, Rule, place
from generators.placement.site import Site
from tests.support.rooms import SIZES, Toy, bathroom, box_model, kitchen, living_room

ROOMS: dict[str, Callable[[], Toy]] = {"kitchen": kitchen, "bathroom": bathroom, "living_room": living_room}
#: Where each category finds a place in the toy rooms.
HOMES = [
    *(("washing_machine", room) for room in ROOMS),
    *(("toilet", room) for room in ROOMS),
    *(("vacuum_cleaner", room) for room in ROOMS),
    *(("clock", room) for room in ROOMS),
    ("microwave", "kitchen"),
    ("coffee_machine", "kitchen"),
    ("coffee_machine", "living_room"),
    ("telephone", "kitchen"),
    ("telephone", "living_room"),
    ("dishwasher", "kitchen"),
    ("kettle", "kitchen"),
    ("radio", "living_room"),
    *(("fan", room) for room in ROOMS),
]


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def footprint(placement: Placement, below: float = math.inf) -> Polygon:
    """Hull of the mesh's plan; with ``below``, of what lies less than that above its lowest point."""
    points = placement.mesh.positions.reshape(-1, 3).astype(np.float64)
    return MultiPoint(points[points[:, 1] <= points[:, 1].min() + below][:, [0, 2]]).convex_hull


def overlaps(toy: Toy, placement: Placement) -> list[tuple[object, object]]:
    """The room's boxes that the object's box enters by more than 2 mm."""
    low, high = placement.bounds.astype(np.float64)
    plan = Polygon(placement.box.grown(-0.002).footprint)
    return [
        (a, b)
        for a, b in toy.solids
        if a[1] < high[1] - 0.002 and b[1] > low[1] + 0.002
        and plan.intersects(Polygon([(a[0], a[2]), (b[0], a[2]), (b[0], b[2]), (a[0], b[2])]))
    ]  # fmt: skip


def check(toy: Toy, placement: Placement) -> None:
    """All rules for one object."""
    model, category = placement.model, placement.model.category
    low, high = placement.bounds.astype(np.float64)
    assert not overlaps(toy, placement)
    if placement.support.kind == "wall":
        # Hangs flush on the inside of a wall, its middle within reach of the eye.
        w, _, d = toy.size
        gap = {90: low[0], -90: w - high[0], 0: low[2], 180: d - high[2]}[round(math.degrees(placement.yaw))]
        assert 0 <= gap <= 0.0005
        assert WALL_HEIGHTS[0] <= (low[1] + high[1]) / 2 <= WALL_HEIGHTS[1]
        return
    tops = sorted({b[1] for _, b in toy.solids if -1e-4 <= low[1] - b[1] <= 0.0005})
    assert len(tops) == 1, "touches exactly one level"
    assert toy.tops(tops[0]).buffer(0.006).covers(footprint(placement, 0.02)), "stands on it with its whole foot"
    if model.mount == "floor":
        assert tops == [0.0]
    if category in ("washing_machine", "toilet"):
        inside = Polygon([(0, 0), (toy.size[0], 0), (toy.size[0], toy.size[2]), (0, toy.size[2])])
        back = placement.box.footprint[:2]  # the corners at the lowest z of the model's own frame
        gaps = [inside.exterior.distance(Point(corner)) for corner in back]
        least, most = RULES[category].gap
        assert least - 0.001 <= min(gaps) <= max(gaps) <= most + 0.001
    elif category in RULES and placement.support.kind != "floor":
        assert placement.front @ np.asarray(placement.support.front) >= math.cos(math.radians(RULES[category].jitter))


def check_floor(scene: Scene, room: str, placements: tuple[Placement, ...]) -> None:
    """The agent's floor is not cut apart."""
    before = FreeSpace.of(scene, room).largest().area
    parts = tuple(p.part(i + 1) for i, p in enumerate(placements))
    after = FreeSpace.of(scene.with_parts(parts), room).largest().area
    assert after >= min(0.8 * before, 1.2)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(("category", "room"), HOMES)
def test_objects_stand_where_they_belong(category: str, room: str, count: int) -> None:
    toy = ROOMS[room]()
    if count > 1 and (category, room) in (("coffee_machine", "living_room"), ("toilet", "bathroom")):
        count = 1
    placed = place(Site.of(toy.scene, room), [box_model(category)] * count, rng=rng(count))
    assert len(placed) == count
    for placement in placed:
        check(toy, placement)
        assert placement.support.room == room
    check_floor(toy.scene, room, placed)
    centres = [p.bounds.mean(axis=0) for p in placed]
    gaps = [float(np.linalg.norm(a - b)) for a, b in combinations(centres, 2)]
    notes = [p.relaxed for p in placed if p.relaxed]
    assert min(gaps, default=9.0) >= (TWIN_DISTANCES[-1] if notes else TWIN_DISTANCES[0]) - 1e-6
    for one, other in combinations(placed, 2):
        assert not Polygon(one.box.footprint).intersects(Polygon(other.box.footprint)) or one.support != other.support


@pytest.mark.parametrize(("category", "count"), [("clock", 2), ("vacuum_cleaner", 3)])
def test_copies_are_no_further_apart_than_the_span(category: str, count: int) -> None:
    toy = living_room()
    model = box_model(category)
    gaps = []
    for span in (math.inf, TWIN_SPAN):
        placed = place(Site.of(toy.scene, "living_room"), [model] * count, rng=rng(1), span=span)
        centres = [p.box.centre for p in placed]
        gaps.append(max(float(np.linalg.norm(a - b)) for a, b in combinations(centres, 2)))
    assert gaps[1] <= TWIN_SPAN < gaps[0]
    with pytest.raises(Avs3dError, match=rf"no {count} of them fit together, 0.5 to 0.4 m apart") as caught:
        place(Site.of(toy.scene, "living_room"), [model] * count, rng=rng(), span=0.4)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("category", CATEGORIES)
def test_every_model_of_the_catalogue_finds_its_place(category: str) -> None:
    toy = kitchen()
    for number, variant in enumerate((*variants(category), *training_variants(category))):
        model = build_model(category, variant, rng(number))
        placed = place(Site.of(toy.scene, "kitchen"), [model] * (1 + number % 2), rng=rng(number))
        for placement in placed:
            check(toy, placement)


@pytest.mark.parametrize(("category", "room"), [h for h in HOMES if h[1] != "bathroom"])
def test_a_scan_names_no_supports_and_they_are_found(category: str, room: str) -> None:
    toy = ROOMS[room]()
    (placement,) = place(Site.of(toy.scan, room), [box_model(category)], rng=rng())
    low, _ = placement.bounds.astype(np.float64)
    assert not overlaps(toy, placement)
    if placement.support.kind == "wall":
        check(toy, placement)
    else:
        tops = [b[1] for _, b in toy.solids if -1e-4 <= low[1] - b[1] <= 0.0005]
        assert toy.tops(tops[0]).buffer(0.006).covers(footprint(placement, 0.02))


@pytest.mark.slow
def test_the_same_generator_gives_the_same_places_and_another_gives_others() -> None:
    scene = kitchen().scene

    def run(seed: int) -> list[tuple[object, ...]]:
        models = [*[box_model("microwave")] * 2, box_model("oven"), box_model("telephone")]
        placed = place(Site.of(scene, "kitchen"), models, rng=rng(seed))
        return [(p.model.category, p.position, p.yaw, p.relaxed) for p in placed]

    assert run(3) == run(3)
    assert len({str(run(seed)) for seed in range(5)}) == 5


@pytest.mark.slow
def test_the_order_in_which_models_are_named_has_no_influence() -> None:
    """The manifest names what sounds first; where things stand must not tell it."""
    scene = kitchen().scene
    models = [*[box_model("clock")] * 2, box_model("microwave"), box_model("oven"), box_model("telephone")]

    def run(order: list[int], seed: int) -> list[tuple[object, ...]]:
        placed = place(Site.of(scene, "kitchen"), [models[index] for index in order], rng=rng(seed))
        return sorted((p.model.category, p.position, p.yaw) for p in placed)

    for seed in range(3):
        assert run([0, 1, 2, 3, 4], seed) == run([4, 3, 1, 2, 0], seed) == run([2, 0, 4, 1, 3], seed)


def test_single_models_are_placed_in_an_order_that_is_drawn() -> None:
    """A worktop with room for one and a shelf for the other: each has the worktop sometimes."""
    toy = Toy("kitchen", (4.0, 2.6, 4.0)).shell().table("worktop", (0, 0, 0), (0.6, 0.9, 0.6), (0, 0, 1))
    toy.table("shelf", (3.4, 0, 0), (4.0, 0.8, 0.6), (-1, 0, 0))
    models = [box_model("microwave"), box_model("coffee_machine", size=(0.48, 0.3, 0.36))]
    on_worktop = {
        next(p.model.category for p in place(Site.of(toy.scene, "kitchen"), models, rng=rng(seed)) if p.position[0] < 1)
        for seed in range(8)
    }
    assert on_worktop == {"microwave", "coffee_machine"}


def test_nothing_that_is_placed_knows_what_sounds() -> None:
    assert not [field for field in Placement.__dataclass_fields__ if "sound" in field]


def test_twins_come_closer_only_where_they_must_and_say_so() -> None:
    def tight(length: float) -> Scene:
        toy = Toy("kitchen", (4.0, 2.6, 4.0)).shell()
        return toy.table("worktop", (0, 0, 0), (length, 0.9, 0.6), (0, 0, 1)).scene

    # Widths of 0.48 on a worktop of 1.7 leave 1.22 between the outermost middles; on 1.3, 0.82; on 1.1, 0.62.
    for length, distance in ((1.7, 1.0), (1.3, 0.7), (1.1, 0.5)):
        one, two = place(Site.of(tight(length), "kitchen"), [box_model("microwave")] * 2, rng=rng())
        assert float(np.linalg.norm(np.subtract(one.position, two.position))) >= distance
        assert (f"{distance} m apart" in one.relaxed) is (distance < 1.0)
    with pytest.raises(Avs3dError, match=r"no place for 2 × microwave .* no 2 of them fit together, 0\.5 m apart"):
        place(Site.of(tight(0.9), "kitchen"), [box_model("microwave")] * 2, rng=rng())


def test_all_copies_or_an_error_but_never_fewer() -> None:
    """The worktop takes one microwave, at one place."""
    toy = Toy("kitchen", (4.0, 2.6, 4.0)).shell().table("worktop", (0, 0, 0), (0.5, 0.9, 0.4), (0, 0, 1))
    assert len(place(Site.of(toy.scene, "kitchen"), [box_model("microwave")], rng=rng())) == 1
    with pytest.raises(Avs3dError, match="no place for 2 × microwave"):
        place(Site.of(toy.scene, "kitchen"), [box_model("microwave")] * 2, rng=rng())


@pytest.mark.slow
def test_a_rough_scanned_wall_still_takes_a_toilet() -> None:
    """4 mm of noise on every vertex of a 5 cm mesh: the back goes to the roughness, the foot to the highest grain."""
    mesh = bathroom().scene.parts[0].mesh
    vertices, faces = trimesh.remesh.subdivide_to_size(
        mesh.positions.reshape(-1, 3), np.arange(3 * len(mesh.positions)).reshape(-1, 3), 0.05
    )
    unique, index = np.unique(np.round(vertices, 4), axis=0, return_inverse=True)
    rough = (unique + rng(7).normal(0.0, 0.002, unique.shape))[index.reshape(-1)][faces].astype(np.float32)
    count = len(rough)
    scan = Mesh(
        rough, np.tile(np.float32([0, 1, 0]), (count, 3, 1)), np.zeros((count, 3, 2), dtype=np.float32),
        np.zeros(count, dtype=np.int32), mesh.materials, mesh.acoustic_positions, mesh.acoustic_labels,
    )  # fmt: skip
    scene = Scene("scan", (Part("scan", scan),), (Room("bathroom", (0, 0, 0), (2.2, 2.5, 2.9)),), ())
    (placement,) = place(Site.of(scene, "bathroom"), [box_model("toilet")], rng=rng())
    low, high = placement.bounds.astype(np.float64)
    back = min(low[0], 2.2 - high[0], low[2], 2.9 - high[2])
    assert 0.0 <= back <= 0.03
    assert 0.0 <= low[1] <= 0.01
    assert not placement.box.grown(-0.002).hits_triangles(rough).any()


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3])
def test_an_oven_stands_beside_a_microwave_and_not_always_the_same(count: int) -> None:
    toy = kitchen()
    nearest = []
    for seed in range(6):
        model = box_model("microwave")
        placed = place(Site.of(toy.scene, "kitchen"), [*[model] * count, box_model("oven")], rng=rng(seed))
        oven = placed[-1]
        assert oven.model.category == "oven"
        gaps = [float(np.linalg.norm(p.box.centre - oven.box.centre)) for p in placed[:-1]]
        assert any(0.5 <= gap <= 1.0 for gap in gaps)
        nearest.append(int(np.argmin(gaps)))
        for one, other in combinations(placed, 2):
            assert Polygon(one.box.footprint).distance(Polygon(other.box.footprint)) >= 0.02
        check(toy, oven)
    assert len(set(nearest)) > 1 or count == 1


@pytest.mark.parametrize("category", ["washing_machine", "vacuum_cleaner", "toilet"])
def test_nothing_stands_in_a_doorway(category: str) -> None:
    toy = Toy("kitchen", (2.2, 2.5, 2.6)).shell(door=(0.6, 1.5))
    for seed in range(8):
        (placement,) = place(Site.of(toy.scene, "kitchen"), [box_model(category)], rng=rng(seed))
        door = MultiPoint([(0.6, 2.6), (1.5, 2.6)]).convex_hull
        assert door.distance(Polygon(placement.box.footprint)) >= 0.5


@pytest.mark.slow
def test_every_object_can_be_seen_from_the_free_floor() -> None:
    # Behind the screen there is a shelf nobody sees; the only visible one is the side table.
    toy = Toy("living_room", (4.0, 2.6, 4.0)).shell()
    toy.table("side_table", (0.1, 0, 0.1), (0.6, 0.5, 0.6), (0, 0, 1)).add((0, 0, 0.75), (0.8, 2.6, 0.8))
    toy.add((0.75, 0, 0), (0.8, 2.6, 0.75))
    with pytest.raises(Avs3dError, match="are hidden from the free floor"):
        place(Site.of(toy.scene, "living_room"), [box_model("telephone")], rng=rng())
    toy.table("side_table", (3.4, 0, 1.6), (4.0, 0.5, 2.2), (-1, 0, 0))
    (placement,) = place(Site.of(toy.scene, "living_room"), [box_model("telephone")], rng=rng())
    assert placement.position[0] > 3.0


def test_the_source_and_the_part_move_with_the_object() -> None:
    (placement,) = place(Site.of(kitchen().scene, "kitchen"), [box_model("washing_machine")], rng=rng())
    part = placement.part(3)
    assert (part.instance_id, part.category, part.licence) == (3, "washing_machine", placement.model.licence)
    np.testing.assert_array_equal(part.mesh.bounds, placement.bounds)
    # It sounds in the middle of its front: half a depth before the middle of the box.
    expected = placement.box.centre + 0.30 * placement.front
    np.testing.assert_allclose(placement.source_position, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("toy", "model", "count", "message"),
    [
        (bathroom(), box_model("microwave"), 1, "it has no worktop, table or shelf large enough for 0.48×0.28×0.36 m"),
        (Toy("kitchen", (0.5, 2.5, 0.5)).shell(), box_model("clock"), 1, "toy/kitchen: no place for clock"),
        (Toy("kitchen", (0.3, 2.5, 0.3)).shell(), box_model("toilet"), 1, "it has no free floor"),
        (kitchen(), box_model("washing_machine", size=(0.9, 3.0, 0.9)), 1, "no place for washing_machine"),
        (bathroom(), box_model("washing_machine"), 6, "no place for 6 × washing_machine"),
        (
            kitchen(),
            box_model("clock", size=(0.3, 2.4, 0.1)),
            1,
            "it has no free wall large enough for 0.30×2.40×0.10 m",
        ),
        (kitchen(), box_model("clock"), 0, "toy/kitchen: no objects to place; expected at least one"),
    ],
)
def test_no_room_for_an_object_is_one_clear_line(toy: Toy, model: Model, count: int, message: str) -> None:
    with pytest.raises(Avs3dError) as caught:
        place(Site.of(toy.scene, toy.name), [model] * count, rng=rng())
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_wall_without_room_for_a_clock() -> None:
    """A wall full of shelves from 1.2 to 2.2 m: every wall support is covered."""
    toy = Toy("living_room", (3.0, 2.6, 3.0)).shell()
    for k in range(5):
        y = 1.2 + 0.2 * k
        toy.add((0, y, 0), (3.0, y + 0.02, 0.3)).add((0, y, 0.3), (0.3, y + 0.02, 3.0)).add(
            (2.7, y, 0.3), (3.0, y + 0.02, 3.0)
        )
    with pytest.raises(Avs3dError, match=r"no place for clock .* spots \d+ collide with the room"):
        place(Site.of(toy.scene, "living_room"), [box_model("clock")], rng=rng())


# The exact tests below the rules.

number = st.floats(-1.2, 1.2)
triangles = st.lists(st.tuples(number, number, number), min_size=3, max_size=3)


@pytest.mark.slow
@settings(max_examples=150)
@given(triangles, st.floats(-3.2, 3.2))
def test_the_separating_axis_test_agrees_with_linear_programming(corners: list[tuple[float, ...]], yaw: float) -> None:
    box = UprightBox(np.array([0.1, -0.05, 0.0]), np.array([0.5, 0.3, 0.4]), yaw)
    local = box.to_local(np.array(corners))
    # A point a·A + b·B + c·C with a + b + c = 1 inside the box, as deep as possible.
    rows = np.vstack([np.hstack([local.T, np.ones((3, 1))]), np.hstack([-local.T, np.ones((3, 1))])])
    limits = np.tile(box.half, 2)
    best = linprog([0, 0, 0, -1], rows, limits, [[1, 1, 1, 0]], [1], bounds=[(0, None)] * 3 + [(None, None)])
    depth = -best.fun
    assume(abs(depth) > 1e-6)
    assert bool(box.hits_triangles(np.array(corners)[None])[0]) is (depth > 0)


@settings(max_examples=100)
@given(st.tuples(number, number, number), st.floats(-3.2, 3.2), st.floats(-3.2, 3.2))
def test_two_boxes_overlap_where_their_plans_and_heights_do(centre: tuple[float, ...], a: float, b: float) -> None:
    one = UprightBox(np.zeros(3), np.array([0.5, 0.3, 0.4]), a)
    other = UprightBox(np.array(centre), np.array([0.2, 0.4, 0.6]), b)
    plans = Polygon(one.footprint), Polygon(other.footprint)
    assume(abs(abs(centre[1]) - 0.7) > 1e-6)
    gap = plans[0].distance(plans[1]) - plans[0].intersection(plans[1]).area
    assume(abs(gap) > 1e-6)
    assert one.hits_box(other) is (gap < 0 and abs(centre[1]) < 0.7)
    assert other.hits_box(one) is one.hits_box(other)


@settings(max_examples=100)
@given(triangles, st.floats(-3.2, 3.2))
def test_a_segment_is_blocked_where_a_sample_lies_inside(ends: list[tuple[float, ...]], yaw: float) -> None:
    box = UprightBox(np.zeros(3), np.array([0.5, 0.3, 0.4]), yaw)
    start, end = np.array(ends[:2])
    samples = start + np.linspace(0, 1, 2001)[:, None] * (end - start)
    distance = box.distance(samples)
    if (distance == 0).any():
        assert box.blocks(start[None], end[None])[0]
    elif distance.min() > 2e-3:
        assert not box.blocks(start[None], end[None])[0]


@given(st.floats(-3.2, 3.2))
def test_yaw_turns_the_front_as_documented(yaw: float) -> None:
    np.testing.assert_allclose(yaw_matrix(yaw) @ (0, 0, 1), (math.sin(yaw), 0, math.cos(yaw)), atol=1e-12)


def own(mount: str, size: tuple[float, float, float] = (0.10, 0.2, 0.10)) -> Model:
    """A box of a category that a manifest adds."""
    return replace(box_model("telephone", mount, size), category="hair_dryer", name="dryer.glb")


@pytest.mark.parametrize(
    ("stands_on", "mount", "expected"),
    [
        (("side_table", "worktop"), "surface", "side_table"),
        (("worktop", "side_table"), "surface", "worktop"),
        (("shelf", "floor"), "surface", "shelf"),
        (("floor", "shelf"), "surface", "floor"),
        (("floor",), "floor", "floor"),
        (("wall",), "wall", "wall"),
        (("wall", "shelf"), "wall_or_surface", "wall"),
        (("shelf", "wall"), "wall_or_surface", "shelf"),
        (("wall", "shelf"), "surface", "shelf"),  # one that moves does not hang
    ],
)
def test_a_declared_category_prefers_its_first_support(
    stands_on: tuple[SupportKind, ...], mount: str, expected: str
) -> None:
    toy = kitchen()
    for seed in range(3):
        (placed,) = place(
            Site.of(toy.scene, "kitchen"), [own(mount)], rng=rng(seed), rules={"hair_dryer": Rule(stands_on=stands_on)}
        )
        assert placed.support.kind == expected
        assert not overlaps(toy, placed)
        low = placed.bounds[0]
        if expected != "wall":
            level = {"floor": 0.0, "worktop": 0.9, "side_table": 0.5, "shelf": 0.8}[expected]
            assert low[1] == pytest.approx(level, abs=0.001)


def test_a_declared_category_takes_the_next_support_where_the_first_is_full() -> None:
    """The table of 0.5 × 0.4 m takes one object of 0.3 m; its twin stands on the worktop."""
    rule = Rule(stands_on=("side_table", "worktop"))
    model = own("surface", (0.3, 0.2, 0.3))
    placed = place(Site.of(kitchen().scene, "kitchen"), [model] * 2, rng=rng(4), rules={"hair_dryer": rule})
    assert sorted(p.support.kind for p in placed) == ["side_table", "worktop"]


@pytest.mark.parametrize("heights", [(0.6, 0.7), (1.9, 2.1)])
def test_a_declared_category_hangs_as_high_as_it_says(heights: tuple[float, float]) -> None:
    """The walls of the toy kitchen are measured, as in a scan: they reach down to the floor."""
    rule = Rule(stands_on=("wall",), wall_heights=heights)
    toy = kitchen()
    (placed,) = place(Site.of(toy.scan, "kitchen"), [own("wall")], rng=rng(1), rules={"hair_dryer": rule})
    assert heights[0] - 1e-3 <= placed.bounds[:, 1].mean() <= heights[1] + 1e-3


@pytest.mark.parametrize(("gap", "free"), [((0.2, 0.3), False), ((0.0, 0.0), False), ((0.01, 0.03), True)])
def test_a_declared_category_stands_at_its_distance_from_the_wall(gap: tuple[float, float], free: bool) -> None:
    rule = Rule(stands_on=("floor",), gap=gap, free=free, jitter=30.0)
    toy = bathroom()
    (placed,) = place(Site.of(toy.scene, "bathroom"), [own("floor")], rng=rng(2), rules={"hair_dryer": rule})
    inside = Polygon([(0, 0), (toy.size[0], 0), (toy.size[0], toy.size[2]), (0, toy.size[2])])
    back = [inside.exterior.distance(Point(corner)) for corner in placed.box.footprint[:2]]
    turned = abs(math.remainder(placed.yaw, math.pi / 2)) > 1e-6
    assert turned == free
    if not free:
        # Behind it is a wall, or the side of the bath (0.4 m from the wall at z = 0, 2.1 m along the other).
        faces = [
            *back,
            *(
                Polygon([(1.5, 0.4), (2.2, 0.4), (2.2, 2.1), (1.5, 2.1)]).distance(Point(c))
                for c in placed.box.footprint[:2]
            ),
        ]
        assert any(gap[0] - 0.001 <= distance <= gap[1] + 0.015 for distance in faces)


def test_a_wall_that_is_not_free_at_the_declared_height_is_one_clear_line() -> None:
    """The toy's wall supports reach from 1.2 to 2.1 m."""
    rule = Rule(stands_on=("wall",), wall_heights=(0.4, 0.8))
    with pytest.raises(
        Avs3dError, match=r"it has no wall from 0\.4 to 0\.8 m above the floor large enough for 0\.10×0\.20"
    ):
        place(Site.of(kitchen().scene, "kitchen"), [own("wall")], rng=rng(), rules={"hair_dryer": rule})


def test_a_mount_that_does_not_suit_the_declared_supports_is_one_clear_line() -> None:
    site = Site.of(kitchen().scene, "kitchen")
    with pytest.raises(Avs3dError, match=r"its mount is wall, but its category stands on side_table or worktop"):
        place(site, [own("wall")], rng=rng(), rules={"hair_dryer": Rule(stands_on=("side_table", "worktop"))})
    with pytest.raises(Avs3dError, match=r"no place for hair_dryer \(dryer.glb\): it has no table or shelf large"):
        place(
            Site.of(bathroom().scene, "bathroom"),
            [own("surface")],
            rng=rng(),
            rules={"hair_dryer": Rule(stands_on=("side_table", "shelf"))},
        )


def test_the_toy_models_cover_the_taxonomy() -> None:
    assert set(SIZES) == {*CATEGORIES, *DISTRACTORS}
