"""The stems of part_3: against the clips, the audible entries, the programmes and the background of the record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    AUDIBLE_LEVEL_DB,
    AUDIBLE_SNR_DB,
    BackgroundRecord,
    FrameRecord,
    ObservationRecord,
    SourceRecord,
)
from avs3d_bench.dataset import Frame
from avs3d_bench.validation.background import Coherence
from avs3d_bench.validation.findings import Findings, read
from avs3d_bench.validation.sound import SILENCE, BinauralClip, check_response
from avs3d_bench.validation.sources import decibels, sounds_throughout, tail_of

#: The sum of the stems is the clip, to this difference of samples.
SUM_TOLERANCE = 1e-6
#: Recorded levels against those of the stems (dB).
LEVEL_TOLERANCE_DB = 0.05
#: A rest of a clip that is quieter than the first may be what rounding leaves, one below the second is nothing but
#: that (dB re full scale): between them it may be recorded as silent or not.
ROUNDING_DB, NOTHING_DB = -120.0, -150.0
#: Level of the background over all frames, and that of all sources above it (dB).
BACKGROUND_TOLERANCE_DB, BACKGROUND_SNR_TOLERANCE_DB = 0.1, 0.5
#: Length of the blocks in which a stem is held to its programme (samples): 10 ms.
BLOCK = layout.SAMPLE_RATE // 100
#: Outside its programme a stem may have this share of its loudest second's RMS: what is left of the tail.
OUTSIDE_SHARE = 10.0 ** (-70.0 / 20.0)
#: Blocks beside the edge of an interval that are not judged: fades, filters that ring before the sound.
EDGE_BLOCKS = 2
#: An interval of this length or longer is not silent (s): sounds with pauses are shorter than that between events.
LEAST_SOUNDING = 1.0


@dataclass
class Stems:
    """Figures of the stems, collected frame by frame; `finish` judges them.

    Attributes:
        power: source's id → mean square of both ears in blocks of `BLOCK` samples, one array per frame (None where the
            stem is missing).
        sources: mean square of all sources together, of each frame that has all stems.
        background: mean square of the background of each frame.
        coherence: of the background's ears.
    """

    record: ObservationRecord
    power: dict[str, list[NDArray[np.float64] | None]] = field(default_factory=dict)
    sources: list[float] = field(default_factory=list)
    background: list[float] = field(default_factory=list)
    coherence: Coherence = field(default_factory=Coherence)

    def add(self, frame: Frame, clip: BinauralClip | None, files: set[str], findings: Findings) -> None:
        """Read the stems of one frame and hold them against its clip and its audible entries."""
        entry = frame.record
        names = layout.Part3Contents(
            tuple(source.id for source in self.record.sources or ()),
            stems=True,
            background=self.record.background is not None,
        ).stem_names
        stems = {name: _read_stem(frame, name, files, findings) for name in names}
        for source in self.record.sources or ():
            self.power.setdefault(source.id, []).append(_blocks(stems[source.id]))
            check_source_response(frame, source, stems[source.id], files, findings)
        noise = stems.get(layout.BACKGROUND)
        if noise is not None:
            self.background.append(float(np.mean(np.square(noise, dtype=np.float64))))
            self.coherence.add(noise)
        whole = {name: stem for name, stem in stems.items() if stem is not None}
        if clip is None or len(whole) < len(stems):
            return  # already named
        path = layout.audio_path(layout.BINAURAL, frame.index)
        total = sum((each.astype(np.float64) for each in whole.values()), start=np.zeros(clip.samples.shape))
        others = total if noise is None else total - noise
        self.sources.append(float(np.mean(np.square(others))))
        off = float(np.abs(total - clip.samples).max(initial=0.0))
        if off > SUM_TOLERANCE:
            text = f"differs from the sum of its stems by up to {off:.2g}; expected at most {SUM_TOLERANCE:g}"
            findings.add(path, text)
        if entry is not None:
            _check_audible(frame, entry, clip, whole, findings)

    def finish(self, findings: Findings) -> None:
        """Hold each source against its programme and the background against its record."""
        for source in self.record.sources or ():
            blocks = self.power.get(source.id, [])
            if blocks and all(each is not None for each in blocks):
                power = np.concatenate([each for each in blocks if each is not None])
                _check_programme(source, power, tail_of(self.record, source), findings)
        background = self.record.background
        if background is not None and len(self.background) == len(self.record.frames):
            self._check_background(background, findings)

    def _check_background(self, background: BackgroundRecord, findings: Findings) -> None:
        mean = float(np.mean(self.background))
        level = decibels(mean**0.5)
        if not abs(level - background.level_db) <= BACKGROUND_TOLERANCE_DB:
            text = f"background.level_db is {background.level_db:.2f} dB, its stem has {level:.2f} dB"
            findings.add(layout.OBSERVATION_JSON, text)
        sources = decibels(float(np.mean(self.sources)) ** 0.5) if self.sources else NOTHING_DB
        if len(self.sources) == len(self.background) and sources > NOTHING_DB:
            snr = sources - level
            if not abs(snr - background.snr_db) <= BACKGROUND_SNR_TOLERANCE_DB:
                text = f"background.snr_db is {background.snr_db:.1f} dB, the stems give {snr:.1f} dB"
                findings.add(layout.OBSERVATION_JSON, text)
        problem = self.coherence.problem()
        if problem is not None:
            findings.add(f"{layout.STEMS}/{layout.BACKGROUND}", problem)


def _read_stem(frame: Frame, name: str, files: set[str], findings: Findings) -> NDArray[np.float32] | None:
    stem = read(findings, files, layout.stem_path(name, frame.index), partial(frame.stem, name))
    return None if stem is None or stem.shape != (2, layout.BINAURAL_SAMPLES) else stem


def _blocks(stem: NDArray[np.float32] | None) -> NDArray[np.float64] | None:
    if stem is None:
        return None
    power = np.mean(np.square(stem, dtype=np.float64), axis=0)
    return np.asarray(power.reshape(-1, BLOCK).mean(axis=1))


def check_source_response(
    frame: Frame, source: SourceRecord, stem: NDArray[np.float32] | None, files: set[str], findings: Findings
) -> None:
    """Read the response of a source, if there is one, and hold it against the source's stem, if that is known.

    Where the source does not sound during the whole clip, most of the stem may be from before it; what moves is heard
    with other responses as well.
    """
    path = layout.rir_path(frame.index, source.id)
    response = read(findings, files, path, partial(frame.impulse_response, source.id))
    if response is None or stem is None or frame.record is None or not sounds_throughout(source, frame.record):
        return
    whole = frame.observation.record
    if whole is not None and whole.source_moves(source):
        return
    if float(np.abs(stem).max()) > SILENCE:
        check_response(path, layout.stem_path(source.id, frame.index), stem, response, findings)


def _level(samples: NDArray[np.floating]) -> float:
    return decibels(float(np.mean(np.square(samples, dtype=np.float64))) ** 0.5)


def _check_audible(
    frame: Frame, entry: FrameRecord, clip: BinauralClip, stems: Mapping[str, NDArray[np.float32]], findings: Findings
) -> None:
    """Levels, SNRs and the choice of the audible sources, from the stems themselves."""
    listed = {heard.source: heard for heard in entry.audible or ()}
    for name, stem in stems.items():
        if name == layout.BACKGROUND:
            continue
        level, rest = _level(stem), _level(clip.samples.astype(np.float64) - stem)
        alone = rest < ROUNDING_DB
        heard, path = listed.get(name), layout.stem_path(name, frame.index)
        above = min(level - AUDIBLE_LEVEL_DB, level - rest - AUDIBLE_SNR_DB if not alone else np.inf)
        ratio = "alone" if alone else f"{abs(level - rest):.1f} dB {'above' if level >= rest else 'below'} the rest"
        what = "the stem is silent" if level < NOTHING_DB else f"the stem has {level:.1f} dB, {ratio}"
        if heard is None:
            if above > LEVEL_TOLERANCE_DB:
                text = f"audible of {frame.name} lacks {name}, but {what}"
                findings.add(layout.OBSERVATION_JSON, text)
            continue
        if above < -LEVEL_TOLERANCE_DB:
            text = f"audible of {frame.name} lists {name}, but {what}: it is not audible"
            findings.add(layout.OBSERVATION_JSON, text)
            continue
        if abs(heard.level_db - level) > LEVEL_TOLERANCE_DB:
            findings.add(path, f"level is {level:.2f} dB, level_db of {frame.name} is {heard.level_db:.2f} dB")
        if rest > ROUNDING_DB if heard.snr_db is None else rest < NOTHING_DB:
            said = "null" if heard.snr_db is None else f"{heard.snr_db:.2f} dB"
            findings.add(path, f"snr_db of {frame.name} is {said}, but {what}")
        elif heard.snr_db is not None and not alone and abs(heard.snr_db - (level - rest)) > LEVEL_TOLERANCE_DB:
            text = f"SNR is {level - rest:.2f} dB, snr_db of {frame.name} is {heard.snr_db:.2f} dB"
            findings.add(path, text)


def _check_programme(source: SourceRecord, power: NDArray[np.float64], tail: float, findings: Findings) -> None:
    """A source is silent outside its programme and its reverberation, and not silent inside it.

    Args:
        source: the source.
        power: (blocks,) mean square of its stem over all frames.
        tail: seconds of reverberation that are allowed.
        findings: where problems go.
    """
    path, second = f"{layout.STEMS}/{source.id}", layout.SAMPLE_RATE / BLOCK
    if len(power) < second:
        return
    loudest = float(power.reshape(-1, round(second)).mean(axis=1).max())
    margin = EDGE_BLOCKS / second
    allowed = np.zeros(len(power), dtype=bool)
    for start, end in source.programme:
        first, last = np.floor((start - margin) * second), np.ceil((end + tail + margin) * second)
        allowed[max(0, int(first)) : max(0, int(last))] = True
    loud = np.flatnonzero(~allowed & (power > max(SILENCE**2, loudest * OUTSIDE_SHARE**2)))
    if len(loud):
        at = loud[0] / second
        text = f"sounds at {at:.2f} s, outside its programme and its reverberation of {tail:.2g} s"
        findings.add(path, f"{text} ({len(loud)} blocks of {1000 / second:g} ms in all)")
    for start, end in source.programme:
        first, last = round(max(start, 0.0) * second), round(min(end, len(power) / second) * second)
        if last - first >= LEAST_SOUNDING * second and float(power[first:last].mean()) ** 0.5 < SILENCE:
            findings.add(path, f"silent from {max(start, 0.0):g} to {end:g} s, where its programme has it sound")
