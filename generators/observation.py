"""One observation, from its plan to a folder on disk: read `generate_observation` top to bottom for the whole story."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from avs3d_bench.schema import (
    AcousticsRecord,
    FrameRecord,
    InstanceCategory,
    InstanceRecord,
    IntrinsicsRecord,
    LicenceRecord,
    ObservationRecord,
    SoundRecord,
    VisionRecord,
)
from generators.acoustics.clips import GAIN, binaural_clip, check_clip, mono_clip, rms
from generators.acoustics.decay import reverberation_time
from generators.assets.catalogue import Model, build_model, variants
from generators.assets.meshfile import load_model
from generators.assets.sounds import load_sound, synthesise
from generators.backends import acoustic_backend, vision_backend
from generators.homes import open_home
from generators.placement import Placement, place
from generators.plan import ObservationPlan, resolve_file
from generators.scenes.light import insert
from generators.scenes.scene import Licence
from generators.surface_points import SurfaceSampler
from generators.trajectory import line_of_sight, walk
from generators.vision.rays import RayCaster
from generators.writer import ObservationWriter

#: Impulse responses from which an observation's reverberation time is read.
T30_RESPONSES = 8
#: Seconds of the source before the first frame, so that the first clip holds reverberation too.
PRE_ROLL = 2


@dataclass(frozen=True, eq=False)
class Sound:
    """What the sounding instance plays: mono samples at the benchmark's rate, and where they come from."""

    samples: NDArray[np.float32]
    asset: str
    licence: Licence


def generate_observation(
    plan: ObservationPlan, root: Path, cache: Path, on_frame: Callable[[int], None] = lambda _: None
) -> ObservationRecord:
    """Make one observation below ``root``; nothing appears under its final name before it is whole.

    Args:
        plan: everything that decides its bytes.
        root: the dataset's folder.
        cache: folder of baked homes.
        on_frame: called with the index of each finished frame.

    Returns:
        The record that was written as observation.json.

    Raises:
        Avs3dError: one line: no room for an object, a file that is missing or broken, a full disk, …
    """
    spec, camera = plan.spec, plan.camera
    home = open_home(plan, cache).for_room(spec.room)

    # What stands where, and the path of the agent.
    sounding, silent = choose_models(plan)
    placements = place(home, spec.room, sounding, instances=spec.copies, silent=silent, rng=plan.rng("placement"))
    poses, notes = walk(
        home, spec.room, placements, frames=camera.frames, height=camera.height, hfov=camera.hfov, rng=plan.rng("path")
    )
    source = next(placement for placement in placements if placement.sounding)
    scene = insert(home, tuple(p.part(number) for number, p in enumerate(placements, start=1)))

    # What is seen and heard from each pose.
    intrinsics = Intrinsics.from_fov(camera.size, camera.hfov)
    sight, sound_engine = vision_backend(plan.vision), acoustic_backend(plan.audio)
    sound = choose_sound(plan)
    caster = RayCaster(scene)
    points = SurfaceSampler(intrinsics, plan.rng("points"))
    frames: list[FrameRecord] = []
    clips: list[NDArray[np.float32]] = []
    decays: list[NDArray[np.float32]] = []
    with ObservationWriter(root / plan.key, depth=plan.depth, rirs=plan.rirs) as writer:
        view = sight.open(scene, intrinsics)
        hearing = sound_engine.open(scene, source.source_position, room=spec.room, sample_rate=layout.SAMPLE_RATE)
        try:
            for index, pose in enumerate(poses):
                frame = view.render(pose)
                response = hearing.impulse_response(pose)
                clip = binaural_clip(sound.samples, response, index + PRE_ROLL)
                check_clip(clip, f"{plan.key}, frame {index}")
                mask = frame.instance_ids == placements.index(source) + 1
                writer.add_frame(index, frame, mask, clip, response)
                points.add(frame, pose)
                clips.append(clip)
                if index % max(1, len(poses) // T30_RESPONSES) == 0:
                    decays.append(response)
                frames.append(describe_frame(index, pose, mask, clip, source, line_of_sight(caster, pose, source)))
                on_frame(index)
        finally:
            hearing.close()
            view.close()
        for index in range(len(clips)):
            writer.add_mono(index, mono_clip(clips, index))
        writer.add_model(intrinsics, poses, points.link(poses, caster))
        writer.add_sounding_mesh(source.mesh)
        return writer.finish(
            ObservationRecord(
                key=plan.key,
                part=spec.part,
                scan=spec.scan,
                room=spec.room,
                index=spec.index,
                category=spec.category,
                seed=plan.seed,
                plan_sha256=plan.digest,
                notes=notes,
                source_position=source.source_position,
                intrinsics=IntrinsicsRecord.of(intrinsics),
                instances=tuple(describe_instance(n, p) for n, p in enumerate(placements, start=1)),
                sound=SoundRecord(asset=sound.asset, licence=licence_record(sound.licence)),
                acoustics=AcousticsRecord(
                    backend=sound_engine.name,
                    version=sound_engine.version,
                    sample_rate=layout.SAMPLE_RATE,
                    gain=GAIN,
                    settings=sound_engine.describe(),
                    t30=reverberation_time(decays, layout.SAMPLE_RATE),
                ),
                vision=VisionRecord(backend=sight.name, version=sight.version),
                frames=tuple(frames),
                files={},
            )
        )


def choose_models(plan: ObservationPlan) -> tuple[Model, tuple[Model, ...]]:
    """The sounding model and the silent others, from the manifest's files or the procedural catalogue."""
    rng = plan.rng("models")

    def choose(category: str, variant: str | None = None) -> Model:
        files = plan.objects.get(category, ())
        if files:
            chosen = files[int(rng.integers(len(files)))]
            licence = Licence(chosen.licence.name, chosen.licence.author, chosen.licence.source or chosen.file)
            path = resolve_file(plan.base, chosen.file, f"mesh for {category}")
            return load_model(path, category, licence=licence, height=chosen.height)
        known = variants(category)
        return build_model(category, variant or known[int(rng.integers(len(known)))], rng)

    return choose(plan.spec.category, plan.spec.variant), tuple(choose(name) for name in plan.spec.silent)


def choose_sound(plan: ObservationPlan) -> Sound:
    """The source signal: as long as the observation plus the pre-roll that the first clip remembers."""
    rng = plan.rng("sound")
    seconds = plan.camera.frames + PRE_ROLL
    files = plan.sounds.get(plan.spec.category, ())
    if files:
        chosen = files[int(rng.integers(len(files)))]
        path = resolve_file(plan.base, chosen.file, f"sound for {plan.spec.category}")
        licence = Licence(chosen.licence.name, chosen.licence.author, chosen.licence.source or chosen.file)
        return Sound(load_sound(path, seconds), chosen.file, licence)
    return Sound(
        synthesise(plan.spec.category, seconds, rng), f"procedural:{plan.spec.category}", Licence(source="synthesised")
    )


def describe_frame(
    index: int,
    pose: Pose,
    mask: NDArray[np.bool_],
    clip: NDArray[np.float32],
    source: Placement,
    seen: bool,
) -> FrameRecord:
    """What observation.json says about one frame."""
    direction = direction_to(pose, source.source_position)
    left, right = rms(clip)
    return FrameRecord(
        name=layout.frame_name(index),
        time=index / layout.FRAME_RATE,
        position=pose.position,
        rotation=pose.rotation,
        visible_pixels=int(mask.sum()),
        azimuth=direction.azimuth,
        elevation=direction.elevation,
        distance=direction.distance,
        line_of_sight=seen,
        rms_left=float(left),
        rms_right=float(right),
    )


def describe_instance(number: int, placement: Placement) -> InstanceRecord:
    """What observation.json says about one placed object."""
    low, high = placement.bounds.tolist()
    pose = Pose.from_yaw(placement.position, placement.yaw)
    return InstanceRecord(
        id=number,
        category=cast(InstanceCategory, placement.model.category),
        sounding=placement.sounding,
        position=pose.position,
        rotation=pose.rotation,
        bounds=(tuple(low), tuple(high)),
        asset=f"procedural:{placement.model.name}"
        if placement.model.licence.source == "procedural"
        else placement.model.name,
        licence=licence_record(placement.model.licence),
    )


def licence_record(licence: Licence) -> LicenceRecord:
    """A licence as the JSON files hold it."""
    return LicenceRecord(name=licence.name, author=licence.author, source=licence.source)
