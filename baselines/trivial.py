"""Predictions that use only the size of the pictures: a lower bound that any method must exceed.

The evaluator prints the same three as reference rows. Here they are real submissions, written without a look at the
truth: sizes come from the headers of the input pictures.

Examples:
    >>> from avs3d_bench import Dataset
    >>> trivial.centre_box(4, 8).astype(int)
    array([[0, 0, 0, 0, 0, 0, 0, 0],
           [0, 0, 1, 1, 1, 1, 0, 0],
           [0, 0, 1, 1, 1, 1, 0, 0],
           [0, 0, 0, 0, 0, 0, 0, 0]])
    >>> trivial.write_trivial("centre-box", Dataset("data/demo"), "centre-box", overwrite=True).record.method
    'centre-box'
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Dataset, Frame
from avs3d_bench.measures.centre_box import centre_box as middle_half
from avs3d_bench.method import Method, write_submission
from avs3d_bench.submission import SubmissionWriter, frame_size

Mask = NDArray[np.bool_]


def all_black(height: int, width: int) -> Mask:
    """(H, W) False: nothing sounds."""
    return np.zeros((height, width), dtype=np.bool_)


def all_white(height: int, width: int) -> Mask:
    """(H, W) True: everything sounds."""
    return np.ones((height, width), dtype=np.bool_)


def centre_box(height: int, width: int) -> Mask:
    """(H, W) True in the middle half of rows and columns (`avs3d_bench.measures.centre_box`)."""
    mask = all_black(height, width)
    mask[middle_half(height, width)] = True
    return mask


#: Name → the mask for a size (height, width).
TRIVIAL: dict[str, Callable[[int, int], Mask]] = {
    "all-black": all_black,
    "all-white": all_white,
    "centre-box": centre_box,
}
_NOTES = {
    "all-black": "looks at nothing: every mask is black",
    "all-white": "looks at nothing: every mask is white",
    "centre-box": "looks at nothing: every mask is the central quarter of the picture",
}


def write_trivial(
    name: str,
    dataset: Dataset,
    path: str | Path,
    *,
    only: Iterable[str] = (),
    overwrite: bool = False,
    progress: bool = False,
) -> SubmissionWriter:
    """Write the submission of one of `TRIVIAL`.

    Args:
        name: which.
        dataset: what to write masks for; no truth of it is read.
        path: the submission's folder.
        only: shell patterns of observation keys.
        overwrite: replace an existing submission.
        progress: show a bar on stderr.

    Returns:
        The writer; its attributes describe what was written.

    Raises:
        UsageError: if no observation matches, or the target is not free.
        Avs3dError: if a picture is damaged or the system refuses.
    """
    method = Method(name, partial(_masks, TRIVIAL[name]), notes=_NOTES[name], entry="baselines.trivial:write_trivial")
    # Writing a uniform mask takes a millisecond: more processes would only take time to start.
    return write_submission(dataset, path, method, only=only, overwrite=overwrite, progress=progress)


def _masks(mask_of: Callable[[int, int], Mask], frames: tuple[Frame, ...]) -> Iterator[Mask]:
    return (mask_of(*frame_size(frame)) for frame in frames)
