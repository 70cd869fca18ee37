"""One observation, from its plan to its files: read `generate_observation` top to bottom for the whole story.

An observation has a tuple of sources; in part_1 and part_2 it is one source that always sounds and is always marked.
`generators.observation.parts` has the table of all that differs by part.

Siblings of a group and variants of an observation have the same pictures: whoever comes after the first links its files
instead of rendering. What is written does not depend on that, since all random draws behind a picture are those of the
first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AudibleRecord, FrameRecord, ObservationRecord
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.errors import Avs3dError
from generators.acoustics.clips import ClippedError, mono_clip
from generators.observation.hearing import HeardSource, hear_in_background, hear_sources
from generators.observation.mixing import make_background, mix, other_backgrounds, stems_of
from generators.observation.output import FolderOutput, ObservationOutput
from generators.observation.prepare import PreparedObservation, prepare_observation
from generators.observation.record import describe_frame, describe_observation
from generators.observation.stems import Clip, Stem, audible_sources
from generators.observation.surface_points import SurfaceSampler
from generators.observation.writer import ObservationWriter
from generators.plan import ObservationPlan
from generators.scenes.renderer import Renderer
from generators.vision.base import frames_at_once

Second = TypeVar("Second")

#: Number of impulse responses from which an observation's reverberation time is measured.
T30_RESPONSES = 8
#: The sources of an observation are lowered by at most so many decibels (`generate_observation`).
LOWERED_DB = 6


@dataclass(frozen=True, eq=False)
class HeardSecond:
    """One second of an observation, whose pictures and responses are written.

    Attributes:
        index: of the second, from 0.
        stems: what the two ears hear of each source.
        decay: (2, n) response from which the reverberation time is measured; None in most seconds.
    """

    index: int
    stems: tuple[Stem, ...]
    decay: NDArray[np.float32] | None


def generate_observation(
    plan: ObservationPlan,
    root: Path,
    cache: Path,
    on_frame: Callable[[int], None] = lambda _: None,
    *,
    cores: Callable[[], int] = lambda: 1,
    pictures: Path | None = None,
    output: Callable[[Path], ObservationOutput] = FolderOutput,
    lowered_db: int | None = None,
) -> ObservationRecord:
    """Make one observation below ``root``; it gets its final name only when it is complete.

    Args:
        plan: all that its bytes depend on.
        root: the dataset's folder.
        cache: folder of baked homes.
        on_frame: called with the index of each finished frame.
        cores: how many cores may be used, called before each frame; the bytes do not depend on it. With more than one,
            several frames are rendered at the same time, and the sound is computed in another process.
        pictures: a finished sibling or original, whose pictures `ObservationOutput.share` takes over; None: they are
            rendered.
        output: makes the output of the files from the observation's final folder. Frames whose picture it does not
            keep are heard as far as others need them, and not rendered.
        lowered_db: by how much all sources are lowered; None: by 0, and where those of a part_3 observation then reach
            full scale, it is made again with all of them lower, decibel by decibel (`LOWERED_DB`).

    Returns:
        The record that was written as observation.json.

    Raises:
        Avs3dError: one line: no place for an object, a room that does not exist, a missing or broken file, a full
            disk, …
    """
    for decibels in range(LOWERED_DB + 1) if lowered_db is None else (lowered_db,):
        prepared = replace(prepare_observation(plan, cache), lowered_db=decibels)
        budget = CoreBudget(cores, 1 if pictures else frames_at_once(prepared.renderer))
        try:
            with ObservationWriter(output(root / plan.key), prepared.contents, **plan.optional_files) as writer:
                return _write(prepared, writer, _hear_and_render(prepared, writer, pictures, on_frame, budget))
        except ClippedError:
            if lowered_db is not None or not plan.spec.is_part_3 or decibels == LOWERED_DB:
                raise
    raise AssertionError("the last round returns or raises")


def _write(
    prepared: PreparedObservation, writer: ObservationWriter, seconds: Sequence[HeardSecond]
) -> ObservationRecord:
    """Write all that follows from what was heard in all seconds; the pictures and responses are written already."""
    plan = prepared.plan
    background, noise = make_background(plan, [second.stems for second in seconds])
    stems = [stems_of(prepared, second.stems, noise, second.index) for second in seconds]
    clips = [mix(prepared, list(named.values()), index) for index, named in enumerate(stems)]
    clips += [np.zeros_like(clips[0])] * (len(prepared.arrangement.poses) - len(clips))
    frames = [
        _write_frame(prepared, writer, seconds[index], stems[index], clip)
        if writer.keeps_frame(index)
        # A frame that is not kept has a record only so that the others have their places.
        else describe_frame(prepared, index, 0, clip, ())
        for index, clip in enumerate(clips)
    ]
    for index, others in enumerate(other_backgrounds(plan, background, len(seconds))):
        _add_background(prepared, writer, index, others)
    for index in range(len(clips)):
        if writer.keeps(layout.audio_path(layout.MONO, index)):
            writer.add_mono(index, mono_clip(clips, index))
    meshes = {number: placement.mesh for number, placement in prepared.sounding.items()}
    writer.add_sounding_mesh(meshes, named=prepared.rules.named_sources and prepared.stage.moves)
    top_view = prepared.stage.top_view(plan.spec.room)
    if top_view is not None:
        writer.add_top_view(top_view.rgb)
    decays = [second.decay for second in seconds if second.decay is not None]
    return writer.finish(describe_observation(prepared, frames, background, decays, top_view))


class CoreBudget:
    """The number of cores that may be used, asked once for each frame.

    Args:
        ask: see ``cores`` of `generate_observation`.
        least: the least answer that counts. A renderer that works on several frames at once has as many threads from
            the first one on, and the sound, which forks, a process of its own before these.

    Attributes:
        cores: the last answer.
    """

    def __init__(self, ask: Callable[[], int], least: int = 1) -> None:
        self._ask, self._least = ask, least
        self.cores = least

    def ask(self) -> int:
        """Ask, and remember the answer."""
        self.cores = max(self._ask(), self._least)
        return self.cores


def _hear_and_render(
    prepared: PreparedObservation,
    writer: ObservationWriter,
    pictures: Path | None,
    on_frame: Callable[[int], None],
    budget: CoreBudget,
) -> list[HeardSecond]:
    """Hear every source in each second, and render its picture meanwhile; write pictures and responses."""
    plan, poses = prepared.plan, prepared.arrangement.poses
    kept = {index: pose for index, pose in enumerate(poses) if writer.keeps_frame(index)}
    last = _seconds_to_hear(prepared, kept)
    if pictures is not None:
        writer.share_pictures(pictures)
    renders = pictures is None
    points = (
        SurfaceSampler(prepared.intrinsics, plan.rng("points")) if renders and writer.keeps(layout.COLMAP) else None
    )
    seconds = []
    with (
        hear_in_background(
            hear_sources(prepared.acoustic_jobs, last), plan.options.device, lambda: budget.ask() > 1
        ) as sounds,
        Renderer(prepared.stage, prepared.renderer, room=plan.spec.room) as camera,
        closing(
            camera.frames(
                kept if renders else {}, prepared.intrinsics, then=writer.add_pictures, cores=lambda: budget.cores
            )
        ) as views,
    ):
        for index in range(last):
            # The sound first: its process must start before there are threads.
            seconds.append(_write_sound(prepared, writer, index, _second_of(sounds, plan, index)))
            if renders and index in kept:
                view = _second_of(views, plan, index)
                if points is not None:
                    points.add(view, poses[index], instances=not prepared.stage.moves)
            on_frame(index)
    if points is not None:
        writer.add_model(prepared.intrinsics, poses, points.link(poses, prepared.stage.hidden))
    return seconds


def _seconds_to_hear(prepared: PreparedObservation, kept: Iterable[int]) -> int:
    """How many seconds must be heard for the kept frames.

    The level of a background follows from the sound of all seconds; a mono clip, from that of its neighbours.
    """
    count = len(prepared.arrangement.poses)
    if prepared.plan.spec.background is not None:
        return count
    return 1 + max((frame for index in kept for frame, _, _ in layout.mono_window(index, count)), default=-1)


def _second_of(values: Iterator[Second], plan: ObservationPlan, index: int) -> Second:
    """The next of the values that are made for each second.

    Raises:
        Avs3dError: if there is none.
    """
    try:
        return next(values)
    except StopIteration:
        raise Avs3dError(f"{plan.key}, frame {index}: it was not computed") from None


def _write_sound(
    prepared: PreparedObservation, writer: ObservationWriter, index: int, heard: Sequence[HeardSource]
) -> HeardSecond:
    """Write the responses of one second, and what the other receivers hear, which is too large to keep."""
    sources = list(zip(prepared.sources, heard, strict=True))
    for source, one in sources:
        writer.add_response(index, source.id, one.head.response)
    for name in prepared.plan.options.receivers.channels if writer.keeps_frame(index) else ():
        stems = {source.id: one.others[name].clip for source, one in sources}
        writer.add_clip(index, mix(prepared, list(stems.values()), index, name), name)
        writer.add_stems(index, stems, name)
        for source, one in sources:
            writer.add_response(index, source.id, one.others[name].response, name)
    inside = [one for source, one in sources if source.instance is not None]
    every = max(1, len(prepared.arrangement.poses) // T30_RESPONSES)
    decay = inside[0].head.response if inside and index % every == 0 else None
    return HeardSecond(index, tuple(Stem(one.head.clip, one.drr_db) for one in heard), decay)


def _write_frame(
    prepared: PreparedObservation, writer: ObservationWriter, second: HeardSecond, stems: dict[str, Clip], clip: Clip
) -> FrameRecord:
    """Write what follows from the sound of one frame, whose pictures are written already: clip, stems and masks."""
    writer.add_clip(second.index, clip)
    writer.add_stems(second.index, stems)
    named = {source.id: stem for source, stem in zip(prepared.sources, second.stems, strict=True)}
    audible = audible_sources(clip, named) if prepared.rules.marked_while_audible else ()
    visible = writer.add_masks(second.index, class_table(prepared, audible))
    return describe_frame(prepared, second.index, visible, clip, audible)


def _add_background(
    prepared: PreparedObservation, writer: ObservationWriter, index: int, noise: dict[str, Clip]
) -> None:
    """Add the background of a second to the clips of the receivers beside the two ears."""
    for name, samples in noise.items() if writer.keeps_frame(index) else ():
        writer.add_clip(index, mix(prepared, [writer.read_clip(index, name), samples], index, name), name)
        writer.add_stems(index, {layout.BACKGROUND: samples}, name)


def class_table(prepared: PreparedObservation, audible: Sequence[AudibleRecord]) -> NDArray[np.uint8]:
    """(instances + 1,) instance id → class id if the instance is marked, else 0; see `PartRules`."""
    heard = {entry.source for entry in audible}
    numbers = class_ids(prepared.plan.own_categories or ())
    table = np.zeros(len(prepared.arrangement.placements) + 1, dtype=np.uint8)
    for source in prepared.sources:
        marked = source.id in heard or not prepared.rules.marked_while_audible
        if marked and source.instance is not None:
            table[source.instance] = numbers[source.category]
    return table
