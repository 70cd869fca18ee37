"""From a source signal and impulse responses to the clips of an observation.

The level of every clip of every observation is scaled by one fixed gain, so that distance stays audible; nothing is
ever normalised per clip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import oaconvolve

from avs3d_bench.contract.layout import BINAURAL_SAMPLES, SAMPLE_RATE, mono_window
from avs3d_bench.errors import Avs3dError
from generators.acoustics.geometry import SPEED_OF_SOUND

#: The fixed gain of every clip: keeps a full-scale source from 0.3 m on below full scale (0.76 at worst).
GAIN = 0.1
#: Half length of the interpolation of changing delays, samples.
_TAPS = 16
#: Time in which a listener gets from one pose to the next (s): in the first samples of a clip, sound as the pose before
#: hears it turns into sound as this one does. Without it, every border of two clips is a click.
STEP_SECONDS = 0.005


def receiver_clip(
    source: NDArray[np.floating],
    impulse_response: NDArray[np.floating],
    index: int,
    sample_rate: int = SAMPLE_RATE,
    gain: float = GAIN,
    tail: int = 0,
) -> NDArray[np.float32]:
    """The second ``index`` of the source as heard by a receiver at pose ``index``, earlier reverberation included.

    clip = gain · (source ∗ h)[index·sr : (index + 1)·sr + tail]. Only the stretch of the source that can still be heard
    is convolved (overlap-add).

    Args:
        source: (n,) mono source signal from time 0 on; n ≥ (index + 1)·sample_rate.
        impulse_response: (channels, m) room impulse response of the frame's pose; of two ears, channel 0 is left.
        index: frame number = second of the source.
        sample_rate: of both, Hz.
        gain: fixed gain, the same for all clips of a dataset.
        tail: samples of the next second that are wanted too, see `joined`; the source is silent where it has ended.

    Returns:
        (channels, sample_rate + tail) float32.

    Raises:
        Avs3dError: if the source is too short, shapes are wrong, or a number is not finite.
    """
    signal = np.asarray(source)
    response = _checked(signal, impulse_response, index, sample_rate)
    start, stop = index * sample_rate, (index + 1) * sample_rate + tail
    signal = _lengthened(signal, stop)
    first = max(0, start - response.shape[1] + 1)
    heard = signal[first:stop].astype(np.float64)
    wet = oaconvolve(heard[None, :], response.astype(np.float64), axes=1)[:, start - first : stop - first]
    return np.asarray(gain * wet, dtype=np.float32)


def binaural_clip(
    source: NDArray[np.floating],
    impulse_response: NDArray[np.floating],
    index: int,
    sample_rate: int = SAMPLE_RATE,
    gain: float = GAIN,
) -> NDArray[np.float32]:
    """`receiver_clip` of two ears: the response is (2, m), channel 0 left.

    Raises:
        Avs3dError: as `receiver_clip`, and if the response has other than two channels.
    """
    if np.ndim(impulse_response) != 2 or np.shape(impulse_response)[0] != 2:
        raise Avs3dError(f"clip {index}: impulse response {np.shape(impulse_response)}, expected (2, m) of two ears")
    return receiver_clip(source, impulse_response, index, sample_rate, gain)


def moving_clip(
    source: NDArray[np.floating],
    impulse_responses: Sequence[NDArray[np.floating]],
    distances: Sequence[float],
    index: int,
    sample_rate: int = SAMPLE_RATE,
    gain: float = GAIN,
    tail: int = 0,
) -> NDArray[np.float32]:
    """The second ``index`` of a moving source, as heard by a listener at pose ``index``.

    The position of the source at the time of emission counts. So the source signal is cross-faded, not the result:

        clip = gain · Σ_k (w_k · x_k) ∗ h_k,

    with h_k the response from where the source is at full second k to the pose, and w_k a triangle that is 1 at k and
    0 at k ± 1. The last k is the end of the second; what left the source before the first k goes through its response,
    of which then only late reverberation is left. The direct sounds of two responses arrive at different times, and a
    plain cross-fade of them would be coloured like a comb. So x_k is the source with a delay that changes linearly, in
    such a way that all direct sounds arrive together, at every moment as late as the distance by then says, its
    Doppler shift included.

    To a listener who stands still, successive clips join without a step, except for reverberation that is older
    than the first k.

    Args:
        source: (n,) mono source signal from time 0 on; n ≥ (index + 1)·sample_rate.
        impulse_responses: (channels, m) each, from where the source is at successive full seconds up to
            ``index + 1``; at least two.
        distances: from the listener to the source then, metres.
        index: frame number = second of the source.
        sample_rate: of all, Hz.
        gain: fixed gain.
        tail: samples of the next second that are wanted too, see `joined`; in them the source stands still.

    Returns:
        (channels, sample_rate + tail) float32; where all responses and distances are equal, what `receiver_clip` gives.

    Raises:
        Avs3dError: as `receiver_clip`, and if there are not as many distances as responses.
    """
    signal = np.asarray(source)
    count = len(impulse_responses)
    if count < 2 or len(distances) != count:
        raise Avs3dError(f"moving clip {index}: {count} responses and {len(distances)} distances, expected 2 or more")
    start, stop = index * sample_rate, (index + 1) * sample_rate + tail
    knots = (index + 1) * sample_rate + sample_rate * np.arange(1 - count, 1)
    lags = np.asarray(distances, dtype=np.float64) / SPEED_OF_SOUND * sample_rate
    lengthened = _lengthened(signal, stop)
    out = np.zeros((np.shape(impulse_responses[0])[0], sample_rate + tail))
    for k, found in enumerate(impulse_responses):
        response = _checked(signal, found, index, sample_rate)
        at, heard = heard_from(lengthened, response, MovingSource(knots, lags), k, (start, stop))
        out[:, at : at + heard.shape[1]] += heard
    return np.asarray(gain * out, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class MovingSource:
    """Where a source is at some times, as one listener hears it.

    Attributes:
        knots: (k,) samples, ascending.
        lags: (k,) samples that its direct sound takes from there.
        corrects_level: of responses that are not alike, the powers add up, not the amplitudes. This is the correlation
            of two successive ones, for which windows are scaled so that the level stays the same; None: they are not.
    """

    knots: NDArray[np.integer]
    lags: NDArray[np.float64]
    corrects_level: float | None = None


def heard_from(
    signal: NDArray[np.floating],
    response: NDArray[np.floating],
    source: MovingSource,
    k: int,
    span: tuple[int, int],
) -> tuple[int, NDArray[np.float64]]:
    """What leaves a moving source about its knot ``k``, through the response from there (see `moving_clip`).

    Args:
        signal: (n,), n ≥ the end of ``span``.
        response: (channels, m) from where the source is at knot ``k``.
        source: its knots; before the first and after the last it stands still.
        k: number of the knot.
        span: first sample wanted and the one after the last.

    Returns:
        offset from the beginning of ``span``, and (channels, j) float64 from there on; nothing where j is 0.
    """
    (start, stop), knots, count = span, source.knots, len(source.knots)
    # The stretch in which sound leaves the source with this response, and can still be heard.
    low = max(0, start - response.shape[1] + 1, int(knots[k - 1]) if k else 0)
    high = int(knots[k + 1]) if k + 1 < count else stop
    high = min(high, stop)
    if low >= high:
        return 0, np.zeros((response.shape[0], 0))
    n = np.arange(low, high)
    lag = np.interp(n, knots, source.lags) - source.lags[k]
    window = np.interp(n, knots, np.eye(count)[k]) if count > 1 else np.ones(len(n))
    if source.corrects_level is not None:
        window = levelled(window, source.corrects_level)
    leaving = window * delayed(signal, lag, low)
    wet = oaconvolve(leaving[None, :], response.astype(np.float64), axes=1)
    return max(low - start, 0), wet[:, max(start - low, 0) : stop - low]


def levelled(window: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
    """A window w of a cross-fade w, 1 − w between signals of this correlation, scaled so that their level stays."""
    other = 1.0 - window
    return np.asarray(window / np.sqrt(window**2 + other**2 + 2 * correlation * window * other))


def joined(clip: NDArray[np.float32], before: NDArray[np.float32]) -> NDArray[np.float32]:
    """A clip that goes on where the clip before it ends.

    In the first samples, sound as it is heard at the pose before turns into sound as it is heard at this one, by a
    raised cosine: neither the sound pressure nor its slope jumps. What both poses hear alike stays as it is.

    Args:
        clip: (channels, n) of a second.
        before: (channels, k) the first k samples of that second as the pose before hears them, from `receiver_clip`
            or `moving_clip` with a tail.

    Returns:
        (channels, n) float32.
    """
    count = before.shape[1]
    rise = np.sin((np.arange(count) + 0.5) / count * (np.pi / 2)) ** 2
    out = clip.copy()
    out[:, :count] = before + rise * (clip[:, :count].astype(np.float64) - before)
    return out


def _lengthened(signal: NDArray[np.floating], count: int) -> NDArray[np.floating]:
    """The signal with silence after its end, so that it has at least ``count`` samples."""
    return np.pad(signal, (0, max(0, count - len(signal))))


def delayed(signal: NDArray[np.floating], delay: NDArray[np.floating], first: int) -> NDArray[np.float64]:
    """Samples ``first`` to ``first + len(delay)`` of a signal with a delay that changes from sample to sample.

    Band-limited interpolation: a sinc of 32 taps under a squared cosine. A whole delay is exact; outside there is
    silence.

    Args:
        signal: (n,).
        delay: (k,) samples, of either sign.
        first: index of the first sample wanted.

    Returns:
        (k,).
    """
    samples = np.asarray(signal, dtype=np.float64)
    if not delay.any():
        return samples[first : first + len(delay)].copy()
    at = np.arange(first, first + len(delay)) - delay
    whole = np.floor(at).astype(np.int64)
    share = at - whole
    padded = np.pad(samples, _TAPS)
    out = np.zeros(len(delay))
    sine = np.sin(np.pi * share) / np.pi
    for tap in range(-_TAPS + 1, _TAPS + 1):
        # sinc(share − tap), whose sine is the same for all taps but for its sign.
        offset = share - tap
        exact = offset == 0
        weight = np.where(exact, 1.0, (1 - 2 * (tap % 2)) * sine / np.where(exact, 1.0, offset))
        weight *= np.cos(np.pi * offset / (2 * (_TAPS + 1))) ** 2
        out += weight * padded[np.clip(whole + tap + _TAPS, 0, len(padded) - 1)]
    return out


def _checked(
    signal: NDArray[np.floating], response: NDArray[np.floating], index: int, sample_rate: int
) -> NDArray[np.floating]:
    """The impulse response, if it and the source can make the second ``index``."""
    response = np.asarray(response)
    if signal.ndim != 1 or response.ndim != 2 or 0 in response.shape:
        raise Avs3dError(
            f"clip {index}: source {signal.shape} and impulse response {response.shape}, "
            "expected (n,) and (channels, m)"
        )
    start, stop = index * sample_rate, (index + 1) * sample_rate
    if index < 0 or len(signal) < stop:
        raise Avs3dError(
            f"clip {index}: the source has {len(signal)} samples, expected at least {stop} ({index + 1} s)"
        )
    heard = signal[max(0, start - response.shape[1] + 1) : stop]
    if not np.isfinite(heard).all() or not np.isfinite(response).all():
        raise Avs3dError(f"clip {index}: the source or its impulse response holds NaN or infinite samples")
    return response


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


class ClippedError(Avs3dError):
    """A clip that reaches full scale.

    Args:
        where: which clip.
        peak: the largest of its samples, of full scale.
    """

    def __init__(self, where: str, peak: float) -> None:
        super().__init__(f"{where}: the clip reaches {peak:.2f} of full scale; lower the gain or move the source away")
        self.peak = peak


def check_clip(clip: NDArray[np.floating], where: str, *, silence: bool = False, most: float = 1.0) -> None:
    """Refuse a clip that is not finite, reaches ``most`` of full scale, or, unless ``silence`` is allowed, is silent.

    Raises:
        ClippedError: if it reaches ``most``.
        Avs3dError: naming ``where``, what was found and what to do.
    """
    samples = np.asarray(clip)
    if not np.isfinite(samples).all():
        raise Avs3dError(f"{where}: the clip holds NaN or infinite samples; check the source and the impulse response")
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= most:
        raise ClippedError(where, peak)
    if peak == 0.0 and not silence:
        raise Avs3dError(f"{where}: the clip is silent; check the source and the line from it to the listener")
