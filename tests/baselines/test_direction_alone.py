"""Direction alone: objects of the pictures become candidates, and the walk's sound chooses among them."""

from __future__ import annotations

import math
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
from baselines.listener.masks import Answer  # noqa: E402
from baselines.listener.predict import ListenerMethod  # noqa: E402

CELLS = 63
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
        frame: Any = None
        out.append(RegisteredView(f"frame_{number:03d}", "train", camera, rotation, np.array([x, 0.0, 0.0]), frame))
    return out


def seen(view: RegisteredView) -> Answer:
    """What a perfect eye says: discs of the objects' size."""
    classes = np.full((1 + len(CATEGORIES), CELLS, CELLS), 0.0, np.float32)
    rows, columns = np.mgrid[:CELLS, :CELLS] + 0.5
    for centre, category in OBJECTS:
        x, y, z = (np.array(centre) - view.position) @ view.rotation
        u, v = (view.camera.fx * x / z + view.camera.cx, view.camera.fy * y / z + view.camera.cy)
        classes[1 + category][np.hypot(columns - u, rows - v) < 0.25 * view.camera.fx / z] = 1.0
    classes[0] = 1 - classes[1:].max(axis=0)
    return Answer(np.zeros((CELLS, CELLS), np.float32), classes, np.zeros(len(CATEGORIES), np.float32))


def clip(view: RegisteredView, source: tuple[float, float, float]) -> NDArray[np.float32]:
    """(2, 44100) bursts of noise, delayed as by a sphere."""
    x, _, z = (np.array(source) - view.position) @ view.rotation
    noise = np.random.default_rng(int(view.name[-3:])).normal(size=44_100) * (np.arange(44_100) // 3000 % 2 == 0)
    delay = float(woodworth_delay(torch.tensor(math.atan2(x, z))))
    turn = np.exp(-2j * math.pi * np.fft.rfftfreq(44_100, 1 / 44_100) * delay)
    return 0.1 * np.stack([np.fft.irfft(np.fft.rfft(noise) * turn, 44_100), noise]).astype(np.float32)


@pytest.fixture(scope="module")
def found() -> tuple[list[RegisteredView], Any]:
    views = walk()
    return views, direction_alone.candidates(views, [seen(view) for view in views])


def test_objects_of_the_pictures_become_candidates_where_they_are(found: Any) -> None:
    _, (points, labels, categories) = found
    assert set(np.unique(categories)) == {CLOCK, TELEPHONE}
    large = [label for label in np.unique(labels) if (labels == label).sum() >= 10]
    middles = sorted(tuple(points[labels == label].mean(axis=0).round(1)) for label in large)
    assert len(middles) == len(OBJECTS)
    for middle, (centre, _) in zip(middles, sorted(OBJECTS), strict=True):
        np.testing.assert_allclose(middle, centre, atol=0.35)


@pytest.mark.parametrize("number", range(len(OBJECTS)))
def test_the_walk_tells_which_candidate_sounds_whatever_it_is_called(found: Any, number: int) -> None:
    views, (points, labels, categories) = found
    centre, category = OBJECTS[number]
    choice = spatial.choose(points, labels, views, np.stack([clip(view, centre) for view in views]))
    assert np.linalg.norm(points[choice.chosen].mean(axis=0) - centre) < 0.5
    assert categories[choice.chosen][0] == category


def test_a_frame_keeps_the_component_that_the_chosen_voxels_are_seen_in(found: Any) -> None:
    views, (points, _, _) = found
    model = ListenerMethod(None, torch.device("cpu"), "0" * 64, refine="none")
    left = points[points[:, 0] < -0.6]
    frame: Any = SimpleNamespace(rgb=lambda: np.zeros((126, 126, 3), np.uint8))
    view = views[4]
    mask = direction_alone.DirectionMethod(model)._of_points(frame, seen(view), left, CLOCK, view)
    assert mask[:, :63].any()
    assert not mask[:, 63:].any()
    nothing = direction_alone.DirectionMethod(model)._of_points(frame, seen(view), left, TELEPHONE, view)
    assert not nothing.any()
