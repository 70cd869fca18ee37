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

from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics
from baselines.echosegnet import aisrm, lift
from baselines.echosegnet.decompose import decompose
from baselines.echosegnet.gaussians import Gaussians

GOLDEN = Path(__file__).parent / "golden"


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
@settings(max_examples=20, deadline=None)
def test_the_order_of_views_and_points_changes_nothing(random: Any):
    data = np.load(GOLDEN / "voting.npz")
    views = [view(r, t, focal=float(data["focal"])) for r, t in zip(data["c2w_R"], data["c2w_t"], strict=True)]
    order = random.sample(range(len(views)), len(views))
    points = random.sample(range(600), 100)
    found = lift.votes(data["points"][points], [views[i] for i in order], [data["masks"][i] for i in order])
    np.testing.assert_array_equal(lift.label(found), data["label_3"][points])


# Decomposition


def needle(x: float, sigma: float = 0.1, *, thin: float = 0.001) -> Gaussians:
    """A Gaussian at (x, 0, 1) whose long axis is the world's x axis."""
    return Gaussians(
        means=torch.tensor([[x, 0.0, 1.0]]), log_scales=torch.log(torch.tensor([[sigma, thin, thin]])),
        rotations=torch.tensor([[1.0, 0, 0, 0]]), opacities=torch.zeros(1), sh=torch.zeros(1, 1, 3),
    )  # fmt: skip


def left_half() -> np.ndarray:
    mask = np.zeros((64, 64), bool)
    mask[:, :32] = True
    return mask


@pytest.mark.parametrize(("x", "share"), [(0.0, 0.5), (0.15, 0.25), (-0.15, 0.75)])
def test_a_gaussian_across_the_edge_is_cut_back_to_its_share(x: float, share: float):
    # The axis goes from x − 0.3 to x + 0.3; the mask ends at x = 0.
    found = decompose(needle(x), [view()], [left_half()])
    assert float(found.scales[0, 0]) == pytest.approx(0.1 * share * 0.8, rel=0.1)
    assert found.scales[0, 1:].tolist() == pytest.approx([0.001, 0.001])
    # Its centre moves by half of what was cut off, towards the inside.
    assert float(found.means[0, 0]) == pytest.approx(x - (1 - share) * 0.3, abs=0.03)
    assert found.means[0, 1:].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("x", [-0.5, 0.5])
def test_a_gaussian_on_one_side_is_left_alone(x: float):
    before = needle(x)
    after = decompose(before, [view()], [left_half()])
    assert torch.equal(after.means, before.means)
    assert torch.allclose(after.log_scales, before.log_scales)


def test_the_other_end_counts_as_well_and_every_nth_view_is_looked_at():
    mirrored = decompose(needle(0.0), [view()], [~left_half()])
    assert float(mirrored.means[0, 0]) == pytest.approx(0.15, abs=0.03)
    views, masks = [view()] * 5, [np.zeros((64, 64), bool), left_half(), left_half(), left_half(), left_half()]
    assert not torch.equal(decompose(needle(0.0), views, masks, every=4).means, needle(0.0).means)  # views 0 and 4
    assert torch.equal(decompose(needle(0.0), views[:4], masks[:4], every=4).means, needle(0.0).means)  # view 0


def test_an_end_behind_the_camera_has_no_pixel():
    before = needle(0.0)
    behind = Gaussians(
        torch.tensor([[0.0, 0.0, 0.1]]), torch.log(torch.tensor([[0.001, 0.001, 0.1]])), before.rotations,
        before.opacities, before.sh,
    )  # fmt: skip
    assert torch.equal(decompose(behind, [view()], [left_half()]).means, behind.means)


# AISRM


def test_the_intensity_map_is_the_released_one():
    data = np.load(GOLDEN / "audio_map.npz")
    views = [view(r, t) for r, t in zip(data["c2w_R"], data["c2w_t"], strict=True)]
    np.testing.assert_allclose(aisrm.loudness(data["clips"])[:, 0], data["rms_left"], atol=1e-8)
    np.testing.assert_allclose(aisrm.loudness(data["clips"])[:, 1], data["rms_right"], atol=1e-8)
    found = aisrm.audio_intensity_map(views, data["clips"], data["points"])
    np.testing.assert_allclose(found, data["intensity"], atol=1e-8)


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
