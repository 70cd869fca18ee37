"""`submission.json`: the method of a submission."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from avs3d_bench.contract.schema.base import ProvenanceRecord, Record, Scalar, Text


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
