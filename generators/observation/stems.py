"""Stems: the clips of single sources, of which the clip of an observation is the sum; their levels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB, AUDIBLE_SNR_DB, AudibleRecord

Clip = NDArray[np.float32]

#: Level below that of a stem under which a difference is rounding (dB).
_NO_PART_DB = -90.0
#: Level below which samples are rounding of 32-bit numbers, not sound (dB re full scale).
_NOTHING_DB = -150.0


@dataclass(frozen=True, eq=False)
class Stem:
    """One source alone in one second.

    Attributes:
        clip: (2, 44100) float32, at the two ears.
        drr_db: level of the direct sound in it above that of all that comes later; None where there is none of either,
            or it was not measured.
    """

    clip: Clip
    drr_db: float | None = None


def direct_to_reverberant(direct: Clip, stem: Clip) -> float | None:
    """Level of the direct sound above that of the rest of a stem, dB; None if either of them is missing.

    Args:
        direct: (2, 44100) the clip of the direct sound alone.
        stem: (2, 44100) everything that is heard of the source.
    """
    early, late = power(direct), power(stem.astype(np.float64) - direct)
    least = power(stem) * 10 ** (_NO_PART_DB / 10)
    return decibels(early) - decibels(late) if min(early, late) > least else None


def power(clip: NDArray[np.floating]) -> float:
    """Mean square over all samples."""
    return float(np.mean(np.square(clip, dtype=np.float64)))


def decibels(value: float) -> float:
    """10·lg of a power; −inf for 0."""
    return 10 * math.log10(value) if value > 0 else -math.inf


def mixture(stems: Sequence[Clip], channels: int = 2) -> Clip:
    """The sum of stems (channels, 44100), rounded once; silence for none."""
    total = np.zeros((channels, layout.BINAURAL_SAMPLES))
    for stem in stems:
        total += stem
    return total.astype(np.float32)


def audible_sources(clip: Clip, stems: Mapping[str, Stem]) -> tuple[AudibleRecord, ...]:
    """The sources that are audible in a second: loud enough, and not drowned by the rest of the clip.

    Args:
        clip: (2, 44100) everything that is heard.
        stems: id of a source → its stem.

    Returns:
        Their records, in the order of ``stems``.
    """
    found = []
    for name, one in stems.items():
        level = decibels(power(one.clip))
        rest = decibels(power(clip.astype(np.float64) - one.clip))
        alone = rest < max(_NOTHING_DB, level + _NOTHING_DB)
        if level >= AUDIBLE_LEVEL_DB and (alone or level - rest >= AUDIBLE_SNR_DB):
            snr = None if alone else level - rest
            found.append(AudibleRecord(source=name, level_db=level, drr_db=one.drr_db, snr_db=snr))
    return tuple(found)
