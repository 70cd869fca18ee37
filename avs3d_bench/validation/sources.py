"""The sources of observation.json against the record: where they are, when they sound, what is audible.

In part_1 and part_2 one source always sounds, and frames have no audible entries. Nothing is decoded here: the level of
a frame's clip is the recorded one, which `validation.sound` holds against the clip. `validation.stems` holds the same
entries against the stems.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    AUDIBLE_LEVEL_DB,
    AUDIBLE_SNR_DB,
    EARLIEST_START,
    AudibleRecord,
    FrameRecord,
    ObservationRecord,
    SourceRecord,
)
from avs3d_bench.validation.findings import Findings

#: The sound may come from a little outside the instance's box (a horn, a speaker grille): metres.
SOURCE_MARGIN = 0.1
#: Times of programmes against each other (s).
TIME_TOLERANCE = 1e-6
#: Levels against each other (dB): rounding of clips and numbers.
LEVEL_TOLERANCE_DB = 0.1
#: Longest reverberation that is simulated, and what is allowed where that of the source's room is not recorded (s).
LONGEST_TAIL = 2.0
#: A response has decayed by 60 dB after T30; what is left after this multiple of it counts as silent.
TAIL_PER_T30 = 3.0
#: Rooms beside may ring longer than the one whose T30 is recorded: shortest tail that is allowed (s).
SHORTEST_TAIL = 1.0
#: Clips with an RMS below this are silent (dB re full scale).
SILENT_DB = -120.0
#: A clip without audible sources may be this much louder than the mean of its background (dB): noise varies.
BACKGROUND_VARIES_DB = 6.0


def has_stems(files: set[str], receiver: str | None = None) -> bool:
    """Whether an observation was made with stems (of a receiver; None: of the two ears)."""
    return any(path.startswith(f"{layout.stems_folder(receiver)}/") for path in files)


def tail_of(record: ObservationRecord, source: SourceRecord) -> float:
    """How long a source may be heard after its programme has ended, in seconds."""
    if record.acoustics.t30 is None or source.instance is None:
        return LONGEST_TAIL
    return min(LONGEST_TAIL, max(SHORTEST_TAIL, TAIL_PER_T30 * record.acoustics.t30))


def decibels(amplitude: float) -> float:
    """An amplitude (RMS, re full scale) in dB; −inf for 0."""
    return 20.0 * math.log10(amplitude) if amplitude > 0 else -math.inf


def amplitude(level_db: float) -> float:
    """The amplitude of a level in dB."""
    return float(10.0 ** (level_db / 20.0))


def check_sources(record: ObservationRecord, findings: Findings) -> None:
    """Check the sources of an observation and, in part_3, the audible entries of its frames."""
    for text in (*_positions(record), *_programmes(record), *_off_screen(record)):
        findings.add(layout.OBSERVATION_JSON, text)
    for number, frame in enumerate(record.frames):
        for text in (*_audible(record, frame), *_clip(record, frame)):
            findings.add(layout.OBSERVATION_JSON, f"frames[{number}]: {text}")


def _positions(record: ObservationRecord) -> Iterator[str]:
    """A source in the room is at its instance."""
    instances = {instance.id: instance for instance in record.instances}
    for source in record.sound_sources:
        if source.instance is None:
            continue
        place, box = np.asarray(source.position), np.asarray(instances[source.instance].bounds)
        outside = float(np.linalg.norm(np.maximum(np.maximum(box[0] - place, place - box[1]), 0.0)))
        if outside > SOURCE_MARGIN:
            name = "source_position" if record.sources is None else f"the position of {source.id}"
            yield f"{name} lies {outside:.2f} m outside the bounds of instance {source.instance}"


def _programmes(record: ObservationRecord) -> Iterator[str]:
    end_of_all = len(record.frames) / layout.FRAME_RATE
    for source in record.sound_sources:
        if not source.programme:
            continue  # the frames end before it sounds
        start, end = source.programme[0][0], source.programme[-1][1]
        if start < EARLIEST_START - TIME_TOLERANCE:
            yield f"{source.id}: programme starts at {start:g} s, expected {EARLIEST_START:g} s at the earliest"
        if end > end_of_all + TIME_TOLERANCE:
            yield f"{source.id}: programme ends at {end:g} s, after the last frame ({end_of_all:g} s)"


def _off_screen(record: ObservationRecord) -> Iterator[str]:
    """An off-screen source is no instance, and is where none is (`validation.off_screen` asks whether it is seen)."""
    for source in record.sound_sources:
        if source.instance is not None:
            continue
        place = np.asarray(source.position)
        for instance in record.instances:
            low, high = np.asarray(instance.bounds)
            if ((place >= low) & (place <= high)).all():
                yield f"{source.id} is off-screen (no instance), but its position is inside instance {instance.id}"


def sounds_during(source: SourceRecord, start: float, end: float, tail: float = 0.0) -> bool:
    """Whether a source, or its reverberation of ``tail`` seconds, can be heard in [start, end)."""
    return any(begin < end and stop + tail > start for begin, stop in source.programme)


def sounds_throughout(source: SourceRecord, frame: FrameRecord) -> bool:
    """Whether a source sounds during the whole clip of a frame, so that its direct sound dominates."""
    return any(start <= frame.time and frame.time + 1 / layout.FRAME_RATE <= end for start, end in source.programme)


def _audible(record: ObservationRecord, frame: FrameRecord) -> Iterator[str]:
    for heard in frame.audible or ():
        source = record.source(heard.source)
        tail = tail_of(record, source)
        if heard.level_db < AUDIBLE_LEVEL_DB - LEVEL_TOLERANCE_DB:
            text = f"{heard.source} has {heard.level_db:.1f} dB, below {AUDIBLE_LEVEL_DB:g} dB it is not audible"
            yield text
        if heard.snr_db is not None and heard.snr_db < AUDIBLE_SNR_DB - LEVEL_TOLERANCE_DB:
            yield f"{heard.source} has an SNR of {heard.snr_db:.1f} dB, below {AUDIBLE_SNR_DB:g} dB it is not audible"
        if not sounds_during(source, frame.time, frame.time + 1 / layout.FRAME_RATE, tail):
            yield f"{heard.source} is audible, but its programme has no interval here or in the {tail:.2g} s before"


def _clip(record: ObservationRecord, frame: FrameRecord) -> Iterator[str]:
    """The level of the clip (rms_left, rms_right) against what is audible, where the record says what that is.

    A clip is the sum of a stem and of the rest, so that its RMS lies between the difference and the sum of theirs.
    """
    if frame.audible is None:
        return
    clip = math.hypot(frame.rms_left, frame.rms_right) / math.sqrt(2.0)
    level = decibels(clip)
    for heard in frame.audible:
        low, high = _range(heard)
        if not low - LEVEL_TOLERANCE_DB <= level <= high + LEVEL_TOLERANCE_DB:
            alone = heard.snr_db is None
            what = "alone" if alone else f"an SNR of {heard.snr_db:.1f} dB"
            makes = f"{low:.1f} dB" if alone else f"{low:.1f} to {high:.1f} dB"
            yield (
                f"{heard.source} with {heard.level_db:.1f} dB and {what} makes a clip of {makes}, "
                f"rms_left and rms_right give {level:.1f} dB"
            )
    if frame.audible:
        return
    count, background = len(record.sound_sources), record.background
    if not count and background is None:
        if level > SILENT_DB:
            yield f"nothing sounds (no source, no background), but the clip has {level:.1f} dB"
        return
    # Each inaudible source is below the least level, or 20 dB below a rest that is no louder than 1.1 times the clip.
    least = count * amplitude(AUDIBLE_LEVEL_DB)
    if background is not None:
        least += amplitude(background.level_db + BACKGROUND_VARIES_DB) * (1 + 0.11 * count)
    if level > decibels(least) + LEVEL_TOLERANCE_DB:
        yield f"audible is empty, but the clip has {level:.1f} dB; expected at most {decibels(least):.1f} dB"


def _range(heard: AudibleRecord) -> tuple[float, float]:
    """Least and greatest level of a clip (dB) that holds a stem of this level above a rest of this SNR."""
    stem = amplitude(heard.level_db)
    rest = 0.0 if heard.snr_db is None else amplitude(heard.level_db - heard.snr_db)
    return decibels(abs(stem - rest)), decibels(stem + rest)
