"""`dataset.json`: the manifest, software and licences of a dataset, and its observations with their digests."""

from __future__ import annotations

import hashlib
import json
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from avs3d_bench.contract.schema.base import (
    PART_3_VERSION,
    SCHEMA_VERSION,
    AttributionRecord,
    Category,
    Part,
    ProvenanceRecord,
    Record,
    Room,
    Scan,
    Sha256,
    Text,
)
from avs3d_bench.contract.schema.observation import ObservationRecord
from avs3d_bench.contract.taxonomy import PART_3


class DatasetEntry(Record):
    """One observation in `dataset.json`."""

    left_out: ClassVar[frozenset[str]] = frozenset({"sounds"})

    key: Text
    category: Category | None = Field(
        description="null in an observation of part_3 without a source, and in a sealed test"
    )
    part: Part
    scan: Scan
    room: Room
    digest: Sha256 = Field(description="sha256 of the observation's observation.json; of poses.json in a sealed test")
    sounds: tuple[Text, ...] | None = Field(
        default=None,
        description="what its sources play, in their order: a voice, such as 'procedural:clock/longcase', or a "
        "recording; absent in sealed tests and datasets of older versions",
    )

    @classmethod
    def of(cls, record: ObservationRecord, digest: str) -> Self:
        """The entry of an observation; ``digest`` is the sha256 of its observation.json."""
        played = [record.sound.asset] if record.sound else [source.asset for source in record.sources or ()]
        return cls(
            key=record.key,
            category=record.category,
            part=record.part,
            scan=record.scan,
            room=record.room,
            digest=digest,
            sounds=tuple(played),
        )


class DatasetRecord(Record):
    """`dataset.json`. It has no time stamp, so the same manifest and backends give the same bytes.

    ``digest`` covers all other fields, with the free text. It detects damage, but not an edit after which it was
    computed again.
    """

    left_out: ClassVar[frozenset[str]] = frozenset({"digest", "provenance", "categories", "sealed_test"})

    schema_version: Literal["1.0", "1.1"] = Field(
        default="1.0", description="1.1 with observations of part_3 or categories of the manifest's own, else 1.0"
    )
    name: Text
    version: Text
    toolkit_version: Text
    created_by: str | None = None
    sealed_test: Literal[True] | None = Field(
        default=None,
        description="true: a sealed test, whose truth is not published (see seal.json): manifest is empty, and no "
        "observation has a category or sounds; absent otherwise",
    )
    manifest: str = Field(description="the text of the manifest, unchanged; empty in a sealed test")
    manifest_sha256: Sha256 = Field(description="sha256 of the manifest's UTF-8 bytes")
    backends: dict[str, Text] = Field(description="backend name → version")
    licence: Text
    attributions: tuple[AttributionRecord, ...] = ()
    provenance: ProvenanceRecord | None = Field(default=None, description="software that made the observations")
    categories: tuple[Category, ...] | None = Field(
        default=None,
        description="categories that the manifest adds, in the order of their class ids, which follow the seven of "
        "the paper; absent if there are none",
    )
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
        if self.sealed_test and self.manifest:
            raise ValueError("manifest is given, but the test is sealed: expected an empty text")
        keys = [entry.key for entry in self.observations]
        if keys != sorted(set(keys)):
            raise ValueError("observations are not sorted by key, or a key is listed twice")
        for entry in self.observations:
            head = f"{entry.part}/{entry.scan}/{entry.room}/"
            if not (entry.key.startswith(head) and entry.key[len(head) :].isdigit()):
                raise ValueError(f"key {entry.key!r} does not fit its part, scan and room: expected {head}<index>")
            if self.sealed_test and entry.category is not None:
                raise ValueError(f"{entry.key}: has a category, but the test is sealed: expected null")
            if self.sealed_test and entry.sounds is not None:
                raise ValueError(f"{entry.key}: names its sounds, but the test is sealed: leave them out")
            if entry.category is None and entry.part != PART_3 and not self.sealed_test:
                raise ValueError(f"{entry.key}: category is missing; only an observation of part_3 may have none")
        newer = bool(self.categories) or any(entry.part == PART_3 for entry in self.observations)
        expected = PART_3_VERSION if newer else SCHEMA_VERSION
        if self.schema_version != expected:
            raise ValueError(f"schema_version is {self.schema_version}, expected {expected}")
        return self
