"""A small but fully valid dataset of part_3, made by hand in the room of `tiny`: one group of five siblings.

Two microwaves (ids 1 and 3) and a telephone (id 2) are in view. No generator is involved.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import (
    AUDIBLE_LEVEL_DB,
    AUDIBLE_SNR_DB,
    AcousticsRecord,
    AttributionRecord,
    AudibleRecord,
    BackgroundRecord,
    CameraSplits,
    DatasetEntry,
    DatasetRecord,
    FrameRecord,
    InstanceRecord,
    IntrinsicsRecord,
    ObservationRecord,
    SourceRecord,
    VisionRecord,
)
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import write_model
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from tests.support.tiny import (
    FRAMES,
    LICENCE,
    RATE,
    SIZE,
    Box,
    _sees,
    colmap_model,
    hashes,
    mono_of,
    path_of,
    render,
    response_of,
)

FIRST, SECOND, BOTH, SILENT, AWAY = (f"part_3/tiny/kitchen/{number}" for number in range(1, 6))
GROUP = (FIRST, SECOND, BOTH, SILENT, AWAY)
BOXES = (
    Box(1, "microwave", False, (-1.5, 1.0, -2.6), (-0.9, 1.4, -2.2)),
    Box(2, "telephone", False, (-0.2, 1.0, -2.6), (0.1, 1.2, -2.3)),
    Box(3, "microwave", False, (0.4, 1.0, -2.6), (1.0, 1.4, -2.2)),
)
#: Where the source of the next room is.
ELSEWHERE = (-6.0, 1.2, 0.0)
_MANIFEST = 'name: tiny-scenes\nversion: "1"\nseed: 1\n'


@dataclass(frozen=True)
class Playing:
    """A source: the box that sounds (None: off-screen), when, and how loud."""

    box: int | None
    programme: tuple[tuple[float, float], ...] | None = None
    gain_db: float = 0.0

    def intervals(self, frames: int) -> tuple[tuple[float, float], ...]:
        """The programme in an observation of ``frames`` seconds: what is later is cut off."""
        found = ((-2.0, float(frames)),) if self.programme is None else self.programme
        return tuple((start, min(end, float(frames))) for start, end in found if start < frames)


#: Key → what sounds, and the SNR of a background.
SCENES: dict[str, tuple[tuple[Playing, ...], float | None]] = {
    FIRST: ((Playing(1),), None),
    SECOND: ((Playing(3),), None),
    BOTH: (
        (Playing(1, ((0.0, 2.0), (4.5, 6.0))), Playing(3, ((2.0, 4.5), (6.0, 10.0))), Playing(2, gain_db=-6.0)),
        20.0,
    ),
    SILENT: ((), None),
    AWAY: ((Playing(None),), 10.0),
}


def stems_of(
    poses: list[Pose], playing: Playing, seed: list[int]
) -> tuple[list[NDArray[np.float32]], tuple[float, float, float]]:
    """The clips of one source, and its position: noise with 1/r and a level difference, gated by its programme.

    Siblings differ in ``seed``: they never share a take.
    """
    position = ELSEWHERE if playing.box is None else BOXES[playing.box - 1].source
    signal = np.random.default_rng(seed).uniform(-0.2, 0.2, len(poses) * RATE) * 10 ** (playing.gain_db / 20)
    if playing.programme is not None:
        gate = np.zeros(len(signal))
        for start, end in playing.programme:
            gate[round(start * RATE) : round(end * RATE)] = 1.0
        signal = signal * gate
    seconds = signal.reshape(len(poses), RATE)
    loss = 0.2 if playing.box is None else 1.0
    return [
        (second * response_of(pose, position)[:, :1] * loss).astype(np.float32)
        for pose, second in zip(poses, seconds, strict=True)
    ], position


def diffuse_noise(seconds: int, spacing: float = 0.18) -> NDArray[np.float32]:
    """(seconds, 2, RATE) white noise at two points of a diffuse field: their coherence is sin(kd) / (kd)."""
    one, other = np.fft.rfft(np.random.default_rng(99).standard_normal((2, seconds * RATE)))
    coherence = np.sinc(2 * np.fft.rfftfreq(seconds * RATE, 1 / RATE) * spacing / 343)
    ears = np.fft.irfft([one, coherence * one + np.sqrt(1 - coherence**2) * other], seconds * RATE)
    return ears.reshape(2, seconds, RATE).transpose(1, 0, 2).astype(np.float32)


def level_db(clip: NDArray[np.floating]) -> float:
    """RMS over all samples, dB re full scale; −inf for silence."""
    power = float(np.mean(np.square(clip, dtype=np.float64)))
    return 10 * math.log10(power) if power else -math.inf


def _part_3(
    folder: Path, key: str, frames: int, size: int, *, stems: bool, rirs: bool = False, points: int = 4
) -> ObservationRecord:
    place = layout.parse_key(key)
    playing, snr = SCENES[key]
    camera, poses = Intrinsics.from_fov(size), path_of(frames)
    first = folder.parent / GROUP[0].rpartition("/")[2]
    categories = {name: number for number, name in enumerate(("washing_machine", "toilet", "vacuum_cleaner",
                  "microwave", "coffee_machine", "clock", "telephone"), start=1)}  # fmt: skip
    parts: dict[str, list[NDArray[np.float32]]] = {}
    sources: list[SourceRecord] = []
    for number, one in enumerate(playing, start=1):
        name = f"source_{number}"
        parts[name], position = stems_of(poses, one, [place.index, number])
        box = None if one.box is None else BOXES[one.box - 1]
        sources.append(
            SourceRecord(
                id=name, instance=one.box, category=box.category if box else "telephone",
                room="kitchen" if box else "living_room", position=position,
                programme=one.intervals(frames), gain_db=one.gain_db, asset="noise",
                licence=LICENCE,
            )
        )  # fmt: skip
    background = None
    if snr is not None:
        power = np.mean([sum(10 ** (level_db(parts[name][i]) / 10) for name in parts) for i in range(frames)])
        level = 10 * math.log10(power) - snr
        noise = diffuse_noise(frames)
        noise *= np.float32(10 ** (level / 20)) / np.sqrt(np.mean(np.square(noise, dtype=np.float64))).astype(
            np.float32
        )
        parts[layout.BACKGROUND] = list(noise)
        background = BackgroundRecord(kind="noise", snr_db=snr, level_db=level)
    silence = np.zeros((2, RATE), dtype=np.float32)
    clips = [sum((parts[name][i] for name in parts), start=silence.copy()) for i in range(frames)]
    records = []
    for i, pose in enumerate(poses):
        rgb, ids, _ = render(camera, pose, BOXES)
        audible = []
        for source in sources:
            stem = parts[source.id][i]
            level, rest = level_db(stem), level_db(clips[i].astype(np.float64) - stem)
            if level >= AUDIBLE_LEVEL_DB and level - rest >= AUDIBLE_SNR_DB:
                quiet = rest < -150  # what rounding leaves
                audible.append(AudibleRecord(source=source.id, level_db=level, drr_db=None if source.instance is None
                               else 60.0, snr_db=None if quiet else level - rest))  # fmt: skip
        heard = [next(s.instance for s in sources if s.id == entry.source) for entry in audible]
        mask = np.isin(ids, [n for n in heard if n is not None])
        kinds = np.zeros_like(ids)
        for box in BOXES:
            kinds[mask & (ids == box.id)] = categories[box.category]
        picture = folder / layout.image_path("input", i)
        if key == FIRST:
            media.write_png_rgb(picture, rgb)
            media.write_png_ids(folder / layout.image_path("instance_masks", i), ids)
        else:
            media.link_or_copy(first / layout.image_path("input", i), picture)
            there = layout.image_path("instance_masks", i)
            media.link_or_copy(first / there, folder / there)
        media.link_or_copy(picture, folder / layout.image_path("images", i))
        media.write_png_mask(folder / layout.image_path("semantic_masks", i), mask)
        media.write_png_categories(folder / layout.image_path("category_masks", i), kinds)
        media.write_wav(folder / layout.audio_path("audio_clips_binaural", i), clips[i])
        media.write_wav(folder / layout.audio_path("audio_clips_mono", i), mono_of(clips, i))
        for name in parts if stems else ():
            media.write_wav(folder / layout.stem_path(name, i), parts[name][i])
        for source in sources if rirs else ():
            media.write_rir(folder / layout.rir_path(i, source.id), response_of(pose, source.position))
        where = direction_to(pose, sources[0].position) if sources else None
        rms = np.sqrt(np.mean(clips[i].astype(float) ** 2, axis=1))
        records.append(
            FrameRecord(
                name=layout.frame_name(i), time=float(i), position=pose.position, rotation=pose.rotation,
                visible_pixels=int(mask.sum()), azimuth=where and where.azimuth, elevation=where and where.elevation,
                distance=where and where.distance,
                line_of_sight=None if where is None else sources[0].instance is not None
                and _sees(pose.position, sources[0].position, BOXES),
                rms_left=rms[0], rms_right=rms[1], audible=tuple(audible),
            )
        )  # fmt: skip
    write_model(folder / "sparse/0", colmap_model(camera, poses, BOXES, points))
    media.write_json(folder / "camera_splits.json", CameraSplits.of(frames))
    sounding = [box for box in BOXES if any(source.instance == box.id for source in sources)]
    if sounding:
        meshes = [box.mesh() for box in sounding]
        corners = np.concatenate([vertices for vertices, _ in meshes])
        faces = np.concatenate([faces + 8 * n for n, (_, faces) in enumerate(meshes)])
        media.write_ply_mesh(folder / "gt_3d/sounding_object.ply", corners, faces)
    record = ObservationRecord(
        schema_version="1.1", key=key, part="part_3", scan=place.scan, room="kitchen", index=place.index,
        category=sources[0].category if sources else None, seed=1,
        source_position=sources[0].position if sources else None, sources=tuple(sources), background=background,
        group=FIRST, intrinsics=IntrinsicsRecord.of(camera),
        instances=tuple(
            InstanceRecord(
                id=box.id, category=box.category, sounding=box in sounding, position=box.low, rotation=(1, 0, 0, 0),
                bounds=(box.low, box.high), asset="box", licence=LICENCE,
            )
            for box in BOXES
        ),
        acoustics=AcousticsRecord(backend="tiny", version="1", sample_rate=RATE, gain=1.0, settings={"law": "1/r"}),
        vision=VisionRecord(backend="tiny", version="1"), frames=tuple(records), files=hashes(folder),
    )  # fmt: skip
    media.write_json(folder / "observation.json", record)
    return record


def write_part_3(
    root: Path,
    *,
    frames: int = FRAMES,
    size: int = SIZE,
    stems: bool = False,
    rirs: bool = False,
    points: int = 4,
    keys: tuple[str, ...] = GROUP,
) -> Path:
    """A valid tree with the siblings ``keys`` (the first of the group must be among them)."""
    records = [_part_3(root / key, key, frames, size, stems=stems, rirs=rirs, points=points) for key in keys]
    entries = [
        DatasetEntry.of(r, hashlib.sha256((root / r.key / "observation.json").read_bytes()).hexdigest())
        for r in sorted(records, key=lambda r: r.key)
    ]
    media.write_json(
        root / "dataset.json",
        DatasetRecord(
            schema_version="1.1", name="tiny-scenes", version="1", toolkit_version=__version__, manifest=_MANIFEST,
            manifest_sha256=hashlib.sha256(_MANIFEST.encode()).hexdigest(), backends={"tiny": "1"}, licence="CC0-1.0",
            attributions=tuple(AttributionRecord(asset=one, **LICENCE.model_dump()) for one in ("box", "noise")),
            observations=tuple(entries),
        ).sealed(),
    )  # fmt: skip
    return root
