"""Successive clips join without a jump: what the first sample of a clip adds to the past is no more than elsewhere.

A step between two samples tells little: loud low sounds have large steps, and a jump of the same size is a click. So
the border is held to what its neighbourhood predicts (linear prediction; Makhoul, "Linear prediction: A tutorial
review", Proc. IEEE 63 (1975) 561–580): the coefficients fit the samples on both sides of it, and what they cannot
predict there is compared with what they cannot predict beside it. White noise jumps at every sample, so that a seam in
it can neither be found nor heard.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.sound import SILENCE, BinauralClip

#: Coefficients of the prediction, and samples on each side of a border to which they are fitted.
_ORDER, _SIDE = 24, 1024
#: Samples on each side with which the border is compared: 5 ms.
_NEAR = 220
#: Ridge of the fit, as a share of the energy: bands without sound leave it ill-conditioned.
_RIDGE = 1e-9
#: One border is a jump where both ears exceed their neighbourhood so many times: a source's onset reaches them at two
#: samples. Of 6.4 million samples of 11 observations (recordings and synthesised sounds, tracer and `analytic`), both
#: ears exceed 8 in five, and the borders 3.6 in none; without joining, the borders of a vacuum cleaner reach 2,500.
JUMP = 8.0
#: The clips were never joined where half of at least so many borders exceed this: those 11 observations have 1.5 to
#: 2.3, and 4.2 to 1,774 without joining.
SEAMS, LEAST_BORDERS = 3.0, 4


def check_seams(clips: Sequence[BinauralClip | None], findings: Findings) -> None:
    """Name the clips that do not go on where the clip before them ends.

    Args:
        clips: of all frames in order; None where one is missing or damaged.
        findings: where problems go.
    """
    found: dict[int, NDArray[np.float64]] = {}
    for index, (before, clip) in enumerate(pairwise(clips), start=1):
        if before is not None and clip is not None:
            jumps = border_jumps(before.samples, clip.samples)
            if jumps is not None:
                found[index] = jumps
    if not found:
        return
    middle = float(np.median([jumps.max() for jumps in found.values()]))
    if middle > SEAMS and len(found) >= LEAST_BORDERS:
        text = f"sound jumps between clips: {middle:.1f} times what its neighbours do, median of {len(found)} borders"
        findings.add(layout.BINAURAL, f"{text}; of a dataset before version 3.0.0, or not in this order?", "warning")
        return
    for index, jumps in found.items():
        if jumps.min() > JUMP:
            text = f"sound jumps between this clip and the one before: {jumps.min():.1f} times what its neighbours do"
            findings.add(layout.audio_path(layout.BINAURAL, index), f"{text}; is it the clip of this second?")


def border_jumps(before: NDArray[np.floating], after: NDArray[np.floating]) -> NDArray[np.float64] | None:
    """What cannot be predicted at the border of two clips, re the RMS of that beside it, of each channel.

    Args:
        before: (channels, n) a clip, n ≥ `_SIDE`.
        after: (channels, n) the next one.

    Returns:
        (channels,), about 1; None where a channel is silent on a side of the border.
    """
    ends = before[:, -_SIDE:].astype(np.float64), after[:, :_SIDE].astype(np.float64)
    if min(float(np.sqrt(np.mean(np.square(end), axis=1)).min()) for end in ends) < SILENCE:
        return None
    return np.array([_jump(channel) for channel in np.concatenate(ends, axis=1)])


def _jump(samples: NDArray[np.float64]) -> float:
    """That of the middle of (2 · `_SIDE`,) samples."""
    windows = np.lib.stride_tricks.sliding_window_view(samples, _ORDER + 1)
    middle = _SIDE - _ORDER  # the window whose last sample is the first after the border
    apart = np.ones(len(windows), dtype=bool)
    apart[middle : middle + _ORDER + 1] = False  # windows with samples of both clips
    past, now = windows[apart, :-1], windows[apart, -1]
    ridge = _RIDGE * float(np.sum(np.square(past))) * np.eye(_ORDER)
    weights = np.linalg.solve(past.T @ past + ridge, past.T @ now)
    left = np.abs(windows[:, -1] - windows[:, :-1] @ weights)
    beside = np.concatenate(
        [left[middle - _NEAR : middle - 1], left[middle + _ORDER + 1 : middle + _ORDER + 1 + _NEAR]]
    )
    scale = float(np.sqrt(np.mean(np.square(beside))))
    return float(left[middle - 1 : middle + 2].max()) / max(scale, 1e-30)
