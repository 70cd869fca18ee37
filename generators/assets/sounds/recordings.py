"""Recordings as sources: read, mixed to mono, resampled, looped, brought to the common loudness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy.signal import resample_poly

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.errors import Avs3dError
from generators.assets.sounds.loudness import CEILING_DB, TARGET_LUFS, integrated_loudness, normalised

#: Least length of a recording, and longest cross-fade of its loop (s).
_SHORTEST = 0.5
_CROSS_FADE = 0.5
#: A recording below this loudness counts as silent (LUFS).
_SILENCE = -60.0


def load_sound(
    path: Path | str, seconds: float, sample_rate: int = SAMPLE_RATE, *, start: float = 0.0
) -> NDArray[np.float32]:
    """A recording as a source: mixed to mono, resampled, looped with a cross-fade, brought to `TARGET_LUFS`.

    Args:
        path: any WAV or FLAC.
        seconds: length of the source; a longer recording is cut, a shorter one looped.
        sample_rate: rate of the source, Hz.
        start: where the source begins, as a share of the recording, in [0, 1).

    Returns:
        (seconds · sample_rate,) float32.

    Raises:
        Avs3dError: if the file is missing, not a sound file, truncated, holds NaN, is silent or too short.
    """
    file = Path(path)
    samples, rate = _read(file)
    mono = samples.mean(axis=1)
    bad = int((~np.isfinite(mono)).sum())
    if bad:
        raise Avs3dError(f"{file}: {bad} samples are NaN or infinite; repair or replace the recording")
    if len(mono) < _SHORTEST * rate:
        raise Avs3dError(f"{file}: the recording lasts {len(mono) / rate:.2f} s; expected at least {_SHORTEST} s")
    mono = resampled(mono, rate, sample_rate)
    first = int(start * len(mono))
    looped = loop(mono, first + round(seconds * sample_rate), round(_CROSS_FADE * sample_rate))[first:]
    loudness = integrated_loudness(looped, sample_rate)
    if loudness < _SILENCE:
        raise Avs3dError(f"{file}: the recording is silent ({loudness:.1f} LUFS); expected at least {_SILENCE:g} LUFS")
    return normalised(looped, sample_rate, TARGET_LUFS, CEILING_DB)


def resampled(mono: NDArray[np.float64], rate: int, sample_rate: int = SAMPLE_RATE) -> NDArray[np.float64]:
    """(n,) samples at ``rate`` Hz as samples at ``sample_rate`` Hz."""
    if rate == sample_rate:
        return mono
    divisor = int(np.gcd(rate, sample_rate))
    return np.asarray(resample_poly(mono, sample_rate // divisor, rate // divisor))


def recorded_seconds(path: Path | str) -> float:
    """Length of a recording (s), from its header.

    Raises:
        Avs3dError: if the file is missing or not a sound file.
    """
    file = Path(path)
    if not file.is_file():
        raise _missing(file)
    try:
        found = soundfile.info(file)
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise _unreadable(file, error) from error
    return float(found.frames / found.samplerate)


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


def _read(file: Path) -> tuple[NDArray[np.float64], int]:
    """Samples (n, channels) float64 and the sample rate; a file that is shorter than its header says is refused."""
    if not file.is_file():
        raise _missing(file)
    try:
        with soundfile.SoundFile(file) as handle:
            promised, rate = handle.frames, handle.samplerate
            samples = handle.read(dtype="float64", always_2d=True)
    except (soundfile.SoundFileError, RuntimeError, OSError) as error:
        raise _unreadable(file, error) from error
    missing = _missing_bytes(file)
    if missing:
        raise Avs3dError(f"{file}: truncated, {missing} bytes of its samples are missing; fetch it again")
    if len(samples) == 0 or len(samples) < promised:
        raise Avs3dError(f"{file}: truncated, {len(samples)} of {promised} samples can be read; fetch it again")
    return samples, rate


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
