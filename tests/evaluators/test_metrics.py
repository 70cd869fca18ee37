"""Figures of masks: the released scoring's golden values, closed forms, and properties."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from avs3d_bench.errors import Avs3dError
from evaluators.metrics.masks import FrameCounts, f_measure, frame_counts, iou, mean, official_f, official_miou

CASES = json.loads((Path(__file__).parents[1] / "golden" / "metrics.json").read_text())["cases"]


def discs(shapes: Any, size: int) -> np.ndarray:
    """The masks of golden/metrics.json: discs [cx, cy, r], or "full"."""
    if shapes == "full":
        return np.ones((size, size), dtype=bool)
    y, x = np.mgrid[0:size, 0:size]
    out = np.zeros((size, size), dtype=bool)
    for cx, cy, r in shapes:
        out |= (x - cx) ** 2 + (y - cy) ** 2 < r**2
    return out


def counts_of(case: dict[str, Any]) -> list[FrameCounts]:
    pairs = zip(case["gt"], case["pred"], strict=True)
    return [frame_counts(discs(g, case["size"]), discs(p, case["size"])) for g, p in pairs]


def test_there_are_24_golden_cases_of_every_kind():
    assert len(CASES) == 24
    assert {case["kind"] for case in CASES} == {
        "jitter", "random", "all_black", "all_white", "perfect", "some_empty_gt", "all_empty_gt_black", "mixed",
    }  # fmt: skip


@pytest.mark.parametrize("number", range(len(CASES)))
def test_official_is_the_released_scoring(number: int):
    case = CASES[number]
    counts = counts_of(case)
    assert official_miou(counts) == pytest.approx(case["mIoU"], abs=1e-6)
    assert official_f(counts) == pytest.approx(case["F"], abs=1e-6)


def sweep(truth: np.ndarray, prediction: np.ndarray) -> np.ndarray:
    """The released sweep for one frame, spelt out: F at 255 thresholds over the sigmoid of the prediction."""
    scores = []
    soft = 1 / (1 + np.exp(-prediction.astype(np.float64)))
    for threshold in np.linspace(0, 1 - 1e-10, 255):
        marked = soft >= threshold
        overlap = (marked & truth).sum()
        p, r = overlap / (marked.sum() + 1e-20), overlap / (truth.sum() + 1e-20)
        scores.append(1.3 * p * r / (0.3 * p + r) if p + r else 0.0)
    return np.array(scores)


masks = hnp.arrays(np.bool_, (9, 11))


@given(st.lists(st.tuples(masks, masks), min_size=1, max_size=4))
@settings(max_examples=60)
def test_two_levels_are_the_whole_sweep(pairs: list[tuple[np.ndarray, np.ndarray]]):
    curves = [sweep(truth, prediction) for truth, prediction in pairs if truth.any()]
    expected = np.mean(curves, axis=0).max() if curves else 0.0
    assert official_f([frame_counts(g, p) for g, p in pairs]) == pytest.approx(expected, abs=1e-9)


@given(masks, masks, st.sampled_from([1, 255]), st.sampled_from([1, 255]))
def test_counts_are_those_of_sets_whatever_stands_for_marked(g: np.ndarray, p: np.ndarray, one: int, other: int):
    found = frame_counts((g * one).astype(np.uint8), (p * other).astype(np.uint8))
    assert found == FrameCounts(g.size, int(g.sum()), int(p.sum()), int((g & p).sum()))
    assert found == frame_counts(g, p)
    assert found.union == (g | p).sum()


def test_counts_of_views_that_are_not_contiguous():
    g, p = np.eye(8, dtype=bool)[:, ::2], np.ones((4, 8), dtype=bool).T
    assert frame_counts(g, p) == FrameCounts(32, 4, 32, 4)


@given(masks, masks)
def test_f_is_the_weighted_harmonic_mean(g: np.ndarray, p: np.ndarray):
    frame = frame_counts(g, p)
    if not frame.overlap:
        assert f_measure(frame) == 0
        return
    precision, recall = frame.overlap / frame.predicted, frame.overlap / frame.truth
    assert f_measure(frame) == pytest.approx(1.3 * precision * recall / (0.3 * precision + recall), rel=1e-12)


@given(masks.filter(lambda m: m.any()))
def test_a_perfect_mask_scores_one(g: np.ndarray):
    frame = frame_counts(g, g)
    assert iou(frame) == 1
    assert f_measure(frame) == 1
    assert official_miou([frame]) == pytest.approx(1, abs=1e-6)
    assert official_f([frame]) == pytest.approx(1, abs=1e-15)


@given(st.lists(st.tuples(masks, masks), min_size=1, max_size=5), st.randoms(use_true_random=False))
@settings(max_examples=50)
def test_the_order_of_frames_changes_nothing(pairs: list[tuple[np.ndarray, np.ndarray]], random: Any):
    frames = [frame_counts(g, p) for g, p in pairs]
    shuffled = random.sample(frames, len(frames))
    assert official_miou(shuffled) == official_miou(frames)
    assert official_f(shuffled) == official_f(frames)


@given(masks)
def test_swapping_black_and_white_turns_a_perfect_mask_into_the_floor(g: np.ndarray):
    frame = frame_counts(g, ~g)
    if not g.any():
        # Nothing to be seen and everything marked.
        assert official_miou([frame]) == 0
        assert official_f([frame]) == 0
        return
    assert iou(frame) == f_measure(frame) == 0
    share = g.mean()
    assert official_f([frame]) == pytest.approx(1.3 * share / (0.3 * share + 1), rel=1e-12)


@given(masks.filter(lambda m: m.any()), masks)
def test_f_as_released_is_never_below_an_all_white_mask(g: np.ndarray, p: np.ndarray):
    share = g.mean()
    assert official_f([frame_counts(g, p)]) >= 1.3 * share / (0.3 * share + 1) - 1e-12


def test_an_all_black_submission_scores_the_share_of_empty_frames():
    empty, seen = np.zeros((4, 4), bool), np.eye(4, dtype=bool)
    frames = [frame_counts(g, empty) for g in (empty, seen, seen, empty, empty)]
    assert official_miou(frames) == pytest.approx(3 / 5, abs=1e-6)


def test_one_pixel_object():
    g, p = np.zeros((1008, 1008), bool), np.zeros((1008, 1008), bool)
    g[500, 3] = p[500, 3] = p[500, 4] = True
    frame = frame_counts(g, p)
    assert iou(frame) == 0.5
    assert f_measure(frame) == pytest.approx(1.3 * 0.5 / (0.3 * 0.5 + 1))


def test_empty_truths_are_left_out_of_f_and_no_truth_at_all_gives_zero():
    empty, seen, full = np.zeros((4, 4), bool), np.eye(4, dtype=bool), np.ones((4, 4), bool)
    assert official_f([frame_counts(seen, seen), frame_counts(empty, full)]) == 1
    assert official_f([frame_counts(empty, empty)]) == 0


def test_nothing_to_score_is_an_error():
    for figure in (official_miou, official_f):
        with pytest.raises(Avs3dError, match="at least one test frame"):
            figure([])


def test_shapes_must_fit():
    with pytest.raises(Avs3dError, match=r"\(3, 4\), expected that of the truth, \(4, 4\)"):
        frame_counts(np.zeros((4, 4), bool), np.zeros((3, 4), bool))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.randoms(use_true_random=False))
def test_mean_does_not_depend_on_the_order(values: list[float], random: Any):
    assert mean(random.sample(values, len(values))) == mean(values)
    assert mean(values) == pytest.approx(math.fsum(values) / len(values))


def test_mean_of_nothing_is_none():
    assert mean([]) is None
