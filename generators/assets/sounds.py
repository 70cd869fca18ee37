"""Mono source signals, synthesised per category or from a recording, at a common loudness.

All sources have the same integrated loudness (ITU-R BS.1770-4) and a limited true peak, so that no category is louder
than another and, with the clips' fixed gain, none clips.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import resample_poly

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.contract.taxonomy import check_category
from avs3d_bench.errors import Avs3dError
from generators.assets.synthesis.loudness import integrated_loudness, normalised
from generators.assets.synthesis.voices import speak

#: Loudness of every source (LUFS).
TARGET_LUFS = -18.0
#: Largest true peak of a source (dBTP).
CEILING_DB = -1.0
#: Least level of every second of a source (dBFS, RMS).
SECOND_FLOOR_DB = -45.0
#: Least length of a recording, and longest cross-fade of its loop (s).
_SHORTEST = 0.5
_CROSS_FADE = 0.5
#: A recording below this loudness counts as silent (LUFS).
_SILENCE = -60.0


def synthesise(category: str, seconds: float, rng: Generator) -> NDArray[np.float32]:
    """A source of ``category`` whose variant is drawn from ``rng``.

    Args:
        category: one of the seven.
        seconds: length, at least 1.
        rng: the only source of randomness.

    Returns:
        (seconds · 44100,) float32 mono at `TARGET_LUFS`, true peak below `CEILING_DB`; every second of it above
        `SECOND_FLOOR_DB`.

    Raises:
        UsageError: for an unknown category.
        Avs3dError: for a length below one second or above an hour.
    """
    check_category(category)
    if not 1.0 <= seconds <= 3600.0:
        raise Avs3dError(f"sound of {category}: length {seconds} s, expected 1 to 3600 s")
    raw = speak(category, round(seconds * SAMPLE_RATE), rng)
    return normalised(raw, SAMPLE_RATE, TARGET_LUFS, CEILING_DB)


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
    if rate != sample_rate:
        divisor = int(np.gcd(rate, sample_rate))
        mono = resample_poly(mono, sample_rate // divisor, rate // divisor)
    first = int(start * len(mono))
    looped = loop(mono, first + round(seconds * sample_rate), round(_CROSS_FADE * sample_rate))[first:]
    loudness = integrated_loudness(looped, sample_rate)
    if loudness < _SILENCE:
        raise Avs3dError(f"{file}: the recording is silent ({loudness:.1f} LUFS); expected at least {_SILENCE:g} LUFS")
    return normalised(looped, sample_rate, TARGET_LUFS, CEILING_DB)


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


def stretches(lengths: Sequence[float], seconds: float, count: int, rng: Generator) -> list[tuple[int, float]]:
    """Where each of several takes begins, so that no two have a sample in common if the recordings reach for that.

    Each recording is divided into stretches, which are dealt in random order. If they are too few, the takes are spread
    over all recordings, as far apart in each as its length allows: takes of one recording overlap then.

    Args:
        lengths: of the recordings (s).
        seconds: length of a take.
        count: number of takes.
        rng: the only source of randomness.

    Returns:
        For each take the number of its recording, and its begin as a share of that recording, in [0, 1).

    Examples:
        >>> found = stretches([31.0, 10.0], 10.0, 4, np.random.default_rng(0))
        >>> sorted((number, int(start * [31, 10][number]) // 10) for number, start in found)
        [(0, 0), (0, 1), (0, 2), (1, 0)]
    """
    offsets = rng.random(len(lengths))
    order = rng.permutation(len(lengths))
    if enough(lengths, seconds, count):
        slots = []
        for number, length in enumerate(lengths):
            whole = int(length / seconds)
            spare = float(offsets[number]) * (length - whole * seconds)
            slots += [(number, (spare + place * seconds) / length) for place in range(whole)]
        return [slots[int(chosen)] for chosen in rng.permutation(len(slots))[:count]]
    owners = [int(order[take % len(lengths)]) for take in range(count)]
    shares = [owners.count(number) for number in range(len(lengths))]
    dealt = [(number, place) for number in range(len(lengths)) for place in range(shares[number])]
    dealt = [dealt[int(chosen)] for chosen in rng.permutation(count)]
    return [(number, float((offsets[number] + place / shares[number]) % 1.0)) for number, place in dealt]


def enough(lengths: Sequence[float], seconds: float, count: int) -> bool:
    """Whether recordings of these lengths (s) have ``count`` stretches without a common sample."""
    return stretches_in(lengths, seconds) >= count


def stretches_in(lengths: Sequence[float], seconds: float) -> int:
    """Number of stretches without a common sample that recordings of these lengths (s) have."""
    return sum(int(length / seconds) for length in lengths)


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
