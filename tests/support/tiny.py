"""A small but fully valid dataset, made by hand: a box room with box-shaped objects, ray-traced in closed form.

No generator is involved, so that the contract has a witness of its own. `write_dataset` writes a tree of ours (one
single- and one multi-instance observation), `write_release` one that looks like the official release.
"""

from __future__ import annotations

import hashlib
import math
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    AcousticsRecord,
    AttributionRecord,
    CameraSplits,
    DatasetEntry,
    DatasetRecord,
    FrameRecord,
    InstanceRecord,
    IntrinsicsRecord,
    LicenceRecord,
    ObservationRecord,
    SoundRecord,
    VisionRecord,
)
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import ColmapModel, write_model
from avs3d_bench.geometry import Intrinsics, Pose, direction_to

SINGLE = "part_1/tiny/kitchen/1"
MULTI = "part_2/tiny/kitchen/1"
FRAMES, SIZE = 10, 64
RATE = layout.SAMPLE_RATE
LICENCE = LicenceRecord(name="CC0-1.0", author="avs3d-bench", source="procedural")
_ROOM = np.array([[-3.0, 0.0, -4.0], [3.0, 2.6, 3.0]])
_MANIFEST = 'name: tiny\nversion: "1"\nseed: 1\n'


@dataclass(frozen=True)
class Box:
    """An instance: an axis-aligned box."""

    id: int
    category: str
    sounding: bool
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def source(self) -> tuple[float, float, float]:
        """The middle of the front face (+Z)."""
        return ((self.low[0] + self.high[0]) / 2, (self.low[1] + self.high[1]) / 2, self.high[2])

    def mesh(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
        return corners * np.subtract(self.high, self.low) + self.low, np.array(faces)


BOXES = {
    SINGLE: (
        Box(1, "microwave", True, (-0.3, 1.0, -2.6), (0.3, 1.4, -2.2)),
        Box(2, "oven", False, (0.9, 0.3, -2.6), (1.5, 0.9, -2.0)),
    ),
    MULTI: (
        Box(1, "microwave", False, (-1.5, 1.0, -2.6), (-0.9, 1.4, -2.2)),
        Box(2, "microwave", True, (0.4, 1.0, -2.6), (1.0, 1.4, -2.2)),
    ),
}
#: Keys of the observations of `make demo`, which README.md names.
DEMO = ("part_1/apartment_1/bathroom/1", "part_2/apartment_1/kitchen/1")
BOXES |= dict(zip(DEMO, (BOXES[SINGLE], BOXES[MULTI]), strict=True))


def path_of(frames: int = FRAMES) -> list[Pose]:
    """Past the object from left to right; from the ninth on the last two poses look away."""
    xs = np.linspace(-1.8, 1.8, frames)
    return [Pose.from_yaw((x, 1.5, 0.02 * i), 2.2 if i >= max(8, frames - 2) else 0.1) for i, x in enumerate(xs)]


def _entry(origin: NDArray[Any], rays: NDArray[Any], low: Any, high: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Ray parameters where rays enter and leave a box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (np.asarray(low) - origin) / rays, (np.asarray(high) - origin) / rays
    return np.fmin(a, b).max(axis=-1), np.fmax(a, b).min(axis=-1)


def render(camera: Intrinsics, pose: Pose, boxes: tuple[Box, ...]) -> tuple[Any, Any, Any]:
    """(rgb, ids, depth): rays through pixel centres, exact."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    local = np.stack([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -np.ones_like(u)], axis=-1)
    rays, origin = local @ pose.rotation_matrix.T, np.asarray(pose.position)
    _, depth = _entry(origin, rays, *_ROOM)
    ids = np.zeros(depth.shape, dtype=np.uint8)
    for box in boxes:
        near, far = _entry(origin, rays, box.low, box.high)
        hit = (near < far) & (near > 0) & (near < depth)
        depth, ids = np.where(hit, near, depth), np.where(hit, box.id, ids).astype(np.uint8)
    spot = origin + rays * depth[..., None]
    shade = 110 + 60 * np.sin(spot * 3.0) + np.array([20, 0, -20]) + 15 * ids[..., None]
    return shade.clip(0, 255).astype(np.uint8), ids, depth


def _sees(position: Any, target: Any, boxes: tuple[Box, ...]) -> bool:
    ray = np.subtract(target, position)
    for box in boxes:
        near, far = _entry(np.asarray(position), ray, box.low, box.high)
        if near < far and 0 < near < 1 - 1e-6:
            return False
    return True


def clips_of(poses: list[Pose], source: Any, seed: int = 0) -> list[NDArray[np.float32]]:
    """Noise with 1/r and a level difference of 12·sin(azimuth) dB."""
    signal = np.random.default_rng(seed).uniform(-0.2, 0.2, (len(poses), RATE))
    out = []
    for pose, second in zip(poses, signal, strict=True):
        out.append((second * response_of(pose, source)[:, :1]).astype(np.float32))
    return out


def response_of(pose: Pose, source: Any) -> NDArray[np.float64]:
    """(2, 8) the impulse response of `clips_of`: one tap."""
    where = direction_to(pose, source)
    half = 10 ** (12 * math.sin(math.radians(where.azimuth)) / 40)
    return np.array([[1 / half], [half]]) / where.distance * np.eye(1, 8)


def mono_of(clips: list[NDArray[np.float32]], index: int) -> NDArray[np.float32]:
    """The 2 s clip: half a second of both neighbours; a train frame takes nothing from a test frame."""
    mix = [clip.mean(axis=0) for clip in clips]
    mine = index % 8 == 0
    before = index > 0 and (mine or (index - 1) % 8 != 0)
    after = index + 1 < len(clips) and (mine or (index + 1) % 8 != 0)
    half = RATE // 2
    if before and after:
        return np.concatenate([mix[index - 1][half:], mix[index], mix[index + 1][:half]])
    if before:
        return np.concatenate([mix[index - 1], mix[index]])
    if after:
        return np.concatenate([mix[index], mix[index + 1]])
    return np.concatenate([mix[index][half:], mix[index], mix[index][:half]])


def colmap_model(
    camera: Intrinsics,
    poses: list[Pose],
    boxes: tuple[Box, ...],
    points: int = 4,
    draw: Callable[[], tuple[Any, Any]] | None = None,
) -> ColmapModel:
    """The sparse model of these poses, with exact points: ``points``² of each frame, or those that ``draw`` gives."""
    positions, colours, tracks = [], [], []
    for number, pose in enumerate(poses):
        rgb, _, depth = render(camera, pose, boxes)
        step = max(2, camera.height // points)
        grid = np.mgrid[1 : camera.height : step, 1 : camera.width : step].reshape(2, -1)
        rows, columns = grid if draw is None else draw()
        centres = np.stack([columns, rows], axis=1) + 0.5
        lifted = camera.unproject(pose, centres, depth[rows, columns])
        projected = [camera.project(there, lifted) for there in poses]
        for which, (xyz, colour) in enumerate(zip(lifted, rgb[rows, columns], strict=True)):
            seen = []
            for other, there in enumerate(poses):
                pixel, z = projected[other][0][which], projected[other][1][which]
                if not (z > 0 and 0 <= pixel[0] < camera.width and 0 <= pixel[1] < camera.height):
                    continue
                if other == number or _sees(there.position, xyz, boxes):
                    seen.append((len(positions), other, *pixel))
            if len(seen) >= min(2, len(poses)):
                tracks += seen
                positions.append(xyz)
                colours.append(colour)
    table = np.array(tracks)
    names = [f"{layout.frame_name(i)}.png" for i in range(len(poses))]
    return ColmapModel.from_poses(
        camera, names, poses, np.array(positions), np.array(colours), table[:, 0], table[:, 1], table[:, 2:]
    )


def _observation(
    folder: Path, key: str, frames: int, size: int, *, ours: bool, extras: bool, points: int = 4
) -> ObservationRecord | None:
    place, boxes = layout.parse_key(key), BOXES[key]
    sounding = next(box for box in boxes if box.sounding)
    camera, poses = Intrinsics.from_fov(size), path_of(frames)
    clips = clips_of(poses, sounding.source)
    subtype = "float" if ours else "pcm16"
    records = []
    for i, pose in enumerate(poses):
        rgb, ids, depth = render(camera, pose, boxes)
        mask = ids == sounding.id
        media.write_png_rgb(folder / layout.image_path("input", i), rgb)
        media.link_or_copy(folder / layout.image_path("input", i), folder / layout.image_path("images", i))
        media.write_png_mask(folder / layout.image_path("semantic_masks", i), mask)
        media.write_wav(folder / layout.audio_path("audio_clips_binaural", i), clips[i], subtype=subtype)
        media.write_wav(folder / layout.audio_path("audio_clips_mono", i), mono_of(clips, i), subtype=subtype)
        if ours:
            media.write_png_ids(folder / layout.image_path("instance_masks", i), ids)
        if extras:
            media.write_png_depth_mm(folder / layout.image_path("depth", i), depth)
            media.write_rir(folder / layout.rir_path(i), response_of(pose, sounding.source))
        where = direction_to(pose, sounding.source)
        rms = np.sqrt(np.mean(clips[i].astype(float) ** 2, axis=1))
        records.append(
            FrameRecord(
                name=layout.frame_name(i), time=float(i), position=pose.position, rotation=pose.rotation,
                visible_pixels=int(mask.sum()), azimuth=where.azimuth, elevation=where.elevation,
                distance=where.distance, line_of_sight=_sees(pose.position, sounding.source, boxes),
                rms_left=rms[0], rms_right=rms[1],
            )
        )  # fmt: skip
    write_model(folder / "sparse/0", colmap_model(camera, poses, boxes, points))
    if not ours:
        return None
    media.write_json(folder / "camera_splits.json", CameraSplits.of(frames))
    media.write_ply_mesh(folder / "gt_3d/sounding_object.ply", *sounding.mesh())
    instances = tuple(
        InstanceRecord(
            id=box.id, category=box.category, sounding=box.sounding, position=box.low, rotation=(1, 0, 0, 0),
            bounds=(box.low, box.high), asset="box", licence=LICENCE,
        )
        for box in boxes
    )  # fmt: skip
    record = ObservationRecord(
        key=key, part=place.part, scan=place.scan, room=place.room, index=place.index, category=sounding.category,
        seed=1, source_position=sounding.source, intrinsics=IntrinsicsRecord.of(camera), instances=instances,
        sound=SoundRecord(asset="noise", licence=LICENCE),
        acoustics=AcousticsRecord(backend="tiny", version="1", sample_rate=RATE, gain=1.0, settings={"law": "1/r"}),
        vision=VisionRecord(backend="tiny", version="1"), frames=tuple(records), files=hashes(folder),
    )  # fmt: skip
    media.write_json(folder / "observation.json", record)
    return record


def hashes(folder: Path) -> dict[str, str]:
    """sha256 of every file below ``folder`` but observation.json."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "observation.json")
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def write_dataset_json(root: Path, records: list[ObservationRecord]) -> None:
    """dataset.json for the observations below ``root``."""
    entries = [
        DatasetEntry.of(r, hashlib.sha256((root / r.key / "observation.json").read_bytes()).hexdigest())
        for r in sorted(records, key=lambda r: r.key)
    ]
    media.write_json(
        root / "dataset.json",
        DatasetRecord(
            name="tiny", version="1", toolkit_version=__version__, manifest=_MANIFEST,
            manifest_sha256=hashlib.sha256(_MANIFEST.encode()).hexdigest(), backends={"tiny": "1"}, licence="CC0-1.0",
            attributions=tuple(AttributionRecord(asset=one, **LICENCE.model_dump()) for one in ("box", "noise")),
            observations=tuple(entries),
        ).sealed(),
    )  # fmt: skip


def write_dataset(
    root: Path,
    *,
    frames: int = FRAMES,
    size: int = SIZE,
    extras: bool = False,
    points: int = 4,
    keys: tuple[str, ...] = (SINGLE, MULTI),
) -> Path:
    """A valid tree of ours; with ``extras`` also depth/ and rirs/; from each frame come ``points``² sparse points."""
    records = [_observation(root / key, key, frames, size, ours=True, extras=extras, points=points) for key in keys]
    write_dataset_json(root, [record for record in records if record])
    return root


def write_release(root: Path, *, style: str = "names", frames: int = FRAMES, size: int = SIZE) -> Path:
    """A tree as the official release has it.

    ``style`` of camera_splits.json: ``names`` (train/test), ``files`` (with extensions), ``cameras`` (keys
    train_cameras/test_cameras), ``absent``.
    """
    for key in (SINGLE, MULTI):
        _observation(root / key, key, frames, size, ours=False, extras=False)
        split = {"train": [f"frame_{i:03d}" for i in range(frames) if i % 8],
                 "test": [f"frame_{i:03d}" for i in range(frames) if not i % 8]}  # fmt: skip
        if style == "files":
            split = {part: [f"{name}.png" for name in names] for part, names in split.items()}
        if style == "cameras":
            split = {f"{part}_cameras": names for part, names in split.items()}
        if style != "absent":
            media.write_json(root / key / "camera_splits.json", split)
    return root


def clone(source: Path, target: Path) -> Path:
    """A copy whose files may be replaced (not written in place): hard links, so that it costs nothing."""
    shutil.copytree(source, target, copy_function=os.link)
    return target


def replace(path: Path, data: bytes) -> None:
    """Put ``data`` in place of a file without touching its hard links."""
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def write_sealed(root: Path, data: dict[str, Any]) -> None:
    """Put ``data`` in place of dataset.json with its digest, whether it fits the schema or not."""
    data.pop("digest", None)
    with suppress(ValidationError):
        data["digest"] = DatasetRecord.model_validate(data).contents_digest()
    replace(root / "dataset.json", media.dump_json(data).encode())


def edit_record(root: Path, key: str, change: Callable[[dict[str, Any]], None], *, rehash: bool = True) -> None:
    """Change observation.json by hand; with ``rehash`` its file hashes and dataset.json's digest follow."""
    path = root / key / "observation.json"
    data = media.read_json(path)
    change(data)
    if rehash:
        data["files"] = hashes(root / key)
        if data.get("sizes") is not None:
            data["sizes"] = {name: (root / key / name).stat().st_size for name in data["files"]}
    replace(path, media.dump_json(data).encode())
    if rehash and (root / "dataset.json").exists():
        dataset = media.read_json(root / "dataset.json")
        for entry in dataset["observations"]:
            file = root / entry["key"] / "observation.json"
            entry["digest"] = hashlib.sha256(file.read_bytes()).hexdigest()
        write_sealed(root, dataset)
