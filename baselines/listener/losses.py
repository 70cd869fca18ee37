"""Losses of the training, and figures of the validation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor
from torch.nn import functional

from avs3d_bench.contract.taxonomy import CATEGORIES
from baselines.listener.augment import Batch
from baselines.listener.masks import LEAST_AREA
from baselines.listener.model import CLASSES, ListenerOutput

#: Weights of the terms.
MASK_WEIGHT, DICE_WEIGHT, CLASS_WEIGHT, AUDIBLE_WEIGHT = 5.0, 1.0, 1.0, 0.5
#: Weight of pixels of the seven categories over those of nothing, in the cross-entropy.
OBJECT_WEIGHT = 5.0
#: As in the benchmark's protocol `listen`: a prediction is right above this IoU; truths differ below it.
RIGHT_IOU = 0.5


@dataclass
class Losses:
    """The terms, means over the batch, before their weights.

    Attributes:
        mask: binary cross-entropy of the mask.
        dice: soft Dice loss of the masks that are not empty.
        classes: cross-entropy and soft Dice loss of the classes of pixels.
        audible: binary cross-entropy of the audible categories.
    """

    mask: Tensor
    dice: Tensor
    classes: Tensor
    audible: Tensor

    @property
    def total(self) -> Tensor:
        """The weighted sum."""
        return (
            MASK_WEIGHT * self.mask
            + DICE_WEIGHT * self.dice
            + CLASS_WEIGHT * self.classes
            + AUDIBLE_WEIGHT * self.audible
        )


def full_size(logits: Tensor, size: tuple[int, int]) -> Tensor:
    """(B, C, H, W) logits at the size of pictures, from stride 2 of padded ones; bilinear."""
    large = functional.interpolate(logits.float(), scale_factor=2.0, mode="bilinear", align_corners=False)
    return large[..., : size[0], : size[1]]


def losses(output: ListenerOutput, batch: Batch) -> Losses:
    """Of a batch. Truths are averaged to the network's stride of 2: a cell may belong to an object in part.

    Without sound (no masks) the terms of sound are 0.
    """
    truth = class_shares(batch.classes)
    size = (truth.shape[-2], truth.shape[-1])
    classes = output.classes.float()[..., : size[0], : size[1]]
    nothing = classes.new_zeros(())
    mask = dice = audible = nothing
    if len(batch.masks):
        logits = output.mask.float()[..., : size[0], : size[1]]
        shares = functional.avg_pool2d(batch.masks.float(), 2)
        mask = functional.binary_cross_entropy_with_logits(logits, shares)
        dice = dice_loss(logits, shares)
        audible = audible_loss(output.audible.float(), batch)
    return Losses(mask, dice, class_loss(classes, truth) + class_dice(classes, truth), audible)


def audible_loss(audible: Tensor, batch: Batch) -> Tensor:
    """Binary cross-entropy of what is heard; names count where they are known, "no name" counts everywhere.

    Args:
        audible: (B·K, categories [+ 1]) logits.
        batch: with its truth.
    """
    weights = batch.named[:, None].float().expand(-1, audible.shape[1]).clone()
    weights[:, len(CATEGORIES) :] = 1
    each = functional.binary_cross_entropy_with_logits(audible, batch.audible[:, : audible.shape[1]], reduction="none")
    return (each * weights).sum() / weights.sum().clamp(min=1)


def class_shares(classes: Tensor) -> Tensor:
    """(B, CLASSES, H/2, W/2) float: shares of each class in cells of 2 × 2 pixels of (B, H, W) classes."""
    hot = functional.one_hot(classes, CLASSES).permute(0, 3, 1, 2)
    return functional.avg_pool2d(hot.float(), 2)


def class_loss(classes: Tensor, truth: Tensor) -> Tensor:
    """Cross-entropy in which pixels of objects count `OBJECT_WEIGHT` times.

    At the minimum of a weighted cross-entropy the odds are as many times too high as the weight says. Here they are
    those of the logits with the weights' logarithm added, so that the logits themselves give the true probabilities.

    Args:
        classes: (B, CLASSES, h, w) logits.
        truth: (B, CLASSES, h, w) share of each class.
    """
    weights = _class_weights(classes)
    weighted = truth * weights
    return -(weighted * (classes + weights.log()).log_softmax(dim=1)).sum() / weighted.sum()


def class_dice(classes: Tensor, truth: Tensor) -> Tensor:
    """1 − soft Dice of each category over the whole batch, the mean over categories.

    Small objects count as much as large ones, which keeps the network from answering "nothing" everywhere. As in
    `class_loss` the weights' logarithm is added.

    Args:
        classes: (B, CLASSES, h, w) logits.
        truth: (B, CLASSES, h, w) share of each class.
    """
    share = (classes + _class_weights(classes).log()).softmax(dim=1)[:, 1:]
    truth = truth[:, 1:]
    both, sums = (share * truth).sum(dim=(0, 2, 3)), (share + truth).sum(dim=(0, 2, 3))
    return (1 - (2 * both + 1) / (sums + 1)).mean()


def _class_weights(classes: Tensor) -> Tensor:
    weights = classes.new_full((CLASSES, 1, 1), OBJECT_WEIGHT)
    weights[0] = 1.0
    return weights


def dice_loss(mask: Tensor, truth: Tensor) -> Tensor:
    """1 − soft Dice (Milletari et al., "V-Net", 3DV 2016), the mean over masks that are not empty; 0 if all are.

    Args:
        mask: (B, H, W) logits.
        truth: (B, H, W) 0 to 1.
    """
    share = mask.sigmoid()
    both, sums = (share * truth).sum(dim=(1, 2)), (share + truth).sum(dim=(1, 2))
    marked = (truth.amax(dim=(1, 2)) > 0).float()
    dice = (2 * both + 1) / (sums + 1)
    return ((1 - dice) * marked).sum() / marked.sum().clamp(min=1)


#: Names of the sums that validation adds up over pictures and devices.
SUMS = (
    "iou", "seen", "false", "unseen", "right_pairs", "pairs", "class_both", "class_either", "audible_right", "sounds",
    "category_iou", "category_seen",
)  # fmt: skip


def measure(output: ListenerOutput, batch: Batch, threshold: float = 0.5) -> dict[str, float]:
    """The sums of `SUMS` over one picture with all its sounds.

    Args:
        output: for one picture.
        batch: of that picture.
        threshold: probability above which a pixel is marked.
    """
    size = (batch.masks.shape[-2], batch.masks.shape[-1])
    marked = _without_small(full_size(output.mask[:, None], size)[:, 0].sigmoid() > threshold)
    truth = batch.masks
    ious = _iou(marked, truth)
    seen = truth.flatten(1).any(dim=1)
    wrong = marked.flatten(1).any(dim=1)
    right = torch.where(seen, ious > RIGHT_IOU, ~wrong)
    pairs = list(_pairs(truth))
    classes = full_size(output.classes, size).softmax(dim=1)
    what = classes.argmax(dim=1)
    # The mask of the category, where one alone is heard: what `marks` hands to a method that lifts masks.
    truly = batch.audible[:, : len(CATEGORIES)]
    named = 1 + truly.argmax(dim=1)
    category = batch.classes == named[:, None, None]
    shown = (truly.sum(dim=1) == 1) & category.flatten(1).any(dim=1)
    of_category = _iou(_without_small(classes[0, named] > threshold), category)
    objects, found = batch.classes > 0, what > 0
    heard = (output.audible[:, : len(CATEGORIES)] > 0) == (truly > 0.5)
    return {
        "iou": float(ious[seen].sum()),
        "seen": float(seen.sum()),
        "false": float((wrong & ~seen).sum()),
        "unseen": float((~seen).sum()),
        "right_pairs": float(sum(bool(right[one] and right[other]) for one, other in pairs)),
        "pairs": float(len(pairs)),
        "class_both": float(((what == batch.classes) & objects).sum()),
        "class_either": float((objects | found).sum()),
        "audible_right": float(heard.all(dim=1).sum()),
        "sounds": float(len(heard)),
        "category_iou": float(of_category[shown].sum()),
        "category_seen": float(shown.sum()),
    }


def _without_small(marked: Tensor) -> Tensor:
    """(B, H, W) bool without masks that are too small as a whole; prediction drops each component that is."""
    height, width = marked.shape[-2:]
    return marked & (marked.flatten(1).sum(dim=1) >= LEAST_AREA * height * width)[:, None, None]


def _iou(one: Tensor, other: Tensor) -> Tensor:
    """(B,) IoU of masks (B, H, W); 1 where both are empty."""
    both, either = (one & other).flatten(1).sum(dim=1), (one | other).flatten(1).sum(dim=1)
    return torch.where(either > 0, both / either.clamp(min=1), torch.ones_like(both, dtype=torch.float32))


def _pairs(truth: Tensor) -> Iterator[tuple[int, int]]:
    """Pairs of sounds whose truths differ."""
    for one, other in combinations(range(len(truth)), 2):
        if float(_iou(truth[one][None], truth[other][None])) < RIGHT_IOU:
            yield one, other


def figures(sums: dict[str, float]) -> dict[str, float | None]:
    """Validation as it is printed: shares, None where there was nothing to measure."""

    def share(part: str, whole: str) -> float | None:
        return round(sums[part] / sums[whole], 4) if sums[whole] else None

    return {
        "iou": share("iou", "seen"),
        "fp_rate": share("false", "unseen"),
        "pair_accuracy": share("right_pairs", "pairs"),
        "class_iou": share("class_both", "class_either"),
        "audible": share("audible_right", "sounds"),
        "category_iou": share("category_iou", "category_seen"),
    }
