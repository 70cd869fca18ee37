"""From frames over observations to means: definitions, null figures with reasons, independence of the order."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.contract.scores import ObservationScores, metrics_of
from evaluators.metrics.contour import boundary_f, contour
from evaluators.metrics.frames import (
    FrameFigures,
    Truth,
    Twin,
    centre_box,
    frame_figures,
    reference_figures,
    truth_figures,
)
from evaluators.metrics.masks import FrameCounts
from evaluators.metrics.volume import VolumeScore
from evaluators.protocols import strict as protocols
from evaluators.protocols.official import official_observation
from evaluators.protocols.strict import strict_observation
from evaluators.references.deaf import DeafFrame, deaf_frame, deaf_references, most_seen
from evaluators.summary import summarise

WHY = {
    "wrong_instance_rate": protocols.ONE_INSTANCE,
    "IoU_3D": protocols.NO_POINTS,
    "centroid_error": protocols.NO_POINTS,
}


def disc(x: int, y: int, radius: int, size: int = 96) -> np.ndarray:
    mask = np.zeros((size, size), np.uint8)
    cv2.circle(mask, (x, y), radius, 255, -1)
    return mask


EMPTY = np.zeros((96, 96), np.uint8)


def figures(truth: np.ndarray, prediction: np.ndarray, *twins: np.ndarray) -> FrameFigures:
    ids = np.zeros(truth.shape, np.uint16)
    for number, twin in enumerate(twins, start=2):
        ids[twin > 0] = number
    ids[truth > 0] = 1
    return frame_figures(Truth.of(truth, ids if twins else None, range(2, 2 + len(twins)), outlines=True), prediction)


def test_iou_and_f_are_means_over_the_frames_where_the_object_is_visible():
    frames = [figures(disc(30, 30, 10), disc(30, 30, 10)), figures(disc(30, 30, 10), EMPTY), figures(EMPTY, EMPTY)]
    scores = strict_observation(frames, None, WHY)
    assert scores.IoU == scores.F == scores.boundary_F == 0.5
    assert (scores.visible_frames, scores.absent_frames, scores.twin_frames) == (2, 1, None)


def test_false_positives_are_counted_where_the_object_is_not_visible():
    quarter = np.zeros((96, 96), np.uint8)
    quarter[:48, :48] = 255
    scores = strict_observation([figures(EMPTY, quarter), figures(EMPTY, EMPTY)], None, WHY)
    assert scores.FP_rate == 0.5
    assert scores.FP_area == 0.125
    assert scores.IoU is scores.F is scores.boundary_F is None
    assert scores.unavailable["IoU"] == protocols.NEVER_VISIBLE


def test_without_empty_frames_there_are_no_false_positive_figures():
    scores = strict_observation([figures(disc(30, 30, 10), EMPTY)], None, WHY)
    assert scores.FP_rate is scores.FP_area is None
    assert scores.unavailable["FP_area"] == protocols.ALWAYS_VISIBLE


def test_a_twin_is_marked_when_more_than_half_of_it_is_covered():
    assert not Twin(visible=10, covered=5).marked
    assert Twin(visible=10, covered=6).marked
    assert Twin(visible=1, covered=1).marked


def test_wrong_instance_rate_counts_frames_that_show_a_twin():
    truth, twin, other = disc(20, 20, 10), disc(70, 70, 10), disc(70, 20, 8)
    frames = [
        figures(truth, truth, twin),  # right
        figures(truth, twin, twin, other),  # wrong
        figures(truth, twin | other, twin, other),  # wrong twice over, one frame
        figures(EMPTY, twin, twin),  # wrong while the object is out of sight
        figures(truth, other, np.zeros_like(twin)),  # no twin in sight
    ]
    scores = strict_observation(frames, None, {})
    assert scores.twin_frames == 4
    assert scores.wrong_instance_rate == 3 / 4


def test_no_twin_in_sight_is_null_and_says_so():
    scores = strict_observation([figures(disc(9, 9, 4), EMPTY, EMPTY)], None, {})
    assert scores.wrong_instance_rate is None
    assert scores.unavailable["wrong_instance_rate"] == protocols.NO_TWIN_SEEN
    assert scores.twin_frames == 0


def test_an_empty_cloud_has_no_centroid():
    scores = strict_observation([figures(disc(9, 9, 4), EMPTY)], VolumeScore(iou=0.0, centroid_error=None), {})
    assert scores.IoU_3D == 0
    assert scores.centroid_error is None
    assert scores.unavailable["centroid_error"] == protocols.EMPTY_CLOUD


def test_every_null_has_a_reason_and_every_reason_a_null():
    for frames in ([figures(EMPTY, EMPTY)], [figures(disc(9, 9, 4), EMPTY)]):
        scores = strict_observation(frames, None, WHY)
        nulls = {m.name for m in metrics_of("strict") if getattr(scores, m.name) is None}
        assert nulls == set(scores.unavailable)


@pytest.mark.parametrize("truth", [EMPTY, disc(48, 48, 20), disc(0, 0, 30), np.full((96, 96), 255, np.uint8)])
@pytest.mark.parametrize("twin", [EMPTY, disc(60, 60, 12)])
def test_reference_figures_are_those_of_real_predictions(truth: np.ndarray, twin: np.ndarray):
    box = np.zeros((96, 96), np.uint8)
    box[centre_box(96, 96)] = 255
    known = Truth.of(truth, np.where(truth, 1, np.where(twin, 2, 0)).astype(np.uint16), (2,), outlines=True)
    references = reference_figures(known)
    for name, prediction in (("all_black", EMPTY), ("all_white", np.full_like(box, 255)), ("centre_box", box)):
        assert references[name] == frame_figures(known, prediction), name


def test_the_truth_as_a_prediction():
    for truth in (EMPTY, disc(48, 48, 20), np.full((96, 96), 255, np.uint8)):
        known = Truth.of(truth, np.where(disc(80, 80, 9), 2, 0).astype(np.uint16), (2,), outlines=True)
        assert truth_figures(known) == frame_figures(known, truth)


def test_deaf_figures_are_those_of_real_predictions():
    truth, twin, far = disc(20, 20, 10), disc(50, 50, 12), disc(80, 80, 5)
    ids = np.zeros((96, 96), np.uint16)
    for number, mask in ((2, twin), (5, far)):
        ids[mask > 0] = number
    known = Truth.of(truth, ids, (2, 5, 9), outlines=True)
    found = deaf_frame(known, sounding=3)
    assert found.category == frame_figures(known, truth | twin | far)
    assert found.nothing == frame_figures(known, EMPTY)
    assert found.single == {number: frame_figures(known, mask) for number, mask in ((3, truth), (2, twin), (5, far))}


def test_the_only_instance_is_the_truth():
    known = Truth.of(disc(20, 20, 10), None, (), outlines=True)
    found = deaf_frame(known, sounding=1)
    assert found.category == found.single[1] == frame_figures(known, known.mask)


def test_the_most_seen_instance_has_the_most_pixels_over_all_frames():
    """Twin 2 is large once, the sounding 3 is smaller but seen twice; equal instances go by id."""
    small, large = disc(20, 20, 9), disc(60, 60, 12)
    shown = [(EMPTY, {2: large}), (small, {}), (small, {})]

    def frames(*chosen: tuple[np.ndarray, dict[int, np.ndarray]]) -> list[DeafFrame]:
        return [deaf_frame(Truth(mask, twins, contour(mask) if mask.any() else None), 3) for mask, twins in chosen]

    assert most_seen(frames(*shown)) == 3
    assert most_seen(frames(*shown[:2])) == 2
    assert most_seen(frames((small, {2: small}))) == 2
    assert most_seen(frames((small, {4: small}))) == 3
    assert most_seen(frames((EMPTY, {}))) is None
    references = deaf_references(frames(*shown[:2]))["deaf_most_seen"]
    assert [frame.counts.predicted for frame in references] == [np.count_nonzero(large), 0]
    assert [frame.counts.predicted for frame in deaf_references(frames((EMPTY, {})))["deaf_most_seen"]] == [0]


def test_the_centre_box_is_a_quarter_of_the_image():
    rows, columns = centre_box(1008, 1008)
    assert (rows, columns) == (slice(252, 756), slice(252, 756))


def test_outlines_are_left_out_when_nobody_asks():
    truth = Truth.of(disc(9, 9, 4), None, (), outlines=False)
    assert truth.contour is None
    assert frame_figures(truth, EMPTY).boundary_f is None


def test_boundary_of_a_frame_is_that_of_its_masks():
    g, p = disc(40, 40, 20), disc(46, 40, 20)
    assert figures(g, p).boundary_f == boundary_f(contour(g), contour(p))


def observation(number: int, iou: float | None, part: str = "part_1") -> ObservationScores:
    truth = 100 if iou is not None else 0
    counts = FrameCounts(1000, truth, truth, round(100 * (iou or 0)))
    frames = [FrameFigures(counts, 0.5 if truth else None)]
    return ObservationScores(
        key=f"{part}/scan/kitchen/{number}", part=part, scan="scan", room="kitchen", category="clock", frames=1,
        official=official_observation(frames), strict=strict_observation(frames, None, WHY),
    )  # fmt: skip


def test_a_mean_goes_over_the_observations_that_have_the_figure():
    group = summarise([observation(1, 1.0), observation(2, 0.0), observation(3, None)])
    assert group.strict.IoU == 0.5
    assert group.strict.counts["IoU"] == 2
    assert group.strict.counts["FP_rate"] == 1
    assert group.strict.counts["IoU_3D"] == 0
    assert group.strict.IoU_3D is None
    assert group.strict.unavailable["IoU_3D"] == protocols.NO_POINTS
    assert group.strict.intervals == {}


def test_a_figure_has_an_interval_from_six_observations_on():
    sure = [observation(number, float(number == 1)) for number in range(1, 7)]
    group = summarise([*sure, observation(7, None)])
    low, high = group.strict.intervals["IoU"]
    assert low == 0.0 < group.strict.IoU < high <= 1.0
    assert "FP_rate" not in group.strict.intervals
    assert summarise(sure[:5]).strict.intervals == {}
    assert summarise(sure[:5]).official.intervals == {}


def test_observations_count_alike_however_many_frames_they_have():
    long = observation(1, 1.0).model_copy(update={"frames": 15})
    assert summarise([long, observation(2, 0.0)]).strict.IoU == 0.5
    assert summarise([long, observation(2, 0.0)]).frames == 16


@given(st.lists(st.one_of(st.none(), st.floats(0, 1)), min_size=1, max_size=8), st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_the_order_of_observations_changes_nothing(ious: list[float | None], random: Any):
    group = [observation(number, iou) for number, iou in enumerate(ious, start=1)]
    assert summarise(random.sample(group, len(group))) == summarise(group)


shapes = st.tuples(st.integers(0, 95), st.integers(0, 95), st.integers(0, 30)).map(
    lambda s: disc(*s) if s[2] else EMPTY
)


@given(st.lists(st.tuples(shapes, shapes, shapes), min_size=1, max_size=6), st.randoms(use_true_random=False))
@settings(max_examples=40)
def test_the_order_of_frames_changes_nothing(masks: list[tuple[np.ndarray, ...]], random: Any):
    frames = [figures(*three) for three in masks]
    shuffled = random.sample(frames, len(frames))
    assert strict_observation(shuffled, None, {}) == strict_observation(frames, None, {})
    assert official_observation(shuffled) == official_observation(frames)


@given(st.lists(shapes, min_size=1, max_size=6))
@settings(max_examples=40)
def test_perfect_masks_score_one_and_mark_nothing_false(masks: list[np.ndarray]):
    scores = strict_observation([figures(mask, mask) for mask in masks], None, WHY)
    if scores.visible_frames:
        assert scores.IoU == scores.boundary_F == 1
        assert scores.F == 1
    if scores.absent_frames:
        assert scores.FP_rate == scores.FP_area == 0


def test_intervals_resample_homes_before_observations():
    """Eighteen observations, three in each of six homes and alike there: the intervals are those of six homes."""
    frame = figures(disc(48, 48, 20), disc(48, 48, 20))
    wrong = figures(disc(48, 48, 20), EMPTY)
    rows = []
    for place in range(18):
        home = place // 3
        frames = [wrong if home % 2 else frame]
        rows.append(
            ObservationScores(
                key=f"part_1/home_{home}/kitchen/{place}", part="part_1", scan=f"home_{home}", room="kitchen",
                category="clock", frames=1, strict=strict_observation(frames, None, WHY),
                official=official_observation(frames),
            )
        )  # fmt: skip
    found = summarise(rows)
    assert found.strict is not None
    assert found.official is not None
    # k of six homes with IoU 1, binomial: .025 lies at k = 1 (P(0) = 1/64), .975 at k = 5.
    assert found.strict.intervals["IoU"] == pytest.approx((1 / 6, 5 / 6))
    assert found.official.intervals["mIoU"] == pytest.approx(found.strict.intervals["IoU"])
    alone = summarise([row.model_copy(update={"scan": "one"}) for row in rows]).strict
    assert alone is not None
    assert alone.intervals["IoU"][0] > 1 / 6, "observations of one home pretend to know more"
