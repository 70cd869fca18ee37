"""One observation, from its plan to a folder on disk: read `generate_observation` top to bottom for the whole story."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.decay import reverberation_time
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from avs3d_bench.schema import (
    SCHEMA_VERSION,
    SOUND_SCENES_VERSION,
    AcousticsRecord,
    AmbisonicsRecord,
    DeviceRecord,
    FrameRecord,
    HrtfRecord,
    InstanceRecord,
    IntrinsicsRecord,
    LicenceRecord,
    ObservationRecord,
    SoundRecord,
    VisionRecord,
)
from avs3d_bench.text import readable
from generators.acoustics.base import AcousticBackend
from generators.acoustics.clips import GAIN, check_clip, mono_clip, rms
from generators.arrangement import Arrangement, arrange, draw_sounding, file_licence
from generators.assets.sounds import load_sound, synthesise
from generators.backends import vision_backend
from generators.core.scene import Licence, Scene
from generators.homes.store import open_home
from generators.library import open_asset
from generators.library.licences import spdx
from generators.manifest import SoundSpec
from generators.paths.stage import Stage, StageRenderer
from generators.paths.watcher import line_of_sight
from generators.placement.placement import Placement
from generators.plan import ObservationPlan, resolve_file
from generators.receivers import Receivers
from generators.recording.hearing import PRE_ROLL, AcousticJob, ReceiverClips, hear, hear_in_background
from generators.recording.output import FolderOutput, ObservationOutput
from generators.recording.surface_points import SurfaceSampler
from generators.recording.writer import ObservationWriter
from generators.vision.base import RenderedView, VisionBackend

#: Number of impulse responses from which an observation's reverberation time is measured.
T30_RESPONSES = 8


@dataclass(frozen=True, eq=False)
class SourceSignal:
    """The source signal: mono samples at the benchmark's sample rate, and their origin."""

    samples: NDArray[np.float32]
    asset: str
    licence: Licence

    @property
    def record(self) -> SoundRecord:
        """Its record in observation.json."""
        return SoundRecord(asset=self.asset, licence=licence_record(self.licence))


def generate_observation(
    plan: ObservationPlan,
    root: Path,
    cache: Path,
    on_frame: Callable[[int], None] = lambda _: None,
    *,
    cores: Callable[[], int] = lambda: 1,
    pictures: Path | None = None,
    output: Callable[[Path], ObservationOutput] = FolderOutput,
) -> ObservationRecord:
    """Make one observation below ``root``; it gets its final name only when it is complete.

    Args:
        plan: all that its bytes depend on.
        root: the dataset's folder.
        cache: folder of baked homes.
        on_frame: called with the index of each finished frame.
        cores: how many cores may be used, called before each frame; the bytes do not depend on it. With more than one,
            several frames are rendered at the same time, and the sound is computed in another process.
        pictures: the finished original of an acoustic variant, whose pictures `ObservationOutput.share` takes
            over; None: they are rendered.
        output: makes the output of the files from the observation's final folder.

    Returns:
        The record that was written as observation.json.

    Raises:
        Avs3dError: one line: no place for an object, a missing or broken file, a full disk, …
    """
    ready = prepare_observation(plan, cache)
    stage, poses = ready.stage, ready.seen.poses
    points = SurfaceSampler(ready.intrinsics, plan.rng("points"))
    frames: list[FrameRecord] = []
    clips: list[NDArray[np.float32]] = []
    decays: list[NDArray[np.float32]] = []
    lent = CoreBudget(cores)
    with (
        ObservationWriter(output(root / plan.key), **plan.optional_files) as writer,
        hear_in_background(hear(ready.listening), ready.listening.device, lambda: lent.ask() > 1) as sounds,
        closing(
            _reuse_pictures(ready, writer, pictures) if pictures else _render(ready, writer, points, lent)
        ) as masks,
    ):
        # The sound first: its process must start before there are threads.
        for index, (pose, sound, mask) in enumerate(zip(poses, sounds, masks, strict=False)):
            clip, response = sound.head.clip, sound.head.response
            check_heard(sound, f"{plan.key}, frame {index}")
            writer.add_sound(index, clip, response)
            writer.add_recordings(index, sound.others)
            clips.append(clip)
            if index % max(1, len(poses) // T30_RESPONSES) == 0:
                decays.append(response)
            frames.append(describe_frame(index, pose, mask, clip, stage))
            on_frame(index)
        for index in range(len(clips) if writer.keeps(layout.MONO) else 0):
            writer.add_mono(index, mono_clip(clips, index))
        if pictures is None and writer.keeps(layout.COLMAP):
            writer.add_model(ready.intrinsics, poses, points.link(poses, stage.hidden))
        writer.add_sounding_mesh(stage.source(0).mesh)
        return writer.finish(describe_observation(plan, ready, frames, decays))


def _render(
    ready: PreparedObservation, writer: ObservationWriter, points: SurfaceSampler, lent: CoreBudget
) -> Generator[NDArray[np.bool_]]:
    """Render and write the pictures; give the mask (H, W) of each frame, and add its surface points."""
    stage, poses = ready.stage, ready.seen.poses

    def write_pictures(index: int, frame: RenderedView) -> None:
        writer.add_pictures(index, frame, frame.instance_ids == ready.sounding)

    with closing(StageRenderer(ready.sight, stage, ready.intrinsics)) as view:
        for pose, frame in zip(poses, view.frames(poses, write_pictures, lambda: lent.cores), strict=False):
            if writer.keeps(layout.COLMAP):
                points.add(frame, pose, instances=not stage.moves)
            yield frame.instance_ids == ready.sounding


def _reuse_pictures(
    ready: PreparedObservation, writer: ObservationWriter, original: Path
) -> Generator[NDArray[np.bool_]]:
    """Take over the pictures of the original; give the mask (H, W) of each frame."""
    writer.share_pictures(original)
    for index in range(len(ready.seen.poses)):
        yield writer.add_mask_of(index, ready.sounding)


def check_heard(sound: ReceiverClips, where: str, *, silence: bool = False) -> None:
    """Refuse clips that are not finite, clip or are silent (see `check_clip`), of any receiver.

    Raises:
        Avs3dError: one line.
    """
    check_clip(sound.head.clip, where, silence=silence)
    for name, one in sound.others.items():
        check_clip(one.clip, f"{where}, {name}", silence=silence)


class CoreBudget:
    """The number of cores that may be used, asked once for each frame.

    Args:
        ask: see ``cores`` of `generate_observation`.

    Attributes:
        cores: the last answer.
    """

    def __init__(self, ask: Callable[[], int]) -> None:
        self._ask = ask
        self.cores = 1

    def ask(self) -> int:
        """Ask, and remember the answer."""
        self.cores = self._ask()
        return self.cores


@dataclass(frozen=True, eq=False)
class PreparedObservation:
    """The part of an observation that is fixed before its first frame.

    Attributes:
        seen: the placed objects and the walk.
        sounding: id of the instance that sounds, from 1.
        stage: the scene at every second.
        sound: the source signal.
        intrinsics: of the camera.
        sight: the renderer.
        engine: the acoustic engine.
        listening: the inputs of the acoustic simulation.
    """

    seen: Arrangement
    sounding: int
    stage: Stage
    sound: SourceSignal
    intrinsics: Intrinsics
    sight: VisionBackend
    engine: AcousticBackend
    listening: AcousticJob

    @property
    def instances(self) -> tuple[InstanceRecord, ...]:
        """The records of the placed objects in observation.json."""
        placed = enumerate(self.seen.placements, start=1)
        return tuple(describe_instance(number, placement, number == self.sounding) for number, placement in placed)


def prepare_observation(plan: ObservationPlan, cache: Path) -> PreparedObservation:
    """Choose all that is visible, with the same rules for all objects; then, independently, the sounding instance.

    Raises:
        Avs3dError: if the room is too small for the objects or the walk, or a file is missing or broken.
    """
    sight = vision_backend(plan.vision)
    home, seen = arranged(plan, cache, sight)
    sounding = draw_sounding(plan, seen.placements)
    stage = Stage(home, seen.placements, sounding, seen.motion)
    intrinsics = Intrinsics.from_fov(plan.camera.size, plan.camera.hfov)
    assert plan.spec.category is not None
    sound = choose_sound(plan, plan.spec.category, plan.rng("sound"))
    seconds = range(len(seen.poses) + 1 if stage.moves else 1)
    listening = AcousticJob(
        backend=plan.audio,
        absorption_scale=plan.spec.acoustics.absorption_scale,
        scene=stage.scene(0),
        room=plan.spec.room,
        samples=sound.samples,
        poses=tuple(seen.poses),
        sources=tuple(stage.source(second).source_position for second in seconds),
        receivers=plan.receivers,
        device=plan.device,
    )
    return PreparedObservation(seen, sounding, stage, sound, intrinsics, sight, listening.engine(), listening)


#: The last home with its arrangement, by the digest of the pictures: siblings and variants often follow one another in
#: a process.
_LAST: dict[str, tuple[Scene, Arrangement]] = {}


def arranged(plan: ObservationPlan, cache: Path, sight: VisionBackend) -> tuple[Scene, Arrangement]:
    """The lit home of a plan, and what is visible in it."""
    if plan.pictures_digest not in _LAST:
        _LAST.clear()
        home = open_home(plan, cache).for_room(plan.spec.room)
        _LAST[plan.pictures_digest] = home, arrange(plan, home, sight.navigable(home))
    return _LAST[plan.pictures_digest]


def describe_observation(
    plan: ObservationPlan,
    ready: PreparedObservation,
    frames: Sequence[FrameRecord],
    decays: list[NDArray[np.float32]],
) -> ObservationRecord:
    """The record in observation.json, without its list of files.

    Args:
        plan: of the observation.
        ready: the part that is fixed before the first frame.
        frames: records of all frames.
        decays: impulse responses (2, n) from which the reverberation time is read.
    """
    spec, source = plan.spec, ready.stage.source(0)
    return ObservationRecord(
        schema_version=SOUND_SCENES_VERSION if plan.own_categories else SCHEMA_VERSION,
        key=plan.key,
        part=spec.part,
        scan=spec.scan,
        room=spec.room,
        index=spec.index,
        categories=plan.own_categories,
        category=spec.category,
        seed=plan.seed,
        plan_sha256=plan.digest,
        notes=ready.seen.notes,
        variant_of=spec.like,
        source_motion="path" if ready.stage.moves else None,
        source_position=source.source_position,
        intrinsics=IntrinsicsRecord.of(ready.intrinsics),
        instances=ready.instances,
        sound=ready.sound.record,
        acoustics=describe_acoustics(ready.engine, plan.receivers, decays),
        vision=VisionRecord(backend=ready.sight.name, version=ready.sight.version),
        device=device_record(plan),
        frames=tuple(frames),
        files={},
    )


def device_record(plan: ObservationPlan) -> DeviceRecord | None:
    """The record of the device that baked the light; None: the CPU."""
    if plan.device == "cpu":
        return None
    return DeviceRecord(name="cuda", version=plan.backends[f"device {plan.device}"])


def describe_acoustics(
    engine: AcousticBackend, receivers: Receivers, decays: list[NDArray[np.float32]]
) -> AcousticsRecord:
    """The record of the acoustic simulation in observation.json.

    Args:
        engine: the acoustic engine.
        receivers: what heard it.
        decays: impulse responses (2, n) from which the reverberation time is read; none where nothing sounds.
    """
    return AcousticsRecord(
        backend=engine.name,
        version=engine.version,
        sample_rate=layout.SAMPLE_RATE,
        gain=GAIN,
        settings=engine.describe(),
        t30=reverberation_time(decays, layout.SAMPLE_RATE) if decays else None,
        hrtf=describe_head(receivers),
        ambisonics=AmbisonicsRecord(order=receivers.ambisonics) if receivers.ambisonics else None,
        array=receivers.array,
    )


def describe_head(receivers: Receivers) -> HrtfRecord | None:
    """The record of the measured head, with the licence that its file states; None: the engine's own head."""
    head = receivers.head()
    if head is None or receivers.hrtf is None:
        return None
    hrirs, name = head.hrirs, readable(receivers.hrtf.name)
    return HrtfRecord(
        asset=f"hrtf:{name}",
        name=spdx(hrirs.licence) or "unknown",
        author=hrirs.author or "unknown",
        source=hrirs.origin or name,
        title=hrirs.name,
        sha256=hrirs.sha256,
    )


@dataclass(frozen=True)
class SoundFile:
    """A recording that the manifest names: its file, and its origin."""

    path: Path
    asset: str
    licence: Licence

    def sound(self, seconds: float, start: float = 0.0) -> SourceSignal:
        """The recording as a source of so many seconds; ``start``: see `load_sound`."""
        return SourceSignal(load_sound(self.path, seconds, start=start), self.asset, self.licence)


def sound_file(plan: ObservationPlan, category: str, spec: SoundSpec) -> SoundFile:
    """The file of an entry of the manifest's ``sounds``.

    Raises:
        Avs3dError: if it is missing.
    """
    if spec.asset is not None:
        path, entry = open_asset(plan.lock, spec.asset)
        return SoundFile(path, entry.id, Licence(entry.licence, entry.author, entry.url or entry.ref))
    path = resolve_file(plan.base, str(spec.file), f"sound for {category}")
    return SoundFile(path, str(spec.file), file_licence(spec))


def choose_sound(plan: ObservationPlan, category: str, rng: np.random.Generator) -> SourceSignal:
    """The signal of the one source, as long as the observation and the pre-roll before its first frame.

    Args:
        plan: of the observation.
        category: of the source.
        rng: the only source of randomness.
    """
    seconds = plan.camera.frames + PRE_ROLL
    files = plan.sounds.get(category, ())
    if files:
        return sound_file(plan, category, files[int(rng.integers(len(files)))]).sound(seconds)
    return synthesised_sound(category, seconds, rng)


def synthesised_sound(category: str, seconds: int, rng: np.random.Generator) -> SourceSignal:
    """A procedural signal, the same for the same state of ``rng``."""
    return SourceSignal(synthesise(category, seconds, rng), f"procedural:{category}", Licence(source="synthesised"))


def describe_frame(
    index: int,
    pose: Pose,
    mask: NDArray[np.bool_],
    clip: NDArray[np.float32],
    stage: Stage,
) -> FrameRecord:
    """The record of one frame in observation.json."""
    source = stage.source(index)
    direction = direction_to(pose, source.source_position)
    left, right = rms(clip)
    own = Pose.from_yaw(source.position, source.yaw)
    return FrameRecord(
        name=layout.frame_name(index),
        time=index / layout.FRAME_RATE,
        position=pose.position,
        rotation=pose.rotation,
        visible_pixels=int(mask.sum()),
        azimuth=direction.azimuth,
        elevation=direction.elevation,
        distance=direction.distance,
        line_of_sight=line_of_sight(stage.caster, pose, source),
        rms_left=float(left),
        rms_right=float(right),
        source_position=source.source_position if stage.moves else None,
        instance_position=own.position if stage.moves else None,
        instance_rotation=own.rotation if stage.moves else None,
    )


def describe_instance(number: int, placement: Placement, sounding: bool) -> InstanceRecord:
    """The record of one placed object in observation.json."""
    low, high = placement.bounds.tolist()
    pose = Pose.from_yaw(placement.position, placement.yaw)
    return InstanceRecord(
        id=number,
        category=placement.model.category,
        sounding=sounding,
        position=pose.position,
        rotation=pose.rotation,
        bounds=(tuple(low), tuple(high)),
        asset=f"procedural:{placement.model.name}"
        if placement.model.licence.source == "procedural"
        else placement.model.name,
        licence=licence_record(placement.model.licence),
    )


def licence_record(licence: Licence) -> LicenceRecord:
    """The record of a licence in the JSON files."""
    return LicenceRecord(name=licence.name, author=licence.author, source=licence.source)
