"""The clips: against their record and against each other; see `validation.interaural` for where the source is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.report import Severity
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Frame, Split
from avs3d_bench.formats import media
from avs3d_bench.validation.findings import Findings, read

#: A channel whose RMS is below this is silent (−120 dB of full scale).
SILENCE = 1e-6
#: Sound that reaches full scale counts as clipped.
FULL_SCALE = 1.0
#: Levels in observation.json: relative, and absolute for 16-bit files.
RMS_TOLERANCE = (1e-3, 2e-5)


@dataclass(frozen=True, eq=False)
class BinauralClip:
    """A binaural clip: ``samples`` (2, n) and the RMS of each channel."""

    samples: NDArray[np.float32]
    rms: NDArray[np.float64]


def check_peak(path: str, samples: NDArray[np.floating], findings: Findings) -> None:
    """Name sound that is clipped, or that is close to it."""
    peak = float(np.abs(samples).max(initial=0.0))
    if peak >= FULL_SCALE:
        findings.add(path, f"clipped: the peak is {peak:.3f} of full scale")
    elif peak > layout.PEAK_CEILING:
        findings.add(path, f"the peak is {20 * np.log10(peak):.2f} dBFS, expected −1 or less", "warning")


def _sound_problems(
    path: str, samples: NDArray[np.float32], findings: Findings, *, may_be_silent: bool
) -> NDArray[np.float64]:
    """Clipping and silence (of one channel alone, where a clip may be silent); returns the RMS of each channel."""
    check_peak(path, samples, findings)
    rms = np.sqrt(np.mean(np.square(samples.astype(np.float64)), axis=1))
    quiet = [f"channel {channel}" for channel, level in enumerate(rms) if level < SILENCE]
    if quiet and not (may_be_silent and len(quiet) == len(rms)):
        where = "silent" if len(quiet) == len(rms) else f"silent in {', '.join(quiet)}"
        findings.add(path, f"{where} (RMS below {SILENCE:g})")
    return np.asarray(rms)


def check_clip(frame: Frame, files: set[str], findings: Findings) -> BinauralClip | None:
    """Read a binaural clip and hold it to its record; None if it is missing or has another format."""
    path = layout.audio_path(layout.BINAURAL, frame.index)
    clip = read(findings, files, path, lambda: media.read_wav(frame.observation.path / path))
    if clip is None or clip.samples.shape != (2, layout.BINAURAL_SAMPLES):
        return None  # format: named by the shallow check
    entry = frame.record
    rms = _sound_problems(path, clip.samples, findings, may_be_silent=frame.observation.is_part_3)
    if entry:
        relative, absolute = RMS_TOLERANCE
        for side, found, noted in zip(("left", "right"), rms, (entry.rms_left, entry.rms_right), strict=True):
            if abs(found - noted) > relative * noted + absolute:
                findings.add(path, f"RMS {side} is {found:.6f}, rms_{side} of {frame.name} is {noted:.6f}")
    return BinauralClip(clip.samples, rms)


def check_mono(
    frames: tuple[Frame, ...],
    clips: list[BinauralClip | None],
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
    _sound_problems(path, clip.samples, findings, may_be_silent=frame.observation.is_part_3)
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
            theirs = theirs[-part.size :] if step < 0 else theirs[: part.size]
            # Silence is nobody's.
            if float(np.abs(theirs).max()) > tolerance and same(part, theirs):
                borrowed.append(frames[other].name)
        if not borrowed:
            return
        leaks = borrowed
    findings.add(path, f"a train clip borrows from the test frame {', '.join(leaks)}", severity)


def _check_neighbours(
    path: str,
    mono: NDArray[np.float32],
    clips: list[BinauralClip | None],
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


def check_response(
    path: str, clip_path: str, samples: NDArray[np.float32], response: NDArray[np.float32], findings: Findings
) -> None:
    """All channels hear one source through their own responses: left ∗ h_right equals right ∗ h_left.

    It holds once the responses have decayed (the source before the clip is not known). Every channel is compared with
    the first.

    Args:
        path: of the response.
        clip_path: of the clip, or in part_3 of the source's stem.
        samples: (channels, n) the clip.
        response: (channels, m).
        findings: where a problem goes.
    """
    from scipy.signal import oaconvolve

    energy = np.cumsum(np.sum(response.astype(np.float64) ** 2, axis=0)[::-1])[::-1]
    if energy.size == 0 or energy[0] <= 0:
        return
    start = int((energy > RESPONSE_REST * energy[0]).sum())
    n = samples.shape[1]
    if start > RESPONSE_LATEST * n:
        return
    for channel in range(1, len(response)):
        pairs = ((0, channel), (channel, 0))
        one, other = (oaconvolve(samples[a].astype(np.float64), response[b])[start:n] for a, b in pairs)
        scale = float(np.linalg.norm(one) + np.linalg.norm(other)) / 2
        off = float(np.linalg.norm(one - other)) / max(scale, 1e-30)
        if scale > 0 and off > RESPONSE_OFF:
            findings.add(path, f"does not explain {clip_path}: {off:.2f} off")
            return


#: Share of a response's energy that may be left where the comparison begins, the latest beginning (share of the clip),
#: and the relative difference that is allowed.
RESPONSE_REST, RESPONSE_LATEST, RESPONSE_OFF = 1e-5, 0.8, 0.2
