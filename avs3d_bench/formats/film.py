"""MP4 films: H.264 (yuv420p, BT.709) and AAC, made through PyAV; they start while they load.

Each picture is written several times at `RATE` pictures a second, so that players need not cope with films of one
picture a second; repeated pictures cost next to nothing. 30 a second, because 44,100 samples are then 1470 for each
exactly: picture 30·k and sample 44,100·k are at the same instant. Every second starts with a key picture. Nothing in
the file depends on the time, and x264 runs on one thread: same input, same bytes, as long as PyAV and its FFmpeg are
the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout

#: Pictures a second; it divides 44,100.
RATE = 30
#: Quality of x264 (lower is better; 18 is said to be visually lossless) and bits a second of the sound.
QUALITY, SOUND_BITS = 20, 256_000
#: Intensity stereo and noise substitution change levels between the ears: of white noise by 0.26 dB instead of 0.03.
_BINAURAL = {"aac_is": "0", "aac_pns": "0", "aac_ms": "0"}


def encode_film(
    av: Any,
    path: Path,
    pictures: Iterator[NDArray[np.uint8]],
    size: tuple[int, int],
    *,
    comment: str,
    repeat: int = RATE,
    sound: NDArray[np.float32] | None = None,
) -> None:
    """Write a film.

    Args:
        av: the module of PyAV.
        path: the MP4.
        pictures: (height, width, 3) RGB each.
        size: (width, height), even numbers.
        comment: what the file says of its origin.
        repeat: how often each picture is written: `RATE` for a picture a second.
        sound: (2, n) at 44.1 kHz; None: a film without sound.
    """
    # bitexact keeps the muxer's version out; x264 has no B-pictures, so that no edit list delays the first picture.
    options = {"movflags": "+faststart", "fflags": "+bitexact"}
    with av.open(str(path), "w", format="mp4", options=options) as container:
        container.metadata["comment"] = comment
        video = container.add_stream("libx264", rate=RATE)
        (video.width, video.height), video.pix_fmt = size, "yuv420p"
        context = video.codec_context
        context.thread_count = 1
        context.color_primaries = context.color_trc = context.colorspace = 1  # BT.709
        context.color_range = 1  # limited, as players expect
        context.options = {
            "preset": "veryfast", "crf": str(QUALITY), "tune": "stillimage", "bf": "0", "g": str(RATE),
            "keyint_min": str(RATE), "sc_threshold": "0",
        }  # fmt: skip
        audio = None
        if sound is not None:
            audio = container.add_stream("aac", rate=layout.SAMPLE_RATE, layout="stereo")
            audio.bit_rate = SOUND_BITS
            audio.codec_context.thread_count = 1
            audio.codec_context.options = dict(_BINAURAL)
        span = layout.SAMPLE_RATE * repeat // RATE
        for number, picture in enumerate(pictures):
            image = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(
                format="yuv420p", src_colorspace="ITU709", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            for time in range(number * repeat, (number + 1) * repeat):
                image.pts, image.time_base = time, Fraction(1, RATE)
                container.mux(video.encode(image))
            if audio is not None and sound is not None:
                _sound(av, container, audio, sound[:, number * span : (number + 1) * span], number * span)
        container.mux(video.encode(None))
        if audio is not None:
            container.mux(audio.encode(None))


def _sound(av: Any, container: Any, stream: Any, samples: NDArray[np.float32], first: int) -> None:
    frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(samples), format="fltp", layout="stereo")
    frame.sample_rate, frame.pts, frame.time_base = layout.SAMPLE_RATE, first, Fraction(1, layout.SAMPLE_RATE)
    container.mux(stream.encode(frame))
