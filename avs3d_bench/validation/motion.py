"""The checks of objects that move: rigid bodies, continuous ways, no point in sparse/0."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import InstanceRecord, ObservationRecord
from avs3d_bench.dataset import Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.colmap import ColmapModel
from avs3d_bench.geometry import Pose, rotation_angle

#: How far poses of the first frame, and the source from its place on the object, may be off: metres, degrees.
TOLERANCE = (2e-3, 0.05)
#: Nothing in a home moves faster, m/s.
MOST_SPEED = 1.0


def motion_problems(record: ObservationRecord) -> Iterator[tuple[str, str]]:
    """Problems of the paths of what moves, as (path, message).

    A path must begin where the record says, be continuous, and carry the source as one body.
    """
    where = layout.OBSERVATION_JSON
    for instance in record.instances:
        if instance.id in record.moving_instances:
            yield from ((where, text) for text in _path_problems(record, instance))
    if not record.is_part_3:
        # In part_3 the place of a source follows from that of its instance.
        yield from ((where, text) for text in _source_problems(record))


def _path_problems(record: ObservationRecord, instance: InstanceRecord) -> Iterator[str]:
    metres, degrees = TOLERANCE
    before = record.frames[0]
    last, own = record.pose_at(before, instance.id), Pose(instance.position, instance.rotation)
    shift = float(np.linalg.norm(np.subtract(last.position, own.position)))
    if shift > metres or rotation_angle(last, own) > degrees:
        yield f"frames[0]: position and rotation of instance {instance.id} differ from those in instances"
    for number, frame in enumerate(record.frames):
        now = record.pose_at(frame, instance.id)
        step = float(np.linalg.norm(np.subtract(now.position, last.position)))
        if number and step > MOST_SPEED * (frame.time - before.time) + metres:
            text = f"frames[{number}]: instance {instance.id} is {step:.2f} m from where it was one frame before"
            yield f"{text}; expected a way of at most {MOST_SPEED:g} m/s"
        before, last = frame, now


def _source_problems(record: ObservationRecord) -> Iterator[str]:
    if record.source_position is None:
        return
    metres, _ = TOLERANCE
    shift = float(np.linalg.norm(np.subtract(record.source_at(record.frames[0]), record.source_position)))
    if shift > metres:
        yield f"source_position is {shift:.3f} m from that of frames[0]; expected the same"
    for number, frame in enumerate(record.frames):
        (expected,) = record.to_frame(frame, np.asarray([record.source_position]))
        off = float(np.linalg.norm(np.asarray(record.source_at(frame)) - expected))
        if off > metres:
            yield f"frames[{number}].source_position is {off:.3f} m off its place on the sounding instance"


def moving_points(observation: Observation, model: ColmapModel) -> tuple[int, int]:
    """How many sightings of sparse/0 fall inside the masks of what moves (0 is right), and how many there are.

    A point on it would be in no one place, and what it hides must not be seen through it.
    """
    wrong = total = 0
    for image in model.images:
        frame = next((f for f in observation.frames if f"{f.name}.png" == image.name), None)
        pixels = image.pixels[image.point_ids >= 0]
        if frame is None or not len(pixels):
            continue
        try:
            mask = _moving_mask(observation, frame)
        except Avs3dError:
            continue  # already named
        # A ray beside the outline may pass the object while the pixel's centre meets it.
        inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8), borderValue=0)
        column, row = np.floor(pixels).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
        wrong += int(inner[row[inside], column[inside]].sum())
        total += len(pixels)
    return wrong, total


def _moving_mask(observation: Observation, frame: Frame) -> NDArray[np.bool_]:
    """(H, W) where a frame shows what moves."""
    record = observation.record
    if record is None or not record.is_part_3:
        return frame.mask()
    return np.isin(frame.instance_ids(), record.moving_instances)
