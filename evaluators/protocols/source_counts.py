"""The counts of an observation of part_1 or part_2, for ``official`` and ``strict``: one source, always marked.

One frame is in memory at a time; all that is kept are counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.scores import BLIND_REFERENCES, ObservationScores, Protocol
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.measures.deaf_oracles import instance_ids_of
from evaluators.metrics.frames import FrameFigures, Truth, frame_figures, reference_figures
from evaluators.metrics.masks import as_bytes
from evaluators.metrics.volume import VolumeScore, score_points, true_volume
from evaluators.protocols.official import official_observation
from evaluators.protocols.strict import MOVING, NO_INSTANCE_MASKS, NO_MESH, NO_POINTS, ONE_INSTANCE, strict_observation
from evaluators.reading.reader import Reader
from evaluators.reading.records import FrameScore, FrameTally, GroupFigures, ObservationFigures, observation_scores
from evaluators.references.deaf import DeafFrame, deaf_frame, deaf_references


class SourceCounts:
    """Counts an observation, frame by frame.

    Attributes:
        observation: to score.
        wanted: the protocols.
        own: the figures of the submission.
        references: name of the blind reference → its figures.
        deaf: the figures of the deaf predictions, under ``strict`` where the instances are known.
        frames: the frames for a report.
    """

    def __init__(self, observation: Observation, wanted: Sequence[Protocol]) -> None:
        """Nothing counted yet."""
        self.observation, self.wanted = observation, wanted
        self._strict = "strict" in wanted
        self._twin_ids = _twin_ids(observation) if self._strict else None
        self.own: list[FrameFigures] = []
        self.references: dict[str, list[FrameFigures]] = {name: [] for name in BLIND_REFERENCES}
        self.deaf: list[DeafFrame] = []
        self.frames: list[FrameScore] = []

    def add(self, siblings: Sequence[Frame], readers: Sequence[Reader]) -> None:
        """Read the truth and the prediction of a frame, and count them if no file is bad."""
        (frame,), (reader,) = siblings, readers
        truth = _truth(frame, self._twin_ids, self._strict)
        height, width = truth.mask.shape
        prediction = reader.mask(frame.name, (height, width))
        if prediction is None or reader.problems:
            return  # there is no score: only look for further bad files
        found = frame_figures(truth, prediction)
        self.own.append(found)
        for name, reference in reference_figures(truth).items():
            self.references[name].append(reference)
        record = self.observation.record
        if self._strict and record is not None:
            self.deaf.append(deaf_frame(truth, record.sounding.id))
        self.frames.append(FrameScore.of(self.observation.key, frame.name, found.counts, found.twins_marked))

    def figures(self, clouds: Sequence[NDArray[np.float32] | None]) -> GroupFigures:
        """The figures of the observation; ``clouds`` has its 3D prediction, (N, 3) metres, or None."""
        (cloud,) = clouds
        volume = _volume(self.observation, cloud) if self._strict and cloud is not None else None
        references = self.references | (deaf_references(self.deaf) if self.deaf else {})
        beside = {name: self._scores(figures, None, points=False) for name, figures in references.items()}
        tallies = tuple(
            FrameTally(
                frame.name,
                found.counts,
                found.boundary_f,
                None if found.twins is None else (len(found.twins), found.twins_marked),
            )
            for frame, found in zip(self.frames, self.own, strict=True)
        )
        scores = self._scores(self.own, volume, points=cloud is not None)
        return GroupFigures([ObservationFigures(scores, beside, self.frames, tallies)])

    def _scores(self, frames: Sequence[FrameFigures], volume: VolumeScore | None, *, points: bool) -> ObservationScores:
        """The scores under a prediction; ``points``: whether it is 3D as well."""
        observation = self.observation
        unavailable = {}
        if observation.place.part == "part_1":
            unavailable["wrong_instance_rate"] = ONE_INSTANCE
        elif observation.record is None:
            unavailable["wrong_instance_rate"] = NO_INSTANCE_MASKS
        if volume is None:
            reason = NO_POINTS if not points else MOVING if _moves(observation) else NO_MESH
            unavailable |= {"IoU_3D": reason, "centroid_error": reason}
        return observation_scores(
            observation,
            len(frames),
            official=official_observation(frames) if "official" in self.wanted else None,
            strict=strict_observation(frames, volume, unavailable) if self._strict else None,
        )


def _twin_ids(observation: Observation) -> tuple[int, ...] | None:
    """Ids of the silent instances of the sounding category; None where they are not known."""
    record = observation.record
    if record is None or observation.place.part == "part_1":
        return None
    return tuple(i.id for i in record.instances if i.category == record.category and not i.sounding)


def _truth(frame: Frame, twin_ids: tuple[int, ...] | None, strict: bool) -> Truth:
    mask = as_bytes(frame.mask())
    height, width = mask.shape
    ids = None if twin_ids is None else instance_ids_of(frame, (height, width))
    return Truth.of(mask, ids, twin_ids or (), outlines=strict)


def _volume(observation: Observation, cloud: NDArray[np.float32]) -> VolumeScore | None:
    """The 3D figures of a predicted cloud (N, 3); None where the dataset has no mesh, or the object moves."""
    if _moves(observation) or not observation.where(layout.SOUNDING_OBJECT).exists():
        return None
    mesh = observation.mesh()
    return score_points(cloud, true_volume(mesh.vertices, mesh.faces))


def _moves(observation: Observation) -> bool:
    """Whether the sounding object moves: then gt_3d holds it at the first frame, and points have no one truth."""
    record = observation.record
    return record is not None and any(map(record.source_moves, record.sound_sources))
