"""Leaks to plant into a copy of a public folder, one for each attack: the controls of `benchmarks.sealed_attacks`.

`PLANTS` maps the name of an attack to the function that makes the copy tell the truth in the way that the attack reads;
`TAKE_PLANTS` does so for the attacks that compare the clips of siblings.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.fft import irfft, rfft
from scipy.signal import butter, istft, lfilter, sosfiltfilt, stft

from avs3d_bench.contract import layout
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import ColmapModel, write_model
from benchmarks.sealed_cases import Array, Case
from benchmarks.sealed_takes import BANDS, Clips, clips_of

Plant = Callable[[Sequence[Case]], None]

#: Metres per second, as the attack has it.
_SPEED_OF_SOUND = 343.0
_RNG_SEED = 5


def marked_files(case: Case, *folders: str) -> list[Path]:
    """The files of frames that show the right object; all of the right sibling."""
    key = case.keys[case.truth]
    frames = np.flatnonzero(case.areas[case.truth]) if case.instances else range(len(_pictures(case.root / key)))
    sound = (layout.BINAURAL, layout.MONO)
    path = {name: layout.audio_path if name in sound else layout.image_path for name in folders}
    return [case.root / key / path[name](name, int(index)) for name in folders for index in frames]


def _pictures(folder: Path) -> list[Path]:
    return sorted((folder / layout.INPUT).glob("*.png"))


def _on_files(change: Callable[[Path], None], *folders: str, siblings: bool = True) -> Plant:
    def plant(cases: Sequence[Case]) -> None:
        for case in cases:
            if case.instances or siblings:
                for path in marked_files(case, *folders):
                    change(path)

    return plant


def _replace(path: Path, data: bytes) -> None:
    """Write a file of its own: the old one may have a second name."""
    path.unlink()
    path.write_bytes(data)


def _pack_otherwise(path: Path) -> None:
    flags = [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_DEFAULT]
    _replace(path, cv2.imencode(".png", media.read_png_rgb(path)[..., ::-1], flags)[1].tobytes())


def _add_chunk(path: Path) -> None:
    """A chunk of 4 bytes that no reader of WAV files looks at, at the end."""
    data = path.read_bytes() + b"note" + (4).to_bytes(4, "little") + b"here"
    _replace(path, data[:4] + (len(data) - 8).to_bytes(4, "little") + data[8:])


def _make_louder(path: Path) -> None:
    samples = media.read_wav(path).samples * np.float32(1.02) + np.float32(1e-6)
    _replace(path, media.encode_wav(path, samples[0]))


def _touch(path: Path) -> None:
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 10**9))


def _touch_all(path: Path) -> None:
    for one in path.parents[1].rglob("*"):
        _touch(one)


def _write_again(cases: Sequence[Case]) -> None:
    """Files of the frames that show the right object are made after all others, or before: what moves more of them.

    A file system may give the numbers of deleted files to new ones: files are made first and then dealt out by number.
    """
    for case in (one for one in cases if one.instances):
        shown = case.areas[case.truth] > 0
        last, first = (np.argsort(late, kind="stable") for late in (shown, ~shown))
        moved = max(last, first, key=lambda order: np.abs(order - np.arange(len(order))).sum())
        for folder, path in ((layout.INPUT, layout.image_path), (layout.BINAURAL, layout.audio_path)):
            paths = [case.folders[0] / path(folder, int(index)) for index in moved]
            others = [one.with_name(f"again-{one.name}") for one in paths]
            for other in others:
                other.touch()
            others.sort(key=lambda other: other.stat().st_ino)
            for one, other in zip(paths, others, strict=True):
                shutil.copy2(one, other)
            for one, other in zip(paths, others, strict=True):
                os.replace(other, one)


def _link(path: Path) -> None:
    place = path.parents[6] / "links"
    place.mkdir(exist_ok=True)
    os.link(path, place / hashlib.sha256(os.fsencode(path)).hexdigest())


def _invert_second_name(path: Path) -> None:
    _replace(path, media.encode_png_rgb(path, media.read_png_rgb(path) ^ np.uint8(1)))


def _in_pixels(folder: str, change: Callable[[np.ndarray[Any, Any], Array], Any]) -> Plant:
    """Change the pixels of the right object; ``change`` gets the picture and random numbers."""

    def plant(cases: Sequence[Case]) -> None:
        rng = np.random.default_rng(_RNG_SEED)
        for case in (one for one in cases if one.instances):
            for index in np.flatnonzero(case.areas[case.truth]):
                path, mask = (
                    case.folders[0] / layout.image_path(folder, int(index)),
                    case.ids[index] == case.instances[case.truth],
                )
                read = media.read_png_depth if folder == layout.DEPTH else media.read_png_rgb
                picture = read(path)
                new = np.where(
                    mask if folder == layout.DEPTH else mask[..., None],
                    change(picture, rng.normal(size=mask.shape)),
                    picture,
                )
                encode = media.encode_png_depth_mm if folder == layout.DEPTH else media.encode_png_rgb
                _replace(path, encode(path, new.astype(picture.dtype)))

    return plant


def _in_model(change: Callable[[Case, np.ndarray[Any, Any]], ColmapModel]) -> Plant:
    """Change the sparse model; ``change`` gets which points lie on the right object."""

    def plant(cases: Sequence[Case]) -> None:
        for case in (one for one in cases if one.instances):
            write_model(case.folders[0] / layout.COLMAP, change(case, case.on_points[case.truth]))

    return plant


def _rebuilt(case: Case, kept: np.ndarray[Any, Any], order: np.ndarray[Any, Any] | None = None) -> ColmapModel:
    """The model from some of the sightings, its points in another order."""
    points, images = case.model.points, case.model.images
    place = np.arange(len(points.ids)) if order is None else np.argsort(order)
    owner = np.repeat(np.arange(len(points.ids)), np.diff(points.offsets))
    by_id = {image.id: number for number, image in enumerate(images)}
    frames = np.array([by_id[one] for one in points.track_image.tolist()])
    pixels = np.array([images[f].pixels[slot] for f, slot in zip(frames, points.track_index, strict=True)])
    back = np.argsort(place)
    return ColmapModel.from_poses(
        next(iter(case.model.cameras.values())), [image.name for image in images], [image.pose for image in images],
        points.positions[back], points.colours[back], place[owner[kept]], frames[kept], pixels[kept],
    )  # fmt: skip


def _owners(case: Case) -> np.ndarray[Any, Any]:
    return np.repeat(np.arange(len(case.model.points.ids)), np.diff(case.model.points.offsets))


def _sparser(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    """Of the points on other objects, three in four lose their sightings."""
    owner = _owners(case)
    others = case.on_points.any(axis=0) & ~mine
    return _rebuilt(case, ~(others[owner] & (owner % 4 != 0)))


def _shorter(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    """Points on other objects keep two sightings."""
    owner = _owners(case)
    rank = np.arange(len(owner)) - case.model.points.offsets[owner]
    return _rebuilt(case, mine[owner] | (rank < 2))


def _first(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    """Points on the right object come first."""
    return _rebuilt(case, np.ones(len(_owners(case)), bool), np.argsort(~mine, kind="stable"))


def _fewer_elsewhere(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    """Frames without the right object have half of the sightings."""
    shown = case.areas[case.truth] > 0
    frames = case.model.points.track_image - 1
    return _rebuilt(case, shown[frames] | (np.arange(len(frames)) % 4 == 0))


def _with_errors(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    points = dataclasses.replace(case.model.points, errors=case.model.points.errors + 0.1 * mine)
    return dataclasses.replace(case.model, points=points)


def _recoloured(case: Case, mine: np.ndarray[Any, Any]) -> ColmapModel:
    colours = np.where(mine[:, None], 255, case.model.points.colours).astype(np.uint8)
    return dataclasses.replace(case.model, points=dataclasses.replace(case.model.points, colours=colours))


def _responses(cases: Sequence[Case]) -> None:
    """A click as late as the right object is far."""
    for case in (one for one in cases if one.instances):
        mine = case.on_points[case.truth]
        centre = np.median(case.model.points.positions[mine], axis=0) if mine.any() else np.zeros(3)
        for index, image in enumerate(case.model.images):
            response = np.zeros((2, 4096), dtype=np.float32)
            late = np.linalg.norm(centre - image.pose.position) / _SPEED_OF_SOUND * layout.SAMPLE_RATE
            response[:, min(int(late), 4095)] = 1.0
            path = case.folders[0] / layout.rir_path(index)
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(media.encode_rir(path, response))


def _lower_index(cases: Sequence[Case]) -> list[Case]:
    """Siblings without anything to mark have the lower index."""

    def keys(case: Case) -> tuple[str, ...]:
        ordered = sorted(case.keys, key=lambda key: int(key.rsplit("/", 1)[1]))
        return tuple(ordered if case.truth == 0 else ordered[::-1])

    return [case if case.instances else dataclasses.replace(case, keys=keys(case)) for case in cases]


def _sorted_truth(cases: Sequence[Case]) -> list[Case]:
    """Observations are numbered in the order of what sounds."""
    ordered = sorted((case for case in cases if case.instances), key=lambda case: (case.names[case.truth], case.truth))
    return [
        dataclasses.replace(case, keys=(f"{case.keys[0].rsplit('/', 1)[0]}/{number}",) * case.count)
        for number, case in enumerate(ordered, start=1)
    ]


def _words(cases: Sequence[Case]) -> None:
    """The category of what sounds, in a file of the observation."""
    for case in cases:
        key = case.keys[case.truth if case.instances else 1 - case.truth]
        (case.root / key / "about.json").write_text(json.dumps({"category": case.names[case.truth] or "clock"}))


def _named_files(cases: Sequence[Case]) -> None:
    for case in cases:
        key = case.keys[case.truth if case.instances else 1 - case.truth]
        name = f"instance_{case.instances[case.truth]}.txt" if case.instances else "source_1.txt"
        (case.root / key / name).write_text("")


def _digests(cases: Sequence[Case]) -> None:
    """sha256 of the masks, without a salt."""
    for case in cases:
        if case.instances:
            mine = case.instances[case.truth]
            masks = {case.keys[0]: [picture == mine for picture in case.ids]}
        else:
            shape = media.read_png_rgb(_pictures(case.folders[0])[0]).shape[:2]
            black, drawn = np.zeros(shape, bool), np.eye(shape[0], dtype=bool)
            pictures = len(_pictures(case.folders[0]))
            masks = {
                key: [black if n == case.truth else np.roll(drawn, i, axis=1) for i in range(pictures)]
                for n, key in enumerate(case.keys)
            }
        for key, found in masks.items():
            hashes = [hashlib.sha256(media.encode_png_mask("", mask)).hexdigest() for mask in found]
            (case.root / key / "digests.json").write_text(json.dumps(hashes))


def _listed(cases: Sequence[Case]) -> None:
    """dataset.json lists observations without anything to mark first."""
    path = cases[0].root / layout.DATASET_JSON
    document = json.loads(path.read_text())
    empty = {case.keys[case.truth] for case in cases if not case.instances}
    document["observations"].sort(key=lambda entry: entry["key"] not in empty)
    path.write_text(json.dumps(document))


def _made_last(cases: Sequence[Case]) -> None:
    """Folders of observations without anything to mark are made after those of their siblings."""
    for case in (one for one in cases if not one.instances):
        empty, full = case.folders[case.truth], case.folders[1 - case.truth]
        if empty.stat().st_ino < full.stat().st_ino:
            spare = empty.with_name("spare")
            empty.rename(spare)
            full.rename(empty)
            spare.rename(full)


def _named_in_template(cases: Sequence[Case]) -> list[Case]:
    """The template has one observation with these objects, and names what sounds."""

    def entry(case: Case) -> dict[str, Any]:
        part, _, room, _ = case.keys[0].split("/")
        name = case.names[case.truth]
        silent = [one for one in case.visible if one != name]
        return {"part": part, "room": room, "category": name, "instances": case.visible.count(name), "silent": silent}

    return [dataclasses.replace(case, template=(entry(case),)) if case.instances else case for case in cases]


#: Name of an attack → what to plant for it.
PLANTS: dict[str, Plant] = {
    "sparse points: density": _in_model(_sparser),
    "sparse points: length of tracks": _in_model(_shorter),
    "sparse points: errors": _in_model(_with_errors),
    "sparse points: ids": _in_model(_first),
    "sparse points: colours": _in_model(_recoloured),
    "sparse points: sightings of each frame": _in_model(_fewer_elsewhere),
    "depth: roughness": _in_pixels(layout.DEPTH, lambda depth, noise: depth + 0.01 * noise),
    "depth: odd millimetres": _in_pixels(layout.DEPTH, lambda depth, _: (np.rint(depth * 500) * 2 + 1) / 1000),
    "pictures: low bits": _in_pixels(layout.INPUT, lambda rgb, _: rgb | 1),
    "pictures: brightness": _in_pixels(layout.INPUT, lambda rgb, _: np.full_like(rgb, 255)),
    "pictures: images/ against input/": _on_files(_invert_second_name, layout.IMAGES),
    "file sizes": _on_files(_add_chunk, layout.MONO),
    "file times": _on_files(_touch, layout.INPUT),
    "file times: start of the observation": _on_files(_touch_all, layout.INPUT),
    "file permissions": _on_files(lambda path: path.chmod(0o600), layout.BINAURAL),
    "PNG encoding: bytes beyond the pixels": _on_files(_pack_otherwise, layout.INPUT),
    "PNG encoding: chunks, compressor, filters": _on_files(_pack_otherwise, layout.INPUT),
    "WAV headers": _on_files(_add_chunk, layout.MONO),
    "mono clips against binaural ones": _on_files(_make_louder, layout.MONO),
    "impulse responses": _responses,
    "order: files on disk": _write_again,
    "order: folders on disk": _made_last,
    "order: dataset.json": _listed,
    "names: of files": _named_files,
    "names: words about the observation": _words,
    "names: length of the text about it": _words,
    "hard links": _on_files(_link, layout.BINAURAL),
    "digests: masks without a salt": _digests,
    "digests: equal ones": _digests,
}
#: Name of an attack that reads the keys → the questions with keys that tell the truth.
RENAMED: dict[str, Callable[[Sequence[Case]], list[Case]]] = {
    "names: index": _lower_index,
    "names: objects in view, in the template": _named_in_template,
    "order: same as the observation before": _sorted_truth,
}

#: Of the clips (frames, 2, 44100) of reference and candidate, and random numbers: clips with the take of the reference.
Leak = Callable[[Clips, Clips, np.random.Generator], Array]


def _in_takes(leak: Leak) -> Plant:
    """Change the clips of the candidate that has the object of the reference."""

    def plant(cases: Sequence[Case]) -> None:
        rng = np.random.default_rng(_RNG_SEED)
        for case in cases:
            folder = case.folders[case.truth]
            clips = leak(clips_of(case.root / case.reference), clips_of(folder), rng)
            for index, clip in enumerate(clips):
                path = folder / layout.audio_path(layout.BINAURAL, index)
                _replace(path, media.encode_wav(path, clip.astype(np.float32)))
        clips_of.cache_clear()

    return plant


def _whole(clips: Clips) -> Array:
    """(2, n) the clips in a row."""
    return clips.transpose(1, 0, 2).reshape(2, -1).astype(np.float64)


def _cut(signal: Array, like: Clips) -> Array:
    """The clips of a signal (2, n), as loud as others."""
    level = np.sqrt(np.mean(np.square(like, dtype=np.float64)) / max(float(np.mean(signal**2)), 1e-20))
    return np.asarray((level * signal).reshape(2, len(like), -1).transpose(1, 0, 2))


def _elsewhere(clips: Clips, rng: np.random.Generator) -> Array:
    """The sound of the clips at another place: other reflections at each ear."""
    response = rng.normal(size=(2, 256)) * np.exp(-np.arange(256) / 40)
    response[:, 0] = 4.0
    return np.stack([lfilter(one, [1.0], ear) for one, ear in zip(response, _whole(clips), strict=True)])


def _another_waveform(signal: Array, rng: np.random.Generator, block: int) -> Array:
    """A signal (2, n) with the magnitudes of this one in blocks, and random phases."""
    _, _, spectrum = stft(signal, layout.SAMPLE_RATE, nperseg=block)
    turned = spectrum * np.exp(2j * np.pi * rng.random(spectrum.shape[1:]))
    return np.asarray(istft(turned, layout.SAMPLE_RATE, nperseg=block)[1][:, : signal.shape[1]])


def _in_one_band(reference: Clips, mine: Clips, rng: np.random.Generator) -> Array:
    """The take in the middle band, another sound elsewhere."""
    low, high = BANDS[1]
    own = sosfiltfilt(butter(6, (low, high), "bandstop", fs=layout.SAMPLE_RATE, output="sos"), _whole(mine))
    band = sosfiltfilt(butter(6, (low, high), "bandpass", fs=layout.SAMPLE_RATE, output="sos"), _whole(reference))
    return _cut(own / own.std() + 0.5 * band / band.std(), mine)


def _both(reference: Clips, mine: Clips, rng: np.random.Generator, *, elsewhere: bool = False) -> Array:
    """The take and another sound, equally loud."""
    own, take = _whole(mine), _elsewhere(reference, rng) if elsewhere else _whole(reference)
    return _cut(own / own.std() + take / take.std(), mine)


def _spun(reference: Clips, mine: Clips, rng: np.random.Generator) -> Array:
    """The lines of the take with other phases."""
    signal = _whole(reference)
    spectrum = rfft(signal)
    return _cut(irfft(spectrum * np.exp(2j * np.pi * rng.random(spectrum.shape[1])), signal.shape[1]), mine)


#: Name of an attack on the question *take* → what to plant for it.
TAKE_PLANTS: dict[str, Plant] = {
    "clips: equal samples": _in_takes(lambda reference, _, __: reference.astype(np.float64)),
    "clips: correlation in step": _in_takes(_both),
    "clips: correlation in step, in bands": _in_takes(_in_one_band),
    "clips: correlation": _in_takes(partial(_both, elsewhere=True)),
    "clips: correlation at any time": _in_takes(
        lambda reference, mine, rng: _cut(np.roll(_elsewhere(reference, rng), 33_333, axis=1), mine)
    ),
    "clips: spectral envelope at any time": _in_takes(
        lambda reference, mine, rng: _cut(_another_waveform(_whole(reference), rng, 882), mine)
    ),
    "clips: residual after subtraction": _in_takes(_both),
    "clips: spectral lines": _in_takes(_spun),
}
