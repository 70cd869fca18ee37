"""Clips against where their source is: the louder ear, level differences in order, the ear that hears it first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Frame
from avs3d_bench.geometry import direction_to
from avs3d_bench.levels import ild_db
from avs3d_bench.schema import FrameRecord, ObservationRecord
from avs3d_bench.validation.findings import Findings
from avs3d_bench.validation.scenes import sounds_throughout
from avs3d_bench.validation.sound import SILENCE, Sound

#: The louder ear is on the source's side: over frames with line of sight and |azimuth| between these, degrees …
ILD_AZIMUTHS = (20.0, 160.0)
#: … in at least this share of them: in 32 of the 34 observations of open-s34-o7 2.0.0, whose least has 0.84.
ILD_SHARE = 0.90
#: One frame is enough where the source is this far to the side (degrees) and the wrong ear this much louder (dB).
ILD_LATERAL, ILD_SURE = (35.0, 145.0), 4.0
#: Below this share the sound is wrong, and not merely reflected.
ILD_LEAST = 0.8
#: In part_3 a frame is judged by its source if everything else in the clip is this much quieter (dB).
ALONE_SNR_DB = 20.0
#: The source whose direction the frames of part_3 record.
_FIRST = "source_1"


@dataclass(frozen=True, eq=False)
class Hearing:
    """A clip in which one source is heard that is in line of sight.

    Attributes:
        frame: the frame.
        sound: its clip.
        azimuth: of the source, degrees, positive right.
    """

    frame: Frame
    sound: Sound
    azimuth: float


def hearings(
    record: ObservationRecord | None,
    frames: tuple[Frame, ...],
    clips: Sequence[Sound | None],
    visible: Mapping[str, frozenset[int]],
) -> tuple[Hearing, ...]:
    """The clips that can be held against the place of a source.

    Args:
        record: the observation's; without it nothing is known of a source.
        frames: all frames.
        clips: the clip of each frame; None where it is missing or damaged.
        visible: frame name → ids of the instances that its picture shows.
    """
    if record is None:
        return ()
    found = []
    for frame, clip in zip(frames, clips, strict=True):
        entry = frame.record
        azimuth = None if entry is None else _azimuth(record, entry, visible.get(frame.name, frozenset()))
        if clip is not None and azimuth is not None:
            found.append(Hearing(frame, clip, azimuth))
    return tuple(found)


def _azimuth(record: ObservationRecord, entry: FrameRecord, visible: frozenset[int]) -> float | None:
    """Azimuth of the only source of a frame, if it is in line of sight.

    In part_3 it must be an instance of the room, sound during the whole clip, and everything else must be
    `ALONE_SNR_DB` quieter. Whether a source other than the first is in line of sight is not recorded: its instance
    must be in view.
    """
    if entry.audible is None:
        return entry.azimuth if entry.line_of_sight else None
    if len(entry.audible) != 1:
        return None
    (heard,) = entry.audible
    source = record.source(heard.source)
    if source.instance is None or (heard.snr_db is not None and heard.snr_db < ALONE_SNR_DB):
        return None
    if not sounds_throughout(source, entry):
        return None  # its reverberation comes from everywhere
    if not (entry.line_of_sight if source.id == _FIRST else source.instance in visible):
        return None
    return direction_to(entry.pose, source.position).azimuth


def check_levels(heard: Sequence[Hearing], findings: Findings) -> None:
    """The louder ear is on the source's side: a statement about the observation, single frames may differ."""
    low, high = ILD_AZIMUTHS
    judged, wrong = 0, list[str]()
    for one in heard:
        rms, azimuth = one.sound.rms, one.azimuth
        if not low < abs(azimuth) < high:
            continue
        judged += 1
        level = ild_db(*(max(each, SILENCE) for each in rms)) * np.sign(azimuth)
        if level < -ILD_SURE and ILD_LATERAL[0] <= abs(azimuth) <= ILD_LATERAL[1]:
            text = f"the ear away from the source is {-level:.1f} dB louder, at {azimuth:.0f}° in line of sight"
            findings.add(layout.audio_path(layout.BINAURAL, one.frame.index), f"{text}: are the channels swapped?")
        if (rms[1] - rms[0]) * azimuth <= 0:
            wrong.append(layout.audio_name(one.frame.index))
    if len(wrong) > max(2.0, (1 - ILD_SHARE) * judged):
        text = (
            f"the louder ear is on the wrong side of the source in {len(wrong)} of {judged} frames with line of sight "
            f"({', '.join(wrong[:5])}…); expected it right in {ILD_SHARE:.0%}"
        )
        # Reflections of a reverberant room may dominate in some frames, but not in many.
        if len(wrong) > (1 - ILD_LEAST) * judged:
            findings.add(layout.BINAURAL, f"{text}: are the channels swapped?")
        else:
            findings.add(layout.BINAURAL, text, severity="warning")


def check_directions(heard: Sequence[Hearing], findings: Findings) -> None:
    """The level difference between the ears follows the source's azimuth: the clips are in order."""
    pairs = [
        (
            np.sin(np.radians(one.azimuth)),
            np.log(np.maximum(one.sound.rms[1], SILENCE) / max(one.sound.rms[0], SILENCE)),
        )
        for one in heard
    ]
    if len(pairs) < ORDER_FRAMES:
        return
    side, level = np.asarray(pairs).T
    if side.std() < ORDER_SPREAD or level.std() == 0:
        return
    found = float(np.corrcoef(side, level)[0, 1])
    if found < ORDER_LEAST:
        text = (
            f"over {len(pairs)} frames with line of sight, level differences do not follow the azimuth (r = {found:.2f}"
        )
        findings.add(layout.BINAURAL, f"{text}, expected {ORDER_LEAST} or more): clips of other frames?")


#: Frames, and spread of the sine of the azimuth, that it takes to judge the order of the clips; the least correlation.
#: Measured over 13 observations of all categories: 0.81 to 0.98; in reverse order 0.15 at most.
ORDER_FRAMES, ORDER_SPREAD, ORDER_LEAST = 8, 0.25, 0.4


def check_delays(heard: Sequence[Hearing], findings: Findings) -> None:
    """The ear on the source's side hears it first: for clips that are played backwards it is the other ear.

    Below 1.2 kHz, where the delay between the ears is less than half a period, their correlation is higher at the delay
    of the source (Woodworth's sphere) than at its opposite. Echoes and tones mislead single frames, not their mean.
    """
    low, high = DELAY_AZIMUTHS
    evidence = [delay_evidence(one.sound.samples, one.azimuth) for one in heard if low <= abs(one.azimuth) <= high]
    if len(evidence) < DELAY_FRAMES:
        return
    mean, error = float(np.mean(evidence)), float(np.std(evidence)) / len(evidence) ** 0.5
    if mean + DELAY_ERRORS * error < -DELAY_LEAST:
        text = f"over {len(evidence)} frames with line of sight the farther ear hears the source first ({mean:.2f})"
        findings.add(layout.BINAURAL, f"{text}: are the clips played backwards?")


#: Azimuths at which the delay between the ears is judged, degrees; fewer frames are no sample.
DELAY_AZIMUTHS, DELAY_FRAMES = (25.0, 155.0), 4
#: The mean must be so many standard errors below zero, and by more than rounding makes of two equal channels.
DELAY_ERRORS, DELAY_LEAST = 2.0, 0.01
#: Delay of a source at the side (s), and the band in which it is looked for (Hz).
_SIDE_DELAY, _BAND = 550e-6, (100.0, 1200.0)


def delay_evidence(samples: NDArray[np.float32], azimuth: float) -> float:
    """Correlation of the ears at the delay of a source at ``azimuth`` (degrees), less that at the opposite delay.

    Args:
        samples: (2, n), channel 0 left, 44.1 kHz.
        azimuth: of the source, positive right.

    Returns:
        −2 to 2; positive if the ear on the source's side leads.
    """
    n = samples.shape[1]
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(samples.astype(np.float64), size)
    frequency = np.fft.rfftfreq(size, 1 / layout.SAMPLE_RATE)
    spectrum[:, (frequency < _BAND[0]) | (frequency > _BAND[1])] = 0
    lag = round(_SIDE_DELAY * layout.SAMPLE_RATE * float(np.sin(np.radians(azimuth))))
    correlation = np.fft.irfft(spectrum[0] * np.conj(spectrum[1]), size)
    power = np.sqrt(np.prod(np.sum(np.abs(spectrum) ** 2, axis=1))) * 2 / size
    # To the right, the left ear hears it later: a positive lag of channel 0.
    return float((correlation[lag] - correlation[-lag]) / max(power, 1e-30))
