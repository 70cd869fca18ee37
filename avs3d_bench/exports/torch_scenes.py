"""Items of `AVS3DDataset` in part_3; an item of the other parts is handled as one with a single source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout, media
from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.exports.samples import FileKind
from avs3d_bench.schema import ObservationRecord

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


@dataclass(frozen=True)
class Scenes:
    """Sizes that all items of a dataset with part_3 have in common.

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
        return cls(own or (), max([1, *(len(record.sources or ()) for record in records)]), categories, stems)

    def kinds(self, observation: Observation) -> tuple[str, ...]:
        """The kinds of files of part_3 that are read of an observation; one without any sound has no stems."""
        record = observation.record if observation.is_sound_scene else None
        if record is None:
            return ()
        stems = self.stems and (record.sources or record.background is not None)
        return ((CATEGORIES,) if self.categories else ()) + ((STEMS,) if stems else ())


@dataclass(frozen=True)
class SceneFiles:
    """Where the scene of a frame is read from.

    Attributes:
        kinds: kinds of files that the observation has.
        class_id: of its (first) source's category; 0: there is none.
        classes: class id of each source; empty in part_1 and part_2.
    """

    kinds: Mapping[str, FileKind]
    class_id: int
    classes: tuple[int, ...]

    def read(self, scenes: Scenes, base: Path, name: str, index: int) -> dict[str, NDArray[Any]]:
        """``category_mask``, ``stems``, ``stem_classes`` and ``background`` of a frame, as far as they are asked for.

        Args:
            scenes: what is asked for.
            base: the observation's folder.
            name: of the frame.
            index: its number.

        Raises:
            Avs3dError: if a file is missing or damaged.
        """
        mask = {"category_mask": self._category_mask(base, name, index)} if scenes.categories else {}
        return mask | (self._stems(scenes.most_sources, base, name, index) if scenes.stems else {})

    def _category_mask(self, base: Path, name: str, index: int) -> NDArray[np.uint8]:
        if CATEGORIES in self.kinds:
            return media.read_png_categories(self.kinds[CATEGORIES].file(base, name, index))
        mask = media.read_png_mask(self.kinds["mask"].file(base, name, index))
        return mask.astype(np.uint8) * np.uint8(self.class_id)

    def _stems(self, most: int, base: Path, name: str, index: int) -> dict[str, NDArray[Any]]:
        stems = np.zeros((most, 2, layout.BINAURAL_SAMPLES), dtype=np.float32)
        classes = np.zeros(most, dtype=np.int64)
        background = np.zeros_like(stems[0])
        if CATEGORIES not in self.kinds:
            stems[0] = read_binaural(self.kinds["binaural"].file(base, name, index))
            classes[0] = self.class_id
        elif STEMS in self.kinds:
            kind = self.kinds[STEMS]
            for number, source in enumerate(kind.sources or ()):
                clip = read_binaural(kind.file(base, name, index, source))
                if source == layout.BACKGROUND:
                    background = clip
                else:
                    stems[number] = clip
            classes[: len(self.classes)] = self.classes
        return {"stems": stems, "stem_classes": classes, "background": background}


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


def audible_classes(
    record: ObservationRecord | None, frame: Frame, classes: Mapping[str, int], class_id: int
) -> NDArray[np.bool_]:
    """(K,) whether a source of class c is audible, in place c − 1; in part_1 and part_2 the one source always is."""
    heard = [class_id] if class_id else []
    if record is not None and frame.record is not None and frame.record.audible is not None:
        heard = [classes[record.source(entry.source).category] for entry in frame.record.audible]
    return np.isin(np.arange(1, len(classes) + 1), heard)
