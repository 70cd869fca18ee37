"""One observation of part_3, from its plan to a folder on disk: read `generate_sound_scene` top to bottom.

Siblings of a group have the same pictures: whoever comes after the first links its files instead of rendering. What is
written does not depend on that, since all random draws behind a picture are those of the first.

    choose objects and path → hear every source in every second, render or link the pictures
    → scale the background → clips, what is audible, masks → observation.json
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from avs3d_bench.schema import (
    AudibleRecord,
    BackgroundRecord,
    FrameRecord,
    InstanceRecord,
    IntrinsicsRecord,
    ObservationRecord,
    Room,
    SourceRecord,
    VisionRecord,
)
from avs3d_bench.taxonomy import class_ids
from generators.acoustics.background import diffuse_noise, diffuse_seconds
from generators.acoustics.base import AcousticBackend
from generators.acoustics.clips import check_clip, mono_clip, rms
from generators.arrangement import Arrangement
from generators.assets.sounds import enough, recorded_seconds, stretches, stretches_in
from generators.backends import acoustic_backend, vision_backend
from generators.core.freespace import FreeSpace
from generators.core.rays import RayCaster
from generators.core.scene import Scene
from generators.observation import (
    T30_RESPONSES,
    CoreBudget,
    SoundFile,
    SourceSignal,
    arranged,
    describe_acoustics,
    describe_instance,
    device_record,
    licence_record,
    sound_file,
    synthesised_sound,
)
from generators.paths.stage import Stage, StageRenderer
from generators.paths.watcher import line_of_sight, point_in_sight
from generators.placement.placement import Placement
from generators.plan import ObservationPlan, derive_rng
from generators.programme import Interval, gated, intervals_of
from generators.recording.hearing import PRE_ROLL, AcousticJob, hear_in_background
from generators.recording.output import FolderOutput, ObservationOutput
from generators.recording.scene_writer import SceneWriter
from generators.recording.stems import Clip, HeardSource, audible_sources, decibels, hear_sources, mixture, power
from generators.recording.surface_points import SurfaceSampler
from generators.vision.base import RenderedView, VisionBackend

Vector = tuple[float, float, float]

#: Height of an off-screen source above the floor (m), about that of a table top or a person's mouth.
OFF_SCREEN_HEIGHT = 1.2
#: Without sources, a background's SNR refers to this level (dB re full scale): about the mean level of one source in a
#: room of the open benchmark (docs/part-3.md).
REFERENCE_LEVEL_DB = -35.0
#: Signals that are kept for variants; one of 120 s takes 21 MB.
MOST_SIGNALS = 3


@dataclass(frozen=True, eq=False)
class SceneSource:
    """A source of a sound scene.

    Attributes:
        id: ``source_1``, …
        category: what it is.
        instance: id of the instance that sounds; None: off-screen.
        room: where it is.
        position: (x, y, z) metres.
        intervals: when it sounds, seconds from the first frame.
        gain_db: level re the common loudness.
        sound: what it plays while it sounds.
    """

    id: str
    category: str
    instance: int | None
    room: Room
    position: Vector
    intervals: tuple[Interval, ...]
    gain_db: float
    sound: SourceSignal

    @property
    def samples(self) -> NDArray[np.float32]:
        """(n,) its signal from `PRE_ROLL` seconds before the first frame on: 0 where it does not sound."""
        scale = np.float32(10 ** (self.gain_db / 20))
        return gated(self.sound.samples * scale, self.intervals, PRE_ROLL)

    @property
    def record(self) -> SourceRecord:
        """Its record in observation.json."""
        return SourceRecord(
            id=self.id,
            instance=self.instance,
            category=self.category,
            room=self.room,
            position=self.position,
            programme=self.intervals,
            gain_db=self.gain_db,
            asset=self.sound.asset,
            licence=licence_record(self.sound.licence),
        )


@dataclass(frozen=True, eq=False)
class PreparedScene:
    """The part of a sound scene that is fixed before its first frame.

    Attributes:
        home: the lit home, without the objects.
        seen: the placed objects and the walk.
        sources: what sounds.
        intrinsics: of the camera.
        sight: the renderer.
        engine: the acoustic engine.
        scene: the home with the objects; its light does not know of them.
    """

    home: Scene
    seen: Arrangement
    sources: tuple[SceneSource, ...]
    intrinsics: Intrinsics
    sight: VisionBackend
    engine: AcousticBackend
    scene: Scene

    @cached_property
    def caster(self) -> RayCaster:
        """Rays against the home with the objects."""
        return RayCaster(self.scene)

    @property
    def sounding(self) -> dict[int, Placement]:
        """Id of an instance that sounds → its placement, sorted."""
        ids = sorted({source.instance for source in self.sources if source.instance is not None})
        return {number: self.seen.placements[number - 1] for number in ids}

    @property
    def instances(self) -> tuple[InstanceRecord, ...]:
        """The records of the placed objects in observation.json."""
        placed = enumerate(self.seen.placements, start=1)
        return tuple(describe_instance(number, placement, number in self.sounding) for number, placement in placed)

    def listenings(self, plan: ObservationPlan) -> tuple[AcousticJob, ...]:
        """The inputs of the acoustic simulation, one per source."""
        return tuple(
            AcousticJob(
                backend=plan.audio,
                absorption_scale=plan.spec.acoustics.absorption_scale,
                scene=self.scene,
                room=source.room,
                samples=source.samples,
                poses=tuple(self.seen.poses),
                sources=(source.position,),
                receivers=plan.receivers,
                device=plan.device,
                seed=plan.acoustic_seed,
            )
            for source in self.sources
        )


def generate_sound_scene(
    plan: ObservationPlan,
    root: Path,
    cache: Path,
    on_frame: Callable[[int], None] = lambda _: None,
    *,
    cores: Callable[[], int] = lambda: 1,
    pictures: Path | None = None,
    output: Callable[[Path], ObservationOutput] = FolderOutput,
) -> ObservationRecord:
    """Make one observation of part_3 below ``root``.

    Args:
        plan: all that its bytes depend on.
        root: the dataset's folder.
        cache: folder of baked homes.
        on_frame: called with the index of each finished frame.
        cores: see `generators.observation.generate_observation`.
        pictures: a finished sibling, whose pictures `ObservationOutput.share` takes over; None: they are rendered.
        output: see `generators.observation.generate_observation`.

    Raises:
        Avs3dError: one line: no place for an object, a room that does not exist, a missing or broken file, …
    """
    ready = prepare_scene(plan, cache)
    lent = CoreBudget(cores)
    sounds = hear_in_background(hear_sources(ready.listenings(plan)), plan.device, lambda: lent.ask() > 1)
    with SceneWriter(output(root / plan.key), contents_of(plan, ready), **plan.optional_files) as writer:
        with sounds as seconds:
            if pictures is None:
                heard = _render(plan, ready, writer, seconds, on_frame, lent)
            else:
                writer.share_pictures(pictures)
                heard = []
                for index in range(len(ready.seen.poses)):
                    heard.append(next_second(plan, ready, writer, seconds, index))
                    on_frame(index)
        background, noise = make_background(plan, [[one.stem for one in second] for second in heard])
        frames, clips = [], []
        for index, second in enumerate(heard):
            clip, frame = write_second(plan, ready, writer, index, second, noise)
            clips.append(clip)
            frames.append(frame)
        for index, others in enumerate(other_backgrounds(plan, background, len(heard))):
            writer.add_other_background(index, others, f"{plan.key}, frame {index}")
        for index in range(len(clips) if writer.keeps(layout.MONO) else 0):
            writer.add_mono(index, mono_clip(clips, index))
        if ready.sounding:
            writer.add_sounding_mesh(*(placement.mesh for placement in ready.sounding.values()))
        return writer.finish(describe_scene(plan, ready, frames, background, decays_of(ready, heard)))


def write_second(
    plan: ObservationPlan,
    ready: PreparedScene,
    writer: SceneWriter,
    index: int,
    second: Sequence[HeardSource],
    noise: NDArray[np.float32],
) -> tuple[Clip, FrameRecord]:
    """Write what follows from the sound of one frame, whose pictures are written already: clip, stems and masks.

    Args:
        plan: of the observation.
        ready: the part that is fixed before the first frame.
        writer: of the files.
        index: of the frame.
        second: what is heard of each source.
        noise: samples of the background over all frames; see `make_background`.

    Returns:
        The clip (2, 44100), and the frame's record.
    """
    clip, audible = mix(plan, ready, index, second, noise)
    writer.add_clip(index, clip)
    writer.add_stems(index, stems_of(ready, second, noise, index))
    visible = writer.add_masks(index, class_table(ready, audible, plan.own_categories or ()))
    return clip, describe_scene_frame(ready, index, visible, clip, audible)


def prepare_scene(plan: ObservationPlan, cache: Path) -> PreparedScene:
    """Choose all that is visible, and then what sounds, which nothing visible depends on.

    Raises:
        Avs3dError: if a room does not exist, is too small for the objects or the walk, or a file is missing or broken.
    """
    sight = vision_backend(plan.vision)
    return prepare_sources(plan, *arranged(plan, cache, sight), sight)


def prepare_sources(plan: ObservationPlan, home: Scene, seen: Arrangement, sight: VisionBackend) -> PreparedScene:
    """Choose what sounds among objects that are placed already.

    Raises:
        Avs3dError: if a room does not exist, or a file is missing or broken.
    """
    return PreparedScene(
        home=home,
        seen=seen,
        sources=choose_sources(plan, home, seen.placements),
        intrinsics=Intrinsics.from_fov(plan.camera.size, plan.camera.hfov),
        sight=sight,
        engine=acoustic_backend(
            plan.audio,
            absorption_scale=plan.spec.acoustics.absorption_scale,
            receivers=plan.receivers,
            device=plan.device,
            seed=plan.acoustic_seed,
        ),
        scene=home.with_parts(tuple(p.part(number) for number, p in enumerate(seen.placements, start=1))),
    )


def choose_sources(plan: ObservationPlan, home: Scene, placements: Sequence[Placement]) -> tuple[SceneSource, ...]:
    """The sources of a plan.

    In all siblings the n-th off-screen source of a room is at the same place; what a source plays is its own in each of
    them. Instances that the manifest does not name are drawn among those that no other source takes.
    """
    instances = draw_instances(plan, [placement.model.category for placement in placements])
    of_category: Counter[str] = Counter()
    of_room: Counter[str] = Counter()
    sources = []
    for number, (spec, instance) in enumerate(zip(plan.spec.sources or (), instances, strict=True), start=1):
        of_category[spec.category] += 1
        if instance is None:
            assert spec.room is not None
            room = spec.room
            of_room[room] += 1
            position = _off_screen(plan, home, room, of_room[room])
        else:
            room = plan.spec.room
            position = placements[instance - 1].source_position
        seconds = float(plan.camera.frames)
        bursts = spec.programme.bursts if spec.programme else None
        rng = plan.rng(f"programme/{number}/{bursts.seed if bursts else 0}")
        nth = of_category[spec.category]
        sources.append(
            SceneSource(
                id=f"source_{number}",
                category=spec.category,
                instance=instance,
                room=room,
                position=position,
                intervals=intervals_of(spec.programme, seconds, PRE_ROLL, rng),
                gain_db=spec.gain_db,
                sound=_sound(plan, spec.category, nth),
            )
        )
    return tuple(sources)


def draw_instances(plan: ObservationPlan, categories: Sequence[str]) -> tuple[int | None, ...]:
    """The instance of each source of a plan, from 1; None for one off-screen.

    Args:
        plan: of the observation.
        categories: of the placed objects, in the order of their ids.
    """
    specs = plan.spec.sources or ()
    same: dict[str, list[int]] = {}
    for number, category in enumerate(categories, start=1):
        same.setdefault(category, []).append(number)
    taken = {same[s.category][s.instance - 1] for s in specs if s.room is None and s.instance is not None}
    found: list[int | None] = []
    for number, spec in enumerate(specs, start=1):
        if spec.room is not None:
            found.append(None)
        elif spec.instance is not None:
            found.append(same[spec.category][spec.instance - 1])
        else:
            free = [one for one in same[spec.category] if one not in taken]
            drawn = free[int(plan.own_rng(f"sounding/{number}").integers(len(free)))]
            found.append(drawn)
            taken.add(drawn)
    return tuple(found)


def _sound(plan: ObservationPlan, category: str, nth: int) -> SourceSignal:
    """The signal of the ``nth`` source of a category.

    Siblings never share a take, and nor do twins in one observation: who finds the same samples in two clips knows
    what sounds without listening, and two sources in step would be one coherent source with two places.
    """
    seconds = plan.camera.frames + PRE_ROLL
    files, lengths = _recordings(plan, category)
    if not files:
        return _synthesised(plan.seed, plan.own_key, f"sound/{category}/{nth}", category, seconds)
    takes = plan.takes[category]
    number, start = stretches(lengths, seconds, takes.of, plan.rng(f"takes/{category}"))[takes.first + nth - 1]
    return files[number].sound(seconds, start)


def _recordings(plan: ObservationPlan, category: str) -> tuple[list[SoundFile], list[float]]:
    """The recordings of a category, each once, and their lengths (s)."""
    files = [sound_file(plan, category, spec) for spec in plan.sounds.get(category, ())]
    files = list({file.path: file for file in files}.values())
    return files, [recorded_seconds(file.path) for file in files]


def check_takes(plans: Iterable[ObservationPlan]) -> None:
    """Refuse recordings that do not reach for a stretch for each take of a group.

    Raises:
        UsageError: one line: siblings would share samples, and a comparison of their clips would tell what sounds.
        Avs3dError: if a recording is missing or broken.
    """
    for plan in plans:
        seconds = plan.camera.frames + PRE_ROLL
        for category, takes in plan.takes.items():
            lengths = _recordings(plan, category)[1]
            if not enough(lengths, seconds, takes.of):
                raise UsageError(
                    f"{plan.spec.like or plan.key}: {takes.of} sources of {category} in the siblings, but its "
                    f"recordings have {stretches_in(lengths, seconds)} stretches of {seconds} s: comparing clips would "
                    "tell what sounds; name more or longer recordings, or make shorter observations (--frames)"
                )


@lru_cache(maxsize=MOST_SIGNALS)
def _synthesised(seed: int, key: str, purpose: str, category: str, seconds: int) -> SourceSignal:
    """A procedural signal: variants play the same ones, and often follow one another in a process."""
    sound = synthesised_sound(category, seconds, derive_rng(seed, key, purpose))
    sound.samples.setflags(write=False)
    return sound


def _off_screen(plan: ObservationPlan, home: Scene, room: str, nth: int) -> Vector:
    """A point above the free floor of another room, for the ``nth`` source in it.

    Raises:
        Avs3dError: if the room does not exist, or has no free floor.
    """
    space = FreeSpace.of(home, room)
    points = space.points
    if not len(points):
        raise Avs3dError(f"{home.name}/{room}: no free floor for an off-screen source; name another room")
    x, z = points[int(plan.rng(f"off-screen/{room}/{nth}").integers(len(points)))].tolist()
    return x, space.floor + OFF_SCREEN_HEIGHT, z


def contents_of(plan: ObservationPlan, ready: PreparedScene) -> layout.SoundScene:
    """The facts that decide which files the observation has."""
    return layout.SoundScene(
        sources=tuple(source.id for source in ready.sources),
        in_room=bool(ready.sounding),
        stems=plan.keeps_stems,
        background=plan.spec.background is not None,
    )


def next_second(
    plan: ObservationPlan,
    ready: PreparedScene,
    writer: SceneWriter,
    seconds: Iterator[tuple[HeardSource, ...]],
    index: int,
) -> tuple[HeardSource, ...]:
    """Hear every source in the next second; an observation without a source gives nothing.

    Responses, and all that other receivers hear of the sources, are written at once.
    """
    heard = next(seconds, ())
    if len(heard) != len(ready.sources):
        raise Avs3dError(f"{plan.key}, frame {index}: {len(heard)} stems of {len(ready.sources)} sources were computed")
    for source, one in zip(ready.sources, heard, strict=True):
        writer.add_response(index, source.id, one.response)
    others = {source.id: one.others for source, one in zip(ready.sources, heard, strict=True)}
    writer.add_others(index, others, f"{plan.key}, frame {index}")
    # What the other receivers hear is written, and too large to be kept.
    return tuple(replace(one, others={}) for one in heard)


def _render(
    plan: ObservationPlan,
    ready: PreparedScene,
    writer: SceneWriter,
    seconds: Iterator[tuple[HeardSource, ...]],
    on_frame: Callable[[int], None],
    lent: CoreBudget,
) -> list[tuple[HeardSource, ...]]:
    """Render and write the pictures, and hear the sources meanwhile."""
    poses = ready.seen.poses
    stage = Stage(ready.home, ready.seen.placements)
    points = SurfaceSampler(ready.intrinsics, plan.rng("points"))
    heard = []
    with closing(StageRenderer(ready.sight, stage, ready.intrinsics)) as view:
        frames: Iterator[RenderedView] = view.frames(poses, writer.add_pictures, lambda: lent.cores)
        for index, pose in enumerate(poses):
            # The sound first: its process must start before there are threads.
            heard.append(next_second(plan, ready, writer, seconds, index))
            frame = next(frames)
            if writer.keeps(layout.COLMAP):
                points.add(frame, pose)
            on_frame(index)
    if writer.keeps(layout.COLMAP):
        writer.add_model(ready.intrinsics, poses, points.link(poses, stage.hidden))
    return heard


def make_background(
    plan: ObservationPlan, stems: Sequence[Sequence[Clip]]
) -> tuple[BackgroundRecord | None, NDArray[np.float32]]:
    """The background of an observation at the level that gives its SNR.

    Args:
        plan: of the observation.
        stems: for every second, the stem (2, 44100) of each source.

    Returns:
        Its record, and its samples (2, seconds · 44100); None and no samples without a background.
    """
    spec = plan.spec.background
    if spec is None:
        return None, np.zeros((2, 0), dtype=np.float32)
    noise = diffuse_noise(spec.kind, len(stems), plan.own_rng("background"))
    mean = float(np.mean([power(mixture(second)) for second in stems]))
    level = (decibels(mean) if mean > 0 else REFERENCE_LEVEL_DB) - spec.snr_db
    noise *= np.float32(10 ** (level / 20))
    return BackgroundRecord(kind=spec.kind, snr_db=spec.snr_db, level_db=decibels(power(noise))), noise


def other_backgrounds(
    plan: ObservationPlan, background: BackgroundRecord | None, seconds: int
) -> Iterator[dict[str, Clip]]:
    """For every second: name of each receiver beside the two ears → its background (channels, 44100).

    Every receiver hears another draw of the same diffuse field. Its level is that of the sound pressure at a point,
    which is the level at each ear. There is none where there is no background, or no such receiver.
    """
    others = plan.receivers.others()
    if background is None or not others:
        return
    scale = np.float32(10 ** (background.level_db / 20))
    fields = {
        name: diffuse_seconds(background.kind, one.diffuse_covariance, seconds, plan.own_rng(f"background/{name}"))
        for name, one in others.items()
    }
    for _ in range(seconds):
        yield {name: next(field) * scale for name, field in fields.items()}


def stems_of(
    ready: PreparedScene, second: Sequence[HeardSource], noise: NDArray[np.float32], index: int
) -> dict[str, Clip]:
    """Name → stem (2, 44100) of one second: every source, and the background if there is one."""
    stems = {source.id: one.stem for source, one in zip(ready.sources, second, strict=True)}
    if noise.shape[1]:
        rate = layout.SAMPLE_RATE
        stems[layout.BACKGROUND] = noise[:, index * rate : (index + 1) * rate]
    return stems


def mix(
    plan: ObservationPlan, ready: PreparedScene, index: int, second: Sequence[HeardSource], noise: NDArray[np.float32]
) -> tuple[Clip, tuple[AudibleRecord, ...]]:
    """The clip (2, 44100) of one second, and the sources that are audible in it.

    Raises:
        Avs3dError: if the clip is not finite, or exceeds full scale.
    """
    clip = mixture(list(stems_of(ready, second, noise, index).values()))
    check_clip(clip, f"{plan.key}, frame {index}", silence=True)
    named = {source.id: one for source, one in zip(ready.sources, second, strict=True)}
    return clip, audible_sources(clip, named)


def class_table(ready: PreparedScene, audible: Sequence[AudibleRecord], own: Sequence[str] = ()) -> NDArray[np.uint8]:
    """(instances + 1,) instance id → class id if the instance is audible, else 0; ``own``: see `class_ids`."""
    heard = {entry.source for entry in audible}
    numbers = class_ids(own)
    table = np.zeros(len(ready.seen.placements) + 1, dtype=np.uint8)
    for source in ready.sources:
        if source.id in heard and source.instance is not None:
            table[source.instance] = numbers[source.category]
    return table


def decays_of(ready: PreparedScene, heard: Sequence[Sequence[HeardSource]]) -> list[NDArray[np.float32]]:
    """The responses from which the room's reverberation time is measured: of its first source in the room."""
    inside = [number for number, source in enumerate(ready.sources) if source.instance is not None]
    step = max(1, len(heard) // T30_RESPONSES)
    return [second[inside[0]].response for second in heard[::step]] if inside else []


def describe_scene_frame(
    ready: PreparedScene,
    index: int,
    visible: int,
    clip: Clip,
    audible: Sequence[AudibleRecord],
) -> FrameRecord:
    """The record of one frame in observation.json; its direction is that of the first source."""
    pose = ready.seen.poses[index]
    left, right = rms(clip)
    first = ready.sources[0] if ready.sources else None
    direction = direction_to(pose, first.position) if first else None
    return FrameRecord(
        name=layout.frame_name(index),
        time=index / layout.FRAME_RATE,
        position=pose.position,
        rotation=pose.rotation,
        visible_pixels=visible,
        azimuth=direction.azimuth if direction else None,
        elevation=direction.elevation if direction else None,
        distance=direction.distance if direction else None,
        line_of_sight=_is_in_sight(ready, first, pose) if first else None,
        rms_left=float(left),
        rms_right=float(right),
        audible=tuple(audible),
    )


def _is_in_sight(ready: PreparedScene, source: SceneSource, pose: Pose) -> bool:
    if source.instance is None:
        return point_in_sight(ready.caster, pose, source.position)
    return line_of_sight(ready.caster, pose, ready.seen.placements[source.instance - 1])


def describe_scene(
    plan: ObservationPlan,
    ready: PreparedScene,
    frames: Sequence[FrameRecord],
    background: BackgroundRecord | None,
    decays: list[NDArray[np.float32]],
) -> ObservationRecord:
    """The record in observation.json, without its list of files."""
    spec = plan.spec
    first = ready.sources[0] if ready.sources else None
    return ObservationRecord(
        schema_version="1.1",
        key=plan.key,
        part=spec.part,
        scan=spec.scan,
        room=spec.room,
        index=spec.index,
        categories=plan.own_categories,
        category=first.category if first else None,
        seed=plan.seed,
        plan_sha256=plan.digest,
        notes=ready.seen.notes,
        variant_of=spec.variant_of,
        source_position=first.position if first else None,
        sources=tuple(source.record for source in ready.sources),
        background=background,
        group=spec.like or plan.key,
        intrinsics=IntrinsicsRecord.of(ready.intrinsics),
        instances=ready.instances,
        acoustics=describe_acoustics(ready.engine, plan.receivers, decays),
        vision=VisionRecord(backend=ready.sight.name, version=ready.sight.version),
        device=device_record(plan),
        frames=tuple(frames),
        files={},
    )
