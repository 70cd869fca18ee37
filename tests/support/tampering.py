"""Named falsifications of a dataset, after which all digests are computed again.

`MUTATIONS` says of each whether `avs3d validate --deep` finds it, or why it cannot be seen. Run as a program it applies
them to a copy of any dataset and prints the table of docs/validation.md:

    python -m tests.support.tampering ROOT [NAME…]
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, oaconvolve, sosfilt

from avs3d_bench.contract import layout
from avs3d_bench.formats import media
from avs3d_bench.formats.colmap import ColmapModel, ColmapPoints, read_model, write_model
from avs3d_bench.geometry import Intrinsics, Pose, direction_to
from avs3d_bench.validate import Problem, validate
from generators.acoustics.clips import joined
from tests.support import tiny

#: The frame that is falsified where one is.
FRAME = 3


# --- a small dataset with sound as a room makes it ----------------------------------------------------------------


def write_witness(
    root: Path, *, frames: int = 10, size: int = 64, extras: bool = False, keys: tuple[str, ...] = (tiny.MULTI,)
) -> Path:
    """`tiny.write_dataset` with delays between the ears, reverberation and one source signal for all frames.

    The source has little above 6 kHz, like most sounds, so that a jump between two clips stands out.
    """
    tiny.write_dataset(root, frames=frames, size=size, extras=extras, points=12, keys=keys)
    for key in keys:
        tree = Tree(root, key)
        record = tree.record
        rng = np.random.default_rng(5)
        source = rng.normal(size=(frames + 2) * tiny.RATE) * 0.05
        source[:: tiny.RATE // 3] += 3.0
        source = 2 * sosfilt(butter(8, 6000, fs=tiny.RATE, output="sos"), source)
        reverberation = rng.normal(size=(2, 6000)) * np.exp(-np.arange(6000) / 900) * 0.01
        clips, tail = [], np.zeros((2, 220), dtype=np.float32)
        for index, frame in enumerate(record["frames"]):
            response = _response(Pose(tuple(frame["position"]), tuple(frame["rotation"])), record, reverberation)
            heard = 0.3 * oaconvolve(source[None], response, axes=1)[:, (index + 2) * tiny.RATE :]
            clip = heard[:, : tiny.RATE].astype(np.float32)
            clips.append(joined(clip, tail) if index else clip)
            tail = heard[:, tiny.RATE : tiny.RATE + 220].astype(np.float32)
            if extras:
                media.write_rir(tree.path / layout.rir_path(index), response)
        tree.set_clips(dict(enumerate(clips)))
        tree.finish()
    return root


def _response(pose: Pose, record: dict[str, Any], tail: NDArray[np.float64]) -> NDArray[np.float64]:
    where = direction_to(pose, record["source_position"])
    sine = math.sin(math.radians(where.azimuth))
    out = tail.copy()
    for ear, sign in enumerate((-1, 1)):
        at = round((where.distance / 343 - sign * 275e-6 * sine) * tiny.RATE)
        out[ear, :at] = 0
        out[ear, at] += 10 ** (sign * 6 * sine / 20) / where.distance
    return out


# --- an observation that can be changed ---------------------------------------------------------------------------


class Tree:
    """One observation of a copy; `finish` makes every digest again."""

    def __init__(self, root: Path, key: str) -> None:
        self.root, self.key, self.path = root, key, root / key
        self.record: dict[str, Any] = media.read_json(self.path / layout.OBSERVATION_JSON)
        self.count = len(self.record["frames"])
        self.sounding = next((i["id"] for i in self.record["instances"] if i["sounding"]), None)
        self.dataset: dict[str, Any] = media.read_json(root / layout.DATASET_JSON)

    @property
    def other(self) -> Tree:
        """Another observation of the dataset."""
        return Tree(self.root, next(e["key"] for e in self.dataset["observations"] if e["key"] != self.key))

    def seen(self) -> int:
        """The frame that shows most of the sounding object."""
        return int(np.argmax([frame["visible_pixels"] for frame in self.record["frames"]]))

    def lateral(self) -> int:
        """The frame in line of sight whose source is most to the side."""
        return int(np.argmax([abs(math.sin(math.radians(f["azimuth"]))) * f["line_of_sight"]
                              for f in self.record["frames"]]))  # fmt: skip

    def place(self, folder: str, index: int) -> Path:
        return self.path / layout.image_path(folder, index)

    def rgb(self, index: int) -> Any:
        return media.read_png_rgb(self.place(layout.INPUT, index))

    def set_rgb(self, index: int, pixels: Any) -> None:
        media.write_png_rgb(self.place(layout.INPUT, index), np.ascontiguousarray(pixels, dtype=np.uint8))
        media.link_or_copy(self.place(layout.INPUT, index), self.place(layout.IMAGES, index))

    def ids(self, index: int) -> Any:
        return media.read_png_ids(self.place(layout.INSTANCE_MASKS, index))

    def set_ids(self, index: int, ids: Any) -> None:
        """Both masks and visible_pixels follow."""
        mask = np.asarray(ids) == self.sounding
        media.write_png_ids(self.place(layout.INSTANCE_MASKS, index), np.asarray(ids).astype(np.uint16))
        media.write_png_mask(self.place(layout.SEMANTIC_MASKS, index), mask)
        self.record["frames"][index]["visible_pixels"] = int(mask.sum())

    def set_mask(self, index: int, mask: Any) -> None:
        ids = self.ids(index)
        ids[ids == self.sounding] = 0
        ids[np.asarray(mask) > 0] = self.sounding
        self.set_ids(index, ids)

    def mask(self, index: int) -> Any:
        return (self.ids(index) == self.sounding).astype(np.uint8)

    def clip(self, index: int) -> Any:
        return media.read_wav(self.path / layout.audio_path(layout.BINAURAL, index)).samples

    def set_clips(self, clips: dict[int, Any]) -> None:
        """Levels and every mono clip follow."""
        for index, samples in clips.items():
            media.write_wav(self.path / layout.audio_path(layout.BINAURAL, index), np.ascontiguousarray(samples))
        every = [self.clip(index) for index in range(self.count)]
        for index, clip in enumerate(every):
            left, right = np.sqrt(np.mean(np.square(clip.astype(float)), axis=1)).tolist()
            self.record["frames"][index].update(rms_left=left, rms_right=right)
            pieces = [every[at].mean(axis=0)[a:b] for at, a, b in layout.mono_window(index, self.count)]
            self.set_mono(index, np.concatenate(pieces))

    def mono(self, index: int) -> Any:
        return media.read_wav(self.path / layout.audio_path(layout.MONO, index)).samples[0]

    def set_mono(self, index: int, samples: Any) -> None:
        media.write_wav(self.path / layout.audio_path(layout.MONO, index), np.ascontiguousarray(samples))

    def change_model(self, change: Callable[[ColmapModel], ColmapModel]) -> None:
        write_model(self.path / layout.COLMAP, change(read_model(self.path / layout.COLMAP)))

    def change_points(self, **fields: Callable[[ColmapPoints], Any]) -> None:
        self.change_model(
            lambda m: replace(m, points=replace(m.points, **{name: make(m.points) for name, make in fields.items()}))
        )

    def change_mesh(self, change: Callable[[Any, Any], tuple[Any, Any]]) -> None:
        mesh = media.read_ply(self.path / layout.SOUNDING_OBJECT)
        media.write_ply_mesh(self.path / layout.SOUNDING_OBJECT, *change(mesh.vertices.copy(), mesh.faces.copy()))

    def move_frame(self, index: int, pose: Pose) -> None:
        """A pose that differs in the record and the sparse model alike; angles, distance and sightings follow."""
        frame = self.record["frames"][index]
        truth = direction_to(pose, self.record["source_position"])
        frame.update(position=list(pose.position), rotation=list(pose.rotation), azimuth=truth.azimuth,
                     elevation=truth.elevation, distance=truth.distance)  # fmt: skip

        def change(model: ColmapModel) -> ColmapModel:
            images = list(model.images)
            rows = {int(number): row for row, number in enumerate(model.points.ids)}
            image = images[index]
            at = model.points.positions[[rows[int(number)] for number in image.point_ids]]
            pixels, _ = model.cameras[image.camera].project(pose, at)
            images[index] = replace(image, pose=pose, pixels=pixels)
            return replace(model, images=tuple(images))

        self.change_model(change)

    def instance(self, *, sounding: bool) -> dict[str, Any]:
        return next(i for i in self.record["instances"] if i["sounding"] == sounding)

    def finish(self) -> None:
        """Write the record, all digests and dataset.json."""

        def put(data: dict[str, Any]) -> None:
            data.clear()
            data.update(self.record)

        current = media.read_json(self.root / layout.DATASET_JSON)
        for name, value in self.dataset.items():
            if name != "digest":
                current[name] = value  # tiny.edit_record computes the digests of the observations again
        tiny.replace(self.root / layout.DATASET_JSON, media.dump_json(current).encode())
        tiny.edit_record(self.root, self.key, put)


# --- the table ----------------------------------------------------------------------------------------------------

Change = Callable[[Tree], None]


@dataclass(frozen=True)
class Mutation:
    """One falsification.

    Attributes:
        group: what it falsifies.
        name: what is done.
        change: does it.
        unseen: why `--deep` cannot see it; empty if it must.
        extras: the optional folders (depth, rirs) that it takes to see it.
    """

    group: str
    name: str
    change: Change
    unseen: str = ""
    extras: bool = False


MUTATIONS: list[Mutation] = []


def mutation(group: str, name: str, *, unseen: str = "", extras: bool = False) -> Callable[[Change], Change]:
    def add(change: Change) -> Change:
        MUTATIONS.append(Mutation(group, name, change, unseen, extras))
        return change

    return add


def _add(group: str, name: str, change: Change, *, unseen: str = "", extras: bool = False) -> None:
    MUTATIONS.append(Mutation(group, name, change, unseen, extras))


def picture(change: Callable[[Any], Any], index: int | None = None) -> Change:
    def apply(tree: Tree) -> None:
        at = tree.seen() if index is None else index
        tree.set_rgb(at, change(tree.rgb(at)))

    return apply


def _exchange(read: str, write: str, a: int, b: int) -> Change:
    def apply(tree: Tree) -> None:
        first, second = getattr(tree, read)(a), getattr(tree, read)(b)
        getattr(tree, write)(a, second)
        getattr(tree, write)(b, first)

    return apply


def _jpeg(pixels: Any) -> Any:
    return cv2.imdecode(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 90])[1], cv2.IMREAD_COLOR)


def _dotted(pixels: Any) -> Any:
    out = pixels.copy()
    out[0, 0] ^= 1
    return out


def _painted(share: float) -> Callable[[Any], Any]:
    def paint(pixels: Any) -> Any:
        out = pixels.copy()
        side = max(1, int(share**0.5 * out.shape[0]))
        at = (out.shape[0] - side) // 2
        out[at : at + side, at : at + side] ^= 128
        return out

    return paint


_add("pictures", "two frames exchanged", _exchange("rgb", "set_rgb", 1, 5))
_add("pictures", "mirrored left to right", picture(lambda p: p[:, ::-1]))
_add("pictures", "upside down", picture(lambda p: p[::-1]))
_add("pictures", "black", picture(lambda p: p * 0))
_add("pictures", "white", picture(lambda p: p * 0 + 255))
_add("pictures", "noise", picture(lambda p: np.random.default_rng(1).integers(0, 256, p.shape)))
_add("pictures", "one level brighter", picture(lambda p: np.minimum(p.astype(int) + 1, 255)))
_add("pictures", "blurred", picture(lambda p: cv2.GaussianBlur(p, (7, 7), 2)))
_add("pictures", "compressed as JPEG in between", picture(_jpeg))
_add("pictures", "red and blue exchanged", picture(lambda p: p[..., ::-1]))
_add("pictures", "moved by one pixel", picture(lambda p: np.roll(p, 1, axis=1)))
_add("pictures", "a quarter painted over", picture(_painted(0.25)))
_add("pictures", "one pixel changed", picture(_dotted),
     unseen="a sparse point watches about one pixel in 5,000 at 1008²: a small retouch falls between them")  # fmt: skip


@mutation("pictures", "a frame replaced by its neighbour's")
def _(tree: Tree) -> None:
    tree.set_rgb(FRAME, tree.rgb(FRAME + 1))


@mutation("pictures", "all in reverse order")
def _(tree: Tree) -> None:
    pictures = [tree.rgb(index) for index in range(tree.count)]
    for index, pixels in enumerate(reversed(pictures)):
        tree.set_rgb(index, pixels)


@mutation("pictures", "all of another observation")
def _(tree: Tree) -> None:
    for index in range(tree.count):
        tree.set_rgb(index, tree.other.rgb(index))


def _recolour(tree: Tree, index: int) -> None:
    """Give the points that were taken from a frame the colours that it has now."""

    def change(model: ColmapModel) -> ColmapModel:
        colours, rgb = model.points.colours.copy(), tree.rgb(index)
        rows = {int(number): row for row, number in enumerate(model.points.ids)}
        image = model.images[index]
        for (u, v), number in zip(image.pixels, image.point_ids, strict=True):
            if abs(u % 1 - 0.5) < 1e-6 and abs(v % 1 - 0.5) < 1e-6:
                colours[rows[int(number)]] = rgb[int(v), int(u)]
        return replace(model, points=replace(model.points, colours=colours))

    tree.change_model(change)


@mutation("pictures", "mirrored, and its sparse points coloured to match")
def _(tree: Tree) -> None:
    tree.set_rgb(FRAME, 255 - tree.rgb(FRAME)[:, ::-1])
    _recolour(tree, FRAME)


@mutation("pictures", "all darker by a tenth, sparse points too",
          unseen="pictures and points agree with each other; nothing else in the dataset has colours")  # fmt: skip
def _(tree: Tree) -> None:
    for index in range(tree.count):
        tree.set_rgb(index, tree.rgb(index) * 0.9)
    for index in range(tree.count):
        _recolour(tree, index)


# Masks: instance masks and visible_pixels follow.


def mask(change: Callable[[Any], Any]) -> Change:
    def apply(tree: Tree) -> None:
        tree.set_mask(tree.seen(), change(tree.mask(tree.seen())))

    return apply


def masks(change: Callable[[Any], Any]) -> Change:
    def apply(tree: Tree) -> None:
        for index in range(tree.count):
            tree.set_mask(index, change(tree.mask(index)))

    return apply


def eroded(pixels: int) -> Callable[[Any], Any]:
    return lambda m: cv2.erode(m, np.ones((2 * pixels + 1,) * 2, np.uint8))


def dilated(pixels: int) -> Callable[[Any], Any]:
    return lambda m: cv2.dilate(m, np.ones((2 * pixels + 1,) * 2, np.uint8))


def _half(m: Any) -> Any:
    columns = np.flatnonzero(m.any(axis=0))
    out = m.copy()
    if len(columns):
        out[:, : (columns[0] + columns[-1]) // 2] = 0
    return out


_add("masks", "one black", mask(lambda m: m * 0))
_add("masks", "one white", mask(lambda m: m * 0 + 1))
_add("masks", "one eroded by 4 pixels", mask(eroded(4)))
_add("masks", "one eroded by 1 pixel (with depth)", mask(eroded(1)), extras=True)
_add("masks", "one dilated by 3 pixels", mask(dilated(3)))
_add("masks", "one dilated by 1 pixel", mask(dilated(1)))
_add("masks", "one moved by 4 pixels", mask(lambda m: np.roll(m, 4, axis=1)))
_add("masks", "one mirrored", mask(lambda m: m[:, ::-1]))
_add("masks", "half of one missing", mask(_half))
_add("masks", "all black", masks(lambda m: m * 0))
_add("masks", "all eroded by 2 pixels", masks(eroded(2)))
_add("masks", "two frames exchanged", _exchange("ids", "set_ids", 1, 5))


@mutation("masks", "all in reverse order")
def _(tree: Tree) -> None:
    every = [tree.ids(index) for index in range(tree.count)]
    for index, ids in enumerate(reversed(every)):
        tree.set_ids(index, ids)


def _trade(tree: Tree, index: int) -> None:
    other, ids = tree.instance(sounding=False)["id"], tree.ids(index).astype(int)
    tree.set_ids(index, np.select([ids == tree.sounding, ids == other], [other, tree.sounding], ids))


@mutation("masks", "one shows the silent instance instead")
def _(tree: Tree) -> None:
    shown = [int((tree.ids(i) == tree.instance(sounding=False)["id"]).sum()) for i in range(tree.count)]
    _trade(tree, int(np.argmax(shown)))


@mutation("masks", "all show the silent instance instead")
def _(tree: Tree) -> None:
    for index in range(tree.count):
        _trade(tree, index)


@mutation("masks", "the silent instance erased from one frame")
def _(tree: Tree) -> None:
    other = tree.instance(sounding=False)["id"]
    shown = [int((tree.ids(i) == other).sum()) for i in range(tree.count)]
    index = int(np.argmax(shown))
    tree.set_ids(index, np.where(tree.ids(index) == other, 0, tree.ids(index)))


@mutation("masks", "the silent instance erased from all frames")
def _(tree: Tree) -> None:
    other = tree.instance(sounding=False)["id"]
    for index in range(tree.count):
        tree.set_ids(index, np.where(tree.ids(index) == other, 0, tree.ids(index)))


@mutation("masks", "a quarter of the wall given to the silent instance")
def _(tree: Tree) -> None:
    ids = tree.ids(FRAME)
    block = ids[: ids.shape[0] // 2, : ids.shape[1] // 2]
    block[block == 0] = tree.instance(sounding=False)["id"]
    tree.set_ids(FRAME, ids)


@mutation("masks", "only the instance mask black")
def _(tree: Tree) -> None:
    media.write_png_ids(tree.place(layout.INSTANCE_MASKS, tree.seen()), tree.ids(FRAME) * 0)


@mutation("masks", "only visible_pixels wrong")
def _(tree: Tree) -> None:
    tree.record["frames"][tree.seen()]["visible_pixels"] -= 1


def depth(change: Callable[[Any], Any]) -> Change:
    def apply(tree: Tree) -> None:
        place = tree.place(layout.DEPTH, FRAME)
        media.write_png_depth_mm(place, change(media.read_png_depth(place)))

    return apply


_add("depth", "mirrored", depth(lambda d: d[:, ::-1]), extras=True)
_add("depth", "a tenth farther", depth(lambda d: d * 1.1), extras=True)
_add("depth", "5 mm nearer", depth(lambda d: d - 0.005), extras=True)
_add("depth", "flat", depth(lambda d: d * 0 + 2), extras=True)


@mutation("depth", "two frames exchanged", extras=True)
def _(tree: Tree) -> None:
    a, b = tree.place(layout.DEPTH, 1), tree.place(layout.DEPTH, 5)
    first, second = media.read_png_depth(a), media.read_png_depth(b)
    media.write_png_depth_mm(a, second)
    media.write_png_depth_mm(b, first)


# Sound: levels and mono clips follow.


def clip(change: Callable[[Any], Any]) -> Change:
    return lambda tree: tree.set_clips({tree.lateral(): change(tree.clip(tree.lateral()))})


def clips(change: Callable[[Any], Any]) -> Change:
    return lambda tree: tree.set_clips({index: change(tree.clip(index)) for index in range(tree.count)})


_INAUDIBLE = "one clip may sound so; only the impulse response (`--with rirs`) or making it again tells"
_add("sound", "all channels exchanged", clips(lambda s: s[::-1]))
_add("sound", "all played backwards", clips(lambda s: s[:, ::-1]))
_add("sound", "one played backwards", clip(lambda s: s[:, ::-1]))
_add("sound", "one played backwards (with rirs)", clip(lambda s: s[:, ::-1]), extras=True)
_add("sound", "one replaced by noise (with rirs)",
     clip(lambda s: 0.05 * np.random.default_rng(2).normal(size=s.shape)), extras=True)  # fmt: skip
_add("sound", "channels of one exchanged", clip(lambda s: s[::-1]))
_add("sound", "one silent", clip(lambda s: s * 0))
_add("sound", "a click at the beginning of one", clip(lambda s: s + 0.05 * (np.arange(s.shape[1]) == 0)))
_add("sound", "one clipped", clip(lambda s: s / np.abs(s).max() * 1.5))
_add("sound", "one channel of all silent", clips(lambda s: s * [[1], [0]]))
_add("sound", "both channels of all the same", clips(lambda s: s.mean(axis=0) * np.ones((2, 1))))
_add("sound", "one channel of one made louder (with rirs)", clip(lambda s: s * [[1], [1.5]]), extras=True)
_add("sound", "one channel of one made louder", clip(lambda s: s * [[1], [1.3]]), unseen=_INAUDIBLE)
_add("sound", "one louder by 2 dB", clip(lambda s: s * 1.3))
_add("sound", "one with inverted polarity", clip(lambda s: -s))
_add("sound", "one 10 ms later", clip(lambda s: np.roll(s, 441, axis=1)))


@mutation("sound", "all of another observation",
          unseen="fits if its source lies in much the same directions; found otherwise")  # fmt: skip
def _(tree: Tree) -> None:
    tree.set_clips({index: tree.other.clip(index) * np.array([[0.9], [1.0]]) for index in range(tree.count)})


@mutation("sound", "all in reverse order")
def _(tree: Tree) -> None:
    every = [tree.clip(index) for index in range(tree.count)]
    tree.set_clips(dict(enumerate(reversed(every))))


@mutation("sound", "a clip changed, its recorded level not")
def _(tree: Tree) -> None:
    levels = [(f["rms_left"], f["rms_right"]) for f in tree.record["frames"]]
    tree.set_clips({FRAME: tree.clip(FRAME) * 1.05})
    for frame, (left, right) in zip(tree.record["frames"], levels, strict=True):
        frame.update(rms_left=left, rms_right=right)


def mono(change: Callable[[Any], Any]) -> Change:
    return lambda tree: tree.set_mono(FRAME, change(tree.mono(FRAME)))


_add("sound", "a mono clip played backwards", mono(lambda s: s[::-1]))
_add("sound", "a mono clip louder", mono(lambda s: s * 1.1))
_add("sound", "the neighbours in a mono clip silent", mono(lambda s: s * (np.abs(np.arange(88200) - 44100) <= 22050)))
_add("sound", "two mono clips exchanged", _exchange("mono", "set_mono", 2, 4))


@mutation("sound", "two responses exchanged", extras=True)
def _(tree: Tree) -> None:
    a, b = tree.path / layout.rir_path(0), tree.path / layout.rir_path(tree.lateral() or 5)
    first, second = media.read_rir(a).samples, media.read_rir(b).samples
    media.write_rir(a, second)
    media.write_rir(b, first)


@mutation("sound", "the channels of a response exchanged", extras=True)
def _(tree: Tree) -> None:
    place = tree.path / layout.rir_path(tree.lateral())
    media.write_rir(place, media.read_rir(place).samples[::-1])


# The mesh.


def mesh(change: Callable[[Any, Any], tuple[Any, Any]]) -> Change:
    return lambda tree: tree.change_mesh(change)


def _mirrored(v: Any, f: Any) -> tuple[Any, Any]:
    """Within its bounds."""
    return v * [-1, 1, 1] + [v[:, 0].min() + v[:, 0].max(), 0, 0], f


_add("mesh", "every other face removed", mesh(lambda v, f: (v, f[::2])))
_add("mesh", "a corner cut off", mesh(lambda v, f: (v, f[(v[f].mean(axis=1) <= np.quantile(v[f].mean(axis=1),
     0.7, axis=0) + 1e-6).any(axis=1)][: max(1, len(f) * 2 // 3)])))  # fmt: skip
_add("mesh", "moved by 1 cm", mesh(lambda v, f: (v + [0.01, 0, 0], f)))
_add("mesh", "shrunk by a tenth", mesh(lambda v, f: ((v - v.mean(axis=0)) * 0.9 + v.mean(axis=0), f)))
_add("mesh", "twice as large", mesh(lambda v, f: ((v - v.mean(axis=0)) * 2 + v.mean(axis=0), f)))
_add("mesh", "in the place of a silent one", lambda tree: tree.change_mesh(
     lambda v, f: (v + np.subtract(tree.instance(sounding=False)["bounds"][0], tree.instance(sounding=True)["bounds"][0]), f)))  # fmt: skip  # noqa: E501
_add("mesh", "faces turned inside out", mesh(lambda v, f: (v, f[:, ::-1])), unseen="covers the same pixels")
_add("mesh", "corners moved by less than 1 mm",
     mesh(lambda v, f: (v + np.random.default_rng(3).uniform(-5e-4, 5e-4, v.shape), f)),
     unseen="below a pixel and below the tolerance of a point on its surface")  # fmt: skip


# observation.json.


def frame_field(name: str, change: Callable[[Any], Any]) -> Change:
    def apply(tree: Tree) -> None:
        frame = tree.record["frames"][FRAME]
        frame[name] = change(frame[name])

    return apply


def field(*path: str, to: Any) -> Change:
    def apply(tree: Tree) -> None:
        data = tree.record
        for step in path[:-1]:
            data = data[step]
        data[path[-1]] = to

    return apply


_REGENERATE = "nothing else in the dataset says it; `--regenerate` compares it"
_add("record", "an azimuth", frame_field("azimuth", lambda v: v + 1))
_add("record", "an elevation", frame_field("elevation", lambda v: v + 1))
_add("record", "a distance", frame_field("distance", lambda v: v + 0.01))
_add("record", "a time", frame_field("time", lambda v: v + 0.5))
_add("record", "a level", frame_field("rms_left", lambda v: v * 1.01))
_add("record", "a pose, by 1 cm", frame_field("position", lambda v: [v[0] + 0.01, *v[1:]]))
_add("record", "seed", lambda tree: tree.record.update(seed=tree.record["seed"] + 1))
_add("record", "sample rate", field("acoustics", "sample_rate", to=48000))
_add("record", "version of the acoustic engine", field("acoustics", "version", to="9"))
_add("record", "version of the renderer", field("vision", "version", to="9"))
_add("record", "reverberation time of a cathedral", field("acoustics", "t30", to=9.0))
_add("record", "reverberation time, ten times that of the responses", field("acoustics", "t30", to=1.41), extras=True)
_add("record", "gain, ten times", lambda tree: tree.record["acoustics"].update(
     gain=10 * tree.record["acoustics"]["gain"]))  # fmt: skip
_add("record", "settings of the engine", field("acoustics", "settings", to={"law": "2/r"}), unseen=_REGENERATE)
_add("record", "notes", field("notes", to=["all is well"]), unseen=_REGENERATE)
_add("record", "asset of the sound", field("sound", "asset", to="other"))
_add(
    "record", "line of sight denied", lambda tree: tree.record["frames"][_plain_view(tree)].update(line_of_sight=False)
)


def _plain_view(tree: Tree) -> int:
    """A frame in which the source is in view with the sounding object all around it."""
    camera = Intrinsics(**tree.record["intrinsics"])
    for index, frame in enumerate(tree.record["frames"]):
        pose = Pose(tuple(frame["position"]), tuple(frame["rotation"]))
        (pixel,), (z,) = camera.project(pose, np.asarray([tree.record["source_position"]]))
        if z > 0 and pixel.min() >= 1 and pixel.max() < camera.width - 1:
            u, v = pixel.astype(int)
            if tree.mask(index)[v - 1 : v + 2, u - 1 : u + 2].all():
                return index
    return tree.seen()


@mutation("record", "line of sight everywhere", unseen="what hides the source may stand within 5 cm of it")
def _(tree: Tree) -> None:
    for frame in tree.record["frames"]:
        frame["line_of_sight"] = True
    tree.record["frames"][0]["line_of_sight"] = False
    tree.record["frames"][0]["line_of_sight"] = True
    tree.record["notes"] = ["edited"]


@mutation("record", "the source moved by 20 cm, angles too")
def _(tree: Tree) -> None:
    tree.record["source_position"][1] += 0.2 + tree.instance(sounding=True)["bounds"][1][1]
    for index, frame in enumerate(tree.record["frames"]):
        truth = direction_to(Pose(tuple(frame["position"]), tuple(frame["rotation"])), tree.record["source_position"])
        tree.record["frames"][index].update(azimuth=truth.azimuth, elevation=truth.elevation, distance=truth.distance)


@mutation("record", "another instance sounds")
def _(tree: Tree) -> None:
    for instance in tree.record["instances"]:
        instance["sounding"] = instance["id"] == next(
            i["id"] for i in tree.record["instances"] if i["id"] != tree.sounding
        )


@mutation("record", "the silent twin sounds, in all files but the clips")
def _(tree: Tree) -> None:
    before, after = tree.instance(sounding=True), tree.instance(sounding=False)
    before["sounding"], after["sounding"] = False, True
    tree.sounding = after["id"]
    shift = np.subtract(after["bounds"][0], before["bounds"][0])
    tree.change_mesh(lambda v, f: (v + shift, f))
    tree.record["source_position"] = np.add(tree.record["source_position"], shift).tolist()
    for index, frame in enumerate(tree.record["frames"]):
        tree.set_ids(index, tree.ids(index))
        truth = direction_to(Pose(tuple(frame["position"]), tuple(frame["rotation"])), tree.record["source_position"])
        frame.update(azimuth=truth.azimuth, elevation=truth.elevation, distance=truth.distance)


@mutation("record", "bounds of a silent instance, by 50 cm")
def _(tree: Tree) -> None:
    box = tree.instance(sounding=False)
    for at in (*box["bounds"], box["position"]):
        at[0] += 0.5


@mutation("record", "bounds of the sounding instance, by 2 cm")
def _(tree: Tree) -> None:
    tree.instance(sounding=True)["bounds"][1][0] += 0.02


@mutation("record", "origin of a silent instance, by 1 m")
def _(tree: Tree) -> None:
    tree.instance(sounding=False)["position"][0] += 1.0


@mutation("record", "rotation of a silent instance", unseen=_REGENERATE)
def _(tree: Tree) -> None:
    tree.instance(sounding=False)["rotation"] = [0.0, 0.0, 1.0, 0.0]


@mutation("record", "asset of an instance")
def _(tree: Tree) -> None:
    tree.instance(sounding=False)["asset"] = "procedural:other"


@mutation("record", "licence of an instance")
def _(tree: Tree) -> None:
    tree.instance(sounding=False)["licence"]["name"] = "MIT"


@mutation("record", "focal length, in sparse/0 too")
def _(tree: Tree) -> None:
    tree.record["intrinsics"].update(fx=tree.record["intrinsics"]["fx"] * 1.02)
    camera = Intrinsics(**tree.record["intrinsics"])
    tree.change_model(lambda m: replace(m, cameras=dict.fromkeys(m.cameras, camera)))


@mutation("record", "a pose, in sparse/0 and its sightings too, by 3 cm")
def _(tree: Tree) -> None:
    index = tree.seen()
    x, y, z = tree.record["frames"][index]["position"]
    tree.move_frame(index, Pose((x + 0.03, y, z), tuple(tree.record["frames"][index]["rotation"])))


@mutation("record", "two poses exchanged, in sparse/0 too")
def _(tree: Tree) -> None:
    poses = [Pose(tuple(tree.record["frames"][i]["position"]), tuple(tree.record["frames"][i]["rotation"]))
             for i in (1, 5)]  # fmt: skip
    tree.move_frame(1, poses[1])
    tree.move_frame(5, poses[0])


# The sparse model and the split.

_add("sparse", "colours one level off", lambda t: t.change_points(colours=lambda p: p.colours ^ np.uint8(1)))
_add("sparse", "colours of the points mixed", lambda t: t.change_points(colours=lambda p: p.colours[::-1]))
_add("sparse", "points moved by 5 cm", lambda t: t.change_points(positions=lambda p: p.positions + [0.05, 0, 0]))
_add("sparse", "two images exchanged", lambda t: t.change_model(lambda m: replace(m, images=(
     replace(m.images[0], name=m.images[1].name), replace(m.images[1], name=m.images[0].name), *m.images[2:]))))  # fmt: skip  # noqa: E501


@mutation("sparse", "no points at all")
def _(tree: Tree) -> None:
    def change(model: ColmapModel) -> ColmapModel:
        images = [replace(i, pixels=i.pixels[:0], point_ids=i.point_ids[:0]) for i in model.images]
        p = model.points
        none = ColmapPoints(p.ids[:0], p.positions[:0], p.colours[:0], p.errors[:0], p.offsets[:1],
                            p.track_image[:0], p.track_index[:0])  # fmt: skip
        return ColmapModel(model.cameras, tuple(images), none)

    tree.change_model(change)


@mutation("split", "a test frame among the train frames")
def _(tree: Tree) -> None:
    place = tree.path / layout.SPLITS_JSON
    data = media.read_json(place)
    data["train"] = sorted([*data["train"], data["test"].pop()])
    media.write_json(place, data)


# dataset.json.


def catalogue(**fields: Any) -> Change:
    return lambda tree: tree.dataset.update(fields)


def manifest(old: str, new: str) -> Change:
    def apply(tree: Tree) -> None:
        import hashlib

        assert old in tree.dataset["manifest"]
        text = tree.dataset["manifest"].replace(old, new, 1)
        tree.dataset.update(manifest=text, manifest_sha256=hashlib.sha256(text.encode()).hexdigest())

    return apply


_FREE_TEXT = "free text that the author may choose; its digest was made again"
_add("dataset.json", "name", catalogue(name="other"))
_add("dataset.json", "version", catalogue(version="9.9.9"))
_add("dataset.json", "toolkit version", catalogue(toolkit_version="9"), unseen=_FREE_TEXT)
_add("dataset.json", "licence", catalogue(licence="MIT"),
     unseen="free text; found if the sound needs a non-commercial licence")  # fmt: skip
_add("dataset.json", "attributions removed", catalogue(attributions=[]))
_add("dataset.json", "versions of the backends", lambda tree: tree.dataset.update(
     backends=dict.fromkeys(tree.dataset["backends"], "9")))  # fmt: skip
_add("dataset.json", "a comment of the manifest", lambda tree: manifest("name:", "# edited\nname:")(tree),
     unseen="says nothing that decides bytes")  # fmt: skip
_add(
    "dataset.json", "name in the manifest", lambda tree: manifest(f"name: {tree.dataset['name']}", "name: other")(tree)
)


@mutation("dataset.json", "author of an attribution")
def _(tree: Tree) -> None:
    tree.dataset["attributions"][0]["author"] = "somebody else"


@mutation("dataset.json", "an attribution of something unused")
def _(tree: Tree) -> None:
    tree.dataset["attributions"].append({"asset": "zebra", "name": "MIT", "author": "x", "source": "x"})


# --- running it ---------------------------------------------------------------------------------------------------


def tampered(pristine: Path, target: Path, one: Mutation, key: str = tiny.MULTI) -> tuple[Problem, ...]:
    """The problems, errors alone, of a copy that was falsified; the copy shares what is unchanged by hard links."""
    tiny.clone(pristine, target)
    tree = Tree(target, key)
    one.change(tree)
    tree.finish()
    return tuple(p for p in validate(target, deep=True).problems if p.severity == "error")


def table(pristine: Path, key: str, names: list[str]) -> Iterator[tuple[Mutation, tuple[Problem, ...]]]:
    """Every mutation with what is found of it in a copy of ``pristine``."""
    for one in MUTATIONS:
        if names and f"{one.group}: {one.name}" not in names and one.name not in names:
            continue
        if one.extras and not (pristine / key / layout.DEPTH).exists():
            continue
        folder = Path(tempfile.mkdtemp(dir=pristine.parent))
        try:
            yield one, tampered(pristine, folder / "data", one, key)
        finally:
            shutil.rmtree(folder)


def main(arguments: list[str]) -> None:
    """Print the table for the dataset that is named first, or for a small one of our own."""
    root = Path(arguments[0])
    for one, problems in table(root, os.environ.get("KEY", tiny.MULTI), arguments[1:]):
        first = problems[0] if problems else None
        said = f"{first.path.split('/', 4)[-1]}: {first.message}" if first else f"not seen: {one.unseen or '???'}"
        print(f"| {one.group} | {one.name} | {said[:150]} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
