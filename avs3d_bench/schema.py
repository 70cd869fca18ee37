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

    Fields named in ``left_out`` are not written if they are None, so that files of older versions keep their bytes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    left_out: ClassVar[frozenset[str]] = frozenset()


class LicenceRecord(Record):
    """Licence, author and source of an asset."""

    name: Text = Field(description="licence: SPDX identifier if there is one")
    author: Text
    source: Text = Field(description="URL, collection and id, or 'procedural'")


class AttributionRecord(LicenceRecord):
    """One asset in the dataset, with its licence."""

    asset: Text


class ProvenanceRecord(Record):
    """The software that made a file; see `avs3d_bench.provenance`."""

    digest: Sha256 = Field(description="digest of the sources, libraries and Python on which the result depends")
    toolkit_version: Text
    python: Text = Field(description="minor version, e.g. 3.11")
    libraries: dict[str, Text] = Field(
        default_factory=dict, description="distribution → version; 'none' if not installed"
    )

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


class InstanceRecord(Record):
    """One placed object. Its id is its pixel value in `instance_masks/`, where 0 is the home.

    For a moving object, ``position``, ``rotation`` and ``bounds`` are those at the first frame.
    """

    id: Annotated[int, Field(ge=1, le=65535)]
    category: InstanceCategory
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


class SoundRecord(Record):
    """The recording or synthesis that the sounding instance plays."""

    asset: Text
    licence: LicenceRecord


class AcousticsRecord(Record):
    """The acoustic simulation that made the clips."""

    backend: Text
    version: Text
    sample_rate: Annotated[int, Field(gt=0)]
    gain: Positive = Field(description="factor applied to all clips of the observation")
    settings: dict[str, Scalar] = Field(
        default_factory=dict, description="settings of the backend: number of rays, depth, …"
    )
    t30: Positive | None = Field(default=None, description="reverberation time of the room, seconds (ISO 3382-2)")
    notes: str = ""


class VisionRecord(Record):
    """The renderer of the pictures."""

    backend: Text
    version: Text


class FrameRecord(Record):
    """One frame: the pose of the agent's sensor, and the visibility and direction of the source.

    If the sounding object moves, ``source_position``, ``instance_position`` and ``instance_rotation`` are its position
    and rotation at ``time``; otherwise all three are absent, and those of the observation are valid for every frame.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"source_position", "instance_position", "instance_rotation"})

    name: FrameName
    time: NonNegative = Field(description="seconds from the start; the clip covers [time, time + 1)")
    position: Vector3 = Field(description="position of the sensor in the world, metres")
    rotation: Quaternion = Field(description="camera-to-world (w, x, y, z); the camera looks down −Z")
    visible_pixels: Annotated[int, Field(ge=0)] = Field(description="pixels of the sounding instance in this frame")
    azimuth: Annotated[float, Field(ge=-180, le=180)] = Field(
        description="azimuth of the source, degrees; 0 ahead, positive to the right"
    )
    elevation: Annotated[float, Field(ge=-90, le=90)] = Field(
        description="elevation of the source, degrees; positive up"
    )
    distance: NonNegative = Field(description="distance to the source, metres")
    line_of_sight: bool = Field(description="whether nothing is between sensor and source")
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

    @property
    def pose(self) -> Pose:
        """The sensor's camera-to-world pose."""
        return Pose(self.position, self.rotation)

    @property
    def instance_pose(self) -> Pose | None:
        """The sounding instance's model-to-world pose at this time; None if it does not move."""
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
    """`observation.json`: one observation with all its frames and files."""

    left_out: ClassVar[frozenset[str]] = frozenset({"variant_of", "source_motion", "sizes"})

    schema_version: Literal["1.0"] = "1.0"
    key: Text
    part: Part
    scan: Scan
    room: Room
    index: Annotated[int, Field(ge=1)]
    category: Category = Field(description="category of the sounding instance")
    seed: Annotated[int, Field(ge=0)]
    plan_sha256: Sha256 | None = Field(
        default=None,
        description="sha256 of all that these bytes depend on; a rerun keeps the observation if it is equal",
    )
    notes: tuple[str, ...] = Field(default=(), description="constraints that were relaxed, e.g. twins closer than 1 m")
    variant_of: Text | None = Field(
        default=None, description="key of the observation from which this variant differs only in its acoustics"
    )
    source_motion: Literal["path"] | None = Field(
        default=None, description="path: the sounding object moves (see frames); absent if it does not move"
    )
    source_position: Vector3 = Field(
        description="position of the source in the world, metres; if it moves, at the first frame"
    )
    intrinsics: IntrinsicsRecord
    instances: Annotated[tuple[InstanceRecord, ...], Field(min_length=1)]
    sound: SoundRecord | None = None
    acoustics: AcousticsRecord
    vision: VisionRecord
    frames: Annotated[tuple[FrameRecord, ...], Field(min_length=1, max_length=layout.MAX_FRAMES)]
    files: dict[RelativePath, Sha256] = Field(description="sha256 of every file beside observation.json")
    sizes: dict[RelativePath, Annotated[int, Field(ge=0)]] | None = Field(
        default=None, description="size in bytes of every file in `files`; absent in datasets of older versions"
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
        """Position of the source in the world at the time of ``frame``, metres."""
        return frame.source_position or self.source_position

    def to_frame(self, frame: FrameRecord, points: ArrayLike) -> NDArray[np.float64]:
        """Points (N, 3) of the sounding instance at the first frame, as in `gt_3d`, moved to the time of ``frame``."""
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
    """`camera_splits.json`: file names, without extension, of the train and test frames."""

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
    """`dataset.json`. It has no time stamp, so the same manifest and backends give the same bytes.

    ``digest`` covers all other fields, with the free text. It detects damage, but not an edit after which it was
    computed again.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"digest", "provenance"})

    schema_version: Literal["1.0"] = "1.0"
    name: Text
    version: Text
    toolkit_version: Text
    created_by: str | None = None
    manifest: str = Field(description="the text of the manifest, unchanged")
    manifest_sha256: Sha256 = Field(description="sha256 of the manifest's UTF-8 bytes")
    backends: dict[str, Text] = Field(description="backend name → version")
    licence: Text
    attributions: tuple[AttributionRecord, ...] = ()
    provenance: ProvenanceRecord | None = Field(default=None, description="software that made the observations")
    observations: tuple[DatasetEntry, ...]
    digest: Sha256 | None = Field(
        default=None, description="sha256 of all other fields as canonical JSON; absent in datasets of older versions"
    )

    def contents_digest(self) -> str:
        """The sha256 that `digest` should have.

        Canonical JSON: sorted keys, no spaces, ASCII with escapes, without fields that are null.
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
    """`submission.json`: the method, and the dataset for which the masks were made."""

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
        description="the ground truth from which the masks were made, e.g. 'masks of test frames'; absent if none. "
        "Leaderboards show a submission with this field, but do not rank it",
    )
    provenance: ProvenanceRecord | None = Field(
        default=None, description="software that made the masks; only for the baselines of this toolkit"
    )


_R = TypeVar("_R", bound=Record)
#: Longest message about a finding (characters); without a limit, a wrong value may be as long as the file.
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
        Avs3dError: naming the file, the first wrong field and the number of further errors.
    """
    try:
        return record.model_validate_json(text)
    except ValidationError as error:
        first, *rest = describe(error)
        more = f" (and {len(rest)} more)" if rest else ""
        raise Avs3dError(f"{where}: {first}{more}; expected a {record.__name__} (see `avs3d schema`)") from None


def unique_attributions(attributions: Iterable[AttributionRecord]) -> tuple[AttributionRecord, ...]:
    """The attributions sorted by asset, without repetitions."""
    found = {(a.asset, a.name, a.author, a.source): a for a in attributions}
    return tuple(found[key] for key in sorted(found))
