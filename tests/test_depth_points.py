"""Points of depth pictures: they lie on the surfaces, and vote only where nothing hides them."""

from __future__ import annotations

import numpy as np
import pytest

from avs3d_bench.dataset import Dataset
from avs3d_bench.geometry import flip_world
from baselines.echosegnet.lift import vote_share
from baselines.echosegnet.sources import OracleMasks
from baselines.echosegnet.views import RegisteredView, input_views, load_views, train_views
from benchmarks.depth_points import VOXEL, surface_points, visible_votes
from tests import tiny

ROOM = np.array([[-3.0, 0.0, -4.0], [3.0, 2.6, 3.0]])


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> tuple[RegisteredView, ...]:
    """The train views of two microwaves of which one sounds."""
    root = tiny.write_dataset(tmp_path_factory.mktemp("depth"), extras=True, keys=(tiny.MULTI,))
    return train_views(input_views(load_views(Dataset(root)[tiny.MULTI])))


def to_surface(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N,) distance to the surface of a box, from either side."""
    outside = np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=1)
    inside = np.minimum(points - low, high - points).min(axis=1)
    return np.where(outside > 0, outside, inside)


def test_points_lie_on_the_surfaces_of_the_room_and_of_its_objects(seen: tuple[RegisteredView, ...]) -> None:
    points = flip_world(surface_points(seen))
    boxes = [ROOM, *(np.array([box.low, box.high]) for box in tiny.BOXES[tiny.MULTI])]
    distance = np.min([to_surface(points, *box) for box in boxes], axis=0)
    assert len(points) > 1000
    # Half the diagonal of a cube, and depth in whole millimetres.
    assert distance.max() <= VOXEL * np.sqrt(3) / 2 + 0.001
    for _, low, high in ((box.id, np.array(box.low), np.array(box.high)) for box in tiny.BOXES[tiny.MULTI]):
        assert (to_surface(points, low, high) < VOXEL).sum() > 20


def test_votes_of_true_masks_are_those_of_the_object_alone(seen: tuple[RegisteredView, ...]) -> None:
    points = surface_points(seen)
    ballots = (
        (view, np.stack([OracleMasks("sounding").mask(view.frame), np.ones((64, 64), bool)], -1)) for view in seen
    )
    inside, total = visible_votes(points, ((view, ballot.astype(np.float32)) for view, ballot in ballots)).T
    marked = vote_share(inside, total) > 0.5
    box = next(box for box in tiny.BOXES[tiny.MULTI] if box.sounding)
    distance = to_surface(flip_world(points), np.array(box.low), np.array(box.high))
    # The wall behind the object projects into its mask, too: what is hidden does not vote. A pixel is 4 to 8 cm wide.
    assert marked.sum() > 50
    assert np.quantile(distance[marked], 0.9) < 0.02
    assert distance[marked].max() < 0.1
    assert (marked & (distance < 0.02)).sum() > 0.8 * ((distance < 0.02) & (total > 0)).sum()


def test_a_point_counts_for_the_pixels_that_it_covers(seen: tuple[RegisteredView, ...]) -> None:
    view = seen[0]
    points = surface_points([view])
    (total,) = visible_votes(points, [(view, np.ones((64, 64, 1), np.float32))]).T
    depth = ((points - view.position) @ view.rotation)[:, 2]
    expected = (view.camera.fx * VOXEL / depth) ** 2
    np.testing.assert_allclose(total[total > 0], expected[total > 0])
    assert (total > 0).mean() > 0.9
    assert visible_votes(points, []).shape == (len(points), 0)
