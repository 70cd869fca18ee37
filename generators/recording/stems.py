"""Stems: the clip of each source of a part_3 observation alone, and the figures that follow from them.

The sources are independent of one another: each has an acoustic session of its own, so that its stem has the same bytes
whatever else sounds, and the clip is the sum of the stems.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.schema import AUDIBLE_LEVEL_DB, AUDIBLE_SNR_DB, AudibleRecord
from generators.acoustics.base import BatchSession
from generators.acoustics.clips import binaural_clip
from generators.acoustics.direct import DirectPath
from generators.recording.hearing import PRE_ROLL, AcousticJob, Recording, hear_still

Clip = NDArray[np.float32]

#: Poses that all sessions together compute at a time; their arrivals are in memory, about 1 MB each.
_TOGETHER = 128
#: Level below that of a stem under which a difference is rounding (dB).
_NO_PART_DB = -90.0
#: Level below which samples are rounding of 32-bit numbers, not sound (dB re full scale).
_NOTHING_DB = -150.0


@dataclass(frozen=True, eq=False)
class HeardSource:
    """One source in one second.

    Attributes:
        stem: (2, 44100) float32, its own clip.
        drr_db: level of the direct sound in it above that of all that comes later; None where there is none of either.
        response: (2, n) float32, from the source to the listener.
        others: name of each receiver beside the two ears → what it hears of the source.
    """

    stem: Clip
    drr_db: float | None
    response: NDArray[np.float32]
    others: Mapping[str, Recording] = field(default_factory=dict)


def hear_sources(listenings: Sequence[AcousticJob]) -> Generator[tuple[HeardSource, ...]]:
    """Hear every source in each second, in order; one response per source and second.

    Args:
        listenings: one per source, with the same poses; empty for a scene without sources, which yields nothing.
    """
    if not listenings:
        return
    sessions = []
    try:
        for one in listenings:
            sessions.append(one.engine().open(one.scene, one.sources[0], room=one.room, sample_rate=layout.SAMPLE_RATE))
            if isinstance(sessions[-1], BatchSession):
                sessions[-1].prepare(one.poses, max(1, _TOGETHER // len(listenings)))
        paths = [DirectPath(one.scene, one.sources[0]) for one in listenings]
        for index, pose in enumerate(listenings[0].poses):
            heard = []
            for one, session, path in zip(listenings, sessions, paths, strict=True):
                found = hear_still(session, one, index)
                stem, response = found.head.clip, found.head.response
                direct = path.of(response, pose)
                part = None if direct is None else binaural_clip(one.samples, direct, index + PRE_ROLL)
                ratio = None if part is None else direct_to_reverberant(part, stem)
                heard.append(HeardSource(stem, ratio, response, found.others))
            yield tuple(heard)
    finally:
        for session in sessions:
            session.close()


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


def audible_sources(clip: Clip, heard: Mapping[str, HeardSource]) -> tuple[AudibleRecord, ...]:
    """The sources that are audible in a second: loud enough, and not drowned by the rest of the clip.

    Args:
        clip: (2, 44100) everything that is heard.
        heard: id of a source → what is heard of it.

    Returns:
        Their records, in the order of ``heard``.
    """
    found = []
    for name, one in heard.items():
        level = decibels(power(one.stem))
        rest = decibels(power(clip.astype(np.float64) - one.stem))
        alone = rest < max(_NOTHING_DB, level + _NOTHING_DB)
        if level >= AUDIBLE_LEVEL_DB and (alone or level - rest >= AUDIBLE_SNR_DB):
            snr = None if alone else level - rest
            found.append(AudibleRecord(source=name, level_db=level, drr_db=one.drr_db, snr_db=snr))
    return tuple(found)
