"""Pictures into segmentation networks and their masks out, without torchvision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from baselines.foundation.protocols import TextMasks

if TYPE_CHECKING:
    import torch


def read_size(side: Any) -> tuple[int, int]:
    """(height, width) of a configuration's ``image_size``, which is one number or two."""
    if isinstance(side, int):
        return side, side
    height, width = side
    return int(height), int(width)


def masks_at(logits: torch.Tensor, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(N, H, W) bool: where logits (N, h, w), bilinearly resized to (height, width), are positive."""
    import torch

    if not len(logits):
        return np.zeros((0, *size), np.bool_)
    full = torch.nn.functional.interpolate(logits[None].float(), size=size, mode="bilinear", align_corners=False)[0]
    return np.asarray((full > 0).cpu().numpy())


def ordered(masks: Any, scores: Any) -> TextMasks:
    """Masks (N, H, W) and scores (N,), the likeliest first, without empty masks."""
    order = [k for k in np.argsort(-scores, kind="stable") if masks[k].any()]
    return TextMasks(masks[order], scores[order])
