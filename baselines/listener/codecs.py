"""Sounds as files of Ogg Vorbis and MP3 give them back: what a lossy codec leaves of two ears."""

from __future__ import annotations

import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import soundfile
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from avs3d_bench.runtime.parallel import available_cores

#: Name → libsndfile's format and subtype.
CODECS = {"ogg": ("OGG", "VORBIS"), "mp3": ("MP3", "MPEG_LAYER_III")}
#: Highest sample of a file.
PEAK = 0.95
#: Most threads that code at the same time; libsndfile works outside the interpreter's lock.
THREADS = 12


def coded(samples: NDArray[np.float32], rate: int, codec: str, level: float) -> tuple[NDArray[np.float32], float]:
    """A clip (channels, n) written by libsndfile and read again, with as many samples, and the bit rate (kbit/s).

    Args:
        samples: of all channels, in one stream; up to ±1.
        rate: Hz.
        codec: of `CODECS`.
        level: 0 (best) to 1 (smallest), libsndfile's compression level.

    Raises:
        soundfile.SoundFileError: if the codec does not take this rate or level.
    """
    kind, subtype = CODECS[codec]
    stream = io.BytesIO()
    soundfile.write(stream, samples.T, rate, format=kind, subtype=subtype, compression_level=level)
    size = stream.tell()
    stream.seek(0)
    found = soundfile.read(stream, dtype="float32", always_2d=True)[0].T
    out = np.zeros_like(samples)
    kept = min(out.shape[1], found.shape[1])
    out[:, :kept] = found[:, :kept]
    return out, size * 8e-3 * rate / samples.shape[1]


def all_coded(clips: NDArray[np.float32], codecs: Sequence[str], levels: Sequence[float]) -> NDArray[np.float32]:
    """Clips (B, channels, n) at `SAMPLE_RATE`, each after its codec; louder ones than `PEAK` are coded more softly.

    Args:
        clips: of any level.
        codecs: of each clip, of `CODECS`.
        levels: of each clip, see `coded`.
    """

    def one(row: int) -> NDArray[np.float32]:
        scale = max(1.0, float(np.abs(clips[row]).max()) / PEAK)
        return coded(clips[row] / np.float32(scale), SAMPLE_RATE, codecs[row], levels[row])[0] * np.float32(scale)

    return np.stack(list(_pool().map(one, range(len(clips)))))


@cache
def _pool() -> ThreadPoolExecutor:
    # One for the process: a step begins a few dozen clips.
    return ThreadPoolExecutor(min(THREADS, available_cores()), thread_name_prefix="codec")
