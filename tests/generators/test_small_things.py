"""Small things of living rooms, bedrooms and desks: each builder alone, and what the rooms of homes get of them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from generators.apartments.apartment import build_apartment
from generators.assets.clutter import living, sleeping
from generators.assets.clutter.catalogue import CLUTTER
from generators.assets.clutter.record import ClutterKind
from generators.assets.furniture import KINDS as FURNITURE
from generators.assets.materials import Palette
from generators.assets.styles import STYLES
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from tests.support.flats import small_things

OWN = (*living.KINDS, *sleeping.KINDS)
#: Triangles of one thing and of the small things of a room, at most.
MOST_TRIANGLES, ROOM_TRIANGLES = 700, 25_000
#: Words that name the seven categories that sound; nothing here may be one of them.
SOUNDING = ("microwave", "clock", "telephone", "washing", "vacuum", "coffee_machine", "toilet_bowl")


@pytest.fixture(scope="module")
def palettes() -> list[Palette]:
    return [Palette(style, 5) for style in ("scandinavian", "rented", "period")]


@pytest.fixture(scope="module")
def home() -> Scene:
    return build_apartment("home", 1, plain=True)


def test_names_are_unique_and_none_names_a_category_that_sounds() -> None:
    count = Counter(kind.name for kind in CLUTTER)
    assert max(count.values()) == 1
    assert not set(count) & set(FURNITURE)
    assert not [kind.name for kind in OWN if any(word in kind.name for word in SOUNDING)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", OWN, ids=lambda kind: kind.name)
def test_a_thing_is_sound_small_and_the_same_for_the_same_seed(kind: ClutterKind, palettes: list[Palette]) -> None:
    for number, palette in enumerate(palettes):
        thing = kind.make(palette, 3, number)
        mesh = thing.mesh
        mesh.check(kind.name)
        assert 12 <= len(mesh.positions) <= MOST_TRIANGLES
        low, _high = mesh.bounds
        assert np.ptp(mesh.bounds, axis=0).max() < 1.2
        if thing.mount == "floor":
            assert low[1] == pytest.approx(0, abs=1e-6)
        else:
            assert low[2] == pytest.approx(0, abs=1e-6)
        face = np.cross(mesh.positions[:, 1] - mesh.positions[:, 0], mesh.positions[:, 2] - mesh.positions[:, 0])
        assert ((face[:, None] * mesh.normals).sum(axis=2) > 0).mean() > 0.97
        again = kind.make(palette, 3, number).mesh
        assert again.positions.tobytes() == mesh.positions.tobytes()
        assert again.uv.tobytes() == mesh.uv.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("kind", OWN, ids=lambda kind: kind.name)
def test_a_thing_shows_no_back_of_a_face(kind: ClutterKind, palettes: list[Palette]) -> None:
    """Rays from above and from the front at a thing on its support meet front faces."""
    thing = kind.make(palettes[0], 7, 1)
    low, high = thing.mesh.bounds.astype(np.float64)
    rng = np.random.default_rng(2)
    around = np.abs(rng.standard_normal((3000, 3))) + 0.05
    around[:, 0] *= rng.choice([-1.0, 1.0], 3000)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    start = (low + high) / 2 + 2 * np.linalg.norm(high - low) * around
    direction = low + rng.random((3000, 3)) * (high - low) - start
    _, hit = RayCaster(thing.mesh.positions).closest(start, direction)
    met = hit >= 0
    p = thing.mesh.positions[hit[met]]
    back = (np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) * direction[met]).sum(axis=1) > 0
    assert met.sum() > 50
    assert back.mean() < 0.01


@pytest.mark.slow
def test_rooms_are_lived_in_within_the_budget(home: Scene) -> None:
    for room, least in (("living_room", 60), ("bedroom", 60)):
        assert sum(part.name.startswith(f"{room}/") for part in home.parts) >= least
        assert sum(len(part.mesh.positions) for part in small_things(home, room)) <= ROOM_TRIANGLES


@pytest.mark.slow
def test_small_things_rest_on_something_and_do_not_overlap(home: Scene) -> None:
    for room in ("living_room", "bedroom"):
        small = small_things(home, room)
        others = np.concatenate([part.mesh.positions for part in home.parts if part not in small])
        caster = RayCaster(others)
        boxes = np.array([part.mesh.bounds for part in small]).astype(np.float64)
        meet = (boxes[:, None, 0] < boxes[None, :, 1]).all(axis=2) & (boxes[None, :, 0] < boxes[:, None, 1]).all(axis=2)
        assert meet.sum() == len(small), [
            small[k].name for k in np.argwhere(meet & ~np.eye(len(small), dtype=bool))[:, 0]
        ]
        for part, (low, high) in zip(small, boxes, strict=True):
            middle = (low + high) / 2
            down = np.array([middle[0], low[1] + 0.06, middle[2]])
            below = caster.closest(down[None], np.array([[0.0, -1.0, 0.0]]))[0][0]
            sides = [
                caster.closest(middle[None], np.array([d]))[0][0]
                for d in ((1.0, 0, 0), (-1.0, 0, 0), (0, 0, 1.0), (0, 0, -1.0))
            ]
            above = caster.closest(middle[None], np.array([[0.0, 1.0, 0.0]]))[0][0]
            gaps = [
                abs(below - 0.06),
                above - (high[1] - low[1]) / 2,
                *(np.array(sides) - np.repeat((high - low)[[0, 2]] / 2, 2)),
            ]
            assert min(gaps) < 0.02, part.name


@pytest.mark.slow
def test_every_kind_of_thing_is_found_in_some_home(home: Scene) -> None:
    """A line of the catalogue that never finds a place is dead."""
    found: set[str] = set()
    for scene in (home, *(build_apartment("home", seed, plain=True) for seed in (2, 3, 7))):
        found |= {part.name.partition("/")[2].rpartition("_")[0] for part in scene.parts}
    missing = {kind.name for kind in OWN} - found
    assert len(missing) <= 0.25 * len(OWN), sorted(missing)


@pytest.mark.slow
def test_small_things_do_not_change_the_furniture(home: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("generators.apartments.apartment.add_clutter", lambda *_: [])
    bare = build_apartment("home", 1, plain=True)
    kept = {part.name: part.mesh.positions.tobytes() for part in home.parts}
    assert {part.name: kept[part.name] for part in bare.parts} == {
        part.name: part.mesh.positions.tobytes() for part in bare.parts
    }
    assert bare.supports == home.supports


def test_there_are_ten_styles_and_they_differ() -> None:
    assert len(STYLES) == 10
    for field in ("walls", "floors", "upholstery", "cushions", "art"):
        assert len({getattr(style, field) for style in STYLES.values()}) == 10, field
    assert {edge for style in STYLES.values() for edge in (style.edge,)} >= {0.5, 1.0, 2.0}
    assert {kind for style in STYLES.values() for kind in style.curtains} == {"pleated", "eyelet", "gathered", "sheer"}
    assert {leg for style in STYLES.values() for leg in style.legs} == {"tapered", "square", "turned"}
