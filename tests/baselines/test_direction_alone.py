"""Direction alone: objects of the pictures become candidates, and the walk's sound chooses among them."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from avs3d_bench.contract.taxonomy import CATEGORIES  # noqa: E402
from avs3d_bench.geometry import Intrinsics  # noqa: E402
from baselines import direction_alone  # noqa: E402
from baselines.echosegnet import spatial  # noqa: E402
from baselines.echosegnet.views import RegisteredView  # noqa: E402
from baselines.listener.direction import woodworth_delay  # noqa: E402
from baselines.listener.predict import ListenerMethod  # noqa: E402

CELLS = 63
KEY = "part_1/home/kitchen/1"
CLOCK, TELEPHONE = (CATEGORIES.index(name) for name in ("clock", "telephone"))
#: Centres of three objects of 40 cm (Y down), and their categories: two clocks, and a telephone.
OBJECTS = (((-1.2, 0.0, 3.0), CLOCK), ((1.2, 0.0, 3.0), CLOCK), ((0.0, 0.5, 3.2), TELEPHONE))


def walk() -> list[RegisteredView]:
    """A walk past the objects, in an arc, always looking at them."""
    out = []
    for number, x in enumerate(np.linspace(-2, 2, 9)):
        yaw = math.atan2(-x, 3.0)
        rotation = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
        camera = Intrinsics.from_fov(CELLS, 90.0)
        frame: Any = SimpleNamespace(observation=SimpleNamespace(root="", path=KEY, is_part_3=False, group_key=KEY))
        out.append(RegisteredView(f"frame_{number:03d}", "train", camera, rotation, np.array([x, 0.0, 0.0]), frame))
    return out


def seen(view: RegisteredView) -> NDArray[np.float32]:
    """(8, n, n) what a perfect eye says: discs of the objects' size."""
    classes = np.full((1 + len(CATEGORIES), CELLS, CELLS), 0.0, np.float32)
    rows, columns = np.mgrid[:CELLS, :CELLS] + 0.5
    for centre, category in OBJECTS:
        x, y, z = (np.array(centre) - view.position) @ view.rotation
        u, v = (view.camera.fx * x / z + view.camera.cx, view.camera.fy * y / z + view.camera.cy)
        classes[1 + category][np.hypot(columns - u, rows - v) < 0.25 * view.camera.fx / z] = 1.0
    classes[0] = 1 - classes[1:].max(axis=0)
    return classes


def clip(view: RegisteredView, source: tuple[float, float, float]) -> NDArray[np.float32]:
    """(2, 44100) bursts of noise, delayed as by a sphere."""
    x, _, z = (np.array(source) - view.position) @ view.rotation
    noise = np.random.default_rng(int(view.name[-3:])).normal(size=44_100) * (np.arange(44_100) // 3000 % 2 == 0)
    delay = float(woodworth_delay(torch.tensor(math.atan2(x, z))))
    turn = np.exp(-2j * math.pi * np.fft.rfftfreq(44_100, 1 / 44_100) * delay)
    return 0.1 * np.stack([np.fft.irfft(np.fft.rfft(noise) * turn, 44_100), noise]).astype(np.float32)


MODEL = ListenerMethod(None, torch.device("cpu"), "0" * 64, refine="none")
FRAME: Any = SimpleNamespace(rgb=lambda: np.zeros((126, 126, 3), np.uint8))


@pytest.fixture(scope="module")
def found() -> tuple[list[RegisteredView], Any]:
    views = walk()
    return views, direction_alone.candidates(views, [seen(view) for view in views])


def test_objects_of_the_pictures_become_candidates_where_they_are(found: Any) -> None:
    _, (points, labels, categories, _) = found
    assert set(np.unique(categories)) == {CLOCK, TELEPHONE}
    large = [label for label in np.unique(labels) if (labels == label).sum() >= 10]
    middles = sorted(tuple(points[labels == label].mean(axis=0).round(1)) for label in large)
    assert len(middles) == len(OBJECTS)
    for middle, (centre, _) in zip(middles, sorted(OBJECTS), strict=True):
        np.testing.assert_allclose(middle, centre, atol=0.35)


@pytest.mark.parametrize("number", range(len(OBJECTS)))
def test_the_walk_tells_which_candidate_sounds_whatever_it_is_called(found: Any, number: int) -> None:
    views, (points, labels, categories, _) = found
    centre, category = OBJECTS[number]
    choice = spatial.choose(points, labels, views, np.stack([clip(view, centre) for view in views]))
    assert np.linalg.norm(points[choice.chosen].mean(axis=0) - centre) < 0.5
    assert categories[choice.chosen][0] == category


def test_a_frame_keeps_the_component_that_the_chosen_voxels_are_seen_in(found: Any) -> None:
    views, (points, *_) = found
    left = points[points[:, 0] < -0.6]
    view = views[4]
    mask = direction_alone.DirectionMethod(MODEL)._of_points(FRAME, seen(view), left, CLOCK, view)
    assert mask[:, :63].any()
    assert not mask[:, 63:].any()
    nothing = direction_alone.DirectionMethod(MODEL)._of_points(FRAME, seen(view), left, TELEPHONE, view)
    assert not nothing.any()


def method(cues: direction_alone.Cues, audible: dict[int, float], monkeypatch: pytest.MonkeyPatch) -> Any:
    """A method with two candidates, a clock of 40 voxels and a telephone of 20, that hears categories by name."""
    labels = np.repeat([0, 1], [40, 20])
    found = np.zeros((60, 3)), labels, np.where(labels == 0, CLOCK, TELEPHONE), np.ones(60, np.bool_)
    monkeypatch.setattr(direction_alone, "candidates", lambda *_, **__: found)
    made = direction_alone.DirectionMethod(ListenerMethod(None, torch.device("cpu"), "0" * 64), cues)
    heard = np.full(len(CATEGORIES), 0.02, np.float32)
    heard[list(audible)] = list(audible.values())
    monkeypatch.setattr(ListenerMethod, "heard", lambda _, frames: np.tile(heard, (len(frames), 1)))
    monkeypatch.setattr(type(made), "_clips", lambda _, views: np.zeros((len(views), 2, 44_100), np.float32))
    return made


@pytest.mark.parametrize(
    ("cues", "place", "heard", "category"),
    [
        ("direction", 0.0, 0.9, CLOCK),  # as likely by place: the larger one
        ("both", 0.0, 0.9, TELEPHONE),  # … and by name: the one that is heard
        ("both", -40.0, 0.9, CLOCK),  # a place that is far less likely outweighs the name
        ("both", 0.0, 0.02, CLOCK),  # nothing is heard by name
    ],
)
def test_name_and_place_choose_together(
    monkeypatch: pytest.MonkeyPatch, cues: direction_alone.Cues, place: float, heard: float, category: int
) -> None:
    choice = SimpleNamespace(labels=np.arange(2), scores=np.array([0.0, place]), heard=9)
    monkeypatch.setattr(spatial, "choose", lambda *_: choice)
    found = method(cues, {TELEPHONE: heard}, monkeypatch)._chosen(walk(), [])
    assert found is not None
    assert found[1] == category


@pytest.mark.parametrize("cues", ["direction", "both"])
def test_a_walk_without_sound_marks_nothing(monkeypatch: pytest.MonkeyPatch, cues: direction_alone.Cues) -> None:
    choice = SimpleNamespace(labels=np.arange(2), scores=np.zeros(2), heard=0)
    monkeypatch.setattr(spatial, "choose", lambda *_: choice)
    assert method(cues, {}, monkeypatch)._chosen(walk(), []) is None


def test_in_part_3_a_name_that_is_heard_confirms_a_candidate_and_another_one_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    posterior = np.array([[0.4, 0.4], [0.4, 0.9]])
    monkeypatch.setattr(direction_alone, "cluster_activity", lambda *_, **__: SimpleNamespace(posterior=posterior))
    both, views = method("both", {CLOCK: 0.9}, monkeypatch), walk()[:2]
    _, labels, categories, _, odds = both._odds(views, views, [])
    found = labels, categories, odds
    assert both._sounding(*found, views).tolist() == [[True, False], [True, True]]
    assert replace(both, cues="direction")._sounding(*found, views).tolist() == [[False, False], [False, True]]


def test_what_does_not_depend_on_names_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    choices = iter([SimpleNamespace(labels=np.arange(2), scores=np.zeros(2), heard=9)])
    monkeypatch.setattr(spatial, "choose", lambda *_: next(choices))
    alone = method("direction", {TELEPHONE: 0.9}, monkeypatch)
    first, second = alone._chosen(walk(), []), replace(alone, cues="both")._chosen(walk(), [])
    assert first is not None
    assert second is not None
    assert (first[1], second[1]) == (CLOCK, TELEPHONE)


def marked(monkeypatch: pytest.MonkeyPatch, sounding: int | None) -> list[NDArray[np.uint8]]:
    """What `DirectionMarker` marks in the train frames of a walk on which one of `OBJECTS` sounds, or none."""
    trained = walk()
    by_name = {view.name: view for view in trained}
    for view in trained:
        frame: Any = view.frame
        frame.name, frame.rgb, frame.observation.is_part_3 = view.name, lambda: np.zeros((126, 126, 3), np.uint8), False
    silence = np.zeros((2, 44_100), np.float32)
    clips = [silence if sounding is None else clip(view, OBJECTS[sounding][0]) for view in trained]
    monkeypatch.setattr(direction_alone.views, "load_views", lambda _: trained)
    monkeypatch.setattr(direction_alone.views, "input_views", lambda views: views)
    monkeypatch.setattr(ListenerMethod, "class_maps", lambda _, frames: [seen(by_name[each.name]) for each in frames])
    monkeypatch.setattr(direction_alone.DirectionMethod, "_clips", lambda *_: np.stack(clips))
    monkeypatch.setattr(direction_alone.DirectionMarker, "method", lambda *_: MODEL)
    marker = direction_alone.DirectionMarker(None, "0" * 64, "direction")
    return list(marker.mark([view.frame for view in trained], torch.device("cpu")))


@pytest.mark.parametrize("number", range(len(OBJECTS)))
def test_train_frames_are_marked_where_the_object_is_from_whose_place_the_sound_comes(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    centre, category = OBJECTS[number]
    for view, ids in zip(walk(), marked(monkeypatch, number), strict=True):
        assert set(np.unique(ids)) == {0, 1 + category}
        x, y, z = (np.array(centre) - view.position) @ view.rotation
        rows, columns = np.nonzero(ids)
        aim = (view.camera.fy * y / z + view.camera.cy) * 2, (view.camera.fx * x / z + view.camera.cx) * 2
        np.testing.assert_allclose((rows.mean(), columns.mean()), aim, atol=6)


def test_train_frames_of_a_silent_walk_have_no_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not any(ids.any() for ids in marked(monkeypatch, None))


def test_where_the_network_misses_the_chosen_object_its_silhouette_lowers_the_threshold(found: Any) -> None:
    views, (points, *_) = found
    classes, left, view = seen(views[4]), points[points[:, 0] < -0.6], views[4]
    sure = direction_alone.DirectionMethod(MODEL)._of_points(FRAME, classes, left, CLOCK, view)
    classes[1:] *= 0.3  # below `OBJECT`: neither clock is a component
    unsure = direction_alone.DirectionMethod(MODEL)._of_points(FRAME, classes, left, CLOCK, view)
    assert (sure & unsure).sum() / (sure | unsure).sum() > 0.6
    assert not unsure[:, 63:].any()


@pytest.mark.parametrize(("nearer", "kept"), [(0, (True, False)), (2, (False, True))])
def test_in_part_3_objects_that_a_picture_shows_as_one_are_cut_where_the_core_ends(
    found: Any, nearer: int, kept: tuple[bool, bool]
) -> None:
    views, (points, *_) = found
    classes, view = seen(views[4]), views[4]
    classes[1 + CLOCK, 28:36, 10:53] = 0.9  # a bar from one clock to the other
    core = points[points[:, 0] * (nearer - 1) > 0.6]
    mask = direction_alone.DirectionMethod(MODEL)._of_core(FRAME, classes[1 + CLOCK], core, view)
    assert (bool(mask[:, :50].any()), bool(mask[:, 76:].any())) == kept


def test_a_hull_that_objects_share_is_divided_between_them_and_each_has_its_core() -> None:
    volume = np.zeros((20, 6, 6))
    volume[2:18, 1:5, 1:5] = 0.5
    volume[2:7, 1:5, 1:5], volume[3:6, 2:4, 2:4] = 0.62, 0.8
    volume[13:18, 1:5, 1:5] = 0.7
    volume[9, 2, 2] = 0.9  # of fewer voxels than `LEAST_PART`
    volume[9, 3, 3] = 0.5
    ((whole, every),) = direction_alone.touching(volume)
    assert len(whole) == (volume > 0).sum()
    assert every.all()
    (one, core), (other, rest) = sorted(direction_alone.objects(volume), key=lambda each: each[0][0, 0])
    assert {tuple(each) for each in one[core]} == {(x, y, z) for x in (3, 4, 5) for y in (2, 3) for z in (2, 3)}
    assert rest.sum() == 5 * 4 * 4
    assert other[rest][:, 0].min() == 13
    # No voxel is lost, and each is of the object that is nearer.
    assert len(one) + len(other) == (volume > 0).sum()
    assert one[:, 0].max() <= 9 <= other[:, 0].min()


def test_a_part_on_which_the_frames_agree_far_less_is_no_object_of_its_own() -> None:
    """Seen from one side alone, a hull reaches far behind its object, where crossing rays make lower peaks."""
    volume = np.full((12, 4, 4), 0.5)
    volume[:3], volume[8:11] = 1.0, 0.7
    ((voxels, core),) = direction_alone.objects(volume)
    assert len(voxels) == volume.size
    assert voxels[core][:, 0].max() == 2


def test_a_silhouette_is_where_voxels_are(found: Any) -> None:
    views, _ = found
    inside = direction_alone.silhouette(np.array([[0.0, 0.0, 2.0]]), views[4], (CELLS, CELLS))
    rows, columns = np.nonzero(inside)
    assert abs(rows.mean() - 31) < 1
    assert abs(columns.mean() - 31) < 1
    assert 1 <= inside.sum() <= 16  # a voxel of 10 cm at 2 m: 1.6 cells of 63 over 90°
