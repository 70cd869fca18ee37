"""Voting, decomposition and AISRM: the released pipeline's golden values, closed forms, refusals."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from baselines.echosegnet import aisrm, lift
from baselines.echosegnet import decompose as decomposition
from baselines.echosegnet.decompose import decompose
from baselines.echosegnet.gaussians import Gaussians

GOLDEN = Path(__file__).parents[1] / "golden"


def view(rotation: Any = None, position: Any = (0, 0, 0), size: int = 64, focal: float = 32.0) -> Any:
    return SimpleNamespace(
        name="frame_001",
        camera=Intrinsics(size, size, focal, focal, size / 2, size / 2),
        rotation=np.eye(3) if rotation is None else np.asarray(rotation),
        position=np.asarray(position, dtype=float),
    )


@pytest.fixture(scope="module")
def voting() -> tuple[Any, list[Any], list[np.ndarray]]:
    data = np.load(GOLDEN / "voting.npz")
    views = [view(r, t, focal=float(data["focal"])) for r, t in zip(data["c2w_R"], data["c2w_t"], strict=True)]
    return data, views, list(data["masks"])


def test_votes_are_the_released_ones(voting: tuple[Any, list[Any], list[np.ndarray]]):
    data, views, masks = voting
    found = lift.votes(data["points"], views, masks)
    np.testing.assert_array_equal(found, data["per_view"])
    for tenths in (1, 3, 5, 7, 9):
        np.testing.assert_array_equal(lift.label(found, tenths / 10), data[f"label_{tenths}"])


def test_counting_as_it_goes_gives_the_same(voting: tuple[Any, list[Any], list[np.ndarray]]):
    data, views, masks = voting
    inside, total = lift.vote_counts(data["points"], zip(views, masks, strict=True))
    np.testing.assert_array_equal(inside, (data["per_view"] == 1).sum(axis=1))
    np.testing.assert_array_equal(total, (data["per_view"] >= 0).sum(axis=1))


def test_pixels_are_rounded_half_to_even():
    # u = 32·x + 31.5 at depth 1: x = 1/32 gives 32.5, which goes to 32; x = 3/32 gives 34.5, which goes to 34.
    u, v, seen = lift.pixels_of(np.array([[1 / 32, 0, 1], [3 / 32, 0, 1], [0, 0, -1], [9, 0, 1]]), view())
    assert u.tolist() == [32, 34, 0, 0]
    assert v.tolist()[:2] == [32, 32]
    assert seen.tolist() == [True, True, False, False]


def test_a_point_that_nobody_sees_is_not_labelled():
    behind = lift.votes(np.array([[0.0, 0, -1]]), [view()], [np.ones((64, 64), bool)])
    assert behind.tolist() == [[-1]]
    assert not lift.label(behind, 0.0).any()


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(Avs3dError, match=r"frame_001: a mask of shape \(32, 64\), expected \(64, 64\)"):
        lift.votes(np.zeros((1, 3)), [view()], [np.ones((32, 64), bool)])
    with pytest.raises(Avs3dError, match="NaN"):
        lift.votes(np.full((1, 3), np.nan), [view()], [np.ones((64, 64), bool)])


@given(st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_the_order_of_views_and_points_changes_nothing(random: Any):
    data = np.load(GOLDEN / "voting.npz")
    views = [view(r, t, focal=float(data["focal"])) for r, t in zip(data["c2w_R"], data["c2w_t"], strict=True)]
    order = random.sample(range(len(views)), len(views))
    points = random.sample(range(600), 100)
    found = lift.votes(data["points"][points], [views[i] for i in order], [data["masks"][i] for i in order])
    np.testing.assert_array_equal(lift.label(found), data["label_3"][points])


def test_rule_a_label_needs_more_than_the_threshold():
    ballots = np.array([[1] * 3 + [0] * 7, [1] * 4 + [0] * 6, [1, 1, 1, 0, 0, 0, 0, 0, 0, -1]], np.int8)
    assert lift.label(ballots).tolist() == [False, True, True]  # 3 of 10 is 0.3, 3 of 9 is more
    for tenths in range(1, 10):
        exactly = np.array([[1] * 3 * tenths + [0] * 3 * (10 - tenths)], np.int8)
        assert not lift.label(exactly, tenths / 10).any()


def test_rule_a_point_out_of_view_does_not_vote_and_one_at_depth_zero_has_no_pixel():
    points = np.array([[0.0, 0, 1], [0, 0, -1], [1.1, 0, 1], [0, 0, 0]])
    assert lift.votes(points, [view()], [np.ones((64, 64), bool)]).tolist() == [[1], [-1], [-1], [-1]]


def test_rule_votes_know_no_occlusion():
    points = np.array([[0.0, 0, 1], [0, 0, 50]])
    assert lift.votes(points, [view()], [np.ones((64, 64), bool)]).tolist() == [[1], [1]]


# Decomposition. The view below has a focal length of 320 pixels and its middle between columns 319 and 320.


def wide() -> Any:
    return view(size=640, focal=320.0)


def turned(degrees: float, axis: str = "z") -> torch.Tensor:
    x, y, z, w = Rotation.from_euler(axis, degrees, degrees=True).as_quat()
    return torch.tensor([[w, x, y, z]], dtype=torch.float32)


def needle(x: float, sigma: float = 0.1, *, thin: float = 0.001, rotation: torch.Tensor | None = None) -> Gaussians:
    """A Gaussian at (x, 0, 1) whose long axis is the world's x axis, unless it is turned."""
    return Gaussians(
        means=torch.tensor([[x, 0.0, 1.0]]), log_scales=torch.log(torch.tensor([[sigma, thin, thin]])),
        rotations=turned(0) if rotation is None else rotation, opacities=torch.zeros(1), sh=torch.zeros(1, 1, 3),
    )  # fmt: skip


def left_of(column: int, size: int = 640) -> np.ndarray:
    return np.broadcast_to(np.arange(size) < column, (size, size)).copy()


def released_cut(x: float, column: int) -> tuple[float, float]:
    """(scale factor, move in metres) of `needle` where the mask ends before ``column``, step by step."""
    centre, reach = 320 * x + 319.5, 1.5 * 32.0
    low, high = (int(np.rint(np.clip(end, 0, 639))) for end in (centre - reach, centre + reach))
    if not low < column <= high:
        return 1.0, 0.0
    ratio = (column - low) / (high - low + 1)
    return ratio * 0.8, -0.5 * (1 - ratio) * 3 * 0.1


#: Places of a needle and first columns outside the mask; no end lies half-way between two pixels.
CUTS = [(0.001, 320), (0.101, 320), (-0.121, 320), (0.001, 273), (-0.951, 10), (0.001, 272)]


@pytest.mark.parametrize(("x", "column"), CUTS)
def test_rule_a_gaussian_across_the_edge_is_cut_back_to_its_share(x: float, column: int):
    """Ends 1.5 σ off, clipped and rounded; all three scales × ratio × 0.8; the centre by ½(1 − ratio)·3σ inwards."""
    factor, move = released_cut(x, column)
    found = decompose(needle(x), [wide()], [left_of(column)])
    assert found.scales[0].tolist() == pytest.approx([0.1 * factor, 0.001 * factor, 0.001 * factor], rel=1e-5)
    assert found.means[0].tolist() == pytest.approx([x + move, 0.0, 1.0], abs=1e-6)


def test_the_cuts_above_are_what_they_should_be():
    assert released_cut(0.001, 320) == pytest.approx((0.8 * 48 / 97, -0.15 * 49 / 97))
    assert released_cut(0.001, 272) == (1.0, 0.0)  # its first pixel is column 272: both ends are outside
    assert released_cut(-0.951, 10)[0] == pytest.approx(0.8 * 10 / 64)  # clipped at the image's edge: columns 0 to 63


@pytest.mark.parametrize("x", [-0.5, 0.5])
def test_a_gaussian_on_one_side_is_left_alone(x: float):
    before = needle(x)
    after = decompose(before, [wide()], [left_of(320)])
    assert torch.equal(after.means, before.means)
    assert torch.allclose(after.log_scales, before.log_scales)


def test_rule_every_fourth_view_is_looked_at():
    views, masks = [wide()] * 5, [left_of(0), *[left_of(320)] * 4]
    assert not torch.equal(decompose(needle(0.0), views, masks, every=4).means, needle(0.0).means)  # views 0 and 4
    assert torch.equal(decompose(needle(0.0), views[:4], masks[:4], every=4).means, needle(0.0).means)  # view 0


@pytest.mark.parametrize("degrees", [0, 30, 45, 60, 90, 135, 150])
def test_no_sign_of_an_axis_and_no_direction_of_a_line_matters(degrees: float):
    """Not reproduced: the released code samples a line that runs to the left as if it were vertical."""
    mask = left_of(300)
    half = Rotation.from_euler("z", degrees, degrees=True).apply([1, 0, 0])
    for turn in (turned(degrees), -turned(degrees), turned(degrees + 180)):
        found = decompose(needle(0.0, 0.2, rotation=turn), [wide()], [mask])
        if degrees == 90:
            assert found.means[0].tolist() == [0.0, 0.0, 1.0]
            continue
        moved = found.means[0].numpy() - [0, 0, 1]
        factor = float(found.scales[0, 0]) / 0.2
        # Along the axis, to the left, by ½(1 − ratio)·3σ; the ratio is that of the horizontal line to about a pixel.
        assert np.cross(moved, half) == pytest.approx([0, 0, 0], abs=1e-6)
        assert moved[0] < 0
        assert np.linalg.norm(moved) == pytest.approx(0.5 * (1 - factor / 0.8) * 0.6, rel=1e-5)
        reach = 1.5 * 64 * abs(half[0])
        assert factor / 0.8 == pytest.approx((reach - 19.5) / (2 * reach), abs=1.5 / (2 * reach))


def test_lines_are_counted_as_one_by_one(monkeypatch: pytest.MonkeyPatch):
    """Against a loop over lines and pixels; and the same in blocks."""
    rng = np.random.default_rng(0)
    mask = rng.random((30, 40)) < 0.5
    start, end = rng.integers(0, 30, (2, 50, 2))
    start[(start == end).all(axis=1)] += 1
    expected = []
    for a, b in zip(start, end, strict=True):
        steps = max(abs(b - a))
        pixels = [np.rint(a + k * ((b - a) / steps)).astype(int) for k in range(steps + 1)]
        expected.append(np.mean([mask[row, column] for column, row in pixels]))
    for block in (50_000, 7):
        monkeypatch.setattr(decomposition, "_BLOCK", block)
        assert decomposition._shares(mask, start, end).tolist() == pytest.approx(expected, abs=1e-12)


def test_the_three_d_axis_is_projected_as_a_direction():
    """Not reproduced: the released code projects it as if it were a point. It points away and to the right here."""
    needles = needle(0.6, rotation=turned(-80, "y"))
    found = decompose(needles, [wide()], [left_of(512)])
    moved = found.means[0].numpy() - [0.6, 0, 1]
    axis = Rotation.from_euler("y", -80, degrees=True).apply([1, 0, 0])
    seen = 320 * (axis[0] - 0.6 * axis[2])  # d(column)/ds at x = 0.6, z = 1: away from the camera is to the left
    assert seen < 0 < axis[2]
    assert moved @ axis > 0, "towards the left, where the mask is"


def test_the_covariance_is_projected_without_a_low_pass_filter():
    """σ = 0.01 px: with 0.3 px² added the ends would lie a pixel apart and the round one would be cut."""
    tiny = needle(0.5 / 320, 0.01 / 320, thin=0.01 / 320)
    assert torch.equal(decompose(tiny, [wide()], [left_of(320)]).means, tiny.means)


def test_a_centre_behind_the_camera_has_no_pixel():
    behind = needle(0.0)
    behind = Gaussians(-behind.means, behind.log_scales, behind.rotations, behind.opacities, behind.sh)
    assert torch.equal(decompose(behind, [wide()], [left_of(320)]).means, behind.means)


def test_decomposition_refuses_masks_of_another_size():
    with pytest.raises(Avs3dError, match=r"frame_001: a mask of shape \(64, 64\), expected \(640, 640\)"):
        decompose(needle(0.0), [wide()], [left_of(3, 64)])


# AISRM


@pytest.mark.parametrize("name", ["audio_map", "audio_map_pitched"])
def test_the_intensity_map_is_the_released_one(name: str):
    data = np.load(GOLDEN / f"{name}.npz")
    views = [view(r, t) for r, t in zip(data["c2w_R"], data["c2w_t"], strict=True)]
    np.testing.assert_allclose(aisrm.loudness(data["clips"])[:, 0], data["rms_left"], atol=1e-8)
    np.testing.assert_allclose(aisrm.loudness(data["clips"])[:, 1], data["rms_right"], atol=1e-8)
    found = aisrm.audio_intensity_map(views, data["clips"], data["points"])
    np.testing.assert_allclose(found, data["intensity"], atol=1e-8)


def test_rule_the_heading_is_not_the_forward_axis_of_a_camera_that_rolls():
    turn = Rotation.from_euler("ZX", [40, 50], degrees=True).as_matrix()  # (R[0, 2], R[0, 0]) is not (R[0, 2], R[2, 2])
    angle = np.arctan2(turn[0, 2], turn[0, 0])
    forward = np.arctan2(turn[0, 2], turn[2, 2])
    assert abs(angle - forward) > 0.03
    between = 0.5 * (angle + forward)
    # A point between both headings: to the left of the one and to the right of the other.
    point = np.array([[np.sin(between), 0.0, np.cos(between)], [np.cos(angle), 0, -np.sin(angle)]])
    left = aisrm.audio_intensity_map([view(turn)], [clip(1.0, 0.0)], point)
    side = np.sin(angle) * point[:, 2] - np.cos(angle) * point[:, 0]
    assert left.tolist() == (side > 0).astype(float).tolist()
    assert left[0] != float(np.sin(forward) * point[0, 2] - np.cos(forward) * point[0, 0] > 0)


def test_rule_a_frame_weighs_its_difference_over_the_louder_side():
    points = np.array([[-1.0, 0, 1], [1.0, 0, 1]])
    found = aisrm.audio_intensity_map([view(), view()], [clip(0.8, 0.2), clip(0.5, 1.0)], points)
    left, right = 0.6 / (0.8 + 1e-6), 0.5 / (1.0 + 1e-6)
    assert found.tolist() == pytest.approx([1.0, right / left], rel=1e-12)


def test_rule_the_centre_is_the_weighted_mean_of_what_lies_above_0_85():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]])
    assert aisrm.audio_centre(points, np.array([0.85, 0.86, 1.0])).tolist() == pytest.approx([3.86 / 1.86, 0, 0])
    assert aisrm.audio_centre(points, np.full(3, 0.85)) is None


def blob(x: float, count: int, height: float = 0.0) -> np.ndarray:
    return np.column_stack([x + 0.001 * np.arange(count), np.full(count, height), np.zeros(count)])


def test_rule_a_kept_cluster_has_strictly_more_points_than_mean_plus_half_a_deviation():
    # Sizes 10, 10, 20, 20: mean 15, population deviation 5, limit 17.5; 10 and 20 alone: exactly 17.5 is below 20.
    points = np.concatenate([blob(0, 10), blob(1, 10), blob(2, 20), blob(3, 20)])
    assert aisrm.refine(points, [0.0, 0, 0]).kept == 2
    assert aisrm.refine(points, [0.0, 0, 0]).chosen.nonzero()[0].tolist() == list(range(20, 40))
    # Sizes 7 and 7, and 7, 7, 7: the limit is 7, and 7 is not more.
    assert aisrm.refine(np.concatenate([blob(0, 7), blob(1, 7)]), [0.0, 0, 0]).is_none
    # Of two unequal clusters only the larger is kept, wherever the sound comes from.
    found = aisrm.refine(np.concatenate([blob(0, 8), blob(5, 30)]), [0.0, 0, 0])
    assert (found.kept, found.chosen.nonzero()[0].tolist()) == (1, list(range(8, 38)))


def test_rule_the_nearest_kept_cluster_is_measured_in_the_xz_plane():
    points = np.concatenate([blob(0, 20, height=3.0), blob(1, 20), blob(5, 6)])
    assert aisrm.refine(points, [0.2, 0, 0]).chosen.nonzero()[0].tolist() == list(range(20))


def test_rule_clusters_reach_4_cm_and_need_6_points():
    assert (aisrm.EPS, aisrm.MIN_POINTS) == (0.04, 6)
    sparse = np.column_stack([0.0401 * np.arange(9), np.zeros(9), np.zeros(9)])
    assert aisrm.refine(sparse, [0, 0, 0]).labels.max() == -1
    assert aisrm.refine(blob(0, 5), [0, 0, 0]).labels.max() == -1
    assert aisrm.refine(blob(0, 6), [0, 0, 0]).labels.max() == 0


@pytest.mark.parametrize("number", range(5))
def test_refinement_is_the_released_one(number: int):
    data = np.load(GOLDEN / f"clusters_{number}.npz")
    found = aisrm.refine(data["points"], data["centre"])
    assert (found.kept, found.is_none) == (int(data["n_kept"]), bool(data["is_none"]))
    np.testing.assert_array_equal(found.chosen, data["chosen"])
    assert found.staying.all() == found.is_none


def clip(left: float, right: float) -> np.ndarray:
    return np.array([np.full(100, left), np.full(100, right)])


def test_the_louder_side_is_left_or_right_of_the_heading():
    # Y down, looking along +z: x is to the right.
    points = np.array([[-1.0, 0, 1], [1.0, 0, 1]])
    assert aisrm.audio_intensity_map([view()], [clip(1.0, 0.1)], points).tolist() == [1.0, 0.0]
    assert aisrm.audio_intensity_map([view()], [clip(0.1, 1.0)], points).tolist() == [0.0, 1.0]


def test_silence_and_equal_loudness_say_nothing():
    points = np.array([[-1.0, 0, 1], [1.0, 0, 1]])
    for level in (0.0, 0.5):
        assert aisrm.audio_intensity_map([view()], [clip(level, level)], points).tolist() == [0.0, 0.0]
    assert aisrm.audio_centre(points, np.zeros(2)) is None


def test_the_first_five_clips_are_not_averaged():
    clips = np.stack([clip(float(i), 0.0) for i in range(8)])
    assert aisrm.loudness(clips)[:, 0].tolist() == pytest.approx([0, 1, 2, 3, 4, 2.5, 3.5, 4.5])


def test_no_points_no_clusters():
    assert aisrm.refine(np.zeros((0, 3)), np.zeros(3)).is_none
    scattered = np.arange(30.0).reshape(10, 3)
    assert aisrm.refine(scattered, np.zeros(3)).is_none


def test_malformed_sound_is_refused():
    with pytest.raises(Avs3dError, match="expected"):
        aisrm.loudness(np.zeros((3, 1, 10)))
    with pytest.raises(Avs3dError, match="NaN"):
        aisrm.loudness(np.full((1, 2, 4), np.nan))
    with pytest.raises(Avs3dError, match="1 clips for 2 train views"):
        aisrm.audio_intensity_map([view(), view()], [clip(1, 0)], np.zeros((1, 3)))
