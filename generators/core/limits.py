"""Allowed ranges and words: of a run's options, for the manifest, the command line and Python; and of settings."""

from __future__ import annotations

from typing import Literal

from avs3d_bench.errors import Avs3dError

#: Heads that have a name; any other is a SOFA file.
HeadName = Literal["sphere", "family", "family-test", "kemar"]
#: What a voice or a recording is for; none is for two.
SoundSplit = Literal["train", "validation", "test"]

#: Least and greatest number of frames of an observation; file names of frames have three digits.
FRAMES = (1, 999)
#: Least and greatest side of a picture (pixels).
SIZE = (16, 8192)
#: Least and greatest level of a source re the common loudness (dB).
SOURCE_LEVEL = (-40.0, 20.0)
#: Greatest index of an observation among those of its part, scan and room: a grid of variants needs thousands.
MOST_INDEX = 9_999
#: Highest order of a cardioid: 32 times quieter (30 dB) at 72° than on its axis.
MOST_ORDER = 16
#: Least and greatest number of worker processes.
WORKERS = (1, 256)
#: An observation makes use of so many cores: four render frames, and the sound, which only one can compute, then takes
#: as long as they do (docs/scaling.md).
MOST_CORES = 5


def check_ranges(what: str, settings: object, ranges: dict[str, tuple[float, float]]) -> None:
    """Check numeric fields of ``settings``.

    Args:
        what: the settings' name in the message.
        settings: an object with these fields.
        ranges: field → least and greatest value.

    Raises:
        Avs3dError: naming the first field that is out of its range or NaN.
    """
    for name, (low, high) in ranges.items():
        value = getattr(settings, name)
        if not low <= value <= high:
            raise Avs3dError(f"{what}: {name} is {value}, expected {low} to {high}")
