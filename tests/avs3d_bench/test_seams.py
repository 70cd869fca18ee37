"""Clips that join, and clips that do not: noise of little bandwidth, tones, clicks, silence."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from avs3d_bench.contract import layout
from avs3d_bench.contract.layout import PEAK_CEILING
from avs3d_bench.validation.seams import JUMP, SEAMS, border_jumps, check_seams
from avs3d_bench.validation.sound import BinauralClip, check_peak
from generators.acoustics.clips import joined

RATE = layout.SAMPLE_RATE


class Said:
    """Takes what a check says."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def add(self, path: str, message: str, severity: str = "error") -> None:
        self.lines.append((severity, path, message))


def sound(kind: str, seconds: int, seed: int = 0) -> NDArray[np.float32]:
    """(2, seconds · RATE): what two ears hear of one source, 0.3 ms apart."""
    rng, t = np.random.default_rng(seed), np.arange(seconds * RATE) / RATE
    if kind == "tone":
        mono = 0.2 * np.sin(2 * np.pi * 440 * t) + 1e-5 * rng.standard_normal(len(t))
    elif kind == "ticks":
        mono = np.zeros(len(t))
        mono[300 :: RATE // 4] = 1.0  # the first of a second 7 ms after its beginning
        mono = sosfilt(butter(2, [1500, 6000], "bandpass", fs=RATE, output="sos"), mono)
        mono += 1e-4 * rng.standard_normal(len(t))
    else:
        mono = 0.1 * sosfilt(butter(6, 4000, fs=RATE, output="sos"), rng.standard_normal(len(t)))
    return np.stack([mono, 0.7 * np.roll(mono, 13)]).astype(np.float32)


def clips_of(samples: NDArray[np.float32]) -> list[BinauralClip | None]:
    clips = np.split(samples, samples.shape[1] // RATE, axis=1)
    return [BinauralClip(clip, np.sqrt(np.mean(np.square(clip), axis=1))) for clip in clips]


def said(clips: list[BinauralClip | None]) -> list[tuple[str, str, str]]:
    found = Said()
    check_seams(clips, found)  # type: ignore[arg-type]
    return found.lines


@pytest.mark.parametrize("kind", ["noise", "tone", "ticks"])
def test_a_sound_that_goes_on_has_no_seam(kind: str) -> None:
    assert said(clips_of(sound(kind, 8))) == []


@pytest.mark.parametrize("kind", ["noise", "tone"])
@pytest.mark.parametrize("change", [lambda s: -s, lambda s: 1.26 * s, lambda s: np.roll(s, 441, axis=1)])
def test_one_clip_that_does_not_fit_is_named(kind: str, change) -> None:
    clips = clips_of(sound(kind, 8))
    odd = np.ascontiguousarray(change(clips[3].samples))  # type: ignore[union-attr]
    clips[3] = BinauralClip(odd, odd.std(axis=1))
    lines = said(clips)
    # It fits neither the clip before nor the one after.
    assert {path for _, path, _ in lines} <= {layout.audio_path(layout.BINAURAL, index) for index in (3, 4)}
    assert lines
    assert all(severity == "error" and "sound jumps" in message for severity, _, message in lines)


def test_clips_that_were_never_joined_are_one_warning() -> None:
    clips = [clips_of(sound("noise", 1, seed))[0] for seed in range(6)]
    ((severity, path, message),) = said(clips)
    assert (severity, path) == ("warning", layout.BINAURAL)
    assert "median of 5 borders; of a dataset before version 3.0.0" in message


def test_joining_removes_the_jump() -> None:
    first, second = sound("noise", 2, 1), sound("noise", 2, 2)
    before, tail, after = first[:, :RATE], first[:, RATE : RATE + 220], second[:, :RATE]
    bare, cured = border_jumps(before, after), border_jumps(before, joined(after, tail))
    assert bare is not None
    assert cured is not None
    assert bare.min() > JUMP
    assert cured.max() < SEAMS


def test_silence_and_missing_clips_are_not_judged() -> None:
    clips = clips_of(sound("noise", 6))
    clips[2] = None
    silent = np.zeros((2, RATE), dtype=np.float32)
    clips[4] = BinauralClip(silent, silent.std(axis=1))
    assert said(clips) == []


@pytest.mark.parametrize(
    ("peak", "line"),
    [
        (PEAK_CEILING, None),
        (0.95, ("warning", "the peak is -0.45 dBFS, expected −1 or less")),
        (1.0, ("error", "clipped: the peak is 1.000 of full scale")),
    ],
)
def test_a_peak_above_the_ceiling_is_a_warning_and_at_full_scale_an_error(
    peak: float, line: tuple[str, str] | None
) -> None:
    found = Said()
    check_peak("a.wav", np.array([[0.1, -peak], [0.0, 0.2]]), found)  # type: ignore[arg-type]
    assert found.lines == ([] if line is None else [(line[0], "a.wav", line[1])])
