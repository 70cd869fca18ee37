"""The clips: against their record, against each other, and against where the source is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Frame, Split
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
#: … in at least this share of them.
ILD_SHARE = 0.95
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
        if (clip.rms[1] - clip.rms[0]) * entry.azimuth <= 0:
            wrong.append(layout.audio_name(frame.index))
    if len(wrong) > max(2.0, (1 - ILD_SHARE) * judged):
        text = (
            f"the louder ear is on the wrong side of the source in {len(wrong)} of {judged} frames with line of sight "
            f"({', '.join(wrong[:5])}…); expected it right in {ILD_SHARE:.0%}"
        )
        # Reflections of a live room may win in some frames; they do not in many.
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
    severity: Severity,
) -> None:
    """The clip's own mix stands at 0, 0.5 or 1 s; what is beside it in a train frame is not a test frame's."""
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
