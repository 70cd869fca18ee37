"""An observation as a film: frames with the sounding object marked, and the binaural track in step.

A frame of the dataset lasts a second, as its clip does; `avs3d_bench.formats.film` writes the MP4, in which the clip of
frame k is heard while frame k is shown.

Clips are joined as the web player joins them (`avs3d_bench.inspector.sound.joined`: 5 ms cross-fades, because the
impulse response changes from frame to frame) and raised by whole decibels, the same for the whole film; the caption
says by how many.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.outputs import DRAWN_BY
from avs3d_bench.contract import layout
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.formats.files import atomic_path
from avs3d_bench.formats.film import encode_film
from avs3d_bench.inspector.facts import PageFacts, read_facts
from avs3d_bench.inspector.floor_map import MapInset
from avs3d_bench.inspector.sound import joined, read_clip
from avs3d_bench.inspector.submissions import ShownSubmission, open_submissions
from avs3d_bench.inspector.video_drawing import AudibleNow, Canvas, Loudness, Overlay, Shown
from avs3d_bench.runtime.imports import needing

#: The loudest sample is raised to this at most, dB re full scale: the encoder overshoots a little.
PEAK_DB = -3.0
#: Largest gain (dB): a source behind two walls stays quiet.
MAX_GAIN_DB = 24
#: Sizes of the picture, pixels of the longer side.
SMALLEST, LARGEST = 64, 2160


@dataclass(frozen=True)
class Film:
    """The film that was written.

    Attributes:
        path: the file.
        frames: frames of the observation; also its length in seconds.
        width: pixels.
        height: pixels, caption included.
        gain_db: by how much the sound is louder than the dataset's files; None if the film is silent.
    """

    path: Path
    frames: int
    width: int
    height: int
    gain_db: int | None


def write_video(
    dataset: Dataset,
    key: str,
    path: str | Path,
    *,
    size: int = 720,
    overlay: Overlay = "tint",
    submission: str | Path | None = None,
    with_map: bool = False,
    advance: Callable[[int], None] | None = None,
) -> Film:
    """Write the film of an observation, all of it or nothing.

    Args:
        dataset: where it is; the official release will do.
        key: of the observation.
        path: the MP4.
        size: longer side of the picture without its caption, pixels.
        overlay: ``tint`` (outline and tint), ``outline`` or ``none``.
        submission: a folder of predictions, outlined in a second colour on the test frames.
        with_map: draw the path, the heading and the source from above in a corner.
        advance: called with the number of frames done.

    Raises:
        UsageError: if there is no such observation, the name or the size does not do, or the submission has no mask
            of the observation.
        Avs3dError: if PyAV is missing, a file is damaged, or the system refuses.
    """
    target = Path(path)
    if target.suffix.lower() != ".mp4":
        raise UsageError(f"{target}: the film is an MP4; expected a name that ends with .mp4")
    if target.is_dir():
        raise UsageError(f"{target}: found a folder, expected the name of a file")
    if not SMALLEST <= size <= LARGEST:
        raise UsageError(f"size {size}: expected {SMALLEST} to {LARGEST} pixels")
    with needing("avs3d video", "pip install 'avs3d-bench[inspect]'"):
        import av
    observation = dataset[key]
    predicted = _predicted(dataset, observation, Path(submission)) if submission is not None else None
    facts = read_facts(dataset, observation)
    sound, gain = film_sound(observation)
    canvas = Canvas.of(observation.frames[0].rgb().shape, size)
    what = (facts.category or "sounding object").replace("_", " ")
    inset = MapInset.of(observation, facts, canvas.width) if with_map and facts.has_map else None
    if with_map and inset is None:
        raise Avs3dError(f"{observation.path}: no frame has a pose, so there is no map; run without --map")

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for number, (frame, moment) in enumerate(zip(observation.frames, facts.moments, strict=True)):
            yield canvas.draw(
                Shown(
                    rgb=frame.rgb(),
                    truth=frame.mask() if overlay != "none" and facts.has_masks and not facts.lanes else None,
                    predicted=predicted.mask(frame) if predicted else None,
                    moment=moment,
                    title=key,
                    what=what,
                    loudness=_loudness(sound, number, gain),
                    method=predicted.name if predicted else None,
                    inset=inset.draw(number) if inset else None,
                    nothing=facts.lanes.nothing if facts.lanes else "",
                    audible=_audible(frame, facts, number, marked=overlay != "none"),
                ),
                overlay,
            )
            if advance is not None:
                advance(number + 1)

    try:
        with atomic_path(target) as temporary:
            encode_film(av, temporary, pictures(), (canvas.width, canvas.height), comment=DRAWN_BY, sound=sound)
    except av.FFmpegError as error:
        raise Avs3dError(
            f"{target}: cannot write the film: {error.strerror}; free some space, or try another"
        ) from error
    return Film(target, len(observation.frames), canvas.width, canvas.height, gain)


def _audible(frame: Frame, facts: PageFacts, number: int, *, marked: bool) -> tuple[AudibleNow, ...] | None:
    """The audible sources of a part_3 observation in one frame, with their visible pixels if they are ``marked``."""
    if facts.lanes is None:
        return None
    sources = facts.lanes.audible(number)
    inside = marked and facts.has_masks and facts.has_instances and any(not source.off_screen for source in sources)
    mask, ids = (frame.mask(), frame.instance_ids()) if inside else (None, None)
    return tuple(
        AudibleNow(
            name=source.name,
            colour=source.colour,
            mask=None if mask is None or source.off_screen else mask & (ids == source.record.instance),
            azimuth=source.azimuth[number],
            distance=source.distance[number],
        )
        for source in sources
    )


def _predicted(dataset: Dataset, observation: Observation, folder: Path) -> ShownSubmission:
    (found,) = open_submissions(dataset, [folder])
    if not any(found.mask_path(frame) for frame in observation.test):
        raise UsageError(f"{folder / observation.key}: no masks of its test frames; choose another observation")
    return found


def film_sound(observation: Observation) -> tuple[NDArray[np.float32] | None, int | None]:
    """The track (2, 44100 · frames) as it will be heard, and the gain in dB; (None, None) without clips.

    Raises:
        Avs3dError: if a clip is missing or damaged, or has other than two channels.
    """
    if not (observation.path / layout.BINAURAL).is_dir():
        return None, None
    samples = joined([read_clip(frame) for frame in observation.frames])
    gain = gain_for(float(np.abs(samples).max(initial=0.0)))
    return (samples * np.float32(10 ** (gain / 20))).astype(np.float32), gain


def gain_for(peak: float) -> int:
    """Whole decibels by which a track of this peak (full scale 1) is raised: to `PEAK_DB`, by `MAX_GAIN_DB` at most.

    It is lowered where it would clip, as far as that takes.
    """
    return min(MAX_GAIN_DB, math.floor(PEAK_DB - 20 * math.log10(peak))) if peak > 0 else 0


def _loudness(sound: NDArray[np.float32] | None, number: int, gain: int | None) -> Loudness | None:
    """RMS of both ears in the file, dB re full scale, for the meters."""
    if sound is None or gain is None:
        return None
    second = sound[:, number * layout.SAMPLE_RATE : (number + 1) * layout.SAMPLE_RATE].astype(np.float64)
    left, right = (10 * math.log10(max(float(power), 1e-20)) for power in np.mean(second**2, axis=1))
    return Loudness(left, right, gain)


def describe_film(film: Film) -> str:
    """One line for the terminal."""
    what = "no sound" if film.gain_db is None else f"sound {film.gain_db:+d} dB"
    return f"{film.path}: {film.frames} s, {film.width} × {film.height}, {what}"
