"""The clips of the receivers beside the two ears: against the binaural clips, against themselves, against the source.

Ambisonics (SN3D) of any sound field have, over all directions of arrival, as much power in the 2l + 1 channels of each
degree l as in W: exactly for one plane wave, and in the mean for many. The intensity, W times the channels X, Y and Z,
points to where the sound comes from. At low frequencies the mean of both ears is the pressure at the head's centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Frame
from avs3d_bench.formats import media
from avs3d_bench.validation.findings import Findings, read
from avs3d_bench.validation.interaural import (
    LEAST_FRAMES,
    LEAST_SINES,
    SURE,
    Hearing,
    SideFit,
    SideLevel,
    order_problem,
    side_level,
)
from avs3d_bench.validation.sound import SILENCE, BinauralClip, check_peak, check_response
from avs3d_bench.validation.stems import SUM_TOLERANCE

#: Power of the channels of a degree above W's (dB): largest mean over the clips. N3D instead of SN3D is 4.8 dB (degree
#: 1) or more off, FuMa's W 3 dB. In rooms, standing waves make single clips differ by up to 0.4 dB.
DEGREE_TOLERANCE_DB = 2.0
#: Band in which the level of the ears is compared with that of W (Hz), and the least and greatest difference (dB): -0.2
#: to 2.1 in observations with a sphere and with a measured head. Above the band, ear canals resonate.
LEVEL_BAND, EARS_ABOVE_W_DB = (350.0, 1400.0), (-6.0, 9.0)
#: Band in which the coherence of the ears with W is measured (Hz), length of the segments (samples), and the least
#: coherence of a clip: 0.97 and more if both are of one sound field; 0.15 to 0.7 if they are of successive seconds, the
#: more the more tonal the source is.
COHERENCE_BAND, COHERENCE_SEGMENT, COHERENCE_LEAST = (100.0, 400.0), 2048, 0.6
#: A channel with less than this share of the power of the loudest one is silent.
SILENT_CHANNEL = 1e-8
#: RMS of a microphone against the median microphone (dB), over all clips: tones have maxima and minima in a room.
MICROPHONE_TOLERANCE_DB = 10.0


@dataclass(frozen=True, eq=False)
class _Channels:
    """The clip of a receiver.

    Attributes:
        frame: the frame.
        path: of the file, in the observation.
        samples: (channels, 44100).
        power: (channels,) mean squares.
    """

    frame: Frame
    path: str
    samples: NDArray[np.float32]
    power: NDArray[np.float64]


def check_receivers(
    record: ObservationRecord,
    frames: tuple[Frame, ...],
    clips: Sequence[BinauralClip | None],
    heard: Sequence[Hearing],
    files: set[str],
    findings: Findings,
) -> None:
    """Check the clips, stems and responses of every receiver beside the two ears.

    Args:
        record: the observation's.
        frames: all frames.
        clips: the binaural clip of each frame; None where it is missing or damaged.
        heard: the clips in which a source in line of sight is heard; see `interaural.hearings`.
        files: the files found.
        findings: where problems go.
    """
    for name, channels in record.acoustics.receivers.items():
        found = []
        for frame, ears in zip(frames, clips, strict=True):
            one = _read_clip(frame, name, channels.channels, files, findings)
            if one is None:
                continue
            found.append(one)
            _check_stems(one, name, record, files, findings)
            _check_responses(one, name, record, files, findings)
            if name == layout.AMBISONICS and ears is not None and record.background is None:
                _check_pressure(one, ears, findings)
        loud = [one for one in found if one.power[0] > SILENCE**2]
        if name == layout.AMBISONICS:
            _check_degrees(loud, findings)
            _check_directions(loud, heard, findings)
        else:
            _check_microphones(loud, channels.channel_names, findings)


def _read_clip(frame: Frame, name: str, channels: int, files: set[str], findings: Findings) -> _Channels | None:
    path = layout.audio_path(layout.clips_folder(name), frame.index)
    clip = read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (channels, layout.BINAURAL_SAMPLES):
        return None  # format: named by the shallow check
    check_peak(path, clip.samples, findings)
    power = np.mean(np.square(clip.samples, dtype=np.float64), axis=1)
    if power.max() >= SILENCE**2:
        quiet = np.flatnonzero(power < power.max() * SILENT_CHANNEL)
        if len(quiet):
            findings.add(path, f"silent in channel {', '.join(map(str, quiet[:5]))}, but not in others")
    elif not frame.observation.is_part_3:
        findings.add(path, f"silent (RMS below {SILENCE:g})")
    return _Channels(frame, path, clip.samples, np.asarray(power))


def _check_pressure(one: _Channels, ears: BinauralClip, findings: Findings) -> None:
    """W is the pressure at the centre of the head that hears the binaural clip."""
    mean = float(np.mean(np.square(ears.rms)))
    silent = [power < SILENCE**2 for power in (mean, float(one.power[0]))]
    if any(silent):
        if not all(silent):
            findings.add(one.path, f"W is {'silent' if silent[1] else 'not silent'}, unlike the binaural clip")
        return
    both, pressure = (_band_power(samples) for samples in (ears.samples, one.samples[:1]))
    above = 10 * np.log10(max(both, SILENCE**2) / max(pressure, SILENCE**2))
    low, high = EARS_ABOVE_W_DB
    if not low <= above <= high:
        where = f"from {LEVEL_BAND[0]:g} to {LEVEL_BAND[1]:g} Hz"
        findings.add(one.path, f"{where} the ears are {above:+.1f} dB re W, expected {low:g} to {high:g} dB")
    found = low_coherence(ears.samples.mean(axis=0), one.samples[0])
    if found < COHERENCE_LEAST:
        text = (
            f"from {COHERENCE_BAND[0]:g} to {COHERENCE_BAND[1]:g} Hz the coherence of W and the mean of both ears is "
            f"{found:.2f}, expected {COHERENCE_LEAST:g} or more: the clip of another frame?"
        )
        findings.add(one.path, text)


def _band_power(samples: NDArray[np.floating]) -> float:
    """Mean square over channels (channels, n) of their part in `LEVEL_BAND`."""
    frequency = np.fft.rfftfreq(samples.shape[1], 1 / layout.SAMPLE_RATE)
    inside = (frequency >= LEVEL_BAND[0]) & (frequency <= LEVEL_BAND[1])
    spectra = np.fft.rfft(samples.astype(np.float64))[:, inside]
    return float(2 * np.sum(np.abs(spectra) ** 2) / samples.shape[1] ** 2 / len(samples))


def low_coherence(one: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Coherence of two signals (n,) in `COHERENCE_BAND`, 0 to 1, frequencies weighted by their power (Welch 1967)."""
    window = np.hanning(COHERENCE_SEGMENT)
    starts = range(0, len(one) - COHERENCE_SEGMENT + 1, COHERENCE_SEGMENT // 2)
    spectra = [np.fft.rfft(np.stack([x[at : at + COHERENCE_SEGMENT] for at in starts]) * window) for x in (one, other)]
    frequency = np.fft.rfftfreq(COHERENCE_SEGMENT, 1 / layout.SAMPLE_RATE)
    inside = (frequency >= COHERENCE_BAND[0]) & (frequency <= COHERENCE_BAND[1])
    first, second = (spectrum[:, inside] for spectrum in spectra)
    cross = np.abs(np.sum(first * np.conj(second), axis=0))
    power = np.sqrt(np.sum(np.abs(first) ** 2, axis=0) * np.sum(np.abs(second) ** 2, axis=0))
    total = float(power.sum())
    return float(cross.sum()) / total if total > 0 else 1.0


def _check_degrees(found: Sequence[_Channels], findings: Findings) -> None:
    if not found:
        return
    power = np.array([one.power for one in found])
    for degree in range(1, round(power.shape[1] ** 0.5)):
        own = power[:, degree**2 : (degree + 1) ** 2].sum(axis=1)
        above = float(np.mean(10 * np.log10(np.maximum(own, SILENCE**2) / power[:, 0])))
        if abs(above) > DEGREE_TOLERANCE_DB:
            text = (
                f"over {len(found)} clips the channels of degree {degree} have {above:+.1f} dB of W's power; expected "
                f"0 ± {DEGREE_TOLERANCE_DB:g} dB: SN3D?"
            )
            findings.add(layout.clips_folder(layout.AMBISONICS), text)


def _check_directions(found: Sequence[_Channels], heard: Sequence[Hearing], findings: Findings) -> None:
    """The intensity points to the side on which the source is: the channels are in ACN order, Y to the left."""
    azimuths = {one.frame.name: one.azimuth for one in heard}
    pairs = [(azimuths[one.frame.name], cardioid_level(one.samples)) for one in found if one.frame.name in azimuths]
    levels = [level for _, level in pairs if level is not None]
    sines = np.sin(np.radians([azimuth for azimuth, level in pairs if level is not None]))
    if len(levels) < LEAST_FRAMES or float(np.sum(sines**2)) < LEAST_SINES:
        return
    fit = SideFit.of(levels, sines)
    text = f"over {len(levels)} frames with line of sight, the intensity"
    asked = "are the channels in ACN order, with Y to the left?"
    if fit.certainty < -SURE:
        text = f"{text} points to the wrong side of the source ({-fit.certainty:.1f} standard errors): {asked}"
        findings.add(layout.clips_folder(layout.AMBISONICS), text)
    elif problem := order_problem(levels, sines):
        findings.add(layout.clips_folder(layout.AMBISONICS), f"{text}'s {problem}: {asked}")


def cardioid_level(samples: NDArray[np.floating]) -> SideLevel | None:
    """By how much more comes from the right at onsets: the level of two cardioids to the sides, W ∓ Y.

    Args:
        samples: (channels, n) ambisonics of any order, ACN.
    """
    return side_level(np.stack([samples[0] + samples[1], samples[0] - samples[1]]))


def _check_microphones(found: Sequence[_Channels], names: Sequence[str], findings: Findings) -> None:
    if not found:
        return
    level = 10 * np.log10(np.maximum(np.mean([one.power for one in found], axis=0), SILENCE**2))
    off = level - np.median(level)
    for number in np.flatnonzero(np.abs(off) > MICROPHONE_TOLERANCE_DB).tolist():
        text = f"microphone {names[number]} is {off[number]:+.1f} dB off the median of all, over {len(found)} clips"
        findings.add(layout.clips_folder(layout.ARRAY), text)


def _stem_names(record: ObservationRecord) -> Iterator[str]:
    yield from (source.id for source in record.sources or ())
    if record.background is not None:
        yield layout.BACKGROUND


def _check_stems(one: _Channels, name: str, record: ObservationRecord, files: set[str], findings: Findings) -> None:
    """The stems of part_3 add up to the clip."""
    paths = [layout.stem_path(stem, one.frame.index, name) for stem in _stem_names(record)]
    if not record.is_part_3 or not paths or not files.issuperset(paths):
        return  # made without stems, or one is missing, which is named already
    total = np.zeros(one.samples.shape)
    for path, stem in zip(paths, _stem_names(record), strict=True):
        samples = read(findings, files, path, partial(one.frame.stem, stem, name))
        if samples is None or samples.shape != total.shape:
            return
        total += samples
    off = float(np.abs(total - one.samples).max())
    if off > SUM_TOLERANCE:
        text = f"differs from the sum of its stems by up to {off:.2g}; expected at most {SUM_TOLERANCE:g}"
        findings.add(one.path, text)


def _check_responses(one: _Channels, name: str, record: ObservationRecord, files: set[str], findings: Findings) -> None:
    """The responses explain the clip, where one source alone makes it; the others are read."""
    sources = record.sources
    ids = [None] if sources is None else [source.id for source in sources]
    alone = record.background is None and (sources is None or len(sources) == 1)
    alone = alone and not any(map(record.source_moves, record.sound_sources))
    for source in ids:
        path = layout.rir_path(one.frame.index, source, name)
        response = read(findings, files, path, partial(one.frame.impulse_response, source, name))
        if response is not None and alone and one.power[0] > SILENCE**2:
            check_response(path, one.path, one.samples, response, findings)
