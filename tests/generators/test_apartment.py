"""Procedural apartments: plan, shell, furniture, supports."""

from __future__ import annotations

import hashlib
import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from generators.apartments.apartment import build_apartment
from generators.apartments.floorplan import SIDES
from generators.apartments.planning import make_floor_plan
from generators.assets.furniture import KINDS
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from tests.support.flats import plain_flat as flat
from tests.support.flats import textured_flat, without_small_things

SEEDS = (0, 1, 2, 3)
CELL = 0.05
RADIUS = 0.2
#: Pairs whose boxes may meet because one is drawn up to, or hangs before, the other.
NESTED = {frozenset(pair) for pair in (("chair", "dining_table"), ("chair", "desk"))}


def kind(part_name: str) -> str:
    return part_name.split("/")[1].rsplit("_", 1)[0]


def furniture(scene: Scene, room: str) -> list[tuple[str, NDArray[np.float32]]]:
    """Kind and bounds of a room's furniture, without small things; curtains as their two bunches of cloth."""
    out = []
    for part in scene.parts:
        if part.name.startswith(f"{room}/") and kind(part.name) in KINDS:
            pieces = [part.mesh.bounds]
            if kind(part.name) == "curtains":
                boxes = part.mesh.acoustic_positions.reshape(-1, 36, 3)
                pieces = [np.stack([box.min(axis=0), box.max(axis=0)]) for box in boxes]
            out += [(kind(part.name), bounds) for bounds in pieces]
    return out


def digest(scene: Scene) -> str:
    state = hashlib.sha256()
    for part in scene.parts:
        for array in (part.mesh.positions, part.mesh.normals, part.mesh.uv, part.mesh.acoustic_positions):
            state.update(array.tobytes())
        for material in part.mesh.materials:
            state.update(repr((material.name, material.colour)).encode())
            if material.texture is not None:
                state.update(material.texture.pixels.tobytes())
    state.update(repr((scene.rooms, scene.supports)).encode())
    return state.hexdigest()


@pytest.mark.parametrize("seed", range(24))
def test_plan_keeps_the_sizes_a_walker_needs(seed: int) -> None:
    plan = make_floor_plan(seed, np.random.default_rng(seed))
    smallest = {"bathroom": (2.8, 3.1), "kitchen": (3.0, 3.4), "living_room": (4.2, 4.8)}
    assert 55 <= sum(room.area for room in plan.rooms) <= 110
    assert 2.5 <= plan.height <= 2.8
    for name, (short, long) in smallest.items():
        room = plan.room(name)
        width, depth = sorted((room.x1 - room.x0, room.z1 - room.z0))
        assert width >= short, name
        assert depth >= long, name


@pytest.mark.parametrize("seed", range(24))
def test_every_room_is_reached_from_the_hall_and_has_daylight(seed: int) -> None:
    plan = make_floor_plan(seed, np.random.default_rng(seed))
    reached = {"hall"}
    for _ in plan.rooms:
        for opening in plan.openings:
            if opening.other is not None and {opening.room, opening.other} & reached:
                reached |= {opening.room, opening.other}
    assert reached == {room.name for room in plan.rooms}
    lit = {opening.room for opening in plan.openings if opening.kind == "window"}
    assert lit >= reached - {"hall"}


@pytest.mark.parametrize("seed", range(24))
def test_openings_lie_inside_both_walls_and_apart(seed: int) -> None:
    plan = make_floor_plan(seed, np.random.default_rng(seed))
    for room in plan.rooms:
        for side in SIDES:
            wall = room.wall(side)
            spans = sorted(wall.along(o.start, o.stop) for o in plan.openings_of(room.name, side))
            assert all(a > 0.1 and b < wall.length - 0.1 for a, b in spans)
            assert all(first[1] + 0.14 < second[0] for first, second in itertools.pairwise(spans))


def test_doors_and_passages_have_the_widths_of_doors() -> None:
    for seed in range(24):
        for opening in make_floor_plan(seed, np.random.default_rng(seed)).openings:
            low, high = {"door": (0.85, 1.0), "passage": (1.0, 2.2), "entrance": (0.9, 1.0), "window": (0.6, 2.6)}[
                opening.kind
            ]
            assert low <= opening.stop - opening.start <= high + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_furniture_does_not_overlap(seed: int) -> None:
    scene = flat(seed)
    for room in scene.rooms:
        pieces = [(k, b) for k, b in furniture(scene, room.name) if b[1, 1] > 0.04]
        for i, (first, a) in enumerate(pieces):
            for second, b in pieces[i + 1 :]:
                if frozenset((first, second)) in NESTED:
                    continue
                depth = (np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])).min()
                assert depth < 0.005, f"{room.name}: {first} and {second} overlap by {depth:.3f} m"


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_furniture_stays_in_its_room(seed: int) -> None:
    scene = flat(seed)
    for room in scene.rooms:
        for name, bounds in furniture(scene, room.name):
            assert (bounds[0] >= np.array(room.low) - 0.01).all(), name
            assert (bounds[1] <= np.array(room.high) + 0.01).all(), name


def floor_grid(scene: Scene, room_name: str) -> NDArray[np.bool_]:
    """Cells of 5 cm over which nothing stands between ankle and sensor, by rays from the ceiling down."""
    room = scene.room(room_name)
    caster = RayCaster(np.concatenate([p.mesh.positions for p in scene.parts]))
    x = np.arange(room.low[0] + CELL / 2, room.high[0], CELL)
    z = np.arange(room.low[2] + CELL / 2, room.high[2], CELL)
    gx, gz = np.meshgrid(x, z, indexing="ij")
    origins = np.stack([gx, np.full_like(gx, 1.75), gz], axis=2).reshape(-1, 3).astype(np.float32)
    distance, _ = caster.closest(origins, np.broadcast_to(np.float32([0, -1, 0]), origins.shape))
    return (np.abs(1.75 - distance) < 0.05).reshape(gx.shape)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("room_name", "square_metres"), [("bathroom", 1.5), ("kitchen", 2.5), ("living_room", 5.0)])
def test_an_agent_can_walk_from_door_to_door(seed: int, room_name: str, square_metres: float) -> None:
    scene = flat(seed)
    plan_room = scene.room(room_name)
    free = floor_grid(scene, room_name)
    clear = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * CELL >= RADIUS
    labels, count = ndimage.label(clear)
    assert count >= 1
    sizes = ndimage.sum_labels(clear, labels, np.arange(1, count + 1)) * CELL**2
    largest = 1 + int(np.argmax(sizes))
    assert sizes.max() >= square_metres
    for door in doors_of(seed, room_name):
        i, j = ((door - np.array(plan_room.low)[[0, 2]]) / CELL).astype(int)
        near = labels[max(i - 4, 0) : i + 5, max(j - 4, 0) : j + 5]
        assert (near == largest).any(), f"a door of {room_name} at {door} is blocked"


def doors_of(seed: int, room_name: str) -> list[NDArray[np.float64]]:
    plan_rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[0])
    plan = make_floor_plan(seed, plan_rng)
    room = plan.room(room_name)
    out = []
    for side in SIDES:
        wall = room.wall(side)
        for opening in plan.openings_of(room_name, side):
            if opening.kind in ("door", "passage"):
                out.append(wall.point(sum(wall.along(opening.start, opening.stop)) / 2, 0.0, 0.4)[[0, 2]])
    return out


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_the_bathroom_keeps_a_free_floor(seed: int) -> None:
    free = floor_grid(flat(seed), "bathroom")
    total = np.pad(np.cumsum(np.cumsum(~free, axis=0), axis=1), ((1, 0), (1, 0)))

    def empty(width: float, depth: float) -> bool:
        m, n = round(width / CELL), round(depth / CELL)
        return bool((total[m:, n:] - total[:-m, n:] - total[m:, :-n] + total[:-m, :-n] == 0).any())

    assert empty(1.6, 1.8) or empty(1.8, 1.6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_no_ray_escapes_from_a_room_and_no_wall_shows_its_back(seed: int) -> None:
    scene = flat(seed)
    shells = [p for p in scene.parts if p.name.startswith("shell_")]
    triangles = np.concatenate([p.mesh.positions for p in shells])
    caster = RayCaster(triangles)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    rng = np.random.default_rng(5)
    for room in scene.rooms:
        low, high = np.array(room.low), np.array(room.high)
        origins = rng.uniform(low + 0.1, high - 0.1, (20000, 3)).astype(np.float32)
        directions = rng.normal(size=(20000, 3)).astype(np.float32)
        distance, face = caster.closest(origins, directions)
        assert np.isfinite(distance).all(), room.name
        assert (face >= 0).all(), room.name
        assert (np.einsum("ij,ij->i", normal[face], directions) < 0).all(), f"{room.name} shows a wall's back"


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_no_sound_escapes(seed: int) -> None:
    scene = flat(seed)
    caster = RayCaster(np.concatenate([p.mesh.acoustic_positions for p in scene.parts if p.name.startswith("shell_")]))
    rng = np.random.default_rng(6)
    for room in scene.rooms:
        origins = rng.uniform(np.array(room.low) + 0.1, np.array(room.high) - 0.1, (5000, 3)).astype(np.float32)
        distance, _ = caster.closest(origins, rng.normal(size=(5000, 3)).astype(np.float32))
        assert np.isfinite(distance).all(), room.name


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_acoustic_faces_are_few_and_labelled(seed: int) -> None:
    known = {
        "plaster",
        "concrete",
        "brick",
        "wood",
        "parquet",
        "tile",
        "ceramic",
        "glass",
        "metal",
        "plastic",
        "fabric",
        "carpet",
        "curtain",
        "upholstery",
        "foliage",
        "paper",
        "water",
    }
    scene = flat(seed)
    for part in scene.parts:
        assert len(part.mesh.acoustic_labels) == len(part.mesh.acoustic_positions)
        assert set(part.mesh.acoustic_labels) <= known, part.name
    shells = [p for p in scene.parts if p.name.startswith("shell_")]
    assert sum(len(p.mesh.acoustic_positions) for p in shells) <= 600
    assert sum(len(p.mesh.acoustic_positions) for p in scene.parts) <= 20000


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_rooms_hold_what_makes_them_recognisable(seed: int) -> None:
    scene = flat(seed)
    wanted = {
        "bathroom": {"washbasin", "vanity_cabinet", "towel_rail", "bath_mat", "laundry_basket", "ceiling_lamp"},
        "kitchen": {"kitchen_counter", "wall_cabinet", "fridge", "dining_table", "chair", "ceiling_lamp"},
        "living_room": {"sofa", "armchair", "coffee_table", "tv_stand", "bookshelf", "rug", "side_table", "curtains"},
    }
    for room, kinds in wanted.items():
        found = {name for name, _ in furniture(scene, room)}
        assert found >= kinds, f"{room} lacks {kinds - found}"
    assert {"bathtub", "shower"} & {name for name, _ in furniture(scene, "bathroom")}


@pytest.mark.slow
def test_pictures_on_blank_walls_change_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def parts(home: Scene) -> list[tuple[str, bytes]]:
        return [(part.name, part.mesh.positions.tobytes()) for part in without_small_things(home).parts]

    dressed = parts(flat(0))
    monkeypatch.setattr("generators.apartments.furnish.dress_walls", lambda _: None)
    bare = parts(build_apartment("flat", 0, plain=True))
    more = [name for name, _ in dressed if name not in dict(bare)]
    assert len(more) >= 4
    assert {kind(name) for name in more} == {"picture"}
    assert [part for part in dressed if part[0] not in more] == bare


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_supports_lie_in_their_rooms_and_are_orthogonal(seed: int) -> None:
    scene = flat(seed)
    for s in scene.supports:
        room = scene.room(s.room)
        o, u, v, n, f = (np.array(value) for value in (s.origin, s.u, s.v, s.normal, s.front))
        for corner in (o, o + u, o + v, o + u + v):
            assert (corner >= np.array(room.low) - 0.01).all(), s
            assert (corner <= np.array(room.high) + 0.01).all(), s
        assert abs(u @ v) < 1e-3
        assert abs(u @ n) < 1e-3
        assert abs(v @ n) < 1e-3
        assert np.linalg.norm(n) == pytest.approx(1, abs=1e-3)
        assert np.linalg.norm(f) == pytest.approx(1, abs=1e-3)
        assert f[1] == 0
        assert s.clearance >= 0.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_supports_have_free_space_above_them(seed: int) -> None:
    """A ray along the support's normal, from just above its middle, is free for its clearance, but for small things."""
    scene = without_small_things(flat(seed))
    caster = RayCaster(np.concatenate([p.mesh.positions for p in scene.parts]))
    for s in scene.supports:
        if s.kind == "floor":
            continue
        middle = np.array(s.origin) + np.array(s.u) / 2 + np.array(s.v) / 2
        start = (middle + 0.01 * np.array(s.normal)).astype(np.float32)
        distance, _ = caster.closest(start[None], np.float32([s.normal]))
        assert distance[0] >= s.clearance - 0.06, s


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_there_is_room_for_the_objects_of_the_benchmark(seed: int) -> None:
    scene = flat(seed)

    def total(room: str, *kinds: str) -> float:
        return sum(float(np.linalg.norm(s.u)) for s in scene.supports if s.room == room and s.kind in kinds)

    assert total("kitchen", "worktop") >= 2.0
    for room in ("kitchen", "living_room"):
        assert total(room, "wall") >= 1.0, f"no wall for clocks in {room}"
    assert total("living_room", "side_table") >= 1.0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_the_name_does_not_matter() -> None:
    assert digest(build_apartment("another name", 1)) == digest(textured_flat(1))


@pytest.mark.slow
def test_a_plain_flat_has_the_geometry_of_the_flat() -> None:
    def geometry(scene: Scene) -> list[tuple[str, bytes, bytes, bytes]]:
        meshes = {part.name: part.mesh for part in scene.parts}
        return [
            (name, mesh.positions.tobytes(), mesh.normals.tobytes(), mesh.acoustic_positions.tobytes())
            for name, mesh in meshes.items()
        ]

    plain, whole = flat(1), textured_flat(1)
    assert geometry(plain) == geometry(whole)
    assert (plain.rooms, repr(plain.supports)) == (whole.rooms, repr(whole.supports))


@pytest.mark.slow
def test_different_seeds_give_different_flats() -> None:
    assert len({digest(flat(seed)) for seed in SEEDS}) == len(SEEDS)
    boxes = {tuple(r.high) for seed in SEEDS for r in flat(seed).rooms if r.name == "living_room"}
    assert len(boxes) == len(SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_the_flat_is_unlit_glows_at_windows_and_lamps_and_is_not_too_heavy(seed: int) -> None:
    scene = flat(seed)
    assert all(part.light is None and part.instance_id == 0 for part in scene.parts)
    for room in ("bathroom", "kitchen", "living_room"):
        shell = next(p for p in scene.parts if p.name == f"shell_{room}")
        glowing = np.array([max(m.emission) > 1 for m in shell.mesh.materials])[shell.mesh.face_material]
        assert glowing.any(), f"{room} has no window"
    assert sum(len(p.mesh.positions) for p in scene.parts) <= 150_000
