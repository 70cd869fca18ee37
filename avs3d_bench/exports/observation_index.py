"""`shards.json` of `avs3d generate --format tar`: contents and digests of the tars, the dataset's record."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from avs3d_bench.exports import observation_tar
from avs3d_bench.exports.samples import described
from avs3d_bench.schema import DatasetRecord, ObservationRecord, Record, RelativePath, Sha256, Text

#: What `shards.json` says of its form; exports of a dataset have other words there.
FORMAT: Literal["webdataset by observation"] = "webdataset by observation"


class ObservationShard(Record):
    """The tar of one observation."""

    left_out: ClassVar[frozenset[str]] = frozenset({"group"})

    file: RelativePath = Field(description="below the folder")
    key: Text = Field(description="of the observation")
    group: Text | None = Field(
        default=None, description="only in part_3: key of the observation whose pictures this one has"
    )
    samples: Annotated[int, Field(ge=1)] = Field(description="number of frames")
    bytes: Annotated[int, Field(ge=1)]
    sha256: Sha256 = Field(description="of the file")


class ObservationShardIndex(Record):
    """`shards.json` over one tar per observation; it is written last."""

    format: Literal["webdataset by observation"] = FORMAT
    members: dict[str, str] = Field(description="possible members of a sample: name → description")
    shards: tuple[ObservationShard, ...] = Field(description="sorted by key")
    dataset: DatasetRecord = Field(description="as dataset.json: licence, attributions, manifest, versions")


def describe_shards(
    root: Path, dataset: DatasetRecord, found: Iterable[tuple[ObservationRecord, str]]
) -> ObservationShardIndex:
    """The index of a folder.

    Args:
        root: the folder.
        dataset: its record.
        found: of each observation its record and the sha256 of its tar, sorted by key.
    """
    shards, folders = [], set[str]()
    for record, digest in found:
        path = observation_tar.tar_path(root / record.key)
        folders |= {name.partition("/")[0] for name in record.files}
        shards.append(
            ObservationShard(
                file=path.relative_to(root).as_posix(),
                key=record.key,
                group=record.group,
                samples=len(record.frames),
                bytes=path.stat().st_size,
                sha256=digest,
            )
        )
    kinds = {name: kind for name, kind in observation_tar.KINDS.items() if kind.folder in folders}
    members = described(kinds) | {"json": "pose, camera, source, instances"}
    return ObservationShardIndex(members=members, shards=tuple(shards), dataset=dataset)
