"""What the siblings of a group hear, and what all of them see, in one frame: all that questions are made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from avs3d_bench.contract.schema import FrameRecord, InstanceRecord, ObservationRecord
from avs3d_bench.dataset import Frame, Observation, by_pictures
from avs3d_bench.geometry import direction_to


@dataclass(frozen=True)
class QaSource:
    """A source that is audible in a frame; directions are from the listener.

    Attributes:
        instance: id; None off-screen.
        category: what it is.
        azimuth: degrees, positive right.
        lateral: degrees between the source and the median plane, positive right.
        distance: metres.
        level_db: of its own clip, dB re full scale.
        snr_db: above the rest of the clip; None if the rest is silent.
    """

    instance: int | None
    category: str
    azimuth: float
    lateral: float
    distance: float
    level_db: float
    snr_db: float | None


@dataclass(frozen=True)
class QaSibling:
    """The sound of one sibling in a frame.

    Attributes:
        key: of the observation.
        sources: those that are audible.
        silent: whether the observation has no source at all.
    """

    key: str
    sources: tuple[QaSource, ...]
    silent: bool


@dataclass(frozen=True)
class QaObject:
    """An object in view that could sound.

    Attributes:
        instance: id.
        category: what it is.
        azimuth: of its middle, degrees, positive right.
        elevation: of its middle, degrees.
        distance: of its middle, metres.
        share: of the picture that it covers.
        pixel: (column, row) of one of its pixels, near the middle of them.
    """

    instance: int
    category: str
    azimuth: float
    elevation: float
    distance: float
    share: float
    pixel: tuple[int, int]


@dataclass(frozen=True)
class QaMoment:
    """One frame of a group.

    Attributes:
        group: key of the observation whose pictures all siblings have.
        frame: its name.
        objects: in view, from left to right.
        siblings: by key.
    """

    group: str
    frame: str
    objects: tuple[QaObject, ...]
    siblings: tuple[QaSibling, ...]


def moment_of(frame: Frame, siblings: Sequence[Observation]) -> QaMoment:
    """The facts of a frame of a group.

    Args:
        frame: of any of the siblings.
        siblings: all of them, with their records.

    Raises:
        Avs3dError: if a record or the picture of instance ids is missing or damaged.
    """
    heard = []
    for each in siblings:
        record = each.record
        assert record is not None, "checked by the caller"
        entry = next(one for one in record.frames if one.name == frame.name)
        heard.append(QaSibling(each.key, tuple(_sources(record, entry)), not record.sound_sources))
    return QaMoment(frame.observation.group_key, frame.name, _objects(frame), tuple(heard))


def _sources(record: ObservationRecord, entry: FrameRecord) -> list[QaSource]:
    found = []
    for audible in entry.audible or ():
        source = record.source(audible.source)
        place = record.source_at(entry, source)
        where = direction_to(entry.pose, place)
        right = entry.pose.to_camera(np.asarray(place))[0]
        lateral = float(np.degrees(np.arcsin(np.clip(right / max(where.distance, 1e-9), -1, 1))))
        found.append(
            QaSource(
                source.instance, source.category, where.azimuth, lateral, where.distance, audible.level_db,
                audible.snr_db,
            )
        )  # fmt: skip
    return found


def _objects(frame: Frame) -> tuple[QaObject, ...]:
    record = frame.observation.record
    assert record is not None, "checked by the caller"
    ids = frame.instance_ids()
    known = {one.id: one for one in record.instances if one.category in record.class_ids}
    found = [_object(frame, known[number], ids == number) for number in np.unique(ids).tolist() if number in known]
    return tuple(sorted(found, key=lambda one: (one.pixel[0], one.instance)))


def _object(
    frame: Frame, instance: InstanceRecord, pixels: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
) -> QaObject:
    record, entry = frame.observation.record, frame.record
    assert record is not None, "checked by the caller"
    assert entry is not None, "a record has all frames"
    where = direction_to(frame.pose, record.middle_at(entry, instance))
    rows, columns = np.nonzero(pixels)
    nearest = int(np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2))
    return QaObject(
        instance.id, instance.category, where.azimuth, where.elevation, where.distance, float(pixels.mean()),
        (int(columns[nearest]), int(rows[nearest])),
    )  # fmt: skip


def groups_of(observations: Sequence[Observation]) -> Mapping[str, tuple[Observation, ...]]:
    """Group → its siblings among some observations, of groups with at least two; both sorted by key."""
    found = by_pictures(each for each in observations if each.is_part_3)
    return {group: found[group] for group in sorted(found) if len(found[group]) > 1}
