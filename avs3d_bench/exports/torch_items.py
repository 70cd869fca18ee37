"""What an item of `AVS3DDataset` holds: the facts of an observation in small arrays, and the files of a frame.

Observations of all parts are read in the same way: one of part_1 or part_2 has a single source, whose stem is the clip.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.samples import FileKind, file_kinds, frame_facts
from avs3d_bench.exports.webdataset import planes
from avs3d_bench.formats import media

#: Facts of a frame that become tensors, with their types; the rest of `frame_facts` is for files.
_NUMBERS = {
    "intrinsics": np.float32,
    "camera_to_world": np.float32,
    "source_position": np.float32,
    "azimuth": np.float32,
    "elevation": np.float32,
    "distance": np.float32,
    "visible_pixels": np.int64,
    "sounding_instance": np.int64,
}
_NO_POSE = [[float("nan")] * 4] * 4
_TEXTS = ("category", "key", "frame", "split")


#: Kinds of files of part_3.
CATEGORIES, STEMS = "categories", "stems"
#: Facts of a frame in part_3 where there is no source; the shapes are the same as where there is one.
NO_SOURCE: dict[str, Any] = {
    "source_position": [float("nan")] * 3,
    "azimuth": float("nan"),
    "elevation": float("nan"),
    "distance": float("nan"),
    "sounding_instance": -1,
    "category": "",
}
#: Value of ``category_index`` where there is no source.
NO_CATEGORY = -1


def read_binaural(path: str | Path) -> NDArray[np.float32]:
    """A binaural clip (2, 44100).

    Raises:
        Avs3dError: if the file is missing, damaged, or of another shape or rate.
    """
    return read_second(path, channels=2)


def read_second(path: str | Path, channels: int | None = None) -> NDArray[np.float32]:
    """A clip (channels, 44100) of any receiver.

    Args:
        path: of the file.
        channels: how many it must have; None: as many as it has.

    Raises:
        Avs3dError: if the file is missing, damaged, or of another shape or rate.
    """
    clip = media.read_wav(path)
    shape = (channels or len(clip.samples), layout.BINAURAL_SAMPLES)
    if clip.samples.shape != shape or clip.rate != layout.SAMPLE_RATE:
        found = f"{clip.samples.shape} at {clip.rate} Hz"
        raise Avs3dError(f"{path}: sound {found}, expected {shape} at {layout.SAMPLE_RATE} Hz")
    return clip.samples


def read_planes(path: str | Path) -> NDArray[np.uint8]:
    """A picture as (3, H, W) uint8 RGB: one pass from OpenCV's BGR, no copy in between.

    Raises:
        Avs3dError: if the file is missing, truncated, damaged or no 8-bit RGB picture.
    """

    def check(header: media.PngHeader) -> None:
        if header.bits != 8 or header.colour_type not in (2, 6):
            raise Avs3dError(f"{path}: {header.mode}, expected RGB, 8 bit")

    return planes(media.decode_png(path, cv2.IMREAD_COLOR, check))


def _read_ids(path: str | Path) -> NDArray[np.int32]:
    return media.read_png_ids(path).astype(np.int32)


#: Flag of the constructor → (kind of file, key of the item, reader).
READERS: dict[str, tuple[str, Callable[[Path], NDArray[Any]]]] = {
    "rgb": ("rgb", read_planes),
    "binaural": ("binaural", read_binaural),
    "ambisonics": ("ambisonics", read_second),
    "array": ("array", read_second),
    "mask": ("mask", media.read_png_mask),
    "instances": ("instance_ids", _read_ids),
    "depth": ("depth", media.read_png_depth),
}


@dataclass(frozen=True)
class ClassKeys:
    """Sizes of the keys that every item has where part_3 is among the observations.

    Attributes:
        own: categories that the manifest adds.
        most_sources: most sources of one observation, at least 1.
        categories: whether the category masks are read.
        stems: whether the stems are read.
    """

    own: tuple[str, ...]
    most_sources: int
    categories: bool
    stems: bool

    @classmethod
    def among(cls, dataset: Dataset, keys: Sequence[str], *, categories: bool, stems: bool) -> Self:
        """Read the records of the observations ``keys``.

        Raises:
            Avs3dError: if one does not fit the schema.
        """
        records = [record for record in (dataset[key].record for key in keys) if record is not None]
        own = dataset.record.categories if dataset.record else records[0].categories if records else None
        return cls(own or (), max([1, *(len(record.sound_sources) for record in records)]), categories, stems)

    def kinds(self, observation: Observation) -> tuple[str, ...]:
        """The kinds of files that they need of an observation; one without any sound has no stems."""
        record = observation.record
        if record is None or record.sources is None:
            return ()
        stems = self.stems and (record.sources or record.background is not None)
        return ((CATEGORIES,) if self.categories else ()) + ((STEMS,) if stems else ())


@dataclass(frozen=True, eq=False)
class ItemFacts:
    """An observation in small arrays, and where the files of its frames are.

    Attributes:
        rows: frame name → row of the arrays.
        numbers: key of the item → (n, …) values.
        texts: key of the item → n texts.
        kinds: kinds of files that the observation has.
        class_id: of its (first) source's category; 0: there is none, or it is of no class.
        classes: class id of each source; empty if the sources are not known.
    """

    rows: dict[str, int]
    numbers: dict[str, NDArray[Any]]
    texts: dict[str, tuple[str, ...]]
    kinds: dict[str, FileKind]
    class_id: int
    classes: tuple[int, ...]

    @classmethod
    def of(cls, observation: Observation, frames: Sequence[tuple[str, int]], keys: ClassKeys | None) -> Self:
        """Read what is known of some frames, from the observation's record (or its `sparse/0`).

        Args:
            observation: theirs.
            frames: (name, number) of each; their files are looked for when they are read.
            keys: None if part_3 is not among the observations.
        """
        # Not the frames that lie there now: a file that has vanished since is named when it is read.
        found = [Frame(observation, name, index) for name, index in frames]
        table = [frame_facts(frame) for frame in found]
        record = observation.record
        for facts in table:
            # An observation with a frame that COLMAP did not register has the same keys as the others in its batch.
            facts["camera_to_world"] = facts["camera_to_world"] or _NO_POSE
            if record is not None:
                facts |= {name: value for name, value in NO_SOURCE.items() if facts[name] is None}
        numbers = {
            name: np.array([facts[name] for facts in table], dtype=kind)
            for name, kind in _NUMBERS.items()
            if all(facts[name] is not None for facts in table)
        }
        texts = {
            name: tuple(str(facts[name]) for facts in table)
            for name in _TEXTS
            if all(facts[name] is not None for facts in table)
        }
        ids = class_ids((record.categories if record else None) or (keys.own if keys else ()))
        class_id = ids.get(observation.category or "", 0)  # a sound of another room may be of no class
        if record is not None:
            numbers["category_index"] = np.full(len(found), class_id - 1 if class_id else NO_CATEGORY, dtype=np.int64)
        if keys is not None:
            texts["group"] = (observation.group_key,) * len(found)
            numbers["audible"] = np.array([_audible_classes(frame, ids) for frame in found])
        classes = tuple(ids.get(source.category, 0) for source in record.sound_sources) if record else ()
        rows = {frame.name: row for row, frame in enumerate(found)}
        return cls(rows, numbers, texts, file_kinds(observation, (*READERS, CATEGORIES, STEMS)), class_id, classes)

    def read(self, names: Sequence[str], keys: ClassKeys | None, base: Path, frame: tuple[str, int]) -> dict[str, Any]:
        """The arrays of a frame, by the key of the item.

        Args:
            names: of `READERS`.
            keys: None if part_3 is not among the observations.
            base: the observation's folder.
            frame: name and number.

        Raises:
            Avs3dError: if a file is missing or damaged.
        """
        out: dict[str, Any] = {}
        for name in names:
            key, read = READERS[name]
            out[key] = read(self.kinds[name].file(base, *frame))
        if keys is not None and keys.categories:
            out["category_mask"] = self._category_mask(base, frame)
        if keys is not None and keys.stems:
            out |= self._stems(keys.most_sources, base, frame)
        return out

    @property
    def _one_source(self) -> bool:
        """Whether one source always sounds, as in part_1 and part_2: no files tell sources apart."""
        return CATEGORIES not in self.kinds

    def _category_mask(self, base: Path, frame: tuple[str, int]) -> NDArray[np.uint8]:
        if not self._one_source:
            return media.read_png_categories(self.kinds[CATEGORIES].file(base, *frame))
        mask = media.read_png_mask(self.kinds["mask"].file(base, *frame))
        return mask.astype(np.uint8) * np.uint8(self.class_id)

    def _stems(self, most: int, base: Path, frame: tuple[str, int]) -> dict[str, NDArray[Any]]:
        stems = np.zeros((most, 2, layout.BINAURAL_SAMPLES), dtype=np.float32)
        classes = np.zeros(most, dtype=np.int64)
        background = np.zeros_like(stems[0])
        if self._one_source:
            stems[0] = read_binaural(self.kinds["binaural"].file(base, *frame))
        elif STEMS in self.kinds:
            kind = self.kinds[STEMS]
            for number, source in enumerate(kind.sources or ()):
                clip = read_binaural(kind.file(base, *frame, source))
                if source == layout.BACKGROUND:
                    background = clip
                else:
                    stems[number] = clip
        if self._one_source or STEMS in self.kinds:
            classes[: len(self.classes)] = self.classes
        return {"stems": stems, "stem_classes": classes, "background": background}


def _audible_classes(frame: Frame, ids: dict[str, int]) -> NDArray[np.bool_]:
    """(K,) whether a source of class c is audible, in place c − 1; none is known in the official release."""
    record, entry = frame.observation.record, frame.record
    heard = [ids.get(source.category, 0) for source in record.audible_sources(entry)] if record and entry else []
    return np.isin(np.arange(1, len(ids) + 1), heard)
