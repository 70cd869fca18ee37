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
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.dataset import Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.card import card_text, gather
from avs3d_bench.exports.samples import (
    ALL_KINDS,
    KINDS,
    PART_3_KINDS,
    Sample,
    check_extras,
    check_split,
    described,
    has_part_3,
    instance_facts,
    part_3_facts,
    receiver_facts,
    select,
)
from avs3d_bench.exports.shards import ShardFormat, ShardIndex, export_shards
from avs3d_bench.exports.webdataset import SHARD_MB, shard_limit
from avs3d_bench.formats import media
from avs3d_bench.runtime.imports import needing

#: Rows of a row group: about 45 MB of a full-size dataset, which is what a reader holds at a time.
ROW_GROUP = 32
OBSERVATIONS = "observations.parquet"
_FILES = {"rgb": "rgb", "binaural": "binaural", "mask": "mask", "instances": "instance_ids", "depth": "depth",
          "mono": "mono", "rirs": "impulse_response", "categories": "category_mask", "ambisonics": "ambisonics",
          "array": "array"}  # fmt: skip
#: Kinds that are columns of sound.
_SOUNDS = ("binaural", "mono", "ambisonics", "array")
#: Columns with a file of each source, in a dataset with part_3: column, and the field that holds the file.
_OF_SOURCES = {"stems": ("stems", "audio"), "rirs": ("impulse_responses", "rir")}
#: Columns that are stored as they are: PNG does not shrink.
_STORED = ("rgb", "mask", "instance_ids", "category_mask", "depth")


def _features(extras: Sequence[str], *, scenes: bool) -> Any:
    """Columns of `frames`; with ``scenes`` also those of part_3."""
    import datasets as hub

    image, audio, value, many = hub.Image, partial(hub.Audio, decode=False), hub.Value, hub.List
    columns: dict[str, Any] = {
        _FILES[name]: audio() if name in _SOUNDS else value("binary") if name == "rirs" else image()
        for name in (*KINDS, *extras)
        if name != "stems"
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
    columns["variant_of"] = value("string")
    if not scenes:
        return hub.Features(columns)
    columns |= _scene_columns() | {"category_mask": image()}
    columns["audible"] = many({"source": value("string")} | dict.fromkeys(_LEVELS, value("float64")))
    if "stems" in extras:
        columns["stems"] = many({"source": value("string"), "audio": audio()})
    if "rirs" in extras:
        columns["impulse_responses"] = many({"source": value("string"), "rir": value("binary")})
    return hub.Features(columns)


_LEVELS = ("level_db", "drr_db", "snr_db")


def _scene_columns() -> dict[str, Any]:
    """Columns of part_3 that `frames` and `observations` share."""
    import datasets as hub

    value, many = hub.Value, hub.List
    source: dict[str, Any] = dict.fromkeys(("id", "category", "room", "asset"), value("string"))
    source |= {"instance": value("int32"), "gain_db": value("float64"), "position": many(value("float64"))}
    source["programme"] = many(many(value("float64")))
    background = {"kind": value("string"), "snr_db": value("float64"), "level_db": value("float64")}
    return {
        "group": value("string"),
        "sources": many(source),
        "background": background,
        "categories": many(value("string")),
    }


def _row(sample: Sample, columns: Sequence[str]) -> dict[str, Any]:
    row: dict[str, Any] = {name: sample.facts.get(name) for name in columns}
    names = {kind.member: name for name, kind in ALL_KINDS.items()}
    for member in sample.members:
        source, _, own = member.name.partition(".")
        data, path = member.read(), f"{sample.key}.{member.name}"
        if member.name in names:
            column = _FILES[names[member.name]]
            row[column] = data if column == "impulse_response" else {"bytes": data, "path": path}
        else:
            column, field = _OF_SOURCES[names[own]]
            value = data if field == "rir" else {"bytes": data, "path": path}
            row[column] = [*(row[column] or ()), {"source": source, field: value}]
    return row


def write_parquet(extras: tuple[str, ...], scenes: bool, stream: BinaryIO, samples: Iterator[Sample]) -> None:
    """Write samples as one Parquet file, a row group at a time; ``scenes``: with the columns of part_3."""
    import pyarrow as pa
    from pyarrow import parquet

    features = _features(extras, scenes=scenes)
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
    import pyarrow as pa
    import pyarrow.parquet as pq

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
    scene: dict[str, Any] = {}
    if record.is_part_3:
        licences = [source.licence for source in record.sources or ()]
        scene = {name: value for name, value in part_3_facts(record, record.frames[0]).items() if name != "audible"}
        scene["sources"] = [
            facts | {"licence": licence.name, "author": licence.author, "source": licence.source}
            for facts, licence in zip(scene["sources"], licences, strict=True)
        ]
    if record.acoustics.receivers:
        row["receivers"] = json.dumps(receiver_facts(record), sort_keys=True)
    return row | scene | {
        "source_position": list(record.source_position) if record.source_position else None,
        "source_moves": any(map(record.source_moves, record.sound_sources[:1])),
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


def _observation_features(*, scenes: bool, receivers: bool) -> Any:
    """Columns of `observations`; with ``receivers`` also what hears beside the two ears, as JSON."""
    import datasets as hub

    value, many = hub.Value, hub.List
    columns: dict[str, Any] = dict.fromkeys(
        ("key", "part", "scan", "room", "category", "variant_of", "acoustics", "vision", "sound"), value("string")
    )
    columns |= dict.fromkeys(("frames", "train", "test"), value("int32"))
    columns |= {"source_position": many(value("float64")), "source_moves": value("bool"), "t30": value("float64")}
    instance: dict[str, Any] = dict.fromkeys(("category", "asset", "licence", "author", "source"), value("string"))
    instance |= dict.fromkeys(("position", "rotation", "low", "high"), many(value("float64")))
    instance |= {"id": value("int32"), "sounding": value("bool")}
    columns |= {"seed": value("uint64"), "instances": many(instance)}
    if receivers:
        columns["receivers"] = value("string")
    if scenes:
        shared = _scene_columns()
        credits = dict.fromkeys(("licence", "author", "source"), value("string"))
        columns |= shared | {"sources": many(shared["sources"].feature | credits)}
    return hub.Features(columns)


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
        extras: ``depth``, ``mono``, ``rirs``, ``stems``, ``ambisonics``, ``array``.
        workers: processes; None: one per core. The bytes do not depend on it, but on pyarrow's version.
        progress: show bars on stderr.

    Raises:
        UsageError: if an argument asks for something that does not exist, or ``folder`` holds something else.
        Avs3dError: if `datasets` is missing, a file is missing or damaged, or the system refuses (full disk, …).

    Examples:
        >>> index = write_huggingface("data/demo", "hub", split="test", workers=1)
        >>> index.splits["test"].samples, [shard.file for shard in index.shards]
        (4, ['data/test-00000-of-00001.parquet'])
        >>> from datasets import load_dataset
        >>> row = load_dataset("hub", split="test", cache_dir="cache")[0]
        >>> row["rgb"].size, waveform(row["binaural"])[0].shape
        ((64, 64), (2, 44100))
    """
    dataset, keys = select(root, only)
    chosen, wanted = check_split(split), check_extras(extras)
    with needing("this export", "pip install 'avs3d-bench[exports]'"):
        import datasets as hub
        import pyarrow as pa
        from pyarrow import parquet
    versions = f"pyarrow {pa.__version__}, datasets {hub.__version__}"
    scenes = has_part_3(keys)
    revision = f"huggingface 1, {versions}, {' '.join(wanted)}{' and part_3' if scenes else ''}"
    style = ShardFormat("huggingface", revision, _room, partial(write_parquet, wanted, scenes), _name)
    facts, held = gather(dataset, keys), (*KINDS, *PART_3_KINDS, *wanted)
    facts = replace(facts, sizes={name: size for name, size in facts.sizes.items() if name in held})

    def finish(target: Path, index: ShardIndex) -> None:
        rows = [observation_row(Observation(dataset.root, key)) for key in keys]
        schema = _observation_features(scenes=scenes, receivers=any("receivers" in row for row in rows)).arrow_schema
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
        members=described(ALL_KINDS) | {"json": "pose, camera, source"},
        workers=workers, progress=progress, finish=finish,
    )  # fmt: skip


def waveform(value: dict[str, Any]) -> tuple[NDArray[np.float32], int]:
    """Decode an undecoded `Audio` value: (channels, n) float32 and the sample rate; needs no torchcodec.

    Args:
        value: ``row["binaural"]``, a mapping with ``bytes``.

    Raises:
        Avs3dError: if there are no bytes, or they are no sound file.

    Examples:
        >>> from pathlib import Path
        >>> wav = Path("data/demo/part_1/apartment_1/bathroom/1/audio_clips_binaural/frame_0.wav")
        >>> samples, rate = waveform({"bytes": wav.read_bytes(), "path": wav.name})
        >>> samples.shape, samples.dtype.name, rate
        ((2, 44100), 'float32', 44100)
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
