"""The clip as input of a network: resampled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import resample_poly

from avs3d_bench.errors import Avs3dError


def resample(clip: NDArray[np.float32], rate: int, target: int) -> NDArray[np.float32]:
    """A mono clip at another rate: polyphase filter, no phase shift, round(n · target / rate) samples.

    Args:
        clip: (n,) samples.
        rate: samples per second.
        target: the rate that is wanted.
    """
    if rate == target:
        return np.asarray(clip, dtype=np.float32)
    common = math.gcd(rate, target)
    length = round(len(clip) * target / rate)
    return np.asarray(resample_poly(clip, target // common, rate // common)[:length], dtype=np.float32)


def check_clip(clip: NDArray[np.float32], where: str) -> NDArray[np.float32]:
    """A clip that a network can be given.

    Raises:
        Avs3dError: if it is empty or not finite.
    """
    if not len(clip):
        raise Avs3dError(f"{where}: the mono clip is empty, expected two seconds of sound")
    if not np.isfinite(clip).all():
        raise Avs3dError(f"{where}: the mono clip holds NaN or infinite samples; regenerate the dataset")
    return clip
