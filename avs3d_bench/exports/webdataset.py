"""WebDataset shards: tar files whose members group into samples by name.

    train-000000.tar
      part_1/apartment_1/kitchen/1/frame_001.rgb.png
      part_1/apartment_1/kitchen/1/frame_001.binaural.wav
      part_1/apartment_1/kitchen/1/frame_001.mask.png
      part_1/apartment_1/kitchen/1/frame_001.instances.png
      part_1/apartment_1/kitchen/1/frame_001.json

    import webdataset
    from avs3d_bench.exports import decode_sample
    frames = webdataset.WebDataset("shards/train-{000000..000011}.tar", shardshuffle=12).shuffle(500).map(decode_sample)

Files are stored as they are. Owner, group and times are 0, so that the same frames give the same bytes; names that
USTAR cannot hold get a PAX header.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports.samples import ALL_KINDS, Sample, check_extras, check_split, described, select
from avs3d_bench.exports.shards import ShardFormat, ShardIndex, export_shards
from avs3d_bench.exports.tar_format import closing, header, padding, pieces, shard_name

#: Megabytes of a shard: large enough to stream, small enough to shuffle and to resume.
SHARD_MB = 256.0
MB = 1_000_000


def room(sample: Sample) -> int:
    """Bytes that a sample takes in a tar file."""
    files = [(f"{sample.key}.{member.name}", member.size) for member in sample.members]
    files.append((f"{sample.key}.json", len(sample.json)))
    return sum(len(header(name, size)) + size + len(padding(size)) for name, size in files)


def write_tar(stream: BinaryIO, samples: Iterator[Sample]) -> None:
    """Write samples as a tar archive."""
    written = 0
    for sample in samples:
        for name, data in [*((m.name, m.read()) for m in sample.members), ("json", sample.json)]:
            for piece in pieces(f"{sample.key}.{name}", data):
                stream.write(piece)
                written += len(piece)
    stream.write(closing(written))


_LAYOUT = ShardFormat("webdataset", "webdataset 1", room, write_tar, shard_name)


def write_webdataset(
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
    """Write a dataset as WebDataset shards; an interrupted export is completed, a finished one checked.

    Args:
        root: the dataset (ours or the official release).
        folder: where the shards and `shards.json` go.
        split: ``train``, ``test`` or ``all``; shards never mix splits.
        shard_mb: a shard's size in megabytes (10⁶ bytes).
        only: shell patterns of observation keys.
        extras: ``depth``, ``mono``, ``rirs``, ``stems``, ``ambisonics``, ``array``.
        workers: processes; None: one per core. The bytes do not depend on it.
        progress: show bars on stderr.

    Raises:
        UsageError: if an argument asks for something that does not exist, or ``folder`` holds something else.
        Avs3dError: if a file is missing or damaged, or the system refuses (full disk, …).

    Examples:
        >>> index = write_webdataset("data/demo", "shards", split="train", workers=1)
        >>> index.splits["train"].samples, [shard.file for shard in index.shards]
        (14, ['train-000000.tar'])
        >>> [path.rpartition("/")[2] for path in shard_paths("shards", split="train")]
        ['train-000000.tar']
    """
    dataset, keys = select(root, only)
    chosen, wanted = check_split(split), check_extras(extras)
    members = described(ALL_KINDS) | {"json": "pose, camera, source, instances"}
    return export_shards(
        dataset, keys, folder, _LAYOUT, split=chosen, limit=shard_limit(shard_mb), extras=wanted, members=members,
        workers=workers, progress=progress,
    )  # fmt: skip


def shard_limit(megabytes: float) -> int:
    """Bytes of a shard.

    Raises:
        UsageError: if ``megabytes`` is not between 0.001 and 10⁶.
    """
    if not 0.001 <= megabytes <= 1e6:
        raise UsageError(f"--shard-size {megabytes:g}: expected megabytes between 0.001 and 1000000")
    return int(megabytes * MB)


def decode_sample(sample: Mapping[str, Any]) -> dict[str, Any]:
    """Decode a sample of undecoded members, as the `webdataset` package yields it.

    Args:
        sample: ``__key__`` and bytes by member name.

    Returns:
        ``facts`` (the JSON) and, where the sample has them, ``rgb`` (3, H, W) uint8, ``binaural`` (2, 44100) float32,
        ``mask`` (H, W) bool, ``instance_ids`` (H, W) int32, ``depth`` (H, W) float32 metres, ``mono`` (n,) float32,
        ``ambisonics`` ((order + 1)², 44100) float32, ``array`` (microphones, 44100) float32,
        ``impulse_response`` (2, n) float32; of part_3 ``category_mask`` (H, W) uint8 class ids, and by source's id
        ``stems`` (2, 44100) float32, ``impulse_responses`` (2, n) float32. Other keys (``__key__``, …) pass through.
        Arrays are numpy's.

    Raises:
        Avs3dError: if a member is damaged; the sample and the member are named.

    Examples:
        >>> from avs3d_bench.exports.shard_files import read_samples  # or webdataset.WebDataset(shard_paths(…))
        >>> from pathlib import Path
        >>> _ = write_webdataset("data/demo", "decoded", split="test", workers=1)
        >>> sample = decode_sample(next(read_samples(Path("decoded/test-000000.tar"))))
        >>> sample["rgb"].shape, sample["binaural"].shape, sample["mask"].dtype.name, sample["facts"]["frame"]
        ((3, 64, 64), (2, 44100), 'bool', 'frame_000')
    """
    import soundfile

    out: dict[str, Any] = {name: value for name, value in sample.items() if name.startswith("__")}
    for name, data in sample.items():
        if name.startswith("__"):
            continue
        try:
            if name == "json":
                out["facts"] = json.loads(data)
            elif name == "rgb.png":
                out["rgb"] = planes(_pixels(data, cv2.IMREAD_COLOR))
            elif name == "mask.png":
                out["mask"] = _pixels(data, cv2.IMREAD_GRAYSCALE) == 255
            elif name == "instances.png":
                out["instance_ids"] = _pixels(data, cv2.IMREAD_UNCHANGED).astype(np.int32)
            elif name == "depth.png":
                out["depth"] = _pixels(data, cv2.IMREAD_UNCHANGED) / np.float32(layout.DEPTH_UNITS_PER_METRE)
            elif name == "binaural.wav":
                out["binaural"] = np.ascontiguousarray(soundfile.read(io.BytesIO(data), dtype="float32")[0].T)
            elif name in ("ambisonics.wav", "array.wav"):
                samples = soundfile.read(io.BytesIO(data), dtype="float32", always_2d=True)[0]
                out[name.partition(".")[0]] = np.ascontiguousarray(samples.T)
            elif name == "mono.wav":
                out["mono"] = soundfile.read(io.BytesIO(data), dtype="float32")[0]
            elif name == "categories.png":
                out["category_mask"] = _pixels(data, cv2.IMREAD_UNCHANGED)
            elif name == "rir.npz":
                out["impulse_response"] = _response(data)
            elif name.endswith(".rir.npz"):
                out.setdefault("impulse_responses", {})[name.partition(".")[0]] = _response(data)
            elif name.endswith(".stem.wav"):
                samples = soundfile.read(io.BytesIO(data), dtype="float32")[0].T
                out.setdefault("stems", {})[name.partition(".")[0]] = np.ascontiguousarray(samples)
        except Exception as error:
            raise Avs3dError(f"{sample.get('__key__')}.{name}: cannot be decoded: {error}") from None
    return out


def planes(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(3, H, W) RGB of OpenCV's (H, W, 3) BGR: one pass, no copy in between."""
    out: NDArray[np.uint8] = np.empty((3, *pixels.shape[:2]), dtype=np.uint8)
    cv2.split(pixels, [out[2], out[1], out[0]])
    return out


def _response(data: bytes) -> Any:
    with np.load(io.BytesIO(data)) as archive:
        return archive["rir"]


def _pixels(data: bytes, flag: int) -> Any:
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flag)
    if pixels is None:
        raise ValueError("damaged PNG")
    return pixels
