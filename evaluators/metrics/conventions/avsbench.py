"""AVSBench, S4 and MS3: M_J (mIoU) and M_F (F-score) as its released test scripts compute them.

Source: Zhou et al., "Audio-Visual Segmentation", ECCV 2022; OpenNLPLab/AVSBench, `avs_scripts/avs_ms3/test.py` and
`utils/utility.py` (`mask_iou`, `Eval_Fmeasure`; those of `avs_s4` compute the same).

Quirks: F takes the best of 255 thresholds on the truth of each batch, so that it depends on the batch size and on which
clips meet in a batch, and is a maximum that no fixed threshold reaches. Means run over batches: a last batch with fewer
clips counts as much as the others. A frame with an empty truth scores the share of its pixels left unmarked in mIoU,
and is left out of F, where false alarms therefore cost nothing; a batch without any object has F = 0. The code takes
the sigmoid of whatever it gets: given masks of 0 and 1 instead of logits, every pixel counts as marked up to threshold
0.5, and F never falls below that of an all-white mask (the protocol ``official`` of this toolkit).
"""

from __future__ import annotations

from evaluators.metrics.conventions.sweep import batches, over_batches, sweep


def evaluate(truth: object, logits: object, clips_per_batch: int = 1, frames_per_clip: int = 5) -> dict[str, float]:
    """Compute mIoU and F as released, whose test scripts use batches of one clip of five frames.

    Args:
        truth: (N, H, W) binary masks (bool, or 0 and 1, or 0 and 255), the frames of each clip together; or an iterable
            of (H, W).
        logits: (N, H, W) real numbers before the sigmoid, or an iterable; −inf and inf are allowed.
        clips_per_batch: batch size of the test script.
        frames_per_clip: frames of a clip.

    Returns:
        ``mIoU`` and ``F``, in [0, 1].

    Raises:
        UsageError: if the frames do not make whole clips.
        Avs3dError: if shapes, types or values are others: NaN, truths that are not binary.

    Examples:
        >>> import numpy as np
        >>> truth = np.zeros((10, 4, 4), bool)
        >>> truth[:, :2] = True
        >>> logits = np.where(truth, 2.0, -2.0)
        >>> logits[5:, 0] = -1.0
        >>> {name: round(value, 3) for name, value in evaluate(truth, logits).items()}
        {'mIoU': 0.75, 'F': 1.0}
    """
    return over_batches(batches(sweep(truth, logits, logits=True, cut=0.5), clips_per_batch, frames_per_clip))


def order_free(truth: object, logits: object) -> dict[str, float]:
    """Compute mIoU and F of all frames as one batch: one threshold for the whole set, whatever the batches and order.

    Arguments and errors as for `evaluate`.

    Examples:
        >>> import numpy as np
        >>> truth = np.zeros((6, 4, 4), bool)
        >>> truth[:3, :2] = True  # three frames with an object and three without, in no clips
        >>> order_free(truth, np.where(truth, 2.0, -2.0))["F"]
        1.0
    """
    return over_batches([sweep(truth, logits, logits=True, cut=0.5)])
