"""The boundary F-measure, compared with shapes of known outline and with a brute-force implementation."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from evaluators.metrics.contour import boundary_f, contour, found, tolerance


def square(size: int, top: int, left: int, side: int) -> np.ndarray:
    mask = np.zeros((size, size), np.uint8)
    mask[top : top + side, left : left + side] = 255
    return mask


def score(truth: np.ndarray, prediction: np.ndarray) -> float:
    return boundary_f(contour(truth), contour(prediction))


def edge(mask: np.ndarray) -> np.ndarray:
    """Boundary pixels, by the definition: (n, 2) rows and columns."""
    out = []
    for row, column in np.argwhere(mask):
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= r < mask.shape[0] and 0 <= c < mask.shape[1] and not mask[r, c]:
                out.append((row, column))
                break
    return np.array(out).reshape(-1, 2)


def witness(truth: np.ndarray, prediction: np.ndarray) -> float:
    g, p = edge(truth), edge(prediction)
    if not len(g) or not len(p):
        return float(len(g) == len(p))
    close = ((g[:, None] - p[None]) ** 2).sum(-1) <= tolerance(*truth.shape) ** 2
    precision, recall = close.any(0).mean(), close.any(1).mean()
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def test_tolerance_is_twelve_pixels_at_full_size():
    assert tolerance(1008, 1008) == 12
    assert tolerance(96, 96) == 2
    assert tolerance(1, 1) == 1


def test_a_square_has_the_outline_of_a_square():
    assert contour(square(64, 10, 12, 20)).length == 4 * 19


def test_the_edge_of_the_image_is_no_boundary():
    assert contour(square(64, 0, 0, 64)).length == 0
    assert contour(square(64, 0, 0, 20)).length == 2 * 20 - 1
    assert contour(square(64, 44, 44, 20)).length == 2 * 20 - 1


def test_a_shift_within_the_tolerance_costs_nothing_and_one_beyond_everything():
    size = 252
    reach = tolerance(size, size)
    still = square(size, 60, 60, 100)
    assert score(still, square(size, 60, 60 + reach, 100)) == 1
    assert score(still, square(size, 60, 60 + reach + 1, 100)) < 1
    assert score(square(size, 10, 10, 30), square(size, 100, 100, 30)) == 0


def test_no_boundary_on_one_side_or_on_both():
    full, empty, some = np.full((32, 32), 255, np.uint8), np.zeros((32, 32), np.uint8), square(32, 8, 8, 8)
    assert score(some, full) == score(some, empty) == score(full, some) == 0
    assert score(full, full) == score(full, empty) == 1


def test_a_hole_has_a_boundary_too():
    ring = square(64, 10, 10, 40)
    ring[25:35, 25:35] = 0
    assert contour(ring).length == 4 * 39 + 4 * 10
    assert contour(ring).length > contour(square(64, 10, 10, 40)).length


masks = hnp.arrays(np.uint8, st.tuples(st.integers(1, 14), st.integers(1, 14)), elements=st.sampled_from([0, 0, 255]))


@given(st.data())
@settings(max_examples=150)
def test_it_is_the_definition(data: st.DataObject):
    truth = data.draw(masks)
    prediction = data.draw(hnp.arrays(np.uint8, truth.shape, elements=st.sampled_from([0, 255])))
    assert score(truth, prediction) == pytest.approx(witness(truth, prediction), abs=1e-12)


@given(masks)
def test_a_perfect_outline_scores_one(mask: np.ndarray):
    assert score(mask, mask) == 1


def test_large_shapes_agree_with_the_witness():
    rng = np.random.default_rng(3)
    for _ in range(5):
        pair = []
        for _ in range(2):
            y, x = np.mgrid[0:200, 0:260]
            cy, cx, a, b = rng.integers(20, 180), rng.integers(20, 240), rng.integers(5, 60), rng.integers(5, 60)
            pair.append((((y - cy) / a) ** 2 + ((x - cx) / b) ** 2 < 1).astype(np.uint8) * 255)
        assert score(*pair) == pytest.approx(witness(*pair), abs=1e-12)


@pytest.mark.parametrize("size", [64, 1008, 2000])
def test_a_disc_and_distances_find_the_same(size: int, monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(size)
    mask = (rng.random((size, size)) < 3 / size).astype(np.uint8) * 255
    found_ = []
    for limit in (0, 100):
        monkeypatch.setattr(import_module("evaluators.metrics.contour"), "DISC_LIMIT", limit)
        found_.append(contour(mask).near > 0)
    assert np.array_equal(*found_)
    assert 0 < found_[0].mean() < 1


def test_found_counts_only_where_the_crops_meet():
    a, b = contour(square(200, 10, 10, 10)), contour(square(200, 150, 150, 10))
    assert found(a, b) == found(b, a) == 0
    assert found(a, a) == a.length
