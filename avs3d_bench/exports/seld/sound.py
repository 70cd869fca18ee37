"""The sound of a recording: the clips of an observation one after the other, at 24 kHz.

Clips join without a step (`generators.acoustics.clips.joined`). First-order ambisonics are turned, sample by sample,
as the head turns between two frames: for sound at one place this is exact, and what a listener would hear who turns
evenly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import resample_poly

from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.seld.events import TurningHead, record_of
from avs3d_bench.geometry import ambisonic_axes

F32 = NDArray[np.float32]

#: Sample rate of SELD data sets (Hz).
SELD_RATE = 24_000
#: 24,000 / 44,100 in lowest terms.
_UP, _DOWN = 80, 147
#: Channels of first-order ambisonics: W, Y, Z, X.
FIRST_ORDER = 4


def check_ambisonics(observation: Observation) -> int:
    """Number of ambisonic channels of an observation.

    Raises:
        UsageError: if it was made without ambisonics.
    """
    found = record_of(observation).acoustics.ambisonics
    if found is None:
        raise UsageError(
            f"{observation.path}: has no ambisonic clips; make the dataset again, in another folder, with `avs3d "
            "generate MANIFEST -o ROOT --audio tracer --with ambisonics`, or export --format binaural"
        )
    return found.channels


def read_second(frame: Frame, receiver: str | None, channels: int) -> F32:
    """(channels, 44100) one clip.

    Raises:
        Avs3dError: if it is missing or damaged, or has another shape.
    """
    clip = frame.audio() if receiver is None else frame.ambisonics()
    if clip.shape != (channels, layout.BINAURAL_SAMPLES):
        where = frame.observation.path / layout.audio_path(layout.clips_folder(receiver), frame.index)
        raise Avs3dError(f"{where}: shape {clip.shape}, expected ({channels}, {layout.BINAURAL_SAMPLES})")
    return clip


def ears_track(observation: Observation, seconds: int) -> F32:
    """(2, 24000 · seconds) the two ears; channel 0 is left."""
    clips = [read_second(frame, None, 2) for frame in observation.frames[:seconds]]
    return resampled(np.concatenate(clips, axis=1))


def ambisonics_track(observation: Observation, seconds: int, head: TurningHead) -> F32:
    """(4, 24000 · seconds) first-order ambisonics, ACN (W, Y, Z, X) and SN3D, turned with the head.

    Raises:
        UsageError: if the dataset has none.
        Avs3dError: if a clip is missing or damaged.
    """
    channels = check_ambisonics(observation)
    clips = []
    for second, frame in enumerate(observation.frames[:seconds]):
        clip = read_second(frame, layout.AMBISONICS, channels)[:FIRST_ORDER]
        # The head turns about an axis of the world; sound turns the other way in the axes of the head.
        axis = ambisonic_axes(head.turn(second) @ head.poses[second].rotation_matrix)
        clips.append(turned(clip, -axis))
    return resampled(np.concatenate(clips, axis=1))


def turned(clip: F32, turn: NDArray[np.float64]) -> F32:
    """First-order ambisonics (4, n) turned by 0 at the first sample, evenly up to ``turn`` after the last one.

    Rodrigues' formula for the vector (X, Y, Z) of each sample; W has no direction.

    Args:
        clip: W, Y, Z, X.
        turn: (3,) rotation vector, radians, axes x forward, y left, z up.
    """
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return clip
    k = turn / angle
    theta = angle * np.arange(clip.shape[1]) / clip.shape[1]
    v = clip[[3, 1, 2]].astype(np.float64)
    along = k @ v
    x, y, z = (
        v * np.cos(theta)
        + np.cross(k, v, axisb=0, axisc=0) * np.sin(theta)
        + np.outer(k, along) * (1.0 - np.cos(theta))
    )
    return np.stack([clip[0], y, z, x]).astype(np.float32)


def resampled(samples: F32) -> F32:
    """(channels, n) at 44.1 kHz as (channels, n · 80/147) at 24 kHz; n is a multiple of 44,100."""
    return np.asarray(resample_poly(samples.astype(np.float64), _UP, _DOWN, axis=1), dtype=np.float32)


def mid_side(ambisonics: F32, view: float) -> F32:
    """(2, n) stereo of a coincident pair that looks ``view`` degrees to the right: W ± Y, left and right.

    The conversion of the DCASE 2025 data (Shimada et al., arXiv:2507.12042): the sound is turned until the view is
    ahead, then mid is W and side is Y.

    Args:
        ambisonics: W, Y, Z, X, (4, n).
        view: degrees, positive to the right.
    """
    w, y, _, x = ambisonics.astype(np.float64)
    angle = np.radians(view)
    side = np.sin(angle) * x + np.cos(angle) * y
    return np.stack([w + side, w - side]).astype(np.float32)
