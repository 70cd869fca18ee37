"""The part that AVSBench, Ref-AVS and COMBO-AVS share: mIoU at one threshold and F over 255, batch by batch."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError
from evaluators.metrics.inputs import paired_frames, probabilities, real_numbers, truth_mask, whole_number
from evaluators.metrics.masks import FrameCounts, Ints, best_mean_f, mean, official_miou
from evaluators.metrics.soft import counts_at

#: Thresholds of the F-measure. The released code ends at 1 − 1e-10, which is 1 in its single precision.
THRESHOLDS = np.linspace(0.0, 1.0, 255).astype(np.float32)


@dataclass(frozen=True, eq=False)
class SweptFrame:
    """The counts of one frame.

    Attributes:
        counts: of the mask that mIoU looks at.
        predicted: (255,) marked pixels at each of `THRESHOLDS`.
        overlap: (255,) of these, the true ones.
        above_half: pixels whose probability is above 0.5.
    """

    counts: FrameCounts
    predicted: Ints
    overlap: Ints
    above_half: int


def sweep(truth: object, prediction: object, *, logits: bool, cut: float) -> list[SweptFrame]:
    """Count every frame.

    Args:
        truth: (N, H, W) binary masks, or an iterable of (H, W).
        prediction: likewise, real numbers.
        logits: whether to take their sigmoid; else they are probabilities.
        cut: a pixel is marked for mIoU if its probability is above this.

    Raises:
        UsageError: if one is no sequence of frames, or there is none.
        Avs3dError: if shapes, types or values are others, or numbers of frames differ.
    """
    frames, like_probabilities, binary = [], True, True
    for where, true_frame, found in paired_frames(truth, prediction):
        mask = truth_mask(true_frame, where)
        if logits:
            numbers = real_numbers(found, mask.shape, where)
            inside = (numbers >= 0) & (numbers <= 1)
            like_probabilities = like_probabilities and bool(inside.all())
            binary = binary and not (inside & (numbers > 0) & (numbers < 1)).any()
            probability = _sigmoid(numbers)
        else:
            probability = probabilities(found, mask.shape, where)
        frames.append(_swept_frame(mask, probability, np.float32(cut)))
    if not frames:
        raise UsageError("truth: no frame; expected at least one")
    if logits and like_probabilities and not binary:
        # Masks of 0 and 1 are no mistake: the released 3D pipeline gives them.
        warnings.warn(
            "logits: all values lie in [0, 1], as those of probabilities; their sigmoid is at least 0.5: every pixel "
            "is marked. Of probabilities p, give log(p / (1 - p)).",
            stacklevel=3,
        )
    return frames


def _sigmoid(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """In double precision and then rounded: nearest to what any library gives in single precision."""
    with np.errstate(over="ignore"):
        return np.asarray(1.0 / (1.0 + np.exp(-logits.astype(np.float64))), dtype=np.float32)


def _swept_frame(mask: NDArray[np.bool_], probability: NDArray[np.float32], cut: np.float32) -> SweptFrame:
    marked = probability > cut
    counts = FrameCounts(mask.size, *(int(np.count_nonzero(m)) for m in (mask, marked, mask & marked)))
    predicted, overlap = counts_at(THRESHOLDS, mask, probability)
    return SweptFrame(counts, predicted, overlap, int(np.count_nonzero(probability > 0.5)))


def batches(frames: Sequence[SweptFrame], clips_per_batch: int, frames_per_clip: int) -> list[Sequence[SweptFrame]]:
    """The frames of each batch; the last one may hold fewer clips.

    Raises:
        UsageError: if a number is none, or the frames do not make whole clips.
    """
    clips = whole_number(clips_per_batch, "clips_per_batch", 1)
    length = whole_number(frames_per_clip, "frames_per_clip", 1)
    if len(frames) % length:
        raise UsageError(
            f"{len(frames)} frames are no whole clips of {length}; frames_per_clip says how many a clip has"
        )
    step = clips * length
    return [frames[start : start + step] for start in range(0, len(frames), step)]


def batch_f(frames: Sequence[SweptFrame]) -> float:
    """F of one batch: the best of 255 thresholds for all its frames together."""
    truth = np.array([frame.counts.truth for frame in frames])
    return best_mean_f(truth, np.stack([f.predicted for f in frames]), np.stack([f.overlap for f in frames]))


def over_batches(groups: Sequence[Sequence[SweptFrame]]) -> dict[str, float]:
    """Compute mIoU and F as means over batches, each batch counting once, however many clips it holds."""
    scores = {
        "mIoU": mean(official_miou([frame.counts for frame in group]) for group in groups),
        "F": mean(batch_f(group) for group in groups),
    }
    return {name: value for name, value in scores.items() if value is not None}
