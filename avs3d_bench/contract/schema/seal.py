"""The files of a sealed test: `poses.json` of each observation, `seal.json` and what it commits to."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema.base import (
    FrameName,
    NonNegative,
    ProvenanceRecord,
    Quaternion,
    Record,
    RelativePath,
    Scalar,
    Sha256,
    Text,
    Vector3,
)
from avs3d_bench.contract.schema.observation import AmbisonicsRecord, ArrayRecord, IntrinsicsRecord, ObservationRecord
from avs3d_bench.errors import UsageError
from avs3d_bench.geometry import Pose

#: Most memory that a commitment may ask for (bytes), and most passes: the record comes from someone else.
_MOST_MEMORY, _MOST_PASSES = 2**30, 16


class PoseRecord(Record):
    """One frame of a sealed test: its time and the pose of the agent's sensor."""

    name: FrameName
    time: NonNegative = Field(description="seconds from the start; the clip covers [time, time + 1)")
    position: Vector3 = Field(description="position of the sensor in the world, metres")
    rotation: Quaternion = Field(description="camera-to-world (w, x, y, z); the camera looks down −Z")

    @property
    def pose(self) -> Pose:
        """The sensor's camera-to-world pose."""
        return Pose(self.position, self.rotation)


class PosesRecord(Record):
    """`poses.json`: what a sealed test publishes of an observation in place of `observation.json`.

    It has nothing that depends on what sounds.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"ambisonics", "array"})

    schema_version: Literal["1.0"] = "1.0"
    key: Text
    intrinsics: IntrinsicsRecord
    frames: Annotated[tuple[PoseRecord, ...], Field(min_length=1, max_length=layout.MAX_FRAMES)]
    ambisonics: AmbisonicsRecord | None = Field(default=None, description="of audio_clips_ambisonics/, if it is there")
    array: ArrayRecord | None = Field(default=None, description="of audio_clips_array/, if it is there")
    files: dict[RelativePath, Sha256] = Field(
        description="sha256 of every published file of the observation beside poses.json"
    )

    @classmethod
    def of(cls, record: ObservationRecord, files: dict[str, str]) -> Self:
        """The part of an observation's record that may be published; ``files``: the published ones → sha256."""
        return cls(
            key=record.key,
            intrinsics=record.intrinsics,
            frames=tuple(
                PoseRecord(name=f.name, time=f.time, position=f.position, rotation=f.rotation) for f in record.frames
            ),
            ambisonics=record.acoustics.ambisonics,
            array=record.acoustics.array,
            files=files,
        )

    @property
    def receivers(self) -> dict[str, AmbisonicsRecord | ArrayRecord]:
        """As `AcousticsRecord.receivers`."""
        named = {layout.AMBISONICS: self.ambisonics, layout.ARRAY: self.array}
        return {name: found for name, found in named.items() if found is not None}

    @model_validator(mode="after")
    def _check(self) -> Self:
        for position, frame in enumerate(self.frames):
            if frame.name != layout.frame_name(position):
                raise ValueError(f"frames[{position}].name is {frame.name}, expected {layout.frame_name(position)}")
        if any(a.time >= b.time for a, b in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("frame times do not increase")
        return self


class SecretCommitment(Record):
    """The commitment to a secret: published before the template, it binds the organiser to the secret."""

    function: Literal["scrypt"] = "scrypt"
    n: Annotated[int, Field(ge=2)] = Field(description="cost; a power of two")
    r: Annotated[int, Field(ge=1)] = Field(description="block size")
    p: Annotated[int, Field(ge=1, le=_MOST_PASSES)] = Field(description="passes")
    salt: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")] = Field(description="16 random bytes, hexadecimal")
    digest: Sha256 = Field(description="bytes 32 to 63 of scrypt(secret, salt), of 64 bytes")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.n & (self.n - 1):
            raise ValueError(f"n is {self.n}, expected a power of two")
        if 128 * self.n * self.r > _MOST_MEMORY:
            raise ValueError(f"n {self.n} and r {self.r} need more than {_MOST_MEMORY:,} bytes")
        return self


class CommitmentsRecord(Record):
    """Commitments by which the organiser is bound."""

    left_out: ClassVar[frozenset[str]] = frozenset({"private"})

    secret: SecretCommitment | Sha256 = Field(
        description="commitment to the secret; in schema 1.0, the sha256 of its 32 bytes"
    )
    manifest: Sha256 = Field(description="sha256 of the manifest with its seeds")
    truth: dict[Text, dict[RelativePath, Sha256]] = Field(
        description="key of an observation → truth file → sha256(salt, 1, bytes), or sha256(salt, 0) if there is no "
        "such file; salt: HMAC-SHA256(opening key, key/file)"
    )
    private: dict[RelativePath, Sha256] | None = Field(
        default=None, description="other private file → commitment of the same kind; absent in schema 1.0"
    )

    @model_validator(mode="after")
    def _keys(self) -> Self:
        for key in self.truth:
            try:
                layout.parse_key(key)
            except UsageError as error:
                raise ValueError(str(error)) from None
        return self


class SealRecord(Record):
    """`seal.json`: the commitments of a sealed test."""

    left_out: ClassVar[frozenset[str]] = frozenset()

    schema_version: Literal["1.0", "1.1"] = Field(
        default="1.1", description="1.1: the commitment to the secret is stretched, and all private files have one"
    )
    name: Text
    version: Text
    train_truth: bool = Field(description="whether the masks of train frames are published")
    settings: dict[str, Scalar] = Field(description="options of `avs3d seal` on which the bytes depend")
    backends: dict[str, Text] = Field(description="backend name → version")
    provenance: ProvenanceRecord = Field(description="software that made the observations")
    dataset_sha256: Sha256 = Field(description="sha256 of dataset.json")
    commitments: CommitmentsRecord

    @model_validator(mode="after")
    def _check(self) -> Self:
        newer = isinstance(self.commitments.secret, SecretCommitment) and self.commitments.private is not None
        if newer != (self.schema_version == "1.1"):
            kind = "a stretched commitment to the secret and commitments to private files"
            raise ValueError(f"schema_version is {self.schema_version}: only 1.1 has {kind}")
        return self


class DrawsRecord(Record):
    """`private/draws.json`: how often the seed of a home was drawn until its observations fitted into it."""

    schema_version: Literal["1.0"] = "1.0"
    draws: dict[Text, Annotated[int, Field(ge=1)]] = Field(description="home in the template → number of draws")
