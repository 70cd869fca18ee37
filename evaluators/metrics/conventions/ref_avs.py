"""Ref-AVS: J (mIoU) and F of referred objects, and S of null references.

Source: Wang et al., "Ref-AVS: Refer and Segment Objects in Audio-Visual Scenes", ECCV 2024; GeWu-Lab/Ref-AVS,
`utils/metric/utility.py` and `scripts/train.py`.

Quirks: mIoU marks pixels whose sigmoid is above 0.4, where AVSBench has 0.5; S marks those above 0.5, and F sweeps 255
thresholds as AVSBench does, so that the three figures are of three different masks. S is the root of the marked share
of a whole batch, and the root of a mean is not the mean of roots: it depends on the batch size. The released test has
batches of four clips of ten frames, and reports S for the split of null references alone, where the right answer is an
empty mask. All quirks of `avsbench` apply, too. J&F in tables of this benchmark is the mean of mIoU and F, not that of
DAVIS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from evaluators.metrics.conventions.sweep import SweptFrame, batches, over_batches, sweep
from evaluators.metrics.masks import mean

#: A pixel is marked for mIoU if its sigmoid is above this.
MASK_CUT = 0.4


def evaluate(truth: object, logits: object, clips_per_batch: int = 4, frames_per_clip: int = 10) -> dict[str, float]:
    """Compute mIoU, F and S as released, whose test has batches of four clips of ten frames.

    Args:
        truth: as for `avsbench.evaluate`; of null references all empty.
        logits: (N, H, W) real numbers before the sigmoid.
        clips_per_batch: batch size of the test script.
        frames_per_clip: frames of a clip.

    Returns:
        ``mIoU`` and ``F``, in [0, 1], and ``S``, the lower the better, which means something for null references alone.

    Raises:
        UsageError: if the frames do not make whole clips.
        Avs3dError: if shapes, types or values are others: NaN, truths that are not binary.

    Examples:
        >>> import numpy as np
        >>> nothing = np.zeros((10, 4, 4), bool)
        >>> logits = np.full((10, 4, 4), -5.0)
        >>> logits[:, 0] = 5.0
        >>> evaluate(nothing, logits)["S"]
        0.5
    """
    frames = sweep(truth, logits, logits=True, cut=MASK_CUT)
    return _over(batches(frames, clips_per_batch, frames_per_clip))


def order_free(truth: object, logits: object) -> dict[str, float]:
    """Compute mIoU, F and S of all frames as one batch; arguments and errors as for `evaluate`.

    Examples:
        >>> import numpy as np
        >>> order_free(np.zeros((3, 4, 4)), np.full((3, 4, 4), -5.0))["S"]
        0.0
    """
    return _over([sweep(truth, logits, logits=True, cut=MASK_CUT)])


def _over(groups: Sequence[Sequence[SweptFrame]]) -> dict[str, float]:
    null = mean(_null_score(group) for group in groups)
    return over_batches(groups) | {"S": 0.0 if null is None else null}


def _null_score(frames: Sequence[SweptFrame]) -> float:
    """Root of the marked share of all pixels of a batch."""
    return math.sqrt(sum(f.above_half for f in frames) / sum(f.counts.pixels for f in frames))
