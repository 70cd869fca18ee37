"""Small things in apartments: how many, that they rest on what they stand on, that they leave room for the rest."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from avs3d_bench.contract.taxonomy import CATEGORIES
from benchmarks.room_objects import count_objects
from generators.apartments.apartment import build_apartment
from generators.apartments.interior.clutter import QUIET, RESERVED_DEPTH, SOFT, reserved_length
from generators.assets.clutter.catalogue import CLUTTER, kinds_for
from generators.assets.clutter.record import ClutterKind
from generators.assets.furniture import KINDS
from generators.assets.materials import ROOM_KINDS, Palette
from generators.core.freespace import FreeSpace
from generators.core.rays import RayCaster
from generators.core.scene import Part
from tests.support.flats import SMALL_THINGS, kind_of, small_things, without_small_things
from tests.support.flats import plain_flat as flat
from tests.support.tiers import some

SLOW = [pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4, 5)]
SEEDS = (0, 1, *SLOW)
#: Least number of objects in a room at the standard density.
LEAST = {"kitchen": 60, "bathroom": 45, "hall": 30}
#: Most triangles of the small things of a room, and of one thing.
ROOM_TRIANGLES, THING_TRIANGLES = 25_000, 1_000
UPRIGHT = {"wall", "door_side", "worktop_wall", "basin_wall", "tub_wall", "fridge", "ceiling"}
Box = NDArray[np.float64]


def ends(a: Box, b: Box) -> tuple[Box, Box]:
    """The lowest and the highest corner (3,) of a box between two corners."""
    return np.minimum(a, b), np.maximum(a, b)


def boxes(parts: list[Part]) -> Box:
    """(N, 2, 3) bounds."""
    return np.array([part.mesh.bounds for part in parts], dtype=np.float64)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_wet_rooms_and_halls_are_full(seed: int) -> None:
    for room in count_objects(flat(seed)):
        assert room.objects >= LEAST.get(room.room, 0), room
    for name in ROOM_KINDS:
        assert sum(len(part.mesh.positions) for part in small_things(flat(seed), f"{name}/")) <= ROOM_TRIANGLES


@pytest.mark.parametrize("seed", SEEDS)
def test_things_do_not_overlap(seed: int) -> None:
    parts = small_things(flat(seed))
    low, high = boxes(parts).swapaxes(0, 1)
    meet = ((low[:, None] < high[None] - 1e-3) & (high[:, None] > low[None] + 1e-3)).all(axis=2)
    np.fill_diagonal(meet, False)
    assert not [(parts[a].name, parts[b].name) for a, b in np.argwhere(meet)]


@pytest.mark.parametrize("seed", SEEDS)
def test_things_touch_what_they_stand_on_and_enter_nothing(seed: int) -> None:
    home = flat(seed)
    caster = RayCaster(without_small_things(home))
    places = {kind.name: set(kind.places) for kind in CLUTTER}
    for part in small_things(home):
        # On upholstery, things lie halfway in: tests/generators/test_small_things.py.
        if places[kind_of(part)] & (UPRIGHT | set(SOFT)):
            continue
        corners = part.mesh.positions.reshape(-1, 3).astype(np.float64)
        bottom = corners[corners[:, 1] < corners[:, 1].min() + 1e-4]
        down, gap = np.broadcast_to([0.0, -1.0, 0.0], bottom.shape), 5e-4
        assert caster.closest(bottom + (0, gap, 0), down)[0].max() < 2e-3, f"{part.name} floats"
        # From the support upwards through the whole thing, nothing of the home is in the way. The placement's rays are
        # 8 mm apart: the tip of a leaf may pass between them, at one corner.
        corner = np.unique(bottom.round(4), axis=0)
        up = np.broadcast_to([0.0, 1.0, 0.0], corner.shape)
        height = float(corners[:, 1].max() - corners[:, 1].min()) - 2 * gap
        assert caster.occluded(corner + (0, gap, 0), up, height).sum() <= 1, part.name


@pytest.mark.parametrize("seed", SEEDS)
def test_places_of_the_benchmarks_objects_stay_free(seed: int) -> None:
    home = flat(seed)
    low, high = boxes(small_things(home)).swapaxes(0, 1)
    for support in home.supports:
        if support.kind in ("floor", "wall") or support.room in QUIET:
            continue
        origin, u, v, front = (np.asarray(c) for c in (support.origin, support.u, support.v, support.front))
        first, last = ends(origin, origin + u + v)
        axis = int(np.argmax(np.abs(u if np.linalg.norm(u) >= np.linalg.norm(v) else v)))
        if support.kind == "worktop":
            # Slim things may stand at the wall, behind the machines.
            deep = int(np.argmax(np.abs(front)))
            axis = 2 - deep
            if front[deep] > 0:
                first[deep] = max(first[deep], last[deep] - RESERVED_DEPTH)
            else:
                last[deep] = min(last[deep], first[deep] + RESERVED_DEPTH)
        on = (low[:, 1] < first[1] + 0.3) & (high[:, 1] > first[1] + 1e-4)
        for k in (0, 2):
            on &= (low[:, k] < last[k] - 2e-3) & (high[:, k] > first[k] + 2e-3)
        edges = [first[axis]]
        free = 0.0
        for a, b in sorted(zip(low[on, axis], high[on, axis], strict=True)):
            free = max(free, a - max(edges))
            edges.append(b)
        free = max(free, last[axis] - max(edges))
        assert free >= reserved_length(support) - 0.01, support


def test_machines_fit_under_what_hangs_over_a_worktop() -> None:
    assert all(support.clearance >= 0.45 for support in flat(1).supports if support.kind == "worktop")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_way_stays_free(seed: int) -> None:
    home = flat(seed)
    without = without_small_things(home)
    for room in home.rooms:
        before, after = FreeSpace.of(without, room.name), FreeSpace.of(home, room.name)
        # No observation is made in halls and bedrooms.
        least = 0.7 if room.name in ("hall", "bedroom") else 0.85
        assert after.largest().area >= least * before.largest().area, room.name


@pytest.mark.slow
def test_furniture_and_supports_do_not_depend_on_small_things(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("generators.apartments.apartment.add_clutter", lambda *_: [])
    plain = build_apartment("flat", 1, plain=True)
    home = without_small_things(flat(1))
    assert plain.supports == home.supports
    assert [p.name for p in plain.parts] == [p.name for p in home.parts]
    assert all(np.array_equal(a.mesh.positions, b.mesh.positions) for a, b in zip(plain.parts, home.parts, strict=True))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_things() -> None:
    again = build_apartment("another name", 1, workers=2, plain=True)
    assert [p.name for p in again.parts] == [p.name for p in flat(1).parts]
    for a, b in zip(small_things(again), small_things(flat(1)), strict=True):
        assert a.mesh.positions.tobytes() == b.mesh.positions.tobytes(), a.name
        assert a.mesh.uv.tobytes() == b.mesh.uv.tobytes(), a.name


def test_names_are_unique_and_tell_no_category() -> None:
    assert not [name for name, count in Counter(kind.name for kind in CLUTTER).items() if count > 1]
    assert not SMALL_THINGS & set(KINDS)
    assert not SMALL_THINGS & set(CATEGORIES)
    for room in ROOM_KINDS:
        assert kinds_for(room)


@pytest.mark.parametrize("kind", some(CLUTTER, every=4), ids=lambda kind: kind.name)
def test_a_thing_is_small_and_differs_from_copy_to_copy(kind: ClutterKind) -> None:
    palette = Palette("scandinavian", 3)
    first, second = (kind.make(palette, 5, copy) for copy in (0, 1))
    assert len(first.mesh.positions) <= THING_TRIANGLES
    assert (np.ptp(first.mesh.bounds, axis=0) < 1.4).all()
    assert kind.make(palette, 5, 0).mesh.positions.tobytes() == first.mesh.positions.tobytes()
    same_colour = [m.name for m in first.mesh.materials] == [m.name for m in second.mesh.materials]
    same_form = first.mesh.positions.tobytes() == second.mesh.positions.tobytes()
    assert kind.name in ALIKE or not (same_colour and same_form)


#: Kinds whose copies are all alike in a home.
ALIKE = {"smoke_detector", "switch", "socket", "worktop_socket", "shaver_socket", "thermostat", "hook"}
