"""From a source signal and impulse responses to the clips of an observation.

The level of every clip of every observation is scaled by one fixed gain, so that distance stays audible; nothing is
ever normalised per clip.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from avs3d_bench.errors import Avs3dError
from avs3d_bench.layout import BINAURAL_SAMPLES, SAMPLE_RATE, is_test

#: The fixed gain of every clip: keeps a full-scale source from 0.3 m on below full scale (0.76 at worst).
GAIN = 0.1


def binaural_clip(
    source: NDArray[np.floating],
    impulse_response: NDArray[np.floating],
    index: int,
    sample_rate: int = SAMPLE_RATE,
    gain: float = GAIN,
) -> NDArray[np.float32]:
    """The second ``index`` of the source as heard by someone who stands at pose ``index``: past included.

    clip = gain · (source ∗ h)[index·sr : (index + 1)·sr]. Only the stretch of the source that can still be heard is
    convolved (overlap-add).

    Args:
        source: (n,) mono source signal from time 0 on; n ≥ (index + 1)·sample_rate.
        impulse_response: (2, m) binaural room impulse response of the frame's pose, channel 0 left.
        index: frame number = second of the source.
        sample_rate: of both, Hz.
        gain: fixed gain, the same for all clips of a dataset.

    Returns:
        (2, sample_rate) float32.

    Raises:
        Avs3dError: if the source is too short, shapes are wrong, or a number is not finite.
    """
    signal = np.asarray(source)
    response = np.asarray(impulse_response)
    if signal.ndim != 1 or response.ndim != 2 or response.shape[0] != 2 or response.shape[1] == 0:
        raise Avs3dError(
            f"binaural clip {index}: source {signal.shape} and impulse response {response.shape}, "
            "expected (n,) and (2, m)"
        )
    start, stop = index * sample_rate, (index + 1) * sample_rate
    if index < 0 or len(signal) < stop:
        raise Avs3dError(
            f"binaural clip {index}: the source has {len(signal)} samples, expected at least {stop} ({index + 1} s)"
        )
    first = max(0, start - response.shape[1] + 1)
    heard = signal[first:stop].astype(np.float64)
    if not np.isfinite(heard).all() or not np.isfinite(response).all():
        raise Avs3dError(f"binaural clip {index}: the source or its impulse response holds NaN or infinite samples")
    wet = oaconvolve(heard[None, :], response.astype(np.float64), axes=1)[:, start - first : stop - first]
    return np.asarray(gain * wet, dtype=np.float32)


def mono_window(index: int, count: int) -> list[tuple[int, int, int]]:
    """Which samples of which clips make the 2 s mono clip of frame ``index`` of ``count``.

    The frame's own second with the half second before and after it. A train frame never borrows from a test frame; it
    takes the missing half from its other neighbour, which then gives its whole second. So does the first and the last
    frame of a sequence. A frame that may borrow from nobody (one frame; or frames 0 and 1 alone, for frame 1) is
    repeated: its second half, itself, its first half, as if it were played in a loop.

    Returns:
        pieces (frame, start, stop) in the order in which they are joined; their lengths add up to 88,200 samples.

    Raises:
        Avs3dError: if ``index`` is not in 0 … count − 1.
    """
    if not 0 <= index < count:
        raise Avs3dError(f"mono clip: frame {index} of {count} does not exist; expected 0 to {count - 1}")
    half, whole = BINAURAL_SAMPLES // 2, BINAURAL_SAMPLES

    def lends(frame: int) -> bool:
        return 0 <= frame < count and (is_test(index) or not is_test(frame))

    before, after = index - 1, index + 1
    own = (index, 0, whole)
    if lends(before) and lends(after):
        return [(before, half, whole), own, (after, 0, half)]
    if lends(before):
        return [(before, 0, whole), own]
    if lends(after):
        return [own, (after, 0, whole)]
    return [(index, half, whole), own, (index, 0, half)]


def mono_clip(clips: Sequence[NDArray[np.floating]], index: int) -> NDArray[np.float32]:
    """The 2 s mono clip of frame ``index``: the mean of both channels over `mono_window`.

    Args:
        clips: the binaural clips (2, 44100) of all frames, in order.
        index: the frame.

    Returns:
        (88200,) float32.
    """
    pieces = mono_window(index, len(clips))
    for frame, _, _ in pieces:
        if np.shape(clips[frame]) != (2, BINAURAL_SAMPLES):
            raise Avs3dError(f"mono clip {index}: clip {frame} has shape {np.shape(clips[frame])}, expected (2, 44100)")
    mixed = [np.asarray(clips[frame], dtype=np.float64)[:, start:stop].mean(axis=0) for frame, start, stop in pieces]
    return np.concatenate(mixed).astype(np.float32)


def rms(clip: NDArray[np.floating]) -> NDArray[np.float64]:
    """Root mean square along the last axis: (2,) for a binaural clip (2, n)."""
    return np.asarray(np.sqrt(np.mean(np.square(np.asarray(clip, dtype=np.float64)), axis=-1)))


def ild_db(clip: NDArray[np.floating]) -> float:
    """Interaural level difference of a binaural clip (2, n) in dB: level(right) − level(left); 0 for silence."""
    left, right = rms(clip)
    if left == 0 and right == 0:
        return 0.0
    with np.errstate(divide="ignore"):
        return float(20 * (np.log10(right) - np.log10(left)))


def check_clip(clip: NDArray[np.floating], where: str) -> None:
    """Refuse a clip that is not finite, clips, or is silent.

    Raises:
        Avs3dError: naming ``where``, what was found and what to do.
    """
    samples = np.asarray(clip)
    if not np.isfinite(samples).all():
        raise Avs3dError(f"{where}: the clip holds NaN or infinite samples; check the source and the impulse response")
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= 1.0:
        raise Avs3dError(f"{where}: the clip reaches {peak:.2f} of full scale; lower the gain or move the source away")
    if peak == 0.0:
        raise Avs3dError(f"{where}: the clip is silent; check the source and the line from it to the listener")
