"""Sounds as files of Ogg Vorbis and MP3 give them back: what a lossy codec leaves of two ears."""

from __future__ import annotations

import io

import numpy as np
import soundfile
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE

#: Name → libsndfile's format and subtype.
CODECS = {"ogg": ("OGG", "VORBIS"), "mp3": ("MP3", "MPEG_LAYER_III")}
#: Compression levels of what is learnt from (190 to 100 kbit/s of Vorbis, 130 to 70 of MP3) and its highest sample.
LEVELS, PEAK = (0.5, 0.97), 0.95


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


def drawn(samples: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """A clip (channels, n) at `SAMPLE_RATE` after a codec and a level of `LEVELS` that are drawn.

    Louder ones than `PEAK` are coded more softly, so that nothing is clipped.
    """
    codec, level = list(CODECS)[rng.integers(len(CODECS))], rng.uniform(*LEVELS)
    scale = np.float32(max(1.0, float(np.abs(samples).max()) / PEAK))
    return coded(samples / scale, SAMPLE_RATE, codec, level)[0] * scale
