"""Reading WebDataset shards once, into arrays that stay on disk and are mapped into memory.

The shards are those of `avs3d export webdataset` or of `avs3d generate --format webdataset`. Siblings of a group share
their pictures, so one copy is stored. What is stored lies in a folder beside the checkpoints; several processes (one
per GPU) and a run that goes on after an interruption map the same files.

This module needs numpy alone: it runs in worker processes.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import tarfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.commands.outputs import Signature, check_replaceable
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import AUDIBLE_LEVEL_DB
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.exports import decode_sample
from avs3d_bench.exports.shard_files import ShardFile, list_shards
from avs3d_bench.formats.files import write_json
from avs3d_bench.formats.staging import staged_folder
from avs3d_bench.runtime.parallel import advance, process_each
from baselines.listener.codecs import drawn
from baselines.listener.dry import DrySounds

#: Side of the pictures the network works on; of those that are stored where frames are larger, so that parts of them
#: are sharp (pixels).
SIDE = 252
FINE = 2 * SIDE
#: Sides to which pictures are resized when the trained network looks at them (pixels).
LOOK_SIDES = (SIDE, FINE, 3 * SIDE)
#: Changes when the stored arrays do: folders of other versions are written again.
VERSION = 5
TABLE = "table.json"
#: How a table begins, which may be replaced: its fields are sorted.
_TABLE_SIGNATURE = Signature(start=b'{\n "audible": ')
_REQUIRED = {
    "json": "facts",
    "rgb.png": "picture",
    "binaural.wav": "sound",
    "mask.png": "mask",
    "instances.png": "instance ids",
}
#: Of them, those of the picture; siblings share them.
_OF_PICTURE = ("json", "rgb.png", "instances.png")
_CLASS = {name: number for number, name in enumerate(CATEGORIES, start=1)}
#: Bytes of zeros at the end of a whole tar archive.
_END = 2 * tarfile.BLOCKSIZE


@dataclass(frozen=True)
class FrameEntry:
    """One frame of one observation.

    Attributes:
        key: ``<observation key>/<frame name>``.
        group: key of the observation whose pictures it shares, with the frame's name.
        home: name of the scan.
        audible: categories that are heard.
        other: whether a sound of no class is heard.
        lateral: lateral angle of the only audible source (rad); NaN if there is none, or several.
        camera: fx, fy, cx, cy as shares of the picture's width and height.
        width: of the picture (pixels).
        instances: (id, class) of the instances of the seven categories.
        response: member with the impulse response of the only audible source; None if there is none, or several.
        members: name → (offset, size) in the shard.
    """

    key: str
    group: str
    home: str
    audible: tuple[str, ...]
    other: bool
    lateral: float
    camera: tuple[float, float, float, float]
    width: int
    instances: tuple[tuple[int, int], ...]
    response: str | None
    members: dict[str, tuple[int, int]]


@dataclass(frozen=True)
class ShardTable:
    """Index of the stored frames, without pixels and samples. A *view* is a picture with all its sounds.

    Attributes:
        version: `VERSION`.
        side: of the stored pictures: `FINE` if a frame is larger than `SIDE`, else that.
        digest: sha256 over the shards' names and sha256.
        keys: of each sound, ``<observation key>/<frame name>``.
        view: of each sound, its picture.
        audible: of each sound, the categories that are heard.
        others: of each sound, whether a sound of no class is heard.
        lateral: of each sound, the lateral angle of its only audible source (rad), None if there is none or several.
        has_response: of each sound, whether the impulse response of its only audible source is stored.
        groups: of each picture, the group and frame.
        homes: of each picture.
        cameras: of each picture, see `FrameEntry`.
        present: of each picture, the categories in the room.
    """

    version: int
    side: int
    digest: str
    keys: list[str]
    view: list[int]
    audible: list[list[str]]
    others: list[bool]
    lateral: list[float | None]
    has_response: list[bool]
    groups: list[str]
    homes: list[str]
    cameras: list[list[float]]
    present: list[list[str]]

    def heard(self, sounds: Iterable[int]) -> NDArray[np.bool_]:
        """(n, categories + 1) which categories are heard in sounds, and last whether one of no class is."""
        rows = [[*(name in self.audible[sound] for name in CATEGORIES), self.others[sound]] for sound in sounds]
        return np.asarray(rows, np.bool_).reshape(-1, len(CATEGORIES) + 1)


@dataclass(frozen=True)
class ShardStore:
    """The arrays, mapped into memory.

    Attributes:
        table: what they hold.
        pictures: (P, side, side, 3) uint8 RGB.
        classes: (P, side, side) uint8: class of the visible instance, 0 none of the seven categories.
        sounds: (N, 2, 44100) float16.
        coded: (N, 2, 44100) float16 the same, each from a file of a lossy codec (`codecs.drawn`).
        masks: (N, side, side / 8) uint8: the mask of what sounds, eight pixels a byte.
        marked: (N,) int32: pixels of the mask.
        extents: (P, 7, 2) float32: lowest and highest lateral angle at which a category is visible (rad), NaN if not.
        responses: (N, 2, 44100) float16 impulse responses with a peak of 1, zeros where there is none (`has_response`);
            (0, 2, 44100) if no sound has one.
        dry: sounds that may sound through them in place of the source's own; None: its own alone.
    """

    table: ShardTable
    pictures: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    sounds: NDArray[np.float16]
    coded: NDArray[np.float16]
    masks: NDArray[np.uint8]
    marked: NDArray[np.int32]
    extents: NDArray[np.float32]
    responses: NDArray[np.float16]
    dry: DrySounds | None = None


def _shapes(views: int, sounds: int, side: int = SIDE, responses: int = 0) -> dict[str, tuple[tuple[int, ...], Any]]:
    return {
        "pictures": ((views, side, side, 3), np.uint8),
        "classes": ((views, side, side), np.uint8),
        "sounds": ((sounds, 2, layout.SAMPLE_RATE), np.float16),
        "coded": ((sounds, 2, layout.SAMPLE_RATE), np.float16),
        "masks": ((sounds, side, math.ceil(side / 8)), np.uint8),
        "marked": ((sounds,), np.int32),
        "extents": ((views, len(CATEGORIES), 2), np.float32),
        "responses": ((responses, 2, layout.SAMPLE_RATE), np.float16),
    }


def index_shard(shard: ShardFile) -> tuple[str, list[FrameEntry]]:
    """The sha256 of a shard, and its frames.

    Raises:
        Avs3dError: if it is cut short or not the one that `shards.json` lists, has a member twice, or a frame lacks
            what training needs.
    """
    path = shard.path
    try:
        data = path.read_bytes()
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            # Names that begin with __ are not samples: the record and the digest in shards of `avs3d generate`.
            members = list(archive)
            infos = [info for info in members if info.isfile() and not info.name.startswith("__")]
    except (OSError, tarfile.TarError) as error:
        raise Avs3dError(f"{path}: cannot be read as a shard ({error}); it may be cut short: write it again") from None
    # The zeros of silence at a cut are no end mark: it comes after the last member.
    end = max((_padded(info.offset_data + info.size) for info in members), default=0) + _END
    if data[-_END:].strip(b"\0") or len(data) < end:
        raise Avs3dError(f"{path}: the shard is cut short, its end mark is missing; write it again")
    digest = hashlib.sha256(data).hexdigest()
    if shard.sha256 not in (None, digest):
        raise Avs3dError(
            f"{path}: sha256 {digest[:12]}…, expected {str(shard.sha256)[:12]}… as in {layout.SHARDS_JSON}; the shard "
            "is damaged: copy it again, or write it again"
        )
    samples: dict[str, dict[str, tuple[int, int]]] = {}
    for info in infos:
        folder, _, name = info.name.rpartition("/")
        stem, _, member = name.partition(".")
        held = samples.setdefault(f"{folder}/{stem}", {})
        if member in held:
            raise Avs3dError(f"{path}: {info.name} is in the shard twice; write it again")
        held[member] = (info.offset_data, info.size)
    return digest, [_entry(path, key, found, data) for key, found in samples.items()]


def _padded(offset: int) -> int:
    """Where the next member begins."""
    return -(-offset // tarfile.BLOCKSIZE) * tarfile.BLOCKSIZE


def _entry(path: Path, key: str, members: dict[str, tuple[int, int]], data: bytes) -> FrameEntry:
    for name, what in _REQUIRED.items():
        if name not in members:
            raise Avs3dError(
                f"{path}: {key} has no {what} ({name}); the listener is trained on frames with all of them"
            )
    offset, size = members["json"]
    try:
        facts = json.loads(data[offset : offset + size])
        audible, other, lateral, source = _heard(facts)
        response = next(
            (name for name in ("rir.npz", f"{source}.rir.npz") if source is not None and name in members), None
        )
        (fx, _, cx), (_, fy, cy), _ = facts["intrinsics"]
        width, height = facts["width"], facts["height"]
        return FrameEntry(
            key=key,
            group=f"{facts.get('group') or facts['key']}/{facts['frame']}",
            home=facts["scan"],
            audible=audible,
            other=other,
            lateral=lateral,
            camera=(fx / width, fy / height, cx / width, cy / height),
            width=int(width),
            instances=tuple((i["id"], _CLASS[i["category"]]) for i in facts["instances"] if i["category"] in _CLASS),
            response=response,
            members={name: members[name] for name in (*_REQUIRED, response) if name},
        )
    except (KeyError, TypeError, ValueError) as error:
        kind = type(error).__name__
        raise Avs3dError(f"{path}: {key}.json lacks facts or is damaged ({kind}: {error}); export it again") from None


def _heard(facts: dict[str, Any]) -> tuple[tuple[str, ...], bool, float, str | None]:
    """The audible categories, whether something of no class is heard, and the only source: lateral angle and id.

    The angle is NaN and the id None if there is no source, or several.
    """
    if "audible" in facts:
        category = {source["id"]: source["category"] for source in facts["sources"]}
        names = [category[each["source"]] for each in facts["audible"]]
        first = facts["sources"][0]["id"] if facts["sources"] else None
        only = [each["source"] for each in facts["audible"]] == [first]
    else:
        loudest = max(facts["rms_left"], facts["rms_right"])
        only = loudest > 10 ** (AUDIBLE_LEVEL_DB / 20)
        names, first = ([facts["category"]] if only else []), "source_1"
    azimuth, elevation = facts["azimuth"], facts["elevation"]
    known = only and azimuth is not None and elevation is not None
    lateral = math.asin(math.sin(math.radians(azimuth)) * math.cos(math.radians(elevation))) if known else math.nan
    known_names = {name for name in names if name in _CLASS}
    return tuple(sorted(known_names)), bool(set(names) - known_names), lateral, first if only else None


def read_store(
    root: str | Path, folder: str | Path, *, workers: int | None = None, progress: bool = False
) -> ShardStore:
    """The frames of all shards below ``root``; what is stored in ``folder`` already is mapped, not read again.

    Args:
        root: folder with shards.
        folder: where the arrays go.
        workers: processes; None: one per core.
        progress: show bars on stderr.

    Raises:
        UsageError: if there are no shards, or ``folder`` holds something else.
        Avs3dError: if a shard is damaged or lacks what training needs, or the system refuses.
    """
    folder, shards = Path(folder), list_shards(root)
    read = dict(process_each(index_shard, shards, workers=workers, label="index of shards", progress=progress))
    found = {shard.path: read[shard] for shard in shards}
    names = "".join(f"{path.relative_to(root).as_posix()} {digest}\n" for path, (digest, _) in found.items())
    digest = hashlib.sha256(names.encode()).hexdigest()
    if stored := open_store(folder, digest):
        return stored
    entries = [(path, entry) for path, (_, mine) in found.items() for entry in mine]
    first_in: dict[str, Path] = {}
    for path, entry in entries:
        if first_in.setdefault(entry.key, path) != path:
            raise Avs3dError(
                f"{path}: {entry.key} is in {first_in[entry.key]} as well; expected each frame in one shard"
            )
    table, first = _table(digest, [entry for _, entry in entries])
    jobs: dict[Path, list[tuple[int, int | None, FrameEntry]]] = {}
    for number, (path, entry) in enumerate(entries):
        view = table.view[number]
        jobs.setdefault(path, []).append((number, view if first[view] == number else None, entry))
    with staged_folder(folder, refuse_others) as fresh:
        count = len(table.keys)
        shapes = _shapes(len(table.groups), count, table.side, count if any(table.has_response) else 0)
        for name, (shape, kind) in shapes.items():
            np.lib.format.open_memmap(fresh / f"{name}.npy", "w+", dtype=kind, shape=shape).flush()
        decode = partial(_decode_shard, fresh)
        sizes = [len(job) for job in jobs.values()]
        for _ in process_each(
            decode, list(jobs.items()), workers=workers, label="frames", progress=progress, sizes=sizes
        ):
            pass
        write_json(fresh / TABLE, asdict(table))
    opened = open_store(folder, digest)
    assert opened is not None
    return opened


def refuse_others(folder: Path) -> None:
    """Refuse a folder that holds anything but stored frames: it is replaced as a whole.

    Raises:
        UsageError: naming what is there.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder}: found a file, expected a folder for the frames of the shards; move it away")
    own = {TABLE, *(f"{name}.npy" for name in _shapes(0, 0))}
    foreign = sorted(path.name for path in folder.iterdir() if path.name not in own)
    if foreign:
        raise UsageError(f"{folder}: holds {foreign[0]}, which is no part of stored frames; move it away")
    check_replaceable(folder / TABLE, (_TABLE_SIGNATURE,))


def open_store(folder: str | Path, digest: str | None = None) -> ShardStore | None:
    """Map what is stored; None if there is nothing, or it comes from other shards."""
    folder = Path(folder)
    try:
        table = ShardTable(**json.loads((folder / TABLE).read_text()))
    except (OSError, ValueError, TypeError):
        return None
    if table.version != VERSION or (digest is not None and table.digest != digest):
        return None
    # Copy-on-write: torch takes arrays that can be written to; nothing is.
    return ShardStore(table, **{name: np.load(folder / f"{name}.npy", mmap_mode="c") for name in _shapes(0, 0)})


def _table(digest: str, entries: Sequence[FrameEntry]) -> tuple[ShardTable, list[int]]:
    """The table, and for each picture the sound whose sample it is read from."""
    names = list(_CLASS)
    views: dict[str, int] = {}
    first: list[int] = []
    for number, entry in enumerate(entries):
        if entry.group not in views:
            views[entry.group] = len(first)
            first.append(number)
    shown = [entries[number] for number in first]
    table = ShardTable(
        version=VERSION,
        side=FINE if any(entry.width > SIDE for entry in entries) else SIDE,
        digest=digest,
        keys=[entry.key for entry in entries],
        view=[views[entry.group] for entry in entries],
        audible=[list(entry.audible) for entry in entries],
        others=[entry.other for entry in entries],
        lateral=[None if math.isnan(entry.lateral) else entry.lateral for entry in entries],
        has_response=[entry.response is not None for entry in entries],
        groups=[entry.group for entry in shown],
        homes=[entry.home for entry in shown],
        cameras=[list(entry.camera) for entry in shown],
        present=[sorted({names[number - 1] for _, number in entry.instances}) for entry in shown],
    )
    return table, first


def _decode_shard(folder: Path, job: tuple[Path, list[tuple[int, int | None, FrameEntry]]]) -> None:
    """Decode frames of a shard into the arrays; of each sound (its number, its picture if it is read here, entry)."""
    path, frames = job
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r+") for name in _shapes(0, 0)}
    side = arrays["classes"].shape[1]
    with path.open("rb") as stream:
        for done, (number, view, entry) in enumerate(frames, start=1):
            wanted = [name for name in entry.members if view is not None or name not in _OF_PICTURE]
            raw: dict[str, Any] = {"__key__": f"{path}: {entry.key}"}
            for name in wanted:
                offset, size = entry.members[name]
                stream.seek(offset)
                raw[name] = stream.read(size)
            sample = decode_sample(raw)
            if sample["binaural"].shape != (2, layout.SAMPLE_RATE):
                shape = sample["binaural"].shape
                raise Avs3dError(f"{path}: {entry.key}: sound of shape {shape}, expected (2, {layout.SAMPLE_RATE})")
            arrays["sounds"][number] = sample["binaural"]
            arrays["coded"][number] = drawn(sample["binaural"], np.random.default_rng([38, *entry.key.encode()]))
            if entry.response:
                arrays["responses"][number] = _response(sample)
            mask = fit(sample["mask"].astype(np.uint8), side, cv2.INTER_NEAREST)
            arrays["masks"][number], arrays["marked"][number] = np.packbits(mask, axis=-1), np.count_nonzero(mask)
            if view is not None:
                arrays["pictures"][view] = fit(sample["rgb"].transpose(1, 2, 0), side, cv2.INTER_AREA)
                lookup = np.zeros(int(sample["instance_ids"].max()) + 1, np.uint8)
                for instance, label in entry.instances:
                    if instance < len(lookup):
                        lookup[instance] = label
                arrays["classes"][view] = fit(lookup[sample["instance_ids"]], side, cv2.INTER_NEAREST)
                arrays["extents"][view] = extents(arrays["classes"][view], entry.camera)
            advance(done, len(frames))


def _response(sample: dict[str, Any]) -> NDArray[np.float32]:
    """(2, 44100) the first second of the impulse response of a decoded sample that has one, with a peak of 1."""
    whole = sample.get("impulse_response")
    if whole is None:
        (whole,) = sample["impulse_responses"].values()
    first = whole[:, : layout.SAMPLE_RATE]
    out = np.zeros((2, layout.SAMPLE_RATE), np.float32)
    out[:, : first.shape[1]] = first / max(float(np.abs(first).max()), 1e-20)
    return out


def fit(pixels: NDArray[np.uint8], side: int, how: int) -> NDArray[np.uint8]:
    """Pixels (H, W[, C]) as a square of some side; the field of view stays."""
    if pixels.shape[:2] == (side, side):
        return pixels
    return np.asarray(cv2.resize(np.ascontiguousarray(pixels), (side, side), interpolation=how), np.uint8)


def extents(classes: NDArray[np.uint8], camera: Sequence[float]) -> NDArray[np.float32]:
    """(7, 2) lowest and highest lateral angle (rad) at which each category is visible, NaN if it is not."""
    fx, fy, cx, cy = camera
    height, width = classes.shape
    x = ((np.arange(width) + 0.5) / width - cx) / fx
    y = ((np.arange(height)[:, None] + 0.5) / height - cy) / fy
    lateral = np.arcsin(x / np.sqrt(x**2 + y**2 + 1))
    out = np.full((len(CATEGORIES), 2), np.nan, np.float32)
    for label in np.unique(classes[classes > 0]):
        seen = lateral[classes == label]
        out[label - 1] = seen.min(), seen.max()
    return out
