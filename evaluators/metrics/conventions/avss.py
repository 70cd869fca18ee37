"""AVSBench-semantic (AVSS): mIoU and F-score of classes.

Source: Zhou et al., "Audio-Visual Segmentation with Semantics", 2023 (IJCV 2024); OpenNLPLab/AVSBench,
`avs_scripts/avss/utils/compute_color_metrics.py` and `test.py`.

Quirks: IoU and F of a class are means over the frames in which truth or prediction has a pixel of it: one wrong pixel
in a frame counts as a frame with IoU 0, whatever its area. The mean over classes runs over all C of them (71 in
AVSBench-semantic); one that occurs nowhere counts as 0, so that figures of a part of the test set are too low. "without
background" (`noBg`) leaves out the last class, while labels are indices of a palette whose first colour is black: the
background is class 0. The released loader (`color_dataloader.py`) pads clips of five frames to ten with black pictures
and labels of class 0, and these frames are scored, too; to repeat a published figure, give them here as well. The IoU
of a video is, frame by frame, the mean over the classes with an IoU above 0: classes missed altogether do not lower it.
Sums over frames do not depend on batches. The usual mIoU, from the pixels of all frames together, is `order_free`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.errors import Avs3dError, UsageError
from evaluators.metrics.classes import Confusion, class_ious, confusion
from evaluators.metrics.inputs import paired_frames, whole_number
from evaluators.metrics.masks import mean

#: β² of the F-score.
_BETA_SQUARED = 0.3
#: More classes than this are no class ids of 8 bits.
_MOST_CLASSES = 256


def evaluate(truth: object, logits: object, classes: int | None = None) -> dict[str, float]:
    """Compute mIoU and F as released.

    Args:
        truth: (N, H, W) class ids, 0 … C − 1; or an iterable of (H, W).
        logits: (N, C, H, W) scores of the classes, of which the highest is taken; or, with ``classes``, (N, H, W) ids.
        classes: C; None: from the shape of ``logits``.

    Returns:
        ``mIoU`` and ``F`` over all classes, ``mIoU_without_last`` and ``F_without_last`` over all but the last, in
        [0, 1].

    Raises:
        UsageError: if there is no frame.
        Avs3dError: if shapes, types or values are others: NaN, ids beyond C − 1.

    Examples:
        >>> import numpy as np
        >>> truth = np.array([[[0, 0], [1, 2]]])
        >>> evaluate(truth, truth, classes=3)
        {'mIoU': 1.0, 'mIoU_without_last': 1.0, 'F': 1.0, 'F_without_last': 1.0}
    """
    frames = _confusions(truth, logits, classes)
    ious = _class_means([_ious(cells) for cells in frames], frames)
    scores = _class_means([_f_scores(cells) for cells in frames], frames)
    return _named(ious, "mIoU") | _named(scores, "F")


def frame_mious(truth: object, logits: object, classes: int | None = None) -> list[float]:
    """The released IoU of a video, frame by frame: the mean over the classes with an IoU above 0; 0 without such.

    Arguments and errors as for `evaluate`.

    Examples:
        >>> import numpy as np
        >>> frame_mious(np.array([[[0, 1]]]), np.array([[[0, 0]]]), classes=2)  # class 1, missed, does not lower it
        [0.5]
    """
    found = [_ious(cells) for cells in _confusions(truth, logits, classes)]
    return [float(values[values > 0].mean()) if (values > 0).any() else 0.0 for values in found]


def order_free(truth: object, logits: object, classes: int | None = None) -> dict[str, float]:
    """Compute mIoU and F from the pixels of all frames together, means over the classes that occur in one of the two.

    Arguments and errors as for `evaluate`. The last class is left out where it occurs.

    Examples:
        >>> import numpy as np
        >>> order_free(np.array([[[0, 1]]]), np.array([[[0, 0]]]), classes=2)["mIoU"]
        0.25
    """
    total: Confusion = np.sum(_confusions(truth, logits, classes), axis=0)
    ious, scores = class_ious(total, first=0), _f_scores(total)
    last = len(total) - 1
    out = {}
    for name, values in (("mIoU", ious), ("F", {number: float(scores[number]) for number in ious})):
        out[name] = mean(values.values()) or 0.0
        out[f"{name}_without_last"] = mean(value for number, value in values.items() if number != last) or 0.0
    return out


def _named(values: NDArray[np.float64], name: str) -> dict[str, float]:
    return {name: float(values.mean()), f"{name}_without_last": float(values[:-1].mean())}


def _class_means(values: list[NDArray[np.float64]], frames: list[Confusion]) -> NDArray[np.float64]:
    """(C,) means over the frames in which a class occurs, 0 of one that occurs in none."""
    present = np.sum([_union(cells) > 0 for cells in frames], axis=0)
    return np.asarray(np.sum(values, axis=0) / np.maximum(present, 1))


def _union(cells: Confusion) -> NDArray[np.int64]:
    return np.asarray(cells.sum(axis=0) + cells.sum(axis=1) - np.diagonal(cells))


def _ious(cells: Confusion) -> NDArray[np.float64]:
    """(C,) IoU of a frame, 0 of classes that do not occur."""
    return np.asarray(np.diagonal(cells) / np.maximum(_union(cells), 1))


def _f_scores(cells: Confusion) -> NDArray[np.float64]:
    """(C,) F, 0 of classes without a right pixel."""
    both = np.diagonal(cells)
    weighted = _BETA_SQUARED * cells.sum(axis=1) + cells.sum(axis=0)
    return np.asarray((1 + _BETA_SQUARED) * both / np.where(both > 0, weighted, 1))


def _confusions(truth: object, logits: object, classes: int | None) -> list[Confusion]:
    frames = list(_each_confusion(truth, logits, classes))
    if not frames:
        raise UsageError("truth: no frame; expected at least one")
    return frames


def _each_confusion(truth: object, logits: object, classes: int | None) -> Iterator[Confusion]:
    if classes is not None:
        classes = whole_number(classes, "classes", 2, _MOST_CLASSES)
    for where, ids, found in paired_frames(truth, logits):
        if ids.ndim != 2 or ids.size == 0:
            raise Avs3dError(f"truth, {where}: shape {ids.shape}, expected (height, width) class ids")
        expected = "(classes, height, width)" if classes is None else "(height, width)"
        if found.ndim != (3 if classes is None else 2) or found.shape[-2:] != ids.shape:
            raise Avs3dError(f"prediction, {where}: shape {found.shape}, expected {expected} of {ids.shape} pixels")
        if classes is None and np.isnan(found).any():
            raise Avs3dError(f"prediction, {where}: holds NaN; expected scores of classes")
        count = classes if classes is not None else len(found)
        if not 2 <= count <= _MOST_CLASSES:
            raise Avs3dError(f"prediction, {where}: {count} classes, expected 2 to {_MOST_CLASSES}")
        named = found if classes is not None else np.argmax(found, axis=0)
        yield confusion(_ids(ids, count, f"truth, {where}"), _ids(named, count, f"prediction, {where}"), count - 1)


def _ids(values: NDArray[Any], count: int, where: str) -> NDArray[np.uint8]:
    """Class ids as uint8, checked."""
    if not np.isfinite(values).all() or values.min() < 0 or values.max() >= count:
        raise Avs3dError(f"{where}: class ids beyond 0 to {count - 1}; expected 0 … C − 1")
    ids = values.astype(np.uint8)
    if not np.array_equal(ids, values):
        raise Avs3dError(f"{where}: holds numbers that are not whole; expected class ids")
    return ids
