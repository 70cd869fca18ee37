"""Named falsifications of part_3 observations, after which all digests are computed again; see `tampering`.

`SCENE_MUTATIONS` says of each what `avs3d validate --deep` must say about which file, or why it cannot be seen. Run as
a program it prints them with what is found of each:

    python -m tests.support.tampering_scenes
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.formats import media
from avs3d_bench.geometry import Pose, direction_to
from avs3d_bench.validate import Problem, validate
from tests.support import tiny, tiny_scenes
from tests.support.tampering import Tree
from tests.support.tiny_scenes import AWAY, BOTH, FIRST, SECOND, SILENT

#: The frame that is falsified where one is: of three sources, the second and the third sound in it.
FRAME = 3
CLIP = layout.audio_path(layout.BINAURAL, FRAME)
MASK, CATEGORIES = (layout.image_path(each, FRAME) for each in (layout.SEMANTIC_MASKS, layout.CATEGORY_MASKS))
RECORD = layout.OBSERVATION_JSON


def write_scenes(root: Path, *, stems: bool = True, rirs: bool = False) -> Path:
    """The group of tests/support/tiny_scenes.py with more sparse points, so that contents can be held to each other."""
    return tiny_scenes.write_part_3(root, stems=stems, rirs=rirs, points=12)


class SceneTree(Tree):
    """One observation of part_3 that can be changed; what follows from a change follows."""

    @property
    def names(self) -> list[str]:
        """The stems of the observation."""
        folder = self.path / layout.STEMS
        return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []

    def stem(self, name: str, index: int) -> NDArray[np.float32]:
        return media.read_wav(self.path / layout.stem_path(name, index)).samples

    def set_stem(self, name: str, index: int, samples: Any) -> None:
        """The stem alone."""
        media.write_wav(self.path / layout.stem_path(name, index), np.ascontiguousarray(samples, dtype=np.float32))

    def set_stems(self, name: str, change: Callable[[Any], Any]) -> None:
        """A stem in all frames; clips follow."""
        for index in range(self.count):
            self.set_stem(name, index, change(self.stem(name, index)))
        self.set_clips({index: sum(self.stem(each, index) for each in self.names) for index in range(self.count)})

    def frame(self, index: int = FRAME) -> dict[str, Any]:
        return self.record["frames"][index]

    def mark(self, index: int, instances: list[int]) -> None:
        """Both masks and visible_pixels of a frame show these instances."""
        ids = self.ids(index)
        mask, kinds = np.isin(ids, instances), np.zeros_like(ids)
        for box in tiny_scenes.BOXES:
            kinds[mask & (ids == box.id)] = {"microwave": 4, "telephone": 7}[box.category]
        media.write_png_mask(self.place(layout.SEMANTIC_MASKS, index), mask)
        media.write_png_categories(self.place(layout.CATEGORY_MASKS, index), kinds)
        self.frame(index)["visible_pixels"] = int(mask.sum())

    def move_source(self, place: tuple[float, float, float]) -> None:
        """The first source is elsewhere; the directions of all frames follow."""
        self.record.update(source_position=list(place))
        self.record["sources"][0].update(position=list(place))
        for frame in self.record["frames"]:
            truth = direction_to(Pose(tuple(frame["position"]), tuple(frame["rotation"])), place)
            frame.update(azimuth=truth.azimuth, elevation=truth.elevation, distance=truth.distance)


Change = Callable[[SceneTree], None]


@dataclass(frozen=True)
class SceneMutation:
    """One falsification.

    Attributes:
        group: what it falsifies.
        name: what is done.
        key: the observation.
        change: does it.
        path: the file or folder that must be named, relative to the observation (or dataset.json).
        words: what must be said of it; empty if it cannot be seen.
        unseen: why ``--deep`` cannot see it.
        needs: ``stems`` or ``rirs`` if it takes these to see it.
    """

    group: str
    name: str
    key: str
    change: Change
    path: str = ""
    words: str = ""
    unseen: str = ""
    needs: str = ""


SCENE_MUTATIONS: list[SceneMutation] = []


def scene(group: str, name: str, key: str, path: str = "", words: str = "", **more: str) -> Callable[[Change], Change]:
    def add(change: Change) -> Change:
        SCENE_MUTATIONS.append(SceneMutation(group, name, key, change, path, words, **more))
        return change

    return add


def _add(group: str, name: str, key: str, change: Change, path: str = "", words: str = "", **more: str) -> None:
    scene(group, name, key, path, words, **more)(change)


def _noise() -> NDArray[np.float64]:
    return np.random.default_rng(8).normal(size=(2, tiny.RATE)) * 0.05


# --- stems ----------------------------------------------------------------------------------------------------------

_add("stems", "one replaced by noise", BOTH, lambda t: t.set_stem("source_2", FRAME, _noise()), CLIP,
     "differs from the sum of its stems", needs="stems")  # fmt: skip
_add("stems", "one missing", BOTH, lambda t: (t.path / layout.stem_path("source_2", FRAME)).unlink(),
     layout.stem_path("source_2", FRAME), "missing file", needs="stems")  # fmt: skip
_add("stems", "those of the background missing", BOTH, lambda t: shutil.rmtree(t.path / "stems/background"),
     "stems/background", "missing folder", needs="stems")  # fmt: skip
_add("stems", "one with one channel", BOTH, lambda t: t.set_stem("source_2", FRAME, _noise()[:1]),
     layout.stem_path("source_2", FRAME), "1 channel(s), expected 2", needs="stems")  # fmt: skip
_add("stems", "the clip louder than their sum, levels too", BOTH, lambda t: t.set_clips({FRAME: t.clip(FRAME) * 1.1}),
     CLIP, "differs from the sum of its stems", needs="stems")  # fmt: skip


@scene("stems", "those of two sources exchanged", BOTH, "stems/source_1", "outside its programme", needs="stems")
def _(tree: SceneTree) -> None:
    for index in range(tree.count):
        one, other = tree.stem("source_1", index), tree.stem("source_2", index)
        tree.set_stem("source_1", index, other)
        tree.set_stem("source_2", index, one)


@scene("stems", "polarity of all, clips too", FIRST, unseen="sounds the same", needs="stems")
def _(tree: SceneTree) -> None:
    tree.set_stems("source_1", lambda samples: -samples)


# --- what is audible ------------------------------------------------------------------------------------------------


@scene("audible", "the only source left out, masks too", FIRST, RECORD, "audible is empty, but the clip has")
def _(tree: SceneTree) -> None:
    tree.frame()["audible"] = []
    tree.mark(FRAME, [])


@scene("audible", "one of two sources left out, masks too", BOTH, RECORD, "audible of frame_003 lacks source_2",
       needs="stems")  # fmt: skip
def _(tree: SceneTree) -> None:
    tree.frame()["audible"] = [each for each in tree.frame()["audible"] if each["source"] != "source_2"]
    tree.mark(FRAME, [2])


@scene("audible", "a source added in its reverberation, masks too", BOTH, RECORD,
       "lists source_1, but the stem is silent", needs="stems")  # fmt: skip
def _(tree: SceneTree) -> None:
    tree.frame()["audible"].insert(0, {"source": "source_1", "level_db": -50.0, "drr_db": None, "snr_db": -15.0})
    tree.mark(FRAME, [1, 2, 3])


@scene("audible", "a source added long after its programme, masks too", BOTH, RECORD,
       "frames[9]: source_1 is audible, but its programme has no interval here")  # fmt: skip
def _(tree: SceneTree) -> None:
    tree.frame(9)["audible"].insert(0, {"source": "source_1", "level_db": -50.0, "drr_db": None, "snr_db": -15.0})
    tree.mark(9, [1, 2, 3])


_add("audible", "a level, by 1 dB", FIRST,
     lambda t: t.frame()["audible"][0].update(level_db=t.frame()["audible"][0]["level_db"] + 1), RECORD,
     "rms_left and rms_right give")  # fmt: skip
_add("audible", "a level of two, by 0.5 dB", BOTH,
     lambda t: t.frame()["audible"][0].update(level_db=t.frame()["audible"][0]["level_db"] + 0.5),
     layout.stem_path("source_2", FRAME), "level_db of frame_003 is", needs="stems")  # fmt: skip
_add("audible", "an SNR, by 0.5 dB", BOTH,
     lambda t: t.frame()["audible"][0].update(snr_db=t.frame()["audible"][0]["snr_db"] + 0.5),
     layout.stem_path("source_2", FRAME), "snr_db of frame_003 is", needs="stems")  # fmt: skip
_add("audible", "an SNR of null beside another source", BOTH, lambda t: t.frame()["audible"][1].update(snr_db=None),
     layout.stem_path("source_3", FRAME), "snr_db of frame_003 is null", needs="stems")  # fmt: skip
_add("audible", "a level below the threshold", BOTH, lambda t: t.frame()["audible"][0].update(level_db=-61.0), RECORD,
     "below -60 dB it is not audible")  # fmt: skip
_add("audible", "a ratio of direct to reverberant sound", FIRST, lambda t: t.frame()["audible"][0].update(drr_db=0.0),
     unseen="the stem does not tell its direct sound from the rest")  # fmt: skip

# --- masks ----------------------------------------------------------------------------------------------------------

_add("masks", "a silent instance marked", FIRST, lambda t: t.mark(FRAME, [1, 2]), MASK, "which is not audible")
_add("masks", "an audible twin not marked", BOTH, lambda t: t.mark(FRAME, [2]), MASK,
     "pixels of instance 3, which is audible in frame_003, are not marked")  # fmt: skip
_add("masks", "something marked under silence", SILENT, lambda t: t.mark(FRAME, [1]), MASK, "which is not audible")
_add("masks", "only visible_pixels wrong", FIRST, lambda t: t.frame().update(visible_pixels=1), MASK,
     "visible_pixels of frame_003 is 1")  # fmt: skip
_add("masks", "category masks missing", FIRST, lambda t: shutil.rmtree(t.path / layout.CATEGORY_MASKS),
     layout.CATEGORY_MASKS, "missing folder")  # fmt: skip


def _categories(change: Callable[[Any], Any]) -> Change:
    def apply(tree: SceneTree) -> None:
        path = tree.place(layout.CATEGORY_MASKS, FRAME)
        media.write_png_categories(path, change(media.read_png_categories(path)))

    return apply


_add("masks", "a class id wrong", BOTH, _categories(lambda k: np.where(k == 7, 2, k)), CATEGORIES,
     "pixels on instance 2 have the class id 2, expected 7")  # fmt: skip
_add("masks", "a class id that does not exist", BOTH, _categories(lambda k: np.where(k == 7, 9, k)), CATEGORIES,
     "values [9] are no class ids")  # fmt: skip
_add("masks", "category mask black", FIRST, _categories(lambda k: k * 0), CATEGORIES, "class id 0, expected 4")
_add("masks", "category mask of a silent instance too", FIRST, _categories(lambda k: np.full_like(k, 4)), CATEGORIES,
     "pixels on instance 2 have the class id 4, expected 0")  # fmt: skip

# --- siblings -------------------------------------------------------------------------------------------------------

_add("siblings", "a picture of one changed", SECOND, lambda t: t.set_rgb(FRAME, 255 - t.rgb(FRAME)),
     layout.image_path(layout.INPUT, FRAME), "differs from that of part_3/tiny/kitchen/1")  # fmt: skip
_add("siblings", "one pixel of a picture of one changed", SECOND, lambda t: t.set_rgb(FRAME, _dotted(t.rgb(FRAME))),
     layout.image_path(layout.INPUT, FRAME), "differs from that of part_3/tiny/kitchen/1")  # fmt: skip
_add("siblings", "a pose of one, in sparse/0 too", SECOND, lambda t: t.move_frame(FRAME, _beside(t.frame())), RECORD,
     f"frames[{FRAME}]: time or pose differs")  # fmt: skip
_add("siblings", "an instance of one", SECOND, lambda t: t.record["instances"][1].update(rotation=[0, 0, 1, 0]), RECORD,
     "instance 2 differs")  # fmt: skip
_add("siblings", "the seed of one", SECOND, lambda t: t.record.update(seed=2), RECORD, "seed differs")
_add("siblings", "a chain of groups", BOTH, lambda t: t.record.update(group=SECOND), RECORD,
     f"group {SECOND} is itself in the group {FIRST}")  # fmt: skip
_add("siblings", "the split of one", SECOND, lambda t: _other_split(t), layout.SPLITS_JSON, "expected the same bytes")


@scene("siblings", "an instance mask of one", SECOND, layout.image_path(layout.INSTANCE_MASKS, FRAME),
       "expected the same bytes")  # fmt: skip
def _(tree: SceneTree) -> None:
    ids = tree.ids(FRAME)
    ids[ids == 2] = 0
    media.write_png_ids(tree.place(layout.INSTANCE_MASKS, FRAME), ids)


def _dotted(pixels: Any) -> Any:
    out = pixels.copy()
    out[0, 0] ^= 1
    return out


def _beside(frame: dict[str, Any]) -> Pose:
    x, y, z = frame["position"]
    return Pose((x + 0.03, y, z), tuple(frame["rotation"]))


def _other_split(tree: SceneTree) -> None:
    place = tree.path / layout.SPLITS_JSON
    tiny.replace(place, place.read_bytes() + b"\n")


# --- sources --------------------------------------------------------------------------------------------------------


def _programme(number: int, *intervals: tuple[float, float]) -> Change:
    return lambda tree: tree.record["sources"][number - 1].update(programme=[list(each) for each in intervals])


_add("sources", "an off-screen source with an instance", AWAY, lambda t: t.record["sources"][0].update(instance=2),
     RECORD, "source_1: instance 2 is no telephone of the kitchen")  # fmt: skip
_add("sources", "an off-screen source within an instance", AWAY, lambda t: t.move_source((-0.05, 1.1, -2.4)), RECORD,
     "source_1 is off-screen (no instance), but its position is inside instance 2")  # fmt: skip
_add("sources", "an off-screen source in the room", AWAY, lambda t: t.move_source((0.0, 1.2, -1.2)), RECORD,
     "see past it")  # fmt: skip
_add("sources", "a source away from its instance, angles too", FIRST, lambda t: t.move_source((-1.2, 1.8, -2.2)),
     RECORD, "the position of source_1 lies 0.40 m outside the bounds of instance 1")  # fmt: skip
_add("sources", "a source of another instance", FIRST, lambda t: t.record["sources"][0].update(instance=3), RECORD,
     "instance 1: sounding is True")  # fmt: skip
_add("sources", "a programme beyond the end", BOTH, _programme(1, (0.0, 2.0), (4.5, 12.0)), RECORD,
     "source_1: programme ends at 12 s, after the last frame (10 s)")  # fmt: skip
_add("sources", "a programme before the beginning", FIRST, _programme(1, (-3.0, 10.0)), RECORD,
     "source_1: programme starts at -3 s")  # fmt: skip
_add("sources", "a programme that leaves out what sounds", BOTH, _programme(2, (2.0, 4.5)), "stems/source_2",
     "sounds at 6.52 s, outside its programme", needs="stems")  # fmt: skip
_add("sources", "a programme without its sound", BOTH, _programme(1, (0.0, 2.0), (4.5, 6.0), (8.0, 10.0)),
     "stems/source_1", "silent from 8 to 10 s", needs="stems")  # fmt: skip
_add("sources", "overlapping intervals", BOTH, _programme(1, (0.0, 2.0), (1.5, 6.0)), RECORD, "increasing intervals")
_add("sources", "asset of one", FIRST, lambda t: t.record["sources"][0].update(asset="other"), "dataset.json",
     "attributions lack other")  # fmt: skip
_add("sources", "gain_db", FIRST, lambda t: t.record["sources"][0].update(gain_db=3.0),
     unseen="the level of a source that plays louder or stands nearer")  # fmt: skip

# --- clips, background, mesh, dataset.json --------------------------------------------------------------------------


def _all_clips(change: Callable[[Any], Any]) -> Change:
    return lambda tree: tree.set_clips({index: change(tree.clip(index)) for index in range(tree.count)})


_add("sound", "noise under silence, levels too", SILENT, _all_clips(lambda s: _noise()), RECORD,
     "nothing sounds (no source, no background), but the clip has")  # fmt: skip
_add("sound", "a clip of a source silent, levels too", FIRST, lambda t: t.set_clips({FRAME: t.clip(FRAME) * 0}), RECORD,
     "rms_left and rms_right give -inf dB")  # fmt: skip
_add("sound", "channels exchanged, stems too", FIRST, lambda t: t.set_stems("source_1", lambda s: s[::-1]),
     layout.BINAURAL, "channels swapped?", needs="stems")  # fmt: skip
_add("sound", "channels of all clips exchanged", FIRST, _all_clips(lambda s: s[::-1]), layout.BINAURAL,
     "channels swapped?")  # fmt: skip


def _background(change: Callable[[Any], Any]) -> Change:
    """The stem of the background at its old level; clips follow, what is audible as far as levels say it does not."""

    def apply(tree: SceneTree) -> None:
        tree.set_stems(layout.BACKGROUND, lambda s: change(s) * np.sqrt(np.mean(s**2) / np.mean(change(s) ** 2)))

    return apply


_add("background", "both ears equal", AWAY, _background(lambda s: s[[0, 0]]), "stems/background",
     "the coherence of the ears", needs="stems")  # fmt: skip
_add("background", "both ears independent", AWAY, _background(lambda s: np.stack([s[0], np.roll(s[1], 9000)])),
     "stems/background", "the coherence of the ears", needs="stems")  # fmt: skip
_add("background", "its level, by 0.5 dB", AWAY,
     lambda t: t.record["background"].update(level_db=t.record["background"]["level_db"] + 0.5), RECORD,
     "background.level_db is", needs="stems")  # fmt: skip
_add("background", "its SNR, by 2 dB", AWAY, lambda t: t.record["background"].update(snr_db=12.0), RECORD,
     "background.snr_db is 12.0 dB", needs="stems")  # fmt: skip
_add("background", "removed from the record", AWAY, lambda t: t.record.update(background=None),
     layout.stem_path(layout.BACKGROUND, FRAME), "surplus file", needs="stems")  # fmt: skip
_add("background", "its kind", AWAY, lambda t: t.record["background"].update(kind="room_tone"),
     unseen="its spectrum is not compared")  # fmt: skip


@scene("responses", "of two sources exchanged", BOTH, "rirs/source_2/frame_3.npz", "does not explain", needs="rirs")
def _(tree: SceneTree) -> None:
    for index in range(tree.count):
        one, other = (tree.path / layout.rir_path(index, f"source_{n}") for n in (2, 3))
        first, second = media.read_rir(one).samples, media.read_rir(other).samples
        media.write_rir(one, second)
        media.write_rir(other, first)


def _copy_mesh(tree: SceneTree) -> None:
    media.write_ply_mesh(tree.path / layout.SOUNDING_OBJECT, *tiny_scenes.BOXES[0].mesh())


_add("mesh", "one where nothing sounds", SILENT, _copy_mesh, layout.SOUNDING_OBJECT,
     "surplus file: no instance of the room sounds")  # fmt: skip
_add("mesh", "only one of the sounding instances", BOTH, _copy_mesh, layout.SOUNDING_OBJECT, "bounds differ")
_add("mesh", "missing", FIRST, lambda t: (t.path / layout.SOUNDING_OBJECT).unlink(), layout.SOUNDING_OBJECT, "missing")
_add("dataset.json", "categories of the manifest's own", FIRST, lambda t: t.dataset.update(categories=["hair_dryer"]),
     "dataset.json", "own are hair_dryer, in part_3/tiny/kitchen/1 and 4 more none")  # fmt: skip
_add("dataset.json", "categories of an observation", FIRST, lambda t: t.record.update(categories=["hair_dryer"]),
     "dataset.json", "categories of the manifest's own are none, in part_3/tiny/kitchen/1 hair_dryer")  # fmt: skip
_add("dataset.json", "category of a silent observation", SILENT, lambda t: t.dataset["observations"][3].update(
     category="clock"), "dataset.json", "category of part_3/tiny/kitchen/4 is clock")  # fmt: skip


def tampered(pristine: Path, target: Path, one: SceneMutation) -> tuple[Problem, ...]:
    """The problems of a copy that was falsified; the copy shares what is unchanged by hard links."""
    tiny.clone(pristine, target)
    tree = SceneTree(target, one.key)
    one.change(tree)
    tree.finish()
    return validate(target, deep=True).problems


def main() -> None:
    """Print the table of docs/validation.md, with what is found first."""
    folder = Path(tempfile.mkdtemp())
    try:
        options = {"": {"stems": False}, "stems": {}, "rirs": {"rirs": True}}
        trees = {name: write_scenes(folder / f"pristine{name}", **more) for name, more in options.items()}
        for number, one in enumerate(SCENE_MUTATIONS):
            problems = tampered(trees[one.needs], folder / str(number), one)
            found = next((p for p in problems if one.words and one.words in p.message), None)
            said = f"{found.path.split('/', 4)[-1]}: {found.message}" if found else f"not seen: {one.unseen or '???'}"
            print(f"| {one.group} | {one.name} | {said[:150]} |", flush=True)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
