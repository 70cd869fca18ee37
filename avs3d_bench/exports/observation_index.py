"""The index over the shards that `avs3d generate --format webdataset` writes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import DatasetRecord, ObservationRecord
from avs3d_bench.exports.observation_tar import KINDS, count_frames
from avs3d_bench.exports.samples import described
from avs3d_bench.exports.shards import ShardIndex, ShardRecord, sum_splits


def describe_shard(split: str, path: Path, record: ObservationRecord, sha256: str) -> ShardRecord:
    """The entry of a shard in the index.

    Args:
        split: ``train`` or ``test``.
        path: of the shard.
        record: of the observation; the digest of its plan is that of the shard.
        sha256: of the file.
    """
    train, test = layout.split_names(frame.name for frame in record.frames)
    names = train if split == "train" else test
    return ShardRecord(
        file=path.name,
        split=split,
        samples=len(names),
        bytes=path.stat().st_size,
        sha256=sha256,
        plan=str(record.plan_sha256),
        first=f"{record.key}/{names[0]}",
        last=f"{record.key}/{names[-1]}",
    )


def describe_shards(
    dataset: DatasetRecord, records: Sequence[ObservationRecord], shards: Iterable[ShardRecord]
) -> ShardIndex:
    """The index of a folder.

    Args:
        dataset: its record.
        records: of its observations.
        shards: in order of their names.
    """
    folders = {name.partition("/")[0] for record in records for name in record.files}
    kinds = {name: kind for name, kind in KINDS.items() if kind.folder in folders}
    found, counts = tuple(shards), Counter(split for record in records for split in count_frames(record))
    return ShardIndex(
        format="webdataset",
        toolkit_version=dataset.toolkit_version,
        dataset=dataset.name,
        dataset_version=dataset.version,
        licence=dataset.licence,
        attributions=dataset.attributions,
        members=described(kinds) | {"json": "pose, camera, source, instances"},
        splits=sum_splits(found, counts),
        shards=found,
        generated=dataset,
    )
