"""`observation.json` and `camera_splits.json`: one observation, with its instances, sources, acoustics and frames."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema.base import (
    PART_3_VERSION,
    SCHEMA_VERSION,
    AttributionRecord,
    Category,
    FrameName,
    LicenceRecord,
    NonNegative,
    Part,
    Positive,
    Quaternion,
    Record,
    RelativePath,
    Room,
    Scalar,
    Scan,
    Sha256,
    SourceId,
    Text,
    Vector3,
)
from avs3d_bench.contract.taxonomy import CATEGORIES, DISTRACTORS, OFF_SCREEN_CATEGORIES, OVEN, PART_3, class_ids
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose


class IntrinsicsRecord(Record):
    """Pinhole camera without distortion, in pixels; the centre of pixel (u, v) is at (u + 0.5, v + 0.5)."""

    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]
    fx: Positive
    fy: Positive
    cx: float
    cy: float

    @classmethod
    def of(cls, camera: Intrinsics) -> Self:
        """The record of a camera."""
        return cls(width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy)

    @property
    def camera(self) -> Intrinsics:
        """The camera that projects."""
        return Intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


class TopViewRecord(Record):
    """`top_view.png`: the room of a scan from above, cut at head height, without placed objects.

    x is to the right, z downwards. Pixels that are black (0, 0, 0) show nothing.
    """

    left: float = Field(description="x of the picture's left side, metres")
    top: float = Field(description="z of the picture's upper side, metres")
    width: Positive = Field(description="metres")
    height: Positive = Field(description="metres")


class InstanceRecord(Record):
    """One placed object. Its id is its pixel value in `instance_masks/`, where 0 is the home.

    For a moving object, ``position``, ``rotation`` and ``bounds`` are those at the first frame; `frames` have the rest.
    """

    id: Annotated[int, Field(ge=1, le=65535)]
    category: Category
    sounding: bool
    position: Vector3 = Field(description="origin of the model in the world, metres")
    rotation: Quaternion = Field(description="model-to-world (w, x, y, z)")
    bounds: tuple[Vector3, Vector3] = Field(description="lowest and highest corner in the world, metres")
    asset: Text = Field(description="name of the model, e.g. 'procedural:clock/round'")
    licence: LicenceRecord

    @model_validator(mode="after")
    def _check(self) -> Self:
        if any(low > high for low, high in zip(*self.bounds, strict=True)):
            raise ValueError(f"bounds {self.bounds}: the lowest corner comes first")
        return self


class DirectivityRecord(Record):
    """Directivity of a source in the frame of its instance: y up, z to the front; 0 dB on its axis in every octave."""

    left_out: ClassVar[frozenset[str]] = frozenset({"licence"})

    name: Text = Field(description="what it is: a cardioid with its axis, the model of a category, a file's title")
    index_db: dict[int, float] = Field(
        description="octave (Hz) → directivity index: level on the axis above that of a point source of the same power"
    )
    licence: LicenceRecord | None = Field(default=None, description="of the file that it is from, if it is from one")


class SoundRecord(Record):
    """The recording or synthesis that the sounding instance plays."""

    left_out: ClassVar[frozenset[str]] = frozenset({"gain_db", "directivity"})

    asset: Text
    licence: LicenceRecord
    gain_db: float | None = Field(
        default=None, description="level re the common loudness of all sources, dB; absent: 0"
    )
    directivity: DirectivityRecord | None = Field(default=None, description="absent: alike in all directions")


class SourceRecord(Record):
    """One source of sound of an observation of part_3.

    ``programme`` lists the intervals in which it sounds, in seconds from the first frame. A source that always sounds
    has sounded before the first frame as well: its only interval starts at a negative time, the beginning of what is
    simulated.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"directivity"})

    id: SourceId
    instance: Annotated[int, Field(ge=1, le=65535)] | None = Field(
        description="id of the instance that sounds, as in instance_masks; null if the source is off-screen"
    )
    category: Category
    room: Room = Field(description="room of the source; another one than the observation's if it is off-screen")
    position: Vector3 = Field(description="position of the source in the world, metres")
    programme: tuple[tuple[float, float], ...] = Field(
        description="[start, end) in seconds, increasing, without overlaps; empty if the frames end before it sounds"
    )
    gain_db: float = Field(description="level re the common loudness of all sources, dB")
    asset: Text = Field(description="the recording or synthesis that it plays")
    licence: LicenceRecord
    directivity: DirectivityRecord | None = Field(default=None, description="absent: alike in all directions")

    @model_validator(mode="after")
    def _check(self) -> Self:
        last = -math.inf
        for start, end in self.programme:
            if not last <= start < end:
                raise ValueError(f"{self.id}: programme {self.programme}: expected increasing intervals, none empty")
            last = end
        return self


class BackgroundRecord(Record):
    """Diffuse sound without a source."""

    kind: Literal["room_tone", "noise"]
    snr_db: float = Field(description="mean level of all sources above the background, dB")
    level_db: float = Field(description="RMS of the background over both ears and all frames, dB re full scale")


class AudibleRecord(Record):
    """One audible source in one frame, from its own clip (stem): everything it is heard with, reverberation included.

    Levels are RMS over both ears and the second of the clip, in dB re full scale.
    """

    source: SourceId
    level_db: float = Field(description="level of the stem")
    drr_db: float | None = Field(
        description="direct sound over reverberation of the stem; null where no direct sound arrives"
    )
    snr_db: float | None = Field(description="level above the rest of the clip; null if the rest is silent")


#: A source is audible if its stem is at least this loud (dB re full scale) …
AUDIBLE_LEVEL_DB = -60.0
#: … and at most this far below the rest of the clip (dB).
AUDIBLE_SNR_DB = -20.0
#: What is simulated begins this long before the first frame (s): no programme begins earlier.
EARLIEST_START = -2.0


class HrtfRecord(LicenceRecord):
    """The measured head that heard the binaural clips, from a SOFA file.

    The licence is the file's own (its global attribute License), by its SPDX identifier if that is clear.
    """

    asset: Text = Field(description="'hrtf:' and the name that the file had; sha256 tells it from others")
    title: Text = Field(description="title, database and subject in the file")
    sha256: Sha256 = Field(description="of the file")

    @property
    def attribution(self) -> AttributionRecord:
        """Its entry in dataset.json."""
        return AttributionRecord(asset=self.asset, name=self.name, author=self.author, source=self.source)


class ResonanceRecord(Record):
    """A notch or a resonance of a pinna."""

    frequency: Positive = Field(description="Hz, straight ahead")
    gain_db: float = Field(description="dB, negative for a notch; of a notch, where it is deepest")
    width: Positive = Field(description="as a share of the frequency")
    rise: float = Field(description="of the frequency, from straight ahead to overhead, as a share of it")


class HeadRecord(Record):
    """A head of the parametric family: a rigid sphere with ears off its diameter, and pinnae.

    Both ears mirror each other. There is no torso.
    """

    family: Literal["train", "test"] = Field(description="which heads it is among: no head is among both")
    radius: Positive = Field(description="of the sphere, metres")
    ear_azimuth: float = Field(description="of the right ear, degrees from straight ahead")
    ear_elevation: float = Field(description="of the ears, degrees")
    notches: Annotated[tuple[ResonanceRecord, ...], Field(min_length=1)]
    peaks: tuple[ResonanceRecord, ...]
    back_shift: float = Field(description="of the notches' frequencies from ahead to behind, as a share of them")
    back_loss_db: NonNegative = Field(description="dB that high frequencies lose behind")


class AmbisonicsRecord(Record):
    """The channels of ``audio_clips_ambisonics/``.

    Coincident at the centre of the head; axes of the head: x forward, y left, z up.
    """

    order: Annotated[int, Field(ge=1, le=3)]
    channel_order: Literal["ACN"] = "ACN"
    normalisation: Literal["SN3D"] = "SN3D"

    @property
    def channels(self) -> int:
        """(order + 1)²."""
        return (self.order + 1) ** 2

    @property
    def channel_names(self) -> tuple[str, ...]:
        """W, Y, Z, X, … (letters after Gerzon and Malham)."""
        return tuple("WYZXVTRSUQOMKLNP"[: self.channels])


class MicrophoneRecord(Record):
    """One omnidirectional microphone of an array."""

    name: Annotated[str, Field(min_length=1, max_length=60)]
    position: Vector3 = Field(description="metres from the centre of the head, in its frame: x right, y up, −z ahead")


class ArrayRecord(Record):
    """The channels of ``audio_clips_array/``: microphones that move with the listener, without a head."""

    microphones: Annotated[tuple[MicrophoneRecord, ...], Field(min_length=1, max_length=layout.MOST_CHANNELS)]

    @property
    def channels(self) -> int:
        """Number of microphones."""
        return len(self.microphones)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """The names of the microphones."""
        return tuple(microphone.name for microphone in self.microphones)


class AcousticsRecord(Record):
    """The acoustic simulation that made the clips.

    ``hrtf``, ``head``, ``ambisonics`` and ``array`` are absent where the engine's own head heard the sound, and nothing
    else did.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"hrtf", "head", "ambisonics", "array"})

    backend: Text
    version: Text
    sample_rate: Annotated[int, Field(gt=0)]
    gain: Positive = Field(description="factor applied to all clips of the observation")
    settings: dict[str, Scalar] = Field(
        default_factory=dict, description="settings of the backend: number of rays, depth, …"
    )
    t30: Positive | None = Field(default=None, description="reverberation time of the room, seconds (ISO 3382-2)")
    notes: str = ""
    hrtf: HrtfRecord | None = Field(default=None, description="the measured head, if a SOFA file was given")
    head: HeadRecord | None = Field(default=None, description="the head, if it is one of the parametric family")
    ambisonics: AmbisonicsRecord | None = Field(default=None, description="of audio_clips_ambisonics/, if it is there")
    array: ArrayRecord | None = Field(default=None, description="of audio_clips_array/, if it is there")

    @property
    def receivers(self) -> dict[str, AmbisonicsRecord | ArrayRecord]:
        """The receivers beside the two ears: name (`layout.RECEIVERS`) → channels."""
        named = {layout.AMBISONICS: self.ambisonics, layout.ARRAY: self.array}
        return {name: found for name, found in named.items() if found is not None}


class VisionRecord(Record):
    """The renderer of the pictures."""

    backend: Text
    version: Text


class DeviceRecord(Record):
    """The device that baked the light and, if the acoustic engine can choose, traced the sound."""

    name: Literal["cuda"]
    version: Text = Field(description="of the software that drives it, with the kind of device; the bytes depend on it")


class MovedRecord(Record):
    """The place of a moving instance at the time of a frame."""

    instance: Annotated[int, Field(ge=1, le=65535)]
    position: Vector3 = Field(description="origin of the model in the world, metres")
    rotation: Quaternion = Field(description="model-to-world (w, x, y, z)")

    @classmethod
    def of(cls, instance: int, pose: Pose) -> Self:
        """The record of an instance at a pose."""
        return cls(instance=instance, position=pose.position, rotation=pose.rotation)

    @property
    def pose(self) -> Pose:
        """Its model-to-world pose."""
        return Pose(self.position, self.rotation)


class FrameRecord(Record):
    """One frame: the pose of the agent's sensor, and the visibility and direction of the source.

    If the sounding object moves, ``source_position``, ``instance_position`` and ``instance_rotation`` are its position
    and rotation at ``time``; otherwise all three are absent, and those of the observation are valid for every frame.

    In part_3, ``moved`` lists all objects that move, whether they sound or not, and is absent if none does; a source is
    carried by its instance (`ObservationRecord.source_at`). ``audible`` lists the audible sources; ``azimuth``,
    ``elevation``, ``distance`` and ``line_of_sight`` are those of the first source of the observation, and null where
    it has none.
    """

    moving: ClassVar[frozenset[str]] = frozenset({"source_position", "instance_position", "instance_rotation"})
    left_out: ClassVar[frozenset[str]] = moving | {"moved", "audible"}

    name: FrameName
    time: NonNegative = Field(description="seconds from the start; the clip covers [time, time + 1)")
    position: Vector3 = Field(description="position of the sensor in the world, metres")
    rotation: Quaternion = Field(description="camera-to-world (w, x, y, z); the camera looks down −Z")
    visible_pixels: Annotated[int, Field(ge=0)] = Field(description="pixels that the mask of this frame marks")
    azimuth: Annotated[float, Field(ge=-180, le=180)] | None = Field(
        description="azimuth of the source, degrees; 0 ahead, positive to the right"
    )
    elevation: Annotated[float, Field(ge=-90, le=90)] | None = Field(
        description="elevation of the source, degrees; positive up"
    )
    distance: NonNegative | None = Field(description="distance to the source, metres")
    line_of_sight: bool | None = Field(description="whether nothing is between sensor and source")
    rms_left: NonNegative
    rms_right: NonNegative
    source_position: Vector3 | None = Field(
        default=None, description="position of the source at this time in the world, metres; only if it moves"
    )
    instance_position: Vector3 | None = Field(
        default=None, description="origin of the sounding instance at this time in the world, metres; only if it moves"
    )
    instance_rotation: Quaternion | None = Field(
        default=None, description="model-to-world (w, x, y, z) of the sounding instance at this time; only if it moves"
    )
    moved: Annotated[tuple[MovedRecord, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="the objects that move, in the order of their ids; only in part_3; absent if none does",
    )
    audible: tuple[AudibleRecord, ...] | None = Field(
        default=None, description="the audible sources in the order of their ids; only in part_3"
    )

    _of_first_source: ClassVar[tuple[str, ...]] = ("azimuth", "elevation", "distance", "line_of_sight")

    @property
    def pose(self) -> Pose:
        """The sensor's camera-to-world pose."""
        return Pose(self.position, self.rotation)

    @model_validator(mode="after")
    def _check(self) -> Self:
        moving = [getattr(self, name) is not None for name in sorted(self.moving)]
        if any(moving) and not all(moving):
            raise ValueError(f"{', '.join(sorted(self.moving))} belong together: expected all three or none")
        first = [getattr(self, name) is not None for name in self._of_first_source]
        if any(first) and not all(first):
            raise ValueError(f"{', '.join(self._of_first_source)} belong together: expected all or none of them")
        return self


class ObservationRecord(Record):
    """`observation.json`: one observation with all its frames and files."""

    part_3_fields: ClassVar[tuple[str, ...]] = ("sources", "background", "group")
    left_out: ClassVar[frozenset[str]] = frozenset(
        {"variant_of", "source_motion", "sizes", "categories", "device", "options", "top_view", *part_3_fields}
    )

    schema_version: Literal["1.0", "1.1"] = Field(
        default="1.0", description="1.1 in part_3 and with categories of the manifest's own, else 1.0"
    )
    key: Text
    part: Part
    scan: Scan
    room: Room
    index: Annotated[int, Field(ge=1)]
    categories: tuple[Category, ...] | None = Field(
        default=None,
        description="categories that the manifest adds, in the order of their class ids, which follow the seven of "
        "the paper; absent if there are none",
    )
    category: Category | None = Field(
        description="category of the sounding instance; in part_3 that of the first source, null if there is none"
    )
    seed: Annotated[int, Field(ge=0)]
    plan_sha256: Sha256 | None = Field(
        default=None,
        description="sha256 of all that these bytes depend on; a rerun keeps the observation if it is equal",
    )
    notes: tuple[str, ...] = Field(default=(), description="constraints that were relaxed, e.g. twins closer than 1 m")
    variant_of: Text | None = Field(
        default=None,
        description="key of the observation from which this one differs only in its acoustics, in part_3 also in "
        "its background",
    )
    source_motion: Literal["path"] | None = Field(
        default=None, description="path: the sounding object moves (see frames); absent if it does not move"
    )
    source_position: Vector3 | None = Field(
        description="position of the source in the world, metres; if it moves, at the first frame; in part_3 that of "
        "the first source, null if there is none"
    )
    sources: tuple[SourceRecord, ...] | None = Field(default=None, description="the sources; only in part_3")
    background: BackgroundRecord | None = Field(default=None, description="only in part_3; null if there is none")
    group: Text | None = Field(
        default=None,
        description="only in part_3: key of the observation whose pictures this one has; its own if it is the first",
    )
    intrinsics: IntrinsicsRecord
    instances: Annotated[tuple[InstanceRecord, ...], Field(min_length=1)]
    sound: SoundRecord | None = None
    acoustics: AcousticsRecord
    vision: VisionRecord
    device: DeviceRecord | None = Field(
        default=None, description="what baked the light and traced the sound; absent: the CPU"
    )
    options: dict[str, Scalar] | None = Field(
        default=None, description="further options of `avs3d generate` on which the bytes depend; absent: the defaults"
    )
    top_view: TopViewRecord | None = Field(
        default=None, description="area that `top_view.png` shows; absent outside of scans, which have no such picture"
    )
    frames: Annotated[tuple[FrameRecord, ...], Field(min_length=1, max_length=layout.MAX_FRAMES)]
    files: dict[RelativePath, Sha256] = Field(description="sha256 of every file beside observation.json")
    sizes: dict[RelativePath, Annotated[int, Field(ge=0)]] | None = Field(
        default=None, description="size in bytes of every file in `files`; absent in datasets of older versions"
    )

    def omitted(self) -> frozenset[str]:
        """The fields that are not written if they are None; a part_3 observation says that it has no background."""
        return self.left_out - {"background"} if self.is_part_3 else self.left_out

    @property
    def made_with(self) -> tuple[tuple[str, str], ...]:
        """(name, version) of renderer, acoustic engine and any device; dataset.json has them in ``backends``."""
        engines = ((self.vision.backend, self.vision.version), (self.acoustics.backend, self.acoustics.version))
        return (*engines, (f"device {self.device.name}", self.device.version)) if self.device else engines

    @property
    def is_part_3(self) -> bool:
        """Whether this is an observation of part_3."""
        return self.part == PART_3

    @property
    def sounding(self) -> InstanceRecord:
        """The instance that sounds, of an observation in which exactly one does.

        Raises:
            Avs3dError: if none or several do, as in part_3 (see `sounding_instances`).
        """
        found = self.sounding_instances
        if len(found) != 1:
            raise Avs3dError(f"{self.key}: {len(found)} instances sound; expected exactly one")
        return found[0]

    @property
    def sounding_instances(self) -> tuple[InstanceRecord, ...]:
        """The instances that sound at some time, in the order of the file."""
        return tuple(instance for instance in self.instances if instance.sounding)

    @property
    def class_ids(self) -> dict[str, int]:
        """Category → its value in category_masks; see `avs3d_bench.contract.taxonomy.class_ids`."""
        return class_ids(self.categories or ())

    @property
    def attributions(self) -> tuple[AttributionRecord, ...]:
        """Every asset that is seen or heard, with its licence; several times if it is there several times."""
        used = [(instance.asset, instance.licence) for instance in self.instances]
        if self.sound is not None:
            used.append((self.sound.asset, self.sound.licence))
        used += [(source.asset, source.licence) for source in self.sources or ()]
        directivities = [source.directivity for source in self.sound_sources]
        used += [(each.name, each.licence) for each in directivities if each is not None and each.licence is not None]
        found = [AttributionRecord(asset=asset, **licence.model_dump()) for asset, licence in used]
        return tuple(found if self.acoustics.hrtf is None else [*found, self.acoustics.hrtf.attribution])

    @property
    def sound_sources(self) -> tuple[SourceRecord, ...]:
        """The sources of an observation of any part; in part_1 and part_2 one that sounds all the time.

        Its position is that at the first frame, if it moves (see `source_at`).
        """
        return (self._only_source,) if self.sources is None else self.sources

    @property
    def _only_source(self) -> SourceRecord:
        """What part_1 and part_2 say of their source in other fields, as part_3 would say it."""
        instance, sound = self.sounding, self.sound
        return SourceRecord(
            id="source_1",
            instance=instance.id,
            category=instance.category,
            room=self.room,
            position=instance.position if self.source_position is None else self.source_position,
            programme=((EARLIEST_START, len(self.frames) / layout.FRAME_RATE),),
            gain_db=(sound and sound.gain_db) or 0.0,
            asset=sound.asset if sound else "not recorded",
            licence=sound.licence if sound else instance.licence,
            directivity=sound.directivity if sound else None,
        )

    @property
    def first_instance(self) -> InstanceRecord | None:
        """The instance of the first source, whose direction the frames have; None if there is none in the room."""
        numbers = {source.instance for source in self.sound_sources[:1]}
        return next((instance for instance in self.instances if instance.id in numbers), None)

    def source(self, name: str) -> SourceRecord:
        """The source of that id.

        Raises:
            Avs3dError: if there is none.
        """
        for source in self.sound_sources:
            if source.id == name:
                return source
        raise Avs3dError(f"{self.key}: no source {name!r}; it has {len(self.sound_sources)}")

    def audible_sources(self, frame: FrameRecord) -> tuple[SourceRecord, ...]:
        """The sources that are audible in ``frame``; in part_1 and part_2 the one source, in every frame."""
        if frame.audible is None:
            return self.sound_sources
        return tuple(self.source(entry.source) for entry in frame.audible)

    def audible_instances(self, frame: FrameRecord) -> tuple[int, ...]:
        """Ids of the instances that are audible in ``frame``, sorted; the mask marks their visible pixels."""
        heard = (source.instance for source in self.audible_sources(frame))
        return tuple(sorted({number for number in heard if number is not None}))

    @property
    def moves(self) -> bool:
        """Whether any object moves."""
        return bool(self.moving_instances)

    @property
    def moving_instances(self) -> tuple[int, ...]:
        """Ids of the instances that move, sorted: in part_1 and part_2 of the one that sounds at most."""
        if self.is_part_3:
            return tuple(one.instance for one in self.frames[0].moved or ())
        return () if self.source_motion is None else (self.sounding.id,)

    def source_moves(self, source: SourceRecord) -> bool:
        """Whether the instance of one of `sound_sources` moves."""
        return source.instance in self.moving_instances

    def instance(self, number: int) -> InstanceRecord:
        """The instance of that id.

        Raises:
            Avs3dError: if there is none.
        """
        for instance in self.instances:
            if instance.id == number:
                return instance
        raise Avs3dError(f"{self.key}: no instance {number}; it has {len(self.instances)}")

    def pose_at(self, frame: FrameRecord, number: int) -> Pose:
        """The model-to-world pose of an instance at the time of ``frame``.

        Raises:
            Avs3dError: if there is no instance of that id.
        """
        for moved in frame.moved or ():
            if moved.instance == number:
                return moved.pose
        own = self.instance(number)
        if frame.instance_position is not None and frame.instance_rotation is not None and own.sounding:
            return Pose(frame.instance_position, frame.instance_rotation)
        return Pose(own.position, own.rotation)

    def source_at(self, frame: FrameRecord, source: SourceRecord | None = None) -> Vector3:
        """Position of a source in the world at the time of ``frame``, metres.

        Args:
            frame: one of the observation's.
            source: one of `sound_sources`; None: the first.

        Raises:
            Avs3dError: if there is no source.
        """
        if frame.source_position is not None:
            return frame.source_position
        if source is None and self.source_position is None:
            raise Avs3dError(f"{self.key}: there is no source, so that it has no position")
        chosen = source or self.sound_sources[0]
        if chosen.instance is None or not self.source_moves(chosen):
            return chosen.position
        x, y, z = self.to_frame(frame, [chosen.position], chosen.instance)[0].tolist()
        return x, y, z

    def to_frame(
        self, frame: FrameRecord, points: ArrayLike, instances: int | NDArray[np.integer] | None = None
    ) -> NDArray[np.float64]:
        """Points of instances at the first frame, as in `gt_3d`, moved to the time of ``frame``.

        Args:
            frame: one of the observation's.
            points: (N, 3) metres, world.
            instances: id of the instance that the points are of, or (N,) that of each; None: the only one that sounds.

        Returns:
            (N, 3) metres, world.

        Raises:
            Avs3dError: if there is no instance of an id, or several sound and none is named.
        """
        found = np.array(points, dtype=np.float64)
        each = np.broadcast_to(self.sounding.id if instances is None else instances, found.shape[:1])
        for number in self.moving_instances:
            own, start = each == number, self.instance(number)
            local = Pose(start.position, start.rotation).to_camera(found[own])
            found[own] = self.pose_at(frame, number).to_world(local)
        return found

    def middle_at(self, frame: FrameRecord, instance: InstanceRecord) -> Vector3:
        """The middle of the bounds of an instance, moved to the time of ``frame``; metres, world."""
        x, y, z = self.to_frame(frame, [np.mean(instance.bounds, axis=0)], instance.id)[0].tolist()
        return x, y, z

    @model_validator(mode="after")
    def _check(self) -> Self:
        place = layout.ObservationKey(self.part, self.scan, self.room, self.index)
        if self.key != str(place):
            raise ValueError(f"key {self.key!r} does not fit part, scan, room and index: expected {place}")
        ids = [instance.id for instance in self.instances]
        if len(set(ids)) != len(ids):
            raise ValueError(f"instance ids {ids} are not unique")
        self._check_categories()
        if self.is_part_3:
            self._check_part_3()
        else:
            self._check_one_source()
        for position, frame in enumerate(self.frames):
            if frame.name != layout.frame_name(position):
                raise ValueError(f"frames[{position}].name is {frame.name}, expected {layout.frame_name(position)}")
        if any(a.time >= b.time for a, b in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("frame times do not increase")
        if self.sizes is not None and self.sizes.keys() != self.files.keys():
            raise ValueError("sizes and files do not name the same files")
        self._check_motion()
        return self

    def _check_motion(self) -> None:
        path = self.source_motion is not None
        moving = self.moving_instances if self.is_part_3 else ()
        if list(moving) != sorted({*moving} & {instance.id for instance in self.instances}):
            raise ValueError(f"{self.frames[0].name}: moved names {moving}; expected ids of instances, sorted")
        for frame in self.frames:
            if (frame.source_position is not None) != path:
                found = "missing, but source_motion is path" if path else "given, but source_motion is not"
                raise ValueError(f"{frame.name}: source_position is {found}")
            found_moving = tuple(one.instance for one in frame.moved or ())
            if found_moving != moving:
                raise ValueError(f"{frame.name}: moved names {found_moving}, expected {moving}")

    def _check_categories(self) -> None:
        own = self.categories or ()
        sound = {*CATEGORIES, *own}
        if len(sound) != len(CATEGORIES) + len(own) or OVEN in own:
            raise ValueError(f"categories {own}: expected new names, each once")
        sources = self.sources or ()
        away = {source.category for source in sources if source.instance is None}
        here = {source.category for source in sources if source.instance is not None}
        if not self.is_part_3 and self.category is not None:
            here.add(self.category)  # in part_3 it is that of the first source
        objects = {instance.category for instance in self.instances}
        for found, known in (
            (objects, sound | {*DISTRACTORS}),
            (away, sound | {*OFF_SCREEN_CATEGORIES}),
            (here, sound),
        ):
            if found - known:
                raise ValueError(f"unknown category {min(found - known)!r}; expected one of {', '.join(sorted(known))}")
        version = PART_3_VERSION if self.is_part_3 or own else SCHEMA_VERSION
        if self.schema_version != version:
            raise ValueError(f"schema_version is {self.schema_version}, expected {version}")

    def _check_one_source(self) -> None:
        """Check the rules of part_1 and part_2: one source, an instance of the room, that sounds all the time."""
        given = [name for name in self.part_3_fields if getattr(self, name) is not None]
        if given:
            raise ValueError(f"{given[0]} belongs to part_3, but part is {self.part}")
        if self.category is None or self.source_position is None:
            raise ValueError(f"category and source_position are missing; {self.part} has one source")
        sounding = self.sounding_instances
        if len(sounding) != 1:
            raise ValueError(f"{len(sounding)} instances are sounding, expected exactly one")
        if sounding[0].category != self.category:
            raise ValueError(f"the sounding instance is a {sounding[0].category}, but category is {self.category}")
        twins = sum(instance.category == self.category for instance in self.instances)
        if (twins == 1) != (self.part == "part_1"):
            expected = "exactly one (single-instance)" if self.part == "part_1" else "several (multi-instance)"
            raise ValueError(f"{twins} instances of {self.category} in {self.part}, expected {expected}")
        for frame in self.frames:
            if frame.azimuth is None or frame.audible is not None:
                raise ValueError(f"{frame.name}: expected azimuth, elevation, distance and line_of_sight, no audible")

    def _check_part_3(self) -> None:
        """Check the rules of part_3."""
        if self.sources is None or self.group is None:
            raise ValueError("sources or group is missing; an observation of part_3 has both")
        names = [source.id for source in self.sources]
        if names != [f"source_{number}" for number in range(1, len(names) + 1)]:
            raise ValueError(f"ids of the sources are {names}, expected source_1, source_2, …")
        place = layout.parse_key(self.group)
        if (place.part, place.scan, place.room) != (self.part, self.scan, self.room):
            raise ValueError(f"group {self.group} is not in the same part, scan and room")
        if self.variant_of is not None and self.variant_of.rpartition("/")[0] != self.key.rpartition("/")[0]:
            raise ValueError(f"variant_of {self.variant_of} is not in the same part, scan and room")
        first = self.sources[0] if self.sources else None
        if self.category != (first and first.category) or self.source_position != (first and first.position):
            raise ValueError("category and source_position are not those of the first source")
        if self.source_motion is not None or self.sound is not None:
            raise ValueError("source_motion and sound belong to part_1 and part_2")
        known = {instance.id: instance.category for instance in self.instances}
        for source in self.sources:
            if source.instance is None:
                if source.room == self.room:
                    raise ValueError(f"{source.id} is off-screen, but in the observation's own room {self.room}")
            elif known.get(source.instance) != source.category or source.room != self.room:
                raise ValueError(
                    f"{source.id}: instance {source.instance} is no {source.category} of the {self.room}; "
                    f"instances: {known}"
                )
        heard = {source.instance for source in self.sources}
        for instance in self.instances:
            if instance.sounding != (instance.id in heard):
                raise ValueError(f"instance {instance.id}: sounding is {instance.sounding}, but sources say otherwise")
        for frame in self.frames:
            if frame.audible is None or (frame.azimuth is None) != (first is None):
                raise ValueError(
                    f"{frame.name}: expected audible, and the direction of the first source if there is one"
                )
            order = [entry.source for entry in frame.audible]
            if order != [name for name in names if name in order]:
                raise ValueError(f"{frame.name}: audible names {order}; expected some of {names}, in this order")


class CameraSplits(Record):
    """`camera_splits.json`: file names, without extension, of the train and test frames."""

    train: tuple[FrameName, ...]
    test: tuple[FrameName, ...]

    @classmethod
    def of(cls, frames: int) -> Self:
        """The split of an observation with ``frames`` frames: every eighth of the sorted names is test."""
        train, test = layout.split_names(layout.frame_name(index) for index in range(frames))
        return cls(train=train, test=test)
