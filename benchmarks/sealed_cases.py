"""What an attacker on a sealed test has to guess: read `load_cases`.

Three questions. *twin* (part_2): which of several identical objects sounds. *object* (part_1): which of all objects
that could sound. *sibling* (part_3): which of two observations with the same pictures has nothing to mark. An attacker
is granted a perfect segmentation of all objects, the groups of siblings and the category of the sound in part_2, but
may not listen: whoever listens solves the task.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.formats import files, media
from avs3d_bench.formats.colmap import ColmapModel, read_model
from avs3d_bench.formats.yamlfile import read_yaml
from avs3d_bench.sealing.seal import TEMPLATE

Array = NDArray[np.float64]
Question = Literal["twin", "object", "sibling", "take"]
QUESTIONS: tuple[Question, ...] = ("twin", "object", "sibling", "take")
#: Seed of the order in which the siblings of a pair are shown to the attacks.
PAIR_SEED = 16


@dataclass(frozen=True, eq=False)
class Case:
    """One question about one observation, or about two siblings.

    Attributes:
        question: which.
        root: the public folder.
        keys: of the candidates' observations: the same one for all objects of an observation.
        names: of the candidates' categories; empty texts for siblings.
        instances: the candidates' ids in the pictures of instance ids; none for siblings.
        ids: (n, H, W) instance ids of the first candidate's observation.
        truth: index of the right candidate.
        visible: categories of all objects in the pictures, sorted, those that cannot sound included.
        template: observations of the manifest from which the test was drawn; the attacker is granted them.
        reference: key of the sibling with which the candidates are compared; empty but for the question *take*.
    """

    question: Question
    root: Path
    keys: tuple[str, ...]
    names: tuple[str, ...]
    instances: tuple[int, ...]
    ids: NDArray[np.uint16]
    truth: int
    visible: tuple[str, ...] = ()
    template: tuple[dict[str, Any], ...] | None = None
    reference: str = ""

    @property
    def folders(self) -> tuple[Path, ...]:
        """Public folder of each candidate's observation."""
        return tuple(self.root / key for key in self.keys)

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self.keys)

    @cached_property
    def areas(self) -> Array:
        """(K, n) visible pixels of each candidate in each frame."""
        return np.array([(self.ids == one).sum(axis=(1, 2)) for one in self.instances], dtype=np.float64)

    @cached_property
    def model(self) -> ColmapModel:
        """The sparse model of the first candidate's observation."""
        return read_model(self.folders[0] / layout.COLMAP)

    @cached_property
    def on_points(self) -> NDArray[np.bool_]:
        """(K, N) whether a sighting of a point of the sparse model lies on a candidate."""
        size = int(self.model.points.ids.max(initial=0)) + 1
        out = np.zeros((self.count, size), dtype=bool)
        for image in self.model.images:
            frame = layout.frame_index(Path(image.name).stem)
            column, row = np.clip(image.pixels.astype(int), 0, np.array(self.ids.shape[:0:-1]) - 1).T
            seen = self.ids[frame, row, column]
            for place, one in enumerate(self.instances):
                out[place, image.point_ids[seen == one]] = True
        return out[:, self.model.points.ids]


def load_cases(public: Path, private: Path) -> list[Case]:
    """The questions about a sealed test, or about any tree and its truth.

    Args:
        public: what the attacks read.
        private: has ``observation.json``, ``instance_masks/`` and ``semantic_masks/`` of all observations, and the
            template of a sealed test.
    """
    records = [
        files.read_record(path, ObservationRecord)
        for path in sorted(private.glob(f"part_*/*/*/*/{layout.OBSERVATION_JSON}"))
    ]
    template = _template(private)
    cases = [
        dataclasses.replace(case, template=template)
        for record in records
        if not record.is_part_3 and (case := _objects(public, private, record))
    ]
    return [*cases, *_siblings(public, private, [record for record in records if record.is_part_3])]


def _objects(public: Path, private: Path, record: ObservationRecord) -> Case | None:
    chosen = [
        one
        for one in record.instances
        if one.category in record.class_ids and (record.part == "part_1" or one.category == record.category)
    ]
    if len(chosen) < 2:
        return None
    return Case(
        question="object" if record.part == "part_1" else "twin",
        root=public,
        keys=(record.key,) * len(chosen),
        names=tuple(one.category for one in chosen),
        instances=tuple(one.id for one in chosen),
        ids=_ids(private / record.key),
        truth=next(place for place, one in enumerate(chosen) if one.sounding),
        visible=tuple(sorted(one.category for one in record.instances)),
    )


def _template(private: Path) -> tuple[dict[str, Any], ...] | None:
    path = private / TEMPLATE
    return tuple(read_yaml(path)[0]["observations"]) if path.exists() else None


def _siblings(public: Path, private: Path, records: Sequence[ObservationRecord]) -> Iterator[Case]:
    """Pairs of siblings with and without something to mark; no observation is in two pairs."""
    rng = np.random.default_rng(PAIR_SEED)
    for group in sorted({record.group or record.key for record in records}):
        keys = [record.key for record in records if (record.group or record.key) == group]
        keys = [keys[number] for number in rng.permutation(len(keys))]
        empty = [key for key in keys if not _marks(private / key)]
        full = [key for key in keys if key not in empty]
        for without, with_something in zip(empty, full, strict=False):
            truth = int(rng.integers(2))
            pair = (with_something, without) if truth else (without, with_something)
            yield Case("sibling", public, pair, ("", ""), (), np.zeros((0, 0, 0), np.uint16), truth)


def _marks(folder: Path) -> bool:
    return any(media.read_png_mask(path).any() for path in sorted((folder / layout.SEMANTIC_MASKS).glob("*.png")))


def _ids(folder: Path) -> NDArray[np.uint16]:
    return np.stack([media.read_png_ids(path) for path in sorted((folder / layout.INSTANCE_MASKS).glob("*.png"))])


def texts(root: Path) -> dict[str, Any]:
    """Name → document of the JSON files at the top of a tree."""
    return {path.name: json.loads(path.read_text()) for path in sorted(root.glob("*.json"))}


def text_about(root: Path, key: str) -> str:
    """All text about an observation: its own JSON files, and what those at the top have under or beside its key."""
    found = [path.read_text() for path in sorted((root / key).rglob("*.json"))]
    found += [json.dumps(part) for document in texts(root).values() for part in _about(document, key)]
    return "\n".join(found)


def _about(document: Any, key: str) -> Iterator[Any]:
    if isinstance(document, dict):
        if document.get("key") == key:
            yield document
            return
        for name, value in document.items():
            if name == key:
                yield value
            else:
                yield from _about(value, key)
    elif isinstance(document, list):
        for value in document:
            yield from _about(value, key)
