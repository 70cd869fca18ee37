"""Random changes of sounds and pictures, sounds without a name, and the calibration."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from avs3d_bench.contract.taxonomy import CATEGORIES  # noqa: E402
from baselines.listener import (  # noqa: E402
    augment,
    calibration,
    direction,
    features,
    losses,
    picture_changes,
    sound_changes,
)
from baselines.listener.batches import UNKNOWN, SoundKind  # noqa: E402
from baselines.listener.calibration import OddsHistogram  # noqa: E402
from baselines.listener.cli import _CHANGES  # noqa: E402
from baselines.listener.model import Listener, match_map  # noqa: E402
from baselines.listener.weights import Calibration, read_weights, save_weights  # noqa: E402
from tests.support.tiny_listener import SMALL  # noqa: E402

GRID = torch.rad2deg(direction.angle_grid())


def bursts(angle: float, seed: int = 0, count: int = 44_100) -> Any:
    """(2, n) bursts of noise from a lateral angle (degrees), by the delay of a sphere."""
    noise = torch.randn(count, generator=torch.Generator().manual_seed(seed)) * 0.1
    noise *= (torch.arange(count) // 3000) % 2 == 0
    delay = direction.woodworth_delay(torch.tensor(math.radians(angle)))
    turn = torch.exp(-2j * math.pi * torch.fft.rfftfreq(count, 1 / 44_100) * delay)
    return torch.stack([torch.fft.irfft(torch.fft.rfft(noise) * turn, count), noise])


def heard_at(sounds: Any) -> Any:
    """Degrees with most votes."""
    response = direction.steered_response(features.spectra(sounds))
    mean_of_votes = len(direction.PHASE_GROUPS) + len(direction.VOTE_GROUPS) - 1
    return GRID[response[:, mean_of_votes].argmax(dim=1)]


def test_no_change_but_timing_moves_a_sound() -> None:
    sounds = torch.stack([bursts(angle, seed) for seed, angle in enumerate((-45, -20, 0, 20, 45, 60))])
    before = heard_at(sounds)
    for seed in range(3):
        after = heard_at(sound_changes.changed_sounds(sounds, torch.Generator().manual_seed(seed), ("timing",)))
        assert (after - before).abs().max() <= 9
    disguise = sound_changes.disguised(sounds, sounds.roll(1, 0))
    assert (heard_at(disguise) - before).abs().max() <= 9


def test_timing_moves_high_frequencies_alone_and_changes_no_level() -> None:
    click = torch.zeros(60, 2, 8192)
    click[:, :, 4000] = 1.0
    only = set(sound_changes.SOUND_CHANGES) - {"timing"}
    found = torch.fft.rfft(sound_changes.changed_sounds(click, torch.Generator().manual_seed(0), only))
    frequency = torch.fft.rfftfreq(8192, 1 / 44_100)
    # Of a click, the phase between the ears from bin to bin is the delay.
    between = (found[:, 0] * found[:, 1].conj()).angle()
    slope = (torch.diff(between) + math.pi) % (2 * math.pi) - math.pi
    delay = slope * 8192 / (2 * math.pi * 44_100)
    torch.testing.assert_close(found[..., 1:-1].abs(), torch.ones_like(found[..., 1:-1].abs()), atol=1e-3, rtol=0)
    low, high = frequency[1:] < 190, (frequency[1:] > 2050) & (frequency[1:] < 15_000)
    assert delay[:, low].abs().max() < 2e-6
    moved = delay[:, high].mean(dim=1)
    assert (delay[:, high] - moved[:, None]).abs().max() < 5e-6
    assert 0.1 < (moved.abs() > 5e-6).float().mean() < 0.4
    assert 2e-4 < moved.abs().max() < 3e-4 + 5e-6
    assert (moved > 5e-6).any()
    assert (moved < -5e-6).any()


@pytest.mark.parametrize("name", sound_changes.SOUND_CHANGES)
def test_each_change_of_sounds_can_be_left_out_and_depends_on_the_seed_alone(name: str) -> None:
    sounds = torch.stack([bursts(30, seed, 8192) for seed in range(6)])
    others = set(sound_changes.SOUND_CHANGES) - {name}
    alone = [sound_changes.changed_sounds(sounds, torch.Generator().manual_seed(s), others) for s in (0, 0, 1)]
    assert torch.equal(alone[0], alone[1])
    assert not torch.allclose(alone[0], alone[2])
    nothing = sound_changes.changed_sounds(sounds, torch.Generator().manual_seed(0), sound_changes.SOUND_CHANGES)
    torch.testing.assert_close(nothing, sounds, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", picture_changes.PICTURE_CHANGES)
def test_each_change_of_pictures_can_be_left_out(name: str) -> None:
    pictures = torch.rand(8, 3, 20, 20, generator=torch.Generator().manual_seed(0))
    objects = torch.zeros(8, 20, 20, dtype=torch.bool)
    others = set(picture_changes.PICTURE_CHANGES) - {name}
    changed = picture_changes.changed_pictures(pictures, objects, torch.Generator().manual_seed(0), others)
    assert changed.shape == pictures.shape
    assert 0.003 < (changed - pictures).abs().mean() < 0.3
    every = picture_changes.PICTURE_CHANGES
    same = picture_changes.changed_pictures(pictures, objects, torch.Generator().manual_seed(0), every)
    assert torch.equal(same, pictures)


def test_clutter_is_around_objects_and_gives_a_flat_wall_the_spectrum_of_its_slope() -> None:
    pictures = torch.full((64, 3, 64, 64), 0.5)
    objects = torch.zeros(64, 64, 64, dtype=torch.bool)
    objects[:, 20:40, 20:40] = True
    changed = picture_changes.cluttered(pictures, objects, torch.Generator().manual_seed(0))
    change = (changed - pictures).abs().mean(dim=1)
    moved = change.flatten(1).any(dim=1)
    assert 0.25 < moved.float().mean() < 0.55
    inside, outside = change[moved][:, 22:38, 22:38].mean(), change[moved][:, :16].mean()
    assert 0.1 < inside / outside < 0.5
    flat = picture_changes.cluttered(pictures, torch.zeros_like(objects), torch.Generator().manual_seed(0))[moved].mean(
        1
    )
    power = torch.fft.rfft2(flat - flat.mean(dim=(1, 2), keepdim=True)).abs().square()[:, 0]
    slopes = torch.log2(power[:, 16:32].mean(dim=1) / power[:, 4:8].mean(dim=1)) / 2
    low, high = (-slope for slope in picture_changes.SLOPES)
    assert high - 0.8 < slopes.min() < slopes.max() < low + 0.8


def test_the_command_names_all_changes() -> None:
    assert set(_CHANGES) == set(augment.CHANGES)


def test_the_end_of_a_spectrum_lies_between_3_and_20_kilohertz() -> None:
    sounds = torch.zeros(40, 2, 44_100)
    sounds[:, :, 100] = 1.0
    only = set(sound_changes.SOUND_CHANGES) - {"band"}
    found = torch.fft.rfft(sound_changes.changed_sounds(sounds, torch.Generator().manual_seed(0), only)).abs()
    power = found[:, 0].square()
    assert (power[:, 600:2500].mean(dim=1) > 0.3).all()  # what lies between is kept
    ended = power[:, 21_000] < 0.1
    assert 0.2 < ended.float().mean() < 0.8


def test_a_disguise_takes_the_rhythm_of_the_other_sound() -> None:
    steady = torch.randn(1, 2, 44_100, generator=torch.Generator().manual_seed(0)) * 0.1
    found = sound_changes.disguised(steady, bursts(0)[None])
    loud = found[0, 0, :42_000].view(14, 3000)[:, 1200:1800].square().mean(dim=1)
    assert loud[::2].min() > 20 * loud[1::2].max()


def test_a_disguised_sound_keeps_its_mask_and_loses_its_name() -> None:
    sounds = torch.stack([bursts(30, seed, 8192) for seed in range(8)])
    kinds = torch.tensor([SoundKind.OWN, SoundKind.FOREIGN] * 4)
    audible = torch.zeros(8, len(CATEGORIES) + 1)
    audible[:, 2] = 1
    batch = augment.Batch(
        torch.zeros(2, 3, 8, 8), torch.zeros(2, 8, 8, dtype=torch.int64), torch.ones(2, 4), sounds,
        torch.ones(8, 8, 8, dtype=torch.bool), audible, torch.ones(8, dtype=torch.bool), kinds,
    )  # fmt: skip
    seen = 0
    for seed in range(10):
        found = augment.hidden(batch, torch.Generator().manual_seed(seed))
        changed = (found.sounds != sounds).flatten(1).any(dim=1)
        seen += int(changed.sum())
        assert (found.named == ~changed).all()
        assert (found.audible[:, UNKNOWN] == changed).all()
        assert not changed[kinds == SoundKind.FOREIGN].any()
        assert torch.equal(found.masks, batch.masks)
    assert seen


def test_names_that_are_not_known_cost_nothing() -> None:
    audible = torch.zeros(2, len(CATEGORIES) + 1)
    none, named = torch.zeros(0), torch.tensor([True, False])
    batch = augment.Batch(none, none, none, none, none, audible, named, torch.zeros(2))
    one, other = torch.zeros(2, len(CATEGORIES) + 1), torch.zeros(2, len(CATEGORIES) + 1)
    other[1, :UNKNOWN] = 5.0
    assert losses.audible_loss(one, batch) == losses.audible_loss(other, batch)
    other[1, UNKNOWN] = 5.0
    assert losses.audible_loss(one, batch) < losses.audible_loss(other, batch)


def test_what_has_no_name_may_be_any_object() -> None:
    classes = torch.full((1, 1 + len(CATEGORIES), 1, 2), -20.0)
    classes[0, 3, 0, 0] = classes[0, 0, 0, 1] = 20.0  # an object, and nothing
    audible = torch.full((2, len(CATEGORIES) + 1), -20.0)
    audible[1, UNKNOWN] = 20.0
    found = match_map(classes, audible)[:, 0, 0]
    torch.testing.assert_close(found, torch.tensor([[0.0, 0.0], [1.0, 0.0]]), atol=1e-4, rtol=0)


def sure(frames: int, looks: int, warm: float) -> tuple[torch.Tensor, torch.Tensor]:
    """(frames, looks, 8, 8) log-odds that are ``warm`` times too large where the looks agree, and their truths."""
    odds = torch.randn(frames, 1, 8, 8, generator=torch.Generator().manual_seed(0)) * 2
    truth = torch.bernoulli(odds[:, 0].sigmoid(), generator=torch.Generator().manual_seed(1))
    return warm * odds.expand(-1, looks, -1, -1), truth


@pytest.mark.parametrize("looks", [1, 2])
def test_a_temperature_makes_sure_probabilities_true(looks: int) -> None:
    odds, truth = sure(1000, looks, 3)
    assert calibration.temperature(odds, truth, torch.ones(1000)) == pytest.approx((3, 0), rel=0.05, abs=0.1)
    warm, bias = calibration.temperature(odds + 2, truth, torch.ones(1000))
    assert (warm, bias) == pytest.approx((3, 2), rel=0.05, abs=0.1)
    before, after = OddsHistogram.empty("cpu"), OddsHistogram.empty("cpu")
    before.add(odds[:, 0], truth)
    after.add(odds[:, 0] / 3, truth)
    assert after.error() < 0.02 < 0.1 < before.error()


def test_looks_that_disagree_need_a_lower_temperature_than_each_alone() -> None:
    """The mean of two looks is less sure than each, so that less is to be taken from them."""
    odds = torch.randn(4000, 2, 4, 4, generator=torch.Generator().manual_seed(0)) * 2
    truth = torch.bernoulli(odds.sum(dim=1).sigmoid(), generator=torch.Generator().manual_seed(1))
    both, one = (calibration.temperature(each, truth, torch.ones(4000))[0] for each in (odds, odds[:, :1]))
    assert both < one


def test_rare_frames_count_as_much_as_their_weight_says() -> None:
    """Frames that are three times too sure, and one in ten of others that are right: equal sums meet between both."""
    odds, truth = sure(1000, 1, 1)
    odds[:900] *= 3
    shown = np.arange(1000) < 900
    equal = torch.from_numpy(calibration.equal_weights(shown, ["part_1/home/room/1/frame_000"] * 1000)).float()
    assert equal[:900].sum() == pytest.approx(1) == equal[900:].sum()
    found = [calibration.temperature(odds, truth, each)[0] for each in (equal, torch.ones(1000))]
    assert 1 < found[0] < found[1] < 3


def test_the_best_rule_has_the_largest_iou_less_false_marks() -> None:
    rules = [
        {"threshold": 0.3, "share": 0.5, "iou": 0.6, "false": 0.4},
        {"threshold": 0.5, "share": 0.5, "iou": 0.5, "false": 0.1},
        {"threshold": 0.5, "share": 0.7, "iou": 0.4, "false": 0.1},
        {"threshold": 0.9, "share": 0.5, "iou": 0.1, "false": 0.0},
    ]
    assert calibration.best_rule(rules) == (0.5, 0.5)


def test_the_first_of_the_best_thresholds_of_a_category_is_taken_and_the_usual_one_without_figures() -> None:
    worth = [None] * len(calibration.CHOICES)
    assert calibration._best(worth, 0.5) == 0.5
    worth[2:5] = [0.1, 0.7, 0.7]
    assert calibration._best(worth, 0.5) == calibration.CHOICES[3]


def test_weights_keep_their_calibration_and_older_ones_have_none(tmp_path: Path) -> None:
    said = Calibration(1.7, 2.5, 0.4, 0.3, 0.6, 1.5, 756)
    save_weights(Listener(replace(SMALL, unknown=True)), tmp_path / "new.safetensors", said)
    found = read_weights(tmp_path / "new.safetensors")
    assert (found.calibration, found.network.widths.unknown) == (said, True)
    packaged = read_weights()
    assert packaged.calibration is None or packaged.calibration.checked()
