"""Which event is active where, every 100 ms: the labels of a recording.

The listener of a dataset stays at the position of a frame for the whole second of its clip, and a moving source goes in
a straight line from where it is at one full second to where it is at the next (`generators.acoustics.clips`). Labels
follow what is heard: position of the listener at the frame, position of the source in the middle of the 100 ms. The
head turns evenly from one frame's rotation to the next, if the sound is turned with it (`TurningHead`); the clips of
the two ears cannot be, and keep the rotation of their frame.

Angles as in DCASE: azimuth 0 ahead, positive to the **left**; elevation positive up; degrees from the head.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import FrameRecord, ObservationRecord, SourceRecord
from avs3d_bench.dataset import Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.geometry import Pose, ambisonic_axes

Array = NDArray[np.float64]

#: Label frames in a second, and the shortest sound in one that makes a source active in it: half of it (s).
LABELS_PER_SECOND = 10
HALF_A_LABEL = 0.05
#: Tolerance of that (s): 0.15 − 0.1 is a little less than 0.05 in floating point.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class SeldEvent:
    """One active source in one label frame.

    Attributes:
        frame: number of the label frame, from 0.
        class_index: of its category, see `event_classes`.
        source: number of the source in the observation, from 0.
        direction: (x, y, z) unit vector to it, axes of the head as AmbiX has them: forward, left, up.
        distance: metres.
    """

    frame: int
    class_index: int
    source: int
    direction: tuple[float, float, float]
    distance: float

    @property
    def azimuth(self) -> float:
        """Degrees, 0 ahead, positive to the left."""
        return math.degrees(math.atan2(self.direction[1], self.direction[0]))

    @property
    def elevation(self) -> float:
        """Degrees, positive up."""
        return math.degrees(math.asin(min(1.0, max(-1.0, self.direction[2]))))


@dataclass(frozen=True, eq=False)
class TurningHead:
    """Rotations of the listener's head over an observation.

    Attributes:
        poses: of its frames, one a second.
        turns: whether the head turns evenly to the rotation of the next frame; else it keeps that of its frame. After
            the last frame it stays.
    """

    poses: tuple[Pose, ...]
    turns: bool

    @classmethod
    def of(cls, frames: Sequence[FrameRecord], *, turns: bool) -> TurningHead:
        """The head of an observation's frames."""
        return cls(tuple(frame.pose for frame in frames), turns)

    def turn(self, second: int) -> Array:
        """(3,) rotation vector (radians, world axes) by which the head turns in a second: the shortest turn."""
        if not self.turns or second + 1 >= len(self.poses):
            return np.zeros(3)
        now, then = (Rotation.from_matrix(self.poses[number].rotation_matrix) for number in (second, second + 1))
        return np.asarray((then * now.inv()).as_rotvec())

    def turned_since(self, second: int, share: float) -> Array:
        """(3, 3) what a vector of the head of full second ``second`` is for the head a ``share`` of a second later.

        Axes of the head: x right, y up, z back.
        """
        start = self.poses[second].rotation_matrix
        turned = Rotation.from_rotvec(share * self.turn(second)).as_matrix()
        return np.asarray((turned @ start).T @ start)


def event_classes(own: Sequence[str], categories: Sequence[str]) -> dict[str, int]:
    """Category → class index, from 0: the seven of the benchmark, then those that the dataset adds.

    Args:
        own: categories that the dataset adds, in the order of their class ids.
        categories: the seven.
    """
    return {name: number for number, name in enumerate((*categories, *own))}


def seconds_of(record: ObservationRecord) -> int:
    """Seconds of a recording: all of the observation, without the last one if a source moves.

    observation.json does not have the place of what moves at the end of the last second.

    Raises:
        UsageError: if nothing is left.
    """
    count = len(record.frames) - (1 if any(map(record.source_moves, record.sound_sources)) else 0)
    if count < 1:
        raise UsageError(f"{record.key}: one frame with a moving source; expected two or more")
    return count


def record_of(observation: Observation) -> ObservationRecord:
    """The truth of an observation.

    Raises:
        UsageError: if it is not published.
    """
    record = observation.record
    if record is None:
        sealed = (observation.path / layout.POSES_JSON).exists()
        why = "its truth is sealed" if sealed else "it has no observation.json, as in the official release"
        raise UsageError(
            f"{observation.path}: {why}, so that no event can be labelled; export a dataset that "
            "`avs3d generate` has made"
        )
    return record


def events_of(record: ObservationRecord, classes: dict[str, int], head: TurningHead) -> tuple[SeldEvent, ...]:
    """All events of an observation, in the order of time and of their sources.

    A source is active in a label frame if its programme covers half of the frame and it is audible in that second
    (`FrameRecord.audible`). Sources in other rooms have no object and no class; their sound comes through doors, not
    along the straight line. They are no events.

    Args:
        record: of the observation.
        classes: category → class index.
        head: the listener's.
    """
    events = []
    for second in range(seconds_of(record)):
        frame = record.frames[second]
        heard = {source.id for source in record.audible_sources(frame)}
        for part in range(LABELS_PER_SECOND):
            share = (part + 0.5) / LABELS_PER_SECOND
            turned = head.turned_since(second, share)
            for number, source in enumerate(record.sound_sources):
                if source.instance is None or source.id not in heard:
                    continue
                if not _sounds(source, second + share):
                    continue
                vector = frame.pose.to_camera(_position(record, source, second, share))
                distance = float(np.linalg.norm(vector))
                x, y, z = (float(c) for c in ambisonic_axes(turned @ (vector / max(distance, 1e-9))))
                events.append(
                    SeldEvent(second * LABELS_PER_SECOND + part, classes[source.category], number, (x, y, z), distance)
                )
    return tuple(events)


def _sounds(source: SourceRecord, middle: float) -> bool:
    """Whether the programme covers half of the label frame about a time."""
    low, high = middle - HALF_A_LABEL, middle + HALF_A_LABEL
    covered = sum(max(0.0, min(end, high) - max(start, low)) for start, end in source.programme)
    return covered >= HALF_A_LABEL - _ROUNDING


def _position(record: ObservationRecord, source: SourceRecord, second: int, share: float) -> Array:
    """Where a source is, (3,) metres in the world."""
    if not record.source_moves(source):
        return np.asarray(source.position, dtype=np.float64)
    start, end = (np.asarray(record.source_at(record.frames[number], source)) for number in (second, second + 1))
    return np.asarray(start + share * (end - start))
