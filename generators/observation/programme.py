"""When a source sounds: from its programme in the manifest to intervals, and to the gated signal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.contract.layout import SAMPLE_RATE
from generators.manifest.schema import ROUNDING, SHORTEST_SOUND, BurstsSpec, ProgrammeSpec, TurnSpec

Interval = tuple[float, float]

#: Duration of the raised-cosine ramps at the start and the end of an interval (s): no click, and still one onset.
RAMP = 0.005


def intervals_of(
    programme: ProgrammeSpec | None, seconds: float, pre_roll: float, rng: Generator
) -> tuple[Interval, ...]:
    """The intervals [start, end) in which a source sounds, in seconds from the first frame, increasing.

    Args:
        programme: of the source; None: it always sounds, and has sounded for ``pre_roll`` before the first frame.
        seconds: length of the observation; what is later is cut off, so that there may be no interval at all.
        pre_roll: length of the simulation before the first frame, seconds.
        rng: draws the bursts; used for nothing else.
    """
    if programme is None:
        return ((-pre_roll, seconds),)
    if programme.bursts is not None:
        found: Iterator[Interval] | Sequence[Interval] = _bursts(programme.bursts, seconds, rng)
    elif programme.turn is not None:
        found = _turns(programme.turn, seconds)
    else:
        found = programme.intervals or ()
    cut = ((start, min(end, seconds)) for start, end in found)
    return tuple((start, end) for start, end in cut if end - start > SHORTEST_SOUND - ROUNDING)


def _bursts(spec: BurstsSpec, seconds: float, rng: Generator) -> Iterator[Interval]:
    end = 0.0
    while end < seconds:
        start = end + float(rng.uniform(*spec.pause))
        end = start + float(rng.uniform(*spec.sound))
        yield start, end


def _turns(spec: TurnSpec, seconds: float) -> Iterator[Interval]:
    step = spec.seconds + spec.pause
    start = spec.start
    while start < seconds:
        yield start, start + spec.seconds
        start += spec.of * step


def gated(
    signal: NDArray[np.floating], intervals: Sequence[Interval], pre_roll: float, sample_rate: int = SAMPLE_RATE
) -> NDArray[np.float32]:
    """A signal that is 0 outside the intervals; inside, ramps of `RAMP` at both ends keep it free of clicks.

    Args:
        signal: (n,) from ``pre_roll`` seconds before the first frame on.
        intervals: in seconds from the first frame; the ones that start with the signal have no ramp there.
        pre_roll: seconds.
        sample_rate: Hz.

    Returns:
        (n,) float32; the first and the last sample of an interval are not 0 where the signal is not.
    """
    gate = np.zeros(len(signal))
    for start, end in intervals:
        first = max(round((start + pre_roll) * sample_rate), 0)
        last = min(round((end + pre_roll) * sample_rate), len(signal))
        count = min(round(RAMP * sample_rate), (last - first) // 2)
        rise = np.sin((np.arange(count) + 0.5) / count * (np.pi / 2)) ** 2
        gate[first:last] = 1.0
        if first > 0:
            gate[first : first + count] = rise
        if last < len(signal):
            gate[last - count : last] = rise[::-1]
    return np.asarray(signal * gate, dtype=np.float32)
