"""One continuous track of an observation's clips, for listening only.

The impulse response changes with every frame, so that clips of successive seconds do not join smoothly. In the first
5 ms of a clip the end of the one before, mirrored, is faded out while the clip fades in: no click, and all other
samples are those of the dataset. The track is FLAC, which changes no sample: samples are rounded as a 16-bit file would
hold them (noise 98 dB below full scale), to fewer bits (12 at least) where the track would be larger than
`MOST_BYTES`, and shifted up by whole bits (6 dB each, the same for the whole observation) so that quiet sources can be
heard.
"""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract.layout import (
    AMBISONICS,
    BINAURAL,
    BINAURAL_SAMPLES,
    SAMPLE_RATE,
    audio_path,
    clips_folder,
    stem_path,
)
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError

#: Length of the cross-fade where clips meet.
FADE_SECONDS = 0.005
#: Bits of headroom that may be used up at most: 24 dB.
MAX_SHIFT = 4
#: Noise compresses badly; with its pictures an observation stays below 15 MB.
MOST_BYTES = 9_000_000
#: Bits of a sample at full scale, and the fewest to which it is rounded.
BITS, FEWEST_BITS = 16, 12
#: Channels of first-order ambisonics.
_FIRST_ORDER = 4


@dataclass(frozen=True)
class Track:
    """Sound for the player.

    Attributes:
        data: FLAC, 44,100 Hz, 16 bits; two channels, four of ambisonics.
        bits: to which samples at full scale were rounded.
        gain: dB by which it is louder than the files.
        problems: one line for each clip that could not be read; there is silence in its place.
    """

    data: bytes
    bits: int
    gain: float
    problems: tuple[str, ...]


def joined(clips: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Clips (channels, n) each, one after the other, cross-faded in the first 5 ms of each but the first.

    Returns:
        (channels, n · len(clips)).
    """
    length = round(FADE_SECONDS * SAMPLE_RATE)
    # From 0 to 1, neither included: the last sample of the clip before has weight 1 already.
    rise = np.sin(0.5 * np.pi * (np.arange(length) + 1) / (length + 1)) ** 2
    out = [clip.astype(np.float32, copy=True) for clip in clips]
    for before, clip in zip(clips, out[1:], strict=False):
        mirrored = before[:, -1 : -length - 1 : -1]
        clip[:, :length] = rise * clip[:, :length] + (1 - rise) * mirrored
    return np.concatenate(out, axis=1)


def read_clip(frame: Frame) -> NDArray[np.float32]:
    """The clip (2, 44100) of a frame.

    One that is shorter than a second (none of ours is) is followed by silence, a longer one is cut: the next frame
    starts on its second whatever the one before brought.

    Raises:
        Avs3dError: if it is missing or damaged, holds nothing, or has other than two channels.
    """
    return _second(frame.audio(), frame.observation.path / audio_path(BINAURAL, frame.index))


def _second(read: NDArray[np.float32], where: Path, channels: int = 2) -> NDArray[np.float32]:
    """Cut samples that were read from ``where`` to one second, or fill them with zeros."""
    if read.shape[0] != channels or not read.shape[1]:
        found = f"{read.shape[0]} channel(s) of {read.shape[1]} samples"
        raise Avs3dError(f"{where}: {found}, expected {channels} of a second")
    clip = np.zeros((channels, BINAURAL_SAMPLES), dtype=np.float32)
    count = min(BINAURAL_SAMPLES, read.shape[1])
    clip[:, :count] = read[:, :count]
    return clip


def read_track(observation: Observation) -> Track:
    """Read the clips and make the track; a clip that cannot be read is a second of silence and a line.

    Raises:
        Avs3dError: if the observation has no frames.
    """
    return _track(observation, read_clip)


def read_stem_track(observation: Observation, name: str) -> Track:
    """The track of one stem (``source_1`` or ``background``), joined as the clips are; see `read_track`.

    The joining is linear: the stems' tracks, each lowered by its own gain, add up to that of the clips, but for the
    rounding of each.
    """

    def read(frame: Frame) -> NDArray[np.float32]:
        return _second(frame.stem(name), observation.path / stem_path(name, frame.index))

    return _track(observation, read)


def read_ambisonics_track(observation: Observation) -> Track:
    """The track of the first-order ambisonics (W, Y, Z, X), joined as the clips are; see `read_track`."""
    channels = observation.channels(AMBISONICS)

    def read(frame: Frame) -> NDArray[np.float32]:
        where = observation.path / audio_path(clips_folder(AMBISONICS), frame.index)
        return _second(frame.ambisonics(), where, channels)[:_FIRST_ORDER]

    return _track(observation, read, _FIRST_ORDER)


def stem_script(key: str, name: str, track: Track) -> bytes:
    """The track of a stem as a script that hands it to the player: JSON arguments, the FLAC in base64."""
    arguments = (key, name, round(track.gain, 3), base64.b64encode(track.data).decode())
    return f"window.AVS3D.stem({', '.join(json.dumps(value) for value in arguments)});\n".encode()


def _track(observation: Observation, read: Callable[[Frame], NDArray[np.float32]], channels: int = 2) -> Track:
    clips, problems = [], []
    for frame in observation.frames:
        try:
            clips.append(read(frame))
        except Avs3dError as error:
            clips.append(np.zeros((channels, BINAURAL_SAMPLES), dtype=np.float32))
            problems.append(str(error))
    samples = joined(clips)
    shift = shift_for(float(np.abs(samples).max(initial=0.0)))
    for bits in range(BITS, FEWEST_BITS - 1, -1):
        data = _flac(_rounded(samples, bits, shift))
        if len(data) <= MOST_BYTES:
            break
    return Track(data, bits, 20 * math.log10(2) * shift, tuple(problems))


def _rounded(samples: NDArray[np.float32], bits: int, shift: int) -> NDArray[np.int16]:
    """Samples rounded to so many bits of full scale, raised by ``shift`` bits, in 16 bits."""
    steps = np.rint(samples * 2.0 ** (bits - 1))
    up = BITS - bits + shift
    low, high = -(2.0**15) / 2**up, 2.0**15 / 2**up - 1
    return np.asarray(np.clip(steps, low, high).astype(np.int16) << up, dtype=np.int16)


def shift_for(peak: float) -> int:
    """By how many bits a signal of this peak (full scale 1) can be raised without clipping, at most `MAX_SHIFT`."""
    if peak <= 0:
        return 0
    return int(np.clip(math.floor(-math.log2(peak)), 0, MAX_SHIFT))


def _flac(samples: NDArray[np.int16]) -> bytes:
    import soundfile

    stream = io.BytesIO()
    with soundfile.SoundFile(stream, "w", SAMPLE_RATE, len(samples), subtype="PCM_16", format="FLAC") as file:
        file.write(np.ascontiguousarray(samples.T))
    return stream.getvalue()
