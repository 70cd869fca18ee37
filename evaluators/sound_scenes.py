"""Scoring a group of sound scenes (part_3): siblings, which have the same pictures and another sound.

A group is scored whole in one process, so that every mask of the dataset and of the submission is decoded once: the
truth of a sibling serves its own figures and those of all its pairs. One frame of all siblings is in memory at a time;
all that is kept are counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from avs3d_bench import layout
from avs3d_bench.dataset import Frame, Observation, sibling_frames
from avs3d_bench.deaf_oracles import can_sound, instance_ids_of
from avs3d_bench.errors import Avs3dError
from avs3d_bench.parallel import advance
from avs3d_bench.schema import ObservationRecord
from avs3d_bench.scores import BLIND_REFERENCES, ObservationScores, SiblingScores
from avs3d_bench.taxonomy import class_ids
from evaluators.classes import Confusion, confusion
from evaluators.deaf import DeafOracles
from evaluators.frames import Truth, reference_figures
from evaluators.listen import listen_observation
from evaluators.metrics import U8, FrameCounts, as_bytes, frame_counts
from evaluators.origin import observation_digests
from evaluators.pairs import CrossCounts, differ, right_pair, sibling_scores
from evaluators.reading.reader import Reader
from evaluators.records import (
    FrameScore,
    FrameTally,
    ScoredObservation,
    SiblingFrame,
    Submission,
    best_frames,
    worst_frames,
)


@dataclass(frozen=True)
class GroupOutcome:
    """The scores of a group.

    Attributes:
        outcomes: of each sibling, by key.
        siblings: the pairs; None if a file of the submission is bad.
        references: name of the reference → its pairs.
        shown: a frame for the report; None if the truths of no pair differ.
    """

    outcomes: Mapping[str, ScoredObservation]
    siblings: SiblingScores | None = None
    references: Mapping[str, SiblingScores] = field(default_factory=dict)
    shown: SiblingFrame | None = None


@dataclass
class _Counted:
    """The counts of one prediction.

    Attributes:
        frames: of each test frame, the prediction for every sibling against the truth of every sibling.
        classes: of each sibling, pixels by true and predicted class, over all frames; None without class ids.
    """

    frames: list[CrossCounts] = field(default_factory=list)
    classes: list[Confusion] | None = None


@dataclass(frozen=True)
class _FrameTruth:
    """The truth of one frame of all siblings.

    Attributes:
        masks: (H, W) uint8 of each, non-zero where something audible is visible.
        classes: (H, W) uint8 class ids of each; None where they are not needed.
        differing: the pairs of siblings whose masks differ.
    """

    masks: list[U8]
    classes: list[U8] | None
    differing: list[tuple[int, int]]

    @property
    def size(self) -> tuple[int, int]:
        height, width = self.masks[0].shape
        return height, width

    @property
    def labels(self) -> list[U8]:
        """The class ids, or else masks of 0 and 1."""
        return self.classes or [(mask > 0).view(np.uint8) for mask in self.masks]


@dataclass
class _GroupCounts:
    """All counts of a group.

    Attributes:
        own: of the submission.
        references: name of the blind reference → its counts.
        deaf: of the deaf oracles; None where the instances are not known.
        differing: of each frame, the pairs of siblings whose truths differ.
    """

    own: _Counted
    references: dict[str, _Counted]
    deaf: DeafOracles | None
    differing: list[list[tuple[int, int]]] = field(default_factory=list)

    @classmethod
    def start(cls, siblings: int, record: ObservationRecord | None, ids: Mapping[str, int], categories: bool) -> Self:
        """Nothing counted yet; with ``categories`` classes are counted, too."""
        side = len(ids) + 1
        own = _Counted(classes=[np.zeros((side, side), np.int64) for _ in range(siblings)] if categories else None)
        deaf = None
        if record is not None:
            deaf = DeafOracles({i.id: ids[i.category] for i in can_sound(record)}, len(ids) if categories else 1)
        return cls(own, {name: _Counted() for name in BLIND_REFERENCES}, deaf)

    def add(
        self, truth: _FrameTruth, masks: Sequence[U8], classes: Sequence[U8], instances: NDArray[np.uint16] | None
    ) -> None:
        """Count a frame.

        Args:
            truth: of all siblings.
            masks: the prediction for each sibling, (H, W) uint8.
            classes: its class ids, likewise; empty without categories/.
            instances: (H, W) instance ids; None where they are not known.
        """
        self.differing.append(truth.differing)
        self.own.frames.append([[frame_counts(mask, marked) for mask in truth.masks] for marked in masks])
        if self.own.classes is not None and truth.classes is not None:
            for counts, true, predicted in zip(self.own.classes, truth.classes, classes, strict=True):
                counts += confusion(true, predicted, len(counts) - 1)
        figures = [reference_figures(Truth(mask, None, None)) for mask in truth.masks]
        for name, kept in self.references.items():
            kept.frames.append(_alike([figure[name].counts for figure in figures]))
        if self.deaf is not None and instances is not None:
            self.deaf.add(instances, truth.labels)

    def all_references(self) -> dict[str, _Counted]:
        """Those of the blind references and of the deaf oracles."""
        out = dict(self.references)
        deaf = self.deaf
        if deaf is None:
            return out
        for name, rows in deaf.rows().items():
            classes = None if self.own.classes is None else deaf.classes(rows, len(self.own.classes[0]) - 1)
            out[name] = _Counted([_alike(counts) for counts in deaf.counts(rows)], classes)
        return out


def score_group(
    observations: Sequence[Observation], submission: Submission, points: bool, categories: bool, group: str
) -> GroupOutcome:
    """Score the siblings of a group under ``listen``.

    Args:
        observations: the siblings to score.
        submission: where its files lie.
        points: whether the submission has 3D predictions; they are read and not scored.
        categories: whether it has categories/.
        group: its key.

    Raises:
        Avs3dError: if the dataset is damaged.
    """
    keys = [observation.key for observation in observations]
    frames = sibling_frames(observations)
    record = observations[0].record
    ids = record.class_ids if record else class_ids()
    highest = len(ids) if categories else None
    readers = [Reader(submission, key) for key in keys]
    # The instances of all siblings are those of the first: they have the same pictures.
    known = record is not None and observations[0].where(layout.INSTANCE_MASKS).is_dir()
    counts = _GroupCounts.start(len(keys), record if known else None, ids, categories)
    for number, siblings in enumerate(frames):
        advance(number, len(frames))
        truth = _read_truth(siblings, highest)
        name = siblings[0].name
        read = [reader.mask(name, truth.size) for reader in readers]
        classes: list[U8 | None] = []
        if highest is not None:
            marks = zip(readers, read, strict=True)
            classes = [reader.categories(name, truth.size, highest, mask) for reader, mask in marks]
        if not any(reader.problems for reader in readers):  # Else there is no score: only look for further bad files.
            instances = instance_ids_of(siblings[0], truth.size) if known else None
            counts.add(truth, [m for m in read if m is not None], [c for c in classes if c is not None], instances)
    for reader in readers if points else ():
        reader.points()
    if any(reader.problems for reader in readers):
        return GroupOutcome(
            {r.key: ScoredObservation(None, problems=tuple(r.problems), files=r.files) for r in readers}
        )
    return _judge(group, observations, frames, counts, readers, {number: name for name, number in ids.items()})


def _judge(
    group: str,
    observations: Sequence[Observation],
    frames: Sequence[Sequence[Frame]],
    counts: _GroupCounts,
    readers: Sequence[Reader],
    names: Mapping[int, str],
) -> GroupOutcome:
    """From the counts of a group to the scores of its siblings; ``names`` are the categories of class ids."""
    keys = [observation.key for observation in observations]
    own, references = counts.own, counts.all_references()
    pairs = {name: sibling_scores(group, keys, counts.differing, each.frames) for name, each in references.items()}
    siblings = sibling_scores(group, keys, counts.differing, own.frames)
    outcomes = {}
    for index, (observation, reader) in enumerate(zip(observations, readers, strict=True)):
        shown = [
            FrameScore.of(observation.key, of[index].name, found[index][index])
            for of, found in zip(frames, own.frames, strict=True)
        ]
        beside = {name: _scores(observation, index, each, pairs[name], names) for name, each in references.items()}
        digests = observation_digests(observation, reader.digests)
        outcomes[observation.key] = ScoredObservation(
            _scores(observation, index, own, siblings, names).model_copy(update={"digests": digests}),
            beside,
            worst_frames(shown),
            best_frames(shown),
            warnings=reader.warnings,
            files=reader.files,
            frames=_tallies(index, shown, counts),
        )
    names_ = [siblings_[0].name for siblings_ in frames]
    return GroupOutcome(outcomes, siblings, pairs, _shown(siblings, names_, counts))


def _tallies(index: int, shown: Sequence[FrameScore], counts: _GroupCounts) -> tuple[FrameTally, ...]:
    """The counts of the sibling ``index`` in each frame, with the pairs that it takes part in."""
    found = []
    for frame, cross, differing in zip(shown, counts.own.frames, counts.differing, strict=True):
        mine = [pair for pair in differing if index in pair]
        right = sum(right_pair(cross, *pair) for pair in mine)
        found.append(FrameTally(frame.name, cross[index][index], pairs=(len(mine), right)))
    return tuple(found)


def _shown(siblings: SiblingScores, names: Sequence[str], counts: _GroupCounts) -> SiblingFrame | None:
    """The frame with the most wrong pairs; of equals that in which the most truths differ, then the first."""
    found = []
    for name, pairs, frame in zip(names, counts.differing, counts.own.frames, strict=True):
        right = sum(right_pair(frame, *pair) for pair in pairs)
        found.append(SiblingFrame(siblings.group, siblings.observations, name, len(pairs), right))
    worst = max(found, key=lambda one: (one.pairs - one.right, one.pairs))
    return worst if worst.pairs else None


def _scores(
    observation: Observation, index: int, counted: _Counted, siblings: SiblingScores, names: Mapping[int, str]
) -> ObservationScores:
    """The scores of the sibling ``index`` under a prediction."""
    place = observation.place
    own = [counts[index][index] for counts in counted.frames]
    classes = None if counted.classes is None else counted.classes[index]
    return ObservationScores.model_validate(
        {
            "key": observation.key,
            "part": place.part,
            "scan": place.scan,
            "room": place.room,
            "category": observation.category,
            "group": siblings.group,
            "frames": len(own),
            "listen": listen_observation(observation.key, own, siblings, classes, names),
        }
    )


def _alike(counts: list[FrameCounts]) -> CrossCounts:
    """The counts of a frame of a prediction that is the same for all siblings.

    Args:
        counts: of the prediction against the truth of each sibling.
    """
    return [counts] * len(counts)


def _read_truth(siblings: Sequence[Frame], highest: int | None) -> _FrameTruth:
    """The truth of a frame of all siblings, with class ids up to ``highest`` unless that is None.

    Raises:
        Avs3dError: if a file is damaged, or the sizes differ.
    """
    masks = [as_bytes(frame.mask()) for frame in siblings]
    classes = None if highest is None else [frame.category_mask() for frame in siblings]
    for frame, mask, labels in zip(siblings, masks, classes or masks, strict=True):
        if mask.shape != masks[0].shape or labels.shape != mask.shape:
            raise Avs3dError(
                f"{frame.path(layout.SEMANTIC_MASKS)}: shape {mask.shape}, expected that of its category mask and of "
                f"{siblings[0].observation.key}, {masks[0].shape}; regenerate the dataset"
            )
        if highest is not None and labels.max(initial=0) > highest:
            raise Avs3dError(
                f"{frame.path(layout.CATEGORY_MASKS)}: class id {labels.max()}, expected at most {highest}; "
                "regenerate the dataset"
            )
    pairs = combinations(range(len(masks)), 2)
    return _FrameTruth(masks, classes, [(a, b) for a, b in pairs if differ(frame_counts(masks[a], masks[b]))])
