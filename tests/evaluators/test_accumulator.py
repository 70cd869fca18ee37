"""This toolkit's figures for arrays in memory: closed forms, batches and order, soft masks, bad input."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from evaluators import metrics
from evaluators.metrics.frames import Truth, frame_figures
from evaluators.metrics.masks import as_bytes
from evaluators.protocols.strict import strict_observation

RNG = np.random.default_rng(3)
TRUTH = RNG.random((12, 9, 11)) < 0.3
TRUTH[[2, 7]] = False
SOFT = 0.3 * TRUTH + 0.7 * RNG.random(TRUTH.shape)


def test_figures_are_those_of_protocol_strict():
    found = metrics.evaluate(TRUTH, SOFT > 0.5)
    frames = [
        frame_figures(Truth.of(as_bytes(g), None, (), outlines=True), as_bytes(p))
        for g, p in zip(TRUTH, SOFT > 0.5, strict=True)
    ]
    strict = strict_observation(frames, None, {})
    for name in ("IoU", "F", "boundary_F", "FP_rate", "FP_area", "visible_frames"):
        assert found[name] == getattr(strict, name)
    assert found["frames"] == 12
    assert "AP" not in found


def test_a_soft_mask_is_cut_at_the_threshold():
    for threshold in (0.3, 0.5, 0.9):
        soft, hard = metrics.evaluate(TRUTH, SOFT, threshold=threshold), metrics.evaluate(TRUTH, threshold < SOFT)
        assert {name: soft[name] for name in hard} == hard
        assert soft["AP"] == metrics.evaluate(TRUTH, SOFT)["AP"]


@given(st.permutations(range(12)), st.integers(1, 5))
@settings(max_examples=15, deadline=None)
def test_neither_batches_nor_order_change_anything(order: list[int], size: int):
    whole = metrics.Accumulator().update(TRUTH, SOFT).compute()
    parts = metrics.Accumulator()
    for start in range(0, 12, size):
        batch = order[start : start + size]
        parts.update(TRUTH[batch], SOFT[batch])
    assert parts.compute() == whole
    assert whole["temporal_consistency"] is None  # frames of no clip


def test_accumulators_of_processes_are_merged():
    one, other = (metrics.Accumulator().update(TRUTH[s], SOFT[s]) for s in (slice(5), slice(5, 12)))
    merged = pickle.loads(pickle.dumps(other)).merge(one)
    assert merged.compute() == metrics.Accumulator().update(TRUTH, SOFT).compute()
    assert len(merged) == 12


def test_clips_have_a_temporal_consistency_and_iterators_are_one_clip():
    clips = metrics.evaluate(TRUTH.reshape(3, 4, 9, 11), SOFT.reshape(3, 4, 9, 11))
    one = metrics.evaluate(TRUTH, SOFT)
    assert metrics.evaluate(iter(TRUTH), (frame for frame in SOFT)) == one
    assert metrics.evaluate(list(TRUTH), SOFT) == one
    differing = {name for name in one if one[name] != clips[name]}
    assert differing == {"temporal_consistency"}  # the nine pairs inside of clips, not all eleven


def test_temporal_consistency_in_closed_form():
    still = np.zeros((4, 8, 8), bool)
    still[:, 2:6, 2:6] = True
    flicker = still.copy()
    flicker[1::2] = False
    moving = np.stack([np.roll(still[0], 2 * k, axis=1) for k in range(4)])  # halves overlap: IoU 8 / 24
    assert metrics.evaluate(still, still)["temporal_consistency"] == 1
    assert metrics.evaluate(moving, moving)["temporal_consistency"] == 1
    assert metrics.evaluate(still, flicker)["temporal_consistency"] == 0
    assert metrics.evaluate(moving, still)["temporal_consistency"] == pytest.approx(1 / 3)


def test_j_counts_empty_frames_as_davis_does():
    truth, found = np.zeros((4, 8, 8), bool), np.zeros((4, 8, 8), bool)
    truth[0, :4] = truth[1, :4] = True
    found[0, :4] = found[1, :2] = found[2, 0, 0] = True
    result = metrics.evaluate(truth, found)
    assert result["J"] == (1 + 0.5 + 0 + 1) / 4
    assert result["IoU"] == 0.75
    assert result["FP_rate"] == 0.5
    edges = (result["boundary_F"] * 2 + 0 + 1) / 4
    assert result["J&F"] == pytest.approx((result["J"] + edges) / 2)


def test_average_precision_is_that_of_scikit_learn():
    reference = pytest.importorskip("sklearn.metrics", reason="the witness is of the [baselines] extra")
    for levels in (2, 5, 1000):  # with many ties and with none
        soft = (np.round(SOFT * levels) / levels).astype(np.float32)
        for truth, found in zip(TRUTH, soft, strict=True):
            if truth.any():
                expected = reference.average_precision_score(truth.ravel(), found.ravel())
                assert metrics.average_precision(truth, found) == pytest.approx(expected, abs=1e-12)


def test_average_precision_needs_no_threshold():
    values = [metrics.evaluate(TRUTH, f(SOFT.astype(np.float64)))["AP"] for f in (np.square, np.sqrt)]
    assert values[0] == pytest.approx(values[1], abs=1e-12)
    assert metrics.evaluate(TRUTH, TRUTH.astype(float))["AP"] == 1


def test_masks_of_any_type_and_tensors_are_read():
    torch = pytest.importorskip("torch", reason="tensors are torch's")
    hard = SOFT > 0.5
    expected = metrics.evaluate(TRUTH, hard)
    for true, found in [
        (TRUTH.astype(np.float32), hard.astype(np.uint8)),
        (TRUTH * np.uint8(255), hard * np.int64(255)),
        (torch.tensor(TRUTH), torch.tensor(hard)),
    ]:
        assert metrics.evaluate(true, found) == expected
    soft = torch.tensor(SOFT, dtype=torch.float32, requires_grad=True)
    assert metrics.evaluate(torch.tensor(TRUTH)[:, None], soft[:, None])["IoU"] == expected["IoU"]
    half = soft.to(torch.bfloat16)
    assert metrics.evaluate(torch.tensor(TRUTH), half)["AP"] == metrics.evaluate(TRUTH, half.detach().float())["AP"]


def test_nothing_of_a_bad_batch_is_added():
    figures = metrics.Accumulator().update(TRUTH, SOFT)
    before = figures.compute()
    bad = SOFT.copy()
    bad[-1, 0, 0] = np.nan
    with pytest.raises(Avs3dError, match="holds NaN"):
        figures.update(TRUTH, bad)
    assert figures.compute() == before


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: metrics.evaluate(TRUTH, SOFT[:, :5]), r"shape \(5, 11\), expected .*\(9, 11\)"),
        (lambda: metrics.evaluate(TRUTH, SOFT[:3]), "prediction: ends after 3 frames, the other goes on"),
        (lambda: metrics.evaluate(TRUTH, SOFT * 9 - 4), "expected probabilities in .* of logits, 1 / "),
        (lambda: metrics.evaluate(TRUTH, (SOFT * 9).astype(int)), "threshold it"),
        (lambda: metrics.evaluate(SOFT, TRUTH), "truth, frame 0: holds numbers that are neither 0 nor 1"),
        (lambda: metrics.evaluate(TRUTH[0], TRUTH[0]), r"expected \(N, H, W\); of one frame, array\[None\]"),
        (lambda: metrics.evaluate([], []), "no frame to score"),
        (lambda: metrics.evaluate(TRUTH, "masks"), "prediction: a str"),
        (lambda: metrics.evaluate(TRUTH, [None] * 12), "prediction, frame 0: object, expected an array of numbers"),
        (lambda: metrics.evaluate(TRUTH, SOFT, threshold=1.5), "threshold: 1.5, expected a number in"),
        (lambda: metrics.Accumulator().update(TRUTH, SOFT[:3]), r"shape \(3, 9, 11\), expected that of the truth"),
        (lambda: metrics.Accumulator().update(TRUTH[0], SOFT[0]), r"expected \(frames, height, width\)"),
        (lambda: metrics.Accumulator().update(TRUTH, SOFT).update(TRUTH, TRUTH), "masks .* after soft masks"),
        (lambda: metrics.Accumulator().merge(metrics.Accumulator(threshold=0.4)), "threshold 0.4, expected"),
        (lambda: metrics.Accumulator().compute(), "no frame to score: expected at least one; call update"),
    ],
)
def test_bad_input_is_one_line(call: Any, line: str):
    with pytest.raises(Avs3dError, match=line) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_angles_between_directions():
    azimuths = np.array([0.0, 30.0, -170.0, 180.0])
    true = metrics.pointing.from_angles(np.zeros(4))
    np.testing.assert_allclose(
        metrics.pointing.angular_error(true, 3 * metrics.pointing.from_angles(azimuths)), abs(azimuths), atol=1e-12
    )
    tiny = metrics.pointing.angular_error(true, metrics.pointing.from_angles(np.full(4, 1e-7)))
    np.testing.assert_allclose(tiny, 1e-7, rtol=1e-6)  # an arccosine gives 0
    found = metrics.pointing.evaluate(true, metrics.pointing.from_angles(azimuths))
    assert found == {
        "mean": pytest.approx(95), "median": pytest.approx(100), "within_5": 0.25, "within_10": 0.25, "within_20": 0.25,
        "directions": 4,
    }  # fmt: skip


def test_directions_of_pixels_and_the_nearest_pixel_of_a_mask():
    camera = Intrinsics.from_fov(64, 90.0)
    (middle, edge) = metrics.pointing.from_pixels([[32, 32], [64, 32]], camera)
    np.testing.assert_allclose(middle, [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(edge, [0.5**0.5, 0, -(0.5**0.5)], atol=1e-15)
    mask = np.zeros((64, 64), bool)
    mask[30:34, 48:52] = True
    inside = metrics.pointing.from_pixels([[49.2, 31.7]], camera)[0]
    assert metrics.pointing.error_to_mask(mask, inside, camera) == 0
    # Straight ahead: the nearest centre is that of column 48, half a pixel above or below.
    expected = np.degrees(np.arctan(np.hypot(16.5, 0.5) / 32))
    assert metrics.pointing.error_to_mask(mask, [0, 0, -1], camera) == pytest.approx(expected)
    assert metrics.pointing.error_to_mask(mask, [-1, 0, 1], camera) > 90


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: metrics.pointing.evaluate([[0, 0, 0]], [[0, 0, 1]]), r"truth: direction 0 is \[0.0, 0.0, 0.0\]"),
        (lambda: metrics.pointing.evaluate([[0, 0, 1]], [[0, np.nan, 1]]), "prediction: direction 0"),
        (lambda: metrics.pointing.evaluate([[0, 0, 1]], [[0, 0, 1]] * 2), "2 directions, expected as many"),
        (lambda: metrics.pointing.evaluate([0, 0, 1], [0, 0, 1]), r"shape \(3,\), expected \(N, 3\)"),
        (lambda: metrics.pointing.from_angles(["x"]), "azimuth: <U1, expected an array of numbers"),
        (lambda: metrics.pointing.from_angles([1, 2], [1, 2, 3]), "elevation: as many as azimuths"),
        (lambda: metrics.pointing.error_to_mask(np.zeros((8, 8)), [0, 0, -1], Intrinsics.from_fov(8)), "mask: empty"),
    ],
)
def test_bad_directions_are_one_line(call: Any, line: str):
    with pytest.raises(Avs3dError, match=line):
        call()


def test_the_metrics_need_neither_torch_nor_the_rest_of_the_toolkit():
    """Importing them and computing every figure loads numpy and OpenCV, and only errors and values of this project."""
    code = (
        "import sys, numpy as np; from evaluators import metrics; m = np.eye(8, dtype=bool)[None].repeat(5, axis=0)\n"
        "metrics.evaluate(m, m * 0.5); metrics.avsbench.evaluate(m, m); metrics.avss.evaluate(m, m, classes=2)\n"
        "metrics.pointing.evaluate([[0, 0, 1]], [[0, 0, 1]])\n"
        "print(*{n.split('.')[0] for n in sys.modules} & {'torch', 'scipy', 'pydantic', 'click', 'pandas', 'rich'})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
