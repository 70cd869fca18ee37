"""The attacks on a sealed test: each reads one thing of the public folder and gives every candidate a score.

`ATTACKS` lists all of them. The score of an object is high if the thing is unusual where the object is visible: in its
pixels, on its points, or in the frames that show it. None means that the public folder does not have the thing at all.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats import media
from benchmarks import sealed_files
from benchmarks.sealed_cases import Array, Case, text_about, texts

#: The scores (K,) of a case's candidates; None: the public folder has nothing of this kind.
Scores = Array | None
Attack = Callable[[Sequence[Case]], list[Scores]]
#: Of a frame's files: one number, or several, for each frame.
PerFrame = Callable[[Path, int], Array]

#: Metres per second.
_SPEED_OF_SOUND = 343.0
#: Share of the largest sample at which an impulse response begins.
_ONSET = 0.2
#: A sha256 in a text.
_DIGEST = re.compile(r"\b[0-9a-f]{64}\b")


def _each(score: Callable[[Case], Scores]) -> Attack:
    return lambda cases: [score(case) for case in cases]


def _objects_only(score: Callable[[Case], Scores]) -> Attack:
    return lambda cases: [score(case) if case.instances else None for case in cases]


def _in_frames(value: PerFrame) -> Attack:
    """Objects: how closely a value of the frames goes with the object's visibility. Siblings: its mean."""

    def score(case: Case) -> Scores:
        if not case.instances:
            return np.array([float(value(one, sealed_files.frame_count(one)).mean()) for one in case.folders])
        values = value(case.folders[0], case.areas.shape[1])
        columns = values.reshape(len(values), -1).T
        return np.array([max(_association(column, area) for column in columns) for area in case.areas])

    return _each(score)


def _association(values: Array, area: Array) -> float:
    """The larger of two correlations (absolute): with whether the object is visible, and with its area."""
    best = 0.0
    for with_ in ((area > 0).astype(np.float64), area):
        if values.std() > 0 and with_.std() > 0:
            best = max(best, abs(float(np.corrcoef(values, with_)[0, 1])))
    return round(best, 9)


def _start(case: Case) -> Scores:
    """When the first file of each sibling was written (seconds)."""
    if case.instances:
        return None
    return np.array([min(path.stat().st_mtime for path in folder.rglob("*")) for folder in case.folders])


def _on_points(value: Callable[[Case], Array]) -> Attack:
    """Mean of a value of the points that lie on each object."""

    def score(case: Case) -> Scores:
        values = value(case)
        return np.array([float(values[mine].mean()) if mine.any() else 0.0 for mine in case.on_points])

    return _objects_only(score)


def _density(case: Case) -> Scores:
    return np.asarray(case.on_points.sum(axis=1) / np.maximum(case.areas.sum(axis=1), 1.0))


def _tracks(case: Case) -> Array:
    return np.diff(case.model.points.offsets).astype(np.float64)


def _errors(case: Case) -> Array:
    return np.asarray(case.model.points.errors.round(6))


def _point_ids(case: Case) -> Array:
    return case.model.points.ids.astype(np.float64)


def _point_colours(case: Case) -> Array:
    return np.asarray(case.model.points.colours.mean(axis=1))


def _in_pixels(folder: str, value: Callable[[NDArray[np.generic]], Array]) -> Attack:
    """Mean over the pixels of each object of a value (H, W) of the pictures in a folder."""

    def score(case: Case) -> Scores:
        if not (case.folders[0] / folder).is_dir():
            return None
        read = media.read_png_depth if folder == layout.DEPTH else media.read_png_rgb
        pictures = [read(case.folders[0] / layout.image_path(folder, i)) for i in range(len(case.ids))]
        values = np.stack([value(picture) for picture in pictures])
        return np.array(
            [float(values[case.ids == one].mean()) if (case.ids == one).any() else 0.0 for one in case.instances]
        )

    return _objects_only(score)


def _roughness(depth: NDArray[np.generic]) -> Array:
    rows = np.asarray(depth, dtype=np.float64)
    return np.abs(np.diff(rows, n=2, axis=1, append=rows[:, -1:], prepend=rows[:, :1])).clip(0, 0.02)


def _odd_millimetres(depth: NDArray[np.generic]) -> Array:
    return (np.rint(np.asarray(depth, dtype=np.float64) * layout.DEPTH_UNITS_PER_METRE) % 2).astype(np.float64)


def _low_bits(rgb: NDArray[np.generic]) -> Array:
    return np.asarray((np.asarray(rgb, dtype=np.int64) % 2).mean(axis=2))


def _brightness(rgb: NDArray[np.generic]) -> Array:
    return np.asarray(np.asarray(rgb, dtype=np.float64).mean(axis=2))


def _mentions(case: Case) -> Scores:
    """Words of a candidate's category, and of any category for siblings, in the text about the observation."""
    about = [text_about(case.root, key) for key in case.keys]
    if case.instances:
        return np.array([text.count(name) for text, name in zip(about, case.names, strict=True)], dtype=np.float64)
    return np.array([sum(text.count(name) for name in CATEGORIES) for text in about], dtype=np.float64)


def _text_length(case: Case) -> Scores:
    if case.instances:
        return None
    return np.array([len(text_about(case.root, key).replace(key, "")) for key in case.keys], dtype=np.float64)


def _file_names(case: Case) -> Scores:
    """Number of files; for objects, of those whose name has the category or the instance."""
    out = []
    for key, name, one in zip(case.keys, case.names, case.instances or (0,) * case.count, strict=True):
        paths = [p.relative_to(case.root / key).as_posix() for p in sorted((case.root / key).rglob("*")) if p.is_file()]
        out.append(sum(name in path or f"instance_{one}" in path for path in paths) if name else len(paths))
    return np.array(out, dtype=np.float64)


def _digests(case: Case) -> Scores:
    """Commitments without a salt: masks of each candidate, encoded as the toolkit does, among the digests."""
    if case.instances:
        known = set(_DIGEST.findall("\n".join([text_about(case.root, case.keys[0]), str(texts(case.root))])))
        out = []
        for one, area in zip(case.instances, case.areas, strict=True):
            masks = [media.encode_png_mask("", case.ids[index] == one) for index in np.flatnonzero(area)]
            out.append(sum(hashlib.sha256(mask).hexdigest() in known for mask in masks))
        return np.array(out, dtype=np.float64)
    # Siblings: how often the digest of a black picture is there.
    shape = media.read_png_rgb(case.folders[0] / layout.image_path(layout.INPUT, 0)).shape[:2]
    black = hashlib.sha256(media.encode_png_mask("", np.zeros(shape, bool))).hexdigest()
    return np.array([text_about(case.root, key).count(black) for key in case.keys], dtype=np.float64)


def _same_digests(case: Case) -> Scores:
    """Equal digests tell equal files: how many an observation has twice, those of its published files aside."""
    if case.instances:
        return None
    out = []
    for key, folder in zip(case.keys, case.folders, strict=True):
        # Silent clips are equal, too: whoever compares them listens.
        own = {hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.rglob("*.*") if path.is_file()}
        found = [digest for digest in _DIGEST.findall(text_about(case.root, key)) if digest not in own]
        out.append(len(found) - len(set(found)))
    return np.array(out, dtype=np.float64)


def _responses(case: Case) -> Scores:
    """Impulse responses tell the distance of the source from each pose."""
    folder = case.folders[0] / layout.RIRS
    if not case.instances or not folder.is_dir():
        return None
    heard = []
    for index in range(len(case.ids)):
        response = media.read_rir(case.folders[0] / layout.rir_path(index)).samples
        loud = np.abs(response).max(axis=0)
        heard.append(float(np.flatnonzero(loud >= _ONSET * loud.max())[0]) / layout.SAMPLE_RATE * _SPEED_OF_SOUND)
    poses = np.array([image.pose.position for image in case.model.images])
    positions = case.model.points.positions
    out = []
    for mine in case.on_points:
        centre = np.median(positions[mine], axis=0) if mine.any() else np.full(3, 1e3)
        out.append(-float(np.abs(np.linalg.norm(poses - centre, axis=1) - heard).mean()))
    return np.array(out)


def _index(case: Case) -> Scores:
    return None if case.instances else np.array([int(key.rsplit("/", 1)[1]) for key in case.keys], dtype=np.float64)


def _listed(case: Case) -> Scores:
    """Place in dataset.json."""
    listed = [entry["key"] for entry in texts(case.root).get(layout.DATASET_JSON, {}).get("observations", [])]
    if case.instances or not listed:
        return None
    return np.array([listed.index(key) for key in case.keys], dtype=np.float64)


def _made(case: Case) -> Scores:
    """Order in which the folders were made."""
    return None if case.instances else np.array([folder.stat().st_ino for folder in case.folders], dtype=np.float64)


def _template(case: Case) -> Scores:
    """How often each category sounds in the template's observations with the same objects in the same kind of room."""
    if case.template is None or not case.instances:
        return None
    part, _, room, _ = case.keys[0].split("/")
    alike = [
        entry["category"]
        for entry in case.template
        if (entry.get("part"), entry.get("room")) == (part, room) and objects_of(entry) == case.visible
    ]
    return np.array([alike.count(name) for name in case.names], dtype=np.float64)


def objects_of(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Categories of all objects of an entry of part_1 or part_2, sorted."""
    copies = entry.get("instances") or (1 if entry["part"] == "part_1" else 2)
    return tuple(sorted([*[entry["category"]] * copies, *(entry.get("silent") or ())]))


def _neighbours(order: Callable[[Case], object]) -> Attack:
    """A candidate of the same kind (category, or place among the ids) as the right one of the case before."""

    def attack(cases: Sequence[Case]) -> list[Scores]:
        out: list[Scores] = [None] * len(cases)
        last: dict[tuple[str, ...], tuple[str, int]] = {}
        for number in sorted(range(len(cases)), key=lambda n: (order(cases[n]), n)):
            case = cases[number]
            if not case.instances:
                continue
            part, _, room, _ = case.keys[0].split("/")
            name, place = last.get((part, room), ("", -1))
            if case.question == "object":
                out[number] = np.array([float(one == name) for one in case.names])
            else:
                out[number] = np.array([float(n == place) for n in range(case.count)])
            last[part, room] = (case.names[case.truth], case.truth)
        return out

    return attack


def _by_key(case: Case) -> object:
    part, scan, room, index = case.keys[0].split("/")
    return part, scan, room, int(index)


#: Name → attack, in the order of the list in docs/sealed.md.
ATTACKS: dict[str, Attack] = {
    "sparse points: density": _objects_only(_density),
    "sparse points: length of tracks": _on_points(_tracks),
    "sparse points: errors": _on_points(_errors),
    "sparse points: ids": _on_points(_point_ids),
    "sparse points: colours": _on_points(_point_colours),
    "sparse points: sightings of each frame": _in_frames(sealed_files.sightings),
    "depth: roughness": _in_pixels(layout.DEPTH, _roughness),
    "depth: odd millimetres": _in_pixels(layout.DEPTH, _odd_millimetres),
    "pictures: low bits": _in_pixels(layout.INPUT, _low_bits),
    "pictures: brightness": _in_pixels(layout.INPUT, _brightness),
    "pictures: images/ against input/": _in_frames(sealed_files.second_name),
    "file sizes": _in_frames(sealed_files.sizes),
    "file times": _in_frames(sealed_files.times),
    "file times: start of the observation": _each(_start),
    "file permissions": _in_frames(sealed_files.modes),
    "PNG encoding: bytes beyond the pixels": _in_frames(sealed_files.png_surplus),
    "PNG encoding: chunks, compressor, filters": _in_frames(sealed_files.png_settings),
    "WAV headers": _in_frames(sealed_files.wav_heads),
    "mono clips against binaural ones": _in_frames(sealed_files.mono_levels),
    "impulse responses": _each(_responses),
    "order: files on disk": _in_frames(sealed_files.inodes),
    "order: folders on disk": _each(_made),
    "order: dataset.json": _each(_listed),
    "order: same as the observation before": _neighbours(_by_key),
    "names: index": _each(_index),
    "names: of files": _each(_file_names),
    "names: words about the observation": _each(_mentions),
    "names: length of the text about it": _each(_text_length),
    "names: objects in view, in the template": _each(_template),
    "hard links": _in_frames(sealed_files.links),
    "digests: masks without a salt": _each(_digests),
    "digests: equal ones": _each(_same_digests),
}
