"""Conventions of other benchmarks: the values of their released functions, and the quirks that the pages name.

golden/avs_metrics.json has what the released functions gave for the arrays of golden/avs_metrics.npz: 8 clips of 5
frames in batches of 1, 2, 4 and 8 clips, and 20 frames of 6 classes.
"""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avs3d_bench.errors import Avs3dError, UsageError
from evaluators import metrics
from evaluators.metrics.masks import frame_counts, official_f, official_miou

GOLDEN = Path(__file__).parents[1] / "golden"
RELEASED: dict[str, Any] = json.loads((GOLDEN / "avs_metrics.json").read_text())["values"]
BATCHES = (1, 2, 4, 8)


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    with np.load(GOLDEN / "avs_metrics.npz") as found:
        return dict(found)


@pytest.mark.parametrize("clips", BATCHES)
def test_avsbench_is_the_released_code(arrays: dict[str, np.ndarray], clips: int):
    found = metrics.avsbench.evaluate(arrays["truth"], arrays["logits"], clips_per_batch=clips)
    assert found == {
        name: pytest.approx(RELEASED[f"avsbench/batch_{clips}"][name]["mean"], abs=1e-6) for name in ("mIoU", "F")
    }


def test_each_batch_is_the_released_one(arrays: dict[str, np.ndarray]):
    for number, value in enumerate(RELEASED["avsbench/batch_1"]["F"]["per_batch"]):
        clip = slice(5 * number, 5 * number + 5)
        found = metrics.avsbench.evaluate(arrays["truth"][clip], arrays["logits"][clip])
        assert found["F"] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("clips", BATCHES)
def test_ref_avs_is_the_released_code(arrays: dict[str, np.ndarray], clips: int):
    found = metrics.ref_avs.evaluate(arrays["truth"], arrays["logits"], clips_per_batch=clips, frames_per_clip=5)
    released = RELEASED[f"ref_avs/batch_{clips}"]
    assert found == {name: pytest.approx(np.mean(released[name]["per_batch"]), abs=1e-6) for name in ("mIoU", "F", "S")}


@pytest.mark.parametrize("clips", BATCHES)
def test_combo_is_the_released_code(arrays: dict[str, np.ndarray], clips: int):
    probability = 1 / (1 + np.exp(-arrays["logits"].astype(np.float64)))
    found = metrics.combo.evaluate(arrays["truth"], probability, clips_per_batch=clips)
    released = RELEASED[f"combo/batch_{clips}"]
    assert found == {name: pytest.approx(released[name]["mean"], abs=1e-6) for name in ("mIoU", "F")}


def test_avss_is_the_released_code(arrays: dict[str, np.ndarray]):
    given = arrays["semantic_truth"], arrays["semantic_logits"]
    found, released = metrics.avss.evaluate(*given), RELEASED["avss"]
    assert found == {name: pytest.approx(released[name], abs=1e-6) for name in found}
    assert set(found) == {"mIoU", "mIoU_without_last", "F", "F_without_last"}
    assert metrics.avss.frame_mious(*given) == pytest.approx(released["video_mIoU"], abs=1e-6)
    assert metrics.avss.evaluate(given[0], given[1].argmax(axis=1), classes=6) == found


def test_the_figure_beside_depends_neither_on_batches_nor_on_order(arrays: dict[str, np.ndarray]):
    truth, logits = arrays["truth"], arrays["logits"]
    order = np.random.default_rng(1).permutation(len(truth))
    values = {metrics.avsbench.evaluate(truth, logits, clips_per_batch=clips)["F"] for clips in BATCHES}
    assert max(values) - min(values) > 0.005  # of the same masks
    by_frame = np.concatenate([order[order % 5 == k] for k in range(5)])  # other clips, of other frames
    assert metrics.avsbench.evaluate(truth[by_frame], logits[by_frame])["F"] != pytest.approx(0.559, abs=1e-3)
    for convention in (metrics.avsbench, metrics.ref_avs):
        assert convention.order_free(truth[order], logits[order]) == convention.order_free(truth, logits)
    assert metrics.avsbench.order_free(truth, logits)["F"] == pytest.approx(
        RELEASED["avsbench/batch_8"]["F"]["mean"], abs=1e-6
    )
    ids, scores = arrays["semantic_truth"], arrays["semantic_logits"]
    other = order[order < len(ids)]
    assert metrics.avss.order_free(ids[other], scores[other]) == metrics.avss.order_free(ids, scores)


def test_a_short_last_batch_counts_as_much_as_the_others(arrays: dict[str, np.ndarray]):
    truth, logits = arrays["truth"][:15], arrays["logits"][:15]
    first, last = ([a[s] for a in (truth, logits)] for s in (slice(10), slice(10, 15)))
    parts = [metrics.avsbench.evaluate(*part, clips_per_batch=2)["mIoU"] for part in (first, last)]
    assert metrics.avsbench.evaluate(truth, logits, clips_per_batch=2)["mIoU"] == pytest.approx(np.mean(parts))


def test_masks_given_as_logits_score_as_protocol_official(arrays: dict[str, np.ndarray]):
    """What the released 3D pipeline does: the sigmoid of 0 and 1."""
    truth, masks = arrays["truth"] > 0, arrays["logits"] > 1
    counts = [frame_counts(g, p) for g, p in zip(truth, masks, strict=True)]
    found = metrics.avsbench.order_free(truth, masks)
    assert found["F"] == pytest.approx(official_f(counts), abs=1e-12)
    assert found["mIoU"] == pytest.approx(official_miou(counts), abs=1e-12)


def test_probabilities_given_as_logits_are_warned_of(arrays: dict[str, np.ndarray]):
    probability = 1 / (1 + np.exp(-arrays["logits"]))
    with pytest.warns(UserWarning, match=r"all values lie in \[0, 1\].* give log\(p / \(1 - p\)\)"):
        metrics.avsbench.evaluate(arrays["truth"], probability)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        metrics.avsbench.evaluate(arrays["truth"], arrays["logits"])
        metrics.avsbench.evaluate(arrays["truth"], probability > 0.5)


def test_logits_may_have_one_channel(arrays: dict[str, np.ndarray]):
    truth, logits = arrays["truth"], arrays["logits"]
    expected = metrics.avsbench.evaluate(truth, logits)
    assert metrics.avsbench.evaluate(truth, logits[:, None], frames_per_clip=np.int64(5)) == expected


def test_infinite_logits_are_masks():
    truth = np.zeros((5, 6, 6), bool)
    truth[:, :3] = True
    found = metrics.avsbench.evaluate(truth, np.where(truth, np.inf, -np.inf))
    assert found == {"mIoU": pytest.approx(1, abs=1e-6), "F": 1.0}


def test_three_thresholds_of_ref_avs_make_three_masks():
    """A pixel with a sigmoid of 0.45 is marked for mIoU and not for S."""
    truth = np.zeros((5, 4, 4), bool)
    logits = np.full((5, 4, 4), math.log(0.45 / 0.55))
    found = metrics.ref_avs.evaluate(truth, logits, frames_per_clip=5)
    assert found == {"mIoU": 0.0, "F": 0.0, "S": 0.0}


def test_one_wrong_pixel_counts_as_a_frame_of_avss_and_hardly_in_pixels():
    truth = np.zeros((4, 10, 10), np.uint8)
    truth[:, :5] = 1
    found = truth.copy()
    found[1:, 9, 9] = 2  # a class that is nowhere in truth
    truth[0, 9, 9] = found[0, 9, 9] = 2
    assert metrics.avss.evaluate(truth, found, classes=3)["mIoU"] == pytest.approx((1 + 1 + 0.25) / 3, abs=0.01)
    absent = metrics.avss.evaluate(truth, found, classes=4)["mIoU"]
    assert absent == pytest.approx(metrics.avss.evaluate(truth, found, classes=3)["mIoU"] * 3 / 4)
    counted = [metrics.avss.order_free(truth, found, classes=count)["mIoU"] for count in (3, 4)]
    assert counted[0] == counted[1]


def test_the_page_has_the_figures_of_the_golden_arrays(arrays: dict[str, np.ndarray]):
    page = (GOLDEN.parents[1] / "docs/which-number.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines() if line[:1] == "|"]
    for clips in (*BATCHES, "order-free"):
        given = arrays["truth"], arrays["logits"]
        if clips == "order-free":
            figures = [m.order_free(*given) for m in (metrics.avsbench, metrics.ref_avs)]
        else:
            size = {"clips_per_batch": clips, "frames_per_clip": 5}
            figures = [m.evaluate(*given, **size) for m in (metrics.avsbench, metrics.ref_avs)]
        assert [str(clips), *(f"{value:.4f}" for found in figures for value in found.values())] in rows
    semantic = arrays["semantic_truth"], arrays["semantic_logits"]
    for name, found in (
        ("AVSS as", metrics.avss.evaluate(*semantic)),
        ("from the", metrics.avss.order_free(*semantic)),
    ):
        (row,) = [row for row in rows if row[0].startswith(name)]
        assert row[1:] == [f"{found['mIoU']:.4f}", f"{found['F']:.4f}"]


FRAMES = np.zeros((5, 4, 4))


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: metrics.avsbench.evaluate(FRAMES, FRAMES[:4]), "prediction: ends after 4 frames"),
        (
            lambda: metrics.avsbench.evaluate(FRAMES, FRAMES[:, :3]),
            r"shape \(3, 4\), expected that of the truth",
        ),
        (lambda: metrics.avsbench.evaluate(FRAMES + 0.5, FRAMES), "neither 0 nor 1"),
        (lambda: metrics.avsbench.evaluate(FRAMES, FRAMES * np.nan), "frame 0: holds NaN"),
        (lambda: metrics.avsbench.evaluate(FRAMES, FRAMES.astype(str)), "<U32, expected an array of numbers"),
        (lambda: metrics.avsbench.evaluate(FRAMES[0], FRAMES[0]), r"shape \(4, 4\), expected \(N, H, W\)"),
        (lambda: metrics.avsbench.evaluate([], []), "no frame"),
        (lambda: metrics.avsbench.evaluate(3, 4), "a int; expected an array"),
        (lambda: metrics.ref_avs.evaluate(FRAMES, FRAMES), "5 frames are no whole clips of 10; frames_per_clip"),
        (lambda: metrics.avsbench.evaluate(FRAMES, FRAMES, clips_per_batch=0), "clips_per_batch: 0, expected"),
        (lambda: metrics.combo.evaluate(FRAMES, FRAMES + 3), "values from 3 to 3, expected probabilities"),
        (lambda: metrics.avss.evaluate(FRAMES + 7, FRAMES, classes=3), "truth, frame 0: class ids beyond 0 to 2"),
        (lambda: metrics.avss.evaluate(FRAMES, FRAMES), r"shape \(4, 4\), expected \(classes, height, width\)"),
        (lambda: metrics.avss.evaluate(FRAMES, FRAMES + 0.5, classes=3), "not whole"),
        (lambda: metrics.avss.evaluate(FRAMES, FRAMES, classes="3"), "classes: '3', expected a whole number from 2 to"),
    ],
)
def test_bad_input_is_one_line(call: Any, line: str):
    with pytest.raises(Avs3dError, match=line) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_what_was_asked_wrongly_is_a_usage_error():
    with pytest.raises(UsageError, match="no frame"):
        metrics.avss.evaluate([], [])
