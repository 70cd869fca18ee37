"""The counts of a group of part_3, for ``listen``: siblings, which have the same pictures and another sound.

A group is scored whole in one process, so that every mask of the dataset and of the submission is decoded once: the
truth of a sibling serves its own figures and those of all its pairs. One frame of all siblings is in memory at a time;
all that is kept are counts. `evaluators.protocols.source_counts` counts other things, for the protocols of part_1 and
part_2: it compares boundaries, twins and volumes of one source, this one predictions and truths of siblings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import BLIND_REFERENCES, ObservationScores, PairKind, SiblingScores
from avs3d_bench.contract.taxonomy import class_ids
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.measures.deaf_oracles import can_sound, instance_ids_of
from avs3d_bench.measures.pair_kinds import pair_kind
from evaluators.metrics.classes import Confusion, confusion
from evaluators.metrics.frames import Truth, reference_figures
from evaluators.metrics.masks import U8, FrameCounts, as_bytes, frame_counts
from evaluators.metrics.pairs import CrossCounts, differ, right_pair, sibling_scores
from evaluators.protocols.listen import listen_observation
from evaluators.reading.reader import Reader
from evaluators.reading.records import (
    FrameScore,
    FrameTally,
    GroupFigures,
    ObservationFigures,
    SiblingFrame,
    observation_scores,
)
from evaluators.references.deaf import DeafOracles


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


class SiblingCounts:
    """Counts the siblings of a group under ``listen``, frame by frame.

    Attributes:
        group: its key.
        observations: the siblings to score.
        own: the counts of the submission.
        references: name of the blind reference → its counts.
        deaf: of the deaf oracles; None where the instances are not known.
        differing: of each frame, the pairs of siblings whose truths differ.
        names: of each frame.
    """

    def __init__(self, observations: Sequence[Observation], *, categories: bool) -> None:
        """Nothing counted yet.

        Args:
            observations: the siblings to score.
            categories: whether the submission has categories/: then classes are counted, too.
        """
        first = observations[0]
        self.group, self.observations = first.group_key, observations
        self._ids = first.record.class_ids if first.record else class_ids()
        self._highest = len(self._ids) if categories else None
        side = len(self._ids) + 1
        self.own = _Counted(classes=[np.zeros((side, side), np.int64) for _ in observations] if categories else None)
        self.references = {name: _Counted() for name in BLIND_REFERENCES}
        self.deaf: DeafOracles | None = None
        # The instances of all siblings are those of the first: they have the same pictures.
        if first.record is not None and first.where(layout.INSTANCE_MASKS).is_dir():
            able = {instance.id: self._ids[instance.category] for instance in can_sound(first.record)}
            self.deaf = DeafOracles(able, len(self._ids) if categories else 1)
        self.differing: list[list[tuple[int, int]]] = []
        self.names: list[str] = []

    def add(self, siblings: Sequence[Frame], readers: Sequence[Reader]) -> None:
        """Read the truth and the prediction of a frame for every sibling, and count them if no file is bad."""
        truth = _read_truth(siblings, self._highest)
        name = siblings[0].name
        read = [reader.mask(name, truth.size) for reader in readers]
        found: list[U8 | None] = []
        if self._highest is not None:
            marks = zip(readers, read, strict=True)
            found = [reader.categories(name, truth.size, self._highest, mask) for reader, mask in marks]
        if any(reader.problems for reader in readers):
            return  # there is no score: only look for further bad files
        masks = [mask for mask in read if mask is not None]
        classes = [ids for ids in found if ids is not None]
        self.names.append(name)
        self.differing.append(truth.differing)
        self.own.frames.append([[frame_counts(mask, marked) for mask in truth.masks] for marked in masks])
        if self.own.classes is not None and truth.classes is not None:
            for counts, true, predicted in zip(self.own.classes, truth.classes, classes, strict=True):
                counts += confusion(true, predicted, len(counts) - 1)
        figures = [reference_figures(Truth(mask, None, None)) for mask in truth.masks]
        for reference, kept in self.references.items():
            kept.frames.append(_alike([figure[reference].counts for figure in figures]))
        if self.deaf is not None:
            self.deaf.add(instance_ids_of(siblings[0], truth.size), truth.labels)

    def figures(self, clouds: Sequence[NDArray[np.float32] | None]) -> GroupFigures:
        """The figures of the siblings; ``clouds`` are not scored, because an observation may have several sources."""
        del clouds
        keys, own, references = [one.key for one in self.observations], self.own, self._all_references()
        kinds = _kinds(self.observations)
        pairs = {
            name: sibling_scores(self.group, keys, self.differing, each.frames, kinds)
            for name, each in references.items()
        }
        siblings = sibling_scores(self.group, keys, self.differing, own.frames, kinds)
        out = []
        for index, observation in enumerate(self.observations):
            shown = [
                FrameScore.of(observation.key, name, found[index][index])
                for name, found in zip(self.names, own.frames, strict=True)
            ]
            beside = {name: self._scores(index, each, pairs[name]) for name, each in references.items()}
            out.append(
                ObservationFigures(self._scores(index, own, siblings), beside, shown, _tallies(index, shown, self))
            )
        return GroupFigures(out, siblings, pairs, _shown(siblings, self))

    def _all_references(self) -> dict[str, _Counted]:
        """Those of the blind references and of the deaf oracles."""
        out, deaf = dict(self.references), self.deaf
        if deaf is None:
            return out
        for name, rows in deaf.rows().items():
            classes = None if self.own.classes is None else deaf.classes(rows, len(self._ids))
            out[name] = _Counted([_alike(counts) for counts in deaf.counts(rows)], classes)
        return out

    def _scores(self, index: int, counted: _Counted, siblings: SiblingScores) -> ObservationScores:
        """The scores of the sibling ``index`` under a prediction."""
        observation = self.observations[index]
        own = [counts[index][index] for counts in counted.frames]
        classes = None if counted.classes is None else counted.classes[index]
        names = {number: name for name, number in self._ids.items()}
        listen = listen_observation(observation.key, own, siblings, classes, names)
        return observation_scores(observation, len(own), group=siblings.group, listen=listen)


def _kinds(siblings: Sequence[Observation]) -> dict[tuple[int, int], PairKind]:
    """Pair (places in ``siblings``) → its kind, of those whose sources are known."""
    known = [(place, one.record) for place, one in enumerate(siblings) if one.record is not None]
    return {(a, b): pair_kind(first, second) for (a, first), (b, second) in combinations(known, 2)}


def _tallies(index: int, shown: Sequence[FrameScore], counts: SiblingCounts) -> tuple[FrameTally, ...]:
    """The counts of the sibling ``index`` in each frame, with the pairs that it takes part in."""
    found = []
    for frame, cross, differing in zip(shown, counts.own.frames, counts.differing, strict=True):
        mine = [pair for pair in differing if index in pair]
        right = sum(right_pair(cross, *pair) for pair in mine)
        found.append(FrameTally(frame.name, cross[index][index], pairs=(len(mine), right)))
    return tuple(found)


def _shown(siblings: SiblingScores, counts: SiblingCounts) -> SiblingFrame | None:
    """The frame with the most wrong pairs; of equals that in which the most truths differ, then the first."""
    found = []
    for name, pairs, frame in zip(counts.names, counts.differing, counts.own.frames, strict=True):
        right = sum(right_pair(frame, *pair) for pair in pairs)
        found.append(SiblingFrame(siblings.group, siblings.observations, name, len(pairs), right))
    worst = max(found, key=lambda one: (one.pairs - one.right, one.pairs))
    return worst if worst.pairs else None


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
