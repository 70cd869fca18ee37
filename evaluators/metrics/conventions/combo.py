"""COMBO-AVS, S4 and MS3: mIoU and F-score of the foreground's probability.

Source: Yang et al., "Cooperation Does Matter: Exploring Multi-Order Bilateral Relations for Audio-Visual Segmentation",
CVPR 2024; yannqi/COMBO-AVS, `models/evaluation/sem_seg_evaluation.py`. Its semantic setting scores as `avss`.

Quirks: the arithmetic is that of `avsbench`, with all its quirks, on the second channel of a softmax over background
and object in place of a sigmoid; give that probability here. Means are taken over the batches of each process, then
over processes, then rounded to four digits: with several GPUs, the same masks can give another figure.
"""

from __future__ import annotations

from evaluators.metrics.conventions.sweep import batches, over_batches, sweep


def evaluate(
    truth: object, probability: object, clips_per_batch: int = 1, frames_per_clip: int = 5
) -> dict[str, float]:
    """Compute mIoU and F as released, of one process and not rounded.

    Args:
        truth: as for `avsbench.evaluate`.
        probability: (N, H, W) of the object, in [0, 1]; or an iterable of (H, W).
        clips_per_batch: batch size of the test script.
        frames_per_clip: frames of a clip.

    Returns:
        ``mIoU`` and ``F``, in [0, 1].

    Raises:
        UsageError: if the frames do not make whole clips.
        Avs3dError: if shapes, types or values are others: NaN, numbers outside of [0, 1].

    Examples:
        >>> import numpy as np
        >>> truth = np.eye(4, dtype=bool)[None].repeat(5, axis=0)
        >>> {name: round(value, 3) for name, value in evaluate(truth, 0.8 * truth).items()}
        {'mIoU': 1.0, 'F': 1.0}
    """
    return over_batches(batches(sweep(truth, probability, logits=False, cut=0.5), clips_per_batch, frames_per_clip))


def order_free(truth: object, probability: object) -> dict[str, float]:
    """Compute mIoU and F of all frames as one batch; arguments and errors as for `evaluate`.

    Examples:
        >>> import numpy as np
        >>> truth = np.eye(4, dtype=bool)[None]
        >>> order_free(truth, 0.8 * truth)["F"]
        1.0
    """
    return over_batches([sweep(truth, probability, logits=False, cut=0.5)])
