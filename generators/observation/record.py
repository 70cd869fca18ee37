"""The record of an observation in observation.json."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    PART_3_VERSION,
    SCHEMA_VERSION,
    AcousticsRecord,
    AmbisonicsRecord,
    AudibleRecord,
    BackgroundRecord,
    DeviceRecord,
    DirectivityRecord,
    FrameRecord,
    HrtfRecord,
    InstanceRecord,
    IntrinsicsRecord,
    LicenceRecord,
    MovedRecord,
    ObservationRecord,
    SoundRecord,
    SourceRecord,
    TopViewRecord,
    VisionRecord,
)
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.measures.decay import reverberation_time
from avs3d_bench.text.printable import readable
from generators.acoustics.base import AcousticBackend
from generators.acoustics.clips import GAIN, rms
from generators.acoustics.receivers import Receivers
from generators.core.scene import Licence
from generators.library.licences import spdx
from generators.observation.prepare import PreparedObservation
from generators.observation.sources import SoundSource
from generators.observation.stems import Clip
from generators.placement.placement import Placement
from generators.plan import ObservationPlan
from generators.vision.top_view import TopView


def describe_observation(
    prepared: PreparedObservation,
    frames: Sequence[FrameRecord],
    background: BackgroundRecord | None,
    decays: list[NDArray[np.float32]],
    top_view: TopView | None = None,
) -> ObservationRecord:
    """The record in observation.json, without its list of files.

    Args:
        prepared: the part that is fixed before the first frame.
        frames: records of the frames.
        background: its record; None: there is none.
        decays: impulse responses (2, n) from which the reverberation time is read; none where nothing sounds.
        top_view: the room from above; None: there is no such picture.
    """
    plan, spec = prepared.plan, prepared.plan.spec
    first = prepared.sources[0] if prepared.sources else None
    named = prepared.rules.named_sources
    return ObservationRecord(
        schema_version=PART_3_VERSION if named or plan.own_categories else SCHEMA_VERSION,
        key=plan.key,
        part=spec.part,
        scan=spec.scan,
        room=spec.room,
        index=spec.index,
        categories=plan.own_categories,
        category=first.category if first else None,
        seed=plan.seed,
        plan_sha256=plan.digest,
        notes=prepared.arrangement.notes,
        variant_of=spec.variant_of if named else spec.like,
        source_motion="path" if prepared.stage.moves and not named else None,
        source_position=first.position if first else None,
        sources=tuple(map(describe_source, prepared.sources)) if named else None,
        background=background,
        group=(spec.like or plan.key) if named else None,
        intrinsics=IntrinsicsRecord.of(prepared.intrinsics),
        instances=describe_instances(prepared),
        sound=describe_signal(first) if first and not named else None,
        acoustics=describe_acoustics(prepared.engine, plan.options.receivers, decays, GAIN * prepared.lowered),
        vision=VisionRecord(backend=prepared.renderer.name, version=prepared.renderer.version),
        device=describe_device(plan),
        options=plan.options.further() or None,
        top_view=describe_top_view(top_view),
        frames=tuple(frames),
        files={},
    )


def describe_top_view(view: TopView | None) -> TopViewRecord | None:
    """The record of the area that a picture from above shows."""
    if view is None:
        return None
    return TopViewRecord(left=view.left, top=view.top, width=view.width, height=view.height)


def describe_source(source: SoundSource) -> SourceRecord:
    """The record of a source of a part_3 observation."""
    return SourceRecord(
        id=source.id,
        instance=source.instance,
        category=source.category,
        room=source.room,
        position=source.position,
        programme=source.intervals,
        gain_db=source.gain_db,
        asset=source.signal.asset,
        licence=describe_licence(source.signal.licence),
        directivity=describe_directivity(source),
    )


def describe_signal(source: SoundSource) -> SoundRecord:
    """The record of the signal of an observation's only source."""
    return SoundRecord(
        asset=source.signal.asset,
        licence=describe_licence(source.signal.licence),
        gain_db=source.gain_db or None,
        directivity=describe_directivity(source),
    )


def describe_directivity(source: SoundSource) -> DirectivityRecord | None:
    """The record of a source's directivity; None: it is alike in all directions."""
    if source.directivity is None:
        return None
    terms = source.directivity_licence
    return DirectivityRecord(
        name=source.directivity.name,
        index_db={band: round(value, 2) for band, value in source.directivity.index().items()},
        licence=None if terms is None else describe_licence(terms),
    )


def describe_frame(
    prepared: PreparedObservation, index: int, visible: int, clip: Clip, audible: Sequence[AudibleRecord]
) -> FrameRecord:
    """The record of one frame; its direction is that of the first source.

    Args:
        prepared: the part that is fixed before the first frame.
        index: of the frame.
        visible: number of marked pixels.
        clip: (2, 44100) of the frame.
        audible: the sources that are audible in it.
    """
    pose = prepared.arrangement.poses[index]
    left, right = rms(clip)
    first = prepared.sources[0] if prepared.sources else None
    direction = direction_to(pose, first.position_at(index)) if first else None
    stage = prepared.stage
    moved = {number: _pose_of(stage.placement(number, index)) for number in stage.moving}
    named = prepared.rules.named_sources
    own = moved.get(first.instance) if first and first.instance and not named else None
    return FrameRecord(
        name=layout.frame_name(index),
        time=index / layout.FRAME_RATE,
        position=pose.position,
        rotation=pose.rotation,
        visible_pixels=visible,
        azimuth=direction.azimuth if direction else None,
        elevation=direction.elevation if direction else None,
        distance=direction.distance if direction else None,
        line_of_sight=_is_in_sight(prepared, first, index) if first else None,
        rms_left=float(left),
        rms_right=float(right),
        source_position=first.position_at(index) if first and own else None,
        instance_position=own.position if own else None,
        instance_rotation=own.rotation if own else None,
        moved=tuple(MovedRecord.of(number, pose) for number, pose in moved.items()) if named and moved else None,
        audible=tuple(audible) if prepared.rules.marked_while_audible else None,
    )


def _is_in_sight(prepared: PreparedObservation, source: SoundSource, index: int) -> bool:
    stage, pose = prepared.stage, prepared.arrangement.poses[index]
    if source.instance is None:
        return stage.is_point_in_sight(pose, source.position, index)
    return stage.is_in_sight(source.instance, pose, index)


def describe_device(plan: ObservationPlan) -> DeviceRecord | None:
    """The record of the device that baked the light; None: the CPU."""
    device = plan.options.device
    return None if device == "cpu" else DeviceRecord(name="cuda", version=plan.backends[f"device {device}"])


def describe_acoustics(
    engine: AcousticBackend, receivers: Receivers, decays: list[NDArray[np.float32]], gain: float
) -> AcousticsRecord:
    """The record of the acoustic simulation.

    Args:
        engine: the acoustic engine.
        receivers: what heard it.
        decays: impulse responses (2, n) from which the reverberation time is read; none where nothing sounds.
        gain: factor on all clips.
    """
    return AcousticsRecord(
        backend=engine.name,
        version=engine.version,
        sample_rate=layout.SAMPLE_RATE,
        gain=gain,
        settings=engine.describe(),
        t30=reverberation_time(decays, layout.SAMPLE_RATE) if decays else None,
        hrtf=describe_head(receivers),
        head=receivers.drawn,
        ambisonics=AmbisonicsRecord(order=receivers.ambisonics) if receivers.ambisonics else None,
        array=receivers.array,
    )


def describe_head(receivers: Receivers) -> HrtfRecord | None:
    """The record of the measured head, with the licence that its file states; None without one."""
    head = receivers.measured()
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


def describe_instances(prepared: PreparedObservation) -> tuple[InstanceRecord, ...]:
    """The records of the placed objects, in the order of their ids."""
    placed = enumerate(prepared.arrangement.placements, start=1)
    return tuple(_describe_instance(number, placement, number in prepared.sounding) for number, placement in placed)


def _describe_instance(number: int, placement: Placement, sounding: bool) -> InstanceRecord:
    low, high = placement.bounds.tolist()
    pose, licence = _pose_of(placement), placement.model.licence
    name = placement.model.name
    return InstanceRecord(
        id=number,
        category=placement.model.category,
        sounding=sounding,
        position=pose.position,
        rotation=pose.rotation,
        bounds=(tuple(low), tuple(high)),
        asset=f"procedural:{name}" if licence.source == "procedural" else name,
        licence=describe_licence(licence),
    )


def _pose_of(placement: Placement) -> Pose:
    return Pose.from_yaw(placement.position, placement.yaw)


def describe_licence(licence: Licence) -> LicenceRecord:
    """The record of a licence."""
    return LicenceRecord(name=licence.name, author=licence.author, source=licence.source)
