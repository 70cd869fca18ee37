"""Recordings as sources: read, mixed to mono, resampled, looped, brought to the common loudness."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy.signal import firwin, kaiserord, resample_poly

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import Avs3dError
from generators.assets.sounds.loudness import CEILING_DB, TARGET_LUFS, integrated_loudness, normalised

#: Least length of a recording, and longest cross-fade of its loop (s).
_SHORTEST = 0.5
_CROSS_FADE = 0.5
#: Longest stretch of a recording that is read at once to be looped (s).
LONGEST_LOOP = 900
#: Frames that `survey` holds at a time, and the magnitude from which a sample is at the end of the scale.
_BLOCK, _END_OF_SCALE = 1 << 20, 0.999
#: How far images and aliases of resampling lie below the sound (dB), and the width of the filter's edge, which ends at
#: half of the lower sample rate (as a share of that).
_STOPBAND, _EDGE = 90.0, 0.09
#: A recording below this loudness counts as silent (LUFS).
_SILENCE = -60.0


Span = tuple[float, float]


def load_sound(
    path: Path | str, seconds: float, sample_rate: int = SAMPLE_RATE, *, start: float = 0.0, trim: Span | None = None
) -> NDArray[np.float32]:
    """A recording as a source: mixed to mono, resampled, looped with a cross-fade, brought to `TARGET_LUFS`.

    Of a long recording only the stretch that is needed is read.

    Args:
        path: any sound file that libsndfile decodes.
        seconds: length of the source; a longer recording is cut, a shorter one looped.
        sample_rate: rate of the source, Hz.
        start: where the source begins, as a share of what is used of the recording, in [0, 1).
        trim: begin and end of what is used of the recording (s); None: all of it.

    Returns:
        (seconds · sample_rate,) float32.

    Raises:
        Avs3dError: if the file is missing, not a sound file, truncated, holds NaN, is silent or too short, or would
            have to be looped though it is longer than `LONGEST_LOOP`.
    """
    file = Path(path)
    used = _used(file, trim)
    begin = used.first + int(start * used.frames)
    if begin + seconds * used.rate <= used.last:
        mono, first = _mono(file, begin, begin + round(seconds * used.rate)), 0
    elif used.frames <= LONGEST_LOOP * used.rate:
        mono, first = _mono(file, used.first, used.last), round((begin - used.first) / used.rate * sample_rate)
    else:
        raise Avs3dError(
            f"{file}: {used.frames / used.rate:.0f} s of recording end before the {seconds:g} s of the source; loops "
            f"are of at most {LONGEST_LOOP} s: give it a trim, or name more recordings"
        )
    mono = resampled(mono, used.rate, sample_rate)
    looped = loop(mono, first + round(seconds * sample_rate), round(_CROSS_FADE * sample_rate))[first:]
    loudness = integrated_loudness(looped, sample_rate)
    if loudness < _SILENCE:
        raise Avs3dError(f"{file}: the recording is silent ({loudness:.1f} LUFS); expected at least {_SILENCE:g} LUFS")
    return normalised(looped, sample_rate, TARGET_LUFS, CEILING_DB)


def resampled(mono: NDArray[np.float64], rate: int, sample_rate: int = SAMPLE_RATE) -> NDArray[np.float64]:
    """(n,) samples at ``rate`` Hz as samples at ``sample_rate`` Hz; images and aliases lie 80 dB below the sound.

    The filter that `scipy.signal.resample_poly` designs by itself is short: of what lies near half the sample rate it
    leaves an image at -6 to -20 dB.
    """
    if rate == sample_rate:
        return mono
    divisor = int(np.gcd(rate, sample_rate))
    up, down = sample_rate // divisor, rate // divisor
    longer = max(up, down)
    count, beta = kaiserord(_STOPBAND, _EDGE / longer)
    taps = firwin(count | 1, (1.0 - _EDGE / 2) / longer, window=("kaiser", beta))
    return np.asarray(resample_poly(mono, up, down, window=taps))  # type: ignore[call-overload]


def recorded_seconds(path: Path | str, trim: Span | None = None) -> float:
    """Length of what is used of a recording (s), from its header.

    Raises:
        Avs3dError: if the file is missing, not a sound file, or shorter than ``trim`` says.
    """
    used = _used(Path(path), trim)
    return used.frames / used.rate


@dataclass(frozen=True)
class SoundSurvey:
    """What a look at all samples of a recording tells.

    Attributes:
        seconds: length.
        sample_rate: Hz.
        peak: largest magnitude of a sample of the mean of all channels, full scale 1; NaN if one is not finite.
        clipped: share of the samples that lie in runs of three or more at the ends of the scale.
        missing: bytes of samples that the header promises and the file has not.
    """

    seconds: float
    sample_rate: int
    peak: float
    clipped: float
    missing: int


def survey(path: Path) -> SoundSurvey:
    """Look at every sample of a recording, a block at a time: memory does not grow with its length.

    Raises:
        soundfile.SoundFileError: if it cannot be decoded.
    """
    peak, flat, count = 0.0, 0, 0
    with soundfile.SoundFile(path) as handle:
        rate = int(handle.samplerate)
        for block in handle.blocks(blocksize=_BLOCK, dtype="float32", always_2d=True):
            peak = float(np.maximum(peak, np.abs(block.mean(axis=1)).max(initial=0.0)))  # NaN stays
            ends = np.abs(block) >= _END_OF_SCALE
            runs = ends[2:] & ends[1:-1] & ends[:-2]
            flat += int((np.pad(runs, ((2, 0), (0, 0))) | np.pad(runs, ((0, 2), (0, 0)))).any(axis=1).sum())
            count += len(block)
    return SoundSurvey(count / rate, rate, peak, flat / max(count, 1), _missing_bytes(path))


@dataclass(frozen=True)
class _Used:
    """The frames of a recording that are used: ``first`` to before ``last``, at ``rate`` Hz."""

    first: int
    last: int
    rate: int

    @property
    def frames(self) -> int:
        return self.last - self.first


def _used(file: Path, trim: Span | None) -> _Used:
    if not file.is_file():
        raise _missing(file)
    try:
        found = soundfile.info(file)
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise _unreadable(file, error) from error
    rate, frames = int(found.samplerate), int(found.frames)
    first, last = (0, frames) if trim is None else (round(trim[0] * rate), round(trim[1] * rate))
    if last > frames:
        raise Avs3dError(
            f"{file}: the recording lasts {frames / rate:.2f} s, but its trim ends at {trim[1] if trim else 0:g} s; "
            "correct the trim in the lock file"
        )
    if last - first < _SHORTEST * rate:
        raise Avs3dError(f"{file}: the recording lasts {frames / rate:.2f} s; expected at least {_SHORTEST} s")
    return _Used(first, last, rate)


def loop(signal: NDArray[np.float64], count: int, fade: int) -> NDArray[np.float64]:
    """Repeat ``signal`` to ``count`` samples; each repetition is cross-faded with the next over ``fade`` samples.

    The fade is of equal power (sine and cosine) and at most a quarter of the signal.
    """
    if len(signal) >= count:
        return signal[:count].copy()
    fade = min(fade, len(signal) // 4)
    hop = len(signal) - fade
    t = (np.arange(fade) + 0.5) / max(fade, 1) * (np.pi / 2)
    body = signal.copy()
    body[:fade] = signal[:fade] * np.sin(t) + signal[hop:] * np.cos(t)
    repeats = -(-count // hop)
    out = np.tile(body[:hop], repeats)[:count]
    out[: min(fade, count)] = signal[: min(fade, count)]  # the first repetition has no predecessor
    return out


def _mono(file: Path, first: int, last: int) -> NDArray[np.float64]:
    """Frames ``first`` to before ``last``, the mean of all channels; a file that ends before is refused."""
    try:
        with soundfile.SoundFile(file) as handle:
            handle.seek(first)
            samples = handle.read(last - first, dtype="float64", always_2d=True)
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise _unreadable(file, error) from error
    missing = _missing_bytes(file)
    if missing:
        raise Avs3dError(f"{file}: truncated, {missing} bytes of its samples are missing; fetch it again")
    if len(samples) < last - first:
        raise Avs3dError(f"{file}: truncated, {first + len(samples)} of {last} samples can be read; fetch it again")
    mono = samples.mean(axis=1)
    bad = int((~np.isfinite(mono)).sum())
    if bad:
        raise Avs3dError(f"{file}: {bad} samples are NaN or infinite; repair or replace the recording")
    return np.asarray(mono)


def _missing(file: Path) -> Avs3dError:
    return Avs3dError(f"{file}: no such sound file; expected a WAV or FLAC")


def _unreadable(file: Path, error: Exception) -> Avs3dError:
    return Avs3dError(f"{file}: not a readable WAV or FLAC ({error}); replace the file")


def _missing_bytes(file: Path) -> int:
    """Bytes by which a RIFF/WAVE file is shorter than its data chunk says (libsndfile ignores this)."""
    with file.open("rb") as handle:
        head = handle.read(12)
        if head[:4] != b"RIFF" or head[8:12] != b"WAVE":
            return 0
        size = file.stat().st_size
        while len(chunk := handle.read(8)) == 8:
            length = int.from_bytes(chunk[4:], "little")
            if chunk[:4] == b"data":
                # 0 and the largest number mean "unknown" in streamed files.
                return 0 if length in (0, 0xFFFFFFFF) else max(0, handle.tell() + length - size)
            handle.seek(length + length % 2, 1)
    return 0
