"""A folder that `datasets.load_dataset(DIR)` reads from local files, without a script and without the network.

    DIR/README.md                               the dataset card; its front matter names the files of each configuration
    DIR/data/train-00000-of-00012.parquet …     configuration `frames` (the default): one row per frame
    DIR/observations.parquet                    configuration `observations`: one row per observation
    DIR/shards.json                             counts and sha256 of every file

Pictures and masks are `Image` features over the original PNG bytes. Sound is an `Audio(decode=False)` feature over the
original WAV bytes: decoding it needs torchcodec (and FFmpeg) in `datasets`, which many machines lack, so a row holds
``{"bytes": …, "path": …}`` and `waveform` turns that into samples. Who has torchcodec casts the column:
``frames.cast_column("binaural", Audio())``.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import media
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.card import card_text, gather
from avs3d_bench.exports.needs import need
from avs3d_bench.exports.samples import ALL_KINDS, KINDS, Sample, check_extras, check_split, instance_facts, select
from avs3d_bench.exports.shards import Layout, ShardIndex, export_shards
from avs3d_bench.exports.webdataset import SHARD_MB, shard_limit

#: Rows of a row group: about 45 MB of a full-size dataset, which is what a reader holds at a time.
ROW_GROUP = 32
OBSERVATIONS = "observations.parquet"
_FILES = {"rgb": "rgb", "binaural": "binaural", "mask": "mask", "instances": "instance_ids", "depth": "depth",
          "mono": "mono", "rirs": "impulse_response"}  # fmt: skip
#: Columns that are stored as they are: PNG does not shrink.
_STORED = ("rgb", "mask", "instance_ids", "depth")


def _features(extras: Sequence[str]) -> Any:
    """Columns of `frames`."""
    hub = need("datasets")
    image, audio, value, many = hub.Image, partial(hub.Audio, decode=False), hub.Value, hub.List
    columns: dict[str, Any] = {
        _FILES[name]: audio() if name in ("binaural", "mono") else value("binary") if name == "rirs" else image()
        for name in (*KINDS, *extras)
    }
    columns |= dict.fromkeys(("key", "frame", "split", "part", "scan", "room", "category"), value("string"))
    columns |= dict.fromkeys(("index", "width", "height", "visible_pixels", "sounding_instance"), value("int32"))
    columns |= dict.fromkeys(
        ("time", "azimuth", "elevation", "distance", "rms_left", "rms_right", "t30"), value("float64")
    )
    columns |= dict.fromkeys(("line_of_sight", "source_moves"), value("bool"))
    columns |= dict.fromkeys(("position", "source_position", "sounding_position"), many(value("float64")))
    columns |= dict.fromkeys(("rotation", "sounding_rotation"), many(value("float64")))
    columns |= dict.fromkeys(("intrinsics", "camera_to_world"), many(many(value("float64"))))
    return hub.Features(columns | {"variant_of": value("string")})


def _row(sample: Sample, columns: Sequence[str]) -> dict[str, Any]:
    row: dict[str, Any] = {name: sample.facts.get(name) for name in columns}
    names = {kind.member: _FILES[name] for name, kind in ALL_KINDS.items()}
    for member in sample.members:
        column, data = names[member.name], member.read()
        row[column] = data if column == "impulse_response" else {"bytes": data, "path": f"{sample.key}.{member.name}"}
    return row


def write_parquet(extras: tuple[str, ...], stream: BinaryIO, samples: Iterator[Sample]) -> None:
    """Write samples as one Parquet file, a row group at a time."""
    pa, parquet = need("pyarrow"), need("pyarrow.parquet")
    features = _features(extras)
    schema = features.arrow_schema
    packing = {name: "NONE" if name.split(".")[0] in _STORED else "ZSTD" for name in _leaves(schema)}
    with parquet.ParquetWriter(pa.PythonFile(stream, mode="w"), schema, compression=packing) as writer:
        rows: list[dict[str, Any]] = []
        for sample in samples:
            rows.append(_row(sample, list(features)))
            if len(rows) == ROW_GROUP:
                writer.write_table(pa.Table.from_pylist(rows, schema=schema))
                rows = []
        if rows:
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))


def _leaves(schema: Any) -> list[str]:
    """Paths of the leaf columns, as Parquet calls them."""
    pq, pa = need("pyarrow.parquet"), need("pyarrow")
    sink = io.BytesIO()
    pq.write_table(schema.empty_table(), pa.PythonFile(sink, mode="w"))
    found = pq.ParquetFile(io.BytesIO(sink.getvalue())).schema
    return [found.column(number).path for number in range(len(found.names))]


def _room(sample: Sample) -> int:
    return sum(member.size for member in sample.members) + len(sample.json)


def _name(split: str, number: int, count: int) -> str:
    return f"data/{split}-{number:05d}-of-{count:05d}.parquet"


def observation_row(observation: Observation) -> dict[str, Any]:
    """An observation as a row; None for what the official release does not say."""
    record, place = observation.record, observation.place
    row: dict[str, Any] = {
        "key": observation.key, "part": place.part, "scan": place.scan, "room": place.room,
        "category": observation.category, "frames": len(observation.frames),
        "train": len(observation.train), "test": len(observation.test),
    }  # fmt: skip
    if record is None:
        return row
    return row | {
        "source_position": list(record.source_position), "source_moves": record.moves,
        "variant_of": record.variant_of, "t30": record.acoustics.t30, "seed": record.seed,
        "acoustics": f"{record.acoustics.backend} {record.acoustics.version}",
        "vision": f"{record.vision.backend} {record.vision.version}",
        "sound": record.sound.asset if record.sound else None,
        "instances": [
            instance_facts(instance)
            | {"licence": instance.licence.name, "author": instance.licence.author, "source": instance.licence.source}
            for instance in record.instances
        ],
    }  # fmt: skip


def _observation_features() -> Any:
    hub = need("datasets")
    value, many = hub.Value, hub.List
    columns: dict[str, Any] = dict.fromkeys(
        ("key", "part", "scan", "room", "category", "variant_of", "acoustics", "vision", "sound"), value("string")
    )
    columns |= dict.fromkeys(("frames", "train", "test"), value("int32"))
    columns |= {"source_position": many(value("float64")), "source_moves": value("bool"), "t30": value("float64")}
    instance: dict[str, Any] = dict.fromkeys(("category", "asset", "licence", "author", "source"), value("string"))
    instance |= dict.fromkeys(("position", "rotation", "low", "high"), many(value("float64")))
    instance |= {"id": value("int32"), "sounding": value("bool")}
    return hub.Features(columns | {"seed": value("uint64"), "instances": many(instance)})


def write_huggingface(
    root: str | Path,
    folder: str | Path,
    *,
    split: str = "all",
    shard_mb: float = SHARD_MB,
    only: Sequence[str] = (),
    extras: Sequence[str] = (),
    workers: int | None = None,
    progress: bool = False,
) -> ShardIndex:
    """Write a folder for `datasets.load_dataset`; an interrupted export is completed, a finished one checked.

    Args:
        root: the dataset (ours or the official release).
        folder: where it goes.
        split: ``train``, ``test`` or ``all``.
        shard_mb: megabytes (10⁶ bytes) of files in a Parquet file.
        only: shell patterns of observation keys.
        extras: ``depth``, ``mono``, ``rirs``.
        workers: processes; None: one per core. The bytes do not depend on it, but on pyarrow's version.
        progress: show bars on stderr.

    Raises:
        UsageError: if an argument asks for something that does not exist, or ``folder`` holds something else.
        Avs3dError: if `datasets` is missing, a file is missing or damaged, or the system refuses (full disk, …).
    """
    dataset, keys = select(root, only)
    chosen, wanted = check_split(split), check_extras(extras)
    pa, parquet = need("pyarrow"), need("pyarrow.parquet")
    versions = f"pyarrow {pa.__version__}, datasets {need('datasets').__version__}"
    revision = f"huggingface 1, {versions}, {' '.join(wanted)}"
    style = Layout("huggingface", revision, _room, partial(write_parquet, wanted), _name)
    facts = gather(dataset, keys)
    facts = replace(facts, sizes={name: size for name, size in facts.sizes.items() if name in (*KINDS, *wanted)})
    schema = _observation_features().arrow_schema

    def finish(target: Path, index: ShardIndex) -> None:
        rows = [observation_row(Observation(dataset.root, key)) for key in keys]
        stream = io.BytesIO()
        parquet.write_table(pa.Table.from_pylist(rows, schema=schema), pa.PythonFile(stream, mode="w"))
        media.write_bytes(target / OBSERVATIONS, stream.getvalue())
        configs = {
            "frames": {name: f"data/{name}-*.parquet" for name in index.splits},
            "observations": {"observations": OBSERVATIONS},
        }
        media.write_bytes(target / "README.md", card_text(facts, configs=configs).encode())

    return export_shards(
        dataset, keys, folder, style, split=chosen, limit=shard_limit(shard_mb), extras=wanted,
        members={kind.member: kind.what for kind in ALL_KINDS.values()} | {"json": "pose, camera, source"},
        workers=workers, progress=progress, finish=finish,
    )  # fmt: skip


def waveform(value: dict[str, Any]) -> tuple[NDArray[np.float32], int]:
    """Decode an undecoded `Audio` value: (channels, n) float32 and the sample rate; needs no torchcodec.

    Args:
        value: ``row["binaural"]``, a mapping with ``bytes``.

    Raises:
        Avs3dError: if there are no bytes, or they are no sound file.
    """
    import soundfile

    data = value.get("bytes") if isinstance(value, dict) else None
    if not isinstance(data, bytes):
        raise Avs3dError(f"audio value of type {type(value).__name__}: expected a mapping with bytes (decode=False)")
    try:
        samples, rate = soundfile.read(io.BytesIO(data), dtype="float32", always_2d=True)
    except soundfile.SoundFileError as error:
        raise Avs3dError(f"{value.get('path')}: damaged sound: {error}") from None
    return np.ascontiguousarray(samples.T), int(rate)
