"""The records behind every JSON file of the contract (pydantic v2, frozen, unknown keys refused, numbers finite).

| file                 | record              |
|----------------------|---------------------|
| `dataset.json`       | `DatasetRecord`     |
| `observation.json`   | `ObservationRecord` |
| `camera_splits.json` | `CameraSplits`      |
| `submission.json`    | `SubmissionRecord`  |

Units: metres, seconds, degrees, pixels. World: right-handed, Y up; quaternions are (w, x, y, z), camera-to-world for
frames and object-to-world for instances. avs3d_bench/scores.py has the record of a file of scores,
avs3d_bench/schema_files.py writes the JSON Schema of each file.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from avs3d_bench import __version__, layout
from avs3d_bench.errors import Avs3dError
from avs3d_bench.geometry import Intrinsics, Pose
from avs3d_bench.text import printable

if TYPE_CHECKING:
    from avs3d_bench.provenance import Provenance

#: Version of the file formats; it changes when a key changes its name or its meaning.
SCHEMA_VERSION = "1.0"

Part = Literal["part_1", "part_2"]
Room = Literal["bathroom", "kitchen", "living_room"]
Category = Literal["washing_machine", "toilet", "vacuum_cleaner", "microwave", "coffee_machine", "clock", "telephone"]
InstanceCategory = Literal[
    "washing_machine", "toilet", "vacuum_cleaner", "microwave", "coffee_machine", "clock", "telephone", "oven"
]
Scalar = bool | int | float | str | None
Text = Annotated[str, Field(min_length=1)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Scan = Annotated[str, Field(pattern=layout.SCAN_PATTERN)]
FrameName = Annotated[str, Field(pattern=layout.FRAME_PATTERN)]
Vector3 = tuple[float, float, float]
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]


def _unit(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    norm = math.sqrt(sum(c * c for c in q))
    if abs(norm - 1.0) > 1e-4:
        raise ValueError(f"norm {norm:.6f}, expected a unit quaternion (w, x, y, z)")
    return q


def _relative(path: str) -> str:
    if not path or path.startswith("/") or "\\" in path or any(p in ("", ".", "..") for p in path.split("/")):
        raise ValueError(f"{path!r} is not a relative path with forward slashes")
    if any(ord(character) < ord(" ") for character in path):
        raise ValueError(f"{path!r} holds a control character; expected a relative path")
    return path


Quaternion = Annotated[tuple[float, float, float, float], AfterValidator(_unit)]
RelativePath = Annotated[str, AfterValidator(_relative)]


class Record(BaseModel):
    """Base of all records.

    Fields named in ``left_out`` are not written where they are None: files without them keep their bytes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    left_out: ClassVar[frozenset[str]] = frozenset()


class LicenceRecord(Record):
    """Where an asset comes from and what may be done with it."""

    name: Text = Field(description="licence, SPDX identifier where there is one")
    author: Text
    source: Text = Field(description="URL, collection and id, or 'procedural'")


class AttributionRecord(LicenceRecord):
    """One asset that the dataset holds, with its licence."""

    asset: Text


class ProvenanceRecord(Record):
    """The software that made a file, see `avs3d_bench.provenance`."""

    digest: Sha256 = Field(description="of the sources, libraries and Python that the result depends on")
    toolkit_version: Text
    python: Text = Field(description="minor version, e.g. 3.11")
    libraries: dict[str, Text] = Field(default_factory=dict, description="distribution → version; none: not installed")

    @classmethod
    def of(cls, software: Provenance) -> Self:
        """The record of what `avs3d_bench.provenance.provenance` found."""
        return cls(
            digest=software.digest,
            toolkit_version=__version__,
            python=software.python,
            libraries=dict(software.libraries),
        )


class IntrinsicsRecord(Record):
    """Pinhole camera without distortion, pixels; the centre of pixel (u, v) lies at (u + 0.5, v + 0.5)."""

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


class InstanceRecord(Record):
    """One placed object. Its id is its value in `instance_masks/`; 0 there is the scan.

    Of a moving source, ``position``, ``rotation`` and ``bounds`` are those at the first frame.
    """

    id: Annotated[int, Field(ge=1, le=65535)]
    category: InstanceCategory
    sounding: bool
    position: Vector3 = Field(description="origin of the model in the world, metres")
    rotation: Quaternion = Field(description="model-to-world (w, x, y, z)")
    bounds: tuple[Vector3, Vector3] = Field(description="lowest and highest corner in the world, metres")
    asset: Text = Field(description="which model, e.g. 'procedural:clock/round'")
    licence: LicenceRecord

    @model_validator(mode="after")
    def _check(self) -> Self:
        if any(low > high for low, high in zip(*self.bounds, strict=True)):
            raise ValueError(f"bounds {self.bounds}: the lowest corner comes first")
        return self


class SoundRecord(Record):
    """The recording or synthesis that the sounding instance plays."""

    asset: Text
    licence: LicenceRecord


class AcousticsRecord(Record):
    """How the clips were made."""

    backend: Text
    version: Text
    sample_rate: Annotated[int, Field(gt=0)]
    gain: Positive = Field(description="the one factor applied to every clip of the observation")
    settings: dict[str, Scalar] = Field(default_factory=dict, description="rays, depth, … of the backend")
    t30: Positive | None = Field(default=None, description="reverberation time of the room, seconds (ISO 3382-2)")
    notes: str = ""


class VisionRecord(Record):
    """What rendered the pictures."""

    backend: Text
    version: Text


class FrameRecord(Record):
    """One frame: where the agent's sensor was, what it saw and heard.

    Where the sounding object moves, ``source_position``, ``instance_position`` and ``instance_rotation`` say where it
    is at ``time``; elsewhere all three are absent, and the observation's own hold for every frame.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"source_position", "instance_position", "instance_rotation"})

    name: FrameName
    time: NonNegative = Field(description="seconds from the start; the clip covers [time, time + 1)")
    position: Vector3 = Field(description="sensor in the world, metres")
    rotation: Quaternion = Field(description="camera-to-world (w, x, y, z); the camera looks down −Z")
    visible_pixels: Annotated[int, Field(ge=0)] = Field(description="pixels of the sounding instance in this frame")
    azimuth: Annotated[float, Field(ge=-180, le=180)] = Field(description="of the source; 0 ahead, positive right")
    elevation: Annotated[float, Field(ge=-90, le=90)] = Field(description="of the source; positive up")
    distance: NonNegative = Field(description="to the source, metres")
    line_of_sight: bool = Field(description="nothing stands between sensor and source")
    rms_left: NonNegative
    rms_right: NonNegative
    source_position: Vector3 | None = Field(
        default=None, description="where the sound comes from at this time, world, metres; only if the source moves"
    )
    instance_position: Vector3 | None = Field(
        default=None, description="origin of the sounding instance at this time; only if the source moves"
    )
    instance_rotation: Quaternion | None = Field(
        default=None, description="model-to-world (w, x, y, z) at this time; only if the source moves"
    )

    @property
    def pose(self) -> Pose:
        """The sensor's camera-to-world pose."""
        return Pose(self.position, self.rotation)

    @property
    def instance_pose(self) -> Pose | None:
        """The sounding instance's model-to-world pose at this time; None where it does not move."""
        if self.instance_position is None or self.instance_rotation is None:
            return None
        return Pose(self.instance_position, self.instance_rotation)

    @model_validator(mode="after")
    def _check(self) -> Self:
        moving = [getattr(self, name) is not None for name in sorted(self.left_out)]
        if any(moving) and not all(moving):
            raise ValueError(f"{', '.join(sorted(self.left_out))} belong together: expected all three or none")
        return self


class ObservationRecord(Record):
    """`observation.json`."""

    left_out: ClassVar[frozenset[str]] = frozenset({"variant_of", "source_motion", "sizes"})

    schema_version: Literal["1.0"] = "1.0"
    key: Text
    part: Part
    scan: Scan
    room: Room
    index: Annotated[int, Field(ge=1)]
    category: Category = Field(description="of the sounding instance")
    seed: Annotated[int, Field(ge=0)]
    plan_sha256: Sha256 | None = Field(
        default=None, description="of everything that decided these bytes; a rerun reuses it"
    )
    notes: tuple[str, ...] = Field(default=(), description="what could not be had as asked, e.g. twins closer than 1 m")
    variant_of: Text | None = Field(
        default=None, description="key of the observation that differs in its acoustics alone; only of a variant"
    )
    source_motion: Literal["path"] | None = Field(
        default=None, description="path: the sounding object moves, see frames; absent where it stands still"
    )
    source_position: Vector3 = Field(
        description="where the sound comes from, world, metres; of a moving source, at the first frame"
    )
    intrinsics: IntrinsicsRecord
    instances: Annotated[tuple[InstanceRecord, ...], Field(min_length=1)]
    sound: SoundRecord | None = None
    acoustics: AcousticsRecord
    vision: VisionRecord
    frames: Annotated[tuple[FrameRecord, ...], Field(min_length=1, max_length=layout.MAX_FRAMES)]
    files: dict[RelativePath, Sha256] = Field(description="sha256 of every file beside observation.json")
    sizes: dict[RelativePath, Annotated[int, Field(ge=0)]] | None = Field(
        default=None, description="bytes of every file in files; absent in trees of older versions"
    )

    @property
    def sounding(self) -> InstanceRecord:
        """The instance that sounds."""
        return next(instance for instance in self.instances if instance.sounding)

    @property
    def moves(self) -> bool:
        """Whether the sounding object moves."""
        return self.source_motion is not None

    def source_at(self, frame: FrameRecord) -> Vector3:
        """Where the sound comes from at the time of ``frame``, world, metres."""
        return frame.source_position or self.source_position

    def to_frame(self, frame: FrameRecord, points: ArrayLike) -> NDArray[np.float64]:
        """Points of the sounding instance as `gt_3d` has them, (N, 3) at the first frame, at the time of ``frame``."""
        first, now = Pose(self.sounding.position, self.sounding.rotation), frame.instance_pose
        if now is None:
            return np.asarray(points, dtype=np.float64)
        local = first.to_camera(points)
        return np.asarray(local @ now.rotation_matrix.T + np.asarray(now.position))

    @model_validator(mode="after")
    def _check(self) -> Self:
        place = layout.ObservationKey(self.part, self.scan, self.room, self.index)
        if self.key != str(place):
            raise ValueError(f"key {self.key!r} does not fit part, scan, room and index: expected {place}")
        sounding = [instance for instance in self.instances if instance.sounding]
        if len(sounding) != 1:
            raise ValueError(f"{len(sounding)} instances are sounding, expected exactly one")
        if sounding[0].category != self.category:
            raise ValueError(f"the sounding instance is a {sounding[0].category}, but category is {self.category}")
        ids = [instance.id for instance in self.instances]
        if len(set(ids)) != len(ids):
            raise ValueError(f"instance ids {ids} are not unique")
        twins = sum(instance.category == self.category for instance in self.instances)
        if (twins == 1) != (self.part == "part_1"):
            expected = "exactly one (single-instance)" if self.part == "part_1" else "several (multi-instance)"
            raise ValueError(f"{twins} instances of {self.category} in {self.part}, expected {expected}")
        for position, frame in enumerate(self.frames):
            if frame.name != layout.frame_name(position):
                raise ValueError(f"frames[{position}].name is {frame.name}, expected {layout.frame_name(position)}")
        if any(a.time >= b.time for a, b in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("frame times do not increase")
        if self.sizes is not None and self.sizes.keys() != self.files.keys():
            raise ValueError("sizes and files do not name the same files")
        for frame in self.frames:
            if (frame.source_position is not None) != self.moves:
                found = "missing, but source_motion is path" if self.moves else "given, but source_motion is not"
                raise ValueError(f"{frame.name}: source_position is {found}")
        return self


class CameraSplits(Record):
    """`camera_splits.json`: names of the image frames, without extension."""

    train: tuple[FrameName, ...]
    test: tuple[FrameName, ...]

    @classmethod
    def of(cls, frames: int) -> Self:
        """The split of an observation with ``frames`` frames: every eighth of the sorted names is test."""
        train, test = layout.split_names(layout.frame_name(index) for index in range(frames))
        return cls(train=train, test=test)


class DatasetEntry(Record):
    """One observation in `dataset.json`."""

    key: Text
    category: Category
    part: Part
    scan: Scan
    room: Room
    digest: Sha256 = Field(description="sha256 of the observation's observation.json")

    @classmethod
    def of(cls, record: ObservationRecord, digest: str) -> Self:
        """The entry of an observation; ``digest`` is the sha256 of its observation.json."""
        return cls(
            key=record.key,
            category=record.category,
            part=record.part,
            scan=record.scan,
            room=record.room,
            digest=digest,
        )


class DatasetRecord(Record):
    """`dataset.json`. It holds no time stamp: the same manifest and backends give the same bytes.

    ``digest`` covers all other fields, the free text too. It finds damage; it cannot find an edit by someone who
    computes it again.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"digest", "provenance"})

    schema_version: Literal["1.0"] = "1.0"
    name: Text
    version: Text
    toolkit_version: Text
    created_by: str | None = None
    manifest: str = Field(description="the manifest, verbatim")
    manifest_sha256: Sha256 = Field(description="sha256 of the manifest's UTF-8 bytes")
    backends: dict[str, Text] = Field(description="backend name → version")
    licence: Text
    attributions: tuple[AttributionRecord, ...] = ()
    provenance: ProvenanceRecord | None = Field(default=None, description="software that made the observations")
    observations: tuple[DatasetEntry, ...]
    digest: Sha256 | None = Field(
        default=None, description="sha256 of all other fields as canonical JSON; absent in trees of older versions"
    )

    def contents_digest(self) -> str:
        """The sha256 that `digest` should have.

        Canonical JSON: keys sorted, no spaces, ASCII with escapes, fields that are null left out.
        """
        fields = self.model_dump(mode="json", exclude={"digest"}, exclude_none=True)
        text = json.dumps(fields, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def sealed(self) -> Self:
        """This record with its digest."""
        return self.model_copy(update={"digest": self.contents_digest()})

    @model_validator(mode="after")
    def _check(self) -> Self:
        if hashlib.sha256(self.manifest.encode()).hexdigest() != self.manifest_sha256:
            raise ValueError("manifest_sha256 is not the sha256 of manifest")
        keys = [entry.key for entry in self.observations]
        if keys != sorted(set(keys)):
            raise ValueError("observations are not sorted by key, or a key is listed twice")
        for entry in self.observations:
            head = f"{entry.part}/{entry.scan}/{entry.room}/"
            if not (entry.key.startswith(head) and entry.key[len(head) :].isdigit()):
                raise ValueError(f"key {entry.key!r} does not fit its part, scan and room: expected {head}<index>")
        return self


class SubmissionRecord(Record):
    """`submission.json`."""

    left_out: ClassVar[frozenset[str]] = frozenset({"provenance", "truth"})

    method: Text
    dataset: Text
    dataset_version: Text
    url: str | None = None
    authors: str | tuple[str, ...] | None = None
    notes: str | None = None
    runtime: float | str | dict[str, Scalar] | None = None
    truth: Text | None = Field(
        default=None,
        description="the ground truth that the masks were made from, e.g. 'masks of test frames'; absent: none. "
        "A submission with it is shown on leaderboards, and not ranked",
    )
    provenance: ProvenanceRecord | None = Field(
        default=None, description="software that made the masks; only of the baselines of this toolkit"
    )


_R = TypeVar("_R", bound=Record)
#: Longest message on a finding (characters): a wrong value may be as long as the file.
_LONGEST_LINE = 1000


def describe(error: ValidationError) -> list[str]:
    """One line per finding of pydantic: ``frames.3.rotation: …``."""
    lines = []
    for finding in error.errors(include_url=False):
        where = ".".join(str(step) for step in finding["loc"])
        message = finding["msg"].removeprefix("Value error, ")
        value = repr(finding.get("input"))
        found = f" (found {value})" if len(value) <= 60 and finding["type"] != "missing" else ""
        line = printable(f"{where}: {message}{found}" if where else f"{message}")
        lines.append(line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}…")
    return lines


def parse_record(text: str | bytes, record: type[_R], where: str | Path) -> _R:
    """Parse the JSON ``text`` of the file ``where``.

    Raises:
        Avs3dError: naming the file, the first wrong field and how many more there are.
    """
    try:
        return record.model_validate_json(text)
    except ValidationError as error:
        first, *rest = describe(error)
        more = f" (and {len(rest)} more)" if rest else ""
        raise Avs3dError(f"{where}: {first}{more}; expected a {record.__name__} (see `avs3d schema`)") from None


def unique_attributions(attributions: Iterable[AttributionRecord]) -> tuple[AttributionRecord, ...]:
    """Sorted, each asset once."""
    found = {(a.asset, a.name, a.author, a.source): a for a in attributions}
    return tuple(found[key] for key in sorted(found))
