"""The clips: against their record, against each other, and against where the source is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Frame, Split
from avs3d_bench.levels import ild_db
from avs3d_bench.report import Severity
from avs3d_bench.validation.findings import Findings, read

#: A channel whose RMS is below this is silent (−120 dB of full scale).
SILENCE = 1e-6
#: Sound that reaches full scale counts as clipped.
FULL_SCALE = 1.0
#: Levels in observation.json: relative, and absolute for 16-bit files.
RMS_TOLERANCE = (1e-3, 2e-5)
#: The louder ear is on the source's side: over frames with line of sight and |azimuth| between these, degrees …
ILD_AZIMUTHS = (20.0, 160.0)
#: … in at least this share of them: in 32 of the 34 observations of open-s34-o7 2.0.0, whose least has 0.84.
ILD_SHARE = 0.90
#: One frame is enough where the source is this far to the side (degrees) and the wrong ear this much louder (dB).
ILD_LATERAL, ILD_SURE = (35.0, 145.0), 4.0
#: Below this share the sound is wrong, and not merely reflected.
ILD_LEAST = 0.8


@dataclass(frozen=True, eq=False)
class Sound:
    """A binaural clip: ``samples`` (2, n) and the RMS of each channel."""

    samples: NDArray[np.float32]
    rms: NDArray[np.float64]


def _sound_problems(path: str, samples: NDArray[np.float32], findings: Findings) -> NDArray[np.float64]:
    """Clipping and silence; returns the RMS of each channel."""
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= FULL_SCALE:
        findings.add(path, f"clipped: the peak is {peak:.3f} of full scale")
    rms = np.sqrt(np.mean(np.square(samples.astype(np.float64)), axis=1))
    quiet = [f"channel {channel}" for channel, level in enumerate(rms) if level < SILENCE]
    if quiet:
        where = "silent" if len(quiet) == len(rms) else f"silent in {', '.join(quiet)}"
        findings.add(path, f"{where} (RMS below {SILENCE:g})")
    return np.asarray(rms)


def check_clip(frame: Frame, files: set[str], findings: Findings) -> Sound | None:
    """Read a binaural clip and hold it to its record; None if it is missing or has another format."""
    path = layout.audio_path(layout.BINAURAL, frame.index)
    clip = read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (2, layout.BINAURAL_SAMPLES):
        return None  # format: named by the shallow check
    rms = _sound_problems(path, clip.samples, findings)
    entry = frame.record
    if entry:
        relative, absolute = RMS_TOLERANCE
        for side, found, noted in zip(("left", "right"), rms, (entry.rms_left, entry.rms_right), strict=True):
            if abs(found - noted) > relative * noted + absolute:
                findings.add(path, f"RMS {side} is {found:.6f}, rms_{side} of {frame.name} is {noted:.6f}")
    return Sound(clip.samples, rms)


def check_levels(frames: tuple[Frame, ...], clips: list[Sound | None], findings: Findings) -> None:
    """The louder ear is on the source's side: a statement about the observation, single frames may differ."""
    low, high = ILD_AZIMUTHS
    judged, wrong = 0, list[str]()
    for frame, clip in zip(frames, clips, strict=True):
        entry = frame.record
        if entry is None or clip is None or not entry.line_of_sight or not low < abs(entry.azimuth) < high:
            continue
        judged += 1
        level = ild_db(*(max(rms, SILENCE) for rms in clip.rms)) * np.sign(entry.azimuth)
        if level < -ILD_SURE and ILD_LATERAL[0] <= abs(entry.azimuth) <= ILD_LATERAL[1]:
            text = f"the ear away from the source is {-level:.1f} dB louder, at {entry.azimuth:.0f}° in line of sight"
            findings.add(layout.audio_path(layout.BINAURAL, frame.index), f"{text}: are the channels swapped?")
        if (clip.rms[1] - clip.rms[0]) * entry.azimuth <= 0:
            wrong.append(layout.audio_name(frame.index))
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


def check_mono(
    frames: tuple[Frame, ...],
    clips: list[Sound | None],
    splits: Mapping[str, Split],
    position: int,
    files: set[str],
    findings: Findings,
    *,
    ours: bool,
) -> None:
    """The clip's own mix stands at 0, 0.5 or 1 s; beside it stand its neighbours', in a train frame no test frame's.

    In a tree of ours every sample is decided by the clips (`layout.mono_window`).
    """
    severity: Severity = "error" if ours else "warning"
    frame, own = frames[position], clips[position]
    path = layout.audio_path(layout.MONO, frame.index)
    clip = read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (1, layout.MONO_SAMPLES):
        return
    _sound_problems(path, clip.samples, findings)
    if own is None:
        return
    mono, mix, n = clip.samples[0], own.samples.mean(axis=0), layout.BINAURAL_SAMPLES
    # 16-bit files are rounded, once here and once there.
    tolerance = 1e-4 * float(np.abs(mix).max()) + 6.2e-5

    def same(first: NDArray[np.float32], second: NDArray[np.float32]) -> bool:
        return bool(np.abs(first - second).max(initial=0.0) <= tolerance)

    offsets = [at for at in (0, n // 2, n) if same(mono[at : at + n], mix)]
    if not offsets:
        findings.add(path, f"does not hold the mix of {layout.audio_path(layout.BINAURAL, frame.index)}", severity)
        return
    if ours:
        _check_neighbours(path, mono, clips, position, tolerance, findings)
    if splits.get(frame.name) != "train":
        return
    leaks: list[str] = []
    for at in offsets:
        borrowed = []
        for step, part in ((-1, mono[:at]), (1, mono[at + n :])):
            other = position + step
            if not part.size or not 0 <= other < len(frames) or splits.get(frames[other].name) != "test":
                continue
            neighbour = clips[other]
            if neighbour is None:
                continue
            theirs = neighbour.samples.mean(axis=0)
            if same(part, theirs[-part.size :] if step < 0 else theirs[: part.size]):
                borrowed.append(frames[other].name)
        if not borrowed:
            return
        leaks = borrowed
    findings.add(path, f"a train clip borrows from the test frame {', '.join(leaks)}", severity)


def _check_neighbours(
    path: str,
    mono: NDArray[np.float32],
    clips: list[Sound | None],
    position: int,
    tolerance: float,
    findings: Findings,
) -> None:
    pieces = layout.mono_window(position, len(clips))
    sounds = [clips[index] for index, _, _ in pieces]
    if any(sound is None for sound in sounds):
        return  # already named
    parts = [
        sound.samples.mean(axis=0)[start:stop]
        for sound, (_, start, stop) in zip(sounds, pieces, strict=True)
        if sound is not None
    ]
    expected = np.concatenate(parts)
    peak = 1e-4 * float(np.abs(expected).max(initial=0.0))
    wrong = int((np.abs(mono - expected) > max(tolerance, peak)).sum())
    if wrong:
        names = ", ".join(layout.audio_name(index) for index, _, _ in pieces)
        findings.add(path, f"{wrong} samples differ from the mix of {names} that it is made of")


def check_directions(frames: tuple[Frame, ...], clips: list[Sound | None], findings: Findings) -> None:
    """The level difference between the ears follows the source's azimuth: the clips are in order."""
    pairs = [
        (np.sin(np.radians(frame.record.azimuth)), np.log(np.maximum(clip.rms[1], SILENCE) / max(clip.rms[0], SILENCE)))
        for frame, clip in zip(frames, clips, strict=True)
        if clip and frame.record and frame.record.line_of_sight
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


def check_delays(frames: tuple[Frame, ...], clips: list[Sound | None], findings: Findings) -> None:
    """The ear on the source's side hears it first: for clips that are played backwards it is the other ear.

    Below 1.2 kHz, where the delay between the ears is less than half a period, their correlation is higher at the delay
    of the source (Woodworth's sphere) than at its opposite. Echoes and tones mislead single frames, not their mean.
    """
    low, high = DELAY_AZIMUTHS
    evidence = [
        delay_evidence(clip.samples, frame.record.azimuth)
        for frame, clip in zip(frames, clips, strict=True)
        if clip and frame.record and frame.record.line_of_sight and low <= abs(frame.record.azimuth) <= high
    ]
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


def check_response(frame: Frame, clip: Sound | None, response: NDArray[np.float32], findings: Findings) -> None:
    """Both ears hear one source through their own responses: left ∗ h_right equals right ∗ h_left.

    It holds once the responses have decayed (the source before the clip is not known).
    """
    if clip is None:
        return
    from scipy.signal import oaconvolve

    energy = np.cumsum(np.sum(response.astype(np.float64) ** 2, axis=0)[::-1])[::-1]
    if energy.size == 0 or energy[0] <= 0:
        return
    start = int((energy > RESPONSE_REST * energy[0]).sum())
    n = clip.samples.shape[1]
    if start > RESPONSE_LATEST * n:
        return
    one, other = (oaconvolve(clip.samples[a].astype(np.float64), response[b])[start:n] for a, b in ((0, 1), (1, 0)))
    scale = float(np.linalg.norm(one) + np.linalg.norm(other)) / 2
    off = float(np.linalg.norm(one - other)) / max(scale, 1e-30)
    if scale > 0 and off > RESPONSE_OFF:
        path = layout.rir_path(frame.index)
        findings.add(path, f"does not explain {layout.audio_path(layout.BINAURAL, frame.index)}: {off:.2f} off")


#: Share of a response's energy that may be left where the comparison begins, the latest beginning (share of the clip),
#: and the relative difference that is allowed.
RESPONSE_REST, RESPONSE_LATEST, RESPONSE_OFF = 1e-5, 0.8, 0.2
